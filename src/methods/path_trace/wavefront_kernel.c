/* SPDX-License-Identifier: MIT
 * wavefront_kernel.c - see wavefront_kernel.h; compiled once per level of base/simd.h. */
#include "methods/path_trace/wavefront_kernel.h"

#include "math/lanes.h"
#include "shared/phase.h"

#define REAL vf
#define INT vi
#define FN(name) lanes_##name
#define PICK(c, a, b) select((c), (a), (b))
#define ALL(x) splat(x)
#define ROOT(x) vsqrt(x)
#define AS_REAL(i) __builtin_convertvector(i, vf)
#define AS_INT(x) __builtin_convertvector(x, vi)
#define BITS(x) ((vi) (x))
#define OF_BITS(i) ((vf) (i))
#include "methods/path_trace/functions.inc"

typedef uint64_t vq __attribute__((vector_size(4 * WIDTH))); /* half of the lanes */
typedef uint32_t vh __attribute__((vector_size(2 * WIDTH)));

#define GOLDEN 0x9e3779b97f4a7c15u
#define EACH(l) for (int l = 0; l < PT_LANES; l += WIDTH) /* the first lane of each vector */

INLINE vi load_int(const void *p)
{
    vi v;
    memcpy(&v, p, sizeof(v));
    return v;
}

INLINE void store_int(void *p, vi v)
{
    memcpy(p, &v, sizeof(v));
}

/* Converts bit sets to lane masks, and back. */
INLINE vi mask_of(uint32_t set, int l)
{
    static const int32_t bit[16] = { 1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768 };

    return (((vi) { 0 } + (int32_t) (set >> l)) & load_int(bit)) != 0;
}

INLINE uint32_t set_of(vi mask, int l)
{
    return movemask(mask) << l;
}

INLINE void put(float *p, vi mask, vf v)
{
    store(p, select(mask, v, load(p)));
}

/* --- Random numbers --------------------------------------------------------------------------------------------------------------- */

INLINE vq mix(vq z)
{
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

INLINE vi upper(const vq half[2])
{
    const vh a = __builtin_convertvector(half[0] >> 32, vh), b = __builtin_convertvector(half[1] >> 32, vh);
    vi v;

    memcpy(&v, &a, sizeof(a));
    memcpy((char *) &v + sizeof(a), &b, sizeof(b));
    return v;
}

INLINE vq half_bits(void)
{
    static const uint64_t bit[8] = { 1, 2, 4, 8, 16, 32, 64, 128 };
    vq v;

    memcpy(&v, bit, sizeof(v));
    return v;
}

/* The next random bits of some lanes, excluding those that still use quasi-random numbers: returns their set. */
INLINE uint32_t draw(struct pt_wavefront_lanes *w, uint32_t set, int32_t *bits, float *quasi)
{
    uint32_t early = 0;

    EACH(l)
    early |= set_of(load_int(w->at + l) < PT_QUASI_RANDOM_NUMBERS, l);
    early &= set;
    EACH(l)
    {
        vq half[2];
        for (int k = 0; k < 2; k++) {
            uint64_t *state = w->state + l + k * (WIDTH / 2);
            const vq on = (vq) ((((vq) { 0 } + ((set & ~early) >> (l + k * (WIDTH / 2)))) & half_bits()) != 0);
            vq s;
            memcpy(&s, state, sizeof(s));
            s += on & GOLDEN;
            memcpy(state, &s, sizeof(s));
            half[k] = mix(s);
        }
        store_int(bits + l, upper(half));
    }
    for (uint32_t left = early; left; left &= left - 1) {
        const int l = __builtin_ctz(left);
        quasi[l] = pt_quasi_random(w->sampler[l]);
        w->at[l] = w->sampler[l]->at;
    }
    return early;
}

/* In [0, 1), as pt_random. */
INLINE void uniform(struct pt_wavefront_lanes *w, uint32_t set, float *out)
{
    _Alignas(64) int32_t bits[PT_LANES];
    _Alignas(64) float quasi[PT_LANES] = { 0 };
    const uint32_t early = draw(w, set, bits, quasi);

    EACH(l)
    {
        const vf late = __builtin_convertvector(load_int(bits + l) >> 8 & 0xffffff, vf) * (1.0f / 16777216.0f);
        store(out + l, early ? select(mask_of(early, l), load(quasi + l), late) : late);
    }
}

INLINE vf chance_of(vi bits)
{
    return (__builtin_convertvector(bits >> 1 & 0x7fffffff, vf) + 0.5f) * 0x1p-31f;
}

/* In (0, 1], as pt_chance. */
INLINE void chance(struct pt_wavefront_lanes *w, uint32_t set, float *out)
{
    _Alignas(64) int32_t bits[PT_LANES];
    _Alignas(64) float quasi[PT_LANES] = { 0 };
    const uint32_t early = draw(w, set, bits, quasi);

    EACH(l)
    {
        const vf late = chance_of(load_int(bits + l));
        store(out + l, early ? select(mask_of(early, l), 1.0f - load(quasi + l), late) : late);
    }
}

/* The component of `of` for the channel chosen as by pt_sample_channel; and the channel itself, unless `channel` is NULL. */
INLINE void choose(const struct pt_wavefront_lanes *w, const float *u, const float of[3], float *out, int32_t *channel)
{
    EACH(l)
    {
        const vf b0 = load(w->beta[0] + l), b1 = load(w->beta[1] + l), b2 = load(w->beta[2] + l), t = load(u + l) * (b0 + b1 + b2);
        const vi second = t >= b0, third = second & (t - b0 >= b1), two = third & (b2 > 0.0f), one = second & ~two & (b1 > 0.0f);
        store(out + l, select(two, splat(of[2]), select(one, splat(of[1]), splat(of[0]))));
        if (channel)
            store_int(channel + l, (two & 2) | (one & 1));
    }
}

/* --- Distances -------------------------------------------------------------------------------------------------------------------- */

/* Like pell_distance_bound; 0 for inactive lanes. */
INLINE void bound(const struct pell_distance_grid *g, const struct pt_wavefront_lanes *w, uint32_t set, float *out)
{
    _Alignas(64) int32_t cube[PT_LANES];
    _Alignas(64) float offset2[PT_LANES], steps[PT_LANES];

    EACH(l)
    {
        vi inside = mask_of(set, l), at[3];
        vf off[3];
        for (int k = 0; k < 3; k++)
            inside &= (load(w->x[k] + l) >= g->low[k]) & (load(w->x[k] + l) <= g->high[k]);
        for (int k = 0; k < 3; k++) {
            const vf x = select(inside, load(w->x[k] + l), splat(g->low[k]));
            const vi i = __builtin_convertvector((x - g->low[k]) * g->inverse_side, vi), last = (vi) { 0 } + (g->size[k] - 1);
            at[k] = (i & (i < last)) | (last & ~(i < last));
            off[k] = x - (g->low[k] + (__builtin_convertvector(at[k], vf) + 0.5f) * g->side);
        }
        store_int(cube + l, ((at[2] * g->size[1] + at[1]) * g->size[0] + at[0]) & inside);
        store(offset2 + l, off[0] * off[0] + off[1] * off[1] + off[2] * off[2]);
        set &= set_of(inside, l) | ~(((1u << WIDTH) - 1u) << l);
    }
    for (int l = 0; l < PT_LANES; l++)
        steps[l] = (float) g->steps[cube[l]];
    EACH(l)
    {
        const vf known = load(steps + l) * g->unit, offset = vsqrt(load(offset2 + l)), b = known - (offset + 5e-7f * (known + offset));
        store(out + l, select(mask_of(set, l) & (b > 0.0f), b, splat(0.0f)));
    }
}

/* --- Steps ------------------------------------------------------------------------------------------------------------------------- */

static uint32_t sample_distance(struct pt_wavefront_lanes *w, const struct pt_wavefront_solid *p, uint32_t on, uint32_t *cut)
{
    const struct pt_coefficients *m = p->m;
    _Alignas(64) float u[PT_LANES], mean_free_path[PT_LANES], grid_bound[PT_LANES];
    uint32_t beyond_safe = 0, rays = 0;

    *cut = 0;
    EACH(l)
    {
        const vi events = load_int(w->events + l);
        *cut |= set_of(events >= p->events, l) & on;
        store_int(w->events + l, events - mask_of(on, l));
    }
    on &= ~*cut;
    if (m->gray) {
        EACH(l)
        {
            store(mean_free_path + l, splat(m->mean_free_path[0]));
            store_int(w->channel + l, (vi) { 0 });
        }
    } else {
        uniform(w, on, u);
        choose(w, u, m->mean_free_path, mean_free_path, w->channel);
    }
    chance(w, on, u);
    EACH(l)
    {
        const vf length = -lanes_log(load(u + l)) * load(mean_free_path + l), safe = load(w->safe + l);
        const vi free = length < safe, mask = mask_of(on, l);
        store(w->length + l, length);
        for (int c = 0; c < 3; c++)
            store(w->inverse_stay[c] + l, splat(1.0f));
        put(w->safe + l, mask & free, safe - length);
        beyond_safe |= set_of(mask & ~free, l);
    }
    if (!beyond_safe)
        return 0;
    if (p->grid)
        bound(p->grid, w, beyond_safe, grid_bound);
    EACH(l)
    {
        const vf safe = p->grid ? load(grid_bound + l) - load(w->length + l) : splat(0.0f);
        const vi mask = mask_of(beyond_safe, l), free = safe > 0.0f;
        store(w->bound + l, p->grid ? vmax(load(grid_bound + l), load(w->safe + l)) : load(w->safe + l));
        put(w->safe + l, mask, select(free, safe, splat(0.0f)));
        rays |= set_of(mask & ~free, l);
    }
    return rays;
}

/* Lanes selected for next-event estimation, as in pt_should_connect. */
static uint32_t select_connections(struct pt_wavefront_lanes *w, const struct pt_wavefront_solid *p, uint32_t on)
{
    _Alignas(64) float reach[PT_LANES], near[PT_LANES];
    uint32_t connecting = 0, selected = 0;

    EACH(l)
    {
        vq half[2];
        for (int k = 0; k < 2; k++) {
            vq s, at;
            vh narrow;
            memcpy(&narrow, w->at + l + k * (WIDTH / 2), sizeof(narrow));
            at = __builtin_convertvector(narrow, vq);
            memcpy(&s, w->state + l + k * (WIDTH / 2), sizeof(s));
            half[k] = mix(mix(s ^ PT_NEE_SALT ^ at << 56) + GOLDEN);
        }
        store(reach + l, -lanes_log(chance_of(upper(half))) * p->connect_mm);
        connecting |= set_of(load(reach + l) > load(w->safe + l), l);
    }
    connecting &= on;
    if (!connecting)
        return 0;
    if (p->grid) {
        bound(p->grid, w, connecting, near);
        EACH(l)
        {
            put(w->safe + l, mask_of(connecting, l), vmax(load(near + l), load(w->safe + l)));
            connecting &= set_of(load(reach + l) > load(near + l), l) | ~(((1u << WIDTH) - 1u) << l);
        }
    }
    EACH(l)
    {
        const vf selection = load(w->selection + l) + select(load_int(w->scattered + l) <= 1, splat(1.0f), splat(p->fraction));
        const vi mask = mask_of(connecting, l), has = selection >= 1.0f;
        put(w->selection + l, mask, select(has, selection - 1.0f, selection));
        selected |= set_of(mask & has, l);
    }
    return selected;
}

static uint32_t collide(struct pt_wavefront_lanes *w, const struct pt_wavefront_solid *p, uint32_t on, uint32_t *lost, uint32_t *gone)
{
    const struct pt_coefficients *m = p->m;

    *lost = *gone = 0;
    EACH(l)
    {
        const vf length = load(w->length + l);
        vi mask = mask_of(on, l), out = ~(length < 1e30f);
        vf to[3], beta[3], t[3], sum;
        for (int k = 0; k < 3; k++) {
            to[k] = load(w->x[k] + l) + length * load(w->w[k] + l);
            out |= (to[k] < p->lo[k]) | (to[k] > p->hi[k]);
        }
        *lost |= set_of(out & mask, l);
        mask &= ~out;
        for (int k = 0; k < 3; k++) {
            put(w->x[k] + l, mask, to[k]);
            beta[k] = load(w->beta[k] + l);
        }
        if (m->gray) {
            for (int c = 0; c < 3; c++)
                beta[c] *= m->sigma_s[c] / m->sigma_t[c] / load(w->inverse_stay[c] + l);
        } else {
            vf density = splat(0.0f), scale;
            sum = beta[0] + beta[1] + beta[2];
            for (int c = 0; c < 3; c++) {
                t[c] = lanes_exp(-m->sigma_t[c] * length);
                density += beta[c] * m->sigma_t[c] * t[c] * load(w->inverse_stay[c] + l);
            }
            scale = sum / density;
            for (int c = 0; c < 3; c++)
                beta[c] = select(density > 0.0f, beta[c] * m->sigma_s[c] * t[c] * scale, splat(0.0f));
        }
        for (int c = 0; c < 3; c++)
            put(w->beta[c] + l, mask, beta[c]);
        store_int(w->scattered + l, load_int(w->scattered + l) - mask);
        *gone |= set_of(mask & ~(beta[0] + beta[1] + beta[2] > 0.0f), l);
    }
    on &= ~(*lost | *gone);
    return p->connects && on ? select_connections(w, p, on) : 0;
}

static uint32_t scatter(struct pt_wavefront_lanes *w, const struct pt_wavefront_solid *p, uint32_t on)
{
    const struct pt_coefficients *m = p->m;
    _Alignas(64) float u[PT_LANES], v[PT_LANES], g[PT_LANES] = { 0 };
    uint32_t low = 0, dead = 0;

    if (!m->alike) {
        uniform(w, on, u);
        choose(w, u, m->g, g, NULL);
    }
    uniform(w, on, u);
    uniform(w, on, v);
    EACH(l)
    {
        const vi mask = mask_of(on, l);
        vf from[3], to[3], beta[3], now;
        for (int k = 0; k < 3; k++) {
            from[k] = load(w->w[k] + l);
            beta[k] = load(w->beta[k] + l);
            put(w->incident[k] + l, mask, from[k]);
            put(w->collision_beta[k] + l, mask, beta[k]);
        }
        if (m->isotropic)
            lanes_uniform_sphere(load(u + l), load(v + l), to);
        else
            lanes_rotate(from, lanes_hg_cosine(m->alike ? splat(m->g[0]) : load(g + l), load(u + l)), load(v + l), to);
        for (int k = 0; k < 3; k++)
            put(w->w[k] + l, mask, to[k]);
        if (!m->alike) {
            const vf cosine = from[0] * to[0] + from[1] * to[1] + from[2] * to[2];
            vf value[3], density, scale;
            for (int c = 0; c < 3; c++)
                value[c] = lanes_hg(m->g[c], cosine);
            density = beta[0] * value[0] + beta[1] * value[1] + beta[2] * value[2];
            scale = (beta[0] + beta[1] + beta[2]) / density;
            for (int c = 0; c < 3; c++) {
                beta[c] = select(density > 0.0f, beta[c] * (value[c] * scale), beta[c]);
                put(w->beta[c] + l, mask, beta[c]);
            }
        }
        now = (beta[0] + beta[1] + beta[2]) * (1.0f / 3.0f);
        store(v + l, now);
        dead |= set_of(mask & ~(now > 0.0f), l);
        low |= set_of(mask & (now > 0.0f) & (now < p->roulette), l);
    }
    if (!low)
        return dead;
    uniform(w, low, u);
    EACH(l)
    {
        const vf now = load(v + l), scale = p->roulette / now;
        const vi mask = mask_of(low, l), terminated = load(u + l) * p->roulette >= now;
        for (int c = 0; c < 3; c++)
            put(w->beta[c] + l, mask & ~terminated, load(w->beta[c] + l) * scale);
        dead |= set_of(mask & terminated, l);
    }
    return dead;
}

extern const struct pt_wavefront_kernels PELL_SIMD(pt_wavefront_kernels);
const struct pt_wavefront_kernels
    PELL_SIMD(pt_wavefront_kernels) = { .sample_distance = sample_distance, .collide = collide, .scatter = scatter };
