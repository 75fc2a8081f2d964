/* SPDX-License-Identifier: MIT
 *
 * engine.h - the interface between the definition of a frame (renderer.c, resources.c, frame.c: order of stages, samples, dependencies) and
 * its computation. An engine owns everything that its stages read and write: scene structures, planes, lights.
 *
 * Errors     a stage that fails ends the frame with its result; the engine has logged why.
 * Threads    one thread at a time per instance, except for pell_services.
 */
#ifndef PELL_ENGINE_H
#define PELL_ENGINE_H

#include "render/angle.h"
#include "render/services.h"
#include "render/single.h"
#include "vulkan/gpu.h"

#define PELL_STAGES_MOST 48

/* Receives the result of one step of a chain of blurs: light with its stride. Steps include the `preblur` ones before the first
 * Gaussian. An error ends the frame. */
typedef enum pell_result pell_take_blur(void *user, const float *const light[3], ptrdiff_t stride, int step, int preblur);

/* A method on one engine. */
struct pell_method_engine {
    /* Creates everything that outlives a frame. `knobs` is in range; `services` and `shape` stay valid as long as the state. On failure
     * *state may be half-built or NULL; `destroy` is called in either case. */
    enum pell_result (*create)(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs, void **state);
    /* Fills `out`: on the CPU engine at once, elsewhere by recording commands. Allocates nothing. Requested planes exist. */
    enum pell_result (*record)(void *state, const struct pell_frame *in, const struct pell_frame_light *out);
    void (*destroy)(void *state); /* takes NULL and a half-built state */
    /* Replaces `record` for methods whose weights vary over the surface: returns the light that each of a material's Gaussians blurs,
     * times the sum of their weights, one after the other. Planes of `out` are overwritten. NULL: the method is not a chain of blurs. */
    enum pell_result (*blurs)(void *state, const struct pell_frame *in, const struct pell_frame_light *out, pell_take_blur *take,
                              void *user);
    /* Thickness tables of transmission, per material; NULL where the method has none. */
    const struct pell_thickness_table *(*thickness)(const void *state, size_t material);
    /* Times of the last render's passes; returns how many (at most `size`). May be NULL. */
    size_t (*times)(const void *state, struct pell_pass_time *times, size_t size);
    /* Standard error of each pixel of the last render, in the unit of the result; planes as in the frame, owned by the state. NULL if
     * the method has no noise, or does not know it. */
    bool (*standard_error)(const void *state, const float *planes[3]);
    /* Records the work of `record` into a command list, on buffers of the device: the services' `planes`, or those of `planes` below,
     * for whole images; allocates nothing. No pixel's widths exceed those of a pixel `depth` mm away with this scattering strength.
     * NULL: the method does not run there. */
    void (*record_in)(void *state, struct pell_gpu_commands *commands, float depth, float strength);
    /* For a state created without planes: the buffers of its own that record_in reads and writes, in the layout of pellucid/vulkan.h;
     * optional ones may be NULL if it does not read them. Returns false if it reads something else, or there are none. NULL: always
     * false. */
    bool (*planes)(const void *state, struct pell_gpu_buffer *planes[PELL_GPU_PLANES]);
    /* With `planes`, before each record_in, while no list is recorded: prepares the host's data of a sample. `in` has no planes. NULL:
     * nothing to prepare. */
    enum pell_result (*prepare)(void *state, const struct pell_frame *in);
    /* See pell_pass_unfinished and pell_pass_unwritten; NULL: always false. */
    bool (*unfinished)(const void *state);
    bool (*unwritten)(const void *state);
};

/* Timings of a frame's stages: a row per stage, created by its first sample. */
struct pell_stage_notes {
    struct pell_stage_time rows[PELL_STAGES_MOST];
    size_t count;
};

/* Adds a stage's time to its row. Dropped if there is no room for another row. */
void pell_stage_note(struct pell_stage_notes *notes, const char *name, double seconds, int64_t pixels, int64_t rays, int64_t bytes);

/* The scene's materials in the form of a frame. */
struct pell_scene_materials {
    uint16_t *frame_index;             /* per scene material + 1: the frame's material + 1, or 0 */
    struct pell_frame_material *frame; /* the translucent ones */
    size_t count;                      /* in `frame`, without the copies below */
    size_t count_with_copies;          /* including copies for further objects of a material */
    uint16_t *of_mesh;        /* per mesh: the frame's material + 1 used by its object alone, or 0; NULL: no two objects share a material */
    float (*total)[3];        /* per scene material: total reflectance of its profile, */
    float (*radius)[3];       /* and its mean radius times the material's strength, mm; 0: opaque */
    struct pell_angle *angle; /* per scene material */
    struct pell_separate_single *separate;         /* per scene material: single scattering, if it is excluded from the profile */
    struct pell_angle *angle_without_single;       /* per scene material: `angle` of the profile without single scattering */
    bool separates_single;                         /* these apply in this frame */
    const struct pell_thickness_table **thickness; /* per scene material; entries may be NULL */
    struct pell_stack **stack;                     /* layers of layered materials, borrowed by the materials in `frame` */
    size_t num_stacks;
};

/* Whether transmission through thin parts by a slab's T is included, so that transport between faces of thicker parts adds to it. */
static inline bool pell_plan_transmits(const struct pell_plan *plan)
{
    return (plan->needs & PELL_NEED_TRANSMISSION) || plan->transmits;
}

/* Whether the method identifies objects by material only, and some objects share one: the frame's plane `material` then holds of_mesh. */
static inline bool pell_separates_objects(const struct pell_scene_materials *m, const struct pell_plan *plan)
{
    return m->of_mesh && plan && !(plan->needs & PELL_NEED_SCENE);
}

/* Data of all samples of a frame. */
struct pell_engine_frame {
    const struct pell_scene *scene;
    const struct pell_settings *settings;
    const struct pell_scene_materials *materials;
    const struct pell_lens *lens;
    const struct pell_plan *plan; /* of the frame's method; NULL: no scattering */
    struct pell_rect covered;     /* bounds of the pixels that any sample may cover */
    bool denoise;                 /* denoise before post: the method reports its noise, and the settings request it */
    bool observed;                /* intermediate images are requested */
    struct pell_stage_notes *notes;
};

struct pell_engine_sample {
    const struct pell_engine_frame *frame;
    struct pell_view view;
    int index;
    const struct pell_frame *in; /* the method's frame, without rectangle and planes; NULL: none */
};

/* Result of a sample's surface stage. */
struct pell_engine_seen {
    struct pell_rect translucent; /* bounds of the pixels with translucent materials */
    int64_t translucent_pixels;
};

/* Result of the method for a sample. */
struct pell_engine_scattered {
    bool present;                   /* false: the sample has no translucent pixel, or no method runs */
    const float *standard_error[3]; /* standard error, as in pell_pass_standard_error; NULL: unknown */
};

/* Resources that an engine keeps from frame to frame. Their dependencies are in resources.c. */
enum pell_engine_resource {
    PELL_ENGINE_SCENE,  /* data for rays and textures */
    PELL_ENGINE_PLANES, /* for an image size; extended whenever a frame needs more planes */
    PELL_ENGINE_RASTER, /* for a scene and a size */
    PELL_ENGINE_LIGHTS,
    PELL_ENGINE_UNSCATTERED, /* media that transmit light unscattered */
    PELL_ENGINE_CONTACT,     /* contact shadow below the objects */
    PELL_ENGINE_CURVATURE,   /* of translucent objects */
    PELL_ENGINE_LINKS,       /* links along which surfaces light each other */
    PELL_ENGINE_INDIRECT,    /* indirect light along the links */
    PELL_ENGINE_THROUGH,     /* light transport through solids, for methods that add transmitted light */
    PELL_ENGINE_RESOURCES
};

struct pell_engine_result {
    const float *display[3];
    const float *alpha;
    ptrdiff_t stride;
    size_t num_channels;
    float exposure, white;
    int64_t invalid;
    bool covered, any_light; /* something is visible; light arrives at it */
    bool negligible;         /* but so little that no exposure shows it */
    float widest_disc;       /* largest blur radius of a sample's part of the lens, px; 0: no depth of field */
};

struct pell_engine_interface {
    const char *name;
    /* Implementation of a method on this engine; NULL: none. */
    const struct pell_method_engine *(*method)(const struct pell_method *method);

    /* Creates an instance, which serves one renderer; `gpu` as in struct pell_device. `close` accepts NULL and a half-built instance. */
    enum pell_result (*open)(struct pell_context *ctx, struct pell_pool *pool, struct pell_gpu *gpu, void **engine);
    void (*close)(void *engine);

    /* Of `frame` only scene, settings, materials and notes are set; and `plan` for PELL_ENGINE_THROUGH, PELL_ENGINE_UNSCATTERED, and the
     * second of two calls for PELL_ENGINE_PLANES. */
    enum pell_result (*make)(void *engine, enum pell_engine_resource resource, const struct pell_engine_frame *frame);
    /* Drops a resource, if it exists. */
    void (*drop)(void *engine, enum pell_engine_resource resource);
    /* Fills rays, engine, light_points and light_grid, once the scene exists. */
    void (*lend)(void *engine, struct pell_services *services);

    /* Replaces all stages of a sample, for engines that render whole images elsewhere; `pass`: the method's, or NULL. *done: whether it
     * did; the first sample of a frame decides for all. NULL: not supported. */
    enum pell_result (*sample)(void *engine, const struct pell_engine_sample *sample, struct pell_pass *pass, struct pell_engine_seen *seen,
                               bool *done);

    /* The stages of a sample, in this order; `shade` only if the method needs its plane, `hand_over` only if it runs. None allocates. */
    enum pell_result (*surface)(void *engine, const struct pell_engine_sample *sample, struct pell_engine_seen *seen);
    enum pell_result (*irradiance)(void *engine, const struct pell_engine_sample *sample);
    enum pell_result (*shade)(void *engine, const struct pell_engine_sample *sample);
    /* Sets the rectangle and the planes. */
    void (*hand_over)(void *engine, const struct pell_engine_sample *sample, struct pell_frame *in, struct pell_frame_light *out);
    enum pell_result (*composite)(void *engine, const struct pell_engine_sample *sample, const struct pell_engine_scattered *scattered);

    /* End of a frame. `average`: only `done` of the planned samples were rendered, so their mean is the result. */
    void (*average)(void *engine, int done, int planned);
    enum pell_result (*post)(void *engine, const struct pell_engine_frame *frame, const struct pell_view *view);
    /* `channels`: room for PELL_LAYER_CHANNELS (layers.h). The planes stay valid until the next frame. */
    void (*read_back)(void *engine, const struct pell_engine_frame *frame, bool noisy, struct pell_channel *channels,
                      struct pell_engine_result *out);
};

struct pell_device {
    struct pell_context *ctx; /* borrowed */
    struct pell_pool *pool;
    enum pell_engine id;
    const struct pell_engine_interface *engine;
    struct pell_engine_interface own;      /* what `engine` points to for the engine vulkan */
    struct pell_gpu *gpu;                  /* NULL: another engine */
    struct pell_gpu_buffer *const *planes; /* see pell_services; NULL: none */
};

extern const struct pell_engine_interface pell_engine_cpu;
/* The cpu engine's stages, with methods and direct light on a Vulkan device. */
void pell_engine_vulkan_make(struct pell_engine_interface *engine);

/* A device of the engine vulkan, whose Vulkan device is opened with `gpu`. */
PELL_NODISCARD enum pell_result pell_device_create_vulkan(struct pell_context *ctx, int threads, const struct pell_gpu_params *gpu,
                                                          struct pell_device **out);
/* A device that borrows the caller's Vulkan device: for passes with `planes` only. */
PELL_NODISCARD enum pell_result pell_device_create_borrowed(struct pell_context *ctx, const struct pell_gpu_borrowed *gpu,
                                                            struct pell_device **out);

/* A device of a custom engine: for tests. */
PELL_NODISCARD enum pell_result pell_device_create_with_engine(struct pell_context *ctx, int threads, enum pell_engine id,
                                                               const struct pell_engine_interface *engine, struct pell_device **out);

#endif
