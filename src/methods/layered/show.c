/* SPDX-License-Identifier: MIT
 * show.c - intermediate images: the planes fitted to the surface, and the depths of the layers below each pixel. */
#include "methods/layered/state.h"

#include "render/intermediate.h"

#include <math.h>
#include <stdio.h>

/* The plane of a pixel, interpolated between its vertices: unit normal, distance in mm. */
static void plane_at(const struct layered_state *st, const struct pell_mesh *mesh, ptrdiff_t at, float plane[4])
{
    const struct pell_frame *in = st->in;
    const float u = in->barycentric[0][at], v = in->barycentric[1][at], weight[3] = { 1.0f - u - v, u, v };
    const float(*const planes)[4] = (const float(*)[4]) st->planes[in->mesh[at]];
    float length;

    for (int k = 0; k < 4; k++) {
        plane[k] = 0.0f;
        for (int c = 0; c < 3; c++)
            plane[k] += weight[c] * planes[mesh->index[3 * (size_t) in->triangle[at] + (size_t) c]][k];
    }
    length = sqrtf(plane[0] * plane[0] + plane[1] * plane[1] + plane[2] * plane[2]);
    for (int k = 0; k < 3 && length > 0.0f; k++)
        plane[k] /= length;
}

static void fill(const struct layered_state *st, float *planes[4], float **depths, float *depth)
{
    const struct pell_scene *scene = st->services->scene;
    const struct pell_frame *in = st->in;

    for (int y = in->rect.y0; y < in->rect.y1; y++)
        for (int x = in->rect.x0; x < in->rect.x1; x++) {
            const ptrdiff_t at = y * in->shape.stride + x;
            const struct pell_mesh *mesh;
            const struct pell_medium_layers *layers;
            float plane[4];
            if (!in->material[at] || !layered_shows(st, at))
                continue;
            mesh = &scene->meshes[in->mesh[at]];
            layers = st->medium_layers[mesh->material];
            plane_at(st, mesh, at, plane);
            for (int k = 0; k < 4; k++)
                planes[k][at] = plane[k];
            pell_medium_layers_depths(layers, mesh, in->triangle[at], in->barycentric[0][at], in->barycentric[1][at], depth);
            for (int k = 0; k < layers->count && isfinite(depth[k]); k++)
                depths[k][at] = depth[k];
        }
}

enum pell_result layered_show(const struct layered_state *st)
{
    const size_t size = (size_t) st->in->shape.stride * (size_t) st->in->shape.height;
    float *memory = pell_calloc(st->ctx, size, (size_t) (4 + st->most_layers) * sizeof(*memory));
    float *depth = pell_calloc(st->ctx, (size_t) st->most_layers + 1, sizeof(*depth));
    float **depths = pell_calloc(st->ctx, (size_t) st->most_layers + 1, sizeof(*depths)), *planes[4];
    char name[64];
    enum pell_result res = PELL_ERR_NOMEM;

    if (!memory || !depth || !depths)
        goto fail;
    for (size_t k = 0; k < 4; k++)
        planes[k] = memory + k * size;
    for (int k = 0; k < st->most_layers; k++)
        depths[k] = memory + (size_t) (4 + k) * size;
    fill(st, planes, depths, depth);
    PELL_TRY(pell_show_pixels(
        st->services, st->in, (const void *const[]) { planes[0], planes[1], planes[2] }, PELL_PLANE_F32,
        &(struct pell_intermediate) { "layered.plane-normal", "1", "unit normal of the plane fitted around the point", .components = 3 }));
    PELL_TRY(pell_show_pixels(
        st->services, st->in, (const void *const[]) { planes[3] }, PELL_PLANE_F32,
        &(struct pell_intermediate) { "layered.plane-distance", "mm", "from the point to the plane fitted around it", .components = 1 }));
    for (int k = 0; k < st->most_layers; k++) {
        snprintf(name, sizeof(name), "layered.bottom-%d", k + 1);
        PELL_TRY(pell_show_pixels(st->services, st->in, (const void *const[]) { depths[k] }, PELL_PLANE_F32,
                                  &(struct pell_intermediate) { name, "mm",
                                                                "from the surface to this layer's bottom; 0: no such layer, or "
                                                                "it has none",
                                                                .components = 1 }));
    }
    res = PELL_OK;
fail:
    pell_free(st->ctx, depths);
    pell_free(st->ctx, depth);
    pell_free(st->ctx, memory);
    return res;
}
