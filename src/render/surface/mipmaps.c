/* SPDX-License-Identifier: MIT
 * mipmaps.c - textures at smaller sizes (Williams 1983, "Pyramidal Parametrics"), made once per scene.
 *
 * A 4k map on a head that fills a third of 720p has some ten texels per pixel: one bilinear look-up per pixel would alias, and its texels
 * come from memory one cache line each. The surface stage knows a pixel's area on the surface exactly (see hits16.h), so a pyramid
 * with the right level is both the cheapest and the best filter of its price; anisotropy is left to multisampling. */
#include "render/surface/mipmaps.h"

#include <stdlib.h>
#include <string.h>

void surface_decode_make(struct surface_decode *decode)
{
    for (int i = 0; i < 256; i++) {
        decode->srgb[i] = (uint16_t) (pell_srgb_u8[i] * 65535.0f + 0.5f);
        decode->linear[i] = (uint16_t) (i * 257);
    }
}

static inline uint64_t pack(uint16_t r, uint16_t g, uint16_t b, uint16_t a)
{
    return (uint64_t) r | (uint64_t) g << 16 | (uint64_t) b << 32 | (uint64_t) a << 48;
}

/* --- Halving ------------------------------------------------------------------------------------------------------------------ */

/* Output texel i of n covers source texels 2i, 2i + 1 of 2n; of 2n + 1 it covers parts of three, 2i to 2i + 2. Out of 2^16. */
struct taps {
    int count;
    uint32_t weight[3];
};

static struct taps taps_of(int i, int size)
{
    const int n = size / 2;
    const uint64_t one = 65536;
    struct taps t = { 3, { 0 } };

    if (size == 1)
        return (struct taps) { 1, { 65536 } };
    if (size % 2 == 0)
        return (struct taps) { 2, { 32768, 32768 } };
    t.weight[0] = (uint32_t) (one * (uint64_t) (n - i) / (uint64_t) size);
    t.weight[2] = (uint32_t) (one * (uint64_t) (i + 1) / (uint64_t) size);
    t.weight[1] = (uint32_t) one - t.weight[0] - t.weight[2];
    return t;
}

#define ROWS_PER_TASK 16

struct halving {
    struct pyramid *pyramid;
    const struct surface_decode *decode;
    int to; /* level to make */
};

static inline uint64_t source_texel(const struct halving *h, int x, int y)
{
    const int from = h->to - 1;
    const size_t at = (size_t) y * (size_t) h->pyramid->width[from] + (size_t) x;

    return from > 0 ? h->pyramid->texels[from][at] : surface_texel(&h->pyramid->image, h->decode, at);
}

/* Mean of four texels, field by field: sums of four 16 bit numbers fit if every other field is masked out. */
static inline uint64_t mean4(uint64_t a, uint64_t b, uint64_t c, uint64_t d)
{
    const uint64_t even_fields = 0x0000ffff0000ffffull, rounding = 0x0000000200000002ull;
    const uint64_t low = (a & even_fields) + (b & even_fields) + (c & even_fields) + (d & even_fields) + rounding;
    const uint64_t high = (a >> 16 & even_fields) + (b >> 16 & even_fields) + (c >> 16 & even_fields) + (d >> 16 & even_fields) + rounding;

    return (low >> 2 & even_fields) | (high >> 2 & even_fields) << 16;
}

/* Colours with straight alpha are weighted by it, so that what is transparent does not bleed. */
static void halve_row(const struct halving *h, int y)
{
    const struct pyramid *p = h->pyramid;
    const int from = h->to - 1, w = p->width[from], out_w = p->width[h->to];
    const bool weighted = p->image.srgb && (p->image.channels == 2 || p->image.channels == 4);
    const struct taps ty = taps_of(y, p->height[from]);
    uint64_t *out = p->texels[h->to] + (size_t) y * (size_t) out_w;

    if (!weighted && w % 2 == 0 && p->height[from] % 2 == 0) {
        for (int x = 0; x < out_w; x++)
            out[x] = mean4(source_texel(h, 2 * x, 2 * y), source_texel(h, 2 * x + 1, 2 * y), source_texel(h, 2 * x, 2 * y + 1),
                           source_texel(h, 2 * x + 1, 2 * y + 1));
        return;
    }
    for (int x = 0; x < out_w; x++) {
        const struct taps tx = taps_of(x, w);
        uint64_t sum[4] = { 0 }, alpha = 0; /* a weight is 2^32 at most, so is their sum; times 2^16 */
        for (int j = 0; j < ty.count; j++)
            for (int i = 0; i < tx.count; i++) {
                const uint64_t texel = source_texel(h, 2 * x + i, 2 * y + j), weight = (uint64_t) ty.weight[j] * tx.weight[i];
                const uint64_t a = texel >> 48, k = weighted ? (weight * a) >> 16 : weight;
                sum[0] += k * (texel & 0xffff);
                sum[1] += k * ((texel >> 16) & 0xffff);
                sum[2] += k * ((texel >> 32) & 0xffff);
                sum[3] += weight * a;
                alpha += k;
            }
        if (weighted && alpha == 0)
            out[x] = source_texel(h, 2 * x, 2 * y) & 0xffffffffffffull;
        else
            out[x] = pack((uint16_t) ((sum[0] + alpha / 2) / alpha), (uint16_t) ((sum[1] + alpha / 2) / alpha),
                          (uint16_t) ((sum[2] + alpha / 2) / alpha), (uint16_t) ((sum[3] + (1ull << 31)) >> 32));
    }
}

static void halve_float_row(const struct halving *h, int y)
{
    const struct pyramid *p = h->pyramid;
    const struct pell_image *from = h->to > 1 ? &p->floats[h->to - 1] : &p->image, *to = &p->floats[h->to];
    const int n = from->channels;
    const struct taps ty = taps_of(y, from->height);

    for (int x = 0; x < to->width; x++) {
        const struct taps tx = taps_of(x, from->width);
        float *out = (float *) to->pixels + ((size_t) y * (size_t) to->width + (size_t) x) * (size_t) n;
        for (int c = 0; c < n; c++)
            out[c] = 0.0f;
        for (int j = 0; j < ty.count; j++)
            for (int i = 0; i < tx.count; i++) {
                const float *texel =
                    (const float *) from->pixels + ((size_t) (2 * y + j) * (size_t) from->width + (size_t) (2 * x + i)) * (size_t) n;
                for (int c = 0; c < n; c++)
                    out[c] += (float) ty.weight[j] * (float) tx.weight[i] * (1.0f / 4294967296.0f) * texel[c];
            }
    }
}

static void halve_task(void *arg, int index, int worker)
{
    const struct halving *h = arg;
    const int end = (index + 1) * ROWS_PER_TASK, height = h->pyramid->height[h->to];

    (void) worker;
    for (int y = index * ROWS_PER_TASK; y < end && y < height; y++) {
        if (h->pyramid->texels[h->to])
            halve_row(h, y);
        else
            halve_float_row(h, y);
    }
}

static enum pell_result build(struct pell_mips *mips, struct pyramid *p, const struct surface_decode *decode, struct pell_pool *pool)
{
    while (p->width[p->levels - 1] > 1 || p->height[p->levels - 1] > 1) {
        const int l = p->levels, w = p->width[l - 1] > 1 ? p->width[l - 1] / 2 : 1, h = p->height[l - 1] > 1 ? p->height[l - 1] / 2 : 1;
        const size_t count = (size_t) w * (size_t) h;
        void *memory;
        struct halving job = { p, decode, l };

        p->width[l] = w;
        p->height[l] = h;
        if (p->image.type == PELL_PIXEL_F32) {
            memory = pell_alloc_array(mips->ctx, count, (size_t) p->image.channels * sizeof(float));
            p->floats[l] = (struct pell_image) { w, h, p->image.channels, PELL_PIXEL_F32, false, memory };
        } else {
            memory = p->texels[l] = pell_alloc_array(mips->ctx, count, sizeof(uint64_t));
        }
        if (!memory)
            return PELL_ERR_NOMEM;
        p->levels++;
        pell_pool_run(pool, (h + ROWS_PER_TASK - 1) / ROWS_PER_TASK, halve_task, &job);
        if (pell_cancelled(mips->ctx))
            return PELL_ERR_CANCELLED;
    }
    return PELL_OK;
}

/* --- One pyramid per image ----------------------------------------------------------------------------------------------------- */

static int by_pixels(const void *a, const void *b)
{
    const struct pyramid *p = a, *q = b;
    const uintptr_t x = (uintptr_t) p->image.pixels, y = (uintptr_t) q->image.pixels;

    return x < y ? -1 : x > y;
}

/* Images that some material reads with a filter, each once: textures that differ in their sampler level0 share pixels. */
static enum pell_result collect(struct pell_mips *mips, const struct pell_scene *scene)
{
    size_t count = 0, kept = 0;

    for (size_t i = 0; i < scene->num_materials; i++)
        for (enum pell_map map = 0; map < PELL_MAPS; map++) {
            const struct pell_texture *t = pell_material_map(&scene->materials[i], map)->texture;
            count += t && !t->nearest;
        }
    mips->slots = pell_calloc(mips->ctx, scene->num_materials * PELL_MAPS, sizeof(*mips->slots));
    mips->pyramids = pell_calloc(mips->ctx, count, sizeof(*mips->pyramids));
    if (!mips->slots || !mips->pyramids)
        return PELL_ERR_NOMEM;

    count = 0;
    for (size_t i = 0; i < scene->num_materials; i++)
        for (enum pell_map map = 0; map < PELL_MAPS; map++) {
            const struct pell_texture *t = pell_material_map(&scene->materials[i], map)->texture;
            if (t && !t->nearest)
                mips->pyramids[count++] = pyramid_of(&t->image);
        }
    qsort(mips->pyramids, count, sizeof(*mips->pyramids), by_pixels);
    for (size_t i = 0; i < count; i++)
        if (i == 0 || mips->pyramids[i].image.pixels != mips->pyramids[kept - 1].image.pixels)
            mips->pyramids[kept++] = mips->pyramids[i];
    mips->num_pyramids = kept;

    for (size_t i = 0; i < scene->num_materials; i++)
        for (enum pell_map map = 0; map < PELL_MAPS; map++) {
            const struct pell_texture *t = pell_material_map(&scene->materials[i], map)->texture;
            if (t && !t->nearest) {
                const struct pyramid key = { .image = t->image };
                mips->slots[i * PELL_MAPS + (size_t) map] = bsearch(&key, mips->pyramids, kept, sizeof(key), by_pixels);
            }
        }
    return PELL_OK;
}

enum pell_result pell_mips_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_pool *pool, struct pell_mips **out)
{
    struct pell_mips *mips = pell_zalloc(ctx, sizeof(*mips));
    struct surface_decode decode;
    enum pell_result res;

    *out = NULL;
    if (!mips)
        return PELL_ERR_NOMEM;
    mips->ctx = ctx;
    mips->any_thin = pell_scene_has_sheets(scene);
    surface_decode_make(&decode);
    PELL_TRY(collect(mips, scene));
    for (size_t i = 0; i < mips->num_pyramids; i++)
        PELL_TRY(build(mips, &mips->pyramids[i], &decode, pool));
    *out = mips;
    return PELL_OK;

fail:
    pell_mips_destroy(&mips);
    return res;
}

/* --- For a device ------------------------------------------------------------------------------------------------------------------ */

static uint32_t rgba8(const struct pell_image *image, size_t at)
{
    const int n = image->channels;
    const uint8_t *p = (const uint8_t *) image->pixels + at * (size_t) n;
    const uint32_t r = p[0], g = n >= 3 ? p[1] : r, b = n >= 3 ? p[2] : r, a = n == 2 || n == 4 ? p[n - 1] : 255;

    return r | g << 8 | b << 16 | a << 24;
}

enum { KIND_BYTES = 1, KIND_SRGB = 2, KIND_FLOATS = 4, KIND_SMALLER_FLOATS = 8 };

/* Writes a texel of a level; returns its number of words. */
static size_t put_texel(const struct pyramid *p, const struct surface_decode *decode, uint32_t kind, int level, size_t i, uint32_t *out)
{
    const bool bytes = level == 0 && (kind & KIND_BYTES), floats = kind & (level == 0 ? KIND_FLOATS : KIND_SMALLER_FLOATS);
    const struct pell_image *image = level == 0 ? &p->image : &p->floats[level];
    uint64_t texel;

    if (floats) {
        float rgba[4];
        if (out)
            pell_image_texel(image, (int) (i % (size_t) image->width), (int) (i / (size_t) image->width), rgba);
        if (out)
            memcpy(out, rgba, sizeof(rgba));
        return 4;
    }
    if (!out)
        return bytes ? 1 : 2;
    texel = level > 0 ? p->texels[level][i] : bytes ? rgba8(&p->image, i) : surface_texel(&p->image, decode, i);
    out[0] = (uint32_t) texel;
    if (!bytes)
        out[1] = (uint32_t) (texel >> 32);
    return bytes ? 1 : 2;
}

/* Writes an image from word `first` on; returns the word after it. `unfiltered`: texels are written as floats, not with 16 bits. */
static size_t put_image(const struct pyramid *p, const struct surface_decode *decode, bool unfiltered, size_t first, uint32_t *out)
{
    const bool floats = p->image.type == PELL_PIXEL_F32;
    const uint32_t kind = floats ? KIND_FLOATS | KIND_SMALLER_FLOATS
                                 : (unfiltered                       ? KIND_FLOATS
                                    : p->image.type == PELL_PIXEL_U8 ? KIND_BYTES
                                                                     : 0u) |
                                       (p->image.srgb ? KIND_SRGB : 0u);
    size_t at = first + 4 + 3 * (size_t) p->levels;

    if (out)
        memcpy(out + first, (uint32_t[]) { (uint32_t) p->levels, (uint32_t) p->image.width, (uint32_t) p->image.height, kind },
               4 * sizeof(*out));
    for (int l = 0; l < p->levels; l++) {
        const size_t count = (size_t) p->width[l] * (size_t) p->height[l], words = put_texel(p, decode, kind, l, 0, NULL);
        if (out)
            memcpy(out + first + 4 + 3 * l, (uint32_t[]) { (uint32_t) at, (uint32_t) p->width[l], (uint32_t) p->height[l] },
                   3 * sizeof(*out));
        for (size_t i = 0; out && i < count; i++)
            put_texel(p, decode, kind, l, i, out + at + words * i);
        at += words * count;
    }
    return at;
}

static const struct pell_texture *texture_of(const struct pell_scene *scene, size_t map)
{
    return pell_material_map(&scene->materials[map / PELL_MAPS], (enum pell_map)(map % PELL_MAPS))->texture;
}

static bool is_same_unfiltered(const struct pell_texture *a, const struct pell_texture *b)
{
    return b && b->nearest && a->image.pixels == b->image.pixels;
}

size_t pell_mips_words(const struct pell_mips *mips, const struct pell_scene *scene, uint32_t *out)
{
    const size_t maps = scene->num_materials * PELL_MAPS;
    size_t at = PELL_MIPS_HEAD + maps * PELL_MIPS_MAP;
    struct surface_decode decode;

    surface_decode_make(&decode);
    for (int i = 0; out && i < 256; i++) {
        out[i] = decode.srgb[i];
        out[256 + i] = decode.linear[i];
    }
    for (size_t i = 0; out && i < maps; i++) {
        const struct pell_texture_map *map = pell_material_map(&scene->materials[i / PELL_MAPS], (enum pell_map)(i % PELL_MAPS));
        uint32_t *row = out + PELL_MIPS_HEAD + i * PELL_MIPS_MAP;
        row[0] = PELL_MIPS_NONE;
        row[1] = 0;
        if (map->texture)
            row[1] = (uint32_t) map->uv | (uint32_t) (map->channel & 3) << 8 | (uint32_t) map->texture->nearest << 10 |
                     (uint32_t) map->texture->wrap_u << 16 | (uint32_t) map->texture->wrap_v << 24;
        memcpy(row + 2, map->matrix, 6 * sizeof(*row));
    }
    for (size_t k = 0; k < mips->num_pyramids; k++) {
        for (size_t i = 0; out && i < maps; i++)
            if (mips->slots[i] == &mips->pyramids[k])
                out[PELL_MIPS_HEAD + i * PELL_MIPS_MAP] = (uint32_t) at;
        at = put_image(&mips->pyramids[k], &decode, false, at, out);
    }
    for (size_t i = 0; i < maps; i++) {
        const struct pell_texture *t = texture_of(scene, i);
        size_t first = 0;
        if (!t || !t->nearest)
            continue;
        while (first < i && !is_same_unfiltered(t, texture_of(scene, first)))
            first++;
        if (out)
            out[PELL_MIPS_HEAD + i * PELL_MIPS_MAP] = first < i ? out[PELL_MIPS_HEAD + first * PELL_MIPS_MAP] : (uint32_t) at;
        if (first == i) {
            const struct pyramid level0 = pyramid_of(&t->image);
            at = put_image(&level0, &decode, true, at, out);
        }
    }
    return at;
}

void pell_mips_destroy(struct pell_mips **mips)
{
    struct pell_mips *m = *mips;

    if (!m)
        return;
    *mips = NULL;
    for (size_t i = 0; m->pyramids && i < m->num_pyramids; i++)
        for (int l = 1; l < SURFACE_MIP_LEVELS; l++) {
            pell_free(m->ctx, m->pyramids[i].texels[l]);
            pell_free(m->ctx, m->pyramids[i].floats[l].pixels);
        }
    pell_free(m->ctx, m->pyramids);
    pell_free(m->ctx, m->slots);
    pell_free(m->ctx, m);
}
