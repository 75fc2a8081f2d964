/* SPDX-License-Identifier: MIT
 * images.c - `pellucid compare A B`: the error of image A against its reference B, whatever program made them. */
#include "cli/compare/sources.h"

#include "base/file.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

struct task {
    struct sources s;
    struct pell_compare_params params;
    struct pell_comparison result, whole; /* `whole`: comparison of all light, if the layer compared is only a part of it */
};

/* --- Comparing ---------------------------------------------------------------------------------------------------------------- */

/* The command line's exposure, else the one that the reference was rendered with, so that the comparison judges what its PNG shows. */
static void take_exposure(struct task *t)
{
    const struct pell_layers *l = &t->s.reference.rows->layers;
    double exposure;

    for (size_t i = 0; i < l->num_attributes && !(t->params.exposure > 0.0f); i++)
        if (strcmp(l->attributes[i].name, "pellucid.exposure") == 0 &&
            pell_parse_number(l->attributes[i].value, strlen(l->attributes[i].value), &exposure) && exposure > 0.0 && exposure <= 1e12)
            t->params.exposure = (float) exposure;
}

static enum pell_result compare_light(struct cli *cli, struct task *t, bool all_light, struct pell_comparison *out)
{
    const struct pell_compare_input in = sources_input(&t->s, all_light, 0);
    const struct pell_compare_rows rows = sources_rows(&t->s, all_light);

    return compare_run(cli, t->s.test.path, t->s.reference.path, &in, &rows, &t->params, out);
}

/* Maps and the report need the whole images in memory; metrics alone do not. */
static enum pell_result compare(struct cli *cli, struct task *t)
{
    struct sources *s = &t->s;
    enum pell_result res;

    PELL_TRY(sources_hold(s, cli->output));
    if (cli->output)
        PELL_TRY(sources_take(s, 0, s->reference.height));
    take_exposure(t);
    PELL_TRY(compare_light(cli, t, false, &t->result));
    if (t->result.masked.pixels == 0)
        return pell_error(cli->ctx, PELL_ERR_INVALID, s->reference.path, "the whole image is compared with --mask none",
                          "no pixel is in the mask (%s above 0.5)", s->mask_name);
    if (sources_have_two(s))
        PELL_TRY(compare_light(cli, t, true, &t->whole));
fail:
    cli_progress_end(cli);
    return res;
}

static bool has_mask(const struct task *t)
{
    return t->s.mask_name[0];
}

static const struct pell_metrics *whole_of(const struct task *t)
{
    return sources_have_two(&t->s) ? &t->whole.whole : &t->result.whole;
}

/* --- The answer --------------------------------------------------------------------------------------------------------------- */

static json_t *answer_json(struct cli *cli, const struct task *t)
{
    const struct pell_comparison *r = &t->result;
    const bool display = t->s.test.display, noise = sources_know_noise(&t->s);
    json_t *method = compare_metrics(&r->masked, display), *reference, *o;

    json_object_set_new(method, "name", cli_text(t->s.test.path));
    json_object_set_new(method, "against", json_string("reference"));
    json_object_set_new(method, "bad_pixels", json_integer(r->bad_test));
    json_object_set_new(method, "whole", compare_metrics(whole_of(t), display));
    reference = json_pack("{s:o,s:o,s:I}", "name", cli_text(t->s.reference.path), "rel_noise",
                          noise ? cli_number(sqrt(r->masked.noise_rel_mse)) : json_null(), "bad_pixels", (json_int_t) r->bad_reference);
    o = json_pack("{s:o,s:[o],s:i,s:i,s:o,s:o,s:f,s:f,s:f,s:O}", "reference", reference, "methods", method, "width", r->width, "height",
                  r->height, "layer", cli_text(t->s.layer), "mask", has_mask(t) ? cli_text(t->s.mask_name) : json_null(), "ppd",
                  (double) t->params.ppd, "floor", (double) t->params.floor, "seconds", r->seconds + t->whole.seconds, "warnings",
                  cli->warnings);
    if (o)
        compare_add_shown(o, r, display);
    if (o && cli->output)
        json_object_set_new(o, "output", cli_text(cli->output));
    return o;
}

static void print_row(const char *name, bool both, const char *masked, const char *whole)
{
    if (both)
        printf("%-18s %12s %12s\n", name, masked, whole);
    else
        printf("%-18s %12s\n", name, whole);
}

static void row_of_counts(const char *name, bool both, int64_t masked, int64_t whole)
{
    char a[24], b[24];

    snprintf(a, sizeof(a), "%" PRId64, masked);
    snprintf(b, sizeof(b), "%" PRId64, whole);
    print_row(name, both, a, b);
}

static void row(const char *name, bool both, double masked, double whole)
{
    char a[24] = "-", b[24] = "-";

    if (isfinite(masked))
        snprintf(a, sizeof(a), "%.6g", masked);
    if (isfinite(whole))
        snprintf(b, sizeof(b), "%.6g", whole);
    print_row(name, both, a, b);
}

static double resolved(double mse, double error)
{
    return pell_metric_resolved(mse, error) ? mse : (double) NAN;
}

/* The noise that was subtracted, and the remaining uncertainty as standard errors; "+-" precedes the metric. */
static void noise_rows(bool both, const struct pell_metrics *m, const struct pell_metrics *w)
{
    char name[40];

    row("noise, mse", both, m->noise_mse, w->noise_mse);
    row("noise, rel mse", both, m->noise_rel_mse, w->noise_rel_mse);
    row("+- mse", both, m->mse_error, w->mse_error);
    row("+- rel mse", both, m->rel_mse_error, w->rel_mse_error);
    for (int c = 0; c < 3; c++) {
        snprintf(name, sizeof(name), "+- bias %c", "rgb"[c]);
        row(name, both, m->bias_error[c], w->bias_error[c]);
    }
    for (int c = 0; c < 3; c++) {
        snprintf(name, sizeof(name), "+- bias %c, rel.", "rgb"[c]);
        row(name, both, m->rel_bias_error[c], w->rel_bias_error[c]);
    }
    row("|z| > 3, share", both, m->agreement.beyond_3, w->agreement.beyond_3);
    row("p, by chance", both, m->agreement.p, w->agreement.p);
}

static void print_verdict(const struct pell_metrics *m)
{
    json_t *numbers = compare_metrics(m, false);
    const char *reason = compare_unresolved(numbers);

    if (reason)
        printf("\nerror not resolved (%s)\n", reason);
    if (isfinite(m->agreement.p))
        printf("\nthe images %s (p %s %.3g)\n", m->agreement.p < COMPARE_LIKELY ? "differ by more than noise" : "agree within their noise",
               m->agreement.p < 1e-9 ? "<" : "=", m->agreement.p < 1e-9 ? 1e-9 : m->agreement.p);
    json_decref(numbers);
}

static void answer_text(const struct cli *cli, const struct task *t)
{
    const struct pell_comparison *r = &t->result;
    const struct pell_metrics *m = &r->masked, *w = whole_of(t);
    const bool both = has_mask(t) || sources_have_two(&t->s);
    char a[256], b[256], shown[256];

    printf("%s%s%s against %s, %d x %d, %s\n\n", cli_style(cli, stdout, 1), pell_printable(t->s.test.path, a, sizeof(a)),
           cli_style(cli, stdout, 0), pell_printable(t->s.reference.path, b, sizeof(b)), r->width, r->height,
           pell_printable(t->s.layer, shown, sizeof(shown)));
    if (both)
        printf("%-18s %12s %12s\n", "", sources_have_two(&t->s) ? SUBSURFACE : "masked", "whole");
    row_of_counts("pixels", both, m->pixels, w->pixels);
    row("mse", both, resolved(m->mse, m->mse_error), resolved(w->mse, w->mse_error));
    row("rel mse", both, resolved(m->rel_mse, m->rel_mse_error), resolved(w->rel_mse, w->rel_mse_error));
    row("mae", both, m->mae, w->mae);
    for (int c = 0; c < 3; c++) {
        snprintf(a, sizeof(a), "bias %c", "rgb"[c]);
        row(a, both, m->bias[c], w->bias[c]);
    }
    for (int c = 0; c < 3; c++) {
        snprintf(a, sizeof(a), "bias %c, relative", "rgb"[c]);
        row(a, both, m->rel_bias[c], w->rel_bias[c]);
    }
    row("ssim", both, m->ssim, w->ssim);
    row("flip", both, m->flip, w->flip);
    if (!t->s.test.display)
        row("flip hdr", both, m->flip_hdr, w->flip_hdr);
    if (sources_know_noise(&t->s))
        noise_rows(both, m, w);
    print_verdict(m);
    if (has_mask(t))
        printf("\nmask: %s\n", pell_printable(t->s.mask_name, shown, sizeof(shown)));
}

/* --- The folder --------------------------------------------------------------------------------------------------------------- */

/* The reference as used for comparison: the mean of its halves. */
static enum pell_result report_reference(struct cli *cli, struct report *report, const struct pell_compare_input *in, json_t **id)
{
    const size_t pixels = (size_t) in->width * (size_t) in->height;
    const float *mean[3];
    float *planes;
    enum pell_result res;

    if (!in->half[0])
        return report_image(report, in->reference, in->stride, id);
    planes = pell_alloc_array(cli->ctx, pixels, 3 * sizeof(float));
    if (!planes)
        return PELL_ERR_NOMEM;
    for (size_t c = 0; c < 3; c++) {
        for (size_t i = 0; i < pixels; i++)
            planes[c * pixels + i] = 0.5f * (in->reference[c][i] + in->half[c][i]);
        mean[c] = planes + c * pixels;
    }
    res = report_image(report, mean, in->stride, id);
    pell_free(cli->ctx, planes);
    return res;
}

static json_t *image_json(const char *name, const char *role)
{
    return json_pack("{s:o,s:s,s:{},s:{},s:{}}", "name", cli_text(name), "role", role, "data", "flip", "metrics");
}

static enum pell_result write_report(struct cli *cli, const struct task *t, struct output_folder *f)
{
    const bool display = t->s.test.display, two = sources_have_two(&t->s), masked = two || has_mask(t);
    json_t *reference = image_json(pell_path_name(t->s.reference.path), "reference"), *id = NULL;
    json_t *test = image_json(pell_path_name(t->s.test.path), "method"), *views = json_array(), *data = NULL;
    struct report *report = NULL;
    const char *path = NULL;
    enum pell_result res;

    PELL_TRY(report_open(cli->ctx, t->s.reference.width, t->s.reference.height, &report));
    for (int whole = masked ? 0 : 1; whole < 2; whole++) {
        const bool again = whole && masked && !two; /* the same pixels with other means */
        struct pell_compare_input in = sources_input(&t->s, whole, 0);
        const struct pell_comparison *r = whole && two ? &t->whole : &t->result;
        const char *view = whole ? "whole" : "part", *from = again ? "part" : view;

        if (whole)
            in.mask = NULL;
        json_array_append_new(views, report_view(report, view,
                                                 whole ? "Whole image"
                                                 : two ? "Subsurface light"
                                                       : "Masked pixels",
                                                 whole ? "All light, all pixels."
                                                 : two ? "Light that went through the material, of the pixels that show it."
                                                       : "The pixels of the mask.",
                                                 &in, &t->params, r));
        if (!again) {
            PELL_TRY(report_reference(cli, report, &in, &id));
            json_object_set_new(json_object_get(reference, "data"), view, id);
            PELL_TRY(report_image(report, in.test, in.stride, &id));
            json_object_set_new(json_object_get(test, "data"), view, id);
            PELL_TRY(report_map(report, r->flip, r->width, &id));
            json_object_set_new(json_object_get(test, "flip"), view, id);
        } else {
            json_object_set(json_object_get(reference, "data"), view, json_object_get(json_object_get(reference, "data"), from));
            json_object_set(json_object_get(test, "data"), view, json_object_get(json_object_get(test, "data"), from));
            json_object_set(json_object_get(test, "flip"), view, json_object_get(json_object_get(test, "flip"), from));
        }
        json_object_set_new(json_object_get(test, "metrics"), view, compare_metrics(whole ? whole_of(t) : &r->masked, display));
    }
    data =
        json_pack("{s:s,s:o,s:s,s:O,s:[O,O],s:O,s:b,s:o}", "kind", "pictures", "title", cli_text(pell_path_name(t->s.test.path)), "command",
                  cli->command_line, "views", views, "pictures", reference, test, "warnings", cli->warnings, "display", (int) display,
                  "rel_noise", sources_know_noise(&t->s) ? cli_number(sqrt(t->result.masked.noise_rel_mse)) : json_null());
    if (!data || !(path = folder_file(f, "report.html"))) {
        res = data ? PELL_ERR_INVALID : PELL_ERR_NOMEM;
        goto fail;
    }
    PELL_TRY(report_write(report, data, path));
fail:
    json_decref(data);
    json_decref(views);
    json_decref(reference);
    json_decref(test);
    report_close(&report);
    return res;
}

static enum pell_result write_all(struct cli *cli, const struct task *t, const json_t *answer)
{
    struct output_folder f;
    enum pell_result res;

    PELL_TRY(folder_begin(cli->ctx, "--output", cli->output, &f));
    PELL_TRY(compare_write_maps(cli, &t->result, t->s.test.display, &f));
    PELL_TRY(compare_write_errors(cli, &t->result, &f, "errors.exr"));
    PELL_TRY(compare_write_json(cli, answer, &f));
    PELL_TRY(write_report(cli, t, &f));
    PELL_TRY(folder_commit(&f));
fail:
    folder_drop(&f);
    return res;
}

/* --- The command -------------------------------------------------------------------------------------------------------------- */

enum exit_code compare_images(struct cli *cli)
{
    struct task t = { .s = { .cli = cli } };
    json_t *answer = NULL;
    enum exit_code code = cli_failed(cli, compare_params(cli, &t.params));

    if (code == EXIT_OK)
        code = cli_failed(cli, sources_open(cli, &t.s));
    if (code == EXIT_OK)
        code = cli_failed(cli, compare(cli, &t));
    if (code == EXIT_OK && !(answer = answer_json(cli, &t)))
        code = EXIT_MEMORY;
    if (code == EXIT_OK && cli->output)
        code = cli_failed(cli, write_all(cli, &t, answer));
    if (code == EXIT_OK && cli->json)
        code = cli_print_json(cli, json_incref(answer));
    else if (code == EXIT_OK)
        answer_text(cli, &t);
    json_decref(answer);
    pell_comparison_finish(cli->ctx, &t.result);
    pell_comparison_finish(cli->ctx, &t.whole);
    sources_close(&t.s);
    return code;
}
