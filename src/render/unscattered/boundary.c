/* SPDX-License-Identifier: MIT
 * boundary.c - see boundary.h. */
#include "render/unscattered/boundary.h"

#define SMOOTHEST 0.05f /* roughness below which a boundary is smooth, as that of path-trace */

/* From the open or to it, at that cosine there: T as light that scatters has it. */
static float transmittance(const struct pell_unscattered_params *p, const struct unscattered_face *f, float outside)
{
    const struct pell_specular_tables *t = p->tables;
    const struct pell_boundary_table *boundary = &t->boundaries[t->boundary[f->material]];
    float scale, bias, fraction;
    int index;

    if (p->smooth)
        return pell_boundary_lookup(boundary->transmittance, outside);
    pell_roughness_position(f->roughness, &index, &fraction);
    pell_albedo_pair(&t->albedo[t->model[f->material]][0][index][0], fraction, outside, &scale, &bias);
    return pell_transmittance(f->rho_s, boundary->f0, scale, bias);
}

static void leave(const struct unscattered_face *f, struct pell_vec3 along, float side, struct unscattered_way *w)
{
    const float c = side * vec3_dot(along, f->ng);

    /* Interpolated normals may send it to the wrong side. */
    w->along = vec3_normalize(c > 0.0f ? along : vec3_mad(along, -2.0f * side * c, f->ng));
    w->side = vec3_mul(f->ng, side);
    w->at = vec3_mad(f->at, f->unit, w->side);
}

bool unscattered_pass(const struct pell_unscattered_params *p, const struct unscattered_face *f, struct unscattered_way *w)
{
    const float alpha = p->smooth || f->roughness < SMOOTHEST ? 0.0f : f->roughness * f->roughness;
    const float facing = -vec3_dot(w->along, f->n);
    const struct pell_vec3 n = facing > 1e-4f ? f->n : f->ng;
    const float c = fminf(fmaxf(-vec3_dot(w->along, n), 1e-4f), 1.0f), r = f->n1 / f->n2, sin2 = r * r * (1.0f - c * c);
    float c2, passed;

    if (sin2 >= 1.0f) {
        unscattered_reflect(&w->lobe, alpha);
        leave(f, vec3_mad(w->along, 2.0f * c, n), 1.0f, w);
        return false;
    }
    c2 = sqrtf(1.0f - sin2);
    if (f->n1 == 1.0f || f->n2 == 1.0f)
        passed = transmittance(p, f, f->n1 == 1.0f ? c : c2);
    else
        passed = 1.0f - pell_refract(1.0f / r, c).reflectance;
    for (int k = 0; k < 3; k++)
        w->weight[k] *= passed;
    unscattered_refract(&w->lobe, alpha, f->n1, f->n2, c, c2);
    leave(f, vec3_mad(vec3_mul(w->along, r), r * c - c2, n), -1.0f, w);
    return true;
}
