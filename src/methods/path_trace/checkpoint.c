/* SPDX-License-Identifier: MIT
 *
 * checkpoint.c - films as bytes. Whole numbers and IEEE doubles, lowest byte first:
 *
 *     8 bytes "PELLPT\r\n"   a program that meddles with line ends shows
 *     u32 version, width, height, films; u64 scene, run
 *     of each film: u64 pixels, identity
 *     of each pixel of each film: 9 doubles of sums, 4 of spreads, u32 samples
 *     u64 hash of all bytes before it
 *
 * The hash finds damage; who forges a file gets a wrong picture of finite numbers, and nothing else.
 */
#include "methods/path_trace/path_trace.h"

#include "base/hash.h"

enum { VERSION = 1, HEADER = 8 + 4 * 4 + 2 * 8, FILM = 2 * 8, NUMBERS = 13, PIXEL = NUMBERS * 8 + 4, TRAILER = 8, FILMS = 64 };

/* No radiance of this program is as large; sums of it stay finite. */
#define LARGEST 1e100

static const uint8_t magic[8] = { 'P', 'E', 'L', 'L', 'P', 'T', '\r', '\n' };

static uint8_t *put(uint8_t *to, uint64_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        *to++ = (uint8_t) (value >> 8 * i);
    return to;
}

static uint8_t *put_double(uint8_t *to, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof(bits));
    return put(to, bits, 8);
}

static uint64_t get(const uint8_t **from, int bytes)
{
    uint64_t value = 0;
    for (int i = 0; i < bytes; i++)
        value |= (uint64_t) * (*from)++ << 8 * i;
    return value;
}

static double get_double(const uint8_t **from)
{
    const uint64_t bits = get(from, 8);
    double value;
    memcpy(&value, &bits, sizeof(value));
    return value;
}

enum pell_result pt_checkpoint_encode(struct pell_context *ctx, const struct pt_checkpoint_key *key, const struct pt_film *films,
                                      uint8_t **data, size_t *size)
{
    size_t pixels = 0;
    uint8_t *to;

    *data = NULL;
    for (uint32_t f = 0; f < key->films; f++)
        pixels += films[f].count;
    *size = HEADER + FILM * (size_t) key->films + PIXEL * pixels + TRAILER;
    to = *data = pell_alloc(ctx, *size);
    if (!to)
        return PELL_ERR_NOMEM;
    memcpy(to, magic, sizeof(magic));
    to = put(to + sizeof(magic), VERSION, 4);
    to = put(to, key->width, 4);
    to = put(to, key->height, 4);
    to = put(to, key->films, 4);
    to = put(to, key->scene, 8);
    to = put(to, key->run, 8);
    for (uint32_t f = 0; f < key->films; f++) {
        to = put(to, films[f].count, 8);
        to = put(to, films[f].identity, 8);
    }
    for (uint32_t f = 0; f < key->films; f++)
        for (size_t i = 0; i < films[f].count; i++) {
            const struct pt_pixel *p = &films[f].pixels[i];
            for (int k = 0; k < PT_PARTS; k++)
                for (int c = 0; c < 3; c++)
                    to = put_double(to, p->sum[k][c]);
            for (int c = 0; c < 4; c++)
                to = put_double(to, p->spread[c]);
            to = put(to, p->count, 4);
        }
    put(to, pell_hash_bytes(0, *data, *size - TRAILER), 8);
    return PELL_OK;
}

static bool read_pixel(const uint8_t **from, struct pt_pixel *p)
{
    bool good = true;
    double *sum = &p->sum[0][0];

    for (int k = 0; k < 9; k++) {
        sum[k] = get_double(from);
        good = good && fabs(sum[k]) <= LARGEST; /* false for what is no number */
    }
    for (int c = 0; c < 4; c++) {
        p->spread[c] = get_double(from);
        good = good && p->spread[c] >= 0.0 && p->spread[c] <= LARGEST * LARGEST;
    }
    p->count = (uint32_t) get(from, 4);
    for (int k = 0; k < 9; k++)
        good = good && (p->count > 0 || sum[k] == 0.0);
    for (int c = 0; c < 4; c++)
        good = good && (p->count > 1 || p->spread[c] == 0.0);
    return good && p->count <= INT32_MAX;
}

/* *from stands behind the magic. */
static enum pell_result check_header(struct pell_context *ctx, const char *path, const uint8_t **from, const struct pt_checkpoint_key *key)
{
    static const char hint[] = "name another file, or remove this one to begin anew";
    const uint32_t version = (uint32_t) get(from, 4), width = (uint32_t) get(from, 4), height = (uint32_t) get(from, 4);
    const uint32_t films = (uint32_t) get(from, 4);
    const uint64_t scene = get(from, 8), run = get(from, 8);

    if (version != VERSION)
        return pell_error(ctx, PELL_ERR_INVALID, path, hint, "is a checkpoint of version %u, this program writes version %d", version,
                          VERSION);
    if (width != key->width || height != key->height || films != key->films)
        return pell_error(ctx, PELL_ERR_INVALID, path, hint, "is of a picture of %u x %u with msaa %u, not of %u x %u with msaa %u", width,
                          height, films, key->width, key->height, key->films);
    if (scene != key->scene)
        return pell_error(ctx, PELL_ERR_INVALID, path, hint, "is of another scene");
    if (run != key->run)
        return pell_error(ctx, PELL_ERR_INVALID, path, hint, "is of other settings, knobs, another seed or another version of the program");
    return PELL_OK;
}

enum pell_result pt_checkpoint_decode(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                      const struct pt_checkpoint_key *key, struct pt_film *films)
{
    static const char hint[] = "remove it to begin anew";
    const uint8_t *from, *end;
    uint64_t pixels = 0;
    enum pell_result res;

    if (key->films < 1 || key->films > FILMS)
        return pell_error(ctx, PELL_ERR_INVALID, path, NULL, "msaa %u, must be in [1, %d]", key->films, FILMS);
    memset(films, 0, key->films * sizeof(*films));
    if (!data || size < HEADER + TRAILER || memcmp(data, magic, sizeof(magic)) != 0)
        return pell_error(ctx, PELL_ERR_FORMAT, path, "name another file", "is no checkpoint of path-trace");
    from = data + sizeof(magic);
    PELL_TRY(check_header(ctx, path, &from, key));
    res = PELL_ERR_FORMAT;
    if ((size - HEADER - TRAILER) / FILM < key->films) {
        pell_error(ctx, res, path, hint, "has %zu bytes, is cut off", size);
        goto fail;
    }
    for (uint32_t f = 0; f < key->films; f++) {
        const uint64_t count = get(&from, 8);
        films[f].identity = get(&from, 8);
        if (count > (uint64_t) key->width * key->height) {
            pell_error(ctx, res, path, hint, "has %llu pixels of a picture of %u x %u", (unsigned long long) count, key->width,
                       key->height);
            goto fail;
        }
        films[f].count = films[f].capacity = (size_t) count;
        pixels += count;
    }
    end = data + size - TRAILER;
    if ((uint64_t) (end - from) != pixels * PIXEL) { /* below 64 x 2^64: width and height are the picture's */
        pell_error(ctx, res, path, hint, "has %zu bytes, must have %llu", size,
                   (unsigned long long) (pixels * PIXEL + (uint64_t) (from - data) + TRAILER));
        goto fail;
    }
    if (pell_hash_bytes(0, data, size - TRAILER) != get(&end, 8)) {
        pell_error(ctx, res, path, hint, "is damaged: its bytes don't have its hash");
        goto fail;
    }
    for (uint32_t f = 0; f < key->films; f++) {
        if (films[f].count == 0)
            continue;
        films[f].pixels = pell_alloc_array(ctx, films[f].count, sizeof(*films[f].pixels));
        if (!films[f].pixels) {
            res = PELL_ERR_NOMEM;
            goto fail;
        }
        for (size_t i = 0; i < films[f].count; i++)
            if (!read_pixel(&from, &films[f].pixels[i])) {
                pell_error(ctx, res, path, hint, "pixel %zu of sample %u has sums that no samples have", i, f);
                goto fail;
            }
    }
    return PELL_OK;

fail:
    for (uint32_t f = 0; f < key->films; f++)
        pell_free(ctx, films[f].pixels);
    memset(films, 0, key->films * sizeof(*films));
    return res;
}
