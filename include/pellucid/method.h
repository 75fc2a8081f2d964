/* SPDX-License-Identifier: MIT
 *
 * pellucid/method.h - one subsurface-scattering technique behind one small interface, and how to run it on your own buffers.
 *
 * Units      lengths mm, coefficients 1/mm, irradiance and exitance W/m^2, radiance W/(m^2 sr); colour linear Rec.709, 0, 1, 2 = R, G, B.
 * Ownership  `create` gives, `destroy` takes back; every other pointer is borrowed for the call.
 * Errors     enum pell_result, logged once with the place, the value and what is allowed; *out is NULL on failure.
 * Threads    a pell_method is constant data; a state belongs to one thread at a time.
 */
#ifndef PELLUCID_METHOD_H
#define PELLUCID_METHOD_H

#include <pellucid/device.h>
#include <pellucid/frame.h>
#include <pellucid/knob.h>

#ifdef __cplusplus
extern "C" {
#endif

struct pell_method_engine; /* a method on one engine: private to the library */

enum pell_method_kind { PELL_KIND_METHOD, PELL_KIND_REFERENCE };
enum pell_quantity { PELL_QUANTITY_EXITANCE, PELL_QUANTITY_RADIANCE };

/* What a method reads of a frame, beside its shape, rect, material and depth. */
enum pell_need {
    PELL_NEED_IRRADIANCE = 1 << 0,   /* light that entered the surface, W/m^2 */
    PELL_NEED_SHADED = 1 << 1,       /* the image without scattering, radiance: for methods that blur what is already shaded */
    PELL_NEED_STRENGTH = 1 << 2,     /* what scales the scattering radius; may be NULL on a caller's planes, too: 1 everywhere */
    PELL_NEED_NORMAL = 1 << 3,       /* the unit shading normal */
    PELL_NEED_POSITION = 1 << 4,     /* the point that is seen, mm */
    PELL_NEED_TRANSMISSION = 1 << 5, /* not read by the method: the renderer computes transmission with the method's thickness tables and
                                      * adds it to M in the composite */
    PELL_NEED_SCENE = 1 << 6,        /* the renderer's own scene and lights: the method reads what no plane holds. It runs in the renderer's
                                 * frames only, not on a caller's planes */
    PELL_NEED_HIT = 1 << 7,          /* with PELL_NEED_SCENE: which point of which triangle a pixel sees */
};

enum pell_output {
    PELL_OUTPUT_SINGLE = 1 << 0,  /* pell_frame_light.single */
    PELL_OUTPUT_SURFACE = 1 << 1, /* pell_frame_light.surface */
};

/* What a set of knobs asks of the frame, and what comes out. */
struct pell_plan {
    unsigned needs;
    unsigned outputs;                 /* parts that can be had apart, of PELL_QUANTITY_RADIANCE */
    bool excludes_surface_reflection; /* radiance of light that entered alone: the composite adds its specular lobe, as it does to
                                           * exitance */
    enum pell_quantity quantity;
    float mix;                  /* mix exponent for all materials; negative: each material's own */
    bool survives_light_change; /* with PELL_NEED_SCENE: lives on when the lights change, which struct pell_frame.lights_revision tells */
};

/* What `--stats` and `bench` print of a method's own passes. */
struct pell_pass_time {
    const char *name; /* constant */
    double seconds;
    int64_t pixels; /* that the pass wrote */
    int64_t bytes;  /* that it must read and write at least once */
    int64_t rays;   /* that it traced */
};

/* Inputs of a scene's materials that a method may leave out of the light that scatters. */
enum pell_ignored {
    PELL_IGNORES_STRENGTH_MAP = 1 << 0,  /* how far light goes varies over the surface; the constant strength is never ignored */
    PELL_IGNORES_COLOR = 1 << 1,         /* map and constant, of materials whose colour comes from a texture */
    PELL_IGNORES_MIX = 1 << 2,           /* of the same materials: where the colour acts */
    PELL_IGNORES_NORMAL_MAP = 1 << 3,    /* where light enters and leaves; the specular lobe always has it */
    PELL_IGNORES_ROUGHNESS = 1 << 4,     /* map and constant: the boundary is smooth where light enters and leaves */
    PELL_IGNORES_SPECULAR = 1 << 5,      /* the lobe's strength, colour and model: the index of refraction says what enters and leaves */
    PELL_IGNORES_PROFILE_MODEL = 1 << 6, /* light goes by the medium's coefficients */
    PELL_IGNORES_DEPTH_MAPS = 1 << 7,    /* of layers: what they reflect at their mean depths is what counts */
};

/* "strength map" and so on; NULL for a number that is none of enum pell_ignored. Constant; thread-safe. */
PELL_API const char *pell_ignored_name(unsigned input);

struct pell_method {
    enum pell_method_kind kind;
    const char *name;              /* stable id, [a-z0-9-]+; its folder uses underscores */
    const char *title;             /* for people */
    const char *cite;              /* authors, title, venue, year */
    const char *limits;            /* what it can't do, a sentence or two */
    const struct pell_knob *knobs; /* ends with {0}; a row called "as" (enum "best", "paper") comes first */
    size_t knobs_size;
    void (*paper)(void *knobs); /* changes the defaults to what the paper ran */
    void (*plan)(const void *knobs, struct pell_plan *plan);
    const struct pell_method_engine *cpu, *vulkan; /* NULL: not on this engine */
    unsigned
        ignores;  /* enum pell_ignored: whatever its knobs say. A renderer warns of maps and colours of the scene that are among these */
    bool partial; /* ends early with what it has when interrupted, and keeps its state in the renderer's checkpoint */
};

/* The built-in methods, in the order in which they are listed; NULL for an index of pell_method_count() or more. Constant data;
 * thread-safe. */
PELL_API size_t pell_method_count(void);
PELL_API const struct pell_method *pell_method_at(size_t index);

/* NULL and a logged message with the nearest name if there is none of that name. `where` says who asked. */
PELL_API const struct pell_method *pell_method_find(struct pell_context *ctx, const char *where, const char *name);

/* Whether it runs with these knobs on a caller's planes (pell_pass_create); else it needs a renderer's scene (PELL_NEED_SCENE). `knobs` is
 * not NULL. Thread-safe. */
PELL_API bool pell_method_runs_on_planes(const struct pell_method *method, const void *knobs);

struct pell_setting {
    const char *name, *value, *where;
};

/* Fills `values` (knobs_size bytes): the defaults of `as`, wherever it stands among the settings, then every other setting in order. */
PELL_API PELL_NODISCARD enum pell_result pell_method_configure(struct pell_context *ctx, const struct pell_method *method,
                                                               const struct pell_setting *settings, size_t num_settings, void *values);

/* A method's knobs in *knobs, NULL on failure, from one line of text: "gaussians=6 lod=2". Settings are parted by white space or commas,
 * the last of one name holds; what has no '=' after a comma belongs to the value before it ("tint=1,0.5,0.2"). "as=paper" chooses the
 * defaults, wherever it stands. NULL or "": the defaults. The caller gives the knobs back with pell_method_knobs_destroy, with the same
 * context; renderers and passes copy them. PELL_ERR_INVALID, logged: an unknown name (with the nearest one), a value that is out of range
 * or not of its type, a word without '='; PELL_ERR_NOMEM. Thread-safe. */
PELL_API PELL_NODISCARD enum pell_result pell_method_knobs_create(struct pell_context *ctx, const struct pell_method *method,
                                                                  const char *text, void **knobs);
/* Sets *knobs to NULL; destroying &(NULL) does nothing. */
PELL_API void pell_method_knobs_destroy(struct pell_context *ctx, void **knobs);

/* Change one knob, as pell_knob_set and pell_knob_set_number do; untouched on failure. "as" is refused: it chooses the defaults of all
 * others, when they are made. */
PELL_API PELL_NODISCARD enum pell_result pell_method_knobs_set_text(struct pell_context *ctx, const struct pell_method *method, void *knobs,
                                                                    const char *name, const char *text);
PELL_API PELL_NODISCARD enum pell_result pell_method_knobs_set_number(struct pell_context *ctx, const struct pell_method *method,
                                                                      void *knobs, const char *name, double number);

/* --- Running a method on the caller's planes ---------------------------------------------------------------------------------- */

struct pell_pass;

/* Makes all that outlives a frame. `shape` is copied, materials included; `knobs` may be NULL: defaults. The device must outlive the pass.
 * PELL_ERR_UNSUPPORTED for a method that needs a scene (PELL_NEED_SCENE), PELL_ERR_DEVICE for one that the device's engine does not have,
 * PELL_ERR_INVALID for a shape or knobs out of range. On failure *out is NULL. */
PELL_API PELL_NODISCARD enum pell_result pell_pass_create(struct pell_device *device, const struct pell_method *method, const void *knobs,
                                                          const struct pell_frame_shape *shape, struct pell_pass **out);
/* `in` must have the pass's shape and the planes that its plan needs; `out` three planes. Allocates nothing. */
PELL_API PELL_NODISCARD enum pell_result pell_pass_render(struct pell_pass *pass, const struct pell_frame *in,
                                                          const struct pell_frame_light *out);
PELL_API const struct pell_plan *pell_pass_plan(const struct pell_pass *pass);
PELL_API const struct pell_thickness_table *pell_pass_thickness(const struct pell_pass *pass, size_t material);
PELL_API size_t pell_pass_times(const struct pell_pass *pass, struct pell_pass_time *times, size_t size);
/* False where the method has no standard error; else planes of the frame's stride, valid until the next render. */
PELL_API bool pell_pass_standard_error(const struct pell_pass *pass, const float *planes[3]);
PELL_API void pell_pass_destroy(struct pell_pass **pass);

#ifdef __cplusplus
}
#endif
#endif
