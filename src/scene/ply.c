/* SPDX-License-Identifier: MIT
 * ply.c - Stanford PLY: ascii and binary of both byte orders, properties of any type in any order, polygons and triangle strips.
 *
 * The header becomes a table of elements and properties; the body is walked once, value by value, whatever its elements are. Counts are
 * held against the bytes that are left before anything is allocated. */
#include "scene/ply.h"

#include "image/color.h"

/* "mesh.ply:face 12" (counted from 0, as vertices are). */
static const char *where_row(const struct ply *p, const char *kind, int64_t row, struct pell_text *text)
{
    memset(text, 0, sizeof(*text));
    pell_text_add_path(text, p->import->path, ":", "");
    pell_text_add(text, "%s %lld", kind, (long long) row);
    return text->str;
}

/* --- Body --------------------------------------------------------------------------------------------------------------------- */

static enum pell_result ends_early(struct ply *p, const char *kind, int64_t row)
{
    struct pell_text text;

    return pell_error(p->ctx, PELL_ERR_FORMAT, where_row(p, kind, row, &text), NULL,
                      "the file ends here, before all rows that it announces");
}

/* Reads the next value of the text body, which may be on any line. */
static bool read_word(struct ply *p, double *value)
{
    float f;
    const char *word;
    size_t length;
    struct pell_lex start;

    for (;;) {
        pell_lex_blank(&p->lex);
        if (!pell_lex_eol(&p->lex))
            break;
        if (p->lex.at >= p->lex.end)
            return false;
        pell_lex_next_line(&p->lex);
    }
    start = p->lex;
    /* Whole numbers beyond 2^24 are not exact as floats. */
    if (pell_lex_float(&p->lex, &f) && fabsf(f) < 16777216.0f) {
        *value = (double) f;
        return true;
    }
    p->lex = start;
    length = pell_lex_word(&p->lex, &word);
    if (pell_parse_number(word, length, value))
        return true;
    /* Spellings of 0/0 and 1/0 by other programs. Such positions are refused later, by their vertex. */
    if (length && length < 12) {
        char copy[12];
        for (size_t i = 0; i < length; i++)
            copy[i] = word[i] >= 'A' && word[i] <= 'Z' ? (char) (word[i] - 'A' + 'a') : word[i];
        if (pell_word_is(copy + (copy[0] == '-' || copy[0] == '+'), length - (copy[0] == '-' || copy[0] == '+'), "nan") ||
            pell_word_is(copy + (copy[0] == '-' || copy[0] == '+'), length - (copy[0] == '-' || copy[0] == '+'), "inf")) {
            *value = NAN;
            return true;
        }
    }
    p->lex = start;
    return false;
}

static double decode(const struct ply *p, const uint8_t *at, enum type type)
{
    const size_t size = type_sizes[type];
    uint64_t bits = 0;
    uint32_t low;
    float f;
    double d;

    if (p->big)
        for (size_t i = 0; i < size; i++)
            bits = bits << 8 | at[i];
    else
        for (size_t i = size; i-- > 0;)
            bits = bits << 8 | at[i];
    low = (uint32_t) bits;
    switch (type) {
    case T_INT8: return (double) (int8_t) low;
    case T_UINT8: return (double) (uint8_t) low;
    case T_INT16: return (double) (int16_t) low;
    case T_UINT16: return (double) (uint16_t) low;
    case T_INT32: return (double) (int32_t) low;
    case T_UINT32: return (double) low;
    case T_FLOAT: memcpy(&f, &low, sizeof(f)); return (double) f;
    case T_DOUBLE: memcpy(&d, &bits, sizeof(d)); return d;
    default: return 0.0;
    }
}

static inline bool read_value(struct ply *p, enum type type, double *value)
{
    if (!p->binary)
        return read_word(p, value);
    if ((size_t) (p->end - p->at) < type_sizes[type])
        return false;
    *value = decode(p, p->at, type);
    p->at += type_sizes[type];
    return true;
}

static enum pell_result read_failed(struct ply *p, const char *kind, int64_t row)
{
    struct pell_text text;
    const char *word;
    char copy[64] = "", shown[64];
    size_t length;

    if (p->binary || p->lex.at >= p->lex.end)
        return ends_early(p, kind, row);
    length = pell_lex_word(&p->lex, &word);
    memcpy(copy, word, length < sizeof(copy) ? length : sizeof(copy) - 1);
    return pell_error(p->ctx, PELL_ERR_FORMAT, pell_lex_where(&p->lex, p->import->path, &text), NULL,
                      "\"%s\" instead of a number of %s %lld", pell_printable(copy, shown, sizeof(shown)), kind, (long long) row);
}

/* Reads a list's length; a skipped list may be as long as the file. */
static enum pell_result read_length(struct ply *p, const struct property *q, const char *kind, int64_t row, int64_t *length)
{
    const int64_t left =
        p->binary ? (int64_t) (p->end - p->at) / (int64_t) type_sizes[q->type] : (int64_t) (p->lex.end - p->lex.at) / 2 + 1;
    struct pell_text text;
    double value;

    if (!read_value(p, q->count_type, &value))
        return read_failed(p, kind, row);
    if (!(value >= 0.0 && value <= (double) left) || value != floor(value))
        return pell_error(p->ctx, PELL_ERR_FORMAT, where_row(p, kind, row, &text), NULL,
                          "a list has the length %g, allowed: 0 to what the file has left (%lld)", value, (long long) left);
    *length = (int64_t) value;
    return PELL_OK;
}

static enum pell_result skip_property(struct ply *p, const struct property *q, const char *kind, int64_t row)
{
    int64_t length = 1;
    double value;
    enum pell_result res;

    if (q->count_type != T_NONE)
        PELL_TRY(read_length(p, q, kind, row, &length));
    if (p->binary && length > (int64_t) ((size_t) (p->end - p->at) / type_sizes[q->type]))
        return ends_early(p, kind, row);
    if (p->binary)
        p->at += (size_t) length * type_sizes[q->type];
    for (int64_t i = 0; !p->binary && i < length; i++)
        if (!read_value(p, q->type, &value))
            return read_failed(p, kind, row);
    return PELL_OK;

fail:
    return res;
}

static bool has_role(const struct ply *p, const struct element *e, enum role role)
{
    for (size_t i = e->first_property; i < e->first_property + e->num_properties; i++)
        if (p->properties[i].role == role)
            return true;
    return false;
}

static enum pell_result make_room(struct ply *p, const struct element *e)
{
    const size_t n = (size_t) e->count;

    p->position = pell_alloc_array(p->ctx, n, 3 * sizeof(float));
    if (!p->position)
        return PELL_ERR_NOMEM;
    if (has_role(p, e, R_NX) && has_role(p, e, R_NY) && has_role(p, e, R_NZ) &&
        !(p->normal = pell_alloc_array(p->ctx, n, 3 * sizeof(float))))
        return PELL_ERR_NOMEM;
    if (has_role(p, e, R_U) && has_role(p, e, R_V) && !(p->uv = pell_alloc_array(p->ctx, n, 2 * sizeof(float))))
        return PELL_ERR_NOMEM;
    if (has_role(p, e, R_RED) && has_role(p, e, R_GREEN) && has_role(p, e, R_BLUE)) {
        p->color = pell_alloc_array(p->ctx, n, 4 * sizeof(float));
        if (!p->color)
            return PELL_ERR_NOMEM;
        for (size_t i = 0; i < n; i++)
            p->color[4 * i + 3] = 1.0f;
    }
    return PELL_OK;
}

/* Integers are sRGB values scaled to their largest; floats are linear. */
static float color_value(double value, enum type type, bool alpha)
{
    const double scale = type == T_UINT8 ? 255.0 : type == T_UINT16 ? 65535.0 : 1.0;
    const float x = (float) fmin(1.0, fmax(0.0, value / scale));

    return alpha || type >= T_FLOAT ? x : pell_srgb_decode(x);
}

static void store(struct ply *p, size_t row, const struct property *q, double value)
{
    if (q->role <= R_Z)
        p->position[3 * row + (size_t) q->role] = (float) value;
    else if (q->role <= R_NZ && p->normal)
        p->normal[3 * row + (size_t) (q->role - R_NX)] = (float) value;
    else if (q->role == R_U && p->uv)
        p->uv[2 * row] = (float) value;
    else if (q->role == R_V && p->uv)
        p->uv[2 * row + 1] = 1.0f - (float) value;
    else if (q->role >= R_RED && q->role <= R_ALPHA && p->color)
        p->color[4 * row + (size_t) (q->role - R_RED)] = color_value(value, q->type, q->role == R_ALPHA);
}

static enum pell_result read_vertices(struct ply *p, const struct element *e)
{
    struct pell_text text;
    enum pell_result res;
    double value;

    PELL_TRY(make_room(p, e));
    for (int64_t row = 0; row < e->count; row++) {
        if (pell_cancelled_at(p->ctx, (uint64_t) row)) {
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
        for (size_t i = e->first_property; i < e->first_property + e->num_properties; i++) {
            const struct property *q = &p->properties[i];
            if (q->role == R_NONE) {
                PELL_TRY(skip_property(p, q, "vertex", row));
                continue;
            }
            if (!read_value(p, q->type, &value))
                return read_failed(p, "vertex", row);
            if (q->role <= R_Z && !(fabs(value) <= FLT_MAX))
                return pell_error(p->ctx, PELL_ERR_FORMAT, where_row(p, "vertex", row, &text), NULL, "%c is %g, must be finite",
                                  "xyz"[q->role], value);
            store(p, (size_t) row, q, value);
        }
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result add_triangle(struct ply *p, uint32_t a, uint32_t b, uint32_t c)
{
    const int64_t limit = pell_context_limits(p->ctx)->triangles;
    void *array = p->corners;
    enum pell_result res;

    if ((int64_t) p->num_triangles >= limit)
        return pell_error(p->ctx, PELL_ERR_UNSUPPORTED, p->import->path, PELL_RAISE_LIMIT("triangles"),
                          "has more than %lld triangles, which are allowed", (long long) limit);
    if (p->num_triangles >= p->cap_triangles) {
        res = pell_grow(p->ctx, &array, p->num_triangles, &p->cap_triangles, 3 * sizeof(*p->corners));
        p->corners = array;
        if (res != PELL_OK)
            return res;
    }
    p->corners[3 * p->num_triangles] = a;
    p->corners[3 * p->num_triangles + 1] = b;
    p->corners[3 * p->num_triangles + 2] = c;
    p->num_triangles++;
    return PELL_OK;
}

static enum pell_result add_face(struct ply *p, size_t count)
{
    enum pell_result res;

    if (count < 3) {
        p->degenerate_faces++;
        return PELL_OK;
    }
    if (count == 3)
        return add_triangle(p, (uint32_t) p->list[0], (uint32_t) p->list[1], (uint32_t) p->list[2]);
    PELL_TRY(pell_polygon_reserve(&p->polygon, count));
    for (size_t i = 0; i < count; i++)
        memcpy(p->polygon.point + 3 * i, p->position + 3 * (size_t) p->list[i], 3 * sizeof(float));
    if (!pell_polygon_triangulate(&p->polygon, count))
        pell_warn(p->ctx, p->import->path, "cut the face into triangles in the program that it comes from",
                  "a face of %zu corners crosses itself, or is too large to be cut well: its shape may be wrong", count);
    for (size_t i = 0; i < count - 2; i++)
        PELL_TRY(add_triangle(p, (uint32_t) p->list[p->polygon.triangle[3 * i]], (uint32_t) p->list[p->polygon.triangle[3 * i + 1]],
                              (uint32_t) p->list[p->polygon.triangle[3 * i + 2]]));
    return PELL_OK;

fail:
    return res;
}

/* Adds strips separated by -1; every other triangle of a strip has the opposite winding. */
static enum pell_result add_strips(struct ply *p, size_t count)
{
    enum pell_result res = PELL_OK;

    for (size_t i = 0, start = 0; i < count && res == PELL_OK; i++) {
        const int64_t *v = p->list + i;
        if (*v < 0) {
            start = i + 1;
        } else if (i >= start + 2 && v[-2] != v[-1] && v[-1] != v[0] && v[-2] != v[0]) {
            const bool odd = (i - start) % 2;
            res = add_triangle(p, (uint32_t) v[odd ? -1 : -2], (uint32_t) v[odd ? -2 : -1], (uint32_t) v[0]);
        }
    }
    return res;
}

/* Reads the list into p->list; elements must be vertex indices, or -1 in strips. */
static enum pell_result read_list(struct ply *p, const struct property *q, const char *kind, int64_t row, size_t *count)
{
    int64_t length;
    struct pell_text text;
    double value;
    enum pell_result res;

    PELL_TRY(read_length(p, q, kind, row, &length));
    if ((size_t) length > p->cap_list) {
        const size_t wanted = (size_t) length + (size_t) length / 2 + 16;
        int64_t *list = pell_realloc_array(p->ctx, p->list, wanted, sizeof(*list));
        if (!list)
            return PELL_ERR_NOMEM;
        p->list = list;
        p->cap_list = wanted;
    }
    for (int64_t i = 0; i < length; i++) {
        if (!read_value(p, q->type, &value))
            return read_failed(p, kind, row);
        if (!(value >= 0.0 && value < (double) p->num_vertices && value == floor(value)) && !(q->role == R_STRIP && value == -1.0))
            return pell_error(p->ctx, PELL_ERR_FORMAT, where_row(p, kind, row, &text), NULL, "refers to vertex %g, allowed: 0 to %lld",
                              value, (long long) p->num_vertices - 1);
        p->list[i] = (int64_t) value;
    }
    *count = (size_t) length;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_faces(struct ply *p, const struct element *e)
{
    const char *kind = e->kind == K_FACE ? "face" : "tristrips";
    enum pell_result res;
    size_t count;

    if (e->count && !p->position)
        return pell_error(p->ctx, PELL_ERR_UNSUPPORTED, p->import->path, NULL, "its faces come before its vertices");
    for (int64_t row = 0; row < e->count; row++) {
        for (size_t i = e->first_property; i < e->first_property + e->num_properties; i++) {
            const struct property *q = &p->properties[i];
            if (q->role == R_NONE) {
                PELL_TRY(skip_property(p, q, kind, row));
                continue;
            }
            PELL_TRY(read_list(p, q, kind, row, &count));
            PELL_TRY(q->role == R_FACE ? add_face(p, count) : add_strips(p, count));
        }
        if (pell_cancelled_at(p->ctx, (uint64_t) row)) {
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result skip_element(struct ply *p, const struct element *e)
{
    enum pell_result res = PELL_OK;

    for (int64_t row = 0; row < e->count && res == PELL_OK; row++) {
        if (pell_cancelled_at(p->ctx, (uint64_t) row))
            return PELL_ERR_CANCELLED;
        for (size_t i = e->first_property; i < e->first_property + e->num_properties && res == PELL_OK; i++)
            res = skip_property(p, &p->properties[i], "element", row);
    }
    return res;
}

static enum pell_result read_body(struct ply *p)
{
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < p->num_elements && res == PELL_OK; i++) {
        const struct element *e = &p->elements[i];
        if (e->num_properties == 0)
            continue; /* rows of zero bytes: there may be any number of them */
        if (e->kind == K_VERTEX)
            res = read_vertices(p, e);
        else if (e->kind == K_OTHER)
            res = skip_element(p, e);
        else
            res = read_faces(p, e);
    }
    return res;
}

static enum pell_result build(struct ply *p)
{
    struct pell_scene *scene = p->import->scene;
    struct pell_mesh *mesh;
    size_t index;
    enum pell_result res;

    if (p->num_triangles == 0)
        return pell_error(p->ctx, PELL_ERR_FORMAT, p->import->path, NULL, "holds no faces");
    PELL_TRY(pell_scene_add_mesh(scene, "", &index));
    PELL_TRY(pell_mesh_allocate(scene, index, (uint32_t) p->num_vertices, (uint32_t) p->num_triangles));
    mesh = &scene->meshes[index];
    mesh->material = -1;
    memcpy(mesh->position, p->position, p->num_vertices * 3 * sizeof(float));
    if (p->normal)
        memcpy(mesh->normal, p->normal, p->num_vertices * 3 * sizeof(float));
    memcpy(mesh->index, p->corners, p->num_triangles * 3 * sizeof(uint32_t));
    mesh->uv[0] = p->uv;
    mesh->color = p->color;
    p->uv = p->color = NULL;
    if (p->degenerate_faces)
        pell_warn(p->ctx, p->import->path, NULL, "%s left out",
                  pell_counted(p->degenerate_faces, "face of fewer than three corners is", "faces of fewer than three corners are").str);
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_import_ply(struct pell_import *import, const uint8_t *data, size_t size)
{
    struct ply *p = pell_zalloc(import->ctx, sizeof(*p));
    enum pell_result res;

    if (!p)
        return PELL_ERR_NOMEM;
    p->import = import;
    p->ctx = p->polygon.ctx = import->ctx;
    p->lex = (struct pell_lex) { (const char *) data, (const char *) data + size, 1 };
    p->end = data + size;
    import->default_mm_per_unit = 0.0;
    PELL_TRY(pell_ply_read_header(p));
    PELL_TRY(pell_ply_check_header(p));
    PELL_TRY(read_body(p));
    PELL_TRY(build(p));

fail:
    pell_polygon_finish(&p->polygon);
    pell_free(p->ctx, p->position);
    pell_free(p->ctx, p->normal);
    pell_free(p->ctx, p->uv);
    pell_free(p->ctx, p->color);
    pell_free(p->ctx, p->corners);
    pell_free(p->ctx, p->list);
    pell_free(p->ctx, p);
    return res;
}
