/* SPDX-License-Identifier: MIT
 * test_gltf_glossiness.c - materials of KHR_materials_pbrSpecularGlossiness, imported as a dielectric with a tinted reflectance at
 * normal incidence. */
#include "gltf_test.h"

/* 2 x 1 pixels, RGBA: a glossy red one, and 10, 20, 30 with alpha 51. */
#define PNG "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAYAAAD0In+KAAAAEUlEQVR42mP4z8Dwn0tEzhgADc8CbjtDsogAAAAASUVORK5CYII="
#define FILE_OF(material, image)                                                                                                           \
    "{\"asset\":{\"version\":\"2.0\"},\"extensionsUsed\":[\"KHR_materials_pbrSpecularGlossiness\"],"                                       \
    "\"extensionsRequired\":[\"KHR_materials_pbrSpecularGlossiness\"]," SQUARE_BUFFERS SQUARE_ACCESSORS "\"nodes\":[{\"mesh\":0}],"        \
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":3},\"indices\":5,\"material\":0}]}],"                     \
    "\"samplers\":[{\"wrapS\":33071,\"magFilter\":9728}],\"textures\":[{\"source\":0,\"sampler\":0}],"                                     \
    "\"images\":[{\"uri\":\"data:image/png;base64," image "\"}],"                                                                          \
    "\"materials\":[{\"pbrMetallicRoughness\":{\"metallicFactor\":1,\"roughnessFactor\":0.5,\"baseColorFactor\":[0,0,0,1]},"               \
    "\"extensions\":{\"KHR_materials_pbrSpecularGlossiness\":{" material "}}}]}"

struct fixture {
    struct pell_alloc_fault fault;
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_scene *scene;
    enum pell_result res;
};

static void begin(struct fixture *f, const char *json, uint64_t fail_at)
{
    const struct square square = make_square();
    struct pell_context_params params = { .log = keep_message, .log_user = &f->kept };

    memset(f, 0, sizeof(*f));
    params.allocator = pell_failing_allocator(&f->fault);
    assert_int_equal(pell_context_create(&params, &f->ctx), PELL_OK);
    f->fault.fail_at = fail_at > 0 ? f->fault.calls + fail_at : 0;
    f->res = import_glb(f->ctx, json, &square, sizeof(square), &f->scene);
}

static void end(struct fixture *f)
{
    pell_scene_destroy(&f->scene);
    pell_context_destroy(&f->ctx);
    assert_int_equal(f->fault.live, 0);
}

static const struct pell_material *material_of(struct fixture *f, const char *json)
{
    begin(f, json, 0);
    if (f->res != PELL_OK)
        fail_msg("refused: %s: %s", f->kept.where, f->kept.what);
    assert_int_equal(f->kept.warnings, 0);
    return &f->scene->materials[0];
}

static void factors_stand_in_for_metal_and_roughness(void **state)
{
    struct fixture f;
    const struct pell_material *m =
        material_of(&f, FILE_OF("\"diffuseFactor\":[0.1,0.2,0.3,0.9],\"specularFactor\":[0.04,0.5,1],\"glossinessFactor\":0.75", PNG));
    (void) state;

    REQUIRE(m->base_color[0] == 0.1f && m->base_color[1] == 0.2f && m->base_color[2] == 0.3f && m->base_color[3] == 0.9f);
    REQUIRE(m->metallic == 0.0f && m->roughness == 0.25f && !m->metallic_map.texture && !m->roughness_map.texture);
    for (int c = 0; c < 3; c++) /* times the 4 % of a dielectric of index 1.5 */
        REQUIRE_NEAR(0.04 * (double) m->specular_color[c], ((const double[]) { 0.04, 0.5, 1.0 })[c], 1e-6);
    end(&f);
    m = material_of(&f, FILE_OF("", PNG)); /* the extension's defaults: a white mirror */
    REQUIRE(m->base_color[0] == 1.0f && m->roughness == 0.0f && fabsf(m->specular_color[1] - 25.0f) < 1e-4f);
    end(&f);
}

static void the_alpha_of_a_texture_is_glossiness(void **state)
{
    static const uint8_t rough[2] = { 128, 230 }; /* 1 - 0.5, 1 - 0.5 x 0.2 */
    struct fixture f;
    const struct pell_material *m =
        material_of(&f, FILE_OF("\"glossinessFactor\":0.5,\"diffuseTexture\":{\"index\":0},\"specularGlossinessTexture\":{\"index\":0,"
                                "\"extensions\":{\"KHR_texture_transform\":{\"offset\":[0.25,0]}}}",
                                PNG));
    const struct pell_texture *texture = m->roughness_map.texture;
    (void) state;

    REQUIRE(texture && texture != m->specular_color_map.texture && m->base_color_map.texture && m->roughness == 1.0f);
    REQUIRE(texture->image.channels == 1 && texture->image.width == 2 && texture->image.height == 1 && texture->nearest);
    REQUIRE(texture->wrap_u == PELL_WRAP_CLAMP && m->roughness_map.channel == 0 && m->roughness_map.matrix[2] == 0.25f);
    assert_memory_equal(texture->image.pixels, rough, sizeof(rough));
    end(&f);
    m = material_of(&f, FILE_OF("\"glossinessFactor\":0.5,\"specularGlossinessTexture\":{\"index\":0}", TINY_PNG)); /* no alpha means 1 */
    REQUIRE(!m->roughness_map.texture && m->roughness == 0.5f && m->specular_color_map.texture);
    end(&f);
}

static void what_is_wrong_is_refused(void **state)
{
    static const char *const wrong[] = {
        FILE_OF("\"glossinessFactor\":\"high\"", PNG),
        FILE_OF("\"diffuseFactor\":[1,1,1]", PNG),
        FILE_OF("\"specularGlossinessTexture\":{\"index\":7}", PNG),
    };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(wrong); i++) {
        struct fixture f;
        begin(&f, wrong[i], 0);
        if (f.res == PELL_OK || f.kept.errors != 1 || !strstr(f.kept.where, "KHR_materials_pbrSpecularGlossiness"))
            fail_msg("%zu: %d, %d errors, %s: %s", i, f.res, f.kept.errors, f.kept.where, f.kept.what);
        end(&f);
    }
}

static void every_failed_allocation_is_survived(void **state)
{
    enum pell_result res = PELL_ERR_NOMEM;
    uint64_t n = 0;
    (void) state;

    while (res != PELL_OK && n < 500) {
        struct fixture f;
        begin(&f, FILE_OF("\"specularGlossinessTexture\":{\"index\":0}", PNG), ++n);
        res = f.res;
        REQUIRE(res == PELL_OK || res == PELL_ERR_NOMEM);
        end(&f);
    }
    REQUIRE(n > 10 && n < 500);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(factors_stand_in_for_metal_and_roughness),
        cmocka_unit_test(the_alpha_of_a_texture_is_glossiness),
        cmocka_unit_test(what_is_wrong_is_refused),
        cmocka_unit_test(every_failed_allocation_is_survived),
    };
    return cmocka_run_group_tests_name("gltf glossiness", tests, NULL, NULL);
}
