/* SPDX-License-Identifier: MIT
 *
 * document.h - the displayed scene, as a scene file: the input with the changes of a page. A saved scene is this document, and the rendered
 * scene is read from it, so that both are identical.
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
    json_t *base;                   /* contents of the input */
    struct pell_load_params params; /* parameters that a scene file can't hold; texts are the caller's */
    char *granted;                  /* environment of the command line if it is outside the input's folder, or NULL */
    json_t *camera, *lights;        /* from the input, positions in mm */
    bool studio;                    /* the lights are the default ones, which depend on the camera unless the document lists lights */
};

/* `path` is a scene file or a mesh; `params` and `size`, `unit` (texts with units, or NULL) override it. */
PELL_NODISCARD enum pell_result viewer_document_open(struct pell_context *ctx, const char *path, const struct pell_load_params *params,
                                                     const char *size, const char *unit, struct viewer_document *out);
void viewer_document_close(struct viewer_document *d);
/* Whether a saved scene holds what an option of the command line ("size") says; the others must be given again with it. */
bool viewer_document_holds(const struct viewer_document *d, const char *option);

/* Records the camera and the lights of the scene loaded from the input alone. */
PELL_NODISCARD enum pell_result viewer_document_note(struct viewer_document *d, const struct pell_scene *scene);
/* The document with a page's changes; NULL if out of memory. */
json_t *viewer_document_merge(const struct viewer_document *d, const struct viewer_message *view);
PELL_NODISCARD enum pell_result viewer_document_load(const struct viewer_document *d, const struct viewer_message *view, json_t *document,
                                                     struct pell_scene **out);
/* Everything but camera and lights as a text; NULL if out of memory. The caller frees it by free(). */
char *viewer_document_structure(const struct viewer_document *d, const struct viewer_message *view, json_t *document);

#endif
