/* SPDX-License-Identifier: MIT
 *
 * transport.c - light transport through solids, between samples of their surfaces:
 *
 *     M(x) = Sum_i K(x, x_i) E(x_i) spacing_i^2          K: of optics/medium/opposed.h, between faces of different orientation
 *
 * over an octree of the samples of each object and material, then from samples to knots like indirect light. Neither depends on the view.
 *
 */
#include "render/indirect/internal.h"

#include "math/scalar.h"
#include "optics/medium/opposed.h"
#include "render/angle.h"
#include "render/camera_view.h"
#include "scene/mesh/topology.h"
#include "scene/triangle.h"
#include "transport/light_tree.h"

#include <string.h>

enum { CHUNK = 128, PACKET = 16 };
#define MAX_SOLID_ANGLE 0.25f /* sr: solid angle below which a node is treated as one sample */
#define MIN_NORMAL2 0.5f      /* least squared length of a node's mean normal */
#define MAX_DISTANCE 14.0f    /* diffusion lengths: nothing is transmitted farther */
#define THIN_LOW 2.0f         /* thickness of a part, in distances of samples: below it a slab's T is used, */
#define THIN_HIGH 4.0f        /* and above it the sum over samples */
#define DEEP_LOW 3.0f         /* thickness in diffusion lengths of a channel: below it a slab's T is used, */
#define DEEP_HIGH 6.0f        /* and above it the sum, since nearly all light comes from around the rim */

#define DIFFUSE_LOW 3.0f  /* thickness in mean free paths minus that in diffusion lengths: rarely absorbed light is diffuse */
#define DIFFUSE_HIGH 4.5f /* from here on, and arrives from the sides as much as from the far side */

#define THINNER 3.0f       /* factor of the thickness at which the sum takes over, for forward-scattered light, */
#define FORWARD_FROM 0.85f /* from this exponent (times the mean free path) on */

#define PASSED_FRACTION 0.1f /* per mean free path, see optics/medium/passing.h */

struct transport {
    struct pell_indirect *in;
    const struct pell_indirect_lights *lights;
    const struct pell_indirect_solid *solid; /* per scene material */
    float mix;                               /* as in struct pell_plan */
    struct pell_surface_sample *sample;      /* per sample of the stage; power without the scale for curvature */
    float (*albedo)[3];                      /* per sample: albedo^m */
    float (*crossed)[3];                     /* curvature/stage.h */
    struct indirect_round *round;
    float (*surplus)[3]; /* of round_parts.c */
    bool *lit;
    float (*sum_weight)[3], *thickness; /* per sample; thickness in mm */
    float (*source)[3], (*single)[3]; /* W/m^2 times mm^2: parts of a sample's power that go into the depth, and that are scattered once */
    float *diffuse;                   /* fraction of the light into the depth that is diffuse */
    struct indirect_solid_light *light;
    struct pell_indirect_beam *beam; /* NULL: no material scatters forward */
    const uint32_t *list;            /* sample indices of one object and material, or of one of its solids */
    size_t count;
    struct pell_light_tree tree;
    struct pell_surface_sample *node; /* nodes of the tree, each as one sample */
};

static int chunks_of(size_t count)
{
    return (int) ((count + CHUNK - 1) / CHUNK);
}

/* Weight of the sum over samples, by how densely they sample a part. */
static float sampling_weight(float thinness, float spacing)
{
    return smooth_ramp(THIN_LOW, THIN_HIGH, thinness > 0.0f ? 1.0f / (thinness * spacing) : THIN_HIGH);
}

/* A slab's T scatters to all sides. Where light is scattered rarely and forward, the sum therefore takes over at smaller thickness. */
static float depth_scale(const struct pell_indirect_solid *as, int c)
{
    return as->beams && as->forward.sigma_t[c] > 0.0f
               ? 1.0f + (THINNER - 1.0f) * smooth_ramp(FORWARD_FROM, 1.0f, as->opposed.kappa[c] * as->opposed.depth[c])
               : 1.0f;
}

/* Weight of the sum over samples for a part of this thinness. */
static float sum_weight_of(const struct pell_indirect_solid *as, float thinness, int c)
{
    const float kappa = as->opposed.kappa[c];

    return fmaxf(smooth_ramp(DEEP_LOW, DEEP_HIGH, depth_scale(as, c) * kappa / thinness),
                 smooth_ramp(DIFFUSE_LOW, DIFFUSE_HIGH, (1.0f / as->opposed.depth[c] - kappa) / thinness));
}

/* Sets the weight of the sum over samples in the transmitted light: 1 where a part is thick for a channel, so that light arrives from
 * the rim as well, or where diffusion holds; 0 where samples are too far apart. */
static void set_sum_weight(const struct pell_indirect_solid *as, float thinness, float spacing, float weight[3])
{
    const float fine = sampling_weight(thinness, spacing);

    for (int c = 0; c < 3; c++)
        weight[c] = fine * (thinness > 0.0f && as->opposed.depth[c] > 0.0f ? sum_weight_of(as, thinness, c) : 1.0f);
}

/* --- Entering light ------------------------------------------------------------------------------------------------------------------- */

/* Computes the light that goes into the depth: without the scale for curvature, without the single scattering of diffuse light, and
 * without the surplus that a half-space returns of oblique light, since that results from its path along the surface. `shifted` and
 * `single` are parts of a sample's power. */
static void split_source(const struct transport *s, const struct indirect_sample *q, const struct pell_surface_sample *p,
                         float shifted[3][PACKET], float single[3][PACKET], size_t i, float source[3])
{
    const float obliquity = fmaxf(1.0f + vec3_dot(q->normal, vec3_load(p->direction)), 0.0f);

    for (int c = 0; c < 3; c++)
        source[c] = p->power[c] > 0.0f
                        ? fmaxf(p->power[c] - shifted[c][i] - single[c][i], 0.0f) / (1.0f + s->solid[q->medium].slope[c] * obliquity)
                        : 0.0f;
}

static void enter16(const struct transport *s, size_t first, size_t count)
{
    const struct pell_indirect *in = s->in;
    float irradiance[3][PACKET], albedo[3][PACKET], gain[3][PACKET], crossed[3][PACKET], uniform[3][PACKET], small[3][PACKET],
        shifted[3][PACKET], single[3][PACKET], direction[3][PACKET], curvature[PACKET], thinness[PACKET], u[PACKET], v[PACKET],
        diffuse[PACKET];
    uint32_t mesh[PACKET], triangle[PACKET], seed[PACKET];
    bool valid[PACKET];
    const struct pell_points_params params = {
        .mix = s->mix, .spacing = in->samples[first].spacing, .samples = 1, .opposed = true, .flat = true
    };
    const struct pell_surface_points points = { .mesh = mesh, .triangle = triangle, .u = u, .v = v, .seed = seed };
    const struct pell_surface_light out = { .irradiance = { irradiance[0], irradiance[1], irradiance[2] },
                                            .albedo = { albedo[0], albedo[1], albedo[2] },
                                            .gain = { gain[0], gain[1], gain[2] },
                                            .crossed = { crossed[0], crossed[1], crossed[2] },
                                            .uniform = { uniform[0], uniform[1], uniform[2] },
                                            .small = { small[0], small[1], small[2] },
                                            .shifted = { shifted[0], shifted[1], shifted[2] },
                                            .single_surplus = { single[0], single[1], single[2] },
                                            .direction = { direction[0], direction[1], direction[2] },
                                            .diffuse = diffuse,
                                            .curvature = curvature,
                                            .thinness = thinness,
                                            .valid = valid };

    for (size_t i = 0; i < count; i++) {
        const struct indirect_sample *q = &in->samples[first + i];
        const float *amount = s->solid[q->medium].opposed.amount;
        const bool is = amount[0] + amount[1] + amount[2] > 0.0f;
        mesh[i] = is && !q->back ? q->mesh : PELL_NO_HIT;
        triangle[i] = q->triangle;
        u[i] = q->u;
        v[i] = q->v;
        seed[i] = (uint32_t) (first + i);
    }
    s->lights->light_points(s->lights->engine, &params, &points, count, &out);
    for (size_t i = 0; i < count; i++) {
        const struct indirect_sample *q = &in->samples[first + i];
        struct pell_surface_sample *p = &s->sample[first + i];
        p->area = q->spacing * q->spacing;
        p->curvature = curvature[i];
        vec3_store(q->position, p->position);
        vec3_store(q->normal, p->normal);
        for (int c = 0; c < 3; c++) {
            const float scale = valid[i] && albedo[c][i] > 0.0f ? p->area / albedo[c][i] : 0.0f;
            s->albedo[first + i][c] = valid[i] ? albedo[c][i] : 0.0f;
            shifted[c][i] *= scale;
            single[c][i] *= scale;
            p->power[c] = irradiance[c][i] * scale;
            p->deep[c] = fmaxf(p->power[c] - single[c][i], 0.0f);
            p->direction[c] = valid[i] ? direction[c][i] : 0.0f;
            s->round[first + i].gain[c] = gain[c][i];
            s->round[first + i].uniform[c] = uniform[c][i];
            s->round[first + i].weight[c] = sampling_weight(thinness[i], q->spacing) * small[c][i];
            s->crossed[first + i][c] = crossed[c][i];
            s->single[first + i][c] = valid[i] ? single[c][i] : 0.0f;
        }
        split_source(s, q, p, shifted, single, i, s->source[first + i]);
        s->diffuse[first + i] = valid[i] ? diffuse[i] : 0.0f;
        s->lit[first + i] = valid[i];
        s->thickness[first + i] = thinness[i] > 0.0f ? 1.0f / thinness[i] : INFINITY;
        if (s->solid[q->medium].between_faces)
            set_sum_weight(&s->solid[q->medium], thinness[i], q->spacing, s->sum_weight[first + i]);
    }
}

static void enter_chunk(void *arg, int index, int worker)
{
    const struct transport *s = arg;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < s->in->num_samples ? first + CHUNK : s->in->num_samples;

    (void) worker;
    for (size_t i = first; i < end; i += PACKET)
        enter16(s, i, end - i < PACKET ? end - i : PACKET);
}

/* --- Exchange between samples --------------------------------------------------------------------------------------------------------- */

/* Light transmitted to a sample. */
struct exchange {
    float light[3];   /* W/m^2 */
    float uniform[3]; /* of uniform light on the faces that it comes from, over that light */
};

static void add_pair(const struct pell_opposed *opposed, const struct indirect_sample *to, const struct pell_surface_sample *from,
                     struct exchange *g)
{
    const struct pell_vec3 v = vec3_sub(to->position, vec3_load(from->position)), n = vec3_load(from->normal),
                           w = vec3_load(from->direction);
    const struct pell_vec3 t = vec3_mad(w, -vec3_dot(w, n), n);
    const struct pell_opposed_pair pair = { vec3_dot(v, v),          vec3_dot(n, v),  vec3_dot(to->normal, v),
                                            vec3_dot(to->normal, n), from->curvature, vec3_dot(t, v),
                                            vec3_dot(t, to->normal), vec3_dot(t, t),  from->area };
    const float visibility = pell_opposed_unseen(pair.facing), max2 = MAX_DISTANCE * MAX_DISTANCE;
    float through[3];
    bool is[3], any = false;

    for (int c = 0; c < 3; c++) {
        is[c] = opposed->amount[c] > 0.0f && opposed->kappa[c] * opposed->kappa[c] * pair.distance2 < max2;
        any |= is[c];
    }
    if (!any || !(visibility > 0.0f))
        return;
    pell_opposed_split_of(opposed, &pair, is, through);
    for (int c = 0; c < 3; c++) {
        g->light[c] += visibility * through[c] * from->power[c];
        g->uniform[c] += visibility * through[c] * from->area;
    }
}

/* Squared distance beyond which no channel transmits anything. */
static float max_distance2(const struct pell_opposed *opposed)
{
    float least = INFINITY;

    for (int c = 0; c < 3; c++)
        if (opposed->amount[c] > 0.0f)
            least = fminf(least, opposed->kappa[c] * opposed->kappa[c]);
    return 1.001f * MAX_DISTANCE * MAX_DISTANCE / least; /* margin for rounding */
}

static void gather(const struct transport *s, const struct pell_opposed *opposed, const struct indirect_sample *to, struct exchange *g)
{
    const struct pell_light_tree *t = &s->tree;
    const float p[3] = { to->position.x, to->position.y, to->position.z }, max2 = max_distance2(opposed);

    for (uint32_t i = 0; i < (uint32_t) t->num_nodes;) {
        const struct pell_light_node *n = &t->nodes[i];
        const struct pell_vec3 v = vec3_sub(to->position, vec3_load(n->centre)), mean = vec3_load(n->normal);
        if (!(n->power[0] + n->power[1] + n->power[2] > 0.0f) || pell_light_node_distance2(n, p) > max2) {
            i = n->next;
        } else if (n->area < MAX_SOLID_ANGLE * vec3_dot(v, v) && vec3_dot(mean, mean) > MIN_NORMAL2) {
            add_pair(opposed, to, &s->node[i], g);
            i = n->next;
        } else if (n->count) {
            for (uint32_t k = n->first; k < n->first + n->count; k++)
                add_pair(opposed, to, &t->samples[k], g);
            i = n->next;
        } else {
            i++;
        }
    }
}

static void gather_chunk(void *arg, int index, int worker)
{
    const struct transport *s = arg;
    const size_t first = (size_t) index * CHUNK;

    (void) worker;
    for (size_t i = first; i < first + CHUNK && i < s->count; i++) {
        const struct indirect_sample *to = &s->in->samples[s->list[i]];
        const float *solved = s->light[s->list[i]].solved, *sum_weight = s->sum_weight[s->list[i]];
        struct pell_opposed opposed = s->solid[to->medium].opposed;
        struct exchange g = { { 0.0f }, { 0.0f } };
        for (int c = 0; c < 3; c++)
            opposed.amount[c] = solved[c] < 1.0f && sum_weight[c] > 0.0f ? opposed.amount[c] : 0.0f;
        if (opposed.amount[0] + opposed.amount[1] + opposed.amount[2] > 0.0f)
            gather(s, &opposed, to, &g);
        for (int c = 0; c < 3; c++) {
            const float most = s->solid[to->medium].returned[c];
            s->in->gathered[s->list[i]][c] = sum_weight[c] * s->crossed[s->list[i]][c] * g.light[c] *
                                             (g.uniform[c] > most ? most / g.uniform[c] : 1.0f) * s->solid[to->medium].white[c];
        }
    }
}

/* --- Objects and their materials ---------------------------------------------------------------------------------------------------- */

static bool same_group(const struct pell_indirect *in, const struct indirect_sample *a, const struct indirect_sample *b)
{
    return a->medium == b->medium && pell_mesh_assembly(&in->p.scene->meshes[a->mesh]) == pell_mesh_assembly(&in->p.scene->meshes[b->mesh]);
}

/* Copies of the list's samples with their light scaled for curvature: what goes into the depth, without albedo, or all. */
static struct pell_surface_sample *scale_by_curvature(const struct transport *s, bool deep)
{
    struct pell_surface_sample *out = pell_alloc_array(s->in->ctx, s->count, sizeof(*out));

    for (size_t i = 0; out && i < s->count; i++) {
        out[i] = s->sample[s->list[i]];
        for (int c = 0; c < 3; c++) {
            const float gain = s->round[s->list[i]].gain[c], scale = gain * s->albedo[s->list[i]][c];
            out[i].power[c] = deep ? s->source[s->list[i]][c] * gain : out[i].power[c] * scale;
            out[i].deep[c] *= scale;
        }
    }
    return out;
}

/* Sums the exchange between faces, where the solved diffusion does not cover everything. */
static enum pell_result sum_between_faces(struct transport *s, struct pell_pool *pool)
{
    struct pell_surface_sample *samples = scale_by_curvature(s, true);
    enum pell_result res;

    if (!samples)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_light_tree_make(s->in->ctx, samples, s->count, &s->tree));
    s->node = pell_alloc_array(s->in->ctx, s->tree.num_nodes, sizeof(*s->node));
    for (size_t i = 0; s->node && i < s->tree.num_nodes; i++)
        s->node[i] = pell_light_node_sample(&s->tree.nodes[i]);
    if (s->node)
        pell_pool_run(pool, chunks_of(s->count), gather_chunk, s);
    res = s->node ? PELL_OK : PELL_ERR_NOMEM;

fail:
    pell_free(s->in->ctx, s->node);
    s->node = NULL;
    pell_light_tree_finish(&s->tree);
    return res;
}

/* Sets the part of a sample's light that is scattered forward: all directional light, and of diffuse light what a slab's T does not
 * cover. */
static void set_beam_source(const struct transport *s, const struct pell_indirect_solid *as, uint32_t sample, struct pell_surface_sample *p)
{
    const float *sum_weight = s->sum_weight[sample];
    float slab_fraction = 0.0f;

    memcpy(p->power, s->source[sample], sizeof(p->power));
    for (int c = 0; c < 3 && as->between_faces; c++) {
        const float slab_weight = s->diffuse[sample] * (1.0f - sum_weight[c]);
        p->power[c] *= 1.0f - slab_weight;
        slab_fraction += slab_weight * (1.0f / 3.0f);
    }
    vec3_store(vec3_mul(vec3_mad(vec3_load(p->direction), slab_fraction * as->refracted, vec3_load(p->normal)),
                        1.0f / fmaxf(1.0f - slab_fraction, 1e-6f)),
               p->direction);
}

/* Sums the forward-scattered light. */
static enum pell_result sum_beams(const struct transport *s, struct pell_pool *pool)
{
    const struct pell_indirect_solid *as = &s->solid[s->in->samples[s->list[0]].medium];
    const struct indirect_forward forward = { s->in, &as->forward, s->list, s->thickness, s->count };
    struct pell_surface_sample *samples = pell_alloc_array(s->in->ctx, s->count, sizeof(*samples));
    enum pell_result res = PELL_OK;

    if (!samples)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < s->count; i++) {
        samples[i] = s->sample[s->list[i]];
        set_beam_source(s, as, s->list[i], &samples[i]);
    }
    PELL_TRY(indirect_forward_send(pool, &forward, samples, s->beam));
    for (size_t i = 0; i < s->count; i++) {
        const struct indirect_sample *to = &s->in->samples[s->list[i]];
        struct pell_indirect_beam *beam = &s->beam[s->list[i]];
        const float *scale = s->in->forward[to->medium].exitance_scale;
        beam->spacing = to->spacing;
        for (int c = 0; c < 3; c++) {
            beam->light[c] *= scale[c];
            beam->cosine[c] *= scale[c];
            vec3_store(vec3_mul(vec3_load(beam->direction[c]), scale[c]), beam->direction[c]);
        }
    }

fail:
    return res;
}

/* Solves the samples of s->list, which are those of one solid. */
static enum pell_result solve_solid(struct transport *s, struct pell_pool *pool, struct profile_sum *profile_sum)
{
    struct pell_indirect *in = s->in;
    const struct pell_indirect_solid *as = &s->solid[in->samples[s->list[0]].medium];
    struct indirect_solid solid = { .profile = as->profile, .opposed = &as->opposed, .profile_sum = profile_sum, .count = s->count };
    struct pell_surface_sample *lit = pell_alloc_array(in->ctx, s->count, sizeof(*lit));
    struct indirect_solid_light *light = pell_alloc_array(in->ctx, s->count, sizeof(*light));
    float *thickness = pell_alloc_array(in->ctx, s->count, sizeof(*thickness));
    float(*source)[3] = pell_alloc_array(in->ctx, s->count, sizeof(*source));
    float(*single)[3] = pell_alloc_array(in->ctx, s->count, sizeof(*single));
    enum pell_result res = PELL_ERR_NOMEM;

    if (!lit || !light || !thickness || !source || !single)
        goto fail;
    for (size_t i = 0; i < s->count; i++) {
        lit[i] = s->sample[s->list[i]];
        thickness[i] = s->thickness[s->list[i]];
        for (int c = 0; c < 3; c++) {
            const float albedo = s->albedo[s->list[i]][c];
            lit[i].power[c] *= albedo;
            source[i][c] = albedo * s->source[s->list[i]][c];
            single[i][c] = albedo * s->single[s->list[i]][c];
        }
        solid.spacing = fmaxf(solid.spacing, in->samples[s->list[i]].spacing);
    }
    solid.samples = lit;
    solid.thickness = thickness;
    solid.source = (const float(*)[3]) source;
    solid.single = (const float(*)[3]) single;
    solid.slope = as->slope;
    PELL_TRY(indirect_diffusion_solve(in->ctx, pool, &solid, light));
    for (size_t i = 0; i < s->count; i++) {
        for (int c = 0; c < 3; c++)
            light[i].light[c] *= as->white[c];
        s->light[s->list[i]] = light[i];
    }
    if (as->between_faces)
        PELL_TRY(sum_between_faces(s, pool));
    if (s->beam && as->beams)
        PELL_TRY(sum_beams(s, pool));
    if (pell_cancelled(in->ctx))
        res = PELL_ERR_CANCELLED;

fail:
    pell_free(in->ctx, lit);
    pell_free(in->ctx, light);
    pell_free(in->ctx, thickness);
    pell_free(in->ctx, source);
    pell_free(in->ctx, single);
    return res;
}

/* Lists all samples of an object and a material that light enters: s->list in the order of their solids. `list` has room for every
 * sample. */
static enum pell_result list_group(struct transport *s, const struct indirect_sample *of, uint32_t *list)
{
    const struct pell_indirect *in = s->in;
    uint32_t *part, *order, *sorted;

    s->count = 0;
    for (size_t i = 0; i < in->num_samples; i++)
        if (s->lit[i] && same_group(in, of, &in->samples[i]))
            list[s->count++] = (uint32_t) i;
    for (size_t i = 0; i < s->count; i++)
        s->lit[list[i]] = false; /* done */
    s->list = list;
    if (!in->part)
        return PELL_OK;
    part = pell_alloc_array(in->ctx, s->count, 4 * sizeof(*part));
    if (!part)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < s->count; i++)
        part[i] = in->part[list[i]];
    order = pell_sort_keys(in->ctx, part, 1, part + s->count, part + 2 * s->count, (uint32_t) s->count);
    sorted = part + 3 * s->count;
    for (size_t i = 0; i < s->count; i++)
        sorted[i] = list[order[i]];
    memcpy(list, sorted, s->count * sizeof(*list));
    pell_free(in->ctx, part);
    return pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

/* Largest distance between the listed samples, mm. */
static float max_spacing(const struct transport *s)
{
    float spacing = 0.0f;

    for (size_t i = 0; i < s->count; i++)
        spacing = fmaxf(spacing, s->in->samples[s->list[i]].spacing);
    return spacing;
}

static enum pell_result make_whole(const struct transport *s, const struct pell_indirect_solid *as, struct profile_sum **out)
{
    const struct pell_indirect *in = s->in;
    struct pell_surface_sample *samples = scale_by_curvature(s, false);

    *out = samples ? pell_calloc(in->ctx, 1, sizeof(**out)) : NULL;
    if (*out)
        return indirect_profile_sum_make(in->ctx, samples, s->count, max_spacing(s), as->profile, &as->opposed, *out);
    pell_free(in->ctx, samples);
    return PELL_ERR_NOMEM;
}

/* Solves an object and material. Methods that integrate over the whole solid integrate over the whole object, even where light is
 * exchanged only within parts of it. */
static enum pell_result solve_group(struct transport *s, struct pell_pool *pool, const struct indirect_sample *of, uint32_t *list)
{
    const struct pell_indirect *in = s->in;
    struct profile_sum *profile_sum = NULL;
    size_t count;
    enum pell_result res;

    PELL_TRY(list_group(s, of, list));
    count = s->count;
    if (indirect_contains_another(in, of))
        return PELL_OK;
    if (s->solid[of->medium].whole_solid) {
        const struct indirect_round_parts parts = { s->sample, s->round, s->list, s->count, max_spacing(s), s->surplus };
        PELL_TRY(make_whole(s, &s->solid[of->medium], &profile_sum));
        PELL_TRY(indirect_round_parts_scale(in->ctx, pool, &s->solid[of->medium], &parts));
    }
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && (!in->part || in->part[list[end]] == in->part[list[i]]); end++)
            ;
        s->list = list + i;
        s->count = end - i;
        PELL_TRY(solve_solid(s, pool, profile_sum));
    }

fail:
    if (profile_sum)
        indirect_profile_sum_finish(profile_sum);
    pell_free(in->ctx, profile_sum);
    return res;
}

/* Radiant exitance from the depth, of one channel at a sample. */
static float exitance_at(const struct transport *s, uint32_t sample, int c)
{
    const struct indirect_solid_light *from = &s->light[sample];
    const bool whole_solid = s->solid[s->in->samples[sample].medium].whole_solid;

    return (whole_solid ? from->solved[c] : 1.0f) * from->exitance[c] + (1.0f - from->solved[c]) * s->in->gathered[sample][c];
}

/* Adds a sample to a value, with this weight. */
static void blend(const struct transport *s, uint32_t sample, float weight, struct pell_indirect_inside *to)
{
    const struct indirect_solid_light *from = &s->light[sample];
    const struct pell_indirect_solid *solid = &s->solid[s->in->samples[sample].medium];
    const struct pell_opposed *opposed = &solid->opposed;
    const bool whole_solid = solid->whole_solid;

    for (int c = 0; c < 3; c++) {
        const float solved = weight * from->solved[c];
        to->transmitted[c] += weight * s->in->gathered[sample][c];
        to->sum_weight[c] += weight * s->sum_weight[sample][c];
        if (opposed->depth[c] > 0.0f)
            to->deep[c] += weight * (1.0f + from->solved[c] * (from->deep[c] - 1.0f)) *
                           fminf(PASSED_FRACTION * s->thickness[sample] / opposed->depth[c], 1.0f);
        to->solved[c] += solved;
        if (whole_solid)
            to->thin[c] += weight * (1.0f - from->solved[c]) * s->surplus[sample][c];
        else
            to->entered[c] += weight * from->entered[c];
        to->gain[c] += solved * from->gain[c];
        to->light[c] += (whole_solid ? solved : weight) * from->light[c];
    }
}

static void blend_beam(const struct pell_indirect_beam *from, float weight, struct pell_indirect_beam *to)
{
    for (int c = 0; c < 3; c++) {
        to->light[c] += weight * from->light[c];
        to->cosine[c] += weight * from->cosine[c];
        vec3_store(vec3_mad(vec3_load(to->direction[c]), weight, vec3_load(from->direction[c])), to->direction[c]);
    }
    to->spacing += weight * from->spacing;
}

/* Sets the directional distribution of light that leaves, except for the part that depends on the medium alone. */
static void set_tilt(const struct transport *s, const struct indirect_near *near, struct pell_indirect_inside *to)
{
    const struct pell_indirect_solid *solid = near->weight[0] > 0.0f ? &s->solid[s->in->samples[near->sample[0]].medium] : NULL;
    float light[INDIRECT_NEAR][3], along_surface[3];

    if (!solid || !solid->profile)
        return;
    for (int k = 0; k < INDIRECT_NEAR && near->weight[k] > 0.0f; k++)
        for (int c = 0; c < 3; c++)
            light[k][c] = exitance_at(s, near->sample[k], c);
    indirect_tilt(s->in, near, &solid->opposed, light, to->deep, to->tilt, along_surface);
    for (int c = 0; c < 3; c++)
        to->deep[c] *= 1.0f - along_surface[c];
}

static void interpolate(const struct transport *s)
{
    const struct pell_indirect *in = s->in;

    for (size_t i = 0; i < in->num_values && !pell_cancelled_at(in->ctx, i); i++) {
        const struct indirect_near *near = &in->near[i];
        struct pell_indirect_inside *to = &in->inside[i].value;
        memset(to, 0, sizeof(*to));
        if (s->beam)
            memset(&in->beam[i], 0, sizeof(in->beam[i]));
        for (int k = 0; k < INDIRECT_NEAR && near->weight[k] > 0.0f; k++) {
            blend(s, near->sample[k], near->weight[k], to);
            if (s->beam)
                blend_beam(&s->beam[near->sample[k]], near->weight[k], &in->beam[i]);
        }
        set_tilt(s, near, to);
    }
}

/* Allocates the forward-scattered light, and its model for each material. */
static enum pell_result create_beams(struct transport *s)
{
    struct pell_indirect *in = s->in;
    const size_t count = in->p.scene->num_materials;
    bool any = false;

    for (size_t i = 0; i < count; i++)
        any |= s->solid[i].beams;
    if (!any) {
        pell_free(in->ctx, in->beam);
        pell_free(in->ctx, in->forward);
        in->beam = NULL;
        in->forward = NULL;
        return PELL_OK;
    }
    in->beam = in->beam ? in->beam : pell_calloc(in->ctx, in->num_values, sizeof(*in->beam));
    in->forward = in->forward ? in->forward : pell_alloc_array(in->ctx, count, sizeof(*in->forward));
    s->beam = pell_calloc(in->ctx, in->num_samples, sizeof(*s->beam));
    if (!in->beam || !in->forward || !s->beam)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < count; i++) {
        const struct pell_indirect_solid *as = &s->solid[i];
        in->forward[i] = (struct pell_indirect_forward) { .model = as->forward, .active = as->beams };
        for (int c = 0; c < 3 && as->beams; c++) {
            in->forward[i].separation[c] = pell_forward_separation(&as->forward, &as->opposed, c);
            in->forward[i].exitance_scale[c] = in->forward[i].separation[c] * as->forward.exitance * as->white[c];
        }
    }
    return PELL_OK;
}

enum pell_result pell_indirect_solve_solids(struct pell_indirect *in, struct pell_pool *pool, const struct pell_indirect_lights *lights,
                                            const struct pell_indirect_solid *solid, float mix)
{
    const size_t n = in->num_samples;
    struct transport s = { .in = in, .lights = lights, .solid = solid, .mix = mix };
    uint32_t *list = pell_alloc_array(in->ctx, n, sizeof(*list));
    enum pell_result res = PELL_ERR_NOMEM;

    s.sample = pell_alloc_array(in->ctx, n, sizeof(*s.sample));
    s.albedo = pell_alloc_array(in->ctx, n, sizeof(*s.albedo));
    s.round = pell_alloc_array(in->ctx, n, sizeof(*s.round));
    s.crossed = pell_alloc_array(in->ctx, n, sizeof(*s.crossed));
    s.surplus = pell_calloc(in->ctx, n, sizeof(*s.surplus));
    s.source = pell_alloc_array(in->ctx, n, sizeof(*s.source));
    s.single = pell_alloc_array(in->ctx, n, sizeof(*s.single));
    s.diffuse = pell_alloc_array(in->ctx, n, sizeof(*s.diffuse));
    s.lit = pell_calloc(in->ctx, n, sizeof(*s.lit));
    s.sum_weight = pell_calloc(in->ctx, n, sizeof(*s.sum_weight));
    s.thickness = pell_calloc(in->ctx, n, sizeof(*s.thickness));
    s.light = pell_calloc(in->ctx, n, sizeof(*s.light));
    if (!list || !s.sample || !s.albedo || !s.round || !s.crossed || !s.source || !s.single || !s.diffuse || !s.lit || !s.sum_weight ||
        !s.thickness || !s.light || !s.surplus)
        goto fail;
    PELL_TRY(create_beams(&s));
    memset(in->gathered, 0, n * sizeof(*in->gathered));
    pell_pool_run(pool, chunks_of(n), enter_chunk, &s);
    for (size_t i = 0; i < n; i++)
        if (s.lit[i])
            PELL_TRY(solve_group(&s, pool, &in->samples[i], list));
    interpolate(&s);
    res = pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(in->ctx, list);
    pell_free(in->ctx, s.sample);
    pell_free(in->ctx, s.albedo);
    pell_free(in->ctx, s.round);
    pell_free(in->ctx, s.surplus);
    pell_free(in->ctx, s.crossed);
    pell_free(in->ctx, s.source);
    pell_free(in->ctx, s.single);
    pell_free(in->ctx, s.diffuse);
    pell_free(in->ctx, s.lit);
    pell_free(in->ctx, s.sum_weight);
    pell_free(in->ctx, s.thickness);
    pell_free(in->ctx, s.light);
    pell_free(in->ctx, s.beam);
    return res;
}
