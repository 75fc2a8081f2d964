/* SPDX-License-Identifier: MIT
 * light_points.c - places on the lamps of a scene, and what they send to the pixels of a packet. */
#include "methods/layered/state.h"

#include "base/hash.h"

enum { ENVIRONMENT = 4 }; /* directions to an environment for each place on a lamp */

static double fraction(double x)
{
    return x - floor(x);
}

/* Points of the unit square that are spread well for any number of them (M. Roberts 2018, "The Unreasonable Effectiveness of Quasirandom
 * Sequences"); the first is the middle. */
static void spread(double number, double u[3])
{
    u[0] = fraction(0.5 + number * 0.8191725133961645);
    u[1] = fraction(0.5 + number * 0.6710436067037893);
    u[2] = fraction(0.5 + number * 0.5497004779019703);
}

static void add_lamp(struct layered_state *st, const struct pell_scene *scene, size_t index, const struct pell_emitters *lamp, int each)
{
    const struct pell_light *light = &scene->lights[index];
    const bool sky = light->type == PELL_LIGHT_ENVIRONMENT;
    const bool face = light->type == PELL_LIGHT_RECT || light->type == PELL_LIGHT_DISC;
    const int count = sky ? ENVIRONMENT * each : face ? each : 1;

    for (int i = 0; i < count && pell_emitters_count(lamp) > 0; i++) {
        struct layered_source *s = &st->sources[st->num_sources];
        const struct pell_vec3 nowhere = { 0 };
        double u[3];
        spread((double) i, u);
        *s = (struct layered_source){ .lamp = lamp, .face = face && each > 1, .number = i, .of = count, .scale = 1.0f, .light = index };
        if (!pell_emitters_sample(lamp, nowhere, u, &s->sample))
            continue;
        s->even = !light->image && (s->sample.away || (light->type == PELL_LIGHT_POINT && !(light->range > 0.0f)));
        if (sky) {
            s->even = true;
            s->scale = (float) fmin(1.0 / (s->sample.pdf * count), 1e12);
        } else if (face) {
            s->scale = (float) (1.0 / (s->sample.pdf * count));
        }
        if (s->even)
            pell_emitters_power_at(lamp, &s->sample, nowhere, s->power);
        st->num_sources++;
    }
}

enum pell_result layered_make_lamps(struct layered_state *st, const struct pell_scene *scene)
{
    const int each = st->knobs.lamps;
    struct pell_scene alone = *scene;
    enum pell_result res = PELL_ERR_NOMEM;

    st->lamps = pell_calloc(st->ctx, scene->num_lights + 1, sizeof(*st->lamps));
    st->sources = pell_calloc(st->ctx, scene->num_lights * ENVIRONMENT + 1, (size_t) each * sizeof(*st->sources));
    if (!st->lamps || !st->sources)
        goto fail;
    for (size_t i = 0; i < scene->num_lights; i++) {
        alone.lights = scene->lights + i;
        alone.num_lights = 1;
        PELL_TRY(pell_emitters_create(st->ctx, &alone, &st->lamps[i]));
        st->num_lamps = i + 1;
        add_lamp(st, scene, i, st->lamps[i], each);
    }
    return PELL_OK;

fail:
    return res;
}

bool layered_set_power(const struct layered_state *st, const struct layered_source *s, const struct layered_packet *p,
                       struct layered_lamp *lamp)
{
    const int sample = st->in->sample;
    bool some = false;

    lamp->away = s->sample.away;
    for (int i = 0; i < p->count; i++) {
        struct pell_emitter_sample one = s->sample;
        float power[3] = { s->power[0], s->power[1], s->power[2] }, scale = s->scale;
        if (s->face) {
            const uint32_t hash = pell_hash((uint32_t) p->at[i] ^ pell_hash(st->in->seed));
            double u[3];
            spread((double) s->number + (double) sample * s->of + (double) (hash >> 8) * (1.0 / 64.0), u);
            if (!pell_emitters_sample(s->lamp, layered_lane3(p->p, i), u, &one))
                scale = 0.0f;
        }
        if (!s->even)
            pell_emitters_power_at(s->lamp, &one, layered_lane3(p->p, i), power);
        if (!one.away && !one.delta) {
            const struct pell_vec3 d = vec3_normalize(vec3_sub(layered_lane3(p->p, i), one.at));
            scale *= fmaxf(0.0f, vec3_dot(one.normal, d));
        }
        for (int c = 0; c < 3; c++) {
            const float value = power[c] * scale;
            lamp->power[c][i] = value > 0.0f ? value < 1e25f ? value : 1e25f : 0.0f;
            some = some || lamp->power[c][i] > 0.0f;
        }
        lamp->to[0][i] = one.away ? one.toward.x : one.at.x;
        lamp->to[1][i] = one.away ? one.toward.y : one.at.y;
        lamp->to[2][i] = one.away ? one.toward.z : one.at.z;
    }
    return some;
}
