/* SPDX-License-Identifier: MIT
 * main.c - the table of commands, and how one is run. */
#include "cli/cli.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const struct command commands[] = {
    { "render", "INPUT", "one picture of a scene or a mesh",
      "INPUT is a glTF (.gltf, .glb), an OBJ, a PLY, or a scene file (.json). A plain mesh needs no scene file: it gets a camera that\n"
      "frames it, a studio of three soft lights, a grey backdrop and, with --material, something to be made of.\n"
      "\n"
      "glTF says its unit (the metre). OBJ and PLY don't: say how large the thing is (--size 70mm, its largest extent) or what one\n"
      "unit of the file is (--unit 1mm), since how deep light goes into a thing depends on it.\n"
      "\n"
      "Examples\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -o bunny.png\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -m none -o plain.png    without scattering, to compare\n"
      "  pellucid render head.gltf --material skin --set gaussians=6 -o head.exr           with all layers\n"
      "  pellucid render scene.json --width 1920 --height 1080 --msaa 8 --stats\n",
      OPTIONS_OUTPUT | OPTIONS_SCENE | OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_ENGINE, 1, 1, command_render },
    { "check", "INPUT", "what a scene holds, and every problem; renders nothing",
      "Reads INPUT as `render` would, and reports its objects, materials, size and problems: open or turned surfaces, a scale that\n"
      "can't be meant, media that the object is too thin for. Exit code 3 if a problem is an error.\n"
      "\n"
      "Example\n"
      "  pellucid check bunny.obj --size 70mm --material wholemilk\n",
      OPTIONS_OUTPUT | OPTIONS_SCENE, 1, 1, command_check },
    { "methods", "[NAME]", "the methods, or all about one: its knobs, its paper, its limits",
      "Examples\n"
      "  pellucid methods\n"
      "  pellucid methods screen-space\n"
      "  pellucid methods --json\n",
      OPTIONS_OUTPUT, 0, 1, command_methods },
    { "materials", "[NAME]", "the built-in materials, or all about one and where each number comes from",
      "Examples\n"
      "  pellucid materials\n"
      "  pellucid materials wholemilk\n",
      OPTIONS_OUTPUT, 0, 1, command_materials },
    { "bench", "[WHAT]", "times of the stages on this machine",
      "Renders the scene bench/WHAT.json cold and warm and prints a row per stage: milliseconds, pixels, bytes, and the time of copying\n"
      "the same bytes, measured in the same run. WHAT is a name (screen-space) or a scene file of your own.\n"
      "\n"
      "Examples\n"
      "  pellucid bench\n"
      "  pellucid bench screen-space --threads 1 --json\n",
      OPTIONS_OUTPUT | OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_BENCH, 0, 1, command_bench },
    { "info", "", "engines, devices, limits, SIMD level, build", "Example\n  pellucid info --json\n", OPTIONS_OUTPUT | OPTIONS_ENGINE, 0, 0, command_info },
};

static struct pell_context *interrupted_context;
static volatile sig_atomic_t interruptions;

static void on_signal(int signal)
{
    (void) signal;
    if (interruptions++ > 0)
        _exit(EXIT_INTERRUPTED);
    if (interrupted_context)
        pell_context_cancel(interrupted_context);
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
          "Exit codes: 0 ok, 1 failed, 2 wrong usage, 3 bad input, 4 engine or device not there, 5 out of memory, 130 interrupted.\n",
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
    const char *names[PELL_COUNT(commands)], *nearest;
    char shown[64], hint[160] = "`pellucid --help` lists them";

    for (size_t i = 0; i < PELL_COUNT(commands); i++)
        names[i] = commands[i].name;
    nearest = pell_nearest(name, names, PELL_COUNT(names));
    if (nearest)
        snprintf(hint, sizeof(hint), "did you mean `pellucid %s`?", nearest);
    return cli_usage(cli, "pellucid", hint, "there is no command \"%s\"", pell_printable(name, shown, sizeof(shown)));
}

static enum exit_code run(struct cli *cli, int argc, const char **argv)
{
    struct sigaction action = { .sa_handler = on_signal };
    enum pell_result res;
    enum exit_code code;
    bool done = false;

    if (argc < 2) {
        print_usage(stderr);
        return EXIT_USAGE;
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 || strcmp(argv[1], "help") == 0) {
        const struct command *about = argc > 2 ? find_command(argv[2]) : NULL;
        if (about)
            cli_print_help(about, stdout);
        else
            print_usage(stdout);
        return EXIT_OK;
    }
    if (strcmp(argv[1], "--version") == 0) {
        printf("pellucid %s\n", pell_version());
        return EXIT_OK;
    }
    cli->command = find_command(argv[1]);
    if (!cli->command) {
        for (int i = 2; i < argc; i++)
            cli->json = cli->json || strcmp(argv[i], "--json") == 0;
        return unknown_command(cli, argv[1]);
    }
    code = cli_parse(cli, argc - 1, argv + 1, &done);
    if (code != EXIT_OK || done)
        return code;

    res = pell_context_create(
        &(struct pell_context_params) {
            .log = cli_message,
            .log_user = cli,
            .log_level = cli->log_level,
            .progress = cli_progress,
            .progress_user = cli,
            .limits = &cli->limits,
        },
        &cli->ctx);
    if (res != PELL_OK)
        return cli_failed(cli, res);
    interrupted_context = cli->ctx;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    signal(SIGPIPE, SIG_IGN);

    code = cli->command->run(cli);
    cli_progress_end(cli);
    if (fflush(stdout) != 0 && code == EXIT_OK)
        code = EXIT_FAILED;
    interrupted_context = NULL;
    pell_context_destroy(&cli->ctx);
    return code;
}

int main(int argc, char **argv)
{
    struct cli cli = { .log_level = PELL_LOG_INFO };
    enum exit_code code;

    cli.tty = isatty(STDERR_FILENO) == 1;
    cli.color = cli.tty && !(getenv("NO_COLOR") && getenv("NO_COLOR")[0]) && !(getenv("TERM") && strcmp(getenv("TERM"), "dumb") == 0);
    cli.warnings = json_array();
    pell_knobs_default(pell_limit_knobs, &cli.limits);
    code = run(&cli, argc, (const char **) argv);
    if (code != EXIT_OK)
        cli_print_json_error(&cli);
    if (code == EXIT_INTERRUPTED && !cli.quiet)
        fputs("interrupted; nothing was written\n", stderr);
    cli_finish(&cli);
    json_decref(cli.warnings);
    return (int) code;
}
