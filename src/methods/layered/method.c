/* SPDX-License-Identifier: MIT
 *
 * method.c - single scattering in texture-mapped layers: G. Francois, S. Pattanaik, K. Bouatouch, G. Breton, "Subsurface Texture Mapping",
 * IRISA, 2006.
 *
 *     L(P) = F_t(w_o)/eta^2 Int sigma_s(M) p(w_in, w_out) E_K e^(-tau(K M)) e^(-tau(M P)) dM
 *
 * M is on the refracted camera ray; K is where the light on its way to M enters, found with planes that approximate the surface.
 * Differences from the paper: README.md.
 */
#include "methods/layered/layered.h"

#include "methods/as_paper.h"

#include <stddef.h>

static const char *const as_names[] = { "best", "paper", NULL };
static const char *const steps_names[] = { "optical", "equal", NULL };
static const char *const march_names[] = { "exponential", "sum", NULL };
static const char *const refraction_names[] = { "planar", "none", "exact", NULL };
static const char *const path_names[] = { "planes+rays", "planes", "rays", NULL };
static const char *const planes_names[] = { "area", "vertex", "tangent", NULL };
static const char *const under_names[] = { "material", "stop", "last", "surface-color", NULL };

#define AT(field) offsetof(struct layered_knobs, field)
/* clang-format off */
static const struct pell_knob knobs[] = {
    { "as", PELL_KNOB_ENUM, "1", AT(as), { LAYERED_BEST }, 0, 0, as_names, "the recommended settings, or those of the paper" },
    { "samples", PELL_KNOB_INT, "1", AT(samples), { 20 }, 1, 4096, NULL, "sample points along the ray below the surface" },
    { "steps", PELL_KNOB_ENUM, "1", AT(steps), { LAYERED_BY_LIGHT }, 0, 0, steps_names,
      "ray marching steps: by optical depth, shorter where more light is scattered, or equal, as in the paper" },
    { "tolerance", PELL_KNOB_FLOAT, "1", AT(tolerance), { 1e-3 }, 0, 0.1, NULL,
      "stop marching where the transmittance down and up again falls to this; 0: at the deepest layer's bottom" },
    { "march", PELL_KNOB_ENUM, "1", AT(march), { LAYERED_EXPONENTIAL }, 0, 0, march_names,
      "integrate each step over the layers that it crosses, or as in the paper use the value at its midpoint" },
    { "refraction", PELL_KNOB_ENUM, "1", AT(refraction), { LAYERED_PLANAR }, 0, 0, refraction_names,
      "refract camera rays at the surface and light at the plane where it enters; none: straight rays without reflection; exact: find the "
      "exact refracted path of light through curved boundaries, focusing included, and ignore light-path (slow)" },
    { "light-path", PELL_KNOB_ENUM, "1", AT(path), { LAYERED_PLANES_RAYS }, 0, 0, path_names,
      "entry points of light: by planes, and by rays for light from below the horizon; only by planes, as in the paper; only by rays" },
    { "planes", PELL_KNOB_ENUM, "1", AT(planes), { LAYERED_BY_AREA }, 0, 0, planes_names,
      "planes that approximate the surface: fitted to nearby vertices, weighted by area or equally; or each vertex's tangent plane" },
    { "epsilon", PELL_KNOB_FLOAT, "1", AT(epsilon), { 0.05 }, 1e-3, 0.9, NULL,
      "fit planes within the distance at which the first layer's transmittance is this; below 1e-3 distant geometry would be included" },
    { "lamps", PELL_KNOB_INT, "1", AT(light_samples), { 4 }, 1, 256, NULL,
      "sample points on each area light; an environment gets four times as many directions" },
    { "below", PELL_KNOB_ENUM, "1", AT(under), { LAYERED_AS_MATERIAL }, 0, 0, under_names, "substrate below the deepest layer" },
    { "shadows", PELL_KNOB_BOOL, "1", AT(shadows), { 1 }, 0, 1, NULL, "trace shadow rays between the lights and the surface" },
    { "multiple", PELL_KNOB_BOOL, "1", AT(multiple), { 0 }, 0, 1, NULL,
      "add multiple scattering: the profile of the layers below each pixel minus its single scattering" },
    { "diffuse", PELL_KNOB_FLOAT, "1", AT(diffuse), { 0 }, 0, 1, NULL,
      "fraction of the light that a diffuse film on top reflects in the base colour; the layers receive the rest" },
    { 0 },
};
/* clang-format on */
#undef AT

static void paper(void *values)
{
    struct layered_knobs *k = values;

    k->as = LAYERED_PAPER;
    k->samples = 100;
    k->steps = LAYERED_EQUAL;
    k->tolerance = 0.0f;
    k->march = LAYERED_SUM;
    k->refraction = LAYERED_NONE;
    k->path = LAYERED_PLANES;
    k->planes = LAYERED_BY_VERTEX;
    k->light_samples = 1;
    k->under = LAYERED_STOP;
    k->shadows = false;
}

static void plan(const void *values, struct pell_plan *plan)
{
    const struct layered_knobs *k = values;

    *plan = (struct pell_plan) {
        .needs = PELL_NEED_SCENE | PELL_NEED_HIT,
        .outputs = PELL_OUTPUT_SINGLE,
        .excludes_surface_reflection = true,
        .quantity = PELL_QUANTITY_RADIANCE,
        .mix = -1.0f,
    };
    if (k->multiple || k->diffuse > 0.0f) { /* diffuse light in addition to single scattering */
        plan->needs |= PELL_NEED_IRRADIANCE;
        plan->quantity = PELL_QUANTITY_EXITANCE;
        plan->excludes_surface_reflection = false;
    }
}

extern const struct pell_method pell_method_layered;
const struct pell_method pell_method_layered = {
    .kind = PELL_KIND_METHOD,
    .name = "layered",
    .title = "Subsurface texture mapping: single scattering in layers",
    .cite = "Guillaume Francois, Sumanta Pattanaik, Kadi Bouatouch and Gaspard Breton, Subsurface Texture Mapping, IRISA research report, "
            "2006",
    .limits = "Without multiple=on dense media are too dark. Planes approximate the surface where light enters, which is inaccurate where "
              "it curves within a few mean free paths (refraction=exact avoids this). The boundary is smooth; strength maps are ignored.",
    .knobs = knobs,
    .knobs_size = sizeof(struct layered_knobs),
    .paper = paper,
    .paper_settings = pell_paper_light,
    .plan = plan,
    .keeps_first = true,
    .cpu = &layered_cpu,
    .ignores =
        PELL_IGNORES_STRENGTH_MAP | PELL_IGNORES_NORMAL_MAP | PELL_IGNORES_ROUGHNESS | PELL_IGNORES_SPECULAR | PELL_IGNORES_PROFILE_MODEL,
};
