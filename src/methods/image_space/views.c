/* SPDX-License-Identifier: MIT
 *
 * views.c - irradiance images from the lights, or from around: the translucent surfaces visible from each, and the total irradiance there.
 */
#include "methods/image_space/image_space.h"

#include "math/vec.h"
#include "render/services.h"

#define MAX_HALF_VIEW 1.0471976f /* half the field of view of a light among the objects: 60 degrees */

struct view_task {
    const struct pell_services *services;
    const struct pell_solids *solids;
    const struct is_light_view *to;
};

/* The view's frame is x right, y down, z forward. */
static void write_texel(const struct view_task *t, int i, const struct pell_ray_hit16 *hit, const struct pell_points16_light *light,
                        float *out)
{
    const struct pell_view *v = &t->to->view;
    const struct pell_vec3 p = vec3_sub(vec3(light->position[0][i], light->position[1][i], light->position[2][i]), v->origin);
    const struct pell_vec3 normal = vec3(light->normal[0][i], light->normal[1][i], light->normal[2][i]);
    const float at[3] = { vec3_dot(p, v->right), -vec3_dot(p, v->up), vec3_dot(p, v->forward) };
    const float n[3] = { vec3_dot(normal, v->right), -vec3_dot(normal, v->up), vec3_dot(normal, v->forward) };
    const float plane = n[0] * at[0] + n[1] * at[1] + n[2] * at[2];
    const float distance = sqrtf(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]);
    const int32_t solid = t->solids->of_mesh[hit->hit.mesh[i]];

    if (solid < 0 || !light->valid[i] || (v->orthographic ? fabsf(n[2]) * IS_SLOPE_MAX < 1.0f : fabsf(plane) * IS_SLOPE_MAX < distance) ||
        !(v->orthographic || at[2] > 0.0f))
        return;
    for (int c = 0; c < 3; c++)
        out[IS_RED + c] = light->irradiance[c][i];
    out[IS_W] = v->orthographic ? at[2] : 1.0f / at[2];
    out[IS_GU] = (v->orthographic ? -n[0] / n[2] : n[0] / plane) / v->focal_px;
    out[IS_GV] = (v->orthographic ? -n[1] / n[2] : n[1] / plane) / v->focal_px;
    out[IS_H] = 1.0f / fabsf(v->orthographic ? n[2] : plane);
    out[IS_KEY] = (float) (solid + 1);
}

static void view_row(void *arg, int y, int worker)
{
    const struct view_task *t = arg;
    const struct pell_view *v = &t->to->view;
    _Alignas(64) int valid[16];

    (void) worker;
    for (int x = 0; x < v->width; x += 16) {
        struct pell_ray_hit16 hit;
        struct pell_points16 points;
        struct pell_points16_light light;
        float *out = t->to->texels + IS_TEXEL * ((size_t) y * (size_t) v->width + (size_t) x), spacing = 0.0f;
        int count = 0;

        pell_view_closest16(v, t->services->rays, x, v->width, y, PELL_RAY_TRANSLUCENT, valid, &hit);
        for (int i = 0; i < 16; i++) {
            const bool hits = valid[i] && hit.hit.mesh[i] < t->solids->num_meshes;
            points.mesh[i] = hits ? hit.hit.mesh[i] : PELL_NO_HIT;
            points.triangle[i] = hit.hit.triangle[i];
            points.u[i] = hit.hit.u[i];
            points.v[i] = hit.hit.v[i];
            points.seed[i] = (uint32_t) (y * v->width + x + i);
            spacing += hits ? (v->orthographic ? 1.0f : hit.ray.tfar[i]) / v->focal_px : 0.0f;
            count += hits;
        }
        if (count == 0)
            continue;
        pell_services_light16(
            t->services,
            &(struct pell_points_params) { .mix = -1.0f, .spacing = spacing / (float) count, .samples = t->services->settings->msaa },
            &points, NULL, 16, &light);
        for (int i = 0; i < 16; i++)
            if (points.mesh[i] != PELL_NO_HIT)
                write_texel(t, i, &hit, &light, out + IS_TEXEL * i);
    }
}

/* A square view from the light that just contains the scene's bounds; false: the light illuminates nothing. */
static bool aim(const struct pell_scene *scene, const struct pell_light *light, int size, struct pell_view *v)
{
    const struct pell_vec3 low = vec3_load(scene->bounds_min), high = vec3_load(scene->bounds_max);
    const struct pell_vec3 middle = vec3_mul(vec3_add(low, high), 0.5f);
    const float radius = 0.5f * vec3_length(vec3_sub(high, low)) * 1.0001f;
    struct pell_vec3 to_middle = vec3_sub(middle, vec3_load(light->position));
    float distance;

    *v = (struct pell_view) { .width = size, .height = size };
    if (!(radius > 0.0f && radius < 1e15f))
        return false;
    if (light->type == PELL_LIGHT_DIRECTIONAL) {
        v->orthographic = true;
        v->forward = vec3_normalize(vec3_load(light->direction));
        v->origin = vec3_mad(middle, -2.0f * radius, v->forward);
        v->focal_px = (float) size / (2.0f * radius);
    } else {
        distance = vec3_length(to_middle);
        v->origin = vec3_load(light->position);
        v->forward = distance > 1e-6f * radius ? vec3_mul(to_middle, 1.0f / distance) : vec3(0.0f, 0.0f, -1.0f);
        v->focal_px = 0.5f * (float) size / tanf(distance > radius ? fminf(asinf(radius / distance), MAX_HALF_VIEW) : MAX_HALF_VIEW);
    }
    vec3_basis(v->forward, &v->right, &v->up);
    return v->focal_px > 0.0f && isfinite(v->focal_px);
}

/* A box that contains all translucent surfaces; false: there are none. */
static bool find_box(const struct pell_scene *scene, const struct pell_solids *solids, struct pell_vec3 *low, struct pell_vec3 *high)
{
    bool some = false;

    *low = vec3(INFINITY, INFINITY, INFINITY);
    *high = vec3(-INFINITY, -INFINITY, -INFINITY);
    for (size_t i = 0; i < scene->num_meshes && i < solids->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        for (uint32_t v = 0; v < mesh->num_vertices && solids->of_mesh[i] >= 0; v++) {
            const struct pell_vec3 p = vec3_load(mesh->position + 3 * (size_t) v);
            *low = vec3(fminf(low->x, p.x), fminf(low->y, p.y), fminf(low->z, p.z));
            *high = vec3(fmaxf(high->x, p.x), fmaxf(high->y, p.y), fmaxf(high->z, p.z));
            some = true;
        }
    }
    return some;
}

/* Parallel views of the box along axis index / 2, in both directions. */
static bool aim_along(struct pell_vec3 low, struct pell_vec3 high, int index, int size, struct pell_view *v)
{
    static const float axes[3][3] = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } };
    const struct pell_vec3 middle = vec3_mul(vec3_add(low, high), 0.5f), extent = vec3_sub(high, low);
    const struct pell_vec3 right = vec3_load(axes[(index / 2 + 1) % 3]), up = vec3_load(axes[(index / 2 + 2) % 3]);
    const float side = fmaxf(vec3_dot(extent, right), vec3_dot(extent, up)) * 1.001f, deep = vec3_length(extent);

    *v = (struct pell_view) { .width = size, .height = size, .orthographic = true, .up = up };
    if (!(side > 0.0f && deep < 1e15f))
        return false;
    v->forward = vec3_mul(vec3_load(axes[index / 2]), index & 1 ? -1.0f : 1.0f);
    v->right = vec3_mul(right, index & 1 ? 1.0f : -1.0f); /* right x up = -forward */
    v->origin = vec3_mad(middle, -deep, v->forward);
    v->focal_px = (float) size / side;
    return v->focal_px > 0.0f && isfinite(v->focal_px);
}

/* Renders the irradiance of a view. */
static enum pell_result fill_view(const struct pell_services *services, const struct pell_solids *solids, struct is_light_view *to)
{
    struct view_task task = { services, solids, to };
    const size_t size = (size_t) to->view.width;

    to->texels = pell_calloc(services->ctx, size * size, IS_TEXEL * sizeof(float));
    if (!to->texels)
        return PELL_ERR_NOMEM;
    pell_pool_run(services->pool, to->view.width, view_row, &task);
    return pell_cancelled(services->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

static enum pell_result views_around(const struct pell_services *services, const struct pell_solids *solids, int size,
                                     struct is_light_view *views, int *count)
{
    struct pell_vec3 low, high;
    enum pell_result res = PELL_OK;

    if (!find_box(services->scene, solids, &low, &high))
        return PELL_OK;
    for (int i = 0; i < 6 && res == PELL_OK; i++)
        if (aim_along(low, high, i, size, &views[*count].view))
            res = fill_view(services, solids, &views[(*count)++]);
    return res;
}

enum pell_result is_light_views_make(const struct pell_services *services, const struct pell_solids *solids, const struct is_knobs *k,
                                     struct is_light_view *views, int *count)
{
    const struct pell_scene *scene = services->scene;
    size_t left = 0;

    *count = 0;
    if (k->views == IS_VIEWS_AROUND)
        return views_around(services, solids, k->view_size, views, count);
    for (size_t i = 0; i < scene->num_lights; i++) {
        struct pell_view v;
        enum pell_result res;
        if (scene->lights[i].type == PELL_LIGHT_ENVIRONMENT || !aim(scene, &scene->lights[i], k->view_size, &v))
            continue;
        if (*count == IS_VIEWS_MAX) {
            left++;
            continue;
        }
        views[*count].view = v;
        res = fill_view(services, solids, &views[(*count)++]);
        if (res != PELL_OK)
            return res;
    }
    if (left > 0)
        pell_warn(services->ctx, "image-space", "leave out the dimmest, or take views=eye+around",
                  "%s no irradiance image of their own, at most %d have one",
                  pell_counted((long long) left, "light has", "lights have").str, IS_VIEWS_MAX);
    return PELL_OK;
}
