/* SPDX-License-Identifier: MIT
 *
 * plot.h - plots of curves: axes with units, a legend, points with error bars; SVG, PDF or PNG by the name of the file.
 *
 * Ownership  everything is borrowed for the call.
 * Errors     logged with the path; PELL_ERR_INVALID for any other file extension.
 */
#ifndef PELL_PLOT_H
#define PELL_PLOT_H

#include "base/base.h"

/* Colours of a palette that colour-blind readers can distinguish (Okabe and Ito 2008). */
enum plot_color { PLOT_BLACK, PLOT_RED, PLOT_GREEN, PLOT_BLUE, PLOT_ORANGE, PLOT_PURPLE, PLOT_SKY, PLOT_GREY, PLOT_COLORS };

enum plot_line { PLOT_SOLID, PLOT_DASHED, PLOT_DOTTED, PLOT_DASH_DOT, PLOT_POINTS, PLOT_LINES };

struct plot_curve {
    const char *label;   /* NULL: no legend entry */
    const double *x, *y; /* not finite: the line breaks; <= 0 on a logarithmic axis: it leaves the plot at the bottom */
    const double *error; /* standard errors of y, drawn as bars; or NULL */
    const double *base;  /* the area between `base` and y is filled; or NULL */
    size_t count;
    enum plot_color color;
    enum plot_line line;
};

struct plot_axis {
    const char *label; /* with the unit */
    bool log;
    double min, max; /* min < max, and 0 < min if log */
    bool down;       /* y axis only: it grows downward */
};

struct plot_panel {
    const char *title; /* or NULL */
    struct plot_axis x, y;
    const struct plot_curve *curves;
    size_t num_curves;
    bool legend;
};

#define PLOT_ROWS 4
struct plot {
    const char *title, *caption;     /* "" if absent; lines end in '\n', longer ones are folded */
    double width, height;            /* in px; a PNG has twice as many along each side */
    int columns, rows;               /* rows <= PLOT_ROWS; panels of a column share their x axis */
    double row_fraction[PLOT_ROWS];  /* fraction of the height that each row gets */
    const struct plot_panel *panels; /* columns x rows, in row order */
};

/* True if the path ends in .svg, .pdf or .png. */
bool plot_can_write(const char *path);
PELL_NODISCARD enum pell_result plot_write(struct pell_context *ctx, const char *path, const struct plot *plot);

#endif
