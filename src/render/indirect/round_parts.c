/* SPDX-License-Identifier: MIT
 * round_parts.c - thin round parts: where diffusion is not solved, the result of a method that integrates over the whole solid is scaled to
 * what such a part returns of uniform light (curvature/stage.h). The method's transport between faces is calibrated on balls and corrected
 * in slabs; rods of one or two mean free paths would be 25 to 45 % too bright. */
#include "render/indirect/internal.h"
#include "render/indirect/profile_sum.h"

#define LEAST 0.25f
#define MOST 2.0f
#define CHUNK 64

struct scaling {
    const struct indirect_round_parts *of;
    struct profile_sum sum; /* of uniform light */
    float total[3];         /* return of a half-space */
};

static bool is_thin(const struct indirect_round *r)
{
    return r->weight[0] + r->weight[1] + r->weight[2] > 0.0f;
}

static void scale_chunk(void *arg, int chunk, int worker)
{
    const struct scaling *t = arg;
    const struct indirect_round_parts *of = t->of;
    const size_t first = (size_t) chunk * CHUNK;

    (void) worker;
    for (size_t i = first; i < first + CHUNK && i < of->count; i++) {
        const struct pell_surface_sample *at = &of->sample[of->list[i]];
        const struct indirect_round *r = &of->round[of->list[i]];
        float sum[3];
        if (!is_thin(r))
            continue;
        indirect_profile_sum_at(&t->sum, at->position, at->normal, sum);
        for (int c = 0; c < 3; c++) {
            const float factor = sum[c] > 0.0f ? r->uniform[c] * t->total[c] / sum[c] : 1.0f;
            of->surplus[of->list[i]][c] = r->weight[c] * (fminf(fmaxf(factor, LEAST), MOST) - 1.0f);
        }
    }
}

enum pell_result indirect_round_parts_scale(struct pell_context *ctx, struct pell_pool *pool, const struct pell_indirect_solid *as,
                                            const struct indirect_round_parts *of)
{
    struct scaling t = { .of = of };
    struct pell_surface_sample *uniform;
    bool any = false;
    enum pell_result res;

    for (size_t i = 0; i < of->count; i++)
        any |= is_thin(&of->round[of->list[i]]);
    if (!any)
        return PELL_OK;
    uniform = pell_alloc_array(ctx, of->count, sizeof(*uniform));
    if (!uniform)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < of->count; i++) {
        uniform[i] = of->sample[of->list[i]];
        for (int c = 0; c < 3; c++)
            uniform[i].power[c] = uniform[i].deep[c] = uniform[i].area * of->round[of->list[i]].gain[c];
    }
    for (int c = 0; c < 3; c++)
        t.total[c] = (float) pell_profile_total(&as->profile[c]);
    res = indirect_profile_sum_make(ctx, uniform, of->count, of->spacing, as->profile, &as->opposed, &t.sum);
    if (res == PELL_OK)
        pell_pool_run(pool, (int) ((of->count + CHUNK - 1) / CHUNK), scale_chunk, &t);
    indirect_profile_sum_finish(&t.sum);
    return res;
}
