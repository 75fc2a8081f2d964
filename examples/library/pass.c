/* SPDX-License-Identifier: MIT
 * pass.c - for engines: a method runs on planes that the caller made. Here they show a marble wall, lit on its right half.
 */
#include <pellucid/context.h>
#include <pellucid/method.h>

#include <math.h>
#include <stdio.h>

enum { WIDTH = 256, HEIGHT = 128, CHANNELS = 3 };
static const float PIXELS_PER_MM = 10.0f, LIGHT = 100.0f; /* W/m^2 */

static uint16_t material[HEIGHT * WIDTH];
static float depth[HEIGHT * WIDTH], irradiance[CHANNELS][HEIGHT * WIDTH], exitance[CHANNELS][HEIGHT * WIDTH];

static void print_message(void *user, const struct pell_message *m)
{
    (void) user;
    fprintf(stderr, "%s: %s\n", m->where, m->what);
}

/* What an engine has after its lighting pass. */
static void light_the_wall(void)
{
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            material[y * WIDTH + x] = 1;   /* the first of the frame's materials; 0 is for what is not translucent */
            depth[y * WIDTH + x] = 500.0f; /* mm */
            for (int c = 0; c < CHANNELS; c++)
                irradiance[c][y * WIDTH + x] = x >= WIDTH / 2 ? LIGHT : 0.0f;
        }
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
        .shape = { .width = WIDTH,
                   .height = HEIGHT,
                   .stride = WIDTH,
                   .orthographic = true,
                   .focal_px = PIXELS_PER_MM,
                   .materials = &wall,
                   .num_materials = 1 },
        .rect = { 0, 0, WIDTH, HEIGHT },
        .material = material,
        .depth = depth,
        .irradiance = { irradiance[0], irradiance[1], irradiance[2] },
    };
    const struct pell_frame_light light = { { exitance[0], exitance[1], exitance[2] } };
    struct pell_context *ctx = NULL;
    struct pell_device *device = NULL;
    struct pell_pass *pass = NULL;
    struct pell_gaussians fit;
    const struct pell_method *method;
    double worst = 0.0;
    enum pell_result res = pell_context_create(&(struct pell_context_params) { .log = print_message }, &ctx);

    light_the_wall();
    if (res == PELL_OK)
        res = pell_device_create(ctx, NULL, &device); /* an engine, and a thread per core */
    method = res == PELL_OK ? pell_method_find(ctx, "pass.c", "screen-space") : NULL;
    if (method)
        res = pell_pass_create(device, method, NULL, &frame.shape, &pass); /* once */
    if (pass)
        res = pell_pass_render(pass, &frame, &light); /* every frame: allocates nothing */
    if (pass && res == PELL_OK)
        res = pell_fit_medium(&wall.medium, &(struct pell_fit_params) { .count = 4 }, &fit, NULL);
    if (pass && res == PELL_OK) {
        printf("mm from the shadow's edge, radiant exitance R G B in W/m^2\n");
        for (int x = 0; x < WIDTH; x++) {
            const double mm = (x + 0.5 - WIDTH / 2) / (double) PIXELS_PER_MM;
            const int at = HEIGHT / 2 * WIDTH + x;

            for (int c = 0; c < CHANNELS && fabs(mm) < 3.0; c++)
                worst = fmax(worst, fabs((double) exitance[c][at] - expected(&fit, c, mm)));
            if (x % 8 == 4 && fabs(mm) < 3.0)
                printf("%6.2f  %7.3f %7.3f %7.3f\n", mm, (double) exitance[0][at], (double) exitance[1][at], (double) exitance[2][at]);
        }
        printf("largest difference from the closed form: %.2f W/m^2 of %g\n", worst, (double) LIGHT);
    }
    pell_pass_destroy(&pass);
    pell_device_destroy(&device);
    pell_context_destroy(&ctx);
    return method && res == PELL_OK && worst < 1.0 ? 0 : 1;
}
