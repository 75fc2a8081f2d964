/* SPDX-License-Identifier: MIT
 *
 * screen_space.h - declarations shared by the files of this method. Its only external symbol is pell_method_screen_space.
 */
#ifndef PELL_SCREEN_SPACE_H
#define PELL_SCREEN_SPACE_H

#include <pellucid/method.h>

enum screen_as { SCREEN_BEST, SCREEN_PAPER };
enum screen_profile { SCREEN_PROFILE_MATERIAL, SCREEN_PROFILE_PUBLISHED };
enum screen_input { SCREEN_INPUT_DIFFUSE, SCREEN_INPUT_SHADED };
enum screen_first { SCREEN_FIRST_BLURRED, SCREEN_FIRST_UNBLURRED, SCREEN_FIRST_SKIN };
enum screen_edges { SCREEN_EDGES_SURFACE, SCREEN_EDGES_PAPER };
enum screen_slope { SCREEN_SLOPE_SURFACE, SCREEN_SLOPE_PAPER };
enum screen_kernel { SCREEN_KERNEL_GAUSSIANS, SCREEN_KERNEL_SEPARABLE };
enum screen_transmission { SCREEN_TRANSMISSION_OFF, SCREEN_TRANSMISSION_GAUSSIAN, SCREEN_TRANSMISSION_SLAB };

struct screen_knobs {
    int as; /* enum screen_as */
    int gaussians;
    int profile; /* enum screen_profile */
    int input;   /* enum screen_input */
    int first;   /* enum screen_first */
    int edges;   /* enum screen_edges */
    int slope;   /* enum screen_slope */
    float ssslevel;
    float correction, maxdd;
    float lod;
    int kernel; /* enum screen_kernel */
    int rank, taps;
    bool rotate;
    bool strength;
    int transmission; /* enum screen_transmission */
};

/* The paper's ssslevel for which a Gaussian's standard deviation on the screen equals its projection: span in pixels = ssslevel
 * sqrt(variance) / depth with the depth in object heights. `focal_px` as in struct pell_frame, `height_mm` the object's height. */
double pell_ss_level(double focal_px, double height_mm);

/* w'_i = w_i / Sum_{j <= i} w_j of section 7.3.3, for each channel; 1 where the sum is 0. */
void pell_ss_blend(const struct pell_gaussians *g, int i, float blend[3]);

/* --- profiles.c --- */

/* Normalises each channel's weights to 1. A channel without weights keeps its light in the narrowest Gaussian. */
void pell_ss_whiten(struct pell_gaussians *g);
/* The Gaussians of table 7.1 for the materials that they are fitted to: the three-layer skin of d'Eon et al. 2007, also as the six
 * Gaussians of their paper, and the marble of Jensen et al. 2001. NULL for all others. */
const struct pell_material_entry *pell_ss_published(const struct pell_frame_material *m);
/* Sum_i w_i exp(-d^2/(2 v_i)) of a channel of struct pell_gaussians at the thickness d, mm: a pell_thickness_fn. */
double pell_ss_transmission(const void *gaussians, int channel, double d);

extern const struct pell_method_engine pell_ss_cpu;
extern const struct pell_method_engine pell_ss_vulkan; /* only in builds with Vulkan */

#endif
