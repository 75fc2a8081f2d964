/* SPDX-License-Identifier: MIT
 * commands.c - command lists: barriers derived from the accesses that passes declare, timed marks, one submission and waiting for it. */
#include "vulkan/core.h"

#define SECOND UINT64_C(1000000000) /* in the semaphores' ns */

struct pell_gpu_commands {
    struct pell_gpu *gpu;
    VkCommandPool pool;
    VkCommandBuffer buffer;
    VkSemaphore done; /* a timeline: reaches `submitted` */
    uint64_t submitted;
    VkQueryPool queries; /* a timestamp for each mark, and for the end */
    const char *names[PELL_GPU_MARKS];
    struct pell_gpu_time times[PELL_GPU_MARKS];
    size_t num_marks, num_times;
    VkBufferMemoryBarrier2 barriers[PELL_GPU_BINDINGS]; /* barriers before the next command */
    uint32_t num_barriers;
};

/* --- Barriers ------------------------------------------------------------------------------------------------------------------- */

static void add_barrier(struct pell_gpu_commands *c, const struct pell_gpu_buffer *b, VkPipelineStageFlags2 before,
                        VkPipelineStageFlags2 stage, VkAccessFlags2 access)
{
    c->barriers[c->num_barriers++] = (VkBufferMemoryBarrier2) {
        .sType = VK_STRUCTURE_TYPE_BUFFER_MEMORY_BARRIER_2,
        .srcStageMask = before,
        .srcAccessMask = b->write_access,
        .dstStageMask = stage,
        .dstAccessMask = access,
        .srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
        .dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
        .buffer = b->handle,
        .size = VK_WHOLE_SIZE,
    };
}

/* Records that the next command accesses the buffer. `reads` and `writes` are its accesses, 0 for none. */
static void use(struct pell_gpu_commands *c, struct pell_gpu_buffer *b, VkPipelineStageFlags2 stage, VkAccessFlags2 reads,
                VkAccessFlags2 writes)
{
    if (writes) {
        if (b->write_stage | b->read_stages)
            add_barrier(c, b, b->write_stage | b->read_stages, stage, reads | writes);
        b->write_stage = stage;
        b->write_access = writes;
        b->read_stages = b->seen_by = 0;
        return;
    }
    if (b->write_stage && !(b->seen_by & stage)) {
        add_barrier(c, b, b->write_stage, stage, reads);
        b->seen_by |= stage;
    }
    b->read_stages |= stage;
}

static void flush(struct pell_gpu_commands *c)
{
    const VkDependencyInfo info = { .sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO,
                                    .bufferMemoryBarrierCount = c->num_barriers,
                                    .pBufferMemoryBarriers = c->barriers };

    if (c->num_barriers > 0)
        c->gpu->vk.CmdPipelineBarrier2(c->buffer, &info);
    c->num_barriers = 0;
}

/* --- Recording ------------------------------------------------------------------------------------------------------------------- */

enum pell_result pell_gpu_begin(struct pell_gpu_commands *c)
{
    const VkCommandBufferBeginInfo info = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                            .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT };
    struct pell_gpu *gpu = c->gpu;
    enum pell_result res;

    c->num_marks = c->num_times = 0;
    c->num_barriers = 0;
    PELL_TRY(PELL_VK(gpu, ResetCommandPool, (gpu->device, c->pool, 0)));
    PELL_TRY(PELL_VK(gpu, BeginCommandBuffer, (c->buffer, &info)));
    if (c->queries)
        gpu->vk.ResetQueryPool(gpu->device, c->queries, 0, PELL_GPU_MARKS + 1);
    return PELL_OK;

fail:
    return res;
}

void pell_gpu_begin_in(struct pell_gpu_commands *c, struct VkCommandBuffer_T *command_buffer)
{
    /* The command buffer may be submitted again: its earlier execution comes first. */
    const VkPipelineStageFlags2 stages = VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_2_COPY_BIT;
    const VkMemoryBarrier2 barrier = { .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER_2,
                                       .srcStageMask = stages,
                                       .srcAccessMask = VK_ACCESS_2_MEMORY_WRITE_BIT,
                                       .dstStageMask = stages,
                                       .dstAccessMask = VK_ACCESS_2_MEMORY_READ_BIT | VK_ACCESS_2_MEMORY_WRITE_BIT };
    const VkDependencyInfo info = { .sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO, .memoryBarrierCount = 1, .pMemoryBarriers = &barrier };

    c->buffer = command_buffer;
    c->num_marks = c->num_times = 0;
    c->num_barriers = 0;
    c->gpu->vk.CmdPipelineBarrier2(c->buffer, &info);
}

static void write_timestamp(struct pell_gpu_commands *c)
{
    if (c->queries)
        c->gpu->vk.CmdWriteTimestamp2(c->buffer, VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT, c->queries, (uint32_t) c->num_marks);
}

static void end_label(struct pell_gpu_commands *c)
{
    if (c->num_marks > 0 && c->gpu->vk.CmdEndDebugUtilsLabelEXT)
        c->gpu->vk.CmdEndDebugUtilsLabelEXT(c->buffer);
}

void pell_gpu_mark(struct pell_gpu_commands *c, const char *name)
{
    const VkDebugUtilsLabelEXT label = { .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_LABEL_EXT, .pLabelName = name };

    if (c->num_marks == PELL_GPU_MARKS)
        return;
    end_label(c);
    write_timestamp(c);
    c->names[c->num_marks++] = name;
    if (c->gpu->vk.CmdBeginDebugUtilsLabelEXT)
        c->gpu->vk.CmdBeginDebugUtilsLabelEXT(c->buffer, &label);
}

void pell_gpu_copy(struct pell_gpu_commands *c, struct pell_gpu_buffer *from, struct pell_gpu_buffer *to, uint64_t size)
{
    pell_gpu_copy_part(c, from, to, 0, size);
}

void pell_gpu_copy_part(struct pell_gpu_commands *c, struct pell_gpu_buffer *from, struct pell_gpu_buffer *to, uint64_t first,
                        uint64_t size)
{
    const VkBufferCopy region = { first, first, size };

    use(c, from, VK_PIPELINE_STAGE_2_COPY_BIT, VK_ACCESS_2_TRANSFER_READ_BIT, 0);
    use(c, to, VK_PIPELINE_STAGE_2_COPY_BIT, 0, VK_ACCESS_2_TRANSFER_WRITE_BIT);
    flush(c);
    c->gpu->vk.CmdCopyBuffer(c->buffer, from->handle, to->handle, 1, &region);
    if (to->host) { /* the host reads it after the list is done */
        use(c, to, VK_PIPELINE_STAGE_2_HOST_BIT, VK_ACCESS_2_HOST_READ_BIT, 0);
        flush(c);
    }
}

void pell_gpu_run(struct pell_gpu_commands *c, struct pell_gpu_pass *pass, const void *push, uint32_t x, uint32_t y, uint32_t z)
{
    const struct pell_shader *s = pass->shader;
    struct pell_gpu *gpu = c->gpu;

    if (gpu->shaders[0])
        pell_vk_replace(pass);
    for (int i = 0; i < s->num_bindings; i++)
        use(c, pass->buffers[i], VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
            s->access[i] & PELL_GPU_READS ? VK_ACCESS_2_SHADER_STORAGE_READ_BIT : 0,
            s->access[i] & PELL_GPU_WRITES ? VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT : 0);
    flush(c);
    gpu->vk.CmdBindPipeline(c->buffer, VK_PIPELINE_BIND_POINT_COMPUTE, pass->pipeline);
    gpu->vk.CmdBindDescriptorSets(c->buffer, VK_PIPELINE_BIND_POINT_COMPUTE, pass->program->layout, 0, 1, &pass->set, 0, NULL);
    if (s->push_size > 0)
        gpu->vk.CmdPushConstants(c->buffer, pass->program->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, s->push_size, push);
    gpu->vk.CmdDispatch(c->buffer, x, y, z);
}

/* --- The end --------------------------------------------------------------------------------------------------------------------- */

static VkResult wait_for(struct pell_gpu_commands *c)
{
    const VkSemaphoreWaitInfo info = {
        .sType = VK_STRUCTURE_TYPE_SEMAPHORE_WAIT_INFO, .semaphoreCount = 1, .pSemaphores = &c->done, .pValues = &c->submitted
    };
    VkResult result = VK_TIMEOUT;

    while (result == VK_TIMEOUT)
        result = c->gpu->vk.WaitSemaphores(c->gpu->device, &info, SECOND);
    return result;
}

static enum pell_result submit(struct pell_gpu_commands *c)
{
    const VkCommandBufferSubmitInfo buffer = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_SUBMIT_INFO, .commandBuffer = c->buffer };
    const VkSemaphoreSubmitInfo done = { .sType = VK_STRUCTURE_TYPE_SEMAPHORE_SUBMIT_INFO,
                                         .semaphore = c->done,
                                         .value = c->submitted + 1,
                                         .stageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT };
    const VkSubmitInfo2 info = { .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO_2,
                                 .commandBufferInfoCount = 1,
                                 .pCommandBufferInfos = &buffer,
                                 .signalSemaphoreInfoCount = 1,
                                 .pSignalSemaphoreInfos = &done };
    enum pell_result res;

    pthread_mutex_lock(&c->gpu->queue_lock);
    res = PELL_VK(c->gpu, QueueSubmit2, (c->gpu->queue, 1, &info, VK_NULL_HANDLE));
    pthread_mutex_unlock(&c->gpu->queue_lock);
    c->submitted += res == PELL_OK;
    return res;
}

static enum pell_result read_times(struct pell_gpu_commands *c)
{
    uint64_t ticks[PELL_GPU_MARKS + 1] = { 0 };
    const size_t count = c->num_marks + 1;
    enum pell_result res = PELL_OK;

    if (c->queries)
        res = PELL_VK(c->gpu, GetQueryPoolResults,
                      (c->gpu->device, c->queries, 0, (uint32_t) count, sizeof(ticks), ticks, sizeof(*ticks), VK_QUERY_RESULT_64_BIT));
    for (size_t i = 0; i < c->num_marks; i++)
        c->times[i] = (struct pell_gpu_time) { c->names[i], (double) ((ticks[i + 1] - ticks[i]) & c->gpu->time_mask) *
                                                                (double) c->gpu->limits.timestampPeriod * 1e-9 };
    c->num_times = res == PELL_OK ? c->num_marks : 0;
    return res;
}

void pell_gpu_end_in(struct pell_gpu_commands *c)
{
    end_label(c);
    c->buffer = VK_NULL_HANDLE;
}

enum pell_result pell_gpu_finish(struct pell_gpu_commands *c)
{
    enum pell_result res;
    VkResult waited;

    end_label(c);
    write_timestamp(c);
    PELL_TRY(PELL_VK(c->gpu, EndCommandBuffer, (c->buffer)));
    PELL_TRY(submit(c));
    waited = wait_for(c);
    PELL_TRY(pell_vk_check(c->gpu, "vkWaitSemaphores", pell_vk_fails(c->gpu) ? pell_vk_injected(c->gpu) : waited));
    PELL_TRY(read_times(c));
    return PELL_OK;

fail:
    return res;
}

size_t pell_gpu_times(const struct pell_gpu_commands *c, struct pell_gpu_time *times, size_t size)
{
    const size_t count = c->num_times < size ? c->num_times : size;

    for (size_t i = 0; i < count; i++)
        times[i] = c->times[i];
    return count;
}

/* --- Lists ----------------------------------------------------------------------------------------------------------------------- */

enum pell_result pell_gpu_commands_create(struct pell_gpu *gpu, const char *name, struct pell_gpu_commands **out)
{
    const VkCommandPoolCreateInfo pool = { .sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                           .flags = VK_COMMAND_POOL_CREATE_TRANSIENT_BIT,
                                           .queueFamilyIndex = gpu->family };
    VkCommandBufferAllocateInfo buffer = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                           .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
                                           .commandBufferCount = 1 };
    const VkSemaphoreTypeCreateInfo timeline = { .sType = VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO,
                                                 .semaphoreType = VK_SEMAPHORE_TYPE_TIMELINE };
    const VkSemaphoreCreateInfo semaphore = { .sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO, .pNext = &timeline };
    const VkQueryPoolCreateInfo queries = { .sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                            .queryType = VK_QUERY_TYPE_TIMESTAMP,
                                            .queryCount = PELL_GPU_MARKS + 1 };
    struct pell_gpu_commands *c = pell_zalloc(gpu->ctx, sizeof(*c));
    enum pell_result res;

    *out = NULL;
    if (!c)
        return PELL_ERR_NOMEM;
    c->gpu = gpu;
    PELL_TRY(PELL_VK(gpu, CreateCommandPool, (gpu->device, &pool, NULL, &c->pool)));
    buffer.commandPool = c->pool;
    PELL_TRY(PELL_VK(gpu, AllocateCommandBuffers, (gpu->device, &buffer, &c->buffer)));
    PELL_TRY(PELL_VK(gpu, CreateSemaphore, (gpu->device, &semaphore, NULL, &c->done)));
    if (gpu->time_mask)
        PELL_TRY(PELL_VK(gpu, CreateQueryPool, (gpu->device, &queries, NULL, &c->queries)));
    pell_vk_name(gpu, VK_OBJECT_TYPE_COMMAND_BUFFER, (uint64_t) (uintptr_t) c->buffer, name);
    *out = c;
    return PELL_OK;

fail:
    pell_gpu_commands_destroy(&c);
    return res;
}

enum pell_result pell_gpu_commands_borrow(struct pell_gpu *gpu, struct pell_gpu_commands **out)
{
    struct pell_gpu_commands *c = pell_zalloc(gpu->ctx, sizeof(*c));

    *out = c;
    if (!c)
        return PELL_ERR_NOMEM;
    c->gpu = gpu;
    return PELL_OK;
}

void pell_gpu_commands_destroy(struct pell_gpu_commands **commands)
{
    struct pell_gpu_commands *c = *commands;
    struct pell_gpu *gpu;

    if (!c)
        return;
    *commands = NULL;
    gpu = c->gpu;
    if (c->submitted > 0)
        (void) wait_for(c); /* a lost device has been logged, and executes nothing any more */
    if (c->queries)
        gpu->vk.DestroyQueryPool(gpu->device, c->queries, NULL);
    if (c->done)
        gpu->vk.DestroySemaphore(gpu->device, c->done, NULL);
    if (c->pool)
        gpu->vk.DestroyCommandPool(gpu->device, c->pool, NULL); /* frees its command buffer, too */
    pell_free(gpu->ctx, c);
}
