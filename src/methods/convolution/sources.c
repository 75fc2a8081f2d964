/* SPDX-License-Identifier: MIT
 *
 * sources.c - samples of the surface: pixels, and hits of rays that pass through them to the surface behind. Each has the area that its
 * pixel, or cell of pixels, covers: depth^2/f^2 / |n . d|, d the ray direction with a unit component along the view axis, or 1/f^2 / |n .
 * axis| in a parallel view.
 */
#include "methods/convolution/convolution.h"

#include "math/vec.h"
#include "render/services.h"
#include "scene/triangle.h"

#include <string.h>

#define MIN_CARRIED 1e-3f

/* --- Visible surface ---------------------------------------------------------------------------------------------------------------- */

/* `facing`: |n . d|: 1 for surface parallel to the planes, and more for surface at the side of the image that faces the camera. */
static void cover(const struct conv_sources *s, float depth, float facing, float *area, float *slant)
{
    const float f = facing > CONV_COS_MIN ? facing : CONV_COS_MIN, mm = s->one_size ? 1.0f : conv_pixel_at(s->in, depth);

    *area = mm * mm / f;
    *slant = f < 1.0f ? sqrtf(1.0f - f) : 1.0f - f;
}

struct conv_depths convolution_depths(const struct conv_sources *s, float median)
{
    const struct pell_frame *in = s->in;

    return (struct conv_depths) {
        .depth = in->depth,
        .group = s->front.group,
        .stride = in->shape.stride,
        .group_stride = s->front.stride,
        .x0 = in->rect.x0,
        .y0 = in->rect.y0,
        .x1 = in->rect.x1,
        .y1 = in->rect.y1,
        .parallel = in->shape.orthographic,
        .one_size = s->one_size,
        .focal_px = in->shape.focal_px,
        .middle_x = 0.5f * (float) in->shape.width,
        .middle_y = 0.5f * (float) in->shape.height,
        .median_px = median * in->shape.focal_px,
    };
}

static struct pell_vec3 ray_of(const struct conv_sources *s, float x, float y, struct pell_vec3 *start)
{
    struct pell_vec3 direction;

    pell_view_ray(&s->view, x, y, start, &direction);
    return direction;
}

static struct pell_vec3 triangle_normal(const struct pell_scene *scene, uint32_t mesh, uint32_t triangle)
{
    struct pell_vec3 corner[3];

    pell_triangle_corners(&scene->meshes[mesh], triangle, corner);
    return vec3_normalize(pell_triangle_cross(corner));
}

void convolution_front_row(const struct conv_sources *s, int y)
{
    const struct pell_frame *in = s->in;
    const struct conv_front *f = &s->front;
    const struct pell_view *v = &s->view;
    const struct pell_scene *scene = s->solids ? s->services->scene : NULL;
    const struct conv_depths depths = convolution_depths(s, 0.0f);
    uint32_t mesh = PELL_NO_HIT, triangle = 0;
    float across = 0.0f, first = 0.0f; /* n . d of the triangle, linear along the row */

    for (int x = in->rect.x0; x < in->rect.x1 && s->solids; x++) {
        const ptrdiff_t at = y * in->shape.stride + x, to = y * f->stride + x;
        if (!f->group[to])
            continue;
        if (in->mesh[at] != mesh || in->triangle[at] != triangle) {
            struct pell_vec3 start;
            const struct pell_vec3 d = ray_of(s, 0.0f, (float) y, &start);
            struct pell_vec3 n;
            mesh = in->mesh[at];
            triangle = in->triangle[at];
            n = triangle_normal(scene, mesh, triangle);
            first = vec3_dot(d, n);
            across = v->orthographic ? 0.0f : vec3_dot(v->right, n) / v->focal_px;
        }
        f->slant[to] = fabsf(first + (float) x * across);
    }
    s->kernels->cover(&depths, y, in->rect.x0, in->rect.x1, !s->solids, f->area + y * f->stride, f->slant + y * f->stride);
}

/* --- Hidden surface ------------------------------------------------------------------------------------------------------------------ */

/* Sets the view and the distance where rays start. */
void convolution_sources_aim(struct conv_sources *s)
{
    const struct pell_scene *scene = s->services->scene;
    float far = 0.0f, size = 0.0f;

    s->view = *s->in->view;
    for (int i = 0; i < 8; i++) {
        const struct pell_vec3 corner =
            vec3(i & 1 ? scene->bounds_max[0] : scene->bounds_min[0], i & 2 ? scene->bounds_max[1] : scene->bounds_min[1],
                 i & 4 ? scene->bounds_max[2] : scene->bounds_min[2]);
        far = fmaxf(far, vec3_dot(vec3_sub(corner, s->view.origin), s->view.forward));
        size = fmaxf(size, vec3_length(corner));
    }
    s->far_depth = far + 1e-3f * (far + size);
}

/* Cells of a row that contain pixels, up to 16 at a time. */
struct cells {
    int x[16], count;
    float front[16]; /* farthest visible depth in the cell */
    uint16_t group[16];
    struct pell_vec3 direction[16];
};

static float cell_middle(const struct conv_behind *b, int cell)
{
    return (float) (cell * b->step) + 0.5f * (float) (b->step - 1);
}

/* Fraction of a sample's light that the planes carry. Faces with the orientation of pixels, toward the camera or nearly so past a rim,
 * light the pixel along the surface; others through the object: by the planes, or by the engine where it solves diffusion in the solid;
 * `transmitted`: pell_services_transmitted. */
static bool find_carried(const struct conv_sources *s, const struct pell_points16 *points, const float transmitted[3][16], int i,
                         struct pell_vec3 normal, struct pell_vec3 direction, float carried[3], float *along)
{
    const float away = fminf(vec3_dot(normal, direction), 1.0f);
    float most = 0.0f;

    carried[0] = carried[1] = carried[2] = *along = 1.0f;
    if (away > 0.0f) {
        *along = 1.0f - away * away;
        for (int c = 0; c < 3; c++)
            carried[c] =
                s->by_slab && s->by_slab[s->solids->solids[s->solids->of_mesh[points->mesh[i]]].material] ? 0.0f : transmitted[c][i];
    }
    for (int c = 0; c < 3; c++) {
        carried[c] += *along * (1.0f - carried[c]);
        most = fmaxf(most, carried[c]);
    }
    return most > MIN_CARRIED;
}

/* Ray hits and their attributes. */
struct ray_hits {
    struct pell_points16 points;
    struct pell_points16_light light;
    float transmitted[3][16]; /* pell_services_transmitted */
    float depth[16];
};

static void put_sample(const struct conv_sources *s, const struct cells *c, int i, int layer, int cell_y, const struct ray_hits *ray_hits)
{
    const struct conv_behind *b = &s->behind;
    const struct pell_points16_light *light = &ray_hits->light;
    const size_t to = ((size_t) layer * (size_t) b->height + (size_t) cell_y) * (size_t) b->width + (size_t) c->x[i];
    const struct pell_vec3 n = vec3(light->normal[0][i], light->normal[1][i], light->normal[2][i]);
    float carried[3], along;

    if (!find_carried(s, &ray_hits->points, ray_hits->transmitted, i, n, c->direction[i], carried, &along))
        return;
    if (layer > 0 && light->irradiance[0][i] == 0.0f && light->irradiance[1][i] == 0.0f && light->irradiance[2][i] == 0.0f)
        along = 0.0f; /* probably one part of the object inside another, which receives no light */
    cover(s, ray_hits->depth[i], fabsf(vec3_dot(c->direction[i], n)), &b->area[to], &b->slant[to]);
    b->area[to] *= (float) (b->step * b->step);
    b->depth[to] = ray_hits->depth[i];
    b->group[to] = (uint16_t) (s->solids->of_mesh[ray_hits->points.mesh[i]] + 1);
    for (int k = 0; k < 3; k++) {
        b->light[k][to] = light->irradiance[k][i];
        b->carried[k][to] = carried[k];
        b->along_surface[k][to] = along / fmaxf(carried[k], MIN_CARRIED);
    }
}

/* Whether a hit belongs to the visible surface and is therefore a pixel already: a triangle of one of the cell's pixels, or one that faces
 * the camera and is no farther than they are. */
static bool is_seen(const struct conv_sources *s, const struct cells *c, int i, int cell_y, const struct pell_ray_hit16 *hit, float depth)
{
    const struct pell_frame *in = s->in;
    const int n = s->behind.step, x0 = c->x[i] * n, y0 = cell_y * n;
    const struct pell_vec3 normal = vec3_normalize(vec3(hit->hit.ngx[i], hit->hit.ngy[i], hit->hit.ngz[i]));
    const float facing = -vec3_dot(normal, c->direction[i]), least = facing > CONV_COS_MIN ? facing : CONV_COS_MIN;
    /* allowing for its slope across the cell */
    const float across = (float) n * conv_pixel_at(in, depth) * sqrtf(facing < 1.0f ? 1.0f - facing * facing : 0.0f) / least;

    if (facing > 0.0f && depth <= c->front[i] + 1e-4f * s->far_depth + across)
        return true;
    for (int y = y0 > in->rect.y0 ? y0 : in->rect.y0; y < y0 + n && y < in->rect.y1; y++)
        for (int x = x0 > in->rect.x0 ? x0 : in->rect.x0; x < x0 + n && x < in->rect.x1; x++)
            if (s->front.group[y * s->front.stride + x] && in->mesh[y * in->shape.stride + x] == hit->hit.mesh[i] &&
                in->triangle[y * in->shape.stride + x] == hit->hit.triangle[i])
                return true;
    return false;
}

/* Traces the rays of some cells behind the visible surface through the requested number of layers. */
static int trace_cells(const struct conv_sources *s, const struct cells *c, int cell_y)
{
    const struct conv_behind *b = &s->behind;
    _Alignas(64) int open[16] = { 0 };
    struct pell_ray_hit16 hit;
    int rays = 0;

    memset(&hit, 0, sizeof(hit));
    for (int i = 0; i < c->count; i++) {
        struct pell_vec3 start;
        ray_of(s, cell_middle(b, c->x[i]), cell_middle(b, cell_y), &start);
        start = vec3_mad(start, s->far_depth, c->direction[i]);
        open[i] = -1;
        hit.ray.ox[i] = start.x;
        hit.ray.oy[i] = start.y;
        hit.ray.oz[i] = start.z;
        hit.ray.dx[i] = -c->direction[i].x;
        hit.ray.dy[i] = -c->direction[i].y;
        hit.ray.dz[i] = -c->direction[i].z;
        hit.ray.mask[i] = PELL_RAY_TRANSLUCENT;
    }
    for (int layer = 0; layer < b->layers; layer++) {
        struct ray_hits ray_hits;
        float spacing = 0.0f;
        int num_hits = 0;
        for (int i = 0; i < 16; i++) {
            hit.ray.tfar[i] = s->far_depth;
            hit.hit.mesh[i] = PELL_NO_HIT;
            rays += open[i] != 0;
        }
        pell_rays_closest16(s->services->rays, open, true, &hit);
        for (int i = 0; i < 16; i++) {
            bool hidden = open[i] && hit.hit.mesh[i] < s->solids->num_meshes;
            ray_hits.depth[i] = s->far_depth - hit.ray.tfar[i];
            hidden = hidden && !is_seen(s, c, i, cell_y, &hit, ray_hits.depth[i]);
            open[i] = hidden ? -1 : 0;
            hit.ray.tnear[i] = hit.ray.tfar[i] + 2e-5f * s->far_depth;
            ray_hits.points.mesh[i] = hidden ? hit.hit.mesh[i] : PELL_NO_HIT;
            ray_hits.points.triangle[i] = hit.hit.triangle[i];
            ray_hits.points.u[i] = hit.hit.u[i];
            ray_hits.points.v[i] = hit.hit.v[i];
            ray_hits.points.seed[i] = (uint32_t) ((layer * b->height + cell_y) * b->width + (i < c->count ? c->x[i] : 0));
            spacing += hidden ? conv_pixel_at(s->in, ray_hits.depth[i]) * (float) b->step : 0.0f;
            num_hits += hidden;
        }
        if (num_hits == 0)
            break;
        rays += (int) pell_services_light16(
            s->services,
            &(struct pell_points_params) {
                .mix = -1.0f, .spacing = spacing / (float) num_hits, .samples = s->in->num_samples, .local = s->by_slab != NULL },
            &ray_hits.points, NULL, 16, &ray_hits.light);
        pell_services_transmitted(s->services, &ray_hits.points, 16, ray_hits.transmitted);
        for (int i = 0; i < c->count; i++)
            if (open[i] && ray_hits.light.valid[i] && s->solids->of_mesh[ray_hits.points.mesh[i]] >= 0)
                put_sample(s, c, i, layer, cell_y, &ray_hits);
    }
    return rays;
}

/* The farthest depth of a cell's pixels; 0: none. */
static float front_of(const struct conv_sources *s, int cell_x, int cell_y)
{
    const struct pell_frame *in = s->in;
    const int n = s->behind.step, x0 = cell_x * n, y0 = cell_y * n;
    float front = 0.0f;

    for (int y = y0; y < y0 + n && y < in->rect.y1; y++)
        for (int x = x0; x < x0 + n && x < in->rect.x1; x++)
            if (y >= in->rect.y0 && x >= in->rect.x0 && s->front.group[y * s->front.stride + x])
                front = in->depth[y * in->shape.stride + x] > front ? in->depth[y * in->shape.stride + x] : front;
    return front;
}

int convolution_behind_row(const struct conv_sources *s, int cell_y)
{
    const struct conv_behind *b = &s->behind;
    const size_t row = (size_t) cell_y * (size_t) b->width;
    struct cells c = { .count = 0 };
    int rays = 0;

    for (int k = 0; k < b->layers; k++)
        memset(b->group + (size_t) k * (size_t) b->height * (size_t) b->width + row, 0, (size_t) b->width * sizeof(*b->group));
    for (int x = s->in->rect.x0 / b->step; x <= (s->in->rect.x1 - 1) / b->step; x++) {
        const float front = front_of(s, x, cell_y);
        struct pell_vec3 start;
        if (!(front > 0.0f))
            continue;
        c.direction[c.count] = ray_of(s, cell_middle(b, x), cell_middle(b, cell_y), &start);
        c.front[c.count] = front;
        c.x[c.count++] = x;
        if (c.count == 16) {
            rays += trace_cells(s, &c, cell_y);
            c.count = 0;
        }
    }
    return c.count > 0 ? rays + trace_cells(s, &c, cell_y) : rays;
}
