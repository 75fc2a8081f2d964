/* SPDX-License-Identifier: MIT
 *
 * plot.c - plots, drawn by cairo. */
#include "cli/plot.h"

#include "base/file.h"

#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <fontconfig/fontconfig.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define FONT "DejaVu Sans"

enum { MAX_TICKS = 64, PNG_SCALE = 2 };
#define FAR_OUT 1e4 /* px, outside any page */
#define AREA_ALPHA 0.6
enum align { LEFT, CENTRE, RIGHT };

static const double palette[PLOT_COLORS][3] = {
    [PLOT_BLACK] = { 0.10, 0.10, 0.10 },  [PLOT_RED] = { 0.835, 0.369, 0.0 },    [PLOT_GREEN] = { 0.0, 0.620, 0.451 },
    [PLOT_BLUE] = { 0.0, 0.447, 0.698 },  [PLOT_ORANGE] = { 0.902, 0.624, 0.0 }, [PLOT_PURPLE] = { 0.8, 0.475, 0.655 },
    [PLOT_SKY] = { 0.337, 0.706, 0.914 }, [PLOT_GREY] = { 0.55, 0.55, 0.55 },
};

struct box {
    double x, y, w, h;
};

struct tick {
    double value;
    char text[24]; /* "": a small tick without a number */
};

/* --- Text --------------------------------------------------------------------------------------------------------------------- */

static void set_font(cairo_t *cr, double size, bool bold)
{
    cairo_select_font_face(cr, FONT, CAIRO_FONT_SLANT_NORMAL, bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(cr, size);
}

static double text_width(cairo_t *cr, const char *text)
{
    cairo_text_extents_t extents;
    cairo_text_extents(cr, text, &extents);
    return extents.x_advance;
}

static void draw_text(cairo_t *cr, double x, double y, enum align align, const char *text)
{
    cairo_move_to(cr, x - text_width(cr, text) * (align == LEFT ? 0.0 : align == CENTRE ? 0.5 : 1.0), y);
    cairo_show_text(cr, text);
}

/* Breaks lines of `text` that are wider than `width`: after a middle dot if there is one, else at a space. */
static void fold(cairo_t *cr, const char *text, double width, struct pell_text *out)
{
    static const char dot[] = " \u00b7 ";
    struct pell_text line = { .length = 0 };

    *out = (struct pell_text) { .length = 0 };
    while (*text) {
        const size_t rest = strcspn(text, "\n"), blank = strcspn(text, " \n");
        const char *next = strstr(text, dot);
        size_t n = next && next < text + rest ? (size_t) (next - text) : rest; /* words between dots stay together */
        char part[512];

        snprintf(part, sizeof(part), "%.*s", (int) n, text);
        if (text_width(cr, part) > width) {
            n = blank > 0 ? blank : 1; /* too wide even alone: break between words */
            snprintf(part, sizeof(part), "%.*s", (int) n, text);
        }
        const size_t before = line.length;
        pell_text_add(&line, "%s", part);
        if (before > 0 && text_width(cr, line.str) > width) {
            pell_text_add(out, "\n");
            line = (struct pell_text) { .length = 0 };
            while (*part && part[0] == ' ')
                memmove(part, part + 1, strlen(part));
            pell_text_add(&line, "%s", part);
        }
        pell_text_add(out, "%s", part);
        text += n;
        if (strncmp(text, dot, sizeof(dot) - 1) == 0) {
            pell_text_add(&line, "%s", dot);
            pell_text_add(out, "%s", dot);
            text += sizeof(dot) - 1;
        } else if (*text == '\n') {
            pell_text_add(out, "\n");
            line = (struct pell_text) { .length = 0 };
            text++;
        }
    }
}

/* Draws lines of `text` from y downward; returns the y of the next one. */
static double draw_lines(cairo_t *cr, double x, double y, double step, const char *text)
{
    char line[512];

    while (*text) {
        const size_t n = strcspn(text, "\n");
        snprintf(line, sizeof(line), "%.*s", (int) (n < sizeof(line) ? n : sizeof(line) - 1), text);
        draw_text(cr, x, y, LEFT, line);
        y += step;
        text += n + (text[n] == '\n');
    }
    return y;
}

static size_t count_lines(const char *text)
{
    size_t n = *text != '\0';
    for (; *text; text++)
        n += *text == '\n' && text[1];
    return n;
}

static void set_color(cairo_t *cr, enum plot_color color, double alpha)
{
    cairo_set_source_rgba(cr, palette[color][0], palette[color][1], palette[color][2], alpha);
}

/* --- Ticks -------------------------------------------------------------------------------------------------------------------- */

static void name_number(double value, char text[24])
{
    char plain[20];
    if (fabs(value) < 1e-12)
        value = 0.0;
    snprintf(plain, sizeof(plain), "%.6g", fabs(value));
    snprintf(text, 24, "%s%s", value < 0.0 ? "\u2212" : "", plain);
}

/* 10 to a power, in superscripts. */
static void name_power(int power, char text[24])
{
    static const char *const digits[] = {
        "\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074", "\u2075", "\u2076", "\u2077", "\u2078", "\u2079"
    };
    const int n = power < 0 ? -power : power;
    snprintf(text, 24, "10%s%s%s", power < 0 ? "\u207b" : "", n > 9 ? digits[n / 10 % 10] : "", digits[n % 10]);
}

static size_t log_ticks(const struct plot_axis *a, struct tick ticks[MAX_TICKS])
{
    const int first = (int) floor(log10(a->min) + 1e-9), last = (int) ceil(log10(a->max) - 1e-9), decades = last - first;
    const int step = decades > 14 ? 4 : decades > 7 ? 2 : 1;
    const bool plain = first >= -3 && last <= 4;
    size_t n = 0;

    for (int d = first; d <= last; d++)
        for (int m = 1; m <= (decades > 7 ? 1 : 9) && n < MAX_TICKS; m++) {
            const double v = m * pow(10.0, d);
            struct tick *t = &ticks[n];
            if (v < a->min * (1.0 - 1e-9) || v > a->max * (1.0 + 1e-9))
                continue;
            *t = (struct tick) { .value = v };
            n++;
            if (m == 1 && (d - first) % step == 0 && plain)
                name_number(v, t->text);
            else if (m == 1 && (d - first) % step == 0)
                name_power(d, t->text);
            else if (decades <= 2 && (m == 2 || m == 5))
                name_number(v, t->text);
        }
    return n;
}

static size_t ticks_of_step(const struct plot_axis *a, double step, struct tick ticks[MAX_TICKS])
{
    size_t n = 0;

    for (double v = ceil(a->min / step - 1e-9) * step; v <= a->max + 1e-9 * step && n < MAX_TICKS; v += step) {
        ticks[n].value = v;
        name_number(v, ticks[n].text);
        n++;
    }
    return n;
}

/* Tick steps of 1, 2 or 5 times a power of ten, about one in 55 px, but three ticks at least. */
static size_t linear_ticks(const struct plot_axis *a, double length, struct tick ticks[MAX_TICKS])
{
    static const double steps[] = { 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1 };
    const double rough = (a->max - a->min) / fmax(4.0, length / 55.0), power = pow(10.0, floor(log10(rough)));
    size_t k = 0, n;

    while (k < 3 && steps[k + 1] * power >= rough)
        k++;
    do
        n = ticks_of_step(a, steps[k] * power, ticks);
    while (n < 3 && ++k < PELL_COUNT(steps));
    return n;
}

static size_t make_ticks(const struct plot_axis *a, double length, struct tick ticks[MAX_TICKS])
{
    return a->log ? log_ticks(a, ticks) : linear_ticks(a, length, ticks);
}

/* Position of a value on an axis, 0 at its minimum, 1 at its maximum; not finite if the axis can't show it. */
static double axis_position(const struct plot_axis *a, double value)
{
    if (!a->log)
        return (value - a->min) / (a->max - a->min);
    return value > 0.0 ? log(value / a->min) / log(a->max / a->min) : (double) NAN;
}

static double x_of(const struct box *b, const struct plot_panel *p, double value)
{
    return b->x + b->w * axis_position(&p->x, value);
}

static double y_of(const struct box *b, const struct plot_panel *p, double value)
{
    const double position = axis_position(&p->y, value);
    return b->y + b->h * (p->y.down ? position : 1.0 - position);
}

/* --- A panel ------------------------------------------------------------------------------------------------------------------ */

static void draw_frame(cairo_t *cr, const struct box *b, const struct plot_panel *p, bool x_labels)
{
    struct tick ticks[MAX_TICKS];
    size_t n = make_ticks(&p->x, b->w, ticks);

    cairo_set_line_width(cr, 0.75);
    set_font(cr, 11.5, false);
    for (size_t i = 0; i < n; i++) {
        const double x = x_of(b, p, ticks[i].value);
        set_color(cr, PLOT_GREY, ticks[i].text[0] ? 0.35 : 0.13);
        cairo_move_to(cr, x, b->y);
        cairo_line_to(cr, x, b->y + b->h);
        cairo_stroke(cr);
        set_color(cr, PLOT_BLACK, 1.0);
        if (x_labels)
            draw_text(cr, x, b->y + b->h + 17.0, CENTRE, ticks[i].text);
    }
    n = make_ticks(&p->y, b->h, ticks);
    for (size_t i = 0; i < n; i++) {
        const double y = y_of(b, p, ticks[i].value);
        set_color(cr, PLOT_GREY, ticks[i].text[0] ? 0.35 : 0.13);
        cairo_move_to(cr, b->x, y);
        cairo_line_to(cr, b->x + b->w, y);
        cairo_stroke(cr);
        set_color(cr, PLOT_BLACK, 1.0);
        draw_text(cr, b->x - 7.0, y + 4.0, RIGHT, ticks[i].text);
    }
    set_color(cr, PLOT_BLACK, 1.0);
    cairo_set_line_width(cr, 1.0);
    cairo_rectangle(cr, b->x, b->y, b->w, b->h);
    cairo_stroke(cr);
    set_font(cr, 12.5, true);
    if (p->title)
        draw_text(cr, b->x + 0.5 * b->w, b->y - 8.0, CENTRE, p->title);
    set_font(cr, 12.5, false);
    if (x_labels)
        draw_text(cr, b->x + 0.5 * b->w, b->y + b->h + 37.0, CENTRE, p->x.label);
}

static void set_line(cairo_t *cr, enum plot_line line)
{
    static const double dashes[PLOT_LINES][4] = {
        [PLOT_DASHED] = { 8, 4, 8, 4 }, [PLOT_DOTTED] = { 1.5, 3.5, 1.5, 3.5 }, [PLOT_DASH_DOT] = { 9, 3.5, 1.5, 3.5 }
    };
    cairo_set_line_width(cr, line == PLOT_DOTTED ? 2.2 : 1.8);
    cairo_set_line_join(cr, CAIRO_LINE_JOIN_ROUND);
    cairo_set_dash(cr, dashes[line], line == PLOT_SOLID || line == PLOT_POINTS ? 0 : 4, 0.0);
}

static void draw_mark(cairo_t *cr, double x, double y, enum plot_color color)
{
    cairo_new_sub_path(cr);
    cairo_arc(cr, x, y, 3.0, 0.0, 2.0 * acos(-1.0));
    cairo_set_source_rgb(cr, 1.0, 1.0, 1.0);
    cairo_fill_preserve(cr);
    set_color(cr, color, 1.0);
    cairo_stroke(cr);
}

static void draw_points(cairo_t *cr, const struct box *b, const struct plot_panel *p, const struct plot_curve *c)
{
    cairo_set_line_width(cr, 1.2);
    cairo_set_dash(cr, NULL, 0, 0.0);
    for (size_t i = 0; i < c->count; i++) {
        const double x = x_of(b, p, c->x[i]), y = y_of(b, p, c->y[i]);
        if (!isfinite(x) || !isfinite(y))
            continue;
        if (c->error && isfinite(c->error[i]) && c->error[i] > 0.0) {
            const double top = y_of(b, p, c->y[i] + c->error[i]), low = y_of(b, p, c->y[i] - c->error[i]);
            const double bottom = isfinite(low) ? low : b->y + b->h;
            set_color(cr, c->color, 1.0);
            cairo_move_to(cr, x, top);
            cairo_line_to(cr, x, bottom);
            cairo_move_to(cr, x - 3.0, top);
            cairo_line_to(cr, x + 3.0, top);
            cairo_move_to(cr, x - 3.0, bottom);
            cairo_line_to(cr, x + 3.0, bottom);
            cairo_stroke(cr);
        }
        draw_mark(cr, x, y, c->color);
    }
}

/* Fills the pieces of the area between y and its base where both are finite. */
static void draw_area(cairo_t *cr, const struct box *b, const struct plot_panel *p, const struct plot_curve *c)
{
    set_color(cr, c->color, AREA_ALPHA);
    for (size_t i = 0; i < c->count; i++) {
        const size_t first = i;
        while (i < c->count && isfinite(c->x[i]) && isfinite(c->y[i]) && isfinite(c->base[i])) {
            cairo_line_to(cr, x_of(b, p, c->x[i]), y_of(b, p, c->y[i]));
            i++;
        }
        for (size_t k = i; k > first; k--)
            cairo_line_to(cr, x_of(b, p, c->x[k - 1]), y_of(b, p, c->base[k - 1]));
        cairo_close_path(cr);
        cairo_fill(cr);
    }
}

static void draw_curve(cairo_t *cr, const struct box *b, const struct plot_panel *p, const struct plot_curve *c)
{
    bool down = false; /* the pen is down */

    if (c->line == PLOT_POINTS) {
        draw_points(cr, b, p, c);
        return;
    }
    if (c->base)
        draw_area(cr, b, p, c);
    set_line(cr, c->line);
    set_color(cr, c->color, 1.0);
    for (size_t i = 0; i < c->count; i++) {
        const bool under = p->y.log && c->y[i] <= 0.0; /* at minus infinity: the line leaves through the edge of the axis */
        const double x = x_of(b, p, c->x[i]), y = under ? FAR_OUT : fmin(fmax(y_of(b, p, c->y[i]), -FAR_OUT), FAR_OUT);
        const bool visible = isfinite(x) && isfinite(c->y[i]);
        if (visible && down)
            cairo_line_to(cr, x, y);
        else if (visible)
            cairo_move_to(cr, x, y);
        down = visible;
    }
    cairo_stroke(cr);
    cairo_set_dash(cr, NULL, 0, 0.0);
}

/* How many samples of the curves lie in a box or close to it. */
static size_t samples_inside(const struct box *b, const struct plot_panel *p, const struct box *at)
{
    size_t n = 0;

    for (size_t k = 0; k < p->num_curves; k++)
        for (size_t i = 0; i < p->curves[k].count; i++) {
            const double x = x_of(b, p, p->curves[k].x[i]), y = y_of(b, p, p->curves[k].y[i]);
            n += x > at->x - 4.0 && x < at->x + at->w + 4.0 && y > at->y - 4.0 && y < at->y + at->h + 4.0;
        }
    return n;
}

static void draw_legend(cairo_t *cr, const struct box *b, const struct plot_panel *p)
{
    const double step = 17.0, sample = 30.0, margin = 8.0;
    struct box best = { 0 };
    double width = 0.0, y;
    size_t rows = 0, least = SIZE_MAX;

    set_font(cr, 11.5, false);
    for (size_t k = 0; k < p->num_curves; k++)
        if (p->curves[k].label) {
            width = fmax(width, text_width(cr, p->curves[k].label));
            rows++;
        }
    if (rows == 0)
        return;
    width += sample + 3.0 * margin;
    /* The corner that the curves cross least; the lower left first, where a falling curve leaves room. */
    for (int corner = 0; corner < 4; corner++) {
        const double h = (double) rows * step + margin;
        const struct box at = { corner & 1 ? b->x + b->w - width - 10.0 : b->x + 10.0, corner & 2 ? b->y + 10.0 : b->y + b->h - h - 10.0,
                                width, h };
        const size_t n = samples_inside(b, p, &at);
        if (n < least) {
            least = n;
            best = at;
        }
    }
    cairo_rectangle(cr, best.x, best.y, best.w, best.h);
    cairo_set_source_rgba(cr, 1.0, 1.0, 1.0, 0.88);
    cairo_fill_preserve(cr);
    cairo_set_line_width(cr, 0.75);
    set_color(cr, PLOT_GREY, 0.6);
    cairo_stroke(cr);
    y = best.y + 0.5 * margin + 0.5 * step;
    for (size_t k = 0; k < p->num_curves; k++) {
        const struct plot_curve *c = &p->curves[k];
        if (!c->label)
            continue;
        if (c->base) {
            set_color(cr, c->color, AREA_ALPHA);
            cairo_rectangle(cr, best.x + margin, y - 5.0, sample, 10.0);
            cairo_fill(cr);
        } else if (c->line == PLOT_POINTS) {
            cairo_set_line_width(cr, 1.2);
            draw_mark(cr, best.x + margin + 0.5 * sample, y, c->color);
        } else {
            set_line(cr, c->line);
            set_color(cr, c->color, 1.0);
            cairo_move_to(cr, best.x + margin, y);
            cairo_line_to(cr, best.x + margin + sample, y);
            cairo_stroke(cr);
            cairo_set_dash(cr, NULL, 0, 0.0);
        }
        set_color(cr, PLOT_BLACK, 1.0);
        draw_text(cr, best.x + 2.0 * margin + sample, y + 4.0, LEFT, c->label);
        y += step;
    }
}

static void draw_panel(cairo_t *cr, const struct box *b, const struct plot_panel *p, bool x_labels)
{
    draw_frame(cr, b, p, x_labels);
    cairo_save(cr);
    cairo_rectangle(cr, b->x, b->y, b->w, b->h);
    cairo_clip(cr);
    for (size_t k = 0; k < p->num_curves; k++)
        draw_curve(cr, b, p, &p->curves[k]);
    if (p->legend)
        draw_legend(cr, b, p);
    cairo_restore(cr);
}

/* --- The page ----------------------------------------------------------------------------------------------------------------- */

/* Width of the widest number on a column's y axes. */
static double number_room(cairo_t *cr, const struct plot *plot, int column, double height)
{
    struct tick ticks[MAX_TICKS];
    double widest = 0.0;

    set_font(cr, 11.5, false);
    for (int row = 0; row < plot->rows; row++) {
        const size_t n = make_ticks(&plot->panels[row * plot->columns + column].y, height * plot->row_fraction[row], ticks);
        for (size_t i = 0; i < n; i++)
            widest = fmax(widest, text_width(cr, ticks[i].text));
    }
    return widest;
}

static void draw_plot(cairo_t *cr, const struct plot *plot)
{
    struct pell_text heading, caption;
    set_font(cr, 14.5, true);
    fold(cr, plot->title, plot->width - 36.0, &heading);
    set_font(cr, 10.5, false);
    fold(cr, plot->caption, plot->width - 36.0, &caption);
    const double lines = 19.0 * (double) count_lines(heading.str), notes = 15.0 * (double) count_lines(caption.str);
    const bool titles = plot->panels[0].title != NULL;
    const double top = 14.0 + lines + (titles ? 22.0 : 8.0), bottom = plot->height - 46.0 - (notes > 0.0 ? notes + 8.0 : 0.0), gap = 16.0;
    const double height = bottom - top - gap * (plot->rows - 1), column = (plot->width - 12.0) / plot->columns;

    cairo_set_source_rgb(cr, 1.0, 1.0, 1.0);
    cairo_paint(cr);
    set_color(cr, PLOT_BLACK, 1.0);
    set_font(cr, 14.5, true);
    draw_lines(cr, 18.0, 25.0, 19.0, heading.str);
    set_font(cr, 10.5, false);
    cairo_set_source_rgb(cr, 0.35, 0.35, 0.35);
    draw_lines(cr, 18.0, plot->height - notes + 1.0, 15.0, caption.str);
    for (int c = 0; c < plot->columns; c++) {
        const double room = number_room(cr, plot, c, height);
        double y = top;
        for (int r = 0; r < plot->rows; r++) {
            const struct plot_panel *p = &plot->panels[r * plot->columns + c];
            const double left = room + 16.0 + (p->y.label[0] ? 22.0 : 4.0);
            const struct box b = { column * c + left, y, column - left - 10.0, height * plot->row_fraction[r] };

            draw_panel(cr, &b, p, r == plot->rows - 1);
            cairo_save(cr);
            cairo_translate(cr, b.x - room - 18.0, b.y + 0.5 * b.h);
            cairo_rotate(cr, -0.5 * acos(-1.0));
            set_font(cr, 12.5, false);
            set_color(cr, PLOT_BLACK, 1.0);
            draw_text(cr, 0.0, 0.0, CENTRE, p->y.label);
            cairo_restore(cr);
            y += b.h + gap;
        }
    }
}

/* --- Files -------------------------------------------------------------------------------------------------------------------- */

struct bytes {
    struct pell_context *ctx;
    uint8_t *data;
    size_t size, capacity;
};

static cairo_status_t keep(void *user, const unsigned char *data, unsigned length)
{
    struct bytes *b = user;

    if (length > b->capacity - b->size) {
        const size_t wanted = b->capacity + b->capacity / 2 + length + 4096;
        uint8_t *grown = pell_realloc_array(b->ctx, b->data, wanted, 1);
        if (!grown)
            return CAIRO_STATUS_NO_MEMORY;
        b->data = grown;
        b->capacity = wanted;
    }
    memcpy(b->data + b->size, data, length);
    b->size += length;
    return CAIRO_STATUS_SUCCESS;
}

bool plot_can_write(const char *path)
{
    return pell_path_has_extension(path, "svg") || pell_path_has_extension(path, "pdf") || pell_path_has_extension(path, "png");
}

enum pell_result plot_write(struct pell_context *ctx, const char *path, const struct plot *plot)
{
    const bool png = pell_path_has_extension(path, "png"), pdf = pell_path_has_extension(path, "pdf");
    struct bytes bytes = { .ctx = ctx };
    cairo_surface_t *surface;
    cairo_t *cr;
    cairo_status_t status;
    enum pell_result res;

    if (!plot_can_write(path))
        return pell_error(ctx, PELL_ERR_INVALID, path, NULL, "a plot must end in .svg, .pdf or .png");
    surface = png   ? cairo_image_surface_create(CAIRO_FORMAT_RGB24, (int) plot->width * PNG_SCALE, (int) plot->height * PNG_SCALE)
              : pdf ? cairo_pdf_surface_create_for_stream(keep, &bytes, plot->width, plot->height)
                    : cairo_svg_surface_create_for_stream(keep, &bytes, plot->width, plot->height);
    if (pdf) /* the same plot gives the same bytes */
        cairo_pdf_surface_set_metadata(surface, CAIRO_PDF_METADATA_CREATE_DATE, "2000-01-01T00:00:00Z");
    cr = cairo_create(surface);
    if (png)
        cairo_scale(cr, PNG_SCALE, PNG_SCALE);
    draw_plot(cr, plot);
    status = cairo_status(cr);
    cairo_destroy(cr);
    if (png && status == CAIRO_STATUS_SUCCESS)
        status = cairo_surface_write_to_png_stream(surface, keep, &bytes);
    cairo_surface_finish(surface);
    if (status == CAIRO_STATUS_SUCCESS)
        status = cairo_surface_status(surface);
    cairo_surface_destroy(surface);
    cairo_debug_reset_static_data(); /* frees fonts, which both libraries would keep until the process ends */
    FcFini();
    if (status == CAIRO_STATUS_SUCCESS)
        res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : pell_file_write(ctx, path, bytes.data, bytes.size);
    else if (status == CAIRO_STATUS_NO_MEMORY)
        res = PELL_ERR_NOMEM;
    else
        res = pell_error(ctx, PELL_ERR_IO, path, NULL, "can't be drawn: %s", cairo_status_to_string(status));
    pell_free(ctx, bytes.data);
    return res;
}
