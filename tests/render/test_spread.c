/* SPDX-License-Identifier: MIT
 * test_spread.c - lateral spread of light transmitted through thin parts: against Gaussians, and pixels that must not change. */
#include "pell_test.h"

#include "base/pool.h"
#include "render/spread/stage.h"
#include "shared/spread.h"

#include <math.h>
#include <string.h>

enum { WIDTH = 160, HEIGHT = 120, STRIDE = WIDTH, SIZE = STRIDE * HEIGHT };

#define FLAT 0.25f /* mm: a pixel */

/* A facing plane whose thickness table spreads light by a variance of `variance` mm^2 at all thicknesses. */
struct sheet {
    struct pell_context *ctx;
    struct pell_pool *pool;
    struct pell_thickness_table table;
    const struct pell_thickness_table *tables[1];
    uint16_t key[SIZE], material[SIZE];
    float depth[SIZE], path[SIZE], light[3][SIZE], sum[3][SIZE], half[3][SIZE];
    uint8_t lit[2 * (STRIDE / PELL_SPREAD_BLOCK + 1) * HEIGHT];
    struct pell_spread_params p;
};

static struct sheet *sheet_of(double variance, int threads)
{
    struct sheet *s = calloc(1, sizeof(*s));

    REQUIRE(s != NULL);
    s->ctx = test_context(NULL, NULL);
    assert_int_equal(pell_pool_create(s->ctx, threads, &s->pool), PELL_OK);
    s->table.max_mm = 10.0f;
    s->tables[0] = &s->table;
    for (int i = 0; i < PELL_THICKNESS_STEPS; i++)
        for (int c = 0; c < 3; c++) {
            s->table.slab[i][c] = 0.1f;
            s->table.spread[i][c] = (float) variance * (float) (1 << 2 * c);
        }
    for (int i = 0; i < SIZE; i++) {
        s->key[i] = s->material[i] = 1;
        s->depth[i] = 100.0f;
        for (int c = 0; c < 3; c++)
            s->sum[c][i] = s->half[c][i] = NAN; /* pixels there have no effect */
    }
    memset(s->lit, 7, sizeof(s->lit));
    s->p = (struct pell_spread_params) { .rect = { 0, 0, WIDTH, HEIGHT },
                                         .stride = STRIDE,
                                         .key = s->key,
                                         .material = s->material,
                                         .thickness = s->tables,
                                         .depth = s->depth,
                                         .path = s->path,
                                         .fixed_mm = FLAT,
                                         .lit = { s->lit, s->lit + sizeof(s->lit) / 2 } };
    for (int c = 0; c < 3; c++) {
        s->p.transmitted[c] = s->light[c];
        s->p.sum[c] = s->sum[c];
        s->p.half[c] = s->half[c];
    }
    return s;
}

static void sheet_free(struct sheet *s)
{
    pell_pool_destroy(&s->pool);
    pell_context_destroy(&s->ctx);
    free(s);
}

static void shine(struct sheet *s, int at, float light)
{
    s->path[at] = light > 0.0f ? pell_spread_pack(2.0f, 1.0f) : 0.0f;
    for (int c = 0; c < 3; c++)
        s->light[c][at] = light;
}

static double total(const struct sheet *s, int channel)
{
    double sum = 0.0;

    for (int i = 0; i < SIZE; i++)
        sum += (double) s->light[channel][i];
    return sum;
}

/* Each variance is represented by two Gaussians, a factor of four apart: their mixture differs from the erf by 4 % of the step between
 * them. */
static void a_half_lit_sheet_is_the_error_function(void **state)
{
    static const double variances[] = { 0.03, 0.3, 1.0, 2.0 };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(variances); k++) {
        struct sheet *s = sheet_of(variances[k], 2);
        for (int i = 0; i < SIZE; i++)
            shine(s, i, i % STRIDE >= WIDTH / 2 ? 8.0f : 0.0f);
        REQUIRE(pell_spread_render(s->pool, &s->p) > 0);
        for (int c = 0; c < 3; c++)
            for (int x = 0; x < WIDTH; x++) {
                const double mm = (x + 0.5 - WIDTH / 2) * (double) FLAT, sigma = sqrt(variances[k] * (1 << 2 * c));
                REQUIRE_NEAR(s->light[c][60 * STRIDE + x], 4.0 + 4.0 * erf(mm / (sigma * sqrt(2.0))), 8.0 * 0.04);
            }
        sheet_free(s);
    }
}

static void a_spot_has_its_light_and_variance(void **state)
{
    static const double variances[] = { 0.02, 0.05, 0.1, 0.2 };
    const int at = 60 * STRIDE + 80;
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(variances); k++) {
        struct sheet *s = sheet_of(variances[k], 2);
        shine(s, at, 100.0f);
        REQUIRE(pell_spread_render(s->pool, &s->p) > 0);
        for (int c = 0; c < 3; c++) {
            const double variance = variances[k] * (1 << 2 * c);
            double moment[2] = { 0.0 };
            for (int i = 0; i < SIZE; i++) {
                moment[0] += (double) s->light[c][i] * pow((i % STRIDE - 80) * (double) FLAT, 2.0);
                moment[1] += (double) s->light[c][i] * pow((i / STRIDE - 60) * (double) FLAT, 2.0);
            }
            REQUIRE_REL(total(s, c), 100.0, 1e-4);
            for (int axis = 0; axis < 2; axis++)
                REQUIRE_REL(moment[axis] / 100.0, variance, 0.02);
        }
        sheet_free(s);
    }
}

/* Scattered light with an unscattered component in randomly chosen pixels: the former stays, the latter is spread. */
static void what_did_not_go_straight_stays(void **state)
{
    struct sheet *s = sheet_of(1.0, 2), *alone = sheet_of(1.0, 2);
    (void) state;

    for (int i = 0; i < SIZE; i++) {
        const float straight = i % 7 == 0 ? 3.0f : 0.0f, share = straight / (straight + 5.0f);
        shine(alone, i, straight);
        shine(s, i, straight + 5.0f);
        s->path[i] = pell_spread_pack(2.0f, share);
    }
    REQUIRE(pell_spread_render(s->pool, &s->p) > 0 && pell_spread_render(alone->pool, &alone->p) > 0);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++)
            for (int c = 0; c < 3; c++) {
                const int i = y * STRIDE + x;
                REQUIRE_NEAR((double) s->light[c][i], (double) alone->light[c][i] + 5.0, 0.01);
            }
    sheet_free(s);
    sheet_free(alone);
}

/* Uniform light is unchanged, including at the borders of an image; and so is light without a known path, such as that from all sides. */
static void even_light_and_light_of_no_way_stay(void **state)
{
    struct sheet *s = sheet_of(0.5, 2);
    (void) state;

    for (int i = 0; i < SIZE; i++)
        shine(s, i, 3.0f);
    pell_spread_render(s->pool, &s->p);
    for (int i = 0; i < SIZE; i++)
        REQUIRE_NEAR(s->light[1][i], 3.0f, 1e-4);
    for (int i = 0; i < SIZE; i++) {
        shine(s, i, (float) (i % 7));
        s->path[i] = 0.0f;
    }
    REQUIRE(pell_spread_render(s->pool, &s->p) == 0);
    for (int i = 0; i < SIZE; i++)
        REQUIRE(s->light[1][i] == (float) (i % 7));
    sheet_free(s);
}

static void objects_and_steps_in_depth_keep_light_apart(void **state)
{
    (void) state;

    for (int by_depth = 0; by_depth < 2; by_depth++) {
        struct sheet *s = sheet_of(0.5, 2);
        for (int i = 0; i < SIZE; i++) {
            const bool far = i % STRIDE >= WIDTH / 2;
            s->key[i] = by_depth || !far ? 1 : 2;
            s->depth[i] = by_depth && far ? 140.0f : 100.0f;
            shine(s, i, far ? 0.0f : 5.0f);
        }
        pell_spread_render(s->pool, &s->p);
        for (int i = 0; i < SIZE; i++)
            REQUIRE_NEAR(s->light[1][i], i % STRIDE >= WIDTH / 2 ? 0.0f : 5.0f, 1e-4);
        sheet_free(s);
    }
}

static void threads_give_the_same_bits(void **state)
{
    struct sheet *one = sheet_of(0.3, 1), *three = sheet_of(0.3, 3);
    (void) state;

    for (int i = 0; i < SIZE; i++) {
        const float light = i * 7919 % 101 < 9 ? (float) (i % 13) : 0.0f;
        shine(one, i, light);
        shine(three, i, light);
        one->depth[i] = three->depth[i] = 100.0f + 0.01f * (float) (i % STRIDE);
    }
    pell_spread_render(one->pool, &one->p);
    pell_spread_render(three->pool, &three->p);
    assert_memory_equal(one->light, three->light, sizeof(one->light));
    sheet_free(one);
    sheet_free(three);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_half_lit_sheet_is_the_error_function),
        cmocka_unit_test(a_spot_has_its_light_and_variance),
        cmocka_unit_test(what_did_not_go_straight_stays),
        cmocka_unit_test(even_light_and_light_of_no_way_stay),
        cmocka_unit_test(objects_and_steps_in_depth_keep_light_apart),
        cmocka_unit_test(threads_give_the_same_bits),
    };

    return cmocka_run_group_tests_name("render.spread", tests, NULL, NULL);
}
