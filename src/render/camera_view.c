/* SPDX-License-Identifier: MIT
 * camera_view.c - from a camera to a view, and from a box to the pixels that it may cover. */
#include "render/camera_view.h"

#include "math/sampling.h"

#include <math.h>
#include <string.h>

struct pell_view pell_view_make(const struct pell_camera *camera, int width, int height, float shift_x, float shift_y)
{
    const struct pell_vec3 forward = vec3_normalize(vec3_load(camera->forward));
    const struct pell_vec3 right = vec3_normalize(vec3_cross(forward, vec3_load(camera->up)));
    const double extent = camera->ortho_height > 0.0f ? (double) camera->ortho_height : 2.0 * tan(0.5 * (double) camera->fov);

    return (struct pell_view) {
        .width = width,
        .height = height,
        .orthographic = camera->ortho_height > 0.0f,
        .focal_px = (float) ((double) height / extent),
        .shift_x = shift_x,
        .shift_y = shift_y,
        .origin = vec3_load(camera->position),
        .forward = forward,
        .right = right,
        .up = vec3_cross(right, forward),
    };
}

static int common_divisor(int a, int b)
{
    while (b) {
        const int rest = a % b;
        a = b;
        b = rest;
    }
    return a;
}

void pell_view_through(struct pell_view *v, const struct pell_lens *lens, int i, int n)
{
    int stride = (int) (PELL_GOLDEN_TURN * n) + 1;
    double p[2];

    if (!(lens->radius > 0.0f) || n <= 1)
        return;
    while (common_divisor(stride, n) != 1) /* in another order than the positions in the pixel */
        stride++;
    pell_sunflower_point((int) ((int64_t) i * stride % n), n, p);
    v->origin = vec3_mad(v->origin, (float) (lens->radius * p[0]), v->right);
    v->origin = vec3_mad(v->origin, (float) (lens->radius * p[1]), v->up);
    v->shift_x -= (float) (v->focal_px * lens->radius * p[0] / lens->focus);
    v->shift_y += (float) (v->focal_px * lens->radius * p[1] / lens->focus);
}

/* First pixel whose centre is at or above `low`, less the border, in [0, size]; the same for the end. Clamps before it converts: large
 * numbers would overflow. */
static int first_pixel(double low, int size)
{
    const double x = ceil(low) - 1.0;
    return x < 0.0 ? 0 : x > (double) size ? size : (int) x;
}

static int end_pixel(double high, int size)
{
    const double x = floor(high) + 2.0;
    return x < 0.0 ? 0 : x > (double) size ? size : (int) x;
}

struct pell_rect pell_view_rect(const struct pell_view *v, const float bounds_min[3], const float bounds_max[3])
{
    const struct pell_rect all = { 0, 0, v->width, v->height }, none = { 0 };
    double low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY };
    bool reaches_behind = false, in_front = false;

    for (int c = 0; c < 3; c++)
        if (bounds_min[c] > bounds_max[c])
            return none;
    for (int i = 0; i < 8; i++) {
        const double p[3] = { (i & 1) ? bounds_max[0] : bounds_min[0], (i & 2) ? bounds_max[1] : bounds_min[1],
                              (i & 4) ? bounds_max[2] : bounds_min[2] };
        const double d[3] = { p[0] - v->origin.x, p[1] - v->origin.y, p[2] - v->origin.z };
        const double x = d[0] * v->right.x + d[1] * v->right.y + d[2] * v->right.z;
        const double y = d[0] * v->up.x + d[1] * v->up.y + d[2] * v->up.z;
        const double z = d[0] * v->forward.x + d[1] * v->forward.y + d[2] * v->forward.z;
        /* The inverse of pell_view_ray; a corner so near to the camera's plane that rounding decides its side is taken to be behind it. */
        const double size = fabs(d[0]) + fabs(d[1]) + fabs(d[2]);
        const double scale = v->focal_px / (v->orthographic ? 1.0 : z);
        const double px = x * scale + 0.5 * v->width - 0.5 - v->shift_x, py = 0.5 * v->height - 0.5 - v->shift_y - y * scale;

        if (!isfinite(size))
            return all;
        in_front |= z > 0.0;
        reaches_behind |= !v->orthographic && !(z > 1e-5 * size);
        low[0] = fmin(low[0], px);
        high[0] = fmax(high[0], px);
        low[1] = fmin(low[1], py);
        high[1] = fmax(high[1], py);
    }
    if (!in_front)
        return none;
    if (reaches_behind)
        return all;

    const struct pell_rect rect = { first_pixel(low[0], v->width), first_pixel(low[1], v->height), end_pixel(high[0], v->width),
                                    end_pixel(high[1], v->height) };
    return rect.x0 < rect.x1 && rect.y0 < rect.y1 ? rect : none;
}

void pell_view_closest16(const struct pell_view *view, const struct pell_rays *rays, int x, int end, int y, uint32_t mask, int valid[16],
                         struct pell_ray_hit16 *hit)
{
    memset(hit, 0, sizeof(*hit));
    for (int i = 0; i < 16; i++) {
        struct pell_vec3 start, direction;
        pell_view_ray(view, (float) (x + i), (float) y, &start, &direction);
        valid[i] = x + i < end ? -1 : 0;
        pell_ray16_set(&hit->ray, i, start, direction, INFINITY);
        hit->ray.mask[i] = mask;
        hit->hit.mesh[i] = PELL_NO_HIT;
    }
    pell_rays_closest16(rays, valid, true, hit);
}
