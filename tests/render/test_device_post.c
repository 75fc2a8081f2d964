/* SPDX-License-Identifier: MIT
 * test_device_post.c - depth of field, bloom and the tone curve on a Vulkan device equal the cpu's, each by itself and in whole frames.
 * Under the validation layer; skipped, by name, where there is no driver or no layer. */
#include "gpu_test.h"
#include "stage.h"

#include "math/lanes.h"
#include "render/engine.h"
#include "render/plane_buffers.h"
#include "render/post/device.h"
#include "vulkan/core.h"

#include <float.h>

struct device {
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_gpu *gpu;
    struct pell_pool *pool;
    struct pell_post_device *post;
};

static void device_start(struct device *d)
{
    memset(d, 0, sizeof(*d));
    d->ctx = gpu_context(NULL, &d->kept);
    d->gpu = gpu_opened(d->ctx);
    OK(pell_pool_create(d->ctx, 2, &d->pool));
    OK(pell_post_device_create(d->ctx, d->gpu, &d->post));
}

static void device_finish(struct device *d)
{
    pell_post_device_destroy(&d->post);
    pell_pool_destroy(&d->pool);
    gpu_finished(&d->ctx, &d->gpu, &d->kept);
}

/* Mean difference over the mean, of a rectangle of planes. */
static double difference(float *const *a, float *const *b, int planes, const struct pell_rect *r, ptrdiff_t stride)
{
    double sum = 0.0, mean_difference = 0.0;

    for (int c = 0; c < planes; c++)
        for (int y = r->y0; y < r->y1; y++)
            for (int x = r->x0; x < r->x1; x++) {
                sum += fabs((double) a[c][y * stride + x]);
                mean_difference += fabs((double) a[c][y * stride + x] - (double) b[c][y * stride + x]);
            }
    REQUIRE(sum > 0.0);
    return mean_difference / sum;
}

/* [0, 1) */
static float hash(int x, int y, int k)
{
    uint32_t h = (uint32_t) x * 0x8da6b343u ^ (uint32_t) y * 0xd8163841u ^ (uint32_t) k * 0xcb1ab31fu;

    h = (h ^ h >> 15) * 0x2c1b3c6du;
    h = (h ^ h >> 13) * 0x297a2d39u;
    return (float) (h >> 9) / (float) (1 << 23);
}

/* --- Depth of field ------------------------------------------------------------------------------------------------------------------ */

enum { SCRATCH = PELL_DOF_PLANES, OUT = 4 };

struct lens {
    struct pell_surface surface;
    float *scratch[SCRATCH], *cpu[OUT], *gpu[OUT], *tiles;
    struct pell_dof_params params;
};

static void lens_start(struct lens *l, struct pell_context *ctx, int width, int height, struct pell_rect rect, float scale)
{
    float **planes[SCRATCH + 2 * OUT];

    memset(l, 0, sizeof(*l));
    for (int i = 0; i < SCRATCH; i++)
        planes[i] = &l->scratch[i];
    for (int i = 0; i < OUT; i++) {
        planes[SCRATCH + i] = &l->cpu[i];
        planes[SCRATCH + OUT + i] = &l->gpu[i];
    }
    OK(pell_planes_allocate(ctx, width, height, planes, PELL_COUNT(planes)));
    OK(pell_surface_allocate(ctx, width, height, &l->surface));
    l->tiles = pell_calloc(ctx, pell_dof_tiles(width, height), sizeof(float));
    l->params = (struct pell_dof_params) { .surface = &l->surface, .rect = rect, .scale = scale, .focus = 100.0f };
}

static void lens_finish(struct lens *l, struct pell_context *ctx)
{
    pell_surface_finish(ctx, &l->surface);
    pell_free(ctx, l->scratch[0]);
    pell_free(ctx, l->tiles);
}

/* A sample: a near bar in front of a receding plane, highlights on both, and nothing at the sides. */
static void lens_picture(struct lens *l, int sample)
{
    struct pell_surface *s = &l->surface;
    const struct pell_rect r = l->params.rect;

    s->covered = r;
    for (int y = r.y0; y < r.y1; y++)
        for (int x = r.x0; x < r.x1; x++) {
            const ptrdiff_t at = y * s->stride + x;
            const bool bar = (x + y / 3 + sample) % 29 < 6, seen = bar || x < r.x1 - 9;
            s->material[at] = seen;
            s->depth[at] = bar ? 60.0f : 90.0f + 3.0f * (float) y;
            l->scratch[3][at] = seen ? 0.25f : 0.0f;
            for (int c = 0; c < 3; c++)
                l->scratch[c][at] = seen ? 0.25f * (hash(x, y, c + 3 * sample) + (hash(x, y, 99) > 0.99f ? 50.0f : 0.0f)) : 0.0f;
        }
}

static const struct {
    int width, height;
    struct pell_rect rect;
    float scale; /* 500: discs up to 3 px; 8000: cut */
} lenses[] = {
    { 97, 61, { 0, 0, 97, 61 }, 500.0f },       { 97, 61, { 13, 21, 90, 58 }, 2500.0f },
    { 150, 100, { 2, 35, 150, 100 }, 8000.0f }, { 33, 20, { 1, 1, 33, 19 }, 5.0f }, /* sharp */
    { 5, 3, { 0, 0, 5, 3 }, 4000.0f },
};

static void the_lens_is_the_cpus(void **state)
{
    struct device d;
    (void) state;

    device_start(&d);
    for (size_t i = 0; i < PELL_COUNT(lenses); i++) {
        struct pell_post_device_times t;
        float widest = 0.0f, on_device;
        double mean_difference, worst = 0.0;
        struct lens l;

        lens_start(&l, d.ctx, lenses[i].width, lenses[i].height, lenses[i].rect, lenses[i].scale);
        OK(pell_post_device_reserve(d.post, lenses[i].width, lenses[i].height, true, false));
        for (int sample = 0; sample < 3; sample++) {
            lens_picture(&l, sample);
            l.params.first = sample == 0;
            widest = fmaxf(widest, pell_dof_render(d.pool, &l.params, l.scratch, l.tiles, l.cpu));
            OK(pell_post_device_lens(d.post, d.pool, &l.params, l.scratch, &t));
            REQUIRE(t.run > 0.0 && t.run < 60.0 && t.upload > 0.0 && t.pack > 0.0 && t.bytes_down == 0);
            REQUIRE(t.bytes_up >= 20 * (int64_t) lenses[i].width * (lenses[i].rect.y1 - lenses[i].rect.y0) && t.bytes_run > t.bytes_up);
        }
        OK(pell_post_device_take_lens(d.post, d.pool, 1.0f, l.gpu, &on_device, &t));
        REQUIRE(t.download > 0.0 && t.bytes_down > 0 && t.bytes_up == 0);
        mean_difference = difference(l.cpu, l.gpu, OUT, &l.params.rect, l.surface.stride);
        for (int c = 0; c < OUT; c++)
            for (ptrdiff_t at = 0; at < l.surface.stride * l.surface.height; at++)
                worst = fmax(worst, fabs((double) l.cpu[c][at] - (double) l.gpu[c][at]));
        print_message("# lens %zu: discs up to %.1f px, mean difference %.2g, largest %.2g\n", i, (double) widest, mean_difference, worst);
        REQUIRE(mean_difference < 1e-6 && worst < 1e-3);
        REQUIRE(fabsf(widest - on_device) <= 1e-6f * widest);
        REQUIRE((i == 3) == (widest < PELL_LENS_SHARP) && (i != 2 || widest > PELL_DOF_MOST));
        lens_finish(&l, d.ctx);
    }
    device_finish(&d);
}

/* Pixels outside the rectangle are kept, and the sum is scaled as requested. */
static void the_rest_of_the_picture_is_left_alone(void **state)
{
    struct pell_post_device_times t;
    struct device d;
    struct lens l;
    float widest;
    (void) state;

    device_start(&d);
    lens_start(&l, d.ctx, 97, 61, (struct pell_rect) { 13, 21, 90, 58 }, 500.0f);
    OK(pell_post_device_reserve(d.post, 97, 61, true, false));
    lens_picture(&l, 0);
    l.params.first = true;
    OK(pell_post_device_lens(d.post, d.pool, &l.params, l.scratch, &t));
    for (int c = 0; c < OUT; c++)
        for (ptrdiff_t at = 0; at < l.surface.stride * 61; at++)
            l.gpu[c][at] = -1.0f;
    OK(pell_post_device_take_lens(d.post, d.pool, 1.0f, l.cpu, &widest, &t));
    OK(pell_post_device_take_lens(d.post, d.pool, 4.0f, l.gpu, &widest, &t));
    for (int c = 0; c < OUT; c++)
        for (int y = 0; y < 61; y++)
            for (int x = 0; x < 97; x++) {
                const ptrdiff_t at = y * l.surface.stride + x;
                const bool inside = x >= 13 && x < 90 && y >= 21 && y < 58;
                REQUIRE(l.gpu[c][at] == (inside ? 4.0f * l.cpu[c][at] : -1.0f));
            }
    l.params.rect = (struct pell_rect) { 0 }; /* nothing is in view */
    OK(pell_post_device_lens(d.post, d.pool, &l.params, l.scratch, &t));
    OK(pell_post_device_take_lens(d.post, d.pool, 1.0f, l.gpu, &widest, &t));
    REQUIRE(widest == 0.0f && t.bytes_down == 0);
    lens_finish(&l, d.ctx);
    device_finish(&d);
}

/* --- Bloom and the tone curve -------------------------------------------------------------------------------------------------------- */

enum { PICTURE = 4, GLOW = PELL_BLOOM_PLANES };

struct picture {
    struct pell_bloom_params params;
    float *cpu[PICTURE], *gpu[PICTURE], *shown[3], *shown_gpu[3], *glow[GLOW];
};

static void picture_start(struct picture *p, struct pell_context *ctx, int width, int height, float sigma)
{
    float **planes[2 * PICTURE + 6 + GLOW];
    int n = 0;

    memset(p, 0, sizeof(*p));
    for (int i = 0; i < PICTURE; i++) {
        planes[n++] = &p->cpu[i];
        planes[n++] = &p->gpu[i];
    }
    for (int i = 0; i < 3; i++) {
        planes[n++] = &p->shown[i];
        planes[n++] = &p->shown_gpu[i];
        planes[n++] = &p->glow[i];
    }
    OK(pell_planes_allocate(ctx, width, height, planes, (size_t) n));
    p->params = (struct pell_bloom_params) { width, height, pell_plane_stride(width), 0.3f, sigma };
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            for (int c = 0; c < PICTURE; c++) {
                const float a = x < width / 3 ? 0.0f : x < width / 2 ? 0.5f : 1.0f, light = hash(x, y, 9) > 0.995f ? 40.0f : 0.4f;
                p->cpu[c][y * p->params.stride + x] = p->gpu[c][y * p->params.stride + x] = c == 3 ? a : a * light * hash(x, y, c);
            }
}

static const struct {
    int width, height;
    float sigma;
    size_t planes;
    struct pell_post_tone tone;
} blooms[] = {
    { 121, 75, 6.0f, 3, { .exposure = 1.5f, .min_alpha = FLT_MAX, .curve = 1.0f, .white_scale = 0.1f } },
    { 121, 75, 25.0f, 4, { .exposure = 0.7f, .min_alpha = 0.0f, .curve = 1.0f, .white_scale = 0.02f } },
    { 64, 48, 1.5f, 4, { .exposure = 2.0f, .min_alpha = 0.0f, .filmic = true } },
    { 200, 33, 13.0f, 3, { .exposure = 1.0f, .min_alpha = FLT_MAX } },
    { 7, 3, 60.0f, 3, { .exposure = 1.0f, .min_alpha = FLT_MAX, .filmic = true } },
    { 1, 1, 0.0f, 3, { .exposure = 1.0f, .min_alpha = FLT_MAX, .curve = 1.0f } },
};

static void cpu_bloom(struct device *d, struct picture *p, size_t planes, const struct pell_post_tone *tone)
{
    const struct pell_post_kernels *k = pell_post_kernels_tables[pell_simd_best()];

    pell_bloom_render(d->pool, &p->params, p->cpu, planes, p->glow);
    for (int y = 0; y < p->params.height; y++) {
        const ptrdiff_t at = y * p->params.stride;
        k->finish(tone, p->params.width, (float *const[]) { p->cpu[0] + at, p->cpu[1] + at, p->cpu[2] + at }, p->cpu[3] + at,
                  (float *const[]) { p->shown[0] + at, p->shown[1] + at, p->shown[2] + at });
    }
}

static void bloom_is_the_cpus(void **state)
{
    struct device d;
    (void) state;

    device_start(&d);
    for (size_t i = 0; i < PELL_COUNT(blooms); i++) {
        const struct pell_rect all = { 0, 0, blooms[i].width, blooms[i].height };
        struct pell_post_device_times t;
        double light, shown, before = 0.0, after = 0.0;
        struct picture p;

        picture_start(&p, d.ctx, blooms[i].width, blooms[i].height, blooms[i].sigma);
        for (ptrdiff_t at = 0; at < p.params.stride * p.params.height; at++)
            before += (double) p.gpu[1][at];
        OK(pell_post_device_reserve(d.post, blooms[i].width, blooms[i].height, false, true));
        cpu_bloom(&d, &p, blooms[i].planes, &blooms[i].tone);
        OK(pell_post_device_bloom(d.post, d.pool, &p.params, &blooms[i].tone, p.gpu, blooms[i].planes, p.shown_gpu, &t));
        light = difference(p.cpu, p.gpu, (int) blooms[i].planes, &all, p.params.stride);
        shown = difference(p.shown, p.shown_gpu, 3, &all, p.params.stride);
        for (ptrdiff_t at = 0; at < p.params.stride * p.params.height; at++)
            after += (double) p.gpu[1][at];
        print_message("# bloom %zu: mean difference %.2g, shown %.2g; light kept to %.2g\n", i, light, shown, fabs(after / before - 1.0));
        REQUIRE(light < 1e-6 && shown < 1e-6);
        REQUIRE(fabs(after / before - 1.0) <
                0.05); /* mirrored edges of sizes that f does not divide conserve light up to a fraction of a cell */
        REQUIRE(t.pack > 0.0 && t.upload > 0.0 && t.run > 0.0 && t.download > 0.0 && t.unpack > 0.0 && t.run < 60.0);
        REQUIRE(t.bytes_up >= t.bytes_run / 100 && t.bytes_down > t.bytes_run / 100 && t.bytes_run > 0);
        pell_free(d.ctx, p.cpu[0]);
    }
    device_finish(&d);
}

/* --- Features that the device lacks, and failures ------------------------------------------------------------------------------------- */

static void pictures_that_no_buffer_holds_are_refused(void **state)
{
    struct device d;
    (void) state;

    device_start(&d);
    OK(pell_post_device_reserve(d.post, 65536, 65536, true, true));
    assert_string_equal(pell_post_device_refuses_lens(d.post), "depth of field by the cpu: more pixels than a buffer holds");
    assert_string_equal(pell_post_device_refuses_bloom(d.post), "bloom by the cpu: more pixels than a buffer holds");
    assert_true(pell_gpu_memory_used(d.gpu) == 0);
    OK(pell_post_device_reserve(d.post, 64, 64, true, true));
    assert_null(pell_post_device_refuses_lens(d.post));
    assert_null(pell_post_device_refuses_bloom(d.post));
    assert_true(pell_gpu_memory_used(d.gpu) > 0);
    pell_post_device_drop(d.post);
    assert_true(pell_gpu_memory_used(d.gpu) == 0);
    device_finish(&d);
}

/* Both stages with all features, on a new device. */
static enum pell_result do_all(struct device *d, struct lens *l, struct picture *p)
{
    struct pell_post_device_times t;
    float widest;
    enum pell_result res;

    PELL_TRY(pell_post_device_create(d->ctx, d->gpu, &d->post));
    PELL_TRY(pell_post_device_reserve(d->post, 97, 61, true, false));
    PELL_TRY(pell_post_device_reserve(d->post, 97, 61, false, true));
    PELL_TRY(pell_post_device_lens(d->post, d->pool, &l->params, l->scratch, &t));
    PELL_TRY(pell_post_device_take_lens(d->post, d->pool, 1.0f, l->gpu, &widest, &t));
    return pell_post_device_bloom(d->post, d->pool, &p->params, &blooms[1].tone, p->gpu, 4, p->shown_gpu, &t);

fail:
    return res;
}

/* Each Vulkan call fails once: it is reported once, nothing remains on the device, and a retry succeeds. */
static void calls_that_fail_leave_nothing(void **state)
{
    struct device d;
    struct lens l;
    struct picture p;
    int failed = 0;
    (void) state;

    device_start(&d);
    pell_post_device_destroy(&d.post);
    lens_start(&l, d.ctx, 97, 61, (struct pell_rect) { 13, 21, 90, 58 }, 500.0f);
    lens_picture(&l, 0);
    l.params.first = true;
    picture_start(&p, d.ctx, 97, 61, 6.0f);
    for (uint64_t n = 1; failed == (int) n - 1; n++) {
        enum pell_result res;
        pell_gpu_fail_at(d.gpu, n);
        res = do_all(&d, &l, &p);
        pell_gpu_fail_at(d.gpu, 0);
        REQUIRE(res == PELL_OK ? d.kept.errors == 0 : res == PELL_ERR_NOMEM && d.kept.errors == 1);
        failed += res != PELL_OK;
        d.kept.errors = 0;
        pell_post_device_destroy(&d.post);
        assert_true(pell_gpu_memory_used(d.gpu) == 0);
    }
    print_message("# %d calls\n", failed);
    REQUIRE(failed > 80);
    pell_dof_render(d.pool, &l.params, l.scratch, l.tiles, l.cpu);
    OK(do_all(&d, &l, &p));
    REQUIRE(difference(l.cpu, l.gpu, OUT, &l.params.rect, l.surface.stride) < 1e-6);
    lens_finish(&l, d.ctx);
    pell_free(d.ctx, p.cpu[0]);
    device_finish(&d);
}

/* The same for host allocations. */
static void allocations_that_fail_leave_nothing(void **state)
{
    struct pell_alloc_fault fault = { 0 };
    struct device d = { .post = NULL };
    bool done = false;
    uint64_t n = 0;
    (void) state;

    d.ctx = gpu_context(&fault, &d.kept);
    d.gpu = gpu_opened(d.ctx);
    OK(pell_pool_create(d.ctx, 2, &d.pool));
    while (!done) {
        fault.fail_at = atomic_load(&fault.calls) + ++n;
        done = pell_post_device_create(d.ctx, d.gpu, &d.post) == PELL_OK && pell_post_device_reserve(d.post, 64, 64, true, true) == PELL_OK;
        fault.fail_at = 0;
        pell_post_device_destroy(&d.post);
        assert_true(pell_gpu_memory_used(d.gpu) == 0);
    }
    REQUIRE(n > 15);
    d.kept.errors = 0;
    device_finish(&d);
}

/* --- Whole frames -------------------------------------------------------------------------------------------------------------------- */

static void start_on(struct stage *s, bool vulkan, int width, int height)
{
    size_t ball, box;

    stage_start(s, width, height);
    if (vulkan) {
        pell_renderer_destroy(&s->r);
        pell_device_destroy(&s->device);
        OK(pell_device_create_vulkan(s->ctx, 2, &validated_gpu, &s->device));
        OK(pell_renderer_create(s->device, &s->r));
    }
    stage_gaussians(s, 0.5, &ball);
    stage_medium(s, "marble", &box);
    stage_ball(s, ball, 0, vec3(0, 0, 10), 12.0f, 24);
    stage_box(s, box, 1, vec3(-30, -30, -40), vec3(30, 30, -14));
    stage_light(s, PELL_LIGHT_SPOT, vec3(40, 30, 60), vec3(0, 0, 0), 0.3f);
    stage_camera(s, vec3(25, 20, 90), vec3(0, 0, 10), 0.5f, 0.0f);
    s->scene->cameras[0].f_number = 1.4f;
    s->settings.msaa = 5;
    s->settings.exposure = s->settings.white = 0.0f; /* metered on the image that was copied back */
}

static const struct pell_stage_time *row(const struct stage *s, const char *name)
{
    for (size_t i = 0; i < s->image.num_stages; i++)
        if (strcmp(s->image.stages[i].name, name) == 0)
            return &s->image.stages[i];
    return NULL;
}

static void render(struct stage *s)
{
    if (!s->set) {
        stage_complete(s);
        OK(pell_renderer_set_scene(s->r, s->scene));
        s->set = true;
        stage_method(s, "screen-space", NULL);
    }
    OK(pell_renderer_render(s->r, &s->settings, &s->image));
}

static const struct {
    const char *name;
    bool dof;
    float bloom;
    enum pell_background background;
    int tonemap;
} frames[] = {
    { "depth of field", true, 0.0f, PELL_BACKGROUND_COLOR, PELL_TONEMAP_REINHARD },
    { "bloom", false, 0.3f, PELL_BACKGROUND_COLOR, PELL_TONEMAP_FILMIC },
    { "both, transparent", true, 0.3f, PELL_BACKGROUND_TRANSPARENT, PELL_TONEMAP_REINHARD },
    { "none of them", false, 0.0f, PELL_BACKGROUND_COLOR, PELL_TONEMAP_REINHARD },
    { "both, environment", true, 0.1f, PELL_BACKGROUND_ENVIRONMENT, PELL_TONEMAP_REINHARD },
};

static void frames_end_as_the_cpus_do(void **state)
{
    struct stage s[2];
    (void) state;

    skip_without_gpu();
    for (int i = 0; i < 2; i++)
        start_on(&s[i], i == 1, 120, 80);
    for (size_t k = SLOW ? PELL_COUNT(frames) - 1 : 0; k < PELL_COUNT(frames); k++) { /* the last has all features */
        const struct pell_rect all = { 0, 0, 120, 80 };
        const struct pell_stage_time *lens, *bloom, *up;
        double shown, alpha, light;

        for (int i = 0; i < 2; i++) {
            s[i].settings.dof = frames[k].dof;
            s[i].settings.bloom = frames[k].bloom;
            s[i].settings.tonemap = frames[k].tonemap;
            s[i].scene->background = frames[k].background;
            render(&s[i]);
        }
        assert_int_equal(s[0].image.stride, s[1].image.stride);
        shown = difference((float *const *) s[0].image.display, (float *const *) s[1].image.display, 3, &all, s[0].image.stride);
        alpha = difference((float *const[]) { (float *) s[0].image.alpha }, (float *const[]) { (float *) s[1].image.alpha }, 1, &all,
                           s[0].image.stride);
        light = difference((float *const[]) { (float *) s[0].image.channels[0].data, (float *) s[0].image.channels[1].data },
                           (float *const[]) { (float *) s[1].image.channels[0].data, (float *) s[1].image.channels[1].data }, 2, &all,
                           s[0].image.stride);
        print_message("# %s: mean difference of what is shown %.2g, of light %.2g, of alpha %.2g; exposure %.6g and %.6g\n", frames[k].name,
                      shown, light, alpha, (double) s[0].image.exposure, (double) s[1].image.exposure);
        REQUIRE(shown < 1e-5 && light < 1e-5 && alpha < 1e-6);
        REQUIRE(fabsf(s[0].image.exposure / s[1].image.exposure - 1.0f) < 1e-5f);
        lens = row(&s[1], "depth of field");
        bloom = row(&s[1], "bloom");
        REQUIRE(!lens == !frames[k].dof && !bloom == (frames[k].bloom == 0.0f));
        for (int i = 0; i < 2; i++) {
            REQUIRE(!row(&s[i], "lens download") == !(i == 1 && frames[k].dof));
            REQUIRE(!row(&s[i], "bloom unpack") == !(i == 1 && frames[k].bloom > 0.0f));
        }
        assert_null(row(&s[1], "lens upload")); /* samples are computed there */
        REQUIRE(!lens || (lens->bytes > 2 * 20 * 5 * 1000 && lens->ms > 0.0f));
        up = row(&s[1], "bloom upload");
        REQUIRE(!bloom || (up->bytes > 2 * 12 * 120 * 80 && bloom->bytes > up->bytes && bloom->ms > 0.0f));
    }
    for (int i = 0; i < 2; i++) {
        pell_renderer_destroy(&s[i].r);
        pell_device_destroy(&s[i].device);
        REQUIRE(s[i].kept.errors == 0);
        stage_finish(&s[i]);
    }
}

/* The display values of a frame, with or without depth of field: a plane of 60 x 40; free() it. */
static float *shown_of(struct stage *s, bool dof)
{
    float *shown = malloc(60 * 40 * sizeof(float));

    s->settings.dof = dof;
    render(s);
    for (int y = 0; y < 40; y++)
        memcpy(shown + 60 * y, s->image.display[1] + y * s->image.stride, 60 * sizeof(float));
    return shown;
}

/* A failing call ends only its own frame: partial sums do not leak into the next frame. */
static void frames_whose_calls_fail_are_reported(void **state)
{
    struct stage s;
    int failed = 0;
    float *good[2], *again;
    (void) state;

    skip_without_gpu();
    start_on(&s, true, 60, 40);
    s.settings.bloom = 0.2f;
    s.settings.msaa = 2;
    s.settings.exposure = 1.0f;
    for (int dof = 0; dof < 2; dof++)
        good[dof] = shown_of(&s, dof);
    REQUIRE(memcmp(good[0], good[1], 60 * 40 * sizeof(float)) != 0);
    for (uint64_t n = 1; failed == (int) n - 1; n++) {
        enum pell_result res;
        pell_gpu_fail_at(s.device->gpu, n);
        res = pell_renderer_render(s.r, &s.settings, &s.image);
        pell_gpu_fail_at(s.device->gpu, 0);
        REQUIRE(res == PELL_OK ? s.kept.errors == 0 : res == PELL_ERR_NOMEM && s.kept.errors == 1);
        failed += res != PELL_OK;
        s.kept.errors = 0;
        if (n % 4 != 0)
            continue;
        again = shown_of(&s, n % 8 == 0);
        assert_memory_equal(again, good[n % 8 == 0], 60 * 40 * sizeof(float));
        free(again);
        s.settings.dof = true;
    }
    print_message("# %d calls\n", failed);
    REQUIRE(failed > 10);
    free(good[0]);
    free(good[1]);
    pell_renderer_destroy(&s.r);
    assert_true(pell_gpu_memory_used(s.device->gpu) == 0);
    pell_device_destroy(&s.device);
    stage_finish(&s);
}

/* The cpu computes what the buffers are too small for, as rows report: the image stays the same with smaller and smaller buffers. */
static void what_no_buffer_holds_is_the_cpus(void **state)
{
    static const char *const lens = "depth of field by the cpu: more pixels than a buffer holds";
    static const char *const bloom = "bloom by the cpu: more pixels than a buffer holds";
    const uint32_t plane = 64 * 40 * sizeof(float), sizes[] = { 5 * plane, 5 * plane - 1, 4 * plane, 4 * plane - 1 };
    float *cpu = NULL;
    (void) state;

    skip_without_gpu();
    for (size_t i = 0; i <= PELL_COUNT(sizes); i++) {
        struct stage s;
        float *shown;
        double mean_difference;

        start_on(&s, i > 0, 60, 40);
        if (i > 0)
            s.device->gpu->limits.maxStorageBufferRange = sizes[i - 1];
        s.settings.bloom = 0.2f;
        s.settings.msaa = 2;
        stage_complete(&s);
        OK(pell_renderer_set_scene(s.r, s.scene));
        s.set = true;
        stage_method(&s, "none", NULL); /* which has no buffers */
        shown = shown_of(&s, true);
        if (i > 0) {
            REQUIRE(!row(&s, lens) == (i < 2) && !row(&s, bloom) == (i < 4));
            REQUIRE(!row(&s, "lens download") == (i >= 2) && !row(&s, "bloom download") == (i >= 4));
            assert_non_null(row(&s, "direct light by the cpu: more triangles than a buffer holds"));
            mean_difference = difference(&cpu, &shown, 1, &(struct pell_rect) { 0, 0, 60, 40 }, 60);
            print_message("# buffers of %u bytes: mean difference %.2g\n", sizes[i - 1], mean_difference);
            REQUIRE(i < 4 ? mean_difference < 1e-6 : mean_difference == 0.0);
            free(shown);
        } else {
            cpu = shown;
        }
        pell_renderer_destroy(&s.r);
        pell_device_destroy(&s.device);
        REQUIRE(s.kept.errors == 0);
        stage_finish(&s);
    }
    free(cpu);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_lens_is_the_cpus),
        cmocka_unit_test(the_rest_of_the_picture_is_left_alone),
        cmocka_unit_test(bloom_is_the_cpus),
        cmocka_unit_test(pictures_that_no_buffer_holds_are_refused),
        cmocka_unit_test(calls_that_fail_leave_nothing),
        cmocka_unit_test(allocations_that_fail_leave_nothing),
        cmocka_unit_test(frames_end_as_the_cpus_do),
        cmocka_unit_test(frames_whose_calls_fail_are_reported),
        cmocka_unit_test(what_no_buffer_holds_is_the_cpus),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
