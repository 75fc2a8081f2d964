/* SPDX-License-Identifier: MIT
 *
 * method.c - exact single scattering: B. Walter, S. Zhao, N. Holzschuch and K. Bala, "Single Scattering in Refractive Media with Triangle
 * Mesh Boundaries", SIGGRAPH 2009; distances along the ray: C. Kulla and M. Fajardo, "Importance Sampling Techniques for Path Tracing in
 * Participating Media", EGSR 2012. Differences: README.md.
 */
#include "methods/single_scatter/single_scatter.h"

#include "methods/as_paper.h"

#include <stddef.h>

static const char *const as_names[] = { "best", "paper", NULL };
static const char *const distance_names[] = { "both", "transmittance", "equiangular", NULL };
static const char *const refraction_names[] = { "exact", "none", NULL };
static const char *const normals_names[] = { "smooth", "flat", NULL };

#define AT(field) offsetof(struct single_knobs, field)
/* clang-format off */
static const struct pell_knob knobs[] = {
    { "as", PELL_KNOB_ENUM, "1", AT(as), { SINGLE_BEST }, 0, 0, as_names, "the recommended settings, or those of the paper" },
    { "error", PELL_KNOB_FLOAT, "1", AT(error), { 0.02 }, 1e-4, 1, NULL,
      "target for the standard error of each channel of a pixel, relative to its value" },
    { "most", PELL_KNOB_INT, "1", AT(most), { 65536 }, 128, 1000000000, NULL,
      "samples per pixel at most, besides the 128 that estimate how many are needed" },
    { "distance", PELL_KNOB_ENUM, "1", AT(distance), { SINGLE_BOTH }, 0, 0, distance_names,
      "distance sampling along the ray: by transmittance, equiangular about the light, or both with the balance heuristic" },
    { "refraction", PELL_KNOB_ENUM, "1", AT(refraction), { SINGLE_EXACT }, 0, 0, refraction_names,
      "refraction at the surface in both directions; none: straight paths without reflection" },
    { "normals", PELL_KNOB_ENUM, "1", AT(normals), { SINGLE_SMOOTH }, 0, 0, normals_names,
      "normals for refraction: interpolated from the vertices, or those of the triangles" },
    { "half", PELL_KNOB_INT, "1", AT(half), { 0 }, 0, 2, NULL,
      "1, 2: two independent images, each with half of the work, as `compare` uses them to separate error and noise; 0: one image" },
    { 0 },
};
/* clang-format on */
#undef AT

static void paper(void *values)
{
    struct single_knobs *k = values;

    k->as = SINGLE_PAPER;
    k->distance = SINGLE_TRANSMITTANCE;
}

static void plan(const void *values, struct pell_plan *plan)
{
    (void) values;
    *plan = (struct pell_plan) {
        .needs = PELL_NEED_POSITION | PELL_NEED_SCENE,
        .outputs = PELL_OUTPUT_SINGLE,
        .excludes_surface_reflection = true,
        .quantity = PELL_QUANTITY_RADIANCE,
        .mix = -1.0f,
    };
}

extern const struct pell_method pell_method_single_scatter;
const struct pell_method pell_method_single_scatter = {
    .kind = PELL_KIND_REFERENCE,
    .name = "single-scatter",
    .title = "Single scattering, exact",
    .cite = "Bruce Walter, Shuang Zhao, Nicolas Holzschuch and Kavita Bala, Single Scattering in Refractive Media with Triangle Mesh "
            "Boundaries, SIGGRAPH, 2009; Christopher Kulla and Marcos Fajardo, Importance Sampling Techniques for Path Tracing in "
            "Participating "
            "Media, EGSR, 2012",
    .limits = "Multiple scattering and internal reflections before or after the scattering event are not included. The boundary is "
              "smooth, whatever the material's roughness; strength maps are ignored.",
    .knobs = knobs,
    .knobs_size = sizeof(struct single_knobs),
    .paper = paper,
    .paper_settings = pell_paper_light,
    .plan = plan,
    .cpu = &pell_single_scatter_cpu,
    .ignores =
        PELL_IGNORES_STRENGTH_MAP | PELL_IGNORES_NORMAL_MAP | PELL_IGNORES_ROUGHNESS | PELL_IGNORES_SPECULAR | PELL_IGNORES_PROFILE_MODEL,
};
