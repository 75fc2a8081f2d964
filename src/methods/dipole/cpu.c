/* SPDX-License-Identifier: MIT
 *
 * cpu.c - M(x) = Int_S R(|x - y|) E(y) dA(y) for each pixel, with the number of samples that the target standard error requires.
 *
 * Two techniques sample y, both with densities per surface area:
 *
 * area    uniform over the whole solid, p = 1/area.
 * probes  (King et al. 2013) an axis a (the normal with probability 1/2, each tangent with 1/4), a channel, a radius r distributed like
 *         that channel's R, an angle; every intersection of the line along a through that point with the surface, within a sphere
 *         around x, is a y. Each y can be found by any axis and channel, so p = Sum_a P_a |n_y . a| Sum_c P_c p_c(r_a), r_a the
 *         distance of y from the axis a through x.
 *
 * They are combined by the balance heuristic (Veach and Guibas 1995): every y found by either adds R E / (N_probes p_probes + N_area
 * p_area).
 *
 * Samples come in batches, each a randomly shifted rank-1 lattice: batches are independent, so their spread gives an unbiased standard
 * error, while the points inside a batch are well distributed. A batch's random numbers are a hash of the point's position and the
 * renderer's seed.
 */
#include "methods/dipole/dipole.h"

#include "math/vec.h"
#include "methods/reference_frame.h"
#include "optics/medium/opposed.h"
#include "optics/profile/white.h"
#include "render/engine.h"
#include "transport/rqmc.h"

#include <string.h>

enum {
    BATCH_PROBES = 16,    /* per batch, if probes are used at all */
    BATCH_AREAS = 4,      /* per batch, in addition to probes */
    BATCHES_TOGETHER = 4, /* batches processed together, so that packets of points are full */
    PILOT_BATCHES = 16,   /* batches that estimate how many are needed */
    MIN_BATCHES = 16,     /* minimum number of batches per pixel */
    DARK_BATCHES = 128,   /* batches where the pilot found no light */
    MAX_HITS = 64,        /* surfaces along a probe; further ones are dropped */
    MAX_POINTS = 64,      /* queued until their irradiance is computed */
    ROWS_TOGETHER = 16,   /* rows between two progress reports */
};

struct solid {
    const struct pell_profile *profile;
    double scale[3]; /* of R: 1, or white */
    struct dipole_radii radii;
    double spacing; /* mm, between texels */
    struct pell_opposed opposed;
    bool is_opposed;
};

/* One per worker. */
struct counts {
    _Alignas(64) int64_t pixels, samples, cut, over; /* over: pixels that stopped at the cap */
};

struct dipole_state {
    struct reference_frame frame;         /* first member */
    const struct pell_services *services; /* borrowed */
    struct pell_context *ctx;
    struct dipole_knobs knobs;
    struct pell_solids *solids;
    struct solid *solid; /* by solid */
    struct counts *counts;
};

/* State of a pixel's estimate, by batches. */
struct pixel {
    const struct dipole_state *st;
    const struct pell_solid *surface;
    const struct solid *solid;
    int32_t solid_index;
    struct pell_vec3 at, axis[3];
    double strength;
    float returned[3], scale[3];  /* factors by pell_services_returned; scale: transmission, times the solid's scale */
    double num_probes, num_areas; /* samples per technique and batch */
    uint32_t seed;
    double error; /* target relative standard error */
    double sum[BATCHES_TOGETHER][3];
    uint32_t mesh[MAX_POINTS], triangle[MAX_POINTS], pattern[MAX_POINTS]; /* of the queued points */
    float u[MAX_POINTS], v[MAX_POINTS];
    uint8_t batch[MAX_POINTS];
    int count;
    struct counts *counts;
};

/* --- Contributions of points ------------------------------------------------------------------------------------------------------ */

/* Sampling density at y over both techniques, per mm^2 and batch. */
static double density(const struct pixel *p, struct pell_vec3 y, struct pell_vec3 n)
{
    static const double fraction[3] = { 0.25, 0.25, 0.5 };
    const struct dipole_radii *radii = &p->solid->radii;
    const struct pell_vec3 to = vec3_sub(y, p->at);
    const double s2 = p->strength * p->strength, d2 = (double) vec3_dot(to, to) / s2;
    double sum = p->num_areas / p->surface->area;

    if (p->num_probes == 0.0 || d2 >= radii->largest * radii->largest)
        return sum;
    for (int a = 0; a < 3; a++) {
        const double along = (double) vec3_dot(to, p->axis[a]), facing = fabs((double) vec3_dot(n, p->axis[a]));
        const double r2 = fmax(d2 - along * along / s2, 0.0);
        double of_radius = 0.0;
        for (int c = 0; c < 3; c++)
            of_radius += dipole_radii_density(radii, c, r2);
        sum += p->num_probes * fraction[a] * facing * of_radius / (s2 * radii->channels);
    }
    return sum;
}

/* Corrects R for the orientation of the faces: `v` from a point with the normal `n` to the pixel. through: see pell_opposed_apply. */
static void oppose(const struct pixel *p, struct pell_vec3 v, struct pell_vec3 n, float curvature, float R[3], float through[3])
{
    const float s = (float) p->strength;
    const struct pell_opposed_pair pair = { vec3_dot(v, v) / (s * s), vec3_dot(n, v) / s, vec3_dot(p->axis[2], v) / s,
                                            vec3_dot(p->axis[2], n), curvature * s };

    for (int c = 0; c < 3; c++)
        R[c] *= p->returned[c];
    pell_opposed_apply(&p->solid->opposed, &pair, p->scale, R, through);
}

/* Computes the irradiance of the queued points and adds their contributions to their batches. */
static void settle(struct pixel *p)
{
    float position[3][MAX_POINTS], normal[3][MAX_POINTS], irradiance[3][MAX_POINTS], single[3][MAX_POINTS], curvature[MAX_POINTS];
    bool valid[MAX_POINTS];
    const struct pell_surface_points in = { p->mesh, p->triangle, p->u, p->v, p->pattern, NULL };
    const struct pell_surface_light out = {
        .irradiance = { irradiance[0], irradiance[1], irradiance[2] },
        .position = { position[0], position[1], position[2] },
        .normal = { normal[0], normal[1], normal[2] },
        .single_surplus = { single[0], single[1], single[2] },
        .curvature = curvature,
        .valid = valid,
    };

    pell_services_light_points(
        p->st->services, &(struct pell_points_params) { .mix = -1.0f, .opposed = true, .spacing = (float) p->solid->spacing, .samples = 1 },
        &in, (size_t) p->count, &out);
    for (int i = 0; i < p->count; i++) {
        const struct pell_vec3 y = vec3(position[0][i], position[1][i], position[2][i]);
        const struct pell_vec3 n = vec3(normal[0][i], normal[1][i], normal[2][i]), to = vec3_sub(y, p->at);
        double r, samples_per_mm2;
        float R[3], through[3] = { 0.0f };
        if (!valid[i] || !(irradiance[0][i] + irradiance[1][i] + irradiance[2][i] > 0.0f))
            continue;
        samples_per_mm2 = density(p, y, n);
        r = sqrt((double) vec3_dot(to, to)) / p->strength;
        for (int c = 0; c < 3; c++)
            R[c] = (float) (p->solid->scale[c] * pell_profile_eval(&p->solid->profile[c], fmax(r, 1e-9)));
        if (p->solid->is_opposed)
            oppose(p, vec3_mul(to, -1.0f), n, curvature[i], R, through);
        for (int c = 0; samples_per_mm2 > 0.0 && c < 3; c++) {
            const float light = R[c] * irradiance[c][i] + through[c] * fmaxf(irradiance[c][i] - single[c][i], 0.0f);
            p->sum[p->batch[i]][c] += (double) light / (samples_per_mm2 * p->strength * p->strength);
        }
    }
    p->count = 0;
}

static void add_point(struct pixel *p, int batch, uint32_t mesh, uint32_t triangle, float u, float v, uint32_t pattern)
{
    const int i = p->count;

    p->mesh[i] = mesh;
    p->triangle[i] = triangle;
    p->u[i] = u;
    p->v[i] = v;
    p->pattern[i] = pattern;
    p->batch[p->count++] = (uint8_t) batch;
    if (p->count == MAX_POINTS)
        settle(p);
}

/* --- Sampling ------------------------------------------------------------------------------------------------------------------------ */

static void send_probes(struct pixel *p, int batch, uint32_t seed)
{
    const struct dipole_radii *radii = &p->solid->radii;
    const double reach = radii->largest * p->strength;
    _Alignas(64) int open[16];
    struct pell_ray_hit16 r;
    float end[16];
    int left = 16;

    memset(&r, 0, sizeof(r));
    for (int i = 0; i < BATCH_PROBES; i++) {
        const double xi = pell_lattice(seed, 0, (uint32_t) i), part = xi < 0.5 ? 2.0 * xi : xi < 0.75 ? 4.0 * xi - 2.0 : 4.0 * xi - 3.0;
        const int a = xi < 0.5 ? 2 : xi < 0.75 ? 0 : 1;
        const struct pell_vec3 axis = p->axis[a], s = p->axis[(a + 1) % 3], t = p->axis[(a + 2) % 3];
        const double phi = 2.0 * PELL_PI * pell_lattice(seed, 2, (uint32_t) i);
        int pick = (int) (part * radii->channels), channel = 0;
        double radius, half;
        struct pell_vec3 o;
        for (; channel < 2 && (!radii->lit[channel] || pick > 0); channel++)
            pick -= radii->lit[channel];
        radius = dipole_radii_draw(radii, channel, pell_lattice(seed, 1, (uint32_t) i)) * p->strength;
        half = sqrt(fmax(reach * reach - radius * radius, 0.0));
        o = vec3_mad(vec3_mad(p->at, (float) (radius * cos(phi)), s), (float) (radius * sin(phi)), t);
        o = vec3_mad(o, (float) half, axis);
        r.ray.ox[i] = o.x;
        r.ray.oy[i] = o.y;
        r.ray.oz[i] = o.z;
        r.ray.dx[i] = -axis.x;
        r.ray.dy[i] = -axis.y;
        r.ray.dz[i] = -axis.z;
        r.ray.tfar[i] = end[i] = (float) (2.0 * half);
        r.ray.mask[i] = PELL_RAY_TRANSLUCENT;
        open[i] = -1;
    }
    for (int k = 0; left > 0; k++) {
        pell_rays_closest16(p->st->services->rays, open, false, &r);
        left = 0;
        for (int i = 0; i < BATCH_PROBES; i++) {
            if (!open[i])
                continue;
            open[i] = r.hit.mesh[i] != PELL_NO_HIT ? -1 : 0;
            if (!open[i])
                continue;
            if (p->st->solids->of_mesh[r.hit.mesh[i]] == p->solid_index)
                add_point(p, batch, r.hit.mesh[i], r.hit.triangle[i], r.hit.u[i], r.hit.v[i], pell_hash(seed ^ (uint32_t) (i + 64 * k)));
            r.ray.tnear[i] = r.ray.tfar[i] * (1.0f + 2e-6f) + 1e-6f * (float) reach;
            r.ray.tfar[i] = end[i];
            if (k + 1 == MAX_HITS || !(r.ray.tnear[i] < end[i])) {
                p->counts->cut += k + 1 == MAX_HITS;
                open[i] = 0;
            }
            left += open[i] != 0;
        }
    }
}

static void spread_areas(struct pixel *p, int batch, uint32_t seed, int count)
{
    for (int i = 0; i < count; i++) {
        const double area = pell_lattice(seed, 3, (uint32_t) i) * p->surface->area;
        double f;
        float u, v;
        const struct pell_solid_triangle at = pell_solid_at(p->surface, area, &f);
        /* The position inside the triangle uses other random numbers: the remaining fraction of the first one has few digits. */
        pell_triangle_point((float) pell_lattice(seed, 4, (uint32_t) i), (float) pell_lattice(seed, 5, (uint32_t) i), &u, &v);
        add_point(p, batch, at.mesh, at.triangle, u, v, pell_hash(seed ^ 0x51ed270bu ^ (uint32_t) i));
    }
}

/* --- One pixel ------------------------------------------------------------------------------------------------------------------ */

static void run_batches(struct pixel *p, uint32_t first, int64_t count, struct pell_batches *s)
{
    memset(s, 0, sizeof(*s));
    while (s->count < count && !((s->count & 255) == 0 && pell_cancelled(p->st->ctx))) {
        memset(p->sum, 0, sizeof(p->sum));
        for (int i = 0; i < BATCHES_TOGETHER; i++) {
            const uint32_t seed = pell_hash(p->seed ^ pell_hash(first + (uint32_t) s->count + (uint32_t) i));
            if (p->num_probes > 0.0)
                send_probes(p, i, seed);
            spread_areas(p, i, seed, (int) p->num_areas);
        }
        settle(p);
        for (int i = 0; i < BATCHES_TOGETHER; i++)
            pell_batches_add(s, p->sum[i]);
    }
}

static void estimate(struct pixel *p, const float own[3], float out[3], float standard_error[3])
{
    const struct dipole_knobs *k = &p->st->knobs;
    const int a_batch = (int) (p->num_probes + p->num_areas);
    const int images = reference_images(k->half);
    const double most = fmax((double) k->most / a_batch, MIN_BATCHES) / images;
    double mean[3], spread[3], needed;
    struct pell_batches pilot, s;

    if (p->solid->radii.channels == 0 || !(p->strength > 1.0 / 1024.0)) {
        for (int c = 0; c < 3; c++) {
            out[c] = (float) (p->solid->scale[c] * pell_profile_total(&p->solid->profile[c]) * (double) own[c]);
            standard_error[c] = 0.0f;
        }
        return;
    }
    /* The pilot batches determine the number of batches and are left out of the mean: including them would bias it low. */
    run_batches(p, 0, PILOT_BATCHES / images, &pilot);
    needed = pell_batches_needed(&pilot, p->error, MIN_BATCHES / images, DARK_BATCHES / images);
    run_batches(p, PILOT_BATCHES, (int64_t) ceil(fmin(needed, most)), &s);
    pell_batches_measure(&s, mean, spread);
    for (int c = 0; c < 3; c++) {
        out[c] = (float) mean[c];
        standard_error[c] = (float) spread[c];
    }
    p->counts->pixels++;
    p->counts->samples += (pilot.count + s.count) * a_batch;
    p->counts->over += needed > most;
}

/* --- A frame -------------------------------------------------------------------------------------------------------------------- */

struct frame_task {
    const struct dipole_state *st;
    const struct pell_frame *in;
    const struct pell_frame_light *out;
    int first; /* row */
};

static void start_pixel(const struct dipole_state *st, struct pell_vec3 at, struct pell_vec3 normal, int32_t solid, float strength,
                        uint32_t seed, struct pixel *p)
{
    const int sampling = st->knobs.sampling;

    p->st = st;
    p->surface = &st->solids->solids[solid];
    p->solid = &st->solid[solid];
    p->solid_index = solid;
    p->at = at;
    p->axis[2] = vec3_normalize(normal);
    vec3_basis(p->axis[2], &p->axis[0], &p->axis[1]);
    p->strength = fmin((double) strength, 1.0);
    p->num_probes = sampling == DI_AREA ? 0.0 : BATCH_PROBES;
    p->num_areas = sampling == DI_AREA ? BATCH_PROBES : sampling == DI_BOTH ? BATCH_AREAS : 0.0;
    p->seed = pell_point_seed(at, seed);
    p->count = 0;
}

static void do16(const struct frame_task *t, const ptrdiff_t *at, int count, struct counts *counts)
{
    const struct pell_frame *in = t->in;
    struct pell_points16 points;
    float returned[3][16], crossed[3][16];
    int32_t solid[16];
    struct pixel p;
    bool any = false;

    pell_solids_find(t->st->solids, t->st->services->rays, in, at, count, solid);
    for (int i = 0; i < count; i++)
        any |= solid[i] >= 0 && t->st->solid[solid[i]].is_opposed;
    if (any) {
        pell_points16_of_pixels(in, at, count, &points);
        pell_services_returned(t->st->services, &points, count, returned, crossed);
    }
    p.counts = counts;
    p.error = reference_sample_error((double) t->st->knobs.error, t->st->knobs.half, in->num_samples);
    for (int i = 0; i < count && !pell_cancelled(t->st->ctx); i++) {
        const float own[3] = { in->irradiance[0][at[i]], in->irradiance[1][at[i]], in->irradiance[2][at[i]] };
        float light[3] = { 0 }, standard_error[3] = { 0 };
        if (solid[i] >= 0 && t->st->solids->solids[solid[i]].num_triangles > 0) {
            start_pixel(t->st, vec3(in->position[0][at[i]], in->position[1][at[i]], in->position[2][at[i]]),
                        vec3(in->normal[0][at[i]], in->normal[1][at[i]], in->normal[2][at[i]]), solid[i],
                        t->st->knobs.strength && in->strength ? in->strength[at[i]] : 1.0f,
                        reference_half_seed(in->seed, t->st->knobs.half), &p);
            for (int c = 0; c < 3 && p.solid->is_opposed; c++) {
                p.returned[c] = returned[c][i];
                p.scale[c] = (float) p.solid->scale[c] * crossed[c][i];
            }
            estimate(&p, own, light, standard_error);
        }
        for (int c = 0; c < 3; c++) {
            t->out->light[c][at[i]] = light[c];
            t->st->frame.standard_error[c][at[i]] = standard_error[c];
        }
    }
}

static void do_row(void *arg, int index, int worker)
{
    const struct frame_task *t = arg;
    const struct pell_rect r = t->in->rect;
    const ptrdiff_t row = (r.y0 + t->first + index) * t->in->shape.stride;
    ptrdiff_t at[16];
    int n = 0;

    for (int x = r.x0; x < r.x1; x++) {
        if (!t->in->material[row + x])
            continue;
        at[n++] = row + x;
        if (n == 16) {
            do16(t, at, n, &t->st->counts[worker]);
            n = 0;
        }
    }
    if (n > 0)
        do16(t, at, n, &t->st->counts[worker]);
}

static enum pell_result dipole_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct dipole_state *st = state;
    struct frame_task t = { st, in, out, 0 };
    struct counts sum = { 0 };
    const int rows = in->rect.y1 - in->rect.y0, threads = pell_pool_threads(st->services->pool);
    const double start = pell_seconds();

    memset(st->frame.standard_error[0], 0, 3 * (size_t) in->shape.stride * (size_t) in->shape.height * sizeof(float));
    memset(st->counts, 0, (size_t) threads * sizeof(*st->counts));
    for (t.first = 0; t.first < rows; t.first += ROWS_TOGETHER) {
        pell_pool_run(st->services->pool, rows - t.first < ROWS_TOGETHER ? rows - t.first : ROWS_TOGETHER, do_row, &t);
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        reference_progress(st->ctx, "dipole", in, t.first + ROWS_TOGETHER, rows);
    }
    for (int i = 0; i < threads; i++) {
        sum.pixels += st->counts[i].pixels;
        sum.samples += st->counts[i].samples;
        sum.cut += st->counts[i].cut;
        sum.over += st->counts[i].over;
    }
    st->frame.time = (struct pell_pass_time) { "dipole.sample", pell_seconds() - start, sum.pixels, sum.pixels * 52 };
    if (sum.pixels > 0)
        pell_info(st->ctx, "dipole", "%.0f samples per pixel; %.2f %% of the pixels reached the maximum (knob most)",
                  (double) sum.samples / (double) sum.pixels, 100.0 * (double) sum.over / (double) sum.pixels);
    if (sum.cut > 0)
        pell_warn(st->ctx, "dipole", NULL, "%lld probe rays met more than %d surfaces: light of those beyond is missing",
                  (long long) sum.cut, MAX_HITS);
    return PELL_OK;
}

static void dipole_destroy(void *state)
{
    struct dipole_state *st = state;

    if (!st)
        return;
    pell_free(st->ctx, st->frame.standard_error[0]);
    pell_free(st->ctx, st->counts);
    pell_free(st->ctx, st->solid);
    pell_solids_destroy(&st->solids);
    pell_free(st->ctx, st);
}

static enum pell_result dipole_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                      void **state)
{
    struct pell_context *ctx = services->ctx;
    struct dipole_state *st = pell_zalloc(ctx, sizeof(*st));
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->services = services;
    st->ctx = ctx;
    st->knobs = *(const struct dipole_knobs *) knobs;
    PELL_TRY(pell_services_solids(services, &st->solids));
    res = PELL_ERR_NOMEM;
    st->solid = pell_calloc(ctx, st->solids->count + 1, sizeof(*st->solid));
    st->counts = pell_calloc(ctx, (size_t) pell_pool_threads(services->pool), sizeof(*st->counts));
    if (!st->solid || !st->counts)
        goto fail;
    PELL_TRY(reference_make_planes(ctx, shape, &st->frame));
    for (size_t i = 0; i < st->solids->count; i++) {
        const struct pell_frame_material *m = &shape->materials[st->solids->solids[i].material];
        struct solid *b = &st->solid[i];
        b->profile = m->profile;
        dipole_radii_make(m, &b->radii);
        b->spacing = 0.05 * fmax(b->radii.largest, 1e-6);
        b->is_opposed = services->settings->opposed && pell_solid_has_medium(services->scene, &st->solids->solids[i], m) &&
                        pell_opposed_make(&m->medium, &b->opposed);
        for (int c = 0; c < 3; c++)
            b->scale[c] = pell_profile_scale(&m->profile[c], m->white);
    }
    return PELL_OK;

fail:
    return res;
}

const struct pell_method_engine pell_dipole_cpu = { .create = dipole_create,
                                                    .record = dipole_render,
                                                    .destroy = dipole_destroy,
                                                    .times = reference_times,
                                                    .standard_error = reference_standard_error };
