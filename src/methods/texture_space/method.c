/* SPDX-License-Identifier: MIT
 *
 * method.c - diffusion in texture space with translucent shadow maps: E. d'Eon, D. Luebke, E. Enderton, "Efficient Rendering of Human
 * Skin", Eurographics Symposium on Rendering, 2007.
 *
 *     M(C) = Sum_i w_i B_i(C) + Sum over lights Sum_i w_i exp(-d_i^2/(2 v_i)) fade_i B_i(A),      B_i = irradiance * G(v_i)
 *
 * The surface is laid out flat; each B_i is a separable blur of B_(i-1) there, whose width follows the stretch of the layout. A is the
 * point where the light transmitted to C entered, d_i the thickness there. Differences from the paper: README.md.
 */
#include "methods/texture_space/texture_space.h"

#include "methods/as_paper.h"

#include <stddef.h>

static const char *const as_names[] = { "best", "paper", NULL };
static const char *const charts_names[] = { "auto", "uv", "planar", NULL };
static const char *const kernel_names[] = { "dense", "seven", "jittered-13", NULL };
static const char *const first_names[] = { "blurred", "unblurred", NULL };
static const char *const tsm_names[] = { "ray", "map", "off", NULL };
static const char *const transmission_names[] = { "slab", "gaussian", NULL };
static const char *const thickness_names[] = { "faces", "printed", NULL };
static const char *const fade_names[] = { "overlap", "linear", NULL };
static const char *const lights_names[] = { "own", "sum", NULL };

#define AT(field) offsetof(struct ts_knobs, field)
/* clang-format off */
static const struct pell_knob knobs[] = {
    { "as", PELL_KNOB_ENUM, "1", AT(as), { TS_BEST }, 0, 0, as_names, "the recommended settings, or those of the paper" },
    { "size", PELL_KNOB_INT, "texels", AT(size), { 0 }, 0, 8192, NULL,
      "side of the largest object's map, at least 16, doubled until its charts fit; smaller objects get smaller maps with the same texel "
      "density; 0: two texels per pixel at the nearest point of an object, at most 1024" },
    { "gaussians", PELL_KNOB_INT, "1", AT(gaussians), { 6 }, 1, PELL_GAUSSIANS_MAX, NULL,
      "Gaussians in the fit of a material's profile; a profile given as Gaussians keeps its own" },
    { "charts", PELL_KNOB_ENUM, "1", AT(charts), { TS_CHARTS_AUTO }, 0, 0, charts_names,
      "layout of the map: the texture coordinates unchanged, or planar charts; auto: the first UV set without overlapping charts, else the "
      "first set with its charts separated; planar if coordinates are missing or unusable" },
    { "border", PELL_KNOB_INT, "texels", AT(border), { -1 }, -1, 512, NULL,
      "width of the border in which charts are extended over their neighbours, so that blurs cross seams; 0: visible seams; -1: the reach "
      "of the widest blur, up to a tenth of the map" },
    { "kernel", PELL_KNOB_ENUM, "1", AT(kernel), { TS_KERNEL_DENSE }, 0, 0, kernel_names,
      "dense: taps at texels, weighted by their distance along the surface; seven: the paper's taps with the blurred stretch map; "
      "jittered-13: one pass of thirteen taps instead of all Gaussians (Hable, Borshukov and Hejl 2009), only on engine cpu" },
    { "stretch", PELL_KNOB_BOOL, "1", AT(stretch), { 1 }, 0, 1, NULL,
      "correct blur widths for the stretch of the layout; off: one scale for the whole map" },
    { "first", PELL_KNOB_ENUM, "1", AT(first), { TS_FIRST_BLURRED }, 0, 0, first_names,
      "unblurred: the pixel's irradiance replaces the narrowest Gaussian" },
    { "tsm", PELL_KNOB_ENUM, "1", AT(tsm), { TS_TSM_RAY }, 0, 0, tsm_names,
      "entry points of transmitted light: by rays, or by the light's shadow map; off: no transmission" },
    { "tsm-size", PELL_KNOB_INT, "px", AT(tsm_size), { 1024 }, 16, 8192, NULL, "side of the lights' maps" },
    { "through", PELL_KNOB_ENUM, "1", AT(transmission), { TS_TRANSMISSION_SLAB }, 0, 0, transmission_names,
      "transmission: by a slab of the medium, or by the paper's sum of w exp(-d^2/(2 v)); Gaussians without a medium have no slab" },
    { "thickness", PELL_KNOB_ENUM, "1", AT(thickness), { TS_THICKNESS_FACES }, 0, 0, thickness_names,
      "path length d of transmitted light: by the steeper of the two faces, or as printed by the shadowed face" },
    { "fade", PELL_KNOB_ENUM, "1", AT(fade), { TS_FADE_OVERLAP }, 0, 0, fade_names,
      "correction for transmitted light that the blurs contain as well: subtract it, or fade over six widths as in the paper" },
    { "soften", PELL_KNOB_BOOL, "1", AT(soften), { 1 }, 0, 1, NULL, "blur transmitted light by a third of the widest blur's width" },
    { "lights", PELL_KNOB_ENUM, "1", AT(lights), { TS_LIGHTS_OWN }, 0, 0, lights_names,
      "irradiance used with the thickness along one light: that of this light, or of all lights as in the paper" },
    { "strength", PELL_KNOB_BOOL, "1", AT(strength), { 1 }, 0, 1, NULL, "scale the scattering radius by the material's strength map" },
    { "cull", PELL_KNOB_BOOL, "1", AT(cull), { 1 }, 0, 1, NULL,
      "skip invisible objects and, for objects of which less than a quarter is visible, texels that no pixel of the first view needs; only "
      "on engine cpu" },
    { "mix", PELL_KNOB_FLOAT, "1", AT(mix), { -1 }, -1, 1, NULL,
      "fraction of the colour that is applied before scattering, as an exponent; negative: the material's" },
    { 0 },
};
/* clang-format on */
#undef AT

static void paper(void *values)
{
    struct ts_knobs *k = values;

    k->as = TS_PAPER;
    k->size = TS_SIZE_MAX;
    k->kernel = TS_KERNEL_SEVEN;
    k->border = 0;
    k->first = TS_FIRST_UNBLURRED;
    k->tsm = TS_TSM_MAP;
    k->transmission = TS_TRANSMISSION_GAUSSIAN;
    k->thickness = TS_THICKNESS_PRINTED;
    k->fade = TS_FADE_LINEAR;
    k->soften = false;
    k->lights = TS_LIGHTS_SUM;
    k->strength = false;
    k->mix = 0.5f;
}

/* Figure 8: two separable bloom passes, whose strength the paper does not give. */
static void paper_settings(struct pell_settings *s)
{
    pell_paper_exit(s);
    s->bloom = 0.05f;
}

static void plan(const void *values, struct pell_plan *plan)
{
    const struct ts_knobs *k = values;

    *plan = (struct pell_plan) { .needs = PELL_NEED_SCENE | PELL_NEED_HIT,
                                 .quantity = PELL_QUANTITY_EXITANCE,
                                 .mix = k->mix,
                                 .local = true,
                                 .transmits = k->tsm != TS_TSM_OFF,
                                 .survives_light_change = true };
    if (k->first == TS_FIRST_UNBLURRED)
        plan->needs |= PELL_NEED_IRRADIANCE;
}

extern const struct pell_method pell_method_texture_space;
const struct pell_method pell_method_texture_space = {
    .kind = PELL_KIND_METHOD,
    .name = "texture-space",
    .title = "Diffusion in texture space with translucent shadow maps",
    .cite = "Eugene d'Eon, David Luebke and Eric Enderton, Efficient Rendering of Human Skin, Eurographics Symposium on Rendering, 2007",
    .limits = "Light travels along the surface, or straight through from a lit point; other transport in the solid is only approximated "
              "without detail. "
              "Transmission includes the first 16 lights; environments only with tsm = ray.",
    .knobs = knobs,
    .knobs_size = sizeof(struct ts_knobs),
    .paper = paper,
    .paper_settings = paper_settings,
    .plan = plan,
    .cpu = &pell_ts_cpu,
#ifdef PELL_HAVE_VULKAN
    .vulkan = &pell_ts_vulkan,
#endif
    .ignores = PELL_IGNORES_DEPTH_MAPS,
    .keeps_first = true,
};
