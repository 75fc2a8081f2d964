/* SPDX-License-Identifier: MIT
 * slow_library.c - preloaded library: intercepts calls that take long and cannot be interrupted, and reports on stderr when one begins. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

void rtcCommitScene(void *scene);
int fsync(int fd);

static void wait_long(const char *what)
{
    struct timespec left = { .tv_sec = 5 };

    if (write(STDERR_FILENO, what, strlen(what)) > 0)
        while (nanosleep(&left, &left) != 0 && errno == EINTR)
            continue;
}

__attribute__((visibility("default"))) void rtcCommitScene(void *scene)
{
    void *next = dlsym(RTLD_NEXT, "rtcCommitScene");
    void (*call)(void *);

    memcpy(&call, &next, sizeof(call));
    wait_long("it builds\n");
    call(scene);
}

__attribute__((visibility("default"))) int fsync(int fd)
{
    (void) fd;
    wait_long("it writes\n");
    return 0;
}
