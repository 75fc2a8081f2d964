/* SPDX-License-Identifier: MIT
 * bench.c - what every bench shares, those of the papers, too: times of frames, rows as a table or as JSON. */
#include "cli/bench.h"

#include "base/simd.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

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
        r->bandwidth_ms = stage->bandwidth_ms;
        r->ratio = stage->bandwidth_ms > 0.0 ? ms / stage->bandwidth_ms : 0.0;
        r->against = "copy";
    }
    return r;
}

enum pell_result bench_frame(struct pell_renderer *renderer, const struct pell_settings *settings, struct pell_render_result *image)
{
    const enum pell_result res = pell_renderer_render(renderer, settings, image);
    return res == PELL_OK && image->partial ? PELL_ERR_CANCELLED : res;
}

json_t *bench_json(const struct rows *rows)
{
    json_t *list = json_array();

    for (size_t i = 0; i < rows->count; i++) {
        const struct row *r = &rows->items[i];
        json_t *o = json_pack("{s:s,s:f,s:I,s:I,s:I,s:f}", "name", r->name, "ms", r->ms, "pixels", (json_int_t) r->pixels, "rays",
                              (json_int_t) r->rays, "bytes", (json_int_t) r->bytes, "copy_ms", r->bandwidth_ms);
        if (o && r->against) {
            json_object_set_new(o, "ratio", json_real(r->ratio));
            json_object_set_new(o, "ratio_to", json_string(r->against));
        }
        if (o && r->frame_ms > 0.0)
            json_object_set_new(o, "frame_ms", json_real(r->frame_ms));
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
    printf("%s", columns & BENCH_FRAME ? "     frame" : "");
    printf("%s%s", columns & BENCH_PIXELS ? "     pixels" : "", columns & BENCH_RAYS ? "       rays" : "");
    printf("%s", columns & BENCH_COPY ? "   copy ms" : "");
    if (items)
        printf(" %*s", (int) strlen(items) > 10 ? (int) strlen(items) : 10, items);
    printf("%s%s  ratio\n", columns & BENCH_ERROR ? "   error %" : "", columns & BENCH_WORK ? "      work" : "");
    for (size_t i = 0; i < rows->count; i++) {
        const struct row *r = &rows->items[i];
        char text[5][32] = { "" };
        const bool memory = r->ms == 0.0 && r->bytes; /* the row measures megabytes, as its name says */
        snprintf(text[0], sizeof(text[0]), "%.*f", memory ? 1 : r->ms < 1.0 ? 4 : 2, memory ? (double) r->bytes / 1048576.0 : r->ms);
        if (r->pixels) {
            snprintf(text[1], sizeof(text[1]), "%lld", (long long) r->pixels);
            snprintf(text[2], sizeof(text[2]), "%lld", (long long) r->rays);
            snprintf(text[3], sizeof(text[3]), "%.2f", r->bandwidth_ms);
        }
        if (r->items && r->ms > 0.0)
            snprintf(text[4], sizeof(text[4]), "%.4g", 1e3 * (double) r->items / r->ms);
        printf("%-*s %9s", width, r->name, text[0]);
        if (columns & BENCH_FRAME && r->frame_ms > 0.0)
            printf(" %9.2f", r->frame_ms);
        else if (columns & BENCH_FRAME)
            printf(" %9s", "");
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
        if (columns & BENCH_WORK && isfinite(r->work))
            printf(" %9.3g", r->work);
        else if (columns & BENCH_WORK)
            printf(" %9s", "");
        if (r->against && r->ratio > 0.0)
            printf("  %.*f x %s", r->ratio < 0.1 ? 4 : 2, r->ratio, r->against);
        putchar('\n');
    }
}

enum exit_code bench_answer(struct cli *cli, const char *what, json_t *facts, const struct rows *rows, unsigned columns, const char *items,
                            const char *setup)
{
    char device[160], build[64];

    cli_device_name(device, sizeof(device));
    snprintf(build, sizeof(build), "%s, SIMD level %s", pell_version_string(), pell_simd_name(pell_simd_best()));
    if (cli->json) {
        json_t *answer =
            json_pack("{s:o,s:s,s:s,s:i}", "bench", cli_text(what), "device", device, "build", build, "repeats", cli->numbers.repeats);
        if (answer && facts)
            json_object_update(answer, facts);
        json_decref(facts);
        json_object_set_new(answer, "rows", bench_json(rows));
        return cli_print_json(cli, answer);
    }
    json_decref(facts);
    printf("%s: %s\npellucid %s\n%s\n\n", what, device, build, setup);
    bench_print(rows, columns, items);
    return EXIT_OK;
}
