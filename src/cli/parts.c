/* SPDX-License-Identifier: MIT
 * parts.c - which part of an image or of a sequence a run renders, and the files that hold such parts. */
#include "cli/cli.h"

#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define NOTE_BYTES_MOST 60000
#define LARGEST 1000000000 /* above every number of a range */

/* Parses a whole number up to the character `end`; *text is moved to it. */
static bool whole_number(const char **text, char end, int *value)
{
    const char *stop = strchr(*text, end);
    const size_t length = stop ? (size_t) (stop - *text) : 0;

    if (length < 1 || length > 9 || strspn(*text, "0123456789") != length)
        return false;
    *value = atoi(*text);
    *text = stop;
    return true;
}

enum exit_code cli_range(struct cli *cli, const char *option, const char *text, int total, int unit, int *first, int *end)
{
    const bool is_fraction = strchr(text, '/') != NULL;
    const char *at = text;
    int a, b;

    if (!whole_number(&at, is_fraction ? '/' : ':', &a) || (at++, !whole_number(&at, '\0', &b)))
        return cli_usage(cli, option, NULL, "\"%s\", must be A:B, or I/N for part I, from 0, of N", text);
    if (is_fraction) {
        const int units = (total + unit - 1) / unit;
        if (total <= 0)
            return cli_usage(cli, option, "give --samples, or A:B", "\"%s\" is a part of a number that is not known", text);
        if (a >= b)
            return cli_usage(cli, option, NULL, "\"%s\", must be 0/%d to %d/%d", text, b, b - 1, b);
        *first = unit * (int) ((int64_t) units * a / b);
        *end = unit * (int) ((int64_t) units * (a + 1) / b);
        if (*first == *end)
            return cli_usage(cli, option, NULL, "\"%s\" is empty: there are %d parts at most", text, units);
        return EXIT_OK;
    }
    if (a >= b)
        return cli_usage(cli, option, NULL, "\"%s\" is empty: B must be above A", text);
    if (total > 0 && b >= total && b < total + unit) /* the last batch may be longer than requested */
        b = (total + unit - 1) / unit * unit;
    if (total > 0 && b > (total + unit - 1) / unit * unit)
        return cli_usage(cli, option, NULL, "\"%s\" ends beyond %d", text, total);
    if (a % unit != 0 || b % unit != 0)
        return cli_usage(cli, option, NULL, "\"%s\", must be multiples of --msaa %d", text, unit);
    *first = a;
    *end = b;
    return EXIT_OK;
}

char *cli_note(const struct cli *cli)
{
    json_t *words = json_array();
    char *text;

    for (int i = 1; i < cli->num_words; i++) /* 0 is the command */
        json_array_append_new(words, json_string(cli->words[i]));
    text = (int) json_array_size(words) == cli->num_words - 1 ? json_dumps(words, JSON_COMPACT) : NULL;
    json_decref(words);
    if (text && strlen(text) > NOTE_BYTES_MOST) {
        free(text);
        text = NULL;
    }
    return text;
}

enum exit_code cli_part_check(struct cli *cli)
{
    const struct {
        const char *option, *text;
    } parts[] = { { "--sample-range", cli->part.samples }, { "--tile-range", cli->part.tiles } };
    enum exit_code code = EXIT_OK;

    for (size_t i = 0; i < PELL_COUNT(parts) && code == EXIT_OK; i++) {
        int first, end;
        if (!parts[i].text)
            continue;
        if (!cli->checkpoint)
            return cli_usage(cli, parts[i].option, "--checkpoint part.ckpt", "the part goes into a checkpoint: name one");
        if (cli_given(cli, "--target-error"))
            return cli_usage(cli, parts[i].option, NULL, "the error is that of the whole image: a part does not go with --target-error");
        code = cli_range(cli, parts[i].option, parts[i].text, LARGEST, 1, &first, &end); /* its form: the total is not known yet */
    }
    return code;
}

enum exit_code cli_part(struct cli *cli, const struct session *s, struct pell_checkpoint *checkpoint, char **note)
{
    const struct pell_knob *knob = s->method ? pell_knob_find(s->method->knobs, "samples") : NULL;
    const int tiles = (s->settings.width + 7) / 8 * ((s->settings.height + 7) / 8);
    static const char *const stops[] = { "--time-limit", "--target-error" };
    int samples = knob ? *(const int *) ((const char *) s->knobs + knob->offset) : 0;
    enum exit_code code = EXIT_OK;

    if (samples == 0 && !cli_given(cli, stops[0]) && !cli_given(cli, stops[1]))
        samples = 64; /* the method's default */
    if (cli->part.samples)
        code = cli_range(cli, "--sample-range", cli->part.samples, samples, s->settings.msaa, &checkpoint->first_sample,
                         &checkpoint->end_sample);
    if (code == EXIT_OK && cli->part.tiles)
        code = cli_range(cli, "--tile-range", cli->part.tiles, tiles, 1, &checkpoint->first_tile, &checkpoint->end_tile);
    *note = code == EXIT_OK ? cli_note(cli) : NULL;
    checkpoint->note = *note;
    return code;
}

/* --- Locks ---------------------------------------------------------------------------------------------------------------------- */

static bool lock_name(const char *path, char name[4096 + 8])
{
    return snprintf(name, 4096 + 8, "%s.lock", path) < 4096 + 8;
}

enum exit_code cli_lock(struct cli *cli, const char *path, int *lock)
{
    char name[4096 + 8], who[128] = "";

    *lock = -1;
    if (!lock_name(path, name))
        return EXIT_OK;
    for (int attempt = 0; attempt < 100; attempt++) {
        struct flock all = { .l_type = F_WRLCK, .l_whence = SEEK_SET };
        struct stat mine, there;
        const int fd = open(name, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
        int n;

        if (fd < 0)
            return EXIT_OK; /* the folder is not writable: writing the checkpoint reports it */
        if (fcntl(fd, F_SETLK, &all) != 0) {
            const int code = errno;
            const ssize_t size = read(fd, who, sizeof(who) - 1);
            char shown[sizeof(who)];
            close(fd);
            if (code != EACCES && code != EAGAIN)
                return EXIT_OK; /* a file system without locks: files are replaced as a whole there, too */
            who[size > 0 ? size : 0] = '\0';
            return cli_failed(cli, pell_error(cli->ctx, PELL_ERR_IO, path, "wait for it, or name another file",
                                              "another run writes to this checkpoint%s%s", who[0] ? ": " : "",
                                              pell_printable(who, shown, sizeof(shown))));
        }
        if (fstat(fd, &mine) != 0 || stat(name, &there) != 0 || mine.st_ino != there.st_ino || mine.st_dev != there.st_dev) {
            close(fd); /* the previous run removed it between the two calls */
            continue;
        }
        gethostname(who, 64);
        n = snprintf(who + strlen(who), 40, " process %ld", (long) getpid());
        if (n > 0 && (ftruncate(fd, 0) != 0 || pwrite(fd, who, strlen(who), 0) < 0))
            errno = 0; /* the name only helps the message */
        *lock = fd;
        return EXIT_OK;
    }
    return EXIT_OK;
}

void cli_unlock(const char *path, int *lock)
{
    char name[4096 + 8];

    if (*lock < 0)
        return;
    if (lock_name(path, name))
        unlink(name);
    close(*lock);
    *lock = -1;
}
