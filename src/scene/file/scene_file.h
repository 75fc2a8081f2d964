/* SPDX-License-Identifier: MIT
 * scene_file.h - what the files of the scene-file reader share. */
#ifndef PELL_SCENE_FILE_H
#define PELL_SCENE_FILE_H

#include "base/file.h"
#include "scene/file/json.h"
#include "scene/names.h"
#include "scene/scene.h"

#define RADIANS (PELL_PI / 180.0)

struct pell_scene_reader {
    struct pell_context *ctx;
    const struct pell_loader *loader;
    struct pell_json_file file;
    struct pell_scene *scene;  /* contents read so far, in mm */
    struct pell_import import; /* for images */
    const char *granted;       /* see struct pell_loader */
    struct pell_scale scale;   /* of the top level */
    struct pell_names objects; /* names given by "object" of meshes */
    size_t *first_of_object, object_capacity;
    struct pell_moment moment;
    struct pell_text moment_where;
    double image_rate;           /* of image sequences, 1/s */
    bool sequences;              /* the scene has image sequences */
    char animation[24];          /* an index, as text */
    double unit;                 /* mm per mesh unit, for positions */
    struct pell_json background; /* parent of a ground nested in it */
    const json_t *layers;        /* layers read last, and their material; NULL: others must read them again */
    size_t layers_of;
};

/* --- file/values.c ------------------------------------------------------------------------------------------------------------ */

bool pell_json_has(const struct pell_json *at, const char *key);
/* Parses a text with a unit ("70mm"). Positions may be 0 and negative. */
PELL_NODISCARD enum pell_result pell_scene_text_length(const struct pell_json *at, bool any_sign, double *mm);
/* Loads an image that the scene file names: missing is an error, broken a warning and NULL. */
PELL_NODISCARD enum pell_result pell_scene_picture(struct pell_scene_reader *r, const struct pell_json *at, const char *reference,
                                                   enum pell_image_role role, struct pell_texture **texture);
/* The same where no fallback exists: a broken image is an error, too. */
PELL_NODISCARD enum pell_result pell_scene_need_picture(struct pell_scene_reader *r, const struct pell_json *at, const char *reference,
                                                        enum pell_image_role role, struct pell_texture **texture);
/* The same for a key, if present. */
PELL_NODISCARD enum pell_result pell_scene_need_picture_at(struct pell_scene_reader *r, const struct pell_json *parent, const char *key,
                                                           struct pell_texture **texture);
/* Getters as in json.h. A length above 0 and a position are numbers times `unit` (mm), or texts with a unit; a colour is three numbers or
 * one for all; a direction becomes a unit vector. */
PELL_NODISCARD enum pell_result pell_scene_length(const struct pell_json *parent, const char *key, double unit, float *mm);
PELL_NODISCARD enum pell_result pell_scene_position(const struct pell_json *parent, const char *key, double unit, double *mm);
PELL_NODISCARD enum pell_result pell_scene_rgb(const struct pell_json *parent, const char *key, double max, float *rgb);
PELL_NODISCARD enum pell_result pell_scene_direction(const struct pell_json *parent, const char *key, float *direction);
/* The direction from `at` towards the point `to`, which key "to" of the parent has given; the two must differ. */
PELL_NODISCARD enum pell_result pell_scene_aim(const struct pell_json *parent, const char *key, const double *at, const double *to,
                                               float *direction);

/* --- file/lights.c ------------------------------------------------------------------------------------------------------------ */

enum { PELL_LIGHT_KINDS = 7 };
extern const struct pell_scene_keys pell_light_keys[PELL_LIGHT_KINDS];

/* "lights" of the root. */
PELL_NODISCARD enum pell_result pell_scene_lights(struct pell_scene_reader *r, const struct pell_json *root, struct pell_extras *extras);

/* --- file/meshes.c ---------------------------------------------------------------------------------------------------------- */

enum { PELL_MESH_KEYS = 10 };
extern const char *const pell_mesh_keys[PELL_MESH_KEYS];

/* "mesh" or "meshes" of the root. */
PELL_NODISCARD enum pell_result pell_scene_meshes(struct pell_scene_reader *r, const struct pell_json *root);

/* --- file/maps.c ------------------------------------------------------------------------------------------------------------ */

enum { PELL_TEXTURE_KEYS = 8 };
extern const char *const pell_texture_keys[PELL_TEXTURE_KEYS];

/* The map of one of these keys; NULL: unknown key. */
struct pell_texture_map *pell_scene_map_called(struct pell_material *m, const char *name);
/* 0 to 3 for "r", "g", "b", "a"; -1: none of them. */
int pell_scene_channel_called(const char *name);
/* Splits "file.png#r": the length of the file's name, and its channel; 0 if there is none. */
PELL_NODISCARD enum pell_result pell_scene_channel_of(const struct pell_json *at, const char *text, size_t *length, int *channel);
/* "baseColor.a": a channel of one of the material's textures, which may be unset. False: the text is something else. */
bool pell_scene_own_map(const struct pell_material *m, const char *text, struct pell_texture_map *map);

/* --- file/materials.c --------------------------------------------------------------------------------------------------------- */

enum { PELL_MATERIAL_KEYS = 28, PELL_SPECULAR_KEYS = 3, PELL_SKIN_KEYS = 6 };
extern const char *const pell_skin_keys[PELL_SKIN_KEYS]; /* material_file.c */
extern const char *const pell_material_keys[PELL_MATERIAL_KEYS];
extern const char *const pell_specular_keys[PELL_SPECULAR_KEYS];

/* A built-in entry, or one from a material file below the scene's folder; entry->name is owned by the caller. */
PELL_NODISCARD enum pell_result pell_scene_material_entry(struct pell_scene_reader *r, const struct pell_json *at, const char *name,
                                                          struct pell_material_entry *entry);
/* Changes a material according to the object. */
PELL_NODISCARD enum pell_result pell_scene_overlay(struct pell_scene_reader *r, const struct pell_json *at, size_t material);
/* "materials" of the root. */
PELL_NODISCARD enum pell_result pell_scene_overlay_all(struct pell_scene_reader *r, const struct pell_json *root);

/* --- file/layers.c ------------------------------------------------------------------------------------------------------------ */

enum { PELL_LAYER_KEYS = 10 };
extern const char *const pell_layer_keys[PELL_LAYER_KEYS];

/* "layers" of a material, and the keys next to it that apply to all of them. `own`: the material has no other profile, and uses theirs. */
PELL_NODISCARD enum pell_result pell_scene_read_layers(struct pell_scene_reader *r, const struct pell_json *at, bool own, size_t material);

#endif
