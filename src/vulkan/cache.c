/* SPDX-License-Identifier: MIT
 *
 * cache.c - stores the driver's pipeline cache in a file between runs. A file that was not written completely for this exact device and
 * driver is ignored, as drivers trust the data; failing to write it is never an error.
 */
#include "vulkan/core.h"

#include "base/file.h"
#include "base/hash.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MAX_BYTES ((size_t) 64 << 20)

enum { VERSION = 1, DRIVER_HEADER = 32 /* bytes defined by Vulkan: size, version, vendor, device, UUID */ };

struct header {
    char magic[8];
    uint32_t version, vendor, device, driver;
    uint8_t uuid[VK_UUID_SIZE];
    uint64_t size, hash; /* of the data that follows */
};

static struct header header_of(const struct pell_gpu *gpu, const void *data, size_t size)
{
    VkPhysicalDeviceProperties p;
    struct header h = { .magic = "PELLVKC", .version = VERSION, .size = size, .hash = pell_hash_bytes(0, data, size) };

    gpu->instance.GetPhysicalDeviceProperties(gpu->physical, &p);
    h.vendor = p.vendorID;
    h.device = p.deviceID;
    h.driver = p.driverVersion;
    memcpy(h.uuid, p.pipelineCacheUUID, sizeof(h.uuid));
    return h;
}

/* Whether the driver's own header matches this device. */
static bool matches_driver(const struct header *h, const uint8_t *data, size_t size)
{
    uint32_t words[4];

    if (size < DRIVER_HEADER)
        return false;
    memcpy(words, data, sizeof(words));
    return words[0] >= DRIVER_HEADER && words[0] <= size && words[1] == VK_PIPELINE_CACHE_HEADER_VERSION_ONE && words[2] == h->vendor &&
           words[3] == h->device && memcmp(data + sizeof(words), h->uuid, sizeof(h->uuid)) == 0;
}

/* The cache file of the device in the folder; false: its name is too long. */
static bool name_file(struct pell_gpu *gpu, const char *folder)
{
    const struct header h = header_of(gpu, NULL, 0);
    const int length =
        snprintf(gpu->cache_path, sizeof(gpu->cache_path), "%s/vulkan-%08x-%08x-%08x.cache", folder, h.vendor, h.device, h.driver);

    return length > 0 && (size_t) length < sizeof(gpu->cache_path);
}

/* Whether the file is complete and was written for this device and driver. */
static bool is_ours(const struct pell_gpu *gpu, const uint8_t *file, size_t size)
{
    struct header found, wanted;

    if (size < sizeof(found))
        return false;
    memcpy(&found, file, sizeof(found));
    wanted = header_of(gpu, file + sizeof(found), size - sizeof(found));
    return memcmp(&found, &wanted, sizeof(found)) == 0 && matches_driver(&wanted, file + sizeof(found), size - sizeof(found));
}

/* Reads the file, which the caller frees; NULL if it is unusable. */
static enum pell_result read_file(struct pell_gpu *gpu, uint8_t **file, size_t *size)
{
    struct stat st;
    enum pell_result res;

    *file = NULL;
    if (stat(gpu->cache_path, &st) != 0 || !S_ISREG(st.st_mode) || access(gpu->cache_path, R_OK) != 0)
        return PELL_OK;
    if (st.st_size >= (off_t) sizeof(struct header) && st.st_size <= (off_t) MAX_BYTES) {
        res = pell_file_read(gpu->ctx, gpu->cache_path, file, size);
        if (res != PELL_OK || is_ours(gpu, *file, *size))
            return res;
        pell_free(gpu->ctx, *file);
        *file = NULL;
    }
    pell_warn(gpu->ctx, gpu->cache_path, NULL, "is damaged, or of another driver: it is ignored and will be replaced");
    return PELL_OK;
}

enum pell_result pell_vk_cache_open(struct pell_gpu *gpu, const char *folder)
{
    VkPipelineCacheCreateInfo info = { .sType = VK_STRUCTURE_TYPE_PIPELINE_CACHE_CREATE_INFO };
    uint8_t *file = NULL;
    size_t size = 0;
    enum pell_result res;

    if (!folder || !*folder || !name_file(gpu, folder)) {
        gpu->cache_path[0] = '\0';
        return PELL_OK;
    }
    PELL_TRY(read_file(gpu, &file, &size));
    if (file) {
        info.initialDataSize = size - sizeof(struct header);
        info.pInitialData = file + sizeof(struct header);
        gpu->cache_hash = pell_hash_bytes(0, info.pInitialData, info.initialDataSize);
    }
    res = PELL_VK(gpu, CreatePipelineCache, (gpu->device, &info, NULL, &gpu->cache));

fail:
    pell_free(gpu->ctx, file);
    return res;
}

/* Whether a file can be written there without errors; makes the last folder of the path. */
static bool is_writable(const char *path)
{
    const char *name = pell_path_name(path);
    char folder[sizeof(((struct pell_gpu *) NULL)->cache_path)];
    struct stat st;

    memcpy(folder, path, (size_t) (name - path));
    folder[name - path] = '\0';
    if (stat(path, &st) == 0)
        return S_ISREG(st.st_mode) && access(path, W_OK) == 0 && access(folder, W_OK) == 0;
    return (mkdir(folder, 0700) == 0 || access(folder, W_OK) == 0) && stat(folder, &st) == 0 && S_ISDIR(st.st_mode);
}

static void write_cache(struct pell_gpu *gpu)
{
    size_t size = 0;
    uint8_t *data;

    if (gpu->vk.GetPipelineCacheData(gpu->device, gpu->cache, &size, NULL) != VK_SUCCESS || size < DRIVER_HEADER || size > MAX_BYTES ||
        !is_writable(gpu->cache_path))
        return;
    data = pell_alloc(gpu->ctx, sizeof(struct header) + size);
    if (!data)
        return;
    if (gpu->vk.GetPipelineCacheData(gpu->device, gpu->cache, &size, data + sizeof(struct header)) == VK_SUCCESS) {
        const struct header h = header_of(gpu, data + sizeof(h), size);
        memcpy(data, &h, sizeof(h));
        if (h.hash != gpu->cache_hash)
            (void) !pell_file_write(gpu->ctx, gpu->cache_path, data, sizeof(h) + size);
    }
    pell_free(gpu->ctx, data);
}

void pell_vk_cache_close(struct pell_gpu *gpu)
{
    if (!gpu->cache)
        return;
    if (gpu->cache_used)
        write_cache(gpu);
    gpu->vk.DestroyPipelineCache(gpu->device, gpu->cache, NULL);
    gpu->cache = VK_NULL_HANDLE;
}
