/* SPDX-License-Identifier: MIT
 * mertens.c - `pellucid-bench mertens`: the image-space method on its scene, 500 x 500 and twice that, with 16 and 64 samples, half of
 * them uniform; and the error of screen-space and hierarchical in equal time. (The paper: 4 to 5 frames a second at 500 x 500 on a Radeon
 * 9700 Pro; it prints no number of samples.) */
#include "papers.h"

#include <math.h>
#include <string.h>

#define REFERENCE "500000" /* samples of the hierarchical reference that errors are measured against, at most */
#define COARSE "20000"     /* and of the one that is compared */
#define FILLING 0.5f       /* of the view's angle: the face alone */

/* A method on a square image: its row has a ratio to copies, samples and an error. */
static enum pell_result measure(struct bench *b, int size, const char *name, const struct bench_run *run, int64_t samples, double *ms)
{
    struct bench_result r;
    enum pell_result res;

    b->s.settings.width = b->s.settings.height = size;
    PELL_TRY(bench_measure(b, name, run, &r));
    *ms = r.row ? r.row->ms : 0.0;
    if (r.row) {
        r.row->ratio = r.row->bandwidth_ms > 0.0 ? r.row->ms / r.row->bandwidth_ms : 0.0;
        r.row->against = "copy";
        r.row->items = samples * r.pixels;
    }
    if (strcmp(run->method, "hierarchical") == 0)
        bench_add(&b->rows, "  once a scene: samples, octree", r.once_ms);

fail:
    return res;
}

static enum pell_result image_space(struct bench *b, int size, int samples, double *ms)
{
    char knobs[64], name[96];
    const struct bench_run run = { "image-space", knobs, .stages = true };

    snprintf(knobs, sizeof(knobs), "samples=%d sampling=combined", samples);
    snprintf(name, sizeof(name), "%d x %d, %d samples", size, size, samples);
    return measure(b, size, name, &run, samples, ms);
}

/* A close-up in which the surface fills the image, and the dependence of the time on the mean free path. */
static enum pell_result filled(struct bench *b)
{
    static const double radii[] = { 0.25, 1.0, 4.0 };
    const float fov = b->s.scene->cameras[0].fov;
    size_t at[PELL_COUNT(radii)];
    double ms[PELL_COUNT(radii)], radius = 1.0;
    enum pell_result res;

    b->s.scene->cameras[0].fov = fov * FILLING;
    for (size_t i = 0; i < PELL_COUNT(radii); i++) {
        const struct bench_run run = { "image-space", "samples=16 sampling=combined", .stages = i == 1 };
        char name[64];
        PELL_TRY(bench_stretch(b, radii[i] / radius));
        radius = radii[i];
        snprintf(name, sizeof(name), "filled, 16 samples, radius x %g", radius);
        PELL_TRY(measure(b, 500, name, &run, 16, &ms[i]));
        at[i] = b->rows.count - 1;
        b->rows.items[at[i]].error = (double) NAN; /* it is another image */
    }
    for (size_t i = 0; i < PELL_COUNT(radii); i += 2) {
        b->rows.items[at[i]].ratio = ms[i] / ms[1];
        b->rows.items[at[i]].against = "radius x 1";
    }
    b->s.scene->cameras[0].fov = fov;
    return bench_stretch(b, 1.0 / radius);

fail:
    return res;
}

enum pell_result bench_mertens(struct bench *b)
{
    static const struct bench_run views = { "image-space", "samples=64 views=eye+lights", false, false };
    static const struct bench_run screen = { "screen-space", "", false, false },
                                  coarse = { "hierarchical", "points=" COARSE, false, false };
    double ms[2][2], screen_ms, hierarchical_ms, ignored_ms;
    struct row *r;
    int equal;
    enum pell_result res;

    snprintf(b->setup, sizeof(b->setup),
             "medians of %d warm frames of the method's own stages; errors against hierarchical of at most " REFERENCE " samples",
             b->repeats);
    b->s.settings.width = b->s.settings.height = 500;
    PELL_TRY(bench_keep_truth(b, "hierarchical", "points=" REFERENCE));
    for (int size = 0; size < 2; size++)
        for (int many = 0; many < 2; many++)
            PELL_TRY(image_space(b, size ? 1000 : 500, many ? 64 : 16, &ms[size][many]));
    if ((r = bench_add(&b->rows, "a sample more, 500 x 500", (ms[0][1] - ms[0][0]) / 48.0))) {
        r->ratio = (ms[0][1] - ms[0][0]) / 48.0 / (ms[0][0] / 16.0);
        r->against = "a 16th of 16 samples";
    }
    PELL_TRY(measure(b, 500, "500 x 500, 64 samples, eye+lights", &views, 128, &ignored_ms));
    PELL_TRY(measure(b, 500, "screen-space, 500 x 500", &screen, 0, &screen_ms));
    PELL_TRY(measure(b, 500, "hierarchical, points=" COARSE, &coarse, 0, &hierarchical_ms));
    equal = (int) fmin(fmax(16.0 * screen_ms / ms[0][0], 1.0), 64.0);
    PELL_TRY(image_space(b, 500, equal, &ignored_ms));
    equal = (int) fmin(fmax(64.0 * hierarchical_ms / ms[0][1], 1.0), 1024.0);
    PELL_TRY(image_space(b, 500, equal, &ignored_ms));
    return filled(b);

fail:
    return res;
}
