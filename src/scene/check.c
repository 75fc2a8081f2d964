/* SPDX-License-Identifier: MIT
 * check.c - a scene's contents and problems: closed meshes, orientation, scale, media, textures. */
#include "scene/mesh/topology.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum kind {
    OPEN,
    NONMANIFOLD,
    FLIPPED,
    INWARD,
    HOLLOW,
    DEGENERATE,
    FACETED,
    COINCIDENT,
    CAMERA,
    LIGHT,
    NO_UV,
    THIN,
    SIZE,
    NO_SCATTERING,
    MEDIUM,
    NONE_TRANSLUCENT,
    KINDS
};

#define HOLLOW_THICKNESS 1e-7 /* objects thinner than this fraction of their extent count as hollow */

/* Properties that coincident copies of an object share (but not only they); the sums are computed only for objects with equal triangle
 * counts. */
struct signature {
    int64_t triangles;
    double sum[3], square; /* sums over the corners' positions, in their order */
    size_t object;
    const uint32_t *meshes; /* meshes of the object, indices into the scene */
    size_t num_meshes;
};

struct check {
    const struct pell_scene *scene;
    struct pell_context *ctx;
    struct pell_scene_report *report;
    struct signature *signature; /* per object of the report */
    size_t capacity;
    int64_t found[KINDS];
    enum pell_severity severity[KINDS]; /* the worst severity of the problems that are only counted */
};

/* Subjects of the problems of a kind, for when only their number is reported. */
static const char *const kinds[KINDS] = {
    [OPEN] = "objects that are open",
    [NONMANIFOLD] = "objects with edges of more than two triangles",
    [FLIPPED] = "objects with triangles that face opposite ways",
    [INWARD] = "objects with inverted normals",
    [HOLLOW] = "objects that enclose no volume",
    [DEGENERATE] = "objects with triangles without an area",
    [FACETED] = "objects with the normals of flat triangles",
    [COINCIDENT] = "objects that lie where another does",
    [CAMERA] = "objects that hold the camera",
    [LIGHT] = "objects that hold a light",
    [NO_UV] = "meshes without the texture coordinates that their materials need",
    [THIN] = "objects that are thinner than light goes between two scattering events",
    [NO_SCATTERING] = "materials that only absorb",
    [MEDIUM] = "translucent materials",
    [NONE_TRANSLUCENT] = "", /* at most one problem of this kind, and of SIZE */
    [SIZE] = "",
};

static enum pell_result add_problem(struct check *k, enum pell_severity severity, const char *where, const char *what)
{
    struct pell_scene_report *r = k->report;
    void *array = r->problems;
    struct pell_problem *p;
    const enum pell_result res = pell_grow(k->ctx, &array, r->num_problems, &k->capacity, sizeof(*r->problems));

    r->problems = array;
    if (res != PELL_OK)
        return res;
    p = &r->problems[r->num_problems++];
    p->severity = severity;
    p->where = pell_strdup(k->ctx, where);
    p->what = pell_strdup(k->ctx, what);
    return p->where && p->what ? PELL_OK : PELL_ERR_NOMEM;
}

/* Adds a problem; those beyond the limit of a kind are only counted. */
static PELL_PRINTF(5, 6) enum pell_result
    add(struct check *k, enum kind kind, enum pell_severity severity, const char *where, const char *fmt, ...)
{
    char what[512];
    va_list args;

    if (k->found[kind]++ >= pell_context_limits(k->ctx)->warnings) {
        k->severity[kind] = severity > k->severity[kind] ? severity : k->severity[kind];
        return PELL_OK;
    }
    va_start(args, fmt);
    vsnprintf(what, sizeof(what), fmt, args);
    va_end(args);
    return add_problem(k, severity, where, what);
}

static const char *describe_subject(const char *kind, const char *name, struct pell_text *text)
{
    char shown[96];

    memset(text, 0, sizeof(*text));
    if (!name || !name[0])
        pell_text_add(text, "%s without a name", kind);
    else
        pell_text_add(text, "%s \"%s\"", kind, pell_printable(name, shown, sizeof(shown)));
    return text->str;
}

/* --- Objects ------------------------------------------------------------------------------------------------------------------ */

static void measure(const struct pell_topology *t, const struct pell_part *parts, struct pell_object_report *o)
{
    const struct pell_edge_counts edges = pell_topology_count_edges(t);
    double area = 0.0;

    o->triangles = t->num_triangles;
    o->degenerate_triangles = t->num_degenerate;
    o->components = (int) t->num_parts;
    o->closed = t->num_parts > 0;
    o->boundary_edges = edges.boundary;
    o->nonmanifold_edges = edges.nonmanifold;
    o->flipped_edges = edges.flipped;
    for (uint32_t i = 0; i < t->num_parts; i++) {
        o->closed &= parts[i].closed;
        o->volume_mm3 += parts[i].volume;
    }
    for (uint32_t i = 0; i < t->num_triangles && !pell_cancelled_at(t->ctx, i); i++)
        area += (double) vec3_length(vec3_load(t->face + 3 * (size_t) i));
    o->area_mm2 = 0.5 * area * t->scale * t->scale;
    if (pell_object_is_hollow(o)) /* rounding errors alone */
        o->volume_mm3 = 0.0;
    o->outward = o->closed && o->volume_mm3 > 0.0;
    o->thickness_mm = o->outward && o->area_mm2 > 0.0 ? 2.0 * o->volume_mm3 / o->area_mm2 : 0.0;
}

bool pell_object_is_hollow(const struct pell_object_report *o)
{
    return o->closed && o->area_mm2 > 0.0 && 2.0 * fabs(o->volume_mm3) < HOLLOW_THICKNESS * o->area_mm2 * sqrt(o->area_mm2);
}

/* The longest mean free path of the object's translucent materials; 0 if it has none. */
static double longest_mean_free_path(const struct pell_scene *scene, const struct pell_topology *t, const struct pell_material **which)
{
    double longest = 0.0;

    *which = NULL;
    for (size_t i = 0; i < t->num_meshes; i++) {
        const struct pell_material *m = &scene->materials[scene->meshes[t->mesh[i]].material];
        for (int c = 0; c < 3 && !m->opaque && !m->profile && m->gaussians.count == 0; c++) {
            const double mfp = pell_mean_free_path(&m->medium, c);
            if (mfp > longest) {
                longest = mfp;
                *which = m;
            }
        }
    }
    return longest;
}

static enum pell_result report_object(struct check *k, const struct pell_topology *t, const struct pell_object_report *o)
{
    const struct pell_material *clearest;
    const double mfp = longest_mean_free_path(k->scene, t, &clearest), size = o->thickness_mm > 0.0 ? o->thickness_mm : t->scale;
    struct pell_text text;
    const char *where = describe_subject("object", o->name, &text);
    bool translucent = false;
    enum pell_result res;

    for (size_t i = 0; i < t->num_meshes; i++)
        translucent |= !k->scene->materials[k->scene->meshes[t->mesh[i]].material].opaque;
    if (translucent && o->boundary_edges && !o->joined)
        PELL_TRY(add(k, OPEN, PELL_SEVERITY_WARNING, where,
                     "is open: %s one triangle, so there is no inside and no thickness; close the mesh",
                     pell_counted(o->boundary_edges, "edge has", "edges have").str));
    if (translucent && o->nonmanifold_edges)
        PELL_TRY(add(k, NONMANIFOLD, PELL_SEVERITY_WARNING, where, "%s more than two triangles",
                     pell_counted(o->nonmanifold_edges, "edge has", "edges have").str));
    if (o->flipped_edges)
        PELL_TRY(add(k, FLIPPED, PELL_SEVERITY_WARNING, where, "%s between triangles that face opposite ways",
                     pell_counted(o->flipped_edges, "edge lies", "edges lie").str));
    if (translucent && pell_object_is_hollow(o))
        PELL_TRY(add(k, HOLLOW, PELL_SEVERITY_WARNING, where, "encloses no volume: its sides lie on each other; give it a thickness"));
    if (o->closed && o->volume_mm3 < 0.0)
        PELL_TRY(add(k, INWARD, PELL_SEVERITY_WARNING, where, "has inverted normals: it encloses %.4g mm^3", o->volume_mm3));
    if (o->degenerate_triangles)
        PELL_TRY(add(k, DEGENERATE, o->degenerate_triangles == o->triangles ? PELL_SEVERITY_WARNING : PELL_SEVERITY_NOTE, where,
                     "%lld of %s no area%s", (long long) o->degenerate_triangles,
                     o->degenerate_triangles == 1 ? pell_counted(o->triangles, "triangle has", "triangles has").str
                                                  : pell_counted(o->triangles, "triangle have", "triangles have").str,
                     o->degenerate_triangles == o->triangles ? ": the object is invisible" : ""));
    if (o->faceted)
        PELL_TRY(
            add(k, FACETED, PELL_SEVERITY_NOTE, where, "has the normals of its flat triangles, which show: --normals smooth rounds it"));
    if (o->holds_camera)
        PELL_TRY(add(k, CAMERA, PELL_SEVERITY_WARNING, where, "holds the camera: what is seen is its inner side"));
    if (o->holds_light >= 0)
        PELL_TRY(add(k, LIGHT, PELL_SEVERITY_WARNING, where,
                     "holds light %d of the scene: light that begins inside a medium is not rendered; put it into a cavity of the mesh",
                     o->holds_light + 1));
    if (mfp > size && !o->joined && !pell_object_is_hollow(o))
        PELL_TRY(
            add(k, THIN, PELL_SEVERITY_WARNING, where,
                "light goes %.3g mm in \"%s\" between two scattering events, but the object is %.3g mm %s: diffusion does not hold; is "
                "the size right?",
                mfp, clearest->name, size, o->thickness_mm > 0.0 ? "thick on average" : "large"));
    return PELL_OK;

fail:
    return res;
}

/* Whether a point is inside: a closed surface subtends a full sphere from a point inside and nothing from outside. */
static bool encloses(const struct pell_scene *scene, const struct pell_topology *t, const struct pell_part *parts, const float at[3])
{
    bool within = false;
    double sum = 0.0;

    for (uint32_t i = 0; i < t->num_parts; i++)
        within |= at[0] > parts[i].min[0] && at[0] < parts[i].max[0] && at[1] > parts[i].min[1] && at[1] < parts[i].max[1] &&
                  at[2] > parts[i].min[2] && at[2] < parts[i].max[2];
    for (size_t m = 0; within && m < t->num_meshes; m++)
        sum += pell_mesh_solid_angle(scene->ctx, &scene->meshes[t->mesh[m]], at);
    return fabs(sum) > 2.0 * PELL_PI;
}

/* The first light that has a place inside a closed translucent object, -1 if there is none. */
static int light_inside(const struct pell_scene *scene, const struct pell_topology *t, const struct pell_part *parts)
{
    enum { LIGHTS_MOST = 256 }; /* each takes all triangles where it is within the bounds */
    const size_t count = scene->num_lights < LIGHTS_MOST ? scene->num_lights : LIGHTS_MOST;

    if (scene->materials[scene->meshes[t->mesh[0]].material].opaque)
        return -1;
    for (size_t i = 0; i < count && !pell_cancelled(scene->ctx); i++) {
        const struct pell_light *l = &scene->lights[i];
        if (l->type != PELL_LIGHT_DIRECTIONAL && l->type != PELL_LIGHT_ENVIRONMENT && encloses(scene, t, parts, l->position))
            return (int) i;
    }
    return -1;
}

static void measure_signature(const struct pell_scene *scene, struct signature *l)
{
    for (size_t m = 0; m < l->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[l->meshes[m]];
        for (size_t i = 0; i < 3 * (size_t) mesh->num_triangles && !pell_cancelled_at(scene->ctx, i); i++)
            for (int c = 0; c < 3; c++) {
                const double p = (double) mesh->position[3 * (size_t) mesh->index[i] + (size_t) c];
                l->sum[c] += p;
                l->square += p * p;
            }
    }
}

static int by_signature(const void *a, const void *b)
{
    const struct signature *l = a, *r = b;

    if (l->triangles != r->triangles)
        return l->triangles < r->triangles ? -1 : 1;
    for (int c = 0; c < 3; c++)
        if (l->sum[c] != r->sum[c])
            return l->sum[c] < r->sum[c] ? -1 : 1;
    if (l->square != r->square)
        return l->square < r->square ? -1 : 1;
    return 0;
}

static int by_signature_then_order(const void *a, const void *b)
{
    const struct signature *l = a, *r = b;
    const int order = by_signature(a, b);

    return order ? order : l->object < r->object ? -1 : l->object > r->object;
}

struct corners {
    const struct pell_scene *scene;
    const struct signature *of;
    size_t mesh, corner; /* the next corner */
};

/* Position of the next corner; NULL: no more corners. */
static const float *next_corner(struct corners *k)
{
    while (k->mesh < k->of->num_meshes) {
        const struct pell_mesh *mesh = &k->scene->meshes[k->of->meshes[k->mesh]];
        if (k->corner < 3 * (size_t) mesh->num_triangles)
            return mesh->position + 3 * (size_t) mesh->index[k->corner++];
        k->mesh++;
        k->corner = 0;
    }
    return NULL;
}

static bool coincide(const struct pell_scene *scene, const struct signature *a, const struct signature *b)
{
    struct corners p = { .scene = scene, .of = a }, q = { .scene = scene, .of = b };

    for (;;) {
        const float *x = next_corner(&p), *y = next_corner(&q);
        if (!x || !y)
            return !x && !y;
        if (memcmp(x, y, 3 * sizeof(*x)) != 0)
            return false;
    }
}

/* An object that was exported twice blocks its own light immediately. Copies list their triangles in one order. */
static enum pell_result find_coincident(struct check *k)
{
    struct pell_object_report *objects = k->report->objects;
    const size_t count = k->report->num_objects;
    struct pell_text text;
    enum pell_result res;

    qsort(k->signature, count, sizeof(*k->signature), by_signature_then_order);
    for (size_t i = 0; i < count; i++) {
        struct signature *l = &k->signature[i];
        if ((i > 0 && l[-1].triangles == l->triangles) || (i + 1 < count && l[1].triangles == l->triangles))
            measure_signature(k->scene, l);
    }
    qsort(k->signature, count, sizeof(*k->signature), by_signature_then_order);
    for (size_t i = 1; i < count; i++) {
        const struct signature *l = &k->signature[i];
        char other[96];
        if (pell_cancelled(k->ctx)) {
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
        if (by_signature(l - 1, l) != 0 || l->triangles == 0 || !coincide(k->scene, l - 1, l))
            continue;
        objects[l->object].coincident = (int) l[-1].object;
        PELL_TRY(add(k, COINCIDENT, PELL_SEVERITY_WARNING, describe_subject("object", objects[l->object].name, &text),
                     "has exactly the same surface as \"%s\": each hides the other: remove one of them",
                     pell_printable(objects[l[-1].object].name, other, sizeof(other))));
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result check_object(struct check *k, const uint32_t *meshes, size_t count)
{
    struct pell_object_report *o = &k->report->objects[k->report->num_objects];
    struct pell_topology t;
    struct pell_part *parts = NULL;
    enum pell_result res;

    if (pell_cancelled(k->ctx))
        return PELL_ERR_CANCELLED;
    PELL_TRY(pell_topology_make(&t, k->scene, meshes, count));
    *o = (struct pell_object_report) { .coincident = -1, .holds_light = -1 };
    o->name = pell_strdup(k->ctx, k->scene->meshes[meshes[0]].name);
    parts = pell_alloc_array(k->ctx, t.num_parts, sizeof(*parts));
    res = PELL_ERR_NOMEM;
    if (o->name && parts) {
        k->signature[k->report->num_objects] =
            (struct signature) { .triangles = t.num_triangles, .object = k->report->num_objects, .meshes = meshes, .num_meshes = count };
        k->report->num_objects++;
        o->material = k->scene->meshes[meshes[0]].material;
        o->joined = k->scene->meshes[meshes[0]].joined > 0;
        pell_topology_parts(&t, k->scene, parts);
        measure(&t, parts, o);
        o->faceted = pell_is_faceted(k->scene, &t);
        o->holds_camera = o->closed && k->scene->num_cameras > 0 && encloses(k->scene, &t, parts, k->scene->cameras[0].position);
        o->holds_light = o->closed ? light_inside(k->scene, &t, parts) : -1;
        k->report->triangles += o->triangles;
        res = pell_cancelled(k->ctx) ? PELL_ERR_CANCELLED : report_object(k, &t, o);
    } else {
        pell_free(k->ctx, o->name);
    }
    pell_free(k->ctx, parts);
    pell_topology_finish(&t);

fail:
    return res;
}

static enum pell_result check_objects(struct check *k)
{
    const struct pell_scene *scene = k->scene;
    uint32_t *order = pell_alloc_array(k->ctx, scene->num_meshes, sizeof(*order));
    uint32_t *scratch = pell_alloc_array(k->ctx, scene->num_meshes, sizeof(*scratch));
    size_t objects = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!order || !scratch)
        goto fail;
    pell_scene_objects(scene, order, scratch);
    for (size_t i = 0; i < scene->num_meshes; i++)
        objects += i == 0 || scene->meshes[order[i]].object != scene->meshes[order[i - 1]].object;
    k->report->objects = pell_calloc(k->ctx, objects, sizeof(*k->report->objects));
    k->signature = pell_alloc_array(k->ctx, objects, sizeof(*k->signature));
    if (!k->report->objects || !k->signature)
        goto fail;
    for (size_t i = 0, end; i < scene->num_meshes; i = end) {
        for (end = i + 1; end < scene->num_meshes && scene->meshes[order[end]].object == scene->meshes[order[i]].object; end++)
            ;
        if ((int) order[i] != scene->ground_mesh)
            PELL_TRY(check_object(k, order + i, end - i));
    }
    res = find_coincident(k);

fail:
    pell_free(k->ctx, k->signature);
    pell_free(k->ctx, order);
    pell_free(k->ctx, scratch);
    return res;
}

/* --- Textures and materials --------------------------------------------------------------------------------------------------- */

int pell_scene_missing_uv(const struct pell_mesh *mesh, const struct pell_material *m)
{
    for (enum pell_map i = 0; i < PELL_MAPS; i++) {
        const struct pell_texture_map *map = pell_material_map(m, i);
        if (map->texture && map->uv >= 0 && map->uv < PELL_UV_SETS && !mesh->uv[map->uv])
            return map->uv;
    }
    for (int i = 0; i < m->num_layers; i++)
        if (m->layers[i].depth_map.texture && !mesh->uv[m->layers[i].depth_map.uv])
            return m->layers[i].depth_map.uv;
    return -1;
}

static enum pell_result check_maps(struct check *k)
{
    struct pell_text text;
    enum pell_result res;

    for (size_t i = 0; i < k->scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &k->scene->meshes[i];
        const struct pell_material *m = &k->scene->materials[mesh->material];
        const int uv = pell_scene_missing_uv(mesh, m);
        if (uv >= 0)
            PELL_TRY(add(k, NO_UV, PELL_SEVERITY_WARNING, describe_subject("mesh", mesh->name, &text),
                         "has no texture coordinates (UV set %d), which the textures of \"%s\" need", uv, m->name));
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result describe_medium(struct check *k, const struct pell_material *m, const char *where)
{
    const char *color = m->color_from == PELL_COLOR_FROM_TEXTURE ? "colour from textures or the base colour" : "colour from the profile";
    const struct pell_medium *d = &m->medium;
    bool scatters = false;
    enum pell_result res;

    if (m->profile)
        return add(k, MEDIUM, PELL_SEVERITY_NOTE, where,
                   "a table as profile, reflecting %.3g, %.3g, %.3g, half of it within %.3g, %.3g, %.3g mm; eta %.3g; %s",
                   pell_profile_total(&m->profile[0]), pell_profile_total(&m->profile[1]), pell_profile_total(&m->profile[2]),
                   pell_profile_sample(&m->profile[0], 0.5), pell_profile_sample(&m->profile[1], 0.5),
                   pell_profile_sample(&m->profile[2], 0.5), d->eta, color);
    if (m->gaussians.count) {
        double mean[3] = { 0 };
        for (int c = 0; c < 3; c++) {
            double sum = 0.0;
            for (int g = 0; g < m->gaussians.count; g++) {
                sum += m->gaussians.weight[g][c];
                mean[c] += m->gaussians.weight[g][c] * m->gaussians.variance[g];
            }
            mean[c] = sum > 0.0 && mean[c] > 0.0 ? sqrt(2.0 * mean[c] / sum) : 0.0;
        }
        return add(k, MEDIUM, PELL_SEVERITY_NOTE, where, "sum of %d Gaussians, root mean square radius %.3g, %.3g, %.3g mm; eta %.3g; %s",
                   m->gaussians.count, mean[0], mean[1], mean[2], d->eta, color);
    }
    for (int c = 0; c < 3; c++)
        scatters |= d->sigma_s_reduced[c] > 0.0;
    PELL_TRY(add(k, MEDIUM, PELL_SEVERITY_NOTE, where,
                 "mean free path %.3g, %.3g, %.3g mm; diffuse mean free path %.3g, %.3g, %.3g mm; eta %.3g; profile %s; %s",
                 pell_mean_free_path(d, 0), pell_mean_free_path(d, 1), pell_mean_free_path(d, 2), pell_diffuse_mean_free_path(d, 0),
                 pell_diffuse_mean_free_path(d, 1), pell_diffuse_mean_free_path(d, 2), d->eta, pell_profile_model_at(m->model)->name,
                 color));
    if (!scatters)
        PELL_TRY(add(k, NO_SCATTERING, PELL_SEVERITY_WARNING, where, "only absorbs: sigma_s_reduced is 0 in all channels"));
    return PELL_OK;

fail:
    return res;
}

static enum pell_result check_materials(struct check *k)
{
    const struct pell_scene *scene = k->scene;
    bool *used = pell_calloc(k->ctx, scene->num_materials, sizeof(*used)), translucent = false;
    struct pell_text text;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!used)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < scene->num_meshes; i++)
        used[scene->meshes[i].material] = true;
    for (size_t i = 0; i < scene->num_materials; i++) {
        const struct pell_material *m = &scene->materials[i];
        translucent |= used[i] && (!m->opaque || pell_material_is_thin(m));
        if (!used[i] || m->opaque)
            continue;
        PELL_TRY(describe_medium(k, m, describe_subject("material", m->name, &text)));
    }
    res = translucent
              ? PELL_OK
              : add(k, NONE_TRANSLUCENT, PELL_SEVERITY_WARNING, "scene", "no material is translucent, so nothing scatters below a surface");

fail:
    pell_free(k->ctx, used);
    return res;
}

static enum pell_result check_size(struct check *k)
{
    const float *min = k->report->bounds_min, *max = k->report->bounds_max;
    const float extent = fmaxf(max[0] - min[0], fmaxf(max[1] - min[1], max[2] - min[2]));

    if (extent >= 0.1f && extent <= 1e5f)
        return PELL_OK;
    return add(k, SIZE, PELL_SEVERITY_WARNING, "scene",
               "the largest extent is %g mm, which is %s for a translucent object; is the unit right?", (double) extent,
               extent < 0.1f ? "tiny" : "huge");
}

static enum pell_result add_counts(struct check *k)
{
    const int limit = pell_context_limits(k->ctx)->warnings;
    char what[160];
    enum pell_result res = PELL_OK;

    for (int i = 0; i < KINDS && res == PELL_OK; i++) {
        if (k->found[i] <= limit)
            continue;
        snprintf(what, sizeof(what), "%lld more %s", (long long) (k->found[i] - limit), kinds[i]);
        res = add_problem(k, k->severity[i], "scene", what);
    }
    return res;
}

enum pell_result pell_scene_check(const struct pell_scene *scene, struct pell_scene_report *report)
{
    if (!scene || !report)
        return pell_null(scene ? scene->ctx : NULL, "pell_scene_check");

    struct check k = { .scene = scene, .ctx = scene->ctx, .report = report };
    enum pell_result res;

    memset(report, 0, sizeof(*report));
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (m->material < 0 || (size_t) m->material >= scene->num_materials)
            return pell_error(scene->ctx, PELL_ERR_INVALID, scene->path, "call pell_scene_complete first", "mesh %zu has no material", i);
        for (size_t t = 0; t < 3 * (size_t) m->num_triangles && !pell_cancelled_at(scene->ctx, t); t++)
            if (m->index[t] >= m->num_vertices)
                return pell_error(scene->ctx, PELL_ERR_INVALID, scene->path, "call pell_scene_complete first",
                                  "mesh %zu refers to vertex %u of %u", i, m->index[t], m->num_vertices);
    }
    if (pell_cancelled(scene->ctx))
        return PELL_ERR_CANCELLED;
    if (scene->animated && scene->num_meshes == (scene->ground_mesh >= 0 ? 1 : 0)) { /* pell_scene_check_extent */
        memcpy(report->bounds_min, scene->bounds_min, sizeof(report->bounds_min));
        memcpy(report->bounds_max, scene->bounds_max, sizeof(report->bounds_max));
    } else if (!pell_scene_bounds(scene, report->bounds_min, report->bounds_max))
        return pell_cancelled(scene->ctx)
                   ? PELL_ERR_CANCELLED
                   : pell_error(scene->ctx, PELL_ERR_INVALID, scene->path, NULL, "the scene has no triangles, or not finite ones");
    PELL_TRY(check_objects(&k));
    PELL_TRY(check_maps(&k));
    PELL_TRY(check_materials(&k));
    PELL_TRY(check_size(&k));
    PELL_TRY(add_counts(&k));
    return PELL_OK;

fail:
    pell_scene_report_finish(scene->ctx, report);
    return res;
}

void pell_scene_report_finish(struct pell_context *ctx, struct pell_scene_report *report)
{
    for (size_t i = 0; i < report->num_problems; i++) {
        pell_free(ctx, report->problems[i].where);
        pell_free(ctx, report->problems[i].what);
    }
    for (size_t i = 0; i < report->num_objects; i++)
        pell_free(ctx, report->objects[i].name);
    pell_free(ctx, report->problems);
    pell_free(ctx, report->objects);
    memset(report, 0, sizeof(*report));
}
