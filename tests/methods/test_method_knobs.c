/* SPDX-License-Identifier: MIT
 * test_method_knobs.c - knobs of a method from one line of text: accepted and refused values, and their messages, for arbitrary bytes. */
#include "pell_test.h"

#include <pellucid/method.h>

struct fixture {
    struct kept_messages kept;
    struct pell_context *ctx;
    const struct pell_method *method; /* screen-space */
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof(*f));

    if (!f || !(f->ctx = test_context(NULL, &f->kept)) || !(f->method = pell_method_find(f->ctx, "test", "screen-space")))
        return -1;
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    const bool leaked = pell_memory_used(f->ctx) != 0;

    pell_context_destroy(&f->ctx);
    free(f);
    return leaked;
}

/* The value of a knob as text. */
static const char *shown(const struct pell_method *method, const void *knobs, const char *name)
{
    static char text[160];

    return pell_knob_format(pell_knob_find(method->knobs, name), knobs, text, sizeof(text));
}

static void *make(struct fixture *f, const char *text)
{
    void *knobs = NULL;

    if (pell_method_knobs_create(f->ctx, f->method, text, &knobs) != PELL_OK)
        fail_msg("'%s' is refused: %s", text, f->kept.what);
    assert_non_null(knobs);
    return knobs;
}

static void refuse(struct fixture *f, const char *text, const char *what, const char *hint)
{
    const int errors = f->kept.errors;
    void *knobs = f;

    if (pell_method_knobs_create(f->ctx, f->method, text, &knobs) != PELL_ERR_INVALID)
        fail_msg("'%s' is taken", text);
    assert_null(knobs);
    assert_int_equal(f->kept.errors, errors + 1);
    assert_string_equal(f->kept.where, "knobs");
    if (!strstr(f->kept.what, what) || !strstr(f->kept.hint, hint))
        fail_msg("'%s' (%s) says nothing of '%s' (%s)", f->kept.what, f->kept.hint, what, hint);
}

static void no_text_means_the_defaults(void **state)
{
    static const char *const texts[] = { NULL, "", " ", " ,\t\n, ", "as=best" };
    struct fixture *f = *state;

    for (size_t i = 0; i < pell_method_count(); i++)
        for (size_t t = 0; t < PELL_COUNT(texts); t++) {
            const struct pell_method *method = pell_method_at(i);
            void *expected = calloc(1, method->knobs_size), *knobs;

            assert_int_equal(pell_method_configure(f->ctx, method, NULL, 0, expected), PELL_OK);
            assert_int_equal(pell_method_knobs_create(f->ctx, method, texts[t], &knobs), PELL_OK);
            assert_memory_equal(knobs, expected, method->knobs_size);
            pell_method_knobs_destroy(f->ctx, &knobs);
            assert_null(knobs);
            pell_method_knobs_destroy(f->ctx, &knobs);
            free(expected);
        }
}

static void settings_are_parted_by_blanks_or_commas_and_the_last_holds(void **state)
{
    static const char *const texts[] = { "gaussians=6 lod=2", "gaussians=6,lod=2", " \tgaussians=6 ,\n lod=2,", "lod=1 gaussians=6 lod=2" };
    struct fixture *f = *state;

    for (size_t i = 0; i < PELL_COUNT(texts); i++) {
        void *knobs = make(f, texts[i]);

        assert_string_equal(shown(f->method, knobs, "gaussians"), "6");
        assert_string_equal(shown(f->method, knobs, "lod"), "2");
        pell_method_knobs_destroy(f->ctx, &knobs);
    }
}

static void as_chooses_the_defaults_wherever_it_stands(void **state)
{
    static const char *const texts[] = { "as=paper gaussians=3", "gaussians=3 as=paper", "as=best gaussians=3, as=paper" };
    struct fixture *f = *state;
    const struct pell_setting settings[] = { { "as", "paper", "test" }, { "gaussians", "3", "test" } };
    void *expected = calloc(1, f->method->knobs_size), *best = make(f, "gaussians=3");

    assert_int_equal(pell_method_configure(f->ctx, f->method, settings, 2, expected), PELL_OK);
    assert_memory_not_equal(expected, best, f->method->knobs_size);
    for (size_t i = 0; i < PELL_COUNT(texts); i++) {
        void *knobs = make(f, texts[i]);

        assert_memory_equal(knobs, expected, f->method->knobs_size);
        pell_method_knobs_destroy(f->ctx, &knobs);
    }
    pell_method_knobs_destroy(f->ctx, &best);
    free(expected);
}

/* Three numbers form one value, with or without blanks after the commas. */
static void a_value_may_have_commas(void **state)
{
    static const char *const choices[] = { "best", "paper", NULL };
    static const struct pell_knob rows[] = {
        { "as", PELL_KNOB_ENUM, "1", 0, { 0 }, 0, 0, choices, "" },
        { "tint", PELL_KNOB_RGB, "1", sizeof(float), { 1, 1, 1 }, 0, 1, NULL, "" },
        { "lod", PELL_KNOB_FLOAT, "1", 4 * sizeof(float), { 1 }, 0, 9, NULL, "" },
        { 0 },
    };
    static const char *const texts[] = { "tint=0.5,0.25,0.125 lod=2", "tint=0.5, 0.25 ,0.125,lod=2", "lod=2 tint=0.5,0.25,0.125, " };
    const struct pell_method method = { .name = "tinted", .knobs = rows, .knobs_size = 5 * sizeof(float) };
    struct fixture *f = *state;
    void *knobs;

    for (size_t i = 0; i < PELL_COUNT(texts); i++) {
        assert_int_equal(pell_method_knobs_create(f->ctx, &method, texts[i], &knobs), PELL_OK);
        assert_string_equal(shown(&method, knobs, "tint"), "0.5,0.25,0.125");
        assert_string_equal(shown(&method, knobs, "lod"), "2");
        pell_method_knobs_destroy(f->ctx, &knobs);
    }
    f->method = &method;
    refuse(f, "tint=0.5,0.25", "tint = 0.5,0.25, must be one number or three", "");
    refuse(f, "tint=0.5,,0.25", "tint = 0.5,,0.25, must be", "");
    refuse(f, "tint=0.5 0.25 0.25", "\"0.25\" is not NAME=VALUE", "");
}

static void errors_name_the_knob_the_value_and_what_is_allowed(void **state)
{
    struct fixture *f = *state;
    char *longest = malloc(100001);

    refuse(f, "gaussian=6", "method screen-space has no knob \"gaussian\"", "did you mean \"gaussians\"?");
    refuse(f, "gaussians=600", "gaussians = 600, must be in [", "");
    refuse(f, "gaussians=6;lod=2", "gaussians = 6;lod=2, must be a whole number", "");
    refuse(f, "gaussians=six", "gaussians = six, must be a whole number in [", "");
    refuse(f, "gaussians=6,7", "gaussians = 6,7, must be a whole number", "");
    refuse(f, "as=papre", "as = papre, must be one of best, paper", "did you mean \"paper\"?");
    refuse(f, "gaussians = 6", "\"gaussians\" is not NAME=VALUE", "without spaces");
    refuse(f, "fast", "\"fast\" is not NAME=VALUE", "");
    refuse(f, "lod=2 ,fast=", "has no knob \"fast\"", "");
    refuse(f, "=6", "has no knob \"\"", "");
    refuse(f, "=", "has no knob \"\"", "");
    refuse(f, "gaussians=", "gaussians = , must be", "");
    refuse(f, "gaussians==6", "gaussians = =6, must be", "");
    refuse(f, "\"gaussians=6\"", "has no knob \"\"gaussians\"", "");
    refuse(f, "{[(gaussians=6", "has no knob", "");
    refuse(f, "ga\xff\x80=6",
           "has no knob \"ga?"
           "?\"",
           "");
    refuse(f, "gaussians=\x01\xfe",
           "gaussians = ?"
           "?, must be",
           "");
    assert_non_null(longest);
    for (size_t i = 0; i < 100000; i++)
        longest[i] = "x=,y "[i % 5];
    longest[100000] = '\0';
    refuse(f, longest, "has no knob \"x\"", "");
    memset(longest, 'x', 100000);
    refuse(f, longest, "...\" is not NAME=VALUE", "");
    memset(longest, '=', 100000);
    refuse(f, longest, "has no knob \"\"", "");
    free(longest);
}

static void every_failing_allocation_is_survived(void **state)
{
    enum pell_result res = PELL_ERR_NOMEM;
    uint64_t fail_at = 1;
    (void) state;

    for (; res != PELL_OK && fail_at < 100; fail_at++) {
        struct pell_alloc_fault fault = { .fail_at = fail_at + 1 }; /* the first is the context */
        struct pell_context *ctx;
        const struct pell_method *method;
        void *knobs = &fault;

        assert_int_equal(pell_context_create(&(struct pell_context_params) { .allocator = pell_failing_allocator(&fault) }, &ctx), PELL_OK);
        method = pell_method_find(ctx, "test", "screen-space");
        res = pell_method_knobs_create(ctx, method, "gaussians=6 lod=2", &knobs);
        assert_true(res == PELL_OK || (res == PELL_ERR_NOMEM && !knobs));
        if (res == PELL_OK)
            pell_method_knobs_destroy(ctx, &knobs);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
    }
    assert_int_equal(res, PELL_OK);
    assert_true(fail_at > 3);
}

static void one_knob_is_set_by_text_or_number(void **state)
{
    struct fixture *f = *state;
    void *knobs = make(f, "lod=1");

    assert_int_equal(pell_method_knobs_set_number(f->ctx, f->method, knobs, "gaussians", 5), PELL_OK);
    assert_int_equal(pell_method_knobs_set_text(f->ctx, f->method, knobs, "lod", "3"), PELL_OK);
    assert_string_equal(shown(f->method, knobs, "gaussians"), "5");
    assert_string_equal(shown(f->method, knobs, "lod"), "3");
    assert_int_equal(pell_method_knobs_set_number(f->ctx, f->method, knobs, "gaussians", 5.5), PELL_ERR_INVALID);
    assert_non_null(strstr(f->kept.what, "gaussians = 5.5, must be a whole number"));
    assert_int_equal(pell_method_knobs_set_number(f->ctx, f->method, knobs, "gausians", 5), PELL_ERR_INVALID);
    assert_non_null(strstr(f->kept.hint, "gaussians"));
    assert_int_equal(pell_method_knobs_set_text(f->ctx, f->method, knobs, "as", "paper"), PELL_ERR_INVALID);
    assert_non_null(strstr(f->kept.hint, "pell_method_knobs_create"));
    assert_int_equal(pell_method_knobs_set_number(f->ctx, f->method, knobs, "as", 1), PELL_ERR_INVALID);
    assert_string_equal(shown(f->method, knobs, "gaussians"), "5");
    assert_string_equal(shown(f->method, knobs, "as"), "best");
    pell_method_knobs_destroy(f->ctx, &knobs);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(no_text_means_the_defaults, setup, teardown),
        cmocka_unit_test_setup_teardown(settings_are_parted_by_blanks_or_commas_and_the_last_holds, setup, teardown),
        cmocka_unit_test_setup_teardown(as_chooses_the_defaults_wherever_it_stands, setup, teardown),
        cmocka_unit_test_setup_teardown(a_value_may_have_commas, setup, teardown),
        cmocka_unit_test_setup_teardown(errors_name_the_knob_the_value_and_what_is_allowed, setup, teardown),
        cmocka_unit_test(every_failing_allocation_is_survived),
        cmocka_unit_test_setup_teardown(one_knob_is_set_by_text_or_number, setup, teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
