/* SPDX-License-Identifier: MIT
 * memory.c - buffers, and the blocks of device memory that they are sub-allocated from: drivers allow few allocations, and each is slow. */
#include "vulkan/core.h"

/* A new block is as large as all existing ones, clamped to this range. */
#define BLOCK_MIN (UINT64_C(2) << 20)
#define BLOCK_MAX (UINT64_C(64) << 20)

/* A region of a block: chunks are contiguous, and no two free ones are adjacent. */
struct pell_vk_chunk {
    struct pell_vk_block *block;
    struct pell_vk_chunk *next, *previous;
    uint64_t offset, size;
    bool used;
};

struct pell_vk_block {
    struct pell_vk_block *next;
    VkDeviceMemory memory;
    uint32_t type;
    char *host; /* mapped address, or NULL */
    struct pell_vk_chunk *chunks;
};

static void destroy_block(struct pell_gpu *gpu, struct pell_vk_block *block)
{
    for (struct pell_vk_chunk *c = block->chunks, *next; c; c = next) {
        next = c->next;
        pell_free(gpu->ctx, c);
    }
    if (block->memory)
        gpu->vk.FreeMemory(gpu->device, block->memory, NULL); /* and unmaps it */
    pell_free(gpu->ctx, block);
}

static enum pell_result create_block(struct pell_gpu *gpu, uint32_t type, uint64_t size, struct pell_vk_block **out)
{
    const VkMemoryAllocateInfo info = { .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = size, .memoryTypeIndex = type };
    struct pell_vk_block *b = pell_zalloc(gpu->ctx, sizeof(*b));
    void *host = NULL;
    enum pell_result res;

    if (!b)
        return PELL_ERR_NOMEM;
    b->type = type;
    res = PELL_ERR_NOMEM;
    if (!(b->chunks = pell_zalloc(gpu->ctx, sizeof(*b->chunks))))
        goto fail;
    b->chunks->block = b;
    b->chunks->size = size;
    PELL_TRY(PELL_VK(gpu, AllocateMemory, (gpu->device, &info, NULL, &b->memory)));
    if (gpu->memory.memoryTypes[type].propertyFlags & VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT)
        PELL_TRY(PELL_VK(gpu, MapMemory, (gpu->device, b->memory, 0, VK_WHOLE_SIZE, 0, &host)));
    b->host = host;
    *out = b;
    return PELL_OK;

fail:
    destroy_block(gpu, b);
    return res;
}

/* Splits the remainder after `size` into a separate chunk. */
static bool split(struct pell_gpu *gpu, struct pell_vk_chunk *c, uint64_t size)
{
    struct pell_vk_chunk *rest = pell_zalloc(gpu->ctx, sizeof(*rest));

    if (!rest)
        return false;
    *rest = (struct pell_vk_chunk) { c->block, c->next, c, c->offset + size, c->size - size, false };
    if (rest->next)
        rest->next->previous = rest;
    c->next = rest;
    c->size = size;
    return true;
}

/* Merges the second into the first. */
static void join(struct pell_gpu *gpu, struct pell_vk_chunk *c, struct pell_vk_chunk *next)
{
    c->size += next->size;
    c->next = next->next;
    if (c->next)
        c->next->previous = c;
    pell_free(gpu->ctx, next);
}

static void release(struct pell_gpu *gpu, struct pell_vk_chunk *c)
{
    struct pell_vk_block *block = c->block;

    c->used = false;
    if (c->next && !c->next->used)
        join(gpu, c, c->next);
    if (c->previous && !c->previous->used) {
        c = c->previous;
        join(gpu, c, c->next);
    }
    if (c->previous || c->next)
        return;
    for (struct pell_vk_block **b = &gpu->blocks; *b; b = &(*b)->next)
        if (*b == block) {
            *b = block->next;
            break;
        }
    destroy_block(gpu, block);
}

static uint64_t block_size(const struct pell_gpu *gpu, uint64_t size)
{
    const uint64_t used = gpu->memory_used, block = used < BLOCK_MIN ? BLOCK_MIN : used > BLOCK_MAX ? BLOCK_MAX : used;

    return size > block ? size : block;
}

/* The first free chunk of the block with room for `size` bytes from *offset on, which is aligned; NULL: none. */
static struct pell_vk_chunk *find_fit(const struct pell_vk_block *block, uint64_t size, uint64_t align, uint64_t *offset)
{
    for (struct pell_vk_chunk *c = block->chunks; c; c = c->next) {
        *offset = (c->offset + align - 1) / align * align;
        if (!c->used && *offset + size <= c->offset + c->size)
            return c;
    }
    return NULL;
}

static enum pell_result allocate(struct pell_gpu *gpu, uint32_t type, uint64_t size, uint64_t align, struct pell_vk_chunk **out)
{
    struct pell_vk_chunk *c = NULL;
    struct pell_vk_block *fresh = NULL;
    uint64_t offset = 0;
    enum pell_result res;

    for (struct pell_vk_block *b = gpu->blocks; b && !c; b = b->next)
        if (b->type == type)
            c = find_fit(b, size, align, &offset);
    if (!c) {
        PELL_TRY(create_block(gpu, type, block_size(gpu, size), &fresh));
        c = find_fit(fresh, size, align, &offset);
        fresh->next = gpu->blocks;
        gpu->blocks = fresh;
    }
    res = PELL_ERR_NOMEM;
    if (offset > c->offset) {
        if (!split(gpu, c, offset - c->offset))
            goto fail;
        c = c->next;
    }
    if (c->size > size && !split(gpu, c, size))
        goto fail;
    c->used = true;
    *out = c;
    return PELL_OK;

fail:
    if (c)
        release(gpu, c); /* still unused: it merges with its neighbours, and an empty block is freed */
    return res;
}

/* The first allowed memory type with all wanted properties; -1: none. */
static int find_type(const struct pell_gpu *gpu, uint32_t allowed, VkMemoryPropertyFlags wanted)
{
    for (uint32_t i = 0; i < gpu->memory.memoryTypeCount; i++)
        if ((allowed >> i & 1) && (gpu->memory.memoryTypes[i].propertyFlags & wanted) == wanted)
            return (int) i;
    return -1;
}

static int choose_type(const struct pell_gpu *gpu, uint32_t allowed, enum pell_gpu_memory memory)
{
    const VkMemoryPropertyFlags shared = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    int type = find_type(gpu, allowed,
                         memory == PELL_GPU_ON_DEVICE     ? VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT
                         : memory == PELL_GPU_FROM_DEVICE ? shared | VK_MEMORY_PROPERTY_HOST_CACHED_BIT
                                                          : shared);

    if (type < 0)
        type = find_type(gpu, allowed, memory == PELL_GPU_ON_DEVICE ? 0 : shared);
    return type;
}

static enum pell_result bind_memory(struct pell_gpu_buffer *b, enum pell_gpu_memory memory)
{
    struct pell_gpu *gpu = b->gpu;
    VkMemoryRequirements needs;
    enum pell_result res;
    int type;

    gpu->vk.GetBufferMemoryRequirements(gpu->device, b->handle, &needs);
    type = choose_type(gpu, needs.memoryTypeBits, memory);
    if (type < 0)
        return pell_error(gpu->ctx, PELL_ERR_UNSUPPORTED, gpu->name, "use --engine cpu", "has no memory for buffer %s", b->name);
    pthread_mutex_lock(&gpu->memory_lock);
    res = allocate(gpu, (uint32_t) type, needs.size, needs.alignment, &b->chunk);
    gpu->memory_used += res == PELL_OK ? b->chunk->size : 0;
    pthread_mutex_unlock(&gpu->memory_lock);
    if (res != PELL_OK)
        return res;
    if (memory != PELL_GPU_ON_DEVICE)
        b->host = b->chunk->block->host + b->chunk->offset;
    return PELL_VK(gpu, BindBufferMemory, (gpu->device, b->handle, b->chunk->block->memory, b->chunk->offset));
}

enum pell_result pell_gpu_buffer_create(struct pell_gpu *gpu, enum pell_gpu_memory memory, uint64_t size, const char *name,
                                        struct pell_gpu_buffer **out)
{
    const VkBufferCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
        .size = size,
        .usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT,
        .sharingMode = VK_SHARING_MODE_EXCLUSIVE,
    };
    struct pell_gpu_buffer *b;
    enum pell_result res;

    *out = NULL;
    if (size > gpu->limits.maxStorageBufferRange)
        return pell_error(gpu->ctx, PELL_ERR_UNSUPPORTED, gpu->name, "use a smaller image, or --engine cpu",
                          "buffer %s would have %llu bytes, the device allows %llu", name, (unsigned long long) size,
                          (unsigned long long) gpu->limits.maxStorageBufferRange);
    b = pell_zalloc(gpu->ctx, sizeof(*b));
    if (!b)
        return PELL_ERR_NOMEM;
    b->gpu = gpu;
    b->size = size;
    b->name = name;
    b->id = ++gpu->buffers;
    PELL_TRY(PELL_VK(gpu, CreateBuffer, (gpu->device, &info, NULL, &b->handle)));
    pell_vk_name(gpu, VK_OBJECT_TYPE_BUFFER, (uint64_t) b->handle, name);
    PELL_TRY(bind_memory(b, memory));
    *out = b;
    return PELL_OK;

fail:
    pell_gpu_buffer_destroy(&b);
    return res;
}

enum pell_result pell_gpu_buffer_borrow(struct pell_gpu *gpu, uint64_t handle, uint64_t size, const char *name,
                                        struct pell_gpu_buffer **out)
{
    struct pell_gpu_buffer *b = pell_zalloc(gpu->ctx, sizeof(*b));

    *out = b;
    if (!b)
        return PELL_ERR_NOMEM;
    *b = (struct pell_gpu_buffer) { .gpu = gpu, .handle = (VkBuffer) handle, .size = size, .name = name, .borrowed = true };
    b->id = ++gpu->buffers;
    return PELL_OK;
}

uint64_t pell_gpu_buffer_id(const struct pell_gpu_buffer *buffer)
{
    return buffer->id;
}

void pell_gpu_buffer_destroy(struct pell_gpu_buffer **buffer)
{
    struct pell_gpu_buffer *b = *buffer;
    struct pell_gpu *gpu;

    if (!b)
        return;
    *buffer = NULL;
    gpu = b->gpu;
    if (b->handle && !b->borrowed)
        gpu->vk.DestroyBuffer(gpu->device, b->handle, NULL);
    if (b->chunk) {
        pthread_mutex_lock(&gpu->memory_lock);
        gpu->memory_used -= b->chunk->size;
        release(gpu, b->chunk);
        pthread_mutex_unlock(&gpu->memory_lock);
    }
    pell_free(gpu->ctx, b);
}

uint64_t pell_gpu_buffer_most(const struct pell_gpu *gpu)
{
    return gpu->limits.maxStorageBufferRange;
}

void *pell_gpu_buffer_host(const struct pell_gpu_buffer *buffer)
{
    return buffer->host;
}

uint64_t pell_gpu_memory_used(struct pell_gpu *gpu)
{
    uint64_t used;

    pthread_mutex_lock(&gpu->memory_lock);
    used = gpu->memory_used;
    pthread_mutex_unlock(&gpu->memory_lock);
    return used;
}
