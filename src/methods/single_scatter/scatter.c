/* SPDX-License-Identifier: MIT
 *
 * scatter.c - single scattering, estimated at sampled points along the refracted camera ray.
 *
 *     L = F_t(w_o)/eta^2 Int_0^S sigma_s e^(-tau(s)) Sum_paths p(w_i, w) E e^(-tau_i) ds
 *
 * S: distance where the ray leaves the solid; paths: all refracted paths to the light (transport/refraction/connect.h); E: irradiance
 * perpendicular to the beam, with the boundary's transmittance F_t. For each light sample one distance s is sampled:
 *
 * - by transmittance: a channel is chosen, then its optical depth;
 * - equi-angularly as seen from the light sample (Kulla and Fajardo 2012), whose position approximates the unknown entry point of its
 *   light; uniformly for distant lights.
 *
 * Both are combined by the balance heuristic (Veach and Guibas 1995). A batch takes the same number of each. Batches are independent: their
 * spread gives the standard error. A batch's random numbers are a hash of the point's position and the seed. */
#include "methods/single_scatter/single_scatter.h"

#include "methods/reference_frame.h"
#include "transport/rqmc.h"

#include <string.h>

enum {
    BATCH_SAMPLES = 16, /* samples per batch */
    PILOT_BATCHES = 8,  /* batches that estimate how many are needed */
    MIN_BATCHES = 8,    /* minimum number of batches per pixel */
    DARK_BATCHES = 16,  /* batches where the pilot found no light */
};

/* The refracted camera ray. */
struct ray {
    const struct single_world *world;
    const struct single_medium *medium;
    int solid;
    double eta;
    struct pell_vec3 at, w; /* entry point and inward direction */
    double transmit;        /* F_t / eta^2 */
    float tint[3];          /* tint of the light that leaves */
    struct single_segments segments;
    double length;               /* mm inside the solid */
    double opacity[3];           /* 1 - e^-tau over the whole ray */
    int scattering[3], channels; /* indices of the channels that scatter, and their number */
    struct single_counts *counts;
};

/* --- Entering ----------------------------------------------------------------------------------------------------------------- */

static bool closest(const struct single_world *world, struct pell_vec3 from, struct pell_vec3 w, double near, double far,
                    struct single_counts *counts, struct pell_ray_hit16 *r)
{
    _Alignas(64) int valid[16] = { -1 };

    memset(r, 0, sizeof(*r));
    r->ray.ox[0] = from.x;
    r->ray.oy[0] = from.y;
    r->ray.oz[0] = from.z;
    r->ray.dx[0] = w.x;
    r->ray.dy[0] = w.y;
    r->ray.dz[0] = w.z;
    r->ray.tnear[0] = (float) near;
    r->ray.tfar[0] = (float) far;
    r->ray.mask[0] = PELL_RAY_ALL;
    pell_rays_closest16(world->rays, valid, true, r);
    counts->rays++;
    return r->hit.mesh[0] != PELL_NO_HIT;
}

/* Applies the boundary's tint to light that crosses it. */
static void tint(const struct single_world *world, uint32_t mesh, uint32_t triangle, float u, float v, bool enters, float light[3])
{
    const struct pell_mesh *m = &world->scene->meshes[mesh];
    const struct pell_tint *t = &world->tint[m->material];
    float color[3];

    if (!t->enabled)
        return;
    pell_base_color_at(&world->scene->materials[m->material], m, triangle, u, v, color);
    pell_tint_apply(t, color, enters, light);
}

/* Finds the visible triangle at `at`, and the refracted camera ray. */
static bool enter(const struct single_world *world, struct pell_vec3 at, struct pell_vec3 toward, double depth,
                  struct single_counts *counts, struct ray *ray)
{
    const double size = fmax(fmax((double) fabsf(at.x), (double) fabsf(at.y)), (double) fabsf(at.z)) + depth;
    struct pell_vec3 n, geometric, in;
    struct pell_ray_hit16 r;
    const struct pell_mesh *m;
    const uint32_t *index;
    double cos_o, cos_i, e = 0.0, facing;
    float u, v;

    for (double reach = 3e-6; reach < 1e-3; reach *= 8.0) {
        e = reach * size;
        if (closest(world, vec3_mad(at, (float) fmin(e, 0.5 * depth), toward), vec3_mul(toward, -1.0f), 0.0, 2.0 * e, counts, &r))
            break;
    }
    if (r.hit.mesh[0] >= world->solids->num_meshes || world->solids->of_mesh[r.hit.mesh[0]] < 0)
        return false;
    memset(ray, 0, sizeof(*ray));
    ray->world = world;
    ray->counts = counts;
    ray->solid = world->solids->of_mesh[r.hit.mesh[0]];
    ray->medium = &world->medium[ray->solid];
    ray->eta = world->knobs.refraction == SINGLE_NONE ? 1.0 : ray->medium->eta;
    u = r.hit.u[0];
    v = r.hit.v[0];
    m = &world->scene->meshes[r.hit.mesh[0]];
    index = m->index + 3 * (size_t) r.hit.triangle[0];
    ray->at = vec3_mul(vec3_load(m->position + 3 * (size_t) index[0]), 1.0f - u - v);
    ray->at =
        vec3_mad(vec3_mad(ray->at, u, vec3_load(m->position + 3 * (size_t) index[1])), v, vec3_load(m->position + 3 * (size_t) index[2]));
    geometric = vec3_normalize(vec3(r.hit.ngx[0], r.hit.ngy[0], r.hit.ngz[0]));
    n = geometric;
    if (world->knobs.normals == SINGLE_SMOOTH) {
        n = vec3_mul(vec3_load(m->normal + 3 * (size_t) index[0]), 1.0f - u - v);
        n = vec3_mad(vec3_mad(n, u, vec3_load(m->normal + 3 * (size_t) index[1])), v, vec3_load(m->normal + 3 * (size_t) index[2]));
        n = vec3_normalize(n);
    }
    facing = (double) vec3_dot(geometric, toward);
    if (!(facing > 0.0)) /* seen from inside, or inverted normals */
        return false;
    cos_o = (double) vec3_dot(n, toward);
    if (!(cos_o > 0.0)) { /* the shading normal faces away from the camera */
        n = geometric;
        cos_o = facing;
    }
    cos_i = 1.0 - (1.0 - cos_o * cos_o) / (ray->eta * ray->eta);
    if (!(cos_i > 0.0))
        return false;
    cos_i = sqrt(cos_i);
    in = vec3_mad(vec3_mul(toward, (float) (-1.0 / ray->eta)), (float) (cos_o / ray->eta - cos_i), n);
    ray->w = vec3_normalize(in);
    facing = -(double) vec3_dot(geometric, ray->w);
    if (!(facing > 0.0))
        return false;
    ray->transmit = ray->eta == 1.0 ? 1.0 : (1.0 - pell_fresnel(ray->eta, cos_o)) / (ray->eta * ray->eta);
    ray->tint[0] = ray->tint[1] = ray->tint[2] = 1.0f;
    tint(world, r.hit.mesh[0], r.hit.triangle[0], u, v, false, ray->tint);
    e = pell_connector_rounding(world->connector, ray->solid) / fmax(facing, 0.02);
    ray->length = closest(world, ray->at, ray->w, e, INFINITY, counts, &r) ? (double) r.ray.tfar[0] : INFINITY;
    return true;
}

/* --- Along the ray ------------------------------------------------------------------------------------------------------------ */

/* Density of the transmittance sampling, 1/mm; `layer` and `depth`, the optical depths, are those of the sampled point. */
static double transmittance_pdf(const struct ray *ray, const struct single_layer *layer, const double depth[3])
{
    double sum = 0.0;

    for (int i = 0; i < ray->channels; i++) {
        const int c = ray->scattering[i];
        sum += ray->opacity[c] > 1e-9 ? layer->sigma_t[c] * exp(-depth[c]) / ray->opacity[c] : 1.0 / ray->length;
    }
    return sum / ray->channels;
}

static double sample_transmittance(const struct ray *ray, double pick, double xi)
{
    const int c = ray->scattering[pick * ray->channels < ray->channels ? (int) (pick * ray->channels) : ray->channels - 1];

    if (!(ray->opacity[c] > 1e-9))
        return xi * ray->length;
    return single_segments_find(&ray->segments, ray->medium, c, -log1p(-xi * ray->opacity[c]));
}

/* Equi-angular sampling: the angles under which a light sample sees the ray. */
struct angles {
    bool uniform;        /* no position, or one on the ray: uniform by length */
    double foot, height; /* of the light from the ray: mm along it, and perpendicular */
    double start, range;
};

static struct angles angles_of(const struct ray *ray, const struct pell_light_sample *source)
{
    struct angles a = { .uniform = true };
    struct pell_vec3 to, perpendicular;

    if (source->distant)
        return a;
    to = vec3_sub(source->at, ray->at);
    a.foot = (double) vec3_dot(to, ray->w);
    perpendicular = vec3_mad(to, (float) -a.foot, ray->w);
    a.height = (double) vec3_length(perpendicular);
    if (!(a.height > 1e-5 * ((double) vec3_length(to) + ray->length)))
        return a;
    a.start = atan(-a.foot / a.height);
    a.range = atan((ray->length - a.foot) / a.height) - a.start;
    a.uniform = !(a.range > 1e-9);
    return a;
}

static double angle_pdf(const struct ray *ray, const struct angles *a, double s)
{
    return a->uniform ? 1.0 / ray->length : a->height / (a->range * (a->height * a->height + (s - a->foot) * (s - a->foot)));
}

static double sample_angle(const struct ray *ray, const struct angles *a, double xi)
{
    const double s = a->uniform ? xi * ray->length : a->foot + a->height * tan(a->start + xi * a->range);
    return fmin(fmax(s, 0.0), ray->length);
}

/* Adds the light that a light sample scatters toward the camera at distance s, per mm, for each channel. */
static void add_light_sample(const struct ray *ray, const struct pell_light_sample *source, double s, const struct single_layer *layer,
                             const double depth[3], double out[3])
{
    const struct pell_vec3 x = vec3_mad(ray->at, (float) s, ray->w), back = vec3_mul(ray->w, -1.0f);
    struct pell_connection paths[PELL_CONNECTIONS];
    double min_sigma_t = INFINITY, reach;
    int n;

    for (int i = 0; i < ray->medium->layers; i++)
        for (int k = 0; k < ray->channels; k++)
            min_sigma_t = fmin(min_sigma_t, ray->medium->layer[i].sigma_t[ray->scattering[k]]);
    reach = min_sigma_t > 0.0 ? SINGLE_OPAQUE / min_sigma_t : INFINITY;
    n = pell_connect(
        ray->world->connector,
        &(struct pell_connection_query) { ray->solid, ray->eta, x, source->distant ? source->toward : source->at, source->distant, reach },
        paths, PELL_CONNECTIONS, &ray->counts->rays);
    for (int i = 0; i < n; i++) {
        const struct pell_connection *p = &paths[i];
        const double cosine = (double) vec3_dot(p->inside, back);
        double beam = p->spread * p->transmit;
        float power[3];
        struct single_segments segments;
        if (!source->distant && !source->delta)
            beam *= fmax(0.0, -(double) vec3_dot(source->normal, p->outside));
        pell_light_sampler_power_at(ray->world->light_sampler, source, p->at, power);
        if (!(beam > 0.0) || !(power[0] + power[1] + power[2] > 0.0f))
            continue;
        single_segments_make(ray->world->connector, ray->solid, ray->medium, x, p->inside, p->inside_mm, &segments);
        if (segments.segment[segments.count - 1].end < p->inside_mm)
            continue;
        tint(ray->world, p->mesh, p->triangle, p->u, p->v, true, power);
        for (int k = 0; k < ray->channels; k++) {
            const int c = ray->scattering[k];
            out[c] += layer->sigma_s[c] * pell_phase_value(&layer->phase[c], cosine) * beam * (double) power[c] *
                      exp(-depth[c] - segments.segment[segments.count - 1].depth[c]);
        }
    }
}

static void run_batch(const struct ray *ray, uint32_t seed, double sum[3])
{
    const int technique = ray->world->knobs.distance;

    for (uint32_t i = 0; i < BATCH_SAMPLES; i++) {
        const bool by_angle = technique == SINGLE_EQUIANGULAR || (technique == SINGLE_BOTH && i % 2);
        const double u[3] = { pell_lattice(seed, 0, i), pell_lattice(seed, 1, i), pell_lattice(seed, 2, i) };
        const double xi = technique == SINGLE_BOTH
                              ? (i / 2 + pell_unit_double(pell_hash(seed ^ (0x51ed270bu + i % 2)))) / (BATCH_SAMPLES / 2)
                              : (i + pell_unit_double(pell_hash(seed ^ 0x51ed270bu))) / BATCH_SAMPLES;
        double depth[3], density = 0.0, s, light[3] = { 0 };
        const struct single_layer *layer;
        struct pell_light_sample source;
        struct angles angles;
        if (!pell_light_sampler_sample(ray->world->light_sampler, ray->at, u, &source) || !(source.pdf > 0.0))
            continue;
        angles = angles_of(ray, &source);
        s = by_angle ? sample_angle(ray, &angles, xi) : sample_transmittance(ray, pell_lattice(seed, 3, i), xi);
        layer = &ray->medium->layer[ray->segments.segment[single_segments_at(&ray->segments, ray->medium, s, depth)].layer];
        if (technique != SINGLE_EQUIANGULAR)
            density += transmittance_pdf(ray, layer, depth);
        if (technique != SINGLE_TRANSMITTANCE)
            density += angle_pdf(ray, &angles, s);
        density *= source.pdf * (technique == SINGLE_BOTH ? BATCH_SAMPLES / 2 : BATCH_SAMPLES);
        if (!(density > 0.0))
            continue;
        add_light_sample(ray, &source, s, layer, depth, light);
        for (int c = 0; c < 3; c++)
            sum[c] += ray->transmit * (double) ray->tint[c] * light[c] / density;
    }
    ray->counts->samples += BATCH_SAMPLES;
}

/* --- Adaptive number of batches ----------------------------------------------------------------------------------------------- */

static void run_batches(const struct ray *ray, uint32_t seed, uint32_t first, int64_t count, struct pell_batches *s)
{
    memset(s, 0, sizeof(*s));
    while (s->count < count && !((s->count & 255) == 0 && pell_cancelled(ray->world->ctx))) {
        double batch[3] = { 0 };
        run_batch(ray, pell_hash(seed ^ pell_hash(first + (uint32_t) s->count)), batch);
        pell_batches_add(s, batch);
    }
}

void single_estimate(const struct single_world *world, struct pell_vec3 at, struct pell_vec3 toward, double depth,
                     struct single_counts *counts, float out[3], float standard_error[3])
{
    const int images = reference_images(world->knobs.half);
    const double most = fmax((double) world->knobs.most / BATCH_SAMPLES, MIN_BATCHES) / images;
    const uint32_t seed = pell_point_seed(at, world->seed);
    double mean[3], spread[3], needed, tau[3];
    struct pell_batches pilot, s;
    struct ray ray;

    for (int c = 0; c < 3; c++)
        out[c] = standard_error[c] = 0.0f;
    counts->pixels++;
    if (!isfinite(at.x + at.y + at.z) || !(depth > 0.0 && depth < 1e15) || pell_light_sampler_count(world->light_sampler) == 0 ||
        !enter(world, at, toward, depth, counts, &ray))
        return;
    single_segments_make(world->connector, ray.solid, ray.medium, ray.at, ray.w, ray.length, &ray.segments);
    ray.length = ray.segments.segment[ray.segments.count - 1].end;
    for (int c = 0; c < 3; c++) {
        bool scatters = false;
        for (int i = 0; i < ray.medium->layers; i++)
            scatters = scatters || ray.medium->layer[i].sigma_s[c] > 0.0;
        if (scatters)
            ray.scattering[ray.channels++] = c;
    }
    if (ray.channels == 0 || !(ray.length > 0.0 && ray.length < INFINITY))
        return;
    single_segments_at(&ray.segments, ray.medium, ray.length, tau);
    for (int c = 0; c < 3; c++)
        ray.opacity[c] = -expm1(-tau[c]);
    /* The pilot batches determine the number of batches and are left out of the mean: including them would bias it low. */
    run_batches(&ray, seed, 0, PILOT_BATCHES / images, &pilot);
    needed = pell_batches_needed(&pilot, world->error, MIN_BATCHES / images, DARK_BATCHES / images);
    run_batches(&ray, seed, PILOT_BATCHES, (int64_t) ceil(fmin(needed, most)), &s);
    pell_batches_measure(&s, mean, spread);
    for (int c = 0; c < 3; c++) {
        out[c] = (float) mean[c];
        standard_error[c] = (float) spread[c];
    }
    counts->over += needed > most;
}
