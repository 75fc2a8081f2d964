/* SPDX-License-Identifier: MIT
 *
 * pellucid/render.h - renders a scene to an image in host memory.
 *
 *     pell_renderer_create(device, &r);
 *     pell_renderer_set_scene(r, scene);
 *     pell_renderer_set_method(r, method, knobs);       // NULL: no scattering, Lambertian, for comparison
 *     pell_settings_default(method, knobs, &settings);
 *     pell_renderer_render(r, &settings, &image);       // any number of times
 *
 * Units      lengths mm, irradiance W/m^2, radiance W/(m^2 sr), times seconds or ms by name; colour linear Rec.709.
 * Ownership  the renderer borrows device, scene and method; the image's planes belong to the renderer and are valid until its next call.
 * Errors     enum pell_result, logged once with the location, the value and the allowed range; *out is NULL on failure.
 * Threads    one thread at a time per renderer; many renderers may run at once, also on one scene and on one device (device.h).
 */
#ifndef PELLUCID_RENDER_H
#define PELLUCID_RENDER_H

#include <pellucid/image.h>
#include <pellucid/method.h>
#include <pellucid/scene.h>

#ifdef __cplusplus
extern "C" {
#endif

enum pell_tonemap { PELL_TONEMAP_REINHARD, PELL_TONEMAP_LINEAR, PELL_TONEMAP_FILMIC };
enum pell_pixel_filter { PELL_PIXEL_FILTER_GAUSSIAN, PELL_PIXEL_FILTER_BOX };
/* Transmittance of the surface for light that enters and leaves: Fresnel's F_t of a smooth boundary, or rho_dt = 1 - rho_s (albedo of the
 * specular lobe). */
enum pell_boundary_model { PELL_BOUNDARY_MODEL_ROUGH, PELL_BOUNDARY_MODEL_SMOOTH };
enum pell_exit_normalization { PELL_EXIT_NORMALIZATION_BALANCED, PELL_EXIT_NORMALIZATION_PUBLISHED };

/* Defaults, ranges and help: pell_settings_knobs(); fill with pell_settings_default. */
struct pell_settings {
    int width, height;
    int msaa;
    int light_samples;
    int ambient_samples;
    int environment_lights;
    int bounces; /* number of bounces of indirect light */
    int indirect_samples;
    bool angles;
    bool curvature;
    bool opposed;           /* rotates profiles between faces at an angle: in methods that cover the whole solid, and in transmission */
    bool single_scattering; /* separate, in closed form, for methods that compute radiant exitance */
    bool unscattered;       /* adds unscattered light through thin parts, for the same methods */
    int64_t seed;
    float exposure;     /* factor from radiance to display; 0: metered (docs/adr/0005) */
    float stops;        /* exposure compensation: scales the displayed image by 2^stops, whatever the exposure */
    float white;        /* luminance after exposure that becomes display white; 0: the 99th percentile of covered pixels, at least 1 */
    float bloom;        /* fraction of the light that the lens scatters, [0, 1]; 0: none */
    float bloom_radius; /* standard deviation of the wider of its two Gaussians, % of the image height */
    bool denoise;       /* denoises the colour of methods that estimate their standard error, for display only; requires `layers` */
    bool dof;           /* depth of field with the camera's thin lens, one lens point per multisample */
    int tonemap;        /* enum pell_tonemap */
    int pixel_filter;   /* enum pell_pixel_filter: for the displayed image with several samples per pixel */
    int exit;           /* enum pell_exit_normalization */
    int boundary;       /* enum pell_boundary_model */
    int profile;        /* profile model of media: 0 for each material's own, else 1 + enum pell_profile_model for all */
    int specular;       /* specular lobe: 0 for each material's own, else 1 + enum pell_specular_model for all */
    bool layers;        /* compute every layer of struct pell_render_result, not only R, G, B, A */
};

/* The rows of struct pell_settings, ending with {0}. Constant data; thread-safe. */
PELL_API const struct pell_knob *pell_settings_knobs(void);

/* The default settings for a method with these knobs: those of the table, some of which as=paper replaces by the settings of the paper's
 * images. If `method` or `knobs` is NULL: those of the table. Thread-safe. */
PELL_API void pell_settings_default(const struct pell_method *method, const void *knobs, struct pell_settings *settings);

struct pell_renderer;

/* A renderer without a scene or a method. PELL_ERR_NOMEM. */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_create(struct pell_device *device, struct pell_renderer **out);
/* Releases the renderer and its images, and sets *r to NULL; *r may be NULL already. */
PELL_API void pell_renderer_destroy(struct pell_renderer **r);

/* The device on which the renderer was created. */
PELL_API struct pell_device *pell_renderer_device(const struct pell_renderer *r);

/* Builds the ray tracing structures. NULL removes the scene. */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_set_scene(struct pell_renderer *r, const struct pell_scene *scene);
/* To be called after positions, directions, sizes, powers or rotations of the scene's lights were changed in place, between two frames:
 * the next frame prepares the lights again and keeps all data that do not depend on them. Cameras may be changed in place without a call.
 * Every other change requires pell_renderer_set_scene. */
PELL_API void pell_renderer_lights_changed(struct pell_renderer *r);
/* NULL: no scattering. `knobs` (NULL: defaults) is copied. */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_set_method(struct pell_renderer *r, const struct pell_method *method,
                                                                  const void *knobs);

enum pell_checkpoint_mode {
    PELL_CHECKPOINT_RENDER,
    PELL_CHECKPOINT_MERGE,         /* renders no samples: the frame consists of the samples in `parts`, which must be complete */
    PELL_CHECKPOINT_MERGE_PARTIAL, /* the same with incomplete parts */
};

/* A file in which an interruptible method stores its state, so that a later run can resume it. A run can render a part of a frame while
 * other runs, possibly on other machines, render the rest; PELL_CHECKPOINT_MERGE combines their files into the frame that a single run
 * would have rendered. */
struct pell_checkpoint {
    const char *path;             /* NULL: none, to merge without writing */
    double every;                 /* seconds between two writes, > 0; it is also written at the end of a frame */
    int first_sample, end_sample; /* samples of each pixel, multiples of the number of multisamples; 0, 0: all */
    int first_tile, end_tile;     /* tiles of 8 x 8 pixels, in rows from the top; 0, 0: all */
    const char *note;             /* text stored in the file, at most 64 KiB; NULL: none */
    enum pell_checkpoint_mode mode;
    const char *const *parts; /* files to merge */
    int num_parts;
};

/* Sets the checkpoint (copied) from the next frame on; NULL: no file. An existing file is read before the first sample and must have the
 * same scene, size, seed and knobs; otherwise the frame fails with PELL_ERR_FORMAT or PELL_ERR_INVALID and the file is not changed. It is
 * replaced atomically. Files to merge must match in the same way and must not overlap. PELL_ERR_INVALID at once: no path, `every` not in
 * (0, 1e9], or ranges that end before they begin; PELL_ERR_UNSUPPORTED at the frame for a method without state (pell_method.partial). */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_set_checkpoint(struct pell_renderer *r, const struct pell_checkpoint *checkpoint);

/* The Gaussian that an intermediate image of a material has been blurred by, from the unblurred light on. */
struct pell_intermediate_gaussian {
    const char *material; /* its name */
    double variance;      /* mm^2 on the surface */
    double weight[3];     /* of the image in the method's result, R, G, B; 0: only an intermediate step to a wider Gaussian */
};

/* An intermediate image of a frame: a plane of struct pell_frame, or an intermediate result of a method (docs/guide/command-line.md). */
struct pell_intermediate {
    const char *name; /* "frame.irradiance", "texture-space.texel-size": [a-z0-9.-]+, up to 63 characters, unique within a frame */
    const char *unit; /* "1" for a pure number */
    const char *what; /* one sentence */
    int width, height;
    ptrdiff_t stride;       /* floats from row to row */
    const float *planes[3]; /* finite */
    int components;         /* [1, 3]; with `color` three: R, G, B; otherwise coordinates */
    bool color;
    const struct pell_intermediate_gaussian *gaussians; /* of a blurred image: one per material; NULL: none */
    size_t num_gaussians;
};

/* Called with each intermediate image of a frame's first multisample, on the rendering thread. The image is valid during the call. Any
 * result but PELL_OK ends the frame with that result. */
struct pell_observer {
    enum pell_result (*show)(void *user, const struct pell_intermediate *image);
    void *user;
};

/* Sets the observer (copied) from the next frame on; NULL removes it. It costs time and memory, because methods compute images that are
 * otherwise not needed. */
PELL_API void pell_renderer_set_observer(struct pell_renderer *r, const struct pell_observer *observer);

/* One stage of a frame. */
struct pell_stage_time {
    const char *name;
    double ms;
    int64_t pixels, rays, bytes;
    double bandwidth_ms; /* time to copy as many bytes on this machine; 0: not measured */
};

struct pell_render_result {
    int width, height;
    ptrdiff_t stride;
    const struct pell_channel *channels; /* linear: "R", "G", "B", "A", "diffuse.multiple.R", ... as EXR layers are named */
    size_t num_channels;
    const float *display[3]; /* after exposure, tone mapping and the pixel filter, [0, 1], not sRGB-encoded; stride as above */
    const float *alpha;
    const struct pell_stage_time *stages;
    size_t num_stages;
    double seconds;
    int64_t invalid;       /* number of pixels that were NaN or infinite and were set to 0; expected to be 0 */
    float exposure, white; /* applied values: factor without stops; luminance after exposure and stops that is display white */
    struct pell_rect rect; /* bounds of the translucent pixels */
    bool partial;          /* ended early by pell_context_interrupt: complete, but with fewer samples than requested */
    bool unfinished;       /* ended by a time limit or an interruption before the requested samples or error */
    bool unwritten;        /* the checkpoint at the end could not be written, which was logged */
};

/* Renders one frame. The first frame of a scene, a size or a method allocates and prepares; later ones reuse it. PELL_ERR_INVALID for
 * settings out of range or above a limit and for a renderer without a scene, PELL_ERR_NOMEM, PELL_ERR_CANCELLED after pell_context_cancel.
 * On failure *image is {0}, and the planes of the last image are no longer valid. */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_render(struct pell_renderer *r, const struct pell_settings *settings,
                                                              struct pell_render_result *image);

/* Logs warnings where the scene violates the method's assumptions: a mean free path larger than the thinnest part or under half a pixel,
 * open surfaces or inverted normals of translucent objects. Examines every triangle; fails only without memory. */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_check_assumptions(struct pell_renderer *r, const struct pell_settings *settings);

#ifdef __cplusplus
}
#endif
#endif
