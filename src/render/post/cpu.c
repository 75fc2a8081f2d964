/* SPDX-License-Identifier: MIT
 * cpu.c - see stage.h. */
#include "render/post/stage.h"

#include "image/color.h"
#include "render/post/kernel.h"

#include <float.h>
#include <string.h>

#define KEY 0.18                /* of a middle grey (Reinhard et al. 2002) */
#define ENVIRONMENT_WHITE 16.0f /* an environment behind the object may be brighter than the object by far */
#define LARGEST_WHITE 1e12f     /* of the setting */
#define NEGLIGIBLE 1e-27        /* mean irradiance, W/m^2, of which no pixel has a luminance that can be metered */
#define METER_FACTOR 3.0        /* largest exposure, as a multiple of that for KEY */
#define ASIDE 0.06f             /* weight of each neighbour along an axis in the pixel filter */
#define BRIGHT 0.01             /* fraction of the covered pixels that the default white leaves above it */

enum { SUM_LOG, COUNT, MAXIMUM, INVALID, PER_ROW };
enum {
    MAX_METERED = 1 << 16,
    BIN_SHIFT = 19,
    BINS = 1 << (31 - BIN_SHIFT)
}; /* at most so many pixels are metered, into 16 bins of luminance per octave */

struct task {
    const struct pell_post_params *p;
    float *const *color;
    float *alpha;
    float *const *display;
    const struct pell_post_kernels *kernels;
    float exposure, white, white_scale; /* 1 / white^2 */
    bool curve;
    struct pell_rect varied;          /* pixels whose background is looked up */
    struct pell_rect filtered;        /* pixels of the pixel filter */
    struct pell_post_tone tone, over; /* for pixels over a single colour; for pixels that are already composited */
};

static void measure_row(void *arg, int index, int worker)
{
    const struct task *t = arg;
    const struct pell_post_params *p = t->p;
    const int y = p->rect.y0 + index;
    const ptrdiff_t at = y * p->stride + p->rect.x0;
    float *const color[] = { t->color[0] + at, t->color[1] + at, t->color[2] + at };
    struct pell_post_measure m;
    (void) worker;

    t->kernels->measure(p->rect.x1 - p->rect.x0, color, t->alpha + at, &m);
    p->rows[y * PER_ROW + SUM_LOG] = m.sum_log;
    p->rows[y * PER_ROW + COUNT] = m.count;
    p->rows[y * PER_ROW + INVALID] = m.invalid;
    p->rows[y * PER_ROW + MAXIMUM] = m.maximum;
}

static float bin_edge(uint32_t bin)
{
    return pell_bits_float((int32_t) (bin << BIN_SHIFT));
}

/* Luminance that the fraction BRIGHT of the covered pixels exceeds, estimated on a regular grid; 0 if nothing is covered. */
static float bright_luminance(const struct task *t)
{
    const struct pell_rect r = t->p->rect;
    const double area = fmax(0.0, r.x1 - r.x0) * fmax(0.0, r.y1 - r.y0);
    const int step = 1 + (int) sqrt(area / MAX_METERED);
    uint32_t counts[BINS] = { 0 }, all = 0, above = 0, bin = BINS;
    float low, high;

    for (int y = r.y0; y < r.y1; y += step)
        for (int x = r.x0; x < r.x1; x += step) {
            const ptrdiff_t at = y * t->p->stride + x;
            const float a = t->alpha[at];
            const float l = PELL_LUMINANCE(t->color[0][at], t->color[1][at], t->color[2][at]) / a;
            if (!(a > 0.5f && l >= 0.0f && l <= FLT_MAX))
                continue;
            counts[(uint32_t) pell_float_bits(l) >> BIN_SHIFT & (BINS - 1)]++;
            all++;
        }
    while (bin > 0 && (double) above <= BRIGHT * all && above < all)
        above += counts[--bin];
    if (above == 0)
        return 0.0f;
    low = bin_edge(bin);
    high = bin_edge(bin + 1);
    return low + (high - low) * ((float) above - (float) BRIGHT * (float) all) / (float) counts[bin];
}

/* Radiance that the filmic curve shows as this colour: inverses of its parts, in reverse order. */
static void unexpose_filmic(const struct task *t, const float shown[3], float rgb[3])
{
    static const float from[3][3] = { { 0.64303825f, 0.31118675f, 0.04577546f },
                                      { 0.05926869f, 0.93143649f, 0.00929492f },
                                      { 0.0059619f, 0.06392902f, 0.93011838f } };
    static const float to[3][3] = { { 1.76474097f, -0.67577768f, -0.08896329f },
                                    { -0.14702785f, 1.16025151f, -0.01322366f },
                                    { -0.03633683f, -0.16243644f, 1.19877327f } };
    float before[3];

    for (int c = 0; c < 3; c++)
        before[c] = pell_filmic_inverse(fminf(from[c][0] * shown[0] + from[c][1] * shown[1] + from[c][2] * shown[2], 1.0f));
    for (int c = 0; c < 3; c++)
        rgb[c] = fmaxf(to[c][0] * before[0] + to[c][1] * before[1] + to[c][2] * before[2], 0.0f) / (PELL_FILMIC_SCALE * t->exposure);
}

/* The same for the selected curve. */
static void unexpose(const struct task *t, const float shown[3], float rgb[3])
{
    const float l = pell_luminance(shown), before = t->curve ? pell_tone_inverse(l, t->white_scale) : l;
    if (t->p->settings->tonemap == PELL_TONEMAP_FILMIC) {
        unexpose_filmic(t, shown, rgb);
        return;
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = l > 0.0f ? shown[c] * (before / l) / t->exposure : 0.0f;
}

/* Radiance of the environment at a pixel of a view; it is infinitely far away. Returns false if there is none. */
static bool environment_in(const struct task *t, const struct pell_view *view, int x, int y, float rgb[3])
{
    struct pell_vec3 start, direction;

    pell_view_ray(view, (float) x, (float) y, &start, &direction);
    return pell_lights_background(t->p->lights, vec3_normalize(direction), rgb);
}

/* The same through the lens. */
static bool environment(const struct task *t, int x, int y, float rgb[3])
{
    const int n = t->p->lens->radius > 0.0f ? t->p->settings->msaa : 1;

    if (n == 1)
        return environment_in(t, t->p->view, x, y, rgb);
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    for (int i = 0; i < n; i++) {
        struct pell_view view = *t->p->view;
        float radiance[3];
        pell_view_through(&view, t->p->lens, i, n);
        if (!environment_in(t, &view, x, y, radiance))
            return false;
        for (int c = 0; c < 3; c++)
            rgb[c] += radiance[c] / (float) n;
    }
    return true;
}

/* Radiance behind pixel (x, y) where it differs from pixel to pixel. */
static void background(const struct task *t, int x, int y, float rgb[3])
{
    const struct pell_scene *scene = t->p->scene;
    float shown[4];

    if (scene->background == PELL_BACKGROUND_COLOR) { /* only called with a contact shadow */
        struct pell_vec3 start, direction;
        float shade;
        pell_view_ray(t->p->view, (float) x, (float) y, &start, &direction);
        shade = pell_contact_shade(t->p->contact, start, direction);
        if (shade == 1.0f) {
            memcpy(rgb, t->tone.background, 3 * sizeof(*rgb));
            return;
        }
        for (int c = 0; c < 3; c++)
            shown[c] = shade * scene->background_color[c];
        unexpose(t, shown, rgb);
    } else if (scene->background == PELL_BACKGROUND_ENVIRONMENT) {
        if (!environment(t, x, y, rgb))
            unexpose(t, scene->background_color, rgb);
    } else {
        pell_image_sample(&scene->background_image->image, PELL_WRAP_CLAMP, PELL_WRAP_CLAMP, false,
                          ((float) x + 0.5f) / (float) t->p->width, ((float) y + 0.5f) / (float) t->p->height, shown);
        unexpose(t, shown, rgb);
    }
}

/* Tone maps a colour. */
static void show(const struct task *t, const float rgb[3], float shown[3])
{
    float color[3] = { rgb[0], rgb[1], rgb[2] };

    t->kernels->finish(&t->over, 1, (float *const[]) { &color[0], &color[1], &color[2] }, &(float) { 1.0f },
                       (float *const[]) { &shown[0], &shown[1], &shown[2] });
}

/* Finishes a partially covered pixel. Its foreground and background are tone mapped separately, then averaged: otherwise a rim far brighter
 * than white would be white as soon as it touches the pixel. */
static void blend(const struct task *t, ptrdiff_t at, const float background[3])
{
    const float a = t->alpha[at];
    float over[3], shown[2][3];

    for (int c = 0; c < 3; c++)
        over[c] = t->color[c][at] / a;
    show(t, over, shown[0]);
    show(t, background, shown[1]);
    for (int c = 0; c < 3; c++) {
        t->color[c][at] += (1.0f - a) * background[c];
        t->display[c][at] = a * shown[0][c] + (1.0f - a) * shown[1][c];
    }
}

static void finish_pixels(const struct task *t, const struct pell_post_tone *tone, ptrdiff_t at, int count)
{
    float *const color[] = { t->color[0] + at, t->color[1] + at, t->color[2] + at };
    float *const display[] = { t->display[0] + at, t->display[1] + at, t->display[2] + at };

    if (count > 0)
        t->kernels->finish(tone, count, color, t->alpha + at, display);
}

/* Composites pixels x0 to x1 of a row over a background that varies per pixel. */
static void finish_varied(const struct task *t, int y, int x0, int x1)
{
    const ptrdiff_t row = y * t->p->stride;
    int first = x0; /* first pixel that is not finished */

    for (int x = x0; x < x1; x++) {
        const float a = t->alpha[row + x];
        float rgb[3];
        if (!(a < 1.0f))
            continue;
        background(t, x, y, rgb);
        if (a > 0.0f) {
            finish_pixels(t, &t->over, row + first, x - first);
            blend(t, row + x, rgb);
            first = x + 1;
        } else {
            for (int c = 0; c < 3; c++)
                t->color[c][row + x] = rgb[c];
        }
    }
    finish_pixels(t, &t->over, row + first, x1 - first);
}

/* Finishes pixels x0 to x1 of a row, with a background that varies or does not. `covered`: something may cover them. */
static void finish_piece(const struct task *t, int y, int x0, int x1, bool varied, bool covered)
{
    const ptrdiff_t at = y * t->p->stride + x0;
    float *const color[] = { t->color[0] + at, t->color[1] + at, t->color[2] + at };
    float *const display[] = { t->display[0] + at, t->display[1] + at, t->display[2] + at };
    const struct pell_post_tone *tone = varied ? &t->over : &t->tone;

    if (x0 >= x1)
        return;
    if (!covered)
        t->kernels->empty(tone, x1 - x0, color, t->alpha + at, display);
    if (varied)
        finish_varied(t, y, x0, x1);
    else if (covered)
        finish_pixels(t, tone, at, x1 - x0);
}

static int clamp(int x, int least, int most)
{
    return x < least ? least : x > most ? most : x;
}

static void finish_span(const struct task *t, int y, int x0, int x1, bool covered)
{
    const struct pell_rect *v = &t->varied;
    const bool crossed = y >= v->y0 && y < v->y1;
    const int from = crossed ? clamp(v->x0, x0, x1) : x1, to = crossed ? clamp(v->x1, from, x1) : x1;

    finish_piece(t, y, x0, from, false, covered);
    finish_piece(t, y, from, to, true, covered);
    finish_piece(t, y, to, x1, false, covered);
}

static void finish_row(void *arg, int y, int worker)
{
    const struct task *t = arg;
    const struct pell_rect r = t->p->rect;
    (void) worker;

    if (y < r.y0 || y >= r.y1 || r.x0 >= r.x1) {
        finish_span(t, y, 0, t->p->width, false);
        return;
    }
    finish_span(t, y, 0, r.x0, false);
    finish_span(t, y, r.x0, r.x1, true);
    finish_span(t, y, r.x1, t->p->width, false);
}

static void show_row(void *arg, int y, int worker)
{
    const struct task *t = arg;
    const ptrdiff_t at = y * t->p->stride;
    float *const color[] = { t->color[0] + at, t->color[1] + at, t->color[2] + at };
    float *const display[] = { t->display[0] + at, t->display[1] + at, t->display[2] + at };
    (void) worker;

    t->kernels->finish(&t->over, t->p->width, color, t->alpha + at, display);
}

static enum pell_result bloom(struct pell_pool *pool, const struct task *t, struct pell_post_device_times *times)
{
    const struct pell_post_params *p = t->p;
    const struct pell_bloom_params params = { p->width, p->height, p->stride, p->settings->bloom,
                                              0.01f * p->settings->bloom_radius * (float) p->height };
    float *const planes[] = { t->color[0], t->color[1], t->color[2], t->alpha };
    const size_t count = p->scene->background == PELL_BACKGROUND_TRANSPARENT ? 4 : 3;

    if (p->device)
        return pell_post_device_bloom(p->device, pool, &params, &t->over, planes, count, t->display, times);
    pell_bloom_render(pool, &params, planes, count, p->bloom_scratch);
    pell_pool_run(pool, p->height, show_row, (void *) t);
    return PELL_OK;
}

/* --- The pixel filter ------------------------------------------------------------------------------------------------------------ */

/* Filters a displayed row along itself into scratch. */
static void filter_across(void *arg, int index, int worker)
{
    const struct task *t = arg;
    const struct pell_rect r = t->filtered;
    const ptrdiff_t row = (r.y0 + index) * t->p->stride;
    const int last = t->p->width - 1;
    (void) worker;

    for (int c = 0; c < 3; c++) {
        const float *in = t->display[c] + row;
        float *out = t->p->unfiltered[c] + row;
        const int from = r.x0 > 0 ? r.x0 : 1, to = r.x1 <= last ? r.x1 : last;
        if (to > from)
            t->kernels->blend(to - from, ASIDE, in + from - 1, in + from, in + from + 1, out + from);
        if (r.x0 == 0)
            t->kernels->blend(1, ASIDE, in, in, in + (last > 0), out);
        if (r.x1 > last && last > 0)
            t->kernels->blend(1, ASIDE, in + last - 1, in + last, in + last, out + last);
    }
}

/* Filters a row of scratch with those above and below into the displayed image. */
static void filter_down(void *arg, int index, int worker)
{
    const struct task *t = arg;
    const struct pell_rect r = t->filtered;
    const int y = r.y0 + index, above = y > r.y0 ? y - 1 : y, below = y < r.y1 - 1 ? y + 1 : y;
    (void) worker;

    for (int c = 0; c < 3; c++) {
        const float *in = t->p->unfiltered[c] + r.x0;
        t->kernels->blend(r.x1 - r.x0, ASIDE, in + above * t->p->stride, in + y * t->p->stride, in + below * t->p->stride,
                          t->display[c] + y * t->p->stride + r.x0);
    }
}

/* Filters covered pixels and a border of one: beyond there is a single colour. Otherwise filters everything, or the background would be
 * sharper next to the object than elsewhere. Colours under an alpha channel are not light that could be blended. */
static void filter_pixels(struct pell_pool *pool, struct task *t)
{
    const struct pell_post_params *p = t->p;
    struct pell_rect r = { 0, 0, p->width, p->height };

    if (p->settings->pixel_filter == PELL_PIXEL_FILTER_BOX || p->settings->msaa == 1 || p->scene->background == PELL_BACKGROUND_TRANSPARENT)
        return;
    if (t->tone.composites && p->settings->bloom == 0.0f && t->varied.x0 >= t->varied.x1) {
        r.x0 = p->rect.x0 > 0 ? p->rect.x0 - 1 : 0;
        r.y0 = p->rect.y0 > 0 ? p->rect.y0 - 1 : 0;
        r.x1 = p->rect.x1 < p->width ? p->rect.x1 + 1 : p->width;
        r.y1 = p->rect.y1 < p->height ? p->rect.y1 + 1 : p->height;
        if (p->rect.x0 >= p->rect.x1 || p->rect.y0 >= p->rect.y1)
            return;
    }
    t->filtered = r;
    pell_pool_run(pool, r.y1 - r.y0, filter_across, t);
    pell_pool_run(pool, r.y1 - r.y0, filter_down, t);
}

/* Bounds of the pixels whose background is looked up. */
static struct pell_rect varied_background(const struct task *t)
{
    const struct pell_scene *scene = t->p->scene;
    const struct pell_rect all = { 0, 0, t->p->width, t->p->height }, none = { 0 };

    switch (scene->background) {
    case PELL_BACKGROUND_ENVIRONMENT: return all;
    case PELL_BACKGROUND_IMAGE: return scene->background_image ? all : none;
    case PELL_BACKGROUND_COLOR: return t->p->contact ? pell_contact_rect(t->p->contact, t->p->view) : none;
    case PELL_BACKGROUND_TRANSPARENT: break;
    }
    return none;
}

/* Prepares the tone curves, and a background of one colour: its radiance, and its displayed colour. Others are looked up per pixel. */
static void prepare_background(struct task *t)
{
    const struct pell_scene *scene = t->p->scene;
    const bool transparent = scene->background == PELL_BACKGROUND_TRANSPARENT;
    const float curve = t->curve ? 1.0f : 0.0f;

    t->over = (struct pell_post_tone) { t->exposure, transparent ? 0.0f : FLT_MAX, curve, curve * t->white_scale,
                                        t->p->settings->tonemap == PELL_TONEMAP_FILMIC };
    t->tone = t->over;
    t->varied = varied_background(t);
    t->tone.composites = !transparent && scene->background != PELL_BACKGROUND_ENVIRONMENT && !scene->background_image;
    if (!t->tone.composites)
        return;
    t->tone.min_alpha = 0.0f; /* foreground and background are tone mapped separately */
    unexpose(t, scene->background_color, t->tone.background);
    show(t, t->tone.background, t->tone.shown);
}

enum pell_result pell_post_render(struct pell_pool *pool, const struct pell_post_params *params, float *const color[3], float *alpha,
                                  float *const display[3], struct pell_post_result *result)
{
    const struct pell_settings *settings = params->settings;
    struct task t = {
        .p = params,
        .color = color,
        .alpha = alpha,
        .display = display,
        .kernels = pell_post_kernels_tables[pell_simd_best()],
        .exposure = settings->exposure,
        .white = settings->white,
        .curve = settings->tonemap == PELL_TONEMAP_REINHARD,
    };
    const int y0 = params->rect.y0, y1 = params->rect.y1;
    double sum = 0.0, count = 0.0, invalid = 0.0, maximum = 0.0, arriving = 0.0, arriving_pixels = 0.0, start;
    float exposure;
    enum pell_result res = PELL_OK;

    if (y1 > y0)
        pell_pool_run(pool, y1 - y0, measure_row, &t);
    for (int y = y0; y < y1; y++) {
        arriving += params->meter[2 * y];
        arriving_pixels += params->meter[2 * y + 1];
        sum += params->rows[y * PER_ROW + SUM_LOG];
        count += params->rows[y * PER_ROW + COUNT];
        invalid += params->rows[y * PER_ROW + INVALID];
        maximum = fmax(maximum, params->rows[y * PER_ROW + MAXIMUM]);
    }
    if (!(t.exposure > 0.0f) && count > 0.0)
        t.exposure = (float) fmin(METER_FACTOR * KEY / exp(sum / count), arriving > 0.0 ? PELL_PI * arriving_pixels / arriving : INFINITY);
    if (!(t.exposure > 0.0f && t.exposure < 1e30f))
        t.exposure = 1.0f;
    exposure = t.exposure;
    t.exposure *= exp2f(settings->stops);
    if (!(t.white > 0.0f))
        t.white = fminf(
            fmaxf(bright_luminance(&t) * t.exposure, params->scene->background == PELL_BACKGROUND_ENVIRONMENT ? ENVIRONMENT_WHITE : 1.0f),
            LARGEST_WHITE);
    t.white_scale = 1.0f / (t.white * t.white);
    prepare_background(&t);
    pell_pool_run(pool, params->height, finish_row, &t);
    start = pell_seconds();
    *result = (struct pell_post_result) {
        .exposure = exposure,
        .white = t.white,
        .invalid = (int64_t) invalid,
        .covered = arriving_pixels > 0.0,
        .any_light = arriving > 0.0 || maximum > 0.0,
        .negligible = !(maximum > 0.0) && arriving < NEGLIGIBLE * arriving_pixels,
    };
    if (settings->bloom > 0.0f)
        res = bloom(pool, &t, &result->on_device);
    result->bloom = pell_seconds() - start;
    filter_pixels(pool, &t);
    return res;
}
