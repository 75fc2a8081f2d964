/* SPDX-License-Identifier: MIT
 * test_curvature.c - mean curvature of meshes against that of the solids that they approximate, and its effect on light: against
 * diffusion solved on a radial grid, against conservation, and against path-trace on a ball. */
#include "stage.h"

#include "math/vec.h"
#include "render/curvature/stage.h"
#include "scene/triangle.h"

#include <pellucid/layers.h>
#include <pellucid/profile.h>

#include <stdatomic.h>

#define SIZE 24

/* --- The gain -------------------------------------------------------------------------------------------------------------------- */

static void medium_of(struct pell_medium *m, double sigma_a, double sigma_s_reduced, double eta)
{
    *m = (struct pell_medium) { .eta = eta };
    for (int c = 0; c < 3; c++) {
        m->sigma_a[c] = sigma_a;
        m->sigma_s_reduced[c] = sigma_s_reduced;
    }
}

enum { NODES = 40000 };

/* Light that leaves a ball (or a hollow in a large body) of radius a, for a source spread uniformly at depth z0: u'' = s^2 u for u = r
 * phi on a grid, u = 0 in the middle (far away, about a hollow) and at the distance zb beyond the surface, by elimination. The flux
 * through the surface is a u' - u there. */
static double escape_on_a_grid(double a, double z0, double zb, double s, bool hollow)
{
    static double u[NODES + 1], upper[NODES + 1];
    const double low = hollow ? a - zb : 0.0, high = hollow ? a + z0 + 30.0 / s : a + zb, h = (high - low) / NODES;
    const double source = hollow ? a + z0 : a - z0, where = (source - low) / h;
    double at, value, slope;
    int i;

    upper[0] = u[0] = 0.0;
    for (i = 1; i < NODES; i++) {
        /* The shell's 1/(4 pi r) per unit of D, distributed over the two adjacent nodes. */
        const double near = 1.0 - fabs(where - i), f = near > 0.0 ? near / h / source : 0.0;
        const double d = -(2.0 / (h * h) + s * s) - upper[i - 1] / (h * h);
        upper[i] = 1.0 / (h * h) / d;
        u[i] = (-f - u[i - 1] / (h * h)) / d;
    }
    u[NODES] = 0.0;
    for (i = NODES - 1; i > 0; i--)
        u[i] -= upper[i] * u[i + 1];
    at = (a - low) / h;
    i = (int) at;
    value = u[i] + (at - i) * (u[i + 1] - u[i]);
    slope = (u[i + 1] - u[i]) / h;
    return fabs(a * slope - value);
}

static void gains_are_what_diffusion_says(void **state)
{
    static const double absorption[] = { 0.002, 0.05, 0.5 }, radii[] = { 8.0, 20.0, 100.0 };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(absorption); i++)
        for (size_t k = 0; k < PELL_COUNT(radii); k++)
            for (int hollow = 0; hollow < 2; hollow++) {
                struct pell_medium m;
                struct pell_profile p;
                double A, z0, zb, s, plane, want;

                medium_of(&m, absorption[i], 1.0, 1.4);
                OK(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, NULL, &p));
                z0 = 1.0 / (absorption[i] + 1.0);
                A = (1.0 + pell_fresnel_diffuse(1.4, PELL_FRESNEL_EXACT)) / (1.0 - pell_fresnel_diffuse(1.4, PELL_FRESNEL_EXACT));
                zb = 2.0 * A * z0 / 3.0;
                s = sqrt(3.0 * absorption[i] / z0);
                plane = exp(-s * (z0 + zb)) * cosh(s * zb);
                want = escape_on_a_grid(radii[k], z0, zb, s, hollow) / plane / pell_profile_cdf(&p, 2.0 * radii[k]);
                REQUIRE_REL(pell_curvature_gain(&m, 0, &p, (hollow ? -1.0 : 1.0) / radii[k]), want, 2e-3);
                REQUIRE(hollow ? want < 1.0 : want > 1.0);
            }
}

/* All light leaves a ball without absorption: the gain compensates for light beyond the longest chord; a plane has no gain. */
static void nothing_is_lost_without_absorption(void **state)
{
    (void) state;

    for (double radius = 10.0; radius < 2000.0; radius *= 3.0) {
        struct pell_medium m;
        struct pell_profile p;
        medium_of(&m, 1e-9, 1.0, 1.3);
        OK(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 1, NULL, &p));
        REQUIRE_REL(pell_curvature_gain(&m, 1, &p, 1.0 / radius) * pell_profile_cdf(&p, 2.0 * radius), 1.0, 1e-3);
        REQUIRE(pell_curvature_gain(&m, 1, &p, 0.0) == 1.0 && pell_curvature_gain(&m, 1, &p, (double) NAN) == 1.0);
    }
}

/* --- Meshes ----------------------------------------------------------------------------------------------------------------------- */

/* A scene of one object, of marble. */
static struct pell_curvature *curvature_of(struct stage *s, struct pell_profile profile[3])
{
    const struct pell_medium *medium = &s->scene->materials[0].medium;
    struct pell_curvature_medium media = { medium, profile };
    struct pell_curvature *out = NULL;
    struct pell_pool *pool = NULL;
    struct pell_rays *rays = NULL;

    for (int c = 0; c < 3; c++)
        OK(pell_profile_make(PELL_PROFILE_DIPOLE, medium, c, NULL, &profile[c]));
    OK(pell_pool_create(s->ctx, 2, &pool));
    OK(pell_rays_create(s->ctx, s->scene, pool, &rays));
    OK(pell_curvature_create(s->ctx, pool, s->scene, rays, &media, &out));
    pell_rays_destroy(&rays);
    pell_pool_destroy(&pool);
    return out;
}

static void a_ball_has_one_over_its_radius(void **state)
{
    static const float radii[] = { 15.0f, 60.0f };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(radii); k++)
        for (int rings = 12; rings <= 96; rings *= 8) {
            struct pell_profile profile[3];
            struct pell_curvature *curvature;
            struct stage s;
            size_t material;

            stage_start(&s, SIZE, SIZE);
            stage_medium(&s, "marble", &material);
            stage_ball(&s, material, 0, vec3(3, 4, 5), radii[k], rings);
            curvature = curvature_of(&s, profile);
            for (uint32_t t = 0; t < s.scene->meshes[0].num_triangles; t++)
                REQUIRE_REL(pell_curvature_at(curvature, 0, t, 0.3f, 0.3f).mean * radii[k], 1.0, rings < 20 ? 0.2 : 0.03);
            REQUIRE(pell_curvature_at(curvature, 1, 0, 0.3f, 0.3f).mean == 0.0f);
            REQUIRE(pell_curvature_at(curvature, 0, UINT32_MAX, 0.3f, 0.3f).mean == 0.0f);
            pell_curvature_destroy(&curvature);
            stage_finish(&s);
        }
}

/* A cube turns by a quarter at each of its edges: pi/4 per mm of edge is the integral of its mean curvature. Away from the edges it is
 * exactly flat. */
static void a_cube_is_curved_along_its_edges(void **state)
{
    const float side = 100.0f;
    const int n = 250;
    struct pell_profile profile[3];
    struct pell_curvature *curvature;
    double sum = 0.0;
    struct stage s;
    size_t material;
    (void) state;

    stage_start(&s, SIZE, SIZE);
    stage_medium(&s, "marble", &material);
    stage_box(&s, material, 0, vec3(0, 0, 0), vec3(side, side, side));
    curvature = curvature_of(&s, profile);
    for (uint32_t t = 0; t < s.scene->meshes[0].num_triangles; t++)
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n - i; j++)
                sum += (double) pell_curvature_at(curvature, 0, t, ((float) i + 0.33f) / (float) n, ((float) j + 0.33f) / (float) n).mean;
    sum *= 0.5 * (double) (side * side) / (0.5 * n * (n + 1));
    REQUIRE_REL(sum, 12.0 * (double) side * PELL_PI / 4.0, 0.1);
    REQUIRE(pell_curvature_at(curvature, 0, 0, 0.35f, 0.3f).mean == 0.0f);
    pell_curvature_destroy(&curvature);
    stage_finish(&s);
}

/* --- Thin parts ------------------------------------------------------------------------------------------------------------------ */

/* R and T of a slab relative to the half-space's R, for R, G and B. */
static void slab_totals(const struct pell_medium *m, double d, double reflected[3], double transmitted[3])
{
    for (int c = 0; c < 3; c++) {
        struct pell_slab slab;
        double half;
        REQUIRE(pell_slab_make(m, c, &slab));
        half = pell_slab_at(&slab, (double) INFINITY).reflected;
        reflected[c] = pell_slab_at(&slab, d).reflected / half;
        transmitted[c] = pell_slab_at(&slab, d).transmitted / half;
    }
}

/* At a point of mesh 0 in one lane; the other lanes are unchanged: they are inactive, or query invalid ids. */
enum { LANE = 11 };
static void effects_at(const struct pell_curvature *curvature, uint32_t triangle, float u, float v, struct pell_curvature_effects *e)
{
    struct pell_points16 points;
    int32_t ask[16];

    for (int i = 0; i < 16; i++) {
        points.mesh[i] = i % 3 == 1 ? UINT32_MAX : 0;
        points.triangle[i] = i % 3 == 2 ? UINT32_MAX : triangle;
        points.u[i] = u;
        points.v[i] = v;
        ask[i] = i % 3 ? -1 : 0;
    }
    points.mesh[LANE] = 0;
    points.triangle[LANE] = triangle;
    ask[LANE] = -1;
    pell_curvature_effects_at(curvature, &points, ask, e);
    for (int i = 0; i < 16; i++)
        for (int c = 0; c < 3 && i != LANE; c++) {
            REQUIRE(e->gain[c][i] == 1.0f && e->local[c][i] == 1.0f && e->opposed[c][i] == 1.0f && e->opposed_local[c][i] == 1.0f);
            REQUIRE(e->shift[c][i] == 0.0f && e->sheet[c][i] == 0.0f && e->round[c][i] == 0.0f && e->returned[c][i] == 1.0f);
            REQUIRE(e->crossed[c][i] == 1.0f);
            REQUIRE(e->flat[i] == 0.0f);
        }
}

/* For a sheet in air that is d mm thick, at the middle of both faces. */
static void a_sheet_keeps_what_a_slab_reflects(void **state)
{
    (void) state;

    for (float d = 0.5f; d < 20.0f; d *= 2.0f) {
        struct pell_profile profile[3];
        struct pell_curvature *curvature;
        double reflected[3], transmitted[3];
        struct stage s;
        size_t material;

        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, "marble", &material);
        stage_box(&s, material, 0, vec3(-100, -100, 0), vec3(100, 100, d));
        curvature = curvature_of(&s, profile);
        slab_totals(&s.scene->materials[0].medium, (double) d, reflected, transmitted);
        for (uint32_t t = 0; t < s.scene->meshes[0].num_triangles; t++) {
            struct pell_vec3 at[3], middle;
            struct pell_curvature_effects e;
            pell_triangle_corners(&s.scene->meshes[0], t, at);
            middle = vec3_add(vec3_mul(at[0], 0.02f), vec3_add(vec3_mul(at[1], 0.49f), vec3_mul(at[2], 0.49f)));
            if (fabsf(middle.x) > 50.0f || fabsf(middle.y) > 50.0f)
                continue; /* a side */
            REQUIRE_REL(pell_curvature_at(curvature, 0, t, 0.49f, 0.49f).thinness * d, 1.0, 1e-3);
            effects_at(curvature, t, 0.49f, 0.49f, &e);
            for (int c = 0; c < 3; c++) {
                REQUIRE_NEAR(e.local[c][LANE], reflected[c], 0.01);
                REQUIRE(e.gain[c][LANE] == 1.0f && reflected[c] < 1.0 && transmitted[c] > 0.0);
            }
        }
        pell_curvature_destroy(&curvature);
        stage_finish(&s);
    }
}

/* For a ball: its total reflectance, minus the light transmitted straight through its middle. */
static void a_ball_keeps_what_does_not_go_through(void **state)
{
    const float radius = 5.0f;
    struct pell_profile profile[3];
    struct pell_curvature *curvature;
    const struct pell_medium *m;
    double all[3], reflected[3], transmitted[3];
    struct stage s;
    size_t material;
    (void) state;

    stage_start(&s, SIZE, SIZE);
    stage_medium(&s, "marble", &material);
    stage_ball(&s, material, 0, vec3(3, 4, 5), radius, 96);
    curvature = curvature_of(&s, profile);
    m = &s.scene->materials[0].medium;
    slab_totals(m, 2.0 * (double) radius, reflected, transmitted);
    for (int c = 0; c < 3; c++)
        all[c] = pell_curvature_gain(m, c, &profile[c], 1.0 / (double) radius) * pell_profile_cdf(&profile[c], 2.0 * (double) radius);
    for (uint32_t t = 0; t < s.scene->meshes[0].num_triangles; t++) {
        struct pell_curvature_effects e;
        effects_at(curvature, t, 0.3f, 0.3f, &e);
        for (int c = 0; c < 3; c++)
            REQUIRE_NEAR(e.local[c][LANE], all[c] - transmitted[c], 0.02);
    }
    pell_curvature_destroy(&curvature);
    stage_finish(&s);
}

static double mean_of(const struct shot *shot, size_t c);

/* A sheet of 2 mm of marble, lit from the front, from behind, and uniformly: the planar profile alone returns a sixth to a third too
 * much in front. */
static void a_sheet_is_as_bright_as_path_traced(void **state)
{
    static const char *const traced[] = { "samples=64", NULL }, *const small_map[] = { "size=256", NULL };
    static const char *const methods[] = { "screen-space", "image-space", "texture-space" };
    (void) state;
    RELEASE_ONLY();

    for (int k = 0; k < 5; k++) {
        const int from = k % 3;
        const bool skin = k >= 3; /* 1 to 3 mean free paths */
        struct shot truth, shot;
        struct stage s;
        size_t material;

        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, skin ? "skin1" : "marble", &material)->rho_s = 0.0f;
        stage_box(&s, material, 0, vec3(-40, -40, -1), vec3(40, 40, 1));
        if (from == 2)
            stage_environment(&s, 1.0f);
        else
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(500, 0, from == 0 ? 700 : -700), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, 40.0f);
        s.settings.layers = s.settings.angles = true;
        truth = stage_shot_of(&s, "path-trace", traced);
        for (int on = 0; on < 2; on++) {
            s.settings.curvature = on;
            for (size_t i = 0; i < PELL_COUNT(methods); i++) {
                shot = stage_shot_of(&s, methods[i], strcmp(methods[i], "texture-space") == 0 ? small_map : NULL);
                for (size_t c = 0; c < 3; c++) {
                    const double ratio = mean_of(&shot, c) / mean_of(&truth, c);
                    if (on)
                        print_message("# %s, %s from %d, channel %zu: %.3f\n", skin ? "skin1" : "marble", methods[i], from, c, ratio);
                    REQUIRE(on ? fabs(ratio - 1.0) < (skin ? 0.15 : 0.05) : from == 1 || skin || ratio > 1.1);
                }
                shot_free(&shot);
            }
        }
        shot_free(&truth);
        stage_finish(&s);
    }
}

/* --- Light ------------------------------------------------------------------------------------------------------------------------ */

/* Light along the axis of a ball of radius a: in the middle of the image the entering light is gain (1 - 2 l/(eta a)) times that of a
 * plane; without scattering it is the same. */
static void a_ball_lit_from_the_front_has_the_closed_form(void **state)
{
    const float radius = 30.0f;
    struct shot shot[2], none[2];
    struct pell_material *m;
    struct stage s;
    size_t material;
    (void) state;

    stage_start(&s, SIZE + 1, SIZE + 1);
    m = stage_medium(&s, "skin1", &material);
    stage_ball(&s, material, 0, vec3(0, 0, 0), radius, 128);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 900), vec3(0, 0, 0), 2.0f);
    stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, 10.0f);
    s.settings.layers = true;
    for (int on = 0; on < 2; on++) {
        s.settings.curvature = on;
        shot[on] = stage_shot_of(&s, "hierarchical", NULL);
        none[on] = stage_shot_of(&s, "none", NULL);
    }
    for (size_t c = 0; c < 3; c++) {
        const double path = 1.0 / (m->medium.sigma_a[c] + m->medium.sigma_s_reduced[c]), bent = 1.0 - 2.0 * path / (m->medium.eta * 30.0);
        struct pell_profile p;
        double gain;
        OK(pell_profile_make(PELL_PROFILE_DIPOLE, &m->medium, (int) c, NULL, &p));
        gain = pell_curvature_gain(&m->medium, (int) c, &p, 1.0 / (double) radius);
        REQUIRE(gain > 1.02);
        REQUIRE_REL(shot_at(&shot[1], SHOT_IRRADIANCE + c, SIZE / 2, SIZE / 2) / shot_at(&shot[0], SHOT_IRRADIANCE + c, SIZE / 2, SIZE / 2),
                    gain * bent, 5e-3);
        REQUIRE_REL(shot_at(&shot[1], c, SIZE / 2, SIZE / 2) / shot_at(&shot[0], c, SIZE / 2, SIZE / 2), gain * bent, 5e-3);
        REQUIRE(shot_at(&none[1], c, SIZE / 2, SIZE / 2) == shot_at(&none[0], c, SIZE / 2, SIZE / 2));
    }
    for (int on = 0; on < 2; on++) {
        shot_free(&shot[on]);
        shot_free(&none[on]);
    }
    stage_finish(&s);
}

static double mean_of(const struct shot *shot, size_t c)
{
    double sum = 0.0;

    for (int y = 0; y < shot->height; y++)
        for (int x = 0; x < shot->width; x++)
            sum += shot_at(shot, c, x, y) - shot_at(shot, SHOT_SPECULAR + c, x, y);
    return sum;
}

/* A ball of 20 mm under uniform illumination, ten mean free paths thick for red: with the planar profile it is a tenth to a quarter too
 * dark. */
static void a_ball_under_even_light_is_as_bright_as_path_traced(void **state)
{
    static const char *const traced[] = { "samples=256", NULL };
    struct shot truth, off, on;
    struct stage s;
    size_t material;
    (void) state;
    RELEASE_ONLY();

    stage_start(&s, SIZE, SIZE);
    stage_medium(&s, "skin1", &material)->roughness = 0.0f;
    stage_ball(&s, material, 0, vec3(0, 0, 0), 10.0f, 48);
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, 22.0f);
    s.settings.layers = s.settings.angles = true;
    s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
    s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
    s.settings.curvature = false;
    truth = stage_shot_of(&s, "path-trace", traced);
    off = stage_shot_of(&s, "hierarchical", NULL);
    s.settings.curvature = true;
    on = stage_shot_of(&s, "hierarchical", NULL);
    for (size_t c = 0; c < 3; c++) {
        REQUIRE(mean_of(&off, c) / mean_of(&truth, c) < 0.95);
        REQUIRE_REL(mean_of(&on, c) / mean_of(&truth, c), 1.0, 0.05);
    }
    shot_free(&truth);
    shot_free(&off);
    shot_free(&on);
    stage_finish(&s);
}

/* Mean radiance in the middle of the image. */
static double middle_of(const struct shot *shot, size_t c)
{
    double sum = 0.0;

    for (int y = shot->height / 2 - SIZE / 4; y < shot->height / 2 + SIZE / 4; y++)
        for (int x = shot->width / 2 - SIZE / 4; x < shot->width / 2 + SIZE / 4; x++)
            sum += shot_at(shot, c, x, y);
    return sum;
}

/* The middle of an orthographic camera's image, by path-trace: only the pixels that middle_of() reads. */
static struct shot traced_middle(struct stage *s, const char *const *knobs)
{
    struct pell_camera *const camera = &s->scene->cameras[0];
    struct shot shot;

    s->settings.width = s->settings.height = SIZE / 2;
    camera->ortho_height *= 0.5f;
    shot = stage_shot_of(s, "path-trace", knobs);
    s->settings.width = s->settings.height = SIZE;
    camera->ortho_height *= 2.0f;
    return shot;
}

/* A prism of skin1 whose edge is sharper than the spacing of samples, under uniform illumination: two faces that nearly meet contribute
 * to each other no more than a half-space returns. (path-trace has 4.2 times the middle's blue over red there: light passes the edge.) */
static void sharp_edges_have_no_colour_of_their_own(void **state)
{
    static const float corner[6][3] = { { -20, 0, 6 }, { 20, 0, 6 }, { -20, 0, -6 }, { 20, 0, -6 }, { -20, 20, 0 }, { 20, 20, 0 } };
    static const uint32_t face[8][3] = { { 0, 1, 5 }, { 0, 5, 4 }, { 3, 2, 4 }, { 3, 4, 5 },
                                         { 2, 3, 1 }, { 2, 1, 0 }, { 0, 4, 2 }, { 1, 3, 5 } };
    struct pell_mesh *mesh;
    struct shot shot;
    struct stage s;
    size_t material;
    double middle, most = 0.0;
    (void) state;

    stage_start(&s, SIZE, SIZE);
    stage_medium(&s, "skin1", &material)->rho_s = 0.0f;
    mesh = shapes_mesh(s.scene, material, 24, 8);
    for (uint32_t i = 0; i < 24; i++) {
        const uint32_t *of = face[i / 3];
        const struct pell_vec3 a = vec3_load(corner[of[0]]), b = vec3_load(corner[of[1]]), c = vec3_load(corner[of[2]]);
        vec3_store(vec3_load(corner[of[i % 3]]), mesh->position + (size_t) 3 * i);
        vec3_store(vec3_normalize(vec3_cross(vec3_sub(b, a), vec3_sub(c, a))), mesh->normal + (size_t) 3 * i);
        mesh->index[i] = i;
    }
    shapes_bound(s.scene, mesh);
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3(0, 300, 900), vec3(0, 10, 0), 0.0f, 24.0f);
    s.settings.layers = s.settings.angles = s.settings.curvature = s.settings.opposed = true;
    s.settings.indirect_samples = 2048;
    shot = stage_shot_of(&s, "screen-space", NULL);
    middle = shot_at(&shot, 2, SIZE / 2, SIZE / 2) / shot_at(&shot, 0, SIZE / 2, SIZE / 2);
    for (int y = 0; y < SIZE; y++)
        for (int x = SIZE / 3; x < 2 * SIZE / 3; x++)
            if (shot_at(&shot, 0, x, y) > 0.0)
                most = fmax(most, shot_at(&shot, 2, x, y) / shot_at(&shot, 0, x, y));
    print_message("# blue over red: %.3f, at the edge %.3f at most\n", middle, most);
    REQUIRE(most < 2.7 * middle);
    shot_free(&shot);
    stage_finish(&s);
}

/* A thin plate of marble, lit from the side and behind: light also comes from its rim, which a slab's T along one direction does not
 * include. */
static void plates_of_what_absorbs_little_are_as_bright_as_path_traced(void **state)
{
    static const char *const traced[] = { "samples=300", NULL }, *const methods[] = { "screen-space", "image-space" };
    (void) state;
    RELEASE_ONLY();

    for (int k = 0; k < 2; k++) {
        struct shot truth, shot;
        struct stage s;
        size_t material;
        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, "marble", &material)->rho_s = 0.0f;
        stage_box(&s, material, 0, vec3(-6, -6, -1), vec3(6, 6, k == 0 ? 1.0f : 2.0f));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(200, 900, -300), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, 13.0f);
        s.settings.layers = s.settings.angles = s.settings.curvature = s.settings.opposed = true;
        s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
        truth = stage_shot_of(&s, "path-trace", traced);
        for (size_t i = 0; i < PELL_COUNT(methods); i++) {
            shot = stage_shot_of(&s, methods[i], NULL);
            for (size_t c = 0; c < 3; c++) {
                const double over = mean_of(&shot, c) / mean_of(&truth, c);
                print_message("# plate of %d mm, %s, channel %zu: %.3f\n", k + 2, methods[i], c, over);
                REQUIRE_REL(over, 1.0, 0.125);
            }
            shot_free(&shot);
        }
        shot_free(&truth);
        stage_finish(&s);
    }
}

/* Light that enters is multiplied by albedo^m, light that leaves by albedo^(1-m): half the albedo is half the light. */
static void the_colour_of_a_surface_is_a_factor(void **state)
{
    static const char *const small_map[] = { "size=128", NULL };
    static const char *const methods[] = { "screen-space", "texture-space", "convolution", "hierarchical" };
    static const float color[2][3] = { { 0.9f, 0.5f, 0.2f }, { 0.45f, 0.25f, 0.1f } };
    (void) state;
    RELEASE_ONLY();

    for (size_t i = 0; i < PELL_COUNT(methods); i++) {
        const char *const *knobs = strcmp(methods[i], "texture-space") == 0 ? small_map : NULL;
        struct shot bright, dim;
        struct pell_material *m;
        struct stage s;
        size_t material;

        stage_start(&s, 48, 48);
        m = stage_medium(&s, "marble", &material);
        m->rho_s = 0.0f;
        m->color_from = PELL_COLOR_FROM_TEXTURE;
        m->mix = 0.3f;
        stage_box(&s, material, 0, vec3(-4, -6, -4), vec3(4, 6, 4));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(700, 300, 500), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, 14.0f);
        s.settings.layers = s.settings.angles = s.settings.curvature = s.settings.opposed = true;
        memcpy(m->base_color, color[0], sizeof(color[0]));
        bright = stage_shot_of(&s, methods[i], knobs);
        memcpy(m->base_color, color[1], sizeof(color[1]));
        dim = stage_shot_of(&s, methods[i], knobs);
        for (size_t c = 0; c < 3; c++)
            for (int y = 0; y < 48; y++)
                for (int x = 0; x < 48; x++)
                    REQUIRE(fabs(shot_at(&dim, c, x, y) - 0.5 * shot_at(&bright, c, x, y)) < 2e-3 * shot_at(&bright, c, 24, 24));
        shot_free(&bright);
        shot_free(&dim);
        stage_finish(&s);
    }
}

/* Sum of a channel over the left or the right half of a picture. */
static double half_of(const struct shot *shot, size_t channel, bool right)
{
    double sum = 0.0;

    for (int y = 0; y < SIZE; y++)
        for (int x = 0; x < SIZE / 2; x++)
            sum += shot_at(shot, channel, x + (right ? SIZE / 2 : 0), y);
    return sum;
}

/* Bars of four mean free paths, thinner than the profile, so that a blur across the visible pixels would mix their lit and dark sides; and
 * plates so wide that few collocation points resolve their absorption. */
static void narrow_solids_are_as_bright_as_path_traced(void **state)
{
    static const char *const traced[] = { "samples=200", NULL }, *const small_map[] = { "size=256", NULL };
    static const char *const methods[] = { "screen-space", "texture-space", "hierarchical" };
    (void) state;
    RELEASE_ONLY();

    for (int k = 0; k < 2; k++) {
        struct shot truth, shot;
        struct stage s;
        size_t material;

        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, k == 0 ? "wax" : "marble", &material)->rho_s = 0.0f;
        if (k == 0)
            stage_box(&s, material, 0, vec3(-1.5f, -6.0f, -1.5f), vec3(1.5f, 6.0f, 1.5f));
        else
            stage_box(&s, material, 0, vec3(-15, -10, -1), vec3(15, 10, 1));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(700, 200, 500), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, k == 0 ? 13.0f : 32.0f);
        s.settings.layers = s.settings.angles = s.settings.curvature = s.settings.opposed = true;
        truth = stage_shot_of(&s, "path-trace", traced);
        for (size_t i = 0; i < PELL_COUNT(methods); i++) {
            shot = stage_shot_of(&s, methods[i], strcmp(methods[i], "texture-space") == 0 ? small_map : NULL);
            for (size_t c = 0; c < 3; c++) {
                const double dark = half_of(&shot, c, false) / half_of(&truth, c, false),
                             lit = half_of(&shot, c, true) / half_of(&truth, c, true);
                print_message("# %s, %s, channel %zu: %.3f and %.3f\n", k == 0 ? "bar" : "plate", methods[i], c, dark, lit);
                REQUIRE_REL(mean_of(&shot, c) / mean_of(&truth, c), 1.0, 0.125);
                REQUIRE_REL(dark, 1.0, 0.18);
                REQUIRE_REL(lit, 1.0, 0.125);
            }
            shot_free(&shot);
        }
        shot_free(&truth);
        stage_finish(&s);
    }
}

/* A ball of 10 mm of skin or marble, and a slab, backlit. All visible light is transmitted: a half-space's profile is up to seven times
 * too dark for the ball of skin, and a slab's T along one chord up to three times too bright for that of marble. For red the radius is
 * four mean free paths of skin, outside the range of the curvature gain. Smooth boundaries: without highlights, light enters others without
 * loss, but not with path-trace. */
static void solids_lit_from_behind_are_as_bright_as_path_traced(void **state)
{
    static const char *const traced[] = { "samples=600", NULL };
    static const char *const methods[] = { "hierarchical", "screen-space", "image-space", "texture-space" };
    (void) state;
    RELEASE_ONLY();

    for (int k = 0; k < 3; k++) {
        const bool slab = k == 2;
        struct shot truth, off[PELL_COUNT(methods)], on;
        struct stage s;
        size_t material;

        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, k == 0 ? "skin1" : "marble", &material)->rho_s = 0.0f;
        if (slab)
            stage_box(&s, material, 0, vec3(-40, -40, -2), vec3(40, 40, 2));
        else
            stage_ball(&s, material, 0, vec3(0, 0, 0), 5.0f, 48);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(100, 150, -900), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, slab ? 40.0f : 8.0f); /* the middle of each */
        s.settings.layers = s.settings.angles = s.settings.curvature = true;
        s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
        s.settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
        truth = traced_middle(&s, traced);
        s.settings.opposed = false;
        for (size_t i = 0; i < PELL_COUNT(methods); i++) /* one after another: what they share is computed once */
            off[i] = stage_shot_of(&s, methods[i], NULL);
        s.settings.opposed = true;
        for (size_t i = 0; i < PELL_COUNT(methods); i++) {
            on = stage_shot_of(&s, methods[i], NULL);
            for (size_t c = 0; c < 2; c++) {
                const double before = middle_of(&off[i], c) / middle_of(&truth, c), now = middle_of(&on, c) / middle_of(&truth, c);
                print_message("# %s, %s, channel %zu: %.3f without, %.3f with\n",
                              slab     ? "slab"
                              : k == 0 ? "ball of skin1"
                                       : "ball of marble",
                              methods[i], c, before, now);
                REQUIRE(fabs(now - 1.0) < 0.06);
                REQUIRE(slab || i == 3 || (k == 0 && c == 0) || fabs(now - 1.0) < 0.5 * fabs(before - 1.0));
            }
            shot_free(&off[i]);
            shot_free(&on);
        }
        shot_free(&truth);
        stage_finish(&s);
    }
}

/* Balls of twelve mean free paths, lit from the camera's side, from aside and from behind to one side. Light leaves a round solid farther
 * around it than it enters, on the side that it comes from less than its exitance toward the camera: without that the lit side is up to
 * 1.2 times too bright. Without internal reflection, and with it. */
static void round_solids_are_as_bright_as_path_traced_from_all_sides(void **state)
{
    static const char *const traced[] = { "samples=256", NULL };
    static const char *const methods[] = { "screen-space", "texture-space", "hierarchical" }, *const small_map[] = { "size=256", NULL };
    static const struct {
        float x, z;
        double within;
    } sides[] = { { 0, 900, 0.09 }, { 900, 0, 0.05 }, { 700, -700, 0.09 } };
    (void) state;
    RELEASE_ONLY();

    for (size_t k = 0; k < 2 * PELL_COUNT(sides); k++) {
        const double within = sides[k / 2].within;
        struct shot truth, shot;
        struct pell_material *m;
        struct stage s;
        size_t material;

        stage_start(&s, SIZE, SIZE);
        m = stage_medium(&s, "marble", &material);
        for (int c = 0; c < 3; c++) {
            m->medium.sigma_a[c] = c == 0 ? 0.16f : c == 1 ? 0.05f : 0.01f;
            m->medium.sigma_s_reduced[c] = 1.0f - m->medium.sigma_a[c];
        }
        m->medium.eta = k % 2 ? 1.4f : 1.0f;
        m->rho_s = m->roughness = 0.0f;
        stage_ball(&s, material, 0, vec3(0, 0, 0), 6.0f, 64);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(sides[k / 2].x, 0, sides[k / 2].z), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, 13.0f);
        s.settings.layers = s.settings.angles = s.settings.curvature = true;
        s.settings.single_scattering = s.settings.opposed = s.settings.unscattered = true;
        s.settings.profile = 0;
        s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
        truth = stage_shot_of(&s, "path-trace", traced);
        for (size_t i = 0; i < PELL_COUNT(methods); i++) {
            shot = stage_shot_of(&s, methods[i], strcmp(methods[i], "texture-space") == 0 ? small_map : NULL);
            for (size_t c = 0; c < 3; c++) {
                const double ratio = mean_of(&shot, c) / mean_of(&truth, c);
                print_message("# index %.1f, side %zu, %s, channel %zu: %.3f\n", k % 2 ? 1.4 : 1.0, k / 2, methods[i], c, ratio);
                REQUIRE_REL(ratio, 1.0, within);
            }
            shot_free(&shot);
        }
        shot_free(&truth);
        stage_finish(&s);
    }
}

/* A ball of grapefruit juice, six mean free paths thick for red. Backlit, the transmitted light is scattered forward. Seen from the
 * light there is none of it: treating it as a diffuse source made rims of clear objects several times too bright. */
static void clear_solids_pass_light_forward(void **state)
{
    static const char *const traced[] = { "samples=96", NULL }, *const methods[] = { "screen-space", "hierarchical" };
    (void) state;
    RELEASE_ONLY();

    for (int back = 0; back < 2; back++) {
        struct shot other, shot;
        struct stage s;
        size_t material;
        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, "ruby-grapefruit-juice", &material)->roughness = 0.0f;
        stage_ball(&s, material, 0, vec3(0, 0, 0), 30.0f, 48);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(back ? 100 : 500, 700, back ? -700 : 900), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, 66.0f);
        s.settings.layers = s.settings.angles = s.settings.curvature = true;
        s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
        for (size_t i = 0; i < PELL_COUNT(methods); i++) {
            s.settings.opposed = false;
            other = back ? stage_shot_of(&s, "path-trace", traced) : stage_shot_of(&s, methods[i], NULL);
            s.settings.opposed = true;
            shot = stage_shot_of(&s, methods[i], NULL);
            for (size_t c = 0; c < 2; c++) {
                const double over = mean_of(&shot, c) / mean_of(&other, c);
                print_message("# %s, %s, channel %zu: %.3f\n", back ? "over path-trace" : "from in front, over that of a half-space",
                              methods[i], c, over);
                REQUIRE(over > (back ? 0.6 : 0.85) && over < (back ? 1.25 : c == 0 ? 1.7 : 1.3));
            }
            shot_free(&shot);
            shot_free(&other);
        }
        stage_finish(&s);
    }
}

/* A sheet of grapefruit juice, 0.4 to 1.1 mean free paths thick, backlit at two angles. The transmitted light is scattered forward: with
 * path-trace it is 20 times as bright in the direction of the light as sideways. */
static void clear_sheets_are_bright_toward_the_light(void **state)
{
    RELEASE_ONLY();
    static const double traced[2][3] = { { 44.1, 29.5, 22.6 }, { 2.19, 1.38, 1.02 } };
    static const char *const methods[] = { "screen-space", "texture-space" };
    (void) state;

    for (int oblique = 0; oblique < 2; oblique++) {
        struct stage s;
        size_t material;
        stage_start(&s, SIZE, SIZE);
        stage_medium(&s, "ruby-grapefruit-juice", &material)->roughness = 0.0f;
        stage_box(&s, material, 0, vec3(-60, -60, -2), vec3(60, 60, 2));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(oblique ? 1200 : 300, 0, -900), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, 40.0f);
        s.settings.layers = s.settings.angles = s.settings.curvature = s.settings.opposed = true;
        s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
        for (size_t i = 0; i < PELL_COUNT(methods); i++) {
            struct shot shot = stage_shot_of(&s, methods[i], NULL);
            for (size_t c = 0; c < 3; c++) {
                const double over = middle_of(&shot, c) / traced[oblique][c];
                print_message("# %s, %s, channel %zu: %.3f\n", oblique ? "oblique" : "nearly behind", methods[i], c, over);
                REQUIRE(over > 0.75 && over < 1.25);
            }
            shot_free(&shot);
        }
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
        size_t material;

        stage_start_on(&s, PELL_ENGINE_CPU, 8, 8, 1, &fault);
        stage_medium(&s, "marble", &material);
        stage_ball(&s, material, 0, vec3(0, 0, 0), 10.0f, 8);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 900), vec3(0, 0, 0), 2.0f);
        stage_camera(&s, vec3(0, 0, 900), vec3(0, 0, 0), 0.0f, 22.0f);
        s.settings.curvature = true;
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
        cmocka_unit_test(gains_are_what_diffusion_says),
        cmocka_unit_test(nothing_is_lost_without_absorption),
        cmocka_unit_test(a_ball_has_one_over_its_radius),
        cmocka_unit_test(a_cube_is_curved_along_its_edges),
        cmocka_unit_test(a_sheet_keeps_what_a_slab_reflects),
        cmocka_unit_test(a_ball_keeps_what_does_not_go_through),
        cmocka_unit_test(a_sheet_is_as_bright_as_path_traced),
        cmocka_unit_test(a_ball_lit_from_the_front_has_the_closed_form),
        cmocka_unit_test(a_ball_under_even_light_is_as_bright_as_path_traced),
        cmocka_unit_test(sharp_edges_have_no_colour_of_their_own),
        cmocka_unit_test(plates_of_what_absorbs_little_are_as_bright_as_path_traced),
        cmocka_unit_test(the_colour_of_a_surface_is_a_factor),
        cmocka_unit_test(narrow_solids_are_as_bright_as_path_traced),
        cmocka_unit_test(solids_lit_from_behind_are_as_bright_as_path_traced),
        cmocka_unit_test(round_solids_are_as_bright_as_path_traced_from_all_sides),
        cmocka_unit_test(clear_solids_pass_light_forward),
        cmocka_unit_test(clear_sheets_are_bright_toward_the_light),
        cmocka_unit_test(every_failing_allocation_is_survived),
    };
    return cmocka_run_group_tests_name("render.curvature", tests, NULL, NULL);
}
