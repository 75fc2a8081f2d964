/* SPDX-License-Identifier: MIT
 * test_wide_bvh.c - the bounding volume hierarchy for shaders: each triangle once, inside the boxes above it, and a bounded depth for
 * any scene. */
#include "shapes.h"

#include "visibility/rays.h"
#include "visibility/wide_bvh.h"

struct walk {
    const struct pell_wide_bvh *bvh;
    uint8_t *seen;
    int levels;
};

static float at(const uint32_t *word)
{
    float x;

    memcpy(&x, word, sizeof(x));
    return x;
}

static void walk_node(struct walk *w, uint32_t number, int level, const float low[3], const float high[3])
{
    const uint32_t *node = w->bvh->nodes + (size_t) number * PELL_WIDE_NODE;

    assert_true(number < w->bvh->num_nodes && level < PELL_WIDE_LEVELS);
    w->levels = level + 1 > w->levels ? level + 1 : w->levels;
    for (int i = 0; i < 4; i++) {
        const uint32_t child = node[24 + i];
        float lo[3], hi[3];
        if (child == PELL_WIDE_NONE)
            continue;
        for (int k = 0; k < 3; k++) {
            lo[k] = at(&node[8 * k + i]);
            hi[k] = at(&node[8 * k + 4 + i]);
            assert_true(lo[k] <= hi[k] && lo[k] >= low[k] && hi[k] <= high[k]);
        }
        if (!(child & PELL_WIDE_LEAF)) {
            walk_node(w, child, level + 1, lo, hi);
            continue;
        }
        for (size_t t = (child & ~PELL_WIDE_LEAF) >> 2, last = t + (child & 3); t <= last; t++) {
            const uint32_t *words = w->bvh->triangles + t * PELL_WIDE_TRIANGLE;
            assert_true(t < w->bvh->num_triangles && !w->seen[t]);
            w->seen[t] = 1;
            for (int k = 0; k < 9; k++)
                assert_true(at(&words[k / 3 * 4 + k % 3]) >= lo[k % 3] && at(&words[k / 3 * 4 + k % 3]) <= hi[k % 3]);
        }
    }
}

static int check(const struct pell_scene *s, const struct pell_wide_bvh *bvh)
{
    static const float low[3] = { -INFINITY, -INFINITY, -INFINITY }, high[3] = { INFINITY, INFINITY, INFINITY };
    struct walk w = { .bvh = bvh, .seen = calloc(bvh->num_triangles + 1, 1) };
    size_t all = 0;

    for (size_t i = 0; i < s->num_meshes; i++)
        all += s->meshes[i].num_triangles;
    assert_int_equal(bvh->num_triangles, all);
    walk_node(&w, 0, 0, low, high);
    for (size_t i = 0; i < bvh->num_triangles; i++) {
        const uint32_t *words = bvh->triangles + i * PELL_WIDE_TRIANGLE;
        const struct pell_mesh *m = &s->meshes[words[3]];
        assert_true(w.seen[i] && words[7] < m->num_triangles);
        for (uint32_t k = 0; k < 3; k++)
            assert_memory_equal(words + 4 * k, m->position + 3 * m->index[3 * words[7] + k], 3 * sizeof(float));
    }
    free(w.seen);
    return w.levels;
}

static void fill(struct pell_mesh *m, struct pell_vec3 (*corner)(uint32_t triangle, uint32_t k, uint32_t *seed))
{
    uint32_t seed = 1;

    for (uint32_t i = 0; i < 3 * m->num_triangles; i++) {
        vec3_store(corner(i / 3, i % 3, &seed), m->position + 3 * i);
        m->index[i] = i;
    }
}

static struct pell_vec3 soup(uint32_t triangle, uint32_t k, uint32_t *seed)
{
    const float x = shapes_random(seed), y = shapes_random(seed);

    (void) k;
    return vec3(100.0f * x + (float) (triangle % 7), 100.0f * y, 3.0f * shapes_random(seed));
}

static struct pell_vec3 one(uint32_t triangle, uint32_t k, uint32_t *seed)
{
    (void) triangle;
    (void) seed;
    return vec3((float) k, (float) (k * k), 5.0f);
}

/* Each at half the distance of the previous one: binning separates one triangle at a time. */
static struct pell_vec3 shrinking(uint32_t triangle, uint32_t k, uint32_t *seed)
{
    const float x = ldexpf(1.0f, 60 - (int) (triangle % 120));

    (void) seed;
    return vec3(x, k == 1 ? 0.1f * x : 0.0f, k == 2 ? 0.1f * x : 0.0f);
}

static void every_triangle_is_in_its_boxes(void **state)
{
    static struct pell_vec3 (*const corners[])(uint32_t, uint32_t, uint32_t *) = { soup, one, shrinking };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(corners); i++)
        for (uint32_t count = 1; count < 9000; count = 3 * count + 1) {
            struct pell_context *ctx = test_context(NULL, NULL);
            struct pell_scene *s = shapes_scene(ctx);
            struct pell_wide_bvh *bvh, *again;
            fill(shapes_mesh(s, 0, 3 * count, count), corners[i]);
            shapes_box(s, shapes_material(s, true), vec3(-1, -1, -1), vec3(1, 1, 1));
            assert_int_equal(pell_wide_bvh_create(ctx, s, &bvh), PELL_OK);
            assert_int_equal(pell_wide_bvh_create(ctx, s, &again), PELL_OK);
            assert_true(check(s, bvh) <= PELL_WIDE_LEVELS);
            assert_true(bvh->num_nodes == again->num_nodes);
            assert_memory_equal(bvh->nodes, again->nodes, bvh->num_nodes * PELL_WIDE_NODE * sizeof(uint32_t));
            pell_wide_bvh_destroy(&bvh);
            pell_wide_bvh_destroy(&again);
            pell_scene_destroy(&s);
            pell_context_destroy(&ctx);
        }
}

/* The cost of a ball's hierarchy is close to that of uniform boxes: its depth is near the logarithm. */
static void a_ball_has_few_levels(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    const struct pell_mesh *m = shapes_ball(s, 0, vec3(0, 0, 0), 50.0f, 100);
    struct pell_wide_bvh *bvh;
    const double start = pell_seconds();
    int levels;

    (void) state;
    assert_int_equal(pell_wide_bvh_create(ctx, s, &bvh), PELL_OK);
    levels = check(s, bvh);
    print_message("# %u triangles: %zu nodes, %d levels, %.0f ms\n", m->num_triangles, bvh->num_nodes, levels,
                  1e3 * (pell_seconds() - start));
    assert_true(levels < 12 && bvh->num_nodes < m->num_triangles / 2);
    pell_wide_bvh_destroy(&bvh);
    pell_wide_bvh_destroy(&bvh); /* of NULL */
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void lack_of_memory_leaves_nothing(void **state)
{
    struct pell_alloc_fault fault = { 0 };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(&fault, &kept);
    struct pell_scene *s = shapes_scene(ctx);
    enum pell_result res = PELL_ERR_NOMEM;
    int failed = 0;

    (void) state;
    shapes_ball(s, 0, vec3(0, 0, 0), 50.0f, 20);
    for (uint64_t n = 1; res != PELL_OK; n++) {
        const size_t used = pell_memory_used(ctx);
        struct pell_wide_bvh *bvh;
        fault.fail_at = atomic_load(&fault.calls) + n;
        res = pell_wide_bvh_create(ctx, s, &bvh);
        fault.fail_at = 0;
        assert_true(res == PELL_OK || (res == PELL_ERR_NOMEM && !bvh));
        pell_wide_bvh_destroy(&bvh);
        assert_int_equal(pell_memory_used(ctx), used);
        failed += res != PELL_OK;
    }
    assert_true(failed > 4);
    assert_int_equal(kept.errors, failed);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_triangle_is_in_its_boxes),
        cmocka_unit_test(a_ball_has_few_levels),
        cmocka_unit_test(lack_of_memory_leaves_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
