/* SPDX-License-Identifier: MIT
 *
 * multipole.c - the diffusion multipole of a slab: Donner and Jensen 2005, "Light Diffusion in Multi-Layered Translucent Materials". The
 * poles' geometric series sum in the Hankel domain, where a pole at depth z is exp(-z kappa)/2, kappa^2 = sigma_tr^2 + s^2:
 *     R+^ = alpha' cosh(zb0 kappa) sinh((d + zbd - l) kappa)/sinh(L kappa),   L = d + zb0 + zbd
 *     T+^ = alpha' cosh(zbd kappa) sinh((l + zb0) kappa)/sinh(L kappa)        and R-, T- with zb0 and zbd swapped. */
#include "optics/layers/multipole.h"

#include "math/vec.h"
#include "optics/medium/dipole.h"

#include <math.h>

static bool in_range(int layer, int channel, const char *field, double value, double min, double max, struct pell_stack_fault *fault)
{
    if (value >= min && value <= max)
        return true;
    if (fault)
        *fault = (struct pell_stack_fault) { layer, channel, field, value, min, max };
    return false;
}

static double or_one(double eta)
{
    return eta == 0.0 ? 1.0 : eta;
}

/* Ratio of a layer's index to that on its other side: side 0 top, 1 bottom. */
static double relative_eta(const struct pell_stack *s, int i, int side)
{
    const double other =
        side == 0 ? (i > 0 ? s->layer[i - 1].eta : or_one(s->eta_above)) : (i + 1 < s->count ? s->layer[i + 1].eta : or_one(s->eta_below));
    return s->layer[i].eta / other;
}

bool pell_stack_valid(const struct pell_stack *s, struct pell_stack_fault *fault)
{
    if (fault)
        *fault = (struct pell_stack_fault) { .layer = -1, .channel = -1 };
    if (!in_range(-1, -1, "count", s->count, 1, PELL_LAYERS_MAX, fault))
        return false;
    if (!in_range(-1, -1, "fresnel", (double) s->fresnel, PELL_FRESNEL_EXACT, PELL_FRESNEL_POLY4, fault) ||
        !in_range(-1, -1, "eta_above", or_one(s->eta_above), PELL_ETA_MIN, PELL_ETA_MAX, fault) ||
        !in_range(-1, -1, "eta_below", or_one(s->eta_below), PELL_ETA_MIN, PELL_ETA_MAX, fault))
        return false;
    for (int i = 0; i < s->count; i++) {
        const struct pell_medium_layer *y = &s->layer[i];
        for (int c = 0; c < 3; c++)
            if (!in_range(i, c, "sigma_a", y->sigma_a[c], 0.0, PELL_SIGMA_MAX, fault) ||
                !in_range(i, c, "sigma_s_reduced", y->sigma_s_reduced[c], 0.0, PELL_SIGMA_MAX, fault) ||
                !in_range(i, c, "sigma_a + sigma_s_reduced", y->sigma_a[c] + y->sigma_s_reduced[c], PELL_SIGMA_T_MIN, 2.0 * PELL_SIGMA_MAX,
                          fault) ||
                !in_range(i, c, "g", y->g[c], -PELL_G_MAX, PELL_G_MAX, fault))
                return false;
        if (!in_range(i, -1, "eta", y->eta, PELL_ETA_MIN, PELL_ETA_MAX, fault))
            return false;
        const bool half_space = i + 1 == s->count && isinf(y->thickness) && y->thickness > 0.0;
        if (!half_space && !in_range(i, -1, "thickness", y->thickness, PELL_THICKNESS_MIN, PELL_THICKNESS_MAX, fault))
            return false;
    }
    for (int i = 0; i < s->count; i++) {
        if (!in_range(i, -1, "eta / eta above it", relative_eta(s, i, 0), PELL_ETA_MIN, PELL_ETA_MAX, fault) ||
            !in_range(i, -1, "eta / eta below it", relative_eta(s, i, 1), PELL_ETA_MIN, PELL_ETA_MAX, fault) ||
            !in_range(i, -1, "roughness", s->roughness[i], 0.0, 1.0, fault))
            return false;
        if ((s->A[i][0] != 0.0 && !in_range(i, -1, "A[0]", s->A[i][0], 1.0, 1e6, fault)) ||
            (s->A[i][1] != 0.0 && !in_range(i, -1, "A[1]", s->A[i][1], 1.0, 1e6, fault)))
            return false;
    }
    return in_range(s->count, -1, "roughness", s->roughness[s->count], 0.0, 1.0, fault);
}

enum pell_result pell_stack_layer(const struct pell_stack *s, int i, struct pell_stack *out)
{
    if (!s || !out)
        return PELL_ERR_INVALID;

    *out = (struct pell_stack) { 0 };
    if (!pell_stack_valid(s, NULL) || i < 0 || i >= s->count)
        return PELL_ERR_INVALID;
    out->count = 1;
    out->layer[0] = s->layer[i];
    out->eta_above = i > 0 ? s->layer[i - 1].eta : or_one(s->eta_above);
    out->eta_below = i + 1 < s->count ? s->layer[i + 1].eta : or_one(s->eta_below);
    out->fresnel = s->fresnel;
    for (int side = 0; side < 2; side++) {
        out->roughness[side] = s->roughness[i + side];
        out->A[0][side] = s->A[i][side];
    }
    return PELL_OK;
}

static double boundary(const struct pell_stack *s, int i, int side)
{
    if (s->A[i][side] > 0.0)
        return s->A[i][side];
    return pell_boundary_A(relative_eta(s, i, side), s->fresnel, s->roughness[i + side]);
}

/* T^ of light entering on a side falls (or grows) as exp(-gap s). */
static double gap_of(const struct pell_multipole_slab *y, int side)
{
    return y->clear[side] ? 0.0 : y->d - y->l;
}

/* Checks the limits of thin layers, and finds how fast the transforms of the stack fall. */
static void find_limits(struct pell_slabs *p)
{
    double thickness = 0.0;
    bool grows = false;

    for (int i = 0; i < p->count; i++)
        thickness += p->slab[i].d;
    p->reach_r = p->reach_t = INFINITY;
    for (int side = 0; side < (isinf(thickness) ? 1 : 2); side++) {
        double there = 0.0, there_and_back = 0.0; /* over the layers so far */
        for (int k = 0; k < p->count; k++) {
            const struct pell_multipole_slab *y = &p->slab[side ? p->count - 1 - k : k];
            if (!y->clear[side]) {
                p->reach_r = fmin(p->reach_r, y->l + there_and_back);
                grows |= y->l + there_and_back < 0.5 * y->l;
            }
            there += gap_of(y, side);
            there_and_back += gap_of(y, 0) + gap_of(y, 1);
        }
        p->reach_t = fmin(p->reach_t, there);
    }
    /* Growing factors must not overflow at the highest frequency, 45 over the shorter reach, however much others fall there. */
    double growth = 0.0;
    int growing = 0;
    for (int i = 0; i < p->count; i++)
        growing += p->slab[i].l > p->slab[i].d;
    for (int i = 0; i < p->count; i++)
        p->slab[i].growth_max = 300.0 / (growing > 0 ? growing : 1);
    for (int i = 0; i < p->count; i++)
        growth += fmax(0.0, p->slab[i].l - p->slab[i].d);
    grows |= growth * 45.0 > 300.0 * (isinf(thickness) ? p->reach_r : fmin(p->reach_r, fmax(p->reach_t, thickness / 16.0)));
    if (grows) {
        p->flags |= PELL_STACK_WIDENED;
        p->reach_r = INFINITY;
        p->reach_t = 0.0;
        for (int i = 0; i < p->count; i++) {
            struct pell_multipole_slab *y = &p->slab[i];
            y->straight = y->l > y->d;
            if (!y->clear[0] || !y->clear[1])
                p->reach_r = fmin(p->reach_r, y->l);
            if (y->d > y->l)
                p->reach_t += y->d - y->l;
        }
    }
    if (!(p->reach_r < INFINITY))
        p->reach_r = thickness; /* nothing is reflected */
    if (!isinf(thickness) && p->reach_t < thickness / 16.0) {
        p->flags |= PELL_STACK_WIDENED;
        p->widen = thickness / 16.0 - p->reach_t;
        p->reach_t = thickness / 16.0;
    }
}

enum pell_result pell_slabs_prepare(const struct pell_stack *s, int channel, struct pell_slabs *out)
{
    *out = (struct pell_slabs) { 0 };
    if (channel < 0 || channel > 2 || !pell_stack_valid(s, NULL))
        return PELL_ERR_INVALID;
    out->count = s->count;
    out->shortest = INFINITY;
    for (int i = 0; i < s->count; i++) {
        const struct pell_medium_layer *m = &s->layer[i];
        struct pell_multipole_slab *y = &out->slab[i];
        const double sigma_t = m->sigma_a[channel] + m->sigma_s_reduced[channel];

        y->albedo = m->sigma_s_reduced[channel] / sigma_t;
        y->sigma_tr = sqrt(3.0 * m->sigma_a[channel] * sigma_t);
        y->l = 1.0 / sigma_t;
        y->d = m->thickness;
        for (int side = 0; side < 2; side++) {
            y->zb[side] = boundary(s, i, side) * 2.0 / 3.0 * y->l; /* 2 A D */
            y->scale[side] = 1.0;
            y->growth_max = 300.0;
        }
        out->shortest = fmin(out->shortest, y->l);
        out->scale += fmin(y->d, 1.0 / y->sigma_tr) + y->l + y->zb[0] + y->zb[1];
        if (isinf(y->d)) {
            if (!(y->sigma_tr * y->l > 1e-4)) /* without absorption there is no longest length: R falls as r^-3 */
                out->scale = fmax(out->scale, 1e4 * y->l);
            else
                out->scale = fmax(out->scale, 1.0 / y->sigma_tr);
            continue;
        }
        if (y->l > y->d)
            out->flags |= PELL_STACK_THIN;
        else if (y->d - y->l > 0.0)
            out->shortest = fmin(out->shortest, y->d - y->l);
        for (int side = 0; side < 2; side++) {
            const double zb = y->zb[1 - side], bound = y->albedo * cosh(zb * y->sigma_tr);
            y->clear[side] = y->l >= y->d + zb;
            if (y->clear[side]) {
                y->transmittance[side] = 1.0 - (1.0 - fmin(bound, 1.0)) * y->d / (y->l - zb);
                out->flags |= PELL_STACK_CLEAR;
            }
        }
        if (y->l > y->d) {
            const struct pell_response all = pell_slab_response(y, 0.0);
            for (int side = 0; side < 2; side++)
                y->scale[side] = 1.0 / fmax(1.0, all.r[side] + all.t[side]);
        }
    }
    find_limits(out);
    return PELL_OK;
}

/* (1 - exp(-2 a kappa))/(1 - exp(-2 b kappa)), b > 0, also for kappa = 0. */
static double decay_ratio(double a, double b, double kappa)
{
    return kappa * b > 1e-200 ? expm1(-2.0 * a * kappa) / expm1(-2.0 * b * kappa) : a / b;
}

struct pell_response pell_slab_response(const struct pell_multipole_slab *y, double s)
{
    const double kappa = sqrt(y->sigma_tr * y->sigma_tr + s * s);
    struct pell_response f = { { 0 } };

    if (isinf(y->d)) {
        f.r[0] = 0.5 * y->albedo * exp(-y->l * kappa) * (1.0 + exp(-2.0 * y->zb[0] * kappa));
        return f;
    }
    const double L = y->d + y->zb[0] + y->zb[1], gap = y->d - y->l;
    const double enter = 0.5 * y->albedo * exp(-y->l * kappa);
    const double leave = 0.5 * y->albedo * exp(fmin(-gap * (y->straight ? y->sigma_tr : kappa), y->growth_max));
    for (int side = 0; side < 2; side++) {
        if (y->clear[side]) {
            f.t[side] = y->transmittance[side];
            continue;
        }
        const double near = y->zb[side], far = y->zb[1 - side];
        f.r[side] = y->scale[side] * enter * (1.0 + exp(-2.0 * near * kappa)) * decay_ratio(gap + far, L, kappa);
        f.t[side] = y->scale[side] * leave * (1.0 + exp(-2.0 * far * kappa)) * decay_ratio(y->l + near, L, kappa);
    }
    return f;
}

struct pell_response pell_response_add(const struct pell_response *a, const struct pell_response *b)
{
    const double series = 1.0 / (1.0 - b->r[0] * a->r[1]);
    return (struct pell_response) {
        .r = { a->r[0] + a->t[0] * b->r[0] * a->t[1] * series, b->r[1] + b->t[1] * a->r[1] * b->t[0] * series },
        .t = { a->t[0] * b->t[0] * series, b->t[1] * a->t[1] * series },
    };
}

struct pell_response pell_slabs_response(const struct pell_slabs *p, double s)
{
    struct pell_response sum = pell_slab_response(&p->slab[0], s);
    for (int i = 1; i < p->count; i++) {
        const struct pell_response next = pell_slab_response(&p->slab[i], s);
        sum = pell_response_add(&sum, &next);
    }
    if (p->widen > 0.0) {
        const double sigma = p->slab[0].sigma_tr, fall = exp(-p->widen * (sqrt(sigma * sigma + s * s) - sigma));
        sum.t[0] *= fall;
        sum.t[1] *= fall;
    }
    return sum;
}

void pell_response_store(const struct pell_response *f, double out[PELL_STACK_PARTS])
{
    out[PELL_STACK_R_PLUS] = f->r[0];
    out[PELL_STACK_T_PLUS] = f->t[0];
    out[PELL_STACK_R_MINUS] = f->r[1];
    out[PELL_STACK_T_MINUS] = f->t[1];
}

void pell_stack_of_medium(const struct pell_medium *medium, double thickness_mm, struct pell_stack *out)
{
    *out = (struct pell_stack) { .count = 1 };
    for (int c = 0; c < 3; c++) {
        out->layer[0].sigma_a[c] = medium->sigma_a[c];
        out->layer[0].sigma_s_reduced[c] = medium->sigma_s_reduced[c];
    }
    out->layer[0].eta = medium->eta;
    out->layer[0].thickness = thickness_mm;
}

enum pell_result pell_stack_totals(const struct pell_stack *stack, int channel, double out[PELL_STACK_PARTS], unsigned *flags)
{
    if (!stack || !out)
        return PELL_ERR_INVALID;

    struct pell_slabs slabs;
    const enum pell_result res = pell_slabs_prepare(stack, channel, &slabs);

    for (int i = 0; i < PELL_STACK_PARTS; i++)
        out[i] = 0.0;
    if (flags)
        *flags = slabs.flags;
    if (res != PELL_OK)
        return res;
    const struct pell_response f = pell_slabs_response(&slabs, 0.0);
    pell_response_store(&f, out);
    return PELL_OK;
}

enum pell_result pell_stack_transforms(const struct pell_stack *stack, int channel, double s, double out[PELL_STACK_PARTS])
{
    if (!stack || !out)
        return PELL_ERR_INVALID;

    struct pell_slabs slabs;
    const enum pell_result res = pell_slabs_prepare(stack, channel, &slabs);

    for (int i = 0; i < PELL_STACK_PARTS; i++)
        out[i] = 0.0;
    if (res != PELL_OK)
        return res;
    if (!(s >= 0.0 && s <= 1e150))
        return PELL_ERR_INVALID;
    const struct pell_response f = pell_slabs_response(&slabs, s);
    pell_response_store(&f, out);
    return PELL_OK;
}

enum pell_result pell_slab_poles(const struct pell_stack *stack, int channel, enum pell_stack_part part, double r_mm, double tolerance,
                                 int dipoles_max, double *out, int *dipoles)
{
    if (!stack || !out)
        return PELL_ERR_INVALID;

    struct pell_slabs p;
    const enum pell_result res = pell_slabs_prepare(stack, channel, &p);

    *out = 0.0;
    if (dipoles)
        *dipoles = 0;
    if (res != PELL_OK)
        return res;
    if (p.count != 1 || (int) part < 0 || part >= PELL_STACK_PARTS || !(fabs(r_mm) <= 1e100) || !(tolerance >= 1e-14 && tolerance <= 1.0) ||
        dipoles_max < 1 || dipoles_max > 100001)
        return PELL_ERR_INVALID;
    const struct pell_multipole_slab *y = &p.slab[0];
    if (y->l >= y->d) /* a pole on the far side itself diverges there */
        return PELL_ERR_UNSUPPORTED;
    const int side = part == PELL_STACK_R_MINUS || part == PELL_STACK_T_MINUS;
    const bool transmittance = part == PELL_STACK_T_PLUS || part == PELL_STACK_T_MINUS;
    if (isinf(y->d)) {
        if (part == PELL_STACK_R_PLUS)
            *out = y->albedo / (4.0 * PELL_PI) *
                   (pell_pole_value(y->l, y->sigma_tr, r_mm) + pell_pole_value(y->l + 2.0 * y->zb[0], y->sigma_tr, r_mm));
        if (dipoles)
            *dipoles = 1;
        return PELL_OK;
    }
    const double period = 2.0 * (y->d + y->zb[0] + y->zb[1]), real = y->l, image = -y->l - 2.0 * y->zb[side];
    double sum = 0.0;
    int n = 0;
    for (;; n++) {
        double pair = 0.0;
        for (int i = n; i >= -n; i -= n > 0 ? 2 * n : 1) { /* n, then -n */
            const double zr = i * period + real, zv = i * period + image;
            pair += transmittance ? pell_pole_value(y->d - zr, y->sigma_tr, r_mm) - pell_pole_value(y->d - zv, y->sigma_tr, r_mm)
                                  : pell_pole_value(zr, y->sigma_tr, r_mm) - pell_pole_value(zv, y->sigma_tr, r_mm);
        }
        sum += pair;
        /* Pairs fall as n^-3 at worst, once n is large compared with r: the remainder is less than n/2 of the last. */
        const bool far = n > 0 && n * period > fabs(r_mm);
        if ((far && fabs(pair) * fmax(1.0, 0.5 * n) <= tolerance * fabs(sum)) || 2 * n + 3 > dipoles_max)
            break;
    }
    *out = y->albedo / (4.0 * PELL_PI) * sum;
    if (dipoles)
        *dipoles = 2 * n + 1;
    return PELL_OK;
}
