/* SPDX-License-Identifier: MIT
 *
 * pack.c - packs planar charts into one map on shelves, at the largest scale that fits.
 */
#include "methods/texture_space/atlas/internal.h"

#include <stdlib.h>

#define MAX_SIZE 16384    /* texels per side */
#define LEAST_SCALE 0.125 /* of the one at which the surface would fill the map; below it, the map is borders */

static int by_height(const void *p, const void *q)
{
    const struct ts_flat_chart *a = p, *b = q;
    const double ha = a->high[1] - a->low[1], hb = b->high[1] - b->low[1];

    return ha > hb ? -1 : ha < hb ? 1 : a->number < b->number ? -1 : 1;
}

static int by_number(const void *p, const void *q)
{
    const struct ts_flat_chart *a = p, *b = q;

    return (a->number > b->number) - (a->number < b->number);
}

/* Packs charts on shelves at `scale` texels per mm. False: there are too many. */
static bool put_on_shelves(struct ts_flat_chart *charts, size_t count, double scale, int gutter, int size)
{
    double x = 2.0, y = 2.0, tall = 0.0;

    for (size_t i = 0; i < count; i++) {
        struct ts_flat_chart *c = &charts[i];
        const double w = (c->high[0] - c->low[0]) * scale + gutter, h = (c->high[1] - c->low[1]) * scale + gutter;
        if (x + w > size - 2.0) {
            x = 2.0;
            y += tall;
            tall = 0.0;
        }
        if (x + w > size - 2.0 || y + h > size - 2.0)
            return false;
        c->x = x + 0.5 * gutter;
        c->y = y + 0.5 * gutter;
        x += w;
        tall = fmax(tall, h);
    }
    return true;
}

enum pell_result ts_atlas_pack(struct ts_atlas_build *b, struct ts_flat_chart *charts, size_t count, double *scale)
{
    struct ts_atlas *a = b->a;
    int gutter = 0, size = b->p->size;
    double low = 0.0, full = 0.0;

    qsort(charts, count, sizeof(*charts), by_height);
    /* If they do not fit in the requested size at a useful scale, the size is doubled. */
    for (; low <= LEAST_SCALE * full && size <= MAX_SIZE; size *= 2) {
        double top;
        full = size / sqrt(b->total_area);
        low = 0.0;
        top = 2.0 * full;
        gutter = 2 * b->p->border;
        if (gutter * gutter * (double) count > 0.25 * (double) size * size)
            gutter = (int) sqrt(0.25 * (double) size * size / (double) (count ? count : 1));
        gutter = gutter > 2 ? gutter : 2;
        for (int i = 0; i < 40; i++) {
            const double middle = 0.5 * (low + top);
            if (put_on_shelves(charts, count, middle, gutter, size))
                low = middle;
            else
                top = middle;
        }
        a->width = a->height = size;
    }
    if (!(low > 0.0) || !put_on_shelves(charts, count, low, gutter, a->width))
        return pell_error(b->ctx, PELL_ERR_UNSUPPORTED, b->p->name, "give it texture coordinates",
                          "%zu charts do not fit in %d x %d texels", count, MAX_SIZE, MAX_SIZE);
    qsort(charts, count, sizeof(*charts), by_number);
    *scale = low;
    return PELL_OK;
}
