/* SPDX-License-Identifier: MIT
 * test_texture_space_forms.c - maps that are made in part, of other taps and in other sizes, against those that are whole and
 * dense. */
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

/* --- Maps made in part ------------------------------------------------------------------------------------------------------------ */

static struct shot stage_view(struct stage *s, struct pell_vec3 from, struct pell_vec3 to, const char *const *knobs)
{
    stage_camera(s, from, to, 0.3f, 0.0f);
    return stage_shot_of(s, "texture-space", knobs);
}

/* A picture has the bits of one whose maps are whole: near, from afar, past an edge, of several lights, samples and forms. */
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
                fail_msg("form %zu, view %d: %g of the mean apart", k, v, shot_difference(&shots[0], &shots[1]).rms);
            shot_free(&shots[0]);
            shot_free(&shots[1]);
        }
    stage_finish(&s);
}

/* Other views of maps that were made for the first one have the bits of a renderer that saw none before. */
static void views_from_all_sides_see_all_of_it(void **state)
{
    static const char *const knobs[] = { "size=128", NULL };
    struct shot seen[2], anew;
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
        anew = stage_view(&s, vec3(v == 1 ? 40 : -60, 20, v == 0 ? 60 : -60), vec3(0, 0, 0), knobs);
        if (!shot_equal(&seen[1], &anew))
            fail_msg("view %d: %g of the mean apart", v, shot_difference(&seen[1], &anew).rms);
        REQUIRE(shot_difference(&seen[1], &seen[0]).rms > 0.1);
        shot_free(&seen[1]);
        shot_free(&anew);
    }
    shot_free(&seen[0]);
    stage_finish(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_not_seen_is_left_out_without_a_trace),
        cmocka_unit_test(views_from_all_sides_see_all_of_it),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
