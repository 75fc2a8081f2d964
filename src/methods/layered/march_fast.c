/* SPDX-License-Identifier: MIT
 *
 * march_fast.c - the march of layered below most packets of most pictures; compiled once per level of base/simd.h.
 *
 * It does what march.c does, for light by planes alone, of thick solids, refracted, integrated exactly, through a few layers that one
 * picture paints. Sums over layers are by the differences of neighbours:
 *
 *     Sum sigma_j |reach in j| = reach sigma_n + Sum (sigma_j - sigma_(j+1)) min(reach, bottom_j)
 *
 * `layers` is a constant wherever this is compiled.
 */
#include "methods/layered/march.h"

#define FAST 4 /* layers, at most */

INLINE bool is_fast(const struct layered_work *work, const struct layered_medium *m, const struct layered_packet *p,
                    const struct layered_light *sources, int count)
{
    bool usual = work->exponential && work->refracts && work->rest && !p->thin && !p->shows_bottom && m->count <= FAST && m->packs <= 1 &&
                 m->colors == 0;

    for (int l = 0; l < count; l++)
        usual = usual && !sources[l].any_nodes;
    for (int i = 0; usual && m->packs > 0 && i < m->pack[0].count; i++)
        usual = m->pack[0].layer[i] == i;
    return usual;
}

/* A light as the march goes on: the way to it from where its light came in last. */
struct beam {
    vf to[3], square;  /* mm; away: unit */
    vf seen, light[3]; /* of an irradiance of 1 */
    vi goes_on;        /* enough of it is left */
};

/* Where light comes in, and how it goes on from there. */
struct entry {
    vf km, per, strength, way[3];
};

INLINE void enter(const struct layered_light *source, int lane, float eta, const vf at[3], const vf plane[3], vf down, struct beam *beam,
                  struct entry *entry)
{
    const vf unit = source->away ? all(1.0f) : inverse_root(greater(beam->square, all(1e-12f)));
    const float per = 1.0f / eta;
    vf cosine, co, ci, ss, sp, both, turn, top;

    cosine = dot3(plane, beam->to) * unit;
    co = between(cosine, 1e-4f, 1.0f);
    ci = greater((1.0f - per * per) + (per * per) * (co * co), all(1e-12f));
    entry->per = inverse_root(ci);
    ci *= entry->per;
    ss = co + eta * ci;
    sp = eta * co + ci;
    both = ss * sp;
    entry->per = lesser(entry->per, all(1.0f / LAYERED_GRAZING));
    entry->km = down * entry->per;
    turn = ci - cosine * per;
    for (int k = 0; k < 3; k++)
        entry->way[k] = beam->to[k] * (unit * per) + turn * plane[k];
    if (!source->away) {
        vf place[3];
        load3(source->to, lane, place);
        for (int k = 0; k < 3; k++)
            beam->to[k] = place[k] - (at[k] + entry->km * entry->way[k]);
        beam->square = greater(dot3(beam->to, beam->to), all(1e-6f));
    }
    top = (2.0f * eta) * (co * co) * (ss * ss + sp * sp) * beam->seen; /* (1 - R) co/ci */
    entry->strength = (vf) ((vi) (top / (both * both * beam->square)) & (cosine > 0.0f));
}

/* What a packet's lanes keep as the march goes on. */
struct lanes {
    const struct layered_medium *m;
    const struct layered_pack *pack; /* of the picture that paints the layers, or NULL */
    const struct layered_place *place;
    int lane, painted;
    vf way[3], gu[3], gv[3], u, v; /* of the camera's ray; the picture's gradients, and its place at M */
    vf tau[3], alive;
};

/* Layers in a step, and what all lights share there. */
struct step {
    vf low, middle, high;               /* depths below the own surface */
    vf slope, down;                     /* d|distance from the plane|/dx, and that distance */
    vf bottom[FAST], part[FAST], above; /* mm of the step in a layer; where the deepest ends in it */
    vf tau[3], half[3];                 /* of the camera's ray in the step, and in its first half */
    unsigned listed;                    /* layers that some lane is in */
};

INLINE void aim(const struct layered_light *source, int lane, const vf at[3], struct beam *b)
{
    load3(source->to, lane, b->to);
    b->seen = load(source->seen + lane);
    b->goes_on = (vi) all(0.0f) == 0;
    b->square = all(1.0f);
    for (int k = 0; k < 3; k++) {
        b->to[k] -= (vf) ((vi) at[k] & (source->away ? 0 : -1));
        b->light[k] = all(0.0f);
    }
    if (!source->away)
        b->square = dot3(b->to, b->to);
}

INLINE void find_layers(const struct lanes *p, vf per_rate, struct step *s, const int layers)
{
    const struct layered_layer *layer = p->m->layer;
    vf above_middle = s->low;

    s->above = s->low;
    s->listed = 0;
    if (p->pack) {
        vf over = { 0 }, numbers[4];
        look_up(p->m, p->pack, p->place, p->lane, p->painted, p->u, p->v, numbers);
#pragma GCC unroll 4
        for (int j = 0; j < layers; j++) {
            s->bottom[j] = greater(j < p->painted ? numbers[j] : all(layer[j].depth), over);
            over = s->bottom[j];
        }
    }
    for (int c = 0; c < 3; c++)
        s->tau[c] = s->half[c] = all(0.0f);
#pragma GCC unroll 4
    for (int j = 0; j < layers; j++) {
        const vf end = lesser(greater(s->bottom[j], s->low), s->high), end_middle = lesser(end, s->middle);
        s->part[j] = (end - s->above) * per_rate;
        if (any(s->part[j] > 0.0f)) {
            const vf before = (end_middle - above_middle) * per_rate;
            s->listed |= 1u << j;
            for (int c = 0; c < 3; c++) {
                s->tau[c] += s->part[j] * layer[j].halves[c];
                s->half[c] += before * layer[j].halves[c];
            }
        }
        s->above = end;
        above_middle = end_middle;
    }
}

/* A light's part of a step: each layer's, from the start down. It ends where its way down to the step's end and up again halves it more
 * than `most` times, in the channel that keeps most of it. */
INLINE void add_light(const struct lanes *p, const struct step *s, const struct entry *e, float most, struct beam *b, const int layers)
{
    const struct layered_layer *layer = p->m->layer, *last = &layer[layers - 1];
    const int painted_above = p->painted < layers ? p->painted : layers - 1;
    vf reach, cosine, faster, strength, start[3], other[FAST] = { { 0 } }, over = { 0 };

    for (int c = 0; c < 3; c++)
        start[c] = s->down * last->halves[c];
    if (p->pack && layers > 1)
        look_up(p->m, p->pack, p->place, p->lane, painted_above, p->u + e->km * dot3(p->gu, e->way), p->v + e->km * dot3(p->gv, e->way),
                other);
#pragma GCC unroll 4
    for (int j = 0; j + 1 < layers; j++) {
        over = greater(p->pack && j < p->painted ? other[j] : all(layer[j].depth), over);
        reach = lesser(s->down, 0.5f * (over + s->bottom[j]));
        for (int c = 0; c < 3; c++)
            start[c] += reach * (layer[j].halves[c] - layer[j + 1].halves[c]);
    }
    reach = s->slope * e->per;
    faster = 1.0f + reach;
    for (int c = 0; c < 3; c++)
        start[c] = p->tau[c] + start[c] * e->per - reach * s->half[c];
    strength = (vf) ((vi) (e->strength * p->alive) & b->goes_on);
    cosine = -dot3(e->way, p->way);
#pragma GCC unroll 4
    for (int j = 0; j < layers; j++) {
        if (s->listed & 1u << j) {
            const vf depth = faster * s->part[j], share = strength * s->part[j];
            const bool thick = any(depth * layer[j].most_halves > 2.0f * THICK);
            vf phase = phase_value(&layer[j].phase[0], cosine);
            for (int c = 0; c < 3; c++) {
                const vf y = depth * (0.5f * layer[j].halves[c]);
                if (c > 0 && !layer[j].one_phase)
                    phase = phase_value(&layer[j].phase[c], cosine);
                b->light[c] += share * phase * (layer[j].sigma_s[c] * mean_light(start[c] + y, y, thick));
                start[c] += 2.0f * y;
            }
        }
    }
    b->goes_on &= ~(lesser(lesser(start[0], start[1]), start[2]) > most);
}

INLINE void fast_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                       const struct layered_light *sources, int count, int lane, const int layers)
{
    const struct layered_layer *layer = m->layer;
    const int n = work->samples;
    const float *edges = m->edges[0];
    const vf length = load(p->length + lane), rate = load(p->rate + lane), per_rate = 1.0f / rate;
    const vf per_length = 1.0f / greater(length, all(1e-20f)), rise = rate * length;
    vf at[3], normal[3], turn[3], lag[3], u = { 0 }, v = { 0 }, du = { 0 }, dv = { 0 };
    vf h = load(p->h + lane), gain = load(p->gain + lane);
    struct lanes k = { .m = m, .pack = m->packs > 0 ? &m->pack[0] : NULL, .place = p->place, .lane = lane, .alive = all(1.0f) };
    struct beam beams[LAYERED_GROUP];
    struct entry entries[LAYERED_GROUP];
    struct step s;

    load3(p->p, lane, at);
    load3(p->w, lane, k.way);
    load3(p->n, lane, normal);
    load3(p->s, lane, turn);
    for (int i = 0; i < 3; i++) {
        turn[i] -= normal[i];
        lag[i] = (h * normal[i]) * per_length - k.way[i]; /* from M to the plane's point, over x */
    }
    if (k.pack) {
        k.painted = k.pack->count;
        u = load(p->place->u[0] + lane);
        v = load(p->place->v[0] + lane);
        du = load(p->place->du[0] + lane);
        dv = load(p->place->dv[0] + lane);
    }
    load3(p->place->gu, lane, k.gu);
    load3(p->place->gv, lane, k.gv);
    for (int l = 0; l < count; l++)
        aim(&sources[l], lane, at, &beams[l]);
    for (int j = 0; j < layers; j++)
        s.bottom[j] = greater(all(layer[j].depth), j > 0 ? s.bottom[j > 0 ? j - 1 : 0] : all(0.0f));

    for (int i = 0; i < n; i++) {
        const float t = 0.5f * (edges[i] + edges[i + 1]);
        const vf x = length * t;
        vf plane[3], m_at[3], unit;
        vi goes_on = { 0 };

        for (int a = 0; a < 3; a++) {
            plane[a] = normal[a] + t * turn[a];
            m_at[a] = at[a] + x * k.way[a];
        }
        unit = inverse_root(greater(dot3(plane, plane), all(1e-12f)));
        s.slope = magnitude(dot3(lag, plane)) * unit;
        for (int a = 0; a < 3; a++)
            plane[a] *= unit;
        s.down = s.slope * x;
        for (int l = 0; l < count; l++)
            enter(&sources[l], lane, m->eta, m_at, plane, s.down, &beams[l], &entries[l]);
        s.low = rise * edges[i];
        s.middle = x * rate;
        s.high = rise * edges[i + 1];
        k.u = u + x * du;
        k.v = v + x * dv;
        find_layers(&k, per_rate, &s, layers);
        if (p->trace && count > 0 && s.listed)
            store(p->trace + (ptrdiff_t) i * LANES + lane, entries[0].km);
        for (int l = 0; l < count && s.listed; l++)
            add_light(&k, &s, &entries[l], work->most_halves, &beams[l], layers);
        for (int c = 0; c < 3; c++)
            k.tau[c] += s.tau[c];
        k.alive = (vf) ((vi) k.alive & ~(s.high - s.above > 1e-3f * (s.high - s.low)));
        for (int l = 0; l < count; l++)
            goes_on |= beams[l].goes_on;
        if (!any((k.alive > 0.0f) & goes_on))
            break;
    }
    for (int c = 0; c < 3; c++) {
        vf light = { 0 };
        for (int l = 0; l < count; l++)
            light += load(sources[l].power[c] + lane) * beams[l].light[c];
        light *= gain;
        store(p->light[c] + lane, load(p->light[c] + lane) + select((light >= 0.0f) & (light < 1e30f), light, all(0.0f)));
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
