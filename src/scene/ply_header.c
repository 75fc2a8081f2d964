/* SPDX-License-Identifier: MIT
 *
 * ply_header.c - the header of a PLY file: elements, their properties, and which of them are used.
 */
#include "scene/ply.h"

static const struct {
    const char *name;
    enum type type;
} type_names[] = {
    { "char", T_INT8 },   { "uchar", T_UINT8 },   { "short", T_INT16 },   { "ushort", T_UINT16 },
    { "int", T_INT32 },   { "uint", T_UINT32 },   { "float", T_FLOAT },   { "double", T_DOUBLE },
    { "int8", T_INT8 },   { "uint8", T_UINT8 },   { "int16", T_INT16 },   { "uint16", T_UINT16 },
    { "int32", T_INT32 }, { "uint32", T_UINT32 }, { "float32", T_FLOAT }, { "float64", T_DOUBLE },
};

/* A printable copy of a word of the header; `shown` has 64 bytes and is returned. */
static const char *show_word(const char *word, size_t length, char *shown)
{
    char copy[64] = "";

    memcpy(copy, word, length < sizeof(copy) ? length : sizeof(copy) - 1);
    return pell_printable(copy, shown, 64);
}

static enum pell_result bad_header(struct ply *p, const char *what, const char *word, size_t length)
{
    struct pell_text text;
    char shown[64];

    return pell_error(p->ctx, PELL_ERR_FORMAT, pell_lex_where(&p->lex, p->import->path, &text), NULL, "%s, but is \"%s\"", what,
                      show_word(word, length, shown));
}

static enum type type_of(const char *word, size_t length)
{
    for (size_t i = 0; i < PELL_COUNT(type_names); i++)
        if (pell_word_is(word, length, type_names[i].name))
            return type_names[i].type;
    return T_NONE;
}

static enum role role_of(enum kind kind, const char *word, size_t length, bool list)
{
    static const struct {
        const char *name;
        enum role role;
    } names[] = { { "x", R_X },
                  { "y", R_Y },
                  { "z", R_Z },
                  { "nx", R_NX },
                  { "ny", R_NY },
                  { "nz", R_NZ },
                  { "u", R_U },
                  { "v", R_V },
                  { "s", R_U },
                  { "t", R_V },
                  { "texture_u", R_U },
                  { "texture_v", R_V },
                  { "texture_s", R_U },
                  { "texture_t", R_V },
                  { "red", R_RED },
                  { "green", R_GREEN },
                  { "blue", R_BLUE },
                  { "alpha", R_ALPHA },
                  { "r", R_RED },
                  { "g", R_GREEN },
                  { "b", R_BLUE },
                  { "a", R_ALPHA },
                  { "diffuse_red", R_RED },
                  { "diffuse_green", R_GREEN },
                  { "diffuse_blue", R_BLUE } };

    if (kind == K_FACE && list && (pell_word_is(word, length, "vertex_indices") || pell_word_is(word, length, "vertex_index")))
        return R_FACE;
    if (kind == K_STRIPS && list && (pell_word_is(word, length, "vertex_indices") || pell_word_is(word, length, "vertex_index")))
        return R_STRIP;
    for (size_t i = 0; kind == K_VERTEX && !list && i < PELL_COUNT(names); i++)
        if (pell_word_is(word, length, names[i].name))
            return names[i].role;
    return R_NONE;
}

static enum pell_result read_element(struct ply *p)
{
    const char *word;
    size_t length = pell_lex_word(&p->lex, &word);
    struct element *e = &p->elements[p->num_elements];
    struct pell_text text;
    double count;

    if (p->num_elements == MAX_ELEMENTS)
        return pell_error(p->ctx, PELL_ERR_UNSUPPORTED, pell_lex_where(&p->lex, p->import->path, &text), NULL,
                          "more than %d elements are not read", MAX_ELEMENTS);
    show_word(word, length, e->name);
    e->kind = pell_word_is(word, length, "vertex")      ? K_VERTEX
              : pell_word_is(word, length, "face")      ? K_FACE
              : pell_word_is(word, length, "tristrips") ? K_STRIPS
                                                        : K_OTHER;
    for (size_t i = 0; i < p->num_elements; i++)
        if (e->kind != K_OTHER && p->elements[i].kind == e->kind)
            return bad_header(p, "an element must be declared once", word, length);
    length = pell_lex_word(&p->lex, &word);
    if (!pell_parse_number(word, length, &count) || !(count >= 0.0 && count <= 9e15) || count != floor(count))
        return bad_header(p, "the count of an element must be a whole number of at most 9e15", word, length);
    e->count = (int64_t) count;
    e->first_property = p->num_properties;
    e->num_properties = 0;
    p->num_elements++;
    return PELL_OK;
}

static enum pell_result read_property(struct ply *p)
{
    const char *word;
    size_t length = pell_lex_word(&p->lex, &word);
    struct property *property = &p->properties[p->num_properties];
    struct element *e = p->num_elements ? &p->elements[p->num_elements - 1] : NULL;
    struct pell_text text;

    if (!e)
        return bad_header(p, "an element must come before its properties", word, length);
    if (p->num_properties == MAX_PROPERTIES)
        return pell_error(p->ctx, PELL_ERR_UNSUPPORTED, pell_lex_where(&p->lex, p->import->path, &text), NULL,
                          "more than %d properties are not read", MAX_PROPERTIES);
    property->count_type = T_NONE;
    if (pell_word_is(word, length, "list")) {
        length = pell_lex_word(&p->lex, &word);
        property->count_type = type_of(word, length);
        if (property->count_type == T_NONE || property->count_type >= T_FLOAT)
            return bad_header(p, "the type of a list's length must be a whole number's", word, length);
        length = pell_lex_word(&p->lex, &word);
    }
    property->type = type_of(word, length);
    if (property->type == T_NONE)
        return bad_header(p, "the type of a property must be one of PLY's (char to double, int8 to float64)", word, length);
    length = pell_lex_word(&p->lex, &word);
    if (!length)
        return bad_header(p, "a property must have a name", word, length);
    property->role = role_of(e->kind, word, length, property->count_type != T_NONE);
    for (size_t i = e->first_property; i < p->num_properties; i++)
        if (property->role != R_NONE && p->properties[i].role == property->role)
            property->role = R_NONE; /* "u" and "texture_u": the first counts */
    e->num_properties++;
    p->num_properties++;
    return PELL_OK;
}

static enum pell_result read_format(struct ply *p)
{
    const char *word;
    const size_t length = pell_lex_word(&p->lex, &word);

    p->binary = !pell_word_is(word, length, "ascii");
    p->big = pell_word_is(word, length, "binary_big_endian");
    return !p->binary || p->big || pell_word_is(word, length, "binary_little_endian")
               ? PELL_OK
               : bad_header(p, "the format must be ascii, binary_little_endian or binary_big_endian", word, length);
}

enum pell_result pell_ply_read_header(struct ply *p)
{
    bool format = false;
    struct pell_text text;
    enum pell_result res;

    pell_lex_next_line(&p->lex); /* "ply" */
    while (p->lex.at < p->lex.end) {
        const char *word;
        const size_t length = pell_lex_word(&p->lex, &word);
        if (pell_word_is(word, length, "end_header")) {
            pell_lex_next_line(&p->lex);
            p->at = (const uint8_t *) p->lex.at;
            if (!format)
                return pell_error(p->ctx, PELL_ERR_FORMAT, pell_lex_where(&p->lex, p->import->path, &text), NULL,
                                  "the header names no format");
            return PELL_OK;
        }
        if (pell_word_is(word, length, "format")) {
            PELL_TRY(read_format(p));
            format = true;
        } else if (pell_word_is(word, length, "element")) {
            PELL_TRY(read_element(p));
        } else if (pell_word_is(word, length, "property")) {
            PELL_TRY(read_property(p));
        } else if (length && !pell_word_is(word, length, "comment") && !pell_word_is(word, length, "obj_info")) {
            return bad_header(p, "a line of the header must begin with format, element, property, comment or end_header", word, length);
        }
        while (!pell_lex_eol(&p->lex))
            p->lex.at++;
        pell_lex_next_line(&p->lex);
    }
    return pell_error(p->ctx, PELL_ERR_FORMAT, pell_lex_where(&p->lex, p->import->path, &text), NULL, "the header has no end_header");

fail:
    return res;
}

/* The least bytes that a row of the element takes. */
static int64_t least_row(const struct ply *p, const struct element *e)
{
    int64_t bytes = 0;

    for (size_t i = 0; i < e->num_properties; i++) {
        const struct property *q = &p->properties[e->first_property + i];
        bytes += !p->binary ? 2 : (int64_t) type_sizes[q->count_type != T_NONE ? q->count_type : q->type];
    }
    return bytes;
}

/* Checks all counts against the file's size; positions must be present. */
enum pell_result pell_ply_check_header(struct ply *p)
{
    const int64_t left = (int64_t) ((const uint8_t *) p->lex.end - p->at) + !p->binary; /* the last line may lack its end */
    const int64_t limit = pell_context_limits(p->ctx)->vertices;
    int64_t need = 0;
    bool axes[3] = { false, false, false }, faces = false;

    for (size_t i = 0; i < p->num_elements; i++) {
        const struct element *e = &p->elements[i];
        int64_t bytes;
        if (__builtin_mul_overflow(e->count, least_row(p, e), &bytes) || __builtin_add_overflow(need, bytes, &need) || need > left)
            return pell_error(p->ctx, PELL_ERR_FORMAT, p->import->path, NULL,
                              "the header announces %lld rows of element \"%s\", which can't fit into the %lld bytes behind it",
                              (long long) e->count, e->name, (long long) (left - !p->binary));
        for (size_t k = e->first_property; k < e->first_property + e->num_properties; k++) {
            if (p->properties[k].role <= R_Z)
                axes[p->properties[k].role] = true;
            faces |= p->properties[k].role == R_FACE || p->properties[k].role == R_STRIP;
        }
        if (e->kind == K_VERTEX && e->count > limit)
            return pell_error(p->ctx, PELL_ERR_UNSUPPORTED, p->import->path, PELL_RAISE_LIMIT("vertices"),
                              "has %lld vertices; %lld are allowed", (long long) e->count, (long long) limit);
        if (e->kind == K_VERTEX && e->num_properties > 0)
            p->num_vertices = (size_t) e->count;
    }
    for (int c = 0; c < 3; c++)
        if (!axes[c])
            return pell_error(p->ctx, PELL_ERR_FORMAT, p->import->path, NULL, "its vertices have no %c, must have x, y and z", "xyz"[c]);
    if (!faces)
        return pell_error(p->ctx, PELL_ERR_FORMAT, p->import->path, "point clouds have no surface that light could enter",
                          "has no faces (vertex_indices) and no tristrips");
    return PELL_OK;
}
