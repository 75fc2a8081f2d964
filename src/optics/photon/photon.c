/* SPDX-License-Identifier: MIT
 *
 * photon.c - photon random walks. Weights and roulette as in Wang, Jacques and Zheng, "MCML", Computer Methods and Programs in Biomedicine
 * 47 (1995); Henyey and Greenstein, Astrophysical Journal 93 (1941). */
#include "optics/photon/photon.h"

#include <pellucid/medium.h>

#include "math/vec.h"

#include <math.h>
#include <string.h>

#define WEIGHT_MIN 1e-4     /* below it, photons in absorbing layers are subject to Russian roulette, */
#define WEIGHT_SURVIVAL 0.1 /* which they survive with this probability */
#define ROULETTE_GROWTH 4

/* --- Random numbers ----------------------------------------------------------------------------------------------------------- */

struct stream {
    uint64_t s[4];
};

static uint64_t splitmix(uint64_t *x)
{
    uint64_t z = *x += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static inline struct stream stream_of(uint64_t seed, uint64_t index)
{
    struct stream r;
    uint64_t x = seed, y;
    y = splitmix(&x) ^ index;
    y = splitmix(&y) + index;
    for (int i = 0; i < 4; i++)
        r.s[i] = splitmix(&y);
    return r;
}

static inline uint64_t next(struct stream *r)
{
    uint64_t *s = r->s;
    const uint64_t result = s[0] + s[3], t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = s[3] << 45 | s[3] >> 19;
    return result;
}

/* (0, 1): the centre of one of 2^52 cells, so neither end occurs. */
static inline double uniform(struct stream *r)
{
    return ((double) (next(r) >> 12) + 0.5) * 0x1p-52;
}

/* -log(u), the same bits on every machine: u = 2^e m with m in [sqrt(1/2), sqrt(2)), log m = 2 artanh((m - 1)/(m + 1)). Its error is
 * below 1e-13. */
static inline double free_flight(struct stream *r)
{
    const double u = uniform(r);
    uint64_t bits;
    double m;
    memcpy(&bits, &u, sizeof(bits));
    const uint64_t below = (0x3fe6a09e667f3bcdu + 0xfffffffffffffu - bits) >> 52; /* octaves from u up to [sqrt(1/2), sqrt(2)) */
    bits += below << 52;
    memcpy(&m, &bits, sizeof(m));
    const double t = (m - 1.0) / (m + 1.0), t2 = t * t;
    const double p =
        1.0 + t2 * (1.0 / 3.0 +
                    t2 * (1.0 / 5.0 + t2 * (1.0 / 7.0 + t2 * (1.0 / 9.0 + t2 * (1.0 / 11.0 + t2 * (1.0 / 13.0 + t2 * (1.0 / 15.0)))))));
    return (double) below * 0.69314718055994530942 - 2.0 * t * p;
}

/* --- One random walk ---------------------------------------------------------------------------------------------------------- */

struct photon {
    double x, y, z;
    double u, v, w; /* direction; w > 0 goes down */
};

/* Rotates the direction by the angle with this cosine about a uniform azimuth. The azimuth is that of a point drawn in the unit disc,
 * doubled, which needs no trigonometry (von Neumann 1951). */
static inline void rotate(struct stream *r, struct photon *p, double cosine)
{
    double a, b, s;
    do {
        const uint64_t bits = next(r);
        a = (double) (int32_t) (bits >> 32) * 0x1p-31;
        b = (double) (int32_t) (uint32_t) bits * 0x1p-31;
        s = a * a + b * b;
    } while (s > 1.0 || s == 0.0);
    const double k = sqrt(fmax(0.0, 1.0 - cosine * cosine)) / s;
    const double cx = (a * a - b * b) * k, cy = 2.0 * a * b * k;

    /* An orthonormal basis about the direction (Duff et al. 2017, "Building an Orthonormal Basis, Revisited"). */
    const double sign = copysign(1.0, p->w), q = -1.0 / (sign + p->w), m = p->u * p->v * q;
    const double u = p->u * cosine + (1.0 + sign * p->u * p->u * q) * cx + m * cy;
    const double v = p->v * cosine + sign * m * cx + (sign + p->v * p->v * q) * cy;
    const double w = p->w * cosine - sign * p->u * cx - p->v * cy;
    /* One step of Newton's method for 1/sqrt keeps the length at 1 over any number of rotations. */
    const double n = 1.5 - 0.5 * (u * u + v * v + w * w);
    p->u = u * n;
    p->v = v * n;
    p->w = w * n;
}

/* Draws a direction uniformly over the sphere. */
static inline void scatter_uniform(struct stream *r, struct photon *p)
{
    double a, b, s;
    do { /* Marsaglia 1972, "Choosing a Point from the Surface of a Sphere" */
        const uint64_t bits = next(r);
        a = (double) (int32_t) (bits >> 32) * 0x1p-31;
        b = (double) (int32_t) (uint32_t) bits * 0x1p-31;
        s = a * a + b * b;
    } while (s >= 1.0);
    const double k = 2.0 * sqrt(1.0 - s);
    p->u = a * k;
    p->v = b * k;
    p->w = 1.0 - 2.0 * s;
}

static inline void scatter(struct stream *r, struct photon *p, double g)
{
    if (g == 0.0) {
        scatter_uniform(r, p);
        return;
    }
    const double xi = 2.0 * uniform(r) - 1.0;
    double cosine;
    if (fabs(g) < 1e-3) { /* the closed form cancels: two terms of its series in g are used */
        cosine = xi + 1.5 * g * (1.0 - xi * xi);
    } else {
        const double q = (1.0 - g * g) / (1.0 + g * xi);
        cosine = (1.0 + g * g - q * q) / (2.0 * g);
    }
    rotate(r, p, fmin(fmax(cosine, -1.0), 1.0));
}

/* Whether the photon crosses a boundary into an index n2; its direction is then refracted, else reflected. */
static inline bool cross_boundary(struct stream *r, struct photon *p, double n1, double n2)
{
    if (n1 == n2)
        return true;
    const double ratio = n1 / n2, mu = fabs(p->w), sin2 = ratio * ratio * (1.0 - mu * mu);
    if (sin2 >= 1.0 || uniform(r) < pell_fresnel(n2 / n1, mu)) {
        p->w = -p->w;
        return false;
    }
    p->u *= ratio;
    p->v *= ratio;
    p->w = copysign(sqrt(1.0 - sin2), p->w);
    return true;
}

struct slice { /* a layer as the random walk needs it */
    double top, bottom, sigma_t, inverse, albedo, g, n;
};

/* Traces one photon from the upper face; true if it exits, with *e filled except for the index. */
static bool walk(const struct pell_photon_stack *s, const struct slice *slices, struct stream *r, pell_photon_callback touch, void *user,
                 struct pell_photon_exit *e, struct pell_photon_sums *sums)
{
    struct photon p = { 0 };
    double weight = 1.0;
    int layer = 0, n = 0, next_roulette = s->roulette > 0 ? s->roulette : PELL_PHOTON_COLLISIONS_MAX + 1;
    uint64_t crossings = 0;

    e->face = 0;
    /* The flux of equal radiance over cosines is uniform in mu^2. */
    const double a = s->mu_min * s->mu_min, b = s->mu_max * s->mu_max;
    p.w = a < b ? sqrt(a + (b - a) * uniform(r)) : s->mu_max;
    p.u = sqrt(fmax(0.0, 1.0 - p.w * p.w));
    if (s->inside) {
        const double ratio = s->n_above / slices[0].n, sin2 = fmin(ratio * ratio * (1.0 - p.w * p.w), 1.0);
        p.u = sqrt(sin2);
        p.w = sqrt(1.0 - sin2);
    } else if (!cross_boundary(r, &p, s->n_above, slices[0].n)) {
        e->collisions = 0;
        e->radius = 0.0;
        e->mu = -p.w;
        e->weight = 1.0;
        return true;
    }

    for (;;) {
        double depth = free_flight(r); /* remaining optical depth of this flight */
        for (;;) {                     /* layers crossed by this flight */
            const struct slice *l = &slices[layer];
            const double face = p.w < 0.0 ? l->top : l->bottom;
            const double step = depth * l->inverse; /* infinite in a layer without collisions */
            const double z = p.z + p.w * step;
            if (p.w < 0.0 ? z > l->top : z < l->bottom) {
                p.x += p.u * step;
                p.y += p.v * step;
                p.z = z;
                break;
            }
            /* A flight parallel to a clear layer never ends; nor does one that is reflected for ever. */
            const double length = (face - p.z) / p.w;
            if (!(length >= 0.0 && length < HUGE_VAL) || ++crossings > 64u * PELL_PHOTON_COLLISIONS_MAX) {
                sums->lost += weight;
                return false;
            }
            p.x += p.u * length;
            p.y += p.v * length;
            p.z = face;
            depth = fmax(0.0, depth - length * l->sigma_t);
            const bool up = p.w < 0.0, out = up ? layer == 0 : layer == s->count - 1;
            const double beyond = up ? (out ? s->n_above : slices[layer - 1].n) : (out ? s->n_below : slices[layer + 1].n);
            if (out) {
                e->face = up ? 0 : 1;
                e->collisions = n;
                e->radius = sqrt(p.x * p.x + p.y * p.y);
                e->mu = fabs(p.w);
                e->weight = weight;
                if (touch)
                    touch(user, e);
            }
            if (cross_boundary(r, &p, l->n, beyond)) {
                if (out) {
                    e->mu = fabs(p.w);
                    return true;
                }
                layer += up ? -1 : 1;
            }
        }

        const struct slice *l = &slices[layer];
        n++;
        sums->collisions++;
        if (l->albedo < 1.0) {
            sums->absorbed[layer] += weight * (1.0 - l->albedo);
            weight *= l->albedo;
            if (weight < WEIGHT_MIN) {
                if (weight == 0.0)
                    return false;
                if (uniform(r) >= WEIGHT_SURVIVAL) {
                    sums->absorbed[layer] += weight; /* compensates Russian roulette: see below */
                    return false;
                }
                sums->absorbed[layer] -= weight * (1.0 / WEIGHT_SURVIVAL - 1.0);
                weight *= 1.0 / WEIGHT_SURVIVAL;
            }
        }
        if (n >= next_roulette) {
            next_roulette = next_roulette > PELL_PHOTON_COLLISIONS_MAX / ROULETTE_GROWTH ? PELL_PHOTON_COLLISIONS_MAX + 1
                                                                                         : ROULETTE_GROWTH * next_roulette;
            if (uniform(r) < 0.5)
                return false;
            weight *= 2.0;
        }
        if (n >= s->collisions_max) {
            sums->lost += weight;
            return false;
        }
        scatter(r, &p, l->g);
    }
}

/* --- Many walks --------------------------------------------------------------------------------------------------------------- */

const char *pell_photon_fault(const struct pell_photon_stack *s)
{
    static const char *const names[PELL_PHOTON_LAYERS][5] = {
#define FIELDS(i) { "layer[" #i "].sigma_a", "layer[" #i "].sigma_s", "layer[" #i "].g", "layer[" #i "].n", "layer[" #i "].thickness" }
        FIELDS(0), FIELDS(1), FIELDS(2), FIELDS(3), FIELDS(4), FIELDS(5), FIELDS(6), FIELDS(7),
#undef FIELDS
    };
    if (s->count < 1 || s->count > PELL_PHOTON_LAYERS)
        return "count";
    for (int i = 0; i < s->count; i++) {
        const struct pell_photon_layer *l = &s->layer[i];
        const bool endless = i == s->count - 1 && l->thickness == HUGE_VAL;
        if (!(l->sigma_a >= 0.0 && l->sigma_a <= PELL_SIGMA_MAX))
            return names[i][0];
        if (!(l->sigma_s >= 0.0 && l->sigma_s <= PELL_SIGMA_MAX / (1.0 - PELL_G_MAX)))
            return names[i][1];
        if (!(fabs(l->g) <= PELL_G_MAX))
            return names[i][2];
        if (!(l->n >= PELL_ETA_MIN && l->n <= PELL_ETA_MAX))
            return names[i][3];
        if (!endless && !(l->thickness > 0.0 && l->thickness <= 1e12))
            return names[i][4];
        if (endless && !(l->sigma_a + l->sigma_s >= PELL_SIGMA_T_MIN))
            return names[i][1];
    }
    if (!(s->n_above >= PELL_ETA_MIN && s->n_above <= PELL_ETA_MAX))
        return "n_above";
    if (!(s->n_below >= PELL_ETA_MIN && s->n_below <= PELL_ETA_MAX))
        return "n_below";
    if (!(s->mu_max > 0.0 && s->mu_max <= 1.0))
        return "mu_max";
    if (!(s->mu_min >= 0.0 && s->mu_min <= s->mu_max))
        return "mu_min";
    if (s->roulette < 0 || s->roulette > PELL_PHOTON_COLLISIONS_MAX)
        return "roulette";
    if (s->collisions_max < 1 || s->collisions_max > PELL_PHOTON_COLLISIONS_MAX)
        return "collisions_max";
    return NULL;
}

void pell_photon_walk(const struct pell_photon_stack *stack, uint64_t seed, uint64_t first, uint64_t count, pell_photon_callback leave,
                      pell_photon_callback touch, void *user, struct pell_photon_sums *sums)
{
    struct slice slices[PELL_PHOTON_LAYERS];
    double depth = 0.0;

    for (int i = 0; i < stack->count; i++) {
        const struct pell_photon_layer *l = &stack->layer[i];
        const double sigma_t = l->sigma_a + l->sigma_s;
        slices[i] =
            (struct slice) { depth, depth + l->thickness, sigma_t, 1.0 / sigma_t, sigma_t > 0.0 ? l->sigma_s / sigma_t : 1.0, l->g, l->n };
        depth += l->thickness;
    }
    for (uint64_t i = first; i < first + count; i++) {
        struct stream r = stream_of(seed, i);
        struct pell_photon_exit e = { .index = i };
        if (walk(stack, slices, &r, touch, user, &e, sums) && leave)
            leave(user, &e);
    }
}
