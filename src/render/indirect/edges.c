/* SPDX-License-Identifier: MIT
 *
 * edges.c - see edges.h. Points represent squares that are as wide as a few mean free paths, so how many points of an adjacent face are
 * close to the edge is a matter of chance. The integrals over a flat face are known: the face ends where its plane intersects the point's
 * own plane. The sums over the sampled elements, weighted by (1 - r^2/reach^2)^2, are scaled to the integrals over the face with the same
 * weight.
 */
#include "render/indirect/edges.h"

#include "math/scalar.h"
#include "math/vec.h"

#include <string.h>

enum { ANGLES = 6, RADII = 8, POINTS = ANGLES * RADII };
_Static_assert((int) POINTS <= (int) EQUATION_BLOCK, "one block");
#define MIN_FACING 0.95f /* least cosine between the normals of one face, */
#define MAX_OFFSET 0.3f  /* and largest distance from its plane, in steps */
#define MIN_HEIGHT 0.02f /* least height of the point over that plane, in steps: on the plane it would get no light from the face */
#define NEAR 1.5f        /* steps: height below which the elements of a face are too coarse, */
#define FAR 2.5f         /* and from which they are fine enough */
#define COVER_LOW 0.45f  /* area of the elements over that of the face: below these the face ends elsewhere, too, */
#define COVER_FULL 0.7f
#define COVER_MOST 1.4f /* and above these there is more than one face */
#define COVER_HIGH 1.8f
#define MAX_FACTOR 4.0f /* largest factor */
#define PARALLEL 0.05f  /* sine of the angle between planes that count as parallel */

/* Elements of one face, as weighted means. */
struct face {
    struct pell_vec3 normal;
    float height;  /* height of the point over the plane of the face; negative as a rule */
    float outward; /* mean height of the elements over the point's own plane */
    float area, wx, wy, wz;
    float curvature_factor[3], source_depth[3][2];
};

/* Quadrature points on a face, in the form of elements. */
struct points {
    float x[POINTS], y[POINTS], z[POINTS], nx[POINTS], ny[POINTS], nz[POINTS], area[POINTS], wx[POINTS], wy[POINTS], wz[POINTS];
    float matrix[POINTS], curvature_factor[POINTS], source_depth[2][POINTS];
};

/* Sums over elements or quadrature points. */
struct sums {
    float double_layer0, single_layer[3], double_layer[3], from_sources[3];
};

static struct pell_vec3 position_of(const struct equation_patches *p, uint32_t i)
{
    return vec3(p->x[i], p->y[i], p->z[i]);
}

static struct pell_vec3 normal_of(const struct equation_patches *p, uint32_t i)
{
    return vec3(p->nx[i], p->ny[i], p->nz[i]);
}

/* Moves the elements on the same face as the one with the largest weight to the front. Returns their count. */
static uint32_t gather_face(const struct equation *e, struct edge_element *b, uint32_t count)
{
    const struct equation_patches *p = &e->patches;
    struct pell_vec3 normal, at;
    uint32_t first = 0, n = 0;

    for (uint32_t i = 1; i < count; i++)
        if (b[i].weight > b[first].weight)
            first = i;
    normal = normal_of(p, b[first].element);
    at = position_of(p, b[first].element);
    for (uint32_t i = 0; i < count; i++) {
        const float off = vec3_dot(vec3_sub(position_of(p, b[i].element), at), normal);
        const struct edge_element swap = b[i];
        if (i != first && !(vec3_dot(normal_of(p, swap.element), normal) > MIN_FACING && fabsf(off) < MAX_OFFSET * e->points->step))
            continue;
        b[i] = b[n];
        b[n++] = swap;
    }
    return n;
}

static void find_face(const struct equation *e, const struct collocation_point *x, const struct edge_element *b, uint32_t count,
                      struct face *f)
{
    const struct equation_patches *p = &e->patches;
    struct pell_vec3 middle = vec3(0.0f, 0.0f, 0.0f);
    float scale;

    memset(f, 0, sizeof(*f));
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t k = b[i].element;
        const float w = b[i].weight * p->area[k];
        f->area += w;
        f->normal = vec3_mad(f->normal, w, normal_of(p, k));
        middle = vec3_mad(middle, w, position_of(p, k));
        f->wx += w * p->wx[k];
        f->wy += w * p->wy[k];
        f->wz += w * p->wz[k];
        for (int c = 0; c < 3; c++)
            if (e->channel[c].active) {
                f->curvature_factor[c] += w * e->channel[c].curvature_factor[k];
                f->source_depth[c][0] += w * e->channel[c].source_depth[0][k];
                f->source_depth[c][1] += w * e->channel[c].source_depth[1][k];
            }
    }
    scale = f->area > 0.0f ? 1.0f / f->area : 0.0f;
    f->normal = vec3_normalize(f->normal);
    middle = vec3_sub(vec3_mul(middle, scale), x->position);
    f->height = -vec3_dot(middle, f->normal);
    f->outward = vec3_dot(middle, x->normal);
    f->wx *= scale;
    f->wy *= scale;
    f->wz *= scale;
    for (int c = 0; c < 3; c++) {
        f->curvature_factor[c] *= scale;
        f->source_depth[c][0] *= scale;
        f->source_depth[c][1] *= scale;
    }
}

/* Clips a ray in the plane of the face to the face: from the point's foot, at this cosine of its angle to the direction into the face. */
static bool clip_ray(float begin, float radius, float cosine, float *from, float *to)
{
    *from = 0.0f;
    *to = radius;
    if (cosine > 1e-4f)
        *from = fmaxf(begin / cosine, 0.0f);
    else if (cosine < -1e-4f)
        *to = fminf(fmaxf(begin / cosine, 0.0f), radius);
    else if (begin > 0.0f)
        return false;
    return *from < *to;
}

/* Position of a face relative to the point. */
struct view {
    struct pell_vec3 foot, into, across; /* foot of the point on the plane; unit vectors from the intersection of the planes into the
                                          * face, and along that line */
    float height, radius;                /* height of the point, and the largest distance of the face from the foot inside the reach */
    float begin;                         /* position of the planes' intersection along `into`: < 0 if it is behind the foot */
};

static void find_view(const struct equation *e, const struct collocation_point *x, const struct face *f, struct view *v)
{
    const float reach = EDGE_REACH * e->points->step, least = MIN_HEIGHT * e->points->step;
    const float height = f->height < 0.0f ? fminf(f->height, -least) : fmaxf(f->height, least);
    const float cosine = vec3_dot(x->normal, f->normal), sine = sqrtf(fmaxf(1.0f - cosine * cosine, 0.0f));
    const float side = f->outward > 0.0f ? 1.0f : -1.0f;

    v->height = fabsf(height);
    v->radius = sqrtf(fmaxf(reach * reach - v->height * v->height, 0.0f));
    v->foot = vec3_mad(x->position, -height, f->normal);
    if (sine > PARALLEL) {
        v->begin = fminf(fmaxf(side * height * cosine / sine, -v->radius), v->radius);
        v->into = vec3_mul(vec3_mad(x->normal, -cosine, f->normal), side / sine);
        v->across = vec3_cross(f->normal, v->into);
    } else {
        v->begin = -v->radius;
        vec3_basis(f->normal, &v->into, &v->across);
    }
}

/* Weighted area of the face inside the reach. The fraction beyond the planes' intersection is exact for the weight (1 - u^2)^2.5, close
 * to the (1 - u^2)^2 that is used. */
static float face_area(const struct view *v, float reach)
{
    const float t = v->radius > 0.0f ? 0.5f - 0.5f * v->begin / v->radius : 0.0f, h = v->radius / reach, h2 = h * h;

    return PELL_PI_F / 3.0f * reach * reach * h2 * h2 * h2 * t * t * t * (10.0f - t * (15.0f - 6.0f * t));
}

/* Places quadrature points on the face inside the reach, denser toward the point. */
static uint32_t place_points(const struct view *v, const struct face *f, float reach, struct points *p)
{
    const float half_angle = v->begin < 0.0f ? PELL_PI_F : acosf(v->begin / v->radius);
    uint32_t n = 0;

    for (int i = 0; i < ANGLES; i++) {
        const float angle = half_angle * (2.0f * ((float) i + 0.5f) / ANGLES - 1.0f);
        const struct pell_vec3 direction = vec3_mad(vec3_mul(v->into, cosf(angle)), sinf(angle), v->across);
        float from, to, first, last, inner;
        if (!clip_ray(v->begin, v->radius, cosf(angle), &from, &to))
            continue;
        first = asinhf(from / v->height);
        last = asinhf(to / v->height);
        inner = from;
        for (int k = 0; k < RADII; k++, n++) {
            const float outer = v->height * sinhf(first + (last - first) * (float) (k + 1) / RADII);
            const float r = v->height * sinhf(first + (last - first) * ((float) k + 0.5f) / RADII);
            const struct pell_vec3 at = vec3_mad(v->foot, r, direction);
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
            p->area[n] = t * t * half_angle / ANGLES * (outer * outer - inner * inner);
            inner = outer;
        }
    }
    return n;
}

/* Integrates over the face. */
static void sum_points(const struct equation *e, const struct collocation_point *x, const struct face *f, struct points *p, uint32_t count,
                       struct sums *sum)
{
    const struct equation_patches patches = { p->x, p->y, p->z, p->nx, p->ny, p->nz, p->area, p->wx, p->wy, p->wz };
    const struct equation_receiver from = {
        x->position.x, x->position.y, x->position.z, x->normal.x, x->normal.y, x->normal.z, 0.0f, 0.0f
    };
    struct equation_block b;

    memset(sum, 0, sizeof(*sum));
    e->kernels->measure(&patches, 0, count, &from, &b);
    for (uint32_t i = 0; i < count; i++)
        sum->double_layer0 += b.double_layer0[i];
    for (int c = 0; c < 3; c++) {
        const struct equation_channel *q = &e->channel[c];
        const struct equation_kernel_params params = { q->kappa,
                                                       1.0f / q->s,
                                                       p->curvature_factor,
                                                       { p->source_depth[0], p->source_depth[1] },
                                                       { q->path_weight[0], q->path_weight[1] },
                                                       { q->blur2[0], q->blur2[1] } };
        if (!q->active)
            continue;
        for (uint32_t i = 0; i < count; i++) {
            p->curvature_factor[i] = f->curvature_factor[c];
            p->source_depth[0][i] = f->source_depth[c][0];
            p->source_depth[1][i] = f->source_depth[c][1];
        }
        e->kernels->fill(&params, 0, count, &b, p->matrix);
        for (uint32_t i = 0; i < count; i++) {
            sum->single_layer[c] += b.single_layer[i];
            sum->double_layer[c] += p->matrix[i] - b.single_layer[i] * params.inverse_s;
            sum->from_sources[c] += b.from_sources[i];
        }
    }
}

/* Sums over the elements. */
static void sum_patches(const struct equation *e, const struct edge_element *b, uint32_t count, struct sums *sum)
{
    memset(sum, 0, sizeof(*sum));
    for (uint32_t i = 0; i < count; i++) {
        const float w = b[i].weight;
        sum->double_layer0 += w * b[i].double_layer0;
        for (int c = 0; c < 3; c++) {
            const struct equation_channel *q = &e->channel[c];
            if (!q->active)
                continue;
            sum->single_layer[c] += w * b[i].single_layer[c];
            sum->double_layer[c] += w * (q->matrix[b[i].entry] - b[i].single_layer[c] / q->s);
            sum->from_sources[c] += w * b[i].from_sources[c];
        }
    }
}

/* Relative correction of a sum: factor - 1, times `amount`. */
static float correction(float exact, float sampled, float amount)
{
    return sampled * exact > 0.0f ? amount * (fminf(exact / sampled, MAX_FACTOR) - 1.0f) : 0.0f;
}

static void correct_face(struct equation *e, const struct collocation_point *x, struct edge_element *b, uint32_t count,
                         float *double_layer0, double rhs[3])
{
    const float step = e->points->step;
    struct points points;
    struct sums exact, sampled;
    struct face face;
    struct view view;
    uint32_t n;
    float amount, area;

    find_face(e, x, b, count, &face);
    amount = 1.0f - ramp(NEAR, FAR, fabsf(face.height) / step);
    if (!(amount > 0.0f))
        return;
    find_view(e, x, &face, &view);
    area = face_area(&view, EDGE_REACH * step);
    if (!(area > 0.0f))
        return;
    amount *= ramp(COVER_LOW, COVER_FULL, face.area / area) * (1.0f - ramp(COVER_MOST, COVER_HIGH, face.area / area));
    if (!(amount > 0.0f))
        return;
    n = place_points(&view, &face, EDGE_REACH * step, &points);
    sum_points(e, x, &face, &points, n, &exact);
    sum_patches(e, b, count, &sampled);
    *double_layer0 += correction(exact.double_layer0, sampled.double_layer0, amount) * sampled.double_layer0;
    for (int c = 0; c < 3; c++) {
        struct equation_channel *q = &e->channel[c];
        const float single_layer = correction(exact.single_layer[c], sampled.single_layer[c], amount),
                    double_layer = correction(exact.double_layer[c], sampled.double_layer[c], amount);
        const float from_sources = correction(exact.from_sources[c], sampled.from_sources[c], amount);
        if (!q->active)
            continue;
        for (uint32_t i = 0; i < count; i++) {
            const float pulled = b[i].single_layer[c] / q->s, w = b[i].weight;
            float *matrix = &q->matrix[b[i].entry];
            rhs[c] += (double) (w * from_sources * b[i].from_sources[c]) * q->source[b[i].element];
            *matrix += w * (single_layer * pulled + double_layer * (*matrix - pulled));
        }
    }
}

void equation_correct_edges(struct equation *e, uint32_t row, struct edges *b, float *double_layer0, double rhs[3])
{
    if (b->count == EDGE_MOST) /* incomplete */
        return;
    for (uint32_t first = 0, count; first < b->count; first += count) {
        count = gather_face(e, b->elements + first, b->count - first);
        correct_face(e, &e->points->point[row], b->elements + first, count, double_layer0, rhs);
    }
}
