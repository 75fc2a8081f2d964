/* SPDX-License-Identifier: MIT
 * stl.c - STL, binary and text: triangles only. Corners at the same position become one vertex, so that surfaces are closed; the normals of
 * the file, one per triangle and often zero, are not used. */
#include "scene/obj/lex.h"
#include "scene/scene.h"

#include <stdio.h>
#include <strings.h>

enum { HEADER = 84, RECORD = 50, PROBES = 64 };

struct stl {
    struct pell_import *import;
    struct pell_context *ctx;
    float *position; /* of the vertices */
    size_t num_vertices, cap_vertices;
    uint32_t *corners;
    size_t num_corners, cap_corners;
    uint32_t *slots; /* vertex + 1, hashed by position */
    size_t num_slots;
};

bool pell_stl_is_binary(const uint8_t *data, size_t size)
{
    return size >= HEADER && (size - HEADER) / RECORD == pell_load_little_endian(data + HEADER - 4) && (size - HEADER) % RECORD == 0;
}

/* --- Vertices ------------------------------------------------------------------------------------------------------------------- */

static size_t slot_of(const struct stl *s, const float p[3])
{
    uint32_t bits[3];
    uint64_t h;

    memcpy(bits, p, sizeof(bits));
    h = (bits[0] * 0x9e3779b97f4a7c15ull) ^ (bits[1] * 0xc2b2ae3d27d4eb4full) ^ (bits[2] * 0x165667b19e3779f9ull);
    h ^= h >> 32;
    h *= 0xd6e8feb86659fd93ull;
    return (size_t) (h >> 32) & (s->num_slots - 1);
}

/* The slot of this position: its vertex, or a free slot. NULL if none is near: the corner becomes a separate vertex, which is also correct,
 * and bounds the time. */
static uint32_t *find(const struct stl *s, const float p[3])
{
    for (size_t i = 0, k = slot_of(s, p); i < PROBES; i++, k = (k + 1) & (s->num_slots - 1))
        if (!s->slots[k] || memcmp(s->position + 3 * (size_t) (s->slots[k] - 1), p, 3 * sizeof(*p)) == 0)
            return &s->slots[k];
    return NULL;
}

static enum pell_result grow_slots(struct stl *s)
{
    const size_t wanted = s->num_slots ? 2 * s->num_slots : 64;
    uint32_t *slots;

    if (2 * (s->num_vertices + 1) <= s->num_slots)
        return PELL_OK;
    slots = pell_calloc(s->ctx, wanted, sizeof(*slots));
    if (!slots)
        return PELL_ERR_NOMEM;
    pell_free(s->ctx, s->slots);
    s->slots = slots;
    s->num_slots = wanted;
    for (size_t i = 0; i < s->num_vertices; i++) {
        uint32_t *slot = find(s, s->position + 3 * i);
        if (slot && !*slot)
            *slot = (uint32_t) i + 1;
    }
    return PELL_OK;
}

static enum pell_result add_corner(struct stl *s, const float position[3])
{
    const float p[3] = { position[0] + 0.0f, position[1] + 0.0f, position[2] + 0.0f }; /* -0 becomes 0 */
    void *array;
    uint32_t *slot;
    enum pell_result res;

    PELL_TRY(grow_slots(s));
    slot = find(s, p);
    array = s->corners;
    res = pell_grow(s->ctx, &array, s->num_corners, &s->cap_corners, sizeof(*s->corners));
    s->corners = array;
    PELL_TRY(res);
    if (slot && *slot) {
        s->corners[s->num_corners++] = *slot - 1;
        return PELL_OK;
    }
    array = s->position;
    res = pell_grow(s->ctx, &array, s->num_vertices, &s->cap_vertices, 3 * sizeof(*s->position));
    s->position = array;
    PELL_TRY(res);
    memcpy(s->position + 3 * s->num_vertices, p, sizeof(p));
    s->corners[s->num_corners++] = (uint32_t) s->num_vertices++;
    if (slot)
        *slot = (uint32_t) s->num_vertices;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result check_limit(const struct stl *s, uint64_t triangles)
{
    const struct pell_limits *limits = pell_context_limits(s->ctx);
    const int64_t most = limits->triangles < limits->vertices ? limits->triangles : limits->vertices;

    if (triangles <= (uint64_t) most && triangles < UINT32_MAX / 3)
        return PELL_OK;
    return pell_error(s->ctx, PELL_ERR_UNSUPPORTED, s->import->path, "raise the limits: --limit vertices=N --limit triangles=N",
                      "%llu triangles; %lld are allowed", (unsigned long long) triangles, (long long) most);
}

/* --- The two forms -------------------------------------------------------------------------------------------------------------- */

static enum pell_result read_binary(struct stl *s, const uint8_t *data, size_t size)
{
    const size_t triangles = (size - HEADER) / RECORD;
    enum pell_result res;

    PELL_TRY(check_limit(s, triangles));
    for (size_t t = 0; t < triangles; t++) {
        const uint8_t *record = data + HEADER + t * RECORD;
        for (size_t k = 1; k < 4; k++) {
            float p[3];
            for (size_t c = 0; c < 3; c++) {
                const uint32_t bits = pell_load_little_endian(record + 12 * k + 4 * c);
                memcpy(&p[c], &bits, sizeof(bits));
            }
            if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2]))
                return pell_error(s->ctx, PELL_ERR_FORMAT, s->import->path, NULL,
                                  "triangle %zu: corner %zu is (%g, %g, %g), must be finite numbers", t, k - 1, (double) p[0],
                                  (double) p[1], (double) p[2]);
            PELL_TRY(add_corner(s, p));
        }
        if (t % 65536 == 0 && pell_cancelled(s->ctx))
            return PELL_ERR_CANCELLED;
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_vertex(struct stl *s, struct pell_lex *l)
{
    static const char axes[] = "xyz";
    float p[3];

    for (int c = 0; c < 3; c++)
        if (!pell_lex_float(l, &p[c])) {
            char shown[48], text[48];
            const char *word;
            const size_t length = pell_lex_word(l, &word);
            snprintf(text, sizeof(text), "%.*s", (int) (length < 40 ? length : 40), word);
            return pell_error(s->ctx, PELL_ERR_FORMAT, s->import->path, NULL, "line %lld: %c is \"%s\", must be a finite number",
                              (long long) l->line, axes[c], pell_printable(text, shown, sizeof(shown)));
        }
    return add_corner(s, p);
}

/* Case-insensitive: some programs write keywords in capitals. */
static bool is_word(const char *word, size_t length, const char *name)
{
    return length == strlen(name) && strncasecmp(word, name, length) == 0;
}

/* Only the keywords that carry information are read: "vertex", and the begin and end of facets. */
static enum pell_result read_text(struct stl *s, const uint8_t *data, size_t size)
{
    struct pell_lex l = { (const char *) data, (const char *) data + size, 1 };
    enum pell_result res;

    for (; l.at < l.end; pell_lex_next_line(&l)) {
        const char *word;
        const size_t length = pell_lex_word(&l, &word);
        if (is_word(word, length, "vertex"))
            PELL_TRY(read_vertex(s, &l));
        if (s->num_corners % 3 != 0 && (is_word(word, length, "endfacet") || is_word(word, length, "endloop")))
            return pell_error(s->ctx, PELL_ERR_FORMAT, s->import->path, NULL, "line %lld: a facet of %zu corners, must have 3",
                              (long long) l.line, s->num_corners % 3);
        if (s->num_corners % 3072 == 0)
            PELL_TRY(check_limit(s, s->num_corners / 3));
        if (l.line % 65536 == 0 && pell_cancelled(s->ctx))
            return PELL_ERR_CANCELLED;
    }
    if (s->num_corners % 3 != 0)
        return pell_error(s->ctx, PELL_ERR_FORMAT, s->import->path, "the file may be cut off", "line %lld: ends within a facet",
                          (long long) l.line);
    return check_limit(s, s->num_corners / 3);

fail:
    return res;
}

static enum pell_result build(struct stl *s)
{
    struct pell_mesh *mesh;
    size_t index;
    enum pell_result res;

    if (s->num_corners == 0)
        return pell_error(s->ctx, PELL_ERR_FORMAT, s->import->path, NULL, "holds no triangles");
    PELL_TRY(pell_scene_add_mesh(s->import->scene, "", &index));
    PELL_TRY(pell_mesh_allocate(s->import->scene, index, (uint32_t) s->num_vertices, (uint32_t) (s->num_corners / 3)));
    mesh = &s->import->scene->meshes[index];
    mesh->material = -1;
    memcpy(mesh->position, s->position, s->num_vertices * 3 * sizeof(float));
    memcpy(mesh->index, s->corners, s->num_corners * sizeof(uint32_t));
    return PELL_OK;

fail:
    return res;
}

/* Headers of binary files begin with "solid", too. */
static bool is_text(const uint8_t *data, size_t size)
{
    return size >= 5 && strncasecmp((const char *) data, "solid", 5) == 0 && !memchr(data, 0, size < 4096 ? size : 4096);
}

enum pell_result pell_import_stl(struct pell_import *import, const uint8_t *data, size_t size)
{
    struct stl s = { .import = import, .ctx = import->ctx };
    const unsigned long long named = size < HEADER ? 0 : (unsigned long long) pell_load_little_endian(data + HEADER - 4) * RECORD + HEADER;
    enum pell_result res;

    import->default_mm_per_unit = 0.0;
    if (!pell_stl_is_binary(data, size) && !is_text(data, size))
        res =
            size < HEADER
                ? pell_error(s.ctx, PELL_ERR_FORMAT, import->path, "the file may be cut off",
                             "is no STL: it has %s, and does not begin with \"solid\"", pell_counted((long long) size, "byte", "bytes").str)
                : pell_error(s.ctx, PELL_ERR_FORMAT, import->path,
                             size < named ? "the file may be cut off" : "what is behind them is no triangle",
                             "names %s, for %llu bytes, but has %zu bytes",
                             pell_counted(pell_load_little_endian(data + HEADER - 4), "triangle", "triangles").str, named, size);
    else
        res = pell_stl_is_binary(data, size) ? read_binary(&s, data, size) : read_text(&s, data, size);
    if (res == PELL_OK)
        res = build(&s);
    pell_free(s.ctx, s.position);
    pell_free(s.ctx, s.corners);
    pell_free(s.ctx, s.slots);
    return res;
}
