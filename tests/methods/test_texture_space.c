/* SPDX-License-Identifier: MIT
 * test_texture_space.c - the texture-space method on whole scenes: blurs against closed forms, good and bad texture layouts, seams, and
 * transmitted light. */
#include "scenes.h"

#include <pellucid/layers.h>

#define HALF 30.0f /* of the sheets, mm */

/* With the margin of the borders 256 texels remain for a layout, and the edge of the light lies between texels. */
static const char *const plain[] = { "size=308", "border=24", "tsm=off", NULL };
static const double width_of[3] = { 1.0, 2.0, 4.0 }, weight_of[3][3] = { { 0.1, 0.2, 0.3 }, { 0.3, 0.2, 0.1 }, { 0.4, 0.3, 0.2 } };

static double normal_cdf(double x)
{
    return 0.5 * erfc(-x / sqrt(2.0));
}

/* --- Sheets with layouts of any kind, lit except for the quadrant x < 0, y < 0 ---------------------------------------------------- */

enum layout { GOOD, SQUEEZED, UNEVEN, ROTATED, SHEARED, CUT, LAYOUTS };
static const char *const layout_names[LAYOUTS] = { "good", "squeezed", "uneven", "rotated", "sheared", "cut into charts" };

/* The texture coordinates of a point of the sheet, in [-1, 1]^2; `part`: the quadrant that it belongs to. */
static void lay_out(enum layout layout, double x, double y, int part, float uv[2])
{
    static const double turn[4] = { 0.0, 0.5 * PELL_PI, PELL_PI, 0.7 };
    double u = 0.5 + 0.5 * x, v = 0.5 - 0.5 * y;

    if (layout == SQUEEZED) {
        v = 0.25 * v;
    } else if (layout == UNEVEN) {
        u = 0.5 + 0.5 * x + 0.1 * sin(PELL_PI * x); /* from 0.37 to 1.63 times the mean */
        v = 0.5 - 0.5 * y - 0.1 * sin(PELL_PI * y);
    } else if (layout == ROTATED) {
        u = cos(0.5) * x - sin(0.5) * y;
        v = sin(0.5) * x + cos(0.5) * y;
    } else if (layout == SHEARED) {
        u = 0.5 * x + 0.25 * y;
        v = 0.5 * y;
    } else if (layout == CUT) { /* separate quadrants, each rotated differently */
        const double cx = part % 2 ? 0.5 : -0.5, cy = part / 2 ? 0.5 : -0.5, c = cos(turn[part]), s = sin(turn[part]);
        u = (part % 2 ? 1.0 : -1.0) + c * (x - cx) - s * (y - cy);
        v = (part / 2 ? 1.0 : -1.0) + s * (x - cx) + c * (y - cy);
    }
    uv[0] = (float) u;
    uv[1] = (float) v;
}

/* A sheet of 16 x 16 cells, facing +z. Quadrants of a cut layout have vertices of their own. */
static struct pell_mesh *sheet(struct stage *s, size_t material, enum layout layout)
{
    const int n = 16;
    struct pell_mesh *m = shapes_mesh(s->scene, material, (uint32_t) (4 * n * n), (uint32_t) (2 * n * n));

    m->uv[0] = pell_calloc(s->ctx, (size_t) (4 * n * n), 2 * sizeof(float));
    assert_non_null(m->uv[0]);
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++) {
            const uint32_t first = (uint32_t) (4 * (j * n + i));
            uint32_t *index = m->index + 6 * (j * n + i);
            for (uint32_t k = 0; k < 4; k++) {
                const double x = -1.0 + 2.0 * (i + (k == 1 || k == 2)) / n, y = -1.0 + 2.0 * (j + (k >= 2)) / n;
                vec3_store(vec3(HALF * (float) x, HALF * (float) y, 0.0f), m->position + 3 * (first + k));
                vec3_store(vec3(0, 0, 1), m->normal + 3 * (first + k));
                lay_out(layout, x, y, 2 * (j >= n / 2) + (i >= n / 2), m->uv[0] + 2 * (first + k));
            }
            for (uint32_t k = 0; k < 6; k++)
                index[k] = first + ((const uint32_t[]) { 0, 1, 2, 0, 2, 3 })[k];
        }
    shapes_bound(s->scene, m);
    return m;
}

/* `edge`: distance of the shadow's corner from the middle, where a cut layout is cut. */
static void quadrant(struct stage *s, enum layout layout, int size, float edge)
{
    size_t m, opaque;

    stage_start(s, size, size);
    stage_gaussians(s, 0.5, &m);
    stage_opaque(s, 0.5f, &opaque);
    sheet(s, m, layout);
    shapes_quad(s->scene, opaque, vec3(edge - 50, edge - 50, 50), vec3(50, 0, 0), vec3(0, 50, 0));
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 1.0f);
    stage_camera(s, vec3(0, 0, 20), vec3(0, 0, 0), 0.0f, 24.0f);
}

/* Largest and root mean square difference from the convolution, relative to the step: of pixels within `near` mm of a seam (x = 0 or y =
 * 0), or further from both. */
static void quadrant_error(const struct shot *shot, double edge, double near, double largest[2], double rms[2])
{
    int n[2] = { 0 };

    largest[0] = largest[1] = rms[0] = rms[1] = 0.0;
    for (int y = 0; y < shot->height; y++)
        for (int x = 0; x < shot->width; x++) {
            const double px = ((x + 0.5) / shot->width - 0.5) * 24.0, py = (0.5 - (y + 0.5) / shot->height) * 24.0;
            const int far = fmin(fabs(px), fabs(py)) > near;
            for (size_t c = 0; c < 3; c++) {
                double expected = 0.0, e, total = 0.0;
                for (int i = 0; i < 3; i++) {
                    expected += weight_of[i][c] * (1.0 - normal_cdf((edge - px) / width_of[i]) * normal_cdf((edge - py) / width_of[i]));
                    total += weight_of[i][c];
                }
                e = fabs(shot_at(shot, c, x, y) * PELL_PI - expected) / total;
                largest[far] = fmax(largest[far], e);
                rms[far] += e * e;
                n[far]++;
            }
        }
    for (int k = 0; k < 2; k++)
        rms[k] = n[k] ? sqrt(rms[k] / n[k]) : 0.0;
}

static void quadrant_of(enum layout layout, const char *const *knobs, double edge, double near, double largest[2], double rms[2])
{
    struct stage s;
    struct shot shot;

    quadrant(&s, layout, 48, (float) edge);
    shot = stage_shot_of(&s, "texture-space", knobs);
    quadrant_error(&shot, edge, near, largest, rms);
    shot_free(&shot);
    stage_finish(&s);
}

static void a_sheet_lit_in_part_is_the_convolution(void **state)
{
    static const char *const fine[] = { "size=564", "border=24", "tsm=off", NULL };
    double largest[2], rms[2], finer[2], unused[2];

    (void) state;
    RELEASE_ONLY();
    quadrant_of(GOOD, plain, 0.0, 1e9, largest, rms);
    quadrant_of(GOOD, fine, 0.0, 1e9, finer, unused);
    print_message("# 256 texels over 60 mm: %.4f of the step off at most, %.4f rms; 512: %.4f\n", largest[0], rms[0], finer[0]);
    REQUIRE(largest[0] < 0.01 && rms[0] < 0.002);
    REQUIRE(finer[0] < 0.006);
}

/* The axes of the sheared layout are not perpendicular: a separable blur along them is anisotropic, which is visible with the paper's
 * taps. */
/* Thirteen taps approximate the convolution: their error is shown next to that of the paper's seven taps per blur. */
static void fewer_taps_are_near_the_convolution(void **state)
{
    static const char *const seven[] = { "size=308", "border=24", "tsm=off", "kernel=seven", NULL };
    static const char *const thirteen[] = { "size=308", "border=24", "tsm=off", "kernel=jittered-13", NULL };
    double largest[2][2], rms[2][2];
    (void) state;
    RELEASE_ONLY();

    quadrant_of(GOOD, seven, 0.0, 1e9, largest[0], rms[0]);
    quadrant_of(GOOD, thirteen, 0.0, 1e9, largest[1], rms[1]);
    print_message("# seven: %.4f of the step at most, %.4f rms; jittered-13: %.4f, %.4f\n", largest[0][0], rms[0][0], largest[1][0],
                  rms[1][0]);
    REQUIRE(rms[0][0] < 0.015 && rms[1][0] < 0.035);
}

static void layouts_of_all_kinds_give_one_picture(void **state)
{
    static const double most[LAYOUTS] = { 0.005, 0.01, 0.005, 0.01, 0.04, 0.03 };
    static const char *const uncorrected[] = { "size=308", "border=24", "tsm=off", "stretch=off", NULL };

    (void) state;
    for (int k = 0; k < LAYOUTS; k++) {
        double largest[2], rms[2];
        quadrant_of((enum layout) k, plain, 0.0, 1e9, largest, rms);
        print_message("# %s: %.4f at most, %.4f rms\n", layout_names[k], largest[0], rms[0]);
        REQUIRE(largest[0] < most[k]);
        if (k == SHEARED) {
            static const char *const seven[] = { "size=308", "border=24", "tsm=off", "kernel=seven", NULL };
            double along[2], unused[2];
            quadrant_of(SHEARED, seven, 0.0, 1e9, along, unused);
            print_message("#   straight along the axes %.4f\n", along[0]);
            REQUIRE(along[0] > 2.0 * largest[0]);
        }
        if (k == SQUEEZED || k == UNEVEN) {
            double off[2], unused[2];
            quadrant_of((enum layout) k, uncorrected, 0.0, 1e9, off, unused);
            print_message("#   without regard to the stretch %.4f\n", off[0]);
            REQUIRE(off[0] > 2.0 * largest[0]);
        }
    }
}

static void no_seam_shows_on_a_sheet_that_is_cut(void **state)
{
    static const char *const with[] = { "size=564", "tsm=off", "border=64", NULL }, *const bare[] = { "size=564", "tsm=off", "border=0",
                                                                                                      NULL };
    double largest[2], rms[2], without[2], unused[2];

    (void) state;
    quadrant_of(CUT, with, 1.3, 0.5, largest, rms);
    quadrant_of(CUT, bare, 1.3, 0.5, without, unused);
    print_message("# within half a mm of a seam %.4f at most (%.4f rms), elsewhere %.4f (%.4f); without borders %.4f\n", largest[0], rms[0],
                  largest[1], rms[1], without[0]);
    REQUIRE(largest[0] < 0.02 && largest[0] < 1.3 * largest[1]);
    REQUIRE(without[0] > 5.0 * largest[0]);
}

static double layout_ms(const struct stage *s)
{
    for (size_t i = 0; i < s->image.num_stages; i++)
        if (strcmp(s->image.stages[i].name, "layout") == 0)
            return s->image.stages[i].ms;
    return 0.0;
}

/* Motion of a vertex: the whole sheet is stretched, or each side of the seam at x = 0 differently. */
static void stretch(struct stage *s, const float *rest, int how)
{
    struct pell_mesh *m = &s->scene->meshes[0];

    for (uint32_t i = 0; i < m->num_vertices; i++) {
        const float x = rest[3 * i], y = rest[3 * i + 1];
        m->position[3 * i] = how == 1 ? 1.15f * x : how == 2 ? x * (x > 0.0f ? 1.15f : 0.9f) : x;
        m->position[3 * i + 1] = how == 1 ? 0.9f * y : y;
    }
}

/* A deforming mesh keeps its layout, by its triangles; the blur is the convolution on the deformed surface. */
static void a_sheet_that_deforms_is_the_convolution(void **state)
{
    static const char *const knobs[] = { "size=564", "tsm=off", "border=64", NULL };
    static const char *const names[3] = { "at rest", "stretched by 1.15 x 0.9", "by 1.15 and 0.9 beside a seam" };
    struct stage s;
    float *rest;
    double first;
    (void) state;

    quadrant(&s, CUT, 48, 1.3f);
    rest = malloc(3 * sizeof(float) * s.scene->meshes[0].num_vertices);
    memcpy(rest, s.scene->meshes[0].position, 3 * sizeof(float) * s.scene->meshes[0].num_vertices);
    stage_method(&s, "texture-space", knobs);
    stage_render(&s);
    first = layout_ms(&s);
    for (int how = 0; how < 3; how++) {
        double largest[2], rms[2], fresh[2], fresh_rms[2], now;
        struct shot shot;
        struct stage other;

        stretch(&s, rest, how);
        OK(pell_renderer_set_scene(s.r, s.scene));
        shot = stage_shot(&s);
        now = layout_ms(&s);
        quadrant_error(&shot, 1.3, 0.5, largest, rms);
        shot_free(&shot);
        quadrant(&other, CUT, 48, 1.3f);
        stretch(&other, rest, how);
        shot = stage_shot_of(&other, "texture-space", knobs);
        quadrant_error(&shot, 1.3, 0.5, fresh, fresh_rms);
        shot_free(&shot);
        stage_finish(&other);
        print_message("# %s: near seams %.4f at most (%.4f rms), elsewhere %.4f; new layout %.4f (%.4f), %.4f; layout %.1f ms, once %.1f\n",
                      names[how], largest[0], rms[0], largest[1], fresh[0], fresh_rms[0], fresh[1], now, first);
        REQUIRE(largest[0] < 1.3 * fresh[0] + (how == 2 ? 0.02 : 0.003) && largest[1] < 1.1 * fresh[1] + 0.001);
        REQUIRE(now > 0.0 && now < 0.5 * first);
    }
    free(rest);
    stage_finish(&s);
}

/* After other texture coordinates, or a triangle whose area vanishes or reappears, the layout is computed again: the image equals that
 * of a new renderer. */
static void other_surfaces_are_laid_out_anew(void **state)
{
    static const char *const knobs[] = { "size=128", NULL };
    struct stage s;
    (void) state;

    quadrant(&s, GOOD, 24, 0.0f);
    stage_method(&s, "texture-space", knobs);
    stage_render(&s);
    for (int k = 0; k < 3; k++) {
        struct stage other;
        struct shot shot[2];

        quadrant(&other, GOOD, 24, 0.0f);
        for (int i = 0; i < 2; i++) {
            struct pell_mesh *m = &(i ? other.scene : s.scene)->meshes[0];
            if (k == 0 || (k == 1 && i == 1))
                m->uv[0][0] -= 0.05f;
            if (k == 1) /* the second triangle loses its area */
                memcpy(m->position + 3 * m->index[5], m->position + 3 * m->index[4], 3 * sizeof(float));
            if (k == 2 && i == 0) { /* and regains it */
                m->position[3 * m->index[5]] = m->position[3 * m->index[3]];
                m->uv[0][0] += 0.05f;
            }
        }
        OK(pell_renderer_set_scene(s.r, s.scene));
        shot[0] = stage_shot(&s);
        shot[1] = stage_shot_of(&other, "texture-space", knobs);
        if (!shot_equal(&shot[0], &shot[1]))
            fail_msg("case %d: difference %g of the mean", k, shot_difference(&shot[0], &shot[1]).rms);
        shot_free(&shot[0]);
        shot_free(&shot[1]);
        stage_finish(&other);
    }
    stage_finish(&s);
}

/* Frames of a sequence in which only the camera moves are bit-identical to those of a new renderer. */
static void a_surface_at_rest_keeps_its_picture(void **state)
{
    static const char *const knobs[] = { "size=128", NULL };
    struct shot shot[2];
    struct stage s;
    size_t m;
    (void) state;

    stage_start(&s, 40, 40);
    stage_gaussians(&s, 0.5, &m);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 10.0f, 24);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(30, 40, 100), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(25, 10, 30), vec3(0, 0, 0), 0.0f, 24.0f);
    shot[0] = stage_shot_of(&s, "texture-space", knobs);
    OK(pell_renderer_set_scene(s.r, s.scene));
    shot[1] = stage_shot(&s);
    REQUIRE(layout_ms(&s) > 0.0);
    if (!shot_equal(&shot[0], &shot[1]))
        fail_msg("difference %g of the mean", shot_difference(&shot[0], &shot[1]).rms);
    shot_free(&shot[0]);
    shot_free(&shot[1]);
    stage_finish(&s);
}

/* --- Solids ------------------------------------------------------------------------------------------------------------------------ */

/* A cube without texture coordinates, lit from above: its top and a side in view. The exiting light must agree on both sides of their
 * edge. */
static void light_goes_round_the_edges_of_a_cube(void **state)
{
    static const char *const with[] = { "size=512", "tsm=off", NULL }, *const bare[] = { "size=512", "tsm=off", "border=0", NULL };
    double jump[2], corner[2][2];

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct stage s;
        struct shot shot;
        size_t m;
        stage_start(&s, 64, 64);
        stage_gaussians(&s, 0.5, &m);
        stage_box(&s, m, 0, vec3(-10, -10, -10), vec3(10, 10, 10));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 100, 0), vec3(0, 0, 0), 1.0f);
        stage_camera(&s, vec3(0, 50, 50), vec3(0, 10, 10), 0.0f, 4.0f); /* the edge is at the middle of the image */
        shot = stage_shot_of(&s, "texture-space", k ? bare : with);
        jump[k] = fabs(shot_at(&shot, 0, 32, 31) / shot_at(&shot, 0, 32, 32) - 1.0);
        shot_free(&shot);
        stage_camera(&s, vec3(60, 60, 60), vec3(10, 10, 10), 0.0f, 8.0f); /* the corner, where three charts meet */
        OK(pell_renderer_set_scene(s.r, s.scene));
        shot = stage_shot(&s);
        corner[k][0] = shot_at(&shot, 0, 27, 36);
        corner[k][1] = shot_at(&shot, 0, 36, 36);
        shot_free(&shot);
        stage_finish(&s);
    }
    print_message("# difference across the edge %.4f, without borders %.4f; near the corner %.4f\n", jump[0], jump[1],
                  fabs(corner[0][0] / corner[0][1] - 1.0));
    REQUIRE(jump[0] < 0.06 && jump[1] > 0.5);
    REQUIRE_REL(corner[0][0], corner[0][1], 0.03);
    REQUIRE(corner[0][0] > 0.02);
}

/* A ball with dents, like those of a head: it faces all directions, and its charts meet at various angles. */
static void dented_ball(struct stage *s, size_t material)
{
    struct pell_mesh *m;

    stage_ball(s, material, 0, vec3(0, 0, 0), 10.0f, 48);
    m = &s->scene->meshes[s->scene->num_meshes - 1];
    for (uint32_t i = 0; i < m->num_vertices; i++) {
        float *p = m->position + 3 * i;
        const double r = 1.0 + 0.08 * sin(0.5 * (double) p[0]) * cos(0.45 * (double) p[1]) + 0.05 * sin(0.6 * (double) p[2] + 1.0);
        vec3_store(vec3_mul(vec3_load(p), (float) r), p);
    }
}

/* Whether the pixel is well inside the silhouettes: at silhouettes the methods differ, as light travels along the surface there and not
 * across. */
static bool is_inside(const struct shot *shot, int x, int y, int margin)
{
    for (int k = 0; k < 4; k++) {
        const int px = x + (k % 2 ? margin : -margin), py = y + (k / 2 ? margin : -margin);
        if (px < 0 || py < 0 || px >= shot->width || py >= shot->height || shot_at(shot, SHOT_A, px, py) < 1.0)
            return false;
    }
    return true;
}

/* Error near seams and elsewhere, relative to the mean: the largest inside silhouettes, and the largest anywhere. */
struct seams {
    double inside[2], all[2], rms[2], bare;
    int count[2];
};

/* Seams are located where an image without borders differs from the one with borders. */
static struct seams seams_of(bool dents)
{
    static const char *const sets[2][5] = { { "size=384", "charts=planar", "tsm=off", NULL },
                                            { "size=384", "charts=planar", "tsm=off", "border=0", NULL } };
    static const char *const whole[] = { "density=64", NULL };
    struct seams out = { { 0.0 } };
    struct shot shots[2], sum;
    struct stage s;
    double mean = 0.0;
    int count = 0;
    size_t m;

    stage_start(&s, 64, 64);
    stage_gaussians(&s, 0.25, &m);
    if (dents)
        dented_ball(&s, m);
    else
        stage_ball(&s, m, 0, vec3(0, 0, 0), 10.0f, 48);
    stage_light(&s, PELL_LIGHT_POINT, vec3(60, 40, 50), vec3(0, 0, 0), 5e-3f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 20.0f);
    for (int k = 0; k < 2; k++)
        shots[k] = stage_shot_of(&s, "texture-space", sets[k]);
    sum = stage_shot_of(&s, "hierarchical", whole);
    for (int y = 0; y < 64; y++)
        for (int x = 0; x < 64; x++)
            if (shot_at(&sum, SHOT_A, x, y) >= 1.0) {
                mean += shot_at(&sum, 0, x, y);
                count++;
            }
    mean /= count;
    for (int y = 0; y < 64; y++)
        for (int x = 0; x < 64; x++) {
            const double is = shot_at(&sum, 0, x, y), off = fabs(shot_at(&shots[0], 0, x, y) - is) / mean;
            const int far = fabs(shot_at(&shots[0], 0, x, y) - shot_at(&shots[1], 0, x, y)) < 0.02 * mean;
            if (shot_at(&sum, SHOT_A, x, y) < 1.0)
                continue;
            out.count[far]++;
            out.all[far] = fmax(out.all[far], off);
            out.bare = fmax(out.bare, fabs(shot_at(&shots[1], 0, x, y) - is) / mean);
            out.rms[far] += off * off;
            if (is_inside(&sum, x, y, 3))
                out.inside[far] = fmax(out.inside[far], off);
        }
    for (int k = 0; k < 2; k++) {
        out.rms[k] = sqrt(out.rms[k] / out.count[k]);
        shot_free(&shots[k]);
    }
    shot_free(&sum);
    stage_finish(&s);
    return out;
}

static void no_seam_shows_on_a_solid_in_many_charts(void **state)
{
    struct seams s[2];

    (void) state;
    for (int dents = 0; dents < 2; dents++) {
        s[dents] = seams_of(dents);
        print_message(
            "# %s: %d pixels at seams, %d elsewhere: %.4f and %.4f of the mean off at most, off silhouettes %.4f and %.4f, rms %.4f "
            "and %.4f; without borders %.3f\n",
            dents ? "dented ball" : "ball", s[dents].count[0], s[dents].count[1], s[dents].all[0], s[dents].all[1], s[dents].inside[0],
            s[dents].inside[1], s[dents].rms[0], s[dents].rms[1], s[dents].bare);
        REQUIRE(s[dents].count[0] > 50 && s[dents].count[1] > 500);
        REQUIRE(s[dents].all[0] < 0.048 && s[dents].all[0] < 1.3 * s[dents].all[1]);
        REQUIRE(s[dents].bare > 3.0 * s[dents].all[0]);
    }
    REQUIRE(s[1].inside[0] <= s[1].inside[1]);
    REQUIRE(s[0].rms[0] <= 1.1 * s[0].rms[1]);
}

static void uniform_light_gives_the_albedo(void **state)
{
    (void) state;
    static const char *const forms[3][3] = { { "size=128" }, { "size=128", "as=paper" }, { "size=128", "kernel=jittered-13" } };

    for (int form = 0; form < 3; form++) {
        struct stage s;
        struct shot shot;
        double low[3] = { 1e9, 1e9, 1e9 }, high[3] = { 0 };
        size_t m;
        stage_start(&s, 40, 40);
        stage_gaussians(&s, 0.5, &m);
        stage_ball(&s, m, 0, vec3(0, 0, 0), 10.0f, 24);
        stage_environment(&s, 1.0f);
        stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 22.0f);
        shot = stage_shot_of(&s, "texture-space", forms[form]);
        for (int y = 0; y < 40; y++)
            for (int x = 0; x < 40; x++)
                for (size_t c = 0; c < 3; c++)
                    if (shot_at(&shot, SHOT_A, x, y) >= 1.0) {
                        low[c] = fmin(low[c], shot_at(&shot, c, x, y));
                        high[c] = fmax(high[c], shot_at(&shot, c, x, y));
                    }
        for (size_t c = 0; c < 3; c++) {
            REQUIRE_REL(low[c], 0.8 - 0.1 * (double) c, 0.01);
            REQUIRE_REL(high[c], 0.8 - 0.1 * (double) c, 0.01);
        }
        shot_free(&shot);
        stage_finish(&s);
    }
}

/* --- Transmitted light ------------------------------------------------------------------------------------------------------------- */

static double transmission_of_slab(const char *material, double thick, const char *const *knobs, size_t channel)
{
    struct stage s;
    struct shot shot;
    double out;
    size_t m;

    stage_start(&s, 8, 8);
    stage_medium(&s, material, &m)->color_from = PELL_COLOR_FROM_PROFILE;
    stage_box(&s, m, 0, vec3(-60, -60, (float) -thick), vec3(60, 60, 0));
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -100), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 50), vec3(0, 0, 0), 0.0f, 4.0f);
    shot = stage_shot_of(&s, "texture-space", knobs);
    out = shot_at(&shot, channel, 4, 4) * PELL_PI;
    shot_free(&shot);
    stage_finish(&s);
    return out;
}

static void transmission_of_a_slab_is_the_slab_integral(void **state)
{
    static const char *const rays[] = { "size=128", NULL }, *const map[] = { "size=128", "tsm=map", "tsm-size=256", NULL };
    static const char *const gaussian[] = { "size=128", "through=gaussian", NULL };
    static const double thick[] = { 2.0, 5.0, 10.0 };
    const struct pell_material_entry *marble = pell_material_find("marble");
    struct pell_profile *profiles = calloc(3, sizeof(*profiles));
    const struct pell_fit_params fit = { .count = 6 };
    struct pell_gaussians g;

    (void) state;
    for (int c = 0; c < 3; c++)
        OK(pell_profile_make(PELL_PROFILE_DIPOLE, &marble->medium, c, NULL, &profiles[c]));
    OK(pell_fit_profiles(profiles, &fit, &g, NULL));
    for (size_t k = 0; k < PELL_COUNT(thick); k++) {
        struct pell_slab slab;
        double exact, sum = 0.0, by_ray, by_map, by_sum;
        REQUIRE(pell_slab_make(&marble->medium, 1, &slab));
        exact = pell_slab_at(&slab, thick[k]).transmitted;
        for (int i = 0; i < g.count; i++)
            sum += g.weight[i][1] * exp(-thick[k] * thick[k] / (2.0 * g.variance[i]));
        by_ray = transmission_of_slab("marble", thick[k], rays, 1);
        by_map = transmission_of_slab("marble", thick[k], map, 1);
        by_sum = transmission_of_slab("marble", thick[k], gaussian, 1);
        print_message(
            "# %g mm of marble, green: the slab lets through %.4f, here %.4f (ray), %.4f (map); the Gaussians' sum %.4f, here %.4f\n",
            thick[k], exact, by_ray, by_map, sum, by_sum);
        REQUIRE_REL(by_ray, exact, 0.03);
        REQUIRE_REL(by_map, exact, 0.03);
        REQUIRE_REL(by_sum, sum, 0.03);
    }
    free(profiles);
}

static void lights_add_up_with_transmission(void **state)
{
    static const char *const own[] = { "size=128", NULL }, *const sum[] = { "size=128", "lights=sum", NULL };
    double worst[2];

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct shot shots[3];
        for (int i = 0; i < 3; i++) {
            struct stage s;
            size_t m;
            stage_start(&s, 32, 32);
            stage_gaussians(&s, 0.5, &m);
            stage_box(&s, m, 0, vec3(-10, -10, -3), vec3(10, 10, 0));
            if (i != 1)
                stage_light(&s, PELL_LIGHT_POINT, vec3(5, 3, -40), vec3(0, 0, 0), 3e-3f);
            if (i != 0)
                stage_light(&s, PELL_LIGHT_POINT, vec3(-20, 10, 30), vec3(0, 0, 0), 2e-3f);
            stage_environment(&s, i == 0 ? 0.1f : i == 1 ? 0.2f : 0.3f);
            stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 22.0f);
            shots[i] = stage_shot_of(&s, "texture-space", k ? sum : own);
            stage_finish(&s);
        }
        worst[k] = 0.0;
        for (int y = 0; y < 32; y++)
            for (int x = 0; x < 32; x++)
                for (size_t c = 0; c < 3; c++)
                    worst[k] =
                        fmax(worst[k], fabs(shot_at(&shots[0], c, x, y) + shot_at(&shots[1], c, x, y) - shot_at(&shots[2], c, x, y)));
        for (int i = 0; i < 3; i++)
            shot_free(&shots[i]);
    }
    print_message("# A + B differs from A and B by %.2g; by the paper's sum %.2g\n", worst[0], worst[1]);
    REQUIRE(worst[0] < 2e-5);
    REQUIRE(worst[1] > 1e-3);
}

struct likeness {
    double light, rms; /* ratio of means; difference relative to the other's mean */
};

/* Red channel of fully covered pixels. */
static struct likeness likeness_of(const struct shot *a, const struct shot *b)
{
    double sum[2] = { 0 }, square = 0.0;
    int n = 0;

    for (int y = 0; y < b->height; y++)
        for (int x = 0; x < b->width; x++)
            if (shot_at(b, SHOT_A, x, y) >= 1.0) {
                sum[0] += shot_at(a, 0, x, y);
                sum[1] += shot_at(b, 0, x, y);
                square += pow(shot_at(a, 0, x, y) - shot_at(b, 0, x, y), 2.0);
                n++;
            }
    return (struct likeness) { sum[0] / sum[1], sqrt(square / n) / (sum[1] / n) };
}

/* A backlit ball not much larger than the diffuse mean free path. Light that diffuses around it is half as much as that straight through
 * it, and both are the same light: a method that adds them counts it twice. */
static void what_comes_round_and_through_a_ball_counts_once(void **state)
{
    static const char *const sets[3][5] = { { "size=160", NULL },
                                            { "size=160", "tsm=map", "tsm-size=256", NULL },
                                            { "size=160", "fade=linear", "soften=off", NULL } };
    static const char *const whole[] = { "density=4", NULL };
    struct stage s;
    struct shot shots[3], sum;
    struct likeness like[3], same;
    size_t m;

    (void) state;
    stage_start(&s, 48, 48);
    stage_gaussians(&s, 0.5, &m);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 3.0f, 48);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -100), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 6.5f);
    sum = stage_shot_of(&s, "hierarchical", whole);
    for (int k = 0; k < 3; k++) {
        shots[k] = stage_shot_of(&s, "texture-space", sets[k]);
        like[k] = likeness_of(&shots[k], &sum);
    }
    same = likeness_of(&shots[1], &shots[0]);
    print_message(
        "# of the sum's light: by ray %.3f, by map %.3f, faded as in the paper %.3f; rms %.3f, %.3f, %.3f; ray and map differ by %.3f\n",
        like[0].light, like[1].light, like[2].light, like[0].rms, like[1].rms, like[2].rms, same.rms);
    REQUIRE(same.rms < 0.09);
    REQUIRE(like[0].light < 1.4 && like[1].light < 1.5 && like[2].light > like[1].light);
    REQUIRE(like[0].rms < like[1].rms && like[0].rms < 0.85 * like[2].rms);
    for (int k = 0; k < 3; k++)
        shot_free(&shots[k]);
    shot_free(&sum);
    stage_finish(&s);
}

/* A cap of a shell about the z axis, shaped like an ear: an outer face, an inner face and the rim between them. */
static void shell(struct stage *s, size_t material, double outer, double inner)
{
    const int rings = 24, sectors = 48;
    const uint32_t side = (uint32_t) ((rings + 1) * sectors);
    struct pell_mesh *m = shapes_mesh(s->scene, material, 2 * side, (uint32_t) (4 * rings * sectors + 2 * sectors));
    uint32_t *out = m->index;

    for (uint32_t k = 0; k < 2 * side; k++) {
        const double theta = PELL_PI / 3.0 * (double) (k % side / (uint32_t) sectors) / rings;
        const double phi = 2.0 * PELL_PI * (double) (k % (uint32_t) sectors) / sectors, radius = k < side ? outer : inner;
        const struct pell_vec3 n = vec3((float) (sin(theta) * cos(phi)), (float) (sin(theta) * sin(phi)), (float) cos(theta));
        vec3_store(vec3_mul(n, (float) radius), m->position + 3 * k);
        vec3_store(vec3_mul(n, k < side ? 1.0f : -1.0f), m->normal + 3 * k);
    }
    for (int face = 0; face < 3; face++)
        for (int j = face == 2 ? rings : 0; j < rings + (face == 2); j++)
            for (int i = 0; i < sectors; i++) {
                const uint32_t base = face == 1 ? side : 0, next = (uint32_t) ((i + 1) % sectors);
                const uint32_t a = base + (uint32_t) (j * sectors + i), b = base + (uint32_t) (j * sectors) + next;
                const uint32_t c = face == 2 ? a + side : a + (uint32_t) sectors, d = face == 2 ? b + side : b + (uint32_t) sectors;
                const uint32_t quad[2][6] = { { a, c, d, a, d, b }, { a, d, c, a, b, d } };
                memcpy(out, quad[face == 1], sizeof(quad[0]));
                out += 6;
            }
    shapes_bound(s->scene, m);
}

static void transmission_of_a_shell_is_nearly_that_of_a_slab(void **state)
{
    static const char *const by[][4] = { { "size=128", NULL }, { "size=128", "tsm=map", "tsm-size=256", NULL } };
    struct pell_slab slab;
    double exact, seen[2];

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct stage s;
        struct shot shot;
        size_t m;
        stage_start(&s, 8, 8);
        stage_medium(&s, "marble", &m)->color_from = PELL_COLOR_FROM_PROFILE;
        shell(&s, m, 30.0, 28.0);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -100), vec3(0, 0, 0), 1.0f);
        stage_camera(&s, vec3(0, 0, 80), vec3(0, 0, 0), 0.0f, 4.0f);
        shot = stage_shot_of(&s, "texture-space", by[k]);
        seen[k] = shot_at(&shot, 1, 4, 4) * PELL_PI;
        REQUIRE(pell_slab_make(&s.scene->materials[m].medium, 1, &slab));
        shot_free(&shot);
        stage_finish(&s);
    }
    exact = pell_slab_at(&slab, 2.0).transmitted;
    print_message("# 2 mm of a shell of 30 mm: %.4f by ray, %.4f by map; a slab %.4f\n", seen[0], seen[1], exact);
    REQUIRE_REL(seen[0], exact, 0.08);
    REQUIRE_REL(seen[1], seen[0], 0.02);
}

/* A shell like an ear's, lit from behind and the side: much of its inside faces the light, is in the shadow of its far rim, and glows. */
static void a_shell_glows_where_it_faces_the_light_in_its_own_shadow(void **state)
{
    enum { SETS = 5 };
    static const char *const sets[SETS][5] = { { "size=192", "through=gaussian", NULL },
                                               { "size=192", "through=gaussian", "tsm=map", NULL },
                                               { "size=192", "tsm=off", NULL },
                                               { "size=192", "through=gaussian", "tsm=map", "lights=sum", NULL },
                                               { "size=192", "through=gaussian", "lights=sum", "thickness=printed", NULL } };
    static const char *const whole[] = { "density=4", NULL };
    struct stage s;
    struct shot shots[SETS], sum;
    struct likeness like[SETS];
    double step[2] = { 0.0, 0.0 };
    size_t m;

    (void) state;
    stage_start(&s, 48, 48);
    stage_gaussians(&s, 0.25, &m);
    shell(&s, m, 12.0, 10.5);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(90, 0, 50), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, -80), vec3(0, 0, 8), 0.0f, 22.0f);
    sum = stage_shot_of(&s, "hierarchical", whole);
    for (int k = 0; k < SETS; k++) {
        shots[k] = stage_shot_of(&s, "texture-space", sets[k]);
        like[k] = likeness_of(&shots[k], &sum);
    }
    /* Differences from pixel to pixel along the shell's middle. */
    for (int x = 5; x < 42; x++)
        for (int k = 0; k < 2; k++)
            step[k] = fmax(step[k], fabs(shot_at(k ? &sum : &shots[0], 0, x + 1, 24) - shot_at(k ? &sum : &shots[0], 0, x, 24)));
    print_message("# of the sum's light: by ray %.3f, by map %.3f, without transmission %.3f; rms %.3f, %.3f, %.3f; steps %.4f, %.4f\n",
                  like[0].light, like[1].light, like[2].light, like[0].rms, like[1].rms, like[2].rms, step[0], step[1]);
    print_message("# where light is read from the sum of all lights %.3f by map, %.3f by rays and the printed thickness; rms %.3f, %.3f\n",
                  like[3].light, like[4].light, like[3].rms, like[4].rms);
    REQUIRE_REL(like[3].light, like[1].light, 0.05);
    REQUIRE(like[3].rms < 0.25);
    for (int k = 0; k < 2; k++) {
        REQUIRE_NEAR(like[k].light, 1.0, 0.1);
        REQUIRE(like[k].rms < 0.18);
    }
    REQUIRE(like[2].light < 0.3);
    REQUIRE(step[0] < 1.2 * step[1]);
    for (int k = 0; k < SETS; k++)
        shot_free(&shots[k]);
    shot_free(&sum);
    stage_finish(&s);
}

/* A ball lit from the side: exiting light by this method and by the integral over the whole surface. */
static void a_ball_is_like_the_sum_over_its_surface(void **state)
{
    static const char *const fine[] = { "size=256", NULL }, *const whole[] = { "density=16", NULL };
    struct stage s;
    struct shot a, b;
    double sum[2] = { 0 }, square = 0.0;
    int n = 0;
    size_t m;

    (void) state;
    stage_start(&s, 40, 40);
    stage_gaussians(&s, 0.25, &m);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 10.0f, 48);
    stage_light(&s, PELL_LIGHT_POINT, vec3(60, 40, 20), vec3(0, 0, 0), 5e-3f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 21.0f);
    a = stage_shot_of(&s, "texture-space", fine);
    b = stage_shot_of(&s, "hierarchical", whole);
    for (int y = 0; y < 40; y++)
        for (int x = 0; x < 40; x++)
            for (size_t c = 0; c < 3 && shot_at(&b, SHOT_A, x, y) >= 1.0; c++) {
                sum[0] += shot_at(&a, c, x, y);
                sum[1] += shot_at(&b, c, x, y);
                square += pow(shot_at(&a, c, x, y) - shot_at(&b, c, x, y), 2.0);
                n++;
            }
    print_message("# %.4f of hierarchical's light, rms difference %.4f of its mean\n", sum[0] / sum[1], sqrt(square / n) / (sum[1] / n));
    REQUIRE_NEAR(sum[0] / sum[1], 1.0, 0.02);
    REQUIRE(sqrt(square / n) < 0.03 * sum[1] / n);
    shot_free(&a);
    shot_free(&b);
    stage_finish(&s);
}

/* --- Useless and hostile layouts ------------------------------------------------------------------------------------------------------ */

enum wrong { MISSING, OVERLAPPING, SECOND_SET, RANDOM, NOT_NUMBERS, HUGE, ALL_ONE, LINE, WRONGS };

static void spoil(struct pell_mesh *m, enum wrong wrong)
{
    uint32_t seed = 1;

    for (uint32_t i = 0; m->uv[0] && i < m->num_vertices; i++) {
        float *uv = m->uv[0] + 2 * i;
        if (wrong == RANDOM)
            uv[i % 2] = shapes_random(&seed);
        else if (wrong == OVERLAPPING)
            uv[0] = fabsf(uv[0] - 0.5f);
        else if (wrong == NOT_NUMBERS && i % 7 == 0)
            uv[0] = NAN;
        else if (wrong == HUGE)
            uv[i % 2] = i % 3 ? 3e38f : -3e38f;
        else if (wrong == ALL_ONE)
            uv[0] = uv[1] = 0.5f;
        else if (wrong == LINE)
            uv[1] = 0.25f;
    }
}

static void other_layouts_are_made_of_those_of_no_use(void **state)
{
    (void) state;
    for (int k = 0; k < WRONGS; k++) {
        struct stage s;
        struct shot shot;
        struct pell_mesh *m;
        double largest[2], rms[2];
        quadrant(&s, GOOD, 48, 0.0f);
        stage_complete(&s); /* refuses NaN; a host may change it later */
        m = &s.scene->meshes[0];
        if (k == MISSING) {
            pell_free(s.ctx, m->uv[0]);
            m->uv[0] = NULL;
        }
        if (k == SECOND_SET) { /* is the valid one */
            m->uv[1] = m->uv[0];
            m->uv[0] = pell_calloc(s.ctx, m->num_vertices, 2 * sizeof(float));
        }
        spoil(m, (enum wrong) k);
        OK(pell_renderer_set_scene(s.r, s.scene));
        s.set = true;
        shot = stage_shot_of(&s, "texture-space", plain);
        quadrant_error(&shot, 0.0, 1e9, largest, rms);
        print_message("# %d: %s; %.4f at most\n", k, s.kept.last_warning, largest[0]);
        REQUIRE(largest[0] < 0.01);
        assert_true((k <= SECOND_SET) == !strstr(s.kept.last_warning, "planar charts"));
        shot_free(&shot);
        stage_finish(&s);
    }
}

/* A post inside a slab: the part of the slab under the post receives no light, and takes none from its surroundings. */
static void parts_in_each_other_have_no_dark_seam(void **state)
{
    static const char *const fine[] = { "size=256", "tsm=off", NULL };
    struct stage s;
    struct shot a, b;
    double ratio[2];
    size_t m;

    (void) state;
    stage_start(&s, 64, 24);
    stage_gaussians(&s, 1.0, &m);
    stage_box(&s, m, 0, vec3(-20, -20, -10), vec3(20, 20, 0));
    stage_box(&s, m, 0, vec3(-5, -5, -6), vec3(5, 5, 8));
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 12.0f);
    a = stage_shot_of(&s, "texture-space", fine);
    b = stage_shot_of(&s, "hierarchical", NULL);
    for (int k = 0; k < 2; k++)
        ratio[k] = shot_at(k ? &b : &a, 0, 32 + 11, 12) / shot_at(k ? &b : &a, 0, 32 + 24, 12);
    print_message("# next to the post %.3f of the light far from it, by the sum over the surface %.3f\n", ratio[0], ratio[1]);
    REQUIRE_NEAR(ratio[0], ratio[1], 0.15); /* 0.69 with the dark texels of the buried part */
    shot_free(&a);
    shot_free(&b);
    stage_finish(&s);
}

static void any_size_and_any_knob_is_finite(void **state)
{
    static const char *const sets[][6] = {
        { "size=16", "tsm=map", "tsm-size=16", NULL },
        { "size=16", "border=512", "gaussians=1", NULL },
        { "size=97", "as=paper", "border=3", NULL },
        { "size=64", "charts=planar", "kernel=seven", "stretch=off", NULL },
        { "size=64", "first=unblurred", "gaussians=10", "mix=1", NULL },
    };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(sets); k++) {
        const int size = k % 2 ? 1 : 17;
        struct stage s;
        struct shot shot;
        size_t a, b, c;
        stage_start(&s, size, size);
        s.settings.msaa = size > 1 ? 4 : 1;
        stage_gaussians(&s, 2.0, &a);
        stage_medium(&s, "wholemilk", &b);
        stage_medium(&s, "skin1", &c);
        s.scene->materials[c].strength = 0.0f;
        stage_box(&s, a, 0, vec3(-10, -10, -4), vec3(0, 10, 0));
        stage_box(&s, b, 0, vec3(0, -10, -4), vec3(10, 10, 0)); /* two materials of one object */
        stage_ball(&s, c, 1, vec3(0, 0, 4), 2.0f, 6);
        stage_ball(&s, c, 2, vec3(5, 5, 3), 0.01f, 4);
        stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, -20), vec3(0, 0, 0), 1e-3f);
        stage_light(&s, PELL_LIGHT_RECT, vec3(20, 20, 40), vec3(0, 0, 0), 10.0f);
        stage_light(&s, PELL_LIGHT_POINT, vec3(-5, 0, -2), vec3(0, 0, 0), 1e-4f); /* inside */
        stage_camera(&s, vec3(0, 0, 50), vec3(0, 0, 0), 0.5f, 0.0f);
        shot = stage_shot_of(&s, "texture-space", sets[k]);
        shot_check(&shot);
        REQUIRE(shot_at(&shot, 1, size / 2, size / 2) > 0.0);
        shot_free(&shot);
        stage_finish(&s);
    }
}

static void a_medium_that_scatters_nothing_is_black(void **state)
{
    static const char *const knobs[] = { "size=64", NULL };
    struct stage s;
    struct shot shot;
    size_t m;

    (void) state;
    stage_start(&s, 8, 8);
    stage_medium(&s, "marble", &m)->medium.sigma_s_reduced[0] = 0.0;
    s.scene->materials[m].color_from = PELL_COLOR_FROM_PROFILE;
    stage_box(&s, m, 0, vec3(-10, -10, -4), vec3(10, 10, 0));
    stage_light(&s, PELL_LIGHT_POINT, vec3(5, 5, 40), vec3(0, 0, 0), 1e-2f);
    stage_light(&s, PELL_LIGHT_POINT, vec3(5, 5, -40), vec3(0, 0, 0), 1e-2f);
    stage_camera(&s, vec3(0, 0, 50), vec3(0, 0, 0), 0.0f, 8.0f);
    shot = stage_shot_of(&s, "texture-space", knobs);
    shot_check(&shot);
    assert_true(shot_at(&shot, 0, 4, 4) == 0.0);
    REQUIRE(shot_at(&shot, 1, 4, 4) > 0.0);
    shot_free(&shot);
    stage_finish(&s);
}

static void two_objects_that_touch_do_not_bleed(void **state)
{
    (void) state;
    require_light_stays_in_its_object("texture-space", plain, true, 0.0f, 16.0f, 16, 6, 8);
}

/* A radius of zero is Lambertian, and half the radius on a sheet equals the sheet with half the widths. */
static void strength_scales_the_radius(void **state)
{
    struct shot shots[2];

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct stage s;
        quadrant(&s, GOOD, 32, 0.0f);
        if (k == 0)
            s.scene->materials[0].strength = 0.5f;
        else
            for (int i = 0; i < 3; i++)
                s.scene->materials[0].gaussians.variance[i] *= 0.25;
        shots[k] = stage_shot_of(&s, "texture-space", plain);
        stage_finish(&s);
    }
    for (int y = 0; y < 32; y++)
        for (int x = 0; x < 32; x++)
            for (size_t c = 0; c < 3; c++)
                REQUIRE_NEAR(shot_at(&shots[0], c, x, y), shot_at(&shots[1], c, x, y), 1e-3);
    shot_free(&shots[0]);
    shot_free(&shots[1]);
}

/* A map is kept when the light on it is gone. */
static void other_samples_of_the_lights_light_it_anew(void **state)
{
    static const char *const knobs[] = { "size=96", NULL };
    struct shot shots[3];

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct stage s;
        size_t m;
        stage_start(&s, 24, 24);
        stage_gaussians(&s, 0.5, &m);
        stage_ball(&s, m, 0, vec3(0, 0, 0), 6.0f, 24);
        stage_ball(&s, m, 1, vec3(0, 9, 0), 2.0f, 12);
        stage_light(&s, PELL_LIGHT_DISC, vec3(40, 10, -30), vec3(0, 0, 0), 30.0f);
        stage_light(&s, PELL_LIGHT_POINT, vec3(-40, 10, 30), vec3(0, 0, 0), 3e-3f);
        stage_environment(&s, 0.2f);
        stage_camera(&s, vec3(0, 0, 60), vec3(0, 0, 0), 0.3f, 0.0f);
        s.settings.seed = k;
        shots[k] = stage_shot_of(&s, "texture-space", knobs);
        if (k == 0) {
            s.settings.seed = 1;
            s.settings.light_samples = 4;
            shots[2] = stage_shot(&s);
            shot_free(&shots[2]);
            s.settings.light_samples = 16;
            shots[2] = stage_shot(&s);
        }
        stage_finish(&s);
    }
    assert_true(shot_equal(&shots[2], &shots[1]) && !shot_equal(&shots[0], &shots[1]));
    for (int k = 0; k < 3; k++)
        shot_free(&shots[k]);
}

/* The map is kept when lights are added and removed. */
static void more_transmitted_lights_than_fit_are_reported(void **state)
{
    static const char *const knobs[] = { "size=64", NULL };
    struct stage s;
    struct shot shot;
    size_t m;

    (void) state;
    stage_start(&s, 8, 8);
    stage_gaussians(&s, 0.5, &m);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 6.0f, 12);
    stage_light(&s, PELL_LIGHT_POINT, vec3(-40, 10, 30), vec3(0, 0, 0), 3e-3f);
    stage_camera(&s, vec3(0, 0, 60), vec3(0, 0, 0), 0.3f, 0.0f);
    shot = stage_shot_of(&s, "texture-space", knobs);
    shot_free(&shot);
    assert_null(strstr(s.kept.last_warning, "only the first"));
    for (int i = 0; i < 16; i++)
        stage_light(&s, PELL_LIGHT_POINT, vec3(-40, (float) i, 30), vec3(0, 0, 0), 3e-4f);
    OK(pell_renderer_set_scene(s.r, s.scene));
    for (int k = 0, count = 0; k < 2; k++) {
        s.settings.seed = k;
        shot = stage_shot(&s);
        shot_free(&shot);
        assert_non_null(strstr(s.kept.last_warning, "17 lights; only the first 16"));
        assert_true(k == 0 || s.kept.warnings == count);
        count = s.kept.warnings;
    }
    stage_finish(&s);
}

/* The first frame makes the map with everything that was allocated when the pass was created; later frames only read it. */
static void frames_allocate_nothing_and_survive_no_memory(void **state)
{
    static const char *const knobs[] = { "size=64", "tsm=map", "tsm-size=32", NULL };
    enum pell_result res = PELL_ERR_NOMEM;

    (void) state;
    for (uint64_t n = 1; res != PELL_OK; n += SLOW ? 7 : 3) {
        struct pell_alloc_fault fault = { 0 };
        struct stage s = { 0 };
        const struct pell_device_params params = { .threads = 1, .engine = PELL_ENGINE_CPU };
        size_t m;
        s.ctx = test_context(&fault, NULL);
        OK(pell_scene_create(s.ctx, &s.scene));
        OK(pell_device_create(s.ctx, &params, &s.device));
        OK(pell_renderer_create(s.device, &s.r));
        pell_knobs_default(pell_settings_knobs(), &s.settings);
        s.settings.width = s.settings.height = 8;
        s.settings.msaa = 1;
        s.settings.indirect_samples = 1024;
        stage_medium(&s, "skin1", &m);
        stage_box(&s, m, 0, vec3(-10, -10, -3), vec3(10, 10, 0));
        stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, -40), vec3(0, 0, 0), 3e-3f);
        stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 22.0f);
        stage_complete(&s);
        OK(pell_renderer_set_scene(s.r, s.scene));
        stage_method(&s, NULL, NULL);
        OK(pell_renderer_render(s.r, &s.settings, &s.image)); /* everything except the method is available */
        stage_method(&s, "texture-space", knobs);
        fault.fail_at = fault.calls + n;
        res = pell_renderer_render(s.r, &s.settings, &s.image);
        assert_true(res == PELL_OK || res == PELL_ERR_NOMEM);
        fault.fail_at = 0;
        if (res == PELL_OK) {
            const uint64_t calls = fault.calls;
            OK(pell_renderer_render(s.r, &s.settings, &s.image));
            assert_true(fault.calls == calls);
            print_message("# there are %d allocations at most\n", (int) n - 1);
        }
        stage_finish(&s);
        assert_int_equal(fault.live, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sheet_lit_in_part_is_the_convolution),
        cmocka_unit_test(fewer_taps_are_near_the_convolution),
        cmocka_unit_test(layouts_of_all_kinds_give_one_picture),
        cmocka_unit_test(no_seam_shows_on_a_sheet_that_is_cut),
        cmocka_unit_test(a_sheet_that_deforms_is_the_convolution),
        cmocka_unit_test(other_surfaces_are_laid_out_anew),
        cmocka_unit_test(a_surface_at_rest_keeps_its_picture),
        cmocka_unit_test(light_goes_round_the_edges_of_a_cube),
        cmocka_unit_test(no_seam_shows_on_a_solid_in_many_charts),
        cmocka_unit_test(uniform_light_gives_the_albedo),
        cmocka_unit_test(transmission_of_a_slab_is_the_slab_integral),
        cmocka_unit_test(lights_add_up_with_transmission),
        cmocka_unit_test(what_comes_round_and_through_a_ball_counts_once),
        cmocka_unit_test(transmission_of_a_shell_is_nearly_that_of_a_slab),
        cmocka_unit_test(a_shell_glows_where_it_faces_the_light_in_its_own_shadow),
        cmocka_unit_test(a_ball_is_like_the_sum_over_its_surface),
        cmocka_unit_test(other_layouts_are_made_of_those_of_no_use),
        cmocka_unit_test(parts_in_each_other_have_no_dark_seam),
        cmocka_unit_test(any_size_and_any_knob_is_finite),
        cmocka_unit_test(a_medium_that_scatters_nothing_is_black),
        cmocka_unit_test(two_objects_that_touch_do_not_bleed),
        cmocka_unit_test(strength_scales_the_radius),
        cmocka_unit_test(other_samples_of_the_lights_light_it_anew),
        cmocka_unit_test(more_transmitted_lights_than_fit_are_reported),
        cmocka_unit_test(frames_allocate_nothing_and_survive_no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
