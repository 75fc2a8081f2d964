/* SPDX-License-Identifier: MIT
 * test_material_inputs.c - a material input that a method reports as ignored changes no bit of its scattered light; any other input
 * changes some. Runs over the registry, as test_contract_scene.c does. */
#include "contract.h"
#include "layers_rig.h"
#include "method_form.h"

/* A map of 2 x 2 texels around the middle value, or of that value everywhere. */
static struct pell_texture_map map_of(struct stage *s, bool varied, uint8_t blue)
{
    static const uint8_t steps[16] = { 250, 120, 40, 255, 60, 200, 130, 255, 30, 90, 220, 255, 180, 40, 90, 255 };
    struct pell_texture_map map = { .matrix = { 1, 0, 0, 0, 1, 0 } };
    uint8_t pixels[16];

    for (size_t i = 0; i < sizeof(pixels); i++)
        pixels[i] = varied ? steps[i] : i % 4 == 2 ? blue : 128;
    map.texture = shapes_texture(s->scene, 2, 2, 4, false, pixels);
    return map;
}

static void strength_map(struct stage *s, struct pell_material *m, bool varied)
{
    m->strength_map = map_of(s, varied, 128);
}

static void color_map(struct stage *s, struct pell_material *m, bool varied)
{
    m->color_from = PELL_COLOR_FROM_TEXTURE;
    m->base_color_map = map_of(s, varied, 128);
}

static void color(struct stage *s, struct pell_material *m, bool varied)
{
    (void) s;
    m->color_from = PELL_COLOR_FROM_TEXTURE;
    m->base_color[0] = varied ? 0.2f : 0.6f;
}

static void mix(struct stage *s, struct pell_material *m, bool varied)
{
    m->color_from = PELL_COLOR_FROM_TEXTURE;
    m->base_color_map = map_of(s, true, 128);
    m->mix = varied ? 1.0f : 0.25f;
}

static void normal_map(struct stage *s, struct pell_material *m, bool varied)
{
    m->normal_map = map_of(s, varied, 255);
}

static void normal_scale(struct stage *s, struct pell_material *m, bool varied)
{
    m->normal_map = map_of(s, true, 255);
    m->normal_scale = varied ? 0.5f : 1.0f;
}

static void roughness_map(struct stage *s, struct pell_material *m, bool varied)
{
    m->roughness = 1.0f;
    m->roughness_map = map_of(s, varied, 128);
}

static void roughness(struct stage *s, struct pell_material *m, bool varied)
{
    (void) s;
    m->roughness = varied ? 0.2f : 0.8f;
}

static void specular_map(struct stage *s, struct pell_material *m, bool varied)
{
    m->rho_s_map = map_of(s, varied, 128);
}

static void specular(struct stage *s, struct pell_material *m, bool varied)
{
    (void) s;
    m->rho_s = varied ? 0.2f : 0.8f;
}

static void specular_color_map(struct stage *s, struct pell_material *m, bool varied)
{
    m->specular_color_map = map_of(s, varied, 128);
}

static void specular_color(struct stage *s, struct pell_material *m, bool varied)
{
    (void) s;
    m->specular_color[1] = varied ? 0.2f : 0.8f;
}

static void specular_model(struct stage *s, struct pell_material *m, bool varied)
{
    (void) s;
    m->specular = varied ? PELL_SPECULAR_PHONG : PELL_SPECULAR_GGX;
}

static void profile_model(struct stage *s, struct pell_material *m, bool varied)
{
    (void) s;
    m->model = varied ? PELL_PROFILE_NORMALIZED_DIFFUSION : PELL_PROFILE_DIPOLE;
}

static void depth_map(struct stage *s, struct pell_material *m, bool varied)
{
    static const double optics[2][3] = { { 1.0, 1.2, 0.3 }, { 2.0, 2.1, 0.0 } };
    const size_t material = (size_t) (m - s->scene->materials);

    layers_set(s->scene, material, 2, optics, (const float[2]) { 2.0f, INFINITY }, PELL_SUBSTRATE_LAST);
    s->scene->materials[material].layers[0].depth_map = map_of(s, varied, 128);
}

static const struct {
    unsigned flag;
    const char *name;
    bool warned; /* a warning names inputs that were set by the user and are ignored */
    void (*set)(struct stage *s, struct pell_material *m, bool varied);
} inputs[] = {
    { PELL_IGNORES_STRENGTH_MAP, "strength map", true, strength_map },
    { PELL_IGNORES_COLOR, "colour map", true, color_map },
    { PELL_IGNORES_COLOR, "colour", true, color },
    { PELL_IGNORES_MIX, "mix", false, mix },
    { PELL_IGNORES_NORMAL_MAP, "normal map", true, normal_map },
    { PELL_IGNORES_NORMAL_MAP, "normal scale", true, normal_scale },
    { PELL_IGNORES_ROUGHNESS, "roughness map", true, roughness_map },
    { PELL_IGNORES_ROUGHNESS, "roughness", false, roughness },
    { PELL_IGNORES_SPECULAR, "specular map", true, specular_map },
    { PELL_IGNORES_SPECULAR, "specular", false, specular },
    { PELL_IGNORES_SPECULAR, "specular colour map", true, specular_color_map },
    { PELL_IGNORES_SPECULAR, "specular colour", false, specular_color },
    { PELL_IGNORES_SPECULAR, "specular model", false, specular_model },
    { PELL_IGNORES_PROFILE_MODEL, "profile model", false, profile_model },
    { PELL_IGNORES_DEPTH_MAPS, "depth map of a layer", true, depth_map },
};

enum { WIDE = 16, HIGH = 12 }; /* px */

/* The scattered light of the method, and its warnings. */
struct scattered {
    size_t size;
    float *data;
    char warnings[sizeof(((struct kept_messages *) NULL)->all_warnings)];
};

/* A slab whose material has one input, changed (`varied`) or not. */
static struct scattered scatter(const struct party *on, size_t input, bool varied)
{
    struct stage_device *device = stage_shared_device(on->engine, 2);
    struct scattered result = { 0 };
    struct pell_mesh *mesh;
    struct pell_material *m;
    struct stage s;
    size_t material;

    device->kept = (struct kept_messages) { 0 };
    stage_start_borrowed(&s, device, WIDE, HIGH);
    s.settings.layers = true;
    s.settings.profile = 0;
    m = stage_medium(&s, "marble", &material);
    m->gaussians.count = 0;
    m->rho_s = 1.0f;
    m->roughness = 0.5f;
    inputs[input].set(&s, m, varied);
    mesh = shapes_box(s.scene, material, vec3(-12.0f, -30.0f, -30.0f), vec3(12.0f, 30.0f, 0.0f));
    mesh->uv[0] = pell_calloc(s.ctx, mesh->num_vertices, 2 * sizeof(float));
    for (uint32_t i = 0; i < mesh->num_vertices; i++) {
        mesh->uv[0][2 * i] = 0.5f + mesh->position[3 * i] / 26.0f;
        mesh->uv[0][2 * i + 1] = 0.5f + mesh->position[3 * i + 1] / 26.0f;
    }
    stage_light(&s, PELL_LIGHT_POINT, vec3(-8.0f, 0.0f, 6.0f), vec3(0, 0, 0), 50.0f);
    stage_camera(&s, vec3(0.0f, 0.0f, 200.0f), vec3(0, 0, 0), 0.0f, 24.0f);
    stage_method(&s, on->method->name, method_form(on->method));
    stage_render(&s);
    result.data = calloc(s.image.num_channels, WIDE * HIGH * sizeof(float));
    for (size_t i = 0; i < s.image.num_channels; i++) {
        const char *name = s.image.channels[i].name;
        if (strncmp(name, "diffuse", 7) != 0 && strncmp(name, "transmission", 12) != 0)
            continue;
        for (int y = 0; y < HIGH; y++, result.size += WIDE)
            memcpy(result.data + result.size, s.image.channels[i].data + y * s.image.channels[i].stride, WIDE * sizeof(float));
    }
    memcpy(result.warnings, device->kept.all_warnings, sizeof(result.warnings));
    stage_finish(&s);
    return result;
}

/* Whether a warning says that the method ignores the input. */
static bool names(const char *warnings, const char *method, const char *input)
{
    char head[80];
    const char *at, *found;

    snprintf(head, sizeof(head), "%s ignores its ", method);
    at = strstr(warnings, head);
    found = at ? strstr(at, input) : NULL;
    return found && found < strchr(at, '\n');
}

static void says_what_it_ignores(void **state)
{
    const struct party *const on = *state;

    for (size_t i = 0; i < PELL_COUNT(inputs); i += SLOW ? 3 : 1) {
        struct scattered varied = scatter(on, i, true), constant = scatter(on, i, false);
        const bool same = memcmp(varied.data, constant.data, constant.size * sizeof(float)) == 0,
                   says = on->method->ignores & inputs[i].flag;
        double sum = 0.0;

        for (size_t k = 0; k < constant.size; k++)
            sum += (double) constant.data[k];
        REQUIRE(sum > 0.0 && varied.size == constant.size);
        if (same != says)
            fail_msg("%s %s the %s", on->method->name, same ? "ignores" : "reads", inputs[i].name);
        if ((says && inputs[i].warned) != names(varied.warnings, on->method->name, pell_ignored_name(inputs[i].flag)))
            fail_msg("%s and its %s: what is warned of is \"%s\"", on->method->name, inputs[i].name, varied.warnings);
        free(varied.data);
        free(constant.data);
    }
    stage_finish_devices(); /* a context prints this many warnings of a kind, and no more */
}

static void every_input_is_tried(void **state)
{
    unsigned tried = 0;

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(inputs); i++)
        tried |= inputs[i].flag;
    for (unsigned flag = 1; flag; flag <<= 1)
        assert_int_equal((tried & flag) != 0, pell_ignored_name(flag) != NULL);
}

#define PROMISE(name)                                                                                                                      \
    {                                                                                                                                      \
#name, name, false                                                                                                                 \
    }

int main(int argc, char **argv)
{
    static const struct promise promises[] = {
        PROMISE(says_what_it_ignores),
        PROMISE(every_input_is_tried),
        { 0 },
    };
    static const struct contract contract = { promises, NULL, NULL, NULL };

    return contract_run(&contract, argc, argv);
}
