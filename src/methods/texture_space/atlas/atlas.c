/* SPDX-License-Identifier: MIT
 *
 * atlas.c - the parametrisation of a solid's surface: charts, texels, and the surface points of texels. Calls the steps in order.
 */
#include "methods/texture_space/atlas/internal.h"

#include <string.h>

#define MAX_OVERLAP 0.01    /* fraction of the texels that two triangles may claim in an accepted layout */
#define MAX_DEGENERATE 0.02 /* fraction of the area whose triangles are degenerate in the layout */
#define MAX_COVERAGE 4.0    /* how many times a layout may cover the map to be examined further */
#define OVERLAPS "its texture coordinates overlap"
#define MIN_COVERAGE 0.02           /* fraction of the layout's rectangle that is covered */
#define MAX_SEPARATED 128           /* maximum number of charts that are separated */
#define MIN_SEPARATED_COVERAGE 0.15 /* fraction of the map that separated charts must cover; planar charts do better */

void ts_atlas_destroy(struct ts_atlas **atlas)
{
    struct ts_atlas *a = *atlas;

    if (!a)
        return;
    *atlas = NULL;
    pell_free(a->ctx, a->triangles);
    pell_free(a->ctx, a->first);
    pell_free(a->ctx, a->corners);
    pell_free(a->ctx, a->chart);
    pell_free(a->ctx, a->twin);
    if (a->key)
        pell_free(a->ctx, a->key - TS_MARGIN);
    pell_free(a->ctx, a->source);
    pell_free(a->ctx, a->metric);
    pell_free(a->ctx, a->orientations);
    pell_free(a->ctx, a->first_orientation);
    pell_free(a->ctx, a->borders);
    pell_free(a->ctx, a->fills);
    pell_free(a->ctx, a->first_with_sources);
    pell_free(a->ctx, a->first_border);
    pell_free(a->ctx, a->sources);
    pell_free(a->ctx, a->runs);
    pell_free(a->ctx, a->first_run);
    pell_free(a->ctx, a->cells);
    pell_free(a->ctx, a);
}

static enum pell_result list_triangles(struct ts_atlas_build *b)
{
    const struct pell_scene *scene = b->p->scene;
    struct ts_atlas *a = b->a;
    size_t count = 0;
    enum pell_result res;

    b->meshes = pell_calloc(b->ctx, scene->num_meshes + 1, sizeof(*b->meshes));
    a->first = pell_alloc_array(b->ctx, scene->num_meshes + 1, sizeof(*a->first));
    if (!b->meshes || !a->first)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        a->first[i] = NONE;
        if (b->p->solids->of_mesh[i] != (int32_t) b->p->solid)
            continue;
        b->meshes[b->num_meshes++] = (uint32_t) i;
        a->first[i] = (uint32_t) count;
        count += scene->meshes[i].num_triangles;
    }
    if (count > UINT32_MAX / 8)
        return pell_error(b->ctx, PELL_ERR_UNSUPPORTED, b->p->name, NULL, "%zu triangles, at most %u in an object", count, UINT32_MAX / 8);
    a->num_triangles = (uint32_t) count;
    a->triangles = pell_alloc_array(b->ctx, count + 1, sizeof(*a->triangles));
    a->corners = pell_calloc(b->ctx, count + 1, sizeof(*a->corners));
    a->chart = pell_calloc(b->ctx, count + 1, sizeof(*a->chart));
    a->twin = pell_alloc_array(b->ctx, 3 * count + 1, sizeof(*a->twin));
    b->area = pell_calloc(b->ctx, count + 1, sizeof(*b->area));
    if (!a->triangles || !a->corners || !a->chart || !a->twin || !b->area)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < b->num_meshes; i++)
        for (uint32_t t = 0; t < scene->meshes[b->meshes[i]].num_triangles && !pell_cancelled_at(b->ctx, t); t++)
            a->triangles[a->first[b->meshes[i]] + t] = (struct ts_triangle) { b->meshes[i], t };
    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        b->area[t] = area_of(a, t);
        b->total_area += b->area[t];
    }
    if (pell_cancelled(b->ctx))
        return PELL_ERR_CANCELLED;
    PELL_TRY(pell_topology_make(&b->topology, scene, b->meshes, b->num_meshes));
    for (size_t h = 0; h < 3 * count; h++)
        a->twin[h] = NONE;
    for (uint32_t e = 0, end, edges = 0; e < b->topology.num_halves && !pell_cancelled_at(b->ctx, edges++); e = end) {
        end = pell_topology_edge(&b->topology, e);
        if (end - e == 2 && b->topology.half[e] / 3 != b->topology.half[e + 1] / 3) {
            a->twin[b->topology.half[e]] = b->topology.half[e + 1];
            a->twin[b->topology.half[e + 1]] = b->topology.half[e];
        }
    }
    return pell_cancelled(b->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

/* Numbers the charts of the laid out corners and finds the texels they cover. `defect`: the layout's defect, or NULL. */
static enum pell_result cover(struct ts_atlas_build *b, uint32_t *order, const char **defect)
{
    struct ts_atlas *a = b->a;
    double flat = 0.0;
    enum pell_result res;

    ts_atlas_number_charts(b, order);
    PELL_TRY(ts_atlas_make_planes(b));
    ts_atlas_rasterize(b);
    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++)
        if (b->area[t] > 0.0 && !(fabs(flat_area(a->corners[t])) > 1e-9))
            flat += b->area[t];
    if (pell_cancelled(b->ctx)) /* its defects are unknown */
        return PELL_ERR_CANCELLED;
    a->degenerate = flat / b->total_area;
    a->overlap = b->claimed > 0 ? (double) b->twice / (double) b->claimed : 0.0;
    *defect = NULL;
    if (a->degenerate > MAX_DEGENERATE)
        *defect = "part of it has no area in its texture coordinates";
    else if (a->overlap > MAX_OVERLAP)
        *defect = OVERLAPS;
    else if ((double) b->claimed < MIN_COVERAGE * a->width * a->height)
        *defect = "its texture coordinates leave most of the map empty";
    return PELL_OK;

fail:
    return res;
}

/* Area of the laid out triangles, texels; overlaps count several times. */
static double covered(const struct ts_atlas_build *b)
{
    double sum = 0.0;

    for (uint32_t t = 0; t < b->a->num_triangles && !pell_cancelled_at(b->ctx, t); t++)
        sum += fabs(flat_area(b->a->corners[t]));
    return sum;
}

/* Uses a set of texture coordinates unchanged. */
static enum pell_result lay_out_set(struct ts_atlas_build *b, int set, uint32_t *order, const char **defect)
{
    *defect = ts_atlas_lay_out_file(b, set);
    if (*defect)
        return b->p->charts == TS_CHARTS_UV
                   ? pell_error(b->ctx, PELL_ERR_INVALID, b->p->name, "let the method choose: charts=auto", "%s", *defect)
                   : PELL_OK;
    if (covered(b) > MAX_COVERAGE * b->a->width * b->a->height) {
        *defect = OVERLAPS;
        return PELL_OK;
    }
    return cover(b, order, defect);
}

/* Uses the first set whose charts do not overlap, else the charts of the first set after separating them, else planar charts. */
static enum pell_result lay_out(struct ts_atlas_build *b, uint32_t *order)
{
    struct ts_atlas *a = b->a;
    const char *defect = NULL, *remaining_defect = NULL;
    enum pell_result res;

    for (int set = 0; set < PELL_UV_SETS && b->p->charts != TS_CHARTS_PLANAR; set++) {
        const char *fault;
        if (set > 0 && !ts_atlas_has_set(b, set))
            continue;
        PELL_TRY(lay_out_set(b, set, order, &fault));
        if (!fault || b->p->charts == TS_CHARTS_UV)
            return PELL_OK;
        defect = set == 0 ? fault : defect;
    }
    if (defect && strcmp(defect, OVERLAPS) == 0 && !ts_atlas_lay_out_file(b, 0)) {
        ts_atlas_number_charts(b, order);
        if (a->num_charts <= MAX_SEPARATED && !pell_cancelled(b->ctx)) {
            PELL_TRY(ts_atlas_separate(b));
            remaining_defect = OVERLAPS;
            if (covered(b) >= MIN_SEPARATED_COVERAGE * a->width * a->height)
                PELL_TRY(cover(b, order, &remaining_defect));
            if (!remaining_defect) {
                a->charts_separated = true;
                a->defect = defect;
                return PELL_OK;
            }
        }
    }
    PELL_TRY(ts_atlas_lay_out_planar(b, order));
    a->defect = defect;
    a->lacks_uv = !a->scene->meshes[b->meshes[0]].uv[0];
    PELL_TRY(ts_atlas_make_planes(b));
    ts_atlas_rasterize(b);
    return pell_cancelled(b->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

enum pell_result ts_atlas_make(struct pell_context *ctx, const struct ts_atlas_params *params, struct ts_atlas **out)
{
    struct ts_atlas *a = pell_zalloc(ctx, sizeof(*a));
    struct ts_atlas_build b = { .ctx = ctx, .p = params, .a = a };
    uint32_t *order = NULL;
    uint8_t *far = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!a)
        return PELL_ERR_NOMEM;
    a->ctx = ctx;
    a->scene = params->scene;
    a->border = params->border;
    a->hash = ts_atlas_hash(params->scene, params->solids, params->solid);
    PELL_TRY(list_triangles(&b));
    a->positions = ts_atlas_positions(a);
    a->metric = pell_alloc_array(ctx, (size_t) a->num_triangles + 1, sizeof(*a->metric));
    order = pell_alloc_array(ctx, 2 * (size_t) a->num_triangles + 1, sizeof(*order));
    if (!order || !a->metric) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    PELL_TRY(lay_out(&b, order));
    a->mm_per_texel = b.claimed > 0 ? sqrt(b.total_area / (double) b.claimed) : 1.0;
    ts_atlas_rescue(&b);
    if (pell_cancelled(ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    PELL_TRY(ts_atlas_drop_buried(&b));
    a->inner = b.claimed;
    far = pell_alloc_array(ctx, a->size, sizeof(*far));
    if (!far) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    b.texel_position = pell_alloc_array(ctx, a->size, sizeof(*b.texel_position));
    if (!b.texel_position) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    PELL_TRY(ts_atlas_find_borders(&b));
    PELL_TRY(ts_atlas_fix_seams(&b));
    ts_atlas_measure_far(a, far);
    PELL_TRY(ts_atlas_sort_borders(&b, far + TS_MARGIN));
    PELL_TRY(ts_atlas_find_runs(&b, far + TS_MARGIN));
    for (int y = 0; y < a->height; y++)
        for (ptrdiff_t at = y * a->stride; at < y * a->stride + a->width; at++)
            if (a->source[at] != NONE)
                b.texel_position[at] = position_of(a, a->source[at], a->bary[0][at], a->bary[1][at]);
    if (a->scene->animated)
        ts_atlas_tilt_by_lengths(a, params->pool); /* so that a film's first frame is treated like the others */
    else
        ts_atlas_tilt(&b);
    *out = a;
    a = NULL;

fail:
    pell_topology_finish(&b.topology);
    pell_free(ctx, b.meshes);
    pell_free(ctx, b.area);
    pell_free(ctx, order);
    pell_free(ctx, far);
    pell_free(ctx, b.buried);
    pell_free(ctx, b.texel_position);
    pell_free(ctx, b.border_source);
    ts_atlas_destroy(&a);
    return res;
}
