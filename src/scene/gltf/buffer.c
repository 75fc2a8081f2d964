/* SPDX-License-Identifier: MIT
 * buffer.c - data URIs, buffers, buffer views and accessors of glTF 2.0 (sections 3.6, 5.1 to 5.5, 5.11 of the specification).
 *
 * An accessor is checked against the bytes behind it once; readers may then trust it. Alignment is not assumed. The file's min and
 * max are not used. */
#include "base/file.h"
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <string.h>

/* --- URIs ------------------------------------------------------------------------------------------------------------------- */

static int hex(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* "%20" -> ' '; a '%' that is not followed by two digits is kept. Returns the length. */
static size_t percent_decode(const char *text, size_t length, uint8_t *out)
{
    size_t n = 0;
    for (size_t i = 0; i < length; i++) {
        if (text[i] == '%' && length - i > 2 && hex(text[i + 1]) >= 0 && hex(text[i + 2]) >= 0) {
            out[n++] = (uint8_t) (16 * hex(text[i + 1]) + hex(text[i + 2]));
            i += 2;
        } else {
            out[n++] = (uint8_t) text[i];
        }
    }
    return n;
}

static bool starts_with(const char *text, const char *start)
{
    for (; *start; text++, start++)
        if (pell_lower(*text) != *start)
            return false;
    return true;
}

bool gltf_is_data_uri(const char *uri)
{
    return starts_with(uri, "data:");
}

static void base64_table(uint8_t table[256])
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    memset(table, 0xff, 256);
    for (int i = 0; i < 64; i++)
        table[(uint8_t) digits[i]] = (uint8_t) i;
}

/* RFC 4648 section 4, padding optional; false for an invalid character, padding in the middle or an impossible length. */
static bool base64_decode(const char *text, size_t length, uint8_t *out, size_t *size)
{
    uint8_t table[256];
    uint32_t bits = 0;
    size_t n = 0, i = 0;

    base64_table(table);
    if (length % 4 == 0 && length >= 4)
        length -= text[length - 1] == '=' ? (text[length - 2] == '=' ? 2 : 1) : 0;
    if (length % 4 == 1)
        return false;
    for (; i + 4 <= length; i += 4) {
        const uint8_t a = table[(uint8_t) text[i]], b = table[(uint8_t) text[i + 1]], c = table[(uint8_t) text[i + 2]],
                      d = table[(uint8_t) text[i + 3]];
        if ((a | b | c | d) & 0x80)
            return false;
        out[n++] = (uint8_t) (a << 2 | b >> 4);
        out[n++] = (uint8_t) (b << 4 | c >> 2);
        out[n++] = (uint8_t) (c << 6 | d);
    }
    for (size_t k = i; k < length; k++) {
        const uint8_t a = table[(uint8_t) text[k]];
        if (a & 0x80)
            return false;
        bits = bits << 6 | a;
    }
    if (length - i == 2)
        out[n++] = (uint8_t) (bits >> 4);
    if (length - i == 3) {
        out[n++] = (uint8_t) (bits >> 10);
        out[n++] = (uint8_t) (bits >> 2);
    }
    *size = n;
    return true;
}

enum pell_result gltf_data_uri(struct pell_context *ctx, const char *uri, uint8_t **bytes, size_t *size, const char **problem)
{
    const char *comma = strchr(uri, ','), *text;
    const size_t head = comma ? (size_t) (comma - uri) : 0;
    size_t length;

    *bytes = NULL;
    *size = 0;
    *problem = NULL;
    if (!comma) {
        *problem = "the data URI has no comma";
        return PELL_OK;
    }
    text = comma + 1;
    length = strlen(text);
    *bytes = pell_alloc(ctx, length + 1);
    if (!*bytes)
        return PELL_ERR_NOMEM;
    if (head >= 7 && starts_with(comma - 7, ";base64")) {
        if (!base64_decode(text, length, *bytes, size)) {
            pell_free(ctx, *bytes);
            *bytes = NULL;
            *problem = "the data URI is not valid base64 (A-Z a-z 0-9 + / and at most two = at the end)";
        }
    } else {
        *size = percent_decode(text, length, *bytes);
    }
    return PELL_OK;
}

enum pell_result gltf_file_uri(struct pell_context *ctx, const char *uri, char **reference, const char **problem)
{
    const size_t length = strlen(uri), scheme = strspn(uri, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+.-");
    size_t n;

    *reference = NULL;
    *problem = NULL;
    /* one letter before a colon would be a drive, which the path rules refuse as absolute */
    if (scheme > 1 && uri[scheme] == ':') {
        *problem = "files are read from disk only; a URI with a scheme is not followed";
        return PELL_OK;
    }
    if (length == 0) {
        *problem = "the URI is empty";
        return PELL_OK;
    }
    *reference = pell_alloc(ctx, length + 1);
    if (!*reference)
        return PELL_ERR_NOMEM;
    n = percent_decode(uri, length, (uint8_t *) *reference);
    (*reference)[n] = '\0';
    if (memchr(*reference, '\0', n)) {
        pell_free(ctx, *reference);
        *reference = NULL;
        *problem = "the URI holds a NUL character (%00)";
    }
    return PELL_OK;
}

/* --- Buffers and views ------------------------------------------------------------------------------------------------------ */

static enum pell_result load_uri(struct gltf *g, const struct pell_json *at, const char *uri, struct gltf_buffer *buffer)
{
    const char *problem;
    char *reference = NULL, *path = NULL;
    struct pell_text where;
    enum pell_result res;
    size_t size;

    if (gltf_is_data_uri(uri)) {
        PELL_TRY(gltf_data_uri(g->ctx, uri, &buffer->owned, &size, &problem));
    } else {
        PELL_TRY(gltf_file_uri(g->ctx, uri, &reference, &problem));
        if (!problem) {
            PELL_TRY(pell_path_resolve(g->ctx, pell_json_where(at, &where), g->import->root, reference, g->import->allow_outside, &path));
            PELL_TRY(pell_file_read(g->ctx, path, &buffer->owned, &size));
        }
    }
    if (problem) {
        res = pell_json_error(at, PELL_ERR_FORMAT, NULL, "%s", problem);
        goto fail;
    }
    buffer->bytes = (struct gltf_bytes) { buffer->owned, size };

fail:
    pell_free(g->ctx, reference);
    pell_free(g->ctx, path);
    return res;
}

static enum pell_result get_buffer(struct gltf *g, int64_t index, struct gltf_bytes *out)
{
    struct gltf_buffer *buffer = &g->buffer[index];
    const struct pell_json at = pell_json_at(&g->buffers, (size_t) index);
    const char *uri = NULL;
    int64_t size = 0;
    enum pell_result res;

    if (!buffer->ready) {
        const struct pell_json uri_at = pell_json_get(&at, "uri");
        PELL_TRY(pell_json_is_object(&at));
        PELL_TRY(pell_json_require(&at, "byteLength"));
        PELL_TRY(pell_json_int(&at, "byteLength", 1, g->limits->file_bytes, &size));
        PELL_TRY(pell_json_string(&at, "uri", &uri));
        if (uri) {
            PELL_TRY(load_uri(g, &uri_at, uri, buffer));
        } else if (index == 0 && g->bin.data) {
            buffer->bytes = g->bin;
        } else {
            struct pell_json extensions, meshopt;
            PELL_TRY(gltf_extension(&at, "EXT_meshopt_compression", &extensions, &meshopt));
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                                   meshopt.value ? "stands in for compressed data, which a view of it does not name"
                                                 : "has no uri, and there is no binary chunk for it");
        }
        if (buffer->bytes.size < (uint64_t) size)
            return pell_json_error(&at, PELL_ERR_FORMAT, "the file may be cut off", "byteLength is %" PRId64 ", but only %s there", size,
                                   pell_counted((long long) buffer->bytes.size, "byte is", "bytes are").str);
        buffer->bytes.size = (uint64_t) size;
        buffer->ready = true;
    }
    *out = buffer->bytes;
    return PELL_OK;

fail:
    return res;
}

/* `length`: the length given by the view. */
static enum pell_result packed_view(struct gltf *g, const struct pell_json *at, const struct pell_json *meshopt, struct gltf_buffer *view,
                                    int64_t length, struct gltf_bytes *out, uint32_t *stride)
{
    struct gltf_bytes bytes = { 0 };
    struct gltf_packed p;
    enum pell_result res;

    PELL_TRY(gltf_meshopt_read(g, meshopt, &p));
    if (length != p.count * p.stride)
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "byteLength is %" PRId64 ", but %s unpacked", length,
                               pell_counted(p.count * p.stride, "byte is", "bytes are").str);
    if (!view->ready) {
        PELL_TRY(get_buffer(g, p.buffer, &bytes));
        PELL_TRY(gltf_meshopt_decode(g, meshopt, &p, bytes, view));
    }
    *out = view->bytes;
    if (stride)
        *stride = p.mode == 0 ? (uint32_t) p.stride : 0;
    return PELL_OK;

fail:
    return res;
}

enum pell_result gltf_view(struct gltf *g, const struct pell_json *parent, const char *key, struct gltf_bytes *out, uint32_t *stride)
{
    int64_t view = -1, buffer = -1, offset = 0, length = 0, step = 0;
    struct pell_json at, extensions, meshopt;
    struct gltf_bytes bytes = { 0 };
    enum pell_result res;

    PELL_TRY(pell_json_require(parent, key));
    PELL_TRY(gltf_index(parent, key, &g->views, &view));
    at = pell_json_at(&g->views, (size_t) view);
    PELL_TRY(pell_json_is_object(&at));
    PELL_TRY(gltf_extension(&at, "EXT_meshopt_compression", &extensions, &meshopt));
    PELL_TRY(pell_json_require(&at, "buffer"));
    PELL_TRY(pell_json_require(&at, "byteLength"));
    PELL_TRY(gltf_index(&at, "buffer", &g->buffers, &buffer));
    PELL_TRY(pell_json_int(&at, "byteOffset", 0, g->limits->file_bytes, &offset));
    PELL_TRY(pell_json_int(&at, "byteLength", 1, g->limits->file_bytes, &length));
    PELL_TRY(pell_json_int(&at, "byteStride", 4, 252, &step));
    if (meshopt.value)
        return packed_view(g, &at, &meshopt, &g->view[view], length, out, stride);
    PELL_TRY(get_buffer(g, buffer, &bytes));
    if ((uint64_t) offset > bytes.size || (uint64_t) length > bytes.size - (uint64_t) offset)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                               "byteOffset %" PRId64 " + byteLength %" PRId64 " passes the end of buffer %" PRId64 ", which has %" PRIu64
                               " bytes",
                               offset, length, buffer, bytes.size);
    *out = (struct gltf_bytes) { bytes.data + offset, (uint64_t) length };
    if (stride)
        *stride = (uint32_t) step;
    return PELL_OK;

fail:
    return res;
}

/* --- Accessors -------------------------------------------------------------------------------------------------------------- */

static uint32_t type_size(enum gltf_type type)
{
    return type == GLTF_I8 || type == GLTF_U8 ? 1 : type == GLTF_I16 || type == GLTF_U16 ? 2 : 4;
}

static enum pell_result component_type(const struct pell_json *parent, bool indices, enum gltf_type *out)
{
    const struct pell_json at = pell_json_get(parent, "componentType");
    int64_t type = 0;
    enum pell_result res;

    PELL_TRY(pell_json_require(parent, "componentType"));
    PELL_TRY(pell_json_int(parent, "componentType", INT32_MIN, INT32_MAX, &type));
    if (indices ? type == GLTF_U8 || type == GLTF_U16 || type == GLTF_U32
                : (type >= GLTF_I8 && type <= GLTF_U16) || type == GLTF_U32 || type == GLTF_F32) {
        *out = (enum gltf_type) type;
        return PELL_OK;
    }
    return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "is %" PRId64 ", allowed: %s", type,
                           indices ? "5121, 5123, 5125 (unsigned integers)" : "5120, 5121, 5122, 5123, 5125, 5126");

fail:
    return res;
}

/* Checks that elements of `element` bytes at `stride` from `offset` on all lie inside the view. */
static enum pell_result check_range(const struct pell_json *at, const struct gltf_bytes *view, int64_t offset, uint32_t count,
                                    uint32_t stride, uint32_t element)
{
    /* offset < 2^36 + 2^6, count < 2^33, stride < 2^8: no overflow */
    const uint64_t end = (uint64_t) offset + (uint64_t) (count - 1) * stride + element;

    if (end <= view->size)
        return PELL_OK;
    return pell_json_error(at, PELL_ERR_FORMAT, NULL,
                           "%" PRIu32 " elements of %" PRIu32 " bytes from byteOffset %" PRId64 " at a stride of %" PRIu32 " need %" PRIu64
                           " bytes, but the buffer view has %" PRIu64,
                           count, element, offset, stride, end, view->size);
}

static enum pell_result read_sparse(struct gltf *g, const struct pell_json *at, struct gltf_accessor *a)
{
    const uint32_t element = type_size(a->type) * (uint32_t) a->components;
    struct pell_json sparse, indices, values;
    struct gltf_bytes view;
    int64_t count = 0, offset = 0;
    enum pell_result res;

    PELL_TRY(pell_json_object(at, "sparse", &sparse));
    if (!sparse.value)
        return PELL_OK;
    PELL_TRY(pell_json_require(&sparse, "count"));
    PELL_TRY(pell_json_require(&sparse, "indices"));
    PELL_TRY(pell_json_require(&sparse, "values"));
    PELL_TRY(pell_json_int(&sparse, "count", 1, a->count, &count));
    PELL_TRY(pell_json_object(&sparse, "indices", &indices));
    PELL_TRY(pell_json_object(&sparse, "values", &values));

    PELL_TRY(component_type(&indices, true, &a->sparse_type));
    PELL_TRY(pell_json_int(&indices, "byteOffset", 0, g->limits->file_bytes, &offset));
    PELL_TRY(gltf_view(g, &indices, "bufferView", &view, NULL));
    PELL_TRY(check_range(&indices, &view, offset, (uint32_t) count, type_size(a->sparse_type), type_size(a->sparse_type)));
    a->sparse_index = view.data + offset;

    offset = 0;
    PELL_TRY(pell_json_int(&values, "byteOffset", 0, g->limits->file_bytes, &offset));
    PELL_TRY(gltf_view(g, &values, "bufferView", &view, NULL));
    PELL_TRY(check_range(&values, &view, offset, (uint32_t) count, element, element));
    a->sparse_value = view.data + offset;
    a->sparse_count = (uint32_t) count;
    return PELL_OK;

fail:
    return res;
}

static uint32_t load_uint(const uint8_t *p, enum gltf_type type, size_t index)
{
    uint32_t u32;
    uint16_t u16;

    if (type == GLTF_U8)
        return p[index];
    if (type == GLTF_U16) {
        memcpy(&u16, p + 2 * index, 2);
        return u16;
    }
    memcpy(&u32, p + 4 * index, 4);
    return u32;
}

static enum pell_result read_accessor(struct gltf *g, int64_t index, struct gltf_accessor *a)
{
    static const char *const types[] = { "SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4" };
    const struct pell_json at = pell_json_at(&g->accessors, (size_t) index);
    const int64_t limit = g->limits->vertices > 3 * g->limits->triangles + 2 ? g->limits->vertices : 3 * g->limits->triangles + 2;
    const int64_t most = limit < UINT32_MAX ? limit : UINT32_MAX;
    int64_t count = 0, offset = 0;
    uint32_t stride = 0, element;
    int type = 0;
    enum pell_result res;

    PELL_TRY(pell_json_is_object(&at));
    PELL_TRY(pell_json_require(&at, "type"));
    PELL_TRY(pell_json_require(&at, "count"));
    PELL_TRY(pell_json_choice(&at, "type", types, PELL_COUNT(types), &type));
    if (type == 4 || type == 5)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "type is %s, allowed for what uses it: SCALAR, VEC2, VEC3, VEC4, MAT4",
                               types[type]);
    PELL_TRY(component_type(&at, false, &a->type));
    PELL_TRY(pell_json_bool(&at, "normalized", &a->normalized));
    PELL_TRY(pell_json_int(&at, "count", 1, most, &count));
    PELL_TRY(pell_json_int(&at, "byteOffset", 0, g->limits->file_bytes, &offset));
    a->components = type == 6 ? 16 : type + 1;
    a->count = (uint32_t) count;
    a->stride = element = type_size(a->type) * (uint32_t) a->components;
    if (pell_json_get(&at, "bufferView").value) {
        struct gltf_bytes view;
        PELL_TRY(gltf_view(g, &at, "bufferView", &view, &stride));
        if (stride && stride < element)
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                                   "the buffer view's stride of %" PRIu32 " is below the %" PRIu32 " bytes of an element", stride, element);
        a->stride = stride ? stride : element;
        PELL_TRY(check_range(&at, &view, offset, a->count, a->stride, element));
        a->data = view.data + offset;
    }
    PELL_TRY(read_sparse(g, &at, a));
    for (uint32_t i = 0, before = 0; i < a->sparse_count; i++) {
        const uint32_t target = load_uint(a->sparse_index, a->sparse_type, i);
        if (i > 0 && target <= before)
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                                   "sparse index %" PRIu32 " is %" PRIu32 " after %" PRIu32 "; they must increase", i, target, before);
        before = target;
        if (target >= a->count)
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "sparse index %" PRIu32 " is %" PRIu32 ", allowed: [0, %" PRIu32 "]", i,
                                   target, a->count - 1);
    }
    a->ready = true;
    return PELL_OK;

fail:
    return res;
}

enum pell_result gltf_accessor(struct gltf *g, int64_t index, const struct gltf_accessor **out)
{
    struct gltf_accessor *a = &g->accessor[index];

    if (!a->ready) {
        enum pell_result res;
        memset(a, 0, sizeof(*a));
        if ((res = read_accessor(g, index, a)) != PELL_OK)
            return res;
    }
    *out = a;
    return PELL_OK;
}

enum pell_result gltf_attribute(struct gltf *g, const struct pell_json *parent, const char *key, int64_t index, int min, int max,
                                uint32_t count, const struct gltf_accessor **out)
{
    const struct pell_json at = pell_json_get(parent, key);
    const enum pell_result res = gltf_accessor(g, index, out);

    if (res != PELL_OK)
        return res;
    if ((*out)->components < min || (*out)->components > max)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "accessor %" PRId64 " has %d components, allowed: %d to %d", index,
                               (*out)->components, min, max);
    if ((*out)->type == GLTF_U32)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "accessor %" PRId64 " has component type 5125, allowed: 5120 to 5123, 5126",
                               index);
    if ((*out)->count != count)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                               "accessor %" PRId64 " has %" PRIu32 " elements, allowed: %" PRIu32 ", as POSITION has", index, (*out)->count,
                               count);
    return PELL_OK;
}

/* --- Reading: loops over memory that is known to be there ------------------------------------------------------------------- */

/* Section 3.11 of the specification: c/127 and c/32767 are limited from below, so that -128 is -1, too. */
#define CONVERT(name, ctype, scale, low)                                                                                                   \
    static void name(const uint8_t *data, size_t stride, size_t count, int components, bool normalized, float *out)                        \
    {                                                                                                                                      \
        const float divisor = normalized ? (scale) : 1.0f, lowest = normalized ? (low) : -3.4028234e38f;                                   \
        for (size_t i = 0; i < count; i++, data += stride)                                                                                 \
            for (int c = 0; c < components; c++) {                                                                                         \
                ctype x;                                                                                                                   \
                memcpy(&x, data + (size_t) c * sizeof(x), sizeof(x));                                                                      \
                const float f = (float) x / divisor;                                                                                       \
                *out++ = f < lowest ? lowest : f;                                                                                          \
            }                                                                                                                              \
    }
CONVERT(convert_i8, int8_t, 127.0f, -1.0f)
CONVERT(convert_u8, uint8_t, 255.0f, 0.0f)
CONVERT(convert_i16, int16_t, 32767.0f, -1.0f)
CONVERT(convert_u16, uint16_t, 65535.0f, 0.0f)
CONVERT(convert_u32, uint32_t, 4294967295.0f, 0.0f)

static void convert(const struct gltf_accessor *a, bool normalize, const uint8_t *data, size_t stride, size_t count, float *out)
{
    const size_t element = (size_t) a->components * sizeof(float);

    switch (a->type) {
    case GLTF_I8: convert_i8(data, stride, count, a->components, normalize, out); break;
    case GLTF_U8: convert_u8(data, stride, count, a->components, normalize, out); break;
    case GLTF_I16: convert_i16(data, stride, count, a->components, normalize, out); break;
    case GLTF_U16: convert_u16(data, stride, count, a->components, normalize, out); break;
    case GLTF_U32: convert_u32(data, stride, count, a->components, normalize, out); break;
    case GLTF_F32:
        if (stride == element) {
            memcpy(out, data, count * element);
        } else {
            for (size_t i = 0; i < count; i++)
                memcpy(out + i * (size_t) a->components, data + i * stride, element);
        }
        break;
    }
}

void gltf_read_floats(const struct gltf_accessor *a, bool normalize, float *out)
{
    const size_t n = (size_t) a->components, element = n * type_size(a->type);

    normalize = normalize || a->normalized;
    if (a->data)
        convert(a, normalize, a->data, a->stride, a->count, out);
    else
        memset(out, 0, a->count * n * sizeof(float));
    for (uint32_t i = 0; i < a->sparse_count; i++) {
        const size_t target = load_uint(a->sparse_index, a->sparse_type, i);
        convert(a, normalize, a->sparse_value + i * element, element, 1, out + target * n);
    }
}

void gltf_read_indices(const struct gltf_accessor *a, uint32_t *out)
{
    const size_t element = type_size(a->type);

    if (!a->data) {
        memset(out, 0, a->count * sizeof(*out));
    } else if (a->stride != element) {
        for (size_t i = 0; i < a->count; i++)
            out[i] = load_uint(a->data + i * a->stride, a->type, 0);
    } else if (a->type == GLTF_U32) {
        memcpy(out, a->data, a->count * sizeof(*out));
    } else if (a->type == GLTF_U16) {
        for (size_t i = 0; i < a->count; i++)
            out[i] = load_uint(a->data, GLTF_U16, i);
    } else {
        for (size_t i = 0; i < a->count; i++)
            out[i] = a->data[i];
    }
    for (uint32_t i = 0; i < a->sparse_count; i++)
        out[load_uint(a->sparse_index, a->sparse_type, i)] = load_uint(a->sparse_value, a->type, i);
}
