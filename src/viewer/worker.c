/* SPDX-License-Identifier: MIT
 * worker.c - the render thread: renders the newest view of each page immediately, at a size that meets the time target; then, while nothing
 * moves, the same view in the quality of `pellucid render`, and after that an accumulating reference. */
#include "viewer/encode.h"
#include "viewer/model.h"
#include "viewer/profile.h"
#include "viewer/truth.h"
#include "viewer/viewer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define TARGET_SECONDS 0.045 /* for rendering and encoding a moving image, of the 80 ms from input to photon */
#define MIN_SCALE 0.25       /* of moving images */
#define MIN_SCALE_SLOW 0.15
#define PROGRESS_INTERVAL 0.2 /* seconds between two progress messages */

enum step { STEP_PREVIEW_A, STEP_PREVIEW_B, STEP_STILL_A, STEP_STILL_B, STEP_TRUTH, STEP_DONE };

/* The worker's state for a page. */
struct pane {
    uint64_t number;
    struct viewer_message *view; /* the last view */
    enum step step;
    double scale;   /* of moving images */
    int timed;      /* number of images timed at this scale */
    double seconds; /* time of one, smoothed */
    char *setup;    /* methods for which `scale` was measured */
    struct viewer_truth *truth;
    uint64_t announced_loads; /* model.loads of the scene whose facts the page has received */
};

struct viewer_worker {
    struct viewer *v;
    struct viewer_model model;
    struct pane panes[VIEWER_PAGES];
    uint64_t last_served; /* index of the page whose view or task was done last */
    pthread_t thread;
    bool started;
};

/* --- Messages to pages ---------------------------------------------------------------------------------------------------------------- */

void viewer_worker_log(void *viewer, const struct pell_message *m)
{
    static const char *const levels[] = { "", "error", "warning", "info", "debug" };
    struct viewer *v = viewer;

    if (m->level > PELL_LOG_WARNING || m->code == PELL_ERR_CANCELLED)
        return;
    viewer_send(v, v->serving,
                json_pack("{s:s,s:s,s:o,s:o,s:o}", "type", "message", "level", levels[m->level], "where", cli_text(m->where), "what",
                          cli_text(m->what), "hint", cli_text(m->hint)),
                -1, NULL, 0);
}

void viewer_worker_progress(void *viewer, const char *task, double fraction)
{
    struct viewer *v = viewer;
    const double now = pell_seconds();

    if (now - v->progress < PROGRESS_INTERVAL || fraction >= 1.0)
        return;
    v->progress = now;
    viewer_send(v, v->serving, json_pack("{s:s,s:s,s:f}", "type", "progress", "task", task, "fraction", fraction), -1, NULL, 0);
}

static const struct viewer_setup *setup_of(const struct viewer_message *view, bool other)
{
    return other ? &view->other : &view->setup;
}

/* --- Images --------------------------------------------------------------------------------------------------------------------------- */

static struct viewer_image display_of(const struct pell_render_result *image)
{
    return (struct viewer_image) {
        image->width, image->height, image->stride, { image->display[0], image->display[1], image->display[2] }, false
    };
}

static const struct pell_method *method_called(const char *name)
{
    for (size_t i = 0; name && i < pell_method_count(); i++)
        if (strcmp(pell_method_at(i)->name, name) == 0)
            return pell_method_at(i);
    return NULL;
}

/* A reference is slow: a newer view interrupts it. */
static bool is_slow(const struct viewer_setup *setup)
{
    const struct pell_method *method = method_called(setup->method);
    return method && method->kind == PELL_KIND_REFERENCE;
}

/* One sample per pixel for progressive methods. */
static struct viewer_setup quick_setup(const struct viewer_setup *setup)
{
    const struct pell_method *method = method_called(setup->method);
    struct viewer_setup quick = *setup;

    if (!method || !method->partial || !pell_knob_find(method->knobs, "samples"))
        return quick;
    quick.num_knobs = 0;
    for (size_t i = 0; i < setup->num_knobs; i++)
        if (strcmp(setup->knobs[i].name, "samples") != 0)
            quick.knobs[quick.num_knobs++] = setup->knobs[i];
    if (quick.num_knobs < VIEWER_SETTINGS_MOST)
        quick.knobs[quick.num_knobs++] = (struct pell_setting) { "samples", "1", "view" };
    return quick;
}

/* Renders a setup and sends it. */
static enum pell_result draw(struct viewer_worker *w, struct pane *p, bool other, const struct viewer_quality *quality, bool still)
{
    const enum viewer_slot slot = still ? (other ? VIEWER_STILL_B : VIEWER_STILL_A) : (other ? VIEWER_LIVE_B : VIEWER_LIVE_A);
    const bool lossless = still && !quality->quick;
    const struct viewer_setup setup = quality->quick ? quick_setup(setup_of(p->view, other)) : *setup_of(p->view, other);
    struct viewer_sent sent = { .still = lossless, .mime = lossless ? "image/png" : "image/jpeg" };
    struct pell_settings settings;
    struct pell_render_result image;
    struct viewer_image shown;
    double start;
    enum pell_result res;

    PELL_TRY(viewer_model_render(&w->model, slot, p->view, &setup, quality, &settings, &image));
    start = pell_seconds();
    shown = display_of(&image);
    if (lossless)
        PELL_TRY(viewer_encode_png(w->v->ctx, &shown, &sent.file, &sent.size));
    else
        PELL_TRY(viewer_encode_jpeg(w->v->ctx, &shown, still ? 92 : 82, &sent.file, &sent.size));
    sent.width = image.width;
    sent.height = image.height;
    sent.seconds = image.seconds;
    sent.encode_seconds = pell_seconds() - start;
    sent.exposure = settings.exposure;
    sent.white = settings.white;
    sent.stages = session_stages(&image);
    viewer_send_image(w->v, p->number, p->view->id, other ? VIEWER_IMAGE_B : VIEWER_IMAGE_A, &sent);
    return PELL_OK;

fail:
    return res;
}

/* Adapts the size of moving images to the time target, by the mean of several of one size: the first includes preparation, and other load
 * on the machine makes single ones late. */
static void adapt(struct pane *p, double seconds)
{
    const double least = is_slow(&p->view->setup) ? MIN_SCALE_SLOW : MIN_SCALE;
    double wanted;

    if (p->timed++ == 0)
        return;
    p->seconds = p->timed == 2 ? seconds : 0.75 * p->seconds + 0.25 * seconds;
    wanted = p->scale * sqrt(TARGET_SECONDS / fmax(p->seconds, 1e-3));
    if (p->timed < 6 && p->seconds < 4.0 * TARGET_SECONDS)
        return;
    wanted = fmin(fmax(0.05 * floor(20.0 * wanted), least), 1.0);
    if (wanted < 0.9 * p->scale || wanted > 1.2 * p->scale) {
        p->scale = wanted;
        p->timed = 0;
    }
}

/* A slow method starts at a small size. */
static void choose_scale(struct pane *p)
{
    const char *method = p->view->setup.method, *other = p->view->other.method;
    char text[256];
    const int n = snprintf(text, sizeof(text), "%s %s", method ? method : "", other ? other : "");

    if (n > 0 && (!p->setup || strcmp(text, p->setup) != 0)) {
        free(p->setup);
        p->setup = strdup(text);
        p->scale = method && strcmp(method, CLI_DEFAULT_METHOD) != 0 ? 0.25 : 0.5;
        p->timed = 0;
    }
}

static enum pell_result draw_moving(struct viewer_worker *w, struct pane *p)
{
    const double start = pell_seconds();
    struct viewer_quality quality = { .quick = true };
    enum pell_result res;

    choose_scale(p);
    quality.scale = p->scale;
    res = draw(w, p, false, &quality, false);
    if (res == PELL_OK && p->view->other.method)
        res = draw(w, p, true, &quality, false);
    if (res == PELL_OK)
        adapt(p, pell_seconds() - start);
    return res;
}

/* --- Work ----------------------------------------------------------------------------------------------------------------------------- */

/* Sends the facts of a loaded scene to the page. */
static void announce(struct viewer_worker *w, struct pane *p)
{
    if (p->announced_loads == w->model.loads)
        return;
    p->announced_loads = w->model.loads;
    viewer_send(w->v, p->number, viewer_model_facts(&w->model), -1, NULL, 0);
}

static void report_failure(struct viewer_worker *w, struct pane *p, enum pell_result res)
{
    if (res == PELL_ERR_CANCELLED)
        return;
    p->step = STEP_DONE;
    viewer_send(w->v, p->number, json_pack("{s:s,s:I}", "type", "failed", "id", (json_int_t) p->view->id), -1, NULL, 0);
}

static void take_view(struct viewer_worker *w, struct pane *p, struct viewer_message *view)
{
    enum pell_result res;

    viewer_message_destroy(&p->view);
    p->view = view;
    p->step = view->moving ? STEP_DONE : STEP_PREVIEW_A;
    viewer_truth_destroy(&p->truth);
    res = viewer_model_apply(&w->model, view, false);
    if (res == PELL_OK)
        announce(w, p);
    if (res == PELL_OK)
        res = draw_moving(w, p);
    if (res != PELL_OK)
        report_failure(w, p, res);
}

/* Whether an image with one multisample is much faster than the final one. */
static bool needs_preview(const struct viewer_worker *w, bool other)
{
    const struct pell_method *method = viewer_model_method(&w->model, other ? VIEWER_LIVE_B : VIEWER_LIVE_A);
    return !method || method->kind == PELL_KIND_METHOD;
}

static enum pell_result accumulate(struct viewer_worker *w, struct pane *p)
{
    enum pell_result res = PELL_OK;

    if (!p->view->truth) {
        p->step = STEP_DONE;
        return PELL_OK;
    }
    if (!p->truth)
        PELL_TRY(viewer_truth_create(w->v, p->number, p->view, &p->truth));
    PELL_TRY(viewer_truth_step(p->truth, &w->model));
    if (viewer_truth_done(p->truth))
        p->step = STEP_DONE;

fail:
    return res;
}

/* One step of refinement while nothing moves. */
static void refine(struct viewer_worker *w, struct pane *p)
{
    static const struct viewer_quality full = { .scale = 1.0 }, preview = { .scale = 1.0, .quick = true };
    const bool other = p->step == STEP_PREVIEW_B || p->step == STEP_STILL_B;
    enum pell_result res = viewer_model_apply(&w->model, p->view, true);

    if (res == PELL_OK)
        announce(w, p);
    if (res == PELL_OK && p->step == STEP_TRUTH) {
        res = accumulate(w, p);
    } else if (res == PELL_OK) {
        const bool still = p->step >= STEP_STILL_A;
        if ((!other || p->view->other.method) && (still || needs_preview(w, other)))
            res = draw(w, p, other, still ? &full : &preview, true);
        if (res == PELL_OK)
            p->step++;
    }
    if (res == PELL_OK && p->step == STEP_DONE)
        viewer_send(w->v, p->number, json_pack("{s:s,s:I}", "type", "rest", "id", (json_int_t) p->view->id), -1, NULL, 0);
    if (res != PELL_OK)
        report_failure(w, p, res);
}

/* Makes a file of the last view, allocated by malloc; errors are logged. */
static enum pell_result make_file(struct viewer_worker *w, struct pane *p, enum viewer_format format, uint8_t **file, size_t *size)
{
    static const struct viewer_quality all = { .scale = 1.0, .layers = true };
    struct pell_context *ctx = w->v->ctx;
    struct pell_settings settings;
    struct pell_render_result image;
    json_t *document;
    enum pell_result res;

    if (format == VIEWER_REPORT && !viewer_truth_compared(p->truth))
        return pell_error(ctx, PELL_ERR_INVALID, "report", "choose a reference under Compare, and wait for its first numbers",
                          "there is no error against a reference yet");
    if (format == VIEWER_REPORT)
        return viewer_truth_report(p->truth, &w->model, file, size);
    PELL_TRY(viewer_model_apply(&w->model, p->view, true));
    if (format == VIEWER_EXR) {
        PELL_TRY(viewer_model_render(&w->model, VIEWER_STILL_A, p->view, &p->view->setup, &all, &settings, &image));
        return viewer_encode_exr(ctx, &image, file, size);
    }
    document = viewer_model_saved(&w->model, p->view);
    *file = (uint8_t *) (document ? json_dumps(document, JSON_INDENT(2)) : NULL);
    *size = *file ? strlen((const char *) *file) : 0;
    json_decref(document);
    res = *file ? PELL_OK : PELL_ERR_NOMEM;

fail:
    return res;
}

/* Reports failure, too: the page must not wait for a file that can't be made. */
static void send_file(struct viewer_worker *w, struct pane *p, const struct viewer_message *m, const char *format, uint8_t *file,
                      size_t size)
{
    json_t *head = file ? json_pack("{s:s,s:I,s:s}", "type", "file", "id", (json_int_t) m->id, "format", format)
                        : json_pack("{s:s,s:I}", "type", "unsaved", "id", (json_int_t) m->id);

    viewer_send(w->v, p->number, head, -1, file, size);
}

static void save(struct viewer_worker *w, struct pane *p, const struct viewer_message *m)
{
    uint8_t *file = NULL;
    size_t size = 0;

    if (make_file(w, p, m->format, &file, &size) != PELL_OK)
        file = NULL;
    send_file(w, p, m, viewer_format_names[m->format], file, size);
}

static void bench_profile(struct viewer_worker *w, struct pane *p, const struct viewer_message *m)
{
    uint8_t *file = NULL;
    size_t size = 0;

    if (!m->export) {
        viewer_send(w->v, p->number, viewer_profile(w->v->ctx, m), -1, NULL, 0);
        return;
    }
    if (viewer_profile_code(w->v->ctx, m, &file, &size) != PELL_OK)
        file = NULL;
    send_file(w, p, m, m->export, file, size);
}

static void do_task(struct viewer_worker *w, struct pane *p, struct viewer_message *m)
{
    if (m->type == VIEWER_PROFILE) {
        bench_profile(w, p, m);
        return;
    }
    if (!p->view)
        return;
    if (m->type == VIEWER_SAVE)
        save(w, p, m);
    else if (viewer_model_apply(&w->model, p->view, false) == PELL_OK)
        viewer_send(w->v, p->number, viewer_model_pick(&w->model, m), -1, NULL, 0);
}

/* --- The thread ----------------------------------------------------------------------------------------------------------------------- */

/* The worker's state for a page; that of a closed connection is cleared. Called with the lock held. */
static struct pane *pane_of(struct viewer_worker *w, int i)
{
    struct pane *p = &w->panes[i];

    if (p->number != w->v->pages[i].number) {
        viewer_message_destroy(&p->view);
        viewer_truth_destroy(&p->truth);
        free(p->setup);
        *p = (struct pane) { .number = w->v->pages[i].number, .step = STEP_DONE };
    }
    return p;
}

struct job {
    struct pane *pane; /* NULL: none */
    struct viewer_message *view, *task;
};

/* Chooses the next job: pages take turns; views and tasks come before refinement. Called with the lock held. */
static struct job choose_job(struct viewer_worker *w)
{
    struct viewer *v = w->v;
    struct job refine_job = { NULL };
    int refined = 0;

    for (int k = 1; k <= VIEWER_PAGES; k++) {
        const int i = (int) ((w->last_served + (uint64_t) k) % VIEWER_PAGES);
        struct viewer_page *page = &v->pages[i];
        struct pane *p = pane_of(w, i);
        struct job job = { .pane = p };

        if (!page->number)
            continue;
        if (page->view && viewer_page_ready(page)) {
            job.view = page->view;
            page->view = NULL;
        } else if (page->num_tasks && !page->view) {
            job.task = page->tasks[0];
            page->num_tasks--;
            memmove(page->tasks, page->tasks + 1, (size_t) page->num_tasks * sizeof(*page->tasks));
        } else {
            if (!refine_job.pane && p->view && p->step < STEP_DONE && viewer_page_ready(page)) {
                refine_job = job;
                refined = i;
            }
            continue;
        }
        w->last_served = (uint64_t) i;
        return job;
    }
    if (refine_job.pane)
        w->last_served = (uint64_t) refined;
    return refine_job;
}

static void note_files(struct viewer_worker *w)
{
    w->v->files_changed = false;
    w->model.stale = true;
    for (int i = 0; i < VIEWER_PAGES; i++)
        if (w->panes[i].view) {
            w->panes[i].step = STEP_PREVIEW_A;
            viewer_truth_destroy(&w->panes[i].truth);
        }
}

static void *run(void *worker)
{
    struct viewer_worker *w = worker;
    struct viewer *v = w->v;

    pthread_mutex_lock(&v->lock);
    while (!v->stop) {
        struct job job;

        if (v->files_changed)
            note_files(w);
        job = choose_job(w);
        if (!job.pane) {
            pthread_cond_wait(&v->wake, &v->lock);
            continue;
        }
        v->serving = job.pane->number;
        v->refining = job.view ? is_slow(&job.view->setup) || is_slow(&job.view->other) : !job.task;
        pthread_mutex_unlock(&v->lock);
        if (job.view)
            take_view(w, job.pane, job.view);
        else if (job.task)
            do_task(w, job.pane, job.task);
        else
            refine(w, job.pane);
        viewer_message_destroy(&job.task);
        pthread_mutex_lock(&v->lock);
        v->refining = false;
        if (!v->stop)
            pell_context_resume(v->ctx);
    }
    pthread_mutex_unlock(&v->lock);
    return NULL;
}

enum pell_result viewer_worker_start(struct viewer *v, struct pell_device *device, struct viewer_document *document,
                                     struct viewer_worker **out)
{
    struct viewer_worker *w = calloc(1, sizeof(*w));
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!w)
        goto fail;
    w->v = v;
    PELL_TRY(viewer_model_open(v->ctx, device, document, &w->model));
    res = PELL_ERR_NOMEM;
    if (pthread_create(&w->thread, NULL, run, w) != 0)
        goto fail;
    w->started = true;
    *out = w;
    return PELL_OK;

fail:
    viewer_worker_stop(&w);
    return res;
}

void viewer_worker_stop(struct viewer_worker **worker)
{
    struct viewer_worker *w = *worker;

    if (!w)
        return;
    *worker = NULL;
    pthread_mutex_lock(&w->v->lock);
    w->v->stop = true;
    pell_context_cancel(w->v->ctx);
    pthread_cond_signal(&w->v->wake);
    pthread_mutex_unlock(&w->v->lock);
    if (w->started)
        pthread_join(w->thread, NULL);
    pell_context_resume(w->v->ctx);
    for (int i = 0; i < VIEWER_PAGES; i++) {
        viewer_message_destroy(&w->panes[i].view);
        viewer_truth_destroy(&w->panes[i].truth);
        free(w->panes[i].setup);
    }
    viewer_model_close(&w->model);
    free(w);
}
