/* SPDX-License-Identifier: MIT
 *
 * core.h - the device behind gpu.h and its functions. Internal to src/vulkan.
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

/* NULL if the loader lacks VK_EXT_debug_utils. */
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
    uint64_t time_mask; /* valid bits of the queue's timestamps; 0: it has none */
    struct {
        PELL_VK_DEVICE_FUNCTIONS(PELL_VK_MEMBER)
        PELL_VK_LABEL_FUNCTIONS(PELL_VK_MEMBER)
    } vk;
    VkPipelineCache cache; /* VK_NULL_HANDLE: none */
    char cache_path[1024];
    uint64_t cache_hash;        /* hash of the data read */
    _Atomic bool cache_used;    /* pipelines were made */
    char shaders[1024];         /* folder whose files replace built-in shaders; "": none */
    struct pell_vk_code *codes; /* loaded files of that folder */
    bool borrowed;              /* instance and device are the caller's */
    bool locks;                 /* the mutexes below are initialised */
    pthread_mutex_t queue_lock;
    pthread_mutex_t memory_lock;
    pthread_mutex_t codes_lock;
    pthread_mutex_t programs_lock;
    struct pell_vk_program *programs; /* kept until the end: recreating passes need not wait for the compiler */
    struct pell_vk_block *blocks;
    uint64_t memory_used;
    _Atomic uint64_t calls;
    _Atomic uint64_t buffers; /* number of buffers created */
    _Atomic uint64_t fail_at; /* 0: none */
    _Atomic bool fail_lost;   /* for tests: that call fails as if the device were lost */
};

/* --- calls.c --- */

/* Counts a call that can fail; returns whether to inject a failure. */
bool pell_vk_fails(struct pell_gpu *gpu);
/* The result of an injected failure. */
static inline VkResult pell_vk_injected(struct pell_gpu *gpu)
{
    return atomic_load(&gpu->fail_lost) ? VK_ERROR_DEVICE_LOST : VK_ERROR_OUT_OF_DEVICE_MEMORY;
}
/* PELL_OK, or the logged failure. */
enum pell_result pell_vk_check(struct pell_gpu *gpu, const char *call, VkResult result);
/* Names an object in captures and messages. */
void pell_vk_name(struct pell_gpu *gpu, VkObjectType type, uint64_t handle, const char *name);

/* Calls a device function that returns a VkResult, `args` in parentheses; yields an enum pell_result. */
#define PELL_VK(gpu, name, args) pell_vk_check(gpu, "vk" #name, pell_vk_fails(gpu) ? pell_vk_injected(gpu) : (gpu)->vk.name args)

/* --- cache.c --- */

/* Opens the pipeline cache in a folder, NULL: none; and closes it, which writes new data. */
PELL_NODISCARD enum pell_result pell_vk_cache_open(struct pell_gpu *gpu, const char *folder);
void pell_vk_cache_close(struct pell_gpu *gpu);

/* --- memory.c --- */

struct pell_gpu_buffer {
    struct pell_gpu *gpu;
    VkBuffer handle;
    uint64_t size;
    const char *name;
    uint64_t id;                 /* unique among all buffers of the gpu so far */
    struct pell_vk_chunk *chunk; /* its memory */
    char *host;                  /* NULL: on the device */
    bool borrowed;
    /* Recorded accesses, from which barriers are derived. */
    VkPipelineStageFlags2 write_stage, read_stages, seen_by; /* of the last write, of reads since, and stages synchronised with it since */
    VkAccessFlags2 write_access;
};

/* --- passes.c --- */

struct pell_gpu_pass {
    struct pell_gpu *gpu;
    const struct pell_shader *shader;
    struct pell_gpu_buffer *buffers[PELL_GPU_BINDINGS]; /* borrowed */
    const struct pell_vk_program *program;              /* owned by the gpu */
    VkPipeline pipeline;                                /* pipeline to bind: the program's, */
    struct pell_vk_replaced *replaced;                  /* or the last of these, if shaders are replaced */
    uint32_t version;                                   /* version of its code; 0: the built-in one */
    VkDescriptorPool pool;
    VkDescriptorSet set;
};

/* --- pipeline.c --- */

/* A compiled shader with values of its constants; shared by all passes of a gpu that use it. */
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
/* Makes the program's pipeline with this code; owned by the caller. */
VkResult pell_vk_pipeline(struct pell_gpu *gpu, const struct pell_vk_program *program, const uint32_t *words, size_t size, VkPipeline *out);

/* --- codes.c --- */

/* The contents of a shader file, shared by all passes of that shader, present and future. */
struct pell_vk_code {
    struct pell_vk_code *next;
    const struct pell_shader *builtin;
    struct stat seen; /* file status at the last check; all 0: it did not exist */
    uint32_t *words;  /* the last usable code; NULL: none */
    size_t size;
    uint32_t version; /* counts changes of the code, including its removal */
    uint32_t warned;  /* the last version for which a warning was given that the driver rejects it */
};

#define PELL_VK_SHADER_HINT "the shader before it stays in use"

/* The contents of the file at the path for a shader, checked now; NULL: out of memory. Called under codes_lock. */
struct pell_vk_code *pell_vk_code_of(struct pell_gpu *gpu, const struct pell_shader *builtin, const char *path);
void pell_vk_codes_destroy(struct pell_gpu *gpu);

/* --- replace.c --- */

/* Switches the pass to the code of the folder of shaders, if that has changed. */
void pell_vk_replace(struct pell_gpu_pass *pass);
void pell_vk_replaced_destroy(struct pell_gpu_pass *pass);

#endif
