/* SPDX-License-Identifier: MIT
 * lights.c - what lights show along a way through the open: faces by directions of its lobe, environments at its width, lights without
 * extent by its density. */
#include "render/unscattered/internal.h"

#include "math/scalar.h"
#include "shared/light.h"

#include <string.h>

#define BUNDLE UNSCATTERED_BUNDLE
#define TAIL 10.0f   /* widths of a lobe, beyond which a light without extent isn't looked for */
#define FEW 0.38f    /* share of a lobe's directions up to which its density says more */
#define SPARSE 0.35f /* of a face's radius: a wider lobe has too few directions there, and the density is even over it */

/* Directions of the lobe, not unit; all are the way itself where it is a ray. */
struct bundle {
    _Alignas(64) float x[BUNDLE], y[BUNDLE], z[BUNDLE];
    int count;
};

static void spread(const struct unscattered_way *w, const float places[4][BUNDLE], struct pell_vec3 t, struct pell_vec3 b, struct bundle *f)
{
    const struct unscattered_lobe *l = &w->lobe;

    f->count = l->wide + l->last + l->pixel > 0.0f ? BUNDLE : 1;
    for (int j = 0; j < f->count; j++) {
        /* a place m of the lobe becomes one of the unit disc */
        const float disc = l->pixel / sqrtf(1.0f + places[0][j] * places[0][j] + places[1][j] * places[1][j]);
        const float p = (l->wide + disc) * places[0][j] + l->last * places[2][j];
        const float q = (l->wide + disc) * places[1][j] + l->last * places[3][j];
        f->x[j] = w->along.x + p * t.x + q * b.x;
        f->y[j] = w->along.y + p * t.y + q * b.y;
        f->z[j] = w->along.z + p * t.z + q * b.z;
    }
}

/* How much of the lobe meets the face from in front, by its window; with an image, `rgb` is multiplied by what of it is met. */
static float meet_face(const struct pell_light_source *s, const struct unscattered_way *w, const struct bundle *f, float reach,
                       float rgb[3])
{
    const struct pell_vec3 to = vec3_sub(w->at, s->position), n = s->direction, r = s->right, u = s->up;
    const float height = vec3_dot(to, n), per_r2 = 1.0f / vec3_dot(r, r), per_u2 = 1.0f / vec3_dot(u, u);
    const bool disc = s->type == PELL_LIGHT_DISC;
    _Alignas(64) float there[BUNDLE], far[BUNDLE];
    float sum = 0.0f, image[3] = { 0 };

    if (!(height > 0.0f))
        return 0.0f;
    for (int j = 0; j < f->count; j++) {
        const float fall = -(f->x[j] * n.x + f->y[j] * n.y + f->z[j] * n.z), t = height / (fall > 1e-12f ? fall : 1e-12f);
        const float qx = to.x + t * f->x[j], qy = to.y + t * f->y[j], qz = to.z + t * f->z[j];
        const float x = (qx * r.x + qy * r.y + qz * r.z) * per_r2, y = (qx * u.x + qy * u.y + qz * u.z) * per_u2, x2 = x * x, y2 = y * y;
        const float most = disc ? x2 + y2 : x2 > y2 ? x2 : y2;
        far[j] = t;
        there[j] = fall > 1e-12f && most <= 1.0f && t < reach ? 1.0f : 0.0f;
    }
    for (int j = 0; j < f->count; j++) {
        sum += there[j];
        if (s->image && there[j] > 0.0f) {
            const struct pell_vec3 d = vec3(f->x[j], f->y[j], f->z[j]);
            float texel[3];
            pell_light_source_image(s, vec3_mad(w->at, far[j], d), vec3_mul(vec3_normalize(d), -1.0f), w->at, texel);
            for (int c = 0; c < 3; c++)
                image[c] += texel[c];
        }
    }
    for (int c = 0; s->image && sum > 0.0f && c < 3; c++)
        rgb[c] *= image[c] / sum;
    return sum / (float) f->count;
}

/* A light without extent: its irradiance across the way to it, W/m^2, times the density of the lobe there. */
static float find_density(const struct pell_light_source *s, const struct unscattered_way *w, const float places[4][BUNDLE],
                          struct pell_vec3 t, struct pell_vec3 b, struct pell_vec3 *to, float *distance)
{
    const bool far = s->type == PELL_LIGHT_DIRECTIONAL;
    const struct pell_vec3 d = far ? vec3_mul(s->direction, -1.0f) : vec3_sub(s->position, w->at);
    const float most = TAIL * (w->lobe.wide + w->lobe.last);
    float along, x, y, scale = 1.0f;

    *distance = far ? INFINITY : vec3_length(d);
    *to = far ? d : vec3_normalize(d);
    along = vec3_dot(*to, w->along);
    if (!(along > 0.05f) || !(vec3_dot(*to, w->side) > 0.0f))
        return 0.0f;
    x = vec3_dot(*to, t) / along;
    y = vec3_dot(*to, b) / along;
    if (x * x + y * y > most * most)
        return 0.0f;
    if (!far)
        scale = pell_light_falloff(*distance, s->scale, s->inv_range);
    if (s->type == PELL_LIGHT_SPOT)
        scale *= pell_light_cone(-vec3_dot(s->direction, *to), s->spot_scale, s->spot_offset);
    return scale * unscattered_density(&w->lobe, places, x, y);
}

static bool is_hidden(const struct pell_unscattered_params *p, const struct unscattered_way *w, struct pell_vec3 to, float distance)
{
    const struct pell_ray ray = {
        { w->at.x, w->at.y, w->at.z }, 0.0f, { to.x, to.y, to.z }, distance < INFINITY ? 0.9999f * distance : INFINITY, PELL_RAY_ALL
    };

    return pell_rays_occluded(p->rays, &ray);
}

/* Whether few directions of the lobe would meet a face: it is wider than that looks, or meets it with its tail alone. */
static bool meets_few(const struct pell_light_source *s, const struct unscattered_way *w)
{
    const struct pell_vec3 to = vec3_sub(s->position, w->at);
    const float width = w->lobe.wide + w->lobe.last, far = vec3_length(to), along = vec3_dot(to, w->along) / far;
    const float radius = sqrtf(vec3_length(s->right) * vec3_length(s->up)) / far;
    const float off = along > 0.05f ? sqrtf(1.0f / fminf(along * along, 1.0f) - 1.0f) : INFINITY;

    return width > SPARSE * radius || off > 1.3f * radius + width;
}

/* The share of the lobe that meets such a face: its density at 16 places there, of which four see the way. With an image, `rgb` is
 * multiplied by what those four show of it. */
static float find_over_face(const struct pell_unscattered_params *p, const struct pell_light_source *s, const struct unscattered_way *w,
                            const float places[4][BUNDLE], struct pell_vec3 t, struct pell_vec3 b, float rgb[3], int64_t *rays)
{
    const float whole = s->type == PELL_LIGHT_DISC ? PELL_PI_F : 4.0f, area = whole * vec3_length(s->right) * vec3_length(s->up);
    float sum = 0.0f, image[3] = { 0 };

    for (int k = 0; k < 4; k++) {
        const float x = k & 1 ? 0.5f : -0.5f, y = k & 2 ? 0.5f : -0.5f;
        const struct pell_vec3 middle = vec3_sub(vec3_mad(vec3_mad(s->position, x, s->right), y, s->up), w->at);
        float part = 0.0f, texel[3];
        for (int i = 0; i < 4; i++) {
            const struct pell_vec3 way = vec3_mad(vec3_mad(middle, i & 1 ? 0.25f : -0.25f, s->right), i & 2 ? 0.25f : -0.25f, s->up);
            const struct pell_vec3 to = vec3_normalize(way);
            const float along = vec3_dot(to, w->along), facing = -vec3_dot(s->direction, to);
            if (along > 0.05f && facing > 0.0f && vec3_dot(to, w->side) > 0.0f)
                part +=
                    unscattered_density(&w->lobe, places, vec3_dot(to, t) / along, vec3_dot(to, b) / along) * facing / vec3_dot(way, way);
        }
        if (!(part > 0.0f))
            continue;
        ++*rays;
        if (is_hidden(p, w, vec3_normalize(middle), vec3_length(middle)))
            continue;
        sum += part * 0.0625f * area;
        if (s->image) {
            pell_light_source_image(s, vec3_add(w->at, middle), vec3_mul(vec3_normalize(middle), -1.0f), w->at, texel);
            for (int c = 0; c < 3; c++)
                image[c] += part * 0.0625f * area * texel[c];
        }
    }
    for (int c = 0; s->image && sum > 0.0f && c < 3; c++)
        rgb[c] *= image[c] / sum;
    return smaller(sum, 1.0f);
}

static void see_environments(const struct pell_unscattered_params *p, const struct unscattered_way *w, float rgb[3])
{
    const struct unscattered_lobe *l = &w->lobe;
    const float width = sqrtf(l->wide * l->wide + l->last * l->last + 0.5f * l->pixel * l->pixel);

    for (size_t e = 0; e < p->lights->num_environments; e++) {
        float seen[3];
        if (width > 0.0f) /* half vectors turn what they reflect twice as far */
            pell_environment_reflection(&p->lights->environments[e], w->along, 0.5f * width, seen);
        else
            pell_environment_radiance(&p->lights->environments[e], w->along, seen);
        for (int c = 0; c < 3; c++)
            rgb[c] += w->weight[c] * seen[c];
    }
}

int64_t unscattered_see_lights(const struct pell_unscattered *u, const struct pell_unscattered_params *p, const struct unscattered_way *w,
                               float reach, float rgb[3])
{
    const float(*const places)[BUNDLE] = (const float(*)[BUNDLE]) u->bundles[w->bundle];
    struct pell_vec3 t, b;
    const bool rough = w->lobe.wide + w->lobe.last > 0.0f;
    struct bundle f;
    int64_t rays = 0;

    vec3_basis(w->along, &t, &b);
    spread(w, places, t, b, &f);
    for (size_t i = 0; i < p->lights->num_sources; i++) {
        const struct pell_light_source *s = &p->lights->sources[i];
        const bool face = s->type == PELL_LIGHT_RECT || s->type == PELL_LIGHT_DISC;
        struct pell_vec3 to;
        float power[3] = { s->power[0], s->power[1], s->power[2] }, share, distance;
        if (s->environment >= 0)
            continue;
        if (face) {
            share = rough && meets_few(s, w) ? 0.0f : meet_face(s, w, &f, reach, power);
            if (rough && share <= FEW) {
                memcpy(power, s->power, sizeof(power));
                share = find_over_face(p, s, w, places, t, b, power, &rays);
            }
            share /= s->sample_area;
        } else if (!rough) {
            continue;
        } else {
            share = find_density(s, w, places, t, b, &to, &distance);
            if (!(share > 0.0f))
                continue;
            rays++;
            if (is_hidden(p, w, to, distance))
                continue;
            if (s->image) {
                float texel[3];
                pell_light_source_image(s, s->position, vec3_mul(to, -1.0f), w->at, texel);
                for (int c = 0; c < 3; c++)
                    power[c] *= texel[c];
            }
        }
        for (int c = 0; c < 3; c++)
            rgb[c] += smaller(w->weight[c] * power[c] * share, 1e25f);
    }
    if (reach == INFINITY)
        see_environments(p, w, rgb);
    return rays;
}
