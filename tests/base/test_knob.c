/* SPDX-License-Identifier: MIT
 * test_knob.c - a table with all types of knobs: defaults, parsing, refusals, printing. */
#include "pell_test.h"

#include <pellucid/knob.h>

struct values {
    bool fast;
    int gaussians;
    int64_t bytes;
    float lod, tenth;
    int mode;
    float tint[3];
    int after; /* no row writes to this member */
};

static const char *const modes[] = { "slab", "gaussian", "none", NULL };

#define AT(field) offsetof(struct values, field)
static const struct pell_knob knobs[] = {
    { "fast", PELL_KNOB_BOOL, "1", AT(fast), { 1 }, 0, 0, NULL, "whether to hurry" },
    { "gaussians", PELL_KNOB_INT, "1", AT(gaussians), { 4 }, 1, 10, NULL, "terms of the sum" },
    { "bytes", PELL_KNOB_INT64, "B", AT(bytes), { 1e12 }, 0, 9007199254740992.0, NULL, "bytes in all" },
    { "lod", PELL_KNOB_FLOAT, "px", AT(lod), { 2.5 }, 0, 64, NULL, "coarsest step; 0 is none" },
    { "tenth", PELL_KNOB_FLOAT, "1", AT(tenth), { 0.1 }, 0.1, 0.3, NULL, "bounds that no float can hold" },
    { "through", PELL_KNOB_ENUM, "1", AT(mode), { 1 }, 0, 0, modes, "transmitted light" },
    { "tint", PELL_KNOB_RGB, "1", AT(tint), { 1, 0.5, 0.25 }, 0, 1, NULL, "colour" },
    { 0 },
};
#undef AT

struct fixture {
    struct kept_messages kept;
    struct pell_context *ctx;
    struct values v;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof(*f));
    if (!f || !(f->ctx = test_context(NULL, &f->kept)))
        return -1;
    f->v.after = 77;
    pell_knobs_default(knobs, &f->v);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    const int touched = f->v.after != 77;
    pell_context_destroy(&f->ctx);
    free(f);
    return touched;
}

static void take(struct fixture *f, const char *name, const char *text)
{
    if (pell_knob_set(f->ctx, knobs, "method test", "--set", &f->v, name, text) != PELL_OK)
        fail_msg("%s=%s is refused: %s", name, text, f->kept.what);
}

static void refuse(struct fixture *f, const char *name, const char *text, const char *what, const char *hint)
{
    const struct values before = f->v;
    const int errors = f->kept.errors;

    if (pell_knob_set(f->ctx, knobs, "method test", "--set", &f->v, name, text) != PELL_ERR_INVALID)
        fail_msg("%s=%s is taken", name, text);
    assert_int_equal(f->kept.errors, errors + 1);
    assert_string_equal(f->kept.where, "--set");
    assert_memory_equal(&before, &f->v, sizeof(before));
    if (what && !strstr(f->kept.what, what))
        fail_msg("'%s' says nothing of '%s'", f->kept.what, what);
    if (hint && !strstr(f->kept.hint, hint))
        fail_msg("the hint '%s' says nothing of '%s'", f->kept.hint, hint);
}

static void defaults_come_from_the_table_and_are_valid(void **state)
{
    struct fixture *f = *state;

    assert_true(f->v.fast);
    assert_int_equal(f->v.gaussians, 4);
    assert_true(f->v.bytes == INT64_C(1000000000000));
    assert_true(f->v.lod == 2.5f && f->v.tenth == 0.1f);
    assert_int_equal(f->v.mode, 1);
    assert_true(f->v.tint[0] == 1 && f->v.tint[1] == 0.5f && f->v.tint[2] == 0.25f);
    assert_int_equal(pell_knobs_check(f->ctx, knobs, "method test", &f->v), PELL_OK);
    assert_ptr_equal(pell_knob_find(knobs, "lod"), &knobs[3]);
    assert_null(pell_knob_find(knobs, "LOD"));
    assert_null(pell_knob_find(knobs, ""));
}

static void limits_have_valid_defaults(void **state)
{
    struct fixture *f = *state;
    struct pell_limits limits;

    pell_knobs_default(pell_limit_knobs(), &limits);
    assert_int_equal(pell_knobs_check(f->ctx, pell_limit_knobs(), "limits", &limits), PELL_OK);
    assert_memory_equal(&limits, pell_context_limits(f->ctx), sizeof(limits));
}

static void values_are_read_by_type(void **state)
{
    static const char *const on[] = { "on", "true", "yes", "1" }, *const off[] = { "off", "false", "no", "0" };
    struct fixture *f = *state;

    for (int i = 0; i < 4; i++) {
        take(f, "fast", off[i]);
        assert_false(f->v.fast);
        take(f, "fast", on[i]);
        assert_true(f->v.fast);
    }
    take(f, "gaussians", "10");
    assert_int_equal(f->v.gaussians, 10);
    take(f, "gaussians", "1e0");
    assert_int_equal(f->v.gaussians, 1);
    take(f, "bytes", "9007199254740992");
    assert_true(f->v.bytes == INT64_C(9007199254740992));
    take(f, "lod", "0.125");
    assert_true(f->v.lod == 0.125f);
    take(f, "tenth", "0.1");
    take(f, "tenth", "0.3");
    assert_int_equal(pell_knobs_check(f->ctx, knobs, "method test", &f->v), PELL_OK);
    take(f, "through", "none");
    assert_int_equal(f->v.mode, 2);
    take(f, "tint", "0.5");
    assert_true(f->v.tint[0] == 0.5f && f->v.tint[1] == 0.5f && f->v.tint[2] == 0.5f);
    take(f, "tint", "0, 0.25 ,1");
    assert_true(f->v.tint[0] == 0 && f->v.tint[1] == 0.25f && f->v.tint[2] == 1);
}

static void values_out_of_range_name_value_and_range(void **state)
{
    struct fixture *f = *state;

    refuse(f, "gaussians", "12", "gaussians = 12, must be in [1, 10]", "terms of the sum");
    refuse(f, "gaussians", "0", "[1, 10]", NULL);
    refuse(f, "gaussians", "2.5", "must be a whole number in [1, 10]", NULL);
    refuse(f, "gaussians", "4294967300", "[1, 10]", NULL); /* 4 in 32 bits */
    refuse(f, "gaussians", "1e30", "[1, 10]", NULL);
    refuse(f, "bytes", "9007199254740993", "[0, 9007199254740992] B", NULL);
    refuse(f, "bytes", "-1", NULL, NULL);
    refuse(f, "lod", "64.001", "lod = 64.001, must be in [0, 64] px", NULL);
    refuse(f, "lod", "nan", "lod = nan, must be a number in [0, 64] px", NULL);
    refuse(f, "lod", "inf", NULL, NULL);
    refuse(f, "lod", "", NULL, NULL);
    refuse(f, "lod", "2px", NULL, NULL);
    refuse(f, "fast", "maybe", "fast = maybe, must be on or off", NULL);
    refuse(f, "tint", "0,0", "r,g,b", NULL);
    refuse(f, "tint", "0,0,0,0", NULL, NULL);
    refuse(f, "tint", "0,,0", NULL, NULL);
    refuse(f, "tint", "0,0,1.5", "[0, 1]", NULL);
    refuse(f, "tint", "0,nan,0", NULL, NULL);
    refuse(f, "through", "gausian", "must be one of slab, gaussian, none", "did you mean \"gaussian\"?");
    refuse(f, "through", "Slab", NULL, "did you mean \"slab\"?");
}

static void unknown_names_get_the_nearest_or_the_list(void **state)
{
    struct fixture *f = *state;

    refuse(f, "gausians", "4", "method test has no knob \"gausians\"", "did you mean \"gaussians\"?");
    refuse(f, "zzzzzz", "4", "\"zzzzzz\"", "fast, gaussians, bytes, lod, tenth, through, tint");
    refuse(f, "", "4", "\"\"", "fast, gaussians");
    refuse(f, "lo\x1b[0md", "4", "\"lo?[0md\"", NULL);
}

static void check_finds_each_kind_of_bad_value(void **state)
{
    struct fixture *f = *state;
    const struct values good = f->v;
    unsigned char two = 2;

#define BAD(change, text)                                                                                                                  \
    do {                                                                                                                                   \
        f->v = good;                                                                                                                       \
        change;                                                                                                                            \
        assert_int_equal(pell_knobs_check(f->ctx, knobs, "method test", &f->v), PELL_ERR_INVALID);                                         \
        if (!strstr(f->kept.what, text))                                                                                                   \
            fail_msg("'%s' says nothing of '%s'", f->kept.what, text);                                                                     \
        assert_string_equal(f->kept.where, "method test");                                                                                 \
    } while (0)
    BAD(memcpy(&f->v.fast, &two, 1), "fast holds 2");
    BAD(f->v.gaussians = 11, "gaussians = 11");
    BAD(f->v.bytes = -1, "bytes = -1");
    BAD(f->v.lod = NAN, "lod = ");
    BAD(f->v.lod = INFINITY, "lod = inf");
    BAD(f->v.lod = -0.5f, "lod = -0.5");
    BAD(f->v.mode = 3, "through = 3");
    BAD(f->v.mode = -1, "through = -1");
    BAD(f->v.tint[2] = 2, "tint = 1,0.5,2");
    BAD(f->v.tint[1] = NAN, "tint = ");
#undef BAD
    f->v = good;
    assert_int_equal(f->kept.errors, 10);
}

static void printed_values_read_back(void **state)
{
    struct fixture *f = *state;
    char text[128];

    f->v.lod = 0.1f;
    f->v.tint[0] = 1.0f / 3;
    f->v.fast = false;
    for (const struct pell_knob *k = knobs; k->type; k++) {
        const struct values before = f->v;
        take(f, k->name, pell_knob_format(k, &f->v, text, sizeof(text)));
        assert_memory_equal(&before, &f->v, sizeof(before));
    }
    assert_string_equal(pell_knob_format(&knobs[3], &f->v, text, sizeof(text)), "0.1");
    assert_string_equal(pell_knob_format(&knobs[5], &f->v, text, sizeof(text)), "gaussian");
    assert_string_equal(pell_knob_format(&knobs[2], &f->v, text, 4), "100"); /* cut, terminated */
    f->v.mode = 12;                                                          /* not a choice: no text, no read past the list */
    assert_string_equal(pell_knob_format(&knobs[5], &f->v, text, sizeof(text)), "");
    f->v.mode = 0;
}

static void no_knobs_at_all_is_a_table(void **state)
{
    static const struct pell_knob none[] = { { 0 } };
    struct fixture *f = *state;

    pell_knobs_default(none, NULL);
    assert_int_equal(pell_knobs_check(f->ctx, none, "method empty", NULL), PELL_OK);
    assert_int_equal(pell_knob_set(f->ctx, none, "method empty", "--set", &f->v, "lod", "1"), PELL_ERR_INVALID);
    assert_string_equal(f->kept.hint, "there are none");
}

static void numbers_are_taken_by_type_and_refused_untouched(void **state)
{
    static const struct {
        const char *name;
        double number;
        const char *what;
    } bad[] = {
        { "gaussians", 4.5, "gaussians = 4.5, must be a whole number in [1, 10]" },
        { "gaussians", 11, "gaussians = 11, must be in [1, 10]" },
        { "gaussians", NAN, "gaussians = not a number, must be a whole number" },
        { "bytes", 1e16, "bytes = 1e+16, must be a whole number" },
        { "bytes", INFINITY, "bytes = infinity, must be a whole number" },
        { "lod", -INFINITY, "lod = -infinity, must be in [0, 64] px" },
        { "lod", NAN, "lod = not a number, must be in" },
        { "lod", 1e300, "must be in [0, 64] px" },
        { "fast", 2, "fast = 2, must be on or off" },
        { "fast", NAN, "fast = not a number, must be on or off" },
        { "through", 3, "through = 3, must be one of slab, gaussian, none" },
        { "through", -1, "through = -1, must be one of" },
        { "through", 0.5, "through = 0.5, must be one of" },
        { "tint", 2, "tint = 2, must be in [0, 1]" },
        { "tnit", 1, "method test has no knob \"tnit\"" },
    };
    struct fixture *f = *state;

    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        const struct values before = f->v;

        assert_int_equal(pell_knob_set_number(f->ctx, knobs, "method test", "here", &f->v, bad[i].name, bad[i].number), PELL_ERR_INVALID);
        assert_memory_equal(&before, &f->v, sizeof(before));
        assert_string_equal(f->kept.where, "here");
        if (!strstr(f->kept.what, bad[i].what))
            fail_msg("'%s' says nothing of '%s'", f->kept.what, bad[i].what);
    }
    assert_int_equal(pell_knob_set_number(f->ctx, knobs, "t", "", &f->v, "fast", 0), PELL_OK);
    assert_int_equal(pell_knob_set_number(f->ctx, knobs, "t", "", &f->v, "gaussians", 7), PELL_OK);
    assert_int_equal(pell_knob_set_number(f->ctx, knobs, "t", "", &f->v, "bytes", 9007199254740992.0), PELL_OK);
    assert_int_equal(pell_knob_set_number(f->ctx, knobs, "t", "", &f->v, "lod", 0.1), PELL_OK);
    assert_int_equal(pell_knob_set_number(f->ctx, knobs, "t", "", &f->v, "through", 2), PELL_OK);
    assert_int_equal(pell_knob_set_number(f->ctx, knobs, "t", "", &f->v, "tint", 0.75), PELL_OK);
    assert_true(!f->v.fast && f->v.gaussians == 7 && f->v.bytes == INT64_C(9007199254740992) && f->v.lod == 0.1f && f->v.mode == 2);
    assert_true(f->v.tint[0] == 0.75f && f->v.tint[1] == 0.75f && f->v.tint[2] == 0.75f);
}

static void three_numbers_are_for_colours_alone(void **state)
{
    struct fixture *f = *state;
    struct values before;

    assert_int_equal(pell_knob_set_rgb(f->ctx, knobs, "t", "", &f->v, "tint", (const double[3]) { 0.25, 0.5, 1 }), PELL_OK);
    assert_true(f->v.tint[0] == 0.25f && f->v.tint[1] == 0.5f && f->v.tint[2] == 1.0f);
    before = f->v;
    assert_int_equal(pell_knob_set_rgb(f->ctx, knobs, "t", "", &f->v, "tint", (const double[3]) { 0, 1.5, NAN }), PELL_ERR_INVALID);
    assert_non_null(strstr(f->kept.what, "tint = 0,1.5,not a number, must be in [0, 1]"));
    assert_int_equal(pell_knob_set_rgb(f->ctx, knobs, "t", "", &f->v, "lod", (const double[3]) { 1, 1, 1 }), PELL_ERR_INVALID);
    assert_non_null(strstr(f->kept.what, "lod takes one value"));
    assert_int_equal(pell_knob_set_rgb(f->ctx, knobs, "t", "", &f->v, "tin", (const double[3]) { 1, 1, 1 }), PELL_ERR_INVALID);
    assert_memory_equal(&before, &f->v, sizeof(before));
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(defaults_come_from_the_table_and_are_valid),
        TEST(limits_have_valid_defaults),
        TEST(values_are_read_by_type),
        TEST(values_out_of_range_name_value_and_range),
        TEST(unknown_names_get_the_nearest_or_the_list),
        TEST(check_finds_each_kind_of_bad_value),
        TEST(printed_values_read_back),
        TEST(no_knobs_at_all_is_a_table),
        TEST(numbers_are_taken_by_type_and_refused_untouched),
        TEST(three_numbers_are_for_colours_alone),
    };
    return cmocka_run_group_tests_name("knob", tests, NULL, NULL);
}
