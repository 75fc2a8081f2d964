/* SPDX-License-Identifier: MIT
 *
 * read.c - reads a glTF 2.0 file: the containers .gltf and .glb (section 4 of the specification), the version, and the order of objects.
 */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <string.h>

static enum pell_result check_asset(struct gltf *g)
{
    struct pell_json asset;
    const char *version = NULL, *least = NULL;
    char shown[48];
    enum pell_result res;

    PELL_TRY(pell_json_is_object(&g->root));
    PELL_TRY(pell_json_require(&g->root, "asset"));
    PELL_TRY(pell_json_object(&g->root, "asset", &asset));
    PELL_TRY(pell_json_require(&asset, "version"));
    PELL_TRY(pell_json_string(&asset, "version", &version));
    PELL_TRY(pell_json_string(&asset, "minVersion", &least));
    if (strncmp(version, "2.", 2) != 0 || (least && strcmp(least, "2.0") != 0))
        return pell_json_error(&asset, PELL_ERR_UNSUPPORTED, "export it again as glTF 2.0", "version is \"%s\", allowed: 2.0",
                               pell_printable(strncmp(version, "2.", 2) != 0 || !least ? version : least, shown, sizeof(shown)));
    return PELL_OK;

fail:
    return res;
}

static enum pell_result open_arrays(struct gltf *g)
{
    const size_t items = (size_t) g->limits->items;
    const struct {
        const char *key;
        struct pell_json *out;
        size_t max;
    } arrays[] = {
        { "buffers", &g->buffers, items },       { "bufferViews", &g->views, items }, { "accessors", &g->accessors, items },
        { "images", &g->images, items },         { "samplers", &g->samplers, items }, { "textures", &g->textures, items },
        { "materials", &g->materials, items },   { "meshes", &g->meshes, items },     { "nodes", &g->nodes, (size_t) g->limits->nodes },
        { "scenes", &g->scenes, items },         { "cameras", &g->cameras, items },   { "skins", &g->skins, items },
        { "animations", &g->animations, items },
    };
    enum pell_result res;

    for (size_t i = 0; i < PELL_COUNT(arrays); i++)
        PELL_TRY(pell_json_array(&g->root, arrays[i].key, 0, arrays[i].max, arrays[i].out));
    PELL_TRY(gltf_extension(&g->root, "KHR_lights_punctual", &g->extensions, &g->lights_extension));
    PELL_TRY(pell_json_array(&g->lights_extension, "lights", 0, items, &g->lights));

    g->buffer = pell_calloc(g->ctx, pell_json_count(&g->buffers), sizeof(*g->buffer));
    g->view = pell_calloc(g->ctx, pell_json_count(&g->views), sizeof(*g->view));
    g->accessor = pell_calloc(g->ctx, pell_json_count(&g->accessors), sizeof(*g->accessor));
    g->mesh = pell_calloc(g->ctx, pell_json_count(&g->meshes), sizeof(*g->mesh));
    g->node = pell_calloc(g->ctx, pell_json_count(&g->nodes), sizeof(*g->node));
    g->skin = pell_calloc(g->ctx, pell_json_count(&g->skins), sizeof(*g->skin));
    g->material = pell_alloc_array(g->ctx, pell_json_count(&g->materials), sizeof(*g->material));
    if (!g->buffer || !g->view || !g->accessor || !g->mesh || !g->node || !g->skin || !g->material)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < pell_json_count(&g->materials); i++)
        g->material[i] = -1;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_document(struct gltf *g, const uint8_t *json, size_t size)
{
    enum pell_result res;

    PELL_TRY(pell_json_parse(&g->file, json, size));
    g->root = pell_json_root(&g->file);
    PELL_TRY(check_asset(g));
    PELL_TRY(gltf_check_required(g));
    PELL_TRY(open_arrays(g));
    PELL_TRY(gltf_animate(g));
    return gltf_read_scene(g);

fail:
    return res;
}

static void finish(struct gltf *g)
{
    for (size_t i = 0; g->buffer && i < pell_json_count(&g->buffers); i++)
        pell_free(g->ctx, g->buffer[i].owned);
    for (size_t i = 0; g->view && i < pell_json_count(&g->views); i++)
        pell_free(g->ctx, g->view[i].owned);
    pell_free(g->ctx, g->view);
    for (size_t i = 0; g->mesh && i < pell_json_count(&g->meshes); i++) {
        for (size_t k = 0; k < g->mesh[i].num_primitives; k++)
            pell_free(g->ctx, g->mesh[i].primitives[k].targets);
        pell_free(g->ctx, g->mesh[i].primitives);
    }
    for (size_t i = 0; g->skin && i < pell_json_count(&g->skins); i++)
        pell_free(g->ctx, g->skin[i].matrix);
    for (size_t i = 0; g->track && i < pell_json_count(&g->accessors); i++)
        pell_free(g->ctx, g->track[i].value);
    pell_free(g->ctx, g->skin);
    pell_free(g->ctx, g->node);
    pell_free(g->ctx, g->track);
    pell_free(g->ctx, g->pose);
    pell_free(g->ctx, g->buffer);
    pell_free(g->ctx, g->accessor);
    pell_free(g->ctx, g->mesh);
    pell_free(g->ctx, g->material);
    pell_json_finish(&g->file);
}

#define GLB_HEADER 12
#define GLB_CHUNK_HEADER 8
#define GLB_JSON 0x4e4f534au
#define GLB_BIN 0x004e4942u

/* Finds the JSON chunk and the binary chunk of a GLB. */
static enum pell_result open_glb(struct gltf *g, const uint8_t *data, size_t size, struct gltf_bytes *json)
{
    const char *path = g->import->path;
    uint64_t at = GLB_HEADER, end;

    if (size < GLB_HEADER + GLB_CHUNK_HEADER)
        return pell_error(g->ctx, PELL_ERR_FORMAT, path, NULL, "a GLB of %zu bytes is too short, allowed: 20 or more", size);
    if (pell_load_little_endian(data + 4) != 2)
        return pell_error(g->ctx, PELL_ERR_UNSUPPORTED, path, "export it again as glTF 2.0", "GLB version %" PRIu32 ", allowed: 2",
                          pell_load_little_endian(data + 4));
    end = pell_load_little_endian(data + 8);
    if (end > size || end < GLB_HEADER + GLB_CHUNK_HEADER)
        return pell_error(g->ctx, PELL_ERR_FORMAT, path, "the file may be cut off", "the GLB says it has %s, but there are %zu",
                          pell_counted((long long) end, "byte", "bytes").str, size);
    for (int chunk = 0; at < end; chunk++) {
        uint64_t length;
        uint32_t type;
        if (end - at < GLB_CHUNK_HEADER) {
            /* exporters that pad the whole file leave up to three bytes */
            if (chunk > 0 && end - at < 4)
                break;
            return pell_error(g->ctx, PELL_ERR_FORMAT, path, NULL, "chunk %d has no room for its header", chunk);
        }
        length = pell_load_little_endian(data + at);
        type = pell_load_little_endian(data + at + 4);
        at += GLB_CHUNK_HEADER;
        if (length > end - at)
            return pell_error(g->ctx, PELL_ERR_FORMAT, path,
                              end < size ? "the length in the GLB's header is less than that of the file" : NULL,
                              "chunk %d has %s, but only %s left", chunk, pell_counted((long long) length, "byte", "bytes").str,
                              pell_counted((long long) (end - at), "is", "are").str);
        if (chunk == 0) {
            if (type != GLB_JSON)
                return pell_error(g->ctx, PELL_ERR_FORMAT, path, NULL,
                                  "the first chunk has type 0x%08" PRIx32 ", allowed: 0x4e4f534a (JSON)", type);
            *json = (struct gltf_bytes) { data + at, length };
        } else if (type == GLB_BIN && !g->bin.data) {
            g->bin = (struct gltf_bytes) { data + at, length };
        }
        at += length;
    }
    return PELL_OK;
}

enum pell_result pell_import_gltf(struct pell_import *import, const uint8_t *data, size_t size)
{
    struct gltf g = { .import = import, .ctx = import->ctx, .scene = import->scene, .limits = pell_context_limits(import->ctx) };
    struct gltf_bytes json = { data, size };
    enum pell_result res;

    import->default_mm_per_unit = 1000.0;
    g.file = (struct pell_json_file) { .ctx = import->ctx, .path = import->path, .range_error = PELL_ERR_FORMAT };
    if (size >= 4 && memcmp(data, "glTF", 4) == 0)
        PELL_TRY(open_glb(&g, data, size, &json));
    PELL_TRY(read_document(&g, json.data, (size_t) json.size));

fail:
    gltf_count_warnings(&g);
    finish(&g);
    return res;
}
