/* SPDX-License-Identifier: MIT
 *
 * scatter.c - light scattered once, at places along the refracted ray of the camera.
 *
 *     L = F_t(w_o)/eta^2 Int_0^S sigma_s e^(-tau(s)) Sum_paths p(w_i, w) E e^(-tau_i) ds
 *
 * S: where the ray leaves the solid; paths: all ways of refraction to the light (transport/refraction/connect.h); E: irradiance of the
 * beam, perpendicular to it, of which the boundary lets F_t through. A place s is drawn for a light's place:
 *
 * - by transmittance: a channel is chosen, then its optical depth;
 * - at equal angles as seen from the light's place (Kulla and Fajardo 2012), which stands still for where its light comes from; evenly, for
 *   lights without a place.
 *
 * Both count by the balance heuristic (Veach and Guibas 1995). A round takes as many of each, and rounds are independent: their spread is
 * the standard error. A round's randomness is a hash of the point's place and of the seed. */
#include "methods/single_scatter/single_scatter.h"

#include "methods/reference_frame.h"
#include "transport/rqmc.h"

#include <string.h>

enum {
    ROUND = 16, /* samples */
    PILOT = 8,  /* rounds that say how many are needed */
    LEAST = 8,  /* rounds of a pixel */
    DARK = 16,  /* rounds where the pilot found no light */
};

/* The refracted ray of the camera, below the surface. */
struct ray {
    const struct single_world *world;
    const struct single_medium *medium;
    int solid;
    double eta;
    struct pell_vec3 at, w; /* w: inward */
    double transmit;        /* F_t / eta^2 */
    float tint[3];          /* of light that leaves there */
    struct single_way way;
    double length;        /* of the way */
    double shade[3];      /* 1 - e^-tau of all of it */
    int lit[3], channels; /* that scatter */
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

/* Multiplies light that passes the boundary there. */
static void tint(const struct single_world *world, uint32_t mesh, uint32_t triangle, float u, float v, bool enters, float light[3])
{
    const struct pell_mesh *m = &world->scene->meshes[mesh];
    const struct pell_tint *t = &world->tint[m->material];
    float color[3];

    if (!t->is)
        return;
    pell_base_color_at(&world->scene->materials[m->material], m, triangle, u, v, color);
    pell_tint_apply(t, color, enters, light);
}

/* Finds the triangle that the camera sees, and where its ray goes below. */
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
    if (!(facing > 0.0)) /* seen from within, or with inverted normals */
        return false;
    cos_o = (double) vec3_dot(n, toward);
    if (!(cos_o > 0.0)) { /* a normal that looks away from where its triangle is seen */
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

/* Of a place by transmittance, 1/mm; `layer` and the optical depths are the place's. */
static double transmittance_density(const struct ray *ray, const struct single_layer *layer, const double depth[3])
{
    double sum = 0.0;

    for (int i = 0; i < ray->channels; i++) {
        const int c = ray->lit[i];
        sum += ray->shade[c] > 1e-9 ? layer->sigma_t[c] * exp(-depth[c]) / ray->shade[c] : 1.0 / ray->length;
    }
    return sum / ray->channels;
}

static double transmittance_place(const struct ray *ray, double pick, double xi)
{
    const int c = ray->lit[pick * ray->channels < ray->channels ? (int) (pick * ray->channels) : ray->channels - 1];

    if (!(ray->shade[c] > 1e-9))
        return xi * ray->length;
    return single_way_find(&ray->way, ray->medium, c, -log1p(-xi * ray->shade[c]));
}

/* Angles under which a light's place sees the way. */
struct angles {
    bool uniform;      /* no place, or one on the ray: evenly by length */
    double foot, away; /* mm along the ray, and from it */
    double first, all;
};

static struct angles angles_of(const struct ray *ray, const struct pell_light_sample *source)
{
    struct angles a = { .uniform = true };
    struct pell_vec3 to, beside;

    if (source->away)
        return a;
    to = vec3_sub(source->at, ray->at);
    a.foot = (double) vec3_dot(to, ray->w);
    beside = vec3_mad(to, (float) -a.foot, ray->w);
    a.away = (double) vec3_length(beside);
    if (!(a.away > 1e-5 * ((double) vec3_length(to) + ray->length)))
        return a;
    a.first = atan(-a.foot / a.away);
    a.all = atan((ray->length - a.foot) / a.away) - a.first;
    a.uniform = !(a.all > 1e-9);
    return a;
}

static double angle_density(const struct ray *ray, const struct angles *a, double s)
{
    return a->uniform ? 1.0 / ray->length : a->away / (a->all * (a->away * a->away + (s - a->foot) * (s - a->foot)));
}

static double angle_place(const struct ray *ray, const struct angles *a, double xi)
{
    const double s = a->uniform ? xi * ray->length : a->foot + a->away * tan(a->first + xi * a->all);
    return fmin(fmax(s, 0.0), ray->length);
}

/* What a light's place brings from a place s of the ray, per mm, to each channel. */
static void bring(const struct ray *ray, const struct pell_light_sample *source, double s, const struct single_layer *layer,
                  const double depth[3], double out[3])
{
    const struct pell_vec3 x = vec3_mad(ray->at, (float) s, ray->w), back = vec3_mul(ray->w, -1.0f);
    struct pell_connection paths[PELL_CONNECTIONS];
    double slowest = INFINITY, reach;
    int n;

    for (int i = 0; i < ray->medium->layers; i++)
        for (int k = 0; k < ray->channels; k++)
            slowest = fmin(slowest, ray->medium->layer[i].sigma_t[ray->lit[k]]);
    reach = slowest > 0.0 ? SINGLE_OPAQUE / slowest : INFINITY;
    n = pell_connect(
        ray->world->connector,
        &(struct pell_connection_query) { ray->solid, ray->eta, x, source->away ? source->toward : source->at, source->away, reach }, paths,
        PELL_CONNECTIONS, &ray->counts->rays);
    for (int i = 0; i < n; i++) {
        const struct pell_connection *p = &paths[i];
        const double cosine = (double) vec3_dot(p->inside, back);
        double beam = p->spread * p->transmit;
        float power[3];
        struct single_way way;
        if (!source->away && !source->delta)
            beam *= fmax(0.0, -(double) vec3_dot(source->normal, p->outside));
        pell_light_sampler_power_at(ray->world->light_sampler, source, p->at, power);
        if (!(beam > 0.0) || !(power[0] + power[1] + power[2] > 0.0f))
            continue;
        single_way_make(ray->world->connector, ray->solid, ray->medium, x, p->inside, p->inside_mm, &way);
        if (way.stretch[way.count - 1].end < p->inside_mm)
            continue;
        tint(ray->world, p->mesh, p->triangle, p->u, p->v, true, power);
        for (int k = 0; k < ray->channels; k++) {
            const int c = ray->lit[k];
            out[c] += layer->sigma_s[c] * pell_phase_value(&layer->phase[c], cosine) * beam * (double) power[c] *
                      exp(-depth[c] - way.stretch[way.count - 1].depth[c]);
        }
    }
}

static void run_round(const struct ray *ray, uint32_t seed, double sum[3])
{
    const int kind = ray->world->knobs.distance;

    for (uint32_t i = 0; i < ROUND; i++) {
        const bool by_angle = kind == SINGLE_EQUIANGULAR || (kind == SINGLE_BOTH && i % 2);
        const double u[3] = { pell_lattice(seed, 0, i), pell_lattice(seed, 1, i), pell_lattice(seed, 2, i) };
        const double xi = kind == SINGLE_BOTH ? (i / 2 + pell_unit_double(pell_hash(seed ^ (0x51ed270bu + i % 2)))) / (ROUND / 2)
                                              : (i + pell_unit_double(pell_hash(seed ^ 0x51ed270bu))) / ROUND;
        double depth[3], density = 0.0, s, light[3] = { 0 };
        const struct single_layer *layer;
        struct pell_light_sample source;
        struct angles angles;
        if (!pell_light_sampler_sample(ray->world->light_sampler, ray->at, u, &source) || !(source.pdf > 0.0))
            continue;
        angles = angles_of(ray, &source);
        s = by_angle ? angle_place(ray, &angles, xi) : transmittance_place(ray, pell_lattice(seed, 3, i), xi);
        layer = &ray->medium->layer[ray->way.stretch[single_way_at(&ray->way, ray->medium, s, depth)].layer];
        if (kind != SINGLE_EQUIANGULAR)
            density += transmittance_density(ray, layer, depth);
        if (kind != SINGLE_TRANSMITTANCE)
            density += angle_density(ray, &angles, s);
        density *= source.pdf * (kind == SINGLE_BOTH ? ROUND / 2 : ROUND);
        if (!(density > 0.0))
            continue;
        bring(ray, &source, s, layer, depth, light);
        for (int c = 0; c < 3; c++)
            sum[c] += ray->transmit * (double) ray->tint[c] * light[c] / density;
    }
    ray->counts->samples += ROUND;
}

/* --- As many as are needed ---------------------------------------------------------------------------------------------------- */

static void run_rounds(const struct ray *ray, uint32_t seed, uint32_t first, int64_t count, struct pell_batches *s)
{
    memset(s, 0, sizeof(*s));
    while (s->count < count && !((s->count & 255) == 0 && pell_cancelled(ray->world->ctx))) {
        double batch[3] = { 0 };
        run_round(ray, pell_hash(seed ^ pell_hash(first + (uint32_t) s->count)), batch);
        pell_batches_add(s, batch);
    }
}

void single_estimate(const struct single_world *world, struct pell_vec3 at, struct pell_vec3 toward, double depth,
                     struct single_counts *counts, float out[3], float standard_error[3])
{
    const int share = world->knobs.half == REFERENCE_WHOLE ? 1 : 2;
    const double most = fmax((double) world->knobs.most / ROUND, LEAST) / share;
    const uint32_t seed = pell_point_seed(at, world->seed);
    double mean[3], spread[3], needed, whole[3];
    struct pell_batches pilot, s;
    struct ray ray;

    for (int c = 0; c < 3; c++)
        out[c] = standard_error[c] = 0.0f;
    counts->pixels++;
    if (!isfinite(at.x + at.y + at.z) || !(depth > 0.0 && depth < 1e15) || pell_light_sampler_count(world->light_sampler) == 0 ||
        !enter(world, at, toward, depth, counts, &ray))
        return;
    single_way_make(world->connector, ray.solid, ray.medium, ray.at, ray.w, ray.length, &ray.way);
    ray.length = ray.way.stretch[ray.way.count - 1].end;
    for (int c = 0; c < 3; c++) {
        bool scatters = false;
        for (int i = 0; i < ray.medium->layers; i++)
            scatters = scatters || ray.medium->layer[i].sigma_s[c] > 0.0;
        if (scatters)
            ray.lit[ray.channels++] = c;
    }
    if (ray.channels == 0 || !(ray.length > 0.0 && ray.length < INFINITY))
        return;
    single_way_at(&ray.way, ray.medium, ray.length, whole);
    for (int c = 0; c < 3; c++)
        ray.shade[c] = -expm1(-whole[c]);
    /* The pilot's rounds say how many are needed and are left out of the mean: rounds that decide when to stop would make it too small. */
    run_rounds(&ray, seed, 0, PILOT / share, &pilot);
    needed = pell_batches_needed(&pilot, world->error, LEAST / share, DARK / share);
    run_rounds(&ray, seed, PILOT, (int64_t) ceil(fmin(needed, most)), &s);
    pell_batches_measure(&s, mean, spread);
    for (int c = 0; c < 3; c++) {
        out[c] = (float) mean[c];
        standard_error[c] = (float) spread[c];
    }
    counts->over += needed > most;
}
