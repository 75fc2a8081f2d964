/* SPDX-License-Identifier: MIT
 * test_touching.c - objects that touch and scatter alike become one assembly; others stay apart. */
#include "scene_test.h"
#include "shapes.h"

#include "math/near.h"
#include "scene/triangle.h"

/* A scene of two objects, and how many assemblies they are once it is complete. */
struct pair {
    struct pell_context *ctx;
    struct pell_scene *scene;
    struct kept_messages kept;
};

static void start(struct pair *p)
{
    memset(p, 0, sizeof(*p));
    p->ctx = test_context(NULL, &p->kept);
    p->scene = shapes_scene(p->ctx);
}

static void box(struct pair *p, size_t material, struct pell_vec3 lo, struct pell_vec3 hi)
{
    const int object = (int) p->scene->num_meshes;

    shapes_box(p->scene, material, lo, hi)->object = object;
}

static int assemblies_when_complete(struct pair *p)
{
    int count = 0;

    for (size_t i = 0; i < p->scene->num_meshes; i++)
        p->scene->meshes[i].file = p->scene->meshes[i].file ? p->scene->meshes[i].file : 1;
    assert_int_equal(pell_scene_complete(p->scene, NULL), PELL_OK);
    for (size_t i = 0; i < p->scene->num_meshes; i++) {
        bool first = true;
        for (size_t k = 0; k < i; k++)
            first &= pell_mesh_assembly(&p->scene->meshes[k]) != pell_mesh_assembly(&p->scene->meshes[i]);
        count += first;
    }
    pell_scene_destroy(&p->scene);
    assert_int_equal(pell_memory_used(p->ctx), 0);
    pell_context_destroy(&p->ctx);
    return count;
}

/* A cube of 10 mm, and a box. */
static int with_box(struct pell_vec3 lo, struct pell_vec3 hi)
{
    struct pair p;

    start(&p);
    box(&p, 0, vec3(0, 0, 0), vec3(10, 10, 10));
    box(&p, 0, lo, hi);
    return assemblies_when_complete(&p);
}

static void closed_objects_are_joined_where_they_touch(void **state)
{
    (void) state;
    assert_int_equal(with_box(vec3(10, 0, 0), vec3(20, 10, 10)), 1);        /* face to equal face */
    assert_int_equal(with_box(vec3(10, 4, 4), vec3(20, 6, 6)), 1);          /* in the middle of a face */
    assert_int_equal(with_box(vec3(10, -40, 4), vec3(20, 40, 6)), 1);       /* a bar across a face: no corner is on the other */
    assert_int_equal(with_box(vec3(-40, 4, 4), vec3(40, 6, 6)), 1);         /* through the cube */
    assert_int_equal(with_box(vec3(9, 9, 9), vec3(20, 20, 20)), 1);         /* a corner inside */
    assert_int_equal(with_box(vec3(10.00005f, 0, 0), vec3(20, 10, 10)), 1); /* rounded coordinates */
    assert_int_equal(with_box(vec3(10.01f, 0, 0), vec3(20, 10, 10)), 2);    /* a gap */
    assert_int_equal(with_box(vec3(2, 2, 2), vec3(8, 8, 8)), 2);            /* inside, without contact */
    assert_int_equal(with_box(vec3(0, 0, 0), vec3(10, 10, 10)), 2);         /* a copy */
    assert_int_equal(with_box(vec3(20, 20, 20), vec3(30, 30, 30)), 2);
}

/* Links of a chain: the boxes meet, the surfaces do not. */
static void boxes_that_meet_are_not_contact(void **state)
{
    struct pair p;

    (void) state;
    start(&p);
    shapes_ball(p.scene, 0, vec3(0, 0, 0), 10.0f, 24)->object = 0;
    shapes_ball(p.scene, 0, vec3(14.5f, 14.5f, 0), 10.0f, 24)->object = 1;
    assert_int_equal(assemblies_when_complete(&p), 2);
    start(&p);
    shapes_ball(p.scene, 0, vec3(0, 0, 0), 10.0f, 24)->object = 0;
    shapes_ball(p.scene, 0, vec3(13.5f, 13.5f, 0), 10.0f, 24)->object = 1;
    assert_int_equal(assemblies_when_complete(&p), 1);
}

/* A cube of 10 mm, and a box of another medium that touches its face x = 10 mm: how far the box reaches into the cube. */
static float reach_into_cube(struct pell_vec3 lo, struct pell_vec3 hi, bool same, bool opaque, int file, int completions)
{
    struct pair p;
    float low = INFINITY, high = -INFINITY;

    start(&p);
    box(&p, 0, vec3(0, 0, 0), vec3(10, 10, 10));
    box(&p, shapes_material(p.scene, opaque), lo, hi);
    if (!same)
        p.scene->materials[1].medium.sigma_a[0] *= 1.5;
    p.scene->meshes[0].file = 1;
    p.scene->meshes[1].file = file;
    for (int i = 0; i < completions; i++)
        assert_int_equal(pell_scene_complete(p.scene, NULL), PELL_OK);
    for (int i = 0; i < 2; i++)
        for (uint32_t k = 0; k < p.scene->meshes[i].num_vertices; k++) {
            const float *at = p.scene->meshes[i].position + 3 * (size_t) k;
            if (i == 0)
                REQUIRE((at[0] == 0.0f || at[0] == 10.0f) && (at[1] == 0.0f || at[1] == 10.0f));
            else
                REQUIRE((at[1] == lo.y || at[1] == hi.y) && (at[2] == lo.z || at[2] == hi.z) && (at[0] == hi.x || at[0] < lo.x + 1e-6f));
            low = i == 1 ? fminf(low, at[0]) : low;
            high = i == 0 ? fmaxf(high, at[0]) : high;
        }
    pell_scene_destroy(&p.scene);
    pell_context_destroy(&p.ctx);
    return high - low;
}

/* The faces of a glass and of the drink in it. */
static void different_media_overlap_where_their_faces_coincide(void **state)
{
    const struct pell_vec3 lo = vec3(10, 4, 4), hi = vec3(20, 6, 6);
    float reach;

    (void) state;
    reach = reach_into_cube(lo, hi, false, false, 1, 1);
    REQUIRE(reach > 5e-4f && reach < 3e-3f);
    REQUIRE(reach_into_cube(lo, hi, false, false, 2, 1) == reach); /* two files */
    REQUIRE(reach_into_cube(lo, hi, false, false, 1, 3) == reach);
    REQUIRE(reach_into_cube(lo, hi, true, false, 1, 1) == 0.0f);
    REQUIRE(reach_into_cube(lo, hi, false, true, 1, 1) == 0.0f);
    REQUIRE(reach_into_cube(lo, hi, false, false, 0, 1) == 0.0f); /* a program's own mesh stays as it is */
    REQUIRE(reach_into_cube(vec3(10.01f, 4, 4), hi, false, false, 1, 1) < 0.0f);
}

static void only_equal_media_are_joined(void **state)
{
    struct pair p;

    (void) state;
    for (int i = 0; i < 4; i++) {
        size_t other;
        start(&p);
        other = shapes_material(p.scene, i == 1);
        if (i == 2)
            p.scene->materials[other].medium.sigma_a[1] *= 1.01;
        if (i == 3) /* another surface of the same medium */
            p.scene->materials[other].roughness = 0.9f;
        box(&p, 0, vec3(0, 0, 0), vec3(10, 10, 10));
        box(&p, other, vec3(10, 0, 0), vec3(20, 10, 10));
        assert_int_equal(assemblies_when_complete(&p), i == 0 || i == 3 ? 1 : 2);
    }
}

/* The lower and the upper half of a ball as two objects, each open; the upper one without its last `missing` triangles. */
static void half_balls(struct pair *p, uint32_t missing)
{
    for (int i = 0; i < 2; i++) {
        struct pell_mesh *m = shapes_ball(p->scene, 0, vec3(0, 0, 0), 10.0f, 24);
        const uint32_t half = m->num_triangles / 2;
        m->object = i;
        if (i == 1)
            memmove(m->index, m->index + 3 * (size_t) half, 3 * (size_t) (m->num_triangles - half) * sizeof(*m->index));
        m->num_triangles = i == 0 ? half : m->num_triangles - half - missing;
    }
}

static void pieces_of_a_closed_surface_are_joined(void **state)
{
    struct pair p;

    (void) state;
    for (int complete = 0; complete < 2; complete++) {
        start(&p);
        half_balls(&p, complete ? 0 : 1);
        assert_int_equal(assemblies_when_complete(&p), complete ? 1 : 2);
    }
}

static void an_open_object_is_not_joined_to_a_closed_one(void **state)
{
    struct pair p;

    (void) state;
    start(&p);
    box(&p, 0, vec3(0, 0, 0), vec3(10, 10, 10));
    shapes_quad(p.scene, 0, vec3(5, 5, 10), vec3(4, 0, 0), vec3(0, 4, 0))->object = 1;
    assert_int_equal(assemblies_when_complete(&p), 2);
}

static void rows_become_one_object(void **state)
{
    struct pair p;

    (void) state;
    start(&p);
    for (int i = 0; i < 50; i++)
        box(&p, 0, vec3((float) i, 0, 0), vec3((float) i + 1.0f, 1, 1));
    for (int i = 0; i < 3; i++)
        box(&p, 0, vec3(100.0f + (float) i, 0, 0), vec3(101.0f + (float) i, 1, 1));
    assert_int_equal(assemblies_when_complete(&p), 2);
}

/* Closed parts that may touch: rays must look whether surface is inside. */
static void overlaps_are_marked(void **state)
{
    static const struct {
        float at;
        bool overlaps;
    } cases[] = { { 10.0f, true }, { 5.0f, true }, { 10.5f, false } };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct pair p;
        start(&p);
        box(&p, 0, vec3(0, 0, 0), vec3(10, 10, 10));
        box(&p, 0, vec3(cases[i].at, 0, 0), vec3(20, 10, 10));
        p.scene->meshes[1].object = 0;
        assert_int_equal(pell_scene_complete(p.scene, NULL), PELL_OK);
        assert_true(p.scene->meshes[0].overlaps == cases[i].overlaps && p.scene->meshes[1].overlaps == cases[i].overlaps);
        pell_scene_destroy(&p.scene);
        pell_context_destroy(&p.ctx);
    }
}

/* Against the nearest of many points of both. */
static void distances_are_those_of_points(void **state)
{
    uint32_t seed = 5;

    (void) state;
    for (int n = 0; n < 200; n++) {
        struct pell_dvec3 s[3], t[3];
        double least = INFINITY;
        for (int k = 0; k < 3; k++) {
            s[k] = dvec3((double) shapes_random(&seed), (double) shapes_random(&seed), (double) shapes_random(&seed));
            t[k] = dvec3((double) shapes_random(&seed) + 0.6, (double) shapes_random(&seed), (double) shapes_random(&seed));
        }
        for (int i = 0; i <= 40; i++) /* points of s, each with the exact distance to t */
            for (int k = 0; i + k <= 40; k++) {
                const struct pell_dvec3 p = dvec3_mad(dvec3_mad(dvec3_mul(s[0], 1.0 - (i + k) / 40.0), i / 40.0, s[1]), k / 40.0, s[2]);
                double u, v;
                least = fmin(least, pell_triangle_distance2(dvec3_sub(p, t[0]), dvec3_sub(t[1], t[0]), dvec3_sub(t[2], t[0]), &u, &v));
            }
        least = sqrt(least);
        assert_true(pell_triangles_touch(s, t, (least + 1e-9) * (least + 1e-9)));
        if (least > 0.08) /* the points are up to 0.04 apart */
            assert_false(pell_triangles_touch(s, t, (least - 0.05) * (least - 0.05)));
    }
}

static void flip(struct pell_mesh *m)
{
    for (uint32_t i = 0; i < m->num_triangles; i++) {
        const uint32_t first = m->index[3 * (size_t) i];
        m->index[3 * (size_t) i] = m->index[3 * (size_t) i + 1];
        m->index[3 * (size_t) i + 1] = first;
    }
}

/* A part that is inside out is turned before it is joined, where its edges are those of its neighbour. */
static void parts_that_are_inside_out_are_turned(void **state)
{
    (void) state;
    for (int halves = 0; halves < 2; halves++) {
        struct pair p;
        double volume = 0.0;
        start(&p);
        if (halves) {
            half_balls(&p, 0);
        } else {
            box(&p, 0, vec3(0, 0, 0), vec3(10, 10, 10));
            box(&p, 0, vec3(10, 0, 0), vec3(20, 10, 10));
        }
        flip(&p.scene->meshes[1]);
        for (int i = 0; i < 2; i++)
            p.scene->meshes[i].file = 1;
        assert_int_equal(pell_scene_complete(p.scene, NULL), PELL_OK);
        assert_int_equal(pell_mesh_assembly(&p.scene->meshes[0]), pell_mesh_assembly(&p.scene->meshes[1]));
        for (size_t i = 0; i < 2; i++) /* signed: that of the cones from the origin to all triangles */
            for (uint32_t t = 0; t < p.scene->meshes[i].num_triangles; t++) {
                struct pell_vec3 at[3];
                pell_triangle_corners(&p.scene->meshes[i], t, at);
                volume += (double) vec3_dot(at[0], vec3_cross(at[1], at[2])) / 6.0;
            }
        REQUIRE_REL(volume, halves ? 4.0 / 3.0 * PELL_PI * 1000.0 : 2000.0, halves ? 0.02 : 1e-6);
        pell_scene_destroy(&p.scene);
        pell_context_destroy(&p.ctx);
    }
}

/* What a scene file puts next to each other stays apart. */
static void objects_of_two_files_are_not_joined(void **state)
{
    struct pair p;

    (void) state;
    start(&p);
    box(&p, 0, vec3(0, 0, 0), vec3(10, 10, 10));
    box(&p, 0, vec3(10, 0, 0), vec3(20, 10, 10));
    p.scene->meshes[1].file = 2;
    assert_int_equal(assemblies_when_complete(&p), 2);
}

/* An OBJ with a name for each half of a bar. */
static void objects_of_a_file_are_joined(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 20.0, .bare = true };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s;
    (void) state;

    assert_int_equal(load_text(ctx, "two.obj",
                               "o first\n" CUBE "o second\nv 1 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 0 1\nv 2 0 1\nv 2 1 1\nv 1 1 1\n"
                               "f 9 12 11 10\nf 13 14 15 16\nf 9 10 14 13\nf 10 11 15 14\nf 11 12 16 15\nf 12 9 13 16\n",
                               &params, &s),
                     PELL_OK);
    assert_int_equal(s->num_meshes, 2);
    assert_int_not_equal(s->meshes[0].object, s->meshes[1].object);
    assert_int_equal(pell_mesh_assembly(&s->meshes[0]), pell_mesh_assembly(&s->meshes[1]));
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closed_objects_are_joined_where_they_touch),
        cmocka_unit_test(boxes_that_meet_are_not_contact),
        cmocka_unit_test(different_media_overlap_where_their_faces_coincide),
        cmocka_unit_test(only_equal_media_are_joined),
        cmocka_unit_test(pieces_of_a_closed_surface_are_joined),
        cmocka_unit_test(an_open_object_is_not_joined_to_a_closed_one),
        cmocka_unit_test(rows_become_one_object),
        cmocka_unit_test(objects_of_two_files_are_not_joined),
        cmocka_unit_test(objects_of_a_file_are_joined),
        cmocka_unit_test(parts_that_are_inside_out_are_turned),
        cmocka_unit_test(overlaps_are_marked),
        cmocka_unit_test(distances_are_those_of_points),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
