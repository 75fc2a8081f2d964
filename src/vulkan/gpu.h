/* SPDX-License-Identifier: MIT
 *
 * gpu.h - a Vulkan device that computes: buffers, compute passes, lists of commands. Needs no headers of Vulkan.
 *
 *     pell_gpu_open(ctx, &params, &gpu);
 *     pell_gpu_buffer_create(gpu, PELL_GPU_TO_DEVICE, size, "in", &in);                    // and others
 *     pell_gpu_pass_create(gpu, &pell_blur_shader, constants, 1, buffers, &blur);          // a shader with its buffers
 *     pell_gpu_commands_create(gpu, 8, &list);
 *     pell_gpu_begin(list); pell_gpu_mark(list, "blur"); pell_gpu_run(list, blur, &push, 64, 64, 1); ... pell_gpu_finish(list);
 *
 * What a pass does with a buffer is what its shader declares (readonly, writeonly): barriers follow from it.
 *
 * Units      bytes, seconds.
 * Ownership  X_destroy and pell_gpu_close set the pointer to NULL and accept NULL in it. All objects of a gpu go before it. Nothing is
 *            allocated between pell_gpu_begin and pell_gpu_finish, but for shaders from a folder.
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
struct VkInstance_T; /* of Vulkan */
struct VkPhysicalDevice_T;
struct VkDevice_T;
struct VkCommandBuffer_T;

enum { PELL_GPU_BINDINGS = 16, PELL_GPU_PUSH = 128, PELL_GPU_MARKS = 64 };
enum pell_gpu_access { PELL_GPU_READS = 1, PELL_GPU_WRITES = 2 };

/* A compute shader, as scripts/make_shader.py writes it: what it declares is found in its SPIR-V. */
struct pell_shader {
    const char *name;
    const uint32_t *words;
    size_t size; /* bytes */
    int num_bindings;
    uint8_t access[PELL_GPU_BINDINGS]; /* enum pell_gpu_access, of the storage buffers 0 to num_bindings - 1 of set 0 */
    uint32_t push_size;                /* bytes of push constants */
    uint32_t local[3];                 /* invocations of a workgroup */
};

struct pell_gpu_params {
    const char *device;  /* a number in the order of pell_vulkan_devices_find, or a piece of a name; NULL: that function's choice */
    const char *cache;   /* a folder (made where its parent is there) for what the driver compiles, to be read by the next run; NULL: none.
                         * A damaged file is made anew; what can't be written is not */
    const char *shaders; /* a folder whose files NAME.spv replace the shaders of that name (replace.c); NULL: none */
    bool validate;       /* with the validation layer, of calls and of synchronisation: its messages are logged as errors */
    uint64_t fail_at;    /* for tests: as pell_gpu_fail_at, from the first call on; 0: none */
};

/* `params` may be NULL. */
PELL_NODISCARD enum pell_result pell_gpu_open(struct pell_context *ctx, const struct pell_gpu_params *params, struct pell_gpu **out);
void pell_gpu_close(struct pell_gpu **gpu);
const char *pell_gpu_name(const struct pell_gpu *gpu); /* printable; as long as the gpu */
/* For tests: the n-th call of Vulkan from now (counted from 1; 0: none) that can fail does, with too little memory. Returns how many
 * there were so far. */
uint64_t pell_gpu_fail_at(struct pell_gpu *gpu, uint64_t n);
/* Bytes of the largest buffer. */
uint64_t pell_gpu_buffer_most(const struct pell_gpu *gpu);
/* Device memory that buffers have. */
uint64_t pell_gpu_memory_used(struct pell_gpu *gpu);

/* On a Vulkan 1.3 device of the caller's program, whose features synchronization2 and maintenance4 are on: handles of Vulkan, and its
 * function vkGetInstanceProcAddr. Nothing is submitted: lists of commands record into the caller's (pell_gpu_begin_in). */
struct pell_gpu_borrowed {
    struct VkInstance_T *instance;
    struct VkPhysicalDevice_T *physical_device;
    struct VkDevice_T *device;
    void (*(*address)(struct VkInstance_T *instance, const char *name))(void);
};
PELL_NODISCARD enum pell_result pell_gpu_borrow(struct pell_context *ctx, const struct pell_gpu_borrowed *params, struct pell_gpu **out);

/* --- Buffers --- */

enum pell_gpu_place { PELL_GPU_ON_DEVICE, PELL_GPU_TO_DEVICE, PELL_GPU_FROM_DEVICE };

/* `size` above 0; contents undefined. `name` is for messages and captures; a constant. */
PELL_NODISCARD enum pell_result pell_gpu_buffer_create(struct pell_gpu *gpu, enum pell_gpu_place place, uint64_t size, const char *name,
                                                       struct pell_gpu_buffer **out);
/* The VkBuffer of someone else, of at least `size` bytes and for storage, that outlives this object. Passes find in it what compute shaders
 * may read, and leave there what compute shaders have written: barriers before and after are the caller's. */
PELL_NODISCARD enum pell_result pell_gpu_buffer_borrow(struct pell_gpu *gpu, uint64_t handle, uint64_t size, const char *name,
                                                       struct pell_gpu_buffer **out);
void pell_gpu_buffer_destroy(struct pell_gpu_buffer **buffer);
/* A number that no other buffer of the gpu has, or had: whether passes were made with this one. */
uint64_t pell_gpu_buffer_number(const struct pell_gpu_buffer *buffer);
/* Its memory, of one that is not on the device: written before a list that reads it finishes, read after one that wrote it did. */
void *pell_gpu_buffer_host(const struct pell_gpu_buffer *buffer);

/* --- Passes --- */

/* `constants`: of the shader's specialisation constants 0 to count - 1. `buffers`: shader->num_bindings of them, on the device or not;
 * borrowed as long as the pass lives. */
PELL_NODISCARD enum pell_result pell_gpu_pass_create(struct pell_gpu *gpu, const struct pell_shader *shader, const uint32_t *constants,
                                                     size_t num_constants, struct pell_gpu_buffer *const *buffers,
                                                     struct pell_gpu_pass **out);
void pell_gpu_pass_destroy(struct pell_gpu_pass **pass);

/* --- Commands --- */

PELL_NODISCARD enum pell_result pell_gpu_commands_create(struct pell_gpu *gpu, const char *name, struct pell_gpu_commands **out);
void pell_gpu_commands_destroy(struct pell_gpu_commands **commands); /* waits for what still runs */

/* A list that records into VkCommandBuffers of someone else, which are begun: pell_gpu_begin_in in place of pell_gpu_begin, and
 * pell_gpu_end_in in place of pell_gpu_finish. It has no times. */
PELL_NODISCARD enum pell_result pell_gpu_commands_borrow(struct pell_gpu *gpu, struct pell_gpu_commands **out);
void pell_gpu_begin_in(struct pell_gpu_commands *commands, struct VkCommandBuffer_T *command_buffer);
void pell_gpu_end_in(struct pell_gpu_commands *commands);

PELL_NODISCARD enum pell_result pell_gpu_begin(struct pell_gpu_commands *commands);
/* What follows, up to the next mark, is timed under this name (a constant), which is its label in captures, too. The marks after the
 * first PELL_GPU_MARKS count as part of the last. */
void pell_gpu_mark(struct pell_gpu_commands *commands, const char *name);
/* The first `size` bytes. */
void pell_gpu_copy(struct pell_gpu_commands *commands, struct pell_gpu_buffer *from, struct pell_gpu_buffer *to, uint64_t size);
/* `size` bytes from byte `first` on, to the same place. */
void pell_gpu_copy_part(struct pell_gpu_commands *commands, struct pell_gpu_buffer *from, struct pell_gpu_buffer *to, uint64_t first,
                        uint64_t size);
/* So many workgroups, each at most 65535. `push`: the shader's push constants, or NULL where it has none. */
void pell_gpu_run(struct pell_gpu_commands *commands, struct pell_gpu_pass *pass, const void *push, uint32_t x, uint32_t y, uint32_t z);
/* Runs the list and waits for its end. */
PELL_NODISCARD enum pell_result pell_gpu_finish(struct pell_gpu_commands *commands);

struct pell_gpu_time {
    const char *name;
    double seconds; /* by the device's clock; 0 where it has none */
};
/* Of the marks of the last finished list, in their order; returns how many (at most `size`). */
size_t pell_gpu_times(const struct pell_gpu_commands *commands, struct pell_gpu_time *times, size_t size);

#endif
