/* SPDX-License-Identifier: MIT
 * texture.c - textures, samplers and images of glTF 2.0 (sections 3.8 and 5.18 to 5.31 of the specification), KHR_texture_transform.
 *
 * An image that can't be loaded is a warning that names it; a file that violates glTF's structure is refused. */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <string.h>

static enum pell_result read_wrap(const struct pell_json *sampler, const char *key, enum pell_wrap *out)
{
    const struct pell_json at = pell_json_get(sampler, key);
    int64_t wrap = 10497;
    const enum pell_result res = pell_json_int(sampler, key, 0, INT32_MAX, &wrap);

    if (res != PELL_OK)
        return res;
    switch (wrap) {
    case 10497: *out = PELL_WRAP_REPEAT; return PELL_OK;
    case 33071: *out = PELL_WRAP_CLAMP; return PELL_OK;
    case 33648: *out = PELL_WRAP_MIRROR; return PELL_OK;
    default: break;
    }
    return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "is %" PRId64 ", allowed: 10497 (repeat), 33071 (clamp), 33648 (mirror)", wrap);
}

static enum pell_result read_sampler(struct gltf *g, const struct pell_json *texture, enum pell_wrap wrap[2], bool *nearest)
{
    int64_t index = -1, filter = 9729;
    struct pell_json sampler;
    enum pell_result res;

    wrap[0] = wrap[1] = PELL_WRAP_REPEAT;
    *nearest = false;
    PELL_TRY(gltf_index(texture, "sampler", &g->samplers, &index));
    if (index < 0)
        return PELL_OK;
    sampler = pell_json_at(&g->samplers, (size_t) index);
    PELL_TRY(pell_json_is_object(&sampler));
    PELL_TRY(read_wrap(&sampler, "wrapS", &wrap[0]));
    PELL_TRY(read_wrap(&sampler, "wrapT", &wrap[1]));
    PELL_TRY(pell_json_int(&sampler, "magFilter", 0, INT32_MAX, &filter));
    *nearest = filter == 9728;
    return PELL_OK;

fail:
    return res;
}

/* The image of a texture, or -1: its own, else one from an extension that this build may not be able to read. */
static enum pell_result find_image(struct gltf *g, const struct pell_json *texture, int64_t *image)
{
    static const char *const formats[] = { "KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds" };
    enum pell_result res;

    *image = -1;
    PELL_TRY(gltf_index(texture, "source", &g->images, image));
    for (size_t i = 0; i < PELL_COUNT(formats); i++) {
        struct pell_json extensions, format;
        PELL_TRY(gltf_extension(texture, formats[i], &extensions, &format));
        if (!format.value)
            continue;
        if (*image >= 0)
            gltf_mention(g, &format, formats[i]);
        else
            gltf_warn(g, GLTF_WARN_TEXTURE, &format, gltf_fix(formats[i]),
                      "the image is %s only, which is not read: the texture is left out", formats[i]);
        return PELL_OK;
    }
    if (*image < 0)
        gltf_warn(g, GLTF_WARN_TEXTURE, texture, NULL, "the texture names no image and is left out");
    return PELL_OK;

fail:
    return res;
}

static enum pell_result load_uri_image(struct gltf *g, const struct pell_json *at, const char *uri, enum pell_image_role role,
                                       struct pell_texture **out)
{
    const struct pell_json uri_at = pell_json_get(at, "uri");
    const char *problem;
    uint8_t *bytes = NULL;
    char *reference = NULL;
    struct pell_text where;
    enum pell_result res;
    size_t size;

    pell_json_where(at, &where);
    if (gltf_is_data_uri(uri)) {
        PELL_TRY(gltf_data_uri(g->ctx, uri, &bytes, &size, &problem));
        if (!problem)
            PELL_TRY(pell_import_texture_bytes(g->import, where.str, where.str, bytes, size, role, out));
    } else {
        PELL_TRY(gltf_file_uri(g->ctx, uri, &reference, &problem));
        if (!problem)
            PELL_TRY(pell_import_texture(g->import, where.str, reference, role, out));
    }
    if (problem)
        gltf_warn(g, GLTF_WARN_TEXTURE, &uri_at, NULL, "%s: the texture is left out", problem);

fail:
    pell_free(g->ctx, bytes);
    pell_free(g->ctx, reference);
    return res;
}

static enum pell_result load_image(struct gltf *g, int64_t image, enum pell_image_role role, struct pell_texture **out)
{
    const struct pell_json at = pell_json_at(&g->images, (size_t) image);
    const char *uri = NULL;
    enum pell_result res;

    *out = NULL;
    PELL_TRY(pell_json_is_object(&at));
    PELL_TRY(pell_json_string(&at, "uri", &uri));
    if (uri)
        return load_uri_image(g, &at, uri, role, out);
    if (pell_json_get(&at, "bufferView").value) {
        struct pell_text where;
        struct gltf_bytes bytes;
        PELL_TRY(gltf_view(g, &at, "bufferView", &bytes, NULL));
        pell_json_where(&at, &where);
        return pell_import_texture_bytes(g->import, where.str, where.str, bytes.data, (size_t) bytes.size, role, out);
    }
    gltf_warn(g, GLTF_WARN_TEXTURE, &at, NULL, "the image has neither uri nor bufferView and is left out");
    return PELL_OK;

fail:
    return res;
}

/* uv' = T R S uv; a positive rotation is counter-clockwise as seen in an image whose v points down. */
static enum pell_result read_transform(const struct pell_json *info, struct pell_texture_map *map, int64_t *uv)
{
    double offset[2] = { 0, 0 }, scale[2] = { 1, 1 }, rotation = 0, c, s;
    struct pell_json extensions, transform;
    enum pell_result res;

    PELL_TRY(gltf_extension(info, "KHR_texture_transform", &extensions, &transform));
    if (!transform.value)
        return PELL_OK;
    PELL_TRY(pell_json_numbers(&transform, "offset", 2, -1e6, 1e6, offset));
    PELL_TRY(pell_json_numbers(&transform, "scale", 2, -1e6, 1e6, scale));
    PELL_TRY(pell_json_number(&transform, "rotation", -1e6, 1e6, &rotation));
    PELL_TRY(pell_json_int(&transform, "texCoord", 0, INT32_MAX, uv));
    c = cos(rotation);
    s = sin(rotation);
    map->matrix[0] = (float) (c * scale[0]);
    map->matrix[1] = (float) (s * scale[1]);
    map->matrix[2] = (float) offset[0];
    map->matrix[3] = (float) (-s * scale[0]);
    map->matrix[4] = (float) (c * scale[1]);
    map->matrix[5] = (float) offset[1];
    return PELL_OK;

fail:
    return res;
}

enum pell_result gltf_texture_map(struct gltf *g, const struct pell_json *parent, const char *key, enum pell_image_role role, int channel,
                                  struct pell_texture_map *map)
{
    struct pell_texture_map found = pell_texture_map_none();
    struct pell_texture *texture = NULL;
    struct pell_json info, texture_at;
    int64_t index = -1, image, uv = 0;
    enum pell_wrap wrap[2];
    bool nearest;
    enum pell_result res;

    PELL_TRY(pell_json_object(parent, key, &info));
    if (!info.value)
        return PELL_OK;
    PELL_TRY(pell_json_require(&info, "index"));
    PELL_TRY(gltf_index(&info, "index", &g->textures, &index));
    PELL_TRY(pell_json_int(&info, "texCoord", 0, INT32_MAX, &uv));
    PELL_TRY(read_transform(&info, &found, &uv));
    if (uv >= PELL_UV_SETS) {
        gltf_warn(g, GLTF_WARN_TEXTURE, &info, NULL, "the texture uses TEXCOORD_%" PRId64 ", allowed: 0 to %d; it is left out", uv,
                  PELL_UV_SETS - 1);
        return PELL_OK;
    }
    texture_at = pell_json_at(&g->textures, (size_t) index);
    PELL_TRY(pell_json_is_object(&texture_at));
    PELL_TRY(read_sampler(g, &texture_at, wrap, &nearest));
    PELL_TRY(find_image(g, &texture_at, &image));
    if (image < 0)
        return PELL_OK;
    PELL_TRY(load_image(g, image, role, &texture));
    if (!texture)
        return PELL_OK;
    PELL_TRY(pell_texture_sampler(g->scene, texture, wrap[0], wrap[1], nearest, &texture));
    found.texture = texture;
    found.uv = (int) uv;
    found.channel = channel;
    *map = found;
    return PELL_OK;

fail:
    return res;
}
