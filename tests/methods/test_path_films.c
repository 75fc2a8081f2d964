/* SPDX-License-Identifier: MIT
 * test_path_films.c - sums of samples, and the files that keep them: what is written is read again bit by bit, and nothing else is. */
#include "pell_test.h"

#include "base/hash.h"
#include "methods/path_trace/path_trace.h"

static uint32_t state_of_random = 1;

static double random_unit(void)
{
    state_of_random = state_of_random * 1664525u + 1013904223u;
    return (double) (state_of_random >> 8) / 16777216.0;
}

static struct pt_light random_light(void)
{
    struct pt_light l;

    for (int c = 0; c < 3; c++) {
        l.multiple[c] = random_unit() * (c + 1);
        l.single[c] = 0.1 * random_unit();
        l.surface[c] = random_unit() < 0.1 ? 5.0 : 0.0;
    }
    return l;
}

static bool same(const struct pt_film *a, const struct pt_film *b)
{
    if (a->count != b->count || a->identity != b->identity)
        return false;
    for (size_t i = 0; i < a->count; i++)
        if (memcmp(a->pixels[i].sum, b->pixels[i].sum, sizeof(a->pixels[i].sum)) != 0 ||
            memcmp(a->pixels[i].spread, b->pixels[i].spread, sizeof(a->pixels[i].spread)) != 0 || a->pixels[i].count != b->pixels[i].count)
            return false;
    return true;
}

/* --- Sums ------------------------------------------------------------------------------------------------------------------------- */

/* Against the textbook's two passes. */
static void mean_and_error_are_the_textbooks(void **state)
{
    enum { N = 1000 };
    static struct pt_light light[N];

    (void) state;
    for (int traced = 0; traced < 2; traced++) {
        struct pt_pixel p = { .count = 0 };
        double mean[4], error[4], sum[4] = { 0 }, square[4] = { 0 };
        static double x[N][4];

        for (int i = 0; i < N; i++) {
            light[i] = random_light();
            REQUIRE(pt_pixel_add(&p, &light[i], traced));
            for (int c = 0; c < 3; c++)
                x[i][c] = light[i].multiple[c] + light[i].single[c] + (traced ? light[i].surface[c] : 0.0);
            x[i][3] = 0.2126 * x[i][0] + 0.7152 * x[i][1] + 0.0722 * x[i][2];
            for (int c = 0; c < 4; c++)
                sum[c] += x[i][c];
        }
        for (int i = 0; i < N; i++)
            for (int c = 0; c < 4; c++)
                square[c] += (x[i][c] - sum[c] / N) * (x[i][c] - sum[c] / N);
        pt_pixel_measure(&p, traced, mean, error);
        for (int c = 0; c < 4; c++) {
            REQUIRE_REL(mean[c], sum[c] / N, 1e-13);
            REQUIRE_REL(error[c], sqrt(square[c] / (N - 1.0) / N), 1e-12);
        }
        assert_int_equal(p.count, N);
    }
}

static void few_samples_have_no_error_and_none_no_light(void **state)
{
    struct pt_pixel p = { .count = 0 };
    struct pt_light light = random_light();
    struct pt_film film = { .count = 1, .pixels = &p };
    double mean[4], error[4];

    (void) state;
    pt_pixel_measure(&p, true, mean, error);
    for (int c = 0; c < 4; c++)
        assert_true(mean[c] == 0.0 && error[c] == 0.0);
    assert_true(isinf(pt_film_error(&film, true)));
    REQUIRE(pt_pixel_add(&p, &light, true));
    pt_pixel_measure(&p, true, mean, error);
    for (int c = 0; c < 4; c++)
        assert_true(mean[c] > 0.0 && error[c] == 0.0);
    assert_true(isinf(pt_film_error(&film, true)));
    film.count = 0;
    assert_true(pt_film_error(&film, true) == 0.0);
}

static void what_is_no_number_is_black(void **state)
{
    static const double bad[] = { NAN, INFINITY, -INFINITY };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(bad); k++)
        for (int part = 0; part < 3; part++) {
            struct pt_pixel p = { .count = 0 };
            struct pt_light good = { { 1, 1, 1 }, { 0 }, { 0 } }, light = good;
            double mean[4], error[4];

            (part == 0 ? light.multiple : part == 1 ? light.single : light.surface)[k % 3] = bad[k];
            REQUIRE(pt_pixel_add(&p, &good, true));
            REQUIRE(!pt_pixel_add(&p, &light, true));
            assert_int_equal(p.count, 2);
            pt_pixel_measure(&p, true, mean, error);
            for (int c = 0; c < 4; c++) {
                REQUIRE_NEAR(mean[c], 0.5, 1e-15);
                REQUIRE_NEAR(error[c], 0.5, 1e-15); /* of 1 and 0: sqrt((1/4 + 1/4) / 2) */
            }
        }
}

/* Two pixels of known errors; one of them so dark that it counts as a hundredth of the mean. */
static void picture_error_is_the_root_mean_square(void **state)
{
    struct pt_pixel p[2] = { { .count = 0 } };
    const struct pt_film film = { .count = 2, .pixels = p };

    (void) state;
    for (int i = 0; i < 100; i++) {
        const double bright = i % 2 ? 1.5 : 0.5, dark = i % 2 ? 2e-6 : 0.0;
        REQUIRE(pt_pixel_add(&p[0], &(struct pt_light) { .multiple = { bright, bright, bright } }, false));
        REQUIRE(pt_pixel_add(&p[1], &(struct pt_light) { .single = { dark, dark, dark } }, false));
    }
    /* sqrt(100 (1/2)^2 / (100 99)) and 1e-6 / 0.5 of it, over 1 and over (1 + 1e-6)/2 / 100. */
    REQUIRE_REL(pt_film_error(&film, false), sqrt((1.0 + pow(2e-6 / 0.01 / (1.0 + 1e-6) * 2.0, 2.0)) / 2.0) * 0.5 / sqrt(99.0), 1e-9);
}

/* --- Files ------------------------------------------------------------------------------------------------------------------------ */

static const struct pt_checkpoint_key key = { .width = 5, .height = 4, .films = 3, .scene = 77, .run = 99 };

/* 20, 0 and 7 pixels with 0 to 6 samples. */
static void fill(struct pt_film films[3], struct pt_pixel pixels[27])
{
    memset(pixels, 0, 27 * sizeof(*pixels));
    for (int i = 0; i < 27; i++)
        for (int k = 0; k < i % 7; k++) {
            const struct pt_light light = random_light();
            REQUIRE(pt_pixel_add(&pixels[i], &light, true));
        }
    films[0] = (struct pt_film) { .count = 20, .identity = 1, .pixels = pixels };
    films[1] = (struct pt_film) { .count = 0 };
    films[2] = (struct pt_film) { .count = 7, .identity = 3, .pixels = pixels + 20 };
}

static void films_are_read_as_they_were_written(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pt_pixel pixels[27];
    struct pt_film films[3], again[3];
    uint8_t *data;
    size_t size;

    (void) state;
    fill(films, pixels);
    assert_int_equal(pt_checkpoint_encode(ctx, &key, films, &data, &size), PELL_OK);
    assert_int_equal(size, 40 + 3 * 16 + 27 * 108 + 8);
    assert_int_equal(pt_checkpoint_decode(ctx, "file", data, size, &key, again), PELL_OK);
    for (int f = 0; f < 3; f++) {
        assert_true(same(&films[f], &again[f]));
        pell_free(ctx, again[f].pixels);
    }
    pell_free(ctx, data);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

/* Decodes bytes that must be refused, with one message that holds `word`. */
static void refused(const uint8_t *data, size_t size, const struct pt_checkpoint_key *k, enum pell_result code, const char *word)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pt_film films[3];

    assert_int_equal(pt_checkpoint_decode(ctx, "some.ckpt", data, size, k, films), code);
    assert_int_equal(kept.errors, 1);
    assert_string_equal(kept.where, "some.ckpt");
    if (!strstr(kept.what, word))
        fail_msg("\"%s\" does not hold \"%s\"", kept.what, word);
    for (int f = 0; f < 3; f++)
        assert_null(films[f].pixels);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void mend_hash(uint8_t *data, size_t size)
{
    const uint64_t hash = pell_hash_bytes(0, data, size - 8);
    for (int i = 0; i < 8; i++)
        data[size - 8 + (size_t) i] = (uint8_t) (hash >> 8 * i);
}

static void damaged_files_are_refused(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pt_pixel pixels[27];
    struct pt_film films[3];
    uint8_t *data, *copy;
    size_t size;

    (void) state;
    fill(films, pixels);
    assert_int_equal(pt_checkpoint_encode(ctx, &key, films, &data, &size), PELL_OK);
    refused(NULL, 0, &key, PELL_ERR_FORMAT, "no checkpoint");
    for (size_t cut = 0; cut < size; cut += cut < 100 ? 1 : 97) { /* in a block of its own size, so that reading on is seen */
        copy = malloc(cut + 1);
        memcpy(copy, data, cut);
        refused(copy, cut, &key, PELL_ERR_FORMAT, "");
        free(copy);
    }
    copy = malloc(size + 16);
    memcpy(copy, data, size);
    memset(copy + size, 0, 16);
    refused(copy, size + 1, &key, PELL_ERR_FORMAT, "bytes");
    refused(copy, size + 16, &key, PELL_ERR_FORMAT, "bytes");
    for (size_t at = 40 + 48; at < size; at += 13) {
        copy[at] ^= (uint8_t) (1u << at % 8);
        refused(copy, size, &key, PELL_ERR_FORMAT, "hash");
        copy[at] = data[at];
    }
    free(copy);
    pell_free(ctx, data);
    pell_context_destroy(&ctx);
}

static void files_of_something_else_are_refused_by_name(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pt_pixel pixels[27];
    struct pt_film films[3];
    struct pt_checkpoint_key other = key;
    uint8_t *data;
    size_t size;

    (void) state;
    fill(films, pixels);
    assert_int_equal(pt_checkpoint_encode(ctx, &key, films, &data, &size), PELL_OK);
    other.width = 6;
    refused(data, size, &other, PELL_ERR_INVALID, "5 x 4");
    refused(data, size, &(struct pt_checkpoint_key) { 5, 4, 2, 77, 99 }, PELL_ERR_INVALID, "msaa 3");
    refused(data, size, &(struct pt_checkpoint_key) { 5, 4, 3, 78, 99 }, PELL_ERR_INVALID, "scene");
    refused(data, size, &(struct pt_checkpoint_key) { 5, 4, 3, 77, 98 }, PELL_ERR_INVALID, "knobs");
    data[8] = 2;
    mend_hash(data, size);
    refused(data, size, &key, PELL_ERR_INVALID, "version 2");
    pell_free(ctx, data);
    pell_context_destroy(&ctx);
}

static void put_number(uint8_t *at, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof(bits));
    for (int i = 0; i < 8; i++)
        at[i] = (uint8_t) (bits >> 8 * i);
}

/* Forged files, whose hash is right. */
static void sums_that_no_samples_have_are_refused(void **state)
{
    static const double bad[] = { NAN, INFINITY, -INFINITY, 1e300 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pt_pixel pixels[27];
    struct pt_film films[3];
    uint8_t *data, *copy, *pixel;
    size_t size;

    (void) state;
    fill(films, pixels);
    assert_int_equal(pt_checkpoint_encode(ctx, &key, films, &data, &size), PELL_OK);
    copy = malloc(size);
    pixel = copy + 40 + 48 + 6 * 108; /* of 6 samples */
    for (int number = 0; number < 13; number++)
        for (size_t k = 0; k < PELL_COUNT(bad); k++) {
            memcpy(copy, data, size);
            put_number(pixel + 8 * number, bad[k]);
            mend_hash(copy, size);
            refused(copy, size, &key, PELL_ERR_FORMAT, "pixel 6 of sample 0");
        }
    memcpy(copy, data, size);
    put_number(pixel + 8 * 12, -1e-3); /* a spread */
    mend_hash(copy, size);
    refused(copy, size, &key, PELL_ERR_FORMAT, "pixel 6");
    for (int byte = 0; byte < 2; byte++) { /* 0 samples, and 2^31 of them */
        memcpy(copy, data, size);
        memset(pixel + 8 * 13, 0, 4);
        pixel[8 * 13 + 3] = byte ? 0x80 : 0;
        mend_hash(copy, size);
        refused(copy, size, &key, PELL_ERR_FORMAT, "pixel 6");
    }
    for (int byte = 0; byte < 8; byte++) { /* more pixels than there are, up to 2^63 */
        memcpy(copy, data, size);
        copy[40 + byte] = 0x80;
        mend_hash(copy, size);
        refused(copy, size, &key, PELL_ERR_FORMAT, "pixels of a picture of 5 x 4");
    }
    memcpy(copy, data, size);
    copy[40] = 19;
    mend_hash(copy, size);
    refused(copy, size, &key, PELL_ERR_FORMAT, "bytes, must have");
    free(copy);
    pell_free(ctx, data);
    pell_context_destroy(&ctx);
}

static void survives_the_nth_allocation(void **state)
{
    struct pell_context *plain = test_context(NULL, NULL);
    struct pt_pixel pixels[27];
    struct pt_film films[3], again[3];
    uint8_t *data, *more;
    size_t size;
    bool done = false;

    (void) state;
    fill(films, pixels);
    assert_int_equal(pt_checkpoint_encode(plain, &key, films, &data, &size), PELL_OK);
    for (uint64_t at = 1; !done; at++) {
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, NULL);
        enum pell_result res;

        fault.fail_at = fault.calls + at;
        res = pt_checkpoint_encode(ctx, &key, films, &more, &size);
        if (res == PELL_OK)
            pell_free(ctx, more);
        if (res == PELL_OK && (res = pt_checkpoint_decode(ctx, "file", data, size, &key, again)) == PELL_OK) {
            done = fault.calls < fault.fail_at;
            for (int f = 0; f < 3; f++)
                pell_free(ctx, again[f].pixels);
        }
        assert_true(res == PELL_OK || res == PELL_ERR_NOMEM);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
    }
    pell_free(plain, data);
    pell_context_destroy(&plain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(mean_and_error_are_the_textbooks),
        cmocka_unit_test(few_samples_have_no_error_and_none_no_light),
        cmocka_unit_test(what_is_no_number_is_black),
        cmocka_unit_test(picture_error_is_the_root_mean_square),
        cmocka_unit_test(films_are_read_as_they_were_written),
        cmocka_unit_test(damaged_files_are_refused),
        cmocka_unit_test(files_of_something_else_are_refused_by_name),
        cmocka_unit_test(sums_that_no_samples_have_are_refused),
        cmocka_unit_test(survives_the_nth_allocation),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
