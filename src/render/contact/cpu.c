/* SPDX-License-Identifier: MIT
 * cpu.c - see stage.h. */
#include "render/contact/stage.h"

#include "math/sampling.h"

#define DARKEST 0.8f /* of the background's light is gone where the whole sky is hidden */
#define REACH 2.0f   /* radii of the objects' bounds, seen from above: how far the shadow goes */
#define FADES 0.5f   /* of the reach: from here on it fades out */
#define LIFT 1e-3f   /* radii: how far below the objects the plane lies, so that what stands on it hides it */

enum { CELLS = 96, POINTS = CELLS + 1, RAYS = 64 };

struct pell_contact {
    struct pell_context *ctx;
    const struct pell_rays *rays;
    float level, center[2], reach, radius;  /* mm; center: x, z */
    struct pell_vec3 sky[RAYS];             /* directions upwards, by the cosine */
    float hidden[(size_t) POINTS * POINTS]; /* share of the sky, faded, in rows along x */
};

/* Where point i of the grid is, from its center. */
static float place(const struct pell_contact *k, int i)
{
    return k->reach * (2.0f * (float) i / (float) CELLS - 1.0f);
}

static void look_up_row(void *arg, int z, int worker)
{
    struct pell_contact *k = arg;
    int valid[PELL_PACKET];
    (void) worker;

    for (int i = 0; i < PELL_PACKET; i++)
        valid[i] = -1;
    for (int x = 0; x < POINTS && !pell_cancelled(k->ctx); x++) {
        const float far = hypotf(place(k, x), place(k, z)) / k->reach, t = (far - FADES) / (1.0f - FADES);
        const float fade = t <= 0.0f ? 1.0f : t >= 1.0f ? 0.0f : 1.0f - t * t * (3.0f - 2.0f * t);
        const struct pell_vec3 from = vec3(k->center[0] + place(k, x), k->level, k->center[1] + place(k, z));
        int hidden = 0;
        for (int first = 0; first < RAYS && fade > 0.0f; first += PELL_PACKET) {
            struct pell_ray16 packet;
            for (int i = 0; i < PELL_PACKET; i++)
                pell_ray16_set(&packet, i, from, k->sky[first + i], INFINITY);
            pell_rays_occluded16(k->rays, valid, true, &packet);
            for (int i = 0; i < PELL_PACKET; i++)
                hidden += packet.tfar[i] < 0.0f;
        }
        k->hidden[z * POINTS + x] = fade * (float) hidden / (float) RAYS;
    }
}

enum pell_result pell_contact_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                     const struct pell_rays *rays, struct pell_contact **out)
{
    const float *low = scene->bounds_min, *high = scene->bounds_max;
    struct pell_contact *k;

    *out = NULL;
    if (!scene->contact_shadow || !rays)
        return PELL_OK;
    if (!(k = pell_calloc(ctx, 1, sizeof(*k))))
        return PELL_ERR_NOMEM;
    k->ctx = ctx;
    k->rays = rays;
    k->radius = fmaxf(0.5f * sqrtf((high[0] - low[0]) * (high[0] - low[0]) + (high[1] - low[1]) * (high[1] - low[1]) +
                                   (high[2] - low[2]) * (high[2] - low[2])),
                      1e-6f);
    k->reach = REACH * k->radius;
    k->level = low[1] - LIFT * k->radius;
    k->center[0] = 0.5f * (low[0] + high[0]);
    k->center[1] = 0.5f * (low[2] + high[2]);
    for (int i = 0; i < RAYS; i++) {
        double p[2];
        pell_sunflower_point(i, RAYS, p);
        k->sky[i] = vec3((float) p[0], (float) sqrt(fmax(1.0 - p[0] * p[0] - p[1] * p[1], 1e-4)), (float) p[1]);
    }
    pell_pool_run(pool, POINTS, look_up_row, k);
    *out = k;
    if (!pell_cancelled(ctx))
        return PELL_OK;
    pell_contact_destroy(out);
    return PELL_ERR_CANCELLED;
}

void pell_contact_destroy(struct pell_contact **contact)
{
    if (*contact)
        pell_free((*contact)->ctx, *contact);
    *contact = NULL;
}

struct pell_rect pell_contact_rect(const struct pell_contact *k, const struct pell_view *view)
{
    const float low[] = { k->center[0] - k->reach, k->level, k->center[1] - k->reach };
    const float high[] = { k->center[0] + k->reach, k->level, k->center[1] + k->reach };

    return pell_view_rect(view, low, high);
}

float pell_contact_shade(const struct pell_contact *k, struct pell_vec3 start, struct pell_vec3 direction)
{
    const float t = (k->level - start.y) / direction.y;
    const float x = start.x + t * direction.x - k->center[0], z = start.z + t * direction.z - k->center[1];
    float u, v;
    int i, j;

    if (!(direction.y < 0.0f && t > 0.0f && fabsf(x) < k->reach && fabsf(z) < k->reach))
        return 1.0f; /* from below the plane is not there */
    u = 0.5f * (x / k->reach + 1.0f) * (float) CELLS;
    v = 0.5f * (z / k->reach + 1.0f) * (float) CELLS;
    i = (int) u < CELLS - 1 ? (int) u : CELLS - 1;
    j = (int) v < CELLS - 1 ? (int) v : CELLS - 1;
    u -= (float) i;
    v -= (float) j;
    {
        const float *h = k->hidden + j * POINTS + i;
        const float near = h[0] + u * (h[1] - h[0]), far = h[POINTS] + u * (h[POINTS + 1] - h[POINTS]);
        return 1.0f - DARKEST * (near + v * (far - near));
    }
}
