/* SPDX-License-Identifier: MIT
 * test_gpu_rays.c - rays in a compute shader (visibility/wide_bvh.glsl) hit the same triangles as Embree's, and no ray passes through an
 * edge. Under the validation layer; skipped, by name, where there is no driver or no layer. */
#include "gpu_test.h"
#include "shapes.h"

#include "visibility/rays.h"
#include "visibility/wide_bvh.h"

enum { MOST = 40000 };

#define OK(expr) assert_int_equal(expr, PELL_OK)

extern const struct pell_shader pell_test_rays_shader;

struct ray {
    float origin[3], near, direction[3], far;
};

struct hit {
    float t, u, v;
    uint32_t hit, mesh, triangle, none[2];
};

struct tracer {
    struct kept_messages kept;
    struct pell_context *ctx;
    struct pell_gpu *gpu;
    struct pell_scene *scene;
    struct pell_pool *pool;
    struct pell_rays *rays;
    struct pell_wide_bvh *bvh;
    struct pell_gpu_buffer *nodes, *triangles, *in, *out, *found;
    struct pell_gpu_pass *pass;
    struct pell_gpu_commands *commands;
};

static void tracer_start(struct tracer *t)
{
    memset(t, 0, sizeof(*t));
    t->ctx = gpu_context(NULL, &t->kept);
    t->gpu = gpu_opened(t->ctx);
    t->scene = shapes_scene(t->ctx);
    OK(pell_pool_create(t->ctx, 2, &t->pool));
}

static void tracer_build(struct tracer *t)
{
    OK(pell_rays_create(t->ctx, t->scene, t->pool, &t->rays));
    OK(pell_wide_bvh_create(t->ctx, t->scene, &t->bvh));
    OK(pell_gpu_buffer_create(t->gpu, PELL_GPU_TO_DEVICE, t->bvh->num_nodes * PELL_WIDE_NODE * 4, "nodes", &t->nodes));
    OK(pell_gpu_buffer_create(t->gpu, PELL_GPU_TO_DEVICE, (t->bvh->num_triangles + 1) * PELL_WIDE_TRIANGLE * 4, "triangles",
                              &t->triangles));
    OK(pell_gpu_buffer_create(t->gpu, PELL_GPU_TO_DEVICE, MOST * sizeof(struct ray), "rays", &t->in));
    OK(pell_gpu_buffer_create(t->gpu, PELL_GPU_ON_DEVICE, MOST * sizeof(struct hit), "hits", &t->found));
    OK(pell_gpu_buffer_create(t->gpu, PELL_GPU_FROM_DEVICE, MOST * sizeof(struct hit), "hits, download", &t->out));
    memcpy(pell_gpu_buffer_host(t->nodes), t->bvh->nodes, t->bvh->num_nodes * PELL_WIDE_NODE * 4);
    memcpy(pell_gpu_buffer_host(t->triangles), t->bvh->triangles, t->bvh->num_triangles * PELL_WIDE_TRIANGLE * 4);
    OK(pell_gpu_pass_create(t->gpu, &pell_test_rays_shader, NULL, 0,
                            (struct pell_gpu_buffer *[]) { t->nodes, t->triangles, t->in, t->found }, &t->pass));
    OK(pell_gpu_commands_create(t->gpu, "rays", &t->commands));
}

static void tracer_finish(struct tracer *t)
{
    pell_gpu_commands_destroy(&t->commands);
    pell_gpu_pass_destroy(&t->pass);
    pell_gpu_buffer_destroy(&t->nodes);
    pell_gpu_buffer_destroy(&t->triangles);
    pell_gpu_buffer_destroy(&t->in);
    pell_gpu_buffer_destroy(&t->found);
    pell_gpu_buffer_destroy(&t->out);
    pell_wide_bvh_destroy(&t->bvh);
    pell_rays_destroy(&t->rays);
    pell_pool_destroy(&t->pool);
    pell_scene_destroy(&t->scene);
    pell_gpu_close(&t->gpu);
    if (t->kept.errors)
        fail_msg("%d messages, the last: %s", t->kept.errors, t->kept.what);
    pell_context_destroy(&t->ctx);
}

static const struct hit *trace(struct tracer *t, uint32_t count, uint32_t mask, bool any)
{
    const uint32_t push[3] = { count, mask, any };

    OK(pell_gpu_begin(t->commands));
    pell_gpu_mark(t->commands, "rays");
    pell_gpu_run(t->commands, t->pass, push, (count + 63) / 64, 1, 1);
    pell_gpu_copy(t->commands, t->found, t->out, count * sizeof(struct hit));
    OK(pell_gpu_finish(t->commands));
    return pell_gpu_buffer_host(t->out);
}

static struct pell_ray as_ray(const struct ray *r, uint32_t mask)
{
    return (struct pell_ray) {
        { r->origin[0], r->origin[1], r->origin[2] }, r->near, { r->direction[0], r->direction[1], r->direction[2] }, r->far, mask
    };
}

static void set(struct ray *r, struct pell_vec3 from, struct pell_vec3 direction, float far)
{
    vec3_store(from, r->origin);
    vec3_store(direction, r->direction);
    r->near = 0.0f;
    r->far = far;
}

static struct pell_vec3 somewhere(uint32_t *seed, float size)
{
    const float x = shapes_random(seed) - 0.5f, y = shapes_random(seed) - 0.5f, z = shapes_random(seed) - 0.5f;

    return vec3(size * x, size * y, size * z);
}

/* Boxes, a ball, random slivers, triangles without an orientation, opaque and translucent. */
static void many_shapes(struct pell_scene *s)
{
    const size_t opaque = shapes_material(s, true);
    struct pell_mesh *soup;
    uint32_t seed = 11;

    shapes_ball(s, 0, vec3(10, 0, 0), 30.0f, 24);
    shapes_box(s, opaque, vec3(-60, -60, -60), vec3(-20, 20, 30));
    shapes_quad(s, opaque, vec3(0, -50, 0), vec3(80, 0, 0), vec3(0, 0, 80));
    soup = shapes_mesh(s, 0, 900, 300);
    for (uint32_t i = 0; i < 300; i++) {
        const struct pell_vec3 at = somewhere(&seed, 120.0f);
        for (uint32_t k = 0; k < 3; k++) {
            vec3_store(vec3_add(at, somewhere(&seed, i % 7 == 0 ? 0.0f : i % 3 == 0 ? 60.0f : 6.0f)), soup->position + 9 * i + 3 * k);
            soup->index[3 * i + k] = 3 * i + k;
        }
    }
}

static void random_rays_meet_what_embree_meets(void **state)
{
    static const uint32_t masks[] = { PELL_RAY_ALL, PELL_RAY_TRANSLUCENT, PELL_RAY_OPAQUE, PELL_RAY_CAMERA };
    enum { RAYS = 10000 };
    struct tracer t;
    uint32_t seed = 5;
    (void) state;

    tracer_start(&t);
    many_shapes(t.scene);
    tracer_build(&t);
    for (size_t m = 0; m < PELL_COUNT(masks); m++) {
        struct ray *rays = pell_gpu_buffer_host(t.in);
        const struct hit *hits;
        int found = 0, other = 0, sight = 0;

        for (int i = 0; i < RAYS; i++) {
            struct pell_vec3 direction = somewhere(&seed, i % 2 ? 1.0f : 200.0f);
            if (i % 5 == 0)
                direction.x = 0.0f;
            if (i % 10 == 0)
                direction.y = 0.0f;
            set(&rays[i], somewhere(&seed, 150.0f), direction, i % 3 == 0 ? 0.9999f : 1e30f);
        }
        hits = trace(&t, RAYS, masks[m], false);
        for (int i = 0; i < RAYS; i++) {
            const struct pell_ray ray = as_ray(&rays[i], masks[m]);
            struct pell_hit cpu = { .t = INFINITY };
            const bool hit = pell_rays_closest(t.rays, &ray, &cpu);
            const double scale = 1e-4 * (double) cpu.t + 1e-4 / (double) vec3_length(vec3_load(rays[i].direction));
            found += hit;
            if (hit != (hits[i].hit != 0) || (hit && fabs((double) cpu.t - (double) hits[i].t) > scale))
                other++;
            else if (hit && hits[i].mesh == cpu.mesh && hits[i].triangle == cpu.triangle)
                REQUIRE(fabs((double) cpu.u - (double) hits[i].u) < 1e-2 && fabs((double) cpu.v - (double) hits[i].v) < 1e-2);
        }
        hits = trace(&t, RAYS, masks[m], true);
        for (int i = 0; i < RAYS; i++) {
            const struct pell_ray ray = as_ray(&rays[i], masks[m]);
            sight += pell_rays_occluded(t.rays, &ray) != (hits[i].hit != 0);
        }
        print_message("# mask %u: %d of %d rays hit; %d hit another triangle, %d differ in visibility\n", masks[m], found, RAYS, other,
                      sight);
        REQUIRE(found > 1000 && found < 9900);
        /* Rays along edges of the slivers. */
        REQUIRE(other <= 5 && sight <= 5);
    }
    tracer_finish(&t);
}

/* From inside a ball far from the origin, at points of edges and at vertices. */
static void no_ray_slips_through_an_edge(void **state)
{
    const struct pell_mesh *m;
    const struct hit *hits;
    struct ray *rays;
    struct tracer t;
    uint32_t seed = 3, count;
    int edges = 0, corners = 0;
    (void) state;

    tracer_start(&t);
    m = shapes_ball(t.scene, 0, vec3(300, -20, 70), 50.0f, 60);
    tracer_build(&t);
    rays = pell_gpu_buffer_host(t.in);
    count = 3 * m->num_triangles < MOST ? 3 * m->num_triangles : MOST;
    for (uint32_t i = 0; i < count; i++) {
        const struct pell_vec3 a = vec3_load(m->position + 3 * m->index[i]);
        const struct pell_vec3 b = vec3_load(m->position + 3 * m->index[i % 3 == 2 ? i - 2 : i + 1]);
        const struct pell_vec3 from = vec3_add(vec3(300, -20, 70), somewhere(&seed, 40.0f));
        set(&rays[i], from, vec3_sub(vec3_mad(a, i % 4 == 0 ? 0.0f : shapes_random(&seed), vec3_sub(b, a)), from), 1e30f);
    }
    hits = trace(&t, count, PELL_RAY_ALL, false);
    for (uint32_t i = 0; i < count; i++) {
        edges += i % 4 != 0 && !hits[i].hit;
        corners += i % 4 == 0 && !hits[i].hit;
    }
    print_message("# %u rays: %d slip through edges, %d through corners\n", count, edges, corners);
    REQUIRE(count > 20000 && edges == 0);
    /* Where six edge tests can contradict each other. */
    REQUIRE(corners * 1000 < (int) count);
    tracer_finish(&t);
}

static void an_empty_scene_stops_no_ray(void **state)
{
    struct tracer t;
    (void) state;

    tracer_start(&t);
    tracer_build(&t);
    set(pell_gpu_buffer_host(t.in), vec3(1, 2, 3), vec3(0, 0, 1), 1e30f);
    assert_int_equal(trace(&t, 1, PELL_RAY_ALL, false)->hit, 0);
    tracer_finish(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_rays_meet_what_embree_meets),
        cmocka_unit_test(no_ray_slips_through_an_edge),
        cmocka_unit_test(an_empty_scene_stops_no_ray),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
