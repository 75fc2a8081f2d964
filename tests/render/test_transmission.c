/* SPDX-License-Identifier: MIT
 * test_transmission.c - light transmitted through thin parts, and invariants of all lights together. */
#include "lights_rig.h"

#define SIZE (SLOW ? 16 : 32)

static const enum pell_light_type every_type[] = { PELL_LIGHT_POINT, PELL_LIGHT_SPOT, PELL_LIGHT_DIRECTIONAL,
                                                   PELL_LIGHT_RECT,  PELL_LIGHT_DISC, PELL_LIGHT_ENVIRONMENT };

/* A slab of material 0, z in [0, thickness], seen from above. */
static void start_slab(struct rig *r, float thickness)
{
    rig_start(r, SIZE, SIZE);
    rig_box(r, rig_material(r, false), 0, vec3(-100, -100, 0), vec3(100, 100, thickness));
    rig_camera(r, 40.0f);
}

/* Sum over points of the light's face of T(t) E(A), where the segment from p to the point leaves the slab's lower side at A. */
static double slab_under(const struct pell_light *l, struct pell_vec3 p, double thickness, int channel)
{
    const struct pell_vec3 at = vec3_load(l->position), up = vec3_load(l->up), axis = vec3_load(l->direction), right = vec3_cross(axis, up);
    const bool flat = l->type == PELL_LIGHT_RECT || l->type == PELL_LIGHT_DISC;
    const int n = flat ? 100 : 1;
    double sum = 0.0;
    if (l->type == PELL_LIGHT_DIRECTIONAL)
        return table_transmittance(thickness, channel) * l->power[channel] * axis.z;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double u = flat ? (i + 0.5) / n - 0.5 : 0.0, v = flat ? (j + 0.5) / n - 0.5 : 0.0;
            const double w = l->type == PELL_LIGHT_DISC ? 2.0 * l->radius : l->width,
                         h = l->type == PELL_LIGHT_DISC ? 2.0 * l->radius : l->height;
            const struct pell_vec3 s = vec3_mad(vec3_mad(at, (float) (u * w), right), (float) (v * h), up), d = vec3_sub(s, p);
            const double length = vec3_length(d), cosine = -d.z / length, a = length - thickness / cosine,
                         facing = -vec3_dot(d, axis) / length;
            double e = table_transmittance(thickness, channel) * l->power[channel] * cosine;
            if (l->type == PELL_LIGHT_DISC && u * u + v * v > 0.25)
                continue;
            if (flat) {
                e *= w * h / (n * n) * facing / (a * a);
            } else {
                const double ramp = fmin(fmax((facing - l->cos_outer) / (l->cos_inner - l->cos_outer), 0.0), 1.0);
                e *= 1e6 / (a * a) * (l->type == PELL_LIGHT_SPOT ? ramp * ramp : 1.0);
            }
            sum += e;
        }
    return sum;
}

static void slab_transmits_every_light(void **state)
{
    static const float thicknesses[] = { 0.5f, 2.0f, 5.0f };
    (void) state;
    for (size_t k = 0; k < 5; k++)
        for (size_t j = 0; j < PELL_COUNT(thicknesses); j++) {
            struct pell_light *l;
            struct rig r;
            start_slab(&r, thicknesses[j]);
            r.settings.light_samples = 1024;
            l = rig_light(&r, every_type[k], vec3(25, -15, -60), vec3(0, 0, 0), 2.0f);
            l->width = 20.0f;
            l->height = 30.0f;
            l->radius = 12.0f;
            rig_render(&r);
            for (int x = 1; x < SIZE; x += 6)
                for (int c = 0; c < 3; c++) {
                    const double want = slab_under(&r.scene->lights[0], rig_point(&r, x, 13), thicknesses[j], c);
                    REQUIRE_NEAR(r.light.transmitted[c][rig_at(&r, x, 13)], want, 4e-3 * want + 1e-6);
                    REQUIRE(r.light.irradiance[c][rig_at(&r, x, 13)] == 0.0f);
                }
            REQUIRE(r.light.transmitted[0][rig_at(&r, SIZE / 2, SIZE / 2)] > 0.0f);
            rig_finish(&r);
        }
}

/* A light that covers the whole lower hemisphere gives the light of a uniform one, at any distance: T(t) pi L. */
static void a_wide_light_is_even_light(void **state)
{
    (void) state;
    for (int k = 0; k < 2; k++) {
        struct pell_light *l;
        struct rig r;
        start_slab(&r, 0.5f);
        r.settings.light_samples = 1024;
        l = rig_light(&r, k ? PELL_LIGHT_DISC : PELL_LIGHT_RECT, vec3(0, 0, -40), vec3(0, 0, 0), 2.0f);
        l->width = l->height = 8000.0f;
        l->radius = 4000.0f;
        rig_render(&r);
        for (int c = 0; c < 3; c++) {
            const double uniform = PELL_PI * (double) l->power[c];
            REQUIRE_NEAR(r.light.transmitted[c][rig_at(&r, SIZE / 2, SIZE / 2)], uniform * table_transmittance(0.5, c),
                         0.05 * uniform * table_transmittance(0.5, c));
        }
        rig_finish(&r);
    }
}

static struct pell_texture *add_environment(struct rig *r)
{
    struct pell_texture *t;
    float *p;
    const int width = 512, height = 256;
    OK(pell_scene_add_texture(r->scene, "sky", &t));
    t->image = (struct pell_image) { width, height, 3, PELL_PIXEL_F32, false, NULL };
    p = pell_calloc(r->ctx, (size_t) width * (size_t) height * 3, sizeof(float));
    t->image.pixels = p;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            float *q = p + 3 * (y * width + x);
            const bool window = x > 100 && x < 160 && y > 60 && y < 170, sun = (x == 300 || x == 301) && y == 140;
            q[0] = 0.2f + 0.1f * (float) y / (float) height + (window ? 4.0f : 0.0f) + (sun ? 3000.0f : 0.0f);
            q[1] = 0.9f * q[0];
            q[2] = 0.3f + (window ? 2.0f : 0.0f);
        }
    return t;
}

/* Under uniform illumination the thin slab shows T(t) pi L; under an environment image, T(t) times the light that enters a
 * reversed slab. */
static void slab_transmits_an_environment(void **state)
{
    (void) state;
    for (int image = 0; image < 2; image++) {
        float entered[3] = { 0 }, transmitted[3] = { 0 };
        for (int turned = 0; turned < 2; turned++) {
            struct pell_light *l;
            struct rig r;
            start_slab(&r, 2.0f);
            r.settings.ambient_samples = 16;
            l = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 1.5f);
            l->power[1] = l->power[2] = 1.5f;
            l->image = image ? add_environment(&r) : NULL;
            l->rotate = turned ? PELL_PI_F : 0.0f; /* about y: swaps both sides */
            rig_render(&r);
            for (int c = 0; c < 3; c++)
                *(turned ? &entered[c] : &transmitted[c]) =
                    (turned ? r.light.irradiance : r.light.transmitted)[c][rig_at(&r, SIZE / 2, SIZE / 2)];
            rig_finish(&r);
        }
        for (int c = 0; c < 3; c++) {
            REQUIRE_REL(transmitted[c], entered[c] * table_transmittance(2.0, c), 5e-3);
            if (!image)
                REQUIRE_REL(entered[c], 1.5 * PELL_PI, 1e-3);
        }
    }
}

/* Transmitted light of the multisamples, their mean in `mean`; the largest deviation of one of them, relative to it. Returns the rays. */
static int64_t transmitted_by_samples(struct rig *r, double mean[SIZE * SIZE], double *off)
{
    static double all[4][SIZE * SIZE];
    int64_t rays = 0;

    for (int s = 0; s < 4; s++) {
        struct pell_irradiance_params p;
        r->sample = (uint32_t) s;
        p = rig_params(r);
        OK(pell_irradiance_render(r->pool, r->lights, &p, &r->light));
        rays += r->light.shadow_rays;
        for (int i = 0; i < SIZE * SIZE; i++)
            all[s][i] = (double) r->light.transmitted[0][rig_at(r, i % SIZE, i / SIZE)];
    }
    *off = 0.0;
    for (int i = 0; i < SIZE * SIZE; i++) {
        mean[i] = 0.25 * (all[0][i] + all[1][i] + all[2][i] + all[3][i]);
        for (int s = 0; s < 4; s++)
            *off = fmax(*off, fabs(all[s][i] / mean[i] - 1.0));
    }
    return rays;
}

/* Over the samples of a frame each pixel receives all lights of an environment, although weak lights take turns among the samples; this
 * needs fewer rays. The sun is strong, and contributes to every sample. */
static void lights_take_turns(void **state)
{
    static double turns[SIZE * SIZE], all[SIZE * SIZE];
    double off_turns, off_all;
    int64_t rays_turns, rays_all;
    int taking = 0, alone = 0;
    struct pell_texture *sky;
    struct rig r;
    (void) state;
    start_slab(&r, 2.0f);
    r.settings.msaa = 4;
    r.settings.ambient_samples = 4;
    sky = add_environment(&r);
    ((float *) sky->image.pixels)[3 * (140 * 512 + 300)] *= 10.0f; /* the sun */
    rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 1.5f)->image = sky;
    rig_render(&r);
    rays_turns = transmitted_by_samples(&r, turns, &off_turns);
    for (size_t i = 0; i < r.lights->num_sources; i++) {
        taking += r.lights->sources[i].turns == 4;
        alone += r.lights->sources[i].turns == 1;
        r.lights->sources[i].turns = 1;
    }
    REQUIRE(taking > 8 && alone > 0);
    rays_all = transmitted_by_samples(&r, all, &off_all);
    for (int i = 0; i < SIZE * SIZE; i++)
        REQUIRE_REL(turns[i], all[i], 1e-5);
    REQUIRE(off_turns > 1e-3 && off_turns < 0.25);
    REQUIRE(off_all < 1e-6);
    REQUIRE(rays_turns < rays_all);
    rig_finish(&r);
}

static void a_projected_image_shows_through_the_slab(void **state)
{
    struct pell_texture *t;
    struct pell_light *l;
    struct rig r;
    int lit = 0, dark = 0;
    (void) state;
    start_slab(&r, 1.0f);
    OK(pell_scene_add_texture(r.scene, "half", &t));
    t->image = (struct pell_image) { 2, 1, 1, PELL_PIXEL_F32, false, pell_zalloc(r.ctx, 2 * sizeof(float)) };
    ((float *) t->image.pixels)[1] = 1.0f;
    t->nearest = true;
    l = rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -1), vec3(0, 0, 0), 1.0f);
    l->up[0] = l->up[2] = 0.0f;
    l->up[1] = 1.0f;
    l->image = t;
    rig_render(&r);
    for (int x = 0; x < SIZE; x++) {
        const bool right = rig_point(&r, x, 5).x < 0.0f; /* along the light's direction, +z, the right is -x */
        const float got = r.light.transmitted[0][rig_at(&r, x, 5)];
        REQUIRE_NEAR(got, right ? table_transmittance(1.0, 0) : 0.0, 1e-3);
        lit += right;
        dark += !right;
    }
    REQUIRE(lit > 5 && dark > 5);
    rig_finish(&r);
}

/* Opaque bone and another solid block the light; a shell of the same object does not. */
static void inner_objects(void **state)
{
    static const struct {
        bool opaque;
        int object;
        size_t material;
        bool passes;
    } cases[] = { { true, 1, 1, false },  { true, 0, 1, false }, { false, 1, 0, false },
                  { false, 1, 1, false }, { false, 0, 0, true }, { false, 0, 1, true } };
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++)
        for (int sphere = 0; sphere < 2; sphere++) {
            struct rig r;
            float inside, outside;
            start_slab(&r, 6.0f);
            rig_material(&r, cases[k].opaque);
            if (sphere)
                rig_sphere(&r, cases[k].material, cases[k].object, vec3(0, 0, 3), 2.0f, 24);
            else
                rig_box(&r, cases[k].material, cases[k].object, vec3(-8, -8, 2), vec3(8, 8, 4));
            rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3(0.1f, 0, -1), vec3(0, 0, 0), 1.0f);
            rig_render(&r);
            inside = r.light.transmitted[0][rig_at(&r, SIZE / 2, SIZE / 2)];
            outside = r.light.transmitted[0][rig_at(&r, 1, 1)];
            REQUIRE_REL(outside, table_transmittance(6.0, 0) / sqrt(1.01), 1e-3);
            if (cases[k].passes)
                REQUIRE_REL(inside, outside, 1e-3);
            else
                REQUIRE(inside == 0.0f);
            rig_finish(&r);
        }
}

static void a_shadow_on_the_far_side_blocks(void **state)
{
    struct rig r;
    (void) state;
    start_slab(&r, 1.0f);
    rig_box(&r, rig_material(&r, true), 1, vec3(-50, -50, -30), vec3(0, 50, -29));
    rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -1), vec3(0, 0, 0), 1.0f);
    rig_render(&r);
    REQUIRE(r.light.transmitted[0][rig_at(&r, 2, 9)] == 0.0f);
    REQUIRE_REL(r.light.transmitted[0][rig_at(&r, SIZE - 3, 9)], table_transmittance(1.0, 0), 1e-3);
    rig_finish(&r);
}

static void opaque_objects_transmit_nothing(void **state)
{
    struct rig r;
    (void) state;
    start_slab(&r, 0.1f);
    r.scene->materials[0].opaque = true;
    for (size_t k = 0; k < PELL_COUNT(every_type); k++) {
        struct pell_light *l = rig_light(&r, every_type[k], vec3(0, 0, -50), vec3(0, 0, 0), 1.0f);
        l->width = l->height = l->radius = 5.0f;
    }
    rig_render(&r);
    for (int x = 0; x < SIZE; x++)
        REQUIRE(r.light.transmitted[1][rig_at(&r, x, x)] == 0.0f);
    rig_finish(&r);
}

static void falls_with_thickness_for_every_light(void **state)
{
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(every_type); k++) {
        float last[3] = { INFINITY, INFINITY, INFINITY };
        for (float t = 0.02f; t < 30.0f; t *= SLOW ? 2.5f : 1.5f) {
            struct pell_light *l;
            struct rig r;
            start_slab(&r, t);
            l = rig_light(&r, every_type[k], vec3(0, 0, -120), vec3(0, 0, 0), 1.0f);
            l->width = l->height = l->radius = 1.0f;
            rig_render(&r);
            for (int c = 0; c < 3; c++) {
                const float got = r.light.transmitted[c][rig_at(&r, SIZE / 2, SIZE / 2)];
                REQUIRE(got >= 0.0f && got <= last[c]);
                REQUIRE(t > 20.0f ? got == 0.0f : t < 2.0f ? got > 0.0f : true);
                last[c] = got;
            }
            rig_finish(&r);
        }
    }
}

/* --- All lights together ------------------------------------------------------------------------------------------------------ */

/* Slow: without the second environment, and with an environment image only where threads are tested: it takes longest to prepare. */
enum { WIDE = SLOW ? 48 : 80, HIGH = SLOW ? 34 : 56, LIGHTS = SLOW ? 11 : 12, PICTURE = 1 << 12, PICTURE_MOSTLY = SLOW ? 0 : PICTURE };
#define EVERY ((1u << LIGHTS) - 1)

/* A glossy sphere, with a thin slab next to it and a bone inside, under the lights of a bit mask. */
static void start_everything(struct rig *r, unsigned lights)
{
    size_t skin, bone;
    rig_start(r, WIDE, HIGH);
    skin = rig_material(r, false);
    bone = rig_material(r, true);
    r->scene->materials[skin].rho_s = 0.8f;
    r->scene->materials[skin].specular = PELL_SPECULAR_KELEMEN;
    r->scene->materials[skin].roughness = 0.3f;
    r->scene->materials[bone].rho_s = 0.5f;
    rig_sphere(r, skin, 0, vec3(-12, 0, 0), 10.0f, 40);
    rig_box(r, skin, 1, vec3(4, -15, -1), vec3(30, 15, 1));
    rig_sphere(r, bone, 2, vec3(18, 0, 6), 4.0f, 16);
    rig_camera(r, 40.0f);
    r->settings.ambient_samples = 4;
    r->settings.light_samples = 4;
    r->settings.environment_lights = 12;
    for (unsigned k = 0; k < 12; k++) {
        struct pell_light *l;
        if (!(lights & 1u << k))
            continue;
        l = rig_light(r, every_type[k % 6], k < 6 ? vec3(60, 40, 80) : vec3(-30, 50, -90), vec3(0, 0, 0), k % 6 < 2 ? 0.01f : 1.0f);
        l->width = l->height = 30.0f;
        l->radius = 20.0f;
        l->cos_inner = 0.99f;
        l->cos_outer = 0.97f;
        l->image = k == 5 && lights & PICTURE ? add_environment(r) : NULL;
    }
}

/* image(A) + image(B) = image(A + B), light by light. */
static void lights_add_up(void **state)
{
    const unsigned all = EVERY | PICTURE_MOSTLY;
    struct rig sum, one;
    double *total, *largest;
    size_t planes;
    (void) state;
    start_everything(&sum, all);
    rig_render(&sum);
    planes = 9 * (size_t) sum.surface.stride * HIGH;
    total = calloc(planes, sizeof(double));
    largest = calloc(planes, sizeof(double));
    for (unsigned k = 0; k < LIGHTS; k++) {
        start_everything(&one, 1u << k | PICTURE_MOSTLY);
        rig_render(&one);
        for (size_t i = 0; i < planes; i++) {
            total[i] += (double) one.light.irradiance[0][i];
            largest[i] = fmax(largest[i], one.light.irradiance[0][i]);
        }
        rig_finish(&one);
    }
    for (size_t i = 0; i < planes; i++)
        REQUIRE_NEAR(sum.light.irradiance[0][i], total[i], 4e-6 * (total[i] + largest[i]) + 1e-12);
    free(total);
    free(largest);
    rig_finish(&sum);
}

static struct pell_vec3 turn(struct pell_vec3 v)
{
    /* about (1, 2, 3)/sqrt(14) by 1.1 radians */
    const struct pell_vec3 k = vec3_normalize(vec3(1, 2, 3));
    const float c = cosf(1.1f), s = sinf(1.1f);
    return vec3_mad(vec3_mad(vec3_mul(v, c), s, vec3_cross(k, v)), (1.0f - c) * vec3_dot(k, v), k);
}

static void rotate_vector(float *v)
{
    vec3_store(turn(vec3_load(v)), v);
}

/* A light rotated together with the object gives the same light, from behind and from the front. */
static void everything_turned_looks_the_same(void **state)
{
    const unsigned lights = 0x7u | 0x7u << 6; /* without random samples; an environment rotates about y only */
    struct rig a, b;
    double front = 0.0, behind = 0.0;
    int differ = 0, covered = 0;
    (void) state;
    start_everything(&a, lights);
    rig_render(&a);
    start_everything(&b, lights);
    for (size_t m = 0; m < b.scene->num_meshes; m++)
        for (uint32_t v = 0; v < b.scene->meshes[m].num_vertices; v++) {
            rotate_vector(b.scene->meshes[m].position + 3 * v);
            rotate_vector(b.scene->meshes[m].normal + 3 * v);
        }
    for (size_t i = 0; i < b.scene->num_lights; i++) {
        rotate_vector(b.scene->lights[i].position);
        rotate_vector(b.scene->lights[i].direction);
        rotate_vector(b.scene->lights[i].up);
    }
    rotate_vector(b.scene->cameras[0].position);
    rotate_vector(b.scene->cameras[0].forward);
    rotate_vector(b.scene->cameras[0].up);
    rig_render(&b);
    for (int y = 0; y < HIGH; y++)
        for (int x = 0; x < WIDE; x++) {
            const size_t i = rig_at(&a, x, y);
            if (!a.surface.material[i] || a.surface.material[i] != b.surface.material[i])
                continue;
            covered++;
            for (int c = 0; c < 3; c++) {
                const double e = a.light.irradiance[c][i], t = a.light.transmitted[c][i];
                /* edges of shadows and of facets may change sides */
                differ += fabs(b.light.irradiance[c][i] - e) > 1e-3 * (e + 0.01) ||
                          fabs(b.light.transmitted[c][i] - t) > 1e-3 * (t + 0.01) ||
                          fabs(b.light.specular[c][i] - a.light.specular[c][i]) > 2e-3 * (a.light.specular[c][i] + 0.01);
                front += e;
                behind += t;
            }
        }
    REQUIRE(front > 100.0 && behind > 10.0 && covered > 500);
    REQUIRE(differ <= covered / 100);
    rig_finish(&a);
    rig_finish(&b);
}

static void the_same_bits_on_any_number_of_threads(void **state)
{
    struct rig a, b;
    (void) state;
    start_everything(&a, EVERY | PICTURE);
    a.threads = 1;
    rig_render(&a);
    for (int threads = SLOW ? 5 : 2; threads < 6; threads += 3) {
        start_everything(&b, EVERY | PICTURE);
        b.threads = threads;
        rig_render(&b);
        assert_memory_equal(a.light.irradiance[0], b.light.irradiance[0], 9 * (size_t) a.surface.stride * HIGH * sizeof(float));
        REQUIRE(a.light.shadow_rays == b.light.shadow_rays);
        rig_finish(&b);
    }
    rig_finish(&a);
}

static void seeds_and_samples_differ(void **state)
{
    struct rig a;
    float *before;
    size_t size;
    (void) state;
    start_everything(&a, 1u << 3);
    rig_render(&a);
    size = 9 * (size_t) a.surface.stride * HIGH * sizeof(float);
    before = malloc(size);
    for (int k = 0; k < 3; k++) {
        memcpy(before, a.light.irradiance[0], size);
        a.seed = k == 0 ? 1 : 0;
        a.sample = k == 1 ? 1 : 0;
        rig_render(&a);
        REQUIRE(memcmp(before, a.light.irradiance[0], size) != 0);
    }
    free(before);
    rig_finish(&a);
}

/* Along the equator of a sphere from full light over the terminator to the dark side: no step, no bright line, no NaN. */
static void the_terminator_is_smooth(void **state)
{
    static const float radii[] = { 1.0f, 4.0f, 20.0f };
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(radii); k++) {
        const int width = 256, row = 8;
        struct rig r;
        rig_start(&r, width, 2 * row);
        rig_sphere(&r, rig_material(&r, false), 0, vec3(0, 0, 0), radii[k], 400);
        rig_camera(&r, radii[k] * 2.02f * 2 * row / width);
        rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3(1, 0, 0), vec3(0, 0, 0), 1.0f);
        rig_render(&r);
        for (int x = 4; x < width - 4; x++) {
            const size_t i = rig_at(&r, x, row);
            const double n = rig_normal(&r, x, row).x, e = r.light.irradiance[0][i], t = r.light.transmitted[0][i];
            const double before = r.light.irradiance[0][i - 1] + (double) r.light.transmitted[0][i - 1];
            REQUIRE(isfinite(e) && isfinite(t) && e >= 0.0 && t >= 0.0);
            REQUIRE_NEAR(e, fmax(n, 0.0), 8e-3);
            REQUIRE(n > 0.01 ? t == 0.0 : true);
            /* near the terminator the transmitted light vanishes faster than the entering light grows */
            REQUIRE(n < 0.0 && n > -0.3 ? t <= 2.0 * fabs(n) * n * n + 1e-3 : true);
            REQUIRE(fabs(e + t - before) < 0.02 + (fabs(n) > 0.9 ? 0.3 : 0.0));
        }
        if (getenv("PELL_PROFILE"))
            for (int x = 0; x < width; x++)
                print_message("# %g %g %g %g\n", (double) radii[k], (double) rig_normal(&r, x, row).x,
                              (double) r.light.irradiance[0][rig_at(&r, x, row)], (double) r.light.transmitted[0][rig_at(&r, x, row)]);
        rig_finish(&r);
    }
}

/* Where the triangle faces the light and the smooth normal does not, the segment to the light begins in air: a wall on this segment that
 * transmits the light counts as it does next to it, where the triangle faces away, too. */
static void a_wall_between_terminators(void **state)
{
    const float tilt = 0.2f, up = sqrtf(1.0f - tilt * tilt);
    (void) state;
    for (int wall = 0; wall < 2; wall++) {
        const struct pell_vec3 to = vec3_normalize(vec3(1.0f, 0.0f, 0.1f));
        size_t floor, m;
        struct rig r;
        rig_start(&r, SIZE, SIZE);
        m = rig_material(&r, false);
        floor = rig_box(&r, m, 0, vec3(-0.5f, -0.5f, 0), vec3(0.5f, 0.5f, 1)); /* small, so that its terminator offset is small */
        for (int k = 16; k < 20; k++)                                          /* its upper side */
            vec3_store(vec3(-tilt, 0.0f, up), &r.scene->meshes[floor].normal[3 * k]);
        if (wall)
            rig_box(&r, m, 0, vec3(1, -20, 1), vec3(1.5f, 20, 6));
        rig_camera(&r, 1.0f);
        rig_light(&r, PELL_LIGHT_DIRECTIONAL, to, vec3(0, 0, 0), 1.0f);
        rig_render(&r);
        for (int x = 2; x < SIZE - 2; x += 3) {
            const struct pell_vec3 c = rig_point(&r, x, SIZE / 2);
            const double m_mm = (1.5 - (double) c.x) / (double) to.x, cosine = (double) (tilt * to.x - up * to.z);
            const double want = wall ? table_transmittance(m_mm + (m_mm * cosine - m_mm) * (double) tilt, 0) * (double) to.x : 0.0;
            REQUIRE(r.light.irradiance[0][rig_at(&r, x, SIZE / 2)] == 0.0f);
            REQUIRE_NEAR(r.light.transmitted[0][rig_at(&r, x, SIZE / 2)], want, 0.02 * want);
            REQUIRE(!wall || want > 1e-3);
        }
        rig_finish(&r);
    }
}

static void grazing_lights_stay_finite(void **state)
{
    (void) state;
    for (int k = 0; k < 24; k += SLOW ? 5 : 1) {
        struct rig r;
        const float a = 0.26f * (float) k;
        start_slab(&r, 0.01f * (float) (1 + k));
        rig_sphere(&r, 0, 1, vec3(0, 0, 8), 6.0f, 12);
        r.scene->materials[0].rho_s = 1.0f;
        r.scene->materials[0].roughness = 0.03f;
        for (size_t j = 0; j < PELL_COUNT(every_type); j++) {
            struct pell_light *l = rig_light(&r, every_type[j], vec3(50 * cosf(a), 50 * sinf(a), k % 3 ? 1e-3f * (float) (k - 12) : 0.0f),
                                             vec3(0, 0, 0), 1e6f);
            l->width = l->height = l->radius = k % 2 ? 30.0f : 1e-3f;
        }
        rig_light(&r, PELL_LIGHT_POINT, vec3(0, 0, 0.005f), vec3(0, 0, 1), 1.0f);                                 /* inside the slab */
        rig_light(&r, PELL_LIGHT_POINT, vec3(-19.375f, 19.375f, 0.01f * (float) (1 + k)), vec3(0, 0, 99), 1e30f); /* on the surface */
        r.settings.light_samples = 2;
        r.settings.ambient_samples = 2;
        rig_render(&r);
        for (size_t i = 0; i < 9 * (size_t) r.surface.stride * SIZE; i++)
            REQUIRE(isfinite(r.light.irradiance[0][i]) && r.light.irradiance[0][i] >= 0.0f);
        rig_finish(&r);
    }
}

static void a_frame_allocates_nothing(void **state)
{
    struct rig r;
    uint64_t before;
    struct pell_irradiance_params p;
    (void) state;
    start_everything(&r, EVERY | PICTURE_MOSTLY);
    rig_render(&r);
    p = (struct pell_irradiance_params) {
        .rays = r.rays, .scene = r.scene, .view = &r.view, .surface = &r.surface, .tables = r.tables, .mix = -1.0f
    };
    before = pell_allocations(r.ctx);
    OK(pell_irradiance_render(r.pool, r.lights, &p, &r.light));
    assert_int_equal(pell_allocations(r.ctx), before);
    rig_finish(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slab_transmits_every_light),
        cmocka_unit_test(a_wide_light_is_even_light),
        cmocka_unit_test(slab_transmits_an_environment),
        cmocka_unit_test(lights_take_turns),
        cmocka_unit_test(a_projected_image_shows_through_the_slab),
        cmocka_unit_test(inner_objects),
        cmocka_unit_test(a_shadow_on_the_far_side_blocks),
        cmocka_unit_test(opaque_objects_transmit_nothing),
        cmocka_unit_test(falls_with_thickness_for_every_light),
        cmocka_unit_test(lights_add_up),
        cmocka_unit_test(everything_turned_looks_the_same),
        cmocka_unit_test(the_same_bits_on_any_number_of_threads),
        cmocka_unit_test(seeds_and_samples_differ),
        cmocka_unit_test(the_terminator_is_smooth),
        cmocka_unit_test(a_wall_between_terminators),
        cmocka_unit_test(grazing_lights_stay_finite),
        cmocka_unit_test(a_frame_allocates_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
