/* SPDX-License-Identifier: MIT
 *
 * screen_space.h - what the files of this method share. Its only symbol for others is pell_method_screen_space.
 */
#ifndef PELL_SCREEN_SPACE_H
#define PELL_SCREEN_SPACE_H

#include <pellucid/method.h>

enum ss_as { SS_BEST, SS_PAPER };
enum ss_profile { SS_PROFILE_MATERIAL, SS_PROFILE_PUBLISHED };
enum ss_input { SS_INPUT_DIFFUSE, SS_INPUT_LIT };
enum ss_first { SS_FIRST_BLURRED, SS_FIRST_UNBLURRED, SS_FIRST_SKIN };
enum ss_edges { SS_EDGES_SURFACE, SS_EDGES_PAPER };
enum ss_slope { SS_SLOPE_SURFACE, SS_SLOPE_PAPER };
enum ss_through { SS_THROUGH_OFF, SS_THROUGH_GAUSSIAN };

struct ss_knobs {
    int as;        /* enum ss_as */
    int gaussians;
    int profile;   /* enum ss_profile */
    int input;     /* enum ss_input */
    int first;     /* enum ss_first */
    int edges;     /* enum ss_edges */
    int slope;     /* enum ss_slope */
    float ssslevel;
    float correction, maxdd;
    float lod;
    bool strength;
    int through;   /* enum ss_through */
};

/* The paper's ssslevel for which a Gaussian's standard deviation on the screen is its projected one: span in pixels = ssslevel
 * sqrt(variance) / depth with the depth in object heights. `focal_px` as in struct pell_frame, `height_mm` the object's. */
double pell_ss_level(double focal_px, double height_mm);

/* w'_i = w_i / Sum_{j <= i} w_j of section 7.3.3, for each channel; 1 where the sum is 0. */
void pell_ss_blend(const struct pell_gaussians *g, int i, float blend[3]);

extern const struct pell_method_engine pell_ss_cpu;

#endif
