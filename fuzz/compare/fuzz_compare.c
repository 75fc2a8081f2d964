/* SPDX-License-Identifier: MIT
 * fuzz_compare.c - two images of arbitrary floats, with halves, variances and masks: no crash, no leak, one message per error and no
 * partial result; each metric is a number within its range, the same for any number of threads. */
#include "base/base.h"

#include <pellucid/compare.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define SIDE 24 /* pixels, at most */
#define PAD 3   /* floats between rows, at most */
#define PLANE (SIDE * (SIDE + PAD))
#define SLACK 1e-5

enum { TEST, REFERENCE, HALF, VARIANCE, PICTURES };

struct bytes {
    const uint8_t *at, *end;
};

#define require(holds) ((holds) ? (void) 0 : fail(#holds, __LINE__))

static void fail(const char *what, int line)
{
    fprintf(stderr, "fuzz_compare.c:%d: not so: %s\n", line, what);
    abort();
}

static unsigned next_byte(struct bytes *in)
{
    return in->at < in->end ? *in->at++ : 0;
}

/* Arbitrary bits, a special value, or a plausible radiance. */
static float value(struct bytes *in)
{
    static const float odd[] = { 0.0f,  -0.0f,    1.0f,      -1.0f, 0.5f,   1e-45f, 1.17549435e-38f, 3.40282347e38f, -3.40282347e38f,
                                 1e15f, INFINITY, -INFINITY, NAN,   1e-20f, 1e20f,  65504.0f };
    const unsigned form = next_byte(in);
    float x;
    uint8_t raw[sizeof(x)];

    if (form < 16)
        return odd[form];
    if (form > 250) {
        for (size_t i = 0; i < sizeof(raw); i++)
            raw[i] = (uint8_t) next_byte(in);
        memcpy(&x, raw, sizeof(x));
        return x;
    }
    if (form > 240)
        return powf(10.0f, ((float) next_byte(in) - 128.0f) / 8.0f);
    return (float) form / 240.0f;
}

/* Repeats the input, so that short inputs fill whole images. */
static void fill(struct bytes *in, float *plane)
{
    const uint8_t *start = in->at;

    for (int i = 0; i < PLANE; i++) {
        if (in->at >= in->end)
            in->at = start;
        plane[i] = value(in);
    }
    in->at = start + (in->end - start) / 2;
}

static float knob(struct bytes *in, float low, float high)
{
    const unsigned form = next_byte(in) % 16;
    if (form == 0)
        return value(in);
    if (form < 3)
        return form == 1 ? low : high;
    return low + (high - low) * (float) next_byte(in) / 255.0f;
}

static void count_errors(void *user, const struct pell_message *message)
{
    if (message->level == PELL_LOG_ERROR) {
        require(message->what[0] && message->where[0]);
        ++*(int *) user;
    }
}

static void check_metrics(const struct pell_metrics *m, int64_t all)
{
    require(m->pixels >= 0 && m->pixels <= all);
    require(isfinite(m->mse) && isfinite(m->mae) && m->mae >= 0.0 && !isnan(m->rel_mse));
    require(!(m->mse_error < 0.0) && !(m->rel_mse_error < 0.0) && !(m->agreement.p < 0.0) && !(m->agreement.p > 1.0));
    require(isfinite(m->noise_mse) && m->noise_mse >= 0.0 && m->noise_rel_mse >= 0.0);
    require(isfinite(m->ssim) && fabs(m->ssim) <= 1.0 + SLACK);
    require(m->flip >= 0.0 && m->flip <= 1.0 + SLACK && m->flip_hdr >= 0.0 && m->flip_hdr <= 1.0 + SLACK);
    for (int c = 0; c < 3; c++) {
        require(isfinite(m->bias[c]) && isfinite(m->rel_bias[c]) && isfinite(m->ssim_rgb[c]) && fabs(m->ssim_rgb[c]) <= 1.0 + SLACK);
        require(fabs(m->bias[c]) <= 3.0 * m->mae * (1.0 + SLACK));
    }
}

static void check_color(float x)
{
    float magma[3], diverging[3];

    pell_color_magma(x, magma);
    pell_color_diverging(x, diverging);
    for (int c = 0; c < 3; c++)
        require(magma[c] >= 0.0f && magma[c] <= 1.0f && diverging[c] >= 0.0f && diverging[c] <= 1.0f);
}

static void check_answer(const struct pell_compare_input *in, const struct pell_comparison *out)
{
    const int64_t all = (int64_t) in->width * in->height;

    check_metrics(&out->whole, all);
    check_metrics(&out->masked, out->whole.pixels);
    require(out->bad_test >= 0 && out->bad_test <= all && out->bad_reference >= 0 && out->bad_reference <= all);
    require(out->whole.pixels >= all - out->bad_test - out->bad_reference);
    require(isfinite(out->exposure) && out->exposure >= 0.0f && isfinite(out->white) && out->white >= 0.0f);
    require(isfinite(out->hdr_start) && isfinite(out->hdr_stop) && out->hdr_exposures >= 0);
    require(out->width == in->width && out->height == in->height);
    for (int64_t i = 0; i < all; i++) {
        require(isfinite(out->relative[i]) && fabsf(out->ssim[i]) <= 1.0f + (float) SLACK);
        require(out->flip[i] >= 0.0f && out->flip[i] <= 1.0f + (float) SLACK);
        require(out->flip_hdr[i] >= 0.0f && out->flip_hdr[i] <= 1.0f + (float) SLACK);
    }
    check_color(out->relative[0]);
    check_color(in->test[0][0]);
}

static bool same(const struct pell_comparison *a, const struct pell_comparison *b)
{
    const size_t bytes = (size_t) a->width * (size_t) a->height * sizeof(float);

    return memcmp(&a->masked, &b->masked, sizeof(a->masked)) == 0 && memcmp(&a->whole, &b->whole, sizeof(a->whole)) == 0 &&
           memcmp(a->relative, b->relative, bytes) == 0 && memcmp(a->ssim, b->ssim, bytes) == 0 && memcmp(a->flip, b->flip, bytes) == 0 &&
           memcmp(a->flip_hdr, b->flip_hdr, bytes) == 0;
}

static void compare(struct pell_context *ctx, int *errors, const struct pell_compare_input *in, struct pell_compare_params *params,
                    bool again)
{
    struct pell_comparison out, other;
    enum pell_result res;

    memset(&out, 0xa5, sizeof(out));
    *errors = 0;
    res = pell_compare(ctx, in, params, &out);
    require((res == PELL_OK) == (*errors == 0) && *errors <= 1);
    if (res == PELL_OK)
        check_answer(in, &out);
    else
        require(!out.relative && !out.ssim && !out.flip && !out.flip_hdr && out.width == 0 && out.whole.mse == 0.0);
    if (res == PELL_OK && again) {
        params->threads = 3;
        require(pell_compare(ctx, in, params, &other) == PELL_OK && same(&out, &other));
        pell_comparison_finish(ctx, &other);
    }
    pell_comparison_finish(ctx, &out);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static float plane[PICTURES][3][PLANE], mask[PLANE];
    struct bytes in = { data, data + size };
    struct pell_limits limits;
    int errors = 0;
    struct pell_context_params context = { .log = count_errors, .log_user = &errors, .limits = &limits };
    struct pell_compare_input input = { 0 };
    struct pell_compare_params params;
    struct pell_context *ctx;
    const unsigned flags = next_byte(&in), more = next_byte(&in);

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.image_pixels = SIDE * SIDE;
    limits.memory_bytes = 64 << 20;
    pell_knobs_default(pell_compare_knobs(), &params);
    params.threads = 1;
    params.ppd = 8.0f;                   /* the default filter is wider than the image */
    params.exposures = more & 8 ? 0 : 2; /* 0: as many as the range of the reference requires, which is slow */
    if (flags & 1) {
        params.ppd = knob(&in, 1.0f, 70.0f);
        params.exposure = knob(&in, 0.0f, 8.0f);
        params.white = knob(&in, 0.0f, 8.0f);
        params.floor = knob(&in, 1e-6f, 1.0f);
        params.tonemap = (int) (next_byte(&in) % 5) - 1;
        params.exposures = (int) (next_byte(&in) % 8) - 1;
    }
    input.width = 1 + (int) (next_byte(&in) % SIDE);
    input.height = 1 + (int) (next_byte(&in) % SIDE);
    input.stride = input.width + (int) (more % (PAD + 1));
    if (more & 64) { /* sizes that are refused before any plane is read */
        static const int sizes[] = { 0, -1, SIDE * SIDE + 1, 65536, 2147483647, -2147483647 - 1 };
        input.width = sizes[next_byte(&in) % 6];
        input.height = more & 128 ? sizes[next_byte(&in) % 6] : 65536;
        input.stride = input.width;
    }
    input.display = flags & 2;
    for (int k = 0; k < PICTURES; k++)
        for (int c = 0; c < 3; c++)
            if (k < HALF || flags & (k == HALF ? 4u : 8u))
                fill(&in, plane[k][c]);
    for (int c = 0; c < 3; c++) {
        input.test[c] = plane[TEST][flags & 16 ? 0 : c]; /* one plane may serve all three */
        input.reference[c] = flags & 32 ? input.test[c] : plane[REFERENCE][c];
        input.half[c] = flags & 4 ? plane[HALF][c] : NULL;
        input.variance[c] = flags & 8 ? plane[VARIANCE][c] : NULL;
    }
    if (flags & 64) {
        fill(&in, mask);
        input.mask = mask;
    }
    if (pell_context_create(&context, &ctx) != PELL_OK)
        return 0;
    compare(ctx, &errors, &input, &params, more & 16);
    require(pell_memory_used(ctx) == 0);
    pell_context_destroy(&ctx);
    return 0;
}
