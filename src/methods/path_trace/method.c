/* SPDX-License-Identifier: MIT
 *
 * method.c - volumetric path tracing inside closed meshes: ground truth. Equations and sources: README.md.
 */
#include "methods/path_trace/path_trace.h"

#include <stddef.h>

static const char *const as_names[] = { "best", "paper", NULL };
static const char *const surface_names[] = { "lobe", "traced", NULL };
static const char *const normals_names[] = { "smooth", "flat", NULL };
static const char *const boundary_names[] = { "settings", "smooth", "rough", NULL };
static const char *const acceleration_names[] = { "none", "lanes", "grid", NULL };

#define AT(field) offsetof(struct pt_method_knobs, field)
/* clang-format off */
static const struct pell_knob knobs[] = {
    { "as", PELL_KNOB_ENUM, "1", AT(as), { PT_BEST }, 0, 0, as_names,
      "best: all sampling techniques; otherwise unidirectional path tracing, which hits lights at random or connects to them from rough "
      "surfaces" },
    { "samples", PELL_KNOB_INT, "1", AT(samples), { 0 }, 0, 1 << 30, NULL,
      "samples per pixel, rounded up to whole rounds of msaa; 0: until error or time-limit is reached, or 64 where neither is set" },
    { "error", PELL_KNOB_FLOAT, "1", AT(error), { 0 }, 0, 1, NULL,
      "stop when the image's relative error (root mean square over its pixels, of luminance) reaches this; 0: not used" },
    { "time-limit", PELL_KNOB_FLOAT, "s", AT(time_limit), { 0 }, 0, 1e8, NULL,
      "stop before the round of samples that would exceed it, but after at least one round (one sample per multisample); 0: no limit" },
    { "surface", PELL_KNOB_ENUM, "1", AT(surface), { PT_SURFACE_LOBE }, 0, 0, surface_names,
      "surface reflection: the specular lobe common to all methods, which reflects only lights, or traced like all other light" },
    { "normals", PELL_KNOB_ENUM, "1", AT(trace.normals), { PT_NORMALS_SMOOTH }, 0, 0, normals_names,
      "normals for refraction: interpolated from the vertices, or those of the triangles" },
    { "boundary", PELL_KNOB_ENUM, "1", AT(trace.boundary), { PT_BOUNDARY_SETTINGS }, 0, 0, boundary_names,
      "a smooth or rough dielectric, or the render setting of that name" },
    { "bounces", PELL_KNOB_INT, "1", AT(trace.bounces), { PT_BOUNCES_ALL }, PT_BOUNCES_ALL, 64, NULL,
      "how often light that leaves a surface enters the same or another surface again; 0: never; -1: any number of times" },
    { "reentry", PELL_KNOB_BOOL, "1", AT(reentry), { 1 }, 0, 1, NULL,
      "off: only direct light enters and a pixel shows only its first surface, as with bounces=0, whatever bounces is" },
    { "events", PELL_KNOB_INT, "1", AT(trace.events), { 65536 }, 1, 1 << 30, NULL,
      "maximum number of scattering events and surface hits of a path; the fraction of light lost is reported" },
    { "roulette", PELL_KNOB_FLOAT, "1", AT(trace.roulette), { 0.4 }, 1e-6, 1, NULL,
      "threshold for Russian roulette: relative weight of a path" },
    { "acceleration", PELL_KNOB_ENUM, "1", AT(trace.acceleration), { PT_ACCELERATION_GRID }, 0, 0, acceleration_names,
      "none: random walks one by one; lanes: many walks in SIMD lanes; grid: also a grid of distances to the surface, so that steps deep "
      "inside need no ray; the first two are bit-identical, a grid has different noise of the same magnitude" },
    { "connections", PELL_KNOB_BOOL, "1", AT(connections), { 1 }, 0, 1, NULL,
      "connect points in the medium to lights through the surface, and light paths to camera paths" },
    { "half", PELL_KNOB_INT, "1", AT(trace.half), { 0 }, 0, 2, NULL,
      "1, 2: two independent images, each with half of the work, as `compare` uses them to separate error and noise; 0: one image" },
    { 0 },
};
/* clang-format on */
#undef AT

/* Textbook path tracing: J. T. Kajiya 1986, H. E. Rushmeier 1988. */
static void paper(void *values)
{
    struct pt_method_knobs *k = values;

    k->as = PT_PAPER;
    k->trace.acceleration = PT_ACCELERATION_NONE;
    k->connections = false;
}

static void plan(const void *values, struct pell_plan *plan)
{
    const struct pt_method_knobs *k = values;

    *plan = (struct pell_plan) {
        .needs = PELL_NEED_POSITION | PELL_NEED_SCENE,
        .outputs = PELL_OUTPUT_SINGLE | (k->surface == PT_SURFACE_TRACED ? PELL_OUTPUT_SURFACE : 0u),
        .excludes_surface_reflection = k->surface == PT_SURFACE_LOBE,
        .quantity = PELL_QUANTITY_RADIANCE,
        .mix = -1.0f,
    };
}

extern const struct pell_method pell_method_path_trace;
const struct pell_method pell_method_path_trace = {
    .kind = PELL_KIND_REFERENCE,
    .name = "path-trace",
    .title = "Volumetric path tracing, ground truth",
    .cite = "Eric P. Lafortune and Yves D. Willems, Rendering Participating Media with Bidirectional Path Tracing, Eurographics Workshop "
            "on Rendering, 1996; Eric Veach, Robust Monte Carlo Methods for Light Transport Simulation, PhD thesis, Stanford University, "
            "1997",
    .limits = "Slow: the error falls with the square root of the time. Needs coefficients, not only a profile, and closed meshes; "
              "open ones are reported.",
    .knobs = knobs,
    .knobs_size = sizeof(struct pt_method_knobs),
    .paper = paper,
    .plan = plan,
    .cpu = &pell_path_trace_cpu,
    .ignores = PELL_IGNORES_STRENGTH_MAP | PELL_IGNORES_NORMAL_MAP | PELL_IGNORES_SPECULAR | PELL_IGNORES_PROFILE_MODEL,
    .partial = true,
};
