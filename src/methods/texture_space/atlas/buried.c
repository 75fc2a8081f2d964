/* SPDX-License-Identifier: MIT
 *
 * buried.c - overlapping parts of a solid: texels inside another part receive no light, and blurs would spread that as a dark seam along
 * the intersection. They are removed from their charts. Parts that do not overlap are not tested.
 */
#include "methods/texture_space/atlas/internal.h"

#include "visibility/buried.h"

#define CLEARANCE 1e-4f /* relative to the largest coordinate, and to a texel: offset of a ray's origin */
#define MAX_PARTS 64    /* with more parts, boxes are not compared and all parts are tested */

struct search {
    struct ts_atlas_build *b;
    const bool *intersects; /* per connected part: its box intersects another one's */
    int *count;             /* per band of rows */
};

static bool separate(const struct pell_part *p, const struct pell_part *q)
{
    for (int k = 0; k < 3; k++)
        if (p->min[k] > q->max[k] || q->min[k] > p->max[k])
            return true;
    return false;
}

/* False: no two boxes intersect. */
static bool compare_boxes(const struct pell_part *parts, uint32_t count, bool *intersects)
{
    bool any = count > MAX_PARTS;

    for (uint32_t i = 0; i < count; i++)
        intersects[i] = count > MAX_PARTS;
    for (uint32_t i = 0; i < count && count <= MAX_PARTS; i++)
        for (uint32_t k = 0; k < i; k++)
            if (!separate(&parts[i], &parts[k]))
                intersects[i] = intersects[k] = any = true;
    return any;
}

/* Tests the collected texels. */
static int flush(struct ts_atlas_build *b, const struct pell_buried_query *points, const ptrdiff_t *at, int count)
{
    bool buried[PELL_PACKET];
    int found = 0;

    pell_buried16(b->p->scene, b->p->rays, points, count, buried);
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
    struct pell_buried_query points[PELL_PACKET];
    ptrdiff_t texels[PELL_PACKET];
    int count = 0;

    (void) worker;
    s->count[band] = 0;
    for (int y = band * BAND; y < (band + 1) * BAND && y < a->height && !pell_cancelled(s->b->ctx); y++)
        for (ptrdiff_t at = y * a->stride; at < y * a->stride + a->width; at++) {
            struct pell_buried_query *p = &points[count];
            float largest;
            uint32_t part;
            if (a->source[at] == NONE)
                continue;
            part = s->b->topology.part[a->source[at]];
            if (part == NONE || !s->intersects[part])
                continue;
            ts_point_of(a, a->source[at], a->bary[0][at], a->bary[1][at], &p->position, &p->normal, &largest);
            p->clearance = CLEARANCE * fmaxf(largest, (float) a->mm_per_texel);
            p->object = pell_mesh_assembly(&a->scene->meshes[a->triangles[a->source[at]].mesh]);
            texels[count++] = at;
            if (count == PELL_PACKET) {
                s->count[band] += flush(s->b, points, texels, count);
                count = 0;
            }
        }
    s->count[band] += count ? flush(s->b, points, texels, count) : 0;
}

enum pell_result ts_atlas_drop_buried(struct ts_atlas_build *b)
{
    struct ts_atlas *a = b->a;
    const int bands = (a->height + BAND - 1) / BAND;
    const uint32_t count = b->topology.num_parts;
    struct pell_part *parts = NULL;
    bool *intersects = NULL;
    struct search s = { .b = b };
    enum pell_result res = PELL_ERR_NOMEM;

    if (a->scene->animated || count < 2) /* moving parts can become exposed later */
        return PELL_OK;
    parts = pell_alloc_array(b->ctx, count, sizeof(*parts));
    intersects = pell_alloc_array(b->ctx, count, sizeof(*intersects));
    s.count = pell_calloc(b->ctx, (size_t) bands, sizeof(*s.count));
    if (!parts || !intersects || !s.count)
        goto fail;
    pell_topology_parts(&b->topology, a->scene, parts);
    res = PELL_OK;
    if (!compare_boxes(parts, count, intersects))
        goto fail;
    res = PELL_ERR_NOMEM;
    b->buried = pell_calloc(b->ctx, a->size, sizeof(*b->buried));
    if (!b->buried)
        goto fail;
    s.intersects = intersects;
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
    pell_free(b->ctx, intersects);
    pell_free(b->ctx, parts);
    return res;
}
