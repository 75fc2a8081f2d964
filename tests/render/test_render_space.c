/* SPDX-License-Identifier: MIT
 * test_render_space.c - the whole renderer: independence of units, distance, resolution, tessellation and background, and behaviour at
 * edges. */
#include "stage.h"

static const char *const off[] = { "through=off", NULL };

/* --- Units ------------------------------------------------------------------------------------------------------------------------- */

static char folder[] = "/tmp/pell-space-XXXXXX";

static const char *in_folder(const char *name)
{
    static char path[4][128];
    static int next;
    char *p = path[next++ % 4];

    snprintf(p, sizeof(path[0]), "%s/%s", folder, name);
    return p;
}

/* A ball of 30 mm with a dent, in a unit of `mm`: as OBJ, or glTF (in metres). */
static void write_ball(const struct pell_mesh *ball, const char *name, double mm, bool gltf)
{
    const uint32_t n = ball->num_vertices, t = ball->num_triangles;
    FILE *f = fopen(in_folder(name), "w");

    assert_non_null(f);
    if (gltf) {
        FILE *bin = fopen(in_folder("ball.bin"), "wb");
        float low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
        assert_non_null(bin);
        for (uint32_t i = 0; i < 3 * n; i++) {
            const float v = (float) ((double) ball->position[i] / mm);
            low[i % 3] = fminf(low[i % 3], v);
            high[i % 3] = fmaxf(high[i % 3], v);
            fwrite(&v, sizeof(v), 1, bin);
        }
        fwrite(ball->index, sizeof(uint32_t), 3 * (size_t) t, bin);
        fclose(bin);
        fprintf(
            f,
            "{\"asset\": {\"version\": \"2.0\"}, \"scene\": 0, \"scenes\": [{\"nodes\": [0]}], \"nodes\": [{\"mesh\": 0}],"
            "\"meshes\": [{\"primitives\": [{\"attributes\": {\"POSITION\": 0}, \"indices\": 1}]}],"
            "\"buffers\": [{\"uri\": \"ball.bin\", \"byteLength\": %u}], \"bufferViews\": [{\"buffer\": 0, \"byteLength\": %u},"
            "{\"buffer\": 0, \"byteOffset\": %u, \"byteLength\": %u}],"
            "\"accessors\": [{\"bufferView\": 0, \"componentType\": 5126, \"count\": %u, \"type\": \"VEC3\", \"min\": [%.9g, %.9g, %.9g],"
            "\"max\": [%.9g, %.9g, %.9g]}, {\"bufferView\": 1, \"componentType\": 5125, \"count\": %u, \"type\": \"SCALAR\"}]}",
            12 * (n + t), 12 * n, 12 * n, 12 * t, n, (double) low[0], (double) low[1], (double) low[2], (double) high[0], (double) high[1],
            (double) high[2], 3 * t);
    } else {
        for (uint32_t i = 0; i < n; i++)
            fprintf(f, "v %.9g %.9g %.9g\n", ball->position[3 * i] / mm, ball->position[3 * i + 1] / mm, ball->position[3 * i + 2] / mm);
        for (uint32_t i = 0; i < t; i++)
            fprintf(f, "f %u %u %u\n", ball->index[3 * i] + 1, ball->index[3 * i + 1] + 1, ball->index[3 * i + 2] + 1);
    }
    fclose(f);
}

static void metres_centimetres_millimetres_and_formats_agree(void **state)
{
    static const struct {
        const char *name;
        double mm, said;
    } files[] = { { "mm.obj", 1.0, 1.0 },
                  { "cm.obj", 10.0, 10.0 },
                  { "m.obj", 1000.0, 1000.0 },
                  { "ball.gltf", 1000.0, 0.0 },
                  { "inch.obj", 25.4, 25.4 } };
    struct stage maker;
    struct pell_mesh *ball;
    struct shot first = { 0 };

    (void) state;
    assert_non_null(mkdtemp(folder));
    stage_start(&maker, 8, 8);
    ball = shapes_ball(maker.scene, 0, vec3(3, 2, 1), 30.0f, 24);
    for (uint32_t i = 0; i < ball->num_vertices; i++) {
        float *p = &ball->position[3 * i];
        if (p[2] > 15.0f)
            p[2] = 15.0f + 0.3f * (15.0f - p[2]);
    }
    for (size_t i = 0; i < PELL_COUNT(files); i++) {
        const struct pell_load_params params = { .mm_per_unit = files[i].said, .material = "skin1", .aspect = 1.5f };
        struct stage s;
        struct shot shot;
        write_ball(ball, files[i].name, files[i].mm, strstr(files[i].name, "gltf") != NULL);
        stage_start(&s, 96, 64);
        pell_scene_destroy(&s.scene);
        OK(pell_scene_load(s.ctx, in_folder(files[i].name), &params, &s.scene));
        OK(pell_renderer_set_scene(s.r, s.scene));
        s.set = true;
        s.settings.light_samples = 8;
        shot = stage_shot_of(&s, "screen-space", NULL);
        if (i > 0) {
            const struct difference d = shot_difference(&first, &shot);
            print_message("# %s: %.2g root mean square, %.2g at most, %lld of %lld over 1 %%\n", files[i].name, d.rms, d.largest,
                          (long long) d.over, (long long) d.count);
            REQUIRE(d.rms < 1e-3);
            REQUIRE(d.over <= d.count / 1000);
            shot_free(&shot);
        } else {
            first = shot;
        }
        stage_finish(&s);
        unlink(in_folder(files[i].name));
    }
    unlink(in_folder("ball.bin"));
    rmdir(folder);
    shot_free(&first);
    stage_finish(&maker);
}

/* --- Backgrounds ------------------------------------------------------------------------------------------------------------------- */

/* A ball next to a thin plate, lit from both sides. */
static void furnish(struct stage *s)
{
    size_t skin, milk;

    stage_medium(s, "skin1", &skin)->rho_s = 1.0f;
    stage_medium(s, "wholemilk", &milk)->rho_s = 1.0f;
    stage_ball(s, skin, 0, vec3(-14, 0, 0), 18.0f, 32);
    stage_box(s, milk, 1, vec3(8, -16, -2), vec3(34, 14, 2));
    stage_light(s, PELL_LIGHT_RECT, vec3(60, 60, 90), vec3(0, 0, 0), 6.0f);
    stage_light(s, PELL_LIGHT_POINT, vec3(20, 30, -80), vec3(0, 0, 0), 0.02f);
    stage_camera(s, vec3(20, 20, 240), vec3(0, 0, 0), 0.3f, 0.0f);
    s->settings.light_samples = 4;
}

static void what_is_behind_does_not_show_on_the_object(void **state)
{
    static const float colors[3][3] = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 0 } };
    static const char *const paper[] = { "as=paper", NULL };

    (void) state;
    for (int k = 0; k < 12; k++) {
        const int size_x = 90, size_y = 60;
        struct shot shot[4]; /* on red, on green, on black, transparent */
        struct stage s;
        int whole = 0, partly = 0;

        stage_start(&s, size_x, size_y);
        furnish(&s);
        s.settings.msaa = k & 1 ? 8 : 1;
        s.settings.exposure = k & 2 ? 0.0f : 0.7f;
        s.settings.tonemap = k & 2 ? PELL_TONEMAP_REINHARD : PELL_TONEMAP_LINEAR;
        s.settings.pixel_filter = PELL_PIXEL_FILTER_BOX; /* straight alpha without a background is not filtered */
        stage_method(&s, k < 4 ? "none" : "screen-space", k < 8 ? NULL : paper);
        for (int i = 0; i < 4; i++) {
            s.scene->background = i == 3 ? PELL_BACKGROUND_TRANSPARENT : PELL_BACKGROUND_COLOR;
            memcpy(s.scene->background_color, colors[i % 3], sizeof(s.scene->background_color));
            shot[i] = stage_shot(&s);
            shot_check(&shot[i]);
        }
        for (int y = 0; y < size_y; y++)
            for (int x = 0; x < size_x; x++) {
                const double a = shot_at(&shot[0], SHOT_A, x, y);
                for (size_t p = 0; p < 7; p++)
                    if (a == 1.0 || p == SHOT_A)
                        for (int i = 1; i < 4; i++)
                            REQUIRE(shot_at(&shot[i], p, x, y) == shot_at(&shot[0], p, x, y));
                whole += a == 1.0;
                partly += a > 0.0 && a < 1.0;
                if (a == 0.0) {
                    REQUIRE(shot_at(&shot[3], SHOT_G, x, y) == 0.0 && shot_at(&shot[3], SHOT_SHOWN + 1, x, y) == 0.0);
                    for (size_t c = 0; c < 3; c++) /* a background has its requested display colour */
                        REQUIRE_NEAR(shot_at(&shot[0], SHOT_SHOWN + c, x, y), (double) colors[0][c], 1e-5);
                    continue;
                }
                for (size_t c = 0; c < 3; c++) {
                    /* Premultiplied in linear values: the image over black equals the transparent one; over red, red is added by its
                     * transparency. */
                    const double linear = shot_at(&shot[3], c, x, y), behind = shot_at(&shot[0], c, 0, 0);
                    REQUIRE(linear == shot_at(&shot[2], c, x, y));
                    REQUIRE_NEAR(shot_at(&shot[0], c, x, y), linear + (1.0 - a) * behind, 1e-6 * (1.0 + fabs(behind)));
                    /* Straight alpha in display values. */
                    if (s.settings.tonemap == PELL_TONEMAP_LINEAR)
                        REQUIRE_NEAR(shot_at(&shot[3], SHOT_SHOWN + c, x, y), fmin(0.7f * linear / a, 1.0), 1e-5);
                }
            }
        REQUIRE(whole > 500 && (k & 1 ? partly > 50 : partly == 0));
        for (int i = 0; i < 4; i++)
            shot_free(&shot[i]);
        stage_finish(&s);
    }
}

/* --- Distance and resolution ------------------------------------------------------------------------------------------------------- */

/* A shadow's edge down the middle of a thick block. */
static void half_lit(struct stage *s, float distance, float fov)
{
    size_t m, screen;

    stage_gaussians(s, 0.4, &m);
    stage_opaque(s, 0.0f, &screen);
    stage_box(s, m, 0, vec3(-400, -400, -300), vec3(400, 400, 0));
    shapes_quad(s->scene, screen, vec3(2500, 0, 2000), vec3(500, 0, 0), vec3(0, 3000, 0))->object = 1;
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(100, 0, 100), vec3(0, 0, 0), 3.0f);
    stage_camera(s, vec3(0, 0, distance), vec3(0, 0, 0), fov, 0.0f);
}

/* Means of n x n pixels, in an image smaller by this factor. */
static struct shot shrunk(const struct shot *from, int n)
{
    struct shot to = *from;

    to.width /= n;
    to.height /= n;
    to.size = (size_t) to.width * (size_t) to.height;
    to.data = calloc(to.size * to.planes, sizeof(float));
    for (size_t p = 0; p < to.planes; p++)
        for (int y = 0; y < to.height * n; y++)
            for (int x = 0; x < to.width * n; x++)
                to.data[p * to.size + (size_t) (y / n) * (size_t) to.width + (size_t) (x / n)] +=
                    (float) (shot_at(from, p, x, y) / (n * n));
    return to;
}

static void twice_as_far_with_twice_the_focal_length(void **state)
{
    const double fov = 0.4, longer = 2.0 * atan(0.5 * tan(0.5 * fov));
    struct shot shot[2];
    struct difference d;

    (void) state;
    for (int i = 0; i < 2; i++) {
        struct stage s;
        stage_start(&s, 120, 90);
        half_lit(&s, i ? 400.0f : 200.0f, (float) (i ? longer : fov));
        shot[i] = stage_shot_of(&s, "screen-space", off);
        stage_finish(&s);
    }
    d = shot_difference(&shot[0], &shot[1]);
    print_message("# %.2g root mean square, %.2g at most\n", d.rms, d.largest);
    REQUIRE(d.rms < 2e-4 && d.largest < 4e-3);
    shot_free(&shot[0]);
    shot_free(&shot[1]);
}

static void twice_the_resolution(void **state)
{
    RELEASE_ONLY();
    static const char *const names[] = { "half-lit plane, half the resolution", "ball and plate, half the resolution",
                                         "half-lit plane, twice as far" };

    (void) state;
    for (int k = 0; k < 3; k++) {
        const bool far = k == 2;
        struct shot shot[2], small;
        struct difference d;
        for (int i = 0; i < 2; i++) { /* small on the screen, large on the screen */
            struct stage s;
            stage_start(&s, i || far ? 192 : 96, i || far ? 128 : 64);
            if (k == 1)
                furnish(&s);
            else
                half_lit(&s, far && !i ? 400.0f : 200.0f, 0.4f);
            for (size_t m = 0; m < s.scene->num_materials; m++)
                s.scene->materials[m].rho_s = 0.0f; /* a highlight is a pixel wide */
            s.settings.msaa = 16;
            s.settings.light_samples = 64;
            shot[i] = stage_shot_of(&s, "screen-space", NULL);
            stage_finish(&s);
        }
        small = shrunk(&shot[1], 2);
        if (far) { /* the middle half of the distant image */
            for (size_t p = 0; p < small.planes; p++)
                for (int y = 0; y < small.height; y++)
                    for (int x = 0; x < small.width; x++)
                        shot[1].data[p * small.size + (size_t) y * (size_t) small.width + (size_t) x] =
                            (float) shot_at(&shot[0], p, x + small.width / 2, y + small.height / 2);
            memcpy(shot[0].data, shot[1].data, small.planes * small.size * sizeof(float));
            shot[0].width = small.width;
            shot[0].height = small.height;
            shot[0].size = small.size;
        }
        d = shot_difference(&small, &shot[0]);
        print_message("# %s: %.2g root mean square, %.2g at most, %lld of %lld values over 1 %%\n", names[k], d.rms, d.largest,
                      (long long) d.over, (long long) d.count);
        REQUIRE(d.rms < (k == 1 ? 0.025 : 0.005)); /* edge pixels of 16 samples */
        REQUIRE(d.largest < (k == 1 ? 0.3 : 0.02));
        shot_free(&small);
        shot_free(&shot[0]);
        shot_free(&shot[1]);
    }
}

/* --- Edges ------------------------------------------------------------------------------------------------------------------------- */

/* For any number of samples the image stays in the same position. */
static void multisampling_does_not_move_the_picture(void **state)
{
    static const int samples[] = { 1, 2, 3, 4, 5, 8, 16, 64 };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(samples); k++) {
        struct stage s;
        struct shot shot;
        double sum = 0.0, mx = 0.0, my = 0.0, square = 0.0;
        int edges = 0;
        size_t m;

        stage_start(&s, 64, 64);
        stage_opaque(&s, 1.0f, &m);
        stage_ball(&s, m, 0, vec3(0, 0, 0), 20.0f, 64);
        stage_environment(&s, 1.0f);
        stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 44.0f);
        s.settings.msaa = samples[k];
        shot = stage_shot_of(&s, "none", NULL);
        for (int y = 0; y < 64; y++)
            for (int x = 0; x < 64; x++) {
                const double a = shot_at(&shot, SHOT_A, x, y);
                int inside = 0; /* of 16 x 16 points, in the disc */
                sum += a;
                mx += a * (x + 0.5 - 32.0);
                my += a * (y + 0.5 - 32.0);
                for (int i = 0; i < 256; i++)
                    inside += hypot(x - 32.0 + (i % 16 + 0.5) / 16.0, y - 32.0 + (i / 16 + 0.5) / 16.0) < 20.0 * 64.0 / 44.0;
                square += pow(a - inside / 256.0, 2.0);
                edges += inside > 0 && inside < 256;
            }
        print_message("# %d samples: centre at %.4f, %.4f px; area %.5f of the disc; coverage of an edge pixel to %.4f root mean square\n",
                      samples[k], mx / sum, my / sum, sum / (PELL_PI * 400.0 * (64.0 / 44.0) * (64.0 / 44.0)), sqrt(square / edges));
        REQUIRE_NEAR(mx / sum, 0.0, 0.03);
        REQUIRE_NEAR(my / sum, 0.0, 0.03);
        REQUIRE(sqrt(square / edges) < 0.35 * pow(samples[k], -0.75) + 0.01);
        shot_free(&shot);
        stage_finish(&s);
    }
}

/* In a uniform environment a solid has the same radiance everywhere, so each edge pixel must have exactly its coverage of it: neither
 * halo nor rim. */
static void edges_neither_lose_nor_borrow_light(void **state)
{
    static const int samples[] = { 1, 2, 4, 8 };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(samples); k++)
        for (int method = 0; method < 2; method++) {
            double worst = 0.0, total;
            struct stage s;
            struct shot shot;
            size_t m;

            stage_start(&s, 100, 100);
            total = pell_gaussians_total(&stage_gaussians(&s, 0.5, &m)->gaussians, 1);
            stage_ball(&s, m, 0, vec3(0, 0, 0), 20.0f, 96);
            stage_environment(&s, 1.0f);
            stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 44.0f);
            s.settings.msaa = samples[k];
            shot = stage_shot_of(&s, method ? "screen-space" : "none", off);
            for (int y = 0; y < 100; y++)
                for (int x = 0; x < 100; x++)
                    worst = fmax(worst, fabs(shot_at(&shot, SHOT_G, x, y) - total * shot_at(&shot, SHOT_A, x, y)) / total);
            print_message("# %d samples, %s: %.5f off at most\n", samples[k], method ? "screen-space" : "none", worst);
            REQUIRE(worst < 0.02);
            shot_free(&shot);
            stage_finish(&s);
        }
}

/* Sum of second differences across pixels at or adjacent to the silhouette, per pixel, relative to the mean radiance there. */
static double roughness(const struct shot *shot)
{
    double sum = 0.0, mean = 0.0;
    int count = 0;

    for (int y = 1; y + 1 < shot->height; y++)
        for (int x = 1; x + 1 < shot->width; x++) {
            double low = 1.0, high = 0.0, around = 0.0;
            for (int k = 0; k < 9; k++) {
                const double a = shot_at(shot, SHOT_A, x - 1 + k % 3, y - 1 + k / 3);
                low = fmin(low, a);
                high = fmax(high, a);
                around += shot_at(shot, SHOT_G, x - 1 + k % 3, y - 1 + k / 3) / 9.0;
            }
            if (low == high)
                continue;
            sum += fabs(around - shot_at(shot, SHOT_G, x, y));
            mean += shot_at(shot, SHOT_G, x, y);
            count++;
        }
    REQUIRE(count > 100);
    return sum / mean;
}

static void edges_are_no_rougher_with_scattering(void **state)
{
    static const int samples[] = { 1, 4, 8 };
    double alone = 0.0;

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(samples); k++) {
        struct stage s;
        struct shot none, moved;

        stage_start(&s, 120, 80);
        furnish(&s);
        s.settings.msaa = samples[k];
        s.settings.light_samples = 64;
        none = stage_shot_of(&s, "none", NULL);
        moved = stage_shot_of(&s, "screen-space", NULL);
        print_message("# %d samples: edge roughness %.4f, with scattering %.4f\n", samples[k], roughness(&none), roughness(&moved));
        REQUIRE(roughness(&moved) <= 1.02 * roughness(&none));
        REQUIRE(samples[k] == 1 || roughness(&moved) < 0.8 * alone);
        alone = samples[k] == 1 ? roughness(&moved) : alone;
        shot_free(&none);
        shot_free(&moved);
        stage_finish(&s);
    }
}

/* The appearance of a material does not depend on a touching one. */
static void touching_materials_do_not_bleed(void **state)
{
    static const double sigma[3][2] = { { 0.001, 1.0 }, { 50.0, 0.2 }, { 0.0, 20.0 } }; /* absorption, scattering of the neighbour */
    struct shot shot[3];
    double worst = 0.0;
    int count = 0;

    (void) state;
    for (int i = 0; i < 3; i++) {
        struct stage s;
        size_t a, b;
        stage_start(&s, 96, 64);
        stage_gaussians(&s, 0.5, &a);
        stage_medium(&s, "marble", &b);
        for (int c = 0; c < 3; c++) {
            s.scene->materials[b].medium.sigma_a[c] = sigma[i][0];
            s.scene->materials[b].medium.sigma_s_reduced[c] = sigma[i][1];
        }
        stage_box(&s, a, 0, vec3(-30, -30, -30), vec3(0, 30, 0));
        stage_box(&s, b, 1, vec3(0, -30, -30), vec3(30, 30, 0));
        stage_light(&s, PELL_LIGHT_POINT, vec3(-20, 20, 60), vec3(0, 0, 0), 0.02f);
        stage_camera(&s, vec3(0, 0, 200), vec3(0, 0, 0), 0.0f, 40.0f);
        shot[i] = stage_shot_of(&s, "screen-space", off);
        stage_finish(&s);
    }
    for (int i = 1; i < 3; i++)
        for (int y = 0; y < 64; y++)
            for (int x = 0; x < 48; x++)
                for (size_t c = 0; c < 3; c++) {
                    worst = fmax(worst, fabs(shot_at(&shot[i], c, x, y) / shot_at(&shot[0], c, x, y) - 1.0));
                    count++;
                }
    print_message("# %d values, largest difference %.2g\n", count, worst);
    REQUIRE(worst < 2e-3);
    for (int i = 0; i < 3; i++)
        shot_free(&shot[i]);
}

/* --- Tessellation ------------------------------------------------------------------------------------------------------------------ */

static struct shot tessellated(int rings, bool environment)
{
    struct stage s;
    struct shot shot;
    size_t m;

    stage_start(&s, 128, 128);
    stage_gaussians(&s, 0.3, &m);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 20.0f, rings);
    if (environment)
        stage_environment(&s, 1.0f);
    else
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(80, 60, 60), vec3(0, 0, 0), 3.0f);
    stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 48.0f);
    s.settings.ambient_samples = 64;
    shot = stage_shot_of(&s, "screen-space", off);
    stage_finish(&s);
    return shot;
}

/* Largest second difference over the whole disc except its last 3 pixels, relative to the brightest pixel. */
static double facet(const struct shot *shot)
{
    double worst = 0.0, brightest = 0.0;

    for (int y = 2; y + 2 < shot->height; y++)
        for (int x = 2; x + 2 < shot->width; x++) {
            const double middle = shot_at(shot, SHOT_G, x, y);
            brightest = fmax(brightest, middle);
            if (hypot(x - 63.5, y - 63.5) > 20.0 * 128.0 / 48.0 - 4.0)
                continue;
            worst = fmax(worst, fabs(shot_at(shot, SHOT_G, x - 1, y) - 2.0 * middle + shot_at(shot, SHOT_G, x + 1, y)));
            worst = fmax(worst, fabs(shot_at(shot, SHOT_G, x, y - 1) - 2.0 * middle + shot_at(shot, SHOT_G, x, y + 1)));
        }
    return worst / brightest;
}

static void tessellations_of_a_sphere_converge(void **state)
{
    static const int rings[] = { 16, 32, 128 };

    (void) state;
    for (int environment = 0; environment < 2; environment++) {
        struct shot shot[3];
        double rms[2], fine;
        for (int i = 0; i < 3; i++)
            shot[i] = tessellated(rings[i], environment);
        fine = facet(&shot[2]);
        for (int i = 0; i < 2; i++) { /* over pixels that both cover fully, and whose neighbours they cover, too */
            double sum = 0.0;
            int count = 0;
            for (int y = 2; y < 126; y++)
                for (int x = 2; x < 126; x++) {
                    if (hypot(x - 63.5, y - 63.5) > 20.0 * 128.0 / 48.0 * 0.97)
                        continue;
                    sum += pow(shot_at(&shot[i], SHOT_G, x, y) - shot_at(&shot[2], SHOT_G, x, y), 2.0);
                    count++;
                }
            rms[i] = sqrt(sum / count);
            print_message("# %s, %d rings: %.4f from %d rings; largest second difference %.4f, there %.4f\n",
                          environment ? "even sky" : "one light", rings[i], rms[i], rings[2], facet(&shot[i]), fine);
            REQUIRE(facet(&shot[i]) < (i ? 1.5 : 2.5) * fine + 0.01);
        }
        REQUIRE(rms[1] < 0.6 * rms[0] + 1e-4);
        REQUIRE(rms[1] < 0.01);
        for (int i = 0; i < 3; i++) {
            /* No dark silhouette: in a uniform environment the outermost fully covered pixel is as bright as the middle. */
            double darkest = INFINITY;
            for (int y = 0; y < 128 && environment; y++)
                for (int x = 0; x < 128; x++)
                    if (shot_at(&shot[i], SHOT_A, x, y) == 1.0)
                        darkest = fmin(darkest, shot_at(&shot[i], SHOT_G, x, y) / shot_at(&shot[2], SHOT_G, 64, 64));
            if (environment)
                print_message("# even sky, %d rings: the darkest pixel is %.4f of the middle\n", rings[i], darkest);
            REQUIRE(!environment || darkest > 0.97);
            shot_free(&shot[i]);
        }
    }
}

/* --- Limits ------------------------------------------------------------------------------------------------------------------------ */

static void no_radius_is_no_scattering(void **state)
{
    (void) state;
    for (int k = 0; k < 3; k++) {
        static const char *const names[] = { "a mean free path of 0.1 um", "strength 0", "strength 0 by a map" };
        static const uint8_t black[4] = { 0, 0, 0, 0 };
        struct stage s;
        struct shot none, moved;
        struct difference d;
        struct pell_material *material;
        size_t m;

        stage_start(&s, 96, 64);
        material = stage_medium(&s, "marble", &m);
        if (k == 0)
            for (int c = 0; c < 3; c++) {
                material->medium.sigma_s_reduced[c] = 1e4;
                material->medium.sigma_a[c] = 10.0 * (c + 1);
            }
        if (k == 1)
            material->strength = 0.0f;
        if (k == 2) {
            material->strength_map = (struct pell_texture_map) { .matrix = { 1, 0, 0, 0, 1, 0 } };
            material->strength_map.texture = shapes_texture(s.scene, 2, 2, 1, false, black);
        }
        shapes_quad(s.scene, m, vec3(0, 0, 0), vec3(40, 0, 0), vec3(0, 30, 0));
        stage_light(&s, PELL_LIGHT_POINT, vec3(-20, 20, 8), vec3(0, 0, 0), 0.002f);
        stage_camera(&s, vec3(0, 20, 120), vec3(0, 0, 0), 0.3f, 0.0f);
        none = stage_shot_of(&s, "none", NULL);
        moved = stage_shot_of(&s, "screen-space", off);
        d = shot_difference(&none, &moved);
        print_message("# %s: %.2g at most\n", names[k], d.largest);
        REQUIRE(d.largest < 1e-4);
        if (k > 0) {
            s.scene->materials[m].strength = 1.0f;
            s.scene->materials[m].strength_map.texture = NULL;
            shot_free(&moved);
            moved = stage_shot(&s);
            REQUIRE(shot_difference(&none, &moved).largest > 0.01);
        }
        shot_free(&none);
        shot_free(&moved);
        stage_finish(&s);
    }
}

/* A wider profile spreads more in each channel; permuting coefficients permutes channels. */
static void channels_are_alike(void **state)
{
    struct shot shot[2];

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct stage s;
        struct pell_material *material;
        size_t m;
        stage_start(&s, 80, 60);
        material = stage_medium(&s, "skin1", &m);
        material->rho_s = 1.0f;
        for (int c = 0; c < 3 && k; c++) {
            const struct pell_material_entry *entry = pell_material_find("skin1");
            material->medium.sigma_a[c] = entry->medium.sigma_a[2 - c];
            material->medium.sigma_s_reduced[c] = entry->medium.sigma_s_reduced[2 - c];
        }
        stage_ball(&s, m, 0, vec3(0, 0, 0), 20.0f, 32);
        stage_light(&s, PELL_LIGHT_POINT, vec3(-60, 60, 20), vec3(0, 0, 0), 0.02f);
        stage_camera(&s, vec3(0, 0, 200), vec3(0, 0, 0), 0.25f, 0.0f);
        shot[k] = stage_shot_of(&s, "screen-space", NULL);
        stage_finish(&s);
    }
    for (int y = 0; y < 60; y++)
        for (int x = 0; x < 80; x++)
            for (size_t c = 0; c < 3; c++)
                REQUIRE_NEAR(shot_at(&shot[0], c, x, y), shot_at(&shot[1], 2 - c, x, y), 1e-3 * shot_at(&shot[0], c, x, y) + 1e-5);
    shot_free(&shot[0]);
    shot_free(&shot[1]);
}

/* --- Sides --------------------------------------------------------------------------------------------------------------------- */

/* Light of a quad that faces +z, alone in the scene, seen from the front or the back; `masked`: visibility by rays. */
static double seen(bool front, bool opaque, bool double_sided, bool masked)
{
    struct stage s;
    struct shot shot;
    struct pell_mesh *quad;
    size_t m, other;
    double sum = 0.0;

    stage_start(&s, 16, 16);
    if (opaque)
        stage_opaque(&s, 0.5f, &m);
    else
        stage_gaussians(&s, 0.5, &m);
    s.scene->materials[m].double_sided = double_sided;
    quad = shapes_quad(s.scene, m, vec3(0, 0, 0), vec3(10, 0, 0), vec3(0, 10, 0));
    if (masked) { /* an alpha map makes the whole scene use rays */
        stage_opaque(&s, 0.5f, &other);
        s.scene->materials[other].alpha_mask = true;
        quad = shapes_quad(s.scene, other, vec3(0, 500, 0), vec3(1, 0, 0), vec3(0, 1, 0));
        quad->color = pell_calloc(s.ctx, 4 * (size_t) quad->num_vertices, sizeof(float));
        assert_non_null(quad->color);
    }
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 1.0f);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -100), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, front ? 50.0f : -50.0f), vec3(0, 0, 0), 0.0f, 10.0f);
    shot = stage_shot_of(&s, "none", NULL);
    shot_check(&shot);
    for (int y = 0; y < 16; y++)
        for (int x = 0; x < 16; x++)
            sum += shot_at(&shot, 1, x, y);
    shot_free(&shot);
    stage_finish(&s);
    return sum;
}

static void backs_of_single_sided_opaque_surfaces_are_not_seen(void **state)
{
    (void) state;
    for (int k = 0; k < 16; k++) {
        const bool front = k & 1, opaque = k & 2, both = k & 4, masked = k & 8;
        const double light = seen(front, opaque, both, masked);
        print_message("# %s of %s %s, by %s: %.3f\n", front ? "front" : "back", both ? "two-sided" : "single-sided",
                      opaque ? "opaque" : "translucent", masked ? "rays" : "tiles", light);
        REQUIRE((light > 0.0) == (front || !opaque || both));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(backs_of_single_sided_opaque_surfaces_are_not_seen),
        cmocka_unit_test(metres_centimetres_millimetres_and_formats_agree),
        cmocka_unit_test(what_is_behind_does_not_show_on_the_object),
        cmocka_unit_test(twice_as_far_with_twice_the_focal_length),
        cmocka_unit_test(twice_the_resolution),
        cmocka_unit_test(multisampling_does_not_move_the_picture),
        cmocka_unit_test(edges_neither_lose_nor_borrow_light),
        cmocka_unit_test(edges_are_no_rougher_with_scattering),
        cmocka_unit_test(touching_materials_do_not_bleed),
        cmocka_unit_test(tessellations_of_a_sphere_converge),
        cmocka_unit_test(no_radius_is_no_scattering),
        cmocka_unit_test(channels_are_alike),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
