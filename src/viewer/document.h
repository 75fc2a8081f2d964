/* SPDX-License-Identifier: MIT
 *
 * document.h - the scene that is shown, as a scene file: what the input says, and what a page says instead. A scene that is saved is this
 * document, and what is drawn is read from it, so that both are the same bits.
 *
 * Errors     logged with the input's name and a JSON pointer.
 */
#ifndef PELL_VIEWER_DOCUMENT_H
#define PELL_VIEWER_DOCUMENT_H

#include "viewer/message.h"

#include <pellucid/render.h>

struct viewer_document {
    struct pell_context *ctx;
    char *path;                     /* for messages; its folder is where other files are looked up */
    json_t *base;                   /* what the input says */
    struct pell_load_params params; /* what a scene file can't say; texts are the caller's */
    char *granted;                  /* the environment of the command line where it lies outside the input's folder, or NULL */
    json_t *camera, *lights;        /* of the input, positions in mm */
    bool studio;                    /* the lights are the default ones, which depend on the camera where the document has none */
};

/* `path` is a scene file or a mesh; `params` and `size`, `unit` (texts with units, or NULL) are what stands above it. */
PELL_NODISCARD enum pell_result viewer_document_open(struct pell_context *ctx, const char *path, const struct pell_load_params *params,
                                                     const char *size, const char *unit, struct viewer_document *out);
void viewer_document_close(struct viewer_document *d);

/* Notes the camera and the lights of the scene that was loaded from the input alone. */
PELL_NODISCARD enum pell_result viewer_document_note(struct viewer_document *d, const struct pell_scene *scene);
/* The document with what a page says; NULL without memory. */
json_t *viewer_document_merge(const struct viewer_document *d, const struct viewer_message *view);
PELL_NODISCARD enum pell_result viewer_document_load(const struct viewer_document *d, const struct viewer_message *view, json_t *document,
                                                     struct pell_scene **out);
/* All but camera and lights as a text; NULL without memory. The caller's, by free(). */
char *viewer_document_structure(const struct viewer_document *d, const struct viewer_message *view, json_t *document);

#endif
