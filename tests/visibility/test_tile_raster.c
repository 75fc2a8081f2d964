/* SPDX-License-Identifier: MIT
 * test_tile_raster.c - rasterised triangles against ray hits, for cameras outside, inside and among the triangles; and cases that
 * require rays. */
#include "shapes.h"

#include "visibility/tile_raster.h"

#define TILE PELL_RASTER_TILE
#define BLOCK PELL_RASTER_BLOCK

/* A camera at `from` looking at `to`; `focal` in pixels, orthographic: pixels per mm. */
static struct pell_raster_view look(struct pell_vec3 from, struct pell_vec3 to, bool orthographic, float focal, int width, int height)
{
    struct pell_raster_view v = { .origin = from,
                                  .orthographic = orthographic,
                                  .focal = focal,
                                  .left = 0.5f - 0.5f * (float) width,
                                  .top = 0.5f * (float) height - 0.5f };

    v.forward = vec3_normalize(vec3_sub(to, from));
    v.right = vec3_normalize(vec3_cross(v.forward, vec3(0.1f, 1.0f, 0.05f)));
    v.up = vec3_cross(v.right, v.forward);
    return v;
}

static void ray_through(const struct pell_raster_view *v, float x, float y, struct pell_ray *ray)
{
    const float sx = (x + v->left) / v->focal, sy = (v->top - y) / v->focal;
    const struct pell_vec3 offset = vec3_add(vec3_mul(v->right, sx), vec3_mul(v->up, sy));

    vec3_store(v->orthographic ? vec3_add(v->origin, offset) : v->origin, ray->origin);
    vec3_store(v->orthographic ? v->forward : vec3_add(v->forward, offset), ray->direction);
    ray->tnear = 1e-6f;
    ray->tfar = INFINITY;
    ray->mask = PELL_RAY_ALL;
}

/* An image of hits; mesh PELL_NO_HIT where there is none. */
struct drawn {
    int width, height;
    struct pell_hit *hits;
    int empty; /* tiles */
};

/* Rasterises; false where rays are required. */
static bool draw(struct pell_raster *r, struct pell_pool *pool, const struct pell_raster_view *view, int width, int height,
                 struct drawn *out)
{
    out->width = width;
    out->height = height;
    out->empty = 0;
    out->hits = calloc((size_t) width * (size_t) height, sizeof(*out->hits));
    assert_non_null(out->hits);
    for (size_t i = 0; i < (size_t) width * (size_t) height; i++)
        out->hits[i].mesh = PELL_NO_HIT;
    if (!pell_raster_draw(r, pool, view, (int64_t) width * height))
        return false;
    for (int n = 0; n < pell_raster_tiles(r); n++) {
        struct pell_raster_tile tile;
        if (!pell_raster_tile(r, n, &tile)) {
            out->empty++;
            continue;
        }
        for (int k = 0; k < PELL_RASTER_BLOCKS * PELL_RASTER_BLOCKS; k++) {
            const int x0 = n % pell_raster_columns(r) * TILE + k % PELL_RASTER_BLOCKS * BLOCK;
            const int y0 = n / pell_raster_columns(r) * TILE + k / PELL_RASTER_BLOCKS * BLOCK;
            struct pell_ray_hit16 p;
            struct pell_corners corners;
            bool any = false;

            memset(&p, 0, sizeof(p));
            for (int i = 0; i < 16; i++) {
                struct pell_ray ray;
                ray_through(view, (float) (x0 + i % BLOCK), (float) (y0 + i / BLOCK), &ray);
                p.ray.ox[i] = ray.origin[0];
                p.ray.oy[i] = ray.origin[1];
                p.ray.oz[i] = ray.origin[2];
                p.ray.dx[i] = ray.direction[0];
                p.ray.dy[i] = ray.direction[1];
                p.ray.dz[i] = ray.direction[2];
                any |= tile.triangle[16 * k + i] >= 0;
            }
            if (!any)
                continue;
            pell_raster_intersect16(r, tile.triangle + 16 * k, &p, &corners);
            for (int i = 0; i < 16; i++) {
                const int x = x0 + i % BLOCK, y = y0 + i / BLOCK;
                if (x < width && y < height && tile.triangle[16 * k + i] >= 0)
                    out->hits[y * width + x] = (struct pell_hit) { p.ray.tfar[i], { p.hit.ngx[i], p.hit.ngy[i], p.hit.ngz[i] },
                                                                   p.hit.u[i],    p.hit.v[i],
                                                                   p.hit.mesh[i], p.hit.triangle[i] };
            }
        }
    }
    return true;
}

static bool same(const struct pell_hit *a, bool ray_hit, const struct pell_hit *b)
{
    return ray_hit ? a->mesh == b->mesh && a->triangle == b->triangle : a->mesh == PELL_NO_HIT;
}

/* Whether a ray through nearly the same point of the pixel hits the rasterised triangle. */
static bool nearly(const struct pell_rays *rays, const struct pell_raster_view *view, float x, float y, const struct pell_hit *drawn)
{
    for (int i = 0; i < 16; i++) {
        const float a = 0.39269908f * (float) i, off = i % 2 ? 4e-3f : 5e-4f;
        struct pell_hit hit;
        struct pell_ray ray;
        bool ray_hit;

        ray_through(view, x + off * cosf(a), y + off * sinf(a), &ray);
        ray_hit = pell_rays_closest(rays, &ray, &hit);
        if (same(drawn, ray_hit, &hit))
            return true;
    }
    return false;
}

/* Compares every pixel with a ray. Returns the number of covered pixels. */
static int compare(struct pell_scene *s, const struct pell_raster_view *view, int width, int height)
{
    struct pell_context *ctx = s->ctx;
    struct pell_raster *raster;
    struct pell_rays *rays;
    struct pell_pool *pool;
    struct drawn d;
    int covered = 0, differ = 0;

    assert_int_equal(pell_pool_create(ctx, 2, &pool), PELL_OK);
    assert_int_equal(pell_rays_create(ctx, s, pool, &rays), PELL_OK);
    assert_int_equal(pell_raster_create(ctx, s, width, height, &raster), PELL_OK);
    assert_non_null(raster);
    assert_true(draw(raster, pool, view, width, height, &d));
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            const struct pell_hit *got = &d.hits[y * width + x];
            struct pell_hit hit;
            struct pell_ray ray;
            bool ray_hit;

            ray_through(view, (float) x, (float) y, &ray);
            ray_hit = pell_rays_closest(rays, &ray, &hit);
            covered += ray_hit;
            if (!same(got, ray_hit, &hit)) {
                differ++;
                assert_true(nearly(rays, view, (float) x, (float) y, got));
            } else if (ray_hit) {
                const struct pell_mesh *m = &s->meshes[got->mesh];
                const uint32_t *index = m->index + 3 * (size_t) got->triangle;
                const struct pell_vec3 d3 = vec3_load(ray.direction), ng = vec3_load(got->ng);
                const float facing = fabsf(vec3_dot(ng, d3)) / (vec3_length(ng) * vec3_length(d3));
                struct pell_vec3 at = { 0 }, off = vec3_sub(vec3_load(ray.origin), vec3_load(m->position + 3 * (size_t) index[0]));
                const float w[3] = { 1.0f - got->u - got->v, got->u, got->v }, size = got->t + vec3_length(off);

                for (int k = 0; k < 3; k++)
                    at = vec3_mad(at, w[k], vec3_load(m->position + 3 * (size_t) index[k]));
                off = vec3_sub(at, vec3_mad(vec3_load(ray.origin), got->t, d3));
                assert_true(w[0] >= -1e-6f && w[1] >= 0.0f && w[2] >= 0.0f);
                REQUIRE_NEAR((double) got->t, (double) hit.t, (double) (3e-6f * size / (facing + 1e-4f)));
                REQUIRE_NEAR((double) vec3_length(off), 0.0, (double) (1e-5f * size));
                for (int c = 0; c < 3; c++)
                    REQUIRE_NEAR(fabs((double) got->ng[c]), fabs((double) hit.ng[c]), 1e-4 * (double) vec3_length(ng));
            }
        }
    assert_true(differ <= width * height / 500 + 1);
    free(d.hits);
    pell_raster_destroy(&raster);
    pell_rays_destroy(&rays);
    pell_pool_destroy(&pool);
    return covered;
}

/* Triangles anywhere in a cube of 100 mm. */
static void soup(struct pell_scene *s, size_t material, uint32_t triangles, float size)
{
    struct pell_mesh *m = shapes_mesh(s, material, 3 * triangles, triangles);
    uint32_t seed = 7;

    for (uint32_t i = 0; i < triangles; i++) {
        const float c[3] = { shapes_random(&seed), shapes_random(&seed), shapes_random(&seed) };
        for (uint32_t k = 0; k < 9; k++)
            m->position[9 * i + k] = 100.0f * (c[k % 3] - 0.5f + size * (shapes_random(&seed) - 0.5f));
        for (uint32_t k = 0; k < 3; k++)
            m->index[3 * i + k] = 3 * i + k;
    }
    shapes_bound(s, m);
}

static void what_is_drawn_is_what_rays_meet(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    int covered = 0;

    (void) state;
    for (int scene = 0; scene < 4; scene++) {
        struct pell_scene *s = shapes_scene(ctx);
        const struct {
            struct pell_vec3 from, to;
            float focal;
            bool orthographic;
        } cameras[] = {
            { { 70, 90, 310 }, { 0, 0, 0 }, 200.0f, false },  { { -500, 20, -900 }, { 3, 2, 1 }, 900.0f, false },
            { { 5, -4, 3 }, { 40, 10, 20 }, 60.0f, false },   /* inside */
            { { 30, 30.5f, -8 }, { 0, 0, 0 }, 30.0f, false }, /* among them, wide angle: many are outside the view and behind */
            { { 40, -300, 200 }, { 0, 0, 0 }, 1.3f, true },   { { 0, 0, 50000 }, { 0, 0, 0 }, 60000.0f, false }, /* from afar */
        };

        if (scene == 0) {
            shapes_ball(s, 0, vec3(0, 0, 0), 50.0f, 40);
        } else if (scene == 1) {
            soup(s, 0, 1500, 0.12f);
        } else if (scene == 2) {
            const size_t opaque = shapes_material(s, true);
            soup(s, opaque, 60, 1.0f); /* large ones */
            shapes_ball(s, 0, vec3(10, 5, -20), 25.0f, 24);
            shapes_quad(s, opaque, vec3(0, -60, 0), vec3(0, 0, 4000), vec3(4000, 0, 0)); /* a floor that extends behind every camera */
            shapes_mesh(s, opaque, 3, 0);
        } else {
            soup(s, 0, 4000, 0.004f); /* smaller than pixels */
            shapes_ball(s, 0, vec3(-10, 0, 0), 1e-3f, 8);
        }
        for (size_t i = 0; i < PELL_COUNT(cameras); i++) {
            struct pell_raster_view v = look(cameras[i].from, cameras[i].to, cameras[i].orthographic, cameras[i].focal, 131, 97);
            if (cameras[i].orthographic && scene == 2)
                continue; /* the floor crosses the camera's plane: see there_is_none */
            v.left += 0.13f;
            v.top -= 0.31f;
            covered += compare(s, &v, 131, 97);
        }
        pell_scene_destroy(&s);
    }
    assert_true(covered > 60000);
    pell_context_destroy(&ctx);
}

/* Vertices, and edges, exactly at pixel centres; and a ball's silhouette from inside, without any gap. */
static void nothing_shows_between_triangles(void **state)
{
    enum { SIDE = 64 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    struct pell_mesh *m = shapes_mesh(s, 0, (SIDE + 1) * (SIDE + 1), 2 * SIDE * SIDE);
    struct pell_raster *raster;
    struct pell_pool *pool;
    struct drawn d;

    (void) state;
    for (uint32_t i = 0; i < (SIDE + 1) * (SIDE + 1); i++)
        vec3_store(vec3((float) (i % (SIDE + 1)) - 32.0f, (float) (i / (SIDE + 1)) - 32.0f, 0.25f * (float) (i % 7)), m->position + 3 * i);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        const uint32_t a = i / SIDE * (SIDE + 1) + i % SIDE;
        memcpy(m->index + 6 * i, (const uint32_t[]) { a, a + 1, a + SIDE + 2, a, a + SIDE + 2, a + SIDE + 1 }, 6 * sizeof(uint32_t));
    }
    shapes_bound(s, m);
    assert_int_equal(pell_pool_create(ctx, 1, &pool), PELL_OK);
    assert_int_equal(pell_raster_create(ctx, s, 120, 120, &raster), PELL_OK);
    for (int k = 0; k < 2; k++) {
        const float focal = k == 0 ? 2.0f : 200.0f;
        struct pell_raster_view v = { { 0, 0, 100 }, { 0, 0, -1 }, { 1, 0, 0 }, { 0, 1, 0 }, k == 0, focal, -60.0f, 60.0f };
        assert_true(draw(raster, pool, &v, 120, 120, &d));
        for (int i = 0; i < 120 * 120; i++)
            assert_int_equal(d.hits[i].mesh, 0);
        free(d.hits);
    }
    pell_raster_destroy(&raster);
    pell_scene_destroy(&s);

    s = shapes_scene(ctx);
    shapes_ball(s, 0, vec3(0, 0, 0), 10.0f, 60);
    assert_int_equal(pell_raster_create(ctx, s, 300, 200, &raster), PELL_OK);
    for (int k = 0; k < 8; k++) {
        const struct pell_vec3 from = vec3(1.1f * (float) k, 0.0f, 0.0f); /* the last nearly touches it */
        const struct pell_vec3 to = vec3_add(from, vec3(0.3f * (float) k, 1.0f, -0.4f));
        const struct pell_raster_view v = look(from, to, false, 120.0f, 300, 200);
        assert_true(draw(raster, pool, &v, 300, 200, &d));
        for (int i = 0; i < 300 * 200; i++)
            assert_int_equal(d.hits[i].mesh, 0);
        free(d.hits);
    }
    pell_raster_destroy(&raster);
    pell_pool_destroy(&pool);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void any_number_of_threads_and_any_processor_give_the_same_bits(void **state)
{
    static const char *const levels[] = { "base", "v2", "v3", "v4" };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    const struct pell_raster_view v = look(vec3(20, 30, 120), vec3(0, 0, 0), false, 90.0f, 203, 150);
    struct drawn first = { 0 };

    (void) state;
    soup(s, 0, 3000, 0.1f);
    soup(s, 0, 3000, 0.1f); /* each triangle twice: the first counts */
    for (size_t k = 0; k < PELL_COUNT(levels); k++)
        for (int threads = 1; threads <= 3; threads += 2) {
            struct pell_raster *raster;
            struct pell_pool *pool;
            struct drawn d;

            setenv("PELL_SIMD", levels[k], 1);
            assert_int_equal(pell_raster_create(ctx, s, 203, 150, &raster), PELL_OK);
            unsetenv("PELL_SIMD");
            assert_int_equal(pell_pool_create(ctx, threads, &pool), PELL_OK);
            assert_true(draw(raster, pool, &v, 203, 150, &d));
            if (!first.hits)
                first = d;
            else
                assert_memory_equal(first.hits, d.hits, 203 * 150 * sizeof(*d.hits));
            for (int i = 0; i < 203 * 150; i++)
                assert_true(d.hits[i].mesh == 0 || d.hits[i].mesh == PELL_NO_HIT);
            if (d.hits != first.hits)
                free(d.hits);
            pell_raster_destroy(&raster);
            pell_pool_destroy(&pool);
        }
    free(first.hits);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void tiles_without_anything_say_so(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    const struct pell_raster_view v = look(vec3(0, 0, 100), vec3(0, 0, 0), false, 200.0f, 320, 320);
    const struct pell_raster_view away = look(vec3(0, 0, 100), vec3(0, 0, 200), false, 200.0f, 320, 320);
    struct pell_raster *raster;
    struct pell_pool *pool;
    struct drawn d;

    (void) state;
    shapes_ball(s, 0, vec3(0, 0, 0), 10.0f, 20); /* 40 pixels across */
    assert_int_equal(pell_pool_create(ctx, 1, &pool), PELL_OK);
    assert_int_equal(pell_raster_create(ctx, s, 320, 320, &raster), PELL_OK);
    assert_true(draw(raster, pool, &v, 320, 320, &d));
    assert_int_equal(d.empty, 96);
    free(d.hits);
    assert_true(draw(raster, pool, &away, 320, 320, &d));
    assert_int_equal(d.empty, 100);
    free(d.hits);
    pell_raster_destroy(&raster);
    pell_pool_destroy(&pool);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void rays_are_asked_where_they_do_better(void **state)
{
    static const float wild[] = { NAN, INFINITY, -1e30f, 1e13f };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    const struct pell_raster_view v = look(vec3(0, 0, 100), vec3(0, 0, 0), false, 200.0f, 256, 256);
    const struct pell_raster_view flat = look(vec3(0, 0, 5), vec3(0, 0, 0), true, 2.0f, 256, 256); /* inside the ball */
    struct pell_mesh *m = shapes_ball(s, 0, vec3(0, 0, 0), 10.0f, 20);
    struct pell_raster *raster;
    struct pell_pool *pool;

    (void) state;
    assert_int_equal(pell_pool_create(ctx, 1, &pool), PELL_OK);
    assert_int_equal(pell_raster_create(ctx, s, 16, 16, &raster), PELL_OK);
    assert_null(raster); /* more triangles than pixels */
    assert_int_equal(pell_raster_create(ctx, s, 256, 256, &raster), PELL_OK);
    assert_true(pell_raster_draw(raster, pool, &v, 256 * 256));
    assert_false(pell_raster_draw(raster, pool, &v, 100)); /* likewise, of the pixels that the object may cover */
    assert_false(pell_raster_draw(raster, pool, &flat, 256 * 256));
    for (size_t i = 0; i < PELL_COUNT(wild); i++) {
        const float kept = m->position[40];
        m->position[40] = wild[i];
        assert_false(pell_raster_draw(raster, pool, &v, 256 * 256));
        m->position[40] = kept;
    }
    assert_true(pell_raster_draw(raster, pool, &v, 256 * 256));
    pell_raster_destroy(&raster);

    s->materials[0].alpha_mask = true;
    s->materials[0].alpha_cutoff = 0.5f;
    s->materials[0].base_color[3] = 0.25f; /* all of it is cut out */
    assert_int_equal(pell_raster_create(ctx, s, 256, 256, &raster), PELL_OK);
    assert_null(raster);
    s->materials[0].base_color_map.texture = shapes_texture(s, 1, 1, 4, false, (const uint8_t[]) { 255, 255, 255, 200 });
    assert_int_equal(pell_raster_create(ctx, s, 256, 256, &raster), PELL_OK);
    assert_null(raster); /* holes */
    pell_scene_destroy(&s);

    s = shapes_scene(ctx);
    for (int i = 0; i < 100; i++) /* many layers */
        shapes_quad(s, 0, vec3(0, 0, (float) i), vec3(1000, 0, 0), vec3(0, 1000, 0));
    assert_int_equal(pell_raster_create(ctx, s, 256, 256, &raster), PELL_OK);
    assert_non_null(raster);
    assert_false(pell_raster_draw(
        raster, pool, &(struct pell_raster_view) { { 0, 0, 500 }, { 0, 0, -1 }, { 1, 0, 0 }, { 0, 1, 0 }, false, 100.0f, -128.0f, 128.0f },
        256 * 256));
    pell_raster_destroy(&raster);
    pell_pool_destroy(&pool);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void running_out_of_memory_is_reported(void **state)
{
    bool built = false;

    (void) state;
    for (uint64_t n = 1; !built; n++) {
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, NULL);
        struct pell_scene *s = shapes_scene(ctx);
        struct pell_raster *raster;

        shapes_ball(s, 0, vec3(0, 0, 0), 1.0f, 8);
        fault.fail_at = atomic_load(&fault.calls) + n;
        built = pell_raster_create(ctx, s, 100, 100, &raster) == PELL_OK;
        assert_true(built || !raster);
        assert_true(!built || n == 11);
        pell_raster_destroy(&raster);
        pell_scene_destroy(&s);
        pell_context_destroy(&ctx);
        assert_int_equal(atomic_load(&fault.live), 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_drawn_is_what_rays_meet),
        cmocka_unit_test(nothing_shows_between_triangles),
        cmocka_unit_test(any_number_of_threads_and_any_processor_give_the_same_bits),
        cmocka_unit_test(tiles_without_anything_say_so),
        cmocka_unit_test(rays_are_asked_where_they_do_better),
        cmocka_unit_test(running_out_of_memory_is_reported),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
