/* SPDX-License-Identifier: MIT
 * test_replace.c - shaders from a folder: valid replacements of built-in ones, refusals, and a pass that reloads its file. Tests that
 * need a device are skipped, by name, where there is no driver or no validation layer. */
#include "gpu_test.h"

#include "vulkan/spirv.h"

#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

enum {
    COUNT = 64,
    DECORATE = 71,
    MEMBER_DECORATE = 72,
    CONSTANT = 43,
    CAPABILITY = 17,
    VARIABLE = 59,
    BUILT_IN = 11,
    NON_WRITABLE = 24,
    WORKGROUP_SIZE = 25,
    INVOCATION = 28,
    NON_READABLE = 25,
    BINDING = 33,
    SET = 34,
    OFFSET = 35
};

extern const struct pell_shader pell_test_scale_shader, pell_test_grow_shader, pell_test_twice_shader;

/* A module that may be changed. */
struct code {
    uint32_t words[2048];
    size_t size;
};

static struct code code_of(const struct pell_shader *shader)
{
    struct code c = { .size = shader->size };

    REQUIRE(shader->size <= sizeof(c.words));
    memcpy(c.words, shader->words, shader->size);
    return c;
}

static const char *refused(struct pell_context *ctx, const struct code *c)
{
    const char *why;

    assert_int_equal(pell_spirv_check(ctx, c->words, c->size, &pell_test_scale_shader, &why), PELL_OK);
    return why;
}

/* The first instruction with that opcode whose words after the first `skip` are these two. */
static uint32_t *find(struct code *c, uint32_t op, size_t skip, uint32_t a, uint32_t b)
{
    for (size_t at = 5; at < c->size / 4; at += c->words[at] >> 16)
        if ((c->words[at] & 0xffffu) == op && c->words[at + skip] == a && c->words[at + skip + 1] == b)
            return c->words + at;
    fail_msg("no such instruction");
    return NULL;
}

static void require_refused(struct pell_context *ctx, const struct code *c, const char *expected)
{
    const char *why = refused(ctx, c);

    if (!why || strcmp(why, expected) != 0)
        fail_msg("%s, not %s", why ? why : "taken", expected);
}

static void what_declares_the_same_may_stand_in(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct code c = code_of(&pell_test_twice_shader);
    (void) state;

    assert_null(refused(ctx, &c));
    c = code_of(&pell_test_scale_shader);
    assert_null(refused(ctx, &c));
    c = code_of(&pell_test_grow_shader); /* it reads bindings that only scale.comp writes, and has no such constants */
    assert_non_null(refused(ctx, &c));
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void what_declares_something_else_is_refused(void **state)
{
    static const char binding[] = "has a buffer at a binding that the built-in shader has none at";
    const struct code good = code_of(&pell_test_twice_shader);
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_shader any = pell_test_scale_shader;
    const char *why;
    struct code c;
    (void) state;

    any.access[0] = any.access[1] = PELL_GPU_READS | PELL_GPU_WRITES;
    c = good;
    c.words[0] = 0x07230204;
    require_refused(ctx, &c, "is no SPIR-V");
    c.words[0] = 0x03022307;
    require_refused(ctx, &c, "is of the other byte order");
    c = good;
    c.words[1] = 0x00020000;
    require_refused(ctx, &c, "is of a version other than 1.0 to 1.6");
    c = good;
    c.words[3] = 0x7fffffff;
    require_refused(ctx, &c, "has a damaged header");
    c = good;
    c.size--;
    require_refused(ctx, &c, "is not between 20 bytes and 4 MiB of words");
    c = good;
    find(&c, CAPABILITY, 0, c.words[5], 1)[1] = 22; /* 16 bits */
    require_refused(ctx, &c, "needs capabilities that the device was not asked for");
    for (uint32_t to = 2; to < 40; to += 9) {
        c = good;
        find(&c, DECORATE, 2, BINDING, 1)[3] = to;
        require_refused(ctx, &c, binding);
    }
    c = good;
    find(&c, DECORATE, 2, BINDING, 1)[3] = 0;
    assert_int_equal(pell_spirv_check(ctx, c.words, c.size, &any, &why), PELL_OK);
    assert_string_equal(why, "has two buffers at one binding");
    any.local[1] = 2;
    assert_int_equal(pell_spirv_check(ctx, good.words, good.size, &any, &why), PELL_OK);
    assert_string_equal(why, "has another workgroup than the built-in shader");
    c = good; /* the workgroup's size is not a constant */
    find(&c, DECORATE, 2, BUILT_IN, INVOCATION)[3] = WORKGROUP_SIZE;
    require_refused(ctx, &c, "has another workgroup than the built-in shader");
    c = good;
    find(&c, DECORATE, 2, SET, 0)[2] = BINDING; /* twice on one variable */
    require_refused(ctx, &c, "decorates something twice");
    c = good;
    find(&c, DECORATE, 2, SET, 0)[3] = 1;
    require_refused(ctx, &c, binding);
    c = good; /* a read-only buffer is written, too */
    find(&c, MEMBER_DECORATE, 2, 0, NON_WRITABLE)[3] = 0;
    require_refused(ctx, &c, "reads or writes a buffer that the built-in shader does not");
    c = good;
    find(&c, MEMBER_DECORATE, 2, 0, NON_READABLE)[3] = 0;
    require_refused(ctx, &c, "reads or writes a buffer that the built-in shader does not");
    c = good; /* the second push constant lies beyond the first 8 bytes */
    find(&c, MEMBER_DECORATE, 2, 1, OFFSET)[4] = 8;
    require_refused(ctx, &c, "has other push constants than the built-in shader");
    c = good;
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

/* Truncated anywhere it is refused; with a word changed it is accepted or refused, without a read out of bounds. */
static void damaged_code_is_refused_or_declares_the_same(void **state)
{
    const struct code good = code_of(&pell_test_twice_shader);
    struct pell_context *ctx = test_context(NULL, NULL);
    uint32_t seed = 5;
    int taken = 0;
    (void) state;

    for (size_t size = 0; size < good.size; size++) {
        uint32_t *words = malloc(size + 4); /* the memory behind is the sanitizer's */
        const char *why;
        memcpy(words, good.words, size);
        words = realloc(words, size ? size : 1);
        assert_int_equal(pell_spirv_check(ctx, words, size, &pell_test_scale_shader, &why), PELL_OK);
        assert_non_null(why);
        free(words);
    }
    for (int i = 0; i < 20000; i++) {
        struct code c = good;
        for (int k = i % 3; k >= 0; k--) {
            seed = seed * 1664525u + 1013904223u;
            c.words[(seed >> 8) % (c.size / 4)] = seed >> 16 & 3 ? seed >> 7 & 0x1ffu : seed * 2654435761u;
        }
        taken += refused(ctx, &c) == NULL;
    }
    print_message("# %d of 20000 taken\n", taken); /* code of functions is not checked */
    REQUIRE(taken > 0 && taken < 15000);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

/* --- A pass and its file -------------------------------------------------------------------------------------------------------------- */

static char folder[64], path[128];

/* Each version of the file has a time of its own. */
static void write_file(const void *data, size_t size)
{
    static time_t second = 1000000;
    struct timespec times[2] = { { 0 } };
    FILE *file = fopen(path, "wb");

    times[0].tv_sec = times[1].tv_sec = ++second;
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    fclose(file);
    assert_int_equal(utimensat(AT_FDCWD, path, times, 0), 0);
}

struct work {
    struct pell_gpu_buffer *in, *out;
    struct pell_gpu_pass *pass;
    struct pell_gpu_commands *commands;
};

/* The result for an input of 1. */
static float run(struct work *w)
{
    const struct {
        int32_t count;
        float add;
    } push = { COUNT, 0.5f };
    float *in = pell_gpu_buffer_host(w->in);

    for (int i = 0; i < COUNT; i++)
        in[i] = 1.0f;
    assert_int_equal(pell_gpu_begin(w->commands), PELL_OK);
    pell_gpu_run(w->commands, w->pass, &push, 1, 1, 1);
    pell_gpu_run(w->commands, w->pass, &push, 1, 1, 1);
    assert_int_equal(pell_gpu_finish(w->commands), PELL_OK);
    return *(float *) pell_gpu_buffer_host(w->out);
}

static void a_pass_follows_its_file(void **state)
{
    const struct pell_shader *twice = &pell_test_twice_shader;
    const struct pell_gpu_params params = { .validate = true, .shaders = folder };
    const float scale = 3.0f;
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &kept);
    struct work w = { 0 };
    struct code broken = code_of(twice);
    struct pell_gpu *gpu;
    uint32_t bits;
    (void) state;

    snprintf(folder, sizeof(folder), "/tmp/pell_replace_XXXXXX");
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof(path), "%s/test_scale.spv", folder);
    memcpy(&bits, &scale, sizeof(bits));
    assert_int_equal(pell_gpu_open(ctx, &params, &gpu), PELL_OK);
    assert_int_equal(pell_gpu_buffer_create(gpu, PELL_GPU_TO_DEVICE, 4 * COUNT, "in", &w.in), PELL_OK);
    assert_int_equal(pell_gpu_buffer_create(gpu, PELL_GPU_FROM_DEVICE, 4 * COUNT, "out", &w.out), PELL_OK);
    assert_int_equal(pell_gpu_pass_create(gpu, &pell_test_scale_shader, &bits, 1, (struct pell_gpu_buffer *[]) { w.in, w.out }, &w.pass),
                     PELL_OK);
    assert_int_equal(pell_gpu_commands_create(gpu, "test", &w.commands), PELL_OK);

    assert_true(run(&w) == 3.5f);
    write_file(twice->words, twice->size);
    assert_true(run(&w) == 6.5f && kept.warnings == 0); /* with the constant of the built-in one */
    write_file(twice->words, twice->size / 2);
    assert_true(run(&w) == 6.5f && kept.warnings == 1);
    assert_int_equal(strncmp(kept.last_warning, path, strlen(path)), 0);
    assert_true(run(&w) == 6.5f && kept.warnings == 1); /* once for each version */
    broken.words[0] = 1;
    write_file(broken.words, broken.size);
    assert_true(run(&w) == 6.5f && kept.warnings == 2);
    assert_non_null(strstr(kept.last_warning, "is no SPIR-V"));
    pell_gpu_pass_destroy(&w.pass); /* one that is created while the file is damaged uses the last valid one, too */
    assert_int_equal(pell_gpu_pass_create(gpu, &pell_test_scale_shader, &bits, 1, (struct pell_gpu_buffer *[]) { w.in, w.out }, &w.pass),
                     PELL_OK);
    assert_true(run(&w) == 6.5f && kept.warnings == 2);
    write_file("", 0);
    assert_true(run(&w) == 6.5f && kept.warnings == 3);
    write_file(pell_test_scale_shader.words, pell_test_scale_shader.size);
    assert_true(run(&w) == 3.5f && kept.warnings == 3);
    write_file(twice->words, twice->size);
    assert_true(run(&w) == 6.5f);
    assert_int_equal(unlink(path), 0);
    assert_true(run(&w) == 3.5f && kept.warnings == 3); /* the built-in one again */
    assert_int_equal(mkdir(path, 0700), 0);
    assert_true(run(&w) == 3.5f && kept.warnings == 4);
    assert_int_equal(rmdir(path), 0);
    assert_int_equal(rmdir(folder), 0);

    pell_gpu_commands_destroy(&w.commands);
    pell_gpu_pass_destroy(&w.pass);
    pell_gpu_buffer_destroy(&w.in);
    pell_gpu_buffer_destroy(&w.out);
    REQUIRE(pell_gpu_memory_used(gpu) == 0 && kept.errors == 0);
    pell_gpu_close(&gpu);
    REQUIRE(pell_memory_used(ctx) < 1024); /* the context knows which files were read */
    pell_context_destroy(&ctx);
}

/* A folder, a device that looks there, and the objects of a pass. */
struct rig {
    struct kept_messages kept;
    struct pell_alloc_fault fault;
    struct pell_context *ctx;
    struct pell_gpu *gpu;
    struct work work;
    uint32_t bits; /* of 3 */
};

static void rig_open(struct rig *r)
{
    const struct pell_gpu_params params = { .shaders = folder };
    const float scale = 3.0f;

    memset(r, 0, sizeof(*r));
    r->ctx = gpu_context(&r->fault, &r->kept);
    snprintf(folder, sizeof(folder), "/tmp/pell_replace_XXXXXX");
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof(path), "%s/test_scale.spv", folder);
    memcpy(&r->bits, &scale, sizeof(r->bits));
    assert_int_equal(pell_gpu_open(r->ctx, &params, &r->gpu), PELL_OK);
    assert_int_equal(pell_gpu_buffer_create(r->gpu, PELL_GPU_TO_DEVICE, 4 * COUNT, "in", &r->work.in), PELL_OK);
    assert_int_equal(pell_gpu_buffer_create(r->gpu, PELL_GPU_FROM_DEVICE, 4 * COUNT, "out", &r->work.out), PELL_OK);
    assert_int_equal(pell_gpu_commands_create(r->gpu, "test", &r->work.commands), PELL_OK);
}

/* Another pass of the shader. */
static void rig_renew(struct rig *r)
{
    struct pell_gpu_buffer *buffers[] = { r->work.in, r->work.out };

    pell_gpu_pass_destroy(&r->work.pass);
    assert_int_equal(pell_gpu_pass_create(r->gpu, &pell_test_scale_shader, &r->bits, 1, buffers, &r->work.pass), PELL_OK);
}

static void rig_close(struct rig *r)
{
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(folder), 0);
    pell_gpu_commands_destroy(&r->work.commands);
    pell_gpu_pass_destroy(&r->work.pass);
    pell_gpu_buffer_destroy(&r->work.in);
    pell_gpu_buffer_destroy(&r->work.out);
    pell_gpu_close(&r->gpu);
    pell_context_destroy(&r->ctx);
}

static void what_no_driver_takes_is_warned_of_once(void **state)
{
    struct rig r;
    (void) state;

    rig_open(&r);
    write_file(pell_test_twice_shader.words, pell_test_twice_shader.size);
    for (int i = 0; i < 2; i++) {
        rig_renew(&r);
        pell_gpu_fail_at(r.gpu, 3); /* after the list's reset and its begin: the module */
        assert_true(run(&r.work) == 3.5f);
        assert_int_equal(r.kept.warnings, 1);
        assert_non_null(strstr(r.kept.last_warning, "the driver does not take it"));
    }
    rig_renew(&r);
    assert_true(run(&r.work) == 6.5f);
    write_file(pell_test_scale_shader.words, pell_test_scale_shader.size);
    pell_gpu_fail_at(r.gpu, 3);
    assert_true(run(&r.work) == 6.5f);
    assert_int_equal(r.kept.warnings, 2); /* that is another version */
    rig_close(&r);
}

/* A file whose reload failed for lack of memory is read again, although it has not changed. */
static void what_could_not_be_read_is_read_later(void **state)
{
    struct rig r;
    (void) state;

    rig_open(&r);
    rig_renew(&r);
    assert_true(run(&r.work) == 3.5f); /* from here on the file is monitored */
    write_file(pell_test_twice_shader.words, pell_test_twice_shader.size);
    r.fault.fail_at = atomic_load(&r.fault.calls) + 1;
    r.fault.sticky = true;
    assert_true(run(&r.work) == 3.5f);
    r.fault.fail_at = 0;
    r.fault.sticky = false;
    assert_true(run(&r.work) == 6.5f);
    rig_close(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_declares_the_same_may_stand_in),          cmocka_unit_test(what_declares_something_else_is_refused),
        cmocka_unit_test(damaged_code_is_refused_or_declares_the_same), cmocka_unit_test(a_pass_follows_its_file),
        cmocka_unit_test(what_no_driver_takes_is_warned_of_once),       cmocka_unit_test(what_could_not_be_read_is_read_later),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
