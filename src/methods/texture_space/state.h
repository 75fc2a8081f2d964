/* SPDX-License-Identifier: MIT
 *
 * state.h - what the parts of the method share; private to this folder. cpu.c calls layouts.c, light_map.c, chain.c and read_map.c; chain.c
 * and cpu.c call a runner, which is that of an engine: run_cpu.c or vulkan.c.
 */
#ifndef METHODS_TEXTURE_SPACE_STATE_H
#define METHODS_TEXTURE_SPACE_STATE_H

#include "methods/texture_space/texture_space.h"

#include "base/pool.h"

#include <stdatomic.h>

enum { TS_ROWS = 16, TS_TIMES = TS_LEVELS + 9, TS_LIT = 4, TS_READ_FAR = 6 };
/* TS_ROWS: that a thread takes in one go. TS_READ_FAR: texels from the inside of charts that pixels read at most: look_around's, and the
 * four about a place. */

enum ts_made { TS_MADE_NOT, TS_MADE_IN_PART, TS_MADE_WHOLE };

struct ts_solid {
    struct ts_atlas *atlas;
    const struct ts_profile *profile; /* of its material */
    float *map;                       /* R, G, B of M and the chart, per texel; begins at texel (0, 0) */
    int side, first_side;             /* texels; of the first frame's map, 0: not yet */
    enum ts_made made;                /* of these lights */
    uint64_t version;                 /* another one for each map that was made; 0: none yet */
    _Atomic uint8_t *seen;            /* per texel, while it is made in part: need.c */
    _Atomic bool missing;             /* pixels read what is not made */
    bool partly;                      /* it is to be made in part */
    struct pell_vec3 middle;          /* of its bounds, */
    float radius;                     /* and half their diagonal; mm */
};

struct ts_runner;
struct ts_pixels;

/* Stages of a chain that texels are needed up to: before its blur number i, and after the first half of that and the second. */
#define TS_NEED_BEFORE(i) (1 + 2 * (i))
#define TS_NEED_ALONG(i) (2 + 2 * (i))
#define TS_NEED_DOWN(i) (3 + 2 * (i))

/* Which texels of the solid that is being made are needed. Planes at texel (0, 0). */
struct ts_need {
    bool on;
    uint8_t *stage; /* that each is needed up to; 0: never */
    uint8_t *cell;  /* most of each block of a row */
    uint8_t *wide;  /* to work in */
    float *wide_key;
    uint8_t *shown;  /* those that pixels read */
    uint8_t *behind; /* those whose transmitted light is needed */
};

struct ts_state {
    const struct ts_runner *run;          /* the engine's */
    void *device;                         /* its own; NULL where it has none, or nothing on it yet */
    struct ts_pixels *pixels;             /* of the engine vulkan: read_gpu.h */
    const struct pell_services *services; /* borrowed */
    const struct pell_frame *in;          /* that is being made */
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct ts_kernels *kernels;
    struct ts_knobs knobs;
    struct pell_solids *solids;
    struct ts_solid *solid;
    size_t num_solids;
    uint64_t versions; /* that there were of maps */
    bool whole;        /* made without a failure */
    bool reused;       /* maps have been read from more than one view: culling would make them twice */
    struct ts_need need;
    struct ts_profile *profiles; /* of materials; a solid's alone are made */
    size_t num_profiles;
    struct ts_tsm tsm;
    float *memory;        /* of the planes below, at texel (0, 0) of any atlas */
    float *light[TS_LIT]; /* that entered, and alpha */
    float *now[TS_PLANES], *half[TS_PLANES], *sum[3];
    float *behind[3]; /* transmitted light, before it is softened */
    float *strength;
    float *scaled[2]; /* lengths over strength */
    struct ts_cell *cells;
    uint64_t made_of; /* its materials, knobs and size: what must be the same in a state that is used again */
    double layout;    /* seconds that layouts took; 0: told */
    uint64_t lit;     /* the lights' number; 0: not yet */
    size_t warned;    /* how many lights there were when they were counted */
    struct ts_work work;
    float least[2], skew; /* lengths of the solid's shortest texels; and the most that a block leans */
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

/* Adds to the pass of this name. */
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

/* Where solids are: once for each set of vertices. */
void ts_layouts_measure(struct ts_state *st);
/* Makes the maps, or those whose texels are too fine or too coarse for the frame anew. */
PELL_NODISCARD enum pell_result ts_layouts_fit(struct ts_state *st, const struct pell_frame *in);
void ts_layouts_finish(struct ts_state *st);
/* Whether a solid's scattering radius is scaled. */
bool ts_scaled_strength(const struct ts_state *st, int32_t solid);

/* --- show.c ---------------------------------------------------------------------------------------------------------------------- */

struct ts_image {
    const char *name, *unit, *what;
    const float *planes[3]; /* of the solid's map */
    int components;
    int number; /* goes behind the name, from 1; 0: none */
    bool color;
    bool of_light;  /* the light's number goes before the name, where it is of one */
    double falloff; /* above 0: the values are alpha, what is shown is the thickness in mm */
};

/* For who observes the renderer: nothing otherwise. The texels of st->shown's solid and light; fails by st->shown.result. */
void ts_show(struct ts_state *st, const struct ts_image *image);

/* --- light_map.c ----------------------------------------------------------------------------------------------------------------- */

/* Light of these lights (a bit each; 0: all) that enters, to st->light; of a map made in part `all` texels, or those that are needed.
 * `faces`: of lights of one known direction, what each triangle shows them; NULL: unknown. Between chains: st->half holds the ambient
 * visibility. */
PELL_NODISCARD enum pell_result ts_light_map(struct ts_state *st, const struct ts_atlas *a, uint64_t lights, const uint8_t *faces,
                                             bool all);
/* The same, and the material's strength, to st->strength. */
void ts_light_map_and_strength(struct ts_state *st, const struct ts_atlas *a);

/* Whether the maps hold light less what leaves at the far side of thin parts: where transmission brings all of it there. */
static inline bool ts_is_local(const struct ts_state *st)
{
    return st->services->settings->curvature && st->knobs.transmission == TS_TRANSMISSION_SLAB && st->knobs.tsm == TS_TSM_RAY &&
           st->knobs.lights == TS_LIGHTS_OWN;
}

/* --- need.c ---------------------------------------------------------------------------------------------------------------------- */

/* Whether maps are made in part. */
bool ts_need_may(const struct ts_state *st, const struct pell_frame *in);
/* Marks what pixels read; and those of the samples to come. */
void ts_need_see(struct ts_state *st, const struct pell_frame *in);
void ts_need_look_ahead(struct ts_state *st, const struct pell_frame *in);
/* Whether so little of a solid is marked that it is made in part. */
bool ts_need_pays(const struct ts_solid *solid);
/* Nothing is made of a solid. */
void ts_need_forget(struct ts_solid *solid);
/* Before a solid is made in part: what was marked becomes what its map shows. */
void ts_need_begin(struct ts_state *st, struct ts_solid *solid);
/* What a chain of all blurs needs, with `transmission` for the texels of the list that receive any, too; and what softening needs. */
void ts_need_chain(struct ts_state *st, const struct ts_solid *solid, bool transmission);
void ts_need_soft(struct ts_state *st, const struct ts_solid *solid);

/* --- cpu.c, whatever the engine --------------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result ts_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                          const struct ts_runner *run, void **state);
/* All that comes before pixels read the maps; then they do, too. */
PELL_NODISCARD enum pell_result ts_make(struct ts_state *st, const struct pell_frame *in);
PELL_NODISCARD enum pell_result ts_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out);
void ts_destroy(void *state);
size_t ts_times(const void *state, struct pell_pass_time *list, size_t size);

/* --- fill.c ---------------------------------------------------------------------------------------------------------------------- */

/* Fills `count` planes' borders that are no further than `far` texels from charts, and of a map that is made in part those that are needed
 * at `stage`. */
void ts_fill(const struct ts_state *st, const struct ts_atlas *a, float *const *planes, int count, int far, int stage);

/* --- chain.c --------------------------------------------------------------------------------------------------------------------- */

struct ts_chain_params {
    bool local;        /* add what leaves on the side where it entered */
    bool transmission; /* add transmitted light, by the alpha in st->light[3] */
    bool scaled;       /* distances are scaled by st->strength */
};

/* Blurs what is in st->light. */
PELL_NODISCARD enum pell_result ts_chain(struct ts_state *st, const struct ts_solid *solid, const struct ts_chain_params *params);
/* Transmitted light is at least as smooth as its way is long: blurs st->behind into the sum. */
PELL_NODISCARD enum pell_result ts_soften(struct ts_state *st, const struct ts_solid *solid);

/* A chain that is running. */
struct ts_blurring {
    struct ts_state *st;
    const struct ts_solid *solid;
    float *const *now; /* on the cpu engine what is blurred next: st->light at first, st->now later */
    int planes;        /* of what the chain starts with */
    int level;         /* in the profile */
    int blurs;         /* that are done */
    bool down;
    bool scaled; /* by strength */
};

struct ts_blur {
    double before, after; /* variance, mm^2 */
    const double *weight; /* NULL: don't add it to the sum */
};

/* The blurs of a solid's chain, those that reach no further than a texel left out. Returns how many. */
int ts_chain_blurs(struct ts_state *st, const struct ts_solid *solid, struct ts_blur out[TS_LEVELS]);
/* That of transmitted light. */
struct ts_blur ts_soft_blur(const struct ts_solid *solid);

/* The stretch that the paper's taps blur, too: texels per mm along x and y; 0 without chart. */
static inline void ts_stretch(const struct ts_state *st, const struct ts_atlas *a, ptrdiff_t at, float density[2])
{
    const float lx = st->work.length[0][at], ly = st->work.length[1][at], skew = st->knobs.stretch ? a->skew[at] * lx : 0.0f;

    density[0] = lx > 0.0f ? 1.0f / lx : 0.0f;
    density[1] = lx > 0.0f ? 1.0f / sqrtf(ly * ly + skew * skew) : 0.0f;
}

/* Standard deviations at which transmitted light counts in full, with fade=linear. */
#define TS_FADE_REACH 6.0f

/* --- run_cpu.c, vulkan.c ---------------------------------------------------------------------------------------------------------- */

/* Planes of a solid's map on an engine: `now`, which is blurred; the sum of what leaves; what is transmitted and not soft yet. What fails
 * is reported by begin, start, look, finish and store; what lies between is recorded alone where the engine is a device. */
struct ts_runner {
    /* Of a solid whose lengths and cells are in st->work: sums are 0. */
    enum pell_result (*begin)(struct ts_state *st, const struct ts_solid *solid);
    /* `now` is st->light, or what is transmitted (`behind`): so many planes. With the paper's taps the stretch, too. */
    enum pell_result (*start)(struct ts_blurring *p, bool behind, int planes);
    /* Borders of `now` that are no further than `far` texels from charts. */
    void (*fill)(struct ts_blurring *p, int planes, int far);
    /* Shares of the texels that light is transmitted to, by `now`'s alpha, of p->level. */
    void (*thin_out)(struct ts_blurring *p);
    /* Blurs `now`, borders first so far as `blurred`; adds the result to the sum. */
    void (*blur)(struct ts_blurring *p, const struct ts_blur *blur, int blurred);
    /* Adds what taps at a few places about each texel of `now` bring to the sum. */
    void (*scatter)(struct ts_blurring *p);
    /* Adds `now` to the sum. */
    void (*add)(struct ts_blurring *p, const double weight[3]);
    /* Adds `now`, where it is transmitted from, by the shares. */
    void (*through)(struct ts_blurring *p);
    /* What has run since the last call is a pass of this name: texels, and planes of them that were read and written. */
    void (*note)(struct ts_state *st, const char *name, int64_t texels, int planes);
    /* Brings `now`, or the sum, to st->now or st->sum, to be looked at. */
    enum pell_result (*look)(struct ts_blurring *p, bool sum);
    /* The chain has ended. */
    enum pell_result (*finish)(struct ts_blurring *p);
    /* The sum becomes the solid's map. */
    enum pell_result (*store)(struct ts_state *st, const struct ts_solid *solid);
    /* Layouts go; and all of the state, NULL: that is no more. */
    void (*forget)(struct ts_state *st);
    void (*close)(struct ts_state *st);
    bool culls; /* leaves out what st->need says */
};

extern const struct ts_runner ts_cpu_runner;

/* --- read_map.c ------------------------------------------------------------------------------------------------------------------ */

/* What leaves where light enters, of each channel, with first=unblurred; else 0. */
void ts_unblurred(const struct ts_state *st, const struct ts_solid *solid, double weight[3]);
/* Returns how many pixels there were. */
int64_t ts_read_map(struct ts_state *st, const struct pell_frame *in, const struct pell_frame_light *out);

#endif
