/* SPDX-License-Identifier: MIT
 *
 * curves.h - the names of the tone curves, for the knobs `tonemap` of images and of comparing.
 */
#ifndef PELL_RENDER_CURVES_H
#define PELL_RENDER_CURVES_H

#define PELL_CURVE_REINHARD "reinhard"
#define PELL_CURVE_LINEAR "linear"
#define PELL_CURVE_FILMIC "filmic"

#endif
