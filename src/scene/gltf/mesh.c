/* SPDX-License-Identifier: MIT
 * mesh.c - primitives of glTF 2.0 (section 3.7.2 of the specification) as meshes of the scene: attributes, triangles of lists,
 * strips and fans, and their placement in the world.
 *
 * A mesh is read, morphed (morph.c), then transformed by its node, or by the joints of its skin (skin.c).
 *
 * A transform that mirrors reverses the order of each triangle's corners, so that all are counter-clockwise from outside, and the sign of
 * the bitangent. Where a primitive has no normals, pell_scene_complete makes them, smooth but for creases: the specification asks for
 * flat ones, which would cut a translucent surface into facets. */
#include "scene/gltf/gltf.h"
#include "scene/scene.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

enum { MODE_TRIANGLES = 4, MODE_STRIP = 5, MODE_FAN = 6 };

/* --- Parsing, once a mesh --------------------------------------------------------------------------------------------------- */

static enum pell_result parse_attributes(struct gltf *g, const struct pell_json *attributes, struct gltf_primitive *p)
{
    enum pell_result res;

    PELL_TRY(gltf_index(attributes, "POSITION", &g->accessors, &p->position));
    PELL_TRY(gltf_index(attributes, "NORMAL", &g->accessors, &p->normal));
    PELL_TRY(gltf_index(attributes, "TANGENT", &g->accessors, &p->tangent));
    PELL_TRY(gltf_index(attributes, "COLOR_0", &g->accessors, &p->color));
    for (int i = 0; i < PELL_UV_SETS; i++) {
        char key[16];
        snprintf(key, sizeof(key), "TEXCOORD_%d", i);
        PELL_TRY(gltf_index(attributes, key, &g->accessors, &p->uv[i]));
    }
    for (int i = 0; i < GLTF_JOINT_SETS; i++) {
        char joints[16], weights[16];
        snprintf(joints, sizeof(joints), "JOINTS_%d", i);
        snprintf(weights, sizeof(weights), "WEIGHTS_%d", i);
        PELL_TRY(gltf_index(attributes, joints, &g->accessors, &p->joints[i]));
        PELL_TRY(gltf_index(attributes, weights, &g->accessors, &p->weights[i]));
        if ((p->joints[i] < 0) != (p->weights[i] < 0))
            return pell_json_error(attributes, PELL_ERR_FORMAT, NULL, "has %s without %s", p->joints[i] < 0 ? weights : joints,
                                   p->joints[i] < 0 ? joints : weights);
    }
    if (pell_json_get(attributes, "JOINTS_2").value && gltf_once(g, GLTF_ONCE_JOINT_SETS))
        gltf_warn(g, GLTF_WARN_PRIMITIVE, attributes, NULL, "JOINTS_2 and later sets are not used: eight joints move a vertex");
    if (pell_json_get(attributes, "COLOR_1").value)
        gltf_warn(g, GLTF_WARN_PRIMITIVE, attributes, NULL, "COLOR_1 and later colour sets are not used");
    return PELL_OK;

fail:
    return res;
}

static enum pell_result parse_primitive(struct gltf *g, const struct pell_json *at, struct gltf_primitive *p, int64_t *targets)
{
    static const char *const skipped[] = { "points", "lines", "a line loop", "a line strip" };
    const struct pell_json mode_at = pell_json_get(at, "mode");
    struct pell_json attributes, extensions, draco;
    int64_t mode = MODE_TRIANGLES;
    enum pell_result res;

    *p = (struct gltf_primitive) { .position = -1,
                                   .normal = -1,
                                   .tangent = -1,
                                   .color = -1,
                                   .uv = { -1, -1, -1, -1 },
                                   .indices = -1,
                                   .material = -1,
                                   .joints = { -1, -1 },
                                   .weights = { -1, -1 },
                                   .targets = p->targets };
    PELL_TRY(pell_json_is_object(at));
    PELL_TRY(pell_json_require(at, "attributes"));
    PELL_TRY(pell_json_object(at, "attributes", &attributes));
    PELL_TRY(pell_json_int(at, "mode", 0, 6, &mode));
    PELL_TRY(gltf_index(at, "indices", &g->accessors, &p->indices));
    PELL_TRY(gltf_index(at, "material", &g->materials, &p->material));
    PELL_TRY(parse_attributes(g, &attributes, p));
    p->mode = (int) mode;
    if (mode < MODE_TRIANGLES) {
        gltf_warn(g, GLTF_WARN_PRIMITIVE, &mode_at, NULL, "the primitive is %s, which are not drawn", skipped[mode]);
        return PELL_OK;
    }
    if (p->position < 0) {
        gltf_warn(g, GLTF_WARN_PRIMITIVE, &attributes, NULL, "the primitive has no POSITION and is not drawn");
        return PELL_OK;
    }
    PELL_TRY(gltf_extension(at, "KHR_draco_mesh_compression", &extensions, &draco));
    if (draco.value) {
        const struct pell_json position = pell_json_at(&g->accessors, (size_t) p->position);
        if (!pell_json_get(&position, "bufferView").value && !pell_json_get(&position, "sparse").value)
            return pell_json_error(&draco, PELL_ERR_UNSUPPORTED, gltf_fix("KHR_draco_mesh_compression"),
                                   "the geometry is compressed with KHR_draco_mesh_compression, which is not read");
        if (gltf_once(g, GLTF_ONCE_DRACO))
            gltf_warn(g, GLTF_WARN_EXTENSION, &draco, NULL, "KHR_draco_mesh_compression is not read: the uncompressed copy is used");
    }
    PELL_TRY(gltf_parse_targets(g, at, p, targets));
    p->drawn = true;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result parse_mesh(struct gltf *g, const struct pell_json *at, struct gltf_mesh *mesh)
{
    struct pell_json primitives;
    int64_t targets = -1;
    enum pell_result res;
    size_t count;

    PELL_TRY(pell_json_is_object(at));
    PELL_TRY(pell_json_require(at, "primitives"));
    PELL_TRY(pell_json_array(at, "primitives", 1, (size_t) g->limits->items, &primitives));
    count = pell_json_count(&primitives);
    if (!mesh->primitives) {
        mesh->primitives = pell_calloc(g->ctx, count, sizeof(*mesh->primitives));
        if (!mesh->primitives)
            return PELL_ERR_NOMEM;
    }
    for (size_t i = 0; i < count; i++) {
        const struct pell_json primitive = pell_json_at(&primitives, i);
        mesh->num_primitives = i + 1; /* counted before it owns anything */
        PELL_TRY(parse_primitive(g, &primitive, &mesh->primitives[i], &targets));
    }
    mesh->num_primitives = count;
    mesh->num_targets = targets > 0 ? (size_t) targets : 0;
    mesh->ready = true;
    return PELL_OK;

fail:
    return res;
}

/* --- Vertices --------------------------------------------------------------------------------------------------------------- */

static enum pell_result attribute(struct gltf *g, const struct pell_json *primitive, const char *key, int64_t index, int min, int max,
                                  uint32_t count, const struct gltf_accessor **out)
{
    const struct pell_json attributes = pell_json_get(primitive, "attributes");
    return gltf_attribute(g, &attributes, key, index, min, max, count, out);
}

static void transform_positions(const struct pell_mat4 *matrix, float *p, size_t count)
{
    for (size_t i = 0; i < count; i++, p += 3)
        vec3_store(mat4_point(matrix, vec3_load(p)), p);
}

/* Checks that positions are finite as read and after the transform. */
static enum pell_result check_positions(const struct pell_json *at, const struct pell_mesh *mesh)
{
    const size_t n = 3 * (size_t) mesh->num_vertices, bad = gltf_first_not_finite(mesh->position, n);
    if (bad < n)
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "POSITION %zu has %c = %g, allowed: finite numbers", bad / 3, "xyz"[bad % 3],
                               (double) mesh -> position[bad]);
    return PELL_OK;
}

static enum pell_result read_tangents(struct gltf *g, const struct pell_json *at, const struct gltf_primitive *p, struct pell_mesh *mesh)
{
    const struct gltf_accessor *a;
    enum pell_result res;

    PELL_TRY(attribute(g, at, "TANGENT", p->tangent, 4, 4, mesh->num_vertices, &a));
    mesh->tangent = pell_alloc_array(g->ctx, mesh->num_vertices, 4 * sizeof(float));
    if (!mesh->tangent)
        return PELL_ERR_NOMEM;
    gltf_read_floats(a, true, mesh->tangent);
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_uvs(struct gltf *g, const struct pell_json *at, const struct gltf_primitive *p, struct pell_mesh *mesh)
{
    enum pell_result res;

    for (int i = 0; i < PELL_UV_SETS; i++) {
        const size_t n = 2 * (size_t) mesh->num_vertices;
        const struct gltf_accessor *a;
        char key[16];
        size_t bad;

        if (p->uv[i] < 0)
            continue;
        snprintf(key, sizeof(key), "TEXCOORD_%d", i);
        PELL_TRY(attribute(g, at, key, p->uv[i], 2, 2, mesh->num_vertices, &a));
        mesh->uv[i] = pell_alloc_array(g->ctx, n, sizeof(float));
        if (!mesh->uv[i])
            return PELL_ERR_NOMEM;
        gltf_read_floats(a, false, mesh->uv[i]);
        bad = gltf_first_not_finite(mesh->uv[i], n);
        if (bad == n)
            continue;
        gltf_warn(g, GLTF_WARN_VALUE, at, NULL, "%s %zu is not finite: such coordinates are taken as 0", key, bad / 2);
        for (; bad < n; bad++)
            if (!isfinite(mesh->uv[i][bad]))
                mesh->uv[i][bad] = 0.0f;
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_colors(struct gltf *g, const struct pell_json *at, const struct gltf_primitive *p, struct pell_mesh *mesh)
{
    const size_t n = mesh->num_vertices;
    const struct gltf_accessor *a;
    enum pell_result res;
    size_t bad = 0;

    PELL_TRY(attribute(g, at, "COLOR_0", p->color, 3, 4, mesh->num_vertices, &a));
    mesh->color = pell_alloc_array(g->ctx, n, 4 * sizeof(float));
    if (!mesh->color)
        return PELL_ERR_NOMEM;
    gltf_read_floats(a, true, mesh->color);
    /* three components to four, from the back so that nothing is overwritten before it is read */
    for (size_t i = n; a->components == 3 && i-- > 0;) {
        memmove(mesh->color + 4 * i, mesh->color + 3 * i, 3 * sizeof(float));
        mesh->color[4 * i + 3] = 1.0f;
    }
    for (size_t i = 0; i < 4 * n; i++) {
        const float c = mesh->color[i];
        if (!(c >= 0.0f && c <= 1e6f)) {
            bad++;
            mesh->color[i] = c > 1e6f && isfinite(c) ? 1e6f : 0.0f;
        }
    }
    if (bad)
        gltf_warn(g, GLTF_WARN_VALUE, at, NULL, "%s taken as 0",
                  pell_counted((long long) bad, "value of COLOR_0 is negative or not finite and is",
                               "values of COLOR_0 are negative or not finite and are")
                      .str);
    return PELL_OK;

fail:
    return res;
}

/* --- Triangles -------------------------------------------------------------------------------------------------------------- */

/* Triangulates a strip or fan, without triangles that repeat a corner, which only join strips. Writes to `out`, unless NULL. */
static uint32_t expand(int mode, const uint32_t *corner, uint32_t count, uint32_t *out)
{
    uint32_t triangles = 0;

    for (uint32_t i = 0; i + 2 < count; i++) {
        /* p_i = { v_i, v_(i + 1 + i % 2), v_(i + 2 - i % 2) }, and for fans { v_(i+1), v_(i+2), v_0 }: section 3.7.2.1 */
        const uint32_t a = mode == MODE_FAN ? i + 1 : i, b = mode == MODE_FAN ? i + 2 : i + 1 + i % 2,
                       c = mode == MODE_FAN ? 0 : i + 2 - i % 2;
        const uint32_t u = corner ? corner[a] : a, v = corner ? corner[b] : b, w = corner ? corner[c] : c;
        if (u == v || v == w || w == u)
            continue;
        if (out) {
            out[3 * (size_t) triangles] = u;
            out[3 * (size_t) triangles + 1] = v;
            out[3 * (size_t) triangles + 2] = w;
        }
        triangles++;
    }
    return triangles;
}

static enum pell_result check_indices(const struct pell_json *at, const uint32_t *index, size_t count, uint32_t vertices)
{
    const struct pell_json indices = pell_json_get(at, "indices");
    uint32_t largest = 0;
    size_t i = 0;

    for (size_t k = 0; k < count; k++)
        largest = index[k] > largest ? index[k] : largest;
    if (largest < vertices)
        return PELL_OK;
    while (index[i] < vertices)
        i++;
    return pell_json_error(&indices, PELL_ERR_FORMAT, NULL, "index %zu is %" PRIu32 ", allowed: [0, %" PRIu32 "]", i, index[i],
                           vertices - 1);
}

/* --- Placing ---------------------------------------------------------------------------------------------------------------- */

/* What is known before the mesh is allocated. `corner` is the decoded strip or fan, NULL for lists. */
struct shape {
    const struct gltf_accessor *position, *indices;
    uint32_t *corner;
    uint32_t count, triangles; /* corners, triangles */
};

static enum pell_result read_shape(struct gltf *g, const struct pell_json *at, const struct gltf_primitive *p, struct shape *s)
{
    const struct pell_json attributes = pell_json_get(at, "attributes"), position = pell_json_get(&attributes, "POSITION");
    const struct pell_json indices = pell_json_get(at, "indices");
    enum pell_result res;

    PELL_TRY(gltf_accessor(g, p->position, &s->position));
    PELL_TRY(attribute(g, at, "POSITION", p->position, 3, 3, s->position->count, &s->position));
    if (!s->position->data && !s->position->sparse_count)
        return pell_json_error(&position, PELL_ERR_FORMAT, NULL,
                               "accessor %" PRId64 " has neither bufferView nor sparse: all points are the same", p->position);
    s->count = s->position->count;
    if (p->indices >= 0) {
        PELL_TRY(gltf_accessor(g, p->indices, &s->indices));
        if (s->indices->components != 1 || (s->indices->type != GLTF_U8 && s->indices->type != GLTF_U16 && s->indices->type != GLTF_U32))
            return pell_json_error(&indices, PELL_ERR_FORMAT, NULL,
                                   "accessor %" PRId64 " has %d components of type %d, allowed: SCALAR of 5121, 5123, 5125", p->indices,
                                   s->indices->components, s->indices->type);
        s->count = s->indices->count;
    }
    s->triangles = s->count / 3;
    if (p->mode != MODE_TRIANGLES) {
        if (s->indices) {
            s->corner = pell_alloc_array(g->ctx, s->count, sizeof(*s->corner));
            if (!s->corner)
                return PELL_ERR_NOMEM;
            gltf_read_indices(s->indices, s->corner);
            PELL_TRY(check_indices(at, s->corner, s->count, s->position->count));
        }
        s->triangles = expand(p->mode, s->corner, s->count, NULL);
    } else if (s->count % 3 && s->triangles) {
        gltf_warn(g, GLTF_WARN_PRIMITIVE, at, NULL, "%s no whole number of triangles: the last %s left out",
                  pell_counted(s->count, "corner is", "corners are").str, s->count % 3 == 1 ? "is" : "2 are");
    }
    return PELL_OK;

fail:
    return res;
}

/* Checks for cancellation between the arrays of a large mesh. */
static enum pell_result check_cancelled(const struct gltf *g)
{
    return pell_cancelled(g->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

static enum pell_result fill_indices(struct gltf *g, const struct pell_json *at, const struct gltf_primitive *p, const struct shape *s,
                                     struct pell_mesh *mesh)
{
    enum pell_result res;

    if (p->mode != MODE_TRIANGLES) {
        expand(p->mode, s->corner, s->count, mesh->index);
    } else if (s->indices && s->count % 3 == 0) {
        gltf_read_indices(s->indices, mesh->index);
        PELL_TRY(check_indices(at, mesh->index, s->count, mesh->num_vertices));
    } else if (s->indices) {
        uint32_t *all = pell_alloc_array(g->ctx, s->count, sizeof(*all));
        if (!all)
            return PELL_ERR_NOMEM;
        gltf_read_indices(s->indices, all);
        res = check_indices(at, all, s->count, mesh->num_vertices);
        memcpy(mesh->index, all, 3 * (size_t) mesh->num_triangles * sizeof(*all));
        pell_free(g->ctx, all);
        PELL_TRY(res);
    } else {
        for (uint32_t i = 0; i < 3 * mesh->num_triangles; i++)
            mesh->index[i] = i;
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_normals(struct gltf *g, const struct pell_json *at, const struct gltf_primitive *p, struct pell_mesh *mesh)
{
    const struct gltf_accessor *a;
    enum pell_result res;

    if (p->normal < 0) {
        if (gltf_once(g, GLTF_ONCE_NO_NORMALS)) {
            struct pell_text where;
            pell_info(g->ctx, pell_json_where(at, &where),
                      "no normals: they are computed, smooth but for creases (glTF specifies flat ones)");
        }
        return PELL_OK;
    }
    PELL_TRY(attribute(g, at, "NORMAL", p->normal, 3, 3, mesh->num_vertices, &a));
    gltf_read_floats(a, true, mesh->normal);
    return PELL_OK;

fail:
    return res;
}

/* Warns of UV sets that a material's maps need and the mesh lacks. */
static void check_uv_sets(struct gltf *g, const struct pell_json *at, const struct pell_mesh *mesh)
{
    const struct pell_material *m = &g->scene->materials[mesh->material];
    const int uv = pell_scene_missing_uv(mesh, m);

    if (uv >= 0)
        gltf_warn(g, GLTF_WARN_PRIMITIVE, at, NULL, "material \"%s\" has a texture on TEXCOORD_%d, which the primitive lacks", m->name, uv);
}

/* Transforms a mesh from its node's space to the world; `world` NULL: it is in world space. */
static void transform_mesh(const struct pell_mat4 *world, struct pell_mesh *mesh)
{
    const bool mirrored = world && mat4_determinant3(world) < 0.0;

    if (world)
        transform_positions(world, mesh->position, mesh->num_vertices);
    for (size_t i = 0; mirrored && i < mesh->num_triangles; i++) {
        const uint32_t b = mesh->index[3 * i + 1];
        mesh->index[3 * i + 1] = mesh->index[3 * i + 2];
        mesh->index[3 * i + 2] = b;
    }
    for (size_t i = 0; mirrored && mesh->tangent && i < mesh->num_vertices; i++)
        mesh->tangent[4 * i + 3] = -mesh->tangent[4 * i + 3];
}

/* Transforms and normalises vectors; if some have no direction the array is dropped, to be recomputed. */
static void transform_vectors(struct gltf *g, const struct pell_json *at, const struct pell_mat4 *world, bool normals,
                              struct pell_mesh *mesh)
{
    size_t bad = 0;

    if (normals)
        bad = gltf_transform_vectors(world, true, mesh->normal, mesh->num_vertices, 3);
    if (bad)
        gltf_warn(g, GLTF_WARN_VALUE, at, NULL, "of %s %s zero or not finite: made anew",
                  pell_counted(mesh->num_vertices, "normal", "normals").str, pell_counted((long long) bad, "is", "are").str);
    if (!mesh->tangent)
        return;
    bad = gltf_transform_vectors(world, false, mesh->tangent, mesh->num_vertices, 4);
    if (bad) {
        gltf_warn(g, GLTF_WARN_VALUE, at, NULL, "%s zero or not finite: all tangents are made anew",
                  pell_counted((long long) bad, "tangent is", "tangents are").str);
        pell_free(g->ctx, mesh->tangent);
        mesh->tangent = NULL;
    }
}

static bool any_normal(const struct pell_mesh *mesh)
{
    for (size_t i = 0; i < 3 * (size_t) mesh->num_vertices; i++)
        if (mesh->normal[i] != 0.0f)
            return true;
    return false;
}

/* Reads, morphs and transforms the vertices. */
static enum pell_result fill_vertices(struct gltf *g, const struct pell_json *at, const struct gltf_primitive *p, const struct shape *shape,
                                      const struct gltf_placement *placement, const double *weights, size_t targets, struct pell_mesh *mesh)
{
    const struct pell_mat4 identity = mat4_identity();
    const struct pell_mat4 *world = placement->skin || memcmp(placement->world, &identity, sizeof(identity)) == 0 ? NULL : placement->world;
    enum pell_result res;

    gltf_read_floats(shape->position, false, mesh->position);
    PELL_TRY(check_positions(at, mesh));
    PELL_TRY(check_cancelled(g));
    PELL_TRY(read_normals(g, at, p, mesh));
    PELL_TRY(read_uvs(g, at, p, mesh));
    /* "when normals are not specified, the provided tangents (if present) must be ignored" */
    if (p->tangent >= 0 && p->normal >= 0)
        PELL_TRY(read_tangents(g, at, p, mesh));
    for (size_t i = 0; mesh->tangent && i < mesh->num_vertices; i++)
        mesh->tangent[4 * i + 3] = mesh->tangent[4 * i + 3] < 0.0f ? -1.0f : 1.0f;
    if (p->color >= 0)
        PELL_TRY(read_colors(g, at, p, mesh));
    PELL_TRY(check_cancelled(g));
    if (weights)
        PELL_TRY(gltf_morph(g, at, p, weights, targets, mesh));
    if (placement->skin)
        PELL_TRY(gltf_skin_mesh(g, at, p, placement->skin, mesh));
    else
        transform_mesh(world, mesh);
    PELL_TRY(check_cancelled(g));
    PELL_TRY(check_positions(at, mesh));
    transform_vectors(g, at, world, p->normal >= 0 && (!weights || any_normal(mesh)), mesh);
    return PELL_OK;

fail:
    return res;
}

static enum pell_result place_primitive(struct gltf *g, const struct pell_json *at, const struct gltf_primitive *p, const char *name,
                                        const struct gltf_placement *placement, const double *weights, size_t targets)
{
    struct shape shape = { 0 };
    struct pell_mesh *mesh;
    int material = -1;
    enum pell_result res;
    size_t index;

    if (pell_cancelled(g->ctx))
        return PELL_ERR_CANCELLED;
    PELL_TRY(read_shape(g, at, p, &shape));
    if (shape.triangles == 0) {
        gltf_warn(g, GLTF_WARN_PRIMITIVE, at, NULL, "the primitive has no triangle");
        goto fail;
    }
    if (p->material >= 0)
        PELL_TRY(gltf_material(g, p->material, &material));

    PELL_TRY(pell_scene_add_mesh(g->scene, name, &index));
    PELL_TRY(pell_mesh_allocate(g->scene, index, shape.position->count, shape.triangles));
    mesh = &g->scene->meshes[index];
    mesh->object = g->next_object;
    mesh->material = material;
    PELL_TRY(fill_indices(g, at, p, &shape, mesh));
    PELL_TRY(check_cancelled(g));
    PELL_TRY(fill_vertices(g, at, p, &shape, placement, weights, targets, mesh));
    if (material >= 0)
        check_uv_sets(g, at, mesh);

fail:
    pell_free(g->ctx, shape.corner);
    return res;
}

enum pell_result gltf_place_mesh(struct gltf *g, int64_t index, const char *name, const struct gltf_placement *placement)
{
    struct gltf_mesh *mesh = &g->mesh[index];
    const struct pell_json at = pell_json_at(&g->meshes, (size_t) index), primitives = pell_json_get(&at, "primitives");
    double *weights = NULL;
    char buffer[128];
    enum pell_result res;

    if (!mesh->ready)
        PELL_TRY(parse_mesh(g, &at, mesh));
    PELL_TRY(gltf_morph_weights(g, &at, placement->node, mesh->num_targets, &weights));
    if (!name)
        name = gltf_name(&at, "mesh", buffer, sizeof(buffer));
    for (size_t i = 0; i < mesh->num_primitives; i++) {
        const struct pell_json primitive = pell_json_at(&primitives, i);
        if (mesh->primitives[i].drawn)
            PELL_TRY(place_primitive(g, &primitive, &mesh->primitives[i], name, placement, weights, mesh->num_targets));
    }
    g->next_object++;

fail:
    pell_free(g->ctx, weights);
    return res;
}
