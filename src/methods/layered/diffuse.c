/* SPDX-License-Identifier: MIT
 * diffuse.c - radiant exitance of a pixel: multiple scattering below it (multiple.h), blurred over the image by the blur chain of the
 * method screen-space, and the reflection of a matt film on top. */
#include "methods/layered/multiple.h"
#include "methods/layered/state.h"

#include "render/engine.h"

#include <string.h>

struct layered_diffuse {
    struct layered_multiple **multiple; /* by material of the scene */
    const struct pell_method *blur_method;
    void *blurs; /* state of the blur chain */
    struct pell_frame_material *materials;
    float *memory;
    float *sum[3], *fraction; /* planes: radiant exitance, and the weight of each depth set */
    size_t size;
    int most_sets;
    /* One blur of the chain. */
    const float *const *light;
    ptrdiff_t stride;
    int gaussian;
};

void layered_diffuse_destroy(struct layered_state *st)
{
    struct layered_diffuse *d = st->diffuse;

    if (!d)
        return;
    if (d->blur_method)
        d->blur_method->cpu->destroy(d->blurs);
    for (size_t i = 0; d->multiple && i < st->num_materials; i++)
        pell_free(st->ctx, d->multiple[i]);
    pell_free(st->ctx, d->multiple);
    pell_free(st->ctx, d->materials);
    pell_free(st->ctx, d->memory);
    pell_free(st->ctx, d);
    st->diffuse = NULL;
}

/* The scene's material that a material of the frame refers to, or the material it was copied from for another object. */
static int material_of(const struct layered_state *st, const struct pell_frame_shape *shape, size_t index)
{
    for (size_t i = 0; i < st->num_materials; i++) {
        const uint16_t frame_material = st->services->frame_index[i + 1];
        if (frame_material == index + 1 ||
            (frame_material > 0 && shape->materials[frame_material - 1].name == shape->materials[index].name &&
             shape->materials[frame_material - 1].profile == shape->materials[index].profile))
            return (int) i;
    }
    return -1;
}

/* Every material of the frame has the same number of Gaussians with equal weights, because each Gaussian is requested separately. */
static enum pell_result make_blurs(struct layered_state *st, const struct pell_frame_shape *shape)
{
    struct layered_diffuse *d = st->diffuse;
    struct pell_frame_shape blur_shape = *shape;
    void *knobs = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    d->materials = pell_alloc_array(st->ctx, shape->num_materials, sizeof(*d->materials));
    if (!d->materials)
        goto fail;
    memcpy(d->materials, shape->materials, shape->num_materials * sizeof(*d->materials));
    for (size_t i = 0; i < shape->num_materials; i++) {
        const int material = material_of(st, shape, i);
        const struct layered_multiple *m = material >= 0 ? d->multiple[material] : NULL;
        struct pell_gaussians *g = &d->materials[i].gaussians;
        g->count = LAYERED_GAUSSIANS;
        for (int k = 0; k < LAYERED_GAUSSIANS; k++) {
            g->variance[k] = m && m->sets > 0 ? m->variance[k] : 1e-12 * (k + 1);
            for (int c = 0; c < 3; c++)
                g->weight[k][c] = 1.0 / LAYERED_GAUSSIANS;
        }
        d->materials[i].white = false;
    }
    blur_shape.materials = d->materials;
    d->blur_method = pell_method_find(st->ctx, "layered", "screen-space");
    res = PELL_ERR_UNSUPPORTED;
    if (!d->blur_method)
        goto fail;
    PELL_TRY(pell_method_knobs_create(st->ctx, d->blur_method, "through=off,strength=off", &knobs));
    res = d->blur_method->cpu->create(st->services, &blur_shape, knobs, &d->blurs);

fail:
    pell_method_knobs_destroy(st->ctx, &knobs);
    return res;
}

enum pell_result layered_diffuse_make(struct layered_state *st, const struct pell_frame_shape *shape)
{
    const struct pell_scene *scene = st->services->scene;
    struct layered_diffuse *d = pell_zalloc(st->ctx, sizeof(*d));
    enum pell_result res = PELL_ERR_NOMEM;

    st->diffuse = d;
    if (!d)
        goto fail;
    d->size = (size_t) shape->stride * (size_t) shape->height;
    d->multiple = pell_calloc(st->ctx, st->num_materials + 1, sizeof(*d->multiple));
    if (!d->multiple)
        goto fail;
    for (size_t i = 0; st->knobs.multiple && i < st->num_materials; i++) {
        const uint16_t frame_material = st->services->frame_index[i + 1];
        if (!st->medium_layers[i] || frame_material == 0)
            continue;
        d->multiple[i] = pell_alloc(st->ctx, sizeof(**d->multiple));
        if (!d->multiple[i])
            goto fail;
        PELL_TRY(
            layered_multiple_make(st->ctx, scene, (int) i, st->medium_layers[i], &shape->materials[frame_material - 1], d->multiple[i]));
        d->most_sets = d->multiple[i]->sets > d->most_sets ? d->multiple[i]->sets : d->most_sets;
        res = PELL_ERR_NOMEM;
    }
    d->memory = pell_calloc(st->ctx, d->size, (size_t) (3 + d->most_sets) * sizeof(*d->memory));
    if (!d->memory)
        goto fail;
    for (int c = 0; c < 3; c++)
        d->sum[c] = d->memory + (size_t) c * d->size;
    d->fraction = d->memory + 3 * d->size;
    if (d->most_sets > 0)
        PELL_TRY(make_blurs(st, shape));
    return PELL_OK;

fail:
    return res;
}

/* --- A frame -------------------------------------------------------------------------------------------------------------------- */

/* Radiant exitance of the film, and the weights of the depth sets at each pixel. */
static void begin_row(void *arg, int index, int worker)
{
    const struct layered_state *st = arg;
    const struct layered_diffuse *d = st->diffuse;
    const struct pell_scene *scene = st->services->scene;
    const struct pell_frame *in = st->in;
    const int y = in->rect.y0 + index;
    float bottoms[PELL_LAYERS_MOST], fraction[LAYERED_SETS];

    (void) worker;
    for (int x = in->rect.x0; x < in->rect.x1; x++) {
        const ptrdiff_t at = y * in->shape.stride + x;
        const struct pell_mesh *mesh;
        const struct layered_multiple *m;
        float color[3] = { 0.0f, 0.0f, 0.0f };

        for (int c = 0; c < 3; c++)
            d->sum[c][at] = 0.0f;
        if (!in->material[at] || !layered_shows(st, at))
            continue;
        mesh = &scene->meshes[in->mesh[at]];
        m = d->multiple[mesh->material];
        if (st->knobs.diffuse > 0.0f && scene->materials[mesh->material].color_from == PELL_COLOR_FROM_TEXTURE)
            color[0] = color[1] = color[2] = 1.0f; /* the irradiance and the image already include it */
        else if (st->knobs.diffuse > 0.0f)
            pell_base_color_at(&scene->materials[mesh->material], mesh, in->triangle[at], in->barycentric[0][at], in->barycentric[1][at],
                               color);
        for (int c = 0; c < 3; c++)
            d->sum[c][at] = st->knobs.diffuse * color[c] * in->irradiance[c][at];
        if (!m || m->sets < 1)
            continue;
        if (m->sets > 1)
            pell_medium_layers_depths(st->medium_layers[mesh->material], mesh, in->triangle[at], in->barycentric[0][at],
                                      in->barycentric[1][at], bottoms);
        layered_multiple_blend(m, bottoms, fraction);
        for (int s = 0; s < m->sets; s++)
            d->fraction[(size_t) s * d->size + (size_t) at] = fraction[s];
    }
}

static void add_row(void *arg, int index, int worker)
{
    const struct layered_state *st = arg;
    const struct layered_diffuse *d = st->diffuse;
    const struct pell_frame *in = st->in;
    const int y = in->rect.y0 + index;
    const float unreflected = 1.0f - st->knobs.diffuse;

    (void) worker;
    for (int x = in->rect.x0; x < in->rect.x1; x++) {
        const ptrdiff_t at = y * in->shape.stride + x;
        const struct layered_multiple *m;
        if (!in->material[at] || !layered_shows(st, at))
            continue;
        m = d->multiple[st->services->scene->meshes[in->mesh[at]].material];
        for (int c = 0; m && c < 3; c++) {
            float weight = 0.0f;
            for (int s = 0; s < m->sets; s++)
                weight += d->fraction[(size_t) s * d->size + (size_t) at] * m->weight[s][d->gaussian][c];
            d->sum[c][at] += unreflected * fmaxf(weight, 0.0f) * d->light[c][y * d->stride + x];
        }
    }
}

static enum pell_result take(void *user, const float *const light[3], ptrdiff_t stride, int step, int preblur)
{
    struct layered_state *st = user;
    struct layered_diffuse *d = st->diffuse;

    if (step < preblur)
        return PELL_OK;
    d->light = light;
    d->stride = stride;
    d->gaussian = step - preblur;
    pell_pool_run(st->pool, st->in->rect.y1 - st->in->rect.y0, add_row, st);
    return PELL_OK;
}

enum pell_result layered_diffuse_render(struct layered_state *st)
{
    struct layered_diffuse *d = st->diffuse;
    const struct pell_frame *in = st->in;
    enum pell_result res;

    pell_pool_run(st->pool, in->rect.y1 - in->rect.y0, begin_row, st);
    if (d->blurs)
        PELL_TRY(d->blur_method->cpu->blurs(d->blurs, in, st->out, take, st));
    for (int y = in->rect.y0; y < in->rect.y1; y++)
        for (int c = 0; c < 3; c++) {
            const ptrdiff_t at = y * in->shape.stride + in->rect.x0;
            memcpy(st->out->light[c] + at, d->sum[c] + at, (size_t) (in->rect.x1 - in->rect.x0) * sizeof(float));
        }
    return PELL_OK;

fail:
    return res;
}
