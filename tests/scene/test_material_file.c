/* SPDX-License-Identifier: MIT
 * test_material_file.c - material files with concentrations, layers and skin, and refusals. Kinds without these are in test_load.c. */
#include "scene_test.h"

#include <pellucid/skin.h>

static enum pell_result read_text(const char *text, struct pell_material_entry *entry, struct kept_messages *kept)
{
    struct pell_context *ctx = test_context(NULL, kept);
    const enum pell_result res = pell_material_read(ctx, "m/soap.json", (const uint8_t *) text, strlen(text), entry);

    REQUIRE((res == PELL_OK) == (entry->name != NULL));
    pell_free(ctx, (char *) entry->name);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
    return res;
}

static void reads(const char *text, struct pell_material_entry *entry)
{
    struct kept_messages kept = { 0 };
    if (read_text(text, entry, &kept) != PELL_OK)
        fail_msg("%s: %s: %s", text, kept.where, kept.what);
}

static void concentration_scales_the_coefficients_of_the_file(void **state)
{
    struct pell_material_entry e;
    (void) state;
    reads("{\"sigma_a\":[0.1,0.2,0.3],\"sigma_s\":[10,20,30],\"g\":0.9,\"concentration\":0.25,\"dilution\":100}", &e);
    assert_int_equal(e.kind, PELL_MATERIAL_MEDIUM);
    REQUIRE(e.concentration == 0.25 && e.dilution == 100.0);
    REQUIRE_NEAR(e.medium.sigma_a[1], 0.05, 1e-15);
    REQUIRE_NEAR(e.medium.sigma_s_reduced[2], 0.75, 1e-14);
    REQUIRE_NEAR(e.medium.g[0], 0.9, 0);
    reads("{\"sigma_a\":[0.1,0.2,0.3],\"sigma_s_reduced\":[1,2,3]}", &e);
    REQUIRE(e.concentration == 1.0 && e.dilution == 0.0);
}

static void another_medium_can_be_diluted_by_name(void **state)
{
    const struct pell_material_entry *milk = pell_material_find("regular-milk");
    struct pell_material_entry e;
    (void) state;
    reads("{\"same_medium_as\":\"regular-milk\",\"concentration\":0.1}", &e);
    assert_int_equal(e.kind, PELL_MATERIAL_MEDIUM);
    for (int c = 0; c < 3; c++) {
        REQUIRE_REL(e.medium.sigma_a[c], 0.1 * milk->medium.sigma_a[c], 1e-14);
        REQUIRE_REL(e.medium.sigma_s_reduced[c], 0.1 * milk->medium.sigma_s_reduced[c], 1e-14);
        REQUIRE_NEAR(e.color[c], milk->color[c], 1e-4);
    }
    REQUIRE(e.medium.eta == milk->medium.eta && e.dilution == milk->dilution);
    reads("{\"same_medium_as\":\"regular-milk\",\"eta\":1.4}", &e);
    REQUIRE(e.medium.eta == 1.4 && e.medium.sigma_a[0] == milk->medium.sigma_a[0]);
}

#define SKIN3                                                                                                                              \
    "{\"name\":\"epidermis\",\"thickness_mm\":0.25,\"sigma_a\":[0.21,0.21,0.5],\"sigma_s_reduced\":[4.8,6,6.5]},"                          \
    "{\"name\":\"upper\",\"thickness_mm\":0.2,\"sigma_a\":[0.016,0.019,0.03],\"sigma_s_reduced\":[3.2,4,4.6]},"                            \
    "{\"thickness_mm\":\"infinite\",\"sigma_a\":[0.0085,0.1,2.5],\"sigma_s_reduced\":[0.45,0.47,0.48]}"

/* Solved when read: the same values as the built-in entry's, which are stored in its file. */
static void a_stack_is_solved_when_read(void **state)
{
    const struct pell_material_entry *skin = pell_material_find("skin-3layer");
    struct pell_material_entry e;
    (void) state;
    reads("{\"eta\":1.4,\"layers\":[" SKIN3 "]}", &e);
    assert_int_equal(e.kind, PELL_MATERIAL_LAYERS);
    assert_int_equal(e.layers.count, 3);
    assert_string_equal(e.layers.item[1].name, "upper");
    REQUIRE(isinf(e.layers.item[2].thickness_mm) && e.layers.item[0].thickness_mm == 0.25 && e.layers.item[2].medium.eta == 1.4);
    assert_false(e.color_from_texture);
    assert_int_equal(e.gaussians.count, PELL_MATERIAL_LAYERS_GAUSSIANS);
    for (int c = 0; c < 3; c++) {
        REQUIRE_NEAR(pell_gaussians_total(&e.gaussians, c), pell_gaussians_total(&skin->gaussians, c), 1e-6);
        REQUIRE_NEAR(e.color[c], pell_gaussians_total(&e.gaussians, c), 1e-12);
    }
    reads("{\"layers\":[{\"thickness_mm\":1,\"sigma_a\":[0,0,0],\"sigma_s\":[1,2,3],\"phase\":\"rayleigh\"}],"
          "\"variances\":[0.1,1],\"weights\":[[0.1,0.2,0.3],[0.2,0.2,0.2]]}",
          &e);
    REQUIRE(e.gaussians.count == 2 && e.layers.item[0].phase[0].kind == PELL_PHASE_RAYLEIGH);
    REQUIRE_NEAR(pell_gaussians_total(&e.gaussians, 1), 0.4, 1e-15); /* given: not scaled, not solved again */
    reads("{\"layers\":[{\"thickness_mm\":1,\"sigma_a\":[1,1,1],\"sigma_s\":[8,8,8],\"phase\":\"schlick\",\"g\":0.8}]}", &e);
    REQUIRE_NEAR(e.layers.item[0].medium.g[0], 0.632, 5e-4); /* Schlick's k */
    REQUIRE_NEAR(e.layers.item[0].medium.sigma_s_reduced[2], 8.0 * (1.0 - e.layers.item[0].medium.g[2]), 1e-14);
}

static void skin_is_made_of_what_is_in_it(void **state)
{
    struct pell_material_entry light, dark, e;
    struct pell_skin skin = pell_skin_default();
    double rgb[3];
    (void) state;
    reads("{\"skin\":{}}", &e);
    assert_int_equal(pell_skin_color(&skin, rgb), PELL_OK);
    for (int c = 0; c < 3; c++)
        REQUIRE_NEAR(e.color[c], rgb[c], 1e-6);
    REQUIRE(e.medium.eta == 1.4 && e.layers.count == 2);
    reads("{\"kind\":\"layers\",\"skin\":{\"melanin\":0.01}}", &light);
    reads("{\"skin\":{\"melanin\":0.3,\"melanin_blend\":0.6,\"haemoglobin\":0.02,\"oxygenation\":0.6,\"epidermis_mm\":0.12,\"eta\":1.38}}",
          &dark);
    REQUIRE(dark.layers.item[0].thickness_mm == 0.12 && dark.medium.eta == 1.38);
    for (int c = 0; c < 3; c++)
        REQUIRE(dark.color[c] < 0.5 * light.color[c]);
}

#define LAYER(fields) "{\"layers\":[{" fields "}]}"
#define OPTICS "\"sigma_a\":[1,1,1],\"sigma_s_reduced\":[1,1,1]"

static void broken_files_are_refused_with_place_and_reason(void **state)
{
    static const struct {
        const char *text, *where, *what;
    } bad[] = {
        { "{" OPTICS ",\"concentration\":0}", "m/soap.json:/concentration", "is 0, allowed: above 0, at most 1000" },
        { "{" OPTICS ",\"concentration\":-1}", "m/soap.json:/concentration", "is -1" },
        { "{" OPTICS ",\"concentration\":1001}", "m/soap.json:/concentration", "is 1001, allowed: above 0, at most 1000" },
        { "{" OPTICS ",\"concentration\":1e-9}", "m/soap.json:/concentration", "sigma_a + sigma_s_reduced" },
        { "{" OPTICS ",\"concentration\":\"half\"}", "m/soap.json:/concentration", "a number" },
        { "{" OPTICS ",\"dilution\":0.5}", "m/soap.json:/dilution", "is 0.5" },
        { "{\"same_medium_as\":\"marbel\"}", "m/soap.json:/same_medium_as", "there is no material" },
        { "{\"same_medium_as\":\"skin\"}", "m/soap.json:/same_medium_as", "has no coefficients" },
        { "{\"same_medium_as\":\"marble\",\"sigma_a\":[1,1,1]}", "m/soap.json:/sigma_a", "one of them" },
        { "{\"kind\":\"medium\",\"layers\":[]}", "m/soap.json:/layers", "no layers" },
        { "{\"kind\":\"gaussians\",\"skin\":{}}", "m/soap.json:/skin", "no layers" },
        { "{\"kind\":\"layers\"}", "m/soap.json:/", "layers" },
        { "{\"layers\":{}}", "m/soap.json:/layers", "an array" },
        { "{\"layers\":[]}", "m/soap.json:/layers", "0 elements" },
        { "{\"layers\":[1]}", "m/soap.json:/layers/0", "an object" },
        { "{\"layers\":[{},{},{},{},{},{},{},{},{}]}", "m/soap.json:/layers", "9 elements" },
        { "{\"layers\":[{}],\"sigma_a\":[1,1,1]}", "m/soap.json:/sigma_a", "in its layers" },
        { "{\"layers\":[{}],\"concentration\":1}", "m/soap.json:/concentration", "in its layers" },
        { "{\"layers\":[{}],\"same_profile_as\":\"skin\"}", "m/soap.json:/same_profile_as", "of its own" },
        { "{\"layers\":[{}],\"skin\":{}}", "m/soap.json:/layers", "beside skin" },
        { "{\"skin\":{},\"eta\":1.4}", "m/soap.json:/eta", "inside skin" },
        { "{\"skin\":{\"melanin\":1.5}}", "m/soap.json:/skin/melanin", "is 1.5" },
        { "{\"skin\":{\"hemoglobin\":0.1}}", "m/soap.json:/skin/hemoglobin", "unknown key" },
        { "{\"skin\":{\"epidermis_mm\":0}}", "m/soap.json:/skin/epidermis_mm", "is 0" },
        { LAYER(OPTICS), "m/soap.json:/layers/0", "thickness_mm" },
        { LAYER(OPTICS ",\"thickness_mm\":0"), "m/soap.json:/layers/0/thickness_mm", "is 0" },
        { LAYER(OPTICS ",\"thickness_mm\":-1"), "m/soap.json:/layers/0/thickness_mm", "is -1" },
        { LAYER(OPTICS ",\"thickness_mm\":1e7"), "m/soap.json:/layers/0/thickness_mm", "is 1" },
        { LAYER(OPTICS ",\"thickness_mm\":\"1mm\""), "m/soap.json:/layers/0/thickness_mm", "a number" },
        { "{\"layers\":[{\"thickness_mm\":\"infinite\"," OPTICS "},{\"thickness_mm\":1," OPTICS "}]}", "m/soap.json:/layers/0/thickness_mm",
          "only the last" },
        { LAYER("\"thickness_mm\":1,\"sigma_s_reduced\":[1,1,1]"), "m/soap.json:/layers/0", "sigma_a" },
        { LAYER("\"thickness_mm\":1,\"sigma_a\":[1,1,1]"), "m/soap.json:/layers/0", "sigma_s_reduced" },
        { LAYER("\"thickness_mm\":1,\"sigma_a\":[1,1,1],\"sigma_s\":[1,1,1]"), "m/soap.json:/layers/0", "without g" },
        { LAYER("\"thickness_mm\":1," OPTICS ",\"sigma_s\":[1,1,1],\"g\":0"), "m/soap.json:/layers/0", "both" },
        { LAYER("\"thickness_mm\":1,\"sigma_a\":[0,0,0],\"sigma_s_reduced\":[1,0,1]"), "m/soap.json:/layers/0", "must not be 0" },
        { LAYER("\"thickness_mm\":1,\"sigma_a\":[1,1,1e7],\"sigma_s_reduced\":[1,1,1]"), "m/soap.json:/layers/0/sigma_a/2", "is 1" },
        { LAYER("\"thickness_mm\":1," OPTICS ",\"phase\":\"mie\""), "m/soap.json:/layers/0/phase", "mie" },
        { LAYER("\"thickness_mm\":1," OPTICS ",\"phase\":\"rayleigh\",\"g\":0.5"), "m/soap.json:/layers/0/g", "rayleigh" },
        { LAYER("\"thickness_mm\":1," OPTICS ",\"g\":1"), "m/soap.json:/layers/0/g", "is 1" },
        { LAYER("\"thickness_mm\":1," OPTICS ",\"eta\":0.5"), "m/soap.json:/layers/0/eta", "0.5" },
        { LAYER("\"thickness_mm\":1," OPTICS ",\"depth\":1"), "m/soap.json:/layers/0/depth", "unknown key" },
        { LAYER("\"thickness_mm\":1," OPTICS ",\"name\":\"a name that is longer than what fits\""), "m/soap.json:/layers/0/name", "bytes" },
        { LAYER("\"thickness_mm\":1,\"sigma_a\":[1,1,1],\"sigma_s_reduced\":[0,0,0]"), "m/soap.json:/layers/0", "does not scatter" },
        { "{\"layers\":[{\"thickness_mm\":1," OPTICS "}],\"variances\":[1]}", "m/soap.json:/", "weights" },
        { "{\"layers\":[{\"thickness_mm\":1," OPTICS "}],\"variances\":[1,2],\"weights\":[[0.6,0,0],[0.6,0.1,0.1]]}",
          "m/soap.json:/weights", "at most 1" },
    };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        struct kept_messages kept = { 0 };
        struct pell_material_entry e;
        const enum pell_result res = read_text(bad[i].text, &e, &kept);
        if (res != PELL_ERR_FORMAT && res != PELL_ERR_INVALID)
            fail_msg("%s: result %d", bad[i].text, res);
        assert_int_equal(kept.errors, 1);
        if (strncmp(kept.where, bad[i].where, strlen(bad[i].where)) != 0 || !strstr(kept.what, bad[i].what))
            fail_msg("%s\n%s: %s, wanted %s: %s", bad[i].text, kept.where, kept.what, bad[i].where, bad[i].what);
    }
}

static void slips_of_the_pen_find_the_nearest_of_many_names(void **state)
{
    /* clang-format off */
    static const char *const slips[][2] = {
        { "regular-mlik", "regular-milk" }, { "skin3layer", "skin-3layer" },   { "esspresso", "espresso" },
        { "head-and-shoulders", "head-and-shoulders-shampoo" },                { "jaed", "jade" },
        { "budwiser-beer", "budweiser-beer" }, { "Merlot", "merlot" },         { "pacific-ocean", "pacific-ocean-surface-water" },
        { "apple_juice", "apple-juice" },      { "grapefruit", "ruby-grapefruit-juice" },
    };
    /* clang-format on */
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(slips); i++) {
        struct kept_messages kept = { 0 };
        struct pell_context *ctx = test_context(NULL, &kept);
        struct pell_material_entry e;
        assert_int_equal(pell_material_open(ctx, "--material", slips[i][0], &e), PELL_ERR_INVALID);
        if (!strstr(kept.hint, slips[i][1]))
            fail_msg("%s: %s", slips[i][0], kept.hint);
        pell_context_destroy(&ctx);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(concentration_scales_the_coefficients_of_the_file),
        cmocka_unit_test(another_medium_can_be_diluted_by_name),
        cmocka_unit_test(a_stack_is_solved_when_read),
        cmocka_unit_test(skin_is_made_of_what_is_in_it),
        cmocka_unit_test(broken_files_are_refused_with_place_and_reason),
        cmocka_unit_test(slips_of_the_pen_find_the_nearest_of_many_names),
    };
    return cmocka_run_group_tests_name("scene.material_file", tests, NULL, NULL);
}
