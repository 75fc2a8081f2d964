/* SPDX-License-Identifier: MIT
 * render.c - `pellucid render`: renders an image, a turntable, or the frames of an animation. */
#include "cli/auto.h"
#include "cli/dump.h"

#include "base/file.h"
#include "math/vec.h"
#include "render/communicator.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MOST_FRAMES 100000
#define INPUT_IS "INPUT must be a mesh (glTF, OBJ, PLY, STL) or a scene file (.json)"

struct job {
    struct session session;
    char output[4096];
    const char *format;
    uint64_t scene_hash, materials_hash; /* 0 unless the format stores them */
    struct pell_render_result image;     /* the last image */
    json_t *images;                      /* for a turntable or frames: the file names */
    bool chooses;                        /* the method is chosen by --max-error */
    json_t *chosen;                      /* how the method was chosen; or NULL */
    struct {
        double from, step;
        int count; /* 0: none */
    } frames;
    double checkpoint_every; /* s */
    int first, end;          /* the images of the sequence to render */
    bool no_image;           /* a part is written to its checkpoint alone */
    char *note;              /* note of the checkpoint */
    int lock;                /* lock on the checkpoint */
};

/* --- Output file -------------------------------------------------------------------------------------------------------------- */

static enum exit_code choose_output(struct cli *cli, struct job *job)
{
    const bool part = cli->part.samples || cli->part.tiles || cli->merge.count > 0;
    const char *name = pell_path_name(cli->arguments[0]), *dot = strrchr(name, '.');
    const int n = cli->output
                      ? snprintf(job->output, sizeof(job->output), "%s", cli->output)
                      : snprintf(job->output, sizeof(job->output), "%.*s.png", dot && dot != name ? (int) (dot - name) : 4000, name);

    if (!cli->output && cli_is_image(name))
        return cli_usage(cli, "render", "to compare images: pellucid compare A B", "\"%s\" is an image; " INPUT_IS, cli->arguments[0]);
    if (!cli->output && !name[0])
        return cli_usage(cli, "render", NULL, "\"%s\" is a folder; " INPUT_IS, cli->arguments[0]);
    job->no_image = part && cli->checkpoint && !cli->output && !cli->dump;
    if (n < 0 || (size_t) n + 16 >= sizeof(job->output)) /* numbers must fit, too */
        return cli_usage(cli, "--output", NULL, "a name of %d bytes is too long", n);
    return dump_check(cli);
}

static enum exit_code choose_format(struct cli *cli, struct job *job)
{
    const bool to_stdout = strcmp(job->output, "-") == 0;
    const char *names[16];
    size_t count = 0;

    for (const char *format; count < PELL_COUNT(names) && (format = pell_write_format_at(count)); names[count++] = format)
        if (cli->format ? strcmp(cli->format, format) == 0 : pell_path_has_extension(job->output, format))
            job->format = format;
    if (!job->format && cli->format) {
        struct pell_text hint = { .length = 0 };
        const bool near = pell_text_suggest(&hint, "", cli->format, names, count);
        return cli_usage(cli, "--format", near ? hint.str : NULL, "is \"%s\", must be png, exr, hdr or pfm", cli->format);
    }
    if (to_stdout && (cli->json || cli->numbers.turntable > 0 || cli->frames))
        return cli_usage(cli, "--output", NULL, "- writes one image to stdout: it does not go with %s",
                         cli->json     ? "--json"
                         : cli->frames ? "--frames"
                                       : "--turntable");
    if (!job->format)
        return cli_usage(cli, "--output", to_stdout ? "add --format png" : "the format follows from the name's ending, or from --format",
                         "is \"%s\", must end in .png, .exr, .hdr or .pfm", job->output);
    return EXIT_OK;
}

/* "0:2:0.25" -> nine times. */
static enum exit_code choose_frames(struct cli *cli, struct job *job)
{
    const char *text = cli->frames, *first = text ? strchr(text, ':') : NULL, *second = first ? strchr(first + 1, ':') : NULL;
    double to = 0.0, count;

    if (!text)
        return EXIT_OK;
    if (!second || !pell_parse_number(text, (size_t) (first - text), &job->frames.from) ||
        !pell_parse_number(first + 1, (size_t) (second - first - 1), &to) ||
        !pell_parse_number(second + 1, strlen(second + 1), &job->frames.step))
        return cli_usage(cli, "--frames", "0:2:0.25 are nine images of two seconds",
                         "\"%s\", must be three numbers of seconds: FROM:TO:STEP", text);
    if (!(job->frames.step > 0.0) || !(to >= job->frames.from))
        return cli_usage(cli, "--frames", NULL, "\"%s\" goes backwards or stands still: STEP must be above 0, TO not before FROM", text);
    count = floor((to - job->frames.from) / job->frames.step * (1.0 + 1e-12) + 1e-9) + 1.0;
    if (!(count <= MOST_FRAMES))
        return cli_usage(cli, "--frames", NULL, "\"%s\" are %g images, at most %d are allowed", text, count, MOST_FRAMES);
    job->frames.count = (int) count;
    if (cli->time || cli->numbers.turntable > 0)
        return cli_usage(cli, "--frames", NULL, "can't be combined with %s", cli->time ? "--time" : "--turntable");
    return EXIT_OK;
}

static bool one_file(const char *a, const char *b)
{
    struct stat x, y;

    return strcmp(a, b) == 0 || (stat(a, &x) == 0 && stat(b, &y) == 0 && x.st_dev == y.st_dev && x.st_ino == y.st_ino);
}

/* Checks what can be known before rendering whether the file can be written; writing itself decides. */
static enum exit_code check_writable(struct cli *cli, const char *option, const char *path)
{
    const char *name = pell_path_name(path);
    char folder[sizeof(((struct job *) NULL)->output)];
    struct stat out;

    if (stat(path, &out) == 0 && S_ISDIR(out.st_mode))
        return cli_failed(cli, pell_error(cli->ctx, PELL_ERR_IO, path, NULL, "is a folder, must name a file"));
    if (one_file(cli->arguments[0], path))
        return cli_usage(cli, option, "give it another name", "\"%s\" is the input", path);
    if (snprintf(folder, sizeof(folder), "%.*s", (int) (name - path), path) >= (int) sizeof(folder) ||
        access(folder[0] ? folder : ".", W_OK) != 0)
        return cli_failed(
            cli, pell_error(cli->ctx, PELL_ERR_IO, path, NULL, "can't be written: its folder does not exist, or you may not write to it"));
    return EXIT_OK;
}

/* "turn.png", 7 -> "turn_0007.png". */
static void numbered(const char *path, int number, int count, char *out, size_t size)
{
    const char *dot = strrchr(pell_path_name(path), '.');
    const int digits = count > 10000 ? 5 : 4;

    if (!dot)
        dot = path + strlen(path);
    snprintf(out, size, "%.*s_%0*d%s", (int) (dot - path), path, digits, number, dot);
}

/* -m auto is --max-error with its default. */
static enum exit_code check_choice(struct cli *cli, struct job *job)
{
    const bool named = cli->method && strcmp(cli->method, "auto") == 0;
    double bound;

    job->chooses = cli->max_error || named;
    if (named) {
        free(cli->method);
        cli->method = NULL; /* until it is known: the scene file's, or the default */
    }
    if (!job->chooses)
        return EXIT_OK;
    if (cli->method)
        return cli_usage(cli, "--max-error", NULL, "chooses the method: it does not go with --method %s", cli->method);
    if (cli->knobs.count || cli->common.count)
        return cli_usage(cli, cli->knobs.count ? cli->knobs.items[0].where : cli->common.items[0].where, "name a method with -m",
                         "belongs to a method, but --max-error chooses the method");
    if (cli->checkpoint || cli->program->communicator)
        return cli_usage(cli, "--max-error", "-m path-trace", "does not go with %s", cli->checkpoint ? "--checkpoint" : "ranks");
    return auto_bound(cli, &bound);
}

/* --- Writing ------------------------------------------------------------------------------------------------------------------ */

static void print_stats(const struct pell_render_result *p)
{
    fprintf(stderr, "%-28s %9s %10s %10s %9s %7s\n", "stage", "ms", "pixels", "rays", "copy ms", "ratio");
    for (size_t i = 0; i < p->num_stages; i++) {
        const struct pell_stage_time *t = &p->stages[i];
        fprintf(stderr, "%-28s %9.2f %10lld %10lld ", t->name, t->ms, (long long) t->pixels, (long long) t->rays);
        if (t->bandwidth_ms > 0.0)
            fprintf(stderr, "%9.2f %7.1f\n", t->bandwidth_ms, t->ms / t->bandwidth_ms);
        else
            fprintf(stderr, "%9s %7s\n", "-", "-");
    }
    fprintf(stderr, "%-28s %9.2f\n", "frame", 1e3 * p->seconds);
}

static enum exit_code render_one(struct cli *cli, struct job *job, const char *path)
{
    enum exit_code code;
    enum pell_result res;

    if ((code = cli_spare_input(cli, "--output", path)) != EXIT_OK)
        return code;
    res = pell_renderer_render(job->session.renderer, &job->session.settings, &job->image);
    cli_progress_end(cli);
    if (res == PELL_OK && !job->no_image)
        res = session_write(cli, &job->session, &job->image, path, job->format, job->scene_hash, job->materials_hash);
    if (res != PELL_OK)
        return cli_failed(cli, res);
    cli->images += !job->no_image;
    cli->partial = job->image.partial;
    if (cli->stats && !cli->json)
        print_stats(&job->image);
    if (job->image.unwritten)
        return cli_failed(cli, PELL_ERR_IO);
    if (cli->resumable && ((cli->partial && cli_terminated()) || (!cli->partial && job->image.unfinished)))
        return EXIT_RESUMABLE;
    return cli->partial ? EXIT_INTERRUPTED : EXIT_OK;
}

/* --- Turntable ---------------------------------------------------------------------------------------------------------------- */

/* Rotates the camera about the vertical axis through the centre of the bounds. */
static void turn_camera(const struct pell_scene *scene, const struct pell_camera *from, double angle, struct pell_camera *to)
{
    const double c = cos(angle), s = sin(angle);
    const struct pell_mat4 turn = { { c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, 0, 0, 0, 1 } };
    const struct pell_vec3 middle =
        vec3(0.5f * (scene->bounds_min[0] + scene->bounds_max[0]), 0.0f, 0.5f * (scene->bounds_min[2] + scene->bounds_max[2]));

    vec3_store(vec3_add(middle, mat4_direction(&turn, vec3_sub(vec3_load(from->position), middle))), to->position);
    vec3_store(mat4_direction(&turn, vec3_load(from->forward)), to->forward);
    vec3_store(mat4_direction(&turn, vec3_load(from->up)), to->up);
}

/* Chooses which images of a sequence of `count` are rendered. */
static enum exit_code choose_sequence(struct cli *cli, struct job *job)
{
    const int count = cli->numbers.turntable > 0 ? cli->numbers.turntable : job->frames.count;

    job->end = count;
    if (!cli->part.frames)
        return EXIT_OK;
    if (count < 1)
        return cli_usage(cli, "--frame-range", NULL, "goes with --frames or --turntable");
    return cli_range(cli, "--frame-range", cli->part.frames, count, 1, &job->first, &job->end);
}

/* Exposure is metered on the first image of a sequence and kept, or the images would flicker. */
static void keep_tone(struct job *job)
{
    struct pell_settings *settings = &job->session.settings;

    if (settings->exposure > 0.0f)
        return;
    settings->exposure = job->image.exposure;
    if (!(settings->white > 0.0f))
        settings->white = job->image.white;
}

/* All images have the exposure of the first of the sequence, and what the method caches from it, even if another run renders that. */
static enum exit_code begin_sequence(struct cli *cli, struct job *job)
{
    const struct session *s = &job->session;
    const bool exposure = !(s->settings.exposure > 0.0f); /* backdrops depend on it in linear images, too */
    const bool kept = job->frames.count > 0 && s->scene->animated && s->method && s->method->keeps_first;
    enum pell_result res;

    if (job->first == 0 || !(exposure || kept))
        return EXIT_OK;
    if (!cli->quiet && !cli->json)
        fprintf(stderr, "image 0 is rendered for its %s\n",
                kept ? "surface, which the method keeps"
                     : "exposure; give --exposure to avoid "
                       "this");
    res = pell_renderer_render(job->session.renderer, &job->session.settings, &job->image);
    if (res == PELL_OK)
        keep_tone(job);
    return cli_failed(cli, res);
}

static enum exit_code render_turntable(struct cli *cli, struct job *job)
{
    struct pell_scene *scene = job->session.scene;
    const struct pell_camera camera = scene->cameras[0];
    const int count = cli->numbers.turntable;
    char path[sizeof(job->output) + 16];
    enum exit_code code = begin_sequence(cli, job);

    job->images = json_array();
    cli->progress.parts = job->end - job->first;
    for (int i = job->first; i < job->end && code == EXIT_OK; i++) {
        cli->progress.part = i - job->first;
        turn_camera(scene, &camera, 2.0 * PELL_PI * i / count, &scene->cameras[0]);
        numbered(job->output, i, count, path, sizeof(path));
        code = render_one(cli, job, path);
        json_array_append_new(job->images, cli_text(path));
        cli_progress(cli, "render", 1.0);
        keep_tone(job);
    }
    scene->cameras[0] = camera;
    return code;
}

/* --- Frames ------------------------------------------------------------------------------------------------------------------- */

static void hash_scene(struct job *job)
{
    if (strcmp(job->format, "exr") != 0)
        return;
    job->scene_hash = pell_scene_hash(job->session.scene);
    job->materials_hash = pell_scene_hash_materials(job->session.scene);
}

/* Renders the frames; the session holds the first scene. */
static enum exit_code render_frames(struct cli *cli, struct job *job)
{
    char path[sizeof(job->output) + 16];
    enum exit_code code = begin_sequence(cli, job);

    if (!job->session.scene->animated && job->frames.count > 1)
        pell_warn(cli->ctx, "--frames", NULL, "no file of the scene has an animation: all images are the same");
    job->images = json_array();
    cli->progress.parts = job->end - job->first;
    for (int i = job->first; i < job->end && code == EXIT_OK; i++) {
        cli->progress.part = i - job->first;
        if (i > 0)
            code = session_move(cli, cli->arguments[0], job->frames.from + i * job->frames.step, &job->session);
        if (code != EXIT_OK)
            break;
        hash_scene(job);
        numbered(job->output, i, job->frames.count, path, sizeof(path));
        code = render_one(cli, job, path);
        json_array_append_new(job->images, cli_text(path));
        cli_progress(cli, "render", 1.0);
        keep_tone(job);
    }
    return code;
}

/* --- Checkpoint ----------------------------------------------------------------------------------------------------------------- */

static enum exit_code check_checkpoint_name(struct cli *cli, const struct job *job)
{
    enum exit_code code = check_writable(cli, "--checkpoint", cli->checkpoint);

    if (code == EXIT_OK && one_file(job->output, cli->checkpoint))
        return cli_usage(cli, "--checkpoint", "give it another name", "\"%s\" is where the image goes", cli->checkpoint);
    return code;
}

static enum exit_code set_merge(struct cli *cli, struct job *job)
{
    char *const note = cli_note(cli);
    const struct pell_checkpoint checkpoint = {
        .path = cli->checkpoint,
        .every = 60.0,
        .note = note,
        .mode = cli->part.partial ? PELL_CHECKPOINT_MERGE_PARTIAL : PELL_CHECKPOINT_MERGE,
        .parts = cli->merge.parts,
        .num_parts = cli->merge.count,
    };
    enum exit_code code = EXIT_OK;

    job->note = note;
    for (int i = 0; i < cli->merge.count; i++) {
        if (cli->output && one_file(job->output, cli->merge.parts[i]))
            return cli_usage(cli, "--output", "give it another name", "\"%s\" is one of the parts", job->output);
        if (cli->checkpoint && one_file(cli->checkpoint, cli->merge.parts[i]))
            return cli_usage(cli, "--checkpoint", "give it another name", "\"%s\" is one of the parts", cli->checkpoint);
    }
    if (cli->checkpoint && (code = check_checkpoint_name(cli, job)) == EXIT_OK)
        code = cli_lock(cli, cli->checkpoint, &job->lock);
    return code == EXIT_OK ? cli_failed(cli, pell_renderer_set_checkpoint(job->session.renderer, &checkpoint)) : code;
}

static enum exit_code check_method(struct cli *cli, const struct pell_method *method)
{
    const char *name = method ? method->name : "none";

    if (method && method->partial)
        return EXIT_OK;
    if (cli->program->communicator)
        return cli_usage(cli, "--method", "-m path-trace", "method %s is not shared by ranks: run it on one machine", name);
    if (cli->part.samples || cli->part.tiles)
        return cli_usage(cli, cli->part.samples ? "--sample-range" : "--tile-range", "-m path-trace",
                         "method %s keeps no checkpoint, into which the part would go", name);
    return cli->checkpoint ? cli_usage(cli, "--checkpoint", "path-trace does", "method %s keeps no checkpoint", name) : EXIT_OK;
}

/* What the options of parts and checkpoints ask for, before the scene is read. The method is checked if it is known already. */
static enum exit_code check_checkpoint(struct cli *cli, struct job *job)
{
    const bool requested = cli->checkpoint || cli->part.samples || cli->part.tiles || cli->program->communicator;
    const struct pell_method *method;
    enum exit_code code = EXIT_OK;

    if (cli->merge.count > 0)
        return EXIT_OK;
    if (requested && !job->chooses && session_method_ahead(cli, &method) && (code = check_method(cli, method)) != EXIT_OK)
        return code;
    if ((code = cli_part_check(cli)) != EXIT_OK)
        return code;
    if (cli->checkpoint_every && !cli->checkpoint)
        return cli_usage(cli, "--checkpoint-every", NULL, "needs --checkpoint FILE");
    if (!cli->checkpoint)
        return EXIT_OK;
    if (cli->numbers.turntable > 0 || cli->frames)
        return cli_usage(cli, "--checkpoint", NULL, "holds the state of one image: it does not go with %s",
                         cli->frames ? "--frames" : "--turntable");
    job->checkpoint_every = 60.0;
    if (cli->checkpoint_every)
        code = cli_parse_seconds(cli, "--checkpoint-every", cli->checkpoint_every, &job->checkpoint_every);
    return code == EXIT_OK ? check_checkpoint_name(cli, job) : code;
}

/* Rank 0 writes the image. */
static void set_communicator(struct cli *cli, struct job *job)
{
    struct pell_communicator *comm = cli->program->communicator;

    if (!comm)
        return;
    job->no_image = job->no_image || comm->rank > 0;
    pell_renderer_set_communicator(job->session.renderer, comm);
}

static enum exit_code lock_checkpoint(struct cli *cli, struct job *job)
{
    return cli->program->communicator && cli->program->communicator->rank > 0 ? EXIT_OK : cli_lock(cli, cli->checkpoint, &job->lock);
}

static enum exit_code set_checkpoint(struct cli *cli, struct job *job)
{
    struct pell_checkpoint checkpoint = { .path = cli->checkpoint, .every = job->checkpoint_every };
    enum exit_code code;

    if (cli->merge.count > 0)
        return set_merge(cli, job);
    if ((code = check_method(cli, job->session.method)) != EXIT_OK || !cli->checkpoint)
        return code;
    if ((code = cli_part(cli, &job->session, &checkpoint, &job->note)) != EXIT_OK || (code = lock_checkpoint(cli, job)) != EXIT_OK)
        return code;
    cli->resumable = true;
    return cli_failed(cli, pell_renderer_set_checkpoint(job->session.renderer, &checkpoint));
}

/* --- The command -------------------------------------------------------------------------------------------------------------- */

static void print_answer(const struct cli *cli, const struct job *job, const char *method, const char *engine, int threads)
{
    const struct pell_render_result *p = &job->image;
    const size_t count = job->images ? json_array_size(job->images) : 0;
    struct pell_text line = { .length = 0 };
    char name[160], last[160];

    if (count > 1)
        pell_text_add(&line, "%s to %s, %zu images", pell_printable(json_string_value(json_array_get(job->images, 0)), name, sizeof(name)),
                      pell_printable(json_string_value(json_array_get(job->images, count - 1)), last, sizeof(last)), count);
    else
        pell_text_add(&line, "%s",
                      pell_printable(count                      ? json_string_value(json_array_get(job->images, 0))
                                     : job->no_image            ? cli->checkpoint
                                     : strcmp(job->output, "-") ? job->output
                                                                : "stdout",
                                     name, sizeof(name)));
    pell_text_add(&line, ": %d x %d, %s on engine %s (%s), %.2f s%s after %.2f s of loading", p->width, p->height, method, engine,
                  pell_counted(threads, "thread", "threads").str, p->seconds, count > 1 ? " for the last" : "", job->session.load_seconds);
    if (cli->tty)
        cli_wrap(stderr, 0, 2, line.str);
    else
        fprintf(stderr, "%s\n", line.str);
}

static enum exit_code answer(struct cli *cli, const struct job *job)
{
    const struct session *s = &job->session;
    const struct pell_render_result *p = &job->image;
    const char *method = s->method ? s->method->name : "none", *engine = pell_engine_name(pell_device_engine(s->device));
    const int threads = pell_device_threads(s->device);
    json_t *o;

    if (!cli->json) {
        if (!cli->quiet)
            print_answer(cli, job, method, engine, threads);
        return EXIT_OK;
    }
    o = json_pack("{s:o,s:s,s:s,s:i,s:i,s:f,s:f,s:i,s:f,s:o,s:O}", "image",
                  job->no_image ? json_null()
                  : job->images ? json_incref(json_array_get(job->images, json_array_size(job->images) - 1))
                                : cli_text(job->output),
                  "method", method, "engine", engine, "width", p->width, "height", p->height, "seconds", p->seconds, "load_seconds",
                  s->load_seconds, "threads", threads, "exposure", (double) p->exposure, "stages", session_stages(p), "warnings",
                  cli->warnings);
    if (o && job->images)
        json_object_set(o, "images", job->images);
    if (o && job->chosen)
        json_object_set(o, "auto", job->chosen);
    if (o && p->partial)
        json_object_set_new(o, "partial", json_true());
    if (o && p->unfinished && cli->resumable)
        json_object_set_new(o, "resumable", json_true());
    return cli_print_json(cli, o);
}

enum exit_code command_render(struct cli *cli)
{
    struct job job = { .format = NULL, .lock = -1 };
    struct dump dump = { .index = NULL };
    enum exit_code code = choose_output(cli, &job);

    if (code == EXIT_OK)
        code = choose_format(cli, &job);
    if (code == EXIT_OK)
        code = choose_frames(cli, &job);
    if (code == EXIT_OK)
        code = choose_sequence(cli, &job);
    if (code == EXIT_OK)
        code = strcmp(job.output, "-") == 0 || job.no_image ? EXIT_OK : check_writable(cli, "--output", job.output);
    if (code == EXIT_OK)
        code = check_choice(cli, &job);
    if (code == EXIT_OK)
        code = check_checkpoint(cli, &job);
    if (code == EXIT_OK)
        code = session_open_at(cli, cli->arguments[0], job.frames.count > 0 ? &job.frames.from : NULL, &job.session);
    if (code == EXIT_OK && job.chooses)
        code = auto_choose(cli, &job.session, &job.chosen);
    if (code == EXIT_OK)
        set_communicator(cli, &job);
    if (code == EXIT_OK)
        code = set_checkpoint(cli, &job);
    if (code == EXIT_OK)
        code = dump_open(cli, &job.session, &dump);
    if (code == EXIT_OK) {
        /* The denoiser's guide images are layers. */
        job.session.settings.layers = cli->dump || strcmp(job.format, "exr") == 0 || job.session.settings.denoise;
        session_shorten(cli, &job.session);
        hash_scene(&job);
        code = cli_failed(cli, pell_renderer_check_assumptions(job.session.renderer, &job.session.settings));
    }
    if (code == EXIT_OK)
        code = cli->numbers.turntable > 0 ? render_turntable(cli, &job)
               : job.frames.count > 0     ? render_frames(cli, &job)
                                          : render_one(cli, &job, job.output);
    if (code == EXIT_OK)
        code = dump_commit(cli, &job.session, &dump);
    if (code == EXIT_OK)
        code = answer(cli, &job);
    else if ((code == EXIT_INTERRUPTED && cli->partial) || code == EXIT_RESUMABLE)
        answer(cli, &job);
    dump_close(&job.session, &dump);
    json_decref(job.images);
    json_decref(job.chosen);
    cli_unlock(cli->checkpoint, &job.lock);
    free(job.note);
    session_close(&job.session);
    return code;
}
