/* SPDX-License-Identifier: MIT
 * test_device_light.c - direct and transmitted light computed on a Vulkan device equal the cpu's, in each plane of the stage
 * "irradiance" and at points. Under the validation layer; skipped, by name, where there is no driver or no layer. */
#include "gpu_test.h"
#include "lights_rig.h"

#include "render/irradiance/device.h"
#include "render/unscattered/stage.h"
#include "scene/triangle.h"
#include "vulkan/core.h"

struct device {
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_gpu *gpu;
    struct pell_light_device *light;
};

static void device_start(struct device *d)
{
    memset(d, 0, sizeof(*d));
    d->ctx = gpu_context(NULL, &d->kept);
    d->gpu = gpu_opened(d->ctx);
    OK(pell_light_device_create(d->ctx, d->gpu, &d->light));
}

static void device_finish(struct device *d)
{
    pell_light_device_destroy(&d->light);
    gpu_finished(&d->ctx, &d->gpu, &d->kept);
}

/* --- Scenes ---------------------------------------------------------------------------------------------------------------------- */

static struct pell_texture *picture(struct rig *r, int width, int height, bool nearest)
{
    struct pell_texture *t;
    float *p;

    OK(pell_scene_add_texture(r->scene, "picture", &t));
    t->nearest = nearest;
    t->image = (struct pell_image) { width, height, 3, PELL_PIXEL_F32, false, NULL };
    t->image.pixels = p = pell_calloc(r->ctx, 3 * (size_t) width * (size_t) height, sizeof(*p));
    for (int i = 0; i < 3 * width * height; i++)
        p[i] = (float) (i * 7 % 11) / 11.0f + (i / 3 % (width + 1) == 1 ? 9.0f : 0.0f);
    return t;
}

/* Materials of all four lobe models, dull and narrow, optically thick, deep and thin, with smooth and flat normals, in each other's
 * shadow. */
static void many_surfaces(struct rig *r)
{
    size_t m[5];

    for (int i = 0; i < 5; i++) {
        m[i] = rig_material(r, i == 2 || i == 4);
        r->scene->materials[m[i]].specular = (enum pell_specular_model)(i % 4);
        r->scene->materials[m[i]].rho_s = 0.9f;
        r->scene->materials[m[i]].roughness = 0.15f + 0.2f * (float) i;
        r->scene->materials[m[i]].base_color[1] = 0.5f;
    }
    r->scene->materials[m[2]].metallic = 0.6f;
    r->scene->materials[m[4]].diffuse_transmission = 0.4f;
    rig_sphere(r, m[0], 0, vec3(-12, 8, 0), 9.0f, 10);
    rig_sphere(r, m[1], 1, vec3(12, 8, -4), 8.0f, 30);
    rig_box(r, m[2], 2, vec3(-20, -18, -10), vec3(-4, -6, 3));
    rig_box(r, m[3], 3, vec3(3, -18, -10), vec3(20, -8, -7));
    rig_plane(r, m[3], 4, -16.0f, 40.0f);
    shapes_quad(r->scene, m[4], vec3(0, 2, 6), vec3(5, 0, 0), vec3(0, 4, 3))->object = 5;
    rig_camera(r, 48.0f);
}

enum kind {
    POINT,
    SPOT,
    SUN,
    RECT,
    DISC,
    NEAR_RECT,
    NEAR_DISC,
    SPOT_IMAGE,
    POINT_IMAGE,
    SUN_IMAGE,
    RECT_IMAGE,
    SKY,
    SKY_IMAGE,
    ALL,
    KINDS
};

static const char *const kind_names[KINDS] = { "point",
                                               "spot",
                                               "directional",
                                               "rect",
                                               "disc",
                                               "rect, near",
                                               "disc, near",
                                               "spot with a picture",
                                               "point with a picture, nearest",
                                               "directional with a picture",
                                               "rect with a picture",
                                               "environment",
                                               "environment of a picture",
                                               "all of them" };

/* `behind`: a light behind the surfaces, toward the viewer. */
static void add_light(struct rig *r, enum kind kind, bool behind)
{
    static const enum pell_light_type types[KINDS] = { [POINT] = PELL_LIGHT_POINT,
                                                       [POINT_IMAGE] = PELL_LIGHT_POINT,
                                                       [SPOT] = PELL_LIGHT_SPOT,
                                                       [SPOT_IMAGE] = PELL_LIGHT_SPOT,
                                                       [SUN] = PELL_LIGHT_DIRECTIONAL,
                                                       [SUN_IMAGE] = PELL_LIGHT_DIRECTIONAL,
                                                       [RECT] = PELL_LIGHT_RECT,
                                                       [RECT_IMAGE] = PELL_LIGHT_RECT,
                                                       [NEAR_RECT] = PELL_LIGHT_RECT,
                                                       [DISC] = PELL_LIGHT_DISC,
                                                       [NEAR_DISC] = PELL_LIGHT_DISC,
                                                       [SKY] = PELL_LIGHT_ENVIRONMENT,
                                                       [SKY_IMAGE] = PELL_LIGHT_ENVIRONMENT };
    const bool near = kind == NEAR_RECT || kind == NEAR_DISC;
    const float z = behind ? -1.0f : 1.0f;
    struct pell_light *l = rig_light(r, types[kind], near ? vec3(2, -4, z * 14) : vec3(30, 50, z * 90), vec3(0, 0, 0), 3.0f);

    l->width = near ? 30.0f : 25.0f;
    l->height = l->radius = 20.0f;
    l->range = kind == POINT ? 160.0f : 0.0f;
    if (kind == SPOT_IMAGE || kind == POINT_IMAGE || kind == SUN_IMAGE || kind == RECT_IMAGE)
        l->image = picture(r, 5, 3, kind == POINT_IMAGE);
    if (kind == SKY_IMAGE)
        l->image = picture(r, 32, 16, false);
}

static void rig_begin(struct rig *r, int width, int height)
{
    rig_start(r, width, height);
    r->seed = 7;
    r->sample = 1;
    r->settings.msaa = 2;
    r->settings.light_samples = r->settings.ambient_samples = 8;
    r->settings.environment_lights = 6;
}

static void add_lights(struct rig *r, enum kind kind, bool behind)
{
    for (int k = 0; k < (int) ALL; k++)
        if (kind == ALL || (int) kind == k)
            add_light(r, (enum kind) k, behind);
}

static void rig_of(struct rig *r, enum kind kind, int width, int height)
{
    rig_begin(r, width, height);
    many_surfaces(r);
    add_lights(r, kind, false);
}

enum { COARSE = 7 }; /* mesh */

/* Backlit: a slab; two nested shells; a shell with an opaque object in it; a part of two materials; a coarse ball, and one behind a
 * transmitting object. */
static void rig_of_thin_parts(struct rig *r, int width, int height)
{
    size_t clear, other, wall;

    rig_begin(r, width, height);
    r->settings.light_samples = r->settings.ambient_samples = 4;
    clear = rig_material(r, false);
    other = rig_material(r, false);
    wall = rig_material(r, true);
    r->scene->materials[clear].rho_s = 0.9f;
    r->scene->materials[other].roughness = 0.2f;
    rig_box(r, clear, 0, vec3(-28, 4, -4), vec3(-8, 18, -1));
    rig_sphere(r, other, 1, vec3(0, 10, 0), 8.0f, 12);
    rig_sphere(r, other, 1, vec3(0, 10, 0), 6.0f, 12);
    rig_sphere(r, clear, 2, vec3(18, 10, 0), 7.0f, 12);
    rig_box(r, wall, 3, vec3(16, 8, -2), vec3(22, 12, 1));
    rig_box(r, clear, 4, vec3(-28, -16, -4), vec3(-18, -2, -2));
    rig_box(r, other, 4, vec3(-20, -15, -5), vec3(-8, -3, -1));
    rig_sphere(r, clear, 5, vec3(0, -9, 0), 7.0f, 6);
    rig_sphere(r, other, 6, vec3(18, -9, 0), 6.0f, 20);
    rig_sphere(r, other, 7, vec3(18, -9, -14), 2.0f, 8);
    rig_camera(r, 40.0f);
    add_lights(r, ALL, true);
}

/* --- Parity ---------------------------------------------------------------------------------------------------------------------- */

enum { SUMS = 5, PLANES = 3 * SUMS + 1 };

static void planes_of(struct pell_lighting *l, float **planes[PLANES])
{
    for (int c = 0; c < 3; c++) {
        planes[c] = &l->irradiance[c];
        planes[3 + c] = &l->specular[c];
        planes[6 + c] = &l->transmitted[c];
        planes[9 + c] = &l->hidden[c];
        planes[12 + c] = &l->lost[c];
    }
    planes[3 * SUMS] = &l->path;
}

static void set(struct device *d, const struct rig *r)
{
    OK(pell_light_device_set_scene(d->light, r->scene));
    OK(pell_light_device_set_lights(d->light, r->lights, r->tables));
    OK(pell_light_device_reserve(d->light, (size_t) r->surface.stride * (size_t) r->height));
    assert_null(pell_light_device_refuses(d->light));
}

/* Repeats the stage with direct light on the device. pell_free the first plane. */
static struct pell_lighting render_on(struct device *d, const struct rig *r, struct pell_pool *pool)
{
    struct pell_irradiance_params p = rig_params(r);
    struct pell_lighting l = { .path = NULL };
    float **planes[PLANES];

    planes_of(&l, planes);
    OK(pell_planes_allocate(r->ctx, r->width, r->height, planes, PLANES));
    p.device = d->light;
    OK(pell_irradiance_render(pool, r->lights, &p, &l));
    return l;
}

/* Kinds of light against the cpu's: the mean difference over the mean of all planes, and the fraction of pixels that differ by more than
 * 1 %. */
static void compare(const struct rig *r, struct pell_lighting *gpu, const char *name)
{
    static const char *const what[SUMS] = { "enters", "mirrored", "transmitted", "hidden", "lost" };
    struct pell_lighting cpu = r->light;
    const int64_t by_cpu = r->light.shadow_rays, by_gpu = gpu->device_rays + gpu->through_rays;
    float **a[PLANES], **b[PLANES];

    planes_of(&cpu, a);
    planes_of(gpu, b);
    for (int k = 0; k < SUMS; k++) {
        double sum = 0.0, difference = 0.0;
        int far = 0, pixels = 0;
        for (int y = 0; y < r->height; y++)
            for (int x = 0; x < r->width; x++) {
                const size_t at = rig_at(r, x, y);
                bool differs = false;
                for (int c = 3 * k; c < 3 * k + 3; c++) {
                    const double p = (double) (*a[c])[at], q = (double) (*b[c])[at];
                    sum += fabs(p);
                    difference += fabs(p - q);
                    differs |= fabs(p - q) > 0.01 * fabs(p) + 1e-6;
                }
                pixels += r->surface.material[at] != 0;
                far += differs;
            }
        print_message("# %s: %s: mean %.3g, mean difference %.2g of it, %d of %d pixels over 1 %%\n", name, what[k], sum / (3.0 * pixels),
                      sum > 0.0 ? difference / sum : 0.0, far, pixels);
        REQUIRE(pixels > 800);
        REQUIRE(difference <= 1e-4 * sum);
        REQUIRE(far * 1000 <= pixels);
    }
    /* All lights move from the cpu to the device. */
    print_message("# %s: %lld rays, of the cpu %lld\n", name, (long long) by_gpu, (long long) by_cpu);
    REQUIRE(by_gpu > 300 && gpu->shadow_rays == 0 && llabs((long long) (by_gpu - by_cpu)) * 1000 <= (long long) by_cpu);
}

enum { POINTS = 960 };

/* Points all over the surfaces, some invalid, some seen from behind; and their irradiance. */
struct points {
    uint32_t mesh[POINTS], triangle[POINTS], seed[POINTS];
    float u[POINTS], v[POINTS], ambient[POINTS];
    bool back[POINTS], valid[2][POINTS];
    float irradiance[2][3][POINTS], albedo[2][3][POINTS], transmission[2][3][POINTS];
};

static struct pell_surface_light light_of(struct points *p, int which)
{
    struct pell_surface_light out = { .valid = p->valid[which] };

    for (int c = 0; c < 3; c++) {
        out.irradiance[c] = p->irradiance[which][c];
        out.albedo[c] = p->albedo[which][c];
        out.transmission[c] = p->transmission[which][c];
    }
    return out;
}

static void scatter_points(const struct rig *r, struct points *p)
{
    uint32_t seed = 9;

    for (uint32_t i = 0; i < POINTS; i++) {
        const uint32_t mesh = i % (uint32_t) r->scene->num_meshes;
        const float f = shapes_random(&seed), g = shapes_random(&seed);
        struct pell_vec3 corner[3];
        p->triangle[i] = (uint32_t) (shapes_random(&seed) * 0.999f * (float) r->scene->meshes[mesh].num_triangles);
        pell_triangle_corners(&r->scene->meshes[mesh], p->triangle[i], corner);
        p->mesh[i] = i % 37 == 5 || !(vec3_length(pell_triangle_cross(corner)) > 1e-6f) ? PELL_NO_HIT : mesh;
        p->u[i] = sqrtf(f) * (1.0f - g);
        p->v[i] = sqrtf(f) * g;
        p->seed[i] = i / 3;
        p->ambient[i] = shapes_random(&seed);
        p->back[i] = r->scene->meshes[mesh].object == 5 && i % 2;
    }
}

/* Light at the points by the cpu, and in a batch on the device; the ambient visibility found by rays, or `known`. Returns the mean
 * difference over the mean. */
static double points_differ(struct device *d, const struct rig *r, uint64_t lights, bool known, double *mean)
{
    struct points *p = calloc(1, sizeof(*p));
    const struct pell_points_params what = { .lights = lights, .mix = -1.0f, .spacing = 0.5f, .first = 3, .samples = 2 };
    const struct pell_surface_points in = { p->mesh, p->triangle, p->u, p->v, p->seed, known ? p->ambient : NULL, p->back };
    const struct pell_surface_light cpu = light_of(p, 0), gpu = light_of(p, 1);
    struct pell_irradiance_params params = rig_params(r), of_run;
    uint32_t slot[POINTS / 16];
    int64_t rays[2];
    double sum = 0.0, difference = 0.0;

    scatter_points(r, p);
    rays[0] = pell_irradiance_points(r->lights, &params, &what, &in, POINTS, &cpu);
    params.device = d->light;
    of_run = params;
    of_run.lights = lights;
    pell_light_device_begin(d->light);
    for (size_t i = 0; i < POINTS; i += 16) {
        const struct pell_surface_points some = { p->mesh + i, p->triangle + i, p->u + i,
                                                  p->v + i,    p->seed + i,     known ? p->ambient + i : NULL,
                                                  p->back + i };
        slot[i / 16] = pell_irradiance_send_points(r->lights, &params, &what, &some, 16);
    }
    OK(pell_light_device_run(d->light, &(struct pell_light_run) { .params = &of_run }));
    rays[1] = 0;
    for (size_t i = 0; i < POINTS; i += 16) {
        const struct pell_surface_points some = { p->mesh + i, p->triangle + i, p->u + i,
                                                  p->v + i,    p->seed + i,     known ? p->ambient + i : NULL,
                                                  p->back + i };
        struct pell_surface_light out = { .valid = gpu.valid + i };
        for (int c = 0; c < 3; c++) {
            out.irradiance[c] = gpu.irradiance[c] + i;
            out.albedo[c] = gpu.albedo[c] + i;
            out.transmission[c] = gpu.transmission[c] + i;
        }
        rays[1] += pell_irradiance_take_points(r->lights, &params, &what, &some, 16, slot[i / 16], &out);
    }
    for (size_t i = 0; i < POINTS; i++) {
        REQUIRE(p->valid[0][i] == p->valid[1][i]);
        for (int c = 0; c < 3; c++) {
            REQUIRE(p->albedo[0][c][i] == p->albedo[1][c][i] && p->transmission[0][c][i] == p->transmission[1][c][i]);
            sum += fabs((double) p->irradiance[0][c][i]);
            difference += fabs((double) p->irradiance[0][c][i] - (double) p->irradiance[1][c][i]);
        }
    }
    REQUIRE((known || rays[0] > 100) && llabs((long long) (rays[0] - rays[1])) * 500 <= (long long) rays[0]);
    *mean = sum / (3.0 * POINTS);
    free(p);
    return sum > 0.0 ? difference / sum : difference;
}

static void compare_points(struct device *d, const struct rig *r, const char *name)
{
    double mean, one = 0.0, all;

    for (int known = 0; known < 2; known++) {
        const double differ = points_differ(d, r, 0, known, &mean);
        print_message("# %s: points: mean %.3g, mean difference %.2g of it\n", name, mean, differ);
        REQUIRE(mean > 0.0 && differ < 1e-4);
        all = mean;
    }
    if (r->scene->num_lights < 2)
        return;
    for (size_t i = 0; i < r->scene->num_lights; i++) { /* one after the other they sum to all light */
        REQUIRE(points_differ(d, r, pell_light_bit(i), true, &mean) < 1e-4);
        one += mean;
    }
    REQUIRE_NEAR(one / all, 1.0, 1e-4);
}

static void each_light_is_the_cpus(void **state)
{
    const int first = getenv("PELL_SANITIZED") ? (int) ALL : 0; /* all of them together use the same code */
    struct device d;
    (void) state;

    device_start(&d);
    for (int kind = first; kind < KINDS; kind++) {
        struct pell_lighting l;
        struct rig r;
        double some = 0.0;

        rig_of(&r, (enum kind) kind, 48, 36);
        r.smooth = kind % 3 == 1;
        r.solid = kind != ALL;
        rig_render(&r);
        for (size_t i = 0; i < (size_t) r.surface.stride * 36; i++)
            some += (double) r.light.irradiance[1][i];
        REQUIRE(some > 0.0);
        set(&d, &r);
        l = render_on(&d, &r, r.pool);
        compare(&r, &l, kind_names[kind]);
        pell_free(r.ctx, l.irradiance[0]);
        compare_points(&d, &r, kind_names[kind]);
        pell_light_device_drop_lights(d.light);
        pell_light_device_drop_scene(d.light);
        rig_finish(&r);
    }
    device_finish(&d);
}

/* A light, and an environment, that need more samples than a slice. */
static void slices_make_one_picture(void **state)
{
    struct pell_lighting l;
    struct device d;
    struct rig r;
    (void) state;

    device_start(&d);
    rig_begin(&r, 40, 30);
    r.settings.light_samples = r.settings.ambient_samples = 2 * PELL_LIT_SLICE + 4;
    many_surfaces(&r);
    add_light(&r, RECT, false);
    add_light(&r, SKY, false);
    rig_render(&r);
    set(&d, &r);
    l = render_on(&d, &r, r.pool);
    compare(&r, &l, "many samples");
    REQUIRE(l.through_rays > 300);
    pell_free(r.ctx, l.irradiance[0]);
    compare_points(&d, &r, "many samples");
    rig_finish(&r);
    device_finish(&d);
}

/* What overlapping slabs and nested shells pass into their shadows, in slices of many samples, too. */
static void media_pass_light_as_on_the_cpu(void **state)
{
    static const uint16_t index[] = { 0, 1, 1, 0, 1, 0 }; /* of materials: 2 and 4 are opaque */
    const struct pell_frame_material medium = {
        .medium = { .sigma_a = { 0.02, 0.05, 0.1 }, .sigma_s_reduced = { 0.01, 0.02, 0.03 }, .eta = 1.3 }, .name = "clear"
    };
    struct device d;
    (void) state;

    device_start(&d);
    for (int many = 0; many < 2; many++) {
        struct pell_unscattered *media;
        struct pell_lighting l;
        struct rig r;
        double with = 0.0, without = 0.0;

        rig_begin(&r, 48, 36);
        r.smooth = r.solid = many == 1;
        r.settings.light_samples = many ? 2 * PELL_LIT_PASSING + 2 : 3;
        many_surfaces(&r);
        rig_box(&r, 0, 6, vec3(-10.3f, -19.6f, 20), vec3(19.7f, 3.6f, 26));
        rig_box(&r, 0, 7, vec3(-29.3f, 0.1f, 22), vec3(-4.3f, 19.7f, 24));
        rig_sphere(&r, 1, 8, vec3(4, 4, 36), 8.0f, 12);
        rig_sphere(&r, 1, 8, vec3(4, 4, 36), 6.0f, 12);
        for (int kind = 0; kind < (int) ALL; kind++)
            if (!many || kind == RECT || kind == DISC)
                add_light(&r, (enum kind) kind, false);
        rig_render(&r);
        for (size_t i = 0; i < (size_t) r.surface.stride * 36; i++)
            without += (double) r.light.irradiance[0][i];
        OK(pell_unscattered_create(r.ctx, r.scene, r.rays, index, &medium, &media));
        assert_non_null(media);
        r.unscattered = media;
        rig_clear(&r);
        rig_render(&r);
        for (size_t i = 0; i < (size_t) r.surface.stride * 36; i++)
            with += (double) r.light.irradiance[0][i];
        print_message("# light %.4g, with what passes %.4g\n", without, with);
        REQUIRE(with > 1.02 * without);
        set(&d, &r);
        l = render_on(&d, &r, r.pool);
        compare(&r, &l, "passing");
        pell_free(r.ctx, l.irradiance[0]);
        pell_light_device_drop_lights(d.light);
        pell_light_device_drop_scene(d.light);
        pell_unscattered_destroy(&media);
        rig_finish(&r);
    }
    device_finish(&d);
}

/* Mean path length of transmitted light, where there is some. */
static void compare_path_lengths(const struct rig *r, const float *cpu, const float *gpu)
{
    double sum = 0.0, difference = 0.0;

    for (int y = 0; y < r->height; y++)
        for (int x = 0; x < r->width; x++) {
            sum += (double) cpu[rig_at(r, x, y)];
            difference += fabs((double) cpu[rig_at(r, x, y)] - (double) gpu[rig_at(r, x, y)]);
        }
    REQUIRE(sum > 0.0 && difference <= 1e-4 * sum);
}

/* Each light, and all of them. */
static void light_passes_as_on_the_cpu(void **state)
{
    float **planes[PLANES], *normals;
    struct device d;
    struct rig r;
    (void) state;

    device_start(&d);
    rig_of_thin_parts(&r, 60, 40);
    rig_render(&r);
    normals = r.scene->meshes[COARSE].normal; /* the mesh where light exits may have no normals */
    r.scene->meshes[COARSE].normal = NULL;
    pell_free(r.ctx, r.light.irradiance[0]);
    planes_of(&r.light, planes);
    OK(pell_planes_allocate(r.ctx, r.width, r.height, planes, PLANES));
    set(&d, &r);
    for (int kind = 0; kind < KINDS; kind++) {
        struct pell_irradiance_params p;
        struct pell_lighting gpu;
        double sum = 0.0;

        r.asked = kind == ALL ? 0 : pell_light_bit((size_t) kind);
        r.smooth = kind % 3 == 2;
        p = rig_params(&r);
        OK(pell_irradiance_render(r.pool, r.lights, &p, &r.light));
        gpu = render_on(&d, &r, r.pool);
        REQUIRE(gpu.through_rays > 300);
        compare(&r, &gpu, kind_names[kind]);
        compare_path_lengths(&r, r.light.path, gpu.path);
        for (size_t i = 0; i < (size_t) r.surface.stride * 40; i++)
            sum += (double) r.light.transmitted[0][i];
        REQUIRE(sum > 0.0);
        pell_free(r.ctx, gpu.irradiance[0]);
    }
    r.scene->meshes[COARSE].normal = normals;
    rig_finish(&r);
    device_finish(&d);
}

/* Where a buffer is too small for the tables, transmitted light alone is computed by the cpu, bit-identically. */
static void what_no_buffer_holds_passes_on_the_cpu(void **state)
{
    struct pell_lighting l;
    struct device d;
    struct rig r;
    (void) state;

    device_start(&d);
    rig_of_thin_parts(&r, 60, 40);
    r.asked = pell_light_bit(SPOT);
    rig_render(&r);
    set(&d, &r);
    d.gpu->limits.maxStorageBufferRange = 2 * 12 * PELL_THICKNESS_STEPS;
    l = render_on(&d, &r, r.pool);
    assert_string_equal(pell_light_device_refuses_transmission(d.light), "transmission by the cpu: more materials than a buffer holds");
    REQUIRE(l.through_rays == 0 && l.shadow_rays > 300 && l.device_rays > 30);
    REQUIRE(llabs((long long) (l.device_rays + l.shadow_rays - r.light.shadow_rays)) * 1000 <= (long long) r.light.shadow_rays);
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < r.height; y++)
            assert_memory_equal(l.transmitted[c] + rig_at(&r, 0, y), r.light.transmitted[c] + rig_at(&r, 0, y), 60 * sizeof(float));
    pell_free(r.ctx, l.irradiance[0]);
    rig_finish(&r);
    device_finish(&d);
}

/* More pixels than a batch can hold; and the bits do not depend on the number of threads, which share the batch's capacity. */
static void batches_make_one_picture(void **state)
{
    struct device d;
    struct pell_lighting one, many;
    struct pell_pool *pool;
    struct rig r;
    (void) state;

    device_start(&d);
    rig_of(&r, SPOT, 512, 192);
    r.settings.light_samples = 2;
    rig_render(&r);
    OK(pell_light_device_set_scene(d.light, r.scene));
    OK(pell_light_device_reserve(d.light, 1));
    OK(pell_light_device_set_lights(d.light, r.lights, r.tables));
    REQUIRE(pell_light_device_room(d.light) < 512 * 192);
    OK(pell_pool_create(r.ctx, 1, &pool));
    one = render_on(&d, &r, pool);
    many = render_on(&d, &r, r.pool);
    compare(&r, &one, "some batches");
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < r.height; y++) {
            assert_memory_equal(one.irradiance[c] + rig_at(&r, 0, y), many.irradiance[c] + rig_at(&r, 0, y), 512 * sizeof(float));
            assert_memory_equal(one.specular[c] + rig_at(&r, 0, y), many.specular[c] + rig_at(&r, 0, y), 512 * sizeof(float));
        }
    pell_free(r.ctx, one.irradiance[0]);
    pell_free(r.ctx, many.irradiance[0]);
    pell_pool_destroy(&pool);
    rig_finish(&r);
    device_finish(&d);
}

/* --- Features that the device lacks -------------------------------------------------------------------------------------------------- */

static void what_the_device_cannot_do_it_refuses(void **state)
{
    struct device d;
    struct rig r;
    (void) state;

    device_start(&d);
    rig_of(&r, SPOT, 48, 36);
    rig_render(&r);
    r.scene->materials[0].alpha_mask = true;
    r.scene->meshes[0].color = pell_calloc(r.ctx, 4 * (size_t) r.scene->meshes[0].num_vertices, sizeof(float));
    OK(pell_light_device_set_scene(d.light, r.scene));
    OK(pell_light_device_set_lights(d.light, r.lights, r.tables));
    OK(pell_light_device_reserve(d.light, 48 * 36));
    assert_string_equal(pell_light_device_refuses(d.light), "direct light by the cpu: alpha cuts surfaces");
    assert_true(pell_gpu_memory_used(d.gpu) == 0);
    r.scene->materials[0].alpha_mask = false;
    r.scene->meshes[0].overlaps = true;
    OK(pell_light_device_set_scene(d.light, r.scene));
    assert_string_equal(pell_light_device_refuses(d.light), "direct light by the cpu: parts of an object overlap");
    assert_true(pell_gpu_memory_used(d.gpu) == 0);
    r.scene->meshes[0].overlaps = false;
    set(&d, &r);
    assert_true(pell_gpu_memory_used(d.gpu) > 0);
    rig_finish(&r);
    device_finish(&d);
}

/* Each Vulkan call of creation and of a batch fails once: it is reported once, nothing remains on the device, and a retry succeeds. */
static enum pell_result make_all(struct device *d, const struct rig *r, struct pell_lighting *l)
{
    struct pell_irradiance_params p = rig_params(r);
    enum pell_result res;

    PELL_TRY(pell_light_device_create(d->ctx, d->gpu, &d->light));
    PELL_TRY(pell_light_device_set_scene(d->light, r->scene));
    PELL_TRY(pell_light_device_reserve(d->light, 48 * 36));
    PELL_TRY(pell_light_device_set_lights(d->light, r->lights, r->tables));
    p.device = d->light;
    return pell_irradiance_render(r->pool, r->lights, &p, l);

fail:
    return res;
}

static void calls_that_fail_are_reported(void **state)
{
    struct device d;
    struct rig r;
    struct pell_lighting l = { .path = NULL };
    float **planes[PLANES];
    int failed = 0;
    (void) state;

    device_start(&d);
    pell_light_device_destroy(&d.light);
    rig_of(&r, SPOT_IMAGE, 48, 36);
    rig_render(&r);
    planes_of(&l, planes);
    OK(pell_planes_allocate(r.ctx, r.width, r.height, planes, PLANES));
    for (uint64_t n = 1; failed == (int) n - 1; n++) {
        enum pell_result res;
        d.kept.errors = 0;
        pell_gpu_fail_at(d.gpu, n);
        res = make_all(&d, &r, &l);
        pell_gpu_fail_at(d.gpu, 0);
        REQUIRE(res == PELL_OK ? d.kept.errors == 0 : res == PELL_ERR_NOMEM && d.kept.errors == 1);
        failed += res != PELL_OK;
        pell_light_device_destroy(&d.light);
        assert_true(pell_gpu_memory_used(d.gpu) == 0);
    }
    print_message("# %d calls\n", failed);
    REQUIRE(failed > 60);
    d.kept.errors = 0;
    OK(make_all(&d, &r, &l));
    compare(&r, &l, "after failures");
    pell_free(r.ctx, l.irradiance[0]);
    rig_finish(&r);
    device_finish(&d);
}

/* The same for host allocations. */
static void allocations_that_fail_are_reported(void **state)
{
    struct pell_alloc_fault fault = { 0 };
    struct device d = { .light = NULL };
    struct rig r;
    bool done = false;
    (void) state;

    d.ctx = gpu_context(&fault, &d.kept);
    d.gpu = gpu_opened(d.ctx);
    rig_of(&r, SPOT_IMAGE, 48, 36);
    rig_render(&r);
    for (uint64_t n = 1; !done; n++) {
        fault.fail_at = atomic_load(&fault.calls) + n;
        done = pell_light_device_create(d.ctx, d.gpu, &d.light) == PELL_OK && pell_light_device_set_scene(d.light, r.scene) == PELL_OK &&
               pell_light_device_reserve(d.light, 48 * 36) == PELL_OK &&
               pell_light_device_set_lights(d.light, r.lights, r.tables) == PELL_OK;
        fault.fail_at = 0;
        pell_light_device_destroy(&d.light);
        assert_true(pell_gpu_memory_used(d.gpu) == 0);
    }
    d.kept.errors = 0;
    rig_finish(&r);
    device_finish(&d);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_light_is_the_cpus),
        cmocka_unit_test(slices_make_one_picture),
        cmocka_unit_test(light_passes_as_on_the_cpu),
        cmocka_unit_test(what_no_buffer_holds_passes_on_the_cpu),
        cmocka_unit_test(media_pass_light_as_on_the_cpu),
        cmocka_unit_test(batches_make_one_picture),
        cmocka_unit_test(what_the_device_cannot_do_it_refuses),
        cmocka_unit_test(calls_that_fail_are_reported),
        cmocka_unit_test(allocations_that_fail_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
