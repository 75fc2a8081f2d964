/* SPDX-License-Identifier: MIT
 * cmd_compare.c - `pellucid compare`: how far a picture is from a reference, as numbers and as maps. */
#include "cli/cli.h"

#include "base/file.h"
#include "image/color.h"
#include "image/formats.h"

#include <pellucid/compare.h>

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define RELATIVE_RANGE 0.5f /* at the ends of the map's colours */

/* A picture of any format as planes, with the names of its layers. */
struct source {
    const char *path;
    int width, height;
    bool display;        /* integers: what a display shows */
    const float *rgb[3]; /* point into one of the following, three times the same for one channel */
    const float *alpha;  /* or NULL */
    struct pell_layers layers;
    float *planes; /* of a file that is no EXR */
    char layer[128];
};

struct task {
    struct source test, reference, half, mask_file;
    float *mask;
    char mask_name[4096];
    struct pell_compare_params params;
    struct pell_comparison result;
};

/* --- Reading ------------------------------------------------------------------------------------------------------------------ */

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

static enum pell_result choose_layer(struct cli *cli, struct source *s)
{
    static const char *const sets[][3] = { { "R", "G", "B" }, { "r", "g", "b" }, { "X", "Y", "Z" },
                                           { "Y", "Y", "Y" }, { "Z", "Z", "Z" }, { "", "", "" } };
    const char *layer = cli->compare.layer ? cli->compare.layer : "";
    struct pell_text names = { .length = 0 };

    snprintf(s->layer, sizeof(s->layer), "%s", layer[0] ? layer : "R,G,B");
    s->alpha = find_channel(&s->layers, "", "A");
    for (size_t i = 0; i < PELL_COUNT(sets); i++) {
        for (int c = 0; c < 3; c++)
            s->rgb[c] = find_channel(&s->layers, layer, sets[i][c]);
        if (s->rgb[0] && s->rgb[1] && s->rgb[2])
            return PELL_OK;
    }
    list_layers(&s->layers, &names);
    return pell_error(cli->ctx, PELL_ERR_INVALID, s->path, "name one with --layer", "there is no layer %s; there are %s",
                      layer[0] ? layer : "R, G, B", names.str);
}

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
    snprintf(s->layer, sizeof(s->layer), "R,G,B");
    return PELL_OK;
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
        PELL_TRY(pell_exr_decode_layers(cli->ctx, &(struct pell_source){ path, data, size, PELL_ROLE_RAW }, &s->layers));
        s->width = s->layers.width;
        s->height = s->layers.height;
        res = choose_layer(cli, s);
        goto fail;
    }
    if (!is_mask && cli->compare.layer) {
        res = pell_error(cli->ctx, PELL_ERR_INVALID, path, NULL, "only OpenEXR files have layers: --layer can't be found in it");
        goto fail;
    }
    PELL_TRY(pell_image_decode(cli->ctx, path, data, size, is_mask ? PELL_ROLE_DATA : PELL_ROLE_RAW, &image));
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
    if (!asked || strcmp(asked, "alpha") == 0) {
        from = r->alpha;
        if (asked && !from)
            return pell_error(cli->ctx, PELL_ERR_INVALID, r->path, NULL, "has no alpha channel: --mask alpha can't be made of it");
        snprintf(t->mask_name, sizeof(t->mask_name), "alpha");
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
    PELL_TRY(make_mask(cli, t));
fail:
    return res;
}

/* --- Maps --------------------------------------------------------------------------------------------------------------------- */

enum { COLORS = 1024 };

static enum pell_result write_map(struct cli *cli, const struct task *t, const char *folder, const char *name, const float *map, float low,
                                  float high, void (*color)(float, float *))
{
    const size_t all = (size_t) t->result.width * (size_t) t->result.height;
    float table[COLORS][3], *planes = pell_alloc_array(cli->ctx, all, 3 * sizeof(float));
    struct pell_channel channels[3];
    char path[4200];
    enum pell_result res;

    if (!planes)
        return PELL_ERR_NOMEM;
    for (int i = 0; i < COLORS; i++) {
        const float u = (float) i / (COLORS - 1), at = low < 0.0f ? 2.0f * u - 1.0f : u;
        color(at, table[i]);
        for (int c = 0; c < 3; c++)
            table[i][c] = pell_srgb_decode(table[i][c]); /* PNG encodes it */
    }
    for (size_t i = 0; i < all; i++) {
        const float u = (map[i] - low) / (high - low);
        const int k = (int) ((u > 0.0f ? u < 1.0f ? u : 1.0f : 0.0f) * (COLORS - 1) + 0.5f);
        for (size_t c = 0; c < 3; c++)
            planes[c * all + i] = table[k][c];
    }
    for (int c = 0; c < 3; c++)
        channels[c] = (struct pell_channel){ (const char *[]){ "R", "G", "B" }[c], planes + (size_t) c * all, t->result.width, false };
    snprintf(path, sizeof(path), "%s/%s", folder, name);
    res = pell_image_write(
        cli->ctx, path, NULL,
        &(struct pell_write_params){ .width = t->result.width, .height = t->result.height, .channels = channels, .num_channels = 3 });
    pell_free(cli->ctx, planes);
    return res;
}

static enum pell_result write_numbers(struct cli *cli, const struct task *t, const char *folder)
{
    const struct pell_comparison *r = &t->result;
    const struct pell_channel channels[] = {
        { "flip.Y", r->flip, r->width, true },
        { "flip_hdr.Y", r->flip_hdr, r->width, true },
        { "relative.Y", r->relative, r->width, true },
        { "ssim.Y", r->ssim, r->width, true },
    };
    const struct pell_attribute attributes[] = { { "pellucid.version", pell_version() }, { "pellucid.command", cli->command_line } };
    char path[4200];

    snprintf(path, sizeof(path), "%s/errors.exr", folder);
    return pell_image_write(cli->ctx, path, NULL,
                            &(struct pell_write_params){ .width = r->width,
                                                         .height = r->height,
                                                         .channels = channels,
                                                         .num_channels = PELL_COUNT(channels),
                                                         .attributes = attributes,
                                                         .num_attributes = PELL_COUNT(attributes),
                                                         .compression = PELL_EXR_ZIP });
}

/* The folder may be there. */
static enum pell_result make_folder(struct cli *cli, const char *folder)
{
    struct stat st;

    if (strlen(folder) > 4000)
        return pell_error(cli->ctx, PELL_ERR_INVALID, "--output", NULL, "a name of %zu bytes is too long", strlen(folder));
    if (mkdir(folder, 0777) == 0 || (errno == EEXIST && stat(folder, &st) == 0 && S_ISDIR(st.st_mode)))
        return PELL_OK;
    return pell_error(cli->ctx, PELL_ERR_IO, folder, "-o names a folder, which is made if the one around it is there",
                      errno == EEXIST ? "is there, and is no folder" : "can't be made");
}

static enum pell_result write_all(struct cli *cli, const struct task *t, const json_t *answer)
{
    const char *folder = cli->output;
    char path[4200], *text = json_dumps(answer, JSON_INDENT(2) | JSON_REAL_PRECISION(9));
    enum pell_result res = text ? PELL_OK : PELL_ERR_NOMEM;

    PELL_TRY(res);
    PELL_TRY(write_map(cli, t, folder, "relative.png", t->result.relative, -RELATIVE_RANGE, RELATIVE_RANGE, pell_color_diverging));
    PELL_TRY(write_map(cli, t, folder, "flip.png", t->result.flip, 0.0f, 1.0f, pell_color_magma));
    if (!t->test.display)
        PELL_TRY(write_map(cli, t, folder, "flip_hdr.png", t->result.flip_hdr, 0.0f, 1.0f, pell_color_magma));
    PELL_TRY(write_numbers(cli, t, folder));
    snprintf(path, sizeof(path), "%s/metrics.json", folder);
    PELL_TRY(pell_file_write(cli->ctx, path, text, strlen(text)));
fail:
    free(text);
    return res;
}

/* --- The answer --------------------------------------------------------------------------------------------------------------- */

static json_t *number(double v)
{
    return isfinite(v) ? json_real(v) : json_null();
}

static json_t *metrics_json(const struct task *t, const struct pell_metrics *m)
{
    return json_pack("{s:I,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o}", "pixels", (json_int_t) m->pixels, "mse", number(m->mse),
                     "rel_mse", number(m->rel_mse), "mae", number(m->mae), "bias", cli_numbers(m->bias, 3), "rel_bias",
                     cli_numbers(m->rel_bias, 3), "ssim", number(m->ssim), "ssim_rgb", cli_numbers(m->ssim_rgb, 3), "flip", number(m->flip),
                     "flip_hdr", t->test.display ? json_null() : number(m->flip_hdr), "noise_mse", number(m->noise_mse), "noise_rel_mse",
                     number(m->noise_rel_mse));
}

static json_t *answer_json(struct cli *cli, const struct task *t)
{
    const struct pell_comparison *r = &t->result;
    json_t *method = metrics_json(t, &r->masked), *reference, *hdr = json_null(), *o;

    json_object_set_new(method, "name", cli_text(t->test.path));
    json_object_set_new(method, "against", json_string("reference"));
    json_object_set_new(method, "bad_pixels", json_integer(r->bad_test));
    json_object_set_new(method, "whole", metrics_json(t, &r->whole));
    reference = json_pack("{s:o,s:o,s:I}", "name", cli_text(t->reference.path), "rel_noise",
                          t->half.path ? number(sqrt(r->masked.noise_rel_mse)) : json_null(), "bad_pixels", (json_int_t) r->bad_reference);
    if (!t->test.display)
        hdr = json_pack("{s:f,s:f,s:i,s:b}", "start", r->hdr_start, "stop", r->hdr_stop, "count", r->hdr_exposures, "median_above_black",
                        (int) r->hdr_above_black);
    o = json_pack("{s:o,s:[o],s:i,s:i,s:o,s:o,s:f,s:f,s:f,s:f,s:o,s:f,s:O}", "reference", reference, "methods", method, "width", r->width,
                  "height", r->height, "layer", cli_text(t->reference.layer), "mask", t->mask ? cli_text(t->mask_name) : json_null(), "ppd",
                  (double) t->params.ppd, "floor", (double) t->params.floor, "exposure", (double) r->exposure, "white", (double) r->white,
                  "hdr_exposures", hdr, "seconds", r->seconds, "warnings", cli->warnings);
    if (o && cli->output)
        json_object_set_new(o, "output", cli_text(cli->output));
    return o;
}

static void row(const char *name, bool both, double masked, double whole)
{
    char a[24] = "", b[24] = "-";

    if (isfinite(masked))
        snprintf(a, sizeof(a), "%.6g", masked);
    if (isfinite(whole))
        snprintf(b, sizeof(b), "%.6g", whole);
    if (both)
        printf("%-18s %12s %12s\n", name, a[0] ? a : "-", b);
    else
        printf("%-18s %12s\n", name, b);
}

static void answer_text(const struct cli *cli, const struct task *t)
{
    const struct pell_comparison *r = &t->result;
    const struct pell_metrics *m = &r->masked, *w = &r->whole;
    const bool both = t->mask != NULL;
    char a[256], b[256], mask[256];

    printf("%s%s%s against %s, %d x %d, %s\n\n", cli_style(cli, stdout, 1), pell_printable(t->test.path, a, sizeof(a)),
           cli_style(cli, stdout, 0), pell_printable(t->reference.path, b, sizeof(b)), r->width, r->height,
           pell_printable(t->reference.layer, mask, sizeof(mask)));
    if (both)
        printf("%-18s %12s %12s\n", "", "masked", "whole");
    row("pixels", both, (double) m->pixels, (double) w->pixels);
    row("mse", both, m->mse, w->mse);
    row("rel mse", both, m->rel_mse, w->rel_mse);
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
    if (t->half.path) {
        row("noise, mse", both, m->noise_mse, w->noise_mse);
        row("noise, rel mse", both, m->noise_rel_mse, w->noise_rel_mse);
    }
    if (both)
        printf("\nmask: %s\n", pell_printable(t->mask_name, mask, sizeof(mask)));
}

/* --- The command -------------------------------------------------------------------------------------------------------------- */

/* The command line's, else the exposure that the reference was rendered with, so that what is judged is what its PNG shows. */
static enum exit_code choose_params(struct cli *cli, struct task *t)
{
    enum pell_result res = PELL_OK;

    pell_knobs_default(pell_compare_knobs, &t->params);
    for (size_t i = 0; res == PELL_OK && i < cli->settings.count; i++)
        res = pell_knob_set(cli->ctx, pell_compare_knobs, "compare", cli->settings.items[i].where, &t->params, cli->settings.items[i].name,
                            cli->settings.items[i].value);
    return cli_failed(cli, res);
}

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
    struct pell_compare_input in = { .width = t->reference.width,
                                     .height = t->reference.height,
                                     .stride = t->reference.width,
                                     .mask = t->mask,
                                     .display = t->test.display };
    enum pell_result res;

    for (int c = 0; c < 3; c++) {
        in.test[c] = t->test.rgb[c];
        in.reference[c] = t->reference.rgb[c];
        in.half[c] = t->half.rgb[c];
    }
    take_exposure(t);
    res = pell_compare(cli->ctx, &in, &t->params, &t->result);
    cli_progress_end(cli);
    if (res != PELL_OK)
        return res;
    if (t->result.bad_test > 0)
        pell_warn(cli->ctx, t->test.path, NULL, "%lld pixels are not finite; they are left out of all numbers",
                  (long long) t->result.bad_test);
    if (t->result.bad_reference > 0)
        pell_warn(cli->ctx, t->reference.path, NULL, "%lld pixels of the reference are not finite; they are left out of all numbers",
                  (long long) t->result.bad_reference);
    if (t->result.whole.pixels == 0)
        return pell_error(cli->ctx, PELL_ERR_INVALID, t->test.path, NULL, "no pixel of both pictures is finite");
    if (t->result.masked.pixels == 0)
        return pell_error(cli->ctx, PELL_ERR_INVALID, t->reference.path, "the whole picture is compared with --mask none",
                          "no pixel is in the mask (%s above 0.5)", t->mask_name);
    return PELL_OK;
}

static void finish_source(struct cli *cli, struct source *s)
{
    pell_layers_finish(cli->ctx, &s->layers);
    pell_free(cli->ctx, s->planes);
}

enum exit_code command_compare(struct cli *cli)
{
    struct task t = { .mask = NULL };
    json_t *answer = NULL;
    enum exit_code code;

    if (cli->compare.methods || cli->num_arguments < 2)
        return cli_usage(cli, cli->compare.methods ? "--methods" : "compare", "render each, then give two pictures: A and its reference B",
                         "methods on one scene can't be compared in one go yet");
    code = choose_params(cli, &t);
    if (code == EXIT_OK)
        code = cli_failed(cli, read_all(cli, &t));
    if (code == EXIT_OK)
        code = cli_failed(cli, compare(cli, &t));
    if (code == EXIT_OK && !(answer = answer_json(cli, &t)))
        code = EXIT_MEMORY;
    if (code == EXIT_OK && cli->output)
        code = cli_failed(cli, make_folder(cli, cli->output));
    if (code == EXIT_OK && cli->output)
        code = cli_failed(cli, write_all(cli, &t, answer));
    if (code == EXIT_OK && cli->json)
        code = cli_print_json(cli, json_incref(answer));
    else if (code == EXIT_OK)
        answer_text(cli, &t);
    json_decref(answer);
    pell_comparison_finish(cli->ctx, &t.result);
    pell_free(cli->ctx, t.mask);
    finish_source(cli, &t.test);
    finish_source(cli, &t.reference);
    finish_source(cli, &t.half);
    finish_source(cli, &t.mask_file);
    return code;
}
