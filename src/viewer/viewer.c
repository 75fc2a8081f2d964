/* SPDX-License-Identifier: MIT
 * viewer.c - queues of the pages, between the server and the render thread. */
#include "viewer/viewer.h"

#include <stdlib.h>
#include <string.h>

enum pell_result viewer_init(struct cli *cli, struct pell_context *ctx, struct pell_context *parsing, struct viewer *v)
{
    pthread_condattr_t attributes;

    *v = (struct viewer) { .cli = cli, .ctx = ctx, .parsing = parsing };
    if (pthread_mutex_init(&v->lock, NULL) != 0)
        return PELL_ERR_NOMEM;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    if (pthread_cond_init(&v->wake, &attributes) != 0) {
        pthread_mutex_destroy(&v->lock);
        return PELL_ERR_NOMEM;
    }
    return PELL_OK;
}

void viewer_outgoing_free(struct viewer_outgoing *message)
{
    free(message);
}

static void empty(struct viewer_page *p)
{
    viewer_message_destroy(&p->view);
    for (int i = 0; i < p->num_tasks; i++)
        viewer_message_destroy(&p->tasks[i]);
    for (int i = 0; i < VIEWER_IMAGE_KINDS; i++)
        viewer_outgoing_free(p->images[i]);
    for (struct viewer_outgoing *n = p->queue, *next; n; n = next) {
        next = n->next;
        viewer_outgoing_free(n);
    }
    *p = (struct viewer_page) { .number = 0 };
}

void viewer_finish(struct viewer *v)
{
    for (int i = 0; i < VIEWER_PAGES; i++)
        empty(&v->pages[i]);
    free(v->hello);
    pthread_cond_destroy(&v->wake);
    pthread_mutex_destroy(&v->lock);
}

/* --- Pages ---------------------------------------------------------------------------------------------------------------------------- */

struct viewer_page *viewer_page_of(struct viewer *v, uint64_t number)
{
    for (int i = 0; i < VIEWER_PAGES; i++)
        if (number && v->pages[i].number == number)
            return &v->pages[i];
    return NULL;
}

struct viewer_page *viewer_page_open(struct viewer *v)
{
    struct viewer_page *page = NULL;

    pthread_mutex_lock(&v->lock);
    for (int i = 0; i < VIEWER_PAGES && !page; i++)
        if (!v->pages[i].number)
            page = &v->pages[i];
    if (page) {
        page->number = ++v->pages_ever;
        page->queue_end = &page->queue;
    }
    pthread_mutex_unlock(&v->lock);
    return page;
}

/* Called with the lock held. */
static void wake_worker(struct viewer *v)
{
    if (v->refining)
        pell_context_cancel(v->ctx);
    pthread_cond_signal(&v->wake);
}

void viewer_page_close(struct viewer *v, uint64_t number)
{
    struct viewer_page *page;

    pthread_mutex_lock(&v->lock);
    if ((page = viewer_page_of(v, number))) {
        empty(page);
        wake_worker(v);
    }
    pthread_mutex_unlock(&v->lock);
}

bool viewer_page_ready(const struct viewer_page *page)
{
    for (int i = 0; i < VIEWER_IMAGE_KINDS; i++)
        if (page->images[i])
            return false;
    return page->num_in_flight < VIEWER_IN_FLIGHT;
}

/* Images arrive in order: older ones are acknowledged, too. */
static void acknowledge(struct viewer_page *page, int64_t serial)
{
    int left = 0;

    for (int i = 0; i < page->num_in_flight; i++)
        if (page->in_flight[i] > serial)
            page->in_flight[left++] = page->in_flight[i];
    page->num_in_flight = left;
}

/* The page shows only the last profile, so a newer request replaces one that waits. */
static bool is_replaced(const struct viewer_message *m)
{
    return m->type == VIEWER_PROFILE && !m->export;
}

/* Takes a task, or what it replaces is left in *message. False: too many wait. */
static bool enqueue(struct viewer_page *page, struct viewer_message **message)
{
    struct viewer_message *m = *message;
    int at = 0;

    while (at < page->num_tasks && !(is_replaced(m) && is_replaced(page->tasks[at])))
        at++;
    if (at == VIEWER_TASKS)
        return false;
    *message = at < page->num_tasks ? page->tasks[at] : NULL;
    page->num_tasks += at == page->num_tasks;
    page->tasks[at] = m;
    return true;
}

enum accepted { ACCEPTED, TOO_MANY, DAMAGED };

static enum accepted accept_locked(struct viewer *v, struct viewer_page *page, struct viewer_message **message)
{
    struct viewer_message *m = *message, *old;

    switch (m->type) {
    case VIEWER_ACK:
        if (m->id > page->sent)
            return DAMAGED;
        acknowledge(page, m->id);
        pthread_cond_signal(&v->wake);
        return ACCEPTED;
    case VIEWER_VIEW:
        old = page->view;
        page->view = m;
        *message = old;
        wake_worker(v);
        return ACCEPTED;
    case VIEWER_SAVE:
    case VIEWER_PICK:
    case VIEWER_PROFILE:
        if (!enqueue(page, message))
            return TOO_MANY;
        wake_worker(v);
        return ACCEPTED;
    }
    return DAMAGED;
}

/* The page must not wait for a file that is not made. */
static void refuse(struct viewer *v, uint64_t number, const struct viewer_message *m)
{
    viewer_send(v, number,
                json_pack("{s:s,s:s,s:s,s:s,s:s}", "type", "message", "level", "warning", "where", "viewer", "what",
                          "too many requests are waiting", "hint", "try again when those before it are done"),
                -1, NULL, 0);
    if (m->type == VIEWER_SAVE || m->export)
        viewer_send(v, number, json_pack("{s:s,s:I}", "type", "unsaved", "id", (json_int_t) m->id), -1, NULL, 0);
}

bool viewer_accept(struct viewer *v, uint64_t number, struct viewer_message *message)
{
    struct viewer_page *page;
    enum accepted accepted = ACCEPTED;

    pthread_mutex_lock(&v->lock);
    if ((page = viewer_page_of(v, number)))
        accepted = accept_locked(v, page, &message);
    pthread_mutex_unlock(&v->lock);
    if (accepted == TOO_MANY)
        refuse(v, number, message);
    viewer_message_destroy(&message);
    return accepted != DAMAGED;
}

/* --- News ----------------------------------------------------------------------------------------------------------------------------- */

static struct viewer_outgoing *make_outgoing(const char *head, const uint8_t *file, size_t size)
{
    const size_t length = strlen(head), before = file ? 4 : 0;
    struct viewer_outgoing *n = malloc(sizeof(*n) + VIEWER_ROOM + before + length + size);

    if (!n)
        return NULL;
    *n = (struct viewer_outgoing) { .binary = file != NULL, .kind = -1, .size = before + length + size };
    n->bytes = (unsigned char *) (n + 1) + VIEWER_ROOM;
    for (size_t i = 0; i < before; i++)
        n->bytes[i] = (unsigned char) (length >> 8 * i);
    memcpy(n->bytes + before, head, length);
    if (size)
        memcpy(n->bytes + before + length, file, size);
    return n;
}

/* Called with the lock held. */
static struct viewer_outgoing *enter(struct viewer_page *page, struct viewer_outgoing *n)
{
    struct viewer_outgoing *old = NULL;

    if (n->kind >= 0) {
        old = page->images[n->kind];
        page->images[n->kind] = n;
        return old;
    }
    if (page->num_queued == VIEWER_QUEUE_MAX) { /* the page does not read them */
        old = page->queue;
        page->queue = old->next;
        if (page->queue_end == &old->next)
            page->queue_end = &page->queue;
    } else {
        page->num_queued++;
    }
    *page->queue_end = n;
    page->queue_end = &n->next;
    return old;
}

void viewer_send(struct viewer *v, uint64_t number, json_t *head, int kind, uint8_t *file, size_t size)
{
    struct viewer_page *page;
    struct viewer_outgoing *n = NULL;
    int64_t serial = 0;
    char *text;

    if (kind >= 0) {
        pthread_mutex_lock(&v->lock);
        serial = ++v->serials;
        pthread_mutex_unlock(&v->lock);
        json_object_set_new(head, "serial", json_integer(serial));
    }
    text = head ? json_dumps(head, JSON_COMPACT | JSON_REAL_PRECISION(9)) : NULL;
    json_decref(head);
    if (text)
        n = make_outgoing(text, file, size);
    free(text);
    free(file);
    if (!n)
        return;
    n->kind = kind;
    n->serial = serial;
    pthread_mutex_lock(&v->lock);
    if ((page = viewer_page_of(v, number)))
        n = enter(page, n);
    if (v->notify)
        v->notify(v);
    pthread_mutex_unlock(&v->lock);
    viewer_outgoing_free(n);
}

void viewer_greet(struct viewer *v, uint64_t number)
{
    struct viewer_outgoing *n = make_outgoing(v->hello, NULL, 0);
    struct viewer_page *page;

    pthread_mutex_lock(&v->lock);
    if (n && (page = viewer_page_of(v, number)))
        n = enter(page, n);
    pthread_mutex_unlock(&v->lock);
    viewer_outgoing_free(n);
}

void viewer_files_changed(struct viewer *v)
{
    pthread_mutex_lock(&v->lock);
    v->files_changed = true;
    wake_worker(v);
    pthread_mutex_unlock(&v->lock);
}

void viewer_send_image(struct viewer *v, uint64_t number, int64_t id, enum viewer_image_kind kind, const struct viewer_sent *s)
{
    json_t *head =
        json_pack("{s:s,s:i,s:I,s:i,s:i,s:s,s:b,s:f,s:f,s:f,s:f,s:o*}", "type", "picture", "picture", (int) kind, "id", (json_int_t) id,
                  "width", s->width, "height", s->height, "mime", s->mime, "still", s->still, "ms", 1e3 * s->seconds, "encode_ms",
                  1e3 * s->encode_seconds, "exposure", (double) s->exposure, "white", (double) s->white, "stages", s->stages);

    viewer_send(v, number, head, (int) kind, s->file, s->size);
}

struct viewer_outgoing *viewer_next(struct viewer *v, uint64_t number)
{
    struct viewer_page *page;
    struct viewer_outgoing *n = NULL;

    pthread_mutex_lock(&v->lock);
    page = viewer_page_of(v, number);
    if (page && page->queue) {
        n = page->queue;
        page->queue = n->next;
        page->num_queued--;
        if (!page->queue)
            page->queue_end = &page->queue;
    }
    for (int i = 0; page && !n && i < VIEWER_IMAGE_KINDS; i++)
        if (page->images[i] && page->num_in_flight < VIEWER_IN_FLIGHT) {
            n = page->images[i];
            page->images[i] = NULL;
            page->sent = n->serial;
            page->in_flight[page->num_in_flight++] = n->serial;
        }
    pthread_mutex_unlock(&v->lock);
    return n;
}
