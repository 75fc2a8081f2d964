/* SPDX-License-Identifier: MIT
 * bench_mertens.c - `pellucid bench mertens`: the image-space method on its scene, 500 x 500 and twice that, 16 and 64 samples, half of
 * them uniform; and what an equal time gives by screen-space and hierarchical. (The paper: 4 to 5 frames a second at 500 x 500 on a Radeon
 * 9700 Pro; it prints no number of samples.) */
#include "cli/bench.h"

#include "base/simd.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define REFERENCE "500000" /* samples of the hierarchical that errors are against, at most */
#define COARSE "20000"     /* and of the one that is compared */
#define FILLING 0.5f       /* of the view's angle: the face alone */

struct run {
    const char *method;
    struct pell_setting settings[4];
    size_t count;
};

static enum pell_result choose(struct bench *b, const struct run *run, int size)
{
    b->s.settings.width = b->s.settings.height = size;
    return bench_choose(b, run->method, run->settings, run->count);
}

static enum pell_result keep_truth(struct bench *b, int size)
{
    const struct run run = { "hierarchical", { { "most", REFERENCE, "bench" } }, 1 };
    struct pell_picture p;
    enum pell_result res;

    PELL_TRY(choose(b, &run, size));
    PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
    PELL_TRY(bench_keep_truth(b, &p));

fail:
    return res;
}

/* Renders a method: its own stages, each the median of the warm frames, their sum, and what it does once. */
static enum pell_result measure(struct bench *b, const struct run *run, int size, const char *name, int64_t samples, bool stages,
                                double *ms)
{
    double *times = calloc((size_t) b->repeats * MAX_STAGES, sizeof(*times)), once = 0.0, sum = 0.0, copy = 0.0;
    struct pell_picture p = { 0 };
    enum pell_result res = times ? PELL_OK : PELL_ERR_NOMEM;
    int64_t pixels = 0, bytes = 0;
    struct row *r;

    PELL_TRY(res);
    PELL_TRY(choose(b, run, size));
    for (int i = -1; i < b->repeats; i++) {
        PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
        for (size_t k = 0; k < p.num_stages && k < MAX_STAGES; k++) {
            if (i < 0 && strcmp(p.stages[k].name, "prepare") == 0)
                once = p.stages[k].ms;
            if (i >= 0)
                times[k * (size_t) b->repeats + (size_t) i] = p.stages[k].ms;
        }
    }
    for (size_t k = 0; k < p.num_stages && k < MAX_STAGES; k++) {
        const struct pell_stage_time *t = &p.stages[k];
        const double median = bench_median(times + k * (size_t) b->repeats, b->repeats);
        char text[96];
        if (bench_is_common(t->name))
            continue;
        sum += median;
        copy += t->copy_ms;
        bytes += t->bytes;
        pixels = t->pixels > pixels ? t->pixels : pixels;
        snprintf(text, sizeof(text), "  %s", t->name);
        if (stages)
            bench_add_stage(&b->rows, text, median, t);
    }
    if ((r = bench_add(&b->rows, name, sum))) {
        r->pixels = pixels;
        r->bytes = bytes;
        r->copy_ms = copy;
        r->ratio = copy > 0.0 ? sum / copy : 0.0;
        r->against = "copy";
        r->items = samples * pixels;
        r->error = bench_error(b, &p);
    }
    if (strcmp(run->method, "hierarchical") == 0)
        bench_add(&b->rows, "  once a scene: samples, octree", once);
    *ms = sum;

fail:
    free(times);
    return res;
}

static enum pell_result image_space(struct bench *b, int size, int samples, double *ms)
{
    char text[32], name[96];
    const struct run run = { "image-space", { { "samples", text, "bench" }, { "sampling", "combined", "bench" } }, 2 };

    snprintf(text, sizeof(text), "%d", samples);
    snprintf(name, sizeof(name), "%d x %d, %d samples", size, size, samples);
    return measure(b, &run, size, name, samples, true, ms);
}

/* The same surface so near that it fills the picture, and how the time hangs on how far light goes. */
static enum pell_result filled(struct bench *b)
{
    static const double radii[] = { 0.25, 1.0, 4.0 };
    static const char *const names[] = { "filled, 16 samples, radius x 0.25", "filled, 16 samples, radius x 1",
                                         "filled, 16 samples, radius x 4" };
    const struct run run = { "image-space", { { "samples", "16", "bench" }, { "sampling", "combined", "bench" } }, 2 };
    const float fov = b->s.scene->cameras[0].fov;
    double ms[PELL_COUNT(radii)], now = 1.0;
    enum pell_result res;

    b->s.scene->cameras[0].fov = fov * FILLING;
    for (size_t i = 0; i < PELL_COUNT(radii); i++) {
        PELL_TRY(bench_stretch(b, radii[i] / now));
        now = radii[i];
        PELL_TRY(measure(b, &run, 500, names[i], 16, i == 1, &ms[i]));
        b->rows.items[b->rows.count - 1].error = (double) NAN; /* it is another picture */
    }
    for (size_t i = 0; i < b->rows.count; i++)
        for (size_t k = 0; k < PELL_COUNT(radii); k++)
            if (k != 1 && strcmp(b->rows.items[i].name, names[k]) == 0) {
                b->rows.items[i].ratio = ms[k] / ms[1];
                b->rows.items[i].against = "radius x 1";
            }
    b->s.scene->cameras[0].fov = fov;
    return bench_stretch(b, 1.0 / now);

fail:
    return res;
}

static enum pell_result run_all(struct bench *b)
{
    const struct run views = { "image-space", { { "samples", "64", "bench" }, { "views", "eye+lights", "bench" } }, 2 };
    const struct run screen = { "screen-space", { { 0 } }, 0 }, coarse = { "hierarchical", { { "most", COARSE, "bench" } }, 1 };
    double ms[2][2], quick, whole;
    struct row *r;
    int equal;
    enum pell_result res;

    PELL_TRY(keep_truth(b, 500));
    for (int size = 0; size < 2; size++)
        for (int many = 0; many < 2; many++)
            PELL_TRY(image_space(b, size ? 1000 : 500, many ? 64 : 16, &ms[size][many]));
    if ((r = bench_add(&b->rows, "a sample more, 500 x 500", (ms[0][1] - ms[0][0]) / 48.0))) {
        r->ratio = (ms[0][1] - ms[0][0]) / 48.0 / (ms[0][0] / 16.0);
        r->against = "a 16th of 16 samples";
    }
    PELL_TRY(measure(b, &views, 500, "500 x 500, 64 samples, eye+lights", 128, false, &quick));
    PELL_TRY(measure(b, &screen, 500, "screen-space, 500 x 500", 0, false, &quick));
    PELL_TRY(measure(b, &coarse, 500, "hierarchical, most=" COARSE, 0, false, &whole));
    equal = (int) fmin(fmax(16.0 * quick / ms[0][0], 1.0), 64.0);
    PELL_TRY(image_space(b, 500, equal, &quick));
    equal = (int) fmin(fmax(64.0 * whole / ms[0][1], 1.0), 1024.0);
    PELL_TRY(image_space(b, 500, equal, &whole));
    return filled(b);

fail:
    return res;
}

enum exit_code bench_mertens(struct cli *cli, const char *what, const char *path)
{
    struct bench b;
    enum exit_code code = bench_open(&b, cli, path);

    if (code == EXIT_OK)
        code = cli_failed(cli, run_all(&b));
    if (code == EXIT_OK)
        code = bench_answer(&b, what, BENCH_PIXELS | BENCH_ERROR, "samples/s",
                            "medians of %d warm frames of the method's own stages; errors against hierarchical of at most %s samples",
                            b.repeats, REFERENCE);
    bench_close(&b);
    return code;
}
