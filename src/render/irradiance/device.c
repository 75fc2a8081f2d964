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
_Static_assert(sizeof(struct pell_lit_point) == 128 && AT(pell_lit_point, hash0, 96) && AT(pell_lit_point, material, 112) &&
                   sizeof(struct pell_lit_material) == 144 && AT(pell_lit_material, enter_base, 32) &&
                   sizeof(struct pell_lit_image) == 16 && sizeof(struct pell_lit_mesh) == 16 && sizeof(struct pell_lights_part) == 8 &&
                   sizeof(struct pell_lit_push) == 72,
               "as std430 lays them out");
_Static_assert(PELL_LIT_ALBEDO_MU == PELL_ALBEDO_MU && PELL_LIT_ALBEDO_ROUGHNESS == PELL_ALBEDO_ROUGHNESS &&
                   PELL_LIT_BOUNDARY_MU == PELL_BOUNDARY_MU && PELL_LIT_THICKNESS_STEPS == PELL_THICKNESS_STEPS,
               "device_data.h has the tables' sizes");

enum {
    ROOM_LEAST = 1 << 16,
    ROOM_MOST = 1 << 18,     /* points of a batch: what fills a large GPU, and leaves it within a second */
    RESULTS_MOST = 64 << 20, /* bytes of a batch's results */
    ENVIRONMENTS_MOST = 256,
    WORD = 16,
    TABLE = 2 * 3 * PELL_THICKNESS_STEPS /* floats of a thickness table */
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
    MESHES, /* and on: transmission.comp */
    CORNERS,
    PARTS,
    THICKNESS,
    MATERIALS_UP,
    POINTS_UP,
    RESULTS_DOWN,
    THICKNESS_UP,
    BUFFERS
};

extern const struct pell_shader pell_irradiance_direct_shader, pell_irradiance_transmission_shader;

struct pell_light_device {
    struct pell_context *ctx; /* borrowed */
    struct pell_gpu *gpu;     /* borrowed */
    struct pell_gpu_commands *commands;
    struct pell_gpu_buffer *buffers[BUFFERS];
    struct pell_gpu_pass *direct, *transmission;
    const struct pell_scene *scene;   /* borrowed; NULL: none is set */
    const struct pell_lights *lights; /* borrowed; NULL: none are set */
    struct pell_light_data *sorted;   /* as the device has them, */
    uint32_t most_samples;            /* and the most that one has */
    const char *scene_why, *lights_why, *through_why;
    bool through;          /* thickness tables are set, */
    bool thickness_new;    /* and not sent yet; */
    size_t room_thickness; /* bytes that there is room for */
    size_t wanted, room;   /* points */
    size_t room_words;     /* of a point, that there is room for */
    size_t words;          /* of a point of the last batch */
    size_t through_at;     /* where those of transmission are among them, if there are some */
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
    pell_gpu_pass_destroy(&d->direct);
    pell_gpu_pass_destroy(&d->transmission);
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
    pell_light_device_drop_lights(d);
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
    drop_buffers(d, MESHES, CORNERS);
    drop_buffers(d, THICKNESS, THICKNESS);
    drop_buffers(d, THICKNESS_UP, THICKNESS_UP);
    d->room_thickness = 0;
    d->through = false;
    d->scene = NULL;
    d->scene_why = NULL;
}

/* What transmission reads of the meshes, where a buffer holds it. */
static enum pell_result send_meshes(struct pell_light_device *d, const struct pell_scene *scene)
{
    struct pell_lit_mesh *meshes = pell_calloc(d->ctx, scene->num_meshes + 1, sizeof(*meshes));
    uint32_t *corners = NULL, at = 0;
    uint64_t words = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!meshes)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < scene->num_meshes; i++)
        words += 3 * ((uint64_t) scene->meshes[i].num_triangles + (scene->meshes[i].normal ? scene->meshes[i].num_vertices : 0));
    if (words * sizeof(*corners) > pell_gpu_buffer_most(d->gpu)) {
        pell_free(d->ctx, meshes);
        return PELL_OK;
    }
    corners = pell_alloc_array(d->ctx, (size_t) words + 1, sizeof(*corners));
    if (!corners)
        goto fail;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        meshes[i] = (struct pell_lit_mesh) { at, PELL_LIT_NONE, mesh->object, mesh->material };
        memcpy(corners + at, mesh->index, 3 * sizeof(*corners) * mesh->num_triangles);
        at += 3 * mesh->num_triangles;
    }
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        if (!mesh->normal)
            continue;
        meshes[i].normals = at;
        memcpy(corners + at, mesh->normal, 3 * sizeof(*corners) * mesh->num_vertices);
        at += 3 * mesh->num_vertices;
    }
    PELL_TRY(send(d, MESHES, meshes, scene->num_meshes * sizeof(*meshes), "light, meshes"));
    PELL_TRY(send(d, CORNERS, corners, (size_t) words * sizeof(*corners), "light, corners"));

fail:
    pell_free(d->ctx, corners);
    pell_free(d->ctx, meshes);
    return res;
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
        PELL_TRY(send_meshes(d, scene));
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
    drop_buffers(d, PARTS, PARTS);
    pell_free(d->ctx, d->sorted);
    d->sorted = NULL;
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
    size_t count = 0;

    d->sorted = pell_calloc(d->ctx, lights->num_sources + 1, sizeof(*d->sorted));
    if (!d->sorted)
        return PELL_ERR_NOMEM;
    d->most_samples = 0;
    for (int e = -1; e < (int) lights->num_environments; e++)
        for (size_t i = 0; i < lights->num_sources; i++) {
            const struct pell_light_source *source = &lights->sources[i];
            struct pell_light_data *light = &d->sorted[count];
            if (source->environment != e)
                continue;
            count++;
            *light = lights->data[i];
            light->light = e < 0 ? source->light : lights->environments[e].light;
            light->flags |= (uint32_t) source->turn << PELL_LIT_TURN_AT | (uint32_t) source->turns << PELL_LIT_TURNS_AT;
            light->image = source->image ? (int32_t) image_number(lights, i) : -1;
            d->most_samples = (uint32_t) source->samples > d->most_samples ? (uint32_t) source->samples : d->most_samples;
        }
    return send(d, LIGHTS, d->sorted, count * sizeof(*d->sorted), "lights");
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

/* Whether some light's highlight is made in several slices. */
static bool has_state(const struct pell_light_device *d)
{
    return d->most_samples > PELL_LIT_SLICE;
}

/* Makes the room, where lights say how large a point's result is, and the passes, where all of their buffers are there. */
static enum pell_result prepare(struct pell_light_device *d)
{
    size_t words, room;
    enum pell_result res;

    if (!d->scene || !d->lights || pell_light_device_refuses(d) || d->wanted == 0)
        return PELL_OK;
    words = 3 + 2 * d->lights->num_environments + PELL_LIT_SHINE_WORDS * has_state(d) + PELL_LIT_THROUGH_WORDS * d->through;
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
    if (!d->direct)
        PELL_TRY(pell_gpu_pass_create(d->gpu, &pell_irradiance_direct_shader, NULL, 0, d->buffers, &d->direct));
    if (d->through && !d->transmission)
        PELL_TRY(pell_gpu_pass_create(d->gpu, &pell_irradiance_transmission_shader, NULL, 0, d->buffers, &d->transmission));
    return PELL_OK;

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
    PELL_TRY(send(d, PARTS, lights->parts, lights->num_parts * sizeof(*lights->parts), "light, parts"));
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

/* --- Transmission -------------------------------------------------------------------------------------------------------------------- */

static const struct pell_thickness_table *table_of(const struct pell_light_device *d, const struct pell_irradiance_params *p,
                                                   size_t material)
{
    const struct pell_thickness_table *t = p->thickness && !d->scene->materials[material].opaque ? p->thickness[material] : NULL;

    return t && t->max_mm > 0.0f ? t : NULL;
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
        drop_buffers(d, THICKNESS, THICKNESS);
        drop_buffers(d, THICKNESS_UP, THICKNESS_UP);
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
        memcpy(values + TABLE / 2, t->slab, sizeof(t->slab));
        values += TABLE;
    }
    d->thickness_new = true;
    return prepare(d);

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
        const struct pell_angle *angle = p->angle && !opaque ? &p->angle[i] : NULL;
        const struct pell_single_apart *apart = p->apart && !opaque ? &p->apart[i] : NULL;
        all[i] = (struct pell_lit_material) {
            .fd = t->boundaries[t->boundary[i]].f0,
            .model = t->model[i],
            .smooth_at = p->smooth && !opaque ? (int32_t) (sizeof(t->albedo) / sizeof(float) + t->boundary[i] * PELL_BOUNDARY_MU) : -1,
            .inverse_eta2 = angle ? angle->inverse_eta2 : 1.0f,
            .single_eta2 = apart ? apart->inverse_eta2 : 0.0f,
            .thickness_at = thickness ? TABLE * tables++ : -1,
            .thickest = thickness ? thickness->max_mm : 0.0f,
            .opaque = opaque,
            .enter_base = rgb4(angle ? angle->enter_base : one),
            .enter_slope = rgb4(angle ? angle->enter_slope : none),
            .pass_base = rgb4(angle ? angle->pass_base : one),
            .pass_slope = rgb4(angle ? angle->pass_slope : none),
            .pass_thick = rgb4(angle ? angle->pass_thick : none),
            .single_albedo = rgb4(apart ? apart->albedo : none),
            .single_g = rgb4(apart ? apart->g : none),
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

static bool is_asked(const struct pell_irradiance_params *p, int light)
{
    return p->lights == 0 || (p->lights & pell_light_bit((size_t) light));
}

/* Which samples of which lights a pass takes at once, from where the slice before ended; `most` of them, or more of a single light's than
 * that by turns. False: there are none left. */
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
        while (at < lights && !is_asked(p, d->sorted[at].light))
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

/* A pass in slices. */
static void run_pass(struct pell_light_device *d, const struct pell_irradiance_params *p, struct pell_gpu_pass *pass, uint32_t most,
                     struct pell_lit_push push)
{
    const uint32_t groups = (push.count + PELL_LIT_GROUP - 1) / PELL_LIT_GROUP;
    uint32_t sky = 0;

    for (size_t e = 0; e < d->lights->num_environments; e++)
        sky = is_asked(p, d->lights->environments[e].light) ? push.ambient_samples : sky;
    push.flags |= PELL_LIT_START;
    do {
        push.sky_end = push.sky + most < sky ? push.sky + most : sky;
        pell_gpu_run(d->commands, pass, &push, groups, 1, 1);
        push.flags &= ~PELL_LIT_START;
        push.sky = push.sky_end;
    } while (push.sky < sky);
    while (next_slice(d, p, most, &push))
        pell_gpu_run(d->commands, pass, &push, groups, 1, 1);
}

enum pell_result pell_light_device_run(struct pell_light_device *d, const struct pell_light_run *run)
{
    const size_t count = atomic_load(&d->used);
    const struct pell_irradiance_params *p = run->params;
    const struct pell_lights *lights = d->lights;
    const bool through = d->through && p->thickness;
    const uint32_t words = (uint32_t) (1 + 2 * run->highlights + (p->apart != NULL) + 2 * lights->num_environments);
    const struct pell_lit_push push = {
        .count = (uint32_t) count,
        .results = words + PELL_LIT_SHINE_WORDS * has_state(d) + PELL_LIT_THROUGH_WORDS * through,
        .environments = (uint32_t) lights->num_environments,
        .low = (uint32_t) p->lights,
        .high = (uint32_t) (p->lights >> 32),
        .flags = (run->highlights ? PELL_LIT_HIGHLIGHTS : 0u) | (p->apart ? PELL_LIT_SINGLE : 0u),
        .ambient_samples = (uint32_t) lights->ambient_samples,
        .light_bits = lights->light_bits,
        .ambient_bits = lights->ambient_bits,
        .parts = (uint32_t) lights->num_parts,
        .shine = words,
        .through = words + PELL_LIT_SHINE_WORDS * has_state(d),
    };
    enum pell_result res;

    if (count == 0)
        return PELL_OK;
    d->words = push.results;
    d->through_at = push.through;
    fill_materials(d, p);
    PELL_TRY(pell_gpu_begin(d->commands));
    pell_gpu_mark(d->commands, "upload");
    pell_gpu_copy(d->commands, d->buffers[MATERIALS_UP], d->buffers[MATERIALS],
                  (d->scene->num_materials + 1) * sizeof(struct pell_lit_material));
    pell_gpu_copy(d->commands, d->buffers[POINTS_UP], d->buffers[POINTS], count * sizeof(struct pell_lit_point));
    if (through && d->thickness_new)
        pell_gpu_copy(d->commands, d->buffers[THICKNESS_UP], d->buffers[THICKNESS], d->room_thickness);
    pell_gpu_mark(d->commands, "direct light");
    run_pass(d, p, d->direct, PELL_LIT_SLICE, push);
    if (through) {
        pell_gpu_mark(d->commands, "transmission");
        run_pass(d, p, d->transmission, PELL_LIT_THROUGH, push);
    }
    pell_gpu_mark(d->commands, "download");
    pell_gpu_copy(d->commands, d->buffers[RESULTS], d->buffers[RESULTS_DOWN], count * d->words * WORD);
    PELL_TRY(pell_gpu_finish(d->commands));
    d->thickness_new &= !through;
    take_times(d, count, through);
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
