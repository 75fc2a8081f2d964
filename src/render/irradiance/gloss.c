/* SPDX-License-Identifier: MIT
 *
 * gloss.c - highlights of area and point lights. Compiled once per SIMD level; plain loops over 16 lanes. Samples are the points on a light
 * that shadow rays are sent to and, where the lobe is narrow, directions of the lobe, which are traced if they hit the light.
 */
#include "render/irradiance/lanes.h"

#include "shared/gloss.h"
#include "shared/lobe.h"

#include <string.h>

/* Area of the light, mm^2. */
static float face_area(const struct pell_light_data *light)
{
    const struct pell_vec4 r = light->right, s = light->up;
    const float square = (r.x * r.x + r.y * r.y + r.z * r.z) * (s.x * s.x + s.y * s.y + s.z * s.z);

    return (light->type == PELL_LIGHT_DATA_DISC ? PELL_PI_F : 4.0f) * sqrtf(square);
}

#define HAS(lanes, MODEL) ((lanes)->models & 1u << PELL_SPECULAR_##MODEL)

/* Lobe value, Schlick's weight and sampling density of a direction, by lane. */
static void shape_lobe(const struct pell_lanes *restrict p, const float l[3][N], const float *restrict solid_angle, float *restrict shape,
                       float *restrict fresnel, float *restrict density)
{
    _Alignas(64) float sin2[N], nl[N], nh[N], hh[N], nv[N], width2[N];

    for (int i = 0; i < N; i++) {
        const float hx = l[0][i] + p->vx[i], hy = l[1][i] + p->vy[i], hz = l[2][i] + p->vz[i];
        const float cx = p->ny[i] * hz - p->nz[i] * hy, cy = p->nz[i] * hx - p->nx[i] * hz, cz = p->nx[i] * hy - p->ny[i] * hx;
        const float square = hx * hx + hy * hy + hz * hz, cosine = p->nx[i] * l[0][i] + p->ny[i] * l[1][i] + p->nz[i] * l[2][i];
        float vh;
        nl[i] = cosine > 1e-6f ? cosine : 1e-6f;
        hh[i] = square > 1e-12f ? square : 1e-12f;
        sin2[i] = cx * cx + cy * cy + cz * cz;
        nv[i] = p->nv[i] > 1e-4f ? p->nv[i] : 1e-4f;
        nh[i] = nl[i] + nv[i];
        vh = 0.5f * sqrtf(hh[i]); /* h.v of the unit half vector: (1 + l.v)/|h| = |h|/2 */
        /* A few samples of a large light in a narrow lobe would be noisy: each represents a patch of solid angle w, or w/(4 h.v) among
         * the half vectors, and the lobe is widened by that patch: the variance of a square along a side is 1/12 of its area, and that
         * of a lobe half of its squared width. */
        width2[i] = p->width2[i] + solid_angle[i] * (1.0f / 24.0f) / vh;
        fresnel[i] = pell_schlick_weight(vh);
        density[i] = pell_half_vector_density(p->width2[i], sin2[i], nh[i], hh[i]);
    }
    memset(shape, 0, N * sizeof(*shape));
    if (HAS(p, GGX))
        for (int i = 0; i < N; i++)
            shape[i] = pell_lobe_ggx(width2[i] < 1.0f ? width2[i] : 1.0f, nl[i], nv[i], sin2[i], nh[i], hh[i]);
    if (HAS(p, KELEMEN))
        for (int i = 0; i < N; i++) {
            const float kelemen = pell_lobe_kelemen(width2[i], sin2[i], nh[i], hh[i]);
            shape[i] = p->model[i] == PELL_SPECULAR_KELEMEN ? kelemen : shape[i];
        }
    if (HAS(p, PHONG))
        for (int i = 0; i < N; i++) {
            const float phong = pell_lobe_phong(width2[i] < 1.0f ? width2[i] : 1.0f, nl[i], nv[i], sin2[i]);
            shape[i] = p->model[i] == PELL_SPECULAR_PHONG ? phong : shape[i];
        }
    if (HAS(p, BLINN_PHONG))
        for (int i = 0; i < N; i++) {
            const float blinn = pell_lobe_blinn_phong(width2[i] < 1.0f ? width2[i] : 1.0f, sin2[i], hh[i]);
            shape[i] = p->model[i] == PELL_SPECULAR_BLINN_PHONG ? blinn : shape[i];
        }
}

/* Directions from the points to positions `j` of the sample's cell on the light. The cell is a subdivision of the frame's samples: all
 * with the same leading digits. */
static void aim_within(const struct pell_light_data *restrict light, const struct pell_lanes *restrict p, const struct pell_aim *restrict a,
                       uint32_t j, float l[3][N], float *restrict cosine)
{
    const uint32_t u = pell_sobol0(j) >> ((p->light_bits + 1) / 2), v = pell_sobol1(j) >> (p->light_bits / 2);
    const bool disc = light->type == PELL_LIGHT_DATA_DISC;

    for (int i = 0; i < N; i++) {
        float x = pell_unit_float(a->at[0][i] ^ u), y = pell_unit_float(a->at[1][i] ^ v), inv;
        float dx, dy;
        pell_disc_point(x, y, &dx, &dy);
        x = disc ? dx : 2.0f * x - 1.0f;
        y = disc ? dy : 2.0f * y - 1.0f;
        l[0][i] = light->position.x + x * light->right.x + y * light->up.x - p->px[i];
        l[1][i] = light->position.y + x * light->right.y + y * light->up.y - p->py[i];
        l[2][i] = light->position.z + x * light->right.z + y * light->up.z - p->pz[i];
        inv = l[0][i] * l[0][i] + l[1][i] * l[1][i] + l[2][i] * l[2][i];
        inv = 1.0f / sqrtf(inv > TINY ? inv : TINY);
        for (int c = 0; c < 3; c++)
            l[c][i] *= inv;
        cosine[i] = p->nx[i] * l[0][i] + p->ny[i] * l[1][i] + p->nz[i] * l[2][i];
    }
}

/* --- Sampling points of the light ----------------------------------------------------------------------------------------------------- */

/* The shadow rays are too few for a narrow lobe, so each sample's cell is evaluated at more points. `facing`: without occlusion. */
void PELL_SIMD(pell_add_highlight)(const struct pell_light_data *restrict light, const struct pell_lanes *restrict p,
                                   const struct pell_aim *restrict a, const float *restrict facing, const float *restrict clipped,
                                   const int32_t *restrict visible, struct pell_gloss *restrict gloss)
{
    const int num_points = pell_light_is_area(light) ? PELL_GLOSS_POINTS : 1;
    _Alignas(64) float shape[N], fresnel[N], density[N], solid_angle[N], f0_sum[N] = { 0 }, f90_sum[N] = { 0 }, l[3][N], cosine[N];

    for (int i = 0; i < N; i++)
        solid_angle[i] = gloss->odds[i] > 0.0f ? 0.0f : a->solid_angle[i] * (1.0f / PELL_GLOSS_POINTS);
    memcpy(l[0], a->lx, sizeof(a->lx));
    memcpy(l[1], a->ly, sizeof(a->ly));
    memcpy(l[2], a->lz, sizeof(a->lz));
    memcpy(cosine, clipped, sizeof(cosine));
    for (int j = 0; j < num_points; j++) {
        if (j > 0)
            aim_within(light, p, a, (uint32_t) j, l, cosine);
        shape_lobe(p, (const float(*)[N]) l, solid_angle, shape, fresnel, density);
        for (int i = 0; i < N; i++) {
            const float w = cosine[i] > 0.0f ? shape[i] * cosine[i] : 0.0f, odds = gloss->odds[i];
            const float part = odds > 0.0f ? w * odds / (odds + density[i]) : w;
            f0_sum[i] += part;
            f90_sum[i] += part * fresnel[i];
        }
    }
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            const float w = facing[i] / ((float) num_points * clipped[i]) * a->falloff[i] * a->intensity[c][i] * p->tint[c][i];
            const float add = w * (p->f0[c][i] * f0_sum[i] + (1.0f - p->f0[c][i]) * f90_sum[i]), limited = add < BIG ? add : BIG;
            const float lit = facing[i] > 0.0f ? limited : 0.0f;
            gloss->visible[c][i] += visible[i] ? lit : 0.0f;
            gloss->occluded[c][i] += visible[i] ? 0.0f : lit;
        }
}

/* --- Sampling directions of the lobe -------------------------------------------------------------------------------------------------- */

/* Samples direction `n` of the lobe. */
static void sample_direction(const struct pell_lanes *restrict p, uint32_t n, float l[3][N])
{
    const uint32_t u = pell_sobol0(n), v = pell_sobol1(n);

    for (int i = 0; i < N; i++) {
        const float nx = p->nx[i], ny = p->ny[i], nz = p->nz[i], nv = nx * p->vx[i] + ny * p->vy[i] + nz * p->vz[i];
        const float ax = p->vx[i] - nv * nx, ay = p->vy[i] - nv * ny, az = p->vz[i] - nv * nz, tangential2 = ax * ax + ay * ay + az * az;
        const float inv = tangential2 > 1e-8f ? 1.0f / sqrtf(tangential2) : 0.0f, side = copysignf(1.0f, nz), d = -1.0f / (side + nz);
        /* relative to the plane of incidence, so that a rotated scene has the same directions; vec3_basis at normal incidence */
        const float tx = inv > 0.0f ? ax * inv : 1.0f + side * nx * nx * d, ty = inv > 0.0f ? ay * inv : side * nx * ny * d;
        const float tz = inv > 0.0f ? az * inv : -side * nx;
        const struct pell_point2 at = pell_disc_at(pell_unit_float(u ^ p->pattern[0][i]), pell_unit_float(v ^ p->pattern[1][i]));
        const struct pell_half_vector h = pell_half_vector_at(p->width2[i], at.x, at.y);
        const float hx = h.x * tx + h.y * (ny * tz - nz * ty) + h.z * nx;
        const float hy = h.x * ty + h.y * (nz * tx - nx * tz) + h.z * ny;
        const float hz = h.x * tz + h.y * (nx * ty - ny * tx) + h.z * nz;
        const float hv = hx * p->vx[i] + hy * p->vy[i] + hz * p->vz[i];
        l[0][i] = 2.0f * hv * hx - p->vx[i];
        l[1][i] = 2.0f * hv * hy - p->vy[i];
        l[2][i] = 2.0f * hv * hz - p->vz[i];
    }
}

/* The light in a direction: the window of its range, 0 outside the light's area and behind it; and its distance. */
static void intersect_light(const struct pell_light_data *restrict light, const struct pell_lanes *restrict p, const float l[3][N],
                            float *restrict hit, float *restrict distance)
{
    const struct pell_vec4 d = light->direction, c = light->position, r = light->right, s = light->up;
    const float per_r2 = 1.0f / (r.x * r.x + r.y * r.y + r.z * r.z), per_s2 = 1.0f / (s.x * s.x + s.y * s.y + s.z * s.z);
    const bool disc = light->type == PELL_LIGHT_DATA_DISC;

    for (int i = 0; i < N; i++) {
        const float tx = p->px[i] - c.x, ty = p->py[i] - c.y, tz = p->pz[i] - c.z;
        const float height = tx * d.x + ty * d.y + tz * d.z, cosine = -(l[0][i] * d.x + l[1][i] * d.y + l[2][i] * d.z);
        const float t = height / (cosine > 1e-12f ? cosine : 1e-12f);
        const float qx = tx + t * l[0][i], qy = ty + t * l[1][i], qz = tz + t * l[2][i];
        const float x = (qx * r.x + qy * r.y + qz * r.z) * per_r2, y = (qx * s.x + qy * s.y + qz * s.z) * per_s2;
        const float x2 = x * x, y2 = y * y, most = disc ? x2 + y2 : x2 > y2 ? x2 : y2;
        hit[i] = height > 0.0f && cosine > 1e-12f && most <= 1.0f ? pell_light_window(t * t, d.w) : 0.0f;
        distance[i] = t;
    }
}

bool PELL_SIMD(pell_reflect)(const struct pell_light_data *light, const struct pell_lanes *p, uint32_t n, struct pell_gloss *gloss,
                             int32_t *mask, struct pell_ray16 *rays)
{
    _Alignas(64) float none[N] = { 0 }, l[3][N], density[N], hit[N], distance[N], shape[N], fresnel[N];
    int32_t any = 0;

    sample_direction(p, n, l);
    intersect_light(light, p, (const float(*)[N]) l, hit, distance);
    shape_lobe(p, (const float(*)[N]) l, none, shape, fresnel, density);
    for (int i = 0; i < N; i++) {
        const float nl = p->nx[i] * l[0][i] + p->ny[i] * l[1][i] + p->nz[i] * l[2][i];
        const float gl = p->gx[i] * l[0][i] + p->gy[i] * l[1][i] + p->gz[i] * l[2][i];
        const float mu = nl > 1e-6f ? nl : 1e-6f, w = hit[i] * shape[i] * pell_lane_facing(p, i, mu, gl) / (gloss->odds[i] + density[i]);
        const bool lit = gloss->odds[i] > 0.0f && nl > 0.0f && pell_lane_fronts(p, i, gl) && w > 0.0f;
        gloss->direction_factor[0][i] = lit ? w : 0.0f;
        gloss->direction_factor[1][i] = lit ? w * fresnel[i] : 0.0f;
        mask[i] = -(int32_t) lit;
        any |= mask[i];
    }
    for (int i = 0; i < N && any; i++)
        pell_ray16_set(rays, i, vec3(p->ox[i], p->oy[i], p->oz[i]), vec3(l[0][i], l[1][i], l[2][i]), 0.9999f * distance[i]);
    return any != 0;
}

void PELL_SIMD(pell_reflected)(const int32_t *visible, struct pell_gloss *gloss)
{
    for (int f = 0; f < 2; f++)
        for (int i = 0; i < N; i++) {
            gloss->mirrored[f][i] += visible[i] ? gloss->direction_factor[f][i] : 0.0f;
            gloss->mirrored_occluded[f][i] += visible[i] ? 0.0f : gloss->direction_factor[f][i];
        }
}

void PELL_SIMD(pell_begin_highlights)(const struct pell_light_data *light, const struct pell_lanes *p, struct pell_gloss *gloss)
{
    const int points = light->samples * PELL_GLOSS_POINTS, directions = pell_gloss_directions(light->samples);
    const float area = pell_light_is_area(light) && light->image < 0 ? face_area(light) : 0.0f;

    memset(gloss, 0, sizeof(*gloss));
    for (int i = 0; i < N && area > 0.0f; i++) {
        const float x = p->px[i] - light->position.x, y = p->py[i] - light->position.y, z = p->pz[i] - light->position.z;
        const float height = x * light->direction.x + y * light->direction.y + z * light->direction.z, d2 = x * x + y * y + z * z;
        const float angle = area * height / ((d2 > TINY ? d2 : TINY) * sqrtf(d2 > TINY ? d2 : TINY));
        const float odds = pell_gloss_odds(angle, p->width2[i], p->nv[i], points, directions);
        gloss->odds[i] = p->valid[i] && height > 0.0f && p->model[i] != PELL_SPECULAR_PHONG ? odds : 0.0f;
        gloss->any_odds |= gloss->odds[i] > 0.0f;
    }
}

/* The highlight from the sums of the factors of the lobe's directions; `per`: factor from the light's power to radiance per direction. */
static float mirrored(const struct pell_light_data *light, const struct pell_lanes *p, float per, const float sums[2][N], int c, int i)
{
    const float power = c == 0 ? light->power.x : c == 1 ? light->power.y : light->power.z;
    const float add = power * per * p->tint[c][i] * (p->f0[c][i] * sums[0][i] + (1.0f - p->f0[c][i]) * sums[1][i]);

    return add < BIG ? add : BIG;
}

void PELL_SIMD(pell_end_highlights)(const struct pell_light_data *light, const struct pell_lanes *p, const struct pell_gloss *gloss,
                                    struct pell_sums *sums)
{
    const bool face = pell_light_is_area(light);
    const float per = (float) light->samples / (face ? face_area(light) * (float) pell_gloss_directions(light->samples) : 1.0f);

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < N; i++) {
            sums->specular[c][i] += gloss->visible[c][i];
            sums->hidden[c][i] += face ? gloss->occluded[c][i] : 0.0f;
        }
    for (int c = 0; c < 3 && gloss->any_odds; c++)
        for (int i = 0; i < N; i++) {
            sums->specular[c][i] += mirrored(light, p, per, gloss->mirrored, c, i);
            sums->hidden[c][i] += mirrored(light, p, per, gloss->mirrored_occluded, c, i);
        }
}
