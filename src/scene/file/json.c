/* SPDX-License-Identifier: MIT
 * json.c - JSON pointers, typed getters and errors over jansson; see json.h. */
#include "scene/file/json.h"

#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define TOO_MANY PELL_RAISE_LIMIT("items") ", or --limit nodes=N if these are nodes"

/* Approximate memory that jansson 2.14 allocates per value of each kind: enough to refuse a small file with a huge tree before it is
 * built. */
#define BYTES_PER_OBJECT 320
#define BYTES_PER_ARRAY 128
#define BYTES_PER_VALUE 48
#define BYTES_PER_KEY 96

/* Skips from an opening quote to the closing one. Uses memchr, as data URIs make strings of megabytes. */
static size_t skip_string(const char *text, size_t size, size_t open)
{
    const char *from = text + open + 1, *end = text + size, *quote;

    while ((quote = memchr(from, '"', (size_t) (end - from))) != NULL) {
        size_t slashes = 0;
        while (quote - (slashes + 1) >= from && *(quote - (slashes + 1)) == '\\')
            slashes++;
        if (slashes % 2 == 0)
            return (size_t) (quote - text);
        from = quote + 1;
    }
    return size;
}

/* Scans the text once, outside of strings, for nesting and the size of the tree. Text that is not JSON may pass; the parser refuses it. */
static enum pell_result scan(const struct pell_json_file *file, const char *text, size_t size)
{
    const struct pell_limits *limits = pell_context_limits(file->ctx);
    uint64_t bytes = size;
    int depth = 0, line = 1;

    for (size_t i = 0; i < size; i++) {
        const char c = text[i];
        switch (c) {
        case '"': i = skip_string(text, size, i); break;
        case '\n': line++; break;
        case '{':
        case '[':
            bytes += c == '{' ? BYTES_PER_OBJECT : BYTES_PER_ARRAY;
            if (++depth > limits->depth) {
                struct pell_text where = { 0 };
                pell_text_add_path(&where, file->path, ":", "line ");
                pell_text_add(&where, "%d", line);
                return pell_error(file->ctx, PELL_ERR_INVALID, where.str, PELL_RAISE_LIMIT("depth") ", if the file is meant to be so",
                                  "JSON is nested deeper than %d levels", limits->depth);
            }
            break;
        case '}':
        case ']': depth--; break;
        case ',': bytes += BYTES_PER_VALUE; break;
        case ':': bytes += BYTES_PER_KEY; break;
        default: break;
        }
    }
    if (bytes > (uint64_t) limits->memory_bytes)
        return pell_error(file->ctx, PELL_ERR_NOMEM, file->path, PELL_RAISE_LIMIT("memory-bytes") ", if the file is meant to be so",
                          "reading this JSON would take about %" PRIu64 " bytes of memory, allowed: %" PRId64, bytes, limits->memory_bytes);
    return PELL_OK;
}

enum pell_result pell_json_parse(struct pell_json_file *file, const void *data, size_t size)
{
    enum pell_result res;
    const char *text = data;
    json_error_t error;

    file->root = NULL;
    if (size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0) {
        text += 3;
        size -= 3;
    }
    if ((res = scan(file, text, size)) != PELL_OK)
        return res;
    file->root = json_loadb(text, size, JSON_REJECT_DUPLICATES | JSON_DECODE_ANY, &error);
    if (!file->root) {
        struct pell_text where = { 0 };
        char what[JSON_ERROR_TEXT_LENGTH];
        const enum json_error_code code = json_error_code(&error);
        const bool nul = code == json_error_null_character || code == json_error_null_byte_in_key;
        if (code == json_error_out_of_memory)
            return pell_error(file->ctx, PELL_ERR_NOMEM, file->path, NULL, "no memory for the JSON tree");
        pell_text_add_path(&where, file->path, ":", "line ");
        pell_text_add(&where, "%d:%d", error.line > 0 ? error.line : 1, error.column > 0 ? error.column : 1);
        return pell_error(file->ctx, PELL_ERR_FORMAT, where.str,
                          code == json_error_premature_end_of_input ? "the file may be cut off" : NULL, "not valid JSON: %s",
                          nul ? "a text holds \\u0000, which no text here may hold" : pell_printable(error.text, what, sizeof(what)));
    }
    return PELL_OK;
}

void pell_json_finish(struct pell_json_file *file)
{
    json_decref(file->root);
    file->root = NULL;
}

struct pell_json pell_json_root(const struct pell_json_file *file)
{
    return (struct pell_json) { .file = file, .value = file->root };
}

struct pell_json pell_json_get(const struct pell_json *parent, const char *key)
{
    return (struct pell_json) { parent->file, parent, key, 0, json_object_get(parent->value, key) };
}

struct pell_json pell_json_at(const struct pell_json *parent, size_t index)
{
    return (struct pell_json) { parent->file, parent, NULL, index, json_array_get(parent->value, index) };
}

size_t pell_json_count(const struct pell_json *array)
{
    return json_array_size(array->value);
}

const char *pell_json_where(const struct pell_json *at, struct pell_text *text)
{
    enum { LEVELS = 24 }; /* longer paths are cut at the front: the end is more specific */
    const struct pell_json *level[LEVELS];
    int count = 0;

    memset(text, 0, sizeof(*text));
    pell_text_add_path(text, at->file->path, ":", "");
    for (; at->parent && count < LEVELS; at = at->parent)
        level[count++] = at;
    if (count == 0)
        pell_text_add(text, "/");
    if (at->parent)
        pell_text_add(text, "...");
    while (count-- > 0) {
        char key[80];
        if (!level[count]->key) {
            pell_text_add(text, "/%zu", level[count]->index);
            continue;
        }
        pell_text_add(text, "/");
        for (const char *c = pell_printable(level[count]->key, key, sizeof(key)); *c; c++)
            if (*c == '~' || *c == '/')
                pell_text_add(text, *c == '~' ? "~0" : "~1");
            else
                pell_text_add(text, "%c", *c);
    }
    return text->str;
}

const char *pell_json_value(const struct pell_json *at, char *buffer, size_t size)
{
    const json_t *v = at->value;

    if (!v)
        snprintf(buffer, size, "nothing");
    else if (json_is_string(v)) {
        char text[64];
        snprintf(buffer, size, "\"%s\"", pell_printable(json_string_value(v), text, sizeof(text)));
    } else if (json_is_integer(v))
        snprintf(buffer, size, "%" JSON_INTEGER_FORMAT, json_integer_value(v));
    else if (json_is_real(v))
        snprintf(buffer, size, "%.9g", json_real_value(v));
    else if (json_is_array(v))
        snprintf(buffer, size, "an array of %zu", json_array_size(v));
    else if (json_is_object(v))
        snprintf(buffer, size, "an object");
    else
        snprintf(buffer, size, "%s", json_is_true(v) ? "true" : json_is_false(v) ? "false" : "null");
    return buffer;
}

enum pell_result pell_json_error(const struct pell_json *at, enum pell_result code, const char *hint, const char *fmt, ...)
{
    struct pell_text where;
    char what[1024];
    va_list args;

    va_start(args, fmt);
    vsnprintf(what, sizeof(what), fmt, args);
    va_end(args);
    return pell_error(at->file->ctx, code, pell_json_where(at, &where), hint, "%s", what);
}

void pell_json_warn(const struct pell_json *at, const char *hint, const char *fmt, ...)
{
    struct pell_text where;
    char what[1024];
    va_list args;

    va_start(args, fmt);
    vsnprintf(what, sizeof(what), fmt, args);
    va_end(args);
    pell_warn(at->file->ctx, pell_json_where(at, &where), hint, "%s", what);
}

/* --- Checks ----------------------------------------------------------------------------------------------------------------- */

enum pell_result pell_json_wrong_type(const struct pell_json *at, const char *allowed)
{
    char value[96];
    return pell_json_error(at, PELL_ERR_FORMAT, NULL, "is %s, allowed: %s", pell_json_value(at, value, sizeof(value)), allowed);
}

/* The code of errors of values. */
static enum pell_result range_code(const struct pell_json *at)
{
    return at->file->range_error ? at->file->range_error : PELL_ERR_INVALID;
}

static enum pell_result out_of_range(const struct pell_json *at, double min, double max)
{
    const enum pell_result code = range_code(at);
    char value[96];

    pell_json_value(at, value, sizeof(value));
    return min == max ? pell_json_error(at, code, NULL, "is %s, allowed: %.10g", value, min)
                      : pell_json_error(at, code, NULL, "is %s, allowed: [%.10g, %.10g]", value, min, max);
}

enum pell_result pell_json_is_object(const struct pell_json *at)
{
    return json_is_object(at->value) ? PELL_OK : pell_json_wrong_type(at, "an object");
}

enum pell_result pell_json_require(const struct pell_json *parent, const char *key)
{
    if (json_object_get(parent->value, key))
        return PELL_OK;
    return pell_json_error(parent, PELL_ERR_FORMAT, NULL, "has no \"%s\", which must be there", key);
}

enum pell_result pell_json_only(const struct pell_json *at, const char *const *keys, size_t count)
{
    void *iter;
    enum pell_result res = pell_json_is_object(at);

    /* jansson's iterators take a non-const object but don't change it */
    for (iter = res ? NULL : json_object_iter((json_t *) at->value); iter; iter = json_object_iter_next((json_t *) at->value, iter)) {
        const char *key = json_object_iter_key(iter);
        struct pell_json child;
        struct pell_text hint = { 0 };
        size_t i = 0;
        while (i < count && strcmp(key, keys[i]) != 0)
            i++;
        if (i < count)
            continue;
        child = pell_json_get(at, key);
        pell_text_suggest_or_list(&hint, "known keys: ", key, keys, count);
        return pell_json_error(&child, range_code(at), hint.str, "unknown key");
    }
    return res;
}

/* --- Values ----------------------------------------------------------------------------------------------------------------- */

enum pell_result pell_json_to_number(const struct pell_json *at, double min, double max, double *out)
{
    double x;
    if (!json_is_number(at->value))
        return pell_json_wrong_type(at, "a number");
    x = json_number_value(at->value);
    if (!(x >= min && x <= max))
        return out_of_range(at, min, max);
    *out = x;
    return PELL_OK;
}

enum pell_result pell_json_to_int(const struct pell_json *at, int64_t min, int64_t max, int64_t *out)
{
    int64_t x;
    if (json_is_integer(at->value)) {
        x = json_integer_value(at->value);
    } else if (json_is_real(at->value)) {
        const double real = json_real_value(at->value);
        if (real != floor(real))
            return pell_json_wrong_type(at, "a whole number");
        if (fabs(real) > 9007199254740992.0) /* 2^53: larger doubles do not represent every integer */
            return out_of_range(at, (double) min, (double) max);
        x = (int64_t) real;
    } else {
        return pell_json_wrong_type(at, "a whole number");
    }
    if (x < min || x > max)
        return out_of_range(at, (double) min, (double) max);
    *out = x;
    return PELL_OK;
}

enum pell_result pell_json_to_string(const struct pell_json *at, const char **out)
{
    if (!json_is_string(at->value))
        return pell_json_wrong_type(at, "a string");
    *out = json_string_value(at->value);
    return PELL_OK;
}

enum pell_result pell_json_to_numbers(const struct pell_json *at, size_t count, double min, double max, double *out)
{
    double x[16];

    if (!json_is_array(at->value) || json_array_size(at->value) != count || count > PELL_COUNT(x)) {
        char allowed[48];
        snprintf(allowed, sizeof(allowed), "an array of %zu numbers", count);
        return pell_json_wrong_type(at, allowed);
    }
    for (size_t i = 0; i < count; i++) {
        const struct pell_json element = pell_json_at(at, i);
        enum pell_result res = pell_json_to_number(&element, min, max, &x[i]);
        if (res != PELL_OK)
            return res;
    }
    memcpy(out, x, count * sizeof(*out));
    return PELL_OK;
}

/* --- Getters ---------------------------------------------------------------------------------------------------------------- */

enum pell_result pell_json_object(const struct pell_json *parent, const char *key, struct pell_json *out)
{
    *out = pell_json_get(parent, key);
    return out->value ? pell_json_is_object(out) : PELL_OK;
}

enum pell_result pell_json_array(const struct pell_json *parent, const char *key, size_t min, size_t max, struct pell_json *out)
{
    const bool limited = max >= (size_t) pell_context_limits(parent->file->ctx)->items;
    struct pell_text allowed = { .length = 0 };
    size_t count;

    *out = pell_json_get(parent, key);
    if (!out->value)
        return PELL_OK;
    if (!json_is_array(out->value))
        return pell_json_wrong_type(out, "an array");
    count = json_array_size(out->value);
    if (count >= min && count <= max)
        return PELL_OK;
    if (min == max)
        pell_text_add(&allowed, "%zu", min);
    else
        pell_text_add(&allowed, "%zu to %zu", min, max);
    return pell_json_error(out, range_code(out), limited ? TOO_MANY : NULL, "has %zu elements, allowed: %s", count, allowed.str);
}

enum pell_result pell_json_number(const struct pell_json *parent, const char *key, double min, double max, double *out)
{
    const struct pell_json at = pell_json_get(parent, key);
    return at.value ? pell_json_to_number(&at, min, max, out) : PELL_OK;
}

enum pell_result pell_json_float(const struct pell_json *parent, const char *key, double min, double max, float *out)
{
    double x = *out;
    enum pell_result res = pell_json_number(parent, key, fmax(min, -3.4028234e38), fmin(max, 3.4028234e38), &x);
    if (res == PELL_OK)
        *out = (float) x;
    return res;
}

enum pell_result pell_json_int(const struct pell_json *parent, const char *key, int64_t min, int64_t max, int64_t *out)
{
    const struct pell_json at = pell_json_get(parent, key);
    return at.value ? pell_json_to_int(&at, min, max, out) : PELL_OK;
}

enum pell_result pell_json_bool(const struct pell_json *parent, const char *key, bool *out)
{
    const struct pell_json at = pell_json_get(parent, key);
    if (!at.value)
        return PELL_OK;
    if (!json_is_boolean(at.value))
        return pell_json_wrong_type(&at, "true or false");
    *out = json_is_true(at.value);
    return PELL_OK;
}

enum pell_result pell_json_string(const struct pell_json *parent, const char *key, const char **out)
{
    const struct pell_json at = pell_json_get(parent, key);
    return at.value ? pell_json_to_string(&at, out) : PELL_OK;
}

enum pell_result pell_json_numbers(const struct pell_json *parent, const char *key, size_t count, double min, double max, double *out)
{
    const struct pell_json at = pell_json_get(parent, key);
    return at.value ? pell_json_to_numbers(&at, count, min, max, out) : PELL_OK;
}

enum pell_result pell_json_floats(const struct pell_json *parent, const char *key, size_t count, double min, double max, float *out)
{
    const struct pell_json at = pell_json_get(parent, key);
    double x[16];
    enum pell_result res;

    if (!at.value)
        return PELL_OK;
    res = pell_json_to_numbers(&at, count, fmax(min, -3.4028234e38), fmin(max, 3.4028234e38), x);
    for (size_t i = 0; res == PELL_OK && i < count; i++)
        out[i] = (float) x[i];
    return res;
}

enum pell_result pell_json_choice(const struct pell_json *parent, const char *key, const char *const *names, size_t count, int *out)
{
    const struct pell_json at = pell_json_get(parent, key);
    const char *text = "";
    char value[96];
    struct pell_text hint = { 0 }, list = { 0 };
    enum pell_result res;
    bool near;

    if (!at.value)
        return PELL_OK;
    if ((res = pell_json_to_string(&at, &text)) != PELL_OK)
        return res;
    for (size_t i = 0; i < count; i++) {
        if (strcmp(text, names[i]) == 0) {
            *out = (int) i;
            return PELL_OK;
        }
        pell_text_add(&list, "%s%s", i ? ", " : "", names[i]);
    }
    near = pell_text_suggest(&hint, "", text, names, count);
    return pell_json_error(&at, range_code(&at), near ? hint.str : NULL, "is %s, allowed: %s", pell_json_value(&at, value, sizeof(value)),
                           list.str);
}
