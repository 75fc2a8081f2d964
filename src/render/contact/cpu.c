/* SPDX-License-Identifier: MIT
 * cpu.c - see stage.h. */
#include "render/contact/stage.h"

#include "math/sampling.h"
#include "math/scalar.h"
#include "shared/table.h"

#define DARKEST 0.8f /* fraction of the background's light that is removed where the whole sky is hidden */
#define MARGIN 1.2f  /* in heights of the objects' bounds, at most their radius: reach of the shadow around them */
#define FADES 0.4f   /* of the margin: start of the fade-out */
#define LIFT 1e-3f   /* radii: distance of the plane below the objects, so that objects standing on it occlude it */

enum { CELLS = 8192, MOST_IN_ROW = 2048, RAYS = 64 }; /* approximate number of cells, about square */

struct contact_side {
    float center, half; /* mm: centre and half extent of the grid */
    int cells;
};

struct pell_contact {
    struct pell_context *ctx;
    const struct pell_rays *rays;
    float level, margin;         /* mm */
    struct contact_side side[2]; /* along x and z */
    struct pell_vec3 sky[RAYS];  /* upward directions, cosine-distributed */
    float *hidden;               /* hidden fraction of the sky, faded, in rows along x */
};

/* Position of grid point i relative to the centre. */
static float coordinate(const struct contact_side *s, int i)
{
    return s->half * (2.0f * (float) i / (float) s->cells - 1.0f);
}

/* Distance along an axis of a position, relative to the centre, from the objects' bounds; 0 inside. */
static float outside_distance(const struct pell_contact *k, const struct contact_side *s, float at)
{
    return fmaxf(fabsf(at) - s->half + k->margin, 0.0f);
}

static void trace_row(void *arg, int row, int worker)
{
    struct pell_contact *k = arg;
    const struct contact_side *s = k->side;
    const float z = coordinate(&s[1], row), outside_z = outside_distance(k, &s[1], z);
    int valid[PELL_PACKET];
    (void) worker;

    for (int i = 0; i < PELL_PACKET; i++)
        valid[i] = -1;
    for (int column = 0; column <= s[0].cells && !pell_cancelled(k->ctx); column++) {
        const float x = coordinate(&s[0], column), outside_x = outside_distance(k, &s[0], x);
        const float outside = sqrtf(outside_x * outside_x + outside_z * outside_z) / k->margin;
        const float fade = 1.0f - smooth_ramp(FADES, 1.0f, outside);
        const struct pell_vec3 from = vec3(s[0].center + x, k->level, s[1].center + z);
        int hidden = 0;
        for (int first = 0; first < RAYS && fade > 0.0f; first += PELL_PACKET) {
            struct pell_ray16 packet;
            for (int i = 0; i < PELL_PACKET; i++)
                pell_ray16_set(&packet, i, from, k->sky[first + i], INFINITY);
            pell_rays_occluded16(k->rays, valid, true, &packet);
            for (int i = 0; i < PELL_PACKET; i++)
                hidden += packet.tfar[i] < 0.0f;
        }
        k->hidden[(size_t) row * (size_t) (s[0].cells + 1) + (size_t) column] = fade * (float) hidden / (float) RAYS;
    }
}

/* Sets the plane, its grid, and the directions. */
static void lay_out(struct pell_contact *k, const float *low, const float *high)
{
    const float radius = fmaxf(0.5f * vec3_length(vec3_sub(vec3_load(high), vec3_load(low))), 1e-6f);
    float cell;

    k->margin = fminf(fmaxf(MARGIN * (high[1] - low[1]), 0.1f * radius), radius);
    k->level = low[1] - LIFT * radius;
    for (int i = 0; i < 2; i++) {
        k->side[i].center = 0.5f * (low[2 * i] + high[2 * i]);
        k->side[i].half = 0.5f * (high[2 * i] - low[2 * i]) + k->margin;
    }
    cell = 2.0f * sqrtf(k->side[0].half * k->side[1].half / (float) CELLS);
    for (int i = 0; i < 2; i++)
        k->side[i].cells = (int) fminf(fmaxf(ceilf(2.0f * k->side[i].half / cell), 1.0f), (float) MOST_IN_ROW);
    for (int i = 0; i < RAYS; i++) { /* ordered by azimuth: rays of a packet have similar directions */
        struct pell_vec3 d;
        double p[2];
        int at = i;
        pell_sunflower_point(i, RAYS, p);
        d = vec3((float) p[0], (float) sqrt(fmax(1.0 - p[0] * p[0] - p[1] * p[1], 1e-4)), (float) p[1]);
        for (; at > 0 && atan2f(k->sky[at - 1].z, k->sky[at - 1].x) > atan2f(d.z, d.x); at--)
            k->sky[at] = k->sky[at - 1];
        k->sky[at] = d;
    }
}

enum pell_result pell_contact_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                     const struct pell_rays *rays, struct pell_contact **out)
{
    struct pell_contact *k;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!scene->contact_shadow || !rays)
        return PELL_OK;
    if (!(k = pell_calloc(ctx, 1, sizeof(*k))))
        return res;
    k->ctx = ctx;
    k->rays = rays;
    lay_out(k, scene->bounds_min, scene->bounds_max);
    k->hidden = pell_calloc(ctx, (size_t) (k->side[0].cells + 1) * (size_t) (k->side[1].cells + 1), sizeof(*k->hidden));
    if (k->hidden) {
        pell_pool_run(pool, k->side[1].cells + 1, trace_row, k);
        res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;
    }
    *out = k;
    if (res != PELL_OK)
        pell_contact_destroy(out);
    return res;
}

void pell_contact_destroy(struct pell_contact **contact)
{
    struct pell_contact *k = *contact;

    if (k) {
        pell_free(k->ctx, k->hidden);
        pell_free(k->ctx, k);
    }
    *contact = NULL;
}

struct pell_rect pell_contact_rect(const struct pell_contact *k, const struct pell_view *view)
{
    const struct contact_side *s = k->side;
    const float low[] = { s[0].center - s[0].half, k->level, s[1].center - s[1].half };
    const float high[] = { s[0].center + s[0].half, k->level, s[1].center + s[1].half };

    return pell_view_rect(view, low, high);
}

/* The cell of a position along a side, and the fraction in it. */
static int cell_at(const struct contact_side *s, float at, float *into)
{
    const float u = 0.5f * (at / s->half + 1.0f) * (float) s->cells;
    const int i = (int) u < s->cells - 1 ? (int) u : s->cells - 1;

    *into = u - (float) i;
    return i;
}

float pell_contact_shade(const struct pell_contact *k, struct pell_vec3 start, struct pell_vec3 direction)
{
    const struct contact_side *s = k->side;
    const size_t row = (size_t) s[0].cells + 1;
    const float t = (k->level - start.y) / direction.y;
    const float x = start.x + t * direction.x - s[0].center, z = start.z + t * direction.z - s[1].center;
    const float *h;
    float u, v;

    if (!(direction.y < 0.0f && t > 0.0f && fabsf(x) < s[0].half && fabsf(z) < s[1].half))
        return 1.0f; /* from below, the plane is invisible */
    h = k->hidden + cell_at(&s[0], x, &u);
    h += row * (size_t) cell_at(&s[1], z, &v);
    return 1.0f - DARKEST * pell_bilinear(h[0], h[1], h[row], h[row + 1], u, v);
}
