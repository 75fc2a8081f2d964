/* SPDX-License-Identifier: MIT
 * device_absent.c - device.h where the build has no Vulkan: there is no device, and nothing but create and destroy is called. */
#include "render/irradiance/device.h"

enum pell_result pell_light_device_create(struct pell_context *ctx, struct pell_gpu *gpu, struct pell_light_device **out)
{
    (void) ctx, (void) gpu;
    *out = NULL;
    return PELL_ERR_DEVICE;
}

void pell_light_device_destroy(struct pell_light_device **device)
{
    *device = NULL;
}

enum pell_result pell_light_device_set_scene(struct pell_light_device *d, const struct pell_scene *scene)
{
    (void) d, (void) scene;
    return PELL_ERR_DEVICE;
}

void pell_light_device_drop_scene(struct pell_light_device *d)
{
    (void) d;
}

enum pell_result pell_light_device_set_lights(struct pell_light_device *d, const struct pell_lights *lights,
                                              const struct pell_specular_tables *tables)
{
    (void) d, (void) lights, (void) tables;
    return PELL_ERR_DEVICE;
}

void pell_light_device_drop_lights(struct pell_light_device *d)
{
    (void) d;
}

enum pell_result pell_light_device_reserve(struct pell_light_device *d, size_t points)
{
    (void) d, (void) points;
    return PELL_ERR_DEVICE;
}

const char *pell_light_device_refuses(const struct pell_light_device *d)
{
    (void) d;
    return "no Vulkan";
}

enum pell_result pell_light_device_set_thickness(struct pell_light_device *d, const struct pell_irradiance_params *params)
{
    (void) d, (void) params;
    return PELL_ERR_DEVICE;
}

const char *pell_light_device_refuses_transmission(const struct pell_light_device *d)
{
    (void) d;
    return "no Vulkan";
}

size_t pell_light_device_room(const struct pell_light_device *d)
{
    (void) d;
    return 0;
}

void pell_light_device_begin(struct pell_light_device *d)
{
    (void) d;
}

uint32_t pell_light_device_claim(struct pell_light_device *d, uint32_t points)
{
    (void) d, (void) points;
    return 0;
}

struct pell_lit_point *pell_light_device_points(const struct pell_light_device *d)
{
    (void) d;
    return NULL;
}

enum pell_result pell_light_device_run(struct pell_light_device *d, const struct pell_light_run *run)
{
    (void) d, (void) run;
    return PELL_ERR_DEVICE;
}

uint32_t *pell_light_device_slots(const struct pell_light_device *d)
{
    (void) d;
    return NULL;
}

const uint32_t *pell_light_device_result(const struct pell_light_device *d, size_t point)
{
    (void) d, (void) point;
    return NULL;
}

const uint32_t *pell_light_device_through(const struct pell_light_device *d, size_t point)
{
    (void) d, (void) point;
    return NULL;
}

struct pell_light_device_times pell_light_device_times(struct pell_light_device *d)
{
    (void) d;
    return (struct pell_light_device_times) { .points = 0 };
}
