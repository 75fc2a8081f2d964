/* SPDX-License-Identifier: MIT
 *
 * renderer_state.h - what a renderer holds from frame to frame: for renderer.c (which is of scene and method), prepare.c (which is of size
 * and settings) and frame.c alone.
 */
#ifndef PELL_RENDERER_STATE_H
#define PELL_RENDERER_STATE_H

#include "render/composite/stage.h"
#include "render/bandwidth.h"
#include "render/post/dof.h"
#include "render/post/stage.h"
#include "render/renderer.h"

#define MAX_STAGES 48
#define MAX_CHANNELS 32

struct pell_renderer {
    struct pell_context *ctx; /* borrowed */
    struct pell_pool *pool;
    const struct pell_scene *scene; /* borrowed */
    const struct pell_method *method;
    void *knobs; /* owned copy */

    /* Of the scene. */
    struct pell_rays *rays;
    struct pell_mips *mips;
    struct pell_specular_tables *tables;
    struct pell_compositor *compositor;
    uint16_t *frame_index;                       /* per scene material + 1: the frame's material + 1, or 0 */
    struct pell_frame_material *frame_materials;
    size_t num_frame_materials;
    struct pell_profile **profiles;              /* per frame material: what was made for it, of three channels, or NULL */
    bool profiled;                               /* they are there, for settings.profile */
    float (*total)[3];                           /* per scene material: total reflectance of its profile */
    const struct pell_thickness_table **thickness; /* per scene material */

    /* Of scene and settings. */
    struct pell_settings settings; /* that the rest was made for */
    struct pell_lights *lights;
    uint64_t lights_number; /* see pell_renderer_lights */
    struct pell_pass *pass;
    float focal_px; /* that the pass was made for */
    bool orthographic;

    /* Of the size and the layers asked for. */
    bool sized;
    struct pell_raster *raster; /* of the scene, too; NULL: `rastered`, but there is none, or nobody asked yet */
    bool rastered;
    struct pell_surface surface;
    struct pell_rect covered; /* of the frame: what any of its samples may cover */
    struct pell_lighting lighting;
    struct pell_accumulator sum;
    struct pell_rect translucent; /* of all samples of the frame */
    bool noisy;                   /* the frame's method knows its standard error */
    float *lit[3], *light[3], *display[3];
    const float *noise[3]; /* the pass's own, of the last sample */
    float *single[3], *reflected[3]; /* there once a method gave them apart */
    int sample;                      /* of the frame, that is being made */
    bool scattered;                  /* the method gave light of a sample of the frame */
    struct pell_view eye;            /* of that sample */
    struct pell_lens lens;           /* of the frame */
    float *glow[PELL_BLOOM_PLANES];  /* there once bloom was asked for */
    float *open[PELL_DOF_PLANES], *open_tiles; /* there once depth of field was asked for */
    struct pell_checkpoint checkpoint; /* owned path; NULL: none */
    float *position[3], *hit[4]; /* there once a method asked for them; mesh, triangle and barycentric */
    uint16_t *material; /* the frame's plane */
    double *rows; /* 4 a row for post, then 2 a row for the meter */

    struct pell_copies copies;
    struct pell_stage_time stages[MAX_STAGES];
    size_t num_stages;
    struct pell_channel channels[MAX_CHANNELS];
};

/* Of a frame's light, all that does not hang on the sample. */
struct pell_irradiance_params pell_renderer_light_params(const struct pell_renderer *r, float mix);
/* Everything that a frame of these settings needs and that is not there yet. */
PELL_NODISCARD enum pell_result pell_renderer_prepare(struct pell_renderer *r, const struct pell_settings *s, const struct pell_view *view);
void pell_renderer_drop_size(struct pell_renderer *r);
/* The frame's shape for the method: what does not change from sample to sample. */
struct pell_frame pell_renderer_frame(const struct pell_renderer *r, const struct pell_view *view);

#endif
