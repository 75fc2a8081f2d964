/* SPDX-License-Identifier: MIT
 *
 * spectra.c - spectra of the kernels between planes. A kernel is even in both axes, so a quadrant describes it and its transform is real:
 * two rows, or two blocks of columns, share one complex transform.
 *
 * Kernels to other planes are smooth on the scale of the distance h: from h of 8 pixels on they are sampled at every second pixel, from 16
 * at every fourth, from 32 at every eighth, and their spectrum is truncated accordingly, with an error below exp(-4 pi).
 */
#include "methods/convolution/convolution.h"

#include "base/pool.h"
#include "math/vec.h"

#include <string.h>

enum { NEAR = 7 }; /* pixels from the centre that are integrated over their squares */

/* --- Sizes --------------------------------------------------------------------------------------------------------------------------- */

/* Number of floats of a complete spectrum. */
static size_t whole(int across, int down)
{
    return ((size_t) across / 32 + 1) * ((size_t) down / 2 + 1) * PELL_FFT_LANES;
}

size_t convolution_spectra_size(const struct convolution_knobs *k, int step, bool orthographic, int width, int height)
{
    const int across = pell_fft_good(2 * width, CONV_MULTIPLE), down = pell_fft_good(2 * height, CONV_MULTIPLE);
    const size_t full = whole(across, down), n = (size_t) convolution_planes(k, step), own = orthographic ? 1 : n;
    const size_t half = ((size_t) across / 64 + 2) * ((size_t) down / 4 + 2) * PELL_FFT_LANES; /* of planes at least 8 pixels apart */
    const size_t pairs = k->placement == CONV_SURFACE ? full + n * (n - 1) / 2 * half : full * (n - 1);

    return 3 * (full * (own + (k->surfaces > 1 && k->apart ? n : 0)) + pairs) + 64;
}

/* Number of floats of a quadrant of a kernel. */
static size_t quarter_size(int across, int down)
{
    return (size_t) (conv_round_up(across / 2 + 1, PELL_FFT_LANES) + 2 * PELL_FFT_LANES) *
           (size_t) conv_round_up(down / 2 + 1, 2 * PELL_FFT_LANES);
}

/* A quadrant of a kernel, two buffers and two tables of transforms. */
size_t convolution_spectra_scratch(int width, int height)
{
    const int across = pell_fft_good(2 * width, CONV_MULTIPLE), down = pell_fft_good(2 * height, CONV_MULTIPLE);

    return quarter_size(across, down) + 2 * pell_fft_buffer(across > down ? across : down) + 3 * ((size_t) across + (size_t) down) + 4096;
}

/* --- One kernel ---------------------------------------------------------------------------------------------------------------------- */

struct kernel {
    const struct conv_radial *radial;
    float distance2; /* mm^2, between the planes */
    float pixel;     /* mm */
    float scale;     /* converts R to units of pixels */
    int step;        /* pixels per sample */
    bool own;        /* of a plane on itself */
    struct conv_spectrum *to;
};

struct maker {
    const struct conv_layout *layout;
    struct kernel list[3 * (2 * CONV_PLANES + CONV_PLANES * (CONV_PLANES - 1) / 2)];
    int count;
    const struct conv_kernels *kernels;
    float *const *scratch;
    float *memory;
};

/* PELL_FFT_ELEMENT samples of a kernel from (x, y) down; 0 beyond its cutoff. `near`: on the same plane, integrals over the nearest
 * pixels. */
static void sample_column(const struct maker *m, const struct kernel *k, const struct conv_samples *s, const double *near, int x, int y,
                          float *out)
{
    const struct conv_layout *lay = m->layout;
    const int cut_x = convolution_cut(lay->across, lay->width), cut_y = convolution_cut(lay->down, lay->height);
    const int count = x > cut_x || y > cut_y ? 0 : (cut_y - y) / k->step + 1;
    const float scale = k->scale * s->pixel2;

    if (count > 0 && !k->radial->point)
        m->kernels->sample(s, (float) x, (float) y, (float) k->step, PELL_FFT_ELEMENT, out);
    else
        memset(out, 0, PELL_FFT_ELEMENT * sizeof(*out));
    for (int i = 0; i < PELL_FFT_ELEMENT; i++)
        out[i] = i < count ? scale * out[i] : 0.0f;
    for (int i = 0; k->own && x < NEAR && y < NEAR && i < NEAR && i < count; i++)
        out[i] = k->scale * (float) near[i * NEAR + x];
}

static void make_spectrum(void *arg, int index, int worker)
{
    const struct maker *m = arg;
    const struct kernel *k = &m->list[index];
    const struct conv_layout *lay = m->layout;
    const int nx = lay->across / k->step, ny = lay->down / k->step, hx = nx / 2, hy = ny / 2, L = PELL_FFT_LANES, E = PELL_FFT_ELEMENT;
    const int stride = conv_round_up(hx + 1, L) + 2 * L, columns = k->step > 1 ? hx : hx + 1;
    const float scale = (float) ((double) k->step * k->step / ((double) lay->across * lay->down));
    const struct conv_samples s = {
        .value = k->radial->value,
        .per_median2 = k->radial->per_median2,
        .pixel2 = k->pixel * k->pixel,
        .distance2 = k->distance2,
        .fine = k->step == 1 && k->radial->median2 + k->distance2 < 36.0f * k->pixel * k->pixel, /* R varies within a pixel */
    };
    double near[NEAR * NEAR];
    float *quarter = m->scratch[worker], *buffer[2], *table, *data = m->memory + (k->to->data - m->memory);
    struct pell_fft across, down;

    buffer[0] = quarter + quarter_size(lay->across, lay->down);
    buffer[1] = buffer[0] + pell_fft_buffer(nx > ny ? nx : ny);
    table = buffer[1] + pell_fft_buffer(nx > ny ? nx : ny);
    pell_fft_init(&across, nx, table);
    pell_fft_init(&down, ny, table + pell_fft_table(nx));
    if (k->own)
        convolution_radial_squares(k->radial, (double) k->pixel, NEAR, near);

    for (int y0 = 0; y0 <= hy; y0 += 2 * L) {
        const float *z;
        for (int x = 0; x <= hx; x++) {
            float *to = buffer[0] + (ptrdiff_t) E * x;
            sample_column(m, k, &s, near, x * k->step, y0 * k->step, to);
            for (int l = hy - y0 + 1; l < E; l++)
                to[l] = 0.0f;
            if (x > 0 && 2 * x < nx)
                memcpy(buffer[0] + (ptrdiff_t) E * (nx - x), to, (size_t) E * sizeof(float));
        }
        z = pell_fft_run(&across, false, buffer[0], buffer[1]);
        for (int f = 0; f <= hx; f += L)
            for (int part = 0; part < 2; part++)
                pell_fft_transpose(&across, z + (ptrdiff_t) E * f + part * L, E, quarter + (ptrdiff_t) (y0 + part * L) * stride + f,
                                   stride);
    }
    for (int b = 0; b < k->to->blocks; b += 2) {
        const float *z;
        for (int y = 0; y <= hy; y++) {
            float *to = buffer[0] + (ptrdiff_t) E * y;
            memcpy(to, quarter + (ptrdiff_t) y * stride + L * b, (size_t) E * sizeof(float));
            for (int l = 0; l < E; l++)
                to[l] = L * b + l < columns ? to[l] * scale : 0.0f;
            if (y > 0 && 2 * y < ny)
                memcpy(buffer[0] + (ptrdiff_t) E * (ny - y), to, (size_t) E * sizeof(float));
        }
        z = pell_fft_run(&down, false, buffer[0], buffer[1]);
        for (int part = 0; part < 2 && b + part < k->to->blocks; part++)
            for (int y = 0; y < k->to->rows; y++)
                memcpy(data + (b + part) * k->to->block + L * y, z + (ptrdiff_t) E * y + part * L, (size_t) L * sizeof(float));
    }
}

/* --- All kernels --------------------------------------------------------------------------------------------------------------------- */

static void add(struct maker *m, const struct conv_radial *r, double h, float pixel, float unit, bool own, struct conv_spectrum *to,
                size_t *used)
{
    const double h_px = h / (double) pixel;
    const int step = own || h_px < 8.0 ? 1 : h_px < 16.0 ? 2 : h_px < 32.0 ? 4 : 8;
    const int columns = m->layout->across / step / 2 + (step == 1), rows = m->layout->down / step / 2 + (step == 1);

    *to = (struct conv_spectrum) {
        .data = m->memory + *used,
        .block = (ptrdiff_t) rows * PELL_FFT_LANES,
        .blocks = (columns + PELL_FFT_LANES - 1) / PELL_FFT_LANES,
        .rows = rows,
    };
    *used += (size_t) to->blocks * (size_t) to->block;
    m->list[m->count++] = (struct kernel) {
        .radial = r,
        .distance2 = (float) (h * h),
        .pixel = pixel,
        .scale = unit * unit / (pixel * pixel),
        .step = step,
        .own = own,
        .to = to,
    };
}

static bool is_kept(const struct convolution_knobs *k, const struct conv_radial *r, double h)
{
    if (!(r->total > 0.0f))
        return false;
    if (k->threshold_by == CONV_AS_PRINTED)
        return !r->point && convolution_radial_value(r, (float) (h * h)) >= k->threshold * convolution_radial_value(r, 0.0f);
    return convolution_radial_beyond(r, h) > (double) k->threshold * (double) r->total;
}

/* The kernels of one channel. */
static void list_channel(struct maker *m, const struct convolution_knobs *k, const struct conv_radial *r, int c, struct conv_spectra *out,
                         size_t *used)
{
    const struct conv_layout *lay = m->layout;
    const int n = lay->planes;

    for (int i = 0; i < out->num_own; i++)
        add(m, r, 0.0, lay->pixel[i], lay->unit, true, &out->own[c][i], used);
    for (int i = 0; i < n; i++) {
        const double h = (double) lay->behind[c][i];
        out->behind[c][i] = (struct conv_spectrum) { .data = NULL };
        if (h >= 0.0 && is_kept(k, r, h))
            add(m, r, h, lay->pixel[i], lay->unit, !(h > 0.0), &out->behind[c][i], used);
    }
    for (int from = 0, at = 0; from < n; from++)
        for (int to = from + 1; to < n; to++, at++) {
            const double h = fabs((double) lay->depth[to] - (double) lay->depth[from]);
            const float pixel = sqrtf(lay->pixel[from] * lay->pixel[to]);
            const bool equal = k->placement == CONV_EQUAL, keep = is_kept(k, r, h);
            struct conv_spectrum *s = &out->far[c][equal ? to - from - 1 : at];
            if (keep && (!equal || from == 0))
                add(m, r, h, equal ? lay->unit : pixel, lay->unit, false, s, used);
            out->pairs[c][at] = (struct conv_pair) {
                .from = from,
                .to = to,
                .spectrum = keep ? s : NULL,
                .factor = equal ? lay->unit * lay->unit / (pixel * pixel) : 1.0f,
            };
        }
    for (int i = 0; i < out->num_responses; i++)
        convolution_response_make(r, k, n > 1 ? fabs((double) lay->depth[i + 1] - (double) lay->depth[i]) : 0.0, &out->response[c][i]);
}

void convolution_spectra_make(struct pell_pool *pool, const struct convolution_knobs *k, const struct conv_radial radial[3],
                              const struct conv_layout *layout, const struct conv_kernels *kernels, float *const *scratch,
                              struct conv_spectra *out)
{
    struct maker m = { .layout = &out->layout, .kernels = kernels, .scratch = scratch, .memory = out->memory };
    size_t used = 0;

    if (memcmp(&out->layout, layout, sizeof(*layout)) == 0)
        return;
    out->layout = *layout;
    out->num_own = 1;
    for (int i = 1; i < layout->planes; i++)
        if (layout->pixel[i] != layout->pixel[0])
            out->num_own = layout->planes;
    out->num_pairs = layout->planes * (layout->planes - 1) / 2;
    out->num_responses = layout->planes == 1 || k->placement == CONV_EQUAL ? 1 : layout->planes - 1;
    for (int c = 0; c < 3; c++)
        list_channel(&m, k, &radial[c], c, out, &used);
    pell_pool_run(pool, m.count, make_spectrum, &m);
}
