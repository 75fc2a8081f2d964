/* SPDX-License-Identifier: MIT
 *
 * check_layers.h - the part of `pellucid check` that cuts through the layers below a surface.
 */
#ifndef PELL_CHECK_LAYERS_H
#define PELL_CHECK_LAYERS_H

#include "cli/cli.h"

/* Whether --cross-section and what belongs to it can be meant, before anything is read. */
enum exit_code check_layers_options(struct cli *cli);

/* Draws the cross-section that --cross-section asks for. *answer: what was drawn, for JSON and for the text; the caller drops it, also
 * after a failure, where it may be NULL. */
enum exit_code check_layers(struct cli *cli, const struct pell_scene *scene, json_t **answer);

#endif
