/* SPDX-License-Identifier: MIT
 *
 * light_sampling.c - see light_sampling.h. Radiance comes from the irradiance stage's lights and lookups; this file adds the densities.
 *
 * A light is chosen in proportion to its estimated irradiance at a point; a tenth of the choices is uniform, so that no light is missed.
 */
#include "lights/light_sampling.h"
#include "image/color.h"
#include "lights/environment_sampling.h"
#include "lights/lights.h"
#include "shared/light.h"

#include <string.h>

#define UNIFORM_FRACTION 0.1 /* fraction of the choices that is uniform over all lights, because estimates may be wrong */
#define ESTIMATE_FLOOR 0.1   /* least factor, for lights that face away or end before the point: points nearby may still be lit */
#define IMAGE_STEPS 32       /* resolution, per side, for the mean of a projected image */

struct sampled_light {
    struct pell_light_source source; /* not used for the environment */
    bool environment;
    double power;       /* luminance of intensity, irradiance, radiance x area, or the environment's mean irradiance */
    double area;        /* mm^2 */
    double radiance[3]; /* rect, disc */
};

struct pell_light_sampler {
    struct pell_context *ctx;
    struct sampled_light *list;
    size_t count;
    struct pell_environment_sampler environments; /* the last entry of the list, if there are any */
    double min_distance2;                         /* mm^2: lower bound of squared distances, for points at a light */
    double centre[3], radius;                     /* of the scene's bounds: centre and half diagonal, mm */
};

/* --- Lights ---------------------------------------------------------------------------------------------------------------------- */

/* Mean luminance of a projected image under its light's colour. */
static double image_power(const struct pell_light_source *source)
{
    double sum = 0.0;

    for (int y = 0; y < IMAGE_STEPS; y++)
        for (int x = 0; x < IMAGE_STEPS; x++) {
            float rgba[4];
            pell_image_sample(&source->image->image, PELL_WRAP_CLAMP, PELL_WRAP_CLAMP, source->image->nearest,
                              ((float) x + 0.5f) / IMAGE_STEPS, ((float) y + 0.5f) / IMAGE_STEPS, rgba);
            for (int c = 0; c < 3; c++)
                rgba[c] = rgba[c] > 0.0f ? fminf(rgba[c], 1e10f) * source->power[c] : 0.0f;
            sum += (double) pell_luminance(rgba);
        }
    return sum / (IMAGE_STEPS * IMAGE_STEPS);
}

static void add_light(struct pell_light_sampler *e, const struct pell_scene *scene, const struct pell_light *light)
{
    struct sampled_light *out = &e->list[e->count];
    const float *p = light->position, *d = light->direction;

    if (!isfinite(p[0] + p[1] + p[2]) || !isfinite(d[0] + d[1] + d[2]) || !pell_light_source_make(scene, light, 1, &out->source))
        return;
    out->area = (double) out->source.sample_area;
    out->power = out->source.image ? image_power(&out->source) : (double) pell_luminance(out->source.power);
    if (out->source.type == PELL_LIGHT_RECT || out->source.type == PELL_LIGHT_DISC) {
        if (!(out->area > 0.0 && out->area < INFINITY))
            return;
        for (int c = 0; c < 3; c++)
            out->radiance[c] = (double) out->source.power[c] / out->area;
    }
    if (isfinite(out->power))
        e->count++;
}

enum pell_result pell_light_sampler_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_light_sampler **out)
{
    struct pell_light_sampler *e = pell_zalloc(ctx, sizeof(*e));
    const float *low = scene->bounds_min, *high = scene->bounds_max;
    double diagonal2 = 0.0;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!e)
        return PELL_ERR_NOMEM;
    e->ctx = ctx;
    for (int k = 0; k < 3; k++) {
        const double size = (double) high[k] - low[k];
        if (!(size >= 0.0 && size < INFINITY))
            continue;
        e->centre[k] = 0.5 * ((double) high[k] + low[k]);
        diagonal2 += size * size;
    }
    e->radius = diagonal2 > 0.0 ? 0.5 * sqrt(diagonal2) : 1.0;
    e->min_distance2 = 1e-6 * e->radius * e->radius;
    e->list = pell_calloc(ctx, scene->num_lights + 1, sizeof(*e->list));
    if (!e->list)
        goto fail;
    for (size_t i = 0; i < scene->num_lights; i++)
        if (scene->lights[i].type != PELL_LIGHT_ENVIRONMENT)
            add_light(e, scene, &scene->lights[i]);
    PELL_TRY(pell_environment_sampler_make(ctx, scene, &e->environments));
    if (e->environments.irradiance > 0.0)
        e->list[e->count++] = (struct sampled_light) { .environment = true, .power = e->environments.irradiance };
    *out = e;
    return PELL_OK;

fail:
    pell_light_sampler_destroy(&e);
    return res;
}

void pell_light_sampler_destroy(struct pell_light_sampler **light_sampler)
{
    struct pell_light_sampler *e = *light_sampler;

    if (!e)
        return;
    *light_sampler = NULL;
    pell_environment_sampler_finish(e->ctx, &e->environments);
    pell_free(e->ctx, e->list);
    pell_free(e->ctx, e);
}

size_t pell_light_sampler_count(const struct pell_light_sampler *light_sampler)
{
    return light_sampler->count;
}

/* --- Light selection ------------------------------------------------------------------------------------------------------------- */

static double with_floor(double visible)
{
    return ESTIMATE_FLOOR + (1.0 - ESTIMATE_FLOOR) * visible;
}

/* Estimated irradiance of a light around `near`, W/m^2; `min_distance2`: lower bound of the squared distance. Never 0. */
static double estimate(const struct sampled_light *e, struct pell_vec3 near, double min_distance2)
{
    const struct pell_light_source *source = &e->source;
    struct pell_dvec3 d;
    double d2, cosine;

    if (e->environment || source->type == PELL_LIGHT_DIRECTIONAL)
        return e->power;
    d = dvec3_between(near, source->position);
    d2 = dvec3_dot(d, d);
    cosine = d2 > 0.0 ? dvec3_dot(d, dvec3_widen(source->direction)) / sqrt(d2) : 0.0;
    if (e->area > 0.0)
        return e->power * with_floor(fmax(cosine, 0.0)) / (fmax(d2, min_distance2) + e->area);
    return e->power * source->scale / fmax(d2, min_distance2) *
           with_floor((double) pell_light_window((float) fmin(d2, 1e30), source->inv_range)) *
           (source->type == PELL_LIGHT_SPOT ? with_floor((double) pell_light_cone((float) cosine, source->spot_scale, source->spot_offset))
                                            : 1.0);
}

static double estimate_all(const struct pell_light_sampler *e, struct pell_vec3 near, double min_distance2)
{
    double sum = 0.0;

    for (size_t i = 0; i < e->count; i++)
        sum += estimate(&e->list[i], near, min_distance2);
    return sum;
}

static double selection_probability(const struct pell_light_sampler *e, size_t source, struct pell_vec3 near, double min_distance2,
                                    double sum)
{
    const double uniform = 1.0 / (double) e->count;
    return sum > 0.0 && sum < INFINITY
               ? UNIFORM_FRACTION * uniform + (1.0 - UNIFORM_FRACTION) * estimate(&e->list[source], near, min_distance2) / sum
               : uniform;
}

/* Chooses a light by *u, and replaces *u by a new uniform number. */
static size_t choose(const struct pell_light_sampler *e, struct pell_vec3 near, double min_distance2, double *u, double *probability)
{
    const double sum = e->count > 1 ? estimate_all(e, near, min_distance2) : 0.0;
    size_t i = 0;

    for (;; i++) {
        *probability = selection_probability(e, i, near, min_distance2, sum);
        if (*u < *probability || i + 1 == e->count)
            break;
        *u -= *probability;
    }
    *u = fmin(*u / *probability, 1.0 - 1e-16);
    return i;
}

static double choice_probability(const struct pell_light_sampler *e, int source, struct pell_vec3 near, double min_distance2)
{
    return e->count > 1 ? selection_probability(e, (size_t) source, near, min_distance2, estimate_all(e, near, min_distance2)) : 1.0;
}

/* --- Sampling ------------------------------------------------------------------------------------------------------------------- */

static bool is_delta(const struct sampled_light *e)
{
    return !e->environment && !(e->area > 0.0);
}

static bool is_distant(const struct sampled_light *e)
{
    return e->environment || e->source.type == PELL_LIGHT_DIRECTIONAL;
}

/* Samples a point on light `index`; out->pdf excludes the choice of the light. `choice` selects one of several environments. */
static void sample_point_on(const struct pell_light_sampler *e, size_t index, double choice, double u, double v,
                            struct pell_light_sample *out)
{
    const struct sampled_light *l = &e->list[index];
    const struct pell_light_source *source = &l->source;

    memset(out, 0, sizeof(*out));
    out->source = (int) index;
    out->distant = is_distant(l);
    out->delta = is_delta(l);
    out->pdf = 1.0;
    if (l->environment) {
        out->toward = pell_environment_sampler_sample(&e->environments, choice, u, v);
        out->pdf = pell_environment_sampler_density(&e->environments, out->toward);
        return;
    }
    if (out->distant) {
        out->toward = vec3_mul(source->direction, -1.0f);
        return;
    }
    out->at = source->position;
    out->normal = out->delta ? vec3(0.0f, 0.0f, 0.0f) : source->direction;
    if (!out->delta) {
        const bool disc = source->type == PELL_LIGHT_DISC;
        const double r = sqrt(u), x = disc ? r * cos(2.0 * PELL_PI * v) : 2.0 * u - 1.0,
                     y = disc ? r * sin(2.0 * PELL_PI * v) : 2.0 * v - 1.0;
        out->at =
            dvec3_narrow(dvec3_mad(dvec3_mad(dvec3_widen(source->position), x, dvec3_widen(source->right)), y, dvec3_widen(source->up)));
        out->pdf = 1.0 / l->area;
    }
}

bool pell_light_sampler_sample(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, const double u[3],
                               struct pell_light_sample *out)
{
    double choice = u[0], probability;
    size_t i;

    memset(out, 0, sizeof(*out));
    if (light_sampler->count == 0)
        return false;
    i = choose(light_sampler, near, light_sampler->min_distance2, &choice, &probability);
    sample_point_on(light_sampler, i, choice, u[1], u[2], out);
    out->pdf *= probability;
    return out->pdf > 0.0;
}

/* Density of a point, without the choice of the light. */
static double point_pdf(const struct pell_light_sampler *e, const struct pell_light_sample *sample)
{
    const struct sampled_light *l = &e->list[sample->source];
    return l->environment ? pell_environment_sampler_density(&e->environments, sample->toward) : is_delta(l) ? 1.0 : 1.0 / l->area;
}

double pell_light_sampler_pdf(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, const struct pell_light_sample *sample)
{
    return choice_probability(light_sampler, sample->source, near, light_sampler->min_distance2) * point_pdf(light_sampler, sample);
}

/* Emission along a unit direction, without range attenuation. */
static void power_along(const struct pell_light_sampler *e, const struct pell_light_sample *sample, struct pell_vec3 direction,
                        struct pell_vec3 receiver, float power[3])
{
    const struct sampled_light *l = &e->list[sample->source];
    const struct pell_light_source *source = &l->source;
    float projected[3] = { 1.0f, 1.0f, 1.0f };
    double scale = 1.0;

    if (l->environment) {
        pell_environment_sampler_radiance(&e->environments, sample->toward, power);
        return;
    }
    if (l->area > 0.0)
        scale = vec3_dot(source->direction, direction) > 0.0f ? 1.0 : 0.0;
    else if (!is_distant(l))
        scale = (double) source->scale;
    if (source->type == PELL_LIGHT_SPOT)
        scale *= (double) pell_light_cone(vec3_dot(source->direction, direction), source->spot_scale, source->spot_offset);
    if (source->image && scale > 0.0)
        pell_light_source_image(source, sample->at, direction, receiver, projected);
    for (int c = 0; c < 3; c++)
        power[c] = (float) (scale * (double) projected[c] * (l->area > 0.0 ? l->radiance[c] : (double) source->power[c]));
}

void pell_light_sampler_power_at(const struct pell_light_sampler *light_sampler, const struct pell_light_sample *sample,
                                 struct pell_vec3 target, float power[3])
{
    const struct pell_dvec3 d = dvec3_between(target, sample->at);
    const double length = sqrt(dvec3_dot(d, d));
    struct pell_vec3 direction = vec3_mul(sample->toward, -1.0f);
    double window = 1.0;

    if (!sample->distant) {
        direction = length > 0.0 ? dvec3_narrow((struct pell_dvec3) { d.x / length, d.y / length, d.z / length }) : vec3(0.0f, 0.0f, 0.0f);
        window = pell_light_sampler_range(light_sampler, sample->source, length);
    }
    power_along(light_sampler, sample, direction, target, power);
    for (int c = 0; c < 3; c++)
        power[c] *= (float) window;
}

double pell_light_sampler_range(const struct pell_light_sampler *light_sampler, int source, double distance)
{
    const struct sampled_light *l = &light_sampler->list[source];
    if (l->environment || l->source.inv_range <= 0.0f)
        return 1.0;
    return (double) pell_light_window((float) fmin(distance * distance, 1e30), l->source.inv_range);
}

/* --- Rays that hit lights -------------------------------------------------------------------------------------------------------- */

/* Distance along the ray to the front of a rect or disc; INFINITY: none up to `reach`. */
static double intersect(const struct sampled_light *l, struct pell_vec3 x, struct pell_vec3 w, double reach)
{
    const struct pell_dvec3 n = dvec3_widen(l->source.direction), right = dvec3_widen(l->source.right), up = dvec3_widen(l->source.up),
                            d = dvec3_between(x, l->source.position);
    const double facing = -dvec3_dot(n, dvec3_widen(w)), t = facing > 0.0 ? dvec3_dot(n, d) / facing : -1.0;
    struct pell_dvec3 p;
    double a, b;

    if (!(t > 0.0 && t <= reach))
        return INFINITY;
    p = dvec3_mad(d, t, dvec3_widen(w));
    a = dvec3_dot(p, right) / dvec3_dot(right, right);
    b = dvec3_dot(p, up) / dvec3_dot(up, up);
    return (l->source.type == PELL_LIGHT_DISC ? a * a + b * b <= 1.0 : fabs(a) <= 1.0 && fabs(b) <= 1.0) ? t : INFINITY;
}

bool pell_light_sampler_hit(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, struct pell_vec3 x, struct pell_vec3 w,
                            double reach, int k, struct pell_light_hit *hit)
{
    struct pell_light_sample *sample = &hit->sample;
    const struct sampled_light *list = light_sampler->list;
    double last = -1.0, nearest = INFINITY;
    size_t last_at = 0, at = 0;

    for (; k >= 0; k--) { /* the k-th by (distance, index) */
        nearest = INFINITY;
        for (size_t i = 0; i < light_sampler->count; i++) {
            const double t = list[i].area > 0.0 ? intersect(&list[i], x, w, reach) : INFINITY;
            if (t < nearest && (t > last || (t == last && i > last_at))) {
                nearest = t;
                at = i;
            }
        }
        if (nearest == INFINITY)
            break;
        last = nearest;
        last_at = at;
    }
    if (nearest == INFINITY) {
        if (k > 0 || reach != INFINITY || light_sampler->count == 0 || !list[light_sampler->count - 1].environment)
            return false;
        at = light_sampler->count - 1;
    }
    memset(sample, 0, sizeof(*sample));
    sample->source = (int) at;
    sample->distant = list[at].environment;
    if (list[at].environment) {
        sample->toward = w;
    } else {
        sample->at = dvec3_narrow(dvec3_mad(dvec3_widen(x), nearest, dvec3_widen(w)));
        sample->normal = list[at].source.direction;
    }
    hit->distance = nearest;
    power_along(light_sampler, sample, vec3_mul(w, -1.0f), x, hit->radiance);
    sample->pdf = pell_light_sampler_pdf(light_sampler, near, sample);
    return true;
}

/* --- Emission ------------------------------------------------------------------------------------------------------------------- */

/* Directions from a light: the sphere, a cone, or cosine-weighted around the normal. */
struct cone {
    struct pell_dvec3 axis;
    double versine; /* 1 - cosine of the cone's angle; 2: all directions */
    bool cosine;
};

static struct cone make_cone(const struct sampled_light *l, struct pell_vec3 centre, double radius, struct pell_vec3 at)
{
    const struct pell_dvec3 d = dvec3_between(centre, at);
    const double d2 = dvec3_dot(d, d), r2 = radius * radius;
    struct cone cone = { dvec3_widen(l->source.direction), 2.0, false };

    if (d2 > r2 * (1.0 + 1e-9)) {
        const double length = sqrt(d2);
        cone.axis = (struct pell_dvec3) { d.x / length, d.y / length, d.z / length };
        cone.versine = r2 / d2 / (1.0 + sqrt(1.0 - r2 / d2));
    }
    if (l->area > 0.0 && cone.versine > 0.5) {
        cone.axis = dvec3_widen(l->source.direction);
        cone.cosine = true;
    }
    if (l->source.type == PELL_LIGHT_SPOT) {
        const double own = 1.0 + (double) l->source.spot_offset / (double) l->source.spot_scale; /* 1 - cos_outer */
        if (own < cone.versine) {
            cone.axis = dvec3_widen(l->source.direction);
            cone.versine = own;
        }
    }
    return cone;
}

static struct pell_vec3 sample_cone(const struct cone *cone, double u, double v)
{
    const double versine = cone->cosine ? 1.0 - sqrt(1.0 - u) : u * cone->versine, c = 1.0 - versine,
                 s = sqrt(fmax(0.0, versine * (2.0 - versine)));
    struct pell_vec3 t, b;

    vec3_basis(dvec3_narrow(cone->axis), &t, &b);
    return dvec3_narrow(dvec3_mad(dvec3_mad(dvec3_mul(cone->axis, c), s * cos(2.0 * PELL_PI * v), dvec3_widen(t)),
                                  s * sin(2.0 * PELL_PI * v), dvec3_widen(b)));
}

bool pell_light_sampler_emit(const struct pell_light_sampler *light_sampler, struct pell_vec3 centre, double radius, const double u[5],
                             struct pell_light_ray *out)
{
    struct pell_light_sample *sample = &out->sample;
    const struct sampled_light *l;
    double choice = u[0], probability;
    float power[3];
    size_t i;

    if (light_sampler->count == 0 || !(radius > 0.0 && radius < INFINITY))
        return false;
    i = choose(light_sampler, centre, radius * radius, &choice, &probability);
    l = &light_sampler->list[i];
    sample_point_on(light_sampler, i, choice, u[1], u[2], sample);
    out->pdf = sample->pdf;
    sample->pdf *= probability;
    if (sample->distant) {
        const double r = radius * sqrt(u[3]);
        const struct pell_dvec3 off = { centre.x - light_sampler->centre[0], centre.y - light_sampler->centre[1],
                                        centre.z - light_sampler->centre[2] };
        const double back = radius + light_sampler->radius + sqrt(dvec3_dot(off, off));
        struct pell_vec3 t, b;
        vec3_basis(sample->toward, &t, &b);
        out->direction = vec3_mul(sample->toward, -1.0f);
        const struct pell_dvec3 aside = dvec3_mad(dvec3_widen(centre), r * cos(2.0 * PELL_PI * u[4]), dvec3_widen(t));
        out->origin =
            dvec3_narrow(dvec3_mad(dvec3_mad(aside, r * sin(2.0 * PELL_PI * u[4]), dvec3_widen(b)), back, dvec3_widen(sample->toward)));
        out->pdf /= PELL_PI * radius * radius;
    } else {
        const struct cone cone = make_cone(l, centre, radius, sample->at);
        out->direction = sample_cone(&cone, u[3], u[4]);
        out->origin = sample->at;
        out->pdf *=
            cone.cosine ? fmax(dvec3_dot(cone.axis, dvec3_widen(out->direction)), 0.0) / PELL_PI : 1.0 / (2.0 * PELL_PI * cone.versine);
    }
    out->pdf *= probability;
    power_along(light_sampler, sample, out->direction, out->origin, power);
    for (int c = 0; c < 3; c++)
        out->weight[c] = (double) power[c] * (l->area > 0.0 ? (double) vec3_dot(sample->normal, out->direction) : 1.0) / out->pdf;
    return out->pdf > 0.0 && out->weight[0] + out->weight[1] + out->weight[2] > 0.0;
}
