/* SPDX-License-Identifier: MIT
 *
 * camera_view.h - the camera: from pixels to rays and back. Pixel (x, y) has its centre at (x + 1/2, y + 1/2), y down.
 */
#ifndef PELL_VIEW_H
#define PELL_VIEW_H

#include "math/vec.h"
#include "shared/camera.h"
#include "visibility/rays.h"

#include <pellucid/scene.h>

struct pell_view {
    int width, height;
    bool orthographic;
    float focal_px;                              /* see struct pell_frame */
    float shift_x, shift_y;                      /* of the sample inside the pixel, from its centre, in (-1/2, 1/2) pixels */
    struct pell_vec3 origin, forward, right, up; /* unit, orthogonal; right x up = -forward */
};

struct pell_view pell_view_make(const struct pell_camera *camera, int width, int height, float shift_x, float shift_y);

/* A thin lens in the camera's plane. Its image is the mean of pinhole images from points of the lens (Haeberli and Akeley 1990), whose
 * pixels coincide in the plane in focus: content at depth z is spread over a disc 2 radius focal_px |1/z - 1/focus| pixels across. Each
 * of n points represents 1/n of the lens around it: render/post/dof.h. */
struct pell_lens {
    float radius; /* mm; 0: a pinhole */
    float focus;  /* mm from the camera along its axis */
};

/* Moves a view from the middle of the lens to point i of n, which fill it evenly: their mean is the middle, and with discs of
 * radius / sqrt(n) about them they are as wide as the lens. With n = 1, or without a radius, the view is unchanged. */
void pell_view_through(struct pell_view *view, const struct pell_lens *lens, int i, int n);

/* Width of a pixel at a depth, mm. */
static inline float pell_view_pixel_mm(const struct pell_view *v, float depth)
{
    return (v->orthographic ? 1.0f : depth) / v->focal_px;
}

/* A ray through a pixel with forward component 1, so that the ray parameter is the depth: p = start + depth * direction. */
static inline void pell_view_ray(const struct pell_view *v, float x, float y, struct pell_vec3 *start, struct pell_vec3 *direction)
{
    const float px = pell_camera_right(x, v->shift_x, (float) v->width, v->focal_px);
    const float py = pell_camera_up(y, v->shift_y, (float) v->height, v->focal_px);
    const struct pell_vec3 offset = vec3_add(vec3_mul(v->right, px), vec3_mul(v->up, py));
    if (v->orthographic) {
        *start = vec3_add(v->origin, offset);
        *direction = v->forward;
    } else {
        *start = v->origin;
        *direction = vec3_add(v->forward, offset);
    }
}

/* Closest hits, among the objects in `mask` (PELL_RAY_ALL), of the rays of 16 pixels of row y from x on; valid[i] is -1 for pixels before
 * `end`, else 0. Both are aligned to 64 bytes. */
void pell_view_closest16(const struct pell_view *view, const struct pell_rays *rays, int x, int end, int y, uint32_t mask, int valid[16],
                         struct pell_ray_hit16 *hit);

/* Bounds, with a border of one pixel, of the pixels that the box may cover, clipped to the image; the whole image if the box reaches
 * behind the camera. */
struct pell_rect pell_view_rect(const struct pell_view *v, const float bounds_min[3], const float bounds_max[3]);

/* Extends `a` to include `b`; empty rectangles add nothing. */
static inline void pell_rect_unite(struct pell_rect *a, const struct pell_rect *b)
{
    if (b->x0 >= b->x1)
        return;
    if (a->x0 >= a->x1)
        *a = *b;
    a->x0 = b->x0 < a->x0 ? b->x0 : a->x0;
    a->y0 = b->y0 < a->y0 ? b->y0 : a->y0;
    a->x1 = b->x1 > a->x1 ? b->x1 : a->x1;
    a->y1 = b->y1 > a->y1 ? b->y1 : a->y1;
}

#endif
