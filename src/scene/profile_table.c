/* SPDX-License-Identifier: MIT
 * profile_table.c - radial profiles from comma-separated values: `r_mm,R,G,B`, or `r_mm,R` for all three channels. Empty lines and those
 * that begin with '#' are passed over; one line of names may come first. */
#include "scene/profile_table.h"

#include <stdio.h>
#include <string.h>

enum { MAX_ROWS = 1 << 16, COLUMNS = 4 };

static const char *const column_names[COLUMNS] = { "r_mm", "R", "G", "B" };

struct table {
    struct pell_context *ctx;
    const char *path;
    const char *at, *end;
    int64_t line; /* of `at`, counted from 1 */
    int columns;  /* 0: no row yet */
    bool named;   /* a line of names was there */
    size_t count, capacity;
    double (*rows)[COLUMNS];
    int64_t *lines; /* where each row stands */
    size_t lines_capacity;
};

static enum pell_result refuse(const struct table *t, int64_t line, const char *hint, const char *fmt, ...) PELL_PRINTF(4, 5);
static enum pell_result refuse(const struct table *t, int64_t line, const char *hint, const char *fmt, ...)
{
    struct pell_text where = { .length = 0 };
    char what[512], shown[256];
    va_list args;

    pell_text_add(&where, "%s:%lld", pell_printable(t->path, shown, sizeof(shown)), (long long) line);
    va_start(args, fmt);
    vsnprintf(what, sizeof(what), fmt, args);
    va_end(args);
    return pell_error(t->ctx, PELL_ERR_FORMAT, where.str, hint, "%s", what);
}

/* Without the blanks at either end. */
static size_t trim(const char **text, size_t length)
{
    while (length && (**text == ' ' || **text == '\t')) {
        (*text)++;
        length--;
    }
    while (length && ((*text)[length - 1] == ' ' || (*text)[length - 1] == '\t'))
        length--;
    return length;
}

static enum pell_result keep_row(struct table *t, const double row[COLUMNS])
{
    void *rows = t->rows, *lines = t->lines;
    enum pell_result res;

    if (t->count == MAX_ROWS)
        return refuse(t, t->line, NULL, "is row %d, allowed are %d", MAX_ROWS + 1, MAX_ROWS);
    res = pell_grow(t->ctx, &rows, t->count, &t->capacity, sizeof(*t->rows));
    t->rows = rows;
    if (res == PELL_OK)
        res = pell_grow(t->ctx, &lines, t->count, &t->lines_capacity, sizeof(*t->lines));
    t->lines = lines;
    if (res != PELL_OK)
        return res;
    memcpy(t->rows[t->count], row, sizeof(*t->rows));
    t->lines[t->count++] = t->line;
    return PELL_OK;
}

/* One line that holds something. */
static enum pell_result read_row(struct table *t, const char *text, size_t length)
{
    double row[COLUMNS] = { 0 };
    int n = 0;

    for (const char *end = text + length;; text++) {
        const char *comma = memchr(text, ',', (size_t) (end - text)), *word = text;
        const size_t size = trim(&word, (size_t) ((comma ? comma : end) - text));

        if (n == COLUMNS)
            return refuse(t, t->line, "r_mm,R,G,B", "has more than %d columns", COLUMNS);
        if (!pell_parse_number(word, size, &row[n])) {
            char cell[40], shown[160];
            if (n == 0 && t->count == 0 && !t->named) {
                t->named = true; /* a line of names; a table that is none is refused at its next line */
                return PELL_OK;
            }
            snprintf(cell, sizeof(cell), "%.*s", (int) (size < 30 ? size : 30), word);
            return refuse(t, t->line, "decimal numbers with a point, and commas between them", "%s is \"%s\", which is no number",
                          column_names[n], pell_printable(cell, shown, sizeof(shown)));
        }
        n++;
        if (!comma)
            break;
        text = comma;
    }
    if (n != 2 && n != COLUMNS)
        return refuse(t, t->line, "r_mm,R,G,B", "has %d column%s, must be 4 (r_mm,R,G,B), or 2 (r_mm,R for all channels)", n,
                      n == 1 ? "" : "s");
    if (t->columns && n != t->columns)
        return refuse(t, t->line, NULL, "has %d columns, the rows before have %d", n, t->columns);
    t->columns = n;
    return keep_row(t, row);
}

static enum pell_result read_rows(struct table *t)
{
    enum pell_result res = PELL_OK;

    if (t->end - t->at >= 3 && memcmp(t->at, "\xef\xbb\xbf", 3) == 0)
        t->at += 3;
    for (t->line = 1; t->at < t->end && res == PELL_OK; t->line++) {
        const char *stop = t->at, *text = t->at;
        size_t length;
        while (stop < t->end && *stop != '\n' && *stop != '\r')
            stop++;
        length = trim(&text, (size_t) (stop - t->at));
        if (length && *text != '#')
            res = read_row(t, text, length);
        if (res != PELL_OK)
            break;
        if (t->line % 4096 == 0 && pell_cancelled(t->ctx))
            return PELL_ERR_CANCELLED;
        t->at = stop + (t->end - stop >= 2 && stop[0] == '\r' && stop[1] == '\n' ? 2 : stop < t->end);
    }
    if (res == PELL_OK && t->count < 2)
        return refuse(t, t->line > 1 ? t->line - 1 : 1, "r_mm,R,G,B", "the table has %zu row%s of numbers, at least 2 are needed", t->count,
                      t->count == 1 ? "" : "s");
    return res;
}

static enum pell_result make_channel(const struct table *t, int channel, double *r, double *R, struct pell_profile *out)
{
    const int column = t->columns == 2 ? 1 : 1 + channel;
    struct pell_profile_fault fault = { .what = "" };
    const char *name;

    for (size_t i = 0; i < t->count; i++) {
        r[i] = t->rows[i][0];
        R[i] = t->rows[i][column];
    }
    if (pell_profile_from_table(r, R, t->count, out, &fault) == PELL_OK)
        return PELL_OK;
    if (strcmp(fault.what, "total") == 0)
        return refuse(t, t->lines[0], "R(r) is in 1/mm^2 and r in mm: are both?",
                      "Int 2 pi r R dr of channel %s is %.6g, allowed: [%g, %g]; no more light can leave than came in",
                      column_names[column], fault.value, fault.min, fault.max);
    name = strcmp(fault.what, "R") == 0 ? column_names[column] : "r_mm";
    return refuse(t, t->lines[fault.row < t->count ? fault.row : 0], strcmp(name, "r_mm") ? NULL : "radii rise from row to row",
                  "%s is %.9g, allowed: [%.9g, %.9g]", name, fault.value, fault.min, fault.max);
}

enum pell_result pell_profile_table_read(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                         struct pell_profile out[3])
{
    struct table t = { .ctx = ctx, .path = path, .at = (const char *) data, .end = (const char *) data + size };
    double *r = NULL, *R = NULL;
    enum pell_result res;

    memset(out, 0, 3 * sizeof(*out));
    PELL_TRY(read_rows(&t));
    r = pell_alloc_array(ctx, t.count, sizeof(*r));
    R = pell_alloc_array(ctx, t.count, sizeof(*R));
    if (!r || !R)
        res = PELL_ERR_NOMEM;
    for (int c = 0; c < 3 && res == PELL_OK; c++)
        res = make_channel(&t, c, r, R, &out[c]);

fail:
    if (res != PELL_OK)
        memset(out, 0, 3 * sizeof(*out));
    pell_free(ctx, r);
    pell_free(ctx, R);
    pell_free(ctx, t.rows);
    pell_free(ctx, t.lines);
    return res;
}
