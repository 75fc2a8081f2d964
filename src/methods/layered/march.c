/* SPDX-License-Identifier: MIT
 *
 * march.c - the march of layered for any packet; compiled once per level of base/simd.h. The mathematics is in kernels.h and README.md.
 * Layers that no lane is in are skipped: they contribute 0.
 */
#include "methods/layered/march.h"

/* --- A step --------------------------------------------------------------------------------------------------------------------- */

/* Data of a step that all lights share, at the sample point M. */
struct step {
    float t;
    vf x, inv_x, step; /* mm from P, and its reciprocal; length of the step */
    vf at[3];          /* M */
    vi far;
    vf depth, normal[3];           /* below the reference surface, and its normal */
    vf plane[3], plane_distance;   /* n_M; distance of M from the plane */
    vf bottom[MOST];               /* depths of the layers' bottoms at M */
    vf length[MOST], before[MOST]; /* mm of the step in a layer, and of its first half */
    int list[MOST], listed;        /* layers that some lane is in */
    vf tau[3], step_tau[3];        /* optical depth of the camera ray before the step, and in it; base 2 */
    vf alive, hidden;              /* 1 or 0: the camera ray reaches this step; the step ends below the deepest layer */
    vf hits_substrate;             /* 1 or 0: the step reaches the substrate below the layers */
    float *trace;                  /* output for |KM|, or NULL */
};

/* The path from a light to M. */
struct path {
    vf km, cosine, inv_cosine, km_slope; /* |KM|, cosine at K and its reciprocal, d|KM|/dx */
    vf beam;                             /* irradiance over the light's power */
    vf dir[3];                           /* unit, from M toward the light */
    vf tint[3];                          /* if m->colors: tint of the light that enters at K */
    vf bottom[MOST];                     /* depths of the layers' bottoms at K */
};

struct ray {
    int lane; /* index of its first lane in the packet */
    vf p[3], w[3], n[3], s[3], h, rate, length, exit, exit_rate, exit_normal[3];
    vf inv_rate, inv_exit_rate, inv_length;
};

INLINE void find_layers(const struct layered_work *work, const struct layered_medium *m, const struct ray *ray, struct step *s)
{
    const vf rate = select(s->far, ray->exit_rate, ray->rate), inv_rate = select(s->far, ray->inv_exit_rate, ray->inv_rate);
    const vf low = vmax(s->depth - 0.5f * s->step * rate, splat(0.0f)), high = s->depth + 0.5f * s->step * rate;
    const vf first = select(s->far, s->depth, low), last = select(s->far, high, s->depth);
    vf above = { 0 }, covered = { 0 };

    s->listed = 0;
    for (int c = 0; c < 3; c++)
        s->step_tau[c] = splat(0.0f);
    for (int j = 0; j < m->count; j++) {
        const vf bottom = s->bottom[j];
        vf length, before;
        if (work->exponential) {
            length = vmax(vmin(bottom, high) - vmax(above, low), splat(0.0f)) * inv_rate;
            before = vmax(vmin(bottom, last) - vmax(above, first), splat(0.0f)) * inv_rate;
        } else {
            length = (vf) ((vi) s->step & (s->depth >= above) & (s->depth < bottom));
            before = 0.5f * length;
        }
        above = bottom;
        if (!any(length > 0.0f))
            continue;
        s->length[j] = length;
        s->before[j] = before;
        s->list[s->listed++] = j;
        covered += length;
        for (int c = 0; c < 3; c++)
            s->step_tau[c] += length * m->layer[j].sigma_t2[c];
    }
    s->hidden = (vf) ((vi) splat(1.0f) & (s->step - covered > 1e-3f * s->step));
}

/* Path by planes, (9) and (10). `entry`: on input K of the previous step, from which the direction to the light is taken; on output K. */
INLINE void path_by_planes(const struct layered_work *work, const struct layered_medium *m, const struct layered_light *source, int lane,
                           const struct step *s, vf entry[3], struct path *path)
{
    vf to[3], k[3], cosine, c, d2 = splat(1.0f);

    load3(source->to, lane, to);
    if (!source->distant) {
        vf inv_length;
        for (int i = 0; i < 3; i++)
            to[i] -= work->refracts ? entry[i] : s->at[i];
        inv_length = 1.0f / vsqrt(vmax(dot3(to, to), splat(1e-12f)));
        for (int i = 0; i < 3; i++)
            to[i] *= inv_length;
    }
    cosine = dot3(s->plane, to);
    path->beam = load(source->seen + lane);
    if (work->refracts) {
        const float eta = m->eta, inv_eta = 1.0f / eta;
        const vf co = clamped(cosine, 1e-4f, 1.0f), ci = vsqrt(1.0f - (1.0f - co * co) * (inv_eta * inv_eta));
        const vf rs = (co - eta * ci), ss = (co + eta * ci), rp = (eta * co - ci), sp = (eta * co + ci);
        const vf a = rs * sp, b = rp * ss, product = ss * sp, product2 = product * product;
        for (int i = 0; i < 3; i++)
            path->dir[i] = (to[i] - cosine * s->plane[i]) * inv_eta + ci * s->plane[i];
        path->beam *= (vf) ((vi) ((product2 - 0.5f * (a * a + b * b)) * co / (product2 * ci)) & (cosine > 0.0f));
        c = ci;
    } else {
        for (int i = 0; i < 3; i++)
            path->dir[i] = to[i];
        if (!work->absolute)
            path->beam = (vf) ((vi) path->beam & (cosine > 0.0f));
        c = vabs(cosine);
    }
    path->cosine = vmax(c, splat(LAYERED_GRAZING));
    path->inv_cosine = 1.0f / path->cosine;
    path->km = s->plane_distance * path->inv_cosine;
    path->km_slope = path->km * s->inv_x;
    for (int i = 0; i < 3; i++)
        k[i] = s->at[i] + path->km * path->dir[i];
    if (!source->distant) {
        vf to_light[3];
        load3(source->to, lane, to_light);
        for (int i = 0; i < 3; i++) {
            to_light[i] -= k[i];
            entry[i] = k[i];
        }
        d2 = vmax(dot3(to_light, to_light), splat(1e-6f));
        path->beam /= d2;
    } else {
        for (int i = 0; i < 3; i++)
            entry[i] = k[i];
    }
}

INLINE void depths_at(const struct layered_medium *m, const struct layered_packet *p, const struct ray *ray, const vf k[3], vf *bottom)
{
    const int lane = ray->lane;
    vf d[3];

    for (int i = 0; i < 3; i++)
        d[i] = k[i] - ray->p[i];
    for (int i = 0; i < m->packs; i++) {
        const struct layered_lookup *lookup = &p->lookup[i];
        vf g[3], u = load(lookup->u[0] + lane), v = load(lookup->v[0] + lane), q[4];
        load3(lookup->gu, lane, g);
        u += dot3(g, d);
        load3(lookup->gv, lane, g);
        v += dot3(g, d);
        look_up(m, &m->pack[i], lookup, lane, m->pack[i].count, u, v, q);
        for (int j = 0; j < m->pack[i].count; j++)
            bottom[m->pack[i].layer[j]] = q[j];
    }
    order_depths(m, bottom);
}

/* Tint of the boundary at the entry point k. */
INLINE void tint_at(const struct layered_medium *m, const struct layered_packet *p, const struct ray *ray, const vf k[3], vf out[3])
{
    const struct layered_lookup *lookup = &p->lookup[m->packs];
    const int lane = ray->lane;
    vf d[3], g[3], u = load(lookup->u[0] + lane), v = load(lookup->v[0] + lane), q[4];

    for (int i = 0; i < 3; i++)
        d[i] = k[i] - ray->p[i];
    load3(lookup->gu, lane, g);
    u += dot3(g, d);
    load3(lookup->gv, lane, g);
    v += dot3(g, d);
    look_up_values(&m->pack[m->packs], lookup, lane, 3, u, v, q);
    load3(p->entry_tint, lane, out);
    for (int c = 0; c < 3; c++)
        out[c] *= q[c] * (1.0f / 65535.0f / 32767.0f) + 32768.0f / 65535.0f;
}

/* Interpolates |KM| between nodes k and k + 1: a parabola through the slopes on both sides, because chords of a round body grow like square
 * roots; clamped to the values at the two nodes. */
INLINE vf interpolate_km(const struct layered_work *work, const struct layered_light *source, int lane, int k, float t)
{
    const float *at = work->node;
    const vf a = load(source->km[k] + lane), b = load(source->km[k + 1] + lane), slope = (b - a) * (1.0f / (at[k + 1] - at[k]));
    vf bend = { 0 }, km;
    float sides = 0.0f;

    t = t > at[k] ? t < at[k + 1] ? t : at[k + 1] : at[k];
    if (k > 0) {
        const vf before = (a - load(source->km[k - 1] + lane)) * (1.0f / (at[k] - at[k - 1]));
        bend += (slope - before) * (1.0f / (at[k + 1] - at[k - 1]));
        sides += 1.0f;
    }
    if (k + 2 < work->nodes) {
        const vf after = (load(source->km[k + 2] + lane) - b) * (1.0f / (at[k + 2] - at[k + 1]));
        bend += (after - slope) * (1.0f / (at[k + 2] - at[k]));
        sides += 1.0f;
    }
    km = a + slope * (t - at[k]) + bend * ((t - at[k]) * (t - at[k + 1]) / sides);
    return vmin(vmax(km, vmin(a, b)), vmax(a, b));
}

/* Path at t, interpolated between the two nearest nodes. */
INLINE void path_by_nodes(const struct layered_work *work, const struct layered_medium *m, const struct layered_light *source,
                          const struct ray *ray, const struct step *s, struct path *path)
{
    const int lane = ray->lane;
    vf inv_length;
    float f;
    int k = 0;

    while (k + 2 < work->nodes && s->t > work->node[k + 1])
        k++;
    f = (s->t - work->node[k]) / (work->node[k + 1] - work->node[k]);
    f = f > 0.0f ? f < 1.0f ? f : 1.0f : 0.0f;
#define LERP_ROW(what, row)                                                                                                                \
    (load(source->what[k] row + lane) + f * (load(source->what[k + 1] row + lane) - load(source->what[k] row + lane)))
#define LERP(what) LERP_ROW(what, )
    path->km = interpolate_km(work, source, lane, k, s->t);
    path->cosine = LERP(cosine);
    path->inv_cosine = 1.0f / path->cosine;
    path->beam = LERP(beam);
    path->km_slope =
        (load(source->km[k + 1] + lane) - load(source->km[k] + lane)) * ray->inv_length * (1.0f / (work->node[k + 1] - work->node[k]));
    path->km_slope = clamped(path->km_slope, -1.0f, 20.0f);
    for (int i = 0; i < 3; i++)
        path->dir[i] = LERP_ROW(dir, [i]);
    inv_length = 1.0f / vsqrt(vmax(dot3(path->dir, path->dir), splat(1e-12f)));
    for (int i = 0; i < 3; i++)
        path->dir[i] *= inv_length;
    for (int c = 0; c < 3 && m->colors; c++)
        path->tint[c] = LERP_ROW(tint, [c]);
#undef LERP
#undef LERP_ROW
    for (int j = 0; j < m->count; j++) {
        const vf a = load(source->depth + (k * m->count + j) * LANES + lane);
        const vf b = load(source->depth + ((k + 1) * m->count + j) * LANES + lane);
        path->bottom[j] = a + f * (b - a);
    }
}

/* Blends `path`, by nodes, with the path by planes, of weight `planes`. */
INLINE void mix_paths(const struct layered_medium *m, vf planes, const struct path *by_planes, struct path *path)
{
    /* Blends reciprocals: where the surface curves away, the path by planes is the one that is far too long. Where no traced ray reached
     * the surface, only the path by planes has a length. */
    const vf blended = path->km * by_planes->km / vmax(planes * path->km + (1.0f - planes) * by_planes->km, splat(1e-20f));

    path->km = select((path->km > 0.0f) & (planes < 1.0f), blended, by_planes->km);
    path->cosine += planes * (by_planes->cosine - path->cosine);
    path->inv_cosine = 1.0f / path->cosine;
    path->km_slope += planes * (by_planes->km_slope - path->km_slope);
    path->beam += planes * (by_planes->beam - path->beam);
    for (int i = 0; i < 3; i++)
        path->dir[i] += planes * (by_planes->dir[i] - path->dir[i]);
    for (int c = 0; c < 3 && m->colors; c++)
        path->tint[c] += planes * (by_planes->tint[c] - path->tint[c]);
    for (int j = 0; j < m->count; j++)
        path->bottom[j] += planes * (by_planes->bottom[j] - path->bottom[j]);
}

/* Optical depths of the path from K to M, base 2. */
INLINE void attenuation(const struct layered_work *work, const struct layered_medium *m, const struct step *s, const struct path *path,
                        bool both, vf tau[3])
{
    const struct layered_layer *last = &m->layer[m->count - 1];
    vf below = { 0 }, cos_at_m = { 0 }, blend_m = splat(0.5f), reach, above = { 0 }, inv_cosine = path->inv_cosine, inv_below = { 0 };
    vf bottom_at_m = { 0 }, below_layers;
    vi split = { 0 };

    if (both) {
        const vf c1 = -dot3(s->normal, path->dir);
        cos_at_m = vmax(c1, splat(1e-3f));
        below = (path->km * path->cosine - s->depth) / (cos_at_m + path->cosine);
        below = vmin(vmax(below, splat(0.0f)), path->km);
        below = (vf) ((vi) below & (c1 > 0.0f));
        split = below > 0.0f;
        blend_m = (vf) ((vi) blend_m & ~split);
        inv_below = 1.0f / cos_at_m;
        bottom_at_m = s->depth + below * cos_at_m;
    }
    reach = (path->km - below) * path->cosine;
    for (int c = 0; c < 3; c++)
        tau[c] = splat(0.0f);
    for (int j = 0; j < m->count; j++) {
        const vf bottom = path->bottom[j] + blend_m * (s->bottom[j] - path->bottom[j]);
        vf length = vmax(vmin(reach, bottom) - above, splat(0.0f)) * inv_cosine;
        above = bottom;
        if (any(split)) {
            const vf start = j > 0 ? vmax(s->bottom[j > 0 ? j - 1 : 0], s->depth) : s->depth;
            length += (vf) ((vi) (vmax(vmin(s->bottom[j], bottom_at_m) - start, splat(0.0f)) * inv_below) & split);
        }
        for (int c = 0; c < 3; c++)
            tau[c] += length * m->layer[j].sigma_t2[c];
    }
    if (m->bottomless)
        return;
    below_layers = vmax(reach - above, splat(0.0f)) * inv_cosine;
    if (work->rest)
        for (int c = 0; c < 3; c++)
            tau[c] += below_layers * select(split, splat(m->rest[c]), splat(last->sigma_t2[c]));
    if (any(split)) {
        below_layers = (vf) ((vi) (vmax(bottom_at_m - vmax(s->bottom[m->count - 1], s->depth), splat(0.0f)) * inv_below) & split);
        for (int c = 0; c < 3; c++)
            tau[c] += below_layers * m->rest[c];
    }
}

/* In-scattered light of the step: the contribution of each layer, integrated from the start down (far: from the end). `path_tau`: optical
 * depths of the path, base 2. */
INLINE void scatter(const struct layered_work *work, const struct layered_medium *m, const struct ray *ray, const struct step *s,
                    const struct path *path, const vf path_tau[3], const vf colour[3], vf sum[3])
{
    const vf cosine = -dot3(path->dir, ray->w);
    const vf rate = work->exponential ? 1.0f + path->km_slope : splat(1.0f);
    vf start[3], tau_above[3], weight[3];

    for (int c = 0; c < 3; c++) {
        start[c] = s->tau[c] + path_tau[c];
        weight[c] = path->beam * colour[c] * s->alive;
        tau_above[c] = splat(0.0f);
    }
    if (work->exponential)
        for (int i = 0; i < s->listed; i++)
            for (int c = 0; c < 3; c++)
                start[c] -= path->km_slope * s->before[s->list[i]] * m->layer[s->list[i]].sigma_t2[c];
    for (int i = 0; i < s->listed; i++) {
        const int j = s->list[i];
        const struct layered_layer *layer = &m->layer[j];
        const vf length = s->length[j];
        vf phase = phase_value(&layer->phase[0], cosine);
        for (int c = 0; c < 3; c++) {
            const vf z = rate * length * layer->sigma_t2[c], y = 0.5f * z, up = tau_above[c] + y;
            const vf tau = start[c] + select(s->far, rate * s->step_tau[c] - up, up);
            vf value;
            if (c > 0 && !layer->one_phase)
                phase = phase_value(&layer->phase[c], cosine);
            if (!work->exponential) {
                value = exp2_neg(start[c] + y);
            } else {
                value = mean_transmittance(tau, y, any(vabs(y) > THICK));
            }
            tau_above[c] += z;
            sum[c] += weight[c] * (phase * length) * (layer->sigma_s[c] * value);
        }
    }
}

/* Adds the light reflected by the Lambertian substrate below the deepest layer where this step reaches it. */
INLINE void add_substrate(const struct layered_work *work, const struct step *s, const struct path *path, const vf path_tau[3],
                          const vf colour[3], const vf base[3], vf sum[3])
{
    const vf facing = vmax(dot3(s->normal, path->dir), splat(0.0f)), rate = work->exponential ? 1.0f + path->km_slope : splat(1.0f);

    for (int c = 0; c < 3; c++) {
        const vf back = work->exponential ? path->km_slope * 0.5f * s->step_tau[c] : splat(0.0f);
        sum[c] += s->hits_substrate * path->beam * colour[c] * base[c] * facing *
                  exp2_neg(s->tau[c] + path_tau[c] - back + rate * s->step_tau[c]);
    }
}

/* --- The march ------------------------------------------------------------------------------------------------------------------ */

INLINE void locate_sample(const struct layered_medium *m, const struct layered_packet *p, const struct ray *ray, struct step *s)
{
    const int lane = ray->lane;
    vf blend[3], inv_length, depth_near = s->x * ray->rate;

    s->depth = depth_near;
    s->far = (vi) { 0 };
    if (p->thin) {
        const vf depth_far = (ray->exit - s->x) * ray->exit_rate;
        s->far = depth_far < depth_near;
        s->depth = vmax(select(s->far, depth_far, depth_near), splat(0.0f));
    }
    for (int k = 0; k < 3; k++) {
        s->at[k] = ray->p[k] + s->x * ray->w[k];
        blend[k] = (1.0f - s->t) * ray->n[k] + s->t * ray->s[k];
    }
    inv_length = 1.0f / vsqrt(vmax(dot3(blend, blend), splat(1e-12f)));
    s->plane_distance = splat(0.0f);
    for (int k = 0; k < 3; k++) {
        s->plane[k] = blend[k] * inv_length;
        s->normal[k] = select(s->far, ray->exit_normal[k], s->plane[k]);
        s->plane_distance += (s->t * ray->h * ray->n[k] - s->x * ray->w[k]) * s->plane[k];
    }
    s->plane_distance = vabs(s->plane_distance);
    for (int i = 0; i < m->packs; i++) {
        const struct layered_lookup *lookup = &p->lookup[i];
        vf u = load(lookup->u[0] + lane) + s->x * load(lookup->du[0] + lane),
           v = load(lookup->v[0] + lane) + s->x * load(lookup->dv[0] + lane);
        vf q[4];
        if (p->thin) {
            u = select(s->far, load(lookup->u[1] + lane) + s->x * load(lookup->du[1] + lane), u);
            v = select(s->far, load(lookup->v[1] + lane) + s->x * load(lookup->dv[1] + lane), v);
        }
        look_up(m, &m->pack[i], lookup, lane, m->pack[i].count, u, v, q);
        for (int k = 0; k < m->pack[i].count; k++)
            s->bottom[m->pack[i].layer[k]] = q[k];
    }
    if (m->packs > 0)
        order_depths(m, s->bottom);
}

/* State of a light during the march: K of the previous step, and the lanes where its light is not yet extinguished. */
struct light_state {
    vf entry[3];
    vi lit;
};

INLINE void light_step(const struct layered_work *work, const struct layered_medium *m, const struct layered_packet *p,
                       const struct ray *ray, const struct step *s, const struct layered_light *source, struct light_state *light_state,
                       vf sum[3])
{
    const int lane = ray->lane;
    vf colour[3], path_tau[3];
    vi within_bound = { 0 };
    struct path path;

    load3(source->power, lane, colour);
    if (source->any_planes) {
        path_by_planes(work, m, source, lane, s, light_state->entry, &path);
        if (s->trace)
            store(s->trace, path.km);
        if (m->colors)
            tint_at(m, p, ray, light_state->entry, path.tint);
        if (m->packs > 0)
            depths_at(m, p, ray, light_state->entry, path.bottom);
        else
            for (int j = 0; j < m->count; j++)
                path.bottom[j] = s->bottom[j];
    }
    if (source->any_nodes) {
        const struct path planes = path;
        path_by_nodes(work, m, source, ray, s, &path);
        if (source->any_planes)
            mix_paths(m, load(source->planes + lane), &planes, &path);
    }
    for (int c = 0; c < 3 && m->colors; c++)
        colour[c] *= path.tint[c];
    attenuation(work, m, s, &path, source->any_nodes || p->thin, path_tau);
    for (int c = 0; c < 3; c++) { /* light from below gets brighter on the way down, so its own path gives no bound */
        const vf bound = source->any_nodes || p->thin ? splat(0.0f) : path_tau[c];
        within_bound |= s->tau[c] + bound <= work->max_tau2;
    }
    path.beam = (vf) ((vi) path.beam & light_state->lit);
    light_state->lit &= within_bound;
    scatter(work, m, ray, s, &path, path_tau, colour, sum);
    if (p->shows_substrate && any(s->hits_substrate > 0.0f)) {
        vf base[3];
        load3(p->color, lane, base);
        add_substrate(work, s, &path, path_tau, colour, base, sum);
    }
}

/* Step boundaries for a packet, chosen by the mean depth of its marches. */
static const float *edges_of(const struct layered_medium *m, const struct layered_packet *p)
{
    float deep = 0.0f, ratio;
    int k = 1;

    if (!p->thin)
        return m->edges[0];
    for (int i = 0; i < p->count; i++)
        deep += p->length[i] * p->rate[i];
    ratio = m->deepest > 0.0f ? deep / ((float) p->count * m->deepest) : 1.0f;
    for (; k < LAYERED_THICKNESSES && ratio < 0.707f; k++)
        ratio *= 2.0f;
    return m->edges[k];
}

static void march_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                        const struct layered_light *sources, int count, int lane)
{
    const int n = work->samples;
    const float *edges = edges_of(m, p);
    vf sum[3] = { { 0 } }, gain = load(p->gain + lane);
    vi any_lit = (vi) splat(0.0f) == 0;
    struct light_state light_state[LAYERED_GROUP];
    struct step s;
    struct ray ray;

    ray.lane = lane;
    load3(p->p, lane, ray.p);
    load3(p->w, lane, ray.w);
    load3(p->n, lane, ray.n);
    load3(p->s, lane, ray.s);
    load3(p->exit_normal, lane, ray.exit_normal);
    ray.h = load(p->h + lane);
    ray.rate = load(p->rate + lane);
    ray.length = load(p->length + lane);
    ray.exit = load(p->exit + lane);
    ray.exit_rate = load(p->exit_rate + lane);
    ray.inv_rate = 1.0f / ray.rate;
    ray.inv_exit_rate = 1.0f / ray.exit_rate;
    ray.inv_length = 1.0f / vmax(ray.length, splat(1e-20f));
    for (int l = 0; l < count; l++) {
        light_state[l].lit = any_lit;
        for (int k = 0; k < 3; k++)
            light_state[l].entry[k] = ray.p[k];
    }
    for (int c = 0; c < 3; c++)
        s.tau[c] = splat(0.0f);
    s.alive = splat(1.0f);
    if (m->packs == 0)
        order_depths(m, s.bottom);
    for (int i = 0; i < n && any((s.alive > 0.0f) & any_lit); i++) {
        s.t = 0.5f * (edges[i] + edges[i + 1]);
        s.step = ray.length * (edges[i + 1] - edges[i]);
        s.x = ray.length * s.t;
        s.inv_x = ray.inv_length * (1.0f / s.t);
        locate_sample(m, p, &ray, &s);
        find_layers(work, m, &ray, &s);
        s.hits_substrate = splat(0.0f);
        if (p->shows_substrate) {
            const vi ends = i + 1 == n ? load_int(p->ends_deep + lane) : (vi) { 0 };
            s.hits_substrate = (vf) ((vi) s.alive & ((s.hidden > 0.0f) | ends));
        }
        any_lit = (vi) { 0 };
        for (int l = 0; l < count; l++) {
            s.trace = p->trace && l == 0 ? p->trace + (ptrdiff_t) i * LANES + lane : NULL;
            light_step(work, m, p, &ray, &s, &sources[l], &light_state[l], sum);
            any_lit |= light_state[l].lit;
        }
        for (int c = 0; c < 3; c++)
            s.tau[c] += s.step_tau[c];
        if (work->exponential || p->shows_substrate)
            s.alive *= 1.0f - s.hidden;
    }
    for (int c = 0; c < 3; c++) {
        const vf light = sum[c] * gain, kept = load(p->light[c] + lane);
        store(p->light[c] + lane, kept + select((light >= 0.0f) & (light < 1e30f), light, splat(0.0f)));
    }
}

void PELL_SIMD(layered_march_any)(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                                  const struct layered_light *sources, int count)
{
    for (int lane = 0; lane < p->count; lane += WIDTH)
        march_lanes(work, m, p, sources, count, lane);
}
