/* SPDX-License-Identifier: MIT
 *
 * gltf.h - what the files of the glTF 2.0 reader share.
 *
 *     gltf.c           containers (.gltf, .glb), extensions, the order of things
 *     gltf_buffer.c    data URIs, buffers, buffer views, accessors
 *     gltf_mesh.c      primitives -> meshes of the scene
 *     gltf_node.c      the hierarchy, instances, cameras, lights
 *     gltf_material.c  materials and media
 *     gltf_texture.c   images, samplers, texture transforms
 *
 * Everything is read when it is first used, so what a scene does not use costs nothing and can't fail. Each accessor, mesh and material is
 * looked up in the JSON once, however often it is drawn. No JSON is touched per vertex.
 */
#ifndef PELL_GLTF_H
#define PELL_GLTF_H

#include "scene/import.h"
#include "scene/json.h"

/* Kinds of warnings: each is printed `limits.warnings` times, then counted. */
enum gltf_warning {
    GLTF_WARN_EXTENSION,
    GLTF_WARN_FEATURE,
    GLTF_WARN_NODE,
    GLTF_WARN_PRIMITIVE,
    GLTF_WARN_VALUE,
    GLTF_WARN_MATERIAL,
    GLTF_WARN_TEXTURE,
    GLTF_WARNINGS
};

/* Things that are said once a file. */
enum gltf_once {
    GLTF_ONCE_SKIN,
    GLTF_ONCE_MORPH,
    GLTF_ONCE_DRACO,
    GLTF_ONCE_MESHOPT,
    GLTF_ONCE_NO_NORMALS,
    GLTF_ONCES
};

struct gltf_bytes {
    const uint8_t *data;
    uint64_t size;
};

struct gltf_buffer {
    struct gltf_bytes bytes;
    uint8_t *owned;
    bool ready;
};

/* Component types by glTF's number. */
enum gltf_type { GLTF_I8 = 5120, GLTF_U8 = 5121, GLTF_I16 = 5122, GLTF_U16 = 5123, GLTF_U32 = 5125, GLTF_F32 = 5126 };

/* An accessor whose every byte is known to lie inside its buffer. */
struct gltf_accessor {
    bool ready;
    bool normalized;
    enum gltf_type type;
    int components;      /* 1..4 */
    uint32_t count;
    uint32_t stride;     /* bytes from element to element */
    const uint8_t *data; /* NULL: all zeros */
    uint32_t sparse_count;
    enum gltf_type sparse_type;
    const uint8_t *sparse_index, *sparse_value;
};

/* One primitive's indices of accessors and so on; -1: none. */
struct gltf_primitive {
    int mode;
    int64_t position, normal, tangent, color, uv[PELL_UV_SETS], indices, material;
    bool drawn;
};

struct gltf_mesh {
    struct gltf_primitive *primitives;
    size_t num_primitives;
    bool ready;
};

struct gltf {
    struct pell_import *import;
    struct pell_context *ctx;
    struct pell_scene *scene;
    const struct pell_limits *limits;

    struct pell_json_file file;
    struct pell_json root, buffers, views, accessors, images, samplers, textures, materials, meshes, nodes, scenes, cameras;
    struct pell_json extensions, lights_extension, lights;

    struct gltf_bytes bin; /* of a GLB; data NULL: none */
    struct gltf_buffer *buffer;
    struct gltf_accessor *accessor;
    struct gltf_mesh *mesh;
    int64_t *material; /* index into the scene's, -1: not read yet */

    int next_object;
    int64_t visits; /* nodes drawn so far, instances counted each */
    int warned[GLTF_WARNINGS];
    bool said[GLTF_ONCES];
    uint64_t extensions_said; /* bits by row of the table in gltf.c */
};

/* --- gltf.c ----------------------------------------------------------------------------------------------------------------- */

void gltf_warn(struct gltf *g, enum gltf_warning kind, const struct pell_json *at, const char *hint, const char *fmt, ...)
    PELL_PRINTF(5, 6);
/* True the first time. */
bool gltf_once(struct gltf *g, enum gltf_once what);
/* Warns once a file of an extension that is met at `at` and is not, or not fully, drawn. */
void gltf_mention(struct gltf *g, const struct pell_json *at, const char *extension);
/* object.extensions.NAME, with NULL value if it is not there. *extensions must outlive *out. */
PELL_NODISCARD enum pell_result gltf_extension(const struct pell_json *object, const char *name, struct pell_json *extensions,
                                               struct pell_json *out);
/* An index into an array of the file; a missing key leaves *index as it is. */
PELL_NODISCARD enum pell_result gltf_index(const struct pell_json *parent, const char *key, const struct pell_json *array, int64_t *index);
/* The name of an element, or `kind` and its number; returns `buffer`. */
const char *gltf_name(const struct pell_json *element, const char *kind, char *buffer, size_t size);

/* --- gltf_buffer.c ---------------------------------------------------------------------------------------------------------- */

/* What is wrong with a data URI, or NULL. *bytes is owned by the caller; NULL without memory (and *problem is NULL, too). */
PELL_NODISCARD enum pell_result gltf_data_uri(struct pell_context *ctx, const char *uri, uint8_t **bytes, size_t *size,
                                              const char **problem);
bool gltf_is_data_uri(const char *uri);
/* Percent-decodes into a new string. What is wrong with a URI that can't be a file beside this one is *problem, else NULL. */
PELL_NODISCARD enum pell_result gltf_file_uri(struct pell_context *ctx, const char *uri, char **reference, const char **problem);

/* The bytes of the buffer view that parent.key names; the key must be there. */
PELL_NODISCARD enum pell_result gltf_view(struct gltf *g, const struct pell_json *parent, const char *key, struct gltf_bytes *out,
                                          uint32_t *stride);
/* `at` is where the number stands, for messages that speak of the use, not of the accessor. */
PELL_NODISCARD enum pell_result gltf_accessor(struct gltf *g, int64_t index, const struct gltf_accessor **out);
/* Writes count x components floats: integers as normalised if `normalize` or if the accessor says so. */
void gltf_read_floats(const struct gltf_accessor *a, bool normalize, float *out);
/* Scalars of an unsigned type. */
void gltf_read_indices(const struct gltf_accessor *a, uint32_t *out);

/* --- gltf_mesh.c ------------------------------------------------------------------------------------------------------------ */

/* Adds a mesh's primitives to the scene, placed by `world`; all with one object number. */
PELL_NODISCARD enum pell_result gltf_place_mesh(struct gltf *g, int64_t mesh, const char *name, const struct pell_mat4 *world);

/* --- gltf_node.c ------------------------------------------------------------------------------------------------------------ */

PELL_NODISCARD enum pell_result gltf_read_scene(struct gltf *g);

/* --- gltf_material.c -------------------------------------------------------------------------------------------------------- */

/* The scene's material for material `index` of the file. */
PELL_NODISCARD enum pell_result gltf_material(struct gltf *g, int64_t index, int *out);
/* A number that is clamped into its range with a warning. */
PELL_NODISCARD enum pell_result gltf_factor(struct gltf *g, const struct pell_json *parent, const char *key, double min, double max,
                                            float *out);
PELL_NODISCARD enum pell_result gltf_factors(struct gltf *g, const struct pell_json *parent, const char *key, size_t count, double min,
                                             double max, float *out);

/* --- gltf_texture.c --------------------------------------------------------------------------------------------------------- */

/* The textureInfo parent.key. Leaves *map as it is if the key is not there or the picture can't be used (a warning names it). */
PELL_NODISCARD enum pell_result gltf_texture_map(struct gltf *g, const struct pell_json *parent, const char *key, enum pell_image_role role,
                                                 int channel, struct pell_texture_map *map);

#endif
