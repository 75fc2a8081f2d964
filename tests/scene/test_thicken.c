/* SPDX-License-Identifier: MIT
 * test_thicken.c - open surfaces that are given a thickness are closed, and as thick as asked. */
#include "scene_test.h"
#include "shapes.h"

#include "scene/mesh/topology.h"

/* A square of 10 x 10 mm in 2 x `side` x `side` triangles, bent about the y axis (`bend`: mm at its borders). */
static char *sheet(int side, double bend)
{
    char *text = NULL;
    size_t size;
    FILE *f = open_memstream(&text, &size);

    for (int y = 0; y <= side; y++)
        for (int x = 0; x <= side; x++) {
            const double u = 2.0 * x / side - 1.0;
            fprintf(f, "v %g %g %g\nvt %g %g\n", 5.0 * u, 10.0 * y / side, -bend * u * u, (double) x / side, (double) y / side);
        }
    for (int y = 0; y < side; y++)
        for (int x = 0; x < side; x++) {
            const int a = y * (side + 1) + x + 1, b = a + 1, c = b + side, d = c + 1;
            fprintf(f, "f %d/%d %d/%d %d/%d\nf %d/%d %d/%d %d/%d\n", a, a, b, b, d, d, a, a, d, d, c, c);
        }
    fclose(f);
    return text;
}

static struct pell_scene *load_thick(struct pell_context *ctx, const char *text, double mm)
{
    const struct pell_load_params params = { .mm_per_unit = 1.0, .bare = true, .thicken_mm = mm };
    struct pell_scene *s;

    assert_int_equal(load_text(ctx, "sheet.obj", text, &params, &s), PELL_OK);
    return s;
}

static void sheets_become_closed_plates(void **state)
{
    (void) state;
    for (int bend = 0; bend < 2; bend++) {
        struct pell_context *ctx = test_context(NULL, NULL);
        char *text = sheet(20, bend ? 1.0 : 0.0);
        struct pell_scene *s = load_thick(ctx, text, 0.5);
        struct pell_scene_report report;

        assert_int_equal(pell_scene_check(s, &report), PELL_OK);
        assert_int_equal(report.objects[0].triangles, 2 * 800 + 2 * 80);
        assert_true(report.objects[0].closed && report.objects[0].outward);
        assert_true(report.objects[0].boundary_edges + report.objects[0].nonmanifold_edges + report.objects[0].flipped_edges == 0);
        /* Width times thickness t times length; of a bent one less the total turn times t^2 / 2. Its length is the integral of
         * sqrt(1 + (2 x / 25)^2) from -5 to 5, its turn twice the arc tangent of 2 / 5. */
        REQUIRE_REL(report.objects[0].volume_mm3, bend ? 10.0 * (10.2604 * 0.5 - 0.125 * 2.0 * atan(0.4)) : 50.0, bend ? 2e-3 : 1e-5);
        pell_scene_report_finish(ctx, &report);
        pell_scene_destroy(&s);
        free(text);
        assert_int_equal(pell_memory_used(ctx), 0);
        pell_context_destroy(&ctx);
    }
}

/* Distances between the two sides of a quarter of a cylinder, whose vertices move along the radius. */
static void both_sides_are_the_thickness_apart(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    char *text = NULL;
    size_t size;
    FILE *f = open_memstream(&text, &size);
    struct pell_scene *s;
    const struct pell_mesh *m;
    int inner = 0;

    (void) state;
    for (int i = 0; i <= 30; i++)
        for (int k = 0; k < 2; k++)
            fprintf(f, "v %.9g %.9g %g\n", 10.0 * cos(i * PELL_PI / 60.0), 10.0 * sin(i * PELL_PI / 60.0), 8.0 * k);
    for (int i = 0; i < 30; i++)
        fprintf(f, "f %d %d %d %d\n", 2 * i + 1, 2 * i + 3, 2 * i + 4, 2 * i + 2);
    fclose(f);
    s = load_thick(ctx, text, 2.0);
    m = &s->meshes[0];
    for (uint32_t i = 0; i < m->num_vertices; i++) {
        const double r = hypot((double) m->position[3 * i], (double) m->position[3 * i + 1]);
        REQUIRE(fabs(r - 10.0) < 0.02 || fabs(r - 8.0) < 0.02);
        inner += fabs(r - 8.0) < 0.02;
    }
    assert_true(inner > 60);
    pell_scene_destroy(&s);
    free(text);
    s = load_thick(ctx, "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf 1 2 3 4\n", 3.0);
    REQUIRE_NEAR(s->bounds_min[2], -3.0, 1e-5); /* the bounds are those of what is rendered */
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

/* Normals and texture coordinates of a file: the other side has the same coordinates, and turned normals. */
static void the_other_side_keeps_texture_coordinates(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = load_thick(ctx,
                                      "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
                                      "f 1/1/1 2/2/1 3/3/1 4/4/1\n",
                                      1.0);
    const struct pell_mesh *m = &s->meshes[0];

    (void) state;
    assert_int_equal(m->num_vertices, 4 + 4 + 16);
    assert_int_equal(m->num_triangles, 12);
    for (uint32_t i = 0; i < 4; i++) {
        const float *a = m->position + 3 * i, *b = m->position + 3 * (i + 4);
        assert_true(a[0] == b[0] && a[1] == b[1] && a[2] == 0.0f && b[2] == -1.0f);
        assert_true(m->normal[3 * i + 2] == 1.0f && m->normal[3 * (i + 4) + 2] == -1.0f);
        assert_memory_equal(m->uv[0] + 2 * i, m->uv[0] + 2 * (i + 4), 2 * sizeof(float));
    }
    for (uint32_t i = 8; i < 24; i++) { /* the rim looks outward */
        const float *p = m->position + 3 * i, *n = m->normal + 3 * i;
        REQUIRE_NEAR(n[2], 0.0, 1e-6);
        REQUIRE((p[0] - 2.0f) * n[0] + (p[1] - 2.0f) * n[1] > 1.9f);
    }
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void what_is_closed_opaque_or_one_sided_stays(void **state)
{
    static const char strip[] = "v 0 0 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nv 1 0 2\nv 1 1 2\n"
                                "f 1 3 4 2\nf 3 5 6 4\nf 5 2 1 6\n"; /* its last piece is twisted */
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    const struct pell_load_params params = { .mm_per_unit = 1.0, .bare = true, .thicken_mm = 0.1 };
    struct pell_scene *s;

    (void) state;
    assert_int_equal(load_text(ctx, "cube.obj", CUBE, &params, &s), PELL_OK);
    assert_int_equal(s->meshes[0].num_triangles, 12);
    pell_scene_destroy(&s);
    assert_int_equal(load_text(ctx, "strip.obj", strip, &params, &s), PELL_OK);
    assert_int_equal(s->meshes[0].num_triangles, 6);
    REQUIRE(strstr(kept.all_warnings, "one side only"));
    pell_scene_destroy(&s);
    s = shapes_scene(ctx);
    shapes_quad(s, shapes_material(s, true), vec3(0, 0, 0), vec3(4, 0, 0), vec3(0, 4, 0))->thicken = 1.0f;
    assert_int_equal(pell_scene_complete(s, NULL), PELL_OK);
    assert_int_equal(s->meshes[0].num_triangles, 2);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void lack_of_memory_is_an_error_and_leaves_nothing(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 1.0, .bare = true, .thicken_mm = 0.5 };
    char *text = sheet(3, 1.0);
    uint64_t calls = 0;

    (void) state;
    for (uint64_t n = 0; n <= calls; n++) {
        struct pell_alloc_fault fault = { .fail_at = n };
        struct pell_context *ctx = test_context(&fault, NULL);
        struct pell_scene *s = NULL;
        if (n == 0 || ctx)
            assert_int_equal(load_text(ctx, "sheet.obj", text, &params, &s), n == 0 ? PELL_OK : PELL_ERR_NOMEM);
        pell_scene_destroy(&s);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
        calls = n == 0 ? fault.calls : calls;
    }
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sheets_become_closed_plates),
        cmocka_unit_test(both_sides_are_the_thickness_apart),
        cmocka_unit_test(the_other_side_keeps_texture_coordinates),
        cmocka_unit_test(what_is_closed_opaque_or_one_sided_stays),
        cmocka_unit_test(lack_of_memory_is_an_error_and_leaves_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
