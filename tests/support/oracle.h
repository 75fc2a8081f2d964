/* SPDX-License-Identifier: MIT
 * oracle.h - reads the expected values of tests/expect, mainly those of tests/expect/oracle, and the project's data. */
#ifndef PELL_TEST_ORACLE_H
#define PELL_TEST_ORACLE_H

#include "pell_test.h"

#include <pellucid/optics.h>

#include <jansson.h>

#define ROUNDED 1e-9 /* relative: the oracle prints 10 digits */

/* A whole JSON file of the project, "data/materials/marble.json". The caller frees it with json_decref. */
static inline json_t *expect_load(const char *name)
{
    json_error_t error;
    json_t *root = json_load_file(project_file(name), 0, &error);
    if (!root)
        fail_msg("%s:%d: %s", name, error.line, error.text);
    return root;
}

/* A file of tests/expect/oracle, "dipole.json". The caller frees it with json_decref. */
static inline json_t *oracle_load(const char *file)
{
    char name[256];
    snprintf(name, sizeof(name), "tests/expect/oracle/%s", file);
    return expect_load(name);
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
