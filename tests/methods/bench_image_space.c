/* SPDX-License-Identifier: MIT
 * bench_image_space.c - time of the image-space passes on a bumpy surface that fills 500 x 500 pixels at 4.2 to the millimetre, and 1000 x
 * 1000 at twice that, next to copying the same bytes in the same run; its dependence on the number of samples and on the radius.
 *
 *     bench_image_space [threads [name=value ...]] */
#include "patch.h"

#include "base/pool.h"

#include <time.h>

#define ROUNDS 9

/* Processor time of all threads. */
static double cpu_seconds(void)
{
    struct timespec t;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return x < y ? -1 : x > y;
}

static double median(double *v, int n)
{
    qsort(v, (size_t) n, sizeof(*v), by_size);
    return v[n / 2];
}

static struct patch *bumps(int size, const struct pell_frame_material *m)
{
    struct patch *p = patch_create(size, size, false, 4.2 * 600.0 * size / 500.0, 600.0, m, 1);

    for (int y = 0; y < size; y++)
        for (int x = 0; x < size; x++) {
            const double u = 500.0 * x / size, v = 500.0 * y / size;
            const size_t i = patch_at(p, x, y);
            p->depth[i] = (float) (600.0 + 6.0 * sin(0.05 * u) * cos(0.04 * v) + 1e-4 * (u - 250.0) * (u - 250.0));
            for (int c = 0; c < 3; c++)
                p->light[c][i] = (float) (0.5 + 0.5 * sin(0.05 * u) * cos(0.07 * v + c));
        }
    return p;
}

/* Medians of the passes in ms, by wall-clock time and by processor time. */
static void measure(const struct test_device *at, int size, double radius, const char *const *settings, bool print, double out[2])
{
    struct pell_frame_material m = { .name = "skin1", .medium = pell_material_find("skin1")->medium };
    const struct pell_method *method = pell_method_find(at->ctx, "bench", "image-space");
    struct patch *p;
    struct pell_pass *pass;
    struct pell_pass_time times[8];
    double wall[ROUNDS], cpu[ROUNDS], stage[8][ROUNDS];
    size_t count = 0;

    for (int c = 0; c < 3; c++) {
        m.medium.sigma_a[c] /= radius;
        m.medium.sigma_s_reduced[c] /= radius;
    }
    p = bumps(size, &m);
    pass = patch_pass(at, method, settings, p);
    for (int r = -2; r < ROUNDS; r++) {
        const double t = pell_seconds(), s = cpu_seconds();
        if (pell_pass_render(pass, &p->frame, &p->out) != PELL_OK)
            exit(1);
        count = pell_pass_times(pass, times, PELL_COUNT(times));
        if (r < 0)
            continue;
        wall[r] = pell_seconds() - t;
        cpu[r] = cpu_seconds() - s;
        for (size_t i = 0; i < count; i++)
            stage[i][r] = times[i].seconds;
    }
    out[0] = 1e3 * median(wall, ROUNDS);
    out[1] = 1e3 * median(cpu, ROUNDS);
    for (size_t i = 0; print && i < count; i++)
        printf("    %-12s %8.2f ms  %9lld pixels\n", times[i].name, 1e3 * median(stage[i], ROUNDS), (long long) times[i].pixels);
    pell_pass_destroy(&pass);
    patch_destroy(p);
}

int main(int argc, char **argv)
{
    static const int sizes[] = { 500, 1000 }, samples[] = { 4, 16, 64 };
    static const double radii[] = { 0.25, 1.0, 4.0 };
    const int threads = argc > 1 ? atoi(argv[1]) : 2;
    struct test_device at = test_device_create(threads, NULL, NULL);

    for (size_t s = 0; s < PELL_COUNT(sizes); s++)
        for (size_t k = 0; k < PELL_COUNT(samples); k++) {
            char text[32];
            const char *settings[16] = { text };
            double ms[2];
            snprintf(text, sizeof(text), "samples=%d", samples[k]);
            for (int i = 2; i < argc && i < 15; i++)
                settings[i - 1] = argv[i];
            measure(&at, sizes[s], 1.0, settings, true, ms);
            printf("%4d x %-4d %3d samples: %8.2f ms, %8.2f ms of all cores, %.1f million samples a second and core\n", sizes[s], sizes[s],
                   samples[k], ms[0], ms[1], 1e-3 * sizes[s] * sizes[s] * samples[k] / ms[1]);
        }
    for (size_t k = 0; k < PELL_COUNT(radii); k++) {
        double ms[2];
        measure(&at, 500, radii[k], NULL, false, ms);
        printf("radius x %.2f: %8.2f ms, %8.2f ms of all cores\n", radii[k], ms[0], ms[1]);
    }
    test_device_destroy(&at);
    return 0;
}
