/* SPDX-License-Identifier: MIT
 * content.c - data of a sample for the device: its view, and the materials in the format of the stages "surface" and "composite". */
#include "render/pass.h"
#include "render/picture/device_state.h"

#include "scene/material_maps.h"

#include <stddef.h>

#define AT(type, member, bytes) (offsetof(struct type, member) == (bytes))
_Static_assert(sizeof(struct pell_picture_frame) == 144 && AT(pell_picture_frame, width, 64) && AT(pell_picture_frame, flags, 96) &&
                   sizeof(struct pell_picture_material) == 160 && AT(pell_picture_material, flags, 144) &&
                   sizeof(struct pell_picture_hit) == 80 && AT(pell_picture_hit, mesh, 64) && sizeof(struct pell_picture_inside) == 144 &&
                   sizeof(struct pell_picture_shown) == 32 && sizeof(struct pell_picture_around) == 64 &&
                   sizeof(struct pell_picture_row) == 56 && sizeof(struct pell_picture_push) == 20 && sizeof(struct pell_spread_push) == 52,
               "as std430 lays them out");

bool picture_is_mapped(const struct pell_scene *scene)
{
    for (size_t i = 0; i < scene->num_materials; i++)
        for (int map = 0; map < PELL_MAPS; map++)
            if (pell_material_map(&scene->materials[i], map)->texture)
                return true;
    for (size_t i = 0; i < scene->num_meshes; i++)
        if (scene->meshes[i].color)
            return true;
    return false;
}

uint32_t picture_flags(const struct pell_picture_sample *s)
{
    const struct pell_irradiance_params *light = s->irradiance;
    const struct pell_composite_params *composite = s->composite;
    struct pell_gpu_buffer *planes[PELL_GPU_PLANES] = { NULL };
    const bool uses_planes = s->pass && pell_pass_planes(s->pass, planes);
    const struct pell_light_lent lent = pell_light_device_lend(s->light);

    return lent.together | (composite->published ? PELL_PICTURE_PUBLISHED : 0u) | (light->separate ? PELL_PICTURE_SINGLE : 0u) |
           (light->shared ? PELL_PICTURE_SHARED : 0u) | (light->thickness ? PELL_PICTURE_THROUGH : 0u) |
           (composite->first ? PELL_PICTURE_FIRST : 0u) | (s->pass ? PELL_PICTURE_SCATTERS : 0u) |
           (pell_scene_has_sheets(composite->scene) ? PELL_PICTURE_SHEETS : 0u) | (s->lens ? PELL_PICTURE_LENS : 0u) |
           (s->spreads ? PELL_PICTURE_SPREADS : 0u) | (s->sample->view.orthographic ? PELL_PICTURE_ORTHOGRAPHIC : 0u) |
           (picture_known(s) ? PELL_PICTURE_INSIDES : 0u) | (lent.environments > 0 ? PELL_PICTURE_SKY : 0u) |
           (picture_is_mapped(s->composite->scene) ? PELL_PICTURE_MAPPED : 0u) |
           (uses_planes && planes[PELL_GPU_PLANE_HIT] ? PELL_PICTURE_HITS : 0u) |
           (uses_planes && planes[PELL_GPU_PLANE_BASE] ? PELL_PICTURE_BASES : 0u) |
           (s->pass && (s->sample->frame->plan->needs & PELL_NEED_STRENGTH) ? PELL_PICTURE_STRENGTH : 0u);
}

uint32_t picture_known(const struct pell_picture_sample *s)
{
    const struct pell_irradiance_params *p = s->irradiance;

    return (p->curvature ? PELL_KNOWN_SHAPE : 0u) | (p->local ? PELL_KNOWN_LOCAL : 0u) | (p->opposed ? PELL_KNOWN_OPPOSED : 0u) |
           (p->solid_light ? PELL_KNOWN_SOLIDS : 0u) | (p->between_faces ? PELL_KNOWN_BETWEEN : 0u) |
           (p->indirect ? PELL_KNOWN_INDIRECT : 0u) | (p->transmits ? PELL_KNOWN_TRANSMITS : 0u);
}

static struct pell_vec4 rgb_and(const float rgb[3], float w)
{
    return (struct pell_vec4) { rgb[0], rgb[1], rgb[2], w };
}

static struct pell_vec4 xyz_and(struct pell_vec3 v, float w)
{
    return (struct pell_vec4) { v.x, v.y, v.z, w };
}

static struct pell_picture_material material_of(const struct pell_picture_sample *s, size_t i)
{
    static const float one[3] = { 1.0f, 1.0f, 1.0f }, none[3];
    const struct pell_composite_params *p = s->composite;
    const struct pell_material *m = &p->scene->materials[i];
    const struct pell_surface_uniform uniform = pell_surface_uniform(m);
    const struct pell_boundary_table *boundary = &p->tables->boundaries[p->tables->boundary[i]];
    const bool textured = !m->opaque && m->color_from == PELL_COLOR_FROM_TEXTURE;
    const float mix = p->mix >= 0.0f ? p->mix : m->mix;
    const struct pell_angle *angle = p->angle && !m->opaque ? &p->angle[i] : NULL;

    return (struct pell_picture_material) {
        .base = rgb_and(m->base_color, m->strength),
        .specular = rgb_and(uniform.specular, m->roughness),
        .emissive = rgb_and(m->emissive, m->metallic),
        .total = rgb_and(m->opaque ? one : p->total[i], textured ? mix : 0.0f),
        .exit_base = rgb_and(angle ? angle->exit_base : one, textured ? 1.0f - mix : 0.0f),
        .exit_slope = rgb_and(angle ? angle->exit_slope : none, boundary->mean),
        .enter_mean = rgb_and(angle ? angle->enter_mean : one, angle ? angle->inverse_eta2 : 1.0f),
        .sheet = rgb_and(m->diffuse_transmission_color, pell_material_is_thin(m) ? m->diffuse_transmission : 0.0f),
        .radius = rgb_and(s->irradiance->radius[i], 0.0f),
        .flags = (m->opaque ? PELL_PICTURE_OPAQUE : 0u) | (textured ? PELL_PICTURE_TEXTURED : 0u) |
                 (p->smooth && !m->opaque ? PELL_PICTURE_SMOOTH : 0u) |
                 (m->specular == PELL_SPECULAR_KELEMEN ? PELL_PICTURE_LINEAR_WIDTH : 0u),
        .normal_scale = m->normal_scale,
        .diffuse = p->diffuse,
    };
}

/* Writes the method's id of the material of each mesh: struct pell_frame.material. */
static void fill_keys(const struct pell_picture_sample *s, uint32_t *keys)
{
    const struct pell_engine_frame *f = s->sample->frame;
    const uint16_t *of_mesh = pell_separates_objects(f->materials, f->plan) ? f->materials->of_mesh : NULL;

    for (size_t i = 0; i < f->scene->num_meshes; i++) {
        const uint16_t key = s->pass ? f->materials->frame_index[f->scene->meshes[i].material + 1] : 0;
        keys[i] = key && of_mesh ? of_mesh[i] : key;
    }
}

void picture_fill(const struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    struct pell_picture_material *materials = pell_gpu_buffer_host(d->buffers[MATERIALS_UP]);
    struct pell_picture_frame *frame = pell_gpu_buffer_host(d->buffers[FRAME_UP]);
    const struct pell_view *v = &s->sample->view;
    const struct pell_specular_tables *t = s->composite->tables;
    const struct pell_rect r = s->composite->rect;

    for (size_t i = 0; i < s->composite->scene->num_materials; i++)
        materials[i] = material_of(s, i);
    fill_keys(s, pell_gpu_buffer_host(d->buffers[KEYS_UP]));
    *frame = (struct pell_picture_frame) {
        .origin = xyz_and(v->origin, v->focal_px),
        .forward = xyz_and(v->forward, (float) s->rays),
        .right = xyz_and(v->right, v->shift_x),
        .up = xyz_and(v->up, v->shift_y),
        .width = v->width,
        .height = v->height,
        .pitch = (int32_t) pell_gpu_pitch(v->width),
        .columns = (int32_t) picture_tiles(r.x1 - r.x0),
        .x0 = r.x0,
        .y0 = r.y0,
        .x1 = r.x1,
        .y1 = r.y1,
        .flags = picture_flags(s),
        .seed = s->irradiance->seed,
        .known = picture_known(s),
        .sample_index = s->irradiance->sample,
        .weight = s->composite->weight,
        .mean_at = (int32_t) (sizeof(t->albedo) / sizeof(float) + t->num_boundaries * PELL_BOUNDARY_MU),
        .depth_mm = v->orthographic ? 0.0f : 1.0f / v->focal_px,
        .fixed_mm = v->orthographic ? 1.0f / v->focal_px : 0.0f,
        .spread = pell_surface_spread(s->sample->frame->settings),
    };
}
