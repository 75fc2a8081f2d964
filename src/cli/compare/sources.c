/* SPDX-License-Identifier: MIT
 * sources.c - see sources.h. */
#include "cli/compare/sources.h"

#include <stdlib.h>
#include <string.h>

/* --- Layers ------------------------------------------------------------------------------------------------------------------- */

static int find_channel(const struct source *s, const char *layer, const char *channel)
{
    const struct pell_layers *layers = &s->rows->layers;
    char name[256];

    snprintf(name, sizeof(name), "%s%s%s", layer, layer[0] && channel[0] ? "." : "", channel);
    for (size_t i = 0; i < layers->count; i++)
        if (strcmp(layers->layers[i].name, name) == 0)
            return (int) i;
    return -1;
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

/* Finds a layer; rgb is -1 if it is missing. */
static bool find_layer(const struct source *s, const char *layer, int rgb[3])
{
    static const char *const sets[][3] = { { "R", "G", "B" }, { "r", "g", "b" }, { "X", "Y", "Z" },
                                           { "Y", "Y", "Y" }, { "Z", "Z", "Z" }, { "", "", "" } };

    for (size_t i = 0; i < PELL_COUNT(sets); i++) {
        for (int c = 0; c < 3; c++)
            rgb[c] = find_channel(s, layer, sets[i][c]);
        if (rgb[0] >= 0 && rgb[1] >= 0 && rgb[2] >= 0)
            return true;
    }
    rgb[0] = rgb[1] = rgb[2] = -1;
    return false;
}

static bool has_subsurface(const struct source *s)
{
    int rgb[3];
    return find_layer(s, "diffuse.multiple", rgb) || find_layer(s, "diffuse.single", rgb);
}

static bool is_subsurface(const struct sources *s)
{
    return strcmp(s->layer, SUBSURFACE) == 0;
}

static enum pell_result choose_layer(const struct sources *all, struct source *s)
{
    const bool beauty = strcmp(all->layer, "R,G,B") == 0;
    struct pell_text names = { .length = 0 };

    if (!s->rows->layered || beauty) {
        if (find_layer(s, "", s->rgb))
            return PELL_OK;
    } else if (is_subsurface(all) && has_subsurface(s)) {
        for (int k = 0; k < SUBSURFACE_LAYERS; k++)
            find_layer(s, cli_subsurface_layers[k], s->light[k]);
        find_layer(s, "", s->full);
        return PELL_OK;
    } else if (find_layer(s, all->layer, s->rgb)) {
        return PELL_OK;
    }
    list_layers(&s->rows->layers, &names);
    return pell_error(all->cli->ctx, PELL_ERR_INVALID, s->path, "name one with --layer", "there is no layer %s; there are %s",
                      beauty ? "R, G, B" : all->layer, names.str);
}

/* Names the compared layer: the command line's; else the subsurface light if both images have it separately. */
static void name_layer(struct sources *s)
{
    const char *asked = s->cli->compare.layer;
    const bool separate = s->test.rows->layered && s->reference.rows->layered && has_subsurface(&s->test) && has_subsurface(&s->reference);

    snprintf(s->layer, sizeof(s->layer), "%s", asked && asked[0] ? asked : separate ? SUBSURFACE : "R,G,B");
}

/* --- Opening ------------------------------------------------------------------------------------------------------------------ */

static enum pell_result open_source(struct cli *cli, const char *path, struct source *s)
{
    enum pell_result res;

    s->path = path;
    PELL_TRY(pell_rows_open(cli->ctx, path, &s->rows));
    if (!s->rows->layered && cli->compare.layer)
        return pell_error(cli->ctx, PELL_ERR_INVALID, path, NULL, "only OpenEXR files have layers: --layer can't be found in it");
    s->width = s->rows->layers.width;
    s->height = s->rows->layers.height;
    s->display = s->rows->display;
    s->alpha = find_channel(s, "", "A");
    s->translucent = s->rows->layered ? find_channel(s, "translucent", "Y") : -1;
    for (int c = 0; c < 3; c++) {
        s->variance[c] = s->rows->layered ? find_channel(s, "variance", (const char *[]) { "R", "G", "B" }[c]) : -1;
        s->rgb[c] = s->full[c] = -1;
        for (int k = 0; k < SUBSURFACE_LAYERS; k++)
            s->light[k][c] = -1;
    }
    if (!(s->planes = pell_calloc(cli->ctx, s->rows->layers.count, sizeof(*s->planes))))
        res = PELL_ERR_NOMEM;
fail:
    return res;
}

static enum pell_result same_size(struct cli *cli, const char *path, int width, int height, const struct source *reference)
{
    if (width == reference->width && height == reference->height)
        return PELL_OK;
    return pell_error(cli->ctx, PELL_ERR_INVALID, path, "render both at one size", "is %d x %d pixels, but %s is %d x %d", width, height,
                      reference->path, reference->width, reference->height);
}

/* Reads the first channel of an image, all of its rows. */
static enum pell_result read_mask(struct sources *s, const char *path)
{
    struct pell_context *ctx = s->cli->ctx;
    struct pell_image image = { 0 };
    enum pell_result res;
    size_t all;

    PELL_TRY(pell_image_read(ctx, path, PELL_ROLE_DATA, &image));
    PELL_TRY(same_size(s->cli, path, image.width, image.height, &s->reference));
    PELL_TRY(pell_image_to_float(ctx, &image));
    all = (size_t) image.width * (size_t) image.height;
    if (!(s->mask = pell_alloc_array(ctx, all, sizeof(float)))) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    for (size_t i = 0; i < all; i++)
        s->mask[i] = ((const float *) image.pixels)[i * (size_t) image.channels];
fail:
    pell_image_finish(ctx, &image);
    return res;
}

static enum pell_result choose_mask(struct sources *s)
{
    struct source *r = &s->reference;
    const char *asked = s->cli->compare.mask;
    const bool of_layer = !asked || strcmp(asked, "alpha") == 0 || strcmp(asked, "translucent") == 0;
    const bool translucent = asked ? asked[0] == 't' : r->translucent >= 0;

    if (asked && strcmp(asked, "none") == 0)
        return PELL_OK;
    if (!of_layer) {
        snprintf(s->mask_name, sizeof(s->mask_name), "%s", asked);
        return read_mask(s, asked);
    }
    if ((translucent ? r->translucent : r->alpha) >= 0)
        snprintf(s->mask_name, sizeof(s->mask_name), "%s", translucent ? "translucent" : "alpha");
    else if (asked)
        return pell_error(s->cli->ctx, PELL_ERR_INVALID, r->path, NULL, "has no %s: --mask %s can't be made of it",
                          translucent ? "layer translucent" : "alpha channel", asked);
    return PELL_OK;
}

enum pell_result sources_open(struct cli *cli, struct sources *s)
{
    const char *test = cli->arguments[0], *reference = cli->arguments[1];
    enum pell_result res;

    s->cli = cli;
    PELL_TRY(open_source(cli, test, &s->test));
    PELL_TRY(open_source(cli, reference, &s->reference));
    PELL_TRY(same_size(cli, test, s->test.width, s->test.height, &s->reference));
    if (s->test.display != s->reference.display)
        return pell_error(cli->ctx, PELL_ERR_INVALID, test, "compare two EXR files, or two PNG files", "is %s, but %s is %s",
                          s->test.display ? "what a display shows" : "linear light", reference,
                          s->reference.display ? "what a display shows" : "linear light");
    if (cli->compare.half) {
        PELL_TRY(open_source(cli, cli->compare.half, &s->half));
        PELL_TRY(same_size(cli, s->half.path, s->half.width, s->half.height, &s->reference));
        if (s->half.display)
            return pell_error(cli->ctx, PELL_ERR_INVALID, s->half.path, NULL, "half of a reference must be linear light, not 8 or 16 bit");
    }
    name_layer(s);
    PELL_TRY(choose_layer(s, &s->test));
    PELL_TRY(choose_layer(s, &s->reference));
    if (s->half.rows)
        PELL_TRY(choose_layer(s, &s->half));
    PELL_TRY(choose_mask(s));
fail:
    return res;
}

/* --- Noise estimates ------------------------------------------------------------------------------------------------------------ */

/* A method's standard error covers the light that the method made, which these layers hold. */
static bool knows_standard_error(const struct sources *all, const struct source *s)
{
    return s->rows && s->variance[0] >= 0 && s->variance[1] >= 0 && s->variance[2] >= 0 &&
           (is_subsurface(all) || strcmp(all->layer, "R,G,B") == 0 || strcmp(all->layer, "diffuse.multiple") == 0);
}

static bool halves_know(const struct sources *s)
{
    return s->half.rows && knows_standard_error(s, &s->reference) && knows_standard_error(s, &s->half);
}

bool sources_know_noise(const struct sources *s)
{
    return s->half.rows || knows_standard_error(s, &s->reference);
}

bool sources_have_two(const struct sources *s)
{
    return s->test.full[0] >= 0 && s->reference.full[0] >= 0 && (!s->half.rows || s->half.full[0] >= 0);
}

enum { SOURCES = 3 };

/* NULL: there is no half. */
static struct source *source_at(struct sources *s, int i)
{
    struct source *const all[] = { &s->reference, &s->test, s->half.rows ? &s->half : NULL };
    return all[i];
}

/* --- The band ------------------------------------------------------------------------------------------------------------------- */

static float *plane_of(const struct source *s, int channel)
{
    return channel >= 0 ? s->planes[channel] : NULL;
}

static bool has_sum(const struct source *s)
{
    for (int k = 0; k < SUBSURFACE_LAYERS; k++)
        if (s->light[k][0] >= 0)
            return true;
    return false;
}

static enum pell_result hold(struct sources *all, struct source *s)
{
    struct pell_context *ctx = all->cli->ctx;
    const size_t size = (size_t) all->capacity * (size_t) s->width;
    const bool reference = s == &all->reference, error = knows_standard_error(all, s);
    int wanted[11 + 3 * SUBSURFACE_LAYERS];
    int count = 0;

    for (int c = 0; c < 3; c++) {
        wanted[count++] = s->rgb[c];
        wanted[count++] = s->full[c];
        wanted[count++] = error ? s->variance[c] : -1;
        for (int k = 0; k < SUBSURFACE_LAYERS; k++)
            wanted[count++] = s->light[k][c];
    }
    wanted[count++] = reference && strcmp(all->mask_name, "alpha") == 0 ? s->alpha : -1;
    wanted[count++] = reference ? s->translucent : -1;
    for (int i = 0; i < count; i++)
        if (wanted[i] >= 0 && !s->planes[wanted[i]] && !(s->planes[wanted[i]] = pell_alloc_array(ctx, size, sizeof(float))))
            return PELL_ERR_NOMEM;
    if (has_sum(s) && !(s->sum = pell_alloc_array(ctx, size, 3 * sizeof(float))))
        return PELL_ERR_NOMEM;
    return PELL_OK;
}

enum pell_result sources_hold(struct sources *s, bool whole)
{
    const int height = s->reference.height;
    enum pell_result res;

    s->chunk = 1;
    for (int i = 0; i < SOURCES && source_at(s, i); i++)
        s->chunk = source_at(s, i)->rows->chunk > s->chunk ? source_at(s, i)->rows->chunk : s->chunk;
    s->capacity = pell_compare_band(s->reference.width) + 2 * PELL_COMPARE_REACH;
    s->capacity = whole || height - s->capacity < s->chunk ? height : s->capacity + s->chunk;
    for (int i = 0; i < SOURCES && source_at(s, i); i++)
        PELL_TRY(hold(s, source_at(s, i)));
    if (halves_know(s) &&
        !(s->variance = pell_alloc_array(s->cli->ctx, (size_t) s->capacity * (size_t) s->reference.width, 3 * sizeof(float))))
        res = PELL_ERR_NOMEM;
fail:
    return res;
}

/* Sums light that was scattered inside a material - once, many times, or transmitted - over pixels where `mask` (NULL: everywhere) is set.
 * Rows from `begin` of the band. */
static void add_subsurface(const struct sources *all, struct source *s, const float *mask, int begin)
{
    const size_t band = (size_t) all->capacity * (size_t) s->width, width = (size_t) s->width;

    for (size_t c = 0; c < 3; c++) {
        float *sum = s->sum + c * band;
        memset(sum + (size_t) begin * width, 0, (size_t) (all->count - begin) * width * sizeof(*sum));
        for (int k = 0; k < SUBSURFACE_LAYERS; k++) {
            const float *light = plane_of(s, s->light[k][c]);
            for (size_t i = (size_t) begin * width; light && i < (size_t) all->count * width; i++)
                sum[i] += !mask || mask[i] > 0.5f ? light[i] : 0.0f;
        }
    }
}

static void join_variances(const struct sources *s, int begin)
{
    const size_t width = (size_t) s->reference.width, band = (size_t) s->capacity * width;

    for (size_t c = 0; c < 3; c++) {
        const float *a = s->reference.planes[s->reference.variance[c]], *b = s->half.planes[s->half.variance[c]];
        for (size_t i = (size_t) begin * width; i < (size_t) s->count * width; i++)
            s->variance[c * band + i] = 0.25f * a[i] + 0.25f * b[i];
    }
}

static void shift(float *plane, size_t by, size_t count)
{
    if (plane && by > 0)
        memmove(plane, plane + by, count * sizeof(*plane));
}

/* Rows `begin` to `s->count - 1` of the band. */
static enum pell_result read_rows(struct sources *all, struct source *s, int begin)
{
    const size_t channels = s->rows->layers.count, at = (size_t) begin * (size_t) s->width;
    float **to = pell_calloc(all->cli->ctx, channels, sizeof(*to));
    enum pell_result res;

    if (!to)
        return PELL_ERR_NOMEM;
    for (size_t c = 0; c < channels; c++)
        to[c] = s->planes[c] ? s->planes[c] + at : NULL;
    res = pell_rows_read(s->rows, all->first + begin, all->count - begin, to, (size_t) s->width);
    pell_free(all->cli->ctx, to);
    return res;
}

/* Moves the band so that it begins with row `first`; returns how many of its rows are kept. */
static int move_band(struct sources *s, int first)
{
    const int end = s->first + s->count, kept = first >= s->first && first < end ? end - first : 0;
    const size_t width = (size_t) s->reference.width, band = (size_t) s->capacity * width, count = (size_t) kept * width;
    const size_t by = kept ? (size_t) (first - s->first) * width : 0;

    for (int i = 0; i < SOURCES && source_at(s, i); i++) {
        struct source *from = source_at(s, i);
        for (size_t c = 0; c < from->rows->layers.count; c++)
            shift(from->planes[c], by, count);
        for (size_t c = 0; c < 3 && from->sum; c++)
            shift(from->sum + c * band, by, count);
    }
    for (size_t c = 0; c < 3 && s->variance; c++)
        shift(s->variance + c * band, by, count);
    s->first = first;
    return kept;
}

enum pell_result sources_take(struct sources *s, int first, int count)
{
    const int height = s->reference.height, chunk = s->chunk;
    const int64_t rounded = ((int64_t) first + count + chunk - 1) / chunk * chunk, end = rounded < height ? rounded : height;
    const float *translucent;
    enum pell_result res;
    int kept;

    if (first >= s->first && first + count <= s->first + s->count)
        return PELL_OK;
    kept = move_band(s, first);
    s->count = (int) (end - first <= s->capacity ? end - first : count);
    for (int i = 0; i < SOURCES && source_at(s, i); i++)
        PELL_TRY(read_rows(s, source_at(s, i), kept));
    translucent = plane_of(&s->reference, s->reference.translucent);
    for (int i = 0; i < SOURCES && source_at(s, i); i++)
        if (source_at(s, i)->sum)
            add_subsurface(s, source_at(s, i), translucent, kept);
    if (s->variance)
        join_variances(s, kept);
    return PELL_OK;
fail:
    s->count = 0;
    return res;
}

/* --- Compared planes -------------------------------------------------------------------------------------------------------------- */

static const float *compared(const struct sources *all, const struct source *s, bool full, int c)
{
    if (!s->rows)
        return NULL;
    if (full)
        return plane_of(s, s->full[c]);
    return s->sum ? s->sum + (size_t) c * (size_t) all->capacity * (size_t) s->width : plane_of(s, s->rgb[c]);
}

static const float *from_row(const float *plane, size_t by)
{
    return plane ? plane + by : NULL;
}

struct pell_compare_input sources_input(const struct sources *s, bool all_light, int first)
{
    const bool full = all_light && sources_have_two(s);
    const struct source *r = &s->reference;
    const size_t width = (size_t) r->width, by = (size_t) (first - s->first) * width;
    struct pell_compare_input in = { .width = r->width, .height = r->height, .stride = r->width, .display = s->test.display };

    for (int c = 0; c < 3; c++) {
        in.test[c] = from_row(compared(s, &s->test, full, c), by);
        in.reference[c] = from_row(compared(s, r, full, c), by);
        in.half[c] = from_row(compared(s, &s->half, full, c), by);
        if (s->half.rows)
            in.variance[c] = from_row(s->variance ? s->variance + (size_t) c * (size_t) s->capacity * width : NULL, by);
        else
            in.variance[c] = knows_standard_error(s, r) ? from_row(plane_of(r, r->variance[c]), by) : NULL;
        in.test_variance[c] = knows_standard_error(s, &s->test) ? from_row(plane_of(&s->test, s->test.variance[c]), by) : NULL;
    }
    if (s->mask)
        in.mask = s->mask + (size_t) first * width;
    else if (s->mask_name[0])
        in.mask = from_row(plane_of(r, s->mask_name[0] == 't' ? r->translucent : r->alpha), by);
    return in;
}

static enum pell_result move(struct sources *s, bool all_light, int first, int count, struct pell_compare_input *in)
{
    const bool figures_only = in->figures_only;
    const enum pell_result res = sources_take(s, first, count);

    *in = res == PELL_OK ? sources_input(s, all_light, first) : *in;
    in->figures_only = figures_only;
    return res;
}

static enum pell_result move_part(void *user, int first, int count, struct pell_compare_input *in)
{
    return move(user, false, first, count, in);
}

static enum pell_result move_all_light(void *user, int first, int count, struct pell_compare_input *in)
{
    return move(user, true, first, count, in);
}

struct pell_compare_rows sources_rows(struct sources *s, bool all_light)
{
    return (struct pell_compare_rows) { all_light ? move_all_light : move_part, s };
}

/* --- The end -------------------------------------------------------------------------------------------------------------------- */

static void close_source(struct sources *all, struct source *s)
{
    for (size_t c = 0; s->rows && s->planes && c < s->rows->layers.count; c++)
        pell_free(all->cli->ctx, s->planes[c]);
    pell_free(all->cli->ctx, s->planes);
    pell_free(all->cli->ctx, s->sum);
    pell_rows_close(&s->rows);
}

void sources_close(struct sources *s)
{
    close_source(s, &s->test);
    close_source(s, &s->reference);
    close_source(s, &s->half);
    pell_free(s->cli->ctx, s->mask);
    pell_free(s->cli->ctx, s->variance);
}
