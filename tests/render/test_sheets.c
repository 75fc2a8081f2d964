/* SPDX-License-Identifier: MIT
 * test_sheets.c - thin sheets that transmit diffuse light, and lampshades around lights: against closed forms and path-trace. */
#include "stage.h"

#define SIZE 24

static const float base[3] = { 0.8f, 0.6f, 0.3f }, color[3] = { 0.5f, 0.9f, 0.7f };
#define SHARE 0.4f

static struct pell_material *add_sheet(struct stage *s, size_t *index)
{
    struct pell_material *m = stage_opaque(s, 1.0f, index);

    m->diffuse_transmission = SHARE;
    memcpy(m->base_color, base, sizeof(base));
    memcpy(m->diffuse_transmission_color, color, sizeof(color));
    return m;
}

/* A square of 100 mm at z = 0 that faces the camera, or away from it, with a light in front of it or behind. */
static struct shot shot_of_square(struct stage *s, bool turned, enum pell_light_type type, bool behind)
{
    const float side = turned ? -1.0f : 1.0f;
    size_t material;

    stage_start(s, SIZE, SIZE);
    add_sheet(s, &material);
    shapes_quad(s->scene, material, vec3(0, 0, 0), vec3(50, 0, 0), vec3(0, 50.0f * side, 0))->object = 0;
    if (type == PELL_LIGHT_ENVIRONMENT)
        stage_environment(s, 1.0f);
    else
        stage_light(s, type, vec3(60, 30, behind ? -200.0f : 200.0f), vec3(0, 0, 0), type == PELL_LIGHT_POINT ? 0.1f : 2.0f);
    stage_camera(s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 80.0f);
    s->settings.layers = true;
    s->settings.light_samples = 64;
    return stage_shot_of(s, "none", NULL);
}

/* Backlit, a sheet looks like an opaque square of the transmitted colour lit from the front, times T; lit from the front like one of the
 * base colour, times 1 - T. */
static void both_sides_have_the_light_of_lambert(void **state)
{
    static const enum pell_light_type types[] = { PELL_LIGHT_DIRECTIONAL, PELL_LIGHT_POINT, PELL_LIGHT_DISC };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(types); k++)
        for (int turned = 0; turned < 2; turned++) {
            struct stage s[2];
            struct shot front = shot_of_square(&s[0], turned, types[k], false), back = shot_of_square(&s[1], turned, types[k], true);
            for (int y = 1; y < SIZE - 1; y++)
                for (int x = 1; x < SIZE - 1; x++)
                    for (size_t c = 0; c < 3; c++) {
                        const double lit = shot_at(&front, SHOT_MULTIPLE + c, x, y) / (double) ((1.0f - SHARE) * base[c]);
                        const double through = shot_at(&back, SHOT_TRANSMISSION + c, x, y) / (double) (SHARE * color[c]);
                        REQUIRE(lit > 0.0);
                        REQUIRE_REL(through, lit, types[k] == PELL_LIGHT_DISC ? 0.05 : 1e-4);
                        REQUIRE_NEAR(shot_at(&front, SHOT_TRANSMISSION + c, x, y), 0.0, 1e-9);
                        REQUIRE_NEAR(shot_at(&back, SHOT_MULTIPLE + c, x, y), 0.0, 1e-9);
                        REQUIRE_REL(shot_at(&back, SHOT_R + c, x, y), shot_at(&back, SHOT_TRANSMISSION + c, x, y), 1e-6);
                    }
            shot_free(&front);
            shot_free(&back);
            stage_finish(&s[0]);
            stage_finish(&s[1]);
        }
}

/* Radiance 1 from all directions: E = pi on both sides. */
static void an_environment_lights_both_sides(void **state)
{
    struct stage s;
    struct shot shot = shot_of_square(&s, false, PELL_LIGHT_ENVIRONMENT, false);
    (void) state;

    for (size_t c = 0; c < 3; c++) {
        REQUIRE_REL(shot_at(&shot, SHOT_MULTIPLE + c, SIZE / 2, SIZE / 2), (double) ((1.0f - SHARE) * base[c]), 0.01);
        REQUIRE_REL(shot_at(&shot, SHOT_TRANSMISSION + c, SIZE / 2, SIZE / 2), (double) (SHARE * color[c]), 0.01);
    }
    shot_free(&shot);
    stage_finish(&s);
}

/* A light at the centre of a closed sphere: inside E = E0/(1 - (1 - T) base), and T of that, tinted by the transmitted colour, leaves
 * outside. */
static void a_lantern_sends_out_what_its_bounces_bring(void **state)
{
    struct stage s;
    struct shot shot;
    struct pell_light *light;
    size_t material;
    (void) state;

    stage_start(&s, SIZE, SIZE);
    add_sheet(&s, &material);
    stage_ball(&s, material, 0, vec3(0, 0, 0), 50.0f, 32);
    light = stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, 0), vec3(0, 0, 1), 1e-3f);
    stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 40.0f);
    s.settings.layers = true;
    s.settings.bounces = 64;
    s.settings.indirect_samples = SLOW ? 2048 : 16384;
    shot = stage_shot_of(&s, "none", NULL);
    for (size_t c = 0; c < 3; c++) {
        const double first = (double) light->power[c] / (0.05 * 0.05), inside = first / (1.0 - (double) ((1.0f - SHARE) * base[c]));
        REQUIRE_REL(shot_at(&shot, SHOT_TRANSMISSION + c, SIZE / 2, SIZE / 2) * PELL_PI, (double) (SHARE * color[c]) * inside, 0.02);
        REQUIRE_NEAR(shot_at(&shot, SHOT_MULTIPLE + c, SIZE / 2, SIZE / 2), 0.0, 1e-9);
    }
    shot_free(&shot);
    stage_finish(&s);
}

static double mean_of(const struct shot *shot, size_t c)
{
    double sum = 0.0;

    for (int y = 0; y < shot->height; y++)
        for (int x = 0; x < shot->width; x++)
            sum += shot_at(shot, c, x, y);
    return sum;
}

/* A translucent ball below a sheet that transmits all of its light: against path-trace, whose paths choose a side at random. */
static void what_is_behind_a_sheet_is_lit_through_it(void **state)
{
    static const char *const samples[] = { "samples=256", NULL };
    struct stage s;
    struct shot traced, fast;
    size_t sheet, milk;
    (void) state;

    stage_start(&s, SIZE, SIZE);
    add_sheet(&s, &sheet);
    stage_gaussians(&s, 1.0, &milk)->gaussians.count = 0; /* marble itself */
    shapes_quad(s.scene, sheet, vec3(0, 40, 0), vec3(60, 0, 0), vec3(0, 0, 60))->object = 0;
    stage_ball(&s, milk, 1, vec3(0, 0, 0), 20.0f, 32);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 300, 0), vec3(0, 0, 0), 2.0f);
    stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 44.0f);
    s.settings.layers = true;
    s.settings.bounces = 16;
    s.settings.indirect_samples = 8192;
    s.settings.angles = true;
    s.settings.profile = 0;
    traced = stage_shot_of(&s, "path-trace", samples);
    fast = stage_shot_of(&s, "screen-space", NULL);
    for (size_t c = 0; c < 3; c++) {
        print_message("# channel %zu: path-trace %.4f, screen-space %.4f\n", c, mean_of(&traced, c), mean_of(&fast, c));
        REQUIRE_REL(mean_of(&fast, c), mean_of(&traced, c), 0.06);
    }
    shot_free(&traced);
    shot_free(&fast);
    stage_finish(&s);
}

/* A bulb around a point light: where it is emissive, the floor is lit as if the bulb did not exist; where it is not, the floor is dark. */
static void the_shell_of_a_light_holds_no_light_back(void **state)
{
    double light[3];
    (void) state;

    for (int k = 0; k < 3; k++) {
        struct stage s;
        struct shot shot;
        size_t floor, bulb;

        stage_start(&s, SIZE, SIZE);
        stage_opaque(&s, 0.5f, &floor);
        stage_opaque(&s, 0.5f, &bulb)->emissive[1] = k == 1 ? 3.0f : 0.0f;
        shapes_quad(s.scene, floor, vec3(0, 0, 0), vec3(80, 0, 0), vec3(0, 80, 0))->object = 0;
        if (k > 0)
            stage_ball(&s, bulb, 1, vec3(0, 0, 60), 5.0f, 8);
        stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, 60), vec3(0, 0, 0), 0.1f);
        stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 80.0f);
        shot = stage_shot_of(&s, "none", NULL);
        light[k] = shot_at(&shot, SHOT_R, SIZE / 4, SIZE / 2);
        if (k == 1) /* and the camera sees it */
            REQUIRE_NEAR(shot_at(&shot, SHOT_R + 1, SIZE / 2, SIZE / 2), 3.0, 1e-5);
        shot_free(&shot);
        stage_finish(&s);
    }
    REQUIRE(light[0] > 0.0);
    REQUIRE_REL(light[1], light[0], 1e-6);
    REQUIRE_NEAR(light[2], 0.0, 1e-9);
}

/* A transmission map of 2 texels. */
static void maps_say_where_and_in_what_colour(void **state)
{
    struct stage s;
    struct shot shot;
    struct pell_texture *t;
    struct pell_mesh *mesh;
    struct pell_material *m;
    size_t material;
    (void) state;

    stage_start(&s, SIZE, SIZE);
    OK(pell_scene_add_texture(s.scene, "map", &t));
    OK(pell_texture_allocate(s.scene, t, 2, 1, 4, PELL_PIXEL_U8));
    memcpy(t->image.pixels, (const uint8_t[]) { 255, 255, 255, 0, 51, 255, 255, 255 }, 8);
    t->nearest = true;
    m = add_sheet(&s, &material);
    m->diffuse_transmission_map.texture = m->diffuse_transmission_color_map.texture = t;
    m->diffuse_transmission_map.channel = 3;
    mesh = shapes_quad(s.scene, material, vec3(0, 0, 0), vec3(50, 0, 0), vec3(0, 50, 0));
    mesh->object = 0;
    for (uint32_t i = 0; i < mesh->num_vertices; i++) {
        mesh->uv[0][2 * i] = mesh->position[3 * i] > 0.0f ? 1.0f : 0.0f;
        mesh->uv[0][2 * i + 1] = 0.5f;
    }
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -500), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 80.0f);
    shot = stage_shot_of(&s, "none", NULL);
    REQUIRE_NEAR(shot_at(&shot, SHOT_G, 2, SIZE / 2), 0.0, 1e-9);
    REQUIRE_REL(shot_at(&shot, SHOT_R, SIZE - 3, SIZE / 2), 0.2 * (double) (SHARE * color[0]) / PELL_PI, 1e-3);
    REQUIRE_REL(shot_at(&shot, SHOT_G, SIZE - 3, SIZE / 2), (double) (SHARE * color[1]) / PELL_PI, 1e-3);
    shot_free(&shot);
    stage_finish(&s);
}

/* Layered skin has the layers below both of its faces; between a light as wide as the sky and the camera it has the radiance of
 * path-trace. */
static void skin_of_layers_lets_through_what_its_layers_do(void **state)
{
    static const char *const samples[] = { "samples=192", NULL };
    (void) state;

    for (int k = 0; k < 2; k++) {
        struct stage s;
        struct shot traced, fast;
        size_t skin;
        stage_start(&s, 8, 8);
        stage_medium(&s, k ? "skin-3layer" : "skin-2layer", &skin);
        stage_box(&s, skin, 0, vec3(-60, -60, 0), vec3(60, 60, 2));
        stage_light(&s, PELL_LIGHT_DISC, vec3(0, 0, -40), vec3(0, 0, 0), 1.0f)->radius = 3000.0f;
        stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 8.0f);
        s.settings.layers = true;
        s.settings.angles = true;
        s.settings.light_samples = 64;
        traced = stage_shot_of(&s, "path-trace", samples);
        fast = stage_shot_of(&s, "screen-space", NULL);
        for (size_t c = 0; c < 2; c++) {
            print_message("# channel %zu: path-trace %.4f, screen-space %.4f\n", c, mean_of(&traced, c), mean_of(&fast, c));
            REQUIRE_REL(mean_of(&fast, c), mean_of(&traced, c), 0.1);
        }
        shot_free(&traced);
        shot_free(&fast);
        stage_finish(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(both_sides_have_the_light_of_lambert),           cmocka_unit_test(an_environment_lights_both_sides),
        cmocka_unit_test(a_lantern_sends_out_what_its_bounces_bring),     cmocka_unit_test(what_is_behind_a_sheet_is_lit_through_it),
        cmocka_unit_test(the_shell_of_a_light_holds_no_light_back),       cmocka_unit_test(maps_say_where_and_in_what_colour),
        cmocka_unit_test(skin_of_layers_lets_through_what_its_layers_do),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
