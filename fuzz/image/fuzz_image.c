/* SPDX-License-Identifier: MIT
 * fuzz_image.c - every image reader on arbitrary bytes: no crash, no leak, one message per error; an accepted image is within the
 * limits, finite, and can be sampled anywhere. The mutator repairs PNG's checksums, since otherwise almost no input would pass them. */
#include "image/color.h"
#include "image/rows.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t max_size);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed);

#define PIXELS_MAX 16384

static void require(bool holds)
{
    if (!holds)
        abort();
}

static void count_errors(void *user, const struct pell_message *message)
{
    if (message->level == PELL_LOG_ERROR) {
        require(message->what[0] && message->where[0]);
        ++*(int *) user;
    }
}

static void check_image(struct pell_context *ctx, struct pell_image *image)
{
    static const float where[] = { -1e9f, -0.3f, 0, 0.5f, 1, 7.25f };
    size_t count;

    require(image->width > 0 && image->height > 0 && (int64_t) image->width * image->height <= PIXELS_MAX);
    require(image->channels >= 1 && image->channels <= 4 && image->pixels);
    for (size_t i = 0; i < PELL_COUNT(where); i++) {
        float rgba[4];
        pell_image_sample(image, (enum pell_wrap)(i % 3), PELL_WRAP_REPEAT, i % 2, where[i], where[PELL_COUNT(where) - 1 - i], rgba);
        require(isfinite(rgba[0]) && isfinite(rgba[3]));
    }
    if (pell_image_to_float(ctx, image) != PELL_OK)
        return;
    count = (size_t) image->width * (size_t) image->height * (size_t) image->channels;
    for (size_t i = 0; i < count; i++)
        require(isfinite(((const float *) image->pixels)[i]));
}

/* The same file some rows at a time. `errors`: what the context counts. */
static void check_rows(struct pell_context *ctx, const uint8_t *data, size_t size, const int *errors)
{
    struct pell_rows *rows;
    enum pell_result res = pell_rows_open_memory(ctx, "fuzz", data, size, &rows);

    if (res == PELL_OK) {
        const size_t width = (size_t) rows->layers.width, count = rows->layers.count;
        float *band = calloc(5 * width * count, sizeof(*band)), **dest = calloc(count, sizeof(*dest));
        require(band && dest && count > 0);
        for (size_t c = 0; c < count; c++)
            dest[c] = band + 5 * width * c;
        for (int y = 0; res == PELL_OK && y < rows->layers.height; y += 5)
            res = pell_rows_read(rows, y, rows->layers.height - y < 5 ? rows->layers.height - y : 5, dest, width);
        free(dest);
        free(band);
    }
    require(*errors == (res == PELL_OK ? 0 : 1));
    pell_rows_close(&rows);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct pell_limits limits;
    int errors = 0;
    struct pell_context_params params = { .log = count_errors, .log_user = &errors, .limits = &limits };
    struct pell_context *ctx;

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.image_pixels = PIXELS_MAX;
    limits.memory_bytes = 32 << 20;
    if (pell_context_create(&params, &ctx) != PELL_OK)
        return 0;
    for (int role = 0; role < 2; role++) {
        struct pell_image image;
        errors = 0;
        if (pell_image_decode(ctx, "fuzz", data, size, (enum pell_image_role) role, &image) == PELL_OK) {
            require(errors == 0);
            check_image(ctx, &image);
        } else {
            require(errors == 1 && !image.pixels);
        }
        pell_image_finish(ctx, &image);
    }
    if (size > 4 && memcmp(data, "\x76\x2f\x31\x01", 4) == 0) {
        const struct pell_source src = { .name = "fuzz", .data = data, .size = size, .role = PELL_ROLE_DATA };
        struct pell_layers layers;
        errors = 0;
        require((pell_exr_decode_layers(ctx, &src, &layers) == PELL_OK) == (errors == 0));
        pell_layers_finish(ctx, &layers);
    }
    errors = 0;
    check_rows(ctx, data, size, &errors);
    require(pell_memory_used(ctx) == 0);
    pell_context_destroy(&ctx);
    return 0;
}

static uint32_t crc32_of(const uint8_t *data, size_t size)
{
    uint32_t crc = 0xffffffff;
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? 0xedb88320 : 0);
    }
    return ~crc;
}

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed)
{
    size = LLVMFuzzerMutate(data, size, max_size);
    if (size < 8 || memcmp(data, "\x89PNG\r\n\x1a\n", 8) != 0 || seed % 8 == 0)
        return size;
    for (size_t at = 8; size - at >= 12;) {
        const size_t length = (size_t) data[at] << 24 | (size_t) data[at + 1] << 16 | (size_t) data[at + 2] << 8 | data[at + 3];
        uint32_t crc;
        if (length > size - at - 12)
            break;
        crc = crc32_of(data + at + 4, length + 4);
        for (size_t i = 0; i < 4; i++)
            data[at + 8 + length + i] = (uint8_t) (crc >> (24 - 8 * i));
        at += length + 12;
    }
    return size;
}
