/* SPDX-License-Identifier: MIT
 * test_irradiance.c - light that enters from the front, against closed forms and brute force. */
#include "lights_rig.h"
#include "slow.h"
#include "specular_lookup.h"

#include "image/color.h"
#include "render/irradiance/sky_kernel.h"

#define SIZE 48

/* A white plane z = 0 from above. */
static void start_plane(struct rig *r)
{
    rig_start(r, SIZE, SIZE);
    rig_plane(r, rig_material(r, true), 0, 0.0f, 100.0f);
    rig_camera(r, 60.0f);
}

static void plane_under_a_point(void **state)
{
    const struct pell_vec3 at = vec3(10.0f, -20.0f, 80.0f);
    struct rig r;
    (void) state;
    start_plane(&r);
    rig_light(&r, PELL_LIGHT_POINT, at, vec3(0, 0, 0), 3.0f);
    rig_render(&r);
    for (int y = 0; y < SIZE; y++)
        for (int x = 0; x < SIZE; x++) {
            const struct pell_vec3 d = vec3_sub(at, rig_point(&r, x, y));
            const double length = vec3_length(d), metres = length * 1e-3, e = 3.0 / (metres * metres) * d.z / length;
            REQUIRE_REL(r.light.irradiance[0][rig_at(&r, x, y)], e, 1e-5);
            REQUIRE_REL(r.light.irradiance[2][rig_at(&r, x, y)], 0.25 * e, 1e-5);
        }
    REQUIRE(r.light.shadow_rays == SIZE * SIZE);
    rig_finish(&r);
}

static void a_range_cuts_a_point_off(void **state)
{
    struct rig r;
    (void) state;
    start_plane(&r);
    rig_light(&r, PELL_LIGHT_POINT, vec3(0, 0, 90), vec3(0, 0, 0), 1.0f)->range = 100.0f;
    rig_render(&r);
    for (int x = 0; x < SIZE; x++) {
        const struct pell_vec3 p = rig_point(&r, x, 3);
        const double d = sqrt((double) p.x * p.x + (double) p.y * p.y + 8100.0), q = pow(d / 100.0, 4);
        REQUIRE_NEAR(r.light.irradiance[0][rig_at(&r, x, 3)], fmax(0.0, 1.0 - q) * 1e6 / (d * d) * 90.0 / d, 1e-3);
    }
    rig_finish(&r);
}

static void plane_under_a_spot(void **state)
{
    struct rig r;
    int inside = 0, between = 0, outside = 0;
    (void) state;
    start_plane(&r);
    rig_light(&r, PELL_LIGHT_SPOT, vec3(0, 0, 40), vec3(0, 0, 0), 1.0f);
    rig_render(&r);
    for (int y = 0; y < SIZE; y++)
        for (int x = 0; x < SIZE; x++) {
            const struct pell_vec3 p = rig_point(&r, x, y);
            const double d = sqrt((double) p.x * p.x + (double) p.y * p.y + 1600.0), c = 40.0 / d;
            const double ramp = fmin(fmax((c - 0.8) / (0.95 - 0.8), 0.0), 1.0);
            inside += ramp == 1.0;
            outside += ramp == 0.0;
            between += ramp > 0.0 && ramp < 1.0;
            REQUIRE_NEAR(r.light.irradiance[0][rig_at(&r, x, y)], ramp * ramp * 1e6 / (d * d) * c, 2e-3);
        }
    REQUIRE(inside > 50 && between > 50 && outside > 50);
    REQUIRE(r.light.shadow_rays < SIZE * SIZE - outside + 1);
    rig_finish(&r);
}

static void plane_under_a_directional(void **state)
{
    struct rig r;
    (void) state;
    start_plane(&r);
    rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3(3, 0, 4), vec3(0, 0, 0), 2.0f);
    rig_render(&r);
    for (int x = 0; x < SIZE; x++)
        REQUIRE_REL(r.light.irradiance[0][rig_at(&r, x, x)], 2.0 * 0.8, 1e-6);
    rig_finish(&r);
}

static void rect_corners(const struct pell_light *l, struct pell_vec3 corner[4])
{
    const struct pell_vec3 p = vec3_load(l->position), up = vec3_load(l->up), right = vec3_cross(vec3_load(l->direction), up);
    for (int k = 0; k < 4; k++)
        corner[k] = vec3_mad(vec3_mad(p, (k == 0 || k == 3 ? -0.5f : 0.5f) * l->width, right), (k < 2 ? -0.5f : 0.5f) * l->height, up);
}

static void plane_under_a_rectangle(void **state)
{
    struct pell_vec3 corner[4];
    struct pell_light *l;
    struct rig r;
    (void) state;
    start_plane(&r);
    r.settings.light_samples = 1024;
    l = rig_light(&r, PELL_LIGHT_RECT, vec3(30, 10, 70), vec3(5, 0, 0), 5.0f);
    l->width = 50.0f;
    l->height = 30.0f;
    rig_render(&r);
    rect_corners(&r.scene->lights[0], corner);
    for (int y = 0; y < SIZE; y += 5)
        for (int x = 0; x < SIZE; x += 5) {
            const double e = 5.0 * polygon_irradiance(rig_point(&r, x, y), vec3(0, 0, 1), corner, 4);
            REQUIRE_REL(r.light.irradiance[0][rig_at(&r, x, y)], e, 3e-3);
        }
    rig_finish(&r);
}

/* One sample per pixel: noisy, but unbiased over pixels and over multisamples. */
static void few_area_samples_are_unbiased(void **state)
{
    struct pell_vec3 corner[4];
    struct pell_light *l;
    struct rig r;
    double got = 0.0, want = 0.0;
    (void) state;
    start_plane(&r);
    r.settings.light_samples = 1;
    l = rig_light(&r, PELL_LIGHT_RECT, vec3(30, 10, 70), vec3(5, 0, 0), 5.0f);
    l->width = 50.0f;
    l->height = 30.0f;
    for (r.sample = 0; r.sample < 4; r.sample++) {
        rig_render(&r);
        rect_corners(&r.scene->lights[0], corner);
        for (int y = 0; y < SIZE; y++)
            for (int x = 0; x < SIZE; x++) {
                got += r.light.irradiance[0][rig_at(&r, x, y)];
                want += 5.0 * polygon_irradiance(rig_point(&r, x, y), vec3(0, 0, 1), corner, 4);
            }
    }
    REQUIRE_REL(got, want, 4e-3);
    rig_finish(&r);
}

/* Lights much larger than their distance: converged with many samples, and without fireflies with 16. */
static void wide_lights_are_even(void **state)
{
    RELEASE_ONLY();
    (void) state;

    for (int samples = 16; samples <= 1024; samples *= 64) {
        struct pell_vec3 corner[4];
        struct pell_light *l;
        struct rig r;
        double disc;
        start_plane(&r);
        r.settings.light_samples = samples;
        l = rig_light(&r, PELL_LIGHT_RECT, vec3(5, 0, 70), vec3(5, 0, 0), 5.0f);
        l->width = 3000.0f;
        l->height = 2000.0f;
        rig_render(&r);
        rect_corners(&r.scene->lights[0], corner);
        for (int y = 0; y < SIZE; y += 5)
            for (int x = 0; x < SIZE; x += 5) {
                const double e = 5.0 * polygon_irradiance(rig_point(&r, x, y), vec3(0, 0, 1), corner, 4);
                REQUIRE_REL(r.light.irradiance[0][rig_at(&r, x, y)], e, samples < 1024 ? 0.25 : 5e-3);
            }
        rig_finish(&r);
        start_plane(&r);
        r.settings.light_samples = samples;
        rig_light(&r, PELL_LIGHT_DISC, vec3(0, 0, 20), vec3(0, 0, 0), 2.0f)->radius = 400.0f;
        rig_render(&r);
        disc = PELL_PI * 2.0 * 160000.0 / (160000.0 + 400.0);
        REQUIRE_REL(r.light.irradiance[0][rig_at(&r, SIZE / 2, SIZE / 2)], disc, samples < 1024 ? 0.25 : 5e-3);
        rig_finish(&r);
    }
}

/* Half of the light's face is below the plane's horizon, and a light that faces away contributes nothing. */
static void a_rectangle_is_clipped_at_the_horizon(void **state)
{
    struct pell_light *l;
    struct rig r;
    (void) state;
    start_plane(&r);
    r.settings.light_samples = 1024;
    l = rig_light(&r, PELL_LIGHT_RECT, vec3(50, 0, 0), vec3(0, 0, 0), 1.0f);
    l->width = l->height = 30.0f;
    l->up[0] = l->up[1] = 0.0f;
    l->up[2] = 1.0f;
    rig_render(&r);
    for (int x = 0; x < SIZE; x += 6) {
        const struct pell_vec3 upper[4] = { vec3(50, -15, 0), vec3(50, 15, 0), vec3(50, 15, 15), vec3(50, -15, 15) };
        REQUIRE_REL(r.light.irradiance[0][rig_at(&r, x, 20)], polygon_irradiance(rig_point(&r, x, 20), vec3(0, 0, 1), upper, 4), 6e-3);
    }
    r.scene->lights[0].direction[0] = 1.0f;
    rig_render(&r);
    for (int x = 0; x < SIZE; x++)
        REQUIRE(r.light.irradiance[0][rig_at(&r, x, 20)] == 0.0f);
    REQUIRE(r.light.shadow_rays == 0);
    rig_finish(&r);
}

static void a_disc_on_its_axis(void **state)
{
    struct rig r;
    (void) state;
    start_plane(&r);
    r.settings.light_samples = 1024;
    rig_light(&r, PELL_LIGHT_DISC, vec3(0, 0, 60), vec3(0, 0, 0), 2.0f)->radius = 40.0f;
    rig_render(&r);
    for (int k = 0; k < 4; k++) /* E = pi L r^2 / (r^2 + h^2) */
        REQUIRE_REL(r.light.irradiance[0][rig_at(&r, SIZE / 2 - k % 2, SIZE / 2 - k / 2)], PELL_PI * 2.0 * 1600.0 / (1600.0 + 3600.0),
                    3e-3);
    rig_finish(&r);
}

static void occluders_throw_exact_shadows(void **state)
{
    static const enum pell_light_type types[] = { PELL_LIGHT_POINT, PELL_LIGHT_DIRECTIONAL };
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(types); k++) {
        struct rig r;
        int lit = 0, dark = 0;
        start_plane(&r);
        rig_box(&r, 0, 1, vec3(200, -8, 40), vec3(260, 8, 60)); /* outside the camera's view */
        rig_light(&r, types[k], vec3(462, 0, 100), vec3(0, 0, 0), 1.0f);
        rig_render(&r);
        for (int y = 0; y < SIZE; y++)
            for (int x = 0; x < SIZE; x++) {
                /* does the shadow ray hit the box? slab test in double precision */
                const struct pell_vec3 p = rig_point(&r, x, y), light = vec3(462, 0, 100);
                const struct pell_vec3 d = types[k] == PELL_LIGHT_POINT ? vec3_sub(light, p) : light;
                const double lo[3] = { 200, -8, 40 }, hi[3] = { 260, 8, 60 }, o[3] = { p.x, p.y, p.z }, v[3] = { d.x, d.y, d.z };
                double t0 = 0.0, t1 = 1.0;
                for (int a = 0; a < 3; a++) {
                    double s0 = (lo[a] - o[a]) / v[a], s1 = (hi[a] - o[a]) / v[a];
                    if (s0 > s1) {
                        const double s = s0;
                        s0 = s1;
                        s1 = s;
                    }
                    t0 = fmax(t0, s0);
                    t1 = fmin(t1, s1);
                }
                if (fabs(t1 - t0) > 1e-4) {
                    const float e = r.light.irradiance[0][rig_at(&r, x, y)];
                    REQUIRE((e == 0.0f) == (t0 < t1));
                    lit += t0 > t1;
                    dark += t0 < t1;
                }
            }
        REQUIRE(lit > 100 && dark > 100);
        rig_finish(&r);
    }
}

/* A projected image (gobo) of a point light: the image appears on the plane, not mirrored, black outside. */
static void an_image_is_projected(void **state)
{
    static uint8_t pixels[4 * 2 * 3] = { 255, 0, 0, 0,   255, 0, 0, 0,   255, 255, 255, 255, /* upper row: red green blue white */
                                         0,   0, 0, 255, 0,   0, 0, 255, 0,   0,   0,   255 };
    struct pell_texture *texture;
    struct pell_light *l;
    struct rig r;
    (void) state;
    start_plane(&r);
    OK(pell_scene_add_texture(r.scene, "gobo", &texture));
    texture->image = (struct pell_image) { 4, 2, 3, PELL_PIXEL_U8, false, NULL };
    texture->image.pixels = pell_alloc(r.ctx, sizeof(pixels));
    memcpy(texture->image.pixels, pixels, sizeof(pixels));
    texture->nearest = true;
    l = rig_light(&r, PELL_LIGHT_POINT, vec3(0, 0, 50), vec3(0, 0, 0), 1.0f);
    l->image = texture;
    l->image_fov = 2.0f * atanf(10.0f / 50.0f); /* 20 mm tall, 40 mm wide on the plane */
    l->up[0] = l->up[2] = 0.0f;
    l->up[1] = 1.0f;
    l->power[0] = l->power[1] = l->power[2] = 1.0f;
    rig_render(&r);
    for (int y = 0; y < SIZE; y++)
        for (int x = 0; x < SIZE; x++) {
            const struct pell_vec3 p = rig_point(&r, x, y);
            const double d = sqrt((double) p.x * p.x + (double) p.y * p.y + 2500.0), e = 1e6 / (d * d) * 50.0 / d;
            const int column = (int) floorf((p.x + 20.0f) / 10.0f),
                      row = p.y > 0.0f ? 0 : 1; /* seen along the light's direction: x to the right */
            for (int c = 0; c < 3; c++) {
                const bool in = fabsf(p.x) < 20.0f && fabsf(p.y) < 10.0f;
                const double want = in ? pixels[3 * (4 * row + column) + c] / 255.0 * e : 0.0;
                REQUIRE_NEAR(r.light.irradiance[c][rig_at(&r, x, y)], want, 1e-4 * e);
            }
        }
    rig_finish(&r);
}

static void a_textured_rectangle_shines_in_its_colours(void **state)
{
    static const uint8_t pixels[2 * 3] = { 255, 0, 0, 0, 255, 0 };
    struct pell_texture *texture;
    struct pell_light *l;
    struct rig r;
    (void) state;
    start_plane(&r);
    r.settings.light_samples = 1024;
    OK(pell_scene_add_texture(r.scene, "face", &texture));
    texture->image = (struct pell_image) { 2, 1, 3, PELL_PIXEL_U8, false, NULL };
    texture->image.pixels = pell_alloc(r.ctx, sizeof(pixels));
    memcpy(texture->image.pixels, pixels, sizeof(pixels));
    texture->nearest = true;
    l = rig_light(&r, PELL_LIGHT_RECT, vec3(0, 0, 40), vec3(0, 0, 0), 1.0f);
    l->width = l->height = 40.0f;
    l->up[0] = l->up[2] = 0.0f;
    l->up[1] = 1.0f;
    l->power[0] = l->power[1] = l->power[2] = 1.0f;
    l->image = texture;
    rig_render(&r);
    for (int x = 0; x < SIZE; x += 7) {
        /* seen from below, facing the light with y up, +x is on the left: red is there */
        const struct pell_vec3 red[4] = { vec3(0, -20, 40), vec3(20, -20, 40), vec3(20, 20, 40), vec3(0, 20, 40) };
        REQUIRE_REL(r.light.irradiance[0][rig_at(&r, x, 11)], polygon_irradiance(rig_point(&r, x, 11), vec3(0, 0, 1), red, 4), 1e-2);
        REQUIRE(r.light.irradiance[2][rig_at(&r, x, 11)] == 0.0f);
    }
    rig_finish(&r);
}

/* E = pi L mean(T), rough and smooth. */
static void constant_environment(void **state)
{
    for (int smooth = 0; smooth < 2; smooth++) {
        struct rig r;
        size_t m;
        double mean;
        (void) state;
        rig_start(&r, SIZE, SIZE);
        m = rig_material(&r, false);
        r.scene->materials[m].rho_s = 0.7f;
        r.scene->materials[m].roughness = 0.35f;
        r.scene->materials[m].medium.eta = 1.4;
        rig_sphere(&r, m, 0, vec3(0, 0, 0), 25.0f, 64);
        rig_camera(&r, 60.0f);
        rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 2.0f);
        r.smooth = smooth;
        r.settings.boundary = smooth;
        rig_render(&r);
        mean = smooth ? boundary_of(r.tables, m)->mean : 1.0 - 0.7 * material_mean(r.tables, m, 0.35f);
        for (int y = 0; y < SIZE; y++)
            for (int x = 0; x < SIZE; x++)
                if (r.surface.material[rig_at(&r, x, y)])
                    REQUIRE_REL(r.light.irradiance[0][rig_at(&r, x, y)], 2.0 * PELL_PI * mean, 2e-3);
        rig_finish(&r);
    }
}

/* The image's texels as lights: direction and radiance x solid angle. */
struct texel {
    float x, y, z, rgb[3];
};

static struct texel *list_texels(const struct pell_light *light, size_t *count)
{
    const struct pell_image *image = &light->image->image;
    struct texel *t = malloc((size_t) image->width * (size_t) image->height * sizeof(*t));
    *count = 0;
    for (int y = 0; y < image->height; y++) {
        const double polar = PELL_PI * (y + 0.5) / image->height,
                     solid = 2.0 * PELL_PI / image->width * PELL_PI / image->height * sin(polar);
        for (int x = 0; x < image->width; x++) {
            /* the image's centre is -z; then rotated about +y */
            const double a = 2.0 * PELL_PI * ((x + 0.5) / image->width - 0.5) - light->rotate;
            struct texel *o = &t[(*count)++];
            float rgba[4];
            pell_image_texel(image, x, y, rgba);
            *o = (struct texel) { (float) (sin(polar) * sin(a)), (float) cos(polar), (float) (-sin(polar) * cos(a)), { 0 } };
            for (int c = 0; c < 3; c++)
                o->rgb[c] = (float) (rgba[c] * light->power[c] * solid);
        }
    }
    return t;
}

/* Int L T max(n.w, 0) dw over the texels, directly from the image. */
static void brute_irradiance(const struct rig *r, const struct texel *texels, size_t count, struct pell_vec3 n, size_t material,
                             double rho_s, float roughness, double rgb[3])
{
    rgb[0] = rgb[1] = rgb[2] = 0.0;
    for (size_t i = 0; i < count; i++) {
        const struct texel *t = &texels[i];
        const float mu = n.x * t->x + n.y * t->y + n.z * t->z;
        double w = mu;
        if (!(mu > 0.0f))
            continue;
        if (r->smooth)
            w *= material_transmittance(r->tables, material, mu);
        else if (rho_s > 0.0)
            w *= 1.0 - rho_s * material_albedo(r->tables, material, mu, roughness);
        for (int c = 0; c < 3; c++)
            rgb[c] += w * t->rgb[c];
    }
}

/* The sum of the environment's lights and its smooth remainder is the image's irradiance on an unshadowed sphere. */
static void check_environment(const char *file, int sources, float rho_s, float roughness, bool smooth, float rotate)
{
    struct pell_texture *texture;
    struct pell_light *l;
    struct rig r;
    struct texel *texels;
    double worst = 0.0;
    size_t m, count;
    rig_start(&r, SIZE, SIZE);
    r.ideal = true;
    m = rig_material(&r, false);
    r.scene->materials[m].rho_s = rho_s;
    r.scene->materials[m].roughness = roughness;
    rig_sphere(&r, m, 0, vec3(0, 0, 0), 25.0f, 200);
    rig_camera(&r, 60.0f);
    OK(pell_scene_add_texture(r.scene, "environment", &texture));
    OK(pell_image_read(r.ctx, file, PELL_ROLE_COLOR, &texture->image));
    l = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 0.5f);
    l->image = texture;
    l->rotate = rotate;
    r.smooth = smooth;
    r.settings.environment_lights = sources;
    r.settings.ambient_samples = 1;
    r.settings.boundary = smooth;
    rig_render(&r);
    texels = list_texels(&r.scene->lights[0], &count);
    for (int k = 0; k < (sources == 24 && !SLOW ? 2 : 1); k++) /* from both sides: the light is rotated instead of the camera */
        for (int y = 2; y < SIZE; y += SLOW ? 31 : 13)
            for (int x = 2; x < SIZE; x += SLOW ? 31 : 13) {
                double want[3];
                if (k == 1 && y == 2 && x == 2) {
                    r.scene->lights[0].rotate = rotate + 2.5f;
                    rig_render(&r);
                    free(texels);
                    texels = list_texels(&r.scene->lights[0], &count);
                }
                if (!r.surface.material[rig_at(&r, x, y)])
                    continue;
                brute_irradiance(&r, texels, count, rig_normal(&r, x, y), m, rho_s, roughness, want);
                for (int c = 0; c < 3; c++) {
                    const double got = r.light.irradiance[c][rig_at(&r, x, y)];
                    worst = fmax(worst, fabs(got / want[c] - 1.0));
                    REQUIRE_REL(got, want[c], 5e-3);
                }
            }
    print_message("# %s, %d lights, rho_s %.1f: largest error %.3f %%\n", strrchr(file, '/') + 1, sources, (double) rho_s, 100.0 * worst);
    free(texels);
    rig_finish(&r);
}

static void environment_sums_to_the_pictures_irradiance_studio(void **state)
{
    (void) state;
    RELEASE_ONLY();
    check_environment(shared_file("assets/environments/brown_photostudio_02_1k.hdr"), 24, 1.0f, 0.4f, false, 0.0f);
    check_environment(shared_file("assets/environments/brown_photostudio_02_1k.hdr"), 0, 0.0f, 0.4f, false, 1.0f);
    check_environment(shared_file("assets/environments/brown_photostudio_02_1k.hdr"), 256, 0.5f, 0.9f, true, 4.0f);
}

static void environment_sums_to_the_pictures_irradiance_sunset(void **state)
{
    (void) state;
    RELEASE_ONLY();
    check_environment(shared_file("assets/environments/venice_sunset_1k.hdr"), 24, 1.0f, 0.2f, false, -2.0f);
    check_environment(shared_file("assets/environments/venice_sunset_1k.hdr"), 5, 0.0f, 0.4f, false, 0.0f);
}

static struct pell_texture *add_picture(struct rig *r, int width, int height, float environment, float sun)
{
    struct pell_texture *t;
    float *p;
    OK(pell_scene_add_texture(r->scene, "made", &t));
    t->image = (struct pell_image) { width, height, 3, PELL_PIXEL_F32, false, NULL };
    p = pell_calloc(r->ctx, (size_t) width * (size_t) height * 3, sizeof(float));
    t->image.pixels = p;
    for (int i = 0; i < width * height * 3; i++)
        p[i] = i / 3 / width < height / 2 ? environment : 0.1f * environment;
    for (int c = 0; c < 3; c++)
        p[3 * ((size_t) (height / 4) * (size_t) width + (size_t) (width / 3)) + (size_t) c] += sun * (1.0f - 0.2f * (float) c);
    return t;
}

/* A one-texel sun ten times as strong as the rest of the environment: its terminator is the hardest case for a table over the normal. */
static void a_sun_in_a_dim_environment_keeps_the_bound(void **state)
{
    struct pell_light *l;
    struct rig r;
    struct texel *texels;
    size_t count;
    const size_t m = 0;
    (void) state;
    rig_start(&r, SIZE, SIZE);
    r.ideal = true;
    rig_material(&r, false);
    rig_sphere(&r, m, 0, vec3(0, 0, 0), 25.0f, 200);
    rig_camera(&r, 60.0f);
    l = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 1.0f);
    l->image = add_picture(&r, 512, 256, 0.1f, 1.5e4f);
    l->rotate = 3.5f;
    r.settings.ambient_samples = 1;
    rig_render(&r);
    texels = list_texels(&r.scene->lights[0], &count);
    for (int y = 2; y < SIZE; y += 3)
        for (int x = 2; x < SIZE; x += 3)
            if (r.surface.material[rig_at(&r, x, y)]) {
                double want[3];
                brute_irradiance(&r, texels, count, rig_normal(&r, x, y), m, 0.0, 0.5f, want);
                for (int c = 0; c < 3; c++)
                    REQUIRE_REL(r.light.irradiance[c][rig_at(&r, x, y)], want[c], 5e-3);
            }
    free(texels);
    rig_finish(&r);
}

/* A run of 2^bits indices has one sample in each cell of the square, and the rays of one index use the cell that contains it. */
static void the_sky_is_looked_at_in_parts(void **state)
{
    (void) state;
    for (int bits = 0; bits <= PELL_SKY_BITS; bits++)
        for (uint32_t first = 0; first < 256; first += 1u << bits) {
            uint32_t parts = 0;
            for (uint32_t n = first; n < first + (1u << bits); n++)
                parts |= 1u << pell_sky_cell(pell_sobol0(n), pell_sobol1(n), bits);
            REQUIRE(parts == (1u << (1u << bits)) - 1u);
        }
    for (int level = 0; level <= (int) pell_simd_best(); level++) {
        const struct pell_sky_kernels *kernels = pell_sky_kernels_tables[level];
        struct pell_lanes lanes = { .any_smooth = 0 };
        struct pell_sky sky = { .bits = 2 };
        uint32_t number[2][1 << PELL_SKY_BITS] = { { 0 } };
        struct pell_ray16 rays;
        for (int i = 0; i < PELL_LANES; i++) {
            const struct pell_vec3 n = vec3_normalize(vec3(0.3f * (float) (i - 7), 1.0f - 0.2f * (float) i, (float) (i % 3) - 1.2f));
            lanes.hash[0][i] = pell_hash((uint32_t) i);
            lanes.hash[1][i] = pell_hash((uint32_t) i + 100u);
            sky.normal[0][i] = n.x;
            sky.normal[1][i] = n.y;
            sky.normal[2][i] = n.z;
            for (int c = 0; c < 3; c++)
                sky.origin[c][i] = (float) (i + c);
        }
        kernels->make(&lanes, 4, 7u, &sky);
        for (uint32_t n = 8; n < 12; n++) {
            const uint32_t part = pell_sky_cell(pell_sobol0(n), pell_sobol1(n), 2);
            number[0][part] = pell_sobol0(n);
            number[1][part] = pell_sobol1(n);
        }
        for (uint32_t j = 0; j < 4; j++) {
            kernels->rays(&sky, (const uint32_t(*)[1 << PELL_SKY_BITS]) number, j, &rays);
            for (int i = 0; i < PELL_LANES; i++) {
                const struct pell_vec3 n = vec3(sky.normal[0][i], sky.normal[1][i], sky.normal[2][i]),
                                       d = vec3(rays.dx[i], rays.dy[i], rays.dz[i]);
                struct pell_vec3 t, b;
                vec3_basis(n, &t, &b);
                REQUIRE_NEAR(vec3_length(d), 1.0, 1e-5);
                REQUIRE(vec3_dot(d, n) > 0.0f && rays.oy[i] == (float) (i + 1));
                /* cell j of the square is a quadrant of the disc */
                REQUIRE((vec3_dot(d, t) > 0.0f) == (j >> 1 & 1u) && (vec3_dot(d, b) > 0.0f) == (j & 1u));
            }
        }
    }
}

/* The depth of the sun's shadow is its fraction of the environment, and the environment is reduced by its occluders. */
static void environment_shadows(void **state)
{
    struct pell_light *l;
    struct rig r;
    double open, shadow;
    (void) state;
    start_plane(&r);
    rig_box(&r, 0, 1, vec3(-60, -60, 30), vec3(0, 60, 31)); /* a roof over half of the plane, visible only from below */
    r.scene->cameras[0].position[2] = 20.0f;
    l = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 1.0f);
    l->image = add_picture(&r, 512, 256, 0.2f, 1.5e4f);
    l->rotate = 0.0f;
    r.settings.ambient_samples = 64;
    rig_render(&r);
    open = r.light.irradiance[0][rig_at(&r, SIZE - 2, SIZE / 2)];
    shadow = r.light.irradiance[0][rig_at(&r, 2, SIZE / 2)];
    REQUIRE(open > 0.0 && shadow >= 0.0 && shadow < 0.9 * open);
    rig_finish(&r);
}

/* A window of 20 by 14 degrees in an otherwise dark image, whose single light has the same extent: across the edge of a roof the
 * penumbra is that of its texels, and where the whole window is visible its samples have equal values. */
static void lights_of_an_environment_have_half_shadows(void **state)
{
    enum { SAMPLES = 64 };
    const float roof = 30.0f, edge = 0.0f;
    double mean[SIZE] = { 0.0 }, want[SIZE] = { 0.0 }, all = 0.0, bright = 0.0;
    struct pell_light *l;
    struct rig r;
    struct texel *texels;
    size_t count;
    int half = 0;
    (void) state;
    start_plane(&r);
    rig_box(&r, 0, 1, vec3(-60, -60, roof), vec3(edge, 60, roof + 0.01f));
    r.scene->cameras[0].position[2] = 20.0f;
    l = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 1.0f);
    l->image = add_picture(&r, 720, 360, 0.0f, 0.0f);
    for (int y = 152; y < 180; y++)
        for (int x = 352; x < 392; x++)
            for (int c = 0; c < 3; c++)
                ((float *) l->image->image.pixels)[3 * (y * 720 + x) + c] = 100.0f + 0.75f * (float) (x - 352);
    l->rotate = (float) PELL_PI; /* the image's centre is above the plane */
    r.settings.environment_lights = 1;
    r.settings.msaa = SAMPLES;
    r.settings.ambient_samples = 1024;
    rig_render(&r);
    REQUIRE(r.lights->num_sources == 1 && !r.lights->sources[0].compact);
    for (r.sample = 0; r.sample < SAMPLES; r.sample++) {
        const struct pell_irradiance_params p = rig_params(&r);
        OK(pell_irradiance_render(r.pool, r.lights, &p, &r.light));
        for (int x = 0; x < SIZE; x++)
            mean[x] += r.light.irradiance[0][rig_at(&r, x, SIZE / 2)] / SAMPLES;
        bright = fmax(bright, r.light.irradiance[0][rig_at(&r, SIZE - 1, SIZE / 2)]);
    }
    texels = list_texels(l, &count);
    for (size_t i = 0; i < count; i++)
        all += texels[i].rgb[0] * texels[i].z * (texels[i].z > 0.0f);
    for (int x = 0; x < SIZE; x++) {
        const struct pell_vec3 at = rig_point(&r, x, SIZE / 2);
        for (size_t i = 0; i < count; i++) {
            const float far = (roof - at.z) / texels[i].z;
            want[x] += texels[i].z > 0.0f && at.x + far * texels[i].x > edge ? texels[i].rgb[0] * texels[i].z : 0.0;
        }
        half += want[x] > 0.1 * all && want[x] < 0.9 * all;
        REQUIRE_NEAR(mean[x], want[x], 0.05 * all);
    }
    REQUIRE(half > SIZE / 8);
    REQUIRE_REL(bright, mean[SIZE - 1], 0.01);
    free(texels);
    rig_finish(&r);
}

/* Reflection of a uniform environment by a perfect mirror-like metal equals the environment; the environment's lights add no second
 * highlight. */
static void a_metal_sphere_reflects_a_uniform_environment(void **state)
{
    for (int model = 0; model < PELL_SPECULAR_MODELS; model++) {
        struct rig r;
        size_t m;
        (void) state;
        rig_start(&r, SIZE, SIZE);
        m = rig_material(&r, true);
        r.scene->materials[m].rho_s = 1.0f;
        r.scene->materials[m].metallic = 1.0f;
        r.scene->materials[m].roughness = 0.1f;
        r.scene->materials[m].specular = (enum pell_specular_model) model;
        rig_sphere(&r, m, 0, vec3(0, 0, 0), 25.0f, 64);
        rig_camera(&r, 60.0f);
        rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 2.0f);
        rig_render(&r);
        /* the pixel's centre lies half a pixel from the sphere's; narrow Blinn lobes lose as mu^2 does */
        REQUIRE_REL(r.light.specular[0][rig_at(&r, SIZE / 2, SIZE / 2)], 2.0 * material_albedo_f0(r.tables, m, 1.0f, 1.0f, 0.1f), 2e-3);
        REQUIRE(r.light.irradiance[0][rig_at(&r, SIZE / 2, SIZE / 2)] == 0.0f); /* a metal has no medium below */
        rig_finish(&r);
    }
}

/* A highlight is shape x F x n.l x light: one pixel by hand. */
static void a_highlight_is_the_lobe(void **state)
{
    for (int model = 0; model < PELL_SPECULAR_MODELS; model++) {
        const struct pell_vec3 at = vec3(40.0f, 15.0f, 90.0f);
        struct rig r;
        size_t m;
        (void) state;
        rig_start(&r, SIZE, SIZE);
        m = rig_material(&r, false);
        r.scene->materials[m].rho_s = 0.6f;
        r.scene->materials[m].roughness = 0.4f;
        r.scene->materials[m].specular = (enum pell_specular_model) model;
        r.scene->materials[m].medium.eta = 1.4;
        rig_plane(&r, m, 0, 0.0f, 100.0f);
        rig_camera(&r, 60.0f);
        rig_light(&r, PELL_LIGHT_POINT, at, vec3(0, 0, 0), 3.0f);
        rig_render(&r);
        for (int x = 0; x < SIZE; x += 3) {
            const struct pell_vec3 d = vec3_sub(at, rig_point(&r, x, x)), l = vec3_normalize(d);
            const double to_l[3] = { l.x, l.y, l.z }, up[3] = { 0.0, 0.0, 1.0 };
            const float f0 = (0.4f / 2.4f) * (0.4f / 2.4f);
            const double e = 3e6 / (double) vec3_dot(d, d) * l.z;
            REQUIRE_REL(r.light.specular[0][rig_at(&r, x, x)],
                        0.6 * pell_specular_value((enum pell_specular_model) model, 0.4, f0, up, to_l, up) * e, 1e-4);
            REQUIRE_REL(r.light.irradiance[0][rig_at(&r, x, x)], (1.0 - 0.6 * material_albedo(r.tables, m, l.z, 0.4f)) * e, 1e-4);
        }
        rig_finish(&r);
    }
}

/* The radiance that a plane at z = 0 reflects upwards from an area light, by 96 x 96 points of the light. A roof at z = 75 hides what is
 * seen through x < `edge` of it. */
static double mirrored_face(const struct pell_light *light, enum pell_specular_model model, float roughness, float f0, struct pell_vec3 at,
                            float edge)
{
    enum { POINTS = 96, ROOF = 75 };
    const bool disc = light->type == PELL_LIGHT_DISC;
    const double half_x = disc ? light->radius : 0.5 * (double) light->width, half_y = disc ? light->radius : 0.5 * (double) light->height;
    const double up[3] = { 0.0, 0.0, 1.0 };
    double sum = 0.0;

    for (int k = 0; k < POINTS * POINTS; k++) { /* the light hangs above and faces down */
        const double x = 2.0 * (k % POINTS + 0.5) / POINTS - 1.0, y = 2.0 * (k / POINTS + 0.5) / POINTS - 1.0;
        const struct pell_vec3 d = vec3_sub(vec3(light->position[0] + (float) (x * half_x), light->position[1] + (float) (y * half_y),
                                                 light->position[2]),
                                            at),
                               l = vec3_normalize(d);
        const double to_l[3] = { l.x, l.y, l.z };
        if ((!disc || x * x + y * y <= 1.0) && at.x + d.x * ((float) ROOF - at.z) / d.z >= edge)
            sum += pell_specular_value(model, (double) roughness, (double) f0, up, to_l, up) * (double) (l.z * l.z / vec3_dot(d, d));
    }
    return (double) light->power[0] * sum * 4.0 * half_x * half_y / (POINTS * POINTS);
}

#define NO_ROOF -1000.0f

/* Highlights of a face of 40 mm at 90 mm on a plane, over the integrals of the lobe: their mean, and their noise over the mean of the
 * integrals; `open`: fraction of the light that the roof of mirrored_face does not hide. */
struct highlight_error {
    double mean, noise, open;
};

static struct highlight_error compare_highlights(enum pell_specular_model model, bool disc, float rough, float edge)
{
    const float f0 = (0.4f / 2.4f) * (0.4f / 2.4f);
    double found = 0.0, expected = 0.0, squares = 0.0, whole = 0.0, n = 0.0;
    struct pell_light *light;
    struct rig r;
    size_t m;

    rig_start(&r, SIZE, SIZE);
    m = rig_material(&r, false);
    r.scene->materials[m].rho_s = 1.0f;
    r.scene->materials[m].roughness = rough;
    r.scene->materials[m].specular = model;
    r.scene->materials[m].medium.eta = 1.4;
    rig_plane(&r, m, 0, 0.0f, 100.0f);
    rig_camera(&r, 60.0f);
    if (edge > NO_ROOF) {
        rig_box(&r, m, 1, vec3(-90, -90, 75), vec3(edge, 90, 75.01f));
        r.scene->cameras[0].position[2] = 20.0f; /* below the roof */
    }
    light = rig_light(&r, disc ? PELL_LIGHT_DISC : PELL_LIGHT_RECT, vec3(6, 4, 90), vec3(6, 4, 0), 50.0f);
    light->width = light->height = 40.0f;
    light->radius = 20.0f;
    r.settings.light_samples = 16;
    rig_render(&r);
    for (int y = 1; y < SIZE; y += 3)
        for (int x = 1; x < SIZE; x += 3) {
            const struct pell_vec3 at = rig_point(&r, x, y);
            const double v = r.light.specular[0][rig_at(&r, x, y)], e = mirrored_face(light, model, rough, f0, at, edge);
            whole += edge > NO_ROOF ? mirrored_face(light, model, rough, f0, at, NO_ROOF) : e;
            found += v;
            expected += e;
            squares += (v - e) * (v - e);
            n++;
        }
    rig_finish(&r);
    return (struct highlight_error) { found / expected, sqrt(squares / n) / (expected / n), expected / whole };
}

/* Highlights of area lights are the integral of the lobe over the light, with little noise, however narrow the lobe. */
static void highlights_of_faces_are_integrals(void **state)
{
    static const float roughness[] = { 0.12f, 0.3f, 0.6f };

    (void) state;
    RELEASE_ONLY();
    for (int k = 0; k < PELL_SPECULAR_MODELS * 2 * (int) PELL_COUNT(roughness); k++) {
        const enum pell_specular_model model = (enum pell_specular_model)(k % PELL_SPECULAR_MODELS);
        const bool disc = k / PELL_SPECULAR_MODELS % 2 == 1;
        const float rough = roughness[k / PELL_SPECULAR_MODELS / 2];
        const struct highlight_error e = compare_highlights(model, disc, rough, NO_ROOF);

        print_message("# %s, %s, roughness %.2f: mean %.4f of the integral, noise %.3f of the mean\n", pell_specular_name(model),
                      disc ? "disc" : "rect", (double) rough, e.mean, e.noise);
        REQUIRE_REL(e.mean, 1.0, 0.015);
        REQUIRE(e.noise < (model == PELL_SPECULAR_PHONG ? 0.25 : 0.09)); /* by light points alone 0.22 */
    }
}

/* The same below a roof over a part of the light: the lobe's own directions are occluded, not the whole light in proportion. */
static void occluded_highlights_are_integrals(void **state)
{
    static const enum pell_specular_model models[] = { PELL_SPECULAR_GGX, PELL_SPECULAR_KELEMEN, PELL_SPECULAR_BLINN_PHONG };

    (void) state;
    RELEASE_ONLY();
    for (size_t k = 0; k < 2 * PELL_COUNT(models); k++) {
        const bool disc = k % 2 == 1;
        const struct highlight_error e = compare_highlights(models[k / 2], disc, 0.12f, 3.0f);

        print_message("# %s, %s, occluded: mean %.4f of the integral, noise %.3f of the mean\n", pell_specular_name(models[k / 2]),
                      disc ? "disc" : "rect", e.mean, e.noise);
        REQUIRE(e.open > 0.3 && e.open < 0.7);
        REQUIRE_REL(e.mean, 1.0, 0.02);
        REQUIRE(e.noise < 0.15); /* by the visible fraction of the light's points 0.45 */
    }
}

static void what_emits_adds_its_radiance(void **state)
{
    struct rig r;
    (void) state;
    start_plane(&r);
    r.scene->materials[0].emissive[1] = 3.5f;
    rig_render(&r);
    REQUIRE_REL(r.light.specular[1][rig_at(&r, 10, 10)], 3.5, 1e-6);
    REQUIRE(r.light.specular[0][rig_at(&r, 10, 10)] == 0.0f);
    rig_finish(&r);
}

/* albedo^m at entry. */
static void the_mix_exponent_colours_what_enters(void **state)
{
    static const float mixes[] = { 0.0f, 0.3f, 0.5f, 1.0f };
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(mixes); k++) {
        struct rig r;
        size_t m;
        rig_start(&r, SIZE, SIZE);
        m = rig_material(&r, false);
        r.scene->materials[m].color_from = PELL_COLOR_FROM_TEXTURE;
        r.scene->materials[m].mix = mixes[k];
        r.scene->materials[m].base_color[0] = 0.25f;
        rig_plane(&r, m, 0, 0.0f, 100.0f);
        rig_camera(&r, 60.0f);
        rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 1), vec3(0, 0, 0), 1.0f);
        rig_render(&r);
        REQUIRE_REL(r.light.irradiance[0][rig_at(&r, 9, 9)], pow(0.25, mixes[k]), 1e-5);
        rig_finish(&r);
    }
}

/* Lights as plain data equal the prepared lights, in their order; the image is its index among the scene's textures. */
static void plain_data_is_the_light(void **state)
{
    static const enum pell_light_type types[] = { PELL_LIGHT_POINT, PELL_LIGHT_SPOT, PELL_LIGHT_DIRECTIONAL,
                                                  PELL_LIGHT_RECT,  PELL_LIGHT_DISC, PELL_LIGHT_ENVIRONMENT };
    size_t compact = 0, images = 0;
    struct rig r;
    (void) state;

    rig_start(&r, 4, 4);
    rig_plane(&r, rig_material(&r, true), 0, 0.0f, 10.0f);
    for (size_t i = 0; i < PELL_COUNT(types); i++) {
        struct pell_light *light = rig_light(&r, types[i], vec3(1, 2, 5), vec3(0, 0.5f, 0), 1.0f + (float) i);
        light->range = 40.0f;
        light->width = light->height = light->radius = 3.0f;
        if (types[i] == PELL_LIGHT_SPOT || types[i] == PELL_LIGHT_ENVIRONMENT)
            light->image = add_picture(&r, 64, 32, 0.2f, 500.0f);
    }
    OK(pell_pool_create(r.ctx, 2, &r.pool));
    OK(pell_lights_create(r.ctx, r.scene, &r.settings, r.pool, &r.lights));
    REQUIRE(r.lights->num_sources > PELL_COUNT(types));
    for (size_t i = 0; i < r.lights->num_sources; i++) {
        const struct pell_light_source *l = &r.lights->sources[i];
        const struct pell_light_data *d = &r.lights->data[i];
        const float expected[] = { l->position.x,  l->position.y,  l->position.z, l->scale,      l->direction.x, l->direction.y,
                                   l->direction.z, l->inv_range,   l->right.x,    l->right.y,    l->right.z,     l->image_u,
                                   l->up.x,        l->up.y,        l->up.z,       l->image_v,    l->power[0],    l->power[1],
                                   l->power[2],    l->sample_area, l->spot_scale, l->spot_offset };
        assert_memory_equal(d, expected, sizeof(expected));
        assert_int_equal(d->type, l->type);
        assert_int_equal(d->samples, l->samples);
        assert_int_equal(d->environment, l->environment);
        assert_int_equal(d->light, l->light);
        assert_true(d->image < 0 ? l->image == NULL : r.scene->textures[d->image] == l->image);
        assert_int_equal(d->flags, l->compact ? PELL_LIGHT_DATA_COMPACT : 0u);
        compact += d->flags != 0;
        images += d->image >= 0;
    }
    REQUIRE(compact > 0 && images == 1);
    pell_lights_destroy(&r.lights);
    pell_pool_destroy(&r.pool);
    pell_scene_destroy(&r.scene);
    pell_context_destroy(&r.ctx);
}

static void nth_allocation_fails_cleanly(void **state)
{
    uint64_t n = 0;
    (void) state;
    for (enum pell_result res = PELL_ERR_NOMEM; res != PELL_OK;) {
        struct pell_alloc_fault fault = { 0 };
        struct rig r;
        struct pell_pool *pool;
        struct pell_lights *lights;
        rig_start(&r, 4, 4);
        pell_scene_destroy(&r.scene);
        pell_context_destroy(&r.ctx);
        r.ctx = test_context(&fault, NULL);
        OK(pell_scene_create(r.ctx, &r.scene));
        rig_plane(&r, rig_material(&r, true), 0, 0.0f, 10.0f);
        for (int i = 0; i < 9; i++)
            rig_light(&r, PELL_LIGHT_POINT, vec3(0, 0, 5), vec3(0, 0, 0), 1.0f);
        rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 5), vec3(0, 0, 0), 1.0f)->image = add_picture(&r, 64, 32, 0.2f, 500.0f);
        rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 5), vec3(0, 0, 0), 1.0f);
        OK(pell_pool_create(r.ctx, 2, &pool));
        n = next_allocation(n);
        fault.fail_at = fault.calls + n;
        res = pell_lights_create(r.ctx, r.scene, &r.settings, pool, &lights);
        fault.fail_at = 0;
        REQUIRE((res == PELL_OK) == (lights != NULL));
        REQUIRE(res == PELL_OK || res == PELL_ERR_NOMEM);
        pell_lights_destroy(&lights);
        pell_lights_destroy(&lights);
        pell_pool_destroy(&pool);
        pell_scene_destroy(&r.scene);
        pell_context_destroy(&r.ctx);
        assert_int_equal(fault.live, 0);
    }
    print_message("# %d allocations at most\n", (int) n - 1);
    REQUIRE(n > 15);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plane_under_a_point),
        cmocka_unit_test(a_range_cuts_a_point_off),
        cmocka_unit_test(plane_under_a_spot),
        cmocka_unit_test(plane_under_a_directional),
        cmocka_unit_test(plane_under_a_rectangle),
        cmocka_unit_test(few_area_samples_are_unbiased),
        cmocka_unit_test(wide_lights_are_even),
        cmocka_unit_test(a_rectangle_is_clipped_at_the_horizon),
        cmocka_unit_test(a_disc_on_its_axis),
        cmocka_unit_test(occluders_throw_exact_shadows),
        cmocka_unit_test(an_image_is_projected),
        cmocka_unit_test(a_textured_rectangle_shines_in_its_colours),
        cmocka_unit_test(constant_environment),
        cmocka_unit_test(environment_sums_to_the_pictures_irradiance_studio),
        cmocka_unit_test(environment_sums_to_the_pictures_irradiance_sunset),
        cmocka_unit_test(a_sun_in_a_dim_environment_keeps_the_bound),
        cmocka_unit_test(environment_shadows),
        cmocka_unit_test(lights_of_an_environment_have_half_shadows),
        cmocka_unit_test(the_sky_is_looked_at_in_parts),
        cmocka_unit_test(a_metal_sphere_reflects_a_uniform_environment),
        cmocka_unit_test(a_highlight_is_the_lobe),
        cmocka_unit_test(highlights_of_faces_are_integrals),
        cmocka_unit_test(occluded_highlights_are_integrals),
        cmocka_unit_test(what_emits_adds_its_radiance),
        cmocka_unit_test(the_mix_exponent_colours_what_enters),
        cmocka_unit_test(plain_data_is_the_light),
        cmocka_unit_test(nth_allocation_fails_cleanly),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
