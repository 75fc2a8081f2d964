/* SPDX-License-Identifier: MIT
 *
 * pellucid/knob.h - describes settings (knobs) by tables: one row per knob with its name, unit, range, default and help.
 *
 * The row is the only definition of these properties; the command line, the scene reader, the documentation and the tests read it.
 * A table is an array of rows that ends with {0}; the values are in a plain struct; each row has the offset of its field.
 *
 * Units      given in each row; lengths in mm, angles in degrees if the name says so.
 * Ownership  tables are constant; a values struct is the caller's memory, of the type that belongs to the table.
 * Errors     logged with the name, the value and what is allowed, and for an unknown name the nearest known one; values are then unchanged.
 * Threads    all functions are safe; a values struct belongs to one thread at a time.
 */
#ifndef PELLUCID_KNOB_H
#define PELLUCID_KNOB_H

#include <pellucid/common.h>

#ifdef __cplusplus
extern "C" {
#endif

struct pell_context;

enum pell_knob_type {
    PELL_KNOB_NONE = 0, /* ends a table */
    PELL_KNOB_BOOL,     /* field: bool; "on", "off", "true", "false", "yes", "no", "1", "0" */
    PELL_KNOB_INT,      /* field: int */
    PELL_KNOB_INT64,    /* field: int64_t; up to 2^53 */
    PELL_KNOB_FLOAT,    /* field: float */
    PELL_KNOB_ENUM,     /* field: int, index into `choices` */
    PELL_KNOB_RGB,      /* field: float[3]; "r,g,b" or one number for all */
};

struct pell_knob {
    const char *name; /* stable, [a-z0-9-]+ */
    enum pell_knob_type type;
    const char *unit;           /* "1" for a pure number, "mm", "px", ... */
    size_t offset;              /* of the field in the values struct */
    double def[3];              /* default; an enum's index; [1] and [2] only for RGB */
    double min, max;            /* inclusive; unused for BOOL and ENUM */
    const char *const *choices; /* NULL-terminated, ENUM only */
    const char *help;           /* one sentence without a full stop; explains 0 and special values */
};

/* Writes every default of `knobs` into `values`. */
PELL_API void pell_knobs_default(const struct pell_knob *knobs, void *values);

/* The row called `name`, or NULL. */
PELL_API const struct pell_knob *pell_knob_find(const struct pell_knob *knobs, const char *name);

/* Parses `text` and writes it into `values`. On failure `values` is untouched and a message with the value, the range allowed and
 * (for an unknown name) the nearest known name is logged; `owner` names the table in it ("method screen-space"); `where` names the origin
 * of the text ("--set", "scene.json:/render/knobs/lod"). Here and below `ctx` (no messages) and `where` may be NULL, and `values`
 * where the table is empty. PELL_ERR_INVALID. */
PELL_API PELL_NODISCARD enum pell_result pell_knob_set(struct pell_context *ctx, const struct pell_knob *knobs, const char *owner,
                                                       const char *where, void *values, const char *name, const char *text);

/* Sets a knob from a number: a bool takes 0 and 1, an enum the index of a choice, RGB the same number three times. PELL_ERR_INVALID for a
 * number that is out of range, not finite, or not whole where an integer is required. */
PELL_API PELL_NODISCARD enum pell_result pell_knob_set_number(struct pell_context *ctx, const struct pell_knob *knobs, const char *owner,
                                                              const char *where, void *values, const char *name, double number);

/* Sets an RGB knob; PELL_ERR_INVALID for a row of another type. */
PELL_API PELL_NODISCARD enum pell_result pell_knob_set_rgb(struct pell_context *ctx, const struct pell_knob *knobs, const char *owner,
                                                           const char *where, void *values, const char *name, const double rgb[3]);

/* Checks that every value is in its range and finite; logs and returns PELL_ERR_INVALID for the first that is not. */
PELL_API PELL_NODISCARD enum pell_result pell_knobs_check(struct pell_context *ctx, const struct pell_knob *knobs, const char *owner,
                                                          const void *values);

/* The value as text that pell_knob_set accepts; truncated to `size` bytes, always terminated. Returns `buffer`. */
PELL_API const char *pell_knob_format(const struct pell_knob *knob, const void *values, char *buffer, size_t size);

#ifdef __cplusplus
}
#endif
#endif
