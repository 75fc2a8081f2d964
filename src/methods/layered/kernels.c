/* SPDX-License-Identifier: MIT
 *
 * kernels.c - start points and rays of the marches of layered; compiled once per level of base/simd.h.
 */
#include "methods/layered/march.h"

/* --- Start of a march ----------------------------------------------------------------------------------------------------------- */

INLINE void cross3(const vf a[3], const vf b[3], vf out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

INLINE void store3(void *rows, int lane, const vf from[3])
{
    float *to = rows;

    for (int k = 0; k < 3; k++)
        store(to + k * LANES + lane, from[k]);
}

INLINE void unit3(vf a[3])
{
    const vf inv_length = 1.0f / vsqrt(vmax(dot3(a, a), splat(1e-30f)));

    for (int k = 0; k < 3; k++)
        a[k] *= inv_length;
}

/* Interpolates a vertex attribute over the triangle; rows of consecutive corners are `size` apart. */
INLINE void mean3(const void *rows, int size, int lane, vf u, vf v, vf out[3])
{
    const float *from = rows;
    const vf w = 1.0f - u - v;

    for (int k = 0; k < 3; k++) {
        const float *a = from + k * LANES + lane;
        out[k] = w * load(a) + u * load(a + size * LANES) + v * load(a + 2 * size * LANES);
    }
}

/* Writes `count` rows to the lanes in the mask `of`. */
INLINE void fill_rows(const void *values, int count, int lane, vi of, void *rows)
{
    const float *from = values;
    float *to = rows;

    for (int i = 0; i < count; i++)
        store(to + i * LANES + lane, select(of, splat(from[i]), load(to + i * LANES + lane)));
}

static void layered_fill(const struct layered_triangle *t, int packs, const int32_t *of, struct layered_packet *p)
{
    for (int lane = 0; lane < LANES; lane += WIDTH) {
        const vi lanes = load_int(of + lane);
        fill_rows(t->corner, 9, lane, lanes, p->corner);
        fill_rows(t->normal, 9, lane, lanes, p->normal);
        fill_rows(t->plane, 12, lane, lanes, p->plane);
        fill_rows(t->uv, 6 * packs, lane, lanes, p->uv);
    }
}

/* Initialises the texture lookup of a pack: the gradients of u and v over the triangle, and their derivatives along the ray. */
INLINE void start_lookup(const struct layered_pack *pack, const float *uv, const struct layered_packet *p, int lane, const vf a[3],
                         const vf b[3], const vf dir[3], struct layered_lookup *o)
{
    const vf u = load(p->u + lane), v = load(p->v + lane), w = 1.0f - u - v, spacing = load(p->spacing + lane);
    const vf size = splat((float) pack->level[0].width * (float) pack->level[0].height);
    vf squares[2], texels;

    for (int d = 0; d < 2; d++) {
        const float *from = uv + d * LANES + lane;
        const vf c0 = load(from), c1 = load(from + 2 * LANES), c2 = load(from + 4 * LANES), here = w * c0 + u * c1 + v * c2;
        vf g[3], along;
        for (int k = 0; k < 3; k++)
            g[k] = (c1 - c0) * a[k] + (c2 - c0) * b[k];
        along = dot3(g, dir);
        squares[d] = dot3(g, g);
        store3(d ? o->gv : o->gu, lane, g);
        for (int far = 0; far < 2; far++) {
            store((d ? o->v : o->u)[far] + lane, here);
            store((d ? o->dv : o->du)[far] + lane, along);
        }
    }
    texels = vsqrt(squares[0] * squares[1]) * size * (spacing * spacing);
    for (int i = 0; i < WIDTH; i++) {
        o->offset[lane + i] = pack->level[0].offset;
        o->stride[lane + i] = pack->level[0].stride;
        o->width[lane + i] = (float) pack->level[0].width;
        o->height[lane + i] = (float) pack->level[0].height;
    }
    if (!any(texels > 2.0f))
        return;
    for (int i = 0; i < WIDTH; i++) {
        float left = texels[i];
        int level = 0;
        while (level + 1 < pack->levels && left > 2.0f) { /* nearest mip level: more than 2 texels are closer to 4 than to 1 */
            left *= 0.25f;
            level++;
        }
        o->offset[lane + i] = pack->level[level].offset;
        o->stride[lane + i] = pack->level[level].stride;
        o->width[lane + i] = (float) pack->level[level].width;
        o->height[lane + i] = (float) pack->level[level].height;
    }
}

INLINE void start_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p, int lane)
{
    const float eta = work->refracts ? m->eta : 1.0f;
    const vf u = load(p->u + lane), v = load(p->v + lane);
    vf at[3], n[3], s[3], facet[3], camera[3], dir[3], corner[3], e1[3], e2[3], a[3], b[3], square, h, co, ci, down, facing, f = { 0 };
    vi usable;

    mean3(p->corner, 3, lane, u, v, at);
    mean3(p->normal, 3, lane, u, v, n);
    mean3(p->plane, 4, lane, u, v, s);
    h = (1.0f - u - v) * load(p->plane[0][3] + lane) + u * load(p->plane[1][3] + lane) + v * load(p->plane[2][3] + lane);
    load3(p->corner[0], lane, corner);
    load3(p->corner[1], lane, e1);
    load3(p->corner[2], lane, e2);
    load3(p->camera, lane, camera);
    for (int k = 0; k < 3; k++) {
        e1[k] -= corner[k];
        e2[k] -= corner[k];
    }
    cross3(e1, e2, facet);
    square = dot3(facet, facet);
    square = (vf) ((vi) (1.0f / vmax(square, splat(1e-30f))) & (square > 1e-30f));
    cross3(e2, facet, a);
    cross3(facet, e1, b);
    for (int k = 0; k < 3; k++) {
        a[k] *= square;
        b[k] *= square;
    }
    unit3(n);
    unit3(s);
    unit3(facet);
    facing = dot3(facet, camera);
    co = dot3(n, camera);
    usable = (dot3(n, n) > 0.5f) & (co > 1e-3f); /* else the shading normal faces away from the camera */
    for (int k = 0; k < 3; k++)
        n[k] = select(usable, n[k], select(facing < 0.0f, -facet[k], facet[k]));
    co = clamped(select(usable, co, vabs(facing)), 1e-3f, 1.0f);
    ci = vsqrt(1.0f - (1.0f - co * co) / (eta * eta));
    if (eta != 1.0f) {
        const vf rs = (co - eta * ci) / (co + eta * ci), rp = (eta * co - ci) / (eta * co + ci);
        f = 0.5f * (rs * rs + rp * rp);
    }
    for (int k = 0; k < 3; k++)
        dir[k] = (co / eta - ci) * n[k] - camera[k] / eta;
    down = -dot3(s, dir);
    usable = down > -1e3f; /* else NaN: a vertex has no plane */
    for (int k = 0; k < 3; k++)
        s[k] = select(usable, s[k], n[k]);
    h = (vf) ((vi) h & usable);
    down = vmax(select(usable, down, ci), splat(LAYERED_GRAZING));
    store3(p->p, lane, at);
    store3(p->n, lane, n);
    store3(p->s, lane, s);
    store3(p->facet, lane, facet);
    store3(p->w, lane, dir);
    store3(p->exit_normal, lane, dir);
    store(p->h + lane, h);
    store(p->gain + lane, (1.0f - f) / (eta * eta));
    store(p->rate + lane, down);
    store(p->length + lane, m->deepest / down);
    store(p->exit + lane, splat(LAYERED_FAR));
    store(p->exit_rate + lane, splat(1.0f));
    for (int k = 0; k < 3; k++) {
        store(p->color[k] + lane, splat(0.0f));
        store(p->light[k] + lane, splat(0.0f));
    }
    for (int k = 0; k < m->packs + m->colors; k++)
        start_lookup(&m->pack[k], p->uv + (ptrdiff_t) k * 6 * LANES, p, lane, a, b, dir, &p->lookup[k]);
}

static void layered_start(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p)
{
    for (int lane = 0; lane < LANES; lane += WIDTH)
        start_lanes(work, m, p, lane);
    for (int i = 0; i < LANES; i++)
        p->ends_deep[i] = -1;
    p->thin = p->shows_substrate = false;
}

/* --- Rays ----------------------------------------------------------------------------------------------------------------------- */

/* Offset of a ray's origin from the surface, in the order of the rounding error of its coordinates. */
INLINE vf ray_offset(const vf at[3])
{
    return LAYERED_RAY_OFFSET * vmax(vmax(vabs(at[0]), vabs(at[1])), vmax(vabs(at[2]), splat(1e-3f)));
}

INLINE void set_ray(struct pell_ray16 *r, int lane, const vf from[3], const vf dir[3], vf near, vf far)
{
    store(r->ox + lane, from[0]);
    store(r->oy + lane, from[1]);
    store(r->oz + lane, from[2]);
    store(r->dx + lane, dir[0]);
    store(r->dy + lane, dir[1]);
    store(r->dz + lane, dir[2]);
    store(r->tnear + lane, near);
    store(r->tfar + lane, far);
    store(r->time + lane, splat(0.0f));
    for (int i = 0; i < WIDTH; i++) {
        r->mask[lane + i] = PELL_RAY_ALL;
        r->id[lane + i] = r->flags[lane + i] = 0;
    }
}

static void layered_exit_rays(const struct layered_packet *p, float size, struct pell_ray16 *r, int32_t *valid)
{
    for (int lane = 0; lane < LANES; lane += WIDTH) {
        vf at[3], dir[3], facet[3];
        load3(p->p, lane, at);
        load3(p->w, lane, dir);
        load3(p->facet, lane, facet);
        set_ray(r, lane, at, dir, ray_offset(at) / vmax(vabs(dot3(facet, dir)), splat(0.05f)),
                vmin(4.0f * load(p->length + lane), splat(4.0f * size)));
    }
    for (int i = 0; i < LANES; i++)
        valid[i] = i < p->count ? -1 : 0;
}

static int layered_light_rays(const struct layered_packet *p, int path, bool shadows, struct layered_light *source, struct pell_ray16 *r,
                              int32_t *valid)
{
    int planes = 0, nodes = 0, rays = 0;

    for (int lane = 0; lane < LANES; lane += WIDTH) {
        vf at[3], facet[3], to[3], normal[3], camera[3], far = splat(INFINITY), front, facing, fraction, lit = { 0 }, off;
        vi active;
        load3(p->p, lane, at);
        load3(p->facet, lane, facet);
        load3(p->n, lane, normal);
        load3(p->camera, lane, camera);
        load3(source->to, lane, to);
        if (!source->distant) {
            vf distance, inv_distance;
            for (int k = 0; k < 3; k++)
                to[k] -= at[k];
            distance = vmax(vsqrt(dot3(to, to)), splat(1e-6f));
            inv_distance = 1.0f / distance;
            for (int k = 0; k < 3; k++)
                to[k] *= inv_distance;
            far = 0.9999f * distance;
        }
        front = select(dot3(facet, camera) < 0.0f, splat(-1.0f), splat(1.0f));
        facing = front * dot3(facet, to);
        fraction = splat(path == LAYERED_RAYS ? 0.0f : 1.0f);
        if (path == LAYERED_PLANES_RAYS) {
            const vf x = clamped(dot3(normal, to) * (1.0f / LAYERED_HORIZON), 0.0f, 1.0f);
            fraction = (vf) ((vi) (x * x * (3.0f - 2.0f * x)) & (facing > 0.0f));
        }
        for (int c = 0; c < 3; c++)
            lit += load(source->power[c] + lane);
        store(source->planes + lane, fraction);
        store(source->seen + lane, splat(1.0f));
        off = front * ray_offset(at);
        for (int k = 0; k < 3; k++)
            at[k] += off * facet[k];
        set_ray(r, lane, at, to, splat(0.0f), far);
        active = (lit > 0.0f) & (fraction > 0.0f) & (facing > 0.0f) & (shadows ? -1 : 0);
        for (int i = 0; i < WIDTH; i++) {
            const bool on = lane + i < p->count && lit[i] > 0.0f;
            planes |= on && fraction[i] > 0.0f;
            nodes |= on && fraction[i] < 1.0f;
            valid[lane + i] = on ? active[i] : 0;
            rays += on && active[i];
        }
    }
    source->any_planes = planes != 0;
    source->any_nodes = nodes != 0;
    return rays;
}

static void layered_march(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                          const struct layered_light *sources, int count)
{
    if (!PELL_SIMD(layered_march_fast)(work, m, p, sources, count))
        PELL_SIMD(layered_march_any)(work, m, p, sources, count);
}

extern const struct layered_kernels PELL_SIMD(layered_kernels);
const struct layered_kernels PELL_SIMD(layered_kernels) = {
    .fill = layered_fill, .start = layered_start, .exit_rays = layered_exit_rays, .light_rays = layered_light_rays, .march = layered_march
};
