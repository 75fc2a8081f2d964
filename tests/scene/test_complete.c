/* SPDX-License-Identifier: MIT
 * test_complete.c - completion of a scene: normals with creases, tangents, orientation, camera, lights, ground; and what is refused. */
#include "scene_test.h"

#include "scene/mesh/topology.h"
#include "scene/triangle.h"

#include "slow.h"

static void finish(struct pell_scene *s)
{
    struct pell_context *ctx = s->ctx;

    pell_scene_destroy(&s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static struct pell_scene *load(const char *text, const struct pell_load_params *params, struct kept_messages *kept)
{
    struct pell_context *ctx = test_context(NULL, kept);
    struct pell_scene *s;

    assert_int_equal(load_text(ctx, "test.obj", text, params, &s), PELL_OK);
    return s;
}

/* --- Normals --------------------------------------------------------------------------------------------------------------------- */

static void a_cube_keeps_flat_faces(void **state)
{
    struct pell_scene *s = load(CUBE, &bare_mm, NULL);
    const struct pell_mesh *m = &s->meshes[0];
    (void) state;

    assert_int_equal(m->num_vertices, 24);
    for (uint32_t i = 0; i < m->num_triangles; i++) {
        const float *n = m->normal + 3 * m->index[3 * i];
        const struct pell_vec3 a = vec3_load(m->position + 3 * m->index[3 * i]), b = vec3_load(m->position + 3 * m->index[3 * i + 1]);
        const struct pell_vec3 c = vec3_load(m->position + 3 * m->index[3 * i + 2]);
        const struct pell_vec3 face = vec3_normalize(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)));
        for (int k = 0; k < 3; k++)
            for (int c3 = 0; c3 < 3; c3++)
                REQUIRE_NEAR(m->normal[3 * m->index[3 * i + k] + c3], n[c3], 0);
        REQUIRE_NEAR(vec3_dot(face, vec3_load(n)), 1.0, 1e-6);
    }
    finish(s);
}

/* Largest angle between vertex normals and the exact normals of the sphere. */
static double sphere_error(const struct pell_mesh *m)
{
    double worst = 0.0;

    for (uint32_t i = 0; i < m->num_vertices; i++) {
        const struct pell_vec3 n = vec3_load(m->normal + 3 * i), p = vec3_normalize(vec3_load(m->position + 3 * i));
        REQUIRE_NEAR(vec3_length(n), 1.0, 1e-5);
        worst = fmax(worst, vec3_length(vec3_cross(n, p)));
        REQUIRE(vec3_dot(n, p) > 0.0f);
    }
    return worst;
}

static void a_sphere_is_smooth_however_its_vertices_are_split(void **state)
{
    (void) state;
    for (int rings = 8; rings <= 32; rings *= 2) {
        char *soup = sphere_obj(rings, 20.0, true, false);
        struct pell_scene *s = load(soup, &bare_mm, NULL);
        const double error = sphere_error(&s->meshes[0]), step = PELL_PI / rings;
        REQUIRE(error < 0.35 * step * step + 1e-4); /* second order in the size of a facet */
        finish(s);
        free(soup);
    }
}

/* A sphere of separate triangles, each with the normal of its plane: as programs write flat shading. */
static char *faceted_sphere(int rings)
{
    char *soup = sphere_obj(rings, 20.0, true, false), *out = NULL, *line = soup;
    size_t size;
    FILE *file = open_memstream(&out, &size);
    struct pell_vec3 p[3];
    int corners = 0, triangles = 0;

    for (char *next; *line; line = next) {
        const int k = corners % 3;
        next = line + strcspn(line, "\n") + 1;
        if (sscanf(line, "v %f %f %f", &p[k].x, &p[k].y, &p[k].z) != 3)
            continue;
        fprintf(file, "v %.9g %.9g %.9g\n", (double) p[k].x, (double) p[k].y, (double) p[k].z);
        corners++;
        if (k == 2) {
            const struct pell_vec3 n = vec3_normalize(vec3_cross(vec3_sub(p[1], p[0]), vec3_sub(p[2], p[0])));
            triangles++;
            fprintf(file, "vn %.9g %.9g %.9g\n", (double) n.x, (double) n.y, (double) n.z);
            fprintf(file, "f %d//%d %d//%d %d//%d\n", 3 * triangles - 2, triangles, 3 * triangles - 1, triangles, 3 * triangles, triangles);
        }
    }
    fclose(file);
    free(soup);
    return out;
}

static void facets_are_told_of_and_smoothed_on_demand(void **state)
{
    const struct pell_load_params smooth = { .mm_per_unit = 1.0, .bare = true, .normals = "smooth" },
                                  as_is = { .mm_per_unit = 1.0, .bare = true, .normals = "file" };
    char *soup = faceted_sphere(16), *round = sphere_obj(16, 20.0, false, false);
    const struct {
        const char *text;
        const struct pell_load_params *params;
        bool sphere, flat;
    } cases[] = { { soup, &bare_mm, true, true },   { soup, &as_is, true, true },     { soup, &smooth, true, false },
                  { round, &bare_mm, true, false }, { CUBE, &bare_mm, false, false }, { CUBE, &smooth, false, false } };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct pell_scene *s = load(cases[i].text, cases[i].params, NULL);
        struct pell_scene_report report;
        bool reported = false;
        assert_int_equal(pell_scene_check(s, &report), PELL_OK);
        for (size_t k = 0; k < report.num_problems; k++)
            reported |= strstr(report.problems[k].what, "--normals smooth") != NULL;
        assert_int_equal(report.objects[0].faceted, cases[i].flat);
        assert_int_equal(reported, cases[i].flat);
        pell_scene_report_finish(s->ctx, &report);
        if (cases[i].sphere)
            assert_int_equal(sphere_error(&s->meshes[0]) > 0.05, cases[i].flat);
        finish(s);
    }
    free(soup);
    free(round);
}

/* By the option, and by the smoothing groups of an OBJ without normals: `s off` is flat, any group is smooth. */
static void flat_normals_are_those_of_the_triangles(void **state)
{
    const struct pell_load_params flat = { .mm_per_unit = 1.0, .bare = true, .normals = "flat" },
                                  smooth = { .mm_per_unit = 1.0, .bare = true, .normals = "smooth" };
    char *round = sphere_obj(16, 20.0, false, false);
    const size_t size = strlen(round) + 16;
    char *off = malloc(size), *on = malloc(size);
    (void) state;

    snprintf(off, size, "s off\n%s", round);
    snprintf(on, size, "s 0\ns 1\n%s", round);
    const struct {
        const char *text;
        const struct pell_load_params *params;
        bool flat;
    } cases[] = {
        { round, &bare_mm, false }, { round, &flat, true }, { off, &bare_mm, true }, { off, &smooth, false }, { on, &bare_mm, false }
    };
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct pell_scene *s = load(cases[i].text, cases[i].params, NULL);
        const struct pell_mesh *m = &s->meshes[0];
        double worst = 1.0;
        for (uint32_t t = 0; t < m->num_triangles; t++) {
            struct pell_vec3 at[3];
            pell_triangle_corners(m, t, at);
            for (int k = 0; k < 3; k++)
                worst = fmin(worst, (double) vec3_dot(vec3_normalize(pell_triangle_cross(at)),
                                                      vec3_load(m->normal + 3 * (size_t) m->index[3 * t + (uint32_t) k])));
        }
        assert_true((worst > 0.9999) == cases[i].flat);
        finish(s);
    }
    free(on);
    free(off);
    free(round);
}

static struct pell_vec3 normal_at_origin(const char *text)
{
    struct pell_scene *s = load(text, &bare_mm, NULL);
    const struct pell_mesh *m = &s->meshes[0];
    struct pell_vec3 n = vec3(0, 0, 0);

    for (uint32_t i = 0; i < m->num_vertices; i++)
        if (m->position[3 * i] == 0.0f && m->position[3 * i + 1] == 0.0f && m->position[3 * i + 2] == 0.0f)
            n = vec3_load(m->normal + 3 * i);
    finish(s);
    return n;
}

static void normals_weigh_faces_by_area_times_angle(void **state)
{
    /* A front of area 1/2 and a side of area sqrt(1/2) that leans back by 45 degrees; both have 90 degrees at the corner. */
    const struct pell_vec3 front = vec3(0, 0, 0.5f * PELL_PI_F), half = vec3_mul(front, 0.5f),
                           side = vec3_mul(vec3(-1, 0, 1), 0.5f * PELL_PI_F);
    const struct pell_vec3 whole = vec3_normalize(vec3_add(front, side));
    (void) state;

    REQUIRE_NEAR(vec3_dot(normal_at_origin("v 0 0 0\nv 1 0 0\nv 0 1 0\nv -1 0 -1\nf 1 2 3\nf 1 3 4\n"), whole), 1.0, 1e-6);
    /* Split into halves through the corner the front has half the area at half the angle twice: half the weight. */
    REQUIRE_NEAR(vec3_dot(normal_at_origin("v 0 0 0\nv 1 0 0\nv 0 1 0\nv -1 0 -1\nv 0.5 0.5 0\nf 1 2 5\nf 1 5 3\nf 1 3 4\n"),
                          vec3_normalize(vec3_add(half, side))),
                 1.0, 1e-6);
}

/* The spacing of single precision is 1 at 1e7. */
static void what_is_too_far_for_its_size_is_told(void **state)
{
    static const char *const distances[] = { "10000000", "10000" };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(distances); i++) {
        char text[256];
        struct kept_messages kept = { 0 };
        snprintf(text, sizeof(text), "v %s 0 0\nv %s 2 0\nv %s 0 2\nf 1 2 3\n", distances[i], distances[i], distances[i]);
        finish(load(text, &bare_mm, &kept));
        assert_int_equal(kept.warnings, i == 0 ? 1 : 0);
        if (i == 0)
            assert_non_null(strstr(kept.last_warning, "from the origin, but is 2 mm large"));
    }
}

static void degenerate_triangles_do_not_hurt(void **state)
{
    struct pell_scene *s = load(CUBE "f 1 1 2\nf 1 2 1\nv 0.5 0 0\nf 1 9 2\n", &bare_mm, NULL);
    (void) state;

    assert_int_equal(s->meshes[0].num_triangles, 15);
    for (uint32_t i = 0; i < 3 * s->meshes[0].num_vertices; i++)
        REQUIRE(isfinite(s->meshes[0].normal[i]));
    for (uint32_t i = 0; i < s->meshes[0].num_vertices; i++)
        REQUIRE_NEAR(vec3_length(vec3_load(s->meshes[0].normal + 3 * i)), 1.0, 1e-5);
    finish(s);
}

/* A copy with rotated corners and one with separate vertices are removed; one with opposite winding or other texture coordinates is
 * kept. */
static void repeated_triangles_are_left_out(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_scene *s = load(CUBE "f 1 3 2\nf 3 2 1\nf 1 2 3\nv 0 0 0\nv 1 0 0\nv 1 1 0\nf 9 11 10\n", &bare_mm, &kept);
    (void) state;

    assert_int_equal(s->meshes[0].num_triangles, 12 + 1);
    assert_non_null(strstr(kept.last_warning, "3 triangles lie exactly where another lies: left out"));
    finish(s);
    s = load("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nf 2/2 3/3 1/1\nf 1/1 2/3 3/2\n", &bare_mm, NULL);
    assert_int_equal(s->meshes[0].num_triangles, 2);
    finish(s);
}

/* The maximal number of triangles, coincident: must not take quadratic time. */
static void very_many_repeated_triangles_take_no_time(void **state)
{
    enum { COUNT = SLOW ? 20000 : 200000 };
    char *text = malloc(64 + COUNT * sizeof("f 1 2 3\n"));
    char *at = text;
    struct pell_scene *s;
    double begin;
    (void) state;

    at += sprintf(at, "v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    for (int i = 0; i < COUNT; i++)
        at += sprintf(at, "f 1 2 3\n");
    begin = busy_seconds();
    s = load(text, &bare_mm, NULL);
    REQUIRE(busy_seconds() - begin < 2.0);
    assert_int_equal(s->meshes[0].num_triangles, 1);
    finish(s);
    free(text);
}

static void single_missing_normals_are_filled(void **state)
{
    struct pell_scene *s =
        load("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvn 0 6e20 8e20\nvn 0 0 1e-44\nf 1//1 2//1 3//2\nf 2//1 4//2 3//2\n", &bare_mm, NULL);
    (void) state;

    assert_int_equal(s->meshes[0].num_vertices, 4);
    REQUIRE_NEAR(s->meshes[0].normal[1], 0.6, 1e-6);
    REQUIRE_NEAR(s->meshes[0].normal[3 * 2 + 2], 1.0, 1e-6);
    finish(s);
}

/* --- Orientation ------------------------------------------------------------------------------------------------------------------ */

static double volume(const struct pell_mesh *m)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < m->num_triangles; i++)
        sum +=
            (double) vec3_dot(vec3_load(m->position + 3 * m->index[3 * i]), vec3_cross(vec3_load(m->position + 3 * m->index[3 * i + 1]),
                                                                                       vec3_load(m->position + 3 * m->index[3 * i + 2]))) /
            6.0;
    return sum;
}

static void what_is_inside_out_is_turned_with_its_normals(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_scene *s = load(CUBE_INSIDE_OUT, &bare_mm, &kept);
    char *soup;
    (void) state;

    REQUIRE_NEAR(volume(&s->meshes[0]), 1.0, 1e-6);
    assert_int_equal(kept.warnings, 1);
    assert_non_null(strstr(kept.last_warning, "inverted normals"));
    finish(s);

    soup = sphere_obj(12, 5.0, true, true);
    s = load(soup, &bare_mm, NULL);
    REQUIRE(volume(&s->meshes[0]) > 0.0);
    sphere_error(&s->meshes[0]); /* normals point outward */
    finish(s);
    free(soup);

    /* Its own normals point inward, like the winding: both are flipped. */
    s = load(CUBE_VERTICES
             "vn 1 1 1\nvn -1 -1 -1\nf 2//1 3//1 4//1 1//1\nf 8//2 7//2 6//2 5//2\nf 5//1 6//1 2//1 1//1\nf 6//2 7//2 3//2 2//2\n"
             "f 7//2 8//2 4//2 3//2\nf 8//1 5//1 1//1 4//1\n",
             &bare_mm, NULL);
    for (uint32_t i = 0; i < s->meshes[0].num_triangles; i++) {
        const struct pell_mesh *m = &s->meshes[0];
        const struct pell_vec3 a = vec3_load(m->position + 3 * m->index[3 * i]), b = vec3_load(m->position + 3 * m->index[3 * i + 1]);
        const struct pell_vec3 c = vec3_load(m->position + 3 * m->index[3 * i + 2]);
        REQUIRE(vec3_dot(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)), vec3_load(m->normal + 3 * m->index[3 * i])) > 0.0f);
    }
    finish(s);
}

/* A hollow ball inside out becomes outward; an object inside the bounding box of an inverted ball, but not inside the ball, is
 * unchanged. */
static void a_hollow_is_turned_with_what_is_around_it(void **state)
{
    static const char outside[] =
        "v 4.4 4.4 4.4\nv 4.8 4.4 4.4\nv 4.4 4.8 4.4\nv 4.4 4.4 4.8\nf -4 -2 -3\nf -4 -3 -1\nf -4 -1 -2\nf -3 -2 -1\n";
    char *outer = sphere_obj(12, 5.0, false, true), *inner = sphere_obj(12, 3.0, false, false);
    (void) state;

    for (int within = 0; within < 2; within++) {
        const char *other = within ? inner : outside;
        const double want = 4.0 / 3.0 * PELL_PI * (within ? 125.0 - 27.0 : 125.0);
        char *text = malloc(strlen(outer) + strlen(other) + 1);
        struct kept_messages kept = { 0 };
        struct pell_scene *s;
        assert_non_null(text);
        strcpy(text, outer);
        strcat(text, other);
        s = load(text, &bare_mm, &kept);
        assert_non_null(strstr(kept.last_warning, within ? "2 surfaces had" : "1 surface had"));
        REQUIRE_REL(volume(&s->meshes[0]), want, 0.05);
        finish(s);
        free(text);
    }
    free(outer);
    free(inner);
}

/* An open sheet of which every third triangle has opposite winding. With normals more than half may be flipped; normals that follow the
 * winding (2) are flipped with it. */
static void triangles_face_as_their_neighbours_do(void **state)
{
    enum { N = 6 };
    (void) state;

    for (int own = 0; own < 3; own++) {
        char text[8192], *at = text;
        struct kept_messages kept = { 0 };
        struct pell_scene *s;

        for (int i = 0; i < (N + 1) * (N + 1); i++)
            at += sprintf(at, "v %d %d 0\n", i % (N + 1), i / (N + 1));
        at += sprintf(at, "vn 0 0 1\nvn 0 0 -1\n");
        for (int i = 0; i < 2 * N * N; i++) {
            const int a = i / 2 % N + i / 2 / N * (N + 1) + 1, b = a + 1, c = a + N + 2, d = a + N + 1;
            const int corner[3] = { a, i % 2 ? c : b, i % 2 ? d : c };
            const bool over = own == 1 ? i % 3 != 0 : i % 3 == 0;
            const int vn = own == 2 && over ? 2 : 1;
            at += own ? sprintf(at, "f %d//%d %d//%d %d//%d\n", corner[0], vn, corner[over ? 2 : 1], vn, corner[over ? 1 : 2], vn)
                      : sprintf(at, "f %d %d %d\n", corner[0], corner[over ? 2 : 1], corner[over ? 1 : 2]);
        }
        s = load(text, &bare_mm, &kept);
        assert_int_equal(kept.warnings, 1);
        assert_non_null(strstr(kept.last_warning, own == 1 ? "48 triangles face against the neighbours" : "24 triangles face against"));
        for (uint32_t i = 0; i < 3 * s->meshes[0].num_triangles; i++)
            REQUIRE_NEAR(s->meshes[0].normal[3 * s->meshes[0].index[i] + 2], 1.0, 1e-6);
        for (uint32_t i = 0; i < s->meshes[0].num_triangles; i++) {
            const struct pell_mesh *m = &s->meshes[0];
            const struct pell_vec3 a = vec3_load(m->position + 3 * m->index[3 * i]), b = vec3_load(m->position + 3 * m->index[3 * i + 1]);
            const struct pell_vec3 c = vec3_load(m->position + 3 * m->index[3 * i + 2]);
            REQUIRE_NEAR(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)).z, 1.0, 1e-6);
        }
        finish(s);
    }
}

/* An inverted cube whose last side has separately rounded vertices is closed enough to be oriented; one without a side is not. */
static void what_is_nearly_closed_is_turned(void **state)
{
    static const char *const last[] = { "v 0 0 1e-6\nv 0 1 1e-6\nv 1 1 1e-6\nv 1 0 1e-6\nf 9 12 11 10\n", "" };
    (void) state;

    for (int open = 0; open < 2; open++) {
        char text[1024];
        struct kept_messages kept = { 0 };
        struct pell_scene *s;

        snprintf(text, sizeof(text), "%s%s%s", CUBE_VERTICES, "f 8 7 6 5\nf 5 6 2 1\nf 6 7 3 2\nf 7 8 4 3\nf 8 5 1 4\n", last[open]);
        s = load(text, &bare_mm, &kept);
        assert_int_equal(kept.warnings, open ? 0 : 1);
        if (!open)
            REQUIRE_NEAR(volume(&s->meshes[0]), 1.0, 1e-5);
        finish(s);
    }
}

static void the_wall_of_a_hollow_stays_as_it_is(void **state)
{
    char *outer = sphere_obj(12, 5.0, false, false), *inner = sphere_obj(12, 3.0, false, true), *text;
    struct kept_messages kept = { 0 };
    struct pell_scene *s;
    const double want = 4.0 / 3.0 * PELL_PI * (125.0 - 27.0);
    (void) state;

    text = malloc(strlen(outer) + strlen(inner) + 1);
    assert_non_null(text);
    strcpy(text, outer);
    strcat(text, inner);
    s = load(text, &bare_mm, &kept);
    REQUIRE_REL(volume(&s->meshes[0]), want, 0.05);
    assert_int_equal(kept.warnings, 0);
    finish(s);
    free(outer);
    free(inner);
    free(text);
}

/* --- Tangents ---------------------------------------------------------------------------------------------------------------------- */

/* One mesh of `count` vertices with a normal map on its material; u and v run as given. */
static struct pell_scene *mapped(const float (*position)[3], const float (*uv)[2], uint32_t count, const uint32_t *index,
                                 uint32_t triangles)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_load_params bare = { .bare = true };
    struct pell_texture *texture;
    struct pell_scene *s;
    struct pell_mesh *m;
    size_t mesh, material;

    assert_int_equal(pell_scene_create(ctx, &s), PELL_OK);
    assert_int_equal(pell_scene_add_material(s, "m", &material), PELL_OK);
    assert_int_equal(pell_scene_add_texture(s, "map", &texture), PELL_OK);
    texture->image = (struct pell_image) { 1, 1, 3, PELL_PIXEL_U8, false, pell_zalloc(ctx, 3) };
    s->materials[material].normal_map.texture = texture;
    assert_int_equal(pell_scene_add_mesh(s, "m", &mesh), PELL_OK);
    assert_int_equal(pell_mesh_allocate(s, mesh, count, triangles), PELL_OK);
    m = &s->meshes[mesh];
    m->uv[0] = pell_alloc_array(ctx, count, 2 * sizeof(float));
    memcpy(m->position, position, count * 3 * sizeof(float));
    memcpy(m->uv[0], uv, count * 2 * sizeof(float));
    memcpy(m->index, index, triangles * 3 * sizeof(uint32_t));
    assert_int_equal(pell_scene_complete(s, &bare), PELL_OK);
    assert_non_null(m->tangent);
    return s;
}

/* A floating-point texture can hold any value; reflectances above one or below zero are clamped. */
static void maps_of_floats_are_limited(void **state)
{
    static const float given[4] = { -5.0f, 0.25f, 1e30f, 3.0f }, reflected[4] = { 0.0f, 0.25f, 1.0f, 1.0f },
                       emitted[4] = { 0.0f, 0.25f, 1e12f, 3.0f };
    const struct pell_load_params bare = { .bare = true };
    (void) state;

    for (int emits = 0; emits < 2; emits++) {
        struct kept_messages kept = { 0 };
        struct pell_context *ctx = test_context(NULL, &kept);
        struct pell_texture *texture;
        struct pell_scene *s;
        size_t mesh, material;

        assert_int_equal(pell_scene_create(ctx, &s), PELL_OK);
        assert_int_equal(pell_scene_add_material(s, "m", &material), PELL_OK);
        assert_int_equal(pell_scene_add_texture(s, "map", &texture), PELL_OK);
        texture->image = (struct pell_image) { 4, 1, 1, PELL_PIXEL_F32, false, pell_alloc_array(ctx, 4, sizeof(float)) };
        memcpy(texture->image.pixels, given, sizeof(given));
        *(emits ? &s->materials[material].emissive_map : &s->materials[material].base_color_map) =
            (struct pell_texture_map) { .texture = texture, .matrix = { 1, 0, 0, 0, 1, 0 } };
        assert_int_equal(pell_scene_add_mesh(s, "m", &mesh), PELL_OK);
        assert_int_equal(pell_mesh_allocate(s, mesh, 3, 1), PELL_OK);
        memcpy(s->meshes[mesh].position, (const float[9]) { 0, 0, 0, 1, 0, 0, 0, 1, 0 }, 9 * sizeof(float));
        memcpy(s->meshes[mesh].index, (const uint32_t[3]) { 0, 1, 2 }, 3 * sizeof(uint32_t));
        assert_int_equal(pell_scene_complete(s, &bare), PELL_OK);
        assert_memory_equal(texture->image.pixels, emits ? emitted : reflected, sizeof(given));
        assert_int_equal(kept.warnings, 1);
        assert_non_null(strstr(kept.last_warning, "such as -5"));
        finish(s);
    }
}

static void tangents_follow_u_and_bitangents_run_up(void **state)
{
    static const float position[4][3] = { { 0, 0, 0 }, { 1, 0, 0 }, { 1, 1, 0 }, { 0, 1, 0 } };
    static const float plain[4][2] = { { 0, 1 }, { 1, 1 }, { 1, 0 }, { 0, 0 } },
                       mirrored[4][2] = { { 1, 1 }, { 0, 1 }, { 0, 0 }, { 1, 0 } };
    static const uint32_t index[6] = { 0, 1, 2, 0, 2, 3 };
    struct pell_scene *s = mapped(position, plain, 4, index, 2);
    (void) state;

    for (int i = 0; i < 4; i++) {
        REQUIRE_NEAR(s->meshes[0].tangent[4 * i], 1.0, 1e-6);
        REQUIRE_NEAR(s->meshes[0].tangent[4 * i + 3], 1.0, 0); /* cross(+z, +x) = +y: up in the image */
    }
    finish(s);
    s = mapped(position, mirrored, 4, index, 2);
    for (int i = 0; i < 4; i++) {
        REQUIRE_NEAR(s->meshes[0].tangent[4 * i], -1.0, 1e-6);
        REQUIRE_NEAR(s->meshes[0].tangent[4 * i + 3], -1.0, 0); /* -cross(+z, -x) = +y */
    }
    finish(s);
}

static void vertices_of_both_handednesses_are_split(void **state)
{
    /* Two quads that share an edge at x = 0, with u mirrored about it. */
    static const float position[6][3] = { { 0, 0, 0 }, { 0, 1, 0 }, { 1, 0, 0 }, { 1, 1, 0 }, { -1, 0, 0 }, { -1, 1, 0 } };
    static const float uv[6][2] = { { 0, 1 }, { 0, 0 }, { 1, 1 }, { 1, 0 }, { 1, 1 }, { 1, 0 } };
    static const uint32_t index[12] = { 0, 2, 3, 0, 3, 1, 4, 0, 1, 4, 1, 5 };
    struct pell_scene *s = mapped(position, uv, 6, index, 4);
    const struct pell_mesh *m = &s->meshes[0];
    (void) state;

    assert_int_equal(m->num_vertices, 8);
    for (uint32_t i = 0; i < 12; i++) {
        const float side = i < 6 ? 1.0f : -1.0f, *t = m->tangent + 4 * m->index[i];
        REQUIRE_NEAR(t[0], side, 1e-6);
        REQUIRE_NEAR(t[3], side, 0);
        REQUIRE_NEAR(m->position[3 * m->index[i]], position[index[i]][0], 0);
        REQUIRE_NEAR(m->uv[0][2 * m->index[i]], uv[index[i]][0], 0);
    }
    finish(s);
}

static void made_tangents_agree_with_those_of_a_file(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_load_params bare = { .bare = true };
    struct pell_scene *s;
    struct pell_mesh *m;
    float *given;
    (void) state;

    assert_int_equal(pell_scene_load(ctx, project_file("tests/assets/generated/mirrored_tangents.gltf"), &bare, &s), PELL_OK);
    m = &s->meshes[0];
    assert_int_equal(m->num_vertices, 8);
    assert_non_null(m->tangent);
    given = m->tangent;
    m->tangent = NULL;
    assert_int_equal(pell_make_tangents(s, 0, 0), PELL_OK);
    assert_int_equal(m->num_vertices, 8);
    for (uint32_t i = 0; i < 4 * m->num_vertices; i++)
        REQUIRE_NEAR(m->tangent[i], given[i], 1e-5);
    pell_free(ctx, given);
    finish(s);
}

/* --- Camera, lights, ground ---------------------------------------------------------------------------------------------------------- */

static void the_default_camera_fills_eighty_percent(void **state)
{
    static const float aspects[] = { 0.0f, 0.5f, 1.0f, 4.0f };
    static const float sizes[][3] = { { 1, 1, 1 }, { 10, 1, 1 }, { 1, 10, 3 }, { 0.01f, 0.01f, 5 }, { 5, 5, 0 } };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(aspects) * PELL_COUNT(sizes); i++) {
        const float aspect = aspects[i % PELL_COUNT(aspects)], *size = sizes[i / PELL_COUNT(aspects)];
        const struct pell_load_params params = { .mm_per_unit = 7.0, .aspect = aspect };
        char text[512];
        struct pell_scene *s;
        const struct pell_camera *c;
        double fill[2] = { 0, 0 };
        snprintf(text, sizeof(text), "v 1 2 3\nv %g 2 3\nv 1 %g %g\nf 1 2 3\nv %g %g %g\nf 2 4 3\n", 1 + size[0], 2 + size[1], 3 + size[2],
                 1 + size[0], 2 + size[1], 3.0);
        s = load(text, &params, NULL);
        assert_int_equal(s->num_cameras, 1);
        c = &s->cameras[0];
        REQUIRE_NEAR(c->fov, 20.0 * PELL_PI / 180.0, 1e-6);
        REQUIRE_NEAR(c->forward[2], -1.0, 0);
        for (int corner = 0; corner < 8; corner++) {
            const double x = corner & 1 ? s->bounds_max[0] : s->bounds_min[0], y = corner & 2 ? s->bounds_max[1] : s->bounds_min[1];
            const double z = corner & 4 ? s->bounds_max[2] : s->bounds_min[2], depth = c->position[2] - z;
            REQUIRE(depth > 0.0);
            fill[0] = fmax(fill[0], fabs(x - c->position[0]) / (depth * tan(0.5 * c->fov) * (aspect > 0.0f ? aspect : 16.0 / 9.0)));
            fill[1] = fmax(fill[1], fabs(y - c->position[1]) / (depth * tan(0.5 * c->fov)));
        }
        if (size[2] < 4.0f)
            REQUIRE_NEAR(fmax(fill[0], fill[1]), 0.8, 1e-3);
        else
            REQUIRE(fmax(fill[0], fill[1]) <= 0.801); /* a needle that points at the camera is kept at a distance */
        finish(s);
    }
}

/* Irradiance on a facing plane at a point, by summation over a fine grid on the rectangle. */
static double rect_irradiance(const struct pell_light *l, const float *point)
{
    enum { N = 64 };
    const struct pell_vec3 d = vec3_load(l->direction), up = vec3_load(l->up), right = vec3_cross(d, up);
    double sum = 0.0;

    for (int i = 0; i < N * N; i++) {
        const float x = ((float) (i % N) + 0.5f) / N - 0.5f, y = ((float) (i / N) + 0.5f) / N - 0.5f;
        const struct pell_vec3 p = vec3_mad(vec3_mad(vec3_load(l->position), x * l->width, right), y * l->height, up);
        const struct pell_vec3 to = vec3_sub(vec3_load(point), p);
        const double r2 = (double) vec3_dot(to, to), cosine = (double) vec3_dot(to, d) / sqrt(r2);
        sum += cosine * cosine / r2;
    }
    return l->power[1] * sum * l->width * l->height / (N * N);
}

static void studio_lights_are_as_bright_on_a_grain_as_on_a_house(void **state)
{
    double first[3] = { 0 };
    (void) state;

    for (int size = 0; size < 3; size++) {
        const struct pell_load_params params = { .size_mm = (double[]) { 1.0, 70.0, 9000.0 }[size] };
        struct pell_scene *s = load(CUBE, &params, NULL);
        float center[3];
        double sum = 0.0;
        for (int c = 0; c < 3; c++)
            center[c] = 0.5f * (s->bounds_min[c] + s->bounds_max[c]);
        assert_int_equal(s->num_lights, 3);
        for (int i = 0; i < 3; i++) {
            const double e = rect_irradiance(&s->lights[i], center);
            assert_int_equal(s->lights[i].type, PELL_LIGHT_RECT);
            if (size == 0)
                first[i] = e;
            REQUIRE_REL(e, first[i], 1e-4);
            sum += e;
        }
        REQUIRE(sum > PELL_PI && sum < 3.0 * PELL_PI);
        REQUIRE_REL(first[0], 0.85 * PELL_PI * 0.97, 1e-3); /* the irradiance that its radiance was chosen for; green of the tint */
        REQUIRE(s->lights[0].position[0] < center[0] && s->lights[0].position[1] > center[1] && s->lights[0].position[2] > center[2]);
        REQUIRE(s->lights[2].position[2] < s->bounds_min[2]); /* the rim light comes from behind */
        finish(s);
    }
}

/* For any side: the vertices fill 0.8 of the image in one direction, and none is outside. */
static void a_side_is_framed_by_the_vertices(void **state)
{
    static const struct {
        const char *from;
        float forward[3];
    } sides[] = { { "front", { 0, 0, -1 } }, { "back", { 0, 0, 1 } },  { "left", { 1, 0, 0 } },  { "right", { -1, 0, 0 } },
                  { "top", { 0, -1, 0 } },   { "90,0", { -1, 0, 0 } }, { "0,-90", { 0, 1, 0 } }, { "45,0", { -0.70711f, 0, -0.70711f } } };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(sides); k++) {
        const struct pell_load_params params = { .mm_per_unit = 7.0, .aspect = 1.5f, .from = sides[k].from };
        struct pell_scene *s = load("v 1 2 3\nv 5 2 3\nv 1 4 3\nv 1 2 6\nf 1 2 3\nf 1 4 2\n", &params, NULL);
        const struct pell_camera *c = &s->cameras[0];
        const struct pell_vec3 f = vec3_load(c->forward), up = vec3_load(c->up), right = vec3_cross(f, up);
        float fill = 0.0f;

        for (int i = 0; i < 3; i++)
            REQUIRE_NEAR(c->forward[i], sides[k].forward[i], 1e-5);
        REQUIRE_NEAR(vec3_dot(f, up), 0.0, 1e-6);
        for (uint32_t i = 0; i < s->meshes[0].num_vertices; i++) {
            const struct pell_vec3 p = vec3_sub(vec3_load(s->meshes[0].position + 3 * i), vec3_load(c->position));
            const float depth = vec3_dot(p, f), slope = tanf(0.5f * c->fov);
            REQUIRE(depth > 0.0f);
            fill = fmaxf(fill, fmaxf(fabsf(vec3_dot(p, up)) / (depth * slope), fabsf(vec3_dot(p, right)) / (depth * slope * 1.5f)));
        }
        REQUIRE_NEAR(fill, 0.8, 1e-3);
        finish(s);
    }
}

static void z_upwards_becomes_y(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 1.0, .up = "z" };
    struct pell_scene *s = load("v 1 2 3\nv 5 2 3\nv 1 4 9\nvn 0 0 1\nf 1//1 2//1 3//1\n", &params, NULL);
    (void) state;

    REQUIRE_NEAR(s->bounds_min[1], 3.0, 1e-6);
    REQUIRE_NEAR(s->bounds_max[1], 9.0, 1e-6);
    REQUIRE_NEAR(s->bounds_min[2], -4.0, 1e-6);
    REQUIRE_NEAR(s->bounds_max[2], -2.0, 1e-6);
    REQUIRE_NEAR(s->meshes[0].normal[1], 1.0, 1e-6);
    finish(s);
}

static void each_studio_has_its_lights(void **state)
{
    static const struct {
        const char *name;
        size_t lights, meshes;
    } studios[] = { { NULL, 3, 1 }, { "soft", 3, 1 }, { "rim", 3, 1 }, { "back", 2, 1 }, { "window", 2, 2 } };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(studios); k++) {
        const struct pell_load_params params = { .mm_per_unit = 10.0, .studio = studios[k].name };
        struct pell_scene *s = load(CUBE, &params, NULL);
        assert_int_equal(s->num_lights, studios[k].lights);
        assert_int_equal(s->num_meshes, studios[k].meshes);
        for (size_t i = 0; i < s->num_lights; i++)
            REQUIRE(s->lights[i].power[1] > 0.0f);
        finish(s);
    }
}

static void a_background_that_is_given_has_no_floor_before_it(void **state)
{
    const struct pell_load_params params = { .mm_per_unit = 10.0, .studio = "window", .background = "#ff8000" };
    struct pell_scene *s = load(CUBE, &params, NULL);
    (void) state;

    assert_int_equal(s->num_meshes, 1);
    assert_int_equal(s->background, PELL_BACKGROUND_COLOR);
    REQUIRE_NEAR(s->background_color[0], 1.0, 1e-6);
    REQUIRE_NEAR(s->background_color[1], pow((128.0 / 255.0 + 0.055) / 1.055, 2.4), 1e-6); /* IEC 61966-2-1 */
    REQUIRE_NEAR(s->background_color[2], 0.0, 1e-6);
    finish(s);
}

static void only_the_default_background_has_a_contact_shadow(void **state)
{
    static const struct memory_file files[] = { { "cube.obj", CUBE }, { NULL, NULL } };
    static const struct {
        const char *more;
        struct pell_load_params params;
        bool shadow;
    } cases[] = {
        { "", { 0 }, true },
        { "", { .studio = "rim" }, true },
        { "", { .studio = "window" }, false },
        { "", { .background = "white" }, false },
        { ",\"lights\":[]", { 0 }, true },
        { ",\"background\":{\"color\":[0.5,0.5,0.5]}", { 0 }, false },
        { ",\"background\":\"transparent\"", { 0 }, false },
        { ",\"ground\":true", { 0 }, false },
        { ",\"lights\":[{\"type\":\"environment\",\"color\":1}]", { 0 }, false },
    };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct pell_context *ctx = test_context(NULL, NULL);
        struct pell_text text = { 0 };
        struct pell_scene *s;
        pell_text_add(&text, "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"10mm\"%s}", cases[i].more);
        assert_int_equal(load_bytes(ctx, "s.json", text.str, text.length, &cases[i].params, files, &s), PELL_OK);
        if (s->contact_shadow != cases[i].shadow)
            fail_msg("%s", text.str);
        finish(s);
    }
}

static void lights_are_over_the_ground_from_any_side(void **state)
{
    static const char *const sides[] = { "front", "34", "-60,35", "20,60", "top", "0,-90" }, *const studios[] = { "soft", "rim", "back" };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(sides); i++)
        for (size_t k = 0; k < PELL_COUNT(studios); k++) {
            const struct pell_load_params params = { .mm_per_unit = 10.0, .from = sides[i], .studio = studios[k], .ground = true };
            struct pell_scene *s = load(CUBE, &params, NULL);
            assert_int_equal(s->ground_mesh, 1);
            for (size_t l = 0; l < s->num_lights; l++) {
                const struct pell_vec3 center = vec3_mul(vec3_add(vec3_load(s->bounds_min), vec3_load(s->bounds_max)), 0.5f);
                const struct pell_vec3 at = vec3_sub(vec3_load(s->lights[l].position), center);
                REQUIRE(at.y > 0.0f);
                if (strstr(s->lights[l].name, "rim") || strstr(s->lights[l].name, "back")) /* from behind: its plane misses the floor */
                    REQUIRE(at.y > 0.99f * hypotf(at.x, at.z));
            }
            finish(s);
        }
}

static void the_ground_is_a_floor_and_a_wall_out_of_the_bounds(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    static const struct memory_file files[] = { { "cube.obj", CUBE }, { NULL, NULL } };
    static const char scene[] = "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"10mm\",\"ground\":true,"
                                "\"camera\":{\"from\":[8,2,0.5],\"to\":[0.5,0.5,0.5]}}";
    struct pell_scene *s;
    const struct pell_mesh *m;
    const struct pell_material *material;
    (void) state;

    assert_int_equal(load_bytes(ctx, "s.json", scene, strlen(scene), NULL, files, &s), PELL_OK);
    assert_int_equal(s->num_meshes, 2);
    assert_int_equal(s->ground_mesh, 1);
    REQUIRE_NEAR(s->bounds_max[0], 10.0, 1e-4);
    m = &s->meshes[1];
    material = &s->materials[m->material];
    assert_string_equal(material->name, "ground");
    assert_true(material->opaque);
    REQUIRE_NEAR(material->base_color[1], 0.35, 1e-6);
    REQUIRE_NEAR(material->rho_s, 0.0, 0);
    for (uint32_t i = 0; i < m->num_vertices; i++) {
        REQUIRE(m->position[3 * i + 1] >= s->bounds_min[1] - 1e-4f);
        REQUIRE_NEAR(vec3_length(vec3_load(m->normal + 3 * i)), 1.0, 1e-5);
        if (m->position[3 * i + 1] > 60.0f)
            REQUIRE(m->position[3 * i] < -40.0f); /* the wall is behind the object, from this camera */
    }
    for (uint32_t i = 0; i < m->num_triangles; i++) {
        const struct pell_vec3 a = vec3_load(m->position + 3 * m->index[3 * i]), b = vec3_load(m->position + 3 * m->index[3 * i + 1]);
        const struct pell_vec3 c = vec3_load(m->position + 3 * m->index[3 * i + 2]);
        const struct pell_vec3 face = vec3_normalize(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)));
        for (int k = 0; k < 3; k++)
            REQUIRE(vec3_dot(face, vec3_load(m->normal + 3 * m->index[3 * i + k])) > 0.99f);
    }
    for (size_t i = 0; i < s->num_lights; i++) /* the corners of a light that is behind the object are above the floor, before the wall */
        for (int corner = 0; corner < 4 && s->lights[i].position[0] < 0.0f; corner++) {
            const struct pell_light *l = &s->lights[i];
            const struct pell_vec3 up = vec3_load(l->up), right = vec3_cross(vec3_load(l->direction), up);
            const struct pell_vec3 at = vec3_mad(vec3_mad(vec3_load(l->position), (corner & 1 ? 0.5f : -0.5f) * l->height, up),
                                                 (corner & 2 ? 0.5f : -0.5f) * l->width, right);
            int found = 0;
            for (uint32_t k = 0; k + 2 < m->num_vertices; k += 2) { /* the profile of the backdrop, from the floor's front on */
                const float *p = m->position + 3 * k, *q = p + 6;
                if (at.y >= p[1] && at.y < q[1]) {
                    REQUIRE(at.x > p[0] + (q[0] - p[0]) * (at.y - p[1]) / (q[1] - p[1]));
                    found++;
                }
            }
            assert_int_equal(found, 1);
        }
    finish(s);
}

/* As given by an option, or the file; an existing one stays the only one. */
static void in_an_environment_the_ground_is_a_table(void **state)
{
    static const struct memory_file files[] = { { "cube.obj", CUBE }, { NULL, NULL } };
    static const char *const said[] = { "", ",\"ground\":true" };
    struct pell_context *ctx = test_context(NULL, NULL);
    (void) state;

    for (int i = 0; i < 4; i++) { /* the last: before another background, which a backdrop would hide */
        const struct pell_load_params params = { .ground = i != 1, .background = i == 3 ? "white" : NULL };
        const struct pell_mesh *m;
        struct pell_scene *s;
        char scene[256];
        float radius;
        snprintf(scene, sizeof(scene),
                 "{\"pellucid\":1,\"mesh\":\"cube.obj\",\"unit\":\"10mm\",\"lights\":[{\"type\":\"environment\",\"color\":1}],"
                 "\"background\":\"environment\"%s}",
                 said[i > 0]);
        assert_int_equal(load_bytes(ctx, "s.json", scene, strlen(scene), &params, files, &s), PELL_OK);
        assert_int_equal(s->num_meshes, 2);
        assert_int_equal(s->ground_mesh, 1);
        assert_false(s->contact_shadow);
        m = &s->meshes[1];
        radius = 3.0f * 0.5f * vec3_length(vec3_sub(vec3_load(s->bounds_max), vec3_load(s->bounds_min)));
        for (uint32_t k = 0; k < m->num_vertices; k++) {
            const float *p = m->position + 3 * k;
            const struct pell_vec3 out =
                vec3(p[0] - 0.5f * (s->bounds_min[0] + s->bounds_max[0]), 0.0f, p[2] - 0.5f * (s->bounds_min[2] + s->bounds_max[2]));
            REQUIRE_NEAR(p[1], s->bounds_min[1], 1e-6);
            REQUIRE_NEAR(vec3_length(out), k + 1 < m->num_vertices ? radius : 0.0f, 1e-4f * radius);
        }
        for (uint32_t k = 0; k < m->num_triangles; k++) {
            struct pell_vec3 corner[3];
            pell_triangle_corners(m, k, corner);
            REQUIRE(pell_triangle_cross(corner).y > 0.0f);
        }
        pell_scene_destroy(&s);
    }
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

/* --- Units ------------------------------------------------------------------------------------------------------------------------- */

static void one_object_in_three_units_is_one_object(void **state)
{
    static const double units[] = { 1.0, 10.0, 1000.0 };
    struct pell_scene *s[3];
    (void) state;

    for (int u = 0; u < 3; u++) {
        const struct pell_load_params params = { .mm_per_unit = units[u], .bare = true };
        char text[2048], *at = text;
        for (int i = 0; i < 40; i++)
            at += sprintf(at, "v %.10g %.10g %.10g\n", 37.0 * cos(i) / units[u], 21.0 * sin(3.7 * i) / units[u], 0.9 * i / units[u]);
        for (int i = 0; i < 13; i++)
            at += sprintf(at, "f %d %d %d\n", 3 * i + 1, 3 * i + 2, 3 * i + 3);
        s[u] = load(text, &params, NULL);
    }
    for (int u = 1; u < 3; u++) {
        assert_int_equal(s[u]->meshes[0].num_vertices, s[0]->meshes[0].num_vertices);
        for (uint32_t i = 0; i < 3 * s[0]->meshes[0].num_vertices; i++)
            REQUIRE_NEAR(s[u]->meshes[0].position[i], s[0]->meshes[0].position[i], 1.2e-7 * 40.0);
    }
    for (int u = 0; u < 3; u++)
        finish(s[u]);
}

/* --- Scenes built by hand ------------------------------------------------------------------------------------------------------------ */

static enum pell_result complete_triangle(struct pell_context *ctx, void (*spoil)(struct pell_scene *))
{
    struct pell_scene *s;
    size_t mesh, material;
    enum pell_result res;

    assert_int_equal(pell_scene_create(ctx, &s), PELL_OK);
    assert_int_equal(pell_scene_add_material(s, "m", &material), PELL_OK);
    s->materials[0].opaque = false;
    assert_int_equal(pell_scene_add_mesh(s, "t", &mesh), PELL_OK);
    assert_int_equal(pell_mesh_allocate(s, mesh, 3, 1), PELL_OK);
    s->meshes[0].position[3] = s->meshes[0].position[7] = 10.0f;
    s->meshes[0].index[1] = 1;
    s->meshes[0].index[2] = 2;
    spoil(s);
    res = pell_scene_complete(s, NULL);
    pell_scene_destroy(&s);
    return res;
}

static void keep_whole(struct pell_scene *s)
{
    (void) s;
}
static void spoil_index(struct pell_scene *s)
{
    s->meshes[0].index[2] = 3;
}
static void spoil_position(struct pell_scene *s)
{
    s->meshes[0].position[4] = NAN;
}
static void spoil_far(struct pell_scene *s)
{
    s->meshes[0].position[4] = 1e30f;
}
static void spoil_size(struct pell_scene *s)
{
    for (uint32_t i = 0; i < 3 * s->meshes[0].num_vertices; i++)
        s->meshes[0].position[i] *= 1e-7f;
}
static void spoil_material(struct pell_scene *s)
{
    s->meshes[0].material = 1;
}
static void spoil_medium(struct pell_scene *s)
{
    s->materials[0].medium.sigma_a[1] = -1.0;
}
static void spoil_nan_medium(struct pell_scene *s)
{
    s->materials[0].medium.sigma_s_reduced[2] = NAN;
}
static void spoil_roughness(struct pell_scene *s)
{
    s->materials[0].roughness = NAN;
}
static void spoil_color(struct pell_scene *s)
{
    s->materials[0].base_color[1] = -0.5f;
}
static void spoil_gaussians(struct pell_scene *s)
{
    s->materials[0].gaussians.count = PELL_GAUSSIANS_MAX + 1;
}
static void spoil_light(struct pell_scene *s)
{
    size_t light;
    assert_int_equal(pell_scene_add_light(s, "l", &light), PELL_OK);
    s->lights[0].type = PELL_LIGHT_RECT; /* no size */
}
static void spoil_light_power(struct pell_scene *s)
{
    size_t light;
    assert_int_equal(pell_scene_add_light(s, "l", &light), PELL_OK);
    s->lights[0].power[0] = INFINITY;
}
static void spoil_camera(struct pell_scene *s)
{
    size_t camera;
    assert_int_equal(pell_scene_add_camera(s, "c", &camera), PELL_OK);
    s->cameras[0].fov = 1.0f; /* no direction */
}

static void values_that_a_renderer_could_not_trust_are_refused(void **state)
{
    static const struct {
        void (*spoil)(struct pell_scene *);
        const char *what;
    } bad[] = {
        { spoil_index, "refers to vertex 3; there are 3" },
        { spoil_position, "coordinate nan" },
        { spoil_far, "coordinate 1e+30" },
        { spoil_size, "largest extent is 1e-06 mm, allowed: 0.0005 mm or more" },
        { spoil_material, "material 1 does not exist" },
        { spoil_medium, "sigma_a[1] is -1" },
        { spoil_nan_medium, "sigma_s_reduced[2] is" },
        { spoil_roughness, "roughness is" },
        { spoil_color, "base colour green is -0.5" },
        { spoil_gaussians, "number of Gaussians is 11" },
        { spoil_light, "width or height" },
        { spoil_light_power, "power is inf" },
        { spoil_camera, "forward vector" },
    };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    (void) state;

    assert_int_equal(complete_triangle(ctx, keep_whole), PELL_OK);
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        const int before = kept.errors;
        REQUIRE(complete_triangle(ctx, bad[i].spoil) != PELL_OK);
        assert_int_equal(kept.errors, before + 1);
        if (!strstr(kept.what, bad[i].what))
            fail_msg("\"%s\" is not in \"%s\"", bad[i].what, kept.what);
    }
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void transforms_keep_normals_at_right_angles_and_turn_mirrored_triangles(void **state)
{
    char *soup = sphere_obj(12, 5.0, true, false);
    struct pell_scene *s = load(soup, &bare_mm, NULL);
    struct pell_mat4 m = mat4_identity();
    const struct pell_mesh *mesh = &s->meshes[0];
    (void) state;

    m.m[0] = -3.0; /* reflects, and scales non-uniformly */
    m.m[4] = 0.5;
    m.m[10] = 0.2;
    m.m[12] = 100.0;
    assert_int_equal(pell_scene_transform(s, &m, 1.0), PELL_OK);
    REQUIRE(volume(mesh) > 0.0);
    for (uint32_t i = 0; i < mesh->num_triangles; i++) {
        const struct pell_vec3 a = vec3_load(mesh->position + 3 * mesh->index[3 * i]),
                               b = vec3_load(mesh->position + 3 * mesh->index[3 * i + 1]);
        const struct pell_vec3 c = vec3_load(mesh->position + 3 * mesh->index[3 * i + 2]);
        const struct pell_vec3 face = vec3_normalize(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)));
        for (int k = 0; k < 3; k++) {
            const struct pell_vec3 n = vec3_load(mesh->normal + 3 * mesh->index[3 * i + k]);
            REQUIRE_NEAR(vec3_length(n), 1.0, 1e-5);
            REQUIRE(vec3_dot(face, n) > 0.0f);
        }
    }
    finish(s);
    free(soup);
}

static void media_are_scaled_with_their_unit_and_presets_are_not(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s;
    struct pell_mat4 m = mat4_identity();
    size_t a, b, light;
    (void) state;

    assert_int_equal(pell_scene_create(ctx, &s), PELL_OK);
    assert_int_equal(pell_scene_add_material(s, "per metre", &a), PELL_OK);
    assert_int_equal(pell_scene_add_material(s, "preset", &b), PELL_OK);
    assert_int_equal(pell_scene_add_light(s, "l", &light), PELL_OK);
    s->materials[a].opaque = false;
    s->materials[a].medium.sigma_a[0] = 500.0;
    s->lights[0].direction[0] = 1.0f;
    s->lights[0].position[1] = 0.25f;
    s->lights[0].range = 2.0f;
    assert_int_equal(pell_material_apply(s, b, "test", "wholemilk"), PELL_OK);
    for (int i = 0; i < 3; i++)
        m.m[5 * i] = 1000.0;
    assert_int_equal(pell_scene_transform(s, &m, 1000.0), PELL_OK);
    REQUIRE_NEAR(s->materials[a].medium.sigma_a[0], 0.5, 1e-12);
    REQUIRE_NEAR(s->materials[b].medium.sigma_s_reduced[0], pell_material_find("wholemilk")->medium.sigma_s_reduced[0], 0);
    REQUIRE_NEAR(s->lights[0].position[1], 250.0, 0);
    REQUIRE_NEAR(s->lights[0].range, 2000.0, 0);
    REQUIRE_NEAR(s->lights[0].direction[0], 1.0, 0);
    finish(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cube_keeps_flat_faces),
        cmocka_unit_test(a_sphere_is_smooth_however_its_vertices_are_split),
        cmocka_unit_test(facets_are_told_of_and_smoothed_on_demand),
        cmocka_unit_test(flat_normals_are_those_of_the_triangles),
        cmocka_unit_test(normals_weigh_faces_by_area_times_angle),
        cmocka_unit_test(degenerate_triangles_do_not_hurt),
        cmocka_unit_test(what_is_too_far_for_its_size_is_told),
        cmocka_unit_test(repeated_triangles_are_left_out),
        cmocka_unit_test(very_many_repeated_triangles_take_no_time),
        cmocka_unit_test(single_missing_normals_are_filled),
        cmocka_unit_test(what_is_inside_out_is_turned_with_its_normals),
        cmocka_unit_test(the_wall_of_a_hollow_stays_as_it_is),
        cmocka_unit_test(triangles_face_as_their_neighbours_do),
        cmocka_unit_test(what_is_nearly_closed_is_turned),
        cmocka_unit_test(a_hollow_is_turned_with_what_is_around_it),
        cmocka_unit_test(maps_of_floats_are_limited),
        cmocka_unit_test(tangents_follow_u_and_bitangents_run_up),
        cmocka_unit_test(vertices_of_both_handednesses_are_split),
        cmocka_unit_test(made_tangents_agree_with_those_of_a_file),
        cmocka_unit_test(the_default_camera_fills_eighty_percent),
        cmocka_unit_test(a_side_is_framed_by_the_vertices),
        cmocka_unit_test(z_upwards_becomes_y),
        cmocka_unit_test(each_studio_has_its_lights),
        cmocka_unit_test(only_the_default_background_has_a_contact_shadow),
        cmocka_unit_test(studio_lights_are_as_bright_on_a_grain_as_on_a_house),
        cmocka_unit_test(a_background_that_is_given_has_no_floor_before_it),
        cmocka_unit_test(lights_are_over_the_ground_from_any_side),
        cmocka_unit_test(the_ground_is_a_floor_and_a_wall_out_of_the_bounds),
        cmocka_unit_test(in_an_environment_the_ground_is_a_table),
        cmocka_unit_test(one_object_in_three_units_is_one_object),
        cmocka_unit_test(values_that_a_renderer_could_not_trust_are_refused),
        cmocka_unit_test(transforms_keep_normals_at_right_angles_and_turn_mirrored_triangles),
        cmocka_unit_test(media_are_scaled_with_their_unit_and_presets_are_not),
    };
    return cmocka_run_group_tests_name("complete", tests, NULL, NULL);
}
