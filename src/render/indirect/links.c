/* SPDX-License-Identifier: MIT
 *
 * links.c - what each sample sees: rays with the density cos/pi, the same in number and height at all samples, turned about the normal.
 */
#include "render/indirect/internal.h"

#include <string.h>

#define CHUNK 64      /* samples of a task */
#define CLEAR 1.0e-4f /* of the largest coordinate: how far from the surface rays start */

/* T of a direction, and its mean over a diffuse hemisphere. */
static float transmittance(const struct pell_indirect *in, uint32_t material, float mu, float *mean)
{
    const struct pell_specular_tables *t = in->p.tables;
    const struct pell_material *m = &in->p.scene->materials[material];
    const struct pell_boundary_table *boundary = &t->boundaries[t->boundary[material]];
    const struct pell_surface_uniform u = pell_surface_uniform(m);
    const float rho = (u.specular[0] + u.specular[1] + u.specular[2]) / 3.0f;
    const float(*n)[2] = t->mean[t->model[material]];
    float fraction, scale, bias;
    int j;

    if (in->p.smooth && !m->opaque) {
        *mean = boundary->mean;
        return pell_boundary_lookup(boundary->transmittance, mu);
    }
    pell_roughness_position(u.roughness, &j, &fraction);
    pell_albedo_pair(t->albedo[t->model[material]][0][j], fraction, mu, &scale, &bias);
    *mean = pell_transmittance(rho, boundary->f0, pell_lerp(n[j][0], n[j + 1][0], fraction), pell_lerp(n[j][1], n[j + 1][1], fraction));
    return pell_transmittance(rho, boundary->f0, scale, bias);
}

struct directions {
    struct pell_indirect *in;
    float x[INDIRECT_RAYS], y[INDIRECT_RAYS], z[INDIRECT_RAYS];
};

static void make_directions(struct directions *d)
{
    for (uint32_t i = 0; i < INDIRECT_RAYS; i++) {
        pell_disc_point(((float) i + 0.5f) / INDIRECT_RAYS, pell_unit_float(pell_sobol0(i)), &d->x[i], &d->y[i]);
        d->z[i] = sqrtf(fmaxf(1.0f - d->x[i] * d->x[i] - d->y[i] * d->y[i], 1e-6f));
    }
}

/* Where a ray ends: the sample nearest to it of those around, and what leaves there along the ray. */
static struct indirect_link link_of(const struct pell_indirect *in, const struct pell_ray_hit16 *r, int i)
{
    const struct pell_hit16 *h = &r->hit;
    const struct pell_vec3 d = vec3(r->ray.dx[i], r->ray.dy[i], r->ray.dz[i]);
    const float mu = -vec3_dot(vec3_normalize(vec3(h->ngx[i], h->ngy[i], h->ngz[i])), d);
    const struct pell_vec3 at = vec3_mad(vec3(r->ray.ox[i], r->ray.oy[i], r->ray.oz[i]), r->ray.tfar[i], d);
    uint32_t knot[3], best = INDIRECT_NONE, material;
    float weight[3], least = INFINITY, factor, mean;

    if (h->mesh[i] == PELL_NO_HIT)
        return (struct indirect_link) { 0, 0 };
    material = (uint32_t) in->p.scene->meshes[h->mesh[i]].material;
    if (mu <= 0.0f && !in->p.scene->materials[material].opaque) /* from inside a solid */
        return (struct indirect_link) { 0, 0 };
    indirect_find(in, h->mesh[i], h->triangle[i], h->u[i], h->v[i], knot, weight);
    for (int k = 0; k < 3; k++) {
        const struct indirect_near *near = &in->near[indirect_value_of(in, h->mesh[i], knot[k], mu < 0.0f)];
        for (int j = 0; j < INDIRECT_NEAR && near->weight[j] > 0.0f; j++) {
            const struct pell_vec3 to = vec3_sub(in->samples[near->sample[j]].position, at);
            const float d2 = vec3_dot(to, to);
            if (d2 < least) {
                least = d2;
                best = near->sample[j];
            }
        }
    }
    if (best == INDIRECT_NONE)
        return (struct indirect_link) { 0, 0 };
    factor = transmittance(in, material, fabsf(mu), &mean) / fmaxf(mean, 1e-3f) * INDIRECT_STEPS + 0.5f;
    return (struct indirect_link) { best, factor < 255.0f ? (unsigned) factor : 255u };
}

static void link_sample(const struct directions *d, uint32_t number)
{
    struct pell_indirect *in = d->in;
    const struct indirect_sample *s = &in->samples[number];
    const float turn = 2.0f * PELL_PI_F * pell_unit_float(pell_hash(in->p.seed + number * 0x9e3779b9u));
    const float cosine = cosf(turn), sine = sinf(turn);
    const float largest = fmaxf(fabsf(s->position.x), fmaxf(fabsf(s->position.y), fabsf(s->position.z)));
    const struct pell_vec3 o = vec3_mad(s->position, CLEAR * fmaxf(largest, s->spacing), s->normal);
    _Alignas(64) int valid[16];
    struct pell_ray_hit16 r;
    struct pell_vec3 t, b;

    vec3_basis(s->normal, &t, &b);
    for (int first = 0; first < INDIRECT_RAYS; first += 16) {
        memset(&r, 0, sizeof(r));
        for (int i = 0; i < 16; i++) {
            const int k = first + i;
            const float x = cosine * d->x[k] - sine * d->y[k], y = sine * d->x[k] + cosine * d->y[k];
            const struct pell_vec3 w = vec3_mad(vec3_mad(vec3_mul(s->normal, d->z[k]), x, t), y, b);
            valid[i] = -1;
            pell_ray16_set(&r.ray, i, o, w, INFINITY);
            r.hit.mesh[i] = PELL_NO_HIT;
        }
        pell_rays_closest16(in->p.rays, valid, false, &r);
        for (int i = 0; i < 16; i++)
            in->links[(size_t) number * INDIRECT_RAYS + (size_t) (first + i)] = link_of(in, &r, i);
    }
}

static void link_chunk(void *arg, int index, int worker)
{
    const struct directions *d = arg;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < d->in->num_samples ? first + CHUNK : d->in->num_samples;

    (void) worker;
    for (size_t i = first; i < end; i++)
        link_sample(d, (uint32_t) i);
}

enum pell_result indirect_links_make(struct pell_indirect *in, struct pell_pool *pool)
{
    struct directions d = { .in = in };

    in->links = pell_alloc_array(in->ctx, in->num_samples, INDIRECT_RAYS * sizeof(*in->links));
    in->enter = pell_alloc_array(in->ctx, in->p.scene->num_materials, sizeof(*in->enter));
    if (!in->links || !in->enter)
        return PELL_ERR_NOMEM;
    make_directions(&d);
    for (size_t m = 0; m < in->p.scene->num_materials; m++)
        for (int k = 0; k < INDIRECT_RAYS; k++) {
            float mean;
            in->enter[m][k] = transmittance(in, (uint32_t) m, d.z[k], &mean) / (INDIRECT_RAYS * INDIRECT_STEPS);
        }
    pell_pool_run(pool, (int) ((in->num_samples + CHUNK - 1) / CHUNK), link_chunk, &d);
    return pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}
