/* SPDX-License-Identifier: MIT
 * wavefront.c - sixteen paths in SIMD lanes. Sequences of flights and scattering events run in the kernel of wavefront_kernel.h; at
 * surfaces, outside, in layers and for next-event estimation each path runs by itself, as in walk.c. A finished path makes room for the
 * next one. The result of a sample does not depend on its neighbours: it has the same bits as with one path after the other. */
#include "methods/path_trace/walk.h"
#include "methods/path_trace/wavefront_kernel.h"

#include <string.h>

#define FEW 2 /* number of paths for which lanes do not pay */

struct slot {
    struct pt_walk p;
    struct pt_sampler sampler;
    struct pt_light light;
    struct pt_light_vertex vertex[PT_LIGHT_VERTICES];
    struct pt_branches branches;
    struct pt_job *job;
};

struct pt_wavefront {
    struct pt_wavefront_lanes w;
    struct pell_ray_hit16 rays;
    struct slot slot[PT_LANES + 1]; /* the last one: a path that waits for a free lane */
    const struct pt_wavefront_kernels *k;
    int key[PT_LANES]; /* state of a path: its solid, and whether it is in that one only */
    uint32_t live;
    uint32_t fresh;  /* rays start at the path's own origin, not at x: it comes from a surface */
    uint32_t single; /* every scattering event is handled individually */
    uint32_t moved;  /* it has scattered since it was put into its lane */
    bool waits;
    const struct pt_scene *s;
    struct pt_walker *walker;
    struct pt_job *jobs;
    int count, next;
    const struct pt_point *point; /* of `hit` */
    struct pt_hit hit;
    bool found;
};

enum pell_result pt_wavefront_create(const struct pt_scene *s, struct pt_wavefront **out)
{
    struct pt_wavefront *d = *out = pell_zalloc(s->ctx, sizeof(*d));

    if (!d)
        return PELL_ERR_NOMEM;
    d->k = pt_wavefront_kernels_tables[pell_simd_best()];
    return PELL_OK;
}

void pt_wavefront_destroy(struct pell_context *ctx, struct pt_wavefront **wavefront)
{
    pell_free(ctx, *wavefront);
    *wavefront = NULL;
}

/* --- Paths in lanes and single paths ------------------------------------------------------------------------------------------------ */

static bool connects(const struct pt_wavefront *d, const struct pt_walk *p)
{
    return p->stack.count == 1 && d->s->solid[pt_top(&p->stack)].connects;
}

static int key_of(const struct pt_walk *p)
{
    return 2 * pt_top(&p->stack) + (p->stack.count == 1);
}

/* Copies the state of a lane to its path. */
static void store_lane(struct pt_wavefront *d, int l)
{
    struct pt_wavefront_lanes *w = &d->w;
    struct pt_walk *p = &d->slot[l].p;
    struct pell_vec3 incident = { w->incident[0][l], w->incident[1][l], w->incident[2][l] };

    p->x = vec3(w->x[0][l], w->x[1][l], w->x[2][l]);
    p->w = vec3(w->w[0][l], w->w[1][l], w->w[2][l]);
    for (int c = 0; c < 3; c++)
        p->beta[c] = w->beta[c][l];
    p->safe = w->safe[l];
    p->selection = w->selection[l];
    p->events = w->events[l];
    p->scattered = w->scattered[l];
    d->slot[l].sampler.state = w->state[l];
    if (!(d->moved >> l & 1))
        return;
    p->from = p->x;
    if (connects(d, p)) {
        const int solid = pt_top(&p->stack);
        p->exit.from = (struct pt_scatterer) { .x = p->x, .w = incident, .medium = &d->s->solid[solid].medium.layer[0] };
        p->exit.solid = solid;
        p->exit.fraction = p->scattered <= 1 ? 1.0f : d->s->solid[solid].fraction;
        for (int c = 0; c < 3; c++)
            p->exit.from.beta[c] = w->collision_beta[c][l];
        p->leaving = true;
    }
}

/* Copies the state of a path to its lane. */
static void load_lane(struct pt_wavefront *d, int l)
{
    struct pt_wavefront_lanes *w = &d->w;
    struct slot *slot = &d->slot[l];
    const struct pt_walk *p = &slot->p;
    const float x[3] = { p->x.x, p->x.y, p->x.z }, dir[3] = { p->w.x, p->w.y, p->w.z };
    const uint32_t bit = 1u << l;

    for (int k = 0; k < 3; k++) {
        w->x[k][l] = x[k];
        w->w[k][l] = dir[k];
        w->beta[k][l] = p->beta[k];
    }
    w->safe[l] = p->safe;
    w->selection[l] = p->selection;
    w->events[l] = p->events;
    w->scattered[l] = p->scattered;
    w->state[l] = slot->sampler.state;
    w->at[l] = slot->sampler.at;
    w->sampler[l] = &slot->sampler;
    d->key[l] = key_of(p);
    d->live |= bit;
    d->fresh |= bit;
    d->moved &= ~bit;
    d->single |= bit; /* until its next scattering event */
}

/* Runs the path alone until it is in a solid whose paths run in lanes. False: the path is complete. */
static bool run_to_lanes(const struct pt_scene *s, struct pt_walk *p)
{
    while (!(p->stack.count > 0 && s->solid[pt_top(&p->stack)].lanes))
        if (!pt_step(p))
            return false;
    return true;
}

/* A path is complete: starts the next of its parts. */
static void finish(struct pt_wavefront *d, int l)
{
    struct slot *slot = &d->slot[l];

    while (pt_next_branch(&slot->p))
        if (run_to_lanes(d->s, &slot->p)) {
            load_lane(d, l);
            return;
        }
    pt_light_add(&slot->job->light, &slot->light);
    d->live &= ~(1u << l);
}

/* Updates the lane after an event outside of the kernel. */
static void resume(struct pt_wavefront *d, int l, bool lives)
{
    if (lives && run_to_lanes(d->s, &d->slot[l].p))
        load_lane(d, l);
    else
        finish(d, l);
}

/* A few paths run faster one at a time. */
static void finish_alone(struct pt_wavefront *d)
{
    for (; d->live; d->live &= d->live - 1) {
        const int l = __builtin_ctz(d->live);
        store_lane(d, l);
        do {
            while (pt_step(&d->slot[l].p))
                continue;
        } while (pt_next_branch(&d->slot[l].p));
        pt_light_add(&d->slot[l].job->light, &d->slot[l].light);
    }
}

/* --- Next paths ----------------------------------------------------------------------------------------------------------------------- */

static void bind_slot(struct slot *slot)
{
    slot->p.sampler = &slot->sampler;
    slot->p.out = &slot->light;
    slot->p.vertex = slot->vertex;
    slot->p.branches = &slot->branches;
    slot->branches.count = 0;
}

static void load_slot(struct pt_wavefront *d, int l, const struct pt_walk *p, const struct pt_sampler *sampler,
                      const struct pt_light *light, struct pt_job *job)
{
    struct slot *slot = &d->slot[l];

    slot->p = *p;
    slot->sampler = *sampler;
    slot->light = *light;
    slot->job = job;
    if (p->vertices > 0)
        memcpy(slot->vertex, p->vertex, (size_t) p->vertices * sizeof(*slot->vertex));
    bind_slot(slot);
}

/* Starts samples until one has a path for the lane. False: no samples are left. */
static bool fill(struct pt_wavefront *d, int l)
{
    if (d->waits) {
        struct slot *from = &d->slot[PT_LANES];
        d->waits = false;
        load_slot(d, l, &from->p, &from->sampler, &from->light, from->job);
        load_lane(d, l);
        return true;
    }
    while (d->next < d->count) {
        struct pt_job *job = &d->jobs[d->next++];
        struct pt_walk walks[2];
        struct pt_sampler sampler[2];
        struct pt_light parts[2];
        bool loaded = false;
        int count;

        if (job->point != d->point)
            d->found = pt_find(d->s, &d->walker->counts, job->point, &d->hit);
        d->point = job->point;
        d->walker->counts.lost += !d->found;
        if (!d->found)
            continue;
        memset(parts, 0, sizeof(parts));
        count = pt_begin(d->s, d->walker, job->point, &d->hit, job->sample, walks, sampler, parts);
        for (int i = 0; i < count; i++) {
            if (!run_to_lanes(d->s, &walks[i])) {
                pt_light_add(&job->light, &parts[i]);
            } else if (!loaded) {
                load_slot(d, l, &walks[i], &sampler[i], &parts[i], job);
                load_lane(d, l);
                loaded = true;
            } else {
                load_slot(d, PT_LANES, &walks[i], &sampler[i], &parts[i], job);
                d->waits = true;
            }
        }
        if (loaded)
            return true;
    }
    return false;
}

/* --- Steps ---------------------------------------------------------------------------------------------------------------------------- */

static int count_lanes(uint32_t set)
{
    set = (set & 0x5555u) + (set >> 1 & 0x5555u);
    set = (set & 0x3333u) + (set >> 2 & 0x3333u);
    set = (set & 0x0f0fu) + (set >> 4 & 0x0f0fu);
    return (int) ((set & 0xffu) + (set >> 8));
}

static struct pt_wavefront_solid solid_data(const struct pt_scene *s, int solid, bool one)
{
    const struct pt_solid *b = &s->solid[solid];
    const float margin = 4.0f * s->epsilon;

    return (struct pt_wavefront_solid) {
        .m = &b->medium.layer[0],
        .grid = b->grid ? pell_distance_grid(s->distance, solid) : NULL,
        .lo = { b->lo.x - margin, b->lo.y - margin, b->lo.z - margin },
        .hi = { b->hi.x + margin, b->hi.y + margin, b->hi.z + margin },
        .roulette = s->knobs.roulette,
        .fraction = b->fraction,
        .connect_mm = b->connect_mm,
        .events = s->knobs.events,
        .connects = one && b->connects,
    };
}

/* A lane's flight whose ray has a hit: false if it continues to its collision. */
static bool lane_hits(struct pt_wavefront *d, int l, bool splits)
{
    const struct pell_ray_hit16 *r = &d->rays;
    struct pt_wavefront_lanes *w = &d->w;
    struct pt_walk *p = &d->slot[l].p;
    struct pt_flight f = { .length = w->length[l], .bound = w->bound[l], .channel = w->channel[l], .found = true };

    if (!splits && !(r->ray.tfar[l] <= w->length[l]))
        return false;
    store_lane(d, l);
    pt_hit_at(d->s, r->hit.mesh[l], r->hit.triangle[l], r->hit.u[l], r->hit.v[l], p->w, &f.hit);
    f.hit.t = r->ray.tfar[l];
    f.has_hit = f.hit.t <= f.length;
    switch (splits ? pt_split(p, &f) : PT_SPLIT_NOT) {
    case PT_SPLIT_NOT:
        if (!f.has_hit)
            return false;
        pt_attenuate(&d->s->solid[pt_top(&p->stack)].medium.layer[0], f.hit.t, p->beta);
        resume(d, l, pt_surface_event(p, &f.hit, f.hit.t));
        return true;
    case PT_SPLIT_COLLIDES:
        w->length[l] = f.length;
        for (int c = 0; c < 3; c++)
            w->inverse_stay[c][l] = f.inverse_stay[c];
        return false;
    case PT_SPLIT_REFLECTS: break;
    }
    resume(d, l, pt_roulette(p->beta, (p->beta[0] + p->beta[1] + p->beta[2]) * (1.0f / 3.0f), d->s->knobs.roulette, p->sampler));
    return true;
}

/* Handles the flights that hit a surface. */
static uint32_t intersect(struct pt_wavefront *d, int solid, bool one, uint32_t set)
{
    const float split_mm = one ? d->s->solid[solid].split_mm : 0.0f;
    const struct pt_wavefront_lanes *w = &d->w;
    struct pell_ray_hit16 *r = &d->rays;
    _Alignas(64) int valid[PELL_PACKET];
    uint32_t hits = 0;

    for (int l = 0; l < PT_LANES; l++) {
        valid[l] = -(int) (set >> l & 1);
        r->ray.ox[l] = w->x[0][l];
        r->ray.oy[l] = w->x[1][l];
        r->ray.oz[l] = w->x[2][l];
        r->ray.dx[l] = w->w[0][l];
        r->ray.dy[l] = w->w[1][l];
        r->ray.dz[l] = w->w[2][l];
        r->ray.tnear[l] = 0.0f;
        r->ray.tfar[l] = fmaxf(w->length[l], w->bound[l] + split_mm);
        r->ray.time[l] = 0.0f;
        r->ray.mask[l] = PELL_RAY_ALL;
        r->ray.id[l] = (uint32_t) l;
        r->ray.flags[l] = 0;
    }
    for (uint32_t left = set & d->fresh; left; left &= left - 1) {
        const int l = __builtin_ctz(left);
        r->ray.ox[l] = d->slot[l].p.from.x;
        r->ray.oy[l] = d->slot[l].p.from.y;
        r->ray.oz[l] = d->slot[l].p.from.z;
    }
    pell_rays_closest16(d->s->rays, valid, false, r);
    d->walker->counts.rays += count_lanes(set);
    for (uint32_t left = set; left; left &= left - 1) {
        const int l = __builtin_ctz(left);
        if (r->hit.mesh[l] == PELL_NO_HIT)
            continue;
        hits |= (uint32_t) lane_hits(d, l, split_mm > 0.0f) << l;
    }
    return hits;
}

/* A flight that left the solid through no surface. */
static void escape(struct pt_wavefront *d, int l)
{
    struct pt_walk *p = &d->slot[l].p;
    const struct pt_solid *b;
    float length;

    store_lane(d, l);
    b = &d->s->solid[pt_top(&p->stack)];
    length = pt_outside(b, p->x, 0.0f) ? 0.0f : pt_exit_distance(b, p->x, p->w);
    pt_attenuate(&b->medium.layer[0], length, p->beta);
    pt_escaped(p, vec3_mad(p->x, length, p->w));
    resume(d, l, true);
}

/* Next-event estimation at a scatterer. */
static void estimate_direct(struct pt_wavefront *d, int l, int solid, bool connecting)
{
    struct pt_walk *p = &d->slot[l].p;

    d->moved &= ~(1u << l);
    store_lane(d, l);
    p->from = p->x;
    const struct pt_scatterer at = { p->x, p->w, &d->s->solid[solid].medium.layer[0], .beta = { p->beta[0], p->beta[1], p->beta[2] },
                                     .bounces = p->bounces };
    pt_scattering_event(p, &at, solid, connecting ? PT_CONNECTION_YES : PT_CONNECTION_NO);
    d->w.selection[l] = p->selection;
    if (!p->all_specular && p->vertices == 0 && !d->s->solid[solid].connects_rough)
        d->single &= ~(1u << l);
}

/* One step of paths in one solid. */
static void step(struct pt_wavefront *d, int solid, bool one, uint32_t set)
{
    struct pt_counts *counts = &d->walker->counts;
    const struct pt_wavefront_solid data = solid_data(d->s, solid, one);
    uint32_t cut, lost, gone, rays, connecting;

    rays = d->k->sample_distance(&d->w, &data, set, &cut);
    for (uint32_t left = cut; left; left &= left - 1) {
        const int l = __builtin_ctz(left);
        pt_count_cut(counts, (const float[3]) { d->w.beta[0][l], d->w.beta[1][l], d->w.beta[2][l] });
        finish(d, l);
    }
    set &= ~cut;
    counts->steps_without_ray += count_lanes(set & ~rays);
    if (rays)
        set &= ~intersect(d, solid, one, rays);
    if (!set)
        return;
    connecting = d->k->collide(&d->w, &data, set, &lost, &gone);
    set &= ~lost;
    counts->scatterings += count_lanes(set);
    for (uint32_t left = lost; left; left &= left - 1)
        escape(d, __builtin_ctz(left));
    for (uint32_t left = gone; left; left &= left - 1)
        finish(d, __builtin_ctz(left));
    set &= ~gone;
    for (uint32_t left = (connecting | d->single) & set; left; left &= left - 1) {
        const int l = __builtin_ctz(left);
        estimate_direct(d, l, solid, connecting >> l & 1);
    }
    d->fresh &= ~set;
    d->moved |= set;
    for (uint32_t left = d->k->scatter(&d->w, &data, set); left; left &= left - 1)
        finish(d, __builtin_ctz(left));
}

void pt_wavefront_trace(const struct pt_scene *s, struct pt_walker *walker, struct pt_job *jobs, int count)
{
    struct pt_wavefront *d = walker->wavefront;

    d->s = s;
    d->walker = walker;
    d->jobs = jobs;
    d->count = count;
    d->next = 0;
    d->live = d->fresh = d->single = d->moved = 0;
    d->waits = false;
    d->point = NULL;
    for (int i = 0; i < count; i++)
        memset(&jobs[i].light, 0, sizeof(jobs[i].light));
    for (;;) {
        uint32_t left;
        for (int l = 0; l < PT_LANES; l++)
            if (!(d->live >> l & 1) && !fill(d, l))
                break;
        if (!d->live || pt_stopped(s))
            return;
        if (count_lanes(d->live) <= FEW) {
            finish_alone(d);
            continue;
        }
        for (left = d->live; left;) {
            const int key = d->key[__builtin_ctz(left)];
            uint32_t set = 0;
            for (int l = 0; l < PT_LANES; l++)
                set |= (uint32_t) (d->key[l] == key) << l;
            set &= left;
            left &= ~set;
            step(d, key / 2, key & 1, set);
        }
    }
}
