/* SPDX-License-Identifier: MIT
 *
 * oracle.h - reading the oracle's JSON results in tests. Numbers there are rounded to 10 digits. */
#ifndef PELL_TEST_ORACLE_H
#define PELL_TEST_ORACLE_H

#include "pell_test.h"

#include <pellucid/optics.h>

#include <jansson.h>

#define ROUNDED 1e-9 /* relative, for numbers with 10 digits */

/* The whole file; skips the test where it is absent. The caller frees it with json_decref. */
static inline json_t *oracle_load(const char *name)
{
    json_error_t error;
    json_t *root = json_load_file(shared_file(name), 0, &error);
    if (!root)
        fail_msg("%s:%d: %s", name, error.line, error.text);
    return root;
}

static inline json_t *oracle_get(json_t *object, const char *key)
{
    json_t *value = json_object_get(object, key);
    if (!value)
        fail_msg("the oracle has no \"%s\" here", key);
    return value;
}

static inline double oracle_number(json_t *object, const char *key)
{
    json_t *value = oracle_get(object, key);
    if (!json_is_number(value))
        fail_msg("\"%s\" is no number", key);
    return json_number_value(value);
}

static inline double oracle_at(json_t *object, const char *key, size_t index)
{
    json_t *value = json_array_get(oracle_get(object, key), index);
    if (!json_is_number(value))
        fail_msg("\"%s\"[%zu] is no number", key, index);
    return json_number_value(value);
}

#endif
