/* SPDX-License-Identifier: MIT
 * test_convolution_scenes.c - the convolution method on whole scenes: hidden surfaces, separate solids, moving depth planes. */
#include "scenes.h"

#include "render/renderer.h"

static const char *const fine[] = { "density=8", NULL };

/* Mean over fully covered pixels; with `other`, the root mean square of the difference, too. */
static double mean_of(const struct shot *a, const struct shot *other, double *rms)
{
    double sum = 0.0, square = 0.0;
    int n = 0;

    for (int y = 0; y < a->height; y++)
        for (int x = 0; x < a->width; x++)
            for (size_t c = 0; c < 3 && shot_at(a, SHOT_A, x, y) >= 1.0; c++) {
                const double v = shot_at(a, c, x, y), e = other ? v - shot_at(other, c, x, y) : 0.0;
                sum += v;
                square += e * e;
                n++;
            }
    if (rms)
        *rms = sqrt(square / n);
    return sum / n;
}

/* 0: a ball lit from the side; 1: two merged balls, a concave object; 2: a backlit sheet. */
static void object(struct stage *s, int which, int size)
{
    size_t m;

    stage_start(s, size, size);
    stage_gaussians(s, 0.5, &m);
    if (which == 1) {
        stage_ball(s, m, 0, vec3(-4, 0, 2), 6.0f, 48);
        stage_ball(s, m, 0, vec3(4, 0, -2), 6.0f, 48);
    } else if (which == 2) {
        stage_box(s, m, 0, vec3(-8, -8, -1.5), vec3(8, 8, 0));
    } else {
        stage_ball(s, m, 0, vec3(0, 0, 0), 6.0f, 64);
    }
    stage_light(s, PELL_LIGHT_POINT, which == 2 ? vec3(10, 10, -60) : vec3(60, 40, 5), vec3(0, 0, 0), 5e-3f);
    stage_camera(s, vec3(0, 0, 100), vec3(0, 0, 0), 0.17f, 0.0f);
}

static void more_planes_come_nearer_to_the_whole_surface(void **state)
{
    static const char *const names[] = { "ball", "two balls in one", "sheet lit from behind" };
    static const double bounds[3][2] = { { 0.06, 0.15 }, { 0.06, 0.2 }, { 0.03, 0.06 } }; /* of the mean, of the root mean square */
    static const double usual[3][2] = { { 0.03, 0.06 }, { 0.06, 0.15 }, { 0.06, 0.15 } }; /* of the method with default knobs */

    (void) state;
    for (int k = 0; k < 3; k++) {
        struct stage s;
        struct shot whole, paper;
        double truth, rms, mean;
        static const char *const printed[] = { "as=paper", "resolution=1", NULL };
        object(&s, k, 64);
        whole = stage_shot_of(&s, "hierarchical", fine);
        truth = mean_of(&whole, NULL, NULL);
        paper = stage_shot_of(&s, "convolution", printed);
        mean = mean_of(&paper, &whole, &rms);
        print_message("# %s: as printed %.3f of hierarchical's light (rms %.3f);", names[k], mean / truth, rms / truth);
        shot_free(&paper);
        for (int planes = 4; planes <= 16; planes *= 4) {
            char text[32];
            const char *const form[] = { text, "surfaces=4", "behind-step=1", "borders=open", NULL };
            struct shot shot;
            double e;
            snprintf(text, sizeof(text), "planes=%d", planes);
            shot = stage_shot_of(&s, "convolution", form);
            mean = mean_of(&shot, &whole, &e);
            print_message(" %d planes %.3f (%.3f)", planes, mean / truth, e / truth);
            if (planes == 16)
                REQUIRE(e < rms && fabs(mean / truth - 1.0) < bounds[k][0] && e < bounds[k][1] * truth);
            shot_free(&shot);
        }
        {
            struct shot shot = stage_shot_of(&s, "convolution", NULL);
            double e;
            mean = mean_of(&shot, &whole, &e);
            print_message(" by default %.3f (%.3f)\n", mean / truth, e / truth);
            REQUIRE(e < rms + 0.02 * truth && fabs(mean / truth - 1.0) < usual[k][0] && e < usual[k][1] * truth);
            shot_free(&shot);
        }
        shot_free(&whole);
        stage_finish(&s);
    }
}

/* A ray through a ball hits two surfaces: requesting more layers finds none, whatever the step. */
static void what_the_camera_sees_counts_once(void **state)
{
    static const char *const two[] = { "surfaces=2", "behind-step=2", NULL }, *const five[] = { "surfaces=5", "behind-step=2", NULL };
    struct stage s;
    struct shot a, b;

    (void) state;
    object(&s, 0, 50);
    a = stage_shot_of(&s, "convolution", two);
    b = stage_shot_of(&s, "convolution", five);
    {
        double rms;
        const double mean = mean_of(&b, &a, &rms);
        REQUIRE_REL(mean, mean_of(&a, NULL, NULL), 0.005);
        REQUIRE(rms < 0.02 * mean);
    }
    shot_free(&a);
    shot_free(&b);
    stage_finish(&s);
}

/* Depth planes that no pixel uses change nothing except rounding. */
static void planes_that_are_not_seen_change_nothing(void **state)
{
    static const char *const on[] = { "planes=12", "visible=on", NULL }, *const off[] = { "planes=12", "visible=off", NULL };

    (void) state;
    for (int k = 0; k < 3; k++) {
        struct stage s;
        struct shot a, b;
        object(&s, k, 50);
        a = stage_shot_of(&s, "convolution", on);
        b = stage_shot_of(&s, "convolution", off);
        {
            const struct difference d = shot_difference(&a, &b);
            print_message("# difference: %.2g of the mean, largest %.2g\n", d.rms, d.largest);
            REQUIRE(d.largest < 1e-5);
        }
        shot_free(&a);
        shot_free(&b);
        stage_finish(&s);
    }
}

/* No light passes from one object to another, even where they touch. */
static void light_stays_in_its_object(void **state)
{
    (void) state;
    require_light_stays_in_its_object("convolution", NULL, false, 0.0f, 16.0f, 16, 6, 8);
}

/* Nor does a light on one object change a bit of another object's pixels inside its bounding rectangle. */
static void light_on_an_object_changes_no_bit_of_another(void **state)
{
    struct shot shots[2] = { { 0 } };
    int own = 0, other = 0;

    (void) state;
    for (int source = 0; source < 2; source++) {
        struct stage s;
        size_t m;
        stage_start(&s, 48, 32);
        stage_gaussians(&s, 0.5, &m);
        stage_box(&s, m, 0, vec3(-10, -8, -4), vec3(2, 0, 0));
        stage_box(&s, m, 1, vec3(2, -8, -4), vec3(10, 8, 0));
        stage_box(&s, m, 1, vec3(-10, 4, -4), vec3(2, 8, 0)); /* surrounds the first */
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(30, 40, 60), vec3(0, 0, 0), 2.0f);
        stage_light(&s, PELL_LIGHT_SPOT, vec3(-4, -4, 30), vec3(-4, -4, 0), source ? 5e-2f : 0.0f);
        s.scene->lights[1].cos_inner = 0.997f;
        s.scene->lights[1].cos_outer = 0.995f;
        stage_camera(&s, vec3(0, 0, 20), vec3(0, 0, 0), 0.0f, 16.0f);
        shots[source] = stage_shot_of(&s, "convolution", NULL);
        stage_finish(&s);
    }
    for (int y = 0; y < 32; y++)
        for (int x = 0; x < 48; x++) {
            const bool first = y >= 17 && x < 27, second = y < 15 || x >= 29; /* edges at 16 and 28 */
            const double a = shot_at(&shots[0], 0, x, y), b = shot_at(&shots[1], 0, x, y);
            own += first && b > 1.01 * a;
            other += second && a > 0.0;
            if (second)
                assert_true(a == b);
        }
    REQUIRE(own > 100 && other > 500);
    shot_free(&shots[0]);
    shot_free(&shots[1]);
}

/* An object so small that some samples of the multisample miss it, including the first: each frame finds the hidden surfaces again. */
static void light_behind_is_of_its_own_frame(void **state)
{
    static const char *const fine_cells[] = { "behind-step=1", NULL };
    int there = 0;

    (void) state;
    for (int i = 0; i < 12; i++) {
        const float at = 0.08f * (float) i - 0.45f, up = 0.25f * (float) (i % 4) - 0.375f;
        struct shot shots[2] = { { 0 } };
        for (int fresh = 0; fresh < 2; fresh++) {
            struct stage s;
            size_t m;
            stage_start(&s, 24, 24);
            s.settings.msaa = 4;
            stage_gaussians(&s, 0.2, &m);
            stage_box(&s, m, 0, vec3(-0.3f, -0.3f, -0.6f), vec3(0.3f, 0.3f, -0.2f));
            stage_light(&s, PELL_LIGHT_POINT, vec3(10, 10, -60), vec3(0, 0, 0), 5e-3f);
            if (!fresh) { /* another object is in view before */
                stage_camera(&s, vec3(0, 0, 5), vec3(0, 0, 0), 0.0f, 1.0f);
                stage_method(&s, "convolution", fine_cells);
                shots[0] = stage_shot(&s);
                shot_free(&shots[0]);
                stage_camera(&s, vec3(at, up, 30), vec3(at, up, 0), 0.0f, 24.0f);
                shots[0] = stage_shot(&s);
            } else {
                stage_camera(&s, vec3(at, up, 30), vec3(at, up, 0), 0.0f, 24.0f);
                shots[1] = stage_shot_of(&s, "convolution", fine_cells);
            }
            stage_finish(&s);
        }
        for (int y = 0; y < 24; y++)
            for (int x = 0; x < 24; x++) {
                there += shot_at(&shots[1], 0, x, y) > 0.0;
                for (size_t c = 0; c < 3; c++)
                    assert_true(shot_at(&shots[0], c, x, y) == shot_at(&shots[1], c, x, y));
            }
        shot_free(&shots[0]);
        shot_free(&shots[1]);
    }
    REQUIRE(there > 5);
}

/* The camera orbits a box: depth planes move through it. The mean radiance must vary as smoothly as the surfaces that the planes
 * represent. At one sample per pixel the hidden sides are three or four columns of cells, whose number changes in steps. */
static void planes_slide_without_popping(void **state)
{
    enum { FRAMES = 12 };
    static const char *const names[] = { "hierarchical", "convolution", "convolution" };
    double jump[3] = { 0.0 };

    (void) state;
    for (int form = 0; form < 3; form++) {
        struct stage s;
        double mean[FRAMES];
        size_t m;
        stage_start(&s, 48, 48);
        s.settings.msaa = form == 2 ? 4 : 1;
        stage_gaussians(&s, 0.5, &m);
        stage_box(&s, m, 0, vec3(-6, -4, -3), vec3(6, 4, 3));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(30, 40, 60), vec3(0, 0, 0), 2.0f);
        for (int i = 0; i < FRAMES; i++) {
            const double a = 0.3 + 0.01 * i;
            struct shot shot;
            stage_camera(&s, vec3(100.0f * (float) sin(a), 30.0f, 100.0f * (float) cos(a)), vec3(0, 0, 0), 0.17f, 0.0f);
            if (i == 0)
                stage_method(&s, names[form], NULL);
            shot = stage_shot(&s);
            mean[i] = mean_of(&shot, NULL, NULL);
            shot_free(&shot);
        }
        for (int i = 1; i + 1 < FRAMES; i++)
            jump[form] = fmax(jump[form], fabs(mean[i + 1] - 2.0 * mean[i] + mean[i - 1]) / mean[i]);
        stage_finish(&s);
    }
    print_message("# half a degree a frame: the mean light bends by %.5f at most, with four samples %.5f, hierarchical's by %.5f\n",
                  jump[1], jump[2], jump[0]);
    REQUIRE(jump[1] < 0.01 && jump[2] < 0.005);
}

/* The surface in front of thick parts receives no light that thin parts of the object transmit: a backlit plate with a block on it.
 * (With the mean over both it was a third as bright as the plate.) */
static void thick_parts_stay_dark_before_light(void **state)
{
    double thin[2], thick[2];

    (void) state;
    for (int method = 0; method < 2; method++) {
        struct stage s;
        struct shot shot;
        size_t m;
        stage_start(&s, 64, 32);
        stage_gaussians(&s, 0.2, &m);
        stage_box(&s, m, 0, vec3(-16, -8, -1), vec3(0, 8, 0));
        stage_box(&s, m, 0, vec3(0, -8, -12), vec3(16, 8, 0));
        stage_box(&s, m, 0, vec3(-16, 7, -60), vec3(-15, 8, -59)); /* uses distant depth planes */
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -60), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 16.0f);
        shot = stage_shot_of(&s, method ? "convolution" : "hierarchical", NULL);
        thin[method] = shot_at(&shot, 0, 16, 16);
        thick[method] = shot_at(&shot, 0, 48, 16);
        shot_free(&shot);
        stage_finish(&s);
    }
    print_message("# before 1 mm and 12 mm: %.3g and %.1e, hierarchical %.3g and %.1e\n", thin[1], thick[1], thin[0], thick[0]);
    REQUIRE_REL(thin[1], thin[0], 0.1);
    REQUIRE(thick[1] < 1e-4 * thin[1]);
}

/* The middle of backlit sheets of a medium: the slab's T, which R at the distance of the planes is not. */
static void sheets_transmit_what_slabs_do(void **state)
{
    (void) state;
    for (float d = 0.5f; d < 5.0f; d *= 2.0f) {
        double middle[3];
        for (int i = 0; i < 3; i++) {
            static const char *const planes[] = { "through=planes", NULL };
            struct stage s;
            struct shot shot;
            size_t m;
            stage_start(&s, 32, 32);
            stage_medium(&s, "marble", &m);
            stage_box(&s, m, 0, vec3(-20, -20, -d), vec3(20, 20, 0));
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -60), vec3(0, 0, 0), 2.0f);
            stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 16.0f);
            shot = stage_shot_of(&s, i == 0 ? "screen-space" : "convolution", i == 2 ? planes : NULL);
            middle[i] = shot_at(&shot, 1, 16, 16);
            shot_free(&shot);
            stage_finish(&s);
        }
        print_message("# %g mm: %.3f of a slab's light, by planes %.3f\n", (double) d, middle[1] / middle[0], middle[2] / middle[0]);
        REQUIRE_REL(middle[1], middle[0], 0.02);
        REQUIRE(d > 0.5f || middle[2] > 1.15 * middle[0]);
    }
}

/* Pixels store ids of solids in 16 bits. */
static void too_many_solids_are_refused_by_name(void **state)
{
    struct stage s;
    size_t m;

    (void) state;
    stage_start(&s, 16, 16);
    stage_gaussians(&s, 0.5, &m);
    for (int i = 0; i < 65535; i++) {
        struct pell_mesh *mesh = shapes_mesh(s.scene, m, 3, 1);
        mesh->object = i;
        for (uint32_t k = 0; k < 3; k++) {
            mesh->position[3 * k] = (float) (i % 256) + (k == 1);
            mesh->position[3 * k + 1] = (float) (i / 256) + (k == 2);
            mesh->normal[3 * k + 2] = 1.0f;
            mesh->index[k] = k;
        }
    }
    stage_light(&s, PELL_LIGHT_POINT, vec3(60, 40, 5), vec3(0, 0, 0), 5e-3f);
    stage_camera(&s, vec3(128, 128, 400), vec3(128, 128, 0), 0.5f, 0.0f);
    stage_method(&s, "convolution", NULL);
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_UNSUPPORTED);
    assert_string_equal(s.kept.what, "65535 solids, at most 65534");
    stage_finish(&s);
}

static void a_frame_allocates_nothing(void **state)
{
    struct stage s;
    uint64_t before;
    size_t m;

    (void) state;
    stage_start(&s, 60, 40);
    stage_gaussians(&s, 0.5, &m);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 6.0f, 24);
    stage_light(&s, PELL_LIGHT_POINT, vec3(60, 40, 5), vec3(0, 0, 0), 5e-3f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.17f, 0.0f);
    stage_method(&s, "convolution", NULL);
    stage_render(&s);
    before = pell_allocations(s.ctx);
    stage_camera(&s, vec3(20, 5, 90), vec3(0, 1, 0), 0.17f, 0.0f);
    stage_render(&s);
    assert_int_equal(pell_allocations(s.ctx), before);
    stage_finish(&s);
}

/* |v/middle - 1| for a wide box that extends beyond the image under uniform illumination, at the pixel where it is largest. */
static double worst_at_borders(const char *borders, float radius)
{
    const char *const knobs[] = { borders, NULL };
    double worst = 0.0;
    struct stage s;
    struct shot shot;
    size_t m;

    stage_start(&s, 48, 32);
    stage_gaussians(&s, (double) radius, &m);
    stage_box(&s, m, 0, vec3(-60, -60, -30), vec3(60, 60, 0));
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.17f, 0.0f);
    shot = stage_shot_of(&s, "convolution", knobs);
    for (int y = 0; y < shot.height; y++)
        for (int x = 0; x < shot.width; x++)
            for (size_t c = 0; c < 3; c++)
                worst = fmax(worst, fabs(shot_at(&shot, c, x, y) / shot_at(&shot, c, shot.width / 2, shot.height / 2) - 1.0));
    shot_free(&shot);
    stage_finish(&s);
    return worst;
}

static void objects_go_on_beyond_the_picture(void **state)
{
    (void) state;
    for (float radius = 0.2f; radius < 2.0f; radius *= 3.0f) {
        const double open = worst_at_borders("borders=open", radius), made_up = worst_at_borders("borders=even", radius);
        print_message("# radius %g mm of 17 mm: off by %.3f at the image's borders, open %.3f\n", (double) radius, made_up, open);
        REQUIRE(made_up < 0.1 && (open > 0.3 || open < 2.0 * made_up));
    }
    assert_true(worst_at_borders("borders=open", 1.8f) > 0.3);
}

/* A facing slab of marble, lit by a spot near its middle, with a strength that is constant, a uniform map, or a map with steps. */
enum painted { CONSTANT, ALIKE, STEPS };
static struct shot shot_of_strength(const char *method, const char *const *knobs, enum painted painted, uint8_t strength)
{
    static const uint8_t steps[4] = { 255, 180, 90, 20 };
    struct pell_material *m;
    struct pell_mesh *mesh;
    struct stage s;
    struct shot shot;
    uint8_t pixels[16];
    size_t material;

    stage_start(&s, 64, 48);
    s.settings.bounces = 0;
    m = stage_medium(&s, "marble", &material);
    for (size_t i = 0; i < sizeof(pixels); i++)
        pixels[i] = painted == STEPS ? steps[i / 4] : strength;
    if (painted == CONSTANT)
        m->strength = (float) strength / 255.0f;
    else
        m->strength_map =
            (struct pell_texture_map) { .matrix = { 1, 0, 0, 0, 1, 0 }, .texture = shapes_texture(s.scene, 2, 2, 4, false, pixels) };
    stage_box(&s, material, 0, vec3(-60.0f, -60.0f, -60.0f), vec3(60.0f, 60.0f, 0.0f));
    mesh = &s.scene->meshes[s.scene->num_meshes - 1];
    mesh->uv[0] = pell_calloc(s.ctx, mesh->num_vertices, 2 * sizeof(float));
    assert_non_null(mesh->uv[0]);
    for (size_t i = 0; i < mesh->num_vertices; i++)
        for (size_t k = 0; k < 2; k++)
            mesh->uv[0][2 * i + k] = 0.5f + mesh->position[3 * i + k] / 40.0f;
    stage_light(&s, PELL_LIGHT_POINT, vec3(-3.0f, 1.0f, 6.0f), vec3(0, 0, 0), 50.0f);
    stage_camera(&s, vec3(0.0f, 0.0f, 200.0f), vec3(0, 0, 0), 0.0f, 12.0f);
    shot = stage_shot_of(&s, method, knobs);
    stage_finish(&s);
    return shot;
}

/* A uniform strength map equals that constant strength, whether one level has it or two are interpolated; a varying map gives each pixel
 * its own, as with the method that sums samples. */
static void a_painted_strength_scales_the_radius(void **state)
{
    static const uint8_t strengths[] = { 255, 180, 90, 20 };
    static const char *const samples[] = { "samples=1024", "tile=1", "through=off", "reconstruct=off", NULL };
    static const char *const off[] = { "strength=off", NULL };
    struct shot painted, other;
    struct difference d, without;

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(strengths); k++) {
        painted = shot_of_strength("convolution", NULL, ALIKE, strengths[k]);
        other = shot_of_strength("convolution", NULL, CONSTANT, strengths[k]);
        d = shot_difference(&painted, &other);
        print_message("# strength %.2f: painted and constant differ by %.4f of the mean\n", strengths[k] / 255.0, d.rms);
        REQUIRE(d.rms < (k == 0 ? 1e-6 : 0.006));
        shot_free(&painted);
        shot_free(&other);
    }
    other = shot_of_strength("image-space", samples, STEPS, 0);
    painted = shot_of_strength("convolution", NULL, STEPS, 0);
    d = shot_difference(&painted, &other);
    shot_free(&painted);
    painted = shot_of_strength("convolution", off, STEPS, 0);
    without = shot_difference(&painted, &other);
    print_message("# painted in steps: %.4f from image-space, %.4f without the map\n", d.rms, without.rms);
    REQUIRE(d.rms < 0.012 && d.rms < 0.25 * without.rms);
    shot_free(&painted);
    shot_free(&other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(more_planes_come_nearer_to_the_whole_surface),
        cmocka_unit_test(what_the_camera_sees_counts_once),
        cmocka_unit_test(planes_that_are_not_seen_change_nothing),
        cmocka_unit_test(light_stays_in_its_object),
        cmocka_unit_test(light_on_an_object_changes_no_bit_of_another),
        cmocka_unit_test(light_behind_is_of_its_own_frame),
        cmocka_unit_test(planes_slide_without_popping),
        cmocka_unit_test(thick_parts_stay_dark_before_light),
        cmocka_unit_test(sheets_transmit_what_slabs_do),
        cmocka_unit_test(objects_go_on_beyond_the_picture),
        cmocka_unit_test(a_painted_strength_scales_the_radius),
        cmocka_unit_test(too_many_solids_are_refused_by_name),
        cmocka_unit_test(a_frame_allocates_nothing),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
