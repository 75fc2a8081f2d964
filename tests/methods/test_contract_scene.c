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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(objects_that_share_a_material_do_not_share_light),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
