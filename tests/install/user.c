/* SPDX-License-Identifier: MIT
 * user.c - a program that uses an installed libpellucid: builds a ball of milk in memory, renders it and inspects the image. Valid C11
 * and C++17; includes only installed headers. */
#include <pellucid/context.h>
#include <pellucid/image.h>
#include <pellucid/method.h>
#include <pellucid/optics.h>
#include <pellucid/render.h>
#include <pellucid/scene.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { RINGS = 24, SLICES = 48, SIZE = 96 };

static void print_message(void *user, const struct pell_message *m)
{
    (void) user;
    fprintf(stderr, "%s: %s\n", m->where, m->what);
}

static enum pell_result make_ball(struct pell_scene *scene, float radius)
{
    const uint32_t columns = SLICES + 1;
    size_t mesh, material;
    enum pell_result res = pell_scene_add_mesh(scene, "ball", &mesh);
    uint32_t *index;

    if (res == PELL_OK)
        res = pell_scene_add_material(scene, "milk", &material);
    if (res == PELL_OK)
        res = pell_material_apply(scene, material, "user.c", "wholemilk");
    if (res == PELL_OK)
        res = pell_mesh_allocate(scene, mesh, (RINGS + 1) * columns, 2 * RINGS * SLICES);
    if (res != PELL_OK)
        return res;
    for (uint32_t r = 0; r <= RINGS; r++)
        for (uint32_t s = 0; s <= SLICES; s++) {
            const float theta = 3.14159265f * (float) r / RINGS, phi = 6.2831853f * (float) (s % SLICES) / SLICES;
            float *p = scene->meshes[mesh].position + 3 * (r * columns + s);
            p[0] = radius * sinf(theta) * cosf(phi);
            p[1] = radius * cosf(theta);
            p[2] = -radius * sinf(theta) * sinf(phi);
        }
    index = scene->meshes[mesh].index;
    for (uint32_t r = 0; r < RINGS; r++)
        for (uint32_t s = 0; s < SLICES; s++) {
            const uint32_t a = r * columns + s, b = a + columns;
            const uint32_t quad[6] = { a, b, a + 1, a + 1, b, b + 1 };
            memcpy(index, quad, sizeof(quad));
            index += 6;
        }
    scene->meshes[mesh].material = (int) material;
    return PELL_OK;
}

static int look(const struct pell_render_result *image)
{
    double inside = 0, outside = 0;

    for (int y = 0; y < image->height; y++)
        for (int x = 0; x < image->width; x++) {
            const double light = image->display[1][y * image->stride + x];
            const double dx = x + 0.5 - SIZE / 2.0, dy = y + 0.5 - SIZE / 2.0;
            if (dx * dx + dy * dy < SIZE * SIZE / 16.0)
                inside += light;
            else if (!(light >= 0 && light <= 1))
                outside += 1;
        }
    printf("mean inside: %.3f, invalid: %d\n", inside / (3.14159265 * SIZE * SIZE / 16.0), (int) image->invalid);
    return inside > 0.05 * SIZE * SIZE / 16.0 && outside == 0 && image->invalid == 0 ? 0 : 1;
}

int main(void)
{
    struct pell_context_params params;
    struct pell_device_params device_params;
    struct pell_load_params load;
    struct pell_settings settings;
    struct pell_render_result image;
    struct pell_context *ctx = NULL;
    struct pell_device *device = NULL;
    struct pell_renderer *renderer = NULL;
    struct pell_scene *scene = NULL;
    const struct pell_method *method;
    char expected[32];
    int status = 1;

    memset(&params, 0, sizeof(params));
    memset(&device_params, 0, sizeof(device_params));
    memset(&load, 0, sizeof(load));
    params.log = print_message;
    load.aspect = 1;
    snprintf(expected, sizeof(expected), "%d.%d.%d", PELL_VERSION_MAJOR, PELL_VERSION_MINOR, PELL_VERSION_PATCH);
    if (strcmp(pell_version_string(), expected) != 0 || fabs(pell_fresnel(1.5, 1.0) - 0.04) > 1e-12)
        return 2;
    if (pell_context_create(&params, &ctx) != PELL_OK)
        return 3;
    method = pell_method_find(ctx, "user.c", "screen-space");
    pell_knobs_default(pell_settings_knobs(), &settings);
    settings.width = settings.height = SIZE;
    if (method && pell_scene_create(ctx, &scene) == PELL_OK && make_ball(scene, 20) == PELL_OK &&
        pell_scene_complete(scene, &load) == PELL_OK && pell_device_create(ctx, &device_params, &device) == PELL_OK &&
        pell_renderer_create(device, &renderer) == PELL_OK && pell_renderer_set_scene(renderer, scene) == PELL_OK &&
        pell_renderer_set_method(renderer, method, NULL) == PELL_OK && pell_renderer_render(renderer, &settings, &image) == PELL_OK)
        status = look(&image);
    pell_renderer_destroy(&renderer);
    pell_device_destroy(&device);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
    return status;
}
