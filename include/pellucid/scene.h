/* SPDX-License-Identifier: MIT
 *
 * pellucid/scene.h - a scene: meshes, materials, lights, cameras. Plain data in millimetres after import.
 *
 * Axes       right-handed, y up; a camera looks along its forward vector. UV (0, 0) is the upper left of an image, v runs down.
 * Units      mm, linear Rec.709; intensity W/sr, irradiance W/m^2, radiance W/(m^2 sr). Point-light fall-off counts in metres.
 * Ownership  a scene owns everything that it points to. Build one with pell_scene_create and the pell_scene_add_* functions, or read one
 *            with pell_scene_load. While a renderer uses it, only the values of its cameras may change,
 *            and those of its lights (pell_renderer_lights_changed), between frames.
 * Errors     logged with file, location, value and the allowed range; the owner destroys the scene also after a failure.
 * Threads    one thread builds a scene; many may read it.
 */
#ifndef PELLUCID_SCENE_H
#define PELLUCID_SCENE_H

#include <pellucid/image.h>
#include <pellucid/material.h>
#include <pellucid/phase.h>
#include <pellucid/specular.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PELL_UV_SETS 4
#define PELL_PICTURE_MOST 16384 /* px: largest width and height of an image */

struct pell_context;

/* One run of triangles with one material, in world space. Arrays belong to the scene. */
struct pell_mesh {
    char *name;
    int object;   /* id shared by the meshes of one file node, >= 0 */
    int file;     /* set by loading: number of its mesh file, from 1; 0: none */
    int joined;   /* set by pell_scene_complete: objects of one file that touch and have the same medium are one assembly. The id of one
                 * of them + 1; 0: it is an assembly of its own */
    int material; /* index into the scene's materials; -1: pell_scene_complete sets marble */
    uint32_t num_vertices, num_triangles;
    float *position;         /* xyz, mm */
    float *normal;           /* xyz, unit; all 0: pell_scene_complete computes them */
    float *tangent;          /* xyz, and w = +-1: bitangent = w cross(normal, tangent); NULL if no map needs it */
    float *uv[PELL_UV_SETS]; /* uv, NULL if the set does not exist */
    float *color;            /* rgba, linear, multiplies the base colour; may be NULL */
    uint32_t *index;         /* 3 per triangle, counter-clockwise seen from outside */
    bool light_shell;        /* set by pell_scene_complete: an opaque emissive mesh around a point or spot light. It casts no shadow
                              * and is visible to cameras only */
    bool flat;               /* computed normals are those of the triangles; false: smooth, with creases at more than 60 degrees */
    float thicken;           /* mm, >= 0: pell_scene_complete gives an open surface this thickness, inward, and a rim; 0: none */
    bool overlaps;           /* set by pell_scene_complete: closed parts of its assembly may touch or overlap, so some of its surface may be
                              * inside the assembly */
};

/* The assembly that a mesh belongs to, an object's id. Light crosses inside an assembly; closedness and thickness are those of the
 * assembly. */
static inline int pell_mesh_assembly(const struct pell_mesh *mesh)
{
    return mesh->joined > 0 ? mesh->joined - 1 : mesh->object;
}

struct pell_texture {
    char *name; /* its file or location, for messages */
    struct pell_image image;
    enum pell_wrap wrap_u, wrap_v;
    bool nearest;
    bool shared;  /* private: the pixels belong to another texture of the scene */
    bool sampled; /* private: the sampler is in use */
    uint64_t key; /* private: key in the importers' cache, 0: none */
};

/* Look-up of a texture by a surface: uv' = matrix (u, v, 1). */
struct pell_texture_map {
    const struct pell_texture *texture; /* NULL: none */
    int uv;                             /* UV set, [0, PELL_UV_SETS) */
    int channel;                        /* for scalar maps: 0..3 = r, g, b, a */
    float matrix[6];                    /* u' = m0 u + m1 v + m2, v' = m3 u + m4 v + m5 */
};

enum pell_color_from { PELL_COLOR_FROM_PROFILE, PELL_COLOR_FROM_TEXTURE };

/* A layer of the medium below a surface, with a constant or texture-mapped depth: from the bottom of the layer above it (the first: from
 * the surface) down to its own depth. Francois et al. (2006), section 3. */
struct pell_scene_layer {
    char *name;
    struct pell_medium medium;         /* its eta is ignored: light refracts only at the surface. g: the phase's mean cosine */
    struct pell_phase phase[3];        /* of R, G and B */
    float depth;                       /* mm from the surface to its bottom, >= 0; with a map: for a map value of 1. INFINITY: no bottom */
    struct pell_texture_map depth_map; /* its `channel` times `depth`: integers are in [0, 1], floats at least 0 */
    bool depth_inverse;                /* use 1 - map, floats in [0, 1]: white is thin */
};

/* The substrate: the medium or surface below the deepest layer. */
enum pell_substrate {
    PELL_SUBSTRATE_STOP,          /* black */
    PELL_SUBSTRATE_LAST,          /* the last layer continues */
    PELL_SUBSTRATE_SURFACE_COLOR, /* a Lambertian surface of the base colour */
};

#define PELL_LAYERS_MOST 64

struct pell_material {
    char *name;
    char *preset; /* name of its built-in entry; may be NULL */
    bool opaque;  /* no light passes below the surface: Lambertian */

    /* Below the surface. The profile is `profile` if that is not NULL (a user's table, a stack of layers), else `gaussians` if their
     * count is not 0 (published sets), else `model` of `medium`. */
    struct pell_medium medium;
    struct pell_gaussians gaussians;
    struct pell_profile *profile; /* three, for R, G and B; owned by the scene */
    enum pell_profile_model model;
    struct pell_scene_layer *layers; /* top to bottom; owned by the scene; `gaussians` or `profile` is then their profile at mean depths */
    int num_layers;                  /* [0, PELL_LAYERS_MOST]; 0: one semi-infinite medium */
    enum pell_substrate substrate;
    enum pell_color_from color_from;
    float mix;                            /* m: albedo^m for light that enters, albedo^(1-m) for light that leaves, [0, 1] */
    float strength;                       /* scales the scattering radius, [0, 1] */
    struct pell_texture_map strength_map; /* its `channel` multiplies `strength` */

    /* The surface. */
    float base_color[4]; /* linear; alpha is compared with alpha_cutoff where alpha_mask */
    struct pell_texture_map base_color_map;
    float metallic, roughness;             /* [0, 1]; roughness is perceptual: alpha = roughness^2 */
    struct pell_texture_map metallic_map;  /* `channel` */
    struct pell_texture_map roughness_map; /* `channel` */
    enum pell_specular_model specular;
    float rho_s;                       /* scales the specular lobe, [0, 1] */
    float specular_color[3];           /* tint of the specular lobe */
    struct pell_texture_map rho_s_map; /* `channel` */
    struct pell_texture_map specular_color_map;
    struct pell_texture_map normal_map;
    float normal_scale;
    float emissive[3]; /* radiance, W/(m^2 sr) */
    struct pell_texture_map emissive_map;
    /* A thin sheet (paper, a leaf), only if `opaque`: this fraction of the diffuse light incident on one side is transmitted to the other,
     * with a separate colour; the rest is reflected. Lambertian on both sides (KHR_materials_diffuse_transmission). */
    float diffuse_transmission; /* [0, 1] */
    float diffuse_transmission_color[3];
    struct pell_texture_map diffuse_transmission_map; /* its `channel` multiplies `diffuse_transmission` */
    struct pell_texture_map diffuse_transmission_color_map;
    bool alpha_mask;
    float alpha_cutoff;
    bool double_sided; /* false: back faces of opaque surfaces are invisible to cameras; translucent surfaces are always double-sided */
};

enum pell_light_type {
    PELL_LIGHT_POINT,       /* power: intensity */
    PELL_LIGHT_SPOT,        /* power: intensity on the axis */
    PELL_LIGHT_DIRECTIONAL, /* power: irradiance on a facing plane */
    PELL_LIGHT_RECT,        /* power: radiance of its front */
    PELL_LIGHT_DISC,        /* power: radiance of its front */
    PELL_LIGHT_ENVIRONMENT, /* power: factor of the image's radiance; without an image the radiance */
};

struct pell_light {
    enum pell_light_type type;
    char *name;
    float position[3];           /* mm; unused for directional and environment */
    float direction[3];          /* unit; the direction in which light travels */
    float up[3];                 /* unit, perpendicular to direction: the v axis of a rect and of images points against it */
    float power[3];              /* see enum pell_light_type */
    float cos_inner, cos_outer;  /* spot: full power inside, none outside, smooth between */
    float width, height, radius; /* mm; rect, disc */
    float range;                 /* mm, 0: none (KHR_lights_punctual's cut-off) */
    struct pell_texture *image;  /* environment: latitude-longitude, +y up, its centre at -z; others: projected. May be NULL */
    float image_fov;             /* of a projected image, vertical, radians; spot: 0 is the cone */
    float rotate;                /* environment: radians about y */
};

struct pell_camera {
    char *name;
    float position[3];
    float forward[3], up[3]; /* unit, perpendicular */
    float fov;               /* vertical, radians; unused where ortho_height > 0 */
    float ortho_height;      /* mm; 0: perspective */
    /* A thin lens for depth of field. Its focal length is that of `fov` on a frame 24 mm high, 12 mm / tan(fov / 2); its diameter is the
     * focal length divided by the f-number. Not for orthographic cameras. */
    float focus;    /* focus distance along `forward`, mm; 0: to the centre of the bounds */
    float f_number; /* 0: 2.8 */
};

enum pell_background { PELL_BACKGROUND_COLOR, PELL_BACKGROUND_ENVIRONMENT, PELL_BACKGROUND_IMAGE, PELL_BACKGROUND_TRANSPARENT };

/* A "render" entry of a scene file: the command line's option of that name ("width", "method"), or a knob ("knobs/lod"). */
struct pell_scene_option {
    char *name, *value, *where;
};

struct pell_scene {
    struct pell_context *ctx; /* borrowed */
    char *path;               /* of the file it was read from, "" if none */

    struct pell_mesh *meshes;
    size_t num_meshes;
    struct pell_material *materials; /* at least one after pell_scene_complete */
    size_t num_materials;
    struct pell_texture **textures;
    size_t num_textures;
    struct pell_light *lights;
    size_t num_lights;
    struct pell_camera *cameras; /* the first is used */
    size_t num_cameras;

    enum pell_background background;
    float background_color[3]; /* as displayed: 1 is display white */
    bool contact_shadow;       /* the objects cast a soft shadow onto a background of uniform colour below them, as if they stood on it */
    struct pell_texture *background_image;

    float bounds_min[3], bounds_max[3]; /* of all meshes but the generated ground, mm */
    int ground_mesh;                    /* index of the generated ground, or -1 */
    double mm_per_unit;                 /* unit of the first mesh file */
    struct pell_scene_option *options;
    size_t num_options;

    /* private */
    bool animated;                           /* a file has animations, or an image belongs to a sequence */
    char *vanished;                          /* the first node whose scale is 0, so that meshes were left out; NULL: none */
    bool from_file;                          /* invalid values come from a file, not from the caller */
    size_t capacity[6];                      /* of the arrays above */
    int64_t total_vertices, total_triangles; /* allocated so far, against the limits */
    uint32_t *texture_slots;                 /* hash of texture keys, holds index + 1 */
    size_t num_texture_slots;
};

/* --- Reading ------------------------------------------------------------------------------------------------------------------ */

struct pell_load_params {
    double mm_per_unit;       /* > 0: length of one unit of the file; 0: that of the format (glTF 1 m), else refused */
    double size_mm;           /* > 0: scale so that the largest extent of the bounds is this; not with mm_per_unit */
    const char *material;     /* built-in name or material file for all objects; NULL: as in the file, default marble */
    const char *camera;       /* name of a camera of the file; NULL: its first, else framed from the bounds */
    double time;              /* seconds into an animation of glTF files; before its start the first pose is used, after its end the last */
    bool timed;               /* `time` is set, even if it is 0, and overrides the scene file's. Without a time rest poses are used */
    const char *animation;    /* its name in the file, or its index from 0; NULL: as in the scene file, else the first */
    float aspect;             /* width / height of the image, for framing; 0: 16/9 */
    bool allow_outside;       /* let files refer to files outside the scene's folder */
    bool bare;                /* add no default lights, no default camera, no ground (used by `check`) */
    const char *up;           /* axis of a mesh file that points upwards, "y" or "z"; NULL: y */
    const char *from;         /* side from which a camera frames the objects: front, back, left, right, top, 34, or "AZIMUTH,ELEVATION"
                            * in degrees; NULL: the file's camera, else front. Not with `camera` */
    const char *studio;       /* soft, rim, back or window: these lights replace the file's; NULL: soft where the file has none */
    const char *environment;  /* equirectangular image that replaces the file's lights and is the background; not with `studio` */
    double environment_scale; /* factor of its radiance; 0: 1 */
    double environment_rotate_deg; /* about the y axis, as in a scene file */
    double thicken_mm;             /* >= 0: open surfaces get this thickness; 0: as the scene file says, else none */
    const char *normals;           /* file: those of the mesh files; smooth: recomputed, with creases where triangles meet at more than
                                    * 60 degrees; flat: those of the triangles; NULL: as in the scene file, else file */
    const char *background;        /* environment, transparent, white, grey, black or "#RRGGBB" (sRGB); NULL: as in the file */
    bool ground;                   /* add an opaque grey ground if the file has none, as "ground": true in a scene file */
};

/* Reads .gltf, .glb, .obj, .ply, .stl or a scene .json (distinguished by content where possible), and completes it: normals, tangents
 * where maps need them, default lights, camera and material. `params` may be NULL: zeros. Without a unit OBJ, PLY and STL are refused
 * (PELL_ERR_INVALID). */
PELL_API PELL_NODISCARD enum pell_result pell_scene_load(struct pell_context *ctx, const char *path, const struct pell_load_params *params,
                                                         struct pell_scene **out);

/* Reads a scene from memory: `path` is the name in messages, and other files are looked up in its folder ("/models/made.json": /models).
 * The bytes are borrowed for the call; `params` may be NULL. */
PELL_API PELL_NODISCARD enum pell_result pell_scene_load_memory(struct pell_context *ctx, const char *path, const void *data, size_t size,
                                                                const struct pell_load_params *params, struct pell_scene **out);

/* Releases the scene and everything that it owns, and sets *scene to NULL; *scene may be NULL already. No renderer may still use it. */
PELL_API void pell_scene_destroy(struct pell_scene **scene);

/* --- Checking ----------------------------------------------------------------------------------------------------------------- */

enum pell_severity { PELL_SEVERITY_NOTE, PELL_SEVERITY_WARNING, PELL_SEVERITY_ERROR };

struct pell_problem {
    enum pell_severity severity;
    char *where, *what;
};

/* Properties of one object's surface. */
struct pell_object_report {
    char *name;
    int material;
    int64_t triangles, boundary_edges, nonmanifold_edges, flipped_edges, degenerate_triangles;
    int components;
    bool closed, outward; /* outward: positive enclosed volume */
    bool joined;          /* part of an assembly of several objects, which is closed */
    double volume_mm3, area_mm2;
    double thickness_mm; /* 2 * volume / area scaled: a mean thickness; 0 if open */
    bool holds_camera;   /* closed, and the first camera is inside it */
    int holds_light;     /* index of the first light that is inside it, where it is closed and translucent; -1: none */
    bool faceted;        /* its normals are per face, though most of its triangles meet at less than 60 degrees */
    int coincident;      /* index of an earlier object with exactly the same surface; -1: none */
};

struct pell_scene_report {
    struct pell_problem *problems;
    size_t num_problems;
    struct pell_object_report *objects;
    size_t num_objects;
    int64_t triangles;
    float bounds_min[3], bounds_max[3];
};

/* Checks closedness, orientation, scale and values. The report is released with pell_scene_report_finish. */
PELL_API PELL_NODISCARD enum pell_result pell_scene_check(const struct pell_scene *scene, struct pell_scene_report *report);
/* Releases what a report owns and sets it to {0}. */
PELL_API void pell_scene_report_finish(struct pell_context *ctx, struct pell_scene_report *report);

/* --- Building in code --------------------------------------------------------------------------------------------------------- */

/* An empty scene; the context must outlive it. PELL_ERR_NOMEM. */
PELL_API PELL_NODISCARD enum pell_result pell_scene_create(struct pell_context *ctx, struct pell_scene **out);

/* Each adds a zeroed element (materials: glTF's defaults, marble's medium, opaque) and sets *index. Pointers to earlier elements of
 * the same array may move, textures never do. Names are copied; NULL is "". */
PELL_API PELL_NODISCARD enum pell_result pell_scene_add_mesh(struct pell_scene *scene, const char *name, size_t *index);
PELL_API PELL_NODISCARD enum pell_result pell_scene_add_material(struct pell_scene *scene, const char *name, size_t *index);
PELL_API PELL_NODISCARD enum pell_result pell_scene_add_texture(struct pell_scene *scene, const char *name, struct pell_texture **texture);
PELL_API PELL_NODISCARD enum pell_result pell_scene_add_light(struct pell_scene *scene, const char *name, size_t *index);
PELL_API PELL_NODISCARD enum pell_result pell_scene_add_camera(struct pell_scene *scene, const char *name, size_t *index);

/* Allocates a mesh's position, normal and index arrays (zeroed); limits vertices and triangles are checked over the whole scene. */
PELL_API PELL_NODISCARD enum pell_result pell_mesh_allocate(struct pell_scene *scene, size_t mesh, uint32_t vertices, uint32_t triangles);

/* Allocates a mesh's UV set `set` (zeroed), after pell_mesh_allocate. PELL_ERR_INVALID: no such mesh or set, or it is there already. */
PELL_API PELL_NODISCARD enum pell_result pell_mesh_allocate_uv(struct pell_scene *scene, size_t mesh, int set);

/* Allocates the pixels of a texture (zeroed) and sets the size and type of its image; a texture has one image. PELL_ERR_INVALID:
 * channels not in [1, 4], a size below 1 or over the limit image-pixels, or pixels are there already. */
PELL_API PELL_NODISCARD enum pell_result pell_texture_allocate(struct pell_scene *scene, struct pell_texture *texture, int width,
                                                               int height, int channels, enum pell_pixel_type type);

/* Sets a material to a built-in entry: medium or Gaussians, colour, roughness, mix. `where` names the origin of the name. */
PELL_API PELL_NODISCARD enum pell_result pell_material_apply(struct pell_scene *scene, size_t material, const char *where,
                                                             const char *entry);

/* Replaces the layers of a material by `count`, [0, PELL_LAYERS_MOST], new ones, zeroed except for the maps' transforms: clear, of depth 0.
 * pell_scene_destroy frees their names: leave them NULL, or copy them by the context's allocator. */
PELL_API PELL_NODISCARD enum pell_result pell_material_allocate_layers(struct pell_scene *scene, size_t material, int count);

/* Sets `gaussians` to the reflectance profile of a material's layers at the mean depths of their maps, under a boundary of medium.eta, and
 * the medium's coefficients to their mean. PELL_ERR_INVALID: no layers, values out of range, or layers without reflectance; in the last
 * case the medium is set nevertheless. */
PELL_API PELL_NODISCARD enum pell_result pell_material_solve_layers(struct pell_scene *scene, size_t material);

/* Computes bounds and missing normals (area- and angle-weighted) and tangents, checks every index and value. Call once after
 * building, before rendering. `params` may be NULL: zeros. */
PELL_API PELL_NODISCARD enum pell_result pell_scene_complete(struct pell_scene *scene, const struct pell_load_params *params);

/* A 64-bit hash of the content, independent of the location of files: of meshes, textures, materials, lights, background and camera; or of
 * materials and their textures only. Not cryptographic. */
PELL_API uint64_t pell_scene_hash(const struct pell_scene *scene);
PELL_API uint64_t pell_scene_hash_materials(const struct pell_scene *scene);

#ifdef __cplusplus
}
#endif
#endif
