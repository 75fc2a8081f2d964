/* SPDX-License-Identifier: MIT
 * device.c - see device.h. */
#include "render/indirect/stage.h"
#include "render/irradiance/device_state.h"
#include "render/unscattered/stage.h"

#include <stddef.h>
#include <string.h>

#define AT(type, member, bytes) (offsetof(struct type, member) == (bytes))
_Static_assert(sizeof(struct pell_lit_point) == 128 && AT(pell_lit_point, hash0, 96) && AT(pell_lit_point, material, 112) &&
                   sizeof(struct pell_lit_material) == 176 && AT(pell_lit_material, enter_base, 32) &&
                   sizeof(struct pell_lit_image) == 16 && sizeof(struct pell_lit_mesh) == 16 && sizeof(struct pell_lights_part) == 8 &&
                   sizeof(struct pell_lit_push) == 72,
               "as std430 lays them out");
_Static_assert(PELL_LIT_ALBEDO_MU == PELL_ALBEDO_MU && PELL_LIT_ALBEDO_ROUGHNESS == PELL_ALBEDO_ROUGHNESS &&
                   PELL_LIT_BOUNDARY_MU == PELL_BOUNDARY_MU && PELL_LIT_THICKNESS_STEPS == PELL_THICKNESS_STEPS,
               "device_data.h has the tables' sizes");

enum pell_result pell_light_device_create(struct pell_context *ctx, struct pell_gpu *gpu, struct pell_light_device **out)
{
    struct pell_light_device *d = pell_zalloc(ctx, sizeof(*d));
    enum pell_result res;

    *out = NULL;
    if (!d)
        return PELL_ERR_NOMEM;
    d->ctx = ctx;
    d->gpu = gpu;
    PELL_TRY(pell_gpu_commands_create(gpu, "direct light", &d->commands));
    *out = d;
    return PELL_OK;

fail:
    pell_light_device_destroy(&d);
    return res;
}

void pell_light_device_destroy(struct pell_light_device **device)
{
    struct pell_light_device *d = *device;

    if (!d)
        return;
    *device = NULL;
    pell_gpu_commands_destroy(&d->commands);
    pell_light_device_drop_lights(d);
    light_device_drop_room(d);
    light_device_drop_buffers(d, 0, BUFFERS - 1);
    pell_free(d->ctx, d);
}

/* --- Transmission -------------------------------------------------------------------------------------------------------------------- */

static const struct pell_thickness_table *table_of(const struct pell_light_device *d, const struct pell_irradiance_params *p,
                                                   size_t material)
{
    const struct pell_thickness_table *t = p->thickness && !d->scene->materials[material].opaque ? p->thickness[material] : NULL;

    return t && t->max_mm > 0.0f ? t : NULL;
}

/* Writes a slab's table without forward-scattered light, which is directional. */
static void slab_of_lights(const struct pell_thickness_table *t, const struct pell_indirect_forward *forward, float *out)
{
    for (int i = 0; i < PELL_THICKNESS_STEPS; i++) {
        const float x = (float) i / (PELL_THICKNESS_STEPS - 1), d = t->max_mm * x * x;
        for (int c = 0; c < 3; c++)
            out[3 * i + c] = t->slab[i][c] * (forward ? pell_forward_diffuse(&forward->model, c, d, forward->separation[c]) : 1.0f);
    }
}

enum pell_result pell_light_device_set_thickness(struct pell_light_device *d, const struct pell_irradiance_params *p)
{
    size_t size = 0;
    float *values;
    enum pell_result res;

    for (size_t i = 0; i < d->scene->num_materials; i++)
        size += table_of(d, p, i) ? TABLE * sizeof(*values) : 0;
    d->through_why = size == 0                             ? NULL
                     : !d->buffers[CORNERS]                ? "transmission by the cpu: more corners than a buffer holds"
                     : size > pell_gpu_buffer_most(d->gpu) ? "transmission by the cpu: more materials than a buffer holds"
                                                           : NULL;
    d->through = size > 0 && !d->through_why;
    if (!d->through)
        return PELL_OK;
    if (size > d->room_thickness) {
        light_device_drop_buffers(d, THICKNESS, THICKNESS);
        light_device_drop_buffers(d, THICKNESS_UP, THICKNESS_UP);
        d->room_thickness = 0;
        PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_ON_DEVICE, size, "thickness", &d->buffers[THICKNESS]));
        PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_TO_DEVICE, size, "thickness, upload", &d->buffers[THICKNESS_UP]));
        d->room_thickness = size;
    }
    values = pell_gpu_buffer_host(d->buffers[THICKNESS_UP]);
    for (size_t i = 0; i < d->scene->num_materials; i++) {
        const struct pell_thickness_table *t = table_of(d, p, i);
        if (!t)
            continue;
        memcpy(values, t->value, sizeof(t->value));
        memcpy(values + TABLE / 4, t->slab, sizeof(t->slab));
        memcpy(values + 2 * (TABLE / 4), t->spread, sizeof(t->spread));
        slab_of_lights(t, p->solid_light ? pell_indirect_forward(p->solid_light, i) : NULL, values + 3 * (TABLE / 4));
        values += TABLE;
    }
    d->thickness_new = true;
    return light_device_prepare(d);

fail:
    d->through = false;
    return res;
}

const char *pell_light_device_refuses_transmission(const struct pell_light_device *d)
{
    return d->through_why;
}

/* --- Batches ------------------------------------------------------------------------------------------------------------------------- */

size_t pell_light_device_room(const struct pell_light_device *d)
{
    return d->room;
}

struct pell_lit_point *pell_light_device_points(const struct pell_light_device *d)
{
    return pell_gpu_buffer_host(d->buffers[POINTS_UP]);
}

uint32_t *pell_light_device_slots(const struct pell_light_device *d)
{
    return d->slots;
}

const uint32_t *pell_light_device_result(const struct pell_light_device *d, size_t point)
{
    return (const uint32_t *) pell_gpu_buffer_host(d->buffers[RESULTS_DOWN]) + point * d->words * (WORD / sizeof(uint32_t));
}

const uint32_t *pell_light_device_through(const struct pell_light_device *d, size_t point)
{
    return pell_light_device_result(d, point) + d->through_at * (WORD / sizeof(uint32_t));
}

static struct pell_vec4 rgb4(const float rgb[3])
{
    return (struct pell_vec4) { rgb[0], rgb[1], rgb[2], 0.0f };
}

static void fill_materials(const struct pell_light_device *d, const struct pell_irradiance_params *p)
{
    static const float one[3] = { 1.0f, 1.0f, 1.0f }, none[3];
    struct pell_lit_material *all = pell_gpu_buffer_host(d->buffers[MATERIALS_UP]);
    const struct pell_specular_tables *t = p->tables;
    int32_t tables = 0;

    for (size_t i = 0; i < d->scene->num_materials; i++) {
        const bool opaque = d->scene->materials[i].opaque;
        const struct pell_thickness_table *thickness = table_of(d, p, i);
        const struct pell_unscattered_material medium = pell_unscattered_material(p->unscattered, d->scene, i);
        const struct pell_angle *angle = p->angle && !opaque ? &p->angle[i] : NULL;
        const struct pell_separate_single *separate = p->separate && !opaque ? &p->separate[i] : NULL;
        all[i] = (struct pell_lit_material) {
            .fd = t->boundaries[t->boundary[i]].f0,
            .model = t->model[i],
            .smooth_at = p->smooth && !opaque ? (int32_t) (sizeof(t->albedo) / sizeof(float) + t->boundary[i] * PELL_BOUNDARY_MU) : -1,
            .inverse_eta2 = angle ? angle->inverse_eta2 : 1.0f,
            .single_eta2 = separate ? separate->inverse_eta2 : 0.0f,
            .thickness_at = thickness ? TABLE * tables++ : -1,
            .thickest = thickness ? thickness->max_mm : 0.0f,
            .opaque = opaque,
            .enter_base = rgb4(angle ? angle->enter_base : one),
            .enter_slope = rgb4(angle ? angle->enter_slope : none),
            .pass_base = rgb4(angle ? angle->pass_base : one),
            .pass_slope = rgb4(angle ? angle->pass_slope : none),
            .pass_per_mm = rgb4(angle ? angle->pass_per_mm : none),
            .single_albedo = rgb4(separate ? separate->albedo : none),
            .single_g = rgb4(separate ? separate->g : none),
            .sigma_t = rgb4(medium.sigma_t),
            .roughness = medium.roughness,
            .rho_s = medium.rho_s,
            .is_traced = medium.is_traced,
        };
    }
}

static void take_times(struct pell_light_device *d, size_t points, bool through)
{
    struct pell_gpu_time list[4];
    const size_t count = pell_gpu_times(d->commands, list, PELL_COUNT(list));
    double *const seconds[] = { &d->times.upload, &d->times.light, through ? &d->times.transmission : &d->times.download,
                                &d->times.download };

    for (size_t i = 0; i < count && i < PELL_COUNT(seconds); i++)
        *seconds[i] += list[i].seconds;
    d->times.points += (int64_t) points;
    d->times.bytes_up += (int64_t) (points * sizeof(struct pell_lit_point));
    d->times.bytes_down += (int64_t) (points * d->words * WORD);
}

void pell_light_device_begin(struct pell_light_device *d)
{
    atomic_store(&d->used, 0);
}

uint32_t pell_light_device_claim(struct pell_light_device *d, uint32_t points)
{
    return atomic_fetch_add_explicit(&d->used, points, memory_order_relaxed);
}

/* Selects the samples and lights of the next slice; `most` of them, or more of a single light, continued over slices. Returns false if
 * none are left. */
static bool next_slice(const struct pell_light_device *d, const struct pell_irradiance_params *p, uint32_t most, struct pell_lit_push *push)
{
    const uint32_t lights = (uint32_t) d->lights->num_sources;
    uint32_t taken = 0, at = push->light_end;

    push->flags &= ~(PELL_LIT_START | PELL_LIT_RESUME);
    push->sky = push->sky_end = 0;
    if (push->flags & PELL_LIT_PAUSE) {
        push->flags ^= PELL_LIT_PAUSE | PELL_LIT_RESUME;
        push->first = push->last;
    } else {
        while (at < lights && !pell_irradiance_requests(p, d->sorted[at].light))
            at++;
        if (at == lights)
            return false;
        push->light = at;
        push->first = 0;
        for (; at < lights && (taken == 0 || taken + (uint32_t) d->sorted[at].samples <= most); at++)
            taken += (uint32_t) d->sorted[at].samples;
        push->light_end = at;
    }
    push->last = push->first + most;
    if (push->light_end == push->light + 1 && push->last < (uint32_t) d->sorted[push->light].samples)
        push->flags |= PELL_LIT_PAUSE;
    return true;
}

/* Records a pass in slices. */
static void run_pass(struct pell_light_device *d, const struct pell_irradiance_params *p, struct pell_gpu_commands *commands,
                     struct pell_gpu_pass *pass, uint32_t most, struct pell_lit_push push)
{
    const uint32_t groups = (push.count + PELL_LIT_GROUP - 1) / PELL_LIT_GROUP;
    uint32_t sky = 0;

    for (size_t e = 0; e < d->lights->num_environments; e++)
        sky = pell_irradiance_requests(p, d->lights->environments[e].light) ? push.ambient_samples : sky;
    push.flags |= PELL_LIT_START;
    do {
        push.sky_end = push.sky + most < sky ? push.sky + most : sky;
        pell_gpu_run(commands, pass, &push, groups, 1, 1);
        push.flags &= ~PELL_LIT_START;
        push.sky = push.sky_end;
    } while (push.sky < sky);
    while (next_slice(d, p, most, &push))
        pell_gpu_run(commands, pass, &push, groups, 1, 1);
}

/* Push constants for `count` points. */
static struct pell_lit_push make_push(const struct pell_light_device *d, const struct pell_light_run *run, size_t count)
{
    const struct pell_irradiance_params *p = run->params;
    const struct pell_lights *lights = d->lights;
    const bool through = d->through && p->thickness;
    const uint32_t words =
        (uint32_t) (1 + PELL_LIT_HIGHLIGHT_WORDS * run->highlights + (p->separate != NULL) + 2 * lights->num_environments);
    const uint32_t state = PELL_LIT_HIGHLIGHT_STATE_WORDS * light_device_has_state(d);

    return (struct pell_lit_push) {
        .count = (uint32_t) count,
        .results = words + state + PELL_LIT_THROUGH_WORDS * through,
        .environments = (uint32_t) lights->num_environments,
        .low = (uint32_t) p->lights,
        .high = (uint32_t) (p->lights >> 32),
        .flags =
            (run->highlights ? PELL_LIT_HIGHLIGHTS : 0u) | (p->separate ? PELL_LIT_SINGLE : 0u) | (p->unscattered ? PELL_LIT_PASSES : 0u),
        .ambient_samples = (uint32_t) lights->ambient_samples,
        .light_bits = lights->light_bits,
        .ambient_bits = lights->ambient_bits,
        .parts = (uint32_t) lights->num_parts,
        .highlight_state = words,
        .through = words + state,
    };
}

void pell_light_device_upload(struct pell_light_device *d, const struct pell_light_run *run, struct pell_gpu_commands *commands)
{
    fill_materials(d, run->params);
    pell_gpu_copy(commands, d->buffers[MATERIALS_UP], d->buffers[MATERIALS],
                  (d->scene->num_materials + 1) * sizeof(struct pell_lit_material));
    if (d->through && run->params->thickness && d->thickness_new)
        pell_gpu_copy(commands, d->buffers[THICKNESS_UP], d->buffers[THICKNESS], d->room_thickness);
}

struct pell_light_layout pell_light_device_record(struct pell_light_device *d, const struct pell_light_run *run,
                                                  struct pell_gpu_commands *commands, size_t points)
{
    const struct pell_lit_push push = make_push(d, run, points);
    const bool through = d->through && run->params->thickness;

    pell_gpu_mark(commands, "direct light");
    run_pass(d, run->params, commands, d->direct, run->params->unscattered ? PELL_LIT_PASSING : PELL_LIT_SLICE, push);
    if (through) {
        pell_gpu_mark(commands, "transmission");
        run_pass(d, run->params, commands, d->transmission, run->params->unscattered ? PELL_LIT_PASSING : PELL_LIT_THROUGH, push);
    }
    return (struct pell_light_layout) { push.results, push.through, through };
}

void pell_light_device_recorded(struct pell_light_device *d, const struct pell_light_run *run)
{
    d->thickness_new &= !(d->through && run->params->thickness);
}

struct pell_light_lent pell_light_device_lend(const struct pell_light_device *d)
{
    return (struct pell_light_lent) {
        .nodes = d->buffers[NODES],
        .triangles = d->buffers[TRIANGLES],
        .meshes = d->buffers[MESHES],
        .corners = d->buffers[CORNERS],
        .materials = d->buffers[MATERIALS],
        .tables = d->buffers[TABLES],
        .points = d->buffers[POINTS],
        .results = d->buffers[RESULTS],
        .thickness = d->buffers[THICKNESS],
        .sky = d->buffers[SKY],
        .room = d->room,
        .environments = d->lights ? d->lights->num_environments : 0,
        .version = d->version,
        .together = d->lights ? d->lights->together : 0u,
    };
}

enum pell_result pell_light_device_run(struct pell_light_device *d, const struct pell_light_run *run)
{
    const size_t count = atomic_load(&d->used);
    struct pell_light_layout layout;
    enum pell_result res;

    if (count == 0)
        return PELL_OK;
    PELL_TRY(pell_gpu_begin(d->commands));
    pell_gpu_mark(d->commands, "upload");
    pell_light_device_upload(d, run, d->commands);
    pell_gpu_copy(d->commands, d->buffers[POINTS_UP], d->buffers[POINTS], count * sizeof(struct pell_lit_point));
    layout = pell_light_device_record(d, run, d->commands, count);
    d->words = layout.words;
    d->through_at = layout.through_at;
    pell_gpu_mark(d->commands, "download");
    pell_gpu_copy(d->commands, d->buffers[RESULTS], d->buffers[RESULTS_DOWN], count * d->words * WORD);
    PELL_TRY(pell_gpu_finish(d->commands));
    pell_light_device_recorded(d, run);
    take_times(d, count, layout.through);
    return PELL_OK;

fail:
    return res;
}

struct pell_light_device_times pell_light_device_times(struct pell_light_device *d)
{
    const struct pell_light_device_times times = d->times;

    d->times = (struct pell_light_device_times) { .points = 0 };
    return times;
}
