/* SPDX-License-Identifier: MIT
 * whole.c - see whole.h. An octree stands for what is far; nearby, samples are taken for as much light as their areas fill of a disc, which
 * is what the methods' own finer samples come to. */
#include "render/indirect/whole.h"

#include "math/vec.h"

#define ERROR 0.1f       /* sr: solid angle of a node that counts as one */
#define MEAN 0.5f        /* least squared length of the mean of a node's normals */
#define WINDOW 2.5f      /* distances of samples */
#define COVER_LOW 0.75f  /* of a disc by samples: below it is a border, */
#define COVER_HIGH 1.35f /* above it more than one surface */
#define FACING 0.3f      /* least cosine of normals on one surface */
#define REACH 1.0e3f     /* windows: beyond, profiles are 0 */

enum pell_result indirect_whole_make(struct pell_context *ctx, struct pell_lit_place *samples, size_t count, float spacing,
                                     const struct pell_profile profile[3], const struct pell_opposed *law, struct whole *out)
{
    const float window = WINDOW * spacing;

    out->law = *law;
    out->window2 = window * window;
    for (int c = 0; c < 3; c++) {
        out->share[c] = (float) (pell_profile_total(&profile[c]) * pell_profile_cdf(&profile[c], (double) window));
        radial_make(&out->radial[c], &profile[c], 0.1f * window, REACH * window);
    }
    return pell_light_tree_make(ctx, samples, count, &out->tree);
}

void indirect_whole_finish(struct whole *w)
{
    pell_light_tree_finish(&w->tree);
}

static void add(const struct whole *w, struct pell_vec3 at, struct pell_vec3 normal, const struct pell_lit_place *from, float near[4],
                float sum[3])
{
    static const float one[3] = { 1.0f, 1.0f, 1.0f };
    const struct pell_vec3 v = vec3_sub(at, vec3_load(from->position)), n = vec3_load(from->normal);
    const struct pell_opposed_pair pair = { vec3_dot(v, v), vec3_dot(n, v), vec3_dot(normal, v), vec3_dot(normal, n), from->curvature };
    float R[3];

    if (pair.distance2 < w->window2 && pair.facing > FACING) {
        for (int c = 0; c < 3; c++)
            near[c] += from->power[c];
        near[3] += from->area;
        return;
    }
    for (int c = 0; c < 3; c++)
        R[c] = radial_at(&w->radial[c], pair.distance2);
    pell_opposed_apply(&w->law, &pair, one, R);
    for (int c = 0; c < 3; c++)
        sum[c] += R[c] * from->power[c];
}

void indirect_whole_at(const struct whole *w, const float position[3], const float normal[3], float M[3])
{
    const struct pell_light_tree *t = &w->tree;
    const struct pell_vec3 at = vec3_load(position), n = vec3_load(normal);
    float near[4] = { 0.0f }, sum[3] = { 0.0f }, cover;

    for (uint32_t i = 0; i < (uint32_t) t->num_nodes;) {
        const struct pell_light_node *q = &t->nodes[i];
        const struct pell_vec3 v = vec3_sub(at, vec3_load(q->centre)), mean = vec3_load(q->normal);
        const float d2 = vec3_dot(v, v);
        if (!(q->power[0] + q->power[1] + q->power[2] > 0.0f)) {
            i = q->next;
        } else if (q->area < ERROR * d2 && d2 > 4.0f * w->window2 && vec3_dot(mean, mean) > MEAN) {
            const struct pell_lit_place one = pell_light_node_place(q);
            add(w, at, n, &one, near, sum);
            i = q->next;
        } else if (q->count) {
            for (uint32_t k = q->first; k < q->first + q->count; k++)
                add(w, at, n, &t->samples[k], near, sum);
            i = q->next;
        } else {
            i++;
        }
    }
    /* A disc that is covered by about its area is covered: how many samples lie in it is chance. */
    cover = near[3] / (PELL_PI_F * w->window2);
    cover = cover < COVER_LOW ? cover / COVER_LOW : cover > COVER_HIGH ? cover / COVER_HIGH : 1.0f;
    for (int c = 0; c < 3 && near[3] > 0.0f; c++)
        sum[c] += w->share[c] * cover * near[c] / near[3];
    memcpy(M, sum, sizeof(sum));
}
