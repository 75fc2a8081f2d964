/* SPDX-License-Identifier: MIT
 * boundary.c - see boundary.h. */
#include "render/unscattered/boundary.h"

#define SMOOTHEST 0.05f /* roughness below which a boundary is smooth, as in path-trace */

float unscattered_transmittance(const struct pell_specular_tables *tables, bool smooth, const struct unscattered_boundary *b, float outside)
{
    const struct pell_boundary_table *boundary = &tables->boundaries[tables->boundary[b->material]];
    float scale, bias, fraction;
    int index;

    if (smooth)
        return pell_boundary_lookup(boundary->transmittance, outside);
    pell_roughness_position(b->roughness, &index, &fraction);
    pell_albedo_pair(&tables->albedo[tables->model[b->material]][0][index][0], fraction, outside, &scale, &bias);
    return pell_transmittance(b->rho_s, boundary->f0, scale, bias);
}

/* Transmitted fraction at the cosines c before and c2 behind the boundary. */
static float transmitted_fraction(const struct pell_unscattered_params *p, const struct unscattered_hit *f, float c, float c2)
{
    if (f->n1 == 1.0f || f->n2 == 1.0f)
        return unscattered_transmittance(p->tables, p->smooth, &f->boundary, f->n1 == 1.0f ? c : c2);
    return 1.0f - pell_refract(f->n2 / f->n1, c).reflectance;
}

/* Continues the path in this direction on one side of the boundary: 1: where it came from, -1: behind it. */
static void set_direction(const struct unscattered_hit *f, struct pell_vec3 direction, float side, struct unscattered_path *w)
{
    const float c = side * vec3_dot(direction, f->ng);

    /* Interpolated normals may point the direction to the wrong side. */
    w->direction = vec3_normalize(c > 0.0f ? direction : vec3_mad(direction, -2.0f * side * c, f->ng));
    w->normal = vec3_mul(f->ng, side);
    w->position = vec3_mad(f->position, f->offset, w->normal);
}

static float cosine_before(const struct unscattered_path *w, struct pell_vec3 normal)
{
    return fminf(fmaxf(-vec3_dot(w->direction, normal), 1e-4f), 1.0f);
}

/* Cosine behind the boundary, from c before it; 0: total internal reflection. */
static float cosine_behind(const struct unscattered_hit *f, float c)
{
    const float r = f->n1 / f->n2, sin2 = r * r * (1.0f - c * c);

    return sin2 < 1.0f ? sqrtf(1.0f - sin2) : 0.0f;
}

/* A sampled facet sets the whole direction of a path into a solid. On the way out it decides whether the path exits, and in which direction
 * only where the mean normal n reflects totally. */
bool unscattered_cross(const struct pell_unscattered_params *p, const struct unscattered_hit *f, struct unscattered_path *w)
{
    const float alpha = p->smooth || f->boundary.roughness < SMOOTHEST ? 0.0f : f->boundary.roughness * f->boundary.roughness,
                r = f->n1 / f->n2;
    const struct pell_vec3 n = -vec3_dot(w->direction, f->n) > 1e-4f ? f->n : f->ng;
    const bool sampled = alpha * fabsf(f->n1 - f->n2) > UNSCATTERED_MIN_WIDTH * f->n2, entering = f->n1 < f->n2;
    const struct pell_vec3 facet = sampled ? unscattered_facet(&w->random, alpha, n, w->direction) : n;
    const float c_n = cosine_before(w, n), c_facet = cosine_before(w, facet);
    const float c2_n = cosine_behind(f, c_n), c2_facet = cosine_behind(f, c_facet);
    const bool by_facet = entering || !(c2_n > 0.0f);
    const float c = by_facet ? c_facet : c_n, c2 = by_facet ? c2_facet : c2_n;
    float transmitted;

    if (!(c2_facet > 0.0f)) {
        unscattered_reflect(&w->lobe, alpha);
        if (sampled)
            unscattered_narrow(&w->lobe);
        set_direction(f, vec3_mad(w->direction, 2.0f * c_facet, facet), 1.0f, w);
        return false;
    }
    transmitted = entering ? transmitted_fraction(p, f, c_n, c2_n) : transmitted_fraction(p, f, c_facet, c2_facet);
    for (int k = 0; k < 3; k++)
        w->weight[k] *= transmitted;
    unscattered_refract(&w->lobe, alpha, f->n1, f->n2, c, c2);
    if (sampled && entering)
        unscattered_narrow(&w->lobe);
    set_direction(f, vec3_mad(vec3_mul(w->direction, r), r * c - c2, by_facet ? facet : n), -1.0f, w);
    return true;
}
