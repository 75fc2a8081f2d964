/* SPDX-License-Identifier: MIT
 * test_specular.c - the lobes and what they leave for the light below. */
#include "pell_test.h"

#include "math/quadrature.h"
#include "render/specular.h"

#include <jansson.h>

static const float roughnesses[] = { 0.1f, 0.2f, 0.3f, 0.45f, 0.6f, 0.8f, 1.0f };
static const float cosines[] = { 0.02f, 0.1f, 0.3f, 0.6f, 0.9f, 1.0f };

static struct pell_scene *make_scene(struct pell_context *ctx, int materials)
{
    struct pell_scene *scene = NULL;
    if (pell_scene_create(ctx, &scene) != PELL_OK)
        return NULL;
    for (int i = 0; i < materials; i++) {
        size_t m;
        if (pell_scene_add_material(scene, "m", &m) != PELL_OK) {
            pell_scene_destroy(&scene);
            return NULL;
        }
    }
    return scene;
}

static struct pell_vec3 spherical(float cosine, float azimuth)
{
    const float s = sqrtf(fmaxf(0.0f, 1.0f - cosine * cosine));
    return vec3(s * cosf(azimuth), s * sinf(azimuth), cosine);
}

/* Int D cos dw = 1, D taken out of the lobe at l = v = h. */
static void beckmann_is_normalised(void **state)
{
    const struct pell_vec3 n = vec3(0.0f, 0.0f, 1.0f);
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(roughnesses); i++) {
        double sum = 0.0;
        for (int k = 0; k < 20000; k++) {
            const double a = (k + 0.5) / 20000 * 0.5 * PELL_PI;
            const struct pell_vec3 h = vec3((float) sin(a), 0.0f, (float) cos(a));
            const double d = 4.0 * pell_specular_shape(PELL_SPECULAR_KELEMEN, roughnesses[i], n, h, h); /* (2h).(2h) = 4 */
            sum += 2.0 * PELL_PI * d * cos(a) * sin(a) * 0.5 * PELL_PI / 20000;
        }
        REQUIRE_NEAR(sum, 1.0, 2e-5);
    }
}

static void ggx_is_normalised(void **state)
{
    const struct pell_vec3 n = vec3(0.0f, 0.0f, 1.0f);
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(roughnesses); i++) {
        const double alpha = (double) roughnesses[i] * roughnesses[i];
        double sum = 0.0;
        for (int k = 0; k < 20000; k++) {
            const double a = (k + 0.5) / 20000 * 0.5 * PELL_PI, c = cos(a);
            const struct pell_vec3 h = vec3((float) sin(a), 0.0f, (float) c);
            const double g = c / sqrt(alpha * alpha + (1.0 - alpha * alpha) * c * c); /* correlated Smith at l = v */
            sum += 2.0 * PELL_PI * pell_specular_shape(PELL_SPECULAR_GGX, roughnesses[i], n, h, h) * 4.0 * c * c / g * c * sin(a) * 0.5 *
                   PELL_PI / 20000;
        }
        REQUIRE_NEAR(sum, 1.0, 1e-4);
    }
}

static void lobes_are_reciprocal(void **state)
{
    const struct pell_vec3 n = vec3_normalize(vec3(0.3f, -0.5f, 0.8f));
    struct pell_vec3 t, b;
    uint32_t seed = 1;
    (void) state;
    vec3_basis(n, &t, &b);
    for (int i = 0; i < 2000; i++) {
        struct pell_vec3 w[2];
        for (int k = 0; k < 2; k++) {
            struct pell_vec3 s;
            seed = seed * 1664525u + 1013904223u;
            s = spherical(0.01f + 0.99f * (float) (seed >> 8) / 16777216.0f, (float) (seed & 0xffu));
            w[k] = vec3_normalize(vec3_add(vec3_add(vec3_mul(t, s.x), vec3_mul(b, s.y)), vec3_mul(n, s.z)));
        }
        for (int model = 0; model < 2; model++) {
            const float f = pell_specular_shape((enum pell_specular_model) model, 0.4f, n, w[0], w[1]);
            const float g = pell_specular_shape((enum pell_specular_model) model, 0.4f, n, w[1], w[0]);
            REQUIRE(isfinite(f) && f >= 0.0f);
            REQUIRE_REL(f, g, 1e-5);
        }
    }
}

/* Int f n.l dl by midpoints over a polar grid round the mirror direction, packed toward it: nothing of the tables' own rule. */
static double brute_albedo(enum pell_specular_model model, float roughness, float f0, float mu)
{
    const struct pell_vec3 n = vec3(0.0f, 0.0f, 1.0f), v = spherical(mu, 0.0f), r = vec3(-v.x, 0.0f, v.z);
    const int rings = 700, turns = 240;
    struct pell_vec3 t, b;
    double sum = 0.0;

    vec3_basis(r, &t, &b);
    for (int i = 0; i < rings; i++) {
        const double s = (i + 0.5) / rings, a = PELL_PI * s * s * s, da = PELL_PI * 3.0 * s * s / rings;
        for (int j = 0; j < turns; j++) {
            const double phi = 2.0 * PELL_PI * (j + 0.5) / turns;
            const struct pell_vec3 l = vec3_normalize(
                vec3_mad(vec3_mad(vec3_mul(r, (float) cos(a)), (float) (sin(a) * cos(phi)), t), (float) (sin(a) * sin(phi)), b));
            const struct pell_vec3 h = vec3_normalize(vec3_add(l, v));
            if (l.z > 0.0f)
                sum += pell_specular_shape(model, roughness, n, l, v) * pell_schlick(f0, vec3_dot(h, v)) * l.z * sin(a) * da * 2.0 *
                       PELL_PI / turns;
        }
    }
    return sum;
}

static void check_albedo(enum pell_specular_model model, double eta)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = make_scene(ctx, 1);
    struct pell_specular_tables *tables;
    const float f0 = (float) (((eta - 1.0) / (eta + 1.0)) * ((eta - 1.0) / (eta + 1.0)));
    double worst = 0.0;

    scene->materials[0].specular = model;
    scene->materials[0].medium.eta = eta;
    assert_int_equal(pell_specular_tables_create(ctx, scene, &tables), PELL_OK);
    for (size_t i = 0; i < PELL_COUNT(roughnesses); i++)
        for (size_t j = 0; j < PELL_COUNT(cosines); j++) {
            const double truth = brute_albedo(model, roughnesses[i], f0, cosines[j]);
            const double a = pell_specular_albedo(tables, 0, cosines[j], roughnesses[i]);
            /* the lobe with rho_s = 1 and what enters make up all the light */
            const double rho_dt = 1.0 - pell_specular_albedo(tables, 0, cosines[j], roughnesses[i]);
            REQUIRE_NEAR(truth + rho_dt, 1.0, 5e-3);
            worst = fmax(worst, fabs(a - truth));
        }
    print_message("# model %d, eta %.2f: largest error of the albedo %.2g\n", (int) model, eta, worst);
    pell_specular_tables_destroy(&tables);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
}

static void specular_and_entering_light_sum_to_one_kelemen(void **state)
{
    (void) state;
    check_albedo(PELL_SPECULAR_KELEMEN, 1.4);
    check_albedo(PELL_SPECULAR_KELEMEN, 2.0);
}

static void specular_and_entering_light_sum_to_one_ggx(void **state)
{
    (void) state;
    check_albedo(PELL_SPECULAR_GGX, 1.5);
    check_albedo(PELL_SPECULAR_GGX, 1.3);
}

/* Under even light the mean of what enters and of what is thrown back is 1 at every roughness; a metal with F0 = 1 loses only what
 * single scattering between facets loses. */
static void furnace_keeps_energy(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = make_scene(ctx, 2);
    struct pell_specular_tables *tables;
    (void) state;
    scene->materials[0].specular = PELL_SPECULAR_KELEMEN;
    scene->materials[1].specular = PELL_SPECULAR_GGX;
    assert_int_equal(pell_specular_tables_create(ctx, scene, &tables), PELL_OK);
    for (size_t m = 0; m < 2; m++)
        for (float r = 0.1f; r < 1.01f; r += 0.075f) {
            double entered = 0.0, reflected = 0.0;
            for (int i = 0; i < 4000; i++) {
                const float mu = ((float) i + 0.5f) / 4000.0f;
                const double a = pell_specular_albedo(tables, m, mu, r);
                REQUIRE(a >= 0.0 && a <= 1.0);
                REQUIRE(pell_specular_albedo_f0(tables, m, 1.0f, mu, r) <= 1.0f);
                entered += 2.0 * mu * (1.0 - a) / 4000;
                reflected += 2.0 * mu * a / 4000;
            }
            REQUIRE_NEAR(entered + reflected, 1.0, 1e-6);
            REQUIRE_NEAR(pell_specular_mean(tables, m, r), reflected, 1e-5);
        }
    REQUIRE(pell_specular_albedo_f0(tables, 1, 1.0f, 0.8f, 0.1f) > 0.99f);
    pell_specular_tables_destroy(&tables);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
}

static void smooth_boundary_is_fresnel(void **state)
{
    static const double etas[] = { 1.0, 1.02, 1.3, 1.5, 2.0, 4.0 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = make_scene(ctx, PELL_COUNT(etas));
    struct pell_specular_tables *tables;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(etas); i++)
        scene->materials[i].medium.eta = etas[i];
    assert_int_equal(pell_specular_tables_create(ctx, scene, &tables), PELL_OK);
    for (size_t i = 0; i < PELL_COUNT(etas); i++) {
        double mean = 0.0;
        for (int k = 1; k <= 20000; k++) {
            const double mu = (k - 0.5) / 20000, t = pell_boundary_transmittance(tables, i, (float) mu);
            REQUIRE_NEAR(t, 1.0 - pell_fresnel(etas[i], mu), 1e-3);
            mean += 2.0 * mu * t / 20000;
        }
        REQUIRE_NEAR(pell_boundary_mean(tables, i), mean, 2e-5);
    }
    pell_specular_tables_destroy(&tables);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
}

/* 1 - Fdr(1/eta) = eta^2 (1 - Fdr(eta)), the latter from the oracle. */
static void mean_transmittance_is_the_oracles(void **state)
{
    json_error_t error;
    json_t *root = json_load_file(shared_file("oracle/results/dipole.json"), 0, &error), *row;
    size_t index, checked = 0;
    (void) state;
    assert_non_null(root);
    json_array_foreach(json_object_get(root, "fresnel"), index, row)
    {
        const double eta = json_number_value(json_object_get(row, "eta")), fdr = json_number_value(json_object_get(row, "Fdr_exact"));
        struct pell_context *ctx;
        struct pell_scene *scene;
        struct pell_specular_tables *tables;
        if (eta < 1.0 || eta > 4.0)
            continue;
        ctx = test_context(NULL, NULL);
        scene = make_scene(ctx, 1);
        scene->materials[0].medium.eta = eta;
        assert_int_equal(pell_specular_tables_create(ctx, scene, &tables), PELL_OK);
        REQUIRE_NEAR(pell_boundary_mean(tables, 0), (1.0 - fdr) * eta * eta, 1e-6);
        pell_specular_tables_destroy(&tables);
        pell_scene_destroy(&scene);
        pell_context_destroy(&ctx);
        checked++;
    }
    json_decref(root);
    REQUIRE(checked >= 8);
}

static void hostile_arguments_stay_finite(void **state)
{
    static const float odd[] = { -1.0f, 0.0f, 1e-7f, 0.5f, 1.0f, 1.0000001f, 7.0f };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = make_scene(ctx, 2);
    struct pell_specular_tables *tables;
    const struct pell_vec3 n = vec3(0.0f, 1.0f, 0.0f);
    (void) state;
    scene->materials[1].specular = PELL_SPECULAR_KELEMEN;
    assert_int_equal(pell_specular_tables_create(ctx, scene, &tables), PELL_OK);
    for (size_t m = 0; m < 2; m++)
        for (size_t i = 0; i < PELL_COUNT(odd); i++)
            for (size_t j = 0; j < PELL_COUNT(odd); j++) {
                const float a = pell_specular_albedo(tables, m, odd[i], odd[j]), t = pell_boundary_transmittance(tables, m, odd[i]);
                const struct pell_vec3 l = vec3_normalize(vec3(1.0f, odd[i], 0.0f)), v = vec3_normalize(vec3(-1.0f, odd[j], 0.0f));
                REQUIRE(a >= 0.0f && a <= 1.0f && t >= 0.0f && t <= 1.0f);
                REQUIRE(isfinite(pell_specular_shape(m ? PELL_SPECULAR_KELEMEN : PELL_SPECULAR_GGX, odd[j], n, l, v)));
            }
    pell_specular_tables_destroy(&tables);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
}

static void nth_allocation_fails_cleanly(void **state)
{
    (void) state;
    for (uint64_t n = 1; n < 20; n++) {
        struct pell_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, NULL);
        struct pell_scene *scene = make_scene(ctx, 3);
        struct pell_specular_tables *tables;
        enum pell_result res;
        scene->materials[1].medium.eta = 1.2;
        fault.fail_at = fault.calls + n;
        res = pell_specular_tables_create(ctx, scene, &tables);
        REQUIRE((res == PELL_OK) == (tables != NULL));
        fault.fail_at = 0;
        pell_specular_tables_destroy(&tables);
        pell_specular_tables_destroy(&tables);
        pell_scene_destroy(&scene);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
        if (res == PELL_OK) {
            REQUIRE(n > 3);
            return;
        }
        assert_int_equal(res, PELL_ERR_NOMEM);
    }
    fail();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(beckmann_is_normalised),
        cmocka_unit_test(ggx_is_normalised),
        cmocka_unit_test(lobes_are_reciprocal),
        cmocka_unit_test(specular_and_entering_light_sum_to_one_kelemen),
        cmocka_unit_test(specular_and_entering_light_sum_to_one_ggx),
        cmocka_unit_test(furnace_keeps_energy),
        cmocka_unit_test(smooth_boundary_is_fresnel),
        cmocka_unit_test(mean_transmittance_is_the_oracles),
        cmocka_unit_test(hostile_arguments_stay_finite),
        cmocka_unit_test(nth_allocation_fails_cleanly),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
