/* SPDX-License-Identifier: MIT
 *
 * forward.c - light that is scattered forward through a solid (optics/medium/forward.h), between samples of its surface: radiance at a
 * sample is summed over an octree of those that light enters at, with the mean of its directions.
 */
#include "render/indirect/internal.h"

enum { CHUNK = 128 };
#define SHARPEST 100.0f /* peak of a beam, see forward.h: where samples are near to each other */
#define SHARP 3.0f      /* over the solid angle of a sample */
#define ERROR 0.1f      /* sr: solid angle of a node that counts as one */
#define MEAN 0.5f       /* least squared length of the mean of a node's normals, and of its ways */

struct forward {
    const struct indirect_forward *of;
    const struct pell_light_tree *tree;
    struct pell_indirect_beam *out;
};

/* Where light leaves. */
struct end {
    const struct indirect_sample *at;
    /* pell_indirect_far of the thickness of the part there: all that enters opposite is as far away or farther, and rays have the rest */
    float far;
};

static void add_beam(const struct pell_forward *law, const struct end *end, const float position[3], const float normal[3],
                     const float way[3], const float power[3], float area, struct pell_indirect_beam *sum)
{
    const struct indirect_sample *to = end->at;
    const struct pell_vec3 v = vec3_sub(to->position, vec3_load(position)), w = vec3_load(way);
    const float d2 = vec3_dot(v, v), d = sqrtf(d2), along = sqrtf(vec3_dot(w, w)), far = fminf(pell_indirect_far(d, to->spacing), end->far);
    float flux[3], cosine[3];

    if (!(far > 0.0f && vec3_dot(to->normal, v) > 0.0f && vec3_dot(vec3_load(normal), v) < 0.0f &&
          vec3_dot(w, v) > 0.0f)) /* see pell_forward_lobe */
        return;
    pell_forward_at(law, d2, fminf(vec3_dot(w, v) / (d * along), 1.0f), fminf(along, 1.0f), fminf(SHARP * d2 / area, SHARPEST), flux,
                    cosine);
    for (int c = 0; c < 3; c++) {
        const float light = far * power[c] * flux[c], goes = light * cosine[c] / d;
        sum->light[c] += light;
        sum->turned[c] += light * cosine[c];
        sum->way[c][0] += goes * v.x;
        sum->way[c][1] += goes * v.y;
        sum->way[c][2] += goes * v.z;
    }
}

static void gather(const struct forward *f, const struct end *end, struct pell_indirect_beam *sum)
{
    const struct pell_light_tree *t = f->tree;

    for (uint32_t i = 0; i < (uint32_t) t->num_nodes;) {
        const struct pell_light_node *n = &t->nodes[i];
        const struct pell_vec3 v = vec3_sub(end->at->position, vec3_load(n->centre)), normal = vec3_load(n->normal),
                               way = vec3_load(n->way);
        if (!(n->power[0] + n->power[1] + n->power[2] > 0.0f)) {
            i = n->next;
        } else if (n->area < ERROR * vec3_dot(v, v) && vec3_dot(normal, normal) > MEAN && vec3_dot(way, way) > MEAN) {
            add_beam(f->of->law, end, n->centre, n->normal, n->way, n->power, n->area, sum);
            i = n->next;
        } else if (n->count) {
            for (uint32_t k = n->first; k < n->first + n->count; k++) {
                const struct pell_lit_place *p = &t->samples[k];
                add_beam(f->of->law, end, p->position, p->normal, p->way, p->power, p->area, sum);
            }
            i = n->next;
        } else {
            i++;
        }
    }
}

static void gather_chunk(void *arg, int index, int worker)
{
    const struct forward *f = arg;
    const size_t first = (size_t) index * CHUNK;

    (void) worker;
    for (size_t i = first; i < first + CHUNK && i < f->of->count; i++) {
        struct pell_indirect_beam sum = { { 0.0f } };
        const uint32_t at = f->of->list[i];
        const struct indirect_sample *to = &f->of->in->samples[at];
        const struct end end = { to, pell_indirect_far(f->of->thickness[at], to->spacing) };
        if (end.far > 0.0f)
            gather(f, &end, &sum);
        f->out[at] = sum;
    }
}

enum pell_result indirect_forward_send(struct pell_pool *pool, const struct indirect_forward *of, struct pell_lit_place *samples,
                                       struct pell_indirect_beam *out)
{
    struct pell_light_tree tree = { .num_nodes = 0 };
    struct forward f = { of, &tree, out };
    enum pell_result res = pell_light_tree_make(of->in->ctx, samples, of->count, &tree);

    if (res == PELL_OK)
        pell_pool_run(pool, (int) ((of->count + CHUNK - 1) / CHUNK), gather_chunk, &f);
    pell_light_tree_finish(&tree);
    return res;
}
