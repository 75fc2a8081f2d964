/* SPDX-License-Identifier: MIT
 * test_color.c - the sRGB curve against IEC 61966-2-1 in double precision; texture look-up against its definition. */
#include "image_test.h"

static double decode_exact(double x)
{
    return x <= 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4);
}

static void curve_is_the_standards(void **state)
{
    (void) state;
    for (int i = 0; i <= 100000; i++) {
        const double x = i / 100000.0;
        REQUIRE_NEAR(pell_srgb_decode((float) x), decode_exact((double) (float) x), 3e-7);
        REQUIRE_NEAR(pell_srgb_encode(pell_srgb_decode((float) x)), x, 1e-6);
    }
    /* published values: sRGB 188 is 50.29 % light, 128 is 21.59 % */
    REQUIRE_NEAR(pell_srgb_decode(188 / 255.0f), 0.5029, 5e-5);
    REQUIRE_NEAR(pell_srgb_decode(128 / 255.0f), 0.2159, 5e-5);
}

static void curve_goes_on_outside_0_1(void **state)
{
    (void) state;
    REQUIRE_NEAR(pell_srgb_decode(-0.1f), -0.1 / 12.92, 1e-8);
    REQUIRE_NEAR(pell_srgb_encode(-0.1f), -0.1 * 12.92, 1e-6);
    REQUIRE_NEAR(pell_srgb_decode(1.0f), 1, 1e-7);
    REQUIRE_NEAR(pell_srgb_encode(1.0f), 1, 1e-7);
    for (float x = 1.0f; x < 4.0f; x += 0.125f) {
        REQUIRE(pell_srgb_decode(x + 0.125f) > pell_srgb_decode(x));
        REQUIRE_NEAR(pell_srgb_encode(pell_srgb_decode(x)), x, 1e-5);
    }
}

static void tables_are_the_curve(void **state)
{
    (void) state;
    for (int i = 0; i < 256; i++)
        REQUIRE_REL(pell_srgb_u8[i], decode_exact(i / 255.0), 6e-8);
    for (int i = 0; i < 65536; i++) {
        const double slope = i ? (decode_exact((i + 0.5) / 65535) - decode_exact((i - 0.5) / 65535)) : 1e-6;
        REQUIRE_NEAR(pell_srgb_decode_u16((uint16_t) i), decode_exact(i / 65535.0), 0.1 * slope + 1.2e-7 * decode_exact(i / 65535.0));
    }
}

/* --- Texels ------------------------------------------------------------------------------------------------------------------- */

static void texels_are_spread_by_layout(void **state)
{
    uint8_t u8[4] = { 188, 128, 64, 51 };
    uint16_t u16[4] = { 65535, 32768, 0, 13107 };
    float f[4] = { 0.25f, 2.0f, 3.0f, 0.5f }, out[4];
    struct pell_image image = { .width = 1, .height = 1, .type = PELL_PIXEL_U8, .srgb = true, .pixels = u8 };

    (void) state;
    image.channels = 1;
    pell_image_texel(&image, 0, 0, out);
    for (int c = 0; c < 3; c++)
        REQUIRE_NEAR(out[c], decode_exact(188 / 255.0), 1e-6);
    REQUIRE_NEAR(out[3], 1, 0);
    image.channels = 2; /* alpha is never encoded */
    pell_image_texel(&image, 0, 0, out);
    REQUIRE_NEAR(out[2], decode_exact(188 / 255.0), 1e-6);
    REQUIRE_NEAR(out[3], 128 / 255.0, 1e-6);
    image.channels = 4;
    pell_image_texel(&image, 0, 0, out);
    REQUIRE_NEAR(out[1], decode_exact(128 / 255.0), 1e-6);
    REQUIRE_NEAR(out[3], 0.2, 1e-6);
    image.srgb = false;
    pell_image_texel(&image, 0, 0, out);
    REQUIRE_NEAR(out[2], 64 / 255.0, 1e-6);
    image = (struct pell_image) { 1, 1, 4, PELL_PIXEL_U16, true, u16 };
    pell_image_texel(&image, 0, 0, out);
    REQUIRE_NEAR(out[0], 1, 1e-6);
    REQUIRE_NEAR(out[1], decode_exact(32768 / 65535.0), 1e-6);
    REQUIRE_NEAR(out[3], 0.2, 1e-6);
    image = (struct pell_image) { 1, 1, 3, PELL_PIXEL_F32, false, f };
    pell_image_texel(&image, 0, 0, out);
    REQUIRE_NEAR(out[2], 3, 0);
    REQUIRE_NEAR(out[3], 1, 0);
}

static int wrapped(enum pell_wrap wrap, long i, long n)
{
    if (wrap == PELL_WRAP_CLAMP)
        return (int) (i < 0 ? 0 : i >= n ? n - 1 : i);
    if (wrap == PELL_WRAP_REPEAT)
        return (int) (((i % n) + n) % n);
    i = ((i % (2 * n)) + 2 * n) % (2 * n);
    return (int) (i < n ? i : 2 * n - 1 - i);
}

/* The definition, in double precision. */
static double sample_exact(const struct pell_image *image, enum pell_wrap wu, enum pell_wrap wv, bool nearest, double u, double v, int c)
{
    const float *p = image->pixels;
    double x = u * image->width, y = v * image->height, sum = 0;

    if (nearest)
        return (
            double) p[(wrapped(wv, (long) floor(y), image->height) * image->width + wrapped(wu, (long) floor(x), image->width)) * 3 + c];
    x -= 0.5;
    y -= 0.5;
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            const double fx = x - floor(x), fy = y - floor(y);
            const int tx = wrapped(wu, (long) floor(x) + i, image->width), ty = wrapped(wv, (long) floor(y) + j, image->height);
            sum += (i ? fx : 1 - fx) * (j ? fy : 1 - fy) * (double) p[(ty * image->width + tx) * 3 + c];
        }
    return sum;
}

static void samples_follow_the_definition(void **state)
{
    float pixels[7 * 5 * 3], out[4];
    struct pell_image image = { 7, 5, 3, PELL_PIXEL_F32, false, pixels };
    uint32_t seed = 1;

    (void) state;
    for (int i = 0; i < 7 * 5 * 3; i++)
        pixels[i] = pattern(i, 3, 1);
    for (int i = 0; i < 20000; i++) {
        const enum pell_wrap wu = (enum pell_wrap)(i % 3), wv = (enum pell_wrap)(i / 3 % 3);
        float u, v;
        seed = seed * 1664525 + 1013904223;
        u = (float) (int) (seed >> 12) / 131072.0f - 4.0f;
        seed = seed * 1664525 + 1013904223;
        v = (float) (int) (seed >> 12) / 131072.0f - 4.0f;
        pell_image_sample(&image, wu, wv, false, u, v, out);
        for (int c = 0; c < 3; c++)
            REQUIRE_NEAR(out[c], sample_exact(&image, wu, wv, false, u, v, c), 2e-5);
        /* nearest filtering is discontinuous: stay away from the steps by the rounding of u * width */
        if (fabs(u * 7 - round(u * 7)) > 1e-3 && fabs(v * 5 - round(v * 5)) > 1e-3) {
            pell_image_sample(&image, wu, wv, true, u, v, out);
            for (int c = 0; c < 3; c++)
                REQUIRE_NEAR(out[c], sample_exact(&image, wu, wv, true, u, v, c), 1e-6);
        }
    }
}

static void texel_centres_give_the_texel(void **state)
{
    float pixels[4 * 4 * 3], a[4], b[4];
    struct pell_image image = { 4, 4, 3, PELL_PIXEL_F32, false, pixels };

    (void) state;
    for (int i = 0; i < 48; i++)
        pixels[i] = pattern(i, 1, 2);
    for (int y = 0; y < 4; y++)
        for (int x = 0; x < 4; x++) {
            pell_image_texel(&image, x, y, a);
            pell_image_sample(&image, PELL_WRAP_REPEAT, PELL_WRAP_REPEAT, false, ((float) x + 0.5f) / 4, ((float) y + 0.5f) / 4, b);
            for (int c = 0; c < 4; c++)
                REQUIRE_NEAR(a[c], b[c], 0);
        }
}

/* Texture look-up stays inside the image for any texture coordinates of a mesh: run under the address sanitizer. */
static void wild_coordinates_stay_inside(void **state)
{
    static const float wild[] = { 0,       -0.0f,       1,          -1,   1e9f,     -1e9f,       1e30f,
                                  -1e30f,  INFINITY,    -INFINITY,  NAN,  16777215, -16777215,   1e-30f,
                                  -1e-30f, 0.99999994f, 1.0000001f, 2.0f, -2.0f,    1e7f + 0.5f, -4.9999995f };
    uint8_t *pixels = malloc(3 * 2 * 4); /* on the heap, so that an access outside is detected */
    struct pell_image image = { 3, 2, 4, PELL_PIXEL_U8, true, pixels };
    float out[4];

    (void) state;
    REQUIRE(pixels);
    memset(pixels, 255, 24);
    for (size_t i = 0; i < PELL_COUNT(wild); i++)
        for (size_t j = 0; j < PELL_COUNT(wild); j++)
            for (int wrap = 0; wrap < 9; wrap++)
                for (int nearest = 0; nearest < 2; nearest++) {
                    pell_image_sample(&image, (enum pell_wrap)(wrap % 3), (enum pell_wrap)(wrap / 3), nearest, wild[i], wild[j], out);
                    for (int c = 0; c < 4; c++)
                        REQUIRE_NEAR(out[c], 1, 1e-5);
                }
    free(pixels);
}

/* A budget far above the measured time (12-25 ns), so that it fails only when look-up has become an entirely different operation. */
static void look_up_is_fast(void **state)
{
    uint8_t *pixels = malloc(1024 * 1024 * 4);
    struct pell_image image = { 1024, 1024, 4, PELL_PIXEL_U8, true, pixels };
    float out[4], sum = 0;
    double best = 1e9;

    (void) state;
    REQUIRE(pixels);
    memset(pixels, 100, 1024 * 1024 * 4);
    for (int round = 0; round < 5; round++) {
        const double start = pell_seconds();
        double ns;
        for (int i = 0; i < 200000; i++) {
            pell_image_sample(&image, PELL_WRAP_REPEAT, PELL_WRAP_REPEAT, false, (float) (i % 997) * 0.0013f, (float) i * 4e-6f, out);
            sum += out[0];
        }
        ns = (pell_seconds() - start) / 200000 * 1e9;
        best = ns < best ? ns : best;
    }
    print_message("# bilinear sRGB RGBA8: %.1f ns\n", best);
    REQUIRE(sum > 0);
    REQUIRE(best < 1000);
    free(pixels);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(curve_is_the_standards),        cmocka_unit_test(curve_goes_on_outside_0_1),
        cmocka_unit_test(tables_are_the_curve),          cmocka_unit_test(texels_are_spread_by_layout),
        cmocka_unit_test(samples_follow_the_definition), cmocka_unit_test(texel_centres_give_the_texel),
        cmocka_unit_test(wild_coordinates_stay_inside),  cmocka_unit_test(look_up_is_fast),
    };
    return cmocka_run_group_tests_name("image.color", tests, NULL, NULL);
}
