/* SPDX-License-Identifier: MIT
 * test_path_chains.c - light of delta lights through chains of smooth surfaces (specular manifold sampling): closed forms of slabs,
 * refractive connections, and a white furnace of delta lights, in which no class of paths may be missing. Seeds are fixed; statistical
 * tests allow 3.5 standard errors. */
#include "path_trace_rig.h"

#include "methods/path_trace/path.h"
#include "render/renderer.h"

#include "slow.h"

#define FEWER(n) (SLOW ? (n) / 8 : (n))

static void plain_stage(struct stage *s)
{
    stage_start_threads(s, 8, 8, 1);
    stage_camera(s, vec3(0, 0, 500), vec3(0, 0, 0), 0.0f, 9.0f);
}

/* Illuminated from directly above. */
static struct pt_point seen_at(const struct stage *s, float x, float y)
{
    const struct pell_ray ray = { { x, y, 100.0f }, 0.0f, { 0, 0, -1 }, INFINITY, PELL_RAY_TRANSLUCENT };
    struct pell_hit hit;

    REQUIRE(pell_rays_closest(pell_renderer_services(s->r)->rays, &ray, &hit));
    return rig_point(vec3(x, y, 100.0f - hit.t), vec3(x, y, 500.0f), 7);
}

static struct rig_mean measure(struct stage *s, struct pt_knobs knobs, unsigned techniques, float x, float y, int samples)
{
    struct pt_scene *scene;
    struct pt_point at;
    struct rig_mean r;

    knobs.techniques = techniques;
    scene = rig_scene(s, &knobs);
    at = seen_at(s, x, y);
    r = rig_measure(scene, &at, 0, samples);
    pt_scene_destroy(&scene);
    assert_int_equal(r.counts.chains_cut, 0);
    return r;
}

static void require_mean(const char *name, double value, double error, double expected, double slack)
{
    print_message("# %s: %.5g +- %.2g, expected %.5g, %.1f sigma\n", name, value, error, expected,
                  (value - expected) / fmax(error, 1e-300));
    REQUIRE_NEAR(value, expected, SIGMAS * error + slack);
}

/* In a scene that is marked complete, since completion refuses materials without scattering. */
static void make_clear(struct stage *s)
{
    for (size_t i = 0; i < s->scene->num_materials; i++)
        for (int c = 0; c < 3; c++)
            s->scene->materials[i].medium.sigma_s_reduced[c] = 1e-9;
    OK(pell_renderer_set_scene(s->r, s->scene));
}

/* --- Closed forms ------------------------------------------------------------------------------------------------------------------ */

/* Single scattering in a wide slab under a directional light, seen along the normal: light and camera paths may both be reflected
 * inside, any number of times. */
static double slab_single(double sigma_s, double sigma_t, double thickness, double eta, double mu_out)
{
    const double mu = sqrt(1.0 - (1.0 - mu_out * mu_out) / (eta * eta)), r = pell_fresnel(eta, mu_out), r0 = pell_fresnel(eta, 1.0);
    const double light = mu_out * (1.0 - r) / mu / (1.0 - r * r * exp(-2.0 * sigma_t * thickness / mu));
    const double camera = (1.0 - r0) / (eta * eta) / (1.0 - r0 * r0 * exp(-2.0 * sigma_t * thickness));
    double sum = 0.0;

    for (int i = 0; i < 1000; i++) {
        const double z = thickness * (i + 0.5) / 1000.0, up = 2.0 * thickness - z;
        sum += (exp(-sigma_t * z) + r0 * exp(-sigma_t * up)) * (exp(-sigma_t * z / mu) + r * exp(-sigma_t * up / mu));
    }
    return sum * thickness / 1000.0 * light * camera * sigma_s / (4.0 * PELL_PI);
}

static void slabs_reflect_inside(void **state)
{
    static const struct {
        double thickness, eta, mu;
    } cases[] = { { 0.4, 1.5, 0.8 }, { 0.2, 2.5, 0.5 }, { 1.5, 1.3, 0.25 } };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        const double thickness = cases[k].thickness, expected = slab_single(0.8, 1.0, thickness, cases[k].eta, cases[k].mu);
        const float sine = (float) sqrt(1.0 - cases[k].mu * cases[k].mu);
        struct rig_mean all, connected;
        struct stage s;
        char name[96];
        size_t m;

        plain_stage(&s);
        m = rig_medium(&s, 0.8, 0.2, 0.0, cases[k].eta);
        stage_box(&s, m, 0, vec3(-300, -300, (float) -thickness), vec3(300, 300, 0));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.6f * sine, 0.8f * sine, (float) cases[k].mu), vec3(0, 0, 0), 1.0f);
        all = measure(&s, rig_knobs(), PT_ALL, 0.013f, 0.007f, FEWER(12000));
        connected = measure(&s, rig_knobs(), PT_ALL & ~(unsigned) PT_SPECULAR_MANIFOLD, 0.013f, 0.007f, FEWER(4000));
        snprintf(name, sizeof(name), "slab of %g mm, index %g, one scattering (%.3g without chains)", thickness, cases[k].eta,
                 connected.mean[1][1]);
        require_mean(name, all.mean[1][1], all.error[1][1], expected, 0.0);
        REQUIRE(SLOW || k != 1 || connected.mean[1][1] + SIGMAS * connected.error[1][1] < expected);
        REQUIRE(SLOW || all.error[1][1] < 0.06 * expected);
        stage_finish(&s);
    }
}

static double slab_passes(double r, double depth)
{
    return (1.0 - r) * (1.0 - r) * exp(-depth) / (1.0 - r * r * exp(-2.0 * depth));
}

/* A nearly clear slab over a dark grey floor: light and camera paths each cross it, with all internal reflections. Interreflection of
 * floor and slab is of second order in the floor's albedo. */
static void slabs_light_what_is_below(void **state)
{
    const double eta = 1.5, mu = 0.8, albedo = 0.01, absorbed = 0.01, inside = sqrt(1.0 - (1.0 - mu * mu) / (eta * eta));
    const double expected =
        slab_passes(pell_fresnel(eta, 1.0), absorbed) * slab_passes(pell_fresnel(eta, mu), absorbed / inside) * mu * albedo / PELL_PI;
    struct rig_mean all;
    struct stage s;
    size_t m, floor;

    (void) state;
    plain_stage(&s);
    m = rig_medium(&s, 1.0, absorbed, 0.0, eta);
    stage_opaque(&s, (float) albedo, &floor);
    stage_box(&s, m, 0, vec3(-30, -30, -1), vec3(30, 30, 0));
    stage_box(&s, floor, 1, vec3(-60, -60, -3), vec3(60, 60, -2));
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.6f, 0.0f, 0.8f), vec3(0, 0, 0), 1.0f);
    stage_render(&s);
    make_clear(&s);
    all = measure(&s, rig_knobs(), PT_ALL, 0.013f, 0.007f, FEWER(12000));
    require_mean("a caustic below a clear slab", all.mean[0][1], all.error[0][1], expected, 0.006 * expected);
    REQUIRE(SLOW || all.error[0][1] < 0.04 * expected);
    all = measure(&s, rig_knobs(), PT_ALL & ~(unsigned) PT_SPECULAR_MANIFOLD, 0.013f, 0.007f, 1000);
    REQUIRE(all.mean[0][1] < 0.02 * expected);
    stage_finish(&s);
}

/* A grey floor below a clear slab, which light reaches through chains only. */
static struct pt_scene *floor_below_slab(struct stage *s, struct pt_knobs *knobs)
{
    size_t m, floor;

    plain_stage(s);
    m = rig_medium(s, 1.0, 0.01, 0.0, 1.5);
    stage_opaque(s, 0.5f, &floor);
    stage_box(s, m, 0, vec3(-30, -30, -1), vec3(30, 30, 0));
    stage_box(s, floor, 1, vec3(-60, -60, -3), vec3(60, 60, -2));
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(0.6f, 0.0f, 0.8f), vec3(0, 0, 0), 1.0f);
    stage_render(s);
    make_clear(s);
    knobs->techniques = PT_SPECULAR_MANIFOLD;
    return rig_scene(s, knobs);
}

/* A chain may take a million trials: none begins once the context is cancelled, and abandoned chains are not counted as failures. */
static void cancelled_trials_end(void **state)
{
    struct pt_knobs knobs = rig_knobs();
    struct pt_scene *scene;
    struct pt_point at;
    struct rig_mean r;
    struct stage s;

    (void) state;
    scene = floor_below_slab(&s, &knobs);
    at = seen_at(&s, 0.013f, 0.007f);
    r = rig_measure(scene, &at, 0, 200);
    REQUIRE(r.counts.chains > 0 && r.mean[0][1] > 0.0);
    pell_context_cancel(s.ctx);
    r = rig_measure(scene, &at, 0, 200);
    REQUIRE(r.counts.chains > 0 && r.counts.chains_cut == 0);
    assert_true(r.mean[0][1] == 0.0);
    pt_scene_destroy(&scene);
    stage_finish(&s);
}

/* After the deadline a chain continues for only a few trials; before it, the deadline has no effect. */
static void late_trials_end(void **state)
{
    struct pt_knobs knobs = rig_knobs();
    struct pt_scene *scene;
    struct pt_point at;
    struct rig_mean r, measured;
    struct stage s;

    (void) state;
    scene = floor_below_slab(&s, &knobs);
    at = seen_at(&s, 0.013f, 0.007f);
    r = rig_measure(scene, &at, 0, 3000);
    REQUIRE(r.counts.chains > 0 && r.counts.late == 0);
    pt_scene_set_deadline(scene, pell_seconds() + 1000.0);
    measured = rig_measure(scene, &at, 0, 3000);
    REQUIRE(measured.counts.late == 0);
    assert_true(measured.mean[0][1] == r.mean[0][1]);
    pt_scene_set_deadline(scene, 0.0);
    r = rig_measure(scene, &at, 0, 3000);
    REQUIRE(r.counts.late > 0 && r.counts.chains > r.counts.late && r.counts.chains_cut == 0);
    REQUIRE(r.mean[0][1] < measured.mean[0][1]);
    pt_scene_destroy(&scene);
    stage_finish(&s);
}

/* --- Against refractive connections ------------------------------------------------------------------------------------------------- */

/* Chains of one surface equal refractive connections, which use different code. Coarse balls have many solutions, including faint ones. */
static void chains_are_connections(void **state)
{
    static const struct {
        int rings, normals;
        enum pell_light_type type;
    } cases[] = {
        { 24, PT_NORMALS_SMOOTH, PELL_LIGHT_POINT },
        { 7, PT_NORMALS_SMOOTH, PELL_LIGHT_DIRECTIONAL },
        { 7, PT_NORMALS_FLAT, PELL_LIGHT_POINT },
    };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        struct pt_knobs knobs = rig_knobs();
        struct rig_mean with, without;
        struct stage s;
        size_t m;

        plain_stage(&s);
        m = rig_medium(&s, 0.3, 0.05, 0.4, 1.4);
        s.scene->materials[m].medium.sigma_a[2] *= 8.0;
        stage_ball(&s, m, 0, vec3(0, 0, 0), 4.0f, cases[k].rings);
        stage_light(&s, cases[k].type, vec3(8, 10, 16), vec3(0, 0, 0), cases[k].type == PELL_LIGHT_POINT ? 0.001f : 1.0f);
        knobs.normals = cases[k].normals;
        with = measure(&s, knobs, PT_ALL, 0.9f, 0.4f, FEWER(5000));
        without = measure(&s, knobs, PT_ALL & ~(unsigned) PT_CONNECT, 0.9f, 0.4f, FEWER(5000));
        for (int part = 0; part < 2; part++)
            for (int c = 0; c < 3; c += 2) {
                char name[96];
                snprintf(name, sizeof(name), "%d rings, normals %d, part %d, channel %d: chains against connections", cases[k].rings,
                         cases[k].normals, part, c);
                require_mean(name, without.mean[part][c], hypot(with.error[part][c], without.error[part][c]), with.mean[part][c], 0.0);
            }
        REQUIRE(without.counts.chains > with.counts.chains);
        stage_finish(&s);
    }
}

/* --- A white furnace of delta lights ------------------------------------------------------------------------------------------------ */

/* Delta lights uniformly all around, equivalent to an environment of radiance 1. */
static void many_lights(struct stage *s, int count)
{
    for (int i = 0; i < count; i++) {
        const double z = 1.0 - 2.0 * (i + 0.5) / count, phi = 2.399963229728653 * i, sine = sqrt(1.0 - z * z);
        stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3((float) (sine * cos(phi)), (float) (sine * sin(phi)), (float) z), vec3(0, 0, 0),
                    (float) (4.0 * PELL_PI / count));
    }
}

enum objects { NOTHING, NESTED, NESTED_ROUGH, BONE, FLOOR, PARTLY_ROUGH };

static void furnace_stage(struct stage *s, enum objects objects)
{
    size_t m, other;

    plain_stage(s);
    m = rig_medium(s, objects == NESTED_ROUGH ? 0.05 : 0.4, 0.0, 0.0, objects == NESTED_ROUGH ? 1.2 : 1.4);
    s->scene->materials[m].roughness = objects == PARTLY_ROUGH ? 0.6f : 0.0f;
    if (objects == PARTLY_ROUGH) { /* one solid of two materials: its upper half is smooth */
        struct pell_mesh *mesh;
        stage_ball(s, m, 0, vec3(0, 0, 0), 3.0f, 16);
        stage_ball(s, m, 0, vec3(0, 0, 0), 3.0f, 16);
        other = rig_medium(s, 0.4, 0.0, 0.0, 1.4);
        s->scene->materials[other].roughness = 0.0f;
        for (int half = 0; half < 2; half++) {
            size_t kept = 0;
            mesh = &s->scene->meshes[half];
            for (size_t t = 0; t < mesh->num_triangles; t++) {
                float z = 0.0f;
                for (size_t k = 0; k < 3; k++)
                    z += mesh->position[3 * (size_t) mesh->index[3 * t + k] + 2];
                if ((z > 0.0f) == (half == 1))
                    memmove(mesh->index + 3 * kept++, mesh->index + 3 * t, 3 * sizeof(*mesh->index));
            }
            mesh->num_triangles = kept;
        }
        s->scene->meshes[1].material = (int) other;
        return;
    }
    stage_ball(s, m, 0, vec3(0, 0, 0), 3.0f, 24);
    if (objects == NESTED || objects == NESTED_ROUGH) {
        other = rig_medium(s, 0.8, 0.0, 0.0, 1.7);
        s->scene->materials[other].roughness = objects == NESTED_ROUGH ? 1.0f : 0.0f;
        stage_ball(s, other, 1, vec3(0.3f, 0.5f, 0.5f), 1.5f, 16);
    } else if (objects == BONE) {
        stage_opaque(s, 1.0f, &other);
        stage_ball(s, other, 1, vec3(0.3f, 0.5f, 0.5f), 1.5f, 16);
    } else if (objects == FLOOR) {
        stage_opaque(s, 0.6f, &other);
        stage_box(s, other, 1, vec3(-12, -12, -4.5f), vec3(12, 12, -3.5f));
    }
}

/* The same solid in an environment, which paths hit at random. Unscattered light that passes only smooth surfaces is invisible for delta
 * lights: samples with such a path have exactly the environment's radiance, and are subtracted. */
static void furnaces_of_delta_lights(void **state)
{
    static const char *const names[] = { "ball", "nested", "nested, rough", "bone", "over a gray floor", "upper half smooth" };

    (void) state;
    for (int objects = 0; objects < (int) PELL_COUNT(names); objects++) {
        struct pt_knobs knobs = rig_knobs();
        struct rig_mean sources, environment, clear;
        struct stage s;
        char name[96];

        knobs.boundary = objects == NESTED_ROUGH || objects == PARTLY_ROUGH ? PT_BOUNDARY_ROUGH : PT_BOUNDARY_SMOOTH;
        furnace_stage(&s, (enum objects) objects);
        many_lights(&s, 128);
        sources = measure(&s, knobs, PT_ALL, 0.9f, 0.4f, FEWER(6000));
        stage_finish(&s);
        furnace_stage(&s, (enum objects) objects);
        stage_environment(&s, 1.0f);
        environment = measure(&s, knobs, PT_HIT_LIGHTS, 0.9f, 0.4f, FEWER(5000));
        for (size_t i = 0; i < s.scene->num_materials; i++) /* nothing scatters: the remaining light passed unscattered */
            for (int c = 0; c < 3; c++) {
                s.scene->materials[i].medium.sigma_a[c] = s.scene->materials[i].medium.sigma_s_reduced[c];
                s.scene->materials[i].base_color[c] = 0.0f;
            }
        make_clear(&s);
        clear = measure(&s, knobs, PT_HIT_LIGHTS, 0.9f, 0.4f, FEWER(4000));
        stage_finish(&s);
        if (objects == NESTED_ROUGH || objects == PARTLY_ROUGH) { /* rough surfaces scatter, too: no single component can be subtracted */
            snprintf(name, sizeof(name), "%s, of lights against the environment, one scattering", names[objects]);
            require_mean(name, sources.mean[1][1], hypot(sources.error[1][1], environment.error[1][1]), environment.mean[1][1],
                         0.01 * environment.mean[1][1]);
            continue;
        }
        for (int part = 0; part < 2; part++) {
            const double bar = hypot(sources.error[part][1], hypot(environment.error[part][1], part == 0 ? clear.error[0][1] : 0.0));
            const double expected = environment.mean[part][1] - (part == 0 ? clear.mean[0][1] : 0.0);
            snprintf(name, sizeof(name), "%s, of lights against the environment, %s", names[objects], part ? "one scattering" : "the rest");
            require_mean(name, sources.mean[part][1], bar, expected, 0.02 * expected);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slabs_reflect_inside), cmocka_unit_test(slabs_light_what_is_below), cmocka_unit_test(cancelled_trials_end),
        cmocka_unit_test(late_trials_end),      cmocka_unit_test(chains_are_connections),    cmocka_unit_test(furnaces_of_delta_lights),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
