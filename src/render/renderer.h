/* SPDX-License-Identifier: MIT
 *
 * renderer.h - what a method may ask of the renderer that runs it.
 */
#ifndef PELL_RENDERER_H
#define PELL_RENDERER_H

#include "base/pool.h"

#include <pellucid/render.h>

struct pell_context *pell_renderer_context(struct pell_renderer *r);
struct pell_pool *pell_renderer_pool(struct pell_renderer *r);
const struct pell_scene *pell_renderer_scene(const struct pell_renderer *r); /* NULL: none */
bool pell_renderer_scatters(const struct pell_renderer *r);                 /* a method is set */

/* Traces the last frame's rays from the eye once more and does nothing with them (see pell_surface_trace_bare); 0 before the first
 * frame. */
double pell_renderer_trace_bare(struct pell_renderer *r);

#endif
