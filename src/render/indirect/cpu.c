/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the stage: light that samples receive and send on, bounce by bounce, and its interpolation to knots.
 */
#include "render/indirect/internal.h"

#include "scene/scene.h"

#include <string.h>

#define CHUNK 256 /* samples or knots per task */

void pell_indirect_destroy(struct pell_indirect **indirect)
{
    struct pell_indirect *in = *indirect;

    if (!in)
        return;
    if (!in->p.samples_from) {
        pell_free(in->ctx, in->meshes);
        pell_free(in->ctx, in->roots);
        pell_free(in->ctx, in->cells);
        pell_free(in->ctx, in->extra);
        pell_free(in->ctx, in->same);
        pell_free(in->ctx, in->samples);
        pell_free(in->ctx, in->near);
    }
    pell_free(in->ctx, in->links);
    pell_free(in->ctx, in->specular_links);
    pell_free(in->ctx, in->reflected);
    pell_free(in->ctx, in->previous);
    pell_free(in->ctx, in->area);
    pell_free(in->ctx, in->direct);
    pell_free(in->ctx, in->albedo);
    pell_free(in->ctx, in->part);
    pell_free(in->ctx, in->opposite);
    pell_free(in->ctx, in->transmitted);
    pell_free(in->ctx, in->passed);
    pell_free(in->ctx, in->behind);
    pell_free(in->ctx, in->gathered);
    pell_free(in->ctx, in->leaving);
    pell_free(in->ctx, in->value);
    pell_free(in->ctx, in->inside);
    pell_free(in->ctx, in->beam);
    pell_free(in->ctx, in->forward);
    pell_free(in->ctx, in);
    *indirect = NULL;
}

/* Whether any ray of a sample hit a surface that can light the sample. */
static bool has_links(const struct pell_indirect *in)
{
    for (size_t i = 0; i < in->num_samples * INDIRECT_RAYS; i++)
        if (in->links[i].factor)
            return true;
    return false;
}

static void borrow_samples(struct pell_indirect *in, const struct pell_indirect *from)
{
    in->meshes = from->meshes;
    in->roots = from->roots;
    in->cells = from->cells;
    in->extra = from->extra;
    in->num_roots = from->num_roots;
    in->num_cells = from->num_cells;
    in->num_extra = from->num_extra;
    in->num_mesh_knots = from->num_mesh_knots;
    in->num_knots = from->num_knots;
    in->num_values = from->num_values;
    in->same = from->same;
    in->samples = from->samples;
    in->num_samples = from->num_samples;
    in->near = from->near;
}

static enum pell_result make_samples(struct pell_indirect *in, struct pell_pool *pool)
{
    struct indirect_spacing spacing;
    enum pell_result res;

    in->same = pell_alloc_array(in->ctx, in->p.scene->num_materials, sizeof(*in->same));
    if (!in->same)
        return PELL_ERR_NOMEM;
    pell_scene_same_media(in->p.scene, in->same);
    indirect_spacing_make(in->p.scene, &spacing);
    PELL_TRY(indirect_cells_make(in, &spacing));
    PELL_TRY(indirect_drop_buried(in, pool));
    PELL_TRY(indirect_near_make(in, pool, &spacing));

fail:
    return res;
}

enum pell_result pell_indirect_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_indirect_params *params,
                                      struct pell_indirect **out)
{
    struct pell_indirect *in = pell_zalloc(ctx, sizeof(*in));
    enum pell_result res;

    *out = in;
    if (!in)
        return PELL_ERR_NOMEM;
    in->ctx = ctx;
    in->kernels = indirect_blend_kernels_tables[pell_simd_best()];
    in->p = *params;
    if (params->samples_from)
        borrow_samples(in, params->samples_from);
    else
        PELL_TRY(make_samples(in, pool));
    if (!params->solids_only) {
        PELL_TRY(indirect_specular_make(in));
        PELL_TRY(indirect_links_make(in, pool));
    }
    if (!params->solids_only && !has_links(in)) {
        pell_indirect_destroy(out);
        return PELL_OK;
    }
    res = PELL_ERR_NOMEM;
    in->direct = pell_alloc_array(ctx, in->num_samples, sizeof(*in->direct));
    in->albedo = pell_alloc_array(ctx, in->num_samples, sizeof(*in->albedo));
    in->gathered = pell_alloc_array(ctx, in->num_samples, sizeof(*in->gathered));
    in->leaving = pell_alloc_array(ctx, in->num_samples, sizeof(*in->leaving));
    if (params->solids_only)
        in->inside = pell_calloc(ctx, in->num_values, sizeof(*in->inside));
    else
        in->value = pell_calloc(ctx, in->num_values, sizeof(*in->value));
    if (!in->direct || !in->albedo || !in->gathered || !in->leaving || (!in->inside && !in->value))
        goto fail;
    res = params->solids_only ? indirect_parts_make(in, pool) : indirect_opposite_make(in, pool);
    if (res != PELL_OK)
        goto fail;
    return PELL_OK;

fail:
    pell_indirect_destroy(out);
    return res;
}

/* --- Light ------------------------------------------------------------------------------------------------------------------------ */

struct solve {
    struct pell_indirect *in;
    const struct pell_indirect_lights *lights;
    int bounce; /* counted from 0 */
    const float (*total)[3];
};

/* Direct light that enters at 16 samples. Textures are filtered to the distance of samples. */
static void direct16(const struct solve *s, size_t first, size_t count)
{
    struct pell_indirect *in = s->in;
    float irradiance[3][16], albedo[3][16], through[3][16], gain[3][16];
    uint32_t mesh[16], triangle[16], seed[16];
    float u[16], v[16];
    bool back[16];
    const struct pell_points_params params = {
        .mix = 1.0f, .spacing = in->samples[first].spacing, .samples = 1, .local = true, .flat = true
    };
    const struct pell_surface_points points = { .mesh = mesh, .triangle = triangle, .u = u, .v = v, .seed = seed, .back = back };
    const struct pell_surface_light out = { .irradiance = { irradiance[0], irradiance[1], irradiance[2] },
                                            .albedo = { albedo[0], albedo[1], albedo[2] },
                                            .transmission = { through[0], through[1], through[2] },
                                            .gain = { gain[0], gain[1], gain[2] } };

    for (size_t i = 0; i < count; i++) {
        const struct indirect_sample *q = &in->samples[first + i];
        mesh[i] = q->mesh;
        triangle[i] = q->triangle;
        u[i] = q->u;
        v[i] = q->v;
        seed[i] = (uint32_t) (first + i);
        back[i] = q->back;
    }
    s->lights->light_points(s->lights->engine, &params, &points, count, &out);
    for (size_t i = 0; i < count; i++) {
        const uint32_t material = in->samples[first + i].medium;
        const bool opaque = in->p.scene->materials[material].opaque;
        for (int c = 0; c < 3; c++) {
            const float total = opaque ? 1.0f : s->total[material][c];
            float stays = gain[c][i], passes = through[c][i];
            if (in->opposite && in->opposite[first + i] == INDIRECT_NONE) { /* without an opposite sample it leaves here */
                stays += passes;
                passes = 0.0f;
            }
            in->direct[first + i][c] = total * stays * irradiance[c][i];
            in->albedo[first + i][c] = total * stays * albedo[c][i];
            in->leaving[first + i][c] = irradiance[c][i];
            if (in->opposite) {
                in->passed[first + i][c] = opaque ? 0.0f : total * passes;
                in->transmitted[first + i][c] = opaque ? passes : total * passes * albedo[c][i];
            }
        }
    }
}

static void direct_chunk(void *arg, int index, int worker)
{
    const struct solve *s = arg;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < s->in->num_samples ? first + CHUNK : s->in->num_samples;

    (void) worker;
    for (size_t i = first; i < end; i += 16)
        direct16(s, i, end - i < 16 ? end - i : 16);
}

/* Adds direct light that leaves on the other side of a solid. For sheets it is included already. */
static void transmit_direct(struct pell_indirect *in)
{
    for (size_t i = 0; in->opposite && i < in->num_samples; i++)
        for (int c = 0; c < 3 && in->opposite[i] != INDIRECT_NONE; c++)
            in->direct[i][c] += in->passed[i][c] * in->leaving[in->opposite[i]][c];
}

/* Computes the exitance of samples after n bounces. */
static void update_exitance(struct pell_indirect *in, int n)
{
    if (in->previous && n > 0)
        memcpy(in->previous, in->leaving, in->num_samples * sizeof(*in->previous));
    for (size_t i = 0; i < in->num_samples; i++)
        for (int c = 0; c < 3; c++)
            in->leaving[i][c] = in->direct[i][c] + (n > 0 ? in->albedo[i][c] * in->gathered[i][c] : 0.0f);
    for (size_t i = 0; in->opposite && n > 0 && i < in->num_samples; i++)
        for (int c = 0; c < 3 && in->opposite[i] != INDIRECT_NONE; c++)
            in->leaving[i][c] += in->transmitted[i][c] * in->gathered[in->opposite[i]][c];
}

/* A reflection is part of the same bounce, so its light left the other sample one bounce earlier. */
static void gather_chunk(void *arg, int index, int worker)
{
    const struct solve *s = arg;
    struct pell_indirect *in = s->in;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < in->num_samples ? first + CHUNK : in->num_samples;

    (void) worker;
    for (size_t i = first; i < end; i++) {
        const struct indirect_link *links = &in->links[i * INDIRECT_RAYS];
        const struct indirect_specular_link *specular_links =
            in->specular_links && s->bounce > 0 ? &in->specular_links[i * INDIRECT_SPECULAR_LINKS] : NULL;
        float sum[3] = { 0.0f, 0.0f, 0.0f };
        if (in->reflected)
            memcpy(sum, in->reflected[i], sizeof(sum));
        for (int k = 0; k < INDIRECT_RAYS; k++) {
            const float w = (float) links[k].factor * (1.0f / (INDIRECT_RAYS * INDIRECT_STEPS));
            const float *light = in->leaving[links[k].sample];
            for (int c = 0; c < 3; c++)
                sum[c] += w * light[c];
        }
        for (int k = 0; specular_links && k < INDIRECT_SPECULAR_LINKS; k++)
            for (int c = 0; c < 3; c++)
                sum[c] += specular_links[k].factor * in->previous[specular_links[k].sample][c];
        memcpy(in->gathered[i], sum, sizeof(sum));
    }
}

static void knot_chunk(void *arg, int index, int worker)
{
    const struct solve *s = arg;
    struct pell_indirect *in = s->in;
    const size_t count = in->num_values, first = (size_t) index * CHUNK;

    (void) worker;
    for (size_t i = first; i < first + CHUNK && i < count; i++) {
        const struct indirect_near *near = &in->near[i];
        float sum[3] = { 0.0f, 0.0f, 0.0f }, behind[3] = { 0.0f, 0.0f, 0.0f };
        for (int k = 0; k < INDIRECT_NEAR && near->weight[k] > 0.0f; k++) {
            const uint32_t sample = near->sample[k], opposite = in->opposite ? in->opposite[sample] : INDIRECT_NONE;
            for (int c = 0; c < 3; c++) {
                sum[c] += near->weight[k] * in->gathered[sample][c];
                if (opposite != INDIRECT_NONE)
                    behind[c] += near->weight[k] * in->passed[sample][c] * in->gathered[opposite][c];
            }
        }
        memcpy(in->value[i], sum, sizeof(sum));
        if (in->behind)
            memcpy(in->behind[i], behind, sizeof(behind));
    }
}

/* Power that arrives at translucent surfaces: W, sum of all channels. */
static double arriving_power(const struct pell_indirect *in, const float (*light)[3])
{
    double sum = 0.0;

    for (size_t i = 0; i < in->num_samples; i++) {
        const struct indirect_sample *q = &in->samples[i];
        if (!in->p.scene->materials[q->medium].opaque)
            sum += (double) (q->spacing * q->spacing) * (double) (light[i][0] + light[i][1] + light[i][2]);
    }
    return sum;
}

float pell_indirect_diffuse(const struct pell_indirect *in)
{
    return in ? in->diffuse : 0.0f;
}

static int chunks_of(size_t count)
{
    return (int) ((count + CHUNK - 1) / CHUNK);
}

enum pell_result pell_indirect_solve(struct pell_indirect *in, struct pell_pool *pool, const struct pell_indirect_lights *lights,
                                     const float (*total)[3], int bounces)
{
    struct solve s = { .in = in, .lights = lights, .total = total };
    double direct_power, indirect_power;
    enum pell_result res;

    pell_pool_run(pool, chunks_of(in->num_samples), direct_chunk, &s);
    if (pell_cancelled(in->ctx))
        return PELL_ERR_CANCELLED;
    direct_power = arriving_power(in, in->leaving);
    transmit_direct(in);
    PELL_TRY(indirect_specular_light(in, pool));
    for (s.bounce = 0; s.bounce < bounces; s.bounce++) {
        update_exitance(in, s.bounce);
        pell_pool_run(pool, chunks_of(in->num_samples), gather_chunk, &s);
    }
    indirect_power = bounces > 0 ? arriving_power(in, in->gathered) : 0.0;
    in->diffuse = indirect_power > 0.0 ? (float) (indirect_power / (direct_power + indirect_power)) : 0.0f;
    pell_pool_run(pool, chunks_of(in->num_values), knot_chunk, &s);
    res = pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}
