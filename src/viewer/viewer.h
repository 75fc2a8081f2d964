/* SPDX-License-Identifier: MIT
 *
 * viewer.h - what the server (the main thread) and the thread that renders share. All members below the lock are guarded by it.
 *
 *     page --view--> server --newest view of each page--> worker --pictures, news--> server --> page --ack--> server
 *
 * A page has two pictures under way at most; until it acknowledges one, nothing is rendered for it. What is refined while nothing moves is
 * cancelled when any page sends a view.
 */
#ifndef PELL_VIEWER_H
#define PELL_VIEWER_H

#include "cli/cli.h"
#include "viewer/message.h"

#include <pthread.h>

#define VIEWER_PAGES 8
#define VIEWER_TASKS 8      /* saves and picks of one page that wait */
#define VIEWER_PICTURES 5   /* kinds of pictures */
#define VIEWER_UNDER_WAY 2  /* pictures that a page has not acknowledged */
#define VIEWER_NEWS_MOST 64 /* texts that wait for one page */

enum viewer_picture_kind { VIEWER_PICTURE_A, VIEWER_PICTURE_B, VIEWER_PICTURE_REFERENCE, VIEWER_PICTURE_ERROR_A, VIEWER_PICTURE_ERROR_B };

/* A message to a page: JSON, or 4 bytes of the length of a JSON head (little endian), the head, and a file. Allocated by malloc. */
struct viewer_news {
    struct viewer_news *next;
    bool binary;
    int kind; /* enum viewer_picture_kind; -1: no picture */
    int64_t serial;
    size_t size;
    unsigned char *bytes; /* room for the network's head stands before them */
};

struct viewer_page {
    uint64_t number; /* of the connection; 0: free */
    struct viewer_message *view;
    struct viewer_message *tasks[VIEWER_TASKS];
    int num_tasks;
    struct viewer_news *pictures[VIEWER_PICTURES]; /* the newest of each kind */
    struct viewer_news *news, **news_end;
    int num_news;
    int64_t sent;                        /* number of the last picture */
    int64_t under_way[VIEWER_UNDER_WAY]; /* pictures sent and not acknowledged */
    int num_under_way;
};

struct viewer {
    struct cli *cli;
    struct pell_context *ctx;     /* of the worker; its cancellation ends what is being refined */
    struct pell_context *parsing; /* of messages from pages */
    char *hello;                  /* the tables as JSON: constant after the start */

    pthread_mutex_t lock;
    pthread_cond_t wake; /* the worker's */
    struct viewer_page pages[VIEWER_PAGES];
    bool stop, refining, files_changed;
    uint64_t pages_ever;
    int64_t serials;                  /* of pictures */
    void (*notify)(struct viewer *v); /* wakes the server; any thread */
    void *server;

    /* The worker's own. */
    uint64_t serving; /* page that is served; 0: none. What is logged goes there */
    double progress;  /* when a page heard of progress last */
};

/* --- viewer.c: what waits for a page; the caller holds the lock where it says so --------------------------------------------------- */

PELL_NODISCARD enum pell_result viewer_init(struct cli *cli, struct pell_context *ctx, struct pell_context *parsing, struct viewer *v);
void viewer_finish(struct viewer *v);
/* A page of a connection, or NULL. With the lock. */
struct viewer_page *viewer_page_of(struct viewer *v, uint64_t number);
/* Takes a free page for a new connection; NULL: there is none. */
struct viewer_page *viewer_page_open(struct viewer *v);
void viewer_page_close(struct viewer *v, uint64_t number);
/* Hands a message of a page over; takes the message. False: it asks for too much. */
bool viewer_accept(struct viewer *v, uint64_t number, struct viewer_message *message);
/* Sends JSON (the reference is dropped) with a file (may be NULL; allocated by malloc, freed here) to a page that may have gone. */
void viewer_send(struct viewer *v, uint64_t number, json_t *head, int kind, uint8_t *file, size_t size);
/* An image that was made. `file` is allocated by malloc. */
struct viewer_sent {
    int width, height;
    const char *mime;
    bool still; /* as `pellucid render` makes it */
    double seconds, encode_seconds;
    float exposure, white;
    json_t *stages; /* NULL: none */
    uint8_t *file;
    size_t size;
};
/* Sends it, and takes what it holds. `id`: of the view that it shows. */
void viewer_send_picture(struct viewer *v, uint64_t number, int64_t id, enum viewer_picture_kind kind, const struct viewer_sent *picture);
/* Sends `hello`. */
void viewer_greet(struct viewer *v, uint64_t number);
/* The input's files have changed: they are read again. */
void viewer_files_changed(struct viewer *v);
/* The next message for a page, which the caller frees; NULL: none. */
struct viewer_news *viewer_next(struct viewer *v, uint64_t number);
void viewer_news_free(struct viewer_news *news);
/* Whether the page takes a picture. With the lock. */
bool viewer_page_ready(const struct viewer_page *page);

/* --- files.c, made from page/ by embed.py ------------------------------------------------------------------------------------------- */

struct viewer_file {
    const char *path, *type; /* "/", "text/html; charset=utf-8" */
    const unsigned char *bytes;
    size_t size;
};
extern const struct viewer_file viewer_files[];
extern const size_t viewer_num_files;

/* --- worker.c ------------------------------------------------------------------------------------------------------------------------- */

struct viewer_document;
struct viewer_worker;

/* Loads the scene, and starts the thread that renders. Takes the document. */
PELL_NODISCARD enum pell_result viewer_worker_start(struct viewer *v, struct pell_device *device, struct viewer_document *document,
                                                    struct viewer_worker **out);
/* Sets *worker to NULL; destroying &(NULL) does nothing. */
void viewer_worker_stop(struct viewer_worker **worker);
/* The log and the progress of the worker's context. */
void viewer_worker_log(void *viewer, const struct pell_message *message);
void viewer_worker_progress(void *viewer, const char *task, double fraction);

/* --- server.c ------------------------------------------------------------------------------------------------------------------------- */

struct viewer_server_params {
    const char *address; /* to listen at */
    int port;            /* 0: any */
    bool open;           /* a browser */
    const char *folder;  /* whose files are watched, */
    const char *shaders; /* and those of this one; NULL: none */
    const char *token;   /* what a page needs */
};

/* EXIT_OK where a server can listen; what keeps it from that is logged. *port 0 becomes one that is free. */
enum exit_code viewer_find_port(struct cli *cli, const char *address, int *port);
/* Serves pages until Ctrl-C, or until none has been open for a while. */
enum exit_code viewer_serve(struct viewer *v, const struct viewer_server_params *params);

/* Room before viewer_news.bytes. */
#define VIEWER_ROOM 32

#endif
