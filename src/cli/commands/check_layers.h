/* SPDX-License-Identifier: MIT
 *
 * check_layers.h - the part of `pellucid check` that plots a cross-section of the layers below a surface.
 */
#ifndef PELL_CHECK_LAYERS_H
#define PELL_CHECK_LAYERS_H

#include "cli/cli.h"

/* Checks --cross-section and its related options before anything is read. */
enum exit_code check_layers_options(struct cli *cli);

/* Draws the plot of --cross-section. *answer: a description of it, for JSON and for the text; the caller drops it, also after a failure,
 * where it may be NULL. */
enum exit_code check_layers(struct cli *cli, const struct pell_scene *scene, json_t **answer);

#endif
