/* SPDX-License-Identifier: MIT
 * renderer.h - functions of a renderer for benches and tests, in addition to render.h. */
#ifndef PELL_RENDERER_H
#define PELL_RENDERER_H

#include "render/services.h"

#define PELL_MSAA_MOST 64 /* multisamples of an image */

/* The services that its method gets; valid while the scene is set. */
const struct pell_services *pell_renderer_services(const struct pell_renderer *r);
/* The running method's pass; NULL before the first frame. */
const struct pell_pass *pell_renderer_pass(const struct pell_renderer *r);

/* From the next frame on: whether to measure after each frame how fast this machine copies, for pell_stage_time.bandwidth_ms. Takes
 * milliseconds. */
void pell_renderer_measure_bandwidth(struct pell_renderer *r, bool wanted);

/* CPU engine only. Traces the last frame's camera rays again and ignores the hits (see pell_surface_trace_bare); 0 before the first
 * frame. */
double pell_renderer_trace_bare(struct pell_renderer *r);
/* CPU engine only. See pell_rays_record: for the renderer's scene. */
void pell_renderer_record_rays(struct pell_renderer *r, struct pell_ray_record *record);

#endif
