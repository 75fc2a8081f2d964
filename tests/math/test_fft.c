/* SPDX-License-Identifier: MIT
 * test_fft.c - the transforms of 16 neighbouring columns against sums in double precision, and their invariants. */
#include "pell_test.h"

#include "base/simd.h"
#include "math/fft.h"

#define PI 3.14159265358979323846
#define E PELL_FFT_ELEMENT

static float *floats(size_t n)
{
    float *p = aligned_alloc(64, (n * sizeof(float) + 63) / 64 * 64 + 64);

    assert_non_null(p);
    memset(p, 0, n * sizeof(float));
    return p;
}

static float noise(unsigned i)
{
    unsigned h = i * 374761393u + 12345u;

    h = (h ^ (h >> 13)) * 1274126177u;
    return (float) ((h ^ (h >> 16)) & 0xffffff) / 8388608.0f - 1.0f;
}

/* A transform of white noise; the result is a copy. */
static float *transform(int n, bool inverse, const float *in)
{
    float *a = floats((size_t) n * E), *b = floats((size_t) n * E), *table = floats(pell_fft_table(n)), *out;
    struct pell_fft plan;

    pell_fft_init(&plan, n, table);
    memcpy(a, in, (size_t) n * E * sizeof(float));
    out = pell_fft_run(&plan, inverse, a, b);
    assert_true(out == a || out == b);
    free(table);
    free(out == a ? b : a);
    return out;
}

static float *fill(int n)
{
    float *p = floats((size_t) n * E);

    for (int i = 0; i < n * E; i++)
        p[i] = noise((unsigned) i);
    return p;
}

/* Largest difference from the direct sum, divided by the root of the power, in lane `lane`; forward and inverse. */
static double distance_to_sum(int n, int lane, int step)
{
    float *in = fill(n);
    double worst = 0.0;

    for (int inverse = 0; inverse < 2; inverse++) {
        float *out = transform(n, inverse, in);
        for (int k = 0; k < n; k += step) {
            double re = 0.0, im = 0.0;
            for (int j = 0; j < n; j++) {
                const double angle = (inverse ? 2.0 : -2.0) * PI * (double) ((long long) j * k % n) / n, c = cos(angle), s = sin(angle);
                const double x = (double) in[E * j + lane], y = (double) in[E * j + 16 + lane];
                re += x * c - y * s;
                im += x * s + y * c;
            }
            worst = fmax(worst, hypot(re - (double) out[E * k + lane], im - (double) out[E * k + 16 + lane]));
        }
        free(out);
    }
    free(in);
    return worst / sqrt(n);
}

static void lengths_up_to_64_are_the_sum(void **state)
{
    double worst = 0.0;

    (void) state;
    for (int n = 1; n <= 64; n++)
        for (int lane = 0; lane < 16; lane += 5)
            worst = fmax(worst, distance_to_sum(n, lane, 1));
    print_message("# up to 64: %.2e of the root of the power\n", worst);
    REQUIRE(worst < 2e-6);
}

static void long_ones_are_the_sum(void **state)
{
    static const int lengths[] = { 72, 96, 100, 120, 125, 128, 135, 243, 256, 360, 1001, 1152, 1155, 1280, 2025, 2048, 4096, 30000 };
    double worst = 0.0;

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(lengths); i++)
        worst = fmax(worst, distance_to_sum(lengths[i], (int) i % 16, 1 + lengths[i] * (lengths[i] / 500) / 2000));
    print_message("# up to 30000: %.2e\n", worst);
    REQUIRE(worst < 4e-6);
}

static void there_and_back_is_n_times_as_much(void **state)
{
    static const int lengths[] = { 1, 2, 3, 5, 7, 8, 16, 60, 64, 77, 480, 1024, 1200, 65536 };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(lengths); i++) {
        const int n = lengths[i];
        float *in = fill(n), *there = transform(n, false, in), *back = transform(n, true, there);
        double worst = 0.0;
        for (int k = 0; k < n * E; k++)
            worst = fmax(worst, fabs((double) back[k] / n - (double) in[k]));
        REQUIRE(worst < 2e-6);
        free(in);
        free(there);
        free(back);
    }
}

static void power_is_kept(void **state)
{
    static const int lengths[] = { 6, 32, 45, 49, 900, 1152, 2000 };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(lengths); i++) {
        const int n = lengths[i];
        float *in = fill(n), *out = transform(n, false, in);
        for (int lane = 0; lane < 16; lane++) {
            double a = 0.0, b = 0.0;
            for (int k = 0; k < n; k++) {
                a +=
                    (double) in[E * k + lane] * (double) in[E * k + lane] + (double) in[E * k + 16 + lane] * (double) in[E * k + 16 + lane];
                b += (double) out[E * k + lane] * (double) out[E * k + lane] +
                     (double) out[E * k + 16 + lane] * (double) out[E * k + 16 + lane];
            }
            REQUIRE_REL(b, a * n, 1e-5);
        }
        free(in);
        free(out);
    }
}

static void sums_transform_to_sums_and_lanes_never_meet(void **state)
{
    const int n = 360;
    float *a = fill(n), *b = floats((size_t) n * E), *c = floats((size_t) n * E), *A, *B, *C;

    (void) state;
    for (int i = 0; i < n * E; i++) {
        b[i] = i % 16 == 3 ? 1e6f * noise((unsigned) i + 99) : 0.0f; /* one much brighter lane */
        c[i] = 2.0f * a[i] - 0.5f * b[i];
    }
    A = transform(n, false, a);
    B = transform(n, false, b);
    C = transform(n, false, c);
    for (int i = 0; i < n * E; i++) {
        if (i % 16 == 3)
            REQUIRE(fabs((double) C[i] - (2.0 * (double) A[i] - 0.5 * (double) B[i])) < 20.0);
        else
            assert_true(C[i] == 2.0f * A[i] && B[i] == 0.0f);
    }
    free(a);
    free(b);
    free(c);
    free(A);
    free(B);
    free(C);
}

/* 16 columns of all rows, from y on. */
static struct pell_fft_rows rows_from(struct pell_fft_rows all, int y)
{
    for (int i = 0; i < 2 && all.image[i]; i++) {
        all.image[i] += y * all.stride;
        all.half[i] += E * y;
    }
    all.rows = all.rows - y < 16 ? all.rows - y : 16;
    return all;
}

/* Rows of images of odd size, in part, and with one image alone. */
static void images_are_the_sum_and_come_back(void **state)
{
    static const struct {
        int n, width, height;
    } cases[] = { { 1, 1, 1 },    { 2, 1, 3 },    { 7, 7, 5 },   { 12, 7, 16 }, { 15, 15, 17 },
                  { 32, 17, 20 }, { 40, 40, 33 }, { 64, 31, 9 }, { 90, 60, 16 } };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(cases); i++)
        for (int alone = 0; alone < 2; alone++) {
            const int n = cases[i].n, width = cases[i].width, height = cases[i].height, blocks = n / 32 + 1;
            const ptrdiff_t stride = (width + 15) / 16 * 16 + 16, block = (ptrdiff_t) E * height;
            float *image[2], *back[2], *half[2], *buffer[2], *table = floats(pell_fft_table(n));
            struct pell_fft_rows all;
            struct pell_fft plan;
            double worst = 0.0, far = 0.0;
            pell_fft_init(&plan, n, table);
            for (int k = 0; k < 2; k++) {
                image[k] = floats((size_t) (stride * height));
                back[k] = floats((size_t) (stride * height));
                half[k] = floats((size_t) (blocks * block));
                buffer[k] = floats(pell_fft_buffer(n));
                for (ptrdiff_t at = 0; at < stride * height; at++)
                    image[k][at] = noise((unsigned) (at + 1000 * k)); /* including beyond the width */
                for (int at = 0; at < blocks * block; at++)
                    half[k][at] = NAN;
            }
            all = (struct pell_fft_rows) { { image[0], alone ? NULL : image[1] }, { half[0], half[1] }, stride, block, width, height };
            for (int y = 0; y < height; y += 16) {
                const struct pell_fft_rows rows = rows_from(all, y);
                pell_fft_rows(&plan, &rows, buffer);
            }
            for (int k = 0; k < 2 - alone; k++)
                for (int y = 0; y < height; y++)
                    for (int f = 0; f < 16 * blocks; f++) {
                        const float *at = half[k] + f / 16 * block + E * y + f % 16;
                        double re = 0.0, im = 0.0;
                        for (int x = 0; x < width && f <= n / 2; x++) {
                            re += (double) image[k][y * stride + x] * cos(2.0 * PI * f * x / n);
                            im -= (double) image[k][y * stride + x] * sin(2.0 * PI * f * x / n);
                        }
                        worst = fmax(worst, hypot(re - (double) at[0], im - (double) at[16]));
                    }
            all.image[0] = back[0];
            all.image[1] = alone ? NULL : back[1];
            for (int y = 0; y < height; y += 16) {
                const struct pell_fft_rows rows = rows_from(all, y);
                pell_fft_rows_back(&plan, &rows, buffer);
            }
            for (int k = 0; k < 2 - alone; k++)
                for (int y = 0; y < height; y++)
                    for (int x = 0; x < width; x++)
                        far = fmax(far, fabs((double) back[k][y * stride + x] / n - (double) image[k][y * stride + x]));
            if (!(worst < 1e-5 && far < 1e-6))
                fail_msg("n %d, %d x %d: %g from the sum, %g there and back", n, width, height, worst, far);
            for (int k = 0; k < 2; k++) {
                free(image[k]);
                free(back[k]);
                free(half[k]);
                free(buffer[k]);
            }
            free(table);
        }
}

static void tiles_turn(void **state)
{
    static const int strides[][2] = { { 16, 16 }, { 32, 48 } };

    (void) state;
    for (int i = 0; i < 2; i++) {
        float *a = floats(16 * 48), *b = floats(16 * 48), table[16];
        struct pell_fft plan;
        pell_fft_init(&plan, 1, table);
        for (int k = 0; k < 16 * 48; k++)
            a[k] = (float) k;
        pell_fft_transpose(&plan, a, strides[i][0], b, strides[i][1]);
        for (int y = 0; y < 16; y++)
            for (int x = 0; x < 16; x++)
                assert_true(b[x * strides[i][1] + y] == a[y * strides[i][0] + x]);
        free(a);
        free(b);
    }
}

static void good_lengths_are_the_smallest_that_are_fast(void **state)
{
    (void) state;
    assert_int_equal(pell_fft_good(1, 1), 1);
    assert_int_equal(pell_fft_good(7, 1), 8);
    assert_int_equal(pell_fft_good(1151, 1), 1152);
    assert_int_equal(pell_fft_good(1157, 16), 1200);
    assert_int_equal(pell_fft_good(1157, 1), 1200);
    for (int n = 1; n < 3000; n += 7)
        for (int multiple = 1; multiple <= 32; multiple *= 2) {
            const int g = pell_fft_good(n, multiple);
            int rest = g;
            for (int p = 2; p <= 5; p++)
                while (rest % p == 0)
                    rest /= p;
            assert_true(g >= n && g % multiple == 0 && rest == 1);
            assert_int_equal(pell_fft_good(g, multiple), g);
        }
}

static void all_levels_give_the_same_bits(void **state)
{
    static const char *const levels[] = { "base", "v2", "v3", "v4" };
    static const int lengths[] = { 8, 30, 77, 1152 };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(lengths); i++) {
        float *in = fill(lengths[i]), *first = NULL;
        for (size_t k = 0; k < PELL_COUNT(levels); k++) {
            float *out;
            setenv("PELL_SIMD", levels[k], 1);
            out = transform(lengths[i], k % 2, in);
            unsetenv("PELL_SIMD");
            if (k % 2 == 0 && first)
                assert_memory_equal(first, out, (size_t) lengths[i] * E * sizeof(float));
            if (k == 0)
                first = out;
            else
                free(out);
        }
        for (int inverse = 0; inverse < 2; inverse++) {
            float *out[2];
            for (int k = 0; k < 2; k++) {
                setenv("PELL_SIMD", k ? "v4" : "v3", 1);
                out[k] = transform(lengths[i], inverse, in);
                unsetenv("PELL_SIMD");
            }
            assert_memory_equal(out[0], out[1], (size_t) lengths[i] * E * sizeof(float));
            free(out[0]);
            free(out[1]);
        }
        free(first);
        free(in);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lengths_up_to_64_are_the_sum),
        cmocka_unit_test(long_ones_are_the_sum),
        cmocka_unit_test(there_and_back_is_n_times_as_much),
        cmocka_unit_test(power_is_kept),
        cmocka_unit_test(sums_transform_to_sums_and_lanes_never_meet),
        cmocka_unit_test(images_are_the_sum_and_come_back),
        cmocka_unit_test(tiles_turn),
        cmocka_unit_test(good_lengths_are_the_smallest_that_are_fast),
        cmocka_unit_test(all_levels_give_the_same_bits),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
