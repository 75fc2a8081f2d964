/* SPDX-License-Identifier: MIT
 * test_vulkan_pass.c - pellucid/vulkan.h: a method recorded into command buffers of a program's own device gives the result of the cpu,
 * without a validation message. Skipped, by name, where there is no driver or no validation layer. */
#include "gpu_test.h"
#include "patch.h"

#include "vulkan/core.h"

#include <pellucid/vulkan.h>

enum { WIDTH = 61, HEIGHT = 43, PITCH = 64 };

#define OK(expr) assert_int_equal(expr, PELL_OK)
#define VK(expr) assert_int_equal(expr, VK_SUCCESS)

/* A program with a device, buffers and a command buffer. */
struct program {
    struct kept_messages kept;
    struct pell_alloc_fault fault;
    struct pell_context *ctx;
    struct pell_gpu *gpu;
    struct pell_gpu_buffer *light, *surface, *result;
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkSemaphore done;
    uint64_t submitted;
    struct pell_vulkan_device_params device;
    struct pell_vulkan_buffers buffers;
};

static void program_start(struct program *p)
{
    const VkSemaphoreTypeCreateInfo timeline = { .sType = VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO,
                                                 .semaphoreType = VK_SEMAPHORE_TYPE_TIMELINE };
    const VkSemaphoreCreateInfo semaphore = { .sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO, .pNext = &timeline };
    VkCommandPoolCreateInfo pool = { .sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO };
    VkCommandBufferAllocateInfo buffer = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, .commandBufferCount = 1 };

    memset(p, 0, sizeof(*p));
    p->ctx = gpu_context(&p->fault, &p->kept);
    p->gpu = gpu_opened(p->ctx);
    OK(pell_gpu_buffer_create(p->gpu, PELL_GPU_TO_DEVICE, PITCH * HEIGHT * 16, "the program's light", &p->light));
    OK(pell_gpu_buffer_create(p->gpu, PELL_GPU_TO_DEVICE, PITCH * HEIGHT * 8, "the program's surface", &p->surface));
    OK(pell_gpu_buffer_create(p->gpu, PELL_GPU_FROM_DEVICE, PITCH * HEIGHT * 16, "the program's result", &p->result));
    pool.queueFamilyIndex = p->gpu->family;
    VK(p->gpu->vk.CreateCommandPool(p->gpu->device, &pool, NULL, &p->pool));
    buffer.commandPool = p->pool;
    VK(p->gpu->vk.AllocateCommandBuffers(p->gpu->device, &buffer, &p->commands));
    VK(p->gpu->vk.CreateSemaphore(p->gpu->device, &semaphore, NULL, &p->done));
    p->device = (struct pell_vulkan_device_params) { p->gpu->instance.handle, p->gpu->physical, p->gpu->device, p->gpu->instance.address };
    p->buffers = (struct pell_vulkan_buffers) { (uint64_t) p->light->handle, (uint64_t) p->surface->handle, (uint64_t) p->result->handle };
}

static void program_finish(struct program *p, int errors)
{
    p->gpu->vk.DestroySemaphore(p->gpu->device, p->done, NULL);
    p->gpu->vk.DestroyCommandPool(p->gpu->device, p->pool, NULL);
    pell_gpu_buffer_destroy(&p->light);
    pell_gpu_buffer_destroy(&p->surface);
    pell_gpu_buffer_destroy(&p->result);
    pell_gpu_close(&p->gpu);
    if (p->kept.errors != errors)
        fail_msg("%d messages, expected %d, the last: %s", p->kept.errors, errors, p->kept.what);
    assert_int_equal(pell_memory_used(p->ctx), 0);
    pell_context_destroy(&p->ctx);
}

/* Writes the patch into the program's buffers; the padding beyond the width holds values that must not be used. */
static void program_fill(struct program *p, const struct patch *patch)
{
    float *light = pell_gpu_buffer_host(p->light);
    uint32_t *surface = pell_gpu_buffer_host(p->surface);

    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < PITCH; x++) {
            const size_t to = (size_t) (y * PITCH + x), from = x < WIDTH ? patch_at(patch, x, y) : 0;
            const float one = x < WIDTH ? patch->strength[from] : NAN;
            for (int c = 0; c < 3; c++)
                light[4 * to + (size_t) c] = x < WIDTH ? patch->light[c][from] : NAN;
            light[4 * to + 3] = x < WIDTH ? patch->depth[from] : NAN;
            surface[2 * to] = x < WIDTH ? patch->material[from] : 1;
            memcpy(&surface[2 * to + 1], &one, sizeof(one));
        }
}

static void program_record(struct program *p, struct pell_vulkan_pass *pass, float nearest)
{
    const VkCommandBufferBeginInfo begin = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO };
    const VkMemoryBarrier2 barrier = { .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER_2,
                                       .srcStageMask = VK_PIPELINE_STAGE_2_COPY_BIT,
                                       .srcAccessMask = VK_ACCESS_2_TRANSFER_WRITE_BIT,
                                       .dstStageMask = VK_PIPELINE_STAGE_2_HOST_BIT,
                                       .dstAccessMask = VK_ACCESS_2_HOST_READ_BIT };
    const VkDependencyInfo info = { .sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO, .memoryBarrierCount = 1, .pMemoryBarriers = &barrier };
    uint64_t calls;

    VK(p->gpu->vk.ResetCommandPool(p->gpu->device, p->pool, 0));
    VK(p->gpu->vk.BeginCommandBuffer(p->commands, &begin));
    calls = pell_allocations(p->ctx);
    OK(pell_vulkan_pass_record(pass, p->commands, nearest));
    assert_true(pell_allocations(p->ctx) == calls);
    p->gpu->vk.CmdPipelineBarrier2(p->commands, &info);
    VK(p->gpu->vk.EndCommandBuffer(p->commands));
}

static void program_submit(struct program *p)
{
    const VkCommandBufferSubmitInfo buffer = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_SUBMIT_INFO, .commandBuffer = p->commands };
    const VkSemaphoreSubmitInfo done = { .sType = VK_STRUCTURE_TYPE_SEMAPHORE_SUBMIT_INFO,
                                         .semaphore = p->done,
                                         .value = ++p->submitted,
                                         .stageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT };
    const VkSubmitInfo2 info = { .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO_2,
                                 .commandBufferInfoCount = 1,
                                 .pCommandBufferInfos = &buffer,
                                 .signalSemaphoreInfoCount = 1,
                                 .pSignalSemaphoreInfos = &done };
    const VkSemaphoreWaitInfo wait = {
        .sType = VK_STRUCTURE_TYPE_SEMAPHORE_WAIT_INFO, .semaphoreCount = 1, .pSemaphores = &p->done, .pValues = &p->submitted
    };

    VK(p->gpu->vk.QueueSubmit2(p->gpu->queue, 1, &info, VK_NULL_HANDLE));
    VK(p->gpu->vk.WaitSemaphores(p->gpu->device, &wait, UINT64_C(60000000000)));
}

/* A tilted plane of two materials with a hole, and irradiance in squares. */
static struct patch *scene(const struct pell_frame_material *materials)
{
    struct patch *p = patch_create(WIDTH, HEIGHT, false, 700.0, 300.0, materials, 2);

    patch_tilt(p, 300.0, 0.4, -0.2);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const size_t i = patch_at(p, x, y);
            p->material[i] = (uint16_t) (x < 40 ? 1 : 2);
            if (x > 15 && x < 20 && y > 10 && y < 20)
                p->material[i] = 0;
            for (int c = 0; c < 3; c++)
                p->light[c][i] = (float) ((x / 7 + y / 5 + c) % 2);
            p->strength[i] = x < 30 ? 1.0f : 0.6f;
        }
    return p;
}

static void two_materials(struct pell_frame_material materials[2])
{
    static const double variance[3] = { 0.5, 2.0, 9.0 }, weight[3][3] = { { 0.3, 0.2, 0.1 }, { 0.2, 0.3, 0.3 }, { 0.3, 0.2, 0.4 } };

    materials[0] = patch_gaussians(3, variance, weight);
    materials[1] = patch_gaussians(2, variance, weight);
}

static void require_same(const struct program *p, const struct patch *cpu)
{
    const float *result = pell_gpu_buffer_host(p->result);

    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++)
            for (int c = 0; c < 3; c++) {
                const float got = result[4 * (y * PITCH + x) + c];
                if (cpu->material[patch_at(cpu, x, y)])
                    REQUIRE_NEAR((double) got, (double) cpu->result[c][patch_at(cpu, x, y)], 1e-4);
                else
                    REQUIRE(got == 0.0f);
            }
}

static void a_recorded_pass_gives_what_the_cpu_gives(void **state)
{
    static const struct {
        const char *method, *knobs;
    } forms[] = { { "screen-space", "" },
                  { "screen-space", "as=paper" },
                  { "screen-space", "gaussians=6 first=unblurred strength=false" },
                  { "screen-space", "kernel=separable rank=2" },
                  { "image-space", "" },
                  { "image-space", "as=paper" },
                  { "image-space", "samples=5 tile=1 renormalise=off" } };
    struct pell_frame_material materials[2];
    struct program p;
    struct patch *patch;
    (void) state;

    two_materials(materials);
    program_start(&p);
    patch = scene(materials);
    program_fill(&p, patch);
    for (size_t i = 0; i < PELL_COUNT(forms); i++) {
        const struct pell_method *method = pell_method_find(p.ctx, "test", forms[i].method);
        struct pell_vulkan_pass *pass;
        struct pell_device *device;
        struct pell_pass *cpu;
        void *knobs;

        OK(pell_method_knobs_create(p.ctx, method, forms[i].knobs, &knobs));
        OK(pell_device_create(p.ctx, &(struct pell_device_params) { .threads = 1, .engine = PELL_ENGINE_CPU }, &device));
        OK(pell_pass_create(device, method, knobs, &patch->frame.shape, &cpu));
        OK(pell_pass_render(cpu, &patch->frame, &patch->out));
        OK(pell_vulkan_pass_create(p.ctx, &p.device, method, knobs, &patch->frame.shape, &p.buffers, &pass));
        program_record(&p, pass, 250.0f);
        for (int again = 0; again < 2; again++) {
            memset(pell_gpu_buffer_host(p.result), 0xff, PITCH * HEIGHT * 16);
            program_submit(&p);
            require_same(&p, patch);
        }
        pell_vulkan_pass_destroy(&pass);
        pell_vulkan_pass_destroy(&pass); /* of NULL */
        pell_pass_destroy(&cpu);
        pell_device_destroy(&device);
        pell_method_knobs_destroy(p.ctx, &knobs);
    }
    patch_destroy(patch);
    program_finish(&p, 0);
}

static void what_is_wrong_is_named(void **state)
{
    struct pell_frame_material materials[2];
    struct pell_vulkan_buffers none;
    struct pell_vulkan_pass *pass;
    struct pell_frame_shape shape;
    struct program p;
    struct patch *patch;
    const struct pell_method *method;
    (void) state;

    two_materials(materials);
    program_start(&p);
    patch = scene(materials);
    shape = patch->frame.shape;
    method = pell_method_find(p.ctx, "test", "screen-space");
    assert_int_equal(pell_vulkan_pitch(1), 16);
    assert_int_equal(pell_vulkan_pitch(64), 64);
    assert_int_equal(pell_vulkan_pass_create(p.ctx, &p.device, pell_method_find(p.ctx, "test", "dipole"), NULL, &shape, &p.buffers, &pass),
                     PELL_ERR_DEVICE);
    assert_null(pass);
    assert_string_equal(p.kept.what, "has no engine vulkan, only cpu");
    none = p.buffers;
    none.result = 0;
    assert_int_equal(pell_vulkan_pass_create(p.ctx, &p.device, method, NULL, &shape, &none, &pass), PELL_ERR_INVALID);
    shape.width = 0;
    assert_int_equal(pell_vulkan_pass_create(p.ctx, &p.device, method, NULL, &shape, &p.buffers, &pass), PELL_ERR_INVALID);
    shape.width = shape.height = 65536;
    assert_int_equal(pell_vulkan_pass_create(p.ctx, &p.device, method, NULL, &shape, &p.buffers, &pass), PELL_ERR_UNSUPPORTED);
    OK(pell_vulkan_pass_create(p.ctx, &p.device, method, NULL, &patch->frame.shape, &p.buffers, &pass));
    assert_int_equal(pell_vulkan_pass_record(pass, p.commands, 0.0f), PELL_ERR_INVALID);
    assert_int_equal(pell_vulkan_pass_record(pass, NULL, 1.0f), PELL_ERR_INVALID);
    pell_vulkan_pass_destroy(&pass);
    patch_destroy(patch);
    program_finish(&p, 6);
}

static void lack_of_memory_leaves_nothing(void **state)
{
    struct pell_frame_material materials[2];
    struct program p;
    struct patch *patch;
    int failed = 0;
    (void) state;

    two_materials(materials);
    program_start(&p);
    patch = scene(materials);
    for (int method = 0; method < 2; method++) {
        enum pell_result res = PELL_ERR_NOMEM;
        for (uint64_t n = 1; res != PELL_OK; n++) {
            const size_t used = pell_memory_used(p.ctx);
            struct pell_vulkan_pass *pass;

            p.fault.fail_at = atomic_load(&p.fault.calls) + n;
            res = pell_vulkan_pass_create(p.ctx, &p.device, pell_method_find(p.ctx, "test", method ? "image-space" : "screen-space"), NULL,
                                          &patch->frame.shape, &p.buffers, &pass);
            p.fault.fail_at = 0;
            REQUIRE(res == PELL_OK || (res == PELL_ERR_NOMEM && !pass));
            pell_vulkan_pass_destroy(&pass);
            assert_int_equal(pell_memory_used(p.ctx), used);
            failed += res != PELL_OK;
        }
    }
    REQUIRE(failed > 60);
    patch_destroy(patch);
    program_finish(&p, failed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_recorded_pass_gives_what_the_cpu_gives),
        cmocka_unit_test(what_is_wrong_is_named),
        cmocka_unit_test(lack_of_memory_leaves_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
