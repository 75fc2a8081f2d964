/* SPDX-License-Identifier: MIT
 * buffers.c - data for direct light on a device: scene, lights, tables, and the buffers of a batch. */
#include "render/irradiance/device_state.h"

#include "image/color.h"
#include "visibility/wide_bvh.h"

#include <string.h>

extern const struct pell_shader pell_irradiance_direct_shader, pell_irradiance_transmission_shader;

void light_device_drop_buffers(struct pell_light_device *d, enum pell_light_buffer first, enum pell_light_buffer last)
{
    d->version++;
    pell_gpu_pass_destroy(&d->direct);
    pell_gpu_pass_destroy(&d->transmission);
    for (int i = first; i <= (int) last; i++)
        pell_gpu_buffer_destroy(&d->buffers[i]);
}

void light_device_drop_room(struct pell_light_device *d)
{
    light_device_drop_buffers(d, POINTS, RESULTS);
    light_device_drop_buffers(d, POINTS_UP, RESULTS_DOWN);
    pell_free(d->ctx, d->slots);
    d->slots = NULL;
    d->room = d->room_words = 0;
}

/* Creates a buffer on the device with `size` bytes of `data`. */
static enum pell_result send(struct pell_light_device *d, enum pell_light_buffer which, const void *data, size_t size, const char *name)
{
    const size_t bytes = size > 0 ? size : WORD; /* a buffer is never empty */
    struct pell_gpu_buffer *up = NULL;
    enum pell_result res;

    PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_ON_DEVICE, bytes, name, &d->buffers[which]));
    PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_TO_DEVICE, bytes, name, &up));
    if (size > 0)
        memcpy(pell_gpu_buffer_host(up), data, size);
    PELL_TRY(pell_gpu_begin(d->commands));
    pell_gpu_copy(d->commands, up, d->buffers[which], bytes);
    PELL_TRY(pell_gpu_finish(d->commands));
    pell_gpu_buffer_destroy(&up);
    return PELL_OK;

fail:
    pell_gpu_buffer_destroy(&up);
    return res;
}

/* --- Persistent data: scene, lights, batch buffers ------------------------------------------------------------------------------------ */

void pell_light_device_drop_scene(struct pell_light_device *d)
{
    light_device_drop_buffers(d, NODES, TRIANGLES);
    light_device_drop_buffers(d, MATERIALS, MATERIALS);
    light_device_drop_buffers(d, MATERIALS_UP, MATERIALS_UP);
    light_device_drop_buffers(d, MESHES, CORNERS);
    light_device_drop_buffers(d, THICKNESS, THICKNESS);
    light_device_drop_buffers(d, THICKNESS_UP, THICKNESS_UP);
    d->room_thickness = 0;
    d->through = false;
    d->scene = NULL;
    d->scene_why = NULL;
}

/* Mesh data; for transmission that of triangles, too, if a buffer holds it. */
static enum pell_result send_meshes(struct pell_light_device *d, const struct pell_scene *scene)
{
    struct pell_lit_mesh *meshes = pell_calloc(d->ctx, scene->num_meshes + 1, sizeof(*meshes));
    uint32_t *corners = NULL, at = 0;
    uint64_t words = 0;
    bool fits;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!meshes)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < scene->num_meshes; i++)
        words += 3 * ((uint64_t) scene->meshes[i].num_triangles + (scene->meshes[i].normal ? scene->meshes[i].num_vertices : 0));
    fits = words * sizeof(*corners) <= pell_gpu_buffer_most(d->gpu);
    corners = pell_alloc_array(d->ctx, fits ? (size_t) words + 1 : 1, sizeof(*corners));
    if (!corners)
        goto fail;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        meshes[i] = (struct pell_lit_mesh) { at, PELL_LIT_NONE, pell_mesh_assembly(mesh), mesh->material };
        if (!fits)
            continue;
        memcpy(corners + at, mesh->index, 3 * sizeof(*corners) * mesh->num_triangles);
        at += 3 * mesh->num_triangles;
    }
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        if (!fits || !mesh->normal)
            continue;
        meshes[i].normals = at;
        memcpy(corners + at, mesh->normal, 3 * sizeof(*corners) * mesh->num_vertices);
        at += 3 * mesh->num_vertices;
    }
    PELL_TRY(send(d, MESHES, meshes, scene->num_meshes * sizeof(*meshes), "light, meshes"));
    if (fits)
        PELL_TRY(send(d, CORNERS, corners, (size_t) words * sizeof(*corners), "light, corners"));

fail:
    pell_free(d->ctx, corners);
    pell_free(d->ctx, meshes);
    return res;
}

/* The device's rays meet surface inside of its own object, which does not bound the medium there. */
static bool overlaps(const struct pell_scene *scene)
{
    bool any = false;

    for (size_t i = 0; i < scene->num_meshes; i++)
        any |= scene->meshes[i].overlaps && !scene->materials[scene->meshes[i].material].opaque;
    return any;
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
                   : overlaps(scene)                  ? "direct light by the cpu: parts of an object overlap"
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
    light_device_drop_buffers(d, LIGHTS, LIGHTS);
    light_device_drop_buffers(d, TABLES, IMAGES);
    light_device_drop_buffers(d, PARTS, PARTS);
    light_device_drop_buffers(d, SKY, SKY);
    pell_free(d->ctx, d->sorted);
    d->sorted = NULL;
    d->lights = NULL;
    d->lights_why = NULL;
}

/* Whether no earlier light has the same image. */
static bool is_first(const struct pell_lights *lights, size_t light)
{
    for (size_t i = 0; i < light; i++)
        if (lights->sources[i].image == lights->sources[light].image)
            return false;
    return lights->sources[light].image != NULL;
}

/* Index of the image among those of earlier lights. */
static size_t image_index(const struct pell_lights *lights, size_t light)
{
    const struct pell_texture *image = lights->sources[light].image;
    size_t count = 0;

    for (size_t i = 0; lights->sources[i].image != image; i++)
        count += is_first(lights, i);
    return count;
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
            light->image = source->image ? (int32_t) image_index(lights, i) : -1;
            d->most_samples = (uint32_t) source->samples > d->most_samples ? (uint32_t) source->samples : d->most_samples;
        }
    return send(d, LIGHTS, d->sorted, count * sizeof(*d->sorted), "lights");
}

static enum pell_result send_tables(struct pell_light_device *d, const struct pell_specular_tables *t)
{
    const size_t num_albedo = sizeof(t->albedo) / sizeof(float), mean_at = num_albedo + t->num_boundaries * PELL_BOUNDARY_MU;
    const size_t all = mean_at + sizeof(t->mean) / sizeof(float);
    float *values = pell_alloc_array(d->ctx, all, sizeof(*values));
    enum pell_result res;

    if (!values)
        return PELL_ERR_NOMEM;
    memcpy(values, t->albedo, sizeof(t->albedo));
    for (size_t i = 0; i < t->num_boundaries; i++)
        memcpy(values + num_albedo + i * PELL_BOUNDARY_MU, t->boundaries[i].transmittance, sizeof(t->boundaries[i].transmittance));
    memcpy(values + mean_at, t->mean, sizeof(t->mean));
    res = send(d, TABLES, values, all * sizeof(*values), "light, tables");
    pell_free(d->ctx, values);
    return res;
}

/* Environment lookup tables, if a buffer holds them. */
static enum pell_result send_sky(struct pell_light_device *d, const struct pell_lights *lights)
{
    const size_t words = pell_lights_environment_words(lights, NULL);
    uint32_t *sky;
    enum pell_result res;

    if (words == 0 || words * sizeof(*sky) > pell_gpu_buffer_most(d->gpu))
        return PELL_OK;
    sky = pell_alloc_array(d->ctx, words, sizeof(*sky));
    if (!sky)
        return PELL_ERR_NOMEM;
    pell_lights_environment_words(lights, sky);
    res = send(d, SKY, sky, words * sizeof(*sky), "light, environments");
    pell_free(d->ctx, sky);
    return res;
}

enum pell_result light_device_prepare(struct pell_light_device *d)
{
    size_t words, room;
    enum pell_result res;

    if (!d->scene || !d->lights || pell_light_device_refuses(d) || d->wanted == 0)
        return PELL_OK;
    words = 2 + PELL_LIT_HIGHLIGHT_WORDS + 2 * d->lights->num_environments + PELL_LIT_HIGHLIGHT_STATE_WORDS * light_device_has_state(d) +
            PELL_LIT_THROUGH_WORDS * d->through;
    room = d->wanted < RESULTS_MOST / (WORD * words) ? d->wanted : RESULTS_MOST / (WORD * words);
    if (room > d->room || words > d->room_words) {
        light_device_drop_room(d);
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
    light_device_drop_room(d);
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
    PELL_TRY(send_sky(d, lights));
    PELL_TRY(send(d, PARTS, lights->parts, lights->num_parts * sizeof(*lights->parts), "light, parts"));
    d->lights = lights;
    PELL_TRY(light_device_prepare(d));
    return PELL_OK;

fail:
    pell_light_device_drop_lights(d);
    return res;
}

enum pell_result pell_light_device_reserve(struct pell_light_device *d, size_t points)
{
    const size_t wanted = points < ROOM_LEAST ? ROOM_LEAST : points < ROOM_MOST ? points : ROOM_MOST;

    d->wanted = wanted > d->wanted ? wanted : d->wanted;
    return light_device_prepare(d);
}

const char *pell_light_device_refuses(const struct pell_light_device *d)
{
    return d->scene_why ? d->scene_why : d->lights_why;
}
