/* SPDX-License-Identifier: MIT
 * scene.c - `pellucid compare INPUT`: compares methods on one scene with a reference, with one exposure for all.
 *
 * The reference is rendered first and kept; then each method is rendered, measured, written and forgotten. A second reference
 * measures the first one: it gives the error of the model that the methods and the first reference share, separately from their own. */
#include "cli/compare/compare.h"

#include "base/file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NOISE_WARNED 0.1 /* relative noise of a reference above which a warning is printed */

enum { PART, WHOLE, VIEWS }; /* the subsurface light of translucent pixels; all light of all pixels: name, title, caption */
static const char *const views[VIEWS][3] = {
    { "part", "Subsurface light", "Light that left the material, at its pixels; of a finished image, all light there." },
    { "whole", "Whole image", "All light of all pixels: reflections and backdrop, too." },
};

/* The light that an image is compared by, rows without padding. */
struct light {
    float *planes; /* owns the others */
    float *rgb[VIEWS][3];
    float *variance[3]; /* NULL: not known */
    struct light *half; /* NULL, or two halves: `rgb` is their mean */
};

struct job {
    struct session session;
    struct run_list runs;
    struct pell_compare_params params;
    struct output_folder folder;
    struct report *report;
    uint64_t scene_hash, materials_hash;
    int width, height;
    float *mask;
    int64_t translucent;
    struct light references[MAX_REFERENCES];
    struct light direct;              /* --decompose: light of the last reference without bounces */
    float *masked;                    /* all light of the references' translucent pixels, 3 planes each: for methods that mix */
    double rel_noise[MAX_REFERENCES]; /* NAN: not known */
    double interreflection[3];
    json_t *methods, *views, *model_error, *shown_as;
    int rendered;
};

/* --- Light -------------------------------------------------------------------------------------------------------------------- */

/* Adds a channel of the image (NULL: nothing) to a plane without padding, where the mask (NULL: everywhere) is set. */
static void add_plane(const struct job *job, const struct pell_channel *from, const float *mask, float *to)
{
    for (int y = 0; from && y < job->height; y++)
        for (int x = 0; x < job->width; x++) {
            const size_t at = (size_t) y * (size_t) job->width + (size_t) x;
            if (!mask || mask[at] > 0.5f)
                to[at] += from->data[y * from->stride + x];
        }
}

/* Makes the mask from the first reference. */
static enum exit_code make_mask(struct cli *cli, struct job *job, const struct pell_render_result *p)
{
    const size_t pixels = (size_t) job->width * (size_t) job->height;

    job->mask = pell_calloc(cli->ctx, pixels, sizeof(float));
    if (!job->mask)
        return EXIT_MEMORY;
    add_plane(job, cli_channel(p, "translucent", "Y"), NULL, job->mask);
    for (size_t i = 0; i < pixels; i++)
        job->translucent += job->mask[i] > 0.5f;
    if (job->translucent == 0)
        return cli_failed(cli,
                          pell_error(cli->ctx, PELL_ERR_INVALID, job->session.scene->path, "give it a --material, or look at another part",
                                     "no pixel shows a translucent object: there is nothing to compare"));
    return EXIT_OK;
}

static void set_planes(struct light *l, size_t pixels, bool noisy)
{
    for (size_t c = 0; c < 3; c++) {
        l->rgb[PART][c] = l->planes + c * pixels;
        l->rgb[WHOLE][c] = l->planes + (3 + c) * pixels;
        l->variance[c] = noisy ? l->planes + (6 + c) * pixels : NULL;
    }
}

static enum pell_result take_light(struct cli *cli, const struct job *job, const struct run *run, const struct pell_render_result *p,
                                   struct light *l)
{
    static const char *const names[3] = { "R", "G", "B" };
    const size_t pixels = (size_t) job->width * (size_t) job->height;
    const bool noisy = cli_channel(p, "variance", "R") != NULL;

    l->planes = pell_calloc(cli->ctx, pixels, (noisy ? 9 : 6) * sizeof(float));
    if (!l->planes)
        return PELL_ERR_NOMEM;
    set_planes(l, pixels, noisy);
    for (size_t c = 0; c < 3; c++) {
        add_plane(job, cli_channel(p, "", names[c]), NULL, l->rgb[WHOLE][c]);
        if (run->mixes)
            add_plane(job, cli_channel(p, "", names[c]), job->mask, l->rgb[PART][c]);
        for (size_t k = 0; !run->mixes && k < PELL_COUNT(cli_subsurface_layers); k++)
            add_plane(job, cli_channel(p, cli_subsurface_layers[k], names[c]), job->mask, l->rgb[PART][c]);
        if (noisy)
            add_plane(job, cli_channel(p, "variance", names[c]), NULL, l->variance[c]);
    }
    return PELL_OK;
}

static void drop_light(struct cli *cli, struct light *l)
{
    for (int h = 0; l->half && h < 2; h++)
        pell_free(cli->ctx, l->half[h].planes);
    pell_free(cli->ctx, l->half);
    pell_free(cli->ctx, l->planes);
    *l = (struct light) { NULL };
}

/* Stores all light of a reference's translucent pixels, for methods that give a finished image only. */
static enum pell_result masked_light(struct cli *cli, struct job *job, size_t reference, const float *rgb[3])
{
    const size_t pixels = (size_t) job->width * (size_t) job->height;

    if (!job->masked) {
        job->masked = pell_alloc_array(cli->ctx, pixels, job->runs.num_references * 3 * sizeof(float));
        if (!job->masked)
            return PELL_ERR_NOMEM;
        for (size_t k = 0; k < 3 * job->runs.num_references; k++)
            for (size_t i = 0; i < pixels; i++)
                job->masked[k * pixels + i] = job->mask[i] > 0.5f ? job->references[k / 3].rgb[WHOLE][k % 3][i] : 0.0f;
    }
    for (size_t c = 0; c < 3; c++)
        rgb[c] = job->masked + (3 * reference + c) * pixels;
    return PELL_OK;
}

/* --- Measuring ---------------------------------------------------------------------------------------------------------------- */

static json_t *child(json_t *object, const char *name)
{
    json_t *found = json_object_get(object, name);

    if (!found && json_object_set_new(object, name, json_object()) == 0)
        found = json_object_get(object, name);
    return found;
}

/* Methods whose output includes surface reflection are compared by all light of the translucent pixels. */
static struct pell_compare_input choose_planes(const struct job *job, const struct run *run, const struct light *l, const struct light *r,
                                               int view)
{
    struct pell_compare_input in = { .width = job->width, .height = job->height, .stride = job->width };
    const bool mixed = view == PART && run->mixes;

    if (view == PART)
        in.mask = job->mask;
    for (int c = 0; c < 3; c++) {
        in.test[c] = l->rgb[view][c];
        in.reference[c] = r->half && !mixed ? r->half[0].rgb[view][c] : r->rgb[mixed ? WHOLE : view][c];
        in.half[c] = r->half && !mixed ? r->half[1].rgb[view][c] : NULL;
        in.variance[c] = r->variance[c];
        in.test_variance[c] = l->variance[c];
    }
    return in;
}

/* Puts the metrics under `key` ("metrics", "total") of the report's image, and into `answer`. */
static enum pell_result measure(struct cli *cli, struct job *job, struct run *run, const struct light *l, size_t reference, const char *key,
                                json_t *answer)
{
    const struct light *r = &job->references[reference];
    enum pell_result res = PELL_OK;

    for (int view = 0; view < VIEWS && res == PELL_OK; view++) {
        struct pell_compare_input in = choose_planes(job, run, l, r, view);
        struct pell_comparison result = { .width = 0 };
        const struct pell_metrics *m = view == PART ? &result.masked : &result.whole;
        char name[280];
        json_t *id;

        if (view == PART && run->mixes)
            PELL_TRY(masked_light(cli, job, reference, in.reference));
        PELL_TRY(compare_run(cli, run->label, job->runs.list[reference].label, &in, NULL, &job->params, &result));
        if (view == PART) {
            compare_add_metrics(answer, m, false);
            run->measured = *m;
            if (r->variance[0] && !run->mixes)
                job->rel_noise[reference] = sqrt(m->noise_rel_mse);
        } else {
            json_object_set_new(answer, "whole", compare_metrics(m, false));
        }
        if (!json_object_get(job->shown_as, views[view][0]))
            compare_add_shown(child(job->shown_as, views[view][0]), &result, false);
        if (job->report) {
            json_object_set_new(child(run->shown, key), views[view][0], compare_metrics(m, false));
            if ((res = report_map(job->report, result.flip, result.width, &id)) == PELL_OK)
                json_object_set_new(child(child(run->shown, "flip"), job->runs.list[reference].label), views[view][0], id);
            if (res == PELL_OK && json_array_size(job->views) == (size_t) view && !run->mixes)
                json_array_append_new(job->views,
                                      report_view(job->report, views[view][0], views[view][1], views[view][2], &in, &job->params, &result));
            if (res == PELL_OK && view == PART && reference == 0) {
                snprintf(name, sizeof(name), "%s.errors.exr", run->file);
                res = compare_write_errors(cli, &result, &job->folder, name);
            }
        }
    fail:
        pell_comparison_finish(cli->ctx, &result);
    }
    return res;
}

/* --- Rendering ---------------------------------------------------------------------------------------------------------------- */

static json_t *describe(const struct job *job, const struct run *run, const struct pell_render_result *p)
{
    const struct pell_method *m = run->method;
    const bool reference = run < job->runs.list + job->runs.num_references;
    char knobs[2048] = "", settings[1024];

    if (m)
        cli_format_knobs(m->knobs, run->values, NULL, knobs, sizeof(knobs));
    cli_format_knobs(pell_settings_knobs(), &run->settings, &job->session.settings, settings, sizeof(settings));
    return json_pack("{s:o,s:s,s:s,s:s,s:s,s:o,s:o,s:s,s:f,s:f,s:o,s:b}", "name", cli_text(run->label), "role",
                     !reference              ? "method"
                     : run == job->runs.list ? "reference"
                                             : "truth",
                     "title", m ? m->title : "No scattering: light leaves where it enters", "cite",
                     m ? m->cite : "J. H. Lambert, Photometria, 1760", "limits", m ? m->limits : "For comparison.", "knobs",
                     cli_text(knobs), "settings", cli_text(settings), "engine", pell_engine_name(pell_device_engine(job->session.device)),
                     "seconds", run->seconds, "cpu_seconds", run->cpu_seconds, "stages", session_stages(p), "mixes", (int) run->mixes);
}

static enum pell_result write_run(struct cli *cli, struct job *job, struct run *run, const struct pell_render_result *p)
{
    struct session as = job->session;
    const char *path;
    char name[280];

    if (!cli->output)
        return PELL_OK;
    snprintf(name, sizeof(name), "%s.exr", run->file);
    path = folder_file(&job->folder, name);
    if (!path)
        return PELL_ERR_INVALID;
    as.settings = run->settings;
    as.method = run->method;
    as.knobs = run->values;
    return session_write(cli, &as, p, path, "exr", job->scene_hash, job->materials_hash);
}

/* Takes size, pixels and exposure of all images from the first one. */
static enum pell_result begin_images(struct cli *cli, struct job *job, const struct pell_render_result *image)
{
    job->width = image->width;
    job->height = image->height;
    job->session.settings.exposure = image->exposure; /* the exposure given, or metered */
    job->params.exposure = image->exposure * exp2f(job->session.settings.stops);
    for (size_t i = 0; i < job->runs.count; i++)
        job->runs.list[i].settings.exposure = image->exposure;
    if (make_mask(cli, job, image) != EXIT_OK)
        return cli->error.present ? cli->error.code : PELL_ERR_NOMEM;
    return cli->output ? report_open(cli->ctx, job->width, job->height, &job->report) : PELL_OK;
}

/* References that support it are rendered as two halves. */
static int images_of(const struct job *job, const struct run *run)
{
    return run < job->runs.list + job->runs.num_references ? halves_of(run) : 1;
}

/* Renders one image, or two halves of one, whose light goes to l->half. */
static enum pell_result render_image(struct cli *cli, struct job *job, struct run *run, struct light *l, struct halves *h,
                                     struct pell_render_result *image)
{
    const int count = images_of(job, run);
    struct session *s = &job->session;
    enum pell_result res;

    if (count == 2 && !(l->half = pell_calloc(cli->ctx, 2, sizeof(*l->half))))
        return PELL_ERR_NOMEM;
    for (int i = 0; i < count; i++) {
        cli->progress.part = job->rendered++;
        cli->progress.fraction = 2.0; /* another task: the previous task's speed does not apply */
        if (count == 2)
            halves_choose(run->method, run->values, i + 1);
        PELL_TRY(pell_renderer_set_method(s->renderer, run->method, run->values));
        PELL_TRY(pell_renderer_render(s->renderer, &run->settings, image));
        cli_progress_end(cli);
        if (image->partial) { /* ended early: an incomplete image is not compared */
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
        if (!job->mask)
            PELL_TRY(begin_images(cli, job, image));
        if (count == 1)
            continue;
        PELL_TRY(take_light(cli, job, run, image, &l->half[i]));
        PELL_TRY(halves_add(cli, image, h));
    }
    res = PELL_OK;
fail:
    if (count == 2)
        halves_choose(run->method, run->values, 0);
    return res;
}

/* Renders a run. A reference is kept in `l`; any other is measured, and released by the caller. */
static enum pell_result render(struct cli *cli, struct job *job, struct run *run, struct light *l)
{
    struct pell_render_result image;
    struct halves halves = { .planes = NULL };
    const double start = cli_cpu_seconds();
    json_t *id;
    enum pell_result res;

    PELL_TRY(render_image(cli, job, run, l, &halves, &image));
    run->seconds = image.seconds;
    run->cpu_seconds = cli_cpu_seconds() - start;
    PELL_TRY(write_run(cli, job, run, &image));
    PELL_TRY(take_light(cli, job, run, &image, l));
    run->shown = describe(job, run, &image);
    res = PELL_ERR_NOMEM;
    if (!run->shown)
        goto fail;
    res = PELL_OK;
    for (int view = 0; job->report && view < VIEWS; view++) {
        PELL_TRY(report_image(job->report, (const float *const *) l->rgb[view], job->width, &id));
        json_object_set_new(child(run->shown, "data"), views[view][0], id);
    }
fail:
    halves_drop(cli, &halves);
    return res;
}

/* Makes the mean of both halves. */
static enum pell_result join_halves(struct cli *cli, const struct job *job, struct light *l)
{
    const size_t pixels = (size_t) job->width * (size_t) job->height, planes = l->half[0].variance[0] ? 9 : 6;

    l->planes = pell_alloc_array(cli->ctx, pixels, planes * sizeof(float));
    if (!l->planes)
        return PELL_ERR_NOMEM;
    for (size_t k = 0; k < planes * pixels; k++)
        l->planes[k] = (k < 6 * pixels ? 0.5f : 0.25f) * (l->half[0].planes[k] + l->half[1].planes[k]);
    set_planes(l, pixels, planes == 9);
    return PELL_OK;
}

/* Renders the same without bounces; not measured, not written. Uses the random numbers of the full image, and halves if that has them. */
static enum pell_result render_direct(struct cli *cli, struct job *job, const struct run *run, struct light *l)
{
    const int count = images_of(job, run);
    struct session *s = &job->session;
    struct pell_settings settings = run->settings;
    struct pell_render_result image;
    void *values = NULL;
    enum pell_result res;

    settings.bounces = 0;
    if (count == 2 && !(l->half = pell_calloc(cli->ctx, 2, sizeof(*l->half))))
        return PELL_ERR_NOMEM;
    if (run->method) {
        values = malloc(run->method->knobs_size);
        if (!values)
            return PELL_ERR_NOMEM;
        memcpy(values, run->values, run->method->knobs_size);
        if (pell_knob_find(run->method->knobs, "reentry"))
            PELL_TRY(pell_method_knobs_set_text(cli->ctx, run->method, values, "reentry", "off"));
    }
    for (int i = 0; i < count; i++) {
        if (count == 2)
            halves_choose(run->method, values, i + 1);
        PELL_TRY(pell_renderer_set_method(s->renderer, run->method, values));
        PELL_TRY(pell_renderer_render(s->renderer, &settings, &image));
        cli_progress_end(cli);
        res = PELL_ERR_CANCELLED;
        if (image.partial)
            goto fail;
        PELL_TRY(take_light(cli, job, run, &image, count == 2 ? &l->half[i] : l));
    }
    if (count == 2)
        res = join_halves(cli, job, l);
fail:
    free(values);
    return res;
}

/* Decomposes a run's error with and without bounces, against the last reference. */
static enum pell_result decompose(struct cli *cli, struct job *job, struct run *run, const struct light *l, json_t *answer)
{
    const struct light *truth = &job->references[job->runs.num_references - 1];
    struct pell_compare_input without;
    struct decompose_input in;
    struct decomposition parts;
    struct light direct = { NULL };
    enum pell_result res;

    PELL_TRY(render_direct(cli, job, run, &direct));
    in.total = run->measured;
    in.whole = choose_planes(job, run, l, truth, PART);
    without = choose_planes(job, run, &direct, &job->direct, PART);
    memcpy(in.direct.test, without.test, sizeof(without.test));
    memcpy(in.direct.reference, without.reference, sizeof(without.reference));
    memcpy(in.direct.half, without.half, sizeof(without.half));
    memcpy(in.direct.variance, without.variance, sizeof(without.variance));
    PELL_TRY(decompose_error(cli, pell_device_threads(job->session.device), &in, &parts));
    if (!run->mixes || job->interreflection[1] == 0.0) /* the subsurface light if some method outputs it separately */
        memcpy(job->interreflection, parts.interreflection, sizeof(parts.interreflection));
    json_object_set_new(answer, "parts", decompose_json(&parts));
fail:
    drop_light(cli, &direct);
    return res;
}

static json_t *run_json(const struct job *job, const struct run *run)
{
    json_t *o =
        json_pack("{s:o,s:s,s:f,s:f,s:O,s:O}", "name", cli_text(run->label), "engine",
                  pell_engine_name(pell_device_engine(job->session.device)), "seconds", run->seconds, "cpu_seconds", run->cpu_seconds,
                  "stages", json_object_get(run->shown, "stages"), "settings", json_object_get(run->shown, "settings"));
    return o;
}

static enum pell_result render_all(struct cli *cli, struct job *job)
{
    const size_t last = job->runs.num_references - 1;
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < job->runs.count; i++)
        cli->progress.parts += images_of(job, &job->runs.list[i]);
    for (size_t i = 0; i < job->runs.count && res == PELL_OK; i++) {
        struct run *run = &job->runs.list[i];
        struct light own = { NULL }, *l = i < job->runs.num_references ? &job->references[i] : &own;

        PELL_TRY(render(cli, job, run, l));
        run->answer = run_json(job, run);
        if (i >= job->runs.num_references) {
            json_object_set_new(run->answer, "against", json_string("reference"));
            if (run->mixes)
                json_object_set_new(run->answer, "light", json_string("all of translucent pixels"));
            PELL_TRY(measure(cli, job, run, l, 0, "metrics", run->answer));
            if (job->runs.num_references > 1)
                PELL_TRY(measure(cli, job, run, l, 1, "total", child(run->answer, "total_error")));
            if (cli->compare.decompose)
                PELL_TRY(decompose(cli, job, run, l, run->answer));
            json_array_append(job->methods, run->answer);
        } else if (i == 1) { /* the error of the model that methods and the first reference share */
            job->model_error = json_pack("{s:o,s:o}", "name", cli_text(job->runs.list[0].label), "against", cli_text(run->label));
            PELL_TRY(measure(cli, job, &job->runs.list[0], &job->references[0], 1, "model", job->model_error));
        }
        if (cli->compare.decompose && i == last) {
            PELL_TRY(render_direct(cli, job, run, &job->direct));
            if (last > 0)
                PELL_TRY(decompose(cli, job, &job->runs.list[0], &job->references[0], job->model_error));
        }
    fail:
        drop_light(cli, &own);
        cli_progress(cli, "compare", 1.0);
    }
    cli_progress_end(cli);
    return res;
}

/* --- The answer --------------------------------------------------------------------------------------------------------------- */

static json_t *answer_json(struct cli *cli, struct job *job)
{
    json_t *o, *references[MAX_REFERENCES];

    for (size_t i = 0; i < job->runs.num_references; i++) {
        references[i] = job->runs.list[i].answer;
        json_object_set_new(references[i], "rel_noise", cli_number(job->rel_noise[i]));
    }
    o = json_pack("{s:O,s:O,s:i,s:i,s:I,s:f,s:f,s:f,s:i,s:O}", "reference", references[0], "methods", job->methods, "width", job->width,
                  "height", job->height, "translucent_pixels", (json_int_t) job->translucent, "ppd", (double) job->params.ppd, "floor",
                  (double) job->params.floor, "load_seconds", job->session.load_seconds, "threads",
                  pell_device_threads(job->session.device), "warnings", cli->warnings);
    if (!o)
        return NULL;
    json_object_update(o, json_object_get(job->shown_as, views[PART][0])); /* exposure, white, hdr_exposures */
    if (job->runs.num_references > 1) {
        json_object_set(o, "truth", references[1]);
        json_object_set(o, "model_error", job->model_error);
    }
    if (cli->compare.decompose)
        json_object_set_new(o, "interreflection",
                            json_pack("[f,f,f]", job->interreflection[0], job->interreflection[1], job->interreflection[2]));
    if (cli->output)
        json_object_set_new(o, "output", cli_text(cli->output));
    return o;
}

static enum pell_result write_report(struct cli *cli, struct job *job)
{
    const struct session *s = &job->session;
    char settings[1024], device[160];
    const char *path = folder_file(&job->folder, "report.html");
    json_t *data, *images = json_array();
    enum pell_result res;

    for (size_t i = 0; i < job->runs.count; i++) {
        if (i < job->runs.num_references)
            json_object_set_new(job->runs.list[i].shown, "rel_noise", cli_number(job->rel_noise[i]));
        json_array_append(images, job->runs.list[i].shown);
    }
    cli_format_knobs(pell_settings_knobs(), &s->settings, NULL, settings, sizeof(settings));
    cli_device_name(device, sizeof(device));
    data = json_pack("{s:s,s:o,s:s,s:O,s:o,s:O,s:b,s:o,s:o,s:i,s:I,s:f,s:o}", "kind", "scene", "title",
                     cli_text(pell_path_name(cli->arguments[0])), "command", cli->command_line, "views", job->views, "pictures", images,
                     "warnings", cli->warnings, "display", 0, "settings", cli_text(settings), "device", cli_text(device), "threads",
                     pell_device_threads(s->device), "translucent_pixels", (json_int_t) job->translucent, "load_seconds", s->load_seconds,
                     "material", cli_text(cli->material ? pell_path_name(cli->material) : ""));
    res = !data ? PELL_ERR_NOMEM : !path ? PELL_ERR_INVALID : report_write(job->report, data, path);
    json_decref(data);
    return res;
}

/* Prints the noise below a table if the reference is noisy. `key`: the member with a method's metrics, NULL: next to its name. */
static void print_noise(const struct cli *cli, const struct job *job, const char *key, const json_t *first)
{
    char name[64];

    if (job->runs.count == job->runs.num_references || !json_is_object(json_object_get(first, "agreement")))
        return;
    table_noise_head(cli);
    if (key)
        table_noise_row(job->runs.list[0].label, job->model_error);
    for (size_t i = job->runs.num_references; i < job->runs.count; i++) {
        const json_t *a = job->runs.list[i].answer;
        table_noise_row(job->runs.list[i].label, key ? json_object_get(a, key) : a);
    }
    for (size_t i = key ? 0 : job->runs.num_references; i < job->runs.count; i++) {
        const json_t *a = job->runs.list[i].answer, *m = i == 0 ? job->model_error : key ? json_object_get(a, key) : a;
        if ((i == 0 || i >= job->runs.num_references) && compare_unresolved(m))
            printf("%s: error not resolved (%s)\n", pell_printable(job->runs.list[i].label, name, sizeof(name)), compare_unresolved(m));
    }
}

static void answer_text(const struct cli *cli, const struct job *job)
{
    const bool two = job->runs.num_references > 1;
    char a[256], title[400];

    printf("%s%s%s, %d x %d, %lld translucent pixels\n", cli_style(cli, stdout, 1),
           pell_printable(pell_path_name(cli->arguments[0]), a, sizeof(a)), cli_style(cli, stdout, 0), job->width, job->height,
           (long long) job->translucent);
    for (size_t i = 0; i < job->runs.num_references; i++) {
        printf("%s: %s, %.3f s, ", i == 0 ? "reference" : "its own reference", job->runs.list[i].label, job->runs.list[i].seconds);
        if (isnan(job->rel_noise[i]))
            puts("noise not estimated");
        else
            printf("noise %.2f %% of its subsurface light%s, subtracted from the errors\n", 100.0 * job->rel_noise[i],
                   job->references[i].half ? " as the mean of two halves" : "");
    }
    snprintf(title, sizeof(title), "Subsurface light of translucent pixels, against %s", job->runs.list[0].label);
    table_head(cli, title, true);
    for (size_t i = job->runs.num_references; i < job->runs.count; i++)
        table_row(job->runs.list[i].label, job->runs.list[i].answer, job->runs.list[i].seconds);
    print_noise(cli, job, NULL, job->runs.list[job->runs.count - 1].answer);
    table_head(cli, "Whole image", false);
    for (size_t i = job->runs.num_references; i < job->runs.count; i++)
        table_row(job->runs.list[i].label, json_object_get(job->runs.list[i].answer, "whole"), -1.0);
    if (two) {
        snprintf(title, sizeof(title), "Error of the model, and with it all error, of the subsurface light against %s",
                 job->runs.list[1].label);
        table_head(cli, title, false);
        table_row(job->runs.list[0].label, job->model_error, -1.0);
        for (size_t i = job->runs.num_references; i < job->runs.count; i++)
            table_row(job->runs.list[i].label, json_object_get(job->runs.list[i].answer, "total_error"), -1.0);
        print_noise(cli, job, "total_error", job->model_error);
    }
    if (cli->compare.decompose) {
        decompose_print_head(cli, job->runs.list[job->runs.num_references - 1].label, job->interreflection);
        if (two)
            decompose_print(job->runs.list[0].label, json_object_get(job->model_error, "parts"));
        for (size_t i = job->runs.num_references; i < job->runs.count; i++)
            decompose_print(job->runs.list[i].label, json_object_get(job->runs.list[i].answer, "parts"));
    }
    for (size_t i = 0; i < job->runs.count; i++) {
        const char *own = json_string_value(json_object_get(job->runs.list[i].answer, "settings"));
        if (own && own[0])
            printf("\n%s is rendered with %s\n", job->runs.list[i].label, own);
    }
    for (size_t i = job->runs.num_references; i < job->runs.count; i++)
        if (job->runs.list[i].mixes)
            printf("\n%s gives finished images: compared is all light of translucent pixels.\n", job->runs.list[i].label);
    if (cli->output)
        printf("\n%s%sreport.html\n", pell_printable(cli->output, a, sizeof(a)), cli->output[strlen(cli->output) - 1] == '/' ? "" : "/");
}

static void warn_of_noise(struct cli *cli, const struct job *job)
{
    for (size_t i = 0; i < job->runs.num_references; i++)
        if (job->rel_noise[i] > NOISE_WARNED)
            pell_warn(cli->ctx, job->runs.list[i].label, "give it more samples, a smaller error or more time",
                      "its noise is %.0f %%, which MAE, SSIM and FLIP include", 100.0 * job->rel_noise[i]);
}

/* --- The command -------------------------------------------------------------------------------------------------------------- */

/* Removes settings that only comparing uses before the renderer sees them; exposure is used by both. */
static void split_settings(struct cli *cli)
{
    size_t kept = 0;

    for (size_t i = 0; i < cli->settings.count; i++) {
        struct pell_setting *s = &cli->settings.items[i];
        /* Images are written without a tone curve, and comparing accepts more curves. */
        if (pell_knob_find(pell_settings_knobs(), s->name) && strcmp(s->name, "tonemap") != 0) {
            cli->settings.items[kept++] = *s;
            continue;
        }
        free((char *) s->name);
        free((char *) s->value);
        free((char *) s->where);
    }
    cli->settings.count = kept;
}

static enum exit_code open_scene(struct cli *cli, struct job *job)
{
    struct session *s = &job->session;
    enum exit_code code;

    code = runs_choose(cli, &job->runs);
    if (code == EXIT_OK)
        split_settings(cli);
    if (code == EXIT_OK)
        code = session_open(cli, cli->arguments[0], s);
    if (code == EXIT_OK)
        code = runs_open(cli, &job->runs, s);
    if (code == EXIT_OK) {
        s->settings = job->runs.list[0].settings;
        code = cli_failed(cli, pell_renderer_set_method(s->renderer, job->runs.list[0].method, job->runs.list[0].values));
    }
    if (code == EXIT_OK)
        code = cli_failed(cli, pell_renderer_check_assumptions(s->renderer, &s->settings));
    if (code == EXIT_OK && cli->output) {
        job->scene_hash = pell_scene_hash(s->scene);
        job->materials_hash = pell_scene_hash_materials(s->scene);
        code = cli_failed(cli, folder_begin(cli->ctx, "--output", cli->output, &job->folder));
    }
    return code;
}

static void finish(struct cli *cli, struct job *job)
{
    runs_finish(&job->runs);
    for (size_t i = 0; i < MAX_REFERENCES; i++)
        drop_light(cli, &job->references[i]);
    drop_light(cli, &job->direct);
    pell_free(cli->ctx, job->mask);
    pell_free(cli->ctx, job->masked);
    json_decref(job->methods);
    json_decref(job->views);
    json_decref(job->model_error);
    json_decref(job->shown_as);
    report_close(&job->report);
    folder_drop(&job->folder);
    session_close(&job->session);
}

enum exit_code compare_scene(struct cli *cli)
{
    struct job *job = calloc(1, sizeof(*job));
    json_t *answer = NULL;
    enum exit_code code = job ? cli_failed(cli, compare_params(cli, &job->params)) : EXIT_MEMORY;

    if (!job)
        return code;
    for (size_t i = 0; i < MAX_REFERENCES; i++)
        job->rel_noise[i] = NAN;
    job->methods = json_array();
    job->views = json_array();
    job->shown_as = json_object();
    if (code == EXIT_OK)
        code = open_scene(cli, job);
    if (code == EXIT_OK)
        code = cli_failed(cli, render_all(cli, job));
    if (code == EXIT_OK)
        warn_of_noise(cli, job);
    if (code == EXIT_OK && !(answer = answer_json(cli, job)))
        code = EXIT_MEMORY;
    if (code == EXIT_OK && cli->output)
        code = cli_failed(cli, compare_write_json(cli, answer, &job->folder));
    if (code == EXIT_OK && cli->output)
        code = cli_failed(cli, write_report(cli, job));
    if (code == EXIT_OK && cli->output)
        code = cli_failed(cli, folder_commit(&job->folder));
    if (code == EXIT_OK && cli->json)
        code = cli_print_json(cli, json_incref(answer));
    else if (code == EXIT_OK)
        answer_text(cli, job);
    json_decref(answer);
    finish(cli, job);
    free(job);
    return code;
}
