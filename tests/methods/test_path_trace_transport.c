/* SPDX-License-Identifier: MIT
 * test_path_trace_transport.c - single samples of path-trace: conservation laws, slabs of the oracle, and agreement of all light
 * sampling techniques. Seeds are fixed; statistical tests allow 3.5 standard errors. */
#include "layers_rig.h"
#include "path_trace_rig.h"

#include "methods/path_trace/path.h"
#include "render/renderer.h"

#include "oracle.h"

#define FEWER(n) (SLOW ? (n) / 8 : (n))

static void plain_stage(struct stage *s)
{
    stage_start_threads(s, 8, 8, 1);
}

static void look_along(struct stage *s, float width)
{
    stage_camera(s, vec3(0, 0, 500), vec3(0, 0, 0), 0.0f, width);
}

/* A point of the upper side of a ball about the origin, seen from above. */
static struct pt_point on_ball(const struct stage *s, float radius, float x, float y)
{
    const struct pell_ray ray = { { x, y, 2.0f * radius }, 0.0f, { 0, 0, -1 }, INFINITY, PELL_RAY_TRANSLUCENT };
    struct pell_hit hit;

    REQUIRE(pell_rays_closest(pell_renderer_services(s->r)->rays, &ray, &hit));
    return rig_point(vec3(x, y, 2.0f * radius - hit.t), vec3(x, y, 500), 7);
}

static void busy_stage(struct stage *s, struct pt_knobs *knobs, bool rough, size_t *material);

/* --- Components ------------------------------------------------------------------------------------------------------------------- */

static void fresnel_is_the_librarys(void **state)
{
    static const float etas[] = { 0.5f, 0.75f, 1.0f, 1.3f, 1.5f, 2.5f };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(etas); i++)
        for (int k = 0; k <= 100; k++) {
            const float c = (float) k / 100.0f;
            float t;
            REQUIRE_NEAR((double) pt_fresnel(etas[i], c, &t), pell_fresnel((double) etas[i], (double) c), 2e-5);
            REQUIRE(t >= 0.0f && t <= 1.0f);
        }
}

/* Single rays against packets. */
static void single_rays_are_packets(void **state)
{
    struct pt_knobs knobs;
    struct stage s;
    struct pt_sampler q = pt_sampler_start(5, 0, 0, 0);
    const struct pell_rays *rays;
    size_t m;
    int hits = 0;

    (void) state;
    busy_stage(&s, &knobs, false, &m);
    stage_method(&s, NULL, NULL);
    stage_render(&s);
    rays = pell_renderer_services(s.r)->rays;
    for (int n = 0; n < 64; n++) {
        struct pell_ray_hit16 p;
        struct pell_ray16 shadow;
        _Alignas(64) int valid[16];
        memset(&p, 0, sizeof(p));
        for (int i = 0; i < 16; i++) {
            valid[i] = -1;
            p.ray.ox[i] = 20.0f * pt_random(&q) - 10.0f;
            p.ray.oy[i] = 20.0f * pt_random(&q) - 10.0f;
            p.ray.oz[i] = 20.0f * pt_random(&q) - 10.0f;
            p.ray.dx[i] = pt_random(&q) - 0.5f;
            p.ray.dy[i] = pt_random(&q) - 0.5f;
            p.ray.dz[i] = pt_random(&q) - 0.5f;
            p.ray.tfar[i] = i % 4 == 0 ? 10.0f : INFINITY;
            p.ray.mask[i] = 1u + (uint32_t) n % 3u;
        }
        shadow = p.ray;
        pell_rays_closest16(rays, valid, false, &p);
        pell_rays_occluded16(rays, valid, false, &shadow);
        for (int i = 0; i < 16; i++) {
            const struct pell_ray ray = { { p.ray.ox[i], p.ray.oy[i], p.ray.oz[i] },
                                          0.0f,
                                          { p.ray.dx[i], p.ray.dy[i], p.ray.dz[i] },
                                          i % 4 == 0 ? 10.0f : INFINITY,
                                          p.ray.mask[i] };
            struct pell_hit hit = { .t = -1.0f };
            const bool hit_found = pell_rays_closest(rays, &ray, &hit);
            assert_int_equal(hit_found, p.hit.mesh[i] != PELL_NO_HIT);
            assert_int_equal(pell_rays_occluded(rays, &ray), hit_found);
            assert_int_equal(shadow.tfar[i] < 0.0f, hit_found);
            hits += hit_found;
            if (!hit_found) {
                REQUIRE(hit.t == -1.0f);
                continue;
            }
            assert_int_equal(hit.mesh, p.hit.mesh[i]);
            REQUIRE_NEAR((double) hit.t, (double) p.ray.tfar[i], 1e-4 * (double) hit.t + 1e-5);
            REQUIRE((hit.ng[0] * p.hit.ngx[i] + hit.ng[1] * p.hit.ngy[i] + hit.ng[2] * p.hit.ngz[i] > 0.0f) ||
                    hit.triangle != p.hit.triangle[i]);
        }
    }
    REQUIRE(hits > 200);
    stage_finish(&s);
}

/* The density of a rough boundary integrates to one, and the samples follow it: frequencies of direction cells. */
static void rough_boundaries_sample_their_density(void **state)
{
    enum { CELLS = 8, TURNS = 8, INTEGRATE = 160 };
    static const struct {
        float alpha, eta, mu;
        int side;
        bool bent;
    } cases[] = {
        { 0.5f, 1.5f, 0.8f, 0, false }, { 0.5f, 1.5f, 0.3f, 1, false }, { 0.9f, 1.3f, 0.2f, 0, false },
        { 0.3f, 1.4f, 0.6f, 1, true },  { 1.0f, 2.0f, 0.9f, 1, true },
    };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        const int samples = FEWER(40000);
        const struct pell_vec3 ng = vec3_normalize(vec3(0.1f, -0.2f, 1.0f));
        const struct pell_vec3 ns = cases[k].bent ? vec3_normalize(vec3_add(ng, vec3(0.25f, 0.1f, 0.0f))) : ng;
        struct pell_vec3 t, b;
        struct pt_sampler s = pt_sampler_start(1, (uint32_t) k, 0, 0);
        double expected[2 * CELLS][TURNS] = { { 0 } }, total = 0.0, worst = 0.0;
        int got[2 * CELLS][TURNS] = { { 0 } };
        struct pt_rough rough;
        struct pt_shading_frame at = { .ns = ns, .ng = ng, .side = cases[k].side };
        const float sine = sqrtf(1.0f - cases[k].mu * cases[k].mu);
        vec3_basis(ng, &t, &b);
        at.o = vec3_add(vec3_mul(t, sine), vec3_mul(ng, cases[k].mu));
        pt_rough_make(cases[k].alpha, cases[k].eta, &rough);
        for (int i = 0; i < 2 * CELLS; i++)
            for (int m = 0; m < INTEGRATE / 8; m++)
                for (int j = 0; j < INTEGRATE; j++) {
                    const double z = -1.0 + (i + (m + 0.5) / (INTEGRATE / 8)) / CELLS, phi = 2.0 * PELL_PI * (j + 0.5) / INTEGRATE;
                    const double r = sqrt(1.0 - z * z);
                    const struct pell_vec3 w = vec3_add(vec3_add(vec3_mul(t, (float) (r * cos(phi))), vec3_mul(b, (float) (r * sin(phi)))),
                                                        vec3_mul(ng, (float) z));
                    expected[i][j * TURNS / INTEGRATE] +=
                        (double) pt_rough_density(&rough, &at, w) * 2.0 * PELL_PI / (CELLS * (INTEGRATE / 8) * INTEGRATE);
                }
        for (int i = 0; i < samples; i++) {
            bool transmitted;
            const struct pell_vec3 w = pt_rough_sample(&rough, &at, &s, &transmitted);
            const double z = (double) vec3_dot(w, ng), phi = atan2((double) vec3_dot(w, b), (double) vec3_dot(w, t));
            const int row = (int) fmin((z + 1.0) * CELLS, 2.0 * CELLS - 1.0),
                      turn = (int) ((phi < 0.0 ? phi + 2.0 * PELL_PI : phi) / (2.0 * PELL_PI) * TURNS);
            REQUIRE((z < 0.0) == transmitted);
            REQUIRE_NEAR((double) vec3_length(w), 1.0, 1e-5);
            got[row][turn < TURNS ? turn : TURNS - 1]++;
        }
        for (int i = 0; i < 2 * CELLS; i++)
            for (int j = 0; j < TURNS; j++) {
                const double p = expected[i][j], share = got[i][j] / (double) samples;
                total += p;
                worst = fmax(worst, (fabs(share - p) - 0.02 * p - 2e-4) / sqrt((p + 1e-4) / samples));
            }
        print_message("# rough boundary, alpha %g, eta %g, mu %g, side %d: the density sums to %.5f, worst cell %.1f sigma\n",
                      (double) cases[k].alpha, (double) cases[k].eta, (double) cases[k].mu, cases[k].side, total, worst);
        REQUIRE_NEAR(total, 1.0, 0.006);
        REQUIRE(worst < 4.5);
    }
}

static void scattered_directions_follow_the_phase_function(void **state)
{
    (void) state;
    for (int k = 0; k < 4; k++) {
        const double g[] = { 0.0, 0.0005, 0.9, -0.6 };
        const int samples = FEWER(40000);
        struct pt_coefficients m = { .hg = true, .gray = true, .alike = true, .isotropic = g[k] == 0.0 };
        struct pt_sampler s = pt_sampler_start(3, (uint32_t) k, 0, 0);
        const struct pell_vec3 w = vec3_normalize(vec3(1, 2, -3));
        double mean = 0.0, square = 0.0, off = 0.0;
        for (int c = 0; c < 3; c++)
            m.g[c] = (float) g[k];
        for (int i = 0; i < samples; i++) {
            struct pell_vec3 v;
            float beta[3] = { 1, 1, 1 }, values[3];
            const float density = pt_phase_sample(&m, w, &s, beta, &v);
            const struct pell_phase phase = { PELL_PHASE_HENYEY_GREENSTEIN, { g[k], 0.0 }, 0.0 };
            pt_phase_values(&m, w, v, values);
            off = fmax(off, fabs((double) density / pell_phase_value(&phase, -(double) vec3_dot(w, v)) - 1.0));
            REQUIRE(values[1] == density && beta[2] == 1.0f);
            mean += (double) vec3_dot(w, v) / samples;
            square += (double) vec3_dot(w, v) * (double) vec3_dot(w, v) / samples;
        }
        REQUIRE_NEAR(mean, g[k], SIGMAS * sqrt((square - mean * mean) / samples) + 1e-4);
        REQUIRE(off < 1e-3);
    }
}

/* --- The white furnace ------------------------------------------------------------------------------------------------------------- */

/* No absorption, and equal radiance from all directions: every sample has this radiance, to rounding, where only paths that hit the
 * environment find light. */
static void white_furnace(void **state)
{
    static const struct {
        const char *name;
        bool rough;
        double eta, g;
        int rings, objects;
    } cases[] = {
        { "smooth", false, 1.3, 0.0, 32, 0 },
        { "matched", false, 1.0, 0.7, 32, 0 },
        { "rough", true, 1.5, 0.0, 32, 0 },
        { "smooth, coarse", false, 1.5, 0.5, 5, 0 },
        { "rough, coarse", true, 1.5, 0.0, 5, 0 },
        { "nested", false, 1.3, 0.0, 24, 1 },
        { "nested, rough", true, 1.3, 0.0, 24, 1 },
        { "bone", false, 1.4, 0.0, 24, 2 },
        { "beside something white", false, 1.4, 0.0, 24, 3 },
        { "rough, beside something white", true, 1.4, 0.0, 24, 3 },
    };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++)
        for (int all = 0; all < 2; all++) {
            struct stage s;
            struct pt_knobs knobs = rig_knobs();
            size_t m;
            struct pt_scene *scene;
            struct pt_point at;
            struct rig_mean r;
            size_t index;

            plain_stage(&s);
            m = rig_medium(&s, 0.7, 0.0, cases[k].g, cases[k].eta);
            for (int c = 0; all && c < 3; c++) /* samples of differing channels are weighted */
                s.scene->materials[m].medium.sigma_s_reduced[c] *= 1.0 + c;
            s.scene->materials[m].roughness = 0.6f;
            stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, cases[k].rings);
            if (cases[k].objects == 1) {
                index = rig_medium(&s, 2.0, 0.0, 0.3, 1.7);
                s.scene->materials[index].roughness = 0.6f;
                stage_ball(&s, index, 1, vec3(0.3f, 0.5f, 0.5f), 1.5f, cases[k].rings);
            } else if (cases[k].objects == 2) {
                stage_opaque(&s, 1.0f, &index);
                stage_ball(&s, index, 1, vec3(0.3f, 0.5f, 0.5f), 1.5f, cases[k].rings);
            } else if (cases[k].objects == 3) {
                stage_opaque(&s, 1.0f, &index);
                stage_ball(&s, index, 1, vec3(5.3f, 0.5f, 1.5f), 2.0f, cases[k].rings);
            }
            stage_environment(&s, 1.0f);
            look_along(&s, 7.0f);
            knobs.boundary = cases[k].rough ? PT_BOUNDARY_ROUGH : PT_BOUNDARY_SMOOTH;
            knobs.techniques = all ? PT_ALL : PT_HIT_LIGHTS;
            scene = rig_scene(&s, &knobs);
            at = on_ball(&s, 3.0f, 1.0f, 0.7f);
            r = rig_measure(scene, &at, 0, FEWER(all ? 500 : 300));
            print_message("# furnace, %s, %s: %.5f +- %.5f (single %.4f, surface %.4f)\n", cases[k].name, all ? "all" : "walks alone",
                          r.mean[3][1], r.error[3][1], r.mean[1][1], r.mean[2][1]);
            REQUIRE(r.counts.cut == 0);
            for (int c = 0; c < 3; c++)
                REQUIRE_NEAR(r.mean[3][c], 1.0, SIGMAS * r.error[3][c] + (all ? 1e-3 : 2e-5));
            /* The same for every single sample, except where surface reflection is selected at random. */
            if (!all && cases[k].objects != 3)
                REQUIRE(r.error[3][1] < 1e-5);
            pt_scene_destroy(&scene);
            stage_finish(&s);
        }
}

/* --- Slabs --------------------------------------------------------------------------------------------------------------------------- */

/* Diffuse reflectance (`back`) or transmittance of light at normal incidence, by reciprocity: a wide slab under a uniform environment
 * whose other half is hidden by black. */
static struct rig_mean slab_of_parts(int parts, const double sigma_s[3], const double sigma_a[3], double g, double eta, double thickness,
                                     bool back, int samples, unsigned techniques)
{
    const float wide = (float) fmax(400.0 * thickness, 40.0 / (sigma_s[0] * (1.0 - g) + sigma_a[0])), d = (float) thickness;
    struct stage s;
    struct pt_knobs knobs = rig_knobs();
    size_t m;
    struct pt_scene *scene;
    struct pt_point at;
    struct rig_mean r;
    size_t black;

    plain_stage(&s);
    m = rig_medium(&s, 1.0, 0.0, g, eta);
    for (int c = 0; c < 3; c++) {
        s.scene->materials[m].medium.sigma_s_reduced[c] = sigma_s[c] * (1.0 - g);
        s.scene->materials[m].medium.sigma_a[c] = sigma_a[c];
    }
    stage_opaque(&s, 0.0f, &black);
    for (int i = 0; i < parts; i++)
        stage_box(&s, m, 0, vec3(-wide, -wide, -d * (float) (i + 1) / (float) parts), vec3(wide, wide, -d * (float) i / (float) parts));
    if (back)
        stage_box(&s, black, 1, vec3(-9 * wide, -9 * wide, -3 * d), vec3(9 * wide, 9 * wide, -2 * d));
    else
        stage_box(&s, black, 1, vec3(-9 * wide, -9 * wide, d), vec3(9 * wide, 9 * wide, 2 * d));
    stage_environment(&s, 1.0f);
    look_along(&s, 7.0f);
    knobs.techniques = techniques;
    scene = rig_scene(&s, &knobs);
    at = rig_point(vec3(0.013f, 0.007f, 0.0f), vec3(0.013f, 0.007f, 500.0f), 5);
    r = rig_measure(scene, &at, 0, samples);
    for (int k = 0; k < 4; k++)
        for (int c = 0; c < 3; c++) { /* relative to the light that entered */
            const double in = 1.0 - pell_fresnel(eta, 1.0);
            r.mean[k][c] /= in;
            r.error[k][c] /= in;
        }
    pt_scene_destroy(&scene);
    stage_finish(&s);
    return r;
}

static struct rig_mean slab3(const double sigma_s[3], const double sigma_a[3], double g, double eta, double thickness, bool back,
                             int samples, unsigned techniques)
{
    return slab_of_parts(1, sigma_s, sigma_a, g, eta, thickness, back, samples, techniques);
}

static struct rig_mean slab(double sigma_s, double sigma_a, double g, double eta, double thickness, bool back, int samples,
                            unsigned techniques)
{
    const double scatter[3] = { sigma_s, sigma_s, sigma_s }, absorb[3] = { sigma_a, sigma_a, sigma_a };

    return slab3(scatter, absorb, g, eta, thickness, back, samples, techniques);
}

static void require_same(const char *name, const struct rig_mean *a, const struct rig_mean *b, int part)
{
    for (int c = 0; c < 3; c++) {
        const double bar = hypot(a->error[part][c], b->error[part][c]), difference = a->mean[part][c] - b->mean[part][c];
        if (c == 1)
            print_message("# %s: %.5g +- %.2g against %.5g +- %.2g, %.1f sigma\n", name, a->mean[part][c], a->error[part][c],
                          b->mean[part][c], b->error[part][c], bar > 0.0 ? difference / bar : 0.0);
        if (!(fabs(difference) <= SIGMAS * bar + 1e-12))
            fail_msg("%s, channel %d: %g +- %g against %g +- %g", name, c, a->mean[part][c], a->error[part][c], b->mean[part][c],
                     b->error[part][c]);
    }
}

static void require_slab(const char *name, const struct rig_mean *r, double expected, double se, int part)
{
    const double value = part == 0 ? r->mean[0][1] + r->mean[1][1] : r->mean[part][1];
    const double error = part == 0 ? hypot(r->error[0][1], r->error[1][1]) : r->error[part][1];

    print_message("# %s: %.5f +- %.5f, expected %.5f\n", name, value, error, expected);
    REQUIRE_NEAR(value, expected, SIGMAS * hypot(error, se));
}

static void slabs_of_the_oracle(void **state)
{
    json_t *root = oracle_load("montecarlo.json"), *row;
    const int n = FEWER(1500);
    char name[96];
    size_t i;

    (void) state;
    json_array_foreach(oracle_get(root, "slab_totals"), i, row)
    {
        const double alpha = oracle_number(row, "alpha"), tau = oracle_number(row, "optical_thickness"), eta = oracle_number(row, "n");
        const struct rig_mean back = slab(alpha, 1.0 - alpha, 0.0, eta, tau, true, n, PT_HIT_LIGHTS);
        const struct rig_mean transmitted = slab(alpha, 1.0 - alpha, 0.0, eta, tau, false, n, PT_HIT_LIGHTS);
        snprintf(name, sizeof(name), "slab n %g, tau %g, albedo %.4f: R", eta, tau, alpha);
        require_slab(name, &back, oracle_number(row, "mc_R"), oracle_number(row, "mc_R_se"), 0);
        snprintf(name, sizeof(name), "slab n %g, tau %g, albedo %.4f: R of one scattering", eta, tau, alpha);
        require_slab(name, &back, oracle_number(row, "mc_R_single"), oracle_number(row, "mc_R_se"), 1);
        snprintf(name, sizeof(name), "slab n %g, tau %g, albedo %.4f: T", eta, tau, alpha);
        require_slab(name, &transmitted, oracle_number(row, "mc_T"), oracle_number(row, "mc_T_se"), 0);
        if (alpha == 1.0) /* the same walks, and none is lost */
            REQUIRE_NEAR(back.mean[0][1] + back.mean[1][1] + transmitted.mean[0][1] + transmitted.mean[1][1], 1.0, 1e-5);
    }
    json_decref(root);
}

/* One of the oracle's slabs put together from layers that touch: no light is reflected or lost between them. */
static void slabs_of_parts_are_slabs(void **state)
{
    json_t *root = oracle_load("montecarlo.json"), *row = json_array_get(oracle_get(root, "slab_totals"), 3);
    const double alpha = oracle_number(row, "alpha"), tau = oracle_number(row, "optical_thickness"), eta = oracle_number(row, "n");
    const double scatter[3] = { alpha, alpha, alpha }, absorb[3] = { 1.0 - alpha, 1.0 - alpha, 1.0 - alpha };

    (void) state;
    for (int back = 0; back < 2; back++) {
        const struct rig_mean r = slab_of_parts(3, scatter, absorb, 0.0, eta, tau, back, FEWER(3000), PT_HIT_LIGHTS);
        require_slab(back ? "of three parts: R" : "of three parts: T", &r, oracle_number(row, back ? "mc_R" : "mc_T"),
                     oracle_number(row, "mc_R_se"), 0);
        assert_int_equal(r.counts.crossed, 0);
    }
    json_decref(root);
}

/* Three of the oracle's slabs at once, as the channels of one: optical thicknesses from 3 to 12.5. Also with flights split at the
 * boundary, which has less noise. */
static void channels_are_slabs(void **state)
{
    static const int rows[3] = { 5, 3, 0 };
    json_t *root = oracle_load("montecarlo.json"), *list = oracle_get(root, "slab_totals");
    double sigma_s[3], sigma_a[3];

    (void) state;
    for (int c = 0; c < 3; c++) {
        json_t *row = json_array_get(list, (size_t) rows[c]);
        sigma_s[c] = oracle_number(row, "alpha") * oracle_number(row, "optical_thickness");
        sigma_a[c] = oracle_number(row, "optical_thickness") - sigma_s[c];
        REQUIRE_NEAR(oracle_number(row, "n"), 1.4, 1e-9);
    }
    for (int back = 0; back < 2; back++) {
        double whole[2] = { 0.0, 0.0 };
        for (int split = 0; split < 2; split++) {
            const struct rig_mean r =
                slab3(sigma_s, sigma_a, 0.0, 1.4, 1.0, back != 0, FEWER(10000), PT_HIT_LIGHTS | (split ? PT_SPLIT : 0u));
            for (int c = 0; c < 3; c++) {
                json_t *row = json_array_get(list, (size_t) rows[c]);
                const double value = r.mean[0][c] + r.mean[1][c], error = hypot(r.error[0][c], r.error[1][c]);
                const double expected = oracle_number(row, back ? "mc_R" : "mc_T");
                print_message("# channel %d%s: %c %.5f +- %.5f, expected %.5f\n", c, split ? ", split" : "", back ? 'R' : 'T', value, error,
                              expected);
                REQUIRE_NEAR(value, expected, SIGMAS * error);
                REQUIRE(SLOW || error < 0.1 * expected);
                whole[split] += error * error;
            }
        }
        REQUIRE(SLOW || whole[1] < 0.75 * whole[0]);
    }
    json_decref(root);
}

/* Reflectance and transmittance sum to one: without absorption all light leaves, for forward scattering and any index, and on both sides
 * of a slab the result equals that of the plain walk. */
static void split_walks_are_whole(void **state)
{
    static const struct {
        double g, eta, thickness;
    } cases[] = { { 0.0, 1.4, 1.0 }, { 0.7, 1.4, 2.0 }, { 0.0, 1.0, 0.5 }, { 0.0, 0.8, 1.0 } };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        const double sigma_s[3] = { 0.5, 2.0, 8.0 }, sigma_a[3] = { 0.0, 0.0, 0.0 };
        struct rig_mean r[2][2];
        for (int back = 0; back < 2; back++)
            for (int split = 0; split < 2; split++)
                r[back][split] = slab3(sigma_s, sigma_a, cases[k].g, cases[k].eta, cases[k].thickness, back != 0, FEWER(3000),
                                       PT_HIT_LIGHTS | (split ? PT_SPLIT : 0u));
        for (int c = 0; c < 3; c++) {
            double sum = 0.0, error = 0.0;
            for (int back = 0; back < 2; back++)
                for (int part = 0; part < 2; part++) {
                    sum += r[back][1].mean[part][c];
                    error = hypot(error, r[back][1].error[part][c]);
                }
            print_message("# g %g, index %g, channel %d: R + T %.5f +- %.5f\n", cases[k].g, cases[k].eta, c, sum, error);
            REQUIRE_NEAR(sum, 1.0, SIGMAS * error);
        }
        for (int part = 0; part < 2; part++) {
            require_same("split against plain, T", &r[0][1], &r[0][0], part);
            require_same("split against plain, R", &r[1][1], &r[1][0], part);
        }
    }
}

/* van de Hulst's slab (g 0.75, no boundary) and Giovanelli's half-space (index 1.5), Chandrasekhar's (matched). */
static void slabs_of_the_literature(void **state)
{
    const int n = FEWER(4000);
    const struct rig_mean back = slab(9.0, 1.0, 0.75, 1.0, 0.2, true, n, PT_HIT_LIGHTS);
    const struct rig_mean transmitted = slab(9.0, 1.0, 0.75, 1.0, 0.2, false, n, PT_HIT_LIGHTS);
    const struct rig_mean deep = slab(9.0, 1.0, 0.0, 1.5, 3.0, true, n, PT_HIT_LIGHTS);
    const struct rig_mean matched = slab(0.3, 0.7, 0.0, 1.0, 25.0, true, n, PT_HIT_LIGHTS);

    (void) state;
    require_slab("van de Hulst, R", &back, 0.09739, 1e-5, 0);
    require_slab("van de Hulst, T", &transmitted, 0.66096, 1e-5, 0);
    require_slab("Giovanelli, R of what entered", &deep, 0.2289645, 6e-5, 0);
    require_slab("Chandrasekhar, albedo 0.3", &matched, 0.0572143506, 1e-8, 0);
}

/* --- The grid, and reproducibility of samples ------------------------------------------------------------------------------------- */

/* A scene with all features: a ball of chromatic medium with g, a bone, a white wall, a point light and a rectangle. */
static void busy_stage(struct stage *s, struct pt_knobs *knobs, bool rough, size_t *material)
{
    struct pell_light *l;
    size_t bone, wall;

    plain_stage(s);
    *material = rig_medium(s, 3.0, 0.05, 0.3, 1.4);
    for (int c = 0; c < 3; c++) {
        s->scene->materials[*material].medium.sigma_s_reduced[c] *= 1.0 + 0.5 * c;
        s->scene->materials[*material].medium.sigma_a[c] *= 1.0 + 4.0 * c;
    }
    s->scene->materials[*material].roughness = 0.5f;
    stage_opaque(s, 0.8f, &bone);
    stage_opaque(s, 0.5f, &wall);
    stage_ball(s, *material, 0, vec3(0, 0, 0), 4.0f, 24);
    stage_ball(s, bone, 1, vec3(0, 0, 0), 1.5f, 16);
    stage_box(s, wall, 2, vec3(-30, -30, -12), vec3(30, 30, -10));
    stage_light(s, PELL_LIGHT_POINT, vec3(10, 15, 20), vec3(0, 0, 0), 0.001f);
    l = stage_light(s, PELL_LIGHT_RECT, vec3(-20, 10, 15), vec3(0, 0, 0), 3.0f);
    l->width = l->height = 8.0f;
    look_along(s, 9.0f);
    *knobs = rig_knobs();
    knobs->boundary = rough ? PT_BOUNDARY_ROUGH : PT_BOUNDARY_SMOOTH;
    knobs->acceleration = PT_ACCELERATION_GRID;
}

/* Equal random numbers give equal walks. Which scattering events sample lights depends on the grid: with it the means agree. */
static void grid_is_the_plain_walk(void **state)
{
    const int samples = FEWER(800);
    struct pt_knobs knobs;
    struct stage s;
    struct pt_scene *scene[2];
    struct pt_walker *w[2];
    struct pt_point at;
    struct rig_mean r[2];
    int same = 0;
    size_t m;

    (void) state;
    for (int all = 0; all < 2; all++) {
        busy_stage(&s, &knobs, all == 1, &m);
        knobs.techniques = all ? PT_ALL : PT_HIT_LIGHTS | PT_LIGHT_SAMPLES;
        for (int k = 0; k < 2; k++) {
            knobs.acceleration = k == 0 ? PT_ACCELERATION_GRID : PT_ACCELERATION_NONE;
            scene[k] = rig_scene(&s, &knobs);
            OK(pt_walker_create(scene[k], &w[k]));
        }
        at = on_ball(&s, 4.0f, 0.5f, 0.7f);
        for (int i = 0; i < samples && !all; i++) {
            struct pt_light x, y;
            pt_trace(scene[0], w[0], &at, (uint32_t) i, 1, &x);
            pt_trace(scene[1], w[1], &at, (uint32_t) i, 1, &y);
            same += fabs(x.multiple[1] - y.multiple[1]) <= 1e-3 * (fabs(x.multiple[1]) + 1e-6);
        }
        if (!all) {
            const struct pt_counts *grid = pt_walker_counts(w[0]), *plain = pt_walker_counts(w[1]);
            print_message("# grid against plain: %d of %d samples the same; %.1f of %.1f scatterings needed no ray\n", same, samples,
                          (double) grid->steps_without_ray / samples, (double) grid->scatterings / samples);
            REQUIRE(same > samples * 98 / 100);
            REQUIRE(plain->steps_without_ray == 0 && grid->steps_without_ray > 0);
        } else {
            r[0] = rig_measure(scene[0], &at, 0, 2 * samples);
            r[1] = rig_measure(scene[1], &at, 100000, 2 * samples);
            require_same("grid against plain, other numbers", &r[0], &r[1], 0);
            require_same("grid against plain, one scattering", &r[0], &r[1], 1);
        }
        for (int k = 0; k < 2; k++) {
            pt_walker_destroy(&w[k]);
            pt_scene_destroy(&scene[k]);
        }
        stage_finish(&s);
    }
}

/* Wavefront walks equal scalar walks to the last bit, at every SIMD level: with equal and different channels, forward scattering,
 * absorption, nested solids, lights of all kinds. */
static void lanes_are_the_plain_walk(void **state)
{
    enum { N = SLOW ? 40 : 300 };
    static struct pt_light plain[N], lanes[N];
    static struct pt_job jobs[2 * N];

    (void) state;
    for (int kind = 0; kind < 4; kind++) {
        struct pt_knobs knobs;
        struct pt_scene *scene[2];
        struct pt_walker *w;
        struct pt_point at, other;
        struct stage s;
        size_t m;

        busy_stage(&s, &knobs, kind == 1, &m);
        for (int c = 0; kind >= 2 && c < 3; c++) {
            s.scene->materials[m].medium.g[c] = kind == 2 ? 0.5 : 0.3 * c;
            s.scene->materials[m].medium.sigma_a[c] = 0.05 * c;
        }
        for (int k = 0; k < 2; k++) {
            knobs.acceleration = k == 0 ? PT_ACCELERATION_NONE : PT_ACCELERATION_LANES;
            scene[k] = rig_scene(&s, &knobs);
        }
        at = on_ball(&s, 4.0f, 0.5f, 0.7f);
        other = on_ball(&s, 4.0f, -0.5f, 0.2f);
        other.pixel = 8;
        OK(pt_walker_create(scene[0], &w));
        pt_trace(scene[0], w, &at, 5, N, plain);
        pt_walker_destroy(&w);
        for (int level = 0; level < 4; level++) {
            static const char *const names[] = { "base", "v2", "v3", "v4" };
            setenv("PELL_SIMD", names[level], 1);
            OK(pt_walker_create(scene[1], &w));
            unsetenv("PELL_SIMD");
            pt_trace(scene[1], w, &at, 5, N, lanes);
            assert_memory_equal(plain, lanes, sizeof(plain));
            for (int i = 0; i < 2 * N; i++) /* among others */
                jobs[i] = (struct pt_job) { .point = i % 2 ? &at : &other, .sample = 5u + (uint32_t) (i / 2) };
            pt_trace_jobs(scene[1], w, jobs, 2 * N);
            for (int i = 0; i < N; i++)
                assert_memory_equal(&plain[i], &jobs[2 * i + 1].light, sizeof(plain[i]));
            pt_walker_destroy(&w);
        }
        for (int k = 0; k < 2; k++)
            pt_scene_destroy(&scene[k]);
        stage_finish(&s);
    }
}

static void a_sample_depends_on_its_numbers_alone(void **state)
{
    enum { N = 24 };
    struct pt_light together[N], one, twice;
    struct pt_knobs knobs;
    size_t m;
    struct stage s;
    struct pt_scene *scene;
    struct pt_point at, other;
    struct pt_walker *a, *b;

    (void) state;
    busy_stage(&s, &knobs, false, &m);
    knobs.acceleration = PT_ACCELERATION_NONE;
    scene = rig_scene(&s, &knobs);
    at = on_ball(&s, 4.0f, 0.5f, 0.7f);
    other = on_ball(&s, 4.0f, -0.5f, 0.2f);
    other.pixel = 8;
    OK(pt_walker_create(scene, &a));
    OK(pt_walker_create(scene, &b));
    pt_trace(scene, a, &at, 3, N, together);
    for (int i = N - 1; i >= 0; i--) {
        pt_trace(scene, b, &other, (uint32_t) i, 1, &one); /* disturbs the state of the walker */
        pt_trace(scene, b, &at, 3u + (uint32_t) i, 1, &one);
        assert_memory_equal(&one, &together[i], sizeof(one));
    }
    pt_trace(scene, a, &at, 3, 1, &twice);
    assert_memory_equal(&twice, &together[0], sizeof(twice));
    pt_walker_destroy(&a);
    pt_walker_destroy(&b);
    pt_scene_destroy(&scene);
    stage_finish(&s);
}

/* --- Light sampling techniques -------------------------------------------------------------------------------------------------------- */

static struct rig_mean with_techniques(struct stage *s, struct pt_knobs knobs, unsigned techniques, const struct pt_point *at,
                                       uint32_t first, int samples)
{
    struct pt_scene *scene;
    struct rig_mean r;

    knobs.techniques = techniques;
    scene = rig_scene(s, &knobs);
    r = rig_measure(scene, at, first, samples);
    pt_scene_destroy(&scene);
    return r;
}

/* A ball under one light. */
static void lit_ball(struct stage *s, struct pt_knobs *knobs, bool rough, double sigma, double sigma_a, enum pell_light_type type,
                     float size, int rings)
{
    size_t m;
    struct pell_light *l;

    plain_stage(s);
    m = rig_medium(s, sigma, sigma_a, 0.0, 1.4);
    s->scene->materials[m].roughness = 0.6f;
    s->scene->materials[m].medium.sigma_a[2] *= 8.0;
    stage_ball(s, m, 0, vec3(0, 0, 0), 4.0f, rings);
    l = stage_light(s, type, vec3(8, 10, 16), vec3(0, 0, 0), type == PELL_LIGHT_POINT ? 0.001f : 1.0f);
    l->width = l->height = size;
    if (type == PELL_LIGHT_RECT)
        for (int c = 0; c < 3; c++) /* the point light's intensity on the axis */
            l->power[c] = 0.001f * 1e6f / (size * size);
    look_along(s, 9.0f);
    *knobs = rig_knobs();
    knobs->boundary = rough ? PT_BOUNDARY_ROUGH : PT_BOUNDARY_SMOOTH;
}

/* A large light: paths hit it at random, or it is sampled explicitly, or both by MIS. Includes coarse balls, whose interpolated normals
 * differ strongly from the triangles'. */
static void every_complete_set_agrees(void **state)
{
    static const struct {
        bool rough;
        int rings;
        int normals;
    } cases[] = {
        { false, 24, PT_NORMALS_SMOOTH }, { false, 7, PT_NORMALS_SMOOTH }, { false, 7, PT_NORMALS_FLAT },
        { true, 24, PT_NORMALS_SMOOTH },  { true, 7, PT_NORMALS_SMOOTH },
    };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        struct pt_knobs knobs;
        struct stage s;
        struct pt_point at;
        struct rig_mean chance, sought, all;
        char name[96];

        lit_ball(&s, &knobs, cases[k].rough, 1.0, 0.02, PELL_LIGHT_RECT, 24.0f, cases[k].rings);
        knobs.normals = cases[k].normals;
        stage_render(&s);
        at = on_ball(&s, 4.0f, 0.9f, 0.4f);
        chance = with_techniques(&s, knobs, PT_HIT_LIGHTS, &at, 0, FEWER(8000));
        all = with_techniques(&s, knobs, PT_ALL, &at, 500000, FEWER(1200));
        sought = with_techniques(&s, knobs, PT_ALL & ~(unsigned) PT_HIT_LIGHTS, &at, 700000, FEWER(1200));
        for (int part = 0; part < 2; part++) {
            snprintf(name, sizeof(name), "%s, %d rings, normals %d, part %d: all against chance", cases[k].rough ? "rough" : "smooth",
                     cases[k].rings, cases[k].normals, part);
            require_same(name, &all, &chance, part);
        }
        /* Explicit sampling alone lacks light that was reflected inside a smooth solid before it scattered: a small loss. */
        if (cases[k].rough)
            require_same("sought alone against chance", &sought, &chance, 1);
        REQUIRE(sought.mean[1][1] <= chance.mean[1][1] + SIGMAS * hypot(sought.error[1][1], chance.error[1][1]));
        if (cases[k].rough) {
            const struct rig_mean surfaces = with_techniques(&s, knobs, PT_HIT_LIGHTS | PT_LIGHT_SAMPLES, &at, 900000, FEWER(4000));
            require_same("rough, light samples at the boundary against near connections", &surfaces, &all, 0);
            require_same("rough, the surface's own", &surfaces, &all, 2);
        }
        stage_finish(&s);
    }
}

/* A small rectangle with the point light's intensity equals the point light, for every technique. */
static void small_lights_are_points(void **state)
{
    (void) state;
    for (int rough = 0; rough < 2; rough++) {
        struct pt_knobs knobs;
        struct stage point, small;
        struct pt_point at;
        struct rig_mean a, b;

        lit_ball(&point, &knobs, rough, 2.0, 0.02, PELL_LIGHT_POINT, 0.0f, 24);
        lit_ball(&small, &knobs, rough, 2.0, 0.02, PELL_LIGHT_RECT, 0.05f, 24);
        stage_render(&point);
        at = on_ball(&point, 4.0f, 0.9f, 0.4f);
        a = with_techniques(&point, knobs, PT_ALL, &at, 0, FEWER(1500));
        b = with_techniques(&small, knobs, PT_ALL, &at, 0, FEWER(1500));
        print_message("# relative variance of a sample under a point, %s: %.2f, %.2f\n", rough ? "rough" : "smooth", a.variance[0][1],
                      a.variance[1][1]);
        require_same("point against small rectangle, many scatterings", &a, &b, 0);
        require_same("point against small rectangle, one scattering", &a, &b, 1);
        stage_finish(&point);
        stage_finish(&small);
    }
}

/* Under a point light, connections and light paths share the contribution by MIS; without connections the light paths find all of it
 * except single scattering. */
static void paths_from_lights_are_connections(void **state)
{
    struct pt_knobs knobs;
    struct stage s;
    struct rig_mean all, sources, connections;
    struct pt_point at;

    (void) state;
    lit_ball(&s, &knobs, false, 0.2, 0.01, PELL_LIGHT_POINT, 0.0f, 32);
    stage_render(&s);
    at = on_ball(&s, 4.0f, 0.9f, 0.4f);
    all = with_techniques(&s, knobs, PT_ALL & ~(unsigned) PT_SPECULAR_MANIFOLD, &at, 0, FEWER(3000));
    sources = with_techniques(&s, knobs, PT_ALL & ~(unsigned) (PT_CONNECT | PT_SPECULAR_MANIFOLD), &at, 0, FEWER(12000));
    connections = with_techniques(&s, knobs, PT_ALL & ~(unsigned) (PT_LIGHT_PATHS | PT_SPECULAR_MANIFOLD), &at, 0, FEWER(3000));
    print_message("# of the light that scattered more than once %.2f %% was reflected before\n",
                  100.0 * (1.0 - connections.mean[0][1] / all.mean[0][1]));
    require_same("light paths against connections", &sources, &all, 0);
    REQUIRE(sources.mean[1][1] == 0.0);
    assert_int_equal(s.kept.warnings, 0);
    REQUIRE(with_techniques(&s, knobs, PT_HIT_LIGHTS | PT_LIGHT_SAMPLES, &at, 0, 10).mean[0][1] == 0.0);
    assert_int_equal(s.kept.warnings, 1); /* black, and a warning says so */
    REQUIRE(all.mean[1][1] == connections.mean[1][1]);
    REQUIRE(SLOW || connections.mean[0][1] < all.mean[0][1]);
    stage_finish(&s);
}

/* --- Layers --------------------------------------------------------------------------------------------------------------------------- */

/* A layer over a deep substrate by the distance below the surface, against two boxes, one upon the other, without a boundary between
 * them: two implementations that have no code in common except collisions. Stacks come from presets: the boxes use the presets'
 * coefficients. */
static void layers_are_boxes(void **state)
{
    const struct pell_material_entry *entry = pell_material_find("skin-2layer");
    const int n = FEWER(4000);
    struct rig_mean r[2];

    (void) state;
    assert_non_null(entry);
    assert_int_equal(entry->layers.count, 2);
    for (int boxes = 0; boxes < 2; boxes++) {
        const float wide = 400.0f, deep = 300.0f, top = (float) entry->layers.item[0].thickness_mm;
        struct pt_knobs knobs = rig_knobs();
        struct pt_scene *scene;
        struct pt_point at;
        struct stage s;
        size_t m, under;

        plain_stage(&s);
        stage_medium(&s, "skin-2layer", &m);
        if (boxes) {
            stage_medium(&s, "marble", &m);
            stage_medium(&s, "marble", &under);
            s.scene->materials[m].medium = entry->layers.item[0].medium;
            s.scene->materials[under].medium = entry->layers.item[1].medium;
            s.scene->materials[under].medium.eta = s.scene->materials[m].medium.eta;
            stage_box(&s, m, 0, vec3(-wide, -wide, -deep - 1.0f), vec3(wide, wide, 0.0f));
            stage_box(&s, under, 1, vec3(-wide + 1.0f, -wide + 1.0f, -deep), vec3(wide - 1.0f, wide - 1.0f, -top));
        } else {
            stage_box(&s, m, 0, vec3(-wide, -wide, -deep), vec3(wide, wide, 0.0f));
        }
        stage_environment(&s, 1.0f);
        look_along(&s, 7.0f);
        knobs.acceleration = PT_ACCELERATION_NONE;
        knobs.techniques = PT_HIT_LIGHTS;
        scene = rig_scene(&s, &knobs);
        at = rig_point(vec3(0.013f, 0.007f, 0.0f), vec3(0.013f, 0.007f, 500.0f), 5);
        r[boxes] = rig_measure(scene, &at, boxes ? 300000 : 0, n);
        pt_scene_destroy(&scene);
        stage_finish(&s);
    }
    require_same("layers against boxes, many scatterings", &r[0], &r[1], 0);
    require_same("layers against boxes, one scattering", &r[0], &r[1], 1);
}

static const double painted_optics[3][3] = { { 2.0, 2.6, 0.25 }, { 6.0, 6.6, 0.4 }, { 1.0, 1.5, 0.8 } };

/* A slab with layers, lit by the environment and a light, at a point. kind 0: uniform; 1: painted, with another value far from the
 * point. */
static struct rig_mean layered_slab(int kind, int count, const float *depth, enum pell_substrate substrate, double eta, uint32_t first,
                                    int n)
{
    struct pt_knobs knobs = rig_knobs();
    struct rig_mean r;
    struct pt_scene *scene;
    struct pt_point at;
    struct stage s;
    size_t m = 0;

    plain_stage(&s);
    stage_medium(&s, "marble", &m);
    s.scene->materials[m].medium.eta = eta;
    layers_set(s.scene, m, count, painted_optics, depth, substrate);
    stage_box(&s, m, 0, vec3(-400.0f, -400.0f, -300.0f), vec3(400.0f, 400.0f, 0.0f));
    layers_unwrap(s.scene);
    for (int i = 0; kind == 1 && i < count; i++)
        layers_paint(s.scene, m, i, 2, 2, 1, (const float[4]) { 1.0f, 1.0f, 1.0f, 0.25f })->nearest = true;
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.0f, 0.6f, 0.8f), vec3(0, 0, 0), 1.0f);
    look_along(&s, 7.0f);
    knobs.acceleration =
        kind == 1 && substrate == PELL_SUBSTRATE_STOP ? PT_ACCELERATION_GRID : PT_ACCELERATION_NONE; /* large grids take time */
    scene = rig_scene(&s, &knobs);
    at = rig_point(vec3(-20.013f, -10.007f, 0.0f), vec3(-20.013f, -10.007f, 500.0f), 5);
    r = rig_measure(scene, &at, first, n);
    pt_scene_destroy(&scene);
    stage_finish(&s);
    return r;
}

/* A uniform map: the same walks. */
static void painted_layers_are_uniform_ones(void **state)
{
    static const float depth[3] = { 0.5f, 1.0f, 3.0f };
    const struct rig_mean a = layered_slab(0, 3, depth, PELL_SUBSTRATE_LAST, 1.3, 0, FEWER(400));
    const struct rig_mean b = layered_slab(1, 3, depth, PELL_SUBSTRATE_LAST, 1.3, 0, FEWER(400));
    (void) state;

    REQUIRE(a.mean[0][1] > 0.0 && a.mean[1][1] > 0.0);
    for (int part = 0; part < 4; part++)
        for (int c = 0; c < 3; c++)
            REQUIRE(a.mean[part][c] == b.mean[part][c]);
}

/* Black below the layers: against single scattering between matched indices in closed form, and against a solid of one medium with a
 * black object in it. */
static void what_is_below_is_black(void **state)
{
    static const float depth[3] = { 0.5f, 1.0f, 3.0f };
    const int n = FEWER(8000);
    double expected = 0.0, optical = 0.0;
    struct rig_mean r[2];
    (void) state;

    for (int i = 0; i < 3; i++) { /* irradiance 1 across the beam, incident at a cosine of 0.8, viewed at 1 */
        const struct pell_phase phase = { PELL_PHASE_SCHLICK, { painted_optics[i][2], 0.0 }, 0.0 };
        const double d = (double) depth[i] - (i > 0 ? (double) depth[i - 1] : 0.0), length = 1.0 + 1.0 / 0.8;
        expected += painted_optics[i][0] / painted_optics[i][1] * pell_phase_value(&phase, 0.8) * exp(-optical * length) *
                    -expm1(-painted_optics[i][1] * d * length) / length;
        optical += painted_optics[i][1] * d;
    }
    for (int kind = 0; kind < 2; kind++) {
        r[kind] = layered_slab(kind, 3, depth, PELL_SUBSTRATE_STOP, 1.0, 0, n);
        print_message("# %s layers over black: %.5g +- %.2g, expected %.5g\n", kind ? "painted" : "even", r[kind].mean[1][1],
                      r[kind].error[1][1], expected);
        REQUIRE_NEAR(r[kind].mean[1][1], expected, 4.0 * r[kind].error[1][1] + 1e-9);
        REQUIRE(r[kind].error[1][1] < (SLOW ? 0.1 : 0.03) * expected);
        assert_int_equal(r[kind].counts.lost, 0);
    }
    r[0] = layered_slab(0, 1, &depth[1], PELL_SUBSTRATE_STOP, 1.3, 0, n);
    {
        struct pt_knobs knobs = rig_knobs();
        struct pt_scene *scene;
        struct pt_point at;
        struct stage s;
        size_t m, black;
        plain_stage(&s);
        stage_medium(&s, "marble", &m);
        s.scene->materials[m].medium.eta = 1.3;
        layers_set(s.scene, m, 1, painted_optics, &depth[1], PELL_SUBSTRATE_LAST);
        stage_opaque(&s, 0.0f, &black);
        stage_box(&s, m, 0, vec3(-400.0f, -400.0f, -300.0f), vec3(400.0f, 400.0f, 0.0f));
        stage_box(&s, black, 1, vec3(-399.0f, -399.0f, -299.0f), vec3(399.0f, 399.0f, -depth[1]));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.0f, 0.6f, 0.8f), vec3(0, 0, 0), 1.0f);
        look_along(&s, 7.0f);
        scene = rig_scene(&s, &knobs);
        at = rig_point(vec3(-20.013f, -10.007f, 0.0f), vec3(-20.013f, -10.007f, 500.0f), 5);
        r[1] = rig_measure(scene, &at, 500000, n);
        pt_scene_destroy(&scene);
        stage_finish(&s);
    }
    require_same("a layer that ends against a black box in it, many scatterings", &r[0], &r[1], 0);
    require_same("the same, one scattering", &r[0], &r[1], 1);
}

#define FLOOR 0.6f

/* A slab over a substrate of reflectance FLOOR: its own floor (0; painted: 1) or a box in it (2), lit at a cosine of 0.8; `furnace`: in
 * an environment of 1. */
static struct rig_mean over_floor(int kind, const double (*optics)[3], double eta, bool furnace, float reflects, int n)
{
    static const float depth[2] = { 0.4f, 1.0f };
    struct pt_knobs knobs = rig_knobs();
    struct rig_mean r;
    struct pt_scene *scene;
    struct pt_point at;
    struct stage s;
    size_t m, box;

    plain_stage(&s);
    stage_medium(&s, "marble", &m);
    s.scene->materials[m].medium.eta = eta;
    for (int c = 0; c < 3; c++)
        s.scene->materials[m].base_color[c] = reflects;
    layers_set(s.scene, m, 2, optics, depth, kind == 2 ? PELL_SUBSTRATE_LAST : PELL_SUBSTRATE_SURFACE_COLOR);
    stage_opaque(&s, reflects, &box);
    stage_box(&s, m, 0, vec3(-40.0f, -40.0f, -30.0f), vec3(40.0f, 40.0f, 0.0f));
    if (kind == 2)
        stage_box(&s, box, 1, vec3(-39.0f, -39.0f, -29.0f), vec3(39.0f, 39.0f, -depth[1]));
    layers_unwrap(s.scene);
    for (int i = 0; kind == 1 && i < 2; i++)
        layers_paint(s.scene, m, i, 2, 2, 1, (const float[4]) { 1.0f, 1.0f, 1.0f, 1.0f });
    if (furnace)
        stage_environment(&s, 1.0f);
    else
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.0f, 0.6f, 0.8f), vec3(0, 0, 0), 1.0f);
    look_along(&s, 7.0f);
    scene = rig_scene(&s, &knobs);
    at = rig_point(vec3(-2.013f, -1.007f, 0.0f), vec3(-2.013f, -1.007f, 500.0f), 5);
    r = rig_measure(scene, &at, 100000 * kind, n);
    pt_scene_destroy(&scene);
    stage_finish(&s);
    return r;
}

/* A Lambertian surface below layers: in closed form where nothing scatters above it, against a box in the slab, and a white furnace
 * where all is white. */
static void what_is_below_reflects(void **state)
{
    static const double clear[2][3] = { { 0.0, 0.9, 0.0 }, { 0.0, 0.3, 0.0 } }, white[2][3] = { { 1.0, 1.0, 0.3 }, { 0.4, 0.4, 0.0 } };
    static const double dim[2][3] = { { 0.8, 0.9, 0.3 }, { 0.4, 0.5, 0.3 } };
    const double tau = 0.4 * 0.9 + 0.6 * 0.3, expected = (double) FLOOR / PELL_PI * 0.8 * exp(-tau * (1.0 + 1.0 / 0.8));
    struct rig_mean r[3];

    (void) state;
    for (int kind = 0; kind < 2; kind++) {
        r[kind] = over_floor(kind, clear, 1.0, false, FLOOR, FEWER(4000));
        print_message("# a floor below clear layers%s: %.5g +- %.2g, expected %.5g\n", kind ? ", painted" : "", r[kind].mean[0][1],
                      r[kind].error[0][1], expected);
        REQUIRE_NEAR(r[kind].mean[0][1], expected, 4.0 * r[kind].error[0][1] + 1e-9);
        REQUIRE(r[kind].mean[1][1] == 0.0 && r[kind].error[0][1] < (SLOW ? 0.15 : 0.05) * expected);
        r[kind] = over_floor(kind, white, 1.3, true, 1.0f, FEWER(2000));
        for (int c = 0; c < 3; c++) {
            const double sum = r[kind].mean[0][c] + r[kind].mean[1][c] + r[kind].mean[2][c];
            REQUIRE_NEAR(sum, 1.0, 3.5 * hypot(r[kind].error[0][c], hypot(r[kind].error[1][c], r[kind].error[2][c])) + 1e-3);
        }
        assert_int_equal(r[kind].counts.lost, 0);
    }
    for (int kind = 0; kind < 3; kind++)
        r[kind] = over_floor(kind, dim, 1.3, false, FLOOR, FEWER(6000));
    for (int kind = 0; kind < 2; kind++) {
        require_same("a floor below layers against a box in it, many scatterings", &r[kind], &r[2], 0);
        require_same("the same, one scattering", &r[kind], &r[2], 1);
    }
}

/* --- Hostile surfaces, bounds, refusals ---------------------------------------------------------------------------------------------- */

/* A ball without its lower cap: no hang, no NaN, not black; light leaves where the surface ends. */
static void open_surfaces(void **state)
{
    (void) state;
    for (int grid = 0; grid < 2; grid++) {
        struct stage s;
        struct pt_knobs knobs = rig_knobs();
        struct pt_scene *scene;
        struct pt_point at;
        struct rig_mean r;
        int warnings;
        size_t m;

        plain_stage(&s);
        m = rig_medium(&s, 1.0, 0.0, 0.0, 1.4);
        stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, 16);
        s.scene->meshes[0].num_triangles = s.scene->meshes[0].num_triangles * 3 / 4;
        stage_environment(&s, 1.0f);
        look_along(&s, 7.0f);
        knobs.acceleration = grid ? PT_ACCELERATION_GRID : PT_ACCELERATION_NONE;
        stage_method(&s, NULL, NULL);
        stage_render(&s);
        at = on_ball(&s, 3.0f, 0.4f, 0.3f);
        warnings = s.kept.warnings;
        scene = rig_scene(&s, &knobs);
        assert_int_equal(s.kept.warnings - warnings, 1);
        assert_non_null(strstr(s.kept.last_warning, "the surface is open"));
        r = rig_measure(scene, &at, 0, FEWER(1000));
        print_message("# open ball: %.4f +- %.4f, %lld of %d walks lost\n", r.mean[3][1], r.error[3][1], (long long) r.counts.lost,
                      FEWER(1000));
        REQUIRE_NEAR(r.mean[3][1], 1.0, SIGMAS * r.error[3][1] + 1e-3);
        REQUIRE(r.counts.lost > 0);
        at.toward = vec3_mul(at.toward, -1.0f); /* its inner side, seen through the hole */
        r = rig_measure(scene, &at, 0, FEWER(100));
        assert_int_equal(r.counts.crossed, 0);
        pt_scene_destroy(&scene);
        stage_finish(&s);
    }
}

/* Two intersecting balls of one object, two boxes with a common face: overlaps are counted. Separate or nested solids are not counted. */
static void surfaces_that_cross_are_counted(void **state)
{
    static const struct {
        float distance;
        int object;
        bool box, odd; /* parts of one object are one solid */
    } cases[] = { { 2.0f, 0, false, false }, { 0.0f, 1, true, true }, { 0.1f, 1, true, false }, { 9.0f, 0, false, false } };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        struct pt_knobs knobs = rig_knobs();
        struct pt_scene *scene;
        struct pt_point at;
        struct rig_mean r;
        struct stage s;
        size_t m;

        plain_stage(&s);
        m = rig_medium(&s, 0.5, 0.0, 0.0, 1.4);
        if (cases[k].box) {
            stage_box(&s, m, 0, vec3(-3, -3, -3), vec3(3, 3, 3));
            stage_box(&s, m, cases[k].object, vec3(3 + cases[k].distance, -3, -3), vec3(9, 3, 3));
        } else {
            stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, 16);
            stage_ball(&s, m, cases[k].object, vec3(cases[k].distance, 0, 0), 3.0f, 16);
        }
        stage_environment(&s, 1.0f);
        look_along(&s, 7.0f);
        scene = rig_scene(&s, &knobs);
        at = on_ball(&s, 3.0f, 0.4f, 0.3f);
        r = rig_measure(scene, &at, 0, 200);
        REQUIRE_NEAR(r.mean[3][1], 1.0, SIGMAS * r.error[3][1] + 1e-3); /* no light is lost because of it */
        REQUIRE((r.counts.crossed > 20) == cases[k].odd);
        REQUIRE(cases[k].odd || r.counts.crossed == 0);
        at.toward = vec3_mul(at.toward, -1.0f); /* a camera inside crosses no surface */
        REQUIRE(cases[k].odd || rig_measure(scene, &at, 0, 200).counts.crossed == 0);
        pt_scene_destroy(&scene);
        stage_finish(&s);
    }
}

/* Surfaces of one or two solids that intersect, are nested or coincide, one of them inside out: under lights of all kinds every sample
 * ends, is finite, and some light arrives; wavefront walks give the same. */
static void surfaces_that_cross_are_lit(void **state)
{
    (void) state;
    for (int k = 0; k < 12; k++) {
        const int object = k % 2, form = k / 2 % 3;
        struct pt_knobs knobs = rig_knobs();
        struct rig_mean r[2];
        struct stage s;
        size_t m, other;

        plain_stage(&s);
        m = rig_medium(&s, 0.8, 0.02, 0.0, 1.4);
        other = rig_medium(&s, 0.3, 0.01, 0.0, 1.2);
        for (size_t i = 0; i < 2; i++)
            s.scene->materials[i ? m : other].roughness = 0.5f;
        stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, 12);
        stage_ball(&s, other, object, form == 0 ? vec3(2.0f, 0, 0) : vec3(0, 0, 0), form == 2 ? 1.5f : 3.0f, 12);
        if (form == 2) /* its triangles with opposite winding */
            for (size_t t = 0; t < s.scene->meshes[1].num_triangles; t++) {
                uint32_t *i = s.scene->meshes[1].index + 3 * t, first = i[0];
                i[0] = i[1];
                i[1] = first;
            }
        stage_environment(&s, 0.1f);
        stage_light(&s, PELL_LIGHT_POINT, vec3(5, 5, 12), vec3(0, 0, 0), 0.001f);
        stage_light(&s, PELL_LIGHT_RECT, vec3(-8, 5, 12), vec3(0, 0, 0), 1.0f)->width = 3.0f;
        look_along(&s, 7.0f);
        knobs.boundary = k < 6 ? PT_BOUNDARY_SMOOTH : PT_BOUNDARY_ROUGH;
        for (int lanes = 0; lanes < 2; lanes++) {
            struct pt_scene *scene;
            struct pt_point at;
            knobs.acceleration = lanes ? PT_ACCELERATION_LANES : PT_ACCELERATION_NONE;
            scene = rig_scene(&s, &knobs);
            at = on_ball(&s, 3.0f, 0.7f, 0.3f);
            r[lanes] = rig_measure(scene, &at, 0, FEWER(160)); /* which requires finite values */
            pt_scene_destroy(&scene);
        }
        for (int c = 0; c < 3; c++) {
            REQUIRE(r[0].mean[3][c] > 0.02);
            REQUIRE(r[0].mean[3][c] == r[1].mean[3][c]);
        }
        assert_int_equal(r[0].counts.cut, 0);
        stage_finish(&s);
    }
}

static struct pell_texture *paint(struct stage *s, int width, int height, int channels, const float *number)
{
    const size_t count = (size_t) width * (size_t) height * (size_t) channels;
    struct pell_texture *t;

    OK(pell_scene_add_texture(s->scene, "painting", &t));
    t->image = (struct pell_image) { .width = width, .height = height, .channels = channels, .type = PELL_PIXEL_F32 };
    t->image.pixels = pell_alloc_array(s->scene->ctx, count, sizeof(float));
    assert_non_null(t->image.pixels);
    memcpy(t->image.pixels, number, count * sizeof(float));
    t->nearest = width == 2;
    layers_unwrap(s->scene);
    return t;
}

/* A roughness map of one value equals that value, to the bit; where it varies, including smooth texels, the furnace stays white, with
 * and without explicit light sampling; each point uses its own texel. */
static void roughness_maps_are_read(void **state)
{
    static const float one[1] = { 0.5f }, varied[8] = { 1.0f, 0.1f, 0.6f, 0.0f, 0.3f, 0.9f, 0.02f, 0.7f }, halves[2] = { 0.25f, 1.0f };
    const float *const maps[] = { NULL, one, varied, varied, halves, halves };
    enum { CASES = 6 };
    struct pt_light light[2][40];
    struct rig_mean r[CASES];

    (void) state;
    for (int k = 0; k < CASES; k++) {
        struct pt_knobs knobs = rig_knobs();
        struct pt_scene *scene;
        struct pt_walker *w;
        struct pt_point at;
        struct stage s;
        size_t m;

        plain_stage(&s);
        m = rig_medium(&s, 0.7, k < 4 ? 0.0 : 0.2, 0.0, 1.5);
        s.scene->materials[m].roughness = k == 0 ? 0.4f : 0.8f;
        stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, 16);
        if (maps[k] == halves)
            s.scene->materials[m].roughness_map.texture = paint(&s, 2, 1, 1, halves);
        else if (maps[k])
            s.scene->materials[m].roughness_map.texture = paint(&s, maps[k] == varied ? 4 : 1, maps[k] == varied ? 2 : 1, 1, maps[k]);
        stage_environment(&s, 1.0f);
        if (k == 5) /* one light, reflected in the surface */
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.0f, 0.0f, 1.0f), vec3(0, 0, 0), 1.0f);
        look_along(&s, 7.0f);
        knobs.boundary = PT_BOUNDARY_ROUGH;
        knobs.techniques = k == 2 ? PT_HIT_LIGHTS : PT_ALL;
        scene = rig_scene(&s, &knobs);
        at = on_ball(&s, 3.0f, 0.4f, 0.3f);
        r[k] = rig_measure(scene, &at, 0, FEWER(400));
        if (k < 4)
            REQUIRE_NEAR(r[k].mean[3][1], 1.0, SIGMAS * r[k].error[3][1] + (k == 2 ? 2e-5 : 1e-3));
        if (k < 2) {
            OK(pt_walker_create(scene, &w));
            pt_trace(scene, w, &at, 0, 40, light[k]);
            pt_walker_destroy(&w);
        }
        if (k == 5) { /* the highlight of a point with the roughness of its half of the map */
            const struct pt_point rough = on_ball(&s, 3.0f, 0.06f, 0.03f), shiny = on_ball(&s, 3.0f, -0.06f, 0.03f);
            REQUIRE(rig_measure(scene, &shiny, 0, 40).mean[2][1] > 4.0 * rig_measure(scene, &rough, 0, 40).mean[2][1]);
        }
        pt_scene_destroy(&scene);
        stage_finish(&s);
    }
    assert_memory_equal(light[0], light[1], sizeof(light[0]));
}

/* A point light is found by connections alone, through smooth boundaries and rough ones: a surface that has both is lit like one that is
 * rough everywhere, and costs no more. */
static void smooth_parts_of_a_rough_surface_are_lit(void **state)
{
    static const float both[2] = { 0.0f, 0.6f }, rough[2] = { 0.06f, 0.6f };
    const float *const maps[] = { both, rough };
    struct rig_mean r[2];

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct pt_knobs knobs = rig_knobs();
        struct pt_scene *scene;
        struct pt_point at;
        struct stage s;
        size_t m;

        plain_stage(&s);
        m = rig_medium(&s, 1.0, 0.05, 0.0, 1.4);
        s.scene->materials[m].roughness = 1.0f;
        stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, 16);
        s.scene->materials[m].roughness_map.texture = paint(&s, 2, 1, 1, maps[k]);
        stage_light(&s, PELL_LIGHT_POINT, vec3(10.0f, 15.0f, 20.0f), vec3(0, 0, 0), 1.0f);
        look_along(&s, 7.0f);
        knobs.boundary = PT_BOUNDARY_ROUGH;
        scene = rig_scene(&s, &knobs);
        at = on_ball(&s, 3.0f, 0.7f, 0.3f);
        r[k] = rig_measure(scene, &at, 0, FEWER(4000));
        pt_scene_destroy(&scene);
        stage_finish(&s);
    }
    for (int c = 0; c < 3; c++) {
        REQUIRE_NEAR(r[0].mean[3][c], r[1].mean[3][c], SIGMAS * (r[0].error[3][c] + r[1].error[3][c]) + 0.01 * r[1].mean[3][c]);
        REQUIRE(r[1].mean[3][c] > 0.0 && r[0].error[3][c] < 1.5 * r[1].error[3][c]);
    }
}

/* --- Colours -------------------------------------------------------------------------------------------------------------------------- */

/* Diffuse reflectance of a half-space for diffuse light that entered, of the balls' media. */
static double half_space(const struct pell_medium *m, int c)
{
    const double total = pell_half_space_albedo(m->sigma_s_reduced[c] / (m->sigma_s_reduced[c] + m->sigma_a[c]), m->eta);

    return total * pell_half_space_angle_of(total, m->eta).mean;
}

/* Light scattered in a ball crosses its boundary once in and once out: a uniform base colour is a factor, however it is split between
 * both, and however lights are sampled; surface reflection is not tinted. */
static void a_colour_is_a_factor(void **state)
{
    static const float mixes[] = { 0.0f, 0.3f, 1.0f }, base[3] = { 0.9f, 0.4f, 0.1f };
    static const struct {
        bool rough;
        enum pell_light_type type;
    } cases[] = { { false, PELL_LIGHT_POINT }, { true, PELL_LIGHT_POINT }, { false, PELL_LIGHT_RECT }, { true, PELL_LIGHT_RECT } };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++)
        for (size_t i = 0; i < PELL_COUNT(mixes); i++) {
            struct rig_mean r[2];
            double factor[3];
            for (int tinted = 0; tinted < 2; tinted++) {
                struct pell_material *m;
                struct pt_knobs knobs;
                struct pt_point at;
                struct stage s;
                lit_ball(&s, &knobs, cases[k].rough, 1.0, 0.02, cases[k].type, 6.0f, 24);
                m = &s.scene->materials[0];
                m->color_from = tinted ? PELL_COLOR_FROM_TEXTURE : PELL_COLOR_FROM_PROFILE;
                m->mix = mixes[i];
                for (int c = 0; c < 3; c++) {
                    m->base_color[c] = base[c];
                    factor[c] = (double) base[c] / half_space(&m->medium, c);
                }
                stage_render(&s);
                at = on_ball(&s, 4.0f, 0.9f, 0.4f);
                r[tinted] = with_techniques(&s, knobs, PT_ALL, &at, 0, FEWER(600));
                stage_finish(&s);
            }
            for (int c = 0; c < 3; c++) {
                REQUIRE_REL(r[1].mean[2][c], r[0].mean[2][c], 1e-4);
                for (int part = 0; part < 2; part++)
                    REQUIRE_NEAR(r[1].mean[part][c], factor[c] * r[0].mean[part][c],
                                 SIGMAS * hypot(r[1].error[part][c], factor[c] * r[0].error[part][c]));
            }
        }
}

/* Colours at entry (mix 1) that sum to white give radiance that sums to white's, where half of a ball has one colour and half the other:
 * each point uses its own texel. */
static void colours_are_read_where_light_enters(void **state)
{
    static const float left[6] = { 1.0f, 0.7f, 0.2f, 0.0f, 0.3f, 0.8f }, right[6] = { 0.0f, 0.3f, 0.8f, 1.0f, 0.7f, 0.2f };
    static const float white[6] = { 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f };
    const float *const maps[3] = { white, left, right };

    (void) state;
    for (int rough = 0; rough < 2; rough++) {
        struct rig_mean r[3];
        for (int k = 0; k < 3; k++) {
            struct pt_knobs knobs;
            struct pt_point at;
            struct stage s;
            lit_ball(&s, &knobs, rough, 0.4, 0.01, PELL_LIGHT_POINT, 0.0f, 24);
            s.scene->materials[0].color_from = PELL_COLOR_FROM_TEXTURE;
            s.scene->materials[0].mix = 1.0f;
            s.scene->materials[0].base_color[0] = s.scene->materials[0].base_color[1] = s.scene->materials[0].base_color[2] = 1.0f;
            s.scene->materials[0].base_color_map.texture = paint(&s, 2, 1, 3, maps[k]);
            stage_render(&s);
            at = on_ball(&s, 4.0f, 0.06f, 0.03f);
            r[k] = with_techniques(&s, knobs, PT_ALL, &at, 0, FEWER(1500));
            stage_finish(&s);
        }
        for (int part = 0; part < 2; part++)
            for (int c = 0; c < 3; c++) {
                const double bar = hypot(r[0].error[part][c], hypot(r[1].error[part][c], r[2].error[part][c]));
                REQUIRE_NEAR(r[1].mean[part][c] + r[2].mean[part][c], r[0].mean[part][c], SIGMAS * bar);
                REQUIRE(r[1].mean[part][c] != r[2].mean[part][c]);
            }
    }
}

static void bounds_are_counted(void **state)
{
    struct stage s;
    struct pt_knobs knobs = rig_knobs();
    size_t m;
    struct pt_scene *scene;
    struct pt_point at;
    struct rig_mean r;

    (void) state;
    plain_stage(&s);
    m = rig_medium(&s, 5.0, 0.0, 0.0, 1.4);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, 24);
    stage_environment(&s, 1.0f);
    look_along(&s, 7.0f);
    knobs.events = 10;
    knobs.techniques = PT_HIT_LIGHTS;
    scene = rig_scene(&s, &knobs);
    at = on_ball(&s, 3.0f, 0.4f, 0.3f);
    r = rig_measure(scene, &at, 0, FEWER(2000));
    print_message("# 10 events: %.4f found, %.4f cut\n", r.mean[3][1], r.counts.cut_weight / FEWER(2000));
    REQUIRE(r.counts.cut > 0);
    REQUIRE_NEAR(r.mean[3][1] + r.counts.cut_weight / FEWER(2000), 1.0, 1e-4); /* all losses are accounted for */
    pt_scene_destroy(&scene);
    stage_finish(&s);
}

/* Single scattering of a plate of 0.005 mm of a thin medium, seen from above; `half` mm to each side, rotated about two axes or not. */
static struct rig_mean thin_plate(float half, bool tilted, int samples)
{
    const struct pell_vec3 x = tilted ? vec3_normalize(vec3(0.7f, 0.2f, 0.5f)) : vec3(1, 0, 0);
    const struct pell_vec3 y = tilted ? vec3_normalize(vec3_cross(vec3(0.3f, -0.4f, 0.8f), x)) : vec3(0, 1, 0), z = vec3_cross(x, y);
    struct pt_knobs knobs = rig_knobs();
    struct pell_mesh *mesh;
    struct pt_scene *scene;
    struct pt_point at;
    struct rig_mean r;
    struct stage s;

    plain_stage(&s);
    mesh = shapes_box(s.scene, rig_medium(&s, 20.0, 20.0, 0.0, 1.4), vec3(-half, -half, -0.005f), vec3(half, half, 0.0f));
    mesh->object = 0;
    for (size_t i = 0; i < mesh->num_vertices; i++)
        for (int k = 0; k < 2; k++) {
            float *p = (k ? mesh->normal : mesh->position) + 3 * i;
            vec3_store(vec3_mad(vec3_mad(vec3_mul(x, p[0]), p[1], y), p[2], z), p);
        }
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3_mul(z, 50.0f), vec3(0, 0, 0), 0.5f, 0.0f);
    knobs.techniques = PT_HIT_LIGHTS;
    scene = rig_scene(&s, &knobs);
    at = rig_point(vec3_mad(vec3_mul(x, 0.013f), 0.007f, y), vec3_mad(vec3_mul(z, 50.0f), 0.5f, x), 7);
    r = rig_measure(scene, &at, 0, samples);
    REQUIRE(r.counts.lost + r.counts.crossed <= samples / 1000);
    pt_scene_destroy(&scene);
    stage_finish(&s);
    return r;
}

/* However wide the plate: the offset of ray origins follows from the precision of the point along its normal. */
static void thin_plates_are_slabs(void **state)
{
    const int samples = FEWER(25000);
    const struct rig_mean small = thin_plate(0.5f, false, samples);
    (void) state;

    for (int tilted = 0; tilted < 2; tilted++) {
        const struct rig_mean wide = thin_plate(tilted ? 5.0f : 2000.0f, tilted, samples);
        const double bar = hypot(small.error[1][1], wide.error[1][1]);
        print_message("# plate of 1:%d: %.5f +- %.5f, of 1:200 %.5f, %.1f sigma\n", tilted ? 2000 : 800000, wide.mean[1][1],
                      wide.error[1][1], small.mean[1][1], (wide.mean[1][1] - small.mean[1][1]) / bar);
        REQUIRE_NEAR(wide.mean[1][1], small.mean[1][1], SIGMAS * bar);
    }
}

static void a_profile_alone_has_an_equivalent_medium(void **state)
{
    struct stage s;
    const struct pt_knobs knobs = rig_knobs();
    struct pt_scene *scene;
    size_t m;

    (void) state;
    plain_stage(&s);
    stage_gaussians(&s, 1.0, &m);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, 8);
    stage_environment(&s, 1.0f);
    look_along(&s, 7.0f);
    stage_render(&s);
    assert_int_equal(pt_scene_create(pell_renderer_services(s.r), &knobs, &scene), PELL_OK);
    pt_scene_destroy(&scene);
    stage_finish(&s);
}

static void survives_the_nth_allocation(void **state)
{
    const struct pell_device_params params = { .threads = 1, .engine = PELL_ENGINE_CPU };
    struct pt_knobs knobs = rig_knobs();
    struct pell_alloc_fault fault = { 0 };
    struct pt_scene *scene = NULL;
    enum pell_result res = PELL_ERR_NOMEM;
    struct stage s;
    uint64_t n;
    size_t m;

    (void) state;
    memset(&s, 0, sizeof(s));
    s.ctx = test_context(&fault, &s.kept);
    OK(pell_scene_create(s.ctx, &s.scene));
    OK(pell_device_create(s.ctx, &params, &s.device));
    OK(pell_renderer_create(s.device, &s.r));
    pell_knobs_default(pell_settings_knobs(), &s.settings);
    s.settings.width = s.settings.height = 4;
    s.settings.msaa = 1;
    m = rig_medium(&s, 1.0, 0.1, 0.0, 1.4);
    s.scene->materials[m].roughness = 0.5f;
    layers_set(s.scene, m, 1, painted_optics, (const float[1]) { 1.0f }, PELL_SUBSTRATE_STOP);
    layers_paint(s.scene, m, 0, 2, 1, 1, (const float[2]) { 1.0f, 0.5f });
    stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, 6);
    stage_light(&s, PELL_LIGHT_POINT, vec3(8, 10, 16), vec3(0, 0, 0), 0.001f);
    look_along(&s, 7.0f);
    stage_method(&s, NULL, NULL);
    stage_render(&s);
    knobs.boundary = PT_BOUNDARY_ROUGH;
    knobs.acceleration = PT_ACCELERATION_GRID;
    for (n = 1; res != PELL_OK && n < 1000; n++) {
        const int64_t live = fault.live;
        fault.fail_at = fault.calls + n;
        res = pt_scene_create(pell_renderer_services(s.r), &knobs, &scene);
        fault.fail_at = 0;
        if (res == PELL_OK) {
            struct pt_walker *w;
            fault.fail_at = fault.calls + 1;
            assert_int_equal(pt_walker_create(scene, &w), PELL_ERR_NOMEM);
            fault.fail_at = 0;
            pt_walker_destroy(&w);
            pt_scene_destroy(&scene);
        } else {
            assert_int_equal(res, PELL_ERR_NOMEM);
            assert_null(scene);
        }
        assert_int_equal(fault.live, live);
    }
    print_message("# %d allocations\n", (int) n - 2);
    assert_int_equal(res, PELL_OK);
    REQUIRE(n > 8);
    stage_finish(&s);
    assert_int_equal(fault.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fresnel_is_the_librarys),
        cmocka_unit_test(single_rays_are_packets),
        cmocka_unit_test(rough_boundaries_sample_their_density),
        cmocka_unit_test(scattered_directions_follow_the_phase_function),
        cmocka_unit_test(white_furnace),
        cmocka_unit_test(slabs_of_the_oracle),
        cmocka_unit_test(slabs_of_parts_are_slabs),
        cmocka_unit_test(channels_are_slabs),
        cmocka_unit_test(split_walks_are_whole),
        cmocka_unit_test(slabs_of_the_literature),
        cmocka_unit_test(grid_is_the_plain_walk),
        cmocka_unit_test(lanes_are_the_plain_walk),
        cmocka_unit_test(a_sample_depends_on_its_numbers_alone),
        cmocka_unit_test(every_complete_set_agrees),
        cmocka_unit_test(small_lights_are_points),
        cmocka_unit_test(paths_from_lights_are_connections),
        cmocka_unit_test(layers_are_boxes),
        cmocka_unit_test(painted_layers_are_uniform_ones),
        cmocka_unit_test(what_is_below_is_black),
        cmocka_unit_test(what_is_below_reflects),
        cmocka_unit_test(open_surfaces),
        cmocka_unit_test(surfaces_that_cross_are_counted),
        cmocka_unit_test(surfaces_that_cross_are_lit),
        cmocka_unit_test(roughness_maps_are_read),
        cmocka_unit_test(smooth_parts_of_a_rough_surface_are_lit),
        cmocka_unit_test(a_colour_is_a_factor),
        cmocka_unit_test(colours_are_read_where_light_enters),
        cmocka_unit_test(bounds_are_counted),
        cmocka_unit_test(thin_plates_are_slabs),
        cmocka_unit_test(a_profile_alone_has_an_equivalent_medium),
        cmocka_unit_test(survives_the_nth_allocation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
