/* SPDX-License-Identifier: MIT
 * test_layered_multiple.c - multiple scattering in layers, and the diffuse film on top. */
#include "stage.h"

#include "methods/layered/multiple.h"
#include "optics/photon/table.h"

#include <pellucid/layers.h>

#include <string.h>

/* --- Single scattering ---------------------------------------------------------------------------------------------------------- */

/* A half-space: the closed form of the photon table; its total and radial profile are compared with photons. */
static void single_of_a_half_space(void **state)
{
    (void) state;
    for (int k = 0; k < 4; k++) {
        const double g = k & 1 ? 0.8 : 0.0, eta = k & 2 ? 1.4 : 1.0, albedo = 0.9, sigma_t = 2.0;
        struct pell_medium_layers one = { .eta = eta, .count = 1, .substrate = PELL_SUBSTRATE_LAST };
        const float bottom = INFINITY;
        struct pell_single s;
        double inside = 0.0, before = 0.0;

        one.item[0].sigma_t[1] = sigma_t;
        one.item[0].sigma_s[1] = albedo * sigma_t;
        one.item[0].phase[1] = (struct pell_phase) { PELL_PHASE_HENYEY_GREENSTEIN, { g, 0.0 }, 0.0 };
        REQUIRE_REL(layered_single_total(&one, &bottom, 1), albedo * pell_single_total(g, eta), 1e-4);
        pell_single_make(g, eta, &s);
        for (double r = 0.01; r < 5.0; r *= 2.0)
            REQUIRE_REL(layered_single_rd(&one, &bottom, 1, r), sigma_t * sigma_t * albedo * pell_single_rd(&s, r * sigma_t), 1e-3);
        for (int i = 1; i <= 4000; i++) { /* the radial profile integrates to the total */
            const double r = 12.0 * pow(i / 4000.0, 3.0), middle = 0.5 * (r + before);
            inside += 2.0 * PELL_PI * middle * layered_single_rd(&one, &bottom, 1, middle) * (r - before);
            before = r;
        }
        REQUIRE_REL(inside, layered_single_total(&one, &bottom, 1), 2e-3);
    }
}

/* Two layers of one medium equal that medium; a layer of finite depth scatters less. */
static void single_of_layers(void **state)
{
    struct pell_medium_layers two = { .eta = 1.3, .count = 2, .substrate = PELL_SUBSTRATE_LAST };
    const float bottoms[2] = { 0.3f, INFINITY }, ends[2] = { 0.3f, 0.8f };
    const double whole = 0.5 * pell_single_total(0.3, 1.3);
    double above = 0.0;

    (void) state;
    for (int i = 0; i < 2; i++) {
        two.item[i].sigma_t[0] = 1.5;
        two.item[i].sigma_s[0] = 0.75;
        two.item[i].phase[0] = (struct pell_phase) { PELL_PHASE_HENYEY_GREENSTEIN, { 0.3, 0.0 }, 0.0 };
    }
    REQUIRE_REL(layered_single_total(&two, bottoms, 0), whole, 1e-4);
    two.substrate = PELL_SUBSTRATE_STOP;
    above = layered_single_total(&two, ends, 0);
    REQUIRE(above < whole * (1.0 - exp(-2.0 * 0.8 * 1.5 * 1.5)) && above > whole * (1.0 - exp(-2.0 * 0.8 * 1.5)));
}

/* --- Images --------------------------------------------------------------------------------------------------------------------- */

static void light_from_above(struct stage *s)
{
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 1), vec3(0, 0, 0), 1.0f);
    stage_camera(s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 8.0f);
}

/* Under uniform light blurs have no effect: multiple scattering is the profile's fraction that is not scattered once. */
static void energy_of_a_half_space(void **state)
{
    static const char *const on[] = { "multiple=on", NULL };

    (void) state;
    for (int strength = 0; strength < 2; strength++) {
        struct shot plain, more;
        struct stage s;
        const struct pell_material *m;

        stage_start(&s, 12, 12);
        m = stage_medium(&s, "wholemilk", NULL);
        s.scene->materials[0].strength = strength ? 0.25f : 1.0f;
        stage_box(&s, 0, 0, vec3(-400, -400, -400), vec3(400, 400, 0));
        light_from_above(&s);
        s.settings.layers = true;
        plain = stage_shot_of(&s, "screen-space", NULL);
        more = stage_shot_of(&s, "layered", on);
        for (int c = 0; c < 3; c++) {
            struct pell_profile profile;
            const double single = m->medium.sigma_s_reduced[c] / (1.0 - m->medium.g[c]) /
                                  (m->medium.sigma_s_reduced[c] / (1.0 - m->medium.g[c]) + m->medium.sigma_a[c]) *
                                  pell_single_total(m->medium.g[c], m->medium.eta);
            double got, whole;
            OK(pell_profile_make(m->model, &m->medium, c, NULL, &profile));
            got = shot_at(&more, SHOT_MULTIPLE + (size_t) c, 6, 6);
            whole = shot_at(&plain, SHOT_MULTIPLE + (size_t) c, 6, 6);
            print_message("# strength %g, channel %d: %.5f of %.5f, single %.4f of %.4f\n", strength ? 0.25 : 1.0, c, got, whole, single,
                          pell_profile_total(&profile));
            REQUIRE_REL(got / whole, 1.0 - single / pell_profile_total(&profile), 2e-3);
        }
        shot_free(&plain);
        shot_free(&more);
        stage_finish(&s);
    }
}

static void set_layer(struct stage *s, struct pell_scene_layer *l, double depth, double sigma_s, double sigma_t)
{
    const struct pell_phase phase = { PELL_PHASE_SCHLICK, { 0.5, 0.0 }, 0.0 };

    l->name = pell_strdup(s->ctx, "layer");
    l->medium.eta = 1.4;
    l->depth = (float) depth;
    for (int c = 0; c < 3; c++) {
        l->phase[c] = phase;
        l->medium.g[c] = pell_phase_mean_cosine(&phase);
        l->medium.sigma_s_reduced[c] = sigma_s * (1.0 - l->medium.g[c]);
        l->medium.sigma_a[c] = sigma_t - sigma_s;
    }
}

static struct pell_material *two_layers(struct stage *s, const uint8_t texels[64])
{
    struct pell_material *m = stage_medium(s, "marble", NULL);
    uint8_t pixels[3 * 64] = { 0 };

    m->medium.eta = 1.4;
    m->layers = pell_calloc(s->ctx, 2, sizeof(*m->layers));
    m->num_layers = 2;
    m->substrate = PELL_SUBSTRATE_LAST;
    set_layer(s, &m->layers[0], 1.0, 20.0, 20.2);
    set_layer(s, &m->layers[1], INFINITY, 10.0, 11.0);
    for (int i = 0; i < 64; i++)
        pixels[3 * i] = texels[i];
    m->layers[0].depth_map = (struct pell_texture_map) { .texture = shapes_texture(s->scene, 8, 8, 3, false, pixels) };
    memcpy(m->layers[0].depth_map.matrix, (const float[6]) { 1, 0, 0, 0, 1, 0 }, sizeof(m->layers[0].depth_map.matrix));
    return m;
}

/* Total of two layers, the first `depth` mm thick, minus single scattering. */
static double rest_of(const struct pell_material *m, double depth)
{
    struct pell_medium_layers layers = { .eta = 1.4, .count = 2, .substrate = PELL_SUBSTRATE_LAST };
    struct pell_stack stack = { .count = 2 };
    const float bottoms[2] = { (float) depth, INFINITY };
    double totals[PELL_STACK_PARTS];

    for (int i = 0; i < 2; i++) {
        struct pell_medium_layer *l = &stack.layer[i];
        l->eta = 1.4;
        l->thickness = i ? (double) INFINITY : depth;
        for (int c = 0; c < 3; c++) {
            l->sigma_a[c] = m->layers[i].medium.sigma_a[c];
            l->sigma_s_reduced[c] = m->layers[i].medium.sigma_s_reduced[c];
            layers.item[i].sigma_s[c] = l->sigma_s_reduced[c] / (1.0 - m->layers[i].medium.g[c]);
            layers.item[i].sigma_t[c] = layers.item[i].sigma_s[c] + l->sigma_a[c];
            layers.item[i].phase[c] = m->layers[i].phase[c];
        }
    }
    OK(pell_stack_totals(&stack, 0, totals, NULL));
    return totals[PELL_STACK_R_PLUS] - layered_single_total(&layers, bottoms, 0);
}

/* Each point uses its own layer depths: a ramp, far wider than light spreads, gives the half-space of each depth. */
static void painted_depths(void **state)
{
    static const char *const on[] = { "multiple=on", NULL };
    uint8_t texels[64];
    struct pell_material *m;
    struct shot shot;
    struct stage s;
    double worst = 0.0;

    (void) state;
    stage_start(&s, 32, 4);
    for (int i = 0; i < 64; i++)
        texels[i] = (uint8_t) (12 + 30 * (i % 8));
    m = two_layers(&s, texels);
    shapes_quad(s.scene, 0, vec3(0, 0, 0), vec3(200, 0, 0), vec3(0, 200, 0));
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 1), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 40.0f);
    s.settings.layers = true;
    shot = stage_shot_of(&s, "layered", on);
    for (int x = 3; x < 29; x++) {
        const double u = 0.5 + (x + 0.5 - 16.0) * 10.0 / 400.0, texel = fmin(fmax(8.0 * u - 0.5, 0.0), 7.0);
        const double depth = (12.0 + 30.0 * texel) / 255.0, first = (12.0 + 30.0 * 3.5) / 255.0;
        const double got =
            shot_at(&shot, SHOT_MULTIPLE, x, 2) / (0.5 * (shot_at(&shot, SHOT_MULTIPLE, 15, 2) + shot_at(&shot, SHOT_MULTIPLE, 16, 2)));
        const double expected = rest_of(m, depth) / rest_of(m, first);
        worst = fmax(worst, fabs(got / expected - 1.0));
        if (x % 5 == 3)
            print_message("# %.3f mm: %.4f, expected %.4f\n", depth, got, expected);
    }
    print_message("# largest error %.4f\n", worst);
    REQUIRE(worst < 0.01);
    shot_free(&shot);
    stage_finish(&s);
}

/* A film of reflectance 1 is a white matt surface; one of reflectance 0.5 halves the light of the layers. */
static void a_film_on_top(void **state)
{
    static const char *const film[] = { "diffuse=1", NULL }, *const half[] = { "diffuse=0.5", NULL }, *const bare[] = { NULL };
    struct shot all, some, none;
    struct stage s;

    (void) state;
    stage_start(&s, 8, 8);
    stage_medium(&s, "ketchup", NULL);
    for (int c = 0; c < 3; c++)
        s.scene->materials[0].base_color[c] = 0.25f * (float) (c + 1);
    stage_box(&s, 0, 0, vec3(-200, -200, -200), vec3(200, 200, 0));
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.6f, 0, 0.8f), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 8.0f);
    all = stage_shot_of(&s, "layered", film);
    some = stage_shot_of(&s, "layered", half);
    none = stage_shot_of(&s, "layered", bare);
    for (size_t c = 0; c < 3; c++) {
        const double one = shot_at(&all, c, 4, 4), under = shot_at(&none, c, 4, 4);
        if (c > 0)
            REQUIRE_REL(one / shot_at(&all, SHOT_R, 4, 4), (double) (c + 1), 1e-4);
        REQUIRE_REL(shot_at(&some, c, 4, 4), 0.5 * (one + under), 1e-4);
    }
    shot_free(&all);
    shot_free(&some);
    shot_free(&none);
    stage_finish(&s);
}

static void failed_allocations(void **state)
{
    static const char *const on[] = { "multiple=on", "diffuse=0.2", NULL };
    static uint8_t texels[64] = { 0, 100, 200, 255 };
    bool done = false;

    (void) state;
    for (uint64_t n = 1; !done; n = next_allocation(n)) {
        struct pell_alloc_fault fault = { 0 };
        enum pell_result res;
        struct stage s;
        stage_start_on(&s, PELL_ENGINE_CPU, 8, 8, 2, &fault);
        two_layers(&s, texels);
        shapes_quad(s.scene, 0, vec3(0, 0, 0), vec3(9, 0, 0), vec3(0, 9, 0));
        light_from_above(&s);
        stage_complete(&s);
        stage_method(&s, "layered", on);
        fault.fail_at = fault.calls + n;
        res = pell_renderer_set_scene(s.r, s.scene);
        if (res == PELL_OK)
            res = pell_renderer_render(s.r, &s.settings, &s.image);
        done = fault.calls < fault.fail_at;
        assert_int_equal(res, done ? PELL_OK : PELL_ERR_NOMEM);
        fault.fail_at = 0;
        stage_finish(&s);
        assert_int_equal(fault.live, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(single_of_a_half_space), cmocka_unit_test(single_of_layers), cmocka_unit_test(energy_of_a_half_space),
        cmocka_unit_test(painted_depths),         cmocka_unit_test(a_film_on_top),    cmocka_unit_test(failed_allocations),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
