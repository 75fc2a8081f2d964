/* SPDX-License-Identifier: MIT
 * test_object_materials.c - ids of objects that share a material, up to as many as a frame's plane can hold, and beyond. */
#include "stage.h"

#include "render/object_materials.h"

enum { SIDE = 65 };

/* `count` small boxes on a grid, an object each, of one material. */
static void boxes(struct stage *s, size_t material, int count)
{
    for (int i = 0; i < count; i++) {
        const float x = (float) (i % SIDE - SIDE / 2), y = (float) (i / SIDE - SIDE / 2);
        stage_box(s, material, i, vec3(x, y, -1.0f), vec3(x + 0.9f, y + 0.9f, 0.0f));
    }
}

/* A pair beyond the last id has no id of its own: it keeps the material's. */
static void objects_have_ids_of_their_own_as_far_as_there_are_ids(void **state)
{
    (void) state;
    for (int count = PELL_FRAME_MATERIALS - 1; count <= PELL_FRAME_MATERIALS + 2; count++) {
        const int distinguished = count < PELL_FRAME_MATERIALS ? count : PELL_FRAME_MATERIALS;
        bool seen[PELL_FRAME_MATERIALS + 1] = { false };
        uint16_t index[2] = { 0, 1 };
        struct pell_scene_materials m = { .frame_index = index, .count = 1 };
        struct stage s;
        size_t marble;

        stage_start(&s, 16, 12);
        stage_medium(&s, "marble", &marble);
        boxes(&s, marble, count);
        m.frame = pell_calloc(s.ctx, 1, sizeof(*m.frame));
        OK(pell_object_materials_make(s.ctx, s.scene, &m));
        assert_int_equal(m.count_with_copies, distinguished);
        for (int i = 0; i < distinguished; i++) {
            REQUIRE(m.of_mesh[i] >= 1 && m.of_mesh[i] <= distinguished && !seen[m.of_mesh[i]]);
            seen[m.of_mesh[i]] = true;
        }
        for (int i = distinguished; i < count; i++)
            assert_int_equal(m.of_mesh[i], 1);
        assert_int_equal(s.kept.warnings, count > PELL_FRAME_MATERIALS);
        if (count == PELL_FRAME_MATERIALS + 2)
            REQUIRE(strstr(s.kept.last_warning, "4097 pairs") && strstr(s.kept.last_warning, "distinguish 4095"));
        pell_free(s.ctx, m.frame);
        pell_free(s.ctx, m.of_mesh);
        stage_finish(&s);
    }
}

/* The image is complete, and a warning says how many pairs are distinguished. */
static void a_scene_of_more_objects_than_ids_renders(void **state)
{
    struct stage s;
    struct shot shot;
    size_t marble;

    (void) state;
    stage_start(&s, 130, 130);
    stage_medium(&s, "marble", &marble);
    boxes(&s, marble, SIDE * SIDE);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 2.0f);
    stage_camera(&s, vec3(0.45f, 0.45f, 100.0f), vec3(0.45f, 0.45f, 0.0f), 0.0f, 65.0f);
    shot = stage_shot_of(&s, "screen-space", NULL);
    shot_check(&shot);
    for (int i = 0; i < SIDE * SIDE; i++) /* the middle of each box, in rows of 2 x 2 pixels */
        REQUIRE(shot_at(&shot, SHOT_R, 2 * (i % SIDE) + 1, 2 * (i / SIDE) + 1) > 0.1);
    shot_free(&shot);
    REQUIRE(strstr(s.kept.all_warnings, "4225 pairs of an object and its material, screen-space methods distinguish 4095"));
    stage_finish(&s);
}

static void more_materials_than_ids_are_refused(void **state)
{
    struct stage s;
    size_t marble = 0;

    (void) state;
    stage_start(&s, 16, 12);
    for (int i = 0; i <= PELL_FRAME_MATERIALS; i++)
        stage_medium(&s, "marble", &marble);
    boxes(&s, marble, 1);
    stage_complete(&s);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.5f, 0.0f);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 2.0f);
    assert_int_equal(pell_renderer_set_scene(s.r, s.scene), PELL_ERR_UNSUPPORTED);
    assert_int_equal(s.kept.errors, 1);
    REQUIRE(strstr(s.kept.what, "more than 4095 translucent materials"));
    stage_finish(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(objects_have_ids_of_their_own_as_far_as_there_are_ids),
        cmocka_unit_test(a_scene_of_more_objects_than_ids_renders),
        cmocka_unit_test(more_materials_than_ids_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
