/* SPDX-License-Identifier: MIT
 * load.c - reads any scene, a mesh file or a scene file, and applies the caller's overrides. */
#include "base/file.h"
#include "scene/scene.h"

#include <string.h>

#define LYING 1.2f /* ratio of depth to height and to width above which an object seems to lie on its back */

static enum pell_result apply_material(struct pell_scene *scene, const struct pell_material_entry *entry)
{
    enum pell_result res;

    PELL_TRY(pell_scene_default_material(scene, true));
    for (size_t i = 0; i < scene->num_materials; i++)
        PELL_TRY(pell_material_set(scene->ctx, &scene->materials[i], entry));

fail:
    return res;
}

/* Opens what the parameters name beside the scene, so that a wrong name is reported before a large mesh is read. */
static enum pell_result open_named(struct pell_context *ctx, const struct pell_load_params *params, struct pell_material_entry *material)
{
    struct pell_file file;
    enum pell_result res = PELL_OK;

    if (params->material)
        PELL_TRY(pell_material_open(ctx, "--material", params->material, material));
    if (params->environment && (res = pell_file_open(ctx, params->environment, &file)) == PELL_OK)
        pell_file_close(&file);

fail:
    return res;
}

static void report(const struct pell_scene *scene)
{
    const float *min = scene->bounds_min, *max = scene->bounds_max;
    bool translucent = false;
    int64_t triangles = 0;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_material *m = &scene->materials[scene->meshes[i].material];
        triangles += (int) i == scene->ground_mesh ? 0 : scene->meshes[i].num_triangles;
        translucent |= !m->opaque || pell_material_is_thin(m);
    }
    pell_info(scene->ctx, scene->path, "%s, %.4g x %.4g x %.4g mm (one unit of the mesh file is %.6g mm)",
              pell_counted(triangles, "triangle", "triangles").str, (double) (max[0] - min[0]), (double) (max[1] - min[1]),
              (double) (max[2] - min[2]), scene->mm_per_unit);
    if (!translucent)
        pell_warn(scene->ctx, scene->path,
                  "--material NAME, or \"materials\" of a scene file, makes it so; `pellucid materials` lists what there is",
                  "no material is translucent, so nothing scatters below a surface");
}

/* Rotates a mesh file whose z axis points upwards. */
static enum pell_result rotate_z_up(struct pell_scene *scene)
{
    const struct pell_mat4 matrix = { { 1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1 } };
    return pell_scene_transform(scene, &matrix, 1.0);
}

/* Informs: an object deeper than high and wide may have been modelled with the z axis upwards. */
static void hint_at_up(const struct pell_scene *scene, const struct pell_load_params *params)
{
    const struct pell_vec3 size = vec3_sub(vec3_load(scene->bounds_max), vec3_load(scene->bounds_min));

    if (!params->up && !params->bare && size.z > LYING * fmaxf(size.x, size.y))
        pell_info(scene->ctx, scene->path, "is longest along z: if the object lies on its back, --up z turns it");
}

/* A time without an animation is allowed, as a sequence may show static objects. A name without an animation is an error. */
static enum pell_result check_animated(const struct pell_scene *scene, const struct pell_load_params *params)
{
    char shown[96];

    if (scene->animated)
        return PELL_OK;
    if (params->animation)
        return pell_error(scene->ctx, PELL_ERR_INVALID, "--animation", NULL, "there is no animation \"%s\": no file of the scene has any",
                          pell_printable(params->animation, shown, sizeof(shown)));
    if (params->time != 0.0)
        pell_warn(scene->ctx, "--time", NULL, "%g s changes nothing: no file of the scene has an animation", params->time);
    return PELL_OK;
}

enum pell_result pell_scene_load_bytes(const struct pell_loader *given, const char *path, const uint8_t *data, size_t size,
                                       struct pell_scene **out)
{
    const struct pell_load_params *params = given->params;
    struct pell_loader chosen = *given;
    const struct pell_loader *loader = &chosen;
    const struct pell_scale scale = { params->mm_per_unit, params->size_mm, params->size_mm > 0.0 ? "--size" : "--unit" };
    struct pell_extras extras = { .ground_material = -1 };
    struct pell_moment moment = { 0 };
    struct pell_material_entry material = { 0 };
    struct pell_scene *scene = NULL;
    bool mesh;
    enum pell_result res;

    *out = NULL;
    PELL_TRY(pell_viewpoint_read(loader->ctx, params, &extras.view));
    if (params->normals)
        PELL_TRY(pell_normals_read(given->ctx, PELL_ERR_INVALID, "--normals", params->normals, &chosen.normals));
    PELL_TRY(pell_surroundings_read(loader->ctx, params, &extras.surroundings));
    if (!(fabs(params->time) <= 1e9))
        return pell_error(loader->ctx, PELL_ERR_INVALID, "--time", NULL, "is %g, must be in [-1e9, 1e9] seconds", params->time);
    if (!(params->size_mm >= 0.0 && isfinite(params->size_mm)))
        return pell_error(loader->ctx, PELL_ERR_INVALID, "--size", NULL, "is %g mm, must be finite and not negative", params->size_mm);
    if (!(params->mm_per_unit >= 0.0 && isfinite(params->mm_per_unit)))
        return pell_error(loader->ctx, PELL_ERR_INVALID, "--unit", NULL, "is %g mm, must be finite and not negative", params->mm_per_unit);
    mesh = !loader->is_scene_file && pell_scene_detect_format(path, data, size) != PELL_SCENE_SCENE;
    if (!mesh && params->up)
        return pell_error(loader->ctx, PELL_ERR_INVALID, "--up", "rotate_deg of a mesh in the scene file turns it",
                          "is for a mesh file, and INPUT is a scene file");
    PELL_TRY(open_named(loader->ctx, params, &material));
    if (!mesh) {
        PELL_TRY(pell_read_scene_file(loader, path, data, size, &scene, &extras));
    } else {
        pell_load_moment(params, &moment);
        PELL_TRY(pell_load_mesh(loader, path, data, size, &scale, &moment, &scene));
        if (extras.view.z_up)
            PELL_TRY(rotate_z_up(scene));
    }
    for (size_t i = 0; i < scene->num_meshes && params->thicken_mm != 0.0; i++)
        scene->meshes[i].thicken = (float) params->thicken_mm;
    PELL_TRY(check_animated(scene, params));
    scene->from_file = true;
    if (params->material)
        PELL_TRY(apply_material(scene, &material));
    if (params->camera)
        PELL_TRY(pell_scene_choose_camera(scene, "--camera", params->camera, PELL_ERR_INVALID));
    PELL_TRY(pell_scene_finish(scene, params, &extras));
    if (!params->bare && scene->num_meshes > 0) /* `check` reports all this itself */
        report(scene);
    if (mesh)
        hint_at_up(scene, params);
    *out = scene;
    scene = NULL;

fail:
    pell_free(loader->ctx, (char *) material.name);
    pell_scene_destroy(&scene);
    return res;
}

enum pell_result pell_scene_load_memory(struct pell_context *ctx, const char *path, const void *data, size_t size,
                                        const struct pell_load_params *params, struct pell_scene **out)
{
    if (out)
        *out = NULL;
    if (!ctx || !path || (!data && size) || !out)
        return pell_null(ctx, "pell_scene_load_memory");

    static const struct pell_load_params none;
    struct pell_loader loader = { .ctx = ctx, .params = params ? params : &none };
    char *folder = pell_path_folder(ctx, path);
    enum pell_result res;

    *out = NULL;
    if (!folder)
        return PELL_ERR_NOMEM;
    loader.root = folder;
    res = pell_scene_load_bytes(&loader, path, data, size, out);
    pell_free(ctx, folder);
    return res;
}

enum pell_result pell_scene_load(struct pell_context *ctx, const char *path, const struct pell_load_params *params, struct pell_scene **out)
{
    if (out)
        *out = NULL;
    if (!ctx || !path || !out)
        return pell_null(ctx, "pell_scene_load");

    uint8_t *data = NULL;
    size_t size;
    enum pell_result res;

    *out = NULL;
    PELL_TRY(pell_file_read(ctx, path, &data, &size));
    PELL_TRY(pell_scene_load_memory(ctx, path, data, size, params, out));

fail:
    pell_free(ctx, data);
    return res;
}
