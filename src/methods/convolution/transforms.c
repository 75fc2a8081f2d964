/* SPDX-License-Identifier: MIT
 *
 * transforms.c - transforms of the planes' images and their product with the kernels: rows of a band, then all images in each block of
 * columns including the inverse, then rows of a band back.
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

float *convolution_band_images(const struct convolution_state *st, int worker)
{
    const struct conv_layout *lay = &st->job.layout;

    return st->scratch[worker] + 2 * pell_fft_buffer(lay->across > lay->down ? lay->across : lay->down);
}

static int num_rows(const struct conv_job *j, int band)
{
    return j->layout.height - band * CONV_BAND < CONV_BAND ? j->layout.height - band * CONV_BAND : CONV_BAND;
}

/* Rows of a band of the images list[0] and, if `count` is 2, list[1]; images of a band are `size` floats apart. */
static struct pell_fft_rows rows_of(const struct convolution_state *st, int band, const int *list, int count, float *images, size_t size)
{
    const struct conv_job *j = &st->job;
    struct pell_fft_rows r = { .stride = j->stride, .block = j->block, .width = j->layout.width, .rows = num_rows(j, band) };

    for (int i = 0; i < 2 && i < count; i++) {
        r.image[i] = images + (size_t) list[i] * size;
        r.half[i] = conv_half(st, list[i]) + E * band * CONV_BAND;
    }
    return r;
}

void convolution_transform_rows(struct convolution_state *st, int band, int worker, float *images)
{
    const struct conv_job *j = &st->job;
    const int num = j->layout.planes + j->between + j->behind;
    const size_t size = (size_t) CONV_BAND * (size_t) j->stride;
    float *buffer[2];
    int list[CONV_IMAGES + 1], count = 0;
    bool which[CONV_IMAGES];

    buffers_of(st, worker, buffer);
    for (int i = 0; i < num; i++)
        if ((which[i] = st->occupied[band * st->format.num_images + i]))
            list[count++] = i;
    convolution_show_band(st, band, false, which, images, size);
    for (int i = 0; i < count; i += 2) {
        const struct pell_fft_rows rows = rows_of(st, band, &list[i], count - i, images, size);
        pell_fft_rows(&j->across, &rows, buffer);
    }
}

void convolution_transform_back(struct convolution_state *st, int band, int worker, const bool *which, float *images, size_t size)
{
    const struct conv_job *j = &st->job;
    const int num = j->layout.planes + j->between;
    float *buffer[2];
    int list[CONV_IMAGES + 1], count = 0;

    buffers_of(st, worker, buffer);
    for (int i = 0; i < num; i++)
        if (which[i])
            list[count++] = i;
    for (int i = 0; i < count; i += 2) {
        const struct pell_fft_rows rows = rows_of(st, band, &list[i], count - i, images, size);
        pell_fft_rows_back(&j->across, &rows, buffer);
    }
    convolution_show_band(st, band, true, which, images, size);
}

/* All images of a block of columns: forward transform, product with the kernels, inverse transform. */
static void columns_block(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const int down = j->layout.down, height = j->layout.height;
    const size_t size = (size_t) height * E * sizeof(float), rest = (size_t) (down - height) * E * sizeof(float);
    struct conv_mix mix = j->mix;
    float *spare = st->scratch[worker];
    const bool odd = j->down.num_stages % 2 != 0; /* transforms alternate between two buffers, once per stage */

    if (pell_cancelled(st->ctx))
        return;
    for (int i = 0; i < mix.planes + mix.between + mix.behind; i++) {
        float *data = st->scratch[worker] + (size_t) (i + 1) * pell_fft_buffer(down), *const in = odd ? spare : data, *result;
        mix.column[i] = NULL;
        if ((!j->lit[i] && !j->seen[i]) || (i >= mix.planes + mix.between && index >= j->behind_blocks))
            continue;
        if (!j->lit[i]) {
            memset(data, 0, size + rest);
            mix.column[i] = data;
            continue;
        }
        for (int band = 0; band < j->bands; band++) { /* bands without light have no spectrum */
            const ptrdiff_t at = (ptrdiff_t) band * CONV_BAND * E;
            const size_t bytes = (size_t) num_rows(j, band) * E * sizeof(float);
            if (st->occupied[band * st->format.num_images + i])
                memcpy(in + at, conv_half(st, i) + index * j->block + at, bytes);
            else
                memset(in + at, 0, bytes);
        }
        memset(in + (ptrdiff_t) height * E, 0, rest);
        result = pell_fft_run(&j->down, false, in, odd ? data : spare);
        if (result != data)
            memcpy(data, result, size + rest);
        mix.column[i] = data;
    }
    st->kernels->mix(&mix, index);
    for (int i = 0; i < mix.planes + mix.between + mix.behind; i++)
        if (j->seen[i])
            memcpy(conv_half(st, i) + index * j->block, pell_fft_run(&j->down, true, mix.column[i], spare), size);
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

void convolution_transform_columns(struct convolution_state *st)
{
    set_mix(st);
    pell_pool_run(st->pool, st->job.column_blocks, columns_block, st);
}
