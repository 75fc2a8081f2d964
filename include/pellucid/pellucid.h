/* SPDX-License-Identifier: MIT
 *
 * pellucid/pellucid.h - all of the library. Each header can also be included alone; docs/guide/library.md is an introduction.
 *
 * Binary interface: before 1.0 structs may grow and enums gain values with every minor version, so a program is recompiled for each; patch
 * versions fit each other. Within 1.x a program will run with every later library: structs that a caller fills will have a size and grow
 * only by members whose value 0 keeps the former behaviour; values of enums and names of functions, knobs and layers stay.
 * pell_context_create refuses a library of another version with a message (pellucid/version.h).
 *
 * Units      lengths mm, coefficients 1/mm, colour linear Rec.709; pellucid/common.h has the rest.
 * Ownership  a _create function transfers an object to the caller, _destroy releases it; _finish releases the contents of a struct that a
 *            function filled; all other pointers are borrowed for the call.
 * Errors     enum pell_result; the function that detects an error logs it once, through the context.
 * Threads    objects belong to one thread at a time unless their header says otherwise; there is no global state.
 */
#ifndef PELLUCID_H
#define PELLUCID_H

#include <pellucid/common.h>
#include <pellucid/compare.h>
#include <pellucid/context.h>
#include <pellucid/device.h>
#include <pellucid/frame.h>
#include <pellucid/image.h>
#include <pellucid/knob.h>
#include <pellucid/method.h>
#include <pellucid/optics.h>
#include <pellucid/render.h>
#include <pellucid/scene.h>
#include <pellucid/version.h>
#include <pellucid/vulkan.h>

#endif
