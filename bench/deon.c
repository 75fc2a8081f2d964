/* SPDX-License-Identifier: MIT
 * deon.c - `pellucid-bench deon-1`: table 1 of d'Eon et al. 2007, at full and low resolution, with the environment alone, with one and
 * with two lights, without and with translucent shadow maps; computed completely in every frame, and under static lights; the low
 * resolution under one light without an environment, too, with the passes of that row next to copies of their bytes; by the light's map
 * instead of rays; and a mesh that deforms from frame to frame. (The paper, on a GeForce 8800: 16.7, 22.7, 32.3 and 43.5 ms a frame at
 * full resolution, 8.7, 9.7, 13.3 and 16.4 ms at the low one.) */
#include "papers.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LIGHTS 3          /* of the scene: the environment and two point lights */
#define AMBIENT_SAMPLES 1 /* per pixel: light sampling is not what is measured, and the map requests enough samples itself */
#define FULL_REPEATS 1    /* frames, at most: they are slow */
#define LOW_REPEATS 3

struct variant {
    const char *name;
    int first, lights; /* of the scene */
    const char *tsm;
};

static void add_stages(struct bench *b, const struct pell_render_result *p)
{
    double blur = 0.0, copy = 0.0;
    struct row *r;

    for (size_t k = 0; k < p->num_stages; k++) {
        const struct pell_stage_time *t = &p->stages[k];
        char text[96];
        if (bench_is_common(t->name))
            continue;
        if (strstr(t->name, "blur")) { /* including those that only add to the sum */
            blur += t->ms;
            copy += t->bandwidth_ms;
        }
        snprintf(text, sizeof(text), "    %s", t->name);
        bench_add_stage(&b->rows, text, t->ms, t);
    }
    if ((r = bench_add(&b->rows, "    all blurs", blur))) {
        r->bandwidth_ms = copy;
        r->ratio = copy > 0.0 ? blur / copy : 0.0;
        r->against = "copy";
    }
}

static int repeats_of(const struct bench *b, bool full)
{
    const int most = full ? FULL_REPEATS : LOW_REPEATS;

    return b->repeats < most ? b->repeats : most;
}

static enum pell_result measure(struct bench *b, const struct variant *v, bool full, bool stages)
{
    struct pell_scene *scene = b->s.scene;
    double *cold = calloc((size_t) b->repeats, sizeof(*cold)), *warm = calloc((size_t) b->repeats, sizeof(*warm));
    struct pell_render_result p = { 0 };
    struct pell_light *const all = scene->lights;
    const size_t lights = scene->num_lights;
    const int repeats = repeats_of(b, full);
    enum pell_result res = cold && warm ? PELL_OK : PELL_ERR_NOMEM;
    char name[96];

    PELL_TRY(res);
    scene->lights = all + v->first;
    scene->num_lights = (size_t) v->lights;
    b->s.settings.width = full ? 2500 : 1280;
    b->s.settings.height = full ? 1500 : 720;
    PELL_TRY(pell_renderer_set_scene(b->s.renderer, scene));
    snprintf(name, sizeof(name), "size=%d tsm=%s tsm-size=%d charts=planar", full ? 2048 : 1024, v->tsm, full ? 2048 : 1024);
    PELL_TRY(bench_choose(b, "texture-space", name));
    PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p)); /* computes the surface's layout, and touches all memory once */
    for (int i = 0; i < repeats; i++) {
        b->s.settings.seed++; /* lighting is kept for one seed */
        PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
        cold[i] = bench_own_ms(&p);
        if (stages && i + 1 == repeats)
            add_stages(b, &p);
        PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
        warm[i] = bench_own_ms(&p);
    }
    snprintf(name, sizeof(name), "%s, %s, all anew", full ? "full" : "low", v->name);
    bench_add(&b->rows, name, bench_median(cold, repeats));
    snprintf(name, sizeof(name), "%s, %s, lights at rest", full ? "full" : "low", v->name);
    bench_add(&b->rows, name, bench_median(warm, repeats));

fail:
    scene->lights = all;
    scene->num_lights = lights;
    free(cold);
    free(warm);
    return res;
}

/* Waves as high as a fiftieth of the mesh, which moves with `phase`. `rest`: the undeformed vertices. */
static void wave(struct pell_scene *scene, const float *rest, double phase)
{
    const float amplitude = 0.02f * (scene->bounds_max[1] - scene->bounds_min[1]);
    struct pell_mesh *m = &scene->meshes[0];

    for (size_t i = 0; i < (size_t) m->num_vertices; i++) {
        const float *p = rest + 3 * i;
        m->position[3 * i] = p[0] + amplitude * sinf((float) phase + 0.1f * p[1] / amplitude);
        m->position[3 * i + 1] = p[1] + 0.3f * amplitude * cosf((float) phase + 0.15f * p[0] / amplitude);
    }
}

/* Frames of a deforming mesh, under one light with its translucent shadow map: all data of the method are recomputed in each, except the
 * topology of the layout. */
static enum pell_result deform(struct bench *b)
{
    struct pell_scene *scene = b->s.scene;
    const size_t size = 3 * (size_t) scene->meshes[0].num_vertices;
    float *rest = calloc(size, sizeof(*rest));
    double *layout = calloc((size_t) b->repeats, sizeof(*layout)), *own = calloc((size_t) b->repeats, sizeof(*own)), once = 0.0;
    struct pell_light *const all = scene->lights;
    const size_t lights = scene->num_lights;
    struct pell_render_result p;
    char name[96];
    enum pell_result res = rest && layout && own ? PELL_OK : PELL_ERR_NOMEM;

    PELL_TRY(res);
    memcpy(rest, scene->meshes[0].position, size * sizeof(*rest));
    scene->lights = all + 1;
    scene->num_lights = 1;
    PELL_TRY(bench_choose(b, "texture-space", "size=1024 charts=planar"));
    for (int i = -1; i < b->repeats; i++) {
        wave(scene, rest, 0.2 * i);
        PELL_TRY(pell_renderer_set_scene(b->s.renderer, scene));
        PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
        if (i < 0) {
            once = bench_stage_ms(&p, "layout");
            continue;
        }
        layout[i] = bench_stage_ms(&p, "layout");
        own[i] = bench_own_ms(&p);
    }
    snprintf(name, sizeof(name), "low, deforming, %u triangles, layout once", scene->meshes[0].num_triangles);
    bench_add(&b->rows, name, once);
    bench_add(&b->rows, "low, deforming, per frame, its layout", bench_median(layout, b->repeats));
    bench_add(&b->rows, "low, deforming, per frame, 1 light alone, TSM", bench_median(own, b->repeats));
    memcpy(scene->meshes[0].position, rest, size * sizeof(*rest));
    PELL_TRY(pell_renderer_set_scene(b->s.renderer, scene));

fail:
    scene->lights = all;
    scene->num_lights = lights;
    free(rest);
    free(layout);
    free(own);
    return res;
}

enum pell_result bench_deon(struct bench *b)
{
    static const struct variant variants[] = {
        { "environment", 0, 1, "off" },   { "1 light", 0, 2, "off" },          { "1 light, TSM", 0, 2, "ray" },
        { "2 lights, TSM", 0, 3, "ray" }, { "1 light, tsm=map", 0, 2, "map" }, { "2 lights, tsm=map", 0, 3, "map" },
    };
    static const struct variant alone = { "1 light alone", 1, 1, "off" }, alone_tsm = { "1 light alone, TSM", 1, 1, "ray" };
    enum pell_result res = PELL_OK;

    if (b->s.scene->num_lights != LIGHTS)
        return pell_error(b->cli->ctx, PELL_ERR_INVALID, b->path, NULL, "has %zu lights, the bench takes an environment and %d",
                          b->s.scene->num_lights, LIGHTS - 1);
    b->s.settings.ambient_samples = AMBIENT_SAMPLES;
    snprintf(b->setup, sizeof(b->setup),
             "medians of frames of the method's own stages; full: %d, 2048 x 2048 texels, 2500 x 1500 pixels, low: %d, 1024 x 1024, "
             "1280 x 720",
             repeats_of(b, true), repeats_of(b, false));
    for (int full = 1; full >= 0; full--)
        for (size_t i = 0; i < PELL_COUNT(variants); i++)
            PELL_TRY(measure(b, &variants[i], full, false));
    PELL_TRY(measure(b, &alone, false, false));
    PELL_TRY(measure(b, &alone_tsm, false, true));
    PELL_TRY(deform(b));

fail:
    return res;
}
