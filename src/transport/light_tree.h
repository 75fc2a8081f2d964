/* SPDX-License-Identifier: MIT
 *
 * light_tree.h - surface samples with their irradiance, and an octree over them: a node represents its subtree from a distance.
 */
#ifndef PELL_LIGHT_TREE_H
#define PELL_LIGHT_TREE_H

#include <pellucid/context.h>

#include <stddef.h>
#include <stdint.h>

struct pell_surface_sample {
    float position[3], normal[3];
    float area;         /* mm^2 */
    float curvature;    /* mean, 1/mm */
    float power[3];     /* E A, W per m^2 times mm^2 */
    float deep[3];      /* the part of it that goes into the depth, where the profile is not all of its transport */
    float direction[3]; /* mean refracted direction of that light, not unit; 0: unknown */
};

struct pell_light_node {
    float centre[3]; /* mean position of the samples, weighted by their light */
    float area;      /* mm^2 */
    float low[3];
    uint32_t next; /* node after its subtree */
    float high[3];
    uint32_t first; /* index of its first sample */
    float power[3], deep[3];
    uint32_t count;             /* number of samples in a leaf; 0: inner node, followed by its children */
    float normal[3], curvature; /* means, weighted by light */
    float direction[3];         /* mean, weighted by light */
};

struct pell_light_tree {
    struct pell_context *ctx;
    struct pell_surface_sample *samples; /* in the tree's order */
    size_t num_samples;
    struct pell_light_node *nodes;
    size_t num_nodes;
};

/* Takes ownership of `samples`, in any order, also on failure. */
PELL_NODISCARD enum pell_result pell_light_tree_make(struct pell_context *ctx, struct pell_surface_sample *samples, size_t num_samples,
                                                     struct pell_light_tree *tree);
void pell_light_tree_finish(struct pell_light_tree *tree);

/* A node as a single sample. */
static inline struct pell_surface_sample pell_light_node_sample(const struct pell_light_node *n)
{
    return (struct pell_surface_sample) {
        .position = { n->centre[0], n->centre[1], n->centre[2] },
        .normal = { n->normal[0], n->normal[1], n->normal[2] },
        .area = n->area,
        .curvature = n->curvature,
        .power = { n->power[0], n->power[1], n->power[2] },
        .deep = { n->deep[0], n->deep[1], n->deep[2] },
        .direction = { n->direction[0], n->direction[1], n->direction[2] },
    };
}

/* Squared distance to the box of a node, mm^2. */
static inline float pell_light_node_distance2(const struct pell_light_node *n, const float *p)
{
    float sum = 0.0f;

    for (int k = 0; k < 3; k++) {
        const float under = n->low[k] - p[k], over = p[k] - n->high[k], d = under > over ? under : over;
        sum += d > 0.0f ? d * d : 0.0f;
    }
    return sum;
}

#endif
