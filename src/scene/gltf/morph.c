/* SPDX-License-Identifier: MIT
 * morph.c - morph targets of glTF 2.0 (section 3.7.2.2 of the specification): attribute + sum of weight x delta.
 *
 * If a target moves the surface without changing its normals, the specification keeps those of the base, which would shade the new shape
 * like the old one. Here they are recomputed (pell_scene_complete), and so are tangents. */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <string.h>

/* Checks a target's accessor against the primitive's, also if its weight is 0 and none of it is read. */
static enum pell_result check_target(struct gltf *g, const struct pell_json *target, const char *key, int64_t index, int64_t position)
{
    const struct pell_json at = pell_json_get(target, key);
    const struct pell_json accessor = pell_json_at(&g->accessors, (size_t) index), base = pell_json_at(&g->accessors, (size_t) position);
    const char *type = "";
    int64_t count = 0, expected = 0;
    enum pell_result res;

    PELL_TRY(pell_json_string(&accessor, "type", &type));
    PELL_TRY(pell_json_int(&accessor, "count", INT64_MIN, INT64_MAX, &count));
    PELL_TRY(pell_json_int(&base, "count", INT64_MIN, INT64_MAX, &expected));
    if (strcmp(type, "VEC3") != 0) {
        char shown[32];
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "accessor %" PRId64 " has the type \"%s\", allowed: \"VEC3\"", index,
                               pell_printable(type, shown, sizeof(shown)));
    }
    if (count != expected)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                               "accessor %" PRId64 " has %" PRId64 " elements, allowed: %" PRId64 ", as POSITION has", index, count,
                               expected);
    return PELL_OK;

fail:
    return res;
}

enum pell_result gltf_parse_targets(struct gltf *g, const struct pell_json *primitive, struct gltf_primitive *p, int64_t *count)
{
    struct pell_json targets;
    int64_t n;
    enum pell_result res;

    PELL_TRY(pell_json_array(primitive, "targets", 1, (size_t) g->limits->items, &targets));
    n = (int64_t) pell_json_count(&targets);
    if (*count >= 0 && n != *count)
        return pell_json_error(targets.value ? &targets : primitive, PELL_ERR_FORMAT, NULL,
                               "%" PRId64 " morph targets, allowed: %" PRId64 ", as many as its fellows have", n, *count);
    *count = n;
    if (n == 0 || p->targets)
        return PELL_OK;
    p->targets = pell_alloc_array(g->ctx, (size_t) n, sizeof(*p->targets));
    if (!p->targets)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < (size_t) n; i++) {
        const struct pell_json at = pell_json_at(&targets, i);
        struct gltf_target *t = &p->targets[i];
        *t = (struct gltf_target) { -1, -1, -1 };
        PELL_TRY(pell_json_is_object(&at));
        PELL_TRY(gltf_index(&at, "POSITION", &g->accessors, &t->position));
        PELL_TRY(gltf_index(&at, "NORMAL", &g->accessors, &t->normal));
        PELL_TRY(gltf_index(&at, "TANGENT", &g->accessors, &t->tangent));
        if (t->position >= 0)
            PELL_TRY(check_target(g, &at, "POSITION", t->position, p->position));
        if (t->normal >= 0)
            PELL_TRY(check_target(g, &at, "NORMAL", t->normal, p->position));
        if (t->tangent >= 0)
            PELL_TRY(check_target(g, &at, "TANGENT", t->tangent, p->position));
        if ((pell_json_get(&at, "TEXCOORD_0").value || pell_json_get(&at, "TEXCOORD_1").value || pell_json_get(&at, "COLOR_0").value) &&
            gltf_once(g, GLTF_ONCE_MORPH_OTHERS))
            gltf_warn(g, GLTF_WARN_PRIMITIVE, &at, NULL, "morph targets of colours and texture coordinates are not used");
    }
    return PELL_OK;

fail:
    pell_free(g->ctx, p->targets); /* a partial list would be taken for the whole */
    p->targets = NULL;
    return res;
}

enum pell_result gltf_morph_weights(struct gltf *g, const struct pell_json *mesh, const struct pell_json *node, size_t count,
                                    double **weights)
{
    const struct gltf_pose *pose = node && g->pose ? &g->pose[node->index] : NULL;
    const struct pell_json *owners[] = { mesh, node };
    bool any = false;
    double *w = NULL;
    enum pell_result res = PELL_OK;

    *weights = NULL;
    if (count == 0 && pose && pose->moved[GLTF_WEIGHTS])
        return pell_json_error(node, PELL_ERR_FORMAT, NULL, "an animation moves its weights, but its mesh has no morph targets");
    if (count == 0) {
        const struct pell_json list = pell_json_get(mesh, "weights");
        if (pell_json_count(&list) > 0 && gltf_once(g, GLTF_ONCE_WEIGHTLESS))
            gltf_warn(g, GLTF_WARN_PRIMITIVE, &list, NULL, "the mesh has weights, but no morph targets");
        return PELL_OK;
    }
    PELL_TRY(gltf_count_deformed(g, mesh, count));
    w = pell_calloc(g->ctx, count, sizeof(*w));
    if (!w)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < PELL_COUNT(owners); i++)
        if (owners[i]) {
            struct pell_json list;
            PELL_TRY(pell_json_array(owners[i], "weights", count, count, &list));
            for (size_t k = 0; k < pell_json_count(&list); k++) {
                const struct pell_json number = pell_json_at(&list, k);
                PELL_TRY(pell_json_to_number(&number, -1e6, 1e6, &w[k]));
            }
        }
    if (pose && pose->moved[GLTF_WEIGHTS])
        PELL_TRY(gltf_animated_weights(g, pose->weights, count, w));
    for (size_t i = 0; i < count; i++)
        any |= w[i] != 0.0;
    if (any) {
        *weights = w;
        return PELL_OK;
    }

fail:
    pell_free(g->ctx, w);
    return res;
}

/* out += weight x deltas, xyz each. `scratch` has room for 3 floats per vertex. */
static enum pell_result add(struct gltf *g, const struct pell_json *target, const char *key, int64_t index, double weight, uint32_t count,
                            float *scratch, float *out)
{
    const bool position = strcmp(key, "POSITION") == 0;
    const size_t size = strcmp(key, "TANGENT") == 0 ? 4 : 3;
    const struct pell_json at = pell_json_get(target, key);
    const struct gltf_accessor *a;
    const float w = (float) weight;
    enum pell_result res;
    size_t bad;

    PELL_TRY(gltf_attribute(g, target, key, index, 3, 3, count, &a));
    PELL_TRY(gltf_count_deformed(g, target, count));
    gltf_read_floats(a, !position && a->type != GLTF_F32, scratch);
    bad = gltf_first_not_finite(scratch, 3 * (size_t) count);
    if (bad < 3 * (size_t) count)
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "%s %zu has %c = %g, allowed: finite numbers", key, bad / 3, "xyz"[bad % 3],
                               (double) scratch[bad]);
    for (size_t i = 0; i < count; i++)
        for (size_t c = 0; c < 3; c++)
            out[size * i + c] += w * scratch[3 * i + c];
    return PELL_OK;

fail:
    return res;
}

enum pell_result gltf_morph(struct gltf *g, const struct pell_json *primitive, const struct gltf_primitive *p, const double *weights,
                            size_t count, struct pell_mesh *mesh)
{
    const struct pell_json targets = pell_json_get(primitive, "targets");
    float *scratch = pell_alloc_array(g->ctx, mesh->num_vertices, 3 * sizeof(*scratch));
    bool no_normal = false, no_tangent = false;
    enum pell_result res = PELL_OK;

    if (!scratch)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < count && res == PELL_OK; i++) {
        const struct pell_json at = pell_json_at(&targets, i);
        const struct gltf_target *t = &p->targets[i];
        if (weights[i] == 0.0)
            continue;
        if (pell_cancelled(g->ctx))
            res = PELL_ERR_CANCELLED;
        if (res == PELL_OK && t->position >= 0)
            res = add(g, &at, "POSITION", t->position, weights[i], mesh->num_vertices, scratch, mesh->position);
        if (res == PELL_OK && t->normal >= 0 && p->normal >= 0)
            res = add(g, &at, "NORMAL", t->normal, weights[i], mesh->num_vertices, scratch, mesh->normal);
        if (res == PELL_OK && t->tangent >= 0 && mesh->tangent)
            res = add(g, &at, "TANGENT", t->tangent, weights[i], mesh->num_vertices, scratch, mesh->tangent);
        no_normal |= t->position >= 0 && t->normal < 0 && p->normal >= 0;
        no_tangent |= t->position >= 0 && t->tangent < 0;
    }
    pell_free(g->ctx, scratch);
    if (res != PELL_OK)
        return res;
    if (no_normal) {
        if (gltf_once(g, GLTF_ONCE_MORPH_NORMALS)) {
            struct pell_text where;
            pell_info(g->ctx, pell_json_where(&targets, &where), "morph targets without normals: normals are recomputed");
        }
        memset(mesh->normal, 0, (size_t) mesh->num_vertices * 3 * sizeof(float));
    }
    if (no_normal || no_tangent) {
        pell_free(g->ctx, mesh->tangent);
        mesh->tangent = NULL;
    }
    return PELL_OK;
}
