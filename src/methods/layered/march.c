/* SPDX-License-Identifier: MIT
 *
 * march.c - the march of layered below any packet; compiled once per level of base/simd.h. The mathematics is in kernels.h and README.md.
 * Layers that no lane is in are skipped: they contribute 0.
 */
#include "methods/layered/march.h"

/* --- A step --------------------------------------------------------------------------------------------------------------------- */

/* What all lights share at a place M. */
struct step {
    float t;
    vf x, per_x, step; /* mm from P, and 1 over it; length of the step */
    vf at[3];          /* M */
    vi far;
    vf depth, own[3];            /* below the own surface, and its normal */
    vf plane[3], down;           /* n_M; how far M is from the plane */
    vf bottom[MOST];             /* of layers at M */
    vf part[MOST], before[MOST]; /* mm of the step in a layer, and of its first half */
    int list[MOST], listed;      /* layers that some lane is in */
    vf tau[3], step_tau[3];      /* of the camera's ray at the start of the step, and in it */
    vf alive, hidden;            /* 1 or 0: light is seen from here; the step ends below the deepest layer */
    vf meets;                    /* 1 or 0: the step meets what lies below the layers */
    float *trace;                /* |KM| of the light is asked for, or NULL */
};

/* A light's path to M. */
struct path {
    vf km, cosine, per, rise; /* |KM|, cosine at K and one over it, d|KM|/dx */
    vf beam;                  /* irradiance is power times this */
    vf way[3];                /* unit, from M toward the light */
    vf tint[3];               /* of m->colors: of light that enters at K */
    vf bottom[MOST];          /* of layers at K */
};

struct ray {
    int lane; /* the first in the packet */
    vf p[3], w[3], n[3], s[3], h, rate, length, exit, exit_rate, exit_normal[3];
    vf per_rate, per_exit_rate, per_length;
};

INLINE void find_layers(const struct layered_work *work, const struct layered_medium *m, const struct ray *ray, struct step *s)
{
    const vf ex = select(s->far, ray->exit_rate, ray->rate), per = select(s->far, ray->per_exit_rate, ray->per_rate);
    const vf low = greater(s->depth - 0.5f * s->step * ex, all(0.0f)), high = s->depth + 0.5f * s->step * ex;
    const vf first = select(s->far, s->depth, low), last = select(s->far, high, s->depth);
    vf above = { 0 }, covered = { 0 };

    s->listed = 0;
    for (int c = 0; c < 3; c++)
        s->step_tau[c] = all(0.0f);
    for (int j = 0; j < m->count; j++) {
        const vf bottom = s->bottom[j];
        vf part, before;
        if (work->exponential) {
            part = greater(lesser(bottom, high) - greater(above, low), all(0.0f)) * per;
            before = greater(lesser(bottom, last) - greater(above, first), all(0.0f)) * per;
        } else {
            part = (vf) ((vi) s->step & (s->depth >= above) & (s->depth < bottom));
            before = 0.5f * part;
        }
        above = bottom;
        if (!any(part > 0.0f))
            continue;
        s->part[j] = part;
        s->before[j] = before;
        s->list[s->listed++] = j;
        covered += part;
        for (int c = 0; c < 3; c++)
            s->step_tau[c] += part * m->layer[j].halves[c];
    }
    s->hidden = (vf) ((vi) all(1.0f) & (s->step - covered > 1e-3f * s->step));
}

/* By planes, (9) and (10). `enters`: K of the step before, from which the light is seen. */
INLINE void by_planes(const struct layered_work *work, const struct layered_medium *m, const struct layered_light *source, int lane,
                      const struct step *s, vf enters[3], struct path *path)
{
    vf to[3], k[3], cosine, c, d2 = all(1.0f);

    load3(source->to, lane, to);
    if (!source->away) {
        vf length;
        for (int i = 0; i < 3; i++)
            to[i] -= work->refracts ? enters[i] : s->at[i];
        length = 1.0f / root(greater(dot3(to, to), all(1e-12f)));
        for (int i = 0; i < 3; i++)
            to[i] *= length;
    }
    cosine = dot3(s->plane, to);
    path->beam = load(source->seen + lane);
    if (work->refracts) {
        const float eta = m->eta, per = 1.0f / eta;
        const vf co = between(cosine, 1e-4f, 1.0f), ci = root(1.0f - (1.0f - co * co) * (per * per));
        const vf rs = (co - eta * ci), ss = (co + eta * ci), rp = (eta * co - ci), sp = (eta * co + ci);
        const vf a = rs * sp, b = rp * ss, whole = ss * sp, whole2 = whole * whole;
        for (int i = 0; i < 3; i++)
            path->way[i] = (to[i] - cosine * s->plane[i]) * per + ci * s->plane[i];
        path->beam *= (vf) ((vi) ((whole2 - 0.5f * (a * a + b * b)) * co / (whole2 * ci)) & (cosine > 0.0f));
        c = ci;
    } else {
        for (int i = 0; i < 3; i++)
            path->way[i] = to[i];
        if (!work->absolute)
            path->beam = (vf) ((vi) path->beam & (cosine > 0.0f));
        c = magnitude(cosine);
    }
    path->cosine = greater(c, all(LAYERED_GRAZING));
    path->per = 1.0f / path->cosine;
    path->km = s->down * path->per;
    path->rise = path->km * s->per_x;
    for (int i = 0; i < 3; i++)
        k[i] = s->at[i] + path->km * path->way[i];
    if (!source->away) {
        vf away[3];
        load3(source->to, lane, away);
        for (int i = 0; i < 3; i++) {
            away[i] -= k[i];
            enters[i] = k[i];
        }
        d2 = greater(dot3(away, away), all(1e-6f));
        path->beam /= d2;
    } else {
        for (int i = 0; i < 3; i++)
            enters[i] = k[i];
    }
}

INLINE void depths_at(const struct layered_medium *m, const struct layered_packet *p, const struct ray *ray, const vf k[3], vf *bottom)
{
    const int lane = ray->lane;
    vf d[3];

    for (int i = 0; i < 3; i++)
        d[i] = k[i] - ray->p[i];
    for (int i = 0; i < m->packs; i++) {
        const struct layered_place *place = &p->place[i];
        vf g[3], u = load(place->u[0] + lane), v = load(place->v[0] + lane), q[4];
        load3(place->gu, lane, g);
        u += dot3(g, d);
        load3(place->gv, lane, g);
        v += dot3(g, d);
        look_up(m, &m->pack[i], place, lane, m->pack[i].count, u, v, q);
        for (int j = 0; j < m->pack[i].count; j++)
            bottom[m->pack[i].layer[j]] = q[j];
    }
    order_depths(m, bottom);
}

/* What the boundary does to light that enters at k. */
INLINE void tint_at(const struct layered_medium *m, const struct layered_packet *p, const struct ray *ray, const vf k[3], vf out[3])
{
    const struct layered_place *place = &p->place[m->packs];
    const int lane = ray->lane;
    vf d[3], g[3], u = load(place->u[0] + lane), v = load(place->v[0] + lane), q[4];

    for (int i = 0; i < 3; i++)
        d[i] = k[i] - ray->p[i];
    load3(place->gu, lane, g);
    u += dot3(g, d);
    load3(place->gv, lane, g);
    v += dot3(g, d);
    look_up_numbers(&m->pack[m->packs], place, lane, 3, u, v, q);
    load3(p->enters, lane, out);
    for (int c = 0; c < 3; c++)
        out[c] *= q[c] * (1.0f / 65535.0f / 32767.0f) + 32768.0f / 65535.0f;
}

/* |KM| between nodes k and k + 1: a parabola by the slopes on both sides, for chords of what is round rise like roots; between the
 * two. */
INLINE vf bent(const struct layered_work *work, const struct layered_light *source, int lane, int k, float t)
{
    const float *at = work->node;
    const vf a = load(source->km[k] + lane), b = load(source->km[k + 1] + lane), slope = (b - a) * (1.0f / (at[k + 1] - at[k]));
    vf bend = { 0 };
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
    bend = a + slope * (t - at[k]) + bend * ((t - at[k]) * (t - at[k + 1]) / sides);
    return lesser(greater(bend, lesser(a, b)), greater(a, b));
}

/* Between the nodes about t. */
INLINE void by_nodes(const struct layered_work *work, const struct layered_medium *m, const struct layered_light *source,
                     const struct ray *ray, const struct step *s, struct path *path)
{
    const int lane = ray->lane;
    vf unit;
    float f;
    int k = 0;

    while (k + 2 < work->nodes && s->t > work->node[k + 1])
        k++;
    f = (s->t - work->node[k]) / (work->node[k + 1] - work->node[k]);
    f = f > 0.0f ? f < 1.0f ? f : 1.0f : 0.0f;
#define BETWEEN_OF(what, row)                                                                                                              \
    (load(source->what[k] row + lane) + f * (load(source->what[k + 1] row + lane) - load(source->what[k] row + lane)))
#define BETWEEN(what) BETWEEN_OF(what, )
    path->km = bent(work, source, lane, k, s->t);
    path->cosine = BETWEEN(cosine);
    path->per = 1.0f / path->cosine;
    path->beam = BETWEEN(beam);
    path->rise =
        (load(source->km[k + 1] + lane) - load(source->km[k] + lane)) * ray->per_length * (1.0f / (work->node[k + 1] - work->node[k]));
    path->rise = between(path->rise, -1.0f, 20.0f);
    for (int i = 0; i < 3; i++)
        path->way[i] = BETWEEN_OF(way, [i]);
    unit = 1.0f / root(greater(dot3(path->way, path->way), all(1e-12f)));
    for (int i = 0; i < 3; i++)
        path->way[i] *= unit;
    for (int c = 0; c < 3 && m->colors; c++)
        path->tint[c] = BETWEEN_OF(tint, [c]);
#undef BETWEEN
#undef BETWEEN_OF
    for (int j = 0; j < m->count; j++) {
        const vf here = load(source->depth + (k * m->count + j) * LANES + lane);
        const vf there = load(source->depth + ((k + 1) * m->count + j) * LANES + lane);
        path->bottom[j] = here + f * (there - here);
    }
}

INLINE void mix_paths(const struct layered_medium *m, vf planes, const struct path *a, struct path *path)
{
    /* By reciprocals: where the surface bends away the plane's path is the one that is far too long. Where no ray came to the surface the
     * plane alone says how long it is. */
    const vf both = path->km * a->km / greater(planes * path->km + (1.0f - planes) * a->km, all(1e-20f));

    path->km = select((path->km > 0.0f) & (planes < 1.0f), both, a->km);
    path->cosine += planes * (a->cosine - path->cosine);
    path->per = 1.0f / path->cosine;
    path->rise += planes * (a->rise - path->rise);
    path->beam += planes * (a->beam - path->beam);
    for (int i = 0; i < 3; i++)
        path->way[i] += planes * (a->way[i] - path->way[i]);
    for (int c = 0; c < 3 && m->colors; c++)
        path->tint[c] += planes * (a->tint[c] - path->tint[c]);
    for (int j = 0; j < m->count; j++)
        path->bottom[j] += planes * (a->bottom[j] - path->bottom[j]);
}

/* Optical depths of the path from K to M. */
INLINE void attenuation(const struct layered_work *work, const struct layered_medium *m, const struct step *s, const struct path *path,
                        bool both, vf tau[3])
{
    const struct layered_layer *last = &m->layer[m->count - 1];
    vf below = { 0 }, steep = { 0 }, share = all(0.5f), reach, above = { 0 }, per = path->per, per_below = { 0 };
    vf bottom_below = { 0 }, rest;
    vi two = { 0 };

    if (both) {
        const vf c1 = -dot3(s->own, path->way);
        steep = greater(c1, all(1e-3f));
        below = (path->km * path->cosine - s->depth) / (steep + path->cosine);
        below = lesser(greater(below, all(0.0f)), path->km);
        below = (vf) ((vi) below & (c1 > 0.0f));
        two = below > 0.0f;
        share = (vf) ((vi) share & ~two);
        per_below = 1.0f / steep;
        bottom_below = s->depth + below * steep;
    }
    reach = (path->km - below) * path->cosine;
    for (int c = 0; c < 3; c++)
        tau[c] = all(0.0f);
    for (int j = 0; j < m->count; j++) {
        const vf bottom = path->bottom[j] + share * (s->bottom[j] - path->bottom[j]);
        vf part = greater(lesser(reach, bottom) - above, all(0.0f)) * per;
        above = bottom;
        if (any(two)) {
            const vf start = j > 0 ? greater(s->bottom[j > 0 ? j - 1 : 0], s->depth) : s->depth;
            part += (vf) ((vi) (greater(lesser(s->bottom[j], bottom_below) - start, all(0.0f)) * per_below) & two);
        }
        for (int c = 0; c < 3; c++)
            tau[c] += part * m->layer[j].halves[c];
    }
    if (m->bottomless)
        return;
    rest = greater(reach - above, all(0.0f)) * per;
    if (work->rest)
        for (int c = 0; c < 3; c++)
            tau[c] += rest * select(two, all(m->rest[c]), all(last->halves[c]));
    if (any(two)) {
        rest = (vf) ((vi) (greater(bottom_below - greater(s->bottom[m->count - 1], s->depth), all(0.0f)) * per_below) & two);
        for (int c = 0; c < 3; c++)
            tau[c] += rest * m->rest[c];
    }
}

/* Light of the step: each layer's part of it, from the start down (far: from the end). */
INLINE void scatter(const struct layered_work *work, const struct layered_medium *m, const struct ray *ray, const struct step *s,
                    const struct path *path, const vf light[3], const vf colour[3], vf sum[3])
{
    const vf cosine = -dot3(path->way, ray->w);
    const vf rate = work->exponential ? 1.0f + path->rise : all(1.0f);
    vf start[3], passed[3], weight[3];

    for (int c = 0; c < 3; c++) {
        start[c] = s->tau[c] + light[c];
        weight[c] = path->beam * colour[c] * s->alive;
        passed[c] = all(0.0f);
    }
    if (work->exponential)
        for (int i = 0; i < s->listed; i++)
            for (int c = 0; c < 3; c++)
                start[c] -= path->rise * s->before[s->list[i]] * m->layer[s->list[i]].halves[c];
    for (int i = 0; i < s->listed; i++) {
        const int j = s->list[i];
        const struct layered_layer *layer = &m->layer[j];
        const vf part = s->part[j];
        vf phase = phase_value(&layer->phase[0], cosine);
        for (int c = 0; c < 3; c++) {
            const vf z = rate * part * layer->halves[c], y = 0.5f * z, up = passed[c] + y;
            const vf tau = start[c] + select(s->far, rate * s->step_tau[c] - up, up);
            vf value;
            if (c > 0 && !layer->one_phase)
                phase = phase_value(&layer->phase[c], cosine);
            if (!work->exponential) {
                value = halving(start[c] + y);
            } else {
                value = mean_light(tau, y, any(magnitude(y) > THICK));
            }
            passed[c] += z;
            sum[c] += weight[c] * (phase * part) * (layer->sigma_s[c] * value);
        }
    }
}

/* The Lambert surface below the deepest layer, where this step meets it. */
INLINE void show_bottom(const struct layered_work *work, const struct step *s, const struct path *path, const vf light[3],
                        const vf colour[3], const vf base[3], vf sum[3])
{
    const vf facing = greater(dot3(s->own, path->way), all(0.0f)), rate = work->exponential ? 1.0f + path->rise : all(1.0f);

    for (int c = 0; c < 3; c++) {
        const vf back = work->exponential ? path->rise * 0.5f * s->step_tau[c] : all(0.0f);
        sum[c] += s->meets * path->beam * colour[c] * base[c] * facing * halving(s->tau[c] + light[c] - back + rate * s->step_tau[c]);
    }
}

/* --- The march ------------------------------------------------------------------------------------------------------------------ */

INLINE void find_place(const struct layered_medium *m, const struct layered_packet *p, const struct ray *ray, struct step *s)
{
    const int lane = ray->lane;
    vf blend[3], length, near = s->x * ray->rate;

    s->depth = near;
    s->far = (vi) { 0 };
    if (p->thin) {
        const vf beyond = (ray->exit - s->x) * ray->exit_rate;
        s->far = beyond < near;
        s->depth = greater(select(s->far, beyond, near), all(0.0f));
    }
    for (int k = 0; k < 3; k++) {
        s->at[k] = ray->p[k] + s->x * ray->w[k];
        blend[k] = (1.0f - s->t) * ray->n[k] + s->t * ray->s[k];
    }
    length = 1.0f / root(greater(dot3(blend, blend), all(1e-12f)));
    s->down = all(0.0f);
    for (int k = 0; k < 3; k++) {
        s->plane[k] = blend[k] * length;
        s->own[k] = select(s->far, ray->exit_normal[k], s->plane[k]);
        s->down += (s->t * ray->h * ray->n[k] - s->x * ray->w[k]) * s->plane[k];
    }
    s->down = magnitude(s->down);
    for (int i = 0; i < m->packs; i++) {
        const struct layered_place *place = &p->place[i];
        vf u = load(place->u[0] + lane) + s->x * load(place->du[0] + lane), v = load(place->v[0] + lane) + s->x * load(place->dv[0] + lane);
        vf q[4];
        if (p->thin) {
            u = select(s->far, load(place->u[1] + lane) + s->x * load(place->du[1] + lane), u);
            v = select(s->far, load(place->v[1] + lane) + s->x * load(place->dv[1] + lane), v);
        }
        look_up(m, &m->pack[i], place, lane, m->pack[i].count, u, v, q);
        for (int k = 0; k < m->pack[i].count; k++)
            s->bottom[m->pack[i].layer[k]] = q[k];
    }
    if (m->packs > 0)
        order_depths(m, s->bottom);
}

/* A light as the march goes on: K of the step before, and whether enough of it is left. */
struct coming {
    vf enters[3];
    vi goes_on;
};

INLINE void light_step(const struct layered_work *work, const struct layered_medium *m, const struct layered_packet *p,
                       const struct ray *ray, const struct step *s, const struct layered_light *source, struct coming *coming, vf sum[3])
{
    const int lane = ray->lane;
    vf colour[3], light[3];
    vi stays = { 0 };
    struct path path;

    load3(source->power, lane, colour);
    if (source->any_planes) {
        by_planes(work, m, source, lane, s, coming->enters, &path);
        if (s->trace)
            store(s->trace, path.km);
        if (m->colors)
            tint_at(m, p, ray, coming->enters, path.tint);
        if (m->packs > 0)
            depths_at(m, p, ray, coming->enters, path.bottom);
        else
            for (int j = 0; j < m->count; j++)
                path.bottom[j] = s->bottom[j];
    }
    if (source->any_nodes) {
        const struct path planes = path;
        by_nodes(work, m, source, ray, s, &path);
        if (source->any_planes)
            mix_paths(m, load(source->planes + lane), &planes, &path);
    }
    for (int c = 0; c < 3 && m->colors; c++)
        colour[c] *= path.tint[c];
    attenuation(work, m, s, &path, source->any_nodes || p->thin, light);
    for (int c = 0; c < 3; c++) { /* light from below rises on the way down: of its own way nothing is certain */
        const vf down = source->any_nodes || p->thin ? all(0.0f) : light[c];
        stays |= s->tau[c] + down <= work->most_halves;
    }
    path.beam = (vf) ((vi) path.beam & coming->goes_on);
    coming->goes_on &= stays;
    scatter(work, m, ray, s, &path, light, colour, sum);
    if (p->shows_bottom && any(s->meets > 0.0f)) {
        vf base[3];
        load3(p->color, lane, base);
        show_bottom(work, s, &path, light, colour, base, sum);
    }
}

/* Where the steps of a packet begin and end: by how deep its marches go, on average. */
static const float *edges_of(const struct layered_medium *m, const struct layered_packet *p)
{
    float deep = 0.0f, share;
    int k = 1;

    if (!p->thin)
        return m->edges[0];
    for (int i = 0; i < p->count; i++)
        deep += p->length[i] * p->rate[i];
    share = m->deepest > 0.0f ? deep / ((float) p->count * m->deepest) : 1.0f;
    for (; k < LAYERED_THICKNESSES && share < 0.707f; k++)
        share *= 2.0f;
    return m->edges[k];
}

static void march_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                        const struct layered_light *sources, int count, int lane)
{
    const int n = work->samples;
    const float *edges = edges_of(m, p);
    vf sum[3] = { { 0 } }, gain = load(p->gain + lane);
    vi some = (vi) all(0.0f) == 0;
    struct coming coming[LAYERED_GROUP];
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
    ray.per_rate = 1.0f / ray.rate;
    ray.per_exit_rate = 1.0f / ray.exit_rate;
    ray.per_length = 1.0f / greater(ray.length, all(1e-20f));
    for (int l = 0; l < count; l++) {
        coming[l].goes_on = some;
        for (int k = 0; k < 3; k++)
            coming[l].enters[k] = ray.p[k];
    }
    for (int c = 0; c < 3; c++)
        s.tau[c] = all(0.0f);
    s.alive = all(1.0f);
    if (m->packs == 0)
        order_depths(m, s.bottom);
    for (int i = 0; i < n && any((s.alive > 0.0f) & some); i++) {
        s.t = 0.5f * (edges[i] + edges[i + 1]);
        s.step = ray.length * (edges[i + 1] - edges[i]);
        s.x = ray.length * s.t;
        s.per_x = ray.per_length * (1.0f / s.t);
        find_place(m, p, &ray, &s);
        find_layers(work, m, &ray, &s);
        s.meets = all(0.0f);
        if (p->shows_bottom) {
            const vi ends = i + 1 == n ? load_int(p->ends_deep + lane) : (vi) { 0 };
            s.meets = (vf) ((vi) s.alive & ((s.hidden > 0.0f) | ends));
        }
        some = (vi) { 0 };
        for (int l = 0; l < count; l++) {
            s.trace = p->trace && l == 0 ? p->trace + (ptrdiff_t) i * LANES + lane : NULL;
            light_step(work, m, p, &ray, &s, &sources[l], &coming[l], sum);
            some |= coming[l].goes_on;
        }
        for (int c = 0; c < 3; c++)
            s.tau[c] += s.step_tau[c];
        if (work->exponential || p->shows_bottom)
            s.alive *= 1.0f - s.hidden;
    }
    for (int c = 0; c < 3; c++) {
        const vf light = sum[c] * gain, kept = load(p->light[c] + lane);
        store(p->light[c] + lane, kept + select((light >= 0.0f) & (light < 1e30f), light, all(0.0f)));
    }
}

void PELL_SIMD(layered_march_any)(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                                  const struct layered_light *sources, int count)
{
    for (int lane = 0; lane < p->count; lane += WIDTH)
        march_lanes(work, m, p, sources, count, lane);
}
