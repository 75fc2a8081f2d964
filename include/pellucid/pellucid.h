/* SPDX-License-Identifier: MIT
 *
 * pellucid/pellucid.h - all of the library. Each header also stands alone; docs/guide/library.md tells which to begin with.
 */
#ifndef PELLUCID_H
#define PELLUCID_H

#include <pellucid/common.h>
#include <pellucid/context.h>
#include <pellucid/device.h>
#include <pellucid/frame.h>
#include <pellucid/image.h>
#include <pellucid/knob.h>
#include <pellucid/method.h>
#include <pellucid/optics.h>
#include <pellucid/render.h>
#include <pellucid/scene.h>

#endif
