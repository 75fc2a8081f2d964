/* SPDX-License-Identifier: MIT
 * answer.c - results of a comparison: as JSON, as maps, as an image of 32-bit errors. */
#include "cli/compare/compare.h"

#include "base/file.h"
#include "compare/rows.h"
#include "image/color.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define RELATIVE_RANGE 0.5f /* relative error at the ends of the map's colours */

enum { COLORS = 1024 };

enum pell_result compare_params(struct cli *cli, struct pell_compare_params *params)
{
    enum pell_result res = PELL_OK;

    pell_knobs_default(pell_compare_knobs(), params);
    params->threads = cli->numbers.threads;
    for (size_t i = 0; res == PELL_OK && i < cli->settings.count; i++) {
        const struct pell_setting *s = &cli->settings.items[i];
        if (pell_knob_find(pell_compare_knobs(), s->name))
            res = pell_knob_set(cli->ctx, pell_compare_knobs(), "compare", s->where, params, s->name, s->value);
    }
    return res;
}

enum pell_result compare_run(struct cli *cli, const char *test, const char *reference, const struct pell_compare_input *input,
                             const struct pell_compare_rows *rows, const struct pell_compare_params *params, struct pell_comparison *out)
{
    struct pell_compare_input in = *input;
    enum pell_result res;

    in.figures_only |= !cli->output; /* maps are not needed */
    res = pell_compare_by_rows(cli->ctx, &in, rows, params, out);
    if (res != PELL_OK)
        return res;
    if (out->bad_test > 0)
        pell_warn(cli->ctx, test, NULL, "%s not finite: left out of all numbers",
                  pell_counted(out->bad_test, "pixel is", "pixels are").str);
    if (out->bad_reference > 0)
        pell_warn(cli->ctx, reference, NULL, "of the reference %s not finite or of a negative variance: excluded from all numbers",
                  pell_counted(out->bad_reference, "pixel is", "pixels are").str);
    if (out->whole.pixels == 0)
        res = out->bad_variance > 0 && out->bad_test == 0 && out->bad_variance == out->bad_reference
                  ? pell_error(cli->ctx, PELL_ERR_INVALID, reference, "compare a layer without it: --layer NAME",
                               "its layer variance is negative or not finite in every pixel")
                  : pell_error(cli->ctx, PELL_ERR_INVALID, test, NULL, "no pixel of both images is finite%s",
                               out->bad_variance > 0 ? " and has a variance that is" : "");
    return res;
}

/* --- JSON --------------------------------------------------------------------------------------------------------------------- */

static json_t *mse_json(double mse, double error)
{
    return pell_metric_resolved(mse, error) ? cli_number(mse) : json_null();
}

/* The metrics that noise hides, with their estimates: null where nothing is hidden. */
static json_t *not_resolved(const struct pell_metrics *m)
{
    const double least = sqrt(PELL_RESOLVED * m->rel_mse_error);
    const bool mse = pell_metric_resolved(m->mse, m->mse_error), rel_mse = pell_metric_resolved(m->rel_mse, m->rel_mse_error);
    char reason[160];
    json_t *o;

    if (mse && rel_mse)
        return json_null();
    if (rel_mse)
        snprintf(reason, sizeof(reason), "noise exceeds the mse; 4 times the samples halve its root");
    else
        snprintf(reason, sizeof(reason), "noise %.2g %% exceeds the error; 4 times the samples resolve errors over %.2g %%", 100.0 * least,
                 50.0 * least);
    o = json_pack("{s:s,s:o}", "reason", reason, "least_error", cli_number(least));
    if (!mse)
        json_object_set_new(o, "mse", cli_number(m->mse));
    if (!rel_mse)
        json_object_set_new(o, "rel_mse", cli_number(m->rel_mse));
    return o;
}

const char *compare_unresolved(const json_t *metrics)
{
    const json_t *o = json_object_get(metrics, "not_resolved");

    return json_object_get(o, "rel_mse") ? json_string_value(json_object_get(o, "reason")) : NULL;
}

static json_t *agreement_json(const struct pell_agreement *a)
{
    if (!isfinite(a->p))
        return json_null();
    return json_pack("{s:b,s:f,s:o,s:I,s:I}", "agrees", (int) (a->p >= COMPARE_LIKELY), "p", a->p, "beyond_3", cli_number(a->beyond_3),
                     "pixels", (json_int_t) a->pixels, "blocks", (json_int_t) a->blocks);
}

json_t *compare_metrics(const struct pell_metrics *m, bool display)
{
    json_t *o =
        json_pack("{s:I,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o}", "pixels", (json_int_t) m->pixels, "mse",
                  mse_json(m->mse, m->mse_error), "rel_mse", mse_json(m->rel_mse, m->rel_mse_error), "mae", cli_number(m->mae), "bias",
                  cli_numbers(m->bias, 3), "rel_bias", cli_numbers(m->rel_bias, 3), "ssim", cli_number(m->ssim), "ssim_rgb",
                  cli_numbers(m->ssim_rgb, 3), "flip", cli_number(m->flip), "flip_hdr", display ? json_null() : cli_number(m->flip_hdr),
                  "noise_mse", cli_number(m->noise_mse), "noise_rel_mse", cli_number(m->noise_rel_mse));
    json_t *noise =
        json_pack("{s:o,s:o,s:o,s:o,s:o,s:o}", "mse_error", cli_number(m->mse_error), "rel_mse_error", cli_number(m->rel_mse_error),
                  "bias_error", cli_numbers(m->bias_error, 3), "rel_bias_error", cli_numbers(m->rel_bias_error, 3), "not_resolved",
                  not_resolved(m), "agreement", agreement_json(&m->agreement));

    json_object_update(o, noise);
    json_decref(noise);
    return o;
}

json_t *compare_part(const struct pell_metrics *m)
{
    return json_pack("{s:o,s:o,s:o,s:o}", "rel_mse", mse_json(m->rel_mse, m->rel_mse_error), "rel_bias", cli_numbers(m->rel_bias, 3),
                     "rel_mse_error", cli_number(m->rel_mse_error), "rel_bias_error", cli_numbers(m->rel_bias_error, 3));
}

void compare_add_metrics(json_t *to, const struct pell_metrics *m, bool display)
{
    json_t *numbers = compare_metrics(m, display);

    json_object_update(to, numbers);
    json_decref(numbers);
}

void compare_add_shown(json_t *to, const struct pell_comparison *r, bool display)
{
    json_object_set_new(to, "exposure", cli_number((double) r->exposure));
    json_object_set_new(to, "white", cli_number((double) r->white));
    json_object_set_new(to, "hdr_exposures",
                        display ? json_null()
                                : json_pack("{s:f,s:f,s:i,s:b}", "start", r->hdr_start, "stop", r->hdr_stop, "count", r->hdr_exposures,
                                            "median_above_black", (int) r->hdr_above_black));
}

enum pell_result compare_write_json(struct cli *cli, const json_t *answer, struct output_folder *f)
{
    char *text = json_dumps(answer, JSON_INDENT(2) | JSON_REAL_PRECISION(9));
    const char *path = folder_file(f, "metrics.json");
    enum pell_result res = !text ? PELL_ERR_NOMEM : !path ? PELL_ERR_INVALID : pell_file_write(cli->ctx, path, text, strlen(text));

    free(text);
    return res;
}

/* --- Maps --------------------------------------------------------------------------------------------------------------------- */

static enum pell_result write_map(struct cli *cli, const struct pell_comparison *r, struct output_folder *f, const char *name,
                                  const float *map, float low, float high, void (*color)(float, float *))
{
    const size_t pixels = (size_t) r->width * (size_t) r->height;
    const char *path = folder_file(f, name);
    float table[COLORS][3], *planes = pell_alloc_array(cli->ctx, pixels, 3 * sizeof(float));
    struct pell_channel channels[3];
    enum pell_result res;

    if (!planes || !path) {
        pell_free(cli->ctx, planes);
        return path ? PELL_ERR_NOMEM : PELL_ERR_INVALID;
    }
    for (int i = 0; i < COLORS; i++) {
        const float u = (float) i / (COLORS - 1), at = low < 0.0f ? 2.0f * u - 1.0f : u;
        color(at, table[i]);
        for (int c = 0; c < 3; c++)
            table[i][c] = pell_srgb_decode(table[i][c]); /* PNG encodes it */
    }
    for (size_t i = 0; i < pixels; i++) {
        const float u = (map[i] - low) / (high - low);
        const int k = (int) ((u > 0.0f ? u < 1.0f ? u : 1.0f : 0.0f) * (COLORS - 1) + 0.5f);
        for (size_t c = 0; c < 3; c++)
            planes[c * pixels + i] = table[k][c];
    }
    for (int c = 0; c < 3; c++)
        channels[c] = (struct pell_channel) { (const char *[]) { "R", "G", "B" }[c], planes + (size_t) c * pixels, r->width, false };
    res = pell_image_write(cli->ctx, path, NULL,
                           &(struct pell_write_params) { .width = r->width, .height = r->height, .channels = channels, .num_channels = 3 });
    pell_free(cli->ctx, planes);
    return res;
}

enum pell_result compare_write_maps(struct cli *cli, const struct pell_comparison *r, bool display, struct output_folder *f)
{
    enum pell_result res = write_map(cli, r, f, "relative.png", r->relative, -RELATIVE_RANGE, RELATIVE_RANGE, pell_color_diverging);

    if (res == PELL_OK)
        res = write_map(cli, r, f, "flip.png", r->flip, 0.0f, 1.0f, pell_color_magma);
    if (res == PELL_OK && !display)
        res = write_map(cli, r, f, "flip_hdr.png", r->flip_hdr, 0.0f, 1.0f, pell_color_magma);
    return res;
}

enum pell_result compare_write_errors(struct cli *cli, const struct pell_comparison *r, struct output_folder *f, const char *name)
{
    const struct pell_channel channels[] = {
        { "flip.Y", r->flip, r->width, true },
        { "flip_hdr.Y", r->flip_hdr, r->width, true },
        { "relative.Y", r->relative, r->width, true },
        { "ssim.Y", r->ssim, r->width, true },
    };
    const struct pell_attribute attributes[] = { { "pellucid.version", pell_version_string() }, { "pellucid.command", cli->command_line } };
    const char *path = folder_file(f, name);

    if (!path)
        return PELL_ERR_INVALID;
    return pell_image_write(cli->ctx, path, NULL,
                            &(struct pell_write_params) { .width = r->width,
                                                          .height = r->height,
                                                          .channels = channels,
                                                          .num_channels = PELL_COUNT(channels),
                                                          .attributes = attributes,
                                                          .num_attributes = PELL_COUNT(attributes),
                                                          .compression = PELL_EXR_ZIP });
}
