/* SPDX-License-Identifier: MIT
 * test_truth.c - the reference methods against independent results: the oracle's pencil beams, photons between planes, closed forms, and
 * each other. Seeds are fixed; statistical tests allow 3.5 standard errors. */
#include "path_trace_rig.h"

#include "methods/path_trace/path.h"
#include "render/renderer.h"

#include "oracle.h"
#include "random.h"

#define FEWER(n) (SLOW ? (n) / 10 : (n))

/* --- Photons between planes ---------------------------------------------------------------------------------------------------------- */

/* An independent Monte Carlo that has no code in common with path-trace: layers of one index between two planes. */
struct plate {
    double thickness, sigma_s, sigma_a, g;
};

struct planes {
    const struct plate *plate;
    int count;
    double eta;
};

struct tally { /* of light that entered */
    double reflected, through, reflected_error, transmission_error;
    double ring[8], ring_error[8]; /* of reflected light, in rings with the given edges */
};

static void turn(double w[3], double g, uint64_t *random)
{
    const double u = random_unit(random), phi = 2.0 * PELL_PI * random_unit(random);
    const double q = g != 0.0 ? (1.0 - g * g) / (1.0 - g + 2.0 * g * u) : 0.0;
    const double c = g != 0.0 ? (1.0 + g * g - q * q) / (2.0 * g) : 2.0 * u - 1.0;
    const double s = sqrt(fmax(1.0 - c * c, 0.0)), a = s * cos(phi), b = s * sin(phi), h = sqrt(fmax(1.0 - w[2] * w[2], 0.0));
    const double x = w[0], y = w[1], z = w[2];

    if (h < 1e-9) {
        w[0] = a;
        w[1] = b;
        w[2] = z > 0.0 ? c : -c;
        return;
    }
    w[0] = x * c + (x * z * a - y * b) / h;
    w[1] = y * c + (y * z * a + x * b) / h;
    w[2] = z * c - h * a;
}

static struct tally photons(const struct planes *p, const double *edge, int rings, int count, uint64_t seed)
{
    struct tally t = { 0 };
    double square[2] = { 0 }, ring2[8] = { 0 };
    double bottom[8], deep = 0.0;

    for (int l = 0; l < p->count; l++)
        bottom[l] = deep += p->plate[l].thickness;
    for (int n = 0; n < count; n++) {
        double x[3] = { 0, 0, 0 }, w[3] = { 0, 0, 1 }, weight = 1.0; /* z goes down */
        int l = 0;
        for (;;) {
            const struct plate *m = &p->plate[l];
            double tau = -log(random_unit(&seed));
            bool out = false;
            for (;;) { /* a free flight by the extinction, through the planes */
                const double sigma = p->plate[l].sigma_s + p->plate[l].sigma_a;
                const double plane = w[2] > 0.0 ? bottom[l] : l > 0 ? bottom[l - 1] : 0.0;
                const double s = w[2] != 0.0 ? (plane - x[2]) / w[2] : INFINITY, to = fmin(s, sigma > 0.0 ? tau / sigma : INFINITY);
                for (int i = 0; i < 3; i++)
                    x[i] += to * w[i];
                m = &p->plate[l];
                if (to < s)
                    break;
                tau -= s * sigma;
                x[2] = plane;
                if (w[2] > 0.0 ? l + 1 < p->count : l > 0) {
                    l += w[2] > 0.0 ? 1 : -1;
                } else if (random_unit(&seed) < pell_fresnel(1.0 / p->eta, fabs(w[2]))) {
                    w[2] = -w[2];
                } else {
                    out = true;
                    break;
                }
            }
            if (out) {
                const bool back = w[2] < 0.0;
                const double r = hypot(x[0], x[1]);
                *(back ? &t.reflected : &t.through) += weight;
                square[back] += weight * weight;
                for (int k = 0; back && k < rings; k++)
                    if (r >= edge[k] && r < edge[k + 1]) {
                        t.ring[k] += weight;
                        ring2[k] += weight * weight;
                    }
                break;
            }
            weight *= m->sigma_s / (m->sigma_s + m->sigma_a);
            if (weight < 0.05) {
                if (random_unit(&seed) >= 0.2)
                    break;
                weight *= 5.0;
            }
            turn(w, m->g, &seed);
        }
    }
    t.reflected /= count;
    t.through /= count;
    t.transmission_error = sqrt((square[0] / count - t.through * t.through) / count);
    t.reflected_error = sqrt((square[1] / count - t.reflected * t.reflected) / count);
    for (int k = 0; k < rings; k++) {
        const double area = PELL_PI * (edge[k + 1] * edge[k + 1] - edge[k] * edge[k]);
        t.ring[k] /= count;
        t.ring_error[k] = sqrt((ring2[k] / count - t.ring[k] * t.ring[k]) / count) / area;
        t.ring[k] /= area;
    }
    return t;
}

static void require_within(const char *name, double value, double error, double expected, double expected_error)
{
    const double bar = hypot(error, expected_error);

    print_message("# %s: %.5g +- %.2g, expected %.5g +- %.2g, %.1f sigma\n", name, value, error, expected, expected_error,
                  (value - expected) / bar);
    REQUIRE(error > 0.0 && value > 0.0);
    REQUIRE(SLOW || fabs(value - expected) <= SIGMAS * bar); /* with few samples even the standard errors are unreliable */
}

/* The photons themselves: van de Hulst's slab, cut into three, and Giovanelli's half-space. */
static void photons_are_right(void **state)
{
    static const struct plate cut[] = { { 0.05, 9.0, 1.0, 0.75 }, { 0.1, 9.0, 1.0, 0.75 }, { 0.05, 9.0, 1.0, 0.75 } };
    static const struct plate deep[] = { { 20.0, 9.0, 1.0, 0.0 } };
    const struct planes hulst = { cut, 3, 1.0 }, giovanelli = { deep, 1, 1.5 };
    const struct tally a = photons(&hulst, NULL, 0, FEWER(60000), 1), b = photons(&giovanelli, NULL, 0, FEWER(60000), 2);

    (void) state;
    require_within("van de Hulst, R by photons", a.reflected, a.reflected_error, 0.09739, 1e-5);
    require_within("van de Hulst, T by photons", a.through, a.transmission_error, 0.66096, 1e-5);
    require_within("Giovanelli, R by photons", b.reflected, b.reflected_error, 0.2289645, 6e-5);
}

/* --- Pencil beams --------------------------------------------------------------------------------------------------------------------- */

/* A black plate at height z with a ring cut out, of polygons with the areas of the circles. */
static void plate_with_a_ring(struct stage *s, size_t black, float z, double inner, double outer, double wide)
{
    enum { SIDES = 96 };
    const double step = 2.0 * PELL_PI / SIDES, grow = sqrt(step / sin(step));
    struct pell_mesh *m = shapes_mesh(s->scene, black, 1 + 3 * SIDES, 3 * SIDES);
    const double radius[3] = { inner * grow, outer * grow, wide };

    m->object = 1;
    for (uint32_t v = 0; v < 1 + 3 * SIDES; v++) {
        const double r = v == 0 ? 0.0 : radius[(v - 1) / SIDES], angle = v == 0 ? 0.0 : step * ((v - 1) % SIDES);
        vec3_store(vec3((float) (r * cos(angle)), (float) (r * sin(angle)), z), m->position + 3 * v);
        vec3_store(vec3(0, 0, 1), m->normal + 3 * v);
    }
    for (uint32_t k = 0; k < SIDES; k++) {
        const uint32_t n = (k + 1) % SIDES, b = 1 + SIDES, c = 1 + 2 * SIDES;
        const uint32_t corners[9] = { 0, 1 + k, 1 + n, b + k, c + k, c + n, b + k, c + n, b + n };
        memcpy(m->index + 9 * (size_t) k, corners, sizeof(corners));
    }
}

/* R(r) over a ring, by reciprocity: the light that leaves at the centre in all directions, for light that enters normally over the ring.
 * The Fresnel loss at entry is divided out, as the oracle normalises by the light that entered. */
static struct rig_mean ring(double sigma_s, double sigma_a, double g, double eta, double thickness, double inner, double outer, int samples)
{
    const double mfp = 1.0 / (sigma_s * (1.0 - g) + sigma_a), wide = 60.0 * outer + 200.0 * mfp;
    const float bound = (float) wide, half = 0.7f * bound;
    struct pt_knobs knobs = rig_knobs();
    struct rig_mean sum = { 0 };
    uint64_t random = 77;
    struct pt_scene *scene;
    struct pt_walker *w;
    struct stage s;
    size_t m, black;

    stage_start_threads(&s, 8, 8, 1);
    m = rig_medium(&s, sigma_s, sigma_a, g, eta);
    stage_opaque(&s, 0.0f, &black);
    stage_box(&s, m, 0, vec3(-half, -half, (float) -thickness), vec3(half, half, 0.0f));
    plate_with_a_ring(&s, black, (float) (5.0 * mfp), inner, outer, 3.0 * wide);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 500), vec3(0, 0, 0), 0.0f, 7.0f);
    scene = rig_scene(&s, &knobs);
    OK(pt_walker_create(scene, &w));
    for (int n = 0; n < samples; n++) {
        const double u = (n + random_unit(&random)) / samples, phi = 2.0 * PELL_PI * random_unit(&random), r = sqrt(u);
        const struct pell_vec3 to = vec3((float) (r * cos(phi)), (float) (r * sin(phi)), (float) sqrt(1.0 - u));
        const struct pt_point at = rig_point(vec3(0, 0, 0), vec3_mul(to, (float) (0.5 * mfp)), (uint32_t) n);
        struct pt_light l;
        pt_trace(scene, w, &at, (uint32_t) n, 1, &l);
        for (int k = 0; k < 2; k++) {
            const double v = k ? l.single[1] : l.multiple[1];
            sum.mean[k][1] += v;
            sum.error[k][1] += v * v;
            sum.variance[k][1] += k ? 0.0 : (l.single[1] + v) * (l.single[1] + v);
        }
    }
    {
        const double scale = PELL_PI / (1.0 - pell_fresnel(eta, 1.0)) / (PELL_PI * (outer * outer - inner * inner));
        sum.mean[3][1] = (sum.mean[0][1] + sum.mean[1][1]) / samples;
        sum.error[3][1] = scale * sqrt((sum.variance[0][1] / samples - sum.mean[3][1] * sum.mean[3][1]) / samples);
        sum.mean[3][1] *= scale;
        for (int k = 0; k < 2; k++) {
            sum.mean[k][1] /= samples;
            sum.error[k][1] = scale * sqrt((sum.error[k][1] / samples - sum.mean[k][1] * sum.mean[k][1]) / samples);
            sum.mean[k][1] *= scale;
        }
    }
    pt_walker_destroy(&w);
    pt_scene_destroy(&scene);
    stage_finish(&s);
    return sum;
}

/* Half-spaces of the oracle, index 1.3: rings that each combine several of its bins. */
static void pencil_beams_of_the_oracle(void **state)
{
    static const struct {
        size_t row;
        double deep; /* mean free paths */
        int samples;
    } beams[] = { { 2, 60.0, 3000 }, { 0, 400.0, 4000 } };
    static const size_t first[] = { 13, 17, 21, 25, 29, 33, 37 };
    json_t *root = oracle_load("montecarlo.json"), *list = oracle_get(root, "radial_profiles");

    (void) state;
    for (size_t b = 0; b < PELL_COUNT(beams); b++) {
        json_t *row = json_array_get(list, beams[b].row);
        const double scatter = oracle_number(row, "sigma_sp"), absorb = oracle_number(row, "sigma_a"), eta = oracle_number(row, "eta");
        const double mfp = oracle_number(row, "mfp_mm");
        double chi2 = 0.0;
        for (size_t k = 0; k + 1 < PELL_COUNT(first); k++) {
            const double inner = oracle_at(row, "bin_edges_mm", first[k]), outer = oracle_at(row, "bin_edges_mm", first[k + 1]);
            double expected = 0.0, square = 0.0, single = 0.0;
            struct rig_mean r;
            char name[96];
            for (size_t i = first[k]; i < first[k + 1]; i++) {
                const double lo = oracle_at(row, "bin_edges_mm", i), hi = oracle_at(row, "bin_edges_mm", i + 1);
                const double overlap = (hi * hi - lo * lo) / (outer * outer - inner * inner);
                expected += overlap * oracle_at(row, "mc_R", i);
                single += overlap * oracle_at(row, "mc_R_single", i);
                square += pow(overlap * oracle_at(row, "mc_se", i), 2.0);
            }
            r = ring(scatter, absorb, 0.0, eta, beams[b].deep * mfp, inner, outer, FEWER(beams[b].samples));
            snprintf(name, sizeof(name), "%s %s, R from %.2f to %.2f mean free paths", json_string_value(oracle_get(row, "material")),
                     json_string_value(oracle_get(row, "channel")), inner / mfp, outer / mfp);
            if (SLOW) { /* too few for reliable standard errors */
                REQUIRE(r.mean[3][1] > 0.0);
                continue;
            }
            require_within(name, r.mean[3][1], r.error[3][1], expected, sqrt(square));
            if (k < 2)
                require_within("  of one scattering", r.mean[1][1], r.error[1][1], single, sqrt(square));
            chi2 += pow(r.mean[3][1] - expected, 2.0) / (r.error[3][1] * r.error[3][1] + square);
            REQUIRE(r.error[3][1] < 0.2 * expected);
        }
        print_message("# chi^2 %.1f of %d\n", chi2, (int) PELL_COUNT(first) - 1);
    }
    json_decref(root);
}

/* The same without a boundary, and of a slab with g and a boundary: against photons. */
static void pencil_beams_of_photons(void **state)
{
    static const struct {
        struct plate plate;
        double eta;
    } cases[] = { { { 60.0, 0.8, 0.2, 0.0 }, 1.0 }, { { 2.0, 4.0, 0.1, 0.7 }, 1.4 } };
    static const double edge[] = { 0.2, 0.5, 1.0, 2.0, 4.0 };
    const int rings = (int) PELL_COUNT(edge) - 1;

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        const struct plate *p = &cases[k].plate;
        const struct planes planes = { p, 1, cases[k].eta };
        const struct tally t = photons(&planes, edge, rings, FEWER(60000), 3 + k);
        for (int i = 0; i < rings; i++) {
            const struct rig_mean r = ring(p->sigma_s, p->sigma_a, p->g, cases[k].eta, p->thickness, edge[i], edge[i + 1], FEWER(1800));
            char name[96];
            snprintf(name, sizeof(name), "n %g, g %g, R from %g to %g mm", cases[k].eta, p->g, edge[i], edge[i + 1]);
            if (SLOW)
                REQUIRE(r.mean[3][1] > 0.0);
            else
                require_within(name, r.mean[3][1], r.error[3][1], t.ring[i], t.ring_error[i]);
        }
    }
}

/* --- Stacks --------------------------------------------------------------------------------------------------------------------------- */

static size_t plate_medium(struct stage *s, const struct plate *p, double eta)
{
    return rig_medium(s, p->sigma_s, p->sigma_a, p->g, eta);
}

/* Diffuse reflectance or transmittance of plates at normal incidence, by reciprocity: under a uniform environment whose other half is
 * hidden. `boxes`: one box per plate, close together in a clear one with the boundary. Otherwise one box whose medium is layered by the
 * distance below its surface: the plates must be symmetric, or the last very deep. */
static struct rig_mean stack(const struct planes *p, bool boxes, bool back, int samples)
{
    struct pt_knobs knobs = rig_knobs();
    struct pt_scene *scene;
    struct stage s;
    struct pt_point at;
    struct rig_mean r;
    size_t m[8], clear = 0, black;
    double deep = 0.0, from = 0.0, wide;
    float half, gap;

    for (int l = 0; l < p->count; l++)
        deep += p->plate[l].thickness;
    wide = 100.0 * deep;
    half = (float) wide;
    gap = boxes ? 1e-3f * (float) deep : 0.0f;
    stage_start_threads(&s, 8, 8, 1);
    for (int l = 0; l < p->count; l++)
        m[l] = plate_medium(&s, &p->plate[l], p->eta);
    if (boxes)
        clear = plate_medium(&s, &(struct plate) { 0.0, 1e-6, 0.0, 0.0 }, p->eta);
    stage_opaque(&s, 0.0f, &black);
    stage_box(&s, boxes ? clear : m[0], 0, vec3(-half, -half, -(float) deep - gap * (float) (p->count + 1)), vec3(half, half, 0.0f));
    for (int l = 0; boxes && l < p->count; l++) {
        const double top = from + (double) gap * (l + 1);
        from += p->plate[l].thickness;
        stage_box(&s, m[l], 2 + l, vec3(-0.99f * half, -0.99f * half, (float) -(from + (double) gap * (l + 1))),
                  vec3(0.99f * half, 0.99f * half, (float) -top));
    }
    stage_box(&s, black, 1, vec3(-9 * half, -9 * half, back ? -3 * (float) deep : (float) deep),
              vec3(9 * half, 9 * half, back ? -2 * (float) deep : 2 * (float) deep));
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3(0, 0, 500), vec3(0, 0, 0), 0.0f, 7.0f);
    knobs.techniques = PT_HIT_LIGHTS;
    scene = rig_scene(&s, &knobs);
    if (!boxes) {
        struct pt_medium *medium = &scene->solid[0].medium;
        medium->layers = (p->count + 1) / 2;
        if (p->count == 2)
            medium->layers = 2; /* over a deep substrate */
        from = 0.0;
        medium->min_sigma_t = INFINITY;
        medium->homogeneous = medium->layers == 1;
        pell_free(s.ctx, medium->layer);
        pell_free(s.ctx, medium->depth);
        medium->layer = pell_calloc(s.ctx, (size_t) medium->layers, sizeof(*medium->layer));
        medium->depth = pell_calloc(s.ctx, (size_t) medium->layers, sizeof(*medium->depth));
        REQUIRE(medium->layer && medium->depth);
        for (int l = 0; l < medium->layers; l++) {
            struct pt_medium one;
            OK(pt_medium_make(s.ctx, s.scene, &s.scene->materials[m[l]], &one));
            medium->layer[l] = one.layer[0];
            from += p->plate[l].thickness;
            medium->depth[l] = l + 1 < medium->layers ? (float) from : INFINITY;
            medium->min_sigma_t = fminf(medium->min_sigma_t, one.min_sigma_t);
            for (int c = 0; c < 3; c++)
                medium->max_sigma_t[c] = fmaxf(medium->max_sigma_t[c], one.max_sigma_t[c]);
            if (l + 1 < medium->layers)
                medium->deepest = (float) from;
            pt_medium_finish(s.ctx, &one);
        }
    }
    at = rig_point(vec3(0.013f, 0.007f, 0.0f), vec3(0.013f, 0.007f, 0.4f * (float) deep), 5);
    r = rig_measure(scene, &at, back ? 0 : 4000000, samples);
    for (int k = 0; k < 4; k++) {
        r.mean[k][1] /= 1.0 - pell_fresnel(p->eta, 1.0);
        r.error[k][1] /= 1.0 - pell_fresnel(p->eta, 1.0);
    }
    pt_scene_destroy(&scene);
    stage_finish(&s);
    return r;
}

static void stacks_of_layers(void **state)
{
    static const struct plate over[] = { { 0.3, 6.0, 0.4, 0.6 }, { 60.0, 2.0, 0.15, 0.0 } };
    static const struct plate sandwich[] = { { 0.4, 5.0, 0.1, 0.7 }, { 0.8, 1.0, 0.3, 0.0 }, { 0.4, 5.0, 0.1, 0.7 } };
    static const struct plate five[] = {
        { 0.2, 5.0, 0.1, 0.7 }, { 0.3, 1.0, 0.3, 0.0 }, { 0.5, 4.0, 0.0, 0.3 }, { 0.3, 1.0, 0.3, 0.0 }, { 0.2, 5.0, 0.1, 0.7 },
    };
    static const struct plate two[] = { { 0.3, 6.0, 0.4, 0.6 }, { 1.0, 2.0, 0.15, 0.0 } };
    static const struct plate tissue[] = { { 1.0, 10.0, 0.1, 0.9 }, { 1.0, 1.0, 0.1, 0.0 }, { 2.0, 1.0, 0.2, 0.7 } };
    static const struct {
        const char *name;
        struct planes planes;
        bool boxes;
    } cases[] = {
        { "two layers, the lower deep", { over, 2, 1.4 }, false },
        { "three layers", { sandwich, 3, 1.4 }, false },
        { "three layers without a boundary", { sandwich, 3, 1.0 }, false },
        { "three media in five layers", { five, 5, 1.4 }, false },
        { "two boxes", { two, 2, 1.4 }, true },
        { "three boxes, of Wang and Jacques's example", { tissue, 3, 1.37 }, true },
    };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        const struct tally t = photons(&cases[k].planes, NULL, 0, FEWER(30000), 100 + k);
        for (int back = 1; back >= 0; back--) {
            struct rig_mean r;
            char name[96];
            if (!back && cases[k].planes.plate == over)
                continue;
            r = stack(&cases[k].planes, cases[k].boxes, back != 0, FEWER(1500));
            snprintf(name, sizeof(name), "%s, %c", cases[k].name, back ? 'R' : 'T');
            require_within(name, r.mean[3][1] - r.mean[2][1], r.error[3][1], back ? t.reflected : t.through,
                           back ? t.reflected_error : t.transmission_error);
        }
    }
}

/* --- Against each other ------------------------------------------------------------------------------------------------------------ */

static size_t channel_named(const struct stage *s, const char *name)
{
    for (size_t i = 0; i < s->image.num_channels; i++)
        if (strcmp(s->image.channels[i].name, name) == 0)
            return i;
    fail_msg("no channel %s", name);
    return 0;
}

/* A ball: the image of single-scatter against the single scattering of path-trace, at the same points. */
static void single_scattering_of_a_ball(void **state)
{
    enum { SIZE = 6 };
    static const char *const knobs[] = { SLOW ? "error=0.2" : "error=0.08", "most=20000", NULL };
    static const enum pell_light_type sources[] = { PELL_LIGHT_DIRECTIONAL, PELL_LIGHT_POINT, PELL_LIGHT_RECT };
    const float tall = 9.0f, radius = 4.0f;

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(sources); k++) {
        struct pt_knobs walk = rig_knobs();
        double sum[2] = { 0 }, bar[2] = { 0 }, square = 0.0, worst = 0.0;
        struct pt_scene *scene;
        struct stage s;
        struct shot shot;
        const float *standard_error[3];
        double quoted[SIZE * SIZE];
        size_t m, single;
        float brightest = 0.0f;
        int n = 0;

        stage_start_threads(&s, SIZE, SIZE, 1);
        m = rig_medium(&s, 1.2, 0.15, 0.4, 1.4);
        stage_ball(&s, m, 0, vec3(0, 0, 0), radius, 48);
        stage_light(&s, sources[k], vec3(8, 10, 16), vec3(0, 0, 0), k == 1 ? 1e-3f : 1.0f);
        s.scene->lights[0].width = s.scene->lights[0].height = 12.0f;
        stage_camera(&s, vec3(0, 0, 500), vec3(0, 0, 0), 0.0f, tall);
        s.settings.layers = true;
        shot = stage_shot_of(&s, "single-scatter", knobs);
        single = channel_named(&s, "diffuse.single.G");
        assert_true(pell_pass_standard_error(pell_renderer_pass(s.r), standard_error));
        for (int i = 0; i < SIZE * SIZE; i++) {
            brightest = fmaxf(brightest, (float) shot_at(&shot, single, i % SIZE, i / SIZE));
            quoted[i] = (double) standard_error[1][i / SIZE * s.image.stride + i % SIZE];
        }
        scene = rig_scene(&s, &walk);
        for (int i = 0; i < SIZE * SIZE; i++) {
            const float x = (float) (((double) (i % SIZE) + 0.5 - 0.5 * SIZE) * (double) tall / SIZE);
            const float y = (float) ((0.5 * SIZE - (double) (i / SIZE) - 0.5) * (double) tall / SIZE); /* rows go down */
            const struct pell_ray ray = { { x, y, 2.0f * radius }, 0.0f, { 0, 0, -1 }, INFINITY, PELL_RAY_TRANSLUCENT };
            const double found = shot_at(&shot, single, i % SIZE, i / SIZE);
            struct pell_hit hit;
            struct pt_point at;
            struct rig_mean r;
            double z;
            if (!pell_rays_closest(pell_renderer_services(s.r)->rays, &ray, &hit)) {
                REQUIRE(found == 0.0);
                continue;
            }
            at = rig_point(vec3(x, y, 2.0f * radius - hit.t), vec3(x, y, 500), (uint32_t) i);
            r = rig_measure(scene, &at, 0, FEWER(200));
            sum[0] += found;
            sum[1] += r.mean[1][1];
            bar[0] += quoted[i] * quoted[i];
            bar[1] += r.error[1][1] * r.error[1][1];
            z = (found - r.mean[1][1]) / hypot(quoted[i], r.error[1][1]);
            if (found < 0.05 * (double) brightest) /* in shadow, where few walks find light: only in the sums */
                continue;
            square += z * z;
            worst = fmax(worst, fabs(z));
            n++;
        }
        REQUIRE(n > 12);
        print_message("# light %zu: %d pixels, %.2f bars root mean square, %.1f at most\n", k, n, sqrt(square / n), worst);
        if (!SLOW) {
            require_within("single-scatter against path-trace's single layer", sum[0], sqrt(bar[0]), sum[1], sqrt(bar[1]));
            REQUIRE(worst < 4.5 && sqrt(square / n) < 1.5);
        } else {
            REQUIRE_NEAR(sum[0], sum[1], 0.3 * sum[1]);
        }
        pt_scene_destroy(&scene);
        shot_free(&shot);
        stage_finish(&s);
    }
}

/* Images of two seeds differ by no more than their standard errors state, with mean 0. */
static void two_seeds(void **state)
{
    enum { SIZE = 16 };
    static const char *const knobs[] = { SLOW ? "samples=16" : "samples=32", "acceleration=none", NULL };
    static double bars[2][SIZE * SIZE];
    double mean = 0.0, square = 0.0, worst = 0.0;
    struct shot shot[2];
    struct stage s;
    size_t m;
    int n = 0;

    (void) state;
    stage_start_threads(&s, SIZE, SIZE, 2);
    m = rig_medium(&s, 1.5, 0.3, 0.3, 1.4);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 4.0f, 32);
    stage_light(&s, PELL_LIGHT_POINT, vec3(8, 10, 16), vec3(0, 0, 0), 1e-3f);
    stage_environment(&s, 0.3f);
    stage_camera(&s, vec3(0, 0, 500), vec3(0, 0, 0), 0.0f, 8.4f);
    for (int k = 0; k < 2; k++) {
        const float *standard_error[3];
        s.settings.seed = 31 + k;
        shot[k] = stage_shot_of(&s, "path-trace", knobs);
        assert_true(pell_pass_standard_error(pell_renderer_pass(s.r), standard_error));
        for (int i = 0; i < SIZE * SIZE; i++)
            bars[k][i] = (double) standard_error[1][i / SIZE * s.image.stride + i % SIZE];
    }
    for (int i = 0; i < SIZE * SIZE; i++)
        if (bars[0][i] > 0.0 || bars[1][i] > 0.0) {
            const double difference = shot_at(&shot[0], SHOT_G, i % SIZE, i / SIZE) - shot_at(&shot[1], SHOT_G, i % SIZE, i / SIZE);
            const double z = difference / hypot(bars[0][i], bars[1][i]);
            mean += z;
            square += z * z;
            worst = fmax(worst, fabs(z));
            n++;
        }
    mean /= n;
    square = square / n - mean * mean;
    print_message("# two seeds, %d pixels: z has mean %.3f +- %.3f, variance %.3f, %.1f at most\n", n, mean, sqrt(square / n), square,
                  worst);
    REQUIRE(n > 150);
    if (!SLOW) {
        REQUIRE(fabs(mean) < SIGMAS * sqrt(square / n));
        REQUIRE(square > 0.5 && square < 1.25);
        REQUIRE(worst < 5.0);
    }
    shot_free(&shot[0]);
    shot_free(&shot[1]);
    stage_finish(&s);
}

/* On a very large plane the radiant exitance is the dipole's total times the irradiance. */
static void dipole_on_a_plane(void **state)
{
    static const char *const fine[] = { "error=0.02", "density=4", NULL };
    static const char *const many[] = { SLOW ? "error=0.1" : "error=0.02", "most=3000", NULL };

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct stage s;
        struct shot shot;
        const struct pell_material *material;
        size_t m;

        stage_start(&s, 4, 4);
        m = rig_medium(&s, 2.0, 0.2, 0.0, 1.3);
        s.scene->materials[m].medium.sigma_a[1] *= 2.0;
        s.scene->materials[m].medium.sigma_a[2] *= 8.0;
        stage_box(&s, m, 0, vec3(-8, -8, -6), vec3(8, 8, 0));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 3.0f);
        stage_camera(&s, vec3(0, 0, 20), vec3(0, 0, 0), 0.0f, 1.0f);
        shot = stage_shot_of(&s, k ? "dipole" : "hierarchical", k ? many : fine);
        material = &s.scene->materials[m];
        for (size_t c = 0; c < 3; c++) {
            const struct pell_dipole d = pell_dipole_make(material->medium.sigma_a[c], material->medium.sigma_s_reduced[c],
                                                          material->medium.eta, PELL_FRESNEL_EXACT);
            const double expected = pell_dipole_total(&d);
            double mean = 0.0;
            for (int i = 0; i < 16; i++)
                mean += shot_at(&shot, c, i % 4, i / 4) * PELL_PI / 3.0 / 16.0;
            print_message("# %s, channel %zu: %.5f, expected %.5f: off by %.2f %%\n", k ? "dipole" : "hierarchical", c, mean, expected,
                          100.0 * (mean / expected - 1.0));
            REQUIRE_REL(mean, expected, k == 0 ? 0.01 : SLOW ? 0.15 : 0.015);
        }
        shot_free(&shot);
        stage_finish(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(photons_are_right), cmocka_unit_test(pencil_beams_of_the_oracle),  cmocka_unit_test(pencil_beams_of_photons),
        cmocka_unit_test(stacks_of_layers),  cmocka_unit_test(single_scattering_of_a_ball), cmocka_unit_test(two_seeds),
        cmocka_unit_test(dipole_on_a_plane),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
