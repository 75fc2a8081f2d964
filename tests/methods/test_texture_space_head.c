/* SPDX-License-Identifier: MIT
 * test_texture_space_head.c - seams of the texture-space method on a scanned head, with the layout of its file and with planar charts,
 * against hierarchical. Skipped where the scan is absent. */
#include "stage.h"

#include "render/renderer.h"

#include "methods/texture_space/texture_space.h"

enum { SIZE = 160, TEXELS = 768, VIEWS = 2 };
#define TALL 72.0f /* height of the image in mm; the head is 100 mm wide at its shoulders */
#define NEAR 3     /* px from a seam, and from silhouettes, where the methods differ */
#define HIDDEN 1.5 /* mm behind the visible surface */

static const struct pell_vec3 camera[VIEWS] = { { 20, 0, 200 }, { -190, 15, -70 } }, middle = { 0, 12, 0 };

static void head(struct stage *s)
{
    const struct pell_load_params params = { .size_mm = 100.0, .bare = true };
    const char *path = shared_file("assets/head_lps/LeePerrySmith.glb");
    size_t m;

    stage_start(s, SIZE, SIZE);
    pell_scene_destroy(&s->scene);
    OK(pell_scene_load(s->ctx, path, &params, &s->scene));
    assert_int_equal(s->scene->num_lights, 0);
    stage_gaussians(s, 0.12, &m);
    for (size_t i = 0; i < s->scene->num_meshes; i++)
        s->scene->meshes[i].material = m;
    stage_light(s, PELL_LIGHT_POINT, vec3(-120, 90, 120), vec3(0, 0, 0), 3e-2f);
    stage_camera(s, camera[0], middle, 0.0f, TALL);
    s->settings.layers = true;
    OK(pell_renderer_set_scene(s->r, s->scene));
    s->set = true;
}

/* Whether a chart ends at this half-edge: at another chart, at itself or at no neighbour. */
static bool is_seam(const struct ts_atlas *a, uint32_t half)
{
    const uint32_t twin = a->twin[half], t = half / 3, k = half % 3;

    if (twin == UINT32_MAX || a->chart[t] != a->chart[twin / 3])
        return true;
    for (uint32_t i = 0; i < 2; i++) {
        const float *here = a->corners[t] + 2 * ((k + i) % 3), *there = a->corners[twin / 3] + 2 * ((twin + 1 - i) % 3);
        if (fabsf(here[0] - there[0]) > 0.01f || fabsf(here[1] - there[1]) > 0.01f)
            return true;
    }
    return false;
}

static void mark(bool *near, int x, int y)
{
    for (int dy = -NEAR; dy <= NEAR; dy++)
        for (int dx = -NEAR; dx <= NEAR; dx++)
            if (x + dx >= 0 && x + dx < SIZE && y + dy >= 0 && y + dy < SIZE)
                near[(y + dy) * SIZE + x + dx] = true;
}

static void look(struct stage *s, int view)
{
    stage_camera(s, camera[view], middle, 0.0f, TALL);
}

/* Marks the pixels near a visible seam. */
static void mark_edge(const struct stage *s, const struct shot *shot, struct pell_vec3 p, struct pell_vec3 q, bool near[SIZE * SIZE])
{
    const struct pell_camera *c = &s->scene->cameras[0];
    const struct pell_vec3 from = vec3_load(c->position), forward = vec3_load(c->forward), up = vec3_load(c->up);
    const struct pell_vec3 right = vec3_cross(forward, up);

    for (int i = 0; i <= 16; i++) {
        const struct pell_vec3 at = vec3_sub(vec3_mad(p, (float) i / 16.0f, vec3_sub(q, p)), from);
        const float x = (0.5f + vec3_dot(at, right) / TALL) * SIZE, y = (0.5f - vec3_dot(at, up) / TALL) * SIZE;
        if (x >= 0.0f && y >= 0.0f && x < SIZE && y < SIZE &&
            fabs(shot_at(shot, SHOT_DEPTH, (int) x, (int) y) - (double) vec3_dot(at, forward)) < HIDDEN)
            mark(near, (int) x, (int) y);
    }
}

static void mark_seams(struct stage *s, const struct shot *shots, int charts, bool near[VIEWS][SIZE * SIZE])
{
    struct ts_atlas_params params = {
        .pool = pell_renderer_services(s->r)->pool, .scene = s->scene, .name = "head", .size = TEXELS, .border = 1
    };
    struct pell_solids *solids;
    struct ts_atlas *a;

    OK(pell_services_solids(pell_renderer_services(s->r), &solids));
    assert_int_equal(solids->count, 1);
    params.solids = solids;
    params.charts = charts;
    OK(ts_atlas_make(s->ctx, &params, &a));
    memset(near, 0, VIEWS * sizeof(*near));
    for (int view = 0; view < VIEWS; view++) {
        look(s, view);
        for (uint32_t half = 0; half < 3 * a->num_triangles; half++) {
            const struct ts_triangle *t = &a->triangles[half / 3];
            const struct pell_mesh *m = &a->scene->meshes[t->mesh];
            const uint32_t *index = m->index + 3 * (size_t) t->triangle;
            if (is_seam(a, half))
                mark_edge(s, &shots[view], vec3_load(m->position + 3 * index[half % 3]), vec3_load(m->position + 3 * index[(half + 1) % 3]),
                          near[view]);
        }
    }
    ts_atlas_destroy(&a);
    pell_solids_destroy(&solids);
}

static bool is_inside(const struct shot *shot, int x, int y)
{
    for (int k = 0; k < 4; k++) {
        const int px = x + (k % 2 ? NEAR : -NEAR), py = y + (k / 2 ? NEAR : -NEAR);
        if (px < 0 || py < 0 || px >= SIZE || py >= SIZE || shot_at(shot, SHOT_A, px, py) < 1.0)
            return false;
    }
    return true;
}

static int rising(const void *p, const void *q)
{
    const double a = *(const double *) p, b = *(const double *) q;

    return (a > b) - (a < b);
}

/* Of red, relative to the mean; one pixel in a hundred is worse than `high`. */
struct errors {
    double most, high, rms;
    int count;
};

static struct errors errors_of(const struct shot *shot, const struct shot *sum, const bool near[SIZE * SIZE], bool at_seams)
{
    static double list[SIZE * SIZE];
    struct errors e = { 0 };
    double mean = 0.0;
    int covered = 0;

    for (int y = 0; y < SIZE; y++)
        for (int x = 0; x < SIZE; x++) {
            const double off = fabs(shot_at(shot, 0, x, y) - shot_at(sum, 0, x, y));
            if (shot_at(sum, SHOT_A, x, y) < 1.0)
                continue;
            mean += shot_at(sum, 0, x, y);
            covered++;
            if (near[y * SIZE + x] != at_seams || !is_inside(sum, x, y))
                continue;
            list[e.count++] = off;
            e.rms += off * off;
        }
    assert_true(e.count > 300);
    mean /= covered;
    qsort(list, (size_t) e.count, sizeof(*list), rising);
    e.most = list[e.count - 1] / mean;
    e.high = list[e.count - 1 - e.count / 100] / mean;
    e.rms = sqrt(e.rms / e.count) / mean;
    return e;
}

static void shoot(struct stage *s, struct shot shots[VIEWS])
{
    for (int view = 0; view < VIEWS; view++) {
        look(s, view);
        shots[view] = stage_shot(s);
    }
}

static void print(const char *what, const struct errors *e)
{
    print_message("#   %s: %.3f at most, 99 of 100 under %.3f, %.4f rms, %d pixels\n", what, e->most, e->high, e->rms, e->count);
}

/* Planar charts end where a surface turns: around lids, lips and ears, where light along the surface and light across differ. So the
 * error at their seams is compared with that of the same pixels in the file's layout, which has its seams elsewhere; and the error at
 * the file's seams with the rest. */
static void no_seam_shows_on_a_head(void **state)
{
    static const char *const sets[2][2][5] = {
        { { "size=768", "tsm=off", "charts=planar", NULL }, { "size=768", "tsm=off", "charts=planar", "border=0", NULL } },
        { { "size=768", "tsm=off", "charts=uv", NULL }, { "size=768", "tsm=off", "charts=uv", "border=0", NULL } },
    };
    static const int charts[2] = { TS_CHARTS_PLANAR, TS_CHARTS_UV };
    static const char *const whole[] = { "points=400000", NULL };
    static bool near[2][VIEWS][SIZE * SIZE];
    struct shot sum[VIEWS], shots[2][2][VIEWS];
    struct stage s;

    (void) state;
    head(&s);
    stage_method(&s, "hierarchical", whole);
    shoot(&s, sum);
    for (int k = 0; k < 2; k++) {
        for (int bare = 0; bare < 2; bare++) {
            stage_method(&s, "texture-space", sets[k][bare]);
            shoot(&s, shots[k][bare]);
        }
        mark_seams(&s, sum, charts[k], near[k]);
    }
    for (int i = 0; i < 2 * VIEWS; i++) {
        const int view = i / 2, k = i % 2;
        const struct errors at = errors_of(&shots[k][0][view], &sum[view], near[k][view], true);
        const struct errors without = errors_of(&shots[k][1][view], &sum[view], near[k][view], true);
        const struct errors elsewhere = errors_of(&shots[k][0][view], &sum[view], near[k][view], false);
        const struct errors other = errors_of(&shots[1 - k][0][view], &sum[view], near[k][view], true);
        print_message("# view %d, %s\n", view, charts[k] == TS_CHARTS_PLANAR ? "planar charts" : "the file's layout");
        print("at seams", &at);
        print("the same without borders", &without);
        print("elsewhere", &elsewhere);
        print("the pixels of these seams in the other layout", &other);
        if (charts[k] == TS_CHARTS_PLANAR) {
            REQUIRE(at.most < 1.5 * other.most && at.high < 1.5 * other.high && at.rms < 1.5 * other.rms);
            REQUIRE(without.rms > 1.3 * at.rms);
        } else {
            /* The file's charts meet at grazing light, so borders contribute little there: the two differ by shadow samples. */
            REQUIRE(at.most <= elsewhere.most && at.rms <= 1.02 * without.rms);
        }
    }
    for (int view = 0; view < VIEWS; view++) {
        for (int k = 0; k < 4; k++)
            shot_free(&shots[k / 2][k % 2][view]);
        shot_free(&sum[view]);
    }
    stage_finish(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(no_seam_shows_on_a_head) };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
