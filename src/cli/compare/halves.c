/* SPDX-License-Identifier: MIT
 * halves.c - a sampled reference as the mean of two independent images, each with half of its work. */
#include "cli/compare/compare.h"

#include <string.h>

static const struct pell_knob *half_knob(const struct pell_method *method)
{
    return method ? pell_knob_find(method->knobs, "half") : NULL;
}

int halves_of(const struct run *run)
{
    const struct pell_knob *k = half_knob(run->method);
    int half = 1;

    if (k)
        memcpy(&half, (const char *) run->values + k->offset, sizeof(half));
    return half == 0 ? 2 : 1; /* a single half requested by the user is an ordinary image */
}

void halves_choose(const struct pell_method *method, void *values, int half)
{
    const struct pell_knob *k = half_knob(method);

    if (k)
        memcpy((char *) values + k->offset, &half, sizeof(half));
}

/* Copies what the renderer owns until its next image. */
static enum pell_result keep(struct cli *cli, const struct pell_render_result *p, struct halves *h)
{
    const size_t pixels = (size_t) p->width * (size_t) p->height;

    h->planes = pell_alloc_array(cli->ctx, pixels, p->num_channels * sizeof(float));
    h->channels = pell_alloc_array(cli->ctx, p->num_channels, sizeof(*h->channels));
    h->stages = pell_alloc_array(cli->ctx, p->num_stages + 1, sizeof(*h->stages));
    h->names = pell_alloc_array(cli->ctx, p->num_stages + 1, sizeof(*h->names));
    if (!h->planes || !h->channels || !h->stages || !h->names)
        return PELL_ERR_NOMEM;
    for (size_t k = 0; k < p->num_channels; k++)
        for (int y = 0; y < p->height; y++)
            memcpy(h->planes + k * pixels + (size_t) y * (size_t) p->width, p->channels[k].data + y * p->channels[k].stride,
                   (size_t) p->width * sizeof(float));
    for (size_t i = 0; i < p->num_stages; i++) {
        h->stages[i] = p->stages[i];
        snprintf(h->names[i], sizeof(h->names[i]), "%s", p->stages[i].name);
        h->stages[i].name = h->names[i];
    }
    h->first = *p;
    return PELL_OK;
}

/* Joins two halves: means of the values, a quarter of the sum of the variances, sums of the costs. */
static void join(struct pell_render_result *p, struct halves *h)
{
    const size_t pixels = (size_t) p->width * (size_t) p->height;

    for (size_t k = 0; k < p->num_channels; k++) {
        const float weight = strncmp(p->channels[k].name, "variance.", 9) == 0 ? 0.25f : 0.5f;
        float *to = h->planes + k * pixels;
        for (int y = 0; y < p->height; y++)
            for (int x = 0; x < p->width; x++, to++)
                *to = weight * *to + weight * p->channels[k].data[y * p->channels[k].stride + x];
        h->channels[k] = (struct pell_channel) { p->channels[k].name, h->planes + k * pixels, p->width, p->channels[k].full_float };
    }
    for (size_t i = 0; i < p->num_stages; i++)
        for (size_t k = 0; k < h->first.num_stages; k++)
            if (strcmp(h->names[k], p->stages[i].name) == 0) { /* stages that the renderer caches are missing in the second image */
                struct pell_stage_time *t = &h->stages[k];
                t->ms += p->stages[i].ms;
                t->pixels += p->stages[i].pixels;
                t->rays += p->stages[i].rays;
                t->bytes += p->stages[i].bytes;
                t->bandwidth_ms += p->stages[i].bandwidth_ms;
            }
    p->num_stages = h->first.num_stages;
    p->stages = h->stages;
    p->channels = h->channels;
    p->seconds += h->first.seconds;
    p->invalid += h->first.invalid;
}

enum pell_result halves_add(struct cli *cli, struct pell_render_result *image, struct halves *h)
{
    if (!h->planes)
        return keep(cli, image, h);
    join(image, h);
    return PELL_OK;
}

void halves_drop(struct cli *cli, struct halves *h)
{
    pell_free(cli->ctx, h->planes);
    pell_free(cli->ctx, h->channels);
    pell_free(cli->ctx, h->stages);
    pell_free(cli->ctx, h->names);
    *h = (struct halves) { .planes = NULL };
}
