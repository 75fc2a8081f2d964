/* SPDX-License-Identifier: MIT
 * light_tree.c - an octree over samples sorted along the Morton curve: nodes are in depth-first order, each with the index after its
 * subtree, so that traversal needs no stack. */
#include "transport/light_tree.h"

#include "base/base.h"
#include "scene/mesh/topology.h"

#include <math.h>
#include <string.h>

enum { LEAF = 8, LEVELS = 21 };

struct builder {
    struct pell_light_tree *tree;
    const uint64_t *codes; /* of the sorted samples */
    size_t capacity;
};

void pell_light_tree_finish(struct pell_light_tree *tree)
{
    if (!tree->ctx)
        return;
    pell_free(tree->ctx, tree->samples);
    pell_free(tree->ctx, tree->nodes);
    memset(tree, 0, sizeof(*tree));
}

/* Inserts two zero bits after each bit, for Morton codes. */
static uint64_t spread(uint64_t x)
{
    x &= 0x1fffff;
    x = (x | x << 32) & 0x001f00000000ffffull;
    x = (x | x << 16) & 0x001f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}

static uint64_t code_at(const void *items, size_t index)
{
    return ((const uint64_t *) items)[index];
}

/* Sums over the samples of a subtree; all but power, deep, area and `middle`, the sum of positions, are weighted by light. */
struct sums {
    double centre[3], middle[3], power[3], deep[3], normal[3], direction[3], curvature, light, area;
};

static void add_sample(const struct pell_surface_sample *s, struct sums *sum, struct pell_light_node *n)
{
    double light = 0.0;

    for (int c = 0; c < 3; c++) {
        light += (double) s->power[c];
        sum->power[c] += (double) s->power[c];
        sum->deep[c] += (double) s->deep[c];
    }
    for (int k = 0; k < 3; k++) {
        sum->centre[k] += light * (double) s->position[k];
        sum->middle[k] += (double) s->position[k];
        sum->normal[k] += light * (double) s->normal[k];
        sum->direction[k] += light * (double) s->direction[k];
        n->low[k] = fminf(n->low[k], s->position[k]);
        n->high[k] = fmaxf(n->high[k], s->position[k]);
    }
    sum->curvature += light * (double) s->curvature;
    sum->light += light;
    sum->area += (double) s->area;
}

static enum pell_result build(struct builder *b, size_t first, size_t end, int level, struct sums *out)
{
    struct pell_light_tree *t = b->tree;
    const size_t at = t->num_nodes;
    struct sums sum = { { 0 } };
    struct pell_light_node n = { .low = { INFINITY, INFINITY, INFINITY },
                                 .high = { -INFINITY, -INFINITY, -INFINITY },
                                 .first = (uint32_t) first };
    enum pell_result res;

    if (pell_cancelled_at(t->ctx, t->num_nodes))
        return PELL_ERR_CANCELLED;
    PELL_TRY(pell_grow(t->ctx, (void **) &t->nodes, t->num_nodes, &b->capacity, sizeof(*t->nodes)));
    t->num_nodes++;
    if (end - first <= LEAF || level < 0) {
        n.count = (uint32_t) (end - first);
        for (size_t i = first; i < end; i++)
            add_sample(&t->samples[i], &sum, &n);
    } else {
        for (size_t i = first; i < end;) {
            const uint64_t digit = b->codes[i] >> 3 * level;
            struct sums child;
            const struct pell_light_node *c;
            size_t j = i + 1;
            while (j < end && b->codes[j] >> 3 * level == digit)
                j++;
            const size_t child_index = t->num_nodes;
            PELL_TRY(build(b, i, j, level - 1, &child));
            c = &t->nodes[child_index];
            for (int k = 0; k < 3; k++) {
                sum.centre[k] += child.centre[k];
                sum.middle[k] += child.middle[k];
                sum.power[k] += child.power[k];
                sum.deep[k] += child.deep[k];
                sum.normal[k] += child.normal[k];
                sum.direction[k] += child.direction[k];
                n.low[k] = fminf(n.low[k], c->low[k]);
                n.high[k] = fmaxf(n.high[k], c->high[k]);
            }
            sum.curvature += child.curvature;
            sum.light += child.light;
            sum.area += child.area;
            i = j;
        }
    }
    n.area = (float) sum.area;
    n.curvature = sum.light > 0.0 ? (float) (sum.curvature / sum.light) : 0.0f;
    n.next = (uint32_t) t->num_nodes;
    for (int k = 0; k < 3; k++) {
        n.power[k] = (float) sum.power[k];
        n.deep[k] = (float) sum.deep[k];
        n.normal[k] = sum.light > 0.0 ? (float) (sum.normal[k] / sum.light) : 0.0f;
        n.direction[k] = sum.light > 0.0 ? (float) (sum.direction[k] / sum.light) : 0.0f;
        n.centre[k] = (float) (sum.light > 0.0 ? sum.centre[k] / sum.light : sum.middle[k] / (double) (end - first));
    }
    t->nodes[at] = n;
    *out = sum;
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_light_tree_make(struct pell_context *ctx, struct pell_surface_sample *samples, size_t num_samples,
                                      struct pell_light_tree *tree)
{
    struct builder b = { .tree = tree };
    struct pell_surface_sample *sorted = NULL;
    uint64_t *codes = NULL, *sorted_codes = NULL;
    uint32_t *order = NULL;
    struct sums sums;
    float low[3] = { INFINITY, INFINITY, INFINITY }, size = 0.0f;
    enum pell_result res = PELL_ERR_NOMEM;

    tree->ctx = ctx;
    tree->samples = samples;
    tree->num_samples = num_samples;
    if (num_samples == 0)
        return PELL_OK;
    sorted = pell_alloc_array(ctx, num_samples, sizeof(*sorted));
    codes = pell_alloc_array(ctx, num_samples, sizeof(*codes));
    sorted_codes = pell_alloc_array(ctx, num_samples, sizeof(*sorted_codes));
    if (!sorted || !codes || !sorted_codes)
        goto fail;
    for (size_t i = 0; i < num_samples; i++)
        for (int k = 0; k < 3; k++)
            low[k] = fminf(low[k], samples[i].position[k]);
    for (size_t i = 0; i < num_samples; i++)
        for (int k = 0; k < 3; k++)
            size = fmaxf(size, samples[i].position[k] - low[k]);
    for (size_t i = 0; i < num_samples; i++) {
        codes[i] = 0;
        for (int k = 0; k < 3; k++) {
            const float f = size > 0.0f ? (samples[i].position[k] - low[k]) / size : 0.0f;
            codes[i] |= spread((uint64_t) (f * 2097151.0f)) << k;
        }
    }
    PELL_TRY(pell_order_by_code(ctx, num_samples, code_at, codes, &order));
    for (size_t i = 0; i < num_samples; i++) {
        sorted_codes[i] = codes[order[i]];
        sorted[i] = samples[order[i]];
    }
    pell_free(ctx, tree->samples);
    tree->samples = sorted;
    sorted = NULL;
    b.codes = sorted_codes;
    PELL_TRY(build(&b, 0, num_samples, LEVELS - 1, &sums));

fail:
    pell_free(ctx, sorted);
    pell_free(ctx, codes);
    pell_free(ctx, sorted_codes);
    pell_free(ctx, order);
    return res;
}
