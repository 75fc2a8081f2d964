/* SPDX-License-Identifier: MIT
 * lookup.c - interpolation from knots to points, 16 at a time. */
#include "render/indirect/internal.h"

#include "render/angle.h"
#include "render/camera_view.h"

#include <string.h>

void pell_indirect_at(const struct pell_indirect *in, const struct pell_points16 *at, const int32_t *back, float rgb[4][16],
                      float behind[4][16])
{
    static const float zero_row[4] = { 0.0f };
    const struct pell_scene *scene = in->p.scene;
    struct indirect_rows own_rows, behind_rows;

    for (int i = 0; i < 16; i++) {
        const uint32_t mesh = at->mesh[i];
        uint32_t knot[3] = { 0 };
        float weight[3] = { 0.0f };
        const bool valid = mesh < scene->num_meshes && at->triangle[i] < scene->meshes[mesh].num_triangles &&
                           (!back[i] || scene->materials[scene->meshes[mesh].material].opaque);
        if (valid)
            indirect_find(in, mesh, at->triangle[i], at->u[i], at->v[i], knot, weight);
        for (int k = 0; k < 3; k++) {
            const size_t value = valid ? indirect_value_of(in, mesh, knot[k], back[i]) : 0;
            own_rows.row[k][i] = valid ? in->value[value] : zero_row;
            behind_rows.row[k][i] = valid && in->behind ? in->behind[value] : zero_row;
            own_rows.weight[k][i] = behind_rows.weight[k][i] = weight[k];
        }
    }
    in->kernels->blend(&own_rows, 4, rgb);
    if (behind && in->behind)
        in->kernels->blend(&behind_rows, 4, behind);
    else if (behind)
        memset(behind, 0, 4 * sizeof(*behind));
}

void pell_indirect_lookup16(const struct pell_indirect *in, const struct pell_points16 *at, const int32_t *active,
                            struct pell_indirect_insides *out)
{
    static const union indirect_inside zero = { .all = { 0.0f } };
    const struct pell_scene *scene = in->p.scene;
    struct indirect_rows rows, beams;

    for (int i = 0; i < 16; i++) {
        uint32_t knot[3] = { 0 };
        float weight[3] = { 0.0f };
        const bool valid = active[i] && at->mesh[i] < scene->num_meshes && at->triangle[i] < scene->meshes[at->mesh[i]].num_triangles;
        if (valid)
            indirect_find(in, at->mesh[i], at->triangle[i], at->u[i], at->v[i], knot, weight);
        for (int k = 0; k < 3; k++) {
            rows.row[k][i] = valid ? in->inside[knot[k]].all : zero.all;
            beams.row[k][i] = valid && in->beam ? in->beam[knot[k]].light : zero.all;
            rows.weight[k][i] = beams.weight[k][i] = weight[k];
        }
    }
    in->kernels->blend(&rows, INDIRECT_INSIDE, out->sum_weight);
    out->beams = in->beam != NULL;
    if (out->beams)
        in->kernels->blend(&beams, INDIRECT_BEAM, out->beam);
}

bool pell_indirect_has_beams(const struct pell_indirect *in)
{
    return in->beam != NULL;
}

const struct pell_indirect_forward *pell_indirect_forward(const struct pell_indirect *in, size_t material)
{
    return in->forward && material < in->p.scene->num_materials && in->forward[material].active ? &in->forward[material] : NULL;
}

struct correct {
    const struct pell_indirect *in;
    const struct pell_view *view;
    const struct pell_angle *angle;
    const struct pell_surface *surface;
    float *const *exitance;
};

/* Factor of light from the depth that leaves toward the camera; q: at the pixel, lane i of 16. */
static float exit_factor(const struct correct *t, int x, int y, const struct pell_indirect_insides *q, int i, int c)
{
    const struct pell_surface *s = t->surface;
    const ptrdiff_t at = y * s->stride + x;
    const struct pell_angle *a = &t->angle[s->material[at] - 1];
    const struct pell_vec3 n = vec3(s->ns[0][at], s->ns[1][at], s->ns[2][at]);
    const struct pell_vec3 tilt = vec3(q->tilt[c][0][i], q->tilt[c][1][i], q->tilt[c][2][i]);
    struct pell_vec3 start, v;
    float nv, pass;

    pell_view_ray(t->view, (float) x, (float) y, &start, &v);
    v = vec3_mul(vec3_normalize(v), -1.0f);
    nv = fminf(fmaxf(vec3_dot(n, v), 0.0f), 1.0f);
    pass = a->pass_base[c] + a->pass_slope[c] * pell_angle_off(a->inverse_eta2, nv);
    return (1.0f + q->deep[c][i] * (pass - 1.0f)) * pell_gradient_exit(a->inverse_eta2, vec3_dot(vec3_mad(v, -nv, n), tilt));
}

/* Corrects the 16 pixels from x0 on. */
static void correct16(const struct correct *t, int x0, int y)
{
    const struct pell_surface *s = t->surface;
    struct pell_indirect_insides q;
    struct pell_points16 hits;
    _Alignas(64) int32_t active[16];
    int any = 0;

    for (int i = 0; i < 16; i++) {
        const ptrdiff_t at = y * s->stride + x0 + i;
        const uint16_t material = x0 + i < s->translucent.x1 ? s->material[at] : 0;
        active[i] = -(int32_t) (material && !t->in->p.scene->materials[material - 1].opaque);
        any |= active[i];
        hits.mesh[i] = active[i] ? s->mesh[at] : 0;
        hits.triangle[i] = active[i] ? s->triangle[at] : 0;
        hits.u[i] = active[i] ? s->barycentric[0][at] : 0.0f;
        hits.v[i] = active[i] ? s->barycentric[1][at] : 0.0f;
    }
    if (!any)
        return;
    pell_indirect_lookup16(t->in, &hits, active, &q);
    for (int i = 0; i < 16; i++)
        for (int c = 0; active[i] && c < 3; c++)
            t->exitance[c][y * s->stride + x0 + i] *=
                q.gain[c][i] * (t->angle ? exit_factor(t, x0 + i, y, &q, i, c) : 1.0f) + (1.0f - q.solved[c][i]) + q.thin[c][i];
}

static void correct_row(void *arg, int index, int worker)
{
    const struct correct *t = arg;

    (void) worker;
    for (int x = t->surface->translucent.x0; x < t->surface->translucent.x1; x += 16)
        correct16(t, x, t->surface->translucent.y0 + index);
}

void pell_indirect_correct(const struct pell_indirect *in, struct pell_pool *pool, const struct pell_view *view,
                           const struct pell_angle *angle, const struct pell_surface *surface, float *const exitance[3])
{
    struct correct t = { in, view, angle, surface, exitance };

    pell_pool_run(pool, surface->translucent.y1 - surface->translucent.y0, correct_row, &t);
}
