/* SPDX-License-Identifier: MIT
 * pass.c - for engines: a method runs on the caller's own planes, here a marble wall, lit on its right half. */
#include <pellucid/context.h>
#include <pellucid/method.h>

#include <math.h>
#include <stdio.h>

enum { WIDTH = 256, HEIGHT = 16, CHANNELS = 3 };
static const float SCALE = 10.0f, LIGHT = 100.0f; /* px/mm; W/m^2 */

static uint16_t material[HEIGHT * WIDTH];
static float depth[HEIGHT * WIDTH], irradiance[CHANNELS][HEIGHT * WIDTH], exitance[CHANNELS][HEIGHT * WIDTH];

static void print_message(void *user, const struct pell_message *m)
{
    (void) user;
    fprintf(stderr, "%s: %s\n", m->where, m->what);
}

/* Runs a method on the frame, which holds an engine's data after its lighting pass. */
static enum pell_result scatter(struct pell_device *device, struct pell_context *ctx, const struct pell_frame *frame,
                                const struct pell_frame_light *light)
{
    const struct pell_method *method = pell_method_find(ctx, "pass.c", "screen-space");
    struct pell_pass *pass = NULL;
    void *knobs = NULL;
    enum pell_result res = method ? pell_method_knobs_create(ctx, method, "gaussians=6 lod=2", &knobs) : PELL_ERR_INVALID;

    if (res == PELL_OK)
        res = pell_pass_create(device, method, knobs, &frame->shape, &pass); /* once */
    if (res == PELL_OK)
        res = pell_pass_render(pass, frame, light); /* every frame: allocates nothing */
    pell_pass_destroy(&pass);
    pell_method_knobs_destroy(ctx, &knobs);
    return res;
}

/* Half-lit plane: R convolved with a step, as a sum of error functions. */
static double expected(const struct pell_gaussians *g, int channel, double mm)
{
    double sum = 0.0;

    for (int i = 0; i < g->count; i++)
        sum += g->weight[i][channel] * 0.5 * (1.0 + erf(mm / sqrt(2.0 * g->variance[i])));
    return sum * (double) LIGHT;
}

int main(void)
{
    const struct pell_material_entry *marble = pell_material_find("marble");
    const struct pell_frame_material wall = { .medium = marble->medium, .name = marble->name };
    const struct pell_frame frame = {
        .shape = { WIDTH, HEIGHT, WIDTH, .orthographic = true, .focal_px = SCALE, .materials = &wall, .num_materials = 1 },
        .rect = { 0, 0, WIDTH, HEIGHT },
        .material = material,
        .depth = depth,
        .irradiance = { irradiance[0], irradiance[1], irradiance[2] },
    };
    const struct pell_frame_light light = { .light = { exitance[0], exitance[1], exitance[2] } };
    struct pell_context *ctx = NULL;
    struct pell_device *device = NULL;
    struct pell_gaussians fit;
    double worst = 0.0;
    enum pell_result res = pell_context_create(&(struct pell_context_params) { .log = print_message }, &ctx);

    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        material[i] = 1;   /* the first of the frame's materials; 0 means not translucent */
        depth[i] = 500.0f; /* mm */
        for (int c = 0; c < CHANNELS; c++)
            irradiance[c][i] = i % WIDTH >= WIDTH / 2 ? LIGHT : 0.0f;
    }
    if (res == PELL_OK)
        res = pell_device_create(ctx, NULL, &device); /* an engine, and a thread per core */
    if (res == PELL_OK)
        res = scatter(device, ctx, &frame, &light);
    if (res == PELL_OK)
        res = pell_fit_medium(&wall.medium, &(struct pell_fit_params) { .count = 6 }, &fit, NULL);
    printf("mm from the shadow's edge, radiant exitance R G B in W/m^2\n");
    for (int x = WIDTH / 2 - 28; res == PELL_OK && x < WIDTH / 2 + 29; x += 4) {
        const double mm = (x + 0.5 - WIDTH / 2) / (double) SCALE;
        const int at = HEIGHT / 2 * WIDTH + x;

        printf("%6.2f  %7.3f %7.3f %7.3f\n", mm, (double) exitance[0][at], (double) exitance[1][at], (double) exitance[2][at]);
        for (int c = 0; c < CHANNELS; c++)
            worst = fmax(worst, fabs((double) exitance[c][at] - expected(&fit, c, mm)));
    }
    printf("largest difference from the closed form: %.2f W/m^2 of %g\n", worst, (double) LIGHT);
    pell_device_destroy(&device);
    pell_context_destroy(&ctx);
    return res == PELL_OK && worst < 1.0 ? 0 : 1;
}
