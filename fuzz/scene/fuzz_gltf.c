/* SPDX-License-Identifier: MIT
 * fuzz_gltf.c - the glTF reader on arbitrary bytes, .gltf and .glb: no crash, no leak, one message per refusal; an accepted scene is in
 * range and finite. The mutator works inside the chunks of a GLB and repairs the lengths in its headers, since otherwise few inputs
 * would pass them. */
#include "scene/import.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t max_size);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed);

static void require(bool holds)
{
    if (!holds)
        abort();
}

static void count_errors(void *user, const struct pell_message *message)
{
    if (message->level == PELL_LOG_ERROR) {
        require(message->what[0] && message->where[0]);
        ++*(int *) user;
    }
}

static void check_mesh(const struct pell_scene *scene, const struct pell_mesh *m)
{
    require(m->num_vertices > 0 && m->num_triangles > 0 && m->material >= -1 && m->material < (int) scene->num_materials);
    for (size_t i = 0; i < 3 * (size_t) m->num_triangles; i++)
        require(m->index[i] < m->num_vertices);
    for (size_t i = 0; i < 3 * (size_t) m->num_vertices; i++)
        require(isfinite(m->position[i]) && fabsf(m->normal[i]) < 1.001f);
    for (size_t i = 0; m->tangent && i < 4 * (size_t) m->num_vertices; i++)
        require(fabsf(m->tangent[i]) < 1.001f);
    for (size_t i = 0; m->color && i < 4 * (size_t) m->num_vertices; i++)
        require(m->color[i] >= 0.0f && m->color[i] <= 1e6f);
    for (int k = 0; k < PELL_UV_SETS; k++)
        for (size_t i = 0; m->uv[k] && i < 2 * (size_t) m->num_vertices; i++)
            require(isfinite(m->uv[k][i]));
}

static void check_scene(const struct pell_scene *scene)
{
    for (size_t i = 0; i < scene->num_meshes; i++)
        check_mesh(scene, &scene->meshes[i]);
    for (size_t i = 0; i < scene->num_materials; i++) {
        const struct pell_material *m = &scene->materials[i];
        for (int c = 0; c < 3; c++) {
            require(isfinite(m->medium.sigma_a[c]) && isfinite(m->medium.sigma_s_reduced[c]) && isfinite(m->emissive[c]));
            require(m->base_color[c] >= 0.0f && m->base_color[c] <= 1.0f);
        }
        require(m->roughness >= 0.0f && m->roughness <= 1.0f && m->medium.eta >= 1.0 && m->medium.eta <= 4.0);
        for (int k = 0; k < 6; k++)
            require(isfinite(m->base_color_map.matrix[k]));
    }
    for (size_t i = 0; i < scene->num_lights; i++) {
        const struct pell_light *l = &scene->lights[i];
        for (int c = 0; c < 3; c++)
            require(isfinite(l->position[c]) && isfinite(l->power[c]) && isfinite(l->direction[c]) && isfinite(l->up[c]));
        require(l->cos_inner >= l->cos_outer && l->range >= 0.0f);
    }
    for (size_t i = 0; i < scene->num_cameras; i++)
        for (int c = 0; c < 3; c++)
            require(isfinite(scene->cameras[i].position[c]) && isfinite(scene->cameras[i].forward[c]) && isfinite(scene->cameras[i].up[c]));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct pell_limits limits;
    int errors = 0;
    struct pell_context_params params = { .log = count_errors, .log_user = &errors, .limits = &limits };
    /* an even number of bytes plays animations, an odd number shows the rest pose */
    struct pell_import import = { .path = "fuzz", .root = "/dev/null", .moment = { .timed = size % 2 == 0, .time = 0.5 } };
    enum pell_result res;
    uint8_t *text;

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.vertices = limits.triangles = 20000;
    limits.nodes = limits.items = 1000;
    limits.image_pixels = 16384;
    limits.memory_bytes = 32 << 20;
    if (pell_context_create(&params, &import.ctx) != PELL_OK)
        return 0;
    text = malloc(size + 1); /* the NUL required by the contract */
    require(text && pell_scene_create(import.ctx, &import.scene) == PELL_OK);
    memcpy(text, data, size);
    text[size] = 0;
    res = pell_import_gltf(&import, text, size);
    require(res == PELL_OK ? errors == 0 : errors == 1);
    if (res == PELL_OK)
        check_scene(import.scene);
    pell_scene_destroy(&import.scene);
    require(pell_memory_used(import.ctx) == 0);
    pell_context_destroy(&import.ctx);
    free(text);
    return 0;
}

static uint32_t get32(const uint8_t *p)
{
    return p[0] | (uint32_t) p[1] << 8 | (uint32_t) p[2] << 16 | (uint32_t) p[3] << 24;
}

static void put32(uint8_t *p, size_t x)
{
    for (int i = 0; i < 4; i++)
        p[i] = (uint8_t) (x >> 8 * i);
}

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed)
{
    size_t json, rest, grown;
    uint8_t *tail;

    if (size < 28 || memcmp(data, "glTF", 4) != 0 || seed % 8 == 0)
        return LLVMFuzzerMutate(data, size, max_size);
    json = get32(data + 12);
    if (json > size - 20)
        return LLVMFuzzerMutate(data, size, max_size);
    rest = size - 20 - json;
    if (seed % 3 == 0 && rest > 8) {
        /* the binary chunk */
        grown = LLVMFuzzerMutate(data + 28 + json, rest - 8, max_size - 28 - json);
        put32(data + 20 + json, grown);
        put32(data + 8, 28 + json + grown);
        return 28 + json + grown;
    }
    if (rest == 0 || max_size - rest <= 20 || !(tail = malloc(rest))) /* libFuzzer writes a byte even where none is allowed */
        return LLVMFuzzerMutate(data, size, max_size);
    memcpy(tail, data + 20 + json, rest);
    grown = LLVMFuzzerMutate(data + 20, json, max_size - 20 - rest);
    memcpy(data + 20 + grown, tail, rest);
    free(tail);
    put32(data + 12, grown);
    put32(data + 8, 20 + grown + rest);
    return 20 + grown + rest;
}
