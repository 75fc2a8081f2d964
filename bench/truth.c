/* SPDX-License-Identifier: MIT
 * truth.c - `pellucid-bench truth`: cost and error of the reference methods, in one run.
 *
 * Milliseconds are processor times, of all threads together: other work of the machine then counts less. Errors are of the subsurface
 * light's luminance at translucent pixels. Noise is measured by pairs of frames a, b of two seeds, which needs no error bar:
 *
 *     relative variance of a frame = Sum (a - b)^2 / 2  /  Sum a b        (noise does not bias the product)
 *
 * and times the seconds of a frame it is independent of the number of samples: the inverse of the efficiency. */
#include "papers.h"

#include "render/renderer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    SAMPLES = 4, /* per pixel, of path-trace */
    SMALL = 20,  /* width in pixels of the dipole's image */
    KEPT_RAYS = 1 << 21,
    TRIES = 3
};
#define DIPOLE_ERROR 0.04 /* that the dipole is run for; its time at 1 % follows from 1/sqrt(time) */
#define GOAL 0.01

struct truths {
    struct bench *bench;
    int64_t pixels; /* translucent, of the last frame */
};

/* Light of a frame. */
struct shot {
    double ms;     /* processor time */
    double *light; /* luminance; 0 where nothing is translucent */
    size_t size;
    int64_t rays; /* of path-trace */
};

static double processor_ms(void)
{
    return 1e3 * cli_cpu_seconds();
}

static void drop(struct shot *shot)
{
    free(shot->light);
    shot->light = NULL;
}

static enum pell_result shoot(struct truths *b, int64_t seed, int width, int height, struct shot *shot)
{
    static const char *const names[3] = { "R", "G", "B" };
    static const double weight[3] = { 0.2126, 0.7152, 0.0722 };
    struct pell_settings settings = b->bench->s.settings;
    struct pell_render_result p;
    const struct pell_channel *mask;
    double begin;
    enum pell_result res;

    memset(shot, 0, sizeof(*shot));
    settings.seed = seed;
    settings.width = width;
    settings.height = height;
    settings.layers = true;
    begin = processor_ms();
    res = bench_frame(b->bench->s.renderer, &settings, &p);
    shot->ms = processor_ms() - begin;
    cli_progress_end(b->bench->cli);
    if (res != PELL_OK)
        return res;
    for (size_t i = 0; i < p.num_stages; i++)
        shot->rays += strcmp(p.stages[i].name, "path-trace") == 0 ? p.stages[i].rays : 0;
    shot->size = (size_t) width * (size_t) height;
    shot->light = calloc(shot->size, sizeof(*shot->light));
    mask = cli_channel(&p, "translucent", "Y");
    if (!shot->light || !mask)
        return PELL_ERR_NOMEM;
    b->pixels = 0;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            double *to = &shot->light[(size_t) y * (size_t) width + (size_t) x];
            if (mask->data[y * mask->stride + x] < 1.0f) /* fully translucent pixels */
                continue;
            b->pixels++;
            for (size_t k = 0; k < PELL_COUNT(cli_subsurface_layers); k++)
                for (int c = 0; c < 3; c++) {
                    const struct pell_channel *part = cli_channel(&p, cli_subsurface_layers[k], names[c]);
                    *to += part ? weight[c] * (double) part->data[y * part->stride + x] : 0.0;
                }
        }
    return PELL_OK;
}

/* Root of the mean squared relative error over translucent pixels. */
static double error_against(const struct shot *a, const struct shot *truth)
{
    double square = 0.0;
    int64_t n = 0;

    for (size_t i = 0; i < a->size; i++)
        if (truth->light[i] > 0.0) {
            const double e = (a->light[i] - truth->light[i]) / truth->light[i];
            square += e * e;
            n++;
        }
    return n ? sqrt(square / (double) n) : 0.0;
}

static struct row *add(struct truths *b, const char *name, double ms, int64_t rays)
{
    struct row *r = bench_add(&b->bench->rows, name, ms);
    static struct row none;

    if (!r)
        return &none;
    r->pixels = b->pixels;
    r->rays = rays;
    return r;
}

/* --- Diffusion ----------------------------------------------------------------------------------------------------------------------- */

/* One pass created and used, then used again: the difference is the cost of its creation. */
static enum pell_result twice(struct truths *b, const char *method, const char *knobs, double *creation_ms, struct shot *shot)
{
    struct shot first = { 0 };
    enum pell_result res = bench_choose(b->bench, method, knobs);

    if (res == PELL_OK)
        res = shoot(b, 0, b->bench->s.settings.width, b->bench->s.settings.height, &first);
    if (res == PELL_OK)
        res = shoot(b, 0, b->bench->s.settings.width, b->bench->s.settings.height, shot);
    *creation_ms = fmax(first.ms - shot->ms, 0.0);
    drop(&first);
    return res;
}

/* A light that takes one ray: the measurement is of the integral over the surface, not of the light. */
static enum pell_result make_source_small(struct truths *b)
{
    struct pell_light *l = b->bench->s.scene->num_lights > 0 ? &b->bench->s.scene->lights[0] : NULL;

    if (l && l->type == PELL_LIGHT_RECT) {
        l->type = PELL_LIGHT_POINT;
        for (int c = 0; c < 3; c++)
            l->power[c] *= 1e-6f * l->width * l->height; /* of mm^2 in m^2, toward where it faced */
    }
    return pell_renderer_set_scene(b->bench->s.renderer, b->bench->s.scene);
}

/* `hierarchical` from coarse to fine: build and query as samples grow, and the first that reaches the error, judged by the finest.
 * *total: its time. */
static enum pell_result hierarchical(struct truths *b, double *total)
{
    static const char *const steps[] = { "density=0.4 error=0.2", "density=1.6 error=0.1", "density=6.4 error=0.05",
                                         "density=64 error=0.02" }; /* ten times longer */
    enum { STEPS = PELL_COUNT(steps) };
    struct shot shot[STEPS] = { { 0 } };
    double creation_ms[STEPS];
    int found = STEPS - 1;
    enum pell_result res = PELL_OK;

    for (int k = 0; k < STEPS && res == PELL_OK; k++)
        res = twice(b, "hierarchical", steps[k], &creation_ms[k], &shot[k]);
    for (int k = STEPS - 2; k >= 0 && res == PELL_OK; k--)
        if (error_against(&shot[k], &shot[STEPS - 1]) <= GOAL)
            found = k;
    for (int k = 0; k < STEPS && res == PELL_OK; k++) {
        char name[96];
        for (int part = 0; part < 2; part++) {
            struct row *r;
            snprintf(name, sizeof(name), "hierarchical %s, %.*s", part ? "query" : "build", (int) strcspn(steps[k], " "), steps[k]);
            r = add(b, name, part ? shot[k].ms : creation_ms[k], 0);
            if (k > 0) {
                const double before = part ? shot[k - 1].ms : creation_ms[k - 1];
                r->ratio = before > 0.0 ? r->ms / before : 0.0;
                r->against = k < STEPS - 1 ? "a quarter of the samples" : "a tenth of the samples";
            }
            if (part && k < STEPS - 1)
                r->error = error_against(&shot[k], &shot[STEPS - 1]);
        }
    }
    if (res == PELL_OK) {
        struct row *r = add(b, "hierarchical at 1 % error", *total = creation_ms[found] + shot[found].ms, 0);
        r->error = found < STEPS - 1 ? error_against(&shot[found], &shot[STEPS - 1]) : (double) NAN;
        r->ratio = (creation_ms[STEPS - 1] + shot[STEPS - 1].ms) / *total;
        r->against = "shorter than what it is judged by";
    }
    for (int k = 0; k < STEPS; k++)
        drop(&shot[k]);
    return res;
}

/* On a small image of few samples: the time of the large one at 1 % is extrapolated, as it is proportional to the pixels and to
 * 1/error^2. */
static enum pell_result dipole(struct truths *b, double hierarchical_ms, int64_t pixels)
{
    struct shot shot = { 0 }, truth = { 0 };
    char error[64], tenth[64];
    double e = 0.0, ms = 0.0;
    struct row *r;
    enum pell_result res;

    snprintf(error, sizeof(error), "error=%g most=100000000", DIPOLE_ERROR);
    snprintf(tenth, sizeof(tenth), "error=%g most=100000000", DIPOLE_ERROR / sqrt(13.0)); /* fixed costs are in both */
    PELL_TRY(bench_choose(b->bench, "dipole", tenth));
    PELL_TRY(shoot(b, 1, SMALL, SMALL, &truth));
    PELL_TRY(bench_choose(b->bench, "dipole", error));
    PELL_TRY(shoot(b, 0, SMALL, SMALL, &shot));
    e = error_against(&shot, &truth);
    r = add(b, "dipole, small picture", shot.ms, 0);
    r->error = e;
    r->ratio = truth.ms / fmax(shot.ms, 1e-9);
    r->against = "shorter than what it is judged by";
    ms = shot.ms * (e / GOAL) * (e / GOAL) * (double) pixels / (double) (b->pixels > 0 ? b->pixels : 1);
    b->pixels = pixels;
    r = add(b, "dipole at 1 % error, extrapolated", ms, 0);
    r->error = GOAL;
    r->ratio = ms / fmax(hierarchical_ms, 1e-9);
    r->against = "hierarchical at 1 % error";

fail:
    drop(&shot);
    drop(&truth);
    return res;
}

/* --- Paths -------------------------------------------------------------------------------------------------------------------------- */

struct noise {
    double creation_ms, frame_ms, variance;
    double product; /* of two images of independent noise, summed: the expected square of the light */
    int64_t rays;
};

static int by_work(const void *a, const void *b)
{
    const struct noise *x = a, *y = b;
    const double p = x->frame_ms * x->variance / x->product, q = y->frame_ms * y->variance / y->product;
    return (p > q) - (p < q);
}

static enum pell_result noise_once(struct truths *b, const char *knobs, int64_t seed, struct noise *n)
{
    struct shot shot = { 0 }, other = { 0 };
    enum pell_result res = bench_choose(b->bench, "path-trace", knobs);
    struct shot first = { 0 };

    memset(n, 0, sizeof(*n));
    if (res == PELL_OK)
        res = shoot(b, 2 * seed, b->bench->s.settings.width, b->bench->s.settings.height, &first);
    if (res == PELL_OK)
        res = shoot(b, 2 * seed, b->bench->s.settings.width, b->bench->s.settings.height, &shot);
    if (res == PELL_OK)
        res = shoot(b, 2 * seed + 1, b->bench->s.settings.width, b->bench->s.settings.height, &other);
    n->creation_ms = fmax(first.ms - shot.ms, 0.0);
    n->frame_ms = shot.ms;
    n->rays = shot.rays;
    for (size_t i = 0; res == PELL_OK && i < shot.size; i++) {
        const double difference = shot.light[i] - other.light[i];
        n->variance += 0.5 * difference * difference;
        n->product += shot.light[i] * other.light[i];
    }
    drop(&first);
    drop(&shot);
    drop(&other);
    return res;
}

/* The median of the repeats. */
static enum pell_result noise_of(struct truths *b, const char *knobs, struct noise *out)
{
    struct noise *all = calloc((size_t) b->bench->repeats, sizeof(*all));
    enum pell_result res = all ? PELL_OK : PELL_ERR_NOMEM;

    for (int i = 0; i < b->bench->repeats && res == PELL_OK; i++)
        res = noise_once(b, knobs, i, &all[i]);
    if (res == PELL_OK) {
        qsort(all, (size_t) b->bench->repeats, sizeof(*all), by_work);
        *out = all[b->bench->repeats / 2];
    }
    free(all);
    return res;
}

static enum pell_result paths(struct truths *b, const char *material, bool frame)
{
    char ours[32], brute[48], name[96];
    struct noise n[2];
    double work[2];
    enum pell_result res;

    snprintf(ours, sizeof(ours), "samples=%d", SAMPLES);
    snprintf(brute, sizeof(brute), "as=paper samples=%d", SAMPLES);
    PELL_TRY(noise_of(b, ours, &n[0]));
    PELL_TRY(noise_of(b, brute, &n[1]));
    snprintf(name, sizeof(name), "path-trace scene, %s", material);
    add(b, name, n[0].creation_ms, 0);
    for (int k = 0; k < 2; k++) {
        struct row *r;
        const double relative = n[k].variance / n[0].product; /* both show the same light, and ours has less noise */
        work[k] = 1e-3 * n[k].frame_ms * relative;
        snprintf(name, sizeof(name), "%s, %s", k ? "brute force" : "path-trace", material);
        r = add(b, name, n[k].frame_ms, n[k].rays);
        r->error = sqrt(fmax(relative, 0.0));
        r->work = work[k];
        if (k) {
            r->ratio = work[1] / work[0];
            r->against = "work of path-trace";
        }
    }
    if (frame)
        add(b, "frame", n[0].frame_ms, n[0].rays);
    return PELL_OK;

fail:
    return res;
}

/* Rays per second of plain walks, which trace all of their rays, next to the same rays by Embree alone, single or in packets, whichever
 * is faster. One thread. All times are the minimum of a few. */
static enum pell_result bare(struct truths *b)
{
    static volatile int64_t kept;
    struct pell_ray_record record = { .capacity = KEPT_RAYS };
    struct shot shot = { 0 };
    double walks = INFINITY, alone = INFINITY, count;
    struct row *r;
    enum pell_result res = PELL_ERR_NOMEM;

    record.rays = calloc(KEPT_RAYS, sizeof(*record.rays));
    record.occlusion = calloc(KEPT_RAYS, sizeof(*record.occlusion));
    if (!record.rays || !record.occlusion)
        goto fail;
    PELL_TRY(bench_choose(b->bench, "path-trace", "as=paper acceleration=lanes samples=4"));
    PELL_TRY(shoot(b, 0, b->bench->s.settings.width, b->bench->s.settings.height, &shot)); /* prepares the scene */
    drop(&shot);
    pell_renderer_record_rays(b->bench->s.renderer, &record);
    res = shoot(b, 0, b->bench->s.settings.width, b->bench->s.settings.height, &shot);
    pell_renderer_record_rays(b->bench->s.renderer, NULL);
    drop(&shot);
    PELL_TRY(res);
    count = (double) (record.count < record.capacity ? record.count : record.capacity);
    for (int i = 0; i < TRIES; i++) {
        PELL_TRY(shoot(b, 0, b->bench->s.settings.width, b->bench->s.settings.height, &shot));
        walks = fmin(walks, shot.ms);
        drop(&shot);
        for (int packets = 0; packets < 2; packets++) {
            const double begin = processor_ms();
            kept = pell_rays_trace_record(pell_renderer_services(b->bench->s.renderer)->rays, &record, packets != 0);
            alone = fmin(alone, processor_ms() - begin);
        }
    }
    add(b, "rays of plain walks, one thread", walks, (int64_t) record.count);
    r = add(b, "the same rays by Embree alone", alone * (double) record.count / fmax(count, 1.0), (int64_t) record.count);
    r->ratio = walks > 0.0 ? r->ms / walks : 0.0;
    r->against = "the walks' time: their rays a second";
    (void) kept;

fail:
    drop(&shot);
    free(record.rays);
    free(record.occlusion);
    return res;
}

/* --- The bench ----------------------------------------------------------------------------------------------------------------------- */

/* Replaces the material of the scene. PELL_OK, or the error that was reported. */
static enum pell_result reopen(struct truths *b, const char *material)
{
    static const enum pell_result results[] = { [EXIT_MEMORY] = PELL_ERR_NOMEM, [EXIT_INTERRUPTED] = PELL_ERR_CANCELLED };
    const enum exit_code code = bench_open(b->bench, material);

    return code == EXIT_OK ? PELL_OK : results[code] != PELL_OK ? results[code] : PELL_ERR_INVALID;
}

enum pell_result bench_truth(struct bench *bench)
{
    static const char *const materials[] = { "wholemilk", "marble", "skin1" };
    struct cli *cli = bench->cli;
    struct truths at = { .bench = bench }, *b = &at;
    const int threads = cli->numbers.threads;
    double hierarchical_ms = 0.0;
    enum pell_result res;

    if (!cli_given(cli, "--repeats"))
        bench->repeats = cli->numbers.repeats = 1;
    snprintf(bench->setup, sizeof(bench->setup),
             "%d x %d; milliseconds of processor time, of all threads together; error: root mean square, relative,\n"
             "of the subsurface light; work: seconds times relative variance, %d samples a pixel",
             bench->s.settings.width, bench->s.settings.height, SAMPLES);
    PELL_TRY(make_source_small(b));
    PELL_TRY(hierarchical(b, &hierarchical_ms));
    PELL_TRY(dipole(b, hierarchical_ms, b->pixels));
    for (size_t i = 0; i < PELL_COUNT(materials); i++) {
        PELL_TRY(reopen(b, materials[i]));
        PELL_TRY(paths(b, materials[i], i == 0));
    }
    cli->numbers.threads = 1;
    PELL_TRY(reopen(b, materials[0]));
    PELL_TRY(bare(b));

fail:
    cli->numbers.threads = threads;
    return res;
}
