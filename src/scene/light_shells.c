/* SPDX-License-Identifier: MIT
 *
 * light_shells.c - meshes that are the shells of lights, such as bulbs: they emit, and a point or spot light is inside them. The light
 * represents the shell's emission, so that the shell must not block it.
 */
#include "scene/scene.h"

double pell_triangle_solid_angle(const struct pell_mesh *m, uint32_t triangle, const float p[3])
{
    double v[3][3], l[3], triple, dots;

    for (size_t c = 0; c < 3; c++) {
        for (size_t a = 0; a < 3; a++)
            v[c][a] = (double) m->position[3 * (size_t) m->index[3 * (size_t) triangle + c] + a] - (double) p[a];
        l[c] = sqrt(v[c][0] * v[c][0] + v[c][1] * v[c][1] + v[c][2] * v[c][2]);
    }
    triple = v[0][0] * (v[1][1] * v[2][2] - v[1][2] * v[2][1]) + v[0][1] * (v[1][2] * v[2][0] - v[1][0] * v[2][2]) +
             v[0][2] * (v[1][0] * v[2][1] - v[1][1] * v[2][0]);
    dots = l[0] * l[1] * l[2];
    for (int c = 0; c < 3; c++) {
        const double *a = v[c], *b = v[(c + 1) % 3];
        dots += (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) * l[(c + 2) % 3];
    }
    return 2.0 * atan2(triple, dots);
}

double pell_mesh_solid_angle(const struct pell_context *ctx, const struct pell_mesh *m, const float p[3])
{
    double sum = 0.0;

    for (uint32_t i = 0; i < m->num_triangles && !pell_cancelled_at(ctx, i); i++)
        sum += pell_triangle_solid_angle(m, i, p);
    return sum;
}

/* Whether a mesh encloses a point: it subtends most of the sphere from there. */
static bool encloses(const struct pell_context *ctx, const struct pell_mesh *m, const float p[3])
{
    float low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };

    for (size_t i = 0; i < m->num_vertices && !pell_cancelled_at(ctx, i); i++)
        for (size_t c = 0; c < 3; c++) {
            low[c] = fminf(low[c], m->position[3 * i + c]);
            high[c] = fmaxf(high[c], m->position[3 * i + c]);
        }
    return p[0] > low[0] && p[0] < high[0] && p[1] > low[1] && p[1] < high[1] && p[2] > low[2] && p[2] < high[2] &&
           fabs(pell_mesh_solid_angle(ctx, m, p)) > 2.0 * PELL_PI;
}

void pell_scene_find_light_shells(struct pell_scene *scene)
{
    for (size_t i = 0; i < scene->num_meshes; i++) {
        struct pell_mesh *m = &scene->meshes[i];
        const struct pell_material *material = &scene->materials[m->material];
        m->light_shell = false;
        if (!material->opaque || !(material->emissive[0] + material->emissive[1] + material->emissive[2] > 0.0f))
            continue;
        for (size_t k = 0; k < scene->num_lights && !m->light_shell; k++) {
            const struct pell_light *l = &scene->lights[k];
            m->light_shell = (l->type == PELL_LIGHT_POINT || l->type == PELL_LIGHT_SPOT) && encloses(scene->ctx, m, l->position);
        }
    }
}
