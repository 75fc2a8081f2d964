/* SPDX-License-Identifier: MIT
 * bake_layers.c - `pellucid bake-layers`: depth maps of layers from nested meshes (Francois et al. 2006, section 3), and a scene file that
 * names them. */
#define _XOPEN_SOURCE 700 /* realpath */
#include "cli/commands/bake.h"

#include "base/file.h"
#include "cli/folder.h"

#include <pellucid/image.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Coefficients of table 1 of the paper: the outer object, the first inner mesh, the others; 1/mm. */
static const struct {
    double sigma_s[3], sigma_t[3], k;
} optics[] = {
    { { 2.0, 1.0, 1.0 }, { 2.6, 1.6, 1.6 }, 0.25 },
    { { 6.0, 3.0, 2.0 }, { 6.6, 3.6, 2.6 }, 0.4 },
    { { 1.0, 1.0, 2.0 }, { 1.5, 1.5, 2.5 }, 0.8 },
};

/* --- Options -------------------------------------------------------------------------------------------------------------------- */

static enum exit_code read_options(struct cli *cli, struct bake *b)
{
    enum pell_result res = PELL_OK;

    if (!cli->output)
        return cli_usage(cli, "bake-layers", "-o layers/", "--output is missing");
    if (cli->bake.inner.count == 0)
        return cli_usage(cli, "bake-layers", "--inner vessel=vessel.obj", "--inner is missing: there is nothing below the surface");
    if (cli->bake.inner.count > BAKE_INNER)
        return cli_usage(cli, "--inner", NULL, "%zu inner meshes, must be at most %d", cli->bake.inner.count, BAKE_INNER);
    b->ctx = cli->ctx;
    b->size = cli->numbers.map_size;
    b->down_to_mm = (double) INFINITY;
    b->outer.path = cli->arguments[0];
    b->outer.name = "body";
    if (pell_path_has_extension(b->outer.path, "json"))
        return cli_usage(cli, "bake-layers", "give the mesh that the scene names", "\"%s\" is a scene, must be a mesh", b->outer.path);
    if (cli->check.down_to)
        res = pell_parse_length(cli->ctx, "--down-to", cli->check.down_to, &b->down_to_mm);
    for (size_t i = 0; res == PELL_OK && i < cli->bake.inner.count; i++) {
        const struct pell_setting *s = &cli->bake.inner.items[i];
        if (!s->name[0] || strcmp(s->name, b->outer.name) == 0)
            return cli_usage(cli, "--inner", "--inner vessel=vessel.obj", "\"%s\" can't be the name of an inner mesh", s->name);
        for (size_t k = 0; k < i; k++)
            if (strcmp(cli->bake.inner.items[k].name, s->name) == 0)
                return cli_usage(cli, "--inner", NULL, "\"%s\" is given twice", s->name);
        b->inner[b->num_inner].name = s->name;
        b->inner[b->num_inner++].path = s->value;
    }
    return cli_failed(cli, res);
}

static enum pell_result load_solid(const struct bake *b, const struct pell_load_params *params, struct bake_solid *s)
{
    struct pell_scene_report report = { 0 };
    enum pell_result res;

    PELL_TRY(pell_scene_load(b->ctx, s->path, params, &s->scene));
    PELL_TRY(pell_scene_check(s->scene, &report));
    for (size_t i = 0; i < report.num_objects; i++)
        if (!report.objects[i].closed)
            pell_warn(b->ctx, s->path, "rays pair entries and exits, so close the mesh", "\"%s\" is not closed", s->name);
    PELL_TRY(pell_rays_create(b->ctx, s->scene, b->pool, &s->rays));

fail:
    pell_scene_report_finish(b->ctx, &report);
    return res;
}

static enum exit_code load_all(struct cli *cli, struct bake *b)
{
    struct pell_load_params params;
    enum exit_code code = cli_load_params(cli, &params);
    enum pell_result res;

    if (code != EXIT_OK)
        return code;
    params.bare = true;
    PELL_TRY(pell_pool_create(b->ctx, cli->numbers.threads, &b->pool));
    PELL_TRY(load_solid(b, &params, &b->outer));
    params.size_mm = 0.0;
    params.mm_per_unit = b->outer.scene->mm_per_unit;
    for (int k = 0; k < b->num_inner; k++)
        PELL_TRY(load_solid(b, &params, &b->inner[k]));

fail:
    return cli_failed(cli, res);
}

/* --- Output --------------------------------------------------------------------------------------------------------------------- */

/* Writes four layers per image, in mm. */
static enum pell_result write_maps(const struct bake *b, struct output_folder *f)
{
    static const char *const names[] = { "R", "G", "B", "A" };
    const size_t n = (size_t) b->size * (size_t) b->size;
    const int maps = b->num_layers - 1;
    enum pell_result res = PELL_OK;

    for (int first = 0; first < maps; first += 4) {
        const int rest = maps - first, count = rest == 1 ? 1 : rest < 4 ? 3 : 4;
        struct pell_channel channels[4];
        const struct pell_write_params params = {
            .width = b->size, .height = b->size, .channels = channels, .num_channels = (size_t) count, .compression = PELL_EXR_ZIP
        };
        char name[32];
        const char *path;
        for (int k = 0; k < count; k++) {
            const int layer = first + (k < rest ? k : rest - 1);
            channels[k] = (struct pell_channel) { count == 1 ? "Y" : names[k], b->bottom + (size_t) layer * n, b->size, true };
        }
        snprintf(name, sizeof(name), "layers-%d.exr", first / 4);
        path = folder_file(f, name);
        if (!path)
            return PELL_ERR_INVALID;
        PELL_TRY(pell_image_write(b->ctx, path, "exr", &params));
    }

fail:
    return res;
}

static const char *name_of(const struct bake *b, int layer)
{
    return b->layer[layer] ? b->inner[b->layer[layer] - 1].name : b->outer.name;
}

static json_t *make_layers(const struct bake *b)
{
    json_t *list = json_array();

    for (int k = 0; k < b->num_layers; k++) {
        const int of = b->layer[k] < 2 ? b->layer[k] : 2;
        json_t *layer = json_pack("{s:o,s:o,s:o,s:s,s:f}", "name", cli_text(name_of(b, k)), "sigma_s", cli_numbers(optics[of].sigma_s, 3),
                                  "sigma_t", cli_numbers(optics[of].sigma_t, 3), "phase", "schlick", "g", optics[of].k);
        char depth[40];
        snprintf(depth, sizeof(depth), "layers-%d.exr#%c", k / 4, "rgba"[k % 4]);
        if (k + 1 < b->num_layers)
            json_object_set_new(layer, "depth", json_string(depth));
        json_array_append_new(list, layer);
    }
    return list;
}

/* `to` relative to the folder `from`, both without symbolic links; false: too long. */
static bool relative(const char *from, const char *to, char *out, size_t size)
{
    size_t common = 0, n = 0;

    for (size_t i = 0; from[i] == to[i]; i++) {
        if (to[i] == '/')
            common = i + 1;
        if (!to[i])
            return false;
    }
    out[0] = '\0';
    for (const char *p = from + common; *p; p++)
        if ((p == from + common || p[-1] == '/') && n + 4 < size)
            n += (size_t) snprintf(out + n, size - n, "../");
    return (size_t) snprintf(out + n, size - n, "%s", to + common) < size - n;
}

/* The path of the mesh relative to the output folder, which may not exist yet. */
static bool mesh_path(const char *folder, const char *mesh, char *out, size_t size)
{
    char around[4300], whole[8600];
    const char *name = pell_path_name(folder);
    char *from, *to = realpath(mesh, NULL);
    bool good;

    snprintf(around, sizeof(around), "%.*s", (int) (name - folder), folder);
    from = realpath(around[0] ? around : ".", NULL);
    snprintf(whole, sizeof(whole), "%s/%s", from ? from : "", name);
    good = from && to && relative(whole, to, out, size);
    free(from);
    free(to);
    return good;
}

static enum pell_result write_scene(const struct bake *b, struct output_folder *f)
{
    char mesh[8600], unit[64], number[40];
    const char *path;
    json_t *scene;
    char *text = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!mesh_path(f->path, b->outer.path, mesh, sizeof(mesh)))
        return pell_error(b->ctx, PELL_ERR_IO, b->outer.path, NULL, "has no path from the folder of --output");
    snprintf(unit, sizeof(unit), "%smm", pell_format_number(b->outer.scene->mm_per_unit, false, number, sizeof(number)));
    scene = json_pack("{s:i,s:o,s:s,s:{s:{s:f,s:s,s:s,s:o}},s:{s:s}}", "pellucid", 1, "mesh", cli_text(mesh), "unit", unit, "materials",
                      "*", "eta", 1.36, "below", "last", "depth_scale", "1mm", "layers", make_layers(b), "render", "method", "layered");
    if (!scene || !(text = json_dumps(scene, JSON_INDENT(2))))
        goto fail;
    res = PELL_ERR_INVALID;
    if ((path = folder_file(f, "scene.json")))
        res = pell_file_write(b->ctx, path, text, strlen(text));

fail:
    free(text);
    json_decref(scene);
    return res;
}

static enum exit_code write_all(struct cli *cli, const struct bake *b)
{
    struct output_folder f;
    enum pell_result res;

    PELL_TRY(folder_begin(cli->ctx, "--output", cli->output, &f));
    PELL_TRY(write_maps(b, &f));
    PELL_TRY(write_scene(b, &f));
    PELL_TRY(folder_commit(&f));

fail:
    folder_drop(&f);
    return cli_failed(cli, res);
}

/* --- The answer ----------------------------------------------------------------------------------------------------------------- */

static enum exit_code answer(struct cli *cli, const struct bake *b)
{
    const size_t n = (size_t) b->size * (size_t) b->size;
    json_t *layers = json_array();

    cli_answer_begins();
    if (!cli->json)
        printf("%s: %d layers of %d x %d texels, %.1f %% of them shown\n\n%-24s %12s %12s\n", cli->output, b->num_layers, b->size, b->size,
               100.0 * (double) b->shown / (double) n, "layer", "covers %", "mean mm");
    for (int k = 0; k < b->num_layers; k++) {
        double sum = 0.0, mean;
        int64_t covering = 0;
        char shown[96];
        for (size_t i = 0; i < n && k + 1 < b->num_layers; i++) {
            const float thick = b->bottom[(size_t) k * n + i] - (k > 0 ? b->bottom[(size_t) (k - 1) * n + i] : 0.0f);
            covering += b->texels[i].count > 0 && thick > 0.0f;
            sum += b->texels[i].count > 0 ? (double) thick : 0.0;
        }
        mean = covering > 0 ? sum / (double) covering : 0.0;
        if (k + 1 == b->num_layers) {
            if (!cli->json)
                printf("%-24s %12s %12s\n", pell_printable(name_of(b, k), shown, sizeof(shown)), "", "no bottom");
            json_array_append_new(layers, json_pack("{s:o}", "name", cli_text(name_of(b, k))));
            continue;
        }
        if (!cli->json)
            printf("%-24s %12.1f %12.3f\n", pell_printable(name_of(b, k), shown, sizeof(shown)),
                   100.0 * (double) covering / (double) b->shown, mean);
        json_array_append_new(layers, json_pack("{s:o,s:f,s:f}", "name", cli_text(name_of(b, k)), "covers",
                                                (double) covering / (double) b->shown, "mean_mm", mean));
    }
    if (!cli->json) {
        json_decref(layers);
        return EXIT_OK;
    }
    return cli_print_json(cli, json_pack("{s:o,s:i,s:I,s:I,s:I,s:I,s:o,s:O}", "folder", cli_text(cli->output), "size", b->size, "shown",
                                         (json_int_t) b->shown, "shared", (json_int_t) b->shared, "cut", (json_int_t) b->cut, "open",
                                         (json_int_t) b->open, "layers", layers, "warnings", cli->warnings));
}

static void warn(const struct bake *b)
{
    for (int k = 0; k < b->num_inner; k++)
        if (!memchr(b->layer, k + 1, (size_t) b->num_layers))
            pell_warn(b->ctx, b->inner[k].path, "it must have the unit of the outer mesh", "no ray hits \"%s\"", b->inner[k].name);
    if (b->shared > b->shown / 1000)
        pell_warn(b->ctx, b->outer.path, "unwrap it without overlaps", "%lld texels of the map are covered by several triangles",
                  (long long) b->shared);
    if (b->cut > 0)
        pell_warn(b->ctx, b->outer.path, "--down-to leaves out what is deep",
                  "%lld texels have more than %d pairs of a mesh or %d stretches", (long long) b->cut, BAKE_PAIRS, BAKE_STRETCHES);
    if (b->open > 0)
        pell_warn(b->ctx, b->outer.path, "close the mesh", "rays of %lld texels do not exit it", (long long) b->open);
}

enum exit_code command_bake_layers(struct cli *cli)
{
    struct bake b = { 0 };
    enum exit_code code = read_options(cli, &b);

    if (code == EXIT_OK)
        code = load_all(cli, &b);
    if (code == EXIT_OK)
        code = cli_failed(cli, bake_measure(&b));
    if (code == EXIT_OK)
        code = cli_failed(cli, bake_align(&b));
    if (code == EXIT_OK) {
        warn(&b);
        code = write_all(cli, &b);
    }
    if (code == EXIT_OK)
        code = answer(cli, &b);
    bake_finish(&b);
    return code;
}
