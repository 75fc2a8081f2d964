/* SPDX-License-Identifier: MIT
 *
 * pellucid/method.h - describes subsurface-scattering methods, and runs them on your own buffers.
 *
 * Units      lengths mm, coefficients 1/mm, irradiance and exitance W/m^2, radiance W/(m^2 sr); colour linear Rec.709, 0, 1, 2 = R, G, B.
 * Ownership  `create` transfers ownership to the caller, `destroy` releases it; every other pointer is borrowed for the call.
 * Errors     enum pell_result, logged once with the location, the value and the allowed range; *out is NULL on failure.
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

struct pell_settings;      /* render.h */
struct pell_method_engine; /* implementation of a method for one engine: private to the library */

enum pell_method_kind { PELL_KIND_METHOD, PELL_KIND_REFERENCE };
enum pell_quantity { PELL_QUANTITY_EXITANCE, PELL_QUANTITY_RADIANCE };

/* Inputs that a method reads from a frame in addition to its shape, rect, material and depth. */
enum pell_need {
    PELL_NEED_IRRADIANCE = 1 << 0,   /* irradiance that enters the surface, W/m^2 */
    PELL_NEED_SHADED = 1 << 1,       /* the image without scattering, radiance: for methods that blur the shaded image */
    PELL_NEED_STRENGTH = 1 << 2,     /* the scale of the scattering radius; may also be NULL on a caller's planes: 1 everywhere */
    PELL_NEED_NORMAL = 1 << 3,       /* the unit shading normal */
    PELL_NEED_POSITION = 1 << 4,     /* the visible point, mm */
    PELL_NEED_TRANSMISSION = 1 << 5, /* a request, not an input: the renderer computes transmission with the method's thickness tables and
                                      * adds it to M in the composite */
    PELL_NEED_SCENE = 1 << 6,        /* the renderer's scene and lights, beyond the planes. The method does not run on a caller's planes */
    PELL_NEED_HIT = 1 << 7,          /* with PELL_NEED_SCENE: the triangle and the barycentric coordinates of a pixel */
};

enum pell_output {
    PELL_OUTPUT_SINGLE = 1 << 0,  /* pell_frame_light.single */
    PELL_OUTPUT_SURFACE = 1 << 1, /* pell_frame_light.surface */
};

/* The inputs and outputs of a method with a set of knobs. */
struct pell_plan {
    unsigned needs;
    unsigned outputs;                 /* separate outputs of PELL_QUANTITY_RADIANCE; always written with exitance, else on request */
    bool excludes_surface_reflection; /* radiance without light reflected at the surface: the composite adds the specular lobe,
                                       * as it does to exitance */
    enum pell_quantity quantity;
    float mix;      /* mix exponent for all materials; negative: each material's own */
    bool opposed;   /* rotates the profile between faces at an angle; the curvature gain is then that of such profiles */
    bool local;     /* spreads light over the surface; the engine adds diffusion in the solid, and removes the light that it accounts for */
    bool spreads;   /* with PELL_NEED_TRANSMISSION: the engine spreads light that crosses a part sideways (pell_slab_spread) */
    bool transmits; /* with `local`: adds a slab's transmission weighted by pell_services_transmitted, the engine adds the rest */
    bool survives_light_change; /* with PELL_NEED_SCENE: the pass is kept when lights change (struct pell_frame.lights_revision) */
};

/* Measurements of a method's own passes, for `--stats` and `bench`. */
struct pell_pass_time {
    const char *name; /* constant */
    double seconds;
    int64_t pixels; /* written by the pass */
    int64_t bytes;  /* minimum that the pass must read and write */
    int64_t rays;   /* traced by the pass */
};

/* Properties of a scene's materials that a method may ignore when it scatters light. */
enum pell_ignored {
    PELL_IGNORES_STRENGTH_MAP = 1 << 0,  /* varies the scattering radius over the surface; the constant strength is never ignored */
    PELL_IGNORES_COLOR = 1 << 1,         /* map and constant, of materials that take their colour from a texture */
    PELL_IGNORES_MIX = 1 << 2,           /* of the same materials: fraction of the colour that is applied before scattering */
    PELL_IGNORES_NORMAL_MAP = 1 << 3,    /* for light that enters and leaves the medium; the specular lobe always uses it */
    PELL_IGNORES_ROUGHNESS = 1 << 4,     /* map and constant: light enters and leaves through a smooth boundary */
    PELL_IGNORES_SPECULAR = 1 << 5,      /* the lobe's strength, colour and model: transmission follows from the index of refraction */
    PELL_IGNORES_PROFILE_MODEL = 1 << 6, /* the medium's coefficients are used instead */
    PELL_IGNORES_DEPTH_MAPS = 1 << 7,    /* of layers: the profile at their mean depths is used instead */
};

/* A display name such as "strength map"; NULL for a value that is not in enum pell_ignored. Constant; thread-safe. */
PELL_API const char *pell_ignored_name(unsigned input);

struct pell_method {
    enum pell_method_kind kind;
    const char *name;              /* stable id, [a-z0-9-]+; its folder uses underscores */
    const char *title;             /* display name */
    const char *cite;              /* authors, title, venue, year */
    const char *limits;            /* limitations, a sentence or two */
    const struct pell_knob *knobs; /* ends with {0}; a row called "as" (enum "best", "paper") comes first */
    size_t knobs_size;
    void (*paper)(void *knobs);                             /* changes the defaults to the published settings */
    void (*paper_settings)(struct pell_settings *settings); /* the same for render settings; NULL: nothing to change */
    void (*plan)(const void *knobs, struct pell_plan *plan);
    const struct pell_method_engine *cpu, *vulkan; /* NULL: not available */
    unsigned ignores; /* enum pell_ignored, whatever the knobs. A renderer warns if a scene has such a map or colour */
    bool partial;     /* interruptible: ends early with a partial result, and stores its state in the renderer's checkpoint */
    /* The method computes data from the first frame of a deforming scene and reuses them in later frames, where they affect the image: each
     * part of a divided animation must therefore start by rendering the first frame. */
    bool keeps_first;
};

/* The built-in methods, in the order in which they are listed; NULL for an index of pell_method_count() or more. Constant data;
 * thread-safe. */
PELL_API size_t pell_method_count(void);
PELL_API const struct pell_method *pell_method_at(size_t index);

/* NULL and a logged message with the nearest name if there is no such method. `where` names the origin of the name. */
PELL_API const struct pell_method *pell_method_find(struct pell_context *ctx, const char *where, const char *name);

/* Whether the method runs with these knobs on a caller's planes (pell_pass_create); otherwise it needs a renderer's scene
 * (PELL_NEED_SCENE). `knobs` is not NULL. Thread-safe. */
PELL_API bool pell_method_runs_on_planes(const struct pell_method *method, const void *knobs);

/* Whether the knobs were created with as=paper; false if `knobs` is NULL. Thread-safe. */
PELL_API bool pell_method_as_paper(const struct pell_method *method, const void *knobs);

struct pell_setting {
    const char *name, *value, *where;
};

/* Fills `values` (knobs_size bytes): first the defaults that `as` selects, at any position among the settings, then every other setting in
 * order. `ctx` may be NULL: no messages. */
PELL_API PELL_NODISCARD enum pell_result pell_method_configure(struct pell_context *ctx, const struct pell_method *method,
                                                               const struct pell_setting *settings, size_t num_settings, void *values);

/* Creates a method's knobs in *knobs, NULL on failure, from one line of text: "gaussians=6 lod=2". Settings are separated by white space or
 * commas; of several with the same name the last is used. Text without '=' after a comma belongs to the preceding value ("tint=1,0.5,0.2").
 * "as=paper" selects the defaults, at any position. NULL or "": the defaults. The caller releases the knobs with pell_method_knobs_destroy,
 * with the same context; renderers and passes copy them. PELL_ERR_INVALID, logged: an unknown name (with the nearest one), a value that is
 * out of range or not of its type, a word without '='; PELL_ERR_NOMEM. Thread-safe. */
PELL_API PELL_NODISCARD enum pell_result pell_method_knobs_create(struct pell_context *ctx, const struct pell_method *method,
                                                                  const char *text, void **knobs);
/* Sets *knobs to NULL; destroying &(NULL) does nothing. */
PELL_API void pell_method_knobs_destroy(struct pell_context *ctx, void **knobs);

/* Change one knob, as pell_knob_set and pell_knob_set_number do; unchanged on failure. "as" is refused, because it selects the defaults of
 * all others at creation. `ctx` may be NULL: no messages. */
PELL_API PELL_NODISCARD enum pell_result pell_method_knobs_set_text(struct pell_context *ctx, const struct pell_method *method, void *knobs,
                                                                    const char *name, const char *text);
PELL_API PELL_NODISCARD enum pell_result pell_method_knobs_set_number(struct pell_context *ctx, const struct pell_method *method,
                                                                      void *knobs, const char *name, double number);

/* --- Running a method on the caller's planes ---------------------------------------------------------------------------------- */

struct pell_pass;

/* Creates a pass with all data kept between frames. `shape` is copied, materials included; `knobs` may be NULL: defaults. The device must
 * outlive the pass. PELL_ERR_UNSUPPORTED for a method that needs a scene (PELL_NEED_SCENE), PELL_ERR_DEVICE for one that the device's
 * engine does not implement, PELL_ERR_INVALID for a shape or knobs out of range. On failure *out is NULL. */
PELL_API PELL_NODISCARD enum pell_result pell_pass_create(struct pell_device *device, const struct pell_method *method, const void *knobs,
                                                          const struct pell_frame_shape *shape, struct pell_pass **out);
/* Writes `out`, three planes, inside in->rect. `in` must have the planes that the pass's plan needs, and the pass's size, stride,
 * projection and number of materials; the materials themselves are those that the pass was created with. No plane of `out` may be one of
 * `in` or another of `out`. PELL_ERR_INVALID if one of these conditions does not hold; PELL_ERR_CANCELLED. Allocates nothing. */
PELL_API PELL_NODISCARD enum pell_result pell_pass_render(struct pell_pass *pass, const struct pell_frame *in,
                                                          const struct pell_frame_light *out);
/* The plan of the method with the knobs of this pass. Valid as long as the pass. */
PELL_API const struct pell_plan *pell_pass_plan(const struct pell_pass *pass);
/* The thickness table of shape.materials[material], valid as long as the pass. NULL if the method or the material has no transmission, or
 * `material` is out of range. */
PELL_API const struct pell_thickness_table *pell_pass_thickness(const struct pell_pass *pass, size_t material);
/* Writes at most `size` pass times of the last render and returns the number written. */
PELL_API size_t pell_pass_times(const struct pell_pass *pass, struct pell_pass_time *times, size_t size);
/* Gets the standard error of each pixel as planes of the frame's stride, valid until the next render. False if the method does not estimate
 * it. */
PELL_API bool pell_pass_standard_error(const struct pell_pass *pass, const float *planes[3]);
/* Whether the last render ended early, by a time limit or an interruption, before the samples or the error that its knobs request. */
PELL_API bool pell_pass_unfinished(const struct pell_pass *pass);
/* Whether the checkpoint at the end of the last render could not be written. */
PELL_API bool pell_pass_unwritten(const struct pell_pass *pass);
/* Releases the pass and sets *pass to NULL; *pass may be NULL already. */
PELL_API void pell_pass_destroy(struct pell_pass **pass);

#ifdef __cplusplus
}
#endif
#endif
