/* SPDX-License-Identifier: MIT
 * bench_munoz.c - `pellucid bench munoz-2`, `munoz-3`, `munoz-5`: the convolution method as in the figures 2, 3 and 5 of its paper: two
 * sizes of a thing ten times apart by threshold; resolutions of the planes, of a thing that fills the picture, too; numbers of planes.
 * (The paper, on a Core i7 of 2.66 GHz, the transforms alone: 4 planes at 800 x 600 7 s, 2 s with half the resolution and a threshold of
 * 0.1 %; 2, 4, 8, 16 planes at 800 x 800 7, 14, 33, 100 s.) */
#include "cli/bench.h"

#include "base/simd.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define REFERENCE "200000" /* samples of the hierarchical that errors are against, at most */
#define FILLING 0.2f       /* of the view's angle: the thing is all that is seen */
#define NUDGE 1e-4f        /* of the eye's distance that it moves from frame to frame, where nothing is to be kept */

static enum pell_result keep_truth(struct bench *b)
{
    const struct pell_setting most = { "most", REFERENCE, "bench" };
    struct pell_picture p;
    enum pell_result res;

    PELL_TRY(bench_choose(b, "hierarchical", &most, 1));
    PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
    PELL_TRY(bench_keep_truth(b, &p));

fail:
    return res;
}

/* The eye a little nearer, or back. */
static void nudge(struct bench *b, int frame)
{
    struct pell_camera *eye = &b->s.scene->cameras[0];
    float far = 0.0f;

    for (int k = 0; k < 3; k++)
        far += eye->forward[k] * (0.5f * (b->s.scene->bounds_min[k] + b->s.scene->bounds_max[k]) - eye->position[k]);
    for (int k = 0; k < 3; k++)
        eye->position[k] += (frame % 2 ? -NUDGE : NUDGE) * far * eye->forward[k];
}

/* The method's own stages of warm frames, and their sum. `moving`: the eye moves, so that spectra are made anew, and there is no error. */
static enum pell_result measure(struct bench *b, const char *name, const struct pell_setting *settings, size_t count, bool stages,
                                bool moving)
{
    double *times = calloc((size_t) b->repeats * MAX_STAGES, sizeof(*times)), sum = 0.0, copy = 0.0;
    struct pell_picture p = { 0 };
    enum pell_result res = times ? PELL_OK : PELL_ERR_NOMEM;
    int64_t pixels = 0;
    struct row *r;

    PELL_TRY(res);
    PELL_TRY(bench_choose(b, "convolution", settings, count));
    for (int i = -1; i < b->repeats; i++) {
        if (moving)
            nudge(b, i + 1);
        PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
        for (size_t k = 0; i >= 0 && k < p.num_stages && k < MAX_STAGES; k++)
            times[k * (size_t) b->repeats + (size_t) i] = p.stages[k].ms;
    }
    for (size_t k = 0; k < p.num_stages && k < MAX_STAGES; k++) {
        const struct pell_stage_time *t = &p.stages[k];
        const double median = bench_median(times + k * (size_t) b->repeats, b->repeats);
        char text[96];
        if (strcmp(t->name, "surface") == 0)
            pixels = t->pixels;
        if (bench_is_common(t->name))
            continue;
        sum += median;
        copy += t->copy_ms;
        snprintf(text, sizeof(text), "  %s", t->name);
        if (stages)
            bench_add_stage(&b->rows, text, median, t);
    }
    if ((r = bench_add(&b->rows, name, sum))) {
        r->pixels = pixels;
        r->copy_ms = copy;
        r->error = moving ? (double) NAN : bench_error(b, &p);
        if (moving)
            snprintf(r->name, sizeof(r->name), "%s, filled %.0f %%", name, 100.0 * (double) pixels / ((double) p.width * p.height));
    }

fail:
    free(times);
    return res;
}

/* How many planes' light a plane receives on the mean, its own too, by the share of the light that goes so far. */
static double convolutions(const struct pell_material *m, double range, int planes, double threshold)
{
    struct pell_profile *profile = malloc(sizeof(*profile));
    double sum = 0.0;

    for (int c = 0; profile && c < 3; c++) {
        if (pell_profile_make(m->model, &m->medium, c, NULL, profile) != PELL_OK)
            continue;
        sum += 1.0;
        for (int k = 1; k < planes; k++)
            if (1.0 - pell_profile_cdf(profile, k * range / (planes - 1)) > threshold)
                sum += 2.0 * (planes - k) / planes;
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

static enum pell_result thresholds(struct bench *b)
{
    static const char *const values[] = { "0", "0.001", "0.05" }, *const rules[] = { "energy", "printed" };
    enum pell_result res;

    for (int small = 0; small < 2; small++) {
        if (small)
            PELL_TRY(bench_stretch(b, 10.0)); /* as if the thing were ten times smaller */
        PELL_TRY(keep_truth(b));
        for (size_t i = 0; i < 2 * PELL_COUNT(values) - 1; i++) {
            const char *value = values[(i + 1) / 2], *rule = rules[i % 2 == 0 && i > 0];
            const struct pell_setting set[] = { { "planes", "8", "bench" },
                                                { "threshold", value, "bench" },
                                                { "threshold-by", rule, "bench" } };
            char name[96];
            if (i % 2 == 0 && i > 0)
                snprintf(name, sizeof(name), "%s, t %s as printed", small ? "small" : "large", value);
            else
                snprintf(name, sizeof(name), "%s, t %s, %.1f convolutions", small ? "small" : "large", value,
                         convolutions(&b->s.scene->materials[b->s.scene->meshes[0].material], depth_range(b->s.scene), 8,
                                      strtod(value, NULL)));
            PELL_TRY(measure(b, name, set, PELL_COUNT(set), false, false));
        }
    }
    return PELL_OK;

fail:
    return res;
}

/* Threshold by resolution, for the material as it is, and ten times as dense. */
static enum pell_result thresholds_and_resolutions(struct bench *b)
{
    static const char *const values[] = { "0.001", "0.05" }, *const sizes[] = { "1", "1/2" };
    enum pell_result res;

    for (int dense = 0; dense < 2; dense++) {
        if (dense) {
            PELL_TRY(bench_stretch(b, 0.1));
            PELL_TRY(keep_truth(b));
        }
        for (size_t i = 0; i < PELL_COUNT(values); i++)
            for (size_t k = 0; k < PELL_COUNT(sizes); k++) {
                const struct pell_setting set[] = { { "planes", "8", "bench" },
                                                    { "threshold", values[i], "bench" },
                                                    { "resolution", sizes[k], "bench" } };
                char name[96];
                snprintf(name, sizeof(name), "%s, t %s, resolution %s", dense ? "dense" : "translucent", values[i], sizes[k]);
                PELL_TRY(measure(b, name, set, PELL_COUNT(set), false, false));
            }
    }
    return PELL_OK;

fail:
    return res;
}

/* So near that the thing is all that is seen, nothing kept from frame to frame: by resolution, and by how far light goes. */
static enum pell_result fill(struct bench *b)
{
    static const char *const values[] = { "1", "1/2", "1/4" };
    static const double radii[] = { 0.25, 1.0, 4.0 };
    const struct pell_camera eye = b->s.scene->cameras[0];
    double now = 1.0, plain = 0.0;
    size_t first;
    enum pell_result res;

    b->s.scene->cameras[0].fov = eye.fov * FILLING;
    for (size_t i = 0; i < PELL_COUNT(values); i++) {
        const struct pell_setting set = { "resolution", values[i], "bench" };
        char name[64];
        snprintf(name, sizeof(name), "4 planes, resolution %s", values[i]);
        PELL_TRY(measure(b, name, &set, 1, true, true));
    }
    first = b->rows.count;
    for (size_t i = 0; i < PELL_COUNT(radii); i++) {
        char name[64];
        PELL_TRY(bench_stretch(b, radii[i] / now));
        now = radii[i];
        snprintf(name, sizeof(name), "radius x %g", now);
        PELL_TRY(measure(b, name, NULL, 0, false, true));
        plain = i == 1 ? b->rows.items[b->rows.count - 1].ms : plain;
    }
    for (size_t i = first; i < b->rows.count; i++) {
        b->rows.items[i].ratio = plain > 0.0 ? b->rows.items[i].ms / plain : 0.0;
        b->rows.items[i].against = "radius x 1";
    }
    b->s.scene->cameras[0] = eye;
    return bench_stretch(b, 1.0 / now);

fail:
    return res;
}

static enum pell_result resolutions(struct bench *b)
{
    static const char *const values[] = { "1", "1/2", "1/4" };
    enum pell_result res;

    PELL_TRY(keep_truth(b));
    for (int planes = 4; planes <= 8; planes *= 2)
        for (size_t i = 0; i < PELL_COUNT(values); i++) {
            char count[8], name[96];
            const struct pell_setting set[] = { { "planes", count, "bench" }, { "resolution", values[i], "bench" } };
            snprintf(count, sizeof(count), "%d", planes);
            snprintf(name, sizeof(name), "%d planes, resolution %s", planes, values[i]);
            PELL_TRY(measure(b, name, set, PELL_COUNT(set), planes == 4 && i == 0, false));
        }
    PELL_TRY(fill(b));
    PELL_TRY(thresholds_and_resolutions(b));
    return PELL_OK;

fail:
    return res;
}

static enum pell_result planes(struct bench *b)
{
    static const char *const forms[] = { "best", "paper" };
    enum pell_result res;

    PELL_TRY(keep_truth(b));
    for (int form = 0; form < 2; form++)
        for (int n = 2; n <= 16; n *= 2) {
            char count[8], name[96];
            const struct pell_setting set[] = { { "as", forms[form], "bench" },
                                                { "planes", count, "bench" },
                                                { "resolution", "1", "bench" } };
            snprintf(count, sizeof(count), "%d", n);
            snprintf(name, sizeof(name), "%d planes%s", n, form ? ", as=paper" : "");
            PELL_TRY(measure(b, name, set, PELL_COUNT(set), form == 0 && n == 4, false));
        }
    return PELL_OK;

fail:
    return res;
}

enum exit_code bench_munoz(struct cli *cli, const char *what, const char *path)
{
    struct bench b;
    enum exit_code code = bench_open(&b, cli, path);

    if (code == EXIT_OK)
        code = cli_failed(cli, strcmp(what, "munoz-2") == 0   ? thresholds(&b)
                               : strcmp(what, "munoz-3") == 0 ? resolutions(&b)
                                                              : planes(&b));
    if (code == EXIT_OK)
        code = bench_answer(&b, what, BENCH_PIXELS | BENCH_RAYS | BENCH_ERROR, NULL,
                            "%d x %d; medians of %d warm frames of the method's own stages; errors against hierarchical of at most %s "
                            "samples",
                            b.s.settings.width, b.s.settings.height, b.repeats, REFERENCE);
    bench_close(&b);
    return code;
}
