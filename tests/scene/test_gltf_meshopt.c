/* SPDX-License-Identifier: MIT
 * test_gltf_meshopt.c - buffer views of EXT_meshopt_compression, encoded here by libmeshoptimizer: decoding, refusals, and damaged
 * bytes. */
#include "gltf_test.h"

#include <meshoptimizer.h>

enum { SIDE = 20, VERTICES = SIDE * SIDE, TRIANGLES = 2 * (SIDE - 1) * (SIDE - 1), ROOM = 1 << 16 };

/* A sheet of SIDE x SIDE vertices, and its encoded attributes one after another. */
struct packed {
    float position[VERTICES][3], normal[VERTICES][4];
    uint32_t index[3 * TRIANGLES];
    uint8_t data[ROOM];
    size_t at[4], bytes[3], size; /* offsets and sizes of positions, normals and indices */
};

struct read {
    struct pell_alloc_fault fault;
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_scene *scene;
    enum pell_result res;
};

static void add(struct packed *p, int part, size_t size)
{
    REQUIRE(size > 0);
    p->bytes[part] = size;
    p->at[part + 1] = p->size = (p->at[part] + size + 3) / 4 * 4;
    REQUIRE(p->size < ROOM / 2);
}

/* `exponential`: positions, else as floats. `sequence`: indices as INDICES, else as TRIANGLES. */
static void pack(struct packed *p, bool exponential, bool sequence)
{
    int8_t octahedral[VERTICES][4];
    uint32_t exponents[VERTICES][3];
    uint32_t *to = p->index;

    memset(p, 0, sizeof(*p));
    for (int i = 0; i < VERTICES; i++) {
        const float x = (float) (i % SIDE) / 4.0f, y = (float) (i / SIDE) / 8.0f, z = 0.1f * x * y,
                    length = sqrtf(0.01f * (x * x + y * y) + 1.0f);
        memcpy(p->position[i], (float[]) { x, y, z }, 12);
        memcpy(p->normal[i], (float[]) { -0.1f * y / length, -0.1f * x / length, 1.0f / length, 0.0f }, 16);
    }
    for (uint32_t y = 0; y + 1 < SIDE; y++)
        for (uint32_t x = 0; x + 1 < SIDE; x++) {
            const uint32_t a = y * SIDE + x, quad[6] = { a, a + 1, a + SIDE, a + SIDE, a + 1, a + SIDE + 1 };
            memcpy(to, quad, sizeof(quad));
            to += 6;
        }
    meshopt_encodeFilterExp(exponents, VERTICES, 12, 24, p->position[0]);
    meshopt_encodeFilterOct(octahedral, VERTICES, 4, 8, p->normal[0]);
    add(p, 0, meshopt_encodeVertexBuffer(p->data, ROOM, exponential ? (const void *) exponents : p->position, VERTICES, 12));
    add(p, 1, meshopt_encodeVertexBuffer(p->data + p->at[1], ROOM / 2, octahedral, VERTICES, 4));
    meshopt_encodeIndexVersion(1);
    add(p, 2,
        sequence ? meshopt_encodeIndexSequence(p->data + p->at[2], ROOM / 2, p->index, 3 * TRIANGLES)
                 : meshopt_encodeIndexBuffer(p->data + p->at[2], ROOM / 2, p->index, 3 * TRIANGLES));
}

/* Members of a document that a test may change. */
struct words {
    const char *position_filter, *index_mode, *position_stride, *index_stride;
    size_t position_count, index_count, index_length;
};

static void import(struct read *r, const struct packed *p, const struct words *w, uint64_t fail_at)
{
    struct pell_context_params params = { .log = keep_message, .log_user = &r->kept };
    char json[4096];

    memset(r, 0, sizeof(*r));
    snprintf(
        json, sizeof(json),
        "{\"asset\":{\"version\":\"2.0\"},\"extensionsUsed\":[\"EXT_meshopt_compression\"],"
        "\"extensionsRequired\":[\"EXT_meshopt_compression\"],\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1},\"indices\":2}]}],"
        "\"buffers\":[{\"byteLength\":%zu},{\"byteLength\":65536,\"extensions\":{\"EXT_meshopt_compression\":{\"fallback\":true}}}],"
        "\"bufferViews\":["
        "{\"buffer\":1,\"byteLength\":%d,\"extensions\":{\"EXT_meshopt_compression\":{\"buffer\":0,\"byteOffset\":0,\"byteLength\":%zu,"
        "\"byteStride\":%s,\"count\":%zu,\"mode\":\"ATTRIBUTES\",\"filter\":\"%s\"}}},"
        "{\"buffer\":1,\"byteLength\":%d,\"byteStride\":4,\"extensions\":{\"EXT_meshopt_compression\":{\"buffer\":0,\"byteOffset\":%zu,"
        "\"byteLength\":%zu,\"byteStride\":4,\"count\":%d,\"mode\":\"ATTRIBUTES\",\"filter\":\"OCTAHEDRAL\"}}},"
        "{\"buffer\":1,\"byteLength\":%zu,\"extensions\":{\"EXT_meshopt_compression\":{\"buffer\":0,\"byteOffset\":%zu,"
        "\"byteLength\":%zu,\"byteStride\":%s,\"count\":%zu,\"mode\":\"%s\"}}}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":%d,\"type\":\"VEC3\"},"
        "{\"bufferView\":1,\"componentType\":5120,\"normalized\":true,\"count\":%d,\"type\":\"VEC3\"},"
        "{\"bufferView\":2,\"componentType\":%d,\"count\":%d,\"type\":\"SCALAR\"}]}",
        p->size, 12 * VERTICES, p->bytes[0], w->position_stride ? w->position_stride : "12",
        w->position_count ? w->position_count : VERTICES, w->position_filter, 4 * VERTICES, p->at[1], p->bytes[1], VERTICES,
        3 * (size_t) TRIANGLES * (strcmp(w->index_stride, "2") == 0 ? 2 : 4), p->at[2], w->index_length ? w->index_length : p->bytes[2],
        w->index_stride, w->index_count ? w->index_count : 3 * (size_t) TRIANGLES, w->index_mode, VERTICES, VERTICES,
        strcmp(w->index_stride, "2") == 0 ? 5123 : 5125, 3 * TRIANGLES);
    r->fault.fail_at = fail_at;
    params.allocator = pell_failing_allocator(&r->fault);
    if (pell_context_create(&params, &r->ctx) != PELL_OK) {
        r->res = PELL_ERR_NOMEM;
        return;
    }
    r->res = import_glb(r->ctx, json, p->data, p->size, &r->scene);
}

static void finish(struct read *r)
{
    pell_scene_destroy(&r->scene);
    pell_context_destroy(&r->ctx);
    assert_int_equal(r->fault.live, 0);
}

static void all_modes_and_filters_give_what_was_packed(void **state)
{
    static struct packed p;

    (void) state;
    for (int k = 0; k < 8; k++) {
        const bool exponential = k & 1, sequence = k & 2;
        const struct words w = { .position_filter = exponential ? "EXPONENTIAL" : "NONE",
                                 .index_mode = sequence ? "INDICES" : "TRIANGLES",
                                 .index_stride = k & 4 ? "2" : "4" };
        const struct pell_mesh *m;
        struct read r;
        double off = 0.0, turned = 0.0;
        pack(&p, exponential, sequence);
        import(&r, &p, &w, 0);
        if (r.res != PELL_OK)
            fail_msg("refused: %s: %s", r.kept.where, r.kept.what);
        assert_int_equal(r.kept.warnings, 0);
        assert_int_equal(r.scene->num_meshes, 1);
        m = &r.scene->meshes[0];
        assert_int_equal(m->num_vertices, VERTICES);
        assert_int_equal(m->num_triangles, TRIANGLES);
        for (size_t i = 0; i < VERTICES; i++)
            for (size_t c = 0; c < 3; c++) {
                off = fmax(off, fabs((double) m->position[3 * i + c] - (double) p.position[i][c]));
                turned = fmax(turned, fabs((double) m->normal[3 * i + c] - (double) p.normal[i][c]));
            }
        for (size_t t = 0; t < TRIANGLES; t++) { /* the encoder may rotate the corners of a triangle */
            const uint32_t *is = m->index + 3 * t, *was = p.index + 3 * t;
            const size_t first = is[0] == was[0] ? 0 : is[0] == was[1] ? 1 : 2;
            for (size_t c = 0; c < 3; c++)
                assert_int_equal(is[c], was[(first + c) % 3]);
        }
        print_message("# %s, %s: positions %.2g off, normals %.2g; %zu bytes instead of %d\n", w.position_filter, w.index_mode, off, turned,
                      p.size, VERTICES * 16 + 12 * TRIANGLES);
        REQUIRE(exponential ? off < 1e-5 : off == 0.0);
        REQUIRE(turned < 0.02);
        finish(&r);
    }
}

static void sizes_that_do_not_fit_are_refused_with_their_place(void **state)
{
    static const struct {
        struct words words;
        const char *said;
    } cases[] = {
        { { "NONE", "TRIANGLES", "10", "4" }, "must be a multiple of 4 with mode ATTRIBUTES" },
        { { "QUATERNION", "TRIANGLES", "12", "4" }, "must be 8 with filter QUATERNION" },
        { { "OCTAHEDRAL", "TRIANGLES", "12", "4" }, "must be 4 or 8 with filter OCTAHEDRAL" },
        { { "NONE", "TRIANGLES", "12", "3" }, "must be 2 or 4 with mode TRIANGLES" },
        { { "NONE", "TRIANGLES", "12", "4", .index_count = 3 * TRIANGLES - 1 }, "must be a multiple of 3" },
        { { "NONE", "TRIANGLES", "12", "4", .index_count = 3 * TRIANGLES + 3 }, "bytes are unpacked" },
        { { "NONE", "TRIANGLES", "12", "4", .index_count = 300000000 }, "can't be packed in" },
        { { "NONE", "TRIANGLES", "12", "4", .position_count = 100000000 }, "can't be packed in" },
        { { "NONE", "TRIANGLES", "12", "4", .index_length = 100000 }, "passes the end of buffer" },
        { { "NONE", "INDICES", "12", "4" }, "can't be packed in" },
        { { "NONE", "TRIANGLES", "12", "4", .index_length = TRIANGLES + 10 }, "are no TRIANGLES of" },
        { { "NONE", "SOMETHING", "12", "4" }, "SOMETHING" },
        { { "SOMETHING", "TRIANGLES", "12", "4" }, "SOMETHING" },
    };
    static struct packed p;

    (void) state;
    pack(&p, false, false);
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct read r;
        import(&r, &p, &cases[i].words, 0);
        if (r.res == PELL_OK || !strstr(r.kept.what, cases[i].said) || !strstr(r.kept.where, "/bufferViews/"))
            fail_msg("case %zu: %d, %s: %s, wanted \"%s\"", i, (int) r.res, r.kept.where, r.kept.what, cases[i].said);
        assert_int_equal(r.kept.errors, 1);
        finish(&r);
    }
}

static void damaged_bytes_do_no_harm(void **state)
{
    static struct packed p, damaged;
    const struct words w = { .position_filter = "EXPONENTIAL", .index_mode = "TRIANGLES", .index_stride = "4" };
    uint32_t seed = 1;
    int refused = 0, runs = 0;

    (void) state;
    pack(&p, true, false);
    for (size_t i = 0; i < p.size; i += 1 + p.size / 1000, runs++) {
        struct read r;
        damaged = p;
        seed = seed * 1664525u + 1013904223u;
        damaged.data[i] ^= (uint8_t) (1 + (seed >> 24) % 255);
        import(&r, &damaged, &w, 0);
        refused += r.res != PELL_OK;
        for (size_t k = 0; r.res == PELL_OK && k < 3 * (size_t) r.scene->meshes[0].num_triangles; k++)
            REQUIRE(r.scene->meshes[0].index[k] < r.scene->meshes[0].num_vertices);
        finish(&r);
    }
    print_message("# %d of %d were refused\n", refused, runs);
    REQUIRE(refused > 0);
}

static void any_allocation_may_fail(void **state)
{
    static struct packed p;
    const struct words w = { .position_filter = "NONE", .index_mode = "INDICES", .index_stride = "4" };
    enum pell_result res = PELL_ERR_NOMEM;

    (void) state;
    pack(&p, false, true);
    for (uint64_t n = 1; res != PELL_OK; n++) {
        struct read r;
        REQUIRE(n < 1000);
        import(&r, &p, &w, n);
        res = r.res;
        REQUIRE(res == PELL_OK || res == PELL_ERR_NOMEM);
        finish(&r);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_modes_and_filters_give_what_was_packed),
        cmocka_unit_test(sizes_that_do_not_fit_are_refused_with_their_place),
        cmocka_unit_test(damaged_bytes_do_no_harm),
        cmocka_unit_test(any_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("gltf_meshopt", tests, NULL, NULL);
}
