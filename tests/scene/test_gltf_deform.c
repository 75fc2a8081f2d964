/* SPDX-License-Identifier: MIT
 * test_gltf_deform.c - deforming meshes of glTF (animations, skins, morph targets) against closed forms; and refusals. */
#include "gltf_test.h"

/* --- Documents -------------------------------------------------------------------------------------------------------------- */

/* A buffer, and the JSON of its views and accessors. */
struct file {
    uint8_t bin[4096];
    size_t size;
    char views[4096], accessors[8192], json[20000];
    int num_views, num_accessors;
};

static int add_view(struct file *f, const void *data, size_t size, int stride)
{
    const size_t at = (f->size + 3) / 4 * 4;
    char *v = f->views + strlen(f->views), step[32] = "";

    REQUIRE(at + size <= sizeof(f->bin));
    memcpy(f->bin + at, data, size);
    f->size = at + size;
    if (stride)
        sprintf(step, ",\"byteStride\":%d", stride);
    sprintf(v, "%s{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu%s}", f->num_views ? "," : "", at, size, step);
    return f->num_views++;
}

static int add_accessor(struct file *f, const char *json)
{
    sprintf(f->accessors + strlen(f->accessors), "%s{%s}", f->num_accessors ? "," : "", json);
    return f->num_accessors++;
}

/* Both at once. */
static int put(struct file *f, int type, const char *kind, bool normalized, const void *data, size_t size, int count)
{
    char json[256];

    sprintf(json, "\"bufferView\":%d,\"componentType\":%d,\"count\":%d,\"type\":\"%s\"%s", add_view(f, data, size, 0), type, count, kind,
            normalized ? ",\"normalized\":true" : "");
    return add_accessor(f, json);
}

#define FLOATS(f, kind, data, count) put(f, 5126, kind, false, data, sizeof(data), count)

/* The document with the buffer and further content. */
static const char *document(struct file *f, const char *rest)
{
    snprintf(f->json, sizeof(f->json),
             "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":%zu}],\"bufferViews\":[%s],"
             "\"accessors\":[%s],%s}",
             f->size, f->views, f->accessors, rest);
    return f->json;
}

struct fixture {
    struct pell_alloc_fault fault;
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_scene *scene;
    enum pell_result res;
};

static void read_limited(struct fixture *x, const struct file *f, const struct pell_moment *moment, const struct pell_limits *limits,
                         uint64_t fail_at)
{
    struct pell_context_params params = { .log = keep_message, .log_user = &x->kept, .log_level = PELL_LOG_WARNING, .limits = limits };
    struct pell_import import = { .path = "test.glb", .root = ".", .moment = moment ? *moment : (struct pell_moment) { 0 } };
    size_t size;
    uint8_t *glb = make_glb(f->json, f->bin, f->size, &size), *exact = malloc(size + 1);

    REQUIRE(exact != NULL);
    memcpy(exact, glb, size);
    exact[size] = 0;
    memset(x, 0, sizeof(*x));
    params.allocator = pell_failing_allocator(&x->fault);
    assert_int_equal(pell_context_create(&params, &x->ctx), PELL_OK);
    assert_int_equal(pell_scene_create(x->ctx, &x->scene), PELL_OK);
    import.ctx = x->ctx;
    import.scene = x->scene;
    if (fail_at)
        x->fault.fail_at = x->fault.calls + fail_at;
    x->res = pell_import_gltf(&import, exact, size);
    free(exact);
    free(glb);
}

static void finish(struct fixture *x)
{
    pell_scene_destroy(&x->scene);
    pell_context_destroy(&x->ctx);
    assert_int_equal(x->fault.live, 0);
}

/* `time` below 0: the rest pose. */
static void read_at(struct fixture *x, const struct file *f, double time)
{
    read_limited(x, f, &(struct pell_moment) { .timed = time >= 0.0, .time = time }, NULL, 0);
    if (x->res != PELL_OK)
        fail_msg("refused: %s: %s", x->kept.where, x->kept.what);
}

static void refuse_at(enum pell_result code, const char *where, const char *what, const struct file *f, const struct pell_moment *moment)
{
    struct fixture x;
    read_limited(&x, f, moment, NULL, 0);
    if (x.res != code || !strstr(x.kept.where, where) || !strstr(x.kept.what, what))
        fail_msg("got %d, \"%s\", \"%s\"; wanted %d, \"%s\", \"%s\"", x.res, x.kept.where, x.kept.what, code, where, what);
    assert_int_equal(x.kept.errors, 1);
    finish(&x);
}

static void require_vec(const float *got, double a, double b, double c, double tolerance)
{
    REQUIRE_NEAR(got[0], a, tolerance);
    REQUIRE_NEAR(got[1], b, tolerance);
    REQUIRE_NEAR(got[2], c, tolerance);
}

/* --- Skins ------------------------------------------------------------------------------------------------------------------ */

/* A bar along y: corners at heights 0, 1, 2. Two joints, the second of which is at height 1 and is rotated by a right angle about z by
 * node 2, or is unrotated in the rest pose. */
#define BAR_CORNERS 6
static const float bar_position[BAR_CORNERS][3] = { { 0, 0, 0 }, { 0.1f, 0, 0 }, { 0, 1, 0 }, { 0.1f, 1, 0 }, { 0, 2, 0 }, { 0.1f, 2, 0 } };
static const float bar_normal[BAR_CORNERS][3] = { { 1, 0, 0 }, { 1, 0, 0 }, { 1, 0, 0 }, { 1, 0, 0 }, { 1, 0, 0 }, { 1, 0, 0 } };
static const float bar_tangent[BAR_CORNERS][4] = { { 0, 1, 0, 1 }, { 0, 1, 0, 1 }, { 0, 1, 0, 1 },
                                                   { 0, 1, 0, 1 }, { 0, 1, 0, 1 }, { 0, 1, 0, 1 } };
static const uint16_t bar_index[] = { 0, 1, 2, 2, 1, 3, 2, 3, 4, 4, 3, 5 };
static const float bar_inverse[2][16] = { { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 },
                                          { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1 } };

enum weight_form { WEIGHT_FLOAT, WEIGHT_BYTE, WEIGHT_SHORT, WEIGHT_FORMS };

/* Accessors: 0 positions, 1 normals, 2 tangents, 3 indices, 4 inverses, 5 joints, 6 weights. */
static void make_bar(struct file *f, enum weight_form form, const float (*weights)[4], const uint8_t (*joints)[4])
{
    static const float linear_weights[BAR_CORNERS][4] = { { 1, 0, 0, 0 },       { 1, 0, 0, 0 }, { 0.5f, 0.5f, 0, 0 },
                                                          { 0.5f, 0.5f, 0, 0 }, { 0, 1, 0, 0 }, { 0, 1, 0, 0 } };
    static const uint8_t first[BAR_CORNERS][4] = { { 0, 1, 0, 0 }, { 0, 1, 0, 0 }, { 0, 1, 0, 0 },
                                                   { 0, 1, 0, 0 }, { 0, 1, 0, 0 }, { 0, 1, 0, 0 } };
    uint8_t bytes[BAR_CORNERS][4];
    uint16_t shorts[BAR_CORNERS][4], wide[BAR_CORNERS][4];

    weights = weights ? weights : linear_weights;
    joints = joints ? joints : first;
    memset(f, 0, sizeof(*f));
    FLOATS(f, "VEC3", bar_position, BAR_CORNERS);
    FLOATS(f, "VEC3", bar_normal, BAR_CORNERS);
    FLOATS(f, "VEC4", bar_tangent, BAR_CORNERS);
    put(f, 5123, "SCALAR", false, bar_index, sizeof(bar_index), 12);
    FLOATS(f, "MAT4", bar_inverse, 2);
    for (int i = 0; i < BAR_CORNERS; i++)
        for (int k = 0; k < 4; k++) {
            bytes[i][k] = (uint8_t) lrintf(255.0f * weights[i][k]);
            shorts[i][k] = (uint16_t) lrintf(65535.0f * weights[i][k]);
            wide[i][k] = joints[i][k];
        }
    if (form == WEIGHT_SHORT)
        put(f, 5123, "VEC4", false, wide, sizeof(wide), BAR_CORNERS);
    else
        put(f, 5121, "VEC4", false, joints, sizeof(wide) / 2, BAR_CORNERS);
    if (form == WEIGHT_FLOAT)
        put(f, 5126, "VEC4", false, weights, sizeof(linear_weights), BAR_CORNERS);
    else if (form == WEIGHT_BYTE)
        put(f, 5121, "VEC4", true, bytes, sizeof(bytes), BAR_CORNERS);
    else
        put(f, 5123, "VEC4", true, shorts, sizeof(shorts), BAR_CORNERS);
}

#define BAR_MESH                                                                                                                           \
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,\"TANGENT\":2,\"JOINTS_0\":5,\"WEIGHTS_0\":6},"             \
    "\"indices\":3}]}]"
#define BAR_SKIN "\"skins\":[{\"joints\":[1,2],\"inverseBindMatrices\":4,\"skeleton\":1}],"
#define RIGHT_ANGLE "[0,0,0.70710678118654752,0.70710678118654752]"
/* The mesh's own node is far away and mirrored, which must have no effect. */
#define BAR_NODES(turn)                                                                                                                    \
    "\"nodes\":[{\"mesh\":0,\"skin\":0,\"translation\":[100,7,3],\"scale\":[-2,5,1]},{\"children\":[2]},"                                  \
    "{\"translation\":[0,1,0],\"rotation\":" turn "}],"

static void require_bent(const struct fixture *x, double tolerance)
{
    const struct pell_mesh *m = &x->scene->meshes[0];
    const double s = sqrt(0.5);

    assert_int_equal(x->scene->num_meshes, 1);
    require_vec(m->position, 0, 0, 0, tolerance);
    require_vec(m->position + 3, 0.1, 0, 0, tolerance);
    require_vec(m->position + 6, 0, 1, 0, tolerance);
    require_vec(m->position + 9, 0.05, 1.05, 0, tolerance); /* half-way between (0.1, 1) and (0, 1.1) */
    require_vec(m->position + 12, -1, 1, 0, tolerance);
    require_vec(m->position + 15, -1, 1.1, 0, tolerance);
    require_vec(m->normal, 1, 0, 0, tolerance);
    require_vec(m->normal + 9, s, s, 0, tolerance);
    require_vec(m->normal + 12, 0, 1, 0, tolerance);
    require_vec(m->tangent + 12, -s, s, 0, tolerance);
    require_vec(m->tangent + 16, -1, 0, 0, tolerance);
    for (int i = 0; i < BAR_CORNERS; i++)
        assert_true(m->tangent[4 * i + 3] == 1.0f);
    for (int i = 0; i < 12; i++)
        assert_int_equal(m->index[i], bar_index[i]);
}

static void a_bar_bends_at_its_joint(void **state)
{
    static const double tolerance[WEIGHT_FORMS] = { 1e-6, 3e-3, 1e-5 }; /* 128 of 255 is not one half */
    struct file f;
    struct fixture x;
    (void) state;
    for (int form = 0; form < WEIGHT_FORMS; form++) {
        make_bar(&f, (enum weight_form) form, NULL, NULL);
        document(&f, BAR_SKIN BAR_NODES(RIGHT_ANGLE) BAR_MESH);
        read_at(&x, &f, -1.0);
        require_bent(&x, tolerance[form]);
        assert_int_equal(x.kept.warnings, 0);
        finish(&x);
    }
}

static void a_skin_at_rest_is_the_mesh(void **state)
{
    struct file f;
    struct fixture x;
    (void) state;
    make_bar(&f, WEIGHT_FLOAT, NULL, NULL);
    document(&f, BAR_SKIN BAR_NODES("[0,0,0,1]") BAR_MESH);
    read_at(&x, &f, -1.0);
    assert_memory_equal(x.scene->meshes[0].position, bar_position, sizeof(bar_position));
    assert_memory_equal(x.scene->meshes[0].normal, bar_normal, sizeof(bar_normal));
    assert_memory_equal(x.scene->meshes[0].tangent, bar_tangent, sizeof(bar_tangent));
    finish(&x);
}

static void weights_need_not_be_of_sum_one(void **state)
{
    static const float doubled[BAR_CORNERS][4] = { { 2, 0, 0, 0 }, { 3, 0, 0, 0 },    { 1, 1, 0, 0 },
                                                   { 5, 5, 0, 0 }, { 0, 0.5f, 0, 0 }, { 0, 9, 0, 0 } };
    static const float none[BAR_CORNERS][4] = { { 0 } };
    /* a joint of weight zero may have any index */
    static const uint8_t wild[BAR_CORNERS][4] = { { 0, 1, 99, 255 }, { 0, 1, 99, 3 }, { 0, 1, 2, 2 },
                                                  { 0, 1, 7, 7 },    { 99, 1, 9, 9 }, { 8, 1, 0, 0 } };
    static const uint8_t second[BAR_CORNERS][4] = { { 1 }, { 1 }, { 1 }, { 1 }, { 1 }, { 200 } };
    struct file f;
    struct fixture x;
    (void) state;
    make_bar(&f, WEIGHT_FLOAT, doubled, wild);
    document(&f, BAR_SKIN BAR_NODES(RIGHT_ANGLE) BAR_MESH);
    read_at(&x, &f, -1.0);
    require_bent(&x, 1e-6);
    assert_int_equal(x.kept.warnings, 1);
    finish(&x);
    make_bar(&f, WEIGHT_FLOAT, none, second);
    document(&f, BAR_SKIN BAR_NODES(RIGHT_ANGLE) BAR_MESH);
    read_at(&x, &f, -1.0);
    require_vec(x.scene->meshes[0].position, 1, 1, 0, 1e-6);        /* the foot follows joint 1 */
    require_vec(x.scene->meshes[0].position + 15, 0.1, 2, 0, 1e-6); /* and one without joints follows the first */
    assert_int_equal(x.kept.warnings, 1);
    finish(&x);
}

/* The second set counts as the first does: here it holds half of each weight. */
static void eight_joints_move_a_vertex(void **state)
{
    static const float half[BAR_CORNERS][4] = { { 0.5f }, { 0.5f }, { 0.5f }, { 0.5f }, { 0, 0.5f }, { 0, 0.5f } };
    static const float rest[BAR_CORNERS][4] = { { 0.5f }, { 0.5f }, { 0, 0.5f }, { 0, 0.5f }, { 0, 0.5f }, { 0, 0.5f } };
    static const uint8_t joint[BAR_CORNERS][4] = { { 0, 1 }, { 0, 1 }, { 0, 1 }, { 0, 1 }, { 0, 1 }, { 0, 1 } };
    struct file f;
    struct fixture x;
    (void) state;
    make_bar(&f, WEIGHT_FLOAT, half, NULL);
    put(&f, 5121, "VEC4", false, joint, sizeof(joint), BAR_CORNERS);
    FLOATS(&f, "VEC4", rest, BAR_CORNERS);
    document(&f, BAR_SKIN BAR_NODES(RIGHT_ANGLE) "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,\"TANGENT\":2,"
                                                 "\"JOINTS_0\":5,\"WEIGHTS_0\":6,\"JOINTS_1\":7,\"WEIGHTS_1\":8},\"indices\":3}]}]");
    read_at(&x, &f, -1.0);
    require_bent(&x, 1e-6);
    assert_int_equal(x.kept.warnings, 0);
    finish(&x);
}

static void joints_that_mirror_turn_triangles(void **state)
{
    struct file f;
    struct fixture x;
    const struct pell_mesh *m;
    (void) state;
    make_bar(&f, WEIGHT_FLOAT, NULL, NULL);
    document(&f, BAR_SKIN "\"nodes\":[{\"mesh\":0,\"skin\":0},{\"scale\":[-1,1,1],\"children\":[2]},{\"translation\":[0,1,0]}]," BAR_MESH);
    read_at(&x, &f, -1.0);
    m = &x.scene->meshes[0];
    require_vec(m->position + 15, -0.1, 2, 0, 1e-6);
    require_vec(m->normal + 15, -1, 0, 0, 1e-6);
    for (int i = 0; i < 12; i += 3) {
        assert_int_equal(m->index[i], bar_index[i]);
        assert_int_equal(m->index[i + 1], bar_index[i + 2]);
    }
    assert_true(m->tangent[3] == -1.0f);
    finish(&x);
    /* scaled to zero: hidden, not refused */
    document(&f, BAR_SKIN "\"nodes\":[{\"mesh\":0,\"skin\":0},{\"scale\":[0,0,0],\"children\":[2]},{}]," BAR_MESH);
    read_at(&x, &f, -1.0);
    assert_int_equal(x.scene->num_meshes, 0);
    finish(&x);
}

static void bad_skins_are_refused(void **state)
{
    static const float negative[BAR_CORNERS][4] = { { 1 }, { 1 }, { 1, -0.5f }, { 1 }, { 1 }, { 1 } };
    static const float empty[BAR_CORNERS][4] = { { 1 }, { 1 }, { NAN }, { 1 }, { 1 }, { 1 } };
    static const uint8_t third[BAR_CORNERS][4] = { { 0 }, { 0 }, { 0 }, { 2 }, { 0 }, { 0 } };
    static const float one[BAR_CORNERS][4] = { { 1 }, { 1 }, { 1 }, { 1 }, { 1 }, { 1 } };
    static const float tilted[16] = { 1, 0, 0, 0.5f, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 };
    static const float infinite[2][16] = { { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 },
                                           { 1, INFINITY, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 } };
#define BAR(nodes, skins, attributes)                                                                                                      \
    "\"nodes\":" nodes ",\"skins\":" skins ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0" attributes "}}]}]"
#define JOINTS ",\"JOINTS_0\":5,\"WEIGHTS_0\":6"
#define NODES "[{\"mesh\":0,\"skin\":0},{}]"
    static const struct {
        const char *where, *what, *rest;
    } cases[] = {
        { "/nodes/0/skin", "is 1, allowed: [0, 0]", BAR("[{\"mesh\":0,\"skin\":1},{}]", "[{\"joints\":[1]}]", JOINTS) },
        { "/skins/0", "has no \"joints\"", BAR(NODES, "[{}]", JOINTS) },
        { "/skins/0/joints", "allowed", BAR(NODES, "[{\"joints\":[]}]", JOINTS) },
        { "/skins/0/joints/1", "is 2", BAR(NODES, "[{\"joints\":[1,2]}]", JOINTS) },
        { "/skins/0/skeleton", "is 9", BAR(NODES, "[{\"joints\":[1],\"skeleton\":9}]", JOINTS) },
        { "/skins/0/inverseBindMatrices", "allowed: MAT4", BAR(NODES, "[{\"joints\":[1],\"inverseBindMatrices\":0}]", JOINTS) },
        { "/skins/0/inverseBindMatrices", "2 matrices for 3 joints",
          BAR(NODES, "[{\"joints\":[1,1,0],\"inverseBindMatrices\":4}]", JOINTS) },
        { "/skins/0/inverseBindMatrices", "last row of matrix 0 is 0.5",
          BAR(NODES, "[{\"joints\":[1],\"inverseBindMatrices\":7}]", JOINTS) },
        { "/skins/0/inverseBindMatrices", "matrix 1 has a component inf",
          BAR(NODES, "[{\"joints\":[1,0],\"inverseBindMatrices\":8}]", JOINTS) },
        { "/attributes", "no JOINTS_0 and WEIGHTS_0", BAR(NODES, "[{\"joints\":[1]}]", "") },
        { "/attributes", "has JOINTS_0 without WEIGHTS_0", BAR(NODES, "[{\"joints\":[1]}]", ",\"JOINTS_0\":5") },
        { "/attributes", "has WEIGHTS_1 without JOINTS_1", BAR(NODES, "[{\"joints\":[1]}]", JOINTS ",\"WEIGHTS_1\":6") },
        { "/attributes/JOINTS_0", "allowed: 5121 or 5123", BAR(NODES, "[{\"joints\":[1]}]", ",\"JOINTS_0\":6,\"WEIGHTS_0\":6") },
        { "/attributes/JOINTS_0", "3 components, allowed: 4", BAR(NODES, "[{\"joints\":[1]}]", ",\"JOINTS_0\":0,\"WEIGHTS_0\":6") },
        { "/attributes/JOINTS_0", "2 elements, allowed: 6", BAR(NODES, "[{\"joints\":[1]}]", ",\"JOINTS_0\":9,\"WEIGHTS_0\":6") },
        { "/attributes/POSITION", "16 components, allowed: 3",
          "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":4}}]}]" },
        { "/nodes/0", "the product of the transforms",
          "\"nodes\":[{\"scale\":[1e30,1,1],\"children\":[1]},{\"scale\":[1e30,1,1],\"children\":[2]},{\"scale\":[1e30,1,1],\"children\":["
          "3]},"
          "{\"scale\":[1e30,1,1],\"children\":[4]},{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]" },
    };
    const size_t count = sizeof(cases) / sizeof(cases[0]);
    struct file f;
    (void) state;
    for (size_t i = 0; i + 1 < count; i++) {
        make_bar(&f, WEIGHT_FLOAT, one, NULL);
        FLOATS(&f, "MAT4", tilted, 1);
        FLOATS(&f, "MAT4", infinite, 2);
        put(&f, 5121, "VEC4", false, third, 8, 2);
        document(&f, cases[i].rest);
        refuse_at(PELL_ERR_FORMAT, cases[i].where, cases[i].what, &f, NULL);
    }
    make_bar(&f, WEIGHT_FLOAT, negative, NULL);
    document(&f, BAR_SKIN BAR_NODES(RIGHT_ANGLE) BAR_MESH);
    refuse_at(PELL_ERR_FORMAT, "/attributes/WEIGHTS_0", "weight 1 of vertex 2 is -0.5", &f, NULL);
    make_bar(&f, WEIGHT_FLOAT, empty, NULL);
    document(&f, BAR_SKIN BAR_NODES(RIGHT_ANGLE) BAR_MESH);
    refuse_at(PELL_ERR_FORMAT, "/attributes/WEIGHTS_0", "weight 0 of vertex 2 is", &f, NULL);
    make_bar(&f, WEIGHT_FLOAT, one, third);
    document(&f, BAR_SKIN BAR_NODES(RIGHT_ANGLE) BAR_MESH);
    refuse_at(PELL_ERR_FORMAT, "/attributes/JOINTS_0", "joint 0 of vertex 3 is 2, allowed: [0, 1]", &f, NULL);
}

/* --- Morph targets ---------------------------------------------------------------------------------------------------------- */

static const float tri_position[3][3] = { { 0, 0, 0 }, { 1, 0, 0 }, { 0, 1, 0 } };
static const float tri_normal[3][3] = { { 0, 0, 1 }, { 0, 0, 1 }, { 0, 0, 1 } };
static const float tri_tangent[3][4] = { { 1, 0, 0, -1 }, { 1, 0, 0, -1 }, { 1, 0, 0, -1 } };
static const float tri_lift[3][3] = { { 0, 0, 1 }, { 0, 0, 2 }, { 0, 0, -4 } };
static const float tri_lean[3][3] = { { 2, 0, 0 }, { 0, 2, 0 }, { 0, 0, 0 } };
static const int8_t tri_small[3][4] = { { 0, 0, 127, 0 }, { 0, -127, 0, 0 }, { -128, 0, 0, 0 } }; /* a stride of four */
static const uint8_t sparse_index[] = { 2 };
static const float sparse_value[3] = { 8, 0, 0 };

/* Accessors: 0 positions, 1 normals, 2 tangents, 3 lift, 4 lean, 5 small (normalised bytes), 6 sparse (only vertex 2), 7 too few,
 * 8 not a number. */
static void make_triangle(struct file *f)
{
    static const float nan[3][3] = { { 0 }, { 0, NAN, 0 }, { 0 } };
    char json[512];

    memset(f, 0, sizeof(*f));
    FLOATS(f, "VEC3", tri_position, 3);
    FLOATS(f, "VEC3", tri_normal, 3);
    FLOATS(f, "VEC4", tri_tangent, 3);
    FLOATS(f, "VEC3", tri_lift, 3);
    FLOATS(f, "VEC3", tri_lean, 3);
    snprintf(json, sizeof(json), "\"bufferView\":%d,\"componentType\":5120,\"count\":3,\"type\":\"VEC3\",\"normalized\":true",
             add_view(f, tri_small, sizeof(tri_small), 4));
    add_accessor(f, json);
    snprintf(json, sizeof(json),
             "\"componentType\":5126,\"count\":3,\"type\":\"VEC3\",\"sparse\":{\"count\":1,\"indices\":{\"bufferView\":%d,"
             "\"componentType\":5121},\"values\":{\"bufferView\":%d}}",
             add_view(f, sparse_index, 1, 0), add_view(f, sparse_value, sizeof(sparse_value), 0));
    add_accessor(f, json);
    put(f, 5126, "VEC3", false, tri_lift, 24, 2);
    FLOATS(f, "VEC3", nan, 3);
}

#define TRIANGLE(weights, targets)                                                                                                         \
    "\"meshes\":[{" weights "\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,\"TANGENT\":2},\"targets\":" targets "}]}]"

static void targets_are_added_by_their_weights(void **state)
{
    const double s = sqrt(0.5), l = 1.0 / sqrt(1.0625);
    struct file f;
    struct fixture x;
    const struct pell_mesh *m;
    (void) state;
    make_triangle(&f);
    document(&f, "\"nodes\":[{\"mesh\":0}]," TRIANGLE("\"weights\":[0.5,0.25],", "[{\"POSITION\":3,\"NORMAL\":4,\"TANGENT\":4},"
                                                                                 "{\"POSITION\":6,\"NORMAL\":5,\"TANGENT\":5}]"));
    read_at(&x, &f, -1.0);
    m = &x.scene->meshes[0];
    require_vec(m->position, 0, 0, 0.5, 1e-6);
    require_vec(m->position + 3, 1, 0, 1, 1e-6);
    require_vec(m->position + 6, 2, 1, -2, 1e-6);
    require_vec(m->normal, 1 / sqrt(1 + 1.5625), 0, 1.25 / sqrt(1 + 1.5625), 1e-6); /* (1, 0, 1 + 0.25) */
    require_vec(m->normal + 6, -0.25 * l, 0, l, 1e-6);                              /* -128 is -1, too */
    require_vec(m->tangent + 4, 1 / sqrt(1 + 0.5625), 0.75 / sqrt(1 + 0.5625), 0, 1e-6);
    assert_true(m->tangent[3] == -1.0f); /* w is not morphed */
    assert_int_equal(x.kept.warnings, 0);
    finish(&x);
    /* the node's weights override the mesh's; the node's transform applies after morphing, a mirror flips the winding where required */
    document(&f,
             "\"nodes\":[{\"mesh\":0,\"weights\":[0,1],\"scale\":[-1,1,1],\"translation\":[0,0,5]}]," TRIANGLE(
                 "\"weights\":[0.5,0.25],", "[{\"POSITION\":3,\"NORMAL\":4,\"TANGENT\":4},{\"POSITION\":6,\"NORMAL\":5,\"TANGENT\":4}]"));
    read_at(&x, &f, -1.0);
    m = &x.scene->meshes[0];
    require_vec(m->position + 6, -8, 1, 5, 1e-6);
    require_vec(m->normal + 3, 0, -s, s, 1e-6);
    require_vec(m->normal + 6, s, 0, s, 1e-6);
    assert_true(m->tangent[3] == 1.0f);
    assert_int_equal(m->index[1], 2);
    finish(&x);
}

/* Realistic face rigs have some fifty targets. */
static void there_may_be_many_targets(void **state)
{
#define FIVE(x) x "," x "," x "," x "," x
    struct file f;
    struct fixture x;
    (void) state;
    make_triangle(&f);
    document(&f, "\"nodes\":[{\"mesh\":0}]," TRIANGLE("\"weights\":[" FIVE(FIVE("0.04")) "],", "[" FIVE(FIVE("{\"POSITION\":3}")) "]"));
    read_at(&x, &f, -1.0);
    require_vec(x.scene->meshes[0].position, 0, 0, 1, 1e-6);
    finish(&x);
#undef FIVE
}

static void weights_of_zero_leave_the_base(void **state)
{
    struct file f;
    struct fixture x;
    (void) state;
    for (int i = 0; i < 3; i++) {
        make_triangle(&f);
        document(&f, i == 0   ? "\"nodes\":[{\"mesh\":0}]," TRIANGLE("", "[{\"POSITION\":3},{\"POSITION\":8}]")
                     : i == 1 ? "\"nodes\":[{\"mesh\":0}]," TRIANGLE("\"weights\":[0,0],", "[{\"POSITION\":3},{\"POSITION\":8}]")
                              : "\"nodes\":[{\"mesh\":0,\"weights\":[0,0]}]," TRIANGLE("\"weights\":[3,4],",
                                                                                       "[{\"POSITION\":3},{\"POSITION\":4}]"));
        read_at(&x, &f, -1.0);
        assert_memory_equal(x.scene->meshes[0].position, tri_position, sizeof(tri_position));
        assert_memory_equal(x.scene->meshes[0].normal, tri_normal, sizeof(tri_normal));
        assert_memory_equal(x.scene->meshes[0].tangent, tri_tangent, sizeof(tri_tangent));
        finish(&x);
    }
}

/* Unchanged base normals would shade the new shape like the old one. */
static void normals_that_a_target_leaves_behind_are_made_anew(void **state)
{
    static const float zero[3] = { 0, 0, 0 };
    struct file f;
    struct fixture x;
    (void) state;
    make_triangle(&f);
    document(&f, "\"nodes\":[{\"mesh\":0}]," TRIANGLE("\"weights\":[0.5],", "[{\"POSITION\":3}]"));
    read_at(&x, &f, -1.0);
    assert_memory_equal(x.scene->meshes[0].normal, zero, sizeof(zero));
    assert_null(x.scene->meshes[0].tangent);
    assert_int_equal(x.kept.warnings, 0);
    finish(&x);
    /* a target without displacement keeps them */
    document(&f, "\"nodes\":[{\"mesh\":0}]," TRIANGLE("\"weights\":[1],", "[{\"NORMAL\":4}]"));
    read_at(&x, &f, -1.0);
    require_vec(x.scene->meshes[0].normal + 6, 0, 0, 1, 1e-6);
    assert_non_null(x.scene->meshes[0].tangent);
    finish(&x);
}

static void bad_targets_are_refused(void **state)
{
#define MESH(weights, targets) "\"nodes\":[{\"mesh\":0}]," TRIANGLE(weights, targets)
    static const struct {
        const char *where, *what, *rest;
    } cases[] = {
        { "/primitives/0/targets", "allowed", MESH("", "[]") },
        { "/primitives/0/targets/0", "allowed: an object", MESH("", "[3]") },
        { "/targets/0/POSITION", "is 77", MESH("", "[{\"POSITION\":77}]") },
        { "/targets/0/POSITION", "\"VEC4\", allowed: \"VEC3\"", MESH("\"weights\":[0],", "[{\"POSITION\":2}]") },
        { "/targets/0/NORMAL", "2 elements, allowed: 3", MESH("\"weights\":[0],", "[{\"NORMAL\":7}]") },
        { "/targets/0/TANGENT", "TANGENT 1 has y = nan", MESH("\"weights\":[1],", "[{\"TANGENT\":8}]") },
        { "/meshes/0/weights", "allowed", MESH("\"weights\":[1],", "[{\"POSITION\":3},{\"POSITION\":3}]") },
        { "/nodes/0/weights", "allowed", "\"nodes\":[{\"mesh\":0,\"weights\":[1,2,3]}]," TRIANGLE("", "[{\"POSITION\":3}]") },
        { "/primitives/1/targets", "2 morph targets, allowed: 1",
          "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"targets\":[{\"POSITION\":3}]},"
          "{\"attributes\":{\"POSITION\":0},\"targets\":[{\"POSITION\":3},{\"POSITION\":3}]}]}]" },
        { "/primitives/1", "0 morph targets, allowed: 1",
          "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"targets\":[{\"POSITION\":3}]},"
          "{\"attributes\":{\"POSITION\":0}}]}]" },
    };
    struct pell_limits limits;
    struct file f;
    struct fixture x;
    (void) state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        make_triangle(&f);
        document(&f, cases[i].rest);
        refuse_at(PELL_ERR_FORMAT, cases[i].where, cases[i].what, &f, NULL);
    }
    /* the work is limited before it is done: 3 targets x 3 vertices and their weights */
    pell_knobs_default(pell_limit_knobs(), &limits);
    make_triangle(&f);
    document(&f,
             "\"nodes\":[{\"mesh\":0,\"weights\":[1,1,1]},{\"mesh\":0,\"weights\":[1,1,1]},{\"mesh\":0,\"weights\":[1,1,1]},{\"mesh\":0,"
             "\"weights\":[1,1,1]},{\"mesh\":0,\"weights\":[1,1,1]}]," TRIANGLE("", "[{\"NORMAL\":3},{\"NORMAL\":3},{\"NORMAL\":3}]"));
    limits.vertices = 15; /* x 16 is 240 >= 5 x (3 + 9) */
    read_limited(&x, &f, NULL, &limits, 0);
    assert_int_equal(x.res, PELL_OK);
    finish(&x);
    document(&f,
             "\"nodes\":[{\"mesh\":0,\"weights\":[1,1,1,1,1,1,1,1,1,1,1,1,1]}]," TRIANGLE(
                 "",
                 "[{\"NORMAL\":3},{\"NORMAL\":3},{\"NORMAL\":3},"
                 "{\"NORMAL\":3},{\"NORMAL\":3},{\"NORMAL\":3},{\"NORMAL\":3},{\"NORMAL\":3},{\"NORMAL\":3},{\"NORMAL\":3},{\"NORMAL\":3},"
                 "{\"NORMAL\":3},{\"NORMAL\":3}]"));
    limits.vertices = 3; /* x 16 is 48 < 13 + 39 */
    read_limited(&x, &f, NULL, &limits, 0);
    assert_int_equal(x.res, PELL_ERR_UNSUPPORTED);
    REQUIRE(strstr(x.kept.where, "/targets/11") && strstr(x.kept.what, "more than 48 vertices"));
    finish(&x);
}

/* --- Animations ------------------------------------------------------------------------------------------------------------- */

/* Appends one animation of one channel; keys at `times`. Returns the rest of the document. */
static const char *animate(struct file *f, const char *path, const char *interpolation, const char *kind, const float *times, int keys,
                           const float *values, int elements)
{
    static char rest[4096];
    const int width = strcmp(kind, "VEC3") == 0 ? 3 : strcmp(kind, "VEC4") == 0 ? 4 : 1;
    const int t = put(f, 5126, "SCALAR", false, times, (size_t) keys * sizeof(float), keys);
    const int v = put(f, 5126, kind, false, values, (size_t) (elements * width) * sizeof(float), elements);

    snprintf(
        rest, sizeof(rest),
        "\"nodes\":[{\"mesh\":0,\"translation\":[0,0,9],\"children\":[1]},{\"mesh\":0}],\"animations\":[{\"name\":\"move\",\"samplers\":"
        "[{\"input\":%d,\"output\":%d,\"interpolation\":\"%s\"}],\"channels\":[{\"sampler\":0,\"target\":{\"node\":0,\"path\":\"%s\"}}]}]"
        "," TRIANGLE("", "[{\"POSITION\":3,\"NORMAL\":4},{\"POSITION\":4,\"NORMAL\":4}]"),
        t, v, interpolation, path);
    return rest;
}

/* The first vertex of node 0's mesh. */
static void require_origin(const struct file *f, double time, double a, double b, double c)
{
    struct fixture x;
    read_at(&x, f, time);
    assert_int_equal(x.scene->num_meshes, 2);
    require_vec(x.scene->meshes[0].position, a, b, c, 1e-5);
    require_vec(x.scene->meshes[1].position, a, b, c, 1e-5); /* its child follows */
    finish(&x);
}

static void steps_hold_and_lines_go_between(void **state)
{
    static const float times[] = { 1, 2, 4 }, values[][3] = { { 0, 0, 0 }, { 2, 0, 0 }, { 2, 8, -4 } };
    struct file f;
    (void) state;
    make_triangle(&f);
    document(&f, animate(&f, "translation", "STEP", "VEC3", times, 3, values[0], 3));
    require_origin(&f, -1.0, 0, 0, 9); /* at rest */
    require_origin(&f, 0.0, 0, 0, 0);  /* before the first key */
    require_origin(&f, 1.999, 0, 0, 0);
    require_origin(&f, 2.0, 2, 0, 0);
    require_origin(&f, 3.999, 2, 0, 0);
    require_origin(&f, 4.0, 2, 8, -4);
    require_origin(&f, 1e9, 2, 8, -4);
    make_triangle(&f);
    document(&f, animate(&f, "translation", "LINEAR", "VEC3", times, 3, values[0], 3));
    require_origin(&f, 0.5, 0, 0, 0);
    require_origin(&f, 1.25, 0.5, 0, 0);
    require_origin(&f, 2.0, 2, 0, 0);
    require_origin(&f, 3.5, 2, 6, -3);
    require_origin(&f, 99.0, 2, 8, -4);
    make_triangle(&f);
    document(&f, animate(&f, "translation", "LINEAR", "VEC3", times, 1, values[1], 1)); /* one key applies at any time */
    require_origin(&f, 0.0, 2, 0, 0);
    require_origin(&f, 7.0, 2, 0, 0);
}

/* Splines through points and tangents of a cubic reproduce that cubic. */
static void splines_are_the_cubic_that_they_are_through(void **state)
{
    static const double keys[] = { 0.5, 1.0, 3.0 };
    float times[3], values[9][3];
    struct file f;
    (void) state;
#define CUBIC(t) (0.5 * (t) * (t) * (t) -2.0 * (t) * (t) + (t) + 1.0)
#define SLOPE(t) (1.5 * (t) * (t) -4.0 * (t) + 1.0)
    for (int i = 0; i < 3; i++) {
        times[i] = (float) keys[i];
        for (int c = 0; c < 3; c++) {
            values[3 * i][c] = values[3 * i + 2][c] = (float) ((c + 1) * SLOPE(keys[i]));
            values[3 * i + 1][c] = (float) ((c + 1) * CUBIC(keys[i]));
        }
    }
    make_triangle(&f);
    document(&f, animate(&f, "translation", "CUBICSPLINE", "VEC3", times, 3, values[0], 9));
    for (double t = 0.5; t <= 3.0; t += 0.171)
        require_origin(&f, t, CUBIC(t), 2 * CUBIC(t), 3 * CUBIC(t));
    require_origin(&f, 0.0, CUBIC(0.5), 2 * CUBIC(0.5), 3 * CUBIC(0.5));
    require_origin(&f, 3.0, CUBIC(3.0), 2 * CUBIC(3.0), 3 * CUBIC(3.0));
    require_origin(&f, 5.0, CUBIC(3.0), 2 * CUBIC(3.0), 3 * CUBIC(3.0));
}

static void require_turn(const struct file *f, double time, double degrees, double tolerance)
{
    struct fixture x;
    read_at(&x, f, time);
    require_vec(x.scene->meshes[0].position + 3, cos(degrees * PELL_PI / 180), sin(degrees * PELL_PI / 180), 9, tolerance);
    finish(&x);
}

static void rotations_go_the_short_way_at_one_speed(void **state)
{
    const float s = sqrtf(0.5f);
    const float times[] = { 0, 3 }, quarter[][4] = { { 0, 0, 0, 1 }, { 0, 0, s, s } }, far[][4] = { { 0, 0, 0, 1 }, { 0, 0, -s, -s } },
                still[][4] = { { 0, 0, s, s }, { 0, 0, -s, -s } }, unscaled[][4] = { { 0, 0, 0, 2 }, { 0, 0, 3, 3 } },
                spline[][4] = { { 0 }, { 0, 0, 0, 1 }, { 0 }, { 0 }, { 0, 0, 1, 0 }, { 0 } };
    static const int16_t shorts[][4] = { { 0, 0, 0, 32767 }, { 0, 0, 23170, 23170 } };
    struct file f;
    int t, v;
    char rest[1024];
    (void) state;
    make_triangle(&f);
    document(&f, animate(&f, "rotation", "LINEAR", "VEC4", times, 2, quarter[0], 2));
    require_turn(&f, 0.0, 0, 1e-6);
    require_turn(&f, 1.0, 30, 1e-6);
    require_turn(&f, 2.5, 75, 1e-6);
    require_turn(&f, 3.0, 90, 1e-6);
    make_triangle(&f);
    document(&f, animate(&f, "rotation", "LINEAR", "VEC4", times, 2, far[0], 2)); /* -q is q */
    require_turn(&f, 1.0, 30, 1e-6);
    make_triangle(&f);
    document(&f, animate(&f, "rotation", "LINEAR", "VEC4", times, 2, still[0], 2));
    require_turn(&f, 1.7, 90, 1e-6);
    make_triangle(&f);
    document(&f, animate(&f, "rotation", "LINEAR", "VEC4", times, 2, unscaled[0], 2));
    require_turn(&f, 1.0, 30, 1e-6);
    make_triangle(&f);
    document(&f, animate(&f, "rotation", "CUBICSPLINE", "VEC4", times, 2, spline[0], 6)); /* half of each, normalised: a quarter turn */
    require_turn(&f, 1.5, 90, 1e-6);
    make_triangle(&f);
    t = FLOATS(&f, "SCALAR", times, 2);
    v = put(&f, 5122, "VEC4", true, shorts, sizeof(shorts), 2);
    snprintf(rest, sizeof(rest),
             "\"nodes\":[{\"mesh\":0,\"translation\":[0,0,9]}],\"animations\":[{\"samplers\":[{\"input\":%d,\"output\":%d}],\"channels\":"
             "[{\"sampler\":0,\"target\":{\"node\":0,\"path\":\"rotation\"}}]}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":"
             "0}}]}]",
             t, v);
    document(&f, rest);
    require_turn(&f, 1.0, 30, 1e-4);
}

static void weights_are_animated(void **state)
{
    static const float times[] = { 0, 1 }, values[] = { 0, 0, 1, 0.5f };
    struct file f;
    struct fixture x;
    (void) state;
    make_triangle(&f);
    document(&f, animate(&f, "weights", "LINEAR", "SCALAR", times, 2, values, 4));
    read_at(&x, &f, 0.5);
    require_vec(x.scene->meshes[0].position, 0.5, 0, 0.5 + 9, 1e-6);
    require_vec(x.scene->meshes[0].position + 3, 1, 0.5, 1 + 9, 1e-6);
    require_vec(x.scene->meshes[1].position, 0, 0, 9, 1e-6); /* the same mesh, of a node that is not animated */
    finish(&x);
    read_at(&x, &f, 0.0);
    require_vec(x.scene->meshes[0].position + 3, 1, 0, 9, 0.0);
    finish(&x);
}

static void animations_are_chosen_by_name_or_number(void **state)
{
    static const float zero[] = { 0 }, one[] = { 1, 0, 0 }, two[] = { 2, 0, 0 };
    static const struct {
        const char *name;
        double x;
    } cases[] = { { NULL, 1 }, { "walk", 1 }, { "1", 2 }, { "0", 1 }, { "run", 2 } };
    struct file f;
    struct fixture x;
    char rest[2048];
    int t, a, b;
    (void) state;
    make_triangle(&f);
    t = FLOATS(&f, "SCALAR", zero, 1);
    a = FLOATS(&f, "VEC3", one, 1);
    b = FLOATS(&f, "VEC3", two, 1);
    snprintf(
        rest, sizeof(rest),
        "\"nodes\":[{\"mesh\":0}],\"animations\":[{\"name\":\"walk\",\"samplers\":[{\"input\":%d,\"output\":%d}],\"channels\":[{"
        "\"sampler\":0,"
        "\"target\":{\"node\":0,\"path\":\"translation\"}},{\"sampler\":0,\"target\":{\"path\":\"scale\"}},{\"sampler\":0,\"target\":{"
        "\"path\":"
        "\"pointer\"}}]},{\"name\":\"run\",\"samplers\":[{\"input\":%d,\"output\":%d}],\"channels\":[{\"sampler\":0,\"target\":{\"node\":0,"
        "\"path\":\"translation\"}}]}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]",
        t, a, t, b);
    document(&f, rest);
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        read_limited(&x, &f, &(struct pell_moment) { .timed = true, .animation = cases[i].name, .where = "--animation" }, NULL, 0);
        assert_int_equal(x.res, PELL_OK);
        require_vec(x.scene->meshes[0].position, cases[i].x, 0, 0, 0.0);
        finish(&x);
    }
    refuse_at(PELL_ERR_INVALID, "--animation", "no animation \"wlak\"", &f,
              &(struct pell_moment) { .timed = true, .animation = "wlak", .where = "--animation" });
    refuse_at(PELL_ERR_INVALID, "--animation", "which has 2", &f,
              &(struct pell_moment) { .timed = true, .animation = "2", .where = "--animation" });
}

/* An arm of two nodes, the second a joint: a skin follows the animation. */
static void skins_follow_animated_joints(void **state)
{
    const float s = sqrtf(0.5f), times[] = { 0, 2 }, turn[][4] = { { 0, 0, -s, s }, { 0, 0, 1, 0 } }; /* -90 to 180 degrees, by 270 */
    struct file f;
    struct fixture x;
    char rest[2048];
    int t, v;
    (void) state;
    make_bar(&f, WEIGHT_FLOAT, NULL, NULL);
    t = FLOATS(&f, "SCALAR", times, 2);
    v = put(&f, 5126, "VEC4", false, turn, sizeof(turn), 2);
    snprintf(rest, sizeof(rest),
             BAR_SKIN BAR_NODES(
                 "[0,0,0,1]") "\"animations\":[{\"samplers\":[{\"input\":%d,\"output\":%d,\"interpolation\":\"STEP\"},{\"input\":%d,"
                              "\"output\":%d}],\"channels\":[{\"sampler\":1,\"target\":{\"node\":2,\"path\":\"rotation\"}}]}]," BAR_MESH,
             t, v, t, v);
    document(&f, rest);
    read_at(&x, &f, 2.0 / 3.0 * 2.0); /* the shorter direction: -90 -> -180; two thirds: -150 */
    require_vec(x.scene->meshes[0].position + 12, -sin(-150 * PELL_PI / 180), 1 + cos(-150 * PELL_PI / 180), 0, 1e-6);
    finish(&x);
}

static void bad_animations_are_refused(void **state)
{
    static const float times[] = { 0, 1 }, twice[] = { 1, 1 }, back[] = { 2, 1 }, negative[] = { -1, 1 }, wild[] = { 0, NAN },
                       values[2][4] = { { 0, 0, 0, 1 }, { 0, 0, 0, 0 } };
    static const uint16_t integers[2] = { 0, 1 };
#define CHANNEL(node, path) "{\"sampler\":0,\"target\":{\"node\":" node ",\"path\":\"" path "\"}}"
#define PLAY(node, sampler, channels)                                                                                                      \
    "\"nodes\":[" node "],\"animations\":[{\"samplers\":[" sampler "],\"channels\":[" channels "]}]," TRIANGLE("", "[{\"POSITION\":3}]")
#define FREE "{\"mesh\":0}"
    /* 9 times, 10 twice, 11 back, 12 negative, 13 wild, 14 integers, 15 two quaternions of which one is 0, 16 a vector 3, 17 two of them */
    static const struct {
        const char *where, *what, *rest;
    } cases[] = {
        { "/animations/0", "has no \"samplers\"", "\"nodes\":[{}],\"animations\":[{\"channels\":[]}]" },
        { "/animations/0", "has no \"channels\"", "\"nodes\":[{}],\"animations\":[{\"samplers\":[{}]}]" },
        { "/animations/0/channels", "allowed", PLAY(FREE, "{}", "") },
        { "/channels/0/sampler", "is 3, allowed: [0, 0]", PLAY(FREE, "{}", "{\"sampler\":3,\"target\":{\"node\":0,\"path\":\"scale\"}}") },
        { "/channels/0", "has no \"target\"", PLAY(FREE, "{}", "{\"sampler\":0}") },
        { "/channels/0/target", "has no \"path\"", PLAY(FREE, "{}", "{\"sampler\":0,\"target\":{\"node\":0}}") },
        { "/channels/0/target/path", "translation", PLAY(FREE, "{}", CHANNEL("0", "translations")) },
        { "/channels/0/target/node", "is 5", PLAY(FREE, "{}", CHANNEL("5", "scale")) },
        { "/channels/1/target/path", "moves the scale of node 0 already",
          PLAY(FREE, "{\"input\":9,\"output\":17}", CHANNEL("0", "scale") "," CHANNEL("0", "scale")) },
        { "/samplers/0", "has no \"input\"", PLAY(FREE, "{}", CHANNEL("0", "scale")) },
        { "/samplers/0", "has no \"output\"", PLAY(FREE, "{\"input\":9}", CHANNEL("0", "scale")) },
        { "/samplers/0/input", "is 88", PLAY(FREE, "{\"input\":88}", CHANNEL("0", "scale")) },
        { "/samplers/0/interpolation", "LINEAR",
          PLAY(FREE, "{\"input\":9,\"output\":17,\"interpolation\":\"BEZIER\"}", CHANNEL("0", "scale")) },
        { "/samplers/0/input", "key 1 is at 1 s, not after", PLAY(FREE, "{\"input\":10,\"output\":17}", CHANNEL("0", "scale")) },
        { "/samplers/0/input", "key 1 is at 1 s, not after", PLAY(FREE, "{\"input\":11,\"output\":17}", CHANNEL("0", "scale")) },
        { "/samplers/0/input", "key 0 is at -1 s", PLAY(FREE, "{\"input\":12,\"output\":17}", CHANNEL("0", "scale")) },
        { "/samplers/0/input", "is nan", PLAY(FREE, "{\"input\":13,\"output\":17}", CHANNEL("0", "scale")) },
        { "/samplers/0/input", "allowed: SCALAR of 5126", PLAY(FREE, "{\"input\":14,\"output\":17}", CHANNEL("0", "scale")) },
        { "/samplers/0/input", "allowed: SCALAR of 5126", PLAY(FREE, "{\"input\":0,\"output\":17}", CHANNEL("0", "scale")) },
        { "/samplers/0/output", "allowed for scale: 3 of 5126", PLAY(FREE, "{\"input\":9,\"output\":15}", CHANNEL("0", "scale")) },
        { "/samplers/0/output", "allowed for rotation: 4 of 5126 or", PLAY(FREE, "{\"input\":9,\"output\":17}", CHANNEL("0", "rotation")) },
        { "/samplers/0/output", "1 elements, allowed: 2 for 2 keys of scale",
          PLAY(FREE, "{\"input\":9,\"output\":16}", CHANNEL("0", "scale")) },
        { "/samplers/0/output", "2 elements, allowed: 6 for 2 keys of scale with two tangents",
          PLAY(FREE, "{\"input\":9,\"output\":17,\"interpolation\":\"CUBICSPLINE\"}", CHANNEL("0", "scale")) },
        { "/samplers/0/output", "3 elements", PLAY(FREE, "{\"input\":9,\"output\":18}", CHANNEL("0", "weights")) },
        { "/channels/0", "the quaternion has length 0", PLAY(FREE, "{\"input\":9,\"output\":15}", CHANNEL("0", "rotation")) },
        { "/nodes/0/matrix", "an animation moves the node",
          PLAY("{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}", "{\"input\":9,\"output\":17}", CHANNEL("0", "scale")) },
        { "/nodes/0", "its mesh has no morph targets",
          "\"nodes\":[{\"mesh\":0}],\"animations\":[{\"samplers\":[{\"input\":9,\"output\":9}],\"channels\":[" CHANNEL(
              "0", "weights") "]}],"
                              "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]" },
    };
    static const float thirds[] = { 0, 1, 2 };
    struct file f;
    (void) state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        make_triangle(&f);
        FLOATS(&f, "SCALAR", times, 2);
        FLOATS(&f, "SCALAR", twice, 2);
        FLOATS(&f, "SCALAR", back, 2);
        FLOATS(&f, "SCALAR", negative, 2);
        FLOATS(&f, "SCALAR", wild, 2);
        put(&f, 5123, "SCALAR", false, integers, sizeof(integers), 2);
        FLOATS(&f, "VEC4", values, 2);
        put(&f, 5126, "VEC3", false, values, 12, 1);
        put(&f, 5126, "VEC3", false, values, 24, 2);
        FLOATS(&f, "SCALAR", thirds, 3);
        document(&f, cases[i].rest);
        refuse_at(PELL_ERR_FORMAT, cases[i].where, cases[i].what, &f, &(struct pell_moment) { .timed = true, .time = 1.0 });
    }
}

/* --- All together ----------------------------------------------------------------------------------------------------------- */

/* A bar with a skin, a morph target and an animation of both. */
static void make_all(struct file *f)
{
    static const float times[] = { 0, 1 }, weights[] = { 0, 1 }, turn[][4] = { { 0, 0, 0, 1 }, { 0, 0, 1, 0 } };
    char rest[2048];
    int t, w, q;

    make_bar(f, WEIGHT_BYTE, NULL, NULL);
    t = FLOATS(f, "SCALAR", times, 2);
    w = FLOATS(f, "SCALAR", weights, 2);
    q = FLOATS(f, "VEC4", turn, 2);
    snprintf(rest, sizeof(rest),
             BAR_SKIN BAR_NODES(
                 "[0,0,0,1]") "\"animations\":[{\"samplers\":[{\"input\":%d,\"output\":%d},{\"input\":%d,\"output\":%d}],\"channels\":"
                              "[{\"sampler\":0,\"target\":{\"node\":0,\"path\":\"weights\"}},{\"sampler\":1,\"target\":{\"node\":2,"
                              "\"path\":\"rotation\"}}]}],"
                              "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,\"TANGENT\":2,\"JOINTS_0\":5,"
                              "\"WEIGHTS_0\":6},"
                              "\"indices\":3,\"targets\":[{\"POSITION\":1,\"NORMAL\":1,\"TANGENT\":1}]}]}]",
             t, w, t, q);
    document(f, rest);
}

static void targets_come_before_joints(void **state)
{
    struct file f;
    struct fixture x;
    (void) state;
    make_all(&f);
    read_at(&x, &f, 0.5); /* the top moves along x by a half, then rotates by a right angle */
    require_vec(x.scene->meshes[0].position + 12, -1, 1.5, 0, 1e-6);
    finish(&x);
}

static void no_allocation_may_fail_unseen(void **state)
{
    const struct pell_moment moment = { .timed = true, .time = 0.5 };
    struct file f;
    struct fixture x;
    uint64_t n = 1;
    (void) state;
    make_all(&f);
    for (;; n++) {
        read_limited(&x, &f, &moment, NULL, n);
        if (x.res == PELL_OK)
            break;
        assert_int_equal(x.res, PELL_ERR_NOMEM);
        finish(&x);
    }
    finish(&x);
    REQUIRE(n > 20);
}

/* Whichever byte of the document or the data is changed, it is read or refused, without an access out of bounds. */
static void changed_bytes_are_read_or_refused(void **state)
{
    static const char put_in[] = "9-0]}{,\"e.";
    const struct pell_moment moment = { .timed = true, .time = 0.5 };
    struct pell_limits limits;
    struct file f;
    struct fixture x;
    (void) state;
    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.memory_bytes = 16 << 20;
    limits.vertices = limits.triangles = 10000;
    make_all(&f);
    for (size_t i = 0; i < strlen(f.json); i += 3) {
        const char was = f.json[i];
        f.json[i] = put_in[(i / 3) % (sizeof(put_in) - 1)];
        read_limited(&x, &f, &moment, &limits, 0);
        assert_int_equal(x.kept.errors, x.res != PELL_OK);
        finish(&x);
        f.json[i] = was;
    }
    for (size_t i = 0; i < f.size; i++) {
        const uint8_t was = f.bin[i];
        f.bin[i] = (uint8_t) (i % 2 ? 0xff : was ^ 0x80);
        read_limited(&x, &f, &moment, &limits, 0);
        assert_int_equal(x.kept.errors, x.res != PELL_OK);
        finish(&x);
        f.bin[i] = was;
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_bar_bends_at_its_joint),
        cmocka_unit_test(a_skin_at_rest_is_the_mesh),
        cmocka_unit_test(weights_need_not_be_of_sum_one),
        cmocka_unit_test(eight_joints_move_a_vertex),
        cmocka_unit_test(joints_that_mirror_turn_triangles),
        cmocka_unit_test(bad_skins_are_refused),
        cmocka_unit_test(targets_are_added_by_their_weights),
        cmocka_unit_test(there_may_be_many_targets),
        cmocka_unit_test(weights_of_zero_leave_the_base),
        cmocka_unit_test(normals_that_a_target_leaves_behind_are_made_anew),
        cmocka_unit_test(bad_targets_are_refused),
        cmocka_unit_test(steps_hold_and_lines_go_between),
        cmocka_unit_test(splines_are_the_cubic_that_they_are_through),
        cmocka_unit_test(rotations_go_the_short_way_at_one_speed),
        cmocka_unit_test(weights_are_animated),
        cmocka_unit_test(animations_are_chosen_by_name_or_number),
        cmocka_unit_test(skins_follow_animated_joints),
        cmocka_unit_test(bad_animations_are_refused),
        cmocka_unit_test(targets_come_before_joints),
        cmocka_unit_test(no_allocation_may_fail_unseen),
        cmocka_unit_test(changed_bytes_are_read_or_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
