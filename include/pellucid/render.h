/* SPDX-License-Identifier: MIT
 *
 * pellucid/render.h - from a scene to a picture in host memory.
 *
 *     pell_renderer_create(device, &r);
 *     pell_renderer_set_scene(r, scene);
 *     pell_renderer_set_method(r, method, knobs);       // NULL: no scattering, plain Lambert, to compare with
 *     pell_renderer_render(r, &settings, &picture);     // as often as wanted
 *
 * Units      lengths mm, irradiance W/m^2, radiance W/(m^2 sr), times seconds or ms by name; colour linear Rec.709.
 * Ownership  the renderer borrows device, scene and method; the picture's planes are the renderer's and hold until the next call on it.
 * Errors     enum pell_result, logged once with the place, the value and what is allowed; *out is NULL on failure.
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

enum pell_tonemap { PELL_TONEMAP_REINHARD, PELL_TONEMAP_LINEAR };
/* How light passes the surface, in and out: by Fresnel's F_t of a smooth boundary, or by rho_dt = 1 - rho_s (albedo of the specular
 * lobe). */
enum pell_boundary_model { PELL_BOUNDARY_MODEL_ROUGH, PELL_BOUNDARY_MODEL_SMOOTH };
enum pell_exit_normalization { PELL_EXIT_NORMALIZATION_BALANCED, PELL_EXIT_NORMALIZATION_PUBLISHED };

/* Defaults, ranges and help: pell_settings_knobs(); fill with pell_knobs_default(pell_settings_knobs(), &s). */
struct pell_settings {
    int width, height;
    int msaa;
    int light_samples;
    int ambient_samples;
    int environment_lights;
    int64_t seed;
    float exposure;     /* 0: key 0.18 over the log-average luminance of what is covered */
    float white;        /* luminance after exposure that becomes display white; 0: the picture's largest */
    float bloom;        /* share of the light that the lens scatters, [0, 1]; 0: none */
    float bloom_radius; /* of the wider of its two Gaussians: standard deviation, % of the picture's height */
    bool dof;           /* depth of field: the picture is seen through the camera's lens, one point of it a multisample */
    int tonemap;        /* enum pell_tonemap */
    int exit;           /* enum pell_exit_normalization */
    int boundary;       /* enum pell_boundary_model */
    int profile;        /* of media: 0 for each material's own model, else 1 + enum pell_profile_model for all of them */
    bool layers;        /* make every layer of struct pell_render_result, not only R, G, B, A */
};

/* The rows of struct pell_settings, ending with {0}. Constant data; thread-safe. */
PELL_API const struct pell_knob *pell_settings_knobs(void);

struct pell_renderer;

PELL_API PELL_NODISCARD enum pell_result pell_renderer_create(struct pell_device *device, struct pell_renderer **out);
PELL_API void pell_renderer_destroy(struct pell_renderer **r);

PELL_API struct pell_device *pell_renderer_device(const struct pell_renderer *r);

/* Builds what rays need. NULL takes the scene away. */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_set_scene(struct pell_renderer *r, const struct pell_scene *scene);
/* NULL: no scattering. `knobs` (NULL: defaults) is copied. */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_set_method(struct pell_renderer *r, const struct pell_method *method,
                                                                  const void *knobs);

/* A file in which a method that works for long keeps its state, so that a later run goes on where one ended, or was ended. */
struct pell_checkpoint {
    const char *path;
    double every; /* seconds between two writings, > 0; it is written at the end of a frame, too */
};

/* From the next frame on; NULL: no file. Copied. A file that is there is read before the first sample and must be of the same scene, size,
 * seed and knobs, else the frame fails with PELL_ERR_FORMAT or PELL_ERR_INVALID and the file stays as it is. It is replaced as a whole,
 * never half-written. PELL_ERR_INVALID at once: no path, or `every` not in (0, 1e9]; PELL_ERR_UNSUPPORTED at the frame for a method that
 * keeps nothing (pell_method.partial). */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_set_checkpoint(struct pell_renderer *r, const struct pell_checkpoint *checkpoint);

/* One stage of a frame. */
struct pell_stage_time {
    const char *name;
    double ms;
    int64_t pixels, rays, bytes;
    double bandwidth_ms; /* copying as many bytes on this machine; 0: not measured */
};

struct pell_render_result {
    int width, height;
    ptrdiff_t stride;
    const struct pell_channel *channels; /* linear: "R", "G", "B", "A", "diffuse.multiple.R", ... as EXR layers are named */
    size_t num_channels;
    const float *display[3]; /* after exposure and tone mapping, [0, 1], not sRGB-encoded; stride as above */
    const float *alpha;
    const struct pell_stage_time *stages;
    size_t num_stages;
    double seconds;
    int64_t invalid;       /* pixels that came out as NaN or infinite and were set to 0: 0 unless something is wrong */
    float exposure;        /* that was applied */
    struct pell_rect rect; /* of translucent pixels */
    bool partial;          /* pell_context_interrupt ended it early: whole, but with fewer samples than were asked for */
};

PELL_API PELL_NODISCARD enum pell_result pell_renderer_render(struct pell_renderer *r, const struct pell_settings *settings,
                                                              struct pell_render_result *image);

/* Warns, in the log, where the scene leaves what the method can do: a mean free path larger than the thinnest part or under half a pixel,
 * open or turned surfaces of translucent objects. Looks at every triangle; fails for want of memory only. */
PELL_API PELL_NODISCARD enum pell_result pell_renderer_check_assumptions(struct pell_renderer *r, const struct pell_settings *settings);

#ifdef __cplusplus
}
#endif
#endif
