/* SPDX-License-Identifier: MIT
 * test_layered.c - painted layers: the ray march against closed forms, its light paths, the fitted planes, and hostile scenes. */
#include "stage.h"

#include "base/simd.h"
#include "methods/layered/layered.h"

#include <string.h>

/* --- Scenes --------------------------------------------------------------------------------------------------------------------- */

struct test_layer {
    double thickness, sigma_s, sigma_t;
    struct pell_phase phase;
};

static struct pell_phase schlick(double k)
{
    return (struct pell_phase) { PELL_PHASE_SCHLICK, { k, 0.0 }, 0.0 };
}

/* Gives material 0 layers, equal in all channels; depths are sums of thicknesses. */
static struct pell_material *give_layers(struct stage *s, const struct test_layer *list, int count, double eta)
{
    struct pell_material *m = stage_medium(s, "marble", NULL);
    double bottom = 0.0;

    m->medium.eta = eta;
    m->layers = pell_calloc(s->ctx, (size_t) count, sizeof(*m->layers));
    assert_non_null(m->layers);
    m->num_layers = count;
    m->substrate = PELL_SUBSTRATE_STOP;
    for (int i = 0; i < count; i++) {
        struct pell_scene_layer *l = &m->layers[i];
        l->name = pell_strdup(s->ctx, "layer");
        l->medium.eta = eta;
        bottom += list[i].thickness;
        l->depth = (float) bottom;
        for (int c = 0; c < 3; c++) {
            l->phase[c] = list[i].phase;
            l->medium.g[c] = pell_phase_mean_cosine(&list[i].phase);
            l->medium.sigma_s_reduced[c] = list[i].sigma_s * (1.0 - l->medium.g[c]);
            l->medium.sigma_a[c] = list[i].sigma_t - list[i].sigma_s;
        }
    }
    return m;
}

/* Single scattering of plane-parallel layers, for light of irradiance 1 across its beam: cosines to the normal inside, and the cosine
 * between the directions to the light and to the camera inside. */
static double closed_form(const struct test_layer *list, int count, double mu_o, double mu_i, double cosine)
{
    const double m = 1.0 / mu_o + 1.0 / mu_i;
    double sum = 0.0, depth = 0.0;

    for (int i = 0; i < count; i++) {
        const double t = list[i].sigma_t, z = t * list[i].thickness * m;
        sum += list[i].sigma_s * pell_phase_value(&list[i].phase, cosine) / mu_o * exp(-depth * m) *
               (z > 1e-9 ? -expm1(-z) / (t * m) : list[i].thickness);
        depth += t * list[i].thickness;
    }
    return sum;
}

/* The layers of tests/expect/oracle/errata_demos.json, seed001_ray_march, and their radiance for mu_o 0.9, mu_i 0.7, cosine 0.3. */
static const struct test_layer fish[3] = {
    { 0.5, 2.0, 2.6, { PELL_PHASE_SCHLICK, { 0.25, 0.0 }, 0.0 } },
    { 0.5, 6.0, 6.6, { PELL_PHASE_SCHLICK, { 0.4, 0.0 }, 0.0 } },
    { 2.0, 1.0, 1.5, { PELL_PHASE_SCHLICK, { 0.8, 0.0 }, 0.0 } },
};
#define FISH 0.0217062584

/* A slab whose upper side is z = 0, seen from above at mu_o and lit at mu_i; `turn`: radians between both azimuths. */
static void slab(struct stage *s, double mu_o, double mu_i, double turn)
{
    const double so = sqrt(1.0 - mu_o * mu_o), si = sqrt(1.0 - mu_i * mu_i);
    const struct pell_vec3 camera = vec3((float) (100.0 * so), 0.0f, (float) (100.0 * mu_o));

    stage_box(s, 0, 0, vec3(-300, -300, -80), vec3(300, 300, 0));
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3((float) (si * cos(turn)), (float) (si * sin(turn)), (float) mu_i), vec3(0, 0, 0), 1.0f);
    stage_camera(s, camera, vec3(0, 0, 0), 0.0f, 4.0f);
}

static double cosine_of(double mu_o, double mu_i, double turn)
{
    return mu_o * mu_i + sqrt((1.0 - mu_o * mu_o) * (1.0 - mu_i * mu_i)) * cos(turn);
}

/* Mean of green over covered pixels, by marches that do not end early. */
static double mean_of(struct stage *s, const char *const *knobs)
{
    const char *list[16] = { "tolerance=0" };
    struct shot shot;
    double mean;

    for (int i = 0; knobs && knobs[i]; i++)
        list[i + 1] = knobs[i];
    shot = stage_shot_of(s, "layered", list);
    mean = shot_mean_green(&shot);
    shot_free(&shot);
    return mean;
}

static double slab_mean(const struct test_layer *list, int count, double eta, double mu_o, double mu_i, double turn,
                        const char *const *knobs)
{
    struct stage s;
    double mean;

    stage_start(&s, 8, 8);
    give_layers(&s, list, count, eta);
    slab(&s, mu_o, mu_i, turn);
    mean = mean_of(&s, knobs);
    stage_finish(&s);
    return mean;
}

/* --- Closed forms --------------------------------------------------------------------------------------------------------------- */

static void homogeneous(void **state)
{
    static const char *const sum[4][6] = {
        { "refraction=none", "march=sum", "samples=10", NULL },
        { "refraction=none", "march=sum", "samples=20", NULL },
        { "refraction=none", "march=sum", "samples=40", NULL },
        { "refraction=none", "march=sum", "samples=80", NULL },
    };
    static const char *const exact[] = { "refraction=none", "samples=3", NULL };
    const double mu_o = 0.8, mu_i = 0.6, turn = 1.0, expected = closed_form(fish, 1, mu_o, mu_i, cosine_of(mu_o, mu_i, turn));
    double error[4];

    (void) state;
    for (int i = 0; i < 4; i++) {
        error[i] = slab_mean(fish, 1, 1.4, mu_o, mu_i, turn, sum[i]) / expected - 1.0;
        print_message("# %d samples, plain sum: %.3g\n", 10 << i, error[i]);
    }
    /* The midpoint rule: second order. */
    for (int i = 1; i < 4; i++)
        REQUIRE_NEAR(error[i - 1] / error[i], 4.0, 0.25);
    REQUIRE_REL(slab_mean(fish, 1, 1.4, mu_o, mu_i, turn, exact), expected, 3e-5);
}

static void three_layers(void **state)
{
    static const int samples[] = { 1, 7, 20, 100 };
    const double mu_o = 0.9, mu_i = 0.7, turn = acos((0.5 - mu_o * mu_i) / sqrt((1.0 - mu_o * mu_o) * (1.0 - mu_i * mu_i)));
    struct test_layer same[3];

    (void) state;
    REQUIRE_REL(closed_form(fish, 3, mu_o, mu_i, 0.3), FISH, 1e-8);
    /* No two directions with these cosines have a cosine of 0.3 between them: other phase functions take the same values at 0.5. */
    memcpy(same, fish, sizeof(same));
    for (int i = 0; i < 3; i++) {
        const double p = pell_phase_value(&fish[i].phase, 0.3) * 4.0 * PELL_PI, a = p * 0.25 + 1.0, b = p * 0.5;
        same[i].phase = schlick((-b + sqrt(b * b - a * (p - 1.0))) / a);
    }
    for (size_t k = 0; k < PELL_COUNT(samples); k++) {
        char text[32];
        const char *const knobs[] = { "refraction=none", text, NULL };
        double mean;
        snprintf(text, sizeof(text), "samples=%d", samples[k]);
        mean = slab_mean(same, 3, 1.4, mu_o, mu_i, turn, knobs);
        print_message("# %d samples: %.9f, expected %.9f\n", samples[k], mean, FISH);
        REQUIRE_REL(mean, FISH, 3e-5);
    }
    {
        /* As in the paper: the oracle's midpoint rule with 100 samples is 0.00372 too low. */
        static const char *const paper[] = { "as=paper", NULL };
        const double mean = slab_mean(same, 3, 1.4, mu_o, mu_i, turn, paper);
        print_message("# as the paper: %.9f\n", mean);
        REQUIRE_REL(mean, 0.02162542158, 1e-4);
    }
}

static void refracting_slab(void **state)
{
    static const double etas[] = { 1.0, 1.33, 1.5 };
    static const char *const knobs[] = { "samples=5", NULL };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(etas); k++)
        for (int oblique = 0; oblique < 2; oblique++) {
            const double eta = etas[k], mu_o = oblique ? 0.35 : 0.85, mu_i = oblique ? 0.3 : 0.7, turn = 2.0;
            const double to = sqrt(1.0 - (1.0 - mu_o * mu_o) / (eta * eta)), ti = sqrt(1.0 - (1.0 - mu_i * mu_i) / (eta * eta));
            const double cosine = cos(turn) * sqrt((1.0 - to * to) * (1.0 - ti * ti)) + to * ti;
            const double enter = (1.0 - pell_fresnel(eta, mu_i)) * mu_i / ti, leave = (1.0 - pell_fresnel(eta, mu_o)) / (eta * eta);
            const double mean = slab_mean(fish, 3, eta, mu_o, mu_i, turn, knobs);
            const double expected = enter * leave * closed_form(fish, 3, to, ti, cosine);
            print_message("# eta %.2f, %s: %.8f, expected %.8f\n", eta, oblique ? "oblique" : "steep", mean, expected);
            REQUIRE_REL(mean, expected, 1e-4);
        }
}

/* Marches that end early lose no more than their tolerance, in thin and in thick layers. */
static void early_end(void **state)
{
    static const char *const tolerances[] = { "tolerance=0.1", "tolerance=0.01", "tolerance=0.001" };
    const double mu_o = 0.9, mu_i = 0.7, turn = 1.0;

    (void) state;
    for (int thick = 0; thick < 2; thick++) {
        struct test_layer list[3];
        double whole, before = 1.0;
        memcpy(list, fish, sizeof(list));
        for (int i = 0; i < 3; i++)
            list[i].thickness *= thick ? 4.0 : 1.0;
        whole = closed_form(list, 3, mu_o, mu_i, cosine_of(mu_o, mu_i, turn));
        for (size_t k = 0; k < PELL_COUNT(tolerances); k++) {
            const char *const knobs[] = { "refraction=none", "samples=100", tolerances[k], NULL };
            const double lost = 1.0 - slab_mean(list, 3, 1.4, mu_o, mu_i, turn, knobs) / whole;
            print_message("# %s, %s: %.5f lost\n", thick ? "thick" : "thin", tolerances[k], lost);
            REQUIRE(lost > -1e-4 && lost < atof(tolerances[k] + 10) && lost <= before);
            before = lost;
        }
        REQUIRE(before > 1e-5); /* the march ended early */
    }
}

static void phases(void **state)
{
    static const struct pell_phase kinds[] = {
        { PELL_PHASE_HENYEY_GREENSTEIN, { 0.0, 0.0 }, 0.0 },  { PELL_PHASE_HENYEY_GREENSTEIN, { 0.9, 0.0 }, 0.0 },
        { PELL_PHASE_HENYEY_GREENSTEIN, { -0.6, 0.0 }, 0.0 }, { PELL_PHASE_SCHLICK, { 0.7, 0.0 }, 0.0 },
        { PELL_PHASE_RAYLEIGH, { 0.0, 0.0 }, 0.0 },           { PELL_PHASE_TWO_LOBE, { 0.8, -0.3 }, 0.7 },
    };
    static const char *const knobs[] = { "refraction=none", "samples=4", NULL };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(kinds); k++)
        for (int back = 0; back < 2; back++) {
            const struct test_layer one = { 1.5, 0.7, 1.1, kinds[k] };
            const double mu_o = 0.5, mu_i = 0.4, turn = back ? 0.1 : 3.0;
            REQUIRE_REL(slab_mean(&one, 1, 1.4, mu_o, mu_i, turn, knobs), closed_form(&one, 1, mu_o, mu_i, cosine_of(mu_o, mu_i, turn)),
                        2e-4);
        }
}

static void clear_and_many(void **state)
{
    static const char *const knobs[] = { "refraction=none", "samples=6", NULL };
    struct test_layer many[PELL_LAYERS_MOST];

    (void) state;
    { /* an empty layer, then one that only scatters: no division by sigma_t = 0 */
        const struct test_layer two[2] = { { 1.0, 0.0, 0.0, schlick(0.2) }, { 2.0, 0.8, 0.8, schlick(0.2) } };
        REQUIRE_REL(slab_mean(two, 2, 1.4, 0.8, 0.7, 0.5, knobs), closed_form(two, 2, 0.8, 0.7, cosine_of(0.8, 0.7, 0.5)), 1e-4);
        REQUIRE_NEAR(slab_mean(two, 1, 1.4, 0.8, 0.7, 0.5, knobs), 0.0, 0.0);
    }
    for (int count = 32; count <= PELL_LAYERS_MOST; count += 32) {
        for (int i = 0; i < count; i++)
            many[i] = (struct test_layer) { 0.02 + 0.001 * i, 0.5 + 0.3 * (i % 4), 1.0 + 0.5 * (i % 4), schlick(0.1 * (i % 7)) };
        REQUIRE_REL(slab_mean(many, count, 1.4, 0.8, 0.7, 0.5, knobs), closed_form(many, count, 0.8, 0.7, cosine_of(0.8, 0.7, 0.5)), 2e-4);
    }
}

/* --- Painted layers ------------------------------------------------------------------------------------------------------------- */

/* A map of 8 x 8 texels with red `red` and green `green`. */
static struct pell_texture *paint(struct stage *s, const uint8_t red[64], const uint8_t green[64])
{
    uint8_t pixels[3 * 64] = { 0 };

    for (int i = 0; i < 64; i++) {
        pixels[3 * i] = red[i];
        pixels[3 * i + 1] = green[i];
    }
    return shapes_texture(s->scene, 8, 8, 3, false, pixels);
}

static void set_map(struct pell_scene_layer *l, const struct pell_texture *t, int channel, const float matrix[6], float depth)
{
    l->depth_map = (struct pell_texture_map) { .texture = t, .channel = channel };
    memcpy(l->depth_map.matrix, matrix, sizeof(l->depth_map.matrix));
    l->depth = depth;
}

static void uniform_paint(void **state)
{
    static const char *const knobs[] = { "refraction=none", "samples=9", NULL };
    static const float straight[6] = { 1, 0, 0, 0, 1, 0 };
    const struct test_layer two[2] = { { 102.0 / 255.0, 2.0, 2.6, schlick(0.25) }, { 2.0 - 102.0 / 255.0, 1.0, 1.5, schlick(0.4) } };
    const double mu_o = 0.6, mu_i = 0.5, expected = closed_form(two, 2, mu_o, mu_i, cosine_of(mu_o, mu_i, 2.0));

    (void) state;
    for (int wrap = PELL_WRAP_REPEAT; wrap <= PELL_WRAP_MIRROR; wrap++)
        for (int nearest = 0; nearest < 2; nearest++) {
            uint8_t red[64], green[64];
            struct pell_texture *t;
            struct pell_material *m;
            struct pell_mesh *mesh;
            struct stage s;
            stage_start(&s, 8, 8);
            memset(red, 102, sizeof(red));
            memset(green, 255, sizeof(green));
            t = paint(&s, red, green);
            t->wrap_u = t->wrap_v = (enum pell_wrap) wrap;
            t->nearest = nearest != 0;
            m = give_layers(&s, two, 2, 1.4);
            set_map(&m->layers[0], t, 0, straight, 1.0f);
            set_map(&m->layers[1], t, 1, straight, 2.0f);
            mesh = shapes_quad(s.scene, 0, vec3(0, 0, 0), vec3(100, 0, 0), vec3(0, 100, 0));
            (void) mesh;
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3((float) (sqrt(0.75) * cos(2.0)), (float) (sqrt(0.75) * sin(2.0)), 0.5f),
                        vec3(0, 0, 0), 1.0f);
            stage_camera(&s, vec3(80, 0, 60), vec3(0, 0, 0), 0.0f, 4.0f);
            REQUIRE_REL(mean_of(&s, knobs), expected, 1e-4);
            stage_finish(&s);
        }
}

/* The same map with mirrored, scaled and rotated texture coordinates gives the same image. */
static void uv_of_any_kind(void **state)
{
    const struct test_layer two[2] = { { 0.5, 2.0, 2.6, schlick(0.25) }, { 1.5, 1.0, 1.5, schlick(0.4) } };
    static const float straight[6] = { 1, 0, 0, 0, 1, 0 }, turned[6] = { 0, -1, 1, 1, 0, 0 };
    static const char *const knobs[] = { "samples=16", NULL };
    struct shot first = { 0 };

    (void) state;
    for (int kind = 0; kind < 4; kind++) {
        uint8_t red[64], green[64];
        struct pell_texture *t;
        struct pell_material *m;
        struct pell_mesh *mesh;
        struct shot shot;
        struct stage s;
        stage_start(&s, 40, 40);
        for (int i = 0; i < 64; i++) {
            const int from = kind == 1 ? (i & ~7) + 7 - (i & 7) : i; /* the image is mirrored, too */
            red[i] = (uint8_t) (40 + (from * 37) % 160);
            green[i] = (uint8_t) (120 + (from * 53) % 130);
        }
        t = paint(&s, red, green);
        m = give_layers(&s, two, 2, 1.4);
        set_map(&m->layers[0], t, 0, kind == 3 ? turned : straight, 2.0f);
        set_map(&m->layers[1], t, 1, kind == 3 ? turned : straight, 4.0f);
        mesh = shapes_quad(s.scene, 0, vec3(0, 0, 0), vec3(16, 0, 0), vec3(0, 16, 0));
        for (uint32_t i = 0; i < mesh->num_vertices; i++) {
            float *uv = mesh->uv[0] + 2 * i;
            const float u = uv[0], v = uv[1];
            uv[0] = kind == 1 ? 1.0f - u : kind == 2 ? u + 3.0f : kind == 3 ? v : u;
            uv[1] = kind == 2 ? v - 5.0f : kind == 3 ? 1.0f - u : v;
        }
        stage_light(&s, PELL_LIGHT_POINT, vec3(-20, 30, 25), vec3(0, 0, 0), 1.0f);
        stage_camera(&s, vec3(30, -20, 40), vec3(0, 0, 0), 0.4f, 0.0f);
        shot = stage_shot_of(&s, "layered", knobs);
        if (kind == 0) {
            first = shot;
            REQUIRE(shot_difference(&first, &first).mean > 1e-4);
        } else {
            const struct difference d = shot_difference(&first, &shot);
            print_message("# coordinates %d: rms %.2g, largest %.2g of the mean\n", kind, d.rms, d.largest);
            REQUIRE(d.largest < 2e-3);
            shot_free(&shot);
        }
        stage_finish(&s);
    }
    shot_free(&first);
}

/* Texels that are NaN or negative, and layers that cross. */
static void hostile_paint(void **state)
{
    static const float straight[6] = { 1, 0, 0, 0, 1, 0 };
    float pixels[4 * 4] = { NAN, -3.0f, INFINITY, 0.5f, -INFINITY, 1e30f, 1.0f, 0.0f };
    struct pell_texture texture = { .name = (char[]) { "map" }, .image = { 4, 4, 1, PELL_PIXEL_F32, false, pixels } };
    const struct pell_texture_map map = { .texture = &texture, .matrix = { straight[0], 0, 0, 0, 1, 0 } };
    struct kept_messages kept;
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_medium_layers *medium_layers = calloc(1, sizeof(*medium_layers));
    struct layered_medium m;

    (void) state;
    medium_layers->eta = 1.3;
    medium_layers->count = 2;
    medium_layers->substrate = PELL_SUBSTRATE_STOP;
    medium_layers->has_maps = true;
    for (int i = 0; i < 2; i++)
        medium_layers->item[i] =
            (struct pell_layer_medium) { .name = "", .sigma_s = { 1, 1, 1 }, .sigma_t = { 2, 2, 2 }, .depth = 3.0, .map = &map };
    OK(layered_medium_make(ctx, medium_layers, "test", LAYERED_AS_MATERIAL, &m));
    assert_int_equal(m.packs, 1);
    assert_int_equal(m.pack[0].count, 2);
    REQUIRE(isfinite(m.deepest) && m.deepest >= 0.0f && m.deepest < 1e8f);
    REQUIRE_REL((double) m.layer[0].depth, 3.0, 1e-6); /* 1 is the largest of them */
    layered_medium_finish(ctx, &m);
    texture.image.width = 0;
    assert_int_equal(layered_medium_make(ctx, medium_layers, "test", LAYERED_AS_MATERIAL, &m), PELL_ERR_UNSUPPORTED);
    assert_non_null(strstr(kept.what, "map"));
    free(medium_layers);
    pell_context_destroy(&ctx);
}

/* --- Light paths ---------------------------------------------------------------------------------------------------------------- */

PELL_SIMD_TABLES(struct layered_kernels, layered_kernels);

static uint32_t bits_of(float x)
{
    uint32_t bits;

    memcpy(&bits, &x, sizeof(bits));
    return bits;
}

/* |K'M| = depth / cos for every sample on a flat slab; all SIMD levels give the same bits. */
static void paths_on_a_slab(void **state)
{
    struct layered_layer layer[2] = { { .depth = 0.7f, .pack = -1, .sigma_s = { 1, 2, 3 }, .sigma_t = { 2, 3, 4 }, .one_phase = true },
                                      { .depth = 2.0f, .pack = -1, .sigma_s = { 1, 2, 3 }, .sigma_t = { 1, 2, 5 }, .one_phase = true } };
    float edges[12];
    const struct layered_medium m = { .count = 2, .layer = layer, .eta = 1.4f, .deepest = 2.0f, .first = 2.0f, .edges = { edges, edges } };
    struct layered_packet *p = NULL;
    struct layered_light source;
    float trace[11 * 16], light[3][16];

    (void) state;
    for (int i = 0; i < 2; i++)
        for (int c = 0; c < 3; c++) {
            layer[i].phase[c] =
                (struct pell_phase_terms) { .shape = PELL_PHASE_TERMS_HENYEY_GREENSTEIN, .n = { 0.06f }, .a = { 1.09f }, .b = { 0.6f } };
            layer[i].sigma_t2[c] = 1.442695f * layer[i].sigma_t[c];
            layer[i].max_tau2 = fmaxf(layer[i].max_tau2, layer[i].sigma_t2[c]);
        }
    for (int i = 0; i < 12; i++)
        edges[i] = (float) i / 11.0f;
    assert_int_equal(posix_memalign((void **) &p, 64, sizeof(*p)), 0);
    for (int level = 0; level < PELL_SIMD_LEVELS && level <= (int) pell_simd_best(); level++) {
        const struct layered_work work = { .max_tau2 = INFINITY,
                                           .samples = 11,
                                           .exponential = true,
                                           .rest = true,
                                           .nodes = LAYERED_RAY_NODES,
                                           .node = { 0.004f, 0.04f, 0.16f, 0.45f, 0.99f } };
        memset(p, 0, sizeof(*p));
        memset(&source, 0, sizeof(source));
        for (int i = 0; i < 16; i++) {
            const double a = 0.09 * i, up = 0.2 + 0.05 * i;
            for (int c = 0; c < 3; c++) {
                p->normal[c][2][i] = p->plane[c][2][i] = 1.0f;
                p->corner[c][c == 1 ? 0 : 1][i] = c > 0 ? 1.0f : 0.0f;
            }
            p->u[i] = 0.3f;
            p->v[i] = 0.2f;
            p->camera[0][i] = (float) sin(a);
            p->camera[2][i] = (float) cos(a);
            p->spacing[i] = 0.1f;
            source.to[1][i] = (float) sqrt(1.0 - up * up);
            source.to[2][i] = (float) up;
            source.planes[i] = source.seen[i] = 1.0f;
            for (int c = 0; c < 3; c++)
                source.power[c][i] = 1.0f;
        }
        p->count = 16;
        source.distant = source.any_planes = true;
        p->trace = trace;
        layered_kernels_tables[level]->start(&work, &m, p);
        layered_kernels_tables[level]->march(&work, &m, p, &source, 1);
        for (int i = 0; i < 16; i++)
            for (int k = 0; k < 11; k++) {
                const double depth = 2.0 * (k + 0.5) / 11, expected = depth / (double) source.to[2][i];
                REQUIRE_REL((double) trace[k * 16 + i], expected, 1e-5);
            }
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < 16; i++) {
                REQUIRE(p->light[c][i] > 0.0f);
                if (level > 0)
                    assert_int_equal(bits_of(p->light[c][i]), bits_of(light[c][i]));
                light[c][i] = p->light[c][i];
            }
        /* The general march gives the same result as the specialised one: a surface too far away to contribute selects it. */
        p->thin = true;
        memset(p->light, 0, sizeof(p->light));
        layered_kernels_tables[level]->march(&work, &m, p, &source, 1);
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < 16; i++)
                REQUIRE_REL((double) p->light[c][i], (double) light[c][i], 1e-5);
    }
    free(p);
}

/* A ball, without refraction: chords give all path lengths. Single scattering of a light at the cosine of `angle` to the camera, along
 * the diameter that the camera sees. */
static double ball_closed_form(double radius, double sigma_s, double sigma_t, double g, double angle)
{
    const int steps = 20000;
    const double cosine = cos(angle), end = fmin(2.0 * radius, 40.0 / sigma_t), h = end / steps;
    const struct pell_phase phase = { PELL_PHASE_HENYEY_GREENSTEIN, { g, 0.0 }, 0.0 };
    double sum = 0.0;

    for (int i = 0; i < steps; i++) { /* the camera looks along a diameter; the light is at `angle` from the camera */
        const double x = (i + 0.5) * h, r = radius - x, b = r * cosine; /* point at height r on the axis */
        const double out = -b + sqrt(b * b + radius * radius - r * r);
        sum += h * exp(-sigma_t * (x + out));
    }
    return sum * sigma_s * pell_phase_value(&phase, cosine);
}

/* The middle of a ball, with a light at an angle to the camera. */
static double ball_layered(double radius, double sigma_s, double sigma_t, double g, double angle, const char *const *knobs)
{
    const struct test_layer one = { 1.0, sigma_s, sigma_t, { PELL_PHASE_HENYEY_GREENSTEIN, { g, 0.0 }, 0.0 } };
    struct pell_material *m;
    struct stage s;
    double mean;

    stage_start(&s, 4, 4);
    m = give_layers(&s, &one, 1, 1.4);
    m->substrate = PELL_SUBSTRATE_LAST;
    stage_ball(&s, 0, 0, vec3(0, 0, 0), (float) radius, 40);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.0f, (float) sin(angle), (float) cos(angle)), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 0.02f * (float) radius);
    mean = mean_of(&s, knobs);
    stage_finish(&s);
    return mean;
}

static void balls(void **state)
{
    static const double radii[] = { 10.0, 3.0 }, degrees[] = { 20, 60, 85, 100, 140 };
    static const char *const ours[] = { "refraction=none", "samples=40", NULL };
    static const char *const rays[] = { "refraction=none", "samples=40", "light-path=rays", NULL };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(radii); k++)
        for (size_t a = 0; a < PELL_COUNT(degrees); a += SLOW ? 2 : 1) {
            const double angle = degrees[a] * PELL_PI / 180.0, expected = ball_closed_form(radii[k], 0.8, 1.0, 0.5, angle);
            const double best = ball_layered(radii[k], 0.8, 1.0, 0.5, angle, ours) / expected - 1.0;
            const double ray = ball_layered(radii[k], 0.8, 1.0, 0.5, angle, rays) / expected - 1.0;
            print_message("# radius %2.0f mm, light %3.0f degrees from the camera: planes+rays %6.2f %%, rays %6.2f %%   (%.3g)\n",
                          radii[k], degrees[a], 100.0 * best, 100.0 * ray, expected);
            if (expected > 1e-6)
                REQUIRE(fabs(best) < (radii[k] >= 10.0 ? 0.06 : 0.1) && fabs(ray) < 0.06);
        }
    /* Backlit it is darker than lit from the front. */
    REQUIRE(ball_layered(5.0, 0.8, 1.0, 0.0, PELL_PI, ours) < 0.2 * ball_layered(5.0, 0.8, 1.0, 0.0, 0.3, ours));
}

/* Packets in which some pixels' light paths use planes, some rays, some both have no bright seams. */
static void terminator(void **state)
{
    static const char *const kinds[2][2] = { { "light-path=planes+rays", NULL }, { "light-path=rays", NULL } };
    double most[2] = { 0 };

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct shot shot;
        struct stage s;
        stage_start(&s, 48, 48);
        give_layers(&s, fish, 3, 1.4);
        stage_ball(&s, 0, 0, vec3(0, 0, 0), 20.0f, 40);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(-1.0f, 0.2f, 0.3f), vec3(0, 0, 0), 1.0f);
        stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 42.0f);
        shot = stage_shot_of(&s, "layered", kinds[k]);
        for (int i = 0; i < 48 * 48; i++)
            most[k] = fmax(most[k], shot_at(&shot, SHOT_G, i % 48, i / 48));
        shot_free(&shot);
        stage_finish(&s);
    }
    print_message("# brightest: %.4g, by rays alone %.4g\n", most[0], most[1]);
    REQUIRE(most[0] < 1.15 * most[1]);
}

/* --- Fitted planes -------------------------------------------------------------------------------------------------------------- */

static void planes(void **state)
{
    enum { SIDE = 60, COUNT = SIDE * SIDE };
    struct kept_messages kept;
    struct layered_cloud c = { .ctx = test_context(NULL, &kept), .count = COUNT, .fitted = COUNT, .radius = 6.0f };
    float(*plane)[4] = calloc(COUNT, sizeof(*plane));
    const struct pell_vec3 n = vec3_normalize(vec3(0.3f, -0.5f, 0.8f));
    struct pell_vec3 t, b;

    (void) state;
    OK(pell_pool_create(c.ctx, 2, &c.pool));
    c.position = calloc(3 * COUNT, sizeof(float));
    c.normal = calloc(3 * COUNT, sizeof(float));
    c.weight = calloc(COUNT, sizeof(float));
    vec3_basis(n, &t, &b);
    /* A plane, whatever the vertex normals are; and a second one close behind with the opposite orientation, as in a fin. */
    for (int i = 0; i < COUNT; i++) {
        const bool back = i % 2 != 0;
        const float x = 0.7f * (float) (i % SIDE), y = 0.7f * (float) (i / SIDE);
        const struct pell_vec3 at = vec3_mad(vec3_mad(vec3_mul(t, x), y, b), back ? -0.8f : 0.0f, n);
        vec3_store(at, c.position + 3 * i);
        vec3_store(vec3_normalize(vec3_mad(vec3_mul(n, back ? -1.0f : 1.0f), 0.2f * sinf((float) i), t)), c.normal + 3 * i);
        c.weight[i] = 1.0f;
    }
    OK(layered_planes_fit(&c, plane));
    for (int i = 0; i < COUNT; i++) {
        REQUIRE_NEAR((double) vec3_dot(vec3_load(plane[i]), n), i % 2 ? -1.0 : 1.0, 1e-5);
        REQUIRE_NEAR((double) plane[i][3], 0.0, 1e-4);
    }
    /* A ball of 20 mm, uniformly covered (a golden spiral): the cap within r of a vertex reaches down to r^2/(2 R), its mean half as
     * far. */
    for (int i = 0; i < COUNT; i++) {
        const double z = 1.0 - 2.0 * (i + 0.5) / COUNT, r = sqrt(1.0 - z * z), phi = 2.399963229728653 * i;
        const struct pell_vec3 up = vec3((float) (r * cos(phi)), (float) (r * sin(phi)), (float) z);
        vec3_store(up, c.normal + 3 * i);
        vec3_store(vec3_mul(up, 20.0f), c.position + 3 * i);
    }
    OK(layered_planes_fit(&c, plane));
    for (int i = 0; i < COUNT; i++) {
        REQUIRE((double) vec3_dot(vec3_load(plane[i]), vec3_load(c.normal + 3 * i)) > 0.999);
        REQUIRE_NEAR((double) plane[i][3], -0.5 * 36.0 / 40.0, 0.05);
    }
    /* Few neighbours, coincident, collinear or NaN: each vertex uses its own tangent plane. */
    c.radius = 0.01f;
    OK(layered_planes_fit(&c, plane));
    REQUIRE_NEAR((double) plane[7][3], 0.0, 0.0);
    c.radius = 1e9f;
    OK(layered_planes_fit(&c, plane));
    for (int i = 0; i < COUNT; i++)
        REQUIRE(isfinite(plane[i][3]));
    for (int i = 0; i < 3 * COUNT; i++)
        c.position[i] = i % 3 == 0 ? (float) i : 1.0f;
    c.radius = 50.0f;
    OK(layered_planes_fit(&c, plane));
    for (int i = 0; i < COUNT; i++)
        REQUIRE_NEAR((double) plane[i][3], 0.0, 0.0);
    pell_pool_destroy(&c.pool);
    free(plane);
    free(c.position);
    free(c.normal);
    free(c.weight);
    pell_context_destroy(&c.ctx);
}

/* --- Lights, sheets, threads ----------------------------------------------------------------------------------------------------- */

/* A backlit sheet without an opposite side: light enters where the layers end. */
static void sheet(void **state)
{
    static const char *const knobs[] = { "refraction=none", "samples=12", NULL };
    const struct test_layer one = { 0.8, 0.9, 1.3, schlick(0.3) };
    const double mu_o = 0.8, mu_i = 0.6, cosine = -mu_o * mu_i, t = 0.8 * 1.3;
    const double a = 1.0 / mu_o - 1.0 / mu_i, p = pell_phase_value(&one.phase, cosine);
    const double expected = 0.9 * p / mu_o * exp(-t / mu_i) * -expm1(-a * t) / (1.3 * a);
    struct stage s;

    (void) state;
    stage_start(&s, 6, 6);
    give_layers(&s, &one, 1, 1.4);
    shapes_quad(s.scene, 0, vec3(0, 0, 0), vec3(50, 0, 0), vec3(0, 50, 0));
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.0f, 0.8f, -0.6f), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(60, 0, 80), vec3(0, 0, 0), 0.0f, 4.0f);
    REQUIRE_REL(mean_of(&s, knobs), expected, 3e-3);
    stage_finish(&s);
}

/* The same light through a slab with an opposite side: its own layers are measured from there. */
static void slab_from_behind(void **state)
{
    static const char *const knobs[] = { "refraction=none", "samples=40", NULL };
    const struct test_layer two[2] = { { 0.5, 0.9, 1.3, schlick(0.3) }, { 50.0, 0.4, 0.6, schlick(0.3) } };
    const double mu_o = 0.8, mu_i = 0.6, thick = 2.0, cosine = -mu_o * mu_i;
    double sum = 0.0, tau = 0.0, whole = 2.0 * 0.5 * 1.3 + 1.0 * 0.6;
    const int steps = 20000;
    struct stage s;

    (void) state;
    for (int i = 0; i < steps; i++) { /* 0.5 mm, 1 mm of the deeper medium, 0.5 mm */
        const double z = (i + 0.5) / steps * thick, h = thick / steps;
        const bool inner = z > 0.5 && z < 1.5;
        const double sigma_t = inner ? 0.6 : 1.3, sigma_s = inner ? 0.4 : 0.9, here = tau + 0.5 * h * sigma_t;
        sum += h / mu_o * sigma_s * exp(-here / mu_o - (whole - here) / mu_i);
        tau += h * sigma_t;
    }
    stage_start(&s, 6, 6);
    give_layers(&s, two, 2, 1.4)->substrate = PELL_SUBSTRATE_LAST;
    stage_box(&s, 0, 0, vec3(-200, -200, -2), vec3(200, 200, 0));
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.0f, 0.8f, -0.6f), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(60, 0, 80), vec3(0, 0, 0), 0.0f, 4.0f);
    REQUIRE_REL(mean_of(&s, knobs), sum * pell_phase_value(&two[0].phase, cosine), 0.02);
    stage_finish(&s);
}

/* A Lambertian surface below clear layers. */
static void bottom(void **state)
{
    static const char *const knobs[] = { "refraction=none", "samples=5", NULL };
    const struct test_layer one = { 0.8, 0.0, 0.7, schlick(0.0) };
    const double mu_o = 0.8, mu_i = 0.6;
    struct pell_material *m;
    struct stage s;

    (void) state;
    stage_start(&s, 6, 6);
    m = give_layers(&s, &one, 1, 1.4);
    m->substrate = PELL_SUBSTRATE_SURFACE_COLOR;
    m->base_color[0] = m->base_color[1] = m->base_color[2] = 0.6f;
    slab(&s, mu_o, mu_i, 1.0);
    REQUIRE_REL(mean_of(&s, knobs), 0.6 / PELL_PI * mu_i * exp(-0.8 * 0.7 * (1.0 / mu_o + 1.0 / mu_i)), 1e-3);
    stage_finish(&s);
}

/* Lights of all kinds are additive. */
static void lights_add_up(void **state)
{
    static const char *const knobs[] = { "samples=8", "lamps=3", "tolerance=0", NULL };
    struct shot one[7] = { { 0 } };

    (void) state;
    for (int run = 0; run < 7; run++) {
        struct stage s;
        stage_start_threads(&s, 40, 30, 1);
        give_layers(&s, fish, 3, 1.4);
        stage_ball(&s, 0, 0, vec3(0, 0, 0), 10.0f, 24);
        for (int k = 0; k < 6; k++)
            if (run == k || run == 6) {
                const enum pell_light_type type = (enum pell_light_type) k;
                const struct pell_vec3 at = vec3(20.0f - 8.0f * (float) k, 15.0f, k % 2 ? 30.0f : -25.0f);
                stage_light(&s, type, at, vec3(0, 0, 0), type == PELL_LIGHT_POINT || type == PELL_LIGHT_SPOT ? 1e-3f : 1.0f);
            }
        stage_camera(&s, vec3(5, 8, 60), vec3(0, 0, 0), 0.5f, 0.0f);
        one[run] = stage_shot_of(&s, "layered", knobs);
        shot_check(&one[run]);
        stage_finish(&s);
    }
    for (int y = 0; y < 30; y++)
        for (int x = 0; x < 40; x++) {
            double sum = 0.0;
            for (int k = 0; k < 6; k++)
                sum += shot_at(&one[k], SHOT_G, x, y);
            REQUIRE_NEAR(shot_at(&one[6], SHOT_G, x, y), sum, 1e-5 * sum + 1e-9);
        }
    for (int k = 0; k < 6; k++) {
        double most = 0.0;
        for (int i = 0; i < 1200; i++)
            most = fmax(most, shot_at(&one[k], SHOT_G, i % 40, i / 40));
        REQUIRE(most > 0.0);
    }
    for (int run = 0; run < 7; run++)
        shot_free(&one[run]);
}

/* Under a uniform environment a slab has the light of single-scatter, though few directions are sampled. */
static void a_slab_under_even_light_has_that_of_single_scatter(void **state)
{
    static const char *const exact[] = { "error=0.02", NULL };
    const struct test_layer one = { INFINITY, 0.02, 0.52, schlick(0.0) };
    double mean[2] = { 0.0 };
    (void) state;

    for (int run = 0; run < 2; run++) {
        struct stage s;
        struct shot shot;
        stage_start(&s, 8, 8);
        s.settings.msaa = 4;
        give_layers(&s, &one, 1, 1.0);
        stage_box(&s, 0, 0, vec3(-80, -80, -5), vec3(80, 80, 0));
        stage_environment(&s, 1.0f);
        stage_camera(&s, vec3(0, 0, 400), vec3(0, 0, 0), 0.0f, 2.0f);
        shot = stage_shot_of(&s, run ? "single-scatter" : "layered", run ? exact : NULL);
        shot_check(&shot);
        for (int i = 0; i < 64; i++)
            mean[run] += shot_at(&shot, SHOT_G, i % 8, i / 8) / 64.0;
        shot_free(&shot);
        stage_finish(&s);
    }
    print_message("# layered %.5f, single-scatter %.5f\n", mean[0], mean[1]);
    REQUIRE_REL(mean[0], mean[1], 0.02);
}

/* Steps equal in optical depth and steps equal in length converge to the same image; with few steps the former are more accurate in
 * optically thick media. */
static void steps_by_optical_depth(void **state)
{
    static const char *const knobs[4][4] = { { "samples=400", "steps=equal", "tolerance=0", NULL },
                                             { "samples=400", "steps=optical", "tolerance=0", NULL },
                                             { "samples=10", "steps=equal", NULL },
                                             { "samples=10", "steps=optical", NULL } };
    struct shot shot[4];
    double error[4] = { 0.0 }, mean = 0.0;
    struct stage s;

    (void) state;
    stage_start(&s, 40, 30);
    give_layers(&s, fish, 3, 1.4);
    stage_ball(&s, 0, 0, vec3(0, 0, 0), 40.0f, 48);
    stage_light(&s, PELL_LIGHT_POINT, vec3(80.0f, 60.0f, 90.0f), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 400), vec3(0, 0, 0), 0.0f, 60.0f);
    for (int k = 0; k < 4; k++) {
        shot[k] = stage_shot_of(&s, "layered", knobs[k]);
        for (int at = 0; at < 40 * 30; at++) {
            const double truth = shot_at(&shot[0], SHOT_G, at % 40, at / 40), off = shot_at(&shot[k], SHOT_G, at % 40, at / 40) - truth;
            error[k] += off * off;
            mean += k == 0 ? truth : 0.0;
        }
    }
    mean /= 40 * 30;
    for (int k = 1; k < 4; k++)
        error[k] = sqrt(error[k] / (40 * 30)) / mean;
    print_message("# 400 steps, optical against equal: %.2e; 10 steps: equal %.2e, optical %.2e\n", error[1], error[2], error[3]);
    REQUIRE(mean > 0.0 && error[1] < 1e-3 && error[3] < 0.6 * error[2]);
    for (int k = 0; k < 4; k++)
        shot_free(&shot[k]);
    stage_finish(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(homogeneous),
        cmocka_unit_test(three_layers),
        cmocka_unit_test(refracting_slab),
        cmocka_unit_test(phases),
        cmocka_unit_test(early_end),
        cmocka_unit_test(clear_and_many),
        cmocka_unit_test(uniform_paint),
        cmocka_unit_test(uv_of_any_kind),
        cmocka_unit_test(hostile_paint),
        cmocka_unit_test(paths_on_a_slab),
        cmocka_unit_test(balls),
        cmocka_unit_test(terminator),
        cmocka_unit_test(planes),
        cmocka_unit_test(sheet),
        cmocka_unit_test(slab_from_behind),
        cmocka_unit_test(bottom),
        cmocka_unit_test(lights_add_up),
        cmocka_unit_test(a_slab_under_even_light_has_that_of_single_scatter),
        cmocka_unit_test(steps_by_optical_depth),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
