/* SPDX-License-Identifier: MIT
 * lights.c - radiance of lights seen along a path outside: area lights by the directions of its lobe, environments filtered to its width,
 * point and directional lights by its density. */
#include "render/unscattered/internal.h"

#include "math/scalar.h"
#include "shared/light.h"

#include <string.h>

#define BUNDLE UNSCATTERED_BUNDLE
#define MAX_WIDTHS 10.0f       /* widths of a lobe beyond which a point light is ignored */
#define MIN_HIT_FRACTION 0.38f /* hit fraction of a lobe's directions up to which its density is the better estimate */
#define MAX_SPREAD 0.35f       /* of a light's radius: a wider lobe has too few directions on the light, and a nearly uniform density */

/* Directions of the lobe, not unit; only the path's direction if the lobe is a ray. */
struct bundle {
    _Alignas(64) float x[BUNDLE], y[BUNDLE], z[BUNDLE];
    int count;
};

static void spread_bundle(const struct unscattered_path *w, const float offsets[4][BUNDLE], struct pell_vec3 t, struct pell_vec3 b,
                          struct bundle *f)
{
    const struct unscattered_lobe *l = &w->lobe;

    f->count = l->earlier + l->last + l->pixel > 0.0f ? BUNDLE : 1;
    for (int j = 0; j < f->count; j++) {
        /* maps an offset m of the lobe to the unit disc */
        const float disc = l->pixel / sqrtf(1.0f + offsets[0][j] * offsets[0][j] + offsets[1][j] * offsets[1][j]);
        const float p = (l->earlier + disc) * offsets[0][j] + l->last * offsets[2][j];
        const float q = (l->earlier + disc) * offsets[1][j] + l->last * offsets[3][j];
        f->x[j] = w->direction.x + p * t.x + q * b.x;
        f->y[j] = w->direction.y + p * t.y + q * b.y;
        f->z[j] = w->direction.z + p * t.z + q * b.z;
    }
}

/* Returns the fraction of the lobe's directions that hit an area light from its front. With an image, `rgb` is multiplied by the mean
 * texel hit. */
static float hit_area_light(const struct pell_light_source *s, const struct unscattered_path *w, const struct bundle *f, float reach,
                            float rgb[3])
{
    const struct pell_vec3 to = vec3_sub(w->position, s->position), n = s->direction, r = s->right, u = s->up;
    const float height = vec3_dot(to, n), per_r2 = 1.0f / vec3_dot(r, r), per_u2 = 1.0f / vec3_dot(u, u);
    const bool disc = s->type == PELL_LIGHT_DISC;
    _Alignas(64) float hit[BUNDLE], distance[BUNDLE];
    float sum = 0.0f, image[3] = { 0 };

    if (!(height > 0.0f))
        return 0.0f;
    for (int j = 0; j < f->count; j++) {
        const float fall = -(f->x[j] * n.x + f->y[j] * n.y + f->z[j] * n.z), t = height / (fall > 1e-12f ? fall : 1e-12f);
        const float qx = to.x + t * f->x[j], qy = to.y + t * f->y[j], qz = to.z + t * f->z[j];
        const float x = (qx * r.x + qy * r.y + qz * r.z) * per_r2, y = (qx * u.x + qy * u.y + qz * u.z) * per_u2, x2 = x * x, y2 = y * y;
        const float most = disc ? x2 + y2 : x2 > y2 ? x2 : y2;
        distance[j] = t;
        hit[j] = fall > 1e-12f && most <= 1.0f && t < reach ? 1.0f : 0.0f;
    }
    for (int j = 0; j < f->count; j++) {
        sum += hit[j];
        if (s->image && hit[j] > 0.0f) {
            const struct pell_vec3 d = vec3(f->x[j], f->y[j], f->z[j]);
            float texel[3];
            pell_light_source_image(s, vec3_mad(w->position, distance[j], d), vec3_mul(vec3_normalize(d), -1.0f), w->position, texel);
            for (int c = 0; c < 3; c++)
                image[c] += texel[c];
        }
    }
    for (int c = 0; s->image && sum > 0.0f && c < 3; c++)
        rgb[c] *= image[c] / sum;
    return sum / (float) f->count;
}

/* Irradiance of a point or directional light at normal incidence, W/m^2, times the density of the lobe in its direction. */
static float point_light_density(const struct pell_light_source *s, const struct unscattered_path *w, const float offsets[4][BUNDLE],
                                 struct pell_vec3 t, struct pell_vec3 b, struct pell_vec3 *to, float *distance)
{
    const bool directional = s->type == PELL_LIGHT_DIRECTIONAL;
    const struct pell_vec3 d = directional ? vec3_mul(s->direction, -1.0f) : vec3_sub(s->position, w->position);
    const float most = MAX_WIDTHS * (w->lobe.earlier + w->lobe.last);
    float along, x, y, scale = 1.0f;

    *distance = directional ? INFINITY : vec3_length(d);
    *to = directional ? d : vec3_normalize(d);
    along = vec3_dot(*to, w->direction);
    if (!(along > 0.05f) || !(vec3_dot(*to, w->normal) > 0.0f))
        return 0.0f;
    x = vec3_dot(*to, t) / along;
    y = vec3_dot(*to, b) / along;
    if (x * x + y * y > most * most)
        return 0.0f;
    if (!directional)
        scale = pell_light_falloff(*distance, s->scale, s->inv_range);
    if (s->type == PELL_LIGHT_SPOT)
        scale *= pell_light_cone(-vec3_dot(s->direction, *to), s->spot_scale, s->spot_offset);
    return scale * unscattered_density(&w->lobe, offsets, x, y);
}

static bool is_occluded(const struct pell_unscattered_params *p, const struct unscattered_path *w, struct pell_vec3 to, float distance)
{
    const struct pell_ray ray = { { w->position.x, w->position.y, w->position.z },
                                  0.0f,
                                  { to.x, to.y, to.z },
                                  distance < INFINITY ? 0.9999f * distance : INFINITY,
                                  PELL_RAY_ALL };

    return pell_rays_occluded(p->rays, &ray);
}

/* Whether too few directions of the lobe would hit an area light: the lobe is much wider than the light, or only its tail hits the
 * light. */
static bool is_undersampled(const struct pell_light_source *s, const struct unscattered_path *w)
{
    const struct pell_vec3 to = vec3_sub(s->position, w->position);
    const float width = w->lobe.earlier + w->lobe.last, distance = vec3_length(to), along = vec3_dot(to, w->direction) / distance;
    const float radius = sqrtf(vec3_length(s->right) * vec3_length(s->up)) / distance;
    const float off = along > 0.05f ? sqrtf(1.0f / fminf(along * along, 1.0f) - 1.0f) : INFINITY;

    return width > MAX_SPREAD * radius || off > 1.3f * radius + width;
}

/* Returns the fraction of the lobe that hits such a light: its density at 16 points on the light, with four shadow rays. With an image,
 * `rgb` is multiplied by the mean of the image at those four. */
static float integrate_area_light(const struct pell_unscattered_params *p, const struct pell_light_source *s,
                                  const struct unscattered_path *w, const float offsets[4][BUNDLE], struct pell_vec3 t, struct pell_vec3 b,
                                  float rgb[3], int64_t *rays)
{
    const float unit_area = s->type == PELL_LIGHT_DISC ? PELL_PI_F : 4.0f, area = unit_area * vec3_length(s->right) * vec3_length(s->up);
    float sum = 0.0f, image[3] = { 0 };

    for (int k = 0; k < 4; k++) {
        const float x = k & 1 ? 0.5f : -0.5f, y = k & 2 ? 0.5f : -0.5f;
        const struct pell_vec3 middle = vec3_sub(vec3_mad(vec3_mad(s->position, x, s->right), y, s->up), w->position);
        float density = 0.0f, texel[3];
        for (int i = 0; i < 4; i++) {
            const struct pell_vec3 point_offset =
                vec3_mad(vec3_mad(middle, i & 1 ? 0.25f : -0.25f, s->right), i & 2 ? 0.25f : -0.25f, s->up);
            const struct pell_vec3 to = vec3_normalize(point_offset);
            const float along = vec3_dot(to, w->direction), facing = -vec3_dot(s->direction, to);
            if (along > 0.05f && facing > 0.0f && vec3_dot(to, w->normal) > 0.0f)
                density += unscattered_density(&w->lobe, offsets, vec3_dot(to, t) / along, vec3_dot(to, b) / along) * facing /
                           vec3_dot(point_offset, point_offset);
        }
        if (!(density > 0.0f))
            continue;
        ++*rays;
        if (is_occluded(p, w, vec3_normalize(middle), vec3_length(middle)))
            continue;
        sum += density * 0.0625f * area;
        if (s->image) {
            pell_light_source_image(s, vec3_add(w->position, middle), vec3_mul(vec3_normalize(middle), -1.0f), w->position, texel);
            for (int c = 0; c < 3; c++)
                image[c] += density * 0.0625f * area * texel[c];
        }
    }
    for (int c = 0; s->image && sum > 0.0f && c < 3; c++)
        rgb[c] *= image[c] / sum;
    return smaller(sum, 1.0f);
}

static void add_environments(const struct pell_unscattered_params *p, const struct unscattered_path *w, float rgb[3])
{
    const struct unscattered_lobe *l = &w->lobe;
    const float width = sqrtf(l->earlier * l->earlier + l->last * l->last + 0.5f * l->pixel * l->pixel);

    for (size_t e = 0; e < p->lights->num_environments; e++) {
        float seen[3];
        if (width > 0.0f) /* half vectors turn reflected light by twice their angle */
            pell_environment_reflection(&p->lights->environments[e], w->direction, 0.5f * width, seen);
        else
            pell_environment_radiance(&p->lights->environments[e], w->direction, seen);
        for (int c = 0; c < 3; c++)
            rgb[c] += w->weight[c] * seen[c];
    }
}

int64_t unscattered_add_lights(const struct pell_unscattered *u, const struct pell_unscattered_params *p, const struct unscattered_path *w,
                               float reach, float rgb[3])
{
    const float(*const offsets)[BUNDLE] = (const float(*)[BUNDLE]) u->bundles[w->bundle];
    struct pell_vec3 t, b;
    const bool rough = w->lobe.earlier + w->lobe.last > 0.0f;
    struct bundle f;
    int64_t rays = 0;

    vec3_basis(w->direction, &t, &b);
    spread_bundle(w, offsets, t, b, &f);
    for (size_t i = 0; i < p->lights->num_sources; i++) {
        const struct pell_light_source *s = &p->lights->sources[i];
        const bool has_area = s->type == PELL_LIGHT_RECT || s->type == PELL_LIGHT_DISC;
        struct pell_vec3 to;
        float power[3] = { s->power[0], s->power[1], s->power[2] }, fraction, distance;
        if (s->environment >= 0)
            continue;
        if (has_area) {
            fraction = rough && is_undersampled(s, w) ? 0.0f : hit_area_light(s, w, &f, reach, power);
            if (rough && fraction <= MIN_HIT_FRACTION) {
                memcpy(power, s->power, sizeof(power));
                fraction = integrate_area_light(p, s, w, offsets, t, b, power, &rays);
            }
            fraction /= s->sample_area;
        } else if (!rough) {
            continue;
        } else {
            fraction = point_light_density(s, w, offsets, t, b, &to, &distance);
            if (!(fraction > 0.0f))
                continue;
            rays++;
            if (is_occluded(p, w, to, distance))
                continue;
            if (s->image) {
                float texel[3];
                pell_light_source_image(s, s->position, vec3_mul(to, -1.0f), w->position, texel);
                for (int c = 0; c < 3; c++)
                    power[c] *= texel[c];
            }
        }
        for (int c = 0; c < 3; c++)
            rgb[c] += smaller(w->weight[c] * power[c] * fraction, 1e25f);
    }
    if (reach == INFINITY)
        add_environments(p, w, rgb);
    return rays;
}
