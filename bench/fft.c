/* SPDX-License-Identifier: MIT
 * fft.c - speed of src/math/fft relative to FFTW: transforms of real images and their inverses, single precision, one thread, the same
 * sizes in the same run. Times are processor times.
 *
 *     bench_fft [--measure]       --measure: FFTW may try plans (FFTW_MEASURE), else it estimates them
 *
 * FFTW is only used as a reference of speed here, and by nothing that is installed. */
#include "math/fft.h"
#include "base/simd.h"

#include <fftw3.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define ROUNDS 7

static double seconds(void)
{
    struct timespec t;

    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return (x > y) - (x < y);
}

struct ours {
    struct pell_fft row, column;
    int width, height;
    ptrdiff_t block;
    float *tables[2], *image[2], *back[2], *half[2], *buffer[2];
};

static float *floats(size_t n)
{
    float *p = aligned_alloc(64, (n * sizeof(float) + 63) / 64 * 64);

    if (!p)
        exit(1);
    memset(p, 0, n * sizeof(float));
    return p;
}

static void start(struct ours *o, int width, int height)
{
    const size_t stride = ((size_t) width + 15) / 16 * 16, size = stride * (size_t) height;
    const int longest = width > height ? width : height;

    o->width = width;
    o->height = height;
    o->block = (ptrdiff_t) PELL_FFT_ELEMENT * height;
    for (int i = 0; i < 2; i++) {
        o->tables[i] = floats(pell_fft_table(i ? height : width));
        o->image[i] = floats(size);
        o->back[i] = floats(size);
        o->half[i] = floats(((size_t) width / 32 + 1) * (size_t) o->block);
        o->buffer[i] = floats(pell_fft_buffer(longest));
        for (size_t k = 0; k < size; k++)
            o->image[i][k] = (float) (k * 2654435761u % 1000) * 1e-3f;
    }
    pell_fft_init(&o->row, width, o->tables[0]);
    pell_fft_init(&o->column, height, o->tables[1]);
}

static void finish(struct ours *o)
{
    for (int i = 0; i < 2; i++) {
        free(o->tables[i]);
        free(o->image[i]);
        free(o->back[i]);
        free(o->half[i]);
        free(o->buffer[i]);
    }
}

/* 16 rows of two images, from y on. */
static struct pell_fft_rows rows_from(const struct ours *o, float *const image[2], int y)
{
    struct pell_fft_rows r = { .stride = (o->width + 15) / 16 * 16, .block = o->block, .width = o->width };

    for (int i = 0; i < 2; i++) {
        r.image[i] = image[i] + y * r.stride;
        r.half[i] = o->half[i] + PELL_FFT_ELEMENT * y;
    }
    r.rows = o->height - y < 16 ? o->height - y : 16;
    return r;
}

/* Two images, forward and inverse. */
static void run(struct ours *o)
{
    for (int y = 0; y < o->height; y += 16) {
        const struct pell_fft_rows rows = rows_from(o, o->image, y);
        pell_fft_rows(&o->row, &rows, o->buffer);
    }
    for (int i = 0; i < 2; i++)
        for (int b = 0; b < o->width / 32 + 1; b++) {
            float *column = o->half[i] + b * o->block, *spectrum, *back;
            spectrum = pell_fft_run(&o->column, false, column, o->buffer[0]);
            back = pell_fft_run(&o->column, true, spectrum, spectrum == column ? o->buffer[0] : column);
            if (back != column)
                memcpy(column, back, (size_t) o->block * sizeof(float));
        }
    for (int y = 0; y < o->height; y += 16) {
        const struct pell_fft_rows rows = rows_from(o, o->back, y);
        pell_fft_rows_back(&o->row, &rows, o->buffer);
    }
}

static void compare(int width, int height, unsigned flags)
{
    const size_t n = (size_t) width * (size_t) height;
    float *image = fftwf_malloc(n * sizeof(float)), *back = fftwf_malloc(n * sizeof(float));
    fftwf_complex *half = fftwf_malloc(((size_t) width / 2 + 1) * (size_t) height * sizeof(*half));
    fftwf_plan forward = fftwf_plan_dft_r2c_2d(height, width, image, half, flags | FFTW_DESTROY_INPUT);
    fftwf_plan inverse = fftwf_plan_dft_c2r_2d(height, width, half, back, flags | FFTW_DESTROY_INPUT);
    double ours[ROUNDS], theirs[ROUNDS], worst = 0.0;
    struct ours o;

    start(&o, width, height);
    for (int i = -1; i < ROUNDS; i++) {
        double from = seconds();
        run(&o);
        if (i >= 0)
            ours[i] = 0.5 * (seconds() - from);
        for (size_t k = 0; k < n; k++)
            image[k] = o.image[0][k / (size_t) width * ((size_t) (width + 15) / 16 * 16) + k % (size_t) width];
        from = seconds();
        fftwf_execute(forward);
        fftwf_execute(inverse);
        if (i >= 0)
            theirs[i] = seconds() - from;
    }
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            const double a = (double) o.back[0][y * ((width + 15) / 16 * 16) + x];
            worst = fmax(worst, fabs(a - (double) back[y * width + x]) / (double) n);
        }
    qsort(ours, ROUNDS, sizeof(double), by_value);
    qsort(theirs, ROUNDS, sizeof(double), by_value);
    printf("%5d x %4d %10.2f %10.2f %8.2f %12.1e\n", width, height, 1e3 * ours[ROUNDS / 2], 1e3 * theirs[ROUNDS / 2],
           ours[ROUNDS / 2] / theirs[ROUNDS / 2], worst);
    finish(&o);
    fftwf_destroy_plan(forward);
    fftwf_destroy_plan(inverse);
    fftwf_free(image);
    fftwf_free(back);
    fftwf_free(half);
}

int main(int argc, char **argv)
{
    static const int sizes[][2] = { { 256, 256 },   { 512, 512 },   { 720, 720 },   { 1024, 1024 },
                                    { 1152, 1152 }, { 1200, 1200 }, { 1600, 1200 }, { 2048, 2048 } };
    const unsigned flags = argc > 1 && strcmp(argv[1], "--measure") == 0 ? FFTW_MEASURE : FFTW_ESTIMATE;

    printf("SIMD level %s, FFTW %s, %s\n  width x height    ours ms    FFTW ms    ratio   difference\n", pell_simd_name(pell_simd_best()),
           fftwf_version, flags == FFTW_MEASURE ? "measured" : "estimated");
    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++)
        compare(sizes[i][0], sizes[i][1], flags);
    return 0;
}
