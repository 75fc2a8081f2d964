/* SPDX-License-Identifier: MIT
 * profile_table.c - radial profiles from comma-separated values: `r_mm,R,G,B`, or `r_mm,R` for all three channels. Empty lines and those
 * that begin with '#' are skipped. A line of names may come first: then columns are found by their names, whatever their order, and those
 * of other profiles (`tr_R`, `dipole_G`: a name, '_' and a channel) are skipped. */
#include "scene/file/profile_table.h"

#include <stdio.h>
#include <string.h>

enum { MAX_ROWS = 1 << 16, COLUMNS = 4, CELLS = 128, SKIP = -1 };
#define RADIUS_LAST_MIN 1e-6 /* mm; the shortest mean free path of a medium (PELL_SIGMA_MAX) */

static const char *const column_names[COLUMNS] = { "r_mm", "R", "G", "B" };
static const char *const skin_names[COLUMNS] = { "r_mm", "epidermis", "dermis", "skin" }; /* written by `profile --wavelength` */
#define ALLOWED "r_mm, R, G and B; NAME_R, NAME_G, NAME_B of other profiles are passed over"

struct table {
    struct pell_context *ctx;
    const char *path;
    const char *at, *end;
    int64_t line;         /* line number of `at`, counted from 1 */
    int columns;          /* columns of the profile that are present: 2 or 4 */
    int cells;            /* cells per line; 0: no line was read */
    int column_of[CELLS]; /* column of each cell of a line, or SKIP */
    size_t count, capacity;
    double (*rows)[COLUMNS];
    int64_t *lines; /* line number of each row */
    size_t lines_capacity;
};

static enum pell_result refuse(const struct table *t, int64_t line, const char *hint, const char *fmt, ...) PELL_PRINTF(4, 5);
static enum pell_result refuse(const struct table *t, int64_t line, const char *hint, const char *fmt, ...)
{
    struct pell_text where = { .length = 0 };
    char what[512], shown[256];
    va_list args;

    pell_text_add_path(&where, pell_printable(t->path, shown, sizeof(shown)), ":", "line ");
    pell_text_add(&where, "%lld", (long long) line);
    va_start(args, fmt);
    vsnprintf(what, sizeof(what), fmt, args);
    va_end(args);
    return pell_error(t->ctx, PELL_ERR_FORMAT, where.str, hint, "%s", what);
}

/* Trims blanks at both ends. */
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
        return refuse(t, t->line, "leave rows out where R is smooth", "is row %d of the table; %d rows are the most that is read",
                      MAX_ROWS + 1, MAX_ROWS);
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

/* The next cell of a line, without blanks, in *word; returns its size. *text is moved past the comma, or to NULL. */
static size_t next_cell(const char **text, const char *end, const char **word)
{
    const char *comma = memchr(*text, ',', (size_t) (end - *text));
    const size_t size = (size_t) ((comma ? comma : end) - *text);

    *word = *text;
    *text = comma ? comma + 1 : NULL;
    return trim(word, size);
}

/* The column of a name, SKIP for another profile's; COLUMNS if unknown. */
static int column_named(const char *word, size_t size)
{
    for (int k = 0; k < COLUMNS; k++)
        for (int other = 0; other < 2; other++) {
            const char *name = (other ? skin_names : column_names)[k];
            const size_t n = strlen(name);
            if (size == n && memcmp(word, name, n) == 0)
                return k;
            if (k > 0 && size > n + 1 && word[size - n - 1] == '_' && memcmp(word + size - n, name, n) == 0)
                return SKIP;
        }
    return COLUMNS;
}

static enum pell_result refuse_name(const struct table *t, const char *word, size_t size)
{
    static const char *const lengths[] = { "r_cm", "r_m", "r_um", "r_nm", "r_in" };
    char cell[40], shown[160];

    snprintf(cell, sizeof(cell), "%.*s", (int) (size < 30 ? size : 30), word);
    for (size_t i = 0; i < PELL_COUNT(lengths); i++)
        if (strcmp(cell, lengths[i]) == 0)
            return refuse(t, t->line, "write radii in mm and values in 1/mm^2, and call the column r_mm",
                          "the radii are \"%s\", must be r_mm", cell);
    return refuse(t, t->line, "columns are " ALLOWED, "there is no column \"%s\"", pell_printable(cell, shown, sizeof(shown)));
}

/* A line of names: every one must be known. */
static enum pell_result read_names(struct table *t, const char *text, size_t length)
{
    bool seen[COLUMNS] = { false };

    for (const char *end = text + length; text;) {
        const char *word;
        const size_t size = next_cell(&text, end, &word);
        const int column = column_named(word, size);

        if (t->cells == CELLS)
            return refuse(t, t->line, NULL, "has more than %d columns", CELLS);
        if (column == COLUMNS)
            return refuse_name(t, word, size);
        if (column >= 0 && seen[column])
            return refuse(t, t->line, NULL, "has two columns \"%.*s\"", (int) size, word);
        if (column >= 0)
            seen[column] = true;
        t->column_of[t->cells++] = column;
    }
    t->columns = seen[2] || seen[3] ? COLUMNS : 2;
    for (int k = 0; k < t->columns; k++)
        if (!seen[k])
            return refuse(t, t->line, "columns are " ALLOWED, "has no column \"%s\"", column_names[k]);
    return PELL_OK;
}

/* Without names: r_mm and one or three channels, in this order. */
static enum pell_result take_order(struct table *t, const char *text, size_t length)
{
    int n = 1;

    for (const char *c = text; c < text + length; c++)
        n += *c == ',';
    if (n > COLUMNS)
        return refuse(t, t->line, "r_mm,R,G,B, or a first line with the columns' names", "has more than %d columns", COLUMNS);
    if (n != 2 && n != COLUMNS)
        return refuse(t, t->line, "r_mm,R,G,B", "has %s, must be 4 (r_mm,R,G,B), or 2 (r_mm,R for all channels)",
                      pell_counted(n, "column", "columns").str);
    t->cells = t->columns = n;
    for (int k = 0; k < n; k++)
        t->column_of[k] = k;
    return PELL_OK;
}

/* Reads one line with content. */
static enum pell_result read_row(struct table *t, const char *text, size_t length)
{
    double row[COLUMNS] = { 0 };
    const char *const begin = text, *const end = text + length;
    int n = 0, cells = 1;

    if (!t->cells) {
        const char *word, *rest = text;
        const size_t size = next_cell(&rest, end, &word);
        if (!pell_parse_number(word, size, &row[0]))
            return read_names(t, begin, length);
        const enum pell_result res = take_order(t, begin, length);
        if (res != PELL_OK)
            return res;
    }
    for (const char *c = begin; c < end; c++)
        cells += *c == ',';
    if (cells != t->cells)
        return refuse(t, t->line, NULL, "has %s, the lines before have %d", pell_counted(cells, "column", "columns").str, t->cells);
    for (; text; n++) {
        const char *word;
        const size_t size = next_cell(&text, end, &word);
        const int column = t->column_of[n];
        if (column != SKIP && !pell_parse_number(word, size, &row[column])) {
            char cell[40], shown[160];
            snprintf(cell, sizeof(cell), "%.*s", (int) (size < 30 ? size : 30), word);
            return refuse(t, t->line, "decimal numbers with a point, and commas between them", "%s is \"%s\", which is no number",
                          column_names[column], pell_printable(cell, shown, sizeof(shown)));
        }
    }
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
        return refuse(t, t->line > 1 ? t->line - 1 : 1, "r_mm,R,G,B", "the table has %s of numbers, at least 2 are needed",
                      pell_counted((long long) t->count, "row", "rows").str);
    return res;
}

static enum pell_result make_channel(const struct table *t, int channel, double *r, double *R, struct pell_profile *out)
{
    const int column = t->columns == 2 ? 1 : 1 + channel;
    struct pell_profile_fault fault = { .field = "" };
    const char *name;

    for (size_t i = 0; i < t->count; i++) {
        r[i] = t->rows[i][0];
        R[i] = t->rows[i][column];
    }
    if (pell_profile_from_table(r, R, t->count, out, &fault) == PELL_OK)
        return PELL_OK;
    if (strcmp(fault.field, "total") == 0)
        return refuse(t, t->lines[0], "R(r) is in 1/mm^2 and r in mm: are both?",
                      "Int 2 pi r R dr of channel %s is %.6g, allowed: [%g, %g]; no more light can leave than came in",
                      column_names[column], fault.value, fault.min, fault.max);
    name = strcmp(fault.field, "R") == 0 ? column_names[column] : "r_mm";
    if (strcmp(name, "r_mm") == 0 && fault.row > 0 && fault.row < t->count && fault.value <= fault.max)
        return refuse(t, t->lines[fault.row], "radii rise from row to row",
                      "r_mm is %.12g, must be more than %.12g, that of the row before", fault.value, t->rows[fault.row - 1][0]);
    return refuse(t, t->lines[fault.row < t->count ? fault.row : 0], NULL, "%s is %.9g, allowed: [%.9g, %.9g]", name, fault.value,
                  fault.min, fault.max);
}

enum pell_result pell_profile_table_read(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                         struct pell_profile out[3])
{
    struct table t = { .ctx = ctx, .path = path, .at = (const char *) data, .end = (const char *) data + size };
    double *r = NULL, *R = NULL;
    enum pell_result res;

    memset(out, 0, 3 * sizeof(*out));
    PELL_TRY(read_rows(&t));
    if (t.rows[t.count - 1][0] < RADIUS_LAST_MIN && t.rows[t.count - 1][0] > t.rows[0][0]) {
        res = refuse(&t, t.lines[t.count - 1], "radii are in mm", "r_mm ends at %.9g, must reach %g or more", t.rows[t.count - 1][0],
                     RADIUS_LAST_MIN);
        goto fail;
    }
    r = pell_alloc_array(ctx, t.count, sizeof(*r));
    R = pell_alloc_array(ctx, t.count, sizeof(*R));
    if (!r || !R)
        res = PELL_ERR_NOMEM;
    for (int c = 0; c < 3 && res == PELL_OK; c++)
        res = make_channel(&t, c, r, R, &out[c]);
    if (res == PELL_OK && !(pell_profile_total(&out[0]) + pell_profile_total(&out[1]) + pell_profile_total(&out[2]) > 0.0))
        pell_warn(ctx, path, "R(r) is in 1/mm^2", "all values are 0: the material returns no light");

fail:
    if (res != PELL_OK)
        memset(out, 0, 3 * sizeof(*out));
    pell_free(ctx, r);
    pell_free(ctx, R);
    pell_free(ctx, t.rows);
    pell_free(ctx, t.lines);
    return res;
}
