/* SPDX-License-Identifier: MIT
 * obj.c - Wavefront OBJ: polygons with positions, texture coordinates, normals and vertex colours, materials by name.
 *
 * One pass over the text collects triangles of (v, vt, vn); then each mesh, one per object ("o") and material, gets a vertex for each
 * different triple. Smoothing groups are ignored: missing normals are made with a crease angle. */
#include "scene/mesh/polygon.h"
#include "scene/obj/corners.h"
#include "scene/obj/lex.h"
#include "scene/obj/mtl.h"

#include "image/color.h"

#define NO_MATERIAL UINT32_MAX

/* Triangles that follow each other in the file and belong to one mesh. */
struct run {
    size_t first, count; /* triangles */
    uint32_t next;       /* run of the mesh, or UINT32_MAX */
};

/* Faces of one object and material, which become a mesh. */
struct part {
    uint32_t object, material;
    uint32_t name; /* index among the names, or UINT32_MAX */
    uint32_t first_run, last_run;
    size_t triangles;
    bool smooth; /* some of its faces are not after `s off` */
};

/* The mesh that receives faces with a material. */
struct target {
    uint32_t object, part;
};

struct obj {
    struct pell_import *import;
    struct pell_context *ctx;
    struct pell_lex lex;
    struct pell_mtl mtl;
    struct pell_names names; /* of objects and groups */
    struct pell_polygon polygon;
    float *v, *vt, *vn, *color; /* xyz; uv; xyz; linear rgb, NULL until the first vertex that has one */
    size_t num_v, num_vt, num_vn, cap_v, cap_vt, cap_vn, cap_color;
    struct pell_obj_corner *corners, *face;
    size_t num_triangles, cap_triangles, cap_face;
    struct run *runs;
    size_t num_runs, cap_runs;
    struct part *parts;
    size_t num_parts, cap_parts;
    struct target *targets; /* per material, [0] for faces without one */
    size_t num_targets, cap_targets;
    uint32_t object, name, group, material, part;      /* state for the next face; part UINT32_MAX: not known */
    bool flat;                                         /* after `s off` */
    int64_t lines, points, surfaces, degenerate_faces; /* counts of skipped elements */
};

static enum pell_result not_a_number(struct obj *o, const char *what)
{
    struct pell_text text;
    const char *word;
    char copy[64] = "", shown[64];
    const size_t length = pell_lex_word(&o->lex, &word);

    memcpy(copy, word, length < sizeof(copy) ? length : sizeof(copy) - 1);
    return pell_error(o->ctx, PELL_ERR_FORMAT, pell_lex_where(&o->lex, o->import->path, &text), NULL,
                      "%s is \"%s\", must be a finite number", what, pell_printable(copy, shown, sizeof(shown)));
}

/* --- Points ------------------------------------------------------------------------------------------------------------------- */

static enum pell_result grow(struct obj *o, float **array, size_t count, size_t *capacity, size_t each)
{
    const int64_t limit = pell_context_limits(o->ctx)->vertices;
    void *grown = *array;
    struct pell_text text;
    enum pell_result res;

    if (count >= (size_t) limit)
        return pell_error(o->ctx, PELL_ERR_UNSUPPORTED, pell_lex_where(&o->lex, o->import->path, &text), PELL_RAISE_LIMIT("vertices"),
                          "more than %lld vertices are not allowed", (long long) limit);
    if (count < *capacity)
        return PELL_OK;
    res = pell_grow(o->ctx, &grown, count, capacity, each * sizeof(float));
    *array = grown;
    return res;
}

/* The colours of vertices [from, to) are white. */
static enum pell_result whiten(struct obj *o, size_t from, size_t to)
{
    enum pell_result res = PELL_OK;

    for (size_t i = from; i < to && res == PELL_OK; i++) {
        res = grow(o, &o->color, i, &o->cap_color, 3);
        if (res == PELL_OK)
            o->color[3 * i] = o->color[3 * i + 1] = o->color[3 * i + 2] = 1.0f;
    }
    return res;
}

/* "v x y z", "v x y z w" (w belongs to curves), "v x y z r g b" with display values of red, green and blue. */
static enum pell_result read_vertex(struct obj *o)
{
    float extra[4];
    int n = 0;
    enum pell_result res;

    PELL_TRY(grow(o, &o->v, o->num_v, &o->cap_v, 3));
    for (int c = 0; c < 3; c++)
        if (!pell_lex_float(&o->lex, &o->v[3 * o->num_v + (size_t) c]))
            return not_a_number(o, c == 0 ? "x" : c == 1 ? "y" : "z");
    while (n < 4 && !pell_lex_eol(&o->lex) && pell_lex_float(&o->lex, &extra[n]))
        n++;
    if (n >= 3) {
        if (!o->color)
            PELL_TRY(whiten(o, 0, o->num_v));
        PELL_TRY(grow(o, &o->color, o->num_v, &o->cap_color, 3));
        for (int c = 0; c < 3; c++)
            o->color[3 * o->num_v + (size_t) c] = pell_srgb_decode(fminf(1.0f, fmaxf(0.0f, extra[c])));
    } else if (o->color) {
        PELL_TRY(whiten(o, o->num_v, o->num_v + 1));
    }
    o->num_v++;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_uv(struct obj *o)
{
    enum pell_result res;
    float *uv;

    PELL_TRY(grow(o, &o->vt, o->num_vt, &o->cap_vt, 2));
    uv = o->vt + 2 * o->num_vt;
    if (!pell_lex_float(&o->lex, &uv[0]))
        return not_a_number(o, "u");
    if (!pell_lex_float(&o->lex, &uv[1]))
        uv[1] = 0.0f;
    uv[1] = 1.0f - uv[1];
    o->num_vt++;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_normal(struct obj *o)
{
    enum pell_result res;

    PELL_TRY(grow(o, &o->vn, o->num_vn, &o->cap_vn, 3));
    for (int c = 0; c < 3; c++)
        if (!pell_lex_float(&o->lex, &o->vn[3 * o->num_vn + (size_t) c]))
            return not_a_number(o, "a normal's component");
    o->num_vn++;
    return PELL_OK;

fail:
    return res;
}

/* --- Faces -------------------------------------------------------------------------------------------------------------------- */

static enum pell_result bad_reference(struct obj *o, const char *what, int64_t value, size_t count)
{
    struct pell_text text;

    if (count == 0)
        return pell_error(o->ctx, PELL_ERR_FORMAT, pell_lex_where(&o->lex, o->import->path, &text), NULL,
                          "the face refers to %s %lld before there is one", what, (long long) value);
    return pell_error(o->ctx, PELL_ERR_FORMAT, pell_lex_where(&o->lex, o->import->path, &text), NULL,
                      "the face refers to %s %lld, allowed: 1 to %zu, or -1 to -%zu", what, (long long) value, count, count);
}

static bool resolve(int64_t value, size_t count, uint32_t *index)
{
    if (value < 0)
        value += (int64_t) count + 1;
    if (value < 1 || value > (int64_t) count)
        return false;
    *index = (uint32_t) value;
    return true;
}

/* "12", "12/3", "12//4", "12/3/4". */
static enum pell_result read_corner(struct obj *o, struct pell_obj_corner *c)
{
    struct pell_lex *l = &o->lex;
    const char *start = l->at;
    struct pell_text text;
    int64_t value;

    c->vt = c->vn = 0;
    if (!pell_lex_integer(l, &value))
        goto fail;
    if (!resolve(value, o->num_v, &c->v))
        return bad_reference(o, "vertex", value, o->num_v);
    c->v--;
    if (*l->at == '/') {
        l->at++;
        if (*l->at != '/' && (unsigned char) *l->at > ' ') {
            if (!pell_lex_integer(l, &value))
                goto fail;
            if (!resolve(value, o->num_vt, &c->vt))
                return bad_reference(o, "texture coordinate", value, o->num_vt);
        }
        if (*l->at == '/') {
            l->at++;
            if ((unsigned char) *l->at > ' ') {
                if (!pell_lex_integer(l, &value))
                    goto fail;
                if (!resolve(value, o->num_vn, &c->vn))
                    return bad_reference(o, "normal", value, o->num_vn);
            }
        }
    }
    if ((unsigned char) *l->at <= ' ' || *l->at == '\\')
        return PELL_OK;

fail:
    l->at = start;
    {
        const char *word;
        char copy[64] = "", shown[64];
        const size_t length = pell_lex_word(l, &word);
        memcpy(copy, word, length < sizeof(copy) ? length : sizeof(copy) - 1);
        return pell_error(o->ctx, PELL_ERR_FORMAT, pell_lex_where(&o->lex, o->import->path, &text), NULL,
                          "a face's corner is \"%s\", must be whole numbers as in 1, 1/2, 1//3 or 1/2/3, none beyond 2147483647",
                          pell_printable(copy, shown, sizeof(shown)));
    }
}

/* Finds the part of the current object and material. */
static enum pell_result find_part(struct obj *o)
{
    const size_t slot = o->material == NO_MATERIAL ? 0 : (size_t) o->material + 1;
    const int limit = pell_context_limits(o->ctx)->items;
    struct pell_text text;
    void *array = o->targets;
    enum pell_result res = PELL_OK;

    if (o->part != UINT32_MAX)
        return PELL_OK;
    while (o->num_targets <= slot && res == PELL_OK) {
        res = pell_grow(o->ctx, &array, o->num_targets, &o->cap_targets, sizeof(*o->targets));
        o->targets = array;
        if (res == PELL_OK)
            o->targets[o->num_targets++] = (struct target) { UINT32_MAX, UINT32_MAX };
    }
    if (res != PELL_OK)
        return res;
    if (o->targets[slot].object != o->object) {
        if (o->num_parts >= (size_t) limit)
            return pell_error(o->ctx, PELL_ERR_UNSUPPORTED, pell_lex_where(&o->lex, o->import->path, &text), PELL_RAISE_LIMIT("items"),
                              "more than %d meshes (an object's faces of one material) are not allowed", limit);
        array = o->parts;
        res = pell_grow(o->ctx, &array, o->num_parts, &o->cap_parts, sizeof(*o->parts));
        o->parts = array;
        if (res != PELL_OK)
            return res;
        o->parts[o->num_parts] =
            (struct part) { o->object, o->material, o->name != UINT32_MAX ? o->name : o->group, UINT32_MAX, UINT32_MAX, 0, false };
        o->targets[slot] = (struct target) { o->object, (uint32_t) o->num_parts++ };
    }
    o->part = o->targets[slot].part;
    return PELL_OK;
}

/* `count` triangles have been added to the current part. */
static enum pell_result extend_run(struct obj *o, size_t count)
{
    struct part *part = &o->parts[o->part];
    struct run *last = part->last_run != UINT32_MAX ? &o->runs[part->last_run] : NULL;
    void *array = o->runs;
    enum pell_result res;

    part->triangles += count;
    part->smooth |= !o->flat;
    if (last && last->first + last->count == o->num_triangles - count) {
        last->count += count;
        return PELL_OK;
    }
    res = pell_grow(o->ctx, &array, o->num_runs, &o->cap_runs, sizeof(*o->runs));
    o->runs = array;
    if (res != PELL_OK)
        return res;
    o->runs[o->num_runs] = (struct run) { o->num_triangles - count, count, UINT32_MAX };
    if (part->last_run != UINT32_MAX)
        o->runs[part->last_run].next = (uint32_t) o->num_runs;
    else
        part->first_run = (uint32_t) o->num_runs;
    part->last_run = (uint32_t) o->num_runs++;
    return PELL_OK;
}

static enum pell_result add_triangles(struct obj *o, size_t corners)
{
    const int64_t limit = pell_context_limits(o->ctx)->triangles;
    struct pell_text text;
    enum pell_result res;

    if ((int64_t) (o->num_triangles + corners - 2) > limit)
        return pell_error(o->ctx, PELL_ERR_UNSUPPORTED, pell_lex_where(&o->lex, o->import->path, &text), PELL_RAISE_LIMIT("triangles"),
                          "more than %lld triangles are not allowed", (long long) limit);
    while (o->num_triangles + corners - 2 > o->cap_triangles) {
        void *array = o->corners;
        size_t capacity = o->cap_triangles;
        res = pell_grow(o->ctx, &array, capacity, &capacity, 3 * sizeof(*o->corners));
        o->corners = array;
        if (res != PELL_OK)
            return res;
        o->cap_triangles = capacity;
    }
    if (corners == 3) {
        memcpy(o->corners + 3 * o->num_triangles, o->face, 3 * sizeof(*o->face));
    } else {
        PELL_TRY(pell_polygon_reserve(&o->polygon, corners));
        for (size_t i = 0; i < corners; i++)
            memcpy(o->polygon.point + 3 * i, o->v + 3 * (size_t) o->face[i].v, 3 * sizeof(float));
        if (!pell_polygon_triangulate(&o->polygon, corners))
            pell_warn(o->ctx, pell_lex_where(&o->lex, o->import->path, &text),
                      "cut the face into triangles in the program that it comes from",
                      "a face of %zu corners crosses itself, or is too large to be cut well: its shape may be wrong", corners);
        for (size_t i = 0; i < 3 * (corners - 2); i++)
            o->corners[3 * o->num_triangles + i] = o->face[o->polygon.triangle[i]];
    }
    o->num_triangles += corners - 2;
    PELL_TRY(find_part(o));
    PELL_TRY(extend_run(o, corners - 2));
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_face(struct obj *o)
{
    size_t count = 0;
    enum pell_result res;

    for (;;) {
        void *array = o->face;
        pell_lex_blank(&o->lex);
        if (pell_lex_eol(&o->lex) || *o->lex.at == '#')
            break;
        if (count >= o->cap_face) {
            res = pell_grow(o->ctx, &array, count, &o->cap_face, sizeof(*o->face));
            o->face = array;
            if (res != PELL_OK)
                goto fail;
        }
        PELL_TRY(read_corner(o, &o->face[count]));
        count++;
    }
    if (count < 3) {
        o->degenerate_faces++;
        return PELL_OK;
    }
    PELL_TRY(add_triangles(o, count));
    return PELL_OK;

fail:
    return res;
}

/* --- Other lines -------------------------------------------------------------------------------------------------------------- */

static enum pell_result read_object_name(struct obj *o, bool is_group)
{
    const char *name;
    const size_t length = pell_lex_rest(&o->lex, &name);
    bool fresh;
    enum pell_result res;

    if (is_group)
        return o->group == UINT32_MAX ? pell_names_enter(&o->names, name, length, &o->group, &fresh) : PELL_OK;
    PELL_TRY(pell_names_enter(&o->names, name, length, &o->name, &fresh));
    o->object++;
    o->part = UINT32_MAX;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result use_material(struct obj *o)
{
    const char *name;
    const size_t length = pell_lex_rest(&o->lex, &name);

    o->part = UINT32_MAX;
    o->material = NO_MATERIAL;
    return length ? pell_mtl_material(&o->mtl, name, length, &o->material) : PELL_OK;
}

/* "mtllib a.mtl b.mtl"; or one name with blanks in it, which shows by ending the line with the only ".mtl". */
static enum pell_result read_libraries(struct obj *o)
{
    const char *rest, *at, *end;
    const size_t length = pell_lex_rest(&o->lex, &rest);
    int endings = 0;
    struct pell_text text;
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i + 4 <= length; i++)
        endings += memcmp(rest + i, ".mtl", 4) == 0;
    end = rest + length;
    for (at = rest; at < end && res == PELL_OK;) {
        const char *stop = at;
        while (stop < end && (endings == 1 || (*stop != ' ' && *stop != '\t')))
            stop++;
        if (stop > at) {
            char *name = pell_strndup(o->ctx, at, (size_t) (stop - at));
            if (!name)
                return PELL_ERR_NOMEM;
            for (char *c = name; *c; c++)
                if (*c == '\\')
                    *c = '/';
            res = pell_mtl_library(&o->mtl, pell_lex_where(&o->lex, o->import->path, &text), name);
            pell_free(o->ctx, name);
        }
        at = stop + (stop < end);
    }
    return res;
}

/* Smoothing groups other than none are all smooth, with creases. */
static void read_smoothing(struct obj *o)
{
    const char *group;
    const size_t length = pell_lex_word(&o->lex, &group);

    o->flat = pell_word_is(group, length, "off") || pell_word_is(group, length, "0");
}

static enum pell_result read_line(struct obj *o)
{
    struct pell_lex *l = &o->lex;
    const char *key;
    const size_t length = pell_lex_word(l, &key);

    if (length && *key == '#') {
        while (!pell_lex_eol(l))
            l->at++; /* a backslash at the end of a comment is a part of it */
        return PELL_OK;
    }
#define IS(text) pell_word_is(key, length, text)
    if (length == 1) {
        switch (*key) {
        case 'v': return read_vertex(o);
        case 'f': return read_face(o);
        case 'o': return read_object_name(o, false);
        case 'g': return read_object_name(o, true);
        case 'l': o->lines++; break;
        case 'p': o->points++; break;
        case 's': read_smoothing(o); break;
        default: break;
        }
    } else if (length == 2 && key[0] == 'v') {
        if (key[1] == 't')
            return read_uv(o);
        if (key[1] == 'n')
            return read_normal(o);
    } else if (IS("usemtl")) {
        return use_material(o);
    } else if (IS("mtllib")) {
        return read_libraries(o);
    } else if (IS("fo")) {
        return read_face(o); /* an obsolete synonym of f */
    } else if (IS("curv") || IS("curv2") || IS("surf")) {
        o->surfaces++;
    }
#undef IS
    return PELL_OK;
}

/* --- Meshes ------------------------------------------------------------------------------------------------------------------- */

static enum pell_result fill_mesh(struct obj *o, struct pell_mesh *mesh, const struct pell_obj_corner *unique)
{
    bool uv = false;

    for (size_t i = 0; i < mesh->num_vertices && !pell_cancelled_at(o->ctx, i); i++) {
        memcpy(mesh->position + 3 * i, o->v + 3 * (size_t) unique[i].v, 3 * sizeof(float));
        if (unique[i].vn)
            memcpy(mesh->normal + 3 * i, o->vn + 3 * ((size_t) unique[i].vn - 1), 3 * sizeof(float));
        uv |= unique[i].vt != 0;
    }
    if (uv) {
        mesh->uv[0] = pell_calloc(o->ctx, mesh->num_vertices, 2 * sizeof(float));
        if (!mesh->uv[0])
            return PELL_ERR_NOMEM;
        for (size_t i = 0; i < mesh->num_vertices; i++)
            if (unique[i].vt)
                memcpy(mesh->uv[0] + 2 * i, o->vt + 2 * ((size_t) unique[i].vt - 1), 2 * sizeof(float));
    }
    if (o->color) {
        mesh->color = pell_alloc_array(o->ctx, mesh->num_vertices, 4 * sizeof(float));
        if (!mesh->color)
            return PELL_ERR_NOMEM;
        for (size_t i = 0; i < mesh->num_vertices; i++) {
            memcpy(mesh->color + 4 * i, o->color + 3 * (size_t) unique[i].v, 3 * sizeof(float));
            mesh->color[4 * i + 3] = 1.0f;
        }
    }
    return PELL_OK;
}

static enum pell_result build_part(struct obj *o, const struct part *part, struct pell_obj_numbering *n)
{
    struct pell_scene *scene = o->import->scene;
    struct pell_mesh *mesh;
    size_t index, at = 0;
    enum pell_result res;

    n->count = n->used = 0;
    if (n->num_slots)
        memset(n->slots, 0, n->num_slots * sizeof(*n->slots));
    for (uint32_t r = part->first_run; r != UINT32_MAX; r = o->runs[r].next)
        for (size_t i = 3 * o->runs[r].first; i < 3 * (o->runs[r].first + o->runs[r].count); i++) {
            uint32_t number;
            PELL_TRY(pell_obj_number_corner(n, &o->corners[i], &number));
            o->corners[i].v = number; /* from here on the corner holds its vertex index in the mesh */
        }
    PELL_TRY(pell_scene_add_mesh(scene, part->name != UINT32_MAX ? o->names.names[part->name].text : "", &index));
    scene->meshes[index].object = (int) part->object;
    scene->meshes[index].flat = !part->smooth;
    scene->meshes[index].material = part->material == NO_MATERIAL ? -1 : (int) part->material;
    PELL_TRY(pell_mesh_allocate(scene, index, (uint32_t) n->count, (uint32_t) part->triangles));
    mesh = &scene->meshes[index];
    for (uint32_t r = part->first_run; r != UINT32_MAX; r = o->runs[r].next)
        for (size_t i = 3 * o->runs[r].first; i < 3 * (o->runs[r].first + o->runs[r].count); i++)
            mesh->index[at++] = o->corners[i].v;
    PELL_TRY(fill_mesh(o, mesh, n->unique));
    for (size_t i = 0; i < n->count; i++)
        n->first[n->unique[i].v] = 0;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result build(struct obj *o)
{
    struct pell_obj_numbering n = { .ctx = o->ctx };
    enum pell_result res = PELL_ERR_NOMEM;

    n.first = pell_calloc(o->ctx, o->num_v, sizeof(*n.first));
    if (!n.first)
        goto fail;
    for (size_t i = 0; i < o->num_parts; i++) {
        if (pell_cancelled(o->ctx)) {
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
        /* Otherwise a table left by one large mesh would be cleared for every small one. */
        if (n.num_slots > 4096 && n.num_slots > 64 * o->parts[i].triangles) {
            pell_free(o->ctx, n.slots);
            n.slots = NULL;
            n.num_slots = 0;
        }
        PELL_TRY(build_part(o, &o->parts[i], &n));
    }
    res = PELL_OK;

fail:
    pell_free(o->ctx, n.first);
    pell_free(o->ctx, n.unique);
    pell_free(o->ctx, n.slots);
    return res;
}

/* Whether the scene file or the caller defines the material. */
static bool is_defined_elsewhere(const struct pell_import *import, const char *name)
{
    const struct pell_loader *l = import->loader;

    return l->params->material || (l->defines && l->defines(l->defines_of, name));
}

/* Materials that no library defines are marble, as objects without a material are. */
static enum pell_result settle_materials(struct obj *o)
{
    const char *first = NULL;
    enum pell_result res;
    size_t missing = 0;

    for (size_t i = 0; i < o->mtl.names.count; i++) {
        if (o->mtl.defined[i])
            continue;
        PELL_TRY(pell_material_apply(o->import->scene, i, o->import->path, "marble"));
        if (is_defined_elsewhere(o->import, o->import->scene->materials[i].name))
            continue;
        first = first ? first : o->import->scene->materials[i].name;
        missing++;
    }
    if (missing)
        pell_warn(o->ctx, o->import->path, "--material NAME chooses another for all",
                  "%zu material%s no library defines (\"%s\"%s): marble is used", missing, missing > 1 ? "s which" : " which", first,
                  missing > 1 ? ", ..." : "");
    return PELL_OK;

fail:
    return res;
}

static void finish(struct obj *o)
{
    pell_mtl_finish(&o->mtl);
    pell_names_finish(&o->names);
    pell_polygon_finish(&o->polygon);
    pell_free(o->ctx, o->v);
    pell_free(o->ctx, o->vt);
    pell_free(o->ctx, o->vn);
    pell_free(o->ctx, o->color);
    pell_free(o->ctx, o->corners);
    pell_free(o->ctx, o->face);
    pell_free(o->ctx, o->runs);
    pell_free(o->ctx, o->parts);
    pell_free(o->ctx, o->targets);
}

enum pell_result pell_import_obj(struct pell_import *import, const uint8_t *data, size_t size)
{
    struct obj o = { .import = import,
                     .ctx = import->ctx,
                     .lex = { (const char *) data, (const char *) data + size, 1 },
                     .name = UINT32_MAX,
                     .group = UINT32_MAX,
                     .material = NO_MATERIAL,
                     .part = UINT32_MAX };
    enum pell_result res = PELL_OK;
    int64_t next_look = 0;

    o.mtl.import = import;
    o.mtl.names.where = o.mtl.libraries.where = o.names.where = import->path;
    o.mtl.names.ctx = o.mtl.libraries.ctx = o.names.ctx = o.polygon.ctx = import->ctx;
    import->default_mm_per_unit = 0.0;
    if (size >= 3 && memcmp(data, "\xef\xbb\xbf", 3) == 0)
        o.lex.at += 3;
    while (o.lex.at < o.lex.end) {
        PELL_TRY(read_line(&o));
        pell_lex_next_line(&o.lex);
        if (o.lex.line >= next_look) {
            next_look = o.lex.line + 4096;
            if (pell_cancelled(o.ctx)) {
                res = PELL_ERR_CANCELLED;
                goto fail;
            }
        }
    }
    if (o.num_triangles == 0) {
        res = pell_error(o.ctx, PELL_ERR_FORMAT, import->path, NULL, "%s",
                         memchr(data, 0, size) ? "is no OBJ: it is not text"
                         : o.degenerate_faces  ? "holds no faces of three corners or more"
                                               : "holds no faces");
        goto fail;
    }
    PELL_TRY(settle_materials(&o));
    PELL_TRY(build(&o));
    if (o.lines || o.points || o.surfaces || o.degenerate_faces)
        pell_warn(o.ctx, import->path, NULL, "what follows is left out: %s, %s, %s, %s of fewer than three corners",
                  pell_counted(o.lines, "line", "lines").str, pell_counted(o.points, "point", "points").str,
                  pell_counted(o.surfaces, "curve or surface", "curves or surfaces").str,
                  pell_counted(o.degenerate_faces, "face", "faces").str);

fail:
    finish(&o);
    return res;
}
