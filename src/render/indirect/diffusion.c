/* SPDX-License-Identifier: MIT
 *
 * diffusion.c - diffusion in the actual solid, instead of a half-space under each point of its surface.
 *
 * Below a fold of a surface there is no half-space: light follows the medium around the air, so the distance across the air says too
 * little. In a highly scattering medium the fluence phi obeys (nabla^2 - kappa^2) phi = -q inside and phi + s dphi/dn = 0 on the surface. q
 * is the light that enters, where it is first scattered: t mean free paths z along its refracted direction w, with the density exp(-t).
 * Green's third identity with G = exp(-kappa r)/(4 pi r) turns this into an integral equation on the surface (O. D. Kellogg, "Foundations
 * of Potential Theory", 1929, chapter 8):
 *
 *     phi/2 + Int (G/s + dG/dn) phi = Int exp(-t) G(x, y + t z w) q          q = L E/s, so that phi is the radiant exitance
 *
 * kappa is the transport exponent, w the mean direction of the light at y, and s = tanh(kappa b)/kappa puts the plane where the fluence
 * would vanish b above a flat surface. Over a ball of mean curvature H it would vanish at the height of Milne's problem s' as well, which
 * is s without internal reflection: s becomes s'/(1 + s' H) + s - s'. L makes a slab transmit light of normal incidence as the diffusion
 * model of opposed.h does: L cosh(kappa b) Int exp(-t) sinh(kappa (t z + b)) = amount sinh(kappa (z + b)).
 *
 * A half-space returns L/(1 + s kappa) Int exp(-t (1 + kappa z m)), m = -n.w. The profile's total differs from that by light that is
 * scattered once or a few times: it leaves where it entered, and curvature changes it as it does single scattering. Where single scattering
 * is computed apart from the profile, phi contains it, and the difference is negative.
 *
 * The equation is solved (equation.c) at collocation points for equal areas, 0.4 diffusion lengths 1/kappa apart or a quarter of the
 * thickness, the same for all channels.
 *
 * phi lacks what is finer than the distance of points. A method adds that: it spreads the entering light less its average over points,
 * and phi is added to the result, as in a coarse-grid correction. Light that enters where diffusion is not solved is left out here, and
 * remains for the method. A method that integrates over the whole solid finds M, the sum of profile_sum.h: its result is scaled by phi/M,
 * up to MAX_GAIN, and the rest is added without detail.
 */
#include "render/indirect/equation.h"
#include "render/indirect/internal.h"
#include "render/indirect/slope.h"

#include "math/scalar.h"
#include "shared/curvature.h"

#include <string.h>

enum { SAMPLES_PER_TASK = 256, MIN_POINTS = 800, MAX_POINTS = 4096, POINTS_PER_TASK = 64 };
#define STEP 0.4f             /* distance of points, in diffusion lengths */
#define MIN_STEP 1.2f         /* least distance of points over that of samples */
#define CLUSTER_DISTANCE 6.0f /* steps: distance beyond which clusters replace points */
#define RESOLVED 0.7f         /* value of STEP up to which a channel is resolved, */
#define UNRESOLVED 1.2f       /* and from which it is not solved */
#define TOTAL_MIN 0.02f       /* total of a profile below which light scatters too rarely for diffusion, */
#define TOTAL_FULL 0.06f      /* and from which diffusion holds; */
#define TOTAL_MAX 0.999       /* above this nothing is absorbed */
#define MIN_DISTANCE 0.3f     /* steps: least distance assumed between points on opposite sides of a thin part */
#define WINDOW 2.5f           /* steps: window in which sums over points are corrected */
#define SMOOTH 1.6f           /* steps: interpolation radius, */
#define MAX_OFFSET 1.5f       /* and largest distance of a sample from its point */
#define MEAN_COSINE 0.93f     /* mean cosine of light that propagates inward, with its angular spread */
#define MAX_GAIN 3.0f         /* largest factor of the result of methods that integrate over the whole solid */
#define THIN 2.0f             /* steps: thickness up to which a part is not solved, */
#define THICK 4.0f            /* and from which it is */

#define MIN_RISEN 0.5f /* limits of the distance of a source over a curved surface, */
#define MAX_RISEN 1.5f /* relative to that over a flat one */

#define PATHS_MIN 1.2f  /* mean free paths: thickness up to which light is scattered too rarely, */
#define PATHS_FULL 2.8f /* and from which diffusion holds */

/* Mean free paths: blur of the two source depths, each of which represents a range of depths. */
static const float blur[2] = { 0.6f, 1.2f };

struct solid {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct indirect_solid *input;
    struct collocation_points points;
    struct equation equation;
    float solved[3];                               /* per channel: confidence of the solution, [0, 1] */
    double *method_exitance[3];                    /* with input->profile_sum: M at the points */
    uint32_t *first_neighbour, *neighbour_cluster; /* per cluster, plus one for the end: clusters from which its samples are interpolated */
    struct indirect_solid_light *out;
};

/* --- Channels ------------------------------------------------------------------------------------------------------------------------- */

/* Light in a medium is first scattered after t mean free paths with the density exp(-t). Two values of t and their weights represent it:
 * Gauss-Laguerre nodes, but the farther one is moved so that the mean of exp(x t) is 1/(1 - x), the value for light that propagates
 * straight down where phi grows by exp(x) per mean free path. */
static void find_paths(float x, struct equation_channel *q)
{
    const double nearer = 2.0 - sqrt(2.0), right = 1.0 / (1.0 - (double) x);
    double low = 2.0 + sqrt(2.0), high = 12.0;

    for (int i = 0; i < 30; i++) {
        const double farther = 0.5 * (low + high), path_weight = (1.0 - nearer) / (farther - nearer); /* mean of t is 1 */
        *((1.0 - path_weight) * exp((double) x * nearer) + path_weight * exp((double) x * farther) < right ? &low : &high) = farther;
    }
    q->path[0] = (float) nearer;
    q->path[1] = (float) low;
    q->path_weight[1] = (float) ((1.0 - nearer) / (low - nearer));
    q->path_weight[0] = 1.0f - q->path_weight[1];
}

/* Returns L so that slabs transmit light of normal incidence with `amount`, whose source is one mean free path deep. */
static float source_scale_of(const struct pell_opposed *opposed, int c, const struct equation_channel *q)
{
    const float kappa = opposed->kappa[c], beyond = opposed->beyond[c];
    float at = 0.0f;

    for (int k = 0; k < 2; k++)
        at += q->path_weight[k] * sinhf(kappa * (q->path[k] * opposed->depth[c] + beyond));
    return opposed->amount[c] * sinhf(kappa * (opposed->depth[c] + beyond)) / (at * coshf(kappa * beyond));
}

/* Sets the coefficients of a channel, see the head of this file. */
static void set_coefficients(const struct pell_opposed *opposed, int c, struct equation_channel *q)
{
    const float beyond = opposed->kappa[c] * opposed->beyond[c];

    q->kappa = opposed->kappa[c];
    q->s = tanhf(beyond) / q->kappa;
    q->depth = opposed->depth[c];
    find_paths(fminf(MEAN_COSINE * q->kappa * q->depth, 0.95f), q);
    q->source_scale = source_scale_of(opposed, c, q);
}

/* Sets everything that depends on a channel's profile. */
static void set_channel(struct solid *s, int c)
{
    const struct pell_profile *profile = &s->input->profile[c];
    struct equation *e = &s->equation;
    struct equation_channel *q = &e->channel[c];
    const double total = pell_profile_total(profile);
    const float step = s->points.step;

    q->total = (float) total;
    if (!(total > (double) TOTAL_MIN && total < TOTAL_MAX))
        return;
    set_coefficients(s->input->opposed, c, q);
    for (int k = 0; k < 2; k++) {
        q->blur2[k] = blur[k] * blur[k] * q->depth * q->depth;
        q->min_distance2[k] = fmaxf(e->min_distance2, q->blur2[k]);
    }
    q->active = q->kappa > 0.0f && q->s > 0.0f && step * q->kappa <= UNRESOLVED;
    if (!q->active)
        return;
    s->solved[c] = (1.0f - ramp(RESOLVED, UNRESOLVED, step * q->kappa)) * ramp(TOTAL_MIN, TOTAL_FULL, q->total);
}

/* Harmonic mean of the thickness, mm, over the area where diffusion holds. */
static double mean_thickness(const struct indirect_solid *of)
{
    const float least = PATHS_MIN * fminf(fminf(of->opposed->depth[0], of->opposed->depth[1]), of->opposed->depth[2]);
    double area = 0.0, sum = 0.0;

    for (size_t i = 0; i < of->count; i++)
        if (of->thickness[i] > least) {
            area += (double) of->samples[i].area;
            sum += (double) of->samples[i].area / (double) of->thickness[i];
        }
    return sum > 0.0 ? area / sum : HUGE_VAL;
}

/* Returns the distance of points that resolves every channel and the thickness, as far as MAX_POINTS allows. It is the same for all
 * channels, so that colours do not shift where a part is too thin for the points. 0: no channel can be resolved. */
static float choose_step(const struct indirect_solid *of)
{
    double area = 0.0, shortest = HUGE_VAL, longest = 0.0, apart;
    float step;

    for (size_t i = 0; i < of->count; i++)
        area += (double) of->samples[i].area;
    for (int c = 0; c < 3; c++) {
        const double total = pell_profile_total(&of->profile[c]);
        if (!(total > (double) TOTAL_MIN && total < TOTAL_MAX) || !(of->opposed->kappa[c] > 0.0f))
            continue;
        shortest = fmin(shortest, 1.0 / (double) of->opposed->kappa[c]);
        longest = fmax(longest, 1.0 / (double) of->opposed->kappa[c]);
    }
    if (!(longest > 0.0))
        return 0.0f;
    apart = fmin((double) STEP * shortest, mean_thickness(of) / (double) THICK);
    step = (float) sqrt(area / fmin(fmax(area / (apart * apart), MIN_POINTS), MAX_POINTS));
    step = fmaxf(step, MIN_STEP * of->spacing);
    return (double) step < (double) UNRESOLVED * longest ? step : 0.0f;
}

/* Confidence of the solution at a sample, by the thickness of its part. */
static float solved_at(const struct solid *s, size_t i, int c)
{
    const float thickness = s->input->thickness[i];

    return s->solved[c] * ramp(THIN, THICK, thickness / s->points.step) *
           ramp(PATHS_MIN, PATHS_FULL, thickness / s->input->opposed->depth[c]);
}

/* Averages the entering light, and its components, over each point and cluster. A method spreads the light that enters where diffusion is
 * not solved; all other light is solved, also where it leaves from thin parts. */
static void find_light(const struct solid *s, int c)
{
    const struct collocation_points *p = &s->points;
    double *light = s->equation.channel[c].light, *source = s->equation.channel[c].source, *single = s->equation.channel[c].single;

    memset(light, 0, p->count * sizeof(*light));
    memset(source, 0, p->count * sizeof(*source));
    memset(single, 0, p->count * sizeof(*single));
    for (size_t i = 0; i < p->num_samples; i++)
        if (p->point_of[i] != COLLOCATION_NONE) {
            const double weight = s->input->profile_sum ? 1.0 : (double) solved_at(s, i, c);
            light[p->point_of[i]] += weight * (double) p->sample[i].power[c];
            source[p->point_of[i]] += weight * (double) s->input->source[i][c];
            single[p->point_of[i]] += s->input->single ? weight * (double) s->input->single[i][c] : 0.0;
        }
    for (uint32_t i = 0; i < p->count; i++) {
        const double per_area = p->point[i].area > 0.0f ? 1.0 / (double) p->point[i].area : 0.0;
        light[i] *= per_area;
        source[i] *= per_area;
        single[i] *= per_area;
    }
    equation_extend(&s->equation, light);
    equation_extend(&s->equation, source);
    equation_extend(&s->equation, single);
}

/* Distance of a source along the mean direction w, from that of its light along its own directions: those differ by the more, the shorter
 * w is, so that light arrives beside the mean. There the surface is below the tangent plane if it is convex, and the source less deep. */
static float along_mean(float distance, float curvature, float w2, float inward)
{
    const float aside2 = distance * distance * fmaxf(1.0f - w2, 0.0f), rise = 0.5f * curvature * aside2;

    return inward > 0.0f ? fminf(fmaxf(distance - rise / inward, MIN_RISEN * distance), MAX_RISEN * distance) : distance;
}

/* Finds the mean light direction of each element and the depths of its sources along it, which are limited by the thickness. */
static enum pell_result find_source_directions(struct solid *s)
{
    const struct collocation_points *p = &s->points;
    const struct equation_patches *to = &s->equation.patches;
    const uint32_t patches = p->count + p->num_clusters;
    float *sum = pell_alloc_array(s->ctx, patches, 3 * sizeof(*sum)), *thickness = sum + patches, *weight = sum + 2 * patches;

    if (!sum)
        return PELL_ERR_NOMEM;
    memset(sum, 0, patches * 3 * sizeof(*sum));
    memset(to->wx, 0, patches * sizeof(*to->wx));
    memset(to->wy, 0, patches * sizeof(*to->wy));
    memset(to->wz, 0, patches * sizeof(*to->wz));
    for (size_t i = 0; i < p->num_samples; i++) {
        const struct pell_surface_sample *q = &p->sample[i];
        float light = 0.0f;
        if (p->point_of[i] == COLLOCATION_NONE)
            continue;
        for (int c = 0; c < 3; c++)
            light += s->input->source[i][c];
        for (int k = 0; k < 2; k++) {
            const uint32_t at = k == 0 ? p->point_of[i] : p->count + p->point[p->point_of[i]].cluster;
            to->wx[at] += light * q->direction[0];
            to->wy[at] += light * q->direction[1];
            to->wz[at] += light * q->direction[2];
            sum[at] += light;
            if (s->input->thickness[i] < INFINITY) {
                thickness[at] += q->area * s->input->thickness[i];
                weight[at] += q->area;
            }
        }
    }
    for (uint32_t i = 0; i < patches; i++) {
        const struct pell_vec3 normal = i < p->count ? p->point[i].normal : vec3_normalize(p->cluster[i - p->count].normal);
        const float curvature = i < p->count ? p->point[i].curvature : p->cluster[i - p->count].curvature;
        const float scale = sum[i] > 0.0f ? 1.0f / sum[i] : 0.0f, thick = weight[i] > 0.0f ? thickness[i] / weight[i] : INFINITY;
        float inward;
        struct pell_vec3 w = vec3_mul(vec3(to->wx[i], to->wy[i], to->wz[i]), scale);
        if (!(vec3_dot(w, w) > 1e-6f))
            w = vec3_mul(normal, -1.0f);
        to->wx[i] = w.x;
        to->wy[i] = w.y;
        to->wz[i] = w.z;
        inward = -vec3_dot(w, normal);
        for (int c = 0; c < 3; c++) {
            struct equation_channel *q = &s->equation.channel[c];
            if (!q->active)
                continue;
            if (i < p->count)
                q->point_source[i] = (q->light[i] - q->single[i]) / (double) (1.0f + s->input->slope[c] * fmaxf(1.0f - inward, 0.0f));
            for (int k = 0; k < 2; k++) {
                const float within = 1.0f - expf(-thick / fmaxf(q->depth * inward, 1e-6f));
                const float distance = -q->depth * logf(1.0f - (1.0f - expf(-q->path[k])) * within);
                q->source_depth[k][i] = along_mean(distance, curvature, vec3_dot(w, w), inward);
            }
        }
    }
    pell_free(s->ctx, sum);
    return PELL_OK;
}

/* Adds the part of the profile that diffusion lacks, less what it has in excess, and the surplus of diffuse light for single scattering.
 * All that leaves where the light entered. */
static void add_local_part(const struct solid *s, float slope, struct equation_channel *q)
{
    const struct collocation_points *p = &s->points;
    const struct equation_patches *patches = &s->equation.patches;

    for (uint32_t i = 0; i < p->count; i++) {
        const struct pell_vec3 n = p->point[i].normal;
        const float inward = -(patches->wx[i] * n.x + patches->wy[i] * n.y + patches->wz[i] * n.z), depth = q->kappa * q->depth * inward;
        const float diffuse = q->source_scale *
                              (q->path_weight[0] * expf(-q->path[0] * depth) + q->path_weight[1] * expf(-q->path[1] * depth)) /
                              (1.0f + q->kappa * q->s);
        const float lacking = q->total * (1.0f + slope * (1.0f - inward)) - diffuse;
        q->phi[i] += (double) pell_curvature_single(p->point[i].curvature * q->depth, 1.0f) *
                     ((double) lacking * q->source[i] + (double) q->total * q->single[i]);
    }
}

/* --- Interpolation to samples --------------------------------------------------------------------------------------------------------- */

/* Returns whether samples of one cluster may be interpolated from the points of the other. */
static bool are_neighbours(const struct solid *s, const struct cluster *a, const struct cluster *b)
{
    const struct pell_vec3 d = vec3_sub(a->position, b->position);
    const float within = a->radius + b->radius + (SMOOTH + MAX_OFFSET) * s->points.step;

    return vec3_dot(d, d) <= within * within;
}

static enum pell_result find_neighbours(struct solid *s)
{
    const struct collocation_points *p = &s->points;
    size_t count = 0;

    if (!(s->first_neighbour = pell_alloc_array(s->ctx, (size_t) p->num_clusters + 1, sizeof(*s->first_neighbour))))
        return PELL_ERR_NOMEM;
    for (int fill = 0; fill < 2; fill++) {
        count = 0;
        for (uint32_t k = 0; k < p->num_clusters && !pell_cancelled(s->ctx); k++) {
            s->first_neighbour[k] = (uint32_t) count;
            for (uint32_t j = 0; j < p->num_clusters; j++)
                if (are_neighbours(s, &p->cluster[k], &p->cluster[j])) {
                    if (fill)
                        s->neighbour_cluster[count] = j;
                    count++;
                }
        }
        s->first_neighbour[p->num_clusters] = (uint32_t) count;
        if (!fill && !(s->neighbour_cluster = pell_alloc_array(s->ctx, count, sizeof(*s->neighbour_cluster))))
            return PELL_ERR_NOMEM;
    }
    return pell_cancelled(s->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

/* Weighted sums over points, and first moments in the sample's tangent plane. */
struct moments {
    struct pell_vec3 t, b; /* tangents */
    struct slope_sums at;
    float phi[3][3], entered[3][3], sum[3][3];
};

static inline void add_moments(float sum[3], float w, float x, float y, float value)
{
    sum[0] += w * value;
    sum[1] += w * x * value;
    sum[2] += w * y * value;
}

/* Sum with linearly corrected weights. */
static inline float weighted_sum(const float sum[3], const float slope[2])
{
    return sum[0] + slope[0] * sum[1] + slope[1] * sum[2];
}

/* Adds the points of a cluster to the moments at a sample. */
static void add_cluster(const struct solid *s, const struct cluster *cluster, struct pell_vec3 at, struct pell_vec3 normal,
                        struct moments *a)
{
    const float radius2 = SMOOTH * SMOOTH * s->points.step * s->points.step;

    for (uint32_t j = cluster->first; j < cluster->end; j++) {
        const struct collocation_point *p = &s->points.point[j];
        const struct pell_vec3 d = vec3_sub(p->position, at);
        const float t = fmaxf(1.0f - vec3_dot(d, d) / radius2, 0.0f), w = t * t * fmaxf(vec3_dot(p->normal, normal), 0.0f);
        const float x = vec3_dot(d, a->t), y = vec3_dot(d, a->b);
        if (!(w > 0.0f))
            continue;
        slope_add(&a->at, w, x, y, 0.0f);
        for (int c = 0; c < 3; c++) {
            const struct equation_channel *q = &s->equation.channel[c];
            if (!q->active)
                continue;
            add_moments(a->phi[c], w, x, y, (float) q->phi[j]);
            if (s->input->profile_sum)
                add_moments(a->sum[c], w, x, y, (float) s->method_exitance[c][j]);
            else
                add_moments(a->entered[c], w, x, y, (float) q->light[j]);
        }
    }
}

/* Fraction of a sample's exitance that a half-space would not return of the local light. */
static float depth_fraction(const struct solid *s, size_t i, int c, float exitance)
{
    const struct pell_surface_sample *p = &s->points.sample[i];

    return exitance > 0.0f && p->area > 0.0f ? fmaxf(1.0f - s->equation.channel[c].total * p->power[c] / (p->area * exitance), 0.0f) : 0.0f;
}

/* Interpolates a sample from the nearby points, with weights centred on it as in neighbours.c. */
static void interpolate_sample(const struct solid *s, size_t i)
{
    const struct collocation_points *p = &s->points;
    const struct pell_vec3 at = vec3_load(p->sample[i].position), normal = vec3_load(p->sample[i].normal);
    const uint32_t own_cluster = p->point[p->point_of[i]].cluster;
    struct moments a = { .at = { .one = 0.0f } };
    float slope[2], weight;

    vec3_basis(normal, &a.t, &a.b);
    for (uint32_t k = s->first_neighbour[own_cluster]; k < s->first_neighbour[own_cluster + 1]; k++) {
        const struct cluster *c = &p->cluster[s->neighbour_cluster[k]];
        const struct pell_vec3 far = vec3_sub(c->position, at);
        const float within = c->radius + SMOOTH * p->step;
        if (vec3_dot(far, far) <= within * within)
            add_cluster(s, c, at, normal, &a);
    }
    slope_centre(&a.at, 1.0f / (SMOOTH * p->step), slope);
    weight = a.at.one + slope[0] * a.at.x + slope[1] * a.at.y;
    for (int c = 0; c < 3 && weight > 0.0f; c++) {
        const float phi = fmaxf(weighted_sum(a.phi[c], slope), 0.0f);
        struct indirect_solid_light *out = &s->out[i];
        if (!s->equation.channel[c].active)
            continue;
        out->solved[c] = solved_at(s, i, c);
        out->exitance[c] = phi / weight;
        out->deep[c] = depth_fraction(s, i, c, out->exitance[c]);
        if (s->input->profile_sum) {
            const float sum = weighted_sum(a.sum[c], slope);
            out->gain[c] = sum > 0.0f ? fminf(phi / sum, MAX_GAIN) : MAX_GAIN;
            out->light[c] = fmaxf(phi - out->gain[c] * sum, 0.0f) / weight;
        } else {
            out->entered[c] = fmaxf(weighted_sum(a.entered[c], slope), 0.0f) / weight;
            out->light[c] = out->exitance[c];
        }
    }
}

static void interpolate_chunk(void *arg, int chunk, int worker)
{
    const struct solid *s = arg;
    const size_t first = (size_t) chunk * SAMPLES_PER_TASK;

    (void) worker;
    for (size_t i = first; i < first + SAMPLES_PER_TASK && i < s->points.num_samples; i++)
        if (s->points.point_of[i] != COLLOCATION_NONE)
            interpolate_sample(s, i);
}

/* --- Solid ---------------------------------------------------------------------------------------------------------------------------- */

/* Computes the result of a method that integrates over the whole solid. */
static void method_chunk(void *arg, int chunk, int worker)
{
    const struct solid *s = arg;
    const uint32_t first = (uint32_t) chunk * POINTS_PER_TASK;

    (void) worker;
    for (uint32_t i = first; i < first + POINTS_PER_TASK && i < s->points.count; i++) {
        float position[3], normal[3], result[3];
        vec3_store(s->points.point[i].position, position);
        vec3_store(s->points.point[i].normal, normal);
        indirect_profile_sum_at(s->input->profile_sum, position, normal, result);
        for (int c = 0; c < 3; c++)
            if (s->equation.channel[c].active)
                s->method_exitance[c][i] = (double) result[c];
    }
}

/* Solves for phi of each channel; those that do not converge are deactivated. */
static enum pell_result solve_channels(struct solid *s)
{
    struct equation *e = &s->equation;
    const uint32_t n = s->points.count;

    equation_fill(e);
    if (s->input->profile_sum) {
        double *all = pell_alloc_array(s->ctx, n, 3 * sizeof(*all));
        if (!all)
            return PELL_ERR_NOMEM;
        for (size_t c = 0; c < 3; c++)
            s->method_exitance[c] = all + c * n;
        pell_pool_run(s->pool, (int) ((n + POINTS_PER_TASK - 1) / POINTS_PER_TASK), method_chunk, s);
    }
    for (int c = 0; c < 3; c++) {
        struct equation_channel *q = &e->channel[c];
        if (!q->active)
            continue;
        q->active = equation_solve(e, q);
        if (q->active)
            add_local_part(s, s->input->slope[c], q);
    }
    return PELL_OK;
}

enum pell_result indirect_diffusion_solve(struct pell_context *ctx, struct pell_pool *pool, const struct indirect_solid *solid,
                                          struct indirect_solid_light *out)
{
    const float step = choose_step(solid);
    struct solid *s;
    enum pell_result res = PELL_ERR_NOMEM;

    memset(out, 0, solid->count * sizeof(*out));
    if (!(step > 0.0f))
        return PELL_OK;
    if (!(s = pell_calloc(ctx, 1, sizeof(*s))))
        return PELL_ERR_NOMEM;
    s->ctx = ctx;
    s->pool = pool;
    s->input = solid;
    s->out = out;
    s->equation.ctx = ctx;
    s->equation.pool = pool;
    s->equation.points = &s->points;
    s->equation.near = CLUSTER_DISTANCE * step;
    s->equation.window2 = WINDOW * WINDOW * step * step;
    s->equation.min_distance2 = MIN_DISTANCE * MIN_DISTANCE * step * step;
    PELL_TRY(indirect_collocation_create(ctx, pool, solid->samples, solid->count, &s->points));
    PELL_TRY(indirect_collocation_choose(&s->points, step));
    for (int c = 0; c < 3; c++)
        set_channel(s, c);
    if (s->equation.channel[0].active || s->equation.channel[1].active || s->equation.channel[2].active) {
        PELL_TRY(equation_make(&s->equation));
        PELL_TRY(find_neighbours(s));
        for (int c = 0; c < 3; c++)
            if (s->equation.channel[c].active)
                find_light(s, c);
        PELL_TRY(find_source_directions(s));
        PELL_TRY(solve_channels(s));
        pell_pool_run(pool, (int) ((solid->count + SAMPLES_PER_TASK - 1) / SAMPLES_PER_TASK), interpolate_chunk, s);
    }
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    equation_finish(&s->equation);
    indirect_collocation_finish(&s->points);
    pell_free(ctx, s->method_exitance[0]);
    pell_free(ctx, s->first_neighbour);
    pell_free(ctx, s->neighbour_cluster);
    pell_free(ctx, s);
    return res;
}
