/* SPDX-License-Identifier: MIT
 * multiple.c - see multiple.h. */
#include "methods/layered/multiple.h"

#include "base/base.h"
#include "math/quadrature.h"
#include "math/vec.h"
#include "scene/layers.h"

#include <pellucid/layers.h>

#include <math.h>
#include <string.h>

enum { ANGLES = 48, RADII = 200, MAX_POINTS = 4096 };
#define MERGE_DISTANCE 0.02f /* of x: sets closer than this are merged */

/* --- Single scattering ---------------------------------------------------------------------------------------------------------- */

struct single_channel { /* one channel */
    const struct pell_medium_layers *layers;
    const float *bottoms;
    int channel;
};

/* sigma_s at depth z below the surface, and the optical depth down to there; 0 below the layers. */
static double scattering_at(const struct single_channel *o, double z, double *tau, const struct pell_phase **phase)
{
    double above = 0.0;

    *tau = 0.0;
    for (int i = 0; i < o->layers->count; i++) {
        const struct pell_layer_medium *l = &o->layers->item[i];
        const bool endless = i + 1 == o->layers->count && o->layers->substrate == PELL_SUBSTRATE_LAST;
        if (endless || z < (double) o->bottoms[i]) {
            *tau += l->sigma_t[o->channel] * (z - above);
            *phase = &l->phase[o->channel];
            return l->sigma_s[o->channel];
        }
        *tau += l->sigma_t[o->channel] * ((double) o->bottoms[i] - above);
        above = (double) o->bottoms[i];
    }
    return 0.0;
}

/* Angle and weight of a quadrature over the angles that leave: t = t0 + (pi/2 - t0) s^2, because the transmittance starts like a square
 * root. */
static double angle_of(double eta, double s, double *weight)
{
    const double t0 = eta > 1.0 ? acos(1.0 / eta) : 0.0, width = 0.5 * PELL_PI - t0;

    *weight = 2.0 * width * s;
    return t0 + width * s * s;
}

/* A photon that collides at z = r tan t makes an angle of cosine mu = sin t with the direction from its entry point, as in
 * optics/photon/single.c:
 *     R = 1/r Int sigma_s(z) p(mu) (1 - F(mu)) mu exp(-tau(z) (1 + 1/mu)) dt */
double layered_single_rd(const struct pell_medium_layers *layers, const float *bottoms, int channel, double r)
{
    const struct single_channel o = { layers, bottoms, channel };
    double x[ANGLES], w[ANGLES], sum = 0.0;

    pell_gauss_legendre(ANGLES, x, w);
    for (int i = 0; i < ANGLES; i++) {
        double dt, tau, sigma_s;
        const double t = angle_of(layers->eta, x[i], &dt), mu = sin(t), z = r * mu / fmax(cos(t), 1e-12);
        const struct pell_phase *phase = NULL;
        sigma_s = scattering_at(&o, z, &tau, &phase);
        if (sigma_s > 0.0)
            sum += w[i] * dt * sigma_s * pell_phase_value(phase, mu) * (1.0 - pell_fresnel(1.0 / layers->eta, mu)) * mu *
                   exp(-tau * (1.0 + 1.0 / mu));
    }
    return sum / r;
}

double layered_single_total(const struct pell_medium_layers *layers, const float *bottoms, int channel)
{
    double x[ANGLES], w[ANGLES], sum = 0.0;

    pell_gauss_legendre(ANGLES, x, w);
    for (int i = 0; i < ANGLES; i++) {
        double dt, tau = 0.0, above = 0.0, part = 0.0;
        const double t = angle_of(layers->eta, x[i], &dt), mu = sin(t), slant = 1.0 + 1.0 / mu;
        for (int k = 0; k < layers->count; k++) {
            const struct pell_layer_medium *l = &layers->item[k];
            const bool endless = k + 1 == layers->count && layers->substrate == PELL_SUBSTRATE_LAST;
            const double thick = endless ? (double) INFINITY : fmax((double) bottoms[k] - above, 0.0);
            const double sigma_t = l->sigma_t[channel], step = sigma_t > 0.0 ? sigma_t * thick : 0.0;
            if (sigma_t > 0.0)
                part += l->sigma_s[channel] * pell_phase_value(&l->phase[channel], mu) * exp(-tau * slant) * -expm1(-step * slant) /
                        (sigma_t * slant);
            tau += step;
            above = fmax((double) bottoms[k], above);
        }
        sum += w[i] * dt * cos(t) * part * (1.0 - pell_fresnel(1.0 / layers->eta, mu));
    }
    return 2.0 * PELL_PI * sum;
}

/* --- Multiple scattering -------------------------------------------------------------------------------------------------------- */

struct sums { /* over all sets */
    struct pell_gaussians item[LAYERED_SETS];
};

/* Profile of the layers, in the lengths of the material, which `strength` scales; false: it returns no light. */
static bool layers_profile(const struct pell_material *m, const struct pell_frame_material *frame, const float *bottoms, double strength,
                           int channel, struct pell_profile *out)
{
    struct pell_stack stack;
    double deep[PELL_LAYERS_MOST];

    if (m->num_layers == 0) {
        *out = frame->profile[channel];
        return pell_profile_total(out) > 0.0;
    }
    for (int i = 0; i < m->num_layers; i++)
        deep[i] = (double) bottoms[i] / strength;
    pell_scene_layers_stack(m, deep, &stack);
    return pell_stack_profile(&stack, channel, PELL_STACK_R_PLUS, out, NULL) == PELL_OK && pell_profile_total(out) > 0.0;
}

/* The multiple-scattering part of a profile: its excess over single scattering, scaled to the remaining total. */
static void subtract_single(const struct pell_medium_layers *layers, const float *bottoms, double strength, int channel,
                            struct pell_profile *profile)
{
    double r[RADII], R[RADII], least = pell_profile_sample(profile, 1e-5), most = pell_profile_sample(profile, 1.0 - 1e-6), rest, total;
    const double single = layered_single_total(layers, bottoms, channel);
    struct pell_profile left;

    rest = pell_profile_total(profile) - single;
    if (!(rest > 1e-6) || !(least > 0.0) || !(most > least)) {
        memset(profile, 0, sizeof(*profile));
        return;
    }
    for (int i = 0; i < RADII; i++) {
        r[i] = least * pow(most / least, i / (RADII - 1.0));
        R[i] = pell_profile_eval(profile, r[i]) - strength * strength * layered_single_rd(layers, bottoms, channel, strength * r[i]);
        R[i] = fmax(R[i], 0.0);
    }
    if (pell_profile_from_table(r, R, RADII, &left, NULL) != PELL_OK || !((total = pell_profile_total(&left)) > 0.0)) {
        memset(profile, 0, sizeof(*profile));
        return;
    }
    for (int i = 0; i < RADII; i++)
        R[i] *= rest / total;
    if (pell_profile_from_table(r, R, RADII, profile, NULL) != PELL_OK)
        memset(profile, 0, sizeof(*profile));
}

/* Sum of Gaussians of one set, with its own variances; count 0: no light. */
static bool solve_set(const struct pell_material *m, const struct pell_medium_layers *layers, const struct pell_frame_material *frame,
                      const float *bottoms, struct pell_profile profiles[3], struct pell_gaussians *out)
{
    static const struct pell_fit_params params = { .count = LAYERED_GAUSSIANS };
    const double strength = fmin(fmax((double) m->strength, 1.0 / 1024.0), 1.0);

    for (int c = 0; c < 3; c++) {
        if (layers_profile(m, frame, bottoms, strength, c, &profiles[c]))
            subtract_single(layers, bottoms, strength, c, &profiles[c]);
        else
            memset(&profiles[c], 0, sizeof(profiles[c]));
    }
    if (pell_fit_profiles(profiles, &params, out, NULL) != PELL_OK)
        return false;
    for (int i = 0; i < out->count; i++) {
        out->variance[i] *= strength * strength;
        for (int c = 0; c < 3; c++)
            out->weight[i][c] /= frame->white ? fmax(pell_profile_total(&frame->profile[c]), 1e-9) : 1.0;
    }
    return true;
}

/* All sets with the same variances: each Gaussian is split between its two neighbours, which preserves energy and second moment. */
static void share_variances(const struct sums *sums, struct layered_multiple *out)
{
    double variance[LAYERED_SETS * PELL_GAUSSIANS_MAX], weight[LAYERED_SETS * PELL_GAUSSIANS_MAX];
    size_t count = 0;

    for (int s = 0; s < out->sets; s++)
        for (int i = 0; i < sums->item[s].count; i++, count++) {
            const double *w = sums->item[s].weight[i];
            variance[count] = sums->item[s].variance[i];
            weight[count] = fmax(w[0], fmax(w[1], w[2])) > 1e-4 ? 1.0 : 0.0;
        }
    if (count == 0 || pell_gaussian_set_targets(variance, weight, count, out->variance, LAYERED_GAUSSIANS) != PELL_OK) {
        out->sets = 0;
        return;
    }
    for (int s = 0; s < out->sets; s++)
        for (int c = 0; c < 3; c++) {
            double from[PELL_GAUSSIANS_MAX], to[LAYERED_GAUSSIANS];
            for (int i = 0; i < sums->item[s].count; i++)
                from[i] = sums->item[s].weight[i][c];
            pell_gaussian_set_reduce(sums->item[s].variance, from, (size_t) sums->item[s].count, out->variance, LAYERED_GAUSSIANS, to);
            for (int i = 0; i < LAYERED_GAUSSIANS; i++)
                out->weight[s][i][c] = (float) to[i];
        }
}

/* --- Sets of depths ------------------------------------------------------------------------------------------------------------- */

static void bend_depths(const struct layered_multiple *m, const float *bottoms, float *x)
{
    for (int i = 0; i < m->layers; i++)
        x[i] = m->bend[i] * fminf(bottoms[i], 1e18f) / (1.0f + m->bend[i] * fminf(bottoms[i], 1e18f));
}

static float distance(const struct layered_multiple *m, const float *a, const float *b)
{
    float sum = 0.0f;

    for (int i = 0; i < m->layers; i++)
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrtf(sum);
}

/* Bottoms at up to MAX_POINTS points of the meshes that have the material, distributed over their triangles. */
static size_t sample_bottoms(const struct pell_scene *scene, int material, const struct pell_medium_layers *layers, float *bottoms)
{
    size_t triangles = 0, count = 0, before = 0;

    for (size_t i = 0; i < scene->num_meshes; i++)
        triangles += scene->meshes[i].material == material ? scene->meshes[i].num_triangles : 0;
    for (size_t i = 0; i < scene->num_meshes && triangles > 0; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        if (mesh->material != material)
            continue;
        for (; count < MAX_POINTS && (size_t) ((double) count / MAX_POINTS * (double) triangles) < before + mesh->num_triangles; count++) {
            const size_t t = (size_t) ((double) count / MAX_POINTS * (double) triangles) - before;
            double u = fmod(0.7548776662466927 * (double) (count + 1), 1.0), v = fmod(0.5698402909980532 * (double) (count + 1), 1.0);
            if (u + v > 1.0) {
                u = 1.0 - u;
                v = 1.0 - v;
            }
            pell_medium_layers_depths(layers, mesh, (uint32_t) t, (float) u, (float) v, bottoms + count * (size_t) layers->count);
        }
        before += mesh->num_triangles;
    }
    return count;
}

/* Chooses the points that are farthest from each other, one per set; returns their indices. */
static void choose_sets(const float *x, size_t count, struct layered_multiple *m, size_t *chosen)
{
    const size_t n = (size_t) m->layers;

    m->sets = 0;
    for (size_t next = 0; m->sets < LAYERED_SETS;) {
        float farthest = 0.0f;
        chosen[m->sets] = next;
        memcpy(m->at[m->sets++], x + next * n, n * sizeof(*x));
        for (size_t i = 0; i < count; i++) {
            float nearest = INFINITY;
            for (int s = 0; s < m->sets; s++)
                nearest = fminf(nearest, distance(m, x + i * n, m->at[s]));
            if (nearest > farthest) {
                farthest = nearest;
                next = i;
            }
        }
        if (farthest <= MERGE_DISTANCE)
            break;
    }
}

/* Weights that interpolate between sets: linear combinations of distances to the sets and a constant, which in one dimension are piecewise
 * linear. The columns of the inverse of [distances, 1; 1, 0] come from Gauss-Jordan elimination with pivoting. */
static void make_cardinals(struct layered_multiple *m)
{
    enum { SIZE = LAYERED_SETS + 1 };
    const int n = m->sets + 1;
    double a[SIZE][2 * SIZE] = { { 0 } };

    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++)
            a[i][j] = i < m->sets && j < m->sets ? (double) distance(m, m->at[i], m->at[j]) : i == j ? 0.0 : 1.0;
        a[i][n + i] = 1.0;
    }
    for (int k = 0; k < n; k++) {
        int pivot = k;
        for (int i = k + 1; i < n; i++)
            pivot = fabs(a[i][k]) > fabs(a[pivot][k]) ? i : pivot;
        for (int j = 0; j < 2 * n; j++) {
            const double swapped = a[k][j];
            a[k][j] = a[pivot][j];
            a[pivot][j] = swapped;
        }
        for (int j = 2 * n - 1; j >= 0; j--)
            a[k][j] /= a[k][k];
        for (int i = 0; i < n; i++)
            for (int j = 2 * n - 1; i != k && j >= k; j--)
                a[i][j] -= a[i][k] * a[k][j];
    }
    for (int i = 0; i < n; i++)
        for (int s = 0; s < m->sets; s++)
            m->cardinal[i][s] = (float) a[i][n + s];
}

void layered_multiple_blend(const struct layered_multiple *m, const float *bottoms, float *fraction)
{
    float x[PELL_LAYERS_MOST];

    if (m->sets == 1) {
        fraction[0] = 1.0f;
        return;
    }
    bend_depths(m, bottoms, x);
    for (int s = 0; s < m->sets; s++)
        fraction[s] = m->cardinal[m->sets][s];
    for (int t = 0; t < m->sets; t++) {
        const float d = distance(m, x, m->at[t]);
        for (int s = 0; s < m->sets; s++)
            fraction[s] += d * m->cardinal[t][s];
    }
}

enum pell_result layered_multiple_make(struct pell_context *ctx, const struct pell_scene *scene, int material,
                                       const struct pell_medium_layers *layers, const struct pell_frame_material *frame,
                                       struct layered_multiple *out)
{
    const struct pell_material *m = &scene->materials[material];
    const size_t n = (size_t) layers->count;
    float *bottoms = pell_alloc_array(ctx, MAX_POINTS * n, sizeof(*bottoms)), *x = pell_alloc_array(ctx, MAX_POINTS * n, sizeof(*x));
    struct pell_profile *profiles = pell_alloc_array(ctx, 3, sizeof(*profiles));
    struct sums *sums = pell_zalloc(ctx, sizeof(*sums));
    size_t chosen[LAYERED_SETS], count;
    enum pell_result res = PELL_ERR_NOMEM;

    memset(out, 0, sizeof(*out));
    if (!bottoms || !x || !profiles || !sums)
        goto fail;
    out->layers = layers->count;
    for (int i = 0; i < layers->count; i++) {
        const struct pell_layer_medium *l = &layers->item[i];
        double bend = 0.0;
        for (int c = 0; c < 3; c++) { /* the light goes down and back up; without absorption the returning light still decreases only as
                                       * 1/depth */
            const double reduced = l->sigma_t[c] - l->sigma_s[c] * pell_phase_mean_cosine(&l->phase[c]);
            bend += (2.0 * sqrt(3.0 * (l->sigma_t[c] - l->sigma_s[c]) * reduced) + 0.125 * reduced) / 3.0;
        }
        out->bend[i] = (float) bend;
    }
    count = sample_bottoms(scene, material, layers, bottoms);
    for (size_t i = 0; i < count; i++)
        bend_depths(out, bottoms + i * n, x + i * n);
    if (count > 0)
        choose_sets(x, count, out, chosen);
    res = PELL_ERR_INVALID;
    for (int s = 0; s < out->sets; s++)
        if (!solve_set(m, layers, frame, bottoms + chosen[s] * n, profiles, &sums->item[s])) {
            pell_error(ctx, res, m->name, "set multiple=off", "no sum of %d Gaussians fits what these layers layers_profile",
                       LAYERED_GAUSSIANS);
            goto fail;
        }
    share_variances(sums, out);
    if (out->sets > 1)
        make_cardinals(out);
    res = PELL_OK;

fail:
    pell_free(ctx, sums);
    pell_free(ctx, profiles);
    pell_free(ctx, x);
    pell_free(ctx, bottoms);
    return res;
}
