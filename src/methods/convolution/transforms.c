/* SPDX-License-Identifier: MIT
 *
 * transforms.c - images of planes through the kernels: rows, then for each block of columns of all images there, kernels and back, then
 * rows back.
 */
#include "methods/convolution/state.h"

#include "base/pool.h"

#include <string.h>

enum { E = PELL_FFT_ELEMENT };

static void buffers_of(const struct convolution_state *st, int worker, float *buffer[2])
{
    const struct conv_layout *lay = &st->job.layout;

    buffer[0] = st->scratch[worker];
    buffer[1] = buffer[0] + pell_fft_buffer(lay->across > lay->down ? lay->across : lay->down);
}

/* Two images of a list: a band each. */
static void rows_band(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const int pair = index / j->bands, band = index % j->bands, y = band * CONV_BAND;
    const int rows = j->layout.height - y < CONV_BAND ? j->layout.height - y : CONV_BAND;
    const int a = j->list[2 * pair], b = 2 * pair + 1 < j->count ? j->list[2 * pair + 1] : -1;
    const bool any = st->occupied[band * st->num_images + a] || (b >= 0 && st->occupied[band * st->num_images + b]);
    float *buffer[2];

    buffers_of(st, worker, buffer);
    if (any) {
        pell_fft_rows(&j->across, conv_image(st, a) + y * j->stride, b >= 0 ? conv_image(st, b) + y * j->stride : NULL, j->stride,
                      j->layout.width, rows, conv_half(st, a) + E * y, b >= 0 ? conv_half(st, b) + E * y : NULL, j->block, buffer);
        return;
    }
    for (int i = 0; i < 2; i++)
        for (int at = 0; at < j->column_blocks && (i == 0 || b >= 0); at++)
            memset(conv_half(st, i ? b : a) + at * j->block + E * y, 0, (size_t) rows * E * sizeof(float));
}

static void back_band(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const int pair = index / j->bands, band = index % j->bands, y = band * CONV_BAND;
    const int rows = j->layout.height - y < CONV_BAND ? j->layout.height - y : CONV_BAND;
    const int a = j->list[2 * pair], b = 2 * pair + 1 < j->count ? j->list[2 * pair + 1] : -1;
    float *buffer[2];

    buffers_of(st, worker, buffer);
    pell_fft_rows_back(&j->across, conv_half(st, a) + E * y, b >= 0 ? conv_half(st, b) + E * y : NULL, j->block,
                       conv_image(st, a) + y * j->stride, b >= 0 ? conv_image(st, b) + y * j->stride : NULL, j->stride, j->layout.width,
                       rows, buffer);
}

/* All images of a block of columns: there, through the kernels, and back. */
static void columns_block(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const int down = j->layout.down, height = j->layout.height;
    const size_t size = (size_t) height * E * sizeof(float), rest = (size_t) (down - height) * E * sizeof(float);
    struct conv_mix mix = j->mix;
    float *spare = st->scratch[worker];

    if (pell_cancelled(st->ctx))
        return;
    for (int i = 0; i < mix.planes + mix.between + mix.behind; i++) {
        float *data = st->scratch[worker] + (size_t) (i + 1) * pell_fft_buffer(down), *there;
        mix.column[i] = NULL;
        if ((!j->lit[i] && !j->seen[i]) || (i >= mix.planes + mix.between && index >= j->behind_blocks))
            continue;
        if (!j->lit[i]) {
            memset(data, 0, size + rest);
            mix.column[i] = data;
            continue;
        }
        memcpy(data, conv_half(st, i) + index * j->block, size);
        memset(data + (ptrdiff_t) height * E, 0, rest);
        there = pell_fft_run(&j->down, false, data, spare);
        if (there != data)
            memcpy(data, there, size + rest);
        mix.column[i] = data;
    }
    st->kernels->mix(&mix, index);
    for (int i = 0; i < mix.planes + mix.between + mix.behind; i++)
        if (j->seen[i])
            memcpy(conv_half(st, i) + index * j->block, pell_fft_run(&j->down, true, mix.column[i], spare), size);
}

static void list_images(struct conv_job *j, const bool *which)
{
    j->count = 0;
    for (int i = 0; i < j->layout.planes + j->between + j->behind; i++)
        if (which[i])
            j->list[j->count++] = i;
}

static void set_mix(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const int c = j->channel, n = j->layout.planes;

    memset(&j->mix, 0, sizeof(j->mix));
    j->mix.height = j->layout.down;
    j->mix.planes = n;
    j->mix.between = j->between;
    j->mix.behind = j->behind;
    for (int i = 0; i < j->behind; i++)
        j->mix.behind_own[i] = j->set->behind[c][i].data ? &j->set->behind[c][i] : NULL;
    j->behind_blocks = 0;
    for (int i = 0; i < j->behind; i++)
        j->behind_blocks = j->set->behind[c][i].blocks > j->behind_blocks ? j->set->behind[c][i].blocks : j->behind_blocks;
    for (int i = 0; i < j->set->num_pairs; i++)
        if (j->set->pairs[c][i].spectrum && j->set->pairs[c][i].spectrum->blocks > j->behind_blocks)
            j->behind_blocks = j->set->pairs[c][i].spectrum->blocks;
    j->mix.pairs = j->set->pairs[c];
    j->mix.num_pairs = j->set->num_pairs;
    for (int i = 0; i < n; i++)
        j->mix.own[i] = &j->set->own[c][j->set->num_own > 1 ? i : 0];
    for (int i = 0, at = 0; i < n; i++)
        for (int to = i + 1; to < n; to++, at++)
            if (to == i + 1) {
                j->mix.next[i] = j->set->pairs[c][at].spectrum;
                j->mix.next_factor[i] = j->set->pairs[c][at].factor;
            }
}

void convolution_transform_rows(struct convolution_state *st)
{
    struct conv_job *j = &st->job;

    list_images(j, j->lit);
    pell_pool_run(st->pool, j->bands * ((j->count + 1) / 2), rows_band, st);
}

void convolution_transform_columns(struct convolution_state *st)
{
    set_mix(st);
    pell_pool_run(st->pool, st->job.column_blocks, columns_block, st);
}

void convolution_transform_back(struct convolution_state *st)
{
    struct conv_job *j = &st->job;

    list_images(j, j->seen);
    pell_pool_run(st->pool, j->bands * ((j->count + 1) / 2), back_band, st);
}
