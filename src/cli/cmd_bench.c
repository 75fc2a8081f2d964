/* SPDX-License-Identifier: MIT
 * cmd_bench.c - `pellucid bench`: times of the stages, cold and warm, as ratios to copying the same bytes in the same run. */
#include "cli/cli.h"

#include "base/file.h"
#include "math/vec.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define MAX_STAGES 48
#define DEFAULT_REPEATS 15

struct row {
    char name[96];
    double ms, copy_ms, ratio; /* ratio: what the row says it is, 0 where it has none */
    const char *against;       /* what `ratio` is a ratio to */
    int64_t pixels, rays, bytes;
};

struct rows {
    struct row items[MAX_STAGES + 16];
    size_t count;
};

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return (x > y) - (x < y);
}

static double median(double *values, int count)
{
    qsort(values, (size_t) count, sizeof(*values), by_value);
    return count % 2 ? values[count / 2] : 0.5 * (values[count / 2 - 1] + values[count / 2]);
}

static struct row *add_row(struct rows *rows, const char *name, double ms)
{
    struct row *r;
    if (rows->count == PELL_COUNT(rows->items))
        return NULL;
    r = &rows->items[rows->count++];
    *r = (struct row) { .ms = ms };
    snprintf(r->name, sizeof(r->name), "%s", name);
    return r;
}

/* Renders `repeats` warm frames; medians of the frame and, where `stages` is given, of each stage. */
static enum pell_result warm_frames(struct cli *cli, struct session *s, struct pell_renderer *renderer, int repeats, double *frame_ms,
                                    struct rows *stages)
{
    double *frames = calloc((size_t) repeats * (MAX_STAGES + 1), sizeof(*frames));
    struct pell_picture p = { 0 };
    enum pell_result res = frames ? PELL_OK : PELL_ERR_NOMEM;

    for (int i = 0; i < repeats && res == PELL_OK; i++) {
        res = pell_renderer_render(renderer, &s->settings, &p);
        frames[i] = 1e3 * p.seconds;
        for (size_t k = 0; k < p.num_stages && k < MAX_STAGES; k++)
            frames[(k + 1) * (size_t) repeats + (size_t) i] = p.stages[k].ms;
        cli_progress(cli, "bench", (double) (i + 1) / repeats);
    }
    cli_progress_end(cli);
    if (res == PELL_OK) {
        *frame_ms = median(frames, repeats);
        for (size_t k = 0; stages && k < p.num_stages && k < MAX_STAGES; k++) {
            const struct pell_stage_time *t = &p.stages[k];
            struct row *r = add_row(stages, t->name, median(frames + (k + 1) * (size_t) repeats, repeats));
            if (r) {
                r->pixels = t->pixels;
                r->rays = t->rays;
                r->bytes = t->bytes;
                r->copy_ms = t->copy_ms;
                r->ratio = t->copy_ms > 0.0 ? r->ms / t->copy_ms : 0.0;
                r->against = "copy";
            }
        }
    }
    free(frames);
    return res;
}

/* The same frame by another number of threads, in the same run. */
static enum pell_result one_thread(struct cli *cli, struct session *s, int repeats, double *ms)
{
    struct pell_renderer *r = NULL;
    struct pell_picture p;
    enum pell_result res = pell_renderer_create(cli->ctx, &(struct pell_renderer_params) { .threads = 1 }, &r);

    if (res == PELL_OK)
        res = pell_renderer_set_scene(r, s->scene);
    if (res == PELL_OK)
        res = pell_renderer_set_method(r, s->method, s->knobs);
    if (res == PELL_OK)
        res = pell_renderer_render(r, &s->settings, &p);
    if (res == PELL_OK)
        res = warm_frames(cli, s, r, repeats, ms, NULL);
    pell_renderer_destroy(&r);
    return res;
}

/* Moves the camera back so that the middle of the bounds is `times` as far. */
static void recede(const struct pell_scene *scene, const struct pell_camera *from, float times, struct pell_camera *to)
{
    const struct pell_vec3 middle = vec3_mul(vec3_add(vec3_load(scene->bounds_min), vec3_load(scene->bounds_max)), 0.5f);
    const struct pell_vec3 away = vec3_sub(vec3_load(from->position), middle);
    vec3_store(vec3_add(middle, vec3_mul(away, times)), to->position);
}

static enum pell_result measure(struct cli *cli, struct session *s, struct rows *rows, struct pell_rect *rect)
{
    const int repeats = cli->repeats > 0 ? cli->repeats : DEFAULT_REPEATS;
    const struct pell_camera camera = s->scene->cameras[0];
    struct pell_picture p;
    struct row *r;
    double cold, warm, one, far;
    enum pell_result res;

    PELL_TRY(pell_renderer_render(s->renderer, &s->settings, &p));
    cold = 1e3 * p.seconds;
    *rect = p.rect;
    PELL_TRY(warm_frames(cli, s, s->renderer, repeats, &warm, rows));
    add_row(rows, "frame", warm);
    add_row(rows, "frame cold", cold);
    if (pell_renderer_threads(s->renderer) > 1) {
        PELL_TRY(one_thread(cli, s, repeats, &one));
        if ((r = add_row(rows, "frame by one thread", one))) {
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
        snprintf(name, sizeof(name), "frame, %d times as far", times);
        if ((r = add_row(rows, name, far))) {
            r->ratio = far / warm;
            r->against = "frame";
        }
    }
    return PELL_OK;

fail:
    return res;
}

/* "screen-space" -> the file bench/screen-space.json beside the program or in its data folder; a path is taken as it is. */
static void find_scene(const char *what, char *path, size_t size)
{
    static const char *const folders[] = { "bench", "../bench", "../share/pellucid/bench" };
    char program[2048];
    const ssize_t n = readlink("/proc/self/exe", program, sizeof(program) - 1);

    snprintf(path, size, "%s", what);
    if (n <= 0 || strchr(what, '/') || strchr(what, '.'))
        return;
    program[n] = '\0';
    *strrchr(program, '/') = '\0';
    for (size_t i = 0; i < PELL_COUNT(folders); i++) {
        snprintf(path, size, "%s/%s/%s.json", program, folders[i], what);
        if (access(path, R_OK) == 0)
            return;
    }
    snprintf(path, size, "bench/%s.json", what);
}

static enum exit_code answer(struct cli *cli, const struct session *s, const char *what, const struct rows *rows, const struct pell_rect *rect)
{
    const int threads = pell_renderer_threads(s->renderer);

    if (cli->json) {
        json_t *list = json_array();
        for (size_t i = 0; i < rows->count; i++) {
            const struct row *r = &rows->items[i];
            json_t *o = json_pack("{s:s,s:f,s:I,s:I,s:I,s:f}", "name", r->name, "ms", r->ms, "pixels", (json_int_t) r->pixels, "rays",
                                  (json_int_t) r->rays, "bytes", (json_int_t) r->bytes, "copy_ms", r->copy_ms);
            if (o && r->against) {
                json_object_set_new(o, "ratio", json_real(r->ratio));
                json_object_set_new(o, "ratio_to", json_string(r->against));
            }
            json_array_append_new(list, o);
        }
        return cli_print_json(cli, json_pack("{s:s,s:s,s:s,s:i,s:s,s:i,s:i,s:[i,i,i,i],s:o}", "bench", what, "engine", "cpu", "device", "processor",
                                             "threads", threads, "build", pell_version(), "width", s->settings.width, "height", s->settings.height,
                                             "rect", rect->x0, rect->y0, rect->x1, rect->y1, "rows", list));
    }
    printf("%s on engine cpu, %d threads, %d x %d, %d sample(s) per pixel; medians of warm frames\n\n", what, threads, s->settings.width,
           s->settings.height, s->settings.msaa);
    printf("%-30s %9s %10s %10s %9s  %s\n", "row", "ms", "pixels", "rays", "copy ms", "ratio");
    for (size_t i = 0; i < rows->count; i++) {
        const struct row *r = &rows->items[i];
        printf("%-30s %9.2f ", r->name, r->ms);
        if (r->pixels)
            printf("%10lld %10lld %9.2f  ", (long long) r->pixels, (long long) r->rays, r->copy_ms);
        else
            printf("%10s %10s %9s  ", "", "", "");
        if (r->against && r->ratio > 0.0)
            printf("%.2f x %s", r->ratio, r->against);
        putchar('\n');
    }
    return EXIT_OK;
}

enum exit_code command_bench(struct cli *cli)
{
    const char *what = cli->num_arguments > 0 ? cli->arguments[0] : "screen-space";
    struct session s = { 0 };
    struct rows rows = { .count = 0 };
    struct pell_rect rect = { 0 };
    char path[4096];
    enum exit_code code;

    find_scene(what, path, sizeof(path));
    code = session_open(cli, path, &s);
    if (code == EXIT_OK)
        code = cli_failed(cli, measure(cli, &s, &rows, &rect));
    if (code == EXIT_OK)
        code = answer(cli, &s, what, &rows, &rect);
    session_close(cli, &s);
    return code;
}
