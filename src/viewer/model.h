/* SPDX-License-Identifier: MIT
 *
 * model.h - the loaded scene, and its renderers. A slot is a renderer with its own method: the slot for moving images keeps its prepared
 * data while another slot renders the static image.
 *
 * Threads    everything belongs to the render thread.
 */
#ifndef PELL_VIEWER_MODEL_H
#define PELL_VIEWER_MODEL_H

#include "viewer/document.h"

enum viewer_slot { VIEWER_LIVE_A, VIEWER_LIVE_B, VIEWER_STILL_A, VIEWER_STILL_B, VIEWER_TRUTH, VIEWER_SLOTS };

struct viewer_model {
    struct pell_context *ctx;
    struct pell_device *device;
    struct viewer_document document;
    struct pell_scene *scene;
    bool stale; /* the files have changed */
    struct viewer_view_key {
        char *structure, *camera, *lights;
    } view_key;          /* the scene's structure, camera and lights as texts allocated by malloc; "null": unchanged */
    char *loaded_camera; /* the camera at loading */
    uint64_t loads;      /* number of times a scene was loaded */
    struct {
        struct pell_renderer *renderer;
        uint64_t loads; /* value of model.loads for the renderer's scene */
        const struct pell_method *method;
        void *knobs;
        char *setup; /* method and knobs as text */
    } slots[VIEWER_SLOTS];
    float exposure, white; /* metered values, with `metered` the key they are valid for; 0: not yet */
    char *metered;
};

/* Takes ownership of the document; the scene is loaded by viewer_model_apply. */
PELL_NODISCARD enum pell_result viewer_model_open(struct pell_context *ctx, struct pell_device *device, struct viewer_document *document,
                                                  struct viewer_model *out);
void viewer_model_close(struct viewer_model *m);

/* Updates the scene to the page's state. `exact`: also those parts that depend on the camera's position besides the view. On failure the
 * last scene is kept. */
PELL_NODISCARD enum pell_result viewer_model_apply(struct viewer_model *m, const struct viewer_message *view, bool exact);

/* Reductions of the page's settings for fast images. */
struct viewer_quality {
    double scale; /* factor of width and height, (0, 1] */
    bool quick;   /* one multisample, few rays */
    int64_t seed_offset;
    bool layers;
};

/* Renders a setup of the page. `image` is valid until the slot's next image. */
PELL_NODISCARD enum pell_result viewer_model_render(struct viewer_model *m, enum viewer_slot slot, const struct viewer_message *view,
                                                    const struct viewer_setup *setup, const struct viewer_quality *quality,
                                                    struct pell_settings *settings, struct pell_render_result *image);
/* The method of a slot's last image; NULL: none. */
const struct pell_method *viewer_model_method(const struct viewer_model *m, enum viewer_slot slot);

/* The surface visible at a position in the image, as JSON; NULL if out of memory. After viewer_model_apply and an image of the slot
 * LIVE_A. */
json_t *viewer_model_pick(const struct viewer_model *m, const struct viewer_message *pick);

/* The document with method, knobs and settings, which `pellucid render` renders identically to the slot's last image; NULL if out of
 * memory. */
json_t *viewer_model_saved(const struct viewer_model *m, const struct viewer_message *view);
/* Facts about the scene for a page; NULL if out of memory. */
json_t *viewer_model_facts(const struct viewer_model *m);

#endif
