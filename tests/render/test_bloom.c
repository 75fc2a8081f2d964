/* SPDX-License-Identifier: MIT
 * test_bloom.c - the point spread of bloom against its two Gaussians, conservation of light, and independence of threads. */
#include "pell_test.h"

#include "math/vec.h"
#include "render/plane_buffers.h"
#include "render/post/bloom.h"

struct image {
    struct pell_context *ctx;
    struct pell_pool *pool;
    struct pell_bloom_params params;
    float *plane[2], *scratch[PELL_BLOOM_PLANES];
};

static void start(struct image *p, int width, int height, float fraction, float sigma, int threads)
{
    float **planes[] = { &p->plane[0], &p->plane[1], &p->scratch[0], &p->scratch[1], &p->scratch[2] };

    p->ctx = test_context(NULL, NULL);
    assert_int_equal(pell_pool_create(p->ctx, threads, &p->pool), PELL_OK);
    assert_int_equal(pell_planes_allocate(p->ctx, width, height, planes, 5), PELL_OK);
    p->params = (struct pell_bloom_params) { width, height, pell_plane_stride(width), fraction, sigma };
}

static void finish(struct image *p)
{
    pell_free(p->ctx, p->plane[0]);
    pell_pool_destroy(&p->pool);
    pell_context_destroy(&p->ctx);
}

static float *at(struct image *p, int plane, int x, int y)
{
    return p->plane[plane] + y * p->params.stride + x;
}

static void spread(struct image *p)
{
    pell_bloom_render(p->pool, &p->params, p->plane, 2, p->scratch);
}

static double total(struct image *p, int plane)
{
    double sum = 0.0;
    for (int y = 0; y < p->params.height; y++)
        for (int x = 0; x < p->params.width; x++)
            sum += (double) *at(p, plane, x, y);
    return sum;
}

static double gaussian(double r2, double sigma)
{
    return exp(-0.5 * r2 / (sigma * sigma)) / (2.0 * PELL_PI * sigma * sigma);
}

/* For any position of the point relative to the coarse grid. */
static void a_point_is_spread_as_stated(void **state)
{
    static const int positions[][2] = { { 160, 120 }, { 163, 122 }, { 167, 127 } };
    static const double sigmas[] = { 2.0, 8.0, 13.0, 24.0 };
    (void) state;
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++) {
            const double sigma = sigmas[i], b = 0.25;
            const int cx = positions[k][0], cy = positions[k][1];
            double worst = 0.0, sum = 0.0, second = 0.0;
            struct image p;
            start(&p, 320, 240, (float) b, (float) sigma, 2);
            *at(&p, 0, cx, cy) = 1000.0f;
            spread(&p);
            for (int y = 0; y < 240; y++)
                for (int x = 0; x < 320; x++) {
                    const double r2 = (double) ((x - cx) * (x - cx) + (y - cy) * (y - cy)), got = (double) *at(&p, 0, x, y) / 1000.0;
                    const double want = 0.5 * b * (gaussian(r2, sigma) + gaussian(r2, 0.25 * sigma)) + (r2 == 0.0 ? 1.0 - b : 0.0);
                    if (sigma >= 8.0 || r2 > 4.0) /* a Gaussian of half a pixel does not resolve a point itself */
                        worst = fmax(worst, fabs(got - want) / (0.5 * b * (gaussian(0.0, sigma) + gaussian(0.0, 0.25 * sigma))));
                    sum += got;
                    second += got * r2;
                }
            print_message("# sigma %g px: %.3f of the halo's peak off at most, variance %.4f of what is stated\n", sigma, worst,
                          second / (b * sigma * sigma * (1.0 + 1.0 / 16.0)));
            REQUIRE(worst < 0.02);
            REQUIRE_NEAR(sum, 1.0, 1e-5);
            REQUIRE_NEAR(second / (b * sigma * sigma * (1.0 + 1.0 / 16.0)), 1.0, 0.02);
            assert_true(*at(&p, 1, cx, cy) == 0.0f); /* planes are separate */
            finish(&p);
        }
}

static void light_is_kept_and_uniform_light_stays(void **state)
{
    static const int sizes[][2] = { { 1, 1 }, { 2, 1 }, { 1, 9 }, { 17, 5 }, { 64, 64 }, { 131, 77 }, { 160, 96 } };
    static const float sigmas[] = { 0.0f, 0.3f, 1.0f, 7.0f, 40.0f, 4000.0f };
    uint32_t seed = 1;
    (void) state;
    for (size_t k = 0; k < sizeof(sizes) / sizeof(sizes[0]); k++)
        for (size_t i = 0; i < sizeof(sigmas) / sizeof(sigmas[0]); i++) {
            const int w = sizes[k][0], h = sizes[k][1];
            double before, after;
            struct image p;
            start(&p, w, h, 0.6f, sigmas[i], 2);
            for (int y = 0; y < h; y++)
                for (int x = 0; x < w; x++) {
                    seed = seed * 1664525u + 1013904223u;
                    *at(&p, 0, x, y) = (float) (seed >> 8) / 16777216.0f;
                    *at(&p, 1, x, y) = 0.75f;
                }
            before = total(&p, 0);
            spread(&p);
            after = total(&p, 0);
            /* boxes that extend beyond the border give pixels at the border more weight */
            REQUIRE_REL(after, before, w % 64 == 0 && h % 64 == 0 ? 1e-5 : 0.05);
            for (int y = 0; y < h; y++)
                for (int x = 0; x < w; x++)
                    REQUIRE_NEAR(*at(&p, 1, x, y), 0.75, 1e-5);
            if (sigmas[i] == 0.0f)
                REQUIRE_REL(after, before, 1e-6);
            finish(&p);
        }
}

static void threads_do_not_matter(void **state)
{
    struct image one, four;
    (void) state;
    start(&one, 203, 150, 0.2f, 11.0f, 1);
    start(&four, 203, 150, 0.2f, 11.0f, 4);
    for (int y = 0; y < 150; y++)
        for (int x = 0; x < 203; x++)
            *at(&one, 0, x, y) = *at(&four, 0, x, y) = (float) ((x * 7919 + y * 104729) % 1000);
    spread(&one);
    spread(&four);
    for (int y = 0; y < 150; y++)
        assert_memory_equal(at(&one, 0, 0, y), at(&four, 0, 0, y), 203 * sizeof(float));
    finish(&one);
    finish(&four);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_point_is_spread_as_stated),
        cmocka_unit_test(light_is_kept_and_uniform_light_stays),
        cmocka_unit_test(threads_do_not_matter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
