/* SPDX-License-Identifier: MIT
 * test_render_wild.c - the whole renderer at the ends of its ranges: random scenes, extreme coefficients, tiny and huge objects,
 * arbitrary cameras; and its warnings. A non-finite pixel, or a render that does not end, is a bug for any scene. */
#include "stage.h"

static const char *const paper[] = { "as=paper", NULL };

/* Renders with and without scattering; nothing may be invalid. */
static void render_both(struct stage *s, const char *what)
{
    for (int k = 0; k < 3; k++) {
        struct shot shot;
        stage_method(s, k ? "screen-space" : "none", k == 2 ? paper : NULL);
        stage_render(s);
        if (s->image.invalid)
            fail_msg("%s, method %d: %lld pixels are no number", what, k, (long long) s->image.invalid);
        shot = shot_copy(&s->image);
        shot_check(&shot);
        shot_free(&shot);
    }
}

/* --- Random scenes ------------------------------------------------------------------------------------------------------------------ */

static double uniform(uint32_t *seed, double low, double high)
{
    return low + (high - low) * (double) shapes_random(seed);
}

static int pick(uint32_t *seed, int count)
{
    const int i = (int) (shapes_random(seed) * (float) count);
    return i < count ? i : count - 1;
}

/* Often a bound or an extreme, else any value, uniform in the logarithm. */
static double wild(uint32_t *seed, double low, double high)
{
    const int kind = pick(seed, 6);

    if (kind == 0)
        return low;
    if (kind == 1)
        return high;
    if (kind == 2 || low < 0.0)
        return uniform(seed, low, high);
    return fmax(low, high * pow(10.0, -uniform(seed, 0.0, 8.0)));
}

static struct pell_vec3 point(uint32_t *seed, double size)
{
    const float x = (float) uniform(seed, -size, size), y = (float) uniform(seed, -size, size), z = (float) uniform(seed, -size, size);
    return vec3(x, y, z);
}

static void random_knobs(const struct pell_knob *knobs, void *values, uint32_t *seed, const char *const *leave)
{
    pell_knobs_default(knobs, values);
    for (const struct pell_knob *k = knobs; k->name; k++) {
        void *field = (char *) values + k->offset;
        bool left = pick(seed, 2) == 0;
        int choices = 0;
        for (int i = 0; leave[i]; i++)
            left = left || strcmp(k->name, leave[i]) == 0;
        if (left)
            continue;
        switch (k->type) {
        case PELL_KNOB_BOOL: *(bool *) field = pick(seed, 2); break;
        case PELL_KNOB_INT: *(int *) field = (int) wild(seed, k->min, k->max); break;
        case PELL_KNOB_INT64: *(int64_t *) field = (int64_t) wild(seed, k->min, k->max); break;
        case PELL_KNOB_FLOAT: *(float *) field = (float) wild(seed, k->min, k->max); break;
        case PELL_KNOB_ENUM:
            while (k->choices[choices])
                choices++;
            *(int *) field = pick(seed, choices);
            break;
        default: break;
        }
    }
}

static void random_material(struct stage *s, uint32_t *seed)
{
    struct pell_material *m;
    size_t i;

    OK(pell_scene_add_material(s->scene, "random", &i));
    m = &s->scene->materials[i];
    m->opaque = pick(seed, 4) == 0;
    for (int c = 0; c < 3; c++) {
        m->medium.sigma_a[c] = wild(seed, 0.0, PELL_SIGMA_MAX);
        m->medium.sigma_s_reduced[c] =
            fmax(wild(seed, 0.0, PELL_SIGMA_MAX), m->medium.sigma_a[c] < PELL_SIGMA_T_MIN ? PELL_SIGMA_T_MIN : 0.0);
        m->base_color[c] = (float) wild(seed, 0.0, 1.0);
        m->specular_color[c] = (float) wild(seed, 0.0, 1.0);
        m->emissive[c] = pick(seed, 4) ? 0.0f : (float) wild(seed, 0.0, 100.0);
    }
    if (m->opaque && pick(seed, 2)) {
        m->diffuse_transmission = (float) wild(seed, 0.0, 1.0);
        m->diffuse_transmission_color[1] = (float) wild(seed, 0.0, 1.0);
    }
    m->medium.eta = wild(seed, 1.0, 4.0);
    if (pick(seed, 3) == 0)
        OK(pell_material_apply(s->scene, i, "test", pell_material_at((size_t) pick(seed, (int) pell_material_count()))->name));
    if (pick(seed, 4) == 0) {
        m->gaussians.count = 1 + pick(seed, PELL_GAUSSIANS_MAX);
        for (int k = 0; k < m->gaussians.count; k++) {
            m->gaussians.variance[k] = (k ? m->gaussians.variance[k - 1] : 0.0) + fmax(wild(seed, 0.0, 1e6), 1e-9) * (k + 1);
            for (int c = 0; c < 3; c++)
                m->gaussians.weight[k][c] = wild(seed, 0.0, 1.0) / m->gaussians.count;
        }
    }
    m->color_from = pick(seed, 2) ? PELL_COLOR_FROM_TEXTURE : PELL_COLOR_FROM_PROFILE;
    m->mix = (float) wild(seed, 0.0, 1.0);
    m->strength = (float) wild(seed, 0.0, 1.0);
    m->metallic = (float) wild(seed, 0.0, 1.0);
    m->roughness = (float) wild(seed, 0.0, 1.0);
    m->rho_s = (float) wild(seed, 0.0, 1.0);
    m->specular = (enum pell_specular_model) pick(seed, PELL_SPECULAR_MODELS);
    m->double_sided = pick(seed, 2);
}

static void random_object(struct stage *s, uint32_t *seed, int object, double size)
{
    const size_t material = (size_t) pick(seed, (int) s->scene->num_materials);
    const struct pell_vec3 at = point(seed, size);
    const float radius = (float) (size * uniform(seed, 0.1, 1.0));

    switch (pick(seed, 4)) {
    case 0: stage_ball(s, material, object, at, radius, 3 + pick(seed, 12)); break;
    case 1: stage_box(s, material, object, at, vec3_add(at, vec3(radius, (float) wild(seed, 1e-6 * size, size), radius))); break;
    case 2: /* open */ shapes_quad(s->scene, material, at, vec3(radius, 0, 0), vec3(0, 0.5f * radius, radius))->object = object; break;
    default: { /* random triangles, some of them points or lines */
        struct pell_mesh *m = shapes_mesh(s->scene, material, 12, 10);
        m->object = object;
        for (int i = 0; i < 12; i++)
            vec3_store(vec3_add(at, point(seed, (double) radius)), &m->position[3 * i]);
        for (int i = 0; i < 30; i++)
            m->index[i] = (uint32_t) pick(seed, 12);
        m->index[0] = 0; /* at least one has an area */
        m->index[1] = 1;
        m->index[2] = 2;
        break;
    }
    }
}

static void random_light(struct stage *s, uint32_t *seed, double size)
{
    const enum pell_light_type type = (enum pell_light_type) pick(seed, 6);
    struct pell_light *l = stage_light(s, type, point(seed, 3.0 * size), vec3(0.1f, 0.2f, 0.3f), 1.0f);

    for (int c = 0; c < 3; c++)
        l->power[c] = (float) (wild(seed, 0.0, 100.0) * (type == PELL_LIGHT_POINT || type == PELL_LIGHT_SPOT ? 1e-6 * size * size : 1.0));
    l->width = (float) (size * uniform(seed, 1e-6, 2.0));
    l->height = (float) (size * uniform(seed, 1e-6, 2.0));
    l->radius = (float) (size * uniform(seed, 1e-6, 2.0));
    l->cos_outer = (float) wild(seed, -1.0, 1.0);
    l->cos_inner = (float) uniform(seed, (double) l->cos_outer, 1.0);
    l->range = pick(seed, 4) ? 0.0f : (float) (size * uniform(seed, 0.1, 10.0));
    l->rotate = (float) uniform(seed, -10.0, 10.0);
    if (pick(seed, 4) == 0) {
        uint8_t pixels[4 * 2 * 3];
        for (size_t i = 0; i < sizeof(pixels); i++)
            pixels[i] = (uint8_t) pick(seed, 256);
        l->image = shapes_texture(s->scene, 4, 2, 3, true, pixels);
        l->image_fov = (float) uniform(seed, 0.01, 3.0);
    }
}

static void random_scenes_end_in_numbers(void **state)
{
    /* Settings that make a frame slow by design, or that are not randomised. */
    static const char *const fixed[] = { "width", "height", "msaa", "light-samples", "ambient-samples", "environment-lights", NULL };
    static const char *const none[] = { NULL };
    double slowest = 0.0, started = busy_seconds();
    int refused = 0;
    struct stage s; /* one renderer for all */

    (void) state;
    stage_start(&s, 8, 8);
    for (uint32_t n = 0; n < 240; n += SLOW ? 6 : 2) {
        uint32_t seed = 12345 + 7919 * n;
        const double size = pow(10.0, uniform(&seed, -2.0, 4.0));
        const struct pell_method *method = pell_method_at(0);
        double start = busy_seconds();
        enum pell_result res;
        void *knobs = calloc(1, method->knobs_size);

        OK(pell_renderer_set_scene(s.r, NULL));
        pell_scene_destroy(&s.scene);
        OK(pell_scene_create(s.ctx, &s.scene));
        s.settings.width = 1 + pick(&seed, 40);
        s.settings.height = 1 + pick(&seed, 30);
        for (int i = 1 + pick(&seed, 3); i > 0; i--)
            random_material(&s, &seed);
        for (int i = 1 + pick(&seed, 4); i > 0; i--)
            random_object(&s, &seed, i, size);
        for (int i = pick(&seed, 4); i > 0; i--)
            random_light(&s, &seed, size);
        if (pick(&seed, 3))
            stage_camera(&s, point(&seed, 3.0 * size), point(&seed, size), (float) wild(&seed, 0.001, 3.0), 0.0f);
        else
            stage_camera(&s, point(&seed, size), point(&seed, size), 0.0f, (float) (size * uniform(&seed, 0.01, 10.0)));
        {
            const int width = s.settings.width, height = s.settings.height;
            random_knobs(pell_settings_knobs(), &s.settings, &seed, fixed);
            s.settings.width = width;
            s.settings.height = height;
        }
        s.settings.dof = s.settings.dof && s.scene->cameras[0].ortho_height == 0.0f; /* which has no lens */
        s.settings.msaa = 1 + pick(&seed, 3);
        s.settings.light_samples = 1 + pick(&seed, 4);
        s.settings.ambient_samples = 1 + pick(&seed, 4);
        s.settings.indirect_samples = 64 + pick(&seed, 400);
        s.settings.environment_lights = pick(&seed, 4);
        s.scene->background = (enum pell_background) pick(&seed, 4);
        random_knobs(method->knobs, knobs, &seed, none);
        OK(pell_renderer_set_method(s.r, pick(&seed, 8) ? method : NULL, knobs));
        stage_complete(&s);
        OK(pell_renderer_set_scene(s.r, s.scene));
        res = pell_renderer_render(s.r, &s.settings, &s.image);
        if (res == PELL_OK) {
            struct shot shot = shot_copy(&s.image);
            if (s.image.invalid)
                fail_msg("scene %u: %lld pixels are no number", n, (long long) s.image.invalid);
            shot_check(&shot);
            shot_free(&shot);
        } else if (res == PELL_ERR_INVALID && s.kept.errors > 0) {
            print_message("# scene %u is refused: %s: %s\n", n, s.kept.where, s.kept.what);
            refused++;
        } else {
            fail_msg("scene %u: %s: %s", n, pell_result_name(res), s.kept.what);
        }
        OK(pell_renderer_check_assumptions(s.r, &s.settings));
        s.kept.errors = 0;
        free(knobs);
        start = busy_seconds() - start;
        slowest = fmax(slowest, start);
        if (start > 40.0)
            fail_msg("scene %u took %.1f s", n, start);
    }
    print_message("# %d scenes, %d refused, in %.1f s; the slowest took %.2f s\n", SLOW ? 100 : 300, refused, busy_seconds() - started,
                  slowest);
    REQUIRE(refused < 30);
    stage_finish(&s);
}

/* --- Ends of ranges ----------------------------------------------------------------------------------------------------------------- */

static void extreme_coefficients(void **state)
{
    static const double values[] = { 0.0, 1e-6, 1.0, 1e6 };

    (void) state;
    for (int k = 0; k < 32; k++) {
        struct pell_material *material;
        struct pell_medium_fault fault;
        char what[128];
        struct stage s;
        size_t m;

        stage_start(&s, 40, 30);
        material = stage_medium(&s, "marble", &m);
        material->rho_s = 1.0f;
        material->roughness = k & 16 ? 0.0f : 1.0f;
        for (int c = 0; c < 3; c++) {
            material->medium.sigma_a[c] = values[k % 4];
            material->medium.sigma_s_reduced[c] = values[k / 4 % 4];
        }
        material->medium.eta = k & 16 ? 4.0 : 1.0;
        s.settings.boundary = k & 16 ? PELL_BOUNDARY_MODEL_SMOOTH : PELL_BOUNDARY_MODEL_ROUGH;
        if (pell_medium_valid(&material->medium, &fault)) {
            snprintf(what, sizeof(what), "sigma_a %g, sigma_s' %g, eta %g", values[k % 4], values[k / 4 % 4], material->medium.eta);
            stage_ball(&s, m, 0, vec3(0, 0, 0), 20.0f, 12);
            stage_light(&s, PELL_LIGHT_POINT, vec3(-60, 60, 60), vec3(0, 0, 0), 0.02f);
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -60), vec3(0, 0, 0), 1.0f);
            stage_camera(&s, vec3(0, 0, 200), vec3(0, 0, 0), 0.25f, 0.0f);
            render_both(&s, what);
        }
        stage_finish(&s);
    }
}

/* The same scene in sizes from a micrometre to a kilometre, with its medium scaled: the image is the same. */
static void tiny_and_huge_objects(void **state)
{
    static const float scales[] = { 1.0f, 1e-4f, 1e-2f, 1e2f, 5e4f };
    struct shot first = { 0 };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(scales); i++) {
        const float k = scales[i];
        struct pell_material *material;
        struct stage s;
        struct shot shot;
        char what[64];
        size_t m;

        stage_start(&s, 60, 45);
        material = stage_gaussians(&s, (double) (0.5f * k), &m);
        material->rho_s = 1.0f;
        stage_ball(&s, m, 0, vec3(-8 * k, 0, 0), 20.0f * k, 24);
        stage_box(&s, m, 1, vec3(14 * k, -15 * k, -1 * k), vec3(30 * k, 15 * k, 1 * k));
        stage_light(&s, PELL_LIGHT_POINT, vec3(-60 * k, 60 * k, 60 * k), vec3(0, 0, 0), 0.02f * k * k);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(10, 0, -60), vec3(0, 0, 0), 1.0f);
        stage_camera(&s, vec3(0, 0, 200 * k), vec3(0, 0, 0), 0.3f, 0.0f);
        snprintf(what, sizeof(what), "a ball of %g mm", (double) (20.0f * k));
        render_both(&s, what);
        shot = stage_shot_of(&s, "screen-space", NULL);
        if (i > 0) {
            const struct difference d = shot_difference(&first, &shot);
            print_message("# %s: %.2g root mean square from that of 20 mm, %lld of %lld values over 1 %%\n", what, d.rms,
                          (long long) d.over, (long long) d.count);
            REQUIRE(d.over <= d.count / 100);
            shot_free(&shot);
        } else {
            first = shot;
        }
        stage_finish(&s);
    }
    shot_free(&first);
}

/* Far from the origin coordinates are rounded to millimetres, and samples of indirect light coincide: rendering still ends quickly. */
static void far_objects_end_soon(void **state)
{
    (void) state;
    for (float far = 1e5f; far <= 1e7f; far *= 100.0f) {
        const double start = pell_seconds();
        struct pell_material *material;
        struct stage s;
        size_t m;

        stage_start(&s, 60, 45);
        s.settings.bounces = 1;
        material = stage_gaussians(&s, 0.5, &m);
        material->rho_s = 1.0f;
        stage_ball(&s, m, 0, vec3(far, far, far), 20.0f, 24);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(10, 0, -60), vec3(0, 0, 0), 1.0f);
        stage_camera(&s, vec3(far, far, far + 200.0f), vec3(far, far, far), 0.3f, 0.0f);
        render_both(&s, "a ball far away");
        print_message("# at %g mm: %.2f s\n", (double) far, pell_seconds() - start);
        REQUIRE(pell_seconds() - start < 30.0);
        stage_finish(&s);
    }
}

static void cameras_anywhere(void **state)
{
    static const struct {
        const char *what;
        struct pell_vec3 from, to;
        float fov, ortho;
    } cases[] = {
        { "inside the ball", { 0, 0, 0 }, { 0, 0, -1 }, 1.0f, 0.0f },
        { "behind it, looking away", { 0, 0, -100 }, { 0, 0, -200 }, 1.0f, 0.0f },
        { "on its surface", { 0, 0, 20 }, { 0, 0, 0 }, 1.0f, 0.0f },
        { "on its surface, along it", { 0, 0, 20 }, { 0, 1, 20 }, 3.0f, 0.0f },
        { "a micrometre away", { 0, 0, 20.001f }, { 0, 0, 0 }, 0.5f, 0.0f },
        { "a kilometre away", { 0, 0, 1e6f }, { 0, 0, 0 }, 1e-4f, 0.0f },
        { "far, wide", { 0, 0, 1e6f }, { 0, 0, 0 }, 3.14f, 0.0f },
        { "in the plane of a side", { 60, -20, 60 }, { 0, -20, 0 }, 0.5f, 0.0f },
        { "from above", { 0, 200, 0 }, { 0, 0, 0 }, 0.5f, 0.0f },
        { "orthographic, inside", { 0, 0, 0 }, { 0, 0, -1 }, 0.0f, 30.0f },
        { "orthographic, tiny", { 0, 0, 60 }, { 0, 0, 0 }, 0.0f, 1e-3f },
        { "orthographic, huge", { 0, 0, 60 }, { 0, 0, 0 }, 0.0f, 1e9f },
        { "at a light", { -60, 60, 60 }, { 0, 0, 0 }, 0.5f, 0.0f },
    };
    struct stage s;
    size_t skin, paint;

    (void) state;
    stage_start(&s, 50, 37);
    stage_medium(&s, "skin1", &skin)->rho_s = 1.0f;
    stage_opaque(&s, 0.5f, &paint)->rho_s = 1.0f;
    stage_ball(&s, skin, 0, vec3(0, 0, 0), 20.0f, 16);
    stage_box(&s, paint, 1, vec3(-60, -30, -60), vec3(60, -20, 60));
    stage_light(&s, PELL_LIGHT_POINT, vec3(-60, 60, 60), vec3(0, 0, 0), 0.02f);
    stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, 0), vec3(0, 0, 1), 0.02f); /* inside the ball */
    stage_environment(&s, 0.2f);
    s.settings.msaa = 2;
    s.settings.light_samples = s.settings.ambient_samples = 2;
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        stage_camera(&s, cases[i].from, cases[i].to, cases[i].fov, cases[i].ortho);
        render_both(&s, cases[i].what);
    }
    stage_finish(&s);
}

/* --- Variants of a scene ------------------------------------------------------------------------------------------------------------- */

static void opaque_objects_alone_need_no_method(void **state)
{
    struct shot none, moved;
    struct stage s;
    size_t paint;

    (void) state;
    stage_start(&s, 60, 40);
    stage_opaque(&s, 0.5f, &paint)->rho_s = 1.0f;
    stage_ball(&s, paint, 0, vec3(0, 0, 0), 20.0f, 16);
    stage_light(&s, PELL_LIGHT_POINT, vec3(-60, 60, 60), vec3(0, 0, 0), 0.02f);
    stage_camera(&s, vec3(0, 0, 200), vec3(0, 0, 0), 0.25f, 0.0f);
    none = stage_shot_of(&s, "none", NULL);
    moved = stage_shot_of(&s, "screen-space", NULL);
    REQUIRE(shot_equal(&none, &moved));
    shot_free(&moved);
    moved = stage_shot_of(&s, "screen-space", paper);
    REQUIRE(shot_equal(&none, &moved));
    OK(pell_renderer_check_assumptions(s.r, &s.settings));
    assert_int_equal(s.kept.warnings, 0);
    shot_free(&none);
    shot_free(&moved);
    stage_finish(&s);
}

static void opaque_and_masked_and_translucent_in_one_picture(void **state)
{
    static const uint8_t holes[2 * 2 * 4] = { 255, 255, 255, 255, 255, 255, 255, 0, 255, 255, 255, 0, 255, 255, 255, 255 };
    struct pell_material *masked;
    struct shot none, moved;
    struct stage s;
    size_t skin, paint, leaf;
    int same = 0, differ = 0;

    (void) state;
    stage_start(&s, 96, 64);
    stage_gaussians(&s, 0.5, &skin);
    stage_opaque(&s, 0.5f, &paint);
    masked = stage_opaque(&s, 1.0f, &leaf);
    masked->alpha_mask = true;
    masked->alpha_cutoff = 0.5f;
    masked->double_sided = true;
    masked->base_color_map =
        (struct pell_texture_map) { .texture = shapes_texture(s.scene, 2, 2, 4, true, holes), .matrix = { 1, 0, 0, 0, 1, 0 } };
    stage_ball(&s, skin, 0, vec3(-15, 0, 0), 18.0f, 24);
    stage_ball(&s, paint, 1, vec3(25, 0, 0), 18.0f, 24);
    shapes_quad(s.scene, leaf, vec3(-15, 0, 40), vec3(12, 0, 0), vec3(0, 12, 0))->object = 2;
    stage_light(&s, PELL_LIGHT_POINT, vec3(-60, 60, 90), vec3(0, 0, 0), 0.02f);
    stage_camera(&s, vec3(0, 0, 240), vec3(0, 0, 0), 0.25f, 0.0f);
    none = stage_shot_of(&s, "none", NULL);
    moved = stage_shot_of(&s, "screen-space", NULL);
    for (int y = 0; y < 64; y++)
        for (int x = 0; x < 96; x++) {
            const bool equal = shot_at(&none, SHOT_R, x, y) == shot_at(&moved, SHOT_R, x, y);
            if (x > 56 || shot_at(&none, SHOT_A, x, y) == 0.0)
                REQUIRE(equal); /* the opaque ball, and nothing */
            same += equal;
            differ += !equal;
        }
    REQUIRE(same > 3000 && differ > 400);
    shot_free(&none);
    shot_free(&moved);
    stage_finish(&s);
}

/* The paper's settings in the renderer: a different image, of similar brightness. */
static void as_in_the_paper(void **state)
{
    struct shot none, best, papers;
    double sum[3] = { 0.0 };
    struct stage s;
    size_t skin;

    (void) state;
    stage_start(&s, 96, 96);
    stage_medium(&s, "skin1", &skin)->rho_s = 1.0f;
    stage_ball(&s, skin, 0, vec3(0, 0, 0), 90.0f, 48);
    stage_light(&s, PELL_LIGHT_POINT, vec3(-300, 300, 300), vec3(0, 0, 0), 0.6f);
    stage_camera(&s, vec3(0, 0, 600), vec3(0, 0, 0), 0.35f, 0.0f);
    none = stage_shot_of(&s, "none", NULL);
    best = stage_shot_of(&s, "screen-space", NULL);
    papers = stage_shot_of(&s, "screen-space", paper);
    for (size_t i = 0; i < none.size; i++) {
        sum[0] += (double) none.data[i];
        sum[1] += (double) best.data[i];
        sum[2] += (double) papers.data[i];
    }
    print_message("# light over that without scattering: best %.4f, paper %.4f\n", sum[1] / sum[0], sum[2] / sum[0]);
    REQUIRE(shot_difference(&none, &papers).rms > 1e-3 && shot_difference(&best, &papers).rms > 1e-3);
    REQUIRE_NEAR(sum[1] / sum[0], 1.0, 0.02);
    REQUIRE_NEAR(sum[2] / sum[0], 1.0, 0.1);
    shot_free(&none);
    shot_free(&best);
    shot_free(&papers);
    stage_finish(&s);
}

/* --- Warnings ------------------------------------------------------------------------------------------------------------------------ */

static const char *const warnings[] = { "is open", "inverted normals", "mean free path", "scattering is not visible" };

/* The warnings of check_range for a ball or box: one bit per warning. */
static unsigned warned(bool closed, bool outward, float radius, float distance, double sigma, bool scatters, bool opaque)
{
    struct pell_material *material;
    struct stage s;
    unsigned bits = 0;
    size_t m;

    stage_start(&s, 128, 128);
    material = stage_medium(&s, "marble", &m);
    material->opaque = opaque;
    for (int c = 0; c < 3; c++) {
        material->medium.sigma_a[c] = 0.01 * sigma;
        material->medium.sigma_s_reduced[c] = sigma;
    }
    if (closed)
        stage_ball(&s, m, 0, vec3(0, 0, 0), radius, 24);
    else
        shapes_quad(s.scene, m, vec3(0, 0, 0), vec3(radius, 0, 0), vec3(0, radius, 0))->object = 0;
    stage_light(&s, PELL_LIGHT_POINT, vec3(-60, 60, 90), vec3(0, 0, 0), 0.02f);
    stage_camera(&s, vec3(0, 0, distance), vec3(0, 0, 0), 0.25f, 0.0f);
    stage_method(&s, scatters ? "screen-space" : "none", NULL);
    stage_complete(&s);
    for (uint32_t i = 0; i < s.scene->meshes[0].num_triangles && !outward; i++) { /* completing a scene would flip it */
        uint32_t *v = s.scene->meshes[0].index + 3 * i, swap = v[1];
        v[1] = v[2];
        v[2] = swap;
    }
    OK(pell_renderer_set_scene(s.r, s.scene));
    s.kept.warnings = 0;
    OK(pell_renderer_check_assumptions(s.r, &s.settings));
    assert_int_equal(s.kept.errors, 0);
    for (size_t i = 0; i < PELL_COUNT(warnings); i++)
        if (s.kept.warnings && strstr(s.kept.last_warning, warnings[i]))
            bits |= 1u << i;
    assert_int_equal(s.kept.warnings, bits ? 1 : 0);
    stage_finish(&s);
    return bits;
}

/* Of many objects with the same problem some are named, the others counted. */
static void warnings_are_counted_where_there_are_many(void **state)
{
    struct stage s;
    size_t m;
    int limit;

    (void) state;
    stage_start(&s, 64, 64);
    stage_medium(&s, "marble", &m);
    for (int i = 0; i < 100; i++) {
        struct pell_mesh *quad = shapes_quad(s.scene, m, vec3((float) (3 * i), 0, 0), vec3(1, 0, 0), vec3(0, 1, 0));
        char name[16];
        snprintf(name, sizeof(name), "sheet %d", i);
        pell_free(s.ctx, quad->name);
        quad->name = pell_strdup(s.ctx, name);
        quad->object = i;
    }
    stage_camera(&s, vec3(0, 0, 200), vec3(0, 0, 0), 0.25f, 0.0f);
    stage_method(&s, "screen-space", NULL);
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    s.kept.warnings = 0;
    limit = pell_context_limits(s.ctx)->warnings;
    OK(pell_renderer_check_assumptions(s.r, &s.settings));
    REQUIRE(limit < 100);
    assert_in_range(s.kept.warnings, limit + 1, limit + 2);
    REQUIRE(strstr(s.kept.last_warning, "more warnings about open surfaces"));
    stage_finish(&s);
}

/* Copies of an object: one warning, and how many more there are. */
static void copies_are_warned_of_once(void **state)
{
    struct stage s;
    size_t m;

    (void) state;
    stage_start(&s, 64, 64);
    stage_medium(&s, "marble", &m);
    for (int i = 0; i < 9; i++)
        shapes_quad(s.scene, m, vec3((float) (3 * i), 0, 0), vec3(1, 0, 0), vec3(0, 1, 0))->object = i;
    stage_camera(&s, vec3(0, 0, 200), vec3(0, 0, 0), 0.25f, 0.0f);
    stage_method(&s, "screen-space", NULL);
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    s.kept.warnings = 0;
    OK(pell_renderer_check_assumptions(s.r, &s.settings));
    assert_int_equal(s.kept.warnings, 2);
    REQUIRE(strstr(s.kept.last_warning, "8 more warnings about open surfaces"));
    stage_finish(&s);
}

static void each_warning_where_it_belongs(void **state)
{
    (void) state;
    assert_int_equal(warned(true, true, 20.0f, 200.0f, 1.0, true, false), 0);   /* a good scene */
    assert_int_equal(warned(false, true, 20.0f, 200.0f, 1.0, true, false), 1);  /* a sheet */
    assert_int_equal(warned(true, false, 20.0f, 200.0f, 1.0, true, false), 2);  /* inverted normals */
    assert_int_equal(warned(true, true, 20.0f, 200.0f, 0.01, true, false), 4);  /* 100 mm between scattering events */
    assert_int_equal(warned(true, true, 20.0f, 200.0f, 1e3, true, false), 8);   /* micrometres */
    assert_int_equal(warned(true, true, 20.0f, 4000.0f, 1.0, true, false), 0);  /* 20 times as far: 5 mm are 0.6 px */
    assert_int_equal(warned(true, true, 20.0f, 20000.0f, 1.0, true, false), 8); /* farther */
    assert_int_equal(warned(false, true, 20.0f, 200.0f, 1.0, false, false), 0); /* nothing scatters */
    assert_int_equal(warned(false, true, 20.0f, 200.0f, 1.0, true, true), 0);   /* nothing is translucent */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_scenes_end_in_numbers),
        cmocka_unit_test(extreme_coefficients),
        cmocka_unit_test(tiny_and_huge_objects),
        cmocka_unit_test(far_objects_end_soon),
        cmocka_unit_test(cameras_anywhere),
        cmocka_unit_test(opaque_objects_alone_need_no_method),
        cmocka_unit_test(opaque_and_masked_and_translucent_in_one_picture),
        cmocka_unit_test(as_in_the_paper),
        cmocka_unit_test(each_warning_where_it_belongs),
        cmocka_unit_test(warnings_are_counted_where_there_are_many),
        cmocka_unit_test(copies_are_warned_of_once),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
