/* SPDX-License-Identifier: MIT
 * test_obj.c - OBJ and MTL: supported statements, triangulation of polygons, and refusals with their messages. */
#include "scene_test.h"
#include "slow.h"

#include "image/color.h"
#include "scene/mesh/polygon.h"

#include <sys/stat.h>

static struct pell_scene *load(const char *text)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *scene;

    assert_int_equal(load_text(ctx, "test.obj", text, &bare_mm, &scene), PELL_OK);
    return scene;
}

static void drop(struct pell_scene *scene)
{
    struct pell_context *ctx = scene->ctx;

    pell_scene_destroy(&scene);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void same_quad(const char *text)
{
    struct pell_scene *s = load(text);

    assert_int_equal(s->num_meshes, 1);
    assert_int_equal(s->meshes[0].num_triangles, 2);
    assert_int_equal(s->meshes[0].num_vertices, 4);
    REQUIRE_NEAR(mesh_area(&s->meshes[0]), 6.0, 1e-6);
    REQUIRE_NEAR(s->meshes[0].normal[2], 1.0, 1e-6);
    drop(s);
}

static void a_quad_is_the_same_however_it_is_written(void **state)
{
    (void) state;
    same_quad("v 0 0 0\nv 2 0 0\nv 2 3 0\nv 0 3 0\nf 1 2 3 4\n");
    same_quad("v 0 0 0\nv 2 0 0\nv 2 3 0\nv 0 3 0\nf -4 -3 -2 -1\n");
    same_quad("v 0 0 0\r\nv 2 0 0\r\nv 2 3 0\r\nv 0 3 0\r\nf 1 2 3 4\r\n");
    same_quad("v 0 0 0\rv 2 0 0\rv 2 3 0\rv 0 3 0\rf 1 2 3 4");
    same_quad("\xef\xbb\xbf# a comment that ends in a backslash \\\nv 0 0 0\nv\t2  0.0e0 0 \n v 2 \\\n 3 0\nv 0 300e-2 0\nf 1 2 \\\r\n 3 4 "
              "# end");
    same_quad("v 0 0 0 1\nv 2 0 0 1\nv 2 3 0 1\nv 0 3 0 1\ng a b\ns off\nf 1// 2// 3// 4//\n");
    same_quad("v 0 0 0\nv 2 0 0\nv 2 3 0\nv 0 3 0\nvt 0 0\nf 1/1 2/1 3/1 4/1\n");
    same_quad("v .0 -0 0.\nv +2 0 0\nv 2 3.000000000000000000000000000 0\nv 0.00000000000000000000000000000000000001e-9 3 0\nfo 1 2 3 4\n");
}

/* Twice the area of a polygon in the plane, by the shoelace formula. */
static double shoelace(const float (*p)[2], size_t n)
{
    double sum = 0.0;
    for (size_t i = 0; i < n; i++)
        sum += (double) p[i][0] * p[(i + 1) % n][1] - (double) p[(i + 1) % n][0] * p[i][1];
    return sum;
}

static void cut_and_compare(const float (*p)[2], size_t n, int plane, bool backward)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_polygon polygon = { .ctx = ctx };
    double area = 0.0, want = shoelace(p, n);
    int signs[2] = { 0, 0 };

    assert_int_equal(pell_polygon_reserve(&polygon, n), PELL_OK);
    for (size_t i = 0; i < n; i++) {
        const size_t k = backward ? n - 1 - i : i;
        float *to = polygon.point + 3 * i;
        to[plane] = p[k][0];
        to[(plane + 1) % 3] = p[k][1];
        to[(plane + 2) % 3] = 0.25f * p[k][0] - 0.5f * p[k][1]; /* a tilted plane */
    }
    pell_polygon_triangulate(&polygon, n);
    for (size_t t = 0; t < n - 2; t++) {
        const uint32_t *v = polygon.triangle + 3 * t;
        double a;
        for (int k = 0; k < 3; k++)
            REQUIRE(v[k] < n);
        a = 0.0;
        for (int k = 0; k < 3; k++) {
            const float *q = polygon.point + 3 * v[k], *r = polygon.point + 3 * v[(k + 1) % 3];
            a += (double) q[plane] * r[(plane + 1) % 3] - (double) r[plane] * q[(plane + 1) % 3];
        }
        area += fabs(a);
        signs[a > 0.0] += fabs(a) > 1e-9;
    }
    /* No triangle is flipped and together they have the polygon's area: so they cover it exactly once. */
    REQUIRE_REL(area, fabs(want), 1e-6);
    REQUIRE(signs[((want > 0.0) != backward) ? 0 : 1] == 0);
    pell_polygon_finish(&polygon);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void concave_polygons_are_covered_once(void **state)
{
    static const float ell[][2] = { { 0, 0 }, { 3, 0 }, { 3, 1 }, { 1, 1 }, { 1, 3 }, { 0, 3 } };
    static const float arrow[][2] = { { 0, 0 }, { 2, -1 }, { 1, 0 }, { 2, 1 } };
    static const float comb[][2] = { { 0, 0 }, { 7, 0 }, { 7, 3 }, { 6, 3 }, { 6, 1 }, { 5, 1 }, { 5, 3 }, { 4, 3 },
                                     { 4, 1 }, { 3, 1 }, { 3, 3 }, { 2, 3 }, { 2, 1 }, { 1, 1 }, { 1, 3 }, { 0, 3 } };
    static const float straight[][2] = { { 0, 0 }, { 1, 0 }, { 2, 0 }, { 2, 1 }, { 2, 2 }, { 1, 2 }, { 0, 2 }, { 0, 1 } };
    float star[2 * 37][2], circle[1000][2];
    (void) state;

    for (int i = 0; i < 2 * 37; i++) {
        const double r = i % 2 ? 0.2 : 1.0, a = PELL_PI * i / 37;
        star[i][0] = (float) (r * cos(a));
        star[i][1] = (float) (r * sin(a));
    }
    for (int i = 0; i < 1000; i++) {
        circle[i][0] = (float) cos(2 * PELL_PI * i / 1000);
        circle[i][1] = (float) sin(2 * PELL_PI * i / 1000);
    }
    for (int plane = 0; plane < 3; plane++)
        for (int backward = 0; backward < 2; backward++) {
            cut_and_compare(ell, PELL_COUNT(ell), plane, backward);
            cut_and_compare(arrow, PELL_COUNT(arrow), plane, backward);
            cut_and_compare(comb, PELL_COUNT(comb), plane, backward);
            cut_and_compare(straight, PELL_COUNT(straight), plane, backward);
            cut_and_compare((const float(*)[2]) star, PELL_COUNT(star), plane, backward);
            cut_and_compare((const float(*)[2]) circle, PELL_COUNT(circle), plane, backward);
        }
}

static void a_giant_spiral_ends_in_bounded_time(void **state)
{
    enum { N = 60000 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_polygon polygon = { .ctx = ctx };
    const double start = busy_seconds();
    (void) state;

    assert_int_equal(pell_polygon_reserve(&polygon, N), PELL_OK);
    for (int i = 0; i < N; i++) {
        const int k = i < N / 2 ? i : N - 1 - i;
        const double r = 1.0 + 0.001 * k + (i < N / 2 ? 0.0 : 0.0005), a = 0.05 * k;
        polygon.point[3 * i] = (float) (r * cos(a));
        polygon.point[3 * i + 1] = (float) (r * sin(a));
        polygon.point[3 * i + 2] = 0.0f;
    }
    pell_polygon_triangulate(&polygon, N);
    for (int i = 0; i < 3 * (N - 2); i++)
        REQUIRE(polygon.triangle[i] < N);
    REQUIRE(busy_seconds() - start < 20.0);
    pell_polygon_finish(&polygon);
    pell_context_destroy(&ctx);
}

static void corners_share_a_vertex_only_if_all_three_numbers_agree(void **state)
{
    struct pell_scene *s = load("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0.25\nvn 0 0 1\nvn 0 1 0\n"
                                "f 1/1/1 2/1/1 3/1/1\nf 2/1/1 4/1/1 3/2/1\nf 3/2/1 2/1/2 1/1/1\nf 3/2/1 1/1/1 4/1/1\n");
    const struct pell_mesh *m = &s->meshes[0];
    (void) state;

    assert_int_equal(m->num_triangles, 4);
    assert_int_equal(m->num_vertices, 6); /* 1/1/1 2/1/1 3/1/1 4/1/1 3/2/1 2/1/2 */
    assert_int_equal(m->index[5], m->index[6]);
    assert_int_equal(m->index[6], m->index[9]);
    REQUIRE_NEAR(m->uv[0][2 * m->index[5]], 1.0, 0);
    REQUIRE_NEAR(m->uv[0][2 * m->index[5] + 1], 0.75, 0); /* v runs down here */
    REQUIRE_NEAR(m->normal[3 * m->index[7] + 1], 1.0, 0);
    drop(s);
}

static void objects_and_materials_make_meshes(void **state)
{
    struct pell_scene *s =
        load("o one\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nusemtl red\nf 1 2 3\nusemtl blue\nf 2 4 3\nusemtl red\nf 1 2 4\n"
             "o two\nf 1 2 3\ng part\nusemtl blue\nf 1 2 3\nf 1 3 4\n");
    static const struct {
        const char *name, *material;
        uint32_t triangles;
        int object;
    } want[] = { { "one", "red", 2, 0 }, { "one", "blue", 1, 0 }, { "two", "red", 1, 1 }, { "two", "blue", 2, 1 } };
    (void) state;

    assert_int_equal(s->num_meshes, PELL_COUNT(want));
    for (size_t i = 0; i < PELL_COUNT(want); i++) {
        assert_string_equal(s->meshes[i].name, want[i].name);
        assert_string_equal(s->materials[s->meshes[i].material].name, want[i].material);
        assert_int_equal(s->meshes[i].num_triangles, want[i].triangles);
        assert_int_equal(s->meshes[i].object - s->meshes[0].object, want[i].object);
    }
    drop(s);
}

static void vertex_colours_are_display_values(void **state)
{
    struct pell_scene *s = load("v 0 0 0\nv 1 0 0 0.5 1 0\nv 0 1 0 0 0 0\nf 1 2 3\n");
    (void) state;

    assert_non_null(s->meshes[0].color);
    REQUIRE_NEAR(s->meshes[0].color[0], 1.0, 0); /* no colours in the file: white */
    REQUIRE_NEAR(s->meshes[0].color[4], 0.21404, 1e-4);
    REQUIRE_NEAR(s->meshes[0].color[5], 1.0, 1e-6);
    REQUIRE_NEAR(s->meshes[0].color[6], 0.0, 0);
    drop(s);
}

/* --- Materials ------------------------------------------------------------------------------------------------------------------- */

static char folder[256];

static void write_text(const char *name, const char *text)
{
    char path[512];
    FILE *file;

    snprintf(path, sizeof(path), "%s/%s", folder, name);
    file = fopen(path, "wb");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

static void write_png(const char *name, int channels)
{
    static const float values[4] = { 0.25f, 0.5f, 0.75f, 1.0f };
    const struct pell_channel rgba[4] = {
        { "R", values, 2, false },
        { "G", values, 2, false },
        { "B", values, 2, false },
        { "A", values, 2, false },
    };
    const struct pell_write_params params = { .width = 2, .height = 2, .channels = rgba, .num_channels = (size_t) channels };
    struct pell_context *ctx = test_context(NULL, NULL);
    char path[512];

    snprintf(path, sizeof(path), "%s/%s", folder, name);
    assert_int_equal(pell_image_write(ctx, path, NULL, &params), PELL_OK);
    pell_context_destroy(&ctx);
}

static int make_folder(void **state)
{
    (void) state;
    snprintf(folder, sizeof(folder), "%s/pell-obj-XXXXXX", getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp");
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
    char command[512];
    (void) state;
    snprintf(command, sizeof(command), "rm -r '%s'", folder);
    return system(command) == 0 ? 0 : -1;
}

static void materials_come_from_their_libraries(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_scene *s;
    const struct pell_material *m;
    char path[512];
    (void) state;

    mkdir((snprintf(path, sizeof(path), "%s/sub", folder), path), 0777);
    write_png("sub/color.png", 4);
    write_png("sub/flat.png", 3);
    write_text("sub/my paint.mtl", "# \\\nnewmtl paint\nKd 0.5 0.25 0.125\nKs 0.25 0.5 0.125\nNs 30\nPm 0.5\nKe 1 2 3\n"
                                   "map_Kd -s 2 4 1 -o 0.5 0.25 -mm 0 1 -clamp on color.png\nmap_d color.png\nnorm flat.png\n"
                                   "map_Pr flat.png\nbump -bm 2 height.png\n"
                                   "newmtl two words\nd 0.5\nKs 0 0 0\nPr 0.3\nmap_Kd gone.png\n");
    write_text("a.obj", "mtllib missing.mtl also-missing.mtl\nmtllib sub\\my paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
                        "usemtl paint\nf 1/1 2/2 3/3\nusemtl two words\nf 1 2 3\nusemtl nowhere\nf 1 2 3\n");
    snprintf(path, sizeof(path), "%s/a.obj", folder);
    assert_int_equal(pell_scene_load(ctx, path, &bare_mm, &s), PELL_OK);
    assert_int_equal(kept.errors, 0);
    assert_int_equal(s->num_materials, 3);

    m = &s->materials[0];
    REQUIRE(m->opaque && !m->preset);
    REQUIRE_NEAR(m->base_color[1], 0.25, 0);
    REQUIRE_NEAR(m->rho_s, 1.0, 0); /* 2 max(Ks) */
    REQUIRE_NEAR(m->specular_color[0], 0.5, 1e-6);
    REQUIRE_NEAR(m->roughness, pow(2.0 / 32.0, 0.25), 1e-6);
    REQUIRE_NEAR(m->metallic, 0.5, 0);
    REQUIRE_NEAR(m->emissive[2], 3.0, 0);
    assert_non_null(m->base_color_map.texture);
    assert_int_equal(m->base_color_map.texture->wrap_u, PELL_WRAP_CLAMP);
    assert_true(m->alpha_mask);
    REQUIRE_NEAR(m->base_color_map.matrix[0], 2.0, 0);
    REQUIRE_NEAR(m->base_color_map.matrix[2], 0.5, 0);
    /* In the library's axes v = 4 v0 + 0.25; here v' = 1 - v and v0' = 1 - v0. */
    REQUIRE_NEAR(m->base_color_map.matrix[4] * (1.0 - 0.3) + m->base_color_map.matrix[5], 1.0 - (4.0 * 0.3 + 0.25), 1e-6);
    assert_non_null(m->normal_map.texture);
    assert_int_equal(m->normal_map.texture->image.srgb, 0); /* data, while the same file as a colour would be sRGB */
    assert_ptr_equal(m->roughness_map.texture, m->normal_map.texture);
    assert_non_null(s->meshes[0].tangent);

    m = &s->materials[1];
    assert_string_equal(m->name, "two words");
    REQUIRE_NEAR(m->rho_s, 0.0, 0);
    REQUIRE_NEAR(m->roughness, 0.3, 1e-6);
    assert_null(m->base_color_map.texture);

    m = &s->materials[2];
    assert_string_equal(m->name, "nowhere");
    assert_string_equal(m->preset, "marble");
    assert_false(m->opaque);
    /* two missing libraries (2 each: the reason, the consequence), height map, opacity, the missing image (2), the undefined material */
    assert_int_equal(kept.warnings, 9);
    pell_scene_destroy(&s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void files_outside_the_folder_are_left_out(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_scene *s;
    char path[512];
    (void) state;

    mkdir((snprintf(path, sizeof(path), "%s/inner", folder), path), 0777);
    write_png("outside.png", 3);
    write_text("inner/b.mtl", "newmtl m\nmap_Kd ../outside.png\n");
    write_text("inner/b.obj", "mtllib b.mtl ../sub/x.mtl /etc/passwd\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    snprintf(path, sizeof(path), "%s/inner/b.obj", folder);
    assert_int_equal(pell_scene_load(ctx, path, &bare_mm, &s), PELL_OK);
    assert_null(s->materials[0].base_color_map.texture);
    assert_int_equal(s->num_textures, 0);
    assert_int_equal(kept.errors, 0);
    REQUIRE(kept.warnings >= 6);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

/* --- Refusals ---------------------------------------------------------------------------------------------------------------------- */

static void broken_files_are_refused_with_the_line(void **state)
{
    static const struct {
        const char *text, *where, *what;
    } bad[] = {
        { "v 0 0 0\nv 1 0 x\n", "bad.obj:2", "z is \"x\", must be a finite number" },
        { "v 0 0\n", "bad.obj:1", "z is \"\"" },
        { "v 0 0 nan\n", "bad.obj:1", "z is \"nan\"" },
        { "v 0 0 1e99\n", "bad.obj:1", "z is \"1e99\"" },
        { "v 0 0 0\n# \n\nf 1 2 3\n", "bad.obj:4", "vertex 2, allowed: 1 to 1" },
        { "v 0 0 0\nf 0 1 1\n", "bad.obj:2", "vertex 0, allowed" },
        { "v 0 0 0\nf 1 1 -2\n", "bad.obj:2", "vertex -2, allowed" },
        { "v 0 0 0\nf 1/1 1 1\n", "bad.obj:2", "texture coordinate 1 before there is one" },
        { "v 0 0 0\nf 1//5 1 1\n", "bad.obj:2", "normal 5 before there is one" },
        { "v 0 0 0\nf 1 1 1.5\n", "bad.obj:2", "corner is \"1.5\"" },
        { "v 0 0 0\nf 1 1 99999999999999999999\n", "bad.obj:2", "corner is \"99999999999999999999\"" },
        { "v 0 0 0\nf 1 1 1/a\n", "bad.obj:2", "corner is \"1/a\"" },
        { "vt x\n", "bad.obj:1", "u is \"x\"" },
        { "vn 0 0\n", "bad.obj:1", "a normal's component" },
        { "v 0 0 0\n", "bad.obj", "holds no faces" },
        { "", "bad.obj", "holds no faces" },
        { "v 0 0 0\nl 1 1\nf 1 1\n", "bad.obj", "holds no faces" },
    };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        struct kept_messages kept = { 0 };
        struct pell_context *ctx = test_context(NULL, &kept);
        struct pell_scene *s;
        assert_int_equal(load_text(ctx, "bad.obj", bad[i].text, &bare_mm, &s), PELL_ERR_FORMAT);
        assert_null(s);
        assert_int_equal(kept.errors, 1);
        assert_string_equal(kept.where, bad[i].where);
        if (!strstr(kept.what, bad[i].what))
            fail_msg("\"%s\" is not in \"%s\"", bad[i].what, kept.what);
        assert_int_equal(pell_memory_used(ctx), 0);
        pell_context_destroy(&ctx);
    }
}

static void lines_points_and_curves_are_counted_once(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_scene *s;
    (void) state;

    assert_int_equal(load_text(ctx, "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2\nl 2 3\np 1\ncurv 0 1 1 2\nf 1 2 3\nf 1 2\n", &bare_mm, &s),
                     PELL_OK);
    assert_int_equal(kept.warnings, 1);
    assert_non_null(strstr(kept.last_warning, "2 lines, 1 point, 1 curve or surface, 1 face of fewer"));
    pell_scene_destroy(&s);
    assert_int_equal(load_text(ctx, "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", &bare_mm, &s), PELL_OK);
    assert_int_equal(kept.warnings, 1);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void limits_hold_before_memory_is_taken(void **state)
{
    struct pell_limits limits;
    struct kept_messages kept = { 0 };
    struct pell_context_params params = { .log = keep_message, .log_user = &kept, .limits = &limits };
    struct pell_context *ctx;
    struct pell_scene *s;
    (void) state;

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.vertices = 7;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(load_text(ctx, "a.obj", CUBE, &bare_mm, &s), PELL_ERR_UNSUPPORTED);
    pell_context_destroy(&ctx);

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.vertices = 3;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(load_text(ctx, "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n", &bare_mm, &s), PELL_ERR_UNSUPPORTED);
    assert_non_null(strstr(kept.where, "a.obj:4"));
    pell_context_destroy(&ctx);

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.vertices = 23; /* creases split 8 vertices into 24 */
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(load_text(ctx, "a.obj", CUBE, &bare_mm, &s), PELL_ERR_UNSUPPORTED);
    pell_context_destroy(&ctx);

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.triangles = 11;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(load_text(ctx, "a.obj", CUBE, &bare_mm, &s), PELL_ERR_UNSUPPORTED);
    assert_int_equal(kept.errors, 4);
    pell_context_destroy(&ctx);

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.items = 2;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(load_text(ctx, "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\no 1\nf 1 2 3\no 2\nf 1 2 3\no 3\nf 1 2 3\n", &bare_mm, &s),
                     PELL_ERR_UNSUPPORTED);
    pell_context_destroy(&ctx);
}

/* Each prefix of a file, and many files with a few changed bytes: an error or a scene, never a crash or a leak. */
static void damaged_files_end_well(void **state)
{
    static const char *const texts[] = {
        CUBE,
        "mtllib a.mtl\no x\nusemtl m\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1 4/2/1\n"
        "f -4//1 \\\n -3//-1 -2//1\nl 1 2\ng q\nusemtl n\nf 4 3 2 1 2 3 4 1\n",
    };
    uint64_t random = 88172645463325252ull;
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(texts); k++) {
        const size_t size = strlen(texts[k]);
        struct pell_context *ctx = test_context(NULL, NULL);
        struct pell_scene *s;
        char copy[1024];
        for (size_t n = 0; n <= size; n++) {
            if (load_bytes(ctx, "a.obj", texts[k], n, &in_mm, NULL, &s) == PELL_OK)
                pell_scene_destroy(&s);
            REQUIRE(!s && pell_memory_used(ctx) == 0);
        }
        for (int n = 0; n < 4000; n++) {
            memcpy(copy, texts[k], size);
            for (int change = 0; change < 1 + n % 4; change++) {
                random ^= random << 13;
                random ^= random >> 7;
                random ^= random << 17;
                copy[random % size] = (char) (random >> 40 & 1 ? random >> 32 : (uint64_t) "0123456789-/. \n\\efvnl"[random >> 45 & 15]);
            }
            if (load_bytes(ctx, "a.obj", copy, size, &in_mm, NULL, &s) == PELL_OK)
                pell_scene_destroy(&s);
            REQUIRE(!s && pell_memory_used(ctx) == 0);
        }
        pell_context_destroy(&ctx);
    }
}

static void every_failed_allocation_is_survived(void **state)
{
    const char *text = "mtllib x.mtl\no x\nusemtl m\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 1\n"
                       "f 1/1 2/2 3/1 4/2\nf 1/1 4/1 3/2\ng q\nusemtl n\nf 1 2 5\nf 1 4 3 2 5\n";
    enum pell_result res = PELL_ERR_NOMEM;
    (void) state;

    for (uint64_t n = 1; res != PELL_OK; n++) {
        struct pell_alloc_fault fault = { .fail_at = n };
        struct pell_context *ctx = test_context(&fault, NULL);
        struct pell_scene *s = NULL;
        if (!ctx)
            continue;
        res = load_text(ctx, "a.obj", text, &in_mm, &s);
        REQUIRE(res == PELL_OK || (res == PELL_ERR_NOMEM && !s));
        pell_scene_destroy(&s);
        pell_context_destroy(&ctx);
        assert_int_equal(atomic_load(&fault.live), 0);
        REQUIRE(n < 1000);
    }
}

/* --- Files of other programs --------------------------------------------------------------------------------------------------------- */

static void check_asset(const char *name, uint32_t triangles, double extent_ratio)
{
    const char *path = shared_file(name); /* skips where it is absent */
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_load_params params = { .size_mm = 100.0, .bare = true };
    struct pell_scene *s;
    float smallest = INFINITY, largest = 0.0f;

    assert_int_equal(pell_scene_load(ctx, path, &params, &s), PELL_OK);
    assert_int_equal(s->num_meshes, 1);
    assert_int_equal(s->meshes[0].num_triangles, triangles);
    for (int c = 0; c < 3; c++) {
        smallest = fminf(smallest, s->bounds_max[c] - s->bounds_min[c]);
        largest = fmaxf(largest, s->bounds_max[c] - s->bounds_min[c]);
    }
    REQUIRE_NEAR(largest, 100.0, 1e-3);
    REQUIRE_NEAR(smallest / largest, extent_ratio, 5e-4);
    pell_scene_destroy(&s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void bunny_hr_loads(void **state)
{
    (void) state;
    check_asset("assets/bunny/bunny_hr.obj", 59664, 30.94 / 40.0);
}

static void hand_loads(void **state)
{
    (void) state;
    check_asset("assets/hand/hand_closed.obj", 15982, 11.4 / 40.0);
}

static void spot_of_quads_is_spot_of_triangles(void **state)
{
    (void) state;
    check_asset("assets/spot/spot_triangulated.obj", 5856, 21.96 / 40.0);
    check_asset("assets/spot/spot_quadrangulated.obj", 5856, 21.96 / 40.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_quad_is_the_same_however_it_is_written),
        cmocka_unit_test(concave_polygons_are_covered_once),
        cmocka_unit_test(a_giant_spiral_ends_in_bounded_time),
        cmocka_unit_test(corners_share_a_vertex_only_if_all_three_numbers_agree),
        cmocka_unit_test(objects_and_materials_make_meshes),
        cmocka_unit_test(vertex_colours_are_display_values),
        cmocka_unit_test(materials_come_from_their_libraries),
        cmocka_unit_test(files_outside_the_folder_are_left_out),
        cmocka_unit_test(broken_files_are_refused_with_the_line),
        cmocka_unit_test(lines_points_and_curves_are_counted_once),
        cmocka_unit_test(limits_hold_before_memory_is_taken),
        cmocka_unit_test(damaged_files_end_well),
        cmocka_unit_test(every_failed_allocation_is_survived),
        cmocka_unit_test(bunny_hr_loads),
        cmocka_unit_test(hand_loads),
        cmocka_unit_test(spot_of_quads_is_spot_of_triangles),
    };
    return cmocka_run_group_tests_name("obj", tests, make_folder, remove_folder);
}
