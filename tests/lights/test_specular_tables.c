/* SPDX-License-Identifier: MIT
 * test_specular_tables.c - tables of specular lobes and boundaries that the materials of a scene share. */
#include "pell_test.h"

#include "specular_lookup.h"

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

/* Materials of equal index share its table, in whatever order they are listed; each finds its own lobe and index. */
static void materials_find_their_own_tables(void **state)
{
    static const double etas[] = { 1.0, 1.3, 1.3, 1.5, 4.0, 1.3 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene = make_scene(ctx, PELL_COUNT(etas));
    struct pell_specular_tables *tables;
    struct pell_specular_table lobe[PELL_SPECULAR_MODELS];
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(etas); i++) {
        scene->materials[i].medium.eta = etas[i];
        scene->materials[i].specular = (enum pell_specular_model)(i % (PELL_SPECULAR_MODELS + 1)); /* one more than fits */
    }
    for (int k = 0; k < PELL_SPECULAR_MODELS; k++)
        pell_specular_table_make((enum pell_specular_model) k, &lobe[k]);
    assert_int_equal(pell_specular_tables_create(ctx, scene, 0, &tables), PELL_OK);
    assert_int_equal(tables->num_boundaries, 4);
    for (size_t i = 0; i < PELL_COUNT(etas); i++) {
        const struct pell_specular_table *own = &lobe[i % (PELL_SPECULAR_MODELS + 1) % PELL_SPECULAR_MODELS];
        const struct pell_boundary_table *b = boundary_of(tables, i);
        REQUIRE(b->eta == etas[i]);
        REQUIRE_NEAR(b->f0, pell_fresnel(etas[i], 1.0), 1e-7);
        REQUIRE(material_albedo(tables, i, 0.3f, 0.4f) == (double) pell_specular_albedo(own, b->f0, 0.3f, 0.4f));
        REQUIRE(material_mean(tables, i, 0.7f) == (double) pell_specular_mean(own, b->f0, 0.7f));
    }
    pell_specular_tables_destroy(&tables);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
}

static void nth_allocation_fails_cleanly(void **state)
{
    (void) state;
    for (uint64_t n = 1; n < 20; n++) {
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, NULL);
        struct pell_scene *scene = make_scene(ctx, 3);
        struct pell_specular_tables *tables;
        enum pell_result res;
        scene->materials[1].medium.eta = 1.2;
        fault.fail_at = fault.calls + n;
        res = pell_specular_tables_create(ctx, scene, 0, &tables);
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
        cmocka_unit_test(materials_find_their_own_tables),
        cmocka_unit_test(nth_allocation_fails_cleanly),
    };
    return cmocka_run_group_tests_name("render.specular", tests, NULL, NULL);
}
