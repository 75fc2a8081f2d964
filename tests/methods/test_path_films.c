/* SPDX-License-Identifier: MIT
 * test_path_films.c - accumulated samples (film) and checkpoint files: written files are read back bit by bit, and damaged or foreign
 * files are refused. */
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
    if (a->count != b->count || a->identity != b->identity || a->tiles != b->tiles)
        return false;
    for (size_t t = 0; t < a->tiles; t++)
        if (a->starts[t] != b->starts[t] || a->num_spans[t] != b->num_spans[t] ||
            memcmp(a->spans + t * a->span_capacity, b->spans + t * b->span_capacity, a->num_spans[t] * sizeof(*a->spans)) != 0)
            return false;
    for (size_t i = 0; i < a->count; i++)
        if (memcmp(a->pixels[i].sum, b->pixels[i].sum, sizeof(a->pixels[i].sum)) != 0 || a->pixels[i].count != b->pixels[i].count ||
            memcmp(a->pixels[i].squares, b->pixels[i].squares, sizeof(a->pixels[i].squares)) != 0)
            return false;
    return true;
}

/* --- Sums ------------------------------------------------------------------------------------------------------------------------- */

/* Against the two-pass algorithm. */
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
            REQUIRE(pt_pixel_add(&p, 1, &light[i], traced));
            for (int c = 0; c < 3; c++)
                x[i][c] = light[i].multiple[c] + light[i].single[c] + (traced ? light[i].surface[c] : 0.0);
            x[i][3] = 0.2126 * x[i][0] + 0.7152 * x[i][1] + 0.0722 * x[i][2];
            for (int c = 0; c < 4; c++)
                sum[c] += x[i][c];
        }
        for (int i = 0; i < N; i++)
            for (int c = 0; c < 4; c++)
                square[c] += (x[i][c] - sum[c] / N) * (x[i][c] - sum[c] / N);
        pt_pixel_measure(&p, 1, traced, mean, error);
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
    pt_pixel_measure(&p, 1, true, mean, error);
    for (int c = 0; c < 4; c++)
        assert_true(mean[c] == 0.0 && error[c] == 0.0);
    assert_true(isinf(pt_film_error(&film, true)));
    REQUIRE(pt_pixel_add(&p, 1, &light, true));
    pt_pixel_measure(&p, 1, true, mean, error);
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
            REQUIRE(pt_pixel_add(&p, 1, &good, true));
            REQUIRE(!pt_pixel_add(&p, 1, &light, true));
            assert_int_equal(p.count, 2);
            pt_pixel_measure(&p, 1, true, mean, error);
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
        REQUIRE(pt_pixel_add(&p[0], 0, &(struct pt_light) { .multiple = { bright, bright, bright } }, false));
        REQUIRE(pt_pixel_add(&p[1], 0, &(struct pt_light) { .single = { dark, dark, dark } }, false));
    }
    /* sqrt(100 (1/2)^2 / (100 99)) and 1e-6 / 0.5 of it, over 1 and over (1 + 1e-6)/2 / 100. */
    REQUIRE_REL(pt_film_error(&film, false), sqrt((1.0 + pow(2e-6 / 0.01 / (1.0 + 1e-6) * 2.0, 2.0)) / 2.0) * 0.5 / sqrt(99.0), 1e-9);
}

/* Sums of the same samples in another order, in two halves, with values of very different magnitude: the same bits. */
static void no_order_changes_a_sum(void **state)
{
    enum { N = 3000 };
    static struct pt_light light[N];
    struct pt_pixel whole = { .count = 0 }, back = { .count = 0 }, odd = { .count = 0 }, even = { .count = 0 };
    double mean[4], error[4], sum = 0.0;

    (void) state;
    for (int i = 0; i < N; i++) {
        const double size = ldexp(random_unit() < 0.5 ? -1.0 : 1.0, (int) (80.0 * random_unit()) - 60);
        for (int c = 0; c < 3; c++) {
            light[i].multiple[c] = size * random_unit();
            light[i].single[c] = random_unit();
            light[i].surface[c] = ldexp(random_unit(), 20);
        }
        sum += light[i].single[1];
    }
    for (int i = 0; i < N; i++) {
        REQUIRE(pt_pixel_add(&whole, -3, &light[i], true));
        REQUIRE(pt_pixel_add(&back, -3, &light[N - 1 - i], true));
        REQUIRE(pt_pixel_add(i % 2 ? &odd : &even, -3, &light[i], true));
    }
    pt_pixel_merge(&odd, &even);
    assert_memory_equal(whole.sum, back.sum, sizeof(whole.sum));
    assert_memory_equal(whole.squares, back.squares, sizeof(whole.squares));
    assert_memory_equal(whole.sum, odd.sum, sizeof(whole.sum));
    assert_memory_equal(whole.squares, odd.squares, sizeof(whole.squares));
    assert_int_equal(odd.count, N);
    REQUIRE_REL(pt_sum_value(&whole.sum[PT_SINGLE][1], -3), sum, 1e-13);
    pt_pixel_measure(&whole, -3, true, mean, error);
    for (int c = 0; c < 4; c++)
        assert_true(isfinite(mean[c]) && isfinite(error[c]) && error[c] > 0.0);
}

/* Noise of a millionth of the mean is distinguished from rounding. */
static void little_noise_is_told_from_rounding(void **state)
{
    struct pt_pixel p = { .count = 0 };
    double mean[4], error[4];

    (void) state;
    for (int i = 0; i < 10000; i++) {
        const double x = 1.0 + (i % 2 ? 1e-6 : -1e-6);
        REQUIRE(pt_pixel_add(&p, 4, &(struct pt_light) { .multiple = { x, x, x } }, false));
    }
    pt_pixel_measure(&p, 4, false, mean, error);
    for (int c = 0; c < 3; c++)
        REQUIRE_REL(error[c], 1e-6 / sqrt(9999.0), 1e-4);
    REQUIRE_REL(error[3], 1e-6 / sqrt(9999.0), 1e-3);
}

/* Against a list of all samples. */
static void spans_are_what_was_covered(void **state)
{
    enum { SAMPLES = 60 };
    struct pell_context *ctx = test_context(NULL, NULL);

    (void) state;
    for (int trial = 0; trial < 200; trial++) {
        const uint8_t pixels[2] = { 1, 2 };
        bool listed[SAMPLES + 1] = { false };
        struct pt_film film;

        assert_int_equal(pt_film_create(ctx, pixels, 2, &film), PELL_OK);
        for (int k = 0; k < 30; k++) {
            const uint32_t from = (uint32_t) (random_unit() * SAMPLES);
            uint32_t next, first = pt_film_missing(&film, 1, from, &next), end, wanted = from;
            while (wanted < SAMPLES && listed[wanted])
                wanted++;
            assert_int_equal(first, wanted);
            if (first >= SAMPLES)
                continue;
            end = first + 1 + (uint32_t) (random_unit() * 4);
            end = end < next ? end : next;
            end = end < SAMPLES ? end : SAMPLES;
            assert_int_equal(pt_film_reserve(ctx, &film, 1), PELL_OK);
            pt_film_cover(&film, 1, (struct pt_span) { first, end });
            for (uint32_t n = first; n < end; n++)
                listed[n] = true;
        }
        assert_int_equal(film.num_spans[0], 0);
        for (uint32_t i = 0; i < film.num_spans[1]; i++) {
            const struct pt_span *span = &film.spans[film.span_capacity + i];
            assert_true(span->first < span->end && (i == 0 || span[-1].end < span->first));
            for (uint32_t n = span->first; n < span->end; n++)
                assert_true(listed[n]);
            assert_false(listed[span->end]);
        }
        pt_film_free(ctx, &film);
    }
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

/* --- Files ------------------------------------------------------------------------------------------------------------------------ */

static const struct pt_checkpoint_key key = {
    .width = 20, .height = 12, .films = 3, .scene = 77, .seed = 99, .words = { 1, 2, 3 }, .roulette = 0.5f, .exponent = 2, .version = "1.2"
};

enum { NOTE = 5, HEADER = 8 + 4 * 4 + 8 + 8 + 8 + 4 + 4 * PT_KEY_WORDS + 32, FILM = HEADER + NOTE, TILES = FILM + 8, PIXEL = 13 * 16 };

static void add_samples(struct pt_film *film, size_t tile, uint32_t first, uint32_t end, struct pell_context *ctx)
{
    assert_int_equal(pt_film_reserve(ctx, film, 1), PELL_OK);
    for (uint32_t i = film->starts[tile]; i < film->starts[tile + 1]; i++)
        for (uint32_t n = first; n < end; n++) {
            const struct pt_light light = random_light();
            REQUIRE(pt_pixel_add(&film->pixels[i], film->exponent, &light, true));
        }
    pt_film_cover(film, tile, (struct pt_span) { first, end });
}

/* Of three samples of the multisample: six tiles that are not begun, and two tiles that are. */
static void fill(struct pell_context *ctx, struct pt_film films[3])
{
    static const uint8_t pixels[2][6] = { { 64, 0, 32, 1, 32, 16 }, { 0, 3, 0, 0, 0, 5 } };

    for (int f = 0; f < 3; f += 2) {
        assert_int_equal(pt_film_create(ctx, pixels[f / 2], 6, &films[f]), PELL_OK);
        films[f].identity = 5 + (uint64_t) f;
        films[f].exponent = key.exponent;
    }
    memset(&films[1], 0, sizeof(films[1]));
    add_samples(&films[0], 0, 0, 4, ctx);
    add_samples(&films[0], 0, 8, 9, ctx);
    add_samples(&films[0], 0, 20, 22, ctx);
    add_samples(&films[0], 3, 2, 3, ctx);
    add_samples(&films[2], 5, 0, 16, ctx);
}

static void drop(struct pell_context *ctx, struct pt_film films[3])
{
    for (int f = 0; f < 3; f++)
        pt_film_free(ctx, &films[f]);
}

static void encode(struct pell_context *ctx, uint8_t **data, size_t *size)
{
    struct pt_film films[3];

    fill(ctx, films);
    assert_int_equal(pt_checkpoint_encode(ctx, &key, "a\nb c", films, data, size), PELL_OK);
    drop(ctx, films);
}

static void films_are_read_as_they_were_written(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pt_film films[3], again[3];
    uint8_t *data;
    size_t size;

    (void) state;
    fill(ctx, films);
    assert_int_equal(pt_checkpoint_encode(ctx, &key, "a\nb c", films, &data, &size), PELL_OK);
    assert_int_equal(size, FILM + 3 * (8 + 6 * 3) + 5 * 8 + (64 + 1 + 5) * PIXEL + 8);
    assert_int_equal(pt_checkpoint_decode(ctx, "file", data, size, &key, again), PELL_OK);
    assert_true(same(&films[0], &again[0]) && same(&films[2], &again[2]));
    assert_true(again[1].count == 0 && again[1].identity == 0);
    drop(ctx, films);
    drop(ctx, again);
    pell_free(ctx, data);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void films_merge_to_what_one_run_gives(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pt_film a[3], b[3];
    uint8_t *data;
    size_t size, tile;
    uint32_t sample, end;

    (void) state;
    encode(ctx, &data, &size);
    assert_int_equal(pt_checkpoint_decode(ctx, "file", data, size, &key, a), PELL_OK);
    assert_int_equal(pt_checkpoint_decode(ctx, "file", data, size, &key, b), PELL_OK);
    assert_int_equal(pt_film_merge(ctx, &a[0], &b[0], &tile, &sample), PELL_ERR_INVALID);
    assert_true(tile == 0 && sample == 0 && same(&a[0], &b[0]));
    memset(b[0].num_spans, 0, 6 * sizeof(*b[0].num_spans));
    memset(b[0].pixels, 0, b[0].count * sizeof(*b[0].pixels));
    assert_true(pt_film_holds(&a[0], &b[0]));
    add_samples(&b[0], 0, 4, 8, ctx);
    add_samples(&b[0], 4, 1, 2, ctx);
    assert_false(pt_film_holds(&a[0], &b[0]));
    assert_int_equal(pt_film_merge(ctx, &a[0], &b[0], &tile, &sample), PELL_OK);
    assert_true(pt_film_holds(&a[0], &b[0]));
    assert_int_equal(a[0].num_spans[0], 2);
    assert_true(pt_film_missing(&a[0], 0, 0, &end) == 9 && end == 20);
    assert_int_equal(a[0].pixels[63].count, 4 + 1 + 2 + 4);
    assert_int_equal(pt_film_merge(ctx, &a[0], &b[0], &tile, &sample), PELL_ERR_INVALID);
    assert_true(tile == 0 && sample == 4);
    drop(ctx, a);
    drop(ctx, b);
    pell_free(ctx, data);
    pell_context_destroy(&ctx);
}

/* Decodes bytes that must be refused, with one message that contains `word`. */
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
    for (uint32_t f = 0; f < k->films; f++)
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
    uint8_t *data, *copy;
    size_t size;

    (void) state;
    encode(ctx, &data, &size);
    refused(NULL, 0, &key, PELL_ERR_FORMAT, "no checkpoint");
    for (size_t cut = 0; cut < size; cut += cut < 200 ? 1 : 97) { /* in a block of its exact size, so that reading beyond it is detected */
        copy = malloc(cut + 1);
        memcpy(copy, data, cut);
        refused(copy, cut, &key, PELL_ERR_FORMAT, "");
        if (cut > HEADER + NOTE + 8) { /* also where the hash is correct */
            mend_hash(copy, cut);
            refused(copy, cut, &key, PELL_ERR_FORMAT, "");
        }
        free(copy);
    }
    copy = malloc(size + 16);
    memcpy(copy, data, size);
    memset(copy + size, 0, 16);
    refused(copy, size + 1, &key, PELL_ERR_FORMAT, "bytes");
    refused(copy, size + 16, &key, PELL_ERR_FORMAT, "bytes");
    mend_hash(copy, size + 16);
    refused(copy, size + 16, &key, PELL_ERR_FORMAT, "16 bytes too many");
    memcpy(copy, data, size);
    for (size_t at = FILM; at < size; at += 13) {
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
    static const char *const words[PT_KEY_WORDS] = { "normals", "boundary",    "acceleration", "events",
                                                     "bounces", "connections", "surface",      "render setting boundary",
                                                     "half" };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pt_checkpoint_key other = key;
    uint8_t *data;
    size_t size;

    (void) state;
    encode(ctx, &data, &size);
    other.width = 21;
    refused(data, size, &other, PELL_ERR_INVALID, "20 x 12");
    other = key;
    other.films = 2;
    refused(data, size, &other, PELL_ERR_INVALID, "msaa 3");
    other = key;
    other.scene = 78;
    refused(data, size, &other, PELL_ERR_INVALID, "another scene");
    other = key;
    other.seed = -1;
    refused(data, size, &other, PELL_ERR_INVALID, "another seed: 99, not -1");
    for (int i = 0; i < PT_KEY_WORDS; i++) {
        other = key;
        other.words[i] += 1;
        refused(data, size, &other, PELL_ERR_INVALID, words[i]);
    }
    other = key;
    other.roulette = 0.25f;
    refused(data, size, &other, PELL_ERR_INVALID, "roulette");
    other = key;
    other.exponent = 3;
    refused(data, size, &other, PELL_ERR_INVALID, "another scene");
    other = key;
    other.version[2] = '3';
    refused(data, size, &other, PELL_ERR_INVALID, "version 1.2 of the program, not by 1.3");
    data[8] = 2; /* the one before */
    mend_hash(data, size);
    refused(data, size, &key, PELL_ERR_INVALID, "version 2");
    pell_free(ctx, data);
    pell_context_destroy(&ctx);
}

/* Manipulated files with a correct hash. */
static void what_no_run_writes_is_refused(void **state)
{
    /* Spans of the first tile begin after its three bytes; its first pixel has 7 samples. */
    static const size_t pixel = TILES + 6 * 3 + 4 * 8;
    const struct {
        size_t at;
        uint8_t value;
        const char *word;
    } bad[] = {
        { TILES, 65, "65 pixels of an image of 20 x 12" },
        { TILES + 2, 0xff, "runs of samples" },
        { TILES + 1, 0, "" },
        { TILES + 3, 4, "samples 4 to 4" },
        { TILES + 3 + 7, 0x80, "samples 0 to" },
        { TILES + 3 + 8, 3, "samples 3 to 9 after those up to 4" },
        { TILES + 3 + 8, 4, "samples 4 to 9 after those up to 4" },
        { pixel + 15, 0x7f, "pixel 0 of sample 0" },
        { pixel + 15, 0x80, "pixel 0 of sample 0" },
        { pixel + 8 * 16 + 13, 1, "pixel 0 of sample 0" },
        { pixel + 12 * 16 + 15, 0x80, "pixel 0 of sample 0" },
        { HEADER - 32 - 4 * PT_KEY_WORDS - 4 - 2, 2, "a note of" },
    };
    struct pell_context *ctx = test_context(NULL, NULL);
    uint8_t *data, *copy;
    size_t size;

    (void) state;
    encode(ctx, &data, &size);
    copy = malloc(size);
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        memcpy(copy, data, size);
        copy[bad[i].at] = bad[i].value;
        mend_hash(copy, size);
        refused(copy, size, &key, PELL_ERR_FORMAT, bad[i].word);
    }
    free(copy);
    pell_free(ctx, data);
    pell_context_destroy(&ctx);
}

static void survives_the_nth_allocation(void **state)
{
    struct pell_context *plain = test_context(NULL, NULL);
    struct pt_film films[3], again[3];
    uint8_t *data, *more;
    size_t size, tile;
    uint32_t sample;
    bool done = false;

    (void) state;
    fill(plain, films);
    encode(plain, &data, &size);
    for (uint64_t at = 1; !done; at++) {
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, NULL);
        enum pell_result res;

        fault.fail_at = fault.calls + at;
        res = pt_checkpoint_encode(ctx, &key, NULL, films, &more, &size);
        if (res == PELL_OK)
            pell_free(ctx, more);
        pell_free(plain, data);
        encode(plain, &data, &size);
        if (res == PELL_OK && (res = pt_checkpoint_decode(ctx, "file", data, size, &key, again)) == PELL_OK) {
            struct pt_film empty;
            const uint8_t pixels[6] = { 64, 0, 32, 1, 32, 16 };
            res = pt_film_create(ctx, pixels, 6, &empty);
            if (res == PELL_OK)
                res = pt_film_merge(ctx, &empty, &again[0], &tile, &sample);
            if (res == PELL_OK)
                done = fault.calls < fault.fail_at;
            pt_film_free(ctx, &empty);
            drop(ctx, again);
        }
        assert_true(res == PELL_OK || res == PELL_ERR_NOMEM);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
    }
    drop(plain, films);
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
        cmocka_unit_test(no_order_changes_a_sum),
        cmocka_unit_test(little_noise_is_told_from_rounding),
        cmocka_unit_test(spans_are_what_was_covered),
        cmocka_unit_test(films_merge_to_what_one_run_gives),
        cmocka_unit_test(films_are_read_as_they_were_written),
        cmocka_unit_test(damaged_files_are_refused),
        cmocka_unit_test(files_of_something_else_are_refused_by_name),
        cmocka_unit_test(what_no_run_writes_is_refused),
        cmocka_unit_test(survives_the_nth_allocation),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
