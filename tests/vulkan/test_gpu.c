/* SPDX-License-Identifier: MIT
 * test_gpu.c - buffers, passes and command lists on a Vulkan device, under the validation layer: any message of it is an error. */
#include "gpu_test.h"

#include "vulkan/core.h"
#include "vulkan/devices.h"

enum { COUNT = 1000 };

extern const struct pell_shader pell_test_scale_shader, pell_test_grow_shader;

/* From `in` to `out`: out = 2 (3 in + add) + in. */
struct work {
    struct pell_gpu_buffer *in, *from, *to, *out;
    struct pell_gpu_pass *scale, *grow;
    struct pell_gpu_commands *commands;
};

static void work_destroy(struct work *w)
{
    pell_gpu_commands_destroy(&w->commands);
    pell_gpu_pass_destroy(&w->grow);
    pell_gpu_pass_destroy(&w->scale);
    pell_gpu_buffer_destroy(&w->out);
    pell_gpu_buffer_destroy(&w->to);
    pell_gpu_buffer_destroy(&w->from);
    pell_gpu_buffer_destroy(&w->in);
}

static enum pell_result work_create(struct pell_gpu *gpu, struct work *w)
{
    const uint64_t size = COUNT * sizeof(float);
    const float scale = 3.0f;
    uint32_t bits;
    enum pell_result res;

    *w = (struct work) { 0 };
    memcpy(&bits, &scale, sizeof(bits));
    PELL_TRY(pell_gpu_buffer_create(gpu, PELL_GPU_TO_DEVICE, size, "in", &w->in));
    PELL_TRY(pell_gpu_buffer_create(gpu, PELL_GPU_ON_DEVICE, size, "from", &w->from));
    PELL_TRY(pell_gpu_buffer_create(gpu, PELL_GPU_ON_DEVICE, size, "to", &w->to));
    PELL_TRY(pell_gpu_buffer_create(gpu, PELL_GPU_FROM_DEVICE, size, "out", &w->out));
    PELL_TRY(pell_gpu_pass_create(gpu, &pell_test_scale_shader, &bits, 1, (struct pell_gpu_buffer *[]) { w->from, w->to }, &w->scale));
    PELL_TRY(pell_gpu_pass_create(gpu, &pell_test_grow_shader, NULL, 0, (struct pell_gpu_buffer *[]) { w->to, w->from }, &w->grow));
    PELL_TRY(pell_gpu_commands_create(gpu, "test", &w->commands));
    return PELL_OK;

fail:
    return res;
}

static enum pell_result work_run(struct work *w, float first, float add)
{
    const struct {
        int32_t count;
        float add;
    } push = { COUNT, add };
    float *in = pell_gpu_buffer_host(w->in);
    enum pell_result res;

    for (int i = 0; i < COUNT; i++)
        in[i] = first + (float) i;
    PELL_TRY(pell_gpu_begin(w->commands));
    pell_gpu_mark(w->commands, "up");
    pell_gpu_copy(w->commands, w->in, w->from, COUNT * sizeof(float));
    pell_gpu_mark(w->commands, "scale");
    pell_gpu_run(w->commands, w->scale, &push, (COUNT + 63) / 64, 1, 1);
    pell_gpu_mark(w->commands, "grow");
    pell_gpu_run(w->commands, w->grow, &push, (COUNT + 63) / 64, 1, 1);
    pell_gpu_mark(w->commands, "down");
    pell_gpu_copy(w->commands, w->to, w->out, COUNT * sizeof(float));
    PELL_TRY(pell_gpu_finish(w->commands));
    return PELL_OK;

fail:
    return res;
}

static void require_result(const struct work *w, float first, float add)
{
    const float *out = pell_gpu_buffer_host(w->out);

    for (int i = 0; i < COUNT; i++)
        REQUIRE(out[i] == 2.0f * (3.0f * (first + (float) i) + add) + first + (float) i);
}

static void passes_follow_one_another(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &kept);
    struct pell_gpu *gpu = gpu_opened(ctx);
    struct pell_gpu_time times[8];
    struct work w;
    (void) state;

    assert_true(pell_gpu_name(gpu)[0] != '\0');
    assert_int_equal(work_create(gpu, &w), PELL_OK);
    for (int frame = 0; frame < 3; frame++) {
        const uint64_t calls = pell_allocations(ctx);
        assert_int_equal(work_run(&w, (float) frame, 7.0f), PELL_OK);
        require_result(&w, (float) frame, 7.0f);
        assert_true(pell_allocations(ctx) == calls);
    }
    assert_int_equal(pell_gpu_times(w.commands, times, PELL_COUNT(times)), 4);
    assert_string_equal(times[0].name, "up");
    assert_string_equal(times[3].name, "down");
    for (int i = 0; i < 4; i++)
        REQUIRE(times[i].seconds >= 0.0 && times[i].seconds < 10.0);
    assert_true(pell_gpu_memory_used(gpu) >= 4 * COUNT * sizeof(float));
    work_destroy(&w);
    assert_true(pell_gpu_memory_used(gpu) == 0);
    pell_gpu_close(&gpu);
    assert_int_equal(pell_memory_used(ctx), 0);
    if (kept.errors)
        fail_msg("%d messages, the last: %s", kept.errors, kept.what);
    pell_context_destroy(&ctx);
}

/* The validation layer is active: leaked objects cause a message. */
/* A shader is compiled once per value of its constants, and stays compiled when its passes are destroyed. */
static void passes_share_what_is_compiled(void **state)
{
    const uint32_t other = 0x40000000; /* 2 */
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &kept);
    struct pell_gpu *gpu = gpu_opened(ctx);
    const struct pell_vk_program *scale, *grow;
    struct pell_gpu_pass *twice;
    struct work w, again;
    (void) state;

    assert_int_equal(work_create(gpu, &w), PELL_OK);
    assert_int_equal(pell_gpu_pass_create(gpu, &pell_test_scale_shader, &other, 1, (struct pell_gpu_buffer *[]) { w.from, w.to }, &twice),
                     PELL_OK);
    scale = w.scale->program;
    grow = w.grow->program;
    assert_true(scale != grow && twice->program != scale && twice->program != grow);
    pell_gpu_pass_destroy(&twice);
    work_destroy(&w);
    assert_int_equal(work_create(gpu, &again), PELL_OK);
    assert_true(again.scale->program == scale && again.grow->program == grow);
    assert_int_equal(work_run(&again, 1.0f, 7.0f), PELL_OK);
    require_result(&again, 1.0f, 7.0f);
    work_destroy(&again);
    pell_gpu_close(&gpu);
    assert_int_equal(kept.errors, 0);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void what_is_forgotten_is_a_message(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &kept);
    struct pell_gpu *gpu = gpu_opened(ctx);
    struct pell_gpu_buffer *forgotten;
    (void) state;

    assert_int_equal(pell_gpu_buffer_create(gpu, PELL_GPU_ON_DEVICE, 64, "forgotten", &forgotten), PELL_OK);
    pell_gpu_close(&gpu);
    assert_true(kept.errors > 0);
    assert_string_equal(kept.where, "vulkan validation");
}

/* Each Vulkan call that can fail does so once: it is reported, once, and nothing leaks. */
static void calls_that_fail_leave_nothing(void **state)
{
    struct kept_messages none = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &none);
    struct pell_gpu *gpu = gpu_opened(ctx);
    uint64_t n;
    enum pell_result res = PELL_ERR_NOMEM;
    (void) state;

    pell_gpu_close(&gpu);
    pell_context_destroy(&ctx);
    for (n = 1; res != PELL_OK; n++) {
        struct kept_messages kept = { 0 };
        const struct pell_gpu_params params = { .validate = n % 8 == 1, .fail_at = n };
        struct work w = { 0 };

        ctx = test_context(NULL, &kept);
        res = pell_gpu_open(ctx, &params, &gpu);
        if (res == PELL_OK)
            res = work_create(gpu, &w);
        if (res == PELL_OK)
            res = work_run(&w, 1.0f, 2.0f);
        if (res == PELL_OK)
            require_result(&w, 1.0f, 2.0f);
        work_destroy(&w);
        pell_gpu_close(&gpu);
        assert_int_equal(pell_memory_used(ctx), 0);
        if (!(res == PELL_OK ? kept.errors == 0 : res == PELL_ERR_NOMEM && kept.errors == 1))
            fail_msg("call %d: result %d, %d messages, the last: %s", (int) n, (int) res, kept.errors, kept.what);
        pell_context_destroy(&ctx);
        REQUIRE(n < 200);
    }
    print_message("# %d calls\n", (int) n - 1);
    REQUIRE(n > 30);
}

/* The device is lost in each call of creation and execution, once: it is reported, once, and objects can be released. */
static void a_lost_device_is_reported(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &kept);
    struct pell_gpu *gpu = gpu_opened(ctx);
    enum pell_result res = PELL_ERR_DEVICE;
    int lost = 0;
    (void) state;

    atomic_store(&gpu->fail_lost, true);
    for (uint64_t n = 1; res != PELL_OK; n++) {
        struct work w = { 0 };
        kept.errors = 0;
        pell_gpu_fail_at(gpu, n);
        res = work_create(gpu, &w);
        if (res == PELL_OK)
            res = work_run(&w, 1.0f, 2.0f);
        REQUIRE(res == PELL_OK ? kept.errors == 0 : res == PELL_ERR_DEVICE && kept.errors == 1 && strstr(kept.what, "the device was lost"));
        work_destroy(&w);
        pell_vk_programs_destroy(gpu); /* so that each of their calls is reached */
        lost += res != PELL_OK;
        REQUIRE(kept.errors == (res != PELL_OK) && pell_gpu_memory_used(gpu) == 0);
    }
    print_message("# lost in %d calls\n", lost);
    REQUIRE(lost > 30);
    pell_gpu_close(&gpu);
    REQUIRE(kept.errors == 0);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void lack_of_memory_leaves_nothing(void **state)
{
    struct kept_messages none = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &none);
    struct pell_gpu *gpu = gpu_opened(ctx);
    enum pell_result res = PELL_ERR_NOMEM;
    (void) state;

    pell_gpu_close(&gpu);
    pell_context_destroy(&ctx);
    for (uint64_t n = 1; res != PELL_OK; n++) {
        struct pell_alloc_fault fault = { 0 };
        struct kept_messages kept = { 0 };
        struct work w = { 0 };

        ctx = test_context(&fault, &kept);
        fault.fail_at = atomic_load(&fault.calls) + n;
        res = pell_gpu_open(ctx, NULL, &gpu);
        if (res == PELL_OK)
            res = work_create(gpu, &w);
        REQUIRE(res == PELL_OK || (res == PELL_ERR_NOMEM && kept.errors == 1));
        work_destroy(&w);
        pell_gpu_close(&gpu);
        assert_int_equal(pell_memory_used(ctx), 0);
        fault.fail_at = 0;
        pell_context_destroy(&ctx);
    }
}

/* Buffers are created and destroyed in an order that leaves gaps: no two overlap, and all memory is freed. */
static void buffers_share_blocks_and_no_byte(void **state)
{
    enum { BUFFERS = 64 };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &kept);
    struct pell_gpu *gpu = gpu_opened(ctx);
    struct pell_gpu_buffer *b[BUFFERS] = { NULL };
    uint64_t size[BUFFERS];
    uint32_t random = 1;
    (void) state;

    for (int round = 0; round < 400; round++) {
        const int i = (int) ((random = random * 1664525u + 1013904223u) >> 16) % BUFFERS;
        if (b[i]) {
            const unsigned char *host = pell_gpu_buffer_host(b[i]);
            for (uint64_t k = 0; k < size[i]; k++)
                REQUIRE(host[k] == i);
            pell_gpu_buffer_destroy(&b[i]);
        } else {
            size[i] = 1 + (random >> 8) % 5000;
            assert_int_equal(pell_gpu_buffer_create(gpu, PELL_GPU_TO_DEVICE, size[i], "piece", &b[i]), PELL_OK);
            memset(pell_gpu_buffer_host(b[i]), i, (size_t) size[i]);
        }
    }
    for (int i = 0; i < BUFFERS; i++)
        pell_gpu_buffer_destroy(&b[i]);
    assert_true(pell_gpu_memory_used(gpu) == 0);
    assert_int_equal(pell_gpu_buffer_create(gpu, PELL_GPU_ON_DEVICE, UINT64_C(1) << 60, "huge", &b[0]), PELL_ERR_UNSUPPORTED);
    REQUIRE(strstr(kept.what, "buffer huge") && kept.errors == 1);
    pell_gpu_close(&gpu);
    assert_int_equal(pell_memory_used(ctx), 0);
    assert_int_equal(kept.errors, 1);
    pell_context_destroy(&ctx);
}

static void devices_are_chosen_by_number_or_name(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &kept);
    struct pell_gpu *gpu = gpu_opened(ctx);
    struct pell_vulkan_devices devices;
    char number[16], piece[8];
    (void) state;

    pell_gpu_close(&gpu);
    assert_int_equal(pell_vulkan_devices_find(ctx, &devices), PELL_OK);
    snprintf(number, sizeof(number), "%d", devices.taken);
    snprintf(piece, sizeof(piece), "%.7s", devices.list[devices.taken].name);
    for (size_t i = 0; piece[i]; i++)
        piece[i] = piece[i] >= 'a' && piece[i] <= 'z' ? (char) (piece[i] - 'a' + 'A') : piece[i];
    for (int i = 0; i < 2; i++) {
        assert_int_equal(pell_gpu_open(ctx, &(struct pell_gpu_params) { .device = i ? piece : number }, &gpu), PELL_OK);
        if (i == 0)
            assert_string_equal(pell_gpu_name(gpu), devices.list[devices.taken].name);
        pell_gpu_close(&gpu);
    }
    assert_int_equal(pell_gpu_open(ctx, &(struct pell_gpu_params) { .device = "no such device" }, &gpu), PELL_ERR_DEVICE);
    assert_null(gpu);
    REQUIRE(strstr(kept.what, "no such device") && strstr(kept.hint, devices.list[0].name));
    assert_int_equal(pell_gpu_open(ctx, &(struct pell_gpu_params) { .device = "99" }, &gpu), PELL_ERR_DEVICE);
    assert_int_equal(pell_gpu_open(ctx, &(struct pell_gpu_params) { .device = "" }, &gpu), PELL_ERR_DEVICE);
    pell_vulkan_devices_release(ctx, &devices);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(passes_follow_one_another),        cmocka_unit_test(passes_share_what_is_compiled),
        cmocka_unit_test(what_is_forgotten_is_a_message),   cmocka_unit_test(calls_that_fail_leave_nothing),
        cmocka_unit_test(a_lost_device_is_reported),        cmocka_unit_test(lack_of_memory_leaves_nothing),
        cmocka_unit_test(buffers_share_blocks_and_no_byte), cmocka_unit_test(devices_are_chosen_by_number_or_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
