/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the stage: tiles of pixels, packed into packets of 16 covered pixels, over all lights and samples. Shadows of point and spot
 * lights use the light's grid (visibility/light_grid.h), if it has one and the pixels are neighbours; otherwise rays.
 */
#include "render/irradiance/internal.h"

#include "math/scalar.h"
#include "render/curvature/stage.h"
#include "render/indirect/stage.h"
#include "render/irradiance/device.h"
#include "scene/material_maps.h"
#include "scene/triangle.h"
#include "shared/gloss.h"
#include "shared/highlights.h"

#include <float.h>
#include <string.h>

#define TILE_W 32
#define TILE_H 16
#define PLANES 7
#define LINE 16                                /* floats per cache line; a tile has as many lines per plane as packets */
#define PACKETS (TILE_W * TILE_H / PELL_LANES) /* per tile */
#define BLOCK 4                                /* packets are blocks of 4 x 4 pixels, whose rays are most coherent */

/* --- Packets of pixels ---------------------------------------------------------------------------------------------------------- */

/* The covered pixels of a tile, with their materials + 1. After the last packet the first of its pixels is repeated. */
struct pixels {
    _Alignas(64) uint16_t at[TILE_W * TILE_H + PELL_LANES], material[TILE_W * TILE_H + PELL_LANES];
    int count;
};

/* Fills the packet from a tile's pixels; lanes beyond `count` repeat the first one. */
static void fill_packet(const struct job *job, struct packet *k, int x0, int y0, const struct pixels *pixels, int first)
{
    const int32_t stride = (int32_t) job->p->surface->stride;
    _Alignas(64) int32_t x[PELL_LANES], y[PELL_LANES];

    k->count = pixels->count - first < PELL_LANES ? pixels->count - first : PELL_LANES;
    for (int i = 0; i < PELL_LANES; i++) {
        const int32_t pixel = pixels->at[first + i];
        x[i] = x0 + pixel % TILE_W;
        y[i] = y0 + pixel / TILE_W;
        k->index[i] = y[i] * stride + x[i];
        k->material[i] = pixels->material[first + i] - 1u;
    }
    pell_load_packet(job, k, x, y, NULL);
}

/* --- Lights -------------------------------------------------------------------------------------------------------------------- */

/* Multiplies by the projected image's colour toward each lane. */
static void project_image(const struct pell_light_source *source, struct packet *k)
{
    struct pell_aim *a = &k->aim;

    for (int i = 0; i < PELL_LANES; i++) {
        float rgb[3];
        if (!(a->front[i] | a->back[i]))
            continue;
        pell_light_source_image(source, vec3(a->sx[i], a->sy[i], a->sz[i]), vec3(-a->lx[i], -a->ly[i], -a->lz[i]),
                                vec3(k->lanes.px[i], k->lanes.py[i], k->lanes.pz[i]), rgb);
        for (int c = 0; c < 3; c++)
            a->intensity[c][i] *= rgb[c];
        if (!(a->intensity[0][i] + a->intensity[1][i] + a->intensity[2][i] > 0.0f))
            a->front[i] = a->back[i] = 0;
    }
}

/* For lights that take turns (struct pell_light_source.turns): the sample of each lane's current light. */
struct turns {
    struct pell_aim aim;
    const struct pell_light_source *first;
};

/* The four pixels of a quad use different lights, and each uses all in turn, so that the mean over the multisamples is that of all
 * lights at all pixels. */
static void record_turn(const struct job *job, const struct pell_light_source *source, const struct packet *k, struct turns *t)
{
    const struct pell_aim *a = &k->aim;
    const uint32_t mask = (uint32_t) source->turns - 1u, turn = (uint32_t) source->turn;

    for (int i = 0; i < PELL_LANES; i++) {
        if (((k->lanes.curve[i] + job->p->sample) & mask) != turn)
            continue;
        t->aim.lx[i] = a->lx[i];
        t->aim.ly[i] = a->ly[i];
        t->aim.lz[i] = a->lz[i];
        t->aim.gl[i] = a->gl[i];
        t->aim.nl[i] = a->nl[i];
        for (int c = 0; c < 3; c++)
            t->aim.intensity[c][i] = a->intensity[c][i] * (float) source->turns;
        t->aim.back[i] = a->back[i];
        t->aim.any_back |= a->back[i];
    }
    t->first = source;
}

/* Transmission uses the centre of an environment's light: the smooth part there is the table minus that light. */
static void aim_at_middle(const struct job *job, const struct pell_light_data *data, struct packet *k)
{
    struct pell_light_data middle = *data;

    middle.environment = -1;
    job->kernels->aim(&middle, &k->lanes, 0, 0, &k->aim);
}

/* Adds the transmission of a light. */
static void transmit(const struct job *job, const struct pell_light_source *source, struct pell_aim *a, struct packet *k)
{
    if (k->any_forward)
        pell_transmit_forward(job, source, a, k);
    if (k->lanes.any_transmits && !k->transmission_by_device)
        pell_transmit_light(job, source, a, k);
}

/* Adds the transmission of lights that took turns. */
static void end_turns(const struct job *job, struct packet *k, struct turns *t)
{
    if (t->aim.any_back)
        transmit(job, t->first, &t->aim, k);
    memset(t->aim.back, 0, sizeof(t->aim.back));
    t->aim.any_back = 0;
}

/* Adds the directions of the lobe that hit the light, and its highlight. */
static void end_highlights(const struct job *job, const struct pell_light_data *data, struct packet *k, struct pell_gloss *gloss,
                           struct pell_sums *sums)
{
    const uint32_t count = gloss->any_odds ? (uint32_t) pell_gloss_directions(data->samples) : 0;

    for (uint32_t j = 0; j < count; j++) {
        _Alignas(64) int32_t mask[PELL_LANES], visible[PELL_LANES];
        struct pell_ray16 rays;

        if (!job->kernels->reflect(data, &k->lanes, job->p->sample * count + j, gloss, mask, &rays))
            continue;
        pell_trace_occlusion(job, k, mask, true, &rays, visible);
        job->kernels->reflected(visible, gloss);
    }
    job->kernels->end_highlights(data, &k->lanes, gloss, sums);
}

/* Adds all samples of a light; light that enters from the front goes to `front`. If the device computed that, transmission may remain. */
static void add_light(const struct job *job, const struct pell_light_source *source, struct packet *k, struct pell_sums *front,
                      struct turns *turns)
{
    const struct pell_light_data *data = &job->lights->data[source - job->lights->sources];
    const bool highlights = source->environment < 0 && !k->lit_by_device && shows_highlights(job, k);
    struct pell_gloss gloss;

    if (k->lit_by_device && !k->any_forward && (k->transmission_by_device || !k->lanes.any_transmits))
        return;
    if (highlights)
        job->kernels->begin_highlights(data, &k->lanes, &gloss);
    for (int s = 0; s < source->samples; s++) {
        const uint32_t n = job->p->sample * (uint32_t) source->samples + (uint32_t) s;
        _Alignas(64) int32_t visible[PELL_LANES];
        struct pell_ray16 rays;

        job->kernels->aim(data, &k->lanes, pell_sobol0(n), pell_sobol1(n), &k->aim);
        if (source->image)
            project_image(source, k);
        if (k->aim.any_front && !k->lit_by_device) {
            if (!pell_query_light_grid(source, k, k->aim.front, k->lanes.ox, k->lanes.oy, k->lanes.oz, visible)) {
                job->kernels->shadow_rays(data, &k->lanes, &k->aim, &rays);
                pell_trace_occlusion(job, k, k->aim.front, true, &rays, visible);
            }
            job->kernels->front(data, &job->tables, &k->lanes, &k->aim, visible, highlights ? &gloss : NULL, front);
            if (job->p->unscattered)
                pell_pass_shadow(job, data, visible, k, front);
        } else if (pell_light_in_table(data) && !k->lit_by_device) {
            job->kernels->unshadowed(&job->tables, &k->lanes, &k->aim, front);
        }
        if (source->environment >= 0 && (k->any_forward || k->lanes.any_transmits))
            aim_at_middle(job, data, k);
        if (k->aim.any_back && turns && source->turns > 1)
            record_turn(job, source, k, turns);
        else if (k->aim.any_back)
            transmit(job, source, &k->aim, k);
    }
    if (highlights)
        end_highlights(job, data, k, &gloss, front);
}

/* --- Environments ------------------------------------------------------------------------------------------------------------- */

/* Adds the lights of an environment. Without highlights, points are not pixels, and lights do not take turns. */
static void add_environment_lights(const struct job *job, size_t environment, struct packet *k, struct pell_sums *sums)
{
    const struct pell_lights *lights = job->lights;
    struct turns turns;

    memset(&turns.aim, 0, sizeof(turns.aim));
    for (size_t j = 0; j < lights->num_sources; j++) {
        const struct pell_light_source *source = &lights->sources[j];
        if (source->environment != (int) environment)
            continue;
        add_light(job, source, k, sums, job->entering_only ? NULL : &turns);
        if (source->turns > 1 && source->turn == source->turns - 1)
            end_turns(job, k, &turns);
    }
    end_turns(job, k, &turns);
}

static void add_reflection(const struct job *job, struct packet *k, const struct pell_environment *env)
{
    const struct pell_lanes *l = &k->lanes;

    for (int i = 0; i < k->count; i++) {
        const struct pell_vec3 n = vec3(l->nx[i], l->ny[i], l->nz[i]), v = vec3(l->vx[i], l->vy[i], l->vz[i]);
        const float nv = max0(l->nv[i]), strength = l->tint[0][i] + l->tint[1][i] + l->tint[2][i];
        float rgb[3], scale, bias;
        if (!(strength > 0.0f))
            continue;
        pell_environment_reflection(env, vec3_normalize(vec3_sub(vec3_mul(n, 2.0f * nv), v)), sqrtf(l->width2[i]), rgb);
        pell_albedo_pair(job->tables.albedo + l->albedo_at[i], l->roughness_fraction[i], nv, &scale, &bias);
        for (int c = 0; c < 3; c++)
            k->sums.specular[c][i] += rgb[c] * l->tint[c][i] * pell_saturate(l->f0[c][i] * scale + bias) * k->ambient[i];
    }
}

static void add_directions(const struct pell_sums *from, struct packet *k)
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < k->count; i++) {
            k->sums.shifted[c][i] += from->shifted[c][i];
            k->sums.direction_in[c][i] += from->direction_in[c][i];
        }
    for (int i = 0; i < k->count; i++)
        k->sums.direction_weight[i] += from->direction_weight[i];
}

/* Diffuse light is returned including its single scattering, as a surplus of entering light (pell_angle.enter_mean). Returns that
 * surplus. */
static float single_surplus(const struct pell_lanes *l, int c, int i)
{
    return l->enter_mean[c][i] - l->enter_base[c][i] - l->enter_slope[c][i] * (1.0f - pell_mean_refracted(l->inverse_eta2[i]));
}

static void add_environments(const struct job *job, struct packet *k)
{
    const struct pell_lights *lights = job->lights;
    const struct pell_lanes *l = &k->lanes;
    struct pell_sky sky;

    if (!pell_any_environment(job))
        return;
    for (int i = 0; i < PELL_LANES; i++) {
        sky.origin[0][i] = l->ox[i];
        sky.origin[1][i] = l->oy[i];
        sky.origin[2][i] = l->oz[i];
        sky.normal[0][i] = l->gx[i]; /* geometric: on a convex mesh the whole environment is visible, however coarse it is */
        sky.normal[1][i] = l->gy[i];
        sky.normal[2][i] = l->gz[i];
    }
    if (job->entering_only && job->p->ambient && !k->far_side)
        for (int i = 0; i < PELL_LANES; i++)
            k->ambient[i] = job->p->ambient[k->index[i]];
    else if (!k->lit_by_device)
        pell_ambient_visibility(job, k, l->valid, PELL_AMBIENT_SALT, &sky, k->ambient);
    for (size_t e = 0; e < lights->num_environments; e++) {
        struct pell_sums sums = { 0 };
        if (!pell_irradiance_requests(job->p, lights->environments[e].light))
            continue;
        if (k->lit_by_device)
            pell_read_environment(job, k, e, &sums);
        add_environment_lights(job, e, k, &sums);
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < k->count; i++)
                k->sums.single[c][i] += sums.single[c][i];
        if (l->any_direction)
            add_directions(&sums, k);
        for (int i = 0; i < k->count; i++) {
            const struct pell_env_query query = lane_query(job, k, i);
            float rgb[3];
            pell_environment_irradiance(&lights->environments[e], vec3(l->nx[i], l->ny[i], l->nz[i]), &query, rgb);
            for (int c = 0; c < 3; c++) {
                const float rest = k->ambient[i] * (rgb[c] - sums.unshadowed[c][i]);
                k->sums.irradiance[c][i] += max0(sums.irradiance[c][i] + l->enter_mean[c][i] * rest);
                if (l->any_direction)
                    k->sums.single_surplus[c][i] += single_surplus(l, c, i) * rest;
            }
        }
        if (shows_highlights(job, k))
            add_reflection(job, k, &lights->environments[e]);
    }
    if (l->any_transmits && k->transmission_by_device)
        pell_read_environment_transmitted(job, k);
    else if (l->any_transmits)
        pell_transmit_environment(job, k);
}

/* --- Indirect light ----------------------------------------------------------------------------------------------------------- */

/* Whether a lane is viewed from the side from which the corners of its triangle run clockwise. */
static bool is_back(const struct job *job, const struct packet *k, int i)
{
    const struct pell_mesh *mesh = &job->p->scene->meshes[k->points.mesh[i]];
    struct pell_vec3 corner[3];

    pell_triangle_corners(mesh, k->points.triangle[i], corner);
    return vec3_dot(pell_triangle_cross(corner), vec3(k->lanes.gx[i], k->lanes.gy[i], k->lanes.gz[i])) < 0.0f;
}

static void add_indirect(const struct job *job, struct packet *k)
{
    const bool transmits = job->p->transmits && !job->entering_only && !k->far_side;
    _Alignas(64) float rgb[4][PELL_LANES], far_side_light[4][PELL_LANES];
    int32_t back[PELL_LANES];

    for (int i = 0; i < PELL_LANES; i++)
        back[i] = k->lanes.opaque[i] && is_back(job, k, i);
    pell_indirect_at(job->p->indirect, &k->points, back, rgb, transmits ? far_side_light : NULL);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PELL_LANES; i++) {
            k->sums.irradiance[c][i] += rgb[c][i] * k->lanes.enter_mean[c][i];
            if (k->lanes.any_direction)
                k->sums.single_surplus[c][i] += rgb[c][i] * single_surplus(&k->lanes, c, i);
            if (transmits)
                k->sums.transmitted[c][i] += far_side_light[c][i];
        }
}

/* --- The stage ---------------------------------------------------------------------------------------------------------------- */

static void shade_side(const struct job *job, struct packet *k)
{
    struct pell_gains gains;
    struct pell_inside inside;

    pell_prepare_inside(job, k, &gains, &inside);
    if (k->lit_by_device)
        pell_read_lights(job, k);
    if (k->transmission_by_device && k->lanes.any_transmits)
        pell_read_transmitted(job, k);
    for (size_t j = 0; j < job->lights->num_sources; j++)
        if (job->lights->sources[j].environment < 0 && pell_irradiance_requests(job->p, job->lights->sources[j].light))
            add_light(job, &job->lights->sources[j], k, &k->sums, NULL);
    add_environments(job, k);
    if (job->p->indirect && pell_irradiance_requests_indirect(job->p))
        add_indirect(job, k);
    if (job->p->curvature)
        pell_scale_lanes(job, &gains, k);
    if (job->p->solid_light)
        pell_add_inside(job, &inside, k);
}

/* Computes the light that the far side of thin sheets receives, which is transmitted. */
static void shade_far_side(const struct job *job, struct packet *k)
{
    struct packet b = *k;
    const struct pell_lanes *l = &b.lanes;

    b.slot += PELL_LANES;
    memset(&b.sums, 0, sizeof(b.sums));
    pell_turn_packet(&b);
    shade_side(job, &b);
    k->rays = b.rays;
    k->device_rays = b.device_rays;
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PELL_LANES; i++)
            k->sums.transmitted[c][i] = l->valid[i] ? b.sums.irradiance[c][i] : k->sums.transmitted[c][i];
}

/* Marks emissive pixels: their specular light includes emission, so its occluded fraction is not known. */
static void exclude_emissive(const struct job *job, struct packet *k)
{
    float *const *emissive = job->p->surface->emissive;

    for (int i = 0; i < k->count; i++) {
        const int32_t at = k->index[i];
        if (emissive[0][at] + emissive[1][at] + emissive[2][at] > 0.0f)
            k->sums.hidden[0][i] = -1.0f;
    }
}

/* Reduces the occluded irradiance by what the method's blur smooths anyway. */
static void scale_lost(const struct job *job, struct packet *k)
{
    for (int i = 0; i < k->count; i++) {
        const float pixel_mm = pell_view_pixel_mm(job->p->view, job->p->surface->depth[k->index[i]]);
        for (int c = 0; c < 3; c++)
            k->sums.lost[c][i] *= pell_highlights_share(job->p->radius[k->material[i]][c], pixel_mm);
    }
}

static void shade_packet(const struct job *job, struct packet *k)
{
    shade_side(job, k);
    if (job->p->shared && job->p->radius)
        scale_lost(job, k);
    if (job->p->shared && job->p->surface->any_emissive)
        exclude_emissive(job, k);
    if (k->lanes.any_thin)
        shade_far_side(job, k);
}

/* Lists fully covered blocks first, each a packet, then the pixels of other blocks. Their materials are stored with them: reading the
 * plane again one by one would wait for the writes of the previous packet. */
static void list_pixels(const struct job *job, int x0, int y0, struct pixels *list)
{
    const struct pell_surface *s = job->p->surface;
    const struct pell_rect r = s->covered;
    uint16_t at[TILE_W * TILE_H + 1], material[TILE_W * TILE_H + 1]; /* one more: the element after the last is written, too */
    int n = 0, m = 0;

    /* Nothing is covered outside the rectangle, but rows below it may not exist. */
    for (int by = y0; by < y0 + TILE_H && by < r.y1; by += BLOCK)
        for (int bx = x0; bx < x0 + TILE_W && bx < r.x1; bx += BLOCK) {
            const uint16_t *block = s->material + (ptrdiff_t) by * s->stride + bx;
            const int rows = r.y1 - by < BLOCK ? r.y1 - by : BLOCK, base = (by - y0) * TILE_W + bx - x0;
            uint16_t ids[BLOCK * BLOCK] = { 0 };
            int all = 1, any = 0;

            for (int j = 0; j < rows; j++)
                memcpy(ids + BLOCK * j, block + s->stride * j, BLOCK * sizeof(*ids));
            for (int i = 0; i < BLOCK * BLOCK; i++) {
                all &= ids[i] != 0;
                any |= ids[i];
            }
            if (all) {
                for (int i = 0; i < BLOCK * BLOCK; i++)
                    list->at[n + i] = (uint16_t) (base + i / BLOCK * TILE_W + i % BLOCK);
                memcpy(list->material + n, ids, sizeof(ids));
                n += BLOCK * BLOCK;
            } else if (any) {
                for (int i = 0; i < BLOCK * BLOCK; i++) {
                    at[m] = (uint16_t) (base + i / BLOCK * TILE_W + i % BLOCK);
                    material[m] = ids[i];
                    m += ids[i] != 0;
                }
            }
        }
    memcpy(list->at + n, at, (size_t) m * sizeof(*at));
    memcpy(list->material + n, material, (size_t) m * sizeof(*material));
    list->count = n + m;
    for (int i = list->count; i % PELL_LANES != 0; i++) {
        list->at[i] = list->at[list->count / PELL_LANES * PELL_LANES];
        list->material[i] = list->material[list->count / PELL_LANES * PELL_LANES];
    }
}

/* The light of a tile's pixels, before it is copied to the planes in whole cache lines. Writing each packet directly to the planes would
 * take longer than its arithmetic, because it touches a quarter of a cache line in every plane and row. */
struct tile {
    _Alignas(64) float planes[PLANES][3][TILE_H * TILE_W]; /* irradiance, transmitted, specular, single, hidden, lost, entered */
    float path[TILE_H * TILE_W];
};

/* Copies a tile to the planes. Uncovered pixels get 0. */
static void flush_tile(const struct job *job, int x0, int y0, const struct tile *tile)
{
    const ptrdiff_t stride = job->p->surface->stride;
    const int rows = job->rect.y1 - y0 < TILE_H ? job->rect.y1 - y0 : TILE_H;
    float *const *const planes[PLANES] = { job->out->irradiance, job->out->transmitted, job->out->specular, job->out->single,
                                           job->out->hidden,     job->out->lost,        job->out->entered };
    const bool enabled[PLANES] = { true, true, true, job->p->separate, job->p->shared, job->p->shared, job->out->entered[0] };

    for (int y = 0; job->out->path && y < rows; y++)
        for (int x = 0; x < TILE_W && x0 + x < stride; x += LINE)
            memcpy(job->out->path + (y0 + y) * stride + x0 + x, tile->path + y * TILE_W + x, LINE * sizeof(float));
    for (int k = 0; k < PLANES; k++)
        for (int c = 0; c < 3 && enabled[k]; c++)
            for (int y = 0; y < rows; y++)
                for (int x = 0; x < TILE_W && x0 + x < stride; x += LINE)
                    memcpy(planes[k][c] + (y0 + y) * stride + x0 + x, tile->planes[k][c] + y * TILE_W + x, LINE * sizeof(float));
}

/* Prefetches 1/32 of the cache lines that this tile is written to, and of those that the next one is read from. There are more streams
 * than hardware prefetchers follow, and a packet's rays leave time for it. */
PELL_FETCHING_INLINE void fetch(const struct job *job, int x0, int y0, int block)
{
    const struct pell_surface *s = job->p->surface;
    const int x = x0 + block % (TILE_W / LINE) * LINE, y = y0 + block / (TILE_W / LINE);
    const ptrdiff_t at = y * s->stride + x;

    if (y >= job->rect.y1)
        return;
    for (int c = 0; x < s->stride && c < 3; c++) {
        pell_fetch_to_write(job->out->irradiance[c] + at);
        pell_fetch_to_write(job->out->transmitted[c] + at);
        pell_fetch_to_write(job->out->specular[c] + at);
    }
    if (x + TILE_W >= job->rect.x1)
        return;
    __builtin_prefetch(s->depth + at + TILE_W);
    __builtin_prefetch(s->terminator_offset + at + TILE_W);
    for (int c = 0; c < 3; c++) {
        __builtin_prefetch(s->ng[c] + at + TILE_W);
        __builtin_prefetch(s->ns[c] + at + TILE_W);
    }
}

static void send_tile(void *arg, int index, int worker)
{
    struct job *job = arg;
    const int tile = job->first_tile + index;
    const int x0 = job->rect.x0 + tile % job->columns * TILE_W, y0 = job->rect.y0 + tile / job->columns * TILE_H;
    struct pixels list;
    struct packet k;

    (void) worker;
    k.cached_material = -1;
    k.far_side = false;
    list_pixels(job, x0, y0, &list);
    for (int first = 0; first < list.count; first += PELL_LANES) {
        fill_packet(job, &k, x0, y0, &list, first);
        job->slots[index * PACKETS + first / PELL_LANES] = pell_send_packet(job, &k, 1);
    }
}

static PELL_FETCHING void shade_tile(void *arg, int index, int worker)
{
    struct job *job = arg;
    const int at = job->first_tile + index;
    const int x0 = job->rect.x0 + at % job->columns * TILE_W, y0 = job->rect.y0 + at / job->columns * TILE_H;
    struct pell_lighting out;
    struct pixels list;
    struct packet k;
    struct tile tile;

    (void) worker;
    k.rays = k.device_rays = k.through_rays = 0;
    k.cached_material = -1;
    k.far_side = false;
    k.lit_by_device = job->slots != NULL;
    k.transmission_by_device = job->transmission_by_device;
    list_pixels(job, x0, y0, &list);
    if (list.count == 0)
        return;
    for (int c = 0; c < 3; c++) {
        out.irradiance[c] = tile.planes[0][c];
        out.transmitted[c] = tile.planes[1][c];
        out.specular[c] = tile.planes[2][c];
        out.single[c] = job->p->separate ? tile.planes[3][c] : NULL;
        out.hidden[c] = job->p->shared ? tile.planes[4][c] : NULL;
        out.lost[c] = tile.planes[5][c];
        out.entered[c] = job->out->entered[c] ? tile.planes[6][c] : NULL;
    }
    out.path = job->out->path ? tile.path : NULL;
    if (list.count < TILE_W * TILE_H)
        memset(&tile, 0, sizeof(tile));
    for (int first = 0; first < list.count; first += PELL_LANES) {
        _Alignas(64) int32_t pixel[PELL_LANES];
        fetch(job, x0, y0, first / PELL_LANES);
        fill_packet(job, &k, x0, y0, &list, first);
        if (k.lit_by_device)
            k.slot = job->slots[index * PACKETS + first / PELL_LANES];
        shade_packet(job, &k);
        for (int i = 0; i < PELL_LANES; i++)
            pixel[i] = list.at[first + i];
        job->kernels->store(&job->tables, &k.lanes, &k.sums, pixel, k.count, &out);
    }
    flush_tile(job, x0, y0, &tile);
    atomic_fetch_add_explicit(&job->rays, k.rays, memory_order_relaxed);
    atomic_fetch_add_explicit(&job->device_rays, k.device_rays, memory_order_relaxed);
    atomic_fetch_add_explicit(&job->through_rays, k.through_rays, memory_order_relaxed);
}

static struct job make_job(const struct pell_lights *lights, const struct pell_irradiance_params *params, struct pell_lighting *out)
{
    const struct pell_specular_tables *t = params->tables;

    return (struct job) {
        .p = params,
        .lights = lights,
        .kernels = pell_shade_kernels_tables[lights->simd],
        .inside = pell_inside_kernels_tables[lights->simd],
        .sky = pell_sky_kernels_tables[lights->simd],
        .tables = { &t->albedo[0][0][0][0], t->boundaries[0].transmittance },
        .out = out,
    };
}

static struct job make_points_job(const struct pell_lights *lights, const struct pell_irradiance_params *params, struct pell_lighting *out)
{
    struct job job = make_job(lights, params, out);

    job.entering_only = true;
    return job;
}

/* Returns false if there is no point. */
static bool fill_points(const struct job *job, struct packet *k, const struct pell_irradiance_packet *at)
{
    const uint16_t *material = job->p->surface->material;
    _Alignas(64) int32_t x[PELL_LANES], y[PELL_LANES] = { 0 };

    k->rays = k->device_rays = k->through_rays = 0;
    k->cached_material = -1;
    k->far_side = false;
    k->count = 0;
    for (int i = 0; i < PELL_LANES; i++) {
        if (!material[i])
            continue;
        x[k->count] = (int32_t) at->seed[i];
        k->material[k->count] = material[i] - 1u;
        k->index[k->count++] = i;
    }
    if (k->count == 0)
        return false;
    for (int i = k->count; i < PELL_LANES; i++) { /* further lanes repeat the first one */
        x[i] = x[0];
        k->material[i] = k->material[0];
        k->index[i] = k->index[0];
    }
    pell_load_packet(job, k, x, y, at->position);
    return true;
}

uint32_t pell_irradiance_send(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                              const struct pell_irradiance_packet *at, int samples)
{
    const struct job job = make_points_job(lights, params, NULL);
    struct packet k;

    return fill_points(&job, &k, at) ? pell_send_packet(&job, &k, samples) : 0;
}

void pell_irradiance_at(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                        const struct pell_irradiance_packet *at, struct pell_lighting *out, float albedo[3][PELL_LANES])
{
    const struct job job = make_points_job(lights, params, out);
    struct packet k;

    if (!fill_points(&job, &k, at))
        return;
    k.lit_by_device = params->device != NULL;
    k.transmission_by_device = false; /* and points receive no transmission */
    k.slot = k.lit_by_device ? at->slot + at->sample * pell_packet_points(&k) : 0;
    shade_packet(&job, &k);
    job.kernels->store(&job.tables, &k.lanes, &k.sums, k.index, k.count, out);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < k.count; i++)
            albedo[c][k.index[i]] = k.lanes.albedo[c][i];
    out->shadow_rays = k.rays;
    out->device_rays = k.device_rays;
}

/* Computes direct light and transmission on the device, in batches of tiles; the rest here. */
static enum pell_result render_on_device(struct pell_pool *pool, struct job *job, int tiles)
{
    struct pell_light_device *d = job->p->device;
    const struct pell_light_run run = { .params = job->p, .highlights = true };
    enum pell_result res = pell_light_device_set_thickness(d, job->p);
    const int per_batch = (int) (pell_light_device_room(d) / (TILE_W * TILE_H * (job->p->surface->any_thin ? 2 : 1)));

    job->transmission_by_device = !pell_light_device_refuses_transmission(d);
    job->slots = pell_light_device_slots(d);
    for (; job->first_tile < tiles && res == PELL_OK; job->first_tile += per_batch) {
        const int count = tiles - job->first_tile < per_batch ? tiles - job->first_tile : per_batch;
        pell_light_device_begin(d);
        pell_pool_run(pool, count, send_tile, job);
        if (pell_cancelled(job->lights->ctx))
            return PELL_ERR_CANCELLED;
        res = pell_light_device_run(d, &run);
        if (res == PELL_OK)
            pell_pool_run(pool, count, shade_tile, job);
    }
    return res;
}

enum pell_result pell_irradiance_render(struct pell_pool *pool, struct pell_lights *lights, const struct pell_irradiance_params *params,
                                        struct pell_lighting *out)
{
    const struct pell_rect covered = params->surface->covered;
    struct job job = make_job(lights, params, out);
    enum pell_result res = PELL_OK;
    int tiles;

    out->shadow_rays = out->device_rays = out->through_rays = 0;
    if (covered.x0 >= covered.x1 || covered.y0 >= covered.y1)
        return PELL_OK;
    /* Tiles are at multiples of their size, so that packets do not depend on other content of the image. */
    job.rect = (struct pell_rect) { covered.x0 / TILE_W * TILE_W, covered.y0 / TILE_H * TILE_H, covered.x1, covered.y1 };
    job.columns = (job.rect.x1 - job.rect.x0 + TILE_W - 1) / TILE_W;
    tiles = job.columns * ((job.rect.y1 - job.rect.y0 + TILE_H - 1) / TILE_H);
    if (params->device)
        res = render_on_device(pool, &job, tiles);
    else
        pell_pool_run(pool, tiles, shade_tile, &job);
    out->shadow_rays = atomic_load(&job.rays);
    out->device_rays = atomic_load(&job.device_rays);
    out->through_rays = atomic_load(&job.through_rays);
    return res == PELL_OK && pell_cancelled(lights->ctx) ? PELL_ERR_CANCELLED : res;
}
