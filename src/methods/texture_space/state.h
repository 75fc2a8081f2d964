/* SPDX-License-Identifier: MIT
 *
 * state.h - declarations shared by the parts of the method; private to this folder. cpu.c calls layouts.c, light_map.c, chain.c and
 * read_map.c; chain.c and cpu.c call the engine's runner: run_cpu.c or vulkan.c.
 */
#ifndef METHODS_TEXTURE_SPACE_STATE_H
#define METHODS_TEXTURE_SPACE_STATE_H

#include "methods/texture_space/texture_space.h"

#include "base/pool.h"

#include <stdatomic.h>

enum { TS_ROWS = 16, TS_TIMES = TS_LEVELS + 9, TS_READ_FAR = 6 };
/* TS_ROWS: rows per task. TS_READ_FAR: largest distance in texels from the inside of charts that pixels read: that of look_around, and the
 * four texels of a bilinear lookup. */

enum ts_made { TS_MADE_NOT, TS_MADE_PARTIAL, TS_MADE_COMPLETE };

struct ts_solid {
    struct ts_atlas *atlas;
    const struct ts_profile *profile; /* of its material */
    float *map;                       /* R, G, B of M and the chart, per texel; begins at texel (0, 0) */
    int side, first_side;             /* texels; of the first frame's map, 0: not yet */
    enum ts_made made;                /* for the current lights */
    uint64_t version;                 /* changes with each map that is made; 0: none yet */
    _Atomic uint8_t *seen;            /* per texel, while the map is made in part: need.c */
    _Atomic bool missing;             /* pixels read texels that were not made */
    bool make_partial;                /* will be made in part */
    struct pell_vec3 middle;          /* centre of its bounds */
    float radius;                     /* half the diagonal of its bounds, mm */
};

struct ts_runner;
struct ts_pixels;

/* Stages of a chain that texels are needed up to: before blur i, after its first pass and after its second. */
#define TS_NEED_BEFORE(i) (1 + 2 * (i))
#define TS_NEED_ALONG(i) (2 + 2 * (i))
#define TS_NEED_DOWN(i) (3 + 2 * (i))

/* The needed texels of the current solid. Planes at texel (0, 0). */
struct ts_need {
    bool on;
    uint8_t *stage; /* last stage that needs the texel; 0: none */
    uint8_t *cell;  /* maximum over each block of a row */
    uint8_t *wide;  /* scratch: reach of taps down columns, and the chart that they stay in */
    float *wide_key;
    uint8_t *shown;       /* texels that pixels read */
    uint8_t *transmitted; /* texels whose transmitted light is needed */
};

struct ts_state {
    const struct ts_runner *run;          /* the engine's */
    void *device;                         /* data of the engine's device; NULL: none, or not yet allocated */
    struct ts_pixels *pixels;             /* of the engine vulkan: read_gpu.h */
    const struct pell_services *services; /* borrowed */
    const struct pell_frame *in;          /* current frame */
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct ts_kernels *kernels;
    struct ts_knobs knobs;
    struct pell_solids *solids;
    struct ts_solid *solid;
    size_t num_solids;
    uint64_t versions; /* number of maps made so far */
    bool complete;     /* created without a failure */
    bool reused;       /* maps have been read from more than one view, so culling would make them twice */
    struct ts_need need;
    struct ts_profile *profiles; /* by material; only those of solids are made */
    size_t num_profiles;
    struct ts_tsm tsm;
    bool joins;              /* a chain with transmission can blur other light, too */
    float *memory;           /* of the planes below, for texel (0, 0) of any atlas */
    float *light[TS_PLANES]; /* irradiance, alpha, and irradiance of light that is only blurred */
    float *now[TS_PLANES], *half[TS_PLANES], *sum[3];
    float *transmitted[3]; /* transmitted light, before softening */
    float *strength;
    float *scaled[2]; /* lengths over strength */
    struct ts_cell *cells;
    uint64_t made_of;      /* hash of materials, knobs and size: a kept state is reused only if it matches */
    double layout_seconds; /* seconds spent on layouts; 0: already reported */
    uint64_t lit;          /* version of the lights; 0: none yet */
    size_t warned;         /* number of lights when they were last counted */
    struct ts_work work;
    float least[2], skew; /* lengths of the solid's shortest texels; largest skew of a block */
    struct pell_pass_time times[TS_TIMES];
    size_t num_times;
    double clock;
    struct {
        size_t solid;
        int light;               /* -1: several */
        enum pell_result result; /* of the observer */
    } shown;
};

/* Runs `task` for each band of TS_ROWS rows. */
static inline void ts_rows(const struct ts_state *st, int height, void (*task)(void *arg, int band, int worker), void *arg)
{
    pell_pool_run(st->pool, (height + TS_ROWS - 1) / TS_ROWS, task, arg);
}

/* Adds to the time of the pass of this name. */
static inline void ts_add_time(struct ts_state *st, const struct pell_pass_time *time)
{
    size_t i = 0;

    while (i < st->num_times && st->times[i].name != time->name)
        i++;
    if (i < TS_TIMES) {
        struct pell_pass_time *t = &st->times[i];
        if (i == st->num_times) {
            *t = (struct pell_pass_time) { .name = time->name };
            st->num_times++;
        }
        t->seconds += time->seconds;
        t->pixels += time->pixels;
        t->bytes += time->bytes;
        t->rays += time->rays;
    }
}

/* Adds the time since the last call to the pass of this name. */
static inline void ts_note_time(struct ts_state *st, const char *name, int64_t pixels, int64_t bytes, int64_t rays)
{
    const double now = pell_seconds();

    ts_add_time(st, &(struct pell_pass_time) { name, now - st->clock, pixels, bytes, rays });
    st->clock = now;
}

/* --- layouts.c ------------------------------------------------------------------------------------------------------------------- */

/* Measures the bounds of solids, once per set of vertices. */
void ts_layouts_measure(struct ts_state *st);
/* Makes the maps, or remakes those whose texels are too fine or too coarse for the frame. */
PELL_NODISCARD enum pell_result ts_layouts_fit(struct ts_state *st, const struct pell_frame *in);
void ts_layouts_finish(struct ts_state *st);
/* Whether a solid's scattering radius is scaled. */
bool ts_scaled_strength(const struct ts_state *st, int32_t solid);

/* --- show.c ---------------------------------------------------------------------------------------------------------------------- */

struct ts_image {
    const char *name, *unit, *what;
    const float *planes[3]; /* of the solid's map */
    int components;
    bool color;
    bool of_light;                                     /* the light's number is prefixed to the name if there is one */
    double falloff;                                    /* above 0: the values are alpha, and the image shows the thickness in mm */
    const struct pell_intermediate_gaussian *gaussian; /* of a blurred image; NULL: none */
};

/* Shows an image to observers of the renderer, if any, for the solid and light of st->shown; a failure is stored in st->shown.result. */
void ts_show(struct ts_state *st, const struct ts_image *image);

/* --- light_map.c ----------------------------------------------------------------------------------------------------------------- */

/* Computes the entering light of the lights in the bit mask (0: all) to three planes; in a partly made map only for needed texels, unless
 * `all`. `faces`: for lights of one known direction the orientation of each triangle; NULL: unknown. `single`: three more planes, for the
 * part that accounts for the single scattering of diffuse light; NULL: not requested. Call between chains: st->half holds the ambient
 * visibility. */
PELL_NODISCARD enum pell_result ts_light_map(struct ts_state *st, const struct ts_atlas *a, uint64_t lights, const uint8_t *faces, bool all,
                                             float *const light[3], float *const *single);
/* The same, and the material's strength to st->strength. */
void ts_light_map_and_strength(struct ts_state *st, const struct ts_atlas *a);

/* Whether the maps exclude light that leaves at the far side of thin parts, because transmission supplies all of it there. */
static inline bool ts_is_local(const struct ts_state *st)
{
    return st->services->settings->curvature && st->knobs.transmission == TS_TRANSMISSION_SLAB && st->knobs.tsm == TS_TSM_RAY &&
           st->knobs.lights == TS_LIGHTS_OWN;
}

/* --- need.c ---------------------------------------------------------------------------------------------------------------------- */

/* Whether maps may be made in part. */
bool ts_need_enabled(const struct ts_state *st, const struct pell_frame *in);
/* Marks the texels that pixels read; and those of later samples. */
void ts_need_mark_visible(struct ts_state *st, const struct pell_frame *in);
void ts_need_mark_later(struct ts_state *st, const struct pell_frame *in);
/* Whether so little of a solid is marked that making its map in part saves time. */
bool ts_need_pays(const struct ts_solid *solid);
/* Discards the map of a solid. */
void ts_need_discard(struct ts_solid *solid);
/* Call before a solid is made in part: the marked texels become those that its map will hold. */
void ts_need_begin(struct ts_state *st, struct ts_solid *solid);
/* Marks the inputs of a chain of all blurs, with `transmission` also for the listed texels that receive light; and the inputs of
 * softening. */
void ts_need_chain(struct ts_state *st, const struct ts_solid *solid, bool transmission);
void ts_need_soft(struct ts_state *st, const struct ts_solid *solid);

/* --- cpu.c, for all engines ------------------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result ts_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                          const struct ts_runner *run, void **state);
/* Does everything up to the lookup by pixels; ts_render includes the lookup. */
PELL_NODISCARD enum pell_result ts_make(struct ts_state *st, const struct pell_frame *in);
PELL_NODISCARD enum pell_result ts_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out);
void ts_destroy(void *state);
size_t ts_times(const void *state, struct pell_pass_time *list, size_t size);

/* --- fill.c ---------------------------------------------------------------------------------------------------------------------- */

/* Fills borders within `far` texels of charts in `count` planes; in a partly made map only those needed at `stage`. */
void ts_fill(const struct ts_state *st, const struct ts_atlas *a, float *const *planes, int count, int far, int stage);

/* --- chain.c --------------------------------------------------------------------------------------------------------------------- */

struct ts_chain_params {
    bool local;        /* add the light that leaves on the side where it entered */
    bool transmission; /* add transmitted light, by the alpha in st->light[TS_ALPHA] */
    bool joined;       /* with transmission: also blur st->light[TS_LOCAL], and add it where it entered */
    bool scaled;       /* distances are scaled by st->strength */
};

/* Blurs st->light. */
PELL_NODISCARD enum pell_result ts_chain(struct ts_state *st, const struct ts_solid *solid, const struct ts_chain_params *params);
/* Transmitted light is at least as smooth as its path is long: blurs st->transmitted into the sum. */
PELL_NODISCARD enum pell_result ts_soften(struct ts_state *st, const struct ts_solid *solid);

/* State of a running chain. */
struct ts_blurring {
    struct ts_state *st;
    const struct ts_solid *solid;
    float *const *now; /* on the cpu engine the input of the next blur: st->light at first, st->now later */
    int planes;        /* number of input planes */
    int level;         /* index in the profile */
    int blurs;         /* number of finished blurs */
    bool down;
    bool scaled; /* by strength */
};

struct ts_blur {
    double before, after; /* variance, mm^2 */
    const double *weight; /* NULL: not added to the sum */
};

/* The blurs of a solid's chain, without those that reach no further than a texel. Returns their number. */
int ts_chain_blurs(struct ts_state *st, const struct ts_solid *solid, struct ts_blur out[TS_LEVELS]);
/* The blur of transmitted light. */
struct ts_blur ts_soft_blur(const struct ts_solid *solid);

/* The stretch for the paper's taps, which blur it as well: texels per mm along x and y; 0 outside of charts. */
static inline void ts_stretch(const struct ts_state *st, const struct ts_atlas *a, ptrdiff_t at, float density[2])
{
    const float lx = st->work.length[0][at], ly = st->work.length[1][at], skew = st->knobs.stretch ? a->skew[at] * lx : 0.0f;

    density[0] = lx > 0.0f ? 1.0f / lx : 0.0f;
    density[1] = lx > 0.0f ? 1.0f / sqrtf(ly * ly + skew * skew) : 0.0f;
}

/* Distance along the surface, in standard deviations, from which transmitted light has its full weight, with fade=linear. */
#define TS_FADE_REACH 6.0f

/* --- run_cpu.c, vulkan.c ---------------------------------------------------------------------------------------------------------- */

/* Operations of an engine on the planes of a solid's map: `now`, the current level; the sum of radiant exitance; the transmitted light
 * before softening. begin, start, inspect, finish and store report failures; on a device the others only record commands. */
struct ts_runner {
    /* Starts a solid whose lengths and cells are in st->work: sums are 0. */
    enum pell_result (*begin)(struct ts_state *st, const struct ts_solid *solid);
    /* `now` becomes st->light or, with `transmitted`, the transmitted light: this many planes. With the paper's taps the stretch, too. */
    enum pell_result (*start)(struct ts_blurring *p, bool transmitted, int planes);
    /* Fills borders of `now` within `far` texels of charts. */
    void (*fill)(struct ts_blurring *p, int planes, int far);
    /* Computes the transmission weights of the listed texels for p->level, from `now`'s alpha. */
    void (*transmission_weights)(struct ts_blurring *p);
    /* Blurs `now`, including borders up to `blurred` texels; adds the weighted result to the sum. */
    void (*blur)(struct ts_blurring *p, const struct ts_blur *blur, int blurred);
    /* Adds the jittered taps around each texel of `now` to the sum. */
    void (*scatter)(struct ts_blurring *p);
    /* Adds the weighted `now` to the sum. */
    void (*add)(struct ts_blurring *p, const double weight[3]);
    /* Adds `now` at the entry points of transmitted light, by the transmission weights. */
    void (*transmit)(struct ts_blurring *p);
    /* Attributes the time since the last call to a pass of this name: texels, and planes of them that were read and written. */
    void (*note)(struct ts_state *st, const char *name, int64_t texels, int planes);
    /* Copies `now`, or the sum, to st->now or st->sum for inspection. */
    enum pell_result (*inspect)(struct ts_blurring *p, bool sum);
    /* Ends the chain. */
    enum pell_result (*finish)(struct ts_blurring *p);
    /* Stores the sum as the solid's map. */
    enum pell_result (*store)(struct ts_state *st, const struct ts_solid *solid);
    /* Releases layouts; `close` releases everything of the state. */
    void (*forget)(struct ts_state *st);
    void (*close)(struct ts_state *st);
    bool culls; /* skips texels that st->need excludes */
    bool joins; /* has TS_PLANES planes: a light's chain can blur other light with it */
};

extern const struct ts_runner ts_cpu_runner;

/* --- read_map.c ------------------------------------------------------------------------------------------------------------------ */

/* Radiant exitance per irradiance at the entry point itself, per channel, with first=unblurred; else 0. */
void ts_unblurred(const struct ts_state *st, const struct ts_solid *solid, double weight[3]);
/* Returns the number of pixels. */
int64_t ts_read_map(struct ts_state *st, const struct pell_frame *in, const struct pell_frame_light *out);

#endif
