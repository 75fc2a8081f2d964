/* SPDX-License-Identifier: MIT
 * test_check.c - results of pell_scene_check: volumes, areas, edges, and every kind of problem. */
#include "scene_test.h"

struct checked {
    struct pell_context *ctx;
    struct pell_scene *scene;
    struct pell_scene_report report;
};

static struct checked check(const char *name, const char *text, const struct pell_load_params *params, const struct memory_file *files)
{
    struct checked c = { .ctx = test_context(NULL, NULL) };

    assert_int_equal(load_bytes(c.ctx, name, text, strlen(text), params, files, &c.scene), PELL_OK);
    assert_int_equal(pell_scene_check(c.scene, &c.report), PELL_OK);
    return c;
}

static void finish(struct checked *c)
{
    pell_scene_report_finish(c->ctx, &c->report);
    pell_scene_destroy(&c->scene);
    assert_int_equal(pell_memory_used(c->ctx), 0);
    pell_context_destroy(&c->ctx);
}

static int count(const struct checked *c, enum pell_severity severity)
{
    int n = 0;
    for (size_t i = 0; i < c->report.num_problems; i++)
        n += c->report.problems[i].severity == severity;
    return n;
}

static const struct pell_problem *find(const struct checked *c, const char *what)
{
    for (size_t i = 0; i < c->report.num_problems; i++)
        if (strstr(c->report.problems[i].what, what))
            return &c->report.problems[i];
    fail_msg("no problem says \"%s\"", what);
    return NULL;
}

static void a_cube_is_closed_and_measured(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct checked c = check("cube.obj", CUBE, &params, NULL);
    const struct pell_object_report *o = c.report.objects;
    (void) state;

    assert_int_equal(c.report.num_objects, 1);
    assert_int_equal(c.report.triangles, 12);
    assert_true(o->closed && o->outward);
    assert_int_equal(o->boundary_edges + o->nonmanifold_edges + o->flipped_edges + o->degenerate_triangles, 0);
    assert_int_equal(o->components, 1);
    REQUIRE_REL(o->volume_mm3, 8000.0, 1e-6);
    REQUIRE_REL(o->area_mm2, 2400.0, 1e-6);
    REQUIRE_REL(o->thickness_mm, 2.0 * 8000.0 / 2400.0, 1e-6);
    REQUIRE_NEAR(c.report.bounds_max[0] - c.report.bounds_min[0], 20.0, 1e-5);
    assert_int_equal(count(&c, PELL_SEVERITY_WARNING) + count(&c, PELL_SEVERITY_ERROR), 0);
    assert_int_equal(find(&c, "mean free path")->severity, PELL_SEVERITY_NOTE);
    finish(&c);
}

static void an_open_cube_has_its_boundary_counted(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct checked c = check("cube.obj", CUBE_VERTICES "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\n", &params, NULL);
    (void) state;

    assert_false(c.report.objects[0].closed);
    assert_int_equal(c.report.objects[0].boundary_edges, 4);
    REQUIRE_NEAR(c.report.objects[0].thickness_mm, 0.0, 0);
    assert_int_equal(find(&c, "4 edges have one triangle")->severity, PELL_SEVERITY_WARNING);
    finish(&c);
}

static void a_cube_without_area_is_said_to_have_none(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct checked c = check("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nf 1 2 3\nf 2 3 4\n", &params, NULL);
    (void) state;

    assert_int_equal(c.report.objects[0].degenerate_triangles, 2);
    assert_int_equal(find(&c, "2 of 2 triangles have no area")->severity, PELL_SEVERITY_WARNING);
    finish(&c);
}

/* A flattened tetrahedron: no volume, whatever its normals are. */
static void sides_that_lie_on_each_other_enclose_nothing(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct checked c = check("flat.obj", "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0.5 0.5 0\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1\n", &params, NULL);
    (void) state;

    assert_true(c.report.objects[0].closed && !c.report.objects[0].outward);
    assert_int_equal(find(&c, "encloses no volume")->severity, PELL_SEVERITY_WARNING);
    finish(&c);
}

/* Two nodes with the same mesh at the same position, and a third moved by 0.1 mm or so. */
static void an_object_that_is_there_twice_is_found(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct checked c = check("twice.obj",
                             "o first\n" CUBE "o second\n" CUBE_VERTICES
                             "f 9 12 11 10\nf 13 14 15 16\nf 9 10 14 13\nf 10 11 15 14\nf 11 12 16 15\nf 12 9 13 16\n"
                             "o moved\nv 0 0 0.001\nv 1 0 0.001\nv 0 1 0.001\nv 0 0 1\n"
                             "f 17 19 18\nf 17 18 20\nf 18 19 20\nf 19 17 20\n",
                             &params, NULL);
    (void) state;

    assert_int_equal(c.report.num_objects, 3);
    assert_int_equal(c.report.objects[0].coincident, -1);
    assert_int_equal(c.report.objects[1].coincident, 0);
    assert_int_equal(c.report.objects[2].coincident, -1);
    assert_string_equal(find(&c, "the same surface as \"first\"")->where, "object \"second\"");
    finish(&c);
}

/* A box and the same box rotated about its centre: the sums of their corners are equal. */
static void two_objects_that_cross_are_no_copies(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 1.0, .bare = true };
    struct checked c = check("plus.obj",
                             "o flat\nv -3 -1 -1\nv 3 -1 -1\nv 3 1 -1\nv -3 1 -1\nv -3 -1 1\nv 3 -1 1\nv 3 1 1\nv -3 1 1\n"
                             "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"
                             "o upright\nv -1 -3 -1\nv 1 -3 -1\nv 1 3 -1\nv -1 3 -1\nv -1 -3 1\nv 1 -3 1\nv 1 3 1\nv -1 3 1\n"
                             "f 9 12 11 10\nf 13 14 15 16\nf 9 10 14 13\nf 10 11 15 14\nf 11 12 16 15\nf 12 9 13 16\n",
                             &params, NULL);
    (void) state;

    assert_int_equal(c.report.num_objects, 2);
    assert_int_equal(c.report.objects[1].coincident, -1);
    finish(&c);
}

/* From inside, from outside but within the bounds of both parts, and directly next to a face. */
static void a_camera_inside_an_object_is_found(void **state)
{
    static const struct {
        float at[3];
        bool inside;
    } cases[] = { { { 10, 10, 10 }, true }, { { 1, 19, 1 }, true }, { { 10, 10, 20.01f }, false }, { { 10, 10, -300 }, false } };
    const struct pell_load_params params = { .mm_per_unit = 20.0 };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct checked c = check("cube.obj", CUBE, &params, NULL);
        assert_true(c.scene->num_cameras > 0);
        assert_false(c.report.objects[0].holds_camera);
        pell_scene_report_finish(c.ctx, &c.report);
        memcpy(c.scene->cameras[0].position, cases[i].at, sizeof(cases[i].at));
        assert_int_equal(pell_scene_check(c.scene, &c.report), PELL_OK);
        assert_int_equal(c.report.objects[0].holds_camera, cases[i].inside);
        if (cases[i].inside)
            assert_int_equal(find(&c, "holds the camera")->severity, PELL_SEVERITY_WARNING);
        finish(&c);
    }
}

/* The same places: light that begins in a medium is not rendered. An opaque box may be a room. */
static void a_light_inside_a_translucent_object_is_found(void **state)
{
    static const struct {
        float at[3];
        bool opaque, found;
    } cases[] = { { { 10, 10, 10 }, false, true }, { { 10, 10, 10 }, true, false }, { { 10, 10, 20.01f }, false, false } };
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct checked c = check("cube.obj", CUBE, &params, NULL);
        size_t light;
        assert_int_equal(c.report.objects[0].holds_light, -1);
        pell_scene_report_finish(c.ctx, &c.report);
        assert_int_equal(pell_scene_add_light(c.scene, "sun", &light), PELL_OK);
        c.scene->lights[light].type = PELL_LIGHT_DIRECTIONAL;
        assert_int_equal(pell_scene_add_light(c.scene, "bulb", &light), PELL_OK);
        c.scene->lights[light].type = PELL_LIGHT_POINT;
        memcpy(c.scene->lights[light].position, cases[i].at, sizeof(cases[i].at));
        c.scene->materials[c.scene->meshes[0].material].opaque = cases[i].opaque;
        assert_int_equal(pell_scene_check(c.scene, &c.report), PELL_OK);
        assert_int_equal(c.report.objects[0].holds_light, cases[i].found ? (int) light : -1);
        if (cases[i].found)
            assert_int_equal(find(&c, "light that begins inside a medium is not rendered")->severity, PELL_SEVERITY_WARNING);
        finish(&c);
    }
}

static void fins_flips_and_flat_triangles_are_found(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct checked c = check("cube.obj",
                             "v 0.5 0.5 2\nv 2 0 0\n" /* shifts the indices: */
                             "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
                             "f 3 4 5 6\nf 7 8 9 10\nf 3 4 8 7\nf 4 5 9 8\nf 5 6 10 9\nf 6 3 7 10\n" /* first side flipped */
                             "f 7 8 1\n"                                                             /* a fin on an edge */
                             "f 3 3 4\n",                                                            /* flat */
                             &params, NULL);
    const struct pell_object_report *o = c.report.objects;
    (void) state;

    assert_int_equal(o->flipped_edges, 0); /* it was flipped back */
    assert_int_equal(o->nonmanifold_edges, 1);
    assert_int_equal(o->boundary_edges, 2);
    assert_int_equal(o->degenerate_triangles, 1);
    assert_false(o->closed);
    find(&c, "more than two triangles");
    find(&c, "has no area");
    finish(&c);
    c = check("moebius.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 4 5 2\nf 2 5 6 3\nf 3 6 1 4\n", &params, NULL);
    assert_int_equal(c.report.objects[0].flipped_edges, 1);
    find(&c, "face opposite ways");
    finish(&c);
}

static void objects_are_judged_one_by_one(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct checked c = check("two.obj", "o a\n" CUBE "o b\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n", &params, NULL);
    (void) state;

    assert_int_equal(c.report.num_objects, 2);
    assert_string_equal(c.report.objects[0].name, "a");
    assert_true(c.report.objects[0].closed);
    assert_string_equal(c.report.objects[1].name, "b");
    assert_int_equal(c.report.objects[1].boundary_edges, 3);
    assert_non_null(strstr(find(&c, "3 edges")->where, "\"b\""));
    finish(&c);
}

static void two_meshes_of_one_object_close_each_other(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct checked c = check(
        "cube.obj", CUBE_VERTICES "usemtl a\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nusemtl b\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n", &params, NULL);
    (void) state;

    assert_int_equal(c.scene->num_meshes, 2);
    assert_int_equal(c.report.num_objects, 1);
    assert_true(c.report.objects[0].closed);
    REQUIRE_REL(c.report.objects[0].volume_mm3, 8000.0, 1e-6);
    finish(&c);
}

static void media_that_do_not_fit_their_object_are_named(void **state)
{
    const struct pell_load_params small = { .mm_per_unit = 0.5, .bare = true }, tiny = { .mm_per_unit = 0.01, .bare = true };
    static const struct memory_file files[] = { { "cube.obj", CUBE }, { NULL, NULL } };
    struct checked c = check("cube.obj", CUBE, &small, NULL); /* marble: 0.46 mm in an object of 0.17 mm */
    (void) state;

    assert_int_equal(find(&c, "diffusion does not hold")->severity, PELL_SEVERITY_WARNING);
    finish(&c);
    c = check("cube.obj", CUBE, &tiny, NULL);
    find(&c, "tiny for a translucent object");
    finish(&c);
    c = check(
        "s.json",
        "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"size\":\"90mm\",\"materials\":{\"*\":{\"sigma_a\":[1,1,1],\"sigma_s_reduced\":[0,0,0]}}}",
        &(struct pell_load_params) { .bare = true }, files);
    find(&c, "only absorbs");
    finish(&c);
    c = check("s.json", "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"size\":\"90mm\",\"materials\":{\"*\":{\"opaque\":true}}}",
              &(struct pell_load_params) { .bare = true }, files);
    find(&c, "no material is translucent");
    finish(&c);
    c = check("s.json",
              "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"size\":\"90mm\",\"materials\":{\"*\":{\"opaque\":true}},\"ground\":\"wax\"}", NULL,
              files);
    for (size_t i = 0; i < c.report.num_problems; i++)
        assert_null(strstr(c.report.problems[i].what, "no material is translucent"));
    finish(&c);
    c = check(
        "s.json",
        "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"size\":\"90mm\",\"ground\":true,\"materials\":{\"*\":{\"preset\":\"skin-6gaussian\"}}}",
        NULL, files);
    find(&c, "sum of 6 Gaussians");
    assert_int_equal(c.report.num_objects, 1); /* the ground is not an object */
    assert_int_equal(c.report.triangles, 12);
    finish(&c);
}

static void textures_without_coordinates_are_found(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct checked c = check("cube.obj", CUBE, &params, NULL);
    struct pell_texture *texture;
    (void) state;

    assert_int_equal(pell_scene_add_texture(c.scene, "t", &texture), PELL_OK);
    c.scene->materials[0].base_color_map.texture = texture;
    pell_scene_report_finish(c.ctx, &c.report);
    assert_int_equal(pell_scene_check(c.scene, &c.report), PELL_OK);
    find(&c, "has no texture coordinates");
    finish(&c);
}

static void many_problems_of_one_kind_are_counted(void **state)
{
    char *text = malloc(200000), *at = text;
    struct checked c;
    (void) state;

    assert_non_null(text);
    for (int i = 0; i < 100; i++)
        at += sprintf(at, "o t%d\nv 0 0 %d\nv 1 0 %d\nv 0 1 %d\nf -3 -2 -1\n", i, i, i, i);
    c = check("many.obj", text, &bare_mm, NULL);
    assert_int_equal(c.report.num_objects, 100);
    assert_int_equal(count(&c, PELL_SEVERITY_WARNING), 21);
    assert_int_equal(find(&c, "80 more objects that are open")->severity, PELL_SEVERITY_WARNING);
    finish(&c);
    free(text);
}

static void every_failed_allocation_is_survived(void **state)
{
    enum pell_result res = PELL_ERR_NOMEM;
    struct pell_alloc_fault fault = { 0 };
    struct pell_context *ctx = test_context(&fault, NULL);
    struct pell_scene *s;
    struct pell_scene_report report;
    uint64_t calls;
    int64_t live;
    (void) state;

    assert_int_equal(load_text(ctx, "a.obj", "o x\n" CUBE "o y\nv 3 3 3\nv 4 3 3\nv 3 4 3\nf -3 -2 -1\n", &in_mm, &s), PELL_OK);
    calls = atomic_load(&fault.calls);
    live = atomic_load(&fault.live);
    for (uint64_t n = 1; res != PELL_OK; n++) {
        fault.calls = calls;
        fault.fail_at = calls + n;
        res = pell_scene_check(s, &report);
        REQUIRE(res == PELL_OK || res == PELL_ERR_NOMEM);
        pell_scene_report_finish(ctx, &report);
        assert_int_equal(atomic_load(&fault.live), live);
        REQUIRE(n < 500);
    }
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void scans_are_what_they_are_said_to_be(void **state)
{
    static const struct {
        const char *name;
        bool closed;
        int64_t boundary, nonmanifold;
    } assets[] = { { "assets/hand/hand_closed.obj", true, 0, 0 },
                   { "assets/bunny/bunny.obj", true, 0, 0 },
                   { "assets/bunny/bunny_hr.obj", true, 0, 0 },
                   { "assets/spot/spot_triangulated.obj", true, 0, 0 },
                   { "assets/demosthenes/demosthenes-low-res.obj", false, 67, 0 },
                   { "assets/generated/slab_1m_x_1m_x_20mm.obj", true, 0, 0 } };
    const struct pell_load_params params = { .size_mm = 100.0, .bare = true };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(assets); i++) {
        struct checked c = { .ctx = test_context(NULL, NULL) };
        assert_int_equal(pell_scene_load(c.ctx, shared_file(assets[i].name), &params, &c.scene), PELL_OK);
        assert_int_equal(pell_scene_check(c.scene, &c.report), PELL_OK);
        assert_int_equal(c.report.objects[0].closed, assets[i].closed);
        assert_int_equal(c.report.objects[0].components, 1);
        assert_int_equal(c.report.objects[0].boundary_edges, assets[i].boundary);
        assert_int_equal(c.report.objects[0].nonmanifold_edges, assets[i].nonmanifold);
        finish(&c);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cube_is_closed_and_measured),
        cmocka_unit_test(an_open_cube_has_its_boundary_counted),
        cmocka_unit_test(a_cube_without_area_is_said_to_have_none),
        cmocka_unit_test(sides_that_lie_on_each_other_enclose_nothing),
        cmocka_unit_test(an_object_that_is_there_twice_is_found),
        cmocka_unit_test(two_objects_that_cross_are_no_copies),
        cmocka_unit_test(a_camera_inside_an_object_is_found),
        cmocka_unit_test(a_light_inside_a_translucent_object_is_found),
        cmocka_unit_test(fins_flips_and_flat_triangles_are_found),
        cmocka_unit_test(objects_are_judged_one_by_one),
        cmocka_unit_test(two_meshes_of_one_object_close_each_other),
        cmocka_unit_test(media_that_do_not_fit_their_object_are_named),
        cmocka_unit_test(textures_without_coordinates_are_found),
        cmocka_unit_test(many_problems_of_one_kind_are_counted),
        cmocka_unit_test(every_failed_allocation_is_survived),
        cmocka_unit_test(scans_are_what_they_are_said_to_be),
    };
    return cmocka_run_group_tests_name("check", tests, NULL, NULL);
}
