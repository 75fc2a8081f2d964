/* SPDX-License-Identifier: MIT
 * kernel.c - 16 rays from the camera, and what their hits look like; compiled once per SIMD level.
 *
 * Vertex data is fetched lane by lane; all else is loops over 16 lanes that the compiler turns into vectors. Lanes of a packet that
 * hit one mesh are worked on together, nearly always all of them; the other lanes run along on data of the first and are not stored.
 *
 * Footprint. A pixel covers A = k^2 / |n . D| of the surface, n unit, D the ray's direction with forward component 1, k the size of a
 * pixel at that depth: depth / focal (perspective) or 1 / focal (orthographic). With Embree's Ng, twice the triangle's area long, a
 * texture of w x h texels has 2 |uv area| w h k^2 / |Ng . D| texels in the pixel; half the binary logarithm is the level of the
 * pyramid (Williams 1983). */
#include "render/surface/kernel.h"
#include "image/color.h"
#include "math/scalar.h"
#include "render/surface/sample16.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <string.h>

/* What a pixel's cosines to the geometric normal and to the viewer are kept above. */
#define BEND 0.01f
/* Surfaces seen at a more grazing cosine than this are not blurred further: a square filter would lose the other direction. */
#define GRAZING 0.0625f

struct vec16 {
    float16 x, y, z;
};

/* What is known of 16 hits. */
struct hits {
    const struct pell_mesh *mesh;
    const struct pell_material *material;
    const struct pyramid *const *pyramids; /* by map; NULL: no mips were made */
    const struct surface_decode *decode;
    uint32_t lanes; /* bit i: lane i is one of these */
    int16lanes on;  /* the same, -1 or 0 */
    uint32_t vertex[3][LANES];
    const struct pell_corners *corners; /* of the triangles, where they are known */
    float16 w0, w1, w2;                 /* barycentric weights */
    const struct pell_ray_hit16 *packet;
    const struct pell_view *camera;
    float16 footprint; /* k^2 / |Ng . D| */
    bool has_footprint;
    struct vec16 view; /* unit, to the viewer */
    struct uv16 uv[PELL_UV_SETS];
    bool has_uv[PELL_UV_SETS];
};

struct shaded {
    struct vec16 ng, ns;
    float16 base[3], specular[3], emissive[3], roughness, metallic, strength, terminator_offset;
};

static inline float dot(const struct vec16 *a, const struct vec16 *b, int i)
{
    return a->x[i] * b->x[i] + a->y[i] * b->y[i] + a->z[i] * b->z[i];
}

/* --- Vertex data -------------------------------------------------------------------------------------------------------------- */

/* Component `c` of `size`-float vertices, interpolated. */
static void interpolate(const struct hits *h, const float *data, size_t size, size_t c, float *restrict out)
{
    float16 a[3];

    for (int k = 0; k < 3; k++)
        for (int i = 0; i < LANES; i++)
            a[k][i] = data[size * h->vertex[k][i] + c];
    for (int i = 0; i < LANES; i++)
        out[i] = h->w0[i] * a[0][i] + h->w1[i] * a[1][i] + h->w2[i] * a[2][i];
}

/* The first three components of the vertices' data, at the three corners. */
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

/* Texture coordinates of a set, and how much of the picture's unit square a pixel covers. */
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

/* Samples a map's `channels` (bits) into rgba; false where the material or the mesh has not what it takes. */
static bool look_up(struct hits *h, enum surface_map which, unsigned channels, float16 *restrict rgba)
{
    const struct pell_texture_map *map = surface_map(h->material, which);
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

/* Unit geometric normals on the viewer's side; where a triangle has no area, the direction to the viewer. */
static void geometric_normals(const struct pell_hit16 *hit, struct hits *h, struct vec16 *restrict ng)
{
    for (int i = 0; i < LANES; i++) {
        const float hx = hit->ngx[i], hy = hit->ngy[i], hz = hit->ngz[i];
        const float x = h->on[i] ? hx : 0.0f, y = h->on[i] ? hy : 0.0f, z = h->on[i] ? hz : 0.0f;
        const float largest = larger(larger(fabsf(x), fabsf(y)), fabsf(z));
        const bool good = largest > 0.0f;
        /* Areas of very small and very large triangles have squares out of range. */
        const float scale = good ? 1.0f / largest : 0.0f;
        const float gx = good ? x * scale : h->view.x[i], gy = good ? y * scale : h->view.y[i], gz = good ? z * scale : h->view.z[i];
        const float inverse = 1.0f / sqrtf(gx * gx + gy * gy + gz * gz);
        const float side = gx * h->view.x[i] + gy * h->view.y[i] + gz * h->view.z[i] < 0.0f ? -inverse : inverse;
        ng->x[i] = gx * side;
        ng->y[i] = gy * side;
        ng->z[i] = gz * side;
    }
}

/* Normal mapping as glTF 2.0, section 3.9.3, and the tangent frame of section 3.7.2.1: b = w n x t, green is +b. */
static void map_normals(struct hits *h, struct vec16 *restrict n)
{
    float16 rgba[4], handed;
    struct vec16 t;
    const float scale = h->material->normal_scale;

    if (!h->material->normal_map.texture || !h->mesh->tangent || !look_up(h, SURFACE_MAP_NORMAL, 7, rgba))
        return;
    interpolate3(h, h->mesh->tangent, 4, &t);
    interpolate(h, h->mesh->tangent, 4, 3, handed);
    for (int i = 0; i < LANES; i++) {
        const float tt = dot(&t, &t, i), it = tt > 0.0f ? 1.0f / sqrtf(tt) : 0.0f, s = handed[i] < 0.0f ? -1.0f : 1.0f;
        const float tx = t.x[i] * it, ty = t.y[i] * it, tz = t.z[i] * it, nx = n->x[i], ny = n->y[i], nz = n->z[i];
        const float bx = s * (ny * tz - nz * ty), by = s * (nz * tx - nx * tz), bz = s * (nx * ty - ny * tx);
        const float a = scale * (2.0f * rgba[0][i] - 1.0f), b = scale * (2.0f * rgba[1][i] - 1.0f), c = 2.0f * rgba[2][i] - 1.0f;
        const float x = a * tx + b * bx + c * nx, y = a * ty + b * by + c * ny, z = a * tz + b * bz + c * nz;
        const float length = x * x + y * y + z * z;
        const bool good = tt > 0.0f && length > 1e-8f;
        const float inverse = 1.0f / sqrtf(good ? length : 1.0f);
        n->x[i] = good ? x * inverse : nx;
        n->y[i] = good ? y * inverse : ny;
        n->z[i] = good ? z * inverse : nz;
    }
}

/* Moves n to the nearest normal in the half-space n . to >= BEND, if it is not there: the projection onto that half-space. Interpolated
 * and mapped normals may point away from the viewer where the triangle does not; shaded as they are, silhouettes would be black. */
static void bend(struct vec16 *restrict n, const struct vec16 *restrict to)
{
    float16 missing;
    int any = 0;

    for (int i = 0; i < LANES; i++) {
        const float m = BEND - dot(n, to, i);
        missing[i] = m > 0.0f ? m : 0.0f;
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

/* How far, along n, the hit lies under the smooth surface that the normals v of its triangle suggest: the mean of its projections onto the
 * three tangent planes, those below it left out (Hanika 2021, "Hacking the Shadow Terminator"). Shadow rays that start up there do not
 * show the triangles of a coarse mesh as dark facets where light grazes. */
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
            const float side = dot(&v[k], n, i) < 0.0f ? -1.0f : 1.0f; /* seen from within, the normals are turned */
            const float under =
                side * ((p[k].x[i] - at.x[i]) * v[k].x[i] + (p[k].y[i] - at.y[i]) * v[k].y[i] + (p[k].z[i] - at.z[i]) * v[k].z[i]);
            const float share = under > 0.0f ? side * w[i] * under : 0.0f;
            sum.x[i] += share * v[k].x[i];
            sum.y[i] += share * v[k].y[i];
            sum.z[i] += share * v[k].z[i];
        }
    }
    for (int i = 0; i < LANES; i++) {
        const float l = dot(&sum, n, i);
        out[i] = h->on[i] && l > 0.0f ? l : 0.0f;
    }
}

static void shading_normals(struct hits *h, const struct vec16 v[restrict 3], const struct vec16 *restrict ng, struct vec16 *restrict ns)
{
    struct vec16 n;
    float16 side;

    blend(h, v, &n);
    for (int i = 0; i < LANES; i++) {
        const float length = dot(&n, &n, i);
        const bool good = length > 1e-8f;
        const float inverse = 1.0f / sqrtf(good ? length : 1.0f);
        n.x[i] = good ? n.x[i] * inverse : ng->x[i];
        n.y[i] = good ? n.y[i] * inverse : ng->y[i];
        n.z[i] = good ? n.z[i] * inverse : ng->z[i];
        /* A back face is the same surface seen from within: dents are bumps there, so the frame is turned as a whole, after mapping. */
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

static void factor(float *restrict out, float value)
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
static void number(struct hits *h, enum surface_map map, float *restrict out)
{
    const int channel = surface_map(h->material, map)->channel & 3;
    float16 rgba[4];

    if (look_up(h, map, 1u << channel, rgba))
        multiply(out, rgba[channel]);
}

static void colour(struct hits *h, enum surface_map map, float16 *restrict out)
{
    float16 rgba[4];

    if (look_up(h, map, 7, rgba))
        for (int c = 0; c < 3; c++)
            multiply(out[c], rgba[c]);
}

static void shade_material(struct hits *h, bool emissive, struct shaded *restrict s)
{
    const struct pell_material *m = h->material;
    float16 rgba[4];

    for (int c = 0; c < 3; c++) {
        factor(s->base[c], m->base_color[c]);
        factor(s->specular[c], m->rho_s * m->specular_color[c]);
    }
    factor(s->roughness, m->roughness);
    factor(s->metallic, m->metallic);
    factor(s->strength, m->strength);

    colour(h, SURFACE_MAP_BASE, s->base);
    if (h->mesh->color) {
        struct vec16 color;
        interpolate3(h, h->mesh->color, 4, &color);
        multiply(s->base[0], color.x);
        multiply(s->base[1], color.y);
        multiply(s->base[2], color.z);
    }
    /* glTF packs both into one picture: one look-up. */
    if (m->metallic > 0.0f && same_look_up(&m->roughness_map, &m->metallic_map)) {
        const int r = m->roughness_map.channel & 3, k = m->metallic_map.channel & 3;
        if (look_up(h, SURFACE_MAP_ROUGHNESS, 1u << r | 1u << k, rgba)) {
            multiply(s->roughness, rgba[r]);
            multiply(s->metallic, rgba[k]);
        }
    } else {
        number(h, SURFACE_MAP_ROUGHNESS, s->roughness);
        if (m->metallic > 0.0f)
            number(h, SURFACE_MAP_METALLIC, s->metallic);
    }
    clamp(s->roughness, 0.03f, 1.0f);
    clamp(s->metallic, 0.0f, 1.0f);
    if (m->rho_s_map.texture) {
        float16 rho;
        factor(rho, 1.0f);
        number(h, SURFACE_MAP_RHO_S, rho);
        for (int c = 0; c < 3; c++)
            multiply(s->specular[c], rho);
    }
    colour(h, SURFACE_MAP_SPECULAR, s->specular);
    number(h, SURFACE_MAP_STRENGTH, s->strength);
    clamp(s->strength, 0.0f, 1.0f);
    if (emissive) {
        for (int c = 0; c < 3; c++)
            factor(s->emissive[c], m->emissive[c]);
        if (m->emissive[0] > 0.0f || m->emissive[1] > 0.0f || m->emissive[2] > 0.0f)
            colour(h, SURFACE_MAP_EMISSIVE, s->emissive);
    }
}

/* --- A packet ----------------------------------------------------------------------------------------------------------------- */

/* What follows from the rays and where they ended. */
static void prepare(const struct pell_ray_hit16 *restrict p, struct hits *restrict h)
{
    for (int i = 0; i < LANES; i++)
        h->on[i] = -(int32_t) (h->lanes >> i & 1);
    for (int i = 0; i < LANES; i++) {
        const float u = h->on[i] ? p->hit.u[i] : 0.0f, v = h->on[i] ? p->hit.v[i] : 0.0f;
        h->w0[i] = 1.0f - u - v;
        h->w1[i] = u;
        h->w2[i] = v;
    }
    for (int i = 0; i < LANES; i++) {
        const float dx = p->ray.dx[i], dy = p->ray.dy[i], dz = p->ray.dz[i];
        const float inverse = -1.0f / sqrtf(dx * dx + dy * dy + dz * dz);
        h->view.x[i] = dx * inverse;
        h->view.y[i] = dy * inverse;
        h->view.z[i] = dz * inverse;
    }
}

/* The lanes in `lanes`, which hit one mesh; `known`: corners of all lanes, on this mesh, or NULL. */
static void shade(const struct surface_job *job, const struct pell_ray_hit16 *p, const struct pell_corners *known, uint32_t lanes,
                  struct shaded *restrict s)
{
    const int first = __builtin_ctz(lanes);
    const struct pell_mesh *mesh = &job->scene->meshes[p->hit.mesh[first]];
    const struct pell_mips *mips = job->out->mips;
    struct vec16 normals[3]; /* at the corners */
    struct hits h;

    h.mesh = mesh;
    h.material = &job->scene->materials[mesh->material];
    h.pyramids = mips ? mips->slots + (size_t) mesh->material * SURFACE_MAPS : NULL;
    h.decode = job->decode;
    h.lanes = lanes;
    h.packet = p;
    h.camera = job->view;
    h.has_footprint = false;
    memset(h.has_uv, 0, sizeof(h.has_uv));
    prepare(p, &h);
    h.corners = known;
    if (known)
        memcpy(h.vertex, known->vertex, sizeof(h.vertex));
    for (int i = 0; !known && i < LANES; i++) {
        const uint32_t *index = mesh->index + 3 * (size_t) p->hit.triangle[(lanes >> i & 1) ? i : first];
        for (int k = 0; k < 3; k++)
            h.vertex[k][i] = index[k];
    }
    geometric_normals(&p->hit, &h, &s->ng);
    corners(&h, mesh->normal, 3, normals);
    shading_normals(&h, normals, &s->ng, &s->ns);
    terminator_offsets(&h, normals, &s->ng, s->terminator_offset);
    shade_material(&h, job->out->any_emissive, s);
}

#define ROW (SURFACE_PACKET_SIDE * sizeof(float))

/* Copies the lanes of `from` into `to`. */
static void merge(struct shaded *restrict to, const struct shaded *restrict from, uint32_t lanes)
{
    float *restrict a = (float *) to;
    const float *restrict b = (const float *) from;

    for (size_t k = 0; k < sizeof(*to) / sizeof(float16); k++)
        for (int i = 0; i < LANES; i++)
            a[LANES * k + (size_t) i] = (lanes >> i & 1) ? b[LANES * k + (size_t) i] : a[LANES * k + (size_t) i];
}

static void store(const struct pell_surface *out, int x, int y, int rows, const struct pell_ray_hit16 *p, const struct shaded *s,
                  const uint16_t *material, bool plain)
{
    for (int j = 0; j < rows; j++) {
        const ptrdiff_t at = (ptrdiff_t) (y + j) * out->stride + x;
        const int k = SURFACE_PACKET_SIDE * j;

        memcpy(out->material + at, material + k, SURFACE_PACKET_SIDE * sizeof(*material));
        memcpy(out->depth + at, p->ray.tfar + k, ROW);
        memcpy(out->ng[0] + at, s->ng.x + k, ROW);
        memcpy(out->ng[1] + at, s->ng.y + k, ROW);
        memcpy(out->ng[2] + at, s->ng.z + k, ROW);
        memcpy(out->ns[0] + at, s->ns.x + k, ROW);
        memcpy(out->ns[1] + at, s->ns.y + k, ROW);
        memcpy(out->ns[2] + at, s->ns.z + k, ROW);
        if (!plain) {
            for (int c = 0; c < 3; c++) {
                memcpy(out->base[c] + at, s->base[c] + k, ROW);
                memcpy(out->specular[c] + at, s->specular[c] + k, ROW);
            }
            memcpy(out->roughness + at, s->roughness + k, ROW);
            memcpy(out->metallic + at, s->metallic + k, ROW);
        }
        memcpy(out->strength + at, s->strength + k, ROW);
        if (out->mesh)
            memcpy(out->mesh + at, p->hit.mesh + k, ROW);
        if (out->triangle) {
            memcpy(out->triangle + at, p->hit.triangle + k, ROW);
            memcpy(out->barycentric[0] + at, p->hit.u + k, ROW);
            memcpy(out->barycentric[1] + at, p->hit.v + k, ROW);
        }
        memcpy(out->terminator_offset + at, s->terminator_offset + k, ROW);
        if (out->any_emissive)
            for (int c = 0; c < 3; c++)
                memcpy(out->emissive[c] + at, s->emissive[c] + k, ROW);
    }
}

#define LINE 16 /* floats of a cache line */

/* Asks for the cache lines of a row that `store` writes. There are more than processors foresee by themselves. */
PELL_FETCHING_INLINE void fetch(const struct pell_surface *out, int x, int y)
{
    const ptrdiff_t at = (ptrdiff_t) y * out->stride + x;

    if (x >= out->stride || y >= out->height)
        return;
    pell_fetch_to_write(out->material + at);
    pell_fetch_to_write(out->depth + at);
    pell_fetch_to_write(out->strength + at);
    pell_fetch_to_write(out->terminator_offset + at);
    for (int c = 0; c < 3; c++) {
        pell_fetch_to_write(out->ng[c] + at);
        pell_fetch_to_write(out->ns[c] + at);
    }
}

/* Widens a rectangle by the pixels of a packet. */
static void cover(struct pell_rect *r, int x, int y, uint32_t lanes)
{
    const uint32_t columns = (lanes | lanes >> 4 | lanes >> 8 | lanes >> 12) & 15;
    const int x0 = x + __builtin_ctz(columns), x1 = x + 32 - __builtin_clz(columns);
    const int y0 = y + __builtin_ctz(lanes) / SURFACE_PACKET_SIDE, y1 = y + (31 - __builtin_clz(lanes)) / SURFACE_PACKET_SIDE + 1;

    r->x0 = x0 < r->x0 ? x0 : r->x0;
    r->y0 = y0 < r->y0 ? y0 : r->y0;
    r->x1 = x1 > r->x1 ? x1 : r->x1;
    r->y1 = y1 > r->y1 ? y1 : r->y1;
}

static void see(const struct surface_job *job, int x, int y, int rows, const struct pell_ray_hit16 *p, const struct pell_corners *known,
                uint32_t hits, struct surface_band *band)
{
    uint16_t material[LANES] = { 0 };
    uint32_t translucent = 0;
    bool plain = job->out->omit_uniform;
    struct shaded s;

    for (uint32_t left = hits; left;) {
        const uint32_t mesh = p->hit.mesh[__builtin_ctz(left)];
        const int number = job->scene->meshes[mesh].material;
        const bool opaque = job->scene->materials[number].opaque;
        uint32_t lanes = 0;

        plain = plain && pell_surface_is_plain(&job->scene->materials[number]);
        for (int i = 0; i < LANES; i++)
            lanes |= (uint32_t) (p->hit.mesh[i] == mesh) << i;
        lanes &= left;
        for (int i = 0; i < LANES; i++)
            material[i] = (lanes >> i & 1) ? (uint16_t) (number + 1) : material[i];
        if (lanes == hits) {
            shade(job, p, known, lanes, &s);
        } else {
            struct shaded some;
            if (left == hits)
                memset(&s, 0, sizeof(s));
            if (!job->out->any_emissive)
                memset(some.emissive, 0, sizeof(some.emissive));
            shade(job, p, NULL, lanes, &some);
            merge(&s, &some, lanes);
        }
        translucent |= opaque ? 0 : lanes;
        left &= ~lanes;
    }
    store(job->out, x, y, rows, p, &s, material, plain);
    cover(&band->covered, x, y, hits);
    band->covered_pixels += __builtin_popcount(hits);
    if (translucent) {
        cover(&band->translucent, x, y, translucent);
        band->translucent_pixels += __builtin_popcount(translucent);
    }
}

/* Rays through a packet's pixels. */
static void aim(const struct pell_view *view, int x, int y, struct pell_ray16 *restrict ray)
{
    const struct pell_view v = *view;

    for (int i = 0; i < LANES; i++) {
        struct pell_vec3 start, direction;
        pell_view_ray(&v, (float) (x + i % SURFACE_PACKET_SIDE), (float) (y + i / SURFACE_PACKET_SIDE), &start, &direction);
        ray->ox[i] = start.x;
        ray->oy[i] = start.y;
        ray->oz[i] = start.z;
        ray->dx[i] = direction.x;
        ray->dy[i] = direction.y;
        ray->dz[i] = direction.z;
    }
}

/* -1 where a lane's pixel is of the picture, else 0. */
static inline int within(const struct pell_view *view, int x, int y, int i)
{
    return x + i % SURFACE_PACKET_SIDE < view->width && y + i / SURFACE_PACKET_SIDE < view->height ? -1 : 0;
}

/* How many pixels from a to b there are in packets that touch `from` to `to`. */
static int of_packets(int a, int b, int from, int to)
{
    const int low = from & ~(SURFACE_PACKET_SIDE - 1), high = (to + SURFACE_PACKET_SIDE - 1) & ~(SURFACE_PACKET_SIDE - 1);
    const int c = a > low ? a : low, d = b < high ? b : high;

    return d > c ? d - c : 0;
}

static PELL_FETCHING void trace_tile(const struct surface_job *job, int number)
{
    const struct pell_surface *out = job->out;
    const struct pell_raster *raster = out->raster;
    const int x0 = number % pell_raster_columns(raster) * PELL_RASTER_TILE, y0 = number / pell_raster_columns(raster) * PELL_RASTER_TILE;
    const int x1 = x0 + PELL_RASTER_TILE < out->width ? x0 + PELL_RASTER_TILE : out->width;
    const int y1 = y0 + PELL_RASTER_TILE < out->height ? y0 + PELL_RASTER_TILE : out->height;
    const ptrdiff_t end = x0 + PELL_RASTER_TILE < out->stride ? x0 + PELL_RASTER_TILE : out->stride;
    const struct pell_rect r = job->rect;
    struct surface_band band = { .covered = { INT_MAX, INT_MAX, 0, 0 }, .translucent = { INT_MAX, INT_MAX, 0, 0 } };
    struct pell_raster_tile tile;
    struct pell_corners corners;
    struct pell_ray_hit16 p;
    bool any;

    any = pell_raster_tile(raster, number, &tile);
    if (r.x0 < r.x1)
        band.rays = (int64_t) of_packets(x0, x1, r.x0, r.x1) * of_packets(y0, y1, r.y0, r.y1);
    for (int y = y0; y < y1; y++)
        memset(out->material + y * out->stride + x0, 0, (size_t) (end - x0) * sizeof(*out->material));
    for (int k = 0; any && k < PELL_RASTER_BLOCKS * PELL_RASTER_BLOCKS; k++) {
        const int x = x0 + k % PELL_RASTER_BLOCKS * SURFACE_PACKET_SIDE, y = y0 + k / PELL_RASTER_BLOCKS * SURFACE_PACKET_SIDE;
        int32_t *triangle = tile.triangle + LANES * k;
        uint32_t hits = 0;

        for (int i = 0; i < LANES; i++) {
            triangle[i] |= ~within(job->view, x, y, i);
            hits |= (uint32_t) (triangle[i] >= 0) << i;
        }
        /* a line of one row of the next blocks: by then all had their turn */
        fetch(out, x0 + k % 2 * LINE, y0 + k / PELL_RASTER_BLOCKS * SURFACE_PACKET_SIDE + SURFACE_PACKET_SIDE + k % PELL_RASTER_BLOCKS / 2);
        if (!hits)
            continue;
        aim(job->view, x, y, &p.ray);
        pell_raster_intersect16(raster, triangle, &p, &corners);
        see(job, x, y, y1 - y < SURFACE_PACKET_SIDE ? y1 - y : SURFACE_PACKET_SIDE, &p, &corners, hits, &band);
    }
    job->bands[number] = band;
}

static PELL_FETCHING void trace_band(const struct surface_job *job, int number)
{
    const struct pell_view *view = job->view;
    const struct pell_surface *out = job->out;
    const int y0 = number * SURFACE_BAND_ROWS, y1 = y0 + SURFACE_BAND_ROWS < view->height ? y0 + SURFACE_BAND_ROWS : view->height;
    struct surface_band band = { .covered = { INT_MAX, INT_MAX, 0, 0 }, .translucent = { INT_MAX, INT_MAX, 0, 0 } };
    struct pell_ray_hit16 p;

    memset(&p, 0, sizeof(p));
    for (int i = 0; i < LANES; i++) {
        p.ray.tnear[i] = 1e-6f; /* depth is positive */
        p.ray.mask[i] = PELL_RAY_CAMERA;
    }
    if (!job->bare)
        memset(out->material + (ptrdiff_t) y0 * out->stride, 0, (size_t) (y1 - y0) * (size_t) out->stride * sizeof(*out->material));
    for (int x = job->rect.x0 & ~(SURFACE_PACKET_SIDE - 1); x < job->rect.x1; x += SURFACE_PACKET_SIDE)
        for (int y = y0; y < y1; y += SURFACE_PACKET_SIDE) {
            const int rows = y1 - y < SURFACE_PACKET_SIDE ? y1 - y : SURFACE_PACKET_SIDE;
            _Alignas(64) int valid[LANES];
            uint32_t hits = 0;
            int rays = 0;

            if (y + rows <= job->rect.y0 || y >= job->rect.y1)
                continue;
            aim(view, x, y, &p.ray);
            for (int i = 0; i < LANES; i++) {
                p.ray.tfar[i] = INFINITY;
                valid[i] = within(view, x, y, i);
                rays -= valid[i];
            }
            pell_rays_closest16(job->rays, valid, true, &p);
            band.rays += rays;
            for (int i = 0; i < LANES; i++)
                hits |= (uint32_t) (p.hit.mesh[i] != PELL_NO_HIT) << i;
            if (!hits || job->bare)
                continue;
            /* the next line of one row: by then all rows of the band had their turn */
            fetch(out, x / LINE * LINE + LINE, y0 + x % LINE / SURFACE_PACKET_SIDE + (y - y0));
            see(job, x, y, rows, &p, NULL, hits, &band);
        }
    job->bands[number] = band;
}

static void look(const struct surface_job *job, const struct pell_ray_hit16 *packet, uint32_t hits)
{
    struct surface_band band = { .covered = { INT_MAX, INT_MAX, 0, 0 }, .translucent = { INT_MAX, INT_MAX, 0, 0 } };

    see(job, 0, 0, SURFACE_PACKET_SIDE, packet, NULL, hits, &band);
}

extern const struct pell_surface_kernels PELL_SIMD(pell_surface_kernels);
const struct pell_surface_kernels PELL_SIMD(pell_surface_kernels) = { trace_band, trace_tile, look };
