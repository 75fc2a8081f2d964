/* SPDX-License-Identifier: MIT
 * scenes.h - scenes and comparisons shared by the tests of several methods. */
#ifndef PELL_METHODS_SCENES_H
#define PELL_METHODS_SCENES_H

#include "stage.h"

/* Light does not pass from one object to another, even where they touch; within one object it does. Boxes on both sides of x = 0, the
 * right one lit (`whole`: one box instead of both, in which light must travel along the surface); a camera over x = `camera` sees
 * `width` mm in `size` pixels, of which (px, py) lies on the left. */
static inline void require_light_stays_in_its_object(const char *method, const char *const *knobs, bool whole, float camera, float width,
                                                     int size, int px, int py)
{
    double seen[2];

    for (int object = 0; object < 2; object++) {
        struct stage s;
        struct shot shot;
        size_t m;
        stage_start(&s, size, size);
        stage_gaussians(&s, 0.5, &m);
        stage_box(&s, m, 0, vec3(-10, -10, -4), vec3(whole && object == 0 ? 10.0f : 0.0f, 10, 0));
        if (!whole || object == 1)
            stage_box(&s, m, object, vec3(0, -10, -4), vec3(10, 10, 0));
        stage_light(&s, PELL_LIGHT_SPOT, vec3(5, 0, 30), vec3(5, 0, 0), 3e-3f);
        s.scene->lights[0].cos_inner = 0.995f;
        s.scene->lights[0].cos_outer = 0.99f; /* lights x > 0 only */
        stage_camera(&s, vec3(camera, 0, 20), vec3(camera, 0, 0), 0.0f, width);
        shot = stage_shot_of(&s, method, knobs);
        seen[object] = shot_at(&shot, 0, px, py);
        shot_free(&shot);
        stage_finish(&s);
    }
    print_message("# %s: %g through one object, %g from another\n", method, seen[0], seen[1]);
    REQUIRE(seen[0] > 1e-3);
    assert_true(seen[1] == 0.0);
}

/* Keeps the first shot (data NULL before); every later one must be bit-identical, and is freed. */
static inline void shot_require_same(struct shot *first, struct shot *shot)
{
    if (first->data) {
        assert_true(shot_equal(first, shot));
        shot_free(shot);
    } else {
        *first = *shot;
    }
}

#endif
