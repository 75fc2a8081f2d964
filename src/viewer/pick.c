/* SPDX-License-Identifier: MIT
 * pick.c - the surface visible at a position in the image: the point, its object and material, and the profile R(r) there. */
#include "viewer/model.h"

#include "cli/cli.h"
#include "render/renderer.h"
#include "visibility/rays.h"

#include <pellucid/medium.h>
#include <pellucid/profile.h>

#include <math.h>

#define RADII 48

static json_t *three(const float *v)
{
    return json_pack("[f,f,f]", (double) v[0], (double) v[1], (double) v[2]);
}

/* R(r) of the three channels over radii spaced uniformly in log r that hold 99.9 % of the light. */
static json_t *profile_json(const struct pell_frame_material *m)
{
    json_t *radii = json_array(), *channels = json_array(), *totals = json_array(), *mean = json_array();
    double far = 1e-3;

    for (int c = 0; c < 3; c++)
        far = fmax(far, pell_profile_sample(&m->profile[c], 0.999));
    for (int i = 0; i < RADII; i++)
        json_array_append_new(radii, json_real(far * pow(1e-3, 1.0 - (double) i / (RADII - 1))));
    for (int c = 0; c < 3; c++) {
        json_t *values = json_array();
        for (size_t i = 0; i < RADII; i++) {
            const double v = pell_profile_eval(&m->profile[c], json_real_value(json_array_get(radii, i)));
            json_array_append_new(values, cli_number(v));
        }
        json_array_append_new(channels, values);
        json_array_append_new(totals, json_real(pell_profile_total(&m->profile[c])));
        json_array_append_new(mean, json_real(pell_profile_sample(&m->profile[c], 0.5)));
    }
    return json_pack("{s:o,s:o,s:o,s:o}", "r_mm", radii, "R", channels, "total", totals, "half_light_mm", mean);
}

json_t *viewer_model_pick(const struct viewer_model *m, const struct viewer_message *pick)
{
    const struct pell_services *services =
        m->slots[VIEWER_LIVE_A].renderer ? pell_renderer_services(m->slots[VIEWER_LIVE_A].renderer) : NULL;
    json_t *o = json_pack("{s:s,s:I,s:f,s:f}", "type", "picked", "id", (json_int_t) pick->id, "x", pick->x, "y", pick->y);
    const int width = services && services->settings ? services->settings->width : 0, height = width ? services->settings->height : 0;
    struct pell_vec3 start, direction;
    struct pell_ray ray = { .tfar = INFINITY, .mask = PELL_RAY_CAMERA };
    struct pell_hit hit;
    struct pell_view view;
    const struct pell_mesh *mesh;
    const struct pell_material *material;
    float at[3];
    uint16_t index;

    if (!o || !services || !services->rays || width < 1)
        return o;
    view = pell_view_make(&m->scene->cameras[0], width, height, 0.0f, 0.0f);
    pell_view_ray(&view, (float) (pick->x * width) - 0.5f, (float) (pick->y * height) - 0.5f, &start, &direction);
    vec3_store(start, ray.origin);
    vec3_store(direction, ray.direction);
    if (!pell_rays_closest(services->rays, &ray, &hit))
        return o;
    vec3_store(vec3_add(start, vec3_mul(direction, hit.t)), at);
    mesh = &m->scene->meshes[hit.mesh];
    material = &m->scene->materials[mesh->material];
    json_object_set_new(o, "at", three(at));
    json_object_set_new(o, "depth_mm", json_real((double) hit.t));
    json_object_set_new(o, "width", json_integer(width));
    json_object_set_new(o, "mm_per_pixel", json_real((double) ((view.orthographic ? 1.0f : hit.t) / view.focal_px)));
    json_object_set_new(o, "object", cli_text(mesh->name ? mesh->name : ""));
    json_object_set_new(o, "material", cli_text(material->name ? material->name : ""));
    json_object_set_new(o, "preset", cli_text(material->preset ? material->preset : ""));
    index = services->frame_index[mesh->material + 1];
    if (index && services->materials[index - 1].profile)
        json_object_set_new(o, "profile", profile_json(&services->materials[index - 1]));
    return o;
}
