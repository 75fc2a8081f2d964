/* SPDX-License-Identifier: MIT
 *
 * lights.h - lights made ready for packets of pixels, and the environment's parts.
 *
 * A light is a light as the stage loops over it: a light of the scene, or one of the directions that stand for an environment's
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
    struct pell_vec3 position, direction; /* direction: unit, the way the light goes */
    struct pell_vec3 right, up;           /* unit; rect, disc: times half the extent; right = direction x up; of an environment: times the
                                           * tangents of half the angles that its samples come from */
    float power[3];                       /* W/sr; W/m^2; rect and disc: radiance x area / samples, so that power cos / d^2 is irradiance */
    float scale;                          /* what 1/d_mm^2 is multiplied by: 1e6 for W/sr, 1 for areas */
    float spot_scale, spot_offset;
    float inv_range;   /* 0: no cut-off */
    float sample_area; /* mm^2 that one sample stands for; 0 for lights without extent */
    int samples;
    const struct pell_texture *image;
    float image_u, image_v; /* from the plane at distance 1 (directional: from mm) to the picture's halves */
    int environment;        /* index of the environment that it belongs to, -1: none; those make no highlight */
    bool compact;           /* of an environment: its light is left out of the smooth table */
    int turn, turns; /* of an environment: of each `turns` lights that follow each other a pixel may take one a multisample, by turns */
    int light;       /* of the scene, where it is no environment's */
    struct pell_light_grid *grid; /* of a point or spot: what it sees, for its shadows; NULL: rays. The lights' own */
};

/* --- environment.c ------------------------------------------------------------------------------------------------------------ */

#define PELL_ENV_ETAS 8   /* indices of refraction with a table of their own for smooth boundaries */
#define PELL_ENV_LEVELS 7 /* of the reflection's prefiltered maps */

struct pell_env_level {
    int width, height;
    float *rgb; /* interleaved */
};

struct pell_environment {
    const struct pell_texture *image; /* NULL: constant */
    float power[3], cos_rotate, sin_rotate;
    int light; /* of the scene */
    /* Irradiance over the normal: E0 = Int L cos, and per model and roughness Int L scale cos, Int L bias cos (optics/medium/specular.h),
     * and per smooth boundary Int L F_t cos; without the compact lights. `size` floats a node. */
    float *nodes;
    int size, model_at[PELL_SPECULAR_MODELS], boundary_at;
    int num_levels; /* 0: the reflection is constant */
    struct pell_env_level levels[PELL_ENV_LEVELS];
};

struct pell_lights {
    struct pell_context *ctx;
    enum pell_simd_level simd; /* that light is computed by */
    struct pell_light_source *sources;
    struct pell_light_data *data; /* of each light */
    size_t num_sources, capacity;
    struct pell_environment *environments;
    size_t num_environments;
    int light_samples, ambient_samples; /* of a multisample */
    int light_bits, ambient_bits;       /* of the numbers of a frame's samples */
    uint32_t
        together; /* the bits of an environment's samples that all pixels have alike, so that rays side by side go about the same way */
    uint8_t *eta_slot; /* of a material: index of its smooth boundary in the environments' tables */
    size_t num_materials;
    /* (object, material) of every mesh, sorted: which solids a pixel's material belongs to. */
    struct pell_lights_part {
        int object, material;
    } * parts;
    size_t num_parts;
};

/* What does not change from frame to frame: area-light samples, the environment resolved into lights and a smooth rest, tables. */
PELL_NODISCARD enum pell_result pell_lights_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                   const struct pell_settings *settings, struct pell_pool *pool, struct pell_lights **out);
void pell_lights_destroy(struct pell_lights **lights);

/* What a light of the scene sees (visibility/light_grid.h), while the lights live; NULL: it has none. */
const struct pell_light_grid *pell_lights_grid(const struct pell_lights *lights, size_t light);

/* Radiance of the environment in a direction, for backgrounds; false where the scene has none. */
bool pell_lights_background(const struct pell_lights *lights, struct pell_vec3 direction, float rgb[3]);

/* Light sources for the brightest parts of an environment. */
struct pell_environment_lights {
    struct pell_light_source *sources;
    size_t count;
};

struct pell_environment_params {
    int index;      /* of the environment among those of the scene */
    int max_lights; /* sources for its brightest parts, at most */
    int msaa;
    const struct pell_specular_tables *tables;
    struct pell_pool *pool;
};

/* Resolves a light of the scene (an environment) into `env` and light sources. `env` is zeroed; finish it, and free out->lights, also after
 * a failure. */
PELL_NODISCARD enum pell_result pell_environment_create(struct pell_context *ctx, const struct pell_light *light,
                                                        const struct pell_environment_params *params, struct pell_environment *env,
                                                        struct pell_environment_lights *out);
void pell_environment_finish(struct pell_context *ctx, struct pell_environment *env);

/* What the table over the normal says: light that enters at a surface with this normal, T = 1 - rho_s albedo_f. */
struct pell_env_query {
    enum pell_specular_model model;
    float roughness, f0, rho_s;
    int smooth; /* slot of a smooth boundary, or -1 */
};
void pell_environment_irradiance(const struct pell_environment *env, struct pell_vec3 normal, const struct pell_env_query *query,
                                 float rgb[3]);
/* Of the light at a place, the share of the environments' smooth rest, in the mean over faces that look all ways; without shadows. */
float pell_lights_diffuse(const struct pell_lights *lights, struct pell_vec3 at);

/* Radiance out of a direction as a lobe of that width (pell_lobe_width) sees it. */
void pell_environment_reflection(const struct pell_environment *env, struct pell_vec3 direction, float width, float rgb[3]);
void pell_environment_radiance(const struct pell_environment *env, struct pell_vec3 direction, float rgb[3]);

/* The environments as words for a device, for the formulas of shared/environment.h; returns how many, 0 without environments. `out` NULL:
 * they are counted. A head: environments, samples of a multisample that look for the sky, the first word of the materials' slots of smooth
 * boundaries. A row of each environment: its nodes' first word, their size, boundary_at, levels, cosine and sine of the rotation, power;
 * the first word of its broad lights (direction, power), and how many; from word 12 on model_at; from 20 on of each level the first word,
 * width, height and roughness. */
enum { PELL_ENV_HEAD = 4, PELL_ENV_ROW = 48 };
size_t pell_lights_environment_words(const struct pell_lights *lights, uint32_t *out);

/* For looking up alone: sets picture, power and rotation of a zeroed `env`, which then needs no finish. */
void pell_environment_aim(struct pell_environment *env, const struct pell_light *light);
/* Where in the picture a unit direction is, and back: u = 1/2 at the centre, growing to the right; v = 0 at the top. */
void pell_environment_place(const struct pell_environment *env, struct pell_vec3 direction, float *u, float *v);
struct pell_vec3 pell_environment_direction(const struct pell_environment *env, double u, double v);

/* --- lights.c ----------------------------------------------------------------------------------------------------------------- */

/* A light of the scene, no environment, whose face is sampled `samples` times; false where it is dark. */
bool pell_light_source_make(const struct pell_scene *scene, const struct pell_light *light, int samples, struct pell_light_source *source);
/* What kernels, and shaders, read of a light. */
struct pell_light_data pell_light_data_of(const struct pell_scene *scene, const struct pell_light_source *source);
/* The projected image's colour of light that leaves the light at `from` along the unit `direction` and meets `place` (directional: that
 * alone counts); black outside of the picture. */
void pell_light_source_image(const struct pell_light_source *source, struct pell_vec3 from, struct pell_vec3 direction,
                             struct pell_vec3 place, float rgb[3]);

/* True if some mesh of `object` has `material`. */
bool pell_lights_part(const struct pell_lights *lights, int object, int material);

#endif
