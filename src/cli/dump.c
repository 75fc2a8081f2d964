/* SPDX-License-Identifier: MIT
 * dump.c - see dump.h. */
#include "cli/dump.h"

#include "base/file.h"

#include <stdlib.h>
#include <string.h>

static json_t *gaussians_json(const struct pell_intermediate *image)
{
    json_t *list = json_array();

    for (size_t i = 0; i < image->num_gaussians; i++) {
        const struct pell_intermediate_gaussian *g = &image->gaussians[i];
        json_array_append_new(list, json_pack("{s:o,s:f,s:[f,f,f]}", "material", cli_text(g->material), "variance_mm2", g->variance,
                                              "weight", g->weight[0], g->weight[1], g->weight[2]));
    }
    return list;
}

static enum pell_result show(void *user, const struct pell_intermediate *image)
{
    static const char *const names[3][3] = { { "Y" }, { "X", "Y", "Z" }, { "R", "G", "B" } };
    struct dump *d = user;
    const struct pell_attribute attributes[] = { { "pellucid.unit", image->unit }, { "pellucid.what", image->what } };
    struct pell_channel channels[3];
    const struct pell_write_params params = { .width = image->width,
                                              .height = image->height,
                                              .channels = channels,
                                              .num_channels = (size_t) image->components,
                                              .attributes = attributes,
                                              .num_attributes = PELL_COUNT(attributes),
                                              .compression = PELL_EXR_ZIP };
    char file[96];
    const char *path;
    json_t *entry;

    for (int c = 0; c < image->components; c++)
        channels[c] = (struct pell_channel) { names[image->components == 1 ? 0
                                                    : image->color         ? 2
                                                                           : 1][c],
                                              image->planes[c], image->stride, true };
    snprintf(file, sizeof(file), "%02zu-%s.exr", d->folder.count, image->name);
    if (!(path = folder_file(&d->folder, file)))
        return PELL_ERR_INVALID;
    entry = json_pack("{s:s,s:s,s:s,s:s,s:i,s:i,s:i}", "file", file, "name", image->name, "unit", image->unit, "what", image->what, "width",
                      image->width, "height", image->height, "components", image->components);
    if (image->num_gaussians > 0 && json_object_set_new(entry, "gaussians", gaussians_json(image)) != 0) {
        json_decref(entry);
        return PELL_ERR_NOMEM;
    }
    if (json_array_append_new(d->index, entry) != 0)
        return PELL_ERR_NOMEM;
    return pell_image_write(d->cli->ctx, path, "exr", &params);
}

enum exit_code dump_check(struct cli *cli)
{
    if (!cli->dump)
        return EXIT_OK;
    if (!cli->dump[0])
        return cli_usage(cli, "--dump", NULL, "is empty, must name a folder");
    if (cli->numbers.turntable > 0 || cli->frames)
        return cli_usage(cli, "--dump", NULL, "is of one image: it does not go with %s", cli->frames ? "--frames" : "--turntable");
    if (cli->program->communicator)
        return cli_usage(cli, "--dump", NULL, "writes the intermediate images of one process: run it on one machine");
    return EXIT_OK;
}

enum exit_code dump_open(struct cli *cli, struct session *s, struct dump *d)
{
    const struct pell_observer observer = { show, d };

    *d = (struct dump) { .cli = cli };
    if (!cli->dump)
        return EXIT_OK;
    if (!(d->index = json_array()))
        return EXIT_MEMORY;
    pell_renderer_set_observer(s->renderer, &observer);
    return cli_failed(cli, folder_begin(cli->ctx, "--dump", cli->dump, &d->folder));
}

enum exit_code dump_commit(struct cli *cli, const struct session *s, struct dump *d)
{
    char knobs[2048] = "", settings[1024];
    json_t *all;
    char *text = NULL;
    const char *path;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!cli->dump)
        return EXIT_OK;
    if (s->method)
        cli_format_knobs(s->method->knobs, s->knobs, NULL, knobs, sizeof(knobs));
    cli_format_knobs(pell_settings_knobs(), &s->settings, NULL, settings, sizeof(settings));
    all = json_pack("{s:s,s:s,s:s,s:O}", "method", s->method ? s->method->name : "none", "knobs", knobs, "settings", settings, "images",
                    d->index);
    if (all && (text = json_dumps(all, JSON_INDENT(2))))
        res = (path = folder_file(&d->folder, "index.json")) ? pell_file_write(cli->ctx, path, text, strlen(text)) : PELL_ERR_INVALID;
    free(text);
    json_decref(all);
    if (res == PELL_OK)
        res = folder_commit(&d->folder);
    return cli_failed(cli, res);
}

void dump_close(struct session *s, struct dump *d)
{
    if (s->renderer && d->index)
        pell_renderer_set_observer(s->renderer, NULL);
    folder_drop(&d->folder);
    json_decref(d->index);
    d->index = NULL;
}
