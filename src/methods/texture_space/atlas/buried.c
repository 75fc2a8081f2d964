/* SPDX-License-Identifier: MIT
 *
 * buried.c - parts of a solid that are pushed into each other: texels inside of another part have no light, and the blurs would carry that
 * out as a dark seam along the line where parts meet. They are taken out of their charts. Parts that do not overlap are not looked at.
 */
#include "methods/texture_space/atlas/internal.h"

#include "visibility/buried.h"

#include <string.h>

#define CLEAR 1e-4f   /* of the largest coordinate, and of a texel: how far from the surface rays start */
#define PARTS_MOST 64 /* whose boxes are compared; of more, all are looked at */

/* A connected part of the surface. */
struct part {
    struct pell_vec3 low, high;
    bool meets; /* the box of another one */
};

struct search {
    struct ts_atlas_build *b;
    const int32_t *of; /* part of each triangle */
    const struct part *parts;
    int *count; /* per band */
};

/* Numbers connected parts; returns how many there are. `todo` has room for all triangles. */
static int32_t number_parts(const struct ts_atlas_build *b, int32_t *of, uint32_t *todo)
{
    const struct ts_atlas *a = b->a;
    int32_t count = 0;

    for (uint32_t t = 0; t < a->num_triangles; t++)
        of[t] = -1;
    for (uint32_t seed = 0; seed < a->num_triangles && !pell_cancelled_at(b->ctx, seed); seed++) {
        uint32_t n = 0;
        if (of[seed] >= 0)
            continue;
        of[seed] = count;
        todo[n++] = seed;
        while (n > 0) {
            const uint32_t t = todo[--n];
            for (uint32_t h = 3 * t; h < 3 * t + 3; h++)
                if (a->twin[h] != NONE && of[a->twin[h] / 3] < 0) {
                    of[a->twin[h] / 3] = count;
                    todo[n++] = a->twin[h] / 3;
                }
        }
        count++;
    }
    return count;
}

static bool apart(const struct part *p, const struct part *q)
{
    return p->low.x > q->high.x || q->low.x > p->high.x || p->low.y > q->high.y || q->low.y > p->high.y || p->low.z > q->high.z ||
           q->low.z > p->high.z;
}

/* False: no two boxes meet. */
static bool compare_boxes(const struct ts_atlas_build *b, const int32_t *of, struct part *parts, int32_t count)
{
    bool any = false;

    for (int32_t i = 0; i < count; i++)
        parts[i] = (struct part) { { INFINITY, INFINITY, INFINITY }, { -INFINITY, -INFINITY, -INFINITY }, count > PARTS_MOST };
    for (uint32_t t = 0; t < b->a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        struct part *p = &parts[of[t]];
        struct pell_vec3 corner[3];
        corner_points(b->a, t, corner);
        for (int k = 0; k < 3; k++) {
            p->low = vec3(fminf(p->low.x, corner[k].x), fminf(p->low.y, corner[k].y), fminf(p->low.z, corner[k].z));
            p->high = vec3(fmaxf(p->high.x, corner[k].x), fmaxf(p->high.y, corner[k].y), fmaxf(p->high.z, corner[k].z));
        }
    }
    for (int32_t i = 0; i < count && count <= PARTS_MOST; i++)
        for (int32_t k = 0; k < i; k++)
            if (!apart(&parts[i], &parts[k]))
                parts[i].meets = parts[k].meets = any = true;
    return any || count > PARTS_MOST;
}

/* Tests the texels that were collected. */
static int flush(struct ts_atlas_build *b, const struct pell_buried_place *places, const ptrdiff_t *at, int count)
{
    bool buried[PELL_PACKET];
    int found = 0;

    pell_buried16(b->p->scene, b->p->rays, places, count, buried);
    for (int i = 0; i < count; i++) {
        b->buried[at[i]] = buried[i];
        found += buried[i];
    }
    return found;
}

static void search_band(void *arg, int band, int worker)
{
    struct search *s = arg;
    struct ts_atlas *a = s->b->a;
    struct pell_buried_place places[PELL_PACKET];
    ptrdiff_t texels[PELL_PACKET];
    int count = 0;

    (void) worker;
    s->count[band] = 0;
    for (int y = band * BAND; y < (band + 1) * BAND && y < a->height && !pell_cancelled(s->b->ctx); y++)
        for (ptrdiff_t at = y * a->stride; at < y * a->stride + a->width; at++) {
            struct pell_buried_place *p = &places[count];
            float largest;
            if (a->source[at] == NONE || !s->parts[s->of[a->source[at]]].meets)
                continue;
            ts_point_of(a, a->source[at], a->bary[0][at], a->bary[1][at], &p->at, &p->normal, &largest);
            p->clearance = CLEAR * fmaxf(largest, (float) a->mm_per_texel);
            p->object = a->scene->meshes[a->triangles[a->source[at]].mesh].object;
            texels[count++] = at;
            if (count == PELL_PACKET) {
                s->count[band] += flush(s->b, places, texels, count);
                count = 0;
            }
        }
    s->count[band] += count ? flush(s->b, places, texels, count) : 0;
}

enum pell_result ts_atlas_drop_buried(struct ts_atlas_build *b, uint32_t *todo)
{
    struct ts_atlas *a = b->a;
    const int bands = (a->height + BAND - 1) / BAND;
    int32_t *of = NULL, count;
    struct part *parts = NULL;
    struct search s = { .b = b };
    enum pell_result res = PELL_OK;

    if (a->scene->animated) /* parts that move dig each other out */
        return PELL_OK;
    of = pell_alloc_array(b->ctx, (size_t) a->num_triangles + 1, sizeof(*of));
    res = PELL_ERR_NOMEM;
    if (!of)
        goto fail;
    count = number_parts(b, of, todo);
    parts = pell_alloc_array(b->ctx, (size_t) count + 1, sizeof(*parts));
    s.count = pell_calloc(b->ctx, (size_t) bands, sizeof(*s.count));
    if (!parts || !s.count)
        goto fail;
    res = PELL_OK;
    if (count < 2 || !compare_boxes(b, of, parts, count))
        goto fail;
    res = PELL_ERR_NOMEM;
    b->buried = pell_calloc(b->ctx, a->size, sizeof(*b->buried));
    if (!b->buried)
        goto fail;
    s.of = of;
    s.parts = parts;
    pell_pool_run(b->p->pool, bands, search_band, &s);
    for (int i = 0; i < bands; i++)
        a->buried += s.count[i];
    for (int y = 0; y < a->height && a->buried > 0; y++)
        for (ptrdiff_t at = y * a->stride; at < y * a->stride + a->width; at++)
            if (b->buried[at]) {
                a->source[at] = NONE;
                a->key[at] = 0.0f;
                a->length[0][at] = a->length[1][at] = 0.0f;
            }
    b->claimed -= a->buried;
    res = pell_cancelled(b->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(b->ctx, s.count);
    pell_free(b->ctx, parts);
    pell_free(b->ctx, of);
    return res;
}
