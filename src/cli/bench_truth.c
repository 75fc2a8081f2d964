/* SPDX-License-Identifier: MIT
 *
 * bench_truth.c - `pellucid bench truth`: what the references cost for what error, in one run.
 *
 * Milliseconds are of processor time, of all threads together: others on the machine then count less. Errors are of the subsurface light's
 * luminance at translucent pixels. Noise is measured by pairs of frames a, b of two seeds, which needs no error bar:
 *
 *     relative variance of a frame = Sum (a - b)^2 / 2  /  Sum a b        (the product has no noise squared in it)
 *
 * and times the seconds of a frame it does not hang on the number of samples: the lower, the sooner a picture is clean.
 */
#include "cli/bench.h"

#include "base/simd.h"
#include "render/renderer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum {
    SAMPLES = 4, /* a pixel, of path-trace */
    SMALL = 20,  /* pixels that the dipole's picture is wide */
    KEPT_RAYS = 1 << 21,
    TRIES = 3
};
#define DIPOLE_ERROR 0.04 /* that the dipole is run for; its time at 1 % follows from 1/sqrt(time) */
#define GOAL 0.01

struct truths {
    struct cli *cli;
    const char *path;
    struct session s;
    struct rows rows;
    double *ms; /* of each repeat */
    int repeats;
    int64_t pixels; /* translucent, of the last frame */
    int threads;
};

/* A frame's light. */
struct shot {
    double ms;     /* processor time */
    double *light; /* luminance; 0 where nothing is translucent */
    size_t size;
    int64_t rays; /* of path-trace */
};

static double processor_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e3 * (double) t.tv_sec + 1e-6 * (double) t.tv_nsec;
}

static void drop(struct shot *shot)
{
    free(shot->light);
    shot->light = NULL;
}

/* "density=4", ... up to NULL. */
static enum pell_result set_method(struct truths *b, const char *name, const char *const *knobs)
{
    const struct pell_method *m = pell_method_find(b->cli->ctx, "bench", name);
    struct pell_setting settings[8];
    char names[8][32];
    void *values = m ? calloc(1, m->knobs_size) : NULL;
    size_t n = 0;
    enum pell_result res = !m ? PELL_ERR_INVALID : !values ? PELL_ERR_NOMEM : PELL_OK;

    for (; res == PELL_OK && knobs[n]; n++) {
        const char *equals = strchr(knobs[n], '=');
        snprintf(names[n], sizeof(names[n]), "%.*s", (int) (equals - knobs[n]), knobs[n]);
        settings[n] = (struct pell_setting){ names[n], equals + 1, "bench" };
    }
    if (res == PELL_OK)
        res = pell_method_configure(b->cli->ctx, m, settings, n, values);
    if (res == PELL_OK)
        res = pell_renderer_set_method(b->s.renderer, m, values);
    free(values);
    return res;
}

static const struct pell_channel *channel(const struct pell_picture *p, const char *layer, char c)
{
    char name[64];

    snprintf(name, sizeof(name), "%s.%c", layer, c);
    for (size_t i = 0; i < p->num_channels; i++)
        if (strcmp(p->channels[i].name, name) == 0)
            return &p->channels[i];
    return NULL;
}

static enum pell_result shoot(struct truths *b, int64_t seed, int width, int height, struct shot *shot)
{
    static const double weight[3] = { 0.2126, 0.7152, 0.0722 };
    struct pell_settings settings = b->s.settings;
    struct pell_picture p;
    const struct pell_channel *mask;
    double begin;
    enum pell_result res;

    memset(shot, 0, sizeof(*shot));
    settings.seed = seed;
    settings.width = width;
    settings.height = height;
    settings.layers = true;
    begin = processor_ms();
    res = bench_frame(b->s.renderer, &settings, &p);
    shot->ms = processor_ms() - begin;
    cli_progress_end(b->cli);
    if (res != PELL_OK)
        return res;
    for (size_t i = 0; i < p.num_stages; i++)
        shot->rays += strcmp(p.stages[i].name, "path-trace") == 0 ? p.stages[i].rays : 0;
    shot->size = (size_t) width * (size_t) height;
    shot->light = calloc(shot->size, sizeof(*shot->light));
    mask = channel(&p, "translucent", 'Y');
    if (!shot->light || !mask)
        return PELL_ERR_NOMEM;
    b->pixels = 0;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            double *to = &shot->light[(size_t) y * (size_t) width + (size_t) x];
            if (mask->data[y * mask->stride + x] < 1.0f) /* wholly translucent pixels */
                continue;
            b->pixels++;
            for (size_t k = 0; k < PELL_COUNT(cli_subsurface_layers); k++)
                for (int c = 0; c < 3; c++) {
                    const struct pell_channel *part = channel(&p, cli_subsurface_layers[k], "RGB"[c]);
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
    struct row *r = bench_add(&b->rows, name, ms);
    static struct row none;

    if (!r)
        return &none;
    r->pixels = b->pixels;
    r->rays = rays;
    return r;
}

static enum exit_code open_session(struct truths *b, const char *material)
{
    session_close(&b->s);
    free(b->cli->material);
    b->cli->material = strdup(material);
    return b->cli->material ? session_open(b->cli, b->path, &b->s) : EXIT_MEMORY;
}

/* --- Diffusion ----------------------------------------------------------------------------------------------------------------------- */

/* One pass made and used, then used again: what making it costs is the difference. */
static enum pell_result twice(struct truths *b, const char *method, const char *const *knobs, double *made, struct shot *shot)
{
    struct shot first = { 0 };
    enum pell_result res = set_method(b, method, knobs);

    if (res == PELL_OK)
        res = shoot(b, 0, b->s.settings.width, b->s.settings.height, &first);
    if (res == PELL_OK)
        res = shoot(b, 0, b->s.settings.width, b->s.settings.height, shot);
    *made = fmax(first.ms - shot->ms, 0.0);
    drop(&first);
    return res;
}

/* A lamp that takes one ray: what is measured shall be of the integral over the surface, not of the lamp. */
static enum pell_result make_lamp_small(struct truths *b)
{
    struct pell_light *l = b->s.scene->num_lights > 0 ? &b->s.scene->lights[0] : NULL;

    if (l && l->type == PELL_LIGHT_RECT) {
        l->type = PELL_LIGHT_POINT;
        for (int c = 0; c < 3; c++)
            l->power[c] *= 1e-6f * l->width * l->height; /* of mm^2 in m^2, toward where it faced */
    }
    return pell_renderer_set_scene(b->s.renderer, b->s.scene);
}

/* `hierarchical` from coarse to fine: build and query as samples grow, and the first that has the error, judged by the finest. *total: its
 * time. */
static enum pell_result hierarchical(struct truths *b, double *total)
{
    static const char *const steps[][3] = { { "density=0.4", "error=0.2", NULL },
                                            { "density=1.6", "error=0.1", NULL },
                                            { "density=6.4", "error=0.05", NULL },
                                            { "density=64", "error=0.02", NULL } }; /* ten times longer */
    enum { STEPS = PELL_COUNT(steps) };
    struct shot shot[STEPS] = { { 0 } };
    double made[STEPS];
    int found = STEPS - 1;
    enum pell_result res = PELL_OK;

    for (int k = 0; k < STEPS && res == PELL_OK; k++)
        res = twice(b, "hierarchical", steps[k], &made[k], &shot[k]);
    for (int k = STEPS - 2; k >= 0 && res == PELL_OK; k--)
        if (error_against(&shot[k], &shot[STEPS - 1]) <= GOAL)
            found = k;
    for (int k = 0; k < STEPS && res == PELL_OK; k++) {
        char name[96];
        for (int part = 0; part < 2; part++) {
            struct row *r;
            snprintf(name, sizeof(name), "hierarchical %s, %s", part ? "query" : "build", steps[k][0]);
            r = add(b, name, part ? shot[k].ms : made[k], 0);
            if (k > 0) {
                const double before = part ? shot[k - 1].ms : made[k - 1];
                r->ratio = before > 0.0 ? r->ms / before : 0.0;
                r->against = k < STEPS - 1 ? "a quarter of the samples" : "a tenth of the samples";
            }
            if (part && k < STEPS - 1)
                r->error = error_against(&shot[k], &shot[STEPS - 1]);
        }
    }
    if (res == PELL_OK) {
        struct row *r = add(b, "hierarchical at 1 % error", *total = made[found] + shot[found].ms, 0);
        r->error = found < STEPS - 1 ? error_against(&shot[found], &shot[STEPS - 1]) : (double) NAN;
        r->ratio = (made[STEPS - 1] + shot[STEPS - 1].ms) / *total;
        r->against = "shorter than what it is judged by";
    }
    for (int k = 0; k < STEPS; k++)
        drop(&shot[k]);
    return res;
}

/* On a small picture of few samples: the time of the large one at 1 % follows, as it grows with the pixels and with 1/error^2. */
static enum pell_result dipole(struct truths *b, double hierarchical_ms, int64_t pixels)
{
    struct shot shot = { 0 }, truth = { 0 };
    char error[32], tenth[32];
    double e = 0.0, ms = 0.0;
    struct row *r;
    enum pell_result res;

    snprintf(error, sizeof(error), "error=%g", DIPOLE_ERROR);
    snprintf(tenth, sizeof(tenth), "error=%g", DIPOLE_ERROR / sqrt(13.0)); /* what does not hang on the error is in both times */
    PELL_TRY(set_method(b, "dipole", (const char *const[]){ tenth, "most=100000000", NULL }));
    PELL_TRY(shoot(b, 1, SMALL, SMALL, &truth));
    PELL_TRY(set_method(b, "dipole", (const char *const[]){ error, "most=100000000", NULL }));
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
    double made_ms, frame_ms, variance, square;
    int64_t rays;
};

static int by_work(const void *a, const void *b)
{
    const struct noise *x = a, *y = b;
    const double p = x->frame_ms * x->variance / x->square, q = y->frame_ms * y->variance / y->square;
    return (p > q) - (p < q);
}

static enum pell_result noise_once(struct truths *b, const char *const *knobs, int64_t seed, struct noise *n)
{
    struct shot shot = { 0 }, other = { 0 };
    enum pell_result res = set_method(b, "path-trace", knobs);
    struct shot first = { 0 };

    memset(n, 0, sizeof(*n));
    if (res == PELL_OK)
        res = shoot(b, 2 * seed, b->s.settings.width, b->s.settings.height, &first);
    if (res == PELL_OK)
        res = shoot(b, 2 * seed, b->s.settings.width, b->s.settings.height, &shot);
    if (res == PELL_OK)
        res = shoot(b, 2 * seed + 1, b->s.settings.width, b->s.settings.height, &other);
    n->made_ms = fmax(first.ms - shot.ms, 0.0);
    n->frame_ms = shot.ms;
    n->rays = shot.rays;
    for (size_t i = 0; res == PELL_OK && i < shot.size; i++) {
        const double apart = shot.light[i] - other.light[i];
        n->variance += 0.5 * apart * apart;
        n->square += shot.light[i] * other.light[i];
    }
    drop(&first);
    drop(&shot);
    drop(&other);
    return res;
}

/* The median of the repeats. */
static enum pell_result noise_of(struct truths *b, const char *const *knobs, struct noise *out)
{
    struct noise *all = calloc((size_t) b->repeats, sizeof(*all));
    enum pell_result res = all ? PELL_OK : PELL_ERR_NOMEM;

    for (int i = 0; i < b->repeats && res == PELL_OK; i++)
        res = noise_once(b, knobs, i, &all[i]);
    if (res == PELL_OK) {
        qsort(all, (size_t) b->repeats, sizeof(*all), by_work);
        *out = all[b->repeats / 2];
    }
    free(all);
    return res;
}

static enum pell_result paths(struct truths *b, const char *material, bool frame)
{
    char samples[32], name[96];
    const char *const ours[] = { samples, NULL };
    const char *const brute[] = { "as=paper", samples, NULL };
    struct noise n[2];
    double work[2];
    enum pell_result res;

    snprintf(samples, sizeof(samples), "samples=%d", SAMPLES);
    PELL_TRY(noise_of(b, ours, &n[0]));
    PELL_TRY(noise_of(b, brute, &n[1]));
    snprintf(name, sizeof(name), "path-trace scene, %s", material);
    add(b, name, n[0].made_ms, 0);
    for (int k = 0; k < 2; k++) {
        struct row *r;
        const double relative = n[k].variance / n[0].square; /* both show the same light, and ours knows it better */
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

/* Rays a second of plain walks, which trace all of their rays, beside the same rays by Embree alone, the faster of its ways: one by one, or
 * in packets. One thread. All times are the least of a few. */
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
    PELL_TRY(set_method(b, "path-trace", (const char *const[]){ "as=paper", "acceleration=lanes", "samples=4", NULL }));
    PELL_TRY(shoot(b, 0, b->s.settings.width, b->s.settings.height, &shot)); /* makes the scene */
    drop(&shot);
    pell_renderer_record_rays(b->s.renderer, &record);
    res = shoot(b, 0, b->s.settings.width, b->s.settings.height, &shot);
    pell_renderer_record_rays(b->s.renderer, NULL);
    drop(&shot);
    PELL_TRY(res);
    count = (double) (record.count < record.capacity ? record.count : record.capacity);
    for (int i = 0; i < TRIES; i++) {
        PELL_TRY(shoot(b, 0, b->s.settings.width, b->s.settings.height, &shot));
        walks = fmin(walks, shot.ms);
        drop(&shot);
        for (int packets = 0; packets < 2; packets++) {
            const double begin = processor_ms();
            kept = pell_rays_trace_record(pell_renderer_rays(b->s.renderer), &record, packets != 0);
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

static enum exit_code measure(struct truths *b)
{
    static const char *const materials[] = { "wholemilk", "marble", "skin1" };
    const int threads = b->cli->numbers.threads;
    double hierarchical_ms = 0.0;
    int64_t pixels;
    enum exit_code code = open_session(b, materials[0]);

    if (code == EXIT_OK)
        b->threads = pell_renderer_threads(b->s.renderer);
    if (code == EXIT_OK)
        code = cli_failed(b->cli, make_lamp_small(b));
    if (code == EXIT_OK)
        code = cli_failed(b->cli, hierarchical(b, &hierarchical_ms));
    pixels = b->pixels;
    if (code == EXIT_OK)
        code = cli_failed(b->cli, dipole(b, hierarchical_ms, pixels));
    for (size_t i = 0; i < PELL_COUNT(materials) && code == EXIT_OK; i++) {
        code = open_session(b, materials[i]);
        if (code == EXIT_OK)
            code = cli_failed(b->cli, paths(b, materials[i], i == 0));
    }
    b->cli->numbers.threads = 1;
    if (code == EXIT_OK)
        code = open_session(b, materials[0]);
    if (code == EXIT_OK)
        code = cli_failed(b->cli, bare(b));
    b->cli->numbers.threads = threads;
    return code;
}

static enum exit_code answer(struct truths *b, const char *what)
{
    struct cli *cli = b->cli;
    char device[160], build[64];

    cli_device_name(device, sizeof(device));
    snprintf(build, sizeof(build), "%s, SIMD level %s", pell_version(), pell_simd_name(pell_simd_best()));
    if (cli->json)
        return cli_print_json(cli,
                              json_pack("{s:s,s:s,s:s,s:i,s:s,s:i,s:i,s:i,s:s,s:o}", "bench", what, "engine", "cpu", "device", device,
                                        "threads", b->threads, "build", build, "width", b->s.settings.width, "height", b->s.settings.height,
                                        "repeats", b->repeats, "clock", "processor", "rows", bench_json(&b->rows)));
    printf("%s: %s\npellucid %s\n%d x %d, %d threads; milliseconds of processor time, of all threads together; error: root mean square, "
           "relative,\nof the subsurface light; work: seconds times relative variance, %d samples a pixel\n\n",
           what, device, build, b->s.settings.width, b->s.settings.height, b->threads, SAMPLES);
    printf("%-36s %10s %8s %10s %8s %9s  %s\n", "row", "ms", "pixels", "rays", "error %", "work", "ratio");
    for (size_t i = 0; i < b->rows.count; i++) {
        const struct row *r = &b->rows.items[i];
        printf("%-36s %10.1f %8lld ", r->name, r->ms, (long long) r->pixels);
        printf(r->rays ? "%10lld " : "%10.0lld ", (long long) r->rays);
        if (isfinite(r->error))
            printf("%8.2f ", 100.0 * r->error);
        else
            printf("%8s ", "");
        if (isfinite(r->work))
            printf("%9.3g  ", r->work);
        else
            printf("%9s  ", "");
        if (r->against && r->ratio > 0.0)
            printf("%.3g x %s", r->ratio, r->against);
        putchar('\n');
    }
    return EXIT_OK;
}

enum exit_code bench_truth(struct cli *cli, const char *what, const char *path)
{
    struct truths *b = calloc(1, sizeof(*b));
    enum exit_code code;

    if (!b)
        return EXIT_MEMORY;
    b->cli = cli;
    b->path = path;
    b->repeats = cli_given(cli, "--repeats") ? cli->numbers.repeats : 1;
    cli->allow_outside = true; /* its mesh is of a package of the system */
    cli->quiet = true;         /* of frames there is nothing to tell */
    code = measure(b);
    if (code == EXIT_OK)
        code = answer(b, what);
    session_close(&b->s);
    free(b);
    return code;
}
