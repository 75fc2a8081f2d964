/* SPDX-License-Identifier: MIT
 * bench_screen_space.c - time of the screen-space passes on a ball of 300,000 pixels in 1280 x 720, 4 Gaussians, next to copying the
 * same bytes in the same run: every translucent pixel's 16 bytes read once and written once in each of a Gaussian's two passes.
 *
 *     bench_screen_space [threads [name=value ...]] */
#include "patch.h"

#include "base/pool.h"

#define ROUNDS 30

struct copy {
    const float *from;
    float *to;
    size_t floats;
};

static void copy_band(void *arg, int index, int worker)
{
    const struct copy *c = arg;
    const size_t part = c->floats / 64;

    (void) worker;
    memcpy(c->to + (size_t) index * part, c->from + (size_t) index * part, part * sizeof(float));
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return x < y ? -1 : x > y;
}

/* A ball of 200 mm, 617 pixels across, seen from a metre. */
static struct patch *ball(const struct pell_frame_material *m)
{
    struct patch *p = patch_create(1280, 720, false, 3031.0, 1000.0, m, 1);
    int count = 0;

    for (int y = 0; y < 720; y++) {
        for (int x = 0; x < 1280; x++) {
            const size_t i = patch_at(p, x, y);
            const double tx = patch_tan_x(p, x), ty = patch_tan_y(p, y), a = 1.0 + tx * tx + ty * ty, b = 1000.0;
            const double under = b * b - a * (b * b - 100.0 * 100.0);
            const bool hit = under > 0.0;
            const double z = hit ? (b - sqrt(under)) / a : 0.0;
            p->material[i] = hit;
            p->depth[i] = (float) z;
            for (int c = 0; c < 3; c++)
                p->light[c][i] = (float) (0.5 + 0.5 * sin(0.05 * x) * cos(0.07 * y + c));
            count += hit;
        }
    }
    p->frame.rect = (struct pell_rect) { 320, 40, 960, 680 };
    printf("%d translucent pixels\n", count);
    return p;
}

int main(int argc, char **argv)
{
    static const double variance[4] = { 0.0362, 0.1144, 0.4555, 3.4833 };
    static const double weight[4][3] = {
        { 0.0544, 0.1245, 0.2177 },
        { 0.2436, 0.2435, 0.1890 },
        { 0.3105, 0.3158, 0.3742 },
        { 0.3913, 0.3161, 0.2189 },
    };
    const struct pell_frame_material m = patch_gaussians(4, variance, weight);
    const int threads = argc > 1 ? atoi(argv[1]) : 2;
    struct test_device at = test_device_create(threads, NULL, NULL);
    const struct pell_method *method = pell_method_find(at.ctx, "bench", "screen-space");
    const char *settings[16] = { NULL };
    struct patch *p = ball(&m);
    struct pell_pass *pass;
    struct pell_pool *pool;
    struct copy copy = { .floats = 4 * 300032 };
    double total[ROUNDS], copies[ROUNDS], stage[24][ROUNDS];
    struct pell_pass_time times[24];
    size_t count = 0;

    for (int i = 2; i < argc && i < 17; i++)
        settings[i - 2] = argv[i];
    copy.from = calloc(copy.floats, sizeof(float));
    copy.to = calloc(copy.floats, sizeof(float));
    if (!method || !copy.from || !copy.to || pell_pool_create(at.ctx, threads, &pool) != PELL_OK)
        return 1;
    pass = patch_pass(&at, method, settings, p);
    for (int r = -5; r < ROUNDS; r++) {
        const double t0 = pell_seconds();
        double t1, t2;
        if (pell_pass_render(pass, &p->frame, &p->out) != PELL_OK)
            return 1;
        t1 = pell_seconds();
        for (int i = 0; i < 8; i++)
            pell_pool_run(pool, 64, copy_band, &copy);
        t2 = pell_seconds();
        count = pell_pass_times(pass, times, PELL_COUNT(times));
        if (r >= 0) {
            total[r] = t1 - t0;
            copies[r] = t2 - t1;
            for (size_t i = 0; i < count; i++)
                stage[i][r] = times[i].seconds;
        }
    }
    qsort(total, ROUNDS, sizeof(double), by_size);
    qsort(copies, ROUNDS, sizeof(double), by_size);
    for (size_t i = 0; i < count; i++) {
        qsort(stage[i], ROUNDS, sizeof(double), by_size);
        printf("%-12s %7.3f ms  %9lld pixels\n", times[i].name, 1e3 * stage[i][ROUNDS / 2], (long long) times[i].pixels);
    }
    printf("all passes   %7.3f ms (fastest %.3f), %d threads\n", 1e3 * total[ROUNDS / 2], 1e3 * total[0], threads);
    printf("copy         %7.3f ms (8 passes of 16 bytes read and written)\n", 1e3 * copies[ROUNDS / 2]);
    printf("ratio        %7.2f\n", total[ROUNDS / 2] / copies[ROUNDS / 2]);
    pell_pass_destroy(&pass);
    pell_pool_destroy(&pool);
    patch_destroy(p);
    test_device_destroy(&at);
    free((void *) (uintptr_t) copy.from);
    free(copy.to);
    return 0;
}
