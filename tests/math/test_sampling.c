/* SPDX-License-Identifier: MIT
 * test_sampling.c - the curve of pixels that distributes one low-discrepancy sequence over neighbouring pixels. */
#include "pell_test.h"

#include "math/sampling.h"

enum { SIDE = 1 << PELL_CURVE_LEVELS };

static void every_place_of_a_block_is_taken_once(void **state)
{
    (void) state;
    for (uint32_t seed = 0; seed < 20; seed++) {
        bool taken[SIDE * SIDE] = { false };
        for (uint32_t y = 0; y < SIDE; y++)
            for (uint32_t x = 0; x < SIDE; x++) {
                const uint32_t index = pell_pixel_curve(x + SIDE * seed, y, seed);
                REQUIRE(index < SIDE * SIDE && !taken[index]);
                taken[index] = true;
            }
    }
}

/* Aligned blocks of 2^k x 2^k pixels have consecutive indices, so that 4 samples per pixel form a (0, 2)-net of 4^(k+1) points: one in
 * each elementary interval of that area. */
static void squares_of_pixels_share_out_the_unit_square(void **state)
{
    (void) state;
    for (uint32_t level = 0; level <= 3; level++)
        for (uint32_t square = 0; square < 16; square++) {
            const uint32_t side = 1u << level, bits = 2 * (level + 1);
            for (uint32_t tall = 0; tall <= bits; tall++) {
                uint8_t count[256] = { 0 };
                for (uint32_t i = 0; i < side * side * 4; i++) {
                    const uint32_t pixel = i / 4, x = (square % 4) * side + pixel % side, y = square / 4 * side + pixel / side;
                    const uint32_t n = pell_pixel_curve(x, y, 7) << 2 | (i & 3);
                    const uint32_t u = pell_sobol0(n), v = pell_sobol1(n);
                    const uint32_t column = tall < bits ? u >> (32 - (bits - tall)) : 0, row = tall > 0 ? v >> (32 - tall) : 0;
                    count[column << tall | row]++;
                }
                for (uint32_t i = 0; i < 1u << bits; i++)
                    assert_int_equal(count[i], 1);
            }
        }
}

/* The order of each digit is randomised: over many seeds the first digit of a pixel takes each value equally often, independently of its
 * neighbour's. */
static void orders_are_drawn(void **state)
{
    int pairs[4][4] = { { 0 } };

    (void) state;
    for (uint32_t seed = 0; seed < 24000; seed++)
        pairs[pell_pixel_curve(0, 0, seed) & 3][pell_pixel_curve(1, 0, seed) & 3]++;
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++)
            REQUIRE(i == k ? pairs[i][k] == 0 : fabs(pairs[i][k] - 2000.0) < 250.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_place_of_a_block_is_taken_once),
        cmocka_unit_test(squares_of_pixels_share_out_the_unit_square),
        cmocka_unit_test(orders_are_drawn),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
