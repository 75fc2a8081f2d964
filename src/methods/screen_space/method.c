/* SPDX-License-Identifier: MIT
 *
 * method.c - screen-space subsurface scattering: J. Jimenez, D. Gutierrez, "Screen-Space Subsurface Scattering", GPU Pro, 2010, ch. 7.
 *
 * The profile is a sum of k Gaussians, R(r) = Sum_i w_i G(v_i, r). Each is a horizontal and a vertical blur on the screen, applied to the
 * result of the one before (so with variance v_i - v_{i-1}), whose width follows the surface seen by each pixel. Differences from the
 * paper: README.md.
 */
#include "methods/screen_space/screen_space.h"

#include "methods/as_paper.h"

#include <pellucid/kernel.h>

#include <math.h>
#include <stddef.h>

static const char *const as_names[] = { "best", "paper", NULL };
static const char *const profile_names[] = { "material", "published", NULL };
static const char *const input_names[] = { "diffuse", "lit", NULL };
static const char *const first_names[] = { "blurred", "unblurred", "skin", NULL };
static const char *const form_names[] = { "surface", "paper", NULL };
static const char *const kernel_names[] = { "gaussians", "separable", NULL };
static const char *const transmission_names[] = { "off", "gaussian", "slab", NULL };

#define AT(field) offsetof(struct screen_knobs, field)
/* clang-format off */
static const struct pell_knob knobs[] = {
    { "as", PELL_KNOB_ENUM, "1", AT(as), { SCREEN_BEST }, 0, 0, as_names, "the recommended settings, or those of the paper" },
    { "gaussians", PELL_KNOB_INT, "1", AT(gaussians), { 4 }, 1, PELL_GAUSSIANS_MAX, NULL,
      "Gaussians in the fit of a material's profile; a profile given as Gaussians keeps its own" },
    { "profile", PELL_KNOB_ENUM, "1", AT(profile), { SCREEN_PROFILE_MATERIAL }, 0, 0, profile_names,
      "published: use the four Gaussians of the paper's table 7.1 for skin, skin-3layer and marble, to which they were fitted, in their "
      "colour" },
    { "input", PELL_KNOB_ENUM, "1", AT(input), { SCREEN_INPUT_DIFFUSE }, 0, 0, input_names,
      "blurred quantity: the irradiance, or as in the paper the shaded image with its highlights" },
    { "first", PELL_KNOB_ENUM, "1", AT(first), { SCREEN_FIRST_BLURRED }, 0, 0, first_names,
      "unblurred: the irradiance replaces the narrowest Gaussian; skin: only for materials named skin*" },
    { "edges", PELL_KNOB_ENUM, "1", AT(edges), { SCREEN_EDGES_SURFACE }, 0, 0, form_names,
      "surface: weight taps by their 3D distance and conserve energy; paper: seven taps on the screen, inside the mask" },
    { "foreshortening", PELL_KNOB_ENUM, "1", AT(slope), { SCREEN_SLOPE_SURFACE }, 0, 0, form_names,
      "with edges = paper: blur widths by the surface's slope, or by correction and maxdd" },
    { "ssslevel", PELL_KNOB_FLOAT, "1", AT(ssslevel), { 0 }, 0, 1e5, NULL,
      "scattering level for depths in object heights; 0: derived, so that the profile has its size in mm" },
    { "correction", PELL_KNOB_FLOAT, "1", AT(correction), { 800 }, 0, 1e5, NULL,
      "weight of the depth gradient per pixel, with foreshortening = paper" },
    { "maxdd", PELL_KNOB_FLOAT, "object heights", AT(maxdd), { 0.001 }, 0, 1, NULL,
      "limit of the depth gradient per pixel, with foreshortening = paper" },
    { "lod", PELL_KNOB_FLOAT, "1/px", AT(lod), { 1.75 }, 0.01, 100, NULL, "skip a Gaussian where its width is under 1/lod pixels" },
    { "kernel", PELL_KNOB_ENUM, "1", AT(kernel), { SCREEN_KERNEL_GAUSSIANS }, 0, 0, kernel_names,
      "gaussians: successively wider blurs, one per Gaussian; separable: pairs of passes with the best separable kernel of the profile" },
    { "rank", PELL_KNOB_INT, "1", AT(rank), { 2 }, 1, PELL_KERNEL_RANK_MAX, NULL,
      "with kernel = separable: pairs of passes; more pairs have less error" },
    { "taps", PELL_KNOB_INT, "1", AT(taps), { 12 }, 1, 64, NULL,
      "with kernel = separable: taps of a pass on either side; wider kernels skip the pixels between taps" },
    { "rotate", PELL_KNOB_BOOL, "1", AT(rotate), { 0 }, 0, 1, NULL,
      "rotate sparse lines of taps from pixel to pixel, which turns banding into noise; with kernel = separable or edges = paper, and the "
      "engine cpu" },
    { "strength", PELL_KNOB_BOOL, "1", AT(strength), { 1 }, 0, 1, NULL, "scale the scattering radius by the material's strength map" },
    { "through", PELL_KNOB_ENUM, "1", AT(transmission), { SCREEN_TRANSMISSION_SLAB }, 0, 0, transmission_names,
      "transmission: none; by thickness d, as the sum of w exp(-d^2/(2 v)); or by a slab of the medium where faces are opposite, unless "
      "the material is a sum of Gaussians" },
    { 0 },
};
/* clang-format on */
#undef AT

static void paper(void *values)
{
    struct screen_knobs *k = values;

    k->as = SCREEN_PAPER;
    k->profile = SCREEN_PROFILE_PUBLISHED;
    k->input = SCREEN_INPUT_SHADED;
    k->first = SCREEN_FIRST_SKIN;
    k->edges = SCREEN_EDGES_PAPER;
    k->slope = SCREEN_SLOPE_PAPER;
    k->ssslevel = 31.5f;
    k->correction = 800.0f;
    k->maxdd = 0.001f;
    k->lod = 0.5f;
    k->transmission = SCREEN_TRANSMISSION_OFF;
}

static void plan(const void *values, struct pell_plan *plan)
{
    const struct screen_knobs *k = values;

    *plan = (struct pell_plan) { .needs = PELL_NEED_IRRADIANCE, .quantity = PELL_QUANTITY_EXITANCE, .mix = -1.0f };
    if (k->input == SCREEN_INPUT_SHADED)
        *plan = (struct pell_plan) { .needs = PELL_NEED_SHADED, .quantity = PELL_QUANTITY_RADIANCE, .mix = 1.0f };
    if (k->strength)
        plan->needs |= PELL_NEED_STRENGTH;
    if (k->transmission != SCREEN_TRANSMISSION_OFF)
        plan->needs |= PELL_NEED_TRANSMISSION;
    plan->spreads = k->transmission == SCREEN_TRANSMISSION_SLAB;
}

extern const struct pell_method pell_method_screen_space;
const struct pell_method pell_method_screen_space = {
    .kind = PELL_KIND_METHOD,
    .name = "screen-space",
    .title = "Screen-space diffusion by Gaussian blurs",
    .cite = "Jorge Jimenez and Diego Gutierrez, Screen-Space Subsurface Scattering, GPU Pro, 2010",
    .limits = "Light is exchanged only between visible points, along the surface; transport through the solid is only approximated without "
              "detail. Light exchanged with hidden surface nearby stays where it arrives.",
    .knobs = knobs,
    .knobs_size = sizeof(struct screen_knobs),
    .paper = paper,
    .paper_settings = pell_paper_light,
    .plan = plan,
    .cpu = &pell_ss_cpu,
#ifdef PELL_HAVE_VULKAN
    .vulkan = &pell_ss_vulkan,
#endif
    .ignores = PELL_IGNORES_DEPTH_MAPS,
};
