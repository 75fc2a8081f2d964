/* SPDX-License-Identifier: MIT
 *
 * adapt.c - adaptive number of samples per region of the image.
 *
 * With N samples the error of M decreases with 1/sqrt(N) or faster, in proportion to the standard deviation s of what samples find. For a
 * given total number of samples, the sum of squared errors over the image is smallest with N proportional to s. s^2 of a region is
 * estimated as the mean squared difference between the light of a pixel and that of pixels at two distances in the image: the median radius
 * of the profile, and IS_SECOND_DISTANCE times that; divided by the square of the fraction of those pixels on the same surface, because
 * fewer valid samples make a less certain mean. Regions are sorted into IS_CLASSES classes by steps of log s^2, each class with twice the
 * samples of the previous one, such that the image takes at most `samples` times its pixels.
 *
 * Both engines choose the same classes: sums are of products, in one order, and everything else is integer arithmetic. Mirror: adapt.comp,
 * choose.comp.
 */
#include "methods/image_space/image_space.h"

#include "render/material_id.h"

/* Pixels that represent a region: every fourth pixel of every second row. */
#define FOR_SOME(x0, y0, x, y)                                                                                                             \
    for (int y = (y0); y < (y0) + IS_REGION_Y; y += 2)                                                                                     \
        for (int x = (x0) + (y & 2); x < (x0) + IS_REGION_X; x += 4)

/* The material + 1 of a pixel, 0: none. */
static int material_at(const struct pell_frame *in, int x, int y)
{
    const bool inside = x >= in->rect.x0 && x < in->rect.x1 && y >= in->rect.y0 && y < in->rect.y1;
    return inside ? pell_material_id(in, y * in->shape.stride + x) : 0;
}

static float depth_at(const struct pell_frame *in, ptrdiff_t at)
{
    const float z = in->depth[at];
    return z > 1e-30f && z < 1e30f ? z : 1.0f;
}

static float strength_at(const struct pell_frame *in, ptrdiff_t at)
{
    const float s = in->strength ? in->strength[at] : 1.0f, low = s < 1.0f ? s : 1.0f;
    return low > 0.0f ? low : 0.0f;
}

/* Sums over these pixels: number, depths, median radii in mm. */
struct region_sums {
    int count;
    float depth, median;
};

static struct region_sums sum_region(const struct is_work *w, int x0, int y0)
{
    const struct pell_frame *in = w->in;
    struct region_sums s = { 0 };

    FOR_SOME(x0, y0, x, y)
    {
        const int m = material_at(in, x, y);
        const ptrdiff_t at = y * in->shape.stride + x;
        if (!m)
            continue;
        s.count++;
        s.depth += in->shape.orthographic ? 1.0f : depth_at(in, at);
        s.median += w->sets[m - 1].median * strength_at(in, at);
    }
    return s;
}

/* log2 of a positive float in units of 1/2^23, linear between powers of two. */
static int log_of(float x)
{
    return pell_float_bits(x);
}

/* Adds the squared differences to pixels on the same surface px away; returns their number. */
static int compare(const struct is_work *w, const struct region_sums *s, int x, int y, int px, float near, float *sum)
{
    static const int step_dir[4][2] = { { 1, 0 }, { -1, 0 }, { 0, 1 }, { 0, -1 } };
    const struct pell_frame *in = w->in;
    const ptrdiff_t at = y * in->shape.stride + x;
    const int m = material_at(in, x, y);
    float light[3], mean2;
    int found = 0;

    if (!m)
        return 0;
    for (int c = 0; c < 3; c++)
        light[c] = in->irradiance[c][at];
    mean2 = (light[0] * light[0] + light[1] * light[1] + light[2] * light[2]) * IS_DIFFERENCE_BIAS;
    for (int k = 0; k < 4; k++) {
        const int qx = x + step_dir[k][0] * px, qy = y + step_dir[k][1] * px;
        const ptrdiff_t to = qy * in->shape.stride + qx;
        float off, d[3];
        if (material_at(in, qx, qy) != m)
            continue;
        off = (depth_at(in, to) - depth_at(in, at)) * (float) s->count;
        if (!(off < near && -off < near))
            continue;
        for (int c = 0; c < 3; c++)
            d[c] = (in->irradiance[c][to] - light[c]) * w->sets[m - 1].scale[c];
        *sum += d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + mean2;
        found++;
    }
    return found;
}

static int step_of(const struct is_work *w, int x0, int y0)
{
    const struct region_sums s = sum_region(w, x0, y0);
    const float wide = w->focal_px * s.median, wide2 = wide * wide, deep2 = s.depth * s.depth, near = IS_NEAR * s.median;
    float sum = 0.0f;
    int px = 1, found = 0, log;

    if (s.count == 0)
        return 0;
    while (px < IS_MAX_DISTANCE && (float) px * s.depth < wide)
        px++;
    FOR_SOME(x0, y0, x, y)
    found += compare(w, &s, x, y, y & 2 ? IS_SECOND_DISTANCE * px : px, y & 2 ? IS_SECOND_DISTANCE * near : near, &sum);
    if (!(sum > 1e-30f && sum < 1e30f && wide2 > 1e-30f && wide2 < 1e30f && deep2 < 1e30f))
        return 0;
    log = log_of(sum) - log_of((float) found) + 2 * (log_of((float) (4 * s.count)) - log_of((float) found));
    log += log_of(wide2) - log_of(wide2 + 2.0f * deep2); /* reduced where the profile is narrower than a pixel */
    log = (log >> IS_STEP_SHIFT) + IS_STEP_OF_ONE;
    return log < 0 ? 0 : log < IS_STEPS ? log : IS_STEPS - 1;
}

static int translucent_in(const struct pell_frame *in, int x0, int y0)
{
    const struct pell_rect *r = &in->rect;
    const int from_y = y0 > r->y0 ? y0 : r->y0, to_y = y0 + IS_REGION_Y < r->y1 ? y0 + IS_REGION_Y : r->y1;
    const int from_x = x0 > r->x0 ? x0 : r->x0, to_x = x0 + IS_REGION_X < r->x1 ? x0 + IS_REGION_X : r->x1;
    int count = 0;

    for (int y = from_y; y < to_y; y++)
        for (int x = from_x; x < to_x; x++)
            count += pell_material_id(in, y * in->shape.stride + x) != 0;
    return count;
}

void is_adapt_row(const struct is_work *w, struct is_adapt *a, int ry)
{
    const struct pell_frame *in = w->in;

    for (int rx = in->rect.x0 / IS_REGION_X; rx * IS_REGION_X < in->rect.x1; rx++) {
        const int count = translucent_in(in, rx * IS_REGION_X, ry * IS_REGION_Y);
        a->count[ry * a->width + rx] = (uint8_t) count;
        a->step[ry * a->width + rx] = (uint16_t) (count > 0 ? step_of(w, rx * IS_REGION_X, ry * IS_REGION_Y) : 0);
    }
}

static int class_at(int step, int from)
{
    const int class = step < from ? 0 : (step - from) / IS_CLASS_STEPS;

    return class < IS_CLASSES ? class : IS_CLASSES - 1;
}

void is_adapt_choose(const struct is_work *w, struct is_adapt *a)
{
    const struct pell_rect *r = &w->in->rect;
    uint32_t pixels[IS_STEPS] = { 0 }, all = 0;
    int low = -IS_CLASSES * IS_CLASS_STEPS, high = IS_STEPS;

    for (int ry = r->y0 / IS_REGION_Y; ry * IS_REGION_Y < r->y1; ry++)
        for (int rx = r->x0 / IS_REGION_X; rx * IS_REGION_X < r->x1; rx++) {
            pixels[a->step[ry * a->width + rx]] += a->count[ry * a->width + rx];
            all += a->count[ry * a->width + rx];
        }
    while (low < high) { /* binary search for the first step of class 0: a lower one takes more samples */
        const int from = (low + high) >> 1;
        uint64_t samples = 0;
        for (int step = 0; step < IS_STEPS; step++)
            samples += (uint64_t) pixels[step] * (uint64_t) w->counts[class_at(step, from)].samples;
        if (samples <= (uint64_t) all * (uint64_t) w->counts[IS_CLASS_OF_ALL].samples)
            high = from;
        else
            low = from + 1;
    }
    for (int ry = r->y0 / IS_REGION_Y; ry * IS_REGION_Y < r->y1; ry++)
        for (int rx = r->x0 / IS_REGION_X; rx * IS_REGION_X < r->x1; rx++)
            a->classes[ry * a->width + rx] = (uint8_t) class_at(a->step[ry * a->width + rx], low);
}
