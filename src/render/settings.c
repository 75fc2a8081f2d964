/* SPDX-License-Identifier: MIT
 * settings.c - the rows of struct pell_settings. */
#include "base/base.h"

#include "optics/medium/specular.h"
#include "render/renderer.h"
#include "shared/tone.h"

#include <pellucid/render.h>

#include <string.h>

static const char *const tonemaps[] = { PELL_CURVE_REINHARD, PELL_CURVE_LINEAR, PELL_CURVE_FILMIC, NULL };
static const char *const pixel_filters[] = { "gaussian", "box", NULL };
static const char *const exits[] = { "balanced", "published", NULL };
static const char *const boundaries[] = { "rough", "smooth", NULL };
/* The names of the rows of pell_profile_model_row, which a test holds them to. */
static const char *const profiles[] = { "material", "dipole", "better-dipole", "normalized-diffusion", "photon-beam", "monte-carlo", NULL };
_Static_assert(PELL_COUNT(profiles) == PELL_PROFILE_MODELS + 2, "one name per model");
/* Those of pell_specular_name. */
static const char *const lobes[] = { "material", "ggx", "kelemen", "phong", "blinn-phong", NULL };
_Static_assert(PELL_COUNT(lobes) == PELL_SPECULAR_MODELS + 2, "one name per lobe");

#define AT(field) offsetof(struct pell_settings, field)
/* clang-format off */
static const struct pell_knob settings_knobs[] = {
    { "width", PELL_KNOB_INT, "px", AT(width), { 1280 }, 1, PELL_PICTURE_MOST, NULL, "width of the image" },
    { "height", PELL_KNOB_INT, "px", AT(height), { 720 }, 1, PELL_PICTURE_MOST, NULL, "height of the image" },
    { "msaa", PELL_KNOB_INT, "1", AT(msaa), { 4 }, 1, PELL_MSAA_MOST, NULL,
      "samples per pixel; the method runs on the image of each sample, then the images are averaged" },
    { "light-samples", PELL_KNOB_INT, "1", AT(light_samples), { 16 }, 1, 1024, NULL,
      "shadow rays per pixel and area light, distributed over the multisamples" },
    { "ambient-samples", PELL_KNOB_INT, "1", AT(ambient_samples), { 16 }, 1, 1024, NULL,
      "rays per pixel for the visibility of the low-frequency part of an environment, distributed over the multisamples" },
    { "environment-lights", PELL_KNOB_INT, "1", AT(environment_lights), { 24 }, 0, 256, NULL,
      "shadowed directional lights that represent an environment's bright parts" },
    { "bounces", PELL_KNOB_INT, "1", AT(bounces), { 8 }, 0, 64, NULL,
      "diffuse bounces: how often light that leaves a surface enters the same or another surface again; 0: never; path-trace has a knob of "
      "that name" },
    { "indirect-samples", PELL_KNOB_INT, "1", AT(indirect_samples), { 16384 }, 64, 1 << 22, NULL,
      "approximate number of surface points at which indirect light (bounces) is gathered" },
    { "angles", PELL_KNOB_BOOL, "1", AT(angles), { 1 }, 0, 1, NULL,
      "reflectance of translucent media depends on the angles of entering and leaving light; off: as at normal incidence" },
    { "curvature", PELL_KNOB_BOOL, "1", AT(curvature), { 1 }, 0, 1, NULL,
      "convex surfaces of translucent media reflect more light, concave and thin ones less; off: as a half-space" },
    { "single-scattering", PELL_KNOB_BOOL, "1", AT(single_scattering), { 1 }, 0, 1, NULL,
      "compute single scattering separately, from the directions of light and view; off: it is part of the profile" },
    { "opposed", PELL_KNOB_BOOL, "1", AT(opposed), { 1 }, 0, 1, NULL,
      "transport through a solid follows its shape: angles between faces, diffusion inside; off: half-space profiles and plane slabs" },
    { "unscattered", PELL_KNOB_BOOL, "1", AT(unscattered), { 1 }, 0, 1, NULL,
      "unscattered light passes thin parts of media: it shows the background, and brightens their shadows" },
    { "seed", PELL_KNOB_INT64, "1", AT(seed), { 0 }, 0, 9007199254740992.0, NULL,
      "seed of all sample patterns; equal seeds give bit-identical images" },
    { "exposure", PELL_KNOB_FLOAT, "1", AT(exposure), { 0 }, 0, 1e12, NULL,
      "factor from radiance to display; 0: metered from the light on the object" },
    { "stops", PELL_KNOB_FLOAT, "1", AT(stops), { 0 }, -20, 20, NULL,
      "exposure compensation in stops: 1 is twice as bright, -1 half as bright" },
    { "white", PELL_KNOB_FLOAT, "1", AT(white), { 0 }, 0, 1e12, NULL,
      "luminance after exposure that becomes display white; 0: the 99th percentile of the object's luminance, at least 1" },
    { "bloom", PELL_KNOB_FLOAT, "1", AT(bloom), { 0 }, 0, 1, NULL,
      "fraction of the light that the lens scatters into a halo of two Gaussians; 0.1 is strong" },
    { "bloom-radius", PELL_KNOB_FLOAT, "%", AT(bloom_radius), { 3 }, 0, 25, NULL,
      "standard deviation of the halo's wider Gaussian in percent of the image height; the other is a quarter as wide" },
    { "denoise", PELL_KNOB_BOOL, "1", AT(denoise), { 0 }, 0, 1, NULL,
      "denoise the image of a reference that estimates its noise, for display: non-local means guided by normal, albedo and depth" },
    { "dof", PELL_KNOB_BOOL, "1", AT(dof), { 0 }, 0, 1, NULL,
      "depth of field by the camera's focus and f-number; each of the msaa samples uses a part of the lens" },
    { "tonemap", PELL_KNOB_ENUM, "1", AT(tonemap), { PELL_TONEMAP_REINHARD }, 0, 0, tonemaps,
      "curve from exposed radiance to the display: photographic (Reinhard et al. 2002), none, or filmic (ACES), where bright colours turn "
      "white and --white has no effect" },
    { "pixel-filter", PELL_KNOB_ENUM, "1", AT(pixel_filter), { PELL_PIXEL_FILTER_GAUSSIAN }, 0, 0, pixel_filters,
      "reconstruction filter of the displayed image, with several samples per pixel: a Gaussian around the pixel's centre, for smooth "
      "edges, or the mean of the pixel's own samples, as always in EXR, HDR and PFM" },
    { "exit", PELL_KNOB_ENUM, "1", AT(exit), { PELL_EXIT_NORMALIZATION_BALANCED }, 0, 0, exits,
      "exit normalization: balanced conserves the energy of the diffusion profile; published loses 6 to 9 % of it" },
    { "boundary", PELL_KNOB_ENUM, "1", AT(boundary), { PELL_BOUNDARY_MODEL_ROUGH }, 0, 0, boundaries,
      "transmittance of the surface: one minus the albedo of the specular lobe, or Fresnel transmittance of a smooth dielectric" },
    { "profile", PELL_KNOB_ENUM, "1", AT(profile), { 0 }, 0, 0, profiles,
      "profile model of all materials with coefficients; material: each material's own" },
    { "specular", PELL_KNOB_ENUM, "1", AT(specular), { 0 }, 0, 0, lobes,
      "specular lobe of all materials; material: each material's own" },
    { "layers", PELL_KNOB_BOOL, "1", AT(layers), { 0 }, 0, 1, NULL,
      "compute every layer (diffuse, transmission, specular, irradiance, depth, normal) in addition to the image" },
    {0},
};
/* clang-format on */

const struct pell_knob *pell_settings_knobs(void)
{
    return settings_knobs;
}

bool pell_method_as_paper(const struct pell_method *method, const void *knobs)
{
    const struct pell_knob *as = method && knobs ? pell_knob_find(method->knobs, "as") : NULL;
    int chosen;

    if (!as)
        return false;
    memcpy(&chosen, (const char *) knobs + as->offset, sizeof(chosen));
    return strcmp(as->choices[chosen], "paper") == 0;
}

void pell_settings_default(const struct pell_method *method, const void *knobs, struct pell_settings *settings)
{
    pell_knobs_default(settings_knobs, settings);
    if (pell_method_as_paper(method, knobs) && method->paper_settings)
        method->paper_settings(settings);
}
