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

enum { CHUNK = 64, PHOTONS = 4 /* of a sample */, PARTS = 64 /* of a photon */ };
#define COARSE 1.5f     /* distances of samples where a photon lands: one from samples farther apart is sent in parts */
#define LEAST_AREA 0.5f /* of a sample's own: what even light brings to one may be less by chance, even nothing */

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
    uint32_t *coarse;       /* those that land among samples much finer than the one that they are from, */
    size_t num_coarse;
    struct photon *parts; /* [coarse][PARTS] */
};

/* Light of a photon where it meets a sample's surface: from the unit direction `v`, from `distance` away. */
struct arrival {
    const struct indirect_sample *sample;
    struct pell_vec3 at, v;
    float distance, power[3];
};

/* A packet of photons on their way. */
struct flight {
    struct pell_ray16 shadow; /* to the light */
    struct pell_ray_hit16 r;
    float power[16][3]; /* at their start */
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
    if (!from.distant) {
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

/* Sets photon i out, reflected. */
static bool set_out(const struct shine *s, const struct arrival *from, uint32_t hash, struct flight *f, int i)
{
    const struct indirect_sample *q = from->sample;
    struct pell_vec3 w, o;
    const float share = indirect_reflect(s->in, q->material, q->smooth, vec3_mul(from->v, -1.0f), hash, &w);

    if (!(share > 0.0f) || !(vec3_dot(w, q->normal) > 0.0f))
        return false;
    for (int c = 0; c < 3; c++)
        f->power[i][c] = share * from->power[c];
    o = vec3_mad(from->at, indirect_clearance(from->at, q->spacing), q->normal);
    pell_ray16_set(&f->shadow, i, o, from->v, from->distance);
    pell_ray16_set(&f->r.ray, i, o, w, INFINITY);
    return true;
}

/* Where 16 photons land. */
static void fly16(const struct shine *s, struct flight *f, int valid[16], struct photon *out)
{
    const struct pell_indirect *in = s->in;

    pell_rays_occluded16(in->p.rays, valid, false, &f->shadow);
    for (int i = 0; i < 16; i++) {
        valid[i] &= -(int) (f->shadow.tfar[i] >= 0.0f);
        f->r.hit.mesh[i] = PELL_NO_HIT;
    }
    pell_rays_closest16(in->p.rays, valid, false, &f->r);
    for (int i = 0; i < 16; i++) {
        const struct pell_hit16 *h = &f->r.hit;
        const struct pell_vec3 w = vec3(f->r.ray.dx[i], f->r.ray.dy[i], f->r.ray.dz[i]);
        float mu, mean, enter;
        uint32_t material;
        out[i].mesh = PELL_NO_HIT;
        if (!valid[i] || h->mesh[i] == PELL_NO_HIT)
            continue;
        mu = -vec3_dot(vec3_normalize(vec3(h->ngx[i], h->ngy[i], h->ngz[i])), w);
        material = (uint32_t) in->p.scene->meshes[h->mesh[i]].material;
        if (mu <= 0.0f && !in->p.scene->materials[material].opaque) /* from inside a solid */
            continue;
        enter = indirect_transmittance(in, material, fabsf(mu), &mean);
        out[i] = (struct photon) { h->mesh[i], h->triangle[i], h->u[i], h->v[i], mu < 0.0f, { 0.0f } };
        for (int c = 0; c < 3; c++)
            out[i].power[c] = enter * f->power[i][c];
    }
}

/* False: no light comes to the photon's sample. */
static bool photon_of(const struct shine *s, size_t number, size_t samples, struct arrival *from)
{
    const size_t sample = number / PHOTONS;
    const struct indirect_sample *q = sample < samples ? &s->in->samples[sample] : NULL;

    if (!q || q->back || !light_from(s, q, (uint32_t) number, &from->v, &from->distance, from->power))
        return false;
    from->sample = q;
    from->at = q->position;
    for (int c = 0; c < 3; c++)
        from->power[c] *= q->spacing * q->spacing / PHOTONS;
    return true;
}

/* 16 photons of four samples. */
static void send16(const struct shine *s, size_t first, size_t end)
{
    _Alignas(64) int valid[16] = { 0 };
    struct flight f;

    memset(&f, 0, sizeof(f));
    for (int i = 0; i < 16; i++) {
        const size_t number = first * PHOTONS + (size_t) i;
        struct arrival from;
        if (photon_of(s, number, end, &from) && set_out(s, &from, pell_hash(s->in->p.seed ^ (uint32_t) number), &f, i))
            valid[i] = -1;
    }
    fly16(s, &f, valid, s->photons + first * PHOTONS);
}

static void send_chunk(void *arg, int index, int worker)
{
    const struct shine *s = arg;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < s->in->num_samples ? first + CHUNK : s->in->num_samples;

    (void) worker;
    for (size_t i = first; i < end; i += 16 / PHOTONS)
        send16(s, i, end);
}

/* A photon that would be a spot where it lands, sent in parts from all over the area that its sample stands for. */
static void send_parts(void *arg, int index, int worker)
{
    const struct shine *s = arg;
    const size_t number = s->coarse[index];
    struct arrival whole;
    struct pell_vec3 t, b;

    (void) worker;
    if (!photon_of(s, number, s->in->num_samples, &whole))
        return;
    vec3_basis(whole.sample->normal, &t, &b);
    for (int c = 0; c < 3; c++)
        whole.power[c] /= PARTS;
    for (int first = 0; first < PARTS; first += 16) {
        _Alignas(64) int valid[16] = { 0 };
        struct flight f;
        memset(&f, 0, sizeof(f));
        for (int i = 0; i < 16; i++) {
            const uint32_t k = (uint32_t) (first + i), hash = pell_hash(s->in->p.seed ^ ((uint32_t) number * PARTS + k));
            const float x = ((float) k + 0.5f) / PARTS - 0.5f, y = pell_unit_float(pell_sobol0(k)) - 0.5f;
            const struct pell_vec3 aside = vec3_mul(vec3_mad(vec3_mul(t, x), y, b), whole.sample->spacing);
            struct arrival from = whole;
            from.at = vec3_add(whole.at, aside);
            if (whole.distance < INFINITY) {
                const struct pell_vec3 to = vec3_sub(vec3_mul(whole.v, whole.distance), aside);
                from.distance = vec3_length(to);
                from.v = vec3_mul(to, from.distance > 0.0f ? 1.0f / from.distance : 0.0f);
            }
            if (set_out(s, &from, hash, &f, i))
                valid[i] = -1;
        }
        fly16(s, &f, valid, s->parts + (size_t) index * PARTS + (size_t) first);
    }
}

/* Finds the photons that land among much finer samples than theirs, and sends them in parts. */
static enum pell_result send_coarse(struct shine *s, struct pell_pool *pool)
{
    const struct pell_indirect *in = s->in;
    size_t room = 0;
    enum pell_result res;

    for (size_t i = 0; i < in->num_samples * PHOTONS && !pell_cancelled_at(in->ctx, i); i++) {
        struct photon *p = &s->photons[i];
        uint32_t knot[3];
        float weight[3];
        const struct indirect_near *near;
        if (p->mesh == PELL_NO_HIT)
            continue;
        indirect_find(in, p->mesh, p->triangle, p->u, p->v, knot, weight);
        near = &in->near[indirect_value_of(in, p->mesh, knot[0], p->back)];
        if (!(near->weight[0] > 0.0f) || in->samples[i / PHOTONS].spacing < COARSE * in->samples[near->sample[0]].spacing)
            continue;
        PELL_TRY(pell_grow(in->ctx, (void **) &s->coarse, s->num_coarse + 1, &room, sizeof(*s->coarse)));
        s->coarse[s->num_coarse++] = (uint32_t) i;
        p->mesh = PELL_NO_HIT;
    }
    if (s->num_coarse == 0)
        return PELL_OK;
    if (!(s->parts = pell_calloc(in->ctx, s->num_coarse, PARTS * sizeof(*s->parts))))
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < s->num_coarse * PARTS; i++)
        s->parts[i].mesh = PELL_NO_HIT;
    pell_pool_run(pool, (int) s->num_coarse, send_parts, s);
    return PELL_OK;

fail:
    return res;
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
    PELL_TRY(send_coarse(&s, pool));
    memset(in->reflected, 0, in->num_samples * sizeof(*in->reflected));
    for (size_t i = 0; i < in->num_samples * PHOTONS && !pell_cancelled_at(in->ctx, i); i++)
        if (s.photons[i].mesh != PELL_NO_HIT)
            land(in, &s.photons[i], in->reflected);
    for (size_t i = 0; i < s.num_coarse * PARTS && !pell_cancelled_at(in->ctx, i); i++)
        if (s.parts[i].mesh != PELL_NO_HIT)
            land(in, &s.parts[i], in->reflected);
    for (size_t i = 0; i < in->num_samples; i++)
        for (int c = 0; c < 3; c++)
            in->reflected[i][c] /= fmaxf(in->area[i][c], LEAST_AREA * in->samples[i].spacing * in->samples[i].spacing);

fail:
    pell_light_sampler_destroy(&lights);
    pell_free(in->ctx, s.photons);
    pell_free(in->ctx, s.coarse);
    pell_free(in->ctx, s.parts);
    return res;
}
