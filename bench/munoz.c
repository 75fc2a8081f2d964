/* SPDX-License-Identifier: MIT
 * munoz.c - `pellucid-bench munoz-2`, `munoz-3`, `munoz-5`: the convolution method as in figures 2, 3 and 5 of its paper: two sizes of an
 * object, a factor of ten apart, by threshold; resolutions of the planes, also of an object that fills the image; numbers of planes.
 * (The paper, on a Core i7 of 2.66 GHz, the transforms alone: 4 planes at 800 x 600 7 s, 2 s with half the resolution and a threshold of
 * 0.1 %; 2, 4, 8, 16 planes at 800 x 800 7, 14, 33, 100 s.) */
#include "papers.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define REFERENCE "200000" /* samples of the hierarchical reference that errors are measured against, at most */
#define FILLING 0.2f       /* of the view's angle: only the object is in view */

static enum pell_result keep_truth(struct bench *b)
{
    snprintf(b->setup, sizeof(b->setup),
             "%d x %d; medians of %d warm frames of the method's own stages; errors against hierarchical of at most " REFERENCE " samples",
             b->s.settings.width, b->s.settings.height, b->repeats);
    return bench_keep_truth(b, "hierarchical", "points=" REFERENCE);
}

/* The method's own stages of warm frames, and their sum; a row counts the visible pixels. `moving`: as for bench_run. */
static enum pell_result measure(struct bench *b, const char *name, const char *knobs, bool stages, bool moving)
{
    const struct bench_run run = { "convolution", knobs, stages, moving };
    const double size = (double) b->s.settings.width * b->s.settings.height;
    struct bench_result r;
    enum pell_result res;

    PELL_TRY(bench_measure(b, name, &run, &r));
    if (r.row) {
        r.row->pixels = r.visible;
        if (moving)
            snprintf(r.row->name, sizeof(r.row->name), "%s, filled %.0f %%", name, 100.0 * (double) r.visible / size);
    }

fail:
    return res;
}

/* Mean number of planes that contribute to a plane, including itself, by the dipole: by the fraction of the light that travels that far,
 * or, as printed in the paper, by the profile's value there over its value at 0. */
static double convolutions(const struct pell_material *m, double range, int planes, double threshold, bool printed)
{
    struct pell_profile *profile = malloc(sizeof(*profile));
    double sum = 0.0;

    for (int c = 0; profile && c < 3; c++) {
        if (pell_profile_make(PELL_PROFILE_DIPOLE, &m->medium, c, NULL, profile) != PELL_OK)
            continue;
        sum += 1.0;
        for (int k = 1; k < planes; k++) {
            const double h = k * range / (planes - 1);
            const bool kept = printed ? pell_profile_eval(profile, h) >= threshold * pell_profile_eval(profile, 0.0)
                                      : 1.0 - pell_profile_cdf(profile, h) > threshold;
            sum += kept ? 2.0 * (planes - k) / planes : 0.0;
        }
    }
    free(profile);
    return sum / 3.0;
}

/* Depth of the scene's bounds along the view. */
static double depth_range(const struct pell_scene *s)
{
    double range = 0.0;

    for (int k = 0; k < 3; k++)
        range += fabs((double) s->cameras[0].forward[k]) * (double) (s->bounds_max[k] - s->bounds_min[k]);
    return range;
}

enum pell_result bench_munoz_2(struct bench *b)
{
    static const struct {
        const char *value, *rule;
    } rows[] = { { "0", "energy" }, { "0.001", "energy" }, { "0.001", "printed" }, { "0.05", "energy" }, { "0.05", "printed" } };
    const struct pell_scene *s = b->s.scene;
    const int profile = b->s.settings.profile;
    enum pell_result res;

    b->s.settings.profile = 1 + PELL_PROFILE_DIPOLE; /* the paper's: the printed threshold is relative to its value at 0 */
    for (int small = 0; small < 2; small++) {
        if (small)
            PELL_TRY(bench_stretch(b, 10.0)); /* as if the object were ten times smaller */
        PELL_TRY(keep_truth(b));
        for (size_t i = 0; i < PELL_COUNT(rows); i++) {
            const bool printed = strcmp(rows[i].rule, "printed") == 0;
            const double n = convolutions(&s->materials[s->meshes[0].material], depth_range(s), 8, strtod(rows[i].value, NULL), printed);
            char knobs[96], name[96];
            snprintf(knobs, sizeof(knobs), "planes=8 resolution=1 threshold=%s threshold-by=%s", rows[i].value, rows[i].rule);
            snprintf(name, sizeof(name), "%s, t %s%s, %.1f convolutions", small ? "small" : "large", rows[i].value,
                     printed ? " as printed" : "", n);
            PELL_TRY(measure(b, name, knobs, false, false));
        }
        PELL_TRY(measure(b, small ? "small, also planes that are not seen" : "large, also planes that are not seen",
                         "planes=8 resolution=1 threshold=0 visible=off", false, false));
    }
    res = PELL_OK;

fail:
    b->s.settings.profile = profile;
    return res;
}

/* Threshold by resolution, for the material as it is, and ten times as dense. */
static enum pell_result thresholds_and_resolutions(struct bench *b)
{
    static const char *const rows[][2] = { { "0.001", "1" }, { "0.001", "1/2" }, { "0.05", "1" }, { "0.05", "1/2" } };
    enum pell_result res;

    for (int dense = 0; dense < 2; dense++) {
        if (dense) {
            PELL_TRY(bench_stretch(b, 0.1));
            PELL_TRY(keep_truth(b));
        }
        for (size_t i = 0; i < PELL_COUNT(rows); i++) {
            char knobs[96], name[96];
            snprintf(knobs, sizeof(knobs), "planes=8 threshold=%s resolution=%s", rows[i][0], rows[i][1]);
            snprintf(name, sizeof(name), "%s, t %s, resolution %s", dense ? "dense" : "translucent", rows[i][0], rows[i][1]);
            PELL_TRY(measure(b, name, knobs, false, false));
        }
    }
    return PELL_OK;

fail:
    return res;
}

/* A close-up in which only the object is in view, nothing kept from frame to frame: by resolution, and by mean free path. */
static enum pell_result fill(struct bench *b)
{
    static const char *const values[] = { "1", "1/2", "1/4" };
    static const double radii[] = { 0.25, 1.0, 4.0 };
    const struct pell_camera camera = b->s.scene->cameras[0];
    double radius = 1.0, base_ms = 0.0;
    char name[64], knobs[64];
    size_t first;
    enum pell_result res;

    b->s.scene->cameras[0].fov = camera.fov * FILLING;
    for (size_t i = 0; i < PELL_COUNT(values); i++) {
        snprintf(name, sizeof(name), "4 planes, resolution %s", values[i]);
        snprintf(knobs, sizeof(knobs), "planes=4 resolution=%s", values[i]);
        PELL_TRY(measure(b, name, knobs, true, true));
    }
    PELL_TRY(measure(b, "4 planes, resolution 1/2, behind-step 2", "planes=4 resolution=1/2 behind-step=2", true, true));
    first = b->rows.count;
    for (size_t i = 0; i < PELL_COUNT(radii); i++) {
        PELL_TRY(bench_stretch(b, radii[i] / radius));
        radius = radii[i];
        snprintf(name, sizeof(name), "radius x %g", radius);
        PELL_TRY(measure(b, name, "planes=4 resolution=1", false, true));
        base_ms = i == 1 ? b->rows.items[b->rows.count - 1].ms : base_ms;
    }
    for (size_t i = first; i < b->rows.count; i++) {
        b->rows.items[i].ratio = base_ms > 0.0 ? b->rows.items[i].ms / base_ms : 0.0;
        b->rows.items[i].against = "radius x 1";
    }
    b->s.scene->cameras[0] = camera;
    return bench_stretch(b, 1.0 / radius);

fail:
    return res;
}

enum pell_result bench_munoz_3(struct bench *b)
{
    static const char *const values[] = { "1", "1/2", "1/4" };
    enum pell_result res;

    PELL_TRY(keep_truth(b));
    for (int planes = 4; planes <= 8; planes *= 2)
        for (size_t i = 0; i < PELL_COUNT(values); i++) {
            char knobs[64], name[96];
            snprintf(knobs, sizeof(knobs), "planes=%d resolution=%s", planes, values[i]);
            snprintf(name, sizeof(name), "%d planes, resolution %s", planes, values[i]);
            PELL_TRY(measure(b, name, knobs, planes == 4 && i == 0, false));
        }
    PELL_TRY(fill(b));
    PELL_TRY(thresholds_and_resolutions(b));
    return PELL_OK;

fail:
    return res;
}

enum pell_result bench_munoz_5(struct bench *b)
{
    enum pell_result res;

    PELL_TRY(keep_truth(b));
    for (int paper = 0; paper < 2; paper++)
        for (int n = 2; n <= 16; n *= 2) {
            char knobs[64], name[96];
            snprintf(knobs, sizeof(knobs), "as=%s planes=%d resolution=1", paper ? "paper" : "best", n);
            snprintf(name, sizeof(name), "%d planes%s", n, paper ? ", as=paper" : "");
            PELL_TRY(measure(b, name, knobs, !paper && n == 4, false));
        }
    return PELL_OK;

fail:
    return res;
}
