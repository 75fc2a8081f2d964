/* SPDX-License-Identifier: MIT
 *
 * model.h - the scene that is loaded, and renderers over it. A slot is a renderer with a method of its own: the one for moving pictures
 * keeps what it has prepared while another makes the still one.
 *
 * Threads    everything belongs to the thread that renders.
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
    struct viewer_sight {
        char *structure, *camera, *lights;
    } sight;             /* what the scene is made of, its camera and its lights as texts of malloc; "null": as in the file */
    char *loaded_camera; /* that it was loaded with */
    uint64_t loads;      /* how often a scene was loaded */
    struct {
        struct pell_renderer *renderer;
        uint64_t loads; /* of the scene that it has */
        const struct pell_method *method;
        void *knobs;
        char *look; /* method and knobs as text */
    } slots[VIEWER_SLOTS];
    float exposure, white; /* metered, with `metered` the text of what it was metered on; 0: not yet */
    char *metered;
};

/* Takes the document; the scene is loaded by viewer_model_apply. */
PELL_NODISCARD enum pell_result viewer_model_open(struct pell_context *ctx, struct pell_device *device, struct viewer_document *document,
                                                  struct viewer_model *out);
void viewer_model_close(struct viewer_model *m);

/* Makes the scene what the page says. `exact`: also what the camera's place changes besides the view. On failure the last scene stays. */
PELL_NODISCARD enum pell_result viewer_model_apply(struct viewer_model *m, const struct viewer_message *view, bool exact);

/* What differs from the settings of the page in a picture that must come soon. */
struct viewer_haste {
    double scale; /* of width and height, (0, 1] */
    bool quick;   /* one multisample, few rays */
    int64_t seed_offset;
    bool layers;
};

/* Renders a look of the page. `image` is valid until the slot's next picture. */
PELL_NODISCARD enum pell_result viewer_model_render(struct viewer_model *m, enum viewer_slot slot, const struct viewer_message *view,
                                                    const struct viewer_look *look, const struct viewer_haste *haste,
                                                    struct pell_settings *settings, struct pell_render_result *image);
/* The method of a slot's last picture; NULL: none. */
const struct pell_method *viewer_model_method(const struct viewer_model *m, enum viewer_slot slot);

/* What is seen at a place of the picture, as JSON; NULL without memory. After viewer_model_apply and a picture of the slot LIVE_A. */
json_t *viewer_model_pick(const struct viewer_model *m, const struct viewer_message *pick);

/* The document with method, knobs and settings, which `pellucid render` draws as the slot's last picture; NULL without memory. */
json_t *viewer_model_saved(const struct viewer_model *m, const struct viewer_message *view);
/* What a page needs to know of the scene; NULL without memory. */
json_t *viewer_model_facts(const struct viewer_model *m);

#endif
