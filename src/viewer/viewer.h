/* SPDX-License-Identifier: MIT
 *
 * viewer.h - state shared by the server (the main thread) and the render thread. The members below the lock are guarded by it, but for the
 * last two.
 *
 *     page --view--> server --newest view of each page--> worker --images, messages--> server --> page --ack--> server
 *
 * A page has at most two images in flight; until it acknowledges one, nothing is rendered for it. Refinement of static views is cancelled
 * when any page sends a view.
 */
#ifndef PELL_VIEWER_H
#define PELL_VIEWER_H

#include "cli/cli.h"
#include "viewer/message.h"

#include <pthread.h>

#define VIEWER_PAGES 8
#define VIEWER_TASKS 8       /* queued saves, picks and profiles of one page */
#define VIEWER_IMAGE_KINDS 5 /* kinds of images */
#define VIEWER_IN_FLIGHT 2   /* images that a page has not acknowledged */
#define VIEWER_QUEUE_MAX 64  /* queued texts for one page */

enum viewer_image_kind { VIEWER_IMAGE_A, VIEWER_IMAGE_B, VIEWER_IMAGE_REFERENCE, VIEWER_IMAGE_ERROR_A, VIEWER_IMAGE_ERROR_B };

/* A message to a page: JSON, or 4 bytes of the length of a JSON head (little endian), the head, and a file. Allocated by malloc. */
struct viewer_outgoing {
    struct viewer_outgoing *next;
    bool binary;
    int kind; /* enum viewer_image_kind; -1: no image */
    int64_t serial;
    size_t size;
    unsigned char *bytes; /* preceded by room for the WebSocket header */
};

struct viewer_page {
    uint64_t number; /* id of the connection; 0: free */
    struct viewer_message *view;
    struct viewer_message *tasks[VIEWER_TASKS];
    int num_tasks;
    struct viewer_outgoing *images[VIEWER_IMAGE_KINDS]; /* the newest of each kind */
    struct viewer_outgoing *queue, **queue_end;
    int num_queued;
    int64_t sent;                        /* number of the last image sent */
    int64_t in_flight[VIEWER_IN_FLIGHT]; /* images sent and not acknowledged */
    int num_in_flight;
};

struct viewer {
    struct cli *cli;
    struct pell_context *ctx;     /* of the worker; cancelling it ends the refinement */
    struct pell_context *parsing; /* for parsing messages from pages */
    char *hello;                  /* the tables as JSON: constant after the start */

    pthread_mutex_t lock;
    pthread_cond_t wake; /* the worker's */
    struct viewer_page pages[VIEWER_PAGES];
    bool stop, refining, files_changed;
    uint64_t pages_ever;
    int64_t serials;                  /* counts images */
    void (*notify)(struct viewer *v); /* wakes the server; callable from any thread */
    void *server;

    /* Used by the worker only. */
    uint64_t serving; /* page being served; 0: none. Log messages go there */
    double progress;  /* time of the last progress message to a page */
};

/* --- viewer.c: queues of the pages; the caller holds the lock where stated --------------------------------------------------- */

PELL_NODISCARD enum pell_result viewer_init(struct cli *cli, struct pell_context *ctx, struct pell_context *parsing, struct viewer *v);
void viewer_finish(struct viewer *v);
/* The page of a connection, or NULL. Called with the lock held. */
struct viewer_page *viewer_page_of(struct viewer *v, uint64_t number);
/* Takes a free page for a new connection; NULL: none is free. */
struct viewer_page *viewer_page_open(struct viewer *v);
void viewer_page_close(struct viewer *v, uint64_t number);
/* Accepts a message of a page; takes ownership. What comes while VIEWER_TASKS wait is refused with a message. False: it is damaged. */
bool viewer_accept(struct viewer *v, uint64_t number, struct viewer_message *message);
/* Sends JSON (the reference is dropped) with a file (may be NULL; allocated by malloc, freed here) to a page, which may have gone. */
void viewer_send(struct viewer *v, uint64_t number, json_t *head, int kind, uint8_t *file, size_t size);
/* A rendered image. `file` is allocated by malloc. */
struct viewer_sent {
    int width, height;
    const char *mime;
    bool still; /* final quality, as in `pellucid render` */
    double seconds, encode_seconds;
    float exposure, white;
    json_t *stages; /* NULL: none */
    uint8_t *file;
    size_t size;
};
/* Sends it, and takes ownership of its members. `id`: of the view that it shows. */
void viewer_send_image(struct viewer *v, uint64_t number, int64_t id, enum viewer_image_kind kind, const struct viewer_sent *image);
/* Sends `hello`. */
void viewer_greet(struct viewer *v, uint64_t number);
/* The input's files have changed: they are reloaded. */
void viewer_files_changed(struct viewer *v);
/* The next message for a page, which the caller frees; NULL: none. */
struct viewer_outgoing *viewer_next(struct viewer *v, uint64_t number);
void viewer_outgoing_free(struct viewer_outgoing *message);
/* Whether the page can receive an image. Called with the lock held. */
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

/* Loads the scene, and starts the render thread. Takes ownership of the document. */
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
    bool open;           /* open a browser */
    const char *folder;  /* folder whose files are watched, */
    const char *shaders; /* and a folder of shaders to watch; NULL: none */
    const char *token;   /* required of pages */
    double end_after;    /* seconds without a page until it ends; 0: ten minutes, or an hour before the first */
};

/* EXIT_OK if a server can listen; the obstacle is logged. *port 0 is replaced by a free one. */
enum exit_code viewer_find_port(struct cli *cli, const char *address, int *port);
/* Serves pages until Ctrl-C, or until none has been open for a while, which is said. */
enum exit_code viewer_serve(struct viewer *v, const struct viewer_server_params *params);

/* Room before viewer_outgoing.bytes. */
#define VIEWER_ROOM 32

#endif
