/* SPDX-License-Identifier: MIT
 *
 * renderer_state.h - what a renderer holds from frame to frame: for renderer.c (which sets inputs), resources.c (which makes what depends
 * on them) and frame.c alone.
 */
#ifndef PELL_RENDERER_STATE_H
#define PELL_RENDERER_STATE_H

#include "render/bandwidth.h"
#include "render/engine.h"
#include "render/layers.h"
#include "render/renderer.h"

/* What a frame is made of. */
enum pell_input {
    PELL_INPUT_SCENE = 1 << 0,
    PELL_INPUT_METHOD = 1 << 1, /* and its knobs */
    PELL_INPUT_CHECKPOINT = 1 << 2,
    PELL_INPUT_SIZE = 1 << 3,   /* and whether there are layers */
    PELL_INPUT_CAMERA = 1 << 4, /* its projection: where it stands is each frame's own affair */
    PELL_INPUT_LIGHTS = 1 << 5, /* the settings that say how they are sampled */
    PELL_INPUT_PROFILE = 1 << 6,
    PELL_INPUT_BOUNCES = 1 << 7, /* of indirect light, and what its links depend on */
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
    struct pell_share *share;      /* borrowed; NULL: alone */
    struct pell_observer observer; /* show NULL: none */
    struct pell_settings settings;
    float focal_px;
    bool orthographic;

    /* What was made of them: see resources.c. */
    unsigned made; /* bit i: resource i */
    struct pell_scene_materials materials;
    struct pell_profile **profiles; /* per frame material: what was made for it, or NULL: three channels of all light, then of light that
                                     * was scattered more than once, where there is `multiple` */
    struct pell_profiles_of {
        const struct pell_profile *all, *multiple; /* NULL: as all */
    } * profiles_of;                               /* per frame material */
    struct pell_services services;
    uint64_t lights_revision; /* counts the lights that were made */
    struct pell_pass *pass;   /* NULL: no method, or nothing translucent */
    struct pell_kept kept;    /* by the method, of passes before */

    /* Of the frame. */
    struct pell_lens lens;
    struct pell_rect translucent; /* of all samples */
    bool noisy;                   /* the method knows its standard error */
    bool scattered;               /* the method gave light of a sample */
    struct pell_stage_notes notes;
    struct pell_channel channels[PELL_LAYER_CHANNELS];
    struct pell_bandwidth bandwidth;
};

/* Drops everything that depends on one of these inputs. */
void pell_renderer_invalidate(struct pell_renderer *r, unsigned inputs);
/* Makes what depends on the scene alone. On failure nothing of it is there. */
PELL_NODISCARD enum pell_result pell_renderer_prepare_scene(struct pell_renderer *r);
/* Takes these settings, and makes everything that a frame of them needs and that is not there yet. */
PELL_NODISCARD enum pell_result pell_renderer_prepare(struct pell_renderer *r, const struct pell_settings *s, const struct pell_view *view);
/* Names the inputs of the scene's translucent materials that the method ignores. There are a scene and a method. */
void pell_renderer_warn_ignored(const struct pell_renderer *r);
/* The shape of the method's frames: what does not change from sample to sample. There is a method. */
struct pell_frame_shape pell_renderer_shape(const struct pell_renderer *r, const struct pell_view *view);

#endif
