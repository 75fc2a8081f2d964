/* SPDX-License-Identifier: MIT
 * command.c - `pellucid view`: from the command line to a page that shows it. */
#include "viewer/address.h"
#include "viewer/document.h"
#include "viewer/viewer.h"

#include "base/file.h"

#include <pellucid/material.h>

#include <signal.h>
#include <stdlib.h>
#include <string.h>

/* --- Initial state of a page ---------------------------------------------------------------------------------------------------------- */

/* Settings that differ from `usual`, as texts. */
static json_t *differences(const struct pell_knob *knobs, const void *values, const void *usual)
{
    json_t *o = json_object();

    for (const struct pell_knob *k = knobs; k->name; k++) {
        char value[128], other[128];
        pell_knob_format(k, values, value, sizeof(value));
        if (strcmp(value, pell_knob_format(k, usual, other, sizeof(other))) != 0)
            json_object_set_new(o, k->name, json_string(value));
    }
    return o;
}

/* The method, knobs and settings of the command line and the scene file. */
static json_t *begin_state(struct cli *cli, const struct session *s)
{
    const bool paper = pell_method_as_paper(s->method, s->knobs);
    struct pell_settings usual;
    json_t *knobs = json_object(), *settings;
    void *values = NULL;

    pell_settings_default(s->method, s->knobs, &usual);
    settings = differences(pell_settings_knobs(), &s->settings, &usual);
    json_object_del(settings, "layers"); /* follows from the format */
    if (s->method && pell_method_knobs_create(cli->ctx, s->method, paper ? "as=paper" : NULL, &values) == PELL_OK) {
        json_decref(knobs);
        knobs = differences(s->method->knobs, s->knobs, values);
        pell_method_knobs_destroy(cli->ctx, &values);
        if (paper)
            json_object_set_new(knobs, "as", json_string("paper"));
    }
    return json_pack("{s:s,s:o,s:o}", "method", s->method ? s->method->name : "none", "knobs", knobs, "settings", settings);
}

static json_t *make_hello(struct cli *cli, const struct session *s)
{
    json_t *methods = json_array(), *settings = json_array(), *materials = json_array();

    for (size_t i = 0; i < pell_method_count(); i++)
        json_array_append_new(methods, cli_method_json(cli, pell_method_at(i)));
    json_array_append_new(methods, json_pack("{s:s,s:s,s:s,s:s,s:[],s:[]}", "name", "none", "title", "No scattering", "kind", "method",
                                             "limits", "A Lambertian surface of the same colour, for comparison.", "knobs", "ignores"));
    for (const struct pell_knob *k = pell_settings_knobs(); k->name; k++)
        if (strcmp(k->name, "layers") != 0)
            json_array_append_new(settings, cli_knob_json(k));
    for (size_t i = 0; i < pell_material_count(); i++)
        json_array_append_new(materials, cli_material_json(pell_material_at(i)));
    return json_pack("{s:s,s:s,s:o,s:o,s:o,s:o,s:o,s:o,s:i}", "type", "hello", "version", pell_version_string(), "input",
                     cli_text(pell_path_name(cli->arguments[0])), "path", cli_text(cli->arguments[0]), "methods", methods, "settings",
                     settings, "materials", materials, "state", begin_state(cli, s), "threads", pell_device_threads(s->device));
}

/* The options from which a page makes the command line of its view; "saved": the scene that it saves holds this one. */
static json_t *begin_options(struct cli *cli, const struct viewer_document *document)
{
    json_t *options = cli_given_options(cli, cli_find_command(cli->program, "render")), *o;
    size_t i;

    if (document->granted && !cli->allow_outside)
        json_array_append_new(options, json_pack("{s:s,s:n}", "name", "allow-outside", "value"));
    json_array_foreach(options, i, o)
        json_object_set_new(o, "saved", json_boolean(viewer_document_holds(document, json_string_value(json_object_get(o, "name")))));
    return options;
}

/* --- The command ---------------------------------------------------------------------------------------------------------------------- */

/* Log messages of both contexts are shown in the page, too; the terminal shows only those of the start. */
static void ignore(void *user, const struct pell_message *message)
{
    (void) user;
    (void) message;
}

/* Only the main thread may receive Ctrl-C, or it would not wake the server. */
static void block_signals(bool block)
{
    sigset_t set;

    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGTERM);
    pthread_sigmask(block ? SIG_BLOCK : SIG_UNBLOCK, &set, NULL);
}

static const char *listening(const struct cli *cli)
{
    return cli->view.listen ? cli->view.listen : "127.0.0.1";
}

static enum exit_code serve(struct cli *cli, struct viewer *v, struct viewer_document *document, double end_after)
{
    struct pell_device_params params = { .threads = cli->numbers.threads, .vulkan_device = cli->device, .vulkan_shaders = cli_shaders() };
    struct viewer_server_params server = {
        .address = listening(cli), .port = cli->numbers.port, .open = !cli->view.no_open, .end_after = end_after
    };
    struct pell_device *device = NULL;
    struct viewer_worker *worker = NULL;
    char *folder = pell_path_folder(cli->ctx, cli->arguments[0]);
    char token[VIEWER_TOKEN + 1];
    enum exit_code code = folder ? cli_engine(cli, &params.engine) : EXIT_MEMORY;

    if (code == EXIT_OK && cli->view.token_file)
        code = cli_failed(cli, viewer_token_keep(cli->ctx, cli->view.token_file, token));
    else if (code == EXIT_OK && !viewer_token_make(token))
        code = cli_failed(cli, pell_error(cli->ctx, PELL_ERR_IO, "viewer", NULL, "the system gives no random bytes for a token"));
    server.token = token;

    server.folder = folder;
    server.shaders = params.vulkan_shaders;
    block_signals(true);
    if (code == EXIT_OK)
        code = cli_failed(cli, pell_device_create(v->ctx, &params, &device));
    if (code == EXIT_OK)
        code = cli_failed(cli, viewer_worker_start(v, device, document, &worker));
    block_signals(false);
    if (code == EXIT_OK)
        code = viewer_serve(v, &server);
    viewer_worker_stop(&worker);
    pell_device_destroy(&device);
    pell_free(cli->ctx, folder);
    return code;
}

enum exit_code command_view(struct cli *cli)
{
    const char *path = cli->arguments[0];
    struct pell_context *ctx = NULL, *parsing = NULL;
    struct viewer_document document = { .ctx = NULL };
    struct pell_load_params params;
    struct session session;
    struct viewer v;
    json_t *hello = NULL;
    int port = cli->numbers.port;
    double end_after = 0.0;
    enum exit_code code = viewer_find_port(cli, listening(cli), &port); /* before slow work */

    if (code == EXIT_OK && cli->view.end_after)
        code = cli_parse_seconds(cli, "--end-after", cli->view.end_after, &end_after);
    if (code != EXIT_OK)
        return code;
    code = session_read(cli, path, &session); /* errors at the start are printed in the terminal */
    if (code == EXIT_OK && !(hello = make_hello(cli, &session)))
        code = EXIT_MEMORY;
    session_close(&session);
    if (code == EXIT_OK)
        code = cli_load_params(cli, &params);
    if (code != EXIT_OK)
        goto fail;
    code = cli_failed(cli, pell_context_create(&(struct pell_context_params) { .log = viewer_worker_log,
                                                                               .log_user = &v,
                                                                               .log_level = PELL_LOG_WARNING,
                                                                               .progress = viewer_worker_progress,
                                                                               .progress_user = &v,
                                                                               .limits = &cli->limits },
                                               &ctx));
    if (code == EXIT_OK)
        code = cli_failed(cli, pell_context_create(&(struct pell_context_params) { .log = ignore, .log_level = PELL_LOG_ERROR }, &parsing));
    if (code == EXIT_OK)
        code = cli_failed(cli, viewer_init(cli, ctx, parsing, &v));
    if (code != EXIT_OK)
        goto fail;
    code = cli_failed(cli, viewer_document_open(ctx, path, &params, cli->size, cli->unit, &document));
    if (code == EXIT_OK) {
        json_object_set_new(hello, "options", begin_options(cli, &document));
        v.hello = json_dumps(hello, JSON_COMPACT | JSON_REAL_PRECISION(9));
        code = v.hello ? EXIT_OK : EXIT_MEMORY;
    }
    if (code == EXIT_OK)
        code = serve(cli, &v, &document, end_after);
    viewer_document_close(&document);
    viewer_finish(&v);

fail:
    json_decref(hello);
    pell_context_destroy(&ctx);
    pell_context_destroy(&parsing);
    return code;
}
