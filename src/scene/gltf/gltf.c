/* SPDX-License-Identifier: MIT
 * gltf.c - reads glTF 2.0: the containers .gltf and .glb (section 4 of the specification), the version, extensions by name, and the order
 * of things. See gltf.h for the other files. */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

/* --- Messages --------------------------------------------------------------------------------------------------------------- */

static const char *const warning_names[GLTF_WARNINGS] = {
    "extensions", "features", "nodes", "primitives", "values", "materials", "textures"
};

void gltf_warn(struct gltf *g, enum gltf_warning kind, const struct pell_json *at, const char *hint, const char *fmt, ...)
{
    char what[1024];
    va_list args;

    if (g->warned[kind] < INT32_MAX)
        g->warned[kind]++;
    if (g->warned[kind] > g->limits->warnings)
        return;
    va_start(args, fmt);
    vsnprintf(what, sizeof(what), fmt, args);
    va_end(args);
    pell_json_warn(at, hint, "%s", what);
}

static void count_warnings(struct gltf *g)
{
    for (int i = 0; i < GLTF_WARNINGS; i++)
        if (g->warned[i] > g->limits->warnings)
            pell_warn(g->ctx, g->import->path, NULL, "%d more warnings about %s", g->warned[i] - g->limits->warnings, warning_names[i]);
}

bool gltf_once(struct gltf *g, enum gltf_once what)
{
    const bool first = !g->said[what];
    g->said[what] = true;
    return first;
}

const char *gltf_name(const struct pell_json *element, const char *kind, char *buffer, size_t size)
{
    const json_t *name = json_object_get(element->value, "name");

    if (json_is_string(name) && json_string_length(name) > 0)
        return pell_printable(json_string_value(name), buffer, size);
    snprintf(buffer, size, "%s %zu", kind, element->index);
    return buffer;
}

/* --- Extensions ------------------------------------------------------------------------------------------------------------- */

enum treatment {
    READ,        /* wholly */
    READ_DRAFT,  /* read, mentioned once as experimental */
    LEFT_OUT,    /* changes the look only: one warning, also where it is required */
    REFUSED,     /* refused where required; else a warning where something uses it */
};

/* The only list of extensions. Bits of gltf.extensions_said count its rows. */
static const struct {
    const char *name;
    enum treatment treatment;
    const char *what, *hint; /* `what` ends a sentence that begins with the name */
} known[] = {
    { "KHR_lights_punctual", READ, NULL, NULL },
    { "KHR_materials_diffuse_transmission", READ, NULL, NULL },
    { "KHR_materials_emissive_strength", READ, NULL, NULL },
    { "KHR_materials_ior", READ, NULL, NULL },
    { "KHR_materials_specular", READ, NULL, NULL },
    { "KHR_materials_volume", READ, NULL, NULL },
    { "KHR_materials_transmission", READ, NULL, NULL }, /* each material that uses it is warned of */
    { "KHR_mesh_quantization", READ, NULL, NULL },
    { "KHR_node_visibility", READ, NULL, NULL },
    { "KHR_texture_transform", READ, NULL, NULL },
    { "KHR_xmp_json_ld", READ, NULL, NULL }, /* facts about the file */
    { "EXT_mesh_gpu_instancing", READ, NULL, NULL },
    { "KHR_materials_volume_scatter", READ_DRAFT, "is a draft: its meaning may change (experimental)", NULL },
    { "KHR_materials_scatter", READ_DRAFT, "is a draft: its meaning may change (experimental)", NULL },
    { "KHR_materials_unlit", LEFT_OUT, "is not drawn: the material is lit", NULL },
    { "KHR_materials_clearcoat", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_sheen", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_iridescence", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_anisotropy", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_dispersion", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_variants", LEFT_OUT, "is not read: the default variant is drawn", NULL },
    { "KHR_materials_pbrSpecularGlossiness", REFUSED, "is not read", "convert it: gltf-transform metalrough in.glb out.glb" },
    { "KHR_texture_basisu", REFUSED, "is not read", "convert the KTX2 textures to PNG" },
    { "EXT_texture_webp", REFUSED, "is not read", "convert the WebP textures to PNG" },
    { "EXT_texture_avif", REFUSED, "is not read", "convert the AVIF textures to PNG" },
    { "MSFT_texture_dds", REFUSED, "is not read", "convert the DDS textures to PNG" },
    { "KHR_draco_mesh_compression", REFUSED, "is not read", "decode it first: gltf-transform copy in.glb out.glb" },
    { "EXT_meshopt_compression", REFUSED, "is not read yet", "decode it first: gltf-transform copy in.glb out.glb" },
    { "KHR_meshopt_compression", REFUSED, "is not read yet", "decode it first: gltf-transform copy in.glb out.glb" },
    { "KHR_animation_pointer", REFUSED, "is not read yet", NULL },
};

static int find_known(const char *name)
{
    for (size_t i = 0; i < PELL_COUNT(known); i++)
        if (strcmp(known[i].name, name) == 0)
            return (int) i;
    return -1;
}

void gltf_mention(struct gltf *g, const struct pell_json *at, const char *extension)
{
    const int row = find_known(extension);

    if (row < 0 || !known[row].what || (g->extensions_said >> row & 1))
        return;
    g->extensions_said |= (uint64_t) 1 << row;
    gltf_warn(g, GLTF_WARN_EXTENSION, at, known[row].hint, "%s %s%s", known[row].name, known[row].what,
              known[row].treatment == REFUSED ? ": the copy without it is used" : "");
}

enum pell_result gltf_extension(const struct pell_json *object, const char *name, struct pell_json *extensions, struct pell_json *out)
{
    enum pell_result res = pell_json_object(object, "extensions", extensions);
    if (res == PELL_OK)
        res = pell_json_object(extensions, name, out);
    return res;
}

static enum pell_result check_required(struct gltf *g)
{
    const size_t most = (size_t) g->limits->items;
    struct pell_json required, used;
    enum pell_result res;

    PELL_TRY(pell_json_array(&g->root, "extensionsRequired", 0, most, &required));
    for (size_t i = 0; i < pell_json_count(&required); i++) {
        const struct pell_json at = pell_json_at(&required, i);
        const char *name;
        char shown[96];
        int row;
        PELL_TRY(pell_json_to_string(&at, &name));
        row = find_known(name);
        if (row < 0)
            return pell_json_error(&at, PELL_ERR_UNSUPPORTED, NULL, "the file requires the extension %s, which is unknown",
                                   pell_printable(name, shown, sizeof(shown)));
        if (known[row].treatment == REFUSED)
            return pell_json_error(&at, PELL_ERR_UNSUPPORTED, known[row].hint, "the file requires %s, which %s", name, known[row].what);
        if (known[row].treatment == LEFT_OUT)
            gltf_mention(g, &at, name);
    }
    PELL_TRY(pell_json_array(&g->root, "extensionsUsed", 0, most, &used));
    for (size_t i = 0; i < pell_json_count(&used); i++) {
        const struct pell_json at = pell_json_at(&used, i);
        const char *name;
        char shown[96];
        int row;
        PELL_TRY(pell_json_to_string(&at, &name));
        row = find_known(name);
        if (row >= 0 && known[row].treatment == LEFT_OUT)
            gltf_mention(g, &at, name);
        if (row < 0)
            gltf_warn(g, GLTF_WARN_EXTENSION, &at, NULL, "the extension %s is unknown and left out",
                      pell_printable(name, shown, sizeof(shown)));
    }
    return PELL_OK;

fail:
    return res;
}

/* --- The document ----------------------------------------------------------------------------------------------------------- */

enum pell_result gltf_index(const struct pell_json *parent, const char *key, const struct pell_json *array, int64_t *index)
{
    const struct pell_json at = pell_json_get(parent, key);
    const int64_t count = (int64_t) pell_json_count(array);
    int64_t i;
    enum pell_result res;

    if (!at.value)
        return PELL_OK;
    if ((res = pell_json_to_int(&at, INT64_MIN, INT64_MAX, &i)) != PELL_OK)
        return res;
    if (count == 0)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "is %" PRId64 ", but the file has no %s", i, array->key);
    if (i < 0 || i >= count)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "is %" PRId64 ", allowed: [0, %" PRId64 "], as there are %" PRId64 " %s", i,
                               count - 1, count, array->key);
    *index = i;
    return PELL_OK;
}

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
        { "buffers", &g->buffers, items },     { "bufferViews", &g->views, items },   { "accessors", &g->accessors, items },
        { "images", &g->images, items },       { "samplers", &g->samplers, items },   { "textures", &g->textures, items },
        { "materials", &g->materials, items }, { "meshes", &g->meshes, items },       { "nodes", &g->nodes, (size_t) g->limits->nodes },
        { "scenes", &g->scenes, items },       { "cameras", &g->cameras, items },     { "skins", &g->skins, items },
        { "animations", &g->animations, items },
    };
    enum pell_result res;

    for (size_t i = 0; i < PELL_COUNT(arrays); i++)
        PELL_TRY(pell_json_array(&g->root, arrays[i].key, 0, arrays[i].max, arrays[i].out));
    PELL_TRY(gltf_extension(&g->root, "KHR_lights_punctual", &g->extensions, &g->lights_extension));
    PELL_TRY(pell_json_array(&g->lights_extension, "lights", 0, items, &g->lights));

    g->buffer = pell_calloc(g->ctx, pell_json_count(&g->buffers), sizeof(*g->buffer));
    g->accessor = pell_calloc(g->ctx, pell_json_count(&g->accessors), sizeof(*g->accessor));
    g->mesh = pell_calloc(g->ctx, pell_json_count(&g->meshes), sizeof(*g->mesh));
    g->node = pell_calloc(g->ctx, pell_json_count(&g->nodes), sizeof(*g->node));
    g->skin = pell_calloc(g->ctx, pell_json_count(&g->skins), sizeof(*g->skin));
    g->material = pell_alloc_array(g->ctx, pell_json_count(&g->materials), sizeof(*g->material));
    if (!g->buffer || !g->accessor || !g->mesh || !g->node || !g->skin || !g->material)
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
    PELL_TRY(check_required(g));
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

/* --- Containers ------------------------------------------------------------------------------------------------------------- */

#define GLB_HEADER 12
#define GLB_CHUNK_HEADER 8
#define GLB_JSON 0x4e4f534au
#define GLB_BIN 0x004e4942u

static uint32_t little_endian(const uint8_t *p)
{
    return p[0] | (uint32_t) p[1] << 8 | (uint32_t) p[2] << 16 | (uint32_t) p[3] << 24;
}

/* Finds the JSON chunk and the binary chunk of a GLB. */
static enum pell_result open_glb(struct gltf *g, const uint8_t *data, size_t size, struct gltf_bytes *json)
{
    const char *path = g->import->path;
    uint64_t at = GLB_HEADER, end;

    if (size < GLB_HEADER + GLB_CHUNK_HEADER)
        return pell_error(g->ctx, PELL_ERR_FORMAT, path, NULL, "a GLB of %zu bytes is too short, allowed: 20 or more", size);
    if (little_endian(data + 4) != 2)
        return pell_error(g->ctx, PELL_ERR_UNSUPPORTED, path, "export it again as glTF 2.0", "GLB version %" PRIu32 ", allowed: 2",
                          little_endian(data + 4));
    end = little_endian(data + 8);
    if (end > size || end < GLB_HEADER + GLB_CHUNK_HEADER)
        return pell_error(g->ctx, PELL_ERR_FORMAT, path, "the file may be cut off",
                          "the GLB says it has %" PRIu64 " bytes, but there are %zu", end, size);
    for (int chunk = 0; at < end; chunk++) {
        uint64_t length;
        uint32_t type;
        if (end - at < GLB_CHUNK_HEADER) {
            /* exporters that pad the whole file leave up to three bytes */
            if (chunk > 0 && end - at < 4)
                break;
            return pell_error(g->ctx, PELL_ERR_FORMAT, path, NULL, "chunk %d has no room for its header", chunk);
        }
        length = little_endian(data + at);
        type = little_endian(data + at + 4);
        at += GLB_CHUNK_HEADER;
        if (length > end - at)
            return pell_error(g->ctx, PELL_ERR_FORMAT, path, NULL, "chunk %d has %" PRIu64 " bytes, but only %" PRIu64 " are left", chunk,
                              length, end - at);
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
    g.file = (struct pell_json_file) { .ctx = import->ctx, .path = import->path, .range = PELL_ERR_FORMAT };
    if (size >= 4 && memcmp(data, "glTF", 4) == 0)
        PELL_TRY(open_glb(&g, data, size, &json));
    PELL_TRY(read_document(&g, json.data, (size_t) json.size));

fail:
    count_warnings(&g);
    finish(&g);
    return res;
}
