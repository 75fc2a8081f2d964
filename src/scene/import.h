/* SPDX-License-Identifier: MIT
 *
 * import.h - what importers and the scene loader share. An importer reads one file into a fresh scene IN THE FILE'S OWN UNITS; the
 * loader (load.c) is the only place that turns units into mm (pell_scene_transform), merges files and completes the scene.
 *
 * Lengths that an importer finds in metres or per metre (glTF's attenuation distance) are stored per file unit, too.
 */
#ifndef PELL_IMPORT_H
#define PELL_IMPORT_H

#include "base/base.h"
#include "math/vec.h"
#include "scene/material_maps.h"

/* The time of a file's animation to load. */
struct pell_moment {
    bool timed;            /* false: the file's rest pose */
    double time;           /* seconds */
    const char *animation; /* name or number; NULL: the first */
    const char *where;     /* what chose the animation, for messages */
    enum pell_result code; /* error code if that animation does not exist; 0: PELL_ERR_INVALID */
};

struct pell_loader;

struct pell_import {
    struct pell_context *ctx;
    const struct pell_loader *loader;
    struct pell_scene *scene; /* the file's content, in its units; a mesh for which it names no material has material -1 */
    const char *path;         /* as the user gave it: for messages */
    const char *root;         /* folder that external files must lie under */
    bool allow_outside;
    bool replaces_materials; /* the caller's material takes the place of the file's */
    bool needed;             /* the caller itself refuses an unusable image: no warning */
    struct pell_moment moment;
    double default_mm_per_unit; /* set by the importer: glTF 1000; 0: the format has no unit */
    size_t animations;          /* set by the importer: how many the file has */
};

/* `data` has a NUL after its `size` bytes. */
PELL_NODISCARD enum pell_result pell_import_gltf(struct pell_import *import, const uint8_t *data, size_t size); /* .gltf and .glb */
PELL_NODISCARD enum pell_result pell_import_obj(struct pell_import *import, const uint8_t *data, size_t size);
PELL_NODISCARD enum pell_result pell_import_ply(struct pell_import *import, const uint8_t *data, size_t size);
PELL_NODISCARD enum pell_result pell_import_stl(struct pell_import *import, const uint8_t *data, size_t size);
/* Whether the file size matches the number of triangles in its header. */
bool pell_stl_is_binary(const uint8_t *data, size_t size);

/* Loads an external image as a texture of the scene; the same (file, role) is read once. A broken or missing image is a warning that names
 * it, and *texture = NULL with PELL_OK; only NOMEM and CANCELLED fail. */
PELL_NODISCARD enum pell_result pell_import_texture(struct pell_import *import, const char *where, const char *reference,
                                                    enum pell_image_role role, struct pell_texture **texture);
/* The same from bytes (data URIs, GLB buffer views); `name` is for messages. */
PELL_NODISCARD enum pell_result pell_import_texture_bytes(struct pell_import *import, const char *where, const char *name, const void *data,
                                                          size_t size, enum pell_image_role role, struct pell_texture **texture);

/* The texture itself if its sampler is the requested one or not set yet, else one that shares its pixels. */
PELL_NODISCARD enum pell_result pell_texture_sampler(struct pell_scene *scene, struct pell_texture *texture, enum pell_wrap wrap_u,
                                                     enum pell_wrap wrap_v, bool nearest, struct pell_texture **out);

/* A map without a texture: identity matrix, UV set 0, channel 0. */
struct pell_texture_map pell_texture_map_none(void);

/* Four bytes of a file, the lowest first, as a number. */
static inline uint32_t pell_load_little_endian(const uint8_t *b)
{
    return (uint32_t) b[0] | (uint32_t) b[1] << 8 | (uint32_t) b[2] << 16 | (uint32_t) b[3] << 24;
}

/* The matrix with its 3x3 part scaled to a largest element of 1, so that cofactors and lengths stay in the range of floats. */
static inline struct pell_mat4 pell_mat4_scaled_to_one(const struct pell_mat4 *matrix)
{
    struct pell_mat4 unit = *matrix;
    double largest = 0.0;

    for (int i = 0; i < 12; i++)
        largest = fmax(largest, i % 4 < 3 ? fabs(matrix->m[i]) : 0.0);
    for (int i = 0; i < 12; i++)
        unit.m[i] = largest > 0.0 ? matrix->m[i] / largest : 0.0;
    return unit;
}

/* Applies a matrix to meshes, lights and cameras (positions, normals, tangents; winding is flipped if it mirrors), divides the media's
 * coefficients by `unit_scale`, and scales the lengths of lights accordingly. */
PELL_NODISCARD enum pell_result pell_scene_transform(struct pell_scene *scene, const struct pell_mat4 *matrix, double unit_scale);

#endif
