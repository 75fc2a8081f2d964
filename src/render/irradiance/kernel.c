/* SPDX-License-Identifier: MIT
 *
 * kernel.c - see kernel.h. Compiled once per SIMD level; plain loops over 16 lanes.
 *
 *     E += L_i T(n.w) max(n.w, 0) V,  T = 1 - rho_s albedo_f or F_t
 *     soft terminator: G = min(1, ng.l / (n.l n.ng)),  factor -G^3 + G^2 + G   (Chiang, Li and Burley 2019, "Taming the Shadow Terminator")
 *
 * The soft terminator fades light out smoothly where the geometric normal turns away, and changes nothing where the normals agree.
 */
#include "render/irradiance/lanes.h"

#include "shared/single.h"
#include "shared/spread.h"
#include "shared/wide_light.h"

#include <float.h>
#include <string.h>

static void finish_aim(const struct pell_lanes *restrict p, struct pell_aim *restrict a)
{
    int32_t front = 0, back = 0;

    for (int i = 0; i < N; i++) {
        const float gl = p->gx[i] * a->lx[i] + p->gy[i] * a->ly[i] + p->gz[i] * a->lz[i];
        const float nl = p->nx[i] * a->lx[i] + p->ny[i] * a->ly[i] + p->nz[i] * a->lz[i];
        const int32_t lit =
            p->valid[i] & -(int32_t) (a->falloff[i] * (a->intensity[0][i] + a->intensity[1][i] + a->intensity[2][i]) > 0.0f);
        a->gl[i] = gl;
        a->nl[i] = nl;
        a->front[i] = lit & -(int32_t) pell_lane_fronts(p, i, gl) & -(int32_t) (nl > 0.0f);
        a->back[i] = lit & (p->transmits[i] | p->scatters_forward[i]) &
                     ~a->front[i]; /* by the triangle or the normal alone: near the terminator they
                                                                       * differ */
        front |= a->front[i];
        back |= a->back[i];
    }
    a->any_front = front != 0;
    a->any_back = back != 0;
}

/* Samples a direction of an environment's light: `direction` is the mean of the samples of its rectangle. */
static void aim_around(const struct pell_light_data *restrict light, const struct pell_lanes *restrict p, uint32_t u0, uint32_t u1,
                       struct pell_aim *restrict a)
{
    const struct pell_vec4 d = light->direction, right = light->right, up = light->up;

    for (int i = 0; i < N; i++) {
        const float x = 2.0f * pell_unit_float(u0 ^ (p->pattern[0][i] & p->pattern_mask)) - 1.0f;
        const float y = 2.0f * pell_unit_float(u1 ^ (p->pattern[1][i] & p->pattern_mask)) - 1.0f;
        const float lx = d.x + x * right.x + y * up.x, ly = d.y + x * right.y + y * up.y, lz = d.z + x * right.z + y * up.z;
        const float inverse = 1.0f / sqrtf(lx * lx + ly * ly + lz * lz);
        a->lx[i] = -lx * inverse;
        a->ly[i] = -ly * inverse;
        a->lz[i] = -lz * inverse;
    }
}

static void aim_directional(const struct pell_light_data *restrict light, const struct pell_lanes *restrict p, uint32_t u0, uint32_t u1,
                            struct pell_aim *restrict a)
{
    const float power[3] = { light->power.x, light->power.y, light->power.z };

    if (light->environment >= 0)
        aim_around(light, p, u0, u1, a);
    else
        for (int i = 0; i < N; i++) {
            a->lx[i] = -light->direction.x;
            a->ly[i] = -light->direction.y;
            a->lz[i] = -light->direction.z;
        }
    for (int i = 0; i < N; i++) {
        a->distance[i] = FLT_MAX;
        a->falloff[i] = 1.0f;
        a->solid_angle[i] = 0.0f;
        for (int c = 0; c < 3; c++)
            a->intensity[c][i] = power[c];
    }
}

/* Sets the sample positions: the centre of the light, or samples over an area light. */
static void sample_light(const struct pell_light_data *restrict light, const struct pell_lanes *restrict p, uint32_t u0, uint32_t u1,
                         struct pell_aim *restrict a)
{
    const bool disc = light->type == PELL_LIGHT_DATA_DISC;

    if (light->type != PELL_LIGHT_DATA_RECT && !disc) {
        for (int i = 0; i < N; i++) {
            a->sx[i] = light->position.x;
            a->sy[i] = light->position.y;
            a->sz[i] = light->position.z;
        }
        return;
    }
    for (int i = 0; i < N; i++) {
        const uint32_t at0 = u0 ^ p->pattern[0][i], at1 = u1 ^ p->pattern[1][i];
        const float u = pell_unit_float(at0), v = pell_unit_float(at1);
        float x, y;
        a->at[0][i] = at0;
        a->at[1][i] = at1;
        pell_disc_point(u, v, &x, &y);
        x = disc ? x : 2.0f * u - 1.0f;
        y = disc ? y : 2.0f * v - 1.0f;
        a->sx[i] = light->position.x + x * light->right.x + y * light->up.x;
        a->sy[i] = light->position.y + x * light->right.y + y * light->up.y;
        a->sz[i] = light->position.z + x * light->right.z + y * light->up.z;
    }
}

/* The light as seen from a point, `to` its centre; `half`: its half extents. Returns false if it is small from there, faces away, or the
 * point is in its plane. */
static bool make_wide(const struct pell_light_data *light, const float half[2], struct pell_vec3 to, struct pell_wide *w)
{
    const float half_x = half[0], half_y = half[1], area = 4.0f * half_x * half_y;
    const float h = -(to.x * light->direction.x + to.y * light->direction.y + to.z * light->direction.z);
    float x, y, outside_x, outside_y;

    if (!(h > 0.0f) || area < PELL_WIDE_LIGHT * h * h) /* early out for most lights */
        return false;
    x = (to.x * light->right.x + to.y * light->right.y + to.z * light->right.z) / half_x;
    y = (to.x * light->up.x + to.y * light->up.y + to.z * light->up.z) / half_y;
    outside_x = fmaxf(fabsf(x) - half_x, 0.0f);
    outside_y = fmaxf(fabsf(y) - half_y, 0.0f);
    if (area < PELL_WIDE_LIGHT * (h * h + outside_x * outside_x + outside_y * outside_y))
        return false;
    *w = pell_wide_make(x, y, half_x, half_y, h);
    return w->angle > 1e-3f;
}

/* Samples a wide light by solid angle; wide[i]: solid angle of the sample, sr, 0: sample by area, -1: no light there. For a disc,
 * samples of the bounding square that are outside the disc are dropped. */
static void sample_wide_light(const struct pell_light_data *light, const struct pell_lanes *p, struct pell_aim *a, float wide[N])
{
    const float half[2] = { vec3_length(vec3(light->right.x, light->right.y, light->right.z)),
                            vec3_length(vec3(light->up.x, light->up.y, light->up.z)) };
    const bool disc = light->type == PELL_LIGHT_DATA_DISC;
    const float inverse_samples = light->power.w / ((disc ? PELL_PI_F : 4.0f) * half[0] * half[1]);

    for (int i = 0; i < N; i++) {
        const struct pell_vec3 to = vec3(light->position.x - p->px[i], light->position.y - p->py[i], light->position.z - p->pz[i]);
        struct pell_point2 at;
        struct pell_wide w;
        float x, y;
        wide[i] = 0.0f;
        if (!p->valid[i] || !make_wide(light, half, to, &w))
            continue;
        at = pell_wide_sample(w, pell_unit_float(a->at[0][i]), pell_unit_float(a->at[1][i]));
        x = at.x;
        y = at.y;
        wide[i] = disc && x * x + y * y > 1.0f ? -1.0f : w.angle * inverse_samples;
        a->at[0][i] = (uint32_t) (fminf(0.5f + 0.5f * x, 0.9999999f) * 4294967296.0f);
        a->at[1][i] = (uint32_t) (fminf(0.5f + 0.5f * y, 0.9999999f) * 4294967296.0f);
        a->sx[i] = light->position.x + x * light->right.x + y * light->up.x;
        a->sy[i] = light->position.y + x * light->right.y + y * light->up.y;
        a->sz[i] = light->position.z + x * light->right.z + y * light->up.z;
    }
}

static void aim(const struct pell_light_data *restrict light, const struct pell_lanes *restrict p, uint32_t u0, uint32_t u1,
                struct pell_aim *restrict a)
{
    const struct pell_vec4 d = light->direction;
    const float area = light->power.w, power[3] = { light->power.x, light->power.y, light->power.z };
    const bool has_area = pell_light_is_area(light);
    const float is_spot = light->type == PELL_LIGHT_DATA_SPOT ? 1.0f : 0.0f;
    float wide[N];

    if (light->type == PELL_LIGHT_DATA_DIRECTIONAL) {
        aim_directional(light, p, u0, u1, a);
        finish_aim(p, a);
        return;
    }
    sample_light(light, p, u0, u1, a);
    if (has_area)
        sample_wide_light(light, p, a, wide);
    for (int i = 0; i < N; i++) {
        const float x = a->sx[i] - p->px[i], y = a->sy[i] - p->py[i], z = a->sz[i] - p->pz[i];
        const float d2 = x * x + y * y + z * z, length = sqrtf(d2 > TINY ? d2 : TINY), inv = 1.0f / length;
        a->lx[i] = x * inv;
        a->ly[i] = y * inv;
        a->lz[i] = z * inv;
        a->distance[i] = length;
        a->falloff[i] = pell_light_falloff(length, light->position.w, light->direction.w);
    }
    for (int i = 0; i < N; i++) {
        /* cosine at the light: to the normal of an area light, or to the axis of a spot */
        const float back = -(d.x * a->lx[i] + d.y * a->ly[i] + d.z * a->lz[i]), cosine = back > 0.0f ? back : 0.0f;
        const float spot = pell_light_cone(back, light->spot_scale, light->spot_offset), w = has_area         ? cosine
                                                                                             : is_spot > 0.0f ? spot
                                                                                                              : 1.0f;
        for (int c = 0; c < 3; c++)
            a->intensity[c][i] = power[c] * w;
        a->solid_angle[i] = area * cosine / (a->distance[i] * a->distance[i]);
    }
    for (int i = 0; has_area && i < N; i++) {
        if (wide[i] == 0.0f)
            continue;
        a->falloff[i] = 1.0f;
        a->solid_angle[i] = fmaxf(wide[i], 0.0f);
        for (int c = 0; c < 3; c++)
            a->intensity[c][i] = power[c] / area * a->solid_angle[i];
    }
    finish_aim(p, a);
}

static void shadow_rays(const struct pell_light_data *light, const struct pell_lanes *restrict p, const struct pell_aim *restrict a,
                        struct pell_ray16 *restrict r)
{
    for (int i = 0; i < N; i++) {
        r->ox[i] = p->ox[i];
        r->oy[i] = p->oy[i];
        r->oz[i] = p->oz[i];
        r->dx[i] = a->sx[i] - p->ox[i];
        r->dy[i] = a->sy[i] - p->oy[i];
        r->dz[i] = a->sz[i] - p->oz[i];
        r->tnear[i] = 0.0f;
        r->tfar[i] = 0.9999f;
        r->time[i] = 0.0f;
        r->mask[i] = PELL_RAY_ALL;
        r->id[i] = 0;
        r->flags[i] = 0;
    }
    if (light->type == PELL_LIGHT_DATA_DIRECTIONAL)
        for (int i = 0; i < N; i++) {
            r->dx[i] = a->lx[i];
            r->dy[i] = a->ly[i];
            r->dz[i] = a->lz[i];
            r->tfar[i] = FLT_MAX;
        }
}

/* T(n.l) per lane: table positions, then table values, then the arithmetic, so that the first and last loops are vectorized. */
static void transmittance(const struct pell_shade_tables *t, const struct pell_lanes *restrict p, const float *restrict mu,
                          float *restrict out)
{
    _Alignas(64) float f[N], near[4][N], beyond[4][N];
    _Alignas(64) int32_t at[N];

    for (int i = 0; i < N; i++) {
        const float coord = pell_cosine_coord(pell_saturate(mu[i]), PELL_ALBEDO_MU);
        const int32_t k = pell_table_cell(coord, PELL_ALBEDO_MU);
        f[i] = coord - (float) k;
        at[i] = p->albedo_at[i] + 2 * PELL_ALBEDO_ROUGHNESS * k;
    }
    for (int i = 0; i < N; i++) {
        const float *q = t->albedo + at[i], *r = q + 2 * PELL_ALBEDO_ROUGHNESS;
        for (int k = 0; k < 4; k++) {
            near[k][i] = q[k];
            beyond[k][i] = r[k];
        }
    }
    for (int i = 0; i < N; i++) {
        const float g = p->roughness_fraction[i];
        const float scale = pell_bilinear(near[0][i], near[2][i], beyond[0][i], beyond[2][i], g, f[i]);
        const float bias = pell_bilinear(near[1][i], near[3][i], beyond[1][i], beyond[3][i], g, f[i]);
        out[i] = pell_transmittance(p->rho[i], p->fd[i], scale, bias);
    }
    if (p->any_smooth)
        for (int i = 0; i < N; i++) {
            const float smooth = pell_boundary_lookup(t->boundary + p->boundary_at[i], mu[i]);
            out[i] = p->smooth[i] ? smooth : out[i];
        }
}

/* Adds light that is scattered once right below the surface, as it arrives there again. */
static void add_single(const struct pell_lanes *restrict p, const struct pell_aim *restrict a, const float *restrict facing,
                       const float *restrict transmitted, struct pell_sums *restrict sums)
{
    _Alignas(64) float in[N], out[N], cosine[N];

    for (int i = 0; i < N; i++) {
        const float nl = pell_saturate(a->nl[i]), nv = pell_saturate(p->nv[i]);
        const float outside = a->lx[i] * p->vx[i] + a->ly[i] * p->vy[i] + a->lz[i] * p->vz[i];
        in[i] = pell_single_cosine(p->single_eta2[i], nl);
        out[i] = pell_single_cosine(p->single_eta2[i], nv);
        cosine[i] = pell_single_phase_cosine(p->single_eta2[i], outside, nl, nv, in[i], out[i]);
    }
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float radiance = pell_single_radiance(p->single_albedo[c][i], p->single_g[c][i], cosine[i], in[i], out[i]);
            const float add = a->intensity[c][i] * a->falloff[i] * transmitted[i] * facing[i] * radiance, limited = add < BIG ? add : BIG;
            sums->single[c][i] += facing[i] > 0.0f && p->single_albedo[c][i] > 0.0f ? limited : 0.0f;
        }
}

/* Adds the refracted directions of entering light, and the part that the curvature of the surface moves there. */
static void add_direction(const struct pell_lanes *restrict p, const struct pell_aim *restrict a, const float *restrict facing,
                          const float *restrict transmitted, const float *restrict off, struct pell_sums *restrict sums)
{
    _Alignas(64) float enters[N] = { 0.0f };

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float mu = a->nl[i] > 1e-6f ? a->nl[i] : 1e-6f, factor = p->enter_base[c][i] + p->enter_slope[c][i] * off[i];
            const float bent = facing[i] + p->shift[c][i] * (1.0f - 3.0f * mu * mu), moved = bent > 0.0f ? bent : 0.0f;
            const float each = a->intensity[c][i] * a->falloff[i] * transmitted[i] * factor;
            const float add = facing[i] > 0.0f ? each * facing[i] : 0.0f;
            sums->shifted[c][i] += facing[i] > 0.0f ? each * moved - add : 0.0f;
            enters[i] += add < BIG ? add : BIG;
        }
    for (int i = 0; i < N; i++) {
        const float nl = a->nl[i] > 0.0f ? a->nl[i] : 0.0f, cos2_t = 1.0f - (1.0f - nl * nl) * p->inverse_eta2[i];
        const float inverse_eta = sqrtf(p->inverse_eta2[i]), along_n = nl * inverse_eta - sqrtf(cos2_t > 0.0f ? cos2_t : 0.0f);
        sums->direction_in[0][i] += enters[i] * (along_n * p->nx[i] - inverse_eta * a->lx[i]);
        sums->direction_in[1][i] += enters[i] * (along_n * p->ny[i] - inverse_eta * a->ly[i]);
        sums->direction_in[2][i] += enters[i] * (along_n * p->nz[i] - inverse_eta * a->lz[i]);
        sums->direction_weight[i] += enters[i];
    }
}

static void add_unshadowed(const struct pell_aim *restrict a, const float *restrict transmitted, struct pell_sums *restrict sums)
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float mu = a->nl[i] > 0.0f ? a->nl[i] : 0.0f, add = a->intensity[c][i] * a->falloff[i] * transmitted[i] * mu;
            sums->unshadowed[c][i] += add < BIG ? add : BIG;
        }
}

static void front(const struct pell_light_data *light, const struct pell_shade_tables *t, const struct pell_lanes *restrict p,
                  const struct pell_aim *restrict a, const int32_t *restrict visible, struct pell_gloss *gloss,
                  struct pell_sums *restrict sums)
{
    const bool has_area = pell_light_is_area(light);
    _Alignas(64) float mu[N], transmitted[N], unoccluded[N], facing[N], off[N];

    for (int i = 0; i < N; i++) {
        const float nl = a->nl[i] > 1e-6f ? a->nl[i] : 1e-6f, lit = pell_lane_facing(p, i, nl, a->gl[i]);
        mu[i] = nl;
        unoccluded[i] = a->front[i] ? lit : 0.0f;
        facing[i] = visible[i] ? unoccluded[i] : 0.0f;
    }
    transmittance(t, p, mu, transmitted);
    for (int i = 0; i < N; i++)
        off[i] = pell_angle_off(p->inverse_eta2[i], mu[i]);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float factor = p->enter_base[c][i] + p->enter_slope[c][i] * off[i];
            const float bent = unoccluded[i] + p->shift[c][i] * (1.0f - 3.0f * mu[i] * mu[i]), enters = bent > 0.0f ? bent : 0.0f;
            const float add = a->intensity[c][i] * a->falloff[i] * transmitted[i] * factor * enters, limited = add < BIG ? add : BIG;
            sums->irradiance[c][i] += facing[i] > 0.0f ? limited : 0.0f;
            sums->lost[c][i] += has_area && unoccluded[i] > facing[i] ? limited : 0.0f;
        }
    if (pell_light_in_table(light))
        add_unshadowed(a, transmitted, sums);
    if (p->any_direction)
        add_direction(p, a, facing, transmitted, off, sums);
    if (p->any_single)
        add_single(p, a, facing, transmitted, sums);
    if (gloss)
        PELL_SIMD(pell_add_highlight)(light, p, a, unoccluded, mu, visible, gloss);
}

/* What passes was counted as lost, and no longer is. */
static void pass(const struct pell_light_data *light, const struct pell_shade_tables *t, const struct pell_lanes *restrict p,
                 const struct pell_aim *restrict a, const int32_t *restrict mask, const float (*restrict through)[N],
                 struct pell_sums *restrict sums)
{
    const float share = pell_light_is_area(light) ? 1.0f : 0.0f;
    struct pell_sums passed = { 0 };
    struct pell_aim dim = *a;

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++)
            dim.intensity[c][i] *= through[c][i];
    memcpy(dim.front, mask, sizeof(dim.front));
    front(light, t, p, &dim, mask, NULL, &passed);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            sums->irradiance[c][i] += passed.irradiance[c][i];
            sums->single[c][i] += passed.single[c][i];
            sums->shifted[c][i] += passed.shifted[c][i];
            sums->direction_in[c][i] += passed.direction_in[c][i];
            sums->lost[c][i] -= share * passed.irradiance[c][i];
        }
    for (int i = 0; i < N; i++)
        sums->direction_weight[i] += passed.direction_weight[i];
}

static void unshadowed(const struct pell_shade_tables *t, const struct pell_lanes *restrict p, const struct pell_aim *restrict a,
                       struct pell_sums *restrict sums)
{
    _Alignas(64) float mu[N], transmitted[N];
    int32_t any_facing = 0;

    for (int i = 0; i < N; i++) {
        mu[i] = a->nl[i] > 0.0f ? a->nl[i] : 0.0f;
        any_facing |= -(int32_t) (mu[i] > 0.0f);
    }
    if (!any_facing)
        return;
    transmittance(t, p, mu, transmitted);
    add_unshadowed(a, transmitted, sums);
}

/* --- Loading ------------------------------------------------------------------------------------------------------------------ */

/* Most packets are 4 x 4 pixels: four rows of four floats of a plane. Returns the stride of the rows, or 0. */
static inline ptrdiff_t row_stride(const int32_t *restrict index)
{
    const int32_t stride = index[4] - index[0];
    int32_t differ = 0;

    for (int i = 0; i < N; i++)
        differ |= index[i] ^ (index[0] + (i >> 2) * stride + (i & 3));
    return differ ? 0 : stride;
}

static inline void gather(const float *restrict plane, const int32_t *restrict index, ptrdiff_t rows, float *restrict out)
{
    if (rows) {
        const float *p = plane + index[0];
        for (int j = 0; j < 4; j++)
            memcpy(out + 4 * j, p + rows * j, 4 * sizeof(float));
        return;
    }
    for (int i = 0; i < N; i++)
        out[i] = plane[index[i]];
}

static void load_pixels(const struct pell_lane_input *input, const float *restrict depth, const int32_t *restrict x,
                        const int32_t *restrict y, struct pell_lanes *restrict p)
{
    const struct pell_view v = *input->view;
    const uint32_t seed = pell_hash(input->seed);
    const float ortho = v.orthographic ? 1.0f : 0.0f, inv = 1.0f / v.focal_px;
    const float cx = (0.5f + v.shift_x - 0.5f * (float) v.width) * inv, cy = (0.5f * (float) v.height - 0.5f - v.shift_y) * inv;

    for (int i = 0; i < N; i++) {
        /* as in pell_view_ray: a perspective ray's offset grows with depth, an orthographic one starts next to the camera */
        const float sx = (float) x[i] * inv + cx, sy = cy - (float) y[i] * inv, scale = ortho + (1.0f - ortho) * depth[i];
        const float dx = (1.0f - ortho) * sx, dy = (1.0f - ortho) * sy;
        const float wx = v.forward.x + dx * v.right.x + dy * v.up.x, wy = v.forward.y + dx * v.right.y + dy * v.up.y;
        const float wz = v.forward.z + dx * v.right.z + dy * v.up.z, toward = -1.0f / sqrtf(wx * wx + wy * wy + wz * wz);
        const float px = v.origin.x + depth[i] * v.forward.x + scale * (sx * v.right.x + sy * v.up.x);
        const float py = v.origin.y + depth[i] * v.forward.y + scale * (sx * v.right.y + sy * v.up.y);
        const float pz = v.origin.z + depth[i] * v.forward.z + scale * (sx * v.right.z + sy * v.up.z);
        const float ax = fabsf(px), ay = fabsf(py), az = fabsf(pz), axy = ax > ay ? ax : ay;
        p->px[i] = px;
        p->py[i] = py;
        p->pz[i] = pz;
        p->vx[i] = wx * toward;
        p->vy[i] = wy * toward;
        p->vz[i] = wz * toward;
        /* about 50 units in the last place of the largest coordinate */
        p->epsilon[i] = 6e-6f * ((axy > az ? axy : az) + depth[i]);
    }
    for (int i = 0; i < N; i++) {
        const uint32_t px = (uint32_t) x[i], py = (uint32_t) y[i];
        const uint32_t block = pell_hash(px >> PELL_CURVE_LEVELS ^ pell_hash(py >> PELL_CURVE_LEVELS ^ seed));
        p->curve[i] = pell_pixel_curve(px, py, seed);
        p->first[i] = pell_hash(px ^ pell_hash(py ^ seed));
        p->hash[0][i] = pell_hash(block ^ 0x68bc21ebu);
        p->hash[1][i] = pell_hash(block ^ 0x02e5be93u);
    }
}

/* The same for points that are not seen by the camera. */
static void load_points(const struct pell_lane_input *input, const float *restrict depth, const int32_t *restrict index,
                        const int32_t *restrict x, const int32_t *restrict y, struct pell_lanes *restrict p)
{
    const uint32_t seed = pell_hash(input->seed);

    for (int i = 0; i < N; i++) {
        const uint32_t hash = pell_hash((uint32_t) x[i] ^ pell_hash((uint32_t) y[i] ^ seed));
        p->px[i] = input->position[0][index[i]];
        p->py[i] = input->position[1][index[i]];
        p->pz[i] = input->position[2][index[i]];
        p->vx[i] = p->gx[i];
        p->vy[i] = p->gy[i];
        p->vz[i] = p->gz[i];
        p->epsilon[i] = 6e-6f * depth[i];
        p->curve[i] = p->first[i] = 0;
        p->hash[0][i] = pell_hash(hash ^ 0x68bc21ebu);
        p->hash[1][i] = pell_hash(hash ^ 0x02e5be93u);
    }
}

static void load_roughness(struct pell_lanes *restrict p)
{
    for (int i = 0; i < N; i++) {
        const float r = p->roughness[i], width = pell_lobe_width(p->model[i], r);
        const float y = pell_roughness_coord(r, PELL_ROUGHNESS_MIN, PELL_ALBEDO_ROUGHNESS);
        const int32_t k = pell_table_cell(y, PELL_ALBEDO_ROUGHNESS);
        p->width2[i] = width * width + 2.0f * p->slope_variance[i];
        p->roughness_fraction[i] = y - (float) k;
        p->albedo_at[i] += 2 * k;
        p->rho[i] = (p->tint[0][i] + p->tint[1][i] + p->tint[2][i]) * (1.0f / 3.0f);
    }
}

static void load_material(const float base[3][N], const float *restrict metallic, struct pell_lanes *restrict p)
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float solid = base[c][i] * (1.0f - metallic[i]);
            p->f0[c][i] = p->fd[i] + metallic[i] * (base[c][i] - p->fd[i]);
            p->albedo[c][i] = p->opaque[i] ? solid : 1.0f;
        }
}

/* Sets the values that the planes would have for this material. */
static void load_uniform(const struct pell_material *m, struct pell_lanes *restrict p)
{
    const struct pell_surface_uniform e = pell_surface_uniform(m);

    for (int i = 0; i < N; i++)
        p->roughness[i] = e.roughness;
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            p->tint[c][i] = e.specular[c];
            p->f0[c][i] = p->fd[i];
            p->albedo[c][i] = 1.0f;
        }
}

/* The same for individual lanes. */
static void load_uniform_lanes(const struct pell_material *const *uniform, float base[3][N], float *restrict metallic,
                               struct pell_lanes *restrict p)
{
    for (int i = 0; uniform && i < N; i++) {
        struct pell_surface_uniform e;
        if (!uniform[i])
            continue;
        e = pell_surface_uniform(uniform[i]);
        metallic[i] = 0.0f;
        p->roughness[i] = e.roughness;
        for (int c = 0; c < 3; c++) {
            base[c][i] = 1.0f;
            p->tint[c][i] = e.specular[c];
        }
    }
}

static void load(const struct pell_lane_input *input, const int32_t *index, const int32_t *x, const int32_t *y,
                 struct pell_lanes *restrict p, struct pell_sums *restrict sums)
{
    const struct pell_surface *s = input->surface;
    const ptrdiff_t rows = row_stride(index);
    _Alignas(64) float depth[N], metallic[N], base[3][N];

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++)
            sums->irradiance[c][i] = sums->specular[c][i] = sums->transmitted[c][i] = sums->unshadowed[c][i] = sums->single[c][i] =
                sums->hidden[c][i] = sums->lost[c][i] = sums->entered[c][i] = sums->solved[c][i] = 0.0f;
    memset(sums->straight, 0, sizeof(sums->straight));
    memset(sums->path, 0, sizeof(sums->path));
    memset(sums->shifted, 0, sizeof(sums->shifted));
    memset(sums->single_surplus, 0, sizeof(sums->single_surplus));
    memset(sums->direction_in, 0, sizeof(sums->direction_in));
    memset(sums->direction_weight, 0, sizeof(sums->direction_weight));
    gather(s->depth, index, rows, depth);
    gather(s->ng[0], index, rows, p->gx);
    gather(s->ng[1], index, rows, p->gy);
    gather(s->ng[2], index, rows, p->gz);
    gather(s->ns[0], index, rows, p->nx);
    gather(s->ns[1], index, rows, p->ny);
    gather(s->ns[2], index, rows, p->nz);
    gather(s->terminator_offset, index, rows, p->terminator_offset);
    if (!input->position && s->spread > 0.0f)
        gather(s->slope_variance, index, rows, p->slope_variance);
    else
        memset(p->slope_variance, 0, sizeof(p->slope_variance));
    if (input->plain) {
        load_uniform(input->plain, p);
    } else {
        gather(s->roughness, index, rows, p->roughness);
        gather(s->metallic, index, rows, metallic);
        for (int c = 0; c < 3; c++) {
            gather(s->base[c], index, rows, base[c]);
            gather(s->specular[c], index, rows, p->tint[c]);
        }
        load_uniform_lanes(input->uniform, base, metallic, p);
        load_material((const float(*)[N]) base, metallic, p);
    }
    if (input->position)
        load_points(input, depth, index, x, y, p);
    else
        load_pixels(input, depth, x, y, p);
    for (int i = 0; i < N; i++)
        pell_lane_pattern(p, i, input->light_bits, 0, p->pattern[0] + i, p->pattern[1] + i);
    p->light_bits = input->light_bits;
    load_roughness(p);
    for (int i = 0; i < N; i++) {
        const float gn = p->gx[i] * p->nx[i] + p->gy[i] * p->ny[i] + p->gz[i] * p->nz[i];
        p->ox[i] = p->px[i] + (p->terminator_offset[i] + p->epsilon[i]) * p->gx[i];
        p->oy[i] = p->py[i] + (p->terminator_offset[i] + p->epsilon[i]) * p->gy[i];
        p->oz[i] = p->pz[i] + (p->terminator_offset[i] + p->epsilon[i]) * p->gz[i];
        p->nv[i] = p->nx[i] * p->vx[i] + p->ny[i] * p->vy[i] + p->nz[i] * p->vz[i];
        p->gn[i] = gn > 1e-3f ? gn : 1e-3f;
    }
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++)
            p->pass[c][i] = p->pass_base[c][i] + p->pass_slope[c][i] * pell_angle_off(p->inverse_eta2[i], pell_saturate(p->nv[i]));
}

static inline void scatter(const float *restrict in, const int32_t *restrict index, int count, ptrdiff_t rows, float *restrict plane)
{
    if (rows) {
        for (int j = 0; j < 4; j++)
            memcpy(plane + index[0] + rows * j, in + 4 * j, 4 * sizeof(float));
        return;
    }
    for (int i = 0; i < count; i++)
        plane[index[i]] = in[i];
}

/* Stores the mean direction of entering light; diffuse light stands in where no direction is known. */
static void store_direction(const struct pell_lanes *restrict p, const struct pell_sums *restrict sums, const int32_t *restrict index,
                            int count, ptrdiff_t rows, struct pell_lighting *out)
{
    _Alignas(64) float inward[N], inverse_sum[N], direction[N], scaled[N], diffuse[N];

    for (int i = 0; i < N; i++) {
        float all = 0.0f;
        for (int c = 0; c < 3; c++)
            all += sums->irradiance[c][i] - sums->shifted[c][i] - sums->single_surplus[c][i];
        inverse_sum[i] = all > TINY ? 1.0f / all : 0.0f;
        diffuse[i] = all > sums->direction_weight[i] ? (all - sums->direction_weight[i]) * inverse_sum[i] : 0.0f;
        inward[i] = diffuse[i] * pell_mean_refracted(p->inverse_eta2[i]);
    }
    scatter(diffuse, index, count, rows, out->diffuse);
    for (int c = 0; c < 3; c++) {
        const float *normal = c == 0 ? p->nx : c == 1 ? p->ny : p->nz;
        for (int i = 0; i < N; i++)
            direction[i] = sums->direction_in[c][i] * inverse_sum[i] - inward[i] * normal[i];
        scatter(direction, index, count, rows, out->direction_in[c]);
        for (int i = 0; i < N; i++)
            scaled[i] = sums->shifted[c][i] * p->albedo[c][i];
        scatter(scaled, index, count, rows, out->shifted[c]);
        for (int i = 0; i < N; i++)
            scaled[i] = sums->single_surplus[c][i] * p->albedo[c][i];
        scatter(scaled, index, count, rows, out->single_surplus[c]);
    }
}

static void store(const struct pell_shade_tables *t, const struct pell_lanes *restrict p, const struct pell_sums *restrict sums,
                  const int32_t *restrict index, int count, struct pell_lighting *out)
{
    const ptrdiff_t rows = count == N ? row_stride(index) : 0;
    _Alignas(64) float irradiance[N], transmitted[N], single[N], lost[N], path[N], exit_transmittance[N] = { 0 };

    if (p->any_single) {
        transmittance(t, p, p->nv, exit_transmittance);
        for (int i = 0; i < N; i++)
            exit_transmittance[i] *= p->single_eta2[i];
    }
    for (int c = 0; c < 3; c++) {
        const float *transmission = p->any_thin ? p->transmission[c] : p->albedo[c];
        for (int i = 0; i < N; i++) {
            irradiance[i] = sums->irradiance[c][i] * p->albedo[c][i] - sums->entered[c][i];
            transmitted[i] = sums->transmitted[c][i] * transmission[i] + sums->solved[c][i];
            single[i] = sums->single[c][i] * exit_transmittance[i];
        }
        scatter(irradiance, index, count, rows, out->irradiance[c]);
        if (out->entered[c])
            scatter(sums->entered[c], index, count, rows, out->entered[c]);
        scatter(transmitted, index, count, rows, out->transmitted[c]);
        scatter(sums->specular[c], index, count, rows, out->specular[c]);
        if (out->single[c])
            scatter(single, index, count, rows, out->single[c]);
        if (out->hidden[c]) {
            scatter(sums->hidden[c], index, count, rows, out->hidden[c]);
            for (int i = 0; i < N; i++)
                lost[i] = sums->lost[c][i] * p->albedo[c][i];
            scatter(lost, index, count, rows, out->lost[c]);
        }
    }
    if (p->any_direction)
        store_direction(p, sums, index, count, rows, out);
    if (out->path) {
        for (int i = 0; i < N; i++) {
            const float all = sums->transmitted[0][i] + sums->transmitted[1][i] + sums->transmitted[2][i] + sums->solved[0][i] +
                              sums->solved[1][i] + sums->solved[2][i];
            path[i] = pell_spread_pack_sums(sums->path[i], sums->straight[i], all);
        }
        scatter(path, index, count, rows, out->path);
    }
}

extern const struct pell_shade_kernels PELL_SIMD(pell_shade_kernels);
const struct pell_shade_kernels PELL_SIMD(pell_shade_kernels) = {
    load,
    aim,
    front,
    pass,
    PELL_SIMD(pell_begin_highlights),
    PELL_SIMD(pell_reflect),
    PELL_SIMD(pell_reflected),
    PELL_SIMD(pell_end_highlights),
    unshadowed,
    store,
    shadow_rays,
};
