/* SPDX-License-Identifier: MIT
 *
 * pellucid/optics.h - the optics tier: from optical coefficients to diffusion profiles, layers, sums of Gaussians, sampling and
 * materials. No scene, no files, no GPU, no global state.
 *
 * Units      mm, 1/mm, profiles 1/mm^2; eta = n_inside / n_outside. Channel 0, 1, 2 = R, G, B.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     functions that can fail return enum pell_result; nothing is logged here: the caller knows the names.
 * Threads    all functions are pure and safe.
 */
#ifndef PELLUCID_OPTICS_H
#define PELLUCID_OPTICS_H

#include <pellucid/gaussians.h>
#include <pellucid/inversion.h>
#include <pellucid/kernel.h>
#include <pellucid/layers.h>
#include <pellucid/material.h>
#include <pellucid/medium.h>
#include <pellucid/phase.h>
#include <pellucid/profile.h>
#include <pellucid/sampling.h>
#include <pellucid/skin.h>
#include <pellucid/spectrum.h>
#include <pellucid/specular.h>

#endif
