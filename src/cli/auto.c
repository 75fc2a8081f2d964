/* SPDX-License-Identifier: MIT
 * auto.c - `render --max-error`: the cheapest method whose error on this scene is below a bound. A small image of the scene shows all that
 * the error depends on (mean free paths relative to object size and pixels, curvature, thin parts, folds, lights): methods are compared
 * with path-trace on one, in the order of their cost, until one is accurate enough. */
#include "cli/auto.h"

#include <pellucid/compare.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define DEFAULT_BOUND "8%" /* default bound of -m auto */
#define PIXELS 16000.0     /* size of the small image: errors per pixel grow with resolution */
/* fraction of the squared bound: once the standard error of an estimated error is below it, the reference has enough samples */
#define RESOLVED 0.25

/* Sample counts of path-trace for both halves of the reference, in increasing order: the first that resolves the bound is used. */
static const char *const samples[] = { "32", "64", "128", "256" };

/* Candidate methods in the order of their cost. */
static const struct {
    const char *label, *method; /* method NULL: no scattering */
    const char *knob, *value;
} candidates[] = {
    { "none", NULL, NULL, NULL },
    { "screen-space", "screen-space", NULL, NULL },
    { "image-space", "image-space", NULL, NULL },
    { "convolution", "convolution", NULL, NULL },
    { "convolution:planes=16", "convolution", "planes", "16" },
    { "texture-space", "texture-space", NULL, NULL },
    { "hierarchical", "hierarchical", NULL, NULL },
};

/* A method's relative error on the small image. */
struct measured {
    double error, noise; /* standard error of `error` */
    double square_noise; /* standard error of the squared error */
};

struct trial {
    struct cli *cli;
    struct session *session;
    struct pell_settings settings; /* settings of the small image */
    size_t pixels;
    float *planes; /* both halves of the reference, then the method's image: three planes each; then the mask */
    json_t *tried;
};

static float *plane(const struct trial *t, size_t number)
{
    return t->planes + number * t->pixels;
}

/* Copies the light that left translucent pixels into three planes. */
static void take_light(const struct trial *t, const struct pell_render_result *p, float *to)
{
    static const char *const names[3] = { "R", "G", "B" };

    memset(to, 0, 3 * t->pixels * sizeof(*to));
    for (size_t c = 0; c < 3; c++)
        for (size_t k = 0; k < PELL_COUNT(cli_subsurface_layers); k++) {
            const struct pell_channel *from = cli_channel(p, cli_subsurface_layers[k], names[c]);
            for (int y = 0; from && y < p->height; y++)
                for (int x = 0; x < p->width; x++)
                    to[c * t->pixels + (size_t) y * (size_t) p->width + (size_t) x] += from->data[y * from->stride + x];
        }
}

static bool take_mask(const struct trial *t, const struct pell_render_result *p)
{
    const struct pell_channel *from = cli_channel(p, "translucent", "Y");
    bool any = false;

    for (int y = 0; from && y < p->height; y++)
        for (int x = 0; x < p->width; x++) {
            const float translucent = from->data[y * from->stride + x];
            plane(t, 9)[(size_t) y * (size_t) p->width + (size_t) x] = translucent;
            any = any || translucent > 0.5f;
        }
    return any;
}

/* Makes the knob values of a method; the caller frees them. */
static enum pell_result make_values(const struct trial *t, const struct pell_method *m, const char *knob, const char *value, void **values)
{
    const struct pell_setting set = { knob, value, "--max-error" };

    *values = calloc(1, m->knobs_size);
    return *values ? pell_method_configure(t->cli->ctx, m, &set, knob ? 1 : 0, *values) : PELL_ERR_NOMEM;
}

/* Renders the small image. `logs`: which messages are printed meanwhile. */
static enum pell_result render_small(struct trial *t, const struct pell_method *m, const void *values, int logs,
                                     struct pell_render_result *image)
{
    struct cli *cli = t->cli;
    enum pell_result res;

    cli->logs = logs;
    res = pell_renderer_set_method(t->session->renderer, m, values);
    if (res == PELL_OK)
        res = pell_renderer_render(t->session->renderer, &t->settings, image);
    cli_progress_end(cli);
    cli->logs = CLI_LOGS_ALL;
    return res == PELL_OK && image->partial ? PELL_ERR_CANCELLED : res;
}

static enum pell_result no_truth(struct pell_context *ctx)
{
    return pell_error(ctx, PELL_ERR_DEVICE, "--max-error", "--engine cpu",
                      "methods are compared with path-trace, which runs only on the engine cpu");
}

/* Renders both halves of the path-traced reference. */
static enum pell_result render_truth(struct trial *t, const char *count)
{
    const struct pell_method *m = pell_method_find(t->cli->ctx, "--max-error", "path-trace");
    struct pell_render_result image;
    void *values = NULL;
    enum pell_result res = m ? PELL_OK : PELL_ERR_INVALID;

    if (m && !session_runs(t->session, m))
        return no_truth(t->cli->ctx);
    for (int half = 0; half < 2 && res == PELL_OK; half++) {
        free(values);
        PELL_TRY(make_values(t, m, "samples", count, &values));
        PELL_TRY(pell_method_knobs_set_text(t->cli->ctx, m, values, "half", half ? "2" : "1"));
        PELL_TRY(render_small(t, m, values, CLI_LOGS_ERRORS, &image));
        take_light(t, &image, plane(t, half ? 3 : 0));
        if (!take_mask(t, &image)) {
            res = pell_error(t->cli->ctx, PELL_ERR_INVALID, t->session->scene->path, "give it a --material, or name a method with -m",
                             "no pixel shows a translucent object: --max-error has nothing to measure");
            goto fail;
        }
    }
fail:
    free(values);
    return res;
}

/* Measures the error of the method's planes. */
static enum pell_result measure(const struct trial *t, struct measured *out)
{
    struct pell_compare_params params;
    struct pell_comparison result = { .width = 0 };
    struct pell_compare_input in = { .width = t->settings.width, .height = t->settings.height, .stride = t->settings.width };
    enum pell_result res;

    pell_knobs_default(pell_compare_knobs(), &params);
    params.threads = t->cli->numbers.threads;
    for (size_t c = 0; c < 3; c++) {
        in.test[c] = plane(t, 6 + c);
        in.reference[c] = plane(t, c);
        in.half[c] = plane(t, 3 + c);
    }
    in.mask = plane(t, 9);
    in.figures_only = true;
    res = pell_compare(t->cli->ctx, &in, &params, &result);
    if (res == PELL_OK) {
        const double square = result.masked.rel_mse;
        out->error = isfinite(square) ? sqrt(fmax(square, 0.0)) : 0.0; /* a black image: no error can be distinguished */
        out->square_noise = result.masked.rel_mse_error;
        out->noise = out->square_noise / (2.0 * fmax(out->error, sqrt(fabs(out->square_noise))));
    }
    pell_comparison_finish(t->cli->ctx, &result);
    return res;
}

static void add_tried(const struct trial *t, const char *label, const struct measured *m)
{
    json_t *o = json_pack("{s:s,s:f}", "method", label, "error", m->error);

    if (o && isfinite(m->noise))
        json_object_set_new(o, "noise", json_real(m->noise));
    json_array_append_new(t->tried, o);
}

/* The scene's other settings at a size that costs little. */
static void shrink(struct trial *t)
{
    const double pixels = (double) t->settings.width * (double) t->settings.height, scale = pixels > PIXELS ? sqrt(PIXELS / pixels) : 1.0;

    t->settings.width = (int) fmax(floor(t->settings.width * scale + 0.5), 1.0);
    t->settings.height = (int) fmax(floor(t->settings.height * scale + 0.5), 1.0);
    t->settings.msaa = 1;
    t->settings.dof = t->settings.denoise = false;
    t->settings.bloom = 0.0f;
    t->settings.layers = true;
}

/* Makes a method and its knob values those of the session. */
static enum exit_code use_method(struct cli *cli, struct session *s, const struct pell_method *m, void *values)
{
    free(s->knobs);
    s->method = m;
    s->knobs = values;
    return session_settings(cli, s->scene, m, values, &s->settings);
}

/* Renders the reference with enough samples to distinguish an error at the bound from one well below it, judged by the error of `none`: the
 * better a method is, the less noise its error has. Leaves the image of `none` in the method's planes. */
static enum pell_result find_truth(struct trial *t, double bound)
{
    struct pell_render_result image;
    struct measured none;
    enum pell_result res;

    PELL_TRY(render_small(t, NULL, NULL, CLI_LOGS_ERRORS, &image));
    take_light(t, &image, plane(t, 6));
    for (size_t i = 0; i < PELL_COUNT(samples); i++) {
        PELL_TRY(render_truth(t, samples[i]));
        PELL_TRY(measure(t, &none));
        if (!(none.square_noise > RESOLVED * bound * bound))
            break;
    }
fail:
    return res;
}

/* Tries the methods; call after find_truth. *method path-trace, *error 0: no method meets the bound. */
static enum pell_result try_all(struct trial *t, double bound, const struct pell_method **method, void **values, double *error)
{
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < PELL_COUNT(candidates); i++) {
        const struct pell_method *m = candidates[i].method ? pell_method_find(t->cli->ctx, "--max-error", candidates[i].method) : NULL;
        struct pell_render_result image;
        struct measured found;
        if (m && !session_runs(t->session, m))
            continue;
        if (m) {
            PELL_TRY(make_values(t, m, candidates[i].knob, candidates[i].value, values));
            res = render_small(t, m, *values, CLI_LOGS_NOTHING, &image);
            if (res == PELL_ERR_UNSUPPORTED || res == PELL_ERR_INVALID) { /* the method does not support this scene */
                free(*values);
                *values = NULL;
                continue;
            }
            if (res != PELL_OK)
                goto fail;
            take_light(t, &image, plane(t, 6));
        }
        PELL_TRY(measure(t, &found));
        add_tried(t, candidates[i].label, &found);
        if (found.error + (isfinite(found.noise) ? found.noise : 0.0) <= bound) {
            *method = m;
            *error = found.error;
            return PELL_OK;
        }
        free(*values);
        *values = NULL;
    }
    *error = 0.0;
    *method = pell_method_find(t->cli->ctx, "--max-error", "path-trace");
    return *method ? make_values(t, *method, NULL, NULL, values) : PELL_ERR_INVALID;
fail:
    free(*values);
    *values = NULL;
    return res;
}

static void report_choice(const struct trial *t, const struct pell_method *m, double bound, double error)
{
    struct pell_text line = { .length = 0 };
    const size_t count = json_array_size(t->tried);

    if (error > 0.0 || !m || strcmp(m->name, "path-trace") != 0)
        pell_text_add(&line, "%s: %.1f %% from path-trace on %d x %d pixels, %.3g %% are allowed",
                      json_string_value(json_object_get(json_array_get(t->tried, count - 1), "method")), 100.0 * error, t->settings.width,
                      t->settings.height, 100.0 * bound);
    else
        pell_text_add(&line, "path-trace: on %d x %d pixels no method is within %.3g %%", t->settings.width, t->settings.height,
                      100.0 * bound);
    for (size_t i = 0; i < count; i++) {
        const json_t *o = json_array_get(t->tried, i);
        const bool last = i + 1 == count && m && strcmp(m->name, "path-trace") != 0;
        const json_t *noise = json_object_get(o, "noise");
        if (last)
            continue;
        pell_text_add(&line, "%s%s %.1f", i == 0 ? "; " : ", ", json_string_value(json_object_get(o, "method")),
                      100.0 * json_real_value(json_object_get(o, "error")));
        if (noise)
            pell_text_add(&line, " +- %.1f", 100.0 * json_real_value(noise));
        pell_text_add(&line, " %%");
    }
    pell_info(t->cli->ctx, "--max-error", "%s", line.str);
}

enum exit_code auto_bound(struct cli *cli, double *bound)
{
    const struct pell_method *truth = pell_method_find(cli->ctx, "--max-error", "path-trace");
    enum exit_code code = cli_parse_percent(cli, "--max-error", cli->max_error ? cli->max_error : DEFAULT_BOUND, bound);

    return code == EXIT_OK && truth && !truth->vulkan && cli->engine && strcmp(cli->engine, "vulkan") == 0
               ? cli_failed(cli, no_truth(cli->ctx))
               : code;
}

enum exit_code auto_choose(struct cli *cli, struct session *s, json_t **answer)
{
    struct trial t = { .cli = cli, .session = s, .settings = s->settings, .tried = json_array() };
    const struct pell_method *method = NULL;
    void *values = NULL;
    double bound = 0.0, error = 0.0;
    enum exit_code code = auto_bound(cli, &bound);
    enum pell_result res = PELL_OK;

    if (code == EXIT_OK) {
        shrink(&t);
        t.pixels = (size_t) t.settings.width * (size_t) t.settings.height;
        t.planes = pell_calloc(cli->ctx, t.pixels, 10 * sizeof(float));
        res = t.planes && t.tried ? find_truth(&t, bound) : PELL_ERR_NOMEM;
        if (res == PELL_OK)
            res = try_all(&t, bound, &method, &values, &error);
        code = cli_failed(cli, res);
    }
    if (code == EXIT_OK) {
        report_choice(&t, method, bound, error);
        code = use_method(cli, s, method, values);
        if (code == EXIT_OK)
            code = cli_failed(cli, pell_renderer_set_method(s->renderer, s->method, s->knobs));
        *answer =
            json_pack("{s:f,s:i,s:i,s:O}", "max_error", bound, "width", t.settings.width, "height", t.settings.height, "tried", t.tried);
    }
    pell_free(cli->ctx, t.planes);
    json_decref(t.tried);
    return code;
}
