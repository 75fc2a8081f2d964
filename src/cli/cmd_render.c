/* SPDX-License-Identifier: MIT
 * cmd_render.c - `pellucid render`: a picture, or a turntable of them. */
#include "cli/cli.h"

#include "base/file.h"
#include "math/vec.h"

#include <stdlib.h>
#include <string.h>

/* "bunny.obj" -> "bunny.png", in the current folder. */
static void default_output(const char *input, char *out, size_t size)
{
    const char *name = strrchr(input, '/') ? strrchr(input, '/') + 1 : input;
    const char *dot = strrchr(name, '.');
    snprintf(out, size, "%.*s.png", dot && dot != name ? (int) (dot - name) : (int) strlen(name), name);
}

/* "turn.png", 7 -> "turn_0007.png". */
static void numbered(const char *path, int number, char *out, size_t size)
{
    const char *slash = strrchr(path, '/'), *dot = strrchr(path, '.');
    if (!dot || (slash && dot < slash))
        dot = path + strlen(path);
    snprintf(out, size, "%.*s_%04d%s", (int) (dot - path), path, number, dot);
}

static const char *format_of(const struct cli *cli, const char *path)
{
    if (cli->format)
        return cli->format;
    for (int i = 0; pell_write_formats[i]; i++)
        if (pell_path_has_extension(path, pell_write_formats[i]))
            return pell_write_formats[i];
    return NULL;
}

static enum exit_code check_output(struct cli *cli, const char *path)
{
    const char *format = format_of(cli, path);
    bool known = false;

    if (!format)
        return cli_usage(cli, "--output", strcmp(path, "-") == 0 ? "add --format png" : "the format follows from the name's ending, or from --format",
                         "\"%s\", must end in .png, .exr, .hdr or .pfm", path);
    for (int i = 0; pell_write_formats[i]; i++)
        known = known || strcmp(format, pell_write_formats[i]) == 0;
    if (!known)
        return cli_usage(cli, "--format", NULL, "\"%s\", must be png, exr, hdr or pfm", format);
    if (strcmp(path, "-") == 0 && (cli->json || cli->turntable > 0))
        return cli_usage(cli, "--output", NULL, "- writes one picture to stdout: it does not go with %s", cli->json ? "--json" : "--turntable");
    return EXIT_OK;
}

static enum pell_result write_picture(struct cli *cli, const struct session *s, const struct pell_picture *p, const char *path)
{
    const char *format = format_of(cli, path);
    const bool png = strcmp(format, "png") == 0, transparent = s->scene->background == PELL_BACKGROUND_TRANSPARENT;
    const struct pell_channel display[4] = {
        { "R", p->display[0], p->stride, false },
        { "G", p->display[1], p->stride, false },
        { "B", p->display[2], p->stride, false },
        { "A", p->alpha, p->stride, false },
    };
    char seed[32], exposure[32], seconds[32];
    const struct pell_attribute attributes[] = {
        { "pellucid.version", pell_version() },
        { "pellucid.command", cli->command_line },
        { "pellucid.method", s->method ? s->method->name : "none" },
        { "pellucid.engine", pell_engine_name(pell_renderer_engine(s->renderer)) },
        { "pellucid.seed", seed },
        { "pellucid.exposure", exposure },
        { "pellucid.seconds", seconds },
        { "pellucid.units", "linear Rec.709; radiance W/(m^2 sr), irradiance W/m^2, depth mm" },
    };

    snprintf(seed, sizeof(seed), "%lld", (long long) s->settings.seed);
    snprintf(exposure, sizeof(exposure), "%.9g", (double) p->exposure);
    snprintf(seconds, sizeof(seconds), "%.3f", p->seconds);
    return pell_image_write(cli->ctx, path, format,
                            &(struct pell_write_params) {
                                .width = p->width,
                                .height = p->height,
                                .channels = png ? display : p->channels,
                                .num_channels = png ? (transparent ? 4 : 3) : p->num_channels,
                                .attributes = attributes,
                                .num_attributes = PELL_COUNT(attributes),
                                .compression = PELL_EXR_PIZ,
                            });
}

static void print_stats(const struct pell_picture *p)
{
    fprintf(stderr, "%-28s %9s %10s %10s %9s %7s\n", "stage", "ms", "pixels", "rays", "copy ms", "ratio");
    for (size_t i = 0; i < p->num_stages; i++) {
        const struct pell_stage_time *t = &p->stages[i];
        fprintf(stderr, "%-28s %9.2f %10lld %10lld ", t->name, t->ms, (long long) t->pixels, (long long) t->rays);
        if (t->copy_ms > 0.0)
            fprintf(stderr, "%9.2f %7.1f\n", t->copy_ms, t->ms / t->copy_ms);
        else
            fprintf(stderr, "%9s %7s\n", "-", "-");
    }
    fprintf(stderr, "%-28s %9.2f\n", "frame", 1e3 * p->seconds);
}

/* Turns the camera about the vertical axis through the middle of the bounds. */
static void turn_camera(const struct pell_scene *scene, const struct pell_camera *from, double angle, struct pell_camera *to)
{
    const double c = cos(angle), s = sin(angle);
    const struct pell_mat4 turn = { { c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, 0, 0, 0, 1 } };
    const struct pell_vec3 middle = vec3(0.5f * (scene->bounds_min[0] + scene->bounds_max[0]), 0.0f, 0.5f * (scene->bounds_min[2] + scene->bounds_max[2]));

    vec3_store(vec3_add(middle, mat4_direction(&turn, vec3_sub(vec3_load(from->position), middle))), to->position);
    vec3_store(mat4_direction(&turn, vec3_load(from->forward)), to->forward);
    vec3_store(mat4_direction(&turn, vec3_load(from->up)), to->up);
}

static enum exit_code render_one(struct cli *cli, struct session *s, const char *path, struct pell_picture *picture)
{
    enum pell_result res = pell_renderer_render(s->renderer, &s->settings, picture);

    cli_progress_end(cli);
    if (res == PELL_OK)
        res = write_picture(cli, s, picture, path);
    if (res != PELL_OK)
        return cli_failed(cli, res);
    if (cli->stats && !cli->json)
        print_stats(picture);
    return EXIT_OK;
}

static enum exit_code answer(struct cli *cli, const struct session *s, const char *path, const struct pell_picture *p)
{
    const char *method = s->method ? s->method->name : "none", *engine = pell_engine_name(pell_renderer_engine(s->renderer));

    if (cli->json)
        return cli_print_json(cli, json_pack("{s:s,s:s,s:s,s:i,s:i,s:f,s:f,s:i,s:f,s:o,s:O}", "image", path, "method", method, "engine", engine,
                                             "width", p->width, "height", p->height, "seconds", p->seconds, "load_seconds", s->load_seconds,
                                             "threads", pell_renderer_threads(s->renderer), "exposure", (double) p->exposure, "stages",
                                             session_stages(p), "warnings", cli->warnings));
    if (!cli->quiet)
        fprintf(stderr, "%s: %d x %d, %s on engine %s (%d threads), %.2f s after %.2f s of loading\n", strcmp(path, "-") ? path : "stdout", p->width,
                p->height, method, engine, pell_renderer_threads(s->renderer), p->seconds, s->load_seconds);
    return EXIT_OK;
}

enum exit_code command_render(struct cli *cli)
{
    const char *input = cli->arguments[0];
    struct pell_picture picture = { 0 };
    struct session s = { 0 };
    char path[4096], fallback[4096];
    const char *output = cli->output;
    enum exit_code code;

    if (!output) {
        default_output(input, fallback, sizeof(fallback));
        output = fallback;
    }
    code = check_output(cli, output);
    if (code == EXIT_OK)
        code = session_open(cli, input, &s);
    if (code == EXIT_OK) {
        s.settings.layers = strcmp(format_of(cli, output), "exr") == 0;
        if ((code = cli_failed(cli, pell_renderer_check_range(s.renderer, &s.settings))) != EXIT_OK)
            goto out;
    }
    if (code == EXIT_OK && cli->turntable == 0) {
        snprintf(path, sizeof(path), "%s", output);
        code = render_one(cli, &s, path, &picture);
    } else if (code == EXIT_OK) {
        const struct pell_camera camera = s.scene->cameras[0];
        for (int i = 0; i < cli->turntable && code == EXIT_OK; i++) {
            turn_camera(s.scene, &camera, 2.0 * PELL_PI * i / cli->turntable, &s.scene->cameras[0]);
            numbered(output, i, path, sizeof(path));
            code = render_one(cli, &s, path, &picture);
            cli_progress(cli, "turntable", (double) (i + 1) / cli->turntable);
        }
        cli_progress_end(cli);
    }
    if (code == EXIT_OK)
        code = answer(cli, &s, path, &picture);
out:
    session_close(cli, &s);
    return code;
}
