/* SPDX-License-Identifier: MIT
 * test_contract_scene.c - what every method and reference owes of a whole scene, on every engine that it has: run over the registry, so
 * that a method that is added to the list is tested from then on. Properties of planes alone are in test_contract.c. */
#include "method_form.h"

/* Two slabs 80 mm wide and 0.1 mm apart, side by side before the camera, of a medium in which light goes some millimetres. */
static void slabs(struct stage *s, enum pell_engine engine, const size_t material[2], const int object[2])
{
    assert_int_equal(pell_device_engine(s->device), engine);
    stage_box(s, material[0], object[0], vec3(-80.05f, -30.0f, -10.0f), vec3(-0.05f, 30.0f, 0.0f));
    stage_box(s, material[1], object[1], vec3(0.05f, -30.0f, -10.0f), vec3(80.05f, 30.0f, 0.0f));
    stage_light(s, PELL_LIGHT_POINT, vec3(-12.0f, 0.0f, 20.0f), vec3(0, 0, 0), 50.0f);
    stage_camera(s, vec3(0.0f, 0.0f, 200.0f), vec3(0, 0, 0), 0.0f, 24.0f);
}

enum slabs { SHARED, NAMED, ONE_OBJECT };

static struct shot shot_of_slabs(const struct pell_method *method, enum pell_engine engine, enum slabs which)
{
    const int object[2] = { 0, which != ONE_OBJECT };
    size_t material[2];
    struct stage s;
    struct shot shot;

    stage_start(&s, 32, 24);
    stage_medium(&s, "marble", &material[0]);
    material[1] = material[0];
    if (which == NAMED)
        stage_medium(&s, "marble", &material[1]);
    slabs(&s, engine, material, object);
    shot = stage_shot_of(&s, method->name, method_form(method));
    stage_finish(&s);
    return shot;
}

/* No light goes through a medium from one object to another, whether each has a material of its own or both share one. */
static void objects_that_share_a_material_do_not_share_light(void **state)
{
    int bleed = 0;

    (void) state;
    FOR_EACH_METHOD_AND_ENGINE(method, engine)
    {
        struct shot shared = shot_of_slabs(method, engine, SHARED), named = shot_of_slabs(method, engine, NAMED);
        struct shot one = shot_of_slabs(method, engine, ONE_OBJECT);
        if (!shot_equal(&shared, &named))
            fail_msg("%s: two objects of one material are not what they are under two names", method->name);
        bleed += !shot_equal(&shared, &one);
        shot_free(&shared);
        shot_free(&named);
        shot_free(&one);
    }
    REQUIRE(bleed >= 2); /* parts of one object exchange light across the gap: the scene is one in which it shows */
}

/* A ball and a slab of a medium whose light goes `reach` times as far as marble's, at a strength. */
static struct shot shot_of_strength(const struct pell_method *method, enum pell_engine engine, double reach, float strength)
{
    struct pell_material *m;
    struct stage s;
    struct shot shot;
    size_t material;

    stage_start(&s, 32, 24);
    assert_int_equal(pell_device_engine(s.device), engine);
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
    shot = stage_shot_of(&s, method->name, method_form(method));
    stage_finish(&s);
    return shot;
}

/* A constant strength is a medium in which light goes as much less far: for methods that walk by coefficients to the bit, as 1/2 is exact;
 * for those with profiles to what their tables hold. */
static void a_constant_strength_scales_every_method(void **state)
{
    (void) state;
    FOR_EACH_METHOD_AND_ENGINE(method, engine)
    {
        struct shot half = shot_of_strength(method, engine, 2.0, 0.5f), plain = shot_of_strength(method, engine, 1.0, 1.0f);
        struct shot full = shot_of_strength(method, engine, 2.0, 1.0f);
        const struct difference d = shot_difference(&plain, &half), ignored = shot_difference(&plain, &full);
        print_message("# %s: rms %.5f, %.5f where strength is left out\n", method->name, d.rms, ignored.rms);
        REQUIRE(ignored.rms > 0.0);
        REQUIRE(d.rms <= 0.25 * ignored.rms);
        shot_free(&half);
        shot_free(&plain);
        shot_free(&full);
    }
}

/* A slab whose material has, of one input, a map that varies (`varied`) or a constant. */
static struct shot shot_of_input(const struct pell_method *method, enum pell_engine engine, unsigned input, bool varied)
{
    static const uint8_t steps[2 * 2 * 4] = { 250, 120, 40, 255, 60, 200, 130, 255, 30, 90, 220, 255, 180, 40, 90, 255 };
    uint8_t pixels[sizeof(steps)];
    struct pell_mesh *mesh;
    struct pell_material *m;
    struct pell_texture_map map = { .matrix = { 1, 0, 0, 0, 1, 0 } };
    struct stage s;
    struct shot shot;
    size_t material;

    stage_start(&s, 32, 24);
    assert_int_equal(pell_device_engine(s.device), engine);
    for (size_t i = 0; i < sizeof(pixels); i++)
        pixels[i] = varied ? steps[i] : input == PELL_IGNORES_NORMAL_MAP && i % 4 == 2 ? 255 : 128;
    map.texture = shapes_texture(s.scene, 2, 2, 4, false, pixels);
    m = stage_medium(&s, "marble", &material);
    switch (input) {
    case PELL_IGNORES_STRENGTH_MAP: m->strength_map = map; break;
    case PELL_IGNORES_COLOR_MAP:
        m->color_from = PELL_COLOR_FROM_TEXTURE;
        m->base_color_map = map;
        break;
    case PELL_IGNORES_NORMAL_MAP: m->normal_map = map; break;
    }
    mesh = shapes_box(s.scene, material, vec3(-12.0f, -30.0f, -30.0f), vec3(12.0f, 30.0f, 0.0f));
    mesh->uv[0] = pell_calloc(s.ctx, mesh->num_vertices, 2 * sizeof(float));
    for (uint32_t i = 0; i < mesh->num_vertices; i++) {
        mesh->uv[0][2 * i] = 0.5f + mesh->position[3 * i] / 26.0f;
        mesh->uv[0][2 * i + 1] = 0.5f + mesh->position[3 * i + 1] / 26.0f;
    }
    stage_light(&s, PELL_LIGHT_POINT, vec3(-8.0f, 0.0f, 6.0f), vec3(0, 0, 0), 50.0f);
    stage_camera(&s, vec3(0.0f, 0.0f, 200.0f), vec3(0, 0, 0), 0.0f, 24.0f);
    shot = stage_shot_of(&s, method->name, method_form(method));
    if (varied) {
        const bool warned = strstr(s.kept.last_warning, pell_ignored_name(input)) != NULL;
        if (warned != ((method->ignores & input) != 0))
            fail_msg("%s: %s and its warning do not agree: \"%s\"", method->name, pell_ignored_name(input), s.kept.last_warning);
    }
    stage_finish(&s);
    return shot;
}

/* What a method says that it ignores changes no bit, and a warning names it; what it does not say changes the picture. */
static void methods_say_what_they_ignore(void **state)
{
    (void) state;
    FOR_EACH_METHOD_AND_ENGINE(method, engine)
    {
        for (unsigned input = 1; pell_ignored_name(input); input <<= 1) {
            struct shot varied = shot_of_input(method, engine, input, true), constant = shot_of_input(method, engine, input, false);
            const bool same = shot_equal(&varied, &constant);
            if (same != ((method->ignores & input) != 0))
                fail_msg("%s %s its %s", method->name, same ? "ignores" : "reads", pell_ignored_name(input));
            shot_free(&varied);
            shot_free(&constant);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(objects_that_share_a_material_do_not_share_light),
        cmocka_unit_test(a_constant_strength_scales_every_method),
        cmocka_unit_test(methods_say_what_they_ignore),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
