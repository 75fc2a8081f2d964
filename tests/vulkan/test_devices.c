/* SPDX-License-Identifier: MIT
 * test_devices.c - the Vulkan devices of the machine and the choice among them. */
#include "pell_test.h"

#include "vulkan/devices.h"

static void hardware_comes_first(void **unused)
{
    struct pell_vulkan_device list[] = {
        { .kind = PELL_VULKAN_CPU }, { .kind = PELL_VULKAN_INTEGRATED }, { .kind = PELL_VULKAN_DISCRETE }, { .kind = PELL_VULKAN_DISCRETE }
    };
    struct pell_vulkan_devices devices = { .list = list };
    static const int taken[] = { -1, 0, 1, 2, 2 };

    (void) unused;
    for (devices.count = 0; devices.count <= PELL_COUNT(list); devices.count++) {
        pell_vulkan_devices_choose(&devices);
        assert_int_equal(devices.taken, taken[devices.count]);
        assert_true(devices.why && devices.why[0]);
    }
}

static void what_lacks_something_is_not_taken(void **unused)
{
    struct pell_vulkan_device list[] = { { .kind = PELL_VULKAN_CPU }, { .kind = PELL_VULKAN_DISCRETE } };
    struct pell_vulkan_devices devices = { .list = list, .count = 2 };

    (void) unused;
    pell_text_add(&list[1].missing, "synchronization2");
    pell_vulkan_devices_choose(&devices);
    assert_int_equal(devices.taken, 0);
    assert_non_null(strstr(devices.why, "CPU"));
    pell_text_add(&list[0].missing, "Vulkan 1.3");
    pell_vulkan_devices_choose(&devices);
    assert_int_equal(devices.taken, -1);
    assert_string_equal(devices.why, "every device lacks something");
}

static void this_machine_is_described(void **unused)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_vulkan_devices devices;
    (void) unused;
    assert_int_equal(pell_vulkan_devices_find(ctx, &devices), PELL_OK);
    assert_non_null(devices.why);
    REQUIRE(devices.taken < (int) devices.count);
    for (size_t i = 0; i < devices.count; i++) {
        const struct pell_vulkan_device *d = &devices.list[i];

        REQUIRE(d->name[0] && d->version[0] >= 1 && d->memory > 0);
        REQUIRE(devices.taken >= 0 || d->missing.length > 0);
    }
#ifndef PELL_HAVE_VULKAN
    assert_int_equal(devices.count, 0);
#endif
    pell_vulkan_devices_release(ctx, &devices);
    assert_int_equal(pell_memory_used(ctx), 0);
    assert_int_equal(kept.errors, 0);
    pell_context_destroy(&ctx);
}

/* Each allocation of the device search fails once: it is reported, and nothing leaks. */
static void lack_of_memory_is_reported(void **unused)
{
    enum pell_result res = PELL_ERR_NOMEM;

    (void) unused;
    for (uint64_t n = 1; res != PELL_OK; n++) {
        struct pell_alloc_fault fault = { 0 };
        struct kept_messages kept = { 0 };
        struct pell_context *ctx = test_context(&fault, &kept);
        struct pell_vulkan_devices devices;

        fault.fail_at = atomic_load(&fault.calls) + n;
        res = pell_vulkan_devices_find(ctx, &devices);
        REQUIRE(res == PELL_OK || (res == PELL_ERR_NOMEM && kept.errors == 1 && devices.count == 0));
        pell_vulkan_devices_release(ctx, &devices);
        assert_int_equal(pell_memory_used(ctx), 0);
        fault.fail_at = 0;
        pell_context_destroy(&ctx);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hardware_comes_first),
        cmocka_unit_test(what_lacks_something_is_not_taken),
        cmocka_unit_test(this_machine_is_described),
        cmocka_unit_test(lack_of_memory_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
