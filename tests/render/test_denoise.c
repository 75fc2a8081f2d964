/* SPDX-License-Identifier: MIT
 * test_denoise.c - the denoiser on images with known ground truth and noise: reduction of the error, preservation of edges, conservation
 * of light, and independence of threads. */
#include "pell_test.h"
#include "slow.h"

#include "math/vec.h"
#include "render/denoise/stage.h"
#include "render/plane_buffers.h"

#include <string.h>

enum { WIDTH = 150, HEIGHT = 110, PLANES = 25 };

struct picture {
    struct pell_context *ctx;
    struct pell_pool *pool;
    struct pell_accumulator sum;
    struct pell_denoise_params params;
    float *truth[3]; /* including the highlight */
    float highlight; /* in every second pixel */
};

/* A pixel's true radiance, and the features that distinguish it. */
typedef void scene_function(struct picture *p, int x, int y, size_t at);

static uint64_t mix_bits(uint64_t n)
{
    n = (n ^ (n >> 30)) * 0xbf58476d1ce4e5b9ULL;
    n = (n ^ (n >> 27)) * 0x94d049bb133111ebULL;
    return n ^ (n >> 31);
}

static double uniform(uint64_t number)
{
    return ((double) (mix_bits(number * 0x9e3779b97f4a7c15ULL + 1) >> 11) + 0.5) * 0x1p-53;
}

/* Means of `samples` exponential variates: skewed like path-traced samples. The variance is the samples' estimate, not the true one. */
static void add_noise(struct picture *p, size_t at, int samples)
{
    const float highlight = at % 2 ? p->highlight : 0.0f, covered = p->sum.translucent[at],
                coverage = covered > 0.0f ? covered : 1.0f; /* opaque: ignored */

    for (int c = 0; c < 3; c++) {
        double sum = 0.0, squares = 0.0, mean;
        for (int i = 0; i < samples; i++) {
            const double v = -(double) p->truth[c][at] * log(uniform((at * 3 + (size_t) c) * 64 + (size_t) i));
            sum += v;
            squares += v * v;
        }
        mean = sum / samples;
        p->sum.multiple[c][at] = coverage * (float) mean;
        p->sum.color[c][at] = p->sum.multiple[c][at] + highlight;
        p->truth[c][at] = coverage * p->truth[c][at] + highlight;
        p->sum.variance[c][at] = coverage * coverage * (float) ((squares / samples - mean * mean) / (samples - 1));
    }
}

static void start_below(struct picture *p, float highlight, int threads, int samples, scene_function *scene)
{
    float **planes[PLANES];
    int n = 0;

    memset(p, 0, sizeof(*p));
    p->highlight = highlight;
    for (int c = 0; c < 3; c++) {
        planes[n++] = &p->sum.color[c];
        planes[n++] = &p->sum.multiple[c];
        planes[n++] = &p->sum.variance[c];
        planes[n++] = &p->sum.normal[c];
        planes[n++] = &p->sum.albedo[c];
        planes[n++] = &p->truth[c];
    }
    planes[n++] = &p->sum.alpha;
    planes[n++] = &p->sum.depth;
    planes[n++] = &p->sum.translucent;
    for (int k = 0; k < PELL_DENOISE_PLANES; k++)
        planes[n++] = &p->params.scratch[k];
    p->ctx = test_context(NULL, NULL);
    assert_int_equal(pell_pool_create(p->ctx, threads, &p->pool), PELL_OK);
    assert_int_equal(pell_planes_allocate(p->ctx, WIDTH, HEIGHT, planes, (size_t) n), PELL_OK);
    p->params.stride = pell_plane_stride(WIDTH);
    p->params.rect = (struct pell_rect) { 0, 0, WIDTH, HEIGHT };
    p->params.sum = &p->sum;
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const size_t at = (size_t) (y * p->params.stride + x);
            p->sum.normal[2][at] = p->sum.alpha[at] = p->sum.translucent[at] = 1.0f;
            p->sum.depth[at] = 500.0f;
            for (int c = 0; c < 3; c++)
                p->sum.albedo[c][at] = 0.5f;
            scene(p, x, y, at);
            add_noise(p, at, samples);
        }
}

static void start(struct picture *p, int threads, int samples, scene_function *scene)
{
    start_below(p, 0.0f, threads, samples, scene);
}

static void finish(struct picture *p)
{
    pell_free(p->ctx, p->sum.color[0]);
    pell_pool_destroy(&p->pool);
    pell_context_destroy(&p->ctx);
}

/* Root mean square of the difference to the ground truth, relative to the mean. */
static double error_of(const struct picture *p, int x0, int x1)
{
    double sum = 0.0, mean = 0.0;

    for (int c = 0; c < 3; c++)
        for (int y = 0; y < HEIGHT; y++)
            for (int x = x0; x < x1; x++) {
                const size_t at = (size_t) (y * p->params.stride + x);
                const double d = (double) p->sum.color[c][at] - (double) p->truth[c][at];
                sum += d * d;
                mean += (double) p->truth[c][at];
            }
    return sqrt(sum / (3.0 * HEIGHT * (x1 - x0))) / (mean / (3.0 * HEIGHT * (x1 - x0)));
}

static double total(const struct picture *p)
{
    double sum = 0.0;

    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++)
            for (int c = 0; c < 3; c++)
                sum += (double) p->sum.color[c][y * p->params.stride + x];
    return sum;
}

/* Light that decreases over a ball's flank, as that of a medium does. */
static void smooth_light(struct picture *p, int x, int y, size_t at)
{
    const float u = ((float) x - 75.0f) / 110.0f, v = ((float) y - 55.0f) / 110.0f;
    const float n[3] = { u, v, sqrtf(1.0f - u * u - v * v) };

    for (int c = 0; c < 3; c++) {
        p->sum.normal[c][at] = n[c];
        p->truth[c][at] = (0.3f + 0.1f * (float) c) * (0.15f + (n[0] + 1.0f) * (n[0] + 1.0f) * n[2]);
    }
    p->sum.depth[at] = 500.0f - 90.0f * n[2];
}

/* A bright and a dark half that no feature distinguishes. */
static void step_of_light(struct picture *p, int x, int y, size_t at)
{
    (void) y;
    for (int c = 0; c < 3; c++)
        p->truth[c][at] = x < 75 ? 1.0f : 0.25f;
}

/* The same, and the surface ends there. */
static void step_of_surface(struct picture *p, int x, int y, size_t at)
{
    step_of_light(p, x, y, at);
    p->sum.depth[at] = x < 75 ? 500.0f : 540.0f;
}

/* The left half is opaque: the filter has no noise estimate for it. */
static void half_opaque(struct picture *p, int x, int y, size_t at)
{
    smooth_light(p, x, y, at);
    p->sum.translucent[at] = x < 75 ? 0.0f : 1.0f;
}

/* At a silhouette a pixel's light is that of the object times its coverage. */
static void ragged_cover(struct picture *p, int x, int y, size_t at)
{
    const float coverage = x % 5 == 0 ? 0.25f : x % 5 == 1 ? 0.75f : 1.0f;
    (void) y;

    p->sum.alpha[at] = p->sum.translucent[at] = coverage;
    p->sum.normal[2][at] = coverage;
    for (int c = 0; c < 3; c++) {
        p->sum.albedo[c][at] = 0.5f * coverage;
        p->truth[c][at] = 0.3f;
    }
}

static void noise_is_a_fifth_of_what_it_was(void **state)
{
    RELEASE_ONLY();
    static const int samples[] = { 4, 16, 64 };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(samples); i++) {
        struct picture p;
        double before, after;
        start(&p, 2, samples[i], smooth_light);
        before = error_of(&p, 0, WIDTH);
        pell_denoise_render(p.pool, &p.params);
        after = error_of(&p, 0, WIDTH);
        print_message("# %d samples: error %.4f, denoised %.4f, 1/%.1f\n", samples[i], before, after, before / after);
        assert_true(after < before / 5.0);
        finish(&p);
    }
}

static void the_total_light_stays(void **state)
{
    static scene_function *const scenes[] = { smooth_light, step_of_light, step_of_surface, half_opaque, ragged_cover };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(scenes); i++) {
        struct picture p;
        double before;
        start(&p, 2, 8, scenes[i]);
        before = total(&p);
        pell_denoise_render(p.pool, &p.params);
        assert_true(fabs(total(&p) / before - 1.0) < 2e-5);
        finish(&p);
    }
}

/* The two columns next to the edge: a blur over it would remove half of the step. */
static void edges_stay(void **state)
{
    static scene_function *const scenes[] = { step_of_light, step_of_surface };
    static const double bounds[] = { 0.15, 0.10 };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(scenes); i++) {
        struct picture p;
        double sides[2] = { 0.0, 0.0 };
        start(&p, 2, 32, scenes[i]);
        pell_denoise_render(p.pool, &p.params);
        for (int y = 0; y < HEIGHT; y++)
            for (int k = 0; k < 2; k++)
                sides[k] += (double) p.sum.color[1][y * p.params.stride + 74 + k] / HEIGHT;
        print_message("# next to the edge %.4f of 1, %.4f of 0.25\n", sides[0], sides[1]);
        assert_true(fabs(sides[0] - 1.0) < bounds[i] && fabs(sides[1] - 0.25) < bounds[i] * 0.25);
        finish(&p);
    }
}

/* Stripes a hundred times as bright as the noisy light below them. */
static void highlights_hide_no_noise(void **state)
{
    struct picture p, plain;
    (void) state;

    start(&plain, 2, 16, smooth_light);
    start_below(&p, 50.0f, 2, 16, smooth_light);
    pell_denoise_render(plain.pool, &plain.params);
    pell_denoise_render(p.pool, &p.params);
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++) {
                const ptrdiff_t at = y * p.params.stride + x;
                REQUIRE_NEAR(p.sum.color[c][at] - (at % 2 ? 50.0f : 0.0f), plain.sum.color[c][at], 1e-5);
            }
    finish(&p);
    finish(&plain);
}

static void pixels_covered_in_part_are_filtered_with_the_others(void **state)
{
    struct picture p;
    double before;
    (void) state;

    start(&p, 2, 16, ragged_cover);
    before = error_of(&p, 0, WIDTH);
    pell_denoise_render(p.pool, &p.params);
    print_message("# error %.4f, denoised %.4f\n", before, error_of(&p, 0, WIDTH));
    assert_true(error_of(&p, 0, WIDTH) < before / 5.0);
    finish(&p);
}

/* With one sample the variances are 0, so the filter has no weights. */
/* A pixel 40 times as bright as its surroundings (a firefly), whose single bright path leaves its variance unknown, becomes like its
 * neighbours; one whose brightness is certain is kept. No light is lost, also where a feature such as a texture distinguishes the
 * pixels. */
static void outliers_are_shared_with_the_pixels_around(void **state)
{
    (void) state;
    for (int resolved = 0; resolved < 2; resolved++) {
        double before = 0.0, after = 0.0, bright = 0.0, expected = 0.0;
        struct picture p;
        ptrdiff_t stride;
        start(&p, 2, 16, smooth_light);
        stride = p.params.stride;
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++) {
                const ptrdiff_t at = y * stride + x;
                for (int c = 0; c < 3; c++) {
                    p.sum.albedo[c][at] = (x + y) % 2 ? 0.2f : 0.8f; /* no similar neighbours */
                    if (x % 30 == 17 && y % 30 == 14) {
                        const float light = 40.0f * p.truth[c][at], change = light - p.sum.multiple[c][at];
                        expected += (double) p.truth[c][at];
                        p.sum.multiple[c][at] = light;
                        p.sum.color[c][at] += change;
                        p.sum.variance[c][at] = resolved ? 1e-4f * light * light : light * light;
                    }
                    before += (double) p.sum.color[c][at];
                }
            }
        pell_denoise_render(p.pool, &p.params);
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++)
                for (int c = 0; c < 3; c++) {
                    after += (double) p.sum.color[c][y * stride + x];
                    bright += x % 30 == 17 && y % 30 == 14 ? (double) p.sum.color[c][y * stride + x] : 0.0;
                }
        print_message("# outliers, %s: %.2f of what is around\n", resolved ? "resolved" : "unresolved", bright / expected);
        REQUIRE_REL(after, before, 1e-5);
        REQUIRE(resolved ? bright > 30.0 * expected : bright < 4.0 * expected);
        finish(&p);
    }
}

static void it_says_where_it_knows_of_no_noise(void **state)
{
    struct picture p;
    (void) state;

    start(&p, 1, 8, ragged_cover);
    assert_true(pell_denoise_has_variance(&p.params));
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < HEIGHT; y++)
            memset(p.sum.variance[c] + y * p.params.stride, 0, WIDTH * sizeof(float));
    assert_false(pell_denoise_has_variance(&p.params));
    finish(&p);
}

static void opaque_pixels_are_left_alone(void **state)
{
    struct picture p, same;
    (void) state;

    start(&p, 2, 8, half_opaque);
    start(&same, 1, 8, half_opaque);
    pell_denoise_render(p.pool, &p.params);
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < HEIGHT; y++)
            assert_memory_equal(p.sum.color[c] + y * p.params.stride, same.sum.color[c] + y * p.params.stride, 75 * sizeof(float));
    assert_true(error_of(&p, 80, WIDTH) < error_of(&same, 80, WIDTH) / 3.0);
    finish(&p);
    finish(&same);
}

static void threads_do_not_matter(void **state)
{
    struct picture p, other;
    (void) state;

    start(&p, 1, 8, smooth_light);
    start(&other, 3, 8, smooth_light);
    pell_denoise_render(p.pool, &p.params);
    pell_denoise_render(other.pool, &other.params);
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < HEIGHT; y++)
            assert_memory_equal(p.sum.color[c] + y * p.params.stride, other.sum.color[c] + y * p.params.stride, WIDTH * sizeof(float));
    finish(&p);
    finish(&other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(noise_is_a_fifth_of_what_it_was),
        cmocka_unit_test(the_total_light_stays),
        cmocka_unit_test(edges_stay),
        cmocka_unit_test(highlights_hide_no_noise),
        cmocka_unit_test(pixels_covered_in_part_are_filtered_with_the_others),
        cmocka_unit_test(outliers_are_shared_with_the_pixels_around),
        cmocka_unit_test(it_says_where_it_knows_of_no_noise),
        cmocka_unit_test(opaque_pixels_are_left_alone),
        cmocka_unit_test(threads_do_not_matter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
