/* SPDX-License-Identifier: MIT
 *
 * points.h - surface points hit by samples of the image-space method, in the camera's irradiance image and in those of lights, and the
 * sampling density of each view there. Included by kernel files only.
 */
#ifndef PELL_IMAGE_SPACE_POINTS_H
#define PELL_IMAGE_SPACE_POINTS_H

#include "methods/image_space/texels.h"

/* Data shared by the samples of a vector of pixels. Vectors are in the camera's frame: x right, y down, z forward, mm. */
struct shading_point {
    vf key;
    vi active; /* lanes of the current material */
    vi x;      /* column */
    int y;
    vf t[2], z, h, per_h;       /* ray, plane, 1/h */
    vf at[3], n[3], s[3], q[3]; /* x_o; unit: normal, tangents */
    vf strength, per_length2;   /* 1/(length strength)^2 */
    const struct is_count *count;
    vf quarter[3];
    /* With levels per pixel: offsets, rows, rows of each channel and the fraction toward the next level; densities. */
    vi offset, density, rows[3];
    vf level_fraction[3], uniform, broad2, reach2;
};

/* A sample's hit on the surface. */
struct surface_hit {
    vi valid;
    vf to[3];    /* p - x_o */
    vf jacobian; /* dA_p/dA_p' */
    vf light[3];
};

/* The plane through x_o of a view's samples, in the view's frame: the tangent plane for the camera, as in the paper; perpendicular to the
 * view for lights, so that the rays of a light reach every point of the surface (a tangent plane that faces away from the light is hit by
 * few), and r is never less than r'. */
struct samples_plane {
    vf n[3], s[3], q[3], at[3];
    vf distance; /* from the centre of projection; parallel view: cosine with it */
};

/* An irradiance image and its view. */
struct image {
    const float *texels;
    ptrdiff_t stride;
    struct pell_rect rect;
    bool parallel;
    float f, cx, cy;            /* column = f X/Z + cx */
    const struct is_view *view; /* NULL: the camera's */
};

/* The camera's view and those of lights: images, and the planes of samples of a vector of pixels. */
struct views {
    const struct image *image;
    const struct samples_plane *plane;
};

/* The row of a squared radius, in units of length^2, and the fraction toward the next. */
INLINE vi find_row(vf square, vf *fraction)
{
    const vi bits = (vi) vmax(vmin(square, splat(IS_SQUARE_LAST)), splat(IS_SQUARE_MIN));

    *fraction = __builtin_convertvector(bits & ((1 << IS_SHIFT) - 1), vf) * (1.0f / (1 << IS_SHIFT));
    return ((bits >> IS_SHIFT) - IS_FIRST_ROW) * 8;
}

INLINE vi in_table(vf square)
{
    return square < IS_SQUARE_MAX;
}

INLINE vi texel_at(vi x, vi y, ptrdiff_t stride, vi inside)
{
    return ((y & inside) * (int) stride + (x & inside)) * IS_TEXEL;
}

INLINE vf plane_at(const vf texel[8], vf du, vf dv)
{
    return IS_PLANE_AT(texel[IS_W], texel[IS_GU], texel[IS_GV], du, dv);
}

/* Tangents of n, a unit vector (Duff et al. 2017, "Building an Orthonormal Basis, Revisited"). */
INLINE void tangents(const vf n[3], vf s[3], vf q[3])
{
    const vf sign = select(n[2] < 0.0f, splat(-1.0f), splat(1.0f)), a = -1.0f / (sign + n[2]), b = n[0] * n[1] * a;

    s[0] = sign * n[0] * n[0] * a + 1.0f;
    s[1] = sign * b;
    s[2] = -sign * n[0];
    q[0] = b;
    q[1] = n[1] * n[1] * a + sign;
    q[2] = -n[1];
}

/* --- The camera's view --------------------------------------------------------------------------------------------------------- */

/* Lookup of a point of the tangent plane in the camera's image. */
struct projection {
    vf scale, du, dv; /* px per mm at the point; offset from the pixel, px */
    vi at, valid, own;
};

/* `o`: a point of the tangent plane relative to x_o; everything is relative to the pixel, because radii may be far below the precision of a
 * depth. */
INLINE void project_to_camera(const struct is_work *w, const struct shading_point *p, const vf o[3], bool parallel, struct projection *to)
{
    const struct pell_rect *r = &w->in->rect;
    const float f = w->focal_px;
    const vf depth = p->z + o[2], scale = parallel ? splat(f) : f / depth;
    const vf du = within(scale * (parallel ? o[0] : o[0] - p->t[0] * o[2]), IS_FAR_PX);
    const vf dv = within(scale * (parallel ? o[1] : o[1] - p->t[1] * o[2]), IS_FAR_PX);
    const vi iu = nearest(du), iv = nearest(dv), x = p->x + iu, y = p->y + iv;
    const vi before = parallel ? (vi) { 0 } - 1 : (vi) (depth > 0.0f);

    to->valid = (x >= r->x0) & (x < r->x1) & (y >= r->y0) & (y < r->y1) & before;
    to->own = (iu == 0) & (iv == 0);
    to->at = texel_at(x, y, w->texel_stride, to->valid);
    to->scale = scale;
    to->du = du;
    to->dv = dv;
}

/* The visible point on the camera ray through point `o` of the tangent plane, relative to x_o. */
INLINE void find_in_camera(const struct is_work *w, const struct shading_point *p, const vf o[3], bool parallel,
                           const struct projection *projection, struct surface_hit *to)
{
    const float f = w->focal_px;
    const vf du = projection->du, dv = projection->dv;
    const vi own = projection->own;
    vf texel[8], plane, z, dz, step, jacobian;

    gather8(w->texels, &projection->at, texel);
    to->valid = projection->valid & (texel[IS_KEY] == p->key);
    plane = plane_at(texel, du - __builtin_convertvector(nearest(du), vf), dv - __builtin_convertvector(nearest(dv), vf));
    jacobian = texel[IS_H] * p->per_h;
    if (parallel) {
        z = plane;
        step = splat(1.0f / f);
    } else {
        vf ratio;
        z = 1.0f / plane;
        step = z * (1.0f / f);
        ratio = step * projection->scale; /* z/z' */
        jacobian = IS_AREA_RATIO(jacobian, ratio);
        to->valid &= own | (plane > 0.0f);
    }
    dz = z - p->z;
    to->to[0] = select(own, o[0], dz * p->t[0] + du * step);
    to->to[1] = select(own, o[1], dz * p->t[1] + dv * step);
    to->to[2] = select(own, o[2], dz);
    to->jacobian = select(own, splat(1.0f), jacobian);
    for (int c = 0; c < 3; c++)
        to->light[c] = texel[IS_RED + c];
}

/* --- Several views ------------------------------------------------------------------------------------------------------------- */

INLINE void into_view(const struct is_view *v, const vf p[3], float shifted, vf out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = v ? v->rotate[k][0] * p[0] + v->rotate[k][1] * p[1] + v->rotate[k][2] * p[2] + shifted * v->shift[k] : p[k];
}

/* The texel of a point, and the offset of the point from its centre; 0 outside of the image. */
INLINE vi load_texel(const struct image *m, const vf p[3], vf *du, vf *dv, vi *at)
{
    const vf scale = m->parallel ? splat(m->f) : m->f / p[2];
    const vf u = within(scale * p[0] + m->cx, IS_FAR_PX), v = within(scale * p[1] + m->cy, IS_FAR_PX);
    const vi x = nearest(u), y = nearest(v), before = m->parallel ? (vi) { 0 } - 1 : (vi) (p[2] > 0.0f);
    const vi inside = (x >= m->rect.x0) & (x < m->rect.x1) & (y >= m->rect.y0) & (y < m->rect.y1) & before;

    *du = u - __builtin_convertvector(x, vf);
    *dv = v - __builtin_convertvector(y, vf);
    *at = texel_at(x, y, m->stride, inside);
    return inside;
}

/* dA_p/dA_p' for a point at `ratio` = z/z'; `distance`: of the tangent plane from the centre of projection; parallel view: cosine with
 * it. */
INLINE vf jacobian_of(const struct image *m, const vf texel[8], vf ratio, vf distance)
{
    const vf h = texel[IS_H] * vabs(distance);
    return m->parallel ? h : IS_AREA_RATIO(h, ratio);
}

INLINE void make_plane(const struct image *m, const struct shading_point *p, struct samples_plane *to)
{
    into_view(m->view, p->at, 1.0f, to->at);
    if (!m->view) {
        for (int k = 0; k < 3; k++)
            to->n[k] = p->n[k];
        to->distance = m->parallel ? p->n[2] : p->n[0] * p->at[0] + p->n[1] * p->at[1] + p->n[2] * p->at[2];
        return;
    }
    to->distance = m->parallel ? splat(1.0f) : vsqrt(to->at[0] * to->at[0] + to->at[1] * to->at[1] + to->at[2] * to->at[2]);
    for (int k = 0; k < 3; k++)
        to->n[k] = m->parallel ? splat(k == 2 ? 1.0f : 0.0f) : to->at[k] / to->distance;
    tangents(to->n, to->s, to->q);
}

/* As find_in_camera, for sample (x, y), mm, in the view of a light. */
INLINE void find_in_light(const struct image *m, const struct samples_plane *n, const struct shading_point *p, vf x, vf y,
                          struct surface_hit *to)
{
    vf location[3], du, dv, plane, z, ratio, texel[8];
    vi at;

    for (int k = 0; k < 3; k++)
        location[k] = n->at[k] + x * n->s[k] + y * n->q[k];
    to->valid = load_texel(m, location, &du, &dv, &at);
    gather8(m->texels, &at, texel);
    to->valid &= texel[IS_KEY] == p->key;
    plane = plane_at(texel, du, dv);
    z = m->parallel ? plane : 1.0f / plane;
    to->valid &= m->parallel ? (vi) { 0 } - 1 : (vi) (plane > 0.0f);
    ratio = z / location[2];
    to->jacobian = jacobian_of(m, texel, ratio, n->distance);
    if (!m->parallel)
        for (int k = 0; k < 2; k++)
            location[k] *= ratio;
    location[2] = z;
    for (int k = 0; k < 3; k++)
        location[k] -= n->at[k];
    for (int k = 0; k < 3; k++)
        to->to[k] = m->view->rotate[0][k] * location[0] + m->view->rotate[1][k] * location[1] + m->view->rotate[2][k] * location[2];
    for (int c = 0; c < 3; c++)
        to->light[c] = texel[IS_RED + c];
}

/* Density of a view's samples at point p of the surface (x_o + to), in units of 1/length^2; 0 if it is not visible. */
INLINE vf density_from(const struct is_work *w, const struct image *m, const struct samples_plane *s, const struct shading_point *p,
                       const struct is_set *set, bool varies, const vf to[3])
{
    const vf *const n = s->n, *const from = s->at, distance = s->distance;
    vf location[3], du, dv, plane, z, towards, ratio, square, fraction, density, jacobian, off, texel[8];
    vi at, seen;

    into_view(m->view, to, 0.0f, location);
    for (int k = 0; k < 3; k++)
        location[k] += from[k];
    seen = load_texel(m, location, &du, &dv, &at);
    gather8(m->texels, &at, texel);
    seen &= texel[IS_KEY] == p->key;
    plane = plane_at(texel, du, dv);
    z = m->parallel ? plane : 1.0f / plane;
    /* Within a pixel's depth of the visible surface. */
    off = texel[IS_H] * (m->parallel ? splat(1.0f / m->f) : z * z * (1.0f / m->f));
    seen &= vabs(location[2] - z) < off + 1e-5f * vabs(z);
    /* The point p' of the tangent plane on the same ray. */
    towards = m->parallel ? n[2] : n[0] * location[0] + n[1] * location[1] + n[2] * location[2];
    if (m->parallel) {
        const vf along = (n[0] * (from[0] - location[0]) + n[1] * (from[1] - location[1]) + n[2] * (from[2] - location[2])) / towards;
        location[2] += along;
        ratio = splat(1.0f);
    } else {
        ratio = towards / distance; /* z/z' */
        seen &= ratio > 0.0f;
        for (int k = 0; k < 3; k++)
            location[k] /= ratio;
    }
    square = splat(0.0f);
    for (int k = 0; k < 3; k++)
        square += (location[k] - from[k]) * (location[k] - from[k]);
    square *= p->per_length2;
    seen &= in_table(square);
    jacobian = w->jacobian ? jacobian_of(m, texel, ratio, distance) : splat(1.0f);
    at = find_row(square, &fraction);
    if (varies)
        at += p->density;
    density = (float) p->count->importance * (gather(&set->rows[0][3], at) + fraction * gather(&set->rows[0][7], at));
    if (set->broad2 > 0.0f) {
        const vf fall = 1.0f + square / (varies ? p->broad2 : splat(set->broad2));
        density += p->count->uniform * (varies ? p->uniform : splat(set->uniform)) / (fall * fall);
    } else {
        density += p->count->uniform *
                   select(square <= (varies ? p->reach2 : splat(set->reach2)), varies ? p->uniform : splat(set->uniform), splat(0.0f));
    }
    density = w->inverted ? density * jacobian : density / jacobian;
    seen &= (density >= 0.0f) & (density < 1e30f);
    return (vf) ((vi) density & seen);
}

#endif
