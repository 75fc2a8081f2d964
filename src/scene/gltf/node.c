/* SPDX-License-Identifier: MIT
 * node.c - the node hierarchy of glTF 2.0 (section 3.5 of the specification), instances, cameras (3.10) and KHR_lights_punctual.
 *
 * Nodes form strict trees: a node with two parents, a cycle, or a scene that names a node twice is refused, so traversal can't multiply a
 * file's size. The traversal has its own stack.
 *
 * KHR_lights_punctual is photometric (candela, lux). Its values are interpreted as radiometric, W/sr and W/m^2, as most renderers do: a
 * scene without physical exposure looks the same either way, and a luminous efficacy would have to be invented. */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <string.h>

/* --- The tree --------------------------------------------------------------------------------------------------------------- */

/* Fills in the parents and refuses second ones and cycles. `mark` has room for one number per node. */
static enum pell_result find_parents(struct gltf *g, size_t count, int32_t *mark)
{
    enum pell_result res;

    for (size_t i = 0; i < count; i++)
        g->node[i].parent = -1;
    for (size_t i = 0; i < count; i++) {
        const struct pell_json node = pell_json_at(&g->nodes, i);
        struct pell_json children;
        PELL_TRY(pell_json_is_object(&node));
        PELL_TRY(pell_json_array(&node, "children", 0, count, &children));
        for (size_t k = 0; k < pell_json_count(&children); k++) {
            const struct pell_json at = pell_json_at(&children, k);
            int64_t child;
            PELL_TRY(pell_json_to_int(&at, 0, (int64_t) count - 1, &child));
            if (g->node[child].parent >= 0)
                return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                                       "node %" PRId64 " is a child of node %" PRId32 " already, allowed: one parent", child,
                                       g->node[child].parent);
            g->node[child].parent = (int32_t) i;
        }
    }
    /* With one parent each, walking up from a node ends at a root or returns to a node of the same walk. */
    memset(mark, 0, count * sizeof(*mark));
    for (size_t i = 0; i < count; i++) {
        const int32_t walk = (int32_t) i + 1;
        int32_t n = (int32_t) i;
        while (n >= 0 && mark[n] == 0) {
            mark[n] = walk;
            n = g->node[n].parent;
        }
        if (n >= 0 && mark[n] == walk) {
            const struct pell_json node = pell_json_at(&g->nodes, (size_t) n);
            return pell_json_error(&node, PELL_ERR_FORMAT, NULL, "the node is its own ancestor, allowed: trees without cycles");
        }
    }
    return PELL_OK;

fail:
    return res;
}

/* --- Cameras and lights ----------------------------------------------------------------------------------------------------- */

/* A unit vector along a column of the matrix, or the fallback if that column is zero. */
static struct pell_vec3 axis(const struct pell_mat4 *world, int column, float sign, struct pell_vec3 fallback)
{
    const double *c = world->m + 4 * column, l = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
    if (!(l > 0.0) || !isfinite(l))
        return fallback;
    return vec3((float) (sign * c[0] / l), (float) (sign * c[1] / l), (float) (sign * c[2] / l));
}

/* Cameras and lights look along -z of their node with +y up. False if the position exceeds the range of floats. */
static bool view_frame(const struct pell_mat4 *world, float *position, float *forward, float *up)
{
    const struct pell_vec3 f = axis(world, 2, -1.0f, vec3(0, 0, -1)), y = axis(world, 1, 1.0f, vec3(0, 1, 0));
    struct pell_vec3 t, b, u = vec3_mad(y, -vec3_dot(y, f), f);

    vec3_basis(f, &t, &b);
    u = vec3_length(u) > 1e-4f ? vec3_normalize(u) : b;
    vec3_store(f, forward);
    vec3_store(u, up);
    for (int c = 0; c < 3; c++)
        position[c] = (float) world->m[12 + c];
    return isfinite(position[0]) && isfinite(position[1]) && isfinite(position[2]);
}

static enum pell_result out_of_range(const struct pell_json *node)
{
    return pell_json_error(node, PELL_ERR_FORMAT, NULL, "the node's position is out of the range of floats");
}

static enum pell_result add_camera(struct gltf *g, const struct pell_json *node, int64_t camera, const struct pell_mat4 *world)
{
    static const char *const types[] = { "perspective", "orthographic" };
    const struct pell_json at = pell_json_at(&g->cameras, (size_t) camera);
    struct pell_json projection;
    struct pell_camera *c;
    double value = 0.0;
    char name[128];
    int type = 0;
    size_t index;
    enum pell_result res;

    PELL_TRY(pell_json_is_object(&at));
    PELL_TRY(pell_json_require(&at, "type"));
    PELL_TRY(pell_json_choice(&at, "type", types, 2, &type));
    PELL_TRY(pell_json_require(&at, types[type]));
    PELL_TRY(pell_json_object(&at, types[type], &projection));
    PELL_TRY(pell_json_require(&projection, type ? "ymag" : "yfov"));
    if (type)
        PELL_TRY(pell_json_number(&projection, "ymag", 1e-9, 1e9, &value));
    else
        PELL_TRY(pell_json_number(&projection, "yfov", 1e-4, 3.14, &value));

    /* a camera is chosen by name: its own, else its node's */
    PELL_TRY(pell_scene_add_camera(g->scene,
                                   pell_json_get(&at, "name").value ? gltf_name(&at, "camera", name, sizeof(name))
                                                                    : gltf_name(node, "camera node", name, sizeof(name)),
                                   &index));
    c = &g->scene->cameras[index];
    if (!view_frame(world, c->position, c->forward, c->up))
        return out_of_range(node);
    c->fov = type ? 0.0f : (float) value;
    c->ortho_height = type ? (float) (2.0 * value) : 0.0f;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result add_light(struct gltf *g, const struct pell_json *node, int64_t light, const struct pell_mat4 *world)
{
    static const char *const types[] = { "point", "spot", "directional" };
    static const enum pell_light_type ours[] = { PELL_LIGHT_POINT, PELL_LIGHT_SPOT, PELL_LIGHT_DIRECTIONAL };
    const struct pell_json at = pell_json_at(&g->lights, (size_t) light);
    float color[3] = { 1, 1, 1 }, intensity = 1.0f, range = 0.0f;
    double inner = 0.0, outer = PELL_PI / 4.0;
    struct pell_json spot;
    struct pell_light *l;
    char name[128];
    int type = 0;
    size_t index;
    enum pell_result res;

    PELL_TRY(pell_json_is_object(&at));
    PELL_TRY(pell_json_require(&at, "type"));
    PELL_TRY(pell_json_choice(&at, "type", types, PELL_COUNT(types), &type));
    PELL_TRY(pell_json_floats(&at, "color", 3, 0.0, 1e6, color));
    PELL_TRY(pell_json_float(&at, "intensity", 0.0, 1e12, &intensity));
    PELL_TRY(pell_json_float(&at, "range", 0.0, 1e12, &range));
    PELL_TRY(pell_json_object(&at, "spot", &spot));
    if (type == 1 && spot.value) {
        PELL_TRY(pell_json_number(&spot, "outerConeAngle", 1e-6, PELL_PI / 2.0 + 1e-4, &outer));
        PELL_TRY(pell_json_number(&spot, "innerConeAngle", 0.0, PELL_PI / 2.0 + 1e-4, &inner));
        if (inner > outer) {
            gltf_warn(g, GLTF_WARN_VALUE, &spot, NULL, "innerConeAngle %g is wider than outerConeAngle %g and is cut to it", inner, outer);
            inner = outer;
        }
    }
    PELL_TRY(pell_scene_add_light(g->scene, gltf_name(&at, "light", name, sizeof(name)), &index));
    l = &g->scene->lights[index];
    l->type = ours[type];
    if (!view_frame(world, l->position, l->direction, l->up))
        return out_of_range(node);
    for (int c = 0; c < 3; c++)
        l->power[c] = color[c] * intensity;
    if (type == 1) {
        l->cos_outer = (float) fmax(cos(outer), 0.0);
        l->cos_inner = (float) fmax(cos(inner), cos(outer));
    }
    l->range = type == 2 ? 0.0f : range;
    return PELL_OK;

fail:
    return res;
}

/* --- Nodes ------------------------------------------------------------------------------------------------------------------ */

static enum pell_result visit(struct gltf *g, const struct pell_json *at)
{
    if (++g->visits > g->limits->nodes)
        return pell_json_error(at, PELL_ERR_UNSUPPORTED, PELL_RAISE_LIMIT("nodes"), "more than %d nodes and instances are drawn",
                               g->limits->nodes);
    return PELL_OK;
}

/* One attribute of EXT_mesh_gpu_instancing as floats, owned by the caller; NULL if absent. *count 0: not known yet. */
static enum pell_result instance_attribute(struct gltf *g, const struct pell_json *attributes, const char *key, int components,
                                           uint32_t *count, float **out)
{
    const struct pell_json at = pell_json_get(attributes, key);
    const struct gltf_accessor *a;
    int64_t index = -1;
    enum pell_result res;

    PELL_TRY(gltf_index(attributes, key, &g->accessors, &index));
    if (index < 0)
        return PELL_OK;
    PELL_TRY(gltf_accessor(g, index, &a));
    if (a->components != components || (*count && a->count != *count))
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                               "accessor %" PRId64 " has %" PRIu32 " elements of %d components, allowed: as many as its fellows, of %d",
                               index, a->count, a->components, components);
    if ((int64_t) a->count > g->limits->nodes)
        return pell_json_error(&at, PELL_ERR_UNSUPPORTED, PELL_RAISE_LIMIT("nodes"), "%" PRIu32 " instances; %d are allowed", a->count,
                               g->limits->nodes);
    *count = a->count;
    *out = pell_alloc_array(g->ctx, a->count, (size_t) components * sizeof(float));
    if (!*out)
        return PELL_ERR_NOMEM;
    gltf_read_floats(a, a->type != GLTF_F32, *out);
    for (size_t i = 0; i < (size_t) a->count * (size_t) components; i++)
        if (!isfinite((*out)[i]))
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "element %zu is not a finite number", i / (size_t) components);
    return PELL_OK;

fail:
    return res;
}

static enum pell_result place_instances(struct gltf *g, const struct pell_json *node, const struct pell_json *instancing, int64_t mesh,
                                        const char *name, const struct pell_mat4 *world)
{
    float *t = NULL, *r = NULL, *s = NULL;
    struct pell_json attributes;
    uint32_t count = 0;
    enum pell_result res;

    PELL_TRY(pell_json_require(instancing, "attributes"));
    PELL_TRY(pell_json_object(instancing, "attributes", &attributes));
    PELL_TRY(instance_attribute(g, &attributes, "TRANSLATION", 3, &count, &t));
    PELL_TRY(instance_attribute(g, &attributes, "ROTATION", 4, &count, &r));
    PELL_TRY(instance_attribute(g, &attributes, "SCALE", 3, &count, &s));
    for (size_t i = 0; i < count; i++) {
        const double it[3] = { t ? t[3 * i] : 0.0, t ? t[3 * i + 1] : 0.0, t ? t[3 * i + 2] : 0.0 };
        const double is[3] = { s ? s[3 * i] : 1.0, s ? s[3 * i + 1] : 1.0, s ? s[3 * i + 2] : 1.0 };
        double q[4] = { r ? r[4 * i] : 0.0, r ? r[4 * i + 1] : 0.0, r ? r[4 * i + 2] : 0.0, r ? r[4 * i + 3] : 1.0 }, length;
        struct pell_mat4 local, placed;
        if (!gltf_normalize_quaternion(q, &length)) {
            res = pell_json_error(&attributes, PELL_ERR_FORMAT, NULL, "ROTATION %zu has length %g, allowed: 1", i, length);
            goto fail;
        }
        local = gltf_compose(it, q, is);
        placed = mat4_mul(world, &local);
        PELL_TRY(visit(g, node));
        if (gltf_has_area(&placed))
            PELL_TRY(gltf_place_mesh(g, mesh, name, &(struct gltf_placement) { .node = node, .world = &placed }));
    }

fail:
    pell_free(g->ctx, t);
    pell_free(g->ctx, r);
    pell_free(g->ctx, s);
    return res;
}

/* A mesh is left out because nothing remains of it: names the topmost node to blame, of a skin above its first joint. */
static enum pell_result leave_out(struct gltf *g, const struct pell_json *node, const struct gltf_skin *skin)
{
    const int32_t own = (int32_t) node->index;
    int32_t at = skin ? skin->first_joint : own;
    struct pell_json blamed;
    char name[128];

    if (gltf_has_area(&g->node[at].world)) /* the inverse matrices of a skin */
        at = own;
    else
        while (g->node[at].parent >= 0 && !gltf_has_area(&g->node[g->node[at].parent].world))
            at = g->node[at].parent;
    blamed = pell_json_at(&g->nodes, (size_t) at);
    if (!g->scene->vanished && !(g->scene->vanished = pell_strdup(g->ctx, gltf_name(&blamed, "node", name, sizeof(name)))))
        return PELL_ERR_NOMEM;
    if (!gltf_once(g, GLTF_ONCE_NO_AREA))
        return PELL_OK;
    if (at == own)
        gltf_warn(g, GLTF_WARN_NODE, &blamed, NULL, "the node's scale is 0: its mesh is left out");
    else
        gltf_warn(g, GLTF_WARN_NODE, &blamed, NULL, "the node's scale is 0: the mesh of node %" PRId32 ", which moves with it, is left out",
                  own);
    return PELL_OK;
}

/* Reads the contents of one node. */
static enum pell_result read_node(struct gltf *g, const struct pell_json *node, const struct pell_mat4 *world)
{
    struct pell_json extensions, light_at, instancing;
    int64_t mesh = -1, camera = -1, light = -1, skin = -1;
    struct gltf_placement placement = { .node = node, .world = world };
    char buffer[128];
    const char *name = pell_json_get(node, "name").value ? gltf_name(node, "node", buffer, sizeof(buffer)) : NULL;
    enum pell_result res;

    PELL_TRY(gltf_index(node, "mesh", &g->meshes, &mesh));
    PELL_TRY(gltf_index(node, "camera", &g->cameras, &camera));
    PELL_TRY(gltf_extension(node, "KHR_lights_punctual", &extensions, &light_at));
    if (light_at.value) {
        PELL_TRY(pell_json_require(&light_at, "light"));
        PELL_TRY(gltf_index(&light_at, "light", &g->lights, &light));
    }
    if (mesh >= 0) {
        PELL_TRY(gltf_extension(node, "EXT_mesh_gpu_instancing", &extensions, &instancing));
        PELL_TRY(gltf_index(node, "skin", &g->skins, &skin));
        if (skin >= 0)
            PELL_TRY(gltf_skin(g, skin, &placement.skin));
        if (skin >= 0 && instancing.value && gltf_once(g, GLTF_ONCE_SKIN_INSTANCES))
            gltf_warn(g, GLTF_WARN_NODE, node, NULL, "the node has a skin and instances: it is drawn once, where its joints are");
        if (skin < 0 && instancing.value)
            PELL_TRY(place_instances(g, node, &instancing, mesh, name, world));
        else if (skin >= 0 ? !placement.skin->singular : gltf_has_area(world))
            PELL_TRY(gltf_place_mesh(g, mesh, name, &placement));
        else
            PELL_TRY(leave_out(g, node, placement.skin));
    }
    if (camera >= 0)
        PELL_TRY(add_camera(g, node, camera, world));
    if (light >= 0)
        PELL_TRY(add_light(g, node, light, world));
    return PELL_OK;

fail:
    return res;
}

/* One level of the traversal. */
struct level {
    int64_t node;
    size_t next; /* child to visit next */
};

struct tree {
    int32_t *seen; /* the last traversal that reached a node */
    int32_t walk;  /* counts from 1 */
    struct level *stack;
};

/* Enters a node; *enter is false if it is invisible (KHR_node_visibility). */
static enum pell_result enter_node(struct gltf *g, const struct pell_json *node, struct tree *tree, struct level *level, bool *enter)
{
    struct pell_json extensions, visibility;
    const struct pell_mat4 *world;
    enum pell_result res;

    if (tree->seen[level->node] == tree->walk)
        return pell_json_error(node, PELL_ERR_FORMAT, NULL, "the scene reaches node %" PRId64 " twice, allowed: once", level->node);
    tree->seen[level->node] = tree->walk;
    PELL_TRY(gltf_extension(node, "KHR_node_visibility", &extensions, &visibility));
    *enter = true;
    if (visibility.value)
        PELL_TRY(pell_json_bool(&visibility, "visible", enter));
    if (!*enter)
        return PELL_OK;
    PELL_TRY(visit(g, node));
    PELL_TRY(gltf_node_world(g, level->node, &world));
    level->next = 0;
    return read_node(g, node, world);

fail:
    return res;
}

/* Depth first, children in order. `stack` has room for limits.depth levels. */
static enum pell_result walk(struct gltf *g, int64_t root, struct tree *tree)
{
    struct level *stack = tree->stack;
    int depth = 0;
    bool enter;
    enum pell_result res;
    struct pell_json node = pell_json_at(&g->nodes, (size_t) root);

    stack[0].node = root;
    PELL_TRY(enter_node(g, &node, tree, &stack[0], &enter));
    if (!enter)
        return PELL_OK;
    while (depth >= 0) {
        struct level *level = &stack[depth];
        struct pell_json children, child_at, child;
        node = pell_json_at(&g->nodes, (size_t) level->node);
        children = pell_json_get(&node, "children");
        if (level->next >= pell_json_count(&children)) {
            depth--;
            continue;
        }
        if (depth + 1 >= g->limits->depth)
            return pell_json_error(&node, PELL_ERR_UNSUPPORTED, PELL_RAISE_LIMIT("depth"), "nodes are nested deeper than %d levels",
                                   g->limits->depth);
        child_at = pell_json_at(&children, level->next++);
        PELL_TRY(pell_json_to_int(&child_at, 0, (int64_t) pell_json_count(&g->nodes) - 1, &stack[depth + 1].node));
        child = pell_json_at(&g->nodes, (size_t) stack[depth + 1].node);
        PELL_TRY(enter_node(g, &child, tree, &stack[depth + 1], &enter));
        if (enter)
            depth++;
    }
    return PELL_OK;

fail:
    return res;
}

/* --- Scenes ----------------------------------------------------------------------------------------------------------------- */

static enum pell_result walk_scene(struct gltf *g, const struct pell_json *scene, struct tree *tree)
{
    const size_t count = pell_json_count(&g->nodes);
    struct pell_json roots;
    enum pell_result res;

    PELL_TRY(pell_json_is_object(scene));
    PELL_TRY(pell_json_array(scene, "nodes", 0, count, &roots));
    for (size_t i = 0; i < pell_json_count(&roots); i++) {
        const struct pell_json at = pell_json_at(&roots, i);
        int64_t root;
        PELL_TRY(pell_json_to_int(&at, 0, (int64_t) count - 1, &root));
        if (g->node[root].parent >= 0)
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL,
                                   "node %" PRId64 " is a child of node %" PRId32 ", allowed: nodes without a parent", root,
                                   g->node[root].parent);
        PELL_TRY(walk(g, root, tree));
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result walk_roots(struct gltf *g, struct tree *tree)
{
    enum pell_result res = PELL_OK;
    for (size_t i = 0; i < pell_json_count(&g->nodes) && res == PELL_OK; i++)
        if (g->node[i].parent < 0)
            res = walk(g, (int64_t) i, tree);
    return res;
}

/* A file of meshes without nodes is a library; each mesh is drawn without a transform. */
static enum pell_result place_all_meshes(struct gltf *g)
{
    const struct pell_mat4 identity = mat4_identity();
    enum pell_result res = PELL_OK;

    if (pell_json_count(&g->meshes) == 0)
        return PELL_OK;
    gltf_warn(g, GLTF_WARN_NODE, &g->meshes, NULL, "the file has no nodes: each mesh is drawn once, at the origin");
    for (size_t i = 0; i < pell_json_count(&g->meshes) && res == PELL_OK; i++) {
        const struct pell_json mesh = pell_json_at(&g->meshes, i);
        res = visit(g, &mesh);
        if (res == PELL_OK)
            res = gltf_place_mesh(g, (int64_t) i, NULL, &(struct gltf_placement) { .world = &identity });
    }
    return res;
}

/* The scene that "scene" names, else the first. If that is empty, the first that is not: exporters put empty ones in front. */
static enum pell_result walk_scenes(struct gltf *g, struct tree *tree)
{
    const size_t count = pell_json_count(&g->scenes);
    int64_t chosen = 0;
    enum pell_result res;

    PELL_TRY(gltf_index(&g->root, "scene", &g->scenes, &chosen));
    for (size_t i = 0; i < count; i++) {
        const size_t index = i == 0 ? (size_t) chosen : i - (i <= (size_t) chosen);
        const struct pell_json scene = pell_json_at(&g->scenes, index);
        tree->walk = (int32_t) i + 1;
        PELL_TRY(walk_scene(g, &scene, tree));
        if (g->scene->num_meshes == 0)
            continue;
        if (i > 0) {
            char name[128];
            gltf_warn(g, GLTF_WARN_NODE, &scene, NULL, "the default scene has no mesh: \"%s\" is drawn instead",
                      gltf_name(&scene, "scene", name, sizeof(name)));
        }
        break;
    }
    return PELL_OK;

fail:
    return res;
}

enum pell_result gltf_read_scene(struct gltf *g)
{
    const size_t count = pell_json_count(&g->nodes);
    struct tree tree = { 0 };
    enum pell_result res = PELL_ERR_NOMEM;

    if (count == 0)
        return place_all_meshes(g);
    tree.seen = pell_alloc_array(g->ctx, count, sizeof(*tree.seen));
    tree.stack = pell_alloc_array(g->ctx, (size_t) g->limits->depth, sizeof(*tree.stack));
    if (!tree.seen || !tree.stack)
        goto fail;
    PELL_TRY(find_parents(g, count, tree.seen));
    memset(tree.seen, 0, count * sizeof(*tree.seen));
    tree.walk = 1;
    if (pell_json_count(&g->scenes) > 0)
        PELL_TRY(walk_scenes(g, &tree));
    else
        PELL_TRY(walk_roots(g, &tree));

fail:
    pell_free(g->ctx, tree.seen);
    pell_free(g->ctx, tree.stack);
    return res;
}
