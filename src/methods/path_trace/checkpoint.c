/* SPDX-License-Identifier: MIT
 *
 * checkpoint.c - serialisation of films. Integers are little-endian:
 *
 *     8 bytes "PELLPT\r\n"   detects conversion of line ends
 *     u32 version, width, height, films; u64 scene; i64 seed; i32 exponent; u32 bytes of the note
 *     f32 roulette, 9 x i32 knobs, 32 bytes version of the program; the note
 *     per film: u64 identity
 *         per tile: u8 pixels, u16 spans; per span u32 first, end
 *         per pixel of a tile with spans: 9 sums and 4 sums of squares of 128 bits
 *     u64 hash of all preceding bytes
 *
 * The hash detects damage. A forged file can only produce a wrong image of finite values.
 */
#include "methods/path_trace/path_trace.h"

#include "base/hash.h"

enum {
    VERSION = 3,
    NAME = 32,
    HEADER = 8 + 4 * 4 + 8 + 8 + 2 * 4 + 4 + 4 * PT_KEY_WORDS + NAME,
    TILE = 3,
    SPAN = 8,
    NUMBERS = 13,
    PIXEL = NUMBERS * 16,
    TRAILER = 8,
    FILMS = 64,
    NOTE = 1 << 16
};

static const uint8_t magic[8] = { 'P', 'E', 'L', 'L', 'P', 'T', '\r', '\n' };
static const char hint_other[] = "name another file, or remove this one to begin anew";
static const char hint_damaged[] = "remove it to begin anew";

static uint8_t *put(uint8_t *to, uint64_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        *to++ = (uint8_t) (value >> 8 * i);
    return to;
}

/* The unread bytes. */
struct reader {
    struct pell_context *ctx;
    const char *path;
    const uint8_t *at, *end;
};

static uint64_t get(struct reader *r, int bytes)
{
    uint64_t value = 0;
    for (int i = 0; i < bytes; i++)
        value |= (uint64_t) *r->at++ << 8 * i;
    return value;
}

static uint32_t get32(struct reader *r)
{
    return (uint32_t) get(r, 4);
}

/* Whether this number of bytes is unread. */
static bool has_bytes(const struct reader *r, uint64_t bytes)
{
    return (uint64_t) (r->end - r->at) >= bytes;
}

/* --- Writing ------------------------------------------------------------------------------------------------------------------------ */

/* A film that was not begun has no tiles; the file stores empty ones. */
static size_t film_size(const struct pt_checkpoint_key *key, const struct pt_film *f)
{
    size_t size = 8 + TILE * pt_tiles(key->width, key->height);

    for (size_t t = 0; t < f->tiles; t++) {
        size += SPAN * (size_t) f->num_spans[t];
        if (f->num_spans[t] > 0)
            size += PIXEL * (size_t) (f->starts[t + 1] - f->starts[t]);
    }
    return size;
}

static uint8_t *put_header(uint8_t *to, const struct pt_checkpoint_key *key, const char *note, size_t note_size)
{
    uint32_t bits;

    memcpy(to, magic, sizeof(magic));
    to = put(to + sizeof(magic), VERSION, 4);
    to = put(to, key->width, 4);
    to = put(to, key->height, 4);
    to = put(to, key->films, 4);
    to = put(to, key->scene, 8);
    to = put(to, (uint64_t) key->seed, 8);
    to = put(to, (uint32_t) key->exponent, 4);
    to = put(to, note_size, 4);
    memcpy(&bits, &key->roulette, sizeof(bits));
    to = put(to, bits, 4);
    for (int i = 0; i < PT_KEY_WORDS; i++)
        to = put(to, (uint32_t) key->words[i], 4);
    memcpy(to, key->version, NAME);
    if (note_size > 0)
        memcpy(to + NAME, note, note_size);
    return to + NAME + note_size;
}

static uint8_t *put_sum(uint8_t *to, const struct pt_sum *sum)
{
    return put(put(to, sum->low, 8), (uint64_t) sum->high, 8);
}

static uint8_t *put_film(uint8_t *to, const struct pt_checkpoint_key *key, const struct pt_film *f)
{
    to = put(to, f->identity, 8);
    if (f->tiles == 0) {
        memset(to, 0, TILE * pt_tiles(key->width, key->height));
        return to + TILE * pt_tiles(key->width, key->height);
    }
    for (size_t t = 0; t < f->tiles; t++) {
        to = put(to, f->starts[t + 1] - f->starts[t], 1);
        to = put(to, f->num_spans[t], 2);
        for (uint32_t i = 0; i < f->num_spans[t]; i++) {
            to = put(to, f->spans[t * f->span_capacity + i].first, 4);
            to = put(to, f->spans[t * f->span_capacity + i].end, 4);
        }
    }
    for (size_t t = 0; t < f->tiles; t++)
        for (uint32_t i = f->starts[t]; f->num_spans[t] > 0 && i < f->starts[t + 1]; i++) {
            const struct pt_pixel *p = &f->pixels[i];
            for (int k = 0; k < PT_COMPONENTS; k++)
                for (int c = 0; c < 3; c++)
                    to = put_sum(to, &p->sum[k][c]);
            for (int c = 0; c < 4; c++)
                to = put_sum(to, &p->squares[c]);
        }
    return to;
}

enum pell_result pt_checkpoint_encode(struct pell_context *ctx, const struct pt_checkpoint_key *key, const char *note,
                                      const struct pt_film *films, uint8_t **data, size_t *size)
{
    const size_t note_size = note ? strlen(note) : 0;
    uint8_t *to;

    *data = NULL;
    if (note_size > NOTE)
        return pell_error(ctx, PELL_ERR_INVALID, "checkpoint", NULL, "a note of %zu bytes, at most %d are allowed", note_size, NOTE);
    *size = HEADER + note_size + TRAILER;
    for (uint32_t f = 0; f < key->films; f++)
        *size += film_size(key, &films[f]);
    *data = pell_alloc(ctx, *size);
    if (!*data)
        return PELL_ERR_NOMEM;
    to = put_header(*data, key, note, note_size);
    for (uint32_t f = 0; f < key->films; f++)
        to = put_film(to, key, &films[f]);
    put(to, pell_hash_bytes(0, *data, *size - TRAILER), 8);
    return PELL_OK;
}

/* --- Reading ------------------------------------------------------------------------------------------------------------------------ */

/* Rejects a file of other knobs and names the first that differs. */
static enum pell_result check_knobs(const struct reader *r, const struct pt_checkpoint_key *stored, const struct pt_checkpoint_key *key)
{
    static const char *const names[PT_KEY_WORDS] = {
        "the knob normals",     "the knob boundary", "the knob acceleration",       "the knob events", "the knob bounces",
        "the knob connections", "the knob surface",  "the render setting boundary", "the knob half"
    };

    for (int i = 0; i < PT_KEY_WORDS; i++)
        if (stored->words[i] != key->words[i])
            return pell_error(r->ctx, PELL_ERR_INVALID, r->path, hint_other, "is of other settings or knobs: %s is %d there, and %d here",
                              names[i], stored->words[i], key->words[i]);
    if (memcmp(&stored->roulette, &key->roulette, sizeof(key->roulette)) != 0)
        return pell_error(r->ctx, PELL_ERR_INVALID, r->path, hint_other,
                          "is of other settings or knobs: the knob roulette is %g there, and %g here", (double) stored->roulette,
                          (double) key->roulette);
    return PELL_OK;
}

/* The key of a file, and the size of its note; before the call r is after the magic, after it at the note. */
static void read_key(struct reader *r, struct pt_checkpoint_key *stored, uint32_t *note)
{
    uint32_t bits;

    memset(stored, 0, sizeof(*stored));
    stored->width = get32(r);
    stored->height = get32(r);
    stored->films = get32(r);
    stored->scene = get(r, 8);
    stored->seed = (int64_t) get(r, 8);
    stored->exponent = (int32_t) get32(r);
    *note = get32(r);
    bits = get32(r);
    memcpy(&stored->roulette, &bits, sizeof(bits));
    for (int i = 0; i < PT_KEY_WORDS; i++)
        stored->words[i] = (int32_t) get32(r);
    memcpy(stored->version, r->at, NAME);
    r->at += NAME;
}

/* r->at is after the magic. */
static enum pell_result check_header(struct reader *r, const struct pt_checkpoint_key *key)
{
    const uint32_t version = get32(r);
    struct pt_checkpoint_key stored;
    char name[NAME + 1] = "";
    uint32_t note;

    if (version != VERSION)
        return pell_error(r->ctx, PELL_ERR_INVALID, r->path, hint_other, "is a checkpoint of version %u, this program writes version %d",
                          version, VERSION);
    read_key(r, &stored, &note);
    if (memcmp(stored.version, key->version, NAME) != 0) {
        stored.version[NAME - 1] = '\0';
        return pell_error(r->ctx, PELL_ERR_INVALID, r->path, hint_other, "was written by version %s of the program, not by %.31s",
                          pell_printable(stored.version, name, sizeof(name)), key->version);
    }
    if (stored.width != key->width || stored.height != key->height || stored.films != key->films)
        return pell_error(r->ctx, PELL_ERR_INVALID, r->path, hint_other,
                          "is of an image of %u x %u with msaa %u, not of %u x %u with msaa %u", stored.width, stored.height, stored.films,
                          key->width, key->height, key->films);
    if (stored.scene != key->scene)
        return pell_error(r->ctx, PELL_ERR_INVALID, r->path, hint_other, "is of another scene");
    if (stored.seed != key->seed)
        return pell_error(r->ctx, PELL_ERR_INVALID, r->path, hint_other, "is of another seed: %lld, not %lld", (long long) stored.seed,
                          (long long) key->seed);
    if (check_knobs(r, &stored, key) != PELL_OK)
        return PELL_ERR_INVALID;
    if (stored.exponent != key->exponent)
        return pell_error(r->ctx, PELL_ERR_INVALID, r->path, hint_other, "is of another scene: its unit is 2^%d, not 2^%d", stored.exponent,
                          key->exponent);
    if (note > NOTE || !has_bytes(r, note))
        return pell_error(r->ctx, PELL_ERR_FORMAT, r->path, hint_damaged, "has a note of %u bytes, is cut off or damaged", note);
    r->at += note;
    return PELL_OK;
}

static bool read_pixel(struct reader *r, struct pt_pixel *p, uint32_t count)
{
    const int64_t most = (int64_t) count << 31;
    bool good = true;

    for (int k = 0; k < PT_COMPONENTS; k++)
        for (int c = 0; c < 3; c++) {
            p->sum[k][c].low = get(r, 8);
            p->sum[k][c].high = (int64_t) get(r, 8);
            good = good && p->sum[k][c].high >= -most && p->sum[k][c].high <= most;
        }
    for (int c = 0; c < 4; c++) {
        p->squares[c].low = get(r, 8);
        p->squares[c].high = (int64_t) get(r, 8);
        good = good && p->squares[c].high >= 0;
    }
    p->count = count;
    return good;
}

/* The spans of a tile; `film` must have room for at least one. Returns the number of samples, or 0 and a message. */
static uint32_t read_spans(struct reader *r, struct pt_film *film, size_t tile, uint32_t count)
{
    uint64_t samples = 0;
    uint32_t last = 0;

    film->num_spans[tile] = (uint16_t) count;
    for (uint32_t i = 0; i < count; i++) {
        struct pt_span *span = &film->spans[tile * film->span_capacity + i];
        span->first = get32(r);
        span->end = get32(r);
        if (span->end <= span->first || span->end > 1u << 30 || (i > 0 && span->first <= last)) {
            pell_error(r->ctx, PELL_ERR_FORMAT, r->path, hint_damaged, "tile %zu has samples %u to %u after those up to %u", tile,
                       span->first, span->end, last);
            return 0;
        }
        last = span->end;
        samples += last - span->first;
    }
    return (uint32_t) samples;
}

/* Reads pixels and numbers of spans of all tiles, without the spans themselves. */
static enum pell_result scan_tiles(struct reader r, const struct pt_checkpoint_key *key, uint8_t *pixels, uint32_t *most, uint64_t *size)
{
    const size_t tiles = pt_tiles(key->width, key->height), columns = (key->width + PT_TILE - 1) / PT_TILE;

    *most = 0;
    *size = 0;
    for (size_t t = 0; t < tiles; t++) {
        const uint32_t x = (uint32_t) (t % columns) * PT_TILE, y = (uint32_t) (t / columns) * PT_TILE;
        const uint32_t w = key->width - x < PT_TILE ? key->width - x : PT_TILE, h = key->height - y < PT_TILE ? key->height - y : PT_TILE;
        uint32_t spans;

        if (!has_bytes(&r, TILE))
            return pell_error(r.ctx, PELL_ERR_FORMAT, r.path, hint_damaged, "has too few bytes, is cut off");
        pixels[t] = (uint8_t) get(&r, 1);
        spans = (uint32_t) get(&r, 2);
        if (pixels[t] > w * h)
            return pell_error(r.ctx, PELL_ERR_FORMAT, r.path, hint_damaged, "tile %zu has %u pixels of an image of %u x %u", t, pixels[t],
                              key->width, key->height);
        if (spans > PT_SPANS)
            return pell_error(r.ctx, PELL_ERR_FORMAT, r.path, hint_damaged, "tile %zu has %u runs of samples, at most %d are possible", t,
                              spans, PT_SPANS);
        if (!has_bytes(&r, (uint64_t) SPAN * spans))
            return pell_error(r.ctx, PELL_ERR_FORMAT, r.path, hint_damaged, "has too few bytes, is cut off");
        r.at += SPAN * spans;
        *size += spans > 0 ? (uint64_t) PIXEL * pixels[t] : 0;
        *most = spans > *most ? spans : *most;
    }
    if (!has_bytes(&r, *size))
        return pell_error(r.ctx, PELL_ERR_FORMAT, r.path, hint_damaged, "has too few bytes, is cut off");
    return PELL_OK;
}

static enum pell_result read_film(struct reader *r, const struct pt_checkpoint_key *key, uint32_t index, struct pt_film *film)
{
    const size_t tiles = pt_tiles(key->width, key->height);
    uint8_t *pixels = pell_alloc(r->ctx, tiles);
    uint32_t most = 0;
    uint64_t size, identity;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!pixels)
        return res;
    if (!has_bytes(r, 8)) {
        res = pell_error(r->ctx, PELL_ERR_FORMAT, r->path, hint_damaged, "has too few bytes, is cut off");
        goto fail;
    }
    identity = get(r, 8);
    PELL_TRY(scan_tiles(*r, key, pixels, &most, &size));
    PELL_TRY(pt_film_create(r->ctx, pixels, tiles, film));
    PELL_TRY(pt_film_reserve(r->ctx, film, most));
    film->identity = identity;
    film->exponent = key->exponent;
    res = PELL_ERR_FORMAT;
    for (size_t t = 0; t < tiles; t++) {
        uint32_t spans, samples;
        r->at++;
        spans = (uint32_t) get(r, 2);
        samples = read_spans(r, film, t, spans);
        if (spans > 0 && samples == 0)
            goto fail;
        for (uint32_t i = film->starts[t]; i < film->starts[t + 1]; i++)
            if (samples > 0)
                film->pixels[i].count = samples;
    }
    for (size_t t = 0; t < tiles; t++)
        for (uint32_t i = film->starts[t]; film->num_spans[t] > 0 && i < film->starts[t + 1]; i++)
            if (!read_pixel(r, &film->pixels[i], film->pixels[i].count)) {
                pell_error(r->ctx, res, r->path, hint_damaged, "pixel %u of sample %u has sums that no samples have", i, index);
                goto fail;
            }
    res = PELL_OK;

fail:
    pell_free(r->ctx, pixels);
    return res;
}

static enum pell_result check_hash(struct reader *r, const uint8_t *data, size_t size)
{
    struct reader trailer = { r->ctx, r->path, data + size - TRAILER, data + size };

    r->end -= TRAILER;
    if (pell_hash_bytes(0, data, size - TRAILER) != get(&trailer, 8))
        return pell_error(r->ctx, PELL_ERR_FORMAT, r->path, hint_damaged,
                          "is damaged or cut off at %zu bytes: its bytes don't have its hash", size);
    return PELL_OK;
}

enum pell_result pt_checkpoint_note(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size, char **note)
{
    struct reader r = { ctx, path, NULL, NULL };
    struct pt_checkpoint_key stored;
    uint32_t version, bytes;
    enum pell_result res;

    *note = NULL;
    if (!data || size < HEADER + TRAILER || memcmp(data, magic, sizeof(magic)) != 0)
        return pell_error(ctx, PELL_ERR_FORMAT, path, "name another file", "is no checkpoint of path-trace");
    r.at = data + sizeof(magic);
    r.end = data + size;
    version = get32(&r);
    if (version != VERSION)
        return pell_error(ctx, PELL_ERR_INVALID, path, hint_other, "is a checkpoint of version %u, this program reads version %d", version,
                          VERSION);
    if ((res = check_hash(&r, data, size)) != PELL_OK)
        return res;
    read_key(&r, &stored, &bytes);
    if (bytes > NOTE || !has_bytes(&r, bytes))
        return pell_error(ctx, PELL_ERR_FORMAT, path, hint_damaged, "has a note of %u bytes, is cut off or damaged", bytes);
    *note = pell_alloc(ctx, (size_t) bytes + 1);
    if (!*note)
        return PELL_ERR_NOMEM;
    memcpy(*note, r.at, bytes);
    (*note)[bytes] = '\0';
    return PELL_OK;
}

enum pell_result pt_checkpoint_decode(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                      const struct pt_checkpoint_key *key, struct pt_film *films)
{
    struct reader r = { ctx, path, NULL, NULL };
    enum pell_result res;

    if (key->films < 1 || key->films > FILMS)
        return pell_error(ctx, PELL_ERR_INVALID, path, NULL, "msaa %u, must be in [1, %d]", key->films, FILMS);
    memset(films, 0, key->films * sizeof(*films));
    if (!data || size < HEADER + TRAILER || memcmp(data, magic, sizeof(magic)) != 0)
        return pell_error(ctx, PELL_ERR_FORMAT, path, "name another file", "is no checkpoint of path-trace");
    r.at = data + sizeof(magic);
    r.end = data + size;
    r.end -= TRAILER;
    PELL_TRY(check_header(&r, key));
    r.end += TRAILER;
    PELL_TRY(check_hash(&r, data, size));
    for (uint32_t f = 0; f < key->films; f++)
        PELL_TRY(read_film(&r, key, f, &films[f]));
    if (r.at == r.end)
        return PELL_OK;
    res = pell_error(ctx, PELL_ERR_FORMAT, path, hint_damaged, "has %s too many", pell_counted(r.end - r.at, "byte", "bytes").str);

fail:
    for (uint32_t f = 0; f < key->films; f++)
        pt_film_free(ctx, &films[f]);
    return res;
}
