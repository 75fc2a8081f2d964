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

static enum pell_result choose(struct bench *b, int samples, const char *as)
{
    char text[16];
    const struct pell_setting settings[] = { { "as", as, "bench" }, { "samples", text, "bench" } };

    snprintf(text, sizeof(text), "%d", samples);
    return bench_choose(b, "layered", settings, PELL_COUNT(settings));
}

static int layers_of(const struct pell_scene *scene)
{
    int most = 0;

    for (size_t i = 0; i < scene->num_materials; i++)
        most = scene->materials[i].num_layers > most ? scene->materials[i].num_layers : most;
    return most;
}

static const struct pell_stage_time *stage_of(const struct pell_picture *p, const char *name)
{
    for (size_t i = 0; i < p->num_stages; i++)
        if (strcmp(p->stages[i].name, name) == 0)
            return &p->stages[i];
    return NULL;
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
        PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
        stage = stage_of(&p, "planes");
        once = i < 0 && stage ? stage->ms : once;
        stage = stage_of(&p, "layered");
        if (i >= 0 && stage)
            times[i] = stage->ms;
    }
    if (samples == TRUTH) {
        PELL_TRY(bench_keep_truth(b, &p));
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
            r->items = stage->pixels * samples * lamps * layers_of(b->s.scene);
            r->error = bench_error(b, &p);
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
    struct pell_scene *scene = b->s.scene;
    const size_t all = scene->num_lights;
    double ms[MOST_LAMPS + 1] = { 0 };
    enum pell_result res = PELL_OK;
    struct row *r;

    for (int lamps = 1; lamps <= MOST_LAMPS; lamps++) {
        scene->num_lights = (size_t) lamps;
        PELL_TRY(pell_renderer_set_scene(b->s.renderer, scene));
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

enum exit_code bench_francois(struct cli *cli, const char *what, const char *path)
{
    struct bench b;
    enum exit_code code = bench_open(&b, cli, path);
    int layers = 0;

    b.s.settings.width = WIDTH;
    b.s.settings.height = HEIGHT;
    if (code == EXIT_OK) {
        layers = layers_of(b.s.scene);
        if (b.s.scene->num_lights != MOST_LAMPS || layers == 0)
            code = cli_failed(cli, pell_error(cli->ctx, PELL_ERR_INVALID, path, NULL,
                                              "has %zu lights and %d layers, the bench takes %d lights and some layers",
                                              b.s.scene->num_lights, layers, MOST_LAMPS));
    }
    if (code == EXIT_OK)
        code = cli_failed(cli, run_all(&b));
    if (code == EXIT_OK)
        code = bench_answer(&b, what, BENCH_PIXELS | BENCH_RAYS | BENCH_ERROR, "layer-samples/s",
                            "%d x %d pixels, %d layers; medians of %d warm frames of the march with its rays; errors against %d samples",
                            WIDTH, HEIGHT, layers, b.repeats, TRUTH);
    bench_close(&b);
    return code;
}
