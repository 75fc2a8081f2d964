/* SPDX-License-Identifier: MIT
 * jimenez.c - `pellucid-bench jimenez-7.2`: table 7.2 of Jimenez and Gutierrez, "Screen-Space Subsurface Scattering" (GPU Pro, 2010):
 * screen-space and texture-space by number of heads, number of lights and distance, without and with 8 samples per pixel; heads far
 * away, hidden by a plane and outside of the image; marble; 200 leaves; bloom and depth of field in the same frame. Lights move in every
 * frame, so that cached lighting of a map would not be valid. (The paper, on a GeForce 8600M GS: 5 heads 50 against 29 frames/s, 6
 * lights 69 against 54, far 220 against 120, 10 heads far 3.6 times as fast, 5 heads behind a plane 2 times, 5 busts of marble 2.8
 * times.) */
#include "papers.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define HEADS 10 /* of the scene, before its plane */
#define LIGHTS 6
#define NEAR 780.0f /* mm from the camera to the first row of heads; medium and far are 3 and 9 times as much */
#define MANY 8      /* samples per pixel */
#define REPEATS 3   /* frames, at most */
#define LEAVES 200
#define CROWN_RADIUS 330.0f       /* mm */
#define CROWN_DISTANCE 2340.0f    /* mm, from the camera to its middle */
#define GOLDEN_ANGLE 3.883222077f /* rad from a leaf to the next: 2 pi (golden ratio - 1) */

enum visibility { IN_SIGHT, HIDDEN, ASIDE };

struct crowd {
    const char *name;
    int heads, lights;
    float distance; /* in multiples of NEAR */
    enum visibility visibility;
};

/* Stages that depend on neither the lights nor the camera: once per scene. */
static bool is_once(const char *stage)
{
    static const char *const names[] = { "prepare", "curvature", "contact shadow", "indirect links", "layout" };

    for (size_t i = 0; i < PELL_COUNT(names); i++)
        if (strcmp(stage, names[i]) == 0)
            return true;
    return false;
}

static double frame_ms(const struct pell_render_result *p)
{
    double sum = 0.0;

    for (size_t k = 0; k < p->num_stages; k++)
        sum += is_once(p->stages[k].name) ? 0.0 : p->stages[k].ms;
    return sum;
}

/* A subset of the scene, seen from the given position. `all`: the whole scene. */
static enum pell_result gather(struct bench *b, const struct pell_scene *all, const struct crowd *crowd)
{
    const bool plane = crowd->visibility == HIDDEN;
    struct pell_scene *s = b->s.scene;
    struct pell_camera *c = &s->cameras[0];

    s->meshes = all->meshes + (plane ? 0 : 1);
    s->num_meshes = (size_t) crowd->heads + plane;
    s->num_lights = (size_t) crowd->lights;
    c->position[2] = plane ? -NEAR * crowd->distance : NEAR * crowd->distance; /* the plane hides the heads */
    c->forward[0] = crowd->visibility == ASIDE ? 1.0f : 0.0f;
    c->forward[2] = crowd->visibility == ASIDE ? 0.0f : plane ? 1.0f : -1.0f;
    return pell_renderer_set_scene(b->s.renderer, s);
}

/* A frame after a change of lights, preceded by one that touched all memory; the stages of the last one are left in *p. */
static enum pell_result measure_frames(struct bench *b, const char *method, double *ms, struct pell_render_result *p)
{
    double times[REPEATS];
    const int repeats = b->repeats < REPEATS ? b->repeats : REPEATS;
    enum pell_result res;

    PELL_TRY(bench_choose(b, method, ""));
    PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, p));
    for (int i = 0; i < repeats; i++) {
        b->s.settings.seed++; /* lighting is kept for one seed */
        PELL_TRY(bench_frame(b->s.renderer, &b->s.settings, p));
        times[i] = frame_ms(p);
    }
    *ms = bench_median(times, repeats);

fail:
    return res;
}

static enum pell_result compare_methods(struct bench *b, const struct crowd *crowd, int msaa)
{
    static const char *const methods[] = { "screen-space", "texture-space" };
    struct pell_render_result p;
    double first = 0.0, ms;
    enum pell_result res;

    b->s.settings.msaa = msaa;
    for (size_t i = 0; i < PELL_COUNT(methods); i++) {
        char name[96];
        struct row *r;
        PELL_TRY(measure_frames(b, methods[i], &ms, &p));
        snprintf(name, sizeof(name), "%s, %dx, %s", crowd->name, msaa, methods[i]);
        r = bench_add(&b->rows, name, ms);
        if (i == 0) {
            first = ms;
        } else if (r && first > 0.0) {
            r->ratio = ms / first;
            r->against = methods[0];
        }
    }

fail:
    return res;
}

/* Times of bloom, depth of field and scattering in one frame: figure 7.2 of the paper. */
static enum pell_result add_effects(struct bench *b, const struct pell_scene *all)
{
    static const struct crowd three = { "3 heads", 3, 2, 3.0f, IN_SIGHT };
    struct pell_render_result p;
    double ms;
    enum pell_result res;

    b->s.settings.msaa = 1;
    b->s.settings.bloom = 0.05f;
    b->s.settings.dof = true;
    PELL_TRY(gather(b, all, &three));
    PELL_TRY(measure_frames(b, "screen-space", &ms, &p));
    bench_add(&b->rows, "3 heads with bloom and depth of field, 1x", ms);
    bench_add(&b->rows, "  scattering alone", bench_own_ms(&p));
    for (size_t k = 0; k < p.num_stages; k++)
        if (strcmp(p.stages[k].name, "bloom") == 0 || strcmp(p.stages[k].name, "depth of field") == 0) {
            char name[96];
            snprintf(name, sizeof(name), "  %s", p.stages[k].name);
            bench_add(&b->rows, name, p.stages[k].ms);
        }
    b->s.settings.bloom = 0.0f;
    b->s.settings.dof = false;

fail:
    return res;
}

/* All rows of the table for the scene that is open now. */
static enum pell_result run_crowds(struct bench *b, const struct crowd *crowds, size_t count, int msaa)
{
    struct pell_scene *s = b->s.scene;
    const struct pell_scene whole = *s;
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < count && res == PELL_OK; i++) {
        res = gather(b, &whole, &crowds[i]);
        if (res == PELL_OK)
            res = compare_methods(b, &crowds[i], msaa);
    }
    if (count > 1 && msaa == 1 && res == PELL_OK)
        res = add_effects(b, &whole);
    s->meshes = whole.meshes; /* released by the caller */
    s->num_meshes = whole.num_meshes;
    s->num_lights = whole.num_lights;
    return res;
}

static void set_up(struct bench *b)
{
    b->s.settings.width = 1280;
    b->s.settings.height = 720;
    b->s.settings.bounces = 0;
    b->s.settings.opposed = b->s.settings.curvature = false;
}

/* A copy of the mesh of one leaf, positioned on the surface of a crown with its upper side outward. It uses the first leaf's index and
 * coordinate arrays. */
static bool attach_leaf(struct pell_mesh *leaf, const struct pell_mesh *first, int i)
{
    const float height = 1.0f - (2.0f * (float) i + 1.0f) / LEAVES, around = GOLDEN_ANGLE * (float) i,
                across = sqrtf(1.0f - height * height);
    const float out[3] = { across * cosf(around), height, across * sinf(around) }, side[3] = { -sinf(around), 0.0f, cosf(around) };
    const float along[3] = { out[1] * side[2], out[2] * side[0] - out[0] * side[2], -out[1] * side[0] }; /* out x side */

    *leaf = *first;
    leaf->object = i;
    leaf->position = malloc(3 * first->num_vertices * sizeof(float));
    leaf->normal = malloc(3 * first->num_vertices * sizeof(float));
    if (!leaf->position || !leaf->normal)
        return false;
    for (size_t v = 0; v < first->num_vertices; v++) {
        const float *p = first->position + 3 * v, *n = first->normal + 3 * v;
        for (int c = 0; c < 3; c++) { /* x is the leaf's length, z its upper side */
            leaf->position[3 * v + c] = CROWN_RADIUS * out[c] + p[0] * along[c] - p[1] * side[c] + p[2] * out[c];
            leaf->normal[3 * v + c] = n[0] * along[c] - n[1] * side[c] + n[2] * out[c];
        }
    }
    return true;
}

/* Many small separate objects. */
static enum pell_result run_leaves(struct bench *b)
{
    static const struct crowd crowd = { "200 leaves", 0, 2, 0.0f, IN_SIGHT };
    struct pell_scene *s = b->s.scene;
    const struct pell_scene whole = *s;
    struct pell_camera *camera = &s->cameras[0];
    const struct pell_camera near = *camera;
    struct pell_mesh *leaves;
    enum pell_result res;

    set_up(b);
    if (s->num_meshes != 1 || s->meshes[0].tangent)
        return pell_error(b->cli->ctx, PELL_ERR_INVALID, b->path, NULL, "has %zu meshes, the bench takes one without a normal map",
                          s->num_meshes);
    leaves = calloc(LEAVES, sizeof(*leaves));
    if (!leaves)
        return PELL_ERR_NOMEM;
    for (int i = 0; i < LEAVES; i++)
        if (!attach_leaf(&leaves[i], &whole.meshes[0], i)) {
            res = PELL_ERR_NOMEM;
            goto fail;
        }
    s->meshes = leaves;
    s->num_meshes = LEAVES;
    camera->position[0] = 0.0f;
    camera->position[2] = CROWN_DISTANCE;
    for (int c = 0; c < 3; c++) {
        s->bounds_max[c] = CROWN_RADIUS + whole.bounds_max[0]; /* x is a leaf's length, the largest of it */
        s->bounds_min[c] = -s->bounds_max[c];
    }
    PELL_TRY(pell_renderer_set_scene(b->s.renderer, s));
    PELL_TRY(compare_methods(b, &crowd, 1));

fail:
    *s = whole;
    *camera = near;
    for (int i = 0; i < LEAVES; i++) {
        free(leaves[i].position);
        free(leaves[i].normal);
    }
    free(leaves);
    return res;
}

enum pell_result bench_jimenez(struct bench *b)
{
    static const struct crowd crowds[] = {
        { "1 head, 2 lights, medium", 1, 2, 3.0f, IN_SIGHT },
        { "3 heads", 3, 2, 3.0f, IN_SIGHT },
        { "5 heads", 5, 2, 3.0f, IN_SIGHT },
        { "4 lights", 1, 4, 3.0f, IN_SIGHT },
        { "6 lights", 1, 6, 3.0f, IN_SIGHT },
        { "near", 1, 2, 1.0f, IN_SIGHT },
        { "far", 1, 2, 9.0f, IN_SIGHT },
        { "10 heads, far", 10, 2, 9.0f, IN_SIGHT },
        { "5 heads behind a plane", 5, 2, 3.0f, HIDDEN },
        { "5 heads outside of the picture", 5, 2, 3.0f, ASIDE },
    };
    static const struct crowd busts = { "5 heads of marble", 5, 2, 3.0f, IN_SIGHT };
    enum { OF_TABLE = 7 }; /* including those with 8 samples per pixel */
    const struct pell_scene *s = b->s.scene;
    enum pell_result res;

    if (s->num_meshes != 1 + HEADS || s->num_lights != LIGHTS)
        return pell_error(b->cli->ctx, PELL_ERR_INVALID, b->path, NULL,
                          "has %zu meshes and %zu lights, the bench takes a plane, %d heads and %d lights", s->num_meshes, s->num_lights,
                          HEADS, LIGHTS);
    set_up(b);
    snprintf(
        b->setup, sizeof(b->setup),
        "medians of at most %d frames whose lights have moved: irradiance, scattering, composite; without indirect light, curvature and "
        "opposed faces; 1280 x 720",
        REPEATS);
    PELL_TRY(run_crowds(b, crowds, PELL_COUNT(crowds), 1));
    PELL_TRY(run_crowds(b, crowds, OF_TABLE, MANY));
    if (bench_open(b, "marble") != EXIT_OK)
        return PELL_ERR_INVALID;
    set_up(b);
    PELL_TRY(run_crowds(b, &busts, 1, 1));
    res = bench_run_sibling(b, "-leaves", run_leaves);

fail:
    return res;
}
