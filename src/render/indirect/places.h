/* SPDX-License-Identifier: MIT
 *
 * places.h - places of a solid's surface that stand for equal areas, chosen among samples, and clusters of them.
 */
#ifndef INDIRECT_PLACES_H
#define INDIRECT_PLACES_H

#include "base/pool.h"
#include "math/vec.h"
#include "transport/light_tree.h"

#define PLACES_MOST 8192
#define PLACES_NONE UINT32_MAX

struct place {
    struct pell_vec3 position, normal;
    float area;       /* mm^2, of its samples */
    float curvature;  /* 1/mm, mean of theirs */
    float far;        /* of the nearest sample to their middle */
    uint32_t nearest; /* that sample */
    int32_t cell[3];  /* of a grid */
    uint32_t next;    /* of its bucket, or PLACES_NONE */
    uint32_t cluster;
};

/* Places beside each other that look much the same way, which stand for one from afar. */
struct cluster {
    struct pell_vec3 position, normal; /* means by area */
    float area, radius, curvature;     /* radius: around all of them; curvature: mean by area */
    uint32_t first, end;               /* places */
};

struct places {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct pell_lit_place *sample;
    size_t num_samples;
    uint32_t *of; /* each sample's place, or PLACES_NONE */
    float step;   /* mm between places, about */
    struct place *place;
    struct cluster *cluster;
    uint32_t count, num_clusters;
    struct place *sorted;
    uint32_t *bucket;
};

/* `samples` are borrowed. */
PELL_NODISCARD enum pell_result indirect_places_create(struct pell_context *ctx, struct pell_pool *pool,
                                                       const struct pell_lit_place *samples, size_t num_samples, struct places *out);
void indirect_places_finish(struct places *p);
/* Chooses anew, `step` apart. The same for any number of threads. */
PELL_NODISCARD enum pell_result indirect_places_choose(struct places *p, float step);

#endif
