/* SPDX-License-Identifier: MIT
 *
 * renderer_state.h - state that a renderer keeps from frame to frame: only for renderer.c (sets inputs), resources.c (creates what depends
 * on them) and frame.c.
 */
#ifndef PELL_RENDERER_STATE_H
#define PELL_RENDERER_STATE_H

#include "render/bandwidth.h"
#include "render/engine.h"
#include "render/layers.h"
#include "render/renderer.h"

/* Inputs of a frame. */
enum pell_input {
    PELL_INPUT_SCENE = 1 << 0,
    PELL_INPUT_METHOD = 1 << 1, /* and its knobs */
    PELL_INPUT_CHECKPOINT = 1 << 2,
    PELL_INPUT_SIZE = 1 << 3,   /* and whether there are layers */
    PELL_INPUT_CAMERA = 1 << 4, /* its projection; the position is set per frame */
    PELL_INPUT_LIGHTS = 1 << 5, /* settings for light sampling */
    PELL_INPUT_PROFILE = 1 << 6,
    PELL_INPUT_BOUNCES = 1 << 7, /* indirect light, and inputs of its links */
};

struct pell_renderer {
    struct pell_context *ctx;   /* borrowed */
    struct pell_device *device; /* borrowed */
    void *engine;               /* instance of the device's */

    /* Inputs. */
    const struct pell_scene *scene;    /* borrowed */
    const struct pell_method *method;  /* borrowed; NULL: none */
    void *knobs;                       /* owned copy */
    struct pell_checkpoint checkpoint; /* owned copy */
    bool has_checkpoint;
    struct pell_communicator *communicator; /* borrowed; NULL: alone */
    struct pell_observer observer;          /* show NULL: none */
    struct pell_settings settings;
    float focal_px;
    bool orthographic;

    /* Resources made from the inputs: see resources.c. */
    unsigned made; /* bit i: resource i */
    struct pell_scene_materials materials;
    struct pell_profile **profiles; /* per frame material: allocation, or NULL: three channels for all light, then for multiply scattered
                                     * light if there is `multiple` */
    struct pell_profiles_of {
        const struct pell_profile *all, *multiple; /* NULL: same as all */
    } * profiles_of;                               /* per frame material */
    struct pell_services services;
    uint64_t lights_revision; /* counts how often lights were made */
    struct pell_pass *pass;   /* NULL: no method, or nothing translucent */
    struct pell_kept kept;    /* by the method, from earlier passes */

    /* Current frame. */
    struct pell_lens lens;
    struct pell_rect translucent; /* of all samples */
    bool noisy;                   /* the method knows its standard error */
    bool scattered;               /* the method returned light for a sample */
    struct pell_stage_notes notes;
    struct pell_channel channels[PELL_LAYER_CHANNELS];
    struct pell_bandwidth bandwidth;
};

/* Drops all resources that depend on one of these inputs. */
void pell_renderer_invalidate(struct pell_renderer *r, unsigned inputs);
/* Creates resources that depend on the scene alone. On failure none of them exist. */
PELL_NODISCARD enum pell_result pell_renderer_prepare_scene(struct pell_renderer *r);
/* Applies settings, and creates all resources that a frame with them needs. */
PELL_NODISCARD enum pell_result pell_renderer_prepare(struct pell_renderer *r, const struct pell_settings *s, const struct pell_view *view);
/* Warns about inputs of the scene's translucent materials that the method ignores. Requires a scene and a method. */
void pell_renderer_warn_ignored(const struct pell_renderer *r);
/* Returns the shape of the method's frames: parameters that are constant over samples. Requires a method. */
struct pell_frame_shape pell_renderer_shape(const struct pell_renderer *r, const struct pell_view *view);

#endif
