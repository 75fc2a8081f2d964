/* SPDX-License-Identifier: MIT
 *
 * links.c - visibility between samples: rays with the density cos/pi. The rays of all samples are successive points of a Sobol sequence, so
 * that the rays of adjacent samples are stratified together.
 */
#include "render/indirect/internal.h"

#include <string.h>

#define CHUNK 64 /* samples per task */

struct linking {
    struct pell_indirect *in;
    uint32_t order[INDIRECT_RAYS]; /* order of tracing: rays of a packet have directions in the same quadrant */
};

_Static_assert(INDIRECT_RAYS == 4 * 16, "a quadrant is a packet");

/* The first rays; those of other samples are in the same quadrants, or in others that are exchanged as a whole. */
static void order_rays(uint32_t *order)
{
    int count = 0;

    for (uint32_t quadrant = 0; quadrant < 4; quadrant++)
        for (uint32_t i = 0; i < INDIRECT_RAYS; i++)
            if ((pell_sobol0(i) >> 31 | pell_sobol1(i) >> 31 << 1) == quadrant)
                order[count++] = i;
}

/* Direction of a ray, in coordinates whose z is the normal. */
static struct pell_vec3 ray_direction(uint32_t seed, uint32_t index)
{
    float x, y;

    pell_disc_point(pell_unit_float(pell_sobol0(index) ^ seed), pell_unit_float(pell_sobol1(index) ^ pell_hash(seed)), &x, &y);
    return vec3(x, y, sqrtf(fmaxf(1.0f - x * x - y * y, 1e-6f)));
}

uint32_t indirect_sample_at(const struct pell_indirect *in, uint32_t mesh, uint32_t triangle, float u, float v, bool back,
                            struct pell_vec3 at)
{
    uint32_t knot[3], best = INDIRECT_NONE;
    float weight[3], least = INFINITY;

    indirect_find(in, mesh, triangle, u, v, knot, weight);
    for (int k = 0; k < 3; k++) {
        const struct indirect_near *near = &in->near[indirect_value_of(in, mesh, knot[k], back)];
        for (int j = 0; j < INDIRECT_NEAR && near->weight[j] > 0.0f; j++) {
            const struct pell_vec3 to = vec3_sub(in->samples[near->sample[j]].position, at);
            const float d2 = vec3_dot(to, to);
            if (d2 < least) {
                least = d2;
                best = near->sample[j];
            }
        }
    }
    return best;
}

/* Returns the sample nearest to the hit of a ray, or INDIRECT_NONE, and the exitance there along the ray, over the mean. */
static uint32_t hit_sample(const struct pell_indirect *in, const struct pell_ray_hit16 *r, int i, float *exit_factor)
{
    const struct pell_hit16 *h = &r->hit;
    const struct pell_vec3 d = vec3(r->ray.dx[i], r->ray.dy[i], r->ray.dz[i]);
    const float mu = -vec3_dot(vec3_normalize(vec3(h->ngx[i], h->ngy[i], h->ngz[i])), d);
    const struct pell_vec3 at = vec3_mad(vec3(r->ray.ox[i], r->ray.oy[i], r->ray.oz[i]), r->ray.tfar[i], d);
    uint32_t material;
    float mean;

    if (h->mesh[i] == PELL_NO_HIT)
        return INDIRECT_NONE;
    material = (uint32_t) in->p.scene->meshes[h->mesh[i]].material;
    if (mu <= 0.0f && !in->p.scene->materials[material].opaque) /* hit from inside a solid */
        return INDIRECT_NONE;
    *exit_factor = indirect_transmittance(in, material, fabsf(mu), &mean) / fmaxf(mean, 1e-3f);
    return indirect_sample_at(in, h->mesh[i], h->triangle[i], h->u[i], h->v[i], mu < 0.0f, at);
}

static struct indirect_link make_link(const struct pell_indirect *in, const struct pell_ray_hit16 *r, int i, float enter_factor)
{
    float exit_factor;
    const uint32_t to = hit_sample(in, r, i, &exit_factor);

    if (to == INDIRECT_NONE)
        return (struct indirect_link) { 0, 0 };
    return (struct indirect_link) { to, (unsigned) fminf(enter_factor * exit_factor * INDIRECT_STEPS + 0.5f, 255.0f) };
}

/* The rays of a sample, in the order of tracing, reflected where they end. */
struct reflected_rays {
    struct pell_vec3 from[INDIRECT_RAYS], direction[INDIRECT_RAYS];
    float weight[INDIRECT_RAYS], total; /* weight of the light along each ray, as it enters the sample; sum of the weights */
};

static void reflect16(const struct pell_indirect *in, const struct pell_ray_hit16 *r, const float *enter_factor, int first, uint32_t seed,
                      struct reflected_rays *out)
{
    for (int i = 0; i < 16; i++) {
        const struct pell_hit16 *h = &r->hit;
        const struct pell_vec3 d = vec3(r->ray.dx[i], r->ray.dy[i], r->ray.dz[i]);
        const int k = first + i;
        struct pell_vec3 at, n;
        out->weight[k] = 0.0f;
        out->from[k] = out->direction[k] = vec3(0.0f, 0.0f, 0.0f);
        if (h->mesh[i] == PELL_NO_HIT)
            continue;
        n = vec3_normalize(vec3(h->ngx[i], h->ngy[i], h->ngz[i]));
        out->weight[k] = enter_factor[i] * indirect_reflect(in, (uint32_t) in->p.scene->meshes[h->mesh[i]].material, n, d,
                                                            pell_hash(seed + (uint32_t) k), &out->direction[k]);
        at = vec3_mad(vec3(r->ray.ox[i], r->ray.oy[i], r->ray.oz[i]), r->ray.tfar[i], d);
        out->from[k] = vec3_mad(at, indirect_ray_offset(at, 0.0f), n);
    }
}

/* Selects reflected rays by their weights (systematic sampling), so that each represents the same power. */
static void make_specular_links(const struct pell_indirect *in, const struct reflected_rays *rays, uint32_t seed,
                                struct indirect_specular_link *links)
{
    const float step = rays->total / INDIRECT_SPECULAR_LINKS;
    float cumulative = 0.0f, threshold = step * pell_unit_float(seed);
    _Alignas(64) int valid[16];
    struct pell_ray_hit16 r;

    memset(links, 0, INDIRECT_SPECULAR_LINKS * sizeof(*links));
    if (!(rays->total > 0.0f))
        return;
    for (int first = 0, k = 0; first < INDIRECT_SPECULAR_LINKS; first += 16) {
        memset(&r, 0, sizeof(r));
        for (int i = 0; i < 16; i++) {
            while (k < INDIRECT_RAYS - 1 && cumulative + rays->weight[k] <= threshold)
                cumulative += rays->weight[k++];
            threshold += step;
            valid[i] = rays->weight[k] > 0.0f ? -1 : 0; /* 0: the last one, by rounding */
            pell_ray16_set(&r.ray, i, rays->from[k], rays->direction[k], INFINITY);
            r.hit.mesh[i] = PELL_NO_HIT;
        }
        pell_rays_closest16(in->p.rays, valid, false, &r);
        for (int i = 0; i < 16; i++) {
            float exit_factor;
            const uint32_t to = valid[i] ? hit_sample(in, &r, i, &exit_factor) : INDIRECT_NONE;
            if (to != INDIRECT_NONE)
                links[first + i] = (struct indirect_specular_link) { to, step * exit_factor / INDIRECT_RAYS };
        }
    }
}

static void link_sample(const struct linking *l, uint32_t sample_index)
{
    struct pell_indirect *in = l->in;
    const struct indirect_sample *s = &in->samples[sample_index];
    struct indirect_link *links = in->links + (size_t) sample_index * INDIRECT_RAYS;
    const uint32_t sample_seed = pell_hash(in->p.seed + sample_index * 0x9e3779b9u);
    const struct pell_vec3 o = vec3_mad(s->position, indirect_ray_offset(s->position, s->spacing), s->normal);
    _Alignas(64) int valid[16];
    struct reflected_rays reflected;
    struct pell_ray_hit16 r;
    struct pell_vec3 t, b;

    vec3_basis(s->normal, &t, &b);
    for (int first = 0; first < INDIRECT_RAYS; first += 16) {
        float mu[16], enter_factor[16] = { 0.0f };
        memset(&r, 0, sizeof(r));
        for (int i = 0; i < 16; i++) {
            const struct pell_vec3 p = ray_direction(in->p.seed, sample_index * INDIRECT_RAYS + l->order[first + i]);
            const struct pell_vec3 w = vec3_mad(vec3_mad(vec3_mul(s->normal, p.z), p.x, t), p.y, b);
            mu[i] = p.z;
            valid[i] = -1;
            pell_ray16_set(&r.ray, i, o, w, INFINITY);
            r.hit.mesh[i] = PELL_NO_HIT;
        }
        pell_rays_closest16(in->p.rays, valid, true, &r);
        for (int i = 0; i < 16; i++) {
            float mean;
            if (r.hit.mesh[i] != PELL_NO_HIT)
                enter_factor[i] = indirect_transmittance(in, s->medium, mu[i], &mean);
            links[first + i] = make_link(in, &r, i, enter_factor[i]);
        }
        if (in->specular_links)
            reflect16(in, &r, enter_factor, first, sample_seed, &reflected);
    }
    if (!in->specular_links)
        return;
    reflected.total = 0.0f;
    for (int k = 0; k < INDIRECT_RAYS; k++)
        reflected.total += reflected.weight[k];
    make_specular_links(in, &reflected, pell_hash(sample_seed), in->specular_links + (size_t) sample_index * INDIRECT_SPECULAR_LINKS);
}

static void link_chunk(void *arg, int index, int worker)
{
    const struct linking *l = arg;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < l->in->num_samples ? first + CHUNK : l->in->num_samples;

    (void) worker;
    for (size_t i = first; i < end; i++)
        link_sample(l, (uint32_t) i);
}

enum pell_result indirect_links_make(struct pell_indirect *in, struct pell_pool *pool)
{
    struct linking l = { .in = in };

    in->links = pell_alloc_array(in->ctx, in->num_samples, INDIRECT_RAYS * sizeof(*in->links));
    if (!in->links)
        return PELL_ERR_NOMEM;
    if (in->reflected &&
        !(in->specular_links = pell_alloc_array(in->ctx, in->num_samples, INDIRECT_SPECULAR_LINKS * sizeof(*in->specular_links))))
        return PELL_ERR_NOMEM;
    order_rays(l.order);
    pell_pool_run(pool, (int) ((in->num_samples + CHUNK - 1) / CHUNK), link_chunk, &l);
    return pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}
