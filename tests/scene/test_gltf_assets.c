/* SPDX-License-Identifier: MIT
 * test_gltf_assets.c - the glTF reader on real files: counts, transforms, media, texture transforms. Skips files that are absent. */
#include "gltf_test.h"

#include <pellucid/material.h>

struct fixture {
    struct pell_alloc_fault fault;
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_scene *scene;
};

static void load(struct fixture *f, const char *name)
{
    const char *path = strncmp(name, "tests/", 6) == 0 ? project_file(name) : shared_file(name);
    memset(f, 0, sizeof(*f));
    f->ctx = test_context(&f->fault, &f->kept);
    assert_non_null(f->ctx);
    if (import_file(f->ctx, path, &f->scene) != PELL_OK)
        fail_msg("%s: %s: %s", name, f->kept.where, f->kept.what);
}

static void unload(struct fixture *f)
{
    pell_scene_destroy(&f->scene);
    pell_context_destroy(&f->ctx);
    assert_int_equal(f->fault.live, 0);
}

static struct pell_vec3 point(const struct pell_mesh *m, uint32_t i)
{
    return vec3_load(m->position + 3 * (size_t) i);
}

/* Every value finite, every index in range, normals of length one where there are any. */
static void check_mesh(const struct pell_mesh *m)
{
    for (size_t i = 0; i < 3 * (size_t) m->num_triangles; i++)
        REQUIRE(m->index[i] < m->num_vertices);
    for (size_t i = 0; i < m->num_vertices; i++) {
        const struct pell_vec3 n = vec3_load(m->normal + 3 * i), p = point(m, (uint32_t) i);
        const float l = vec3_length(n);
        REQUIRE(isfinite(p.x) && isfinite(p.y) && isfinite(p.z));
        REQUIRE(l == 0.0f || fabsf(l - 1.0f) < 1e-5f);
        if (m->tangent) {
            REQUIRE_NEAR(vec3_length(vec3_load(m->tangent + 4 * i)), 1.0, 1e-5);
            REQUIRE(fabsf(m->tangent[4 * i + 3]) == 1.0f);
        }
    }
}

/* The fraction of triangles, by area, that are oriented like their corners' normals. */
static double agreement(const struct pell_scene *scene, const char *name)
{
    double good = 0.0, all = 0.0;
    for (size_t k = 0; k < scene->num_meshes; k++) {
        const struct pell_mesh *m = &scene->meshes[k];
        if (name && strcmp(m->name, name) != 0)
            continue;
        for (uint32_t t = 0; t < m->num_triangles; t++) {
            const uint32_t *i = m->index + 3 * (size_t) t;
            const struct pell_vec3 a = point(m, i[0]), n = vec3_cross(vec3_sub(point(m, i[1]), a), vec3_sub(point(m, i[2]), a));
            struct pell_vec3 sum = vec3(0, 0, 0);
            for (int c = 0; c < 3; c++)
                sum = vec3_add(sum, vec3_load(m->normal + 3 * (size_t) i[c]));
            all += vec3_length(n);
            if (vec3_dot(n, sum) > 0.0f)
                good += vec3_length(n);
        }
    }
    return good / all;
}

static void all_assets_have_the_counts_of_their_table(void **state)
{
    /* vertices and triangles as drawn: each instance counts, meshes that no node of the scene references do not */
    static const struct {
        const char *name;
        int64_t vertices, triangles;
        int meshes, textures;
        bool translucent;
    } rows[] = {
        { "head_lps/head.gltf", 9279, 17684, 1, 3, true },
        { "head_lps/LeePerrySmith.glb", 9279, 17684, 1, 0, false },
        { "plato/plato.gltf", 9019, 17064, 1, 1, true },
        { "marble_player/marble_player.gltf", 9858, 18082, 1, 1, true },
        { "generated/scatter_spheres.glb", 17934, 35840, 7, 0, true },
        { "generated/paper_lantern.gltf", 5395, 10496, 2, 3, false },
        { "generated/mirrored_tangents.gltf", 8, 4, 1, 1, false },
        { "generated/hierarchy.gltf", 3 * 26, 3 * 48, 3, 0, false },
        { "khronos/GlassHurricaneCandleHolder/GlassHurricaneCandleHolder.gltf", 2386, 4126, 2, 2, false },
        { "khronos/NormalTangentMirrorTest/NormalTangentMirrorTest.glb", 2770, 5240, 1, 3, false },
        { "khronos/Suzanne/Suzanne.gltf", 11808, 3936, 1, 2, false },
        { "khronos/BoxInterleaved/BoxInterleaved.glb", 24, 12, 1, 0, false },
        { "khronos/SimpleSparseAccessor/SimpleSparseAccessor.gltf", 14, 12, 1, 0, false },
        { "khronos/NegativeScaleTest/NegativeScaleTest.glb", 3958, 7724, 11, 2, false },
        { "khronos/TextureTransformTest/TextureTransformTest.gltf", 12 * 4, 12 * 2, 12, 5, false },
        { "khronos/MultiUVTest/MultiUVTest.glb", 24, 12, 1, 2, false },
        { "khronos/BoxVertexColors/BoxVertexColors.glb", 24, 12, 1, 0, false },
        { "khronos/OrientationTest/OrientationTest.glb", 1048, 524, 13, 0, false },
        { "khronos/TriangleWithoutIndices/TriangleWithoutIndices.gltf", 3, 1, 1, 0, false },
        { "khronos/Box With Spaces/Box With Spaces.gltf", 24, 12, 1, 3, false },
        { "khronos/AttenuationTest/AttenuationTest.glb", 584, 292, 23, 2, false },
        { "khronos/TransmissionRoughnessTest/TransmissionRoughnessTest.glb", 47260, 77792, 9, 5, false },
    };
    (void) state;
    for (size_t r = 0; r < PELL_COUNT(rows); r++) {
        int64_t vertices = 0, triangles = 0;
        bool translucent = false;
        struct fixture f;
        char name[256];
        snprintf(name, sizeof(name), "assets/%s", rows[r].name);
        load(&f, name);
        for (size_t i = 0; i < f.scene->num_meshes; i++) {
            const struct pell_mesh *m = &f.scene->meshes[i];
            check_mesh(m);
            vertices += m->num_vertices;
            triangles += m->num_triangles;
            REQUIRE(m->material >= -1 && m->material < (int) f.scene->num_materials);
        }
        for (size_t i = 0; i < f.scene->num_materials; i++)
            translucent |= !f.scene->materials[i].opaque;
        for (size_t i = 0; i < f.scene->num_textures; i++)
            REQUIRE(f.scene->textures[i]->image.pixels);
        if (vertices != rows[r].vertices || triangles != rows[r].triangles || (int) f.scene->num_meshes != rows[r].meshes ||
            (int) f.scene->num_textures != rows[r].textures || translucent != rows[r].translucent)
            fail_msg("%s: %lld vertices, %lld triangles, %zu meshes, %zu textures, translucent %d", rows[r].name, (long long) vertices,
                     (long long) triangles, f.scene->num_meshes, f.scene->num_textures, translucent);
        assert_int_equal(f.kept.errors, 0);
        unload(&f);
    }
}

static bool has_point(const struct pell_mesh *m, float x, float y, float z)
{
    for (uint32_t i = 0; i < m->num_vertices; i++)
        if (vec3_length(vec3_sub(point(m, i), vec3(x, y, z))) < 1e-6f)
            return true;
    return false;
}

static const struct pell_mesh *find_mesh(const struct pell_scene *scene, const char *name)
{
    for (size_t i = 0; i < scene->num_meshes; i++)
        if (strcmp(scene->meshes[i].name, name) == 0)
            return &scene->meshes[i];
    fail_msg("no mesh %s", name);
    return NULL;
}

/* hierarchy.gltf, worked out by hand. The parent turns by 45 degrees about y (+x goes to (c, 0, -c), +z to (c, 0, c), c = sqrt(1/2)) and
 * stretches y by 1.5. The corner (20, 20, 20) mm of the cube:
 *   parent          (2c 20, 30, 0)                                           (28.284, 30, 0) mm
 *   child_negative  (60 - 20, 20, 20) -> (c (40 + 20), 30, c (20 - 40))     (42.426, 30, -14.142) mm
 *   matrix          x' = z, z' = -x: (20, 100, -20) -> (0, 150, -2c 20)     (0, 150, -28.284) mm */
static void nested_transforms_place_the_cubes(void **state)
{
    const float c = 0.02f * 1.41421356f;
    struct fixture f;
    double volume[3];
    (void) state;
    load(&f, "tests/assets/generated/hierarchy.gltf");
    REQUIRE(has_point(find_mesh(f.scene, "parent"), c, 0.03f, 0));
    REQUIRE(has_point(find_mesh(f.scene, "child_negative"), 1.5f * c, 0.03f, -0.5f * c));
    REQUIRE(has_point(find_mesh(f.scene, "matrix"), 0, 0.15f, -c));
    /* each faces outward: positive volume, also the mirrored one */
    for (int k = 0; k < 3; k++) {
        const struct pell_mesh *m = &f.scene->meshes[k];
        volume[k] = 0.0;
        for (uint32_t t = 0; t < m->num_triangles; t++) {
            const uint32_t *i = m->index + 3 * (size_t) t;
            volume[k] += (double) vec3_dot(point(m, i[0]), vec3_cross(point(m, i[1]), point(m, i[2]))) / 6.0;
        }
        REQUIRE_REL(volume[k], 0.04 * 0.04 * 0.06, 1e-4);
    }
    /* three nodes, three objects */
    REQUIRE(f.scene->meshes[0].object != f.scene->meshes[1].object && f.scene->meshes[1].object != f.scene->meshes[2].object);
    unload(&f);
}

static void negative_scales_keep_faces_and_normals_together(void **state)
{
    static const char *const names[] = { "assets/khronos/NegativeScaleTest/NegativeScaleTest.glb",
                                         "assets/khronos/OrientationTest/OrientationTest.glb",
                                         "assets/khronos/TransmissionRoughnessTest/TransmissionRoughnessTest.glb",
                                         "assets/head_lps/head.gltf" };
    struct fixture f;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        load(&f, names[i]);
        if (!(agreement(f.scene, NULL) > 0.9999))
            fail_msg("%s: only %g of the area faces like its normals", names[i], agreement(f.scene, NULL));
        unload(&f);
    }
}

/* On each face of the cube an arrow, rotated by its node, points at a target whose position is in its vertices. */
static void orientation_arrows_point_at_their_targets(void **state)
{
    static const char *const faces[] = { "X1", "X2", "Y1", "Y2", "Z1", "Z2" };
    struct fixture f;
    (void) state;
    load(&f, "assets/khronos/OrientationTest/OrientationTest.glb");
    for (int k = 0; k < 6; k++) {
        const float side = k % 2 ? -5.0f : 5.0f;
        const struct pell_vec3 foot = vec3(k / 2 == 0 ? side : 0, k / 2 == 1 ? side : 0, k / 2 == 2 ? side : 0);
        const struct pell_mesh *arrow, *target;
        struct pell_vec3 tip = foot, sum = vec3(0, 0, 0);
        char name[32];
        snprintf(name, sizeof(name), "Arrow%s", faces[k]);
        arrow = find_mesh(f.scene, name);
        snprintf(name, sizeof(name), "Target%s", faces[k]);
        target = find_mesh(f.scene, name);
        for (uint32_t i = 0; i < arrow->num_vertices; i++)
            if (vec3_length(vec3_sub(point(arrow, i), foot)) > vec3_length(vec3_sub(tip, foot)))
                tip = point(arrow, i);
        for (uint32_t i = 0; i < target->num_vertices; i++)
            sum = vec3_mad(sum, 1.0f / (float) target->num_vertices, point(target, i));
        /* within 8 degrees: the tip is a blunt edge, 0.33 wide at a distance of 3; the turns differ by more */
        REQUIRE(vec3_dot(vec3_normalize(vec3_sub(tip, foot)), vec3_normalize(vec3_sub(sum, foot))) > 0.99f);
    }
    unload(&f);
}

/* The base array is a 7 x 2 grid; three of its upper points are replaced. */
static void sparse_accessor_replaces_three_points(void **state)
{
    static const float want[14][3] = { { 0, 0, 0 }, { 1, 0, 0 }, { 2, 0, 0 }, { 3, 0, 0 }, { 4, 0, 0 }, { 5, 0, 0 }, { 6, 0, 0 },
                                       { 0, 1, 0 }, { 1, 2, 0 }, { 2, 1, 0 }, { 3, 3, 0 }, { 4, 1, 0 }, { 5, 4, 0 }, { 6, 1, 0 } };
    struct fixture f;
    (void) state;
    load(&f, "assets/khronos/SimpleSparseAccessor/SimpleSparseAccessor.gltf");
    for (int i = 0; i < 14; i++)
        for (int c = 0; c < 3; c++)
            REQUIRE_NEAR(f.scene->meshes[0].position[3 * i + c], want[i][c], 0.0);
    unload(&f);
}

/* Each tile of the test shows the part of a texture with an arrow or a check mark. The tile "All" has offset, rotation and scale; its
 * matrix follows the extension: T R S. */
static void texture_transforms_follow_the_extension(void **state)
{
    struct fixture f;
    int seen = 0;
    (void) state;
    load(&f, "assets/khronos/TextureTransformTest/TextureTransformTest.gltf");
    for (size_t i = 0; i < f.scene->num_materials; i++) {
        const struct pell_material *m = &f.scene->materials[i];
        const float *t = m->base_color_map.matrix;
        if (strcmp(m->name, "Offset UV") == 0) {
            const float want[6] = { 1, 0, 0.5f, 0, 1, 0.5f };
            for (int k = 0; k < 6; k++)
                REQUIRE_NEAR(t[k], want[k], 1e-7);
            seen++;
        } else if (strcmp(m->name, "Rotation") == 0) {
            REQUIRE_NEAR(t[0], cos(0.39269908169872414), 1e-7);
            REQUIRE_NEAR(t[1], sin(0.39269908169872414), 1e-7);
            REQUIRE_NEAR(t[3], -sin(0.39269908169872414), 1e-7);
            REQUIRE_NEAR(t[4], cos(0.39269908169872414), 1e-7);
            seen++;
        } else if (strcmp(m->name, "All") == 0) {
            const double c = 1.5 * cos(0.3), s = 1.5 * sin(0.3), want[6] = { c, s, -0.2, -s, c, -0.1 };
            for (int k = 0; k < 6; k++)
                REQUIRE_NEAR(t[k], want[k], 1e-6);
            seen++;
        }
    }
    assert_int_equal(seen, 3);
    unload(&f);
}

/* The file's own check: each of these tiles shows an arrow whose tip, at (0.7778, 0.7778) of the image, lies under a check mark that is
 * a separate mesh. The tile covers uv 0..1 from its upper left. A rotation of the wrong sign puts the tip at the mark "Error". */
static void transformed_arrows_point_at_their_check_marks(void **state)
{
    static const char *const tiles[] = { "Rotation", "Scale", "All" };
    struct fixture f;
    (void) state;
    load(&f, "assets/khronos/TextureTransformTest/TextureTransformTest.gltf");
    for (size_t k = 0; k < PELL_COUNT(tiles); k++) {
        const struct pell_mesh *tile = find_mesh(f.scene, tiles[k]), *mark;
        const float *m = f.scene->materials[tile->material].base_color_map.matrix;
        const double d = (double) m[0] * m[4] - (double) m[1] * m[3], x = 0.7778 - m[2], y = 0.7778 - m[5];
        const double u = (m[4] * x - m[1] * y) / d, v = (m[0] * y - m[3] * x) / d;
        double at[2] = { 0, 0 };
        char name[64];
        snprintf(name, sizeof(name), "%s - Correct", tiles[k]);
        mark = find_mesh(f.scene, name);
        for (int i = 0; i < 4; i++)
            for (int c = 0; c < 2; c++)
                at[c] += 0.25 * mark->position[3 * i + c];
        /* corner 0 is the upper left */
        REQUIRE_NEAR(tile->position[0] + u, at[0], 0.025);
        REQUIRE_NEAR(tile->position[1] - v, at[1], 0.025);
    }
    unload(&f);
}

static void second_uv_set_is_read_and_asked_for(void **state)
{
    struct fixture f;
    const struct pell_material *m;
    (void) state;
    load(&f, "assets/khronos/MultiUVTest/MultiUVTest.glb");
    REQUIRE(f.scene->meshes[0].uv[0] && f.scene->meshes[0].uv[1] && !f.scene->meshes[0].uv[2]);
    REQUIRE(memcmp(f.scene->meshes[0].uv[0], f.scene->meshes[0].uv[1], 24 * 2 * sizeof(float)) != 0);
    m = &f.scene->materials[f.scene->meshes[0].material];
    assert_int_equal(m->base_color_map.uv, 0);
    assert_int_equal(m->emissive_map.uv, 1);
    REQUIRE(m->base_color_map.texture->image.srgb);
    unload(&f);
}

static void box_with_spaces_finds_its_files(void **state)
{
    struct fixture f;
    const struct pell_material *m;
    (void) state;
    load(&f, "assets/khronos/Box With Spaces/Box With Spaces.gltf");
    m = &f.scene->materials[0];
    REQUIRE(m->base_color_map.texture && m->normal_map.texture && m->roughness_map.texture);
    REQUIRE(m->roughness_map.texture == m->metallic_map.texture && m->roughness_map.channel == 1 && m->metallic_map.channel == 2);
    REQUIRE(m->base_color_map.texture->image.srgb && !m->normal_map.texture->image.srgb);
    assert_int_equal(f.kept.warnings, 0);
    unload(&f);
}

/* --- Media ------------------------------------------------------------------------------------------------------------------ */

/* Compares per metre against the built-in material, per mm. The files hold m to 6 digits; for almost white albedos sigma_a is a small
 * difference: its error is d(1 - albedo)/dm 5e-7 sigma_t. */
static void check_measured(const struct pell_medium *medium, const char *name)
{
    const struct pell_material_entry *e = pell_material_find(name);
    assert_non_null(e);
    REQUIRE_NEAR(medium->eta, e->medium.eta, 1e-9);
    for (int c = 0; c < 3; c++) {
        const double s = e->medium.sigma_s_reduced[c], a = e->medium.sigma_a[c];
        REQUIRE_REL(medium->sigma_s_reduced[c] / 1000.0, s, 2e-5);
        REQUIRE_NEAR(medium->sigma_a[c] / 1000.0, a, 1e-6 * (s + a) + 1e-4 * a);
    }
}

static void scatter_spheres_are_the_measured_media(void **state)
{
    struct fixture f;
    (void) state;
    load(&f, "tests/assets/generated/scatter_spheres.glb");
    assert_int_equal(f.scene->num_materials, 7);
    for (size_t i = 0; i < f.scene->num_materials; i++) {
        const struct pell_material *m = &f.scene->materials[i];
        REQUIRE(!m->opaque && m->color_from == PELL_COLOR_FROM_PROFILE && m->gaussians.count == 0);
        check_measured(&m->medium, m->name);
    }
    unload(&f);
}

static void statues_are_marble(void **state)
{
    static const char *const names[] = { "assets/plato/plato.gltf", "assets/marble_player/marble_player.gltf" };
    struct fixture f;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        load(&f, names[i]);
        check_measured(&f.scene->materials[0].medium, "marble");
        REQUIRE(f.scene->materials[0].color_from == PELL_COLOR_FROM_PROFILE);
        REQUIRE(f.scene->materials[0].normal_map.texture);
        unload(&f);
    }
}

/* The head's appearance is painted: light spreads as measured (eta is the file's 1.4, not the table's 1.3), the colour is the
 * photograph's. */
static void head_is_skin_with_its_texture(void **state)
{
    struct pell_medium medium;
    struct fixture f;
    const struct pell_material *m;
    (void) state;
    load(&f, "assets/head_lps/head.gltf");
    m = &f.scene->materials[0];
    REQUIRE_NEAR(m->medium.eta, 1.4, 1e-9);
    medium = m->medium;
    medium.eta = 1.3;
    check_measured(&medium, "skin1");
    REQUIRE(!m->opaque && m->color_from == PELL_COLOR_FROM_TEXTURE && m->mix == 0.5f);
    REQUIRE(m->base_color_map.texture && m->normal_map.texture && m->specular_color_map.texture);
    unload(&f);
}

static void lantern_is_a_sheet_around_a_lamp(void **state)
{
    struct fixture f;
    int papers = 0, bulbs = 0;
    (void) state;
    load(&f, "tests/assets/generated/paper_lantern.gltf");
    for (size_t i = 0; i < f.scene->num_materials; i++) {
        const struct pell_material *m = &f.scene->materials[i];
        if (strcmp(m->name, "paper") == 0) {
            papers++;
            REQUIRE(m->opaque && m->double_sided && m->diffuse_transmission == 0.6f);
            REQUIRE(m->diffuse_transmission_map.texture && m->diffuse_transmission_map.channel == 3);
            REQUIRE(m->diffuse_transmission_color_map.texture && m->diffuse_transmission_color_map.texture->image.srgb);
        } else {
            bulbs++;
            REQUIRE(m->opaque);
            REQUIRE_REL(m->emissive[0], 40.0, 1e-6);
            REQUIRE_REL(m->emissive[2], 24.0, 1e-6);
        }
    }
    assert_int_equal(papers, 1);
    REQUIRE(bulbs > 0);
    assert_int_equal(f.kept.warnings, 0);
    assert_int_equal(f.scene->num_lights, 1);
    unload(&f);
}

static void mirrored_tangents_keep_their_sign(void **state)
{
    struct fixture f;
    int plus = 0, minus = 0;
    (void) state;
    load(&f, "tests/assets/generated/mirrored_tangents.gltf");
    for (size_t i = 0; i < f.scene->meshes[0].num_vertices; i++) {
        plus += f.scene->meshes[0].tangent[4 * i + 3] == 1.0f;
        minus += f.scene->meshes[0].tangent[4 * i + 3] == -1.0f;
    }
    REQUIRE(plus == 4 && minus == 4);
    unload(&f);
}

static void default_scene_is_the_one_named(void **state)
{
    struct fixture f;
    (void) state;
    load(&f, "assets/head_lps/LeePerrySmith.glb");
    assert_int_equal(f.scene->num_meshes, 1);
    unload(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_assets_have_the_counts_of_their_table),
        cmocka_unit_test(nested_transforms_place_the_cubes),
        cmocka_unit_test(negative_scales_keep_faces_and_normals_together),
        cmocka_unit_test(orientation_arrows_point_at_their_targets),
        cmocka_unit_test(sparse_accessor_replaces_three_points),
        cmocka_unit_test(texture_transforms_follow_the_extension),
        cmocka_unit_test(transformed_arrows_point_at_their_check_marks),
        cmocka_unit_test(second_uv_set_is_read_and_asked_for),
        cmocka_unit_test(box_with_spaces_finds_its_files),
        cmocka_unit_test(scatter_spheres_are_the_measured_media),
        cmocka_unit_test(statues_are_marble),
        cmocka_unit_test(head_is_skin_with_its_texture),
        cmocka_unit_test(lantern_is_a_sheet_around_a_lamp),
        cmocka_unit_test(mirrored_tangents_keep_their_sign),
        cmocka_unit_test(default_scene_is_the_one_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
