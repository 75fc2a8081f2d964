/* SPDX-License-Identifier: MIT
 * indirect.c - `pellucid-bench truth-gap`: time of indirect light: links of a first frame by samples, moved lights by bounces, and the
 * stage "irradiance" of a frame that keeps both, next to the same without; and diffusion in solids (render/indirect/diffusion.c). */
#include "papers.h"

#include <string.h>

/* Medians of a stage over repeated frames, each after a call of `change`; NULL: no change. */
static enum pell_result measure(struct bench *b, const char *stage, void (*change)(struct pell_settings *s), double *ms)
{
    double values[64];
    const int repeats = b->repeats < 64 ? b->repeats : 64;
    enum pell_result res;

    for (int i = 0; i < repeats; i++) {
        struct pell_render_result p;
        if (change)
            change(&b->s.settings);
        PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, &p));
        values[i] = bench_stage_ms(&p, stage);
    }
    *ms = bench_median(values, repeats);
    return PELL_OK;

fail:
    return res;
}

static void new_links(struct pell_settings *s)
{
    s->seed++;
}

/* Lights are prepared again when their sampling changes. */
static void new_lights(struct pell_settings *s)
{
    s->environment_lights = s->environment_lights == 24 ? 25 : 24;
}

static void add(struct bench *b, const char *name, double ms, double to, const char *against)
{
    struct row *r = bench_add(&b->rows, name, ms);

    if (r && against) {
        r->ratio = ms / to;
        r->against = against;
    }
}

enum pell_result bench_indirect(struct bench *b)
{
    static const int samples[] = { 4096, 16384, 65536 }, bounces[] = { 1, 8, 64 };
    double first = 0.0, still = 0.0, ms;
    enum pell_result res;
    char name[96];

    PELL_TRY(pell_renderer_set_method(b->s.renderer, NULL, NULL));
    snprintf(b->setup, sizeof(b->setup), "%d x %d pixels, %d threads; medians of %d frames", b->s.settings.width, b->s.settings.height,
             pell_device_threads(pell_renderer_device(b->s.renderer)), b->repeats);
    b->s.settings.bounces = 8;
    for (size_t i = 0; i < PELL_COUNT(samples); i++) {
        b->s.settings.indirect_samples = samples[i];
        PELL_TRY(measure(b, "indirect links", new_links, &ms));
        snprintf(name, sizeof(name), "first frame: links, %d samples", samples[i]);
        first = i == 0 ? ms : first;
        add(b, name, ms, first, i > 0 ? "4096 samples" : NULL);
    }
    b->s.settings.indirect_samples = samples[1];
    for (size_t i = 0; i < PELL_COUNT(bounces); i++) {
        b->s.settings.bounces = bounces[i];
        PELL_TRY(measure(b, "indirect light", new_lights, &ms));
        snprintf(name, sizeof(name), "lights moved: %d bounce%s", bounces[i], bounces[i] > 1 ? "s" : "");
        first = i == 0 ? ms : first;
        add(b, name, ms, first, i > 0 ? "1 bounce" : NULL);
    }
    for (int on = 0; on < 2; on++) {
        b->s.settings.bounces = on ? 8 : 0;
        PELL_TRY(measure(b, "irradiance", NULL, &ms));
        still = on ? still : ms;
        add(b, on ? "every frame: irradiance with it" : "every frame: irradiance without", ms, still, on ? "without" : NULL);
    }
    PELL_TRY(bench_choose(b, "screen-space", ""));
    PELL_TRY(measure(b, "through", new_links, &first));
    add(b, "first frame: light through solids, screen-space", first, first, NULL);
    PELL_TRY(measure(b, "through", new_lights, &ms));
    add(b, "lights moved: light through solids", ms, first, "first frame");

fail:
    return res;
}
