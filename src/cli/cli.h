/* SPDX-License-Identifier: MIT
 *
 * cli.h - what the commands of the program share: options, messages, exit codes, JSON.
 *
 * stdout is for results, stderr for messages and progress. With --json one object goes to stdout, errors included.
 */
#ifndef PELL_CLI_H
#define PELL_CLI_H

#include "base/base.h"

#include <pellucid/material.h>
#include <pellucid/render.h>

#include <jansson.h>
#include <stdio.h>

/* Documented in docs/guide/command-line.md, in the man page and in `pellucid --help`. */
enum exit_code {
    EXIT_OK = 0,
    EXIT_FAILED = 1,
    EXIT_USAGE = 2,
    EXIT_INPUT = 3,
    EXIT_DEVICE = 4,
    EXIT_MEMORY = 5,
    EXIT_RESUMABLE = 75, /* a time limit, SIGTERM or SIGHUP ended the run, and its checkpoint holds what is done */
    EXIT_INTERRUPTED = 130,
};

struct cli;
struct pell_communicator;

/* A command of a program: one row of its table in main.c. */
struct command {
    const char *name, *arguments; /* "render", "INPUT" */
    const char *summary;          /* one line of `help` */
    const char *text;             /* paragraphs of its --help; lines that begin with two spaces stay as they are */
    const char *examples;         /* shell lines: the tests run them */
    unsigned options;             /* groups of options that the command takes */
    int min_arguments, max_arguments;
    enum exit_code (*run)(struct cli *cli);
};

/* A topic that `help` explains: paragraphs, then names with texts. */
struct topic_row {
    const char *name, *text;
};
struct topic {
    const char *name, *summary, *text;
    const char *aliases;          /* other names, "|" around each: "|units|unit|" */
    const struct topic_row *rows; /* ends with {NULL}; NULL: none */
};

/* A program made of commands. */
struct program {
    const char *name, *about; /* "pellucid"; one line */
    const char *start;        /* lines of --help below the commands, or "" */
    const struct command *commands;
    size_t num_commands;
    struct absent_command {
        const char *name, *what, *hint;
    } absent;                               /* a command that this build lacks, and why; {NULL}: none */
    struct pell_communicator *communicator; /* set if the process is one of several that render together; NULL: alone */
};

enum option_group {
    OPTIONS_ALL = 1 << 0, /* --help, --version, --json, --quiet, --log-level: every command has them */
    OPTIONS_SCENE = 1 << 1,
    OPTIONS_METHOD = 1 << 2,
    OPTIONS_PICTURE = 1 << 3, /* rows of pell_settings_knobs() */
    OPTIONS_FILE = 1 << 4,    /* output files */
    OPTIONS_ENGINE = 1 << 5,
    OPTIONS_BENCH = 1 << 6,
    OPTIONS_PROFILE = 1 << 7,
    OPTIONS_COMPARE = 1 << 8, /* with the rows of pell_compare_knobs() */
    OPTIONS_CHECK = 1 << 9,
    OPTIONS_REPEATS = 1 << 10, /* of OPTIONS_BENCH, those that need no scene */
    OPTIONS_PARTS = 1 << 11,   /* parts of an image or of a sequence */
    OPTIONS_MERGE = 1 << 12,
    OPTIONS_VIEW = 1 << 13,
    OPTIONS_BAKE = 1 << 14,
    OPTIONS_CHOICE = 1 << 15, /* the choice of a method, in a single process */
};

struct settings_list {
    struct pell_setting *items;
    size_t count, capacity;
};

struct cli {
    const struct program *program;
    const struct command *command;
    char **arguments;
    int num_arguments;

    /* Options as given; NULL or false if absent. */
    char *output, *format, *method, *max_error, *material, *size, *unit, *camera, *engine, *device;
    char *up, *normals, *thicken, *from, *studio, *environment, *environment_scale, *environment_rotate, *background;
    char *time, *animation, *frames, *checkpoint, *checkpoint_every, *dump, *progress_form;
    bool json, quiet, stats, allow_outside, ground;
    struct {
        const char *const *parts;
        int count; /* 0: the option was not given */
    } merge;
    struct {
        char *samples, *tiles, *frames, *scenes, *input;
        bool partial;
    } part;
    struct {
        char *model, *compare, *gaussians, *eta, *roughness, *layers, *skin, *solver, *wavelength, *export, *from, *to;
        bool csv, shared, free_energy, weighted;
    } profile;
    struct {
        char *layer, *mask, *half, *methods, *reference;
        bool decompose;
    } compare;
    struct {
        char *cross_section, *line, *layers_of, *down_to;
    } check;
    struct {
        char *listen, *token_file, *end_after;
        bool no_open;
    } view;
    struct {
        struct settings_list inner; /* --inner NAME=FILE */
    } bake;
    struct {
        int threads, turntable, repeats, points, taps, rank, port, map_size;
    } numbers;
    enum pell_log_level log_level;
    enum { CLI_LOGS_ALL, CLI_LOGS_ERRORS, CLI_LOGS_NOTHING } logs; /* whatever log_level is: used while something is only tried */
    struct settings_list knobs;                                    /* --set NAME=VALUE */
    struct settings_list settings;                                 /* --width 640: rows of pell_settings_knobs() */
    struct settings_list common;                                   /* --samples 64: options that each method maps to one of its own knobs */
    struct pell_limits limits;                                     /* --limit NAME=VALUE */
    char command_line[2048];                                       /* for metadata, without folders of this machine */
    const char **words;                                            /* the original command line, borrowed */
    int num_words;
    bool of_a_file;        /* parsed from a checkpoint, not from the command line: prints nothing */
    const char *given[96]; /* names of the options on the command line, "taps" */
    int num_given;

    /* State. */
    struct pell_context *ctx;
    bool color_out, color_err, tty; /* tty: stderr is one */
    bool answered;                  /* an object has been written to stdout */
    int images;                     /* images written so far */
    bool partial;                   /* Ctrl-C ended the last image early */
    bool resumable;                 /* a checkpoint exists from which the run can be resumed */
    json_t *warnings;               /* array of texts */
    json_t *collected;              /* NULL, or warnings that only the answer holds: severity, where, what, hint */
    struct {
        enum pell_result code;
        char where[1024], what[2048], hint[1024];
        bool present;
    } error; /* the first one */
    struct {
        double begin, shown;   /* seconds */
        double fraction, from; /* current fraction; fraction at `begin` */
        int part, parts;       /* position in a longer job; parts 0: the task is the whole job */
        int width;             /* columns of the open progress line on a terminal, 0: none */
        char shorter[128];     /* the options that shorten the task; "": none, or said already */
    } progress;
};

/* --- help.c ------------------------------------------------------------------------------------------------------------------- */

void cli_print_usage(const struct program *program, FILE *file);
/* NULL: the program has no command of that name. */
const struct command *cli_find_command(const struct program *program, const char *name);
/* Reports a name that is no command or, for `help`, no topic either; suggests the nearest name. */
enum exit_code cli_unknown_command(struct cli *cli, const char *name, bool help);
/* `help WORDS`; without words: help on the whole program. Sets cli->command and *done to false where a command answers. */
enum exit_code cli_help(struct cli *cli, const char **words, int count, bool *done);

/* --- topics.c ----------------------------------------------------------------------------------------------------------------- */

/* Ends with {NULL}. */
extern const struct topic cli_topics[];

/* --- program.c ---------------------------------------------------------------------------------------------------------------- */

/* Runs the command that the arguments name. Returns the exit code of the process. */
int cli_main(const struct program *program, int argc, char **argv);

/* --- signals.c ---------------------------------------------------------------------------------------------------------------- */

/* Whether SIGTERM or SIGHUP has arrived: a batch system ends the job, or the terminal is closed. */
bool cli_terminated(void);
/* Exit code after an interruption: EXIT_RESUMABLE after SIGTERM or SIGHUP if a checkpoint exists to resume from, even an empty one. */
enum exit_code cli_interrupted(const struct cli *cli);
/* From here to the end of the command, a signal cancels its work. If cancelling takes long (a library builds a large structure) and no file
 * is half-written, the process exits by itself. A second signal ends it at once. */
void cli_signals_begin(struct cli *cli);
void cli_signals_end(void);
/* Reports, once, why there is no image or only a part of it. `code`: EXIT_INTERRUPTED or EXIT_RESUMABLE. */
void cli_say_interrupted(const struct cli *cli, enum exit_code code);

/* --- options.c ---------------------------------------------------------------------------------------------------------------- */

/* Parses what follows the command's name. EXIT_OK: continue; *done: --help was given and has been printed. */
enum exit_code cli_parse(struct cli *cli, int argc, const char **argv, bool *done);
void cli_print_help(const struct program *program, const struct command *command, FILE *file);
/* Whether a command has an option ("--msaa" or "msaa"); `print`: also prints its row. */
bool cli_print_option(const struct command *command, const char *name, bool print, FILE *file);
/* Names of the options of all commands, each as often as it occurs; at most `most`. */
size_t cli_option_names(const struct program *program, const char **names, size_t most);
void cli_finish(struct cli *cli);
/* Values of --log-level and --progress; end with NULL. */
extern const char *const cli_log_levels[], *const cli_progress_forms[];
/* Whether an option ("--taps") was given on the command line, whatever its value. */
bool cli_given(const struct cli *cli, const char *option);
/* The given options that another command takes, too, but for those of the method and the image: [{"name": "size", "value": "70mm"}, ...];
 * the value is null where an option has none. */
json_t *cli_given_options(const struct cli *cli, const struct command *other);
void cli_free_settings(struct settings_list *list);
PELL_NODISCARD enum pell_result cli_add_setting(struct settings_list *list, const char *name, const char *value, const char *where);
PELL_NODISCARD enum pell_result cli_append_settings(struct settings_list *to, const struct settings_list *from);
/* Adds "NAME=VALUE", and splits the text in place; `where` names the option. */
enum exit_code cli_add_pair(struct cli *cli, struct settings_list *list, const char *where, char *text);
/* Formats the knobs of a table whose values are not those of `usual` (NULL: all) as `name=value name=value`. */
void cli_format_knobs(const struct pell_knob *knobs, const void *values, const void *usual, char *text, size_t size);

/* --- words.c ------------------------------------------------------------------------------------------------------------------ */

/* Records the command line in shell syntax, for metadata. Of a path on this machine only the file name is kept. */
void cli_keep_command_line(struct cli *cli, int argc, const char **argv);

/* --- parts.c: parts of images and sequences, and the files that hold them --------------------------------------------------------- */

/* Parses "A:B", or "I/N": part I, from 0, of N parts of [0, total), in multiples of `unit`. `total` 0: not known. */
enum exit_code cli_range(struct cli *cli, const char *option, const char *text, int total, int unit, int *first, int *end);
/* Whether --sample-range and --tile-range have their form and go with the other options; call before the scene is read. */
enum exit_code cli_part_check(struct cli *cli);
struct session;
/* Fills in the samples, tiles and note of a checkpoint from the command line. The caller frees the note (free). */
enum exit_code cli_part(struct cli *cli, const struct session *s, struct pell_checkpoint *checkpoint, char **note);
/* The command line as a JSON array, from which `merge` knows the scene and the options; the caller frees it (free). NULL: not UTF-8, or too
 * long. */
char *cli_note(const struct cli *cli);
/* Keeps other runs from writing to a checkpoint while this one lives. *lock is for cli_unlock, -1: none. */
enum exit_code cli_lock(struct cli *cli, const char *path, int *lock);
void cli_unlock(const char *path, int *lock);

/* --- names.c ------------------------------------------------------------------------------------------------------------------ */

/* Whether a path ends as an image's does. */
bool cli_is_image(const char *path);
/* Adds a hint if the command has an option of this name: `did you mean the option "--bounces"?` */
bool cli_option_hint(const struct cli *cli, const char *name, struct pell_text *hint);
/* Refuses a key of a scene file's "render" that is none. */
enum exit_code cli_check_render_key(struct cli *cli, const struct pell_setting *setting);
/* Refuses a knob on the command line that no method has: it may be an option. */
enum exit_code cli_check_knob_names(struct cli *cli);
/* Refuses a knob that the method lacks if it is an option, or stands in the wrong place of a scene file. */
enum exit_code cli_check_knobs_of(struct cli *cli, const struct pell_method *method, const struct settings_list *given);

/* --- messages.c --------------------------------------------------------------------------------------------------------------- */

/* A usage error: printed (or kept for JSON), EXIT_USAGE. */
enum exit_code cli_usage(struct cli *cli, const char *where, const char *hint, const char *fmt, ...) PELL_PRINTF(4, 5);
/* Refuses the name of a limit that is none. */
enum exit_code cli_check_limit(struct cli *cli, const char *name);
/* EXIT_OK unless `path` is a file that has been read, under any name: a scene's texture, a mesh. `option` names the output. */
enum exit_code cli_spare_input(struct cli *cli, const char *option, const char *path);
/* The exit code for a failed library call. */
enum exit_code cli_failed(struct cli *cli, enum pell_result result);
void cli_message(void *cli, const struct pell_message *message);
void cli_progress(void *cli, const char *task, double fraction);
void cli_progress_end(struct cli *cli);
#define STDOUT_NAME "standard output" /* as pell_file_write calls it */
/* From here on only printing is left: a first Ctrl-C no longer cuts off what is being written to a pipe, a second one ends the program. */
void cli_answer_begins(void);
/* Prints the object and drops the reference. */
enum exit_code cli_print_json(struct cli *cli, json_t *object);
enum exit_code cli_print_version(struct cli *cli);
/* {"error": ...} on stdout, where --json was given and nothing was answered. */
void cli_print_json_error(struct cli *cli, enum exit_code code);
/* Escape sequences, or "" without colour: 0 plain, 1 bold, 2 dim, 31 red, 33 yellow, 36 cyan. `file` is stdout or stderr. */
const char *cli_style(const struct cli *cli, const FILE *file, int style);
/* Line length: the terminal's width, at most 96; 96 if the file is no terminal. */
int cli_columns(FILE *file);
/* Prints text in lines of at most cli_columns. `column`: current column; `indent`: where later lines begin. Lines of the text that begin
 * with two spaces are printed unchanged. */
void cli_wrap(FILE *file, int column, int indent, const char *text);
/* Prints shell lines, each whole unless it is too long for the terminal: then it is continued as the shell allows. */
void cli_print_shell(FILE *file, const char *lines);
/* A head and its text, which begins at `column`, or below the head where a terminal is too narrow for both. */
void cli_row(FILE *file, const char *head, int column, const char *text);
/* True if the reader of stdout has closed the pipe: failing to write then needs no message. */
bool cli_reader_left(void);
/* From here on warnings are kept for the answer, and printed only if an error replaces the answer. */
void cli_collect(struct cli *cli);
/* Numbers as JSON; null where they are not finite. */
json_t *cli_number(double value);
json_t *cli_numbers(const double *values, size_t count);
/* A JSON text from bytes of a file or the command line; invalid UTF-8 is replaced, so that the result is never NULL because of it. */
json_t *cli_text(const char *text);

/* --- session.c: what render, compare and bench share -------------------------------------------------------------------------- */

struct session {
    struct pell_scene *scene;
    struct pell_device *device;
    struct pell_renderer *renderer;
    const struct pell_method *method; /* NULL: no scattering */
    void *knobs;
    struct pell_settings settings;
    double load_seconds;
};

/* "30s", "5min", "2h", "250ms": a time needs its unit. */
enum exit_code cli_parse_seconds(struct cli *cli, const char *where, const char *text, double *seconds);
/* "1%" -> 0.01; range (0, 1]. */
enum exit_code cli_parse_percent(struct cli *cli, const char *where, const char *text, double *fraction);
/* Load parameters from the command line. */
enum exit_code cli_load_params(struct cli *cli, struct pell_load_params *params);
/* Values of --engine; ends with NULL. */
extern const char *const cli_engine_names[];
enum exit_code cli_engine(struct cli *cli, enum pell_engine *engine);
/* The folder named by PELL_SHADERS, whose shaders replace built-in ones; NULL: none. */
const char *cli_shaders(void);
/* The method that the command line or the scene file names, if that is known before the scene is read; NULL: none. */
bool session_method_ahead(struct cli *cli, const struct pell_method **method);
/* Loads `path`; options of the command line override those of the scene file. Creates no renderer. */
enum exit_code session_read(struct cli *cli, const char *path, struct session *s);
/* The same, and creates a renderer. */
enum exit_code session_open(struct cli *cli, const char *path, struct session *s);
/* The same at a time in seconds; NULL: the time on the command line. */
enum exit_code session_open_at(struct cli *cli, const char *path, const double *time, struct session *s);
/* Reloads the scene at a time in seconds; the rest of the session stays. */
enum exit_code session_move(struct cli *cli, const char *path, double time, struct session *s);
void session_close(struct session *s);
/* Lets a long render say by which options of its method it would be shorter. */
void session_shorten(struct cli *cli, const struct session *s);
/* Whether the session's engine has the method. */
bool session_runs(const struct session *s, const struct pell_method *method);
/* The settings for a method on a scene: the method's defaults, overridden by the scene file's options, then by the command line's. */
enum exit_code session_settings(struct cli *cli, const struct pell_scene *scene, const struct pell_method *method, const void *knobs,
                                struct pell_settings *settings);
/* Whether the options and knobs that a scene file gives for its image are valid. */
enum exit_code session_check(struct cli *cli, struct pell_scene *scene);
json_t *session_stages(const struct pell_render_result *image);
/* A channel of a layer ("": of the image itself), or NULL. */
const struct pell_channel *cli_channel(const struct pell_render_result *image, const char *layer, const char *name);
/* Processor time of all threads together. */
double cli_cpu_seconds(void);
/* Writes the image in a format of pell_write_format_at with metadata on how it was made; the hashes are used for EXR alone (0
 * elsewhere). */
PELL_NODISCARD enum pell_result session_write(struct cli *cli, const struct session *s, const struct pell_render_result *image,
                                              const char *path, const char *format, uint64_t scene_hash, uint64_t materials_hash);
/* The method if neither the command line nor the scene names one. */
#define CLI_DEFAULT_METHOD "screen-space"
/* Layers of light that was scattered inside a material; an image has some of them. */
extern const char *const cli_subsurface_layers[3];
/* The processor's name; "processor" if the system does not report one. */
void cli_device_name(char *name, size_t size);

/* --- commands/list.c, commands/materials.c: rows of tables as JSON --------------------------------------------------------------- */

json_t *cli_knob_json(const struct pell_knob *k);
json_t *cli_method_json(const struct cli *cli, const struct pell_method *m);
json_t *cli_material_json(const struct pell_material_entry *e);

/* --- Commands ------------------------------------------------------------------------------------------------------------------- */

enum exit_code command_render(struct cli *cli);
enum exit_code command_merge(struct cli *cli);
enum exit_code command_methods(struct cli *cli);
enum exit_code command_materials(struct cli *cli);
enum exit_code command_info(struct cli *cli);
enum exit_code command_check(struct cli *cli);
enum exit_code command_bench(struct cli *cli);
enum exit_code command_profile(struct cli *cli);
enum exit_code command_compare(struct cli *cli);
enum exit_code command_bake_layers(struct cli *cli);
/* Defined in src/viewer; absent if the build has no libwebsockets. */
enum exit_code command_view(struct cli *cli);

#endif
