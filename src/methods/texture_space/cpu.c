/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the texture-space method on the cpu engine: state kept between frames, and the stages that make the map of a solid: light on the
 * map (light_map.c), transmission (translucent shadow map), the chain of blurs (chain.c). Pixels then read the map (read_map.c).
 *
 * A map is made by the first frame with the current scene and lights; later frames only read it. The first view makes only the part of the
 * map that its pixels need (need.c).
 */
#include "methods/texture_space/state.h"

#include "base/hash.h"
#include "base/simd.h"
#include "render/engine.h"

#include <stdio.h>
#include <string.h>

PELL_SIMD_TABLES(struct ts_kernels, pell_ts_kernels);

enum { LIGHTS_MOST = 16, CHUNK = 1024 };
#define READ_VARIANCE (1.0f / 6.0f) /* texels^2 that bilinear interpolation adds on average */
#define MIN_STRENGTH 1e-3f

/* --- Create and destroy ---------------------------------------------------------------------------------------------------------- */

static void ts_free(void *state)
{
    struct ts_state *st = state;

    if (!st)
        return;
    ts_layouts_finish(st);
    if (st->run && st->run->close)
        st->run->close(st);
    for (size_t i = 0; st->profiles && i < st->num_profiles; i++)
        ts_profile_finish(st->ctx, &st->profiles[i]);
    pell_free(st->ctx, st->profiles);
    pell_free(st->ctx, st->solid);
    pell_solids_destroy(&st->solids);
    pell_free(st->ctx, st);
}

/* A complete state is kept, for the next pass over the same scene. */
void ts_destroy(void *state)
{
    struct ts_state *st = state;
    struct pell_kept *kept = st && st->complete ? st->services->kept : NULL;

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

/* Hash of materials, knobs, size and settings: all inputs of layouts, profiles and planes except the triangles. */
static uint64_t made_of(const struct pell_services *services, const struct pell_frame_shape *shape, const struct ts_knobs *knobs)
{
    const struct pell_scene *scene = services->scene;
    uint64_t hash = pell_hash_bytes(0, knobs, sizeof(*knobs));

    hash = pell_hash_word(hash, (uint64_t) shape->width << 32 | (uint64_t) shape->height);
    hash = pell_hash_word(hash, (uint64_t) services->settings->curvature);
    hash = pell_hash_word(hash, (uint64_t) services->settings->opposed);
    for (size_t i = 0; i < shape->num_materials; i++) {
        const struct pell_frame_material *m = &shape->materials[i];
        hash = pell_hash_bytes(hash, &m->medium, sizeof(m->medium));
        hash = pell_hash_bytes(hash, &m->gaussians, sizeof(m->gaussians));
        hash = pell_hash_bytes(hash, m->profile, 3 * sizeof(*m->profile));
        hash = pell_hash_word(hash, m->white);
    }
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_material *m = &scene->materials[scene->meshes[i].material];
        hash = pell_hash_word(hash, (m->strength != 1.0f) | (m->strength_map.texture != 0) << 1);
    }
    return hash;
}

/* Takes a kept state for a scene whose vertices have moved; NULL, and the kept state is destroyed, if it belongs to another scene. */
static struct ts_state *take_kept(const struct pell_services *services, const struct pell_solids *solids, uint64_t hash)
{
    struct ts_state *st = services->kept ? services->kept->state : NULL;
    bool same = st && st->made_of == hash && st->num_solids == solids->count;

    if (!st)
        return NULL;
    services->kept->state = NULL;
    for (size_t i = 0; same && i < solids->count; i++)
        same = st->solid[i].atlas
                   ? st->solid[i].atlas->hash == ts_atlas_hash(services->scene, solids, i) && solids->solids[i].num_triangles > 0
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

enum pell_result ts_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                           const struct ts_runner *run, void **state)
{
    const double start = pell_seconds();
    struct pell_context *ctx = services->ctx;
    const uint64_t hash = made_of(services, shape, knobs);
    struct pell_solids *solids;
    struct ts_state *st;
    enum pell_result res;

    *state = NULL;
    PELL_TRY(pell_services_solids(services, &solids));
    if ((st = take_kept(services, solids, hash)) != NULL) {
        *state = st;
        st->services = services;
        st->solids = solids;
        ts_layouts_measure(st);
        st->layout_seconds = pell_seconds() - start;
        return PELL_OK;
    }
    *state = st = pell_zalloc(ctx, sizeof(*st));
    if (!st) {
        pell_solids_destroy(&solids);
        return PELL_ERR_NOMEM;
    }
    st->services = services;
    st->ctx = ctx;
    st->run = run;
    st->pool = services->pool;
    st->kernels = pell_ts_kernels_tables[pell_simd_best()];
    st->knobs = *(const struct ts_knobs *) knobs;
    st->solids = solids;
    st->num_solids = solids->count;
    st->made_of = hash;
    st->num_profiles = shape->num_materials;
    st->solid = pell_calloc(ctx, st->solids->count + 1, sizeof(*st->solid));
    st->profiles = pell_calloc(ctx, shape->num_materials, sizeof(*st->profiles));
    if (!st->solid || !st->profiles)
        return PELL_ERR_NOMEM;
    ts_layouts_measure(st);
    return PELL_OK;

fail:
    return res;
}

/* --- The map of a solid ---------------------------------------------------------------------------------------------------------- */

/* Divides lengths by the strength map: where light scatters less far, distances count more. Without `stretch` all texels have the mean
 * length. */
static void scale_lengths(struct ts_state *st, const struct ts_atlas *a, bool strength)
{
    float *const plane[1] = { st->strength };

    if (strength) {
        ts_light_map_and_strength(st, a);
        ts_fill(st, a, plane, 1, TS_FAR - 1, 0);
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
                const float s = strength ? fmaxf(st->strength[at], MIN_STRENGTH) : 1.0f;
                const bool in_chart = a->key[at] > 0.0f;
                const float length = !in_chart ? 0.0f : (st->knobs.stretch ? a->length[k][at] : (float) a->mm_per_texel) / s;
                st->scaled[k][at] = length;
                if (!in_chart)
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

/* Clears the planes of sums. All solids share them, so the parts that this one leaves unused must not show another solid's. */
static void clear_rows(void *arg, int band, int worker)
{
    const struct mapping *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_atlas *a = p->solid->atlas;
    float *const added[6] = { st->sum[0], st->sum[1], st->sum[2], st->transmitted[0], st->transmitted[1], st->transmitted[2] };
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
    for (int c = 0; c < TS_PLANES && st->solids->count > 1; c++)
        if (st->light[c])
            memset(st->light[c] + from, 0, (size_t) (to - from) * sizeof(float));
}

/* The reach of blurs depends on the shortest texels. */
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

/* `several`: the light is not that of st->shown.light alone. */
static void show_light(struct ts_state *st, float *const light[3], bool several)
{
    ts_show(st, &(struct ts_image) { "irradiance",
                                     "W/m^2",
                                     "irradiance that entered, with albedo^m",
                                     { light[0], light[1], light[2] },
                                     3,
                                     .color = true,
                                     .of_light = !several });
}

/* Prepares the planes, lengths and lists of a solid. */
static void begin_solid(struct ts_state *st, size_t index, struct ts_chain_params *chain)
{
    const struct ts_atlas *a = st->solid[index].atlas;

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
        .read_variance = st->knobs.kernel != TS_KERNEL_SEVEN ? READ_VARIANCE : 0.0f,
        .seven = st->knobs.kernel == TS_KERNEL_SEVEN,
    };
    chain->scaled = ts_scaled_strength(st, (int32_t) index);
    if (chain->scaled || !st->knobs.stretch)
        scale_lengths(st, a, chain->scaled);
    if (st->knobs.tsm != TS_TSM_OFF)
        ts_tsm_start(a, &st->tsm);
    find_least(st, a);
    ts_note_time(st, "start", 0, 0, 0);
    st->shown.solid = index;
    st->shown.light = -1;
    st->shown.result = PELL_OK;
    ts_show(st, &(struct ts_image) { "texel-size",
                                     "mm",
                                     "size on the surface of a texel, along x and at right angles to that: the stretch",
                                     { a->length[0], a->length[1] },
                                     2 });
}

struct remaining_task {
    struct ts_state *st;
    const struct ts_atlas *atlas;
    float *const *single; /* W/m^2: of the light, the part that accounts for single scattering and is not transmitted; NULL: none */
};

/* The fraction of the light where a texel's transmitted light enters that goes into the depth. */
static void deep_fraction(const struct remaining_task *p, const struct ts_transmitted_texel *t, float fraction[3])
{
    const float *const light[3] = { p->st->light[0], p->st->light[1], p->st->light[2] };
    const float *const single[3] = { p->single[0], p->single[1], p->single[2] };
    float all[3], once[3];

    ts_read(p->atlas, &t->from, light, 3, all);
    ts_read(p->atlas, &t->from, single, 3, once);
    for (int c = 0; c < 3; c++)
        fraction[c] = all[c] > 0.0f ? fminf(fmaxf(1.0f - once[c] / all[c], 0.0f), 1.0f) : 1.0f;
}

static void remaining_chunk(void *arg, int chunk, int worker)
{
    const struct remaining_task *p = arg;
    const struct ts_atlas *a = p->atlas;
    struct ts_tsm *tsm = &p->st->tsm;
    const size_t first = (size_t) chunk * CHUNK;

    (void) worker;
    for (size_t i = first; i < first + CHUNK && i < tsm->count; i += 16) {
        struct ts_transmitted_texel *t = &tsm->texels[i];
        const int count = tsm->count - i < 16 ? (int) (tsm->count - i) : 16;
        struct pell_points16 points;
        float remaining[3][16], deep[3] = { 1.0f, 1.0f, 1.0f };
        for (int k = 0; k < count; k++) {
            const struct ts_triangle *of = &a->triangles[a->source[t[k].at]];
            points.mesh[k] = of->mesh;
            points.triangle[k] = of->triangle;
            points.u[k] = a->bary[0][t[k].at];
            points.v[k] = a->bary[1][t[k].at];
        }
        pell_services_transmitted(p->st->services, &points, count, remaining);
        for (int k = 0; k < count; k++) {
            if (p->single)
                deep_fraction(p, &t[k], deep);
            for (int c = 0; c < 3; c++)
                t[k].remaining[c] = remaining[c][k] * deep[c];
        }
    }
}

/* The fraction of the light in st->light that is transmitted, without what the engine already adds for light inside the solid. */
static void set_remaining(struct ts_state *st, const struct ts_atlas *a, float *const *single)
{
    struct remaining_task task = { st, a, single };

    pell_pool_run(st->services->pool, (int) ((st->tsm.count + CHUNK - 1) / CHUNK), remaining_chunk, &task);
}

/* Computes the light of the lights in the bit mask, which is blurred together with that of a transmitted light. */
static enum pell_result join(struct ts_state *st, const struct ts_atlas *a, uint64_t lights)
{
    enum pell_result res;

    PELL_TRY(ts_light_map(st, a, lights, NULL, false, st->light + TS_LOCAL, NULL));
    show_light(st, st->light + TS_LOCAL, true);

fail:
    return res;
}

/* Blurs the transmitted light of one light, and with lights=own also its light that enters locally, and that of the lights in the bit mask
 * `local` (0: none); `*any`: any light is transmitted, otherwise nothing is blurred. */
static enum pell_result transmit(struct ts_state *st, size_t index, size_t light, uint64_t local, struct ts_chain_params *chain, bool *any)
{
    const struct ts_solid *solid = &st->solid[index];
    const struct ts_atlas *a = solid->atlas;
    const bool around = st->services->scene->lights[light].type == PELL_LIGHT_ENVIRONMENT; /* no face points away from it */
    const struct ts_tsm_params t = {
        .services = st->services,
        .solids = st->solids,
        .solid = (int32_t) index,
        .atlas = a,
        .light = &st->services->scene->lights[light],
        .grid = pell_services_light_grid(st->services, light),
        .form = st->knobs.tsm,
        .size = st->knobs.tsm_size,
        .printed = st->knobs.thickness == TS_THICKNESS_PRINTED,
        .at_once = around || st->knobs.lights == TS_LIGHTS_SUM,
        .need = st->need.on ? st->need.stage : NULL,
        .thickest = solid->profile->thickest,
        .falloff = solid->profile->widest,
    };
    /* planes that the blurs need only later; other lights have directions, and their single scattering is separate */
    float *const *single = around && st->knobs.lights == TS_LIGHTS_OWN ? st->now : NULL;
    int64_t rays = 0;
    enum pell_result res;

    st->tsm.count = 0;
    if (st->need.on)
        ts_need_chain(st, solid, true);
    ts_tsm_face(&t, &st->tsm);
    PELL_TRY(ts_tsm_make(&t, st->light[TS_ALPHA], &st->tsm, &rays));
    ts_note_time(st, "tsm", a->inner, a->inner * 40, rays);
    st->shown.light = (int) light;
    *any = st->tsm.count > 0;
    if (!*any)
        return PELL_OK;
    if (st->knobs.lights == TS_LIGHTS_OWN) {
        const float *const lit[3] = { st->light[0], st->light[1], st->light[2] };
        if (st->need.on && around)
            ts_need_chain(st, solid, true);
        PELL_TRY(ts_light_map(st, a, pell_light_bit(light), around ? NULL : st->tsm.faces, !around, st->light,
                              single)); /* rays accept light from any side */
        rays = 0;
        if (!around)
            PELL_TRY(ts_tsm_light(&t, lit, st->light[TS_ALPHA], &st->tsm, &rays));
        ts_note_time(st, "tsm", 0, 0, rays);
        show_light(st, st->light, false);
    }
    ts_show(st, &(struct ts_image) { "thickness",
                                     "mm",
                                     "distance that transmitted light goes; 0: none is transmitted",
                                     { st->light[TS_ALPHA] },
                                     1,
                                     .of_light = true,
                                     .falloff = t.falloff });
    set_remaining(st, a, single);
    if (st->need.on)
        ts_need_chain(st, solid, true);
    if (local)
        PELL_TRY(join(st, a, local));
    chain->transmission = true;
    chain->joined = local != 0;
    PELL_TRY(ts_chain(st, solid, chain));
    chain->joined = false;
    chain->local = st->knobs.lights == TS_LIGHTS_OWN;
    return PELL_OK;

fail:
    return res;
}

/* An environment has no depth map, and with the sum of all lights no light of its own. */
static bool transmits(const struct ts_state *st, const struct pell_light *light)
{
    if (light->type == PELL_LIGHT_ENVIRONMENT)
        return st->knobs.tsm == TS_TSM_RAY && st->knobs.lights == TS_LIGHTS_OWN;
    return st->knobs.tsm != TS_TSM_OFF;
}

/* Index of the last light that is transmitted; SIZE_MAX: none is. */
static size_t last_transmitted(const struct ts_state *st)
{
    const struct pell_scene *scene = st->services->scene;
    size_t last = SIZE_MAX;
    int count = 0;

    for (size_t i = 0; i < scene->num_lights && i < 62 && count < LIGHTS_MOST; i++)
        if (transmits(st, &scene->lights[i])) {
            last = i;
            count++;
        }
    return last;
}

static enum pell_result light_solid(struct ts_state *st, size_t index)
{
    const struct pell_scene *scene = st->services->scene;
    struct ts_solid *solid = &st->solid[index];
    const struct ts_atlas *a = solid->atlas;
    struct mapping p = { .st = st, .solid = solid };
    struct ts_chain_params chain = { .local = true };
    const struct pell_settings *settings = st->services->settings;
    /* Light that is not blurred yet. What the engine adds for the solid is subtracted from indirect light. */
    uint64_t rest = settings->bounces > 0 || settings->opposed ? PELL_LIGHT_INDIRECT : 0;
    const size_t last = last_transmitted(st);
    bool is_transmitted = false;
    enum pell_result res;

    st->clock = pell_seconds();
    ts_rows(st, a->height, clear_rows, &p);
    begin_solid(st, index, &chain);
    if (st->need.on)
        ts_need_begin(st, solid);
    PELL_TRY(st->run->begin(st, solid));
    if (st->knobs.lights == TS_LIGHTS_SUM) {
        PELL_TRY(ts_light_map(st, a, 0, NULL, true, st->light, NULL));
        show_light(st, st->light, false);
    }
    for (size_t i = 0; i < scene->num_lights; i++)
        rest |= pell_light_bit(i);
    for (size_t i = 0; last != SIZE_MAX && i <= last; i++) {
        const uint64_t others = rest & ~pell_light_bit(i);
        const bool joins = i == last && st->joins;
        bool any = false;
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        if (!transmits(st, &scene->lights[i]))
            continue;
        PELL_TRY(transmit(st, index, i, joins ? others : 0, &chain, &any));
        if (any && st->knobs.lights == TS_LIGHTS_OWN)
            rest = joins ? 0 : others;
        is_transmitted = is_transmitted || any;
    }
    st->tsm.count = 0;
    st->shown.light = -1;
    if (st->need.on)
        ts_need_chain(st, solid, false);
    if (st->knobs.lights == TS_LIGHTS_OWN && rest) {
        PELL_TRY(ts_light_map(st, a, rest, NULL, false, st->light, NULL));
        show_light(st, st->light, false);
    }
    chain.transmission = false;
    if (chain.local && rest)
        PELL_TRY(ts_chain(st, solid, &chain));
    if (is_transmitted && st->knobs.soften && st->need.on)
        ts_need_soft(st, solid);
    if (is_transmitted && st->knobs.soften)
        PELL_TRY(ts_soften(st, solid));
    if (pell_services_observed(st->services, st->in))
        PELL_TRY(st->run->inspect(&(struct ts_blurring) { .st = st, .solid = solid }, true));
    ts_show(st, &(struct ts_image) { "exitance",
                                     "W/m^2",
                                     "radiant exitance, all Gaussians and transmission",
                                     { st->sum[0], st->sum[1], st->sum[2] },
                                     3,
                                     .color = true });
    PELL_TRY(st->run->store(st, solid));
    ts_note_time(st, "start", a->inner, a->inner * 28, 0);
    return st->shown.result != PELL_OK ? st->shown.result : pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

/* --- A frame --------------------------------------------------------------------------------------------------------------------- */

/* Warns once for each new number of lights above the limit. */
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

/* Makes the maps that this frame reads and no earlier frame has made. When a view needs more of a solid for the second time, the solid's
 * map is completed, and from then on so are all others. */
static enum pell_result make_maps(struct ts_state *st, const struct pell_frame *in)
{
    const bool may_cull = ts_need_enabled(st, in);
    bool complete = true, partial = false;
    enum pell_result res;

    for (size_t i = 0; i < st->solids->count; i++)
        complete &= !st->solid[i].atlas || st->solid[i].made == TS_MADE_COMPLETE;
    if (complete)
        return PELL_OK;
    if (st->knobs.cull && st->run->culls) {
        ts_need_mark_visible(st, in);
        for (size_t i = 0; may_cull && i < st->solids->count; i++) {
            st->solid[i].make_partial =
                atomic_load(&st->solid[i].missing) && st->solid[i].made == TS_MADE_NOT && ts_need_pays(&st->solid[i]);
            partial |= st->solid[i].make_partial;
        }
        if (partial && in->num_samples > 1)
            ts_need_mark_later(st, in);
        ts_note_time(st, "need", 0, 0, 0);
    }
    for (size_t i = 0; i < st->solids->count; i++) {
        struct ts_solid *solid = &st->solid[i];
        const bool more = atomic_exchange(&solid->missing, false);
        if (!solid->atlas || solid->made == TS_MADE_COMPLETE || (may_cull && !more) || (solid->made == TS_MADE_PARTIAL && !more))
            continue;
        st->need.on = may_cull && solid->made == TS_MADE_NOT && solid->make_partial;
        st->reused |= solid->made == TS_MADE_PARTIAL;
        solid->made = TS_MADE_NOT;
        res = light_solid(st, i);
        if (res != PELL_OK) {
            ts_need_discard(solid);
            goto fail;
        }
        solid->made = st->need.on ? TS_MADE_PARTIAL : TS_MADE_COMPLETE;
        solid->version = ++st->versions;
    }
    return PELL_OK;

fail:
    return res;
}

enum pell_result ts_make(struct ts_state *st, const struct pell_frame *in)
{
    enum pell_result res;

    st->num_times = 0;
    st->in = in;
    st->clock = pell_seconds() - st->layout_seconds;
    if (in->first || !st->complete)
        PELL_TRY(ts_layouts_fit(st, in));
    if (st->layout_seconds > 0.0) /* by this frame, initially or again */
        ts_note_time(st, "layout", 0, 0, 0);
    st->layout_seconds = 0.0;
    if (st->lit != in->lights_revision) {
        for (size_t i = 0; i < st->solids->count; i++)
            ts_need_discard(&st->solid[i]);
        warn_of_lights(st);
        st->lit = in->lights_revision;
    }
    PELL_TRY(make_maps(st, in));
    st->clock = pell_seconds();
    return PELL_OK;

fail:
    return res;
}

enum pell_result ts_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct ts_state *st = state;
    int64_t pixels;
    enum pell_result res;

    PELL_TRY(ts_make(st, in));
    pixels = ts_read_map(st, in, out);
    ts_note_time(st, "gather", pixels, pixels * (4 * 16 + 16 + 12), 0);
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

size_t ts_times(const void *state, struct pell_pass_time *list, size_t size)
{
    const struct ts_state *st = state;

    for (size_t i = 0; i < st->num_times && i < size; i++)
        list[i] = st->times[i];
    return st->num_times < size ? st->num_times : size;
}

static enum pell_result create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs, void **state)
{
    return ts_create(services, shape, knobs, &ts_cpu_runner, state);
}

const struct pell_method_engine pell_ts_cpu = { .create = create, .record = ts_render, .destroy = ts_destroy, .times = ts_times };
