/* SPDX-License-Identifier: MIT
 *
 * beside.c - see beside.h. Places stand for squares that are as wide as a few free paths. Of a face on the other side of an edge a place
 * has as much as chance has put places of it close to the edge. What it has of an even face is known: that face ends in the plane of the
 * place's own, where both meet. The integrals over it, weighted by (1 - r^2/reach^2)^2, are what the sums over its places, weighted so,
 * are scaled to.
 */
#include "render/indirect/beside.h"

#include "math/scalar.h"
#include "math/vec.h"

#include <string.h>

enum { ANGLES = 6, RADII = 8, POINTS = ANGLES * RADII };
_Static_assert((int) POINTS <= (int) EQUATION_BLOCK, "one block");
#define FLAT 0.95f      /* least cosine of normals on a face, */
#define EVEN 0.3f       /* and distance from its plane, in those of places */
#define LOWEST 0.02f    /* the same of the place from that plane: as a point on it, it has no light from the face */
#define LOW 1.5f        /* distances of places: nearer, a face is not seen as points, */
#define HIGH 2.5f       /* and from which on it is */
#define COVER_LOW 0.45f /* of the face by its places: below it ends elsewhere, too, */
#define COVER_FULL 0.7f
#define COVER_MOST 1.4f /* and above it is more than one */
#define COVER_HIGH 1.8f
#define LARGEST 4.0f   /* factor */
#define OPPOSITE 0.05f /* sine of the angle between planes that meet nowhere near */

/* Patches of one face, in the means by their weights. */
struct face {
    struct pell_vec3 normal;
    float above;   /* of the place over its plane; below it as a rule: < 0 */
    float outward; /* how far they are on the outer side of the place's own plane */
    float area, wx, wy, wz;
    float bend[3], deep[3][2];
};

/* Points over a face, as patches. */
struct points {
    float x[POINTS], y[POINTS], z[POINTS], nx[POINTS], ny[POINTS], nz[POINTS], area[POINTS], wx[POINTS], wy[POINTS], wz[POINTS];
    float left[POINTS], bend[POINTS], deep[2][POINTS];
};

/* What the sums over patches, or points, are. */
struct sums {
    float even, pull[3], along[3], below[3];
};

static struct pell_vec3 at_of(const struct equation_patches *p, uint32_t i)
{
    return vec3(p->x[i], p->y[i], p->z[i]);
}

static struct pell_vec3 normal_of(const struct equation_patches *p, uint32_t i)
{
    return vec3(p->nx[i], p->ny[i], p->nz[i]);
}

/* Puts the patches of the face of the heaviest first; returns how many they are. */
static uint32_t take_face(const struct equation *e, struct beside_patch *b, uint32_t count)
{
    const struct equation_patches *p = &e->patches;
    struct pell_vec3 normal, at;
    uint32_t first = 0, n = 0;

    for (uint32_t i = 1; i < count; i++)
        if (b[i].weight > b[first].weight)
            first = i;
    normal = normal_of(p, b[first].patch);
    at = at_of(p, b[first].patch);
    for (uint32_t i = 0; i < count; i++) {
        const float off = vec3_dot(vec3_sub(at_of(p, b[i].patch), at), normal);
        const struct beside_patch swap = b[i];
        if (i != first && !(vec3_dot(normal_of(p, swap.patch), normal) > FLAT && fabsf(off) < EVEN * e->places->step))
            continue;
        b[i] = b[n];
        b[n++] = swap;
    }
    return n;
}

static void find_face(const struct equation *e, const struct place *x, const struct beside_patch *b, uint32_t count, struct face *f)
{
    const struct equation_patches *p = &e->patches;
    struct pell_vec3 middle = vec3(0.0f, 0.0f, 0.0f);
    float scale;

    memset(f, 0, sizeof(*f));
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t k = b[i].patch;
        const float w = b[i].weight * p->area[k];
        f->area += w;
        f->normal = vec3_mad(f->normal, w, normal_of(p, k));
        middle = vec3_mad(middle, w, at_of(p, k));
        f->wx += w * p->wx[k];
        f->wy += w * p->wy[k];
        f->wz += w * p->wz[k];
        for (int c = 0; c < 3; c++)
            if (e->channel[c].is) {
                f->bend[c] += w * e->channel[c].bend[k];
                f->deep[c][0] += w * e->channel[c].deep[0][k];
                f->deep[c][1] += w * e->channel[c].deep[1][k];
            }
    }
    scale = f->area > 0.0f ? 1.0f / f->area : 0.0f;
    f->normal = vec3_normalize(f->normal);
    middle = vec3_sub(vec3_mul(middle, scale), x->position);
    f->above = -vec3_dot(middle, f->normal);
    f->outward = vec3_dot(middle, x->normal);
    f->wx *= scale;
    f->wy *= scale;
    f->wz *= scale;
    for (int c = 0; c < 3; c++) {
        f->bend[c] *= scale;
        f->deep[c][0] *= scale;
        f->deep[c][1] *= scale;
    }
}

/* The part of a ray over the face, from the foot of the place, at this cosine of its angle to the way into the face. */
static bool part_of_ray(float begins, float most, float cosine, float *from, float *to)
{
    *from = 0.0f;
    *to = most;
    if (cosine > 1e-4f)
        *from = fmaxf(begins / cosine, 0.0f);
    else if (cosine < -1e-4f)
        *to = fminf(fmaxf(begins / cosine, 0.0f), most);
    else if (begins > 0.0f)
        return false;
    return *from < *to;
}

/* Where a face is, as the place sees it. */
struct view {
    struct pell_vec3 foot, into, across; /* of the place on its plane; the way into it, from where the planes meet, and along there: unit */
    float height, most;                  /* of the place, and the farthest of the face from the foot inside the reach */
    float begins;                        /* where the planes meet, along the way into the face: < 0 behind the foot */
};

static void find_view(const struct equation *e, const struct place *x, const struct face *f, struct view *v)
{
    const float reach = BESIDE_REACH * e->places->step, least = LOWEST * e->places->step;
    const float above = f->above < 0.0f ? fminf(f->above, -least) : fmaxf(f->above, least);
    const float cosine = vec3_dot(x->normal, f->normal), sine = sqrtf(fmaxf(1.0f - cosine * cosine, 0.0f));
    const float side = f->outward > 0.0f ? 1.0f : -1.0f;

    v->height = fabsf(above);
    v->most = sqrtf(fmaxf(reach * reach - v->height * v->height, 0.0f));
    v->foot = vec3_mad(x->position, -above, f->normal);
    if (sine > OPPOSITE) {
        v->begins = fminf(fmaxf(side * above * cosine / sine, -v->most), v->most);
        v->into = vec3_mul(vec3_mad(x->normal, -cosine, f->normal), side / sine);
        v->across = vec3_cross(f->normal, v->into);
    } else {
        v->begins = -v->most;
        vec3_basis(f->normal, &v->into, &v->across);
    }
}

/* Area of the face inside the reach, weighted, but for the fraction that is beyond where the planes meet, of (1 - u^2)^2 in place of
 * (1 - u^2)^2.5. */
static float area_of(const struct view *v, float reach)
{
    const float t = v->most > 0.0f ? 0.5f - 0.5f * v->begins / v->most : 0.0f, h = v->most / reach, h2 = h * h;

    return PELL_PI_F / 3.0f * reach * reach * h2 * h2 * h2 * t * t * t * (10.0f - t * (15.0f - 6.0f * t));
}

/* Points of the face inside the reach, denser toward the place. */
static uint32_t spread_points(const struct view *v, const struct face *f, float reach, struct points *p)
{
    const float wide = v->begins < 0.0f ? PELL_PI_F : acosf(v->begins / v->most);
    uint32_t n = 0;

    for (int i = 0; i < ANGLES; i++) {
        const float angle = wide * (2.0f * ((float) i + 0.5f) / ANGLES - 1.0f);
        const struct pell_vec3 way = vec3_mad(vec3_mul(v->into, cosf(angle)), sinf(angle), v->across);
        float from, to, first, last, inner;
        if (!part_of_ray(v->begins, v->most, cosf(angle), &from, &to))
            continue;
        first = asinhf(from / v->height);
        last = asinhf(to / v->height);
        inner = from;
        for (int k = 0; k < RADII; k++, n++) {
            const float outer = v->height * sinhf(first + (last - first) * (float) (k + 1) / RADII);
            const float r = v->height * sinhf(first + (last - first) * ((float) k + 0.5f) / RADII);
            const struct pell_vec3 at = vec3_mad(v->foot, r, way);
            const float t = fmaxf(1.0f - (r * r + v->height * v->height) / (reach * reach), 0.0f);
            p->x[n] = at.x;
            p->y[n] = at.y;
            p->z[n] = at.z;
            p->nx[n] = f->normal.x;
            p->ny[n] = f->normal.y;
            p->nz[n] = f->normal.z;
            p->wx[n] = f->wx;
            p->wy[n] = f->wy;
            p->wz[n] = f->wz;
            p->area[n] = t * t * wide / ANGLES * (outer * outer - inner * inner);
            inner = outer;
        }
    }
    return n;
}

/* The integrals over the face. */
static void sum_points(const struct equation *e, const struct place *x, const struct face *f, struct points *p, uint32_t count,
                       struct sums *sum)
{
    const struct equation_patches patches = { p->x, p->y, p->z, p->nx, p->ny, p->nz, p->area, p->wx, p->wy, p->wz };
    const struct equation_from from = { x->position.x, x->position.y, x->position.z, x->normal.x, x->normal.y, x->normal.z, 0.0f, 0.0f };
    struct equation_block b;

    memset(sum, 0, sizeof(*sum));
    e->kernels->measure(&patches, 0, count, &from, &b);
    for (uint32_t i = 0; i < count; i++)
        sum->even += b.even[i];
    for (int c = 0; c < 3; c++) {
        const struct equation_channel *q = &e->channel[c];
        const struct equation_law law = {
            q->kappa, 1.0f / q->s, p->bend, { p->deep[0], p->deep[1] }, { q->share[0], q->share[1] }, { q->blur2[0], q->blur2[1] }
        };
        if (!q->is)
            continue;
        for (uint32_t i = 0; i < count; i++) {
            p->bend[i] = f->bend[c];
            p->deep[0][i] = f->deep[c][0];
            p->deep[1][i] = f->deep[c][1];
        }
        e->kernels->entries(&law, 0, count, &b, p->left);
        for (uint32_t i = 0; i < count; i++) {
            sum->pull[c] += b.pull[i];
            sum->along[c] += p->left[i] - b.pull[i] * law.inverse_s;
            sum->below[c] += b.below[i];
        }
    }
}

/* The same by patches. */
static void sum_patches(const struct equation *e, const struct beside_patch *b, uint32_t count, struct sums *sum)
{
    memset(sum, 0, sizeof(*sum));
    for (uint32_t i = 0; i < count; i++) {
        const float w = b[i].weight;
        sum->even += w * b[i].even;
        for (int c = 0; c < 3; c++) {
            const struct equation_channel *q = &e->channel[c];
            if (!q->is)
                continue;
            sum->pull[c] += w * b[i].pull[c];
            sum->along[c] += w * (q->left[b[i].entry] - b[i].pull[c] / q->s);
            sum->below[c] += w * b[i].below[c];
        }
    }
}

/* What is to be added to what has the weight 1, over that. */
static float more(float right, float is, float amount)
{
    return is * right > 0.0f ? amount * (fminf(right / is, LARGEST) - 1.0f) : 0.0f;
}

static void set_right(struct equation *e, const struct place *x, struct beside_patch *b, uint32_t count, float *even, double right[3])
{
    const float step = e->places->step;
    struct points points;
    struct sums exact, is;
    struct face face;
    struct view view;
    uint32_t n;
    float amount, area;

    find_face(e, x, b, count, &face);
    amount = 1.0f - ramp(LOW, HIGH, fabsf(face.above) / step);
    if (!(amount > 0.0f))
        return;
    find_view(e, x, &face, &view);
    area = area_of(&view, BESIDE_REACH * step);
    if (!(area > 0.0f))
        return;
    amount *= ramp(COVER_LOW, COVER_FULL, face.area / area) * (1.0f - ramp(COVER_MOST, COVER_HIGH, face.area / area));
    if (!(amount > 0.0f))
        return;
    n = spread_points(&view, &face, BESIDE_REACH * step, &points);
    sum_points(e, x, &face, &points, n, &exact);
    sum_patches(e, b, count, &is);
    *even += more(exact.even, is.even, amount) * is.even;
    for (int c = 0; c < 3; c++) {
        struct equation_channel *q = &e->channel[c];
        const float pull = more(exact.pull[c], is.pull[c], amount), along = more(exact.along[c], is.along[c], amount);
        const float below = more(exact.below[c], is.below[c], amount);
        if (!q->is)
            continue;
        for (uint32_t i = 0; i < count; i++) {
            const float pulled = b[i].pull[c] / q->s, w = b[i].weight;
            float *left = &q->left[b[i].entry];
            right[c] += (double) (w * below * b[i].below[c]) * q->source[b[i].patch];
            *left += w * (pull * pulled + along * (*left - pulled));
        }
    }
}

void equation_beside(struct equation *e, uint32_t row, struct beside *b, float *even, double right[3])
{
    if (b->count == BESIDE_MOST) /* not all of them */
        return;
    for (uint32_t first = 0, count; first < b->count; first += count) {
        count = take_face(e, b->patch + first, b->count - first);
        set_right(e, &e->places->place[row], b->patch + first, count, even, right);
    }
}
