/* SPDX-License-Identifier: MIT
 *
 * march_fast.c - the march of layered for the common case; compiled once per level of base/simd.h.
 *
 * Same result as march.c for paths by planes only, thick solids, refraction, exact integration, and a few layers that share one texture.
 * Sums over layers are written with differences of neighbouring coefficients:
 *
 *     Sum sigma_j |reach in j| = reach sigma_n + Sum (sigma_j - sigma_(j+1)) min(reach, bottom_j)
 *
 * `layers` is a compile-time constant in each instance.
 */
#include "methods/layered/march.h"

#define FAST 4 /* maximum number of layers */

INLINE bool is_fast(const struct layered_work *work, const struct layered_medium *m, const struct layered_packet *p,
                    const struct layered_light *sources, int count)
{
    bool fast = work->exponential && work->refracts && work->rest && !p->thin && !p->shows_substrate && m->count <= FAST && m->packs <= 1 &&
                m->colors == 0;

    for (int l = 0; l < count; l++)
        fast = fast && !sources[l].any_nodes;
    for (int i = 0; fast && m->packs > 0 && i < m->pack[0].count; i++)
        fast = m->pack[0].layer[i] == i;
    return fast;
}

/* State of a light during the march: the direction from its previous entry point. */
struct beam {
    vf to[3], square;  /* mm; distant: unit */
    vf seen, light[3]; /* light: for a power of 1 */
    vi lit;            /* lanes where its light is not yet extinguished */
};

/* Refraction of the light at the entry point. */
struct entry {
    vf km, inv_cosine, strength, dir[3];
};

INLINE void enter(const struct layered_light *source, int lane, float eta, const vf at[3], const vf plane[3], vf plane_distance,
                  struct beam *beam, struct entry *entry)
{
    const vf inv_distance = source->distant ? splat(1.0f) : inverse_root(vmax(beam->square, splat(1e-12f)));
    const float inv_eta = 1.0f / eta;
    vf cosine, co, ci, ss, sp, denominator, normal_part, numerator;

    cosine = dot3(plane, beam->to) * inv_distance;
    co = clamped(cosine, 1e-4f, 1.0f);
    ci = vmax((1.0f - inv_eta * inv_eta) + (inv_eta * inv_eta) * (co * co), splat(1e-12f));
    entry->inv_cosine = inverse_root(ci);
    ci *= entry->inv_cosine;
    ss = co + eta * ci;
    sp = eta * co + ci;
    denominator = ss * sp;
    entry->inv_cosine = vmin(entry->inv_cosine, splat(1.0f / LAYERED_GRAZING));
    entry->km = plane_distance * entry->inv_cosine;
    normal_part = ci - cosine * inv_eta;
    for (int k = 0; k < 3; k++)
        entry->dir[k] = beam->to[k] * (inv_distance * inv_eta) + normal_part * plane[k];
    if (!source->distant) {
        vf position[3];
        load3(source->to, lane, position);
        for (int k = 0; k < 3; k++)
            beam->to[k] = position[k] - (at[k] + entry->km * entry->dir[k]);
        beam->square = vmax(dot3(beam->to, beam->to), splat(1e-6f));
    }
    numerator = (2.0f * eta) * (co * co) * (ss * ss + sp * sp) * beam->seen; /* (1 - R) co/ci */
    entry->strength = (vf) ((vi) (numerator / (denominator * denominator * beam->square)) & (cosine > 0.0f));
}

/* Data of a packet that is constant during its march. */
struct lanes {
    const struct layered_medium *m;
    const struct layered_pack *pack; /* the texture of the depths, or NULL */
    const struct layered_lookup *lookup;
    int lane, mapped;
    vf dir[3], gu[3], gv[3], u, v; /* camera ray; gradients of the texture coordinates, and the coordinates at M */
    vf tau[3], alive;
};

/* Layers in a step, and the data that all lights share. */
struct step {
    vf low, middle, high;                 /* depths below the surface */
    vf slope, plane_distance;             /* d plane_distance/dx; distance of M from the plane */
    vf bottom[FAST], length[FAST], above; /* mm of the step in a layer; bottom of the deepest layer in it */
    vf tau[3], half[3];                   /* optical depths of the camera ray in the step, and in its first half */
    unsigned listed;                      /* bit mask of the layers that some lane is in */
};

INLINE void start_light(const struct layered_light *source, int lane, const vf at[3], struct beam *b)
{
    load3(source->to, lane, b->to);
    b->seen = load(source->seen + lane);
    b->lit = (vi) splat(0.0f) == 0;
    b->square = splat(1.0f);
    for (int k = 0; k < 3; k++) {
        b->to[k] -= (vf) ((vi) at[k] & (source->distant ? 0 : -1));
        b->light[k] = splat(0.0f);
    }
    if (!source->distant)
        b->square = dot3(b->to, b->to);
}

INLINE void find_layers(const struct lanes *p, vf inv_rate, struct step *s, const int layers)
{
    const struct layered_layer *layer = p->m->layer;
    vf above_middle = s->low;

    s->above = s->low;
    s->listed = 0;
    if (p->pack) {
        vf over = { 0 }, depths[4];
        look_up(p->m, p->pack, p->lookup, p->lane, p->mapped, p->u, p->v, depths);
#pragma GCC unroll 4
        for (int j = 0; j < layers; j++) {
            s->bottom[j] = vmax(j < p->mapped ? depths[j] : splat(layer[j].depth), over);
            over = s->bottom[j];
        }
    }
    for (int c = 0; c < 3; c++)
        s->tau[c] = s->half[c] = splat(0.0f);
#pragma GCC unroll 4
    for (int j = 0; j < layers; j++) {
        const vf end = vmin(vmax(s->bottom[j], s->low), s->high), end_middle = vmin(end, s->middle);
        s->length[j] = (end - s->above) * inv_rate;
        if (any(s->length[j] > 0.0f)) {
            const vf before = (end_middle - above_middle) * inv_rate;
            s->listed |= 1u << j;
            for (int c = 0; c < 3; c++) {
                s->tau[c] += s->length[j] * layer[j].sigma_t2[c];
                s->half[c] += before * layer[j].sigma_t2[c];
            }
        }
        s->above = end;
        above_middle = end_middle;
    }
}

/* Adds the contribution of one light to a step, layer by layer from its start down. A light ends where the way down to the end of the step
 * and the path back up attenuate it by more than `most` halvings in the brightest channel. */
INLINE void add_light(const struct lanes *p, const struct step *s, const struct entry *e, float most, struct beam *b, const int layers)
{
    const struct layered_layer *layer = p->m->layer, *last = &layer[layers - 1];
    const int mapped_above = p->mapped < layers ? p->mapped : layers - 1;
    vf reach, cosine, km_slope, rate, strength, start[3], other[FAST] = { { 0 } }, over = { 0 };

    for (int c = 0; c < 3; c++)
        start[c] = s->plane_distance * last->sigma_t2[c];
    if (p->pack && layers > 1)
        look_up(p->m, p->pack, p->lookup, p->lane, mapped_above, p->u + e->km * dot3(p->gu, e->dir), p->v + e->km * dot3(p->gv, e->dir),
                other);
#pragma GCC unroll 4
    for (int j = 0; j + 1 < layers; j++) {
        over = vmax(p->pack && j < p->mapped ? other[j] : splat(layer[j].depth), over);
        reach = vmin(s->plane_distance, 0.5f * (over + s->bottom[j]));
        for (int c = 0; c < 3; c++)
            start[c] += reach * (layer[j].sigma_t2[c] - layer[j + 1].sigma_t2[c]);
    }
    km_slope = s->slope * e->inv_cosine;
    rate = 1.0f + km_slope;
    for (int c = 0; c < 3; c++)
        start[c] = p->tau[c] + start[c] * e->inv_cosine - km_slope * s->half[c];
    strength = (vf) ((vi) (e->strength * p->alive) & b->lit);
    cosine = -dot3(e->dir, p->dir);
#pragma GCC unroll 4
    for (int j = 0; j < layers; j++) {
        if (s->listed & 1u << j) {
            const vf depth = rate * s->length[j], fraction = strength * s->length[j];
            const bool thick = any(depth * layer[j].max_tau2 > 2.0f * THICK);
            vf phase = phase_value(&layer[j].phase[0], cosine);
            for (int c = 0; c < 3; c++) {
                const vf y = depth * (0.5f * layer[j].sigma_t2[c]);
                if (c > 0 && !layer[j].one_phase)
                    phase = phase_value(&layer[j].phase[c], cosine);
                b->light[c] += fraction * phase * (layer[j].sigma_s[c] * mean_transmittance(start[c] + y, y, thick));
                start[c] += 2.0f * y;
            }
        }
    }
    b->lit &= ~(vmin(vmin(start[0], start[1]), start[2]) > most);
}

INLINE void fast_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                       const struct layered_light *sources, int count, int lane, const int layers)
{
    const struct layered_layer *layer = m->layer;
    const int n = work->samples;
    const float *edges = m->edges[0];
    const vf length = load(p->length + lane), rate = load(p->rate + lane), inv_rate = 1.0f / rate;
    const vf inv_length = 1.0f / vmax(length, splat(1e-20f)), full_depth = rate * length;
    vf at[3], normal[3], normal_change[3], lag[3], u = { 0 }, v = { 0 }, du = { 0 }, dv = { 0 };
    vf h = load(p->h + lane), gain = load(p->gain + lane);
    struct lanes k = { .m = m, .pack = m->packs > 0 ? &m->pack[0] : NULL, .lookup = p->lookup, .lane = lane, .alive = splat(1.0f) };
    struct beam beams[LAYERED_GROUP];
    struct entry entries[LAYERED_GROUP];
    struct step s;

    load3(p->p, lane, at);
    load3(p->w, lane, k.dir);
    load3(p->n, lane, normal);
    load3(p->s, lane, normal_change);
    for (int i = 0; i < 3; i++) {
        normal_change[i] -= normal[i];
        lag[i] = (h * normal[i]) * inv_length - k.dir[i]; /* from M toward the plane's point, divided by x */
    }
    if (k.pack) {
        k.mapped = k.pack->count;
        u = load(p->lookup->u[0] + lane);
        v = load(p->lookup->v[0] + lane);
        du = load(p->lookup->du[0] + lane);
        dv = load(p->lookup->dv[0] + lane);
    }
    load3(p->lookup->gu, lane, k.gu);
    load3(p->lookup->gv, lane, k.gv);
    for (int l = 0; l < count; l++)
        start_light(&sources[l], lane, at, &beams[l]);
    for (int j = 0; j < layers; j++)
        s.bottom[j] = vmax(splat(layer[j].depth), j > 0 ? s.bottom[j > 0 ? j - 1 : 0] : splat(0.0f));

    for (int i = 0; i < n; i++) {
        const float t = 0.5f * (edges[i] + edges[i + 1]);
        const vf x = length * t;
        vf plane[3], m_at[3], inv_norm;
        vi lit = { 0 };

        for (int a = 0; a < 3; a++) {
            plane[a] = normal[a] + t * normal_change[a];
            m_at[a] = at[a] + x * k.dir[a];
        }
        inv_norm = inverse_root(vmax(dot3(plane, plane), splat(1e-12f)));
        s.slope = vabs(dot3(lag, plane)) * inv_norm;
        for (int a = 0; a < 3; a++)
            plane[a] *= inv_norm;
        s.plane_distance = s.slope * x;
        for (int l = 0; l < count; l++)
            enter(&sources[l], lane, m->eta, m_at, plane, s.plane_distance, &beams[l], &entries[l]);
        s.low = full_depth * edges[i];
        s.middle = x * rate;
        s.high = full_depth * edges[i + 1];
        k.u = u + x * du;
        k.v = v + x * dv;
        find_layers(&k, inv_rate, &s, layers);
        if (p->trace && count > 0 && s.listed)
            store(p->trace + (ptrdiff_t) i * LANES + lane, entries[0].km);
        for (int l = 0; l < count && s.listed; l++)
            add_light(&k, &s, &entries[l], work->max_tau2, &beams[l], layers);
        for (int c = 0; c < 3; c++)
            k.tau[c] += s.tau[c];
        k.alive = (vf) ((vi) k.alive & ~(s.high - s.above > 1e-3f * (s.high - s.low)));
        for (int l = 0; l < count; l++)
            lit |= beams[l].lit;
        if (!any((k.alive > 0.0f) & lit))
            break;
    }
    for (int c = 0; c < 3; c++) {
        vf light = { 0 };
        for (int l = 0; l < count; l++)
            light += load(sources[l].power[c] + lane) * beams[l].light[c];
        light *= gain;
        store(p->light[c] + lane, load(p->light[c] + lane) + select((light >= 0.0f) & (light < 1e30f), light, splat(0.0f)));
    }
}

bool PELL_SIMD(layered_march_fast)(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                                   const struct layered_light *sources, int count)
{
    if (!is_fast(work, m, p, sources, count))
        return false;
    for (int lane = 0; lane < p->count; lane += WIDTH)
        switch (m->count) {
        case 1: fast_lanes(work, m, p, sources, count, lane, 1); break;
        case 2: fast_lanes(work, m, p, sources, count, lane, 2); break;
        case 3: fast_lanes(work, m, p, sources, count, lane, 3); break;
        default: fast_lanes(work, m, p, sources, count, lane, 4); break;
        }
    return true;
}
