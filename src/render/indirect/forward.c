/* SPDX-License-Identifier: MIT
 *
 * forward.c - forward-scattered light through a solid (optics/medium/forward.h), between samples of its surface: the radiance at a sample
 * and its mean direction are summed over an octree of the samples that light enters.
 */
#include "render/indirect/internal.h"

enum { CHUNK = 128 };
#define MAX_PEAK 100.0f      /* largest peak of a beam, see forward.h: for samples close to each other */
#define PEAK_SCALE 3.0f      /* peak times the solid angle of a sample */
#define MAX_SOLID_ANGLE 0.1f /* sr: solid angle below which a node is treated as one sample */
#define MIN_LENGTH2 0.5f     /* least squared length of a node's mean normal and mean light direction */

struct gathering {
    const struct indirect_forward *input;
    const struct pell_light_tree *tree;
    struct pell_indirect_beam *out;
};

/* The point where light leaves. */
struct receiver {
    const struct indirect_sample *at;
    /* pell_indirect_far_weight of the local thickness: all light that enters opposite is at least as far away; rays find the rest */
    float far_weight;
};

static void add_beam(const struct pell_forward *model, const struct receiver *receiver, const float position[3], const float normal[3],
                     const float direction[3], const float power[3], float area, struct pell_indirect_beam *sum)
{
    const struct indirect_sample *to = receiver->at;
    const struct pell_vec3 v = vec3_sub(to->position, vec3_load(position)), w = vec3_load(direction);
    const float d2 = vec3_dot(v, v), d = sqrtf(d2), length = sqrtf(vec3_dot(w, w)),
                far_weight = fminf(pell_indirect_far_weight(d, to->spacing), receiver->far_weight);
    float flux[3], cosine[3];

    if (!(far_weight > 0.0f && vec3_dot(to->normal, v) > 0.0f && vec3_dot(vec3_load(normal), v) < 0.0f &&
          vec3_dot(w, v) > 0.0f)) /* see pell_forward_lobe */
        return;
    pell_forward_at(model, d2, fminf(vec3_dot(w, v) / (d * length), 1.0f), fminf(length, 1.0f), fminf(PEAK_SCALE * d2 / area, MAX_PEAK),
                    flux, cosine);
    for (int c = 0; c < 3; c++) {
        const float light = far_weight * power[c] * flux[c], weight = light * cosine[c] / d;
        sum->light[c] += light;
        sum->cosine[c] += light * cosine[c];
        sum->direction[c][0] += weight * v.x;
        sum->direction[c][1] += weight * v.y;
        sum->direction[c][2] += weight * v.z;
    }
}

static void gather(const struct gathering *f, const struct receiver *receiver, struct pell_indirect_beam *sum)
{
    const struct pell_light_tree *t = f->tree;

    for (uint32_t i = 0; i < (uint32_t) t->num_nodes;) {
        const struct pell_light_node *n = &t->nodes[i];
        const struct pell_vec3 v = vec3_sub(receiver->at->position, vec3_load(n->centre)), normal = vec3_load(n->normal),
                               direction = vec3_load(n->direction);
        if (!(n->power[0] + n->power[1] + n->power[2] > 0.0f)) {
            i = n->next;
        } else if (n->area < MAX_SOLID_ANGLE * vec3_dot(v, v) && vec3_dot(normal, normal) > MIN_LENGTH2 &&
                   vec3_dot(direction, direction) > MIN_LENGTH2) {
            add_beam(f->input->model, receiver, n->centre, n->normal, n->direction, n->power, n->area, sum);
            i = n->next;
        } else if (n->count) {
            for (uint32_t k = n->first; k < n->first + n->count; k++) {
                const struct pell_surface_sample *p = &t->samples[k];
                add_beam(f->input->model, receiver, p->position, p->normal, p->direction, p->power, p->area, sum);
            }
            i = n->next;
        } else {
            i++;
        }
    }
}

static void gather_chunk(void *arg, int index, int worker)
{
    const struct gathering *f = arg;
    const size_t first = (size_t) index * CHUNK;

    (void) worker;
    for (size_t i = first; i < first + CHUNK && i < f->input->count; i++) {
        struct pell_indirect_beam sum = { { 0.0f } };
        const uint32_t at = f->input->list[i];
        const struct indirect_sample *to = &f->input->in->samples[at];
        const struct receiver receiver = { to, pell_indirect_far_weight(f->input->thickness[at], to->spacing) };
        if (receiver.far_weight > 0.0f)
            gather(f, &receiver, &sum);
        f->out[at] = sum;
    }
}

enum pell_result indirect_forward_send(struct pell_pool *pool, const struct indirect_forward *input, struct pell_surface_sample *samples,
                                       struct pell_indirect_beam *out)
{
    struct pell_light_tree tree = { .num_nodes = 0 };
    struct gathering f = { input, &tree, out };
    enum pell_result res = pell_light_tree_make(input->in->ctx, samples, input->count, &tree);

    if (res == PELL_OK)
        pell_pool_run(pool, (int) ((input->count + CHUNK - 1) / CHUNK), gather_chunk, &f);
    pell_light_tree_finish(&tree);
    return res;
}
