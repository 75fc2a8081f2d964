/* SPDX-License-Identifier: MIT
 *
 * method.c - hierarchical diffusion: H. W. Jensen, J. Buhler, "A Rapid Hierarchical Rendering Technique for Translucent Materials",
 * SIGGRAPH 2002. Differences from the paper: README.md.
 */
#include "methods/hierarchical/hierarchical.h"

#include "methods/as_paper.h"

#include <stddef.h>

static const char *const as_names[] = { "best", "paper", NULL };
static const char *const near_names[] = { "corrected", "plain", NULL };

#define AT(field) offsetof(struct hierarchical_knobs, field)
/* clang-format off */
static const struct pell_knob knobs[] = {
    { "as", PELL_KNOB_ENUM, "1", AT(as), { HI_BEST }, 0, 0, as_names, "the recommended settings, or those of the paper" },
    { "error", PELL_KNOB_FLOAT, "sr", AT(error), { 0.1 }, 1e-6, 10, NULL,
      "a cluster of samples counts as one if its area subtends a smaller solid angle than this" },
    { "density", PELL_KNOB_FLOAT, "1", AT(density), { 4 }, 0.01, 1000, NULL,
      "number of samples on a disc that contains a quarter of the light of the narrowest channel's profile" },
    { "points", PELL_KNOB_INT, "1", AT(points), { 4000000 }, 64, 100000000, NULL,
      "maximum number of sample points in the scene; a warning is printed if `density` needs more" },
    { "near", PELL_KNOB_ENUM, "1", AT(near), { HI_NEAR_CORRECTED }, 0, 0, near_names,
      "light of the nearest samples: corrected to the response of a smooth surface, or the plain sum" },
    { "gaussians", PELL_KNOB_INT, "1", AT(gaussians), { 0 }, 0, PELL_GAUSSIANS_MAX, NULL,
      "0: the profile itself; else the best-fitting sum of this number of Gaussians; a profile given as Gaussians keeps its own" },
    { "strength", PELL_KNOB_BOOL, "1", AT(strength), { 1 }, 0, 1, NULL, "scale the scattering radius by the material's strength map" },
    { 0 },
};
/* clang-format on */
#undef AT

static void paper(void *values)
{
    struct hierarchical_knobs *k = values;

    k->as = HI_PAPER;
    k->density = 1.0f;
    k->near = HI_NEAR_PLAIN;
    k->strength = false;
}

static void plan(const void *values, struct pell_plan *plan)
{
    const struct hierarchical_knobs *k = values;

    *plan = (struct pell_plan) {
        .needs = PELL_NEED_IRRADIANCE | PELL_NEED_POSITION | PELL_NEED_NORMAL | PELL_NEED_SCENE | PELL_NEED_HIT |
                 (k->strength ? PELL_NEED_STRENGTH : 0u),
        .quantity = PELL_QUANTITY_EXITANCE,
        .mix = -1.0f,
        .opposed = true,
    };
}

extern const struct pell_method pell_method_hierarchical;
const struct pell_method pell_method_hierarchical = {
    .kind = PELL_KIND_REFERENCE,
    .name = "hierarchical",
    .title = "Diffusion over the whole surface, by an octree of samples",
    .cite = "Henrik Wann Jensen and Juan Buhler, A Rapid Hierarchical Rendering Technique for Translucent Materials, SIGGRAPH, 2002",
    .limits = "Assumes diffusion: parts of few mean free paths differ from transport. Irradiance detail finer than the sample distance "
              "is smoothed.",
    .knobs = knobs,
    .knobs_size = sizeof(struct hierarchical_knobs),
    .paper = paper,
    .paper_settings = pell_paper_light,
    .plan = plan,
    .cpu = &pell_hierarchical_cpu,
    .ignores = PELL_IGNORES_DEPTH_MAPS,
};
