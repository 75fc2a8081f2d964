/* SPDX-License-Identifier: MIT
 *
 * specular.c - light that a translucent surface reflects without letting it in, and that enters where it hits next: up to a tenth of all
 * light between folds. Each sample reflects the light of the light sources as photons. Light that other samples sent is found backward, by
 * the links' rays reflected where they end (links.c). There is one reflection per path segment.
 */
#include "render/indirect/internal.h"

#include "lights/light_sampling.h"
#include "shared/lobe.h"

#include <string.h>

enum { CHUNK = 64, PHOTONS = 4 /* per sample */, PARTS = 64 /* per photon */ };
#define COARSE                                                                                                                             \
    1.5f              /* ratio of the distance between samples at the source to that where a photon lands: coarser photons are
                         * subdivided */
#define MIN_AREA 0.5f /* of a sample's own area: a random pattern may assign less to a sample, even nothing */

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

/* The normal about which a ray along w is reflected: n, or at a rough boundary a facet's normal, sampled by GGX (Walter et al. 2007, eq.
 * 35). */
static struct pell_vec3 facet(const struct pell_indirect *in, uint32_t material, struct pell_vec3 n, struct pell_vec3 w, uint32_t hash)
{
    const struct pell_surface_uniform u = pell_surface_uniform(&in->p.scene->materials[material]);
    const float width = in->p.smooth ? 0.0f : pell_lobe_width((int32_t) in->p.tables->model[material], u.roughness);
    const float along = pell_unit_float(hash), rotation = 2.0f * PELL_PI_F * pell_unit_float(pell_hash(hash));
    const float tangent2 = width * width * along / (1.0f - along), cosine = 1.0f / sqrtf(1.0f + tangent2), sine = cosine * sqrtf(tangent2);
    struct pell_vec3 t, b, m;

    vec3_basis(n, &t, &b);
    m = vec3_mad(vec3_mad(vec3_mul(n, cosine), sine * cosf(rotation), t), sine * sinf(rotation), b);
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

/* A photon where it lands. */
struct photon {
    uint32_t mesh, triangle; /* PELL_NO_HIT: it hits nothing */
    float u, v;
    bool back;
    float power[3]; /* mm^2 W/m^2 */
};

struct photon_pass {
    const struct pell_indirect *in;
    const struct pell_light_sampler *lights;
    struct photon *photons; /* [sample][PHOTONS] */
    uint32_t *coarse;       /* photons that land among samples much finer than the one they are from */
    size_t num_coarse;
    struct photon *parts; /* [coarse][PARTS] */
};

/* Light of a photon at its sample: arrives from the unit direction `v`, from `distance` away. */
struct arrival {
    const struct indirect_sample *sample;
    struct pell_vec3 at, v;
    float distance, power[3];
};

/* A packet of photons. */
struct photon_packet {
    struct pell_ray16 shadow; /* shadow ray to the light */
    struct pell_ray_hit16 r;
    float power[16][3]; /* at the source sample */
};

/* Samples a light: irradiance at a sample, W/m^2, from the unit direction `v`. Returns false if there is none. */
static bool sample_light(const struct photon_pass *s, const struct indirect_sample *to, uint32_t photon_index, struct pell_vec3 *v,
                         float *distance, float irradiance[3])
{
    const double u[3] = { pell_lattice(s->in->p.seed, 0, photon_index), pell_lattice(s->in->p.seed, 1, photon_index),
                          pell_lattice(s->in->p.seed, 2, photon_index) };
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

/* Emits photon i with its direction after reflection. */
static bool emit(const struct photon_pass *s, const struct arrival *from, uint32_t hash, struct photon_packet *f, int i)
{
    const struct indirect_sample *q = from->sample;
    struct pell_vec3 w, o;
    const float reflected_fraction = indirect_reflect(s->in, q->medium, q->smooth, vec3_mul(from->v, -1.0f), hash, &w);

    if (!(reflected_fraction > 0.0f) || !(vec3_dot(w, q->normal) > 0.0f))
        return false;
    for (int c = 0; c < 3; c++)
        f->power[i][c] = reflected_fraction * from->power[c];
    o = vec3_mad(from->at, indirect_ray_offset(from->at, q->spacing), q->normal);
    pell_ray16_set(&f->shadow, i, o, from->v, from->distance);
    pell_ray16_set(&f->r.ray, i, o, w, INFINITY);
    return true;
}

/* Traces 16 photons to where they land. */
static void trace16(const struct photon_pass *s, struct photon_packet *f, int valid[16], struct photon *out)
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
        if (mu <= 0.0f && !in->p.scene->materials[material].opaque) /* hit from inside a solid */
            continue;
        enter = indirect_transmittance(in, material, fabsf(mu), &mean);
        out[i] = (struct photon) { h->mesh[i], h->triangle[i], h->u[i], h->v[i], mu < 0.0f, { 0.0f } };
        for (int c = 0; c < 3; c++)
            out[i].power[c] = enter * f->power[i][c];
    }
}

/* Returns false if no light arrives at the photon's sample. */
static bool make_photon(const struct photon_pass *s, size_t photon_index, size_t samples, struct arrival *from)
{
    const size_t sample = photon_index / PHOTONS;
    const struct indirect_sample *q = sample < samples ? &s->in->samples[sample] : NULL;

    if (!q || q->back || !sample_light(s, q, (uint32_t) photon_index, &from->v, &from->distance, from->power))
        return false;
    from->sample = q;
    from->at = q->position;
    for (int c = 0; c < 3; c++)
        from->power[c] *= q->spacing * q->spacing / PHOTONS;
    return true;
}

/* Emits 16 photons of four samples. */
static void emit16(const struct photon_pass *s, size_t first, size_t end)
{
    _Alignas(64) int valid[16] = { 0 };
    struct photon_packet f;

    memset(&f, 0, sizeof(f));
    for (int i = 0; i < 16; i++) {
        const size_t photon_index = first * PHOTONS + (size_t) i;
        struct arrival from;
        if (make_photon(s, photon_index, end, &from) && emit(s, &from, pell_hash(s->in->p.seed ^ (uint32_t) photon_index), &f, i))
            valid[i] = -1;
    }
    trace16(s, &f, valid, s->photons + first * PHOTONS);
}

static void emit_chunk(void *arg, int index, int worker)
{
    const struct photon_pass *s = arg;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < s->in->num_samples ? first + CHUNK : s->in->num_samples;

    (void) worker;
    for (size_t i = first; i < end; i += 16 / PHOTONS)
        emit16(s, i, end);
}

/* Replaces a photon that would make a spot where it lands by parts that start all over the area of its sample. */
static void emit_parts(void *arg, int index, int worker)
{
    const struct photon_pass *s = arg;
    const size_t photon_index = s->coarse[index];
    struct arrival coarse;
    struct pell_vec3 t, b;

    (void) worker;
    if (!make_photon(s, photon_index, s->in->num_samples, &coarse))
        return;
    vec3_basis(coarse.sample->normal, &t, &b);
    for (int c = 0; c < 3; c++)
        coarse.power[c] /= PARTS;
    for (int first = 0; first < PARTS; first += 16) {
        _Alignas(64) int valid[16] = { 0 };
        struct photon_packet f;
        memset(&f, 0, sizeof(f));
        for (int i = 0; i < 16; i++) {
            const uint32_t k = (uint32_t) (first + i), hash = pell_hash(s->in->p.seed ^ ((uint32_t) photon_index * PARTS + k));
            const float x = ((float) k + 0.5f) / PARTS - 0.5f, y = pell_unit_float(pell_sobol0(k)) - 0.5f;
            const struct pell_vec3 aside = vec3_mul(vec3_mad(vec3_mul(t, x), y, b), coarse.sample->spacing);
            struct arrival from = coarse;
            from.at = vec3_add(coarse.at, aside);
            if (coarse.distance < INFINITY) {
                const struct pell_vec3 to = vec3_sub(vec3_mul(coarse.v, coarse.distance), aside);
                from.distance = vec3_length(to);
                from.v = vec3_mul(to, from.distance > 0.0f ? 1.0f / from.distance : 0.0f);
            }
            if (emit(s, &from, hash, &f, i))
                valid[i] = -1;
        }
        trace16(s, &f, valid, s->parts + (size_t) index * PARTS + (size_t) first);
    }
}

/* Finds the photons that land among much finer samples, and replaces them by parts. */
static enum pell_result subdivide_coarse(struct photon_pass *s, struct pell_pool *pool)
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
    pell_pool_run(pool, (int) s->num_coarse, emit_parts, s);
    return PELL_OK;

fail:
    return res;
}

/* Distributes the power of a photon over the samples around it. */
static void deposit(const struct pell_indirect *in, const struct photon *p, float (*sum)[3])
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

/* Measures the area over which each sample collects photons: what deposit() gives it of uniform light. */
static void measure_areas(struct pell_indirect *in)
{
    for (size_t i = 0; i < in->num_samples; i++)
        for (int c = 0; c < 3; c++)
            in->area[i][c] = 0.0f;
    for (size_t i = 0; i < in->num_samples && !pell_cancelled_at(in->ctx, i); i++) {
        const struct indirect_sample *q = &in->samples[i];
        const float area = q->spacing * q->spacing;
        const struct photon p = { q->mesh, q->triangle, q->u, q->v, q->back, { area, area, area } };
        deposit(in, &p, in->area);
    }
}

enum pell_result indirect_specular_make(struct pell_indirect *in)
{
    bool any = false;

    for (size_t i = 0; i < in->p.scene->num_materials; i++)
        any |= !in->p.scene->materials[i].opaque;
    if (!any)
        return PELL_OK;
    in->reflected = pell_calloc(in->ctx, in->num_samples, sizeof(*in->reflected));
    in->previous = pell_alloc_array(in->ctx, in->num_samples, sizeof(*in->previous));
    in->area = pell_alloc_array(in->ctx, in->num_samples, sizeof(*in->area));
    if (!in->reflected || !in->previous || !in->area)
        return PELL_ERR_NOMEM;
    measure_areas(in);
    return PELL_OK;
}

enum pell_result indirect_specular_light(struct pell_indirect *in, struct pell_pool *pool)
{
    const size_t groups = (in->num_samples + 16 / PHOTONS - 1) / (16 / PHOTONS);
    struct photon_pass s = { .in = in };
    struct pell_light_sampler *lights = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!in->reflected)
        return PELL_OK;
    if (!(s.photons = pell_alloc_array(in->ctx, groups, 16 * sizeof(*s.photons))))
        goto fail;
    PELL_TRY(pell_light_sampler_create(in->ctx, in->p.scene, &lights));
    s.lights = lights;
    pell_pool_run(pool, (int) ((in->num_samples + CHUNK - 1) / CHUNK), emit_chunk, &s);
    PELL_TRY(subdivide_coarse(&s, pool));
    memset(in->reflected, 0, in->num_samples * sizeof(*in->reflected));
    for (size_t i = 0; i < in->num_samples * PHOTONS && !pell_cancelled_at(in->ctx, i); i++)
        if (s.photons[i].mesh != PELL_NO_HIT)
            deposit(in, &s.photons[i], in->reflected);
    for (size_t i = 0; i < s.num_coarse * PARTS && !pell_cancelled_at(in->ctx, i); i++)
        if (s.parts[i].mesh != PELL_NO_HIT)
            deposit(in, &s.parts[i], in->reflected);
    for (size_t i = 0; i < in->num_samples; i++)
        for (int c = 0; c < 3; c++)
            in->reflected[i][c] /= fmaxf(in->area[i][c], MIN_AREA * in->samples[i].spacing * in->samples[i].spacing);

fail:
    pell_light_sampler_destroy(&lights);
    pell_free(in->ctx, s.photons);
    pell_free(in->ctx, s.coarse);
    pell_free(in->ctx, s.parts);
    return res;
}
