/* SPDX-License-Identifier: MIT
 * test_light_grid.c - shadow and thickness queries of a light grid, against a test of every triangle, against rays, and where no grid
 * can be built. */
#include "shapes.h"

#include "visibility/light_grid.h"

static _Alignas(64) const int32_t all[16] = { -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1 };

struct points {
    _Alignas(64) float x[16], y[16], z[16];
};

static struct pell_light_grid *grid_of(const struct pell_scene *s, struct pell_vec3 apex)
{
    struct pell_light_grid *grid;

    assert_int_equal(pell_light_grid_create(s->ctx, s, apex, &grid), PELL_OK);
    return grid;
}

/* Neighbours within `size` mm of a point. */
static void spread(uint32_t *seed, struct pell_vec3 about, float size, struct points *p)
{
    for (int i = 0; i < 16; i++) {
        p->x[i] = about.x + size * (shapes_random(seed) - 0.5f);
        p->y[i] = about.y + size * (shapes_random(seed) - 0.5f);
        p->z[i] = about.z + size * (shapes_random(seed) - 0.5f);
    }
}

/* Moller and Trumbore 1997 in double precision, o + t d. `edge` is how far from the nearest edge, in barycentric units. */
static double intersect(const struct pell_mesh *m, uint32_t triangle, const double o[3], const double d[3], double *edge)
{
    double v[3][3], e1[3], e2[3], p[3], q[3], t[3], det = 0.0, a = 0.0, b = 0.0, along = 0.0;

    for (size_t k = 0; k < 9; k++)
        v[k / 3][k % 3] = (double) m->position[3 * (size_t) m->index[3 * (size_t) triangle + k / 3] + k % 3];
    for (int c = 0; c < 3; c++) {
        e1[c] = v[1][c] - v[0][c];
        e2[c] = v[2][c] - v[0][c];
        t[c] = o[c] - v[0][c];
    }
    for (int c = 0; c < 3; c++) {
        p[c] = d[(c + 1) % 3] * e2[(c + 2) % 3] - d[(c + 2) % 3] * e2[(c + 1) % 3];
        q[c] = t[(c + 1) % 3] * e1[(c + 2) % 3] - t[(c + 2) % 3] * e1[(c + 1) % 3];
    }
    for (int c = 0; c < 3; c++) {
        det += e1[c] * p[c];
        a += t[c] * p[c];
        b += d[c] * q[c];
        along += e2[c] * q[c];
    }
    *edge = fmin(fmin(a / det, b / det), 1.0 - a / det - b / det);
    return along / det;
}

static struct pell_mesh *soup(struct pell_scene *s, uint32_t triangles)
{
    struct pell_mesh *m = shapes_mesh(s, 0, 3 * triangles, triangles);
    uint32_t seed = 7;

    for (uint32_t i = 0; i < triangles; i++) {
        const float c[3] = { shapes_random(&seed), shapes_random(&seed), shapes_random(&seed) };
        for (uint32_t k = 0; k < 9; k++)
            m->position[9 * i + k] = 100.0f * (c[k % 3] + 0.15f * (shapes_random(&seed) - 0.5f));
        for (uint32_t k = 0; k < 3; k++)
            m->index[3 * i + k] = 3 * i + k;
    }
    shapes_bound(s, m);
    return m;
}

static void points_see_the_apex_where_no_triangle_of_all_is_between(void **state)
{
    enum { TRIANGLES = 500, PACKETS = 300 };
    const struct pell_vec3 apex = vec3(-60.0f, 30.0f, 320.0f);
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    const struct pell_mesh *m = soup(s, TRIANGLES);
    struct pell_light_grid *grid = grid_of(s, apex);
    uint32_t seed = 3;
    int compared = 0, hidden = 0, near_ones = 0;

    (void) state;
    assert_non_null(grid);
    for (int n = 0; n < PACKETS; n++) {
        const float ax = 100.0f * shapes_random(&seed), ay = 100.0f * shapes_random(&seed), az = 100.0f * shapes_random(&seed);
        const struct pell_vec3 about = vec3(ax, ay, az);
        _Alignas(64) int32_t visible[16];
        struct pell_ray_hit16 r;
        struct points p;

        spread(&seed, about, 4.0f, &p);
        memset(&r, 0, sizeof(r));
        for (int i = 0; i < 16; i++) {
            r.ray.ox[i] = p.x[i];
            r.ray.oy[i] = p.y[i];
            r.ray.oz[i] = p.z[i];
            r.ray.tfar[i] = i % 2 ? 1.0f : 0.1f;
        }
        assert_true(pell_light_grid_visible16(grid, all, p.x, p.y, p.z, visible));
        assert_true(pell_light_grid_closest16(grid, all, &r));
        for (int i = 0; i < 16; i++) {
            const double o[3] = { (double) p.x[i], (double) p.y[i], (double) p.z[i] };
            const double d[3] = { (double) apex.x - o[0], (double) apex.y - o[1], (double) apex.z - o[2] };
            double nearest = INFINITY, second = INFINITY;
            uint32_t which = 0;
            bool doubtful = false;

            for (uint32_t k = 0; k < TRIANGLES; k++) {
                double edge;
                const double t = intersect(m, k, o, d, &edge);
                doubtful |= fabs(edge) < 1e-3 || fabs(t) < 1e-5;
                if (edge >= 0.0 && t > 0.0 && t < 0.9999) {
                    second = t < nearest ? nearest : t < second ? t : second;
                    which = t < nearest ? k : which;
                    nearest = t < nearest ? t : nearest;
                }
            }
            if (doubtful || second - nearest < 1e-4 || fabs(nearest - 0.1) < 1e-4)
                continue;
            compared++;
            hidden += nearest < 1.0;
            assert_int_equal(visible[i], nearest < 1.0 ? 0 : -1);
            if (!(nearest < (i % 2 ? 1.0 : 0.1))) {
                assert_int_equal(r.hit.mesh[i], PELL_NO_HIT);
                assert_true(r.ray.tfar[i] == (i % 2 ? 1.0f : 0.1f));
                continue;
            }
            near_ones++;
            assert_int_equal(r.hit.mesh[i], 0);
            assert_int_equal(r.hit.triangle[i], which);
            REQUIRE_NEAR((double) r.ray.tfar[i], nearest, 1e-5);
            for (uint32_t c = 0; c < 3; c++) {
                const float *v0 = m->position + 9 * which + c, u = r.hit.u[i], v = r.hit.v[i];
                REQUIRE_NEAR((double) ((1.0f - u - v) * v0[0] + u * v0[3] + v * v0[6]), o[c] + nearest * d[c], 5e-3);
            }
        }
    }
    assert_true(compared > 3000);
    assert_true(hidden > 500 && compared - hidden > 500);
    assert_true(near_ones > 300);
    pell_light_grid_destroy(&grid);
    pell_light_grid_destroy(&grid);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

/* A ball with vertices at irregular positions; points of its far side are aimed exactly at vertices and edges of the near side. */
static void nothing_slips_through_between_triangles(void **state)
{
    const struct pell_vec3 apex = vec3(13.7f, -4.1f, 71.3f);
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    const struct pell_mesh *m = shapes_ball(s, 0, vec3(0.3f, -0.2f, 0.1f), 10.0f, 40);
    struct pell_light_grid *grid = grid_of(s, apex);
    int asked = 0;

    (void) state;
    assert_non_null(grid);
    for (size_t k = 0; k < 3 * (size_t) m->num_triangles; k++) {
        const size_t next = k % 3 == 2 ? k - 2 : k + 1;
        const struct pell_vec3 a = vec3_load(m->position + 3 * (size_t) m->index[k]);
        const struct pell_vec3 b = vec3_load(m->position + 3 * (size_t) m->index[next]);
        _Alignas(64) int32_t visible[16];
        struct points p;

        if (!(vec3_dot(vec3_sub(a, vec3(0.3f, -0.2f, 0.1f)), vec3_sub(apex, a)) > 100.0f)) /* faces the apex, and not from its border */
            continue;
        for (int i = 0; i < 16; i++) {
            const struct pell_vec3 q = vec3_mad(a, (float) i / 15.0f, vec3_sub(b, a));
            const struct pell_vec3 behind = vec3_mad(q, 0.05f, vec3_sub(q, apex));
            p.x[i] = behind.x;
            p.y[i] = behind.y;
            p.z[i] = behind.z;
        }
        assert_true(pell_light_grid_visible16(grid, all, p.x, p.y, p.z, visible));
        for (int i = 0; i < 16; i++, asked++)
            assert_int_equal(visible[i], 0);
    }
    assert_true(asked > 20000);
    pell_light_grid_destroy(&grid);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void lanes_that_are_off_stay_off_and_levels_agree(void **state)
{
    static const char *const levels[] = { "base", "v2", "v3", "v4" };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    int32_t first[100][16];
    struct pell_ray_hit16 hits[100];

    (void) state;
    soup(s, 500);
    memset(hits, 0, sizeof(hits));
    for (size_t k = 0; k < PELL_COUNT(levels); k++) {
        uint32_t seed = 5;
        struct pell_light_grid *grid;

        setenv("PELL_SIMD", levels[k], 1);
        grid = grid_of(s, vec3(50.0f, 60.0f, -300.0f));
        unsetenv("PELL_SIMD");
        assert_non_null(grid);
        for (int n = 0; n < 100; n++) {
            _Alignas(64) int32_t mask[16], visible[16];
            struct pell_ray_hit16 r;
            struct points p;

            spread(&seed, vec3(50.0f, 50.0f, 50.0f), 9.0f, &p);
            memset(&r, 0, sizeof(r));
            for (int i = 0; i < 16; i++) {
                mask[i] = (n + i) % 3 ? -1 : 0;
                if (!mask[i])
                    p.x[i] = p.y[i] = i % 2 ? NAN : 1e30f; /* is not tested */
                r.ray.ox[i] = p.x[i];
                r.ray.oy[i] = p.y[i];
                r.ray.oz[i] = p.z[i];
                r.ray.tfar[i] = 0.5f;
            }
            assert_true(pell_light_grid_visible16(grid, mask, p.x, p.y, p.z, visible));
            assert_true(pell_light_grid_closest16(grid, mask, &r));
            for (int i = 0; i < 16; i++)
                if (!mask[i]) {
                    assert_int_equal(visible[i], 0);
                    assert_int_equal(r.hit.mesh[i], PELL_NO_HIT);
                    r.ray.ox[i] = r.ray.oy[i] = 0.0f; /* NaN is not compared below */
                }
            if (k == 0) {
                memcpy(first[n], visible, sizeof(visible));
                hits[n] = r;
            }
            assert_memory_equal(first[n], visible, sizeof(visible));
            assert_memory_equal(&hits[n], &r, sizeof(r));
        }
        pell_light_grid_destroy(&grid);
    }
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void there_is_none_where_rays_do_better(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    struct pell_light_grid *grid;
    _Alignas(64) int32_t visible[16];
    struct points p;
    uint32_t seed = 1;

    (void) state;
    assert_null(grid_of(s, vec3(0, 0, 10))); /* nothing there */
    shapes_ball(s, 0, vec3(0, 0, 0), 1.0f, 12);
    assert_null(grid_of(s, vec3(0, 0, 0)));
    assert_null(grid_of(s, vec3(0.5f, 0.2f, 0.5f))); /* inside it */
    assert_null(grid_of(s, vec3(0, 0, NAN)));
    assert_null(grid_of(s, vec3(INFINITY, 0, 0)));
    grid = grid_of(s, vec3(0, 0, 10));
    assert_non_null(grid);
    spread(&seed, vec3(0, 0, 0), 2.0f, &p); /* no neighbours */
    assert_false(pell_light_grid_visible16(grid, all, p.x, p.y, p.z, visible));
    spread(&seed, vec3(0, 0, 12.0f), 0.1f, &p); /* behind the light */
    assert_false(pell_light_grid_visible16(grid, all, p.x, p.y, p.z, visible));
    spread(&seed, vec3(40.0f, 0, 1.0f), 0.01f, &p); /* outside the image */
    assert_true(pell_light_grid_visible16(grid, all, p.x, p.y, p.z, visible));
    for (int i = 0; i < 16; i++)
        assert_int_equal(visible[i], -1);
    pell_light_grid_destroy(&grid);

    shapes_ball(s, 0, vec3(30000.0f, 0, 0), 0.5f, 60); /* most triangles lie in one cell */
    assert_null(grid_of(s, vec3(15000.0f, 0, 30000.0f)));
    pell_scene_destroy(&s);

    s = shapes_scene(ctx);
    shapes_quad(s, 0, vec3(0, 0, 0), vec3(1, 0, 0), vec3(0, 1, 0));
    grid = grid_of(s, vec3(0, 0, 10));
    assert_non_null(grid);
    pell_light_grid_destroy(&grid);
    s->materials[0].alpha_mask = true;
    s->materials[0].alpha_cutoff = 0.5f;
    s->materials[0].base_color[3] = 0.25f; /* all of it is cut out */
    assert_null(grid_of(s, vec3(0, 0, 10)));
    s->materials[0].base_color[3] = 1.0f;
    s->meshes[0].color = pell_calloc(ctx, 4, 4 * sizeof(float)); /* some of it may be */
    assert_null(grid_of(s, vec3(0, 0, 10)));
    s->materials[0].alpha_mask = false;
    s->meshes[0].position[2] = NAN;
    assert_null(grid_of(s, vec3(0, 0, 10)));
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

/* Points offset above their triangles as the lighting does it for a camera at 10 mm; the light is at 3 m. */
static void a_far_apex_leaves_the_surface_its_light(void **state)
{
    const struct pell_vec3 to_light = vec3_normalize(vec3(0.6f, 0.3f, 0.74f));
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    const struct pell_mesh *m = shapes_ball(s, 0, vec3(0.3f, -0.2f, 0.1f), 50.0f, 40);
    const struct pell_vec3 apex = vec3_mul(to_light, 3200.0f);
    struct pell_light_grid *grid;
    uint32_t seed = 1;
    int asked = 0;

    (void) state;
    assert_null(grid_of(s, apex)); /* more than 8 sizes away */
    shapes_quad(s, 0, vec3_mul(to_light, -330.0f), vec3(10.0f, 0, 0), vec3(0, 10.0f, 0));
    m = &s->meshes[0];
    grid = grid_of(s, apex);
    assert_non_null(grid);
    for (size_t t = 0; t < m->num_triangles; t++) {
        const uint32_t *index = m->index + 3 * t;
        const struct pell_vec3 a = vec3_load(m->position + 3 * (size_t) index[0]);
        const struct pell_vec3 e1 = vec3_sub(vec3_load(m->position + 3 * (size_t) index[1]), a);
        const struct pell_vec3 e2 = vec3_sub(vec3_load(m->position + 3 * (size_t) index[2]), a);
        const struct pell_vec3 n = vec3_normalize(vec3_cross(e1, e2));
        _Alignas(64) int32_t visible[16];
        struct points p;

        if (!(vec3_dot(n, to_light) > 0.3f))
            continue;
        for (int i = 0; i < 16; i++) {
            const float u = shapes_random(&seed), v = (1.0f - u) * shapes_random(&seed);
            const struct pell_vec3 at = vec3_mad(vec3_mad(vec3_mad(a, u, e1), v, e2), 3.6e-4f, n);
            p.x[i] = at.x;
            p.y[i] = at.y;
            p.z[i] = at.z;
        }
        assert_true(pell_light_grid_visible16(grid, all, p.x, p.y, p.z, visible));
        for (int i = 0; i < 16; i++, asked++)
            assert_int_equal(visible[i], -1);
    }
    assert_true(asked > 30000);
    pell_light_grid_destroy(&grid);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

/* Translucent, opaque, rotated and degenerate meshes, one that alpha hides and one without triangles. */
static void several_meshes_answer_as_rays_do(void **state)
{
    const struct pell_vec3 apex = vec3(30.0f, 20.0f, 90.0f);
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    const size_t opaque = shapes_material(s, true), hidden = shapes_material(s, true);
    struct pell_pool *pool;
    struct pell_rays *rays;
    struct pell_light_grid *grid;
    uint32_t seed = 11;
    int hits_of_mesh[6] = { 0 }, open = 0, differ = 0, compared = 0;

    (void) state;
    shapes_ball(s, 0, vec3(0, 0, 0), 10.0f, 20);
    shapes_quad(s, opaque, vec3(0, 0, -15.0f), vec3(20.0f, 0, 0), vec3(0, 20.0f, 0));
    shapes_quad(s, opaque, vec3(9.0f, 6.0f, 25.0f), vec3(0, 3.0f, 0), vec3(3.0f, 0, 0)); /* its back is lit */
    shapes_quad(s, hidden, vec3(10.0f, 7.0f, 40.0f), vec3(9.0f, 0, 0), vec3(0, 9.0f, 0));
    shapes_quad(s, 0, vec3(5.0f, 5.0f, 30.0f), vec3(1.0f, 1.0f, 0), vec3(0, 0, 0));
    s->materials[hidden].alpha_mask = true;
    s->materials[hidden].alpha_cutoff = 0.5f;
    s->materials[hidden].base_color[3] = 0.25f;
    shapes_mesh(s, 0, 3, 0);
    assert_int_equal(pell_pool_create(ctx, 1, &pool), PELL_OK);
    assert_int_equal(pell_rays_create(ctx, s, pool, &rays), PELL_OK);
    grid = grid_of(s, apex);
    assert_non_null(grid);
    for (int n = 0; n < 2000; n++) {
        const float x = 36.0f * shapes_random(&seed) - 18.0f, y = 36.0f * shapes_random(&seed) - 18.0f;
        _Alignas(64) int32_t visible[16];
        struct pell_ray_hit16 r, mine;
        struct points p;

        spread(&seed, vec3(x, y, 30.0f * shapes_random(&seed) - 14.0f), 0.6f, &p);
        memset(&r, 0, sizeof(r));
        for (int i = 0; i < 16; i++) {
            r.ray.ox[i] = p.x[i];
            r.ray.oy[i] = p.y[i];
            r.ray.oz[i] = p.z[i];
            r.ray.dx[i] = apex.x - p.x[i];
            r.ray.dy[i] = apex.y - p.y[i];
            r.ray.dz[i] = apex.z - p.z[i];
            r.ray.tfar[i] = 0.9999f;
            r.ray.mask[i] = PELL_RAY_ALL;
        }
        mine = r;
        pell_rays_closest16(rays, all, true, &r);
        assert_true(pell_light_grid_visible16(grid, all, p.x, p.y, p.z, visible));
        assert_true(pell_light_grid_closest16(grid, all, &mine));
        for (int i = 0; i < 16; i++) {
            const bool hit = r.hit.mesh[i] != PELL_NO_HIT;
            compared++;
            if (mine.hit.mesh[i] != r.hit.mesh[i] || (hit && mine.hit.triangle[i] != r.hit.triangle[i]) || (visible[i] == 0) != hit) {
                differ++; /* at edges */
                continue;
            }
            open += !hit;
            if (!hit)
                continue;
            hits_of_mesh[r.hit.mesh[i]]++;
            REQUIRE_NEAR((double) mine.ray.tfar[i], (double) r.ray.tfar[i], 1e-5);
            REQUIRE_NEAR((double) mine.hit.u[i], (double) r.hit.u[i], 1e-3);
            REQUIRE_NEAR((double) mine.hit.v[i], (double) r.hit.v[i], 1e-3);
            assert_true(mine.hit.ngx[i] * r.hit.ngx[i] + mine.hit.ngy[i] * r.hit.ngy[i] + mine.hit.ngz[i] * r.hit.ngz[i] > 0.0f);
        }
    }
    assert_true(differ * 1000 < compared && open > 1000 && hits_of_mesh[0] > 1000 && hits_of_mesh[2] > 100 &&
                hits_of_mesh[3] + hits_of_mesh[4] + hits_of_mesh[5] == 0);
    pell_light_grid_destroy(&grid);
    pell_rays_destroy(&rays);
    pell_pool_destroy(&pool);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

/* Each triangle covers the whole grid: 80,000 of them would need 2 billion list entries. */
static void triangles_that_cover_all_are_given_up_at_once(void **state)
{
    enum { TRIANGLES = 80000 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = shapes_scene(ctx);
    struct pell_mesh *m = shapes_mesh(s, 0, 3, TRIANGLES);
    static const float corners[9] = { -50.0f, -50.0f, 0.0f, 50.0f, -50.0f, 0.0f, 0.0f, 50.0f, 1.0f };
    size_t before;
    double begin;

    (void) state;
    memcpy(m->position, corners, sizeof(corners));
    for (size_t i = 0; i < 3 * (size_t) TRIANGLES; i++)
        m->index[i] = (uint32_t) (i % 3);
    shapes_bound(s, m);
    before = pell_memory_used(ctx);
    begin = pell_seconds();
    assert_null(grid_of(s, vec3(0, 0, 200.0f)));
    assert_true(pell_seconds() - begin < 2.0);
    assert_int_equal(pell_memory_used(ctx), before);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void where_memory_is_short_there_is_none_and_no_error(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context_params params = { .log = keep_message, .log_user = &kept };
    struct pell_limits limits;
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s;
    void *rest;

    (void) state;
    limits = *pell_context_limits(ctx);
    pell_context_destroy(&ctx);
    limits.memory_bytes = 2 << 20;
    params.limits = &limits;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    s = shapes_scene(ctx);
    shapes_ball(s, 0, vec3(0, 0, 0), 10.0f, 120);
    assert_null(grid_of(s, vec3(0, 0, 100.0f)));
    rest = pell_alloc(ctx, (size_t) limits.memory_bytes - pell_memory_used(ctx) - (32 << 10)); /* not even memory for counting */
    assert_non_null(rest);
    assert_null(grid_of(s, vec3(0, 0, 100.0f)));
    assert_int_equal(kept.errors + kept.warnings, 0);
    pell_free(ctx, rest);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void running_out_of_memory_is_reported(void **state)
{
    bool built = false;

    (void) state;
    for (uint64_t n = 1; !built; n++) {
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, NULL);
        struct pell_scene *s = shapes_scene(ctx);
        struct pell_light_grid *grid;

        shapes_ball(s, 0, vec3(0, 0, 0), 1.0f, 8);
        fault.fail_at = atomic_load(&fault.calls) + n;
        built = pell_light_grid_create(ctx, s, vec3(0, 0, 10), &grid) == PELL_OK;
        assert_true(built || !grid);
        assert_true(!built || n == 7);
        pell_light_grid_destroy(&grid);
        pell_scene_destroy(&s);
        pell_context_destroy(&ctx);
        assert_int_equal(atomic_load(&fault.live), 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_see_the_apex_where_no_triangle_of_all_is_between),
        cmocka_unit_test(nothing_slips_through_between_triangles),
        cmocka_unit_test(lanes_that_are_off_stay_off_and_levels_agree),
        cmocka_unit_test(there_is_none_where_rays_do_better),
        cmocka_unit_test(a_far_apex_leaves_the_surface_its_light),
        cmocka_unit_test(several_meshes_answer_as_rays_do),
        cmocka_unit_test(triangles_that_cover_all_are_given_up_at_once),
        cmocka_unit_test(where_memory_is_short_there_is_none_and_no_error),
        cmocka_unit_test(running_out_of_memory_is_reported),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
