/* SPDX-License-Identifier: MIT
 * papers.c - functions shared by the benches of the papers. */
#include "papers.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NUDGE 1e-4f /* of the camera's distance: its motion from frame to frame, where nothing is to be kept */

/* --- Scene and method ------------------------------------------------------------------------------------------------------------- */

enum exit_code bench_open(struct bench *b, const char *material)
{
    enum exit_code code;

    session_close(&b->s);
    if (material) {
        free(b->cli->material);
        b->cli->material = strdup(material);
        if (!b->cli->material)
            return EXIT_MEMORY;
    }
    code = session_open(b->cli, b->path, &b->s);
    b->s.settings.msaa = 1;
    return code;
}

enum pell_result bench_run_sibling(struct bench *b, const char *suffix, enum pell_result (*run)(struct bench *b))
{
    const char *const own = b->path;
    char path[4096];
    enum pell_result res = PELL_ERR_IO;

    snprintf(path, sizeof(path), "%.*s%s.json", (int) (strlen(own) - strlen(".json")), own, suffix);
    free(b->cli->material);
    b->cli->material = NULL;
    b->path = path;
    if (bench_open(b, NULL) == EXIT_OK)
        res = run(b);
    b->path = own;
    return res;
}

void bench_close(struct bench *b)
{
    session_close(&b->s);
    free(b->truth);
    b->truth = NULL;
}

enum pell_result bench_choose(struct bench *b, const char *method, const char *knobs)
{
    const struct pell_method *m = pell_method_find(b->cli->ctx, "bench", method);
    void *values = NULL;
    enum pell_result res = m ? pell_method_knobs_create(b->cli->ctx, m, knobs, &values) : PELL_ERR_INVALID;

    if (res == PELL_OK)
        res = pell_renderer_set_method(b->s.renderer, m, values);
    pell_method_knobs_destroy(b->cli->ctx, &values);
    return res;
}

enum pell_result bench_stretch(struct bench *b, double factor)
{
    for (size_t i = 0; i < b->s.scene->num_materials; i++)
        for (int c = 0; c < 3; c++) {
            b->s.scene->materials[i].medium.sigma_a[c] /= factor;
            b->s.scene->materials[i].medium.sigma_s_reduced[c] /= factor;
        }
    return pell_renderer_set_scene(b->s.renderer, b->s.scene);
}

bool bench_is_common(const char *stage)
{
    static const char *const names[] = { "prepare", "indirect links", "indirect light", "surface", "irradiance", "highlights", "curvature",
                                         "contact shadow", "through", "unscattered", "spread", "lit", "composite", "post",
                                         /* by a device */
                                         "light upload", "direct light", "transmission", "light download", "tables upload", "clear",
                                         "inside", "finish", "rows", "picture download", "picture unpack" };

    for (size_t i = 0; i < PELL_COUNT(names); i++)
        if (strcmp(stage, names[i]) == 0)
            return true;
    return false;
}

double bench_stage_ms(const struct pell_render_result *image, const char *stage)
{
    for (size_t i = 0; i < image->num_stages; i++)
        if (strcmp(image->stages[i].name, stage) == 0)
            return image->stages[i].ms;
    return 0.0;
}

double bench_own_ms(const struct pell_render_result *p)
{
    double sum = 0.0;

    for (size_t k = 0; k < p->num_stages; k++)
        sum += bench_is_common(p->stages[k].name) ? 0.0 : p->stages[k].ms;
    return sum;
}

/* --- Errors --------------------------------------------------------------------------------------------------------------------- */

static enum pell_result keep(struct bench *b, const struct pell_render_result *p)
{
    const size_t width = (size_t) p->width, height = (size_t) p->height;

    free(b->truth);
    b->truth = calloc(width * height, 4 * sizeof(*b->truth));
    if (!b->truth)
        return PELL_ERR_NOMEM;
    b->truth_width = p->width;
    b->truth_height = p->height;
    for (size_t c = 0; c < 4; c++)
        for (size_t y = 0; y < height; y++)
            memcpy(b->truth + (c * height + y) * width, p->channels[c].data + (ptrdiff_t) y * p->channels[c].stride,
                   width * sizeof(*b->truth));
    return PELL_OK;
}

/* Root mean square difference from the reference over its mean, R, G, B, of fully covered pixels; NAN where no reference has that size. */
static double error_of(const struct bench *b, const struct pell_render_result *p)
{
    const size_t size = (size_t) p->width * (size_t) p->height;
    double square = 0.0, sum = 0.0, count = 0.0;

    if (!b->truth || b->truth_width != p->width || b->truth_height != p->height)
        return (double) NAN;
    for (int y = 0; y < p->height; y++)
        for (int x = 0; x < p->width; x++) {
            const float *truth = b->truth + (size_t) y * (size_t) p->width + (size_t) x;
            for (size_t c = 0; c < 3 && truth[3 * size] >= 1.0f; c++) {
                const double t = (double) truth[c * size], d = (double) p->channels[c].data[y * p->channels[c].stride + x] - t;
                square += d * d;
                sum += t;
                count += 1.0;
            }
        }
    return sum > 0.0 ? sqrt(square * count) / sum : 0.0;
}

enum pell_result bench_keep_truth(struct bench *b, const char *method, const char *knobs)
{
    struct pell_render_result p;
    enum pell_result res;

    PELL_TRY(bench_choose(b, method, knobs));
    PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
    PELL_TRY(keep(b, &p));

fail:
    return res;
}

/* --- Times ---------------------------------------------------------------------------------------------------------------------- */

/* Moves the camera a little closer, or back. */
static void nudge(struct bench *b, int frame)
{
    const struct pell_scene *s = b->s.scene;
    struct pell_camera *c = &b->s.scene->cameras[0];
    float far = 0.0f;

    for (int k = 0; k < 3; k++)
        far += c->forward[k] * (0.5f * (s->bounds_min[k] + s->bounds_max[k]) - c->position[k]);
    for (int k = 0; k < 3; k++)
        c->position[k] += (frame % 2 ? -NUDGE : NUDGE) * far * c->forward[k];
}

enum pell_result bench_measure(struct bench *b, const char *name, const struct bench_run *run, struct bench_result *result)
{
    double *times = calloc((size_t) b->repeats * MAX_STAGES, sizeof(*times)), sum = 0.0, frame = 0.0, copy = 0.0;
    struct bench_result found = { 0 };
    struct pell_render_result p = { 0 };
    enum pell_result res = times ? PELL_OK : PELL_ERR_NOMEM;
    int64_t rays = 0, bytes = 0;

    PELL_TRY(res);
    PELL_TRY(bench_choose(b, run->method, run->knobs));
    for (int i = -1; i < b->repeats; i++) {
        if (run->moving)
            nudge(b, i + 1);
        PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
        for (size_t k = 0; k < p.num_stages && k < MAX_STAGES; k++) {
            if (i < 0 && strcmp(p.stages[k].name, "prepare") == 0)
                found.once_ms = p.stages[k].ms;
            if (i >= 0)
                times[k * (size_t) b->repeats + (size_t) i] = p.stages[k].ms;
        }
    }
    for (size_t k = 0; k < p.num_stages && k < MAX_STAGES; k++) {
        const struct pell_stage_time *t = &p.stages[k];
        const double median = bench_median(times + k * (size_t) b->repeats, b->repeats);
        char text[96];
        if (strcmp(t->name, "surface") == 0)
            found.visible = t->pixels;
        frame += median;
        if (bench_is_common(t->name))
            continue;
        sum += median;
        copy += t->bandwidth_ms;
        bytes += t->bytes;
        rays += t->rays;
        found.pixels = t->pixels > found.pixels ? t->pixels : found.pixels;
        snprintf(text, sizeof(text), "  %s", t->name);
        if (run->stages)
            bench_add_stage(&b->rows, text, median, t);
    }
    if ((found.row = bench_add(&b->rows, name, sum))) {
        found.row->frame_ms = frame;
        found.row->pixels = found.pixels;
        found.row->rays = rays;
        found.row->bytes = bytes;
        found.row->bandwidth_ms = copy;
        found.row->error = run->moving ? (double) NAN : error_of(b, &p);
    }
    if (result)
        *result = found;

fail:
    free(times);
    return res;
}
