/* SPDX-License-Identifier: MIT
 * stacks.h - stacks of layers shared by several tests. */
#ifndef PELL_TEST_STACKS_H
#define PELL_TEST_STACKS_H

#include "oracle.h"

#define RP PELL_STACK_R_PLUS
#define TP PELL_STACK_T_PLUS
#define RM PELL_STACK_R_MINUS
#define TM PELL_STACK_T_MINUS

static inline struct pell_medium_layer layer_of(double sigma_a, double sigma_s_reduced, double eta, double thickness)
{
    struct pell_medium_layer y = { .eta = eta, .thickness = thickness };
    for (int c = 0; c < 3; c++) {
        y.sigma_a[c] = sigma_a;
        y.sigma_s_reduced[c] = sigma_s_reduced;
    }
    return y;
}

static inline struct pell_stack slab_of(double sigma_a, double sigma_s_reduced, double eta, double thickness)
{
    struct pell_stack s = { .count = 1, .fresnel = PELL_FRESNEL_POLY4 };
    s.layer[0] = layer_of(sigma_a, sigma_s_reduced, eta, thickness);
    return s;
}

static inline void put_below(struct pell_stack *s, struct pell_medium_layer layer)
{
    s->layer[s->count++] = layer;
}

/* Donner and Jensen 2005's skin in the oracle's reading (1/cm); two layers: the upper dermis has no bottom. */
static inline struct pell_stack skin_of(int layers)
{
    static const double sa[3][3] = { { 0.21, 0.21, 0.50 }, { 0.016, 0.019, 0.030 }, { 0.0085, 0.1, 2.5 } };
    static const double ss[3][3] = { { 4.8, 6.0, 6.5 }, { 3.2, 4.0, 4.6 }, { 0.45, 0.47, 0.48 } }, d[3] = { 0.25, 0.20, INFINITY };
    struct pell_stack s = { .count = layers, .fresnel = PELL_FRESNEL_POLY4 };
    for (int i = 0; i < layers && i < 3; i++) {
        memcpy(s.layer[i].sigma_a, sa[i], sizeof(sa[i]));
        memcpy(s.layer[i].sigma_s_reduced, ss[i], sizeof(ss[i]));
        s.layer[i].eta = 1.4;
        s.layer[i].thickness = i + 1 == layers ? INFINITY : d[i];
    }
    return s;
}

/* The stack in reverse order. */
static inline struct pell_stack mirrored(const struct pell_stack *s)
{
    struct pell_stack m = *s;
    for (int i = 0; i < s->count; i++) {
        m.layer[i] = s->layer[s->count - 1 - i];
        m.A[i][0] = s->A[s->count - 1 - i][1];
        m.A[i][1] = s->A[s->count - 1 - i][0];
    }
    for (int i = 0; i <= s->count; i++)
        m.roughness[i] = s->roughness[s->count - i];
    m.eta_above = s->eta_below;
    m.eta_below = s->eta_above;
    return m;
}

/* Deterministic pseudo-random numbers in (0, 1). */
static inline double next_random(uint64_t *state)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return ((double) (*state >> 11) + 0.5) / 9007199254740992.0;
}

/* A random valid stack: coefficients over `decades` around 1/mm, 1 to 6 layers, with or without absorption. */
static inline struct pell_stack random_stack(uint64_t *state, double decades)
{
    struct pell_stack s = { .count = 1 + (int) (6.0 * next_random(state)), .fresnel = PELL_FRESNEL_EXACT };
    for (int i = 0; i < s.count; i++) {
        double sa = pow(10.0, decades * (next_random(state) - 0.7)), ss = pow(10.0, decades * (next_random(state) - 0.5));
        if (next_random(state) < 0.15)
            sa = 0.0;
        const double thickness = pow(10.0, decades * (next_random(state) - 0.5)), eta = 1.0 + next_random(state);
        s.layer[i] =
            layer_of(sa, ss, eta, thickness); /* separate statements: compilers differ in the order in which they evaluate arguments */
        s.roughness[i] = next_random(state) < 0.2 ? next_random(state) : 0.0;
    }
    if (next_random(state) < 0.3)
        s.layer[s.count - 1].thickness = INFINITY;
    return s;
}

#endif
