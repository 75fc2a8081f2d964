/* SPDX-License-Identifier: MIT
 * shadow.c - the unscattered light in the shadow of thin parts, see stage.h. */
#include "render/unscattered/internal.h"

#include "shared/through.h"

#include <math.h>
#include <string.h>

/* Solids that a ray is in, the innermost last. */
struct nest {
    int object[PELL_THROUGH_NESTING], material[PELL_THROUGH_NESTING];
    int inner[PELL_THROUGH_NESTING]; /* surfaces of the same object inside it that the ray has entered */
    int depth;
};

static bool is_dark(const float through[3][16], int i, float least)
{
    return !(fmaxf(through[0][i], fmaxf(through[1][i], through[2][i])) > least);
}

static int find_solid(const struct nest *nest, int object)
{
    int at = nest->depth - 1;

    while (at >= 0 && nest->object[at] != object)
        at--;
    return at;
}

/* Leaves a solid, which need not be the last one where solids overlap. */
static void leave(struct nest *nest, int at)
{
    nest->depth--;
    for (; at < nest->depth; at++) {
        nest->object[at] = nest->object[at + 1];
        nest->material[at] = nest->material[at + 1];
        nest->inner[at] = nest->inner[at + 1];
    }
}

/* Passes the boundary that lane i has hit. Returns false if the light ends there. */
static bool pass(const struct pell_unscattered_shadow *s, const struct pell_ray_hit16 *r, int i, struct nest *nest)
{
    const struct pell_mesh *mesh = &s->scene->meshes[r->hit.mesh[i]];
    const struct pell_vec3 d = vec3(r->ray.dx[i], r->ray.dy[i], r->ray.dz[i]);
    const bool outer = vec3_dot(d, vec3(r->hit.ngx[i], r->hit.ngy[i], r->hit.ngz[i])) < 0.0f;
    const int object = pell_mesh_assembly(mesh), at = find_solid(nest, object);

    if (!s->media->media[mesh->material].is_traced)
        return false;
    if (at >= 0) {
        if (outer || nest->inner[at] > 0)
            nest->inner[at] += outer ? 1 : -1;
        else
            leave(nest, at);
        return true;
    }
    if (!outer || nest->depth == PELL_THROUGH_NESTING)
        return false;
    nest->object[nest->depth] = object;
    nest->material[nest->depth] = mesh->material;
    nest->inner[nest->depth++] = 0;
    return true;
}

/* Multiplies by what the boundary transmits, if that has changed the medium. */
static void cross(const struct pell_unscattered_shadow *s, const struct pell_ray_hit16 *r, int i, float through[3][16])
{
    const struct unscattered_boundary boundary = unscattered_boundary_of(s->scene, s->scene->meshes[r->hit.mesh[i]].material);
    const struct pell_vec3 d = vec3(r->ray.dx[i], r->ray.dy[i], r->ray.dz[i]), ng = vec3(r->hit.ngx[i], r->hit.ngy[i], r->hit.ngz[i]);
    const float cosine = fabsf(vec3_dot(vec3_normalize(d), vec3_normalize(ng)));
    const float transmitted = unscattered_transmittance(s->tables, s->smooth, &boundary, cosine);

    for (int c = 0; c < 3; c++)
        through[c][i] *= transmitted;
}

int64_t pell_unscattered_shadow(const struct pell_unscattered_shadow *s, const int32_t mask[16], const struct pell_ray16 *rays,
                                float through[3][16])
{
    const float least = s->ambient ? PELL_THROUGH_AMBIENT : PELL_THROUGH_LEAST;
    _Alignas(64) int32_t active[16];
    struct nest nest[16];
    struct pell_ray_hit16 r;
    int64_t count = 0;

    r.ray = *rays;
    memcpy(active, mask, sizeof(active));
    for (int i = 0; i < 16; i++) {
        nest[i].depth = 0;
        through[0][i] = through[1][i] = through[2][i] = mask[i] ? 1.0f : 0.0f;
    }
    for (int step = 0; step <= PELL_THROUGH_SURFACES; step++) {
        bool any = false;
        for (int i = 0; i < 16; i++) {
            r.ray.tfar[i] = rays->tfar[i];
            r.hit.mesh[i] = r.hit.instance[i] = PELL_NO_HIT;
            any |= active[i] != 0;
            count -= active[i];
        }
        if (!any)
            break;
        pell_rays_closest16(s->rays, active, !s->ambient, &r);
        for (int i = 0; i < 16; i++) {
            const struct pell_vec3 d = vec3(r.ray.dx[i], r.ray.dy[i], r.ray.dz[i]), o = vec3(r.ray.ox[i], r.ray.oy[i], r.ray.oz[i]);
            const int before = nest[i].depth;
            const float length = vec3_length(d);
            bool goes_on;
            if (!active[i])
                continue;
            if (r.hit.mesh[i] >= s->scene->num_meshes) { /* the light, unless that is inside a solid */
                active[i] = 0;
                if (before > 0)
                    through[0][i] = through[1][i] = through[2][i] = 0.0f;
                continue;
            }
            for (int c = 0; before > 0 && c < 3; c++)
                through[c][i] *=
                    expf(-s->media->media[nest[i].material[before - 1]].sigma_t[c] * (r.ray.tfar[i] - r.ray.tnear[i]) * length);
            goes_on = step < PELL_THROUGH_SURFACES && !is_dark((const float(*)[16]) through, i, least) && pass(s, &r, i, &nest[i]);
            if (goes_on && nest[i].depth != before && (before == 0 || nest[i].depth == 0))
                cross(s, &r, i, through);
            if (!goes_on)
                through[0][i] = through[1][i] = through[2][i] = 0.0f;
            active[i] = goes_on ? -1 : 0;
            r.ray.tnear[i] = pell_through_near(r.ray.tfar[i], vec3_max_abs(o), length);
        }
    }
    return count;
}

struct pell_unscattered_material pell_unscattered_material(const struct pell_unscattered *media, const struct pell_scene *scene,
                                                           size_t material)
{
    const struct unscattered_boundary boundary = unscattered_boundary_of(scene, (int) material);
    const struct unscattered_medium *m = media ? &media->media[material] : NULL;

    if (!m || !m->is_traced)
        return (struct pell_unscattered_material) { .is_traced = false };
    return (struct pell_unscattered_material) { true, { m->sigma_t[0], m->sigma_t[1], m->sigma_t[2] }, boundary.roughness, boundary.rho_s };
}
