/* SPDX-License-Identifier: MIT
 *
 * chain.c - a material's sum of Gaussians, the chain of blurs made from it, and thickness tables.
 */
#include "methods/screen_space/chain.h"
#include "methods/screen_space/formulas.h"

#include "methods/thickness.h"
#include "render/intermediate.h"

#include <pellucid/kernel.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

/* px^2: above this variance the first blur is divided into several steps, each with four times the variance of the one before. */
#define AHEAD_PX2 20.0

/* --- Profiles ------------------------------------------------------------------------------------------------------------------ */

static bool starts(const char *name, const char *prefix)
{
    return strncmp(name, prefix, strlen(prefix)) == 0;
}

static enum pell_result find_profile(const struct screen_chain *st, const struct pell_frame_shape *shape, size_t index,
                                     struct pell_gaussians *g)
{
    const struct pell_frame_material *m = &shape->materials[index];
    const struct pell_fit_params params = { .count = st->knobs.gaussians };
    const struct pell_material_entry *published = st->knobs.profile == SCREEN_PROFILE_PUBLISHED ? pell_ss_published(m) : NULL;

    if (published) { /* white: the material's colour is that of its own profile */
        *g = published->gaussians;
        pell_ss_whiten(g);
        for (int i = 0; i < g->count; i++)
            for (int c = 0; c < 3; c++)
                g->weight[i][c] *= pell_profile_total(&m->profile[c]);
        return PELL_OK;
    }
    if (m->gaussians.count > 0) {
        *g = m->gaussians;
        return PELL_OK;
    }
    for (size_t i = 0; i < index; i++) {
        if (shape->materials[i].profile == m->profile && !shape->materials[i].preset == !m->preset &&
            strcmp(shape->materials[i].name, m->name) == 0 && shape->materials[i].white == m->white) {
            *g = st->profiles[i];
            return PELL_OK;
        }
    }
    if (pell_fit_profiles(m->profile, &params, g, NULL) != PELL_OK)
        return pell_error(st->ctx, PELL_ERR_INVALID, m->name, "change its coefficients, or use fewer Gaussians",
                          "no sum of %d Gaussians fits this material's profile", params.count);
    return PELL_OK;
}

/* --- The chain of blurs -------------------------------------------------------------------------------------------------------- */

static bool unblurred_first(const struct screen_chain *st, const char *name)
{
    return st->knobs.first == SCREEN_FIRST_UNBLURRED || (st->knobs.first == SCREEN_FIRST_SKIN && starts(name, "skin"));
}

/* Writes the chain of a material into the tables. If the first Gaussian stays unblurred the chain begins with the second one: the sum is
 * initialised with the unblurred light. */
static void make_chain(struct screen_chain *st, const struct pell_frame_shape *shape, size_t index)
{
    const struct pell_gaussians *g = &st->profiles[index];
    const int skipped = unblurred_first(st, shape->materials[index].name) ? 1 : 0;
    const size_t row = st->num_materials + 1, m = index + 1;
    const double first = skipped < g->count ? g->variance[skipped] : 0.0;

    for (int i = 0; i < SCREEN_PREBLUR; i++)
        st->variance[(size_t) i * row + m] = (float) (first * pow(4.0, i - SCREEN_PREBLUR));
    for (int i = 0; i < st->steps; i++) {
        const size_t at = (size_t) (SCREEN_PREBLUR + i) * row + m;
        if (i + skipped < g->count) {
            st->variance[at] = (float) g->variance[i + skipped];
            pell_ss_blend(g, i + skipped, st->blend[at]);
        } else {
            st->variance[at] = i > 0 ? st->variance[at - row] : 0.0f; /* already applied */
        }
    }
    for (int c = 0; c < 3; c++)
        st->total[m][c] = (float) pell_gaussians_total(g, c);
    if (first > st->variance_max)
        st->variance_max = first;
}

void pell_ss_chain_choose(const struct screen_chain *st, float scale, int *preblur, int *first)
{
    const size_t row = st->num_materials + 1;
    double px2 = st->variance_max * (double) scale;
    int step;

    *preblur = 0;
    for (; st->knobs.edges == SCREEN_EDGES_SURFACE && px2 > AHEAD_PX2 && *preblur < SCREEN_PREBLUR; px2 /= 4.0)
        ++*preblur;
    for (step = SCREEN_PREBLUR - *preblur; step < SCREEN_PREBLUR + st->steps; step++) {
        bool any = false;
        for (size_t m = 1; m < row && !any; m++)
            any = st->variance[(size_t) step * row + m] * scale > st->skip;
        if (any)
            break;
    }
    *first = step - (SCREEN_PREBLUR - *preblur);
}

const char *pell_ss_step_name(int step, int preblur)
{
    static const char *const names[PELL_GAUSSIANS_MAX] = { "blur 1", "blur 2", "blur 3", "blur 4", "blur 5",
                                                           "blur 6", "blur 7", "blur 8", "blur 9", "blur 10" };

    return step < preblur ? "blur ahead" : names[step - preblur];
}

const char *pell_ss_term_name(int term)
{
    static const char *const names[PELL_KERNEL_RANK_MAX] = { "kernel 1", "kernel 2", "kernel 3" };

    return names[term];
}

static enum pell_result make_tables(struct screen_chain *st, const struct pell_frame_shape *shape)
{
    const size_t n = st->num_materials, row = n + 1;
    enum pell_result res = PELL_ERR_NOMEM;

    st->profiles = pell_calloc(st->ctx, n, sizeof(*st->profiles));
    if (!st->profiles)
        goto fail;
    for (size_t i = 0; i < n; i++) {
        struct pell_gaussians *g = &st->profiles[i];
        PELL_TRY(find_profile(st, shape, i, g));
        if (shape->materials[i].white || st->knobs.input == SCREEN_INPUT_SHADED)
            pell_ss_whiten(g);
        if (g->count - unblurred_first(st, shape->materials[i].name) > st->steps)
            st->steps = g->count - unblurred_first(st, shape->materials[i].name);
    }
    res = PELL_ERR_NOMEM;
    st->variance = pell_calloc(st->ctx, (size_t) (SCREEN_PREBLUR + st->steps) * row, sizeof(*st->variance));
    st->blend = pell_calloc(st->ctx, (size_t) (SCREEN_PREBLUR + st->steps) * row, sizeof(*st->blend));
    st->total = pell_calloc(st->ctx, row, sizeof(*st->total));
    if (!st->variance || !st->blend || !st->total)
        goto fail;
    for (size_t i = 0; i < n; i++)
        make_chain(st, shape, i);
    if (st->knobs.transmission == SCREEN_TRANSMISSION_OFF)
        return PELL_OK;
    st->thickness = pell_calloc(st->ctx, n, sizeof(*st->thickness));
    if (!st->thickness)
        goto fail;
    for (size_t i = 0; i < n; i++) {
        struct pell_frame_material m = shape->materials[i];
        const size_t first = pell_first_alike(shape, i);
        if (first < i) {
            st->thickness[i] = st->thickness[first];
            continue;
        }
        m.white |= st->knobs.input == SCREEN_INPUT_SHADED;
        pell_thickness_table_make(&m, pell_ss_transmission, &st->profiles[i], st->knobs.transmission == SCREEN_TRANSMISSION_SLAB,
                                  sqrt((double) st->ratio2), &st->thickness[i]);
    }
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_ss_chain_make(struct pell_context *ctx, const struct pell_frame_shape *shape, const struct screen_knobs *k,
                                    struct screen_chain *st)
{
    const bool heights = k->ssslevel > 0.0f || (k->edges == SCREEN_EDGES_PAPER && k->slope == SCREEN_SLOPE_PAPER);

    st->ctx = ctx;
    if (heights && !(shape->object_height > 0.0f))
        return pell_error(ctx, PELL_ERR_INVALID, "screen-space", "set ssslevel = 0 and foreshortening = surface",
                          "object_height = %g mm, must be positive where depths count in object heights", (double) shape->object_height);
    st->knobs = *k;
    st->num_materials = shape->num_materials;
    st->depth_mm = shape->orthographic ? 0.0f : 1.0f / shape->focal_px;
    st->fixed_mm = shape->orthographic ? 1.0f / shape->focal_px : 0.0f;
    st->ratio2 = 1.0f;
    if (k->ssslevel > 0.0f) {
        const double ratio = (double) k->ssslevel / pell_ss_level((double) shape->focal_px, (double) shape->object_height);
        st->ratio2 = (float) fmin(fmax(ratio * ratio, 1e-12), 1e12);
    }
    st->skip = 1.0f / (SCREEN_SPAN * SCREEN_SPAN * k->lod * k->lod);
    st->correction = k->correction;
    st->maxdd = k->maxdd;
    st->unit = shape->object_height > 0.0f ? 1.0f / shape->object_height : 1.0f;
    st->forms =
        (k->edges == SCREEN_EDGES_PAPER ? SCREEN_FORM_PAPER_EDGES : 0) | (k->slope == SCREEN_SLOPE_PAPER ? SCREEN_FORM_PAPER_SLOPE : 0);
    return make_tables(st, shape);
}

void pell_ss_chain_finish(struct screen_chain *st)
{
    if (!st->ctx)
        return;
    pell_free(st->ctx, st->total);
    pell_free(st->ctx, st->blend);
    pell_free(st->ctx, st->variance);
    pell_free(st->ctx, st->thickness);
    pell_free(st->ctx, st->profiles);
}

/* What each material's light has been blurred by after a step; materials that are alike and have the same name are listed once. Returns
 * their number. */
static size_t list_gaussians(const struct screen_chain *st, const struct pell_frame_shape *shape, int step, int preblur,
                             struct pell_intermediate_gaussian *list)
{
    const size_t row = (size_t) (SCREEN_PREBLUR - preblur + step) * (st->num_materials + 1);
    size_t count = 0;

    for (size_t i = 0; i < st->num_materials; i++) {
        const struct pell_gaussians *g = &st->profiles[i];
        const char *name = shape->materials[i].name;
        const int k = step - preblur + (unblurred_first(st, name) ? 1 : 0);
        const size_t first = pell_first_alike(shape, i);
        struct pell_intermediate_gaussian *to = &list[count];
        if (first < i && strcmp(shape->materials[first].name, name) == 0)
            continue;
        *to = (struct pell_intermediate_gaussian) { .material = name, .variance = (double) (st->variance[row + i + 1] * st->ratio2) };
        for (int c = 0; c < 3 && step >= preblur && k < g->count; c++)
            to->weight[c] = st->total[i + 1][c] > 0.0f ? g->weight[k][c] / (double) st->total[i + 1][c] : 0.0;
        count++;
    }
    return count;
}

enum pell_result pell_ss_show(const struct screen_chain *chain, const struct pell_services *services, const struct pell_frame *in,
                              const float *const light[3], ptrdiff_t stride, int step, int preblur)
{
    const void *const planes[3] = { light[0], light[1], light[2] };
    struct pell_intermediate_gaussian *list = NULL;
    char name[64], what[192];
    struct pell_intermediate image = {
        .name = name,
        .what = what,
        .unit = chain->knobs.input == SCREEN_INPUT_SHADED ? "W/(m^2 sr)" : "W/m^2",
        .stride = stride,
        .components = 3,
        .color = true,
    };
    enum pell_result res;

    if (chain->knobs.kernel == SCREEN_KERNEL_SEPARABLE) {
        snprintf(name, sizeof(name), "screen-space.kernel-%d", step + 1);
        image.what = "light after the terms of the separable kernel up to this one; the last is the result";
        return pell_show_pixels(services, in, planes, PELL_PLANE_F32, &image);
    }
    if (!(list = pell_calloc(chain->ctx, chain->num_materials, sizeof(*list))))
        return PELL_ERR_NOMEM;
    image.gaussians = list;
    image.num_gaussians = list_gaussians(chain, &in->shape, step, preblur, list);
    if (step < preblur) {
        snprintf(name, sizeof(name), "screen-space.blur-1.step-%d", step + 1);
        snprintf(what, sizeof(what),
                 "light times the profile's total after a blur without weight, which keeps the first Gaussian's taps close");
    } else {
        snprintf(name, sizeof(name), "screen-space.blur-%d", step - preblur + 1);
        snprintf(what, sizeof(what),
                 "light times the profile's total after the Gaussians up to this one%s; pixels that skip it are as before",
                 chain->knobs.strength ? "; where the strength is s, the variance is s^2 times as large" : "");
    }
    res = pell_show_pixels(services, in, planes, PELL_PLANE_F32, &image);
    pell_free(chain->ctx, list);
    return res;
}
