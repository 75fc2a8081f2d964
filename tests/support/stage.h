/* SPDX-License-Identifier: MIT
 * stage.h - for end-to-end tests of the renderer: small hand-made scenes, and copies of images to compare. */
#ifndef RENDER_STAGE_H
#define RENDER_STAGE_H

#include "shapes.h"
#include "slow.h"

#include <pellucid/render.h>

#define OK(expr) assert_int_equal(expr, PELL_OK)

struct stage {
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_scene *scene;
    struct pell_device *device;
    struct pell_renderer *r;
    struct pell_settings settings;
    struct pell_render_result image;
    bool set;      /* the renderer has the scene */
    bool borrowed; /* context and device belong to a struct stage_device */
};

/* A device for several stages, one after another: starting Vulkan and compiling its shaders takes longer than rendering a small image. */
struct stage_device {
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_device *device;
    pid_t owner; /* a child of fork() has none of its threads, and creates its own */
};

/* A copy of an image: planes without padding, the linear channels first, then the display's three. */
struct shot {
    int width, height;
    size_t planes, size;
    float *data;
    float exposure;
    int64_t invalid;
};

/* Number of planes of a shot without layers, and with. */
enum {
    SHOT_R,
    SHOT_G,
    SHOT_B,
    SHOT_A,
    SHOT_SHOWN,
    SHOT_MULTIPLE = 4,
    SHOT_TRANSMISSION = 7,
    SHOT_SPECULAR = 10,
    SHOT_IRRADIANCE = 13,
    SHOT_NORMAL = 16,
    SHOT_ALBEDO = 19,
    SHOT_DEPTH = 22,
    SHOT_TRANSLUCENT = 23,
    SHOT_SHOWN_LAYERS = 24
};

enum { STAGE_ENGINES = 4, STAGE_THREADS = 4 };

static inline struct stage_device *stage_devices(void)
{
    static struct stage_device devices[STAGE_ENGINES * STAGE_THREADS];

    return devices;
}

/* The device shared by a run; stage_finish_devices destroys it. */
static inline struct stage_device *stage_shared_device(enum pell_engine engine, int threads)
{
    const struct pell_device_params params = { .threads = threads, .engine = engine };
    struct stage_device *d = &stage_devices()[(int) engine * STAGE_THREADS + threads];

    REQUIRE((int) engine < STAGE_ENGINES && threads < STAGE_THREADS);
    if (d->device && d->owner == getpid())
        return d;
    memset(d, 0, sizeof(*d));
    d->owner = getpid();
    d->ctx = test_context(NULL, &d->kept);
    assert_non_null(d->ctx);
    OK(pell_device_create(d->ctx, &params, &d->device));
    return d;
}

static inline void stage_finish_devices(void)
{
    for (struct stage_device *d = stage_devices(); d < stage_devices() + STAGE_ENGINES * STAGE_THREADS; d++)
        if (d->owner == getpid()) {
            pell_device_destroy(&d->device);
            pell_context_destroy(&d->ctx);
        }
}

/* Scene, renderer and settings on the stage's context and device. */
static inline void stage_make(struct stage *s, int width, int height)
{
    OK(pell_scene_create(s->ctx, &s->scene));
    OK(pell_renderer_create(s->device, &s->r));
    pell_knobs_default(pell_settings_knobs(), &s->settings);
    s->settings.width = width;
    s->settings.height = height;
    s->settings.msaa = 1;
    s->settings.exposure = 1.0f;
    s->settings.bounces = 0;                            /* most tests look at direct light without interreflection, */
    s->settings.angles = s->settings.curvature = false; /* with unmodified profiles, */
    s->settings.profile = 1 + PELL_PROFILE_DIPOLE;      /* in closed form */
    s->settings.single_scattering = s->settings.opposed = s->settings.unscattered = false;
    s->scene->background_color[0] = s->scene->background_color[1] = s->scene->background_color[2] = 0.0f;
}

/* `fault` counts the context's allocations; may be NULL. */
static inline void stage_start_on(struct stage *s, enum pell_engine engine, int width, int height, int threads,
                                  struct pell_alloc_fault *fault)
{
    const struct pell_device_params params = { .threads = threads, .engine = engine };

    memset(s, 0, sizeof(*s));
    s->ctx = test_context(fault, &s->kept);
    assert_non_null(s->ctx);
    OK(pell_device_create(s->ctx, &params, &s->device));
    stage_make(s, width, height);
}

/* The device outlives the stage, and receives its messages. */
static inline void stage_start_borrowed(struct stage *s, const struct stage_device *device, int width, int height)
{
    memset(s, 0, sizeof(*s));
    s->borrowed = true;
    s->ctx = device->ctx;
    s->device = device->device;
    stage_make(s, width, height);
}

static inline void stage_start_threads(struct stage *s, int width, int height, int threads)
{
    stage_start_on(s, PELL_ENGINE_CPU, width, height, threads, NULL);
}

static inline void stage_start(struct stage *s, int width, int height)
{
    stage_start_threads(s, width, height, 2);
}

static inline void stage_finish(struct stage *s)
{
    pell_renderer_destroy(&s->r);
    if (!s->borrowed)
        pell_device_destroy(&s->device);
    pell_scene_destroy(&s->scene);
    if (!s->borrowed)
        pell_context_destroy(&s->ctx);
}

/* --- Materials: without a specular lobe unless a test adds one ------------------------------------------------------------------- */

static inline struct pell_material *stage_opaque(struct stage *s, float white, size_t *index)
{
    struct pell_material *m;
    size_t i;

    OK(pell_scene_add_material(s->scene, "opaque", &i));
    m = &s->scene->materials[i];
    m->opaque = true;
    m->metallic = 0.0f;
    m->rho_s = 0.0f;
    m->base_color[0] = m->base_color[1] = m->base_color[2] = white;
    if (index)
        *index = i;
    return m;
}

static inline struct pell_material *stage_medium(struct stage *s, const char *entry, size_t *index)
{
    struct pell_material *m;
    size_t i;

    OK(pell_scene_add_material(s->scene, entry, &i));
    OK(pell_material_apply(s->scene, i, "test", entry));
    m = &s->scene->materials[i];
    m->opaque = false;
    m->metallic = 0.0f;
    m->rho_s = 0.0f;
    if (index)
        *index = i;
    return m;
}

/* 2, 4 and 8 mm wide times `scale`; the channels differ and have totals of 0.8, 0.7, 0.6. */
static inline struct pell_material *stage_gaussians(struct stage *s, double scale, size_t *index)
{
    static const double width[3] = { 2.0, 4.0, 8.0 }, weight[3][3] = { { 0.1, 0.2, 0.3 }, { 0.3, 0.2, 0.1 }, { 0.4, 0.3, 0.2 } };
    struct pell_material *m = stage_medium(s, "marble", index);

    m->gaussians.count = 3;
    for (int i = 0; i < 3; i++) {
        m->gaussians.variance[i] = width[i] * width[i] * scale * scale;
        for (int c = 0; c < 3; c++)
            m->gaussians.weight[i][c] = weight[i][c];
    }
    m->color_from = PELL_COLOR_FROM_PROFILE;
    return m;
}

/* --- Objects --------------------------------------------------------------------------------------------------------------------- */

static inline void stage_box(struct stage *s, size_t material, int object, struct pell_vec3 lo, struct pell_vec3 hi)
{
    shapes_box(s->scene, material, lo, hi)->object = object;
}

static inline void stage_ball(struct stage *s, size_t material, int object, struct pell_vec3 center, float radius, int rings)
{
    shapes_ball(s->scene, material, center, radius, rings)->object = object;
}

static inline struct pell_light *stage_light(struct stage *s, enum pell_light_type type, struct pell_vec3 at, struct pell_vec3 to,
                                             float power)
{
    struct pell_light *l = shapes_light(s->scene, type, at, to);

    l->power[0] = l->power[1] = l->power[2] = power;
    l->width = l->height = 30.0f;
    l->radius = 18.0f;
    return l;
}

static inline struct pell_light *stage_environment(struct stage *s, float radiance)
{
    return stage_light(s, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, -1), radiance);
}

/* Looks from one point at another; `ortho` > 0: the image's height in mm, else `fov` radians. */
static inline struct pell_camera *stage_camera(struct stage *s, struct pell_vec3 from, struct pell_vec3 to, float fov, float ortho)
{
    const struct pell_vec3 f = vec3_normalize(vec3_sub(to, from));
    const struct pell_vec3 side = vec3_normalize(vec3_cross(f, fabsf(f.y) > 0.99f ? vec3(0, 0, 1) : vec3(0, 1, 0)));
    struct pell_camera *c;
    size_t i;

    if (s->scene->num_cameras == 0)
        OK(pell_scene_add_camera(s->scene, "camera", &i));
    c = &s->scene->cameras[0];
    vec3_store(from, c->position);
    vec3_store(f, c->forward);
    vec3_store(vec3_cross(side, f), c->up);
    c->fov = fov;
    c->ortho_height = ortho;
    return c;
}

/* --- Rendering -------------------------------------------------------------------------------------------------------------------- */

/* Selects a method by name with knobs "name=value" up to NULL; NULL or "none": no method. */
static inline void stage_method(struct stage *s, const char *name, const char *const *knobs)
{
    const struct pell_method *m = NULL;
    struct pell_setting list[16] = { { NULL, NULL, NULL } };
    char names[16][32];
    void *values = NULL;
    size_t n = 0;

    if (name && strcmp(name, "none") != 0) {
        m = pell_method_find(s->ctx, "test", name);
        assert_non_null(m);
        for (; knobs && knobs[n]; n++) {
            const char *equal = strchr(knobs[n], '=');
            snprintf(names[n], sizeof(names[n]), "%.*s", (int) (equal - knobs[n]), knobs[n]);
            list[n] = (struct pell_setting) { names[n], equal + 1, "test" };
        }
        values = calloc(1, m->knobs_size);
        OK(pell_method_configure(s->ctx, m, list, n, values));
    }
    OK(pell_renderer_set_method(s->r, m, values));
    free(values);
}

static inline void stage_complete(struct stage *s)
{
    const struct pell_load_params bare = { .bare = true };

    OK(pell_scene_complete(s->scene, &bare));
}

/* Completes the scene on the first call. */
static inline void stage_render(struct stage *s)
{
    if (!s->set) {
        stage_complete(s);
        OK(pell_renderer_set_scene(s->r, s->scene));
        s->set = true;
    }
    OK(pell_renderer_render(s->r, &s->settings, &s->image));
}

static inline struct shot shot_copy(const struct pell_render_result *p)
{
    struct shot shot = {
        .width = p->width, .height = p->height, .planes = p->num_channels + 3, .exposure = p->exposure, .invalid = p->invalid
    };

    shot.size = (size_t) p->width * (size_t) p->height;
    shot.data = malloc(shot.planes * shot.size * sizeof(float));
    for (size_t i = 0; i < shot.planes; i++) {
        const bool shown = i >= p->num_channels;
        const float *from = shown ? p->display[i - p->num_channels] : p->channels[i].data;
        const ptrdiff_t stride = shown ? p->stride : p->channels[i].stride;
        for (int y = 0; y < p->height; y++)
            memcpy(shot.data + i * shot.size + (size_t) y * (size_t) p->width, from + y * stride, (size_t) p->width * sizeof(float));
    }
    return shot;
}

/* Renders with the selected method and takes a copy; no pixel may be invalid. */
static inline struct shot stage_shot(struct stage *s)
{
    stage_render(s);
    assert_int_equal(s->image.invalid, 0);
    return shot_copy(&s->image);
}

static inline struct shot stage_shot_of(struct stage *s, const char *method, const char *const *knobs)
{
    stage_method(s, method, knobs);
    return stage_shot(s);
}

static inline void shot_free(struct shot *shot)
{
    free(shot->data);
    shot->data = NULL;
}

static inline double shot_at(const struct shot *shot, size_t plane, int x, int y)
{
    return (double) shot->data[plane * shot->size + (size_t) y * (size_t) shot->width + (size_t) x];
}

/* Mean of green over covered pixels; at least one is covered. */
static inline double shot_mean_green(const struct shot *shot)
{
    double sum = 0.0, n = 0.0;

    for (int y = 0; y < shot->height; y++)
        for (int x = 0; x < shot->width; x++)
            if (shot_at(shot, SHOT_A, x, y) > 0.0) {
                sum += shot_at(shot, SHOT_G, x, y);
                n += 1.0;
            }
    REQUIRE(n > 0.0);
    return sum / n;
}

static inline bool shot_equal(const struct shot *a, const struct shot *b)
{
    return a->width == b->width && a->height == b->height && a->planes == b->planes &&
           memcmp(a->data, b->data, a->planes * a->size * sizeof(float)) == 0;
}

/* All values are finite, and display values lie in [0, 1]. */
static inline void shot_check(const struct shot *shot)
{
    for (size_t i = 0; i < shot->planes * shot->size; i++)
        if (!isfinite(shot->data[i]))
            fail_msg("plane %zu, pixel %zu is %g", i / shot->size, i % shot->size, (double) shot->data[i]);
    for (size_t i = (shot->planes - 3) * shot->size; i < shot->planes * shot->size; i++)
        if (!(shot->data[i] >= 0.0f && shot->data[i] <= 1.0f))
            fail_msg("display is %g", (double) shot->data[i]);
}

/* Difference of two images in R, G, B: root mean square and largest, relative to the first's mean of covered pixels. */
struct difference {
    double rms, largest, mean;
    int64_t count, over; /* values compared; those that differ by more than 1 % of the mean */
};

static inline struct difference shot_difference(const struct shot *a, const struct shot *b)
{
    struct difference d = { 0 };
    double sum = 0.0, square = 0.0;
    int64_t covered = 0;

    assert_int_equal(a->width, b->width);
    assert_int_equal(a->height, b->height);
    for (size_t i = 0; i < a->size; i++)
        if (a->data[SHOT_A * a->size + i] > 0.0f) {
            covered += 3;
            for (size_t c = 0; c < 3; c++)
                sum += (double) a->data[c * a->size + i];
        }
    d.mean = covered ? sum / (double) covered : 1.0;
    for (size_t i = 0; i < 3 * a->size; i++) {
        const double e = fabs((double) a->data[i] - (double) b->data[i]) / d.mean;
        square += e * e;
        d.largest = fmax(d.largest, e);
        d.over += e > 0.01;
    }
    d.count = covered;
    d.rms = covered ? sqrt(square / (double) covered) : 0.0;
    return d;
}

#endif
