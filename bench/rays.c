/* SPDX-License-Identifier: MIT
 * rays.c - the surface stage's overhead over bare Embree: the same rays in the same packets through Embree alone, through src/visibility,
 * and through the whole stage, without and with maps, in one run.
 *
 *     bench_rays [--mesh FILE --size MM] [--threads N] [--texture N]
 *
 * Without a file the mesh is a bumpy ball of 73,000 triangles. The camera is placed such that it covers a third of 1280 x 720. */
#include "render/surface/stage.h"

#include <embree3/rtcore.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH 1280
#define HEIGHT 720
#define ROUNDS 40

static void log_message(void *user, const struct pell_message *m)
{
    (void) user;
    fprintf(stderr, "%s: %s\n", m->where, m->what);
}

static enum pell_result make_ball(struct pell_context *ctx, struct pell_scene **out)
{
    enum { RINGS = 135, SECTORS = 270 };
    struct pell_scene *s;
    enum pell_result res;
    size_t mesh, material;
    struct pell_mesh *m;
    uint32_t *index;

    PELL_TRY(pell_scene_create(ctx, out));
    s = *out;
    PELL_TRY(pell_scene_add_material(s, "ball", &material));
    PELL_TRY(pell_scene_add_mesh(s, "ball", &mesh));
    PELL_TRY(pell_mesh_allocate(s, mesh, (RINGS + 1) * (SECTORS + 1), 2 * RINGS * SECTORS));
    m = &s->meshes[mesh];
    m->uv[0] = pell_calloc(ctx, m->num_vertices, 2 * sizeof(float));
    m->tangent = pell_calloc(ctx, m->num_vertices, 4 * sizeof(float));
    if (!m->uv[0] || !m->tangent)
        return PELL_ERR_NOMEM;
    s->materials[material].opaque = false;
    s->materials[material].roughness = 0.4f;
    s->materials[material].metallic = 0.0f;
    index = m->index;
    for (int j = 0; j <= RINGS; j++)
        for (int i = 0; i <= SECTORS; i++) {
            const int k = j * (SECTORS + 1) + i;
            const float u = (float) i / SECTORS, v = (float) j / RINGS, theta = v * PELL_PI_F, phi = 2.0f * PELL_PI_F * u;
            const float r = 100.0f * (1.0f + 0.03f * sinf(9.0f * theta) * sinf(12.0f * phi));
            const float n[3] = { sinf(theta) * cosf(phi), cosf(theta), -sinf(theta) * sinf(phi) };
            for (int c = 0; c < 3; c++) {
                m->position[3 * k + c] = r * n[c];
                m->normal[3 * k + c] = n[c];
            }
            m->uv[0][2 * k] = u;
            m->uv[0][2 * k + 1] = v;
            m->tangent[4 * k] = -sinf(phi);
            m->tangent[4 * k + 2] = -cosf(phi);
            m->tangent[4 * k + 3] = 1.0f;
            if (i < SECTORS && j < RINGS) {
                const uint32_t q = (uint32_t) k, face[6] = { q, q + SECTORS + 1, q + 1, q + 1, q + SECTORS + 1, q + SECTORS + 2 };
                memcpy(index, face, sizeof(face));
                index += 6;
            }
        }
    for (int c = 0; c < 3; c++) {
        s->bounds_min[c] = -103.0f;
        s->bounds_max[c] = 103.0f;
    }
    return PELL_OK;

fail:
    return res;
}

/* A texture of pseudo-random pixels, of 3 channels. */
static enum pell_result add_texture(struct pell_scene *s, const char *name, int size, bool srgb, int base, int range,
                                    struct pell_texture **out)
{
    enum pell_result res;
    const size_t bytes = (size_t) size * (size_t) size * 3;
    uint8_t *pixels;
    uint32_t state = 1;

    PELL_TRY(pell_scene_add_texture(s, name, out));
    pixels = pell_alloc(s->ctx, bytes);
    if (!pixels)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < bytes; i++) {
        state = state * 1664525u + 1013904223u;
        pixels[i] = (uint8_t) (base + (int) ((state >> 16) % (uint32_t) range));
    }
    (*out)->image = (struct pell_image) { size, size, 3, PELL_PIXEL_U8, srgb, pixels };
    return PELL_OK;

fail:
    return res;
}

/* --- Bare Embree -------------------------------------------------------------------------------------------------------------- */

struct bare {
    RTCScene scene;
    const struct pell_rays *rays; /* instead of it */
    const struct pell_view *view;
    struct pell_rect rect;
    int64_t hits[HEIGHT];
};

static void bare_band(void *arg, int index, int worker)
{
    struct bare *b = arg;
    struct pell_ray_hit16 p;
    int64_t hits = 0;

    (void) worker;
    memset(&p, 0, sizeof(p));
    for (int i = 0; i < 16; i++) {
        p.ray.tnear[i] = 1e-6f;
        p.ray.mask[i] = PELL_RAY_ALL;
    }
    for (int x = b->rect.x0 & ~3; x < b->rect.x1; x += 4)
        for (int y = 8 * index; y < 8 * index + 8; y += 4) {
            _Alignas(64) int valid[16];
            if (y + 4 <= b->rect.y0 || y >= b->rect.y1)
                continue;
            for (int i = 0; i < 16; i++) {
                struct pell_vec3 start, direction;
                pell_view_ray(b->view, (float) (x + i % 4), (float) (y + i / 4), &start, &direction);
                p.ray.ox[i] = start.x;
                p.ray.oy[i] = start.y;
                p.ray.oz[i] = start.z;
                p.ray.dx[i] = direction.x;
                p.ray.dy[i] = direction.y;
                p.ray.dz[i] = direction.z;
                p.ray.tfar[i] = INFINITY;
                valid[i] = -1;
            }
            if (b->rays) {
                pell_rays_closest16(b->rays, valid, true, &p);
            } else if (b->scene) {
                struct RTCIntersectContext context;
                rtcInitIntersectContext(&context);
                context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
                memset(p.hit.mesh, 0xff, sizeof(p.hit.mesh));
                rtcIntersect16(valid, b->scene, &context, (struct RTCRayHit16 *) &p);
            }
            for (int i = 0; i < 16; i++)
                hits += p.hit.mesh[i] != PELL_NO_HIT;
        }
    b->hits[index] = hits;
}

/* The best of many rounds, in ms; compared times are taken in the same rounds, as the speed of machines varies. */
static void best_of(double start, double *best)
{
    *best = fmin(*best, (pell_seconds() - start) * 1e3);
}

static RTCScene bare_scene(RTCDevice device, const struct pell_scene *s)
{
    RTCScene scene = rtcNewScene(device);

    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    for (size_t i = 0; i < s->num_meshes; i++) {
        const struct pell_mesh *m = &s->meshes[i];
        RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, m->position, 0, 12, m->num_vertices);
        rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, m->index, 0, 12, m->num_triangles);
        rtcSetGeometryMask(g, ~0u);
        rtcCommitGeometry(g);
        rtcAttachGeometry(scene, g);
        rtcReleaseGeometry(g);
    }
    rtcCommitScene(scene);
    return scene;
}

/* A camera in front of the bounds such that a ball inside them covers about a third of the image. */
static struct pell_view look(const struct pell_scene *s)
{
    struct pell_camera camera = { .forward = { 0, 0, -1 }, .up = { 0, 1, 0 }, .fov = 0.349f };
    const float height = s->bounds_max[1] - s->bounds_min[1], width = s->bounds_max[0] - s->bounds_min[0];
    const float extent = height > width ? height : width;

    for (int c = 0; c < 3; c++)
        camera.position[c] = 0.5f * (s->bounds_min[c] + s->bounds_max[c]);
    camera.position[2] += 0.5f * extent + 0.5f * extent / 0.87f / tanf(0.5f * camera.fov);
    return pell_view_make(&camera, WIDTH, HEIGHT, 0.0f, 0.0f);
}

/* Input, and the objects made from it. */
struct bench {
    const char *path; /* NULL: a ball */
    double size;
    int threads, texture;
    struct pell_context *ctx;
    struct pell_pool *pool;
    struct pell_scene *scene;
    struct pell_rays *rays;
    struct pell_mips *mips;
    struct pell_surface surface;
    struct pell_view view;
    RTCDevice device;
    RTCScene bare;
};

/* Milliseconds; of repeated work the minimum. */
struct times {
    double bare_build, build, made, bare, rays, plain, mips, maps, aliased;
};

static void read_options(struct bench *b, int argc, char **argv)
{
    for (int i = 1; i + 1 < argc; i += 2) {
        if (strcmp(argv[i], "--mesh") == 0)
            b->path = argv[i + 1];
        else if (strcmp(argv[i], "--size") == 0)
            b->size = strtod(argv[i + 1], NULL);
        else if (strcmp(argv[i], "--threads") == 0)
            b->threads = atoi(argv[i + 1]);
        else if (strcmp(argv[i], "--texture") == 0)
            b->texture = atoi(argv[i + 1]);
    }
}

static enum pell_result open_scene(struct bench *b)
{
    const struct pell_load_params load = { .size_mm = b->size, .material = "wholemilk", .bare = true };
    enum pell_result res;

    if (!b->path)
        return make_ball(b->ctx, &b->scene);
    PELL_TRY(pell_scene_load(b->ctx, b->path, &load, &b->scene));
    for (size_t i = 0; i < b->scene->num_materials; i++) { /* its own maps are not what is compared */
        struct pell_material *m = &b->scene->materials[i];
        m->base_color_map.texture = m->normal_map.texture = m->roughness_map.texture = m->metallic_map.texture = m->rho_s_map.texture =
            m->specular_color_map.texture = m->strength_map.texture = m->emissive_map.texture = NULL;
    }
fail:
    return res;
}

static enum pell_result time_surface(struct bench *b, double *best)
{
    const double start = pell_seconds();
    const enum pell_result res = pell_surface_render(b->pool, b->rays, b->scene, &b->view, &b->surface);

    best_of(start, best);
    return res;
}

/* Building, and rays of a frame without maps: bare Embree, ours, and the surface stage. */
static enum pell_result time_rays(struct bench *b, struct times *t)
{
    const struct pell_rect rect = pell_view_rect(&b->view, b->scene->bounds_min, b->scene->bounds_max);
    double *const best[3] = { &t->made, &t->bare, &t->rays };
    enum pell_result res;

    t->bare_build = pell_seconds();
    b->device = rtcNewDevice(NULL);
    b->bare = bare_scene(b->device, b->scene);
    t->bare_build = (pell_seconds() - t->bare_build) * 1e3;
    t->build = pell_seconds();
    PELL_TRY(pell_rays_create(b->ctx, b->scene, b->pool, &b->rays));
    t->build = (pell_seconds() - t->build) * 1e3;
    PELL_TRY(pell_surface_allocate(b->ctx, WIDTH, HEIGHT, &b->surface));
    for (int i = 0; i < ROUNDS; i++) {
        struct bare kinds[3] = {
            { NULL, NULL, &b->view, rect, { 0 } },
            { b->bare, NULL, &b->view, rect, { 0 } },
            { NULL, b->rays, &b->view, rect, { 0 } },
        };
        for (int k = 0; k < 3; k++) {
            const double start = pell_seconds();
            pell_pool_run(b->pool, HEIGHT / 8, bare_band, &kinds[k]);
            best_of(start, best[k]);
        }
        PELL_TRY(time_surface(b, &t->plain));
    }
fail:
    return res;
}

/* The surface stage with three maps, with and without mips. */
static enum pell_result time_maps(struct bench *b, struct times *t)
{
    struct pell_texture *maps[3];
    enum pell_result res;

    PELL_TRY(add_texture(b->scene, "color", b->texture, true, 100, 100, &maps[0]));
    PELL_TRY(add_texture(b->scene, "normal", b->texture, false, 120, 16, &maps[1]));
    PELL_TRY(add_texture(b->scene, "spec", b->texture, false, 50, 100, &maps[2]));
    b->scene->materials[0].base_color_map.texture = maps[0];
    if (b->scene->meshes[0].tangent)
        b->scene->materials[0].normal_map.texture = maps[1];
    b->scene->materials[0].rho_s_map.texture = maps[2];
    t->mips = pell_seconds();
    PELL_TRY(pell_mips_create(b->ctx, b->scene, b->pool, &b->mips));
    t->mips = (pell_seconds() - t->mips) * 1e3;
    for (int i = 0; i < ROUNDS; i++) {
        b->surface.mips = NULL;
        PELL_TRY(time_surface(b, &t->aliased));
        b->surface.mips = b->mips;
        PELL_TRY(time_surface(b, &t->maps));
    }
fail:
    return res;
}

static void print_times(const struct bench *b, const struct times *t)
{
    const double rays = (double) b->surface.rays, pixels = (double) b->surface.covered_pixels;

    printf("%u triangles, %.0f rays, %.0f pixels hit (%.2f of %d x %d), %d threads, %d x %d textures\n", b->scene->meshes[0].num_triangles,
           rays, pixels, pixels / (WIDTH * HEIGHT), WIDTH, HEIGHT, b->threads, b->texture, b->texture);
    printf("build              %8.2f ms   bare %.2f ms\n", t->build, t->bare_build);
    printf("making rays        %8.2f ms\n", t->made);
    printf("bare Embree        %8.2f ms   %.1f Mray/s\n", t->bare, rays / t->bare * 1e-3);
    printf("rays               %8.2f ms   %.3f of bare\n", t->rays, t->rays / t->bare);
    printf("surface            %8.2f ms   %.3f of bare, %.1f ns a pixel more\n", t->plain, t->plain / t->bare,
           (t->plain - t->bare) * 1e6 / pixels);
    printf("surface, 3 maps    %8.2f ms   %.3f of bare; without mips %.2f ms; making mips %.1f ms\n", t->maps, t->maps / t->bare,
           t->aliased, t->mips);
}

int main(int argc, char **argv)
{
    const struct pell_context_params params = { .log = log_message };
    struct bench b = { .size = 200.0, .threads = 2, .texture = 4096 };
    struct times t = { .made = INFINITY, .bare = INFINITY, .rays = INFINITY, .plain = INFINITY, .maps = INFINITY, .aliased = INFINITY };
    enum pell_result res;

    read_options(&b, argc, argv);
    PELL_TRY(pell_context_create(&params, &b.ctx));
    PELL_TRY(pell_pool_create(b.ctx, b.threads, &b.pool));
    PELL_TRY(open_scene(&b));
    b.view = look(b.scene);
    PELL_TRY(time_rays(&b, &t));
    PELL_TRY(time_maps(&b, &t));
    print_times(&b, &t);

fail:
    pell_surface_finish(b.ctx, &b.surface);
    pell_mips_destroy(&b.mips);
    pell_rays_destroy(&b.rays);
    if (b.bare)
        rtcReleaseScene(b.bare);
    if (b.device)
        rtcReleaseDevice(b.device);
    pell_scene_destroy(&b.scene);
    pell_pool_destroy(&b.pool);
    pell_context_destroy(&b.ctx);
    return res == PELL_OK ? 0 : 1;
}
