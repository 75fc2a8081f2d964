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

struct bench {
    struct cli *cli;
    struct session *s;
    struct rows rows;
    int repeats;
    float *truth; /* R, G, B, A of the reference */
};

struct run {
    const char *method;
    struct pell_setting settings[4];
    size_t count;
};

/* What all methods share. */
static bool is_common(const char *stage)
{
    static const char *const names[] = { "prepare", "surface", "irradiance", "lit", "composite", "post" };

    for (size_t i = 0; i < PELL_COUNT(names); i++)
        if (strcmp(stage, names[i]) == 0)
            return true;
    return false;
}

static enum pell_result choose(struct bench *b, const struct run *run, int size)
{
    const struct pell_method *m = pell_method_find(b->cli->ctx, "bench mertens", run->method);
    void *values = m ? calloc(1, m->knobs_size) : NULL;
    enum pell_result res = m ? PELL_ERR_NOMEM : PELL_ERR_INVALID;

    if (values)
        res = pell_method_configure(b->cli->ctx, m, run->settings, run->count, values);
    if (res == PELL_OK)
        res = pell_renderer_set_method(b->s->renderer, m, values);
    free(values);
    b->s->settings.width = b->s->settings.height = size;
    return res;
}

/* Root mean square difference from the reference over its mean, of pixels that both cover. */
static double error_of(const struct bench *b, const struct pell_picture *p)
{
    const size_t size = (size_t) p->width * (size_t) p->height;
    double square = 0.0, sum = 0.0;

    for (int y = 0; y < p->height; y++)
        for (int x = 0; x < p->width; x++)
            for (size_t c = 0; c < 3 && b->truth[3 * size + (size_t) (y * p->width + x)] >= 1.0f; c++) {
                const double t = (double) b->truth[c * size + (size_t) (y * p->width + x)];
                const double d = (double) p->channels[c].data[y * p->channels[c].stride + x] - t;
                square += d * d;
                sum += t;
            }
    return sum > 0.0 ? sqrt(square * (double) (3 * size)) / sum : 0.0;
}

static enum pell_result keep_truth(struct bench *b, int size)
{
    const struct run run = { "hierarchical", { { "most", REFERENCE, "bench" } }, 1 };
    struct pell_picture p;
    enum pell_result res;

    PELL_TRY(choose(b, &run, size));
    PELL_TRY(pell_renderer_render(b->s->renderer, &b->s->settings, &p));
    for (size_t c = 0; c < 4; c++)
        for (int y = 0; y < size; y++)
            memcpy(b->truth + (c * (size_t) size + (size_t) y) * (size_t) size, p.channels[c].data + y * p.channels[c].stride,
                   (size_t) size * sizeof(float));
    return PELL_OK;

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
        PELL_TRY(pell_renderer_render(b->s->renderer, &b->s->settings, &p));
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
        if (is_common(t->name))
            continue;
        sum += median;
        copy += t->copy_ms;
        bytes += t->bytes;
        pixels = t->pixels > pixels ? t->pixels : pixels;
        snprintf(text, sizeof(text), "  %s", t->name);
        if (stages && (r = bench_add(&b->rows, text, median))) {
            r->pixels = t->pixels;
            r->bytes = t->bytes;
            r->copy_ms = t->copy_ms;
            r->ratio = t->copy_ms > 0.0 ? median / t->copy_ms : 0.0;
            r->against = "copy";
        }
    }
    if ((r = bench_add(&b->rows, name, sum))) {
        r->pixels = pixels;
        r->bytes = bytes;
        r->copy_ms = copy;
        r->ratio = copy > 0.0 ? sum / copy : 0.0;
        r->against = "copy";
        r->items = samples * pixels;
        r->error = b->truth && size == 500 ? error_of(b, &p) : (double) NAN;
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

/* Makes light of every material go `factor` times as far. */
static enum pell_result stretch(struct bench *b, double factor)
{
    for (size_t i = 0; i < b->s->scene->num_materials; i++)
        for (int c = 0; c < 3; c++) {
            b->s->scene->materials[i].medium.sigma_a[c] /= factor;
            b->s->scene->materials[i].medium.sigma_s_reduced[c] /= factor;
        }
    return pell_renderer_set_scene(b->s->renderer, b->s->scene);
}

/* The same surface so near that it fills the picture, and how the time hangs on how far light goes. */
static enum pell_result filled(struct bench *b)
{
    static const double radii[] = { 0.25, 1.0, 4.0 };
    static const char *const names[] = { "filled, 16 samples, radius x 0.25", "filled, 16 samples, radius x 1",
                                         "filled, 16 samples, radius x 4" };
    const struct run run = { "image-space", { { "samples", "16", "bench" }, { "sampling", "combined", "bench" } }, 2 };
    const float fov = b->s->scene->cameras[0].fov;
    double ms[PELL_COUNT(radii)], now = 1.0;
    enum pell_result res;

    b->s->scene->cameras[0].fov = fov * FILLING;
    for (size_t i = 0; i < PELL_COUNT(radii); i++) {
        PELL_TRY(stretch(b, radii[i] / now));
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
    b->s->scene->cameras[0].fov = fov;
    return stretch(b, 1.0 / now);

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

static enum exit_code answer(struct cli *cli, const struct bench *b)
{
    const int threads = pell_renderer_threads(b->s->renderer);
    char device[160], build[64];

    cli_device_name(device, sizeof(device));
    snprintf(build, sizeof(build), "%s, SIMD level %s", pell_version(), pell_simd_name(pell_simd_best()));
    if (cli->json)
        return cli_print_json(cli, json_pack("{s:s,s:s,s:s,s:i,s:s,s:i,s:o}", "bench", "mertens", "engine", "cpu", "device", device,
                                             "threads", threads, "build", build, "repeats", b->repeats, "rows", bench_json(&b->rows)));
    printf("mertens: %d threads, %s\npellucid %s\nmedians of %d warm frames of the method's own stages; errors against hierarchical of at "
           "most %s samples\n\n%-34s %9s %10s %12s %8s  %s\n", threads, device, build, b->repeats, REFERENCE, "row", "ms", "pixels",
           "samples/s", "error %", "ratio");
    for (size_t i = 0; i < b->rows.count; i++) {
        const struct row *r = &b->rows.items[i];
        printf("%-34s %9.2f ", r->name, r->ms);
        if (r->pixels)
            printf("%10lld ", (long long) r->pixels);
        else
            printf("%10s ", "");
        if (r->items && r->ms > 0.0)
            printf("%12.4g ", 1e3 * (double) r->items / r->ms);
        else
            printf("%12s ", "");
        if (isfinite(r->error))
            printf("%8.3f  ", 100.0 * r->error);
        else
            printf("%8s  ", "");
        if (r->against && r->ratio > 0.0)
            printf("%.2f x %s", r->ratio, r->against);
        putchar('\n');
    }
    return EXIT_OK;
}

enum exit_code bench_mertens(struct cli *cli, const char *path)
{
    struct session s = { 0 };
    struct bench *b = calloc(1, sizeof(*b));
    enum exit_code code = EXIT_MEMORY;

    cli->stats = true; /* times are compared with copies */
    if (b)
        b->truth = calloc((size_t) 4 * 500 * 500, sizeof(*b->truth));
    if (b && b->truth) {
        b->cli = cli;
        b->s = &s;
        b->repeats = cli->numbers.repeats;
        code = session_open(cli, path, &s);
        s.settings.msaa = 1;
        if (code == EXIT_OK)
            code = cli_failed(cli, run_all(b));
        if (code == EXIT_OK)
            code = answer(cli, b);
        session_close(&s);
    }
    if (b)
        free(b->truth);
    free(b);
    return code;
}
