/* SPDX-License-Identifier: MIT
 *
 * device.h - direct light and transmission through thin parts on a Vulkan device: the scene's triangles, lights and tables are kept there,
 * points are sent in batches, and the light of all lights at them is read back (device_data.h, direct.comp, transmission.comp). The CPU
 * computes the rest of the stage (stage.h).
 *
 * Ownership  pell_light_device_destroy sets the pointer to NULL and accepts NULL in it. Scene, lights and tables are borrowed while they
 *            are set.
 * Errors     as in gpu.h; previous contents are then dropped.
 * Threads    one at a time, except for claims and for reading results.
 */
#ifndef PELL_IRRADIANCE_DEVICE_H
#define PELL_IRRADIANCE_DEVICE_H

#include "render/irradiance/device_data.h"
#include "render/irradiance/stage.h"

struct pell_gpu;
struct pell_gpu_buffer;
struct pell_gpu_commands;
struct pell_light_device;

PELL_NODISCARD enum pell_result pell_light_device_create(struct pell_context *ctx, struct pell_gpu *gpu, struct pell_light_device **out);
void pell_light_device_destroy(struct pell_light_device **device);

/* Builds the bounding volume hierarchy for rays. */
PELL_NODISCARD enum pell_result pell_light_device_set_scene(struct pell_light_device *d, const struct pell_scene *scene);
void pell_light_device_drop_scene(struct pell_light_device *d);
/* Sets the lights of the current scene. */
PELL_NODISCARD enum pell_result pell_light_device_set_lights(struct pell_light_device *d, const struct pell_lights *lights,
                                                             const struct pell_specular_tables *tables);
void pell_light_device_drop_lights(struct pell_light_device *d);
/* Reserves buffers for batches of so many points, within limits. */
PELL_NODISCARD enum pell_result pell_light_device_reserve(struct pell_light_device *d, size_t points);

/* Returns why the CPU computes direct light, as named in a row of the timings; NULL: the device does. A constant. */
const char *pell_light_device_refuses(const struct pell_light_device *d);

/* Sets the thickness tables of params for the next frame, if there are any. Batches then include transmission. */
PELL_NODISCARD enum pell_result pell_light_device_set_thickness(struct pell_light_device *d, const struct pell_irradiance_params *params);
/* Returns why the CPU computes transmission although the device computes direct light, as above; NULL: the device does, or there is
 * none. */
const char *pell_light_device_refuses_transmission(const struct pell_light_device *d);

/* --- Batches ------------------------------------------------------------------------------------------------------------------------- */

/* Available room, in points. */
size_t pell_light_device_room(const struct pell_light_device *d);
/* Begins an empty batch. */
void pell_light_device_begin(struct pell_light_device *d);
/* Claims so many points of the batch, which the caller then writes, and returns the first. All together must fit the room. Any thread. */
uint32_t pell_light_device_claim(struct pell_light_device *d, uint32_t points);
/* Points of the batch, to be written in order of address. */
struct pell_lit_point *pell_light_device_points(const struct pell_light_device *d);
/* One value per 16 points of the batch, for the caller's use. */
uint32_t *pell_light_device_slots(const struct pell_light_device *d);

struct pell_light_run {
    const struct pell_irradiance_params *params;
    bool highlights; /* highlights are required */
};
/* Computes the light of the claimed points. */
PELL_NODISCARD enum pell_result pell_light_device_run(struct pell_light_device *d, const struct pell_light_run *run);
/* Results of the last batch: a point's words, and those of transmission among them. */
const uint32_t *pell_light_device_result(const struct pell_light_device *d, size_t point);
const uint32_t *pell_light_device_through(const struct pell_light_device *d, size_t point);

/* --- Batches with points made on the device (picture/device.h) ------------------------------------------------------------------------ */

/* Buffers for passes, which are recreated when `version` changes; NULL where a buffer is not needed. `points` and `results` belong to
 * one batch; `sky` holds pell_lights_environment_words of `environments`, NULL if no buffer holds them. */
struct pell_light_lent {
    struct pell_gpu_buffer *nodes, *triangles, *meshes, *corners, *materials, *tables, *points, *results, *thickness, *sky;
    size_t room;
    size_t environments;
    uint32_t version, together; /* as in pell_lights */
};
struct pell_light_lent pell_light_device_lend(const struct pell_light_device *d);

/* Layout of a point's words: their number, and the first one of transmission, if there is any. */
struct pell_light_layout {
    uint32_t words, through_at;
    bool through;
};
/* Record into a command list: the uploads of a frame, before all of its batches; and the light of the first `points` of `points`. Call
 * pell_light_device_recorded once the list has run. */
void pell_light_device_upload(struct pell_light_device *d, const struct pell_light_run *run, struct pell_gpu_commands *commands);
struct pell_light_layout pell_light_device_record(struct pell_light_device *d, const struct pell_light_run *run,
                                                  struct pell_gpu_commands *commands, size_t points);
void pell_light_device_recorded(struct pell_light_device *d, const struct pell_light_run *run);

/* Timings and counts of all batches since the last call. */
struct pell_light_device_times {
    double upload, light, transmission, download; /* seconds, by the device's clock */
    int64_t points, bytes_up, bytes_down;
};
struct pell_light_device_times pell_light_device_times(struct pell_light_device *d);

#endif
