/* SPDX-License-Identifier: MIT
 *
 * transmission.c - transmission through thin parts: for a light behind a point C, a ray from just inside C toward the light
 * leaves the solid at A, m = |A - C|. The thickness is
 *
 *     d = lerp(m, m cos, max(0, -n_A.n_C)),   cos = -n_C.l     (held over half of -ng.l: a normal map can't make a slab thin)
 *
 * and table(d) E(A) is transmitted, by the slab's table to the degree that the faces oppose (struct pell_thickness_table). Where A faces
 * the same way as C, the light that enters at A is already part of the irradiance near C, which the method spreads along the surface;
 * counting it again would draw a bright line just behind the terminator. So the light is scaled by 1 - max(0, n_A.n_C): 1 for every slab,
 * wedge and ear, 0 where both ends meet at the terminator. Methods that add transmission in this way spread only visible light: where A
 * faces away from the camera, beyond the rim of a backlit part, nothing else carries its light to C, and all of it counts. n_A is the
 * interpolated normal, T at A uses C's roughness and specular strength, and albedo is C's.
 *
 * Clear media scatter forward (optics/medium/forward.h): this light has a direction w, refracted at A, and its exit depends on the view.
 * The part from nearby, where sums over samples are too coarse, is that of a broad beam, found along the direction halfway between w and
 * the refracted view, which is that of light scattered half way. This direction is found in two steps, since w depends on A. T has the
 * rest.
 */
#include "render/irradiance/internal.h"

#include "math/scalar.h"
#include "shared/light.h"
#include "shared/thickness.h"

#include <float.h>
#include <string.h>

#define STEPS 5         /* surfaces that a ray may cross on its way out: two shells of the same object inside it */
#define MIN_FACING 0.2f /* cosine between a path through the solid and the normals at its ends */

/* Exit points of rays inside a solid. */
struct exits {
    _Alignas(64) int32_t found[PELL_LANES];
    struct pell_vec3 point[PELL_LANES]; /* A, mm */
    struct pell_vec3 geometric[PELL_LANES], normal[PELL_LANES];
    float terminator_offset[PELL_LANES]; /* of the smooth surface above the triangle, mm */
};

/* Origin of rays into the solid: just below the triangle. */
static struct pell_vec3 origin_inside(const struct pell_lanes *l, int i)
{
    return vec3_mad(vec3(l->px[i], l->py[i], l->pz[i]), -l->epsilon[i], vec3(l->gx[i], l->gy[i], l->gz[i]));
}

/* Interpolated normal of a hit, and the height of the smooth surface above the triangle there, as in struct
 * pell_surface.terminator_offset. */
static void hit_surface(const struct pell_mesh *mesh, uint32_t triangle, float u, float v, struct pell_vec3 geometric,
                        struct pell_vec3 *normal, float *terminator_offset)
{
    const uint32_t *index = mesh->index + (size_t) 3 * triangle;
    const float w[3] = { 1.0f - u - v, u, v };
    struct pell_vec3 at = { 0 }, n = { 0 }, sum = { 0 };

    *normal = geometric;
    *terminator_offset = 0.0f;
    if (!mesh->normal)
        return;
    for (int k = 0; k < 3; k++) {
        at = vec3_mad(at, w[k], vec3_load(mesh->position + (size_t) 3 * index[k]));
        n = vec3_mad(n, w[k], vec3_load(mesh->normal + (size_t) 3 * index[k]));
    }
    for (int k = 0; k < 3; k++) {
        const struct pell_vec3 nk = vec3_load(mesh->normal + (size_t) 3 * index[k]);
        const float under = vec3_dot(vec3_sub(vec3_load(mesh->position + (size_t) 3 * index[k]), at), nk);
        sum = vec3_mad(sum, w[k] * fabsf(under), nk);
    }
    n = vec3_normalize(n);
    if (vec3_dot(n, geometric) > 0.0f) {
        *normal = n;
        *terminator_offset = max0(vec3_dot(sum, geometric));
    }
}

/* Finds the object of the surface below each lane of `mask` that is not yet `known`, by a short ray from above it. */
static void find_objects(const struct job *job, struct packet *k, const int32_t *mask, int32_t *known, int *object)
{
    const struct pell_lanes *l = &k->lanes;
    _Alignas(64) int32_t active[PELL_LANES];
    struct pell_ray_hit16 probe;

    for (int i = 0; i < PELL_LANES; i++) {
        active[i] = mask[i] & ~known[i];
        known[i] |= active[i];
    }
    if (count_lanes(active) == 0)
        return;
    for (int i = 0; i < PELL_LANES; i++) {
        const float e = 4.0f * l->epsilon[i];
        const struct pell_vec3 g = vec3(l->gx[i], l->gy[i], l->gz[i]);
        pell_ray16_set(&probe.ray, i, vec3_mad(vec3(l->px[i], l->py[i], l->pz[i]), e, g), vec3_mul(g, -1.0f), 2.0f * e);
        probe.hit.mesh[i] = probe.hit.instance[i] = PELL_NO_HIT;
    }
    pell_rays_closest16(job->p->rays, active, true, &probe);
    k->rays += count_lanes(active);
    for (int i = 0; i < PELL_LANES; i++)
        if (active[i])
            object[i] =
                probe.hit.mesh[i] < job->p->scene->num_meshes ? pell_mesh_assembly(&job->p->scene->meshes[probe.hit.mesh[i]]) : INT32_MIN;
}

/* Traces the rays of `r` (lanes of `mask`) to where they leave the solid that they are in. Opaque objects or other solids in between:
 * not found. `depth`: number of shells of the same object inside it that a ray is in (they are crossed), -1: the ray has yet to enter
 * the solid. `source`: the light that rays run to; NULL: they run inward from the surface. */
static void find_exits(const struct job *job, struct packet *k, const int32_t *mask, const struct pell_light_source *source,
                       struct pell_ray_hit16 *r, int *depth, struct exits *out)
{
    const bool coherent = !source || source->samples == 1; /* samples of a large light diverge */
    const struct pell_scene *scene = job->p->scene;
    _Alignas(64) int32_t active[PELL_LANES], inner[PELL_LANES], known[PELL_LANES] = { 0 };
    float limit[PELL_LANES];
    int object[PELL_LANES];

    memcpy(limit, r->ray.tfar, sizeof(limit));
    memset(out->found, 0, sizeof(out->found));
    memcpy(active, mask, sizeof(active));
    for (int step = 0; step < STEPS; step++) {
        int any = 0;
        if (step > 0 || !source || !source->grid || !pell_light_grid_closest16(source->grid, active, r))
            pell_rays_closest16(job->p->rays, active, coherent, r);
        k->rays += count_lanes(active);
        for (int i = 0; i < PELL_LANES; i++) {
            const bool hit = active[i] && r->hit.mesh[i] < scene->num_meshes;
            const struct pell_mesh *mesh = hit ? &scene->meshes[r->hit.mesh[i]] : NULL;
            const struct pell_vec3 d = vec3(r->ray.dx[i], r->ray.dy[i], r->ray.dz[i]);
            struct pell_vec3 ng;
            bool is_exit;
            inner[i] = 0;
            if (!hit || scene->materials[mesh->material].opaque ||
                !pell_lights_part(job->lights, pell_mesh_assembly(mesh), (int) k->material[i]))
                continue;
            ng = vec3_normalize(vec3(r->hit.ngx[i], r->hit.ngy[i], r->hit.ngz[i]));
            is_exit = vec3_dot(ng, d) > 0.0f;
            if (is_exit && depth[i] == 0) {
                out->found[i] = -1;
                out->point[i] = vec3_mad(vec3(r->ray.ox[i], r->ray.oy[i], r->ray.oz[i]), r->ray.tfar[i], d);
                out->geometric[i] = ng;
                hit_surface(mesh, r->hit.triangle[i], r->hit.u[i], r->hit.v[i], ng, &out->normal[i], &out->terminator_offset[i]);
            } else {
                depth[i] += !is_exit ? 1 : depth[i] > 0 ? -1 : 0;
                inner[i] = any = -1;
            }
        }
        if (!any)
            return;
        find_objects(job, k, inner, known, object);
        for (int i = 0; i < PELL_LANES; i++) {
            active[i] = inner[i] && pell_mesh_assembly(&scene->meshes[r->hit.mesh[i]]) == object[i] ? -1 : 0;
            if (active[i]) {
                r->ray.tnear[i] = r->ray.tfar[i] * (1.0f + 1e-5f) + 1e-20f;
                r->ray.tfar[i] = limit[i];
            }
        }
    }
}

/* Fraction of E(A) transmitted to lane i; `same` is n_A.n_C; `beams`: without forward-scattered light. */
static void transmitted_fraction(const struct job *job, const struct packet *k, int i, float d, const struct pell_vec3 *normal, float same,
                                 bool beams, float rgb[3])
{
    const struct pell_lanes *l = &k->lanes;
    const struct pell_thickness_table *t = job->p->thickness[k->material[i]];
    const float counted = pell_thickness_counted(same, vec3_dot(*normal, vec3(l->vx[i], l->vy[i], l->vz[i])));
    const float coord = pell_thickness_coord(max0(d), t->max_mm, PELL_THICKNESS_STEPS), opposed = pell_thickness_opposed(same);
    const int j = pell_table_cell(coord, PELL_THICKNESS_STEPS);
    const struct pell_indirect_forward *forward = beams ? k->forward_model[i] : NULL;

    for (int c = 0; c < 3; c++) {
        const float rest = forward ? pell_forward_diffuse(&forward->model, c, max0(d), forward->separation[c]) : 1.0f;
        const float here = pell_lerp(t->value[j][c], rest * t->slab[j][c], opposed),
                    next = pell_lerp(t->value[j + 1][c], rest * t->slab[j + 1][c], opposed);
        rgb[c] = counted * pell_thickness_transmission(here, next, coord, PELL_THICKNESS_STEPS);
    }
}

/* T of lane i's surface at this cosine. */
static float transmittance(const struct job *job, const struct pell_lanes *l, int i, float mu)
{
    float scale, bias;

    if (l->smooth[i])
        return pell_boundary_lookup(job->tables.boundary + l->boundary_at[i], mu);
    pell_albedo_pair(job->tables.albedo + l->albedo_at[i], l->roughness_fraction[i], mu, &scale, &bias);
    return pell_transmittance(l->rho[i], l->fd[i], scale, bias);
}

/* Adds transmitted light of known path length to lane i. In round parts light spreads around the whole part, which a slab does not
 * describe. */
static void add_transmitted(struct packet *k, int i, const float light[3], float d)
{
    for (int c = 0; c < 3; c++) {
        const float exiting = light[c] * pell_thickness_exit(k->lanes.pass_per_mm[c][i], d, k->lanes.pass[c][i]);
        k->sums.transmitted[c][i] += exiting;
        k->sums.straight[i] += exiting;
        k->sums.path[i] += d * k->flat[i] * exiting;
    }
}

/* Falloff where the light enters, `m` mm nearer to it than lane i. Samples of a wide light represent solid angles, and have no falloff. */
static float falloff_at(const struct pell_light_source *source, const struct pell_aim *a, int i, float m)
{
    const bool wide = a->falloff[i] != pell_light_falloff(a->distance[i], source->scale, source->inv_range);

    return wide ? a->falloff[i] : pell_light_falloff(larger(a->distance[i] - m, 1e-3f), source->scale, source->inv_range);
}

/* Finds the fraction of the light that arrives at the lanes' exits. */
static void trace_to_light(const struct job *job, const struct pell_light_source *source, const struct pell_aim *a, struct packet *k,
                           const struct exits *exits, float arriving[3][PELL_LANES])
{
    const struct pell_lanes *l = &k->lanes;
    const bool directional = source->type == PELL_LIGHT_DIRECTIONAL;
    _Alignas(64) int32_t visible[PELL_LANES], occluded[PELL_LANES];
    _Alignas(64) float through[3][PELL_LANES];
    struct pell_ray16 rays;
    bool passes;

    for (int i = 0; i < PELL_LANES; i++) {
        struct pell_vec3 o = vec3(l->ox[i], l->oy[i], l->oz[i]), s = vec3(a->sx[i], a->sy[i], a->sz[i]);
        if (exits->found[i])
            o = vec3_mad(exits->point[i], exits->terminator_offset[i] + l->epsilon[i], exits->geometric[i]);
        pell_ray16_set(&rays, i, o, directional ? vec3(a->lx[i], a->ly[i], a->lz[i]) : vec3_sub(s, o), directional ? FLT_MAX : 0.9999f);
    }
    if (!pell_query_light_grid(source, k, exits->found, rays.ox, rays.oy, rays.oz, visible))
        pell_trace_occlusion(job, k, exits->found, true, &rays, visible);
    for (int i = 0; i < PELL_LANES; i++) {
        occluded[i] = exits->found[i] & ~visible[i];
        rays.tfar[i] = directional ? FLT_MAX : 0.9999f;
    }
    passes = pell_follow_shadow(job, k, occluded, &rays, false, through);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PELL_LANES; i++)
            arriving[c][i] = visible[i] ? 1.0f : passes ? through[c][i] : 0.0f;
}

static bool is_dark(const float light[3][PELL_LANES], int i)
{
    return !(light[0][i] + light[1][i] + light[2][i] > 0.0f);
}

/* Fraction of the light's intensity that enters at lane i's exit, m mm from the lane. */
static float entering_light(const struct job *job, const struct pell_light_source *source, const struct pell_aim *a, const struct packet *k,
                            const struct exits *exits, int i, float m)
{
    const struct pell_lanes *l = &k->lanes;
    const struct pell_vec3 to = vec3(a->lx[i], a->ly[i], a->lz[i]);
    const bool lifted = exits->terminator_offset[i] > TERMINATOR_LIFTED * l->epsilon[i]; /* the triangle does not decide the facing */
    const float mu = vec3_dot(exits->normal[i], to), facing = vec3_dot(exits->geometric[i], to);
    float g;

    if (!(mu > 0.0f) || !(facing > 0.0f || lifted))
        return 0.0f;
    g = lifted ? 1.0f : pell_thickness_facing(facing, mu, vec3_dot(exits->normal[i], exits->geometric[i]));
    g = pell_soft_terminator(transmittance(job, l, i, mu) * mu, g);
    return source->type == PELL_LIGHT_DIRECTIONAL ? g : g * falloff_at(source, a, i, m);
}

void pell_transmit_light(const struct job *job, const struct pell_light_source *source, struct pell_aim *a, struct packet *k)
{
    const struct pell_lanes *l = &k->lanes;
    const bool directional = source->type == PELL_LIGHT_DIRECTIONAL;
    struct pell_ray_hit16 r;
    struct exits exits;
    float cosine[PELL_LANES], arriving[3][PELL_LANES];
    int depth[PELL_LANES];

    for (int i = 0; i < PELL_LANES; i++)
        a->back[i] &= k->straight[i] & l->transmits[i];
    if (count_lanes(a->back) == 0) /* light inside the solid was solved everywhere */
        return;
    for (int i = 0; i < PELL_LANES; i++) {
        const bool out = a->gl[i] > 0.0f; /* the ray starts in air and crosses the entry surface */
        const struct pell_vec3 o = out ? vec3(l->ox[i], l->oy[i], l->oz[i]) : origin_inside(l, i);
        const struct pell_vec3 d = directional ? vec3(a->lx[i], a->ly[i], a->lz[i]) : vec3(a->sx[i] - o.x, a->sy[i] - o.y, a->sz[i] - o.z);
        const float reach = a->back[i] ? job->p->thickness[k->material[i]]->max_mm : 0.0f;
        float limit;
        cosine[i] = pell_thickness_cosine(a->nl[i], a->gl[i]);
        limit = reach / cosine[i]; /* d >= m cos: nothing is transmitted beyond */
        depth[i] = out ? -1 : 0;
        pell_ray16_set(&r.ray, i, o, d, directional ? limit : smaller(0.9999f, limit / a->distance[i]));
    }
    find_exits(job, k, a->back, source, &r, depth, &exits);
    if (count_lanes(exits.found) == 0)
        return;
    trace_to_light(job, source, a, k, &exits, arriving);
    for (int i = 0; i < PELL_LANES; i++) {
        float light[3], m, d, w, same;
        if (is_dark((const float(*)[PELL_LANES]) arriving, i))
            continue;
        m = vec3_length(vec3_sub(exits.point[i], vec3(l->px[i], l->py[i], l->pz[i])));
        w = entering_light(job, source, a, k, &exits, i, m);
        if (!(w > 0.0f))
            continue;
        same = vec3_dot(exits.normal[i], vec3(l->nx[i], l->ny[i], l->nz[i]));
        d = pell_thickness_of(m, cosine[i], same);
        transmitted_fraction(job, k, i, d, &exits.normal[i], same, true, light);
        for (int c = 0; c < 3; c++)
            light[c] = smaller(a->intensity[c][i] * arriving[c][i] * w * light[c], 1e25f);
        add_transmitted(k, i, light, d);
    }
}

/* Aims between the light's direction w and the direction toward the camera, to find exits of nearby light. Returns false if there is no
 * such direction. */
static bool aim_between(struct packet *k, int i, struct pell_vec3 w, struct pell_ray_hit16 *r)
{
    const struct pell_lanes *l = &k->lanes;
    const struct pell_vec3 v = vec3_load(k->toward[i]), u = vec3_normalize(vec3_add(w, v)), g = vec3(l->gx[i], l->gy[i], l->gz[i]);
    const bool found = vec3_dot(w, v) > 0.0f && vec3_dot(u, g) > MIN_FACING;

    pell_ray16_set(&r->ray, i, origin_inside(l, i), vec3_mul(found ? u : g, -1.0f), found ? PELL_INDIRECT_BEYOND * k->spacing[i] : 0.0f);
    return found;
}

void pell_transmit_forward(const struct job *job, const struct pell_light_source *source, const struct pell_aim *a, struct packet *k)
{
    const struct pell_lanes *l = &k->lanes;
    _Alignas(64) int32_t active[PELL_LANES];
    float arriving[3][PELL_LANES];
    struct pell_vec3 w[PELL_LANES];
    struct pell_ray_hit16 r;
    struct exits exits;

    for (int i = 0; i < PELL_LANES; i++) {
        active[i] = a->back[i] & -(int32_t) (k->forward_model[i] != NULL);
        w[i] = vec3(-a->lx[i], -a->ly[i], -a->lz[i]);
    }
    for (int step = 0; step < 2; step++) {
        int depth[PELL_LANES] = { 0 };
        for (int i = 0; i < PELL_LANES; i++)
            active[i] &= -(int32_t) aim_between(k, i, w[i], &r);
        find_exits(job, k, active, NULL, &r, depth, &exits);
        if (count_lanes(exits.found) == 0)
            return;
        for (int i = 0; i < PELL_LANES; i++) {
            const float to[3] = { a->lx[i], a->ly[i], a->lz[i] }, n[3] = { exits.normal[i].x, exits.normal[i].y, exits.normal[i].z };
            float out[3];
            active[i] = exits.found[i];
            if (!active[i])
                continue;
            pell_angle_inside(l->inverse_eta2[i], to, n, out);
            w[i] = vec3_mul(vec3_load(out), -1.0f);
        }
    }
    trace_to_light(job, source, a, k, &exits, arriving);
    for (int i = 0; i < PELL_LANES; i++) {
        const struct pell_indirect_forward *forward = k->forward_model[i];
        struct pell_vec3 path;
        float m, in, facing, near;
        if (is_dark((const float(*)[PELL_LANES]) arriving, i))
            continue;
        path = vec3_sub(vec3(l->px[i], l->py[i], l->pz[i]), exits.point[i]);
        m = vec3_length(path);
        near = 1.0f - pell_indirect_far_weight(m, k->spacing[i]);
        in = near * entering_light(job, source, a, k, &exits, i, m);
        facing = larger(-vec3_dot(exits.normal[i], path) / larger(m, 1e-20f), MIN_FACING);
        for (int c = 0; c < 3 && in > 0.0f; c++) {
            float cosine;
            const float left = pell_forward_broad(&forward->model, c, m, &cosine);
            const float toward = left > 0.0f ? pell_forward_phase(cosine, vec3_dot(w[i], vec3_load(k->toward[i]))) : 0.0f;
            k->forward[c][i] +=
                smaller(a->intensity[c][i] * arriving[c][i] * in * forward->exitance_scale[c] * left * toward / facing, 1e25f);
        }
    }
}

/* The environment's smooth part at a normal: the table without the environment's broad lights. */
static void smooth_environment(const struct job *job, const struct packet *k, int i, int index, struct pell_vec3 n, float rgb[3])
{
    const struct pell_env_query query = lane_query(job, k, i);

    pell_environment_irradiance(&job->lights->environments[index], n, &query, rgb);
    for (size_t j = 0; j < job->lights->num_sources; j++) {
        const struct pell_light_source *source = &job->lights->sources[j];
        const float mu = -vec3_dot(n, source->direction);
        if (source->environment != index || source->compact || !(mu > 0.0f))
            continue;
        const float w = mu * transmittance(job, &k->lanes, i, mu);
        for (int c = 0; c < 3; c++)
            rgb[c] -= w * source->power[c];
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = max0(rgb[c]);
}

/* Adds the environments' smooth part to lane i: a fraction of the light that enters at the normal n, `m` mm away. */
static void add_smooth_environment(const struct job *job, struct packet *k, int i, struct pell_vec3 n, const float fraction[3], float m)
{
    for (size_t e = 0; e < job->lights->num_environments; e++) {
        float rest[3];
        smooth_environment(job, k, i, (int) e, n, rest);
        for (int c = 0; c < 3; c++)
            rest[c] *= fraction[c];
        add_transmitted(k, i, rest, m);
    }
}

void pell_transmit_environment(const struct job *job, struct packet *k)
{
    const struct pell_lanes *l = &k->lanes;
    struct pell_sky sky;
    float visible[PELL_LANES];
    struct pell_ray_hit16 r;
    struct exits exits;
    int depth[PELL_LANES] = { 0 };

    for (int i = 0; i < PELL_LANES; i++)
        exits.found[i] = l->valid[i] & l->transmits[i] & k->straight[i];
    if (count_lanes(exits.found) == 0)
        return;
    for (int i = 0; i < PELL_LANES; i++) {
        const struct pell_vec3 g = vec3(l->gx[i], l->gy[i], l->gz[i]), n = vec3(l->nx[i], l->ny[i], l->nz[i]);
        pell_ray16_set(&r.ray, i, origin_inside(l, i), vec3_mul(vec3_dot(g, n) > 0.5f ? n : g, -1.0f),
                       l->valid[i] & l->transmits[i] ? job->p->thickness[k->material[i]]->max_mm : 0.0f);
    }
    memcpy(k->aim.back, exits.found, sizeof(exits.found));
    find_exits(job, k, k->aim.back, NULL, &r, depth, &exits);
    if (count_lanes(exits.found) == 0)
        return;
    for (int i = 0; i < PELL_LANES; i++) {
        struct pell_vec3 o = origin_inside(l, i), n = vec3(0.0f, 0.0f, 1.0f);
        if (exits.found[i]) {
            n = exits.geometric[i];
            o = vec3_mad(exits.point[i], exits.terminator_offset[i] + l->epsilon[i], n);
        }
        sky.origin[0][i] = o.x;
        sky.origin[1][i] = o.y;
        sky.origin[2][i] = o.z;
        sky.normal[0][i] = n.x;
        sky.normal[1][i] = n.y;
        sky.normal[2][i] = n.z;
    }
    pell_ambient_visibility(job, k, exits.found, PELL_BEYOND_SALT, &sky, visible);
    for (int i = 0; i < PELL_LANES; i++) {
        float fraction[3], m;
        if (!exits.found[i] || !(visible[i] > 0.0f))
            continue;
        m = vec3_length(vec3_sub(exits.point[i], vec3(l->px[i], l->py[i], l->pz[i])));
        transmitted_fraction(job, k, i, m, &exits.normal[i], vec3_dot(exits.normal[i], vec3(l->nx[i], l->ny[i], l->nz[i])), false,
                             fraction);
        for (int c = 0; c < 3; c++)
            fraction[c] *= visible[i];
        add_smooth_environment(job, k, i, exits.normal[i], fraction, m);
    }
}

void pell_read_environment_transmitted(const struct job *job, struct packet *k)
{
    for (int i = 0; i < k->count; i++) {
        struct pell_vec3 normal;
        float fraction[3], m;
        if (pell_read_exit(job, k, i, fraction, &m, &normal))
            add_smooth_environment(job, k, i, normal, fraction, m);
    }
}
