/* SPDX-License-Identifier: MIT
 * francois.c - `pellucid-bench francois-2`: layered on images filled by its fish (three painted layers) and its gecko (four), 800 x 600: by
 * number of samples with one and with two lights, with the difference to 400 samples; by lights; and the memory of the layers. (The paper,
 * figure 14 and table 2: the fish 126, 51 and 20 frames a second with 10, 50 and 100 samples on a GeForce 7800 GTX, the gecko 120, 33 and
 * 16.) */
#include "papers.h"

#include <string.h>

enum { WIDTH = 800, HEIGHT = 600, MOST_LIGHTS = 4 };
#define TRUTH "400"

static const int samples[] = { 10, 20, 50, 100 };

static int layers_of(const struct pell_scene *scene)
{
    int most = 0;

    for (size_t i = 0; i < scene->num_materials; i++)
        most = scene->materials[i].num_layers > most ? scene->materials[i].num_layers : most;
    return most;
}

/* The march of `count` samples under the first lights; *ms: the median of warm frames, may be NULL. */
static enum pell_result measure(struct bench *b, const char *what, int count, int lights, const char *as, double *ms)
{
    char knobs[64], name[96];
    const struct bench_run run = { "layered", knobs, false, false };
    struct bench_result r;
    enum pell_result res;

    snprintf(knobs, sizeof(knobs), "as=%s samples=%d", as, count);
    snprintf(name, sizeof(name), "%s%d samples, %d light%s%s", what, count, lights, lights > 1 ? "s" : "",
             strcmp(as, "best") == 0 ? "" : ", as=paper");
    PELL_TRY(bench_measure(b, name, &run, &r));
    if (r.row)
        r.row->items = r.pixels * count * lights * layers_of(b->s.scene);
    if (r.row && ms)
        *ms = r.row->ms;

fail:
    return res;
}

/* Time of fitting the planes through the surface that `as=best` uses, once per scene: a stage of a first frame. */
static enum pell_result add_planes(struct bench *b, const char *what)
{
    char name[96];
    struct pell_render_result p;
    enum pell_result res;

    snprintf(name, sizeof(name), "%sonce a scene: planes", what);
    PELL_TRY(bench_choose(b, "layered", "as=best"));
    PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
    for (size_t i = 0; i < p.num_stages; i++)
        if (strcmp(p.stages[i].name, "planes") == 0)
            bench_add(&b->rows, name, p.stages[i].ms);

fail:
    return res;
}

static void add_memory(struct bench *b)
{
    static const struct {
        const char *name;
        double bytes;
    } rows[] = {
        /* With mip levels: 4/3 of 4 pairs of 2-byte numbers; a voxel of the solid needs the index of its layer, a byte, for a depth
         * equal to the width. */
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

/* Both settings by samples under the first light, each against its own result with many samples; *ms as in measure(), with 50 samples. */
static enum pell_result add_samples(struct bench *b, const char *what, double *ms)
{
    enum pell_result res;

    PELL_TRY(bench_keep_truth(b, "layered", "samples=" TRUTH));
    for (size_t i = 0; i < PELL_COUNT(samples); i++)
        PELL_TRY(measure(b, what, samples[i], 1, "best", samples[i] == 50 ? ms : NULL));
    PELL_TRY(bench_keep_truth(b, "layered", "as=paper samples=" TRUTH));
    for (size_t i = 0; i < PELL_COUNT(samples); i++)
        PELL_TRY(measure(b, what, samples[i], 1, "paper", NULL));

fail:
    return res;
}

/* The gecko under its first light. */
static enum pell_result run_gecko(struct bench *b)
{
    enum pell_result res;

    b->s.settings.width = WIDTH;
    b->s.settings.height = HEIGHT;
    b->s.scene->num_lights = b->s.scene->num_lights > 1 ? 1 : b->s.scene->num_lights;
    PELL_TRY(pell_renderer_set_scene(b->s.renderer, b->s.scene));
    PELL_TRY(add_planes(b, "gecko: "));
    PELL_TRY(add_samples(b, "gecko: ", NULL));

fail:
    return res;
}

enum pell_result bench_francois(struct bench *b)
{
    struct pell_scene *scene = b->s.scene;
    const size_t all = scene->num_lights;
    const int layers = layers_of(scene);
    double ms[MOST_LIGHTS + 1] = { 0 };
    enum pell_result res = PELL_OK;
    struct row *r;

    if (all != MOST_LIGHTS || layers == 0)
        return pell_error(b->cli->ctx, PELL_ERR_INVALID, b->path, NULL,
                          "has %zu lights and %d layers, the bench takes %d lights and some layers", all, layers, MOST_LIGHTS);
    b->s.settings.width = WIDTH;
    b->s.settings.height = HEIGHT;
    snprintf(b->setup, sizeof(b->setup),
             "%d x %d pixels, the fish with %d layers and the gecko with 4; medians of %d warm frames of the march with its rays; errors "
             "against " TRUTH " samples",
             WIDTH, HEIGHT, layers, b->repeats);
    for (int lights = 1; lights <= MOST_LIGHTS; lights++) {
        scene->num_lights = (size_t) lights;
        PELL_TRY(pell_renderer_set_scene(b->s.renderer, scene));
        if (lights == 1) {
            PELL_TRY(add_planes(b, ""));
            PELL_TRY(add_samples(b, "", &ms[1]));
            continue;
        }
        PELL_TRY(bench_keep_truth(b, "layered", "samples=" TRUTH));
        for (size_t i = 0; i < PELL_COUNT(samples); i++)
            if (lights == 2 || samples[i] == 50)
                PELL_TRY(measure(b, "", samples[i], lights, "best", samples[i] == 50 ? &ms[lights] : NULL));
    }
    if ((r = bench_add(&b->rows, "a light more, 50 samples", (ms[MOST_LIGHTS] - ms[1]) / (MOST_LIGHTS - 1)))) {
        r->ratio = r->ms / ms[1];
        r->against = "one light";
    }
    scene->num_lights = all;
    PELL_TRY(bench_run_sibling(b, "-gecko", run_gecko)); /* the fish's scene is closed */
    add_memory(b);
    return PELL_OK;

fail:
    if (scene == b->s.scene)
        scene->num_lights = all;
    return res;
}
