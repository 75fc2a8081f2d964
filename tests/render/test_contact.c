/* SPDX-License-Identifier: MIT
 * test_contact.c - the contact shadow of objects on the default background. */
#include "stage.h"

#include "render/contact/stage.h"

#define RADIUS 20.0f

/* A ball that touches the plane y = -RADIUS. */
static struct pell_contact *contact_of_ball(struct stage *s, int threads)
{
    struct pell_contact *contact;
    struct pell_pool *pool;
    struct pell_rays *rays;
    size_t m;

    stage_start_threads(s, 16, 16, threads);
    stage_opaque(s, 1.0f, &m);
    stage_ball(s, m, 0, vec3(0, 0, 0), RADIUS, 96);
    for (int c = 0; c < 3; c++) {
        s->scene->bounds_min[c] = -RADIUS;
        s->scene->bounds_max[c] = RADIUS;
    }
    s->scene->contact_shadow = true;
    assert_int_equal(pell_pool_create(s->ctx, threads, &pool), PELL_OK);
    assert_int_equal(pell_rays_create(s->ctx, s->scene, pool, &rays), PELL_OK);
    assert_int_equal(pell_contact_create(s->ctx, pool, s->scene, rays, &contact), PELL_OK);
    assert_non_null(contact);
    pell_rays_destroy(&rays);
    pell_pool_destroy(&pool);
    return contact;
}

/* The fraction of the hemisphere that the ball occludes at a point at distance d from the point of contact: the form factor R^2 cos /
 * D^2 of a sphere above the point's horizon. */
static double hidden(double d)
{
    const double there = sqrt(d * d + (double) (RADIUS * RADIUS));
    return pow((double) RADIUS / there, 3.0);
}

static void a_ball_hides_its_configuration_factor_of_the_sky(void **state)
{
    struct stage s;
    struct pell_contact *contact = contact_of_ball(&s, 2);
    const struct pell_vec3 down = vec3(0, -1, 0);
    const double under = 1.0 - (double) pell_contact_shade(contact, vec3(0, 50, 0), down); /* the effect of full occlusion */
    (void) state;

    REQUIRE(under > 0.5 && under < 0.95);
    for (double d = 5.0; d <= 30.0; d += 5.0)
        for (int turn = 0; turn < 8; turn++) {
            const struct pell_vec3 from = vec3((float) (d * cos(turn)), 50, (float) (d * sin(turn)));
            REQUIRE_NEAR((1.0 - (double) pell_contact_shade(contact, from, down)) / under, hidden(d), 0.035);
        }
    for (int turn = 0; turn < 8; turn++) { /* the shadow ends inside the grid, and is nowhere lighter than the background */
        const struct pell_vec3 edge = vec3((float) (75.0 * cos(turn)), 50, (float) (75.0 * sin(turn)));
        REQUIRE_NEAR((double) pell_contact_shade(contact, edge, down), 1.0, 1e-3);
    }
    REQUIRE_NEAR((double) pell_contact_shade(contact, vec3(0, -50, 0), vec3(0, 1, 0)), 1.0, 0); /* from below */
    REQUIRE_NEAR((double) pell_contact_shade(contact, vec3(0, 50, 0), vec3(0, 1, 0)), 1.0, 0);
    REQUIRE_NEAR((double) pell_contact_shade(contact, vec3(0, 50, 0), vec3(1, 0, 0)), 1.0, 0); /* along the plane */
    pell_contact_destroy(&contact);
    stage_finish(&s);
}

static void threads_do_not_change_it(void **state)
{
    struct stage s[2];
    struct pell_contact *contact[] = { contact_of_ball(&s[0], 1), contact_of_ball(&s[1], 3) };
    (void) state;

    for (float x = -70.0f; x < 70.0f; x += 0.9f)
        assert_true(pell_contact_shade(contact[0], vec3(x, 9, 3), vec3(0.1f, -1, 0.2f)) ==
                    pell_contact_shade(contact[1], vec3(x, 9, 3), vec3(0.1f, -1, 0.2f)));
    for (int i = 0; i < 2; i++) {
        pell_contact_destroy(&contact[i]);
        stage_finish(&s[i]);
    }
}

/* The shadow darkens the background below the ball, and nothing else. */
static void pixels_outside_of_it_have_the_bits_of_the_plain_background(void **state)
{
    struct shot shot[2];
    (void) state;

    for (int i = 0; i < 2; i++) {
        struct stage s;
        size_t m;
        stage_start(&s, 64, 64);
        stage_opaque(&s, 1.0f, &m);
        stage_ball(&s, m, 0, vec3(0, 0, 0), RADIUS, 48);
        stage_environment(&s, 1.0f);
        stage_camera(&s, vec3(0, 40, 200), vec3(0, 0, 0), 0.0f, 120.0f);
        s.scene->background = PELL_BACKGROUND_COLOR;
        for (int c = 0; c < 3; c++)
            s.scene->background_color[c] = 0.4f;
        s.scene->contact_shadow = i == 1;
        shot[i] = stage_shot_of(&s, "screen-space", NULL);
        stage_finish(&s);
    }
    for (int c = 0; c < 3; c++) {
        assert_true(shot_at(&shot[0], SHOT_SHOWN + c, 2, 2) == shot_at(&shot[1], SHOT_SHOWN + c, 2, 2));     /* above */
        assert_true(shot_at(&shot[0], SHOT_SHOWN + c, 32, 32) == shot_at(&shot[1], SHOT_SHOWN + c, 32, 32)); /* the ball */
        REQUIRE(shot_at(&shot[1], SHOT_SHOWN + c, 32, 43) < 0.8 * shot_at(&shot[0], SHOT_SHOWN + c, 32, 43));
    }
    shot_free(&shot[0]);
    shot_free(&shot[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_ball_hides_its_configuration_factor_of_the_sky),
        cmocka_unit_test(threads_do_not_change_it),
        cmocka_unit_test(pixels_outside_of_it_have_the_bits_of_the_plain_background),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
