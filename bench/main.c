/* SPDX-License-Identifier: MIT
 * main.c - `pellucid-bench`: the tables and figures of the papers behind the methods, timed and with errors. Options, messages and exit
 * codes are those of pellucid (src/cli). */
#include "papers.h"

#include <string.h>
#include <unistd.h>

static enum exit_code run(struct cli *cli);

#define PICTURE OPTIONS_PICTURE
#define SCENE (OPTIONS_ENGINE | OPTIONS_BENCH)
#define COMMAND(name, summary, options)                                                                                                    \
    {                                                                                                                                      \
        name, "", summary, "", "  pellucid-bench " name " --repeats 1\n", options, 0, 0, run                                               \
    }

/* Each has its row in `benches`. */
static const struct command commands[] = {
    COMMAND("profiles", "fits, layers and R(r): renders nothing", OPTIONS_REPEATS),
    COMMAND("truth", "what the references cost for what error, in processor time", SCENE | PICTURE),
    COMMAND("truth-gap", "light that leaves a surface and enters again: by samples and bounces", SCENE | PICTURE),
    COMMAND("mertens", "image-space by samples, size and radius, and others in the same time", SCENE),
    COMMAND("munoz-2", "convolution by threshold, figure 2 of its paper", SCENE | PICTURE),
    COMMAND("munoz-3", "convolution by resolution, figure 3, and filling the image", SCENE | PICTURE),
    COMMAND("munoz-5", "convolution by planes, figure 5", SCENE | PICTURE),
    COMMAND("deon-1", "texture-space by resolution and lights, table 1 of its paper", SCENE),
    COMMAND("jimenez-7.2", "screen-space beside texture-space by heads, lights and distance, table 7.2 of its paper", SCENE),
    COMMAND("francois-2", "layered by samples and lights, table 2 of its paper", SCENE),
};

static const struct row_of {
    const char *name;
    enum pell_result (*run)(struct bench *b);
    const char *material; /* of the scene, instead of its own */
    const char *own;      /* a render setting of its own in addition to msaa */
    unsigned columns;
    const char *items; /* the unit of the rows, "samples/s" */
} benches[] = {
    { "profiles", bench_profiles, NULL, NULL, BENCH_ERROR, "R(r)/s" },
    { "truth", bench_truth, "wholemilk", "seed", BENCH_PIXELS | BENCH_RAYS | BENCH_ERROR | BENCH_WORK, NULL },
    { "truth-gap", bench_indirect, NULL, "bounces", 0, NULL },
    { "mertens", bench_mertens, NULL, NULL, BENCH_FRAME | BENCH_PIXELS | BENCH_ERROR, "samples/s" },
    { "munoz-2", bench_munoz_2, NULL, NULL, BENCH_FRAME | BENCH_PIXELS | BENCH_RAYS | BENCH_ERROR, NULL },
    { "munoz-3", bench_munoz_3, NULL, NULL, BENCH_FRAME | BENCH_PIXELS | BENCH_RAYS | BENCH_ERROR, NULL },
    { "munoz-5", bench_munoz_5, NULL, NULL, BENCH_FRAME | BENCH_PIXELS | BENCH_RAYS | BENCH_ERROR, NULL },
    { "deon-1", bench_deon, NULL, NULL, BENCH_FRAME | BENCH_PIXELS | BENCH_RAYS, NULL },
    { "jimenez-7.2", bench_jimenez, NULL, NULL, 0, NULL },
    { "francois-2", bench_francois, NULL, NULL, BENCH_FRAME | BENCH_PIXELS | BENCH_RAYS | BENCH_ERROR, "layer-samples/s" },
};

/* The scene file is next to the program. */
static void scene_path(const char *name, char *path, size_t size)
{
    char program[2048];
    const ssize_t n = readlink("/proc/self/exe", program, sizeof(program) - 1);
    const char *slash;

    program[n > 0 ? n : 0] = '\0';
    slash = strrchr(program, '/');
    snprintf(path, size, "%.*s/%s.json", slash ? (int) (slash - program) : 1, slash ? program : ".", name);
}

/* A setting that the bench would not obey is refused. */
static enum exit_code refuse_own(struct cli *cli, const struct row_of *row)
{
    for (size_t i = 0; i < cli->settings.count; i++) {
        const char *name = cli->settings.items[i].name;
        if (strcmp(name, "msaa") == 0 || (row->own && strcmp(name, row->own) == 0))
            return cli_usage(cli, cli->settings.items[i].where, NULL, "has no effect on the bench %s, which chooses its own", row->name);
    }
    return EXIT_OK;
}

static enum exit_code run(struct cli *cli)
{
    struct bench b = { .cli = cli, .repeats = cli->numbers.repeats };
    const struct row_of *row = benches;
    const bool renders = cli->command->options & OPTIONS_BENCH;
    char path[4096];
    json_t *facts = NULL;
    enum exit_code code;

    while (strcmp(row->name, cli->command->name) != 0)
        row++;
    code = refuse_own(cli, row);
    if (code == EXIT_OK && renders) {
        scene_path(row->name, path, sizeof(path));
        b.path = path;
        cli->quiet = true;                         /* of frames there is nothing to report */
        cli->stats = !(row->columns & BENCH_WORK); /* times are compared with copies, which would count as processor time */
        code = bench_open(&b, row->material);
    }
    if (code == EXIT_OK && renders)
        facts =
            json_pack("{s:s,s:i}", "engine", pell_engine_name(pell_device_engine(b.s.device)), "threads", pell_device_threads(b.s.device));
    if (code == EXIT_OK)
        code = cli_failed(cli, row->run(&b));
    if (facts) {
        json_object_set_new(facts, "width", json_integer(b.s.settings.width));
        json_object_set_new(facts, "height", json_integer(b.s.settings.height));
    }
    if (code == EXIT_OK)
        code = bench_answer(cli, row->name, facts, &b.rows, row->columns, row->items, b.setup);
    else
        json_decref(facts);
    bench_close(&b);
    return code;
}

int main(int argc, char **argv)
{
    static const struct program program = {
        .name = "pellucid-bench",
        .about = "times the methods as their papers did",
        .start = "",
        .commands = commands,
        .num_commands = PELL_COUNT(commands),
    };

    return cli_main(&program, argc, argv);
}
