/* SPDX-License-Identifier: MIT
 * test_camera_view.c - rays of pixels, and bounding rectangles of boxes in the image. */
#include "pell_test.h"

#include "render/camera_view.h"

static struct pell_camera camera_at(struct pell_vec3 position, struct pell_vec3 forward, float fov, float ortho)
{
    struct pell_camera c = { .fov = fov, .ortho_height = ortho };
    struct pell_vec3 t, b;

    forward = vec3_normalize(forward);
    vec3_basis(forward, &t, &b);
    vec3_store(position, c.position);
    vec3_store(forward, c.forward);
    vec3_store(t, c.up);
    return c;
}

static void the_corners_of_the_picture_are_where_the_camera_says(void **state)
{
    const struct pell_camera c = { .position = { 1, 2, 3 }, .forward = { 0, 0, -1 }, .up = { 0, 1, 0 }, .fov = 1.0f };
    const struct pell_camera o = { .position = { 1, 2, 3 }, .forward = { 0, 0, -1 }, .up = { 0, 1, 0 }, .ortho_height = 50.0f };
    struct pell_view v = pell_view_make(&c, 64, 32, 0.0f, 0.0f);
    struct pell_vec3 start, d;

    (void) state;
    REQUIRE_REL(v.focal_px, 16.0 / tan(0.5), 1e-6);
    pell_view_ray(&v, -0.5f, -0.5f, &start, &d); /* the upper left corner */
    REQUIRE_REL(d.x, -2.0 * tan(0.5), 1e-6);
    REQUIRE_REL(d.y, tan(0.5), 1e-6);
    REQUIRE_NEAR(d.z, -1.0, 0);
    REQUIRE_NEAR(start.x, 1.0, 0);
    pell_view_ray(&v, 63.5f, 31.5f, &start, &d);
    REQUIRE_REL(d.x, 2.0 * tan(0.5), 1e-6);
    REQUIRE_REL(d.y, -tan(0.5), 1e-6);
    v = pell_view_make(&o, 64, 32, 0.25f, -0.25f);
    REQUIRE_REL(v.focal_px, 32.0 / 50.0, 1e-6);
    assert_true(v.orthographic);
    pell_view_ray(&v, 0.0f, 0.0f, &start, &d);
    REQUIRE_REL(start.x, 1.0 + (0.75 - 32.0) / 0.64, 1e-6);
    REQUIRE_REL(start.y, 2.0 + (16.0 - 0.25) / 0.64, 1e-6); /* y runs down */
    REQUIRE_NEAR(d.x, 0.0, 0);
    REQUIRE_NEAR(d.z, -1.0, 0);
}

/* Every pixel whose ray hits the box must be in the rectangle, and the rectangle must not be much larger than their bounds. */
static void rectangles_hold_every_pixel_that_sees_the_box(void **state)
{
    static const float low[3] = { -3, 1, 2 }, high[3] = { 4, 3, 9 };
    static const int sizes[][2] = { { 1, 1 }, { 7, 3 }, { 64, 48 }, { 101, 37 } };
    uint32_t seed = 1;
    int seen_at_all = 0;

    (void) state;
    for (int n = 0; n < 400; n++) {
        const int w = sizes[n % 4][0], h = sizes[n % 4][1];
        struct pell_vec3 camera, at;
        struct pell_rect rect, tight = { w, h, 0, 0 };
        struct pell_view v;
        float r[8];
        for (int i = 0; i < 8; i++) {
            seed = seed * 1664525u + 1013904223u;
            r[i] = (float) (seed >> 8) / 16777216.0f - 0.5f;
        }
        camera = vec3(60.0f * r[0], 60.0f * r[1], 60.0f * r[2]);
        at = vec3(20.0f * r[3], 20.0f * r[4], 20.0f * r[5]);
        struct pell_camera c = camera_at(camera, vec3_sub(at, camera), 0.7f, n % 3 ? 0.0f : 25.0f);
        v = pell_view_make(&c, w, h, r[6], r[7]);
        rect = pell_view_rect(&v, low, high);
        assert_true(rect.x0 >= 0 && rect.y0 >= 0 && rect.x1 <= w && rect.y1 <= h);
        for (int y = 0; y < h; y++)
            for (int x = 0; x < w; x++) {
                struct pell_vec3 o, d;
                double near = 0.0, far = INFINITY;
                pell_view_ray(&v, (float) x, (float) y, &o, &d);
                const double oo[3] = { o.x, o.y, o.z }, dd[3] = { d.x, d.y, d.z };
                for (int k = 0; k < 3; k++) {
                    const double a = (low[k] - oo[k]) / dd[k], b = (high[k] - oo[k]) / dd[k];
                    near = fmax(near, fmin(a, b));
                    far = fmin(far, fmax(a, b));
                }
                if (near > far)
                    continue;
                seen_at_all++;
                assert_in_range(x, rect.x0, rect.x1 - 1);
                assert_in_range(y, rect.y0, rect.y1 - 1);
                tight.x0 = x < tight.x0 ? x : tight.x0;
                tight.y0 = y < tight.y0 ? y : tight.y0;
                tight.x1 = x + 1 > tight.x1 ? x + 1 : tight.x1;
                tight.y1 = y + 1 > tight.y1 ? y + 1 : tight.y1;
            }
        /* Where the whole box is in view and not small, the border is about one pixel. */
        if (w == 64 && rect.x0 > 0 && rect.y0 > 0 && rect.x1 < w && rect.y1 < h && tight.x1 - tight.x0 > 8 && tight.y1 - tight.y0 > 8) {
            assert_in_range(tight.x0 - rect.x0, 0, 4);
            assert_in_range(rect.x1 - tight.x1, 0, 4);
            assert_in_range(tight.y0 - rect.y0, 0, 4);
            assert_in_range(rect.y1 - tight.y1, 0, 4);
        }
    }
    assert_true(seen_at_all > 5000);
}

static void boxes_behind_around_and_empty(void **state)
{
    const struct pell_camera c = camera_at(vec3(0, 0, 0), vec3(0, 0, -1), 0.7f, 0.0f), o = camera_at(vec3(0, 0, 0), vec3(0, 0, -1), 0, 10);
    const struct pell_view v = pell_view_make(&c, 64, 48, 0, 0), w = pell_view_make(&o, 64, 48, 0, 0);
    struct pell_rect r;

    (void) state;
    r = pell_view_rect(&v, (float[]) { -1, -1, 2 }, (float[]) { 1, 1, 3 });
    assert_true(r.x0 >= r.x1);
    r = pell_view_rect(&w, (float[]) { -1, -1, 2 }, (float[]) { 1, 1, 3 });
    assert_true(r.x0 >= r.x1);
    r = pell_view_rect(&v, (float[]) { -1, -1, -1 }, (float[]) { 1, 1, 3 }); /* the camera is inside the box */
    assert_true(r.x0 == 0 && r.y0 == 0 && r.x1 == 64 && r.y1 == 48);
    r = pell_view_rect(&w, (float[]) { -1, -1, -1 }, (float[]) { 1, 1, 3 }); /* 2 mm of 10 mm: still tight */
    assert_in_range(r.y1 - r.y0, 9, 13);
    r = pell_view_rect(&v, (float[]) { 1, 1, -5 }, (float[]) { -1, -1, -3 });
    assert_true(r.x0 >= r.x1);
    r = pell_view_rect(&v, (float[]) { -INFINITY, -1, -5 }, (float[]) { 1, 1, -3 });
    assert_true(r.x0 == 0 && r.y0 == 0 && r.x1 == 64 && r.y1 == 48);
    r = pell_view_rect(&v, (float[]) { 100, -1, -5 }, (float[]) { 101, 1, -3 }); /* outside the image */
    assert_true(r.x0 >= r.x1 || r.y0 >= r.y1);
    r = pell_view_rect(&v, (float[]) { -1e30f, -1e30f, -1e-30f }, (float[]) { 1e30f, 1e30f, -1e-31f });
    assert_true(r.x0 == 0 && r.y0 == 0 && r.x1 == 64 && r.y1 == 48);
    r = pell_view_rect(&v, (float[]) { 0, 0, -5 }, (float[]) { 0, 0, -5 }); /* a point */
    assert_true(r.x0 <= 31 && r.x1 >= 33 && r.x1 - r.x0 <= 4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_corners_of_the_picture_are_where_the_camera_says),
        cmocka_unit_test(rectangles_hold_every_pixel_that_sees_the_box),
        cmocka_unit_test(boxes_behind_around_and_empty),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
