/* SPDX-License-Identifier: MIT
 *
 * pellucid/pellucid.h - all of the library. Each header also stands alone; docs/guide/library.md tells which to begin with.
 *
 * Binary interface: before 1.0 structs may grow and enums gain values with every minor version, so a program is recompiled for each; patch
 * versions fit each other. Within 1.x a program will run with every later library: structs that a caller fills will grow only where a
 * member of 0 means what was done before, and carry their size; values of enums and names of functions, knobs and layers stay.
 * pell_context_create refuses a library of another version with a message (pellucid/version.h).
 *
 * Units      lengths mm, coefficients 1/mm, colour linear Rec.709; pellucid/common.h has the rest.
 * Ownership  what a _create function gives, _destroy takes back; what a function fills, _finish empties; the rest is borrowed for the call.
 * Errors     enum pell_result; who detects an error logs it once, through the context.
 * Threads    objects belong to one thread at a time unless their header says more; there is no global state.
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

#endif
