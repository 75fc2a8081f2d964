/* SPDX-License-Identifier: MIT
 * meshopt.c - buffer views of EXT_meshopt_compression, decoded by libmeshoptimizer: the only file that uses it. Its decoders are safe for
 * hostile bytes, but trust sizes and counts, which are checked here. */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <meshoptimizer.h>

enum mode { ATTRIBUTES, TRIANGLES, INDICES };
enum filter { NO_FILTER, OCTAHEDRAL, QUATERNION, EXPONENTIAL };
static const char *const modes[] = { "ATTRIBUTES", "TRIANGLES", "INDICES" };
static const char *const filters[] = { "NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL" };

static enum pell_result check_stride(const struct pell_json *at, const struct gltf_packed *p)
{
    const bool vertices = p->mode == ATTRIBUTES;

    if (vertices ? p->stride % 4 != 0 : p->stride != 2 && p->stride != 4)
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "byteStride is %" PRId64 ", must be %s with mode %s", p->stride,
                               vertices ? "a multiple of 4" : "2 or 4", modes[p->mode]);
    if (p->filter != NO_FILTER && !vertices)
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "filter %s needs mode ATTRIBUTES, not %s", filters[p->filter], modes[p->mode]);
    if ((p->filter == OCTAHEDRAL && p->stride != 4 && p->stride != 8) || (p->filter == QUATERNION && p->stride != 8))
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "byteStride is %" PRId64 ", must be %s with filter %s", p->stride,
                               p->filter == QUATERNION ? "8" : "4 or 8", filters[p->filter]);
    if (p->mode == TRIANGLES && p->count % 3 != 0)
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "count is %" PRId64 ", must be a multiple of 3 with mode TRIANGLES", p->count);
    return PELL_OK;
}

/* At best 256 values of a byte take 4 bytes, a triangle or an index one: a larger count can't be in the data, and must not allocate
 * memory. */
static enum pell_result check_promise(const struct pell_json *at, const struct gltf_packed *p)
{
    const int64_t least = p->mode == ATTRIBUTES ? p->count / 256 * p->stride * 4 : p->mode == TRIANGLES ? p->count / 3 : p->count;

    if (least <= p->length)
        return PELL_OK;
    return pell_json_error(at, PELL_ERR_FORMAT, "the file may be damaged", "%" PRId64 " elements can't be packed in %" PRId64 " bytes",
                           p->count, p->length);
}

enum pell_result gltf_meshopt_read(struct gltf *g, const struct pell_json *at, struct gltf_packed *p)
{
    enum pell_result res;

    *p = (struct gltf_packed) { .buffer = -1 };
    PELL_TRY(pell_json_require(at, "buffer"));
    PELL_TRY(pell_json_require(at, "byteLength"));
    PELL_TRY(pell_json_require(at, "byteStride"));
    PELL_TRY(pell_json_require(at, "count"));
    PELL_TRY(pell_json_require(at, "mode"));
    PELL_TRY(gltf_index(at, "buffer", &g->buffers, &p->buffer));
    PELL_TRY(pell_json_int(at, "byteOffset", 0, g->limits->file_bytes, &p->offset));
    PELL_TRY(pell_json_int(at, "byteLength", 1, g->limits->file_bytes, &p->length));
    PELL_TRY(pell_json_int(at, "byteStride", 1, 256, &p->stride));
    PELL_TRY(pell_json_int(at, "count", 1, g->limits->file_bytes / p->stride, &p->count));
    PELL_TRY(pell_json_choice(at, "mode", modes, PELL_COUNT(modes), &p->mode));
    PELL_TRY(pell_json_choice(at, "filter", filters, PELL_COUNT(filters), &p->filter));
    PELL_TRY(check_stride(at, p));
    return check_promise(at, p);

fail:
    return res;
}

static int decode(const struct gltf_packed *p, const uint8_t *data, uint8_t *out)
{
    const size_t count = (size_t) p->count, stride = (size_t) p->stride, size = (size_t) p->length;
    int failed = 0;

    switch ((enum mode) p->mode) {
    case ATTRIBUTES: failed = meshopt_decodeVertexBuffer(out, count, stride, data, size); break;
    case TRIANGLES: failed = meshopt_decodeIndexBuffer(out, count, stride, data, size); break;
    case INDICES: failed = meshopt_decodeIndexSequence(out, count, stride, data, size); break;
    }
    if (failed)
        return failed;
    switch ((enum filter) p->filter) {
    case NO_FILTER: break;
    case OCTAHEDRAL: meshopt_decodeFilterOct(out, count, stride); break;
    case QUATERNION: meshopt_decodeFilterQuat(out, count, stride); break;
    case EXPONENTIAL: meshopt_decodeFilterExp(out, count, stride); break;
    }
    return 0;
}

enum pell_result gltf_meshopt_decode(struct gltf *g, const struct pell_json *at, const struct gltf_packed *p, struct gltf_bytes buffer,
                                     struct gltf_buffer *view)
{
    if ((uint64_t) p->offset > buffer.size || (uint64_t) p->length > buffer.size - (uint64_t) p->offset)
        return pell_json_error(at, PELL_ERR_FORMAT, NULL,
                               "byteOffset %" PRId64 " + byteLength %" PRId64 " passes the end of buffer %" PRId64 ", which has %" PRIu64
                               " bytes",
                               p->offset, p->length, p->buffer, buffer.size);
    view->owned = pell_alloc_array(g->ctx, (size_t) p->count, (size_t) p->stride);
    if (!view->owned)
        return PELL_ERR_NOMEM;
    if (decode(p, buffer.data + p->offset, view->owned) != 0)
        return pell_json_error(at, PELL_ERR_FORMAT, "the file may be damaged",
                               "its %" PRId64 " bytes are no %s of %" PRId64 " x %" PRId64 " bytes", p->length, modes[p->mode], p->count,
                               p->stride);
    view->bytes = (struct gltf_bytes) { view->owned, (uint64_t) p->count * (uint64_t) p->stride };
    view->ready = true;
    return PELL_OK;
}
