/* SPDX-License-Identifier: MIT
 *
 * borders.c - light from beyond the picture, where an object goes on there. A straight border d mm away hides
 *
 *     H(d) = Int_d^inf L(x) dx = 1/pi Int_d^inf acos(d/r) dC(r)        L: R along a line, C: light inside circles, of all
 *
 * of what comes to a pixel, where the object has no end; else less H where the scene's box ends. It is taken to be as bright as the rest:
 * the pixel's light is divided by 1 - H of each border at which the pixel in its row or column is of the same object.
 */
#include "methods/convolution/state.h"

#include "render/services.h"
#include "transport/solids.h"

#include <stdlib.h>
#include <string.h>

#define REACH 0.01 /* share of the light that may come from farther away */
enum { RADII = 128 };

static void make_table(const struct conv_radial *r, struct conv_border *b)
{
    double radius[RADII];

    b->reach = r->point ? 0.0f : (float) (r->radius * pell_profile_sample(r->profile, 1.0 - REACH));
    if (!(b->reach > 0.0f))
        return;
    for (int i = 0; i < RADII; i++)
        radius[i] = r->radius * pell_profile_sample(r->profile, (i + 0.5) / RADII);
    for (int k = 0; k <= CONV_BORDER_STEPS; k++) {
        const double t = (double) k / CONV_BORDER_STEPS, d = (double) b->reach * t * t;
        double sum = 0.0;
        for (int i = 0; i < RADII; i++)
            sum += d < radius[i] ? acos(d / radius[i]) : 0.0;
        b->hidden[k] = (float) (sum / (RADII * PELL_PI));
    }
}

/* `edges` takes the border for one of them, and the surface to go on as far as its window. */
static void find_known(const struct conv_edges *e, const struct conv_radial *r, struct conv_border *b)
{
    float sum = 0.0f;

    memset(b->known, 0, sizeof(b->known));
    for (int x = CONV_WINDOW; x > 0 && e->fade > 0.0f && r->total > 0.0f; x--) {
        for (int y = -CONV_WINDOW; y <= CONV_WINDOW; y++)
            sum += e->square[abs(y)][x];
        b->known[x - 1] = e->fade * sum / r->total;
    }
}

/* Pixels from each border of the picture to where the scene ends; the ground has no end. */
static void find_ends(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const struct pell_scene *scene = st->services->scene;
    const int width = j->in->shape.width, height = j->in->shape.height;
    struct pell_view view = st->sources.view;
    struct pell_rect rect;

    view.width = 3 * width; /* the picture is the middle of it */
    view.height = 3 * height;
    rect = pell_view_rect(&view, scene->bounds_min, scene->bounds_max);
    if (scene->ground_mesh >= 0 && st->solids->of_mesh[scene->ground_mesh] == (int) j->group)
        rect = (struct pell_rect) { 0, 0, view.width, view.height };
    j->beyond[CONV_LEFT] = rect.x0 > 0 ? fmaxf((float) (width - rect.x0), 0.0f) : INFINITY;
    j->beyond[CONV_RIGHT] = rect.x1 < view.width ? fmaxf((float) (rect.x1 - 2 * width), 0.0f) : INFINITY;
    j->beyond[CONV_TOP] = rect.y0 > 0 ? fmaxf((float) (height - rect.y0), 0.0f) : INFINITY;
    j->beyond[CONV_BOTTOM] = rect.y1 < view.height ? fmaxf((float) (rect.y1 - 2 * height), 0.0f) : INFINITY;
}

void convolution_find_borders(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct pell_frame_shape *shape = &j->in->shape;

    j->cut = st->solids && st->knobs.as != CONV_PAPER && st->knobs.borders == CONV_BORDERS_AUTO && !j->divide &&
             (rect->x0 == 0 || rect->y0 == 0 || rect->x1 == shape->width || rect->y1 == shape->height);
    if (j->cut)
        find_ends(st);
    for (int c = 0; c < 3 && j->cut; c++) {
        make_table(&j->radial[c], &j->border[c]);
        find_known(&j->edges[c], &j->radial[c], &j->border[c]);
    }
}

/* H at a distance, mm. */
static float hidden_at(const struct conv_border *b, float distance)
{
    const float t = CONV_BORDER_STEPS * sqrtf(distance / b->reach);
    const int k = t < CONV_BORDER_STEPS ? (int) t : CONV_BORDER_STEPS;

    return t < CONV_BORDER_STEPS ? b->hidden[k] + (t - (float) k) * (b->hidden[k + 1] - b->hidden[k]) : 0.0f;
}

/* Share of a pixel's light that one border does not hide, `pixels` away, where the picture ends at the pixel `end`. */
static float shown(const struct convolution_state *st, enum conv_side side, ptrdiff_t at, ptrdiff_t end, ptrdiff_t end_group, float pixels)
{
    const struct conv_job *j = &st->job;
    const struct conv_border *b = &j->border[j->channel];
    const float depth = j->in->depth[at], pixel = conv_pixel_at(j->in, depth), across = pixels * pixel;
    float along, hidden;

    if (!(across < b->reach) || st->sources.front.group[end_group] != j->group + 1)
        return 1.0f;
    along = j->in->depth[end] - depth;
    hidden = hidden_at(b, sqrtf(across * across + along * along)) - hidden_at(b, across + j->beyond[side] * pixel);
    if (pixels < CONV_WINDOW)
        hidden -= b->known[(int) pixels];
    return 1.0f - fmaxf(hidden, 0.0f);
}

void convolution_make_up_row(const struct convolution_state *st, int y, float *out)
{
    const struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct pell_frame_shape *shape = &j->in->shape;
    const ptrdiff_t stride = shape->stride, groups = st->sources.front.stride;
    const int right = shape->width - 1, bottom = shape->height - 1;

    for (int x = rect->x0; x < rect->x1; x++) {
        const ptrdiff_t at = y * stride + x;
        float sides;
        if (st->sources.front.group[y * groups + x] != j->group + 1)
            continue;
        sides = shown(st, CONV_LEFT, at, y * stride, y * groups, (float) x + 0.5f);
        sides *= shown(st, CONV_RIGHT, at, y * stride + right, y * groups + right, (float) (right - x) + 0.5f);
        sides *= shown(st, CONV_TOP, at, x, x, (float) y + 0.5f);
        sides *= shown(st, CONV_BOTTOM, at, bottom * stride + x, bottom * groups + x, (float) (bottom - y) + 0.5f);
        out[x] /= sides; /* a sixteenth at least */
    }
}
