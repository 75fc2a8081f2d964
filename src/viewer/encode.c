/* SPDX-License-Identifier: MIT
 * encode.c - encodes images for the page: JPEG while it moves, PNG when it is static. */
#include "viewer/encode.h"

#include "image/formats.h"
#include "shared/tone.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

#define STEPS 4096 /* size of the table; a step is below a quarter of one of the 255 except for the darkest few */

static void make_table(uint8_t table[STEPS + 1], bool encoded)
{
    for (int i = 0; i <= STEPS; i++) {
        const float x = (float) i / STEPS;
        table[i] = (uint8_t) (255.0f * (encoded ? x : pell_srgb_encode(x)) + 0.5f);
    }
}

enum pell_result viewer_encode_jpeg(struct pell_context *ctx, const struct viewer_image *p, int quality, uint8_t **bytes, size_t *size)
{
    const size_t width = (size_t) p->width, height = (size_t) p->height;
    uint8_t table[STEPS + 1], *rgb = pell_alloc_array(ctx, width * 3, height);
    tjhandle jpeg = tjInitCompress();
    unsigned char *made = NULL;
    unsigned long length = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    *bytes = NULL;
    *size = 0;
    if (!rgb || !jpeg)
        goto fail;
    make_table(table, p->encoded);
    for (size_t y = 0; y < height; y++)
        for (size_t x = 0; x < width; x++)
            for (int c = 0; c < 3; c++) {
                const float v = p->planes[c][(ptrdiff_t) y * p->stride + (ptrdiff_t) x];
                rgb[3 * (y * width + x) + (size_t) c] = table[(int) (v > 0.0f ? v < 1.0f ? v * STEPS + 0.5f : STEPS : 0.0f)];
            }
    if (tjCompress2(jpeg, rgb, p->width, 0, p->height, TJPF_RGB, &made, &length, quality >= 90 ? TJSAMP_444 : TJSAMP_420, quality,
                    TJFLAG_FASTDCT) != 0) {
        res = pell_error(ctx, PELL_ERR_NOMEM, "viewer", NULL, "JPEG: %s", tjGetErrorStr2(jpeg));
        goto fail;
    }
    if (!(*bytes = malloc(length)))
        goto fail;
    memcpy(*bytes, made, length);
    *size = length;
    res = PELL_OK;

fail:
    tjFree(made);
    if (jpeg)
        tjDestroy(jpeg);
    pell_free(ctx, rgb);
    return res;
}

static enum pell_result take(struct pell_writer *w, enum pell_result res, uint8_t **bytes, size_t *size)
{
    *bytes = NULL;
    *size = 0;
    if (res == PELL_OK && !(*bytes = malloc(w->size + 1)))
        res = pell_error(w->ctx, PELL_ERR_NOMEM, w->name, NULL, "out of memory: %zu bytes", w->size);
    if (res == PELL_OK) {
        memcpy(*bytes, w->data, w->size);
        *size = w->size;
    }
    pell_free(w->ctx, w->data);
    return res;
}

enum pell_result viewer_encode_png(struct pell_context *ctx, const struct viewer_image *p, uint8_t **bytes, size_t *size)
{
    const struct pell_channel channels[3] = {
        { "R", p->planes[0], p->stride, false },
        { "G", p->planes[1], p->stride, false },
        { "B", p->planes[2], p->stride, false },
    };
    const struct pell_write_params params = { .width = p->width, .height = p->height, .channels = channels, .num_channels = 3 };
    struct pell_writer w = { .ctx = ctx, .name = "PNG", .params = &params };

    return take(&w, pell_png_encode(&w), bytes, size);
}

enum pell_result viewer_encode_exr(struct pell_context *ctx, const struct pell_render_result *image, uint8_t **bytes, size_t *size)
{
    const struct pell_write_params params = { .width = image->width,
                                              .height = image->height,
                                              .channels = image->channels,
                                              .num_channels = image->num_channels,
                                              .compression = PELL_EXR_PIZ };
    struct pell_writer w = { .ctx = ctx, .name = "EXR", .params = &params };

    return take(&w, pell_exr_encode(&w), bytes, size);
}

static void show_filmic(float exposure, const float in[3], float *const out[3])
{
    const float e = PELL_FILMIC_SCALE * exposure, r = fmaxf(e * in[0], 0.0f), g = fmaxf(e * in[1], 0.0f), b = fmaxf(e * in[2], 0.0f);
    const float mixed[3] = { PELL_FILMIC_TO_R(r, g, b), PELL_FILMIC_TO_G(r, g, b), PELL_FILMIC_TO_B(r, g, b) };
    float x[3];

    for (int c = 0; c < 3; c++) {
        const float light = fminf(mixed[c], PELL_FILMIC_MOST);
        x[c] = PELL_FILMIC_CURVE(light);
    }
    *out[0] = fminf(fmaxf(PELL_FILMIC_FROM_R(x[0], x[1], x[2]), 0.0f), 1.0f);
    *out[1] = fminf(fmaxf(PELL_FILMIC_FROM_G(x[0], x[1], x[2]), 0.0f), 1.0f);
    *out[2] = fminf(fmaxf(PELL_FILMIC_FROM_B(x[0], x[1], x[2]), 0.0f), 1.0f);
}

void viewer_tone(const struct pell_settings *settings, const float *const in[3], float *const out[3], size_t count)
{
    const float curve = settings->tonemap == PELL_TONEMAP_REINHARD ? 1.0f : 0.0f;
    const float white = curve / (settings->white * settings->white), exposure = settings->exposure * exp2f(settings->stops);

    for (size_t i = 0; i < count; i++) {
        if (settings->tonemap == PELL_TONEMAP_FILMIC) {
            show_filmic(exposure, (const float[]) { in[0][i], in[1][i], in[2][i] },
                        (float *const[]) { &out[0][i], &out[1][i], &out[2][i] });
            continue;
        }
        const float l = fmaxf(exposure * PELL_LUMINANCE(in[0][i], in[1][i], in[2][i]), 0.0f);
        const float scale = PELL_TONE_SCALE(exposure, l, curve, white);
        for (int c = 0; c < 3; c++)
            out[c][i] = fminf(fmaxf(in[c][i] * scale, 0.0f), 1.0f);
    }
}
