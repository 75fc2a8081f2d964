/* SPDX-License-Identifier: MIT
 *
 * engine_cpu_state.h - state shared by the files of the CPU engine. Private to them.
 */
#ifndef PELL_ENGINE_CPU_STATE_H
#define PELL_ENGINE_CPU_STATE_H

#include "render/composite/stage.h"
#include "render/contact/stage.h"
#include "render/curvature/stage.h"
#include "render/engine_cpu.h"
#include "render/indirect/stage.h"
#include "render/irradiance/device.h"
#include "render/layers.h"
#include "render/picture/device.h"
#include "render/plane_buffers.h"
#include "render/post/device.h"
#include "render/post/dof.h"
#include "render/post/stage.h"
#include "render/unscattered/stage.h"

enum { PELL_CPU_BLOCKS = 16 }; /* most separate allocations of planes */

struct pell_cpu {
    struct pell_context *ctx; /* borrowed */
    struct pell_pool *pool;   /* borrowed */

    /* Of the scene. */
    const struct pell_scene *scene; /* borrowed */
    struct pell_rays *rays;
    struct pell_mips *mips;
    struct pell_specular_tables *tables;
    struct pell_compositor *compositor;

    struct pell_lights *lights;
    struct pell_light_device *light_device;       /* owned by the engine vulkan; NULL: the CPU computes direct light */
    const struct pell_scene_materials *materials; /* borrowed: the renderer's own */
    const struct pell_settings *settings;         /* for the lights; borrowed: owned by the renderer */

    struct pell_contact *contact;     /* NULL: no contact shadow */
    struct pell_curvature *curvature; /* NULL: off, or nothing is curved */

    struct pell_indirect *indirect;       /* NULL: no surface lights another, or no bounces are requested */
    struct pell_indirect *solids;         /* samples of solids, created on first use */
    struct pell_indirect *solid_light;    /* the same, with light transport through solids; NULL: none */
    bool whole_solid;                     /* `solid_light` is for a method that integrates over the whole solid */
    bool between_faces;                   /* `solid_light` includes transport between faces */
    struct pell_unscattered *unscattered; /* NULL: off, or nothing is thin enough */
    bool indirect_solved;                 /* the indirect light is up to date with the lights */

    struct pell_raster *raster; /* NULL: camera visibility is ray traced */
    bool raster_tried;          /* the raster was built, or found to be impossible */

    /* Of the size. */
    bool has_planes;
    float *blocks[PELL_CPU_BLOCKS]; /* own the planes below */
    int num_blocks;
    struct pell_surface surface;
    struct pell_lighting lighting;
    uint8_t *spread_lit, *has_hidden; /* scratch of the stages "spread" and "highlights": flags of blocks of pixels */
    struct pell_accumulator sum;
    float *display[3]; /* scratch of stages until the end of the frame: "highlights", "spread", then the result of "unscattered" */
    float *plane[PELL_PLANES][3];            /* of the frame, by enum pell_plane: 4 bytes per pixel; NULL where a stage has the plane */
    float *bloom_scratch[PELL_BLOOM_PLANES]; /* created once bloom is requested */
    float *pinhole[PELL_DOF_PLANES];         /* created once depth of field is requested */
    float *pinhole_tiles;
    float widest_disc;                    /* of the frame's samples, px */
    struct pell_post_device *post_device; /* owned by the engine vulkan; NULL: done on the CPU */
    bool lens_pending;                    /* the sum of depth of field is still on the device, */
    float lens_scale;                     /* with this pending factor */
    struct pell_picture_device *picture;  /* owned by the engine vulkan */
    bool pictured;                        /* the sum of the samples is still on the device */
    uint32_t solids_version;              /* counts changes of curvature, indirect light and light inside solids */
    double *rows;                         /* 4 per row for post, then 2 per row for the meter */

    struct pell_composite_params composite; /* of the current sample */
    struct pell_post_result post;
};

/* --- engine_cpu.c: parameters of a sample ------------------------------------------------------------------------------------------- */

struct pell_irradiance_params pell_cpu_sample_light(const struct pell_cpu *e, const struct pell_engine_sample *sample);
/* Without the method's result. `light`: of the same sample. */
struct pell_composite_params pell_cpu_sample_composite(const struct pell_cpu *e, const struct pell_engine_sample *sample,
                                                       const struct pell_irradiance_params *light);
/* Whether straight transmission through thin parts is spread sideways. */
bool pell_cpu_spreads(const struct pell_engine_frame *frame);

/* --- engine_cpu_lend.c: services for methods ------------------------------------------------------------------------------------------ */

/* Parameters of a frame's light that do not depend on the sample. `separate_single`: single scattering is added separately, except where
 * indirect light is still to be computed, which uses all light that surfaces reflect. */
struct pell_irradiance_params pell_cpu_light(const struct pell_cpu *e, float mix, bool separate_single);
/* The same for points. */
struct pell_irradiance_params pell_cpu_points_light(const struct pell_cpu *e, const struct pell_points_params *params);
/* pell_services.light_points */
int64_t pell_cpu_light_points(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n,
                              const struct pell_surface_light *out);
/* pell_engine_interface.lend */
void pell_cpu_lend(void *engine, struct pell_services *services);

/* --- engine_cpu_around.c: stages before and after the method ----------------------------------------------------------------------- */

/* Whether unscattered light shows what is behind thin parts: the method's result does not. */
bool pell_cpu_sees_through(const struct pell_cpu *e, const struct pell_engine_frame *frame);
/* After the irradiance, with lighting.hidden. */
void pell_cpu_share_highlights(struct pell_cpu *e, const struct pell_engine_sample *sample);
/* Unscattered light, for the composite. */
void pell_cpu_see_through(struct pell_cpu *e, const struct pell_engine_sample *sample);
/* Spreads straight transmission, before the method. `key`: the frame's plane `material`. */
void pell_cpu_spread(struct pell_cpu *e, const struct pell_engine_sample *sample, const uint16_t *key);

/* --- engine_cpu_end.c: stages after the composite ------------------------------------------------------------------------------------- */

/* The composite of one sample, blurred by its part of the lens. */
enum pell_result pell_cpu_composite_through_lens(struct pell_cpu *e, const struct pell_engine_sample *sample);
/* pell_engine_interface.average and .post */
void pell_cpu_average(void *engine, int done, int planned);
enum pell_result pell_cpu_post(void *engine, const struct pell_engine_frame *f, const struct pell_view *view);

#endif
