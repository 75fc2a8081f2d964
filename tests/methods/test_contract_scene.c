/* SPDX-License-Identifier: MIT
 * test_contract_scene.c - properties that every method and reference must have on a whole scene, on each of its engines: runs over the
 * registry, so that a newly listed method is tested automatically; built a second time with the papers' settings. Properties on planes
 * alone are in test_contract.c. */
#include "contract.h"
#include "method_form.h"

#include <pthread.h>

#ifndef PAPER
#define PAPER 0 /* 1: the methods with their papers' settings */
#endif

/* The reason why a method is not tested here: NULL, or that its paper's settings equal its own. */
static const char *unfit(const struct pell_method *m)
{
    return PAPER && (m->kind == PELL_KIND_REFERENCE || !(m->knobs && m->knobs[0].name && strcmp(m->knobs[0].name, "as") == 0))
               ? "has one form"
               : NULL;
}

static const char *const *form(const struct pell_method *m)
{
    static _Thread_local const char *knobs[8];
    const char *const *const small = method_form(m);
    size_t n = 0;

    if (PAPER && !unfit(m))
        knobs[n++] = "as=paper";
    for (size_t i = 0; small[i]; i++)
        knobs[n++] = small[i];
    knobs[n] = NULL;
    return knobs;
}

/* On a device that tests use one after another. */
static void start(struct stage *s, const struct party *on, int width, int height, int threads)
{
    stage_start_borrowed(s, stage_shared_device(on->engine, threads), width, height);
    if (PAPER && on->method->paper_settings)
        on->method->paper_settings(&s->settings);
}

/* On a device of its own. */
static void start_alone(struct stage *s, const struct party *on, int width, int height, struct pell_alloc_fault *fault)
{
    stage_start_on(s, on->engine, width, height, 2, fault);
    if (PAPER && on->method->paper_settings)
        on->method->paper_settings(&s->settings);
}

/* Two slabs 80 mm wide and 0.1 mm apart, side by side in front of the camera, of a medium with a diffuse mean free path of some
 * millimetres. */
static void slabs(struct stage *s, const size_t material[2], const int object[2])
{
    stage_box(s, material[0], object[0], vec3(-80.05f, -30.0f, -10.0f), vec3(-0.05f, 30.0f, 0.0f));
    stage_box(s, material[1], object[1], vec3(0.05f, -30.0f, -10.0f), vec3(80.05f, 30.0f, 0.0f));
    stage_light(s, PELL_LIGHT_POINT, vec3(-12.0f, 0.0f, 20.0f), vec3(0, 0, 0), 50.0f);
    stage_camera(s, vec3(0.0f, 0.0f, 200.0f), vec3(0, 0, 0), 0.0f, 24.0f);
}

enum slabs { SHARED, NAMED, ONE_OBJECT };

static struct shot shot_of_slabs(const struct party *on, enum slabs which)
{
    const int object[2] = { 0, which != ONE_OBJECT };
    size_t material[2];
    struct stage s;
    struct shot shot;

    start(&s, on, 32, 24, 2);
    stage_medium(&s, "marble", &material[0]);
    material[1] = material[0];
    if (which == NAMED)
        stage_medium(&s, "marble", &material[1]);
    slabs(&s, material, object);
    shot = stage_shot_of(&s, on->method->name, form(on->method));
    stage_finish(&s);
    return shot;
}

/* No light passes through a medium from one object to another, whether each has its own material or both use one. */
static void objects_that_share_a_material_do_not_share_light(void **state)
{
    const struct party *const on = *state;
    struct shot shared = shot_of_slabs(on, SHARED), named = shot_of_slabs(on, NAMED);

    REQUIRE(shot_equal(&shared, &named));
    shot_free(&shared);
    shot_free(&named);
}

/* The scene would reveal such a leak. */
static void parts_of_an_object_share_light(void **state)
{
    const struct party *const on = *state;
    struct shot shared = shot_of_slabs(on, SHARED), one = shot_of_slabs(on, ONE_OBJECT);

    REQUIRE(!shot_equal(&shared, &one));
    shot_free(&shared);
    shot_free(&one);
}

/* A ball and a slab of a medium whose mean free path is `reach` times marble's, at a strength. */
static struct shot shot_of_strength(const struct party *on, double reach, float strength)
{
    struct pell_material *m;
    struct stage s;
    struct shot shot;
    size_t material;

    start(&s, on, 32, 24, 2);
    m = stage_medium(&s, "marble", &material);
    m->gaussians.count = 0;
    for (int c = 0; c < 3; c++) {
        m->medium.sigma_a[c] /= reach;
        m->medium.sigma_s_reduced[c] /= reach;
    }
    m->strength = strength;
    stage_box(&s, material, 0, vec3(-12.0f, -30.0f, -30.0f), vec3(12.0f, 30.0f, 0.0f));
    stage_light(&s, PELL_LIGHT_POINT, vec3(-8.0f, 0.0f, 6.0f), vec3(0, 0, 0), 50.0f);
    stage_camera(&s, vec3(0.0f, 0.0f, 200.0f), vec3(0, 0, 0), 0.0f, 24.0f);
    shot = stage_shot_of(&s, on->method->name, form(on->method));
    stage_finish(&s);
    return shot;
}

/* A medium that only absorbs reflects at its surface alone, as without a method. */
static void what_does_not_scatter_keeps_its_highlights(void **state)
{
    const struct party *const on = *state;
    double shown[2], reflected = 0.0;

    for (int i = 0; i < 2; i++) {
        struct pell_material *m;
        struct shot shot;
        struct stage s;
        size_t material;

        start(&s, on, 32, 24, 2);
        s.settings.bloom = 0.0f;
        s.settings.specular = 0;
        s.settings.layers = true;
        m = stage_medium(&s, "marble", &material);
        m->gaussians.count = 0;
        m->rho_s = 1.0f;
        m->roughness = 0.4f;
        for (int c = 0; c < 3; c++) {
            m->medium.sigma_a[c] = 2.0;
            m->medium.sigma_s_reduced[c] = 0.0;
        }
        stage_ball(&s, material, 0, vec3(0, 0, -12), 12.0f, 20);
        stage_light(&s, PELL_LIGHT_POINT, vec3(-8.0f, 5.0f, 40.0f), vec3(0, 0, 0), 50.0f);
        stage_camera(&s, vec3(0.0f, 0.0f, 200.0f), vec3(0, 0, 0), 0.0f, 24.0f);
        shot = stage_shot_of(&s, i ? "none" : on->method->name, i ? NULL : form(on->method));
        shown[i] = 0.0;
        for (int y = 0; y < 24; y++)
            for (int x = 0; x < 32; x++) {
                shown[i] += shot_at(&shot, SHOT_G, x, y);
                reflected += i ? shot_at(&shot, SHOT_SPECULAR + 1, x, y) : 0.0;
            }
        shot_free(&shot);
        stage_finish(&s);
    }
    REQUIRE(reflected > 0.0);
    REQUIRE_REL(shown[1], reflected, 1e-5);
    REQUIRE_REL(shown[0], reflected, 0.02);
}

/* A constant strength s is equivalent to a medium with mean free paths multiplied by s. */
static void a_constant_strength_scales_every_method(void **state)
{
    const struct party *const on = *state;
    struct shot half = shot_of_strength(on, 2.0, 0.5f), plain = shot_of_strength(on, 1.0, 1.0f);
    struct shot full = shot_of_strength(on, 2.0, 1.0f);
    const struct difference d = shot_difference(&plain, &half), ignored = shot_difference(&plain, &full);

    print_message("# %s: rms %.5f, %.5f where strength is left out\n", on->method->name, d.rms, ignored.rms);
    REQUIRE(ignored.rms > 0.0);
    REQUIRE(d.rms <= 0.25 * ignored.rms);
    shot_free(&half);
    shot_free(&plain);
    shot_free(&full);
}

/* As 1/2 is exact in floating point, the results are bit-identical. */
static void a_constant_strength_scales_to_the_bit(void **state)
{
    const struct party *const on = *state;
    struct shot half = shot_of_strength(on, 2.0, 0.5f), plain = shot_of_strength(on, 1.0, 1.0f);

    REQUIRE(shot_equal(&half, &plain));
    shot_free(&half);
    shot_free(&plain);
}

/* --- A small scene -------------------------------------------------------------------------------------------------------------------- */

/* Light that a method is known not to compute, and why. */
static const struct promise_exception exceptions[] = {
#if PAPER
    { "screen-space", "parts_of_an_object_share_light", "its level of detail drops blurs as narrow as these are in pixels" },
    { "screen-space", "a_constant_strength_scales_every_method", "its level of detail drops blurs as narrow as these are in pixels" },
    { "image-space", "a_constant_strength_scales_every_method", "its paper has no strength" },
    { "image-space", "another_seed_gives_another_pattern", "its samples are the same in all pictures" },
    { "texture-space", "a_constant_strength_scales_every_method", "its paper has no strength" },
    { "texture-space", "a_constant_strength_scales_to_the_bit", "its paper has no strength" },
    { "texture-space", "light_of_two_lights_is_the_sum", "the light of all passes the thickness that each has" },
#endif
    { "image-space", "a_constant_strength_scales_to_the_bit", "its samples are chosen for the profile as it is at strength 1" },
    { "hierarchical", "a_constant_strength_scales_to_the_bit", "its samples lie as densely as the profile at strength 1 asks for" },
#if !PAPER
    { "screen-space", "light_of_two_lights_is_the_sum", "what goes through thin parts is spread by the mean of its ways" },
    { "convolution", "light_of_two_lights_is_the_sum", "what goes through thin parts is spread by the mean of its ways" },
    { "image-space", "light_of_two_lights_is_the_sum", "what goes through thin parts is spread by the mean of its ways" },
#endif
    { "layered", "parts_of_an_object_share_light", "single scattering leaves at the point that the camera sees" },
    { "single-scatter", "parts_of_an_object_share_light", "single scattering leaves at the point that the camera sees" },
    { "screen-space", "another_seed_gives_another_pattern", "draws no random numbers" },
    { "texture-space", "another_seed_gives_another_pattern", "a point light is no random choice, and no environment is there" },
    { "convolution", "another_seed_gives_another_pattern", "draws no random numbers" },
    { "layered", "another_seed_gives_another_pattern", "a point light is no random choice" },
    { "hierarchical", "another_seed_gives_another_pattern", "its samples on the surface are the same for every seed" },
    { "path-trace", "light_of_two_lights_is_the_sum", "lights are chosen by chance: equal in the mean alone" },
    { "single-scatter", "light_of_two_lights_is_the_sum", "samples end where their error, of all lights together, is small" },
    { 0 },
};

enum lit_by { LIT_BY_BOTH, LIT_BY_POINT, LIT_BY_RECT };

/* A ball above an opaque floor, lit by a point and a rectangle; the diffuse mean free path is a tenth of its radius or more. */
static void ball(struct stage *s, enum lit_by lit_by, float power)
{
    size_t marble, floor;

    stage_medium(s, "marble", &marble);
    stage_opaque(s, 0.5f, &floor);
    stage_ball(s, marble, 0, vec3(0, 0, 0), 10.0f, 8);
    stage_box(s, floor, 1, vec3(-30.0f, -14.0f, -30.0f), vec3(30.0f, -11.0f, 30.0f));
    if (lit_by != LIT_BY_RECT)
        stage_light(s, PELL_LIGHT_POINT, vec3(-20.0f, 25.0f, 20.0f), vec3(0, 0, 0), 2000.0f * power);
    if (lit_by != LIT_BY_POINT)
        stage_light(s, PELL_LIGHT_RECT, vec3(30.0f, 10.0f, 10.0f), vec3(0, 0, 0), 3.0f * power);
    stage_camera(s, vec3(0.0f, 0.0f, 60.0f), vec3(0, 0, 0), 0.5f, 0.0f);
}

static struct shot shot_of_ball(const struct party *on, int threads, int seed, enum lit_by lit_by, float power)
{
    struct stage s;
    struct shot shot;

    start(&s, on, 16, 12, threads);
    s.settings.seed = seed;
    ball(&s, lit_by, power);
    shot = stage_shot_of(&s, on->method->name, form(on->method));
    stage_finish(&s);
    return shot;
}

/* An environment, several samples per pixel, and enough rows for several concurrent tasks. */
static struct shot shot_of_threads(const struct party *on, int threads)
{
    const bool quick = on->method->kind == PELL_KIND_METHOD;
    struct stage s;
    struct shot shot;

    start(&s, on, quick ? 60 : 12, quick ? 45 : 12, threads);
    s.settings.msaa = 2;
    ball(&s, LIT_BY_BOTH, 1.0f);
    stage_environment(&s, 0.2f);
    stage_light(&s, PELL_LIGHT_DISC, vec3(10.0f, 10.0f, -40.0f), vec3(0, 0, 0), 3.0f);
    shot = stage_shot_of(&s, on->method->name, form(on->method));
    stage_finish(&s);
    return shot;
}

static void any_number_of_threads_gives_the_same_bits(void **state)
{
    const struct party *const on = *state;
    struct shot first = shot_of_threads(on, 1);
    const int x = first.width / 2, y = first.height / 2;
    bool same = true;

    for (int threads = SLOW ? 3 : 2; threads <= 3; threads++) {
        struct shot shot = shot_of_threads(on, threads);
        same = same && shot_equal(&first, &shot);
        shot_free(&shot);
    }
    shot_check(&first);
    REQUIRE(shot_at(&first, SHOT_R, x, y) > 0.0);
    REQUIRE(same);
    shot_free(&first);
}

static void another_seed_gives_another_pattern(void **state)
{
    const struct party *const on = *state;
    struct shot first = shot_of_ball(on, 2, 1, LIT_BY_POINT, 1.0f), other = shot_of_ball(on, 2, 2, LIT_BY_POINT, 1.0f);

    REQUIRE(!shot_equal(&first, &other));
    shot_free(&first);
    shot_free(&other);
}

static void twice_the_light_is_twice_the_image(void **state)
{
    const struct party *const on = *state;
    struct shot one = shot_of_ball(on, 2, 1, LIT_BY_BOTH, 1.0f), two = shot_of_ball(on, 2, 1, LIT_BY_BOTH, 2.0f);
    bool twice = true;

    for (size_t i = 0; i < 3 * one.size; i++)
        twice = twice && fabs((double) two.data[i] - 2.0 * (double) one.data[i]) <= 1e-5 * (double) two.data[i];
    REQUIRE(twice);
    shot_free(&one);
    shot_free(&two);
}

static void light_of_two_lights_is_the_sum(void **state)
{
    const struct party *const on = *state;
    struct shot both = shot_of_ball(on, 2, 1, LIT_BY_BOTH, 1.0f), point = shot_of_ball(on, 2, 1, LIT_BY_POINT, 1.0f);
    struct shot rect = shot_of_ball(on, 2, 1, LIT_BY_RECT, 1.0f);
    double worst = 0.0, most = 0.0;

    for (size_t i = 0; i < 3 * both.size; i++) {
        worst = fmax(worst, fabs((double) both.data[i] - (double) point.data[i] - (double) rect.data[i]));
        most = fmax(most, (double) both.data[i]);
    }
    REQUIRE(worst <= 1e-5 * most);
    shot_free(&both);
    shot_free(&point);
    shot_free(&rect);
}

/* Uniform illumination from all directions on a medium with almost no absorption: the mean pixel is no brighter than the illumination
 * itself. */
static void no_more_light_leaves_than_arrives(void **state)
{
    const struct party *const on = *state;
    struct pell_material *m;
    struct stage s;
    struct shot shot;
    size_t milk;
    double sum = 0.0;
    int count = 0;

    start(&s, on, 24, 18, 2);
    s.settings.layers = true;
    s.settings.curvature = !PAPER;
    m = stage_medium(&s, "marble", &milk);
    m->gaussians.count = 0;
    m->rho_s = 1.0f;
    for (int c = 0; c < 3; c++) {
        m->medium.sigma_a[c] = 1e-5;
        m->medium.sigma_s_reduced[c] = 1.0;
    }
    stage_ball(&s, milk, 0, vec3(0, 0, 0), 10.0f, 24);
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3(0.0f, 0.0f, 60.0f), vec3(0, 0, 0), 0.5f, 0.0f);
    shot = stage_shot_of(&s, on->method->name, form(on->method));
    for (size_t i = 0; i < shot.size; i++) {
        if (shot.data[SHOT_TRANSLUCENT * shot.size + i] < 1.0f)
            continue;
        sum += (double) shot.data[SHOT_G * shot.size + i];
        count++;
    }
    print_message("# %s: %.4f of the light leaves\n", on->method->name, sum / count);
    REQUIRE(count > 50 && sum > 0.0);
    REQUIRE(sum / count <= 1.002);
    shot_free(&shot);
    stage_finish(&s);
}

static void a_frame_allocates_nothing(void **state)
{
    const struct party *const on = *state;
    struct stage s;
    uint64_t before;

    start(&s, on, 16, 12, 2);
    ball(&s, LIT_BY_BOTH, 1.0f);
    stage_method(&s, on->method->name, form(on->method));
    stage_render(&s);
    before = pell_allocations(s.ctx);
    stage_render(&s);
    REQUIRE(pell_allocations(s.ctx) == before);
    stage_finish(&s);
}

static void a_size_and_back_gives_the_same_bits(void **state)
{
    const struct party *const on = *state;
    struct shot first, larger, again;
    struct stage s;

    start(&s, on, 16, 12, 2);
    ball(&s, LIT_BY_BOTH, 1.0f);
    first = stage_shot_of(&s, on->method->name, form(on->method));
    s.settings.width = 27;
    s.settings.height = 9;
    larger = stage_shot(&s);
    shot_check(&larger);
    s.settings.width = 16;
    s.settings.height = 12;
    again = stage_shot(&s);
    REQUIRE(shot_equal(&first, &again));
    shot_free(&first);
    shot_free(&larger);
    shot_free(&again);
    stage_finish(&s);
}

/* Every fourth or so of the allocations that renderer, scene and method make. */
static void failed_allocations_leak_nothing(void **state)
{
    const struct party *const on = *state;
    bool done = false;

    for (uint64_t n = 1; !done; n = next_allocation(n)) {
        struct pell_alloc_fault fault = { 0 };
        enum pell_result res;
        struct stage s;
        start_alone(&s, on, 16, 12, &fault);
        ball(&s, LIT_BY_BOTH, 1.0f);
        stage_complete(&s);
        stage_method(&s, on->method->name, form(on->method));
        fault.fail_at = fault.calls + n;
        res = pell_renderer_set_scene(s.r, s.scene);
        if (res == PELL_OK)
            res = pell_renderer_render(s.r, &s.settings, &s.image);
        done = fault.calls < fault.fail_at;
        if (res != (done ? PELL_OK : PELL_ERR_NOMEM))
            fail_msg("%s: allocation %d gives %d", on->method->name, (int) n, (int) res);
        fault.fail_at = 0;
        stage_finish(&s);
        if (fault.live != 0)
            fail_msg("%s: allocation %d leaks", on->method->name, (int) n);
    }
}

struct racer {
    const struct pell_scene *scene;
    const struct pell_method *method;
    struct stage s;
    struct shot shot;
};

static void *race(void *arg)
{
    struct racer *r = arg;

    stage_method(&r->s, r->method->name, form(r->method));
    OK(pell_renderer_set_scene(r->s.r, r->scene));
    OK(pell_renderer_render(r->s.r, &r->s.settings, &r->s.image));
    r->shot = shot_copy(&r->s.image);
    return NULL;
}

static void two_renderers_share_a_scene(void **state)
{
    const struct party *const on = *state;
    struct racer racers[2] = { { .method = on->method }, { .method = on->method } };
    struct shot alone = shot_of_ball(on, 2, 0, LIT_BY_BOTH, 1.0f);

    pthread_t threads[2];
    struct stage owner;
    start_alone(&owner, on, 16, 12, NULL);
    ball(&owner, LIT_BY_BOTH, 1.0f);
    stage_complete(&owner);
    for (int i = 0; i < 2; i++) {
        start_alone(&racers[i].s, on, 16, 12, NULL);
        racers[i].s.settings.seed = 0;
        racers[i].scene = owner.scene;
    }
    for (int i = 0; i < 2; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, race, &racers[i]), 0);
    for (int i = 0; i < 2; i++)
        pthread_join(threads[i], NULL);
    REQUIRE(shot_equal(&racers[0].shot, &alone) && shot_equal(&racers[1].shot, &alone));
    for (int i = 0; i < 2; i++) {
        shot_free(&racers[i].shot);
        stage_finish(&racers[i].s);
    }
    shot_free(&alone);
    stage_finish(&owner);
}

/* "NAME=VALUE" for the i-th choice or bound of a knob; false where there is none, or where the bound only sets the amount of work. */
static bool knob_at_an_end(const struct pell_knob *k, int i, char *text, size_t size)
{
    const double end = i == 0 ? k->min : k->max;

    if (k->type == PELL_KNOB_ENUM)
        return k->choices[i] && snprintf(text, size, "%s=%s", k->name, k->choices[i]) > 0;
    if (i > 1 || ((k->type == PELL_KNOB_INT || k->type == PELL_KNOB_INT64) && i == 1 && end > 64.0))
        return false;
    if (k->type == PELL_KNOB_BOOL)
        return snprintf(text, size, "%s=%d", k->name, i) > 0;
    return snprintf(text, size, "%s=%.9g", k->name, end) > 0;
}

/* Each choice, and the bounds of each range except those that only set the amount of work: one after another with one renderer. */
static void every_knob_at_its_ends_gives_finite_light(void **state)
{
    const struct party *const on = *state;
    char text[80];
    struct stage s;

    start_alone(&s, on, 12, 9, NULL);
    ball(&s, LIT_BY_BOTH, 1.0f);
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    for (const struct pell_knob *k = on->method->knobs; k->type; k++)
        for (int i = 0; knob_at_an_end(k, i, text, sizeof(text)); i++) {
            const char *knobs[6] = { NULL };
            enum pell_result res;
            size_t n = 0;
            for (const char *const *small = form(on->method); small[n]; n++)
                knobs[n] = small[n];
            knobs[n] = text; /* the last setting applies */
            s.kept.errors = 0;
            stage_method(&s, on->method->name, knobs);
            res = pell_renderer_render(s.r, &s.settings, &s.image);
            if (res == PELL_OK) {
                struct shot shot = shot_copy(&s.image);
                shot_check(&shot);
                shot_free(&shot);
            } else if ((res != PELL_ERR_INVALID && !(res == PELL_ERR_UNSUPPORTED && on->engine != PELL_ENGINE_CPU)) || s.kept.errors != 1) {
                fail_msg("%s: %s gives %d", on->method->name, text, (int) res);
            } else {
                print_message("# %s refuses %s: %s\n", on->method->name, text, s.kept.what);
            }
        }
    stage_finish(&s);
}

#define PROMISE(name)                                                                                                                      \
    {                                                                                                                                      \
#name, name, false                                                                                                                 \
    }

int main(int argc, char **argv)
{
    static const struct promise promises[] = {
        PROMISE(objects_that_share_a_material_do_not_share_light),
        PROMISE(parts_of_an_object_share_light),
        PROMISE(a_constant_strength_scales_every_method),
        PROMISE(what_does_not_scatter_keeps_its_highlights),
        PROMISE(any_number_of_threads_gives_the_same_bits),
        PROMISE(a_constant_strength_scales_to_the_bit),
        PROMISE(another_seed_gives_another_pattern),
        PROMISE(twice_the_light_is_twice_the_image),
        PROMISE(light_of_two_lights_is_the_sum),
        PROMISE(no_more_light_leaves_than_arrives),
        PROMISE(a_frame_allocates_nothing),
        PROMISE(a_size_and_back_gives_the_same_bits),
        PROMISE(failed_allocations_leak_nothing),
        PROMISE(two_renderers_share_a_scene),
        PROMISE(every_knob_at_its_ends_gives_finite_light),
        { 0 },
    };
    static const struct contract contract = { promises, exceptions, unfit, NULL };

    const int failed = contract_run(&contract, argc, argv);

    stage_finish_devices();
    return failed;
}
