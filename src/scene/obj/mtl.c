/* SPDX-License-Identifier: MIT
 * mtl.c - material libraries (Wavefront MTL, with the Pr, Pm and norm that many programs write). Colours are linear; Kd is Lambert's
 * reflectance, Ks scales the specular lobe so that 0.5 is an ordinary dielectric, Ns becomes a GGX roughness of equal width
 * (alpha^2 = 2/(Ns + 2), Walter et al. 2007). */
#include "scene/obj/mtl.h"

#include "base/file.h"
#include "scene/obj/lex.h"

enum pell_result pell_mtl_material(struct pell_mtl *mtl, const char *name, size_t length, uint32_t *index)
{
    void *defined = mtl->defined;
    struct pell_material *m;
    size_t made;
    bool fresh;
    enum pell_result res;

    PELL_TRY(pell_names_enter(&mtl->names, name, length, index, &fresh));
    if (!fresh)
        return PELL_OK;
    res = pell_grow(mtl->import->ctx, &defined, *index, &mtl->capacity, sizeof(*mtl->defined));
    mtl->defined = defined;
    if (res != PELL_OK)
        goto fail;
    mtl->defined[*index] = false;
    PELL_TRY(pell_scene_add_material(mtl->import->scene, mtl->names.names[*index].text, &made));
    m = &mtl->import->scene->materials[made];
    m->metallic = 0.0f;
    m->roughness = 0.5f;
    return PELL_OK;

fail:
    return res;
}

void pell_mtl_finish(struct pell_mtl *mtl)
{
    pell_free(mtl->import->ctx, mtl->defined);
    pell_names_finish(&mtl->names);
    pell_names_finish(&mtl->libraries);
}

/* --- Lines -------------------------------------------------------------------------------------------------------------------- */

struct reader {
    struct pell_mtl *mtl;
    struct pell_lex lex;
    const char *path;   /* for messages */
    const char *folder; /* of the library below the OBJ file's, ends in '/' or is empty */
    struct pell_material *m;
    char *alpha_map; /* map_d of the current material, owned */
    char *color_map; /* map_Kd of the current material, owned */
    bool height_warned, alpha_warned;
};

/* Reads up to three numbers in [min, max]; a single one is used for all. Invalid ones cause a warning, and the values stay. */
static void read_numbers(struct reader *r, const char *key, int count, float min, float max, float *out)
{
    struct pell_text text;
    float v[3];
    int n = 0;

    while (n < count && pell_lex_float(&r->lex, &v[n]))
        n++;
    if (n == 0) {
        pell_warn(r->mtl->import->ctx, pell_lex_where(&r->lex, r->path, &text), NULL, "%s needs %s", key,
                  count == 1 ? "a number" : "one or three numbers");
        return;
    }
    for (int i = 0; i < count; i++) {
        const float x = v[i < n ? i : n - 1];
        if (x < min || x > max)
            pell_warn(r->mtl->import->ctx, pell_lex_where(&r->lex, r->path, &text), NULL, "%s is %g and counts as %g; allowed: [%g, %g]",
                      key, (double) x, (double) (x < min ? min : max), (double) min, (double) max);
        out[i] = x < min ? min : x > max ? max : x;
    }
}

struct map_options {
    float scale[3], offset[3];
    bool clamp;
};

static bool next_is_number(struct reader *r, float *value)
{
    const struct pell_lex start = r->lex;

    if (pell_lex_float(&r->lex, value))
        return true;
    r->lex = start;
    return false;
}

/* "-s 2 2 1 -clamp on" in front of a file name. */
static void read_options(struct reader *r, struct map_options *o)
{
    static const struct {
        const char *name;
        int numbers, words; /* takes at most that many numbers, then exactly so many words */
    } options[] = { { "-s", 3, 0 },     { "-o", 3, 0 },       { "-t", 3, 0 },      { "-mm", 2, 0 },        { "-bm", 1, 0 },
                    { "-boost", 1, 0 }, { "-texres", 1, 0 },  { "-blendu", 0, 1 }, { "-blendv", 0, 1 },    { "-cc", 0, 1 },
                    { "-clamp", 0, 1 }, { "-imfchan", 0, 1 }, { "-type", 0, 1 },   { "-colorspace", 0, 1 } };

    *o = (struct map_options) { { 1, 1, 1 }, { 0, 0, 0 }, false };
    for (;;) {
        const struct pell_lex start = r->lex;
        const char *word, *value;
        const size_t length = pell_lex_word(&r->lex, &word);
        size_t k = 0;
        float ignored[3], *into;

        while (k < PELL_COUNT(options) && !pell_word_is(word, length, options[k].name))
            k++;
        if (k == PELL_COUNT(options)) {
            r->lex = start;
            return;
        }
        into = k == 0 ? o->scale : k == 1 ? o->offset : ignored;
        for (int i = 0; i < options[k].numbers && next_is_number(r, &into[i]); i++)
            ;
        for (int i = 0; i < options[k].words; i++) {
            const size_t n = pell_lex_word(&r->lex, &value);
            if (pell_word_is(word, length, "-clamp"))
                o->clamp = pell_word_is(value, n, "on");
        }
    }
}

/* The file name at the rest of the line, below the OBJ file's folder; owned by the caller. */
static char *read_name(struct reader *r)
{
    const char *rest;
    const size_t length = pell_lex_rest(&r->lex, &rest), folder = strlen(r->folder);
    char *name = pell_alloc(r->mtl->import->ctx, folder + length + 1);

    if (!name)
        return NULL;
    memcpy(name, r->folder, folder);
    memcpy(name + folder, rest, length);
    name[folder + length] = '\0';
    for (char *c = name; *c; c++)
        if (*c == '\\')
            *c = '/';
    return name;
}

static enum pell_result read_map(struct reader *r, enum pell_image_role role, struct pell_texture_map *map, char **keep)
{
    struct pell_import *import = r->mtl->import;
    struct map_options o;
    struct pell_texture *texture;
    struct pell_text text;
    char *name;
    enum pell_result res;

    read_options(r, &o);
    name = read_name(r);
    if (!name)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_import_texture(import, pell_lex_where(&r->lex, r->path, &text), name, role, &texture));
    if (texture) {
        const enum pell_wrap wrap = o.clamp ? PELL_WRAP_CLAMP : PELL_WRAP_REPEAT;
        PELL_TRY(pell_texture_sampler(import->scene, texture, wrap, wrap, false, &texture));
        *map = pell_texture_map_none();
        map->texture = texture;
        /* v points up in the library, down here. */
        map->matrix[0] = o.scale[0];
        map->matrix[2] = o.offset[0];
        map->matrix[4] = o.scale[1];
        map->matrix[5] = 1.0f - o.scale[1] - o.offset[1];
    }
    if (keep) {
        pell_free(import->ctx, *keep);
        *keep = name;
        name = NULL;
    }

fail:
    pell_free(import->ctx, name);
    return res;
}

/* Ends a material: its opacity map can be used only if it is the alpha of its colour map. */
static void end_material(struct reader *r)
{
    struct pell_context *ctx = r->mtl->import->ctx;
    struct pell_text text;

    if (r->m && r->alpha_map) {
        const struct pell_texture *t = r->m->base_color_map.texture;
        if (t && r->color_map && strcmp(r->alpha_map, r->color_map) == 0 && t->image.channels % 2 == 0)
            r->m->alpha_mask = true;
        else
            pell_warn(ctx, pell_lex_where(&r->lex, r->path, &text),
                      "put opacity into the alpha channel of map_Kd and name that file in map_d, too",
                      "map_d of material \"%s\" is not the alpha channel of its map_Kd and is ignored", r->m->name);
    }
    pell_free(ctx, r->alpha_map);
    pell_free(ctx, r->color_map);
    r->alpha_map = r->color_map = NULL;
}

static enum pell_result begin_material(struct reader *r)
{
    const char *name;
    const size_t length = pell_lex_rest(&r->lex, &name);
    uint32_t index;
    enum pell_result res;

    end_material(r);
    PELL_TRY(pell_mtl_material(r->mtl, name, length, &index));
    r->mtl->defined[index] = true;
    r->m = &r->mtl->import->scene->materials[index];
    return PELL_OK;

fail:
    return res;
}

static void read_opacity(struct reader *r, bool inverse)
{
    struct pell_text text;
    const char *word;
    float d = inverse ? 0.0f : 1.0f;

    pell_lex_blank(&r->lex);
    if (*r->lex.at == '-')
        pell_lex_word(&r->lex, &word); /* -halo */
    read_numbers(r, inverse ? "Tr" : "d", 1, 0.0f, 1.0f, &d);
    if ((inverse ? 1.0f - d : d) < 1.0f && !r->alpha_warned) {
        r->alpha_warned = true;
        pell_warn(r->mtl->import->ctx, pell_lex_where(&r->lex, r->path, &text), NULL, "transparent material \"%s\" is rendered as opaque",
                  r->m->name);
    }
}

static enum pell_result ignore_height(struct reader *r)
{
    struct pell_text text;

    if (!r->height_warned)
        pell_warn(r->mtl->import->ctx, pell_lex_where(&r->lex, r->path, &text), "make a normal map and name it with \"norm\"",
                  "height maps are not read");
    r->height_warned = true;
    return PELL_OK;
}

static enum pell_result read_line(struct reader *r, const char *key, size_t length)
{
    struct pell_material *m = r->m;
    float v[3];

#define IS(text) pell_word_is(key, length, text)
    if (IS("newmtl"))
        return begin_material(r);
    if (!m || length == 0)
        return PELL_OK;
    if (IS("Kd")) {
        read_numbers(r, "Kd", 3, 0.0f, 1.0f, m->base_color);
    } else if (IS("Ks")) {
        v[0] = v[1] = v[2] = 0.5f;
        read_numbers(r, "Ks", 3, 0.0f, 1.0f, v);
        const float largest = fmaxf(v[0], fmaxf(v[1], v[2]));
        m->rho_s = fminf(1.0f, 2.0f * largest);
        for (int c = 0; c < 3; c++)
            m->specular_color[c] = largest > 0.0f ? v[c] / largest : 1.0f;
    } else if (IS("Ke")) {
        read_numbers(r, "Ke", 3, 0.0f, 1e6f, m->emissive);
    } else if (IS("Ns")) {
        v[0] = 0.0f;
        read_numbers(r, "Ns", 1, 0.0f, 1e6f, v);
        m->roughness = powf(2.0f / (v[0] + 2.0f), 0.25f);
    } else if (IS("Pr")) {
        read_numbers(r, "Pr", 1, 0.0f, 1.0f, &m->roughness);
    } else if (IS("Pm")) {
        read_numbers(r, "Pm", 1, 0.0f, 1.0f, &m->metallic);
    } else if (IS("d") || IS("Tr")) {
        read_opacity(r, IS("Tr"));
    } else if (IS("map_Kd")) {
        return read_map(r, PELL_ROLE_COLOR, &m->base_color_map, &r->color_map);
    } else if (IS("map_Ks")) {
        return read_map(r, PELL_ROLE_COLOR, &m->specular_color_map, NULL);
    } else if (IS("map_Ke")) {
        return read_map(r, PELL_ROLE_COLOR, &m->emissive_map, NULL);
    } else if (IS("map_Pr")) {
        return read_map(r, PELL_ROLE_DATA, &m->roughness_map, NULL);
    } else if (IS("map_Pm")) {
        return read_map(r, PELL_ROLE_DATA, &m->metallic_map, NULL);
    } else if (IS("norm") || IS("map_Kn")) {
        return read_map(r, PELL_ROLE_DATA, &m->normal_map, NULL);
    } else if (IS("bump") || IS("map_bump") || IS("map_Bump") || IS("disp")) {
        return ignore_height(r);
    } else if (IS("map_d")) {
        struct map_options o;
        read_options(r, &o);
        pell_free(r->mtl->import->ctx, r->alpha_map);
        r->alpha_map = read_name(r);
        return r->alpha_map ? PELL_OK : PELL_ERR_NOMEM;
    }
#undef IS
    return PELL_OK;
}

enum pell_result pell_mtl_read(struct pell_mtl *mtl, const char *path, const char *folder, const uint8_t *data, size_t size)
{
    struct reader r = { .mtl = mtl, .lex = { (const char *) data, (const char *) data + size, 1 }, .path = path, .folder = folder };
    enum pell_result res = PELL_OK;

    while (r.lex.at < r.lex.end) {
        const char *key;
        const size_t length = pell_lex_word(&r.lex, &key);
        if (length && *key == '#')
            while (!pell_lex_eol(&r.lex))
                r.lex.at++; /* a backslash at the end of a comment is a part of it */
        else
            PELL_TRY(read_line(&r, key, length));
        pell_lex_next_line(&r.lex);
    }

fail:
    end_material(&r);
    return res;
}

enum pell_result pell_mtl_library(struct pell_mtl *mtl, const char *where, const char *reference)
{
    struct pell_import *import = mtl->import;
    struct pell_context *ctx = import->ctx;
    const size_t folder = (size_t) (pell_path_name(reference) - reference);
    char *path = NULL, *prefix = NULL, shown[160];
    uint8_t *data = NULL;
    size_t size;
    uint32_t number;
    bool fresh;
    enum pell_result res;

    PELL_TRY(pell_names_enter(&mtl->libraries, reference, strlen(reference), &number, &fresh));
    if (!fresh)
        return PELL_OK;
    pell_log_downgrade(ctx, 1);
    res = pell_path_resolve(ctx, where, import->root, reference, import->allow_outside, &path);
    if (res == PELL_OK)
        res = pell_file_read(ctx, path, &data, &size);
    pell_log_downgrade(ctx, -1);
    if (res == PELL_ERR_NOMEM || res == PELL_ERR_CANCELLED)
        goto fail;
    if (res != PELL_OK) {
        pell_warn(ctx, where, NULL, "the material library \"%s\" can't be read; its materials are missing",
                  pell_printable(reference, shown, sizeof(shown)));
        res = PELL_OK;
        goto fail;
    }
    prefix = pell_strndup(ctx, reference, folder);
    if (!prefix) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    PELL_TRY(pell_mtl_read(mtl, path, prefix, data, size));

fail:
    pell_free(ctx, path);
    pell_free(ctx, prefix);
    pell_free(ctx, data);
    return res;
}
