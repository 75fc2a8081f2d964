/* SPDX-License-Identifier: MIT
 * distance_sampling.c - free-flight sampling. Each flight samples the distance of one channel, chosen by the channels' throughput, and is
 * weighted by the densities of all three (balance heuristic; with channels chosen by throughput the sum of the weights never grows). A
 * flight within a distance known to be free of surfaces needs no ray; the random numbers are the same with and without. Layers: delta
 * tracking (Woodcock et al. 1965) with the largest sigma_t of any layer and channel as majorant; null collisions are weighted in the same
 * way. */
#include "methods/path_trace/path.h"

#include "scene/triangle.h"

/* Whether a surface comes before the end of a flight. */
static void look_ahead(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_ray *ray, float *safe,
                       struct pt_flight *f)
{
    f->has_hit = f->found = false;
    f->bound = *safe;
    if (f->length < *safe) {
        counts->steps_without_ray++;
        *safe -= f->length;
        return;
    }
    if (s->solid[solid].grid) {
        const float bound = pell_distance_bound(s->distance, solid, ray->x);
        if (f->length < bound) {
            counts->steps_without_ray++;
            *safe = bound - f->length;
            return;
        }
        f->bound = fmaxf(f->bound, bound);
    }
    *safe = 0.0f;
    f->found = pt_intersect(s, counts, ray->from, ray->w, fmaxf(f->length, f->bound + f->lookahead), PELL_RAY_ALL, &f->hit);
    f->has_hit = f->found && f->hit.t <= f->length;
}

bool pt_outside(const struct pt_solid *b, struct pell_vec3 x, float margin)
{
    return x.x < b->lo.x - margin || x.x > b->hi.x + margin || x.y < b->lo.y - margin || x.y > b->hi.y + margin || x.z < b->lo.z - margin ||
           x.z > b->hi.z + margin;
}

float pt_exit_distance(const struct pt_solid *b, struct pell_vec3 x, struct pell_vec3 w)
{
    const float tx = w.x > 0.0f ? (b->hi.x - x.x) / w.x : w.x < 0.0f ? (b->lo.x - x.x) / w.x : INFINITY;
    const float ty = w.y > 0.0f ? (b->hi.y - x.y) / w.y : w.y < 0.0f ? (b->lo.y - x.y) / w.y : INFINITY;
    const float tz = w.z > 0.0f ? (b->hi.z - x.z) / w.z : w.z < 0.0f ? (b->lo.z - x.z) / w.z : INFINITY;

    return fmaxf(fminf(tx, fminf(ty, tz)), 0.0f);
}

void pt_attenuate(const struct pt_coefficients *m, float length, float beta[3])
{
    float sum = 0.0f, passed = 0.0f, t[3];

    if (m->gray)
        return; /* all channels have the same transmittance */
    for (int c = 0; c < 3; c++) {
        t[c] = pt_exp(-m->sigma_t[c] * length);
        sum += beta[c];
        passed += beta[c] * t[c];
    }
    for (int c = 0; c < 3; c++)
        beta[c] = passed > 0.0f ? beta[c] * t[c] * (sum / passed) : 0.0f;
}

static void collide(const struct pt_coefficients *m, float length, const float inverse_stay[3], float beta[3])
{
    float sum = 0.0f, density = 0.0f, t[3];

    if (m->gray) {
        for (int c = 0; c < 3; c++)
            beta[c] *= m->sigma_s[c] / m->sigma_t[c] / inverse_stay[c];
        return;
    }
    for (int c = 0; c < 3; c++) {
        t[c] = pt_exp(-m->sigma_t[c] * length);
        sum += beta[c];
        density += beta[c] * m->sigma_t[c] * t[c] * inverse_stay[c];
    }
    for (int c = 0; c < 3; c++)
        beta[c] = density > 0.0f ? beta[c] * m->sigma_s[c] * t[c] * (sum / density) : 0.0f;
}

void pt_sample_flight(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_ray *ray, const float beta[3],
                      float *safe, struct pt_sampler *sampler, struct pt_flight *out)
{
    const struct pt_coefficients *m = &s->solid[solid].medium.layer[0];
    const int c = m->gray ? 0 : pt_sample_channel(beta, pt_random(sampler));
    const float depth = -pt_log(pt_chance(sampler));

    out->channel = c;
    out->length = m->sigma_t[c] > 0.0f ? depth * m->mean_free_path[c] : INFINITY;
    if (!(out->length < 1e30f)) { /* no collision before the bounds of the scene */
        out->length = INFINITY;
        *safe = 0.0f;
    }
    for (int k = 0; k < 3; k++)
        out->inverse_stay[k] = 1.0f;
    look_ahead(s, counts, solid, ray, safe, out);
}

void pt_end_flight(const struct pt_scene *s, int solid, const struct pt_ray *ray, const struct pt_flight *f, float beta[3],
                   struct pt_free_path *out)
{
    const struct pt_solid *b = &s->solid[solid];
    const struct pt_coefficients *m = &b->medium.layer[0];

    out->has_hit = f->has_hit;
    out->lost = out->floor = false;
    out->medium = m;
    if (out->has_hit) {
        out->hit = f->hit;
        out->length = out->hit.t;
        out->x = out->hit.p;
        pt_attenuate(m, out->length, beta);
        return;
    }
    out->length = f->length;
    out->x = vec3_mad(ray->x, f->length, ray->w);
    if (f->length == INFINITY || pt_outside(b, out->x, 4.0f * s->epsilon)) {
        out->lost = true;
        out->length = pt_outside(b, ray->x, 0.0f) ? 0.0f : pt_exit_distance(b, ray->x, ray->w);
        out->x = vec3_mad(ray->x, out->length, ray->w);
        pt_attenuate(m, out->length, beta);
        return;
    }
    collide(m, f->length, f->inverse_stay, beta);
}

/* --- Layers ------------------------------------------------------------------------------------------------------------------------ */

/* NULL: below the layers, where light is absorbed. */
static const struct pt_coefficients *layer_at(const struct pt_scene *s, int solid, struct pell_vec3 x)
{
    const struct pt_medium *m = &s->solid[solid].medium;
    const struct pt_coefficients *lowest = m->ends ? NULL : &m->layer[m->layers - 1];
    const float bound = s->solid[solid].grid ? pell_distance_bound(s->distance, solid, x) : 0.0f;
    struct pell_nearest nearest;
    int i = 0;

    if (bound >= m->deepest || !pell_rays_closest_point(s->rays, x, m->deepest, s->solids->of_mesh, solid, &nearest))
        return lowest;
    if (m->maps) {
        float depth[PELL_LAYERS_MOST];
        pell_medium_layers_depths(&m->maps->medium_layers, &m->maps->meshes[nearest.mesh], nearest.triangle, nearest.u, nearest.v, depth);
        i = pell_medium_layers_at(&m->maps->medium_layers, depth, (float) nearest.distance);
        return i < 0 ? NULL : &m->layer[i];
    }
    while (i < m->layers && nearest.distance >= (double) m->depth[i])
        i++;
    return i < m->layers ? &m->layer[i] : lowest;
}

/* The bottom of the layers near x: the nearest surface point, and the direction and distance of the bottom. */
struct bottom {
    struct pell_nearest nearest;
    struct pell_vec3 n;  /* unit, outward */
    double depth, least; /* mm; least: minimum step toward it */
};

static bool find_bottom(const struct pt_scene *s, int solid, struct pell_vec3 x, struct bottom *b)
{
    const struct pt_medium *m = &s->solid[solid].medium;
    const float reach = m->floor ? 1.01f * m->deepest + 64.0f * s->epsilon : m->deepest;
    struct pell_vec3 corner[3];

    b->depth = (double) m->deepest;
    b->least = fmax((m->maps ? 2e-3 : 1e-4) * (double) m->deepest, m->floor ? 4.0 * (double) s->epsilon : 0.0);
    if (!pell_rays_closest_point(s->rays, x, reach, s->solids->of_mesh, solid, &b->nearest))
        return false;
    if (m->maps) {
        float depth[PELL_LAYERS_MOST];
        pell_medium_layers_depths(&m->maps->medium_layers, &m->maps->meshes[b->nearest.mesh], b->nearest.triangle, b->nearest.u,
                                  b->nearest.v, depth);
        b->depth = (double) depth[m->layers - 1];
    }
    if (!m->floor)
        return true;
    b->n = vec3_mul(vec3_sub(b->nearest.point, x), 1.0f / fmaxf((float) b->nearest.distance, 1e-20f));
    if (b->nearest.distance < 16.0 * (double) s->epsilon) { /* on the surface */
        pell_triangle_corners(&s->scene->meshes[b->nearest.mesh], b->nearest.triangle, corner);
        b->n = vec3_normalize(pell_triangle_cross(corner));
    }
    return true;
}

/* Distance that light at x can travel along w before it can be below the layers, at least the minimum step; 0: it is below. INFINITY if the
 * layers have no end. Mapped depths vary, so half of the distance to them is used. Light reflected by a substrate travels up from it. */
static float distance_to_bottom(const struct pt_scene *s, int solid, struct pell_vec3 x, struct pell_vec3 w)
{
    const struct pt_medium *m = &s->solid[solid].medium;
    struct bottom b;
    double gap;

    if (!m->ends)
        return INFINITY;
    if (!find_bottom(s, solid, x, &b))
        return 0.0f;
    gap = b.depth - b.nearest.distance;
    if (!(gap > 0.0))
        return m->floor && gap > -3.0 * b.least && vec3_dot(w, b.n) > 0.0f ? (float) b.least : 0.0f;
    return (float) fmax(m->maps ? 0.5 * gap : gap, b.least);
}

static void absorb(const struct pt_medium *m, struct pell_vec3 x, float length, float beta[3], struct pt_free_path *out)
{
    beta[0] = beta[1] = beta[2] = 0.0f;
    out->medium = &m->layer[m->layers - 1];
    out->length = length;
    out->x = x;
}

/* Handles light at x below the layers. */
static void end_below(const struct pt_scene *s, int solid, struct pell_vec3 x, float length, float beta[3], struct pt_free_path *out)
{
    const struct pt_medium *m = &s->solid[solid].medium;
    const struct pell_mesh *mesh;
    struct bottom b;

    if (!m->floor || !find_bottom(s, solid, x, &b)) {
        absorb(m, x, length, beta, out);
        return;
    }
    mesh = &s->scene->meshes[b.nearest.mesh];
    pell_base_color_at(&s->scene->materials[mesh->material], mesh, b.nearest.triangle, b.nearest.u, b.nearest.v, out->albedo);
    out->floor = true;
    out->medium = NULL;
    out->length = length;
    out->n = b.n;
    out->x = vec3_mad(x, (float) (b.nearest.distance - fmax(b.depth - b.least, 0.0)), b.n);
}

/* Delta tracking between real and null collisions. A step beyond the known free distance traces a ray. */
static void sample_layers(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_ray *ray, float beta[3],
                          float *safe, struct pt_sampler *sampler, struct pt_free_path *out)
{
    struct pt_ray r = *ray;
    const struct pt_solid *b = &s->solid[solid];
    const float majorant = fmaxf(b->medium.max_sigma_t[0], fmaxf(b->medium.max_sigma_t[1], b->medium.max_sigma_t[2]));
    struct pt_flight flight = { .lookahead = 0.0f };
    float length = 0.0f;

    for (;;) {
        const float clear = distance_to_bottom(s, solid, r.x, r.w),
                    tentative = majorant > 0.0f ? -logf((float) pt_fine(sampler)) / majorant : INFINITY;
        const float step = fminf(tentative, clear);
        float sum = 0.0f, real = 0.0f, p;
        if (clear == 0.0f) {
            end_below(s, solid, r.x, length, beta, out);
            return;
        }
        flight.length = step < 1e30f ? step : INFINITY;
        look_ahead(s, counts, solid, &r, safe, &flight);
        out->has_hit = flight.has_hit;
        if (out->has_hit) {
            out->hit = flight.hit;
            out->length = length + out->hit.t;
            out->x = out->hit.p;
            return;
        }
        out->x = vec3_mad(r.x, step, r.w);
        out->length = length + step;
        if (!(step < 1e30f) || pt_outside(b, out->x, 4.0f * s->epsilon)) {
            out->lost = true;
            out->x = vec3_mad(r.x, pt_outside(b, r.x, 0.0f) ? 0.0f : pt_exit_distance(b, r.x, r.w), r.w);
            return;
        }
        length += step;
        r.x = r.from = out->x;
        if (clear < tentative) /* by memorylessness the remaining flight is distributed like a new one */
            continue;
        out->medium = layer_at(s, solid, r.x);
        if (!out->medium) {
            end_below(s, solid, r.x, length, beta, out);
            return;
        }
        for (int c = 0; c < 3; c++) {
            sum += beta[c];
            real += beta[c] * out->medium->sigma_t[c];
        }
        p = sum > 0.0f ? real / (sum * majorant) : 1.0f;
        if (pt_random(sampler) < p) {
            for (int c = 0; c < 3; c++)
                beta[c] = real > 0.0f ? beta[c] * out->medium->sigma_s[c] * (sum / real) : 0.0f;
            return;
        }
        for (int c = 0; c < 3; c++)
            beta[c] *= (1.0f - out->medium->sigma_t[c] / majorant) / (1.0f - p);
    }
}

void pt_sample_distance(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_ray *ray, float beta[3], float *safe,
                        struct pt_sampler *sampler, struct pt_free_path *out)
{
    struct pt_flight flight = { .lookahead = 0.0f };

    out->has_hit = out->lost = out->floor = false;
    if (s->solid[solid].medium.homogeneous) {
        pt_sample_flight(s, counts, solid, ray, beta, safe, sampler, &flight);
        pt_end_flight(s, solid, ray, &flight, beta, out);
    } else {
        sample_layers(s, counts, solid, ray, beta, safe, sampler, out);
    }
}

/* Layers: ratio tracking (Novak et al. 2014, "Residual Ratio Tracking for Estimating Attenuation in Participating Media"). */
void pt_transmittance(const struct pt_scene *s, int solid, struct pell_vec3 x, struct pell_vec3 w, float reach, struct pt_sampler *sampler,
                      float out[3])
{
    const struct pt_medium *m = &s->solid[solid >= 0 ? solid : 0].medium;
    const float majorant = fmaxf(m->max_sigma_t[0], fmaxf(m->max_sigma_t[1], m->max_sigma_t[2]));

    out[0] = out[1] = out[2] = 1.0f;
    if (solid < 0)
        return;
    for (int c = 0; c < 3; c++)
        out[c] = m->homogeneous ? pt_exp(-m->layer[0].sigma_t[c] * reach) : 1.0f;
    if (m->homogeneous || !(majorant > 0.0f || m->ends))
        return;
    for (float at = 0.0f;;) {
        const struct pt_coefficients *k;
        const float clear = distance_to_bottom(s, solid, vec3_mad(x, at, w), w),
                    tentative = majorant > 0.0f ? -logf((float) pt_fine(sampler)) / majorant : INFINITY;
        at += fminf(tentative, clear);
        if (!(at < reach) && clear > 0.0f)
            return;
        if (clear < tentative && clear > 0.0f)
            continue;
        k = clear > 0.0f ? layer_at(s, solid, vec3_mad(x, at, w)) : NULL;
        if (!k) {
            out[0] = out[1] = out[2] = 0.0f;
            return;
        }
        for (int c = 0; c < 3; c++)
            out[c] *= 1.0f - k->sigma_t[c] / majorant;
        if (out[0] + out[1] + out[2] <= 1e-9f)
            return;
    }
}
