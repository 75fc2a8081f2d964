/* SPDX-License-Identifier: MIT
 * bench.c - what the benches share: the scene and the method that are timed, errors against a picture, rows as a table or as JSON. */
#include "cli/bench.h"

#include "base/simd.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum exit_code bench_open(struct bench *b, struct cli *cli, const char *path)
{
    enum exit_code code;

    memset(b, 0, sizeof(*b));
    cli->stats = true; /* times are compared with copies */
    b->cli = cli;
    b->repeats = cli->numbers.repeats;
    code = session_open(cli, path, &b->s);
    b->s.settings.msaa = 1;
    return code;
}

void bench_close(struct bench *b)
{
    session_close(&b->s);
    free(b->truth);
    b->truth = NULL;
}

enum pell_result bench_choose(struct bench *b, const char *method, const struct pell_setting *settings, size_t count)
{
    const struct pell_method *m = pell_method_find(b->cli->ctx, "bench", method);
    void *values = m ? calloc(1, m->knobs_size) : NULL;
    enum pell_result res = m ? PELL_ERR_NOMEM : PELL_ERR_INVALID;

    if (values)
        res = pell_method_configure(b->cli->ctx, m, settings, count, values);
    if (res == PELL_OK)
        res = pell_renderer_set_method(b->s.renderer, m, values);
    free(values);
    return res;
}

enum pell_result bench_stretch(struct bench *b, double factor)
{
    for (size_t i = 0; i < b->s.scene->num_materials; i++)
        for (int c = 0; c < 3; c++) {
            b->s.scene->materials[i].medium.sigma_a[c] /= factor;
            b->s.scene->materials[i].medium.sigma_s_reduced[c] /= factor;
        }
    return pell_renderer_set_scene(b->s.renderer, b->s.scene);
}

bool bench_is_common(const char *stage)
{
    static const char *const names[] = { "prepare", "surface", "irradiance", "lit", "composite", "post" };

    for (size_t i = 0; i < PELL_COUNT(names); i++)
        if (strcmp(stage, names[i]) == 0)
            return true;
    return false;
}

/* --- Errors --------------------------------------------------------------------------------------------------------------------- */

enum pell_result bench_keep_truth(struct bench *b, const struct pell_picture *p)
{
    const size_t width = (size_t) p->width, height = (size_t) p->height;

    free(b->truth);
    b->truth = calloc(width * height, 4 * sizeof(*b->truth));
    if (!b->truth)
        return PELL_ERR_NOMEM;
    b->truth_width = p->width;
    b->truth_height = p->height;
    for (size_t c = 0; c < 4; c++)
        for (size_t y = 0; y < height; y++)
            memcpy(b->truth + (c * height + y) * width, p->channels[c].data + (ptrdiff_t) y * p->channels[c].stride,
                   width * sizeof(*b->truth));
    return PELL_OK;
}

double bench_error(const struct bench *b, const struct pell_picture *p)
{
    const size_t size = (size_t) p->width * (size_t) p->height;
    double square = 0.0, sum = 0.0, count = 0.0;

    if (!b->truth || b->truth_width != p->width || b->truth_height != p->height)
        return (double) NAN;
    for (int y = 0; y < p->height; y++)
        for (int x = 0; x < p->width; x++) {
            const float *truth = b->truth + (size_t) y * (size_t) p->width + (size_t) x;
            for (size_t c = 0; c < 3 && truth[3 * size] >= 1.0f; c++) {
                const double t = (double) truth[c * size], d = (double) p->channels[c].data[y * p->channels[c].stride + x] - t;
                square += d * d;
                sum += t;
                count += 1.0;
            }
        }
    return sum > 0.0 ? sqrt(square * count) / sum : 0.0;
}

/* --- Rows ----------------------------------------------------------------------------------------------------------------------- */

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return (x > y) - (x < y);
}

double bench_median(double *values, int count)
{
    qsort(values, (size_t) count, sizeof(*values), by_value);
    return count % 2 ? values[count / 2] : 0.5 * (values[count / 2 - 1] + values[count / 2]);
}

struct row *bench_add(struct rows *rows, const char *name, double ms)
{
    struct row *r;
    if (rows->count == PELL_COUNT(rows->items))
        return NULL;
    r = &rows->items[rows->count++];
    *r = (struct row) { .ms = ms, .error = (double) NAN, .work = (double) NAN };
    snprintf(r->name, sizeof(r->name), "%s", name);
    return r;
}

struct row *bench_add_stage(struct rows *rows, const char *name, double ms, const struct pell_stage_time *stage)
{
    struct row *r = bench_add(rows, name, ms);

    if (r) {
        r->pixels = stage->pixels;
        r->rays = stage->rays;
        r->bytes = stage->bytes;
        r->copy_ms = stage->copy_ms;
        r->ratio = stage->copy_ms > 0.0 ? ms / stage->copy_ms : 0.0;
        r->against = "copy";
    }
    return r;
}

enum pell_result bench_frame(struct pell_renderer *renderer, const struct pell_settings *settings, struct pell_picture *picture)
{
    const enum pell_result res = pell_renderer_render(renderer, settings, picture);
    return res == PELL_OK && picture->partial ? PELL_ERR_CANCELLED : res;
}

json_t *bench_json(const struct rows *rows)
{
    json_t *list = json_array();

    for (size_t i = 0; i < rows->count; i++) {
        const struct row *r = &rows->items[i];
        json_t *o = json_pack("{s:s,s:f,s:I,s:I,s:I,s:f}", "name", r->name, "ms", r->ms, "pixels", (json_int_t) r->pixels, "rays",
                              (json_int_t) r->rays, "bytes", (json_int_t) r->bytes, "copy_ms", r->copy_ms);
        if (o && r->against) {
            json_object_set_new(o, "ratio", json_real(r->ratio));
            json_object_set_new(o, "ratio_to", json_string(r->against));
        }
        if (o && isfinite(r->error))
            json_object_set_new(o, "error", json_real(r->error));
        if (o && isfinite(r->work))
            json_object_set_new(o, "work_variance", json_real(r->work));
        if (o && r->items)
            json_object_set_new(o, "each_ns", json_real(1e6 * r->ms / (double) r->items));
        json_array_append_new(list, o);
    }
    return list;
}

void bench_print(const struct rows *rows, unsigned columns, const char *items)
{
    int width = 26;

    for (size_t i = 0; i < rows->count; i++)
        width = (int) strlen(rows->items[i].name) > width ? (int) strlen(rows->items[i].name) : width;
    printf("%-*s %9s", width, "row", "ms");
    printf("%s%s", columns & BENCH_PIXELS ? "     pixels" : "", columns & BENCH_RAYS ? "       rays" : "");
    printf("%s", columns & BENCH_COPY ? "   copy ms" : "");
    if (items)
        printf(" %*s", (int) strlen(items) > 10 ? (int) strlen(items) : 10, items);
    printf("%s  ratio\n", columns & BENCH_ERROR ? "   error %" : "");
    for (size_t i = 0; i < rows->count; i++) {
        const struct row *r = &rows->items[i];
        char text[5][32] = { "" };
        const bool memory = r->ms == 0.0 && r->bytes; /* the row is of megabytes, as its name says */
        snprintf(text[0], sizeof(text[0]), "%.*f", memory ? 1 : 2, memory ? (double) r->bytes / 1048576.0 : r->ms);
        if (r->pixels) {
            snprintf(text[1], sizeof(text[1]), "%lld", (long long) r->pixels);
            snprintf(text[2], sizeof(text[2]), "%lld", (long long) r->rays);
            snprintf(text[3], sizeof(text[3]), "%.2f", r->copy_ms);
        }
        if (r->items && r->ms > 0.0)
            snprintf(text[4], sizeof(text[4]), "%.4g", 1e3 * (double) r->items / r->ms);
        printf("%-*s %9s", width, r->name, text[0]);
        if (columns & BENCH_PIXELS)
            printf(" %10s", text[1]);
        if (columns & BENCH_RAYS)
            printf(" %10s", text[2]);
        if (columns & BENCH_COPY)
            printf(" %9s", text[3]);
        if (items)
            printf(" %*s", (int) strlen(items) > 10 ? (int) strlen(items) : 10, text[4]);
        if (columns & BENCH_ERROR && isfinite(r->error))
            printf(" %9.3f", 100.0 * r->error);
        else if (columns & BENCH_ERROR)
            printf(" %9s", "");
        if (r->against && r->ratio > 0.0)
            printf("  %.2f x %s", r->ratio, r->against);
        putchar('\n');
    }
}

enum exit_code bench_answer(const struct bench *b, const char *what, unsigned columns, const char *items, const char *fmt, ...)
{
    const struct pell_renderer *r = b->s.renderer;
    const int threads = pell_renderer_threads(r);
    const char *engine = pell_engine_name(pell_renderer_engine(r));
    char device[160], build[64];
    va_list args;

    cli_device_name(device, sizeof(device));
    snprintf(build, sizeof(build), "%s, SIMD level %s", pell_version(), pell_simd_name(pell_simd_best()));
    if (b->cli->json)
        return cli_print_json(b->cli, json_pack("{s:s,s:s,s:s,s:i,s:s,s:i,s:i,s:i,s:o}", "bench", what, "engine", engine, "device", device,
                                                "threads", threads, "build", build, "width", b->s.settings.width, "height",
                                                b->s.settings.height, "repeats", b->repeats, "rows", bench_json(&b->rows)));
    printf("%s: engine %s, %d threads, %s\npellucid %s\n", what, engine, threads, device, build);
    va_start(args, fmt);
    vprintf(fmt, args);
    va_end(args);
    fputs("\n\n", stdout);
    bench_print(&b->rows, columns, items);
    return EXIT_OK;
}
