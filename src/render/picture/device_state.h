/* SPDX-License-Identifier: MIT
 * device_state.h - state shared by the files that implement device.h. Private to them. */
#ifndef PELL_PICTURE_DEVICE_STATE_H
#define PELL_PICTURE_DEVICE_STATE_H

#include "render/picture/device.h"
#include "render/picture/device_data.h"

enum picture_buffer {
    EMPTY, /* bound in place of buffers that a frame does not need */
    MATERIALS,
    MATERIALS_UP,
    KEYS,
    KEYS_UP,
    FRAME,
    FRAME_UP,
    HITS,
    INSIDES,
    SHOWN,
    AROUND,
    THROUGH,
    SINGLE,
    HIGHLIGHTS,
    ENTERED, /* entering light before shadows are filtered */
    SPREAD_SUM,
    SPREAD_HALF,
    SUM,
    SUM_DOWN,
    ROWS,
    ROWS_DOWN,
    SHAPES, /* words of the data of solids */
    SOLIDS,
    BETWEEN,
    ATTRIBUTES, /* words of vertices, and of maps */
    MAPS,
    NO_LIGHT, /* planes of a method, if there is none */
    NO_SURFACE,
    BUFFERS,
    LIGHT = BUFFERS, /* the method's */
    ARRIVED,         /* LIGHT or ENTERED */
    SURFACE,
    RESULT,
    METHOD_HITS,
    METHOD_BASES,
    LENS,  /* planes of depth of field */
    NODES, /* the light's */
    TRIANGLES,
    MESHES,
    CORNERS,
    LIT,
    TABLES,
    POINTS,
    RESULTS,
    THICKNESS,
    SKY,
    ALL_BUFFERS
};

enum picture_pass {
    CLEAR,
    TRACE_CAMERA,
    ADD_INSIDE,
    FINISH,
    FILTER_HIGHLIGHTS,
    REDUCE_ROWS,
    SPREAD_SPLIT,
    SPREAD_ACROSS,
    SPREAD_DOWN,
    COMPOSE,
    PASSES
};

struct pell_picture_device {
    struct pell_context *ctx; /* borrowed */
    struct pell_gpu *gpu;     /* borrowed */
    struct pell_gpu_commands *commands;
    struct pell_gpu_buffer *buffers[ALL_BUFFERS]; /* from LIGHT on borrowed */
    uint64_t sizes[BUFFERS];                      /* bytes; 0: not there */
    struct pell_gpu_pass *passes[PASSES];
    uint64_t bound[PASSES][PELL_GPU_BINDINGS]; /* numbers of the buffers that they were made with */
    int width, height;
    size_t room;      /* points of a batch */
    uint32_t version; /* of the data of solids, as uploaded, */
    bool sent;        /* if it was */
};

/* --- buffers.c --------------------------------------------------------------------------------------------------------------------- */

/* Creates the buffers that the sample needs, large enough for it. */
PELL_NODISCARD enum pell_result picture_prepare(struct pell_picture_device *d, const struct pell_picture_sample *s);
/* Bytes of the largest buffer that a sample needs. */
uint64_t picture_largest(const struct pell_picture_sample *s);

/* --- content.c: data that a sample uploads -------------------------------------------------------------------------------------------- */

/* Writes materials, keys and the frame. */
void picture_fill(const struct pell_picture_device *d, const struct pell_picture_sample *s);
/* Whether some material has maps, or some mesh colours. */
bool picture_is_mapped(const struct pell_scene *scene);
/* Flags of the frame. */
uint32_t picture_flags(const struct pell_picture_sample *s);
/* Available data of solids: PELL_KNOWN_... */
uint32_t picture_known(const struct pell_picture_sample *s);

/* --- blurs.c: straight transmission --------------------------------------------------------------------------------------------------- */

/* Records the blurs that the rows require; `translucent`: bounds of such pixels. */
void picture_spread(struct pell_picture_device *d, const struct pell_picture_sample *s, struct pell_rect translucent);

/* How many tiles hold so many pixels. */
static inline uint32_t picture_tiles(int pixels)
{
    return (uint32_t) ((pixels + PELL_PICTURE_TILE - 1) / PELL_PICTURE_TILE);
}

#endif
