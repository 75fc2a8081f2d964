/* SPDX-License-Identifier: MIT
 * meshes.c - "mesh" and "meshes" of a scene file: their files, scale, placement, normals, material, and the objects that they belong to. */
#include "scene/file/scene_file.h"

#include <string.h>

const char *const pell_mesh_keys[PELL_MESH_KEYS] = { "path",  "unit",     "size",   "translate", "rotate_deg",
                                                     "scale", "material", "object", "normals",   "thicken" };

/* "unit" and "size" of an object; the caller's override those of the file's top level. */
static enum pell_result read_scale(const struct pell_json *at, struct pell_scale *scale)
{
    const struct pell_json unit = pell_json_get(at, "unit"), size = pell_json_get(at, "size");
    enum pell_result res;

    if (unit.value && size.value)
        return pell_json_error(&size, PELL_ERR_FORMAT, "either of them settles the scale", "has both unit and size");
    if (unit.value || size.value)
        scale->mm_per_unit = scale->size_mm = 0.0;
    if (unit.value)
        PELL_TRY(pell_scene_text_length(&unit, false, &scale->mm_per_unit));
    if (size.value)
        PELL_TRY(pell_scene_text_length(&size, false, &scale->size_mm));
    return PELL_OK;

fail:
    return res;
}

/* Load parameters override it. */
static enum pell_result read_normals(const struct pell_json *at, struct pell_loader *loader)
{
    const struct pell_json normals = pell_json_get(at, "normals");
    struct pell_text where;
    const char *text;
    enum pell_normals chosen;
    enum pell_result res;

    if (!normals.value)
        return PELL_OK;
    PELL_TRY(pell_json_to_string(&normals, &text));
    PELL_TRY(pell_normals_read(loader->ctx, PELL_ERR_FORMAT, pell_json_where(&normals, &where), text, &chosen));
    if (!loader->params->normals)
        loader->normals = chosen;

fail:
    return res;
}

static enum pell_result read_thickness(const struct pell_json *at, struct pell_scene *scene)
{
    const struct pell_json thicken = pell_json_get(at, "thicken");
    double mm = 0.0;
    enum pell_result res;

    if (!thicken.value)
        return PELL_OK;
    PELL_TRY(pell_scene_text_length(&thicken, false, &mm));
    for (size_t i = 0; i < scene->num_meshes; i++)
        scene->meshes[i].thicken = (float) mm;

fail:
    return res;
}

/* translate x rotate x scale; rotations about the fixed axes x, then y, then z. */
static enum pell_result read_placement(const struct pell_json *at, double unit, struct pell_mat4 *matrix)
{
    const struct pell_json factor = pell_json_get(at, "scale");
    double move[3] = { 0 }, turn[3] = { 0 }, scale[3] = { 1, 1, 1 };
    struct pell_mat4 m;
    enum pell_result res;

    PELL_TRY(pell_scene_position(at, "translate", unit, move));
    PELL_TRY(pell_json_numbers(at, "rotate_deg", 3, -36000.0, 36000.0, turn));
    if (json_is_number(factor.value)) {
        PELL_TRY(pell_json_to_number(&factor, -1e6, 1e6, &scale[0]));
        scale[1] = scale[2] = scale[0];
    } else {
        PELL_TRY(pell_json_numbers(at, "scale", 3, -1e6, 1e6, scale));
    }
    for (int c = 0; c < 3; c++)
        if (fabs(scale[c]) < 1e-6)
            return pell_json_error(&factor, PELL_ERR_FORMAT, NULL, "scales by %g, must be at least 1e-6 either way", scale[c]);
    *matrix = mat4_identity();
    for (int c = 0; c < 3; c++)
        matrix->m[5 * c] = scale[c];
    for (int axis = 0; axis < 3; axis++) {
        const double sine = sin(turn[axis] * RADIANS), cosine = cos(turn[axis] * RADIANS);
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        m = mat4_identity();
        m.m[4 * u + u] = m.m[4 * v + v] = cosine;
        m.m[4 * u + v] = sine;
        m.m[4 * v + u] = -sine;
        *matrix = mat4_mul(&m, matrix);
    }
    for (int c = 0; c < 3; c++)
        matrix->m[12 + c] = move[c];
    return PELL_OK;

fail:
    return res;
}

/* "material" of a mesh: a material of this file, else a built-in one or a material file. */
static enum pell_result set_mesh_material(struct pell_scene_reader *r, const struct pell_json *at, struct pell_scene *scene)
{
    const struct pell_json root = pell_json_root(&r->file), materials = pell_json_get(&root, "materials");
    struct pell_material_entry entry = { 0 };
    const char *name;
    size_t index;
    enum pell_result res;

    PELL_TRY(pell_json_to_string(at, &name));
    if (materials.value && strcmp(name, "*") != 0 && pell_json_has(&materials, name)) {
        PELL_TRY(pell_scene_add_material(scene, name, &index));
        PELL_TRY(pell_material_apply(scene, index, scene->path, "marble")); /* what the overlay does not set */
        for (size_t i = 0; i < scene->num_meshes; i++)
            scene->meshes[i].material = (int) index;
        return PELL_OK;
    }
    PELL_TRY(pell_scene_material_entry(r, at, name, &entry));
    PELL_TRY(pell_scene_default_material(scene, true));
    for (size_t i = 0; i < scene->num_materials; i++)
        PELL_TRY(pell_material_set(r->ctx, &scene->materials[i], &entry));

fail:
    pell_free(r->ctx, (char *) entry.name);
    return res;
}

struct defined {
    const struct pell_scene_reader *reader;
    bool all; /* overridden by the mesh's own "material" */
};

/* Whether "materials" defines a mesh file's material. */
static bool defines_material(const void *of, const char *name)
{
    const struct defined *d = of;
    const struct pell_json root = pell_json_root(&d->reader->file), materials = pell_json_get(&root, "materials");

    return d->all || (materials.value && (pell_json_has(&materials, "*") || pell_json_has(&materials, name)));
}

/* Whether materials of two mesh files are one: they have the same name, which "materials" of the scene file refers to, or are the same
 * built-in entry without changes. */
static bool is_same_material(const struct pell_material *a, const struct pell_material *b)
{
    bool painted = false;

    if (!a->preset != !b->preset || (a->preset && strcmp(a->preset, b->preset) != 0))
        return false;
    for (int map = 0; map < PELL_MAPS; map++)
        painted |= pell_material_map(a, map)->texture || pell_material_map(b, map)->texture;
    return strcmp(a->name, b->name) == 0 || (a->preset && !painted);
}

/* "object" of the meshes from `first` on: joins them with those of earlier entries that have the same name into one object, in which each
 * material exists once, as light scatters from mesh to mesh of one material. */
static enum pell_result join_object(struct pell_scene_reader *r, const struct pell_json *at, size_t first)
{
    const struct pell_scene *s = r->scene;
    const char *name;
    uint32_t number;
    bool fresh;
    enum pell_result res;

    PELL_TRY(pell_json_to_string(at, &name));
    PELL_TRY(pell_names_enter(&r->objects, name, strlen(name), &number, &fresh));
    PELL_TRY(pell_grow(r->ctx, (void **) &r->first_of_object, number, &r->object_capacity, sizeof(*r->first_of_object)));
    if (fresh)
        r->first_of_object[number] = first;
    for (size_t i = first; i < s->num_meshes; i++) {
        struct pell_mesh *mesh = &s->meshes[i];
        mesh->object = s->meshes[r->first_of_object[number]].object;
        for (size_t k = r->first_of_object[number]; k < first && mesh->material >= 0; k++) {
            const struct pell_mesh *other = &s->meshes[k];
            if (other->object == mesh->object && other->material >= 0 &&
                is_same_material(&s->materials[other->material], &s->materials[mesh->material])) {
                mesh->material = other->material;
                break;
            }
        }
    }
    return PELL_OK;

fail:
    return res;
}

/* `at` is a path or an object with one. */
static enum pell_result read_mesh(struct pell_scene_reader *r, const struct pell_json *at)
{
    const bool plain = json_is_string(at->value);
    const size_t before = r->scene->num_meshes;
    const struct pell_json material = plain ? *at : pell_json_get(at, "material"), path_at = plain ? *at : pell_json_get(at, "path");
    const struct defined defined = { r, !plain && material.value };
    struct pell_loader loader = *r->loader;
    struct pell_scale scale = r->scale;
    struct pell_scene *scene = NULL;
    struct pell_json object;
    struct pell_mat4 matrix;
    struct pell_text where;
    const char *reference;
    char *path = NULL;
    uint8_t *data = NULL;
    size_t size;
    enum pell_result res;

    if (!plain && !json_is_object(at->value))
        return pell_json_wrong_type(at, "a path, or an object with one");
    loader.defines = defines_material;
    loader.defines_of = &defined;
    scale.where = pell_json_where(at, &where);
    if (!plain) {
        PELL_TRY(pell_json_only(at, pell_mesh_keys, PELL_MESH_KEYS));
        PELL_TRY(pell_json_require(at, "path"));
        PELL_TRY(read_scale(at, &scale));
        PELL_TRY(read_normals(at, &loader));
    }
    PELL_TRY(pell_json_to_string(&path_at, &reference));
    res = pell_loader_read(r->loader, where.str, reference, &path, &data, &size);
    if (res != PELL_OK) {
        res = res == PELL_ERR_INVALID ? PELL_ERR_FORMAT : res;
        goto fail;
    }
    PELL_TRY(pell_load_mesh(&loader, path, data, size, &scale, &r->moment, &scene));
    if (!plain) {
        PELL_TRY(read_placement(at, scene->mm_per_unit, &matrix));
        PELL_TRY(pell_scene_transform(scene, &matrix, 1.0));
        if (material.value)
            PELL_TRY(set_mesh_material(r, &material, scene));
        PELL_TRY(read_thickness(at, scene));
    }
    if (r->scene->num_meshes == 0)
        r->scene->mm_per_unit = scene->mm_per_unit;
    PELL_TRY(pell_scene_merge(r->scene, scene));
    object = pell_json_get(at, "object");
    if (!plain && object.value)
        PELL_TRY(join_object(r, &object, before));

fail:
    pell_scene_destroy(&scene);
    pell_free(r->ctx, path);
    pell_free(r->ctx, data);
    return res;
}

enum pell_result pell_scene_meshes(struct pell_scene_reader *r, const struct pell_json *root)
{
    const struct pell_load_params *params = r->loader->params;
    const struct pell_json mesh = pell_json_get(root, "mesh");
    struct pell_json meshes;
    enum pell_result res;

    PELL_TRY(read_scale(root, &r->scale));
    if (params->mm_per_unit > 0.0 || params->size_mm > 0.0) {
        r->scale.mm_per_unit = params->mm_per_unit;
        r->scale.size_mm = params->size_mm;
    }
    PELL_TRY(pell_json_array(root, "meshes", 1, (size_t) pell_context_limits(r->ctx)->items, &meshes));
    if (!mesh.value == !meshes.value)
        return pell_json_error(root, PELL_ERR_FORMAT, NULL, mesh.value ? "has both mesh and meshes; one is allowed" : "has no mesh");
    if (mesh.value)
        PELL_TRY(read_mesh(r, &mesh));
    for (size_t i = 0; i < pell_json_count(&meshes); i++) {
        const struct pell_json at = pell_json_at(&meshes, i);
        PELL_TRY(read_mesh(r, &at));
    }
    r->unit = r->scale.mm_per_unit > 0.0 ? r->scale.mm_per_unit : r->scene->mm_per_unit;
    return PELL_OK;

fail:
    return res;
}
