/* SPDX-License-Identifier: MIT
 * scene.h - internal interface between the files of src/scene. */
#ifndef PELL_SCENE_PRIVATE_H
#define PELL_SCENE_PRIVATE_H

#include "scene/import.h"

/* --- scene.c, light_shells.c, textures.c -------------------------------------------------------------------------------------- */

void pell_mesh_finish(struct pell_context *ctx, struct pell_mesh *mesh);
PELL_NODISCARD enum pell_result pell_scene_add_option(struct pell_scene *scene, const char *name, const char *value, const char *where);
/* A medium's profile model by default: closest to path-trace over materials, shapes and lights (docs/adr/0018). */
#define PELL_MATERIAL_MODEL PELL_PROFILE_MONTE_CARLO

/* Logs that no built-in material is called `name`, with the nearest one as hint. */
enum pell_result pell_material_unknown(struct pell_context *ctx, const char *where, const char *name);
PELL_NODISCARD enum pell_result pell_material_set(struct pell_context *ctx, struct pell_material *material,
                                                  const struct pell_material_entry *entry);
/* Whether a closed surface encloses nothing: its sides coincide. */
bool pell_object_is_hollow(const struct pell_object_report *o);
/* A UV set that one of the material's maps needs and the mesh lacks, or -1. */
int pell_scene_missing_uv(const struct pell_mesh *mesh, const struct pell_material *m);
/* Of one triangle; see pell_mesh_solid_angle. */
double pell_triangle_solid_angle(const struct pell_mesh *m, uint32_t triangle, const float p[3]);
/* Signed solid angle of a mesh from a point: 4 pi inside a closed mesh whose triangles face outward, 0 outside (Van Oosterom and Strackee
 * 1983). Any value if the work was cancelled. */
double pell_mesh_solid_angle(const struct pell_context *ctx, const struct pell_mesh *m, const float p[3]);
/* Sets `light_shell` of all meshes. */
void pell_scene_find_light_shells(struct pell_scene *scene);
/* Makes `up` a unit vector perpendicular to the unit vector `forward`. */
void pell_scene_orthogonalize(const float *forward, float *up);
/* The texture may be NULL. */
void pell_texture_destroy(struct pell_context *ctx, struct pell_texture *texture);
/* Removes the textures that could not be read, and the cache. Nothing may be imported afterwards. */
void pell_scene_drop_textures(struct pell_scene *scene);
/* Gives the mesh `more` vertices, which are copies of those in `from`; all its arrays grow. */
PELL_NODISCARD enum pell_result pell_mesh_duplicate(struct pell_scene *scene, size_t mesh, const uint32_t *from, uint32_t more);

/* --- file/material_file.c ----------------------------------------------------------------------------------------------------- */

/* Reads a material file (data/materials/schema.json; only the optics are required). entry->name is owned by the caller, and the other texts
 * lie behind it in the same block: pell_free of the name frees all. */
PELL_NODISCARD enum pell_result pell_material_read(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                                   struct pell_material_entry *entry);
/* A built-in name, or the path of a material file ("x.json" or with a '/'): as pell_material_read. An unknown name is
 * PELL_ERR_INVALID. */
PELL_NODISCARD enum pell_result pell_material_open(struct pell_context *ctx, const char *where, const char *name_or_path,
                                                   struct pell_material_entry *entry);
struct pell_json;
/* sigma_a with sigma_s_reduced, or with sigma_s and g; eta. A missing eta keeps the value of `medium`; other missing keys are errors. */
PELL_NODISCARD enum pell_result pell_read_medium(const struct pell_json *at, struct pell_medium *medium);
/* "skin": its composition (pellucid/skin.h) as layers, and their reflectance; its texts are constant. */
PELL_NODISCARD enum pell_result pell_material_read_skin(const struct pell_json *at, struct pell_material_entry *entry);
bool pell_material_is_path(const char *name_or_path);

/* Parsed load parameters of the viewpoint. */
struct pell_viewpoint {
    bool z_up;
    bool has_from, has_studio; /* --from and --studio were given: azimuth and elevation, and studio, count */
    /* rad: direction from the object to the camera; 0, 0: front; positive azimuth moves the camera to the right */
    double azimuth, elevation;
    int studio; /* index into the table of studio.c, 0: soft */
};

/* Parsed load parameters of the surroundings. */
struct pell_surroundings {
    const char *environment; /* file; NULL: none given */
    float scale, rotate;     /* of the environment; rad */
    bool background;         /* given: */
    enum pell_background kind;
    float color[3];
};

/* A scene file's requests beyond load parameters. */
struct pell_extras {
    struct pell_viewpoint view; /* from the load parameters, as is the next */
    struct pell_surroundings surroundings;
    bool studio;         /* add the default lights although there are others */
    bool backdrop;       /* these lights need the backdrop on the ground */
    bool own_background; /* the file gives a background */
    bool own_lights;     /* the file lists its lights, perhaps none: add no defaults */
    bool ground;
    int ground_material; /* -1: the neutral one */
    float aspect;        /* of the image that the file requests; 0: not given */
};

/* --- load.c, mesh_file.c ------------------------------------------------------------------------------------------------------ */

/* Where the normals of mesh files are from: the option --normals. */
enum pell_normals { PELL_NORMALS_FILE, PELL_NORMALS_SMOOTH, PELL_NORMALS_FLAT };

/* The source of bytes, and the files that may be referenced. `read` NULL: files. */
struct pell_loader {
    struct pell_context *ctx;
    const struct pell_load_params *params;
    const char *root;
    enum pell_result (*read)(void *user, struct pell_context *ctx, const char *path, uint8_t **data, size_t *size);
    void *user;
    enum pell_normals normals;
    bool is_scene_file; /* the bytes are a scene file's, whatever the path's name */
    /* Whether the scene file defines a mesh file's material of this name; NULL: no scene file, or it defines none. */
    bool (*defines)(const void *of, const char *material);
    const void *defines_of;
    const char *granted; /* one image outside the root that a scene file may reference; NULL: none */
};

/* The scale of a file's units. */
struct pell_scale {
    double mm_per_unit, size_mm; /* 0: not given */
    const char *where;           /* where it was given, for messages */
};

enum pell_scene_format { PELL_SCENE_GLTF, PELL_SCENE_OBJ, PELL_SCENE_PLY, PELL_SCENE_STL, PELL_SCENE_SCENE, PELL_SCENE_UNKNOWN };
/* Detects the format of a file: by its content, then by its name. */
enum pell_scene_format pell_scene_detect_format(const char *path, const uint8_t *data, size_t size);
/* Resolves `reference` under the root and reads it (see pell_file_read). *path is owned by the caller. */
PELL_NODISCARD enum pell_result pell_loader_read(const struct pell_loader *loader, const char *where, const char *reference, char **path,
                                                 uint8_t **data, size_t *size);
/* Reads a mesh file into a fresh scene in mm; scene->mm_per_unit is set. */
PELL_NODISCARD enum pell_result pell_load_mesh(const struct pell_loader *loader, const char *path, const uint8_t *data, size_t size,
                                               const struct pell_scale *scale, const struct pell_moment *moment, struct pell_scene **out);
/* Applies the load parameters of time, which override those that `moment` has from a scene file. */
void pell_load_moment(const struct pell_load_params *params, struct pell_moment *moment);
/* Moves all contents of `from` to the end of `to`. Both stay valid in any case. */
PELL_NODISCARD enum pell_result pell_scene_merge(struct pell_scene *to, struct pell_scene *from);
/* Reads a scene from memory, whatever its format: the part of pell_scene_load after reading the bytes. */
PELL_NODISCARD enum pell_result pell_scene_load_bytes(const struct pell_loader *loader, const char *path, const uint8_t *data, size_t size,
                                                      struct pell_scene **out);
/* Makes the camera called `name` the first; PELL_ERR_INVALID (or `code`) and the nearest name if there is none. */
PELL_NODISCARD enum pell_result pell_scene_choose_camera(struct pell_scene *scene, const char *where, const char *name,
                                                         enum pell_result code);

/* --- file/scene_file.c -------------------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result pell_read_scene_file(const struct pell_loader *loader, const char *path, const uint8_t *data, size_t size,
                                                     struct pell_scene **out, struct pell_extras *extras);
/* Reads "camera" and "lights" of a scene file's text into a complete scene, as if it had been loaded from that text. Lights keep their
 * images: the text must list the same number of lights, of the same types. On failure the scene must be reloaded. */
PELL_NODISCARD enum pell_result pell_scene_read_view(struct pell_scene *scene, const char *path, const void *data, size_t size);
/* The keys of each kind of object in a scene file: the parser, its hints and the test of the schema share them. pell_scene_keys covers all
 * but the lights (scene_file.h) and ends with {0}. */
struct pell_scene_keys {
    const char *object; /* name in the schema's $defs; "" is the root */
    const char *const *keys;
    size_t count;
};
extern const struct pell_scene_keys pell_scene_keys[];

/* --- complete.c --------------------------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result pell_scene_finish(struct pell_scene *scene, const struct pell_load_params *params,
                                                  const struct pell_extras *extras);
/* Refuses a scene without surface or smaller than a wavelength. Where the parameters have a time in an animation, it becomes empty instead,
 * with a warning. Bounds are set. */
PELL_NODISCARD enum pell_result pell_scene_check_extent(struct pell_scene *scene, const struct pell_load_params *params);
/* Checks lights and cameras, and makes their directions unit vectors. */
PELL_NODISCARD enum pell_result pell_scene_check_view(struct pell_scene *scene);
/* The same values of lights, which a program may change between frames; nothing is mended. */
PELL_NODISCARD enum pell_result pell_scene_check_lights(const struct pell_scene *scene);
/* Gives marble to meshes for which the file names no material. */
PELL_NODISCARD enum pell_result pell_scene_default_material(struct pell_scene *scene, bool quiet);
/* Bounds of all vertices that triangles use. False if there are none, or they are not finite. */
bool pell_scene_bounds(const struct pell_scene *scene, float *min, float *max);
/* Whether any triangle has an area: otherwise nothing is visible. */
bool pell_scene_has_area(const struct pell_scene *scene);

/* --- normals.c, tangents.c ---------------------------------------------------------------------------------------------------- */

struct pell_topology;

/* Sets for each material of the scene the first one that scatters light in the same way below the surface: parts of one object with equal
 * numbers are one volume, whatever their surfaces look like. Opaque and layered materials are equal to none but themselves. */
void pell_scene_same_media(const struct pell_scene *scene, uint32_t *same);

/* Makes the missing normals of the meshes of one object, which `topology` describes. Meshes without any get creases where faces meet at
 * more than 60 degrees. */
PELL_NODISCARD enum pell_result pell_make_normals(struct pell_scene *scene, const struct pell_topology *topology);
/* Whether an object's normals are to be computed and will smooth most of its edges, which bend by 25 to 60 degrees: it may be a gem. */
bool pell_smooths_facets(const struct pell_scene *scene, const struct pell_topology *topology);
/* Whether the normals of an object are per face, so that recomputed normals would hide its facets. */
bool pell_is_faceted(const struct pell_scene *scene, const struct pell_topology *topology);
/* Tangents along UV set `uv`. */
PELL_NODISCARD enum pell_result pell_make_tangents(struct pell_scene *scene, size_t mesh, int uv);

/* --- studio.c ----------------------------------------------------------------------------------------------------------------- */

/* Reads up, from and studio; PELL_ERR_INVALID with the option's name if one is wrong. */
PELL_NODISCARD enum pell_result pell_viewpoint_read(struct pell_context *ctx, const struct pell_load_params *params,
                                                    struct pell_viewpoint *view);
/* Parses a side, or azimuth and elevation in degrees, as in "--from"; or a studio's name. Fails with `code` for an unknown one. */
PELL_NODISCARD enum pell_result pell_side_read(struct pell_context *ctx, enum pell_result code, const char *where, const char *text,
                                               struct pell_viewpoint *view);
/* "file", "smooth" or "flat". */
PELL_NODISCARD enum pell_result pell_normals_read(struct pell_context *ctx, enum pell_result code, const char *where, const char *text,
                                                  enum pell_normals *normals);
PELL_NODISCARD enum pell_result pell_studio_read(struct pell_context *ctx, enum pell_result code, const char *where, const char *text,
                                                 int *studio);
/* Adds a camera that looks along -z and frames the bounds. */
PELL_NODISCARD enum pell_result pell_scene_frame(struct pell_scene *scene, float aspect);
/* Inserts as first camera one on the viewpoint's side that frames the objects. */
PELL_NODISCARD enum pell_result pell_scene_frame_from(struct pell_scene *scene, const struct pell_viewpoint *view, float aspect);
/* Adds the lights of a studio (0: three soft ones) around the bounds, relative to the first camera. `level`: as for a camera that looks
 * horizontally; a rim light would be on the floor, or below it, where the camera looks down. */
PELL_NODISCARD enum pell_result pell_scene_studio(struct pell_scene *scene, int studio, bool level);
/* Whether the studio has a ground. Lights from behind would cut the floor in a visible line, where it crosses their planes. */
bool pell_studio_has_backdrop(int studio);
/* Adds a floor with a curved backdrop behind the bounds, relative to the first camera, or a round table if an environment lights the scene;
 * `material` -1 makes a neutral one. */
PELL_NODISCARD enum pell_result pell_scene_ground(struct pell_scene *scene, int material);
/* Names for --from, --studio, --up and --normals, in the order of their tables; NULL after the last. */
const char *pell_side_name(size_t i);
const char *pell_studio_name(size_t i);
const char *pell_axis_name(size_t i);
const char *pell_normals_name(size_t i);

/* --- surroundings.c ----------------------------------------------------------------------------------------------------------- */

/* Reads environment and background; PELL_ERR_INVALID with the option's name if one is wrong. No file is opened. */
PELL_NODISCARD enum pell_result pell_surroundings_read(struct pell_context *ctx, const struct pell_load_params *params,
                                                       struct pell_surroundings *surroundings);
/* The same for --background. */
const char *pell_background_name(size_t i);
/* Parses a background's name or colour; fails with `code` and the valid names. */
PELL_NODISCARD enum pell_result pell_background_read(struct pell_context *ctx, enum pell_result code, const char *where, const char *text,
                                                     enum pell_background *kind, float *color);
/* Whether a light is an environment. */
bool pell_scene_has_environment(const struct pell_scene *scene);
/* Replaces the file's environment and background. */
PELL_NODISCARD enum pell_result pell_scene_surround(struct pell_scene *scene, const struct pell_surroundings *surroundings);
/* Removes all lights, and with them an environment visible behind the objects. */
void pell_scene_drop_lights(struct pell_scene *scene);

#endif
