/* SPDX-License-Identifier: MIT
 *
 * layouts.c - the maps of all solids: their sizes, their layouts, and planes shared by all of them.
 */
#include "methods/texture_space/state.h"

#include "render/camera_view.h"
#include "render/engine.h"

#include <stdio.h>
#include <string.h>

#define MIN_SIZE 32.0    /* texels, for small objects next to large ones */
#define PIXEL_TEXELS 8.0 /* maximum number of texels per pixel, over the maps of all objects */
#define TAPS_REACH 3.46  /* in standard deviations */
#define COVERED 0.6      /* fraction of a map that charts are assumed to cover */
#define TEXELS_PER_PIXEL 2.0
enum { MAX_JOINED = 5 << 20 }; /* texels with margins, above 2048 x 2048: joined chains have nine more planes */

bool ts_scaled_strength(const struct ts_state *st, int32_t solid)
{
    const struct pell_scene *scene = st->services->scene;

    for (size_t i = 0; st->knobs.strength && i < scene->num_meshes; i++)
        if (st->solids->of_mesh[i] == solid) {
            const struct pell_material *m = &scene->materials[scene->meshes[i].material];
            if (m->strength != 1.0f || m->strength_map.texture)
                return true;
        }
    return false;
}

/* Reach of the widest blur's taps, for the texel length that results if charts cover 0.6 of the map. */
static int border_of(const struct ts_state *st, const struct ts_profile *p, double area, int size)
{
    double widest = 0.0, reach;

    if (st->knobs.border >= 0)
        return st->knobs.border;
    for (int i = 0; i < p->count; i++)
        widest = fmax(widest, p->variance[i] - (i > 0 ? p->variance[i - 1] : 0.0));
    reach = TAPS_REACH * sqrt(widest * COVERED * size * size / area);
    return (int) fmin(fmax(ceil(reach), 4.0), ceil(0.1 * size));
}

/* Objects that were laid out again for the same reason are reported in one line. */
static void report_layouts(struct ts_state *st, const struct pell_frame_shape *shape)
{
    for (size_t i = 0; i < st->solids->count; i++) {
        const struct ts_atlas *a = st->solid[i].atlas;
        const char *name = shape->materials[st->solids->solids[i].material].name, *defect = a ? a->defect : NULL;
        char more[64] = "";
        size_t others = 0;

        if (!defect)
            continue;
        for (size_t j = i + 1; j < st->solids->count; j++)
            if (st->solid[j].atlas && st->solid[j].atlas->defect == defect && st->solid[j].atlas->charts_separated == a->charts_separated &&
                st->solids->solids[j].material == st->solids->solids[i].material) {
                st->solid[j].atlas->defect = NULL;
                others++;
            }
        if (others)
            snprintf(more, sizeof(more), "; so are %zu other objects", others);
        if (a->charts_separated)
            pell_info(st->ctx, name, "%s: %d charts moved apart%s", defect, a->num_charts, more);
        else if (a->lacks_uv)
            pell_info(st->ctx, name, "%s: laid out in planar charts, %d in all%s", defect, a->num_charts, more);
        else
            pell_warn(st->ctx, name, "charts=planar selects this layout explicitly", "%s: laid out in planar charts, %d in all%s", defect,
                      a->num_charts, more);
    }
}

/* Side of the largest map. */
static double size_of(const struct ts_state *st)
{
    return st->knobs.size == 0 ? TS_SIZE_MAX : fmax(st->knobs.size, TS_SIZE_MIN);
}

/* Scale of all maps' sides: together they have at most four times the texels of one map of side `size`, and fewer in small images, except
 * for maps at the minimum size. */
static double texel_budget_scale(const struct ts_state *st, const struct pell_frame_shape *shape, double largest)
{
    const double size = size_of(st), one = size * size, pixels = (double) shape->width * shape->height;
    const double most = fmin(fmax(PIXEL_TEXELS * pixels, 2.0 * one), 4.0 * one);
    double all = 0.0;

    for (size_t i = 0; i < st->solids->count && largest > 0.0; i++)
        all += one * st->solids->solids[i].area / largest;
    return all > most ? sqrt(most / all) : 1.0;
}

/* Bounds of the solids. */
void ts_layouts_measure(struct ts_state *st)
{
    for (size_t i = 0; i < st->solids->count && st->knobs.size == 0; i++) { /* an explicit side needs no bounds */
        const struct pell_solid *solid = &st->solids->solids[i];
        struct ts_solid *out = &st->solid[i];
        struct pell_vec3 low = vec3(INFINITY, INFINITY, INFINITY), high = vec3(-INFINITY, -INFINITY, -INFINITY);
        for (size_t k = 0; k < solid->num_triangles && !pell_cancelled_at(st->ctx, k); k++) {
            const struct pell_mesh *mesh = &st->services->scene->meshes[solid->triangles[k].mesh];
            for (int j = 0; j < 3; j++) {
                const struct pell_vec3 p =
                    vec3_load(mesh->position + 3 * (size_t) mesh->index[3 * (size_t) solid->triangles[k].triangle + (size_t) j]);
                low = vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
                high = vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
            }
        }
        out->middle = vec3_mul(vec3_add(low, high), 0.5f);
        out->radius = 0.5f * vec3_length(vec3_sub(high, low));
    }
}

/* Side of the map whose texels match the image's resolution at the solid's nearest distance: `side`, or smaller by a power of the square
 * root of 2, so that camera motion seldom rebuilds maps. */
static double needed_side(const struct ts_state *st, size_t i, const struct pell_view *view, double side)
{
    const struct ts_solid *solid = &st->solid[i];
    const float depth = vec3_dot(vec3_sub(solid->middle, view->origin), view->forward) - solid->radius;
    const double per_mm = view->orthographic ? (double) view->focal_px : depth > 0.0f ? (double) (view->focal_px / depth) : INFINITY;
    const double needed = TEXELS_PER_PIXEL * per_mm * sqrt(st->solids->solids[i].area / COVERED);

    return st->knobs.size == 0 && needed > 0.0 && needed < side ? side * exp2(-0.5 * floor(2.0 * log2(side / needed))) : side;
}

/* The first frame's side if it is close: maps of moving objects then stay the same, in any run that renders some of the frames. */
static int keep_first(struct ts_solid *solid, int needed)
{
    if (solid->first_side == 0)
        solid->first_side = needed;
    return needed <= 2 * solid->first_side && 2 * needed >= solid->first_side ? solid->first_side : needed;
}

/* Computes the sides of all maps; true: the maps already have them. */
static bool find_sides(struct ts_state *st, const struct pell_frame *in)
{
    const struct pell_solids *b = st->solids;
    double largest = 0.0, factor;
    bool same = true;

    for (size_t i = 0; i < b->count; i++)
        largest = fmax(largest, b->solids[i].area);
    factor = texel_budget_scale(st, &in->shape, largest);
    for (size_t i = 0; i < b->count; i++) {
        const double fraction = largest > 0.0 ? factor * sqrt(b->solids[i].area / largest) : 0.0;
        const double side = fmin(fmax(ceil(size_of(st) * fraction), MIN_SIZE), size_of(st));
        const int needed = (int) ceil(fmin(fmax(needed_side(st, i, in->view, side), MIN_SIZE), side));
        const int chosen = keep_first(&st->solid[i], needed);
        same &= b->solids[i].num_triangles == 0 || st->solid[i].side == chosen;
        st->solid[i].side = chosen;
    }
    return same;
}

static enum pell_result make_atlases(struct ts_state *st, const struct pell_frame_shape *shape)
{
    const struct pell_solids *b = st->solids;
    enum pell_result res;

    for (size_t i = 0; i < b->count; i++) {
        const struct pell_solid *solid = &b->solids[i];
        const struct pell_frame_material *m = &shape->materials[solid->material];
        struct ts_profile *profile = &st->profiles[solid->material];
        struct ts_atlas_params p = {
            .pool = st->pool,
            .scene = st->services->scene,
            .rays = st->services->rays,
            .solids = b,
            .solid = i,
            .name = m->name,
            .charts = st->knobs.charts,
            .size = st->solid[i].side,
        };
        if (solid->num_triangles == 0)
            continue;
        if (profile->count == 0)
            PELL_TRY(ts_profile_make(st->ctx, m, &st->knobs, ts_is_local(st), st->services->settings->opposed, profile));
        st->solid[i].profile = profile;
        p.border = border_of(st, profile, solid->area, p.size);
        PELL_TRY(ts_atlas_make(st->ctx, &p, &st->solid[i].atlas));
        st->solid[i].map = pell_calloc(st->ctx, 4 * st->solid[i].atlas->size, sizeof(float));
        if (!st->solid[i].map)
            return PELL_ERR_NOMEM;
        st->solid[i].map += 4 * TS_MARGIN;
        st->solid[i].seen = pell_calloc(st->ctx, st->solid[i].atlas->size, sizeof(*st->solid[i].seen));
        if (!st->solid[i].seen)
            return PELL_ERR_NOMEM;
        st->solid[i].seen += TS_MARGIN;
        st->solid[i].made = TS_MADE_NOT;
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        pell_progress(st->ctx, "layouts", (double) (i + 1) / (double) b->count);
    }
    report_layouts(st, shape);
    return PELL_OK;

fail:
    return res;
}

/* Planes have the size of the largest atlas. */
static enum pell_result make_planes(struct ts_state *st)
{
    const bool seven = st->knobs.kernel == TS_KERNEL_SEVEN, transmission = st->knobs.tsm != TS_TSM_OFF;
    const struct ts_atlas **atlases = pell_calloc(st->ctx, st->solids->count + 1, sizeof(*atlases));
    size_t size = 0, cells = 0, count = 0, planes = 0;
    bool strength = false;
    int chained;
    float **list[3 * TS_PLANES + 10];
    enum pell_result res = PELL_ERR_NOMEM;

    if (!atlases)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < st->solids->count; i++) {
        const struct ts_atlas *a = st->solid[i].atlas;
        if (!a)
            continue;
        atlases[count++] = a;
        size = a->size > size ? a->size : size;
        cells = (size_t) a->blocks * (size_t) a->height > cells ? (size_t) a->blocks * (size_t) a->height : cells;
        strength |= ts_scaled_strength(st, (int32_t) i);
    }
    st->joins =
        transmission && st->run->joins && st->knobs.kernel == TS_KERNEL_DENSE && st->knobs.lights == TS_LIGHTS_OWN && size <= MAX_JOINED;
    chained = st->joins ? TS_PLANES : transmission ? TS_ALPHA + 1 : 3;
    for (int i = 0; i < chained; i++)
        list[planes++] = &st->light[i];
    for (int i = 0; i < (seven ? 6 : chained); i++) {
        list[planes++] = &st->now[i];
        list[planes++] = &st->half[i];
    }
    for (int i = 0; i < 3; i++)
        list[planes++] = &st->sum[i];
    for (int i = 0; i < 3 && transmission && st->knobs.soften; i++)
        list[planes++] = &st->transmitted[i];
    list[planes++] = &st->need.wide_key;
    if (strength)
        list[planes++] = &st->strength;
    if (strength || !st->knobs.stretch) {
        list[planes++] = &st->scaled[0];
        list[planes++] = &st->scaled[1];
    }
    size = (size + 15) / 16 * 16 + 48;
    st->memory = pell_calloc(st->ctx, size * planes + 1, sizeof(float));
    st->cells = pell_calloc(st->ctx, cells + 1, sizeof(*st->cells));
    st->need.cell = pell_calloc(st->ctx, cells + 4 * size + 1, sizeof(*st->need.cell));
    if (!st->memory || !st->cells || !st->need.cell)
        goto fail;
    st->need.stage = st->need.cell + cells + TS_MARGIN;
    st->need.wide = st->need.stage + size;
    st->need.shown = st->need.wide + size;
    st->need.transmitted = st->need.shown + size;
    for (size_t i = 0; i < planes; i++)
        *list[i] = st->memory + i * size + TS_MARGIN;
    if (transmission)
        PELL_TRY(ts_tsm_allocate(st->ctx, atlases, count, st->knobs.tsm == TS_TSM_MAP ? st->knobs.tsm_size : 0, &st->tsm));
    res = PELL_OK;

fail:
    pell_free(st->ctx, atlases);
    return res;
}

void ts_layouts_finish(struct ts_state *st)
{
    for (size_t i = 0; st->solid && i < st->num_solids; i++) {
        ts_atlas_destroy(&st->solid[i].atlas);
        if (st->solid[i].map)
            pell_free(st->ctx, st->solid[i].map - 4 * TS_MARGIN);
        if (st->solid[i].seen)
            pell_free(st->ctx, (void *) (st->solid[i].seen - TS_MARGIN));
        st->solid[i].map = NULL;
        st->solid[i].seen = NULL;
    }
    if (st->run)
        st->run->forget(st);
    ts_tsm_finish(st->ctx, &st->tsm);
    pell_free(st->ctx, st->need.cell);
    st->need.cell = NULL;
    pell_free(st->ctx, st->cells);
    pell_free(st->ctx, st->memory);
    st->cells = NULL;
    st->memory = NULL;
    st->complete = false;
}

enum pell_result ts_layouts_fit(struct ts_state *st, const struct pell_frame *in)
{
    const double start = pell_seconds();
    enum pell_result res;

    if (find_sides(st, in) && st->complete)
        return PELL_OK;
    ts_layouts_finish(st);
    st->lit = 0;
    PELL_TRY(make_atlases(st, &in->shape));
    PELL_TRY(make_planes(st));
    st->complete = true;
    st->layout_seconds += pell_seconds() - start;
    return PELL_OK;

fail:
    return res;
}
