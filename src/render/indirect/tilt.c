/* SPDX-License-Identifier: MIT
 *
 * tilt.c - directions in which light from the depth of a solid leaves.
 *
 * How steeply light in the depth grows along the surface around a value. Light that leaves was scattered last about a mean free path l back
 * along its way, where there is exp(g.t) of it, g the gradient of its logarithm and t the part of the way along the surface: 1/(1 - l g.t)
 * in the mean, over what grows along the rest of the way. The tilt is l g over that. The more of the growth is along the surface, the less
 * light comes straight up: aside[c] is its share, of squares.
 */
#include "render/indirect/internal.h"
#include "render/indirect/slope.h"

#define STEEPEST 0.95f /* of the exponent of the depth: that light grows by along a surface at most */
#define WITHIN 0.6f    /* mean cosine against the inward normal of light that leaves, on its way there */
#define SOME 0.5f      /* of the weight of samples: those that have light */

void indirect_tilt(const struct pell_indirect *in, const struct indirect_near *near, const struct pell_opposed *law,
                   const float (*light)[3], float tilt[3][3], float aside[3])
{
    struct pell_vec3 middle = vec3(0.0f, 0.0f, 0.0f), normal = middle, a, b;

    for (int k = 0; k < INDIRECT_NEAR && near->weight[k] > 0.0f; k++) {
        middle = vec3_mad(middle, near->weight[k], in->samples[near->sample[k]].position);
        normal = vec3_mad(normal, near->weight[k], in->samples[near->sample[k]].smooth);
    }
    aside[0] = aside[1] = aside[2] = 0.0f;
    if (!(vec3_dot(normal, normal) > 0.0f))
        return;
    vec3_basis(vec3_normalize(normal), &a, &b);
    for (int c = 0; c < 3; c++) {
        const float steepest = STEEPEST * law->kappa[c];
        struct slope_sums line = { .one = 0.0f };
        float slope[2], steep2, least;
        if (!(steepest > 0.0f))
            continue;
        for (int k = 0; k < INDIRECT_NEAR && near->weight[k] > 0.0f; k++) {
            const struct pell_vec3 d = vec3_sub(in->samples[near->sample[k]].position, middle);
            if (light[k][c] > 0.0f)
                slope_add(&line, near->weight[k], vec3_dot(d, a), vec3_dot(d, b), logf(light[k][c]));
        }
        if (!(line.one > SOME) || !slope_of(&line, slope))
            continue;
        steep2 = slope[0] * slope[0] + slope[1] * slope[1];
        least = fminf(1.0f, steepest / sqrtf(fmaxf(steep2, 1e-20f)));
        steep2 = fminf(steep2, steepest * steepest);
        aside[c] = steep2 / (law->kappa[c] * law->kappa[c]);
        least *= law->depth[c] / (1.0f - WITHIN * law->depth[c] * sqrtf(law->kappa[c] * law->kappa[c] - steep2));
        vec3_store(vec3_mul(vec3_mad(vec3_mul(a, slope[0]), slope[1], b), least), tilt[c]);
    }
}
