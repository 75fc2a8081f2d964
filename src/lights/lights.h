/* SPDX-License-Identifier: MIT
 *
 * lights.h - lights prepared for packets of pixels, and the parts of an environment.
 *
 * A light source is what the irradiance stage loops over: a light of the scene, or one of the directions that represent an environment's
 * bright parts.
 */
#ifndef PELL_LIGHTS_H
#define PELL_LIGHTS_H

#include "image/color.h"
#include "lights/specular_tables.h"
#include "math/sampling.h"
#include "shared/environment.h"
#include "shared/light_data.h"
#include "visibility/light_grid.h"

#include <pellucid/render.h>

#define PELL_LANES 16

struct pell_light_source {
    enum pell_light_type type;            /* never PELL_LIGHT_ENVIRONMENT */
    struct pell_vec3 position, direction; /* direction: unit, direction of travel of the light */
    struct pell_vec3 right, up;           /* unit; rect, disc: times half the extent; right = direction x up; of an environment: times the
                                           * tangents of half the angles of its samples */
    float power[3];                       /* W/sr; W/m^2; rect and disc: radiance x area / samples, so that power cos / d^2 is irradiance */
    float scale;                          /* factor of 1/d_mm^2: 1e6 for W/sr, 1 for areas */
    float spot_scale, spot_offset;
    float inv_range;   /* 0: unlimited */
    float sample_area; /* mm^2 per sample; 0 for lights without extent */
    int samples;
    const struct pell_texture *image;
    float image_u, image_v; /* from the plane at distance 1 (directional: from mm) to half the image's size */
    int environment;        /* index of its environment, -1: none; environment lights make no highlight */
    bool compact;           /* of an environment: its light is excluded from the smooth table */
    int turn, turns;        /* of an environment: of each `turns` consecutive lights a pixel may sample one per multisample, in turn */
    int light;              /* index in the scene, unless it is an environment's */
    struct pell_light_grid *grid; /* point or spot: visibility grid for its shadows; NULL: rays. Owned by the lights */
};

/* --- environment.c ------------------------------------------------------------------------------------------------------------ */

#define PELL_ENV_ETAS 8   /* number of indices of refraction with their own table for smooth boundaries */
#define PELL_ENV_LEVELS 7 /* prefiltered maps for reflection */

struct pell_env_level {
    int width, height;
    float *rgb; /* interleaved */
};

struct pell_environment {
    const struct pell_texture *image; /* NULL: constant */
    float power[3], cos_rotate, sin_rotate;
    int light; /* index in the scene */
    /* Irradiance over the normal: E0 = Int L cos, and per model and roughness Int L scale cos, Int L bias cos (optics/medium/specular.h),
     * and per smooth boundary Int L F_t cos; without the compact lights. `size` floats per node. */
    float *nodes;
    int size, model_at[PELL_SPECULAR_MODELS], boundary_at;
    int num_levels; /* 0: the reflection is constant */
    struct pell_env_level levels[PELL_ENV_LEVELS];
};

struct pell_lights {
    struct pell_context *ctx;
    enum pell_simd_level simd; /* of the light kernels */
    struct pell_light_source *sources;
    struct pell_light_data *data; /* per light */
    size_t num_sources, capacity;
    struct pell_environment *environments;
    size_t num_environments;
    int light_samples, ambient_samples; /* per multisample */
    int light_bits, ambient_bits;       /* bits of the index of a frame's samples */
    uint32_t together;                  /* bits of an environment's samples that all pixels share, so that adjacent rays are coherent */
    uint8_t *eta_slot;                  /* by material: index of its smooth boundary in the environments' tables */
    size_t num_materials;
    /* (object, material) of every mesh, sorted: the solids that a pixel's material may belong to. */
    struct pell_lights_part {
        int object, material;
    } * parts;
    size_t num_parts;
};

/* Frame-independent data: area-light samples, the environment resolved into lights and a smooth part, tables. */
PELL_NODISCARD enum pell_result pell_lights_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                   const struct pell_settings *settings, struct pell_pool *pool, struct pell_lights **out);
void pell_lights_destroy(struct pell_lights **lights);

/* Visibility grid of a light of the scene (visibility/light_grid.h), valid while the lights exist; NULL: none. */
const struct pell_light_grid *pell_lights_grid(const struct pell_lights *lights, size_t light);

/* Radiance of the environment in a direction, for backgrounds; false if the scene has none. */
bool pell_lights_background(const struct pell_lights *lights, struct pell_vec3 direction, float rgb[3]);

/* Light sources for the brightest parts of an environment. */
struct pell_environment_lights {
    struct pell_light_source *sources;
    size_t count;
};

struct pell_environment_params {
    int index;      /* index of the environment among the environments */
    int max_lights; /* maximum number of light sources for its brightest parts */
    int msaa;
    const struct pell_specular_tables *tables;
    struct pell_pool *pool;
};

/* Resolves a light of the scene (an environment) into `env` and light sources. `env` is zeroed; call its finish function, and free
 * out->sources, even after a failure. */
PELL_NODISCARD enum pell_result pell_environment_create(struct pell_context *ctx, const struct pell_light *light,
                                                        const struct pell_environment_params *params, struct pell_environment *env,
                                                        struct pell_environment_lights *out);
void pell_environment_finish(struct pell_context *ctx, struct pell_environment *env);

/* Lookup in the table over the normal: light that enters at a surface with this normal, T = 1 - rho_s albedo_f. */
struct pell_env_query {
    enum pell_specular_model model;
    float roughness, f0, rho_s;
    int smooth; /* slot of a smooth boundary, or -1 */
};
void pell_environment_irradiance(const struct pell_environment *env, struct pell_vec3 normal, const struct pell_env_query *query,
                                 float rgb[3]);
/* The environments' smooth part of the irradiance at a point, relative to the total, averaged over all orientations; without shadows. */
float pell_lights_diffuse(const struct pell_lights *lights, struct pell_vec3 at);

/* Radiance from a direction, prefiltered by a lobe of this width (pell_lobe_width). */
void pell_environment_reflection(const struct pell_environment *env, struct pell_vec3 direction, float width, float rgb[3]);
void pell_environment_radiance(const struct pell_environment *env, struct pell_vec3 direction, float rgb[3]);

/* The environments in the format of a device, for the formulas of shared/environment.h; returns the number of words, 0 without
 * environments. `out` NULL: only counts. The header: number of environments, samples per multisample of their visibility, the first word of
 * the materials' slots of smooth boundaries. A row per environment: first word of its nodes, their size, boundary_at, levels, cosine and
 * sine of the rotation, power; first word of its broad lights (direction, power), and their number; from word 12 on model_at; from 20 on
 * for each level the first word, width, height and roughness. */
enum { PELL_ENV_HEAD = 4, PELL_ENV_ROW = 48 };
size_t pell_lights_environment_words(const struct pell_lights *lights, uint32_t *out);

/* For lookups only: sets image, power and rotation of a zeroed `env`, which then needs no finish. */
void pell_environment_init(struct pell_environment *env, const struct pell_light *light);
/* Image coordinates of a unit direction, and the inverse: u = 1/2 at the centre, growing to the right; v = 0 at the top. */
void pell_environment_uv(const struct pell_environment *env, struct pell_vec3 direction, float *u, float *v);
struct pell_vec3 pell_environment_direction(const struct pell_environment *env, double u, double v);

/* --- lights.c ----------------------------------------------------------------------------------------------------------------- */

/* Prepares a light of the scene other than an environment, with `samples` samples if it has extent; false: it is dark. */
bool pell_light_source_make(const struct pell_scene *scene, const struct pell_light *light, int samples, struct pell_light_source *source);
/* The data that kernels, and shaders, read of a light. */
struct pell_light_data pell_light_data_of(const struct pell_scene *scene, const struct pell_light_source *source);
/* Colour of the projected image for light from `from` along the unit `direction` to `receiver` (directional: only this matters); black
 * outside of the image. */
void pell_light_source_image(const struct pell_light_source *source, struct pell_vec3 from, struct pell_vec3 direction,
                             struct pell_vec3 receiver, float rgb[3]);

/* True if some mesh of `object` has `material`. */
bool pell_lights_part(const struct pell_lights *lights, int object, int material);

#endif
