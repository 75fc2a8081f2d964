/* SPDX-License-Identifier: MIT
 *
 * method.c - diffusion over the whole surface by Monte Carlo: H. W. Jensen et al., "A Practical Model for Subsurface Light Transport",
 * SIGGRAPH 2001; probe rays: A. King et al., "BSSRDF Importance Sampling", SIGGRAPH 2013 talks. Differences: README.md.
 */
#include "methods/dipole/dipole.h"

#include "methods/as_paper.h"

#include <stddef.h>

static const char *const as_names[] = { "best", "paper", NULL };
static const char *const sampling_names[] = { "both", "probes", "area", NULL };

#define AT(field) offsetof(struct dipole_knobs, field)
/* clang-format off */
static const struct pell_knob knobs[] = {
    { "as", PELL_KNOB_ENUM, "1", AT(as), { DI_BEST }, 0, 0, as_names, "the recommended settings, or those of the paper" },
    { "error", PELL_KNOB_FLOAT, "1", AT(error), { 0.02 }, 1e-4, 1, NULL,
      "target for the standard error of each channel of a pixel, relative to its value" },
    { "most", PELL_KNOB_INT, "1", AT(most), { 65536 }, 1, 1000000000, NULL,
      "samples per pixel at most, besides the 320 that estimate how many are needed; at least 320 are taken" },
    { "sampling", PELL_KNOB_ENUM, "1", AT(sampling), { DI_BOTH }, 0, 0, sampling_names,
      "sampling of the surface: by probe rays around the point, uniformly, or both, weighted by the balance heuristic" },
    { "strength", PELL_KNOB_BOOL, "1", AT(strength), { 1 }, 0, 1, NULL, "scale the scattering radius by the material's strength map" },
    { "half", PELL_KNOB_INT, "1", AT(half), { 0 }, 0, 2, NULL,
      "1, 2: two independent images, each with half of the work, as `compare` uses them to separate error and noise; 0: one image" },
    { 0 },
};
/* clang-format on */
#undef AT

static void paper(void *values)
{
    struct dipole_knobs *k = values;

    k->as = DI_PAPER;
    k->sampling = DI_PROBES;
    k->strength = false;
}

static void plan(const void *values, struct pell_plan *plan)
{
    const struct dipole_knobs *k = values;

    *plan = (struct pell_plan) {
        .needs = PELL_NEED_IRRADIANCE | PELL_NEED_POSITION | PELL_NEED_NORMAL | PELL_NEED_SCENE | PELL_NEED_HIT |
                 (k->strength ? PELL_NEED_STRENGTH : 0u),
        .quantity = PELL_QUANTITY_EXITANCE,
        .mix = -1.0f,
        .opposed = true,
    };
}

extern const struct pell_method pell_method_dipole;
const struct pell_method pell_method_dipole = {
    .kind = PELL_KIND_REFERENCE,
    .name = "dipole",
    .title = "Diffusion over the whole surface, by Monte Carlo",
    .cite = "Henrik Wann Jensen, Stephen R. Marschner, Marc Levoy and Pat Hanrahan, A Practical Model for Subsurface Light Transport, "
            "SIGGRAPH, 2001; Alan King, Christopher Kulla, Alejandro Conty and Marcos Fajardo, BSSRDF Importance Sampling, SIGGRAPH "
            "talks, 2013",
    .limits = "Slow: the error falls with the square root of the time. Assumes diffusion: parts of few mean free paths differ from "
              "transport.",
    .knobs = knobs,
    .knobs_size = sizeof(struct dipole_knobs),
    .paper = paper,
    .paper_settings = pell_paper_light,
    .plan = plan,
    .cpu = &pell_dipole_cpu,
    .ignores = PELL_IGNORES_DEPTH_MAPS,
};
