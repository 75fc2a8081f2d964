/* SPDX-License-Identifier: MIT
 * test_texture_space_forms.c - partial maps, other tap counts and other map sizes, against complete and dense maps. */
#include "scenes.h"

/* A ball with dents, so that it has many charts and shadows of its own. */
static void dented_ball(struct stage *s, size_t material, int object, struct pell_vec3 at, int rings)
{
    struct pell_mesh *m;

    stage_ball(s, material, object, vec3(0, 0, 0), 10.0f, rings);
    m = &s->scene->meshes[s->scene->num_meshes - 1];
    for (uint32_t i = 0; i < m->num_vertices; i++) {
        float *p = m->position + 3 * i;
        const double r = 1.0 + 0.12 * sin(0.5 * (double) p[0]) * cos(0.45 * (double) p[1]) + 0.08 * sin(0.6 * (double) p[2] + 1.0);
        vec3_store(vec3_add(vec3_mul(vec3_load(p), (float) r), at), p);
    }
    shapes_bound(s->scene, m);
}

/* --- Partial maps ----------------------------------------------------------------------------------------------------------------- */

static struct shot stage_view(struct stage *s, struct pell_vec3 from, struct pell_vec3 to, const char *const *knobs)
{
    stage_camera(s, from, to, 0.3f, 0.0f);
    return stage_shot_of(s, "texture-space", knobs);
}

/* An image from partial maps is bit-identical to one from complete maps: close, distant, past an edge, for several lights, samples and
 * settings. */
static void what_is_not_seen_is_left_out_without_a_trace(void **state)
{
    static const char *const part[][6] = { { "size=160", "cull=true" },
                                           { "size=160", "tsm=map", "cull=true" },
                                           { "size=160", "tsm=off", "cull=true" },
                                           { "size=160", "lights=sum", "cull=true" },
                                           { "size=160", "soften=off", "first=unblurred", "cull=true" } };
    static const char *const all[][6] = { { "size=160", "cull=false" },
                                          { "size=160", "tsm=map", "cull=false" },
                                          { "size=160", "tsm=off", "cull=false" },
                                          { "size=160", "lights=sum", "cull=false" },
                                          { "size=160", "soften=off", "first=unblurred", "cull=false" } };
    static const struct pell_vec3 from[3] = { { 0, 0, 80 }, { 30, 10, 24 }, { -70, 20, -40 } }, to[3] = { { 0 }, { 6, 0, 5 }, { 0 } };
    struct stage s;
    size_t m;
    (void) state;

    stage_start(&s, 40, 32);
    stage_gaussians(&s, 0.1, &m);
    dented_ball(&s, m, 1, vec3(0, 0, 0), 24);
    dented_ball(&s, m, 2, vec3(-26, 0, 0), 20);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(50, 60, 70), vec3(0, 0, 0), 1.0f);
    stage_light(&s, PELL_LIGHT_RECT, vec3(-40, 20, -60), vec3(0, 0, 0), 20.0f);
    stage_environment(&s, 0.2f);
    for (size_t k = 0; k < PELL_COUNT(part); k++)
        for (int v = 0; v < 3; v++) {
            struct shot shots[2];
            s.settings.msaa = v == 1 ? 4 : 1;
            shots[0] = stage_view(&s, from[v], to[v], part[k]);
            shots[1] = stage_view(&s, from[v], to[v], all[k]);
            REQUIRE(shot_mean_green(&shots[0]) > 0.0);
            if (!shot_equal(&shots[0], &shots[1]))
                fail_msg("form %zu, view %d: difference %g of the mean", k, v, shot_difference(&shots[0], &shots[1]).rms);
            shot_free(&shots[0]);
            shot_free(&shots[1]);
        }
    stage_finish(&s);
}

/* Other views with maps that were made for the first view are bit-identical to those of a new renderer. */
static void views_from_all_sides_see_all_of_it(void **state)
{
    static const char *const knobs[] = { "size=128", NULL };
    struct shot seen[2], fresh;
    struct stage s;
    size_t m;
    (void) state;

    stage_start(&s, 40, 32);
    stage_gaussians(&s, 0.1, &m);
    dented_ball(&s, m, 1, vec3(0, 0, 0), 24);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(50, 60, 70), vec3(0, 0, 0), 1.0f);
    seen[0] = stage_view(&s, vec3(0, 0, 80), vec3(0, 0, 0), knobs);
    for (int v = 0; v < 3; v++) {
        stage_camera(&s, vec3(v == 1 ? 40 : -60, 20, v == 0 ? 60 : -60), vec3(0, 0, 0), 0.3f, 0.0f);
        seen[1] = stage_shot(&s);
        fresh = stage_view(&s, vec3(v == 1 ? 40 : -60, 20, v == 0 ? 60 : -60), vec3(0, 0, 0), knobs);
        if (!shot_equal(&seen[1], &fresh))
            fail_msg("view %d: difference %g of the mean", v, shot_difference(&seen[1], &fresh).rms);
        REQUIRE(shot_difference(&seen[1], &seen[0]).rms > 0.1);
        shot_free(&seen[1]);
        shot_free(&fresh);
    }
    shot_free(&seen[0]);
    stage_finish(&s);
}

/* --- Normal maps ------------------------------------------------------------------------------------------------------------------ */

#define HALF 30.0f  /* of the sheet, mm */
#define SLOPE 0.25f /* at its steepest */

/* A sheet with waves along x and the texture coordinates of a flat one; `high` 0: flat. */
static void ridges(struct stage *s, size_t material, float wave, float high)
{
    enum { N = 480 };
    struct pell_mesh *m = shapes_mesh(s->scene, material, 2 * (N + 1), 2 * N);

    m->uv[0] = pell_calloc(s->ctx, 2 * (N + 1), 2 * sizeof(float));
    m->tangent = pell_calloc(s->ctx, 2 * (N + 1), 4 * sizeof(float));
    assert_true(m->uv[0] && m->tangent);
    for (uint32_t i = 0; i < 2 * (N + 1); i++) {
        const float x = HALF * (2.0f * (float) (i / 2) / N - 1.0f), y = i % 2 ? HALF : -HALF, k = 2.0f * (float) PELL_PI / wave;
        vec3_store(vec3(x, y, high * sinf(k * x)), m->position + 3 * i);
        vec3_store(vec3_normalize(vec3(-high * k * cosf(k * x), 0, 1)), m->normal + 3 * i);
        vec3_store(vec3_normalize(vec3(1, 0, high * k * cosf(k * x))), m->tangent + 4 * i);
        m->tangent[4 * i + 3] = 1.0f;
        m->uv[0][2 * i] = 0.5f + 0.5f * x / HALF;
        m->uv[0][2 * i + 1] = 0.5f - 0.5f * y / HALF;
    }
    for (uint32_t i = 0; i < N; i++)
        for (uint32_t k = 0; k < 6; k++)
            m->index[6 * i + k] = 2 * i + ((const uint32_t[]) { 0, 2, 3, 0, 3, 1 })[k];
    shapes_bound(s->scene, m);
}

/* The normal map of these waves. */
static struct pell_texture *ridge_map(struct stage *s, float wave)
{
    enum { N = 1024 };
    uint8_t pixels[N][3];

    for (int i = 0; i < N; i++) {
        const float x = HALF * (2.0f * ((float) i + 0.5f) / N - 1.0f);
        const struct pell_vec3 n = vec3_normalize(vec3(-SLOPE * cosf(2.0f * (float) PELL_PI / wave * x), 0, 1));
        pixels[i][0] = (uint8_t) (127.5f * (1.0f + n.x) + 0.5f);
        pixels[i][1] = 128;
        pixels[i][2] = (uint8_t) (127.5f * (1.0f + n.z) + 0.5f);
    }
    return shapes_texture(s->scene, N, 1, 3, false, pixels[0]);
}

/* Mean and contrast of the waves in the middle of an image 24 mm wide: twice the amplitude over the mean, of each channel. */
static void contrast_of(const struct shot *shot, float wave, double mean[3], double contrast[3])
{
    for (size_t c = 0; c < 3; c++) {
        double sum = 0.0, in[2] = { 0 };
        for (int y = 0; y < shot->height; y++)
            for (int x = 0; x < shot->width; x++) {
                const double at = ((x + 0.5) / shot->width - 0.5) * 24.0, phase = 2.0 * PELL_PI * at / (double) wave;
                sum += shot_at(shot, c, x, y);
                in[0] += shot_at(shot, c, x, y) * cos(phase);
                in[1] += shot_at(shot, c, x, y) * sin(phase);
            }
        mean[c] = sum / (double) shot->size;
        contrast[c] = 2.0 * hypot(in[0], in[1]) / sum;
    }
}

/* Light on a flat sheet with a normal map is blurred like that on the waves that the map encodes: their height is small compared with
 * their length, and so is its effect on distances through the medium. */
static void light_on_a_normal_map_is_that_on_its_bumps(void **state)
{
    static const char *const fine[] = { "size=512", "tsm=off", NULL }, *const whole[] = { "density=16", NULL };
    static const double variance[3] = { 0.25, 1.0, 4.0 }, weight[3][3] = { { 0.1, 0.2, 0.3 }, { 0.3, 0.2, 0.1 }, { 0.4, 0.3, 0.2 } };
    (void) state;

    for (int n = 0; n < 2; n++) {
        const float wave = n == 0 ? 4.0f : 8.0f;
        double mean[3][3], contrast[3][3];
        for (int form = 0; form < 3;
             form++) { /* the geometry by the integral over the surface, the map on a flat sheet, the map without scattering */
            struct stage s;
            struct shot shot;
            struct pell_material *m;
            size_t index;
            stage_start(&s, 96, 8);
            m = stage_gaussians(&s, 0.25, &index);
            m->normal_map.texture = form > 0 ? ridge_map(&s, wave) : NULL;
            ridges(&s, index, wave, form > 0 ? 0.0f : SLOPE * wave / (2.0f * (float) PELL_PI));
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(60, 0, 80), vec3(0, 0, 0), 1.0f);
            stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 2.0f);
            shot = stage_shot_of(&s,
                                 form == 0   ? "hierarchical"
                                 : form == 1 ? "texture-space"
                                             : "none",
                                 form == 0   ? whole
                                 : form == 1 ? fine
                                             : NULL);
            contrast_of(&shot, wave, mean[form], contrast[form]);
            shot_free(&shot);
            stage_finish(&s);
        }
        for (size_t c = 0; c < 3; c++) {
            double kept = 0.0, all = 0.0;
            for (int i = 0; i < 3; i++) {
                kept += weight[i][c] * exp(-0.5 * variance[i] * pow(2.0 * PELL_PI / (double) wave, 2.0));
                all += weight[i][c];
            }
            print_message(
                "# waves of %g mm, channel %zu: contrast %.4f on bumps, %.4f on the map, %.4f unscattered (times %.3f: %.4f); mean "
                "%.4f, %.4f\n",
                (double) wave, c, contrast[0][c], contrast[1][c], contrast[2][c], kept / all, kept / all * contrast[2][c], mean[0][c],
                mean[1][c]);
            REQUIRE_NEAR(contrast[1][c], kept / all * contrast[2][c], 0.003);
            REQUIRE_NEAR(contrast[1][c], contrast[0][c], 0.015);
            REQUIRE_REL(mean[1][c], mean[0][c], 0.015);
        }
    }
}

/* --- Inside of a solid ------------------------------------------------------------------------------------------------------------- */

/* An opaque bar in a backlit slab: its shadow reaches the front, as with path-trace, where the light there is 0.10 of that next to it
 * (40 s, noise of 2 %); light solved for the whole solid is left to the method's own transmission. */
static void a_bone_is_seen_through_a_slab(void **state)
{
    static const char *const knobs[] = { "size=256", NULL };
    double behind[2], reference[2];
    (void) state;

    for (int bone = 0; bone < 2; bone++) {
        struct stage s;
        struct shot shot;
        size_t marble, opaque;
        stage_start(&s, 48, 48);
        s.settings.curvature = true;
        stage_medium(&s, "marble", &marble);
        stage_opaque(&s, 0.8f, &opaque);
        stage_box(&s, marble, 1, vec3(-20, -20, -4), vec3(20, 20, 4));
        if (bone)
            stage_box(&s, opaque, 2, vec3(-4, -18, -1.5f), vec3(4, 18, 1.5f));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -100), vec3(0, 0, 0), 3.0f);
        stage_camera(&s, vec3(0, 0, 150), vec3(0, 0, 0), 0.0f, 32.0f);
        shot = stage_shot_of(&s, "texture-space", knobs);
        behind[bone] = shot_at(&shot, SHOT_R, 24, 24);
        reference[bone] = shot_at(&shot, SHOT_R, 6, 24);
        shot_free(&shot);
        stage_finish(&s);
    }
    print_message("# red behind the bone %.4f, next to it %.4f; without a bone %.4f, %.4f\n", behind[1], reference[1], behind[0],
                  reference[0]);
    REQUIRE(behind[1] < 0.12 * reference[1] && behind[0] > 0.9 * reference[0]);
    REQUIRE_REL(reference[1], reference[0], 0.15);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_not_seen_is_left_out_without_a_trace),
        cmocka_unit_test(views_from_all_sides_see_all_of_it),
        cmocka_unit_test(a_bone_is_seen_through_a_slab),
        cmocka_unit_test(light_on_a_normal_map_is_that_on_its_bumps),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
