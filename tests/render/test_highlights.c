/* SPDX-License-Identifier: MIT
 * test_highlights.c - light visibility shared between neighbouring pixels for highlights: results that are required, and pixels that
 * must not change. */
#include "pell_test.h"

#include "base/pool.h"
#include "math/sampling.h"
#include "render/highlights/stage.h"

#include <math.h>
#include <string.h>

enum { WIDTH = 150, HEIGHT = 60, STRIDE = 160, SIZE = STRIDE * HEIGHT, SUMS = PELL_HIGHLIGHTS_SUMS };

/* A facing plane. */
struct wall {
    struct pell_context *ctx;
    struct pell_pool *pool;
    uint16_t material[SIZE];
    float depth[SIZE], normal[3][SIZE], hidden[SUMS][SIZE], light[SUMS][SIZE], room[SUMS][SIZE]; /* mirrored, entering */
    uint8_t lit[(STRIDE / PELL_HIGHLIGHTS_BLOCK + 1) * HEIGHT];
    struct pell_highlights_params p;
};

/* `unhidden` W/(m^2 sr), all of which is visible to a pixel with a given probability, and none otherwise. */
static struct wall *wall_of(int threads, float unhidden, double probability)
{
    struct wall *w = calloc(1, sizeof(*w));
    uint32_t random = 1;

    REQUIRE(w != NULL);
    w->ctx = test_context(NULL, NULL);
    assert_int_equal(pell_pool_create(w->ctx, threads, &w->pool), PELL_OK);
    memset(w->lit, 7, sizeof(w->lit));
    w->p = (struct pell_highlights_params) { .rect = { 0, 0, WIDTH, HEIGHT },
                                             .stride = STRIDE,
                                             .material = w->material,
                                             .depth = w->depth,
                                             .fixed_mm = 0.25f,
                                             .rays = 1,
                                             .has_hidden = w->lit };
    for (int i = 0; i < SIZE; i++) {
        bool seen;
        random = pell_hash(random + (uint32_t) i);
        seen = (double) random / 4294967296.0 < probability;
        w->material[i] = 1;
        w->depth[i] = 100.0f;
        w->normal[2][i] = 1.0f;
        for (int c = 0; c < SUMS; c++) {
            w->light[c][i] = seen ? unhidden * (float) (c + 1) : 0.0f;
            w->hidden[c][i] = seen ? 0.0f : unhidden * (float) (c + 1);
            w->room[c][i] = NAN; /* pixels there have no effect */
        }
    }
    for (int c = 0; c < SUMS; c++) {
        w->p.normal[c % 3] = w->normal[c % 3];
        w->p.hidden[c] = w->hidden[c];
        w->p.light[c] = w->light[c];
        w->p.scratch[c] = w->room[c];
    }
    return w;
}

static void wall_free(struct wall *w)
{
    pell_pool_destroy(&w->pool);
    pell_context_destroy(&w->ctx);
    free(w);
}

/* At least `margin` pixels from the border. */
static void moments(const struct wall *w, int channel, int margin, double *mean, double *variance)
{
    double sum = 0.0, squares = 0.0, n = 0.0;

    for (int y = margin; y < HEIGHT - margin; y++)
        for (int x = margin; x < WIDTH - margin; x++) {
            const double v = (double) w->light[channel][y * STRIDE + x];
            sum += v;
            squares += v * v;
            n++;
        }
    *mean = sum / n;
    *variance = squares / n - *mean * *mean;
}

/* In uniform light the stage is an average: its weights fall linearly, so the remaining variance is the square of (1 + 4 + 9 + 16 + 9 +
 * 4 + 1)/256 for seven pixels in each direction, and more where the nine next to a pixel happen to differ: for noise independent between
 * pixels, which is not as well distributed as that of rays. */
static void noise_falls_and_the_mean_stays(void **state)
{
    (void) state;
    for (int k = 0; k < 2; k++) {
        const double probability = k ? 0.7 : 0.06;
        struct wall *w = wall_of(1, 2.0f, probability);
        double before[2], after[2];
        for (int c = 0; c < SUMS; c++) {
            moments(w, c, 8, &before[0], &before[1]);
            REQUIRE_NEAR(before[0], probability * 2.0 * (c + 1), 0.1 * (c + 1));
        }
        moments(w, 0, 8, &before[0], &before[1]);
        REQUIRE(pell_highlights_render(w->pool, &w->p) == WIDTH * HEIGHT);
        moments(w, 0, 8, &after[0], &after[1]);
        REQUIRE_NEAR(after[0], before[0], 0.02);
        REQUIRE(after[1] / before[1] > 44.0 / 256.0 * 44.0 / 256.0 - 0.008 && after[1] / before[1] < 0.06);
        wall_free(w);
    }
}

/* A narrow highlight keeps its shape: pixels share the visible fraction, not radiance. */
static void highlights_stay_sharp(void **state)
{
    struct wall *w = wall_of(1, 1.0f, 0.5);
    double sum[3] = { 0 };

    (void) state;
    for (int i = 0; i < SIZE; i++) {
        const double x = i % STRIDE - 75.0, peak = 100.0 * exp(-0.5 * x * x) + 1e-3; /* a pixel wide */
        const bool visible = w->hidden[0][i] == 0.0f;
        for (int c = 0; c < SUMS; c++) {
            w->light[c][i] = visible ? (float) peak : 0.0f;
            w->hidden[c][i] = visible ? 0.0f : (float) peak;
        }
    }
    pell_highlights_render(w->pool, &w->p);
    for (int y = 8; y < HEIGHT - 8; y++)
        for (int k = 0; k < 3; k++)
            sum[k] += (double) w->light[1][y * STRIDE + 75 + 2 * k - (k == 2)];
    REQUIRE_NEAR(sum[0], 50.0 * (HEIGHT - 16), 5.0 * (HEIGHT - 16));
    REQUIRE_NEAR(sum[1] / sum[0], exp(-2.0), 0.12 * exp(-2.0));
    REQUIRE_NEAR(sum[2] / sum[0], exp(-4.5), 0.1 * exp(-4.5));
    wall_free(w);
}

/* A shadow's edge between two pixels is not noise: three pixels away all is unchanged, and next to the edge nearly so. */
static void sharp_shadows_stay(void **state)
{
    struct wall *w = wall_of(1, 1.0f, 0.5);
    (void) state;

    w->p.rays = 4;
    for (int i = 0; i < SIZE; i++)
        for (int c = 0; c < SUMS; c++) {
            w->light[c][i] = i % STRIDE < 75 ? 1.0f : 0.0f;
            w->hidden[c][i] = 1.0f - w->light[c][i];
        }
    pell_highlights_render(w->pool, &w->p);
    for (int y = 8; y < HEIGHT - 8; y++)
        for (int c = 0; c < SUMS; c++) {
            const float *row = w->light[c] + y * STRIDE;
            REQUIRE(row[70] == 1.0f && row[79] == 0.0f);
            REQUIRE(row[73] > 0.95f && row[76] < 0.05f); /* the mean of the surroundings is 0.81 and 0.19 */
            REQUIRE(row[74] > row[75] + 0.2f);
        }
    wall_free(w);
}

/* Half of the image is lit, the other dark, with an edge of some kind between them. */
static void edges_keep_light_apart(void **state)
{
    (void) state;
    for (int kind = 0; kind < 4; kind++) {
        struct wall *w = wall_of(1, 1.0f, 0.5);
        bool same = true;
        for (int i = 0; i < SIZE; i++) {
            const bool left = i % STRIDE < 75;
            if (left) {
                w->material[i] = kind == 0 ? 2 : 1;
                w->depth[i] = kind == 1 ? 110.0f : 100.0f;
                w->normal[2][i] = kind == 2 ? 0.8f : 1.0f;
                w->normal[0][i] = kind == 2 ? 0.6f : 0.0f;
            }
            for (int c = 0; c < SUMS; c++) {
                w->light[c][i] = left ? 3.0f : 0.0f;
                w->hidden[c][i] = left ? (kind == 3 && c == 0 ? -1.0f : 0.0f) : 1.0f; /* 3: the left emits */
            }
        }
        pell_highlights_render(w->pool, &w->p);
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++)
                for (int c = 0; c < SUMS; c++)
                    same &= w->light[c][y * STRIDE + x] == (x < 75 ? 3.0f : 0.0f);
        REQUIRE(same);
        wall_free(w);
    }
}

static void what_nothing_hides_keeps_its_bits(void **state)
{
    struct wall *w = wall_of(1, 1.0f, 1.1);
    float before[SIZE];

    (void) state;
    for (int i = 0; i < SIZE; i++)
        w->light[1][i] = (float) (i % 97) / 7.0f;
    memcpy(before, w->light[1], sizeof(before));
    assert_int_equal(pell_highlights_render(w->pool, &w->p), 0);
    for (int c = 0; c < SUMS; c++)
        w->hidden[c][30 * STRIDE + 20] = 1.0f; /* one pixel: its block and the next are read, in seven rows */
    assert_int_equal(pell_highlights_render(w->pool, &w->p), 2 * 7 * PELL_HIGHLIGHTS_BLOCK);
    for (int i = 0; i < SIZE; i++)
        if (abs(i % STRIDE - 20) > 3 || abs(i / STRIDE - 30) > 3)
            REQUIRE(w->light[1][i] == before[i]);
    w->p.rect.x1 = 0;
    assert_int_equal(pell_highlights_render(w->pool, &w->p), 0);
    wall_free(w);
}

/* Next to pixels without a surface, whose planes may hold anything. */
static void what_shows_nothing_has_no_effect(void **state)
{
    static const float anything[] = { NAN, INFINITY, -INFINITY, -1e30f };
    struct wall *w = wall_of(1, 1.0f, 0.5), *clean = wall_of(1, 1.0f, 0.5);

    (void) state;
    for (int i = 0; i < SIZE; i++) {
        if (i % STRIDE < 75 && i / STRIDE < 30)
            continue;
        w->material[i] = clean->material[i] = 0;
        for (int c = 0; c < SUMS; c++) {
            w->light[c][i] = w->hidden[c][i] = w->normal[c % 3][i] = anything[i % 4];
            clean->light[c][i] = clean->hidden[c][i] = 0.0f;
        }
        w->depth[i] = anything[i / 4 % 4];
    }
    pell_highlights_render(w->pool, &w->p);
    pell_highlights_render(clean->pool, &clean->p);
    for (int i = 0; i < SIZE; i++)
        for (int c = 0; c < SUMS && w->material[i]; c++)
            REQUIRE(w->light[c][i] == clean->light[c][i]);
    wall_free(w);
    wall_free(clean);
}

static void any_number_of_threads_gives_the_same_bits(void **state)
{
    struct wall *a = wall_of(1, 1.0f, 0.3), *b = wall_of(4, 1.0f, 0.3);

    (void) state;
    pell_highlights_render(a->pool, &a->p);
    pell_highlights_render(b->pool, &b->p);
    assert_memory_equal(a->light, b->light, sizeof(a->light));
    wall_free(a);
    wall_free(b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(noise_falls_and_the_mean_stays),
        cmocka_unit_test(highlights_stay_sharp),
        cmocka_unit_test(sharp_shadows_stay),
        cmocka_unit_test(edges_keep_light_apart),
        cmocka_unit_test(what_nothing_hides_keeps_its_bits),
        cmocka_unit_test(what_shows_nothing_has_no_effect),
        cmocka_unit_test(any_number_of_threads_gives_the_same_bits),
    };

    return cmocka_run_group_tests_name("render.highlights", tests, NULL, NULL);
}
