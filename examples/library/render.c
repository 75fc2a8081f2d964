/* SPDX-License-Identifier: MIT
 * render.c - a mesh and a material become an image in memory, and then an EXR file with all layers.
 *
 *     render MESH SIZE_MM MATERIAL OUT.exr */
#include <pellucid/context.h>
#include <pellucid/image.h>
#include <pellucid/render.h>
#include <pellucid/scene.h>

#include <stdio.h>
#include <stdlib.h>

static void print_message(void *user, const struct pell_message *m)
{
    (void) user;
    fprintf(stderr, "%s: %s%s%s\n", m->where, m->what, m->hint[0] ? "; " : "", m->hint);
}

static enum pell_result choose_method(struct pell_context *ctx, struct pell_renderer *r)
{
    const struct pell_method *method = pell_method_find(ctx, "render.c", "screen-space");
    void *knobs;
    enum pell_result res = method ? pell_method_knobs_create(ctx, method, "gaussians=6", &knobs) : PELL_ERR_INVALID;

    if (res != PELL_OK)
        return res;
    res = pell_renderer_set_method(r, method, knobs); /* copies them */
    pell_method_knobs_destroy(ctx, &knobs);
    return res;
}

static void print_image(const struct pell_render_result *p)
{
    const float *rgb[3] = { p->channels[0].data, p->channels[1].data, p->channels[2].data };
    const ptrdiff_t middle = p->height / 2 * p->stride + p->width / 2;

    printf("%d x %d pixels, %.1f ms, exposure %g, %d pixels set to 0\n", p->width, p->height, 1e3 * p->seconds, (double) p->exposure,
           (int) p->invalid);
    printf("radiance in the middle: %g %g %g W/(m^2 sr)\n", (double) rgb[0][middle], (double) rgb[1][middle], (double) rgb[2][middle]);
    for (size_t i = 0; i < p->num_channels; i++)
        printf("%s%s", i ? " " : "channels: ", p->channels[i].name);
    printf("\n");
}

int main(int argc, char **argv)
{
    struct pell_load_params load = { .aspect = 16.0f / 9.0f };
    struct pell_settings settings;
    struct pell_render_result image;
    struct pell_context *ctx = NULL;
    struct pell_scene *scene = NULL;
    struct pell_device *device = NULL;
    struct pell_renderer *renderer = NULL;
    enum pell_result res;

    if (argc != 5) {
        fprintf(stderr, "usage: render MESH SIZE_MM MATERIAL OUT.exr\n");
        return 2;
    }
    load.size_mm = strtod(argv[2], NULL);
    load.material = argv[3];
    pell_knobs_default(pell_settings_knobs(), &settings);
    settings.width = 320;
    settings.height = 180;
    settings.layers = true;

    res = pell_context_create(&(struct pell_context_params) { .log = print_message, .log_level = PELL_LOG_WARNING }, &ctx);
    if (res == PELL_OK)
        res = pell_scene_load(ctx, argv[1], &load, &scene);
    if (res == PELL_OK)
        res = pell_device_create(ctx, NULL, &device); /* an engine, and a thread per core */
    if (res == PELL_OK)
        res = pell_renderer_create(device, &renderer);
    if (res == PELL_OK)
        res = pell_renderer_set_scene(renderer, scene);
    if (res == PELL_OK)
        res = choose_method(ctx, renderer);
    if (res == PELL_OK)
        res = pell_renderer_render(renderer, &settings, &image);
    if (res == PELL_OK) {
        print_image(&image);
        res = pell_image_write(
            ctx, argv[4], NULL,
            &(struct pell_write_params) {
                .width = image.width, .height = image.height, .channels = image.channels, .num_channels = image.num_channels });
    }
    pell_renderer_destroy(&renderer); /* in this order; each accepts NULL */
    pell_device_destroy(&device);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
    return res == PELL_OK ? 0 : 1;
}
