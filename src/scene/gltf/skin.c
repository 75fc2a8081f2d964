/* SPDX-License-Identifier: MIT
 * skin.c - skins of glTF 2.0 (section 3.7.3 of the specification): linear blend skinning. A vertex is transformed by the weighted mean of
 * its joints' matrices; the transform of the mesh's own node is ignored. */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define WEIGHT_TOLERANCE 0.01 /* error of a sum of weights; eight weights of a byte each are off by as much */

/* --- Joints ----------------------------------------------------------------------------------------------------------------- */

/* The `count` inverse bind matrices of a skin; absent ones are identities. */
static enum pell_result read_inverses(struct gltf *g, const struct pell_json *skin, uint32_t count, struct pell_mat4 *out)
{
    const struct pell_json at = pell_json_get(skin, "inverseBindMatrices");
    const struct gltf_accessor *a;
    int64_t index = -1;
    float *m;
    enum pell_result res;

    for (uint32_t i = 0; i < count; i++)
        out[i] = mat4_identity();
    PELL_TRY(gltf_index(skin, "inverseBindMatrices", &g->accessors, &index));
    if (index < 0)
        return PELL_OK;
    PELL_TRY(gltf_accessor(g, index, &a));
    if (a->components != 16 || a->type != GLTF_F32)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                               "accessor %" PRId64 " has %d components of type %d, allowed: MAT4 of 5126 (float)", index, a->components,
                               a->type);
    if (a->count < count)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "accessor %" PRId64 " has %" PRIu32 " matrices for %" PRIu32 " joints", index,
                               a->count, count);
    PELL_TRY(gltf_count_deformed(g, &at, a->count)); /* a sparse accessor may be far larger than its file */
    m = pell_alloc_array(g->ctx, a->count, 16 * sizeof(*m));
    if (!m)
        return PELL_ERR_NOMEM;
    gltf_read_floats(a, false, m);
    for (uint32_t i = 0; i < count && res == PELL_OK; i++) {
        const float *p = m + 16 * (size_t) i;
        const size_t bad = gltf_first_not_finite(p, 16);
        if (bad < 16)
            res = pell_json_error(&at, PELL_ERR_FORMAT, NULL, "matrix %" PRIu32 " has a component %g, allowed: finite numbers", i,
                                  (double) p[bad]);
        else if (fabsf(p[3]) > 1e-4f || fabsf(p[7]) > 1e-4f || fabsf(p[11]) > 1e-4f || fabsf(p[15] - 1.0f) > 1e-4f)
            res = pell_json_error(&at, PELL_ERR_FORMAT, NULL, "the last row of matrix %" PRIu32 " is %g %g %g %g, allowed: 0 0 0 1", i,
                                  (double) p[3], (double) p[7], (double) p[11], (double) p[15]);
        for (int k = 0; k < 16; k++)
            out[i].m[k] = k % 4 < 3 ? (double) p[k] : k == 15;
    }
    pell_free(g->ctx, m);
    return res;

fail:
    return res;
}

static enum pell_result read_skin(struct gltf *g, int64_t index, struct gltf_skin *s)
{
    const struct pell_json at = pell_json_at(&g->skins, (size_t) index);
    struct pell_json joints;
    int64_t skeleton;
    enum pell_result res;

    PELL_TRY(pell_json_is_object(&at));
    PELL_TRY(pell_json_require(&at, "joints"));
    PELL_TRY(pell_json_array(&at, "joints", 1, (size_t) g->limits->nodes, &joints));
    PELL_TRY(gltf_index(&at, "skeleton", &g->nodes, &skeleton)); /* only a hint to find the joints' common root */
    s->num_joints = (uint32_t) pell_json_count(&joints);
    if (!s->matrix)
        s->matrix = pell_alloc_array(g->ctx, s->num_joints, sizeof(*s->matrix));
    if (!s->matrix)
        return PELL_ERR_NOMEM;
    PELL_TRY(read_inverses(g, &at, s->num_joints, s->matrix));
    s->singular = true;
    for (uint32_t i = 0; i < s->num_joints; i++) {
        const struct pell_json joint_at = pell_json_at(&joints, i);
        const struct pell_mat4 *world;
        int64_t joint;
        PELL_TRY(pell_json_to_int(&joint_at, 0, (int64_t) pell_json_count(&g->nodes) - 1, &joint));
        PELL_TRY(gltf_node_world(g, joint, &world));
        if (i == 0)
            s->first_joint = (int32_t) joint;
        s->matrix[i] = mat4_mul(world, &s->matrix[i]);
        s->singular &= !gltf_has_area(&s->matrix[i]);
        for (int k = 0; k < 16; k++)
            if (!(fabs(s->matrix[i].m[k]) < 1e300)) /* weighted sums stay finite */
                return pell_json_error(&joint_at, PELL_ERR_FORMAT, NULL, "the matrix of joint %" PRIu32 " is out of the range of numbers",
                                       i);
    }
    s->ready = true;
    return PELL_OK;

fail:
    return res;
}

enum pell_result gltf_skin(struct gltf *g, int64_t index, const struct gltf_skin **out)
{
    struct gltf_skin *s = &g->skin[index];
    enum pell_result res;

    if (!s->ready && (res = read_skin(g, index, s)) != PELL_OK)
        return res;
    *out = s;
    return PELL_OK;
}

/* --- Vertices --------------------------------------------------------------------------------------------------------------- */

/* Joints and weights, four per vertex and set, as in the file. */
struct binding {
    float *joint[GLTF_JOINT_SETS], *weight[GLTF_JOINT_SETS];
    int sets;
    size_t not_normalized, weightless; /* vertices whose weights do not sum to 1; that have no weights */
};

static enum pell_result read_binding(struct gltf *g, const struct pell_json *primitive, const struct gltf_primitive *p, uint32_t vertices,
                                     struct binding *b)
{
    const struct pell_json attributes = pell_json_get(primitive, "attributes");
    enum pell_result res;

    for (int i = 0; i < GLTF_JOINT_SETS && p->joints[i] >= 0; i++) {
        const struct gltf_accessor *joints, *weights;
        char key[2][16];
        snprintf(key[0], sizeof(key[0]), "JOINTS_%d", i);
        snprintf(key[1], sizeof(key[1]), "WEIGHTS_%d", i);
        PELL_TRY(gltf_attribute(g, &attributes, key[0], p->joints[i], 4, 4, vertices, &joints));
        PELL_TRY(gltf_attribute(g, &attributes, key[1], p->weights[i], 4, 4, vertices, &weights));
        if ((joints->type != GLTF_U8 && joints->type != GLTF_U16) || joints->normalized) {
            const struct pell_json at = pell_json_get(&attributes, key[0]);
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                                   "accessor %" PRId64 " has component type %d%s, allowed: 5121 or 5123 as whole numbers", p->joints[i],
                                   joints->type, joints->normalized ? ", normalized" : "");
        }
        if (weights->type != GLTF_F32 && weights->type != GLTF_U8 && weights->type != GLTF_U16) {
            const struct pell_json at = pell_json_get(&attributes, key[1]);
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "accessor %" PRId64 " has component type %d, allowed: 5126, 5121, 5123",
                                   p->weights[i], weights->type);
        }
        PELL_TRY(gltf_count_deformed(g, primitive, vertices));
        b->joint[i] = pell_alloc_array(g->ctx, vertices, 4 * sizeof(float));
        b->weight[i] = pell_alloc_array(g->ctx, vertices, 4 * sizeof(float));
        if (!b->joint[i] || !b->weight[i])
            return PELL_ERR_NOMEM;
        gltf_read_floats(joints, false, b->joint[i]);
        gltf_read_floats(weights, weights->type != GLTF_F32, b->weight[i]);
        b->sets = i + 1;
    }
    if (b->sets == 0)
        return pell_json_error(&attributes, PELL_ERR_FORMAT, NULL, "the mesh has a skin, but the primitive has no JOINTS_0 and WEIGHTS_0");
    return PELL_OK;

fail:
    return res;
}

/* The weighted mean of a vertex' joints. Joints without weight are ignored: exporters leave arbitrary indices there. */
static enum pell_result blend(const struct pell_json *primitive, const struct gltf_skin *skin, struct binding *b, size_t vertex,
                              struct pell_mat4 *out)
{
    double sum = 0.0;

    memset(out, 0, sizeof(*out));
    for (int i = 0; i < 4 * b->sets; i++) {
        const float w = b->weight[i / 4][4 * vertex + (size_t) (i % 4)], joint = b->joint[i / 4][4 * vertex + (size_t) (i % 4)];
        if (!(w >= 0.0f && w <= 1e6f)) {
            const struct pell_json attributes = pell_json_get(primitive, "attributes");
            const struct pell_json at = pell_json_get(&attributes, i < 4 ? "WEIGHTS_0" : "WEIGHTS_1");
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "weight %d of vertex %zu is %g, allowed: [0, 1]", i % 4, vertex, (double) w);
        }
        if (w > 0.0f && !(joint < (float) skin->num_joints)) {
            const struct pell_json attributes = pell_json_get(primitive, "attributes");
            const struct pell_json at = pell_json_get(&attributes, i < 4 ? "JOINTS_0" : "JOINTS_1");
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                                   "joint %d of vertex %zu is %g, allowed: [0, %" PRIu32 "], as the skin has %" PRIu32, i % 4, vertex,
                                   (double) joint, skin->num_joints - 1, skin->num_joints);
        }
        for (int k = 0; k < 16 && w > 0.0f; k++)
            out->m[k] += (double) w * skin->matrix[(uint32_t) joint].m[k];
        sum += (double) w;
    }
    b->not_normalized += fabs(sum - 1.0) > WEIGHT_TOLERANCE;
    if (sum > 0.0) {
        for (int k = 0; k < 15; k++)
            out->m[k] /= sum;
    } else {
        const float joint = b->joint[0][4 * vertex];
        b->weightless++;
        *out = skin->matrix[joint < (float) skin->num_joints ? (uint32_t) joint : 0];
    }
    out->m[15] = 1.0;
    return PELL_OK;
}

/* Reverses triangles if the joints mirror, so that they stay counter-clockwise from outside. */
static void flip_triangles(const uint8_t *mirrored, struct pell_mesh *mesh)
{
    for (size_t i = 0; i < mesh->num_triangles; i++) {
        uint32_t *corner = mesh->index + 3 * i;
        if (mirrored[corner[0]] + mirrored[corner[1]] + mirrored[corner[2]] >= 2) {
            const uint32_t second = corner[1];
            corner[1] = corner[2];
            corner[2] = second;
        }
    }
}

enum pell_result gltf_skin_mesh(struct gltf *g, const struct pell_json *primitive, const struct gltf_primitive *p,
                                const struct gltf_skin *skin, struct pell_mesh *mesh)
{
    struct binding b = { 0 };
    uint8_t *mirrored = NULL;
    bool any = false;
    enum pell_result res;

    PELL_TRY(read_binding(g, primitive, p, mesh->num_vertices, &b));
    mirrored = pell_calloc(g->ctx, mesh->num_vertices, 1);
    if (!mirrored) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    for (size_t i = 0; i < mesh->num_vertices; i++) {
        float *v = mesh->position + 3 * i;
        struct pell_mat4 m;
        PELL_TRY(blend(primitive, skin, &b, i, &m));
        vec3_store(mat4_point(&m, vec3_load(v)), v);
        mirrored[i] = mat4_determinant3(&m) < 0.0;
        any |= mirrored[i];
        if (p->normal >= 0)
            gltf_transform_vectors(&m, true, mesh->normal + 3 * i, 1, 3);
        if (mesh->tangent) {
            gltf_transform_vectors(&m, false, mesh->tangent + 4 * i, 1, 4);
            mesh->tangent[4 * i + 3] *= mirrored[i] ? -1.0f : 1.0f;
        }
    }
    if (any)
        flip_triangles(mirrored, mesh);
    if (b.not_normalized && gltf_once(g, GLTF_ONCE_WEIGHTS))
        gltf_warn(g, GLTF_WARN_VALUE, primitive, NULL,
                  "the joints' weights of %zu of %" PRIu32 " vertices are not of sum 1: they are scaled%s", b.not_normalized,
                  mesh->num_vertices, b.weightless ? "; those of sum 0 follow their first joint" : "");

fail:
    for (int i = 0; i < GLTF_JOINT_SETS; i++) {
        pell_free(g->ctx, b.joint[i]);
        pell_free(g->ctx, b.weight[i]);
    }
    pell_free(g->ctx, mirrored);
    return res;
}
