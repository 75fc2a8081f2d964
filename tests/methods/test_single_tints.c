/* SPDX-License-Identifier: MIT
 * test_single_tints.c - base colour textures at light entry and exit, for the methods with single scattering: layered and
 * single-scatter. */
#include "stage.h"

#include "layers_rig.h"

#include <string.h>

#define WIDE 8

static const char *const planar[] = { "samples=20", "tolerance=0", NULL }, *const rays[] = { "samples=20", "light-path=rays", NULL };
static const char *const exact[] = { "samples=20", "refraction=exact", NULL }, *const few[] = { "most=128", "error=1e-4", NULL };
static const struct {
    const char *method;
    const char *const *knobs;
} cases[] = { { "layered", planar }, { "layered", rays }, { "layered", exact }, { "single-scatter", few } };

/* A ball that fills the image. `colors`: texels of its base colour, `count` in a row; NULL: no texture. */
static void start(struct stage *s, double eta, float mix, const float (*colors)[3], int count)
{
    struct pell_material *m;
    size_t material;

    stage_start(s, WIDE, WIDE);
    m = stage_medium(s, "marble", &material);
    m->medium.eta = eta;
    m->mix = mix;
    m->rho_s = 0.0f;
    for (int c = 0; c < 3; c++) {
        m->medium.sigma_s_reduced[c] = 0.4 + 0.3 * c;
        m->medium.sigma_a[c] = 0.3;
        m->medium.g[c] = 0.3;
        m->base_color[c] = 1.0f;
    }
    m->color_from = colors ? PELL_COLOR_FROM_TEXTURE : PELL_COLOR_FROM_PROFILE;
    stage_ball(s, material, 0, vec3(0, 0, 0), 10.0f, 24);
    if (colors && count > 0) {
        struct pell_texture *t;
        OK(pell_scene_add_texture(s->scene, "painting", &t));
        t->image = (struct pell_image) { .width = count, .height = 1, .channels = 3, .type = PELL_PIXEL_F32 };
        t->image.pixels = pell_alloc_array(s->scene->ctx, 3 * (size_t) count, sizeof(float));
        assert_non_null(t->image.pixels);
        memcpy(t->image.pixels, colors, 3 * (size_t) count * sizeof(float));
        t->nearest = true;
        s->scene->materials[material].base_color_map.texture = t;
        layers_unwrap(s->scene);
    }
    stage_light(s, PELL_LIGHT_POINT, vec3(30, 20, 60), vec3(0, 0, 0), 1.0f);
    stage_camera(s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 14.0f);
}

static double reflectance(const struct pell_medium *m, int c)
{
    const double total = pell_half_space_albedo(m->sigma_s_reduced[c] / (m->sigma_s_reduced[c] + m->sigma_a[c]), m->eta);

    return total * pell_half_space_angle_of(total, m->eta).mean;
}

/* Scattered light crosses the boundary in and out: a uniform base colour b is a factor, b/rho, however it is split between entry and
 * exit. */
static void a_base_colour_is_a_factor(void **state)
{
    RELEASE_ONLY();
    static const float none[1][3] = { { 1.0f, 1.0f, 1.0f } }, base[1][3] = { { 0.9f, 0.4f, 0.1f } }, mixes[] = { 0.3f, 1.0f };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++)
        for (size_t i = 0; i < 2 * PELL_COUNT(mixes); i++) {
            struct shot plain, tinted;
            double factor[3], sum = 0.0;
            struct stage s;
            start(&s, 1.3, 0.5f, NULL, 0);
            plain = stage_shot_of(&s, cases[k].method, cases[k].knobs);
            stage_finish(&s);
            start(&s, 1.3, mixes[i / 2], i % 2 ? base : none, i % 2); /* by the texture, or by the constant */
            for (int c = 0; c < 3; c++) {
                s.scene->materials[0].base_color[c] = i % 2 ? 1.0f : base[0][c];
                factor[c] = (double) base[0][c] / reflectance(&s.scene->materials[0].medium, c);
            }
            tinted = stage_shot_of(&s, cases[k].method, cases[k].knobs);
            for (int at = 0; at < WIDE * WIDE; at++)
                for (int c = 0; c < 3; c++) {
                    const double light = factor[c] * shot_at(&plain, (size_t) c, at % WIDE, at / WIDE);
                    REQUIRE_NEAR(shot_at(&tinted, (size_t) c, at % WIDE, at / WIDE), light, 3e-4 * light + 1e-12);
                    sum += light;
                }
            REQUIRE(sum > 0.0);
            shot_free(&plain);
            shot_free(&tinted);
            stage_finish(&s);
        }
}

/* Colours of the two halves that sum to white give radiance that sums to white's, applied at entry (mix 1) or at exit (mix 0): each
 * point uses its own texel. */
static void halves_sum_to_white(void **state)
{
    static const float maps[3][2][3] = { { { 1.0f, 1.0f, 1.0f }, { 1.0f, 1.0f, 1.0f } },
                                         { { 1.0f, 0.7f, 0.2f }, { 0.0f, 0.3f, 0.8f } },
                                         { { 0.0f, 0.3f, 0.8f }, { 1.0f, 0.7f, 0.2f } } };

    (void) state;
    for (size_t k = 0; k < 2 * PELL_COUNT(cases); k++) {
        struct shot shot[3];
        bool differ = false;
        for (int map = 0; map < 3; map++) {
            struct stage s;
            start(&s, 1.3, k % 2 ? 1.0f : 0.0f, maps[map], 2);
            shot[map] = stage_shot_of(&s, cases[k / 2].method, cases[k / 2].knobs);
            stage_finish(&s);
        }
        for (size_t at = 0; at < 3 * (size_t) WIDE * WIDE; at++) {
            const double white = (double) shot[0].data[at];
            REQUIRE_NEAR((double) shot[1].data[at] + (double) shot[2].data[at], white, 3e-4 * white + 1e-12);
            differ = differ || shot[1].data[at] != shot[2].data[at];
        }
        REQUIRE(differ);
        for (int map = 0; map < 3; map++)
            shot_free(&shot[map]);
    }
}

/* Single-scattering radiance of the image's translucent pixels, and its largest difference between neighbours, relative to that
 * radiance. */
static void light_of(const char *method, const char *const *knobs, double eta, float mix, double sum[3], double row[WIDE])
{
    float stripes[16][3];
    struct stage s;

    for (int i = 0; i < 16; i++)
        for (int c = 0; c < 3; c++)
            stripes[i][c] = i % 2 ? 0.9f - 0.3f * (float) c : 0.05f;
    start(&s, eta, mix, (const float(*)[3]) stripes, 16);
    s.settings.layers = true;
    stage_method(&s, method, knobs);
    stage_render(&s);
    memset(sum, 0, 3 * sizeof(*sum));
    memset(row, 0, WIDE * sizeof(*row));
    for (size_t i = 0; i < s.image.num_channels; i++)
        for (int c = 0; c < 3; c++) {
            const char *const name[3] = { "diffuse.single.R", "diffuse.single.G", "diffuse.single.B" };
            if (strcmp(s.image.channels[i].name, name[c]) != 0)
                continue;
            for (int at = 0; at < WIDE * WIDE; at++) {
                const double x = (double) s.image.channels[i].data[at / WIDE * s.image.channels[i].stride + at % WIDE];
                sum[c] += x;
                row[at % WIDE] += x;
            }
        }
    stage_finish(&s);
}

/* Stripes as wide as two mean free paths, applied at light entry, against path-trace (without a boundary, where path-trace has no
 * internal reflections, which single-scatter lacks) and single-scatter. */
static void stripes_of_the_references(void **state)
{
    static const char *const walks[] = { "samples=192", NULL }, *const truth[] = { "error=0.03", "most=512", NULL };
    double a[3], b[3], c[3], row_a[WIDE], row_b[WIDE], row_c[WIDE], rms[2] = { 0.0, 0.0 }, mean = 0.0;

    (void) state;
    light_of("path-trace", walks, 1.0, 1.0f, a, row_a);
    light_of("single-scatter", truth, 1.0, 1.0f, b, row_b);
    for (int k = 0; k < 3; k++) {
        print_message("# stripes, channel %d: path-trace %.5g, single-scatter %.5g (%.2f %%)\n", k, a[k], b[k],
                      100.0 * (b[k] / a[k] - 1.0));
        REQUIRE_REL(b[k], a[k], 0.03);
    }
    light_of("layered", planar, 1.0, 1.0f, c, row_c);
    light_of("layered", planar, 1.0, 0.0f, a, row_a); /* the colour at the exit point */
    for (int x = 0; x < WIDE; x++) {
        rms[0] += (row_c[x] - row_b[x]) * (row_c[x] - row_b[x]);
        rms[1] += (row_a[x] - row_b[x]) * (row_a[x] - row_b[x]);
        mean += row_b[x];
    }
    print_message("# stripes, columns against single-scatter: %.2f %%, %.2f %% by the colour of where light leaves\n",
                  100.0 * sqrt(WIDE * rms[0]) / mean, 100.0 * sqrt(WIDE * rms[1]) / mean);
    REQUIRE(rms[0] < 0.2 * rms[1]);
    for (int k = 0; k < 3; k++)
        REQUIRE_REL(c[k], b[k], 0.06);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_base_colour_is_a_factor),
        cmocka_unit_test(halves_sum_to_white),
        cmocka_unit_test(stripes_of_the_references),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
