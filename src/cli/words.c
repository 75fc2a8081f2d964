/* SPDX-License-Identifier: MIT
 * words.c - the command line as one line of text. */
#include "cli/cli.h"

#include <string.h>

static void add_word(char *line, size_t size, size_t *n, const char *word, size_t length)
{
    for (size_t i = 0; i < length && *n + 1 < size; i++)
        line[(*n)++] = word[i];
    line[*n] = '\0';
}

void cli_keep_command_line(struct cli *cli, int argc, const char **argv)
{
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_./:=,+-@%#";
    const size_t size = sizeof(cli->command_line);
    size_t n = 0;

    add_word(cli->command_line, size, &n, cli->program->name, strlen(cli->program->name));
    for (int i = 0; i < argc; i++) {
        const char *equals = argv[i][0] == '-' ? strchr(argv[i], '=') : NULL, *value = equals ? equals + 1 : argv[i], *end, *name;
        char shown[1024];

        for (end = value + strlen(value); *value == '/' && end > value + 1 && end[-1] == '/'; end--)
            ;
        for (name = *value == '/' ? end : value; name > value && name[-1] != '/'; name--)
            ;
        snprintf(shown, sizeof(shown), "%.*s%.*s", (int) (value - argv[i] < 256 ? value - argv[i] : 256), argv[i],
                 (int) (end - name < 512 ? end - name : 512), name);
        add_word(cli->command_line, size, &n, " ", 1);
        if (shown[0] && strspn(shown, plain) == strlen(shown)) {
            add_word(cli->command_line, size, &n, shown, strlen(shown));
            continue;
        }
        add_word(cli->command_line, size, &n, "'", 1);
        for (const char *c = shown; *c; c++)
            add_word(cli->command_line, size, &n, *c == '\'' ? "'\\''" : c, *c == '\'' ? 4 : 1);
        add_word(cli->command_line, size, &n, "'", 1);
    }
}
