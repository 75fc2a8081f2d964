/* SPDX-License-Identifier: MIT
 * topics.c - what `help` knows beside commands and options. The man pages say the same. */
#include "cli/cli.h"

static const struct topic_row exit_codes[] = {
    { "0", "Success." },
    { "1", "Failed: the answer could not be written, for example." },
    { "2", "Wrong usage: an unknown command, option, method, material or knob, a value out of range, a mesh without a unit." },
    { "3",
      "Bad input: a file is missing, damaged, of an unknown format, over a limit, or can't be written; `check` found a problem that is an "
      "error." },
    { "4", "The engine or device asked for is not there." },
    { "5", "Out of memory, or over the limit memory-bytes." },
    { "75", "Ended by a time limit or SIGTERM, and resumable from its checkpoint." },
    { "130", "Interrupted (Ctrl-C). Nothing half-written is left; a second Ctrl-C stops at once." },
    { NULL, NULL },
};

static const struct topic_row noises[] = {
    { "relative error",
      "Of `path-trace`, and what --target-error asks for: the root mean square, over all pixels of the image, of the standard error of a "
      "pixel's luminance divided by its luminance (at least 1 % of the image's mean)." },
    { "noise of a reference",
      "Of `compare`: the root of the reference's variance as a relative mean squared error, over the pixels that are compared, which are "
      "translucent, and of the subsurface light alone. It is subtracted from the errors of methods." },
    { NULL, NULL },
};

static const struct topic_row variables[] = {
    { "NO_COLOR", "If set and not empty: no colours. There are none either where the output is no terminal, or TERM is dumb." },
    { "PELL_SHADERS", "A folder whose files NAME.spv replace the shaders of --engine vulkan, and are read again when they change. "
                      "--log-level debug lists the names." },
    { "PELL_SIMD", "base, v2, v3 or v4: the highest level of vector instructions to use. All levels give the same bits." },
    { NULL, NULL },
};

static const struct topic_row files[] = {
    { "PREFIX/share/pellucid/bench", "The scenes of `bench`." },
    { "PREFIX/share/pellucid/examples", "Scene files to start from." },
    { NULL, NULL },
};

const struct topic cli_topics[] = {
    { "lengths", "what a length looks like",
      "A length always carries its unit: 70mm, 7cm, 0.07m, 2in. A bare number is refused: how deep light goes into an object is a length, "
      "and without a scale the picture would be arbitrary.\n"
      "\n"
      "--size 70mm is the largest extent of the object, --unit 1mm the length of one unit of its file. The unit of glTF is the metre; OBJ, "
      "PLY and STL have none.\n",
      "|units|unit|length|size|sizes|scale|millimetres|mm|", NULL },
    { "scenes", "what a scene file holds",
      "A scene file is JSON: meshes with their unit, materials by name, lights, a camera, a background, and what the command line would "
      "say (\"render\"). Every part but the mesh may be missing. What `pellucid view` saves is one.\n"
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
      "`pellucid check scene.json` says what is wrong with one, and where. Files are looked for in the scene's own folder; --allow-outside "
      "lets it name others.\n",
      "|scene|scene-file|scene file|scene files|", NULL },
    { "knobs", "how methods are set",
      "A knob is a number, a name or a switch of one method: --set NAME=VALUE, or \"knobs\" in a scene file. `pellucid methods NAME` lists "
      "those of a method with their ranges and defaults; as=paper sets all of them as in the method's paper. What holds for every method "
      "(--width, --msaa, --bounces) is an option of its own: `pellucid render --help`.\n",
      "|knob|settings|setting|parameters|parameter|set|", NULL },
    { "output", "what goes where",
      "Results go to standard output, messages and progress to standard error. With --json standard output holds exactly one JSON object, "
      "which is {\"error\": {\"code\", \"where\", \"what\", \"hint\"}} after a failure. A file is written under a temporary name and "
      "renamed when "
      "it is whole; what was there before stays until then.\n",
      "|stdout|stderr|streams|errors|json|", NULL },
    { "layers", "two files that have them",
      "Stacks of layers are written in two places, which are for two kinds of work.\n"
      "\n"
      "A material file (--material FILE, `profile --layers FILE`) has \"layers\" with a \"thickness_mm\" each, a number, and \"infinite\" "
      "in "
      "the last: a flat stack, which is the same everywhere. A scene file's material has \"layers\" with a \"depth\" each, a text with its "
      "unit (\"1.5mm\") or an image: how far below the surface the layer ends, which may differ from place to place. Every method "
      "renders both; `layered` shows what is painted into the second. `bake-layers` makes the images of the second from meshes inside a "
      "mesh.\n",
      "|layer|stacks|stack|", NULL },
    { "noise", "two measures of it, and which is printed where",
      "Both fall as 1 over the root of the number of samples. The second is larger where a background without noise fills much of the "
      "image.\n",
      "|variance|error bars|", noises },
    { "exit-codes", "what a program that ends has to say", "",
      "|exit-code|exit codes|exit code|exitcodes|exit|codes|code|exit status|status|return code|return codes|", exit_codes },
    { "environment", "variables that are read", "", "|variables|variable|env|environment variables|", variables },
    { "files", "what is installed", "", "|file|folders|paths|installed|", files },
    { NULL, NULL, NULL, NULL, NULL },
};
