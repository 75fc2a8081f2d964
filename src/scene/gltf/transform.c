/* SPDX-License-Identifier: MIT
 *
 * transform.c - node transforms: local, and from a node's space to the world's.
 */
#include "scene/gltf/gltf.h"

#include <math.h>

static bool is_finite_matrix(const struct pell_mat4 *m)
{
    for (int i = 0; i < 16; i++)
        if (!isfinite(m->m[i]))
            return false;
    return true;
}

struct pell_mat4 gltf_compose(const double t[3], const double q[4], const double s[3])
{
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    return (struct pell_mat4) { {
        s[0] * (1 - 2 * (y * y + z * z)),
        s[0] * 2 * (x * y + z * w),
        s[0] * 2 * (x * z - y * w),
        0,
        s[1] * 2 * (x * y - z * w),
        s[1] * (1 - 2 * (x * x + z * z)),
        s[1] * 2 * (y * z + x * w),
        0,
        s[2] * 2 * (x * z + y * w),
        s[2] * 2 * (y * z - x * w),
        s[2] * (1 - 2 * (x * x + y * y)),
        0,
        t[0],
        t[1],
        t[2],
        1,
    } };
}

bool gltf_normalize_quaternion(double q[4], double *length)
{
    *length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(*length > 1e-12 && *length < 1e12))
        return false;
    for (int i = 0; i < 4; i++)
        q[i] /= *length;
    return true;
}

/* `pose` NULL, or unanimated parts: the node's own values. */
static enum pell_result local_matrix(struct gltf *g, const struct pell_json *node, const struct gltf_pose *pose, struct pell_mat4 *out)
{
    const double most = 1e30; /* products are finite in doubles */
    const struct pell_json matrix_at = pell_json_get(node, "matrix"), rotation_at = pell_json_get(node, "rotation");
    double t[3] = { 0, 0, 0 }, q[4] = { 0, 0, 0, 1 }, s[3] = { 1, 1, 1 }, length;
    enum pell_result res;

    PELL_TRY(pell_json_numbers(node, "translation", 3, -most, most, t));
    PELL_TRY(pell_json_numbers(node, "rotation", 4, -most, most, q));
    PELL_TRY(pell_json_numbers(node, "scale", 3, -most, most, s));
    *out = mat4_identity();
    if (matrix_at.value && pose && (pose->moved[GLTF_TRANSLATION] || pose->moved[GLTF_ROTATION] || pose->moved[GLTF_SCALE]))
        return pell_json_error(&matrix_at, PELL_ERR_FORMAT, NULL,
                               "an animation moves the node, allowed then: translation, rotation and scale");
    if (matrix_at.value) {
        PELL_TRY(pell_json_numbers(node, "matrix", 16, -most, most, out->m));
        if (fabs(out->m[3]) > 1e-6 || fabs(out->m[7]) > 1e-6 || fabs(out->m[11]) > 1e-6 || fabs(out->m[15] - 1.0) > 1e-6)
            return pell_json_error(&matrix_at, PELL_ERR_FORMAT, NULL, "the last row is %g %g %g %g, allowed: 0 0 0 1", out->m[3], out->m[7],
                                   out->m[11], out->m[15]);
        out->m[3] = out->m[7] = out->m[11] = 0.0;
        out->m[15] = 1.0;
        if (rotation_at.value || pell_json_get(node, "translation").value || pell_json_get(node, "scale").value)
            gltf_warn(g, GLTF_WARN_NODE, node, NULL, "the node has a matrix and translation, rotation or scale: the matrix is used");
        return PELL_OK;
    }
    if (!gltf_normalize_quaternion(q, &length))
        return pell_json_error(&rotation_at, PELL_ERR_FORMAT, NULL, "the quaternion has length %g, allowed: 1", length);
    if (fabs(length - 1.0) > 1e-3)
        gltf_warn(g, GLTF_WARN_NODE, &rotation_at, NULL, "the quaternion has length %g instead of 1 and is normalised", length);
    *out = gltf_compose(pose && pose->moved[GLTF_TRANSLATION] ? pose->value[GLTF_TRANSLATION] : t,
                        pose && pose->moved[GLTF_ROTATION] ? pose->value[GLTF_ROTATION] : q,
                        pose && pose->moved[GLTF_SCALE] ? pose->value[GLTF_SCALE] : s);
    return PELL_OK;

fail:
    return res;
}

enum pell_result gltf_node_world(struct gltf *g, int64_t index, const struct pell_mat4 **out)
{
    int32_t at = (int32_t) index, child = -1;
    enum pell_result res;

    /* up to a known matrix, then down the same path: trees may be of any depth */
    for (; at >= 0 && !g->node[at].placed; at = g->node[at].parent) {
        g->node[at].child = child;
        child = at;
    }
    while (child >= 0) {
        struct gltf_node *n = &g->node[child];
        const struct pell_json node = pell_json_at(&g->nodes, (size_t) child);
        struct pell_mat4 local;
        PELL_TRY(local_matrix(g, &node, g->pose ? &g->pose[child] : NULL, &local));
        n->world = n->parent >= 0 ? mat4_mul(&g->node[n->parent].world, &local) : local;
        if (!is_finite_matrix(&n->world))
            return pell_json_error(&node, PELL_ERR_FORMAT, NULL, "the product of the transforms down to this node is not finite");
        n->placed = true;
        child = n->child;
    }
    *out = &g->node[index].world;
    return PELL_OK;

fail:
    return res;
}

bool gltf_has_area(const struct pell_mat4 *world)
{
    const double *m = world->m;
    double largest = 0.0, cofactor = 0.0;

    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 3; i++)
            largest = fmax(largest, fabs(m[4 * a + i]));
    for (int a = 0; a < 3 && largest > 0.0; a++) {
        const double *u = m + 4 * a, *v = m + 4 * ((a + 1) % 3);
        for (int i = 0; i < 3; i++) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            cofactor = fmax(cofactor, fabs(u[j] / largest * (v[k] / largest) - u[k] / largest * (v[j] / largest)));
        }
    }
    return cofactor > 1e-12;
}
