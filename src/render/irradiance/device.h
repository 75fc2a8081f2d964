/* SPDX-License-Identifier: MIT
 *
 * device.h - direct light, and what is transmitted through thin parts, on a Vulkan device: the scene's triangles, the lights and the tables
 * are kept there, points come in batches, and what all lights give them goes back (device_data.h, direct.comp, transmission.comp). The rest
 * of the stage is the cpu's (stage.h).
 *
 * Ownership  pell_light_device_destroy sets the pointer to NULL and accepts NULL in it. Scene, lights and tables are borrowed while they
 *            are set.
 * Errors     as gpu.h has them; what was set before is then dropped.
 * Threads    one at a time, but for claims and for reading results.
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

/* Builds the hierarchy that rays go through. */
PELL_NODISCARD enum pell_result pell_light_device_set_scene(struct pell_light_device *d, const struct pell_scene *scene);
void pell_light_device_drop_scene(struct pell_light_device *d);
/* Of the scene that is set. */
PELL_NODISCARD enum pell_result pell_light_device_set_lights(struct pell_light_device *d, const struct pell_lights *lights,
                                                             const struct pell_specular_tables *tables);
void pell_light_device_drop_lights(struct pell_light_device *d);
/* Room for batches of at least so many points, or of as many as are worth one. */
PELL_NODISCARD enum pell_result pell_light_device_reserve(struct pell_light_device *d, size_t points);

/* Why the cpu finds direct light in what is set, as the name of a row of times says it; NULL: the device does. A constant. */
const char *pell_light_device_refuses(const struct pell_light_device *d);

/* Of the frame that follows: the thickness tables of params, if it has any. Batches of it have what is transmitted then, too. */
PELL_NODISCARD enum pell_result pell_light_device_set_thickness(struct pell_light_device *d, const struct pell_irradiance_params *params);
/* Why the cpu finds transmission though the device finds direct light, as above; NULL: the device does, or there is none. */
const char *pell_light_device_refuses_transmission(const struct pell_light_device *d);

/* --- Batches ------------------------------------------------------------------------------------------------------------------------- */

/* The room that there is. */
size_t pell_light_device_room(const struct pell_light_device *d);
/* An empty batch. */
void pell_light_device_begin(struct pell_light_device *d);
/* The first of so many points of the batch, which are the caller's to write; all together no more than the room. By any thread. */
uint32_t pell_light_device_claim(struct pell_light_device *d, uint32_t points);
/* The points of the batch, to be written in order of address. */
struct pell_lit_point *pell_light_device_points(const struct pell_light_device *d);
/* For the caller's use: a number for each 16 points of the room. */
uint32_t *pell_light_device_slots(const struct pell_light_device *d);

struct pell_light_run {
    const struct pell_irradiance_params *params;
    bool highlights; /* what is mirrored is asked for */
};
/* Lights what was claimed. */
PELL_NODISCARD enum pell_result pell_light_device_run(struct pell_light_device *d, const struct pell_light_run *run);
/* Of the last batch: a point's words, and those of transmission among them. */
const uint32_t *pell_light_device_result(const struct pell_light_device *d, size_t point);
const uint32_t *pell_light_device_through(const struct pell_light_device *d, size_t point);

/* --- Batches whose points are made on the device (picture/device.h) ------------------------------------------------------------------ */

/* What there is, for passes that are made anew when `version` is another; NULL where nothing needs it. `points` and `results` are of one
 * batch; `sky` is pell_lights_environment_words of `environments`, NULL where no buffer holds them. */
struct pell_light_lent {
    struct pell_gpu_buffer *nodes, *triangles, *meshes, *corners, *materials, *tables, *points, *results, *thickness, *sky;
    size_t room;
    size_t environments;
    uint32_t version, together; /* of pell_lights */
};
struct pell_light_lent pell_light_device_lend(const struct pell_light_device *d);

/* Of a point's words: how many, and the first of transmission, where there is some. */
struct pell_light_layout {
    uint32_t words, through_at;
    bool through;
};
/* Record into a list: what a frame sends, before all of its batches; and the light of the first `points` of `points`. Once the list has
 * run, the last. */
void pell_light_device_upload(struct pell_light_device *d, const struct pell_light_run *run, struct pell_gpu_commands *commands);
struct pell_light_layout pell_light_device_record(struct pell_light_device *d, const struct pell_light_run *run,
                                                  struct pell_gpu_commands *commands, size_t points);
void pell_light_device_recorded(struct pell_light_device *d, const struct pell_light_run *run);

/* Of all batches since the last call. */
struct pell_light_device_times {
    double upload, light, transmission, download; /* by the device's clock */
    int64_t points, bytes_up, bytes_down;
};
struct pell_light_device_times pell_light_device_times(struct pell_light_device *d);

#endif
