/* SPDX-License-Identifier: MIT
 * test_surface.c - visible surfaces of pixels: against balls and planes in closed form, and against single texture look-ups. */
#include "shapes.h"

#include "image/color.h"
#include "render/surface/stage.h"

/* A scene ready to render at one size. */
struct stage {
    struct pell_context *ctx;
    struct pell_scene *scene;
    struct pell_pool *pool;
    struct pell_rays *rays;
    struct pell_mips *mips;
    struct pell_surface surface;
    struct pell_view view;
    float spread;
};

static struct stage stage_of(struct pell_context *ctx, struct pell_scene *scene, int threads)
{
    struct stage s = { .ctx = ctx, .scene = scene };

    assert_int_equal(pell_pool_create(ctx, threads, &s.pool), PELL_OK);
    assert_int_equal(pell_rays_create(ctx, scene, s.pool, &s.rays), PELL_OK);
    return s;
}

static void add_mips(struct stage *s)
{
    assert_int_equal(pell_mips_create(s->ctx, s->scene, s->pool, &s->mips), PELL_OK);
}

/* From z = `distance` along -z; `height` > 0: orthographic, else 0.5 radians. */
static void render(struct stage *s, int width, int height, float distance, float ortho)
{
    const struct pell_camera c = {
        .position = { 0, 0, distance }, .forward = { 0, 0, -1 }, .up = { 0, 1, 0 }, .fov = 0.5f, .ortho_height = ortho
    };

    pell_surface_finish(s->ctx, &s->surface);
    s->view = pell_view_make(&c, width, height, 0.0f, 0.0f);
    assert_int_equal(pell_surface_allocate(s->ctx, width, height, &s->surface), PELL_OK);
    s->surface.mips = s->mips;
    s->surface.spread = s->spread;
    assert_int_equal(pell_surface_render(s->pool, s->rays, s->scene, &s->view, &s->surface), PELL_OK);
}

static void stage_finish(struct stage *s)
{
    pell_surface_finish(s->ctx, &s->surface);
    pell_mips_destroy(&s->mips);
    pell_rays_destroy(&s->rays);
    pell_pool_destroy(&s->pool);
    pell_scene_destroy(&s->scene);
    pell_context_destroy(&s->ctx);
}

static struct pell_vec3 at(float *const plane[3], ptrdiff_t i)
{
    return vec3(plane[0][i], plane[1][i], plane[2][i]);
}

/* Counts and rectangles against the material plane, and invariants of every pixel. */
static void check_invariants(const struct stage *st)
{
    const struct pell_surface *s = &st->surface;
    struct pell_rect covered = { s->width, s->height, 0, 0 }, translucent = covered;
    int64_t hits = 0, inside = 0;

    for (int y = 0; y < s->height; y++)
        for (int x = 0; x < s->width; x++) {
            const ptrdiff_t i = y * s->stride + x;
            struct pell_rect *const rects[2] = { &covered, &translucent };
            struct pell_vec3 o, d, ng, ns;
            bool solid;
            if (!s->material[i])
                continue;
            assert_true(s->material[i] <= st->scene->num_materials);
            solid = !st->scene->materials[s->material[i] - 1].opaque;
            hits++;
            inside += solid;
            for (int k = 0; k < 1 + solid; k++) {
                rects[k]->x0 = x < rects[k]->x0 ? x : rects[k]->x0;
                rects[k]->y0 = y < rects[k]->y0 ? y : rects[k]->y0;
                rects[k]->x1 = x + 1 > rects[k]->x1 ? x + 1 : rects[k]->x1;
                rects[k]->y1 = y + 1 > rects[k]->y1 ? y + 1 : rects[k]->y1;
            }
            assert_true(s->depth[i] > 0.0f && isfinite(s->depth[i]));
            pell_view_ray(&st->view, (float) x, (float) y, &o, &d);
            d = vec3_normalize(d);
            ng = at(s->ng, i);
            ns = at(s->ns, i);
            REQUIRE_NEAR(vec3_length(ng), 1.0, 1e-5);
            REQUIRE_NEAR(vec3_length(ns), 1.0, 1e-5);
            assert_true(vec3_dot(ng, d) <= 0.0f);
            assert_true(vec3_dot(ns, d) < -0.0099f);
            assert_true(vec3_dot(ns, ng) > 0.0f);
            assert_true(s->roughness[i] >= 0.03f && s->roughness[i] <= 1.0f);
            assert_true(s->metallic[i] >= 0.0f && s->metallic[i] <= 1.0f);
            assert_true(s->strength[i] >= 0.0f && s->strength[i] <= 1.0f);
        }
    assert_int_equal(hits, s->covered_pixels);
    assert_int_equal(inside, s->translucent_pixels);
    assert_true(s->rays >= hits);
    if (hits)
        assert_memory_equal(&covered, &s->covered, sizeof(covered));
    else
        assert_true(s->covered.x0 >= s->covered.x1);
    if (inside)
        assert_memory_equal(&translucent, &s->translucent, sizeof(translucent));
    else
        assert_true(s->translucent.x0 >= s->translucent.x1);
}

/* Largest errors of depth and normal over pixels well inside a ball of radius 10 about the origin; all of them must be covered, none
 * outside. */
static void ball_errors(const struct stage *st, double *depth, double *normal)
{
    const struct pell_surface *s = &st->surface;

    *depth = *normal = 0.0;
    for (int y = 0; y < s->height; y++)
        for (int x = 0; x < s->width; x++) {
            const ptrdiff_t i = y * s->stride + x;
            struct pell_vec3 o, d, p, ns = at(s->ns, i);
            double a, b, c, disc, t, off;
            pell_view_ray(&st->view, (float) x, (float) y, &o, &d);
            a = vec3_dot(d, d);
            b = vec3_dot(o, d);
            c = vec3_dot(o, o) - 100.0;
            disc = b * b - a * c;
            off = sqrt(fmax(0.0, vec3_dot(o, o) - b * b / a)); /* distance of the ray from the centre */
            if (off > 10.0)
                assert_int_equal(s->material[i], 0);
            if (off > 9.0)
                continue;
            if (s->material[i] != 1)
                fail_msg("pixel %d %d, %.3g from the centre, is not covered", x, y, off);
            t = (-b - sqrt(disc)) / a;
            p = vec3_mul(vec3_mad(o, (float) t, d), 0.1f);
            *depth = fmax(*depth, fabs(s->depth[i] - t));
            *normal = fmax(*normal, vec3_length(vec3_sub(ns, p)));
        }
}

static void a_ball_converges_over_three_tessellations_and_has_no_pinholes(void **state)
{
    static const int rings[3] = { 20, 40, 80 };
    double depth[2][3], normal[2][3];

    (void) state;
    for (int k = 0; k < 3; k++) {
        struct pell_context *ctx = test_context(NULL, NULL);
        struct pell_scene *scene = shapes_scene(ctx);
        struct stage s;
        shapes_ball(scene, 0, vec3(0, 0, 0), 10.0f, rings[k]);
        s = stage_of(ctx, scene, 2);
        for (int ortho = 0; ortho < 2; ortho++) {
            render(&s, 211, 199, 60.0f, ortho ? 24.0f : 0.0f);
            check_invariants(&s);
            ball_errors(&s, &depth[ortho][k], &normal[ortho][k]);
            /* The silhouette's area: a polygon inscribed in a disc. */
            const double per_px = ortho ? 24.0 / 199.0 : 60.0 / s.view.focal_px, r = ortho ? 10.0 : 10.0 / sqrt(1.0 - 1.0 / 36.0);
            REQUIRE_REL((double) s.surface.covered_pixels * per_px * per_px, PELL_PI * r * r, k == 2 ? 0.003 : 0.02);
        }
        stage_finish(&s);
    }
    for (int ortho = 0; ortho < 2; ortho++) {
        REQUIRE_NEAR(depth[ortho][2], 0.0, 0.03);
        REQUIRE_NEAR(normal[ortho][2], 0.0, 0.003);
        for (int k = 0; k < 2; k++) { /* both errors are quadratic in the size of a facet */
            assert_true(depth[ortho][k] / depth[ortho][k + 1] > 3.0);
            assert_true(normal[ortho][k] / normal[ortho][k + 1] > 3.0);
        }
    }
}

/* The footprint of a pixel of w mm on a ball of radius r, at t from its middle, is w across and w / cos t along the slope, and normals
 * turn by 1/r there. A plane's normals do not, and its value is clamped for a whole silhouette. */
static void normals_turn_inside_of_a_pixel_as_on_a_ball(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    struct stage s;
    double worst = 0.0;
    int seen = 0;

    (void) state;
    shapes_ball(scene, 0, vec3(0, 0, 0), 10.0f, 160);
    s = stage_of(ctx, scene, 2);
    for (int ortho = 0; ortho < 2; ortho++) {
        s.spread = 0.25f;
        render(&s, 121, 99, 60.0f, ortho ? 24.0f : 0.0f);
        for (int y = 0; y < s.surface.height; y++)
            for (int x = 0; x < s.surface.width; x++) {
                const ptrdiff_t i = y * s.surface.stride + x;
                const double w = (ortho ? 1.0 : (double) s.surface.depth[i]) / (double) s.view.focal_px;
                struct pell_vec3 o, d;
                double c;
                if (!s.surface.material[i])
                    continue;
                pell_view_ray(&s.view, (float) x, (float) y, &o, &d);
                REQUIRE(s.surface.slope_variance[i] > 0.0f && s.surface.slope_variance[i] <= 0.02f);
                c = (double) vec3_dot(at(s.surface.ng, i), vec3_normalize(d));
                if (c > -0.5) /* facets are nowhere as steep as the ball */
                    continue;
                worst = fmax(worst, fabs((double) s.surface.slope_variance[i] / (0.25 * w * w / 100.0 * (1.0 + 1.0 / (c * c))) - 1.0));
                seen++;
            }
    }
    print_message("# normals turn as on a ball within %.3f at %d pixels\n", worst, seen);
    REQUIRE(seen > 3000);
    REQUIRE_NEAR(worst, 0.0, 0.1);
    render(&s, 4, 3, 60.0f, 24.0f);
    REQUIRE_NEAR((double) s.surface.slope_variance[s.surface.stride + 1], 0.02, 1e-7);
    stage_finish(&s);
}

static void a_plane_has_its_depth_and_a_picture_its_right_side_up(void **state)
{
    static const uint8_t pixels[12] = { 255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255 }; /* red green / blue white */
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    struct pell_texture *t = shapes_texture(scene, 2, 2, 3, true, pixels);
    struct stage s;

    (void) state;
    shapes_quad(scene, 0, vec3(0, 0, 0), vec3(10, 0, 0), vec3(0, 10, 0));
    scene->materials[0].base_color_map.texture = t;
    scene->materials[0].base_color[1] = 0.5f;
    t->nearest = true;
    s = stage_of(ctx, scene, 1);
    add_mips(&s);
    for (int ortho = 0; ortho < 2; ortho++) {
        render(&s, 64, 48, 50.0f, ortho ? 20.0f : 0.0f);
        check_invariants(&s);
        for (int y = 0; y < 48; y++)
            for (int x = 0; x < 64; x++) {
                const ptrdiff_t i = y * s.surface.stride + x;
                const bool right = x >= 32, low = y >= 24;
                if (!s.surface.material[i])
                    continue;
                REQUIRE_REL(s.surface.depth[i], 50.0, 1e-6);
                REQUIRE_NEAR(s.surface.ng[2][i], 1.0, 1e-6);
                REQUIRE_NEAR(s.surface.ns[2][i], 1.0, 1e-6);
                REQUIRE_NEAR(s.surface.base[0][i], right == low ? 1.0 : 0.0, 1e-6);
                REQUIRE_NEAR(s.surface.base[1][i], right ? 0.5 : 0.0, 1e-6);
                REQUIRE_NEAR(s.surface.base[2][i], low ? 1.0 : 0.0, 1e-6);
            }
        /* Pixels whose centre is less than half a side from the middle: 10 mm in 48 px for 20 mm, or 50 mm away. */
        const int half = ortho ? 24 : (int) floor(10.0 / 50.0 * (double) s.view.focal_px + 0.5);
        assert_int_equal(s.surface.covered_pixels, 4 * half * half);
    }
    stage_finish(&s);
}

static void odd_sizes_and_single_pixels_are_the_same_picture_cut_smaller(void **state)
{
    static const int sizes[][2] = { { 1, 1 }, { 1, 17 }, { 17, 1 }, { 3, 5 }, { 15, 16 }, { 16, 15 }, { 31, 9 }, { 129, 67 } };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    struct stage s;

    (void) state;
    shapes_ball(scene, 0, vec3(0, 0, 0), 10.0f, 30);
    shapes_quad(scene, shapes_material(scene, true), vec3(0, 0, -12), vec3(3, 0, 0), vec3(0, 20, 0));
    s = stage_of(ctx, scene, 3);
    for (size_t n = 0; n < PELL_COUNT(sizes); n++) {
        render(&s, sizes[n][0], sizes[n][1], 60.0f, n % 2 ? 0.0f : 15.0f);
        check_invariants(&s);
        assert_int_equal(s.surface.material[sizes[n][1] / 2 * s.surface.stride + sizes[n][0] / 2], 1);
    }
    stage_finish(&s);
}

/* The bounding rectangle must not lose a pixel of the silhouette: with a ground plane the whole image is traced. */
static void the_rectangle_of_the_bounds_loses_no_pixel(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    struct stage s;
    uint16_t *kept;
    size_t bytes;

    (void) state;
    shapes_ball(scene, 0, vec3(1.3f, -0.4f, 0.2f), 10.0f, 25);
    s = stage_of(ctx, scene, 2);
    for (int n = 0; n < 12; n++) {
        const float distance = 11.5f + 9.0f * (float) n;
        render(&s, 97, 83, distance, n % 3 == 2 ? 22.0f : 0.0f);
        bytes = (size_t) s.surface.stride * 83 * sizeof(*kept);
        kept = pell_alloc(ctx, bytes);
        memcpy(kept, s.surface.material, bytes);
        check_invariants(&s);
        const int64_t rays = s.surface.rays;
        scene->ground_mesh = 0;
        assert_int_equal(pell_surface_render(s.pool, s.rays, scene, &s.view, &s.surface), PELL_OK);
        scene->ground_mesh = -1;
        assert_memory_equal(kept, s.surface.material, bytes);
        assert_int_equal(s.surface.rays, 97 * 83);
        assert_true(rays <= s.surface.rays);
        if (n > 6 && n % 3 != 2)
            assert_true(rays < s.surface.rays / 2);
        pell_free(ctx, kept);
    }
    stage_finish(&s);
}

static void what_was_there_in_the_last_frame_is_gone(void **state)
{
    const struct pell_camera away = { .position = { 0, 0, 22 }, .forward = { 0, 0, 1 }, .up = { 0, 1, 0 }, .fov = 0.5f };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    struct stage s;

    (void) state;
    shapes_ball(scene, 0, vec3(0, 0, 0), 10.0f, 20);
    s = stage_of(ctx, scene, 2);
    render(&s, 64, 64, 22.0f, 0.0f);
    assert_true(s.surface.covered_pixels > 1000);
    s.view = pell_view_make(&away, 64, 64, 0, 0);
    assert_int_equal(pell_surface_render(s.pool, s.rays, scene, &s.view, &s.surface), PELL_OK);
    assert_int_equal(s.surface.covered_pixels, 0);
    assert_int_equal(s.surface.rays, 0);
    check_invariants(&s);
    for (ptrdiff_t i = 0; i < 64 * s.surface.stride; i++)
        assert_int_equal(s.surface.material[i], 0);
    stage_finish(&s);
}

/* A bumpy, textured scene with several materials in one packet. */
static struct pell_scene *rich_scene(struct pell_context *ctx)
{
    struct pell_scene *s = shapes_scene(ctx);
    uint8_t *standard_error = pell_alloc(ctx, 64 * 64 * 3);
    uint32_t seed = 5;
    struct pell_texture *t;

    assert_non_null(standard_error);
    for (int i = 0; i < 64 * 64 * 3; i++)
        standard_error[i] = (uint8_t) (128.0f + 127.0f * (shapes_random(&seed) - 0.5f));
    shapes_ball(s, 0, vec3(0, 0, 0), 10.0f, 12);
    for (int i = 0; i < 6; i++) {
        const size_t m = shapes_material(s, i % 2 == 0);
        struct pell_material *material = &s->materials[m];
        t = shapes_texture(s, 64, 64, 3, i % 2 == 0, standard_error);
        material->base_color_map.texture = t;
        t = shapes_texture(s, 63, 64, 3, false, standard_error);
        material->normal_map.texture = material->strength_map.texture = material->roughness_map.texture = t;
        material->metallic_map = material->roughness_map;
        material->metallic = 1.0f;
        material->metallic_map.channel = 2;
        material->emissive[0] = i == 3 ? 2.0f : 0.0f;
        shapes_quad(s, m, vec3(-12.0f + 4.0f * (float) i, 2.0f * (float) i - 6.0f, 3.0f), vec3(2, 0, (float) i - 2), vec3(0.3f, 7, 1));
    }
    pell_free(ctx, standard_error);
    return s;
}

static uint64_t hash_plane(uint64_t h, const void *data, size_t row, size_t stride, int rows)
{
    for (int y = 0; y < rows; y++)
        for (size_t i = 0; i < row; i++)
            h = (h ^ ((const uint8_t *) data + stride * (size_t) y)[i]) * 0x100000001b3ull;
    return h;
}

/* Compares defined values only: the other planes are undefined where nothing was hit. */
static uint64_t hash_surface(const struct pell_surface *s)
{
    const float *const planes[] = { s->depth,     s->ng[0],       s->ng[1],       s->ng[2],       s->ns[0],
                                    s->ns[1],     s->ns[2],       s->base[0],     s->base[1],     s->base[2],
                                    s->roughness, s->metallic,    s->specular[0], s->specular[1], s->specular[2],
                                    s->strength,  s->emissive[0], s->emissive[1], s->emissive[2] };
    uint64_t h = hash_plane(0xcbf29ce484222325ull, s->material, (size_t) s->width * 2, (size_t) s->stride * 2, s->height);

    for (int y = 0; y < s->height; y++)
        for (int x = 0; x < s->width; x++)
            if (s->material[y * s->stride + x])
                for (size_t k = 0; k < PELL_COUNT(planes); k++)
                    h = hash_plane(h, planes[k] + y * s->stride + x, sizeof(float), 0, 1);
    return h;
}

static void any_number_of_threads_and_any_processor_give_the_same_bits(void **state)
{
    static const int threads[] = { 1, 2, 3, 5 };
    static const char *const levels[] = { "base", "v2", "v3", "v4" };
    uint64_t first = 0;
    int64_t pixels = 0;

    (void) state;
    for (size_t n = 0; n < PELL_COUNT(threads) + PELL_COUNT(levels); n++) {
        struct pell_context *ctx = test_context(NULL, NULL);
        struct stage s = stage_of(ctx, rich_scene(ctx), n < PELL_COUNT(threads) ? threads[n] : 2);
        if (n >= PELL_COUNT(threads))
            setenv("PELL_SIMD", levels[n - PELL_COUNT(threads)], 1);
        add_mips(&s);
        render(&s, 203, 151, 60.0f, 0.0f);
        unsetenv("PELL_SIMD");
        assert_true(s.surface.any_emissive);
        if (n == 0) {
            check_invariants(&s);
            first = hash_surface(&s.surface);
            pixels = s.surface.covered_pixels;
            assert_true(pixels > 8000 && s.surface.translucent_pixels < pixels);
        }
        assert_int_equal(hash_surface(&s.surface), first);
        assert_int_equal(s.surface.covered_pixels, pixels);
        stage_finish(&s);
    }
}

/* A surface by rasterisation of its scene against one by rays: equal except where a pixel's centre lies on an edge, to rounding; the
 * same bits on any number of threads and any processor; and nothing remains of the previous frame. */
static void drawn_and_traced_are_one_picture(void **state)
{
    static const char *const levels[] = { "base", "v2", "v3", "v4" };
    const struct pell_camera away = { .position = { 0, 0, 22 }, .forward = { 0, 0, 1 }, .up = { 0, 1, 0 }, .fov = 0.5f };
    struct pell_context *ctx = test_context(NULL, NULL);

    (void) state;
    for (int k = 0; k < 8; k++) {
        const int width = k & 1 ? 97 : 64, height = k & 2 ? 75 : 64;
        struct pell_scene *scene = rich_scene(ctx);
        struct pell_surface traced, first;
        struct pell_raster *raster;
        int64_t differ = 0, unequal = 0;
        struct stage s = stage_of(ctx, scene, 1);

        add_mips(&s);
        render(&s, width, height, 40.0f, k & 4 ? 24.0f : 0.0f);
        traced = s.surface;
        memset(&s.surface, 0, sizeof(s.surface));
        for (size_t level = 0; level < PELL_COUNT(levels); level++) {
            setenv("PELL_SIMD", levels[level], 1);
            assert_int_equal(pell_raster_create(ctx, scene, width, height, &raster), PELL_OK);
            assert_non_null(raster);
            pell_surface_finish(ctx, &s.surface);
            assert_int_equal(pell_surface_allocate(ctx, width, height, &s.surface), PELL_OK);
            unsetenv("PELL_SIMD");
            s.surface.mips = s.mips;
            s.surface.raster = raster;
            memset(s.surface.material, 0xff, (size_t) (s.surface.stride * height) * sizeof(*s.surface.material));
            if (level == 2) { /* other threads */
                pell_pool_destroy(&s.pool);
                assert_int_equal(pell_pool_create(ctx, 3, &s.pool), PELL_OK);
            }
            assert_int_equal(pell_surface_render(s.pool, s.rays, scene, &s.view, &s.surface), PELL_OK);
            check_invariants(&s);
            assert_int_equal(s.surface.rays, traced.rays);
            if (level == 0) {
                first = s.surface;
                memset(&s.surface, 0, sizeof(s.surface));
            } else {
                assert_memory_equal(first.material, s.surface.material, (size_t) (first.stride * height) * sizeof(*first.material));
                for (ptrdiff_t i = 0; i < first.stride * height; i++)
                    if (first.material[i])
                        assert_true(first.depth[i] == s.surface.depth[i] && first.ns[0][i] == s.surface.ns[0][i] &&
                                    first.terminator_offset[i] == s.surface.terminator_offset[i] &&
                                    first.base[1][i] == s.surface.base[1][i]);
            }
            if (level + 1 < PELL_COUNT(levels))
                pell_raster_destroy(&raster);
        }
        for (ptrdiff_t i = 0; i < first.stride * height; i++) {
            const bool here = first.material[i] != 0, there = i % first.stride < width && traced.material[i] != 0;
            differ += here != there || (here && first.material[i] != traced.material[i]);
            if (!here || first.material[i] != traced.material[i])
                continue;
            unequal += fabsf(first.depth[i] - traced.depth[i]) > 1e-3f || fabsf(first.ng[0][i] - traced.ng[0][i]) > 1e-3f ||
                       fabsf(first.ns[1][i] - traced.ns[1][i]) > 1e-3f || fabsf(first.base[0][i] - traced.base[0][i]) > 2e-3f ||
                       fabsf(first.terminator_offset[i] - traced.terminator_offset[i]) > 1e-4f ||
                       fabsf(first.roughness[i] - traced.roughness[i]) > 2e-3f;
        }
        assert_true(traced.covered_pixels > 500);
        assert_true(differ <= 3);
        assert_true(unequal <= traced.covered_pixels / 200);
        s.view = pell_view_make(&away, width, height, 0, 0);
        s.surface.raster = raster;
        assert_int_equal(pell_surface_render(s.pool, s.rays, scene, &s.view, &s.surface), PELL_OK);
        assert_int_equal(s.surface.covered_pixels, 0);
        check_invariants(&s);
        pell_raster_destroy(&raster);
        pell_surface_finish(ctx, &first);
        pell_surface_finish(ctx, &traced);
        pell_surface_finish(ctx, &s.surface);
        pell_mips_destroy(&s.mips);
        pell_rays_destroy(&s.rays);
        pell_pool_destroy(&s.pool);
        pell_scene_destroy(&scene);
    }
    pell_context_destroy(&ctx);
}

static void a_frame_allocates_nothing(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct stage s = stage_of(ctx, rich_scene(ctx), 2);
    uint64_t before;

    (void) state;
    add_mips(&s);
    render(&s, 80, 60, 60.0f, 0.0f);
    before = pell_allocations(ctx);
    for (int i = 0; i < 5; i++)
        assert_int_equal(pell_surface_render(s.pool, s.rays, s.scene, &s.view, &s.surface), PELL_OK);
    assert_int_equal(pell_allocations(ctx), before);
    stage_finish(&s);
}

static void holes_and_insides(void **state)
{
    static const uint8_t pixels[4 * 2] = { 200, 255, 200, 0, 200, 0, 200, 255 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    const size_t leaf = shapes_material(scene, true);
    struct pell_texture *t = shapes_texture(scene, 2, 2, 2, true, pixels);
    struct stage s;

    (void) state;
    t->nearest = true;
    scene->materials[leaf].alpha_mask = true;
    scene->materials[leaf].base_color_map.texture = t;
    shapes_quad(scene, leaf, vec3(0, 0, 0), vec3(10, 0, 0), vec3(0, 10, 0));
    shapes_ball(scene, 0, vec3(0, 0, 0), 200.0f, 40); /* seen from inside */
    s = stage_of(ctx, scene, 2);
    render(&s, 64, 64, 50.0f, 20.0f);
    check_invariants(&s);
    assert_int_equal(s.surface.covered_pixels, 64 * 64);
    assert_int_equal(s.surface.translucent_pixels, 64 * 64 / 2);
    for (int y = 0; y < 64; y++)
        for (int x = 0; x < 64; x++) {
            const ptrdiff_t i = y * s.surface.stride + x;
            const bool hole = (x >= 32) != (y >= 32);
            assert_int_equal(s.surface.material[i], hole ? 1 : (int) leaf + 1);
            REQUIRE_NEAR(s.surface.depth[i], hole ? 250.0 : 50.0, hole ? 2.0 : 1e-3);
            REQUIRE_NEAR(s.surface.ns[2][i], 1.0, 0.01); /* toward the viewer, although the ball's normals point out */
        }
    stage_finish(&s);
}

static void normals_that_point_anywhere_are_brought_to_the_viewer(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    struct pell_mesh *m = shapes_ball(scene, 0, vec3(0, 0, 0), 10.0f, 6);
    uint32_t seed = 9;
    struct stage s;

    (void) state;
    s = stage_of(ctx, scene, 1);
    render(&s, 128, 128, 45.0f, 0.0f); /* so coarse that many interpolated normals point away */
    check_invariants(&s);
    for (uint32_t i = 0; i < 3 * m->num_vertices; i++)
        m->normal[i] = shapes_random(&seed) - 0.5f;
    render(&s, 128, 128, 45.0f, 0.0f);
    check_invariants(&s);
    for (uint32_t i = 0; i < 3 * m->num_vertices; i++)
        m->normal[i] = 0.0f;
    render(&s, 128, 128, 45.0f, 0.0f); /* none: facets */
    check_invariants(&s);
    for (int y = 0; y < 128; y++)
        for (int x = 0; x < 128; x++) {
            const ptrdiff_t i = y * s.surface.stride + x;
            if (s.surface.material[i] && s.surface.ng[2][i] > 0.3f)
                REQUIRE_NEAR(vec3_dot(at(s.surface.ng, i), at(s.surface.ns, i)), 1.0, 1e-5);
        }
    stage_finish(&s);
}

static void normal_maps_bend_the_normal_as_gltf_says(void **state)
{
    static const uint8_t pixels[3] = { 204, 153, 242 }; /* +0.6 right, +0.2 up, +0.898 out */
    const double a = 2.0 * 204 / 255 - 1, b = 2.0 * 153 / 255 - 1, c = 2.0 * 242 / 255 - 1;
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    struct pell_mesh *m = shapes_quad(scene, 0, vec3(0, 0, 0), vec3(10, 0, 0), vec3(0, 10, 0));
    struct stage s;

    (void) state;
    scene->materials[0].normal_map.texture = shapes_texture(scene, 1, 1, 3, false, pixels);
    s = stage_of(ctx, scene, 1);
    add_mips(&s);
    for (int kind = 0; kind < 5; kind++) {
        /* unchanged; half as strong; bitangent mirrored; seen from behind: the whole frame turned; no tangents: no map */
        const double k = kind == 1 ? 0.5 : 1.0, mirror = kind == 2 ? -1.0 : 1.0;
        const double behind = kind == 3 ? -1.0 : 1.0, on = kind == 4 ? 0.0 : 1.0;
        const double length = sqrt(on * (a * a + b * b) * k * k + c * c);
        const struct pell_camera back = { .position = { 0, 0, -50 }, .forward = { 0, 0, 1 }, .up = { 0, 1, 0 }, .ortho_height = 20 };
        scene->materials[0].normal_scale = (float) k;
        for (int i = 0; i < 4; i++) {
            m->tangent[4 * i + 3] = (float) mirror;
            m->tangent[4 * i] = (float) on; /* zero length: no frame */
        }
        render(&s, 16, 16, 50.0f, 20.0f);
        if (kind == 3) {
            s.view = pell_view_make(&back, 16, 16, 0, 0);
            assert_int_equal(pell_surface_render(s.pool, s.rays, scene, &s.view, &s.surface), PELL_OK);
        }
        check_invariants(&s);
        REQUIRE_NEAR(s.surface.ns[0][5 * s.surface.stride + 5], behind * on * k * a / length, 1e-4);
        REQUIRE_NEAR(s.surface.ns[1][5 * s.surface.stride + 5], behind * on * mirror * k * b / length, 1e-4);
        REQUIRE_NEAR(s.surface.ns[2][5 * s.surface.stride + 5], behind * c / length, 1e-4);
        REQUIRE_NEAR(s.surface.ng[2][5 * s.surface.stride + 5], behind, 1e-6);
    }
    stage_finish(&s);
}

/* Bumps smaller than a pixel act as roughness: slopes of +-s along x in every other texel have the variance s^2 along one axis, half of
 * it in the mean. */
static void bumps_smaller_than_a_pixel_are_roughness(void **state)
{
    enum { SIZE = 256 };
    const float slope = 0.35f, z = 1.0f / sqrtf(1.0f + slope * slope);

    (void) state;
    for (int model = 0; model < 2; model++) {
        struct pell_context *ctx = test_context(NULL, NULL);
        struct pell_scene *scene = shapes_scene(ctx);
        struct stage s;
        uint8_t *pixels = malloc((size_t) 3 * SIZE * SIZE);
        double expected, mean = 0.0;
        assert_non_null(pixels);
        for (int i = 0; i < SIZE * SIZE; i++) {
            const float x = (i % SIZE + i / SIZE) % 2 ? slope * z : -slope * z;
            pixels[3 * i] = (uint8_t) lrintf(255.0f * (0.5f + 0.5f * x));
            pixels[3 * i + 1] = 128;
            pixels[3 * i + 2] = (uint8_t) lrintf(255.0f * (0.5f + 0.5f * z));
        }
        scene->materials[0].normal_map.texture = shapes_texture(scene, SIZE, SIZE, 3, false, pixels);
        scene->materials[0].specular = model ? PELL_SPECULAR_KELEMEN : PELL_SPECULAR_GGX;
        scene->materials[0].roughness = 0.3f;
        free(pixels);
        shapes_quad(scene, 0, vec3(0, 0, 0), vec3(10, 0, 0), vec3(0, 10, 0));
        s = stage_of(ctx, scene, 1);
        add_mips(&s);
        render(&s, 16, 16, 100.0f, 16.0f);
        for (int i = 0; i < 256; i++)
            mean += (double) s.surface.roughness[i / 16 * s.surface.stride + i % 16] / 256.0;
        expected = model ? sqrt(0.09 + (double) (slope * slope)) : sqrt(sqrt(pow(0.3, 4.0) + (double) (slope * slope)));
        print_message("# roughness 0.3 over bumps: %.3f, expected %.3f\n", mean, expected);
        REQUIRE_NEAR(mean, expected, 0.05 * expected);
        stage_finish(&s);
    }
}

static void every_map_multiplies_its_own_factor(void **state)
{
    static const uint8_t four[4] = { 51, 102, 153, 204 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    struct pell_texture *t = shapes_texture(scene, 1, 1, 4, false, four);
    struct pell_mesh *quad = shapes_quad(scene, 0, vec3(0, 0, 0), vec3(10, 0, 0), vec3(0, 10, 0));
    struct pell_material *m = &scene->materials[0];
    struct stage s;
    ptrdiff_t i;

    (void) state;
    m->base_color_map.texture = m->metallic_map.texture = m->roughness_map.texture = m->rho_s_map.texture = m->specular_color_map.texture =
        m->strength_map.texture = m->emissive_map.texture = t;
    m->roughness_map.channel = 1;
    m->metallic_map.channel = 2;
    m->rho_s_map.channel = 3;
    m->strength_map.channel = 0;
    m->roughness = 0.5f;
    m->metallic = 0.9f;
    m->rho_s = 0.7f;
    m->strength = 0.8f;
    for (int c = 0; c < 3; c++) {
        m->base_color[c] = 0.9f - 0.1f * (float) c;
        m->specular_color[c] = 0.5f + 0.1f * (float) c;
        m->emissive[c] = 3.0f + (float) c;
    }
    quad->color = pell_calloc(ctx, 4, 4 * sizeof(float));
    for (int k = 0; k < 16; k++)
        quad->color[k] = 0.25f + 0.25f * (float) (k % 4);
    s = stage_of(ctx, scene, 1);
    render(&s, 16, 16, 50.0f, 20.0f);
    check_invariants(&s);
    i = 5 * s.surface.stride + 5;
    assert_true(s.surface.any_emissive);
    for (int c = 0; c < 3; c++) {
        REQUIRE_NEAR(s.surface.base[c][i], (0.9 - 0.1 * c) * 0.2 * (1 + c) * (0.25 + 0.25 * c), 1e-5);
        REQUIRE_NEAR(s.surface.specular[c][i], 0.7 * 0.8 * (0.5 + 0.1 * c) * 0.2 * (1 + c), 1e-5);
        REQUIRE_NEAR(s.surface.emissive[c][i], (3.0 + c) * 0.2 * (1 + c), 1e-4);
    }
    REQUIRE_NEAR(s.surface.roughness[i], 0.5 * 0.4, 1e-5);
    REQUIRE_NEAR(s.surface.metallic[i], 0.9 * 0.6, 1e-5);
    REQUIRE_NEAR(s.surface.strength[i], 0.8 * 0.2, 1e-5);
    m->roughness = 0.001f;
    render(&s, 16, 16, 50.0f, 20.0f);
    REQUIRE_NEAR(s.surface.roughness[i], 0.03, 1e-7);
    stage_finish(&s);
}

static void fill(struct pell_context *ctx, struct pell_image *image, enum pell_pixel_type type, int channels, uint32_t *seed)
{
    static const size_t sizes[] = { [PELL_PIXEL_U8] = 1, [PELL_PIXEL_U16] = 2, [PELL_PIXEL_F32] = 4 };
    const size_t count = (size_t) image->width * (size_t) image->height * (size_t) channels;

    image->type = type;
    image->channels = channels;
    image->pixels = pell_alloc(ctx, count * sizes[type]);
    assert_non_null(image->pixels);
    for (size_t i = 0; i < count; i++) {
        const float x = shapes_random(seed);
        if (type == PELL_PIXEL_U8)
            ((uint8_t *) image->pixels)[i] = (uint8_t) (x * 256.0f);
        else if (type == PELL_PIXEL_U16)
            ((uint16_t *) image->pixels)[i] = (uint16_t) (x * 65536.0f);
        else
            ((float *) image->pixels)[i] = 4.0f * x;
    }
}

/* All formats, wrap modes and texture matrices, against pell_image_sample at the point that the pixel sees. */
static void magnified_textures_are_what_a_look_up_one_by_one_gives(void **state)
{
    uint32_t seed = 11;

    (void) state;
    for (int n = 0; n < 3 * 4 * 3 * 2; n++) {
        struct pell_context *ctx = test_context(NULL, NULL);
        struct pell_scene *scene = shapes_scene(ctx);
        struct pell_texture *t = NULL;
        struct pell_texture_map *map = &scene->materials[0].base_color_map;
        struct stage s;
        const enum pell_pixel_type type = (enum pell_pixel_type)(n / 2 % 3);
        double worst = 0.0;

        assert_int_equal(pell_scene_add_texture(scene, "t", &t), PELL_OK);
        t->image = (struct pell_image) { .width = 5, .height = 4, .srgb = n % 2 && type != PELL_PIXEL_F32 };
        fill(ctx, &t->image, type, 1 + n / 6 % 4, &seed);
        t->wrap_u = (enum pell_wrap)(n / 24 % 3);
        t->wrap_v = (enum pell_wrap)((n / 24 + n) % 3);
        shapes_quad(scene, 0, vec3(0, 0, 0), vec3(10, 0, 0), vec3(0, 10, 0));
        map->texture = t;
        for (int k = 0; k < 6; k++)
            map->matrix[k] = 6.0f * shapes_random(&seed) - 3.0f;
        s = stage_of(ctx, scene, 1);
        add_mips(&s);
        render(&s, 128, 128, 50.0f, 20.0f);
        for (int y = 0; y < 128; y++)
            for (int x = 0; x < 128; x++) {
                const float u = ((float) x + 0.5f) / 128.0f, v = ((float) y + 0.5f) / 128.0f, *m = map->matrix;
                float rgba[4];
                pell_image_sample(&t->image, t->wrap_u, t->wrap_v, false, m[0] * u + m[1] * v + m[2], m[3] * u + m[4] * v + m[5], rgba);
                for (int c = 0; c < 3; c++)
                    worst = fmax(worst, fabs(s.surface.base[c][y * s.surface.stride + x] - rgba[c]));
            }
        REQUIRE_NEAR(worst, 0.0, type == PELL_PIXEL_F32 ? 2e-4 : 5e-5);
        stage_finish(&s);
    }
}

/* Far away a pixel must show the mean over its footprint: a board of single black and white texels, and noise of odd sizes. */
static void shrunk_textures_show_their_mean_and_do_not_alias(void **state)
{
    static const int sizes[][2] = { { 512, 512 }, { 301, 177 } };

    (void) state;
    for (int n = 0; n < 2 * 3 * 2; n++) {
        const int w = sizes[n % 2][0], h = sizes[n % 2][1];
        const enum pell_pixel_type type = (enum pell_pixel_type)(n / 2 % 3);
        struct pell_context *ctx = test_context(NULL, NULL);
        struct pell_scene *scene = shapes_scene(ctx);
        struct pell_texture *t = NULL;
        struct stage s;
        double mean[3] = { 0 }, deviation[2];
        uint32_t seed = 21;

        assert_int_equal(pell_scene_add_texture(scene, "t", &t), PELL_OK);
        t->image = (struct pell_image) { .width = w, .height = h, .srgb = n >= 6 && type != PELL_PIXEL_F32 };
        fill(ctx, &t->image, type, 3, &seed);
        for (int y = 0; y < h; y++)
            for (int x = 0; x < w; x++) {
                float rgba[4];
                pell_image_texel(&t->image, x, y, rgba);
                for (int c = 0; c < 3; c++)
                    mean[c] += rgba[c] / ((double) w * h);
            }
        shapes_quad(scene, 0, vec3(0, 0, 0), vec3(10, 0, 0), vec3(0, 10, 0));
        scene->materials[0].base_color_map.texture = t;
        s = stage_of(ctx, scene, 2);
        add_mips(&s);
        for (int with = 0; with < 2; with++) {
            double sum = 0.0, squares = 0.0;
            int count = 0;
            render(&s, 64, 64, 50.0f, 40.0f);
            if (!with) {
                s.surface.mips = NULL;
                assert_int_equal(pell_surface_render(s.pool, s.rays, scene, &s.view, &s.surface), PELL_OK);
            }
            for (int y = 17; y < 47; y++)
                for (int x = 17; x < 47; x++) {
                    const double v = s.surface.base[1][y * s.surface.stride + x];
                    sum += v;
                    squares += v * v;
                    count++;
                }
            sum /= count;
            deviation[with] = sqrt(fmax(0.0, squares / count - sum * sum)) / mean[1];
            if (with)
                REQUIRE_REL(sum, mean[1], 0.01);
        }
        /* Some 100 or 50 independent texels per pixel. */
        assert_true(deviation[1] < 0.25 * deviation[0]);
        stage_finish(&s);
    }
}

static void transparent_texels_do_not_bleed_into_smaller_levels(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = shapes_scene(ctx);
    uint8_t *pixels = pell_alloc(ctx, 256 * 256 * 4);
    struct stage s;

    (void) state;
    for (int i = 0; i < 256 * 256; i++) /* opaque green, transparent black, in columns */
        memcpy(pixels + 4 * i, i % 2 ? "\0\xff\0\xff" : "\0\0\0\0", 4);
    scene->materials[0].base_color_map.texture = shapes_texture(scene, 256, 256, 4, true, pixels);
    pell_free(ctx, pixels);
    shapes_quad(scene, 0, vec3(0, 0, 0), vec3(10, 0, 0), vec3(0, 10, 0));
    s = stage_of(ctx, scene, 1);
    add_mips(&s);
    render(&s, 64, 64, 50.0f, 40.0f);
    for (int y = 17; y < 47; y++)
        for (int x = 17; x < 47; x++)
            REQUIRE_NEAR(s.surface.base[1][y * s.surface.stride + x], 1.0, 1e-4);
    stage_finish(&s);
}

static void wrong_sizes_are_refused(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_scene *scene = shapes_scene(ctx);
    struct pell_surface surface;
    struct stage s;

    (void) state;
    assert_int_equal(pell_surface_allocate(ctx, 0, 5, &surface), PELL_ERR_INVALID);
    assert_int_equal(pell_surface_allocate(ctx, 5, -1, &surface), PELL_ERR_INVALID);
    assert_int_equal(pell_surface_allocate(ctx, 2147483647, 2147483647, &surface), PELL_ERR_INVALID);
    assert_int_equal(kept.errors, 3);
    pell_surface_finish(ctx, &surface);
    s = stage_of(ctx, scene, 1);
    render(&s, 8, 8, 50.0f, 20.0f);
    assert_int_equal(s.surface.covered_pixels, 0);
    s.view.width = 9;
    assert_int_equal(pell_surface_render(s.pool, s.rays, scene, &s.view, &s.surface), PELL_ERR_INVALID);
    assert_int_equal(kept.errors, 4);
    s.view.width = 8;
    pell_context_cancel(ctx);
    assert_int_equal(pell_surface_render(s.pool, s.rays, scene, &s.view, &s.surface), PELL_ERR_CANCELLED);
    stage_finish(&s);
}

static void lack_of_memory_leaves_nothing_behind(void **state)
{
    bool done = false;

    (void) state;
    for (uint64_t n = 1; !done; n++) {
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, NULL);
        struct stage s = stage_of(ctx, rich_scene(ctx), 1);
        enum pell_result res;
        fault.fail_at = atomic_load(&fault.calls) + n;
        res = pell_mips_create(ctx, s.scene, s.pool, &s.mips);
        if (res == PELL_OK)
            res = pell_surface_allocate(ctx, 33, 21, &s.surface);
        else
            assert_null(s.mips);
        done = res == PELL_OK;
        if (!done)
            assert_int_equal(res, PELL_ERR_NOMEM);
        assert_true(n < 200);
        assert_true(done || n > 0);
        stage_finish(&s);
        assert_int_equal(atomic_load(&fault.live), 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_ball_converges_over_three_tessellations_and_has_no_pinholes),
        cmocka_unit_test(normals_turn_inside_of_a_pixel_as_on_a_ball),
        cmocka_unit_test(a_plane_has_its_depth_and_a_picture_its_right_side_up),
        cmocka_unit_test(odd_sizes_and_single_pixels_are_the_same_picture_cut_smaller),
        cmocka_unit_test(the_rectangle_of_the_bounds_loses_no_pixel),
        cmocka_unit_test(what_was_there_in_the_last_frame_is_gone),
        cmocka_unit_test(any_number_of_threads_and_any_processor_give_the_same_bits),
        cmocka_unit_test(drawn_and_traced_are_one_picture),
        cmocka_unit_test(a_frame_allocates_nothing),
        cmocka_unit_test(holes_and_insides),
        cmocka_unit_test(normals_that_point_anywhere_are_brought_to_the_viewer),
        cmocka_unit_test(normal_maps_bend_the_normal_as_gltf_says),
        cmocka_unit_test(bumps_smaller_than_a_pixel_are_roughness),
        cmocka_unit_test(every_map_multiplies_its_own_factor),
        cmocka_unit_test(magnified_textures_are_what_a_look_up_one_by_one_gives),
        cmocka_unit_test(shrunk_textures_show_their_mean_and_do_not_alias),
        cmocka_unit_test(transparent_texels_do_not_bleed_into_smaller_levels),
        cmocka_unit_test(wrong_sizes_are_refused),
        cmocka_unit_test(lack_of_memory_leaves_nothing_behind),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
