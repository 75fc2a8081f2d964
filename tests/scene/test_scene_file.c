/* SPDX-License-Identifier: MIT
 * test_scene_file.c - the scene file: effect of each key, refusal of wrong values, and agreement of the published schema with the
 * reader. */
#include "scene_test.h"

#include "base/file.h"
#include "scene/file/scene_file.h"

#include <pellucid/inversion.h>
#include <pellucid/skin.h>

#include <regex.h>

/* A triangle of 1 m whose node moves 4 m along x in two seconds ("walk"), or stays at 4 m ("stand"). */
#define WALK                                                                                                                               \
    "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":68,\"uri\":\"data:;base64,"                                             \
    "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAEAAAAAAAAAAAAAAAAAAAIBAAAAAAAAAAAA=\"}],"                                    \
    "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},{\"buffer\":0,\"byteOffset\":36,\"byteLength\":8},{\"buffer\":0,"                   \
    "\"byteOffset\":44,\"byteLength\":24}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},"        \
    "{\"bufferView\":1,\"componentType\":5126,\"count\":2,\"type\":\"SCALAR\"},{\"bufferView\":2,\"componentType\":5126,\"count\":2,"      \
    "\"type\":\"VEC3\"}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],\"nodes\":[{\"mesh\":0}],\"animations\":["      \
    "{\"name\":\"walk\",\"samplers\":[{\"input\":1,\"output\":2}],\"channels\":[{\"sampler\":0,\"target\":{\"node\":0,\"path\":"           \
    "\"translation\"}}]},{\"name\":\"stand\",\"samplers\":[{\"input\":1,\"output\":2,\"interpolation\":\"STEP\"}],\"channels\":["          \
    "{\"sampler\":0,\"target\":{\"node\":0,\"path\":\"translation\"}}]}]}"

static const struct memory_file files[] = {
    { "cube.obj", CUBE },
    { "two.obj", CUBE_VERTICES "usemtl Skin\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nusemtl Cloth\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n" },
    { "soap.json", "{\"sigma_a\":[0.01,0.02,0.03],\"sigma_s_reduced\":[1,2,3],\"eta\":1.45}" },
    { "wax.csv", "r_mm,R,G,B\n0,0.1,0.05,0.02\n1,0.05,0.02,0.01\n2,0,0,0\n" },
    { "bright.csv", "0,10,10,10\n1,10,10,10\n" },
    { "walk.gltf", WALK },
    { NULL, NULL },
};

static struct pell_scene *load_with(const char *text, const struct pell_load_params *params, struct kept_messages *kept)
{
    struct pell_context *ctx = test_context(NULL, kept);
    struct pell_scene *s;

    if (load_bytes(ctx, "s.json", text, strlen(text), params, files, &s) != PELL_OK)
        fail_msg("%s: refused: %s: %s", text, kept ? kept->where : "", kept ? kept->what : "");
    return s;
}

static struct pell_scene *load(const char *text, struct kept_messages *kept)
{
    return load_with(text, NULL, kept);
}

static void finish(struct pell_scene *s)
{
    struct pell_context *ctx = s->ctx;

    pell_scene_destroy(&s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

#define SCENE(rest) "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"10mm\"" rest "}"

/* --- Meshes, camera ----------------------------------------------------------------------------------------------------------- */

static void meshes_are_placed_in_their_own_units(void **state)
{
    struct pell_scene *s =
        load("{\"pellucid\":1,\"meshes\":[\"cube.obj\",{\"path\":\"cube.obj\",\"size\":\"30mm\",\"translate\":[1,\"-2cm\",\"0mm\"],"
             "\"rotate_deg\":[0,0,90],\"scale\":[2,1,1],\"material\":\"ketchup\"}],\"unit\":\"1cm\"}",
             NULL);
    float min[3] = { INFINITY, INFINITY, INFINITY }, max[3] = { -INFINITY, -INFINITY, -INFINITY };
    (void) state;

    assert_int_equal(s->num_meshes, 2);
    REQUIRE(s->meshes[0].object != s->meshes[1].object);
    REQUIRE_NEAR(s->mm_per_unit, 10.0, 1e-12);
    for (uint32_t i = 0; i < 3 * s->meshes[1].num_vertices; i++) {
        min[i % 3] = fminf(min[i % 3], s->meshes[1].position[i]);
        max[i % 3] = fmaxf(max[i % 3], s->meshes[1].position[i]);
    }
    /* 60 x 30 x 30 turned about z by a quarter: x runs to -30, y to 60; then moved by one unit of 30 mm and by -20 mm. */
    REQUIRE_NEAR(min[0], 0.0, 1e-4);
    REQUIRE_NEAR(max[0], 30.0, 1e-4);
    REQUIRE_NEAR(min[1], -20.0, 1e-4);
    REQUIRE_NEAR(max[1], 40.0, 1e-4);
    REQUIRE_NEAR(max[2], 30.0, 1e-4);
    assert_string_equal(s->materials[s->meshes[1].material].preset, "ketchup");
    assert_string_equal(s->materials[s->meshes[0].material].preset, "marble");
    finish(s);
}

static void entries_of_one_object_share_it_and_their_materials(void **state)
{
#define ENTRY(rest) "{\"path\":\"cube.obj\",\"unit\":\"1mm\"" rest "}"
    struct pell_scene *s =
        load("{\"pellucid\":1,\"meshes\":[" ENTRY(",\"object\":\"a\"") "," ENTRY(
                 ",\"object\":\"b\"") ","
                                      "{\"path\":\"two.obj\",\"unit\":\"1mm\",\"translate\":[1,0,0],\"object\":\"a\",\"material\":"
                                      "\"ketchup\"}," ENTRY(",\"translate\":[0,1,0],\"object\":\"a\"") "," ENTRY(
                                          ",\"object\":\"a\",\"material\":\"ketchup\"") "," ENTRY("") "]}",
             NULL);
    const struct pell_mesh *m = s->meshes;
    (void) state;

    assert_int_equal(s->num_meshes, 7); /* two.obj has two materials, with names of their own that one entry replaces */
    for (size_t i = 2; i < 6; i++)
        assert_int_equal(m[i].object, m[0].object);
    REQUIRE(m[1].object != m[0].object && m[6].object != m[0].object && m[6].object != m[1].object);
    assert_int_equal(m[4].material, m[0].material);
    assert_int_equal(m[5].material, m[2].material);
    REQUIRE(m[2].material != m[0].material);
    finish(s);
#undef ENTRY
}

static void positions_are_in_mesh_units_or_say_their_own(void **state)
{
    struct pell_scene *s = load(SCENE(",\"camera\":{\"from\":[0,\"5cm\",8],\"to\":[0,5,0],\"up\":[0,1,1],\"fov_deg\":30},"
                                      "\"lights\":[{\"type\":\"point\",\"at\":[1,2,\"-3mm\"],\"intensity\":5}]"),
                                NULL);
    (void) state;

    REQUIRE_NEAR(s->cameras[0].position[1], 50.0, 1e-4);
    REQUIRE_NEAR(s->cameras[0].position[2], 80.0, 1e-4);
    REQUIRE_NEAR(s->cameras[0].forward[2], -1.0, 1e-6);
    REQUIRE_NEAR(s->cameras[0].up[1], 1.0, 1e-6); /* made perpendicular to the view direction */
    REQUIRE_NEAR(s->cameras[0].fov, 30 * PELL_PI / 180, 1e-6);
    REQUIRE_NEAR(s->lights[0].position[0], 10.0, 1e-5);
    REQUIRE_NEAR(s->lights[0].position[2], -3.0, 1e-5);
    REQUIRE_NEAR(s->lights[0].power[1], 5.0, 0);
    finish(s);
    s = load(SCENE(",\"camera\":{\"from\":[0,0,10],\"ortho_height\":\"3cm\"}"), NULL);
    REQUIRE_NEAR(s->cameras[0].ortho_height, 30.0, 1e-5);
    finish(s);
}

static void the_command_line_stands_above_the_file(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_load_params params = { .size_mm = 50.0, .material = "ketchup" };
    static const char text[] = SCENE(",\"materials\":{\"*\":{\"preset\":\"wholemilk\"}}");
    struct pell_scene *s;
    (void) state;

    assert_int_equal(load_bytes(ctx, "s.json", text, strlen(text), &params, files, &s), PELL_OK);
    REQUIRE_NEAR(s->bounds_max[0], 50.0, 1e-4);
    assert_string_equal(s->materials[0].preset, "ketchup");
    finish(s);
}

/* --- Time ------------------------------------------------------------------------------------------------------------------- */

static void time_is_the_command_lines_then_the_files(void **state)
{
#define MOVING(rest) "{\"pellucid\":1,\"meshes\":[\"walk.gltf\",{\"path\":\"cube.obj\",\"unit\":\"1m\"}]" rest "}"
    static const struct {
        const char *text;
        struct pell_load_params params;
        double x; /* m */
    } cases[] = {
        { MOVING(""), { .bare = true }, 0 },
        { MOVING(""), { .bare = true, .time = 1.0 }, 2 },
        { MOVING(""), { .bare = true, .animation = "1", .time = 1.5 }, 0 }, /* "stand" steps at 2 s only */
        { MOVING(",\"time\":0.5"), { .bare = true }, 1 },
        { MOVING(",\"time\":0.5"), { .bare = true, .time = 1.5 }, 3 },
        { MOVING(",\"time\":0.5"), { .bare = true, .timed = true }, 0 },
        { MOVING(",\"time\":2,\"animation\":\"stand\""), { .bare = true }, 4 },
        { MOVING(",\"time\":1,\"animation\":1"), { .bare = true }, 0 },
        { MOVING(",\"time\":1,\"animation\":1"), { .bare = true, .animation = "walk" }, 2 },
        { WALK, { .bare = true, .time = 1.0 }, 2 },
        { WALK, { .bare = true, .time = -3.0 }, 0 },
        { WALK, { .bare = true }, 0 },
    };
    const struct pell_load_params unknown = { .bare = true, .animation = "wakl" };
    const struct pell_load_params still = { .bare = true, .mm_per_unit = 1.0, .time = 1.0 };
    const struct pell_load_params none = { .bare = true, .mm_per_unit = 1.0, .animation = "walk" };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx;
    struct pell_scene *s;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        ctx = test_context(NULL, NULL);
        assert_int_equal(load_bytes(ctx, "s.json", cases[i].text, strlen(cases[i].text), &cases[i].params, files, &s), PELL_OK);
        REQUIRE_NEAR(s->meshes[0].position[0], 1000.0 * cases[i].x, 1e-3);
        finish(s);
    }
    ctx = test_context(NULL, &kept);
    assert_int_equal(load_bytes(ctx, "walk.gltf", WALK, strlen(WALK), &unknown, files, &s), PELL_ERR_INVALID);
    assert_string_equal(kept.where, "--animation");
    REQUIRE(strstr(kept.hint, "\"walk\""));
    assert_int_equal(load_bytes(ctx, "cube.obj", CUBE, strlen(CUBE), &none, files, &s), PELL_ERR_INVALID);
    assert_int_equal(kept.warnings, 0);
    assert_int_equal(load_bytes(ctx, "cube.obj", CUBE, strlen(CUBE), &still, files, &s), PELL_OK);
    assert_int_equal(kept.warnings, 1); /* a time that has no effect */
    finish(s);
}

/* --- Lights ------------------------------------------------------------------------------------------------------------------- */

static void lights_are_read(void **state)
{
    struct pell_scene *s = load(SCENE(",\"lights\":[{\"type\":\"spot\",\"name\":\"lamp\",\"at\":[0,0,10],\"to\":[0,0,0],\"intensity\":[1,2,"
                                      "3],\"cone_deg\":60,\"inner_deg\":20},"
                                      "{\"type\":\"directional\",\"direction\":[0,-2,0],\"irradiance\":3.5},"
                                      "{\"type\":\"rect\",\"at\":[0,10,0],\"width\":2,\"height\":\"1cm\",\"radiance\":7},"
                                      "{\"type\":\"disc\",\"at\":[0,10,0],\"to\":[0,20,0],\"radius\":\"5mm\",\"radiance\":[1,1,0]},"
                                      "{\"type\":\"environment\",\"color\":[0.5,1,2],\"scale\":2,\"rotate_deg\":90}]"),
                                NULL);
    (void) state;

    assert_int_equal(s->num_lights, 5);
    assert_string_equal(s->lights[0].name, "lamp");
    REQUIRE_NEAR(s->lights[0].cos_outer, cos(30 * PELL_PI / 180), 1e-6);
    REQUIRE_NEAR(s->lights[0].cos_inner, cos(10 * PELL_PI / 180), 1e-6);
    REQUIRE_NEAR(s->lights[0].direction[2], -1.0, 1e-6);
    REQUIRE_NEAR(s->lights[0].power[2], 3.0, 0);
    assert_int_equal(s->lights[1].type, PELL_LIGHT_DIRECTIONAL);
    REQUIRE_NEAR(s->lights[1].direction[1], -1.0, 1e-6);
    REQUIRE_NEAR(s->lights[2].width, 20.0, 1e-5);
    REQUIRE_NEAR(s->lights[2].height, 10.0, 1e-5);
    REQUIRE_NEAR(s->lights[2].direction[1], -1.0, 1e-6);
    REQUIRE_NEAR(vec3_dot(vec3_load(s->lights[2].up), vec3_load(s->lights[2].direction)), 0.0, 1e-6);
    REQUIRE_NEAR(s->lights[3].radius, 5.0, 1e-5);
    REQUIRE_NEAR(s->lights[3].direction[1], 1.0, 1e-6);
    REQUIRE_NEAR(s->lights[4].power[2], 4.0, 1e-6);
    REQUIRE_NEAR(s->lights[4].rotate, PELL_PI / 2, 1e-6);
    assert_int_equal(s->background, PELL_BACKGROUND_ENVIRONMENT);
    finish(s);
    s = load(SCENE(",\"lights\":[]"), NULL);
    assert_int_equal(s->num_lights, 0);
    finish(s);
    s = load(SCENE(",\"lights\":[{\"studio\":true},{\"type\":\"point\",\"at\":[1,1,9],\"intensity\":1}]"), NULL);
    assert_int_equal(s->num_lights, 4);
    finish(s);
    s = load(SCENE(""), NULL);
    assert_int_equal(s->num_lights, 3);
    finish(s);
}

/* The same scenes by the options of the same names; options override the file. */
static void sides_studios_and_backgrounds_are_those_of_the_options(void **state)
{
    static const struct {
        const char *file;
        struct pell_load_params above, alone;
    } cases[] = {
        { ",\"camera\":{\"side\":\"34\"}", { 0 }, { .from = "34" } },
        { ",\"camera\":{\"side\":\"-20.5,75\"}", { 0 }, { .from = "-20.5,75" } },
        { ",\"camera\":{\"side\":\"top\"}", { .from = "left" }, { .from = "left" } },
        { ",\"lights\":[{\"studio\":\"rim\"}]", { 0 }, { .studio = "rim" } },
        { ",\"lights\":[{\"studio\":\"window\"}]", { 0 }, { .studio = "window" } },
        { ",\"lights\":[{\"studio\":\"window\"}]", { .studio = "back" }, { .studio = "back" } },
        { ",\"lights\":[{\"studio\":\"window\"}]", { .background = "black" }, { .studio = "window", .background = "black" } },
        { ",\"lights\":[{\"studio\":\"window\"}],\"background\":\"#10aaFF\"", { 0 }, { .studio = "window", .background = "#10AAff" } },
        { ",\"background\":\"transparent\"", { 0 }, { .background = "transparent" } },
        { ",\"background\":\"grey\"", { .background = "white" }, { .background = "white" } },
    };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct pell_text text = { 0 };
        struct pell_scene *a, *b;
        pell_text_add(&text, "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"1mm\"%s}", cases[i].file);
        a = load_with(text.str, &cases[i].above, NULL);
        b = load_with("{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"1mm\"}", &cases[i].alone, NULL);
        assert_int_equal(a->num_meshes, b->num_meshes);
        assert_int_equal(a->background, b->background);
        REQUIRE(memcmp(a->background_color, b->background_color, sizeof(a->background_color)) == 0);
        if (pell_scene_hash(a) != pell_scene_hash(b))
            fail_msg("%s", cases[i].file);
        finish(a);
        finish(b);
    }
}

/* --- Materials ---------------------------------------------------------------------------------------------------------------- */

static const struct pell_material *called(const struct pell_scene *s, const char *name)
{
    for (size_t i = 0; i < s->num_materials; i++)
        if (strcmp(s->materials[i].name, name) == 0)
            return &s->materials[i];
    fail_msg("there is no material %s", name);
    return NULL;
}

static void materials_are_overlaid_by_name(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_scene *s =
        load("{\"pellucid\":1,\"mesh\":\"two.obj\",\"unit\":\"10mm\",\"materials\":{"
             "\"Skin\":{\"sigma_a\":[0.1,0.2,0.3],\"sigma_s\":[4,8,12],\"g\":[0.5,0.75,0.9],\"eta\":1.4,\"mix\":0.25,\"strength\":0.5,"
             "\"specular\":{\"model\":\"kelemen\",\"roughness\":0.35,\"rho_s\":0.18},\"profile\":\"dipole\"},"
             "\"*\":{\"preset\":\"wholemilk\",\"roughness\":0.7},\"Skim\":{\"opaque\":true}}}",
             &kept);
    const struct pell_material *m = called(s, "Skin");
    (void) state;

    assert_null(m->preset);
    REQUIRE_NEAR(m->medium.sigma_a[1], 0.2, 1e-15);
    REQUIRE_NEAR(m->medium.sigma_s_reduced[0], 2.0, 1e-12); /* 1/mm, whatever the mesh's unit */
    REQUIRE_NEAR(m->medium.sigma_s_reduced[2], 1.2, 1e-12);
    REQUIRE_NEAR(m->medium.g[2], 0.9, 0);
    REQUIRE_NEAR(m->medium.eta, 1.4, 0);
    REQUIRE_NEAR(m->mix, 0.25, 0);
    REQUIRE_NEAR(m->strength, 0.5, 0);
    assert_int_equal(m->specular, PELL_SPECULAR_KELEMEN);
    REQUIRE_NEAR(m->roughness, 0.35, 1e-6);
    REQUIRE_NEAR(m->rho_s, 0.18, 1e-6);
    m = called(s, "Cloth");
    assert_string_equal(m->preset, "wholemilk");
    REQUIRE_NEAR(m->roughness, 0.7, 1e-6);
    assert_int_equal(kept.warnings, 1); /* no library defines the mesh's materials, but this file does */
    assert_non_null(strstr(kept.last_warning, "no material is called \"Skim\""));
    finish(s);
}

/* Materials of a mesh file that are undefined are reported, except those that the scene file or the mesh's own "material" defines. */
static void materials_that_nothing_defines_are_reported(void **state)
{
    static const struct {
        const char *rest;
        int warnings;
    } cases[] = { { "", 1 },
                  { ",\"materials\":{\"Skin\":{\"preset\":\"marble\"}}", 1 },
                  { ",\"materials\":{\"Skin\":{\"preset\":\"marble\"},\"Cloth\":{\"opaque\":true}}", 0 },
                  { ",\"materials\":{\"*\":{\"preset\":\"marble\"}}", 0 } };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct kept_messages kept = { 0 };
        char text[256];
        snprintf(text, sizeof(text), "{\"pellucid\":1,\"mesh\":\"two.obj\",\"unit\":\"10mm\"%s}", cases[i].rest);
        finish(load(text, &kept));
        assert_int_equal(kept.warnings, cases[i].warnings);
        if (i == 1)
            assert_non_null(strstr(kept.last_warning, "1 material which no library defines (\"Cloth\")"));
    }
}

/* Under the model that the material selects, the medium has the colour; the radius of other programs is a length. */
static void a_radius_means_what_its_kind_says(void **state)
{
    static const double color[] = { 0.3, 0.5, 0.7 };
    (void) state;

    for (int kind = 0; kind < PELL_SCATTER_RADII; kind++) {
        char text[512];
        struct pell_scene *s;
        snprintf(text, sizeof(text),
                 SCENE(",\"materials\":{\"*\":{\"color\":[0.3,0.5,0.7],\"radius\":\"2mm\",\"radius_kind\":\"%s\",\"eta\":1.4,"
                       "\"profile\":\"normalized-diffusion\",\"color_from\":\"texture\"}}"),
                 pell_scatter_radius_at((size_t) kind)->name);
        s = load(text, NULL);
        const struct pell_material *m = &s->materials[0];
        assert_int_equal(m->color_from, PELL_COLOR_FROM_TEXTURE);
        for (int c = 0; c < 3; c++) {
            struct pell_profile p;
            assert_int_equal(pell_profile_make(m->model, &m->medium, c, NULL, &p), PELL_OK);
            REQUIRE_NEAR(pell_profile_total(&p), color[c], 1e-8);
            if (kind == PELL_SCATTER_RADIUS_MEAN_FREE_PATH)
                REQUIRE_REL(pell_mean_free_path(&m->medium, c), 2.0, 1e-9);
            if (kind == PELL_SCATTER_RADIUS_DIFFUSE)
                REQUIRE_REL(pell_diffuse_mean_free_path(&m->medium, c), 2.0, 1e-9);
        }
        finish(s);
    }
}

static void a_profile_is_a_model_or_a_table(void **state)
{
    struct pell_scene *s = load("{\"pellucid\":1,\"mesh\":\"two.obj\",\"unit\":\"10mm\",\"materials\":{"
                                "\"Skin\":{\"preset\":\"skin1\",\"profile\":\"photon-beam\"},"
                                "\"*\":{\"preset\":\"wholemilk\",\"profile\":{\"table\":\"wax.csv\"}}}}",
                                NULL);
    const struct pell_material *m = called(s, "Skin");
    (void) state;

    assert_int_equal(m->model, PELL_PROFILE_PHOTON_BEAM);
    assert_null(m->profile);
    m = called(s, "Cloth");
    assert_int_equal(m->model, PELL_PROFILE_MONTE_CARLO);
    assert_non_null(m->profile);
    REQUIRE_NEAR(pell_profile_eval(&m->profile[1], 1.0), 0.02, 1e-15); /* mm, whatever the mesh's unit */
    REQUIRE_NEAR(pell_profile_eval(&m->profile[2], 2.5), 0.0, 0);
    finish(s);
}

static void a_colour_and_a_mean_free_path_make_a_medium(void **state)
{
    struct pell_scene *s =
        load(SCENE(",\"materials\":{\"*\":{\"color\":[0.2,0.5,0.9],\"mean_free_path\":[\"1mm\",\"0.05cm\",\"100um\"],\"eta\":1.5}}"), NULL);
    static const double color[] = { 0.2, 0.5, 0.9 }, mm[] = { 1.0, 0.5, 0.1 };
    (void) state;

    for (int c = 0; c < 3; c++) {
        const struct pell_medium *d = &s->materials[0].medium;
        struct pell_profile p;
        assert_int_equal(pell_profile_make(PELL_PROFILE_MONTE_CARLO, d, c, NULL, &p), PELL_OK);
        REQUIRE_NEAR(pell_profile_total(&p), color[c], 1e-9);
        REQUIRE_REL(pell_mean_free_path(d, c), mm[c], 1e-12);
    }
    finish(s);
}

/* Skin by its composition is the stack of pell_skin_layers, and has no name of a built-in material. */
static void skin_is_made_of_its_composition(void **state)
{
    struct pell_scene *s =
        load(SCENE(",\"materials\":{\"*\":{\"skin\":{\"melanin\":0.3,\"epidermis_mm\":0.15,\"eta\":1.35},\"roughness\":0.5}}"), NULL);
    const struct pell_material *m = &s->materials[0];
    struct pell_skin skin = pell_skin_default();
    struct pell_material_layers layers;
    struct pell_gaussians sum;
    (void) state;

    skin.melanin = 0.3;
    skin.epidermis_mm = 0.15;
    skin.eta = 1.35;
    assert_int_equal(pell_skin_layers(&skin, &layers), PELL_OK);
    assert_int_equal(pell_material_solve(&layers, &sum, NULL), PELL_OK);
    assert_memory_equal(&m->gaussians, &sum, sizeof(sum));
    assert_null(m->preset);
    assert_false(m->opaque);
    REQUIRE(m->medium.eta == 1.35 && m->roughness == 0.5f);
    finish(s);
}

static void other_ways_to_name_a_material_work(void **state)
{
    struct pell_scene *s =
        load(SCENE(",\"materials\":{\"*\":{\"preset\":\"soap.json\",\"color_from\":\"texture\",\"color\":[0.5,0.25,1]}}"), NULL);
    (void) state;

    REQUIRE_NEAR(s->materials[0].medium.eta, 1.45, 0);
    assert_string_equal(s->materials[0].preset, "soap.json");
    REQUIRE_NEAR(s->materials[0].base_color[1], 0.25, 0);
    finish(s);
    s = load(SCENE(",\"materials\":{\"default\":{\"opaque\":true,\"color\":[0.1,0.1,0.1]}}"), NULL);
    assert_true(s->materials[0].opaque);
    REQUIRE_NEAR(s->materials[0].base_color[2], 0.1, 1e-6);
    finish(s);
    s = load("{\"pellucid\":1,\"meshes\":[{\"path\":\"cube.obj\",\"material\":\"mine\"},{\"path\":\"cube.obj\",\"material\":\"apple\"}],"
             "\"unit\":\"1cm\",\"materials\":{\"mine\":{\"preset\":\"cream\"}},\"ground\":\"mine\"}",
             NULL);
    assert_string_equal(s->materials[s->meshes[0].material].preset, "cream");
    assert_string_equal(s->materials[s->meshes[1].material].preset, "apple");
    assert_int_equal(s->meshes[2].material, s->meshes[0].material);
    finish(s);
}

/* Image files exist on disk. */
static void pictures_are_looked_up_and_named_when_broken(void **state)
{
    static const float values[4] = { 0.25f, 0.5f, 0.75f, 1.0f };
    const struct pell_channel rgba[4] = {
        { "R", values, 2, false },
        { "G", values, 2, false },
        { "B", values, 2, false },
        { "A", values, 2, false },
    };
    const struct pell_write_params params = { .width = 2, .height = 2, .channels = rgba, .num_channels = 4 };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    char folder[256], path[512], command[512];
    static const struct {
        const char *name, *text;
        enum pell_result res;
    } scenes[] = {
        { "good.json",
          "{\"pellucid\":1,\"mesh\":{\"path\":\"c.obj\"},\"size\":\"1cm\",\"lights\":[{\"type\":\"environment\",\"image\":\"p.png\"},"
          "{\"type\":\"point\",\"at\":[0,0,9],\"intensity\":1,\"project\":\"p.png\",\"project_fov_deg\":90}],"
          "\"background\":{\"image\":\"p.png\"},"
          "\"materials\":{\"*\":{\"textures\":{\"baseColor\":\"p.png\",\"roughness\":\"p.png#g\",\"normal\":\"b.png\"},"
          "\"strength\":\"baseColor.a\"}}}",
          PELL_OK },
        { "sheet.json",
          "{\"pellucid\":1,\"mesh\":\"c.obj\",\"size\":\"1cm\",\"materials\":{\"*\":{\"opaque\":true,\"alpha_cutoff\":0.25,\"textures\":{"
          "\"baseColor\":\"p.png\","
          "\"diffuseTransmission\":\"p.png#a\"},\"diffuse_transmission\":0.25}}}",
          PELL_OK },
        { "mask.json", "{\"pellucid\":1,\"mesh\":\"c.obj\",\"size\":\"1cm\",\"materials\":{\"*\":{\"strength\":\"p.png#b\"}}}", PELL_OK },
        { "gone.json",
          "{\"pellucid\":1,\"mesh\":\"c.obj\",\"size\":\"1cm\",\"materials\":{\"*\":{\"textures\":{\"normal\":\"gone.png\"}}}}",
          PELL_ERR_IO },
        { "out.json",
          "{\"pellucid\":1,\"mesh\":\"c.obj\",\"size\":\"1cm\",\"materials\":{\"*\":{\"textures\":{\"normal\":\"/etc/passwd\"}}}}",
          PELL_ERR_FORMAT },
        { "up.json", "{\"pellucid\":1,\"mesh\":\"../c.obj\",\"size\":\"1cm\"}", PELL_ERR_FORMAT },
        { "dark.json", "{\"pellucid\":1,\"mesh\":\"c.obj\",\"size\":\"1cm\",\"lights\":[{\"type\":\"environment\",\"image\":\"b.png\"}]}",
          PELL_ERR_FORMAT },
        { "none.json", "{\"pellucid\":1,\"mesh\":\"none.obj\",\"size\":\"1cm\"}", PELL_ERR_IO },
    };
    (void) state;

    snprintf(folder, sizeof(folder), "%s/pell-scene-XXXXXX", getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp");
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof(path), "%s/p.png", folder);
    assert_int_equal(pell_image_write(ctx, path, NULL, &params), PELL_OK);
    snprintf(path, sizeof(path), "%s/b.png", folder);
    assert_int_equal(pell_file_write(ctx, path, "\x89PNG\r\n\x1a\nbroken", 14), PELL_OK);
    snprintf(path, sizeof(path), "%s/c.obj", folder);
    assert_int_equal(pell_file_write(ctx, path, CUBE, strlen(CUBE)), PELL_OK);
    for (size_t i = 0; i < PELL_COUNT(scenes); i++) {
        const int before = kept.errors;
        struct pell_scene *s;
        enum pell_result res;
        snprintf(path, sizeof(path), "%s/%s", folder, scenes[i].name);
        assert_int_equal(pell_file_write(ctx, path, scenes[i].text, strlen(scenes[i].text)), PELL_OK);
        res = pell_scene_load(ctx, path, NULL, &s);
        if (res != scenes[i].res)
            fail_msg("%s: %d, wanted %d (%s: %s)", scenes[i].name, res, scenes[i].res, kept.where, kept.what);
        assert_int_equal(kept.errors - before, res != PELL_OK);
        if (i == 0) {
            const struct pell_material *m = &s->materials[0];
            assert_non_null(m->base_color_map.texture);
            assert_ptr_equal(m->strength_map.texture, m->base_color_map.texture);
            assert_int_equal(m->strength_map.channel, 3);
            assert_int_equal(m->roughness_map.channel, 1);
            REQUIRE(m->roughness_map.texture && m->roughness_map.texture != m->base_color_map.texture);
            assert_false(m->alpha_mask);
            assert_null(m->normal_map.texture); /* broken: skipped, with a warning */
            assert_int_equal(s->num_textures, 2);
            REQUIRE(s->lights[0].image && s->lights[1].image && s->background == PELL_BACKGROUND_IMAGE);
            REQUIRE(kept.warnings >= 1);
        } else if (i == 1) {
            const struct pell_material *m = &s->materials[0];
            REQUIRE(m->opaque && m->diffuse_transmission == 0.25f && m->diffuse_transmission_map.channel == 3);
            REQUIRE(m->alpha_mask && m->alpha_cutoff == 0.25f);
            /* the colour of the surface */
            assert_ptr_equal(m->diffuse_transmission_color_map.texture, m->base_color_map.texture);
        } else if (i == 2) {
            REQUIRE(s->materials[0].strength_map.texture && s->materials[0].strength_map.channel == 2);
        }
        pell_scene_destroy(&s);
        assert_int_equal(pell_memory_used(ctx), 0);
    }
    pell_context_destroy(&ctx);
    snprintf(command, sizeof(command), "rm -r '%s'", folder);
    assert_int_equal(system(command), 0);
}

/* "%04d" in the name of an image is the number of the scene's time. */
static void a_picture_of_a_sequence_is_that_of_the_time(void **state)
{
#define FILM(name, rest) "{\"pellucid\":1,\"mesh\":\"c.obj\",\"size\":\"1cm\",\"materials\":{\"*\":{\"strength\":\"" name "#r\"}}" rest "}"
    static const struct {
        const char *text;
        double time;
        enum pell_result res;
        int number; /* -1: no sequence */
    } cases[] = {
        { FILM("p_%04d.png", ""), 0.0, PELL_OK, 0 },
        { FILM("p_%04d.png", ""), -5.0, PELL_OK, 0 },
        { FILM("p_%04d.png", ""), 1.0 / 24.0, PELL_OK, 1 },
        { FILM("p_%04d.png", ",\"image_rate\":2"), 0.99, PELL_OK, 1 },
        { FILM("p_%04d.png", ",\"image_rate\":2"), 1.0, PELL_OK, 2 },
        { FILM("p_%04d.png", ",\"image_rate\":2"), 1.5, PELL_ERR_IO, 0 },
        { FILM("p_%04d.png", ",\"time\":1,\"image_rate\":2"), 0.0, PELL_OK, 2 },
        { FILM("q%d.png", ",\"image_rate\":1"), 2.0, PELL_OK, 2 },
        { FILM("p_%04d_%d.png", ""), 0.0, PELL_ERR_FORMAT, 0 },
        { FILM("p_%04d.png", ",\"image_rate\":1e6"), 1e6, PELL_ERR_FORMAT, 0 },
        { FILM("p_%04d.png", ",\"image_rate\":0"), 0.0, PELL_ERR_FORMAT, 0 },
        { FILM("p_%s%n%99d%.png", ""), 0.0, PELL_ERR_IO, 0 },
        { FILM("../p_%04d.png", ""), 0.0, PELL_ERR_FORMAT, 0 },
        { FILM("p_0001.png", ""), 0.0, PELL_OK, -1 },
    };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    char folder[256], path[512], command[512];

    (void) state;
    snprintf(folder, sizeof(folder), "%s/pell-scene-XXXXXX", getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp");
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof(path), "%s/c.obj", folder);
    assert_int_equal(pell_file_write(ctx, path, CUBE, strlen(CUBE)), PELL_OK);
    for (int i = 0; i < 6; i++) {
        const float value = (float) (i % 3 + 1) * 0.25f;
        const struct pell_channel grey = { "Y", &value, 1, true };
        const struct pell_write_params params = { .width = 1, .height = 1, .channels = &grey, .num_channels = 1 };
        snprintf(path, sizeof(path), i < 3 ? "%s/p_%04d.png" : "%s/q%d.png", folder, i % 3);
        assert_int_equal(pell_image_write(ctx, path, NULL, &params), PELL_OK);
    }
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        const struct pell_load_params params = { .timed = cases[i].time != 0.0, .time = cases[i].time };
        struct pell_scene *s;
        enum pell_result res;
        snprintf(path, sizeof(path), "%s/s.json", folder);
        assert_int_equal(pell_file_write(ctx, path, cases[i].text, strlen(cases[i].text)), PELL_OK);
        res = pell_scene_load(ctx, path, &params, &s);
        if (res != cases[i].res)
            fail_msg("case %zu: %d, wanted %d (%s: %s)", i, res, cases[i].res, kept.where, kept.what);
        if (res == PELL_OK) {
            const struct pell_texture *t = s->materials[0].strength_map.texture;
            char name[16];
            assert_non_null(t);
            snprintf(name, sizeof(name), strchr(cases[i].text, 'q') ? "q%d.png" : "p_%04d.png", cases[i].number < 0 ? 1 : cases[i].number);
            assert_non_null(strstr(t->name, name));
            assert_int_equal(s->animated, cases[i].number >= 0);
        }
        pell_scene_destroy(&s);
        assert_int_equal(pell_memory_used(ctx), 0);
    }
    pell_context_destroy(&ctx);
    snprintf(command, sizeof(command), "rm -r '%s'", folder);
    assert_int_equal(system(command), 0);
#undef FILM
}

/* --- Background, options ------------------------------------------------------------------------------------------------------ */

static void backgrounds_and_options_are_kept(void **state)
{
    struct pell_scene *s =
        load(SCENE(",\"background\":{\"color\":[0.1,0.2,0.3],\"ground\":true},\"render\":{\"method\":\"screen-space\",\"width\":400,"
                   "\"height\":800,\"exposure\":0.125,\"layers\":true,\"knobs\":{\"lod\":0.5,\"tint\":[1,0.5,0.25]}}"),
             NULL);
    static const struct {
        const char *name, *value, *where;
    } want[] = { { "method", "screen-space", "s.json:/render/method" },
                 { "width", "400", "s.json:/render/width" },
                 { "height", "800", "s.json:/render/height" },
                 { "exposure", "0.125", "s.json:/render/exposure" },
                 { "layers", "true", "s.json:/render/layers" },
                 { "knobs/lod", "0.5", "s.json:/render/knobs/lod" },
                 { "knobs/tint", "1,0.5,0.25", "s.json:/render/knobs/tint" } };
    (void) state;

    assert_int_equal(s->num_options, PELL_COUNT(want));
    for (size_t i = 0; i < PELL_COUNT(want); i++) {
        size_t k = 0;
        while (k < s->num_options && strcmp(s->options[k].name, want[i].name) != 0)
            k++;
        REQUIRE(k < s->num_options);
        assert_string_equal(s->options[k].value, want[i].value);
        assert_string_equal(s->options[k].where, want[i].where);
    }
    assert_int_equal(s->background, PELL_BACKGROUND_COLOR);
    REQUIRE_NEAR(s->background_color[2], 0.3, 1e-6);
    assert_int_equal(s->ground_mesh, 1);
    /* The default camera frames for the image's aspect ratio, which is narrow here: the cube's width determines the distance. */
    REQUIRE_NEAR(5.0 / ((s->cameras[0].position[2] - s->bounds_max[2]) * tan(0.5 * s->cameras[0].fov) * 0.5), 0.8, 1e-3);
    finish(s);
    s = load(SCENE(",\"background\":\"transparent\""), NULL);
    assert_int_equal(s->background, PELL_BACKGROUND_TRANSPARENT);
    finish(s);
}

/* --- Refusals ----------------------------------------------------------------------------------------------------------------- */

#define OF_ALL(material) SCENE(",\"materials\":{\"*\":{" material "}}")
#define SIGMA "\"sigma_s\":[1,1,1],\"sigma_t\":[2,2,2]"

static const struct {
    const char *text, *where, *what, *hint;
} refused[] = {
    { "{\"pellucid\":1}", "s.json:/", "has no mesh", "" },
    { "{\"mesh\":\"cube.obj\"}", "s.json:/", "has no \"pellucid\"", "" },
    { OF_ALL("\"preset\":\"apple\",\"diffuse_transmission\":0.5"), "s.json:/materials/*/diffuse_transmission", "thin opaque sheets",
      "opaque" },
    { "{\"pellucid\":2,\"mesh\":\"cube.obj\"}", "s.json:/pellucid", "is 2", "" },
    { SCENE(",\"meshes\":[\"cube.obj\"]"), "s.json:/", "both mesh and meshes", "" },
    { SCENE(",\"size\":\"1cm\""), "s.json:/size", "both unit and size", "" },
    { SCENE(",\"lihgts\":[]"), "s.json:/lihgts", "unknown key", "\"lights\"" },
    { SCENE(",\"time\":\"1s\""), "s.json:/time", "allowed: a number", "" },
    { SCENE(",\"time\":2e9"), "s.json:/time", "is 2e+09", "" },
    { SCENE(",\"animation\":\"walk\""), "s.json:/animation", "no mesh file has an animation", "" },
    { "{\"pellucid\":1,\"mesh\":\"walk.gltf\",\"animation\":\"waddle\"}", "s.json:/animation", "there is no animation \"waddle\"", "" },
    { SCENE(",\"animation\":-1"), "s.json:/animation", "is -1", "" },
    { SCENE(",\"animation\":[]"), "s.json:/animation", "allowed: a string", "" },
    { "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":10}", "s.json:/unit", "is 10", "" },
    { "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"10\"}", "s.json:/unit", "no unit", "10mm" },
    { "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"-1mm\"}", "s.json:/unit", "above 0", "" },
    { "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"1e40km\"}", "s.json:/", "allowed", "" },
    { "{\"pellucid\":1,\"mesh\":{\"path\":\"cube.obj\",\"scale\":0},\"unit\":\"1mm\"}", "s.json:/mesh/scale", "at least 1e-6", "" },
    { SCENE(",\"normals\":\"smooth\""), "s.json:/normals", "unknown key", "it is a key of \"mesh\"" },
    { "{\"pellucid\":1,\"mesh\":{\"pth\":\"cube.obj\"},\"unit\":\"1mm\"}", "s.json:/mesh/pth", "unknown key", "\"path\"" },
    { SCENE(",\"camera\":\"front\""), "s.json:/camera", "no camera \"front\"", "" },
    { SCENE(",\"camera\":{\"to\":[0,0,0]}"), "s.json:/camera", "has no \"from\"", "" },
    { SCENE(",\"camera\":{\"from\":[0,0,0]}"), "s.json:/camera", "gives no direction", "" },
    { SCENE(",\"camera\":{\"from\":[0,0,1],\"fov_deg\":180}"), "s.json:/camera/fov_deg", "is 180", "" },
    { SCENE(",\"camera\":{\"from\":[0,0,1],\"fov_deg\":20,\"ortho_height\":1}"), "s.json:/camera", "has both", "" },
    { SCENE(",\"camera\":{\"from\":[0,0]}"), "s.json:/camera/from", "elements", "" },
    { SCENE(",\"camera\":{\"from\":[0,0,1e300]}"), "s.json:/camera/from/2", "is 1e+300", "" },
    { SCENE(",\"camera\":{\"from\":[0,0,1],\"up\":[0,0,0]}"), "s.json:/camera/up", "has no length", "" },
    { SCENE(",\"lights\":[{\"type\":\"pont\",\"at\":[0,0,1],\"intensity\":1}]"), "s.json:/lights/0/type", "is \"pont\"", "\"point\"" },
    { SCENE(",\"lights\":[{\"type\":\"point\",\"at\":[0,0,1],\"intensity\":-1}]"), "s.json:/lights/0/intensity", "is -1", "" },
    { SCENE(",\"lights\":[{\"type\":\"point\",\"at\":[0,0,1]}]"), "s.json:/lights/0", "\"intensity\"", "" },
    { SCENE(",\"lights\":[{\"type\":\"point\",\"at\":[0,0,1],\"radiance\":1}]"), "s.json:/lights/0/radiance", "unknown key", "" },
    { SCENE(",\"lights\":[{\"type\":\"rect\",\"at\":[0,0,1],\"radiance\":1,\"width\":1}]"), "s.json:/lights/0", "\"height\"", "" },
    { SCENE(",\"lights\":[{\"type\":\"rect\",\"at\":[0,0,1],\"radiance\":1,\"width\":0,\"height\":1}]"), "s.json:/lights/0/width", "is 0",
      "" },
    { SCENE(",\"lights\":[{\"type\":\"spot\",\"at\":[0,0,0],\"intensity\":1}]"), "s.json:/lights/0", "gives no direction", "" },
    { SCENE(",\"lights\":[{\"type\":\"spot\",\"at\":[0,0,1],\"intensity\":1,\"cone_deg\":10,\"inner_deg\":20}]"),
      "s.json:/lights/0/inner_deg", "is 20", "" },
    { SCENE(",\"lights\":[{\"type\":\"environment\"}]"), "s.json:/lights/0", "neither image nor color", "" },
    { SCENE(",\"lights\":{}"), "s.json:/lights", "an array", "" },
    { SCENE(",\"lights\":[{\"studio\":1}]"), "s.json:/lights/0/studio", "is 1", "" },
    { SCENE(",\"lights\":[{\"studio\":\"windw\"}]"), "s.json:/lights/0/studio", "no \"windw\"", "\"window\"" },
    { SCENE(",\"camera\":{\"side\":\"fornt\"}"), "s.json:/camera/side", "no \"fornt\"", "\"front\"" },
    { SCENE(",\"camera\":{\"side\":\"10,95\"}"), "s.json:/camera/side", "10,95", "35,15" },
    { SCENE(",\"camera\":{\"side\":34}"), "s.json:/camera/side", "34", "" },
    { SCENE(",\"camera\":{\"side\":\"34\",\"fov_deg\":20}"), "s.json:/camera/fov_deg", "does not go with", "from" },
    { SCENE(",\"background\":\"#12345\""), "s.json:/background", "\"#12345\" is no colour", "#RRGGBB" },
    { SCENE(",\"materials\":{\"*\":{\"preset\":\"marbel\"}}"), "s.json:/materials/*/preset", "no material \"marbel\"", "\"marble\"" },
    { SCENE(",\"materials\":{\"*\":{\"sigma_a\":[1,1,1]}}"), "s.json:/materials/*", "sigma_s_reduced", "" },
    { SCENE(",\"materials\":{\"*\":{\"sigma_a\":[1,1,-2],\"sigma_s_reduced\":[1,1,1]}}"), "s.json:/materials/*/sigma_a/2", "is -2", "" },
    { SCENE(",\"materials\":{\"*\":{\"sigma_a\":[0,0,0],\"sigma_s_reduced\":[0,0,0]}}"), "s.json:/materials/*", "must not be 0", "" },
    { SCENE(",\"materials\":{\"*\":{\"preset\":\"marble\",\"sigma_a\":[1,1,1]}}"), "s.json:/materials/*", "a preset and coefficients", "" },
    { SCENE(",\"materials\":{\"*\":{\"color\":[1,1,1],\"mean_free_path\":1}}"), "s.json:/materials/*/mean_free_path", "without a unit",
      "1.2mm" },
    { SCENE(",\"materials\":{\"*\":{\"color\":[1,1,1],\"mean_free_path\":[\"1mm\",2,\"1mm\"]}}"), "s.json:/materials/*/mean_free_path/1",
      "without a unit", "" },
    { SCENE(",\"materials\":{\"*\":{\"mean_free_path\":\"1mm\"}}"), "s.json:/materials/*", "\"color\"", "" },
    { SCENE(",\"materials\":{\"*\":{\"color\":[1,1,1],\"radius\":1}}"), "s.json:/materials/*/radius", "without a unit", "1.2mm" },
    { SCENE(",\"materials\":{\"*\":{\"color\":[0.5,0.5,0.5],\"radius\":\"1mm\",\"radius_kind\":\"bruley\"}}"),
      "s.json:/materials/*/radius_kind", "burley", "" },
    { SCENE(",\"materials\":{\"*\":{\"color\":[0.5,0.5,0.5],\"mean_free_path\":\"1mm\",\"radius_kind\":\"burley\"}}"),
      "s.json:/materials/*", "\"radius\"", "" },
    { SCENE(",\"materials\":{\"*\":{\"color\":[0.5,0.5,0.5],\"mean_free_path\":\"1mm\",\"radius\":\"1mm\"}}"), "s.json:/materials/*",
      "a mean_free_path and a radius", "" },
    { SCENE(",\"materials\":{\"*\":{\"color\":[1,1,1],\"radius\":\"1mm\",\"radius_kind\":\"diffuse\"}}"), "s.json:/materials/*",
      "has no medium", "" },
    { SCENE(",\"materials\":{\"*\":{\"color\":[1,1,1]}}"), "s.json:/materials/*/color", "says nothing", "mean_free_path" },
    { SCENE(",\"materials\":{\"*\":{\"skin\":{\"melanin\":1.5}}}"), "s.json:/materials/*/skin/melanin", "is 1.5", "" },
    { SCENE(",\"materials\":{\"*\":{\"skin\":{\"blood\":0.1}}}"), "s.json:/materials/*/skin/blood", "unknown key", "" },
    { SCENE(",\"materials\":{\"*\":{\"skin\":[]}}"), "s.json:/materials/*/skin", "an object", "" },
    { SCENE(",\"materials\":{\"*\":{\"skin\":{},\"preset\":\"milk\"}}"), "s.json:/materials/*", "a preset and skin", "" },
    { SCENE(",\"materials\":{\"*\":{\"skin\":{},\"eta\":1.3}}"), "s.json:/materials/*/eta", "belongs inside skin", "" },
    { SCENE(",\"materials\":{\"*\":{\"color\":[1,1,1.5],\"mean_free_path\":\"1mm\"}}"), "s.json:/materials/*/color/2", "is 1.5", "" },
    { SCENE(",\"materials\":{\"*\":{\"color\":1.5,\"mean_free_path\":\"1mm\"}}"), "s.json:/materials/*/color", "is 1.5", "" },
    { OF_ALL("\"textures\":{\"roughness\":\"a.png#q\"}"), "s.json:/materials/*/textures/roughness", "no channel \"q\"", "#g" },
    { OF_ALL("\"textures\":{\"roughness\":\"a.png#\"}"), "s.json:/materials/*/textures/roughness", "no channel \"\"", "#g" },
    { SCENE(",\"materials\":{\"*\":\"marble\"}"), "s.json:/materials/*", "allowed: an object", "\"preset\"" },
    { OF_ALL("\"layers\":[]"), "s.json:/materials/*/layers", "elements", "" },
    { OF_ALL("\"layers\":[3]"), "s.json:/materials/*/layers/0", "allowed: an object", "" },
    { OF_ALL("\"layers\":[{\"depht\":\"1mm\"}]"), "s.json:/materials/*/layers/0/depht", "unknown key", "\"depth\"" },
    { OF_ALL("\"layers\":[{\"sigma_s\":[1,1,1],\"depth\":\"1mm\"}]"), "s.json:/materials/*/layers/0", "two of sigma_a", "sigma_t = " },
    { OF_ALL("\"layers\":[{\"sigma_a\":[1,1,1]," SIGMA ",\"depth\":\"1mm\"}]"), "s.json:/materials/*/layers/0", "two of sigma_a", "" },
    { OF_ALL("\"layers\":[{\"sigma_s\":[1,3,1],\"sigma_t\":[2,2,2],\"depth\":\"1mm\"}]"), "s.json:/materials/*/layers/0/sigma_s/1",
      "is 3, allowed: [0, 2]", "" },
    { OF_ALL("\"layers\":[{\"sigma_a\":[1,1,2.5],\"sigma_t\":[2,2,2],\"depth\":\"1mm\"}]"), "s.json:/materials/*/layers/0/sigma_a/2",
      "is 2.5, allowed: [0, 2]", "" },
    { OF_ALL("\"layers\":[{\"sigma_a\":[1,1,-1],\"sigma_t\":[2,2,2],\"depth\":\"1mm\"}]"), "s.json:/materials/*/layers/0/sigma_a/2",
      "is -1", "" },
    { OF_ALL("\"layers\":[{\"sigma_a\":[1,1,1e7],\"sigma_s\":[2,2,2],\"depth\":\"1mm\"}]"), "s.json:/materials/*/layers/0/sigma_a/2",
      "is 10000000", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":2}]"), "s.json:/materials/*/layers/0/depth", "without a unit", "1.2mm" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"2\"}]"), "s.json:/materials/*/layers/0/depth", "no unit", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"-1mm\"}]"), "s.json:/materials/*/layers/0/depth", "is -1 mm, allowed: [0,", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"2km\"}]"), "s.json:/materials/*/layers/0/depth", "is 2e+06 mm, allowed: [0,", "" },
    { OF_ALL("\"layers\":[{" SIGMA "},{" SIGMA ",\"depth\":\"1mm\"}]"), "s.json:/materials/*/layers/0", "has no \"depth\"", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"2mm\"},{" SIGMA ",\"depth\":\"1mm\"}]"), "s.json:/materials/*/layers/1/depth",
      "is 1 mm, allowed: [2,", "top to bottom" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"a.png#q\",\"depth_scale\":\"4mm\"}]"), "s.json:/materials/*/layers/0/depth",
      "no channel \"q\"", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"a.png#r\"}]"), "s.json:/materials/*/layers/0", "must have depth_scale", "4mm" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"a.png#r\",\"depth_scale\":\"2km\"}]"), "s.json:/materials/*/layers/0/depth_scale",
      "is 2e+06 mm, allowed:", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"a.png#r\",\"depth_scale\":4}]"), "s.json:/materials/*/layers/0/depth_scale",
      "a number without a unit", "as in \"4mm\"" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"a.png#r\",\"depth_scale\":\"4mm\",\"depth_encoding\":\"log\"}]"),
      "s.json:/materials/*/layers/0/depth_encoding", "linear, inverse", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"baseColor.a\",\"depth_scale\":\"4mm\"}]"), "s.json:/materials/*/layers/0/depth",
      "has no such texture", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\",\"depth_scale\":\"4mm\"}]"), "s.json:/materials/*/layers/0/depth_scale",
      "belongs to a painted depth", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\",\"phase\":\"mie\"}]"), "s.json:/materials/*/layers/0/phase",
      "hg, schlick, rayleigh, two-lobe", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\",\"g\":1}]"), "s.json:/materials/*/layers/0/g", "is 1", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\",\"g\":[0.1,0.2]}]"), "s.json:/materials/*/layers/0/g", "an array of 2, allowed",
      "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\",\"phase\":\"rayleigh\",\"g\":0}]"), "s.json:/materials/*/layers/0/g",
      "does not belong", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\",\"phase\":\"two-lobe\"}]"), "s.json:/materials/*/layers/0", "has no \"g\"", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\",\"phase\":\"two-lobe\",\"g\":[0.1,0.2],\"weight\":2}]"),
      "s.json:/materials/*/layers/0/weight", "is 2", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\",\"weight\":0.5}]"), "s.json:/materials/*/layers/0/weight",
      "belongs to the phase function", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\"}],\"below\":\"nothing\""), "s.json:/materials/*/below", "stop, last, surface-color",
      "" },
    { OF_ALL("\"below\":\"stop\""), "s.json:/materials/*/below", "stands without layers", "" },
    { OF_ALL("\"layers\":[{" SIGMA "}],\"depths\":[\"a.png\",\"b.png\"]"), "s.json:/materials/*/depths", "has 2 images for 1 layer", "" },
    { OF_ALL("\"layers\":[{" SIGMA "}],\"depths\":[\"a.png\"]"), "s.json:/materials/*/layers/0", "must have depth_scale", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\"}],\"profile\":\"dipole\""), "s.json:/materials/*/profile",
      "layers have one of their own", "" },
    { OF_ALL("\"layers\":[{" SIGMA ",\"depth\":\"1mm\"}],\"color\":[1,1,1]"), "s.json:/materials/*/color", "says nothing", "" },
    { SCENE(",\"materials\":{\"*\":{\"profile\":\"multipole\"}}"), "s.json:/materials/*/profile", "photon-beam, monte-carlo", "" },
    { SCENE(",\"materials\":{\"*\":{\"preset\":\"skin-6gaussian\",\"profile\":\"photon-beam\"}}"), "s.json:/materials/*/profile",
      "this material has none", "coefficients" },
    { SCENE(",\"materials\":{\"*\":{\"preset\":\"leaf\",\"profile\":\"dipole\"}}"), "s.json:/materials/*/profile", "this material has none",
      "" },
    { SCENE(",\"materials\":{\"*\":{\"profile\":3}}"), "s.json:/materials/*/profile", "is 3", "" },
    { SCENE(",\"materials\":{\"*\":{\"profile\":{}}}"), "s.json:/materials/*/profile", "\"table\"", "" },
    { SCENE(",\"materials\":{\"*\":{\"profile\":{\"tabel\":\"wax.csv\"}}}"), "s.json:/materials/*/profile/tabel", "unknown key",
      "\"table\"" },
    { SCENE(",\"materials\":{\"*\":{\"profile\":{\"table\":\"none.csv\"}}}"), "", "no such file", "" },
    { SCENE(",\"materials\":{\"*\":{\"profile\":{\"table\":\"bright.csv\"}}}"), "bright.csv:1", "no more light", "" },
    { SCENE(",\"materials\":{\"*\":{\"g\":0.5}}"), "s.json:/materials/*/g", "without sigma_s", "" },
    { SCENE(",\"materials\":{\"*\":{\"mix\":1.5}}"), "s.json:/materials/*/mix", "is 1.5", "" },
    { SCENE(",\"materials\":{\"*\":{\"specular\":{\"model\":\"phnog\"}}}"), "s.json:/materials/*/specular/model",
      "ggx, kelemen, phong, blinn-phong", "" },
    { SCENE(",\"materials\":{\"*\":{\"specualr\":{}}}"), "s.json:/materials/*/specualr", "unknown key", "\"specular\"" },
    { SCENE(",\"materials\":{\"a/b~c\":{\"mix\":0.5,\"mxi\":1}}"), "s.json:/materials/a~1b~0c/mxi", "unknown key", "" },
    { SCENE(",\"background\":\"environment\""), "s.json:/background", "no light is one", "" },
    { SCENE(",\"background\":\"sky\""), "s.json:/background", "no \"sky\"", "environment, transparent" },
    { SCENE(",\"background\":{\"color\":[1,1,1],\"ground\":true},\"ground\":true"), "s.json:/background", "one is allowed", "" },
    { SCENE(",\"ground\":5"), "s.json:/ground", "must be true", "" },
    { SCENE(",\"ground\":\"grass\""), "s.json:/ground", "no material \"grass\"", "" },
    { SCENE(",\"render\":{\"width\":null}"), "s.json:/render/width", "must be a number", "" },
    { SCENE(",\"render\":{\"knobs\":5}"), "s.json:/render/knobs", "an object", "" },
    { SCENE(",\"mesh\":\"cube.obj\""), "s.json:1:", "duplicate", "" },
    { "5", "s.json:/", "is 5, allowed: an object", "" },
    { "null", "s.json:/", "is null, allowed: an object", "" },
    { "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"1mm\",\"camera\":{\"from\":[0,0,1e999]}}", "s.json:1:", "not valid JSON", "" },
    { "{\"pellucid\":1,\"mesh\":\"s.json\",\"unit\":\"1mm\"}", "s.json", "no such file", "" },
    { "{\"pellucid\":1,\"mesh\":\"soap.json\",\"unit\":\"1mm\"}", "soap.json", "a mesh file is needed", "" },
};

static void what_is_wrong_is_refused_with_place_value_and_hint(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(refused); i++) {
        struct kept_messages kept = { 0 };
        struct pell_context *ctx = test_context(NULL, &kept);
        struct pell_scene *s;
        const enum pell_result res = load_bytes(ctx, "s.json", refused[i].text, strlen(refused[i].text), NULL, files, &s);
        if (res == PELL_OK || res == PELL_ERR_NOMEM || kept.errors != 1 ||
            strncmp(kept.where, refused[i].where, strlen(refused[i].where)) != 0 || !strstr(kept.what, refused[i].what) ||
            !strstr(kept.hint, refused[i].hint))
            fail_msg("%s\n-> %d, %d errors, %s: %s (%s)\nwanted %s: %s (%s)", refused[i].text, res, kept.errors, kept.where, kept.what,
                     kept.hint, refused[i].where, refused[i].what, refused[i].hint);
        assert_null(s);
        assert_int_equal(pell_memory_used(ctx), 0);
        pell_context_destroy(&ctx);
    }
}

/* --- The schema --------------------------------------------------------------------------------------------------------------- */

static json_t *read_schema(void)
{
    json_error_t error;
    json_t *schema = json_load_file(SCHEMA, JSON_REJECT_DUPLICATES, &error);

    if (!schema)
        fail_msg("%s:%d: %s", SCHEMA, error.line, error.text);
    return schema;
}

static void same_keys(const json_t *schema, const struct pell_scene_keys *table)
{
    const json_t *object = *table->object ? json_object_get(json_object_get(schema, "$defs"), table->object) : schema;
    json_t *properties = json_object_get(object, "properties"), *value;
    const char *key;

    if (!properties)
        fail_msg("the schema has no object %s", table->object);
    for (size_t i = 0; i < table->count; i++)
        if (!json_object_get(properties, table->keys[i]))
            fail_msg("the schema's %s has no %s", table->object, table->keys[i]);
    json_object_foreach(properties, key, value)
    {
        size_t i = 0;
        while (i < table->count && strcmp(key, table->keys[i]) != 0)
            i++;
        if (i == table->count)
            fail_msg("the reader's %s has no %s", table->object, key);
    }
}

static void schema_and_reader_know_the_same_keys(void **state)
{
    json_t *schema = read_schema(), *defs = json_object_get(schema, "$defs"), *value;
    const char *name;
    size_t objects = 0;
    (void) state;

    for (const struct pell_scene_keys *t = pell_scene_keys; t->object; t++, objects++)
        same_keys(schema, t);
    for (size_t i = 0; i < PELL_LIGHT_KINDS; i++, objects++)
        same_keys(schema, &pell_light_keys[i]);
    json_object_foreach(defs, name, value) objects -= json_object_get(value, "properties") != NULL;
    assert_int_equal(objects, 1); /* the root: every object of the schema has a table */
    json_decref(schema);
}

/* The subset of JSON Schema that the file uses. Fails the test on an unknown keyword. */
static bool valid(const json_t *schema, const json_t *root, const json_t *v);

static bool matches(const char *pattern, const char *text)
{
    regex_t regex;
    bool found;

    assert_int_equal(regcomp(&regex, pattern, REG_EXTENDED | REG_NOSUB), 0);
    found = regexec(&regex, text, 0, NULL, 0) == 0;
    regfree(&regex);
    return found;
}

static bool has_type(const json_t *v, const char *type)
{
    if (strcmp(type, "object") == 0)
        return json_is_object(v);
    if (strcmp(type, "array") == 0)
        return json_is_array(v);
    if (strcmp(type, "string") == 0)
        return json_is_string(v);
    if (strcmp(type, "number") == 0)
        return json_is_number(v);
    if (strcmp(type, "boolean") == 0)
        return json_is_boolean(v);
    if (strcmp(type, "integer") != 0)
        fail_msg("the schema says type \"%s\", which this test does not know", type);
    return json_is_number(v) && floor(json_number_value(v)) == json_number_value(v);
}

static int count_valid(const json_t *list, const json_t *root, const json_t *v)
{
    int n = 0;
    for (size_t i = 0; i < json_array_size(list); i++)
        n += valid(json_array_get(list, i), root, v);
    return n;
}

static bool contains(const json_t *list, const json_t *v)
{
    for (size_t i = 0; i < json_array_size(list); i++)
        if (json_equal(json_array_get(list, i), v))
            return true;
    return false;
}

static bool valid_object(const json_t *schema, const json_t *root, const json_t *v)
{
    const json_t *properties = json_object_get(schema, "properties"), *additional = json_object_get(schema, "additionalProperties");
    const char *key;
    json_t *value;

    json_object_foreach((json_t *) v, key, value)
    {
        const json_t *s = json_object_get(properties, key);
        if (!s)
            s = additional;
        if (s && !(json_is_false(s) ? false : valid(s, root, value)))
            return false;
    }
    return true;
}

static bool valid(const json_t *schema, const json_t *root, const json_t *v)
{
    const char *word;
    json_t *s;

    json_object_foreach((json_t *) schema, word, s)
    {
        bool ok = true;
        if (strcmp(word, "$ref") == 0) {
            assert_int_equal(strncmp(json_string_value(s), "#/$defs/", 8), 0);
            s = json_object_get(json_object_get(root, "$defs"), json_string_value(s) + 8);
            assert_non_null(s);
            ok = valid(s, root, v);
        } else if (strcmp(word, "type") == 0) {
            ok = has_type(v, json_string_value(s));
        } else if (strcmp(word, "const") == 0) {
            ok = json_equal(s, v) || (json_is_number(s) && json_is_number(v) && json_number_value(s) == json_number_value(v));
        } else if (strcmp(word, "enum") == 0) {
            ok = contains(s, v);
        } else if (strcmp(word, "anyOf") == 0) {
            ok = count_valid(s, root, v) > 0;
        } else if (strcmp(word, "oneOf") == 0) {
            ok = count_valid(s, root, v) == 1;
        } else if (strcmp(word, "not") == 0) {
            ok = !valid(s, root, v);
        } else if (strcmp(word, "required") == 0) {
            for (size_t i = 0; i < json_array_size(s); i++)
                ok &= !json_is_object(v) || json_object_get(v, json_string_value(json_array_get(s, i))) != NULL;
        } else if (strcmp(word, "properties") == 0 || strcmp(word, "additionalProperties") == 0) {
            ok = !json_is_object(v) || valid_object(schema, root, v);
        } else if (strcmp(word, "items") == 0) {
            for (size_t i = 0; i < json_array_size(v); i++)
                ok &= valid(s, root, json_array_get(v, i));
        } else if (strcmp(word, "minItems") == 0) {
            ok = !json_is_array(v) || json_array_size(v) >= (size_t) json_integer_value(s);
        } else if (strcmp(word, "maxItems") == 0) {
            ok = !json_is_array(v) || json_array_size(v) <= (size_t) json_integer_value(s);
        } else if (strcmp(word, "minimum") == 0) {
            ok = !json_is_number(v) || json_number_value(v) >= json_number_value(s);
        } else if (strcmp(word, "exclusiveMinimum") == 0) {
            ok = !json_is_number(v) || json_number_value(v) > json_number_value(s);
        } else if (strcmp(word, "maximum") == 0) {
            ok = !json_is_number(v) || json_number_value(v) <= json_number_value(s);
        } else if (strcmp(word, "pattern") == 0) {
            ok = !json_is_string(v) || matches(json_string_value(s), json_string_value(v));
        } else if (word[0] != '$' && strcmp(word, "description") != 0 && strcmp(word, "title") != 0) {
            fail_msg("the schema says \"%s\", which this test does not know", word);
        }
        if (!ok)
            return false;
    }
    return true;
}

/* Valid scenes, complete; and scenes that only their semantics make invalid (names, files, dependent ranges). */
static const char *const good[] = {
    SCENE(""),
    SCENE(",\"materials\":{\"*\":{\"skin\":{\"melanin\":0.1,\"melanin_blend\":0.5,\"haemoglobin\":0.02,\"oxygenation\":0.7}}}"),
    "{\"$schema\":\"scene.schema.json\",\"pellucid\":1,\"meshes\":[\"cube.obj\",{\"path\":\"cube.obj\",\"unit\":\"1 "
    "cm\",\"translate\":[0,\"-5mm\",\"0cm\"],"
    "\"rotate_deg\":[1,2,3],\"scale\":-2,\"material\":\"apple\",\"object\":\"fruit\",\"normals\":\"smooth\"}],\"size\":\"7e-2m\"}",
    "{\"pellucid\":1,\"mesh\":\"walk.gltf\",\"time\":1.5,\"animation\":\"stand\"}",
    SCENE(",\"time\":0,\"camera\":{\"from\":[0,0,9],\"to\":[1,1,1],\"up\":[0,1,0],\"ortho_height\":\"5cm\",\"focus\":3,\"f_number\":2.8}"),
    SCENE(",\"camera\":{\"side\":\"front\"},\"lights\":[{\"studio\":\"back\"}],\"background\":\"#00ff00\""),
    SCENE(",\"lights\":[{\"type\":\"point\",\"name\":\"a\",\"at\":[0,0,9],\"to\":[0,0,0],\"up\":[1,0,0],\"project_fov_deg\":40,"
          "\"intensity\":[1,2,3]},"
          "{\"type\":\"spot\",\"at\":[0,0,9],\"intensity\":1,\"cone_deg\":30,\"inner_deg\":10},"
          "{\"type\":\"directional\",\"direction\":[0,-1,0],\"irradiance\":1,\"width\":3,\"height\":4,\"at\":[0,0,0]},"
          "{\"type\":\"rect\",\"at\":[0,0,9],\"width\":1,\"height\":1,\"radiance\":1},{\"type\":\"disc\",\"at\":[0,0,9],\"radius\":1,"
          "\"radiance\":1},"
          "{\"type\":\"environment\",\"color\":1,\"scale\":0.5,\"rotate_deg\":-90},{\"studio\":false}],\"background\":\"environment\""),
    SCENE(",\"materials\":{\"*\":{\"preset\":\"apple\",\"color_from\":\"texture\",\"mix\":0,\"strength\":1,\"roughness\":0.5,\"normal_"
          "scale\":-1,"
          "\"specular\":{\"model\":\"ggx\",\"roughness\":1,\"rho_s\":0},\"opaque\":false,\"profile\":\"dipole\",\"eta\":1.5,\"textures\":{}"
          "}},"
          "\"ground\":{\"opaque\":true,\"color\":[1,0,0],\"diffuse_transmission\":0.5,\"diffuse_transmission_color\":[1,1,0]}"),
    SCENE(",\"materials\":{\"*\":{\"preset\":\"soap.json\",\"profile\":\"monte-carlo\"},\"a\":{\"preset\":\"apple\",\"profile\":{"
          "\"table\":\"wax.csv\"}}}"),
    SCENE(",\"background\":{\"color\":0.5,\"ground\":\"marble\"},\"render\":{\"method\":\"x\",\"width\":64,\"height\":64,\"seed\":5,"
          "\"tonemap\":\"linear\","
          "\"knobs\":{\"a\":true,\"b\":[1,2,3]}}"),
    OF_ALL("\"preset\":\"skin\",\"layers\":[{\"name\":\"a\",\"sigma_s\":[1,2,3],\"sigma_t\":[2,2,3],\"depth\":\"0mm\"},"
           "{\"sigma_a\":[0,0,0],\"sigma_t\":[0,0,0],\"phase\":\"two-lobe\",\"g\":[0.9,-0.1],\"weight\":0.75,\"depth\":\"1.5 mm\"},"
           "{\"sigma_a\":[0,1,0],\"sigma_s\":[1,1,1],\"phase\":\"schlick\",\"g\":[0.1,0.2,0.3]}],\"below\":\"stop\""),
    OF_ALL("\"eta\":1.3,\"layers\":[{\"sigma_s\":[1,2,3],\"sigma_t\":[2,2,3],\"phase\":\"rayleigh\",\"depth\":\"2mm\"}],"
           "\"below\":\"surface-color\",\"color\":[1,1,1]"),
};
static const char *const beyond_schema[] = {
    "this material has none",
    "/mesh/scale",
    "no mesh file has an animation",
    "there is no animation",
    "no camera",
    "gives no direction",
    "has no length",
    "at least 1e-6",
    "marbel",
    "sigma_s_reduced",
    "must not be 0",
    "a preset and coefficients",
    "\"color\"",
    "says nothing",
    "without sigma_s",
    "no light is one",
    "one is allowed",
    "grass",
    "is 20",
    "duplicate",
    "not valid JSON",
    "no such file",
    "a mesh file is needed",
    "allowed",
    "no more light",
    "has no medium",
    "\"radius\"",
    "a mean_free_path and a radius",
    "a preset and skin",
    "belongs inside skin",
    "thin opaque sheets",
    "two of sigma_a",
    "no unit",
    "has no \"depth\"",
    "must have depth_scale",
    "has no such texture",
    "belongs to a painted depth",
    "an array of 2", /* of two lobes */
    "does not belong",
    "has no \"g\"",
    "belongs to the phase function",
    "stands without layers",
    "has 2 images",
    "layers have one of their own",
};

/* A preset has a colour for where there is no colour map; a map given with it must not be tinted by that colour. */
static void a_base_color_texture_is_not_tinted_by_the_preset(void **state)
{
    static const char *const names[] = { "cube.obj", "white.hdr", "a.json", "b.json" };
    const char *texts[] = { CUBE, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n\x80\x80\x80\x81",
                            SCENE(",\"materials\":{\"*\":{\"preset\":\"skin\",\"textures\":{\"baseColor\":\"white.hdr\"}}}"),
                            SCENE(",\"materials\":{\"*\":{\"preset\":\"skin\",\"color\":[0.5,0.25,1],"
                                  "\"textures\":{\"baseColor\":\"white.hdr\"}}}") };
    char folder[256], path[512];
    struct pell_context *ctx = test_context(NULL, NULL);
    (void) state;

    snprintf(folder, sizeof(folder), "%s/pell-scene-XXXXXX", getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp");
    assert_non_null(mkdtemp(folder));
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        snprintf(path, sizeof(path), "%s/%s", folder, names[i]);
        assert_int_equal(pell_file_write(ctx, path, texts[i], strlen(texts[i])), PELL_OK);
    }
    for (int i = 0; i < 2; i++) {
        struct pell_load_params params = { .bare = true };
        struct pell_scene *s;
        snprintf(path, sizeof(path), "%s/%s", folder, names[2 + i]);
        assert_int_equal(pell_scene_load(ctx, path, &params, &s), PELL_OK);
        assert_non_null(s->materials[0].base_color_map.texture);
        REQUIRE_NEAR(s->materials[0].base_color[1], i == 0 ? 1.0 : 0.25, 1e-7);
        pell_scene_destroy(&s);
    }
    pell_context_destroy(&ctx);
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        snprintf(path, sizeof(path), "%s/%s", folder, names[i]);
        remove(path);
    }
    rmdir(folder);
}

static void schema_and_reader_agree(void **state)
{
    json_t *schema = read_schema();
    int rejected = 0;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(good); i++) {
        json_t *v = json_loads(good[i], 0, NULL);
        struct kept_messages kept = { 0 };
        assert_non_null(v);
        finish(load(good[i], &kept));
        if (!valid(schema, schema, v))
            fail_msg("the schema refuses %s", good[i]);
        json_decref(v);
    }
    for (size_t i = 0; i < PELL_COUNT(refused); i++) {
        json_t *v = json_loads(refused[i].text, JSON_REJECT_DUPLICATES, NULL);
        bool meaning = false;
        for (size_t k = 0; k < PELL_COUNT(beyond_schema); k++)
            meaning |= strstr(refused[i].what, beyond_schema[k]) != NULL;
        if (v && !meaning) {
            if (valid(schema, schema, v))
                fail_msg("the schema allows %s", refused[i].text);
            rejected++;
        }
        json_decref(v);
    }
    REQUIRE(rejected >= 25);
    json_decref(schema);
}

/* --- Errors ------------------------------------------------------------------------------------------------------------------- */

static void damaged_files_end_well(void **state)
{
    uint64_t random = 88172645463325252ull;
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s;
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(good); k++) {
        const size_t size = strlen(good[k]);
        char copy[2048];
        for (size_t n = 0; n < size; n++) {
            REQUIRE(load_bytes(ctx, "s.json", good[k], n, NULL, files, &s) != PELL_OK);
            REQUIRE(!s && pell_memory_used(ctx) == 0);
        }
        for (int n = 0; n < (strstr(good[k], "layers\":[{") ? 100 : 1500); n++) { /* a stack is solved in milliseconds */
            memcpy(copy, good[k], size);
            for (int change = 0; change < 1 + n % 3; change++) {
                random ^= random << 13;
                random ^= random >> 7;
                random ^= random << 17;
                copy[random % size] = (char) (random >> 40 & 1 ? random >> 32 : (uint64_t) "0123456789-.,\"{}[]:e"[(random >> 45) % 20]);
            }
            if (load_bytes(ctx, "s.json", copy, size, NULL, files, &s) == PELL_OK)
                pell_scene_destroy(&s);
            REQUIRE(!s && pell_memory_used(ctx) == 0);
        }
    }
    pell_context_destroy(&ctx);
}

/* A complete scene takes camera and lights of another text as if it had been loaded from it; images are kept. */
static void camera_and_lights_are_read_again(void **state)
{
    static const char *const texts[] = {
        "{\"pellucid\": 1, \"mesh\": \"cube.obj\", \"unit\": \"1mm\", \"camera\": {\"from\": [0, 0, 9]}, \"lights\": ["
        "{\"type\": \"point\", \"at\": [1, 2, 3], \"intensity\": 1}, {\"type\": \"environment\", \"color\": [1, 1, 1]}]}",
        "{\"pellucid\": 1, \"mesh\": \"cube.obj\", \"unit\": \"1mm\", \"camera\": {\"from\": [\"3mm\", 1, 7], \"fov_deg\": 33.3}, "
        "\"lights\": ["
        "{\"type\": \"point\", \"at\": [4, \"-5.25mm\", 6], \"intensity\": [3, 2, 1]},"
        "{\"type\": \"environment\", \"color\": [0.5, 0.25, 1], \"rotate_deg\": 30}]}",
    };
    static const char *const wrong[] = {
        "{\"lights\": []}",
        "{\"lights\": [{\"type\": \"environment\", \"color\": [1, 1, 1]}, {\"type\": \"point\", \"at\": [1, 2, 3], \"intensity\": 1}]}",
        "{\"lights\": [{\"studio\": true}, {\"studio\": true}]}",
        "{\"camera\": {\"from\": [0, 0, 0]}}",
        "{\"camera\": {\"to\": [0, 0, 0]}}",
        "[",
    };
    static const char side[] = "{\"camera\": {\"side\": \"right\"}}";
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *a = NULL, *b = NULL;

    (void) state;
    REQUIRE(load_bytes(ctx, "s.json", texts[0], strlen(texts[0]), NULL, files, &a) == PELL_OK);
    REQUIRE(load_bytes(ctx, "s.json", texts[1], strlen(texts[1]), NULL, files, &b) == PELL_OK);
    REQUIRE(pell_scene_hash(a) != pell_scene_hash(b));
    for (int i = 0; i < 3; i++)
        REQUIRE(pell_scene_read_view(a, "s.json", texts[1], strlen(texts[1])) == PELL_OK);
    assert_int_equal(a->num_cameras, b->num_cameras);
    REQUIRE(memcmp(a->cameras[0].position, b->cameras[0].position, sizeof(a->cameras[0].position)) == 0);
    REQUIRE(pell_scene_hash(a) == pell_scene_hash(b));
    REQUIRE(pell_scene_read_view(a, "s.json", side, strlen(side)) == PELL_OK);
    assert_int_equal(a->num_cameras, b->num_cameras);
    REQUIRE(a->cameras[0].position[0] > 0.0f && a->cameras[0].forward[0] < -0.999f);
    for (size_t i = 0; i < PELL_COUNT(wrong); i++)
        REQUIRE(pell_scene_read_view(a, "s.json", wrong[i], strlen(wrong[i])) != PELL_OK);
    pell_scene_destroy(&a);
    pell_scene_destroy(&b);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void every_failed_allocation_is_survived(void **state)
{
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(good); k++) {
        enum pell_result res = PELL_ERR_NOMEM;
        for (uint64_t n = 1; res != PELL_OK; n++) {
            struct pell_alloc_fault fault = { .fail_at = n };
            struct pell_context *ctx = test_context(&fault, NULL);
            struct pell_scene *s = NULL;
            if (!ctx)
                continue;
            res = load_bytes(ctx, "s.json", good[k], strlen(good[k]), NULL, files, &s);
            REQUIRE(res == PELL_OK || (res == PELL_ERR_NOMEM && !s));
            pell_scene_destroy(&s);
            pell_context_destroy(&ctx);
            assert_int_equal(atomic_load(&fault.live), 0);
            REQUIRE(n < 2000);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(meshes_are_placed_in_their_own_units),
        cmocka_unit_test(entries_of_one_object_share_it_and_their_materials),
        cmocka_unit_test(positions_are_in_mesh_units_or_say_their_own),
        cmocka_unit_test(the_command_line_stands_above_the_file),
        cmocka_unit_test(time_is_the_command_lines_then_the_files),
        cmocka_unit_test(lights_are_read),
        cmocka_unit_test(sides_studios_and_backgrounds_are_those_of_the_options),
        cmocka_unit_test(materials_are_overlaid_by_name),
        cmocka_unit_test(materials_that_nothing_defines_are_reported),
        cmocka_unit_test(a_profile_is_a_model_or_a_table),
        cmocka_unit_test(a_radius_means_what_its_kind_says),
        cmocka_unit_test(a_colour_and_a_mean_free_path_make_a_medium),
        cmocka_unit_test(skin_is_made_of_its_composition),
        cmocka_unit_test(other_ways_to_name_a_material_work),
        cmocka_unit_test(pictures_are_looked_up_and_named_when_broken),
        cmocka_unit_test(a_picture_of_a_sequence_is_that_of_the_time),
        cmocka_unit_test(backgrounds_and_options_are_kept),
        cmocka_unit_test(what_is_wrong_is_refused_with_place_value_and_hint),
        cmocka_unit_test(schema_and_reader_know_the_same_keys),
        cmocka_unit_test(a_base_color_texture_is_not_tinted_by_the_preset),
        cmocka_unit_test(schema_and_reader_agree),
        cmocka_unit_test(damaged_files_end_well),
        cmocka_unit_test(camera_and_lights_are_read_again),
        cmocka_unit_test(every_failed_allocation_is_survived),
    };
    return cmocka_run_group_tests_name("scene file", tests, NULL, NULL);
}
