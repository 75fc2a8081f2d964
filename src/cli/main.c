/* SPDX-License-Identifier: MIT
 * main.c - the table of commands, and how one is run. */
#include "cli/cli.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const struct command commands[] = {
    { "render", "INPUT", "one picture of a scene or a mesh, a turntable of them, or an animation",
      "INPUT is a glTF (.gltf, .glb), an OBJ, a PLY, or a scene file (.json). A plain mesh needs no scene file: it gets a camera that "
      "frames it, a studio of three soft lights, a grey backdrop and, with --material, something to be made of.\n"
      "\n"
      "glTF says its unit (the metre). OBJ and PLY don't: say how large the thing is (--size 70mm, its largest extent) or what one unit of "
      "the file is (--unit 1mm), since how deep light goes into a thing depends on it.\n"
      "\n"
      "Options of the command line win over those of a scene file. PNG shows the exposed picture; EXR, HDR and PFM hold linear radiance "
      "without exposure, and EXR also holds all layers.\n",
      "  pellucid render bunny.obj --material wholemilk --size 70mm -o bunny.png\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -m none -o plain.png  # unscattered\n"
      "  pellucid render head.gltf --material skin --set gaussians=6 -o head.exr          # with layers\n"
      "  pellucid render scene.json --width 1920 --height 1080 --msaa 8 --stats\n"
      "  pellucid render scene.json --turntable 4 -o turn.png     # turn_0000.png, turn_0001.png, ...\n"
      "  pellucid render scene.json --frames 0:2:0.25 -o walk.png # its animation, walk_0000.png, ...\n"
      "  pellucid render scene.json --dof on --msaa 64 --bloom 0.1\n",
      OPTIONS_SCENE | OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_FILE | OPTIONS_ENGINE, 1, 1, command_render },
    { "check", "INPUT", "what a scene holds, and every problem; renders nothing",
      "Reads INPUT as `render` would, and reports its objects, materials, size and problems: open or turned surfaces, a scale that can't "
      "be meant, media that the object is too thin for. Exit code 3 if INPUT can't be read or a problem is an error.\n"
      "\n"
      "With --cross-section it also draws what lies below the surface: the layers of a material along a line, painted or even, in mm.\n",
      "  pellucid check bunny.obj --size 70mm --material wholemilk\n"
      "  pellucid check scene.json --json\n"
      "  pellucid check scene.json --cross-section layers.svg --down-to 2mm\n",
      OPTIONS_SCENE | OPTIONS_CHECK, 1, 1, command_check },
    { "methods", "[NAME]", "the methods, or all about one: its knobs, its paper, its limits", "",
      "  pellucid methods\n"
      "  pellucid methods screen-space\n"
      "  pellucid methods --json\n",
      0, 0, 1, command_methods },
    { "materials", "[NAME]", "the built-in materials, or one and where its numbers come from", "",
      "  pellucid materials\n"
      "  pellucid materials wholemilk\n",
      0, 0, 1, command_materials },
    { "profile", "[MATERIAL|FILE]", "how light spreads: R(r), T(r) of slabs, fits, plots, code for engines",
      "MATERIAL is a built-in name (`pellucid materials`), FILE a material file (.json) or a table of your own (.csv: rows r_mm,R,G,B in "
      "mm and 1/mm^2, or a line of names and columns in its order; what --csv writes is read again, T and other models passed over). "
      "Printed are R(r), the flux that leaves per mm^2 at a distance r from where light fell in, its total, and a sum of "
      "Gaussians fitted to it, with error (10) of d'Eon et al. 2007: sqrt(Int r (R - G)^2 dr / Int r R^2 dr).\n"
      "\n"
      "Models: dipole (Jensen et al. 2001), better-dipole (d'Eon 2012), normalized-diffusion (Christensen and Burley 2015), photon-beam "
      "(Habel et al. 2013), monte-carlo (a table made by photons).\n",
      "  pellucid profile marble\n"
      "  pellucid profile marble --gaussians 6 --shared -o marble.svg\n"
      "  pellucid profile marble --gaussians 2,4 --weighted -o figure-2.svg   # 2 pi r R(r)\n"
      "  pellucid profile wax.json --csv -o wax.csv --points 200\n"
      "  pellucid profile wholemilk --export glsl --taps 17 -o milk.glsl\n"
      "  pellucid profile --skin melanin=0.2 --solver gaussian --json\n"
      "  pellucid profile --wavelength 500nm --solver all -o figure-12.svg\n",
      OPTIONS_PROFILE, 0, 1, command_profile },
    { "bench", "[WHAT]", "times of the stages on this machine",
      "Renders the scene WHAT cold and warm and prints a row per stage: milliseconds, pixels, rays, and the time of copying the same "
      "bytes, measured in the same run; then rows for the whole frame, for one thread and for the thing farther away. WHAT is a scene of "
      "the bench folder (screen-space) or a scene file of your own; or profiles: fits, layers and R(r); or truth: the references at equal "
      "error; or mertens: image-space by samples, size and radius; or munoz-2, munoz-3, "
      "munoz-5: convolution by threshold, resolution, planes; or deon-1: texture-space by resolution and lights; or "
      "francois-2: layered by samples and lamps. Those choose their methods and samples: -m, --set and --samples are refused; mertens, "
      "deon-1 and francois-2 choose the size of the picture, too, deon-1 the --ambient-samples and truth the seeds; profiles renders "
      "nothing and takes no option of rendering.\n",
      "  pellucid bench\n"
      "  pellucid bench screen-space --threads 1 --json\n"
      "  pellucid bench profiles\n"
      "  pellucid bench truth\n"
      "  pellucid bench mertens\n"
      "  pellucid bench deon-1\n"
      "  pellucid bench francois-2\n",
      OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_BENCH, 0, 1, command_bench },
    { "compare", "INPUT|A B", "methods on a scene, or two pictures, against a reference: numbers, a report",
      "INPUT is a scene or a mesh, as for `render`. Every method of --methods and the reference render it under one exposure; the table "
      "says how far each is from the reference: of the subsurface light of translucent pixels, and of the whole picture. With two "
      "references, the first is also measured against the second: the error of the model, apart from the error of the methods.\n"
      "\n"
      "A and B are pictures of one size (exr, hdr, pfm, png, jpg), from here or from another program: both linear light, or both as a "
      "display shows them. Printed are the mean squared, relative squared and absolute error, the bias of each channel, SSIM (Wang et "
      "al. 2004) and FLIP (Andersson et al. 2020; of linear light also HDR-FLIP, 2021), over the pixels of a mask and over the whole "
      "picture. SSIM and FLIP judge what is shown: both pictures under the exposure and the curve of B.\n"
      "\n"
      "A reference that was made by sampling has noise of its own: render it twice, with two seeds, and give the second as --half; dipole, "
      "single-scatter and path-trace tell their own. With -o a folder gets report.html, one file for any browser, and metrics.json; of a "
      "scene, every picture as EXR and the errors of each; of two pictures, relative.png (blue: too dark, red: too bright, +-50 %), "
      "flip.png, flip_hdr.png (black 0, light "
      "yellow 1) and errors.exr with the numbers behind them.\n",
      "  pellucid compare bunny.obj --material wholemilk --size 70mm -o report/\n"
      "  pellucid compare bunny.obj --size 70mm --material marble --methods screen-space:gaussians=6,none\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -o milk.exr\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -m none -o plain.exr\n"
      "  pellucid compare plain.exr milk.exr\n"
      "  pellucid compare plain.exr milk.exr -o errors/\n"
      "  pellucid compare plain.exr milk.exr --layer diffuse.multiple --json\n",
      OPTIONS_SCENE | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_COMPARE, 1, 2, command_compare },
    { "info", "", "engines, devices, limits, formats, SIMD level, build", "",
      "  pellucid info\n"
      "  pellucid info --json\n",
      OPTIONS_ENGINE, 0, 0, command_info },
};

static struct pell_context *volatile interrupted_context;
static volatile sig_atomic_t interruptions;

static void on_signal(int signal)
{
    (void) signal;
    if (interruptions)
        _exit(EXIT_INTERRUPTED);
    interruptions = 1;
    if (interrupted_context)
        pell_context_interrupt(interrupted_context);
}

/* Signals that the caller wants ignored (nohup, a job in the background) stay ignored. */
static void catch_signal(int number)
{
    struct sigaction action = { .sa_handler = on_signal }, old;
    if (sigaction(number, NULL, &old) == 0 && old.sa_handler != SIG_IGN)
        sigaction(number, &action, NULL);
}

static void print_usage(FILE *file)
{
    fputs("pellucid - renders translucent things from measured optics\n\n"
          "usage: pellucid COMMAND [ARGUMENTS] [OPTIONS]\n\n", file);
    for (size_t i = 0; i < PELL_COUNT(commands); i++) {
        char head[64];
        snprintf(head, sizeof(head), "%s %s", commands[i].name, commands[i].arguments);
        fprintf(file, "  %-18s %s\n", head, commands[i].summary);
    }
    fputs("\n  --help             this text; `pellucid COMMAND --help` tells all about one\n"
          "  --version          the version\n\n"
          "Start here\n"
          "  pellucid render bunny.obj --material wholemilk --size 70mm -o bunny.png\n\n"
          "Exit codes: 0 ok, 1 failed, 2 wrong usage, 3 bad input, 4 engine or device not there,\n"
          "5 out of memory, 130 interrupted.\n",
          file);
}

static const struct command *find_command(const char *name)
{
    for (size_t i = 0; i < PELL_COUNT(commands); i++)
        if (strcmp(commands[i].name, name) == 0)
            return &commands[i];
    return NULL;
}

static enum exit_code unknown_command(struct cli *cli, const char *name)
{
    const char *names[PELL_COUNT(commands)];
    struct pell_text hint = { .length = 0 };

    for (size_t i = 0; i < PELL_COUNT(commands); i++)
        names[i] = commands[i].name;
    if (!pell_text_suggest(&hint, "pellucid ", name, names, PELL_COUNT(names)))
        pell_text_add(&hint, "`pellucid --help` lists them");
    return cli_usage(cli, "pellucid", hint.str, "there is no command \"%s\"", name);
}

/* --help, --version and their like. EXIT_OK and *done, or the command's row. */
static enum exit_code choose_command(struct cli *cli, int argc, const char **argv, bool *done)
{
    const char *first = argc > 1 ? argv[1] : "", *about = argc > 2 ? argv[2] : NULL;

    *done = true;
    if (argc < 2) {
        print_usage(stderr);
        return EXIT_USAGE;
    }
    if (strcmp(first, "--version") == 0) {
        if (cli->json)
            return cli_print_json(cli, json_pack("{s:s}", "version", pell_version()));
        printf("pellucid %s\n", pell_version());
        return EXIT_OK;
    }
    if (strcmp(first, "--help") == 0 || strcmp(first, "-h") == 0 || strcmp(first, "help") == 0) {
        if (about && !find_command(about))
            return unknown_command(cli, about);
        if (about)
            cli_print_help(find_command(about), stdout);
        else
            print_usage(stdout);
        return EXIT_OK;
    }
    *done = false;
    cli->command = find_command(first);
    return cli->command ? EXIT_OK : unknown_command(cli, first);
}

static enum exit_code run(struct cli *cli, int argc, const char **argv)
{
    enum exit_code code;
    bool done = false;
    enum pell_result res;

    /* Errors of the command line itself are answered as JSON, too. */
    for (int i = 1; i < argc; i++)
        cli->json = cli->json || strcmp(argv[i], "--json") == 0;
    code = choose_command(cli, argc, argv, &done);
    if (code == EXIT_OK && !done)
        code = cli_parse(cli, argc - 1, argv + 1, &done);
    if (code != EXIT_OK || done)
        return code;

    res = pell_context_create(
        &(struct pell_context_params) {
            .log = cli_message,
            .log_user = cli,
            .log_level = cli->log_level > PELL_LOG_WARNING ? cli->log_level : PELL_LOG_WARNING, /* for the answer in JSON */
            .progress = cli_progress,
            .progress_user = cli,
            .limits = &cli->limits,
        },
        &cli->ctx);
    if (res != PELL_OK)
        return cli_failed(cli, res);
    interrupted_context = cli->ctx;
    catch_signal(SIGINT);
    catch_signal(SIGTERM);

    code = cli->command->run(cli);
    cli_progress_end(cli);
    interrupted_context = NULL;
    pell_context_destroy(&cli->ctx);
    return code;
}

int main(int argc, char **argv)
{
    struct cli cli = { .log_level = PELL_LOG_INFO, .progress = { .fraction = 2.0 } };
    const char *term = getenv("TERM"), *no_color = getenv("NO_COLOR");
    const bool color = !(no_color && no_color[0]) && !(term && strcmp(term, "dumb") == 0);
    enum exit_code code;

    signal(SIGPIPE, SIG_IGN); /* a write that fails says so */
    signal(SIGXFSZ, SIG_IGN);
    cli.tty = isatty(STDERR_FILENO) == 1;
    cli.color_err = color && cli.tty;
    cli.color_out = color && isatty(STDOUT_FILENO) == 1;
    cli.warnings = json_array();
    pell_knobs_default(pell_limit_knobs, &cli.limits);
    code = run(&cli, argc, (const char **) argv);
    if (code != EXIT_OK)
        cli_print_json_error(&cli, code);
    if (code == EXIT_INTERRUPTED && !cli.quiet && !cli.json && cli.partial)
        fputs("interrupted; the picture was written with the samples that it had\n", stderr);
    else if (code == EXIT_INTERRUPTED && !cli.quiet && !cli.json && cli.pictures)
        fprintf(stderr, "interrupted; written before: %d pictures\n", cli.pictures);
    else if (code == EXIT_INTERRUPTED && !cli.quiet && !cli.json)
        fputs("interrupted; nothing was written\n", stderr);
    if ((fflush(stdout) != 0 || ferror(stdout)) && code == EXIT_OK) {
        if (!cli_reader_left())
            fputs("the answer can't be written to stdout\n", stderr);
        code = EXIT_FAILED;
    }
    cli_finish(&cli);
    return (int) code;
}
