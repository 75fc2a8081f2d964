/* SPDX-License-Identifier: MIT
 *
 * method.c - convolution of light on planes through the object: A. Munoz, J. I. Echevarria, F. J. Seron, D. Gutierrez, "Convolution-Based
 * Simulation of Homogeneous Subsurface Scattering", Computer Graphics Forum 30(8), 2011.
 *
 *     M_l = Sum over planes i of  E_i * R_il,     R_il(x, y) = R(sqrt(x^2 + y^2 + (z_i - z_l)^2))                    (5), (6), corrected
 *
 * by Fourier transforms; E_i is the light of the surface near plane i, in front and behind. Differences from the paper: README.md.
 */
#include "methods/convolution/convolution.h"

#include "methods/as_paper.h"

#include <stddef.h>

static const char *const as_names[] = { "best", "paper", NULL };
static const char *const placement_names[] = { "equal", "surface", NULL };
static const char *const split_names[] = { "linear", "half", NULL };
static const char *const restore_names[] = { "between", "response", "off", NULL };
static const char *const threshold_names[] = { "energy", "printed", NULL };
static const char *const resolution_names[] = { "1", "1/2", "1/4", "auto", NULL };
static const char *const pixels_names[] = { "each", "one", NULL };
static const char *const through_names[] = { "slab", "planes", NULL };
static const char *const step_names[] = { "1", "2", "4", "auto", NULL };
static const char *const borders_names[] = { "even", "open", "auto", NULL };

#define AT(field) offsetof(struct convolution_knobs, field)
/* clang-format off */
static const struct pell_knob knobs[] = {
    { "as", PELL_KNOB_ENUM, "1", AT(as), { CONV_BEST }, 0, 0, as_names, "the recommended settings, or those of the paper" },
    { "planes", PELL_KNOB_INT, "1", AT(planes), { 0 }, 0, CONV_PLANES, NULL,
      "number of planes across the depth of the visible object; 0: 8, or 12 at half the resolution" },
    { "placement", PELL_KNOB_ENUM, "1", AT(placement), { CONV_EQUAL }, 0, 0, placement_names,
      "equally spaced, or denser where there is more surface" },
    { "split", PELL_KNOB_ENUM, "1", AT(split), { CONV_LINEAR }, 0, 0, split_names,
      "division of light between the two nearest planes: by distance, or half and half as in the paper" },
    { "restore", PELL_KNOB_ENUM, "1", AT(restore), { CONV_BETWEEN }, 0, 0, restore_names,
      "energy lost by splitting and gathering: keep it in images between planes, divide by the response of a flat surface, or lose it" },
    { "threshold", PELL_KNOB_FLOAT, "1", AT(threshold), { 0.0001 }, 0, 0.5, NULL,
      "skip pairs of planes that exchange less than this" },
    { "threshold-by", PELL_KNOB_ENUM, "1", AT(threshold_by), { CONV_BY_ENERGY }, 0, 0, threshold_names,
      "quantity compared with threshold: fraction of the light, or R over R(0) as in the paper" },
    { "resolution", PELL_KNOB_ENUM, "1", AT(resolution), { CONV_AUTO_SIZE }, 0, 0, resolution_names,
      "resolution of the planes relative to the image; auto: 1/2 for objects of a scene where half of the light of all channels travels "
      "three pixels or more, else 1" },
    { "pixels", PELL_KNOB_ENUM, "1", AT(pixels), { CONV_EACH }, 0, 0, pixels_names,
      "pixel size under perspective: that of each plane, or one for all planes as in the paper" },
    { "visible", PELL_KNOB_BOOL, "1", AT(visible), { 1 }, 0, 1, NULL, "inverse transforms only for planes that the image needs" },
    { "surfaces", PELL_KNOB_INT, "1", AT(surfaces), { 2 }, 1, CONV_SURFACES_MOST, NULL,
      "surface crossings per view ray whose light is computed: the first, the last, and those before the last; 1 needs no scene" },
    { "behind-step", PELL_KNOB_ENUM, "px", AT(behind_step), { CONV_EVERY_AUTO }, 0, 0, step_names,
      "spacing of the rays that find hidden surfaces; auto: 4 for resolution=1/2 and 1/4, else 2" },
    { "through", PELL_KNOB_ENUM, "1", AT(through), { CONV_THROUGH_SLAB }, 0, 0, through_names,
      "transmission of thin parts: by a slab of the medium as thick as the part along rays (Gaussians without a medium: as planes), or by "
      "R at the distance of the planes, as in the paper" },
    { "apart", PELL_KNOB_BOOL, "1", AT(apart), { 1 }, 0, 1, NULL,
      "keep light that enters on the far side in a separate image, at its mean distance from the plane; off: one image, as in the paper" },
    { "edges", PELL_KNOB_BOOL, "1", AT(edges), { 1 }, 0, 1, NULL,
      "if light travels only a pixel or two, exclude pixels across a depth discontinuity and extrapolate the surface uniformly instead" },
    { "borders", PELL_KNOB_ENUM, "1", AT(borders), { CONV_BORDERS_EVEN }, 0, 0, borders_names,
      "even: assume that hidden surface is as bright as the surface found, by normalising with the same convolutions of unit light; open: "
      "use only the surface found; auto: open, but even for surfaces=1, which finds no hidden surface" },
    { "strength", PELL_KNOB_BOOL, "1", AT(strength), { 1 }, 0, 1, NULL,
      "scale the scattering radius by the material's strength map: convolve at successively halved radii and interpolate" },
    { 0 },
};
/* clang-format on */
#undef AT

static void paper(void *values)
{
    struct convolution_knobs *k = values;

    k->as = CONV_PAPER;
    k->planes = 4;
    k->split = CONV_HALF;
    k->restore = CONV_LOST;
    k->threshold = 0.001f;
    k->threshold_by = CONV_AS_PRINTED;
    k->resolution = CONV_HALF_SIZE;
    k->behind_step = CONV_EVERY_1;
    k->pixels = CONV_ONE;
    k->through = CONV_THROUGH_PLANES;
    k->apart = false;
    k->edges = false;
    k->borders = CONV_BORDERS_AUTO;
    k->strength = false;
}

/* Section 4: Phong for what the surface reflects. */
static void paper_settings(struct pell_settings *s)
{
    pell_paper_exit(s);
    s->specular = 1 + PELL_SPECULAR_PHONG;
}

static void plan(const void *values, struct pell_plan *plan)
{
    const struct convolution_knobs *k = values;

    *plan = (struct pell_plan) { .needs = PELL_NEED_IRRADIANCE, .quantity = PELL_QUANTITY_EXITANCE, .mix = -1.0f, .local = true };
    if (k->strength)
        plan->needs |= PELL_NEED_STRENGTH;
    if (k->through == CONV_THROUGH_SLAB)
        plan->needs |= PELL_NEED_TRANSMISSION;
    plan->spreads = k->through == CONV_THROUGH_SLAB;
    if (k->surfaces > 1)
        plan->needs |= PELL_NEED_SCENE | PELL_NEED_HIT;
}

extern const struct pell_method pell_method_convolution;
const struct pell_method pell_method_convolution = {
    .kind = PELL_KIND_METHOD,
    .name = "convolution",
    .title = "Convolution of light on planes through the object",
    .cite = "Adolfo Munoz, Jose I. Echevarria, Francisco J. Seron and Diego Gutierrez, Convolution-Based Simulation of Homogeneous "
            "Subsurface Scattering, Computer Graphics Forum 30(8), 2011",
    .limits = "Distances along the view direction are quantised to the planes, so tilted surfaces are smoothed.",
    .knobs = knobs,
    .knobs_size = sizeof(struct convolution_knobs),
    .paper = paper,
    .paper_settings = paper_settings,
    .plan = plan,
    .cpu = &pell_convolution_cpu,
    .ignores = PELL_IGNORES_DEPTH_MAPS,
};
