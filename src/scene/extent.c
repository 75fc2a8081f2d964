/* SPDX-License-Identifier: MIT
 * extent.c - how large a scene is: refused where that is nothing, except in a frame of an animation. */
#include "scene/scene.h"

#include <float.h>
#include <math.h>

#define EMPTY_EXTENT 100.0f   /* mm, taken for a scene whose objects have vanished */
#define SMALLEST_EXTENT 5e-4f /* mm, extent of a scene: half a micrometre */
#define COARSEST 1e-3f        /* of the scene's extent: the largest spacing of floats that still represents the shape */

bool pell_scene_bounds(const struct pell_scene *scene, float *min, float *max)
{
    bool any = false, finite = true;

    for (int c = 0; c < 3; c++) {
        min[c] = INFINITY;
        max[c] = -INFINITY;
    }
    for (size_t k = 0; k < scene->num_meshes; k++) {
        const struct pell_mesh *m = &scene->meshes[k];
        if ((int) k == scene->ground_mesh)
            continue;
        any |= m->num_triangles > 0;
        for (size_t i = 0; i < 3 * (size_t) m->num_triangles && !pell_cancelled_at(scene->ctx, i); i++)
            for (int c = 0; c < 3 && m->index[i] < m->num_vertices; c++) {
                const float x = m->position[3 * (size_t) m->index[i] + c];
                min[c] = x < min[c] ? x : min[c];
                max[c] = x > max[c] ? x : max[c];
            }
    }
    for (int c = 0; c < 3; c++)
        finite &= isfinite(min[c]) && isfinite(max[c]) && isfinite(max[c] - min[c]);
    return any && finite;
}

static enum pell_result check_size(struct pell_scene *scene)
{
    const float *min = scene->bounds_min, *max = scene->bounds_max;
    const float extent = fmaxf(max[0] - min[0], fmaxf(max[1] - min[1], max[2] - min[2]));
    float farthest = 0.0f;

    if (extent > 0.0f && extent < SMALLEST_EXTENT)
        return pell_error(scene->ctx, scene->from_file ? PELL_ERR_FORMAT : PELL_ERR_INVALID, scene->path,
                          "--size 70mm: the largest extent; --unit 1mm: what one unit is",
                          "the largest extent is %.3g mm, allowed: %g mm or more: objects smaller than a wavelength of light cast no "
                          "shadow",
                          (double) extent, (double) SMALLEST_EXTENT);
    if (extent < 0.1f || extent > 1e5f)
        pell_warn(scene->ctx, scene->path, "is the unit or size right? --size 70mm: the largest extent; --unit 1mm: what one unit is",
                  "the largest extent is %g mm, which is %s for a translucent object", (double) extent, extent < 0.1f ? "tiny" : "huge");
    for (int c = 0; c < 3; c++)
        farthest = fmaxf(farthest, fmaxf(fabsf(min[c]), fabsf(max[c])));
    if (farthest * FLT_EPSILON > COARSEST * extent)
        pell_warn(
            scene->ctx, scene->path, "move it to the origin in the program that it comes from",
            "the scene lies up to %g mm from the origin, but is %.3g mm large: coordinates are rounded to %.2g mm, and its shape is lost",
            (double) farthest, (double) extent, (double) (farthest * FLT_EPSILON));
    return PELL_OK;
}

/* Whether the pose of an animation leaves nothing to see: its meshes are dropped then, and the image is the background. Another scene
 * without surface is an error. */
enum pell_result pell_scene_check_extent(struct pell_scene *scene, const struct pell_load_params *params)
{
    const bool any = pell_scene_bounds(scene, scene->bounds_min, scene->bounds_max), pose = scene->animated && params->timed;
    float extent = 0.0f;
    bool empty;

    for (int c = 0; c < 3 && any; c++)
        extent = fmaxf(extent, scene->bounds_max[c] - scene->bounds_min[c]);
    empty = pose && (any ? extent < SMALLEST_EXTENT : scene->vanished && scene->total_triangles == 0);
    if (pell_cancelled(scene->ctx))
        return PELL_ERR_CANCELLED;
    if (!any && !empty && scene->vanished && scene->total_triangles == 0)
        return pell_error(scene->ctx, PELL_ERR_FORMAT, scene->path, NULL,
                          "the scale of \"%s\" is 0, and nothing else in the file has a surface: there is nothing to render",
                          scene->vanished);
    if (!any && !empty)
        return pell_error(scene->ctx, PELL_ERR_FORMAT, scene->path, NULL, "holds no triangles");
    if (!empty)
        return check_size(scene);
    pell_warn(scene->ctx, scene->path, NULL, "at %g s all objects have shrunk to nothing%s%s%s: the image shows the background",
              params->time, scene->vanished ? " (" : "", scene->vanished ? scene->vanished : "", scene->vanished ? ")" : "");
    for (size_t i = 0; i < scene->num_meshes; i++)
        pell_mesh_finish(scene->ctx, &scene->meshes[i]);
    scene->num_meshes = 0;
    for (int c = 0; c < 3; c++) { /* what a default camera frames */
        scene->bounds_min[c] = -EMPTY_EXTENT / 2;
        scene->bounds_max[c] = EMPTY_EXTENT / 2;
    }
    return PELL_OK;
}
