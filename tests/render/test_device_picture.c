/* SPDX-License-Identifier: MIT
 * test_device_picture.c - images whose samples are computed on a Vulkan device from the camera to their sum equal the cpu's: feature by
 * feature, for sequences of frames, and where calls fail; features that the device lacks are computed by the cpu, and a row states why.
 * Under the validation layer; skipped, by name, where there is no driver or no layer. */
#include "gpu_test.h"
#include "slow.h"
#include "stage.h"

#include "render/engine.h"
#include "vulkan/core.h"

enum { WIDTH = 92, HEIGHT = 68 };

/* Only the first device compiles the shaders. */
static char cache[] = "/tmp/pell_picture_XXXXXX";
static const struct pell_gpu_params cached_gpu = { .validate = true, .cache = cache };

static void start_on(struct stage *s, bool vulkan, void (*fill)(struct stage *s))
{
    stage_start(s, WIDTH, HEIGHT);
    if (vulkan) {
        pell_renderer_destroy(&s->r);
        pell_device_destroy(&s->device);
        OK(pell_device_create_vulkan(s->ctx, 2, &cached_gpu, &s->device));
        OK(pell_renderer_create(s->device, &s->r));
    }
    s->settings.msaa = 2;
    s->settings.exposure = 0.0f; /* metered */
    s->settings.light_samples = 8;
    stage_camera(s, vec3(25, 20, 90), vec3(0, 0, 0), 0.5f, 0.0f);
    fill(s);
}

static void finish_on(struct stage *s)
{
    pell_renderer_destroy(&s->r);
    if (s->device->gpu)
        assert_true(pell_gpu_memory_used(s->device->gpu) == 0);
    pell_device_destroy(&s->device);
    if (s->kept.errors)
        fail_msg("%d messages, the last: %s", s->kept.errors, s->kept.what);
    stage_finish(s);
}

static void render_by(struct stage *s, const char *method, const char *const *knobs)
{
    if (!s->set) {
        stage_complete(s);
        OK(pell_renderer_set_scene(s->r, s->scene));
        s->set = true;
        stage_method(s, method, knobs);
    }
    OK(pell_renderer_render(s->r, &s->settings, &s->image));
}

static void render(struct stage *s, const char *method)
{
    render_by(s, method, NULL);
}

static const struct pell_stage_time *row(const struct stage *s, const char *name)
{
    for (size_t i = 0; i < s->image.num_stages; i++)
        if (strcmp(s->image.stages[i].name, name) == 0)
            return &s->image.stages[i];
    return NULL;
}

/* The row that states why the cpu computed the samples; NULL: it did not. */
static const char *reason(const struct stage *s)
{
    static const char begin[] = "surface to composite by the cpu: ";

    for (size_t i = 0; i < s->image.num_stages; i++)
        if (strncmp(s->image.stages[i].name, begin, sizeof(begin) - 1) == 0)
            return s->image.stages[i].name + sizeof(begin) - 1;
    return NULL;
}

/* --- Scenes: each has features that another lacks ------------------------------------------------------------------------------------ */

/* A ball in front of a box, one material each. */
static void two_objects(struct stage *s, size_t ball, size_t box)
{
    stage_ball(s, ball, 0, vec3(0, 0, 10), 12.0f, 20);
    stage_box(s, box, 1, vec3(-30, -22, -40), vec3(26, 24, -14));
}

static void plain(struct stage *s)
{
    size_t ball, box;

    stage_gaussians(s, 0.5, &ball);
    stage_opaque(s, 0.7f, &box);
    two_objects(s, ball, box);
    stage_light(s, PELL_LIGHT_SPOT, vec3(40, 30, 60), vec3(0, 0, 0), 0.3f);
}

static void orthographic(struct stage *s)
{
    plain(s);
    stage_camera(s, vec3(25, 20, 90), vec3(0, 0, 0), 0.5f, 60.0f);
}

/* Lobes, metal, emission, and colours split between entry and exit. */
static void surfaces(struct stage *s)
{
    struct pell_material *m;
    size_t ball, box, tin;

    m = stage_gaussians(s, 0.5, &ball);
    m->rho_s = 0.9f;
    m->roughness = 0.35f;
    m->color_from = PELL_COLOR_FROM_TEXTURE;
    m->base_color[0] = 0.9f;
    m->base_color[1] = 0.4f;
    m->mix = 0.3f;
    m->strength = 0.6f;
    m = stage_opaque(s, 0.7f, &box);
    m->metallic = 0.8f;
    m->rho_s = 1.0f;
    m->base_color[2] = 0.2f;
    m = stage_opaque(s, 0.3f, &tin);
    m->emissive[0] = 0.02f;
    m->rho_s = 0.5f;
    two_objects(s, ball, box);
    stage_box(s, tin, 2, vec3(10, -16, 2), vec3(18, -8, 12));
    stage_light(s, PELL_LIGHT_RECT, vec3(40, 30, 60), vec3(0, 0, 0), 0.01f);
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(-40, 30, 20), vec3(0, 0, 0), 0.4f);
}

static void smooth(struct stage *s)
{
    surfaces(s);
    s->settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
    s->settings.exit = PELL_EXIT_NORMALIZATION_PUBLISHED;
    s->settings.angles = true;
}

/* Penumbras on surfaces that blur light by less than a pixel, by one to two pixels, and by more. */
static void small_radii(struct stage *s)
{
    size_t fine, middle, wide, bar;

    stage_gaussians(s, 0.01, &fine);
    stage_gaussians(s, 1.0, &middle);
    stage_gaussians(s, 16.0, &wide);
    stage_opaque(s, 0.5f, &bar);
    two_objects(s, fine, middle);
    stage_box(s, wide, 2, vec3(-20, -16, 8), vec3(-12, -8, 14));
    stage_box(s, bar, 3, vec3(8, 6, 22), vec3(12, 24, 26));
    stage_light(s, PELL_LIGHT_RECT, vec3(40, 30, 60), vec3(0, 0, 0), 0.01f);
}

/* All effects of solids: curvature on fine and coarse triangles, thin parts, transmission and light between objects. */
static void solids(struct stage *s)
{
    size_t ball, box, floor;

    stage_medium(s, "marble", &ball);
    stage_medium(s, "wholemilk", &box)->rho_s = 0.5f;
    stage_opaque(s, 0.6f, &floor);
    two_objects(s, ball, box);
    stage_box(s, ball, 2, vec3(-22, -12, 4), vec3(-20.5f, 8, 16));
    shapes_quad(s->scene, floor, vec3(0, -22, 0), vec3(0, 0, 60), vec3(60, 0, 0))->object = 3;
    stage_light(s, PELL_LIGHT_RECT, vec3(40, 30, 60), vec3(0, 0, 0), 0.01f);
    stage_light(s, PELL_LIGHT_POINT, vec3(-60, 10, 0), vec3(0, 0, 0), 0.3f);
    s->settings.bounces = 3;
    s->settings.indirect_samples = 600;
    s->settings.angles = s->settings.curvature = s->settings.opposed = s->settings.single_scattering = true;
}

/* Transmission through slabs and shells with lateral spread, in two objects of one material. */
static void thin_parts(struct stage *s)
{
    size_t wax, stone;

    stage_medium(s, "marble", &stone);
    stage_medium(s, "wholemilk", &wax);
    stage_box(s, wax, 0, vec3(-16, -14, 0), vec3(-1, 14, 0.8f));
    stage_box(s, wax, 1, vec3(1, -14, 0), vec3(16, 14, 2.0f));
    stage_box(s, stone, 2, vec3(-16, -20, -2), vec3(16, -15, 1));
    stage_light(s, PELL_LIGHT_DISC, vec3(10, 8, -50), vec3(0, 0, 0), 0.02f);
    stage_light(s, PELL_LIGHT_SPOT, vec3(-20, 8, -40), vec3(-4, 0, 0), 0.3f);
}

static struct pell_texture *picture(struct stage *s, int width, int height, int channels, bool srgb)
{
    struct pell_texture *t;
    uint8_t *p;

    OK(pell_scene_add_texture(s->scene, "picture", &t));
    t->image = (struct pell_image) { width, height, channels, PELL_PIXEL_U8, srgb, NULL };
    t->image.pixels = p = pell_calloc(s->ctx, (size_t) channels * (size_t) width * (size_t) height, 1);
    for (int i = 0; i < channels * width * height; i++)
        p[i] = (uint8_t) (90 + i * 37 % 151);
    return t;
}

static void set_map(struct pell_texture_map *map, struct pell_texture *t, float scale, int channel)
{
    *map = (struct pell_texture_map) { .texture = t, .channel = channel, .matrix = { scale, 0.2f, 0.1f, -0.1f, scale, 0.3f } };
}

/* A board with one texture coordinate per corner, in front of the box. */
static struct pell_mesh *board(struct stage *s, size_t material, float x, int object)
{
    struct pell_mesh *m = shapes_quad(s->scene, material, vec3(x, -4, 24), vec3(5, 1, 0), vec3(0, 6, 2));

    m->object = object;
    m->uv[0] = pell_calloc(s->ctx, 2 * (size_t) m->num_vertices, sizeof(float));
    for (uint32_t i = 0; i < m->num_vertices; i++) {
        m->uv[0][2 * i] = i == 1 || i == 2 ? 1.0f : 0.0f;
        m->uv[0][2 * i + 1] = i >= 2 ? 1.0f : 0.0f;
    }
    return m;
}

/* Maps of all kinds except those of sheets, as large as and much smaller than a pixel's footprint, with three wrap modes; vertex
 * colours. */
static void maps(struct stage *s)
{
    struct pell_material *m;
    struct pell_texture *t;
    struct pell_mesh *mesh;
    size_t skin, tin, paint;

    plain(s);
    m = stage_gaussians(s, 0.3, &skin);
    m->rho_s = 0.8f;
    m->color_from = PELL_COLOR_FROM_TEXTURE;
    m->mix = 0.5f;
    t = picture(s, 16, 9, 3, true);
    t->wrap_u = PELL_WRAP_MIRROR;
    set_map(&m->base_color_map, t, 3.0f, 0);
    set_map(&m->strength_map, picture(s, 5, 4, 1, false), 1.0f, 0);
    set_map(&m->roughness_map, picture(s, 7, 7, 2, false), 2.0f, 1);
    set_map(&m->normal_map, picture(s, 130, 70, 3, false), 2.0f, 0);
    m->normal_scale = 0.7f;
    m = stage_opaque(s, 0.9f, &tin);
    m->metallic = 0.9f;
    m->rho_s = 1.0f;
    m->emissive[1] = 0.01f;
    set_map(&m->metallic_map, picture(s, 3, 3, 4, false), 1.5f, 2);
    set_map(&m->rho_s_map, picture(s, 4, 4, 3, false), 0.7f, 1);
    t = picture(s, 300, 200, 3, true);
    t->wrap_v = PELL_WRAP_CLAMP;
    set_map(&m->specular_color_map, t, 4.0f, 0);
    set_map(&m->emissive_map, picture(s, 9, 2, 4, true), 1.0f, 0);
    stage_opaque(s, 0.8f, &paint);
    board(s, skin, -12.0f, 2);
    board(s, tin, 0.0f, 3);
    mesh = board(s, paint, 12.0f, 4);
    mesh->color = pell_calloc(s->ctx, 4 * (size_t) mesh->num_vertices, sizeof(float));
    for (uint32_t i = 0; i < 4 * mesh->num_vertices; i++)
        mesh->color[i] = (float) (i % 5) / 5.0f;
    stage_light(s, PELL_LIGHT_POINT, vec3(-20, 10, 70), vec3(0, 0, 0), 0.2f);
}

/* Floating-point maps, as large as and much smaller than a pixel's footprint, and unfiltered maps, of 8 bits and of floats. */
static void float_maps(struct stage *s)
{
    struct pell_material *skin, *tin;
    struct pell_texture *t[3];

    maps(s);
    skin = &s->scene->materials[s->scene->num_materials - 3];
    tin = &s->scene->materials[s->scene->num_materials - 2];
    for (int k = 0; k < 3; k++) {
        const int side = k == 1 ? 120 : 7;
        float *p;
        t[k] = picture(s, side, side, 3, false);
        t[k]->nearest = k == 2;
        pell_free(s->ctx, t[k]->image.pixels);
        t[k]->image.type = PELL_PIXEL_F32;
        t[k]->image.pixels = p = pell_calloc(s->ctx, 3 * (size_t) (side * side), sizeof(float));
        for (int i = 0; i < 3 * side * side; i++)
            p[i] = 0.2f + (float) (i * 29 % 101) / 130.0f;
    }
    set_map(&skin->base_color_map, t[0], 1.0f, 0);
    set_map(&tin->specular_color_map, t[1], 4.0f, 0);
    set_map(&tin->metallic_map, t[2], 1.5f, 1);
    t[0] = picture(s, 5, 4, 3, true);
    t[0]->nearest = true;
    t[0]->wrap_u = PELL_WRAP_MIRROR;
    set_map(&tin->base_color_map, t[0], 2.0f, 0);
}

/* A rotated environment image with a sun and a broad bright part, and a second, constant environment. */
static void under_pictures(struct stage *s)
{
    struct pell_texture *t = picture(s, 64, 32, 3, true);
    struct pell_light *sky = stage_environment(s, 0.3f);
    uint8_t *p = t->image.pixels;

    for (int y = 0; y < 32; y++)
        for (int x = 0; x < 64; x++)
            for (int c = 0; c < 3; c++)
                p[3 * (64 * y + x) + c] = x == 40 && y == 9                    ? 255
                                          : x > 8 && x < 20 && y > 6 && y < 14 ? 160
                                                                               : (uint8_t) (20 + (x * 5 + y * (3 + c)) % 31);
    sky->image = t;
    sky->rotate = 0.7f;
    stage_environment(s, 0.02f);
    s->settings.ambient_samples = 8;
}

/* Thin sheets with and without transmission maps, in front of a ball and a box, under an environment image. */
static void sheets(struct stage *s)
{
    struct pell_material *m;
    size_t leaf, paper;

    surfaces(s);
    m = stage_opaque(s, 0.5f, &leaf);
    m->diffuse_transmission = 0.6f;
    m->diffuse_transmission_color[2] = 0.2f;
    m->rho_s = 0.5f;
    set_map(&m->diffuse_transmission_map, picture(s, 6, 5, 3, false), 1.0f, 1);
    set_map(&m->diffuse_transmission_color_map, picture(s, 4, 9, 3, true), 1.0f, 0);
    stage_opaque(s, 0.8f, &paper)->diffuse_transmission = 0.4f;
    board(s, leaf, -12.0f, 3);
    board(s, paper, 0.0f, 4);
    under_pictures(s);
    s->settings.bounces = 2;
    s->settings.indirect_samples = 300;
    s->settings.curvature = true;
}

/* A medium whose colour comes from a map. */
static void painted(struct stage *s)
{
    struct pell_material *m;
    size_t wax;

    plain(s);
    m = stage_medium(s, "marble", &wax);
    m->color_from = PELL_COLOR_FROM_TEXTURE;
    set_map(&m->base_color_map, picture(s, 16, 9, 3, true), 1.0f, 0);
    board(s, wax, -6.0f, 2);
}

static void with_lens(struct stage *s)
{
    surfaces(s);
    s->settings.dof = true;
    s->scene->cameras[0].f_number = 2.0f;
}

static void sky(struct stage *s)
{
    surfaces(s);
    under_pictures(s);
}

static void smooth_sky(struct stage *s)
{
    smooth(s);
    under_pictures(s);
}

static void thin_parts_under_a_sky(struct stage *s)
{
    thin_parts(s);
    under_pictures(s);
    s->settings.curvature = s->settings.angles = s->settings.single_scattering = true;
}

static const struct {
    const char *name;
    void (*fill)(struct stage *s);
    const char *method, *knobs[4];
} scenes[] = {
    { "a spot light", plain, "screen-space", { NULL } },
    { "without scattering", plain, "none", { NULL } },
    { "orthographic", orthographic, "screen-space", { NULL } },
    { "lobes, metal, colours", surfaces, "screen-space", { NULL } },
    { "smooth boundaries", smooth, "screen-space", { NULL } },
    { "small radii", small_radii, "screen-space", { NULL } },
    { "solids", solids, "screen-space", { NULL } },
    { "thin parts", thin_parts, "screen-space", { NULL } },
    { "maps", maps, "screen-space", { NULL } },
    { "maps of floats, or unfiltered", float_maps, "screen-space", { NULL } },
    { "environments", sky, "screen-space", { NULL } },
    { "environments, smooth boundaries", smooth_sky, "screen-space", { NULL } },
    { "environments, thin parts", thin_parts_under_a_sky, "screen-space", { NULL } },
    { "depth of field", with_lens, "screen-space", { NULL } },
    { "thin sheets", sheets, "screen-space", { NULL } },
    { "image-space", solids, "image-space", { NULL } },
    { "image-space, by albedo", painted, "image-space", { "spread=albedo", NULL } },
    { "image-space, orthographic", orthographic, "image-space", { NULL } },
    { "texture-space", solids, "texture-space", { NULL } },

    { "texture-space, unblurred", maps, "texture-space", { "size=64", "tsm-size=64", "first=unblurred" } },
};

/* --- Comparison ---------------------------------------------------------------------------------------------------------------------- */

/* Whether the coverage of a pixel, or of a neighbour, is partial. */
static bool at_silhouette(const struct pell_render_result *a, int x, int y)
{
    for (int v = y - 1; v <= y + 1; v++)
        for (int u = x - 1; u <= x + 1; u++) {
            const float alpha = v < 0 || u < 0 || v >= a->height || u >= a->width ? 0.0f : a->alpha[v * a->stride + u];
            if (alpha > 0.0f && alpha < 1.0f)
                return true;
        }
    return false;
}

struct image_difference {
    double mean;         /* of radiance, relative to its mean */
    double worst;        /* of a pixel away from silhouettes, relative to its radiance plus a little of the mean */
    int over, pixels;    /* away from silhouettes: that differ by more than 1 %; all of them */
    double alpha, shown; /* mean differences */
};

static struct image_difference compare(const struct pell_render_result *a, const struct pell_render_result *b)
{
    struct image_difference d = { .mean = 0.0 };
    double sum = 0.0;

    for (int c = 0; c < 3; c++)
        for (int y = 0; y < a->height; y++)
            for (int x = 0; x < a->width; x++)
                sum += (double) ((const float *) a->channels[c].data)[y * a->stride + x];
    REQUIRE(sum > 0.0);
    for (int y = 0; y < a->height; y++)
        for (int x = 0; x < a->width; x++) {
            const ptrdiff_t at = y * a->stride + x;
            double most = 0.0;
            for (int c = 0; c < 3; c++) {
                const double p = (double) ((const float *) a->channels[c].data)[at], q = (double) ((const float *) b->channels[c].data)[at];
                d.mean += fabs(p - q) / sum;
                d.shown += fabs((double) a->display[c][at] - (double) b->display[c][at]) / (3.0 * a->width * a->height);
                most = fmax(most, fabs(p - q) / (p + 0.01 * sum / (3.0 * a->width * a->height)));
            }
            d.alpha += fabs((double) a->alpha[at] - (double) b->alpha[at]) / (a->width * a->height);
            if (at_silhouette(a, x, y))
                continue;
            d.pixels++;
            d.over += most > 0.01;
            d.worst = fmax(d.worst, most);
        }
    return d;
}

static void each_feature_is_the_cpus(void **state)
{
    (void) state;
    skip_without_gpu();
    for (size_t k = 0; k < PELL_COUNT(scenes); k += SLOW ? 3 : 1) {
        struct stage s[2];
        struct image_difference d;
        int64_t rays[2] = { 0, 0 };

        for (int i = 0; i < 2; i++) {
            start_on(&s[i], i == 1, scenes[k].fill);
            render_by(&s[i], scenes[k].method, scenes[k].knobs);
        }
        if (reason(&s[1]))
            fail_msg("%s: by the cpu: %s", scenes[k].name, reason(&s[1]));
        d = compare(&s[0].image, &s[1].image);
        rays[0] = row(&s[0], "irradiance")->rays;
        rays[1] = row(&s[1], "direct light")->rays + (row(&s[1], "transmission") ? row(&s[1], "transmission")->rays : 0);
        print_message("# %s: mean difference %.2g, of alpha %.2g, of what is shown %.2g; the worst pixel %.2g; %lld and %lld rays\n",
                      scenes[k].name, d.mean, d.alpha, d.shown, d.worst, (long long) rays[0], (long long) rays[1]);
        REQUIRE(d.mean < 1e-5 && d.alpha < 1e-5 && d.shown < 1e-5 && d.pixels > 2000 && d.over * 1000 <= d.pixels);
        REQUIRE(fabsf(s[0].image.exposure / s[1].image.exposure - 1.0f) < 1e-5f);
        REQUIRE(rays[0] > 2000 && fabs((double) rays[1] / (double) rays[0] - 1.0) < 2e-3);
        assert_memory_equal(&s[0].image.rect, &s[1].image.rect, sizeof(s[0].image.rect));
        for (int i = 0; i < 2; i++)
            finish_on(&s[i]);
    }
}

/* The image is copied back once, and neither points nor planes are copied to the device. */
static void the_picture_comes_back_once(void **state)
{
    static const char *const of_host[] = { "irradiance", "light upload", "light download", "pack", "unpack", "spread unpack" };
    static const char *const of_device[] = { "surface", "direct light", "finish", "rows", "load", "composite", "picture download" };
    const struct pell_stage_time *down;
    struct stage s;
    (void) state;

    skip_without_gpu();
    start_on(&s, true, plain);
    s.settings.msaa = 3;
    render(&s, "screen-space");
    assert_null(reason(&s));
    for (size_t i = 0; i < PELL_COUNT(of_host); i++)
        assert_null(row(&s, of_host[i]));
    for (size_t i = 0; i < PELL_COUNT(of_device); i++)
        if (!row(&s, of_device[i]) || !(row(&s, of_device[i])->ms > 0.0f) || row(&s, of_device[i])->bytes <= 0)
            fail_msg("no time of %s", of_device[i]);
    down = row(&s, "picture download");
    REQUIRE(down->pixels > 1000 && down->pixels <= WIDTH * HEIGHT && down->bytes == 32 * down->pixels);
    REQUIRE(row(&s, "surface")->rays > 3 * 1500 && row(&s, "surface")->rays <= 3 * WIDTH * HEIGHT);
    finish_on(&s);
}

/* --- Features that the device lacks -------------------------------------------------------------------------------------------------- */

static void with_layers(struct stage *s)
{
    plain(s);
    s->settings.layers = true;
}

static void what_the_device_lacks_the_cpu_does(void **state)
{
    static const struct {
        void (*fill)(struct stage *s);
        const char *method, *why, *knobs[2];
    } cases[] = {
        { with_layers, "screen-space", "layers are asked for", { NULL } },
        { plain, "image-space", "the method reads other planes", { "views=eye+lights", NULL } },
    };
    (void) state;

    skip_without_gpu();
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        struct stage s[2];
        struct image_difference d;

        for (int i = 0; i < 2; i++) {
            start_on(&s[i], i == 1, cases[k].fill);
            render_by(&s[i], cases[k].method, cases[k].knobs);
        }
        assert_null(reason(&s[0]));
        assert_non_null(reason(&s[1]));
        assert_string_equal(reason(&s[1]), cases[k].why);
        assert_null(row(&s[1], "picture download"));
        d = compare(&s[0].image, &s[1].image);
        REQUIRE(d.mean < 1e-4 && d.over * 1000 <= d.pixels);
        for (int i = 0; i < 2; i++)
            finish_on(&s[i]);
    }
}

/* Smaller buffers: all samples of a frame are then computed by the cpu. */
static void what_no_buffer_holds_the_cpu_does(void **state)
{
    struct stage s;
    (void) state;

    skip_without_gpu();
    start_on(&s, true, plain);
    render(&s, "none");
    assert_null(reason(&s));
    s.device->gpu->limits.maxStorageBufferRange = 32 * 96 * HEIGHT - 1; /* rows have 96 pixels */
    render(&s, "none");
    assert_non_null(reason(&s));
    assert_string_equal(reason(&s), "more pixels, or more known of solids, than a buffer holds");
    finish_on(&s);
}

/* --- Sequences of frames ------------------------------------------------------------------------------------------------------------- */

static float *copy_of(const struct stage *s)
{
    const struct pell_render_result *a = &s->image;
    float *copy = malloc(3 * (size_t) a->width * (size_t) a->height * sizeof(float));

    assert_non_null(copy);
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < a->height; y++)
            memcpy(copy + ((size_t) c * (size_t) a->height + (size_t) y) * (size_t) a->width,
                   (const float *) a->channels[c].data + y * a->stride, (size_t) a->width * sizeof(float));
    return copy;
}

/* Changes from frame to frame: step `k` of a sequence, from any step before. */
enum { STEPS = 5 };
static void change(struct stage *s, int k)
{
    s->settings.width = k == 1 ? 36 : 48;
    s->settings.height = 32;
    s->settings.msaa = k == 1 ? 1 : 2;
    s->settings.dof = k == 2;
    s->settings.bounces = k == 3 ? 2 : 0;
    s->settings.curvature = k == 3;
    s->settings.light_samples = k == 4 ? 40 : 8; /* a light in slices, whose state needs memory */
    s->scene->cameras[0].position[0] = k == 4 ? 60.0f : 25.0f;
}

/* After all possible changes between them, frames equal those of a new renderer. */
static void frames_do_not_depend_on_those_before(void **state)
{
    float *first[STEPS];
    struct stage s;
    (void) state;

    skip_without_gpu();
    for (int k = 0; k < STEPS; k++) {
        start_on(&s, true, thin_parts);
        s.settings.indirect_samples = 64;
        change(&s, k);
        render(&s, "screen-space");
        assert_null(reason(&s));
        first[k] = copy_of(&s);
        finish_on(&s);
    }
    start_on(&s, true, thin_parts);
    s.settings.indirect_samples = 64;
    for (int i = 0; i < (SLOW ? 1 : 2) * STEPS; i++) {
        const int k = i * 3 % STEPS;
        float *again;
        change(&s, k);
        render(&s, "screen-space");
        again = copy_of(&s);
        assert_memory_equal(again, first[k], 3 * (size_t) s.image.width * 32 * sizeof(float));
        free(again);
    }
    finish_on(&s);
    for (int k = 0; k < STEPS; k++)
        free(first[k]);
}

/* --- Failures ------------------------------------------------------------------------------------------------------------------------ */

/* A small frame with all features; all resources that depend on the size are created again for each `n`. */
static enum pell_result small_frame(struct stage *s, uint64_t n)
{
    s->settings.width = n % 2 ? 28 : 24;
    s->settings.height = 16;
    s->settings.msaa = 1;
    s->settings.light_samples = 2;
    return pell_renderer_render(s->r, &s->settings, &s->image);
}

static void small_solids(struct stage *s)
{
    thin_parts(s);
    stage_environment(s, 0.02f);
    s->settings.bounces = 1;
    s->settings.indirect_samples = 64;
    s->settings.curvature = s->settings.angles = s->settings.single_scattering = true;
}

/* Methods that record commands between buffers of the device, and one for which the host prepares data. */
static const struct {
    const char *method, *knobs[3];
} failing[] = { { "screen-space", { NULL } }, { "texture-space", { "size=64", "tsm=off", NULL } } };

static void fail_calls(const char *method, const char *const *knobs)
{
    struct stage s;
    float *good, *again;
    int failed = 0;

    start_on(&s, true, small_solids);
    render_by(&s, method, knobs);
    OK(small_frame(&s, 0));
    assert_null(reason(&s));
    good = copy_of(&s);
    for (uint64_t n = 1; failed >= 0; n += n / 8 + 1) {
        enum pell_result res;
        pell_gpu_fail_at(s.device->gpu, n);
        res = small_frame(&s, n);
        pell_gpu_fail_at(s.device->gpu, 0);
        REQUIRE(res == PELL_OK ? s.kept.errors == 0 : res == PELL_ERR_NOMEM && s.kept.errors == 1);
        if (res == PELL_OK)
            break;
        failed++;
        s.kept.errors = 0;
    }
    print_message("# %d calls\n", failed);
    REQUIRE(failed > 20);
    OK(small_frame(&s, 0));
    again = copy_of(&s);
    assert_memory_equal(again, good, 3 * 24 * 16 * sizeof(float));
    free(again);
    free(good);
    finish_on(&s);
}

static void calls_that_fail_are_reported(void **state)
{
    (void) state;
    skip_without_gpu();
    for (size_t i = 0; i < PELL_COUNT(failing); i++)
        fail_calls(failing[i].method, failing[i].knobs);
}

static void fail_allocations(const char *method, const char *const *knobs)
{
    struct pell_alloc_fault fault = { 0 };
    enum pell_result res = PELL_ERR_NOMEM;
    struct stage s;
    int failed = 0;

    stage_start_on(&s, PELL_ENGINE_CPU, WIDTH, HEIGHT, 1, &fault);
    pell_renderer_destroy(&s.r);
    pell_device_destroy(&s.device);
    OK(pell_device_create_vulkan(s.ctx, 1, &cached_gpu, &s.device));
    OK(pell_renderer_create(s.device, &s.r));
    stage_camera(&s, vec3(25, 20, 90), vec3(0, 0, 0), 0.5f, 0.0f);
    small_solids(&s);
    render_by(&s, method, knobs);
    for (uint64_t n = 1; res != PELL_OK; n = next_allocation(n)) {
        fault.fail_at = atomic_load(&fault.calls) + n;
        res = small_frame(&s, n);
        fault.fail_at = 0;
        failed += res != PELL_OK;
        REQUIRE(res == PELL_OK || res == PELL_ERR_NOMEM);
    }
    print_message("# %d allocations\n", failed);
    REQUIRE(failed > 20);
    s.kept.errors = 0;
    finish_on(&s);
    REQUIRE(atomic_load(&fault.live) == 0);
}

static void allocations_that_fail_leave_nothing(void **state)
{
    (void) state;
    skip_without_gpu();
    for (size_t i = 0; i < PELL_COUNT(failing); i++)
        fail_allocations(failing[i].method, failing[i].knobs);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_feature_is_the_cpus),
        cmocka_unit_test(the_picture_comes_back_once),
        cmocka_unit_test(what_the_device_lacks_the_cpu_does),
        cmocka_unit_test(what_no_buffer_holds_the_cpu_does),
        cmocka_unit_test(frames_do_not_depend_on_those_before),
        cmocka_unit_test(calls_that_fail_are_reported),
        cmocka_unit_test(allocations_that_fail_leave_nothing),
    };
    char command[64];
    int failed;

    if (!mkdtemp(cache))
        return 1;
    failed = cmocka_run_group_tests(tests, NULL, NULL);
    snprintf(command, sizeof(command), "rm -r %s", cache);
    return system(command) != 0 || failed;
}
