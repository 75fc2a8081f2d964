/* SPDX-License-Identifier: MIT
 * test_colormap.c - colour maps of error images against the tables published by their authors. */
#include "compare_test.h"

struct color {
    double at, rgb[3];
};

/* Entries of matplotlib's magma (256 colours), none of which is a knot of our interpolation. */
static void magma_is_that_of_its_authors(void **state)
{
    static const struct color known[] = {
        { 8, { 0.013708, 0.011771, 0.068667 } },   { 22, { 0.065330, 0.047318, 0.184892 } },  { 52, { 0.238826, 0.059517, 0.443256 } },
        { 100, { 0.537755, 0.156894, 0.506551 } }, { 158, { 0.894700, 0.309773, 0.393995 } }, { 172, { 0.950210, 0.390820, 0.362468 } },
        { 248, { 0.989434, 0.941470, 0.697519 } }, { 0, { 0.001462, 0.000466, 0.013866 } },   { 255, { 0.987053, 0.991438, 0.749504 } },
    };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(known); i++) {
        float rgb[3];
        pell_color_magma((float) (known[i].at / 255.0), rgb);
        for (int c = 0; c < 3; c++)
            REQUIRE_NEAR(rgb[c], known[i].rgb[c], 1.5 / 255.0);
    }
}

/* The 8-bit table printed in Moreland 2009. */
static void diverging_is_that_of_its_author(void **state)
{
    static const struct color known[] = {
        { -1.0, { 59, 76, 192 } },    { -0.75, { 98, 130, 234 } }, { -0.5, { 141, 176, 254 } },
        { -0.25, { 184, 208, 249 } }, { 0.0, { 221, 221, 221 } },  { 0.25, { 245, 196, 173 } },
        { 0.5, { 244, 154, 123 } },   { 0.75, { 222, 96, 77 } },   { 1.0, { 180, 4, 38 } },
    };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(known); i++) {
        float rgb[3];
        pell_color_diverging((float) known[i].at, rgb);
        for (int c = 0; c < 3; c++)
            REQUIRE_NEAR(255.0 * (double) rgb[c], known[i].rgb[c], 1.5);
    }
}

static void ends_hold_for_all_that_lies_beyond(void **state)
{
    static void (*const maps[])(float, float *) = { pell_color_magma, pell_color_diverging };
    (void) state;
    for (int m = 0; m < 2; m++)
        for (int i = 0; i < 2; i++) {
            float end[3], far[3], nan[3], zero[3];
            maps[m](i ? 1.0f : m ? -1.0f : 0.0f, end);
            maps[m](i ? INFINITY : -INFINITY, far);
            maps[m](NAN, nan);
            maps[m](0.0f, zero);
            assert_memory_equal(end, far, sizeof(end));
            assert_memory_equal(nan, zero, sizeof(nan));
        }
}

/* A larger error has a higher luminance, for every step. */
static void magma_brightens(void **state)
{
    double last = -1.0;
    (void) state;
    for (int i = 0; i <= 1000; i++) {
        float rgb[3];
        double l;
        pell_color_magma((float) i / 1000.0f, rgb);
        l = 0.2126 * (double) rgb[0] + 0.7152 * (double) rgb[1] + 0.0722 * (double) rgb[2];
        REQUIRE(l > last);
        last = l;
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(magma_is_that_of_its_authors),
        cmocka_unit_test(diverging_is_that_of_its_author),
        cmocka_unit_test(ends_hold_for_all_that_lies_beyond),
        cmocka_unit_test(magma_brightens),
    };
    return cmocka_run_group_tests_name("compare.colormap", tests, NULL, NULL);
}
