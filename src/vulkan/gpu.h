/* SPDX-License-Identifier: MIT
 *
 * gpu.h - a Vulkan compute device: buffers, compute passes, command lists. Needs no Vulkan headers.
 *
 *     pell_gpu_open(ctx, &params, &gpu);
 *     pell_gpu_buffer_create(gpu, PELL_GPU_TO_DEVICE, size, "in", &in);                    // and others
 *     pell_gpu_pass_create(gpu, &pell_blur_shader, constants, 1, buffers, &blur);          // a shader with its buffers
 *     pell_gpu_commands_create(gpu, "frame", &list);
 *     pell_gpu_begin(list); pell_gpu_mark(list, "blur"); pell_gpu_run(list, blur, &push, 64, 64, 1); ... pell_gpu_finish(list);
 *
 * A pass accesses a buffer as its shader declares (readonly, writeonly): barriers are derived from that.
 *
 * Units      bytes, seconds.
 * Ownership  X_destroy and pell_gpu_close set the pointer to NULL and accept NULL in it. All objects of a gpu are destroyed before it.
 *            Nothing is allocated between pell_gpu_begin and pell_gpu_finish, except for shaders from a folder.
 * Errors     logged once: PELL_ERR_DEVICE (no device, a call failed, the device was lost), PELL_ERR_NOMEM (host or device),
 *            PELL_ERR_UNSUPPORTED (more than the device's limits allow). On failure *out is NULL.
 * Threads    a gpu serves any number of threads. A buffer, a pass and a list belong to one at a time; a buffer to one list.
 */
#ifndef PELL_VULKAN_GPU_H
#define PELL_VULKAN_GPU_H

#include "base/base.h"

struct pell_gpu;
struct pell_gpu_buffer;
struct pell_gpu_pass;
struct pell_gpu_commands;
struct VkInstance_T; /* from Vulkan */
struct VkPhysicalDevice_T;
struct VkDevice_T;
struct VkCommandBuffer_T;

enum { PELL_GPU_BINDINGS = 16, PELL_GPU_PUSH = 128, PELL_GPU_MARKS = 64 };
enum pell_gpu_access { PELL_GPU_READS = 1, PELL_GPU_WRITES = 2 };

/* A compute shader, as scripts/make_shader.py writes it: its declarations are extracted from its SPIR-V. */
struct pell_shader {
    const char *name;
    const uint32_t *words;
    size_t size; /* bytes */
    int num_bindings;
    uint8_t access[PELL_GPU_BINDINGS]; /* enum pell_gpu_access, for the storage buffers 0 to num_bindings - 1 of set 0 */
    uint32_t push_size;                /* bytes of push constants */
    uint32_t local[3];                 /* invocations of a workgroup */
};

struct pell_gpu_params {
    const char *device; /* index in the order of pell_vulkan_devices_find, or part of a name; NULL: that function's choice */
    /* folder (created if its parent exists) of the pipeline cache for the next run; NULL: none. A damaged file is replaced; failing to
     * write it is no error */
    const char *cache;
    const char *shaders; /* a folder whose files NAME.spv replace the shaders of that name (replace.c); NULL: none */
    bool validate;       /* with the validation layer for calls and synchronisation: its messages are logged as errors */
    uint64_t fail_at;    /* for tests: as pell_gpu_fail_at, but from the first call on; 0: none */
};

/* `params` may be NULL. */
PELL_NODISCARD enum pell_result pell_gpu_open(struct pell_context *ctx, const struct pell_gpu_params *params, struct pell_gpu **out);
void pell_gpu_close(struct pell_gpu **gpu);
const char *pell_gpu_name(const struct pell_gpu *gpu); /* printable; valid as long as the gpu */
/* For tests: the n-th Vulkan call from now (counted from 1; 0: none) that can fail does, with out of memory. Returns the number of such
 * calls so far. */
uint64_t pell_gpu_fail_at(struct pell_gpu *gpu, uint64_t n);
/* Size of the largest possible buffer in bytes. */
uint64_t pell_gpu_buffer_most(const struct pell_gpu *gpu);
/* Device memory used by buffers. */
uint64_t pell_gpu_memory_used(struct pell_gpu *gpu);

/* Opens a gpu on a Vulkan 1.3 device of the calling program, with synchronization2 and maintenance4 enabled: Vulkan handles, and its
 * vkGetInstanceProcAddr. Nothing is submitted: command lists record into the caller's (pell_gpu_begin_in). */
struct pell_gpu_borrowed {
    struct VkInstance_T *instance;
    struct VkPhysicalDevice_T *physical_device;
    struct VkDevice_T *device;
    void (*(*address)(struct VkInstance_T *instance, const char *name))(void);
};
PELL_NODISCARD enum pell_result pell_gpu_borrow(struct pell_context *ctx, const struct pell_gpu_borrowed *params, struct pell_gpu **out);

/* --- Buffers --- */

enum pell_gpu_memory { PELL_GPU_ON_DEVICE, PELL_GPU_TO_DEVICE, PELL_GPU_FROM_DEVICE };

/* `size` above 0; contents undefined. `name` is for messages and captures; a constant. */
PELL_NODISCARD enum pell_result pell_gpu_buffer_create(struct pell_gpu *gpu, enum pell_gpu_memory memory, uint64_t size, const char *name,
                                                       struct pell_gpu_buffer **out);
/* Wraps an external VkBuffer of at least `size` bytes with storage usage, which must outlive this object. Passes read data visible to
 * compute shaders, and leave data written by compute shaders: barriers before and after are the caller's. */
PELL_NODISCARD enum pell_result pell_gpu_buffer_borrow(struct pell_gpu *gpu, uint64_t handle, uint64_t size, const char *name,
                                                       struct pell_gpu_buffer **out);
void pell_gpu_buffer_destroy(struct pell_gpu_buffer **buffer);
/* An id that no other buffer of the gpu has, or had: shows whether passes were made with this one. */
uint64_t pell_gpu_buffer_id(const struct pell_gpu_buffer *buffer);
/* Host memory of a mapped buffer: write before a list that reads it finishes, read after one that wrote it finished. */
void *pell_gpu_buffer_host(const struct pell_gpu_buffer *buffer);

/* --- Passes --- */

/* `constants`: specialisation constants 0 to count - 1 of the shader. `buffers`: shader->num_bindings of them, device-local or not;
 * borrowed as long as the pass lives. */
PELL_NODISCARD enum pell_result pell_gpu_pass_create(struct pell_gpu *gpu, const struct pell_shader *shader, const uint32_t *constants,
                                                     size_t num_constants, struct pell_gpu_buffer *const *buffers,
                                                     struct pell_gpu_pass **out);
void pell_gpu_pass_destroy(struct pell_gpu_pass **pass);

/* --- Commands --- */

PELL_NODISCARD enum pell_result pell_gpu_commands_create(struct pell_gpu *gpu, const char *name, struct pell_gpu_commands **out);
void pell_gpu_commands_destroy(struct pell_gpu_commands **commands); /* waits for running commands */

/* A list that records into external VkCommandBuffers, which have begun: pell_gpu_begin_in replaces pell_gpu_begin, and pell_gpu_end_in
 * replaces pell_gpu_finish. It has no times. */
PELL_NODISCARD enum pell_result pell_gpu_commands_borrow(struct pell_gpu *gpu, struct pell_gpu_commands **out);
void pell_gpu_begin_in(struct pell_gpu_commands *commands, struct VkCommandBuffer_T *command_buffer);
void pell_gpu_end_in(struct pell_gpu_commands *commands);

PELL_NODISCARD enum pell_result pell_gpu_begin(struct pell_gpu_commands *commands);
/* The commands up to the next mark are timed under this name (a constant), which is also their label in captures. Marks after the first
 * PELL_GPU_MARKS count as part of the last. */
void pell_gpu_mark(struct pell_gpu_commands *commands, const char *name);
/* Copies the first `size` bytes. */
void pell_gpu_copy(struct pell_gpu_commands *commands, struct pell_gpu_buffer *from, struct pell_gpu_buffer *to, uint64_t size);
/* Copies `size` bytes from byte `first` on, to the same offset. */
void pell_gpu_copy_part(struct pell_gpu_commands *commands, struct pell_gpu_buffer *from, struct pell_gpu_buffer *to, uint64_t first,
                        uint64_t size);
/* Dispatches so many workgroups, each count at most 65535. `push`: the shader's push constants, or NULL if it has none. */
void pell_gpu_run(struct pell_gpu_commands *commands, struct pell_gpu_pass *pass, const void *push, uint32_t x, uint32_t y, uint32_t z);
/* Runs the list and waits for its end. */
PELL_NODISCARD enum pell_result pell_gpu_finish(struct pell_gpu_commands *commands);

struct pell_gpu_time {
    const char *name;
    double seconds; /* by the device's clock; 0 without timestamps */
};
/* Times of the marks of the last finished list, in order; returns how many (at most `size`). */
size_t pell_gpu_times(const struct pell_gpu_commands *commands, struct pell_gpu_time *times, size_t size);

#endif
