/* SPDX-License-Identifier: MIT
 *
 * kernel.c - 16 rays from the camera, and the surface at their hits (hits16.h); compiled once per SIMD level. Lanes of a packet that hit
 * one mesh are processed together, nearly always all of them; the other lanes compute with data of the first and are not stored.
 */
#include "render/surface/hits16.h"

#include <limits.h>
#include <string.h>

/* --- A packet ----------------------------------------------------------------------------------------------------------------- */

/* Computes masks, barycentric weights and view directions of the lanes. */
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

/* Computes the surface in the lanes of `lanes`, which hit one mesh; `known`: corners of all lanes, on this mesh, or NULL. */
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
    h.pyramids = mips ? mips->slots + (size_t) mesh->material * PELL_MAPS : NULL;
    h.decode = job->decode;
    h.lanes = lanes;
    h.packet = p;
    h.camera = job->view;
    h.has_footprint = h.bumpy = false;
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
    if (job->out->spread > 0.0f)
        measure_slope_variance(&h, normals, job->out->spread, s->slope_variance);
    shade_material(&h, job->out, s);
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
        if (out->spread > 0.0f)
            memcpy(out->slope_variance + at, s->slope_variance + k, ROW);
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
        if (out->any_thin) {
            for (int c = 0; c < 3; c++)
                memcpy(out->transmission[c] + at, s->transmission[c] + k, ROW);
            memcpy(out->reflection + at, s->reflection + k, ROW);
        }
    }
}

#define LINE 16 /* floats of a cache line */

/* Prefetches the cache lines of a row that `store` writes. There are more streams than hardware prefetchers follow. */
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

/* Computes and stores the surface at the hits of a packet. */
static void shade_packet(const struct surface_job *job, int x, int y, int rows, const struct pell_ray_hit16 *p,
                         const struct pell_corners *known, uint32_t hits, struct surface_band *band)
{
    uint16_t material[LANES] = { 0 };
    uint32_t translucent = 0;
    bool plain = job->out->omit_uniform;
    struct shaded s;

    for (uint32_t left = hits; left;) {
        const uint32_t mesh = p->hit.mesh[__builtin_ctz(left)];
        const int index = job->scene->meshes[mesh].material;
        const bool opaque = job->scene->materials[index].opaque;
        uint32_t lanes = 0;

        plain = plain && pell_surface_is_plain(&job->scene->materials[index]);
        for (int i = 0; i < LANES; i++)
            lanes |= (uint32_t) (p->hit.mesh[i] == mesh) << i;
        lanes &= left;
        for (int i = 0; i < LANES; i++)
            material[i] = (lanes >> i & 1) ? (uint16_t) (index + 1) : material[i];
        if (lanes == hits) {
            shade(job, p, known, lanes, &s);
        } else {
            struct shaded part;
            if (left == hits)
                memset(&s, 0, sizeof(s));
            if (!job->out->any_emissive)
                memset(part.emissive, 0, sizeof(part.emissive));
            if (!job->out->any_thin) {
                memset(part.transmission, 0, sizeof(part.transmission));
                memset(part.reflection, 0, sizeof(part.reflection));
            }
            shade(job, p, NULL, lanes, &part);
            merge(&s, &part, lanes);
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

/* Sets origins and directions of the rays through a packet's pixels. */
static void set_rays(const struct pell_view *view, int x, int y, struct pell_ray16 *restrict ray)
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

/* -1 where a lane's pixel is inside the image, else 0. */
static inline int within(const struct pell_view *view, int x, int y, int i)
{
    return x + i % SURFACE_PACKET_SIDE < view->width && y + i / SURFACE_PACKET_SIDE < view->height ? -1 : 0;
}

/* Number of pixels from a to b in packets that overlap `from` to `to`. */
static int pixels_in_packets(int a, int b, int from, int to)
{
    const int low = from & ~(SURFACE_PACKET_SIDE - 1), high = (to + SURFACE_PACKET_SIDE - 1) & ~(SURFACE_PACKET_SIDE - 1);
    const int c = a > low ? a : low, d = b < high ? b : high;

    return d > c ? d - c : 0;
}

static PELL_FETCHING void trace_tile(const struct surface_job *job, int index)
{
    const struct pell_surface *out = job->out;
    const struct pell_raster *raster = out->raster;
    const int x0 = index % pell_raster_columns(raster) * PELL_RASTER_TILE, y0 = index / pell_raster_columns(raster) * PELL_RASTER_TILE;
    const int x1 = x0 + PELL_RASTER_TILE < out->width ? x0 + PELL_RASTER_TILE : out->width;
    const int y1 = y0 + PELL_RASTER_TILE < out->height ? y0 + PELL_RASTER_TILE : out->height;
    const ptrdiff_t end = x0 + PELL_RASTER_TILE < out->stride ? x0 + PELL_RASTER_TILE : out->stride;
    const struct pell_rect r = job->rect;
    struct surface_band band = { .covered = { INT_MAX, INT_MAX, 0, 0 }, .translucent = { INT_MAX, INT_MAX, 0, 0 } };
    struct pell_raster_tile tile;
    struct pell_corners corners;
    struct pell_ray_hit16 p;
    bool any;

    any = pell_raster_tile(raster, index, &tile);
    if (r.x0 < r.x1)
        band.rays = (int64_t) pixels_in_packets(x0, x1, r.x0, r.x1) * pixels_in_packets(y0, y1, r.y0, r.y1);
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
        /* a line of one row of the next blocks; all lines have been prefetched when they are reached */
        fetch(out, x0 + k % 2 * LINE, y0 + k / PELL_RASTER_BLOCKS * SURFACE_PACKET_SIDE + SURFACE_PACKET_SIDE + k % PELL_RASTER_BLOCKS / 2);
        if (!hits)
            continue;
        set_rays(job->view, x, y, &p.ray);
        pell_raster_intersect16(raster, triangle, &p, &corners);
        shade_packet(job, x, y, y1 - y < SURFACE_PACKET_SIDE ? y1 - y : SURFACE_PACKET_SIDE, &p, &corners, hits, &band);
    }
    job->bands[index] = band;
}

static PELL_FETCHING void trace_band(const struct surface_job *job, int index)
{
    const struct pell_view *view = job->view;
    const struct pell_surface *out = job->out;
    const int y0 = index * SURFACE_BAND_ROWS, y1 = y0 + SURFACE_BAND_ROWS < view->height ? y0 + SURFACE_BAND_ROWS : view->height;
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
            set_rays(view, x, y, &p.ray);
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
            /* the next line of one row; all rows of the band have been prefetched when x reaches it */
            fetch(out, x / LINE * LINE + LINE, y0 + x % LINE / SURFACE_PACKET_SIDE + (y - y0));
            shade_packet(job, x, y, rows, &p, NULL, hits, &band);
        }
    job->bands[index] = band;
}

static void look(const struct surface_job *job, const struct pell_ray_hit16 *packet, uint32_t hits)
{
    struct surface_band band = { .covered = { INT_MAX, INT_MAX, 0, 0 }, .translucent = { INT_MAX, INT_MAX, 0, 0 } };

    shade_packet(job, 0, 0, SURFACE_PACKET_SIDE, packet, NULL, hits, &band);
}

extern const struct pell_surface_kernels PELL_SIMD(pell_surface_kernels);
const struct pell_surface_kernels PELL_SIMD(pell_surface_kernels) = { trace_band, trace_tile, look };
