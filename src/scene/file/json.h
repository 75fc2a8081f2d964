/* SPDX-License-Identifier: MIT
 *
 * json.h - reading untrusted JSON: typed getters with ranges, errors with a JSON pointer. A thin layer over jansson.
 *
 * A struct pell_json is a value and its path: a child points to its parent, which must outlive it (both live on the stack of the reader).
 * The JSON pointer ("/meshes/0/name") is put together only when a message needs it.
 *
 *     struct pell_json_file file = { .ctx = ctx, .path = "scene.json" };
 *     PELL_TRY(pell_json_parse(&file, data, size));
 *     const struct pell_json root = pell_json_root(&file);
 *     PELL_TRY(pell_json_only(&root, keys, PELL_COUNT(keys)));
 *     struct pell_json camera;
 *     PELL_TRY(pell_json_object(&root, "camera", &camera));
 *     if (camera.value)
 *         PELL_TRY(pell_json_number(&camera, "fov_deg", 1.0, 179.0, &fov));
 *     ...
 *     pell_json_finish(&file);
 *
 * Getters    take the parent and a key. A missing key is no error: the variable keeps its value (the default), a struct has
 *            .value == NULL. Call pell_json_require first if a key is mandatory.
 * Errors     PELL_ERR_FORMAT for text that is not JSON and for wrong types, PELL_ERR_INVALID for values out of range; logged with
 *            file, pointer, value and the allowed values. Numbers are always finite (the parser refuses 1e999).
 */
#ifndef PELL_JSON_H
#define PELL_JSON_H

#include "base/base.h"

#include <jansson.h>

struct pell_json_file {
    struct pell_context *ctx;
    const char *path;             /* for messages */
    enum pell_result range_error; /* code for a value out of range; 0: PELL_ERR_INVALID */
    json_t *root;                 /* owned; set by pell_json_parse */
};

struct pell_json {
    const struct pell_json_file *file;
    const struct pell_json *parent; /* NULL: the root */
    const char *key;                /* NULL: an element of an array */
    size_t index;
    const json_t *value; /* NULL: absent */
};

/* Refuses what is not JSON (with line and column), duplicate keys, nesting deeper than limits.depth, and texts whose tree would pass
 * the memory limit. A UTF-8 byte order mark is skipped. */
PELL_NODISCARD enum pell_result pell_json_parse(struct pell_json_file *file, const void *data, size_t size);
void pell_json_finish(struct pell_json_file *file);

struct pell_json pell_json_root(const struct pell_json_file *file);
/* any type; NULL value if absent or the parent is no object */
struct pell_json pell_json_get(const struct pell_json *parent, const char *key);
struct pell_json pell_json_at(const struct pell_json *parent, size_t index); /* NULL value past the end or if it is no array */
size_t pell_json_count(const struct pell_json *array);                       /* 0 if it is no array */

/* Writes "file.json:/meshes/0/name" (pointer escapes ~0 ~1, long ones cut at the front) into `text` and returns text->str. */
const char *pell_json_where(const struct pell_json *at, struct pell_text *text);
/* A short printable form of a value ("-2", "\"abc...\"", "an array of 3", "nothing"); returns `buffer`. */
const char *pell_json_value(const struct pell_json *at, char *buffer, size_t size);

/* pell_error and pell_warn with the JSON pointer. */
enum pell_result pell_json_error(const struct pell_json *at, enum pell_result code, const char *hint, const char *fmt, ...)
    PELL_PRINTF(4, 5);
void pell_json_warn(const struct pell_json *at, const char *hint, const char *fmt, ...) PELL_PRINTF(3, 4);

/* --- Checks ----------------------------------------------------------------------------------------------------------------- */

/* PELL_ERR_FORMAT: reports the value, and the allowed type ("an object"). */
enum pell_result pell_json_wrong_type(const struct pell_json *at, const char *allowed);
/* PELL_ERR_FORMAT unless the value is an object. */
PELL_NODISCARD enum pell_result pell_json_is_object(const struct pell_json *at);
/* PELL_ERR_FORMAT unless the object has the key. */
PELL_NODISCARD enum pell_result pell_json_require(const struct pell_json *parent, const char *key);
/* PELL_ERR_INVALID for the first key of the object that is not among `keys`, with the nearest one as hint. */
PELL_NODISCARD enum pell_result pell_json_only(const struct pell_json *at, const char *const *keys, size_t count);

/* --- Getters: of a key of an object ----------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result pell_json_object(const struct pell_json *parent, const char *key, struct pell_json *out);
/* An array of min..max elements. */
PELL_NODISCARD enum pell_result pell_json_array(const struct pell_json *parent, const char *key, size_t min, size_t max,
                                                struct pell_json *out);
PELL_NODISCARD enum pell_result pell_json_number(const struct pell_json *parent, const char *key, double min, double max, double *out);
PELL_NODISCARD enum pell_result pell_json_float(const struct pell_json *parent, const char *key, double min, double max, float *out);
/* An integer; 3.0 counts as one. */
PELL_NODISCARD enum pell_result pell_json_int(const struct pell_json *parent, const char *key, int64_t min, int64_t max, int64_t *out);
PELL_NODISCARD enum pell_result pell_json_bool(const struct pell_json *parent, const char *key, bool *out);
/* Borrowed from the tree: valid until pell_json_finish. Valid UTF-8 without NUL. */
PELL_NODISCARD enum pell_result pell_json_string(const struct pell_json *parent, const char *key, const char **out);
/* Exactly `count` numbers. */
PELL_NODISCARD enum pell_result pell_json_numbers(const struct pell_json *parent, const char *key, size_t count, double min, double max,
                                                  double *out);
PELL_NODISCARD enum pell_result pell_json_floats(const struct pell_json *parent, const char *key, size_t count, double min, double max,
                                                 float *out);
/* One of `names` -> its index; PELL_ERR_INVALID with the nearest name and the list otherwise. */
PELL_NODISCARD enum pell_result pell_json_choice(const struct pell_json *parent, const char *key, const char *const *names, size_t count,
                                                 int *out);

/* --- The same for a value (elements of arrays, values of more than one type) ------------------------------------------------ */

PELL_NODISCARD enum pell_result pell_json_to_number(const struct pell_json *at, double min, double max, double *out);
PELL_NODISCARD enum pell_result pell_json_to_int(const struct pell_json *at, int64_t min, int64_t max, int64_t *out);
PELL_NODISCARD enum pell_result pell_json_to_string(const struct pell_json *at, const char **out);
PELL_NODISCARD enum pell_result pell_json_to_numbers(const struct pell_json *at, size_t count, double min, double max, double *out);

#endif
