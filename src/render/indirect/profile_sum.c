/* SPDX-License-Identifier: MIT
 * profile_sum.c - see profile_sum.h. Distant samples are aggregated in an octree. Nearby samples are weighted by the fraction of a disc
 * that their areas cover, which is what the methods' own finer samples amount to. */
#include "render/indirect/profile_sum.h"

#include "math/vec.h"

#define MAX_SOLID_ANGLE 0.1f /* sr: solid angle below which a node is treated as one sample */
#define MIN_NORMAL2 0.5f     /* least squared length of a node's mean normal */
#define WINDOW 2.5f          /* in distances of samples */
#define COVERAGE_LOW 0.75f   /* area of the samples over that of the disc: below this the disc contains a border, */
#define COVERAGE_HIGH 1.35f  /* above this more than one surface */
#define MIN_FACING 0.3f      /* least cosine of normals on one surface */
#define REACH 1.0e3f         /* windows: profiles are 0 beyond */

enum pell_result indirect_profile_sum_make(struct pell_context *ctx, struct pell_surface_sample *samples, size_t count, float spacing,
                                           const struct pell_profile profile[3], const struct pell_opposed *opposed,
                                           struct profile_sum *out)
{
    const float window = WINDOW * spacing;

    out->opposed = *opposed;
    out->window2 = window * window;
    for (int c = 0; c < 3; c++) {
        out->window_total[c] = (float) (pell_profile_total(&profile[c]) * pell_profile_cdf(&profile[c], (double) window));
        radial_make(&out->radial[c], &profile[c], 0.1f * window, REACH * window);
    }
    return pell_light_tree_make(ctx, samples, count, &out->tree);
}

void indirect_profile_sum_finish(struct profile_sum *w)
{
    pell_light_tree_finish(&w->tree);
}

static void add(const struct profile_sum *w, struct pell_vec3 at, struct pell_vec3 normal, const struct pell_surface_sample *from,
                float near[4], float sum[3])
{
    static const float one[3] = { 1.0f, 1.0f, 1.0f };
    const struct pell_vec3 v = vec3_sub(at, vec3_load(from->position)), n = vec3_load(from->normal);
    const struct pell_opposed_pair pair = { vec3_dot(v, v), vec3_dot(n, v), vec3_dot(normal, v), vec3_dot(normal, n), from->curvature };
    float R[3], through[3];

    if (pair.distance2 < w->window2 && pair.facing > MIN_FACING) {
        for (int c = 0; c < 3; c++)
            near[c] += from->power[c];
        near[3] += from->area;
        return;
    }
    for (int c = 0; c < 3; c++)
        R[c] = radial_at(&w->radial[c], pair.distance2);
    pell_opposed_apply(&w->opposed, &pair, one, R, through);
    for (int c = 0; c < 3; c++)
        sum[c] += R[c] * from->power[c] + through[c] * from->deep[c];
}

void indirect_profile_sum_at(const struct profile_sum *w, const float position[3], const float normal[3], float M[3])
{
    const struct pell_light_tree *t = &w->tree;
    const struct pell_vec3 at = vec3_load(position), n = vec3_load(normal);
    float near[4] = { 0.0f }, sum[3] = { 0.0f }, coverage;

    for (uint32_t i = 0; i < (uint32_t) t->num_nodes;) {
        const struct pell_light_node *q = &t->nodes[i];
        const struct pell_vec3 v = vec3_sub(at, vec3_load(q->centre)), mean = vec3_load(q->normal);
        const float d2 = vec3_dot(v, v);
        if (!(q->power[0] + q->power[1] + q->power[2] > 0.0f)) {
            i = q->next;
        } else if (q->area < MAX_SOLID_ANGLE * d2 && d2 > 4.0f * w->window2 && vec3_dot(mean, mean) > MIN_NORMAL2) {
            const struct pell_surface_sample one = pell_light_node_sample(q);
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
    /* A coverage near 1 counts as full: how many samples fall inside the disc is random. */
    coverage = near[3] / (PELL_PI_F * w->window2);
    coverage = coverage < COVERAGE_LOW ? coverage / COVERAGE_LOW : coverage > COVERAGE_HIGH ? coverage / COVERAGE_HIGH : 1.0f;
    for (int c = 0; c < 3 && near[3] > 0.0f; c++)
        sum[c] += w->window_total[c] * coverage * near[c] / near[3];
    memcpy(M, sum, sizeof(sum));
}
