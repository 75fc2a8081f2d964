/* SPDX-License-Identifier: MIT
 * test_rows.c - files read in bands of rows give the same result as files read at once, including damaged files and failed allocations. */
#include "image_test.h"

#include "image/rows.h"

/* Reads all channels, one after the other, in bands of `band` rows from top to bottom; NULL where a band is refused. */
static float *read_bands(struct pell_rows *rows, int band)
{
    const size_t width = (size_t) rows->layers.width, height = (size_t) rows->layers.height, all = width * height;
    float *out = calloc(rows->layers.count * all, sizeof(*out)), **dest = calloc(rows->layers.count, sizeof(*dest));

    REQUIRE(out && dest);
    for (int y = 0; out && y < (int) height; y += band) {
        for (size_t c = 0; c < rows->layers.count; c++)
            dest[c] = out + c * all + (size_t) y * width;
        if (pell_rows_read(rows, y, (int) height - y < band ? (int) height - y : band, dest, width) != PELL_OK) {
            free(out);
            out = NULL;
        }
    }
    free(dest);
    return out;
}

/* The same for a file that is decoded at once; NULL: refused. */
static float *read_whole(struct pell_context *ctx, const char *name, const uint8_t *data, size_t size)
{
    struct pell_image image;
    float *out;
    size_t all;

    if (pell_image_decode(ctx, name, data, size, PELL_ROLE_RAW, &image) != PELL_OK)
        return NULL;
    assert_int_equal(pell_image_to_float(ctx, &image), PELL_OK);
    all = (size_t) image.width * (size_t) image.height;
    REQUIRE(out = malloc((size_t) image.channels * all * sizeof(*out)));
    for (size_t c = 0; c < (size_t) image.channels; c++)
        for (size_t i = 0; i < all; i++)
            out[c * all + i] = ((const float *) image.pixels)[i * (size_t) image.channels + c];
    pell_image_finish(ctx, &image);
    return out;
}

static bool is_exr(const uint8_t *data, size_t size)
{
    return size >= 4 && memcmp(data, "\x76\x2f\x31\x01", 4) == 0;
}

static float *layers_at_once(struct pell_context *ctx, const char *name, const uint8_t *data, size_t size)
{
    const struct pell_source src = { .name = name, .data = data, .size = size, .role = PELL_ROLE_RAW };
    struct pell_layers layers;
    float *out;
    size_t all;

    if (pell_exr_decode_layers(ctx, &src, &layers) != PELL_OK)
        return NULL;
    all = (size_t) layers.width * (size_t) layers.height;
    REQUIRE(out = malloc(layers.count * all * sizeof(*out)));
    for (size_t c = 0; c < layers.count; c++)
        memcpy(out + c * all, layers.layers[c].data, all * sizeof(*out));
    pell_layers_finish(ctx, &layers);
    return out;
}

/* The image as role RAW decodes it, where it has these channels. */
static void check_rgb(struct pell_context *ctx, const char *name, const uint8_t *data, size_t size, const struct pell_layers *layers,
                      const float *bands)
{
    static const char *const names[] = { "R", "G", "B", "A" };
    const size_t all = (size_t) layers->width * (size_t) layers->height;
    struct pell_image image;

    if (pell_image_decode(ctx, name, data, size, PELL_ROLE_RAW, &image) != PELL_OK)
        return;
    for (size_t i = 0; i < layers->count; i++)
        for (int c = 0; c < image.channels && image.channels > 2; c++)
            for (size_t k = 0; k < all && strcmp(layers->layers[i].name, names[c]) == 0; k++)
                if (memcmp(&bands[i * all + k], (const float *) image.pixels + k * (size_t) image.channels + (size_t) c, sizeof(float)))
                    fail_msg("%s: channel %s, pixel %zu", name, names[c], k);
    pell_image_finish(ctx, &image);
}

static void rows_of(const char *name, const uint8_t *data, size_t size)
{
    static const int bands[] = { 7, 1, 1000, 3 };
    struct image_test t;
    struct pell_rows *rows;
    float *whole;

    image_test_begin(&t);
    whole = is_exr(data, size) ? layers_at_once(t.ctx, name, data, size) : read_whole(t.ctx, name, data, size);
    if (pell_rows_open_memory(t.ctx, name, data, size, &rows) == PELL_OK) {
        const size_t bytes = rows->layers.count * (size_t) rows->layers.width * (size_t) rows->layers.height * sizeof(float);
        for (size_t i = 0; i < PELL_COUNT(bands); i++) {
            float *read = read_bands(rows, bands[i]);
            REQUIRE((read != NULL) == (whole != NULL));
            if (whole && memcmp(read, whole, bytes) != 0)
                fail_msg("%s: bands of %d rows give another image", name, bands[i]);
            if (whole && is_exr(data, size))
                check_rgb(t.ctx, name, data, size, &rows->layers, read);
            free(read);
        }
    } else {
        REQUIRE(!whole && !rows);
    }
    free(whole);
    pell_rows_close(&rows);
    image_test_end(&t);
}

static void rows_are_those_of_the_picture(void **state)
{
    (void) state;
    for_each_variant(rows_of);
}

/* From a file: identical values, and only the requested rows are read. */
static void files_are_read_row_by_row(void **state)
{
    static const char *const names[] = { "rows.png", "rows.exr", "rows.hdr", "rows.pfm" };
    struct image_test t;
    struct planes p;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 33, 41, pattern);
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        const char *path = temp_path(names[i]);
        float guard[4 * 33], *dest[4], *whole;
        struct pell_rows *rows;
        uint8_t *data;
        size_t size;
        assert_int_equal(pell_image_write(t.ctx, path, NULL, &p.params), PELL_OK);
        data = file_bytes(path, &size);
        whole = is_exr(data, size) ? layers_at_once(t.ctx, path, data, size) : read_whole(t.ctx, path, data, size);
        assert_int_equal(pell_rows_open(t.ctx, path, &rows), PELL_OK);
        assert_true(rows->format && rows->layers.width == 33 && rows->layers.height == 41);
        assert_int_equal(rows->layered, i == 1);
        assert_int_equal(rows->display, i == 0);
        for (size_t y = 41; y-- > 0;) { /* backwards, one channel alone */
            for (size_t c = 0; c < 4; c++)
                dest[c] = c == 1 ? guard : NULL;
            for (size_t x = 0; x < 4 * 33; x++)
                guard[x] = -7.0f;
            assert_int_equal(pell_rows_read(rows, (int) y, 1, dest, 33), PELL_OK);
            assert_memory_equal(guard, whole + (41 + y) * 33, 33 * sizeof(float));
            assert_true(guard[33] < -6.0f);
        }
        assert_int_equal(pell_rows_read(rows, 41, 1, dest, 33), PELL_ERR_INVALID);
        assert_int_equal(pell_rows_read(rows, 0, 42, dest, 33), PELL_ERR_INVALID);
        assert_int_equal(pell_rows_read(rows, 0, 1, dest, 32), PELL_ERR_INVALID);
        pell_rows_close(&rows);
        free(whole);
        free(data);
        unlink(path);
    }
    planes_free(&p);
    image_test_end(&t);
}

static void cut_rows(const char *name, const uint8_t *data, size_t size)
{
    struct image_test t;

    image_test_begin(&t);
    for (size_t length = 0; length < size; length += length < 500 || size - length < 50 ? 1 : 37) {
        uint8_t *copy = malloc(length ? length : 1);
        struct pell_rows *rows;
        float *read = NULL, *whole;
        REQUIRE(copy);
        memcpy(copy, data, length);
        whole = is_exr(copy, length) ? NULL : read_whole(t.ctx, name, copy, length);
        t.kept.errors = 0;
        if (pell_rows_open_memory(t.ctx, name, copy, length, &rows) == PELL_OK)
            read = read_bands(rows, 5);
        assert_int_equal(t.kept.errors, read ? 0 : 1);
        if (!is_exr(copy, length) && (read != NULL) != (whole != NULL))
            fail_msg("%s: cut at %zu of %zu, rows are %s", name, length, size, read ? "read" : "refused");
        pell_rows_close(&rows);
        free(read);
        free(whole);
        free(copy);
    }
    image_test_end(&t);
}

static void cut_files_are_refused_with_one_error(void **state)
{
    (void) state;
    for_each_variant(cut_rows);
}

static void rows_without_memory(const char *name, const uint8_t *data, size_t size)
{
    for (uint64_t n = 1; n < 1000; n++) {
        struct kept_messages kept = { 0 };
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, &kept);
        struct pell_rows *rows;
        float *read = NULL;
        bool done;

        REQUIRE(ctx);
        fault.fail_at = fault.calls + n;
        if (pell_rows_open_memory(ctx, name, data, size, &rows) == PELL_OK)
            read = read_bands(rows, 16);
        done = fault.calls < fault.fail_at;
        if (!done) {
            assert_null(read);
            assert_int_equal(kept.errors, 1);
            assert_int_equal(kept.code, PELL_ERR_NOMEM);
        }
        free(read);
        pell_rows_close(&rows);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
        if (done)
            return;
    }
    fail_msg("%s takes more than 1000 allocations", name);
}

static void every_allocation_may_fail(void **state)
{
    (void) state;
    for_each_variant(rows_without_memory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_are_those_of_the_picture),
        cmocka_unit_test(files_are_read_row_by_row),
        cmocka_unit_test(cut_files_are_refused_with_one_error),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("image.rows", tests, NULL, NULL);
}
