/* SPDX-License-Identifier: MIT
 *
 * mirror.c - light that a translucent surface reflects without letting it in, and that enters where it lands: between folds as much as a
 * tenth of all light. Each sample sends what lights send to it on along reflected rays, as photons; what other samples sent is found
 * backward, by the links' rays reflected where they end (links.c). One reflection on each way.
 */
#include "render/indirect/internal.h"

#include "lights/light_sampling.h"
#include "shared/lobe.h"

#include <string.h>

enum { CHUNK = 64, PHOTONS = 4 /* of a sample */ };

float indirect_transmittance(const struct pell_indirect *in, uint32_t material, float mu, float *mean)
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

/* The normal that a ray along w is reflected about: n, or where the boundary is rough that of a facet, by GGX (Walter et al. 2007,
 * eq. 35). */
static struct pell_vec3 facet(const struct pell_indirect *in, uint32_t material, struct pell_vec3 n, struct pell_vec3 w, uint32_t hash)
{
    const struct pell_surface_uniform u = pell_surface_uniform(&in->p.scene->materials[material]);
    const float width = in->p.smooth ? 0.0f : pell_lobe_width((int32_t) in->p.tables->model[material], u.roughness);
    const float along = pell_unit_float(hash), turn = 2.0f * PELL_PI_F * pell_unit_float(pell_hash(hash));
    const float tangent2 = width * width * along / (1.0f - along), cosine = 1.0f / sqrtf(1.0f + tangent2), sine = cosine * sqrtf(tangent2);
    struct pell_vec3 t, b, m;

    vec3_basis(n, &t, &b);
    m = vec3_mad(vec3_mad(vec3_mul(n, cosine), sine * cosf(turn), t), sine * sinf(turn), b);
    return vec3_dot(m, w) < 0.0f ? m : n;
}

float indirect_reflect(const struct pell_indirect *in, uint32_t material, struct pell_vec3 n, struct pell_vec3 w, uint32_t hash,
                       struct pell_vec3 *out)
{
    const float mu = -vec3_dot(n, w);
    struct pell_vec3 m;
    float mean;

    if (!(mu > 0.0f) || in->p.scene->materials[material].opaque)
        return 0.0f;
    m = facet(in, material, n, w, hash);
    *out = vec3_mad(w, -2.0f * vec3_dot(m, w), m);
    if (!(vec3_dot(*out, n) > 0.0f))
        *out = vec3_mad(w, 2.0f * mu, n);
    return 1.0f - indirect_transmittance(in, material, mu, &mean);
}

/* --- Photons ------------------------------------------------------------------------------------------------------------------------ */

/* What one brings to where it lands. */
struct photon {
    uint32_t mesh, triangle; /* PELL_NO_HIT: nowhere */
    float u, v;
    bool back;
    float power[3]; /* mm^2 W/m^2 */
};

struct shine {
    const struct pell_indirect *in;
    const struct pell_light_sampler *lights;
    struct photon *photons; /* [sample][PHOTONS] */
};

/* What a place of a light sends to a sample, W/m^2, from the unit direction `v`. False: nothing. */
static bool light_from(const struct shine *s, const struct indirect_sample *to, uint32_t number, struct pell_vec3 *v, float *distance,
                       float irradiance[3])
{
    const double u[3] = { pell_lattice(s->in->p.seed, 0, number), pell_lattice(s->in->p.seed, 1, number),
                          pell_lattice(s->in->p.seed, 2, number) };
    struct pell_light_sample from;
    double scale = 1.0;

    if (!pell_light_sampler_sample(s->lights, to->position, u, &from))
        return false;
    *distance = INFINITY;
    *v = from.toward;
    if (!from.away) {
        const struct pell_vec3 d = vec3_sub(from.at, to->position);
        const float length = vec3_length(d);
        if (!(length > 0.0f))
            return false;
        *v = vec3_mul(d, 1.0f / length);
        *distance = length;
        scale = (from.delta ? 1.0 : fmax(-(double) vec3_dot(from.normal, *v), 0.0)) / ((double) length * (double) length);
    }
    scale *= (double) vec3_dot(to->normal, *v) / from.pdf;
    if (!(scale > 0.0))
        return false;
    pell_light_sampler_power_at(s->lights, &from, to->position, irradiance);
    for (int c = 0; c < 3; c++)
        irradiance[c] = (float) ((double) irradiance[c] * scale);
    return irradiance[0] + irradiance[1] + irradiance[2] > 0.0f;
}

/* 16 photons of four samples. */
static void send16(const struct shine *s, size_t first, size_t end)
{
    const struct pell_indirect *in = s->in;
    _Alignas(64) int valid[16] = { 0 };
    struct pell_ray16 shadow;
    struct pell_ray_hit16 r;
    float irradiance[16][3];

    memset(&shadow, 0, sizeof(shadow));
    memset(&r, 0, sizeof(r));
    for (int i = 0; i < 16; i++) {
        const size_t number = first * PHOTONS + (size_t) i, sample = number / PHOTONS;
        const struct indirect_sample *q = &in->samples[sample < end ? sample : first];
        struct pell_vec3 v, o, w;
        float distance, share;
        s->photons[number].mesh = PELL_NO_HIT;
        r.hit.mesh[i] = PELL_NO_HIT;
        if (sample >= end || q->back || !light_from(s, q, (uint32_t) number, &v, &distance, irradiance[i]))
            continue;
        share = indirect_reflect(in, q->material, q->smooth, vec3_mul(v, -1.0f), pell_hash(in->p.seed ^ (uint32_t) number), &w);
        if (!(share > 0.0f) || !(vec3_dot(w, q->normal) > 0.0f))
            continue;
        for (int c = 0; c < 3; c++)
            irradiance[i][c] *= share * q->spacing * q->spacing / PHOTONS;
        o = vec3_mad(q->position, indirect_clearance(q->position, q->spacing), q->normal);
        valid[i] = -1;
        pell_ray16_set(&shadow, i, o, v, distance);
        pell_ray16_set(&r.ray, i, o, w, INFINITY);
    }
    pell_rays_occluded16(in->p.rays, valid, false, &shadow);
    for (int i = 0; i < 16; i++)
        valid[i] &= -(int) (shadow.tfar[i] >= 0.0f);
    pell_rays_closest16(in->p.rays, valid, false, &r);
    for (int i = 0; i < 16; i++) {
        struct photon *p = &s->photons[first * PHOTONS + (size_t) i];
        const struct pell_hit16 *h = &r.hit;
        const struct pell_vec3 w = vec3(r.ray.dx[i], r.ray.dy[i], r.ray.dz[i]);
        float mu, mean, enter;
        uint32_t material;
        if (!valid[i] || h->mesh[i] == PELL_NO_HIT)
            continue;
        mu = -vec3_dot(vec3_normalize(vec3(h->ngx[i], h->ngy[i], h->ngz[i])), w);
        material = (uint32_t) in->p.scene->meshes[h->mesh[i]].material;
        if (mu <= 0.0f && !in->p.scene->materials[material].opaque) /* from inside a solid */
            continue;
        enter = indirect_transmittance(in, material, fabsf(mu), &mean);
        *p = (struct photon) { h->mesh[i], h->triangle[i], h->u[i], h->v[i], mu < 0.0f, { 0.0f } };
        for (int c = 0; c < 3; c++)
            p->power[c] = enter * irradiance[i][c];
    }
}

static void send_chunk(void *arg, int index, int worker)
{
    const struct shine *s = arg;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < s->in->num_samples ? first + CHUNK : s->in->num_samples;

    (void) worker;
    for (size_t i = first; i < end; i += 16 / PHOTONS)
        send16(s, i, end);
}

/* Shares what lands at a place among the samples around it. */
static void land(const struct pell_indirect *in, const struct photon *p, float (*sum)[3])
{
    uint32_t knot[3];
    float weight[3];

    indirect_find(in, p->mesh, p->triangle, p->u, p->v, knot, weight);
    for (int k = 0; k < 3; k++) {
        const struct indirect_near *near = &in->near[indirect_value_of(in, p->mesh, knot[k], p->back)];
        for (int j = 0; j < INDIRECT_NEAR && near->weight[j] > 0.0f; j++)
            for (int c = 0; c < 3; c++)
                sum[near->sample[j]][c] += weight[k] * near->weight[j] * p->power[c];
    }
}

/* The area that each sample stands for when light lands: what land() gives it of one that falls evenly. */
static void even_light(struct pell_indirect *in)
{
    for (size_t i = 0; i < in->num_samples; i++)
        for (int c = 0; c < 3; c++)
            in->area[i][c] = 0.0f;
    for (size_t i = 0; i < in->num_samples && !pell_cancelled_at(in->ctx, i); i++) {
        const struct indirect_sample *q = &in->samples[i];
        const float area = q->spacing * q->spacing;
        const struct photon p = { q->mesh, q->triangle, q->u, q->v, q->back, { area, area, area } };
        land(in, &p, in->area);
    }
}

enum pell_result indirect_mirror_make(struct pell_indirect *in)
{
    bool any = false;

    for (size_t i = 0; i < in->p.scene->num_materials; i++)
        any |= !in->p.scene->materials[i].opaque;
    if (!any)
        return PELL_OK;
    in->reflected = pell_calloc(in->ctx, in->num_samples, sizeof(*in->reflected));
    in->before = pell_alloc_array(in->ctx, in->num_samples, sizeof(*in->before));
    in->area = pell_alloc_array(in->ctx, in->num_samples, sizeof(*in->area));
    if (!in->reflected || !in->before || !in->area)
        return PELL_ERR_NOMEM;
    even_light(in);
    return PELL_OK;
}

enum pell_result indirect_mirror_light(struct pell_indirect *in, struct pell_pool *pool)
{
    const size_t groups = (in->num_samples + 16 / PHOTONS - 1) / (16 / PHOTONS);
    struct shine s = { .in = in };
    struct pell_light_sampler *lights = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!in->reflected)
        return PELL_OK;
    if (!(s.photons = pell_alloc_array(in->ctx, groups, 16 * sizeof(*s.photons))))
        goto fail;
    PELL_TRY(pell_light_sampler_create(in->ctx, in->p.scene, &lights));
    s.lights = lights;
    pell_pool_run(pool, (int) ((in->num_samples + CHUNK - 1) / CHUNK), send_chunk, &s);
    memset(in->reflected, 0, in->num_samples * sizeof(*in->reflected));
    for (size_t i = 0; i < in->num_samples * PHOTONS && !pell_cancelled_at(in->ctx, i); i++)
        if (s.photons[i].mesh != PELL_NO_HIT)
            land(in, &s.photons[i], in->reflected);
    for (size_t i = 0; i < in->num_samples; i++)
        for (int c = 0; c < 3; c++)
            in->reflected[i][c] /= fmaxf(in->area[i][c], 1e-30f);

fail:
    pell_light_sampler_destroy(&lights);
    pell_free(in->ctx, s.photons);
    return res;
}
