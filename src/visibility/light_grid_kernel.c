/* SPDX-License-Identifier: MIT
 *
 * light_grid_kernel.c - packet queries of a light grid; compiled once per SIMD level. All levels give the same bits.
 *
 * With d the vector from the apex to a point, the edge functions u = d . (a - b) x (a + b) etc. give the side of the point relative to the
 * planes through the apex and the triangle's sides (Pineda 1988, "A Parallel Algorithm for Polygon Rasterization"), and s = normal . (d -
 * a) its side of the triangle's plane. The triangle occludes the point if u, v, w >= 0 and s > 0: no division. Where s is small it is
 * computed from a difference of nearby points, so it does not suffer from cancellation. For the same reason d - a is computed in world
 * space: relative to an apex at 10 m all points are rounded to micrometres, more than the offset of a ray from its surface.
 */
#include "visibility/light_grid.h"

#include "math/lanes.h"

#define LANES 16
#define CELLS 16      /* per packet */
#define LISTED 64     /* triangles per batch */
#define NEAR 9999.0f  /* relative to a distance of 10000: beyond the part next to the apex that is ignored */
#define WHOLE 0.9999f /* the same relative to 1 */

struct packet_points {
    _Alignas(64) float d[3][LANES]; /* from the apex */
    const float *at[3];             /* in world space */
    int x0, x1, y0, y1;
    float near, depth; /* depth range of the points */
};

/* The cells that the packet covers. False: too many, or a point is not in front of the apex. */
INLINE bool locate(const struct pell_light_grid *f, const int32_t *restrict mask, const float *restrict x, const float *restrict y,
                   const float *restrict z, struct packet_points *restrict p)
{
    const float right = (float) (f->columns - 1), top = (float) (f->rows - 1);
    _Alignas(64) float depth[LANES];
    _Alignas(64) int32_t column[LANES], row[LANES];
    int x0 = INT32_MAX, x1 = 0, y0 = INT32_MAX, y1 = 0, behind = 0;
    int32_t nearest = INT32_MAX, farthest = 0;

    for (int i = 0; i < LANES; i++) {
        const float dx = x[i] - f->apex.x, dy = y[i] - f->apex.y, dz = z[i] - f->apex.z;
        const float t = dx * f->forward.x + dy * f->forward.y + dz * f->forward.z, inverse = 1.0f / (t > 0.0f ? t : 1.0f);
        const float a = ((dx * f->right.x + dy * f->right.y + dz * f->right.z) * inverse - f->left) * f->inv_x;
        const float b = ((dx * f->up.x + dy * f->up.y + dz * f->up.z) * inverse - f->low) * f->inv_y;
        const float a0 = a > 0.0f ? a : 0.0f, b0 = b > 0.0f ? b : 0.0f;
        p->d[0][i] = dx;
        p->d[1][i] = dy;
        p->d[2][i] = dz;
        depth[i] = t > 0.0f ? t : 0.0f;
        column[i] = (int32_t) (a0 < right ? a0 : right);
        row[i] = (int32_t) (b0 < top ? b0 : top);
        behind |= mask[i] & -(int32_t) !(t > 0.0f);
    }
    p->at[0] = x;
    p->at[1] = y;
    p->at[2] = z;
    for (int i = 0; i < LANES; i++) {
        const int32_t on = mask[i], cx = column[i], cy = row[i];
        int32_t bits;
        memcpy(&bits, &depth[i], sizeof(bits)); /* non-negative floats are ordered like their bits */
        bits &= on;
        x0 = (cx | (~on & INT32_MAX)) < x0 ? (cx | (~on & INT32_MAX)) : x0;
        y0 = (cy | (~on & INT32_MAX)) < y0 ? (cy | (~on & INT32_MAX)) : y0;
        x1 = (cx & on) > x1 ? cx & on : x1;
        y1 = (cy & on) > y1 ? cy & on : y1;
        farthest = bits > farthest ? bits : farthest;
        bits |= ~on & INT32_MAX;
        nearest = bits < nearest ? bits : nearest;
    }
    p->x0 = x0;
    p->x1 = x1;
    p->y0 = y0;
    p->y1 = y1;
    memcpy(&p->near, &nearest, sizeof(p->near));
    memcpy(&p->depth, &farthest, sizeof(p->depth));
    return !behind && x0 <= x1 && (x1 - x0 + 1) * (y1 - y0 + 1) <= CELLS;
}

/* s; `inside`: mask of the lanes whose rays pass through the triangle. */
INLINE vf edge_test(const struct pell_light_grid_triangle *t, const struct packet_points *p, int at, vi *inside)
{
    const vf x = load(p->d[0] + at), y = load(p->d[1] + at), z = load(p->d[2] + at);
    const vf u = x * t->edge[0][0] + y * t->edge[0][1] + z * t->edge[0][2];
    const vf v = x * t->edge[1][0] + y * t->edge[1][1] + z * t->edge[1][2];
    const vf w = x * t->edge[2][0] + y * t->edge[2][1] + z * t->edge[2][2];

    *inside = vmin(vmin(u, v), w) >= 0.0f;
    return (load(p->at[0] + at) - t->corner[0]) * t->normal[0] + (load(p->at[1] + at) - t->corner[1]) * t->normal[1] +
           (load(p->at[2] + at) - t->corner[2]) * t->normal[2];
}

INLINE const uint32_t *list_of(const struct pell_light_grid *f, int column, int row)
{
    return f->first + (size_t) row * (size_t) f->columns + (size_t) column;
}

/* State of a packet's iteration over its cells. */
struct search {
    int column, row;
    uint32_t next; /* next entry; 0: the cell's first */
};

/* The next triangles that begin between two depths and are not in a previous cell. They are prefetched when found, so that their memory
 * latencies overlap. */
INLINE int find_next(const struct pell_light_grid *f, const struct packet_points *p, float begin, struct search *s, uint32_t *restrict list)
{
    int count = 0;

    for (; s->row <= p->y1; s->row++, s->column = p->x0)
        for (; s->column <= p->x1; s->column++, s->next = 0) {
            const uint32_t *first = list_of(f, s->column, s->row), end = first[1];
            const uint32_t wanted = (s->column > p->x0 ? PELL_LIGHT_GRID_LEFT : 0) | (s->row > p->y0 ? PELL_LIGHT_GRID_LOW : 0);

            for (uint32_t e = s->next ? s->next : first[0]; e < end && f->entries[e].depth < p->depth; e++) {
                const uint32_t triangle = f->entries[e].triangle;
                if (count == LISTED) {
                    s->next = e;
                    return count;
                }
                list[count] = triangle & PELL_LIGHT_GRID_INDEX;
                __builtin_prefetch(&f->triangles[list[count]]);
                count += (triangle & wanted) == wanted && f->entries[e].depth >= begin;
            }
        }
    return count;
}

static bool visible16(const struct pell_light_grid *f, const int32_t *mask, const float *x, const float *y, const float *z,
                      int32_t *visible)
{
    vi open[LANES / WIDTH];
    uint32_t list[LISTED];
    struct search search;
    struct packet_points p;
    int count;

    if (!locate(f, mask, x, y, z, &p))
        return false;
    search = (struct search) { p.x0, p.y0, 0 };
    memcpy(open, mask, sizeof(open));
    do {
        vi left = { 0 };

        count = find_next(f, &p, -INFINITY, &search, list);
        for (int i = 0; i < count; i++) {
            const struct pell_light_grid_triangle *t = &f->triangles[list[i]];
            for (int k = 0, at = 0; k < LANES / WIDTH; k++, at += WIDTH) {
                vi inside;
                const vf s = edge_test(t, &p, at, &inside);
                open[k] &= ~(inside & (s > 0.0f) & (s < t->plane * NEAR));
            }
        }
        for (int k = 0; k < LANES / WIDTH; k++)
            left |= open[k];
        if (!any(left))
            break;
    } while (count == LISTED);
    memcpy(visible, open, sizeof(open));
    return true;
}

/* A hit is at the fraction s / (plane + s) of the distance: the smaller s / plane, the nearer it is. */
static bool closest16(const struct pell_light_grid *f, const int32_t *mask, struct pell_ray_hit16 *packet)
{
    struct pell_ray16 *ray = &packet->ray;
    struct pell_hit16 *hit = &packet->hit;
    _Alignas(64) float best[LANES];
    _Alignas(64) int32_t which[LANES];
    float longest = 0.0f, begin;
    uint32_t list[LISTED];
    struct search search;
    struct packet_points p;
    int count;

    if (!locate(f, mask, ray->ox, ray->oy, ray->oz, &p))
        return false;
    for (int i = 0; i < LANES; i++) {
        const float reach = ray->tfar[i] < WHOLE ? ray->tfar[i] : WHOLE;
        best[i] = mask[i] && reach > 0.0f ? reach / (1.0f - reach) : 0.0f;
        which[i] = -1;
        longest = mask[i] && reach > longest ? reach : longest;
    }
    begin = p.near * (1.0f - longest) * (1.0f - 1e-5f) -
            f->max_thickness; /* a triangle that begins before this depth ends before the rays do */
    search = (struct search) { p.x0, p.y0, 0 };
    do {
        count = find_next(f, &p, begin, &search, list);
        for (int i = 0; i < count; i++) {
            const struct pell_light_grid_triangle *t = &f->triangles[list[i]];
            const float per_plane = t->plane > 0.0f ? 1.0f / t->plane : 0.0f;
            for (int at = 0; at < LANES; at += WIDTH) {
                vi inside, old;
                const vf s = edge_test(t, &p, at, &inside), part = s * per_plane;
                const vi nearer = inside & (s > 0.0f) & (part < load(best + at));
                memcpy(&old, which + at, sizeof(old));
                store(best + at, select(nearer, part, load(best + at)));
                old = (((vi) { 0 } + (int32_t) list[i]) & nearer) | (old & ~nearer);
                memcpy(which + at, &old, sizeof(old));
            }
        }
    } while (count == LISTED);
    for (int i = 0; i < LANES; i++) {
        const struct pell_light_grid_triangle *t;
        const struct pell_light_grid_source *source;
        float side[3], sum;

        hit->mesh[i] = hit->instance[i] = PELL_NO_HIT;
        if (which[i] < 0)
            continue;
        t = &f->triangles[which[i]];
        source = &f->sources[which[i]];
        for (int k = 0; k < 3; k++)
            side[k] = p.d[0][i] * t->edge[k][0] + p.d[1][i] * t->edge[k][1] + p.d[2][i] * t->edge[k][2];
        sum = side[0] + side[1] + side[2];
        sum = sum > 0.0f ? 1.0f / sum : 0.0f;
        ray->tfar[i] = best[i] / (1.0f + best[i]);
        hit->u[i] = side[2] * sum;
        hit->v[i] = side[0] * sum;
        hit->ngx[i] = t->normal[0] * source->orientation;
        hit->ngy[i] = t->normal[1] * source->orientation;
        hit->ngz[i] = t->normal[2] * source->orientation;
        hit->mesh[i] = source->mesh;
        hit->triangle[i] = source->triangle;
    }
    return true;
}

extern const struct pell_light_grid_kernels PELL_SIMD(pell_light_grid_kernels);
const struct pell_light_grid_kernels PELL_SIMD(pell_light_grid_kernels) = { visible16, closest16 };
