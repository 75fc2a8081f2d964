/* SPDX-License-Identifier: MIT
 * bench_francois.c - `pellucid bench francois-2`: layered on a picture that its fish fills, 800 x 600, three painted layers: by samples
 * with one and with two lamps, and how far each is from 400 samples; by lamps; and what the layers take in memory. (The paper, figure 14
 * and table 2: 126, 51 and 20 frames a second with 10, 50 and 100 samples on a GeForce 7800 GTX.) */
#include "cli/bench.h"

#include "base/simd.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 800, HEIGHT = 600, MOST_LAMPS = 4, TRUTH = 400 };

struct bench {
    struct cli *cli;
    struct session *s;
    struct rows rows;
    int repeats, layers;
    float *truth; /* R, G, B */
};

static enum pell_result choose(struct bench *b, int samples, const char *as)
{
    char text[16];
    const struct pell_setting settings[] = { { "as", as, "bench" }, { "samples", text, "bench" } };
    const struct pell_method *m = pell_method_find(b->cli->ctx, "bench francois-2", "layered");
    void *values = m ? calloc(1, m->knobs_size) : NULL;
    enum pell_result res = m ? PELL_ERR_NOMEM : PELL_ERR_INVALID;

    snprintf(text, sizeof(text), "%d", samples);
    if (values)
        res = pell_method_configure(b->cli->ctx, m, settings, PELL_COUNT(settings), values);
    if (res == PELL_OK)
        res = pell_renderer_set_method(b->s->renderer, m, values);
    free(values);
    return res;
}

static const struct pell_stage_time *stage_of(const struct pell_picture *p, const char *name)
{
    for (size_t i = 0; i < p->num_stages; i++)
        if (strcmp(p->stages[i].name, name) == 0)
            return &p->stages[i];
    return NULL;
}

/* Root mean square difference from 400 samples over their mean. */
static double error_of(const struct bench *b, const struct pell_picture *p)
{
    const size_t size = (size_t) WIDTH * HEIGHT;
    double square = 0.0, sum = 0.0;

    for (size_t c = 0; c < 3; c++)
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++) {
                const double t = (double) b->truth[c * size + (size_t) (y * WIDTH + x)];
                const double d = (double) p->channels[c].data[y * p->channels[c].stride + x] - t;
                square += d * d;
                sum += t;
            }
    return sum > 0.0 ? sqrt(square * (double) (3 * size)) / sum : 0.0;
}

static void keep_truth(struct bench *b, const struct pell_picture *p)
{
    for (size_t c = 0; c < 3; c++)
        for (int y = 0; y < HEIGHT; y++)
            memcpy(b->truth + (c * HEIGHT + (size_t) y) * WIDTH, p->channels[c].data + y * p->channels[c].stride, WIDTH * sizeof(float));
}

/* The march of so many samples under the first lamps: the median of the warm frames. *ms may be NULL. */
static enum pell_result measure(struct bench *b, int samples, int lamps, const char *as, double *ms)
{
    double *times = calloc((size_t) b->repeats, sizeof(*times)), once = -1.0;
    const struct pell_stage_time *stage = NULL;
    enum pell_result res = times ? PELL_OK : PELL_ERR_NOMEM;
    struct pell_picture p = { 0 };
    char name[96];
    struct row *r;

    PELL_TRY(res);
    PELL_TRY(choose(b, samples, as));
    for (int i = -1; i < (samples == TRUTH ? 0 : b->repeats); i++) {
        PELL_TRY(bench_frame(b->s->renderer, &b->s->settings, &p));
        stage = stage_of(&p, "planes");
        once = i < 0 && stage ? stage->ms : once;
        stage = stage_of(&p, "layered");
        if (i >= 0 && stage)
            times[i] = stage->ms;
    }
    if (samples == TRUTH) {
        keep_truth(b, &p);
        if (lamps == 1 && once >= 0.0 && strcmp(as, "best") == 0)
            bench_add(&b->rows, "once a scene: planes", once);
    } else if (stage) {
        const double median = bench_median(times, b->repeats);
        snprintf(name, sizeof(name), "%d samples, %d lamp%s%s", samples, lamps, lamps > 1 ? "s" : "",
                 strcmp(as, "best") == 0 ? "" : ", as=paper");
        if ((r = bench_add(&b->rows, name, median))) {
            r->pixels = stage->pixels;
            r->rays = stage->rays;
            r->bytes = stage->bytes;
            r->copy_ms = stage->copy_ms;
            r->items = stage->pixels * samples * lamps * b->layers;
            r->error = error_of(b, &p);
        }
        if (ms)
            *ms = median;
    }

fail:
    free(times);
    return res;
}

static void add_memory(struct bench *b)
{
    static const struct {
        const char *name;
        double bytes;
    } rows[] = {
        /* With levels: 4/3 of 4 pairs of numbers of 2 bytes; a texel of the solid needs which layer it is in, a byte, as deep as it is
         * wide. */
        { "4 layers at 1024 x 1024, MB", 4.0 / 3.0 * 1024.0 * 1024.0 * 16.0 },
        { "3D texture, 1024 x 1024 x 1024, MB", 1024.0 * 1024.0 * 1024.0 },
    };
    struct row *r;

    for (size_t i = 0; i < PELL_COUNT(rows); i++)
        if ((r = bench_add(&b->rows, rows[i].name, 0.0))) {
            r->bytes = (int64_t) rows[i].bytes;
            r->ratio = rows[i].bytes / rows[0].bytes;
            r->against = "the layers'";
        }
}

static enum pell_result run_all(struct bench *b)
{
    static const int samples[] = { 10, 20, 50, 100 };
    struct pell_scene *scene = b->s->scene;
    const size_t all = scene->num_lights;
    double ms[MOST_LAMPS + 1] = { 0 };
    enum pell_result res = PELL_OK;
    struct row *r;

    for (int lamps = 1; lamps <= MOST_LAMPS; lamps++) {
        scene->num_lights = (size_t) lamps;
        PELL_TRY(pell_renderer_set_scene(b->s->renderer, scene));
        PELL_TRY(measure(b, TRUTH, lamps, "best", NULL));
        for (size_t i = 0; i < PELL_COUNT(samples); i++)
            if (lamps <= 2 || samples[i] == 50)
                PELL_TRY(measure(b, samples[i], lamps, "best", samples[i] == 50 ? &ms[lamps] : NULL));
        if (lamps > 1)
            continue;
        PELL_TRY(measure(b, TRUTH, lamps, "paper", NULL));
        for (size_t i = 0; i < PELL_COUNT(samples); i++)
            PELL_TRY(measure(b, samples[i], lamps, "paper", NULL));
    }
    if ((r = bench_add(&b->rows, "a lamp more, 50 samples", (ms[MOST_LAMPS] - ms[1]) / (MOST_LAMPS - 1)))) {
        r->ratio = r->ms / ms[1];
        r->against = "one lamp";
    }
    add_memory(b);

fail:
    scene->num_lights = all;
    return res;
}

static enum exit_code answer(struct cli *cli, const struct bench *b)
{
    const int threads = pell_renderer_threads(b->s->renderer);
    char device[160], build[64];

    cli_device_name(device, sizeof(device));
    snprintf(build, sizeof(build), "%s, SIMD level %s", pell_version(), pell_simd_name(pell_simd_best()));
    if (cli->json)
        return cli_print_json(cli, json_pack("{s:s,s:s,s:s,s:i,s:s,s:i,s:o}", "bench", "francois-2", "engine", "cpu", "device", device,
                                             "threads", threads, "build", build, "repeats", b->repeats, "rows", bench_json(&b->rows)));
    printf(
        "francois-2: %d threads, %s\npellucid %s\n%d x %d pixels, %d layers; medians of %d warm frames of the march with its rays; errors "
        "against %d samples\n\n%-36s %9s %10s %10s %15s %9s  %s\n",
        threads, device, build, WIDTH, HEIGHT, b->layers, b->repeats, TRUTH, "row", "ms", "pixels", "rays", "layer-samples/s", "error %",
        "ratio");
    for (size_t i = 0; i < b->rows.count; i++) {
        const struct row *r = &b->rows.items[i];
        if (r->ms == 0.0 && r->bytes) {
            printf("%-36s %9.1f %10s %10s %15s %9s  %.0f x %s\n", r->name, (double) r->bytes / 1048576.0, "", "", "", "", r->ratio,
                   r->against);
            continue;
        }
        printf("%-36s %9.2f ", r->name, r->ms);
        if (r->pixels)
            printf("%10lld %10lld %15.4g ", (long long) r->pixels, (long long) r->rays, 1e3 * (double) r->items / r->ms);
        else
            printf("%10s %10s %15s ", "", "", "");
        if (isfinite(r->error))
            printf("%9.4f  ", 100.0 * r->error);
        else
            printf("%9s  ", "");
        if (r->against && r->ratio > 0.0)
            printf("%.2f x %s", r->ratio, r->against);
        putchar('\n');
    }
    return EXIT_OK;
}

enum exit_code bench_francois(struct cli *cli, const char *path)
{
    struct session s = { 0 };
    struct bench *b = calloc(1, sizeof(*b));
    enum exit_code code = EXIT_MEMORY;

    cli->stats = true; /* times are compared with copies */
    if (b)
        b->truth = calloc((size_t) 3 * WIDTH * HEIGHT, sizeof(*b->truth));
    if (b && b->truth) {
        b->cli = cli;
        b->s = &s;
        b->repeats = cli->numbers.repeats;
        code = session_open(cli, path, &s);
        s.settings.msaa = 1;
        s.settings.width = WIDTH;
        s.settings.height = HEIGHT;
        for (size_t i = 0; code == EXIT_OK && i < s.scene->num_materials; i++)
            b->layers = s.scene->materials[i].num_layers > b->layers ? s.scene->materials[i].num_layers : b->layers;
        if (code == EXIT_OK && (s.scene->num_lights != MOST_LAMPS || b->layers == 0))
            code = cli_failed(cli, pell_error(cli->ctx, PELL_ERR_INVALID, path, NULL,
                                              "has %zu lights and %d layers, the bench takes %d lights "
                                              "and some layers",
                                              s.scene->num_lights, b->layers, MOST_LAMPS));
        if (code == EXIT_OK)
            code = cli_failed(cli, run_all(b));
        if (code == EXIT_OK)
            code = answer(cli, b);
        session_close(&s);
    }
    if (b)
        free(b->truth);
    free(b);
    return code;
}
