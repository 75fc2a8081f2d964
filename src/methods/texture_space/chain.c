/* SPDX-License-Identifier: MIT
 *
 * chain.c - the chain of blurs: each level blurs the result of the one before, adds its weighted result to the sum, and transmits its part
 * through thin regions. The operations are those of an engine (struct ts_runner).
 */
#include "methods/texture_space/state.h"

#include <stdio.h>
#include <string.h>

#define SOFT (1.0 / 3.0)    /* relative to the widest blur's width */
#define MIN_WEIGHTLESS 0.05 /* texels^2: a blur without weight and with less variance is skipped */

static const char *level_name(int i)
{
    static const char *const names[TS_LEVELS] = {
        "blur 1",  "blur 2",  "blur 3",  "blur 4",  "blur 5",  "blur 6",  "blur 7",  "blur 8",  "blur 9",  "blur 10", "blur 11",
        "blur 12", "blur 13", "blur 14", "blur 15", "blur 16", "blur 17", "blur 18", "blur 19", "blur 20", "blur 21", "blur 22",
        "blur 23", "blur 24", "blur 25", "blur 26", "blur 27", "blur 28", "blur 29", "blur 30", "blur 31", "blur 32",
    };

    return names[i];
}

/* How far from charts borders must be blurred along rows, so that the blur down columns finds its inputs, and how far they must hold
 * light. */
static void reach_of(const struct ts_blurring *p, const struct ts_blur *b, int *blurred, int *filled)
{
    const struct ts_state *st = p->st;
    struct ts_work w = st->work;
    float reach[2], aside;

    *blurred = *filled = TS_FAR - 1;
    w.before = (float) b->before;
    w.after = (float) b->after;
    for (int k = 0; k < 2; k++)
        reach[k] = floorf(st->kernels->reach(&w, st->least[k]));
    aside = ceilf(reach[1] * st->skew);
    if (w.seven || !(reach[0] + reach[1] + aside + 1.0f < (float) TS_FAR))
        return;
    *blurred = (int) fmaxf(reach[1], aside);
    *filled = (int) fmaxf(reach[1], aside + reach[0]);
}

/* Fills the borders of p->now as far as the next blur needs them, and so that charts can be read anywhere. */
static void fill_for(struct ts_blurring *p, const struct ts_blur *next, int planes)
{
    int blurred, filled = 1;

    if (next)
        reach_of(p, next, &blurred, &filled);
    p->st->run->fill(p, planes, filled > 1 ? filled : 1);
}

/* One level of the chain. */
struct level {
    int index; /* in the profile */
    bool blurs;
    struct ts_blur blur; /* if no blur is run, only its weight counts */
};

/* Texels may be longer than the width that a blur adds: reading the map alone then blurs more. */
static bool reaches(const struct ts_blurring *p, const struct ts_blur *b)
{
    const struct ts_state *st = p->st;
    struct ts_work w = st->work;

    w.before = (float) b->before;
    w.after = (float) b->after;
    return w.seven || st->kernels->reach(&w, st->least[0]) > 0.0f || st->kernels->reach(&w, st->least[1]) > 0.0f;
}

static int list_levels(const struct ts_blurring *p, bool local, struct level *out)
{
    const struct ts_profile *profile = p->solid->profile;
    const double texels_per_mm2 = 1.0 / (p->solid->atlas->mm_per_texel * p->solid->atlas->mm_per_texel);
    double before = 0.0;
    int count = 0, unblurred = -1;

    for (int i = 0; i < profile->count && unblurred < 0; i++)
        if (profile->weight[i][0] + profile->weight[i][1] + profile->weight[i][2] > 0.0)
            unblurred = i;
    for (int i = 0; i < profile->count; i++) {
        const double *weight = profile->weight[i];
        const bool none = !(weight[0] > 0.0 || weight[1] > 0.0 || weight[2] > 0.0);
        const bool stays_unblurred = p->st->knobs.first == TS_FIRST_UNBLURRED && i <= unblurred;
        if (none && (stays_unblurred || (profile->variance[i] - before) * texels_per_mm2 < MIN_WEIGHTLESS))
            continue;
        out[count] = (struct level) { i, false, { before, profile->variance[i], local && !none && !stays_unblurred ? weight : NULL } };
        out[count].blurs = !stays_unblurred && reaches(p, &out[count].blur);
        before = stays_unblurred ? before : profile->variance[i];
        count++;
    }
    return count;
}

int ts_chain_blurs(struct ts_state *st, const struct ts_solid *solid, struct ts_blur out[TS_LEVELS])
{
    const struct ts_blurring p = { .st = st, .solid = solid };
    struct level levels[TS_LEVELS];
    const int all = list_levels(&p, true, levels);
    int count = 0;

    for (int i = 0; i < all; i++)
        if (levels[i].blurs)
            out[count++] = levels[i].blur;
    return count;
}

struct ts_blur ts_soft_blur(const struct ts_solid *solid)
{
    static const double whole[3] = { 1.0, 1.0, 1.0 };

    return (struct ts_blur) { 0.0, SOFT * SOFT * solid->profile->widest * solid->profile->widest, whole };
}

static const struct ts_blur *next_blur(const struct level *levels, int from, int count)
{
    for (int i = from; i < count; i++)
        if (levels[i].blurs)
            return &levels[i].blur;
    return NULL;
}

/* Blurs along rows and down columns, and adds the weighted result to the sum. Borders must hold the blur's inputs. Returns the texels of
 * both passes. */
static int64_t blur_planes(struct ts_blurring *p, const struct ts_blur *b)
{
    const struct ts_atlas *a = p->solid->atlas;
    int blurred, filled;

    reach_of(p, b, &blurred, &filled);
    p->st->run->blur(p, b, blurred);
    p->blurs++;
    return 2 * a->inner + (int64_t) a->within[blurred] + (int64_t) a->within[filled];
}

static enum pell_result start(struct ts_blurring *p, bool transmitted, int planes)
{
    p->st->work.planes = p->st->knobs.kernel == TS_KERNEL_SEVEN ? 6 : planes;
    p->planes = planes;
    return p->st->run->start(p, transmitted, planes);
}

/* Shows three planes of `now` after a blur. `several`: their light is not that of st->shown.light alone, and none of it is transmitted. */
static void show_planes(const struct ts_blurring *p, const struct ts_blur *b, float *const *planes, bool several)
{
    struct ts_state *st = p->st;
    const struct ts_profile *profile = p->solid->profile;
    const int inserted = profile->inserted[p->level];
    const char *material = st->in->shape.materials[profile - st->profiles].name;
    struct pell_intermediate_gaussian gaussian = { .material = material ? material : "", .variance = b->after };
    char name[32], what[320];

    for (int c = 0; c < 3 && b->weight; c++)
        gaussian.weight[c] = b->weight[c];
    if (inserted)
        snprintf(name, sizeof(name), "blur-%d.step-%d", profile->gaussian[p->level], inserted);
    else
        snprintf(name, sizeof(name), "blur-%d", profile->gaussian[p->level]);
    snprintf(what, sizeof(what), "irradiance map after %s%s%s%s",
             inserted ? "a blur without weight, which keeps the ratio of variances small" : "the Gaussians up to this one",
             st->knobs.stretch ? ", along the surface: the stretch sets the width in texels"
                               : ", whose width in texels ignores the stretch: the variance is that of texels of the mean size",
             p->scaled ? "; where the strength is s, the variance is s^2 times as large" : "",
             p->planes > 3 && !several ? "; transmitted light has its own weights, by the thickness at each texel" : "");
    ts_show(st, &(struct ts_image) { name,
                                     "W/m^2",
                                     what,
                                     { planes[0], planes[1], planes[2] },
                                     3,
                                     .color = true,
                                     .of_light = !several && st->knobs.lights == TS_LIGHTS_OWN,
                                     .gaussian = &gaussian });
}

static enum pell_result show_blur(struct ts_blurring *p, const struct ts_blur *b)
{
    struct ts_state *st = p->st;
    enum pell_result res;

    if (!pell_services_observed(st->services, st->in))
        return PELL_OK;
    PELL_TRY(st->run->inspect(p, false));
    show_planes(p, b, st->now, false);
    if (p->planes == TS_PLANES)
        show_planes(p, b, st->now + TS_LOCAL, true);

fail:
    return res;
}

enum pell_result ts_chain(struct ts_state *st, const struct ts_solid *solid, const struct ts_chain_params *params)
{
    struct ts_blurring chain = { .st = st, .solid = solid, .scaled = params->scaled }, *p = &chain;
    const struct ts_runner *run = st->run;
    const bool transmission = params->transmission;
    const int planes = params->joined ? TS_PLANES : transmission ? TS_ALPHA + 1 : 3;
    struct level levels[TS_LEVELS];
    int index = 0, count;
    enum pell_result res;

    PELL_TRY(start(p, false, planes));
    if (params->local && st->knobs.kernel == TS_KERNEL_JITTERED) {
        run->fill(p, 3, TS_FAR - 1);
        run->scatter(p);
        run->note(st, "taps", solid->atlas->inner, 4 * TS_TAPS * 3);
        if (!transmission)
            return run->finish(p);
    }
    count = list_levels(p, params->local && st->knobs.kernel != TS_KERNEL_JITTERED, levels);
    fill_for(p, next_blur(levels, 0, count), planes);
    for (int i = 0; i < count; i++) {
        const struct ts_blur *b = &levels[i].blur;
        p->level = levels[i].index;
        if (transmission)
            run->transmission_weights(p);
        if (levels[i].blurs) {
            const int64_t texels = blur_planes(p, b);
            if (params->local) /* with lights=sum the chains of all lights blur the same light, and only the first adds it */
                PELL_TRY(show_blur(p, b));
            if (transmission || i + 1 < count)
                fill_for(p, next_blur(levels, i + 1, count), planes);
            run->note(st, level_name(index++), texels, 2 * st->work.planes);
        } else if (b->weight) {
            run->add(p, b->weight);
            run->note(st, "unblurred", solid->atlas->inner, 9);
        }
        if (transmission) {
            run->transmit(p);
            run->note(st, "transmit", (int64_t) st->tsm.count, 20);
        }
    }
    return run->finish(p);

fail:
    return res;
}

enum pell_result ts_soften(struct ts_state *st, const struct ts_solid *solid)
{
    struct ts_blurring chain = { .st = st, .solid = solid }, *p = &chain;
    const struct ts_blur blur = ts_soft_blur(solid);
    int64_t texels;
    enum pell_result res;

    PELL_TRY(start(p, true, 3));
    fill_for(p, &blur, 3);
    texels = blur_planes(p, &blur);
    st->run->note(st, "soften", texels, 2 * st->work.planes);
    return st->run->finish(p);

fail:
    return res;
}
