/* SPDX-License-Identifier: MIT
 * setup.c - setup of image-space common to all engines: sample sets, thickness tables, views from the lights, and their frame-dependent
 * parts. */
#include "methods/image_space/image_space.h"

#include "math/vec.h"
#include "methods/thickness.h"
#include "render/engine.h"
#include "render/material_id.h"

#include <string.h>

#define MAX_PIXELS ((size_t) 1 << 28) /* a texel's float has an int index */

/* The dipole of a material's coefficients, if the method is to use it and the material has any. */
static enum pell_result published_profile(const struct is_setup *st, const struct pell_frame_material *m, struct pell_profile *out,
                                          struct pell_frame_material *with)
{
    bool scatters = m->gaussians.count == 0 && pell_medium_valid(&m->medium, NULL);

    *with = *m;
    for (int c = 0; c < 3; c++)
        scatters = scatters && m->medium.sigma_a[c] + m->medium.sigma_s_reduced[c] > 0.0;
    if (st->knobs.profile != IS_PROFILE_DIPOLE || !scatters)
        return PELL_OK;
    for (int c = 0; c < 3; c++) {
        const enum pell_result res = pell_profile_make(PELL_PROFILE_DIPOLE, &m->medium, c, NULL, &out[c]);
        if (res != PELL_OK)
            return pell_error(st->ctx, res, m->name, NULL, "has no dipole");
    }
    with->profile = out;
    return PELL_OK;
}

static bool same_set(const struct pell_frame_material *a, const struct pell_frame_material *b)
{
    return a->profile == b->profile && a->white == b->white && (a->gaussians.count == 0) == (b->gaussians.count == 0) &&
           memcmp(&a->medium, &b->medium, sizeof(a->medium)) == 0;
}

static enum pell_result make_set(struct is_setup *st, const struct pell_frame_shape *shape, size_t i, struct pell_profile *dipole)
{
    const struct pell_frame_material *m = &shape->materials[i];
    const double most = 0.5 * (double) shape->object_height;
    struct pell_frame_material with;
    double reach;
    enum pell_result res;

    for (size_t k = 0; k < i; k++)
        if (same_set(&shape->materials[k], m)) {
            st->sets[i] = st->sets[k];
            st->sets[i].owned = false;
            return PELL_OK;
        }
    PELL_TRY(published_profile(st, m, dipole, &with));
    reach = is_reach(&with);
    if (most > 0.0 && reach > most && is_uniform_samples(&st->knobs) > 0)
        pell_warn(st->ctx, m->name, "few samples find light from farther away: use more samples, or hierarchical",
                  "its light spreads %.3g mm, further than half the object: uniform samples are limited to %.3g mm", reach, most);
    return is_set_make(st->ctx, &with, &st->knobs, most > 0.0 ? fmin(most, 1e15) : 1e15, &st->sets[i]);

fail:
    return res;
}

static enum pell_result make_sets(struct is_setup *st, const struct pell_frame_shape *shape)
{
    struct pell_profile *dipole = pell_calloc(st->ctx, 3, sizeof(*dipole));
    enum pell_result res = PELL_ERR_NOMEM;

    st->sets = pell_calloc(st->ctx, shape->num_materials, sizeof(*st->sets));
    if (!dipole || !st->sets)
        goto fail;
    st->num_sets = shape->num_materials;
    for (size_t i = 0; i < shape->num_materials; i++)
        PELL_TRY(make_set(st, shape, i, dipole));
    res = PELL_OK;

fail:
    pell_free(st->ctx, dipole);
    return res;
}

static enum pell_result make_thickness(struct is_setup *st, const struct pell_frame_shape *shape)
{
    const int through = is_through_of(&st->knobs);

    if (through == IS_THROUGH_OFF)
        return PELL_OK;
    st->thickness = pell_calloc(st->ctx, shape->num_materials, sizeof(*st->thickness));
    if (!st->thickness)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < shape->num_materials; i++) {
        const struct pell_frame_material *m = &shape->materials[i];
        const size_t first = pell_first_alike(shape, i);
        if (first < i)
            st->thickness[i] = st->thickness[first];
        else
            pell_thickness_table_make(m, pell_thickness_beyond, m, through == IS_THROUGH_SLAB, 1.0, &st->thickness[i]);
    }
    return PELL_OK;
}

void is_setup_finish(struct is_setup *st)
{
    for (size_t i = 0; st->sets && i < st->num_sets; i++)
        if (st->sets[i].owned) {
            pell_free(st->ctx, st->sets[i].offset);
            pell_free(st->ctx, st->sets[i].original);
            pell_free(st->ctx, st->sets[i].rows);
            pell_free(st->ctx, st->sets[i].level);
        }
    for (int i = 0; i < IS_VIEWS_MAX; i++)
        pell_free(st->ctx, st->light_views[i].texels);
    pell_solids_destroy(&st->solids);
    pell_free(st->ctx, st->thickness);
    pell_free(st->ctx, st->sets);
}

static void set_counts(struct is_work *w, const struct is_knobs *k)
{
    const int importance = is_importance_samples(k);

    for (int class = 0; class < IS_CLASSES; class ++) {
        struct is_knobs class_knobs = *k;
        class_knobs.samples = is_class_samples(k, class);
        w->counts[class] = (struct is_count) { class_knobs.samples, is_importance_samples(&class_knobs),
                                               (float) is_uniform_samples(&class_knobs), w->samples_row };
        w->samples_row += class_knobs.samples;
    }
    w->first_kind = k->sampling == IS_SEPARATE && importance > 0 ? importance : k->samples;
}

enum pell_result is_setup_make(const struct pell_services *services, const struct pell_frame_shape *shape, const struct is_knobs *k,
                               struct is_setup *st)
{
    struct is_work *w = &st->work;
    enum pell_result res;

    st->services = services;
    st->ctx = services->ctx;
    st->knobs = *k;
    if ((size_t) shape->width * (size_t) shape->height > MAX_PIXELS)
        return pell_error(st->ctx, PELL_ERR_UNSUPPORTED, "image-space", NULL, "%d x %d pixels, at most %zu in all", shape->width,
                          shape->height, MAX_PIXELS);
    set_counts(w, k);
    w->tile = is_tile_side(k);
    w->jacobian = k->jacobian || k->misprint == IS_MISPRINT_JACOBIAN;
    w->inverted = k->misprint == IS_MISPRINT_JACOBIAN;
    w->reconstruct = k->reconstruct && w->tile > 1;
    w->renormalise = k->renormalise;
    if (w->renormalise == IS_BY_VIEWS)
        w->renormalise = k->views != IS_VIEWS_CAMERA ? IS_NEVER : IS_BY_WEIGHT;
    w->factor = k->misprint == IS_MISPRINT_TWO_PI ? (float) (0.5 / PELL_PI) : 1.0f;
    w->focal_px = shape->focal_px;
    PELL_TRY(make_sets(st, shape));
    w->sets = st->sets;
    PELL_TRY(make_thickness(st, shape));
    if (k->views != IS_VIEWS_CAMERA) {
        PELL_TRY(pell_services_solids(services, &st->solids));
        PELL_TRY(is_light_views_make(services, st->solids, k, st->light_views, &w->num_views));
        w->views = st->views;
    }
    return PELL_OK;

fail:
    return res;
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------- */

void is_find_solids(const struct is_setup *st, const struct pell_frame *in, int y, int32_t *to)
{
    ptrdiff_t at[16];
    int32_t found[16];
    int count = 0;

    for (int x = in->rect.x0; x < in->rect.x1; x++) {
        if (pell_material_id(in, y * in->shape.stride + x))
            at[count++] = y * in->shape.stride + x;
        if (count == 0 || (count < 16 && x + 1 < in->rect.x1))
            continue;
        pell_solids_find(st->solids, st->services->rays, in, at, count, found);
        for (int i = 0; i < count; i++)
            to[at[i] - y * in->shape.stride] = found[i] + 1;
        count = 0;
    }
}

/* Subpixel position of this frame's rays, derived from their hit points. */
static void find_shift(struct is_setup *st, const struct pell_frame *in, const struct pell_view *camera)
{
    for (int y = in->rect.y0; y < in->rect.y1; y++)
        for (int x = in->rect.x0; x < in->rect.x1; x++) {
            const ptrdiff_t i = y * in->shape.stride + x;
            struct pell_vec3 p;
            float scale;
            if (!pell_material_id(in, i))
                continue;
            p = vec3_sub(vec3(in->position[0][i], in->position[1][i], in->position[2][i]), camera->origin);
            scale = in->shape.orthographic ? in->shape.focal_px : in->shape.focal_px / in->depth[i];
            st->work.mid_x = (float) x + 0.5f - vec3_dot(p, camera->right) * scale;
            st->work.mid_y = (float) y + 0.5f + vec3_dot(p, camera->up) * scale;
            return;
        }
}

/* The views of lights in the camera coordinates of this frame. */
static void turn_views(struct is_setup *st, const struct pell_frame *in)
{
    const struct pell_view camera = *in->view;
    const struct pell_vec3 from[3] = { camera.right, vec3_mul(camera.up, -1.0f), camera.forward };

    find_shift(st, in, &camera);
    for (int i = 0; i < st->work.num_views; i++) {
        const struct pell_view *v = &st->light_views[i].view;
        const struct pell_vec3 to[3] = { v->right, vec3_mul(v->up, -1.0f), v->forward };
        struct is_view *out = &st->views[i];
        *out = (struct is_view) {
            .texels = st->light_views[i].texels,
            .size = v->width,
            .orthographic = v->orthographic,
            .focal_px = v->focal_px,
            .centre_px = 0.5f * (float) v->width - 0.5f,
        };
        for (int k = 0; k < 3; k++) {
            for (int j = 0; j < 3; j++)
                out->rotate[k][j] = vec3_dot(to[k], from[j]);
            out->shift[k] = vec3_dot(to[k], vec3_sub(camera.origin, v->origin));
        }
    }
}

enum pell_result is_setup_frame(struct is_setup *st, const struct pell_frame *in)
{
    struct is_work *w = &st->work;
    const bool observed = pell_services_observed(st->services, in);
    const uint64_t image_index = (uint64_t) in->seed * (uint64_t) (in->num_samples > 1 ? in->num_samples : 1) + (uint64_t) in->sample;
    enum pell_result res = PELL_OK;

    if (st->knobs.progressive && image_index != st->image_index) {
        for (size_t i = 0; i < st->num_sets; i++)
            if (st->sets[i].owned)
                is_set_turn(&st->knobs, image_index, &st->sets[i]);
        st->image_index = image_index;
    }
    w->mid_x = 0.5f * (float) in->shape.width;
    w->mid_y = 0.5f * (float) in->shape.height;
    if (st->solids)
        turn_views(st, in);
    if (observed)
        res = is_show_samples(st->services, &st->knobs, st->sets, st->num_sets);
    for (int i = 0; i < w->num_views && res == PELL_OK && observed; i++)
        res = is_show_view(st->services, &st->light_views[i], i + 1);
    return res;
}
