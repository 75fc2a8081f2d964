/* SPDX-License-Identifier: MIT
 * light_points.c - sample points on the lights of a scene, and the light they send to the pixels of a packet. */
#include "methods/layered/state.h"

#include "base/hash.h"

enum {
    ENVIRONMENT = 4, /* directions to an environment per point on another light */
    MAX_SETS = 64,   /* sets of such directions, one for each multisample of a pixel */
};

static double fraction(double x)
{
    return x - floor(x);
}

/* A low-discrepancy sequence in the unit square, well distributed for any number of points (M. Roberts 2018, "The Unreasonable
 * Effectiveness of Quasirandom Sequences"); the first point is the centre. u[0] chooses between lights, and each sampler has one. */
static void spread(double index, double u[3])
{
    u[0] = 0.5;
    u[1] = fraction(0.5 + index * 0.7548776662466927);
    u[2] = fraction(0.5 + index * 0.5698402909980532);
}

/* The distance of n step from an integer times n, the least of all n < count: large where the points i step modulo 1 are evenly spaced. */
static double evenness(double step, int count)
{
    double least = 1.0;

    for (int n = 1; n < count; n++) {
        const double at = fraction(n * step);
        least = fmin(least, n * fmin(at, 1.0 - at));
    }
    return least;
}

/* Point i of a lattice has the coordinates (i + 1/2)/(sets count) and i step modulo 1, and is in set i modulo `sets`. The steps with which
 * each set is a spiral by the golden ratio are (golden ratio + k)/sets; returns the one with the most even lattice. */
static double lattice_step(int sets, int count)
{
    const double golden = 0.6180339887498949;
    double best = golden, most = 0.0;

    for (int k = 0; k < sets; k++) {
        const double step = (golden + k) / sets, value = evenness(step, sets * count);
        if (value > most) {
            most = value;
            best = step;
        }
    }
    return best;
}

/* Multisamples of a pixel use different directions: a set is the same for all pixels, and its error depends on the surface's direction. */
static int sets_of(const struct layered_state *st, const struct pell_light *light)
{
    const int samples = st->services->settings->msaa;

    return light->type != PELL_LIGHT_ENVIRONMENT ? 1 : samples < MAX_SETS ? samples : MAX_SETS;
}

static void add_light(struct layered_state *st, const struct pell_scene *scene, size_t index, const struct pell_light_sampler *sampler,
                      int each)
{
    const struct pell_light *light = &scene->lights[index];
    const bool environment = light->type == PELL_LIGHT_ENVIRONMENT;
    const bool area_light = light->type == PELL_LIGHT_RECT || light->type == PELL_LIGHT_DISC;
    const int count = environment ? ENVIRONMENT * each : area_light ? each : 1, sets = sets_of(st, light), all = sets * count;
    const double step = environment ? lattice_step(sets, count) : 0.0;

    for (int i = 0; i < all && pell_light_sampler_count(sampler) > 0; i++) {
        struct layered_light_point *s = &st->light_points[st->num_light_points];
        const struct pell_vec3 nowhere = { 0 };
        double u[3] = { 0.5, (i + 0.5) / all, fraction(i * step) };
        if (!environment)
            spread((double) i, u);
        *s = (struct layered_light_point) {
            .sampler = sampler,
            .per_pixel = area_light && each > 1,
            .index = i,
            .count = count,
            .set = i % sets,
            .sets = sets,
            .scale = 1.0f,
            .light = index,
        };
        if (!pell_light_sampler_sample(sampler, nowhere, u, &s->sample))
            continue;
        s->uniform = !light->image && (s->sample.distant || (light->type == PELL_LIGHT_POINT && !(light->range > 0.0f)));
        if (environment) {
            s->uniform = true;
            s->scale = (float) fmin(1.0 / (s->sample.pdf * count), 1e12);
        } else if (area_light) {
            s->scale = (float) (1.0 / (s->sample.pdf * count));
        }
        if (s->uniform)
            pell_light_sampler_power_at(sampler, &s->sample, nowhere, s->power);
        st->num_light_points++;
    }
}

enum pell_result layered_make_lights(struct layered_state *st, const struct pell_scene *scene)
{
    const int each = st->knobs.light_samples;
    struct pell_scene alone = *scene;
    size_t sets = 1;
    enum pell_result res = PELL_ERR_NOMEM;

    for (size_t i = 0; i < scene->num_lights; i++)
        sets += ENVIRONMENT * (size_t) sets_of(st, &scene->lights[i]);
    st->samplers = pell_calloc(st->ctx, scene->num_lights + 1, sizeof(*st->samplers));
    st->light_points = pell_calloc(st->ctx, sets, (size_t) each * sizeof(*st->light_points));
    if (!st->samplers || !st->light_points)
        goto fail;
    for (size_t i = 0; i < scene->num_lights; i++) {
        alone.lights = scene->lights + i;
        alone.num_lights = 1;
        PELL_TRY(pell_light_sampler_create(st->ctx, &alone, &st->samplers[i]));
        st->num_samplers = i + 1;
        add_light(st, scene, i, st->samplers[i], each);
    }
    return PELL_OK;

fail:
    return res;
}

bool layered_set_power(const struct layered_state *st, const struct layered_light_point *s, const struct layered_packet *p,
                       struct layered_light *source)
{
    const int sample = st->in->sample;
    bool any = false;

    if (sample % s->sets != s->set)
        return false;
    source->distant = s->sample.distant;
    for (int i = 0; i < p->count; i++) {
        struct pell_light_sample one = s->sample;
        float power[3] = { s->power[0], s->power[1], s->power[2] }, scale = s->scale;
        if (s->per_pixel) {
            const uint32_t hash = pell_hash((uint32_t) p->at[i] ^ pell_hash(st->in->seed));
            double u[3];
            spread((double) s->index + (double) sample * s->count + (double) (hash >> 8) * (1.0 / 64.0), u);
            if (!pell_light_sampler_sample(s->sampler, layered_lane3(p->p, i), u, &one))
                scale = 0.0f;
        }
        if (!s->uniform)
            pell_light_sampler_power_at(s->sampler, &one, layered_lane3(p->p, i), power);
        if (!one.distant && !one.delta) {
            const struct pell_vec3 d = vec3_normalize(vec3_sub(layered_lane3(p->p, i), one.at));
            scale *= fmaxf(0.0f, vec3_dot(one.normal, d));
        }
        for (int c = 0; c < 3; c++) {
            const float value = power[c] * scale;
            source->power[c][i] = value > 0.0f ? value < 1e25f ? value : 1e25f : 0.0f;
            any = any || source->power[c][i] > 0.0f;
        }
        source->to[0][i] = one.distant ? one.toward.x : one.at.x;
        source->to[1][i] = one.distant ? one.toward.y : one.at.y;
        source->to[2][i] = one.distant ? one.toward.z : one.at.z;
    }
    return any;
}
