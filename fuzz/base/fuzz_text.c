/* SPDX-License-Identifier: MIT
 * fuzz_text.c - numbers, lengths, names and knobs from arbitrary bytes: no crash, and accepted input has the documented properties. */
#include "base/base.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static const char *const modes[] = { "slab", "gaussian", NULL };

struct values {
    bool flag;
    int count, mode;
    int64_t large;
    float number, rgb[3];
};

#define AT(field) offsetof(struct values, field)
static const struct pell_knob knobs[] = {
    { "flag", PELL_KNOB_BOOL, "1", AT(flag), { 0 }, 0, 0, NULL, "" },
    { "count", PELL_KNOB_INT, "1", AT(count), { 1 }, -100, 1e9, NULL, "" },
    { "large", PELL_KNOB_INT64, "1", AT(large), { 1 }, -1e15, 1e15, NULL, "" },
    { "number", PELL_KNOB_FLOAT, "1", AT(number), { 1 }, -1e30, 1e30, NULL, "" },
    { "mode", PELL_KNOB_ENUM, "1", AT(mode), { 0 }, 0, 0, modes, "" },
    { "rgb", PELL_KNOB_RGB, "1", AT(rgb), { 1, 1, 1 }, 0, 1e6, NULL, "" },
    { 0 },
};
#undef AT

static void require(bool holds)
{
    if (!holds)
        abort();
}

/* Whatever pell_parse_number accepts, strtod must read completely, and to the same bits (the fuzzer runs in the C locale). */
static void check_number(const char *text, size_t length)
{
    char back[40], *end;
    double value, again;
    int64_t whole;

    if (pell_parse_number(text, length, &value)) {
        const double expected = strtod(text, &end);
        require(end == text + length && isfinite(value) && memcmp(&value, &expected, sizeof(value)) == 0);
        pell_format_number(value, false, back, sizeof(back));
        require(pell_parse_number(back, strlen(back), &again) && memcmp(&value, &again, sizeof(value)) == 0);
    }
    if (pell_parse_int(text, length, &whole))
        require(whole == strtoll(text, &end, 10) && end == text + length);
}

static void check_text(struct pell_context *ctx, const char *text)
{
    static const char *const names[] = { "wholemilk", "skimmilk", "marble", "jade" };
    struct pell_text hint = { .length = 0 };
    char shown[48], again[48];
    double mm;

    pell_printable(text, shown, sizeof(shown));
    require(strlen(shown) < sizeof(shown));
    require(strcmp(pell_printable(shown, again, sizeof(again)), shown) == 0); /* nothing is left to mask */
    if (pell_parse_length(ctx, "fuzz", text, &mm) == PELL_OK)
        require(isfinite(mm) && mm > 0);
    pell_text_suggest_or_list(&hint, "known: ", text, names, PELL_COUNT(names));
    require(strlen(hint.str) == hint.length && hint.length > 0);
}

static size_t field_size(enum pell_knob_type type)
{
    const struct values v = { 0 };
    return type == PELL_KNOB_BOOL ? sizeof(v.flag) : type == PELL_KNOB_INT64 ? sizeof(v.large) : type == PELL_KNOB_RGB ? sizeof(v.rgb) : 4;
}

static void check_knobs(struct pell_context *ctx, const char *text)
{
    struct values v, w;
    char printed[160];

    pell_knobs_default(knobs, &v);
    for (const struct pell_knob *k = knobs; k->type; k++)
        if (pell_knob_set(ctx, knobs, "fuzz", "fuzz", &v, k->name, text) == PELL_OK) {
            w = v;
            require(pell_knobs_check(ctx, knobs, "fuzz", &v) == PELL_OK);
            pell_knob_format(k, &v, printed, sizeof(printed));
            require(pell_knob_set(ctx, knobs, "fuzz", "fuzz", &w, k->name, printed) == PELL_OK);
            require(memcmp((char *) &v + k->offset, (char *) &w + k->offset, field_size(k->type)) == 0);
        }
    if (pell_knob_set(ctx, knobs, "fuzz", "fuzz", &v, text, "1") == PELL_OK)
        require(pell_knob_find(knobs, text) != NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct pell_context *ctx;
    char *text;

    if (pell_context_create(NULL, &ctx) != PELL_OK)
        return 0;
    text = pell_strndup(ctx, (const char *) data, size);
    if (text) {
        check_number(text, size);
        check_text(ctx, text);
        check_knobs(ctx, text);
    }
    pell_free(ctx, text);
    pell_context_destroy(&ctx);
    return 0;
}
