/* SPDX-License-Identifier: MIT
 *
 * engine.h - the seam between what a frame is (renderer.c, resources.c, frame.c: order of stages, samples, what depends on what) and what
 * computes it. An engine owns everything that its stages read and write: scene structures, planes, lights.
 *
 * Errors     a stage that fails ends the frame with its result; the engine has logged why.
 * Threads    one thread at a time per instance, but for what pell_services lends.
 */
#ifndef PELL_ENGINE_H
#define PELL_ENGINE_H

#include "render/angle.h"
#include "render/services.h"
#include "render/single.h"
#include "vulkan/gpu.h"

#define PELL_STAGES_MOST 48

/* Given what a step of a chain of blurs made: light of a stride. Steps count from those ahead of the first Gaussian, of which there are
 * `preblur`. An error ends the frame. */
typedef enum pell_result pell_take_blur(void *user, const float *const light[3], ptrdiff_t stride, int step, int preblur);

/* A method on one engine. */
struct pell_method_engine {
    /* Makes all that outlives a frame. `knobs` is in range; `services` and `shape` hold while the state lives. On failure *state may be
     * half-built or NULL; `destroy` is called in either case. */
    enum pell_result (*create)(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs, void **state);
    /* Fills `out`: the cpu engine at once, others record what will. Allocates nothing. Planes that were asked for are there. */
    enum pell_result (*record)(void *state, const struct pell_frame *in, const struct pell_frame_light *out);
    void (*destroy)(void *state); /* takes NULL and a half-built state */
    /* In place of `record`, for methods whose weights vary over the surface: the light that each of a material's Gaussians blurs, times the
     * sum of their weights, one after the other. Planes of `out` are overwritten. NULL: the method is no chain of blurs. */
    enum pell_result (*blurs)(void *state, const struct pell_frame *in, const struct pell_frame_light *out, pell_take_blur *take,
                              void *user);
    /* Thickness tables of transmission, per material; NULL where the method has none. */
    const struct pell_thickness_table *(*thickness)(const void *state, size_t material);
    /* Times of the last render's passes; returns how many (at most `size`). May be NULL. */
    size_t (*times)(const void *state, struct pell_pass_time *times, size_t size);
    /* Standard error of each pixel of the last render, in the unit of what comes out; planes as in the frame, the state's own. NULL where
     * the method has no noise, or does not know it. */
    bool (*standard_error)(const void *state, const float *planes[3]);
    /* Records all that `record` does into a list, between buffers of the device: the services' `planes`, or those of `planes` below, whole
     * pictures; allocates nothing. No pixel's widths are larger than those of one that is `depth` mm away and has this strength of
     * scattering. NULL: the method does not run there. */
    void (*record_in)(void *state, struct pell_gpu_commands *commands, float depth, float strength);
    /* Of a state that was created without planes: the buffers of its own that record_in reads and leaves its result in, in the layout of
     * pellucid/vulkan.h; of those that not all methods have NULL: it reads none. False: it reads something else, or there are none. NULL:
     * so it is with all of them. */
    bool (*planes)(const void *state, struct pell_gpu_buffer *planes[PELL_GPU_PLANES]);
    /* With `planes`, before each record_in, while no list is recorded: what the host makes for a sample. `in` has no planes. NULL:
     * nothing. */
    enum pell_result (*prepare)(void *state, const struct pell_frame *in);
    bool (*unfinished)(const void *state);
    bool (*unwritten)(const void *state);
};

/* Times of a frame's stages: a row each, made by its first sample. */
struct pell_stage_notes {
    struct pell_stage_time rows[PELL_STAGES_MOST];
    size_t count;
};

/* Adds a stage's time to its row. Drops it where there is no room for another row. */
void pell_stage_note(struct pell_stage_notes *notes, const char *name, double seconds, int64_t pixels, int64_t rays, int64_t bytes);

/* The scene's materials as a frame sees them. */
struct pell_scene_materials {
    uint16_t *frame_index;             /* per scene material + 1: the frame's material + 1, or 0 */
    struct pell_frame_material *frame; /* the translucent ones */
    size_t count;                      /* of `frame`, without what follows: */
    size_t count_apart;                /* with the copies for further objects of a material */
    uint16_t *of_mesh; /* per mesh: the frame's material + 1 that its object alone has, or 0; NULL: no two objects share a material */
    float (*total)[3]; /* per scene material: total reflectance of its profile */
    struct pell_angle *angle;        /* per scene material */
    struct pell_single_apart *apart; /* per scene material: light that is scattered once, where it has no part in the profile */
    struct pell_angle *angle_apart;  /* per scene material: `angle` of what is left then */
    bool single_apart;               /* they count in this frame */
    const struct pell_thickness_table **thickness; /* per scene material; entries may be NULL */
    struct pell_stack **stack;                     /* their layers, which those of `frame` borrow */
    size_t num_stacks;
};

/* Whether what gets through thin parts by a slab's T is there, so that what goes between faces of thicker parts adds to it. */
static inline bool pell_plan_transmits(const struct pell_plan *plan)
{
    return (plan->needs & PELL_NEED_TRANSMISSION) || plan->transmits;
}

/* Whether the method knows objects by their materials alone, and some share one: of_mesh is what the frame's plane `material` holds. */
static inline bool pell_objects_apart(const struct pell_scene_materials *m, const struct pell_plan *plan)
{
    return m->of_mesh && plan && !(plan->needs & PELL_NEED_SCENE);
}

/* What holds for all samples of a frame. */
struct pell_engine_frame {
    const struct pell_scene *scene;
    const struct pell_settings *settings;
    const struct pell_scene_materials *materials;
    const struct pell_lens *lens;
    const struct pell_plan *plan; /* of the frame's method; NULL: nothing scatters */
    struct pell_rect covered;     /* holds every pixel that any sample may cover */
    bool denoise;                 /* before post: the method states its noise, and the settings ask */
    bool observed;                /* intermediate images are asked for */
    struct pell_stage_notes *notes;
};

struct pell_engine_sample {
    const struct pell_engine_frame *frame;
    struct pell_view view;
    int number;
    const struct pell_frame *in; /* the method's frame, without rectangle and planes; NULL: there is none */
};

/* What a sample's surface says. */
struct pell_engine_seen {
    struct pell_rect translucent; /* holds every pixel whose material is not opaque */
    int64_t translucent_pixels;
};

/* What the method gave of a sample. */
struct pell_engine_scattered {
    bool there;                     /* false: the sample has no translucent pixel, or no method runs */
    const float *standard_error[3]; /* standard error, as pell_pass_standard_error has it; NULL: not known */
};

/* What an engine keeps from frame to frame. What each depends on stands in resources.c. */
enum pell_engine_resource {
    PELL_ENGINE_SCENE,  /* what rays and textures need */
    PELL_ENGINE_PLANES, /* of a size; made again (what is not there yet) whenever a frame asks for more */
    PELL_ENGINE_RASTER, /* of a scene and a size */
    PELL_ENGINE_LIGHTS,
    PELL_ENGINE_CONTACT,     /* the shadow below the objects */
    PELL_ENGINE_CURVATURE,   /* of translucent objects */
    PELL_ENGINE_LINKS,       /* along which surfaces light each other */
    PELL_ENGINE_INDIRECT,    /* what the lights send along the links */
    PELL_ENGINE_THROUGH,     /* what they send through solids, for methods that add transmitted light */
    PELL_ENGINE_UNSCATTERED, /* media that let light through unscattered, for methods that don't have that themselves */
    PELL_ENGINE_RESOURCES
};

struct pell_engine_result {
    const float *display[3];
    const float *alpha;
    ptrdiff_t stride;
    size_t num_channels;
    float exposure, white;
    int64_t invalid;
    bool covered, any_light; /* something is in view; light arrives at it */
    float widest_disc;       /* radius of what a sample's part of the lens blurs most, px; 0: no depth of field */
};

struct pell_engine_interface {
    const char *name;
    /* What runs a method here; NULL: nothing. */
    const struct pell_method_engine *(*method)(const struct pell_method *method);

    /* One instance serves one renderer; `gpu` as struct pell_device has it. `close` takes NULL and what `open` left half-built. */
    enum pell_result (*open)(struct pell_context *ctx, struct pell_pool *pool, struct pell_gpu *gpu, void **engine);
    void (*close)(void *engine);

    /* `frame->plan` is NULL for all but a second call for PELL_ENGINE_PLANES, and its `covered` and `lens` are not set. */
    enum pell_result (*make)(void *engine, enum pell_engine_resource resource, const struct pell_engine_frame *frame);
    /* Nothing where it is not there. */
    void (*drop)(void *engine, enum pell_engine_resource resource);
    /* Fills in rays, engine, light_points and light_grid. Once the scene is made. */
    void (*lend)(void *engine, struct pell_services *services);

    /* In place of all stages of a sample, by engines that make whole pictures elsewhere; `pass`: the method's, or NULL. *done: it did; of
     * the first sample of a frame this says it for all of them. NULL: no engine does. */
    enum pell_result (*sample)(void *engine, const struct pell_engine_sample *sample, struct pell_pass *pass, struct pell_engine_seen *seen,
                               bool *done);

    /* The stages of a sample, in this order; `shade` where the method asks for the plane, `hand_over` where it runs. None allocates. */
    enum pell_result (*surface)(void *engine, const struct pell_engine_sample *sample, struct pell_engine_seen *seen);
    enum pell_result (*irradiance)(void *engine, const struct pell_engine_sample *sample);
    enum pell_result (*shade)(void *engine, const struct pell_engine_sample *sample);
    /* Fills in the rectangle and the planes. */
    void (*hand_over)(void *engine, const struct pell_engine_sample *sample, struct pell_frame *in, struct pell_frame_light *out);
    enum pell_result (*composite)(void *engine, const struct pell_engine_sample *sample, const struct pell_engine_scattered *scattered);

    /* The end of a frame. `average`: only `done` of the planned samples were made, their mean is what counts. */
    void (*average)(void *engine, int done, int planned);
    enum pell_result (*post)(void *engine, const struct pell_engine_frame *frame, const struct pell_view *view);
    /* `channels`: room for PELL_LAYER_CHANNELS (layers.h). The planes hold until the next frame. */
    void (*read_back)(void *engine, const struct pell_engine_frame *frame, bool noisy, struct pell_channel *channels,
                      struct pell_engine_result *out);
};

struct pell_device {
    struct pell_context *ctx; /* borrowed */
    struct pell_pool *pool;
    enum pell_engine id;
    const struct pell_engine_interface *engine;
    struct pell_engine_interface own;      /* of the engine vulkan */
    struct pell_gpu *gpu;                  /* NULL: another engine */
    struct pell_gpu_buffer *const *planes; /* see pell_services; NULL: none */
};

extern const struct pell_engine_interface pell_engine_cpu;
/* The cpu engine's stages, with methods and direct light on a Vulkan device. */
void pell_engine_vulkan_make(struct pell_engine_interface *engine);

/* A device of the engine vulkan, whose Vulkan device is opened with `gpu`. */
PELL_NODISCARD enum pell_result pell_device_create_vulkan(struct pell_context *ctx, int threads, const struct pell_gpu_params *gpu,
                                                          struct pell_device **out);
/* One whose Vulkan device is the caller's: for passes with `planes` alone. */
PELL_NODISCARD enum pell_result pell_device_create_borrowed(struct pell_context *ctx, const struct pell_gpu_borrowed *gpu,
                                                            struct pell_device **out);

/* A device of an engine of one's own: for tests. */
PELL_NODISCARD enum pell_result pell_device_create_with_engine(struct pell_context *ctx, int threads, enum pell_engine id,
                                                               const struct pell_engine_interface *engine, struct pell_device **out);

#endif
