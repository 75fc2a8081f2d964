/* SPDX-License-Identifier: MIT
 * gltf.c - what all parts of the reader call: warnings, extensions by name, indices. See gltf.h for the other files. */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

/* --- Messages --------------------------------------------------------------------------------------------------------------- */

static const char *const warning_names[GLTF_WARNINGS] = { "extensions", "features",  "nodes",     "primitives",
                                                          "values",     "materials", "interiors", "textures" };

void gltf_warn(struct gltf *g, enum gltf_warning kind, const struct pell_json *at, const char *hint, const char *fmt, ...)
{
    char what[1024];
    va_list args;

    if (kind == GLTF_WARN_INTERIOR && g->import->replaces_materials)
        return;
    if (g->warned[kind] < INT32_MAX)
        g->warned[kind]++;
    if (g->warned[kind] > g->limits->warnings)
        return;
    va_start(args, fmt);
    vsnprintf(what, sizeof(what), fmt, args);
    va_end(args);
    pell_json_warn(at, hint, "%s", what);
}

void gltf_count_warnings(struct gltf *g)
{
    for (int i = 0; i < GLTF_WARNINGS; i++)
        if (g->warned[i] > g->limits->warnings)
            pell_warn(g->ctx, g->import->path, NULL, "%s about %s",
                      pell_counted(g->warned[i] - g->limits->warnings, "more warning", "more warnings").str, warning_names[i]);
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
    READ,       /* fully read */
    READ_DRAFT, /* read, mentioned once as experimental */
    LEFT_OUT,   /* affects the look only: one warning, also if required */
    REFUSED,    /* refused if required; else a warning if used */
};

/* The only list of extensions. Bits of gltf.extensions_said count its rows. */
static const struct {
    const char *name;
    enum treatment treatment;
    const char *what, *hint; /* `what` completes a sentence that begins with the name */
} known[] = {
    { "KHR_lights_punctual", READ, NULL, NULL },
    { "KHR_materials_diffuse_transmission", READ, NULL, NULL },
    { "KHR_materials_emissive_strength", READ, NULL, NULL },
    { "KHR_materials_ior", READ, NULL, NULL },
    { "KHR_materials_pbrSpecularGlossiness", READ, NULL, NULL },
    { "KHR_materials_specular", READ, NULL, NULL },
    { "KHR_materials_volume", READ, NULL, NULL },
    { "KHR_materials_transmission", READ, NULL, NULL }, /* each material that uses it gets a warning */
    { "KHR_mesh_quantization", READ, NULL, NULL },
    { "KHR_node_visibility", READ, NULL, NULL },
    { "KHR_texture_transform", READ, NULL, NULL },
    { "KHR_xmp_json_ld", READ, NULL, NULL }, /* metadata of the file */
    { "EXT_mesh_gpu_instancing", READ, NULL, NULL },
    { "EXT_meshopt_compression", READ, NULL, NULL },
    { "KHR_materials_volume_scatter", READ_DRAFT, "is a draft: its meaning may change (experimental)", NULL },
    { "KHR_materials_scatter", READ_DRAFT, "is a draft: its meaning may change (experimental)", NULL },
    { "KHR_materials_unlit", LEFT_OUT, "is not drawn: the material is lit", NULL },
    { "KHR_materials_clearcoat", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_sheen", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_iridescence", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_anisotropy", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_dispersion", LEFT_OUT, "is not drawn", NULL },
    { "KHR_materials_variants", LEFT_OUT, "is not read: the default variant is drawn", NULL },
    { "KHR_texture_basisu", REFUSED, "is not read", "decode them first: gltf-transform ktxdecompress in.glb out.glb" },
    { "EXT_texture_webp", REFUSED, "is not read", "convert them first: gltf-transform png in.glb out.glb --formats webp" },
    { "EXT_texture_avif", REFUSED, "is not read", "convert them first: gltf-transform png in.glb out.glb --formats avif" },
    { "MSFT_texture_dds", REFUSED, "is not read", "convert each with oiiotool in.dds -o out.png, and name that in the file" },
    { "KHR_draco_mesh_compression", REFUSED, "is not read", "decode it first: gltf-transform copy in.glb out.glb" },
    { "KHR_meshopt_compression", REFUSED, "is not read", "decode it first: gltf-transform copy in.glb out.glb" },
    { "KHR_animation_pointer", REFUSED, "is not read yet", NULL },
};

static int find_known(const char *name)
{
    for (size_t i = 0; i < PELL_COUNT(known); i++)
        if (strcmp(known[i].name, name) == 0)
            return (int) i;
    return -1;
}

const char *gltf_fix(const char *extension)
{
    const int row = find_known(extension);
    return row < 0 ? NULL : known[row].hint;
}

void gltf_mention(struct gltf *g, const struct pell_json *at, const char *extension)
{
    const int row = find_known(extension);

    if (row < 0 || !known[row].what || (g->extensions_said >> row & 1))
        return;
    if (known[row].treatment == READ_DRAFT && g->import->replaces_materials) /* drafts concern the replaced material */
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

enum pell_result gltf_check_required(struct gltf *g)
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

/* --- Indices ---------------------------------------------------------------------------------------------------------------- */

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
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "is %" PRId64 ", allowed: [0, %" PRId64 "], by the number of %s", i, count - 1,
                               array->key);
    *index = i;
    return PELL_OK;
}
