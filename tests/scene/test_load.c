/* SPDX-License-Identifier: MIT
 * test_load.c - detection of formats, units, sizes, materials and cameras by name, and error handling. */
#include "scene_test.h"

#include "base/file.h"

struct attempt {
    enum pell_result res;
    struct kept_messages kept;
};

static struct attempt try_text(const char *name, const char *text, const struct pell_load_params *params)
{
    struct attempt a = { .res = PELL_OK };
    struct pell_context *ctx = test_context(NULL, &a.kept);
    struct pell_scene *s;

    a.res = load_text(ctx, name, text, params, &s);
    REQUIRE((a.res == PELL_OK) == (s != NULL));
    REQUIRE((a.res == PELL_OK) == (a.kept.errors == 0));
    REQUIRE(a.res == PELL_OK || (a.kept.errors == 1 && a.kept.code == a.res));
    pell_scene_destroy(&s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
    return a;
}

#define TRIANGLE_PLY                                                                                                                       \
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"                      \
    "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"

static void a_mesh_without_a_unit_is_refused_with_the_reason(void **state)
{
    static const char *const texts[] = { CUBE, TRIANGLE_PLY };
    static const char *const names[] = { "cube.obj", "three.ply" };
    (void) state;

    for (int i = 0; i < 2; i++) {
        const struct attempt a = try_text(names[i], texts[i], NULL);
        assert_int_equal(a.res, PELL_ERR_INVALID);
        assert_string_equal(a.kept.where, names[i]);
        assert_non_null(strstr(a.kept.what, "files have no unit"));
        assert_non_null(strstr(a.kept.hint, "--size 70mm"));
        assert_non_null(strstr(a.kept.hint, "--unit 1mm"));
    }
}

static void a_unit_and_a_size_together_are_refused(void **state)
{
    const struct pell_load_params both = { .mm_per_unit = 1.0, .size_mm = 70.0 }, infinite = { .size_mm = INFINITY };
    const struct pell_load_params negative = { .mm_per_unit = -1.0 }, never = { .mm_per_unit = 1.0, .time = NAN };
    const struct pell_load_params nan_time = { .mm_per_unit = 1.0, .time = NAN }, huge = { .mm_per_unit = 1e300 };
    (void) state;

    assert_int_equal(try_text("cube.obj", CUBE, &both).res, PELL_ERR_INVALID);
    assert_int_equal(try_text("cube.obj", CUBE, &infinite).res, PELL_ERR_INVALID);
    assert_int_equal(try_text("cube.obj", CUBE, &negative).res, PELL_ERR_INVALID);
    assert_int_equal(try_text("cube.obj", CUBE, &never).res, PELL_ERR_INVALID);
    assert_int_equal(try_text("cube.obj", CUBE, &nan_time).res, PELL_ERR_INVALID);
    assert_int_equal(try_text("cube.obj", CUBE, &huge).res, PELL_ERR_INVALID);
}

/* Parts without a name are named after the file, in messages and lists. */
static void meshes_without_names_have_the_files(void **state)
{
    static const char *const two = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no named\nf 1 2 3\no\nf 3 2 1\n";
    static const char *const expected[] = { "three 1", "named", "three 3" };
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_load_params params = { .mm_per_unit = 1.0, .bare = true };
    struct pell_scene *s;
    (void) state;

    assert_int_equal(load_text(ctx, "cube.obj", CUBE, &params, &s), PELL_OK);
    assert_true(s->meshes[0].name[0]);
    pell_scene_destroy(&s);
    assert_int_equal(load_text(ctx, "three.ply", TRIANGLE_PLY, &params, &s), PELL_OK);
    assert_string_equal(s->meshes[0].name, "three");
    pell_scene_destroy(&s);
    assert_int_equal(load_text(ctx, "folder/of.two/three.obj", two, &params, &s), PELL_OK);
    assert_int_equal(s->num_meshes, PELL_COUNT(expected));
    for (size_t i = 0; i < s->num_meshes; i++)
        assert_string_equal(s->meshes[i].name, expected[i]);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void a_size_is_the_largest_extent(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_load_params params = { .size_mm = 70.0, .bare = true };
    struct pell_scene *s;
    (void) state;

    assert_int_equal(load_text(ctx, "a.obj", "v 1 1 1\nv 3 1 1\nv 1 1.5 8\nf 1 2 3\nv 1000 0 0\n", &params, &s), PELL_OK);
    REQUIRE_NEAR(s->bounds_max[2] - s->bounds_min[2], 70.0, 1e-4); /* a point that no face uses does not count */
    REQUIRE_NEAR(s->bounds_max[0] - s->bounds_min[0], 20.0, 1e-4);
    REQUIRE_NEAR(s->mm_per_unit, 10.0, 1e-9);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
    assert_int_equal(try_text("a.obj", "v 1 1 1\nf 1 1 1\n", &params).res, PELL_ERR_FORMAT);
}

static void absurd_sizes_are_warned_of(void **state)
{
    const struct pell_load_params tiny = { .size_mm = 0.05 }, huge = { .size_mm = 200000.0 }, fine = { .size_mm = 0.2 };
    (void) state;

    assert_int_equal(try_text("cube.obj", CUBE, &tiny).kept.warnings, 1);
    assert_int_equal(try_text("cube.obj", CUBE, &huge).kept.warnings, 1);
    assert_int_equal(try_text("cube.obj", CUBE, &fine).kept.warnings, 0);
}

static void formats_are_told_by_content(void **state)
{
    static const char gltf[] = "{\"asset\":{\"version\":\"2.0\"},\"scenes\":[{\"nodes\":[]}],\"scene\":0}";
    struct attempt a;
    (void) state;

    assert_int_equal(try_text("no-ending", CUBE, &in_mm).res, PELL_OK);
    assert_int_equal(try_text("wrong.ply", "# made by hand\n\n" CUBE, &in_mm).res, PELL_OK);
    assert_int_equal(try_text("wrong.obj", TRIANGLE_PLY, &in_mm).res, PELL_OK);
    a = try_text("wrong.json", gltf, &in_mm); /* a glTF without content */
    assert_int_equal(a.res, PELL_ERR_FORMAT);
    REQUIRE(!strstr(a.kept.what, "pellucid"));
    a = try_text("scene.json", "{\"pellucid\": 2}", NULL);
    assert_int_equal(a.res, PELL_ERR_FORMAT);
    assert_string_equal(a.kept.where, "scene.json:/pellucid");
    a = try_text("thing", "solid cube\nfacet normal\n", &in_mm); /* an STL without content */
    assert_int_equal(a.res, PELL_ERR_FORMAT);
    assert_non_null(strstr(a.kept.what, "holds no triangles"));
    a = try_text("thing.fbx", "Kaydara FBX Binary", &in_mm);
    assert_non_null(strstr(a.kept.what, "FBX"));
    assert_non_null(strstr(a.kept.hint, "assimp export IN.fbx OUT.glb"));
    a = try_text("empty", "", &in_mm);
    assert_non_null(strstr(a.kept.what, "an empty file"));
}

static void a_missing_file_is_an_io_error(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_scene *s;
    (void) state;

    assert_int_equal(pell_scene_load(ctx, "/nonexistent/a.obj", &in_mm, &s), PELL_ERR_IO);
    assert_int_equal(kept.errors, 1);
    assert_null(s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

/* --- Materials ------------------------------------------------------------------------------------------------------------------- */

static void materials_are_found_by_name(void **state)
{
    struct pell_load_params params = { .mm_per_unit = 10.0, .material = "wholemilk", .bare = true };
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_material_entry *milk = pell_material_find("wholemilk");
    struct attempt a;
    struct pell_scene *s;
    (void) state;

    assert_int_equal(load_text(ctx, "a.obj", CUBE, &params, &s), PELL_OK);
    assert_string_equal(s->materials[s->meshes[0].material].preset, "wholemilk");
    assert_memory_equal(&s->materials[0].medium, &milk->medium, sizeof(milk->medium)); /* 1/mm, whatever the mesh's unit */
    REQUIRE(!s->materials[0].opaque);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);

    params.material = "wholmilk";
    a = try_text("a.obj", CUBE, &params);
    assert_int_equal(a.res, PELL_ERR_INVALID);
    assert_non_null(strstr(a.kept.hint, "\"wholemilk\""));
    params.material = "nowhere/x.json";
    assert_int_equal(try_text("a.obj", CUBE, &params).res, PELL_ERR_IO);
    assert_int_equal(try_text("a.obj", CUBE, &(struct pell_load_params) { .mm_per_unit = 1, .camera = "front" }).res, PELL_ERR_INVALID);
}

static enum pell_result read_material(const char *text, struct pell_material_entry *entry, struct kept_messages *kept)
{
    struct pell_context *ctx = test_context(NULL, kept);
    const enum pell_result res = pell_material_read(ctx, "m/soap.json", (const uint8_t *) text, strlen(text), entry);

    if (res == PELL_OK)
        assert_string_equal(entry->name, strstr(text, "\"name\"") ? "x" : "soap.json");
    else
        assert_null(entry->name);
    pell_free(ctx, (char *) entry->name);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
    return res;
}

static void material_files_need_only_their_optics(void **state)
{
    struct pell_material_entry e;
    (void) state;

    assert_int_equal(read_material("{\"sigma_a\":[0.1,0.2,0.3],\"sigma_s_reduced\":[1,2,3]}", &e, NULL), PELL_OK);
    assert_int_equal(e.kind, PELL_MATERIAL_MEDIUM);
    REQUIRE_NEAR(e.medium.eta, 1.3, 0);
    assert_false(e.color_from_texture);
    {
        const struct pell_dipole d = pell_dipole_make(0.1, 1.0, 1.3, PELL_FRESNEL_EXACT);
        REQUIRE_NEAR(e.color[0], pell_dipole_total(&d), 1e-12); /* its colour follows from its coefficients */
    }
    assert_int_equal(read_material("{\"name\":\"x\",\"sigma_a\":[0.1,0.2,0.3],\"sigma_s\":[1,2,4],\"g\":0.75,\"eta\":1.5,\"mix\":1,"
                                   "\"color_from\":\"texture\",\"color\":[0.1,0.2,0.3],\"roughness\":0.9}",
                                   &e, NULL),
                     PELL_OK);
    REQUIRE_NEAR(e.medium.sigma_s_reduced[2], 1.0, 1e-15);
    REQUIRE_NEAR(e.medium.g[1], 0.75, 0);
    assert_true(e.color_from_texture);
    REQUIRE_NEAR(e.color[1], 0.2, 0);
    assert_int_equal(read_material("{\"variances\":[0.1,2],\"weights\":[[0.5,0.2,0.1],[0.5,0.2,0.3]]}", &e, NULL), PELL_OK);
    assert_int_equal(e.kind, PELL_MATERIAL_GAUSSIANS);
    for (int c = 0; c < 3; c++)
        REQUIRE_NEAR(pell_gaussians_total(&e.gaussians, c), 1.0, 1e-12); /* white: colour comes from textures */
    assert_true(e.color_from_texture);
    assert_int_equal(read_material("{\"same_profile_as\":\"skin-4gaussian\"}", &e, NULL), PELL_OK);
    assert_int_equal(e.gaussians.count, 4);
}

static void broken_material_files_are_refused(void **state)
{
    static const struct {
        const char *text, *where, *what;
    } bad[] = {
        { "{", "m/soap.json:1:", "not valid JSON" },
        { "[]", "m/soap.json:/", "an object" },
        { "{\"sigma_a\":[1,1,1]}", "m/soap.json:/", "sigma_s_reduced" },
        { "{\"sigma_s_reduced\":[1,1,1]}", "m/soap.json:/", "sigma_a" },
        { "{\"sigma_a\":[1,1,-1],\"sigma_s_reduced\":[1,1,1]}", "m/soap.json:/sigma_a/2", "is -1" },
        { "{\"sigma_a\":[1,1],\"sigma_s_reduced\":[1,1,1]}", "m/soap.json:/sigma_a", "an array of 2" },
        { "{\"sigma_a\":[0,0,0],\"sigma_s_reduced\":[1,0,1]}", "m/soap.json:/", "must not be 0" },
        { "{\"sigma_a\":[1,1,1],\"sigma_s\":[1,1,1]}", "m/soap.json:/", "without g" },
        { "{\"sigma_a\":[1,1,1],\"sigma_s\":[1,1,1],\"sigma_s_reduced\":[1,1,1],\"g\":0}", "m/soap.json:/", "has both" },
        { "{\"sigma_a\":[1,1,1],\"sigma_s_reduced\":[1,1,1],\"eta\":0.5}", "m/soap.json:/eta", "0.5" },
        { "{\"sigma_a\":[1,1,1],\"sigma_s_reduced\":[1,1,1],\"ete\":1.5}", "m/soap.json:/ete", "unknown key" },
        { "{\"sigma_a\":[1,1,1],\"sigma_s_reduced\":[1,1,1],\"title\":5}", "m/soap.json:/title", "a string" },
        { "{\"variances\":[2,1],\"weights\":[[1,1,1],[1,1,1]]}", "m/soap.json:/variances/1", "is 1" },
        { "{\"variances\":[1,2],\"weights\":[[1,1,1]]}", "m/soap.json:/weights", "1 elements" },
        { "{\"variances\":[1],\"weights\":[[1,0,1]]}", "m/soap.json:/weights", "channel 1" },
        { "{\"variances\":[1],\"weights\":[[1,1,1]],\"sigma_a\":[1,1,1]}", "m/soap.json:/sigma_a", "no coefficients" },
        { "{\"kind\":\"medium\",\"variances\":[1],\"weights\":[[1,1,1]]}", "m/soap.json:/variances", "no Gaussians" },
        { "{\"same_profile_as\":\"marble\"}", "m/soap.json:/same_profile_as", "has no Gaussians" },
    };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        struct kept_messages kept = { 0 };
        struct pell_material_entry e;
        assert_int_equal(read_material(bad[i].text, &e, &kept), PELL_ERR_FORMAT);
        assert_int_equal(kept.errors, 1);
        if (strncmp(kept.where, bad[i].where, strlen(bad[i].where)) != 0 || !strstr(kept.what, bad[i].what))
            fail_msg("%s: %s, wanted %s: %s", kept.where, kept.what, bad[i].where, bad[i].what);
    }
}

static void built_in_files_read_as_their_entries(void **state)
{
    (void) state;
    for (size_t i = 0; i < pell_material_count(); i++) {
        const struct pell_material_entry *want = pell_material_at(i);
        struct pell_context *ctx = test_context(NULL, NULL);
        struct pell_material_entry e;
        uint8_t *data;
        size_t size;
        char path[1024];
        snprintf(path, sizeof(path), "%s/%s.json", MATERIALS, want->name);
        assert_int_equal(pell_file_read(ctx, path, &data, &size), PELL_OK);
        assert_int_equal(pell_material_read(ctx, path, data, size, &e), PELL_OK);
        assert_string_equal(e.name, want->name);
        assert_int_equal(e.kind, want->kind);
        assert_int_equal(e.color_from_texture, want->color_from_texture);
        REQUIRE_NEAR(e.roughness, want->roughness, 1e-12);
        REQUIRE_NEAR(e.mix, want->mix, 1e-12);
        REQUIRE_NEAR(e.medium.eta, want->medium.eta, 1e-12);
        assert_int_equal(e.gaussians.count, want->gaussians.count);
        for (int c = 0; c < 3; c++) {
            REQUIRE_NEAR(e.color[c], want->color[c], 1e-12);
            REQUIRE_NEAR(e.medium.sigma_a[c], want->medium.sigma_a[c], 1e-12);
            REQUIRE_NEAR(e.medium.sigma_s_reduced[c], want->medium.sigma_s_reduced[c], 1e-12);
            for (int g = 0; g < e.gaussians.count; g++)
                REQUIRE_NEAR(e.gaussians.weight[g][c], want->gaussians.weight[g][c], 1e-9);
        }
        pell_free(ctx, (char *) e.name);
        pell_free(ctx, data);
        assert_int_equal(pell_memory_used(ctx), 0);
        pell_context_destroy(&ctx);
    }
}

/* --- Errors ------------------------------------------------------------------------------------------------------------------------- */

static void a_cancelled_context_reads_nothing(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s;
    (void) state;

    pell_context_cancel(ctx);
    assert_int_equal(load_text(ctx, "a.obj", CUBE, &in_mm, &s), PELL_ERR_CANCELLED);
    assert_null(s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void an_unsaid_material_is_marble(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s;
    (void) state;

    assert_int_equal(load_text(ctx, "a.obj", CUBE, &in_mm, &s), PELL_OK);
    assert_int_equal(s->num_materials, 1);
    assert_string_equal(s->materials[0].preset, "marble");
    assert_int_equal(s->background, PELL_BACKGROUND_COLOR);
    REQUIRE_NEAR(s->background_color[0], 0.18, 1e-6);
    assert_int_equal(s->ground_mesh, -1);
    pell_scene_destroy(&s);
    assert_int_equal(load_text(ctx, "a.obj", CUBE, &bare_mm, &s), PELL_OK);
    assert_int_equal(s->num_lights + s->num_cameras, 0);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void a_scene_in_memory_looks_for_files_in_its_folder(void **state)
{
    static const char text[] = "{ \"pellucid\": 1, \"mesh\": \"cube.obj\", \"unit\": \"1mm\" }";
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_scene *s;
    (void) state;

    assert_int_equal(pell_scene_load_memory(ctx, "no/such/folder/made.json", text, sizeof(text) - 1, NULL, &s), PELL_ERR_IO);
    assert_null(s);
    assert_non_null(strstr(kept.what, "cube.obj"));
    assert_int_equal(pell_scene_load_memory(ctx, "made.obj", CUBE, sizeof(CUBE) - 1, &in_mm, &s), PELL_OK);
    assert_int_equal(s->num_meshes, 1);
    pell_scene_destroy(&s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void uv_sets_and_pixels_are_allocated_once_and_within_range(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_texture *texture;
    struct pell_scene *s;
    size_t mesh;
    (void) state;

    assert_int_equal(pell_scene_create(ctx, &s), PELL_OK);
    assert_int_equal(pell_scene_add_mesh(s, "m", &mesh), PELL_OK);
    assert_int_equal(pell_mesh_allocate_uv(s, mesh, 0), PELL_ERR_INVALID);
    assert_int_equal(pell_mesh_allocate(s, mesh, 3, 1), PELL_OK);
    assert_int_equal(pell_mesh_allocate_uv(s, mesh, PELL_UV_SETS), PELL_ERR_INVALID);
    assert_int_equal(pell_mesh_allocate_uv(s, mesh, -1), PELL_ERR_INVALID);
    assert_int_equal(pell_mesh_allocate_uv(s, mesh + 1, 0), PELL_ERR_INVALID);
    assert_int_equal(pell_mesh_allocate_uv(s, mesh, 1), PELL_OK);
    assert_non_null(s->meshes[0].uv[1]);
    assert_int_equal(pell_mesh_allocate_uv(s, mesh, 1), PELL_ERR_INVALID);
    assert_int_equal(pell_scene_add_texture(s, "t", &texture), PELL_OK);
    assert_int_equal(pell_texture_allocate(s, texture, 4, 0, 3, PELL_PIXEL_U8), PELL_ERR_INVALID);
    assert_int_equal(pell_texture_allocate(s, texture, 2000000000, 2000000000, 3, PELL_PIXEL_U8), PELL_ERR_INVALID);
    assert_int_equal(pell_texture_allocate(s, texture, 4, 2, 5, PELL_PIXEL_U8), PELL_ERR_INVALID);
    assert_int_equal(pell_texture_allocate(s, texture, 4, 2, 3, PELL_PIXEL_F32), PELL_OK);
    assert_int_equal(texture->image.width * texture->image.height * texture->image.channels, 24);
    assert_int_equal(pell_texture_allocate(s, texture, 4, 2, 3, PELL_PIXEL_F32), PELL_ERR_INVALID);
    pell_scene_destroy(&s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_mesh_without_a_unit_is_refused_with_the_reason),
        cmocka_unit_test(a_unit_and_a_size_together_are_refused),
        cmocka_unit_test(a_size_is_the_largest_extent),
        cmocka_unit_test(absurd_sizes_are_warned_of),
        cmocka_unit_test(formats_are_told_by_content),
        cmocka_unit_test(a_missing_file_is_an_io_error),
        cmocka_unit_test(materials_are_found_by_name),
        cmocka_unit_test(material_files_need_only_their_optics),
        cmocka_unit_test(broken_material_files_are_refused),
        cmocka_unit_test(built_in_files_read_as_their_entries),
        cmocka_unit_test(a_cancelled_context_reads_nothing),
        cmocka_unit_test(an_unsaid_material_is_marble),
        cmocka_unit_test(meshes_without_names_have_the_files),
        cmocka_unit_test(a_scene_in_memory_looks_for_files_in_its_folder),
        cmocka_unit_test(uv_sets_and_pixels_are_allocated_once_and_within_range),
    };
    return cmocka_run_group_tests_name("load", tests, NULL, NULL);
}
