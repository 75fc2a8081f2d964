/* SPDX-License-Identifier: MIT
 * truth.c - a reference that accumulates, and errors against it. */
#include "viewer/truth.h"

#include "viewer/encode.h"

#include "base/file.h"
#include "cli/compare/compare.h"

#include <pellucid/compare.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PIXELS (640.0 * 360.0) /* limit on the size of compared images */
#define BATCHES_MOST 1024
#define NOISE_ENOUGH 0.002
#define REPORT_EVERY 2.0 /* seconds */

struct viewer_truth {
    struct viewer *v;
    uint64_t page;
    const struct viewer_message *view;
    struct viewer_setup setup; /* of the reference */
    bool sampled;              /* it is rendered many times, with other random numbers each time */
    double scale;
    int width, height;
    size_t count;
    float *test[2][3], *mask, *mean[3], *variance[3], *display[3];
    double *sum[3], *squares[3];
    int tests, batches; /* images so far */
    struct pell_settings settings;
    float exposure;
    double noise, reported;
    bool done;
};

enum pell_result viewer_truth_create(struct viewer *v, uint64_t page, const struct viewer_message *view, struct viewer_truth **out)
{
    struct viewer_truth *t = pell_zalloc(v->ctx, sizeof(*t));
    const struct pell_method *method = pell_method_find(v->ctx, "truth", view->truth);

    *out = NULL;
    if (!t || !method) {
        pell_free(v->ctx, t);
        return method ? PELL_ERR_NOMEM : PELL_ERR_INVALID;
    }
    *t = (struct viewer_truth) { .v = v, .page = page, .view = view, .sampled = method->partial, .setup = { .method = method->name } };
    if (t->sampled && pell_knob_find(method->knobs, "samples"))
        t->setup.knobs[t->setup.num_knobs++] = (struct pell_setting) { "samples", "4", "truth" };
    *out = t;
    return PELL_OK;
}

void viewer_truth_destroy(struct viewer_truth **truth)
{
    struct viewer_truth *t = *truth;
    struct pell_context *ctx = t ? t->v->ctx : NULL;

    if (!t)
        return;
    *truth = NULL;
    for (int c = 0; c < 3; c++) {
        pell_free(ctx, t->test[0][c]);
        pell_free(ctx, t->test[1][c]);
        pell_free(ctx, t->mean[c]);
        pell_free(ctx, t->variance[c]);
        pell_free(ctx, t->display[c]);
        pell_free(ctx, t->sum[c]);
        pell_free(ctx, t->squares[c]);
    }
    pell_free(ctx, t->mask);
    pell_free(ctx, t);
}

bool viewer_truth_done(const struct viewer_truth *t)
{
    return t->done;
}

static enum pell_result allocate(struct viewer_truth *t, const struct pell_render_result *image)
{
    struct pell_context *ctx = t->v->ctx;
    bool allocated = true;

    t->width = image->width;
    t->height = image->height;
    t->count = (size_t) t->width * (size_t) t->height;
    for (int c = 0; c < 3; c++) {
        allocated = allocated && (t->test[0][c] = pell_calloc(ctx, t->count, sizeof(float))) != NULL;
        allocated = allocated && (t->test[1][c] = pell_calloc(ctx, t->count, sizeof(float))) != NULL;
        allocated = allocated && (t->mean[c] = pell_calloc(ctx, t->count, sizeof(float))) != NULL;
        allocated = allocated && (t->variance[c] = pell_calloc(ctx, t->count, sizeof(float))) != NULL;
        allocated = allocated && (t->display[c] = pell_calloc(ctx, t->count, sizeof(float))) != NULL;
        allocated = allocated && (t->sum[c] = pell_calloc(ctx, t->count, sizeof(double))) != NULL;
        allocated = allocated && (t->squares[c] = pell_calloc(ctx, t->count, sizeof(double))) != NULL;
    }
    allocated = allocated && (t->mask = pell_calloc(ctx, t->count, sizeof(float))) != NULL;
    return allocated ? PELL_OK : PELL_ERR_NOMEM;
}

static void copy_plane(const struct viewer_truth *t, const float *from, ptrdiff_t stride, float *to)
{
    for (int y = 0; y < t->height; y++)
        memcpy(to + (size_t) y * (size_t) t->width, from + (ptrdiff_t) y * stride, (size_t) t->width * sizeof(float));
}

/* Renders image A, or B, for comparison. */
static enum pell_result draw_test(struct viewer_truth *t, struct viewer_model *m)
{
    static const char *const names[3] = { "R", "G", "B" };
    const bool other = t->tests == 1;
    struct pell_render_result image;
    struct viewer_quality quality = { .scale = 1.0 };
    struct pell_settings full;
    enum pell_result res;

    if (t->tests == 0) {
        int64_t width, height;
        pell_settings_default(NULL, NULL, &full);
        width = full.width;
        height = full.height;
        for (size_t i = 0; i < t->view->num_settings; i++) {
            const struct pell_setting *s = &t->view->settings[i];
            if (strcmp(s->name, "width") == 0)
                pell_parse_int(s->value, strlen(s->value), &width);
            if (strcmp(s->name, "height") == 0)
                pell_parse_int(s->value, strlen(s->value), &height);
        }
        t->scale = fmin(1.0, sqrt(PIXELS / fmax(1.0, (double) width * (double) height)));
    }
    quality.scale = t->scale;
    PELL_TRY(viewer_model_render(m, VIEWER_TRUTH, t->view, other ? &t->view->other : &t->view->setup, &quality, &t->settings, &image));
    if (t->tests == 0)
        PELL_TRY(allocate(t, &image));
    for (int c = 0; c < 3; c++) {
        const struct pell_channel *channel = cli_channel(&image, "", names[c]);
        if (channel)
            copy_plane(t, channel->data, channel->stride, t->test[t->tests][c]);
    }
    if (t->tests == 0 && image.alpha)
        copy_plane(t, image.alpha, image.stride, t->mask);
    t->exposure = t->settings.exposure;
    t->tests++;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result draw_reference(struct viewer_truth *t, struct viewer_model *m)
{
    static const char *const names[3] = { "R", "G", "B" };
    const struct viewer_quality quality = { .scale = t->scale, .seed_offset = t->batches };
    struct pell_render_result image;
    struct pell_settings settings;
    double error = 0.0, light = 0.0;
    enum pell_result res;

    PELL_TRY(viewer_model_render(m, VIEWER_TRUTH, t->view, &t->setup, &quality, &settings, &image));
    if (image.partial)
        return PELL_ERR_CANCELLED;
    t->batches++;
    for (int c = 0; c < 3; c++) {
        const struct pell_channel *channel = cli_channel(&image, "", names[c]);
        for (size_t i = 0; channel && i < t->count; i++) {
            const double n = t->batches,
                         x = (double)
                                 channel->data[(ptrdiff_t) (i / (size_t) t->width) * channel->stride + (ptrdiff_t) (i % (size_t) t->width)];
            double mean, variance;
            t->sum[c][i] += x;
            t->squares[c][i] += x * x;
            mean = t->sum[c][i] / n;
            variance = n > 1.0 ? fmax(0.0, (t->squares[c][i] / n - mean * mean) / (n - 1.0)) : 0.0;
            t->mean[c][i] = (float) mean;
            t->variance[c][i] = (float) variance;
            if (t->mask[i] > 0.5f) {
                error += variance;
                light += mean * mean;
            }
        }
    }
    t->noise = t->batches > 1 && light > 0.0 ? sqrt(error / light) : 0.0;
    t->done = !t->sampled || t->batches >= BATCHES_MOST || (t->batches >= 8 && t->noise < NOISE_ENOUGH);
    return PELL_OK;

fail:
    return res;
}

/* --- Messages to the page ----------------------------------------------------------------------------------------------------------- */

static json_t *metrics_json(const struct pell_metrics *x)
{
    return json_pack("{s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o}", "rel_mse", cli_number(x->rel_mse), "rel_mse_error",
                     cli_number(x->rel_mse_error), "mse", cli_number(x->mse), "mae", cli_number(x->mae), "ssim", cli_number(x->ssim),
                     "flip", cli_number(x->flip), "flip_hdr", cli_number(x->flip_hdr), "bias", cli_numbers(x->rel_bias, 3), "bias_error",
                     cli_numbers(x->rel_bias_error, 3), "resolved", json_boolean(pell_metric_resolved(x->rel_mse, x->rel_mse_error)));
}

static enum pell_result send_planes(struct viewer_truth *t, enum viewer_image_kind kind, bool encoded)
{
    const struct viewer_image planes = { t->width, t->height, t->width, { t->display[0], t->display[1], t->display[2] }, encoded };
    struct viewer_sent sent = {
        .width = t->width, .height = t->height, .mime = "image/jpeg", .exposure = t->exposure, .white = t->settings.white
    };
    const enum pell_result res = viewer_encode_jpeg(t->v->ctx, &planes, 90, &sent.file, &sent.size);

    if (res == PELL_OK)
        viewer_send_image(t->v, t->page, t->view->id, kind, &sent);
    return res;
}

/* Signed relative error: blue is too dark, red too bright. */
static enum pell_result send_error(struct viewer_truth *t, const struct pell_comparison *x, bool other)
{
    for (size_t i = 0; i < t->count; i++) {
        float rgb[3];
        pell_color_diverging(t->mask[i] > 0.5f ? 2.0f * x->relative[i] : 0.0f, rgb);
        for (int c = 0; c < 3; c++)
            t->display[c][i] = rgb[c];
    }
    return send_planes(t, other ? VIEWER_IMAGE_ERROR_B : VIEWER_IMAGE_ERROR_A, true);
}

/* Compares one of the test images with the mean of the references. */
static enum pell_result compare_test(struct viewer_truth *t, struct viewer_model *m, int test, struct pell_compare_input *input,
                                     struct pell_compare_params *params, struct pell_comparison *out)
{
    const bool noisy = t->batches > 1;

    *input = (struct pell_compare_input) { .width = t->width, .height = t->height, .stride = t->width, .mask = t->mask };
    for (int c = 0; c < 3; c++) {
        input->test[c] = t->test[test][c];
        input->reference[c] = t->mean[c];
        input->variance[c] = noisy ? t->variance[c] : NULL;
    }
    pell_knobs_default(pell_compare_knobs(), params);
    params->exposure = t->exposure * exp2f(t->settings.stops);
    params->threads = pell_device_threads(m->device);
    return pell_compare(t->v->ctx, input, params, out);
}

static enum pell_result compare_one(struct viewer_truth *t, struct viewer_model *m, int test, json_t *report)
{
    struct pell_compare_input input;
    struct pell_compare_params params;
    struct pell_comparison comparison;
    enum pell_result res;

    PELL_TRY(compare_test(t, m, test, &input, &params, &comparison));
    json_object_set_new(report, test ? "b" : "a", metrics_json(&comparison.masked));
    res = send_error(t, &comparison, test == 1);
    pell_comparison_finish(t->v->ctx, &comparison);

fail:
    return res;
}

static enum pell_result report(struct viewer_truth *t, struct viewer_model *m)
{
    json_t *o =
        json_pack("{s:s,s:I,s:s,s:i,s:f,s:b,s:b,s:i,s:i}", "type", "truth", "id", (json_int_t) t->view->id, "method", t->setup.method,
                  "batches", t->batches, "noise", t->noise, "random", t->sampled, "done", t->done, "width", t->width, "height", t->height);
    enum pell_result res;

    viewer_tone(&t->settings, (const float *const *) t->mean, t->display, t->count);
    PELL_TRY(send_planes(t, VIEWER_IMAGE_REFERENCE, false));
    for (int i = 0; i < t->tests; i++)
        PELL_TRY(compare_one(t, m, i, o));
    viewer_send(t->v, t->page, o, -1, NULL, 0);
    t->reported = pell_seconds();
    return PELL_OK;

fail:
    json_decref(o);
    return res;
}

enum pell_result viewer_truth_step(struct viewer_truth *t, struct viewer_model *m)
{
    enum pell_result res;

    if (t->tests < (t->view->other.method ? 2 : 1))
        return draw_test(t, m);
    res = draw_reference(t, m);
    if (res == PELL_OK && (t->done || t->batches < 3 || pell_seconds() - t->reported > REPORT_EVERY))
        res = report(t, m);
    return res;
}

bool viewer_truth_compared(const struct viewer_truth *t)
{
    return t && t->batches > 0;
}

/* --- The report ----------------------------------------------------------------------------------------------------------------------- */

static json_t *report_setup(const struct viewer_setup *setup, const char *role)
{
    char name[200];
    int n = snprintf(name, sizeof(name), "%s", setup->method ? setup->method : CLI_DEFAULT_METHOD);

    for (size_t i = 0; i < setup->num_knobs && n > 0 && (size_t) n < sizeof(name); i++)
        n += snprintf(name + n, sizeof(name) - (size_t) n, "%s%s=%s", i ? "," : ":", setup->knobs[i].name, setup->knobs[i].value);
    return json_pack("{s:o,s:s,s:{},s:{},s:{}}", "name", cli_text(name), "role", role, "data", "flip", "metrics");
}

/* Adds a test's image, FLIP and metrics; the first one defines how all are displayed. */
static enum pell_result report_test(struct viewer_truth *t, struct viewer_model *m, int test, struct report *report, json_t *views,
                                    json_t *images)
{
    json_t *o = report_setup(test ? &t->view->other : &t->view->setup, "method"), *id = NULL;
    struct pell_compare_input input;
    struct pell_compare_params params;
    struct pell_comparison comparison = { .width = 0 };
    enum pell_result res;

    PELL_TRY(compare_test(t, m, test, &input, &params, &comparison));
    if (test == 0) {
        json_t *view =
            report_view(report, "object", "The object", "All light of the pixels that show the object.", &input, &params, &comparison);
        json_array_append_new(views, view);
    }
    PELL_TRY(report_image(report, input.test, input.stride, &id));
    json_object_set_new(json_object_get(o, "data"), "object", id);
    PELL_TRY(report_map(report, comparison.flip, comparison.width, &id));
    json_object_set_new(json_object_get(o, "flip"), "object", id);
    json_object_set_new(json_object_get(o, "metrics"), "object", compare_metrics(&comparison.masked, false));
    json_array_append(images, o);

fail:
    json_decref(o);
    pell_comparison_finish(t->v->ctx, &comparison);
    return res;
}

enum pell_result viewer_truth_report(struct viewer_truth *t, struct viewer_model *m, uint8_t **file, size_t *size)
{
    json_t *views = json_array(), *images = json_array(), *reference = report_setup(&t->setup, "reference"), *data = NULL, *id = NULL;
    struct report *report = NULL;
    const struct cli *cli = t->v->cli;
    char *page = NULL;
    enum pell_result res;

    PELL_TRY(report_open(t->v->ctx, t->width, t->height, &report));
    PELL_TRY(report_image(report, (const float *const *) t->mean, t->width, &id));
    json_object_set_new(json_object_get(reference, "data"), "object", id);
    json_array_append(images, reference);
    for (int i = 0; i < t->tests; i++)
        PELL_TRY(report_test(t, m, i, report, views, images));
    data = json_pack("{s:s,s:o,s:s,s:O,s:O,s:[],s:b,s:o}", "kind", "pictures", "title", cli_text(pell_path_name(cli->arguments[0])),
                     "command", cli->command_line, "views", views, "pictures", images, "warnings", "display", 0, "rel_noise",
                     t->sampled ? cli_number(t->noise) : json_null());
    res = data ? report_page(report, data, &page, size) : PELL_ERR_NOMEM;
    *file = (uint8_t *) page;

fail:
    json_decref(data);
    json_decref(views);
    json_decref(images);
    json_decref(reference);
    report_close(&report);
    return res;
}
