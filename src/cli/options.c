/* SPDX-License-Identifier: MIT
 * options.c - the command line: one table of options, of which each command accepts some groups; render settings come from
 * pell_settings_knobs(), so that each has one row. */
#include "cli/cli.h"

#include <pellucid/compare.h>
#include <pellucid/kernel.h>

#include <popt.h>
#include <stdlib.h>
#include <string.h>

#define NUMBER(field) offsetof(struct cli, numbers.field) - offsetof(struct cli, numbers)
/* clang-format off */
static const struct pell_knob number_knobs[] = {
    { "threads", PELL_KNOB_INT, "1", NUMBER(threads), { 0 }, 0, 256, NULL, "number of threads; 0: one per core" },
    { "turntable", PELL_KNOB_INT, "1", NUMBER(turntable), { 0 }, 0, 100000, NULL,
      "number of views around the object, numbered before the file name's extension, all exposed as the first; 0: one image" },
    { "repeats", PELL_KNOB_INT, "1", NUMBER(repeats), { 15 }, 1, 10000, NULL, "warm frames; times are their median" },
    { "points", PELL_KNOB_INT, "1", NUMBER(points), { 0 }, 0, 4096, NULL, "radii, evenly spaced in log r; 0: 13 in a table, 64 elsewhere" },
    { "taps", PELL_KNOB_INT, "1", NUMBER(taps), { 25 }, 3, PELL_KERNEL_TAPS_MAX, NULL,
      "taps of the separable kernel that --export writes, an odd number" },
    { "rank", PELL_KNOB_INT, "1", NUMBER(rank), { 1 }, 1, PELL_KERNEL_RANK_MAX, NULL,
      "separable terms of that kernel, each of two passes; more terms have less error" },
    { "port", PELL_KNOB_INT, "1", NUMBER(port), { 0 }, 0, 65535, NULL, "TCP port of the page; 0: any free port" },
    { "map-size", PELL_KNOB_INT, "texels", NUMBER(map_size), { 1024 }, 8, 8192, NULL, "texels along a side of the maps" },
    {0},
};
/* clang-format on */
#undef NUMBER

enum kind { HELP, VERSION, FLAG, TEXT, LEVEL, KNOB, LIMIT, NUMBER, SETTING, COMMON, INNER };

struct option {
    unsigned groups; /* the option belongs to any of these groups */
    char letter;
    const char *name, *argument, *help;
    enum kind kind;
    size_t offset;                /* FLAG, TEXT: offset of the field in struct cli */
    const struct pell_knob *knob; /* NUMBER, SETTING: its knob, which also has the help */
};

#define AT(field) offsetof(struct cli, field)
static const struct option options[] = {
    { OPTIONS_SCENE, 0, "material", "NAME|FILE", "material of all objects: a built-in name (`pellucid materials`) or a material file", TEXT,
      AT(material), NULL },
    { OPTIONS_BAKE, 0, "inner", "NAME=FILE",
      "a closed mesh inside INPUT, of the same unit, and the name of its layers; repeatable; where meshes overlap, the last counts", INNER,
      0, NULL },
    { OPTIONS_BAKE, 0, "map-size", "N", NULL, NUMBER, 0, &number_knobs[7] },
    { OPTIONS_BAKE, 0, "down-to", "LENGTH", "maximum depth of the rays: 5mm; default: to the other side", TEXT, AT(check.down_to), NULL },
    { OPTIONS_BAKE, 'o', "output", "FOLDER", "folder for the maps (EXR, 32 bit, in mm) and scene.json, which refers to them", TEXT,
      AT(output), NULL },
    { OPTIONS_SCENE | OPTIONS_BAKE, 0, "size", "LENGTH", "largest extent of the object, with its unit: 70mm", TEXT, AT(size), NULL },
    { OPTIONS_SCENE | OPTIONS_BAKE, 0, "unit", "LENGTH", "length of one unit of the mesh file: 1mm", TEXT, AT(unit), NULL },
    { OPTIONS_SCENE, 0, "camera", "NAME", "a camera of the file; default: its first, or one that frames the object", TEXT, AT(camera),
      NULL },
    { OPTIONS_SCENE, 0, "time", "SECONDS", "time of the animation of glTF files; default: the scene file's, or no animation", TEXT,
      AT(time), NULL },
    { OPTIONS_SCENE, 0, "animation", "NAME|NUMBER", "animation, by its name or its number from 0; default: the first", TEXT, AT(animation),
      NULL },
    { OPTIONS_SCENE | OPTIONS_BENCH, 0, "allow-outside", NULL, "let files refer to files outside the scene's folder", FLAG,
      AT(allow_outside), NULL },
    { OPTIONS_SCENE | OPTIONS_BENCH | OPTIONS_REPEATS | OPTIONS_PROFILE | OPTIONS_COMPARE | OPTIONS_BAKE, 0, "limit", "NAME=VALUE",
      "raise or lower a limit (`pellucid info` lists them); repeatable", LIMIT, 0, NULL },
    { OPTIONS_METHOD, 'm', "method", "NAME", "scattering method (`pellucid methods`); none: no scattering", TEXT, AT(method), NULL },
    { OPTIONS_CHOICE, 0, "max-error", "PERCENT",
      "use the cheapest method whose error plus its standard error is at most this, measured on a small image against path-trace; "
      "-m auto: 8%",
      TEXT, AT(max_error), NULL },
    { OPTIONS_METHOD | OPTIONS_COMPARE, 0, "set", "KNOB=VALUE", "a knob of the method (`pellucid methods NAME`); repeatable", KNOB, 0,
      NULL },
    { OPTIONS_METHOD, 0, "samples", "N", "number of samples of the method (its knob samples, or most)", COMMON, 0, NULL },
    { OPTIONS_METHOD, 0, "time-limit", "TIME", "stop a progressive reference after this time: 30s, 5min or 2h (its knob time-limit)",
      COMMON, 0, NULL },
    { OPTIONS_METHOD, 0, "target-error", "PERCENT", "render until the noise of a reference is below this: 1% (its knob error)", COMMON, 0,
      NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_CHECK | OPTIONS_VIEW, 0, "up", "AXIS",
      "axis of a mesh file that points upwards: y (default) or z", TEXT, AT(up), NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_CHECK | OPTIONS_VIEW, 0, "normals", "NAME",
      "normals of meshes: file; smooth, which recomputes them with creases where triangles meet at more than 60 degrees; or flat: those "
      "of the triangles",
      TEXT, AT(normals), NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_CHECK | OPTIONS_VIEW, 0, "thicken", "LENGTH",
      "give open surfaces, as leaves, shells and cloth, this thickness: 0.5mm", TEXT, AT(thicken), NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_VIEW, 0, "from", "SIDE",
      "frame the object from front, back, left, right, top, 34 (from the right and above), or AZIMUTH,ELEVATION in degrees: 35,15", TEXT,
      AT(from), NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_VIEW, 0, "studio", "NAME",
      "lights that replace the file's: soft (default if it has none), rim (two from behind), back (backlit), window (from the left, with a "
      "floor)",
      TEXT, AT(studio), NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_VIEW, 0, "environment", "FILE",
      "equirectangular image (hdr, exr or another) that replaces the file's lights and is the background", TEXT, AT(environment), NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_VIEW, 0, "environment-rotate", "DEGREES",
      "rotate the environment about the vertical axis "
      "by this angle",
      TEXT, AT(environment_rotate), NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_VIEW, 0, "environment-scale", "FACTOR",
      "multiply the environment's radiance by this "
      "factor; default 1",
      TEXT, AT(environment_scale), NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_VIEW, 0, "background", "COLOUR",
      "background: #RRGGBB, white, grey, black, transparent or "
      "environment",
      TEXT, AT(background), NULL },
    { OPTIONS_FILE | OPTIONS_COMPARE | OPTIONS_VIEW, 0, "ground", NULL,
      "put the object on a grey ground: a floor with a curved backdrop, or with an environment a round table", FLAG, AT(ground), NULL },
    { OPTIONS_FILE, 0, "checkpoint", "FILE",
      "file for the state of path-trace; a run that finds the file resumes it; the result is "
      "bit-identical",
      TEXT, AT(checkpoint), NULL },
    { OPTIONS_FILE, 0, "checkpoint-every", "TIME",
      "interval between writes of the checkpoint, which is also written at the end and at "
      "Ctrl-C; default 60s",
      TEXT, AT(checkpoint_every), NULL },
    { OPTIONS_PARTS, 0, "sample-range", "A:B|I/N",
      "render only samples A to B - 1 of every pixel, or part I (from 0) of N equal parts, into the checkpoint; see `pellucid merge`", TEXT,
      AT(part.samples), NULL },
    { OPTIONS_PARTS, 0, "tile-range", "A:B|I/N",
      "render only tiles A to B - 1 of 8 x 8 pixels, in rows from the top, or part I of N, into the checkpoint", TEXT, AT(part.tiles),
      NULL },
    { OPTIONS_PARTS, 0, "frame-range", "A:B|I/N", "render only images A to B - 1 of --frames or --turntable, or part I of N", TEXT,
      AT(part.frames), NULL },
    { OPTIONS_COMPARE, 0, "scene-range", "A:B|I/N", "compare only scenes A to B - 1 of a list, or part I (from 0) of N", TEXT,
      AT(part.scenes), NULL },
    { OPTIONS_MERGE, 0, "partial", NULL, "accept gaps; pixels with fewer samples have larger error bars", FLAG, AT(part.partial), NULL },
    { OPTIONS_MERGE, 0, "input", "FILE", "the scene or mesh, if its path differs from that stored in the parts", TEXT, AT(part.input),
      NULL },
    { OPTIONS_MERGE, 0, "checkpoint", "FILE", "file for the merged state, which a render can resume and another merge can read", TEXT,
      AT(checkpoint), NULL },
    { OPTIONS_MERGE, 0, "allow-outside", NULL, "let the scene refer to files outside its folder", FLAG, AT(allow_outside), NULL },
    { OPTIONS_MERGE, 'o', "output", "FILE", "png, exr, hdr or pfm by its extension", TEXT, AT(output), NULL },
    { OPTIONS_MERGE, 0, "format", "FORMAT", "png, exr, hdr or pfm, whatever the extension", TEXT, AT(format), NULL },
    { OPTIONS_FILE, 'o', "output", "FILE",
      "png, exr, hdr or pfm by its extension; - writes to stdout, with --format; default: INPUT's name with .png, in the current folder",
      TEXT, AT(output), NULL },
    { OPTIONS_FILE, 0, "format", "FORMAT", "png, exr, hdr or pfm, whatever the extension", TEXT, AT(format), NULL },
    { OPTIONS_FILE, 0, "turntable", "N", NULL, NUMBER, 0, &number_knobs[1] },
    { OPTIONS_FILE, 0, "frames", "FROM:TO:STEP",
      "images of the animation at times in seconds, numbered before the file name's extension, with the exposure of the first", TEXT,
      AT(frames), NULL },
    { OPTIONS_FILE, 0, "dump", "FOLDER",
      "folder for the intermediate images of the frame's first sample, as EXR, with index.json; replaces an earlier dump there", TEXT,
      AT(dump), NULL },
    { OPTIONS_FILE, 0, "stats", NULL, "print a table of stage times on stderr", FLAG, AT(stats), NULL },
    { OPTIONS_BENCH | OPTIONS_REPEATS, 0, "repeats", "N", NULL, NUMBER, 0, &number_knobs[2] },
    { OPTIONS_PROFILE, 0, "model", "NAME", "profile model: dipole (default), or another of the list above", TEXT, AT(profile.model), NULL },
    { OPTIONS_PROFILE, 0, "compare", "NAMES", "models to compare with it: names separated by commas, or all", TEXT, AT(profile.compare),
      NULL },
    { OPTIONS_PROFILE, 0, "gaussians", "K[,K]",
      "number of Gaussians of the fit, 1 to 10, default 4: each channel has its own variances and keeps its energy; several numbers, "
      "separated by commas, are compared; 0: no fit",
      TEXT, AT(profile.gaussians), NULL },
    { OPTIONS_PROFILE, 0, "shared", NULL, "one set of variances for the three channels, so that one blur serves all", FLAG,
      AT(profile.shared), NULL },
    { OPTIONS_PROFILE, 0, "free", NULL,
      "do not constrain the fit's energy: smaller errors and less light; for the dipole up to 12 % with separate variances, else more",
      FLAG, AT(profile.free_energy), NULL },
    { OPTIONS_PROFILE, 0, "eta", "X", "index of refraction, 0.25 to 4, instead of the material's", TEXT, AT(profile.eta), NULL },
    { OPTIONS_PROFILE, 0, "roughness", "X", "roughness of the boundary, 0 to 1; default: smooth", TEXT, AT(profile.roughness), NULL },
    { OPTIONS_PROFILE, 0, "layers", "FILE",
      "a stack of layers instead of MATERIAL: a material file with layers, or a built-in layered material", TEXT, AT(profile.layers),
      NULL },
    { OPTIONS_PROFILE, 0, "skin", "N=V,N=V",
      "skin instead of MATERIAL: melanin, melanin-blend, haemoglobin, oxygenation, eta, epidermis (a length); default: light skin", TEXT,
      AT(profile.skin), NULL },
    { OPTIONS_PROFILE, 0, "wavelength", "LENGTH", "epidermis, dermis and both of that skin at one wavelength, 380nm to 780nm", TEXT,
      AT(profile.wavelength), NULL },
    { OPTIONS_PROFILE, 0, "solver", "NAME", "solver of layers: hankel (default), gaussian, analytic, or all to compare them", TEXT,
      AT(profile.solver), NULL },
    { OPTIONS_PROFILE, 0, "from", "LENGTH", "the smallest radius, with its unit: 0.01mm", TEXT, AT(profile.from), NULL },
    { OPTIONS_PROFILE, 0, "to", "LENGTH", "the largest radius: 30mm", TEXT, AT(profile.to), NULL },
    { OPTIONS_PROFILE, 0, "points", "N", NULL, NUMBER, 0, &number_knobs[3] },
    { OPTIONS_PROFILE, 0, "weighted", NULL, "plot 2 pi r R(r), the light that leaves per mm of radius, on linear axes", FLAG,
      AT(profile.weighted), NULL },
    { OPTIONS_PROFILE, 0, "csv", NULL, "write the table as comma-separated values, which `profile` can read", FLAG, AT(profile.csv), NULL },
    { OPTIONS_PROFILE, 0, "export", "LANGUAGE", "c, glsl, hlsl or json: the fit, a separable kernel and a table to paste into an engine",
      TEXT, AT(profile.export), NULL },
    { OPTIONS_PROFILE, 0, "taps", "N", NULL, NUMBER, 0, &number_knobs[4] },
    { OPTIONS_PROFILE, 0, "rank", "N", NULL, NUMBER, 0, &number_knobs[5] },
    { OPTIONS_PROFILE, 'o', "output", "FILE",
      "file for the plot: svg, pdf or png by its extension; with --csv or --export: file for that text (default: stdout)", TEXT, AT(output),
      NULL },
    { OPTIONS_COMPARE, 0, "methods", "NAMES",
      "methods to compare on a scene, separated by commas, each optionally with knobs (screen-space:gaussians=6); all: every method that "
      "is not a reference (default); none: no scattering",
      TEXT, AT(compare.methods), NULL },
    { OPTIONS_COMPARE, 0, "reference", "NAME[,NAME]",
      "reference of the methods, default hierarchical; with a second one, the first is measured against it: the error of the model", TEXT,
      AT(compare.reference), NULL },
    { OPTIONS_COMPARE, 0, "decompose", NULL,
      "for methods on a scene, split the error against path-trace into direct light and interreflection between surfaces; renders "
      "everything a second time without bounces",
      FLAG, AT(compare.decompose), NULL },
    { OPTIONS_COMPARE, 0, "layer", "NAME",
      "for two OpenEXR files, the layer to compare: subsurface (diffuse.single + diffuse.multiple + transmission; default if both "
      "have them), diffuse.multiple, or another; R,G,B (default otherwise) is all light",
      TEXT, AT(compare.layer), NULL },
    { OPTIONS_COMPARE, 0, "mask", "FILE|NAME",
      "for two images, the pixels to compare: where the image FILE is above 0.5; or alpha or translucent of the reference (default if it "
      "has one); or none: all pixels",
      TEXT, AT(compare.mask), NULL },
    { OPTIONS_COMPARE, 0, "half", "FILE",
      "for two images, the second half of the reference, with equal samples and another seed: both are averaged and their noise is "
      "subtracted",
      TEXT, AT(compare.half), NULL },
    { OPTIONS_COMPARE, 'o', "output", "FOLDER",
      "folder for report.html, metrics.json, error maps of two images, or for a scene every image as EXR with its errors", TEXT, AT(output),
      NULL },
    { OPTIONS_CHECK, 0, "cross-section", "FILE", "plot of the layers below a line on the surface: svg, pdf or png by its extension", TEXT,
      AT(check.cross_section), NULL },
    { OPTIONS_CHECK, 0, "line", "U,V,U,V",
      "line of the cross-section in texture coordinates of the depth maps; 0,0 is the upper left corner; default 0,0.5,1,0.5", TEXT,
      AT(check.line), NULL },
    { OPTIONS_CHECK, 0, "down-to", "LENGTH", "depth of the cross-section: 2mm; default: the deepest layer", TEXT, AT(check.down_to), NULL },
    { OPTIONS_CHECK, 0, "layers-of", "NAME", "material of the cross-section; default: the first with texture-mapped layers", TEXT,
      AT(check.layers_of), NULL },
    { OPTIONS_VIEW, 0, "port", "N", NULL, NUMBER, 0, &number_knobs[6] },
    { OPTIONS_VIEW, 0, "listen", "ADDRESS",
      "network address that the page is served on, for other machines; default: 127.0.0.1, reachable only from this machine", TEXT,
      AT(view.listen), NULL },
    { OPTIONS_VIEW, 0, "token-file", "FILE",
      "file that stores the token, created if missing. With it and --port, open pages reconnect when the program is restarted", TEXT,
      AT(view.token_file), NULL },
    { OPTIONS_VIEW, 0, "end-after", "TIME",
      "end when no page has been open for this time: 8h; default: 10min, and 1h before the first page", TEXT, AT(view.end_after), NULL },
    { OPTIONS_VIEW, 0, "no-open", NULL, "print the address without opening a browser", FLAG, AT(view.no_open), NULL },
    { OPTIONS_ENGINE, 0, "engine", "NAME", "compute engine: auto, cpu or vulkan", TEXT, AT(engine), NULL },
    { OPTIONS_ENGINE, 0, "device", "N|NAME", "Vulkan device, by its number in `pellucid info` or a part of its name", TEXT, AT(device),
      NULL },
    { OPTIONS_ENGINE | OPTIONS_BAKE, 0, "threads", "N", NULL, NUMBER, 0, &number_knobs[0] },
    { OPTIONS_ALL, 0, "json", NULL, "print the result as one JSON object on stdout", FLAG, AT(json), NULL },
    { OPTIONS_PARTS | OPTIONS_MERGE, 0, "progress", "FORM", "text (default), or json: one object per second on stderr, one per line", TEXT,
      AT(progress_form), NULL },
    { OPTIONS_ALL, 'q', "quiet", NULL, "print only errors on stderr", FLAG, AT(quiet), NULL },
    { OPTIONS_ALL, 0, "log-level", "LEVEL", "none, error, warning, info (default) or debug", LEVEL, 0, NULL },
    { OPTIONS_ALL, 'h', "help", NULL, "print this text", HELP, 0, NULL },
    { OPTIONS_ALL, 'V', "version", NULL, "print the version of the program", VERSION, 0, NULL },
};
#undef AT

#define MAX_OPTIONS 96
#define ON_OFF "on|off"

static const char *argument_of(const struct pell_knob *k)
{
    return k->type == PELL_KNOB_ENUM ? "NAME" : k->type == PELL_KNOB_BOOL ? ON_OFF : "N";
}

/* The options that a command takes: the rows of its groups, then the knobs of the image or of comparing. */
static size_t list_options(unsigned groups, struct option list[MAX_OPTIONS])
{
    size_t n = 0;

    for (size_t i = 0; i < PELL_COUNT(options); i++)
        if ((groups | OPTIONS_ALL) & options[i].groups)
            list[n++] = options[i];
    for (const struct pell_knob *k = pell_settings_knobs(); (groups & OPTIONS_PICTURE) && k->name && n < MAX_OPTIONS; k++)
        if (strcmp(k->name, "layers") != 0 && /* follows from the format */
            /* For display only: measurements use the method's unfiltered image. */
            !((groups & (OPTIONS_COMPARE | OPTIONS_BENCH)) && strcmp(k->name, "denoise") == 0) &&
            /* Only one row for options of the same name: that of compare has more choices. */
            !((groups & OPTIONS_COMPARE) && pell_knob_find(pell_compare_knobs(), k->name)))
            list[n++] = (struct option) { OPTIONS_PICTURE, 0, k->name, argument_of(k), NULL, SETTING, 0, k };
    for (const struct pell_knob *k = pell_compare_knobs(); (groups & OPTIONS_COMPARE) && k->name && n < MAX_OPTIONS; k++)
        if (strcmp(k->name, "threads") != 0) /* it is one of the engine's options */
            list[n++] = (struct option) { OPTIONS_COMPARE, 0, k->name, argument_of(k), NULL, SETTING, 0, k };
    return n;
}

/* --- Help --------------------------------------------------------------------------------------------------------------------- */

static void describe(const struct option *o, char *text, size_t size)
{
    const struct pell_knob *k = o->knob;
    char low[40], high[40], def[40];
    size_t n;

    snprintf(text, size, "%s", k ? k->help : o->help);
    if (!k)
        return;
    n = strlen(text);
    if (k->type == PELL_KNOB_ENUM) {
        for (int i = 0; k->choices[i] && n < size; i++)
            n += (size_t) snprintf(text + n, size - n, "%s%s%s", i ? ", " : "; ", k->choices[i], i == (int) k->def[0] ? " (default)" : "");
        return;
    }
    if (k->type == PELL_KNOB_BOOL) {
        snprintf(text + n, size - n, "; default %s", k->def[0] != 0.0 ? "on" : "off");
        return;
    }
    snprintf(text + n, size - n, "; %s to %s%s%s, default %s", pell_format_number(k->min, false, low, sizeof(low)),
             pell_format_number(k->max, false, high, sizeof(high)), strcmp(k->unit, "1") ? " " : "", strcmp(k->unit, "1") ? k->unit : "",
             pell_format_number(k->def[0], false, def, sizeof(def)));
}

static void print_row(const struct option *o, FILE *file)
{
    char head[64], text[512];
    const char letter[5] = { '-', o->letter, ',', ' ', '\0' };

    snprintf(head, sizeof(head), "  %s--%s%s%s", o->letter ? letter : "    ", o->name, o->argument ? " " : "",
             o->argument ? o->argument : "");
    describe(o, text, sizeof(text));
    cli_row(file, head, 30, text);
}

bool cli_print_option(const struct command *command, const char *name, bool print, FILE *file)
{
    struct option list[MAX_OPTIONS];
    const size_t n = list_options(command->options, list);

    name += strspn(name, "-");
    for (size_t i = 0; i < n; i++)
        if (strcmp(list[i].name, name) == 0 || (list[i].letter && list[i].letter == name[0] && !name[1])) {
            if (print)
                print_row(&list[i], file);
            return true;
        }
    return false;
}

size_t cli_option_names(const struct program *program, const char **names, size_t most)
{
    struct option list[MAX_OPTIONS];
    size_t count = 0;

    for (size_t c = 0; c < program->num_commands; c++) {
        const size_t n = list_options(program->commands[c].options, list);
        for (size_t i = 0; i < n && count < most; i++)
            names[count++] = list[i].name;
    }
    return count;
}

void cli_print_help(const struct program *program, const struct command *command, FILE *file)
{
    struct option list[MAX_OPTIONS];
    const size_t n = list_options(command->options, list);
    char head[256];

    snprintf(head, sizeof(head), "%s %s - %s", program->name, command->name, command->summary);
    cli_wrap(file, 0, 2, head);
    snprintf(head, sizeof(head), "usage: %s %s %s%s[OPTIONS]", program->name, command->name, command->arguments,
             command->arguments[0] ? " " : "");
    fputc('\n', file);
    cli_wrap(file, 0, 6, head);
    fputc('\n', file);
    if (command->text[0]) {
        cli_wrap(file, 0, 0, command->text);
        fputc('\n', file);
    }
    fputs("Examples\n", file);
    cli_print_shell(file, command->examples);
    fputs("\nOptions\n", file);
    for (size_t i = 0; i < n; i++)
        print_row(&list[i], file);
}

void cli_format_knobs(const struct pell_knob *knobs, const void *values, const void *usual, char *text, size_t size)
{
    size_t n = 0;

    text[0] = '\0';
    for (const struct pell_knob *k = knobs; k->name && n < size; k++) {
        char value[128], other[128];
        pell_knob_format(k, values, value, sizeof(value));
        if (!usual || strcmp(value, pell_knob_format(k, usual, other, sizeof(other))) != 0)
            n += (size_t) snprintf(text + n, size - n, "%s%s=%s", n ? " " : "", k->name, value);
    }
}

/* --- Values of options -------------------------------------------------------------------------------------------------------- */

enum pell_result cli_add_setting(struct settings_list *list, const char *name, const char *value, const char *where)
{
    struct pell_setting *s;

    if (list->count == list->capacity) {
        const size_t capacity = list->capacity ? 2 * list->capacity : 16;
        struct pell_setting *grown = realloc(list->items, capacity * sizeof(*grown));
        if (!grown)
            return PELL_ERR_NOMEM;
        list->items = grown;
        list->capacity = capacity;
    }
    s = &list->items[list->count++];
    *s = (struct pell_setting) { strdup(name), strdup(value), strdup(where) };
    return s->name && s->value && s->where ? PELL_OK : PELL_ERR_NOMEM;
}

void cli_free_settings(struct settings_list *list)
{
    for (size_t i = 0; i < list->count; i++) {
        free((char *) list->items[i].name);
        free((char *) list->items[i].value);
        free((char *) list->items[i].where);
    }
    free(list->items);
    *list = (struct settings_list) { 0 };
}

void cli_finish(struct cli *cli)
{
    for (size_t i = 0; i < PELL_COUNT(options); i++)
        if (options[i].kind == TEXT) {
            char **text = (char **) ((char *) cli + options[i].offset);
            free(*text);
            *text = NULL; /* several rows may fill one field */
        }
    for (int i = 0; i < cli->num_arguments; i++)
        free(cli->arguments[i]);
    free(cli->arguments);
    cli_free_settings(&cli->knobs);
    cli_free_settings(&cli->bake.inner);
    cli_free_settings(&cli->settings);
    cli_free_settings(&cli->common);
    json_decref(cli->warnings);
    json_decref(cli->collected);
}

enum pell_result cli_append_settings(struct settings_list *to, const struct settings_list *from)
{
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < from->count && res == PELL_OK; i++)
        res = cli_add_setting(to, from->items[i].name, from->items[i].value, from->items[i].where);
    return res;
}

/* Splits "NAME=VALUE" at its first '='. */
static enum exit_code split(struct cli *cli, const char *option, char *text, const char **value)
{
    char *equals = strchr(text, '=');

    if (!equals || equals == text)
        return cli_usage(cli, option,
                         strcmp(option, "--limit") == 0   ? "`pellucid info` lists the names"
                         : strcmp(option, "--inner") == 0 ? "dermis=dermis.obj"
                                                          : "`pellucid methods` lists the names",
                         "\"%s\", must be NAME=%s", text, strcmp(option, "--inner") == 0 ? "FILE" : "VALUE");
    *equals = '\0';
    *value = equals + 1;
    return EXIT_OK;
}

enum exit_code cli_add_pair(struct cli *cli, struct settings_list *list, const char *where, char *text)
{
    const char *value = NULL;
    const enum exit_code code = split(cli, where, text, &value);

    return code == EXIT_OK ? cli_failed(cli, cli_add_setting(list, text, value, where)) : code;
}

const char *const cli_log_levels[] = { "none", "error", "warning", "info", "debug", NULL };
const char *const cli_progress_forms[] = { "text", "json", NULL };

static enum exit_code set_log_level(struct cli *cli, const char *text)
{
    for (int i = 0; cli_log_levels[i]; i++)
        if (strcmp(cli_log_levels[i], text) == 0) {
            cli->log_level = (enum pell_log_level) i;
            return EXIT_OK;
        }
    return cli_usage(cli, "--log-level", NULL, "\"%s\", must be none, error, warning, info or debug", text);
}

bool cli_given(const struct cli *cli, const char *option)
{
    for (int i = 0; i < cli->num_given; i++)
        if (strcmp(cli->given[i], option + 2) == 0)
            return true;
    return false;
}

/* Parses one option's value. `ctx` is used for reporting only. */
static enum exit_code set_option(struct cli *cli, struct pell_context *ctx, const struct option *o, char *text)
{
    char where[64];
    const char *value = NULL;
    char **field = (char **) ((char *) cli + o->offset);
    enum exit_code code = EXIT_OK;
    enum pell_result res = PELL_OK;

    snprintf(where, sizeof(where), "--%s", o->name);
    if (!cli_given(cli, where) && cli->num_given < (int) PELL_COUNT(cli->given))
        cli->given[cli->num_given++] = o->name;
    else if (o->argument && o->kind != KNOB && o->kind != LIMIT)
        pell_info(ctx, where, "is given more than once: the last, \"%.200s\", counts", text);
    switch (o->kind) {
    case HELP:
    case VERSION: break;
    case FLAG: *(bool *) ((char *) cli + o->offset) = true; break;
    case LEVEL: return set_log_level(cli, text);
    case TEXT:
        free(*field);
        *field = strdup(text);
        res = *field ? PELL_OK : PELL_ERR_NOMEM;
        break;
    case KNOB: code = cli_add_pair(cli, &cli->knobs, where, text); break;
    case INNER: code = cli_add_pair(cli, &cli->bake.inner, where, text); break;
    case LIMIT:
        if ((code = split(cli, where, text, &value)) == EXIT_OK && (code = cli_check_limit(cli, text)) == EXIT_OK)
            res = pell_knob_set(ctx, pell_limit_knobs(), "limits", where, &cli->limits, text, value);
        break;
    case NUMBER: res = pell_knob_set(ctx, o->knob, "pellucid", where, &cli->numbers, o->name, text); break;
    case SETTING: res = cli_add_setting(&cli->settings, o->name, text, where); break;
    case COMMON: res = cli_add_setting(&cli->common, o->name, text, where); break;
    }
    return code != EXIT_OK ? code : cli_failed(cli, res);
}

/* {"name", "value"} of an option that was given; null: it has no value. */
static json_t *given_option(const struct cli *cli, const struct option *o)
{
    const char *field = (const char *) cli + o->offset;
    char text[128];

    return json_pack("{s:s,s:o}", "name", o->name, "value",
                     o->kind == TEXT     ? cli_text(*(char *const *) (const void *) field)
                     : o->kind == NUMBER ? json_string(pell_knob_format(o->knob, &cli->numbers, text, sizeof(text)))
                                         : json_null());
}

json_t *cli_given_options(const struct cli *cli, const struct command *other)
{
    struct option list[MAX_OPTIONS];
    const size_t n = list_options(cli->command->options, list);
    struct pell_limits usual;
    json_t *all = json_array();

    for (size_t i = 0; i < n; i++)
        if ((list[i].groups & other->options & ~(unsigned) (OPTIONS_ALL | OPTIONS_METHOD)) &&
            (list[i].kind == TEXT || list[i].kind == FLAG || list[i].kind == NUMBER))
            for (int k = 0; k < cli->num_given; k++)
                if (strcmp(cli->given[k], list[i].name) == 0)
                    json_array_append_new(all, given_option(cli, &list[i]));
    pell_knobs_default(pell_limit_knobs(), &usual);
    for (const struct pell_knob *k = pell_limit_knobs(); k->name; k++) {
        char value[128], other_value[128];
        if (strcmp(pell_knob_format(k, &cli->limits, value, sizeof(value)),
                   pell_knob_format(k, &usual, other_value, sizeof(other_value))) != 0)
            json_array_append_new(all, json_pack("{s:s,s:o}", "name", "limit", "value", json_sprintf("%s=%s", k->name, value)));
    }
    return all;
}

/* --- The command line --------------------------------------------------------------------------------------------------------- */

/* Reports an option that popt refused, with the nearest option as a hint. */
static enum exit_code refuse(struct cli *cli, const char *bad, int error, const struct option *list, size_t n)
{
    const char *names[MAX_OPTIONS], *name = bad;
    struct pell_text hint = { .length = 0 };

    for (size_t i = 0; i < n; i++)
        names[i] = list[i].name;
    while (*name == '-')
        name++;
    if (error == POPT_ERROR_BADOPT) {
        char word[64];
        snprintf(word, sizeof(word), "%.*s", (int) (strcspn(name, "=") < 63 ? strcspn(name, "=") : 63), name);
        pell_text_suggest(&hint, "--", word, names, n);
    }
    if (hint.length == 0)
        pell_text_add(&hint, "`%s %s --help` lists the options", cli->program->name, cli->command->name);
    return cli_usage(cli, bad, hint.str, "%s",
                     error == POPT_ERROR_BADOPT  ? "unknown option"
                     : error == POPT_ERROR_NOARG ? "needs a value"
                                                 : poptStrerror(error));
}

/* Whether an option's value is in fact the next option. */
static bool is_option(const char *text, const struct option *list, size_t n)
{
    const size_t length = strncmp(text, "--", 2) == 0 ? strcspn(text + 2, "=") : 0;
    const char letter = text[0] == '-' && text[1] && !text[2] ? text[1] : 0;

    for (size_t i = 0; i < n; i++) {
        if (length > 0 && strlen(list[i].name) == length && strncmp(text + 2, list[i].name, length) == 0)
            return true;
        if (letter && list[i].letter == letter)
            return true;
    }
    return false;
}

static enum exit_code refuse_option(struct cli *cli, const struct option *o, const char *text)
{
    char where[64];

    snprintf(where, sizeof(where), "--%s", o->name);
    return cli_usage(cli, where, NULL, "needs a value, %s, but \"%.200s\" follows", o->argument, text);
}

static enum exit_code take_all(struct cli *cli, poptContext popt, const struct option *list, size_t n, bool *done)
{
    struct pell_context *ctx;
    enum exit_code code = EXIT_OK;
    const char *argument;
    int got;

    if (pell_context_create(&(struct pell_context_params) { .log = cli_message, .log_user = cli }, &ctx) != PELL_OK)
        return EXIT_MEMORY;
    while (code == EXIT_OK && !*done && (got = poptGetNextOpt(popt)) != -1) {
        char *text;
        if (got < -1) {
            code = refuse(cli, poptBadOption(popt, POPT_BADOPTION_NOALIAS), got, list, n);
            break;
        }
        text = poptGetOptArg(popt);
        if (text && is_option(text, list, n))
            code = refuse_option(cli, &list[got - 1], text);
        else
            code = set_option(cli, ctx, &list[got - 1], text ? text : (char[]) { "" });
        free(text);
        *done = list[got - 1].kind == HELP || list[got - 1].kind == VERSION;
        if (list[got - 1].kind == VERSION)
            code = cli_print_version(cli);
    }
    while (code == EXIT_OK && (argument = poptGetArg(popt))) {
        if (!(cli->arguments[cli->num_arguments] = strdup(argument)))
            code = EXIT_MEMORY;
        else
            cli->num_arguments++;
    }
    pell_context_destroy(&ctx);
    return code;
}

/* The arguments for popt: "on" is added after an on|off option that is last or followed by another option. Owned by the caller; NULL: no
 * memory. */
static const char **switch_on(int *argc, const char **argv, const struct option *list, size_t n)
{
    const char **all = calloc(2 * (size_t) *argc + 1, sizeof(*all));
    int count = 0;

    for (int i = 0; all && i < *argc; i++) {
        all[count++] = argv[i];
        for (size_t k = 0; strncmp(argv[i], "--", 2) == 0 && k < n; k++)
            if (list[k].argument && strcmp(list[k].argument, ON_OFF) == 0 && strcmp(argv[i] + 2, list[k].name) == 0 &&
                (i + 1 == *argc || is_option(argv[i + 1], list, n)))
                all[count++] = "on";
    }
    *argc = count;
    return all;
}

enum exit_code cli_parse(struct cli *cli, int argc, const char **argv, bool *done)
{
    struct option list[MAX_OPTIONS];
    struct poptOption table[MAX_OPTIONS + 1] = { 0 };
    const struct command *command = cli->command;
    const size_t n = list_options(command->options, list);
    poptContext popt;
    enum exit_code code = EXIT_MEMORY;

    for (size_t i = 0; i < n; i++)
        table[i] = (struct poptOption) {
            .longName = list[i].name,
            .shortName = list[i].letter,
            .argInfo = list[i].argument ? POPT_ARG_STRING : POPT_ARG_NONE,
            .val = (int) i + 1,
        };
    pell_knobs_default(number_knobs, &cli->numbers);
    cli->words = argv;
    cli->num_words = argc;
    cli_keep_command_line(cli, argc, argv);
    cli->arguments = calloc((size_t) argc + 1, sizeof(*cli->arguments));
    argv = switch_on(&argc, argv, list, n);
    popt = argv ? poptGetContext(cli->program->name, argc, argv, table, 0) : NULL;
    if (cli->arguments && popt)
        code = take_all(cli, popt, list, n, done);
    poptFreeContext(popt);
    free(argv);
    if (code != EXIT_OK)
        return code;
    if (*done) {
        if (!cli->of_a_file && !cli->answered)
            cli_print_help(cli->program, command, stdout);
        return EXIT_OK;
    }
    if (cli->num_arguments < command->min_arguments)
        return cli_usage(cli, command->name, "`--help` shows examples", "%s is missing", command->arguments);
    if (cli->num_arguments > command->max_arguments)
        return cli_usage(cli, command->name, "`--help` shows examples", "\"%s\" is one argument too many",
                         cli->arguments[command->max_arguments]);
    if (cli->progress_form && strcmp(cli->progress_form, "json") != 0 && strcmp(cli->progress_form, "text") != 0)
        return cli_usage(cli, "--progress", NULL, "\"%s\", must be text or json", cli->progress_form);
    for (int i = 0; i < cli->num_arguments; i++)
        if (!cli->arguments[i][0])
            return cli_usage(cli, command->name, "`--help` shows examples", "an empty text for %s", command->arguments);
        else if (strcmp(cli->arguments[i], "-") == 0)
            return cli_usage(cli, command->name, "write it to a file first: what a mesh is follows from its name and content",
                             "standard input is not read as %s", command->arguments);
    return EXIT_OK;
}
