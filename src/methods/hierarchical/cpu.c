/* SPDX-License-Identifier: MIT
 *
 * cpu.c - surface samples of each solid, their irradiance, and the traversal of their octree for each pixel.
 *
 * N = area / A samples, a Poisson disc set, represent an area of about A each (samples.c).
 *
 * For a pixel at x, with r_i = |x - x_i| and the window w(r) = (1 - r^2/reach^2)^2:
 *
 *     M = Sum_i (1 - w(r_i)) R(r_i) E_i A + near,     near = W Sum_i w R E_i A / Sum_i w R A,    W = Int 2 pi r w(r) R(r) dr
 *
 * The first sum is smooth on the scale of the sample spacing, so point samples are accurate; distant ones are clustered. `near` is a mean
 * of the irradiance around x, including the pixel's own, times the light that the window returns under uniform irradiance, so variations of
 * the sample density cancel. On a smooth surface W is correct to second order, on a sphere exactly: the area within a chord r is pi r^2.
 * Where the samples in the window do not resemble a smooth surface (creases, borders, sheets thinner than the window) the plain sum is
 * used, with a smooth transition between both.
 */
#include "methods/hierarchical/hierarchical.h"

#include "math/scalar.h"
#include "math/vec.h"
#include "methods/reference_frame.h"
#include "optics/medium/opposed.h"
#include "optics/profile/white.h"
#include "render/engine.h"
#include "visibility/buried.h"

#include <stdio.h>
#include <string.h>

enum {
    CHUNK = 512, /* points per task of the irradiance */
    MIN_SAMPLES = 16384,
    ROWS = 2,   /* rows of pixels per task */
    BATCH = 32, /* bands between two progress reports */
};
#define RAY_OFFSET 1e-4f      /* of the largest coordinate: offset of ray origins */
#define REACH 2.0f            /* radius of the near window, in sample spacings */
enum { REPRESENTATIVES = 4 }; /* samples that represent a distant node whose normals differ: */
#define MIN_NORMAL2 0.5f      /* squared length of its mean normal below this */

struct solid {
    struct hierarchical_radial radial;
    struct pell_light_tree tree;
    struct pell_opposed opposed;
    bool is_opposed;
    float scale[3];                       /* of transmitted light: 1, or white */
    float mean_area, reach2, window_area; /* mm^2: mean area of a sample; squared radius of the window; Int w dA on a plane */
};

struct hierarchical_state {
    struct reference_frame frame;         /* first member */
    const struct pell_services *services; /* borrowed */
    struct pell_context *ctx;
    struct hierarchical_knobs knobs;
    struct pell_solids *solids;
    struct solid *solid; /* by solid */
};

/* --- Samples -------------------------------------------------------------------------------------------------------------------- */

struct light_task {
    const struct hierarchical_state *st;
    struct hierarchical_sample *points;
    struct pell_surface_sample *samples;
    bool *valid;
    size_t count;
    double mean_area; /* mm^2, of a sample */
};

/* Invalidates samples of surface inside another part of the object. */
static void drop_buried(const struct light_task *t, size_t first, size_t count)
{
    const struct pell_services *services = t->st->services;
    struct pell_buried_query query[PELL_PACKET];
    bool buried[PELL_PACKET];

    for (size_t at = 0; at < count; at += PELL_PACKET) {
        const int n = count - at < PELL_PACKET ? (int) (count - at) : PELL_PACKET;
        for (int i = 0; i < n; i++) {
            const struct pell_surface_sample *s = &t->samples[first + at + (size_t) i];
            const struct pell_vec3 p = vec3_load(s->position);
            query[i] = (struct pell_buried_query) { p, vec3_load(s->normal), RAY_OFFSET * vec3_max_abs(p),
                                                    pell_mesh_assembly(&services->scene->meshes[t->points[first + at + (size_t) i].mesh]) };
        }
        pell_buried16(services->scene, services->rays, query, n, buried);
        for (int i = 0; i < n; i++)
            t->valid[first + at + (size_t) i] &= !buried[i];
    }
}

static void light_chunk(void *arg, int index, int worker)
{
    const struct light_task *t = arg;
    const size_t first = (size_t) index * CHUNK, left = t->count - first, count = left < CHUNK ? left : CHUNK;
    uint32_t mesh[CHUNK], triangle[CHUNK], seed[CHUNK];
    float u[CHUNK], v[CHUNK], position[3][CHUNK], normal[3][CHUNK], irradiance[3][CHUNK], single[3][CHUNK], curvature[CHUNK];
    const struct pell_surface_points in = { mesh, triangle, u, v, seed, NULL };
    const struct pell_surface_light out = {
        .irradiance = { irradiance[0], irradiance[1], irradiance[2] },
        .position = { position[0], position[1], position[2] },
        .normal = { normal[0], normal[1], normal[2] },
        .single_surplus = { single[0], single[1], single[2] },
        .curvature = curvature,
        .valid = t->valid + first,
    };
    const struct pell_points_params params = {
        .mix = -1.0f, .opposed = true, .spacing = (float) sqrt(t->mean_area), .samples = t->st->services->settings->msaa
    };

    (void) worker;
    for (size_t i = 0; i < count; i++) {
        mesh[i] = t->points[first + i].mesh;
        triangle[i] = t->points[first + i].triangle;
        u[i] = t->points[first + i].u;
        v[i] = t->points[first + i].v;
        seed[i] = (uint32_t) (first + i);
    }
    pell_services_light_points(t->st->services, &params, &in, count, &out);
    for (size_t i = 0; i < count; i++) {
        struct pell_surface_sample *s = &t->samples[first + i];
        s->area = t->points[first + i].area;
        s->curvature = curvature[i];
        for (int c = 0; c < 3; c++) {
            s->position[c] = position[c][i];
            s->normal[c] = normal[c][i];
            s->power[c] = irradiance[c][i] * s->area;
            s->deep[c] = fmaxf(irradiance[c][i] - single[c][i], 0.0f) * s->area;
        }
    }
    drop_buried(t, first, count);
}

static enum pell_result sample_solid(struct hierarchical_state *st, const struct pell_solid *solid, size_t count,
                                     struct pell_light_tree *tree)
{
    struct light_task t = { .st = st, .count = count, .mean_area = solid->area / (double) count };
    const int chunks = (int) ((count + CHUNK - 1) / CHUNK);
    size_t kept = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    PELL_TRY(hierarchical_samples_make(st->ctx, st->services->pool, st->services->scene, solid, count, &t.points));
    res = PELL_ERR_NOMEM;
    t.samples = pell_alloc_array(st->ctx, count, sizeof(*t.samples));
    t.valid = pell_alloc_array(st->ctx, count, sizeof(*t.valid));
    if (!t.samples || !t.valid)
        goto fail;
    pell_pool_run(st->services->pool, chunks, light_chunk, &t);
    res = PELL_ERR_CANCELLED;
    if (pell_cancelled(st->ctx))
        goto fail;
    for (size_t i = 0; i < count; i++)
        if (t.valid[i])
            t.samples[kept++] = t.samples[i];
    pell_free(st->ctx, t.valid);
    pell_free(st->ctx, t.points);
    return pell_light_tree_make(st->ctx, t.samples, kept, tree);

fail:
    pell_free(st->ctx, t.samples);
    pell_free(st->ctx, t.valid);
    pell_free(st->ctx, t.points);
    return res;
}

static enum pell_result make_solid(struct hierarchical_state *st, const struct pell_frame_shape *shape, size_t index, size_t count)
{
    const struct pell_solid *from = &st->solids->solids[index];
    const struct pell_scene *scene = st->services->scene;
    struct solid *b = &st->solid[index];
    const struct pell_frame_material *m = &shape->materials[from->material];
    struct pell_profile *profile;
    double diagonal = 0.0, spacing, reach;
    enum pell_result res;

    for (int k = 0; k < 3; k++)
        diagonal += pow((double) scene->bounds_max[k] - (double) scene->bounds_min[k], 2.0);
    spacing = sqrt(from->area / (double) count);
    diagonal = fmax(sqrt(diagonal), spacing);
    reach = (double) REACH * spacing;
    b->mean_area = (float) (spacing * spacing);
    b->reach2 = (float) (reach * reach);
    b->window_area = (float) (PELL_PI * reach * reach / 3.0);
    b->is_opposed = st->services->settings->opposed && pell_solid_has_medium(scene, from, m) && pell_opposed_make(&m->medium, &b->opposed);
    profile = pell_alloc_array(st->ctx, 3, sizeof(*profile));
    if (!profile)
        return PELL_ERR_NOMEM;
    PELL_TRY(hierarchical_radial_fit(st->ctx, m, st->knobs.gaussians, profile));
    PELL_TRY(
        hierarchical_radial_make(st->ctx, profile, m->white, spacing / 8.0, 16.0 * diagonal, reach, spacing / sqrt(PELL_PI), &b->radial));
    for (int c = 0; c < 3; c++)
        b->scale[c] = (float) pell_profile_scale(&m->profile[c], m->white);
    PELL_TRY(sample_solid(st, from, count, &b->tree));

fail:
    pell_free(st->ctx, profile);
    return res;
}

static void hierarchical_destroy(void *state)
{
    struct hierarchical_state *st = state;

    if (!st)
        return;
    for (size_t i = 0; st->solid && i < st->solids->count; i++) {
        hierarchical_radial_finish(&st->solid[i].radial);
        pell_light_tree_finish(&st->solid[i].tree);
    }
    pell_free(st->ctx, st->solid);
    pell_solids_destroy(&st->solids);
    pell_free(st->ctx, st);
}

static enum pell_result hierarchical_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                            void **state)
{
    struct pell_context *ctx = services->ctx;
    struct hierarchical_state *st = pell_zalloc(ctx, sizeof(*st));
    const double start = pell_seconds();
    double wanted = 0.0, fraction;
    size_t samples = 0, bytes = 0;
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->services = services;
    st->ctx = ctx;
    st->knobs = *(const struct hierarchical_knobs *) knobs;
    PELL_TRY(pell_services_solids(services, &st->solids));
    res = PELL_ERR_NOMEM;
    st->solid = pell_calloc(ctx, st->solids->count + 1, sizeof(*st->solid));
    if (!st->solid)
        goto fail;
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < st->solids->count; i++) {
            const struct pell_solid *b = &st->solids->solids[i];
            const double length = hierarchical_radial_length(&shape->materials[b->material]);
            const double n = fmax(b->area * (double) st->knobs.density / (PELL_PI * length * length), MIN_SAMPLES);
            if (b->num_triangles == 0)
                continue;
            if (pass == 0) {
                wanted += n;
                continue;
            }
            fraction = fmin(1.0, (double) st->knobs.points / wanted);
            PELL_TRY(make_solid(st, shape, i, (size_t) fmax(64.0, n * fraction)));
            samples += st->solid[i].tree.num_samples;
            bytes += st->solid[i].tree.num_samples * sizeof(struct pell_surface_sample) +
                     st->solid[i].tree.num_nodes * sizeof(struct pell_light_node) +
                     ((size_t) st->solid[i].radial.count + 2) * sizeof(*st->solid[i].radial.node);
        }
    if (wanted > (double) st->knobs.points)
        pell_warn(ctx, "hierarchical", "raise the knob points, or lower density",
                  "the density needs %.0f samples, %d are used: the image may show them as spots", wanted, st->knobs.points);
    pell_info(ctx, "hierarchical", "%zu samples on %s, %.1f MB, made in %.3f s", samples,
              pell_counted((long long) st->solids->count, "solid", "solids").str, 1e-6 * (double) bytes, pell_seconds() - start);
    return PELL_OK;

fail:
    return res;
}

/* --- One pixel ------------------------------------------------------------------------------------------------------------------ */

/* R of all channels at a squared radius. */
static inline void look_up(const struct hierarchical_radial *t, float r2, float out[4])
{
    const uint32_t bits = (uint32_t) pell_float_bits(r2);
    int at;
    float f;
    const float *a;

    at = (int) (bits >> HI_SHIFT) - t->first;
    f = (float) (bits & ((1u << HI_SHIFT) - 1)) * (1.0f / (float) (1u << HI_SHIFT));
    if (at < 0) {
        at = 0;
        f = 0.0f;
    }
    if (at >= t->count) {
        out[0] = out[1] = out[2] = out[3] = 0.0f;
        return;
    }
    a = t->node[at];
    for (int c = 0; c < 4; c++)
        out[c] = a[c] + f * (a[c + 4] - a[c]);
}

struct near {
    float light[4], weight[4];
    float area, normal[3];
};

static inline float distance2(const float *a, const float *b)
{
    const float x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return x * x + y * y + z * z;
}

static inline float length2(const float *a)
{
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
}

/* Factors of a flat thin part, R, G and B, by pell_services_returned; scale: transmission, times the solid's scale. */
struct slab {
    float returned[3], scale[3];
};

/* The point where light leaves. */
struct exit {
    const float *at, *normal;
    float inverse, inverse2; /* reciprocal of the strength, and its square */
    const struct slab *slab;
};

/* Light that arrives at the point from a sample at the squared distance d2, all channels, times strength^2; R: the transport, 1/mm^2. */
static void transport(const struct solid *b, const struct exit *x, float d2, const struct pell_surface_sample *from, float R[4],
                      float light[3])
{
    struct pell_opposed_pair pair = { 0.0f, 0.0f, 0.0f, 0.0f, from->curvature / x->inverse };
    float through[3];

    look_up(&b->radial, d2 * x->inverse2, R);
    if (!b->is_opposed) {
        for (int c = 0; c < 3; c++)
            light[c] = R[c] * from->power[c];
        return;
    }
    for (int c = 0; c < 3; c++)
        R[c] *= x->slab->returned[c];
    for (int k = 0; k < 3; k++) {
        const float v = (x->at[k] - from->position[k]) * x->inverse;
        pair.distance2 += v * v;
        pair.from += from->normal[k] * v;
        pair.to += x->normal[k] * v;
        pair.facing += x->normal[k] * from->normal[k];
    }
    pell_opposed_apply(&b->opposed, &pair, x->slab->scale, R, through);
    for (int c = 0; c < 3; c++) {
        light[c] = R[c] * from->power[c] + through[c] * from->deep[c];
        R[c] += through[c];
    }
}

static void add_samples(const struct solid *b, const struct pell_light_node *n, const struct exit *x, float *sum, struct near *near)
{
    for (uint32_t i = n->first; i < n->first + n->count; i++) {
        const struct pell_surface_sample *s = &b->tree.samples[i];
        const float area = s->area, d2 = distance2(s->position, x->at), t = 1.0f - d2 / b->reach2, w = t > 0.0f ? t * t : 0.0f;
        float R[4], light[3];
        transport(b, x, d2, s, R, light);
        for (int c = 0; c < 3; c++)
            sum[c] += (1.0f - w) * light[c];
        if (!(w > 0.0f))
            continue;
        for (int c = 0; c < 3; c++) {
            near->light[c] += w * light[c];
            near->weight[c] += w * R[c] * area;
            near->normal[c] += w * area * s->normal[c];
        }
        near->area += w * area;
    }
}

/* Adds a distant node whose samples face different directions, of which the transport between faces is no mean: a few samples, evenly
 * spaced along the tree's curve, represent them. Returns false, and adds nothing, if the node has few samples or its light is on others. */
static bool add_folded_node(const struct solid *b, const struct pell_light_node *n, const struct exit *x, float *sum)
{
    const uint32_t end = n->next < b->tree.num_nodes ? b->tree.nodes[n->next].first : (uint32_t) b->tree.num_samples;
    const uint64_t count = end - n->first;
    float light[3] = { 0.0f }, power[3] = { 0.0f };

    if (count < 2 * REPRESENTATIVES)
        return false;
    for (uint32_t i = 0; i < REPRESENTATIVES; i++) {
        const struct pell_surface_sample *s = &b->tree.samples[n->first + (uint32_t) ((2 * i + 1) * count / (2 * REPRESENTATIVES))];
        float R[4], one[3];
        transport(b, x, distance2(s->position, x->at), s, R, one);
        for (int c = 0; c < 3; c++) {
            light[c] += one[c];
            power[c] += s->power[c];
        }
    }
    for (int c = 0; c < 3; c++)
        if (n->power[c] > 0.0f && !(power[c] > 0.0f))
            return false;
    for (int c = 0; c < 3; c++)
        sum[c] += power[c] > 0.0f ? n->power[c] * light[c] / power[c] : 0.0f;
    return true;
}

/* Similarity of the samples in the window to a smooth surface without a border, 0 to 1. */
static float smooth_surface(const struct solid *b, const struct near *n)
{
    const float cover = n->area / b->window_area;
    float length;

    if (!(n->area > 0.0f))
        return 0.0f;
    length = sqrtf(n->normal[0] * n->normal[0] + n->normal[1] * n->normal[1] + n->normal[2] * n->normal[2]) / n->area;
    return smooth_ramp(0.8f, 0.95f, length) * smooth_ramp(0.5f, 0.75f, cover) * (1.0f - smooth_ramp(1.35f, 1.6f, cover));
}

static void gather(const struct hierarchical_state *st, const struct solid *b, const float p[3], const float normal[3], float strength,
                   const float own[3], const struct slab *slab, float out[3])
{
    const struct pell_light_node *nodes = b->tree.nodes;
    const float error = st->knobs.error, s = strength > 1.0f ? 1.0f : strength;
    const float coord = s * (HI_STRENGTHS - 1);
    const int row = (int) (coord + 0.5f);
    float inverse2, sum[4] = { 0 }, q;
    struct near near = { { 0 } };
    struct exit x;

    if (row == 0 || b->tree.num_nodes == 0) { /* no subsurface scattering: light leaves where it enters */
        for (int c = 0; c < 3; c++)
            out[c] = (float) b->radial.total[c] * own[c];
        return;
    }
    inverse2 = 1.0f / (s * s);
    x = (struct exit) { p, normal, 1.0f / s, inverse2, slab };
    for (uint32_t i = 0; i < (uint32_t) b->tree.num_nodes;) {
        const struct pell_light_node *n = &nodes[i];
        const float d2 = distance2(n->centre, p);
        if (b->is_opposed && !(n->power[0] + n->power[1] + n->power[2] > 0.0f) && pell_light_node_distance2(n, p) > b->reach2) {
            i = n->next;
            continue;
        }
        const bool far = n->area < error * d2 && pell_light_node_distance2(n, p) > b->reach2;
        if (far && (!b->is_opposed || length2(n->normal) > MIN_NORMAL2)) {
            const struct pell_surface_sample one = pell_light_node_sample(n);
            float R[4], light[3];
            transport(b, &x, d2, &one, R, light);
            for (int c = 0; c < 3; c++)
                sum[c] += light[c];
            i = n->next;
        } else if (far && add_folded_node(b, n, &x, sum)) {
            i = n->next;
        } else if (n->count) {
            add_samples(b, n, &x, sum, &near);
            i = n->next;
        } else {
            i++;
        }
    }
    q = st->knobs.near == HI_NEAR_PLAIN ? 0.0f : smooth_surface(b, &near);
    for (int c = 0; c < 3; c++) {
        const float core = slab->returned[c] * b->radial.core[row][c] * b->mean_area, weight = near.weight[c] * inverse2 + core;
        const float mean = weight > 0.0f ? (near.light[c] * inverse2 + core * own[c]) / weight : own[c];
        const float light =
            sum[c] * inverse2 + q * slab->returned[c] * b->radial.window[row][c] * mean + (1.0f - q) * near.light[c] * inverse2;
        out[c] = light > 0.0f ? light : 0.0f;
    }
}

/* --- A frame -------------------------------------------------------------------------------------------------------------------- */

struct frame_task {
    const struct hierarchical_state *st;
    const struct pell_frame *in;
    const struct pell_frame_light *out;
    int first; /* band */
};

/* Up to 16 pixels. */
static void gather16(const struct frame_task *t, const ptrdiff_t *at, int count)
{
    const struct pell_frame *in = t->in;
    struct pell_points16 points;
    float returned[3][16], crossed[3][16];
    int32_t solid[16];
    bool any = false;

    pell_solids_find(t->st->solids, t->st->services->rays, in, at, count, solid);
    for (int i = 0; i < count; i++)
        any |= solid[i] >= 0 && t->st->solid[solid[i]].is_opposed;
    if (any) {
        pell_points16_of_pixels(in, at, count, &points);
        pell_services_returned(t->st->services, &points, count, returned, crossed);
    }
    for (int i = 0; i < count; i++) {
        const float p[3] = { in->position[0][at[i]], in->position[1][at[i]], in->position[2][at[i]] };
        const float normal[3] = { in->normal[0][at[i]], in->normal[1][at[i]], in->normal[2][at[i]] };
        const float own[3] = { in->irradiance[0][at[i]], in->irradiance[1][at[i]], in->irradiance[2][at[i]] };
        struct slab slab = { { 1.0f, 1.0f, 1.0f }, { 1.0f, 1.0f, 1.0f } };
        float light[3] = { 0 };
        for (int c = 0; c < 3 && solid[i] >= 0 && t->st->solid[solid[i]].is_opposed; c++) {
            slab.returned[c] = returned[c][i];
            slab.scale[c] = t->st->solid[solid[i]].scale[c] * crossed[c][i];
        }
        if (solid[i] >= 0)
            gather(t->st, &t->st->solid[solid[i]], p, normal, t->st->knobs.strength && in->strength ? in->strength[at[i]] : 1.0f, own,
                   &slab, light);
        for (int c = 0; c < 3; c++)
            t->out->light[c][at[i]] = light[c];
    }
}

static void gather_band(void *arg, int index, int worker)
{
    const struct frame_task *t = arg;
    const struct pell_rect r = t->in->rect;
    const int y0 = r.y0 + (t->first + index) * ROWS, y1 = y0 + ROWS < r.y1 ? y0 + ROWS : r.y1;
    ptrdiff_t at[16];
    int n = 0;

    (void) worker;
    for (int y = y0; y < y1; y++)
        for (int x = r.x0; x < r.x1; x++) {
            const ptrdiff_t i = y * t->in->shape.stride + x;
            if (!t->in->material[i])
                continue;
            at[n++] = i;
            if (n == 16) {
                gather16(t, at, n);
                n = 0;
            }
        }
    if (n > 0)
        gather16(t, at, n);
}

static enum pell_result hierarchical_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct hierarchical_state *st = state;
    struct frame_task t = { st, in, out, 0 };
    const int bands = (in->rect.y1 - in->rect.y0 + ROWS - 1) / ROWS;
    const double start = pell_seconds();

    for (t.first = 0; t.first < bands; t.first += BATCH) {
        pell_pool_run(st->services->pool, bands - t.first < BATCH ? bands - t.first : BATCH, gather_band, &t);
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        reference_progress(st->ctx, "hierarchical", in, t.first + BATCH, bands);
    }
    st->frame.time = (struct pell_pass_time) {
        .name = "hierarchical.gather",
        .seconds = pell_seconds() - start,
        .pixels = (int64_t) (in->rect.x1 - in->rect.x0) * (in->rect.y1 - in->rect.y0),
    };
    st->frame.time.bytes = st->frame.time.pixels * 52;
    return PELL_OK;
}

const struct pell_method_engine pell_hierarchical_cpu = {
    .create = hierarchical_create, .record = hierarchical_render, .destroy = hierarchical_destroy, .times = reference_times
};
