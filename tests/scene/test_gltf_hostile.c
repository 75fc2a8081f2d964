/* SPDX-License-Identifier: MIT
 * test_gltf_hostile.c - the glTF reader on damaged files and with failing allocations: no crash, no leak, an error that is logged once. */
#include "gltf_test.h"
#include "random.h"
#include "slow.h"

/* A damaged file may still be read; if not, one error says why. Small limits keep each attempt short. */
static enum pell_result try_bytes(const uint8_t *bytes, size_t size, struct pell_alloc_fault *fault)
{
    struct kept_messages kept = { 0 };
    struct pell_alloc_fault none = { 0 };
    struct pell_limits limits;
    struct pell_context_params params = { .log = keep_message, .log_user = &kept, .limits = &limits };
    struct pell_context *ctx;
    struct pell_scene *scene = NULL;
    enum pell_result res;
    uint8_t *exact = malloc(size + 1);

    if (!exact)
        abort();
    memcpy(exact, bytes, size);
    exact[size] = 0;
    if (!fault)
        fault = &none;
    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.vertices = limits.triangles = 100000;
    limits.image_pixels = 1000000;
    params.allocator = pell_failing_allocator(fault);
    res = pell_context_create(&params, &ctx);
    if (res == PELL_OK) {
        res = import_bytes(ctx, "test.glb", ".", exact, size, &scene);
        if (res != PELL_OK && kept.errors != 1)
            fail_msg("result %d with %d errors logged, the last: %s", res, kept.errors, kept.what);
        if (res == PELL_OK && kept.errors != 0)
            fail_msg("success, but an error was logged: %s: %s", kept.where, kept.what);
        for (size_t i = 0; res == PELL_OK && i < scene->num_meshes; i++)
            for (size_t k = 0; k < 3 * (size_t) scene->meshes[i].num_triangles; k++)
                REQUIRE(scene->meshes[i].index[k] < scene->meshes[i].num_vertices);
        pell_scene_destroy(&scene);
        pell_context_destroy(&ctx);
    }
    free(exact);
    if (fault->live != 0)
        fail_msg("%lld blocks are not freed", (long long) fault->live);
    return res;
}

static void every_failing_allocation_is_reported_and_leaks_nothing(void **state)
{
    const struct square square = make_square();
    enum pell_result res = PELL_ERR_NOMEM;
    uint64_t n = 0;
    size_t size;
    uint8_t *glb = make_glb(RICH_JSON, &square, sizeof(square), &size);
    (void) state;
    while (res != PELL_OK) {
        struct pell_alloc_fault fault = { .fail_at = ++n };
        res = try_bytes(glb, size, &fault);
        if (res != PELL_OK && res != PELL_ERR_NOMEM)
            fail_msg("allocation %llu failed: result %d, allowed: out of memory", (unsigned long long) n, res);
    }
    REQUIRE(n > 50);
    free(glb);
}

static void a_glb_cut_at_any_byte_is_refused(void **state)
{
    const struct square square = make_square();
    size_t size;
    uint8_t *glb = make_glb(RICH_JSON, &square, sizeof(square), &size);
    (void) state;
    assert_int_equal(try_bytes(glb, size, NULL), PELL_OK);
    for (size_t n = 0; n < size; n++)
        if (try_bytes(glb, n, NULL) == PELL_OK)
            fail_msg("%zu of %zu bytes were read as a whole file", n, size);
    /* the same with a header that states the shorter length */
    for (size_t n = 20; n < size; n += 7) {
        put32(glb + 8, (uint32_t) n);
        if (try_bytes(glb, n, NULL) == PELL_OK && n + 4 < size - sizeof(square))
            fail_msg("%zu of %zu bytes were read as a whole file", n, size);
    }
    free(glb);
}

static void random_damage_is_read_or_refused(void **state)
{
    static const char *const numbers[] = { "0",     "-1",  "1e9",  "4294967295", "2147483648", "9007199254740993",
                                           "1e300", "0.5", "null", "\"x\"",      "[]",         "{}" };
    const struct square square = make_square();
    uint64_t random = 20011966;
    int read = 0, refused = 0;
    size_t size;
    uint8_t *glb = make_glb(RICH_JSON, &square, sizeof(square), &size), *bytes = malloc(size + 64);
    (void) state;
    assert_non_null(bytes);
    for (int i = 0; i < 6000; i++) {
        size_t length = size;
        memcpy(bytes, glb, size);
        if (i % 2) {
            /* bytes at any position */
            for (int k = (int) (random_bits(&random) % 4); k >= 0; k--)
                bytes[random_bits(&random) % length] = (uint8_t) random_bits(&random);
        } else {
            /* a number of the JSON is replaced; the lengths in the headers are adjusted */
            const char *put = numbers[random_bits(&random) % PELL_COUNT(numbers)];
            const size_t json = sizeof(RICH_JSON) - 1, add = strlen(put);
            size_t at = 20 + random_bits(&random) % json, end;
            while (at < 20 + json && !(bytes[at] >= '0' && bytes[at] <= '9' && strchr(":,[", bytes[at - 1])))
                at++;
            for (end = at; end < 20 + json && strchr("0123456789.", bytes[end]);)
                end++;
            memcpy(bytes + at, put, add);
            memcpy(bytes + at + add, glb + end, size - end);
            length = size - (end - at) + add;
            put32(bytes + 8, (uint32_t) length);
            put32(bytes + 12, (uint32_t) (length - size) + glb[12] + 256u * glb[13]);
        }
        if (try_bytes(bytes, length, NULL) == PELL_OK)
            read++;
        else
            refused++;
    }
    /* both outcomes occur often, or the damage tests nothing */
    REQUIRE(read > 300 && refused > 300);
    free(bytes);
    free(glb);
}

static void damaged_binary_data_is_never_trusted(void **state)
{
    static const char json[] =
        "{\"asset\":{\"version\":\"2.0\"}," SQUARE_BUFFERS SQUARE_ACCESSORS
        "\"nodes\":[{\"mesh\":0,\"scale\":[1e3,-1,1],\"extensions\":{\"EXT_mesh_gpu_instancing\":{\"attributes\":{\"TRANSLATION\":7}}}}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":6,\"NORMAL\":1,\"TANGENT\":2,\"TEXCOORD_0\":3,\"COLOR_0\":4},"
        "\"indices\":5}]}]}";
    uint64_t random = 7;
    int read = 0;
    (void) state;
    for (int i = 0; i < 2000; i++) {
        struct square square = make_square();
        size_t size;
        uint8_t *glb;
        for (int k = (int) (random_bits(&random) % 8); k >= 0; k--)
            ((uint8_t *) &square)[random_bits(&random) % sizeof(square)] = (uint8_t) random_bits(&random);
        glb = make_glb(json, &square, sizeof(square), &size);
        read += try_bytes(glb, size, NULL) == PELL_OK;
        free(glb);
    }
    REQUIRE(read > 100 && read < 2000);
}

/* Small files that request much work: each must be refused, or read, within moments and within the limits. */
static void amplification_is_bounded(void **state)
{
    enum { N = 30000 };
    char *json = malloc(N * 64);
    const struct square square = make_square();
    const double start = busy_seconds();
    size_t n = 0, size;
    uint8_t *glb;
    (void) state;
    assert_non_null(json);
    /* many scenes without a mesh, each over many nodes */
    n += (size_t) sprintf(json, "{\"asset\":{\"version\":\"2.0\"},\"nodes\":[");
    for (int i = 0; i < N; i++)
        n += (size_t) sprintf(json + n, "%s{}", i ? "," : "");
    n += (size_t) sprintf(json + n, "],\"scenes\":[");
    for (int i = 0; i < N; i++)
        n += (size_t) sprintf(json + n, "%s{\"nodes\":[%d]}", i ? "," : "", i);
    sprintf(json + n, "]}");
    assert_int_equal(try_bytes((const uint8_t *) json, strlen(json), NULL), PELL_OK);
    /* many nodes with the same mesh of many primitives: limited by the number of vertices */
    n = (size_t) sprintf(json, "{\"asset\":{\"version\":\"2.0\"}," SQUARE_BUFFERS SQUARE_ACCESSORS "\"nodes\":[");
    for (int i = 0; i < 1000; i++)
        n += (size_t) sprintf(json + n, "%s{\"mesh\":0}", i ? "," : "");
    n += (size_t) sprintf(json + n, "],\"meshes\":[{\"primitives\":[");
    for (int i = 0; i < 1000; i++)
        n += (size_t) sprintf(json + n, "%s{\"attributes\":{\"POSITION\":0},\"indices\":5}", i ? "," : "");
    sprintf(json + n, "]}]}");
    glb = make_glb(json, &square, sizeof(square), &size);
    assert_int_equal(try_bytes(glb, size, NULL), PELL_ERR_UNSUPPORTED);
    free(glb);
    free(json);
    REQUIRE(busy_seconds() - start < 20.0); /* including sanitizers; far under a second without */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_failing_allocation_is_reported_and_leaks_nothing),
        cmocka_unit_test(a_glb_cut_at_any_byte_is_refused),
        cmocka_unit_test(random_damage_is_read_or_refused),
        cmocka_unit_test(damaged_binary_data_is_never_trusted),
        cmocka_unit_test(amplification_is_bounded),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
