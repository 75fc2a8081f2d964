/* SPDX-License-Identifier: MIT
 *
 * core.h - the device behind gpu.h and its functions. For the files of this room alone.
 */
#ifndef PELL_VULKAN_CORE_H
#define PELL_VULKAN_CORE_H

#include "vulkan/gpu.h"
#include "vulkan/instance.h"

#include <pthread.h>
#include <sys/stat.h>

#define PELL_VK_DEVICE_FUNCTIONS(F)                                                                                                        \
    F(AllocateCommandBuffers)                                                                                                              \
    F(AllocateDescriptorSets)                                                                                                              \
    F(AllocateMemory)                                                                                                                      \
    F(BeginCommandBuffer)                                                                                                                  \
    F(BindBufferMemory)                                                                                                                    \
    F(CmdBindDescriptorSets)                                                                                                               \
    F(CmdBindPipeline)                                                                                                                     \
    F(CmdCopyBuffer)                                                                                                                       \
    F(CmdDispatch)                                                                                                                         \
    F(CmdPipelineBarrier2)                                                                                                                 \
    F(CmdPushConstants)                                                                                                                    \
    F(CmdWriteTimestamp2)                                                                                                                  \
    F(CreateBuffer)                                                                                                                        \
    F(CreateCommandPool)                                                                                                                   \
    F(CreateComputePipelines)                                                                                                              \
    F(CreateDescriptorPool)                                                                                                                \
    F(CreateDescriptorSetLayout)                                                                                                           \
    F(CreatePipelineCache)                                                                                                                 \
    F(CreatePipelineLayout)                                                                                                                \
    F(CreateQueryPool)                                                                                                                     \
    F(CreateSemaphore)                                                                                                                     \
    F(CreateShaderModule)                                                                                                                  \
    F(DestroyBuffer)                                                                                                                       \
    F(DestroyCommandPool)                                                                                                                  \
    F(DestroyDescriptorPool)                                                                                                               \
    F(DestroyDescriptorSetLayout)                                                                                                          \
    F(DestroyDevice)                                                                                                                       \
    F(DestroyPipeline)                                                                                                                     \
    F(DestroyPipelineCache)                                                                                                                \
    F(DestroyPipelineLayout)                                                                                                               \
    F(DestroyQueryPool)                                                                                                                    \
    F(DestroySemaphore)                                                                                                                    \
    F(DestroyShaderModule)                                                                                                                 \
    F(EndCommandBuffer)                                                                                                                    \
    F(FreeMemory)                                                                                                                          \
    F(GetBufferMemoryRequirements)                                                                                                         \
    F(GetDeviceQueue)                                                                                                                      \
    F(GetPipelineCacheData)                                                                                                                \
    F(GetQueryPoolResults)                                                                                                                 \
    F(MapMemory)                                                                                                                           \
    F(QueueSubmit2)                                                                                                                        \
    F(ResetCommandPool)                                                                                                                    \
    F(ResetQueryPool)                                                                                                                      \
    F(UpdateDescriptorSets)                                                                                                                \
    F(WaitSemaphores)

/* NULL where the loader has no VK_EXT_debug_utils. */
#define PELL_VK_LABEL_FUNCTIONS(F)                                                                                                         \
    F(CmdBeginDebugUtilsLabelEXT)                                                                                                          \
    F(CmdEndDebugUtilsLabelEXT)                                                                                                            \
    F(SetDebugUtilsObjectNameEXT)

struct pell_vk_block;

struct pell_gpu {
    struct pell_context *ctx; /* borrowed */
    struct pell_vk_instance instance;
    char name[256];
    VkPhysicalDevice physical;
    VkPhysicalDeviceLimits limits;
    VkPhysicalDeviceMemoryProperties memory;
    VkDevice device;
    uint32_t family;
    VkQueue queue;
    uint64_t time_mask; /* of the bits that the queue's timestamps have; 0: it has none */
    struct {
        PELL_VK_DEVICE_FUNCTIONS(PELL_VK_MEMBER)
        PELL_VK_LABEL_FUNCTIONS(PELL_VK_MEMBER)
    } vk;
    VkPipelineCache cache; /* none: VK_NULL_HANDLE */
    char cache_path[1024];
    uint64_t cache_hash;        /* of what was read */
    _Atomic bool cache_used;    /* pipelines were made */
    char shaders[1024];         /* a folder whose files replace built-in shaders; "": none */
    struct pell_vk_code *codes; /* what its files hold */
    bool borrowed;              /* instance and device are the caller's */
    bool locks;                 /* those that follow are made */
    pthread_mutex_t queue_lock;
    pthread_mutex_t memory_lock;
    pthread_mutex_t codes_lock;
    pthread_mutex_t programs_lock;
    struct pell_vk_program *programs; /* until the end: who makes passes again need not wait for the compiler */
    struct pell_vk_block *blocks;
    uint64_t memory_used;
    _Atomic uint64_t calls;
    _Atomic uint64_t buffers; /* that were made */
    _Atomic uint64_t fail_at; /* 0: none */
    _Atomic bool fail_lost;   /* for tests: that call fails as if the device were lost */
};

/* --- calls.c --- */

/* Counts a call that can fail; whether it is the one to fail. */
bool pell_vk_fails(struct pell_gpu *gpu);
/* What that one fails with. */
static inline VkResult pell_vk_injected(struct pell_gpu *gpu)
{
    return atomic_load(&gpu->fail_lost) ? VK_ERROR_DEVICE_LOST : VK_ERROR_OUT_OF_DEVICE_MEMORY;
}
/* PELL_OK, or the logged failure. */
enum pell_result pell_vk_check(struct pell_gpu *gpu, const char *call, VkResult result);
/* Names an object in captures and messages. */
void pell_vk_name(struct pell_gpu *gpu, VkObjectType type, uint64_t handle, const char *name);

/* A call of a device's function that returns a VkResult, `args` in parentheses: an enum pell_result. */
#define PELL_VK(gpu, name, args) pell_vk_check(gpu, "vk" #name, pell_vk_fails(gpu) ? pell_vk_injected(gpu) : (gpu)->vk.name args)

/* --- cache.c --- */

/* The cache of pipelines in a folder, NULL: none; and its end, which writes what is new. */
PELL_NODISCARD enum pell_result pell_vk_cache_open(struct pell_gpu *gpu, const char *folder);
void pell_vk_cache_close(struct pell_gpu *gpu);

/* --- memory.c --- */

struct pell_gpu_buffer {
    struct pell_gpu *gpu;
    VkBuffer handle;
    uint64_t size;
    const char *name;
    uint64_t number;             /* of all that the gpu had */
    struct pell_vk_chunk *chunk; /* its memory */
    char *host;                  /* NULL: on the device */
    bool borrowed;
    /* What has been recorded, for the barriers that follow from it. */
    VkPipelineStageFlags2 write_stage, read_stages, seen_by; /* of the last write, of reads since, and whose barriers were made since */
    VkAccessFlags2 write_access;
};

/* --- passes.c --- */

struct pell_gpu_pass {
    struct pell_gpu *gpu;
    const struct pell_shader *shader;
    struct pell_gpu_buffer *buffers[PELL_GPU_BINDINGS]; /* borrowed */
    const struct pell_vk_program *program;              /* the gpu's */
    VkPipeline pipeline;                                /* that is bound: the program's, */
    struct pell_vk_replaced *replaced;                  /* or the last of these, with a folder of shaders */
    uint32_t version;                                   /* of the code that it has; 0: the built-in one */
    VkDescriptorPool pool;
    VkDescriptorSet set;
};

/* --- pipeline.c --- */

/* A shader with values of its constants, compiled; all passes of a gpu that run it share it. */
struct pell_vk_program {
    struct pell_vk_program *next;
    const struct pell_shader *shader;
    uint32_t constants[PELL_GPU_BINDINGS];
    size_t num_constants;
    VkDescriptorSetLayout set_layout;
    VkPipelineLayout layout;
    VkPipeline pipeline;
};

PELL_NODISCARD enum pell_result pell_vk_program_of(struct pell_gpu *gpu, const struct pell_shader *shader, const uint32_t *constants,
                                                   size_t num_constants, const struct pell_vk_program **out);
void pell_vk_programs_destroy(struct pell_gpu *gpu);
/* The program's pipeline with this code; the caller's. */
VkResult pell_vk_pipeline(struct pell_gpu *gpu, const struct pell_vk_program *program, const uint32_t *words, size_t size, VkPipeline *out);

/* --- codes.c --- */

/* What the file of a name holds, for all passes of that shader, those that are made later, too. */
struct pell_vk_code {
    struct pell_vk_code *next;
    const struct pell_shader *like;
    struct stat seen; /* the file as it was looked at; all 0: it was not there */
    uint32_t *words;  /* of the last one that may be used; NULL: none */
    size_t size;
    uint32_t version; /* counts those, and its end */
    uint32_t warned;  /* the last one of which it was said that the driver does not take it */
};

#define PELL_VK_SHADER_HINT "the shader before it stays in use"

/* What the file at the path holds for a shader, looked at now; NULL: no memory. Under codes_lock. */
struct pell_vk_code *pell_vk_code_of(struct pell_gpu *gpu, const struct pell_shader *like, const char *path);
void pell_vk_codes_destroy(struct pell_gpu *gpu);

/* --- replace.c --- */

/* Takes over what the folder of shaders has for the pass, if that has changed; and frees what was taken. */
void pell_vk_replace(struct pell_gpu_pass *pass);
void pell_vk_replaced_destroy(struct pell_gpu_pass *pass);

#endif
