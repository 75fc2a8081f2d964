/* SPDX-License-Identifier: MIT
 *
 * gltf.h - what the files of the glTF 2.0 reader share.
 *
 *     gltf/read.c      containers (.gltf, .glb), the version, the order of objects
 *     gltf.c           warnings, extensions, indices
 *     gltf/transform.c node transforms
 *     gltf/vertices.c  arrays of vertices
 *     gltf/buffer.c    data URIs, buffers, buffer views, accessors
 *     gltf/meshopt.c   compressed buffer views
 *     gltf/mesh.c      primitives -> meshes of the scene
 *     gltf/morph.c     morph targets
 *     gltf/skin.c      skins
 *     gltf/animation.c poses of the nodes at a time of an animation
 *     gltf/node.c      the hierarchy, instances, cameras, lights
 *     gltf/material.c  materials and media
 *     gltf/texture.c   images, samplers, texture transforms
 *
 * Everything is read when it is first used, so unused parts of a file cost nothing and can't fail. Each accessor, mesh and material is
 * looked up in the JSON once, however often it is drawn. No JSON is touched per vertex.
 */
#ifndef PELL_GLTF_H
#define PELL_GLTF_H

#include "scene/file/json.h"
#include "scene/import.h"

/* Kinds of warnings: each is printed `limits.warnings` times, then counted. */
enum gltf_warning {
    GLTF_WARN_EXTENSION,
    GLTF_WARN_FEATURE,
    GLTF_WARN_NODE,
    GLTF_WARN_PRIMITIVE,
    GLTF_WARN_VALUE,
    GLTF_WARN_MATERIAL,
    GLTF_WARN_INTERIOR, /* problem of the medium: suppressed if the caller's material replaces it */
    GLTF_WARN_TEXTURE,
    GLTF_WARNINGS
};

/* Messages that are logged once per file. */
enum gltf_once {
    GLTF_ONCE_JOINT_SETS,
    GLTF_ONCE_WEIGHTS,
    GLTF_ONCE_MORPH_OTHERS,
    GLTF_ONCE_MORPH_NORMALS,
    GLTF_ONCE_SKIN_INSTANCES,
    GLTF_ONCE_DRACO,
    GLTF_ONCE_NO_NORMALS,
    GLTF_ONCE_NO_AREA,
    GLTF_ONCE_WEIGHTLESS,
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
    int components; /* 1..4, or 16: MAT4, column by column */
    uint32_t count;
    uint32_t stride;     /* bytes from element to element */
    const uint8_t *data; /* NULL: all zeros */
    uint32_t sparse_count;
    enum gltf_type sparse_type;
    const uint8_t *sparse_index, *sparse_value;
};

#define GLTF_JOINT_SETS 2 /* of four joints each */

/* A morph target, as indices of accessors; -1: none. */
struct gltf_target {
    int64_t position, normal, tangent;
};

/* One primitive's indices of accessors and materials; -1: none. */
struct gltf_primitive {
    int mode;
    int64_t position, normal, tangent, color, uv[PELL_UV_SETS], indices, material;
    int64_t joints[GLTF_JOINT_SETS], weights[GLTF_JOINT_SETS];
    struct gltf_target *targets; /* as many as the mesh declares */
    bool drawn;
};

struct gltf_mesh {
    struct gltf_primitive *primitives;
    size_t num_primitives, num_targets;
    bool ready;
};

/* A node's position in the hierarchy and in the world. */
struct gltf_node {
    struct pell_mat4 world; /* valid if `placed` */
    int32_t parent;         /* -1: none */
    int32_t child;          /* during a walk upwards: the node it came from */
    bool placed;
};

enum { GLTF_TRANSLATION, GLTF_ROTATION, GLTF_SCALE, GLTF_WEIGHTS, GLTF_PATHS };

/* A node's animated values; unset ones are the node's own. */
struct gltf_pose {
    bool moved[GLTF_PATHS];
    double value[GLTF_WEIGHTS][4]; /* translation, unit quaternion, scale */
    int32_t weights;               /* index of the channel of GLTF_WEIGHTS */
};

/* An accessor of an animation as floats. */
struct gltf_track {
    float *value;
    bool ordered; /* checked as times: increasing, none negative */
};

/* Matrices from a mesh's bind pose to the world. */
struct gltf_skin {
    struct pell_mat4 *matrix; /* joint's world matrix x inverse bind matrix */
    uint32_t num_joints;
    int32_t first_joint;  /* its node */
    bool ready, singular; /* singular: all matrices are */
};

/* The transform of a drawn mesh. */
struct gltf_placement {
    const struct pell_json *node;  /* NULL: a file without nodes */
    const struct pell_mat4 *world; /* unused with a skin */
    const struct gltf_skin *skin;  /* NULL: rigid */
};

struct gltf {
    struct pell_import *import;
    struct pell_context *ctx;
    struct pell_scene *scene;
    const struct pell_limits *limits;

    struct pell_json_file file;
    struct pell_json root, buffers, views, accessors, images, samplers, textures, materials, meshes, nodes, scenes, cameras;
    struct pell_json skins, animations, animation, animation_samplers, animation_channels; /* the latter three of the chosen one */
    struct pell_json extensions, lights_extension, lights;

    struct gltf_bytes bin; /* of a GLB; data NULL: none */
    struct gltf_buffer *buffer;
    struct gltf_buffer *view; /* decompressed ones */
    struct gltf_accessor *accessor;
    struct gltf_mesh *mesh;
    struct gltf_node *node;
    struct gltf_skin *skin;
    struct gltf_track *track; /* per accessor, where an animation plays */
    struct gltf_pose *pose;   /* per node; NULL: the file's rest pose */
    double time;
    int64_t deformed;  /* vertices moved by morph targets and skins, counted each time */
    int64_t *material; /* index into the scene's, -1: not read yet */

    int next_object;
    int64_t visits; /* nodes drawn so far, counting each instance */
    int warned[GLTF_WARNINGS];
    bool said[GLTF_ONCES];
    uint64_t extensions_said; /* bits by row of the table in gltf.c */
};

/* --- gltf.c ----------------------------------------------------------------------------------------------------------------- */

/* The command that converts a file to avoid an unsupported extension; NULL: none. */
const char *gltf_fix(const char *extension);

void gltf_warn(struct gltf *g, enum gltf_warning kind, const struct pell_json *at, const char *hint, const char *fmt, ...)
    PELL_PRINTF(5, 6);
/* True the first time. */
bool gltf_once(struct gltf *g, enum gltf_once what);
/* Warns once per file of an extension that is used at `at` and not, or not fully, supported. */
void gltf_mention(struct gltf *g, const struct pell_json *at, const char *extension);
/* object.extensions.NAME, with NULL value if it is not there. *extensions must outlive *out. */
PELL_NODISCARD enum pell_result gltf_extension(const struct pell_json *object, const char *name, struct pell_json *extensions,
                                               struct pell_json *out);
/* An index into an array of the file; a missing key leaves *index as it is. */
PELL_NODISCARD enum pell_result gltf_index(const struct pell_json *parent, const char *key, const struct pell_json *array, int64_t *index);
/* The name of an element, or `kind` and its number; returns `buffer`. */
const char *gltf_name(const struct pell_json *element, const char *kind, char *buffer, size_t size);
/* Refuses a file that requires an unsupported extension, and warns of those that affect the look. */
PELL_NODISCARD enum pell_result gltf_check_required(struct gltf *g);
/* Reports how many warnings of each kind were not printed. */
void gltf_count_warnings(struct gltf *g);

/* --- gltf/meshopt.c --- */

/* A buffer view's EXT_meshopt_compression at `at`, checked. */
struct gltf_packed {
    int64_t buffer, offset, length, stride, count; /* bytes; of elements */
    int mode, filter;                              /* indices into lists of meshopt.c; mode 0: vertices */
};
PELL_NODISCARD enum pell_result gltf_meshopt_read(struct gltf *g, const struct pell_json *at, struct gltf_packed *p);
/* Decompresses it into `view`, which owns the bytes also on failure. */
PELL_NODISCARD enum pell_result gltf_meshopt_decode(struct gltf *g, const struct pell_json *at, const struct gltf_packed *p,
                                                    struct gltf_bytes buffer, struct gltf_buffer *view);

/* --- gltf/buffer.c ---------------------------------------------------------------------------------------------------------- */

/* Decodes a data URI. *bytes is owned by the caller. *problem: what is wrong with the URI, and *bytes is NULL; else NULL. */
PELL_NODISCARD enum pell_result gltf_data_uri(struct pell_context *ctx, const char *uri, uint8_t **bytes, size_t *size,
                                              const char **problem);
bool gltf_is_data_uri(const char *uri);
/* Percent-decodes into a new string. *problem: why the URI can't be a file next to this one, else NULL. */
PELL_NODISCARD enum pell_result gltf_file_uri(struct pell_context *ctx, const char *uri, char **reference, const char **problem);

/* The bytes of the buffer view that parent.key names; the key must be there. */
PELL_NODISCARD enum pell_result gltf_view(struct gltf *g, const struct pell_json *parent, const char *key, struct gltf_bytes *out,
                                          uint32_t *stride);
/* Reads and checks an accessor when it is first used. */
PELL_NODISCARD enum pell_result gltf_accessor(struct gltf *g, int64_t index, const struct gltf_accessor **out);
/* Writes count x components floats: integers as normalised if `normalize` or if the accessor says so. */
void gltf_read_floats(const struct gltf_accessor *a, bool normalize, float *out);
/* The accessor that parent.key names as `index`, with `min` to `max` components and `count` elements, none of them 32-bit integers. */
PELL_NODISCARD enum pell_result gltf_attribute(struct gltf *g, const struct pell_json *parent, const char *key, int64_t index, int min,
                                               int max, uint32_t count, const struct gltf_accessor **out);
/* Scalars of an unsigned type. */
void gltf_read_indices(const struct gltf_accessor *a, uint32_t *out);

/* --- gltf/mesh.c ------------------------------------------------------------------------------------------------------------ */

/* Adds a mesh's primitives to the scene; all with one object number. */
PELL_NODISCARD enum pell_result gltf_place_mesh(struct gltf *g, int64_t mesh, const char *name, const struct gltf_placement *placement);

/* --- gltf/morph.c ----------------------------------------------------------------------------------------------------------- */

/* Reads primitive.targets; all primitives of a mesh must have the same number; *count -1: not known yet. */
PELL_NODISCARD enum pell_result gltf_parse_targets(struct gltf *g, const struct pell_json *primitive, struct gltf_primitive *p,
                                                   int64_t *count);
/* The weights of `count` targets: the animation's, else the node's, else the mesh's. *weights is owned by the caller, NULL if all are 0. */
PELL_NODISCARD enum pell_result gltf_morph_weights(struct gltf *g, const struct pell_json *mesh, const struct pell_json *node, size_t count,
                                                   double **weights);
/* Adds the targets to a mesh as stored in the file. Normals and tangents that the targets do not update are zeroed. */
PELL_NODISCARD enum pell_result gltf_morph(struct gltf *g, const struct pell_json *primitive, const struct gltf_primitive *p,
                                           const double *weights, size_t count, struct pell_mesh *mesh);

/* --- gltf/skin.c ------------------------------------------------------------------------------------------------------------ */

PELL_NODISCARD enum pell_result gltf_skin(struct gltf *g, int64_t index, const struct gltf_skin **out);
/* Transforms a mesh as stored in the file, morphed or not, to world space. */
PELL_NODISCARD enum pell_result gltf_skin_mesh(struct gltf *g, const struct pell_json *primitive, const struct gltf_primitive *p,
                                               const struct gltf_skin *skin, struct pell_mesh *mesh);

/* --- gltf/animation.c ------------------------------------------------------------------------------------------------------- */

/* Fills g->pose with the poses of the nodes at the time that the importer was given. */
PELL_NODISCARD enum pell_result gltf_animate(struct gltf *g);
/* The morph target weights of channel `channel`. */
PELL_NODISCARD enum pell_result gltf_animated_weights(struct gltf *g, int32_t channel, size_t count, double *weights);

/* --- gltf/node.c ------------------------------------------------------------------------------------------------------------ */

PELL_NODISCARD enum pell_result gltf_read_scene(struct gltf *g);

/* --- gltf/transform.c ------------------------------------------------------------------------------------------------------- */

/* Translation, unit quaternion (x, y, z, w), scale: T R S. */
struct pell_mat4 gltf_compose(const double t[3], const double q[4], const double s[3]);
/* The matrix from a node's space to the world's, for any node; computed once. */
PELL_NODISCARD enum pell_result gltf_node_world(struct gltf *g, int64_t node, const struct pell_mat4 **out);
/* False if the matrix collapses everything into a line or a point: scale 0 is a common way to hide objects. */
bool gltf_has_area(const struct pell_mat4 *world);
/* False for a quaternion of zero length. */
bool gltf_normalize_quaternion(double q[4], double *length);

/* --- gltf/vertices.c -------------------------------------------------------------------------------------------------------- */

/* The index of the first float that is infinite or NaN, or `count`. */
size_t gltf_first_not_finite(const float *x, size_t count);
/* Transforms and normalises vectors of `size` floats; those without a direction (zero, not finite, collapsed by a singular transform)
 * become zero. Returns how many. `matrix` NULL: no transform. */
size_t gltf_transform_vectors(const struct pell_mat4 *matrix, bool normals, float *p, size_t count, size_t size);
/* Accounts for work that the size of the scene doesn't bound, before it is done. */
PELL_NODISCARD enum pell_result gltf_count_deformed(struct gltf *g, const struct pell_json *at, uint64_t vertices);

/* --- gltf/material.c -------------------------------------------------------------------------------------------------------- */

/* The scene's material for material `index` of the file. */
PELL_NODISCARD enum pell_result gltf_material(struct gltf *g, int64_t index, int *out);
/* A number that is clamped into its range with a warning. */
PELL_NODISCARD enum pell_result gltf_factor(struct gltf *g, const struct pell_json *parent, const char *key, double min, double max,
                                            float *out);
PELL_NODISCARD enum pell_result gltf_factors(struct gltf *g, const struct pell_json *parent, const char *key, size_t count, double min,
                                             double max, float *out);

/* --- gltf/texture.c --------------------------------------------------------------------------------------------------------- */

/* The textureInfo parent.key. Leaves *map unchanged if the key is absent or the image can't be used (a warning names it). */
PELL_NODISCARD enum pell_result gltf_texture_map(struct gltf *g, const struct pell_json *parent, const char *key, enum pell_image_role role,
                                                 int channel, struct pell_texture_map *map);

#endif
