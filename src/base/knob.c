/* SPDX-License-Identifier: MIT
 * knob.c - reads, checks and prints the values that tables of knobs describe. */
#include "base/base.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { LISTED = 256, SHOWN = 96 };
#define INT53 9007199254740992.0

static void *field(const struct pell_knob *knob, void *values)
{
    return (char *) values + knob->offset;
}

static const void *const_field(const struct pell_knob *knob, const void *values)
{
    return (const char *) values + knob->offset;
}

void pell_knobs_default(const struct pell_knob *knobs, void *values)
{
    for (const struct pell_knob *k = knobs; k->type; k++) {
        void *f = field(k, values);
        switch (k->type) {
        case PELL_KNOB_NONE: break;
        case PELL_KNOB_BOOL: *(bool *) f = k->def[0] != 0; break;
        case PELL_KNOB_INT:
        case PELL_KNOB_ENUM: *(int *) f = (int) k->def[0]; break;
        case PELL_KNOB_INT64: *(int64_t *) f = (int64_t) k->def[0]; break;
        case PELL_KNOB_FLOAT: *(float *) f = (float) k->def[0]; break;
        case PELL_KNOB_RGB:
            for (int i = 0; i < 3; i++)
                ((float *) f)[i] = (float) k->def[i];
            break;
        }
    }
}

const struct pell_knob *pell_knob_find(const struct pell_knob *knobs, const char *name)
{
    for (const struct pell_knob *k = knobs; k->type; k++)
        if (strcmp(k->name, name) == 0)
            return k;
    return NULL;
}

static enum pell_result unknown_knob(struct pell_context *ctx, const struct pell_knob *knobs, const char *owner, const char *where,
                                     const char *name)
{
    const char *names[LISTED] = { NULL };
    struct pell_text hint = { .length = 0 };
    char shown[SHOWN];
    size_t count = 0;

    for (const struct pell_knob *k = knobs; k->type && count < LISTED; k++)
        names[count++] = k->name;
    pell_text_suggest_or_list(&hint, "known: ", name, names, count);
    if (count == 0)
        pell_text_add(&hint, "there are none");
    return pell_error(ctx, PELL_ERR_INVALID, where, hint.str, "%s has no knob \"%s\"", owner, pell_printable(name, shown, sizeof(shown)));
}

static enum pell_result bad_choice(struct pell_context *ctx, const struct pell_knob *knob, const char *where, const char *text)
{
    struct pell_text list = { .length = 0 }, hint = { .length = 0 };
    char shown[SHOWN];
    size_t count = 0;
    bool near;

    for (; knob->choices[count]; count++)
        pell_text_add(&list, "%s%s", count ? ", " : "", knob->choices[count]);
    near = pell_text_suggest(&hint, "", text, knob->choices, count);
    return pell_error(ctx, PELL_ERR_INVALID, where, near ? hint.str : knob->help, "%s = %s, must be one of %s", knob->name,
                      pell_printable(text, shown, sizeof(shown)), list.str);
}

/* "gaussians = 12, must be in [1, 10]"; `must` is "" or "a number " where the type is wrong, too. */
static enum pell_result bad_value(struct pell_context *ctx, const struct pell_knob *knob, const char *where, const char *text,
                                  const char *must)
{
    const bool pure = !knob->unit || strcmp(knob->unit, "1") == 0;
    char shown[SHOWN], low[40], high[40];

    return pell_error(ctx, PELL_ERR_INVALID, where, knob->help, "%s = %s, must be %sin [%s, %s]%s%s", knob->name,
                      pell_printable(text, shown, sizeof(shown)), must, pell_format_number(knob->min, false, low, sizeof(low)),
                      pell_format_number(knob->max, false, high, sizeof(high)), pure ? "" : " ", pure ? "" : knob->unit);
}

static bool parse_bool(const char *text, bool *value)
{
    static const struct {
        const char *text;
        bool value;
    } words[] = { { "on", true },   { "true", true },   { "yes", true }, { "1", true },
                  { "off", false }, { "false", false }, { "no", false }, { "0", false } };

    for (size_t i = 0; i < PELL_COUNT(words); i++) {
        if (strcmp(text, words[i].text) == 0) {
            *value = words[i].value;
            return true;
        }
    }
    return false;
}

/* Integers may be written as any number with an integral value: "1e6". */
static bool parse_whole(const char *text, int64_t *value)
{
    double v;

    if (pell_parse_int(text, strlen(text), value))
        return true;
    if (!pell_parse_number(text, strlen(text), &v) || v != floor(v) || fabs(v) > INT53)
        return false;
    *value = (int64_t) v;
    return true;
}

static bool in_range(const struct pell_knob *knob, double value)
{
    return isfinite(value) && value >= knob->min && value <= knob->max;
}

/* "r,g,b" with spaces allowed around each, or one number for all. */
static bool parse_rgb(const char *text, double rgb[3])
{
    int n = 0;

    for (const char *s = text;; s++) {
        const char *end = s + strcspn(s, ","), *last = end;

        while (s < last && *s == ' ')
            s++;
        while (last > s && last[-1] == ' ')
            last--;
        if (n == 3 || !pell_parse_number(s, (size_t) (last - s), &rgb[n]))
            return false;
        n++;
        s = end;
        if (!*s)
            break;
    }
    if (n == 1)
        rgb[1] = rgb[2] = rgb[0];
    return n != 2;
}

/* Stores an integer if it is in the knob's range; `text`: the integer as the caller wrote it, for messages. */
static enum pell_result store_whole(struct pell_context *ctx, const struct pell_knob *knob, const char *where, const char *text,
                                    void *values, int64_t whole)
{
    void *f = field(knob, values);

    /* Beyond 2^53 the comparison with the bounds, which are doubles, would round. */
    if (whole > (int64_t) INT53 || whole < -(int64_t) INT53 || !in_range(knob, (double) whole))
        return bad_value(ctx, knob, where, text, "");
    if (knob->type == PELL_KNOB_INT64) {
        *(int64_t *) f = whole;
        return PELL_OK;
    }
    if (whole > INT32_MAX || whole < INT32_MIN)
        return bad_value(ctx, knob, where, text, "a whole number of 32 bits ");
    *(int *) f = (int) whole;
    return PELL_OK;
}

static enum pell_result store_floats(struct pell_context *ctx, const struct pell_knob *knob, const char *where, const char *text,
                                     void *values, const double *numbers, int count)
{
    for (int i = 0; i < count; i++)
        if (!in_range(knob, numbers[i]) || !isfinite((float) numbers[i]))
            return bad_value(ctx, knob, where, text, "");
    for (int i = 0; i < count; i++)
        ((float *) field(knob, values))[i] = (float) numbers[i];
    return PELL_OK;
}

static enum pell_result bad_flag(struct pell_context *ctx, const struct pell_knob *knob, const char *where, const char *text)
{
    char shown[SHOWN];

    return pell_error(ctx, PELL_ERR_INVALID, where, knob->help, "%s = %s, must be on or off", knob->name,
                      pell_printable(text, shown, sizeof(shown)));
}

enum pell_result pell_knob_set(struct pell_context *ctx, const struct pell_knob *knobs, const char *owner, const char *where, void *values,
                               const char *name, const char *text)
{
    if (!knobs || !owner || (!values && knobs->type) || !name || !text)
        return pell_null(ctx, "pell_knob_set");

    const struct pell_knob *knob = pell_knob_find(knobs, name);
    double number, rgb[3];
    int64_t whole;
    bool flag;

    if (!knob)
        return unknown_knob(ctx, knobs, owner, where, name);
    switch (knob->type) {
    case PELL_KNOB_NONE: break;
    case PELL_KNOB_BOOL:
        if (!parse_bool(text, &flag))
            return bad_flag(ctx, knob, where, text);
        *(bool *) field(knob, values) = flag;
        break;
    case PELL_KNOB_INT:
    case PELL_KNOB_INT64:
        if (!parse_whole(text, &whole))
            return bad_value(ctx, knob, where, text, "a whole number ");
        return store_whole(ctx, knob, where, text, values, whole);
    case PELL_KNOB_FLOAT:
        if (!pell_parse_number(text, strlen(text), &number))
            return bad_value(ctx, knob, where, text, "a number ");
        return store_floats(ctx, knob, where, text, values, &number, 1);
    case PELL_KNOB_ENUM:
        for (int i = 0; knob->choices[i]; i++) {
            if (strcmp(knob->choices[i], text) == 0) {
                *(int *) field(knob, values) = i;
                return PELL_OK;
            }
        }
        return bad_choice(ctx, knob, where, text);
    case PELL_KNOB_RGB:
        if (!parse_rgb(text, rgb))
            return bad_value(ctx, knob, where, text, "one number or three (r,g,b) ");
        return store_floats(ctx, knob, where, text, values, rgb, 3);
    }
    return PELL_OK;
}

static const char *format_any(double number, char *buffer, size_t size)
{
    if (isfinite(number))
        return pell_format_number(number, false, buffer, size);
    snprintf(buffer, size, "%s", isnan(number) ? "not a number" : number < 0.0 ? "-infinity" : "infinity");
    return buffer;
}

static int count_choices(const struct pell_knob *knob)
{
    int count = 0;

    while (knob->choices[count])
        count++;
    return count;
}

enum pell_result pell_knob_set_number(struct pell_context *ctx, const struct pell_knob *knobs, const char *owner, const char *where,
                                      void *values, const char *name, double number)
{
    if (!knobs || !owner || (!values && knobs->type) || !name)
        return pell_null(ctx, "pell_knob_set_number");

    const struct pell_knob *knob = pell_knob_find(knobs, name);
    const bool whole = fabs(number) <= INT53 && number == floor(number);
    char text[40];

    if (!knob)
        return unknown_knob(ctx, knobs, owner, where, name);
    format_any(number, text, sizeof(text));
    switch (knob->type) {
    case PELL_KNOB_NONE: break;
    case PELL_KNOB_BOOL:
        if (number != 0.0 && number != 1.0)
            return bad_flag(ctx, knob, where, text);
        *(bool *) field(knob, values) = number != 0.0;
        break;
    case PELL_KNOB_INT:
    case PELL_KNOB_INT64:
        return whole ? store_whole(ctx, knob, where, text, values, (int64_t) number) : bad_value(ctx, knob, where, text, "a whole number ");
    case PELL_KNOB_FLOAT: return store_floats(ctx, knob, where, text, values, &number, 1);
    case PELL_KNOB_ENUM:
        if (!whole || number < 0.0 || number >= count_choices(knob))
            return bad_choice(ctx, knob, where, text);
        *(int *) field(knob, values) = (int) number;
        break;
    case PELL_KNOB_RGB: return store_floats(ctx, knob, where, text, values, (const double[3]) { number, number, number }, 3);
    }
    return PELL_OK;
}

enum pell_result pell_knob_set_rgb(struct pell_context *ctx, const struct pell_knob *knobs, const char *owner, const char *where,
                                   void *values, const char *name, const double rgb[3])
{
    if (!knobs || !owner || (!values && knobs->type) || !name || !rgb)
        return pell_null(ctx, "pell_knob_set_rgb");

    const struct pell_knob *knob = pell_knob_find(knobs, name);
    char part[3][40], text[128];

    if (!knob)
        return unknown_knob(ctx, knobs, owner, where, name);
    if (knob->type != PELL_KNOB_RGB)
        return pell_error(ctx, PELL_ERR_INVALID, where, knob->help, "%s takes one value, three were given", knob->name);
    for (int i = 0; i < 3; i++)
        format_any(rgb[i], part[i], sizeof(part[i]));
    snprintf(text, sizeof(text), "%s,%s,%s", part[0], part[1], part[2]);
    return store_floats(ctx, knob, where, text, values, rgb, 3);
}

/* Compared as floats: a bound such as 0.1 that a float can't hold is still allowed. */
static bool float_in_range(const struct pell_knob *knob, float value)
{
    return isfinite(value) && value >= (float) knob->min && value <= (float) knob->max;
}

static bool value_valid(const struct pell_knob *knob, const void *values)
{
    const void *f = const_field(knob, values);

    switch (knob->type) {
    case PELL_KNOB_NONE: break;
    case PELL_KNOB_BOOL: return *(const unsigned char *) f <= 1; /* as a byte: reading a bool that is neither 0 nor 1 is undefined */
    case PELL_KNOB_INT: return in_range(knob, *(const int *) f);
    case PELL_KNOB_INT64: return *(const int64_t *) f >= knob->min && *(const int64_t *) f <= knob->max;
    case PELL_KNOB_FLOAT: return float_in_range(knob, *(const float *) f);
    case PELL_KNOB_ENUM: return *(const int *) f >= 0 && *(const int *) f < count_choices(knob);
    case PELL_KNOB_RGB:
        for (int i = 0; i < 3; i++)
            if (!float_in_range(knob, ((const float *) f)[i]))
                return false;
        break;
    }
    return true;
}

enum pell_result pell_knobs_check(struct pell_context *ctx, const struct pell_knob *knobs, const char *owner, const void *values)
{
    if (!knobs || !owner || (!values && knobs->type))
        return pell_null(ctx, "pell_knobs_check");

    for (const struct pell_knob *k = knobs; k->type; k++) {
        char text[SHOWN];

        if (value_valid(k, values))
            continue;
        if (k->type == PELL_KNOB_BOOL)
            return pell_error(ctx, PELL_ERR_INVALID, owner, NULL, "%s holds %d, must be true or false", k->name,
                              *(const unsigned char *) const_field(k, values));
        if (k->type == PELL_KNOB_ENUM) {
            snprintf(text, sizeof(text), "%d", *(const int *) const_field(k, values));
            return bad_choice(ctx, k, owner, text);
        }
        return bad_value(ctx, k, owner, pell_knob_format(k, values, text, sizeof(text)), "");
    }
    return PELL_OK;
}

const char *pell_knob_format(const struct pell_knob *knob, const void *values, char *buffer, size_t size)
{
    const void *f = const_field(knob, values);
    char part[3][40];
    int count = 0;

    if (size == 0)
        return buffer;
    buffer[0] = '\0';
    switch (knob->type) {
    case PELL_KNOB_NONE: break;
    case PELL_KNOB_BOOL: snprintf(buffer, size, "%s", *(const unsigned char *) f ? "on" : "off"); break;
    case PELL_KNOB_INT: snprintf(buffer, size, "%d", *(const int *) f); break;
    case PELL_KNOB_INT64: snprintf(buffer, size, "%lld", (long long) *(const int64_t *) f); break;
    case PELL_KNOB_FLOAT: pell_format_number(*(const float *) f, true, buffer, size); break;
    case PELL_KNOB_ENUM:
        while (knob->choices[count] && count < *(const int *) f)
            count++;
        if (count == *(const int *) f && knob->choices[count])
            snprintf(buffer, size, "%s", knob->choices[count]);
        break;
    case PELL_KNOB_RGB:
        for (int i = 0; i < 3; i++)
            pell_format_number(((const float *) f)[i], true, part[i], sizeof(part[i]));
        snprintf(buffer, size, "%s,%s,%s", part[0], part[1], part[2]);
        break;
    }
    return buffer;
}
