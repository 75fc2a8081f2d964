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
        stage_medium(&s, "marble", &marble)->medium.g[0] = 1e-4 * i;
    boxes(&s, marble, 1);
    stage_complete(&s);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.5f, 0.0f);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 2.0f);
    assert_int_equal(pell_renderer_set_scene(s.r, s.scene), PELL_ERR_UNSUPPORTED);
    assert_int_equal(s.kept.errors, 1);
    REQUIRE(strstr(s.kept.what, "more than 4095 translucent materials"));
    stage_finish(&s);
}

/* A ball of two meshes, whose materials scatter alike but reflect differently. */
static struct shot ball_of_two(const char *method, bool two_materials)
{
    struct stage s;
    struct shot shot;
    struct pell_mesh *half[2];
    size_t first, second;
    uint32_t k;

    stage_start(&s, 32, 32);
    s.settings.opposed = s.settings.curvature = true;
    s.settings.bounces = 1;
    stage_medium(&s, "wax", &first);
    stage_medium(&s, "wax", &second)->rho_s = 0.0f;
    s.scene->materials[first].rho_s = 0.0f;
    for (int i = 0; i < 2; i++) {
        stage_ball(&s, i && two_materials ? second : first, 0, vec3(0, 0, 0), 10.0f, 24);
        half[i] = &s.scene->meshes[s.scene->num_meshes - 1];
        k = half[i]->num_triangles / 2;
        if (i == 1)
            memmove(half[i]->index, half[i]->index + 3 * (size_t) k, 3 * (size_t) (half[i]->num_triangles - k) * sizeof(uint32_t));
        half[i]->num_triangles = i == 0 ? k : half[i]->num_triangles - k;
    }
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(80, 30, 40), vec3(0, 0, 0), 2.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 24.0f);
    shot = stage_shot_of(&s, method, NULL);
    stage_finish(&s);
    return shot;
}

static void two_materials_of_one_medium_are_one_solid(void **state)
{
    static const char *const methods[] = { "screen-space", "hierarchical" };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(methods); i++) {
        struct shot one = ball_of_two(methods[i], false), two = ball_of_two(methods[i], true);
        REQUIRE(shot_mean_green(&one) > 0.05);
        REQUIRE(shot_equal(&one, &two));
        shot_free(&one);
        shot_free(&two);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(objects_have_ids_of_their_own_as_far_as_there_are_ids),
        cmocka_unit_test(a_scene_of_more_objects_than_ids_renders),
        cmocka_unit_test(more_materials_than_ids_are_refused),
        cmocka_unit_test(two_materials_of_one_medium_are_one_solid),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
