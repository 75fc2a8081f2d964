/* SPDX-License-Identifier: MIT
 *
 * spacing.c - distance between samples: a fraction of the object's size on the object, growing on other surfaces with the distance from it,
 * so that a large ground is fine around objects and coarse elsewhere.
 */
#include "render/indirect/internal.h"

#include "math/scalar.h"

#include <float.h>

#define SPACINGS 80.0f /* spacings per diagonal of the bounding box */
#define GROWTH 0.15f   /* growth of the spacing per distance */

static void extend_box(const struct pell_context *ctx, struct indirect_box *box, const struct pell_mesh *mesh)
{
    for (uint32_t i = 0; i < mesh->num_vertices && !pell_cancelled_at(ctx, i); i++) {
        const struct pell_vec3 p = vec3_load(mesh->position + 3 * (size_t) i);
        box->low = vec3(fminf(box->low.x, p.x), fminf(box->low.y, p.y), fminf(box->low.z, p.z));
        box->high = vec3(fmaxf(box->high.x, p.x), fmaxf(box->high.y, p.y), fmaxf(box->high.z, p.z));
    }
}

/* Rounding error of a point's coordinates, > 0: an object of that size is a point. */
static float rounding(struct pell_vec3 p)
{
    return fmaxf(2.0f * FLT_EPSILON * vec3_length(p), 1e-30f);
}

void indirect_spacing_make(const struct pell_scene *scene, struct indirect_spacing *out)
{
    int object[INDIRECT_BOXES];

    out->count = 0;
    out->scale = 1.0f;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        int k = 0;

        if (!indirect_shown(scene, mesh))
            continue;
        while (k < out->count && object[k] != pell_mesh_assembly(mesh))
            k++;
        if (k == INDIRECT_BOXES) /* the last box is shared by all further objects */
            k--;
        if (k == out->count) {
            object[k] = pell_mesh_assembly(mesh);
            out->box[k] = (struct indirect_box) { vec3(INFINITY, INFINITY, INFINITY), vec3(-INFINITY, -INFINITY, -INFINITY), 0.0f };
            out->count++;
        }
        extend_box(scene->ctx, &out->box[k], mesh);
    }
    for (int k = 0; k < out->count; k++)
        out->box[k].spacing = fmaxf(vec3_length(vec3_sub(out->box[k].high, out->box[k].low)) / SPACINGS,
                                    fmaxf(rounding(out->box[k].low), rounding(out->box[k].high)));
}

float indirect_spacing_at(const struct indirect_spacing *s, struct pell_vec3 p)
{
    float minimum = INFINITY;

    for (int k = 0; k < s->count; k++) {
        const struct indirect_box *b = &s->box[k];
        const struct pell_vec3 d =
            vec3(larger(larger(b->low.x - p.x, p.x - b->high.x), 0.0f), larger(larger(b->low.y - p.y, p.y - b->high.y), 0.0f),
                 larger(larger(b->low.z - p.z, p.z - b->high.z), 0.0f));
        minimum = smaller(minimum, b->spacing + GROWTH * vec3_length(d));
    }
    return fmaxf(minimum * s->scale, rounding(p)); /* closer samples would coincide, and a knot could have any number of them around it */
}
