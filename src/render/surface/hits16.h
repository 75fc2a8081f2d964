/* SPDX-License-Identifier: MIT
 *
 * hits16.h - surface at 16 hits of one mesh: vertex data, normals, maps; part of kernel.c, so compiled per SIMD level.
 *
 * Vertex data is gathered lane by lane; everything else is loops over 16 lanes that the compiler vectorizes.
 *
 * Footprint. A pixel covers the area A = k^2 / |n . D| of the surface, n unit, D the ray's direction with forward component 1, k the size
 * of a pixel at that depth: depth / focal (perspective) or 1 / focal (orthographic). With Embree's Ng, twice the triangle's area long, a
 * texture of w x h texels has 2 |uv area| w h k^2 / |Ng . D| texels in the pixel; half the binary logarithm is the mipmap level (Williams
 * 1983).
 */
#ifndef PELL_SURFACE_HITS16_H
#define PELL_SURFACE_HITS16_H

#include "image/color.h"
#include "math/scalar.h"
#include "render/surface/kernel.h"
#include "render/surface/sample16.h"
#include "shared/camera.h"

#include <float.h>
#include <math.h>

/* Least cosine for the size of the texture filter: beyond it an isotropic filter would blur the other axis too much. */
#define GRAZING 0.0625f

struct vec16 {
    float16 x, y, z;
};

/* 16 hits. */
struct hits {
    const struct pell_mesh *mesh;
    const struct pell_material *material;
    const struct pyramid *const *pyramids; /* per map; NULL: no mipmaps */
    const struct surface_decode *decode;
    uint32_t lanes; /* bit i: lane i is active */
    int16lanes on;  /* the same, -1 or 0 */
    uint32_t vertex[3][LANES];
    const struct pell_corners *corners; /* of the triangles; NULL: not known */
    float16 w0, w1, w2;                 /* barycentric weights */
    const struct pell_ray_hit16 *packet;
    const struct pell_view *camera;
    float16 footprint; /* k^2 / |Ng . D| */
    bool has_footprint;
    struct vec16 view; /* unit, to the viewer */
    struct uv16 uv[PELL_UV_SETS];
    bool has_uv[PELL_UV_SETS];
    float16 bumps; /* slope variance of the normal map inside a pixel */
    bool bumpy;
};

struct shaded {
    struct vec16 ng, ns;
    float16 base[3], specular[3], emissive[3], transmission[3], reflection, roughness, slope_variance, metallic, strength,
        terminator_offset;
};

static inline float dot(const struct vec16 *a, const struct vec16 *b, int i)
{
    return a->x[i] * b->x[i] + a->y[i] * b->y[i] + a->z[i] * b->z[i];
}

/* --- Vertex data -------------------------------------------------------------------------------------------------------------- */

/* Interpolates component `c` of a vertex attribute of `size` floats. */
static void interpolate(const struct hits *h, const float *data, size_t size, size_t c, float *restrict out)
{
    float16 a[3];

    for (int k = 0; k < 3; k++)
        for (int i = 0; i < LANES; i++)
            a[k][i] = data[size * h->vertex[k][i] + c];
    for (int i = 0; i < LANES; i++)
        out[i] = h->w0[i] * a[0][i] + h->w1[i] * a[1][i] + h->w2[i] * a[2][i];
}

/* Loads the first three components of a vertex attribute at the three corners. */
static void corners(const struct hits *h, const float *data, size_t size, struct vec16 a[restrict 3])
{
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < LANES; i++) {
            const float *p = data + size * h->vertex[k][i];
            a[k].x[i] = p[0];
            a[k].y[i] = p[1];
            a[k].z[i] = p[2];
        }
}

static void blend(const struct hits *h, const struct vec16 *restrict a, struct vec16 *restrict out)
{
    for (int i = 0; i < LANES; i++) {
        out->x[i] = h->w0[i] * a[0].x[i] + h->w1[i] * a[1].x[i] + h->w2[i] * a[2].x[i];
        out->y[i] = h->w0[i] * a[0].y[i] + h->w1[i] * a[1].y[i] + h->w2[i] * a[2].y[i];
        out->z[i] = h->w0[i] * a[0].z[i] + h->w1[i] * a[1].z[i] + h->w2[i] * a[2].z[i];
    }
}

static void interpolate3(const struct hits *h, const float *data, size_t size, struct vec16 *restrict out)
{
    struct vec16 a[3];

    corners(h, data, size, a);
    blend(h, a, out);
}

static void measure_footprint(const struct pell_view *view, const struct pell_ray_hit16 *restrict p, struct hits *restrict h)
{
    const float per_depth = view->orthographic ? 0.0f : 1.0f / view->focal_px, fixed = view->orthographic ? 1.0f / view->focal_px : 0.0f;

    for (int i = 0; i < LANES; i++) {
        const float gx = h->on[i] ? p->hit.ngx[i] : 0.0f, gy = h->on[i] ? p->hit.ngy[i] : 0.0f, gz = h->on[i] ? p->hit.ngz[i] : 0.0f;
        const float dx = p->ray.dx[i], dy = p->ray.dy[i], dz = p->ray.dz[i], t = h->on[i] ? p->ray.tfar[i] : 1.0f;
        const float facing = fabsf(gx * dx + gy * dy + gz * dz), pixel = fixed + per_depth * t;
        const float least = GRAZING * sqrtf(dx * dx + dy * dy + dz * dz) * sqrtf(gx * gx + gy * gy + gz * gz);
        h->footprint[i] = pixel * pixel / larger(larger(facing, least), FLT_MIN);
    }
    h->has_footprint = true;
}

/* Texture coordinates of a UV set, and the area of a pixel in the texture's unit square. */
static const struct uv16 *coordinates(struct hits *h, int set)
{
    struct uv16 *out = &h->uv[set];
    float16 u[3], v[3];

    if (h->has_uv[set])
        return out;
    h->has_uv[set] = true;
    if (!h->has_footprint)
        measure_footprint(h->camera, h->packet, h);
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < LANES; i++) {
            const float *p = h->mesh->uv[set] + 2 * (size_t) h->vertex[k][i];
            u[k][i] = p[0];
            v[k][i] = p[1];
        }
    for (int i = 0; i < LANES; i++) {
        const float det = (u[1][i] - u[0][i]) * (v[2][i] - v[0][i]) - (u[2][i] - u[0][i]) * (v[1][i] - v[0][i]);
        out->u[i] = h->w0[i] * u[0][i] + h->w1[i] * u[1][i] + h->w2[i] * u[2][i];
        out->v[i] = h->w0[i] * v[0][i] + h->w1[i] * v[1][i] + h->w2[i] * v[2][i];
        out->area[i] = fabsf(det) * h->footprint[i];
    }
    return out;
}

/* Samples a map's `channels` (bits) into rgba; false if the material has no such map or the mesh no such UV set. */
static bool look_up(struct hits *h, enum pell_map which, unsigned channels, float16 *restrict rgba)
{
    const struct pell_texture_map *map = pell_material_map(h->material, which);
    const struct pyramid *pyramid = h->pyramids ? h->pyramids[which] : NULL;

    if (!map->texture || !h->mesh->uv[map->uv])
        return false;
    if (!pyramid) {
        const struct pyramid alone = pyramid_of(&map->texture->image);
        sample16(&alone, map, h->decode, coordinates(h, map->uv), h->lanes, channels, rgba);
    } else {
        sample16(pyramid, map, h->decode, coordinates(h, map->uv), h->lanes, channels, rgba);
    }
    return true;
}

/* --- Normals ------------------------------------------------------------------------------------------------------------------ */

/* Unit geometric normals on the viewer's side; the direction to the viewer for triangles without area. */
static void geometric_normals(const struct pell_hit16 *hit, struct hits *h, struct vec16 *restrict ng)
{
    for (int i = 0; i < LANES; i++) {
        const float hx = hit->ngx[i], hy = hit->ngy[i], hz = hit->ngz[i];
        const float x = h->on[i] ? hx : 0.0f, y = h->on[i] ? hy : 0.0f, z = h->on[i] ? hz : 0.0f;
        const float largest = larger(larger(fabsf(x), fabsf(y)), fabsf(z));
        const bool good = largest > 0.0f;
        /* Squared areas of very small and very large triangles are out of range. */
        const float scale = good ? 1.0f / largest : 0.0f;
        const float gx = good ? x * scale : h->view.x[i], gy = good ? y * scale : h->view.y[i], gz = good ? z * scale : h->view.z[i];
        const float inverse = 1.0f / sqrtf(gx * gx + gy * gy + gz * gz);
        const float side = gx * h->view.x[i] + gy * h->view.y[i] + gz * h->view.z[i] < 0.0f ? -inverse : inverse;
        ng->x[i] = gx * side;
        ng->y[i] = gy * side;
        ng->z[i] = gz * side;
    }
}

/* Slope variance of the normals whose mean a normal map stores. */
static void measure_bumps(struct hits *h, const float16 *restrict rgba)
{
    const struct pell_texture_map *map = &h->material->normal_map;
    const struct pell_image *image = &map->texture->image;
    const float texels =
        (float) image->width * (float) image->height * fabsf(map->matrix[0] * map->matrix[4] - map->matrix[1] * map->matrix[3]);
    const struct uv16 *uv = coordinates(h, map->uv);
    const float scale = h->material->normal_scale;

    h->bumpy = true;
    for (int i = 0; i < LANES; i++) {
        const float x = 2.0f * rgba[0][i] - 1.0f, y = 2.0f * rgba[1][i] - 1.0f, z = 2.0f * rgba[2][i] - 1.0f, r2 = x * x + y * y + z * z;
        h->bumps[i] = pell_bumps(r2, uv->area[i] * texels, scale);
    }
}

/* Widens lobes by the bumps of the normal map. */
static void widen_lobes(const struct hits *h, float *restrict roughness)
{
    const bool linear = h->material->specular == PELL_SPECULAR_KELEMEN;

    for (int i = 0; i < LANES; i++)
        roughness[i] = pell_bumpy_roughness(roughness[i], h->bumps[i], linear);
}

/* Normal mapping as glTF 2.0, section 3.9.3, and the tangent frame of section 3.7.2.1: b = w n x t, green is +b. */
static void map_normals(struct hits *h, struct vec16 *restrict n)
{
    float16 rgba[4], handed;
    struct vec16 t;
    const float scale = h->material->normal_scale;

    if (!h->material->normal_map.texture || !h->mesh->tangent || !look_up(h, PELL_MAP_NORMAL, 7, rgba))
        return;
    measure_bumps(h, rgba);
    interpolate3(h, h->mesh->tangent, 4, &t);
    interpolate(h, h->mesh->tangent, 4, 3, handed);
    for (int i = 0; i < LANES; i++) {
        const float tt = dot(&t, &t, i), it = tt > 0.0f ? 1.0f / sqrtf(tt) : 0.0f, s = handed[i] < 0.0f ? -1.0f : 1.0f;
        const float tx = t.x[i] * it, ty = t.y[i] * it, tz = t.z[i] * it, nx = n->x[i], ny = n->y[i], nz = n->z[i];
        const float bx = s * (ny * tz - nz * ty), by = s * (nz * tx - nx * tz), bz = s * (nx * ty - ny * tx);
        const float a = scale * (2.0f * rgba[0][i] - 1.0f), b = scale * (2.0f * rgba[1][i] - 1.0f), c = 2.0f * rgba[2][i] - 1.0f;
        const float x = a * tx + b * bx + c * nx, y = a * ty + b * by + c * ny, z = a * tz + b * bz + c * nz;
        const float length2 = x * x + y * y + z * z;
        const bool good = tt > 0.0f && length2 > 1e-8f;
        const float inverse = 1.0f / sqrtf(good ? length2 : 1.0f);
        n->x[i] = good ? x * inverse : nx;
        n->y[i] = good ? y * inverse : ny;
        n->z[i] = good ? z * inverse : nz;
    }
}

/* Moves n to the nearest normal in the half-space n . to >= PELL_MIN_VISIBLE_COSINE, if it is not there: the projection onto that
 * half-space. What is interpolated and mapped may point away from the viewer where the triangle does not; shaded as it is, silhouettes
 * would be black. */
static void bend(struct vec16 *restrict n, const struct vec16 *restrict to)
{
    float16 missing;
    int any = 0;

    for (int i = 0; i < LANES; i++) {
        missing[i] = pell_bend_missing(dot(n, to, i));
    }
    for (int i = 0; i < LANES; i++)
        any |= missing[i] > 0.0f;
    if (!any) /* nearly always */
        return;
    for (int i = 0; i < LANES; i++) {
        const float x = n->x[i] + missing[i] * to->x[i], y = n->y[i] + missing[i] * to->y[i], z = n->z[i] + missing[i] * to->z[i];
        const float inverse = 1.0f / sqrtf(x * x + y * y + z * z);
        const bool on = missing[i] > 0.0f;
        n->x[i] = on ? x * inverse : n->x[i];
        n->y[i] = on ? y * inverse : n->y[i];
        n->z[i] = on ? z * inverse : n->z[i];
    }
}

/* Distance along n from the hit to the smooth surface that the normals v of its triangle suggest: the mean of its distances to the three
 * tangent planes (Hanika 2021, "Hacking the Shadow Terminator"). Shadow rays that start as far up do not show the triangles of a coarse
 * mesh as dark facets where light grazes. Hanika leaves out planes below the hit; in waists, where some are above and some below, or all
 * below, triangles would stay dark. */
static void terminator_offsets(const struct hits *h, const struct vec16 v[restrict 3], const struct vec16 *restrict n, float *restrict out)
{
    const struct vec16 *p;
    struct vec16 fetched[3], at, sum = { { 0 } };

    if (h->corners) {
        p = (const struct vec16 *) h->corners->position;
    } else {
        corners(h, h->mesh->position, 3, fetched);
        p = fetched;
    }
    blend(h, p, &at);
    for (int k = 0; k < 3; k++) {
        const float *w = k == 0 ? h->w0 : k == 1 ? h->w1 : h->w2;
        for (int i = 0; i < LANES; i++) {
            const float side = dot(&v[k], n, i) < 0.0f ? -1.0f : 1.0f; /* seen from inside, the normals are inverted */
            const float under =
                side * ((p[k].x[i] - at.x[i]) * v[k].x[i] + (p[k].y[i] - at.y[i]) * v[k].y[i] + (p[k].z[i] - at.z[i]) * v[k].z[i]);
            const float weight = side * w[i] * fabsf(under);
            sum.x[i] += weight * v[k].x[i];
            sum.y[i] += weight * v[k].y[i];
            sum.z[i] += weight * v[k].z[i];
        }
    }
    for (int i = 0; i < LANES; i++) {
        const float l = dot(&sum, n, i);
        out[i] = h->on[i] && l > 0.0f ? l : 0.0f;
    }
}

/* Slope variance of the smooth surface inside a pixel, from the normals v at the corners and the pixel's two axes on the triangle
 * (Tokuyoshi and Kaplanyan 2019, "Improved Geometric Specular Antialiasing"). */
static void measure_slope_variance(const struct hits *h, const struct vec16 v[restrict 3], float spread, float *restrict out)
{
    const struct pell_view view = *h->camera;
    const float per_depth = view.orthographic ? 0.0f : 1.0f / view.focal_px, fixed = view.orthographic ? 1.0f / view.focal_px : 0.0f;
    const struct vec16 *p;
    struct vec16 fetched[3];

    if (h->corners) {
        p = (const struct vec16 *) h->corners->position;
    } else {
        corners(h, h->mesh->position, 3, fetched);
        p = fetched;
    }
    for (int i = 0; i < LANES; i++) {
        const struct pell_vec3 d = { h->packet->ray.dx[i], h->packet->ray.dy[i], h->packet->ray.dz[i] };
        const struct pell_vec3 a = { p[1].x[i] - p[0].x[i], p[1].y[i] - p[0].y[i], p[1].z[i] - p[0].z[i] };
        const struct pell_vec3 b = { p[2].x[i] - p[0].x[i], p[2].y[i] - p[0].y[i], p[2].z[i] - p[0].z[i] };
        const struct pell_vec3 n = vec3_cross(a, b);
        const float nn = vec3_dot(n, n), nd = vec3_dot(n, d), least = GRAZING * sqrtf(vec3_dot(d, d) * nn), size = fabsf(nd);
        const float facing = nd < 0.0f ? -larger(size, least) : larger(size, least);
        const float pixel = fixed + per_depth * (h->on[i] ? h->packet->ray.tfar[i] : 1.0f);
        float sum = 0.0f;
        for (int k = 0; k < 2; k++) {
            const struct pell_vec3 axis = k == 0 ? view.right : view.up;
            const struct pell_vec3 step = vec3_mad(axis, -vec3_dot(n, axis) / facing, d);
            const float s = vec3_dot(vec3_cross(step, b), n) / nn, t = vec3_dot(vec3_cross(a, step), n) / nn;
            const float x = s * (v[1].x[i] - v[0].x[i]) + t * (v[2].x[i] - v[0].x[i]);
            const float y = s * (v[1].y[i] - v[0].y[i]) + t * (v[2].y[i] - v[0].y[i]);
            const float z = s * (v[1].z[i] - v[0].z[i]) + t * (v[2].z[i] - v[0].z[i]);
            sum += x * x + y * y + z * z;
        }
        out[i] = pell_slope_variance(pixel * pixel * sum, spread);
    }
}

static void shading_normals(struct hits *h, const struct vec16 v[restrict 3], const struct vec16 *restrict ng, struct vec16 *restrict ns)
{
    struct vec16 n;
    float16 side;

    blend(h, v, &n);
    for (int i = 0; i < LANES; i++) {
        const float length2 = dot(&n, &n, i);
        const bool good = length2 > 1e-8f;
        const float inverse = 1.0f / sqrtf(good ? length2 : 1.0f);
        n.x[i] = good ? n.x[i] * inverse : ng->x[i];
        n.y[i] = good ? n.y[i] * inverse : ng->y[i];
        n.z[i] = good ? n.z[i] * inverse : ng->z[i];
        /* A back face is the same surface seen from inside, where dents are bumps: the shading frame is flipped after normal mapping. */
        side[i] = dot(&n, ng, i) < 0.0f ? -1.0f : 1.0f;
    }
    map_normals(h, &n);
    for (int i = 0; i < LANES; i++) {
        ns->x[i] = side[i] * n.x[i];
        ns->y[i] = side[i] * n.y[i];
        ns->z[i] = side[i] * n.z[i];
    }
    bend(ns, ng);
    bend(ns, &h->view);
}

/* --- Materials ---------------------------------------------------------------------------------------------------------------- */

static void fill(float *restrict out, float value)
{
    for (int i = 0; i < LANES; i++)
        out[i] = value;
}

static void multiply(float *restrict out, const float *restrict by)
{
    for (int i = 0; i < LANES; i++)
        out[i] *= by[i];
}

static void clamp(float *restrict out, float low, float high)
{
    for (int i = 0; i < LANES; i++)
        out[i] = out[i] < low ? low : out[i] > high ? high : out[i];
}

static bool same_look_up(const struct pell_texture_map *a, const struct pell_texture_map *b)
{
    return a->texture == b->texture && a->uv == b->uv && memcmp(a->matrix, b->matrix, sizeof(a->matrix)) == 0;
}

/* Multiplies by one channel of a map. */
static void multiply_channel(struct hits *h, enum pell_map map, float *restrict out)
{
    const int channel = pell_material_map(h->material, map)->channel & 3;
    float16 rgba[4];

    if (look_up(h, map, 1u << channel, rgba))
        multiply(out, rgba[channel]);
}

/* Multiplies by the colour of a map. */
static void multiply_color(struct hits *h, enum pell_map map, float16 *restrict out)
{
    float16 rgba[4];

    if (look_up(h, map, 7, rgba))
        for (int c = 0; c < 3; c++)
            multiply(out[c], rgba[c]);
}

/* Reflected and transmitted fractions of diffuse light at a thin sheet; other surfaces reflect all of it. */
static void shade_sheet(struct hits *h, struct shaded *restrict s)
{
    const struct pell_material *m = h->material;
    float16 through;

    fill(through, pell_material_is_thin(m) ? m->diffuse_transmission : 0.0f);
    for (int c = 0; c < 3; c++)
        fill(s->transmission[c], m->diffuse_transmission_color[c]);
    if (pell_material_is_thin(m)) {
        multiply_channel(h, PELL_MAP_TRANSMISSION, through);
        multiply_color(h, PELL_MAP_TRANSMISSION_COLOR, s->transmission);
    }
    clamp(through, 0.0f, 1.0f);
    for (int i = 0; i < LANES; i++)
        s->reflection[i] = 1.0f - through[i];
    for (int i = 0; i < LANES; i++)
        through[i] *= 1.0f - s->metallic[i];
    for (int c = 0; c < 3; c++)
        multiply(s->transmission[c], through);
}

static void shade_material(struct hits *h, const struct pell_surface *out, struct shaded *restrict s)
{
    const struct pell_material *m = h->material;
    float16 rgba[4];

    for (int c = 0; c < 3; c++) {
        fill(s->base[c], m->base_color[c]);
        fill(s->specular[c], m->rho_s * m->specular_color[c]);
    }
    fill(s->roughness, m->roughness);
    fill(s->metallic, m->metallic);
    fill(s->strength, m->strength);

    multiply_color(h, PELL_MAP_BASE, s->base);
    if (h->mesh->color) {
        struct vec16 color;
        interpolate3(h, h->mesh->color, 4, &color);
        multiply(s->base[0], color.x);
        multiply(s->base[1], color.y);
        multiply(s->base[2], color.z);
    }
    /* glTF packs both into one image: one lookup suffices */
    if (m->metallic > 0.0f && same_look_up(&m->roughness_map, &m->metallic_map)) {
        const int r = m->roughness_map.channel & 3, k = m->metallic_map.channel & 3;
        if (look_up(h, PELL_MAP_ROUGHNESS, 1u << r | 1u << k, rgba)) {
            multiply(s->roughness, rgba[r]);
            multiply(s->metallic, rgba[k]);
        }
    } else {
        multiply_channel(h, PELL_MAP_ROUGHNESS, s->roughness);
        if (m->metallic > 0.0f)
            multiply_channel(h, PELL_MAP_METALLIC, s->metallic);
    }
    if (h->bumpy)
        widen_lobes(h, s->roughness);
    clamp(s->roughness, PELL_ROUGHNESS_MIN, 1.0f);
    clamp(s->metallic, 0.0f, 1.0f);
    if (m->rho_s_map.texture) {
        float16 rho;
        fill(rho, 1.0f);
        multiply_channel(h, PELL_MAP_RHO_S, rho);
        for (int c = 0; c < 3; c++)
            multiply(s->specular[c], rho);
    }
    multiply_color(h, PELL_MAP_SPECULAR, s->specular);
    multiply_channel(h, PELL_MAP_STRENGTH, s->strength);
    clamp(s->strength, 0.0f, 1.0f);
    if (out->any_thin)
        shade_sheet(h, s);
    if (out->any_emissive) {
        for (int c = 0; c < 3; c++)
            fill(s->emissive[c], m->emissive[c]);
        if (m->emissive[0] > 0.0f || m->emissive[1] > 0.0f || m->emissive[2] > 0.0f)
            multiply_color(h, PELL_MAP_EMISSIVE, s->emissive);
    }
}

#endif
