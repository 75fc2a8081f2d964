/* SPDX-License-Identifier: MIT
 * test_stl.c - STL in its two forms: a ball written and read, merging of vertices, damaged and inconsistent files. */
#include "scene_test.h"

#include <ctype.h>

enum { ROWS = 12, COLUMNS = 20, MOST = 2 * ROWS * COLUMNS };

struct fixture {
    struct pell_alloc_fault fault;
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_scene *scene;
    enum pell_result res;
};

static void read_stl(struct fixture *f, const char *name, const void *data, size_t size, uint64_t fail_at)
{
    struct pell_context_params params = { .log = keep_message, .log_user = &f->kept };

    memset(f, 0, sizeof(*f));
    f->fault.fail_at = fail_at;
    params.allocator = pell_failing_allocator(&f->fault);
    f->res = pell_context_create(&params, &f->ctx);
    if (f->res == PELL_OK)
        f->res = load_bytes(f->ctx, name, data, size, &bare_mm, NULL, &f->scene);
}

static void finish(struct fixture *f)
{
    pell_scene_destroy(&f->scene);
    pell_context_destroy(&f->ctx);
    assert_int_equal(f->fault.live, 0);
}

/* A ball of 10 mm, in triangles without shared vertices. */
static size_t ball(float corners[MOST][3][3])
{
    size_t n = 0;

    for (int i = 0; i < ROWS; i++)
        for (int j = 0; j < COLUMNS; j++) {
            float p[4][3];
            for (int k = 0; k < 4; k++) {
                const int row = i + (k >= 2), column = (j + (k == 1 || k == 2)) % COLUMNS;
                const double a = PELL_PI * ((double) row / ROWS - 0.5), b = 2.0 * PELL_PI * column / COLUMNS;
                const double r = row == 0 || row == ROWS ? 0.0 : 10.0 * cos(a);
                p[k][0] = (float) (r * sin(b));
                p[k][1] = (float) (10.0 * sin(a));
                p[k][2] = (float) (r * cos(b));
            }
            for (int t = 0; t < 2; t++) {
                static const int corner[2][3] = { { 0, 1, 2 }, { 0, 2, 3 } };
                if ((i == 0 && t == 0) || (i == ROWS - 1 && t == 1))
                    continue; /* at the poles */
                for (int k = 0; k < 3; k++)
                    memcpy(corners[n][k], p[corner[t][k]], 12);
                n++;
            }
        }
    return n;
}

static size_t write_binary(uint8_t *out, float corners[][3][3], size_t triangles, const char *header)
{
    memset(out, 0, 84 + 50 * triangles);
    memcpy(out, header, strlen(header));
    for (int k = 0; k < 4; k++)
        out[80 + k] = (uint8_t) (triangles >> 8 * k);
    for (size_t t = 0; t < triangles; t++)
        memcpy(out + 84 + 50 * t + 12, corners[t], 36); /* little-endian, as the supported machines are */
    return 84 + 50 * triangles;
}

static size_t write_text(char *out, float corners[][3][3], size_t triangles)
{
    char *at = out + sprintf(out, "solid ball of mine\n");

    for (size_t t = 0; t < triangles; t++) {
        at += sprintf(at, "facet normal 0 0 0\n outer loop\n");
        for (int k = 0; k < 3; k++)
            at += sprintf(at, "  vertex %.9g %.9g %.9g\n", (double) corners[t][k][0], (double) corners[t][k][1], (double) corners[t][k][2]);
        at += sprintf(at, " endloop\nendfacet\n");
    }
    return (size_t) (at + sprintf(at, "endsolid ball of mine\n") - out);
}

static float triangles_of_ball[MOST][3][3];
static uint8_t bytes[1 << 20];

static void both_forms_give_a_closed_ball(void **state)
{
    static const char *const names[] = { "ball.stl", "by-its-content", "ball.STL" };
    const size_t n = ball(triangles_of_ball);

    (void) state;
    for (int k = 0; k < 9; k++) {
        const size_t size = k < 3 ? write_binary(bytes, triangles_of_ball, n, k == 1 ? "solid in the header of a binary file" : "")
                                  : write_text((char *) bytes, triangles_of_ball, n);
        const struct pell_mesh *m;
        struct fixture f;
        for (size_t i = 0; k >= 6 && i < size; i++) /* text in capitals */
            bytes[i] = (uint8_t) toupper(bytes[i]);
        read_stl(&f, names[k % 3], bytes, size, 0);
        if (f.res != PELL_OK)
            fail_msg("refused: %s: %s", f.kept.where, f.kept.what);
        assert_int_equal(f.scene->num_meshes, 1);
        m = &f.scene->meshes[0];
        assert_int_equal(m->num_triangles, n);
        assert_int_equal(m->num_vertices, COLUMNS * (ROWS - 1) + 2); /* Euler: V - E + F = 2 */
        for (uint32_t i = 0; i < m->num_vertices; i++) {
            const float *p = m->position + 3 * i, *q = m->normal + 3 * i;
            REQUIRE_NEAR(p[0] * p[0] + p[1] * p[1] + p[2] * p[2], 100.0, 1e-3);
            REQUIRE(p[0] * q[0] + p[1] * q[1] + p[2] * q[2] > 9.0f); /* outward */
        }
        finish(&f);
    }
}

static void refused(const char *name, const void *data, size_t size, const char *said)
{
    struct fixture f;

    read_stl(&f, name, data, size, 0);
    if (f.res == PELL_OK || !strstr(f.kept.what, said))
        fail_msg("got %d, \"%s\"; wanted \"%s\"", (int) f.res, f.kept.what, said);
    assert_int_equal(f.kept.errors, 1);
    finish(&f);
}

static void damaged_files_are_refused_with_their_place(void **state)
{
    static const float nan_bits = NAN;
    size_t size;

    (void) state;
    size = write_binary(bytes, triangles_of_ball, ball(triangles_of_ball), "");
    refused("a.stl", bytes, size - 1, "but has");
    refused("a.stl", bytes, 83, "is no STL: it has 83 bytes");
    bytes[83] = 0xff;
    refused("a.stl", bytes, size, "names 42");
    bytes[83] = 0;
    memcpy(bytes + 84 + 50 * 7 + 12 + 24 + 4, &nan_bits, 4);
    refused("a.stl", bytes, size, "triangle 7: corner 2 is (");
    size = write_binary(bytes, triangles_of_ball, 0, "");
    refused("a.stl", bytes, size, "holds no triangles");
#define REFUSED(text, said) refused("a.stl", text, sizeof(text) - 1, said)
    REFUSED("solid\nendsolid\n", "holds no triangles");
    {
        static uint8_t cut[84 + 50] = "solid in the header of a binary file";
        cut[80] = 3;
        refused("a.stl", cut, sizeof(cut), "names 3 triangles, for 234 bytes, but has 134 bytes");
    }
    REFUSED("solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nendloop\n", "line 6: a facet of 2 corners, must have 3");
    REFUSED("solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0", "line 5: z is \"\", must be a finite number");
    REFUSED("solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "ends within a facet");
    REFUSED("solid\nfacet\nvertex 0 nan 0\n", "line 3: y is \"nan\"");
    REFUSED("solid\nfacet\nvertex 0 1e39 0\n", "line 3: y is \"1e39\"");
}

static void changed_bytes_and_failed_allocations_do_no_harm(void **state)
{
    const size_t n = ball(triangles_of_ball);
    enum pell_result res = PELL_ERR_NOMEM;
    uint32_t seed = 1;
    struct fixture f;
    size_t size;

    (void) state;
    for (int form = 0; form < 2; form++)
        for (int i = 0; i < 300; i++) {
            size = form ? write_text((char *) bytes, triangles_of_ball, 40) : write_binary(bytes, triangles_of_ball, 40, "");
            for (int k = 0; k < 3; k++) {
                seed = seed * 1664525u + 1013904223u;
                bytes[(seed >> 4) % size] = (uint8_t) (seed >> 24);
            }
            read_stl(&f, "a.stl", bytes, i % 3 ? size : (seed >> 8) % size, 0);
            finish(&f);
        }
    size = write_binary(bytes, triangles_of_ball, n, "");
    for (uint64_t at = 1; res != PELL_OK; at++) {
        REQUIRE(at < 1000);
        read_stl(&f, "a.stl", bytes, size, at);
        res = f.res;
        REQUIRE(res == PELL_OK || res == PELL_ERR_NOMEM);
        finish(&f);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(both_forms_give_a_closed_ball),
        cmocka_unit_test(damaged_files_are_refused_with_their_place),
        cmocka_unit_test(changed_bytes_and_failed_allocations_do_no_harm),
    };
    return cmocka_run_group_tests_name("stl", tests, NULL, NULL);
}
