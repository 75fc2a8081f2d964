/* SPDX-License-Identifier: MIT
 * test_ply.c - PLY in its three encodings: arbitrary properties, polygons, strips; false headers and damaged bodies. */
#include "scene_test.h"
#include "slow.h"

#include "image/color.h"

/* --- Writing in any encoding ------------------------------------------------------------------------------------------------------ */

enum encoding { ASCII, LITTLE, BIG };

struct writer {
    enum encoding encoding;
    uint8_t data[4096];
    size_t size;
};

static void put_text(struct writer *w, const char *text)
{
    memcpy(w->data + w->size, text, strlen(text));
    w->size += strlen(text);
}

static void put_bytes(struct writer *w, const void *value, size_t size)
{
    const uint16_t one = 1;
    const bool swap = (w->encoding == BIG) == (*(const uint8_t *) &one == 1);

    for (size_t i = 0; i < size; i++)
        w->data[w->size++] = ((const uint8_t *) value)[swap ? size - 1 - i : i];
}

static void put_int(struct writer *w, int64_t value, size_t size)
{
    const int8_t i8 = (int8_t) value;
    const int16_t i16 = (int16_t) value;
    const int32_t i32 = (int32_t) value;
    char text[32];

    if (w->encoding == ASCII) {
        snprintf(text, sizeof(text), "%lld ", (long long) value);
        put_text(w, text);
    } else {
        put_bytes(w, size == 1 ? (const void *) &i8 : size == 2 ? (const void *) &i16 : &i32, size);
    }
}

static void put_real(struct writer *w, double value, size_t size)
{
    const float f = (float) value;
    char text[40];

    if (w->encoding == ASCII) {
        snprintf(text, sizeof(text), "%.17g ", value);
        put_text(w, text);
    } else {
        put_bytes(w, size == 4 ? (const void *) &f : &value, size);
    }
}

static void put_header(struct writer *w, enum encoding encoding, const char *rest)
{
    static const char *const names[] = { "ascii", "binary_little_endian", "binary_big_endian" };

    w->encoding = encoding;
    w->size = 0;
    put_text(w, "ply\nformat ");
    put_text(w, names[encoding]);
    put_text(w, " 1.0\ncomment with a backslash \\\n");
    put_text(w, rest);
    put_text(w, "end_header\n");
}

/* A pentagon, a triangle and a quad over 6 vertices, with all other elements that may surround them. */
static void write_all(struct writer *w, enum encoding encoding)
{
    static const double points[6][3] = { { 0, 0, 0 }, { 2, 0, 0 }, { 3, 1.5, 0 }, { 1, 3, 0 }, { -1, 1.5, 0 }, { 1, 1, 4 } };

    put_header(w, encoding,
               "element camera 2\nproperty list uint8 float junk\nproperty short tail\nelement empty 1000000000000\n"
               "element vertex 6\nproperty uchar red\nproperty double z\nproperty list ushort int marks\nproperty float x\n"
               "property uchar green\nproperty uint8 blue\nproperty float32 y\nproperty float s\nproperty float t\nproperty int16 flags\n"
               "element face 3\nproperty uchar group\nproperty list int uint16 vertex_indices\nproperty list uchar float texcoord\n"
               "element tail 1\nproperty int x\n");
    for (int i = 0; i < 2; i++) {
        put_int(w, i, 1);
        for (int k = 0; k < i; k++)
            put_real(w, 1.5, 4);
        put_int(w, -7, 2);
    }
    for (int i = 0; i < 6; i++) {
        put_int(w, 255, 1);
        put_real(w, points[i][2], 8);
        put_int(w, i % 3, 2);
        for (int k = 0; k < i % 3; k++)
            put_int(w, -100000 * k, 4);
        put_real(w, points[i][0], 4);
        put_int(w, 0, 1);
        put_int(w, 128, 1);
        put_real(w, points[i][1], 4);
        put_real(w, 0.25, 4);
        put_real(w, 0.125 * i, 4);
        put_int(w, -1, 2);
    }
    {
        static const int faces[3][6] = { { 5, 4, 3, 2, 1, 0 }, { 3, 0, 1, 5 }, { 4, 1, 2, 3, 5 } };
        for (int i = 0; i < 3; i++) {
            put_int(w, 3, 1);
            put_int(w, faces[i][0], 4);
            for (int k = 0; k < faces[i][0]; k++)
                put_int(w, faces[i][1 + k], 2);
            put_int(w, 1, 1);
            put_real(w, 0.5, 4);
        }
    }
    put_int(w, 42, 4);
}

static struct pell_scene *load(struct pell_context *ctx, const void *data, size_t size)
{
    struct pell_scene *s;

    assert_int_equal(load_bytes(ctx, "a.ply", data, size, &bare_mm, NULL, &s), PELL_OK);
    return s;
}

static void all_encodings_give_the_same(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scenes[3];
    (void) state;

    for (int e = 0; e < 3; e++) {
        struct writer w;
        write_all(&w, (enum encoding) e);
        scenes[e] = load(ctx, w.data, w.size);
    }
    assert_int_equal(scenes[0]->meshes[0].num_triangles, 3 + 1 + 2);
    for (int e = 0; e < 3; e++) {
        const struct pell_mesh *a = &scenes[0]->meshes[0], *b = &scenes[e]->meshes[0];
        assert_int_equal(a->num_vertices, b->num_vertices);
        assert_memory_equal(a->position, b->position, a->num_vertices * 3 * sizeof(float));
        assert_memory_equal(a->normal, b->normal, a->num_vertices * 3 * sizeof(float));
        assert_memory_equal(a->uv[0], b->uv[0], a->num_vertices * 2 * sizeof(float));
        assert_memory_equal(a->color, b->color, a->num_vertices * 4 * sizeof(float));
        assert_memory_equal(a->index, b->index, a->num_triangles * 3 * sizeof(uint32_t));
    }
    {
        const struct pell_mesh *m = &scenes[2]->meshes[0];
        REQUIRE_NEAR(m->position[3 * 3 + 1], 3.0, 0);
        REQUIRE_NEAR(m->uv[0][2 * 3 + 1], 1.0 - 0.375, 0);
        REQUIRE_NEAR(m->color[0], 1.0, 0);
        REQUIRE_NEAR(m->color[1], 0.0, 0);
        REQUIRE_NEAR(m->color[2], pell_srgb_u8[128], 1e-6);
        REQUIRE_NEAR(m->color[3], 1.0, 0);
        /* The file names no material: marble, in these colours. */
        assert_string_equal(scenes[2]->materials[m->material].preset, "marble");
        assert_int_equal(scenes[2]->materials[m->material].color_from, PELL_COLOR_FROM_TEXTURE);
        REQUIRE_NEAR(scenes[2]->materials[m->material].base_color[0], 1.0, 0);
    }
    for (int e = 0; e < 3; e++)
        pell_scene_destroy(&scenes[e]);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void strips_turn_every_other_triangle(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    (void) state;

    for (int e = 0; e < 3; e++) {
        static const int strip[] = { 0, 1, 2, 3, -1, 2, 3, 4, 5, 5, -1, -1, 0, 1, -1, 0, 2, 4 };
        struct writer w;
        struct pell_scene *s;
        put_header(&w, (enum encoding) e,
                   "element vertex 6\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\n"
                   "property list int int vertex_indices\n");
        for (int i = 0; i < 6; i++) {
            put_real(&w, i % 2, 4);
            put_real(&w, -(i / 2), 4);
            put_real(&w, 0, 4);
        }
        put_int(&w, (int64_t) PELL_COUNT(strip), 4);
        for (size_t i = 0; i < PELL_COUNT(strip); i++)
            put_int(&w, strip[i], 4);
        s = load(ctx, w.data, w.size);
        /* Four of the ladder; the one along its side has no area but is kept. */
        assert_int_equal(s->meshes[0].num_triangles, 5);
        for (int i = 0; i < 4; i++) {
            const uint32_t *v = s->meshes[0].index + 3 * i;
            const float *a = s->meshes[0].position + 3 * v[0], *b = s->meshes[0].position + 3 * v[1], *c = s->meshes[0].position + 3 * v[2];
            REQUIRE_NEAR((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]), -1.0, 1e-6);
        }
        pell_scene_destroy(&s);
    }
    pell_context_destroy(&ctx);
}

/* --- Refusals ------------------------------------------------------------------------------------------------------------------- */

#define XYZ "property float x\nproperty float y\nproperty float z\n"
#define LIST "property list uchar int vertex_indices\n"

static void lying_headers_are_refused_at_once(void **state)
{
    static const struct {
        const char *text, *what;
        enum pell_result code;
    } bad[] = {
        { "ply\nformat ascii 1.0\nelement vertex 1000000000000\n" XYZ "element face 1\n" LIST "end_header\n0 0 0\n",
          "announces 1000000000000 rows", PELL_ERR_FORMAT },
        { "ply\nformat binary_little_endian 1.0\nelement vertex 3\n" XYZ "element face 4000000000\n" LIST "end_header\n0123456789abcdef",
          "can't fit", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 9007199254740993000\n" XYZ "end_header\n", "count of an element", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex -1\n" XYZ "end_header\n", "count of an element", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 1.5\n" XYZ "end_header\n", "count of an element", PELL_ERR_FORMAT },
        { "ply\nformat utf8 1.0\n", "the format must be", PELL_ERR_FORMAT },
        { "ply\nelement vertex 1\n" XYZ "end_header\n", "names no format", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\n", "type of a property", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 1\nproperty list float int x\n", "list's length", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nproperty float x\n", "element must come before", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 0\n" XYZ "element vertex 0\nend_header\n", "declared once", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement face 0\n" LIST "end_header\n1\n",
          "no y, must have x, y and z", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 1\n" XYZ "end_header\n0 0 0\n", "has no faces", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 1\n" XYZ "element face 0\n" LIST "end_header\n0 0 0\n", "holds no faces",
          PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nhello\nend_header\n", "a line of the header", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 1\n", "no end_header", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement face 1\n" LIST "element vertex 3\n" XYZ "end_header\n3 0 1 2\n0 0 0\n1 0 0\n0 1 0\n",
          "come before", PELL_ERR_UNSUPPORTED },
        { "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ "element face 1\n" LIST "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n",
          "refers to vertex 3, allowed: 0 to 2", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ "element face 1\n" LIST "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n",
          "refers to vertex -1", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ "element face 1\n" LIST "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 0.5\n",
          "refers to vertex 0.5", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ "element face 1\n" LIST "end_header\n0 0 0\n1 0 0\n0 1 0\n200 0 1 2\n",
          "length 200", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ "element face 1\n" LIST "end_header\n0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n",
          "z is nan", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ "element face 1\n" LIST "end_header\n0 0 0\n1 0 oops\n0 1 0\n3 0 1 2\n",
          "\"oops\" instead of", PELL_ERR_FORMAT },
        { "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ "element face 1\n" LIST "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0",
          "the file ends here", PELL_ERR_FORMAT },
    };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        struct kept_messages kept = { 0 };
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, &kept);
        struct pell_scene *s;
        const double start = busy_seconds();
        assert_int_equal(load_text(ctx, "bad.ply", bad[i].text, &bare_mm, &s), bad[i].code);
        assert_int_equal(kept.errors, 1);
        if (!strstr(kept.what, bad[i].what))
            fail_msg("\"%s\" is not in \"%s\"", bad[i].what, kept.what);
        REQUIRE(strncmp(kept.where, "bad.ply", 7) == 0);
        REQUIRE(busy_seconds() - start < 1.0);
        assert_int_equal(pell_memory_used(ctx), 0);
        pell_context_destroy(&ctx);
    }
}

static void damaged_files_end_well(void **state)
{
    uint64_t random = 88172645463325252ull;
    (void) state;

    for (int e = 0; e < 3; e++) {
        struct pell_context *ctx = test_context(NULL, NULL);
        struct pell_scene *s;
        struct writer w, copy;
        write_all(&w, (enum encoding) e);
        for (size_t n = 4; n < w.size; n++) {
            const enum pell_result res = load_bytes(ctx, "a.ply", w.data, n, &in_mm, NULL, &s);
            /* Truncations are detected except within the last bytes, which end the last number or are not needed. */
            if (res == PELL_OK && n + 2 < w.size)
                fail_msg("%zu of %zu bytes were enough", n, w.size);
            pell_scene_destroy(&s);
            REQUIRE(pell_memory_used(ctx) == 0);
        }
        for (int n = 0; n < 4000; n++) {
            copy = w;
            for (int change = 0; change < 1 + n % 4; change++) {
                random ^= random << 13;
                random ^= random >> 7;
                random ^= random << 17;
                copy.data[4 + random % (w.size - 4)] = (uint8_t) (random >> 32);
            }
            if (load_bytes(ctx, "a.ply", copy.data, w.size, &in_mm, NULL, &s) == PELL_OK)
                pell_scene_destroy(&s);
            REQUIRE(!s && pell_memory_used(ctx) == 0);
        }
        pell_context_destroy(&ctx);
    }
}

static void every_failed_allocation_is_survived(void **state)
{
    enum pell_result res = PELL_ERR_NOMEM;
    struct writer w;
    (void) state;

    write_all(&w, BIG);
    for (uint64_t n = 1; res != PELL_OK; n++) {
        struct pell_alloc_fault fault = { .fail_at = n };
        struct pell_context *ctx = test_context(&fault, NULL);
        struct pell_scene *s = NULL;
        if (!ctx)
            continue;
        res = load_bytes(ctx, "a.ply", w.data, w.size, &in_mm, NULL, &s);
        REQUIRE(res == PELL_OK || (res == PELL_ERR_NOMEM && !s));
        pell_scene_destroy(&s);
        pell_context_destroy(&ctx);
        assert_int_equal(atomic_load(&fault.live), 0);
        REQUIRE(n < 1000);
    }
}

/* --- Files of other programs ------------------------------------------------------------------------------------------------------ */

static void spheres_of_two_byte_orders_and_text_agree(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_load_params metres = { .mm_per_unit = 1000.0, .bare = true };
    struct pell_scene *a, *b, *fine;
    (void) state;

    assert_int_equal(pell_scene_load(ctx, project_file("tests/assets/generated/sphere_r20mm_lod3_ascii.ply"), &metres, &a), PELL_OK);
    assert_int_equal(pell_scene_load(ctx, project_file("tests/assets/generated/sphere_r20mm_lod3_be.ply"), &metres, &b), PELL_OK);
    assert_int_equal(pell_scene_load(ctx, project_file("tests/assets/generated/sphere_r20mm.ply"), &metres, &fine), PELL_OK);
    assert_int_equal(a->meshes[0].num_triangles, 1280);
    assert_int_equal(a->meshes[0].num_vertices, 642);
    assert_int_equal(b->meshes[0].num_vertices, 642);
    for (uint32_t i = 0; i < 3 * 642; i++)
        REQUIRE_NEAR(a->meshes[0].position[i], b->meshes[0].position[i], 2e-5);
    assert_memory_equal(a->meshes[0].index, b->meshes[0].index, 1280 * 3 * sizeof(uint32_t));
    assert_int_equal(fine->meshes[0].num_triangles, 20480);
    REQUIRE_NEAR(mesh_area(&fine->meshes[0]), 4 * PELL_PI * 400.0, 3.0);
    pell_scene_destroy(&a);
    pell_scene_destroy(&b);
    pell_scene_destroy(&fine);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_encodings_give_the_same),         cmocka_unit_test(strips_turn_every_other_triangle),
        cmocka_unit_test(lying_headers_are_refused_at_once),   cmocka_unit_test(damaged_files_end_well),
        cmocka_unit_test(every_failed_allocation_is_survived), cmocka_unit_test(spheres_of_two_byte_orders_and_text_agree),
    };
    return cmocka_run_group_tests_name("ply", tests, NULL, NULL);
}
