/* SPDX-License-Identifier: MIT
 * test_medium_layers.c - the media below each point of a surface: layers of scenes, of presets, of homogeneous media; painted depths. */
#include "layers_rig.h"
#include "shapes.h"
#include "transport/equivalent_medium.h"
#include "transport/medium_layers.h"

#define OK(expr) assert_int_equal(expr, PELL_OK)

static const double optics[3][3] = { { 2.0, 2.6, 0.25 }, { 6.0, 6.6, 0.4 }, { 1.0, 1.5, 0.8 } };
static const float depths[3] = { 0.5f, 1.0f, 3.0f };

/* A square of two triangles in x, y from -400 to 400: texture coordinates from 0 to 1. */
static struct pell_scene *square(struct pell_context *ctx)
{
    struct pell_scene *s = shapes_scene(ctx);
    struct pell_mesh *m;

    assert_non_null(s);
    m = shapes_mesh(s, 0, 4, 2);
    for (uint32_t i = 0; i < 4; i++) {
        m->position[3 * i] = i == 1 || i == 2 ? 400.0f : -400.0f;
        m->position[3 * i + 1] = i >= 2 ? 400.0f : -400.0f;
    }
    memcpy(m->index, (const uint32_t[]) { 0, 1, 2, 0, 2, 3 }, 6 * sizeof(uint32_t));
    layers_set(s, 0, 3, optics, depths, PELL_SUBSTRATE_STOP);
    layers_unwrap(s);
    return s;
}

/* At texture coordinates. */
static void depths_at(const struct pell_medium_layers *medium_layers, const struct pell_scene *s, float x, float y, float *depth)
{
    /* p = p0 + u (p1 - p0) + v (p2 - p0): the first triangle is where x >= y. */
    if (x >= y)
        pell_medium_layers_depths(medium_layers, &s->meshes[0], 0, x - y, y, depth);
    else
        pell_medium_layers_depths(medium_layers, &s->meshes[0], 1, x, y - x, depth);
}

static void uniform_layers(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = square(ctx);
    struct pell_medium_layers medium_layers;
    float depth[PELL_LAYERS_MOST];
    (void) state;

    OK(pell_medium_layers_make(ctx, "test", &s->materials[0], &medium_layers));
    assert_int_equal(medium_layers.count, 3);
    REQUIRE(!medium_layers.has_maps && medium_layers.substrate == PELL_SUBSTRATE_STOP && medium_layers.eta == s->materials[0].medium.eta &&
            medium_layers.deepest == 3.0);
    for (int i = 0; i < 3; i++) {
        assert_null(medium_layers.item[i].map);
        assert_string_equal(medium_layers.item[i].name, "");
        REQUIRE_NEAR(medium_layers.item[i].sigma_s[1], optics[i][0], 1e-12);
        REQUIRE_NEAR(medium_layers.item[i].sigma_t[1], optics[i][1], 1e-12);
        REQUIRE_NEAR(medium_layers.item[i].depth, (double) depths[i], 0.0);
    }
    depths_at(&medium_layers, s, 0.3f, 0.8f, depth);
    assert_int_equal(pell_medium_layers_at(&medium_layers, depth, 0.0f), 0);
    assert_int_equal(pell_medium_layers_at(&medium_layers, depth, 0.4999f), 0);
    assert_int_equal(pell_medium_layers_at(&medium_layers, depth, 0.5f), 1);
    assert_int_equal(pell_medium_layers_at(&medium_layers, depth, 2.9f), 2);
    assert_int_equal(pell_medium_layers_at(&medium_layers, depth, 3.0f), -1);
    medium_layers.substrate = PELL_SUBSTRATE_LAST;
    assert_int_equal(pell_medium_layers_at(&medium_layers, depth, 3.0f), 2);
    s->materials[0].layers[2].depth = INFINITY;
    OK(pell_medium_layers_make(ctx, "test", &s->materials[0], &medium_layers));
    REQUIRE(medium_layers.item[2].depth == (double) INFINITY && medium_layers.deepest == 1.0);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

/* Linear between texel centres and across the border, or the nearest texel. */
static void maps_are_filtered_as_textures_are(void **state)
{
    static const float depth_fraction[4] = { 0.1f, 0.3f, 0.5f, 0.9f }; /* rows of two */
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = square(ctx);
    struct pell_texture *t = layers_paint(s, 0, 0, 2, 2, 1, depth_fraction);
    struct pell_medium_layers medium_layers;
    float depth[PELL_LAYERS_MOST];
    (void) state;

    OK(pell_medium_layers_make(ctx, "test", &s->materials[0], &medium_layers));
    REQUIRE(medium_layers.has_maps && medium_layers.item[0].map && !medium_layers.item[1].map);
    REQUIRE_NEAR(medium_layers.deepest, 3.0, 0.0);
    depths_at(&medium_layers, s, 0.25f, 0.25f, depth);
    REQUIRE_NEAR((double) depth[0], 0.5 * 0.1, 1e-6);
    REQUIRE_NEAR((double) depth[1], 1.0, 0.0);
    depths_at(&medium_layers, s, 0.75f, 0.25f, depth);
    REQUIRE_NEAR((double) depth[0], 0.5 * 0.3, 1e-6);
    depths_at(&medium_layers, s, 0.5f, 0.25f, depth);
    REQUIRE_NEAR((double) depth[0], 0.5 * 0.2, 1e-6);
    depths_at(&medium_layers, s, 0.5f, 0.5f, depth);
    REQUIRE_NEAR((double) depth[0], 0.5 * 0.45, 1e-6);
    depths_at(&medium_layers, s, 0.0f, 0.75f, depth); /* half from the opposite side */
    REQUIRE_NEAR((double) depth[0], 0.5 * 0.7, 1e-6);
    t->wrap_u = t->wrap_v = PELL_WRAP_CLAMP;
    depths_at(&medium_layers, s, 0.0f, 0.75f, depth);
    REQUIRE_NEAR((double) depth[0], 0.5 * 0.5, 1e-6);
    t->nearest = true;
    depths_at(&medium_layers, s, 0.49f, 0.25f, depth);
    REQUIRE_NEAR((double) depth[0], 0.5 * 0.1, 1e-6);
    /* A quarter turn: u' = v, v' = 1 - u. */
    memcpy(s->materials[0].layers[0].depth_map.matrix, (const float[6]) { 0, 1, 0, -1, 0, 1 }, 6 * sizeof(float));
    depths_at(&medium_layers, s, 0.25f, 0.75f, depth); /* u' = 0.75, v' = 0.75 */
    REQUIRE_NEAR((double) depth[0], 0.5 * 0.9, 1e-6);
    s->materials[0].layers[0].depth_inverse = true;
    OK(pell_medium_layers_make(ctx, "test", &s->materials[0], &medium_layers));
    depths_at(&medium_layers, s, 0.25f, 0.75f, depth);
    REQUIRE_NEAR((double) depth[0], 0.5 * (1.0 - 0.9), 1e-6);
    /* Without texture coordinates a map is white. */
    pell_free(ctx, s->meshes[0].uv[0]);
    s->meshes[0].uv[0] = NULL;
    depths_at(&medium_layers, s, 0.25f, 0.75f, depth);
    REQUIRE_NEAR((double) depth[0], 0.0, 0.0);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void the_upper_layer_wins(void **state)
{
    static const float depth_fraction[2 * 4] = { 0.2f, 0.8f, 0.5f, 1.0f, 1.0f, 0.4f, 0.75f, 1.0f }; /* two texels of four channels */
    static const float all[3] = { 2.0f, 2.0f, 2.0f };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = square(ctx);
    struct pell_material *m = &s->materials[0];
    struct pell_medium_layers medium_layers;
    float depth[PELL_LAYERS_MOST];
    (void) state;

    layers_set(s, 0, 3, optics, all, PELL_SUBSTRATE_STOP);
    layers_paint(s, 0, 0, 2, 1, 4, depth_fraction)->nearest = true;
    for (int i = 1; i < 3; i++) {
        m->layers[i].depth_map = m->layers[0].depth_map;
        m->layers[i].depth_map.channel = i;
    }
    OK(pell_medium_layers_make(ctx, "test", m, &medium_layers));
    depths_at(&medium_layers, s, 0.25f, 0.5f, depth);
    REQUIRE(depth[0] == 0.4f && depth[1] == 1.6f && depth[2] == 1.6f); /* 0.4, 1.6, 1.0: the third is empty */
    assert_int_equal(pell_medium_layers_at(&medium_layers, depth, 0.5f), 1);
    assert_int_equal(pell_medium_layers_at(&medium_layers, depth, 1.6f), -1);
    depths_at(&medium_layers, s, 0.75f, 0.5f, depth);
    REQUIRE(depth[0] == 2.0f && depth[1] == 2.0f && depth[2] == 2.0f);
    assert_int_equal(pell_medium_layers_at(&medium_layers, depth, 1.9f), 0);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

/* A map of one value equals that value. */
static void maps_of_one_value_are_uniform(void **state)
{
    static const float same[4] = { 0.75f, 0.75f, 0.75f, 0.75f }, deep[4] = { 0.75f, 0.75f, 6.0f, 0.75f };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = square(ctx);
    struct pell_medium_layers medium_layers;
    (void) state;

    layers_paint(s, 0, 2, 2, 2, 1, same);
    OK(pell_medium_layers_make(ctx, "test", &s->materials[0], &medium_layers));
    REQUIRE(!medium_layers.has_maps && !medium_layers.item[2].map && medium_layers.item[2].depth == 2.25 && medium_layers.deepest == 2.25);
    layers_paint(s, 0, 2, 2, 2, 1, deep);
    OK(pell_medium_layers_make(ctx, "test", &s->materials[0], &medium_layers));
    REQUIRE(medium_layers.has_maps && medium_layers.item[2].map && medium_layers.item[2].depth == 3.0 && medium_layers.deepest == 18.0);
    /* A layer boundary that crosses another everywhere is pushed down at each point. */
    s->materials[0].layers[2].depth_map.texture = NULL;
    s->materials[0].layers[2].depth = 0.25f;
    OK(pell_medium_layers_make(ctx, "test", &s->materials[0], &medium_layers));
    REQUIRE(medium_layers.item[2].depth == 1.0);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void presets_and_media(void **state)
{
    const struct pell_material_entry *fish = pell_material_find("fish"), *milk = pell_material_find("wholemilk");
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_scene *s = shapes_scene(ctx);
    struct pell_material *m = &s->materials[0];
    struct pell_medium_layers medium_layers;
    double depth = 0.0;
    (void) state;

    OK(pell_material_apply(s, 0, "test", "fish"));
    OK(pell_medium_layers_make(ctx, "test", m, &medium_layers));
    assert_int_equal(medium_layers.count, fish->layers.count);
    REQUIRE(medium_layers.substrate == PELL_SUBSTRATE_LAST && medium_layers.item[medium_layers.count - 1].depth == (double) INFINITY &&
            medium_layers.eta == fish->medium.eta);
    for (int i = 0; i < medium_layers.count; i++) {
        const struct pell_material_layer *l = &fish->layers.item[i];
        assert_string_equal(medium_layers.item[i].name, l->name);
        REQUIRE(medium_layers.item[i].sigma_s[2] == l->medium.sigma_s_reduced[2] / (1.0 - l->medium.g[2]));
        REQUIRE(i + 1 == medium_layers.count || medium_layers.item[i].depth == (depth += l->thickness_mm));
    }
    OK(pell_material_apply(s, 0, "test", "wholemilk"));
    OK(pell_medium_layers_make(ctx, "test", m, &medium_layers));
    REQUIRE(medium_layers.count == 1 && medium_layers.item[0].depth == (double) INFINITY && medium_layers.eta == milk->medium.eta);
    REQUIRE_NEAR(medium_layers.item[0].sigma_t[0], milk->medium.sigma_a[0] + milk->medium.sigma_s_reduced[0] / (1.0 - milk->medium.g[0]),
                 1e-12);
    /* A material's own layers override a preset's. */
    OK(pell_material_apply(s, 0, "test", "fish"));
    layers_set(s, 0, 2, optics, depths, PELL_SUBSTRATE_LAST);
    OK(pell_medium_layers_make(ctx, "test", m, &medium_layers));
    assert_int_equal(medium_layers.count, 2);
    OK(pell_material_allocate_layers(s, 0, 0));
    m->gaussians.weight[0][0] *= 1.5;
    assert_int_equal(pell_medium_layers_make(ctx, "a-method", m, &medium_layers), PELL_ERR_UNSUPPORTED);
    REQUIRE(strstr(kept.what, "a-method") && strstr(kept.what, "no medium"));
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

/* Whatever model the profile comes from: the medium has the same reflectance and mean distance. */
static void a_profile_has_an_equivalent_medium(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = square(ctx);
    struct pell_material *m = &s->materials[0];
    struct pell_medium medium;
    struct pell_medium_fault fault;
    struct pell_profile own, same;

    (void) state;
    OK(pell_material_allocate_layers(s, 0, 0));
    for (size_t i = 0; i < pell_material_count(); i++) {
        const struct pell_material_entry *e = pell_material_at(i);
        OK(pell_material_apply(s, 0, "test", e->name));
        assert_int_equal(pell_has_profile_only(m), e->kind == PELL_MATERIAL_GAUSSIANS);
        if (!pell_has_profile_only(m))
            continue;
        assert_int_equal(pell_equivalent_medium(m, &medium, &fault), PELL_OK);
        for (int c = 0; c < 3; c++) {
            const double color = m->color_from == PELL_COLOR_FROM_TEXTURE ? fmin((double) m->base_color[c], 0.999) : -1.0;
            OK(pell_profile_from_gaussians(&m->gaussians, c, &own));
            OK(pell_profile_make(PELL_PROFILE_MONTE_CARLO, &medium, c, NULL, &same));
            REQUIRE_NEAR(pell_profile_total(&same), color >= 0.0 ? color : fmin(pell_profile_total(&own), 0.999), 1e-6);
            REQUIRE_REL(pell_profile_mean_radius(&same), pell_profile_mean_radius(&own), 1e-6);
        }
    }
    /* A channel without scattered light absorbs all. */
    OK(pell_material_apply(s, 0, "test", "marble-4gaussian"));
    memset(m->gaussians.weight, 0, sizeof(m->gaussians.weight));
    m->color_from = PELL_COLOR_FROM_PROFILE;
    assert_int_equal(pell_equivalent_medium(m, &medium, &fault), PELL_OK);
    REQUIRE(medium.sigma_s_reduced[0] == 0.0 && medium.sigma_a[0] > 0.0);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(uniform_layers),       cmocka_unit_test(maps_are_filtered_as_textures_are),
        cmocka_unit_test(the_upper_layer_wins), cmocka_unit_test(maps_of_one_value_are_uniform),
        cmocka_unit_test(presets_and_media),    cmocka_unit_test(a_profile_has_an_equivalent_medium),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
