/* SPDX-License-Identifier: MIT
 *
 * films.c - the films of a run: their pixels, and the files they are read from and written to.
 */
#include "methods/path_trace/run.h"

#include "base/file.h"
#include "base/hash.h"

#include <stdio.h>
#include <unistd.h>

static const char another_view[] = "is of another view of this scene";
static const char hint_view[] = "name another file, or remove this one to begin anew";

void pt_rank_path(const char *path, int rank, char *out, size_t size)
{
    if (rank == 0)
        snprintf(out, size, "%s", path);
    else
        snprintf(out, size, "%s" PT_RANK_SUFFIX "%d", path, rank);
}

void pt_drop_films(struct pt_state *st)
{
    for (size_t i = 0; i < st->num_films; i++)
        pt_film_free(st->ctx, &st->films[i]);
}

struct pt_checkpoint_key pt_make_key(const struct pt_state *st, const struct pell_frame *in)
{
    const struct pt_knobs *k = &st->knobs.trace;
    struct pt_checkpoint_key key = {
        .width = (uint32_t) in->shape.width,
        .height = (uint32_t) in->shape.height,
        .films = (uint32_t) st->num_films,
        .scene = pell_scene_hash(st->services->scene),
        .seed = st->services->settings->seed,
        .words = { [PT_KEY_NORMALS] = k->normals,
                   [PT_KEY_BOUNDARY] = k->boundary,
                   [PT_KEY_ACCELERATION] = k->acceleration,
                   [PT_KEY_EVENTS] = k->events,
                   [PT_KEY_BOUNCES] = k->bounces,
                   [PT_KEY_TECHNIQUES] = (int32_t) k->techniques,
                   [PT_KEY_SURFACE] = st->knobs.surface,
                   [PT_KEY_SETTING] = st->services->settings->boundary,
                   [PT_KEY_HALF] = k->half },
        .roulette = k->roulette,
        .exponent = pt_scene_exponent(st->scene),
    };
    const char *version = pell_version_string();

    memcpy(key.version, version, strnlen(version, sizeof(key.version) - 1));
    return key;
}

/* --- Reading -------------------------------------------------------------------------------------------------------------------------- */

enum pell_result pt_read_file(struct pt_state *st, const struct pt_checkpoint_key *key, const char *path, struct pt_film *films)
{
    uint8_t *data;
    size_t size;
    enum pell_result res = pell_file_read(st->ctx, path, &data, &size);

    if (res != PELL_OK)
        return res;
    res = pt_checkpoint_decode(st->ctx, path, data, size, key, films);
    pell_free(st->ctx, data);
    return res;
}

enum pell_result pt_merge_film(struct pt_state *st, const char *path, struct pt_film *film, struct pt_film *more)
{
    size_t tile;
    uint32_t sample;
    enum pell_result res;

    if (more->identity == 0) /* it was not begun */
        return PELL_OK;
    if (film->identity == 0) {
        pt_film_free(st->ctx, film);
        *film = *more;
        memset(more, 0, sizeof(*more));
        return PELL_OK;
    }
    if (film->identity != more->identity || film->count != more->count ||
        memcmp(film->starts, more->starts, (film->tiles + 1) * sizeof(*film->starts)) != 0)
        return pell_error(st->ctx, PELL_ERR_INVALID, path, hint_view, another_view);
    res = pt_film_merge(st->ctx, film, more, &tile, &sample);
    if (res == PELL_ERR_INVALID)
        pell_error(st->ctx, res, path, "leave out one of the files", "overlaps the files before it: both have sample %u of tile %zu",
                   sample * (uint32_t) st->num_films, tile);
    return res;
}

static enum pell_result read_parts(struct pt_state *st, const struct pt_checkpoint_key *key)
{
    const struct pell_checkpoint *checkpoint = st->services->checkpoint;
    struct pt_film *films = pell_calloc(st->ctx, st->num_films, sizeof(*films));
    enum pell_result res = films ? PELL_OK : PELL_ERR_NOMEM;

    for (int i = 0; res == PELL_OK && i < checkpoint->num_parts; i++) {
        res = pt_read_file(st, key, checkpoint->parts[i], films);
        for (size_t f = 0; res == PELL_OK && f < st->num_films; f++)
            res = pt_merge_film(st, checkpoint->parts[i], &st->films[f], &films[f]);
        for (size_t f = 0; f < st->num_films; f++)
            pt_film_free(st->ctx, &films[f]);
    }
    pell_free(st->ctx, films);
    return res;
}

enum pell_result pt_read_films(struct pt_state *st, const struct pell_frame *in)
{
    const struct pt_checkpoint_key key = pt_make_key(st, in);
    const char *path = st->services->checkpoint->path;

    if (pt_merges(st))
        return read_parts(st, &key);
    return access(path, F_OK) == 0 ? pt_read_file(st, &key, path, st->films) : PELL_OK;
}

enum pell_result pt_write_films(struct pt_state *st, const struct pell_frame *in, bool last)
{
    const struct pt_checkpoint_key key = pt_make_key(st, in);
    const struct pell_checkpoint *checkpoint = st->services->checkpoint;
    const bool result = last && (checkpoint->end_sample > 0 || checkpoint->end_tile > 0 || pt_merges(st));
    enum pell_result res;
    char path[4096 + 16];
    uint8_t *data;
    size_t size;

    if (!checkpoint->path)
        return PELL_OK;
    pt_rank_path(checkpoint->path, pt_communicator(st) ? pt_communicator(st)->rank : 0, path, sizeof(path));
    pell_log_downgrade(st->ctx, last ? 0 : 1);
    res = pt_checkpoint_encode(st->ctx, &key, checkpoint->note, st->films, &data, &size);
    if (res == PELL_OK) {
        res = pell_file_write(st->ctx, path, data, size);
        if (res != PELL_OK && !last)
            pell_warn(st->ctx, path, NULL, "the checkpoint was not written; the render continues");
        pell_free(st->ctx, data);
    }
    pell_log_downgrade(st->ctx, last ? 0 : -1);
    st->unwritten = res != PELL_OK;
    st->written = pell_seconds();
    return result ? res : PELL_OK;
}

/* --- Pixels ------------------------------------------------------------------------------------------------------------------------- */

/* Adds the pixels of a tile to the list, if there is one, and their positions to the hash of the film. */
static uint8_t list_tile(const struct pt_run *run, size_t tile, uint32_t *pixel_index, uint64_t *identity)
{
    const struct pell_frame *in = run->in;
    const int columns = (in->shape.width + PT_TILE - 1) / PT_TILE, left = (int) (tile % (size_t) columns) * PT_TILE;
    const int top = (int) (tile / (size_t) columns) * PT_TILE;
    uint8_t count = 0;

    for (int y = top > in->rect.y0 ? top : in->rect.y0; y < top + PT_TILE && y < in->rect.y1; y++)
        for (int x = left > in->rect.x0 ? left : in->rect.x0; x < left + PT_TILE && x < in->rect.x1; x++) {
            const size_t at = (size_t) (y * in->shape.stride + x);
            if (!in->material[at])
                continue;
            if (pixel_index) {
                const float p[3] = { in->position[0][at], in->position[1][at], in->position[2][at] };
                pixel_index[count] = (uint32_t) at;
                *identity = pell_hash_word(*identity, (uint64_t) x | (uint64_t) y << 16 | (uint64_t) in->material[at] << 32);
                *identity = pell_hash_bytes(*identity, p, sizeof(p));
            }
            count++;
        }
    return count;
}

/* Lists the pixels, and their number per tile. */
static enum pell_result list_pixels(struct pt_run *run, uint8_t *pixels, size_t tiles, size_t *total, uint64_t *identity)
{
    struct pt_state *st = run->st;
    size_t count = 0;

    for (size_t t = 0; t < tiles; t++)
        count += pixels[t] = list_tile(run, t, NULL, NULL);
    *total = count;
    if (count > st->pixel_index_capacity) {
        uint32_t *grown = pell_realloc_array(st->ctx, st->pixel_index, count, sizeof(*grown));
        if (!grown)
            return PELL_ERR_NOMEM;
        st->pixel_index = grown;
        st->pixel_index_capacity = count;
    }
    *identity = 1;
    count = 0;
    for (size_t t = 0; t < tiles; t++)
        if (pixels[t] > 0)
            count += list_tile(run, t, st->pixel_index + count, identity);
    return PELL_OK;
}

static bool same_layout(const struct pt_film *film, const uint8_t *pixels, size_t count)
{
    for (size_t t = 0; t < film->tiles; t++)
        if (film->starts[t + 1] - film->starts[t] != pixels[t])
            return false;
    return film->count == count;
}

enum pell_result pt_start_film(struct pt_run *run)
{
    struct pt_state *st = run->st;
    struct pt_film *film = run->film;
    const size_t tiles = pt_tiles((uint32_t) run->in->shape.width, (uint32_t) run->in->shape.height);
    uint64_t identity;
    uint8_t *pixels;
    size_t count;
    enum pell_result res = PELL_ERR_NOMEM;

    if (tiles > st->tiles_capacity) {
        pixels = pell_realloc_array(st->ctx, st->tile_pixels, tiles, sizeof(*pixels));
        if (!pixels)
            return res;
        st->tile_pixels = pixels;
        st->tiles_capacity = tiles;
    }
    pixels = st->tile_pixels;
    PELL_TRY(list_pixels(run, pixels, tiles, &count, &identity));
    if (st->services->checkpoint && film->identity != 0) {
        res = film->identity == identity && same_layout(film, pixels, count)
                  ? PELL_OK
                  : pell_error(st->ctx, PELL_ERR_INVALID,
                               st->services->checkpoint->path ? st->services->checkpoint->path : st->services->checkpoint->parts[0],
                               hint_view, another_view);
        goto fail;
    }
    if (film->identity == identity && film->pixels && same_layout(film, pixels, count)) { /* the previous frame had the same view */
        memset(film->pixels, 0, count * sizeof(*film->pixels));
        memset(film->num_spans, 0, tiles * sizeof(*film->num_spans));
        goto fail;
    }
    pt_film_free(st->ctx, film);
    PELL_TRY(pt_film_create(st->ctx, pixels, tiles, film));
    film->identity = identity;
    film->exponent = pt_scene_exponent(st->scene);

fail:
    return res;
}

enum pell_result pt_check_gaps(const struct pt_run *run, uint32_t end)
{
    struct pt_state *st = run->st;
    const bool partial = st->services->checkpoint->mode == PELL_CHECKPOINT_MERGE_PARTIAL;
    const struct pt_film *film = run->film;
    const uint32_t msaa = (uint32_t) st->num_films;
    size_t tiles = 0, black = 0, first = 0;
    uint32_t from = 0, to = 0;

    for (size_t t = 0; t < film->tiles; t++) {
        uint32_t next, missing = pt_film_missing(film, t, 0, &next);
        if (film->starts[t] == film->starts[t + 1] || missing >= end)
            continue;
        black += film->num_spans[t] == 0;
        if (tiles++ > 0)
            continue;
        first = t;
        from = missing;
        to = next < end ? next : end;
    }
    if (tiles > 0 && !partial)
        return pell_error(st->ctx, PELL_ERR_INVALID, st->services->checkpoint->parts[0],
                          "render the missing part, or use `pellucid merge --partial`, which accepts gaps",
                          "these files leave gaps: samples %u:%u are missing in %s, the first is tile %zu", from * msaa, to * msaa,
                          pell_counted((long long) tiles, "tile", "tiles").str, first);
    if (tiles > 0 && !st->gaps)
        pell_warn(st->ctx, st->services->checkpoint->parts[0], NULL,
                  "a partial image: %s samples, the first is tile %zu without %u:%u; %s black",
                  pell_counted((long long) tiles, "tile lacks", "tiles lack").str, first, from * msaa, to * msaa,
                  pell_counted((long long) black, "tile has none and is", "tiles have none and are").str);
    st->gaps = st->gaps || tiles > 0;
    return PELL_OK;
}
