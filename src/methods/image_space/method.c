/* SPDX-License-Identifier: MIT
 *
 * method.c - importance sampling of the profile in image space: T. Mertens, J. Kautz, P. Bekaert, F. Van Reeth, H.-P. Seidel, "Efficient
 * Rendering of Local Subsurface Scattering", Pacific Graphics, 2003.
 *
 *     M(x_o) = Sum over samples and views that see p of  R(|p - x_o|) E(p) / Sum over views that see p of (N_r p_r + N_u p_u)(r') / J
 *
 * Samples are in the tangent plane at x_o and are projected to the surface along the rays of an irradiance image. Differences from the
 * paper: README.md.
 */
#include "methods/image_space/image_space.h"

#include "methods/as_paper.h"

#include <stddef.h>

static const char *const as_names[] = { "best", "paper", NULL };
static const char *const sampling_names[] = { "combined", "separate", "importance", "uniform", NULL };
static const char *const tile_names[] = { "1", "2", "4", "8", NULL };
static const char *const views_names[] = { "eye", "eye+lights", "eye+around", NULL };
static const char *const renormalise_names[] = { "auto", "weight", "count", "off", NULL };
static const char *const spread_names[] = { "material", "albedo", NULL };
static const char *const profile_names[] = { "material", "dipole", NULL };
static const char *const through_names[] = { "auto", "off", "profile", "slab", NULL };
static const char *const misprint_names[] = { "none", "two-pi", "jacobian", "one-number", NULL };

#define AT(field) offsetof(struct is_knobs, field)
/* clang-format off */
static const struct pell_knob knobs[] = {
    { "as", PELL_KNOB_ENUM, "1", AT(as), { IS_BEST }, 0, 0, as_names, "the recommended settings, or those of the paper" },
    { "samples", PELL_KNOB_INT, "1", AT(samples), { 16 }, 1, 16384, NULL, "samples per pixel and view" },
    { "adaptive", PELL_KNOB_BOOL, "1", AT(adaptive), { 1 }, 0, 1, NULL,
      "vary the samples per pixel from half to four times, by the variation of light within the scattering radius, with the same total; "
      "above 128 samples uniform" },
    { "progressive", PELL_KNOB_BOOL, "1", AT(progressive), { 1 }, 0, 1, NULL,
      "multisamples and images with different seeds use different patterns, so that averaging them is equivalent to more samples" },
    { "sampling", PELL_KNOB_ENUM, "1", AT(sampling), { IS_COMBINED }, 0, 0, sampling_names,
      "sample radii by the profile, uniformly on a disc, or half of each: from one mixture distribution, or as in the paper from two "
      "separate ones" },
    { "tile", PELL_KNOB_ENUM, "px", AT(tile), { IS_TILE_4 }, 0, 0, tile_names,
      "side of a tile of pixels with different sample patterns; 1: all pixels use the same pattern" },
    { "views", PELL_KNOB_ENUM, "1", AT(views), { IS_VIEWS_CAMERA }, 0, 0, views_names,
      "irradiance images: the camera's view; also the views of the lights; or also six parallel views along the axes, for surfaces lit by "
      "environments" },
    { "view-size", PELL_KNOB_INT, "px", AT(view_size), { 512 }, 16, 8192, NULL, "side of the other views' irradiance images" },
    { "renormalise", PELL_KNOB_ENUM, "1", AT(renormalise), { IS_BY_VIEWS }, 0, 0, renormalise_names,
      "compensation for samples that miss the surface: normalise the weights of the others, scale by their count as in the paper, or lose "
      "the light; auto: weight for the camera alone, off with more views" },
    { "jacobian", PELL_KNOB_BOOL, "1", AT(jacobian), { 1 }, 0, 1, NULL, "weight samples by area on the surface over area in the tangent "
      "plane" },
    { "reconstruct", PELL_KNOB_BOOL, "1", AT(reconstruct), { 1 }, 0, 1, NULL,
      "average over the tile along the surface, if light spreads farther than the tile" },
    { "strength", PELL_KNOB_BOOL, "1", AT(strength), { 1 }, 0, 1, NULL, "scale the scattering radius by the material's strength map" },
    { "spread", PELL_KNOB_ENUM, "1", AT(spread), { IS_SPREAD_MATERIAL }, 0, 0, spread_names,
      "scattering distance under a colour texture: the material's, or at each pixel that of a medium with the pixel's colour and the "
      "material's mean free path" },
    { "profile", PELL_KNOB_ENUM, "1", AT(profile), { IS_PROFILE_MATERIAL }, 0, 0, profile_names,
      "the material's own, or the dipole of its coefficients" },
    { "through", PELL_KNOB_ENUM, "1", AT(through), { IS_THROUGH_AUTO }, 0, 0, through_names,
      "transmission by thickness d: none, as the profile beyond the radius d, or by a slab of the medium where faces are opposite; auto: "
      "slab with the camera's view alone, off with more views, which include the entry points" },
    { "misprint", PELL_KNOB_ENUM, "1", AT(misprint), { IS_AS_MEANT }, 0, 0, misprint_names,
      "restore a misprint of the paper's equations: 1/(2 pi) in (9), inverted Jacobian of (8), one random number for two choices" },
    { 0 },
};
/* clang-format on */
#undef AT

static void paper(void *values)
{
    struct is_knobs *k = values;

    k->as = IS_PAPER;
    k->sampling = IS_SEPARATE;
    k->renormalise = IS_BY_COUNT;
    k->adaptive = false;
    k->progressive = false;
    k->jacobian = false;
    k->reconstruct = false;
    k->strength = false;
    k->profile = IS_PROFILE_DIPOLE;
    k->through = IS_THROUGH_OFF;
}

static void plan(const void *values, struct pell_plan *plan)
{
    const struct is_knobs *k = values;

    *plan = (struct pell_plan) { .needs = PELL_NEED_IRRADIANCE, .quantity = PELL_QUANTITY_EXITANCE, .mix = -1.0f };
    if (k->strength)
        plan->needs |= PELL_NEED_STRENGTH;
    if (is_through_of(k) != IS_THROUGH_OFF)
        plan->needs |= PELL_NEED_TRANSMISSION;
    plan->spreads = is_through_of(k) == IS_THROUGH_SLAB;
    if (k->views != IS_VIEWS_CAMERA)
        plan->needs |= PELL_NEED_SCENE | PELL_NEED_POSITION | PELL_NEED_NORMAL;
}

extern const struct pell_method pell_method_image_space;
const struct pell_method pell_method_image_space = {
    .kind = PELL_KIND_METHOD,
    .name = "image-space",
    .title = "Importance sampling of the profile in irradiance images",
    .cite = "Tom Mertens, Jan Kautz, Philippe Bekaert, Frank Van Reeth and Hans-Peter Seidel, Efficient Rendering of Local Subsurface "
            "Scattering, Pacific Graphics, 2003",
    .limits = "Light that enters outside the irradiance images is missing, except for transmission through thin parts (views = eye+lights "
              "or eye+around include most of it). Few samples leave a pattern where the irradiance varies and the profile is wide.",
    .knobs = knobs,
    .knobs_size = sizeof(struct is_knobs),
    .paper = paper,
    .paper_settings = pell_paper_exit,
    .plan = plan,
    .cpu = &pell_is_cpu,
#ifdef PELL_HAVE_VULKAN
    .vulkan = &pell_is_vulkan,
#endif
    .ignores = PELL_IGNORES_DEPTH_MAPS,
};
