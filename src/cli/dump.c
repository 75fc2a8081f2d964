/* SPDX-License-Identifier: MIT
 * dump.c - see dump.h. */
#include "cli/dump.h"

#include "base/file.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define IMAGE_FILE "%02zu-%s.exr" /* number, name */

enum { MOST_INDEX = 2 << 20 }; /* bytes of an index of an earlier dump */

/* NULL: no memory. */
static json_t *gaussians_json(const struct pell_intermediate *image)
{
    json_t *list = json_array();

    for (size_t i = 0; i < image->num_gaussians; i++) {
        const struct pell_intermediate_gaussian *g = &image->gaussians[i];
        if (json_array_append_new(list, json_pack("{s:o,s:f,s:[f,f,f]}", "material", cli_text(g->material), "variance_mm2", g->variance,
                                                  "weight", g->weight[0], g->weight[1], g->weight[2])) != 0) {
            json_decref(list);
            return NULL;
        }
    }
    return list;
}

static enum pell_result write_intermediate(void *user, const struct pell_intermediate *image)
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
    snprintf(file, sizeof(file), IMAGE_FILE, d->folder.count, image->name);
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

/* --- The dump that is replaced ------------------------------------------------------------------------------------------------- */

/* Reads a regular file of at most MOST_INDEX bytes; NULL if there is none. pell_file_read would make it an input of the render, which is
 * never overwritten. */
static char *read_index(struct pell_context *ctx, const char *path, size_t *size)
{
    struct pell_file file = { .handle = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC) };
    struct stat st;
    char *data = NULL;

    if (file.handle < 0)
        return NULL;
    if (fstat(file.handle, &st) == 0 && S_ISREG(st.st_mode) && st.st_size > 0 && st.st_size <= MOST_INDEX)
        data = pell_alloc(ctx, file.size = (size_t) st.st_size);
    if (data)
        *size = pell_file_read_at(&file, 0, data, file.size);
    pell_file_close(&file);
    return data;
}

/* File of image `i` of an index, if it has the name that `write_intermediate` gives it; NULL otherwise. */
static const char *image_file(const json_t *images, size_t i)
{
    const json_t *image = json_array_get(images, i);
    const char *name = json_string_value(json_object_get(image, "name")), *file = json_string_value(json_object_get(image, "file"));
    char expected[96];

    if (!name || !file || strlen(name) > 63 || strspn(name, "abcdefghijklmnopqrstuvwxyz0123456789.-") != strlen(name))
        return NULL;
    snprintf(expected, sizeof(expected), IMAGE_FILE, i, name);
    return strcmp(file, expected) == 0 ? file : NULL;
}

/* Images that the folder's index lists are removed when this dump replaces them: all, or none if any of them could not be a dump's. */
static void replace_previous(struct dump *d)
{
    char path[sizeof(d->folder.path) + 16];
    size_t size, count;
    char *text;
    json_t *index, *images;
    bool ours;

    snprintf(path, sizeof(path), "%s/index.json", d->folder.path);
    if (!d->folder.existed || !(text = read_index(d->cli->ctx, path, &size)))
        return;
    index = json_loadb(text, size, JSON_REJECT_DUPLICATES, NULL);
    pell_free(d->cli->ctx, text);
    images = json_object_get(index, "images");
    count = json_array_size(images);
    ours = json_is_string(json_object_get(index, "method")) && json_is_string(json_object_get(index, "knobs")) &&
           json_is_string(json_object_get(index, "settings")) && count < PELL_COUNT(d->folder.files);
    for (size_t i = 0; i < count && ours; i++)
        ours = image_file(images, i) != NULL;
    for (size_t i = 0; i < count && ours; i++)
        folder_replace(&d->folder, image_file(images, i));
    json_decref(index);
}

/* --- The dump ------------------------------------------------------------------------------------------------------------------ */

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
    const struct pell_observer observer = { write_intermediate, d };
    enum pell_result res;

    *d = (struct dump) { .cli = cli };
    if (!cli->dump)
        return EXIT_OK;
    if (!(d->index = json_array()))
        return EXIT_MEMORY;
    pell_renderer_set_observer(s->renderer, &observer);
    res = folder_begin(cli->ctx, "--dump", cli->dump, &d->folder);
    if (res == PELL_OK)
        replace_previous(d);
    return cli_failed(cli, res);
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
    if (json_array_size(d->index) == 0)
        pell_warn(cli->ctx, "--dump", s->method ? NULL : "name a method with -m", "there are no intermediate images: %s",
                  s->method ? "nothing translucent is in view" : "-m none renders without a method");
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
