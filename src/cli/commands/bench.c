/* SPDX-License-Identifier: MIT
 * bench.c - `pellucid bench`: times of a scene's stages, cold and warm, as ratios to copying the same bytes in the same run. */
#include "cli/bench.h"

#include "base/file.h"
#include "math/vec.h"
#include "render/renderer.h"

#include <dirent.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Renders `repeats` warm frames; medians of the frame and, where `stages` is given, of each stage. */
static enum pell_result warm_frames(struct cli *cli, struct session *s, struct pell_renderer *renderer, int repeats, double *frame_ms,
                                    struct rows *stages)
{
    double *frames = calloc((size_t) repeats * (MAX_STAGES + 1), sizeof(*frames));
    struct pell_render_result p = { 0 };
    enum pell_result res = frames ? PELL_OK : PELL_ERR_NOMEM;

    for (int i = 0; i < repeats && res == PELL_OK; i++) {
        res = bench_frame(renderer, &s->settings, &p);
        frames[i] = 1e3 * p.seconds;
        for (size_t k = 0; k < p.num_stages && k < MAX_STAGES; k++)
            frames[(k + 1) * (size_t) repeats + (size_t) i] = p.stages[k].ms;
        cli_progress(cli, "bench", 1.0);
        cli->progress.part++;
    }
    cli_progress_end(cli);
    if (res == PELL_OK) {
        *frame_ms = bench_median(frames, repeats);
        for (size_t k = 0; stages && k < p.num_stages && k < MAX_STAGES; k++) {
            const struct pell_stage_time *t = &p.stages[k];
            bench_add_stage(stages, t->name, bench_median(frames + (k + 1) * (size_t) repeats, repeats), t);
        }
    }
    free(frames);
    return res;
}

/* Times the stage "surface" relative to its rays alone, one sample per pixel. */
static enum pell_result bare_rays(struct session *s, struct rows *rows, int repeats)
{
    double *times = calloc((size_t) repeats, sizeof(*times)), bare;
    struct row *r;

    if (!times)
        return PELL_ERR_NOMEM;
    for (int i = 0; i < repeats; i++)
        times[i] = 1e3 * pell_renderer_trace_bare(s->renderer);
    bare = bench_median(times, repeats);
    free(times);
    r = bench_add(rows, "camera rays alone", bare);
    for (size_t i = 0; r && bare > 0.0 && i < rows->count; i++)
        if (strcmp(rows->items[i].name, "surface") == 0) {
            rows->items[i].ratio = rows->items[i].ms / (bare * s->settings.msaa);
            rows->items[i].against = "rays alone";
        }
    return PELL_OK;
}

/* Times the same frame with one thread, in the same run. */
static enum pell_result one_thread(struct cli *cli, struct session *s, int repeats, double *ms)
{
    struct pell_device *device = NULL;
    struct pell_renderer *r = NULL;
    struct pell_render_result p;
    enum pell_result res = pell_device_create(cli->ctx, &(struct pell_device_params) { .threads = 1 }, &device);

    if (res == PELL_OK)
        res = pell_renderer_create(device, &r);
    if (res == PELL_OK)
        res = pell_renderer_set_scene(r, s->scene);
    if (res == PELL_OK)
        res = pell_renderer_set_method(r, s->method, s->knobs);
    if (res == PELL_OK)
        res = bench_frame(r, &s->settings, &p);
    if (res == PELL_OK)
        res = warm_frames(cli, s, r, repeats, ms, NULL);
    pell_renderer_destroy(&r);
    pell_device_destroy(&device);
    return res;
}

/* Moves the camera back to `times` its distance from the centre of the bounds. */
static void recede(const struct pell_scene *scene, const struct pell_camera *from, float times, struct pell_camera *to)
{
    const struct pell_vec3 middle = vec3_mul(vec3_add(vec3_load(scene->bounds_min), vec3_load(scene->bounds_max)), 0.5f);
    const struct pell_vec3 away = vec3_sub(vec3_load(from->position), middle);
    vec3_store(vec3_add(middle, vec3_mul(away, times)), to->position);
}

static enum pell_result measure(struct cli *cli, struct session *s, struct rows *rows, struct pell_rect *rect)
{
    const int repeats = cli->numbers.repeats;
    const struct pell_camera camera = s->scene->cameras[0];
    struct pell_render_result p;
    struct row *r;
    double cold, warm, one, far;
    enum pell_result res;

    cli->progress.parts = 2 + repeats * (pell_device_threads(s->device) > 1 ? 4 : 3);
    PELL_TRY(bench_frame(s->renderer, &s->settings, &p));
    cold = 1e3 * p.seconds;
    *rect = p.rect;
    PELL_TRY(warm_frames(cli, s, s->renderer, repeats, &warm, rows));
    PELL_TRY(bare_rays(s, rows, repeats));
    bench_add(rows, "frame", warm);
    bench_add(rows, "frame cold", cold);
    if (pell_device_threads(s->device) > 1) {
        PELL_TRY(one_thread(cli, s, repeats, &one));
        if ((r = bench_add(rows, "frame by one thread", one))) {
            r->ratio = one / warm;
            r->against = "frame";
        }
    }
    for (int times = 2; times <= 4; times *= 2) {
        char name[64];
        recede(s->scene, &camera, (float) times, &s->scene->cameras[0]);
        res = warm_frames(cli, s, s->renderer, repeats, &far, NULL);
        s->scene->cameras[0] = camera;
        if (res != PELL_OK)
            goto fail;
        snprintf(name, sizeof(name), "frame at %d x the distance", times);
        if ((r = bench_add(rows, name, far))) {
            r->ratio = far / warm;
            r->against = "frame";
        }
    }
    return PELL_OK;

fail:
    return res;
}

/* The folder of bench scenes, in the build or installed. False: not found. */
static bool find_folder(char *folder, size_t size)
{
    static const char *const places[] = { "bench", "../bench", "../../bench", "../share/pellucid/bench" };
    char program[2048];
    const ssize_t n = readlink("/proc/self/exe", program, sizeof(program) - 1);

    if (n <= 0)
        return false;
    program[n] = '\0';
    for (size_t i = 0; i < PELL_COUNT(places); i++) {
        snprintf(folder, size, "%.*s%s", (int) (pell_path_name(program) - program), program, places[i]);
        if (access(folder, R_OK | X_OK) == 0)
            return true;
    }
    return false;
}

/* Whether a name is a bench of the program `pellucid-bench`, which this command once had. */
static bool is_of_papers(const char *name)
{
    static const char *const names[] = { "profiles", "truth",  "mertens",    "munoz-2",         "munoz-3",
                                         "munoz-5",  "deon-1", "francois-2", "francois-2-gecko" };

    for (size_t i = 0; i < PELL_COUNT(names); i++)
        if (strcmp(name, names[i]) == 0)
            return true;
    return false;
}

static int by_name(const void *a, const void *b)
{
    return strcmp(*(const char *const *) a, *(const char *const *) b);
}

static enum exit_code unknown_bench(struct cli *cli, const char *what, const char *folder)
{
    char names[32][64];
    struct pell_text hint = { .length = 0 };
    const char *list[PELL_COUNT(names)];
    DIR *dir = folder[0] ? opendir(folder) : NULL;
    const struct dirent *entry;
    size_t count = 0;

    while (dir && count < PELL_COUNT(names) && (entry = readdir(dir))) {
        const size_t length = strlen(entry->d_name);
        if (!pell_path_has_extension(entry->d_name, "json") || length - 5 >= sizeof(names[0]))
            continue;
        snprintf(names[count], sizeof(names[0]), "%.*s", (int) (length - 5), entry->d_name);
        list[count] = names[count];
        count += !is_of_papers(names[count]);
    }
    if (dir)
        closedir(dir);
    qsort(list, count, sizeof(*list), by_name);
    pell_text_suggest_or_list(&hint, "known: ", what, list, count);
    return cli_usage(cli, "bench", count ? hint.str : "the folder of bench scenes is missing next to the program",
                     "there is no bench "
                     "\"%s\"",
                     what);
}

/* "screen-space" -> that scene of the bench folder; a name with a '/' or a '.' is a path. */
static enum exit_code find_scene(struct cli *cli, const char *what, char *path, size_t size)
{
    char folder[3000] = "";

    snprintf(path, size, "%s", what);
    if (strchr(what, '/') || strchr(what, '.'))
        return EXIT_OK;
    if (find_folder(folder, sizeof(folder))) {
        snprintf(path, size, "%s/%s.json", folder, what);
        if (what[0] && access(path, R_OK) == 0)
            return EXIT_OK;
    }
    return unknown_bench(cli, what, folder);
}

/* Fraction of the image that the scene's objects cover. */
static double covered(const struct session *s, const struct rows *rows)
{
    for (size_t i = 0; i < rows->count; i++)
        if (strcmp(rows->items[i].name, "surface") == 0)
            return (double) rows->items[i].pixels / ((double) s->settings.width * s->settings.height * s->settings.msaa);
    return 0.0;
}

static enum exit_code answer(struct cli *cli, const struct session *s, const char *what, const struct rows *rows,
                             const struct pell_rect *rect)
{
    const char *method = s->method ? s->method->name : "none", *engine = pell_engine_name(pell_device_engine(s->device));
    const int threads = pell_device_threads(s->device);
    json_t *facts = json_pack("{s:s,s:s,s:i,s:i,s:i,s:i,s:f,s:[i,i,i,i]}", "method", method, "engine", engine, "threads", threads, "width",
                              s->settings.width, "height", s->settings.height, "msaa", s->settings.msaa, "covered", covered(s, rows),
                              "rect", rect->x0, rect->y0, rect->x1, rect->y1);
    char setup[320];

    snprintf(setup, sizeof(setup),
             "method %s on engine %s, %d threads; %d x %d, %d sample%s per pixel, objects cover %.1f %% of the image;\n"
             "medians of %d warm frames",
             method, engine, threads, s->settings.width, s->settings.height, s->settings.msaa, s->settings.msaa > 1 ? "s" : "",
             100.0 * covered(s, rows), cli->numbers.repeats);
    return bench_answer(cli, what, facts, rows, BENCH_PIXELS | BENCH_RAYS | BENCH_COPY, NULL, setup);
}

static enum exit_code render(struct cli *cli, const char *what, const char *path)
{
    struct session s = { 0 };
    struct rows rows = { .count = 0 };
    struct pell_rect rect = { 0 };
    enum exit_code code;

    cli->stats = true; /* times are compared with copies */
    code = session_open(cli, path, &s);
    if (code == EXIT_OK)
        code = cli_failed(cli, measure(cli, &s, &rows, &rect));
    if (code == EXIT_OK)
        code = answer(cli, &s, what, &rows, &rect);
    session_close(&s);
    return code;
}

enum exit_code command_bench(struct cli *cli)
{
    const char *what = cli->num_arguments > 0 ? cli->arguments[0] : "screen-space";
    char path[4096];
    enum exit_code code;

    if (is_of_papers(what))
        return cli_usage(cli, "bench", NULL, "%s is in a program of its own, built from the source: build/bench/pellucid-bench %s", what,
                         what);
    code = find_scene(cli, what, path, sizeof(path));
    return code == EXIT_OK ? render(cli, what, path) : code;
}
