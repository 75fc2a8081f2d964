/* SPDX-License-Identifier: MIT
 * device_state.h - state shared by the files that implement device.h. Private to them. */
#ifndef PELL_IRRADIANCE_DEVICE_STATE_H
#define PELL_IRRADIANCE_DEVICE_STATE_H

#include "render/irradiance/device.h"
#include "vulkan/gpu.h"

#include <stdatomic.h>

enum {
    ROOM_LEAST = 1 << 16,
    ROOM_MOST = 1 << 18,     /* points of a batch: fills a large GPU, for less than a second */
    RESULTS_MOST = 64 << 20, /* bytes of a batch's results */
    ENVIRONMENTS_MOST = 256,
    WORD = 16,
    TABLE = 4 * 3 * PELL_THICKNESS_STEPS /* floats of a thickness table: value, slab, spread, and slab of lights */
};

enum pell_light_buffer {
    NODES,
    TRIANGLES,
    LIGHTS,
    MATERIALS,
    TABLES,
    IMAGES,
    POINTS,
    RESULTS,
    MESHES,
    CORNERS, /* and on: transmission.comp */
    PARTS,
    THICKNESS,
    SKY, /* for picture/device.h */
    MATERIALS_UP,
    POINTS_UP,
    RESULTS_DOWN,
    THICKNESS_UP,
    BUFFERS
};

struct pell_light_device {
    struct pell_context *ctx; /* borrowed */
    struct pell_gpu *gpu;     /* borrowed */
    struct pell_gpu_commands *commands;
    struct pell_gpu_buffer *buffers[BUFFERS];
    struct pell_gpu_pass *direct, *transmission;
    const struct pell_scene *scene;   /* borrowed; NULL: none is set */
    const struct pell_lights *lights; /* borrowed; NULL: none are set */
    struct pell_light_data *sorted;   /* in the order of the device */
    uint32_t most_samples;            /* maximum number of samples of a light */
    const char *scene_why, *lights_why, *through_why;
    bool through;          /* thickness tables are set, */
    bool thickness_new;    /* and not sent yet; */
    size_t room_thickness; /* capacity in bytes */
    size_t wanted, room;   /* points */
    size_t room_words;     /* capacity in words per point */
    size_t words;          /* of a point of the last batch */
    size_t through_at;     /* index of the first word of transmission, if any */
    uint32_t *slots;
    _Atomic uint32_t used; /* points of the batch */
    uint32_t version;      /* number of times that buffers were dropped */
    struct pell_light_device_times times;
};

/* Whether some light's highlight is made in several slices. */
static inline bool light_device_has_state(const struct pell_light_device *d)
{
    return d->most_samples > PELL_LIT_PASSING; /* the smallest slice */
}

/* --- buffers.c ----------------------------------------------------------------------------------------------------------------------- */

/* Destroys buffers, and the passes that hold them. */
void light_device_drop_buffers(struct pell_light_device *d, enum pell_light_buffer first, enum pell_light_buffer last);
void light_device_drop_room(struct pell_light_device *d);
/* Makes the room, where lights say how large a point's result is, and the passes, where all of their buffers are there. */
PELL_NODISCARD enum pell_result light_device_prepare(struct pell_light_device *d);

#endif
