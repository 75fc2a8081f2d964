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

/* At cosines before and behind it. */
static float passes(const struct pell_unscattered_params *p, const struct unscattered_face *f, float c, float c2)
{
    if (f->n1 == 1.0f || f->n2 == 1.0f)
        return transmittance(p, f, f->n1 == 1.0f ? c : c2);
    return 1.0f - pell_refract(f->n2 / f->n1, c).reflectance;
}

static void leave(const struct unscattered_face *f, struct pell_vec3 along, float side, struct unscattered_way *w)
{
    const float c = side * vec3_dot(along, f->ng);

    /* Interpolated normals may send it to the wrong side. */
    w->along = vec3_normalize(c > 0.0f ? along : vec3_mad(along, -2.0f * side * c, f->ng));
    w->side = vec3_mul(f->ng, side);
    w->at = vec3_mad(f->at, f->unit, w->side);
}

/* A cosine behind the boundary; 0: nothing passes. */
static float behind(const struct unscattered_face *f, float c)
{
    const float r = f->n1 / f->n2, sin2 = r * r * (1.0f - c * c);

    return sin2 < 1.0f ? sqrtf(1.0f - sin2) : 0.0f;
}

/* By one of its facets: into a solid all of the way; out of it whether it goes on, and which way where it would not by n. */
static bool pass_facet(const struct pell_unscattered_params *p, const struct unscattered_face *f, float alpha, struct pell_vec3 n,
                       struct unscattered_way *w)
{
    const struct pell_vec3 facet = unscattered_facet(&w->draw, alpha, n, w->along);
    const float r = f->n1 / f->n2, by_n = fminf(fmaxf(-vec3_dot(w->along, n), 1e-4f), 1.0f),
                by_facet = fminf(fmaxf(-vec3_dot(w->along, facet), 1e-4f), 1.0f), behind_n = behind(f, by_n),
                behind_facet = behind(f, by_facet);
    const bool in = f->n1 < f->n2, all = in || !(behind_n > 0.0f);
    const float c = all ? by_facet : by_n, c2 = all ? behind_facet : behind_n;
    float passed;

    if (!(behind_facet > 0.0f)) {
        unscattered_reflect(&w->lobe, alpha);
        unscattered_drawn(&w->lobe);
        leave(f, vec3_mad(w->along, 2.0f * by_facet, facet), 1.0f, w);
        return false;
    }
    passed = in ? passes(p, f, by_n, behind_n) : passes(p, f, by_facet, behind_facet);
    for (int k = 0; k < 3; k++)
        w->weight[k] *= passed;
    unscattered_refract(&w->lobe, alpha, f->n1, f->n2, c, c2);
    if (in)
        unscattered_drawn(&w->lobe);
    leave(f, vec3_mad(vec3_mul(w->along, r), r * c - c2, all ? facet : n), -1.0f, w);
    return true;
}

bool unscattered_pass(const struct pell_unscattered_params *p, const struct unscattered_face *f, struct unscattered_way *w)
{
    const float alpha = p->smooth || f->roughness < SMOOTHEST ? 0.0f : f->roughness * f->roughness;
    const float facing = -vec3_dot(w->along, f->n);
    const struct pell_vec3 n = facing > 1e-4f ? f->n : f->ng;
    const float c = fminf(fmaxf(-vec3_dot(w->along, n), 1e-4f), 1.0f), r = f->n1 / f->n2, sin2 = r * r * (1.0f - c * c);
    float c2, passed;

    if (alpha * fabsf(f->n1 - f->n2) > UNSCATTERED_DRAWN * f->n2)
        return pass_facet(p, f, alpha, n, w);
    if (sin2 >= 1.0f) {
        unscattered_reflect(&w->lobe, alpha);
        leave(f, vec3_mad(w->along, 2.0f * c, n), 1.0f, w);
        return false;
    }
    c2 = sqrtf(1.0f - sin2);
    passed = passes(p, f, c, c2);
    for (int k = 0; k < 3; k++)
        w->weight[k] *= passed;
    unscattered_refract(&w->lobe, alpha, f->n1, f->n2, c, c2);
    leave(f, vec3_mad(vec3_mul(w->along, r), r * c - c2, n), -1.0f, w);
    return true;
}
