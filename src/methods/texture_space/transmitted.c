/* SPDX-License-Identifier: MIT
 *
 * transmitted.c - a texel and the entry point of its transmitted light: the thickness of the solid between them, and their distance.
 */
#include "methods/texture_space/transmitted.h"

#define SLAB_ANGLES 4.0f /* a face counts fully as a slab's if the light is at least 1/SLAB_ANGLES rad behind it */

struct ts_shading_point ts_flat_point(const struct ts_atlas *a, struct ts_surface_point p)
{
    struct ts_shading_point s;

    ts_point_of(a, p.triangle, p.u, p.v, &s.at, &s.geometric, &s.max_coordinate);
    s.normal = s.geometric;
    return s;
}

struct ts_shading_point ts_smooth_point(const struct ts_atlas *a, struct ts_surface_point p, struct ts_shading_point s)
{
    const struct pell_mesh *m = &a->scene->meshes[a->triangles[p.triangle].mesh];
    const uint32_t *index = m->index + 3 * (size_t) a->triangles[p.triangle].triangle;
    struct pell_vec3 n = { 0 };

    for (int k = 0; k < 3; k++)
        n = vec3_mad(n, k == 0 ? 1.0f - p.u - p.v : k == 1 ? p.u : p.v, vec3_load(m->normal + 3 * (size_t) index[k]));
    if (vec3_dot(n, s.geometric) > 0.0f)
        s.normal = vec3_normalize(n);
    return s;
}

struct ts_shading_point ts_shading_point_of(const struct ts_atlas *a, struct ts_surface_point p)
{
    return ts_smooth_point(a, p, ts_flat_point(a, p));
}

struct ts_surface_point ts_point_at(const struct ts_atlas *a, ptrdiff_t at)
{
    return (struct ts_surface_point) { a->source[at], a->bary[0][at], a->bary[1][at] };
}

struct ts_shading_point ts_shading_point_at(const struct ts_atlas *a, ptrdiff_t at)
{
    return ts_shading_point_of(a, ts_point_at(a, at));
}

bool ts_needs_ray(const struct ts_task *t, ptrdiff_t at)
{
    const bool away = t->faces[t->p->atlas->source[at]] & TS_FACE_AWAY;

    if (t->p->need && !t->p->need[at])
        return false;
    return t->p->at_once ? true : t->lit ? !away && !(t->lit[0][at] + t->lit[1][at] + t->lit[2][at] > 0.0f) : away;
}

/* Thickness between two faces m apart, seen from C along the unit direction. */
static float thickness_of(const struct ts_task *t, const struct ts_shading_point *a, const struct ts_shading_point *c, struct pell_vec3 dir,
                          float m, float *opposed)
{
    const float away = fmaxf(-vec3_dot(c->normal, dir), 0.0f);

    *opposed = fmaxf(0.0f, -vec3_dot(a->normal, c->normal));
    if (t->p->printed) /* section 5.2: m lerped to m cos by the normals' cosine */
        return m + *opposed * (m * away - m);
    /* The faces of a slab are opposed: one faces the light, the other one faces away from it. */
    *opposed *= fminf(away * SLAB_ANGLES, 1.0f);
    /* On a slab both cosines are equal; at an edge the face at the smaller angle gives the better estimate. */
    return m + *opposed * (m * fminf(fmaxf(away, vec3_dot(a->normal, dir)), 1.0f) - m);
}

bool ts_transmit(const struct ts_task *t, ptrdiff_t at, const struct ts_shading_point *c, struct ts_surface_point entry,
                 struct pell_vec3 dir, struct pell_vec3 light, struct ts_transmitted_texel *out)
{
    const struct ts_atlas *a = t->p->atlas;
    const struct ts_shading_point s = ts_shading_point_of(a, entry);
    const float m = vec3_length(vec3_sub(s.at, c->at));
    float opposed;
    const float d = thickness_of(t, &s, c, dir, m, &opposed);

    out->at = (int32_t) at;
    out->from = ts_atlas_locate(a, entry.triangle, entry.u, entry.v);
    if (out->from.at < 0 || !(vec3_dot(s.geometric, light) > 0.0f) || !((double) d < t->p->thickest))
        return false;
    if (out->from.key == a->key[at]) {
        const ptrdiff_t from = out->from.at, x = at % a->stride, y = at / a->stride;
        const ptrdiff_t entry_x = from % a->stride, entry_y = from / a->stride;
        const float *const length[2] = { a->length[0], a->length[1] };
        const float dx = (float) (entry_x - x) + out->from.fx, dy = (float) (entry_y - y) + out->from.fy;
        const ptrdiff_t there = a->key[from] == out->from.key ? from : at;
        const float lx = 0.5f * (length[0][at] + length[0][there]), ly = 0.5f * (length[1][at] + length[1][there]);
        const float along = (dx + 0.5f * (a->skew[at] + a->skew[there]) * dy) * lx;
        out->surface_distance = sqrtf(along * along + dy * ly * dy * ly);
        out->along_surface = true;
    } else {
        out->surface_distance = m;
        out->along_surface = false;
    }
    out->second_weight = 0.0f;
    out->opposed = opposed;
    out->normal = s.normal;
    out->cosine = vec3_dot(s.normal, dir);
    out->m = m;
    t->alpha[at] = expf(-d / (float) t->p->falloff);
    return true;
}
