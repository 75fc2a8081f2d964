/* SPDX-License-Identifier: MIT
 *
 * tilt.c - directional distribution of light that leaves a solid.
 *
 * The light in the solid has a gradient along the surface around a knot. Light that leaves was last scattered about a mean free path l back
 * along its direction, where the light is exp(g.t) times as strong: g is the gradient of the logarithm, t the component of that path along
 * the surface. The mean is 1/(1 - l g.t), for light from the depth over the growth along the normal component of the path. The tilt is l g
 * over the same. It makes a round solid darker where it is lit from the camera's side, and brighter where it is lit from behind. The more
 * of the gradient is along the surface, the less light from the depth leaves at right angles: along_surface[c] is that fraction, of squared
 * slopes.
 */
#include "render/indirect/internal.h"
#include "render/indirect/slope.h"

#define MAX_GROWTH 0.95f /* of kappa: largest relative slope along a surface */
#define MEAN_INWARD 0.6f /* mean cosine, to the inward normal, of the last path segment of light that leaves */
#define MIN_WEIGHT 0.5f  /* least weight of the samples that have light */

void indirect_tilt(const struct pell_indirect *in, const struct indirect_near *near, const struct pell_opposed *opposed,
                   const float (*light)[3], const float deep[3], float tilt[3][3], float along_surface[3])
{
    struct pell_vec3 centroid = vec3(0.0f, 0.0f, 0.0f), normal = centroid, a, b;

    for (int k = 0; k < INDIRECT_NEAR && near->weight[k] > 0.0f; k++) {
        centroid = vec3_mad(centroid, near->weight[k], in->samples[near->sample[k]].position);
        normal = vec3_mad(normal, near->weight[k], in->samples[near->sample[k]].smooth);
    }
    along_surface[0] = along_surface[1] = along_surface[2] = 0.0f;
    if (!(vec3_dot(normal, normal) > 0.0f))
        return;
    vec3_basis(vec3_normalize(normal), &a, &b);
    for (int c = 0; c < 3; c++) {
        const float max_slope = MAX_GROWTH * opposed->kappa[c];
        struct slope_sums sums = { .one = 0.0f };
        float slope[2], slope2, scale, growth;
        if (!(max_slope > 0.0f))
            continue;
        for (int k = 0; k < INDIRECT_NEAR && near->weight[k] > 0.0f; k++) {
            const struct pell_vec3 d = vec3_sub(in->samples[near->sample[k]].position, centroid);
            if (light[k][c] > 0.0f)
                slope_add(&sums, near->weight[k], vec3_dot(d, a), vec3_dot(d, b), logf(light[k][c]));
        }
        if (!(sums.one > MIN_WEIGHT) || !slope_fit(&sums, slope))
            continue;
        slope2 = slope[0] * slope[0] + slope[1] * slope[1];
        scale = fminf(1.0f, max_slope / sqrtf(fmaxf(slope2, 1e-20f)));
        slope2 = fminf(slope2, max_slope * max_slope);
        along_surface[c] = slope2 / (opposed->kappa[c] * opposed->kappa[c]);
        growth = 1.0f / (1.0f - MEAN_INWARD * opposed->depth[c] * sqrtf(opposed->kappa[c] * opposed->kappa[c] - slope2));
        scale *= opposed->depth[c] * (1.0f + deep[c] * (growth - 1.0f));
        vec3_store(vec3_mul(vec3_mad(vec3_mul(a, slope[0]), slope[1], b), scale), tilt[c]);
    }
}
