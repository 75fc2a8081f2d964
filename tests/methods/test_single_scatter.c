/* SPDX-License-Identifier: MIT
 * test_single_scatter.c - single scattering against closed forms, quadratures and brute-force Monte Carlo. */
#include "layers_rig.h"
#include "random.h"
#include "scenes.h"

#include "methods/single_scatter/single_scatter.h"
#include "render/renderer.h"

/* The contents of the method's state, made by hand: one solid, of material 0. */
struct rig {
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_scene *scene;
    struct pell_pool *pool;
    struct pell_rays *rays;
    struct pell_solids *solids;
    struct pell_connector *connector;
    struct pell_light_sampler *light_sampler;
    struct single_medium medium;
    struct single_layer layer[4]; /* for media made by hand */
    struct single_counts counts;
    struct single_world world;
};

static void rig_start(struct rig *r)
{
    memset(r, 0, sizeof(*r));
    r->ctx = test_context(NULL, &r->kept);
    r->scene = shapes_scene(r->ctx);
    assert_non_null(r->scene);
    OK(pell_pool_create(r->ctx, 1, &r->pool));
    r->medium.eta = 1.4;
    r->medium.layers = 1;
    r->medium.layer = r->layer;
    r->medium.layer[0].bottom = INFINITY;
    for (int c = 0; c < 3; c++) {
        r->medium.layer[0].sigma_s[c] = 0.3 + 0.3 * c;
        r->medium.layer[0].sigma_t[c] = 0.5 + 0.4 * c;
        r->medium.layer[0].phase[c] = (struct pell_phase) { PELL_PHASE_HENYEY_GREENSTEIN, { 0.5 - 0.4 * c, 0.0 }, 0.0 };
    }
}

static void rig_build(struct rig *r, int normals, int refraction, int distance, float error)
{
    static const struct pell_tint tints[4]; /* none */
    static const uint16_t index[8] = { 0, 1 };
    const struct pell_frame_material material = { .medium = { .eta = 1.4 }, .name = "test" };
    const struct pell_load_params bare = { .bare = true };

    if (!r->rays) {
        OK(pell_scene_complete(r->scene, &bare));
        OK(pell_rays_create(r->ctx, r->scene, r->pool, &r->rays));
        OK(pell_solids_create(r->ctx, r->scene, index, &material, &r->solids));
        OK(pell_light_sampler_create(r->ctx, r->scene, &r->light_sampler));
    }
    pell_connector_destroy(&r->connector);
    OK(pell_connector_create(r->ctx, r->scene, r->rays, r->solids, normals == SINGLE_FLAT, &r->connector));
    r->world = (struct single_world) {
        .ctx = r->ctx,
        .scene = r->scene,
        .rays = r->rays,
        .solids = r->solids,
        .connector = r->connector,
        .light_sampler = r->light_sampler,
        .medium = &r->medium,
        .tint = tints,
        .seed = 7,
        .error = (double) error,
        .knobs = { .error = error, .most = 2000000, .distance = distance, .refraction = refraction, .normals = normals },
    };
}

static void rig_finish(struct rig *r)
{
    pell_light_sampler_destroy(&r->light_sampler);
    pell_connector_destroy(&r->connector);
    pell_solids_destroy(&r->solids);
    pell_rays_destroy(&r->rays);
    pell_pool_destroy(&r->pool);
    pell_scene_destroy(&r->scene);
    pell_context_destroy(&r->ctx);
}

static void rig_box(struct rig *r, float half, float deep)
{
    struct stage s = { .scene = r->scene, .ctx = r->ctx };
    stage_box(&s, 0, 0, vec3(-half, -half, -deep), vec3(half, half, 0));
}

static struct pell_light *rig_light(struct rig *r, enum pell_light_type type, struct pell_vec3 at, struct pell_vec3 to, float power)
{
    struct stage s = { .scene = r->scene, .ctx = r->ctx };
    return stage_light(&s, type, at, to, power);
}

/* Mean over some points of a plane, and its standard error. */
static void mean_over_points(struct rig *r, struct pell_vec3 toward, int points, double mean[3], double bar[3])
{
    for (int c = 0; c < 3; c++)
        mean[c] = bar[c] = 0.0;
    for (int k = 0; k < points; k++) {
        float light[3], standard_error[3];
        single_estimate(&r->world, vec3(0.37f * (float) k, 0.11f * (float) k, 0.0f), toward, 100.0, &r->counts, light, standard_error);
        for (int c = 0; c < 3; c++) {
            mean[c] += (double) light[c] / points;
            bar[c] += (double) standard_error[c] * (double) standard_error[c] / (points * points);
        }
    }
    for (int c = 0; c < 3; c++)
        bar[c] = sqrt(bar[c]);
}

static void within(const char *what, double found, double bar, double expected, double most)
{
    print_message("# %s: %.7g +- %.2g, expected %.7g: off by %.4f, %.1f bars\n", what, found, bar, expected, found / expected - 1.0,
                  bar > 0.0 ? (found - expected) / bar : 0.0);
    REQUIRE(bar < most * expected);
    REQUIRE_NEAR(found, expected, 4.0 * bar + 1e-6 * expected);
}

/* --- Slabs -------------------------------------------------------------------------------------------------------------------- */

/* Single scattering of plane-parallel layers without refraction, for light of irradiance 1 across its beam: the mu are cosines to the
 * normal, `cosine` is that between the directions to the light and to the camera. A layer: thickness, sigma_s, sigma_t, Schlick's k. */
static double layers_closed_form(const double (*layer)[4], int count, double mu_o, double mu_i, double cosine)
{
    const double m = 1.0 / mu_o + 1.0 / mu_i;
    double sum = 0.0, depth = 0.0;

    for (int i = 0; i < count; i++) {
        const double d = layer[i][0], k = layer[i][3], p = (1.0 - k * k) / (4.0 * PELL_PI * (1.0 + k * cosine) * (1.0 + k * cosine));
        sum += layer[i][1] * p / mu_o * exp(-depth * m) * -expm1(-layer[i][2] * d * m) / (layer[i][2] * m);
        depth += layer[i][2] * d;
    }
    return sum;
}

/* The layers of tests/expect/oracle/errata_demos.json, seed001_ray_march: Francois et al. 2006, table 1, and their radiance. */
static const double fish[3][4] = { { 0.5, 2.0, 2.6, 0.25 }, { 0.5, 6.0, 6.6, 0.4 }, { 2.0, 1.0, 1.5, 0.8 } };
#define FISH 0.0217062584
#define FISH_FIRST 0.02092591899

/* The k that gives the same phase function value at another angle: no two directions with the cosines of the oracle's case have a cosine
 * of 0.3 between them. */
static double other_k(double k, double cosine, double other)
{
    const double p = (1.0 - k * k) / ((1.0 + k * cosine) * (1.0 + k * cosine)), a = p * other * other + 1.0, b = p * other;
    return (-b + sqrt(b * b - a * (p - 1.0))) / a;
}

static void three_layers(void **state)
{
    const double mu_o = 0.9, mu_i = 0.7, cosine = 0.5, side = sqrt(1.0 - mu_o * mu_o), x = (cosine - mu_o * mu_i) / side;
    const struct pell_vec3 to_camera = vec3((float) side, 0.0f, (float) mu_o);
    const struct pell_vec3 to_light = vec3((float) x, (float) sqrt(1.0 - mu_i * mu_i - x * x), (float) mu_i);
    double mean[3], bar[3];

    (void) state;
    REQUIRE_REL(layers_closed_form(fish, 3, mu_o, mu_i, 0.3), FISH, 1e-8);
    REQUIRE_REL(layers_closed_form(fish, 1, mu_o, mu_i, 0.3), FISH_FIRST, 1e-8);
    for (int count = 1; count <= 3; count += 2)
        for (int distance = SINGLE_BOTH; distance <= SINGLE_TRANSMITTANCE; distance++) {
            struct rig r;
            double bottom = 0.0;
            rig_start(&r);
            r.medium.eta = 1.33; /* which is not requested */
            r.medium.layers = count + 1;
            for (int i = 0; i <= count; i++) {
                struct single_layer *l = &r.medium.layer[i];
                bottom += i < count ? fish[i][0] : INFINITY;
                l->bottom = bottom;
                for (int c = 0; c < 3; c++) { /* below them it is black */
                    l->sigma_s[c] = i < count ? fish[i][1] : 0.0;
                    l->sigma_t[c] = i < count ? fish[i][2] : 1e4;
                    l->phase[c] =
                        (struct pell_phase) { PELL_PHASE_SCHLICK, { i < count ? other_k(fish[i][3], 0.3, cosine) : 0.0, 0.0 }, 0.0 };
                }
            }
            rig_box(&r, 400.0f, 100.0f);
            rig_light(&r, PELL_LIGHT_DIRECTIONAL, to_light, vec3(0, 0, 0), 1.0f);
            rig_build(&r, SINGLE_SMOOTH, SINGLE_NONE, distance, SLOW ? 0.01f : 0.004f);
            mean_over_points(&r, to_camera, SLOW ? 1 : 3, mean, bar);
            within(count == 1 ? "one layer" : "three layers", mean[1], bar[1], count == 1 ? FISH_FIRST : FISH, SLOW ? 0.03 : 0.004);
            rig_finish(&r);
        }
}

/* A built-in stack, by the name that a user gives. */
static void layers_of_a_material(void **state)
{
    const struct pell_material_entry *e = pell_material_find("fish");
    const double mu_o = 0.8, mu_i = 0.6, cosine = mu_o * mu_i;
    const struct pell_vec3 to_camera = vec3(0.6f, 0.0f, 0.8f), to_light = vec3(0.0f, 0.8f, 0.6f);
    struct pell_material *m;
    double mean[3], bar[3];
    struct rig r;

    (void) state;
    assert_non_null(e);
    rig_start(&r);
    m = &r.scene->materials[0];
    OK(pell_material_apply(r.scene, 0, "test", "fish"));
    OK(single_medium_make(r.ctx, m, &r.medium));
    assert_int_equal(r.medium.layers, e->layers.count);
    rig_box(&r, 400.0f, 100.0f);
    rig_light(&r, PELL_LIGHT_DIRECTIONAL, to_light, vec3(0, 0, 0), 1.0f);
    rig_build(&r, SINGLE_SMOOTH, SINGLE_NONE, SINGLE_BOTH, SLOW ? 0.05f : 0.02f);
    mean_over_points(&r, to_camera, 2, mean, bar);
    for (int c = 0; c < 3; c++) {
        double layer[3][4];
        for (int i = 0; i < 3; i++) {
            const struct pell_medium *l = &e->layers.item[i].medium;
            layer[i][0] = i < 2 ? e->layers.item[i].thickness_mm : 100.0;
            layer[i][1] = l->sigma_s_reduced[c] / (1.0 - l->g[c]);
            layer[i][2] = layer[i][1] + l->sigma_a[c];
            layer[i][3] = e->layers.item[i].phase[c].g[0];
        }
        within("fish", mean[c], bar[c], layers_closed_form((const double(*)[4]) layer, 3, mu_o, mu_i, cosine), 0.05);
    }
    /* A material that has only a profile is refused by name. */
    m->gaussians.weight[0][0] *= 1.5;
    single_medium_finish(r.ctx, &r.medium);
    assert_int_equal(single_medium_make(r.ctx, m, &r.medium), PELL_ERR_UNSUPPORTED);
    assert_non_null(strstr(r.kept.what, "coefficients"));
    single_medium_finish(r.ctx, &r.medium);
    rig_finish(&r);
}

/* The oracle's layers in a scene, over black: uniform; painted with one value; painted with another value far away; painted in two
 * halves, each of which equals a known uniform stack. `depth`: of the three layer bottoms at the shaded point. */
static void light_of_painted(int painted, const float depth[3], float at, double light[3], double bar[3])
{
    static const float full[3] = { 1.0f, 2.0f, 6.0f };
    const double mu_o = 0.9, mu_i = 0.7, cosine = 0.5, side = sqrt(1.0 - mu_o * mu_o), x = (cosine - mu_o * mu_i) / side;
    double optics[3][3];
    struct rig r;

    for (int i = 0; i < 3; i++) {
        optics[i][0] = fish[i][1];
        optics[i][1] = fish[i][2];
        optics[i][2] = other_k(fish[i][3], 0.3, cosine);
    }
    rig_start(&r);
    r.scene->materials[0].medium.eta = 1.33;
    layers_set(r.scene, 0, 3, optics, painted ? full : depth, PELL_SUBSTRATE_STOP);
    for (int i = 0; painted && i < 3; i++) {
        const float here = depth[i] / full[i];
        const float share[4] = { painted == 3 ? 0.5f : here, here, painted == 2 ? 0.0f : painted == 3 ? 0.5f : here, here };
        layers_paint(r.scene, 0, i, 2, 2, 1, share)->nearest = true; /* the right half is `here`, except in case 2 */
    }
    rig_box(&r, 400.0f, 100.0f);
    layers_unwrap(r.scene);
    rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3((float) x, (float) sqrt(1.0 - mu_i * mu_i - x * x), (float) mu_i), vec3(0, 0, 0), 1.0f);
    rig_build(&r, SINGLE_SMOOTH, SINGLE_NONE, SINGLE_BOTH, SLOW ? 0.05f : 0.01f);
    OK(single_medium_make(r.ctx, &r.scene->materials[0], &r.medium));
    assert_int_equal(r.medium.layers, 4);
    REQUIRE((r.medium.maps != NULL) == (painted >= 2));
    single_medium_attach(&r.medium, r.scene, r.rays, r.solids, 0);
    {
        float value[3], standard_error[3];
        single_estimate(&r.world, vec3(at, 0.25f * at, 0.0f), vec3((float) side, 0.0f, (float) mu_o), 100.0, &r.counts, value,
                        standard_error);
        for (int c = 0; c < 3; c++) {
            light[c] = (double) value[c];
            bar[c] = (double) standard_error[c];
        }
    }
    single_medium_finish(r.ctx, &r.medium);
    rig_finish(&r);
}

static void painted_layers(void **state)
{
    static const float oracle[3] = { 0.5f, 1.0f, 3.0f }, halves[3] = { 0.5f, 1.0f, 3.0f }, thin[3] = { 0.25f, 0.75f, 1.0f };
    double uniform[3], found[3], bar[3];
    (void) state;

    light_of_painted(0, oracle, 101.0f, uniform, bar);
    within("uniform layers of a scene", uniform[1], bar[1], FISH, SLOW ? 0.1 : 0.02);
    light_of_painted(1, oracle, 101.0f, found, bar);
    for (int c = 0; c < 3; c++)
        REQUIRE(found[c] == uniform[c]);             /* bit by bit */
    light_of_painted(2, oracle, 101.0f, found, bar); /* below the point the left half and the lower right have the same values */
    within("painted layers", found[1], bar[1], FISH, SLOW ? 0.1 : 0.02);
    for (int c = 0; c < 3; c++)
        REQUIRE_REL(found[c], uniform[c], 1e-4); /* the same points: the remaining error is that of finding the boundaries */
    light_of_painted(3, thin, 101.0f, found, bar);
    light_of_painted(0, thin, 101.0f, uniform, bar);
    for (int c = 0; c < 3; c++)
        REQUIRE_REL(found[c], uniform[c], 1e-4);
    light_of_painted(3, thin, -101.0f, found, bar); /* the left half is 0.5, 1, 3 mm whatever the right is */
    light_of_painted(0, halves, -101.0f, uniform, bar);
    for (int c = 0; c < 3; c++)
        REQUIRE_REL(found[c], uniform[c], 1e-4);
}

/* A homogeneous medium with a refracting surface: directional light in closed form; a point light by quadrature over the ray, with the
 * cross-section of its beam by the difference of two rays, found by bisection. */
static double at_depth(double eta, double high, double deep, double angle)
{
    const double s = sin(angle) / eta;
    return high * tan(angle) + deep * s / sqrt(1.0 - s * s);
}

static double slab_by_quadrature(const struct single_layer *l, int c, double eta, double mu_o, const struct pell_vec3 *source, double thick)
{
    const double so = sqrt(1.0 - mu_o * mu_o) / eta, co = sqrt(1.0 - so * so), end = fmin(thick / co, 40.0 / l->sigma_t[c]);
    const int steps = 4000;
    double sum = 0.0;

    for (int k = 0; k < steps; k++) {
        const double s = (k + 0.5) / steps * end, deep = s * co;
        const double dx = (double) source->x + s * so, dy = (double) source->y, lateral = hypot(dx, dy); /* the ray runs toward -x */
        double low = 0.0, high = 1.5707, angle, si, ci, h = 1e-5, rise, beam, cosine;
        for (int i = 0; i < 60; i++) {
            const double mid = 0.5 * (low + high);
            if (at_depth(eta, (double) source->z, deep, mid) < lateral)
                low = mid;
            else
                high = mid;
        }
        angle = 0.5 * (low + high);
        si = sin(angle) / eta;
        ci = sqrt(1.0 - si * si);
        rise = (at_depth(eta, (double) source->z, deep, angle + h) - at_depth(eta, (double) source->z, deep, angle - h)) / (2.0 * h);
        beam = 1e6 * sin(angle) / (lateral * rise * ci) * (1.0 - pell_fresnel(eta, cos(angle)));
        cosine = so * si * (dx / lateral) + co * ci; /* between the direction back to the camera, (so, 0, co), and that to the light */
        sum += end / steps * l->sigma_s[c] * pell_phase_value(&l->phase[c], cosine) * beam * exp(-l->sigma_t[c] * (s + deep / ci));
    }
    return sum * (1.0 - pell_fresnel(eta, mu_o)) / (eta * eta);
}

static void slab_that_refracts(void **state)
{
    const double eta = 1.4, mu_o = 0.75;
    const struct pell_vec3 to_camera = vec3((float) sqrt(1.0 - mu_o * mu_o), 0.0f, (float) mu_o);

    (void) state;
    for (int sun = 0; sun < 2; sun++)
        for (int distance = SINGLE_BOTH; distance <= SINGLE_EQUIANGULAR; distance++) {
            const struct pell_vec3 source = sun ? vec3_normalize(vec3(-0.5f, 0.3f, 0.8f)) : vec3(-1.5f, 1.0f, 4.0f);
            float light[3], standard_error[3];
            struct rig r;
            rig_start(&r);
            rig_box(&r, 300.0f, 3.0f);
            rig_light(&r, sun ? PELL_LIGHT_DIRECTIONAL : PELL_LIGHT_POINT, source, vec3(0, 0, 0), 1.0f);
            rig_build(&r, SINGLE_SMOOTH, SINGLE_EXACT, distance, SLOW ? 0.03f : 0.01f);
            single_estimate(&r.world, vec3(0, 0, 0), to_camera, 100.0, &r.counts, light, standard_error);
            for (int c = 0; c < 3; c++) {
                const struct single_layer *l = &r.medium.layer[0];
                double expected;
                if (sun) {
                    const double mu = (double) source.z, ti = sqrt(1.0 - (1.0 - mu * mu) / (eta * eta)),
                                 to = sqrt(1.0 - (1.0 - mu_o * mu_o) / (eta * eta));
                    const double m = 1.0 / ti + 1.0 / to, sigma = l->sigma_t[c];
                    const double cosine = ((double) to_camera.x * (double) source.x) / (eta * eta) + ti * to;
                    expected = (1.0 - pell_fresnel(eta, mu)) * (1.0 - pell_fresnel(eta, mu_o)) / (eta * eta) * mu / ti * l->sigma_s[c] *
                               pell_phase_value(&l->phase[c], cosine) / to * -expm1(-sigma * 3.0 * m) / (sigma * m);
                } else {
                    expected = slab_by_quadrature(l, c, eta, mu_o, &source, 3.0);
                }
                within(sun ? "slab under a sun" : "slab under a point", (double) light[c], (double) standard_error[c], expected,
                       SLOW ? 0.08 : 0.03);
            }
            rig_finish(&r);
        }
}

/* --- Brute force -------------------------------------------------------------------------------------------------------------- */

struct trial {
    struct pell_vec3 at, n, w; /* of an exit: position, normal, direction inside */
    double length;
    bool out;
};

static struct trial leave(const struct rig *r, struct pell_vec3 x, struct pell_vec3 w, bool flat)
{
    _Alignas(64) int valid[16] = { -1 };
    struct pell_ray_hit16 p;
    struct trial t = { .w = w };

    memset(&p, 0, sizeof(p));
    p.ray.ox[0] = x.x;
    p.ray.oy[0] = x.y;
    p.ray.oz[0] = x.z;
    p.ray.dx[0] = w.x;
    p.ray.dy[0] = w.y;
    p.ray.dz[0] = w.z;
    p.ray.tnear[0] = 1e-4f;
    p.ray.tfar[0] = INFINITY;
    p.ray.mask[0] = PELL_RAY_ALL;
    pell_rays_closest16(r->rays, valid, false, &p);
    if (p.hit.mesh[0] == PELL_NO_HIT)
        return t;
    t.out = true;
    t.length = (double) p.ray.tfar[0];
    t.at = vec3_mad(x, p.ray.tfar[0], w);
    t.n = vec3_normalize(vec3(p.hit.ngx[0], p.hit.ngy[0], p.hit.ngz[0]));
    if (!flat) {
        const struct pell_mesh *m = &r->scene->meshes[p.hit.mesh[0]];
        const uint32_t *v = m->index + 3 * (size_t) p.hit.triangle[0];
        t.n = vec3_mul(vec3_load(m->normal + 3 * (size_t) v[0]), 1.0f - p.hit.u[0] - p.hit.v[0]);
        t.n = vec3_mad(t.n, p.hit.u[0], vec3_load(m->normal + 3 * (size_t) v[1]));
        t.n = vec3_normalize(vec3_mad(t.n, p.hit.v[0], vec3_load(m->normal + 3 * (size_t) v[2])));
    }
    return t;
}

/* The point of the object seen by the camera above, and the normal there. */
static struct trial seen_at(const struct rig *r, float x, float y, bool flat)
{
    struct trial t = leave(r, vec3(x, y, 20.0f), vec3(0, 0, -1), flat);

    REQUIRE(t.out);
    return t;
}

static double number(uint64_t *state)
{
    return (double) (random_bits(state) >> 11) * 0x1p-53;
}

/* Samples paths from the camera: the camera's ray, a random scattering point, a random direction, the exit, and there the light is hit
 * or not. */
static void ball_by_brute_force(void **state)
{
    const double eta = 1.4, radius = 8.0;
    uint64_t random = 77;

    (void) state;
    for (int flat = 0; flat < 2; flat++)
        for (int environment = 0; environment < 2; environment++) {
            const struct pell_vec3 middle = vec3(-25.0f, 30.0f, 20.0f), towards = vec3_normalize(vec3_mul(middle, -1.0f));
            struct pell_vec3 side, up;
            struct pell_light *source;
            struct rig r;
            rig_start(&r);
            shapes_ball(r.scene, 0, vec3(0, 0, 0), (float) radius, flat ? 14 : 64);
            for (int c = 0; c < 3; c++) {
                r.medium.layer[0].sigma_s[c] *= 0.4;
                r.medium.layer[0].sigma_t[c] *= 0.4;
            }
            if (environment) {
                source = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, -1), 0.7f);
            } else {
                source = rig_light(&r, PELL_LIGHT_RECT, middle, vec3(0, 0, 0), 2.0f);
                source->width = 50.0f;
                source->height = 40.0f;
            }
            up = vec3_load(source->up);
            side = vec3_cross(towards, up);
            rig_build(&r, flat ? SINGLE_FLAT : SINGLE_SMOOTH, SINGLE_EXACT, SINGLE_BOTH, SLOW ? 0.05f : 0.025f);
            for (int k = 0; k < (SLOW ? 1 : 2); k++) {
                const struct pell_vec3 from = vec3_mul(vec3_normalize(vec3(0.3f * (float) k - 0.35f, 0.13f, 1.0f)), 20.0f);
                const struct pell_vec3 to_camera = vec3(0, 0, 1);
                const int64_t trials = SLOW ? 12000 : 24000;
                const struct trial top = seen_at(&r, 0.4f * from.x, 0.4f * from.y, flat);
                const struct pell_vec3 at = top.at, n = top.n;
                struct pell_vec3 w;
                struct trial whole;
                float light[3], standard_error[3];
                double sum[3] = { 0 }, square[3] = { 0 }, cos_o, cos_i;
                single_estimate(&r.world, at, to_camera, 100.0, &r.counts, light, standard_error);
                cos_o = (double) vec3_dot(n, to_camera);
                cos_i = sqrt(1.0 - (1.0 - cos_o * cos_o) / (eta * eta));
                w = vec3_normalize(vec3_mad(vec3_mul(to_camera, (float) (-1.0 / eta)), (float) (cos_o / eta - cos_i), n));
                whole = leave(&r, at, w, flat);
                REQUIRE(whole.out);
                for (int64_t t = 0; t < trials; t++) {
                    const double s = number(&random) * whole.length, z = 2.0 * number(&random) - 1.0, phi = 2.0 * PELL_PI * number(&random);
                    const double q = sqrt(1.0 - z * z);
                    const struct pell_vec3 x = vec3_mad(at, (float) s, w),
                                           d = vec3((float) (q * cos(phi)), (float) (q * sin(phi)), (float) z);
                    const struct trial o = leave(&r, x, d, flat);
                    double ci, co2, seen = 0.0;
                    struct pell_vec3 out;
                    if (!o.out)
                        continue;
                    ci = (double) vec3_dot(o.n, d);
                    co2 = 1.0 - eta * eta * (1.0 - ci * ci);
                    if (!(ci > 0.0) || !(co2 > 0.0))
                        continue;
                    out = vec3_mad(vec3_mul(d, (float) eta), (float) (sqrt(co2) - eta * ci), o.n);
                    if (environment) {
                        seen = 0.7;
                    } else {
                        const double facing = -(double) vec3_dot(out, towards);
                        const double far = -(double) vec3_dot(vec3_sub(middle, o.at), towards) / facing;
                        const struct pell_vec3 hit = vec3_sub(vec3_mad(o.at, (float) far, out), middle);
                        if (facing > 0.0 && far > 0.0 && fabsf(vec3_dot(hit, side)) < 25.0f && fabsf(vec3_dot(hit, up)) < 20.0f)
                            seen = 2.0;
                    }
                    seen *= eta * eta * (1.0 - pell_fresnel(1.0 / eta, ci)) * 4.0 * PELL_PI * whole.length;
                    for (int c = 0; seen > 0.0 && c < 3; c++) {
                        const struct single_layer *l = &r.medium.layer[0];
                        const double v = seen * l->sigma_s[c] * pell_phase_value(&l->phase[c], -(double) vec3_dot(w, d)) *
                                         exp(-l->sigma_t[c] * (s + o.length));
                        sum[c] += v;
                        square[c] += v * v;
                    }
                }
                for (int c = 0; c < 3; c++) {
                    const double scale = (1.0 - pell_fresnel(eta, cos_o)) / (eta * eta), mean = sum[c] / (double) trials;
                    const double bar = scale * sqrt((square[c] / (double) trials - mean * mean) / (double) trials);
                    const double both = sqrt(bar * bar + (double) standard_error[c] * (double) standard_error[c]);
                    print_message("# ball (%s), %s: %.5g +- %.2g, by brute force %.5g +- %.2g: %.1f bars\n", flat ? "flat" : "smooth",
                                  environment ? "sky" : "rect", (double) light[c], (double) standard_error[c], scale * mean, bar,
                                  ((double) light[c] - scale * mean) / both);
                    REQUIRE((double) standard_error[c] < (SLOW ? 0.3 : 0.15) * (double) light[c] &&
                            bar < (SLOW ? 0.3 : 0.15) * scale * mean);
                    REQUIRE_NEAR((double) light[c], scale * mean, 3.5 * both + 2e-3 * scale * mean);
                }
            }
            rig_finish(&r);
        }
}

/* --- Against other estimators ------------------------------------------------------------------------------------------------- */

/* Three strategies of sampling the scattering point agree, and the stated standard errors are correct. */
static void all_ways_agree(void **state)
{
    struct rig r;
    double bars = 0.0;
    int count = 0;

    (void) state;
    rig_start(&r);
    shapes_ball(r.scene, 0, vec3(0, 0, 0), 8.0f, 24);
    rig_light(&r, PELL_LIGHT_POINT, vec3(10, 14, 6), vec3(0, 0, 0), 0.01f);
    rig_light(&r, PELL_LIGHT_POINT, vec3(-3, 5, -16), vec3(0, 0, 0), 0.05f); /* from behind */
    for (int k = 0; k < 3; k++) {
        double mean[3], bar[3], sum = 0.0, weight = 0.0;
        for (int distance = SINGLE_BOTH; distance <= SINGLE_EQUIANGULAR; distance++) {
            float light[3], standard_error[3];
            rig_build(&r, SINGLE_SMOOTH, SINGLE_EXACT, distance, 0.06f);
            single_estimate(&r.world, seen_at(&r, 4.0f * (float) k - 4.1f, 1.3f, false).at, vec3(0, 0, 1), 100.0, &r.counts, light,
                            standard_error);
            mean[distance] = (double) light[1];
            bar[distance] = (double) standard_error[1];
            sum += mean[distance] / (bar[distance] * bar[distance]);
            weight += 1.0 / (bar[distance] * bar[distance]);
        }
        print_message("# both %.5g +- %.2g, transmittance %.5g +- %.2g, equiangular %.5g +- %.2g\n", mean[0], bar[0], mean[1], bar[1],
                      mean[2], bar[2]);
        for (int i = 0; i < 3; i++) {
            const double d = (mean[i] - sum / weight) / bar[i];
            bars += d * d;
            count++;
            REQUIRE(fabs(d) < 4.0);
        }
        count--; /* the mean of the three */
    }
    REQUIRE(bars / count < 3.0);

    /* Other seeds: the spread of the results, in standard errors. */
    rig_build(&r, SINGLE_SMOOTH, SINGLE_EXACT, SINGLE_BOTH, 0.15f);
    {
        const int seeds = SLOW ? 12 : 30;
        double sum = 0.0, square = 0.0, bar2 = 0.0, spread;
        for (int i = 0; i < seeds; i++) {
            float light[3], standard_error[3];
            r.world.seed = (uint32_t) (1000 + i);
            single_estimate(&r.world, seen_at(&r, 2.3f, 1.1f, false).at, vec3(0, 0, 1), 100.0, &r.counts, light, standard_error);
            sum += (double) light[1] / seeds;
            square += (double) light[1] * (double) light[1] / seeds;
            bar2 += (double) standard_error[1] * (double) standard_error[1] / seeds;
        }
        spread = sqrt((square - sum * sum) * seeds / (seeds - 1.0) / bar2);
        print_message("# %d seeds: %.5g, they spread by %.2f bars\n", seeds, sum, spread);
        REQUIRE(spread > 0.5 && spread < 1.7);
    }
    rig_finish(&r);
}

static void what_can_t_be_seen(void **state)
{
    const struct pell_vec3 odd[] = { vec3(NAN, 0, 8), vec3(0, 0, 8000), vec3(0, 0, 0), vec3(INFINITY, 0, 0) };
    float light[3], standard_error[3];
    struct rig r;

    (void) state;
    rig_start(&r);
    shapes_ball(r.scene, 0, vec3(0, 0, 0), 8.0f, 12);
    rig_build(&r, SINGLE_SMOOTH, SINGLE_EXACT, SINGLE_BOTH, 0.1f);
    single_estimate(&r.world, vec3(0, 0, 8), vec3(0, 0, 1), 10.0, &r.counts, light, standard_error);
    REQUIRE(light[0] == 0.0f && standard_error[0] == 0.0f); /* no lights */
    rig_finish(&r);
    rig_start(&r);
    shapes_ball(r.scene, 0, vec3(0, 0, 0), 8.0f, 12);
    rig_light(&r, PELL_LIGHT_POINT, vec3(0, 10, 20), vec3(0, 0, 0), 0.01f);
    rig_build(&r, SINGLE_SMOOTH, SINGLE_EXACT, SINGLE_BOTH, 0.1f);
    for (size_t i = 0; i < PELL_COUNT(odd); i++) {
        single_estimate(&r.world, odd[i], vec3(0, 0, 1), 10.0, &r.counts, light, standard_error);
        REQUIRE(light[0] == 0.0f && light[1] == 0.0f && light[2] == 0.0f);
    }
    for (int c = 0; c < 3; c++)
        r.medium.layer[0].sigma_s[c] = 0.0;
    single_estimate(&r.world, vec3(0, 0, 8), vec3(0, 0, 1), 10.0, &r.counts, light, standard_error);
    REQUIRE(light[0] == 0.0f && light[1] == 0.0f && light[2] == 0.0f);
    rig_finish(&r);
}

/* --- As a method -------------------------------------------------------------------------------------------------------------- */

static const char *const quick[] = { "error=0.3", "most=128", NULL };

/* An object under two lights, one behind; `layers`: the image has separate layers. */
static void set_scene(struct stage *s, bool layers)
{
    size_t m;

    stage_start(s, 6, 6);
    stage_medium(s, "skimmilk", &m);
    stage_ball(s, m, 0, vec3(0, 0, 0), 8.0f, 16);
    stage_light(s, PELL_LIGHT_POINT, vec3(12, 16, 20), vec3(0, 0, 0), 0.01f);
    stage_light(s, PELL_LIGHT_RECT, vec3(-10, 8, -20), vec3(0, 0, 0), 3.0f);
    stage_camera(s, vec3(0, 0, 60), vec3(0, 0, 0), 0.3f, 0.0f);
    s->settings.layers = layers;
}

/* The image is the same whether or not single scattering is a separate layer, and then this layer contains all light from below the
 * surface. */
static void kept_apart(void **state)
{
    struct stage s;
    struct shot whole, layers;
    const float *standard_error[3];
    size_t single = SIZE_MAX, multiple = SIZE_MAX;

    (void) state;
    set_scene(&s, false);
    whole = stage_shot_of(&s, "single-scatter", quick);
    stage_finish(&s);
    set_scene(&s, true);
    layers = stage_shot_of(&s, "single-scatter", quick);
    for (size_t i = 0; i < s.image.num_channels; i++) {
        if (strcmp(s.image.channels[i].name, "diffuse.single.G") == 0)
            single = i;
        if (strcmp(s.image.channels[i].name, "diffuse.multiple.G") == 0)
            multiple = i;
    }
    REQUIRE(single != SIZE_MAX && multiple != SIZE_MAX);
    REQUIRE(pell_pass_standard_error(pell_renderer_pass(s.r), standard_error));
    for (int y = 0; y < 6; y++)
        for (int x = 0; x < 6; x++) {
            REQUIRE_NEAR(shot_at(&layers, SHOT_G, x, y), shot_at(&whole, SHOT_G, x, y), 1e-6 * shot_at(&whole, SHOT_G, x, y));
            REQUIRE_NEAR(shot_at(&layers, single, x, y), shot_at(&whole, SHOT_G, x, y), 1e-6 * shot_at(&whole, SHOT_G, x, y));
            REQUIRE(shot_at(&layers, multiple, x, y) == 0.0);
            REQUIRE(standard_error[1][y * s.image.stride + x] >= 0.0f);
        }
    shot_free(&whole);
    shot_free(&layers);
    stage_finish(&s);
}

static void planes_alone_are_refused(void **state)
{
    const struct pell_frame_material material = { .medium = { .eta = 1.3 }, .gaussians = { .count = 1, .variance = { 1.0 } } };
    struct pell_frame_shape shape = { .width = 4, .height = 4, .stride = 4, .focal_px = 1.0f, .num_materials = 1, .materials = &material };
    struct pell_pass *pass;
    struct stage s;

    (void) state;
    stage_start(&s, 4, 4);
    assert_int_equal(pell_pass_create(s.device, pell_method_find(s.ctx, "test", "single-scatter"), NULL, &shape, &pass),
                     PELL_ERR_UNSUPPORTED);
    assert_null(pass);
    stage_finish(&s);
}

static void a_profile_alone_is_refused(void **state)
{
    struct stage s;
    size_t m;

    (void) state;
    stage_start(&s, 4, 4);
    stage_gaussians(&s, 1.0, &m);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 8.0f, 8);
    stage_light(&s, PELL_LIGHT_POINT, vec3(12, 16, 20), vec3(0, 0, 0), 0.01f);
    stage_camera(&s, vec3(0, 0, 60), vec3(0, 0, 0), 0.3f, 0.0f);
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    stage_method(&s, "single-scatter", quick);
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_UNSUPPORTED);
    stage_finish(&s);
}

static void survives_the_nth_allocation(void **state)
{
    bool done = false;

    (void) state;
    for (uint64_t at = 1; !done; at = next_allocation(at)) {
        struct pell_alloc_fault fault = { 0 };
        struct stage s = { 0 };
        size_t m;
        const struct pell_device_params params = { .threads = 1, .engine = PELL_ENGINE_CPU };
        s.ctx = test_context(&fault, &s.kept);
        OK(pell_scene_create(s.ctx, &s.scene));
        OK(pell_device_create(s.ctx, &params, &s.device));
        OK(pell_renderer_create(s.device, &s.r));
        pell_knobs_default(pell_settings_knobs(), &s.settings);
        s.settings.width = s.settings.height = 2;
        s.settings.msaa = 1;
        stage_medium(&s, "marble", &m);
        layers_set(s.scene, m, 1, (const double[1][3]) { { 1.0, 2.0, 0.1 } }, (const float[1]) { 0.5f }, PELL_SUBSTRATE_STOP);
        layers_paint(s.scene, m, 0, 2, 1, 1, (const float[2]) { 1.0f, 0.5f });
        stage_box(&s, m, 0, vec3(-1, -1, -1), vec3(1, 1, 1));
        layers_unwrap(s.scene);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 9), vec3(0, 0, 0), 3.0f);
        stage_camera(&s, vec3(0, 0, 9), vec3(0, 0, 0), 0.0f, 1.0f);
        stage_complete(&s);
        OK(pell_renderer_set_scene(s.r, s.scene));
        stage_method(&s, "single-scatter", (const char *const[]) { "error=1", "most=128", NULL });
        fault.fail_at = fault.calls + at;
        switch (pell_renderer_render(s.r, &s.settings, &s.image)) {
        case PELL_OK: done = fault.calls < fault.fail_at; break;
        case PELL_ERR_NOMEM: break;
        default: fail_msg("allocation %d gave another error", (int) at);
        }
        stage_finish(&s);
        assert_int_equal(fault.live, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(three_layers),
        cmocka_unit_test(layers_of_a_material),
        cmocka_unit_test(painted_layers),
        cmocka_unit_test(slab_that_refracts),
        cmocka_unit_test(ball_by_brute_force),
        cmocka_unit_test(all_ways_agree),
        cmocka_unit_test(what_can_t_be_seen),
        cmocka_unit_test(kept_apart),
        cmocka_unit_test(planes_alone_are_refused),
        cmocka_unit_test(a_profile_alone_is_refused),
        cmocka_unit_test(survives_the_nth_allocation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
