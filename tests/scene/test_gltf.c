/* SPDX-License-Identifier: MIT
 * test_gltf.c - the glTF reader on small documents: geometry, transforms, materials, cameras, lights, and refusals. */
#include "gltf_test.h"

struct fixture {
    struct pell_alloc_fault fault;
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_scene *scene;
    enum pell_result res;
};

static void read_with(struct fixture *f, const struct pell_limits *limits, const char *json, const void *bin, size_t bin_size)
{
    struct pell_context_params params = { .log = keep_message, .log_user = &f->kept, .limits = limits };
    memset(f, 0, sizeof(*f));
    params.allocator = pell_failing_allocator(&f->fault);
    assert_int_equal(pell_context_create(&params, &f->ctx), PELL_OK);
    f->res = import_glb(f->ctx, json, bin, bin_size, &f->scene);
}

static void finish(struct fixture *f)
{
    pell_scene_destroy(&f->scene);
    pell_context_destroy(&f->ctx);
    assert_int_equal(f->fault.live, 0);
}

static void read_ok(struct fixture *f, const char *json, const void *bin, size_t bin_size)
{
    read_with(f, NULL, json, bin, bin_size);
    if (f->res != PELL_OK)
        fail_msg("refused: %s: %s", f->kept.where, f->kept.what);
}

/* A refusal with this code, whose message names this position and contains this text. */
static void refuse_bytes(enum pell_result code, const char *where, const char *what, const char *json, const void *bin, size_t bin_size)
{
    struct fixture f;
    read_with(&f, NULL, json, bin, bin_size);
    if (f.res != code || !strstr(f.kept.where, where) || !strstr(f.kept.what, what))
        fail_msg("got %d, \"%s\", \"%s\"; wanted %d, \"%s\", \"%s\"", f.res, f.kept.where, f.kept.what, code, where, what);
    assert_int_equal(f.kept.errors, 1);
    finish(&f);
}

static void refuse(enum pell_result code, const char *where, const char *what, const char *json)
{
    const struct square square = make_square();
    refuse_bytes(code, where, what, json, &square, sizeof(square));
}

#define HEAD "{\"asset\":{\"version\":\"2.0\"},"
#define ONE_NODE "\"nodes\":[{\"mesh\":0}],"
#define SQUARE HEAD SQUARE_BUFFERS SQUARE_ACCESSORS

static const float *position(const struct fixture *f, size_t mesh, size_t vertex)
{
    return f->scene->meshes[mesh].position + 3 * vertex;
}

static void require_points(const struct fixture *f, size_t mesh, const float *want, size_t count, double tolerance)
{
    for (size_t i = 0; i < 3 * count; i++)
        REQUIRE_NEAR(f->scene->meshes[mesh].position[i], want[i], tolerance);
}

static void require_triangles(const struct fixture *f, size_t mesh, const uint32_t *want, uint32_t count)
{
    assert_int_equal(f->scene->meshes[mesh].num_triangles, count);
    for (uint32_t i = 0; i < 3 * count; i++)
        assert_int_equal(f->scene->meshes[mesh].index[i], want[i]);
}

/* --- Triangles -------------------------------------------------------------------------------------------------------------- */

static void strips_turn_every_second_triangle(void **state)
{
    /* 0 1 2 3, joined by repeated corners to 3 2 1: the degenerate triangles are not drawn */
    static const struct {
        float p[4][3];
        uint16_t index[9];
    } bin = { { { 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 }, { 1, 1, 0 } }, { 0, 1, 2, 3, 3, 3, 3, 2, 1 } };
    static const char json[] =
        HEAD ONE_NODE "\"buffers\":[{\"byteLength\":66}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48},{\"buffer\":0,\"byteOffset\":48,"
                      "\"byteLength\":18}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"},"
                      "{\"bufferView\":1,\"componentType\":5123,\"count\":9,\"type\":\"SCALAR\"}],"
                      "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,\"mode\":5}]}]}";
    /* triangle 6 of the strip (even) is 3 2 1 */
    static const uint32_t want[] = { 0, 1, 2, 1, 3, 2, 3, 2, 1 };
    struct fixture f;
    (void) state;
    read_ok(&f, json, &bin, 66);
    require_triangles(&f, 0, want, 3);
    finish(&f);
}

static void fans_and_lists_without_indices_are_drawn(void **state)
{
    const struct square square = make_square();
    static const uint32_t grid[] = { 1, 2, 0, 2, 3, 0 }, strip[] = { 0, 1, 2, 1, 3, 2 }, list[] = { 0, 1, 2 };
    struct fixture f;
    (void) state;
    read_ok(&f,
            SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":6},"
                            "{\"attributes\":{\"POSITION\":0},\"mode\":5},{\"attributes\":{\"POSITION\":0}}]}]}",
            &square, sizeof(square));
    assert_int_equal(f.scene->num_meshes, 3);
    require_triangles(&f, 0, grid, 2);
    require_triangles(&f, 1, strip, 2);
    require_triangles(&f, 2, list, 1); /* four corners: the last is dropped, with a warning */
    assert_int_equal(f.kept.warnings, 1);
    REQUIRE(f.scene->meshes[0].object == f.scene->meshes[2].object);
    assert_int_equal(f.scene->meshes[0].material, -1);
    finish(&f);
}

static void points_and_lines_are_skipped_with_a_warning(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    (void) state;
    read_ok(&f,
            SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":0},"
                            "{\"attributes\":{\"POSITION\":0},\"mode\":3},{\"attributes\":{\"NORMAL\":1}},"
                            "{\"attributes\":{\"POSITION\":0},\"indices\":5}]}]}",
            &square, sizeof(square));
    assert_int_equal(f.scene->num_meshes, 1);
    assert_int_equal(f.kept.warnings, 3);
    finish(&f);
}

/* --- Accessors -------------------------------------------------------------------------------------------------------------- */

/* KHR_mesh_quantization: i8 normalised, i16 plain, u16 normalised, with a stride of 8 and odd alignment. */
static void quantised_positions_keep_their_scale(void **state)
{
    static const uint8_t bin[1 + 3 * 8] = { 99, /* offset 1: nothing is aligned */
                                            127, 0x80, 64, 0, 0, 0, 0, 0, 0x81, 0, 127, 0, 0, 0, 0, 0, 0xff, 1, 2, 0, 0, 0, 0, 0 };
    static const char json[] =
        HEAD "\"extensionsRequired\":[\"KHR_mesh_quantization\"]," ONE_NODE
             "\"buffers\":[{\"byteLength\":25}],\"bufferViews\":[{\"buffer\":0,\"byteOffset\":1,\"byteLength\":24,\"byteStride\":8}],"
             "\"accessors\":[{\"bufferView\":0,\"componentType\":5120,\"normalized\":true,\"count\":3,\"type\":\"VEC3\"},"
             "{\"bufferView\":0,\"componentType\":5120,\"count\":3,\"type\":\"VEC3\"},"
             "{\"bufferView\":0,\"componentType\":5121,\"normalized\":true,\"count\":3,\"type\":\"VEC3\"},"
             "{\"bufferView\":0,\"componentType\":5122,\"normalized\":true,\"count\":3,\"type\":\"VEC3\"},"
             "{\"bufferView\":0,\"componentType\":5123,\"count\":3,\"type\":\"VEC3\"}],"
             "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}},{\"attributes\":{\"POSITION\":1}},{\"attributes\":{"
             "\"POSITION\":2}},"
             "{\"attributes\":{\"POSITION\":3}},{\"attributes\":{\"POSITION\":4}}]}]}";
    static const float i8n[] = { 1, -1, 64 / 127.0f, -1, 0, 1, -1 / 127.0f, 1 / 127.0f, 2 / 127.0f };
    static const float i8[] = { 127, -128, 64, -127, 0, 127, -1, 1, 2 };
    static const float u8n[] = { 127 / 255.0f, 128 / 255.0f, 64 / 255.0f, 129 / 255.0f, 0, 127 / 255.0f, 1, 1 / 255.0f, 2 / 255.0f };
    static const float i16n[] = {
        (0x807f - 0x10000) / 32767.0f, 64 / 32767.0f, 0, 129 / 32767.0f, 127 / 32767.0f, 0, 511 / 32767.0f, 2 / 32767.0f, 0
    };
    static const float u16[] = { 0x807f, 64, 0, 129, 127, 0, 511, 2, 0 };
    struct fixture f;
    (void) state;
    read_ok(&f, json, bin, sizeof(bin));
    require_points(&f, 0, i8n, 3, 1e-7);
    require_points(&f, 1, i8, 3, 0);
    require_points(&f, 2, u8n, 3, 1e-7);
    require_points(&f, 3, i16n, 3, 1e-7);
    require_points(&f, 4, u16, 3, 0);
    finish(&f);
}

static void sparse_values_replace_and_stand_alone(void **state)
{
    const struct square square = make_square();
    static const float mixed[] = { 0, 0, 0, 1, 0, 0, 1, 1, 7, 0, 1, 0 }, alone[] = { 0, 0, 0, 0, 0, 0, 1, 1, 7, 0, 0, 0 };
    struct fixture f;
    (void) state;
    read_ok(&f,
            HEAD SQUARE_BUFFERS ONE_NODE
            "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\",\"sparse\":{\"count\":1,"
            "\"indices\":{\"bufferView\":6,\"componentType\":5123},\"values\":{\"bufferView\":7}}},"
            "{\"componentType\":5126,\"count\":4,\"type\":\"VEC3\",\"sparse\":{\"count\":1,"
            "\"indices\":{\"bufferView\":6,\"componentType\":5121},\"values\":{\"bufferView\":7}}}],"
            "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":6},{\"attributes\":{\"POSITION\":1},\"mode\":6}]}]}",
            &square, sizeof(square));
    require_points(&f, 0, mixed, 4, 0);
    require_points(&f, 1, alone, 4, 0);
    finish(&f);
}

static void vertex_colours_of_all_types_become_rgba(void **state)
{
    static const struct {
        float p[3][3];
        uint8_t rgba[3][4];
        uint16_t rgb[3][4];
    } bin = { { { 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 } },
              { { 255, 51, 0, 102 }, { 0, 0, 0, 0 }, { 1, 2, 3, 4 } },
              { { 65535, 13107, 0, 9 }, { 0, 0, 0, 9 }, { 1, 2, 3, 9 } } };
    struct fixture f;
    (void) state;
    read_ok(&f,
            HEAD ONE_NODE
            "\"buffers\":[{\"byteLength\":72}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},{\"buffer\":0,\"byteOffset\":36,"
            "\"byteLength\":12},"
            "{\"buffer\":0,\"byteOffset\":48,\"byteLength\":24,\"byteStride\":8}],"
            "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},"
            "{\"bufferView\":1,\"componentType\":5121,\"normalized\":true,\"count\":3,\"type\":\"VEC4\"},"
            "{\"bufferView\":2,\"componentType\":5123,\"normalized\":true,\"count\":3,\"type\":\"VEC3\"}],"
            "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"COLOR_0\":1}},{\"attributes\":{\"POSITION\":0,\"COLOR_0\":2}},"
            "{\"attributes\":{\"POSITION\":0,\"COLOR_0\":0}}]}]}",
            &bin, sizeof(bin));
    REQUIRE_NEAR(f.scene->meshes[0].color[1], 0.2, 1e-7);
    REQUIRE_NEAR(f.scene->meshes[0].color[3], 0.4, 1e-7);
    REQUIRE_NEAR(f.scene->meshes[0].color[8], 1 / 255.0, 1e-9);
    for (int i = 0; i < 3; i++)
        REQUIRE(f.scene->meshes[1].color[4 * i + 3] == 1.0f && f.scene->meshes[2].color[4 * i + 3] == 1.0f);
    REQUIRE_NEAR(f.scene->meshes[1].color[1], 0.2, 1e-7);
    REQUIRE_NEAR(f.scene->meshes[1].color[10], 3 / 65535.0, 1e-9);
    REQUIRE(f.scene->meshes[2].color[4] == 1.0f && f.scene->meshes[2].color[9] == 1.0f);
    finish(&f);
}

static void indices_of_one_and_four_bytes_are_read(void **state)
{
    static const struct {
        float p[3][3];
        uint32_t i32[3];
        uint8_t i8[4];
    } bin = { { { 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 } }, { 2, 0, 1 }, { 1, 2, 0, 0 } };
    static const uint32_t four[] = { 2, 0, 1 }, one[] = { 1, 2, 0 };
    struct fixture f;
    (void) state;
    read_ok(
        &f,
        HEAD ONE_NODE
        "\"buffers\":[{\"byteLength\":52}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},{\"buffer\":0,\"byteOffset\":36,"
        "\"byteLength\":16}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},"
        "{\"bufferView\":1,\"componentType\":5125,\"count\":3,\"type\":\"SCALAR\"},"
        "{\"bufferView\":1,\"byteOffset\":12,\"componentType\":5121,\"count\":3,\"type\":\"SCALAR\"}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1},{\"attributes\":{\"POSITION\":0},\"indices\":2}]}]}",
        &bin, sizeof(bin));
    require_triangles(&f, 0, four, 1);
    require_triangles(&f, 1, one, 1);
    finish(&f);
}

static void base64_is_read_with_and_without_padding(void **state)
{
    /* three points: 36 bytes; "AAAA" is three zero bytes; the last float is 1 = 00 00 80 3f */
    static const char *const tails[] = { "AACAPw==", "AACAPw" };
    struct fixture f;
    char json[700];
    (void) state;
    for (size_t i = 0; i < 2; i++) {
        /* 36 bytes = 12 * "AAAA"; with a 37th byte the tail needs padding: 11 * 3 = 33, then 00 00 80 3f */
        snprintf(json, sizeof(json),
                 HEAD ONE_NODE "\"buffers\":[{\"byteLength\":37,\"uri\":\"data:;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA%s\"}],"
                               "\"bufferViews\":[{\"buffer\":0,\"byteOffset\":1,\"byteLength\":36}],"
                               "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],"
                               "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
                 tails[i]);
        read_ok(&f, json, NULL, 0);
        REQUIRE(position(&f, 0, 2)[2] == 1.0f && position(&f, 0, 2)[1] == 0.0f);
        finish(&f);
    }
}

static void data_uris_without_base64_are_percent_decoded(void **state)
{
    struct fixture f;
    (void) state;
    read_ok(&f,
            HEAD ONE_NODE "\"buffers\":[{\"byteLength\":36,\"uri\":\"data:application/octet-stream,"
                          "%00%00%80%3f%00%00%00%00%00%00%00%00%00%00%80%3F%00%00%00%00%00%00%00%00%00%00%80?%00%00%00%00%00%00%00%00\"}],"
                          "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],"
                          "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],"
                          "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
            NULL, 0);
    REQUIRE(position(&f, 0, 0)[0] == 1.0f && position(&f, 0, 1)[0] == 1.0f && position(&f, 0, 2)[0] == 1.0f);
    finish(&f);
}

/* --- Nodes ------------------------------------------------------------------------------------------------------------------ */

/* Half a turn about z, a mirror in x, and a translation: (x, y, z) -> (-2x, y, z) -> (2x, -y, z) -> + (1, 2, 3). */
static void mirrors_turn_triangles_normals_and_tangents(void **state)
{
    const struct square square = make_square();
    static const float want[] = { 1, 2, 3, 3, 2, 3, 3, 1, 3, 1, 1, 3 };
    static const uint32_t turned[] = { 0, 2, 1, 0, 3, 2 };
    struct fixture f;
    (void) state;
    read_ok(&f,
            SQUARE "\"nodes\":[{\"mesh\":0,\"scale\":[-2,1,1],\"rotation\":[0,0,1,0],\"translation\":[1,2,3]}],"
                   "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,\"TANGENT\":2},\"indices\":5}]}]}",
            &square, sizeof(square));
    require_points(&f, 0, want, 4, 1e-6);
    require_triangles(&f, 0, turned, 2);
    for (int i = 0; i < 4; i++) {
        REQUIRE_NEAR(f.scene->meshes[0].normal[3 * i + 2], 1.0, 1e-6);
        REQUIRE_NEAR(f.scene->meshes[0].tangent[4 * i], 1.0, 1e-6);
        REQUIRE(f.scene->meshes[0].tangent[4 * i + 3] == -1.0f);
    }
    finish(&f);
}

static void matrices_nest_and_normals_follow_the_inverse_transpose(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    const float *n;
    (void) state;
    /* a shear, z' = z + x, below a stretch of x by 2: the plane z = x / 2, normal (-1, 0, 2) / sqrt 5 */
    read_ok(&f,
            SQUARE "\"nodes\":[{\"scale\":[2,1,1],\"children\":[1]},{\"matrix\":[1,0,1,0,0,1,0,0,0,0,1,0,0,0,0,1],\"mesh\":0}],"
                   "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1},\"indices\":5}]}]}",
            &square, sizeof(square));
    n = f.scene->meshes[0].normal;
    REQUIRE_NEAR(position(&f, 0, 2)[0], 2.0, 1e-6);
    REQUIRE_NEAR(position(&f, 0, 2)[2], 1.0, 1e-6);
    REQUIRE_NEAR(n[0], -1 / sqrt(5), 1e-6);
    REQUIRE_NEAR(n[2], 2 / sqrt(5), 1e-6);
    finish(&f);
}

static void instances_are_placed_each(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    (void) state;
    read_ok(&f,
            SQUARE "\"nodes\":[{\"name\":\"grass\",\"mesh\":0,\"translation\":[0,5,0],\"extensions\":{\"EXT_mesh_gpu_instancing\":"
                   "{\"attributes\":{\"TRANSLATION\":7}}}}],\"extensionsRequired\":[\"EXT_mesh_gpu_instancing\"],"
                   "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5}]}]}",
            &square, sizeof(square));
    assert_int_equal(f.scene->num_meshes, 2);
    REQUIRE(position(&f, 0, 0)[0] == 10.0f && position(&f, 1, 0)[0] == 20.0f && position(&f, 1, 0)[1] == 5.0f);
    REQUIRE(f.scene->meshes[0].object != f.scene->meshes[1].object);
    assert_string_equal(f.scene->meshes[1].name, "grass");
    finish(&f);
}

static void hidden_nodes_and_flattened_ones_draw_nothing(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    (void) state;
    read_ok(&f,
            SQUARE "\"nodes\":[{\"mesh\":0,\"scale\":[0,0,0]},{\"mesh\":0,\"scale\":[1,0,0]},{\"mesh\":0,\"scale\":[1,1,0]},"
                   "{\"extensions\":{\"KHR_node_visibility\":{\"visible\":false}},\"children\":[4]},{\"mesh\":0}],"
                   "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1},\"indices\":5}]}]}",
            &square, sizeof(square));
    assert_int_equal(f.scene->num_meshes, 1); /* flat in z alone */
    REQUIRE_NEAR(f.scene->meshes[0].normal[2], 1.0, 1e-6);
    finish(&f);
}

static void empty_default_scene_gives_way_to_one_with_a_mesh(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    (void) state;
    read_ok(&f,
            SQUARE "\"scene\":1,\"scenes\":[{\"nodes\":[0]},{\"name\":\"aux\",\"nodes\":[1]},{\"nodes\":[0,1]}],"
                   "\"nodes\":[{\"mesh\":0},{\"name\":\"empty\"}],"
                   "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5}]}]}",
            &square, sizeof(square));
    assert_int_equal(f.scene->num_meshes, 1);
    assert_int_equal(f.kept.warnings, 1);
    REQUIRE(strstr(f.kept.last_warning, "scene 0"));
    finish(&f);
}

static void bad_hierarchies_are_refused(void **state)
{
    (void) state;
    refuse(PELL_ERR_FORMAT, "/nodes/0", "its own ancestor", HEAD "\"nodes\":[{\"children\":[1]},{\"children\":[0]}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/0", "its own ancestor", HEAD "\"nodes\":[{\"children\":[0]}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/1/children/0", "one parent", HEAD "\"nodes\":[{\"children\":[2]},{\"children\":[2]},{}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/0/children/0", "allowed: 0", HEAD "\"nodes\":[{\"children\":[1]}]}");
    refuse(PELL_ERR_FORMAT, "/scenes/0/nodes/1", "without a parent",
           HEAD "\"nodes\":[{\"children\":[1]},{}],\"scenes\":[{\"nodes\":[0,1]}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/0", "twice", HEAD "\"nodes\":[{}, {}],\"scenes\":[{\"nodes\":[0,0]}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/0/rotation", "length 0", HEAD "\"nodes\":[{\"rotation\":[0,0,0,0]}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/0/matrix", "last row", HEAD "\"nodes\":[{\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,2]}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/0/matrix", "16 numbers", HEAD "\"nodes\":[{\"matrix\":[1,0,0]}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/0/scale/1", "a number", HEAD "\"nodes\":[{\"scale\":[1,\"2\",3]}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/0/mesh", "the file has no meshes", HEAD "\"nodes\":[{\"mesh\":0}]}");
}

static void deep_and_wide_hierarchies_are_limited(void **state)
{
    enum { N = 400 };
    static char json[N * 24 + 200];
    struct pell_limits limits;
    struct fixture f;
    size_t n = 0;
    (void) state;
    n += (size_t) snprintf(json, sizeof(json), HEAD "\"nodes\":[");
    for (int i = 0; i + 1 < N; i++)
        n += (size_t) snprintf(json + n, sizeof(json) - n, "{\"children\":[%d]},", i + 1);
    snprintf(json + n, sizeof(json) - n, "{}]}");
    refuse(PELL_ERR_UNSUPPORTED, "/nodes/255", "deeper than 256", json);

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.nodes = 3;
    read_with(&f, &limits, HEAD "\"nodes\":[{},{},{},{}]}", NULL, 0);
    assert_int_equal(f.res, PELL_ERR_FORMAT);
    REQUIRE(strstr(f.kept.where, "/nodes") && strstr(f.kept.what, "allowed: 0 to 3"));
    finish(&f);
}

/* --- Cameras and lights ----------------------------------------------------------------------------------------------------- */

static void cameras_and_lights_look_along_minus_z_of_their_nodes(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    const struct pell_light *l;
    const struct pell_camera *c;
    (void) state;
    read_ok(&f, RICH_JSON, &square, sizeof(square));
    assert_int_equal(f.scene->num_cameras, 2);
    assert_int_equal(f.scene->num_lights, 2);
    /* under "top", a quarter turn about y: -z goes to -x; the position is top's */
    c = &f.scene->cameras[0];
    assert_string_equal(c->name, "front");
    REQUIRE_NEAR(c->forward[0], -1.0, 1e-6);
    REQUIRE_NEAR(c->up[1], 1.0, 1e-6);
    REQUIRE_NEAR(c->position[2], 3.0, 1e-6);
    REQUIRE_NEAR(c->fov, 0.5, 1e-6);
    REQUIRE(c->ortho_height == 0.0f);
    REQUIRE_NEAR(f.scene->cameras[1].ortho_height, 4.0, 1e-6);
    REQUIRE_NEAR(f.scene->cameras[1].forward[2], -1.0, 1e-6);
    l = &f.scene->lights[0];
    REQUIRE(l->type == PELL_LIGHT_SPOT);
    REQUIRE_NEAR(l->direction[0], -1.0, 1e-6);
    REQUIRE_NEAR(l->power[0], 8.0, 1e-6);
    REQUIRE_NEAR(l->power[2], 2.0, 1e-6);
    REQUIRE_NEAR(l->cos_inner, cos(0.2), 1e-6);
    REQUIRE_NEAR(l->cos_outer, cos(0.4), 1e-6);
    REQUIRE_NEAR(l->range, 4.0, 1e-6);
    l = &f.scene->lights[1];
    REQUIRE(l->type == PELL_LIGHT_DIRECTIONAL && l->direction[2] == -1.0f && l->power[1] == 3.0f);
    finish(&f);
}

static void wrong_cameras_and_lights_are_refused(void **state)
{
    (void) state;
    refuse(PELL_ERR_FORMAT, "/cameras/0/perspective/yfov", "allowed: [0.0001, 3.14]",
           HEAD "\"nodes\":[{\"camera\":0}],\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":0}}]}");
    refuse(PELL_ERR_FORMAT, "/cameras/0/type", "perspective, orthographic",
           HEAD "\"nodes\":[{\"camera\":0}],\"cameras\":[{\"type\":\"perspektive\"}]}");
    refuse(PELL_ERR_FORMAT, "/lights/0/intensity", "is -1",
           HEAD "\"nodes\":[{\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}}],\"extensions\":{\"KHR_lights_punctual\":{\"lights\":"
                "[{\"type\":\"point\",\"intensity\":-1}]}}}");
    refuse(PELL_ERR_FORMAT, "/KHR_lights_punctual/light", "has no lights",
           HEAD "\"nodes\":[{\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}}]}");
}

/* --- Materials -------------------------------------------------------------------------------------------------------------- */

static void every_field_of_a_material_arrives(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    const struct pell_material *m;
    double sigma_t, ss, albedo;
    (void) state;
    read_ok(&f, RICH_JSON, &square, sizeof(square));
    m = &f.scene->materials[0];
    assert_string_equal(m->name, "wax");
    REQUIRE_NEAR(m->base_color[1], 0.6, 1e-7);
    REQUIRE_NEAR(m->base_color[3], 0.8, 1e-7);
    REQUIRE_NEAR(m->metallic, 0.1, 1e-7);
    REQUIRE_NEAR(m->roughness, 0.2, 1e-7);
    REQUIRE_NEAR(m->normal_scale, 0.5, 1e-7);
    REQUIRE_NEAR(m->emissive[1], 2.0, 1e-6);
    REQUIRE(m->alpha_mask && m->double_sided && m->specular == PELL_SPECULAR_GGX);
    REQUIRE_NEAR(m->alpha_cutoff, 0.25, 1e-7);
    REQUIRE_NEAR(m->rho_s, 0.7, 1e-7);
    REQUIRE_NEAR(m->specular_color[2], 0.8, 1e-7);
    REQUIRE_NEAR(m->medium.eta, 1.4, 1e-12);

    /* maps: channels, roles, samplers, the transform and its own texCoord */
    REQUIRE(m->metallic_map.channel == 2 && m->roughness_map.channel == 1 && m->rho_s_map.channel == 3);
    REQUIRE(m->base_color_map.texture->image.srgb && !m->roughness_map.texture->image.srgb);
    REQUIRE(m->base_color_map.texture->wrap_u == PELL_WRAP_CLAMP && m->base_color_map.texture->wrap_v == PELL_WRAP_MIRROR);
    REQUIRE(m->base_color_map.texture->nearest && !m->emissive_map.texture->nearest);
    REQUIRE(m->emissive_map.texture->wrap_u == PELL_WRAP_REPEAT && m->emissive_map.texture->image.srgb);
    assert_int_equal(m->base_color_map.uv, 0);
    REQUIRE_NEAR(m->base_color_map.matrix[0], 2 * cos(0.3), 1e-6);
    REQUIRE_NEAR(m->base_color_map.matrix[1], 3 * sin(0.3), 1e-6);
    REQUIRE_NEAR(m->base_color_map.matrix[3], -2 * sin(0.3), 1e-6);
    REQUIRE_NEAR(m->base_color_map.matrix[5], 0.5, 1e-6);
    REQUIRE(m->normal_map.matrix[0] == 1.0f && m->normal_map.matrix[1] == 0.0f);

    /* the medium, green: sigma_t = ln 4 / 1 mm */
    sigma_t = log(4.0) / 0.001;
    ss = 1.0 - pow(4.09712 + 4.20863 * 0.6 - sqrt(9.59217 + 41.6808 * 0.6 + 17.7126 * 0.36), 2);
    albedo = ss / (1.0 - 0.2 * (1.0 - ss));
    REQUIRE(!m->opaque && m->color_from == PELL_COLOR_FROM_TEXTURE);
    REQUIRE_REL(m->medium.sigma_a[1], (1.0 - albedo) * sigma_t, 1e-6);
    REQUIRE_REL(m->medium.sigma_s_reduced[1], 0.8 * albedo * sigma_t, 1e-6);
    REQUIRE_NEAR(m->medium.g[1], 0.2, 1e-12);

    m = &f.scene->materials[1];
    /* no volume: a sheet */
    REQUIRE(m->opaque && m->diffuse_transmission == 0.6f && m->metallic == 1.0f && m->roughness == 1.0f);
    REQUIRE(m->diffuse_transmission_color[0] == 0.9f && m->diffuse_transmission_color[2] == 0.7f);
    finish(&f);
}

/* clear glass; a volume alone; scattering of zero; scattering without a distance; scattering alone */
static const char interiors[] = SQUARE ONE_NODE
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5,\"material\":0},{\"attributes\":{\"POSITION\":0},"
    "\"indices\":5,"
    "\"material\":1},{\"attributes\":{\"POSITION\":0},\"indices\":5,\"material\":2},{\"attributes\":{\"POSITION\":0},\"indices\":5,"
    "\"material\":3},"
    "{\"attributes\":{\"POSITION\":0},\"indices\":5,\"material\":4}]}],"
    "\"materials\":[{\"extensions\":{\"KHR_materials_transmission\":{\"transmissionFactor\":1},\"KHR_materials_volume\":{"
    "\"attenuationDistance\":1,"
    "\"attenuationColor\":[0.5,0.5,0.5]}}},"
    "{\"extensions\":{\"KHR_materials_volume\":{\"attenuationDistance\":1,\"attenuationColor\":[0.5,0.5,0.5]}}},"
    "{\"extensions\":{\"KHR_materials_diffuse_transmission\":{},\"KHR_materials_volume\":{\"attenuationDistance\":1},"
    "\"KHR_materials_volume_scatter\":{\"multiscatterColor\":[0.5,0.5,0.5]}}},"
    "{\"extensions\":{\"KHR_materials_diffuse_transmission\":{\"diffuseTransmissionFactor\":1},\"KHR_materials_volume_scatter\":"
    "{\"multiscatterColor\":[0.5,0.5,0.5]}}},"
    "{\"extensions\":{\"KHR_materials_volume\":{\"attenuationDistance\":0.01,\"attenuationColor\":[0.5,1,0]},\"KHR_materials_scatter\":"
    "{\"multiscatterColor\":[1,0,0.5]}}}]}";

static void translucency_needs_a_way_in(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    const struct pell_material *m;
    (void) state;
    read_ok(&f, interiors, &square, sizeof(square));
    m = f.scene->materials;
    REQUIRE(m[0].opaque && m[1].opaque && m[2].opaque && !m[3].opaque && !m[4].opaque);
    REQUIRE_REL(m[3].medium.sigma_a[0] + m[3].medium.sigma_s_reduced[0], 2192.1, 1e-9);
    for (int c = 0; c < 3; c++) /* colours of 0 and 1 stay in range */
        REQUIRE(m[4].medium.sigma_a[c] > 0.0 && m[4].medium.sigma_s_reduced[c] >= 0.0 && isfinite(m[4].medium.sigma_a[c]));
    finish(&f);
}

static void blend_is_a_mask_and_others_are_named(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    (void) state;
    read_ok(&f,
            SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5,\"material\":0}]}],"
                            "\"materials\":[{\"alphaMode\":\"BLEND\",\"alphaCutoff\":0.1}]}",
            &square, sizeof(square));
    REQUIRE(f.scene->materials[0].alpha_mask && f.scene->materials[0].alpha_cutoff == 0.5f);
    REQUIRE(strstr(f.kept.last_warning, "BLEND"));
    finish(&f);
    read_ok(&f,
            SQUARE ONE_NODE
            "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5,\"material\":0},"
            "{\"attributes\":{\"POSITION\":0},\"indices\":5,\"material\":1}]}],\"extensionsRequired\":[\"KHR_materials_unlit\"],"
            "\"materials\":[{\"extensions\":{\"KHR_materials_unlit\":{}}},{\"extensions\":{\"KHR_materials_unlit\":{}}}]}",
            &square, sizeof(square));
    assert_int_equal(f.kept.warnings, 1);
    REQUIRE(strstr(f.kept.last_warning, "KHR_materials_unlit"));
    finish(&f);
}

static void factors_out_of_range_are_cut_with_a_warning(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    (void) state;
    read_ok(&f,
            SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5,\"material\":0}]}],"
                            "\"materials\":[{\"pbrMetallicRoughness\":{\"roughnessFactor\":1.5,\"baseColorFactor\":[-1,0,2,1]}}]}",
            &square, sizeof(square));
    REQUIRE(f.scene->materials[0].roughness == 1.0f && f.scene->materials[0].base_color[0] == 0.0f &&
            f.scene->materials[0].base_color[2] == 1.0f);
    assert_int_equal(f.kept.warnings, 3);
    finish(&f);
}

static void broken_pictures_are_warnings_that_name_them(void **state)
{
    /* clang-format off */
    static const char *const images[] = {
        "{\"uri\":\"data:image/png;base64,%%%\"}",  "{\"uri\":\"data:image/png;base64,AAAA\"}", "{\"uri\":\"absent.png\"}",
        "{\"uri\":\"http://example.com/a.png\"}",   "{\"uri\":\"\"}",                             "{\"uri\":\"%00\"}",
        "{\"uri\":\"../../../../etc/passwd\"}",     "{\"bufferView\":0,\"mimeType\":\"image/png\"}", "{}",
    };
    /* clang-format on */
    const struct square square = make_square();
    struct fixture f;
    char json[4096];
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(images); i++) {
        snprintf(json, sizeof(json),
                 SQUARE ONE_NODE
                 "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":3},\"indices\":5,\"material\":0}]}],"
                 "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0}}}],"
                 "\"textures\":[{\"source\":0}],\"images\":[%s]}",
                 images[i]);
        read_ok(&f, json, &square, sizeof(square));
        REQUIRE(f.kept.warnings > 0 && f.kept.errors == 0);
        REQUIRE(strstr(f.kept.last_warning, "/images/0"));
        assert_null(f.scene->materials[0].base_color_map.texture);
        finish(&f);
    }
}

/* --- What is refused -------------------------------------------------------------------------------------------------------- */

#define MESH "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],"

static void accessors_outside_their_bytes_are_refused(void **state)
{
    static const struct {
        const char *views, *accessor, *where, *what;
    } rows[] = {
        { "{\"buffer\":0,\"byteLength\":48}", "\"count\":5", "/accessors/0", "need 60 bytes, but the buffer view has 48" },
        { "{\"buffer\":0,\"byteLength\":48}", "\"count\":4,\"byteOffset\":1", "/accessors/0", "need 49 bytes" },
        { "{\"buffer\":0,\"byteLength\":48,\"byteStride\":16}", "\"count\":4", "/accessors/0", "need 60 bytes" },
        { "{\"buffer\":0,\"byteOffset\":240,\"byteLength\":48}", "\"count\":3", "/bufferViews/0", "passes the end of buffer 0" },
        { "{\"buffer\":0,\"byteLength\":9007199254740993}", "\"count\":3", "/bufferViews/0/byteLength", "allowed" },
        { "{\"buffer\":0,\"byteOffset\":1e18,\"byteLength\":48}", "\"count\":3", "/bufferViews/0/byteOffset", "allowed" },
        { "{\"buffer\":0,\"byteOffset\":-1,\"byteLength\":48}", "\"count\":3", "/bufferViews/0/byteOffset", "is -1" },
        { "{\"buffer\":1,\"byteLength\":48}", "\"count\":3", "/bufferViews/0/buffer", "allowed: [0, 0]" },
        { "{\"buffer\":0,\"byteLength\":48,\"byteStride\":3}", "\"count\":3", "/bufferViews/0/byteStride", "allowed: [4, 252]" },
        { "{\"buffer\":0,\"byteLength\":48,\"byteStride\":8}", "\"count\":3", "/accessors/0", "stride of 8 is below the 12 bytes" },
        { "{\"buffer\":0,\"byteLength\":48}", "\"count\":9007199254740993", "/accessors/0/count", "allowed: [1, " },
        { "{\"buffer\":0,\"byteLength\":48}", "\"count\":0", "/accessors/0/count", "is 0" },
        { "{\"buffer\":0,\"byteLength\":48}", "\"count\":-3", "/accessors/0/count", "is -3" },
        { "{\"buffer\":0,\"byteLength\":48}",
          "\"count\":3,\"sparse\":{\"count\":4,\"indices\":{\"bufferView\":0,\"componentType\":5121},"
          "\"values\":{\"bufferView\":0}}",
          "/accessors/0/sparse/count", "allowed: [1, 3]" },
        { "{\"buffer\":0,\"byteLength\":48},{\"buffer\":0,\"byteOffset\":8,\"byteLength\":8}",
          "\"count\":3,\"sparse\":{\"count\":1,\"indices\":"
          "{\"bufferView\":1,\"byteOffset\":6,\"componentType\":5125},\"values\":{\"bufferView\":0}}",
          "/sparse/indices", "need 10 bytes" },
        { "{\"buffer\":0,\"byteLength\":48}",
          "\"count\":3,\"sparse\":{\"count\":1,\"indices\":{\"bufferView\":0,\"byteOffset\":14,\"componentType\":5121},"
          "\"values\":{\"bufferView\":0}}",
          "/accessors/0", "sparse index 0 is 128, allowed: [0, 2]" },
        { "{\"buffer\":0,\"byteLength\":48}",
          "\"count\":3,\"sparse\":{\"count\":2,\"indices\":{\"bufferView\":0,\"componentType\":5121},"
          "\"values\":{\"bufferView\":0}}",
          "/accessors/0", "sparse index 1 is 0 after 0; they must increase" },
        { "{\"buffer\":0,\"byteLength\":48}",
          "\"count\":3,\"sparse\":{\"count\":1,\"indices\":{\"bufferView\":0,\"componentType\":5126},"
          "\"values\":{\"bufferView\":0}}",
          "/sparse/indices/componentType", "allowed: 5121" },
    };
    char json[2048];
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(rows); i++) {
        snprintf(json, sizeof(json),
                 HEAD ONE_NODE MESH
                 "\"buffers\":[{\"byteLength\":260}],\"bufferViews\":[%s],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,"
                 "\"type\":\"VEC3\",%s}]}",
                 rows[i].views, rows[i].accessor);
        refuse(PELL_ERR_FORMAT, rows[i].where, rows[i].what, json);
    }
}

static void wrong_attributes_are_refused(void **state)
{
    (void) state;
    refuse(PELL_ERR_FORMAT, "/attributes/NORMAL", "2 elements, allowed: 4",
           SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":7}}]}]}");
    refuse(PELL_ERR_FORMAT, "/attributes/POSITION", "2 components, allowed: 3",
           SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":3}}]}]}");
    refuse(PELL_ERR_FORMAT, "/primitives/0/indices", "allowed: SCALAR",
           SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":0}]}]}");
    refuse(PELL_ERR_FORMAT, "/attributes/POSITION", "is 99, allowed: [0, 7]",
           SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":99}}]}]}");
    refuse(PELL_ERR_FORMAT, "/primitives/0/mode", "allowed: [0, 6]",
           SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":7}]}]}");
    refuse(PELL_ERR_FORMAT, "/meshes/0", "has no \"primitives\"", SQUARE ONE_NODE "\"meshes\":[{}]}");
    refuse(PELL_ERR_FORMAT, "/attributes/POSITION", "neither bufferView nor sparse",
           HEAD ONE_NODE MESH "\"accessors\":[{\"componentType\":5126,\"count\":100000000,\"type\":\"VEC3\"}]}");
    refuse(PELL_ERR_FORMAT, "/accessors/0/componentType", "is 5124",
           HEAD ONE_NODE MESH "\"accessors\":[{\"componentType\":5124,\"count\":3,\"type\":\"VEC3\"}]}");
    refuse(PELL_ERR_FORMAT, "/accessors/0", "type is MAT3",
           HEAD ONE_NODE MESH "\"accessors\":[{\"componentType\":5126,\"count\":3,\"type\":\"MAT3\"}]}");
    refuse(PELL_ERR_FORMAT, "/attributes/POSITION", "16 components",
           HEAD ONE_NODE MESH "\"accessors\":[{\"componentType\":5126,\"count\":3,\"type\":\"MAT4\"}]}");
    refuse(PELL_ERR_FORMAT, "/attributes/POSITION", "component type 5125",
           HEAD ONE_NODE MESH "\"accessors\":[{\"componentType\":5125,\"count\":3,\"type\":\"VEC3\"}]}");
}

static void indices_past_the_vertices_are_refused(void **state)
{
    struct square square = make_square();
    static const char *const modes[] = { "4", "5" };
    char json[4096];
    (void) state;
    square.index[4] = 4;
    for (int i = 0; i < 2; i++) {
        snprintf(json, sizeof(json),
                 SQUARE ONE_NODE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5,\"mode\":%s}]}]}", modes[i]);
        refuse_bytes(PELL_ERR_FORMAT, "/meshes/0/primitives/0/indices", "index 4 is 4, allowed: [0, 3]", json, &square, sizeof(square));
    }
}

static void values_that_are_not_finite_are_refused_or_mended(void **state)
{
    static const char json[] = SQUARE ONE_NODE
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,\"TANGENT\":2,\"TEXCOORD_0\":3},\"indices\":5}]}]}";
    struct square square = make_square();
    struct fixture f;
    (void) state;
    square.position[2][1] = NAN;
    refuse_bytes(PELL_ERR_FORMAT, "/meshes/0/primitives/0", "POSITION 2 has y = ", json, &square, sizeof(square));
    square = make_square();
    square.position[2][1] = 3e38f;
    refuse_bytes(PELL_ERR_FORMAT, "/meshes/0/primitives/0", "POSITION 2 has y = inf",
                 SQUARE "\"nodes\":[{\"mesh\":0,\"scale\":[10,10,10]}]," MESH "\"scene\":0,\"scenes\":[{\"nodes\":[0]}]}", &square,
                 sizeof(square));

    square = make_square();
    square.normal[1][0] = INFINITY;
    square.normal[2][2] = 0.0f;
    square.tangent[3][0] = NAN;
    square.uv[0][1] = -INFINITY;
    read_ok(&f, json, &square, sizeof(square));
    assert_int_equal(f.kept.warnings, 3);
    for (int c = 0; c < 3; c++)
        REQUIRE(f.scene->meshes[0].normal[3 + c] == 0.0f && f.scene->meshes[0].normal[6 + c] == 0.0f);
    assert_null(f.scene->meshes[0].tangent);
    REQUIRE(f.scene->meshes[0].uv[0][1] == 0.0f && f.scene->meshes[0].uv[0][2] == 1.0f);
    finish(&f);
}

static void compressed_and_unknown_extensions_are_refused_by_name(void **state)
{
    struct fixture f;
    (void) state;
    refuse(PELL_ERR_UNSUPPORTED, "/extensionsRequired/0", "KHR_draco_mesh_compression",
           HEAD "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]}");
    refuse(PELL_ERR_UNSUPPORTED, "/extensionsRequired/0", "KHR_texture_basisu", HEAD "\"extensionsRequired\":[\"KHR_texture_basisu\"]}");
    refuse(PELL_ERR_UNSUPPORTED, "/extensionsRequired/0", "KHR_meshopt_compression",
           HEAD "\"extensionsRequired\":[\"KHR_meshopt_compression\"]}");
    refuse(PELL_ERR_UNSUPPORTED, "/extensionsRequired/1", "ACME_gravity, which is unknown",
           HEAD "\"extensionsRequired\":[\"KHR_materials_ior\",\"ACME_gravity\"]}");
    read_with(&f, NULL, HEAD "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]}", NULL, 0);
    assert_string_equal(f.kept.hint, "decode it first: gltf-transform copy in.glb out.glb");
    finish(&f);
    read_with(&f, NULL, HEAD "\"extensionsRequired\":[\"KHR_texture_basisu\"]}", NULL, 0);
    assert_string_equal(f.kept.hint, "decode them first: gltf-transform ktxdecompress in.glb out.glb");
    finish(&f);
    read_with(&f, NULL, HEAD "\"extensionsRequired\":[\"EXT_texture_webp\"]}", NULL, 0);
    assert_string_equal(f.kept.hint, "convert them first: gltf-transform png in.glb out.glb --formats webp");
    finish(&f);
    refuse(PELL_ERR_UNSUPPORTED, "/primitives/0/extensions/KHR_draco_mesh_compression", "compressed",
           HEAD ONE_NODE
           "\"accessors\":[{\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],\"meshes\":[{\"primitives\":[{\"attributes\":"
           "{\"POSITION\":0},\"extensions\":{\"KHR_draco_mesh_compression\":{\"bufferView\":0}}}]}]}");
    refuse_bytes(PELL_ERR_FORMAT, "/buffers/0", "stands in for compressed data",
                 HEAD ONE_NODE MESH
                 "\"buffers\":[{\"byteLength\":48,\"extensions\":{\"EXT_meshopt_compression\":{\"fallback\":true}}}],"
                 "\"bufferViews\":[{\"buffer\":0,\"byteLength\":48}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,"
                 "\"count\":3,\"type\":\"VEC3\"}]}",
                 NULL, 0);
}

static void fallbacks_of_compressed_files_are_used_with_a_warning(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    (void) state;
    read_ok(&f,
            SQUARE ONE_NODE "\"extensionsUsed\":[\"KHR_draco_mesh_compression\",\"KHR_texture_basisu\"],"
                            "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":3},\"indices\":5,\"material\":0,"
                            "\"extensions\":{\"KHR_draco_mesh_compression\":{\"bufferView\":0}}}]}],"
                            "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0}},\"emissiveFactor\":[1,1,1],"
                            "\"emissiveTexture\":{\"index\":1}}],"
                            "\"textures\":[{\"source\":0,\"extensions\":{\"KHR_texture_basisu\":{\"source\":0}}},"
                            "{\"extensions\":{\"KHR_texture_basisu\":{\"source\":0}}}],"
                            "\"images\":[{\"uri\":\"data:image/png;base64," TINY_PNG "\"}]}",
            &square, sizeof(square));
    assert_int_equal(f.scene->num_meshes, 1);
    REQUIRE(f.scene->materials[0].base_color_map.texture && !f.scene->materials[0].emissive_map.texture);
    assert_int_equal(f.kept.warnings, 3); /* draco, the image with a fallback, the one without */
    finish(&f);
}

static void extensions_that_are_unknown_are_named(void **state)
{
    const struct square square = make_square();
    struct fixture f;
    (void) state;
    read_ok(&f, SQUARE ONE_NODE "\"extensionsUsed\":[\"ACME_gravity\"],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
            &square, sizeof(square));
    REQUIRE(f.kept.warnings >= 1 && f.kept.errors == 0);
    finish(&f);
}

static void versions_and_containers_are_checked(void **state)
{
    (void) state;
    refuse(PELL_ERR_UNSUPPORTED, "/asset", "version is \"1.0\", allowed: 2.0", "{\"asset\":{\"version\":\"1.0\"}}");
    refuse(PELL_ERR_UNSUPPORTED, "/asset", "version is \"2.1\"", "{\"asset\":{\"version\":\"2.1\",\"minVersion\":\"2.1\"}}");
    refuse(PELL_ERR_FORMAT, ":/", "has no \"asset\"", "{}");
    refuse(PELL_ERR_FORMAT, ":/", "allowed: an object", "[]");
    refuse(PELL_ERR_FORMAT, "/nodes", "allowed: an array", HEAD "\"nodes\":{}}");
    refuse_bytes(PELL_ERR_FORMAT, "/buffers/0", "there is no binary chunk",
                 HEAD ONE_NODE MESH "\"buffers\":[{\"byteLength\":48}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48}],"
                                    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]}",
                 NULL, 0);
    refuse(PELL_ERR_FORMAT, "/buffers/0", "byteLength is 999, but only 260 bytes are there",
           HEAD ONE_NODE MESH "\"buffers\":[{\"byteLength\":999}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48}],"
                              "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]}");
    refuse(PELL_ERR_FORMAT, "/buffers/0/uri", "scheme",
           HEAD ONE_NODE MESH
           "\"buffers\":[{\"byteLength\":48,\"uri\":\"https://example.com/a.bin\"}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48}],"
           "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]}");
    refuse(PELL_ERR_FORMAT, "/buffers/0/uri", "not valid base64",
           HEAD ONE_NODE MESH
           "\"buffers\":[{\"byteLength\":3,\"uri\":\"data:;base64,AA=A\"}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":3}],"
           "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]}");
}

static void files_outside_the_folder_are_refused(void **state)
{
    static const char *const uris[] = { "/etc/passwd", "../secret.bin", "%2e%2e/secret.bin", "a/../../secret.bin" };
    char json[1024];
    struct fixture f;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(uris); i++) {
        snprintf(json, sizeof(json),
                 HEAD ONE_NODE MESH "\"buffers\":[{\"byteLength\":48,\"uri\":\"%s\"}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48}],"
                                    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]}",
                 uris[i]);
        read_with(&f, NULL, json, NULL, 0);
        REQUIRE(f.res != PELL_OK && f.kept.errors == 1 && strstr(f.kept.where, "/buffers/0/uri"));
        finish(&f);
    }
}

static void scene_limits_hold_before_memory_is_taken(void **state)
{
    const struct square square = make_square();
    struct pell_limits limits;
    struct fixture f;
    (void) state;
    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.vertices = 10; /* two squares and a half */
    read_with(&f, &limits,
              SQUARE "\"nodes\":[{\"mesh\":0},{\"mesh\":0},{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                     "\"indices\":5}]}]}",
              &square, sizeof(square));
    assert_int_equal(f.res, PELL_ERR_UNSUPPORTED);
    assert_int_equal(f.scene->num_meshes, 3);
    finish(&f);
    limits.warnings = 2;
    limits.vertices = 100;
    read_with(&f, &limits,
              SQUARE "\"nodes\":[{\"mesh\":0},{\"mesh\":0},{\"mesh\":0},{\"mesh\":0}],"
                     "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5},{\"attributes\":{\"POSITION\":7}}]}]}",
              &square, sizeof(square));
    assert_int_equal(f.res, PELL_OK);
    assert_int_equal(f.kept.warnings, 3); /* two, and the number of the others */
    REQUIRE(strstr(f.kept.last_warning, "2 more warnings"));
    finish(&f);
}

/* Rare features together: strided, sparse and unused indices; instances with all three attributes; a matrix together with a scale. */
static void rare_forms_are_read(void **state)
{
    static const struct {
        float p[4][3];
        uint32_t strided[8]; /* 1 2 3 at a stride of 8 */
        uint8_t sparse_at[4];
        uint32_t sparse_value;
        int8_t rotation[2][4];
        float scale[2][3];
    } bin = { { { 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } },
              { 1, 9, 2, 9, 3, 9, 0, 9 },
              { 2 },
              0,
              { { 0, 0, 0, 127 }, { 0, 0, 127, 0 } },
              { { 1, 1, 1 }, { 2, 2, 2 } } };
    static const uint32_t strided[] = { 1, 2, 3 }, sparse[] = { 1, 2, 0 };
    struct fixture f;
    (void) state;
    read_ok(
        &f,
        HEAD
        "\"nodes\":[{\"mesh\":0,\"matrix\":[2,0,0,0,0,2,0,0,0,0,2,0,0,0,0,1],\"scale\":[5,5,5],\"extensions\":{\"EXT_mesh_gpu_instancing\":"
        "{\"attributes\":{\"ROTATION\":3,\"SCALE\":4}}}}],"
        "\"buffers\":[{\"byteLength\":120}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":48},"
        "{\"buffer\":0,\"byteOffset\":48,\"byteLength\":32,\"byteStride\":8},{\"buffer\":0,\"byteOffset\":80,\"byteLength\":4},"
        "{\"buffer\":0,\"byteOffset\":84,\"byteLength\":4},{\"buffer\":0,\"byteOffset\":88,\"byteLength\":8},"
        "{\"buffer\":0,\"byteOffset\":96,\"byteLength\":24}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"},"
        "{\"bufferView\":1,\"componentType\":5125,\"count\":4,\"type\":\"SCALAR\"},"
        "{\"bufferView\":1,\"componentType\":5125,\"count\":3,\"type\":\"SCALAR\",\"sparse\":{\"count\":1,\"indices\":{\"bufferView\":2,"
        "\"componentType\":5121},\"values\":{\"bufferView\":3}}},"
        "{\"bufferView\":4,\"componentType\":5120,\"normalized\":true,\"count\":2,\"type\":\"VEC4\"},"
        "{\"bufferView\":5,\"componentType\":5126,\"count\":2,\"type\":\"VEC3\"}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1},{\"attributes\":{\"POSITION\":0},\"indices\":2}]}]}",
        &bin, sizeof(bin));
    assert_int_equal(f.scene->num_meshes, 4);
    require_triangles(&f, 0, strided, 1);
    require_triangles(&f, 1, sparse, 1);
    /* the second instance: half a turn about z, twice as large, under the node's 2 */
    REQUIRE_NEAR(position(&f, 2, 1)[0], -4.0, 1e-6);
    REQUIRE_NEAR(position(&f, 2, 3)[2], 4.0, 1e-6);
    assert_int_equal(f.kept.warnings, 3); /* matrix and scale; four corners, for each instance */
    finish(&f);
}

static void wrong_instances_are_refused(void **state)
{
#define INSTANCES(attributes)                                                                                                              \
    SQUARE "\"nodes\":[{\"mesh\":0,\"extensions\":{\"EXT_mesh_gpu_instancing\":{\"attributes\":{" attributes "}}}}],"                      \
           "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5}]}]}"
    struct square square = make_square();
    struct pell_limits limits;
    struct fixture f;
    (void) state;
    refuse(PELL_ERR_FORMAT, "/attributes/SCALE", "4 elements of 3 components", INSTANCES("\"TRANSLATION\":7,\"SCALE\":0"));
    refuse(PELL_ERR_FORMAT, "/attributes/ROTATION", "of 4", INSTANCES("\"ROTATION\":7"));
    square.instances[1][2] = NAN;
    refuse_bytes(PELL_ERR_FORMAT, "/attributes/TRANSLATION", "element 1 is not a finite number", INSTANCES("\"TRANSLATION\":7"), &square,
                 sizeof(square));
    memset(square.tangent, 0, sizeof(square.tangent));
    refuse_bytes(PELL_ERR_FORMAT, "/EXT_mesh_gpu_instancing/attributes", "ROTATION 0 has length 0", INSTANCES("\"ROTATION\":2"), &square,
                 sizeof(square));
    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.nodes = 2; /* the node and one of its two instances */
    square = make_square();
    read_with(&f, &limits, INSTANCES("\"TRANSLATION\":7"), &square, sizeof(square));
    assert_int_equal(f.res, PELL_ERR_UNSUPPORTED);
    REQUIRE(strstr(f.kept.what, "more than 2 nodes and instances"));
    finish(&f);
    limits.nodes = 1;
    read_with(&f, &limits, INSTANCES("\"TRANSLATION\":7"), &square, sizeof(square));
    REQUIRE(f.res == PELL_ERR_UNSUPPORTED && strstr(f.kept.what, "2 instances; 1 are allowed"));
    finish(&f);
}

static void places_beyond_the_range_of_numbers_are_refused(void **state)
{
    static char json[4096];
    size_t n = (size_t) snprintf(json, sizeof(json), HEAD "\"nodes\":[");
    (void) state;
    for (int i = 0; i < 12; i++)
        n += (size_t) snprintf(json + n, sizeof(json) - n, "%s{\"scale\":[1e30,1e30,1e30],\"children\":[%d]}", i ? "," : "", i + 1);
    snprintf(json + n, sizeof(json) - n, ",{}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/10", "is not finite", json);
    refuse(PELL_ERR_FORMAT, "/nodes/0/translation/0", "allowed: [-1e+30, 1e+30]", HEAD "\"nodes\":[{\"translation\":[1e39,0,0]}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/1", "out of the range of floats",
           HEAD "\"nodes\":[{\"scale\":[1e30,1,1],\"children\":[1]},{\"translation\":[1e30,0,0],\"camera\":0}],"
                "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1}}]}");
    refuse(PELL_ERR_FORMAT, "/nodes/1", "out of the range of floats",
           HEAD "\"nodes\":[{\"scale\":[1e30,1,1],\"children\":[1]},{\"translation\":[1e30,0,0],\"extensions\":{\"KHR_lights_punctual\":"
                "{\"light\":0}}}],\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"point\"}]}}}");
}

static void odd_values_are_mended_with_a_warning(void **state)
{
    static const struct {
        float p[3][3];
        float color[3][3];
    } bin = { { { 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 } }, { { -1, NAN, 1e9f }, { 0, 0.5f, 1 }, { 2, 0, 0 } } };
    struct fixture f;
    const float *c;
    (void) state;
    read_ok(&f,
            HEAD ONE_NODE
            "\"buffers\":[{\"byteLength\":72}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},"
            "{\"buffer\":0,\"byteOffset\":36,\"byteLength\":36}],"
            "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},"
            "{\"bufferView\":1,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],"
            "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"COLOR_0\":1},\"material\":0}]}],"
            "\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"data:image/png;base64," TINY_PNG "\"}],"
            "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0,\"texCoord\":5}},\"extensions\":{"
            "\"KHR_materials_diffuse_transmission\":{\"diffuseTransmissionFactor\":1,\"diffuseTransmissionColorFactor\":[1,0.5,0],"
            "\"diffuseTransmissionColorTexture\":{\"index\":0}},\"KHR_materials_volume\":{\"thicknessFactor\":1},\"KHR_materials_"
            "transmission\":{\"transmissionFactor\":1},"
            "\"KHR_materials_ior\":{\"ior\":0}}}]}",
            &bin, sizeof(bin));
    c = f.scene->meshes[0].color;
    REQUIRE(c[0] == 0.0f && c[1] == 0.0f && c[2] == 1e6f && c[5] == 0.5f && c[8] == 2.0f);
    /* TEXCOORD_5 is unsupported; then the transmitted colour becomes the surface colour */
    REQUIRE(f.scene->materials[0].base_color_map.texture && f.scene->materials[0].base_color[1] == 0.5f);
    REQUIRE(f.scene->materials[0].color_from == PELL_COLOR_FROM_TEXTURE && f.scene->materials[0].medium.eta == 1.5);
    /* the colours, the set, the index of refraction, the clear part, the missing scattering, the UV set that is not there */
    assert_int_equal(f.kept.warnings, 6);
    finish(&f);
}

static void warnings_about_interiors_are_not_for_who_replaces_them(void **state)
{
    const struct square square = make_square();
    struct kept_messages kept[2] = { { 0 }, { 0 } };
    (void) state;
    for (int replaced = 0; replaced < 2; replaced++) {
        struct pell_context *ctx = test_context(NULL, &kept[replaced]);
        struct pell_import import = { .ctx = ctx, .path = "x.glb", .replaces_materials = replaced };
        size_t size;
        uint8_t *glb = make_glb(interiors, &square, sizeof(square), &size);

        assert_non_null(ctx);
        assert_int_equal(pell_scene_create(ctx, &import.scene), PELL_OK);
        assert_int_equal(pell_import_gltf(&import, glb, size), PELL_OK);
        pell_scene_destroy(&import.scene);
        pell_context_destroy(&ctx);
        free(glb);
    }
    /* clear glass, and scattering without a distance */
    assert_true(kept[0].warnings >= 2);
    assert_int_equal(kept[1].warnings, 0);
}

static void cancelling_ends_the_import(void **state)
{
    const struct square square = make_square();
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene;
    (void) state;
    assert_non_null(ctx);
    pell_context_cancel(ctx);
    assert_int_equal(import_glb(ctx, RICH_JSON, &square, sizeof(square), &scene), PELL_ERR_CANCELLED);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(strips_turn_every_second_triangle),
        cmocka_unit_test(fans_and_lists_without_indices_are_drawn),
        cmocka_unit_test(points_and_lines_are_skipped_with_a_warning),
        cmocka_unit_test(quantised_positions_keep_their_scale),
        cmocka_unit_test(sparse_values_replace_and_stand_alone),
        cmocka_unit_test(vertex_colours_of_all_types_become_rgba),
        cmocka_unit_test(indices_of_one_and_four_bytes_are_read),
        cmocka_unit_test(base64_is_read_with_and_without_padding),
        cmocka_unit_test(data_uris_without_base64_are_percent_decoded),
        cmocka_unit_test(mirrors_turn_triangles_normals_and_tangents),
        cmocka_unit_test(matrices_nest_and_normals_follow_the_inverse_transpose),
        cmocka_unit_test(instances_are_placed_each),
        cmocka_unit_test(hidden_nodes_and_flattened_ones_draw_nothing),
        cmocka_unit_test(empty_default_scene_gives_way_to_one_with_a_mesh),
        cmocka_unit_test(bad_hierarchies_are_refused),
        cmocka_unit_test(deep_and_wide_hierarchies_are_limited),
        cmocka_unit_test(cameras_and_lights_look_along_minus_z_of_their_nodes),
        cmocka_unit_test(wrong_cameras_and_lights_are_refused),
        cmocka_unit_test(every_field_of_a_material_arrives),
        cmocka_unit_test(translucency_needs_a_way_in),
        cmocka_unit_test(blend_is_a_mask_and_others_are_named),
        cmocka_unit_test(factors_out_of_range_are_cut_with_a_warning),
        cmocka_unit_test(broken_pictures_are_warnings_that_name_them),
        cmocka_unit_test(accessors_outside_their_bytes_are_refused),
        cmocka_unit_test(wrong_attributes_are_refused),
        cmocka_unit_test(indices_past_the_vertices_are_refused),
        cmocka_unit_test(values_that_are_not_finite_are_refused_or_mended),
        cmocka_unit_test(compressed_and_unknown_extensions_are_refused_by_name),
        cmocka_unit_test(fallbacks_of_compressed_files_are_used_with_a_warning),
        cmocka_unit_test(extensions_that_are_unknown_are_named),
        cmocka_unit_test(versions_and_containers_are_checked),
        cmocka_unit_test(files_outside_the_folder_are_refused),
        cmocka_unit_test(scene_limits_hold_before_memory_is_taken),
        cmocka_unit_test(rare_forms_are_read),
        cmocka_unit_test(wrong_instances_are_refused),
        cmocka_unit_test(places_beyond_the_range_of_numbers_are_refused),
        cmocka_unit_test(odd_values_are_mended_with_a_warning),
        cmocka_unit_test(warnings_about_interiors_are_not_for_who_replaces_them),
        cmocka_unit_test(cancelling_ends_the_import),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
