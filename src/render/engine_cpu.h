/* SPDX-License-Identifier: MIT
 *
 * engine_cpu.h - functions of the cpu engine for benches, beyond rendering a frame.
 */
#ifndef PELL_ENGINE_CPU_H
#define PELL_ENGINE_CPU_H

#include "render/engine.h"

/* See pell_surface_trace_bare: the rays of a frame from `view`, of a size that was made. */
double pell_engine_cpu_trace_bare(void *engine, const struct pell_view *view);
/* See pell_rays_record. Does nothing without a scene. */
void pell_engine_cpu_record_rays(void *engine, struct pell_ray_record *record);

#endif
