/* SPDX-License-Identifier: MIT
 *
 * message.h - requests of a page to the viewer. They are untrusted: everything is checked here, except what the scene reader and the tables
 * of knobs check anyway.
 *
 *     {"type": "view", "id": 7, "moving": true, "state": STATE}   render this; a newer one replaces it
 *     {"type": "ack", "serial": 12}                               the image of that number is displayed
 *     {"type": "save", "id": 8, "format": "scene" | "exr" | "report"}   the last view as a file
 *     {"type": "pick", "id": 9, "x": 0.5, "y": 0.5}               query the visible point, in fractions of the image size
 *     {"type": "profile", "id": 10, "medium": {"sigma_a": ...}}   R(r) of coefficients, with a fit of so many "gaussians"; with
 *                                                                 "export": "glsl" the code of it as a file
 *     {"type": "profile", "id": 11, "material": {"skin": ...}}    R(r) and the layers of a composition of skin
 *
 * STATE has any of "method", "knobs", "settings", "camera", "lights", "materials", "time", "other" (method, knobs: what A is compared with)
 * and "truth" (a reference). Knobs and settings are objects of texts; camera, lights and materials are as in a scene file.
 */
#ifndef PELL_VIEWER_MESSAGE_H
#define PELL_VIEWER_MESSAGE_H

#include "base/base.h"
#include "scene/file/json.h"

#include <pellucid/gaussians.h>
#include <pellucid/method.h>

#define VIEWER_MESSAGE_BYTES (256u << 10)
#define VIEWER_SETTINGS_MOST 64

enum viewer_message_type { VIEWER_VIEW, VIEWER_ACK, VIEWER_SAVE, VIEWER_PICK, VIEWER_PROFILE };

enum viewer_format { VIEWER_SCENE, VIEWER_EXR, VIEWER_REPORT };
extern const char *const viewer_format_names[];

/* A method and its knobs as a page names them; texts belong to the message. "none" is no method. */
struct viewer_setup {
    const char *method;
    struct pell_setting knobs[VIEWER_SETTINGS_MOST];
    size_t num_knobs;
};

struct viewer_message {
    struct pell_json_file file; /* holds the tree */
    enum viewer_message_type type;
    int64_t id; /* for an ack: the image's number */

    bool moving;
    struct viewer_setup setup, other; /* other.method NULL: none */
    struct pell_setting settings[VIEWER_SETTINGS_MOST];
    size_t num_settings;
    json_t *camera, *lights, *materials; /* borrowed from the tree; NULL: unchanged */
    bool timed;
    double time;       /* seconds */
    const char *truth; /* NULL: no reference requested */

    enum viewer_format format; /* for a save */
    double x, y;               /* for a pick, [0, 1] */
    json_t *medium;            /* for a profile: coefficients as in a scene file; borrowed from the tree. NULL: */
    json_t *material;          /* "skin" as in a scene file; borrowed, too */
    int gaussians;             /* [1, PELL_GAUSSIANS_MAX] */
    const char *export;        /* language of the exported code; NULL: numbers */
};

/* PELL_ERR_FORMAT or PELL_ERR_INVALID, logged; *out is NULL on failure. */
PELL_NODISCARD enum pell_result viewer_message_parse(struct pell_context *ctx, const void *data, size_t size, struct viewer_message **out);
/* Sets *message to NULL; destroying &(NULL) does nothing. */
void viewer_message_destroy(struct viewer_message **message);

#endif
