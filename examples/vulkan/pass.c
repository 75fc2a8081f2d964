/* SPDX-License-Identifier: MIT
 * pass.c - for engines on Vulkan: a program with its own device records screen-space into its command buffer, between its own commands.
 * Here its buffers show a marble wall, lit on its right half. Exit code 77: there is no device of Vulkan 1.3. */
#include <pellucid/context.h>
#include <pellucid/vulkan.h>

#include <math.h>
#include <stdio.h>
#include <vulkan/vulkan.h>

enum { WIDTH = 250, HEIGHT = 16, NO_DEVICE = 77 };
static const float SCALE = 10.0f, LIGHT = 100.0f; /* px/mm; W/m^2 */

/* Objects of an engine. */
struct engine {
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    uint32_t family;
    VkQueue queue;
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkBuffer buffers[3]; /* light, surface, result */
    VkDeviceMemory memory[3];
    void *host[3];
};

static void print_message(void *user, const struct pell_message *m)
{
    (void) user;
    fprintf(stderr, "%s: %s\n", m->where, m->what);
}

/* The first device of Vulkan 1.3 with a compute queue. */
static bool choose_device(struct engine *e)
{
    VkPhysicalDevice list[16];
    uint32_t count = 16;

    if (vkEnumeratePhysicalDevices(e->instance, &count, list) < 0)
        return false;
    for (uint32_t i = 0; i < count; i++) {
        VkPhysicalDeviceProperties properties;
        VkQueueFamilyProperties families[16];
        uint32_t num_families = 16;

        vkGetPhysicalDeviceProperties(list[i], &properties);
        vkGetPhysicalDeviceQueueFamilyProperties(list[i], &num_families, families);
        for (uint32_t f = 0; properties.apiVersion >= VK_API_VERSION_1_3 && f < num_families; f++)
            if (families[f].queueFlags & VK_QUEUE_COMPUTE_BIT) {
                e->physical = list[i];
                e->family = f;
                printf("device: %s\n", properties.deviceName);
                return true;
            }
    }
    return false;
}

static bool open_device(struct engine *e)
{
    const VkApplicationInfo application = { .sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_3 };
    const VkInstanceCreateInfo instance = { .sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &application };
    const float priority = 1.0f;
    VkDeviceQueueCreateInfo queue = { .sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, .queueCount = 1, .pQueuePriorities = &priority };
    VkPhysicalDeviceVulkan13Features features = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES,
                                                  .synchronization2 = VK_TRUE, /* the library needs these two */
                                                  .maintenance4 = VK_TRUE };
    const VkDeviceCreateInfo device = {
        .sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, .pNext = &features, .queueCreateInfoCount = 1, .pQueueCreateInfos = &queue
    };
    VkCommandPoolCreateInfo pool = { .sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO };
    VkCommandBufferAllocateInfo commands = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, .commandBufferCount = 1 };

    if (vkCreateInstance(&instance, NULL, &e->instance) != VK_SUCCESS || !choose_device(e))
        return false;
    queue.queueFamilyIndex = pool.queueFamilyIndex = e->family;
    if (vkCreateDevice(e->physical, &device, NULL, &e->device) != VK_SUCCESS)
        return false;
    vkGetDeviceQueue(e->device, e->family, 0, &e->queue);
    if (vkCreateCommandPool(e->device, &pool, NULL, &e->pool) != VK_SUCCESS)
        return false;
    commands.commandPool = e->pool;
    return vkAllocateCommandBuffers(e->device, &commands, &e->commands) == VK_SUCCESS;
}

/* A buffer that is visible to the host, too: an engine would have its lighting pass write it, or copy an image into it. */
static bool create_buffer(struct engine *e, int which, VkDeviceSize size)
{
    const VkMemoryPropertyFlags wanted = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    const VkBufferCreateInfo info = { .sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                      .size = size,
                                      .usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT };
    VkMemoryAllocateInfo memory = { .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO };
    VkPhysicalDeviceMemoryProperties types;
    VkMemoryRequirements needs;

    if (vkCreateBuffer(e->device, &info, NULL, &e->buffers[which]) != VK_SUCCESS)
        return false;
    vkGetBufferMemoryRequirements(e->device, e->buffers[which], &needs);
    vkGetPhysicalDeviceMemoryProperties(e->physical, &types);
    while (memory.memoryTypeIndex < types.memoryTypeCount && (!(needs.memoryTypeBits >> memory.memoryTypeIndex & 1) ||
                                                              (types.memoryTypes[memory.memoryTypeIndex].propertyFlags & wanted) != wanted))
        memory.memoryTypeIndex++;
    memory.allocationSize = needs.size;
    return memory.memoryTypeIndex < types.memoryTypeCount && vkAllocateMemory(e->device, &memory, NULL, &e->memory[which]) == VK_SUCCESS &&
           vkBindBufferMemory(e->device, e->buffers[which], e->memory[which], 0) == VK_SUCCESS &&
           vkMapMemory(e->device, e->memory[which], 0, VK_WHOLE_SIZE, 0, &e->host[which]) == VK_SUCCESS;
}

static void close_device(struct engine *e)
{
    for (int i = 0; i < 3 && e->device; i++) {
        vkDestroyBuffer(e->device, e->buffers[i], NULL);
        vkFreeMemory(e->device, e->memory[i], NULL);
    }
    if (e->device)
        vkDestroyCommandPool(e->device, e->pool, NULL);
    if (e->device)
        vkDestroyDevice(e->device, NULL);
    if (e->instance)
        vkDestroyInstance(e->instance, NULL);
}

/* The engine's frame: its own commands before and after are left out here, except for the barrier before the result is read. */
static bool render_frame(struct engine *e, struct pell_vulkan_pass *pass)
{
    const VkCommandBufferBeginInfo begin = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO };
    const VkMemoryBarrier2 barrier = { .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER_2,
                                       .srcStageMask = VK_PIPELINE_STAGE_2_COPY_BIT,
                                       .srcAccessMask = VK_ACCESS_2_TRANSFER_WRITE_BIT,
                                       .dstStageMask = VK_PIPELINE_STAGE_2_HOST_BIT,
                                       .dstAccessMask = VK_ACCESS_2_HOST_READ_BIT };
    const VkDependencyInfo read = { .sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO, .memoryBarrierCount = 1, .pMemoryBarriers = &barrier };
    const VkSubmitInfo submit = { .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &e->commands };

    if (vkBeginCommandBuffer(e->commands, &begin) != VK_SUCCESS || pell_vulkan_pass_record(pass, e->commands, 500.0f) != PELL_OK)
        return false;
    vkCmdPipelineBarrier2(e->commands, &read);
    return vkEndCommandBuffer(e->commands) == VK_SUCCESS && vkQueueSubmit(e->queue, 1, &submit, VK_NULL_HANDLE) == VK_SUCCESS &&
           vkQueueWaitIdle(e->queue) == VK_SUCCESS;
}

/* The output of the lighting pass: a facing wall, 500 mm away. */
static void fill(const struct engine *e)
{
    float *light = e->host[0];
    uint32_t *surface = e->host[1];

    for (int i = 0; i < pell_vulkan_pitch(WIDTH) * HEIGHT; i++) {
        const int x = i % pell_vulkan_pitch(WIDTH);
        light[4 * i] = light[4 * i + 1] = light[4 * i + 2] = x >= WIDTH / 2 ? LIGHT : 0.0f;
        light[4 * i + 3] = 500.0f;
        surface[2 * i] = 1;
        surface[2 * i + 1] = 0x3f800000; /* 1.0f */
    }
}

/* Half-lit plane: R convolved with a step, as a sum of error functions. Returns the largest difference. */
static double check(const struct engine *e, const struct pell_medium *medium)
{
    const float *result = e->host[2];
    struct pell_gaussians fit;
    double worst = 0.0;

    if (pell_fit_medium(medium, &(struct pell_fit_params) { .count = 4 }, &fit, NULL) != PELL_OK)
        return INFINITY;
    for (int x = WIDTH / 2 - 28; x < WIDTH / 2 + 29; x++)
        for (int c = 0; c < 3; c++) {
            const double mm = (x + 0.5 - WIDTH / 2) / (double) SCALE;
            const float got = result[4 * (HEIGHT / 2 * pell_vulkan_pitch(WIDTH) + x) + c];
            double sum = 0.0;
            for (int i = 0; i < fit.count; i++)
                sum += fit.weight[i][c] * 0.5 * (1.0 + erf(mm / sqrt(2.0 * fit.variance[i])));
            worst = fmax(worst, fabs((double) got - sum * (double) LIGHT));
        }
    return worst;
}

int main(void)
{
    const struct pell_material_entry *marble = pell_material_find("marble");
    const struct pell_frame_material wall = { .medium = marble->medium, .name = marble->name };
    const struct pell_frame_shape shape = {
        .width = WIDTH, .height = HEIGHT, .orthographic = true, .focal_px = SCALE, .materials = &wall, .num_materials = 1
    };
    const VkDeviceSize pixels = (VkDeviceSize) (pell_vulkan_pitch(WIDTH) * HEIGHT);
    struct engine e = { .family = 0 };
    struct pell_context *ctx = NULL;
    struct pell_vulkan_pass *pass = NULL;
    double worst = INFINITY;
    bool good = open_device(&e);

    if (!good) {
        fprintf(stderr, "no device of Vulkan 1.3\n");
        close_device(&e);
        return NO_DEVICE;
    }
    good = create_buffer(&e, 0, pixels * 16) && create_buffer(&e, 1, pixels * 8) && create_buffer(&e, 2, pixels * 16) &&
           pell_context_create(&(struct pell_context_params) { .log = print_message }, &ctx) == PELL_OK;
    if (good) {
        const struct pell_vulkan_device_params device = { e.instance, e.physical, e.device, vkGetInstanceProcAddr };
        const struct pell_vulkan_buffers buffers = { (uint64_t) e.buffers[0], (uint64_t) e.buffers[1], (uint64_t) e.buffers[2] };

        fill(&e);
        good = pell_vulkan_pass_create(ctx, &device, pell_method_find(ctx, "pass.c", "screen-space"), NULL, &shape, &buffers, &pass) ==
                   PELL_OK &&          /* once */
               render_frame(&e, pass); /* every frame: allocates nothing */
    }
    if (good)
        worst = check(&e, &wall.medium);
    printf("largest difference from the closed form: %.2f W/m^2 of %g\n", worst, (double) LIGHT);
    pell_vulkan_pass_destroy(&pass);
    pell_context_destroy(&ctx);
    close_device(&e);
    return worst < 1.0 ? 0 : 1;
}
