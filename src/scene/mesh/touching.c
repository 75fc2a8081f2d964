/* SPDX-License-Identifier: MIT
 *
 * touching.c - joins the objects of a mesh file that touch and scatter alike: light crosses between them as it does inside one solid. Two
 * closed objects are joined where their surfaces touch or intersect, open ones where they are the pieces of a closed surface. Objects that
 * a scene file or a program puts next to each other stay apart.
 *
 * Where faces of closed objects of different media coincide, as those of a glass and the drink in it, rays would meet either of them. There
 * the smaller object is extended a little into the other one: of solids that overlap, the one that a ray entered last is its medium.
 */
#include "scene/mesh/touching.h"
#include "math/near.h"
#include "scene/mesh/topology.h"

#include <stdlib.h>
#include <string.h>

#define GAP 1e-5       /* of the smaller object's extent: surfaces this near touch */
#define ROUNDING 4e-7  /* of the largest coordinate */
#define OVERLAP 10.0   /* in gaps: how far objects whose faces coincide overlap */
#define STEPS_MOST 2e8 /* tests of triangles and boxes, about a second; objects that are left after that stay apart */

struct object {
    const uint32_t *meshes;
    size_t count;
    struct pell_dvec3 lo, hi;
    int file;                                /* pell_mesh.file */
    enum { UNKNOWN, OPEN, CLOSED } boundary; /* UNKNOWN until it is asked for */
};

struct triangle {
    struct pell_dvec3 corner[3], lo, hi; /* corners; box */
};

struct triangles {
    struct triangle *at;
    size_t count, capacity;
};

struct search {
    struct pell_scene *scene;
    uint32_t *same; /* per material: pell_scene_same_media */
    struct object *objects;
    size_t count;
    uint32_t *set;            /* per object: union-find parent */
    struct triangles near[2]; /* of two objects, near the other one */
    double steps;
    size_t extended; /* number of objects */
};

static double extent(const struct object *o)
{
    return fmax(o->hi.x - o->lo.x, fmax(o->hi.y - o->lo.y, o->hi.z - o->lo.z));
}

static double largest_coordinate(const struct object *o)
{
    return fmax(fmax(fmax(fabs(o->lo.x), fabs(o->hi.x)), fmax(fabs(o->lo.y), fabs(o->hi.y))), fmax(fabs(o->lo.z), fabs(o->hi.z)));
}

/* mm: surfaces of two objects that are nearer touch. */
static double gap_between(const struct object *a, const struct object *b)
{
    return GAP * fmin(extent(a), extent(b)) + ROUNDING * fmax(largest_coordinate(a), largest_coordinate(b));
}

static void widen_box(struct pell_dvec3 *lo, struct pell_dvec3 *hi, struct pell_dvec3 p)
{
    *lo = dvec3(fmin(lo->x, p.x), fmin(lo->y, p.y), fmin(lo->z, p.z));
    *hi = dvec3(fmax(hi->x, p.x), fmax(hi->y, p.y), fmax(hi->z, p.z));
}

static bool boxes_meet(struct pell_dvec3 lo, struct pell_dvec3 hi, struct pell_dvec3 other_lo, struct pell_dvec3 other_hi, double gap)
{
    return lo.x <= other_hi.x + gap && other_lo.x <= hi.x + gap && lo.y <= other_hi.y + gap && other_lo.y <= hi.y + gap &&
           lo.z <= other_hi.z + gap && other_lo.z <= hi.z + gap;
}

/* --- Two meshes ------------------------------------------------------------------------------------------------------------------- */

/* Lists the triangles of a mesh that are near an object, sorted along x. */
static enum pell_result list_near(struct search *s, const struct pell_mesh *mesh, const struct object *other, double gap,
                                  struct triangles *out)
{
    out->count = 0;
    s->steps += mesh->num_triangles;
    for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(s->scene->ctx, i); i++) {
        struct triangle t;
        for (int k = 0; k < 3; k++)
            t.corner[k] = dvec3_load(mesh->position + 3 * (size_t) mesh->index[3 * (size_t) i + (size_t) k]);
        t.lo = t.hi = t.corner[0];
        widen_box(&t.lo, &t.hi, t.corner[1]);
        widen_box(&t.lo, &t.hi, t.corner[2]);
        if (!boxes_meet(t.lo, t.hi, other->lo, other->hi, gap))
            continue;
        if (pell_grow(s->scene->ctx, (void **) &out->at, out->count + 1, &out->capacity, sizeof(*out->at)) != PELL_OK)
            return PELL_ERR_NOMEM;
        out->at[out->count++] = t;
    }
    return PELL_OK;
}

static int compare_starts(const void *a, const void *b)
{
    const struct triangle *s = a, *t = b;

    return s->lo.x < t->lo.x ? -1 : s->lo.x > t->lo.x;
}

/* Sweeps along x over both lists. */
static bool lists_touch(struct search *s, double gap)
{
    struct triangles *a = &s->near[0], *b = &s->near[1];
    double longest = 0.0; /* in b, along x */
    size_t first = 0;

    if (a->count == 0 || b->count == 0)
        return false;
    qsort(a->at, a->count, sizeof(*a->at), compare_starts);
    qsort(b->at, b->count, sizeof(*b->at), compare_starts);
    for (size_t k = 0; k < b->count; k++)
        longest = fmax(longest, b->at[k].hi.x - b->at[k].lo.x);
    for (size_t i = 0; i < a->count && s->steps < STEPS_MOST && !pell_cancelled_at(s->scene->ctx, i); i++) {
        const struct triangle *t = &a->at[i];
        while (first < b->count && b->at[first].lo.x + longest + gap < t->lo.x)
            first++;
        for (size_t k = first; k < b->count && b->at[k].lo.x <= t->hi.x + gap; k++, s->steps++)
            if (boxes_meet(t->lo, t->hi, b->at[k].lo, b->at[k].hi, gap) && pell_triangles_touch(t->corner, b->at[k].corner, gap * gap))
                return true;
    }
    return false;
}

static bool is_translucent(const struct pell_scene *scene, const struct pell_mesh *mesh)
{
    return mesh->num_triangles > 0 && !scene->materials[mesh->material].opaque;
}

static enum pell_result objects_touch(struct search *s, const struct object *a, const struct object *b, double gap, bool *touch)
{
    const struct pell_scene *scene = s->scene;
    enum pell_result res = PELL_OK;

    *touch = false;
    for (size_t i = 0; i < a->count && !*touch; i++)
        for (size_t k = 0; k < b->count && !*touch && s->steps < STEPS_MOST; k++) {
            const struct pell_mesh *m = &scene->meshes[a->meshes[i]], *n = &scene->meshes[b->meshes[k]];
            if (!is_translucent(scene, m) || !is_translucent(scene, n) || s->same[m->material] != s->same[n->material])
                continue;
            PELL_TRY(list_near(s, m, b, gap, &s->near[0]));
            PELL_TRY(list_near(s, n, a, gap, &s->near[1]));
            *touch = lists_touch(s, gap);
        }

fail:
    return res;
}

/* --- Objects of different media ------------------------------------------------------------------------------------------------------ */

/* Whether a point is within `gap` of a triangle of the list, which is sorted along x; `longest`: of its triangles, along x. */
static bool is_near(struct search *s, struct pell_dvec3 p, const struct triangles *list, double longest, double gap)
{
    size_t low = 0, high = list->count;

    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (list->at[middle].lo.x < p.x - longest - gap)
            low = middle + 1;
        else
            high = middle;
    }
    for (; low < list->count && list->at[low].lo.x <= p.x + gap; low++) {
        const struct triangle *t = &list->at[low];
        double u, v;
        s->steps++;
        if (boxes_meet(p, p, t->lo, t->hi, gap) &&
            pell_triangle_distance2(dvec3_sub(p, t->corner[0]), dvec3_sub(t->corner[1], t->corner[0]),
                                    dvec3_sub(t->corner[2], t->corner[0]), &u, &v) <= gap * gap)
            return true;
    }
    return false;
}

/* Marks the triangles of a mesh that lie on those of s->near[0]; returns whether there are any. */
static bool mark_coinciding(struct search *s, const struct pell_mesh *mesh, double gap, bool *marks)
{
    struct triangles *list = &s->near[0];
    double longest = 0.0;
    bool any = false;

    qsort(list->at, list->count, sizeof(*list->at), compare_starts);
    for (size_t k = 0; k < list->count; k++)
        longest = fmax(longest, list->at[k].hi.x - list->at[k].lo.x);
    for (uint32_t i = 0; i < mesh->num_triangles && s->steps < STEPS_MOST && !pell_cancelled_at(s->scene->ctx, i); i++) {
        const uint32_t *index = mesh->index + 3 * (size_t) i;
        struct pell_dvec3 middle = { 0.0, 0.0, 0.0 };
        bool on = true;
        for (int k = 0; k < 3 && on; k++) {
            const struct pell_dvec3 p = dvec3_load(mesh->position + 3 * (size_t) index[k]);
            middle = dvec3_mad(middle, 1.0 / 3.0, p);
            on = is_near(s, p, list, longest, gap);
        }
        if (on && is_near(s, middle, list, longest, gap))
            marks[i] = any = true;
    }
    return any;
}

static double corner_angle(const struct pell_dvec3 p[3], int k)
{
    const struct pell_dvec3 a = dvec3_sub(p[(k + 1) % 3], p[k]), b = dvec3_sub(p[(k + 2) % 3], p[k]), n = dvec3_cross(a, b);

    return atan2(sqrt(dvec3_dot(n, n)), dvec3_dot(a, b));
}

/* Adds the normal of a triangle to those of its corners' positions. */
static void add_normal(const struct pell_topology *t, const struct pell_mesh *mesh, uint32_t triangle, uint32_t all,
                       struct pell_dvec3 *normal)
{
    const struct pell_dvec3 n = dvec3_normalize(dvec3_load(t->face + 3 * (size_t) all));
    struct pell_dvec3 p[3];

    for (int k = 0; k < 3; k++)
        p[k] = dvec3_load(mesh->position + 3 * (size_t) mesh->index[3 * (size_t) triangle + (size_t) k]);
    for (int k = 0; k < 3; k++) {
        struct pell_dvec3 *sum = &normal[t->corner[3 * all + (uint32_t) k]];
        *sum = dvec3_mad(*sum, corner_angle(p, k), n);
    }
}

/* Moves the marked ones of a closed object's triangles outwards, with all vertices in the places of their corners. */
static enum pell_result extend(const struct search *s, const struct object *o, const bool *marks, double distance)
{
    struct pell_scene *scene = s->scene;
    struct pell_topology t;
    struct pell_dvec3 *normal;
    enum pell_result res = pell_topology_make(&t, scene, o->meshes, o->count);

    if (res != PELL_OK)
        return res;
    normal = pell_calloc(scene->ctx, t.num_positions, sizeof(*normal));
    for (size_t m = 0; normal && m < o->count; m++)
        for (uint32_t i = t.first_triangle[m]; i < t.first_triangle[m + 1]; i++)
            if (marks[i])
                add_normal(&t, &scene->meshes[o->meshes[m]], i - t.first_triangle[m], i, normal);
    for (size_t m = 0; normal && m < o->count; m++)
        for (uint32_t i = t.first_vertex[m]; i < t.first_vertex[m + 1]; i++) {
            float *at = scene->meshes[o->meshes[m]].position + 3 * (size_t) (i - t.first_vertex[m]);
            const struct pell_dvec3 n = normal[t.weld[i]];
            if (dvec3_dot(n, n) > 0.0)
                vec3_store(dvec3_narrow(dvec3_mad(dvec3_load(at), distance, dvec3_normalize(n))), at);
        }
    res = normal ? PELL_OK : PELL_ERR_NOMEM;
    pell_free(scene->ctx, normal);
    pell_topology_finish(&t);
    return res;
}

/* Extends an object where its faces coincide with those of other media in another one; *any: they do. */
static enum pell_result extend_into(struct search *s, const struct object *o, const struct object *other, double gap, bool *any)
{
    const struct pell_scene *scene = s->scene;
    size_t triangles = 0, first = 0;
    bool *marks;
    enum pell_result res = PELL_OK;

    *any = false;
    for (size_t i = 0; i < o->count; i++)
        triangles += scene->meshes[o->meshes[i]].num_triangles;
    marks = pell_calloc(scene->ctx, triangles, sizeof(*marks));
    if (!marks)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < o->count; first += scene->meshes[o->meshes[i++]].num_triangles)
        for (size_t k = 0; k < other->count && s->steps < STEPS_MOST; k++) {
            const struct pell_mesh *m = &scene->meshes[o->meshes[i]], *n = &scene->meshes[other->meshes[k]];
            if (!is_translucent(scene, m) || !is_translucent(scene, n) || s->same[m->material] == s->same[n->material])
                continue;
            PELL_TRY(list_near(s, n, o, gap, &s->near[0]));
            *any |= s->near[0].count > 0 && mark_coinciding(s, m, gap, marks + first);
        }
    if (*any)
        res = extend(s, o, marks, OVERLAP * gap);

fail:
    pell_free(scene->ctx, marks);
    return res;
}

/* The smaller object has its vertices on the larger one, in most cases. */
static enum pell_result overlap(struct search *s, const struct object *a, const struct object *b, double gap)
{
    const bool a_first = extent(a) < extent(b);
    bool any;
    enum pell_result res = extend_into(s, a_first ? a : b, a_first ? b : a, gap, &any);

    if (res == PELL_OK && !any)
        res = extend_into(s, a_first ? b : a, a_first ? a : b, gap, &any);
    s->extended += res == PELL_OK && any;
    return res;
}

/* --- All objects ------------------------------------------------------------------------------------------------------------------ */

/* Also orients the surface: where two closed objects share edges, the parts of their union could not be told apart. */
static enum pell_result is_closed(const struct search *s, const uint32_t *meshes, size_t count, bool *closed)
{
    struct pell_topology t;
    enum pell_result res = pell_topology_make(&t, s->scene, meshes, count);

    *closed = false;
    if (res != PELL_OK)
        return res;
    res = pell_orient(s->scene, &t, meshes, count, s->scene->path);
    *closed = res == PELL_OK && t.num_parts > 0 && pell_topology_count_edges(&t).unbalanced == 0;
    pell_topology_finish(&t);
    return res;
}

static enum pell_result find_boundary(const struct search *s, struct object *o)
{
    bool closed = false;
    enum pell_result res = PELL_OK;

    if (o->boundary == UNKNOWN)
        res = is_closed(s, o->meshes, o->count, &closed);
    if (o->boundary == UNKNOWN)
        o->boundary = closed ? CLOSED : OPEN;
    return res;
}

static enum pell_result list_objects(struct search *s, const uint32_t *order)
{
    const struct pell_scene *scene = s->scene;

    for (size_t i = 0, end; i < scene->num_meshes; i = end) {
        struct object o = { .meshes = order + i, .lo = { INFINITY, INFINITY, INFINITY }, .hi = { -INFINITY, -INFINITY, -INFINITY } };
        bool translucent = false;
        for (end = i; end < scene->num_meshes && scene->meshes[order[end]].object == scene->meshes[order[i]].object; end++) {
            const struct pell_mesh *m = &scene->meshes[order[end]];
            translucent |= is_translucent(scene, m);
            for (size_t k = 0; k < 3 * (size_t) m->num_triangles && !pell_cancelled_at(scene->ctx, k); k++)
                widen_box(&o.lo, &o.hi, dvec3_load(m->position + 3 * (size_t) m->index[k]));
        }
        o.count = end - i;
        o.file = scene->meshes[order[i]].file;
        if (translucent && o.file > 0)
            s->objects[s->count++] = o;
    }
    return pell_cancelled(scene->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

static int compare_objects(const void *a, const void *b)
{
    const struct object *s = a, *t = b;

    return s->lo.x != t->lo.x ? (s->lo.x < t->lo.x ? -1 : 1) : s->meshes < t->meshes ? -1 : s->meshes > t->meshes;
}

/* A copy of an object at its place, which pell_check_scene reports. */
static bool coincide(const struct object *a, const struct object *b)
{
    return memcmp(&a->lo, &b->lo, sizeof(a->lo)) == 0 && memcmp(&a->hi, &b->hi, sizeof(a->hi)) == 0;
}

/* Joins the objects that touch another one of their kind, closed or open. */
static enum pell_result join_touching(struct search *s)
{
    enum pell_result res = PELL_OK;

    for (uint32_t i = 0; i < s->count; i++)
        for (uint32_t k = i + 1; k < s->count && s->steps < STEPS_MOST; k++, s->steps++) {
            struct object *a = &s->objects[i], *b = &s->objects[k];
            const double gap = gap_between(a, b);
            bool touch;
            if (b->lo.x > a->hi.x + gap)
                break;
            if (!boxes_meet(a->lo, a->hi, b->lo, b->hi, gap) || coincide(a, b) || pell_union_root(s->set, i) == pell_union_root(s->set, k))
                continue;
            PELL_TRY(find_boundary(s, a));
            PELL_TRY(find_boundary(s, b));
            if (a->boundary != b->boundary)
                continue;
            if (a->boundary == CLOSED)
                PELL_TRY(overlap(s, a, b, gap));
            if (a->file != b->file)
                continue;
            PELL_TRY(objects_touch(s, a, b, gap, &touch));
            if (touch)
                pell_union_join(s->set, i, k);
        }

fail:
    return res;
}

/* Makes the objects of one set an assembly; open objects only if they are closed together. `members` are the set's objects. */
static enum pell_result make_assembly(struct search *s, const uint32_t *members, size_t count, uint32_t *meshes, bool *made)
{
    struct pell_scene *scene = s->scene;
    bool closed = s->objects[members[0]].boundary == CLOSED;
    size_t num_meshes = 0;
    int number = INT32_MAX;
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < count; i++) {
        const struct object *o = &s->objects[members[i]];
        memcpy(meshes + num_meshes, o->meshes, o->count * sizeof(*meshes));
        num_meshes += o->count;
    }
    if (!closed)
        res = is_closed(s, meshes, num_meshes, &closed);
    *made = closed;
    for (size_t k = 0; k < num_meshes; k++)
        number = scene->meshes[meshes[k]].object < number ? scene->meshes[meshes[k]].object : number;
    for (size_t k = 0; closed && k < num_meshes; k++)
        scene->meshes[meshes[k]].joined = number + 1;
    return res;
}

/* Counts the objects that are joined, and the assemblies. */
static enum pell_result make_assemblies(struct search *s, uint32_t *meshes, size_t *joined, size_t *assemblies)
{
    struct pell_context *ctx = s->scene->ctx;
    uint32_t *root = pell_alloc_array(ctx, s->count, 3 * sizeof(*root)), *order;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!root)
        return PELL_ERR_NOMEM;
    for (uint32_t i = 0; i < s->count; i++)
        root[i] = pell_union_root(s->set, i);
    order = pell_sort_keys(ctx, root, 1, root + s->count, root + 2 * s->count, (uint32_t) s->count);
    for (size_t i = 0, end; i < s->count; i = end) {
        bool made = false;
        for (end = i + 1; end < s->count && root[order[end]] == root[order[i]]; end++)
            continue;
        if (end - i > 1)
            PELL_TRY(make_assembly(s, order + i, end - i, meshes, &made));
        *joined += made ? end - i : 0;
        *assemblies += made;
    }
    res = PELL_OK;

fail:
    pell_free(ctx, root);
    return res;
}

enum pell_result pell_join_touching(struct pell_scene *scene, bool quiet)
{
    struct pell_context *ctx = scene->ctx;
    struct search s = { .scene = scene };
    uint32_t *order = pell_alloc_array(ctx, scene->num_meshes, 3 * sizeof(*order));
    size_t joined = 0, assemblies = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    for (size_t i = 0; i < scene->num_meshes; i++)
        scene->meshes[i].joined = 0;
    s.same = pell_alloc_array(ctx, scene->num_materials, sizeof(*s.same));
    s.objects = pell_alloc_array(ctx, scene->num_meshes, sizeof(*s.objects));
    s.set = pell_alloc_array(ctx, scene->num_meshes, sizeof(*s.set));
    if (!order || !s.same || !s.objects || !s.set)
        goto fail;
    pell_scene_same_media(scene, s.same);
    pell_scene_objects(scene, order, order + scene->num_meshes);
    PELL_TRY(list_objects(&s, order));
    if (s.count < 2)
        goto fail;
    for (uint32_t i = 0; i < s.count; i++)
        s.set[i] = i;
    qsort(s.objects, s.count, sizeof(*s.objects), compare_objects);
    PELL_TRY(join_touching(&s));
    PELL_TRY(make_assemblies(&s, order + 2 * scene->num_meshes, &joined, &assemblies));
    if (assemblies > 0 && !quiet)
        pell_info(ctx, scene->path, "%zu objects touch others of the same medium: they are rendered as %s", joined,
                  pell_counted((long long) assemblies, "solid", "solids").str);
    if (s.extended > 0 && !quiet)
        pell_info(ctx, scene->path, "faces of %s coincide with those of another medium: there the solids overlap a little now",
                  pell_counted((long long) s.extended, "object", "objects").str);
    if (s.steps >= STEPS_MOST && !quiet)
        pell_info(ctx, scene->path, "too many objects are near each other to find all that touch");
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(ctx, s.near[1].at);
    pell_free(ctx, s.near[0].at);
    pell_free(ctx, s.set);
    pell_free(ctx, s.objects);
    pell_free(ctx, s.same);
    pell_free(ctx, order);
    return res;
}
