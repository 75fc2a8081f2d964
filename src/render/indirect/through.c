/* SPDX-License-Identifier: MIT
 *
 * through.c - light that goes through solids, between samples of their surfaces:
 *
 *     M(x) = Sum_i K(x, x_i) E(x_i) spacing_i^2          K: of optics/medium/opposed.h, between faces that don't look the same way
 *
 * over an octree of the samples of each object and material, and from samples to knots as indirect light goes. Neither depends on the view.
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
#define ERROR 0.25f    /* sr: solid angle of a node that counts as one */
#define MEAN 0.5f      /* least squared length of the mean of a node's normals */
#define FAR 14.0f      /* diffusion lengths: beyond, nothing goes through */
#define THIN_LOW 2.0f  /* thickness of a part in distances of samples: below it a slab's T is taken, */
#define THIN_HIGH 4.0f /* and above it the sum */
#define DEEP_LOW 3.0f  /* thickness in diffusion lengths of a channel: below it a slab's T is taken, */
#define DEEP_HIGH 6.0f /* and above it, where little but what comes from the rim gets through, the sum */

#define DIFFUSE_LOW 3.0f  /* thickness in mean free paths less that in diffusion lengths: light that is seldom absorbed is diffuse */
#define DIFFUSE_HIGH 4.5f /* from here on, and then comes from aside as much */

#define SOONER 3.0f    /* of the thickness where the sum takes over, for light that is scattered forward, */
#define SCATTERS 0.85f /* from this exponent on, in mean free paths */

#define PASSING 0.1f /* over mean free paths, see optics/medium/passing.h */

struct send {
    struct pell_indirect *in;
    const struct pell_indirect_lights *lights;
    const struct pell_indirect_solid *solid; /* of scene materials */
    struct pell_lit_place *sample;           /* of each of the stage's, its power not scaled by curvature */
    float (*gain)[3], (*crossed)[3];         /* curvature/stage.h */
    bool *there;
    float (*thick)[3], *thickness;  /* of samples; thickness mm */
    float (*source)[3], (*once)[3]; /* W/m^2 times mm^2: of a sample's power, what goes into the depth, and what is scattered once */
    float *diffuse;                 /* how much of the former has no direction */
    struct indirect_solid_light *light;
    struct pell_indirect_beam *beam; /* NULL: nothing is scattered forward */
    const uint32_t *list;            /* of one object and material, or a solid of it */
    size_t count;
    struct pell_light_tree tree;
    struct pell_lit_place *node; /* its nodes, each as one place */
};

static int chunks_of(size_t count)
{
    return (int) ((count + CHUNK - 1) / CHUNK);
}

/* How far samples are near enough to each other for a sum over a part. */
static float fine_enough(float thinness, float spacing)
{
    return smooth_ramp(THIN_LOW, THIN_HIGH, thinness > 0.0f ? 1.0f / (thinness * spacing) : THIN_HIGH);
}

/* Where little is scattered, and forward, a slab's T sends it to all sides: the sum takes over sooner. */
static float sooner(const struct pell_indirect_solid *as, int c)
{
    return as->beams && as->forward.unscattered[c] > 0.0f
               ? 1.0f + (SOONER - 1.0f) * smooth_ramp(SCATTERS, 1.0f, as->law.kappa[c] * as->law.depth[c])
               : 1.0f;
}

/* How far the sum over places holds for a part as thin as this. */
static float sum_holds(const struct pell_indirect_solid *as, float thinness, int c)
{
    const float kappa = as->law.kappa[c];

    return fmaxf(smooth_ramp(DEEP_LOW, DEEP_HIGH, sooner(as, c) * kappa / thinness),
                 smooth_ramp(DIFFUSE_LOW, DIFFUSE_HIGH, (1.0f / as->law.depth[c] - kappa) / thinness));
}

/* Share of what gets through that the sum finds best: all in parts that are deep for a channel, where light comes from the rim, too, or
 * where diffusion holds; none where samples are too far apart. */
static void deep_parts(const struct pell_indirect_solid *as, float thinness, float spacing, float part[3])
{
    const float fine = fine_enough(thinness, spacing);

    for (int c = 0; c < 3; c++)
        part[c] = fine * (thinness > 0.0f && as->law.depth[c] > 0.0f ? sum_holds(as, thinness, c) : 1.0f);
}

/* --- Light that enters ------------------------------------------------------------------------------------------------------------ */

/* What goes into the depth: as it falls there, not as a curved surface moves it, without what diffuse light returns by single scattering,
 * and without what a half-space returns more for its angle, since that comes of a way along the surface. */
static void find_source(const struct send *s, const struct indirect_sample *q, const struct pell_lit_place *p, float aside[3][PACKET],
                        float once[3][PACKET], size_t i, float source[3])
{
    const float off = fmaxf(1.0f + vec3_dot(q->normal, vec3_load(p->way)), 0.0f);

    for (int c = 0; c < 3; c++)
        source[c] = p->power[c] > 0.0f
                        ? fmaxf(p->power[c] - (aside[c][i] + once[c][i]) * p->area, 0.0f) / (1.0f + s->solid[q->material].slope[c] * off)
                        : 0.0f;
}

static void light16(const struct send *s, size_t first, size_t count)
{
    const struct pell_indirect *in = s->in;
    float irradiance[3][PACKET], gain[3][PACKET], crossed[3][PACKET], aside[3][PACKET], once[3][PACKET], way[3][PACKET], curvature[PACKET],
        thinness[PACKET], u[PACKET], v[PACKET], diffuse[PACKET];
    uint32_t mesh[PACKET], triangle[PACKET], number[PACKET];
    bool there[PACKET];
    const struct pell_points_params params = {
        .mix = 0.0f, .spacing = in->samples[first].spacing, .samples = 1, .opposed = true, .flat = true
    };
    const struct pell_surface_points points = { .mesh = mesh, .triangle = triangle, .u = u, .v = v, .number = number };
    const struct pell_surface_light out = { .irradiance = { irradiance[0], irradiance[1], irradiance[2] },
                                            .gain = { gain[0], gain[1], gain[2] },
                                            .crossed = { crossed[0], crossed[1], crossed[2] },
                                            .aside = { aside[0], aside[1], aside[2] },
                                            .once = { once[0], once[1], once[2] },
                                            .way = { way[0], way[1], way[2] },
                                            .diffuse = diffuse,
                                            .curvature = curvature,
                                            .thinness = thinness,
                                            .there = there };

    for (size_t i = 0; i < count; i++) {
        const struct indirect_sample *q = &in->samples[first + i];
        const float *amount = s->solid[q->material].law.amount;
        const bool is = amount[0] + amount[1] + amount[2] > 0.0f;
        mesh[i] = is && !q->back ? q->mesh : PELL_NO_HIT;
        triangle[i] = q->triangle;
        u[i] = q->u;
        v[i] = q->v;
        number[i] = (uint32_t) (first + i);
    }
    s->lights->light_points(s->lights->engine, &params, &points, count, &out);
    for (size_t i = 0; i < count; i++) {
        const struct indirect_sample *q = &in->samples[first + i];
        struct pell_lit_place *p = &s->sample[first + i];
        p->area = q->spacing * q->spacing;
        p->curvature = curvature[i];
        vec3_store(q->position, p->position);
        vec3_store(q->normal, p->normal);
        for (int c = 0; c < 3; c++) {
            p->power[c] = there[i] ? irradiance[c][i] * p->area : 0.0f;
            p->way[c] = there[i] ? way[c][i] : 0.0f;
            s->gain[first + i][c] = gain[c][i];
            s->crossed[first + i][c] = crossed[c][i];
            s->once[first + i][c] = there[i] ? once[c][i] * p->area : 0.0f;
        }
        find_source(s, q, p, aside, once, i, s->source[first + i]);
        s->diffuse[first + i] = there[i] ? diffuse[i] : 0.0f;
        s->there[first + i] = there[i];
        s->thickness[first + i] = thinness[i] > 0.0f ? 1.0f / thinness[i] : INFINITY;
        if (s->solid[q->material].between)
            deep_parts(&s->solid[q->material], thinness[i], q->spacing, s->thick[first + i]);
    }
}

static void light_chunk(void *arg, int index, int worker)
{
    const struct send *s = arg;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < s->in->num_samples ? first + CHUNK : s->in->num_samples;

    (void) worker;
    for (size_t i = first; i < end; i += PACKET)
        light16(s, i, end - i < PACKET ? end - i : PACKET);
}

/* --- From sample to sample -------------------------------------------------------------------------------------------------------- */

/* What goes through to a sample. */
struct gathered {
    float light[3]; /* W/m^2 */
    float even[3];  /* of even light on the faces that it comes from, over that light */
};

static void add_pair(const struct pell_opposed *law, const struct indirect_sample *to, const struct pell_lit_place *from,
                     struct gathered *g)
{
    const struct pell_vec3 v = vec3_sub(to->position, vec3_load(from->position)), n = vec3_load(from->normal), w = vec3_load(from->way);
    const struct pell_vec3 t = vec3_mad(w, -vec3_dot(w, n), n);
    const struct pell_opposed_pair pair = { vec3_dot(v, v),          vec3_dot(n, v),  vec3_dot(to->normal, v),
                                            vec3_dot(to->normal, n), from->curvature, vec3_dot(t, v),
                                            vec3_dot(t, to->normal), vec3_dot(t, t),  from->area };
    const float unseen = pell_opposed_unseen(pair.facing), far2 = FAR * FAR;
    float through[3];
    bool is[3], any = false;

    for (int c = 0; c < 3; c++) {
        is[c] = law->amount[c] > 0.0f && law->kappa[c] * law->kappa[c] * pair.distance2 < far2;
        any |= is[c];
    }
    if (!any || !(unseen > 0.0f))
        return;
    pell_opposed_split_of(law, &pair, is, through);
    for (int c = 0; c < 3; c++) {
        g->light[c] += unseen * through[c] * from->power[c];
        g->even[c] += unseen * through[c] * from->area;
    }
}

/* Squared distance beyond which nothing goes through in any channel. */
static float reach2(const struct pell_opposed *law)
{
    float least = INFINITY;

    for (int c = 0; c < 3; c++)
        if (law->amount[c] > 0.0f)
            least = fminf(least, law->kappa[c] * law->kappa[c]);
    return 1.001f * FAR * FAR / least; /* rounding is far less than that */
}

static void gather(const struct send *s, const struct pell_opposed *law, const struct indirect_sample *to, struct gathered *g)
{
    const struct pell_light_tree *t = &s->tree;
    const float p[3] = { to->position.x, to->position.y, to->position.z }, far2 = reach2(law);

    for (uint32_t i = 0; i < (uint32_t) t->num_nodes;) {
        const struct pell_light_node *n = &t->nodes[i];
        const struct pell_vec3 v = vec3_sub(to->position, vec3_load(n->centre)), mean = vec3_load(n->normal);
        if (!(n->power[0] + n->power[1] + n->power[2] > 0.0f) || pell_light_node_distance2(n, p) > far2) {
            i = n->next;
        } else if (n->area < ERROR * vec3_dot(v, v) && vec3_dot(mean, mean) > MEAN) {
            add_pair(law, to, &s->node[i], g);
            i = n->next;
        } else if (n->count) {
            for (uint32_t k = n->first; k < n->first + n->count; k++)
                add_pair(law, to, &t->samples[k], g);
            i = n->next;
        } else {
            i++;
        }
    }
}

static void gather_chunk(void *arg, int index, int worker)
{
    const struct send *s = arg;
    const size_t first = (size_t) index * CHUNK;

    (void) worker;
    for (size_t i = first; i < first + CHUNK && i < s->count; i++) {
        const struct indirect_sample *to = &s->in->samples[s->list[i]];
        const float *solved = s->light[s->list[i]].solved, *thick = s->thick[s->list[i]];
        struct pell_opposed law = s->solid[to->material].law;
        struct gathered g = { { 0.0f }, { 0.0f } };
        for (int c = 0; c < 3; c++)
            law.amount[c] = solved[c] < 1.0f && thick[c] > 0.0f ? law.amount[c] : 0.0f;
        if (law.amount[0] + law.amount[1] + law.amount[2] > 0.0f)
            gather(s, &law, to, &g);
        for (int c = 0; c < 3; c++) {
            const float most = s->solid[to->material].returned[c];
            s->in->gathered[s->list[i]][c] = thick[c] * s->crossed[s->list[i]][c] * g.light[c] *
                                             (g.even[c] > most ? most / g.even[c] : 1.0f) * s->solid[to->material].white[c];
        }
    }
}

/* --- Objects and their materials ---------------------------------------------------------------------------------------------------- */

static bool together(const struct pell_indirect *in, const struct indirect_sample *a, const struct indirect_sample *b)
{
    return a->material == b->material && in->p.scene->meshes[a->mesh].object == in->p.scene->meshes[b->mesh].object;
}

/* The light of the list's samples as curvature scales it. */
static struct pell_lit_place *scaled(const struct send *s, bool deep)
{
    struct pell_lit_place *out = pell_alloc_array(s->in->ctx, s->count, sizeof(*out));

    for (size_t i = 0; out && i < s->count; i++) {
        out[i] = s->sample[s->list[i]];
        for (int c = 0; c < 3; c++)
            out[i].power[c] = (deep ? s->source[s->list[i]][c] : out[i].power[c]) * s->gain[s->list[i]][c];
    }
    return out;
}

/* Sums what goes between faces, where what was solved is not all. */
static enum pell_result send_between(struct send *s, struct pell_pool *pool)
{
    struct pell_lit_place *samples = scaled(s, true);
    enum pell_result res;

    if (!samples)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_light_tree_make(s->in->ctx, samples, s->count, &s->tree));
    s->node = pell_alloc_array(s->in->ctx, s->tree.num_nodes, sizeof(*s->node));
    for (size_t i = 0; s->node && i < s->tree.num_nodes; i++)
        s->node[i] = pell_light_node_place(&s->tree.nodes[i]);
    if (s->node)
        pell_pool_run(pool, chunks_of(s->count), gather_chunk, s);
    res = s->node ? PELL_OK : PELL_ERR_NOMEM;

fail:
    pell_free(s->in->ctx, s->node);
    s->node = NULL;
    pell_light_tree_finish(&s->tree);
    return res;
}

/* What of a sample's light is scattered forward: all that has a direction, and of diffuse light what a slab's T does not have. */
static void aim_beam(const struct send *s, const struct pell_indirect_solid *as, uint32_t sample, struct pell_lit_place *p)
{
    const float *thick = s->thick[sample];
    float less = 0.0f;

    memcpy(p->power, s->source[sample], sizeof(p->power));
    for (int c = 0; c < 3 && as->between; c++) {
        const float by_slab = s->diffuse[sample] * (1.0f - thick[c]);
        p->power[c] *= 1.0f - by_slab;
        less += by_slab * (1.0f / 3.0f);
    }
    vec3_store(vec3_mul(vec3_mad(vec3_load(p->way), less * as->refracted, vec3_load(p->normal)), 1.0f / fmaxf(1.0f - less, 1e-6f)), p->way);
}

/* Sums what is scattered forward. */
static enum pell_result send_beams(const struct send *s, struct pell_pool *pool)
{
    const struct pell_indirect_solid *as = &s->solid[s->in->samples[s->list[0]].material];
    const struct indirect_forward forward = { s->in, &as->forward, s->list, s->thickness, s->count };
    struct pell_lit_place *samples = pell_alloc_array(s->in->ctx, s->count, sizeof(*samples));
    enum pell_result res = PELL_OK;

    if (!samples)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < s->count; i++) {
        samples[i] = s->sample[s->list[i]];
        aim_beam(s, as, s->list[i], &samples[i]);
    }
    PELL_TRY(indirect_forward_send(pool, &forward, samples, s->beam));
    for (size_t i = 0; i < s->count; i++) {
        const struct indirect_sample *to = &s->in->samples[s->list[i]];
        struct pell_indirect_beam *beam = &s->beam[s->list[i]];
        const float *share = s->in->ahead[to->material].share;
        beam->spacing = to->spacing;
        for (int c = 0; c < 3; c++) {
            beam->light[c] *= share[c];
            beam->turned[c] *= share[c];
            vec3_store(vec3_mul(vec3_load(beam->way[c]), share[c]), beam->way[c]);
        }
    }

fail:
    return res;
}

/* Whether most of a mesh lies inside of an object: what its normals meet first is that object's inner side. */
static bool lies_inside(const struct pell_indirect *in, const struct pell_mesh *m, int object)
{
    const struct pell_scene *scene = in->p.scene;
    _Alignas(64) int valid[16];
    struct pell_ray_hit16 r;
    int inside = 0, count = 0;

    memset(&r, 0, sizeof(r));
    for (int i = 0; i < 16; i++) {
        const uint32_t t = (uint32_t) ((uint64_t) i * m->num_triangles / 16);
        struct pell_vec3 p[3], n, at;
        pell_triangle_corners(m, t, p);
        n = vec3_normalize(pell_triangle_cross(p));
        at = vec3_mul(vec3_add(p[0], vec3_add(p[1], p[2])), 1.0f / 3.0f);
        valid[i] = vec3_dot(n, n) > 0.5f ? -1 : 0;
        count += valid[i] != 0;
        pell_ray16_set(&r.ray, i, vec3_mad(at, indirect_clearance(at, 0.0f), n), n, INFINITY);
        r.hit.mesh[i] = PELL_NO_HIT;
    }
    pell_rays_closest16(in->p.rays, valid, false, &r);
    for (int i = 0; i < 16; i++)
        inside += valid[i] && pell_hit16_inside(scene, &r, i, object);
    return 2 * inside > count;
}

/* Whether anything else is inside of a solid, as bones are: diffusion is not solved around it, and methods' own ways end there. */
static bool holds_another(const struct pell_indirect *in, const struct indirect_sample *of)
{
    const struct pell_scene *scene = in->p.scene;
    const int object = scene->meshes[of->mesh].object;
    bool holds = false;

    for (size_t i = 0; i < scene->num_meshes && !holds; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (m->num_triangles > 0 && (m->object != object || (uint32_t) m->material != of->material))
            holds = lies_inside(in, m, object);
    }
    return holds;
}

/* Of the samples that s->list holds, those of one solid. */
static enum pell_result send_solid(struct send *s, struct pell_pool *pool, struct whole *whole)
{
    struct pell_indirect *in = s->in;
    const struct pell_indirect_solid *as = &s->solid[in->samples[s->list[0]].material];
    struct indirect_solid solid = { .profile = as->profile, .law = &as->law, .whole = whole, .around = as->around, .count = s->count };
    struct pell_lit_place *lit = pell_alloc_array(in->ctx, s->count, sizeof(*lit));
    struct indirect_solid_light *light = pell_alloc_array(in->ctx, s->count, sizeof(*light));
    float *thickness = pell_alloc_array(in->ctx, s->count, sizeof(*thickness));
    float(*source)[3] = pell_alloc_array(in->ctx, s->count, sizeof(*source));
    float(*once)[3] = pell_alloc_array(in->ctx, s->count, sizeof(*once));
    enum pell_result res = PELL_ERR_NOMEM;

    if (!lit || !light || !thickness || !source || !once)
        goto fail;
    for (size_t i = 0; i < s->count; i++) {
        lit[i] = s->sample[s->list[i]];
        thickness[i] = s->thickness[s->list[i]];
        memcpy(source[i], s->source[s->list[i]], sizeof(source[i]));
        memcpy(once[i], s->once[s->list[i]], sizeof(once[i]));
        solid.spacing = fmaxf(solid.spacing, in->samples[s->list[i]].spacing);
    }
    solid.samples = lit;
    solid.thickness = thickness;
    solid.source = (const float(*)[3]) source;
    solid.once = (const float(*)[3]) once;
    solid.slope = as->slope;
    PELL_TRY(indirect_solid_solve(in->ctx, pool, &solid, light));
    for (size_t i = 0; i < s->count; i++) {
        for (int c = 0; c < 3; c++)
            light[i].light[c] *= as->white[c];
        s->light[s->list[i]] = light[i];
    }
    if (as->between)
        PELL_TRY(send_between(s, pool));
    if (s->beam && as->beams)
        PELL_TRY(send_beams(s, pool));
    if (pell_cancelled(in->ctx))
        res = PELL_ERR_CANCELLED;

fail:
    pell_free(in->ctx, lit);
    pell_free(in->ctx, light);
    pell_free(in->ctx, thickness);
    pell_free(in->ctx, source);
    pell_free(in->ctx, once);
    return res;
}

/* All samples of an object and a material that light goes into: s->list in the order of their solids. `list` has room for every sample. */
static enum pell_result list_group(struct send *s, const struct indirect_sample *of, uint32_t *list)
{
    const struct pell_indirect *in = s->in;
    uint32_t *part, *order, *sorted;

    s->count = 0;
    for (size_t i = 0; i < in->num_samples; i++)
        if (s->there[i] && together(in, of, &in->samples[i]))
            list[s->count++] = (uint32_t) i;
    for (size_t i = 0; i < s->count; i++)
        s->there[list[i]] = false; /* done */
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

static enum pell_result make_whole(const struct send *s, const struct pell_indirect_solid *as, struct whole **out)
{
    const struct pell_indirect *in = s->in;
    struct pell_lit_place *samples = scaled(s, false);
    float spacing = 0.0f;

    *out = samples ? pell_calloc(in->ctx, 1, sizeof(**out)) : NULL;
    for (size_t i = 0; i < s->count; i++)
        spacing = fmaxf(spacing, in->samples[s->list[i]].spacing);
    if (*out)
        return indirect_whole_make(in->ctx, samples, s->count, spacing, as->profile, &as->law, *out);
    pell_free(in->ctx, samples);
    return PELL_ERR_NOMEM;
}

/* Methods that ask the whole solid ask the whole object, also where light goes to and fro in parts of it alone. */
static enum pell_result send_group(struct send *s, struct pell_pool *pool, const struct indirect_sample *of, uint32_t *list)
{
    const struct pell_indirect *in = s->in;
    struct whole *whole = NULL;
    size_t count;
    enum pell_result res;

    PELL_TRY(list_group(s, of, list));
    count = s->count;
    if (holds_another(in, of))
        return PELL_OK;
    if (s->solid[of->material].all)
        PELL_TRY(make_whole(s, &s->solid[of->material], &whole));
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && (!in->part || in->part[list[end]] == in->part[list[i]]); end++)
            ;
        s->list = list + i;
        s->count = end - i;
        PELL_TRY(send_solid(s, pool, whole));
    }

fail:
    if (whole)
        indirect_whole_finish(whole);
    pell_free(in->ctx, whole);
    return res;
}

/* Light from the depth of a channel at a sample. */
static float light_at(const struct send *s, uint32_t sample, int c)
{
    const struct indirect_solid_light *from = &s->light[sample];

    return from->solved[c] * from->all[c] + (1.0f - from->solved[c]) * s->in->gathered[sample][c];
}

/* Adds a sample of this weight to a value. */
static void blend(const struct send *s, uint32_t sample, float weight, struct pell_indirect_inside *to)
{
    const struct indirect_solid_light *from = &s->light[sample];
    const struct pell_opposed *law = &s->solid[s->in->samples[sample].material].law;

    for (int c = 0; c < 3; c++) {
        const float solved = weight * from->solved[c];
        to->through[c] += weight * s->in->gathered[sample][c];
        to->thick[c] += weight * s->thick[sample][c];
        if (law->depth[c] > 0.0f)
            to->deep[c] +=
                weight * (1.0f + from->solved[c] * (from->deep[c] - 1.0f)) * fminf(PASSING * s->thickness[sample] / law->depth[c], 1.0f);
        to->solved[c] += solved;
        to->gain[c] += solved * from->gain[c];
        to->light[c] += solved * from->light[c];
    }
}

static void blend_beam(const struct pell_indirect_beam *from, float weight, struct pell_indirect_beam *to)
{
    for (int c = 0; c < 3; c++) {
        to->light[c] += weight * from->light[c];
        to->turned[c] += weight * from->turned[c];
        vec3_store(vec3_mad(vec3_load(to->way[c]), weight, vec3_load(from->way[c])), to->way[c]);
    }
    to->spacing += weight * from->spacing;
}

/* Directions in which light from the depth leaves, but for what depends on the medium alone. */
static void turn_aside(const struct send *s, const struct indirect_near *near, struct pell_indirect_inside *to)
{
    const struct pell_indirect_solid *solid = near->weight[0] > 0.0f ? &s->solid[s->in->samples[near->sample[0]].material] : NULL;
    float light[INDIRECT_NEAR][3], aside[3];

    if (!solid || !solid->profile)
        return;
    for (int k = 0; k < INDIRECT_NEAR && near->weight[k] > 0.0f; k++)
        for (int c = 0; c < 3; c++)
            light[k][c] = light_at(s, near->sample[k], c);
    indirect_tilt(s->in, near, &solid->law, light, to->tilt, aside);
    for (int c = 0; c < 3; c++) {
        for (int k = 0; k < 3 && solid->all; k++)
            to->tilt[c][k] *= to->deep[c]; /* what a method finds is not all from the depth */
        to->deep[c] *= 1.0f - aside[c];
    }
}

static void spread(const struct send *s)
{
    const struct pell_indirect *in = s->in;

    for (size_t i = 0; i < in->num_values && !pell_cancelled_at(in->ctx, i); i++) {
        const struct indirect_near *near = &in->near[i];
        struct pell_indirect_inside *to = &in->inside[i].of;
        memset(to, 0, sizeof(*to));
        if (s->beam)
            memset(&in->beam[i], 0, sizeof(in->beam[i]));
        for (int k = 0; k < INDIRECT_NEAR && near->weight[k] > 0.0f; k++) {
            blend(s, near->sample[k], near->weight[k], to);
            if (s->beam)
                blend_beam(&s->beam[near->sample[k]], near->weight[k], &in->beam[i]);
        }
        turn_aside(s, near, to);
    }
}

/* Room for what is scattered forward, and how that is for each material. */
static enum pell_result make_beams(struct send *s)
{
    struct pell_indirect *in = s->in;
    const size_t count = in->p.scene->num_materials;
    bool any = false;

    for (size_t i = 0; i < count; i++)
        any |= s->solid[i].beams;
    if (!any) {
        pell_free(in->ctx, in->beam);
        pell_free(in->ctx, in->ahead);
        in->beam = NULL;
        in->ahead = NULL;
        return PELL_OK;
    }
    in->beam = in->beam ? in->beam : pell_calloc(in->ctx, in->num_values, sizeof(*in->beam));
    in->ahead = in->ahead ? in->ahead : pell_alloc_array(in->ctx, count, sizeof(*in->ahead));
    s->beam = pell_calloc(in->ctx, in->num_samples, sizeof(*s->beam));
    if (!in->beam || !in->ahead || !s->beam)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < count; i++) {
        const struct pell_indirect_solid *as = &s->solid[i];
        in->ahead[i] = (struct pell_indirect_ahead) { .law = as->forward, .is = as->beams };
        for (int c = 0; c < 3 && as->beams; c++) {
            in->ahead[i].apart[c] = pell_forward_apart(&as->forward, &as->law, c);
            in->ahead[i].share[c] = in->ahead[i].apart[c] * as->forward.leaves * as->white[c];
        }
    }
    return PELL_OK;
}

enum pell_result pell_indirect_send_through(struct pell_indirect *in, struct pell_pool *pool, const struct pell_indirect_lights *lights,
                                            const struct pell_indirect_solid *solid)
{
    const size_t n = in->num_samples;
    struct send s = { .in = in, .lights = lights, .solid = solid };
    uint32_t *list = pell_alloc_array(in->ctx, n, sizeof(*list));
    enum pell_result res = PELL_ERR_NOMEM;

    s.sample = pell_alloc_array(in->ctx, n, sizeof(*s.sample));
    s.gain = pell_alloc_array(in->ctx, n, sizeof(*s.gain));
    s.crossed = pell_alloc_array(in->ctx, n, sizeof(*s.crossed));
    s.source = pell_alloc_array(in->ctx, n, sizeof(*s.source));
    s.once = pell_alloc_array(in->ctx, n, sizeof(*s.once));
    s.diffuse = pell_alloc_array(in->ctx, n, sizeof(*s.diffuse));
    s.there = pell_calloc(in->ctx, n, sizeof(*s.there));
    s.thick = pell_calloc(in->ctx, n, sizeof(*s.thick));
    s.thickness = pell_calloc(in->ctx, n, sizeof(*s.thickness));
    s.light = pell_calloc(in->ctx, n, sizeof(*s.light));
    if (!list || !s.sample || !s.gain || !s.crossed || !s.source || !s.once || !s.diffuse || !s.there || !s.thick || !s.thickness ||
        !s.light)
        goto fail;
    PELL_TRY(make_beams(&s));
    memset(in->gathered, 0, n * sizeof(*in->gathered));
    pell_pool_run(pool, chunks_of(n), light_chunk, &s);
    for (size_t i = 0; i < n; i++)
        if (s.there[i])
            PELL_TRY(send_group(&s, pool, &in->samples[i], list));
    spread(&s);
    res = pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(in->ctx, list);
    pell_free(in->ctx, s.sample);
    pell_free(in->ctx, s.gain);
    pell_free(in->ctx, s.crossed);
    pell_free(in->ctx, s.source);
    pell_free(in->ctx, s.once);
    pell_free(in->ctx, s.diffuse);
    pell_free(in->ctx, s.there);
    pell_free(in->ctx, s.thick);
    pell_free(in->ctx, s.thickness);
    pell_free(in->ctx, s.light);
    pell_free(in->ctx, s.beam);
    return res;
}
