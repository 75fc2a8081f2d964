/* SPDX-License-Identifier: MIT
 * pictures.c - `pellucid compare A B`: how far picture A is from its reference B, wherever they come from. */
#include "cli/compare/compare.h"

#include "base/file.h"
#include "image/formats.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SUBSURFACE "subsurface" /* the layer that is a sum of layers */

/* A picture of any format as planes, with the names of its layers. */
struct source {
    const char *path;
    int width, height;
    bool display;                                   /* integers: what a display shows */
    const float *rgb[3];                            /* point into one of the following, three times the same for one channel */
    const float *full[3];                           /* R, G, B of all light, where `rgb` is the subsurface light alone; else NULL */
    const float *alpha, *translucent, *variance[3]; /* or NULL */
    struct pell_layers layers;
    float *planes; /* of a file that is no EXR, or the subsurface light */
};

struct task {
    struct source test, reference, half, mask_file;
    char layer[128];
    float *mask;
    float *variance; /* of the mean of two halves that both know theirs, three planes; or NULL */
    char mask_name[4096];
    struct pell_compare_params params;
    struct pell_comparison result, whole; /* `whole`: of all light, where that is another picture */
};

/* --- Layers ------------------------------------------------------------------------------------------------------------------- */

static const float *find_channel(const struct pell_layers *layers, const char *layer, const char *channel)
{
    char name[256];

    snprintf(name, sizeof(name), "%s%s%s", layer, layer[0] && channel[0] ? "." : "", channel);
    for (size_t i = 0; i < layers->count; i++)
        if (strcmp(layers->layers[i].name, name) == 0)
            return layers->layers[i].data;
    return NULL;
}

/* "R, diffuse.multiple, depth": each layer once, cut where it gets long. */
static void list_layers(const struct pell_layers *layers, struct pell_text *text)
{
    char last[256] = "", name[256] = "";

    for (size_t i = 0; i < layers->count && text->length < sizeof(text->str) - 100; i++) {
        const char *full = layers->layers[i].name, *dot = strrchr(full, '.');
        char shown[128];
        snprintf(name, sizeof(name), "%.*s", dot ? (int) (dot - full) : 200, full);
        if (strcmp(name, last) == 0)
            continue;
        pell_text_add(text, "%s%s", text->length ? ", " : "", pell_printable(name, shown, sizeof(shown)));
        memcpy(last, name, sizeof(last));
    }
}

static bool find_layer(const struct source *s, const char *layer, const float *rgb[3])
{
    static const char *const sets[][3] = { { "R", "G", "B" }, { "r", "g", "b" }, { "X", "Y", "Z" },
                                           { "Y", "Y", "Y" }, { "Z", "Z", "Z" }, { "", "", "" } };

    for (size_t i = 0; i < PELL_COUNT(sets); i++) {
        for (int c = 0; c < 3; c++)
            rgb[c] = find_channel(&s->layers, layer, sets[i][c]);
        if (rgb[0] && rgb[1] && rgb[2])
            return true;
    }
    return false;
}

static bool has_subsurface(const struct source *s)
{
    const float *rgb[3];
    return find_layer(s, "diffuse.multiple", rgb) || find_layer(s, "diffuse.single", rgb);
}

/* Light that went through a material: scattered once, many times, or from behind; of pixels where `where` (NULL: everywhere) is. */
static enum pell_result add_subsurface(struct cli *cli, struct source *s, const float *where)
{
    const size_t all = (size_t) s->width * (size_t) s->height;

    s->planes = pell_calloc(cli->ctx, all, 3 * sizeof(float));
    if (!s->planes)
        return PELL_ERR_NOMEM;
    for (size_t k = 0; k < PELL_COUNT(cli_subsurface_layers); k++) {
        const float *rgb[3];
        if (!find_layer(s, cli_subsurface_layers[k], rgb))
            continue;
        for (size_t c = 0; c < 3; c++)
            for (size_t i = 0; i < all; i++)
                s->planes[c * all + i] += !where || where[i] > 0.5f ? rgb[c][i] : 0.0f;
    }
    if (!find_layer(s, "", s->full))
        s->full[0] = s->full[1] = s->full[2] = NULL;
    for (size_t c = 0; c < 3; c++)
        s->rgb[c] = s->planes + c * all;
    return PELL_OK;
}

/* `where`: the reference's translucent pixels, or NULL. */
static enum pell_result choose_layer(struct cli *cli, const struct task *t, struct source *s)
{
    const bool beauty = strcmp(t->layer, "R,G,B") == 0;
    struct pell_text names = { .length = 0 };

    if (s->rgb[0])
        return PELL_OK; /* no EXR: there is nothing to choose */
    if (strcmp(t->layer, SUBSURFACE) == 0 && has_subsurface(s))
        return add_subsurface(cli, s, t->reference.translucent);
    if (find_layer(s, beauty ? "" : t->layer, s->rgb))
        return PELL_OK;
    list_layers(&s->layers, &names);
    return pell_error(cli->ctx, PELL_ERR_INVALID, s->path, "name one with --layer", "there is no layer %s; there are %s",
                      beauty ? "R, G, B" : t->layer, names.str);
}

/* What the command line says; else the subsurface light where both pictures tell it apart. */
static void name_layer(const struct cli *cli, struct task *t)
{
    const char *asked = cli->compare.layer;
    const bool apart =
        t->test.layers.count > 0 && t->reference.layers.count > 0 && has_subsurface(&t->test) && has_subsurface(&t->reference);

    snprintf(t->layer, sizeof(t->layer), "%s", asked && asked[0] ? asked : apart ? SUBSURFACE : "R,G,B");
}

/* --- Reading ------------------------------------------------------------------------------------------------------------------ */

/* The channels of a picture that is no EXR, one after the other; grey is one plane, three times. */
static enum pell_result spread(struct cli *cli, struct source *s, const struct pell_image *image)
{
    const size_t all = (size_t) image->width * (size_t) image->height, channels = (size_t) image->channels;
    const float *in = image->pixels;

    s->planes = pell_alloc_array(cli->ctx, all, channels * sizeof(float));
    if (!s->planes)
        return PELL_ERR_NOMEM;
    for (size_t c = 0; c < channels; c++)
        for (size_t i = 0; i < all; i++)
            s->planes[c * all + i] = in[i * channels + c];
    for (size_t c = 0; c < 3; c++)
        s->rgb[c] = s->planes + (channels > 2 ? c : 0) * all;
    s->alpha = channels % 2 == 0 ? s->planes + (channels - 1) * all : NULL;
    s->width = image->width;
    s->height = image->height;
    return PELL_OK;
}

static void find_masks(struct source *s)
{
    s->width = s->layers.width;
    s->height = s->layers.height;
    s->alpha = find_channel(&s->layers, "", "A");
    s->translucent = find_channel(&s->layers, "translucent", "Y");
    for (int c = 0; c < 3; c++)
        s->variance[c] = find_channel(&s->layers, "variance", (const char *[]) { "R", "G", "B" }[c]);
}

/* A mask has no layers to choose from. */
static enum pell_result read_source(struct cli *cli, const char *path, bool is_mask, struct source *s)
{
    static const uint8_t exr[4] = { 0x76, 0x2f, 0x31, 0x01 };
    struct pell_image image = { 0 };
    uint8_t *data = NULL;
    size_t size;
    enum pell_result res;

    s->path = path;
    PELL_TRY(pell_file_read(cli->ctx, path, &data, &size));
    if (!is_mask && size >= 4 && memcmp(data, exr, 4) == 0) {
        PELL_TRY(pell_exr_decode_layers(cli->ctx, &(struct pell_source) { path, data, size, PELL_ROLE_RAW }, &s->layers));
        find_masks(s);
        goto fail;
    }
    if (!is_mask && cli->compare.layer) {
        res = pell_error(cli->ctx, PELL_ERR_INVALID, path, NULL, "only OpenEXR files have layers: --layer can't be found in it");
        goto fail;
    }
    PELL_TRY(pell_image_decode(cli->ctx, path, data, size, is_mask ? PELL_ROLE_DATA : PELL_ROLE_RAW, &image));
    pell_free(cli->ctx, data); /* large images need the memory for their planes */
    data = NULL;
    s->display = image.type != PELL_PIXEL_F32;
    PELL_TRY(pell_image_to_float(cli->ctx, &image));
    res = spread(cli, s, &image);
fail:
    pell_image_finish(cli->ctx, &image);
    pell_free(cli->ctx, data);
    return res;
}

static enum pell_result same_size(struct cli *cli, const struct source *a, const struct source *reference)
{
    if (a->width == reference->width && a->height == reference->height)
        return PELL_OK;
    return pell_error(cli->ctx, PELL_ERR_INVALID, a->path, "render both at one size", "is %d x %d pixels, but %s is %d x %d", a->width,
                      a->height, reference->path, reference->width, reference->height);
}

static enum pell_result make_mask(struct cli *cli, struct task *t)
{
    const struct source *r = &t->reference;
    const char *asked = cli->compare.mask;
    const float *from = NULL;
    enum pell_result res;

    if (asked && strcmp(asked, "none") == 0)
        return PELL_OK;
    if (!asked || strcmp(asked, "alpha") == 0 || strcmp(asked, "translucent") == 0) {
        const bool translucent = asked ? asked[0] == 't' : r->translucent != NULL;
        from = translucent ? r->translucent : r->alpha;
        snprintf(t->mask_name, sizeof(t->mask_name), "%s", translucent ? "translucent" : "alpha");
        if (asked && !from)
            return pell_error(cli->ctx, PELL_ERR_INVALID, r->path, NULL, "has no %s: --mask %s can't be made of it",
                              translucent ? "layer translucent" : "alpha channel", asked);
    } else {
        if ((res = read_source(cli, asked, true, &t->mask_file)) != PELL_OK || (res = same_size(cli, &t->mask_file, r)) != PELL_OK)
            return res;
        from = t->mask_file.rgb[0];
        snprintf(t->mask_name, sizeof(t->mask_name), "%s", asked);
    }
    if (!from) {
        t->mask_name[0] = '\0';
        return PELL_OK;
    }
    t->mask = pell_alloc_array(cli->ctx, (size_t) r->width * (size_t) r->height, sizeof(float));
    if (!t->mask)
        return PELL_ERR_NOMEM;
    memcpy(t->mask, from, (size_t) r->width * (size_t) r->height * sizeof(float));
    return PELL_OK;
}

static enum pell_result read_all(struct cli *cli, struct task *t)
{
    enum pell_result res;

    PELL_TRY(read_source(cli, cli->arguments[0], false, &t->test));
    PELL_TRY(read_source(cli, cli->arguments[1], false, &t->reference));
    PELL_TRY(same_size(cli, &t->test, &t->reference));
    if (t->test.display != t->reference.display)
        return pell_error(cli->ctx, PELL_ERR_INVALID, t->test.path, "compare two EXR files, or two PNG files", "is %s, but %s is %s",
                          t->test.display ? "what a display shows" : "linear light", t->reference.path,
                          t->reference.display ? "what a display shows" : "linear light");
    if (cli->compare.half) {
        PELL_TRY(read_source(cli, cli->compare.half, false, &t->half));
        PELL_TRY(same_size(cli, &t->half, &t->reference));
        if (t->half.display)
            return pell_error(cli->ctx, PELL_ERR_INVALID, t->half.path, NULL, "half of a reference must be linear light, not 8 or 16 bit");
    }
    name_layer(cli, t);
    PELL_TRY(choose_layer(cli, t, &t->test));
    PELL_TRY(choose_layer(cli, t, &t->reference));
    if (t->half.path)
        PELL_TRY(choose_layer(cli, t, &t->half));
    PELL_TRY(make_mask(cli, t));
fail:
    return res;
}

/* --- Comparing ---------------------------------------------------------------------------------------------------------------- */

/* A method's standard error is of the light that it made: that is in these layers. */
static bool knows_standard_error(const struct task *t, const struct source *s)
{
    return s->variance[0] && s->variance[1] && s->variance[2] &&
           (strcmp(t->layer, SUBSURFACE) == 0 || strcmp(t->layer, "R,G,B") == 0 || strcmp(t->layer, "diffuse.multiple") == 0);
}

static bool knows_noise(const struct task *t)
{
    return t->half.path || knows_standard_error(t, &t->reference);
}

static enum pell_result join_variances(struct cli *cli, struct task *t)
{
    const size_t all = (size_t) t->reference.width * (size_t) t->reference.height;

    if (!t->half.path || !knows_standard_error(t, &t->reference) || !knows_standard_error(t, &t->half))
        return PELL_OK;
    t->variance = pell_alloc_array(cli->ctx, all, 3 * sizeof(float));
    if (!t->variance)
        return PELL_ERR_NOMEM;
    for (size_t c = 0; c < 3; c++)
        for (size_t i = 0; i < all; i++)
            t->variance[c * all + i] = 0.25f * t->reference.variance[c][i] + 0.25f * t->half.variance[c][i];
    return PELL_OK;
}

static bool two_pictures(const struct task *t)
{
    return t->test.full[0] && t->reference.full[0] && (!t->half.path || t->half.full[0]);
}

static struct pell_compare_input input_of(const struct task *t, bool whole)
{
    const bool full = whole && two_pictures(t);
    struct pell_compare_input in = { .width = t->reference.width,
                                     .height = t->reference.height,
                                     .stride = t->reference.width,
                                     .mask = t->mask,
                                     .display = t->test.display };

    for (int c = 0; c < 3; c++) {
        in.test[c] = full ? t->test.full[c] : t->test.rgb[c];
        in.reference[c] = full ? t->reference.full[c] : t->reference.rgb[c];
        in.half[c] = full ? t->half.full[c] : t->half.rgb[c];
        if (t->half.path)
            in.variance[c] = t->variance ? t->variance + (size_t) c * (size_t) in.width * (size_t) in.height : NULL;
        else
            in.variance[c] = knows_standard_error(t, &t->reference) ? t->reference.variance[c] : NULL;
        in.test_variance[c] = knows_standard_error(t, &t->test) ? t->test.variance[c] : NULL;
    }
    return in;
}

/* The command line's, else the exposure that the reference was rendered with, so that what is judged is what its PNG shows. */
static void take_exposure(struct task *t)
{
    const struct pell_layers *l = &t->reference.layers;
    double exposure;

    for (size_t i = 0; i < l->num_attributes && !(t->params.exposure > 0.0f); i++)
        if (strcmp(l->attributes[i].name, "pellucid.exposure") == 0 &&
            pell_parse_number(l->attributes[i].value, strlen(l->attributes[i].value), &exposure) && exposure > 0.0 && exposure <= 1e12)
            t->params.exposure = (float) exposure;
}

static enum pell_result compare(struct cli *cli, struct task *t)
{
    struct pell_compare_input in;
    enum pell_result res;

    PELL_TRY(join_variances(cli, t));
    in = input_of(t, false);
    take_exposure(t);
    PELL_TRY(compare_run(cli, t->test.path, t->reference.path, &in, &t->params, &t->result));
    if (t->result.masked.pixels == 0)
        return pell_error(cli->ctx, PELL_ERR_INVALID, t->reference.path, "the whole picture is compared with --mask none",
                          "no pixel is in the mask (%s above 0.5)", t->mask_name);
    if (two_pictures(t)) {
        in = input_of(t, true);
        PELL_TRY(compare_run(cli, t->test.path, t->reference.path, &in, &t->params, &t->whole));
    }
fail:
    cli_progress_end(cli);
    return res;
}

static const struct pell_metrics *whole_of(const struct task *t)
{
    return two_pictures(t) ? &t->whole.whole : &t->result.whole;
}

/* --- The answer --------------------------------------------------------------------------------------------------------------- */

static json_t *answer_json(struct cli *cli, const struct task *t)
{
    const struct pell_comparison *r = &t->result;
    const bool display = t->test.display, noise = knows_noise(t);
    json_t *method = compare_metrics(&r->masked, display), *reference, *o;

    json_object_set_new(method, "name", cli_text(t->test.path));
    json_object_set_new(method, "against", json_string("reference"));
    json_object_set_new(method, "bad_pixels", json_integer(r->bad_test));
    json_object_set_new(method, "whole", compare_metrics(whole_of(t), display));
    reference = json_pack("{s:o,s:o,s:I}", "name", cli_text(t->reference.path), "rel_noise",
                          noise ? compare_number(sqrt(r->masked.noise_rel_mse)) : json_null(), "bad_pixels", (json_int_t) r->bad_reference);
    o = json_pack("{s:o,s:[o],s:i,s:i,s:o,s:o,s:f,s:f,s:f,s:O}", "reference", reference, "methods", method, "width", r->width, "height",
                  r->height, "layer", cli_text(t->layer), "mask", t->mask ? cli_text(t->mask_name) : json_null(), "ppd",
                  (double) t->params.ppd, "floor", (double) t->params.floor, "seconds", r->seconds + t->whole.seconds, "warnings",
                  cli->warnings);
    if (o)
        compare_add_shown(o, r, display);
    if (o && cli->output)
        json_object_set_new(o, "output", cli_text(cli->output));
    return o;
}

static void row(const char *name, bool both, double masked, double whole)
{
    char a[24] = "-", b[24] = "-";

    if (isfinite(masked))
        snprintf(a, sizeof(a), "%.6g", masked);
    if (isfinite(whole))
        snprintf(b, sizeof(b), "%.6g", whole);
    if (both)
        printf("%-18s %12s %12s\n", name, a, b);
    else
        printf("%-18s %12s\n", name, b);
}

static double resolved(double mse, double error)
{
    return pell_metric_resolved(mse, error) ? mse : (double) NAN;
}

/* The noise that was taken off, and what is left of it as standard errors; "+-" before what it is of. */
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
        printf("\nthe pictures %s (p %s %.3g)\n",
               m->agreement.p < COMPARE_LIKELY ? "differ by more than noise" : "agree within their noise",
               m->agreement.p < 1e-9 ? "<" : "=", m->agreement.p < 1e-9 ? 1e-9 : m->agreement.p);
    json_decref(numbers);
}

static void answer_text(const struct cli *cli, const struct task *t)
{
    const struct pell_comparison *r = &t->result;
    const struct pell_metrics *m = &r->masked, *w = whole_of(t);
    const bool both = t->mask != NULL || two_pictures(t);
    char a[256], b[256], shown[256];

    printf("%s%s%s against %s, %d x %d, %s\n\n", cli_style(cli, stdout, 1), pell_printable(t->test.path, a, sizeof(a)),
           cli_style(cli, stdout, 0), pell_printable(t->reference.path, b, sizeof(b)), r->width, r->height,
           pell_printable(t->layer, shown, sizeof(shown)));
    if (both)
        printf("%-18s %12s %12s\n", "", two_pictures(t) ? SUBSURFACE : "masked", "whole");
    row("pixels", both, (double) m->pixels, (double) w->pixels);
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
    if (!t->test.display)
        row("flip hdr", both, m->flip_hdr, w->flip_hdr);
    if (knows_noise(t))
        noise_rows(both, m, w);
    print_verdict(m);
    if (t->mask)
        printf("\nmask: %s\n", pell_printable(t->mask_name, shown, sizeof(shown)));
}

/* --- The folder --------------------------------------------------------------------------------------------------------------- */

/* The reference as it is compared with: the mean of its halves. */
static enum pell_result report_reference(struct cli *cli, struct report *report, const struct pell_compare_input *in, json_t **id)
{
    const size_t all = (size_t) in->width * (size_t) in->height;
    const float *mean[3];
    float *planes;
    enum pell_result res;

    if (!in->half[0])
        return report_image(report, in->reference, in->stride, id);
    planes = pell_alloc_array(cli->ctx, all, 3 * sizeof(float));
    if (!planes)
        return PELL_ERR_NOMEM;
    for (size_t c = 0; c < 3; c++) {
        for (size_t i = 0; i < all; i++)
            planes[c * all + i] = 0.5f * (in->reference[c][i] + in->half[c][i]);
        mean[c] = planes + c * all;
    }
    res = report_image(report, mean, in->stride, id);
    pell_free(cli->ctx, planes);
    return res;
}

static json_t *picture_json(const char *name, const char *role)
{
    return json_pack("{s:o,s:s,s:{},s:{},s:{}}", "name", cli_text(name), "role", role, "data", "flip", "metrics");
}

static enum pell_result write_report(struct cli *cli, const struct task *t, struct output_folder *f)
{
    const bool display = t->test.display, two = two_pictures(t), masked = two || t->mask;
    json_t *reference = picture_json(pell_path_name(t->reference.path), "reference"), *id = NULL;
    json_t *test = picture_json(pell_path_name(t->test.path), "method"), *views = json_array(), *data = NULL;
    struct report *report = NULL;
    const char *path = NULL;
    enum pell_result res;

    PELL_TRY(report_open(cli->ctx, t->reference.width, t->reference.height, &report));
    for (int whole = masked ? 0 : 1; whole < 2; whole++) {
        const bool again = whole && masked && !two; /* the same pixels, other means */
        struct pell_compare_input in = input_of(t, whole);
        const struct pell_comparison *r = whole && two ? &t->whole : &t->result;
        const char *view = whole ? "whole" : "part", *from = again ? "part" : view;

        if (whole)
            in.mask = NULL;
        json_array_append_new(views, report_view(report, view,
                                                 whole ? "Whole picture"
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
    data = json_pack("{s:s,s:o,s:s,s:O,s:[O,O],s:O,s:b,s:o}", "kind", "pictures", "title", cli_text(pell_path_name(t->test.path)),
                     "command", cli->command_line, "views", views, "pictures", reference, test, "warnings", cli->warnings, "display",
                     (int) display, "rel_noise", knows_noise(t) ? compare_number(sqrt(t->result.masked.noise_rel_mse)) : json_null());
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
    PELL_TRY(compare_write_maps(cli, &t->result, t->test.display, &f));
    PELL_TRY(compare_write_errors(cli, &t->result, &f, "errors.exr"));
    PELL_TRY(compare_write_json(cli, answer, &f));
    PELL_TRY(write_report(cli, t, &f));
    PELL_TRY(folder_commit(&f));
fail:
    folder_drop(&f);
    return res;
}

/* --- The command -------------------------------------------------------------------------------------------------------------- */

static void finish_source(struct cli *cli, struct source *s)
{
    pell_layers_finish(cli->ctx, &s->layers);
    pell_free(cli->ctx, s->planes);
}

enum exit_code compare_pictures(struct cli *cli)
{
    struct task t = { .mask = NULL };
    json_t *answer = NULL;
    enum exit_code code = cli_failed(cli, compare_params(cli, &t.params));

    if (code == EXIT_OK)
        code = cli_failed(cli, read_all(cli, &t));
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
    pell_free(cli->ctx, t.mask);
    pell_free(cli->ctx, t.variance);
    finish_source(cli, &t.test);
    finish_source(cli, &t.reference);
    finish_source(cli, &t.half);
    finish_source(cli, &t.mask_file);
    return code;
}
