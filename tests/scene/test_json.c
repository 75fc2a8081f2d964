/* SPDX-License-Identifier: MIT
 * test_json.c - reading untrusted JSON: error positions, ranges, hints, depth, parse errors with line and column. */
#include "pell_test.h"
#include "scene/file/json.h"

struct fixture {
    struct pell_alloc_fault fault;
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_json_file file;
};

static struct pell_json parse(struct fixture *f, const char *text)
{
    memset(f, 0, sizeof(*f));
    f->ctx = test_context(&f->fault, &f->kept);
    assert_non_null(f->ctx);
    f->file = (struct pell_json_file) { .ctx = f->ctx, .path = "t.json" };
    assert_int_equal(pell_json_parse(&f->file, text, strlen(text)), PELL_OK);
    return pell_json_root(&f->file);
}

static void finish(struct fixture *f)
{
    pell_json_finish(&f->file);
    pell_context_destroy(&f->ctx);
    assert_int_equal(f->fault.live, 0);
}

static void refuse(const char *text, size_t size, enum pell_result code, const char *where)
{
    struct fixture f = { 0 };
    f.ctx = test_context(&f.fault, &f.kept);
    f.file = (struct pell_json_file) { .ctx = f.ctx, .path = "t.json" };
    assert_int_equal(pell_json_parse(&f.file, text, size), code);
    assert_null(f.file.root);
    assert_int_equal(f.kept.errors, 1);
    assert_string_equal(f.kept.where, where);
    finish(&f);
}

static void parse_errors_name_line_and_column(void **state)
{
    (void) state;
    refuse("{\n  \"a\": 1,\n  \"b\": }\n", 22, PELL_ERR_FORMAT, "t.json:3:8");
    refuse("", 0, PELL_ERR_FORMAT, "t.json:1:1");
    refuse("{\"a\":1}x", 8, PELL_ERR_FORMAT, "t.json:1:8");
    refuse("{\"a\":1,\"a\":2}", 13, PELL_ERR_FORMAT, "t.json:1:10");
    refuse("{\"a\":1e999}", 11, PELL_ERR_FORMAT, "t.json:1:10");
    refuse("{\"a\":\"\xff\"}", 9, PELL_ERR_FORMAT, "t.json:1:6");
    refuse("{\"a\":\"b\0c\"}", 11, PELL_ERR_FORMAT, "t.json:1:7");
    refuse("{\"a\":NaN}", 9, PELL_ERR_FORMAT, "t.json:1:8");
}

static void nesting_is_limited(void **state)
{
    char deep[2001];
    (void) state;
    memset(deep, '[', 1000);
    memset(deep + 1000, ']', 1000);
    deep[2000] = '\0';
    refuse(deep, 2000, PELL_ERR_INVALID, "t.json:1");
    memset(deep, '[', sizeof(deep));
    refuse(deep, sizeof(deep), PELL_ERR_INVALID, "t.json:1");
}

static void brackets_in_strings_are_no_nesting(void **state)
{
    struct fixture f;
    char text[4096];
    size_t n = 0;
    struct pell_json root;
    const char *value = NULL;

    (void) state;
    n += (size_t) snprintf(text, sizeof(text), "\xef\xbb\xbf{\"a\":\"\\\\\\\"");
    for (int i = 0; i < 1000; i++)
        text[n++] = '[';
    snprintf(text + n, sizeof(text) - n, "\\\\\"}");
    root = parse(&f, text);
    assert_int_equal(pell_json_string(&root, "a", &value), PELL_OK);
    assert_int_equal(strlen(value), 1003);
    finish(&f);
}

static void a_tree_larger_than_the_memory_limit_is_refused_before_it_is_built(void **state)
{
    struct pell_limits limits;
    struct kept_messages kept = { 0 };
    struct pell_context_params params = { .log = keep_message, .log_user = &kept, .limits = &limits };
    struct pell_context *ctx;
    struct pell_json_file file;
    enum { N = 2000000 };
    char *text = malloc(N);

    (void) state;
    assert_non_null(text);
    for (int i = 0; i < N; i++)
        text[i] = i % 2 ? ',' : '0';
    text[0] = '[';
    text[N - 1] = ']';
    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.memory_bytes = 16 << 20;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    file = (struct pell_json_file) { .ctx = ctx, .path = "t.json" };
    assert_int_equal(pell_json_parse(&file, text, N), PELL_ERR_NOMEM);
    assert_non_null(strstr(kept.what, "16777216"));
    pell_context_destroy(&ctx);
    free(text);
}

static void errors_carry_the_pointer_the_value_and_the_range(void **state)
{
    struct fixture f;
    const struct pell_json root = parse(&f, "{\"a\":[{\"x/y~z\":-2.5}]}"), a = pell_json_get(&root, "a"), e = pell_json_at(&a, 0);
    double x = 7;
    (void) state;
    assert_int_equal(pell_json_number(&e, "x/y~z", 0, 1, &x), PELL_ERR_INVALID);
    assert_string_equal(f.kept.where, "t.json:/a/0/x~1y~0z");
    assert_non_null(strstr(f.kept.what, "-2.5"));
    assert_non_null(strstr(f.kept.what, "[0, 1]"));
    assert_true(x == 7);
    finish(&f);
}

static void missing_keys_keep_the_default(void **state)
{
    struct fixture f;
    const struct pell_json root = parse(&f, "{}");
    struct pell_json child;
    double x = 1, v[3] = { 1, 2, 3 };
    float y = 2;
    int64_t i = 3;
    bool b = true;
    int choice = 4;
    const char *s = "d", *names[] = { "one" };
    (void) state;
    assert_int_equal(pell_json_number(&root, "k", 0, 0, &x), PELL_OK);
    assert_int_equal(pell_json_float(&root, "k", 0, 0, &y), PELL_OK);
    assert_int_equal(pell_json_int(&root, "k", 0, 0, &i), PELL_OK);
    assert_int_equal(pell_json_bool(&root, "k", &b), PELL_OK);
    assert_int_equal(pell_json_string(&root, "k", &s), PELL_OK);
    assert_int_equal(pell_json_numbers(&root, "k", 3, 0, 0, v), PELL_OK);
    assert_int_equal(pell_json_choice(&root, "k", names, 1, &choice), PELL_OK);
    assert_int_equal(pell_json_object(&root, "k", &child), PELL_OK);
    assert_null(child.value);
    assert_true(x == 1 && y == 2 && i == 3 && b && choice == 4 && v[2] == 3 && strcmp(s, "d") == 0);
    assert_int_equal(f.kept.errors, 0);
    assert_int_equal(pell_json_require(&root, "k"), PELL_ERR_FORMAT);
    assert_string_equal(f.kept.where, "t.json:/");
    finish(&f);
}

static void wrong_types_are_named(void **state)
{
    struct fixture f;
    const struct pell_json root = parse(&f, "{\"n\":1.5,\"s\":\"text\",\"a\":[1,2],\"b\":true,\"o\":{},\"z\":null}");
    struct pell_json child;
    double x, v[3];
    int64_t i;
    bool b;
    const char *s;
    (void) state;
    assert_int_equal(pell_json_number(&root, "s", 0, 1, &x), PELL_ERR_FORMAT);
    assert_string_equal(f.kept.what, "is \"text\", allowed: a number");
    assert_int_equal(pell_json_int(&root, "n", 0, 9, &i), PELL_ERR_FORMAT);
    assert_string_equal(f.kept.what, "is 1.5, allowed: a whole number");
    assert_int_equal(pell_json_numbers(&root, "a", 3, 0, 9, v), PELL_ERR_FORMAT);
    assert_string_equal(f.kept.what, "is an array of 2, allowed: an array of 3 numbers");
    assert_int_equal(pell_json_bool(&root, "z", &b), PELL_ERR_FORMAT);
    assert_string_equal(f.kept.what, "is null, allowed: true or false");
    assert_int_equal(pell_json_string(&root, "o", &s), PELL_ERR_FORMAT);
    assert_string_equal(f.kept.what, "is an object, allowed: a string");
    assert_int_equal(pell_json_object(&root, "b", &child), PELL_ERR_FORMAT);
    assert_string_equal(f.kept.what, "is true, allowed: an object");
    assert_int_equal(pell_json_array(&root, "a", 3, 4, &child), PELL_ERR_INVALID);
    assert_string_equal(f.kept.what, "has 2 elements, allowed: 3 to 4");
    finish(&f);
}

static void whole_numbers_beyond_a_double_are_exact_or_refused(void **state)
{
    struct fixture f;
    const struct pell_json root = parse(&f, "{\"i\":9007199254740993,\"r\":1e300,\"w\":3.0,\"m\":-9223372036854775808}");
    int64_t i = 0;
    (void) state;
    assert_int_equal(pell_json_int(&root, "i", 0, INT64_MAX, &i), PELL_OK);
    assert_true(i == 9007199254740993);
    assert_int_equal(pell_json_int(&root, "r", 0, INT64_MAX, &i), PELL_ERR_INVALID);
    assert_int_equal(pell_json_int(&root, "w", 0, 3, &i), PELL_OK);
    assert_true(i == 3);
    assert_int_equal(pell_json_int(&root, "m", INT64_MIN, 0, &i), PELL_OK);
    assert_true(i == INT64_MIN);
    finish(&f);
}

static void unknown_keys_and_names_get_the_nearest_as_hint(void **state)
{
    static const char *const keys[] = { "roughness", "specular", "mix" };
    struct fixture f;
    struct pell_json root = parse(&f, "{\"rougness\":1}");
    int choice = -1;
    (void) state;
    assert_int_equal(pell_json_only(&root, keys, 3), PELL_ERR_INVALID);
    assert_string_equal(f.kept.where, "t.json:/rougness");
    assert_string_equal(f.kept.hint, "did you mean \"roughness\"?");
    finish(&f);
    root = parse(&f, "{\"quite different\":1}");
    assert_int_equal(pell_json_only(&root, keys, 3), PELL_ERR_INVALID);
    assert_string_equal(f.kept.hint, "known keys: roughness, specular, mix");
    finish(&f);
    root = parse(&f, "{\"k\":\"speculr\",\"l\":\"mix\"}");
    assert_int_equal(pell_json_choice(&root, "k", keys, 3, &choice), PELL_ERR_INVALID);
    assert_string_equal(f.kept.what, "is \"speculr\", allowed: roughness, specular, mix");
    assert_string_equal(f.kept.hint, "did you mean \"specular\"?");
    assert_int_equal(pell_json_choice(&root, "l", keys, 3, &choice), PELL_OK);
    assert_int_equal(choice, 2);
    assert_int_equal(pell_json_only(&root, keys, 0), PELL_ERR_INVALID);
    finish(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parse_errors_name_line_and_column),
        cmocka_unit_test(nesting_is_limited),
        cmocka_unit_test(brackets_in_strings_are_no_nesting),
        cmocka_unit_test(a_tree_larger_than_the_memory_limit_is_refused_before_it_is_built),
        cmocka_unit_test(errors_carry_the_pointer_the_value_and_the_range),
        cmocka_unit_test(missing_keys_keep_the_default),
        cmocka_unit_test(wrong_types_are_named),
        cmocka_unit_test(whole_numbers_beyond_a_double_are_exact_or_refused),
        cmocka_unit_test(unknown_keys_and_names_get_the_nearest_as_hint),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
