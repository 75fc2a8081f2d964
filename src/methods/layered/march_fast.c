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
    bool usual = work->exponential && work->refracts && work->rest && !p->thin && !p->shows_bottom && m->count <= FAST && m->packs <= 1;

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

INLINE void fast_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                       const struct layered_light *sources, int count, int lane, const int layers)
{
    const struct layered_pack *pack = m->packs > 0 ? &m->pack[0] : NULL;
    const struct layered_place *place = p->place;
    const int n = work->samples, painted = pack ? pack->count : 0, painted_above = painted < layers ? painted : layers - 1;
    const struct layered_layer *layer = m->layer, *last = &layer[layers - 1];
    const vf length = load(p->length + lane), rate = load(p->rate + lane), per_rate = 1.0f / rate;
    const vf per_length = 1.0f / greater(length, all(1e-20f)), rise = rate * length * (1.0f / (float) n);
    vf at[3], way[3], normal[3], turn[3], lag[3], gu[3], gv[3], u = { 0 }, v = { 0 }, du = { 0 }, dv = { 0 };
    vf tau[3] = { { 0 } }, alive = all(1.0f), h = load(p->h + lane), gain = load(p->gain + lane);
    vf bottom[FAST], part[FAST];
    struct beam beams[LAYERED_GROUP];
    struct entry entries[LAYERED_GROUP];

    load3(p->p, lane, at);
    load3(p->w, lane, way);
    load3(p->n, lane, normal);
    load3(p->s, lane, turn);
    for (int k = 0; k < 3; k++) {
        turn[k] -= normal[k];
        lag[k] = (h * normal[k]) * per_length - way[k]; /* from M to the plane's point, over x */
    }
    if (pack) {
        u = load(place->u[0] + lane);
        v = load(place->v[0] + lane);
        du = load(place->du[0] + lane);
        dv = load(place->dv[0] + lane);
    }
    load3(place->gu, lane, gu);
    load3(place->gv, lane, gv);
    for (int l = 0; l < count; l++) {
        struct beam *b = &beams[l];
        load3(sources[l].to, lane, b->to);
        b->seen = load(sources[l].seen + lane);
        b->square = all(1.0f);
        for (int k = 0; k < 3; k++) {
            b->to[k] -= (vf) ((vi) at[k] & (sources[l].away ? 0 : -1));
            b->light[k] = all(0.0f);
        }
        if (!sources[l].away)
            b->square = dot3(b->to, b->to);
    }
    for (int j = 0; j < layers; j++)
        bottom[j] = greater(all(layer[j].depth), j > 0 ? bottom[j > 0 ? j - 1 : 0] : all(0.0f));

    for (int i = 0; i < n; i++) {
        const float t = ((float) i + 0.5f) / (float) n;
        const vf x = length * t, low = rise * (float) i, middle = x * rate, high = rise * (float) (i + 1);
        vf plane[3], m_at[3], numbers[4], slope, unit, down, above = low, above_middle = low, step_tau[3], half[3];
        unsigned listed = 0;

        for (int k = 0; k < 3; k++) {
            plane[k] = normal[k] + t * turn[k];
            m_at[k] = at[k] + x * way[k];
        }
        unit = inverse_root(greater(dot3(plane, plane), all(1e-12f)));
        slope = magnitude(dot3(lag, plane)) * unit;
        for (int k = 0; k < 3; k++)
            plane[k] *= unit;
        down = slope * x;
        for (int l = 0; l < count; l++)
            enter(&sources[l], lane, m->eta, m_at, plane, down, &beams[l], &entries[l]);
        if (pack) {
            vf over = { 0 };
            look_up(m, pack, place, lane, painted, u + x * du, v + x * dv, numbers);
#pragma GCC unroll 4
            for (int j = 0; j < layers; j++) {
                bottom[j] = greater(j < painted ? numbers[j] : all(layer[j].depth), over);
                over = bottom[j];
            }
        }
        for (int c = 0; c < 3; c++)
            step_tau[c] = half[c] = all(0.0f);
#pragma GCC unroll 4
        for (int j = 0; j < layers; j++) {
            const vf end = lesser(greater(bottom[j], low), high), end_middle = lesser(end, middle);
            part[j] = (end - above) * per_rate;
            if (any(part[j] > 0.0f)) {
                const vf before = (end_middle - above_middle) * per_rate;
                listed |= 1u << j;
                for (int c = 0; c < 3; c++) {
                    step_tau[c] += part[j] * layer[j].halves[c];
                    half[c] += before * layer[j].halves[c];
                }
            }
            above = end;
            above_middle = end_middle;
        }
        for (int l = 0; l < count && listed; l++) {
            struct beam *b = &beams[l];
            vf reach, cosine, faster, start[3], other[FAST] = { { 0 } }, over = { 0 };
            struct entry e = entries[l];

            if (p->trace && l == 0)
                store(p->trace + (ptrdiff_t) i * LANES + lane, e.km);
            for (int c = 0; c < 3; c++)
                start[c] = down * last->halves[c];
            if (pack && layers > 1)
                look_up(m, pack, place, lane, painted_above, u + x * du + e.km * dot3(gu, e.way), v + x * dv + e.km * dot3(gv, e.way),
                        other);
#pragma GCC unroll 4
            for (int j = 0; j + 1 < layers; j++) {
                over = greater(pack && j < painted ? other[j] : all(layer[j].depth), over);
                reach = lesser(down, 0.5f * (over + bottom[j]));
                for (int c = 0; c < 3; c++)
                    start[c] += reach * (layer[j].halves[c] - layer[j + 1].halves[c]);
            }
            reach = slope * e.per;
            faster = 1.0f + reach;
            for (int c = 0; c < 3; c++)
                start[c] = tau[c] + start[c] * e.per - reach * half[c];
            e.strength *= alive;
            cosine = -dot3(e.way, way);
#pragma GCC unroll 4
            for (int j = 0; j < layers; j++) {
                if (listed & 1u << j) {
                    const vf depth = faster * part[j], share = e.strength * part[j];
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
        }
        for (int c = 0; c < 3; c++)
            tau[c] += step_tau[c];
        alive = (vf) ((vi) alive & ~(high - above > 1e-3f * rise));
        if (!any(alive > 0.0f))
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
