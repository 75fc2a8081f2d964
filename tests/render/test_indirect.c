/* SPDX-License-Identifier: MIT
 * test_indirect.c - interreflection (light that leaves a surface and enters another): closed forms of radiosity, properties that must
 * always hold, and dependence on the angle. */
#include "stage.h"

#include <stdatomic.h>

#define SIZE (SLOW ? 12 : 24)
#define SAMPLES (SLOW ? 2048 : 16384)

/* Light that enters at a pixel, in channel `c`, tinted by the surface's base colour. */
static double light_at(const struct shot *shot, int x, int y, size_t c)
{
    return shot_at(shot, SHOT_IRRADIANCE + c, x, y);
}

static struct shot shot_by(struct stage *s, int bounces, int samples)
{
    s->settings.layers = true;
    s->settings.bounces = bounces;
    s->settings.indirect_samples = samples;
    return stage_shot_of(s, "none", NULL);
}

static struct shot shot_with(struct stage *s, int bounces)
{
    return shot_by(s, bounces, SAMPLES);
}

/* Mean over all covered pixels. */
static double mean_light(const struct shot *shot, size_t c)
{
    double sum = 0.0, covered = 0.0;

    for (int y = 0; y < shot->height; y++)
        for (int x = 0; x < shot->width; x++) {
            sum += light_at(shot, x, y, c);
            covered += shot_at(shot, SHOT_A, x, y);
        }
    return covered > 0.0 ? sum / covered : 0.0;
}

static void turn_inside_out(struct pell_mesh *mesh)
{
    for (uint32_t i = 0; i < mesh->num_triangles; i++) {
        uint32_t *index = mesh->index + 3 * i, first = index[0];
        index[0] = index[1];
        index[1] = first;
    }
    for (uint32_t i = 0; i < 3 * mesh->num_vertices; i++)
        mesh->normal[i] *= -1.0f;
}

/* A light at the centre of a closed sphere of reflectance rho gives it a uniform irradiance E0; each bounce multiplies it by rho: after
 * n of them it is E0 (1 - rho^(n+1))/(1 - rho). Seen from inside, for triangles that face outward and inward. */
static void an_integrating_sphere_sums_the_geometric_series(void **state)
{
    static const float rho[3] = { 0.2f, 0.5f, 0.9f };
    static const int bounces[] = { 1, 2, 8, 64 };
    (void) state;

    for (int inward = 0; inward < 2; inward++) {
        struct stage s;
        struct shot direct, all;
        struct pell_material *m;
        size_t material;

        stage_start(&s, SIZE, SIZE);
        m = stage_opaque(&s, 1.0f, &material);
        memcpy(m->base_color, rho, sizeof(rho));
        stage_ball(&s, material, 0, vec3(0, 0, 0), 50.0f, 24);
        if (inward)
            turn_inside_out(&s.scene->meshes[0]);
        stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, 0), vec3(0, 0, 1), 1e-3f);
        stage_camera(&s, vec3(0, 0, 20), vec3(0, 0, 0), 1.5f, 0.0f);
        direct = shot_with(&s, 0);
        for (size_t k = 0; k < PELL_COUNT(bounces); k++) {
            all = shot_with(&s, bounces[k]);
            for (size_t c = 0; c < 3; c++) {
                const double r = (double) rho[c], want = (1.0 - pow(r, bounces[k] + 1)) / (1.0 - r);
                REQUIRE_REL(mean_light(&all, c) / mean_light(&direct, c), want, bounces[k] > 8 ? 0.015 : 0.01);
                REQUIRE_REL(light_at(&all, SIZE / 2, SIZE / 2, c) / light_at(&direct, SIZE / 2, SIZE / 2, c), want, 0.03);
            }
            shot_free(&all);
        }
        shot_free(&direct);
        stage_finish(&s);
    }
}

/* The wall of a hollow in a medium that absorbs almost all light, lit from its centre: reflected light hits the wall again, in the
 * amount of the Fresnel reflectance, for smooth and rough boundaries. */
static void light_that_a_wall_reflects_enters_elsewhere(void **state)
{
    static const double eta = 1.5;
    (void) state;

    for (int rough = 0; rough < 2; rough++) {
        const double f0 = (eta - 1.0) * (eta - 1.0) / ((eta + 1.0) * (eta + 1.0));
        struct stage s;
        struct shot direct, all;
        struct pell_material *m;
        size_t material;

        stage_start(&s, SIZE, SIZE);
        s.settings.boundary = rough ? PELL_BOUNDARY_MODEL_ROUGH : PELL_BOUNDARY_MODEL_SMOOTH;
        m = stage_medium(&s, "marble", &material);
        m->rho_s = 1.0f;
        m->roughness = 0.1f;
        m->medium.eta = eta;
        for (int c = 0; c < 3; c++) {
            m->medium.sigma_a[c] = 10.0;
            m->medium.sigma_s_reduced[c] = 1e-3;
        }
        stage_ball(&s, material, 0, vec3(0, 0, 0), 50.0f, 48);
        s.scene->meshes[0].num_triangles -= 300; /* surfaces that are nearly closed are oriented outward */
        turn_inside_out(&s.scene->meshes[0]);
        stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, 0), vec3(0, 0, 1), 1e-3f);
        stage_camera(&s, vec3(0, 0, 20), vec3(0, 0, 0), 1.5f, 0.0f);
        direct = shot_with(&s, 0);
        all = shot_with(&s, 1);
        print_message("# %g %g\n", mean_light(&direct, 1), mean_light(&all, 1));
        REQUIRE_NEAR(mean_light(&all, 1) / mean_light(&direct, 1) - 1.0, f0, 0.05 * f0);
        shot_free(&all);
        shot_free(&direct);
        stage_finish(&s);
    }
}

/* Form factor from a small square to a parallel square of side 2 a at the distance `h` over its middle (Howell, "A Catalog of Radiation
 * Heat Transfer Configuration Factors", B-3, four times). */
static double parallel_factor(double a, double h)
{
    const double x = a / h, r = sqrt(1.0 + x * x);
    return 4.0 / (2.0 * PELL_PI) * 2.0 * x / r * atan(x / r);
}

/* A tile of 2 mm at height z that faces up or down, and a camera close in front of it. */
static void add_tile(struct stage *s, size_t material, float z, bool up)
{
    const float side = up ? 1.0f : -1.0f;

    shapes_quad(s->scene, material, vec3(0, 0, z), vec3(1, 0, 0), vec3(0, side, 0))->object = 1;
    stage_camera(s, vec3(0, 0, z + 5.0f * side), vec3(0, 0, z), 0.1f, 0.0f);
}

/* Light from below hits the lower face of a plate, and is reflected to a small tile that faces up; a tile above, which faces the plate's
 * dark side, receives none. */
static void a_plate_lights_what_faces_it_and_lets_nothing_through(void **state)
{
    static const float heights[] = { 12.0f, 30.0f, 80.0f };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(heights); k++)
        for (int above = 0; above < 2; above++) {
            struct stage s;
            struct shot shot;
            size_t material;

            stage_start(&s, SIZE, SIZE);
            stage_opaque(&s, 0.8f, &material);
            shapes_quad(s.scene, material, vec3(0, 0, 0), vec3(50, 0, 0), vec3(0, -50, 0))->object = 0; /* faces down */
            add_tile(&s, material, above ? heights[k] : -heights[k], !above);
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -500), vec3(0, 0, 0), 2.0f);
            shot = shot_with(&s, 1);
            REQUIRE_NEAR(light_at(&shot, SIZE / 2, SIZE / 2, 1) / (0.8 * 0.8 * 2.0),
                         above ? 0.0 : parallel_factor(50.0, (double) heights[k]), above ? 1e-6 : 0.03);
            shot_free(&shot);
            stage_finish(&s);
        }
}

/* Light parallel to a floor hits only a long wall of height H. The wall fills (1 - d/sqrt(d^2 + H^2))/2 of the cosine-weighted
 * hemisphere of a floor point at the distance d from its foot; the wall is red. */
static void check_red_wall(float d, int samples)
{
    const double height = 40.0, form_factor = 0.5 * (1.0 - (double) d / sqrt((double) d * (double) d + height * height));
    struct stage s;
    struct shot shot;
    size_t red, white;

    stage_start(&s, SIZE, SIZE);
    stage_opaque(&s, 0.1f, &red)->base_color[0] = 0.8f;
    stage_opaque(&s, 0.5f, &white);
    shapes_quad(s.scene, red, vec3(0, 0, 20), vec3(0, 2000, 0), vec3(0, 0, 20))->object = 0; /* faces +x */
    shapes_quad(s.scene, white, vec3(60, 0, 0), vec3(60, 0, 0), vec3(0, 60, 0))->object = 1; /* faces +z */
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(900, 0, 0), vec3(0, 0, 0), 3.0f);
    stage_camera(&s, vec3(d, 0, 30), vec3(d, 0, 0), 0.0f, 1.0f);
    shot = shot_by(&s, 1, samples);
    print_message("# at %g mm: %.3f of the closed form\n", (double) d,
                  light_at(&shot, SIZE / 2, SIZE / 2, 0) / (0.5 * 0.8 * 3.0 * form_factor));
    REQUIRE_REL(light_at(&shot, SIZE / 2, SIZE / 2, 0), 0.5 * 0.8 * 3.0 * form_factor, SLOW ? 0.15 : 0.06);
    REQUIRE_REL(light_at(&shot, SIZE / 2, SIZE / 2, 1), 0.5 * 0.1 * 3.0 * form_factor, SLOW ? 0.15 : 0.06);
    shot_free(&shot);
    stage_finish(&s);
}

static void a_red_wall_reddens_the_floor_before_it(void **state)
{
    static const float distances[] = { 10.0f, 25.0f, 60.0f };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(distances); k++)
        check_red_wall(distances[k], SAMPLES);
}

/* Many samples need many cells: no triangle is left whole, with light that only its corners know. */
static void many_samples_light_large_triangles_evenly(void **state)
{
    (void) state;
    RELEASE_ONLY();

    check_red_wall(25.0f, 400000);
}

/* A pit with interreflection between its walls, in a ground. */
static void start_pit(struct stage *s, int threads, struct pell_alloc_fault *fault)
{
    size_t stone, ground;

    stage_start_on(s, PELL_ENGINE_CPU, 24, 24, threads, fault); /* its inside is visible */
    stage_medium(s, "marble", &stone);
    stage_opaque(s, 0.5f, &ground);
    stage_box(s, stone, 0, vec3(-20, -20, 0), vec3(-5, 20, 20));
    stage_box(s, stone, 1, vec3(5, -20, 0), vec3(20, 20, 20));
    shapes_quad(s->scene, ground, vec3(0, 0, -1), vec3(200, 0, 0), vec3(0, 200, 0))->object = 2;
    stage_light(s, PELL_LIGHT_POINT, vec3(0, 0, 60), vec3(0, 0, 0), 2e-3f);
    stage_light(s, PELL_LIGHT_RECT, vec3(80, 0, 80), vec3(0, 0, 0), 1.0f);
    stage_environment(s, 0.1f);
    stage_camera(s, vec3(0, -20, 100), vec3(0, 0, 0), 0.8f, 0.0f);
}

static void bits_are_those_of_any_number_of_threads_and_of_a_new_renderer(void **state)
{
    static const int threads[] = { 1, 2, 7 };
    struct shot first = { .data = NULL }, one;
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(threads); k++) {
        struct stage s;
        start_pit(&s, threads[k], NULL);
        if (k == 1) { /* results for other settings are computed again */
            one = shot_with(&s, 1);
            shot_free(&one);
            s.settings.seed = 7;
            one = shot_with(&s, 8);
            shot_free(&one);
            s.settings.seed = 0;
        }
        one = shot_with(&s, 8);
        shot_check(&one);
        if (first.data) {
            assert_true(shot_equal(&first, &one));
            shot_free(&one);
        } else {
            first = one;
        }
        stage_finish(&s);
    }
    shot_free(&first);
}

/* Interpolation of pixels from nearby knots, of light between and inside solids and of their shape, is vectorised. */
static void bits_are_those_of_any_level(void **state)
{
    static const char *const levels[] = { "base", "v2", "v3", "v4" }, *const knobs[] = { "gaussians=2", NULL };
    struct shot first = { .data = NULL }, one;
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(levels); k++) {
        struct stage s;
        setenv("PELL_SIMD", levels[k], 1);
        start_pit(&s, 2, NULL);
        stage_ball(&s, 0, 3, vec3(0, 10, 8), 4.5f, 24);
        s.settings.width = s.settings.height = 50;
        s.settings.curvature = s.settings.opposed = s.settings.angles = true;
        stage_method(&s, "screen-space", knobs);
        one = shot_with(&s, 2);
        shot_check(&one);
        if (k > 0) {
            assert_true(shot_equal(&first, &one));
            shot_free(&one);
        } else {
            first = one;
        }
        stage_finish(&s);
    }
    unsetenv("PELL_SIMD");
    shot_free(&first);
}

static void more_bounces_are_more_light_and_none_is_none(void **state)
{
    static const int bounces[] = { 0, 1, 2, 8 };
    double before = 0.0;
    struct stage s;
    (void) state;

    start_pit(&s, 2, NULL);
    for (size_t k = 0; k < PELL_COUNT(bounces); k++) {
        struct shot shot = shot_with(&s, bounces[k]);
        const double light = mean_light(&shot, 1);
        print_message("# %d bounces: %g\n", bounces[k], light);
        REQUIRE(light > before * 1.002);
        before = light;
        shot_free(&shot);
    }
    stage_finish(&s);
}

/* No part of a convex solid sees another part. */
static void a_convex_solid_keeps_its_bits(void **state)
{
    struct stage s;
    struct shot none, many;
    size_t material;
    (void) state;

    stage_start(&s, SIZE, SIZE);
    stage_medium(&s, "wholemilk", &material);
    stage_ball(&s, material, 0, vec3(0, 0, 0), 20.0f, 12);
    stage_light(&s, PELL_LIGHT_POINT, vec3(30, 60, 60), vec3(0, 0, 0), 2e-3f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.5f, 0.0f);
    none = shot_with(&s, 0);
    many = shot_with(&s, 8);
    assert_true(shot_equal(&none, &many));
    shot_free(&none);
    shot_free(&many);
    stage_finish(&s);
}

static double shot_sum(const struct shot *shot, size_t plane)
{
    double sum = 0.0;

    for (int i = 0; i < shot->width * shot->height; i++)
        sum += shot_at(shot, plane, i % shot->width, i / shot->width);
    return sum;
}

/* A part of an object that lies inside another part is not a surface: light passes through the solid as if the part did not exist. */
static void what_lies_inside_a_solid_is_no_surface(void **state)
{
    static const char *const methods[] = { "screen-space", "hierarchical" };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(methods); i++) {
        struct shot plain = { 0 };
        for (int inner = 0; inner < 2; inner++) {
            struct shot shot;
            struct stage s;
            size_t material;

            stage_start(&s, SIZE, SIZE);
            stage_medium(&s, "marble", &material);
            stage_ball(&s, material, 0, vec3(0, 0, 0), 20.0f, 24);
            if (inner)
                stage_ball(&s, material, 0, vec3(2, 4, 1), 14.0f, 24);
            stage_light(&s, PELL_LIGHT_POINT, vec3(30, 60, -60), vec3(0, 0, 0), 2e-3f);
            stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.5f, 0.0f);
            s.settings.opposed = s.settings.curvature = s.settings.angles = true;
            s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
            shot = stage_shot_of(&s, methods[i], NULL);
            if (inner) {
                const struct difference d = shot_difference(&plain, &shot);
                print_message("# %s: differs by %.4f\n", methods[i], d.rms);
                REQUIRE(d.rms < 0.2); /* samples are at other positions; 0.9 where the inner surface receives light */
                shot_free(&plain);
                shot_free(&shot);
            } else {
                plain = shot;
            }
            stage_finish(&s);
        }
    }
}

/* Far from the ball the ground's samples are sparse, and their reflections fall on the ball's samples, which are dense: this must cause
 * no spots, for any number of samples. */
static void a_mirroring_ground_leaves_no_spots(void **state)
{
    static const int samples[] = { 4096, 16384, 65536 };
    struct shot shot[PELL_COUNT(samples)];
    double worst = 0.0, middle;
    (void) state;
    RELEASE_ONLY();

    for (size_t i = 0; i < PELL_COUNT(samples); i++) {
        struct stage s;
        size_t ball, ground, card;
        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, "skin1", &ball);
        stage_medium(&s, "marble", &ground);
        s.scene->materials[ground].rho_s = 1.0f;
        stage_ball(&s, ball, 0, vec3(0, 0, 0), 10.0f, 24);
        shapes_quad(s.scene, ground, vec3(0, -10, 0), vec3(0, 0, 300), vec3(300, 0, 0))->object = 1;
        stage_light(&s, PELL_LIGHT_POINT, vec3(0, 10, 280), vec3(0, 0, 0), 1.0f);
        stage_opaque(&s, 0.0f, &card); /* between the light and the ball */
        shapes_quad(s.scene, card, vec3(0, 6, 140), vec3(6, 0, 0), vec3(0, 6, 0))->object = 2;
        stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 24.0f);
        s.settings.bounces = 2;
        s.settings.indirect_samples = samples[i];
        shot[i] = stage_shot_of(&s, "none", NULL);
        stage_finish(&s);
    }
    middle = shot_at(&shot[1], 0, SIZE / 2, SIZE / 2);
    for (size_t k = 0; k < PELL_COUNT(samples); k++)
        for (int i = 0; i < SIZE * SIZE; i++) {
            const int x = i % SIZE, y = i / SIZE;
            if (hypot(x + 0.5 - SIZE / 2, y + 0.5 - SIZE / 2) < 0.3 * SIZE)
                worst = fmax(worst, fabs(shot_at(&shot[k], 0, x, y) - shot_at(&shot[1], 0, x, y)) / middle);
        }
    print_message("# 4096 to 65536 samples: off by %.3f of the light in the middle\n", worst);
    REQUIRE(middle > 0.0 && worst < 1.5); /* 8.5 where photons are not split */
    for (size_t k = 0; k < PELL_COUNT(samples); k++)
        shot_free(&shot[k]);
}

/* Triangles in the order of their sectors, from pole to pole. */
static void order_by_sectors(struct pell_mesh *m, int rings)
{
    const int sectors = 2 * rings, each = 2 * (rings - 1);
    uint32_t *sorted = malloc(3 * (size_t) m->num_triangles * sizeof(*sorted)), *out = sorted;

    assert_non_null(sorted);
    for (int i = 0; i < sectors; i++)
        for (int k = 0; k < each; k++) { /* the ring at a pole has one triangle per sector, others two */
            const int row = (k + 1) / 2, in_ring = row == 0 || row == rings - 1 ? 1 : 2;
            const int before = row == 0 ? 0 : sectors + 2 * sectors * (row - 1),
                      at = before + in_ring * i + (in_ring == 2 ? (k + 1) % 2 : 0);
            memcpy(out, m->index + 3 * at, 3 * sizeof(*out));
            out += 3;
        }
    memcpy(m->index, sorted, 3 * (size_t) m->num_triangles * sizeof(*sorted));
    free(sorted);
}

/* A ball whose sectors have two samples each: their heights must differ. */
static void samples_keep_no_step_with_the_mesh(void **state)
{
    enum { RINGS = 256, SAMPLES_EACH = 2 };
    double light[2];

    (void) state;
    RELEASE_ONLY();
    for (int fine = 0; fine < 2; fine++) {
        struct shot shot;
        struct stage s;
        size_t material;

        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, "marble", &material);
        order_by_sectors(shapes_ball(s.scene, material, vec3(0, 0, 0), 15.0f, RINGS), RINGS);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 60, 60), vec3(0, 0, 0), 10.0f);
        stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.35f, 0.0f);
        s.settings.opposed = s.settings.curvature = true;
        s.settings.indirect_samples = fine ? 16384 : 2 * RINGS * SAMPLES_EACH;
        shot = stage_shot_of(&s, "screen-space", NULL);
        light[fine] = shot_at(&shot, 1, SIZE / 2, SIZE / 2);
        shot_free(&shot);
        stage_finish(&s);
    }
    print_message("# with two samples a sector: %.3f of the light with 16384\n", light[0] / light[1]);
    REQUIRE_NEAR(light[0] / light[1], 1.0, 0.06);
}

/* A cylinder about the y axis, of radius 20 mm, from y = 0 to 100 mm, whose side is divided into `rows`. A cap has a vertex in its
 * middle. */
static void add_cylinder(struct stage *s, size_t material, int sides, int rows)
{
    const uint32_t n = (uint32_t) sides, ring = n * (uint32_t) (rows + 1), caps = ring + 2 * (n + 1);
    struct pell_mesh *m = shapes_mesh(s->scene, material, caps, 2 * n * (uint32_t) rows + 2 * n);
    uint32_t *index = m->index;

    for (uint32_t i = 0; i < caps; i++) {
        const bool cap = i >= ring, centre = cap && (i - ring) % (n + 1) == n, top = cap ? i - ring > n : false;
        const float angle = 2.0f * PELL_PI_F * (float) (cap ? (i - ring) % (n + 1) : i % n) / (float) n;
        const float height = cap ? (top ? 100.0f : 0.0f) : 100.0f * (float) (i / n) / (float) rows;
        const struct pell_vec3 out = vec3(cosf(angle), 0.0f, -sinf(angle));
        vec3_store(vec3_mad(vec3(0.0f, height, 0.0f), centre ? 0.0f : 20.0f, out), m->position + 3 * i);
        vec3_store(cap ? vec3(0.0f, top ? 1.0f : -1.0f, 0.0f) : out, m->normal + 3 * i);
    }
    for (uint32_t i = 0; i < n; i++) {
        const uint32_t next = (i + 1) % n, below = ring, above = ring + n + 1;
        for (uint32_t row = 0; row < (uint32_t) rows; row++, index += 6) {
            const uint32_t a = row * n + i, b = row * n + next;
            const uint32_t two[6] = { a, b, b + n, a, b + n, a + n };
            memcpy(index, two, sizeof(two));
        }
        const uint32_t cap_triangles[6] = { below + n, below + next, below + i, above + n, above + i, above + next };
        memcpy(index, cap_triangles, sizeof(cap_triangles));
        index += 6;
    }
    shapes_bound(s->scene, m);
    m->object = 0;
}

/* Modelling programs make cylinders of long thin triangles. They have the light of many short ones. */
static void long_thin_triangles_have_the_light_of_short_ones(void **state)
{
    struct shot shot[2];
    struct difference d;

    (void) state;
    RELEASE_ONLY();
    for (int fine = 0; fine < 2; fine++) {
        struct stage s;
        size_t material, ground;
        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, "soap", &material);
        stage_opaque(&s, 0.8f, &ground);
        add_cylinder(&s, material, 360, fine ? 60 : 1);
        shapes_quad(s.scene, ground, vec3(0, 0, 0), vec3(150, 0, 0), vec3(0, 0, -150))->object = 1;
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(-300, 300, 200), vec3(0, 0, 0), 3.0f);
        stage_camera(&s, vec3(0, 50, 500), vec3(0, 50, 0), 0.0f, 90.0f);
        s.settings.opposed = s.settings.curvature = true;
        s.settings.indirect_samples = 16384;
        shot[fine] = stage_shot_of(&s, "screen-space", NULL);
        stage_finish(&s);
    }
    d = shot_difference(&shot[1], &shot[0]);
    print_message("# root mean square error %.4f\n", d.rms);
    REQUIRE(d.rms < 0.03);
    shot_free(&shot[0]);
    shot_free(&shot[1]);
}

/* The light of a row of bricks along x, 60 mm long, 20 mm deep, that reach from y = -10 mm or, if `uneven`, from below -30 mm, to
 * 10 mm. */
static struct shot shot_of_bricks(int bricks, bool uneven, const char *method)
{
    struct shot shot;
    struct stage s;
    size_t material;

    stage_start(&s, SIZE, SIZE);
    stage_medium(&s, "marble", &material);
    for (int i = 0; i < bricks; i++)
        stage_box(&s, material, 0, vec3(-30.0f + 60.0f * (float) i / (float) bricks, uneven ? -30.0f - 4.0f * (float) i : -10.0f, -10),
                  vec3(-30.0f + 60.0f * (float) (i + 1) / (float) bricks, 10, 10));
    stage_light(&s, PELL_LIGHT_POINT, vec3(-60, 60, 60), vec3(0, 0, 0), 2e-3f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.5f, 0.0f);
    s.settings.opposed = s.settings.curvature = s.settings.angles = true;
    s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
    shot = stage_shot_of(&s, method, NULL);
    stage_finish(&s);
    return shot;
}

/* Adjacent bricks are one solid: where they touch there is no surface. Edges of bricks that end at different heights are not welded. */
static void bricks_side_by_side_are_one_solid(void **state)
{
    static const char *const methods[] = { "screen-space", "hierarchical" };
    (void) state;

    for (size_t m = 0; m < (SLOW ? 1 : PELL_COUNT(methods)); m++) {
        for (int bricks = 3; bricks <= 5; bricks += 2) {
            struct shot whole = shot_of_bricks(1, bricks == 5, methods[m]), shot = shot_of_bricks(bricks, bricks == 5, methods[m]);
            double worst = 0.0;
            for (size_t c = 0; c < 3; c++)
                for (int x = 0; x < SIZE; x++)
                    if (shot_at(&whole, c, x, SIZE / 2) > 0.0)
                        worst = fmax(worst, fabs(shot_at(&shot, c, x, SIZE / 2) / shot_at(&whole, c, x, SIZE / 2) - 1.0));
            print_message("# %s, %d bricks: off by %.3f\n", methods[m], bricks, worst);
            REQUIRE(worst < 0.06);
            shot_free(&shot);
            shot_free(&whole);
        }
    }
}

/* The dark side of a block lit from above: it has no direct light, and its light comes from the rim. A slab of its thickness transmits
 * none. */
static void sides_of_blocks_are_lit_from_the_rim(void **state)
{
    RELEASE_ONLY();
    static const char *const methods[] = { "hierarchical", "screen-space", "texture-space" };
    double light[PELL_COUNT(methods)];
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(methods); k++) {
        struct shot shot;
        struct stage s;
        size_t material;

        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, "jade", &material);
        stage_box(&s, material, 0, vec3(-14, -14, -14), vec3(14, 14, 14));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 60, 0), vec3(0, 0, 0), 10.0f);
        stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.3f, 0.0f);
        s.settings.opposed = s.settings.curvature = true;
        s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
        shot = stage_shot_of(&s, methods[k], NULL);
        light[k] = shot_at(&shot, 1, SIZE / 2, SIZE / 2);
        shot_free(&shot);
        stage_finish(&s);
    }
    for (size_t k = 1; k < PELL_COUNT(methods); k++) {
        print_message("# in the middle of the side: %s has %.2f of hierarchical's light\n", methods[k], light[k] / light[0]);
        REQUIRE(light[k] > 0.25 * light[0] && light[k] < 1.5 * light[0]); /* path-trace: 0.65 */
    }
}

/* On a dark face of a block adjacent to the edge of a lit face, light depends only on the distance from the edge. */
static void light_beside_an_edge_is_even(void **state)
{
    RELEASE_ONLY();
    enum { PIXELS = 32 };
    struct shot shot;
    struct stage s;
    size_t material;
    double within = 0.0, all = 0.0;
    (void) state;

    stage_start(&s, PIXELS, PIXELS);
    stage_medium(&s, "wholemilk", &material);
    stage_box(&s, material, 0, vec3(-20, -20, -20), vec3(20, 20, 20));
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 60), vec3(0, 0, 0), 10.0f);
    stage_camera(&s, vec3(220, 0, 12), vec3(0, 0, 12), 0.08f, 0.0f); /* the edge is 8 mm right of the middle; the image shows 16 mm */
    s.settings.opposed = s.settings.curvature = true;
    s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
    shot = stage_shot_of(&s, "screen-space", NULL);
    for (int x = 0; x < PIXELS; x++) {
        double sum = 0.0, square = 0.0;
        for (int y = 0; y < PIXELS; y++) {
            const double light = shot_at(&shot, 2, x, y);
            sum += light / PIXELS;
            square += light * light / PIXELS;
        }
        within += square - sum * sum;
        all += sum * sum;
    }
    print_message("# %.4f uneven\n", sqrt(within / all));
    REQUIRE(sqrt(within / all) < 0.05);
    shot_free(&shot);
    stage_finish(&s);
}

/* Two balls that nearly touch have the same brightness and colour as one object and as two: no light passes through the media from one
 * to the other. */
static void solids_that_nearly_touch_stay_apart(void **state)
{
    static const char *const methods[] = { "hierarchical", "screen-space" };
    static const double most[] = { 0.02, 0.055 }; /* blurs include pixels that are close on the screen */
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(methods); i++) {
        struct shot two = { 0 };
        for (int one = 0; one < 2; one++) {
            struct difference d;
            struct shot shot;
            struct stage s;
            size_t material;

            stage_start(&s, SIZE, SIZE);
            stage_medium(&s, "marble", &material);
            stage_ball(&s, material, 0, vec3(-10.005f, 0, 0), 10.0f, 16);
            stage_ball(&s, material, one ? 0 : 1, vec3(10.005f, 0, 0), 10.0f, 16);
            stage_light(&s, PELL_LIGHT_POINT, vec3(30, 60, 60), vec3(0, 0, 0), 2e-3f);
            stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.5f, 0.0f);
            s.settings.opposed = s.settings.curvature = s.settings.angles = true;
            s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
            shot = stage_shot_of(&s, methods[i], NULL);
            stage_finish(&s);
            if (!one) {
                two = shot;
                continue;
            }
            d = shot_difference(&two, &shot);
            print_message("# %s: differs by %.4f\n", methods[i], d.rms);
            REQUIRE(d.rms < most[i]);
            shot_free(&two);
            shot_free(&shot);
        }
    }
}

/* Sparse samples are unevenly distributed: none is treated as a hole through which light is lost, or as a light source. */
static void few_samples_leave_no_spots(void **state)
{
    (void) state;
    RELEASE_ONLY();

    for (int samples = 800; samples <= 1400; samples += 150) {
        struct shot shot[2];
        double worst = 0.0;
        for (int fine = 0; fine < 2; fine++) {
            struct stage s;
            size_t material;
            stage_start(&s, SIZE, SIZE);
            stage_medium(&s, "wholemilk", &material);
            stage_ball(&s, material, 0, vec3(0, 0, 0), 35.0f, 16);
            stage_light(&s, PELL_LIGHT_POINT, vec3(100, 200, 200), vec3(0, 0, 0), 2e-2f);
            stage_camera(&s, vec3(0, 0, 200), vec3(0, 0, 0), 0.5f, 0.0f);
            s.settings.opposed = s.settings.curvature = s.settings.angles = true;
            s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
            s.settings.indirect_samples = fine ? 16384 : samples;
            shot[fine] = stage_shot_of(&s, "screen-space", NULL);
            stage_finish(&s);
        }
        for (size_t c = 0; c < 3; c++)
            for (int i = 0; i < SIZE * SIZE; i++) {
                const double few = shot_at(&shot[0], c, i % SIZE, i / SIZE), many = shot_at(&shot[1], c, i % SIZE, i / SIZE);
                worst = fmax(worst, fabs(few - many) / shot_at(&shot[1], c, SIZE / 2, SIZE / 2));
            }
        print_message("# %d samples: off by %.3f of the light in the middle\n", samples, worst);
        REQUIRE(worst < 0.1);
        shot_free(&shot[0]);
        shot_free(&shot[1]);
    }
}

/* A ball of marble with a wall of 3 mm and a light inside: light is reflected back and forth inside, by the reflectance of a thin wall,
 * and the transmitted fraction of each bounce is visible from outside. */
static void a_thin_wall_lets_indirect_light_out(void **state)
{
    static const char *const methods[] = { "screen-space", "image-space", "texture-space", "hierarchical" };
    static const char *const traced[] = { "samples=64", NULL };
    struct shot truth, shot[PELL_COUNT(methods)];
    struct stage s;
    size_t material;
    (void) state;
    RELEASE_ONLY();

    stage_start(&s, SIZE, SIZE);
    stage_medium(&s, "marble", &material);
    stage_ball(&s, material, 0, vec3(0, 0, 0), 30.0f, 24);
    stage_ball(&s, material, 0, vec3(0, 0, 0), 27.0f, 24);
    turn_inside_out(&s.scene->meshes[1]);
    stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, 0), vec3(0, 0, 1), 1e-3f);
    stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 40.0f);
    s.settings.opposed = s.settings.curvature = s.settings.angles = true;
    s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
    s.settings.bounces = 8;
    truth = stage_shot_of(&s, "path-trace", traced);
    for (size_t i = 0; i < PELL_COUNT(methods); i++) /* one after another: what they share is computed once */
        shot[i] = stage_shot_of(&s, methods[i], NULL);
    s.settings.bounces = 0;
    for (size_t i = 0; i < PELL_COUNT(methods); i++) {
        struct shot none = stage_shot_of(&s, methods[i], NULL);
        for (size_t c = 0; c < 3; c++) {
            const double of = shot_sum(&truth, c);
            print_message("# %s: %.3f without, %.3f with\n", methods[i], shot_sum(&none, c) / of, shot_sum(&shot[i], c) / of);
            REQUIRE_NEAR(shot_sum(&shot[i], c) / of, 1.0, 0.15); /* the error of one bounce accumulates over many */
        }
        shot_free(&none);
        shot_free(&shot[i]);
    }
    shot_free(&truth);
    stage_finish(&s);
}

/* Scattering at points of the scene is counted once, however the lights are split. */
static void points_have_it_as_pixels_have(void **state)
{
    static const char *const methods[] = { "screen-space", "hierarchical", "texture-space", "convolution", "image-space" };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(methods); k++) {
        double light[2];
        struct stage s;
        start_pit(&s, 2, NULL);
        for (int n = 0; n < 2; n++) {
            struct shot shot;
            double sum = 0.0;
            s.settings.layers = true;
            s.settings.bounces = n * 8;
            s.settings.indirect_samples = SAMPLES;
            shot = stage_shot_of(&s, methods[k], NULL);
            for (size_t i = 0; i < shot.size; i++)
                if (shot.data[SHOT_TRANSLUCENT * shot.size + i] > 0.5f)
                    sum += (double) shot.data[SHOT_MULTIPLE * shot.size + i];
            light[n] = sum;
            shot_free(&shot);
        }
        print_message("# %s: %.3f times the light\n", methods[k], light[1] / light[0]);
        REQUIRE(light[1] > 1.02 * light[0] && light[1] < 1.6 * light[0]);
        stage_finish(&s);
    }
}

/* A flat medium under a directional light at one angle, seen at another: entering and exiting light have the factors of their own
 * angles. */
static void a_flat_medium_returns_light_by_its_angle(void **state)
{
    static const float away[] = { 0.0f, 0.6f, 3.0f }; /* tangents */
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(away); i++)
        for (size_t j = 0; j < PELL_COUNT(away); j++) {
            struct shot shot[2];
            struct pell_material *m;
            struct stage s;
            size_t medium;

            stage_start(&s, SIZE, SIZE);
            m = stage_medium(&s, "skin1", &medium);
            stage_box(&s, medium, 0, vec3(-500, -500, -100), vec3(500, 500, 0));
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(900 * away[i], 0, 900), vec3(0, 0, 0), 2.0f);
            stage_camera(&s, vec3(0, 900 * away[j], 900), vec3(0, 0, 0), 0.0f, 10.0f);
            for (int on = 0; on < 2; on++) {
                s.settings.angles = on;
                shot[on] = shot_with(&s, 0);
            }
            for (size_t c = 0; c < 3; c++) {
                struct pell_profile profile;
                struct pell_half_space_angle a;
                const double in = 1.0 / sqrt(1.0 + (double) away[i] * (double) away[i]);
                const double out = 1.0 / sqrt(1.0 + (double) away[j] * (double) away[j]), eta = (double) m->medium.eta;
                OK(pell_profile_make(PELL_PROFILE_DIPOLE, &m->medium, (int) c, NULL, &profile));
                a = pell_half_space_angle_of(pell_profile_total(&profile), eta);
                REQUIRE(a.slope > 0.05);
                const double enters = 1.0 + a.slope * (1.0 - sqrt(1.0 - (1.0 - in * in) / (eta * eta)));
                const double leaves = (1.0 + a.slope * (1.0 - sqrt(1.0 - (1.0 - out * out) / (eta * eta)))) / a.mean;
                REQUIRE_REL(light_at(&shot[1], SIZE / 2, SIZE / 2, c) / light_at(&shot[0], SIZE / 2, SIZE / 2, c), enters, 1e-4);
                REQUIRE_REL(shot_at(&shot[1], c, SIZE / 2, SIZE / 2) / shot_at(&shot[0], c, SIZE / 2, SIZE / 2), enters * leaves, 1e-4);
            }
            shot_free(&shot[0]);
            shot_free(&shot[1]);
            stage_finish(&s);
        }
}

static void every_failing_allocation_is_survived(void **state)
{
    (void) state;

    for (uint64_t at = 1;; at = next_allocation(at)) {
        struct pell_alloc_fault fault = { 0 };
        enum pell_result res;
        struct stage s;

        start_pit(&s, 1, &fault);
        s.settings.bounces = 2;
        s.settings.indirect_samples = 512;
        stage_complete(&s);
        OK(pell_renderer_set_scene(s.r, s.scene));
        fault.fail_at = atomic_load(&fault.calls) + at;
        res = pell_renderer_render(s.r, &s.settings, &s.image);
        fault.fail_at = 0;
        REQUIRE(res == PELL_OK || res == PELL_ERR_NOMEM);
        OK(pell_renderer_render(s.r, &s.settings, &s.image));
        stage_finish(&s);
        assert_int_equal(fault.live, 0);
        if (res == PELL_OK)
            break;
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_integrating_sphere_sums_the_geometric_series),
        cmocka_unit_test(light_that_a_wall_reflects_enters_elsewhere),
        cmocka_unit_test(a_plate_lights_what_faces_it_and_lets_nothing_through),
        cmocka_unit_test(a_red_wall_reddens_the_floor_before_it),
        cmocka_unit_test(many_samples_light_large_triangles_evenly),
        cmocka_unit_test(bits_are_those_of_any_number_of_threads_and_of_a_new_renderer),
        cmocka_unit_test(bits_are_those_of_any_level),
        cmocka_unit_test(more_bounces_are_more_light_and_none_is_none),
        cmocka_unit_test(a_thin_wall_lets_indirect_light_out),
        cmocka_unit_test(what_lies_inside_a_solid_is_no_surface),
        cmocka_unit_test(bricks_side_by_side_are_one_solid),
        cmocka_unit_test(sides_of_blocks_are_lit_from_the_rim),
        cmocka_unit_test(samples_keep_no_step_with_the_mesh),
        cmocka_unit_test(long_thin_triangles_have_the_light_of_short_ones),
        cmocka_unit_test(a_mirroring_ground_leaves_no_spots),
        cmocka_unit_test(light_beside_an_edge_is_even),
        cmocka_unit_test(solids_that_nearly_touch_stay_apart),
        cmocka_unit_test(few_samples_leave_no_spots),
        cmocka_unit_test(a_convex_solid_keeps_its_bits),
        cmocka_unit_test(points_have_it_as_pixels_have),
        cmocka_unit_test(a_flat_medium_returns_light_by_its_angle),
        cmocka_unit_test(every_failing_allocation_is_survived),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
