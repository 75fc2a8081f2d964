/* SPDX-License-Identifier: MIT
 * patch.h - hand-made frames for tests of methods: planes of floats for a surface given by a formula. */
#ifndef PELL_PATCH_H
#define PELL_PATCH_H

#include "pell_test.h"

#include <pellucid/method.h>
#include <pellucid/render.h>

struct patch {
    struct pell_frame frame;
    struct pell_frame_light out;
    float *memory;
    uint16_t *material;
    float *depth, *strength, *light[3], *normal[3], *position[3], *result[3];
};

/* Three channels of one Gaussian each: white, with a variance of v mm^2 times `channel`. */
static inline struct pell_frame_material patch_gaussians(int count, const double *variance, const double (*weight)[3])
{
    struct pell_frame_material m = { .name = "test", .medium = { .eta = 1.3 } };
    m.gaussians.count = count;
    for (int i = 0; i < count; i++) {
        m.gaussians.variance[i] = variance[i];
        for (int c = 0; c < 3; c++)
            m.gaussians.weight[i][c] = weight[i][c];
    }
    return m;
}

/* A facing surface at `depth` mm that fills the image, with uniform irradiance 1; materials are borrowed. `focal` as in struct
 * pell_frame. */
static inline struct patch *patch_create(int width, int height, bool orthographic, double focal, double depth,
                                         const struct pell_frame_material *materials, size_t num_materials)
{
    struct patch *p = calloc(1, sizeof(*p));
    const size_t stride = (size_t) width + 3, size = stride * (size_t) height; /* odd on purpose: any stride must work */
    float **const planes[] = { &p->depth,       &p->strength,  &p->light[0],  &p->light[1],    &p->light[2],
                               &p->normal[0],   &p->normal[1], &p->normal[2], &p->position[0], &p->position[1],
                               &p->position[2], &p->result[0], &p->result[1], &p->result[2] };

    p->memory = calloc(size * PELL_COUNT(planes) + 1, sizeof(float));
    p->material = calloc(size + 1, sizeof(*p->material));
    for (size_t i = 0; i < PELL_COUNT(planes); i++)
        *planes[i] = p->memory + i * size;
    p->frame = (struct pell_frame) {
        .shape = { .width = width,
                   .height = height,
                   .stride = (ptrdiff_t) stride,
                   .orthographic = orthographic,
                   .focal_px = (float) focal,
                   .object_height = 200.0f,
                   .materials = materials,
                   .num_materials = num_materials },
        .rect = { 0, 0, width, height },
        .material = p->material,
        .depth = p->depth,
        .strength = p->strength,
    };
    for (int c = 0; c < 3; c++) {
        p->frame.irradiance[c] = p->frame.shaded[c] = p->light[c];
        p->frame.normal[c] = p->normal[c];
        p->frame.position[c] = p->position[c];
        p->out.light[c] = p->result[c];
    }
    for (size_t i = 0; i < size; i++) {
        p->material[i] = 1;
        p->depth[i] = (float) depth;
        p->strength[i] = p->light[0][i] = p->light[1][i] = p->light[2][i] = 1.0f;
        p->normal[2][i] = -1.0f;
    }
    return p;
}

static inline void patch_destroy(struct patch *p)
{
    if (!p)
        return;
    free(p->memory);
    free(p->material);
    free(p);
}

static inline size_t patch_at(const struct patch *p, int x, int y)
{
    return (size_t) (y * p->frame.shape.stride + x);
}

/* Slopes of the rays through a pixel. */
static inline double patch_tan_x(const struct patch *p, double x)
{
    return p->frame.shape.orthographic ? 0.0 : (x + 0.5 - 0.5 * p->frame.shape.width) / (double) p->frame.shape.focal_px;
}

static inline double patch_tan_y(const struct patch *p, double y)
{
    return p->frame.shape.orthographic ? 0.0 : (y + 0.5 - 0.5 * p->frame.shape.height) / (double) p->frame.shape.focal_px;
}

/* Makes the surface the plane z = depth + slope_x X + slope_y Y, and fills normal and position. */
static inline void patch_tilt(struct patch *p, double depth, double slope_x, double slope_y)
{
    const double n = sqrt(1.0 + slope_x * slope_x + slope_y * slope_y);

    for (int y = 0; y < p->frame.shape.height; y++) {
        for (int x = 0; x < p->frame.shape.width; x++) {
            const size_t i = patch_at(p, x, y);
            const double f = (double) p->frame.shape.focal_px;
            const double X = (x + 0.5 - 0.5 * p->frame.shape.width) / f, Y = (y + 0.5 - 0.5 * p->frame.shape.height) / f;
            double z;
            if (p->frame.shape.orthographic) {
                z = depth + slope_x * X + slope_y * Y;
                p->position[0][i] = (float) X;
                p->position[1][i] = (float) Y;
            } else {
                z = depth / (1.0 - slope_x * X - slope_y * Y);
                p->position[0][i] = (float) (X * z);
                p->position[1][i] = (float) (Y * z);
            }
            p->depth[i] = p->position[2][i] = (float) z;
            p->normal[0][i] = (float) (slope_x / n);
            p->normal[1][i] = (float) (slope_y / n);
            p->normal[2][i] = (float) (-1.0 / n);
        }
    }
}

/* Irradiance 1 on the pixels from `half` on along an axis (0: x), 0 before. */
static inline void patch_light_half(struct patch *p, int axis, int half)
{
    for (int y = 0; y < p->frame.shape.height; y++)
        for (int x = 0; x < p->frame.shape.width; x++)
            for (int c = 0; c < 3; c++)
                p->light[c][patch_at(p, x, y)] = (axis ? y : x) >= half;
}

static inline void patch_light(struct patch *p, float r, float g, float b)
{
    const float rgb[3] = { r, g, b };

    for (size_t i = 0; i < (size_t) p->frame.shape.stride * (size_t) p->frame.shape.height; i++)
        for (int c = 0; c < 3; c++)
            p->light[c][i] = rgb[c];
}

/* A device with `threads` threads in a context of its own; `fault` and `kept` may be NULL. */
struct test_device {
    struct pell_context *ctx;
    struct pell_device *device;
};

static inline struct test_device test_device_create_on(enum pell_engine engine, int threads, struct pell_alloc_fault *fault,
                                                       struct kept_messages *kept)
{
    struct test_device at = { 0 };
    const struct pell_device_params params = { .threads = threads, .engine = engine };

    at.ctx = test_context(fault, kept);
    assert_non_null(at.ctx);
    assert_int_equal(pell_device_create(at.ctx, &params, &at.device), PELL_OK);
    return at;
}

static inline struct test_device test_device_create(int threads, struct pell_alloc_fault *fault, struct kept_messages *kept)
{
    return test_device_create_on(PELL_ENGINE_CPU, threads, fault, kept);
}

static inline void test_device_destroy(struct test_device *at)
{
    pell_device_destroy(&at->device);
    pell_context_destroy(&at->ctx);
}

/* Runs a method once, with knobs as "name=value" texts that end with NULL; `settings` may be NULL. */
static inline void patch_configure(struct pell_context *ctx, const struct pell_method *m, const char *const *settings, void *values)
{
    struct pell_setting list[16] = { { NULL, NULL, NULL } };
    char names[16][32];
    size_t n = 0;

    for (; settings && settings[n]; n++) {
        const char *equal = strchr(settings[n], '=');
        snprintf(names[n], sizeof(names[n]), "%.*s", (int) (equal - settings[n]), settings[n]);
        list[n] = (struct pell_setting) { names[n], equal + 1, "test" };
    }
    assert_int_equal(pell_method_configure(ctx, m, list, n, values), PELL_OK);
}

static inline struct pell_pass *patch_pass(const struct test_device *at, const struct pell_method *m, const char *const *settings,
                                           const struct patch *p)
{
    struct pell_pass *pass;
    void *values = calloc(1, m->knobs_size);

    patch_configure(at->ctx, m, settings, values);
    assert_int_equal(pell_pass_create(at->device, m, values, &p->frame.shape, &pass), PELL_OK);
    free(values);
    return pass;
}

static inline void patch_run(const struct test_device *at, const struct pell_method *m, const char *const *settings, struct patch *p)
{
    struct pell_pass *pass = patch_pass(at, m, settings, p);

    assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
    pell_pass_destroy(&pass);
}

/* Sum of a channel's output over the sum of its input, by pixels. */
static inline double patch_sum(const struct patch *p, float *const planes[3], int channel)
{
    double sum = 0.0;

    for (int y = 0; y < p->frame.shape.height; y++)
        for (int x = 0; x < p->frame.shape.width; x++)
            if (p->material[patch_at(p, x, y)])
                sum += (double) planes[channel][patch_at(p, x, y)];
    return sum;
}

#endif
