/* SPDX-License-Identifier: MIT
 * test_layered_frames.c - the layered method from frame to frame: fitted planes that are kept, rotated with their solid, or fitted
 * again. */
#include "stage.h"

#include <string.h>

static const char *const knobs[] = { "samples=10", NULL };

enum { REST, LIGHTS, TURNED, BENT, SCALED };

/* An ellipsoid of two layers; `motion`: the positions of its vertices. */
static void object(struct stage *s, int motion)
{
    static const float size[3] = { 12.0f, 7.0f, 4.0f };
    const float a = motion == TURNED ? 0.7f : 0.0f, c = cosf(a), d = sinf(a);
    struct pell_material *m;
    struct pell_mesh *mesh;

    stage_start(s, 48, 32);
    m = stage_medium(s, "marble", NULL);
    m->layers = pell_calloc(s->ctx, 1, sizeof(*m->layers));
    assert_non_null(m->layers);
    m->num_layers = 1;
    m->substrate = PELL_SUBSTRATE_LAST;
    m->layers[0].name = pell_strdup(s->ctx, "layer");
    m->layers[0].medium = m->medium;
    m->layers[0].depth = 1.0f;
    for (int k = 0; k < 3; k++) {
        m->layers[0].medium.sigma_s_reduced[k] = 1.0;
        m->layers[0].medium.sigma_a[k] = 1.0;
        m->layers[0].phase[k] = (struct pell_phase) { PELL_PHASE_HENYEY_GREENSTEIN, { 0.0, 0.0 }, 0.0 };
    }
    stage_ball(s, 0, 0, vec3(0, 0, 0), 1.0f, 40);
    mesh = &s->scene->meshes[0];
    for (uint32_t i = 0; i < mesh->num_vertices; i++) {
        float *p = mesh->position + 3 * (size_t) i, *n = mesh->normal + 3 * (size_t) i;
        struct pell_vec3 q = vec3(size[0] * p[0], size[1] * p[1], size[2] * p[2]);
        struct pell_vec3 w = vec3_normalize(vec3(n[0] / size[0], n[1] / size[1], n[2] / size[2]));
        if (motion == BENT && q.x > 9.0f)
            q.x += 0.5f * (q.x - 9.0f);
        if (motion == SCALED)
            q = vec3_mul(q, 1.1f);
        vec3_store(vec3(c * q.x - d * q.z, q.y, d * q.x + c * q.z), p);
        vec3_store(vec3(c * w.x - d * w.z, w.y, d * w.x + c * w.z), n);
    }
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(motion == LIGHTS ? -0.5f : 0.5f, 0.6f, 0.7f), vec3(0, 0, 0), 1.0f);
    stage_camera(s, vec3(10, 20, 60), vec3(0, 0, 0), 0.5f, 0.0f);
}

/* Bytes of the planes that were fitted for the last image. */
static int64_t fitted(const struct stage *s)
{
    int64_t bytes = 0;

    for (size_t i = 0; i < s->image.num_stages; i++)
        if (strcmp(s->image.stages[i].name, "planes") == 0)
            bytes += s->image.stages[i].bytes;
    return bytes;
}

/* A frame of `moving`, after others, and the same frame by a new renderer. Returns the fraction of planes that were fitted again. */
static double frame(struct stage *moving, int motion, struct difference *d)
{
    struct stage s;
    struct shot alone, shot;
    int64_t all, some;

    object(&s, motion);
    alone = stage_shot_of(&s, "layered", knobs);
    all = fitted(&s);
    OK(pell_renderer_set_scene(moving->r, s.scene));
    moving->set = true;
    shot = stage_shot(moving);
    some = fitted(moving);
    *d = shot_difference(&alone, &shot);
    print_message("# motion %d: %.3g of the planes fitted, largest difference %.3g of the mean\n", motion, (double) some / (double) all,
                  d->largest);
    OK(pell_renderer_set_scene(moving->r, NULL));
    shot_free(&alone);
    shot_free(&shot);
    stage_finish(&s);
    REQUIRE(all > 0);
    return (double) some / (double) all;
}

static void planes_are_kept(void **state)
{
    struct difference d;
    struct stage moving;
    double refitted;

    (void) state;
    stage_start(&moving, 48, 32);
    stage_method(&moving, "layered", knobs);
    REQUIRE(frame(&moving, REST, &d) == 1.0 && d.largest == 0.0);
    REQUIRE(frame(&moving, LIGHTS, &d) == 0.0 && d.largest == 0.0); /* unmoved: the same bits */
    REQUIRE(frame(&moving, TURNED, &d) == 0.0 && d.largest < 0.02);
    refitted = frame(&moving, BENT, &d); /* against the first frame, not the rotated one */
    REQUIRE(refitted > 0.02 && refitted < 0.7 && d.largest < 0.02);
    REQUIRE(frame(&moving, SCALED, &d) == 1.0 && d.largest == 0.0);
    REQUIRE(frame(&moving, REST, &d) == 0.0 && d.largest == 0.0);
    stage_finish(&moving);
}

/* A frame is the same whatever frames lie between it and the first one. */
static void parts_of_a_film_are_alike(void **state)
{
    static const int films[2][4] = { { REST, TURNED, SCALED, BENT }, { REST, BENT, BENT, BENT } };
    struct shot last[2];

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct stage moving;
        stage_start(&moving, 48, 32);
        stage_method(&moving, "layered", knobs);
        for (int i = 0; i < 4; i++) {
            struct stage s;
            object(&s, films[k][i]);
            stage_complete(&s);
            OK(pell_renderer_set_scene(moving.r, s.scene));
            moving.set = true;
            last[k] = stage_shot(&moving);
            OK(pell_renderer_set_scene(moving.r, NULL));
            stage_finish(&s);
            if (i < 3)
                shot_free(&last[k]);
        }
        stage_finish(&moving);
    }
    assert_true(shot_equal(&last[0], &last[1]));
    shot_free(&last[0]);
    shot_free(&last[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(planes_are_kept), cmocka_unit_test(parts_of_a_film_are_alike) };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
