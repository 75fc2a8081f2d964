/* SPDX-License-Identifier: MIT
 * topics.c - the topics of `help` besides commands and options. The man pages say the same. */
#include "cli/cli.h"

static const struct topic_row exit_codes[] = {
    { "0", "Success." },
    { "1", "Failed; for example, the result could not be written." },
    { "2", "Wrong usage: an unknown command, option, method, material or knob, a value out of range, a mesh without a unit." },
    { "3",
      "Bad input: a file is missing, damaged, of an unknown format, over a limit, or can't be written; `check` found a problem that is an "
      "error." },
    { "4", "The requested engine or device is not available." },
    { "5", "Out of memory, or over the limit memory-bytes." },
    { "75", "Ended by a time limit, SIGTERM or SIGHUP, and resumable from its checkpoint." },
    { "130", "Interrupted (Ctrl-C). Nothing half-written is left; a second Ctrl-C stops at once." },
    { NULL, NULL },
};

static const struct topic_row noises[] = {
    { "relative error",
      "Printed by `path-trace` and limited by --target-error: the standard error of a pixel's luminance divided by its luminance (at least "
      "1 % of the image's mean), as a root mean square over all pixels of the image." },
    { "noise of a reference",
      "Printed by `compare`: the root of the reference's variance as a relative mean squared error, over the compared (translucent) pixels "
      "and for the subsurface light only. It is subtracted from the errors of methods." },
    { NULL, NULL },
};

static const struct topic_row variables[] = {
    { "NO_COLOR", "If set and not empty, disables colours. They are also disabled if the output is no terminal or TERM is dumb." },
    { "PELL_SHADERS", "A folder whose files NAME.spv replace the shaders of --engine vulkan; changed files are reloaded. --log-level debug "
                      "lists the names." },
    { "PELL_EMBREE",
      "more configuration of the ray library, in its own words: max_isa=avx2 traces rays as on a processor without AVX-512." },
    { "PELL_SIMD", "base, v2, v3 or v4: the highest level of SIMD instructions to use. Results are bit-identical at all levels." },
    { NULL, NULL },
};

static const struct topic_row files[] = {
    { "PREFIX/share/pellucid/bench", "The scenes of `bench`." },
    { "PREFIX/share/pellucid/examples", "Scene files to start from." },
    { NULL, NULL },
};

const struct topic cli_topics[] = {
    { "lengths", "how to write lengths",
      "A length always has a unit: 70mm, 7cm, 0.07m, 2in. A bare number is refused: light penetrates an object by a length in mm, and "
      "without a scale the image would be arbitrary.\n"
      "\n"
      "--size 70mm is the largest extent of the object, --unit 1mm the length of one unit of its file. The unit of glTF is the metre; OBJ, "
      "PLY and STL have none.\n",
      "|units|unit|length|size|sizes|scale|millimetres|mm|", NULL },
    { "scenes", "the contents of a scene file",
      "A scene file is JSON: meshes with their unit, materials by name, lights, a camera, a background, and options of the command line "
      "(\"render\"). Only the mesh is required. `pellucid view` can save a scene file.\n"
      "\n"
      "  {\n"
      "    \"pellucid\": 1,\n"
      "    \"mesh\": \"bunny.obj\",\n"
      "    \"size\": \"7cm\",\n"
      "    \"lights\": [{ \"studio\": \"rim\" }],\n"
      "    \"materials\": {\n"
      "      \"*\": { \"preset\": \"wholemilk\" }\n"
      "    }\n"
      "  }\n"
      "\n"
      "`pellucid check scene.json` lists the problems of a scene file with their locations. Other files must be in the scene's own folder "
      "or below it; --allow-outside lifts this restriction.\n",
      "|scene|scene-file|scene file|scene files|", NULL },
    { "knobs", "settings of a method",
      "A knob is a setting of one method, a number, a name or a switch: --set NAME=VALUE, or \"knobs\" in a scene file. `pellucid methods "
      "NAME` lists the knobs of a method with their ranges and defaults; as=paper sets all of them as in the method's paper. Settings "
      "common to all methods (--width, --msaa, --bounces) are options: `pellucid render --help`.\n",
      "|knob|settings|setting|parameters|parameter|set|", NULL },
    { "output", "standard output, standard error and files",
      "Results go to standard output, messages and progress to standard error. With --json standard output holds exactly one JSON object; "
      "after a failure it is {\"error\": {\"code\", \"where\", \"what\", \"hint\"}}. Files are written atomically: an existing file is "
      "replaced only when the new one is complete.\n",
      "|stdout|stderr|streams|errors|json|", NULL },
    { "layers", "layers in material files and in scene files",
      "Layers can be defined in two kinds of files, for two purposes.\n"
      "\n"
      "A material file (--material FILE, `profile --layers FILE`) "
      "has \"layers\" with a \"thickness_mm\" each, a number, or \"infinite\" in the last: a stack of uniform layers. A scene file's "
      "material has \"layers\" with a \"depth\" each, the distance from the surface to the bottom of the layer: a length with its unit "
      "(\"1.5mm\"), or an image that varies it over the surface. Every method renders both; `layered` resolves the depth maps of the "
      "second. `bake-layers` computes depth maps from meshes inside a mesh.\n",
      "|layer|stacks|stack|", NULL },
    { "noise", "two measures of noise, and where each is printed",
      "Both are inversely proportional to the square root of the number of samples. The second is larger if a background without noise "
      "fills much of the image.\n",
      "|variance|error bars|", noises },
    { "exit-codes", "exit codes of the program", "",
      "|exit-code|exit codes|exit code|exitcodes|exit|codes|code|exit status|status|return code|return codes|", exit_codes },
    { "environment", "environment variables", "", "|variables|variable|env|environment variables|", variables },
    { "files", "installed files", "", "|file|folders|paths|installed|", files },
    { NULL, NULL, NULL, NULL, NULL },
};
