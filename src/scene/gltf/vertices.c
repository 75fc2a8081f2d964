/* SPDX-License-Identifier: MIT
 *
 * vertices.c - what meshes, morph targets and skins do to arrays of vertices.
 */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

/* limit on moved vertices, counting each target and each set of joints, as a multiple of the limit of vertices */
#define DEFORMED_FACTOR 16

/* Tests bit patterns first, which vectorises. */
size_t gltf_first_not_finite(const float *x, size_t count)
{
    enum { BLOCK = 1024 };
    for (size_t at = 0; at < count; at += BLOCK) {
        const size_t n = count - at < BLOCK ? count - at : BLOCK;
        uint32_t bad = 0;
        for (size_t i = 0; i < n; i++) {
            uint32_t bits;
            memcpy(&bits, x + at + i, sizeof(bits));
            bad |= (bits & 0x7f800000u) == 0x7f800000u;
        }
        for (size_t i = 0; bad && i < n; i++)
            if (!isfinite(x[at + i]))
                return at + i;
    }
    return count;
}

size_t gltf_transform_vectors(const struct pell_mat4 *matrix, bool normals, float *p, size_t count, size_t size)
{
    struct pell_mat4 unit = { { 0 } };
    size_t bad = 0;

    if (matrix)
        unit = pell_mat4_scaled_to_one(matrix);
    for (size_t i = 0; i < count; i++, p += size) {
        struct pell_vec3 v = vec3_load(p);
        float l2 = vec3_dot(v, v);
        if (l2 > 1e-20f && l2 < 1e20f) {
            v = vec3_mul(v, 1.0f / sqrtf(l2));
            if (matrix) {
                v = normals ? mat4_normal(&unit, v) : mat4_direction(&unit, v);
                l2 = vec3_dot(v, v);
                v = l2 > 1e-30f ? vec3_mul(v, 1.0f / sqrtf(l2)) : vec3(0, 0, 0);
            }
        } else {
            v = vec3(0, 0, 0);
        }
        bad += v.x == 0.0f && v.y == 0.0f && v.z == 0.0f;
        vec3_store(v, p);
    }
    return bad;
}

enum pell_result gltf_count_deformed(struct gltf *g, const struct pell_json *at, uint64_t vertices)
{
    const int64_t most = DEFORMED_FACTOR * g->limits->vertices; /* below 2^36 */

    if (vertices > (uint64_t) (most - g->deformed))
        return pell_json_error(at, PELL_ERR_UNSUPPORTED, PELL_RAISE_LIMIT("vertices"),
                               "morph targets and skins move more than %" PRId64 " vertices, each counted for each target and joint", most);
    g->deformed += (int64_t) vertices;
    return PELL_OK;
}
