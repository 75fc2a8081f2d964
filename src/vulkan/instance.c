/* SPDX-License-Identifier: MIT
 * instance.c - opens the Vulkan loader and an instance, with the validation layer if requested. */
#define _GNU_SOURCE /* dl_iterate_phdr */
#include "vulkan/instance.h"

#include <dlfcn.h>
#include <link.h>
#include <string.h>

#define LAYER "VK_LAYER_KHRONOS_validation"

static const char *result_name(VkResult result)
{
    switch (result) {
    case VK_ERROR_OUT_OF_HOST_MEMORY: return "out of host memory";
    case VK_ERROR_OUT_OF_DEVICE_MEMORY: return "out of device memory";
    case VK_ERROR_INITIALIZATION_FAILED: return "initialization failed";
    case VK_ERROR_DEVICE_LOST: return "the device was lost";
    case VK_ERROR_MEMORY_MAP_FAILED: return "memory can't be mapped";
    case VK_ERROR_LAYER_NOT_PRESENT: return "a layer is not present";
    case VK_ERROR_EXTENSION_NOT_PRESENT: return "an extension is not present";
    case VK_ERROR_FEATURE_NOT_PRESENT: return "a feature is not present";
    case VK_ERROR_INCOMPATIBLE_DRIVER: return "the driver is incompatible";
    case VK_ERROR_TOO_MANY_OBJECTS: return "too many objects";
    case VK_TIMEOUT: return "timeout";
    default: return "error";
    }
}

enum pell_result pell_vk_failed(struct pell_context *ctx, const char *call, VkResult result)
{
    const bool memory = result == VK_ERROR_OUT_OF_HOST_MEMORY || result == VK_ERROR_OUT_OF_DEVICE_MEMORY;
    const char *hint = memory                                     ? "use a smaller image, or --engine cpu"
                       : result == VK_ERROR_INITIALIZATION_FAILED ? "drivers say so where memory ends, too; or use --engine cpu"
                                                                  : "use --engine cpu";

    return pell_error(ctx, memory ? PELL_ERR_NOMEM : PELL_ERR_DEVICE, "vulkan", hint, "%s failed: %s (VkResult %d)", call,
                      result_name(result), (int) result);
}

/* Called by the layer, possibly from a driver's thread. */
static VKAPI_ATTR VkBool32 VKAPI_CALL take_message(VkDebugUtilsMessageSeverityFlagBitsEXT severity, VkDebugUtilsMessageTypeFlagsEXT types,
                                                   const VkDebugUtilsMessengerCallbackDataEXT *data, void *user)
{
    (void) severity;
    (void) types;
    pell_error(user, PELL_ERR_DEVICE, "vulkan validation", NULL, "%s", data->pMessage ? data->pMessage : "a message without text");
    return VK_FALSE;
}

/* Whether the loader exists and supports instances above 1.0; if not, *why gives the reason. */
static bool open_loader(struct pell_vk_instance *v, const char **why)
{
    PFN_vkEnumerateInstanceVersion get_version;
    uint32_t version = VK_API_VERSION_1_0;

    *why = "there is no Vulkan loader: install libvulkan1";
    v->loader = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
    v->address = v->loader ? (PFN_vkGetInstanceProcAddr) dlsym(v->loader, "vkGetInstanceProcAddr") : NULL;
    if (!v->address)
        return false;
    *why = "the Vulkan loader is older than 1.1";
    get_version = (PFN_vkEnumerateInstanceVersion) v->address(NULL, "vkEnumerateInstanceVersion");
    return get_version && get_version(&version) == VK_SUCCESS && version >= VK_API_VERSION_1_1;
}

static bool has_extension(const struct pell_vk_instance *v, const char *name)
{
    const PFN_vkEnumerateInstanceExtensionProperties list =
        (PFN_vkEnumerateInstanceExtensionProperties) v->address(NULL, "vkEnumerateInstanceExtensionProperties");
    VkExtensionProperties found[64];
    uint32_t count = PELL_COUNT(found);
    VkResult result;

    if (!list)
        return false;
    result = list(NULL, &count, found);
    for (uint32_t i = 0; (result == VK_SUCCESS || result == VK_INCOMPLETE) && i < count; i++)
        if (strcmp(found[i].extensionName, name) == 0)
            return true;
    return false;
}

static bool has_layer(const struct pell_vk_instance *v)
{
    const PFN_vkEnumerateInstanceLayerProperties list =
        (PFN_vkEnumerateInstanceLayerProperties) v->address(NULL, "vkEnumerateInstanceLayerProperties");
    VkLayerProperties found[64];
    uint32_t count = PELL_COUNT(found);
    VkResult result;

    if (!list)
        return false;
    result = list(&count, found);
    for (uint32_t i = 0; (result == VK_SUCCESS || result == VK_INCOMPLETE) && i < count; i++)
        if (strcmp(found[i].layerName, LAYER) == 0)
            return true;
    return false;
}

/* --- Keeping drivers loaded -------------------------------------------------------------------------------------------------------- */

/* The loader unloads drivers with the last instance. Each time that NVIDIA's is reloaded it takes static thread storage that the C library
 * never gets back: after some 30 instances none is left, and the driver fails to load. So libraries that an instance has loaded stay
 * loaded. */

enum { MAX_LIBRARIES = 1024, MAX_NEW = 128, MAX_PATH = 256 };

struct libraries {
    ElfW(Addr) base[MAX_LIBRARIES];
    int count;
};

struct new_libraries {
    const struct libraries *before;
    char path[MAX_NEW][MAX_PATH];
    int count;
};

static int list_library(struct dl_phdr_info *info, size_t size, void *user)
{
    struct libraries *list = user;

    (void) size;
    list->base[list->count++] = info->dlpi_addr;
    return list->count == MAX_LIBRARIES;
}

static int list_new_library(struct dl_phdr_info *info, size_t size, void *user)
{
    struct new_libraries *list = user;

    (void) size;
    for (int i = 0; i < list->before->count; i++)
        if (list->before->base[i] == info->dlpi_addr)
            return 0;
    if (info->dlpi_name && info->dlpi_name[0] && strlen(info->dlpi_name) < MAX_PATH)
        memcpy(list->path[list->count++], info->dlpi_name, strlen(info->dlpi_name) + 1);
    return list->count == MAX_NEW;
}

static void keep_loaded(const struct libraries *before)
{
    struct new_libraries list = { .before = before };

    dl_iterate_phdr(list_new_library, &list);
    for (int i = 0; i < list.count; i++) {
        void *library = dlopen(list.path[i], RTLD_LAZY | RTLD_NOLOAD | RTLD_NODELETE);
        if (library)
            dlclose(library);
    }
}

/* --- Instances ---------------------------------------------------------------------------------------------------------------------- */

/* Returns VK_ERROR_INCOMPATIBLE_DRIVER, with nothing created, if there is no driver. */
static VkResult create_instance(struct pell_context *ctx, struct pell_vk_instance *v, bool validate)
{
    static const char *const layers[] = { LAYER };
    static const VkValidationFeatureEnableEXT checks[] = { VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT };
    const char *extensions[] = { VK_EXT_DEBUG_UTILS_EXTENSION_NAME, VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME };
    const VkDebugUtilsMessengerCreateInfoEXT messenger = {
        .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT,
        .messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
        .messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT,
        .pfnUserCallback = take_message,
        .pUserData = ctx,
    };
    const VkValidationFeaturesEXT features = { .sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT,
                                               .enabledValidationFeatureCount = PELL_COUNT(checks),
                                               .pEnabledValidationFeatures = checks };
    const VkApplicationInfo application = { .sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
                                            .pApplicationName = "pellucid",
                                            .apiVersion = VK_API_VERSION_1_3 };
    const VkInstanceCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
        .pNext = validate ? &features : NULL,
        .pApplicationInfo = &application,
        .enabledLayerCount = validate ? 1 : 0,
        .ppEnabledLayerNames = layers,
        .enabledExtensionCount = validate    ? 2
                                 : v->labels ? 1
                                             : 0,
        .ppEnabledExtensionNames = extensions,
    };
    const PFN_vkCreateInstance create = (PFN_vkCreateInstance) v->address(NULL, "vkCreateInstance");
    PFN_vkCreateDebugUtilsMessengerEXT create_messenger;
    VkResult result = create ? create(&info, NULL, &v->handle) : VK_ERROR_INITIALIZATION_FAILED;

    if (result != VK_SUCCESS) {
        v->handle = VK_NULL_HANDLE;
        return result;
    }
#define LOAD(name) v->name = (PFN_vk##name) v->address(v->handle, "vk" #name);
    PELL_VK_INSTANCE_FUNCTIONS(LOAD)
#undef LOAD
    create_messenger = (PFN_vkCreateDebugUtilsMessengerEXT) v->address(v->handle, "vkCreateDebugUtilsMessengerEXT");
    return validate && create_messenger ? create_messenger(v->handle, &messenger, NULL, &v->messenger) : VK_SUCCESS;
}

enum pell_result pell_vk_instance_open(struct pell_context *ctx, bool validate, struct pell_vk_instance *out, const char **why)
{
    struct libraries before = { .count = 0 };
    VkResult result;

    *out = (struct pell_vk_instance) { .loader = NULL };
    dl_iterate_phdr(list_library, &before);
    if (!open_loader(out, why))
        return PELL_OK;
    out->labels = has_extension(out, VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
    if (validate && !(has_layer(out) && out->labels))
        return pell_error(ctx, PELL_ERR_DEVICE, "vulkan", "install vulkan-validationlayers", "the layer %s is not installed", LAYER);
    *why = "there is no Vulkan driver: install one (mesa-vulkan-drivers)";
    result = create_instance(ctx, out, validate);
    keep_loaded(&before);
    return result == VK_SUCCESS || result == VK_ERROR_INCOMPATIBLE_DRIVER ? PELL_OK : pell_vk_failed(ctx, "vkCreateInstance", result);
}

void pell_vk_instance_close(struct pell_vk_instance *v)
{
    if (v->handle) {
        const PFN_vkDestroyDebugUtilsMessengerEXT destroy_messenger =
            (PFN_vkDestroyDebugUtilsMessengerEXT) v->address(v->handle, "vkDestroyDebugUtilsMessengerEXT");
        if (v->messenger && destroy_messenger)
            destroy_messenger(v->handle, v->messenger, NULL);
        v->DestroyInstance(v->handle, NULL);
    }
    if (v->loader)
        dlclose(v->loader);
    *v = (struct pell_vk_instance) { .loader = NULL };
}
