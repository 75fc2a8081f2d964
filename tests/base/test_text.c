/* SPDX-License-Identifier: MIT
 * test_text.c - bounded strings, nearest names, safe printing, numbers and lengths. */
#include "pell_test.h"

#include <locale.h>

/* --- struct pell_text --- */

static void text_truncates_and_stays_terminated(void **state)
{
    struct pell_text text = { .length = 0 };
    (void) state;

    pell_text_add(&text, "%s-%d", "a", 7);
    assert_string_equal(text.str, "a-7");
    assert_int_equal(text.length, 3);
    for (int i = 0; i < 200; i++)
        pell_text_add(&text, "%s", "0123456789");
    assert_int_equal(text.length, sizeof(text.str) - 1);
    assert_int_equal(strlen(text.str), text.length);
    pell_text_add(&text, "more");
    assert_int_equal(text.length, sizeof(text.str) - 1);
}

/* --- nearest names --- */

static void nearest_finds_slips_and_pieces_only(void **state)
{
    static const char *const names[] = { "wholemilk", "skimmilk", "marble", "skin1", "skin2", "jade", NULL, "ketchup" };
    static const struct {
        const char *typed, *says;
    } cases[] = {
        { "wholmilk", "did you mean \"wholemilk\"?" },             /* one left out */
        { "marbel", "did you mean \"marble\"?" },                  /* two swapped */
        { "MARBLE", "did you mean \"marble\"?" },                  /* case */
        { "Ketchap", "did you mean \"ketchup\"?" },                /* one other */
        { "jades", "did you mean \"jade\"?" },                     /* one too many */
        { "milk", "did you mean \"skimmilk\" or \"wholemilk\"?" }, /* a piece of two; the shorter first */
        { "whole", "did you mean \"wholemilk\"?" },                /* a beginning */
        { "skin", "did you mean \"skin1\"?" },                     /* the first of two equally near */
        { "granite", "" },
        { "xyzw", "" },
        { "", "" },
        { "ab", "" },
        { "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "" },
    };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct pell_text text = { .length = 0 };
        const bool found = pell_text_suggest(&text, "", cases[i].typed, names, PELL_COUNT(names));
        assert_string_equal(text.str, cases[i].says);
        assert_int_equal(found, cases[i].says[0] != '\0');
    }
    assert_false(pell_text_suggest(&(struct pell_text) { .length = 0 }, "", "marble", NULL, 0));
}

static void of_many_pieces_the_shortest_are_suggested(void **state)
{
    static const char *const names[] = { "x-milk-55", "x-milk-4", "milk-666666", "x-milk-333", "x-milk", "milky\033" };
    struct pell_text text = { .length = 0 };
    (void) state;

    assert_true(pell_text_suggest(&text, "--", "mil", names, PELL_COUNT(names)));
    assert_string_equal(text.str, "did you mean \"--x-milk\", \"--milky?\", \"--x-milk-4\" or \"--x-milk-55\"?");
}

static void what_is_near_nothing_gets_the_list(void **state)
{
    static const char *const names[] = { "cpu", "vulkan" };
    struct pell_text near = { .length = 0 }, far = { .length = 0 };
    (void) state;

    pell_text_suggest_or_list(&near, "known: ", "vulcan", names, PELL_COUNT(names));
    assert_string_equal(near.str, "did you mean \"vulkan\"?");
    pell_text_suggest_or_list(&far, "known: ", "fpga", names, PELL_COUNT(names));
    assert_string_equal(far.str, "known: cpu, vulkan");
}

static void counts_agree_with_their_nouns(void **state)
{
    (void) state;

    assert_string_equal(pell_counted(1, "edge has", "edges have").str, "1 edge has");
    assert_string_equal(pell_counted(0, "edge has", "edges have").str, "0 edges have");
    assert_string_equal(pell_counted(21, "vertex", "vertices").str, "21 vertices");
}

/* --- printable --- */

static void printable_keeps_good_utf8_and_masks_the_rest(void **state)
{
    static const struct {
        const char *raw, *shown;
    } cases[] = {
        { "plain", "plain" },
        { "tab\tbell\a del\x7f", "tab?bell? del?" },
        { "\x1b[31mred", "?[31mred" },
        { "gr\xc3\xbc\xc3\x9f\x65 \xe2\x82\xac \xf0\x9f\x90\xb0", "gr\xc3\xbc\xc3\x9f\x65 \xe2\x82\xac \xf0\x9f\x90\xb0" },
        { "\xff\xfe", "??" },
        { "cut \xe2\x82", "cut ??" },              /* ends inside a character */
        { "\xc0\xaf", "??" },                      /* overlong */
        { "\xe0\x80\x80", "???" },                 /* overlong */
        { "\xed\xa0\x80", "???" },                 /* a surrogate */
        { "\xf4\x90\x80\x80", "????" },            /* above U+10FFFF */
        { "\xc2\x85", "??" },                      /* a C1 control */
        { "a\xe2\x80\xaegpj.exe", "a???gpj.exe" }, /* right-to-left override */
    };
    char buffer[64];
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++)
        assert_string_equal(pell_printable(cases[i].raw, buffer, sizeof(buffer)), cases[i].shown);
    assert_string_equal(pell_printable(NULL, buffer, sizeof(buffer)), "");
}

static void printable_cuts_long_texts_between_characters(void **state)
{
    static const char text[] = "ab\xe2\x82\xac\xe2\x82\xac\xe2\x82\xac"
                               "defgh";
    char buffer[32];
    (void) state;

    assert_string_equal(pell_printable("0123456789", buffer, 11), "0123456789");
    assert_string_equal(pell_printable("0123456789", buffer, 10), "012345...");
    assert_string_equal(pell_printable(text, buffer, 12), "ab\xe2\x82\xac\xe2\x82\xac...");
    assert_string_equal(pell_printable(text, buffer, 11), "ab\xe2\x82\xac...");
    assert_string_equal(pell_printable("0123456789", buffer, 4), "...");
    for (size_t size = 1; size < sizeof(buffer); size++) {
        memset(buffer, 'x', sizeof(buffer));
        pell_printable(text, buffer, size);
        REQUIRE(strlen(buffer) < size);
        for (size_t i = size; i < sizeof(buffer); i++)
            assert_int_equal(buffer[i], 'x');
    }
    pell_printable(text, buffer, 0);
}

/* --- numbers --- */

static void numbers_refuse_what_is_not_wholly_a_number(void **state)
{
    static const char *const bad[] = { "",
                                       " 1",
                                       "1 ",
                                       "\t1",
                                       "1\n",
                                       "nan",
                                       "inf",
                                       "-inf",
                                       "infinity",
                                       "NaN",
                                       "0x10",
                                       "0x1p3",
                                       "1,5",
                                       "1e",
                                       "1e+",
                                       "e5",
                                       ".",
                                       "-",
                                       "+",
                                       "-.",
                                       "1.2.3",
                                       "1e5.0",
                                       "1f",
                                       "--1",
                                       "+-1",
                                       "1e999",
                                       "-1e999",
                                       "1'000",
                                       "1_000",
                                       "\xd9\xa1",
                                       "1e99999999999999999999999" };
    double value = 42;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(bad); i++)
        if (pell_parse_number(bad[i], strlen(bad[i]), &value))
            fail_msg("'%s' is taken as %g", bad[i], value);
    assert_true(value == 42);
    assert_false(pell_parse_number("1\0002", 3, &value));
}

static void numbers_stop_at_the_given_length(void **state)
{
    double value;
    (void) state;

    assert_true(pell_parse_number("12345", 2, &value));
    assert_true(value == 12);
    assert_true(pell_parse_number("1e5", 1, &value));
    assert_true(value == 1);
    assert_false(pell_parse_number("1e5", 2, &value));
}

static void numbers_are_exact(void **state)
{
    static const struct {
        const char *text;
        double value;
        /* clang-format off */
    } cases[] = {
        { "0", 0 }, { "-0", 0 }, { "+1", 1 }, { ".5", .5 }, { "5.", 5 }, { "00012.500", 12.5 }, { "1e3", 1000 }, { "1E+3", 1000 },
        { "1e-3", 1e-3 }, { "0.1", 0.1 }, { "123456789012345678", 123456789012345678.0 }, { "9007199254740993", 9007199254740992.0 },
        { "9007199254740993.0000000000000000000000000000001", 9007199254740994.0 }, { "1.7976931348623157e308", 0x1.fffffffffffffp1023 },
        { "4.9406564584124654e-324", 0x1p-1074 }, { "2.2250738585072014e-308", 0x1p-1022 }, { "1e-400", 0 },
        { "0e99999999999999999999", 0 },
        { "1e-99999999999999999999", 0 }, { "6.02214076e23", 6.02214076e23 }, { "1e22", 1e22 }, { "1e23", 1e23 }, { "8.5e-23", 8.5e-23 },
    };
    /* clang-format on */
    double value;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        if (!pell_parse_number(cases[i].text, strlen(cases[i].text), &value) || value != cases[i].value)
            fail_msg("'%s' gives %.17g, not %.17g", cases[i].text, value, cases[i].value);
    }
    assert_true(pell_parse_number("-0", 2, &value) && signbit(value));
}

/* Long digit strings: an exact tie, and a tie with one more digit a thousand digits later. */
static void numbers_round_right_after_a_thousand_digits(void **state)
{
    char text[3000];
    double value;
    size_t n;
    (void) state;

    /* 2^53 + 1 lies half-way between two doubles; ties round to even. */
    n = (size_t) snprintf(text, sizeof(text), "9007199254740993.");
    memset(text + n, '0', 2000);
    assert_true(pell_parse_number(text, n + 2000, &value));
    assert_true(value == 9007199254740992.0);
    text[n + 1999] = '1';
    assert_true(pell_parse_number(text, n + 2000, &value));
    assert_true(value == 9007199254740994.0);

    /* "0.000...0001" with an exponent that compensates the zeros, and "1000...000e-2000". */
    memset(text, '0', sizeof(text));
    text[1] = '.';
    n = 2000;
    n += (size_t) snprintf(text + n, sizeof(text) - n, "1e1999");
    assert_true(pell_parse_number(text, n, &value));
    assert_true(value == 1);
    memset(text, '0', sizeof(text));
    text[0] = '1';
    n = 2001 + (size_t) snprintf(text + 2001, sizeof(text) - 2001, "e-2000");
    assert_true(pell_parse_number(text, n, &value));
    assert_true(value == 1);
}

/* Compared with the C library in the C locale, over doubles of every magnitude. */
static void numbers_agree_with_the_c_library(void **state)
{
    uint64_t seed = 1;
    (void) state;

    for (int i = 0; i < 200000; i++) {
        char text[64];
        uint64_t bits;
        double wanted, value;

        seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
        bits = seed ^ seed >> 29;
        memcpy(&wanted, &bits, sizeof(wanted));
        if (!isfinite(wanted))
            continue;
        snprintf(text, sizeof(text), "%.*g", 1 + i % 20, wanted);
        wanted = strtod(text, NULL);
        if (!isfinite(wanted))
            continue;
        if (!pell_parse_number(text, strlen(text), &value) || memcmp(&value, &wanted, sizeof(value)) != 0)
            fail_msg("'%s' gives %.17g, not %.17g", text, value, wanted);
    }
}

static void numbers_do_not_depend_on_the_locale(void **state)
{
    static const char *const locales[] = { "de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "fr_FR.utf8", "ps_AF.UTF-8" };
    char buffer[40];
    bool found = false;
    double value;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(locales); i++) {
        if (!setlocale(LC_ALL, locales[i]))
            continue;
        found = true;
        assert_true(pell_parse_number("1.5", 3, &value));
        assert_true(value == 1.5);
        assert_true(pell_parse_number("1.234567890123456789012", 23, &value));
        assert_true(value == 1.234567890123456789012);
        assert_false(pell_parse_number("1,5", 3, &value));
        assert_string_equal(pell_format_number(0.25, false, buffer, sizeof(buffer)), "0.25");
        setlocale(LC_ALL, "C");
    }
    if (!found) {
        print_message("# skipped: no locale with another decimal point is installed\n");
        skip();
    }
}

static void numbers_print_shortest_and_read_back(void **state)
{
    static const struct {
        double value;
        bool single;
        const char *text;
    } cases[] = { { 0.1, false, "0.1" },
                  { 0.1f, true, "0.1" },
                  { 1.0 / 3, false, "0.3333333333333333" },
                  { 1e300, false, "1e+300" },
                  { -2, false, "-2" },
                  { 16777216, true, "16777216" },
                  { 5e-324, false, "4.94065645841247e-324" },
                  { 0.2 + 0.1, false, "0.30000000000000004" } };
    char buffer[40];
    uint64_t seed = 7;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++)
        assert_string_equal(pell_format_number(cases[i].value, cases[i].single, buffer, sizeof(buffer)), cases[i].text);
    for (int i = 0; i < 20000; i++) {
        double value, back;
        uint64_t bits;

        seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
        bits = seed ^ seed >> 31;
        memcpy(&value, &bits, sizeof(value));
        if (!isfinite(value))
            continue;
        pell_format_number(value, false, buffer, sizeof(buffer));
        assert_true(pell_parse_number(buffer, strlen(buffer), &back));
        assert_memory_equal(&value, &back, sizeof(value));
    }
    assert_string_equal(pell_format_number(123456, false, buffer, 4), "123");
}

static void integers_stop_at_64_bits(void **state)
{
    static const char *const bad[] = {
        "", "+", "-", "1.0", "1e3", " 1", "1 ", "0x1", "9223372036854775808", "-9223372036854775809", "99999999999999999999999999"
    };
    int64_t value = 0;
    (void) state;

    assert_true(pell_parse_int("9223372036854775807", 19, &value));
    assert_true(value == INT64_MAX);
    assert_true(pell_parse_int("-9223372036854775808", 20, &value));
    assert_true(value == INT64_MIN);
    assert_true(pell_parse_int("+0012", 5, &value));
    assert_true(value == 12);
    for (size_t i = 0; i < PELL_COUNT(bad); i++)
        if (pell_parse_int(bad[i], strlen(bad[i]), &value))
            fail_msg("'%s' is taken as %lld", bad[i], (long long) value);
    assert_true(value == 12);
}

/* --- lengths --- */

static void lengths_of_all_units_are_exact(void **state)
{
    static const struct {
        const char *text;
        double mm;
    } cases[] = {
        { "70mm", 70 }, { "7 cm", 70 },      { "0.07m", 70 },        { "1e3um", 1 },         { "2in", 50.8 },
        { "1km", 1e6 }, { "250nm", 250e-6 }, { "3\xc2\xb5m", 3e-3 }, { "3\xce\xbcm", 3e-3 }, { "1e-3m", 1 },
        { "+5mm", 5 },  { ".5in", 12.7 },    { "1e3   mm", 1000 },
    };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        double mm = -1;
        if (pell_parse_length(ctx, "--size", cases[i].text, &mm) != PELL_OK || fabs(mm - cases[i].mm) > 1e-15 * cases[i].mm)
            fail_msg("'%s' gives %.17g mm, not %.17g", cases[i].text, mm, cases[i].mm);
    }
    assert_int_equal(kept.errors, 0);
    pell_context_destroy(&ctx);
}

static void lengths_without_a_unit_are_refused_with_a_hint(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    double mm = -1;
    (void) state;

    assert_int_equal(pell_parse_length(ctx, "--size", "70", &mm), PELL_ERR_INVALID);
    assert_int_equal(kept.errors, 1);
    assert_string_equal(kept.where, "--size");
    assert_non_null(strstr(kept.what, "\"70\" has no unit"));
    assert_non_null(strstr(kept.what, "nm, um, mm, cm, m, km or in"));
    assert_non_null(strstr(kept.hint, "70mm"));
    assert_int_equal(pell_parse_length(ctx, "--size", "70ft", &mm), PELL_ERR_INVALID);
    assert_non_null(strstr(kept.what, "unknown unit"));
    assert_true(mm == -1);
    pell_context_destroy(&ctx);
}

static void lengths_must_be_finite_and_above_zero(void **state)
{
    static const char *const bad[] = { "",       "mm",       " 70mm",    "70mm ",  "-1mm",  "0mm",  "nanmm",
                                       "infmm",  "1e308km",  "1e-323nm", "70 m m", "7 0mm", "70MM", "70\tmm",
                                       "0x10mm", "1e5000mm", "70\xff",   "70mm\n", "1,5mm" };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    double mm = -1;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        if (pell_parse_length(ctx, "--size", bad[i], &mm) != PELL_ERR_INVALID)
            fail_msg("'%s' is taken as %g mm", bad[i], mm);
        assert_int_equal(kept.errors, i + 1);
    }
    assert_true(mm == -1);
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_truncates_and_stays_terminated),
        cmocka_unit_test(nearest_finds_slips_and_pieces_only),
        cmocka_unit_test(of_many_pieces_the_shortest_are_suggested),
        cmocka_unit_test(what_is_near_nothing_gets_the_list),
        cmocka_unit_test(counts_agree_with_their_nouns),
        cmocka_unit_test(printable_keeps_good_utf8_and_masks_the_rest),
        cmocka_unit_test(printable_cuts_long_texts_between_characters),
        cmocka_unit_test(numbers_refuse_what_is_not_wholly_a_number),
        cmocka_unit_test(numbers_stop_at_the_given_length),
        cmocka_unit_test(numbers_are_exact),
        cmocka_unit_test(numbers_round_right_after_a_thousand_digits),
        cmocka_unit_test(numbers_agree_with_the_c_library),
        cmocka_unit_test(numbers_do_not_depend_on_the_locale),
        cmocka_unit_test(numbers_print_shortest_and_read_back),
        cmocka_unit_test(integers_stop_at_64_bits),
        cmocka_unit_test(lengths_of_all_units_are_exact),
        cmocka_unit_test(lengths_without_a_unit_are_refused_with_a_hint),
        cmocka_unit_test(lengths_must_be_finite_and_above_zero),
    };
    return cmocka_run_group_tests_name("text", tests, NULL, NULL);
}
