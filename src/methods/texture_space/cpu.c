/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the texture-space method on the cpu engine: what lives between frames, and the steps that make the map of a solid: light on the
 * map (light_map.c), transmission (translucent shadow map), the chain of blurs (chain.c). Pixels then read it (read_map.c).
 *
 * A frame makes the map when it is the first one that sees the scene and its lights like this; later ones only look at it.
 */
#include "methods/texture_space/state.h"

#include "base/hash.h"
#include "base/simd.h"
#include "render/engine.h"

#include <stdio.h>
#include <string.h>

PELL_SIMD_TABLES(struct ts_kernels, pell_ts_kernels);

enum { LIGHTS_MOST = 16, LEFT_CHUNK = 1024 };
#define GRID_VARIANCE (1.0f / 6.0f) /* texels^2 that bilinear reading adds on the average */
#define SIZE_LEAST 32.0             /* texels, of small objects beside large ones */
#define PIXEL_TEXELS 8.0            /* maps of all objects together have no more texels for each pixel */
#define TAPS_REACH 3.46             /* standard deviations */
#define COVERED 0.6
#define STRENGTH_LEAST 1e-3f

/* --- Life ------------------------------------------------------------------------------------------------------------------------ */

static void ts_free(void *state)
{
    struct ts_state *st = state;

    if (!st)
        return;
    for (size_t i = 0; st->solid && i < st->num_solids; i++) {
        ts_atlas_destroy(&st->solid[i].atlas);
        if (st->solid[i].map)
            pell_free(st->ctx, st->solid[i].map - 4 * TS_MARGIN);
    }
    for (size_t i = 0; st->profiles && i < st->num_profiles; i++)
        ts_profile_finish(st->ctx, &st->profiles[i]);
    ts_tsm_finish(st->ctx, &st->tsm);
    pell_free(st->ctx, st->cells);
    pell_free(st->ctx, st->memory);
    pell_free(st->ctx, st->profiles);
    pell_free(st->ctx, st->solid);
    pell_solids_destroy(&st->solids);
    pell_free(st->ctx, st);
}

/* A state that is whole is kept, for the pass of the same scene a moment later. */
static void ts_destroy(void *state)
{
    struct ts_state *st = state;
    struct pell_kept *kept = st && st->whole ? st->services->kept : NULL;

    if (!kept) {
        ts_free(st);
        return;
    }
    if (kept->state)
        kept->destroy(kept->state);
    pell_solids_destroy(&st->solids);
    st->services = NULL;
    st->in = NULL;
    *kept = (struct pell_kept) { st, ts_free };
}

static bool scaled_strength(const struct ts_state *st, int32_t solid)
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

/* As far as the taps of the widest blur reach, where texels are as long as they would be if charts covered 0.6 of the map. */
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

/* Objects that were laid out again for the same reason are told of in one line. */
static void tell_of_layouts(struct ts_state *st, const struct pell_frame_shape *shape)
{
    for (size_t i = 0; i < st->solids->count; i++) {
        const struct ts_atlas *a = st->solid[i].atlas;
        const char *name = shape->materials[st->solids->solids[i].material].name, *wrong = a ? a->wrong : NULL;
        char more[64] = "";
        size_t others = 0;

        if (!wrong)
            continue;
        for (size_t j = i + 1; j < st->solids->count; j++)
            if (st->solid[j].atlas && st->solid[j].atlas->wrong == wrong &&
                st->solids->solids[j].material == st->solids->solids[i].material) {
                st->solid[j].atlas->wrong = NULL;
                others++;
            }
        if (others)
            snprintf(more, sizeof(more), "; so are %zu other objects", others);
        if (a->without)
            pell_info(st->ctx, name, "%s: laid out in %d planar charts%s", wrong, a->num_charts, more);
        else
            pell_warn(st->ctx, name, "charts=planar says that this is as meant", "%s: laid out in %d planar charts%s", wrong, a->num_charts,
                      more);
    }
}

/* Factor of the sides of all maps: together they have at most four times the texels of one of the side `size`, and in small images fewer,
 * but for maps that are as small as they get. */
static double share_texels(const struct ts_state *st, const struct pell_frame_shape *shape, double largest)
{
    const double one = (double) st->knobs.size * st->knobs.size, pixels = (double) shape->width * shape->height;
    const double most = fmin(fmax(PIXEL_TEXELS * pixels, 2.0 * one), 4.0 * one);
    double all = 0.0;

    for (size_t i = 0; i < st->solids->count && largest > 0.0; i++)
        all += one * st->solids->solids[i].area / largest;
    return all > most ? sqrt(most / all) : 1.0;
}

static enum pell_result make_atlases(struct ts_state *st, const struct pell_frame_shape *shape)
{
    const struct pell_solids *b = st->solids;
    double largest = 0.0, factor;
    enum pell_result res;

    for (size_t i = 0; i < b->count; i++)
        largest = fmax(largest, b->solids[i].area);
    factor = share_texels(st, shape, largest);
    for (size_t i = 0; i < b->count; i++) {
        const struct pell_solid *solid = &b->solids[i];
        const struct pell_frame_material *m = &shape->materials[solid->material];
        const double share = largest > 0.0 ? factor * sqrt(solid->area / largest) : 0.0;
        struct ts_profile *profile = &st->profiles[solid->material];
        struct ts_atlas_params p = {
            .pool = st->pool,
            .scene = st->services->scene,
            .solids = b,
            .solid = i,
            .name = m->name,
            .charts = st->knobs.charts,
            .size = (int) fmin(fmax(ceil(st->knobs.size * share), SIZE_LEAST), st->knobs.size),
        };
        if (solid->num_triangles == 0)
            continue;
        if (profile->count == 0)
            PELL_TRY(ts_profile_make(st->ctx, m, &st->knobs, ts_is_local(st), profile));
        st->solid[i].profile = profile;
        p.border = border_of(st, profile, solid->area, p.size);
        PELL_TRY(ts_atlas_make(st->ctx, &p, &st->solid[i].atlas));
        st->solid[i].map = pell_calloc(st->ctx, 4 * st->solid[i].atlas->size, sizeof(float));
        if (!st->solid[i].map)
            return PELL_ERR_NOMEM;
        st->solid[i].map += 4 * TS_MARGIN;
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        pell_progress(st->ctx, "layouts", (double) (i + 1) / (double) b->count);
    }
    tell_of_layouts(st, shape);
    return PELL_OK;

fail:
    return res;
}

/* Planes of the largest atlas serve all. */
static enum pell_result make_planes(struct ts_state *st)
{
    const bool seven = st->knobs.kernel == TS_KERNEL_SEVEN, transmission = st->knobs.tsm != TS_TSM_OFF;
    const struct ts_atlas **atlases = pell_calloc(st->ctx, st->solids->count + 1, sizeof(*atlases));
    size_t size = 0, cells = 0, count = 0, planes = 0;
    bool strength = false;
    float **list[TS_LIT + 2 * TS_PLANES + 9];
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
        strength |= scaled_strength(st, (int32_t) i);
    }
    for (int i = 0; i < (transmission ? 4 : 3); i++)
        list[planes++] = &st->light[i];
    for (int i = 0; i < (seven ? 6 : transmission ? 4 : 3); i++) {
        list[planes++] = &st->now[i];
        list[planes++] = &st->half[i];
    }
    for (int i = 0; i < 3; i++)
        list[planes++] = &st->sum[i];
    for (int i = 0; i < 3 && transmission && st->knobs.soften; i++)
        list[planes++] = &st->behind[i];
    if (strength)
        list[planes++] = &st->strength;
    if (strength || !st->knobs.stretch) {
        list[planes++] = &st->scaled[0];
        list[planes++] = &st->scaled[1];
    }
    size = (size + 15) / 16 * 16 + 48;
    st->memory = pell_calloc(st->ctx, size * planes + 1, sizeof(float));
    st->cells = pell_calloc(st->ctx, cells + 1, sizeof(*st->cells));
    if (!st->memory || !st->cells)
        goto fail;
    for (size_t i = 0; i < planes; i++)
        *list[i] = st->memory + i * size + TS_MARGIN;
    if (transmission)
        PELL_TRY(ts_tsm_allocate(st->ctx, atlases, count, st->knobs.tsm == TS_TSM_MAP ? st->knobs.tsm_size : 0, &st->tsm));
    res = PELL_OK;

fail:
    pell_free(st->ctx, atlases);
    return res;
}

/* Materials, knobs, size and settings: all that layouts, profiles and planes depend on beside the triangles. */
static uint64_t made_of(const struct pell_services *services, const struct pell_frame_shape *shape, const struct ts_knobs *knobs)
{
    const struct pell_scene *scene = services->scene;
    uint64_t print = pell_hash_bytes(0, knobs, sizeof(*knobs));

    print = pell_hash_word(print, (uint64_t) shape->width << 32 | (uint64_t) shape->height);
    print = pell_hash_word(print, (uint64_t) services->settings->curvature);
    for (size_t i = 0; i < shape->num_materials; i++) {
        const struct pell_frame_material *m = &shape->materials[i];
        print = pell_hash_bytes(print, &m->medium, sizeof(m->medium));
        print = pell_hash_bytes(print, &m->gaussians, sizeof(m->gaussians));
        print = pell_hash_bytes(print, m->profile, 3 * sizeof(*m->profile));
        print = pell_hash_word(print, m->white);
    }
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_material *m = &scene->materials[scene->meshes[i].material];
        print = pell_hash_word(print, (m->strength != 1.0f) | (m->strength_map.texture != 0) << 1);
    }
    return print;
}

/* What was kept, for a scene whose vertices have moved: NULL, and nothing is kept any more, where it is of another. */
static struct ts_state *take_kept(const struct pell_services *services, const struct pell_solids *solids, uint64_t print)
{
    struct ts_state *st = services->kept ? services->kept->state : NULL;
    bool same = st && st->made_of == print && st->num_solids == solids->count;

    if (!st)
        return NULL;
    services->kept->state = NULL;
    for (size_t i = 0; same && i < solids->count; i++)
        same = st->solid[i].atlas
                   ? st->solid[i].atlas->print == ts_atlas_print(services->scene, solids, i) && solids->solids[i].num_triangles > 0
                   : solids->solids[i].num_triangles == 0;
    for (size_t i = 0; same && i < solids->count; i++)
        same = !st->solid[i].atlas || ts_atlas_update(st->solid[i].atlas, services->pool, services->scene);
    if (!same) {
        ts_free(st);
        return NULL;
    }
    st->lit = 0;
    st->warned = 0;
    return st;
}

static enum pell_result ts_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                  void **state)
{
    const double start = pell_seconds();
    struct pell_context *ctx = services->ctx;
    const uint64_t print = made_of(services, shape, knobs);
    struct pell_solids *solids;
    struct ts_state *st;
    enum pell_result res;

    *state = NULL;
    PELL_TRY(pell_services_solids(services, &solids));
    if ((st = take_kept(services, solids, print)) != NULL) {
        *state = st;
        st->services = services;
        st->solids = solids;
        st->layout = pell_seconds() - start;
        return PELL_OK;
    }
    *state = st = pell_zalloc(ctx, sizeof(*st));
    if (!st) {
        pell_solids_destroy(&solids);
        return PELL_ERR_NOMEM;
    }
    st->services = services;
    st->ctx = ctx;
    st->pool = services->pool;
    st->kernels = pell_ts_kernels_tables[pell_simd_best()];
    st->knobs = *(const struct ts_knobs *) knobs;
    st->solids = solids;
    st->num_solids = solids->count;
    st->made_of = print;
    st->num_profiles = shape->num_materials;
    st->solid = pell_calloc(ctx, st->solids->count + 1, sizeof(*st->solid));
    st->profiles = pell_calloc(ctx, shape->num_materials, sizeof(*st->profiles));
    if (!st->solid || !st->profiles)
        return PELL_ERR_NOMEM;
    PELL_TRY(make_atlases(st, shape));
    PELL_TRY(make_planes(st));
    st->whole = true;
    st->layout = pell_seconds() - start;
    return PELL_OK;

fail:
    return res;
}

/* --- The map of a solid ---------------------------------------------------------------------------------------------------------- */

/* Lengths over strength: what scatters less far lies further apart. Without `stretch` all texels are as long as their mean. */
static void scale_lengths(struct ts_state *st, const struct ts_atlas *a, bool strength)
{
    float *const plane[1] = { st->strength };

    if (strength) {
        ts_light_map_and_strength(st, a);
        ts_fill(st, a, plane, 1, TS_FAR - 1);
    }
    for (int y = 0; y < a->height; y++)
        for (int b = 0; b < a->blocks; b++) {
            struct ts_cell *cell = &st->cells[(ptrdiff_t) y * a->blocks + b];
            *cell = a->cells[(ptrdiff_t) y * a->blocks + b];
            cell->skew = st->knobs.stretch ? cell->skew : 0.0f;
            cell->least[0] = cell->least[1] = cell->most[0] = cell->most[1] = 0.0f;
            for (int i = 0; i < 2 * TS_BLOCK; i++) {
                const ptrdiff_t at = y * a->stride + b * TS_BLOCK + i / 2;
                const int k = i % 2;
                const float s = strength ? fmaxf(st->strength[at], STRENGTH_LEAST) : 1.0f;
                const bool is = a->key[at] > 0.0f;
                const float length = !is ? 0.0f : (st->knobs.stretch ? a->length[k][at] : (float) a->mm_per_texel) / s;
                st->scaled[k][at] = length;
                if (!is)
                    continue;
                cell->least[k] = cell->most[k] > 0.0f ? fminf(cell->least[k], length) : length;
                cell->most[k] = fmaxf(cell->most[k], length);
            }
        }
    for (int k = 0; k < 2; k++)
        st->work.length[k] = st->scaled[k];
    st->work.cells = st->cells;
}

struct mapping {
    struct ts_state *st;
    const struct ts_solid *solid;
};

/* Clears the planes that are summed into. All solids share them, so the part that this one does not use must not show another's. */
static void clear_rows(void *arg, int band, int worker)
{
    const struct mapping *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_atlas *a = p->solid->atlas;
    float *const added[6] = { st->sum[0], st->sum[1], st->sum[2], st->behind[0], st->behind[1], st->behind[2] };
    const ptrdiff_t from = band * TS_ROWS * a->stride - (band == 0 ? TS_MARGIN : 0);
    const ptrdiff_t to = (band + 1) * TS_ROWS < a->height ? (band + 1) * TS_ROWS * a->stride : (ptrdiff_t) a->size - TS_MARGIN;

    (void) worker;
    for (int c = 0; c < 6; c++)
        for (int y = band * TS_ROWS; added[c] && y < (band + 1) * TS_ROWS && y < a->height; y++)
            for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
                memset(added[c] + y * a->stride + a->runs[r].from * TS_BLOCK, 0,
                       (size_t) (a->runs[r].to - a->runs[r].from) * TS_BLOCK * sizeof(float));
    for (int c = 0; c < TS_PLANES && st->solids->count > 1; c++)
        if (st->now[c]) {
            memset(st->now[c] + from, 0, (size_t) (to - from) * sizeof(float));
            memset(st->half[c] + from, 0, (size_t) (to - from) * sizeof(float));
        }
    for (int c = 0; c < TS_LIT && st->solids->count > 1; c++)
        if (st->light[c])
            memset(st->light[c] + from, 0, (size_t) (to - from) * sizeof(float));
}

/* What blurs reach depends on the shortest texels. */
static void find_least(struct ts_state *st, const struct ts_atlas *a)
{
    st->least[0] = st->least[1] = INFINITY;
    st->skew = 0.0f;
    for (ptrdiff_t i = 0; i < (ptrdiff_t) a->blocks * a->height; i++) {
        const struct ts_cell *cell = &st->work.cells[i];
        if (!(cell->most[0] > 0.0f))
            continue;
        for (int k = 0; k < 2; k++)
            st->least[k] = fminf(st->least[k], cell->least[k]);
        st->skew = fmaxf(st->skew, fabsf(cell->skew));
    }
}

static void store_rows(void *arg, int band, int worker)
{
    const struct mapping *p = arg;
    const struct ts_atlas *a = p->solid->atlas;

    (void) worker;
    for (int y = band * TS_ROWS; y < (band + 1) * TS_ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int b = a->runs[r].from; b < a->runs[r].to; b++) {
                const ptrdiff_t first = y * a->stride + b * TS_BLOCK;
                if (a->cells[(ptrdiff_t) y * a->blocks + b].near > TS_READ_FAR)
                    continue;
                for (ptrdiff_t at = first; at < first + TS_BLOCK; at++) {
                    float *out = p->solid->map + 4 * at;
                    for (int c = 0; c < 3; c++)
                        out[c] = p->st->sum[c][at];
                    out[3] = a->key[at];
                }
            }
}

static void show_light(struct ts_state *st)
{
    ts_show(st, &(struct ts_image) { "irradiance",
                                     "W/m^2",
                                     "irradiance that entered, with albedo^m",
                                     { st->light[0], st->light[1], st->light[2] },
                                     3,
                                     .color = true,
                                     .of_light = true });
}

/* Gets the planes, lengths and lists of a solid ready. */
static void begin_solid(struct ts_state *st, size_t number, struct ts_chain_params *chain)
{
    const struct ts_atlas *a = st->solid[number].atlas;

    st->work = (struct ts_work) {
        .width = a->width,
        .height = a->height,
        .blocks = a->blocks,
        .stride = a->stride,
        .key = a->key,
        .cells = a->cells,
        .length = { a->length[0], a->length[1] },
        .tilt = { a->tilt[0], a->tilt[1] },
        .tilts = st->knobs.stretch,
        .grid = st->knobs.kernel == TS_KERNEL_DENSE ? GRID_VARIANCE : 0.0f,
    };
    chain->scaled = scaled_strength(st, (int32_t) number);
    if (chain->scaled || !st->knobs.stretch)
        scale_lengths(st, a, chain->scaled);
    if (st->knobs.tsm != TS_TSM_OFF)
        ts_tsm_start(a, &st->tsm);
    find_least(st, a);
    ts_note_time(st, "start", 0, 0, 0);
    st->shown.solid = number;
    st->shown.light = -1;
    st->shown.result = PELL_OK;
    ts_show(st, &(struct ts_image) { "texel-size",
                                     "mm",
                                     "size on the surface of a texel, along x and at right angles to that: the stretch",
                                     { a->length[0], a->length[1] },
                                     2 });
}

struct left_task {
    struct ts_state *st;
    const struct ts_atlas *atlas;
};

static void leave_chunk(void *arg, int chunk, int worker)
{
    const struct left_task *p = arg;
    const struct ts_atlas *a = p->atlas;
    struct ts_tsm *tsm = &p->st->tsm;
    const size_t first = (size_t) chunk * LEFT_CHUNK;

    (void) worker;
    for (size_t i = first; i < first + LEFT_CHUNK && i < tsm->count; i++) {
        struct ts_transmitted_texel *t = &tsm->texels[i];
        const struct ts_triangle *of = &a->triangles[a->source[t->at]];
        float solved[3];
        pell_services_solved(p->st->services, of->mesh, of->triangle, a->bary[0][t->at], a->bary[1][t->at], solved);
        for (int c = 0; c < 3; c++)
            t->left[c] = 1.0f - solved[c];
    }
}

/* What is left to transmit where diffusion in the solid is solved. */
static void leave(struct ts_state *st, const struct ts_atlas *a)
{
    struct left_task task = { st, a };

    pell_pool_run(st->services->pool, (int) ((st->tsm.count + LEFT_CHUNK - 1) / LEFT_CHUNK), leave_chunk, &task);
}

/* Blurs the light that one light transmits, and with lights=own what else enters of it; `*is`: it transmits any. */
static enum pell_result transmit(struct ts_state *st, size_t number, size_t light, struct ts_chain_params *chain, bool *is)
{
    const struct ts_solid *solid = &st->solid[number];
    const struct ts_atlas *a = solid->atlas;
    const bool around = st->services->scene->lights[light].type == PELL_LIGHT_ENVIRONMENT; /* no face turns away from it */
    const struct ts_tsm_params t = {
        .services = st->services,
        .solids = st->solids,
        .solid = (int32_t) number,
        .atlas = a,
        .light = &st->services->scene->lights[light],
        .grid = pell_services_light_grid(st->services, light),
        .form = st->knobs.tsm,
        .size = st->knobs.tsm_size,
        .printed = st->knobs.thickness == TS_THICKNESS_PRINTED,
        .at_once = around || st->knobs.lights == TS_LIGHTS_SUM,
        .thickest = solid->profile->thickest,
        .falloff = solid->profile->widest,
    };
    int64_t rays = 0;
    enum pell_result res;

    ts_tsm_face(&t, &st->tsm);
    PELL_TRY(ts_tsm_make(&t, st->light[3], &st->tsm, &rays));
    ts_note_time(st, "tsm", a->inner, a->inner * 40, rays);
    st->shown.light = (int) light;
    *is = st->tsm.count > 0;
    if (!*is)
        return PELL_OK;
    if (st->knobs.lights == TS_LIGHTS_OWN) {
        const float *const lit[3] = { st->light[0], st->light[1], st->light[2] };
        ts_light_map(st, a, pell_light_bit(light), around ? NULL : st->tsm.faces);
        rays = 0;
        if (!around)
            PELL_TRY(ts_tsm_light(&t, lit, st->light[3], &st->tsm, &rays));
        ts_note_time(st, "tsm", 0, 0, rays);
        show_light(st);
    }
    ts_show(st, &(struct ts_image) { "thickness",
                                     "mm",
                                     "distance that transmitted light goes; 0: none is transmitted",
                                     { st->light[3] },
                                     1,
                                     .of_light = true,
                                     .falloff = t.falloff });
    leave(st, a);
    chain->transmission = true;
    ts_chain(st, solid, chain);
    chain->local = st->knobs.lights == TS_LIGHTS_OWN;
    return PELL_OK;

fail:
    return res;
}

/* An environment has no map of what it sees, and with the sum of all lights no light of its own. */
static bool transmits(const struct ts_state *st, const struct pell_light *light)
{
    if (light->type == PELL_LIGHT_ENVIRONMENT)
        return st->knobs.tsm == TS_TSM_RAY && st->knobs.lights == TS_LIGHTS_OWN;
    return st->knobs.tsm != TS_TSM_OFF;
}

static enum pell_result light_solid(struct ts_state *st, size_t number)
{
    const struct pell_scene *scene = st->services->scene;
    struct ts_solid *solid = &st->solid[number];
    const struct ts_atlas *a = solid->atlas;
    struct mapping p = { .st = st, .solid = solid };
    struct ts_chain_params chain = { .local = true };
    uint64_t rest = st->services->settings->bounces > 0 ? PELL_LIGHT_INDIRECT : 0; /* whose light is not blurred yet */
    int shining = 0;
    bool is_transmitted = false;
    enum pell_result res;

    st->clock = pell_seconds();
    ts_rows(st, a->height, clear_rows, &p);
    begin_solid(st, number, &chain);
    if (st->knobs.lights == TS_LIGHTS_SUM) {
        ts_light_map(st, a, 0, NULL);
        show_light(st);
    }
    for (size_t i = 0; i < scene->num_lights; i++) {
        const uint64_t bit = pell_light_bit(i);
        bool is = false;
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        rest |= bit;
        if (!transmits(st, &scene->lights[i]) || shining == LIGHTS_MOST || i >= 62)
            continue;
        shining++;
        PELL_TRY(transmit(st, number, i, &chain, &is));
        rest &= is && st->knobs.lights == TS_LIGHTS_OWN ? ~bit : ~(uint64_t) 0;
        is_transmitted = is_transmitted || is;
    }
    st->tsm.count = 0;
    st->shown.light = -1;
    if (st->knobs.lights == TS_LIGHTS_OWN && rest) {
        ts_light_map(st, a, rest, NULL);
        show_light(st);
    }
    chain.transmission = false;
    if (chain.local && rest)
        ts_chain(st, solid, &chain);
    if (is_transmitted && st->knobs.soften)
        ts_soften(st, solid);
    ts_show(st, &(struct ts_image) { "exitance",
                                     "W/m^2",
                                     "radiant exitance, all Gaussians and transmission",
                                     { st->sum[0], st->sum[1], st->sum[2] },
                                     3,
                                     .color = true });
    ts_fill(st, a, st->sum, 3, TS_READ_FAR);
    ts_rows(st, a->height, store_rows, &p);
    ts_note_time(st, "start", a->inner, a->inner * 28, 0);
    return st->shown.result != PELL_OK ? st->shown.result : pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

/* --- A frame --------------------------------------------------------------------------------------------------------------------- */

/* Warns once for each new number of lights that is over the limit. */
static void warn_of_lights(struct ts_state *st)
{
    const struct pell_scene *scene = st->services->scene;
    size_t lights = 0;

    for (size_t i = 0; i < scene->num_lights; i++)
        lights += transmits(st, &scene->lights[i]);
    if (lights > LIGHTS_MOST && lights != st->warned)
        pell_warn(st->ctx, "texture-space", "leave out the dimmest", "%zu lights; only the first %d are transmitted through thin parts",
                  lights, LIGHTS_MOST);
    st->warned = lights;
}

static enum pell_result ts_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct ts_state *st = state;
    int64_t pixels;
    enum pell_result res;

    st->num_times = 0;
    st->in = in;
    st->clock = pell_seconds() - st->layout;
    if (st->layout > 0.0) /* of this frame's triangles */
        ts_note_time(st, "layout", 0, 0, 0);
    st->layout = 0.0;
    if (st->lit != in->lights_revision) {
        st->lit = 0;
        warn_of_lights(st);
        for (size_t i = 0; i < st->solids->count; i++)
            if (st->solid[i].atlas)
                PELL_TRY(light_solid(st, i));
        st->lit = in->lights_revision;
    }
    st->clock = pell_seconds();
    pixels = ts_read_map(st, in, out);
    ts_note_time(st, "gather", pixels, pixels * (4 * 16 + 16 + 12), 0);
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

static size_t ts_times(const void *state, struct pell_pass_time *list, size_t size)
{
    const struct ts_state *st = state;

    for (size_t i = 0; i < st->num_times && i < size; i++)
        list[i] = st->times[i];
    return st->num_times < size ? st->num_times : size;
}

const struct pell_method_engine pell_ts_cpu = { .create = ts_create, .record = ts_render, .destroy = ts_destroy, .times = ts_times };
