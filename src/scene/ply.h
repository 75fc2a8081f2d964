/* SPDX-License-Identifier: MIT
 *
 * ply.h - what the two parts of the PLY reader share: the layout that a header declares. Private to ply.c and ply_header.c.
 */
#ifndef PELL_SCENE_PLY_H
#define PELL_SCENE_PLY_H

#include "scene/mesh/polygon.h"
#include "scene/obj/lex.h"
#include "scene/scene.h"

enum type { T_INT8, T_UINT8, T_INT16, T_UINT16, T_INT32, T_UINT32, T_FLOAT, T_DOUBLE, T_NONE };

static const size_t type_sizes[] = { 1, 1, 2, 2, 4, 4, 4, 8 };

/* The role of a vertex property. */
enum role { R_X, R_Y, R_Z, R_NX, R_NY, R_NZ, R_U, R_V, R_RED, R_GREEN, R_BLUE, R_ALPHA, R_FACE, R_STRIP, R_NONE };

enum { MAX_ELEMENTS = 64, MAX_PROPERTIES = 256 };

struct property {
    enum type type, count_type; /* count_type T_NONE: no list */
    enum role role;
};

enum kind { K_VERTEX, K_FACE, K_STRIPS, K_OTHER };

struct element {
    enum kind kind;
    char name[64]; /* as printed in messages */
    int64_t count;
    size_t first_property, num_properties;
};

struct ply {
    struct pell_import *import;
    struct pell_context *ctx;
    struct pell_lex lex; /* the header, and the body where it is text */
    const uint8_t *at, *end;
    bool binary, big;
    struct element elements[MAX_ELEMENTS];
    struct property properties[MAX_PROPERTIES];
    size_t num_elements, num_properties;

    size_t num_vertices;
    float *position, *normal, *uv, *color;
    uint32_t *corners;
    size_t num_triangles, cap_triangles;
    int64_t *list;
    size_t cap_list;
    struct pell_polygon polygon;
    int64_t degenerate_faces; /* faces with fewer than three corners */
};

/* Fills elements and properties; p->at is then the body's first byte. */
PELL_NODISCARD enum pell_result pell_ply_read_header(struct ply *p);
/* Checks all counts against the file's size; positions must be present. */
PELL_NODISCARD enum pell_result pell_ply_check_header(struct ply *p);

#endif
