/* SPDX-License-Identifier: MIT
 * test_distance_field.c - the distance field's lower bounds are valid everywhere, and tight enough to be useful. */
#include "solids.h"

#include "transport/distance_field.h"

#include <time.h>

#define POINTS (SLOW ? 300 : 1500)

struct object {
    struct stage s;
    struct pell_pool *pool;
    struct pell_rays *rays;
    struct pell_solids *solids;
    struct pell_distance *distance;
};

/* Each translucent material of the scene gets a medium of its own. */
static void finish_object(struct object *t, size_t bytes)
{
    struct pell_frame_material materials[8];
    uint16_t frame_index[9] = { 0 };
    uint16_t n = 0;

    stage_complete(&t->s);
    memset(materials, 0, sizeof(materials));
    for (size_t i = 0; i < t->s.scene->num_materials; i++)
        if (!t->s.scene->materials[i].opaque) {
            materials[n].white = n + 1;
            frame_index[i + 1] = ++n;
        }
    OK(pell_pool_create(t->s.ctx, 2, &t->pool));
    OK(pell_rays_create(t->s.ctx, t->s.scene, t->pool, &t->rays));
    OK(pell_solids_create(t->s.ctx, t->s.scene, frame_index, materials, &t->solids));
    OK(pell_distance_create(t->s.ctx, t->pool, t->s.scene, t->solids, bytes, &t->distance));
}

static void drop_object(struct object *t)
{
    pell_distance_destroy(&t->distance);
    pell_solids_destroy(&t->solids);
    pell_rays_destroy(&t->rays);
    pell_pool_destroy(&t->pool);
    stage_finish(&t->s);
}

/* Whether x is inside a closed solid: the first face along some direction is seen from behind. */
static bool is_inside(const struct object *t, int solid, struct pell_vec3 x)
{
    static const int valid[16] = { -1 };
    struct pell_ray_hit16 p;
    _Alignas(64) int one[16];

    memcpy(one, valid, sizeof(one));
    memset(&p, 0, sizeof(p));
    p.ray.ox[0] = x.x;
    p.ray.oy[0] = x.y;
    p.ray.oz[0] = x.z;
    p.ray.dx[0] = 0.36f;
    p.ray.dy[0] = -0.48f;
    p.ray.dz[0] = 0.8f;
    p.ray.tfar[0] = INFINITY;
    p.ray.mask[0] = PELL_RAY_TRANSLUCENT;
    pell_rays_closest16(t->rays, one, false, &p);
    return p.hit.mesh[0] != PELL_NO_HIT && t->solids->of_mesh[p.hit.mesh[0]] == solid &&
           0.36f * p.hit.ngx[0] - 0.48f * p.hit.ngy[0] + 0.8f * p.hit.ngz[0] > 0.0f;
}

/* The bound at random points in and around the scene's bounds: never more than the distance to the nearest triangle. Returns the mean
 * ratio of bound and distance, over points inside of the solid at least `deep` mm below its surfaces. */
static double check_bounds(const struct object *t, int solid, double deep)
{
    const float *low = t->s.scene->bounds_min, *high = t->s.scene->bounds_max;
    double sum = 0.0;
    uint32_t random = 7;
    int n = 0;

    for (int i = 0; i < POINTS; i++) {
        struct pell_vec3 x;
        struct pell_nearest near;
        float bound;
        for (int k = 0; k < 3; k++) {
            const float wide = i % 8 ? 0.0f : 0.1f * (high[k] - low[k]);
            const float at = low[k] - wide + shapes_random(&random) * (high[k] - low[k] + 2.0f * wide);
            *(k == 0 ? &x.x : k == 1 ? &x.y : &x.z) = at;
        }
        assert_true(pell_rays_closest_point(t->rays, x, INFINITY, NULL, 0, &near));
        bound = pell_distance_bound(t->distance, solid, x);
        if (!(bound >= 0.0f && (double) bound <= near.distance))
            fail_msg("bound %.9g, distance %.9g at %.9g %.9g %.9g", (double) bound, near.distance, (double) x.x, (double) x.y,
                     (double) x.z);
        if (near.distance >= deep && is_inside(t, solid, x)) {
            sum += (double) bound / near.distance;
            n++;
        }
    }
    return n ? sum / n : 0.0;
}

/* The test's solids are closed, oriented outward and of the correct volume. */
static void solids_are_solids(void **state)
{
    static const float thickness[3] = { 1.0f, 2.0f, 0.5f };
    double before = 0.0;

    (void) state;
    for (int cuts = 0; cuts < 5; cuts++) {
        const size_t materials[3] = { 0, 0, 0 };
        struct stage s;
        double volume;
        stage_start(&s, 4, 4);
        stage_medium(&s, "marble", NULL);
        solid_stack(&s, materials, thickness, 3, 10.0f, 0.0f);
        solid_shell(&s, 0, 0, 3.0f, 1.0f, cuts);
        solid_slab(&s, 0, 7, 20.0f, 0.25f);
        for (size_t i = 0; i < 3; i++)
            REQUIRE_REL(solid_volume(&s.scene->meshes[i]), 400.0 * (double) thickness[i], 1e-6);
        volume = solid_volume(&s.scene->meshes[3]) / (4.0 / 3.0 * PELL_PI * 27.0);
        print_message("# ball of %u triangles: %.5f of a ball's volume\n", s.scene->meshes[3].num_triangles, volume);
        REQUIRE(volume < 1.0 && volume > before);
        if (cuts > 1) /* each subdivision reduces the deficit to a quarter */
            REQUIRE_REL(1.0 - volume, 0.25 * (1.0 - before), 0.1);
        before = volume;
        REQUIRE_REL(27.0 * solid_volume(&s.scene->meshes[4]), solid_volume(&s.scene->meshes[3]), 1e-5);
        REQUIRE_REL(solid_volume(&s.scene->meshes[5]), 400.0, 1e-6);
        stage_finish(&s);
    }
}

static void no_bound_is_more_than_the_distance(void **state)
{
    static const struct {
        const char *name;
        float scale, offset;
    } sizes[] = { { "hand-sized", 1.0f, 0.0f }, { "tiny", 1e-4f, 0.0f }, { "huge", 1e5f, 0.0f }, { "far from the origin", 1.0f, 3e4f } };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(sizes); k++)
        for (int shape = 0; shape < 4; shape++) {
            const float s = sizes[k].scale, o = sizes[k].offset;
            const struct pell_vec3 at = vec3(o, -0.5f * o, 0.0f);
            struct object t;
            size_t material, opaque, other;
            double kept;

            stage_start(&t.s, 4, 4);
            stage_medium(&t.s, "marble", &material);
            stage_opaque(&t.s, 1.0f, &opaque);
            stage_medium(&t.s, "wholemilk", &other);
            if (shape == 0)
                solid_ball(&t.s, material, 0, at, 20.0f * s, 3);
            if (shape == 1)
                stage_box(&t.s, material, 0, vec3(o - 50.0f * s, -0.5f * o - 50.0f * s, -0.25f * s),
                          vec3(o + 50.0f * s, -0.5f * o + 50.0f * s, 0.25f * s));
            if (shape >= 2) { /* with a bone, or another solid, inside */
                stage_box(&t.s, material, 0, vec3(o - 20.0f * s, -0.5f * o - 20.0f * s, -20.0f * s),
                          vec3(o + 20.0f * s, -0.5f * o + 20.0f * s, 20.0f * s));
                stage_ball(&t.s, shape == 2 ? opaque : other, 1, at, 8.0f * s, 16);
            }
            finish_object(&t, shape == 1 ? 2u << 20 : 1u << 18);
            for (int solid = 0; solid < (shape == 3 ? 2 : 1); solid++) {
                const double deep = (shape == 1 ? 0.15 : 4.0) * (double) s;
                kept = check_bounds(&t, solid, deep);
                print_message("# %s, shape %d, body %d: %.3f of the distance kept at %g mm and deeper\n", sizes[k].name, shape, solid, kept,
                              deep);
                if (k < 3) /* far away, positions are no finer than floats */
                    REQUIRE(kept > (shape == 1 ? 0.2 : 0.65));
            }
            drop_object(&t);
        }
}

static void outside_of_bounds_is_nothing(void **state)
{
    struct object t;
    size_t material;

    (void) state;
    stage_start(&t.s, 4, 4);
    stage_medium(&t.s, "marble", &material);
    stage_box(&t.s, material, 0, vec3(-10, -10, -10), vec3(10, 10, 10));
    finish_object(&t, 1u << 20);
    REQUIRE(pell_distance_bound(t.distance, 0, vec3(0, 0, 0)) > 8.0f);
    assert_true(pell_distance_bound(t.distance, 0, vec3(10.01f, 0, 0)) == 0.0f);
    assert_true(pell_distance_bound(t.distance, 0, vec3(0, NAN, 0)) == 0.0f);
    assert_true(pell_distance_bound(t.distance, 0, vec3(0, 0, -INFINITY)) == 0.0f);
    assert_true(pell_distance_bound(t.distance, 1, vec3(0, 0, 0)) == 0.0f);
    assert_true(pell_distance_bound(t.distance, -1, vec3(0, 0, 0)) == 0.0f);
    for (int k = 0; k < 3; k++) { /* on the faces themselves */
        float x[3] = { 1, 2, 3 };
        x[k] = 10.0f;
        assert_true(pell_distance_bound(t.distance, 0, vec3_load(x)) == 0.0f);
        x[k] = -10.0f;
        assert_true(pell_distance_bound(t.distance, 0, vec3_load(x)) == 0.0f);
    }
    drop_object(&t);
}

/* With any memory limit; without memory the bound is 0. */
static void memory_is_kept_to(void **state)
{
    (void) state;
    for (size_t bytes = 0; bytes <= 1u << 22; bytes = bytes ? 16 * bytes : 1) {
        struct object t;
        size_t material, before, after;
        float bound;

        stage_start(&t.s, 4, 4);
        stage_medium(&t.s, "marble", &material);
        stage_box(&t.s, material, 0, vec3(-10, -10, -10), vec3(10, 10, 10));
        stage_box(&t.s, material, 1, vec3(20, -10, -1), vec3(40, 10, 1));
        finish_object(&t, bytes);
        before = pell_memory_used(t.s.ctx);
        bound = pell_distance_bound(t.distance, 0, vec3(0.1f, 0.1f, 0.1f));
        pell_distance_destroy(&t.distance);
        after = pell_memory_used(t.s.ctx);
        print_message("# %zu bytes allowed: %zu used, bound %.4g\n", bytes, before - after, (double) bound);
        REQUIRE(before - after <= bytes + 1024);
        REQUIRE(bytes < 4096 || bound > 4.0f);
        drop_object(&t);
    }
}

/* Identical results for any number of threads, and for concurrent queries. */
static void threads_agree(void **state)
{
    struct object t;
    size_t material;

    (void) state;
    stage_start(&t.s, 4, 4);
    stage_medium(&t.s, "marble", &material);
    stage_ball(&t.s, material, 0, vec3(0, 0, 0), 20.0f, 24);
    finish_object(&t, 1u << 18);
    for (int threads = 1; threads <= 4; threads += 3) {
        struct pell_pool *pool;
        struct pell_distance *other;
        uint32_t random = 3;
        OK(pell_pool_create(t.s.ctx, threads, &pool));
        OK(pell_distance_create(t.s.ctx, pool, t.s.scene, t.solids, 1u << 18, &other));
        for (int i = 0; i < 20000; i++) {
            float x[3];
            for (int k = 0; k < 3; k++)
                x[k] = 20.0f * (2.0f * shapes_random(&random) - 1.0f);
            assert_true(pell_distance_bound(t.distance, 0, vec3_load(x)) == pell_distance_bound(other, 0, vec3_load(x)));
        }
        pell_distance_destroy(&other);
        pell_pool_destroy(&pool);
    }
    drop_object(&t);
}

static void survives_the_nth_allocation(void **state)
{
    struct object t;
    struct pell_alloc_fault fault = { 0 };
    struct pell_context *ctx = test_context(&fault, NULL);
    enum pell_result res = PELL_ERR_NOMEM;
    size_t material;

    (void) state;
    stage_start(&t.s, 4, 4);
    stage_medium(&t.s, "marble", &material);
    stage_ball(&t.s, material, 0, vec3(0, 0, 0), 20.0f, 8);
    finish_object(&t, 1u << 12);
    for (uint64_t n = 1; res != PELL_OK; n++) {
        const int64_t live = fault.live;
        struct pell_distance *d;
        fault.calls = 0;
        fault.fail_at = n;
        res = pell_distance_create(ctx, t.pool, t.s.scene, t.solids, 1u << 12, &d);
        fault.fail_at = 0;
        REQUIRE(res == PELL_OK || (res == PELL_ERR_NOMEM && !d));
        pell_distance_destroy(&d);
        assert_true(fault.live == live);
    }
    pell_context_destroy(&ctx);
    drop_object(&t);
}

/* The well-known scan (bunny), 100 mm tall. Prints the cost of building. */
static void the_bunny(void **state)
{
    static const char file[] = "/usr/share/glmark2/models/bunny.obj";
    const struct pell_load_params params = { .size_mm = 100.0, .bare = true };
    const size_t bytes = SLOW ? 1u << 20 : 8u << 20;
    struct object t;
    struct pell_scene *scene;
    struct timespec from, to;

    (void) state;
    if (access(file, R_OK) != 0) {
        print_message("# skipped: %s is not here\n", file);
        skip();
    }
    stage_start(&t.s, 4, 4);
    OK(pell_scene_load(t.s.ctx, file, &params, &scene));
    pell_scene_destroy(&t.s.scene);
    t.s.scene = scene;
    finish_object(&t, 16);
    pell_distance_destroy(&t.distance);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &from);
    OK(pell_distance_create(t.s.ctx, t.pool, t.s.scene, t.solids, bytes, &t.distance));
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &to);
    print_message("# bunny: %zu triangles, %.3f CPU seconds\n", t.solids->solids[0].num_triangles,
                  (double) (to.tv_sec - from.tv_sec) + 1e-9 * (double) (to.tv_nsec - from.tv_nsec));
    for (double deep = 0.25; deep < 20.0; deep *= 8.0)
        print_message("# %.3f of the distance kept at %g mm and deeper\n", check_bounds(&t, 0, deep), deep);
    REQUIRE(check_bounds(&t, 0, 4.0) > (SLOW ? 0.5 : 0.75));
    drop_object(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(solids_are_solids),
        cmocka_unit_test(no_bound_is_more_than_the_distance),
        cmocka_unit_test(outside_of_bounds_is_nothing),
        cmocka_unit_test(memory_is_kept_to),
        cmocka_unit_test(threads_agree),
        cmocka_unit_test(survives_the_nth_allocation),
        cmocka_unit_test(the_bunny),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
