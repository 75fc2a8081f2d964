/* SPDX-License-Identifier: MIT
 * device.c - see device.h. */
#include "render/irradiance/device.h"

#include "image/color.h"
#include "visibility/wide_bvh.h"
#include "vulkan/gpu.h"

#include <stdatomic.h>
#include <stddef.h>
#include <string.h>

#define AT(type, member, bytes) (offsetof(struct type, member) == (bytes))
_Static_assert(sizeof(struct pell_lit_point) == 128 && AT(pell_lit_point, pattern0, 96) && AT(pell_lit_point, material, 112) &&
                   sizeof(struct pell_lit_material) == 96 && AT(pell_lit_material, enter_base, 32) && sizeof(struct pell_lit_image) == 16 &&
                   sizeof(struct pell_lit_push) == 36,
               "as std430 lays them out");
_Static_assert(PELL_LIT_ALBEDO_MU == PELL_ALBEDO_MU && PELL_LIT_ALBEDO_ROUGHNESS == PELL_ALBEDO_ROUGHNESS &&
                   PELL_LIT_BOUNDARY_MU == PELL_BOUNDARY_MU,
               "device_data.h has the tables' sizes");

enum {
    ROOM_LEAST = 1 << 16,
    ROOM_MOST = 1 << 18,     /* points of a batch: what fills a large GPU, and leaves it within a second */
    RESULTS_MOST = 64 << 20, /* bytes of a batch's results */
    ENVIRONMENTS_MOST = 256,
    WORD = 16
};

enum buffer {
    NODES,
    TRIANGLES,
    LIGHTS,
    MATERIALS,
    TABLES,
    IMAGES,
    POINTS,
    RESULTS,
    BINDINGS,
    MATERIALS_UP = BINDINGS,
    POINTS_UP,
    RESULTS_DOWN,
    BUFFERS
};

extern const struct pell_shader pell_irradiance_direct_shader;

struct pell_light_device {
    struct pell_context *ctx; /* borrowed */
    struct pell_gpu *gpu;     /* borrowed */
    struct pell_gpu_commands *commands;
    struct pell_gpu_buffer *buffers[BUFFERS];
    struct pell_gpu_pass *pass;
    const struct pell_scene *scene;   /* borrowed; NULL: none is set */
    const struct pell_lights *lights; /* borrowed; NULL: none are set */
    const char *scene_why, *lights_why;
    size_t wanted, room; /* points */
    size_t room_words;   /* of a point, that there is room for */
    size_t words;        /* of a point of the last batch */
    uint32_t *slots;
    _Atomic uint32_t used; /* points of the batch */
    struct pell_light_device_times times;
};

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

static void drop_buffers(struct pell_light_device *d, enum buffer first, enum buffer last)
{
    pell_gpu_pass_destroy(&d->pass);
    for (int i = first; i <= (int) last; i++)
        pell_gpu_buffer_destroy(&d->buffers[i]);
}

static void drop_room(struct pell_light_device *d)
{
    drop_buffers(d, POINTS, RESULTS);
    drop_buffers(d, POINTS_UP, RESULTS_DOWN);
    pell_free(d->ctx, d->slots);
    d->slots = NULL;
    d->room = d->room_words = 0;
}

void pell_light_device_destroy(struct pell_light_device **device)
{
    struct pell_light_device *d = *device;

    if (!d)
        return;
    *device = NULL;
    pell_gpu_commands_destroy(&d->commands);
    drop_room(d);
    drop_buffers(d, 0, BUFFERS - 1);
    pell_free(d->ctx, d);
}

/* A buffer on the device that holds `size` bytes of `data`. */
static enum pell_result send(struct pell_light_device *d, enum buffer which, const void *data, size_t size, const char *name)
{
    const size_t most = size > 0 ? size : WORD;
    struct pell_gpu_buffer *up = NULL;
    enum pell_result res;

    PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_ON_DEVICE, most, name, &d->buffers[which]));
    PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_TO_DEVICE, most, name, &up));
    if (size > 0)
        memcpy(pell_gpu_buffer_host(up), data, size);
    PELL_TRY(pell_gpu_begin(d->commands));
    pell_gpu_copy(d->commands, up, d->buffers[which], most);
    PELL_TRY(pell_gpu_finish(d->commands));
    pell_gpu_buffer_destroy(&up);
    return PELL_OK;

fail:
    pell_gpu_buffer_destroy(&up);
    return res;
}

/* --- What is kept: scene, lights, room ---------------------------------------------------------------------------------------------- */

void pell_light_device_drop_scene(struct pell_light_device *d)
{
    drop_buffers(d, NODES, TRIANGLES);
    drop_buffers(d, MATERIALS, MATERIALS);
    drop_buffers(d, MATERIALS_UP, MATERIALS_UP);
    d->scene = NULL;
    d->scene_why = NULL;
}

enum pell_result pell_light_device_set_scene(struct pell_light_device *d, const struct pell_scene *scene)
{
    const uint64_t most = pell_gpu_buffer_most(d->gpu), materials = (scene->num_materials + 1) * sizeof(struct pell_lit_material);
    struct pell_wide_bvh *bvh = NULL;
    size_t nodes, triangles;
    enum pell_result res;

    pell_light_device_drop_scene(d);
    PELL_TRY(pell_wide_bvh_create(d->ctx, scene, &bvh));
    d->scene = scene;
    nodes = bvh->num_nodes * PELL_WIDE_NODE * 4;
    triangles = bvh->num_triangles * PELL_WIDE_TRIANGLE * 4;
    d->scene_why = bvh->cut                           ? "direct light by the cpu: alpha cuts surfaces"
                   : nodes > most || triangles > most ? "direct light by the cpu: more triangles than a buffer holds"
                                                      : NULL;
    if (!d->scene_why) {
        PELL_TRY(send(d, NODES, bvh->nodes, nodes, "rays' nodes"));
        PELL_TRY(send(d, TRIANGLES, bvh->triangles, triangles, "rays' triangles"));
        PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_ON_DEVICE, materials, "light, materials", &d->buffers[MATERIALS]));
        PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_TO_DEVICE, materials, "light, materials, upload", &d->buffers[MATERIALS_UP]));
    }
    pell_wide_bvh_destroy(&bvh);
    return PELL_OK;

fail:
    pell_wide_bvh_destroy(&bvh);
    pell_light_device_drop_scene(d);
    return res;
}

void pell_light_device_drop_lights(struct pell_light_device *d)
{
    drop_buffers(d, LIGHTS, LIGHTS);
    drop_buffers(d, TABLES, IMAGES);
    d->lights = NULL;
    d->lights_why = NULL;
}

/* Whether no light before has its image. */
static bool is_first(const struct pell_lights *lights, size_t light)
{
    for (size_t i = 0; i < light; i++)
        if (lights->sources[i].image == lights->sources[light].image)
            return false;
    return lights->sources[light].image != NULL;
}

/* Number of the image among those of the lights before. */
static size_t image_number(const struct pell_lights *lights, size_t light)
{
    const struct pell_texture *image = lights->sources[light].image;
    size_t number = 0;

    for (size_t i = 0; lights->sources[i].image != image; i++)
        number += is_first(lights, i);
    return number;
}

static enum pell_result send_images(struct pell_light_device *d, const struct pell_lights *lights)
{
    const uint64_t most = pell_gpu_buffer_most(d->gpu);
    uint64_t words = 0;
    uint32_t count = 0, at;
    struct pell_lit_image *all;
    enum pell_result res;

    for (size_t i = 0; i < lights->num_sources; i++)
        if (is_first(lights, i)) {
            words += 1 + (uint64_t) lights->sources[i].image->image.width * (uint64_t) lights->sources[i].image->image.height;
            count++;
        }
    if (words * WORD > most) {
        d->lights_why = "direct light by the cpu: a projected image that no buffer holds";
        return PELL_OK;
    }
    all = pell_calloc(d->ctx, (size_t) words + 1, WORD);
    if (!all)
        return PELL_ERR_NOMEM;
    at = count;
    count = 0;
    for (size_t i = 0; i < lights->num_sources; i++) {
        const struct pell_image *image = is_first(lights, i) ? &lights->sources[i].image->image : NULL;
        if (!image)
            continue;
        all[count++] = (struct pell_lit_image) { at, (uint32_t) image->width, (uint32_t) image->height, lights->sources[i].image->nearest };
        for (int y = 0; y < image->height; y++)
            for (int x = 0; x < image->width; x++) {
                float rgba[4];
                pell_image_texel(image, x, y, rgba);
                memcpy(&all[at++], rgba, WORD);
            }
    }
    res = send(d, IMAGES, all, (size_t) words * WORD, "light, images");
    pell_free(d->ctx, all);
    return res;
}

static enum pell_result send_lights(struct pell_light_device *d, const struct pell_lights *lights)
{
    struct pell_light_data *all = pell_calloc(d->ctx, lights->num_sources + 1, sizeof(*all));
    size_t count = 0;
    enum pell_result res;

    if (!all)
        return PELL_ERR_NOMEM;
    for (int e = -1; e < (int) lights->num_environments; e++)
        for (size_t i = 0; i < lights->num_sources; i++) {
            if (lights->sources[i].environment != e)
                continue;
            all[count] = lights->data[i];
            all[count].light = e < 0 ? lights->sources[i].light : lights->environments[e].light;
            all[count++].image = lights->sources[i].image ? (int32_t) image_number(lights, i) : -1;
        }
    res = send(d, LIGHTS, all, count * sizeof(*all), "lights");
    pell_free(d->ctx, all);
    return res;
}

static enum pell_result send_tables(struct pell_light_device *d, const struct pell_specular_tables *t)
{
    const size_t of_albedo = sizeof(t->albedo) / sizeof(float), all = of_albedo + t->num_boundaries * PELL_BOUNDARY_MU;
    float *values = pell_alloc_array(d->ctx, all, sizeof(*values));
    enum pell_result res;

    if (!values)
        return PELL_ERR_NOMEM;
    memcpy(values, t->albedo, sizeof(t->albedo));
    for (size_t i = 0; i < t->num_boundaries; i++)
        memcpy(values + of_albedo + i * PELL_BOUNDARY_MU, t->boundaries[i].transmittance, sizeof(t->boundaries[i].transmittance));
    res = send(d, TABLES, values, all * sizeof(*values), "light, tables");
    pell_free(d->ctx, values);
    return res;
}

/* Makes the room, where lights say how large a point's result is, and the pass, where all of its buffers are there. */
static enum pell_result prepare(struct pell_light_device *d)
{
    size_t words, room;
    enum pell_result res;

    if (!d->scene || !d->lights || pell_light_device_refuses(d) || d->wanted == 0)
        return PELL_OK;
    words = 3 + 2 * d->lights->num_environments;
    room = d->wanted < RESULTS_MOST / (WORD * words) ? d->wanted : RESULTS_MOST / (WORD * words);
    if (room > d->room || words > d->room_words) {
        drop_room(d);
        res = PELL_ERR_NOMEM;
        d->slots = pell_calloc(d->ctx, room / 16 + 1, sizeof(*d->slots));
        if (!d->slots)
            goto fail;
        PELL_TRY(
            pell_gpu_buffer_create(d->gpu, PELL_GPU_ON_DEVICE, room * sizeof(struct pell_lit_point), "lit points", &d->buffers[POINTS]));
        PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_TO_DEVICE, room * sizeof(struct pell_lit_point), "lit points, upload",
                                        &d->buffers[POINTS_UP]));
        PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_ON_DEVICE, room * words * WORD, "direct light", &d->buffers[RESULTS]));
        PELL_TRY(
            pell_gpu_buffer_create(d->gpu, PELL_GPU_FROM_DEVICE, room * words * WORD, "direct light, download", &d->buffers[RESULTS_DOWN]));
        d->room = room;
        d->room_words = words;
    }
    return d->pass ? PELL_OK : pell_gpu_pass_create(d->gpu, &pell_irradiance_direct_shader, NULL, 0, d->buffers, &d->pass);

fail:
    drop_room(d);
    return res;
}

enum pell_result pell_light_device_set_lights(struct pell_light_device *d, const struct pell_lights *lights,
                                              const struct pell_specular_tables *tables)
{
    enum pell_result res;

    pell_light_device_drop_lights(d);
    if (d->scene_why)
        return PELL_OK;
    if (lights->num_environments > ENVIRONMENTS_MOST) {
        d->lights_why = "direct light by the cpu: more environments than a batch has room for";
        return PELL_OK;
    }
    PELL_TRY(send_images(d, lights));
    if (d->lights_why)
        return PELL_OK;
    PELL_TRY(send_lights(d, lights));
    PELL_TRY(send_tables(d, tables));
    d->lights = lights;
    PELL_TRY(prepare(d));
    return PELL_OK;

fail:
    pell_light_device_drop_lights(d);
    return res;
}

enum pell_result pell_light_device_reserve(struct pell_light_device *d, size_t points)
{
    const size_t wanted = points < ROOM_LEAST ? ROOM_LEAST : points < ROOM_MOST ? points : ROOM_MOST;

    d->wanted = wanted > d->wanted ? wanted : d->wanted;
    return prepare(d);
}

const char *pell_light_device_refuses(const struct pell_light_device *d)
{
    return d->scene_why ? d->scene_why : d->lights_why;
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

static struct pell_vec4 rgb4(const float rgb[3])
{
    return (struct pell_vec4) { rgb[0], rgb[1], rgb[2], 0.0f };
}

static void fill_materials(const struct pell_light_device *d, const struct pell_irradiance_params *p)
{
    static const float one[3] = { 1.0f, 1.0f, 1.0f }, none[3];
    struct pell_lit_material *all = pell_gpu_buffer_host(d->buffers[MATERIALS_UP]);
    const struct pell_specular_tables *t = p->tables;

    for (size_t i = 0; i < d->scene->num_materials; i++) {
        const bool opaque = d->scene->materials[i].opaque;
        const struct pell_angle *angle = p->angle && !opaque ? &p->angle[i] : NULL;
        const struct pell_single_apart *apart = p->apart && !opaque ? &p->apart[i] : NULL;
        all[i] = (struct pell_lit_material) {
            .fd = t->boundaries[t->boundary[i]].f0,
            .model = t->model[i],
            .smooth_at = p->smooth && !opaque ? (int32_t) (sizeof(t->albedo) / sizeof(float) + t->boundary[i] * PELL_BOUNDARY_MU) : -1,
            .inverse_eta2 = angle ? angle->inverse_eta2 : 1.0f,
            .single_eta2 = apart ? apart->inverse_eta2 : 0.0f,
            .enter_base = rgb4(angle ? angle->enter_base : one),
            .enter_slope = rgb4(angle ? angle->enter_slope : none),
            .single_albedo = rgb4(apart ? apart->albedo : none),
            .single_g = rgb4(apart ? apart->g : none),
        };
    }
}

static void take_times(struct pell_light_device *d, size_t points)
{
    struct pell_gpu_time list[4];
    const size_t count = pell_gpu_times(d->commands, list, PELL_COUNT(list));
    double *const seconds[] = { &d->times.upload, &d->times.light, &d->times.download };

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

enum pell_result pell_light_device_run(struct pell_light_device *d, const struct pell_light_run *run)
{
    const size_t count = atomic_load(&d->used);
    const struct pell_irradiance_params *p = run->params;
    const struct pell_lights *lights = d->lights;
    const struct pell_lit_push push = {
        .count = (uint32_t) count,
        .results = (uint32_t) (1 + 2 * run->highlights + (p->apart != NULL) + 2 * lights->num_environments),
        .lights = (uint32_t) lights->num_sources,
        .environments = (uint32_t) lights->num_environments,
        .low = (uint32_t) p->lights,
        .high = (uint32_t) (p->lights >> 32),
        .flags = (run->highlights ? PELL_LIT_HIGHLIGHTS : 0u) | (p->apart ? PELL_LIT_SINGLE : 0u),
        .ambient_samples = (uint32_t) lights->ambient_samples,
        .light_bits = lights->light_bits,
    };
    enum pell_result res;

    if (count == 0)
        return PELL_OK;
    d->words = push.results;
    fill_materials(d, p);
    PELL_TRY(pell_gpu_begin(d->commands));
    pell_gpu_mark(d->commands, "upload");
    pell_gpu_copy(d->commands, d->buffers[MATERIALS_UP], d->buffers[MATERIALS],
                  (d->scene->num_materials + 1) * sizeof(struct pell_lit_material));
    pell_gpu_copy(d->commands, d->buffers[POINTS_UP], d->buffers[POINTS], count * sizeof(struct pell_lit_point));
    pell_gpu_mark(d->commands, "direct light");
    pell_gpu_run(d->commands, d->pass, &push, (uint32_t) ((count + PELL_LIT_GROUP - 1) / PELL_LIT_GROUP), 1, 1);
    pell_gpu_mark(d->commands, "download");
    pell_gpu_copy(d->commands, d->buffers[RESULTS], d->buffers[RESULTS_DOWN], count * d->words * WORD);
    PELL_TRY(pell_gpu_finish(d->commands));
    take_times(d, count);
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
