/* SPDX-License-Identifier: MIT
 *
 * test_materials.c - the built-in table against the published numbers, the ranges of media, mean free paths, and the table of fit
 * errors in src/optics/README.md. */
#include "oracle.h"

static void every_entry_is_valid_named_and_in_order(void **state)
{
    (void) state;
    assert_int_equal(pell_material_count(), 16);
    for (size_t i = 0; i < pell_material_count(); i++) {
        const struct pell_material_entry *e = pell_material_at(i);
        REQUIRE(i == 0 || strcmp(pell_material_at(i - 1)->name, e->name) < 0);
        assert_ptr_equal(pell_material_find(e->name), e);
        REQUIRE(e->title[0] && e->source[0] && e->note);
        REQUIRE(e->roughness > 0.0 && e->roughness <= 1.0 && e->mix >= 0.0 && e->mix <= 1.0);
        for (int c = 0; c < 3; c++)
            REQUIRE(e->color[c] >= 0.0 && e->color[c] <= 1.0);
        if (e->kind == PELL_MATERIAL_MEDIUM) {
            REQUIRE(pell_medium_valid(&e->medium, NULL));
            REQUIRE(e->gaussians.count == 0 && !e->color_from_texture);
        } else {
            REQUIRE(e->gaussians.count > 0 && e->color_from_texture);
            REQUIRE(e->medium.eta >= 1.0 && e->medium.sigma_a[0] == 0.0);
        }
    }
    assert_null(pell_material_at(pell_material_count()));
}

static void unknown_names_are_not_found(void **state)
{
    (void) state;
    assert_null(pell_material_find("milk"));
    assert_null(pell_material_find(""));
    assert_null(pell_material_find("zzz"));
    assert_null(pell_material_find("WholeMilk"));
    assert_null(pell_material_find(NULL));
}

/* Bit by bit: generation and compilation round nothing. */
static void measured_coefficients_are_jensens(void **state)
{
    json_t *root = oracle_load("data/jensen2001.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach (oracle_get(root, "materials"), i, row) {
        const struct pell_material_entry *e = pell_material_find(json_string_value(oracle_get(row, "name")));
        assert_non_null(e);
        assert_int_equal(e->kind, PELL_MATERIAL_MEDIUM);
        REQUIRE(e->medium.eta == oracle_number(row, "eta"));
        for (size_t c = 0; c < 3; c++) {
            REQUIRE(e->medium.sigma_a[c] == oracle_at(row, "sigma_a", c));
            REQUIRE(e->medium.sigma_s_reduced[c] == oracle_at(row, "sigma_s_prime", c));
            REQUIRE(e->color[c] == oracle_at(row, "diffuse_reflectance", c));
            REQUIRE(e->medium.g[c] == 0.0);
            const struct pell_dipole d =
                pell_dipole_make(e->medium.sigma_a[c], e->medium.sigma_s_reduced[c], e->medium.eta, PELL_FRESNEL_EXACT);
            REQUIRE_NEAR(pell_dipole_total(&d), e->color[c], 0.027); /* the measured column has two digits */
        }
    }
    assert_int_equal(i, 12);
    json_decref(root);
}

static void published_gaussians_are_those_of_the_papers(void **state)
{
    static const struct {
        const char *ours, *theirs;
    } sets[] = {
        { "skin-6gaussian", "skin6_gpugems3" },
        { "skin-4gaussian", "skin4_jimenez2010" },
        { "marble-4gaussian", "marble4_jimenez2010" },
    };
    json_t *root = oracle_load("data/skin_gaussians.json"), *row;
    size_t i;
    int found = 0;
    (void) state;
    json_array_foreach (oracle_get(root, "sets"), i, row)
        for (size_t s = 0; s < PELL_COUNT(sets); s++) {
            static const char *const channels[3] = { "R", "G", "B" };
            const struct pell_material_entry *e = pell_material_find(sets[s].ours);
            if (strcmp(json_string_value(oracle_get(row, "name")), sets[s].theirs) != 0)
                continue;
            found++;
            assert_int_equal((size_t) e->gaussians.count, json_array_size(oracle_get(row, "variances")));
            for (int k = 0; k < e->gaussians.count; k++) {
                REQUIRE(e->gaussians.variance[k] == oracle_at(row, "variances", (size_t) k));
                for (int c = 0; c < 3; c++)
                    REQUIRE_NEAR(e->gaussians.weight[k][c], oracle_at(oracle_get(row, "weights"), channels[c], (size_t) k), 2e-4);
            }
        }
    assert_int_equal(found, 3);
    json_decref(root);
}

static void published_weights_sum_to_one_exactly(void **state)
{
    (void) state;
    for (size_t i = 0; i < pell_material_count(); i++) {
        const struct pell_material_entry *e = pell_material_at(i);
        for (int c = 0; c < 3 && e->kind == PELL_MATERIAL_GAUSSIANS; c++)
            REQUIRE(pell_gaussians_total(&e->gaussians, c) == 1.0);
    }
}

/* Table 7.1 prints w'_i = w_i / Sum_{j<=i} w_j beside the weights (the formula there has a wrong index). */
static void table_7_1_blend_constants(void **state)
{
    static const struct {
        const char *name;
        double blend[4][3];
    } sets[] = {
        { "skin-4gaussian", { { 1, 1, 1 }, { 0.3251, 0.45, 0.3583 }, { 0.34, 0.1864, 0 }, { 0.46, 0, 0.0402 } } },
        { "marble-4gaussian", { { 1, 1, 1 }, { 0.8173, 0.6616, 0.4647 }, { 0.5101, 0.4617, 0.4791 }, { 0.3913, 0.3161, 0.2189 } } },
    };
    (void) state;
    for (size_t s = 0; s < PELL_COUNT(sets); s++) {
        const struct pell_gaussians *g = &pell_material_find(sets[s].name)->gaussians;
        assert_int_equal(g->count, 4);
        for (int c = 0; c < 3; c++) {
            double sum = 0.0;
            for (int i = 0; i < 4; i++) {
                sum += g->weight[i][c];
                REQUIRE_NEAR(g->weight[i][c] / sum, sets[s].blend[i][c], 2e-4);
            }
        }
    }
}

static void four_skin_gaussians_are_near_the_six(void **state)
{
    static const double six[3] = { 1.3828682, 0.0681294, 0.0247722 }, four[3] = { 0.98028732, 0.07243628, 0.10233496 };
    const struct pell_gaussians *a = &pell_material_find("skin-6gaussian")->gaussians;
    const struct pell_gaussians *b = &pell_material_find("skin-4gaussian")->gaussians;
    (void) state;
    for (int c = 0; c < 3; c++) {
        double mean_a = 0.0, mean_b = 0.0;
        for (int i = 0; i < a->count; i++)
            mean_a += a->variance[i] * a->weight[i][c];
        for (int i = 0; i < b->count; i++)
            mean_b += b->variance[i] * b->weight[i][c];
        REQUIRE_REL(mean_a, six[c], 1e-9);
        REQUIRE_REL(mean_b, four[c], 4e-4);
    }
}

static void skin_is_the_six_gaussians(void **state)
{
    const struct pell_material_entry *skin = pell_material_find("skin"), *six = pell_material_find("skin-6gaussian");
    (void) state;
    assert_memory_equal(&skin->gaussians, &six->gaussians, sizeof(six->gaussians));
    REQUIRE(skin->mix == 0.5 && skin->roughness == 0.35 && skin->medium.eta == 1.4);
}

static void faults_name_the_first_bad_field(void **state)
{
    static const double bad[] = { NAN, INFINITY, -INFINITY, -1e-9, 1.0000001e6 };
    const struct pell_medium good = pell_material_find("wholemilk")->medium;
    struct pell_medium_fault fault;
    (void) state;
    REQUIRE(pell_medium_valid(&good, &fault) && fault.field == NULL);
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        struct pell_medium m = good;
        m.sigma_a[2] = bad[i];
        m.eta = 0.5;
        REQUIRE(!pell_medium_valid(&m, &fault));
        assert_string_equal(fault.field, "sigma_a[2]");
        REQUIRE(isnan(bad[i]) ? isnan(fault.value) : fault.value == bad[i]);
        REQUIRE(fault.min == 0.0 && fault.max == PELL_SIGMA_MAX);
        m = good;
        m.sigma_s_reduced[1] = bad[i];
        REQUIRE(!pell_medium_valid(&m, &fault));
        assert_string_equal(fault.field, "sigma_s_reduced[1]");
    }
    struct pell_medium m = good;
    m.g[0] = 1.0;
    REQUIRE(!pell_medium_valid(&m, &fault));
    assert_string_equal(fault.field, "g[0]");
    m = good;
    m.sigma_a[0] = m.sigma_s_reduced[0] = 0.0;
    REQUIRE(!pell_medium_valid(&m, &fault));
    assert_string_equal(fault.field, "sigma_a[0] + sigma_s_reduced[0]");
    m = good;
    m.eta = 0.24;
    REQUIRE(!pell_medium_valid(&m, &fault) && fault.min == PELL_ETA_MIN && fault.max == PELL_ETA_MAX);
    assert_string_equal(fault.field, "eta");
    m.eta = NAN;
    REQUIRE(!pell_medium_valid(&m, NULL));
}

static void mean_free_paths(void **state)
{
    const struct pell_medium *milk = &pell_material_find("wholemilk")->medium, *white = &pell_material_find("spectralon")->medium;
    const struct pell_medium none = { { 0 }, { 0 }, { 0 }, 1.3 };
    (void) state;
    REQUIRE_REL(pell_mean_free_path(milk, 0), 1.0 / 2.5511, 1e-14);
    REQUIRE_REL(pell_diffuse_mean_free_path(milk, 2), 1.0 / sqrt(3.0 * 0.014 * 3.784), 1e-14);
    REQUIRE_REL(pell_mean_free_path(white, 1), 1.0 / 20.4, 1e-14);
    REQUIRE(isinf(pell_diffuse_mean_free_path(white, 1)));
    REQUIRE(isinf(pell_mean_free_path(&none, 0)) && isinf(pell_diffuse_mean_free_path(&none, 0)));
}

/* Rows "| apple | R G B | R G B |": percent, shared and own. Rounded to 3 digits there. */
static void readme_states_the_errors_of_today(void **state)
{
    FILE *file = fopen(PELL_SOURCE_ROOT "/src/optics/README.md", "r");
    char line[256];
    int rows = 0;
    (void) state;
    assert_non_null(file);
    while (fgets(line, sizeof(line), file)) {
        const struct pell_fit_params params = { .count = 4 };
        struct pell_gaussians g;
        struct pell_fit_report shared, own;
        double s[3], o[3];
        char name[32];
        if (sscanf(line, "| %31s | %lf %lf %lf | %lf %lf %lf |", name, &s[0], &s[1], &s[2], &o[0], &o[1], &o[2]) != 7)
            continue;
        const struct pell_material_entry *e = pell_material_find(name);
        assert_non_null(e);
        assert_int_equal(pell_fit_medium(&e->medium, &params, &g, &shared), PELL_OK);
        for (int c = 0; c < 3; c++) {
            const struct pell_dipole d =
                pell_dipole_make(e->medium.sigma_a[c], e->medium.sigma_s_reduced[c], e->medium.eta, PELL_FRESNEL_EXACT);
            assert_int_equal(pell_fit_dipole(&d, &params, &g, &own), PELL_OK);
            REQUIRE_REL(s[c], 100.0 * shared.error[c], 6e-3);
            REQUIRE_REL(o[c], 100.0 * own.error[0], 6e-3);
        }
        rows++;
    }
    fclose(file);
    assert_int_equal(rows, 12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_entry_is_valid_named_and_in_order),
        cmocka_unit_test(unknown_names_are_not_found),
        cmocka_unit_test(measured_coefficients_are_jensens),
        cmocka_unit_test(published_gaussians_are_those_of_the_papers),
        cmocka_unit_test(published_weights_sum_to_one_exactly),
        cmocka_unit_test(table_7_1_blend_constants),
        cmocka_unit_test(four_skin_gaussians_are_near_the_six),
        cmocka_unit_test(skin_is_the_six_gaussians),
        cmocka_unit_test(faults_name_the_first_bad_field),
        cmocka_unit_test(mean_free_paths),
        cmocka_unit_test(readme_states_the_errors_of_today),
    };
    return cmocka_run_group_tests_name("optics.materials", tests, NULL, NULL);
}
