/* SPDX-License-Identifier: MIT
 * complete.c - turns the contents of a file into a scene that a renderer may trust: checks every index and value, computes bounds,
 * orientation, normals and tangents, and adds defaults for missing parts. */
#include "scene/layers.h"
#include "scene/mesh/topology.h"
#include "scene/mesh/touching.h"

#include <float.h>
#include <string.h>

#define LARGEST_COORDINATE 1e12f /* mm: a million kilometres; squares stay well within a float's range */
#define SMALLEST_PICTURE 1e-6f   /* mm, extent of an orthographic view: a nanometre */
#define LARGEST_THICKNESS 1e5f   /* mm */
#define NO_LENGTH 1e-30f         /* shorter vectors have no direction: their inverse length would overflow */

#define PARTS_TRIED 1000 /* parts of an object whose boxes are compared */
#define PART_GAP 1e-5    /* of the coordinates: boxes this near may touch */

static bool in_range(double value, double min, double max)
{
    return value >= min && value <= max;
}

static enum pell_result bad_value(const struct pell_scene *scene, const char *kind, const char *name, const char *field, double value,
                                  double min, double max)
{
    struct pell_text where = { 0 };
    char shown[96];

    pell_text_add_path(&where, scene->path, ": ", "");
    pell_text_add(&where, "%s \"%s\"", kind, pell_printable(name, shown, sizeof(shown)));
    return pell_error(scene->ctx, scene->from_file ? PELL_ERR_FORMAT : PELL_ERR_INVALID, where.str, NULL, "%s is %g, allowed: [%g, %g]",
                      field, value, min, max);
}

/* --- Meshes ------------------------------------------------------------------------------------------------------------------- */

/* Sets not-finite values of an optional array to 0. Returns their number. */
static size_t clear_bad(const struct pell_context *ctx, float *values, size_t count)
{
    size_t bad = 0;

    for (size_t i = 0; i < count && !pell_cancelled_at(ctx, i); i++)
        if (!(fabsf(values[i]) <= FLT_MAX)) {
            values[i] = 0.0f;
            bad++;
        }
    return bad;
}

/* Normalises normals; those that can't be become zero, for pell_make_normals. Returns how many are not finite. */
static size_t clean_normals(const struct pell_context *ctx, struct pell_mesh *mesh)
{
    size_t bad = 0;

    for (size_t i = 0; i < mesh->num_vertices && !pell_cancelled_at(ctx, i); i++) {
        float *n = mesh->normal + 3 * i;
        const float largest = vec3_max_abs(vec3_load(n));
        const bool finite = isfinite(n[0] + n[1] + n[2]);
        bad += !finite;
        if (largest > NO_LENGTH && finite)
            vec3_store(vec3_normalize(vec3_mul(vec3_load(n), 1.0f / largest)), n);
        else
            n[0] = n[1] = n[2] = 0.0f;
    }
    return bad;
}

static void clean_tangents(const struct pell_context *ctx, struct pell_mesh *mesh)
{
    for (size_t i = 0; mesh->tangent && i < mesh->num_vertices && !pell_cancelled_at(ctx, i); i++) {
        float *t = mesh->tangent + 4 * i;
        const struct pell_vec3 n = vec3_load(mesh->normal + 3 * i);
        struct pell_vec3 v = vec3_load(t), b;
        v = vec3_normalize(vec3_mad(v, -vec3_dot(v, n), n));
        if (!(vec3_dot(v, v) > 0.5f))
            vec3_basis(n, &v, &b);
        vec3_store(v, t);
        t[3] = t[3] < 0.0f ? -1.0f : 1.0f;
    }
}

static enum pell_result check_mesh(struct pell_scene *scene, size_t index)
{
    struct pell_mesh *m = &scene->meshes[index];
    struct pell_text where = { 0 };
    char shown[96];
    size_t bad = 0, bad_normals;

    pell_text_add_path(&where, scene->path, ": ", "");
    pell_text_add(&where, "mesh \"%s\"", pell_printable(m->name, shown, sizeof(shown)));
    if ((m->num_vertices && (!m->position || !m->normal)) || (m->num_triangles && !m->index))
        return pell_error(scene->ctx, PELL_ERR_INVALID, where.str, NULL, "has no position, normal or index array");
    if (m->material < 0 || (size_t) m->material >= scene->num_materials)
        return pell_error(scene->ctx, PELL_ERR_INVALID, where.str, NULL, "material %d does not exist; there are %zu", m->material,
                          scene->num_materials);
    if (!(m->thicken >= 0.0f && m->thicken <= LARGEST_THICKNESS))
        return pell_error(scene->ctx, PELL_ERR_INVALID, where.str, NULL, "thicken is %g mm, must be in [0, %g]", (double) m->thicken,
                          (double) LARGEST_THICKNESS);
    for (size_t i = 0; i < 3 * (size_t) m->num_triangles && !pell_cancelled_at(scene->ctx, i); i++)
        if (m->index[i] >= m->num_vertices)
            return pell_error(scene->ctx, PELL_ERR_FORMAT, where.str, NULL, "triangle %zu refers to vertex %u; there are %u", i / 3,
                              m->index[i], m->num_vertices);
    for (size_t i = 0; i < 3 * (size_t) m->num_vertices && !pell_cancelled_at(scene->ctx, i); i++)
        if (!(fabsf(m->position[i]) <= LARGEST_COORDINATE))
            return pell_error(scene->ctx, PELL_ERR_FORMAT, where.str, "is the unit or size right?",
                              "vertex %zu has the coordinate %g mm; allowed: [%g, %g]", i / 3, (double) m->position[i],
                              (double) -LARGEST_COORDINATE, (double) LARGEST_COORDINATE);
    bad_normals = clean_normals(scene->ctx, m);
    if (bad_normals)
        pell_warn(scene->ctx, where.str, NULL, "%zu of %u normals are not finite and were replaced by those of the triangles", bad_normals,
                  m->num_vertices);
    for (int u = 0; u < PELL_UV_SETS; u++)
        if (m->uv[u])
            bad += clear_bad(scene->ctx, m->uv[u], 2 * (size_t) m->num_vertices);
    if (m->color)
        bad += clear_bad(scene->ctx, m->color, 4 * (size_t) m->num_vertices);
    if (m->tangent)
        bad += clear_bad(scene->ctx, m->tangent, 4 * (size_t) m->num_vertices);
    if (bad)
        pell_warn(scene->ctx, where.str, NULL, "%zu texture coordinates, colours or tangents are not finite and count as 0", bad);
    return pell_cancelled(scene->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

bool pell_scene_has_area(const struct pell_scene *scene)
{
    for (size_t k = 0; k < scene->num_meshes; k++) {
        const struct pell_mesh *m = &scene->meshes[k];
        for (uint32_t i = 0; i < m->num_triangles; i++) {
            const uint32_t *corner = m->index + 3 * (size_t) i;
            const float *p = m->position + 3 * (size_t) corner[0], *q = m->position + 3 * (size_t) corner[1],
                        *r = m->position + 3 * (size_t) corner[2];
            double a[3], b[3];
            for (int c = 0; c < 3; c++) {
                a[c] = (double) q[c] - (double) p[c];
                b[c] = (double) r[c] - (double) p[c];
            }
            if (a[1] * b[2] != a[2] * b[1] || a[2] * b[0] != a[0] * b[2] || a[0] * b[1] != a[1] * b[0])
                return true;
        }
    }
    return false;
}

/* --- Materials, lights, cameras ----------------------------------------------------------------------------------------------- */

static enum pell_result check_medium(struct pell_scene *scene, const struct pell_material *m)
{
    struct pell_medium_fault fault;

    if (m->opaque)
        return PELL_OK;
    if (m->model < 0 || m->model >= PELL_PROFILE_MODELS)
        return bad_value(scene, "material", m->name, "the model of the profile", m->model, 0, PELL_PROFILE_MODELS - 1);
    if (m->profile)
        return in_range(m->medium.eta, 1.0, 4.0) ? PELL_OK : bad_value(scene, "material", m->name, "eta", m->medium.eta, 1.0, 4.0);
    if (m->gaussians.count < 0 || m->gaussians.count > PELL_GAUSSIANS_MAX)
        return bad_value(scene, "material", m->name, "the number of Gaussians", m->gaussians.count, 0, PELL_GAUSSIANS_MAX);
    if (m->gaussians.count == 0)
        return pell_medium_valid(&m->medium, &fault)
                   ? PELL_OK
                   : bad_value(scene, "material", m->name, fault.field, fault.value, fault.min, fault.max);
    if (!in_range(m->medium.eta, 1.0, 4.0))
        return bad_value(scene, "material", m->name, "eta", m->medium.eta, 1.0, 4.0);
    for (int i = 0; i < m->gaussians.count; i++) {
        const double least = i ? m->gaussians.variance[i - 1] : 0.0;
        if (!(m->gaussians.variance[i] > 0.0) || !in_range(m->gaussians.variance[i], least, 1e12))
            return bad_value(scene, "material", m->name, "a Gaussian's variance", m->gaussians.variance[i], least, 1e12);
        for (int c = 0; c < 3; c++)
            if (!in_range(m->gaussians.weight[i][c], -1e3, 1e3))
                return bad_value(scene, "material", m->name, "a Gaussian's weight", m->gaussians.weight[i][c], -1e3, 1e3);
    }
    return PELL_OK;
}

static enum pell_result check_map(struct pell_scene *scene, const struct pell_material *m, const struct pell_texture_map *map)
{
    if (!map->texture)
        return PELL_OK;
    if (map->uv < 0 || map->uv >= PELL_UV_SETS)
        return bad_value(scene, "material", m->name, "a texture's UV set", map->uv, 0, PELL_UV_SETS - 1);
    if (map->channel < 0 || map->channel > 3)
        return bad_value(scene, "material", m->name, "a texture's channel", map->channel, 0, 3);
    for (int i = 0; i < 6; i++)
        if (!in_range(map->matrix[i], -1e9, 1e9))
            return bad_value(scene, "material", m->name, "a texture's transform", map->matrix[i], -1e9, 1e9);
    return PELL_OK;
}

/* Clamps the floats of a texture to [0, most]. */
static void limit_texture(const struct pell_scene *scene, const struct pell_texture *texture, float most, const char *what)
{
    const struct pell_image *image = texture ? &texture->image : NULL;
    const size_t count = image && image->type == PELL_PIXEL_F32 ? (size_t) image->width * image->height * image->channels : 0;
    float *values = count ? image->pixels : NULL, first = 0.0f;
    long long outside = 0;

    for (size_t i = 0; values && i < count && !pell_cancelled_at(scene->ctx, i); i++)
        if (!(values[i] >= 0.0f && values[i] <= most)) {
            first = outside++ ? first : values[i];
            values[i] = values[i] > 0.0f ? most : 0.0f;
        }
    if (outside)
        pell_warn(scene->ctx, texture->name, NULL, "%s: %s outside of [0, %g], such as %g, and clamped", what,
                  pell_counted(outside, "value is", "values are").str, (double) most, (double) first);
}

/* Checks layers made by the caller; a file's layers were checked when they were read. */
static enum pell_result check_layers(struct pell_scene *scene, const struct pell_material *m)
{
    struct pell_layer_measure measure[PELL_LAYERS_MOST];
    struct pell_layer_fault fault;
    int64_t texels;

    if (scene->from_file || (m->num_layers == 0 && !m->layers))
        return PELL_OK;
    if (!pell_scene_layers_valid(m, &fault))
        return bad_value(scene, "material", m->name, fault.field, fault.value, fault.min, fault.max);
    texels = pell_scene_layers_measure(m, measure);
    for (int i = 0; i < m->num_layers; i++)
        if (measure[i].crossings > 0) {
            pell_warn(scene->ctx, m->name, "where layers cross, the upper one takes precedence",
                      "the bottom of layer %d lies above that of a layer above it at %lld of %lld texels", i,
                      (long long) measure[i].crossings, (long long) texels);
            break;
        }
    return PELL_OK;
}

static enum pell_result check_material(struct pell_scene *scene, const struct pell_material *m)
{
    const struct {
        const char *field;
        float value, min, max;
    } numbers[] = {
        { "mix", m->mix, 0, 1 },
        { "strength", m->strength, 0, 1 },
        { "metallic", m->metallic, 0, 1 },
        { "roughness", m->roughness, 0, 1 },
        { "rho_s", m->rho_s, 0, 1 },
        { "the normal map's scale", m->normal_scale, -1e3f, 1e3f },
        { "the alpha cut-off", m->alpha_cutoff, 0, FLT_MAX },
        { "base colour red", m->base_color[0], 0, 1e6f },
        { "base colour green", m->base_color[1], 0, 1e6f },
        { "base colour blue", m->base_color[2], 0, 1e6f },
        { "base colour alpha", m->base_color[3], 0, 1 },
        { "specular colour red", m->specular_color[0], 0, 1e6f },
        { "specular colour green", m->specular_color[1], 0, 1e6f },
        { "specular colour blue", m->specular_color[2], 0, 1e6f },
        { "emission red", m->emissive[0], 0, 1e12f },
        { "emission green", m->emissive[1], 0, 1e12f },
        { "emission blue", m->emissive[2], 0, 1e12f },
        { "diffuse transmission", m->diffuse_transmission, 0, 1 },
        { "transmitted colour red", m->diffuse_transmission_color[0], 0, 1e6f },
        { "transmitted colour green", m->diffuse_transmission_color[1], 0, 1e6f },
        { "transmitted colour blue", m->diffuse_transmission_color[2], 0, 1e6f },
    };
    enum pell_result res = check_medium(scene, m);

    for (size_t i = 0; res == PELL_OK && i < PELL_COUNT(numbers); i++)
        if (!in_range(numbers[i].value, numbers[i].min, numbers[i].max))
            res = bad_value(scene, "material", m->name, numbers[i].field, numbers[i].value, numbers[i].min, numbers[i].max);
    for (enum pell_map i = 0; res == PELL_OK && i < PELL_MAPS; i++) {
        res = check_map(scene, m, pell_material_map(m, i));
        if (res == PELL_OK)
            /* Maps hold reflectances, fractions and directions, except the map of emission. */
            limit_texture(scene, pell_material_map(m, i)->texture, i == PELL_MAP_EMISSIVE ? 1e12f : 1.0f, "a material's map");
    }
    return res == PELL_OK ? check_layers(scene, m) : res;
}

static bool has_length(const float v[3])
{
    return vec3_max_abs(vec3_load(v)) > NO_LENGTH && isfinite(v[0] + v[1] + v[2]);
}

/* Makes a direction a unit vector; false if its length is zero. */
static bool make_unit(float *v)
{
    if (!has_length(v))
        return false;
    vec3_store(vec3_normalize(vec3_mul(vec3_load(v), 1.0f / vec3_max_abs(vec3_load(v)))), v);
    return true;
}

static enum pell_result check_light_values(const struct pell_scene *scene, const struct pell_light *l)
{
    for (int c = 0; c < 3; c++) {
        if (!in_range(l->position[c], -LARGEST_COORDINATE, LARGEST_COORDINATE))
            return bad_value(scene, "light", l->name, "its position (mm)", l->position[c], -LARGEST_COORDINATE, LARGEST_COORDINATE);
        if (!in_range(l->power[c], 0.0, 1e20))
            return bad_value(scene, "light", l->name, "its power", l->power[c], 0.0, 1e20);
    }
    if (!in_range(l->range, 0.0, FLT_MAX))
        return bad_value(scene, "light", l->name, "its range (mm)", l->range, 0.0, FLT_MAX);
    if (l->type == PELL_LIGHT_RECT && !(in_range(l->width, FLT_MIN, 1e9) && in_range(l->height, FLT_MIN, 1e9)))
        return bad_value(scene, "light", l->name, "its width or height (mm)", fminf(l->width, l->height), FLT_MIN, 1e9);
    if (l->type == PELL_LIGHT_DISC && !in_range(l->radius, FLT_MIN, 1e9))
        return bad_value(scene, "light", l->name, "its radius (mm)", l->radius, FLT_MIN, 1e9);
    if (l->type == PELL_LIGHT_SPOT && !in_range(l->cos_outer, -1.0, 1.0))
        return bad_value(scene, "light", l->name, "the cosine of its outer cone", l->cos_outer, -1.0, 1.0);
    if (l->type == PELL_LIGHT_SPOT && !in_range(l->cos_inner, l->cos_outer, 1.0))
        return bad_value(scene, "light", l->name, "the cosine of its inner cone", l->cos_inner, l->cos_outer, 1.0);
    if (!in_range(l->image_fov, 0.0, 3.1415925))
        return bad_value(scene, "light", l->name, "its image's angle", l->image_fov, 0.0, PELL_PI);
    if (!isfinite(l->rotate))
        return bad_value(scene, "light", l->name, "its rotation", l->rotate, -FLT_MAX, FLT_MAX);
    if (l->type != PELL_LIGHT_ENVIRONMENT && l->type != PELL_LIGHT_POINT && !has_length(l->direction))
        return bad_value(scene, "light", l->name, "the length of its direction", 0.0, FLT_MIN, FLT_MAX);
    return PELL_OK;
}

enum pell_result pell_scene_check_lights(const struct pell_scene *scene)
{
    enum pell_result res = PELL_OK;

    for (size_t i = 0; res == PELL_OK && i < scene->num_lights; i++)
        res = check_light_values(scene, &scene->lights[i]);
    return res;
}

static enum pell_result check_light(struct pell_scene *scene, struct pell_light *l)
{
    const enum pell_result res = check_light_values(scene, l);

    if (res != PELL_OK)
        return res;
    limit_texture(scene, l->image, 1e12f, "a light's image");
    if (l->type == PELL_LIGHT_ENVIRONMENT)
        return PELL_OK;
    if (!make_unit(l->direction))
        vec3_store(vec3(0, 0, -1), l->direction);
    if (!make_unit(l->up))
        vec3_store(vec3(0, 1, 0), l->up);
    pell_scene_orthogonalize(l->direction, l->up);
    return PELL_OK;
}

static enum pell_result check_camera(struct pell_scene *scene, struct pell_camera *c)
{
    for (int i = 0; i < 3; i++)
        if (!in_range(c->position[i], -LARGEST_COORDINATE, LARGEST_COORDINATE))
            return bad_value(scene, "camera", c->name, "its position (mm)", c->position[i], -LARGEST_COORDINATE, LARGEST_COORDINATE);
    if (c->ortho_height != 0.0f && !in_range(c->ortho_height, (double) SMALLEST_PICTURE, 1e12))
        return bad_value(scene, "camera", c->name, "the height of its image (mm)", c->ortho_height, (double) SMALLEST_PICTURE, 1e12);
    if (c->ortho_height == 0.0f && !in_range(c->fov, 1e-4, 3.14))
        return bad_value(scene, "camera", c->name, "its vertical angle (radians)", c->fov, 1e-4, 3.14);
    if (!in_range(c->focus, 0.0, 1e12))
        return bad_value(scene, "camera", c->name, "the distance in focus (mm)", c->focus, 0.0, 1e12);
    if (c->f_number != 0.0f && !in_range(c->f_number, 0.1, 1e6))
        return bad_value(scene, "camera", c->name, "its f-number", c->f_number, 0.1, 1e6);
    if (!make_unit(c->forward))
        return bad_value(scene, "camera", c->name, "the length of its forward vector", 0.0, FLT_MIN, FLT_MAX);
    if (!make_unit(c->up))
        vec3_store(vec3(0, 1, 0), c->up);
    pell_scene_orthogonalize(c->forward, c->up);
    return PELL_OK;
}

/* --- Objects ------------------------------------------------------------------------------------------------------------------ */

static void describe_object(const struct pell_scene *scene, const char *name, struct pell_text *where)
{
    char shown[96];

    pell_text_add_path(where, scene->path, name[0] ? ": " : "", "");
    if (name[0])
        pell_text_add(where, "\"%s\"", pell_printable(name, shown, sizeof(shown)));
}

/* The topology of an object in which no triangle lies on another. */
static enum pell_result make_topology(struct pell_scene *scene, const uint32_t *meshes, size_t count, const char *where,
                                      struct pell_topology *t)
{
    uint32_t dropped = 0;
    enum pell_result res = pell_topology_make(t, scene, meshes, count);

    if (res == PELL_OK)
        res = pell_drop_repeated(scene, t, &dropped);
    if (res == PELL_OK && !dropped)
        return PELL_OK;
    pell_topology_finish(t);
    if (res != PELL_OK)
        return res;
    pell_warn(scene->ctx, where, NULL, "%s exactly where another lies: left out",
              pell_counted(dropped, "triangle lies", "triangles lie").str);
    return pell_topology_make(t, scene, meshes, count);
}

/* Sets pell_mesh.overlaps. Of many parts some are assumed to touch; parts that share edges are one part. */
static enum pell_result find_overlaps(struct pell_scene *scene, const struct pell_topology *t)
{
    bool overlaps = t->num_parts > PARTS_TRIED || pell_topology_count_edges(t).nonmanifold > 0;
    struct pell_part *parts = NULL;

    if (!overlaps && t->num_parts > 1) {
        parts = pell_alloc_array(scene->ctx, t->num_parts, sizeof(*parts));
        if (!parts)
            return PELL_ERR_NOMEM;
        pell_topology_parts(t, scene, parts);
    }
    for (uint32_t i = 0; parts && i < t->num_parts && !overlaps; i++)
        for (uint32_t k = 0; k < i && !overlaps; k++) {
            overlaps = parts[i].closed && parts[k].closed;
            for (int c = 0; c < 3; c++) {
                const double gap = PART_GAP * fmax(fabs(parts[i].max[c]), fabs(parts[i].min[c]));
                overlaps &= parts[i].min[c] <= parts[k].max[c] + gap && parts[k].min[c] <= parts[i].max[c] + gap;
            }
        }
    for (size_t m = 0; m < t->num_meshes; m++)
        scene->meshes[t->mesh[m]].overlaps = overlaps;
    pell_free(scene->ctx, parts);
    return PELL_OK;
}

/* Gives an open object the thickness that is wanted. */
static enum pell_result thicken(struct pell_scene *scene, const uint32_t *meshes, size_t count, const char *where, struct pell_topology *t)
{
    struct pell_edge_counts edges;
    float wanted = 0.0f;
    enum pell_result res;

    for (size_t m = 0; m < count; m++)
        if (!scene->materials[scene->meshes[meshes[m]].material].opaque)
            wanted = fmaxf(wanted, scene->meshes[meshes[m]].thicken);
    if (!(wanted > 0.0f))
        return PELL_OK;
    edges = pell_topology_count_edges(t);
    if (edges.boundary == 0)
        return PELL_OK;
    if (edges.flipped > 0) {
        pell_warn(scene->ctx, where, NULL, "has one side only, as a Moebius strip: no thickness is given to it");
        return PELL_OK;
    }
    for (size_t m = 0; m < count; m++)
        scene->meshes[meshes[m]].thicken = wanted;
    res = pell_thicken(scene, t);
    if (res != PELL_OK)
        return res;
    pell_info(scene->ctx, where, "is open: it is given a thickness of %g mm", (double) wanted);
    pell_topology_finish(t);
    return pell_topology_make(t, scene, meshes, count);
}

static enum pell_result complete_object(struct pell_scene *scene, const uint32_t *meshes, size_t count, bool quiet)
{
    struct pell_text where = { 0 };
    struct pell_topology t;
    enum pell_result res;

    if (pell_cancelled(scene->ctx))
        return PELL_ERR_CANCELLED;
    describe_object(scene, scene->meshes[meshes[0]].name, &where);
    PELL_TRY(make_topology(scene, meshes, count, where.str, &t));
    res = pell_orient(scene, &t, meshes, count, where.str);
    if (res == PELL_OK)
        res = thicken(scene, meshes, count, where.str, &t);
    if (res == PELL_OK)
        res = find_overlaps(scene, &t);
    if (res == PELL_OK && !quiet && pell_is_faceted(scene, &t))
        pell_info(scene->ctx, where.str, "has per-face normals, so its triangles are visible: --normals smooth computes smooth ones");
    if (res == PELL_OK && !quiet && pell_smooths_facets(scene, &t))
        pell_info(scene->ctx, where.str, "has no normals and few faces, which are smoothed: --normals flat keeps them flat");
    if (res == PELL_OK)
        res = pell_make_normals(scene, &t);
    pell_topology_finish(&t);

fail:
    return res;
}

static enum pell_result complete_objects(struct pell_scene *scene, bool quiet)
{
    uint32_t *order = pell_alloc_array(scene->ctx, scene->num_meshes, sizeof(*order));
    uint32_t *scratch = pell_alloc_array(scene->ctx, scene->num_meshes, sizeof(*scratch));
    enum pell_result res = PELL_ERR_NOMEM;

    if (!order || !scratch)
        goto fail;
    pell_scene_assemblies(scene, order, scratch);
    for (size_t i = 0, end; i < scene->num_meshes; i = end) {
        end = pell_assembly_end(scene, order, i);
        PELL_TRY(complete_object(scene, order + i, end - i, quiet));
    }
    res = PELL_OK;

fail:
    pell_free(scene->ctx, order);
    pell_free(scene->ctx, scratch);
    return res;
}

static enum pell_result complete_tangents(struct pell_scene *scene)
{
    for (size_t i = 0; i < scene->num_meshes; i++) {
        struct pell_mesh *mesh = &scene->meshes[i];
        const struct pell_texture_map *map = &scene->materials[mesh->material].normal_map;
        enum pell_result res;

        if (map->texture && !mesh->tangent && mesh->uv[map->uv]) {
            res = pell_make_tangents(scene, i, map->uv);
            if (res != PELL_OK)
                return res;
        }
        clean_tangents(scene->ctx, mesh);
    }
    return PELL_OK;
}

/* --- All ---------------------------------------------------------------------------------------------------------------------- */

enum pell_result pell_scene_default_material(struct pell_scene *scene, bool quiet)
{
    bool missing = scene->num_materials == 0, colored = scene->num_meshes > 0; /* at the vertices of all meshes */
    struct pell_material *m;
    size_t index = 0;
    enum pell_result res;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        missing |= scene->meshes[i].material < 0;
        colored &= scene->meshes[i].material >= 0 || scene->meshes[i].color;
    }
    if (!missing)
        return PELL_OK;
    PELL_TRY(pell_scene_add_material(scene, PELL_DEFAULT_MATERIAL, &index));
    PELL_TRY(pell_material_apply(scene, index, scene->path, "marble"));
    m = &scene->materials[index];
    if (colored) {
        m->color_from = PELL_COLOR_FROM_TEXTURE;
        m->base_color[0] = m->base_color[1] = m->base_color[2] = 1.0f;
    }
    if (!quiet)
        pell_info(scene->ctx, scene->path, "names no material: marble is used%s", colored ? " in the colours of the vertices" : "");
    for (size_t i = 0; i < scene->num_meshes; i++)
        if (scene->meshes[i].material < 0)
            scene->meshes[i].material = (int) index;
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_scene_check_view(struct pell_scene *scene)
{
    enum pell_result res = PELL_OK;

    for (size_t i = 0; res == PELL_OK && i < scene->num_lights; i++)
        res = check_light(scene, &scene->lights[i]);
    for (size_t i = 0; res == PELL_OK && i < scene->num_cameras; i++)
        res = check_camera(scene, &scene->cameras[i]);
    return res;
}

/* Adds what a file may leave out: camera, lights, a ground. */
static enum pell_result complete_view(struct pell_scene *scene, const struct pell_load_params *params, const struct pell_extras *extras)
{
    const struct pell_surroundings *around = &extras->surroundings;
    bool ground;
    enum pell_result res;

    if (extras->view.has_from)
        PELL_TRY(pell_scene_frame_from(scene, &extras->view, params->aspect > 0.0f ? params->aspect : extras->aspect));
    else if (scene->num_cameras == 0)
        PELL_TRY(pell_scene_frame(scene, params->aspect > 0.0f ? params->aspect : extras->aspect));
    if (extras->view.has_studio)
        pell_scene_drop_lights(scene);
    ground = extras->view.has_studio ? pell_studio_has_backdrop(extras->view.studio) && scene->background == PELL_BACKGROUND_COLOR
                                     : extras->backdrop && !around->environment;
    ground = extras->ground || params->ground || (ground && !around->background);
    if ((extras->studio && !around->environment) || extras->view.has_studio || (scene->num_lights == 0 && !extras->own_lights))
        PELL_TRY(pell_scene_studio(scene, extras->view.studio, ground));
    if (ground)
        PELL_TRY(pell_scene_ground(scene, extras->ground_material));
    if (scene->from_file && scene->background == PELL_BACKGROUND_COLOR && scene->ground_mesh < 0 && !extras->own_background &&
        !around->background)
        scene->contact_shadow = true;
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_scene_finish(struct pell_scene *scene, const struct pell_load_params *params, const struct pell_extras *extras)
{
    static const struct pell_load_params no_params;
    static const struct pell_extras no_extras = { .ground_material = -1 };
    bool thick = false; /* bounds are those of surfaces with their thickness */
    enum pell_result res;

    if (!params)
        params = &no_params;
    if (!extras)
        extras = &no_extras;
    PELL_TRY(pell_scene_surround(scene, &extras->surroundings));
    PELL_TRY(pell_scene_default_material(scene, false));
    for (size_t i = 0; i < scene->num_meshes; i++)
        PELL_TRY(check_mesh(scene, i));
    for (size_t i = 0; i < scene->num_materials; i++)
        PELL_TRY(check_material(scene, &scene->materials[i]));
    PELL_TRY(pell_scene_check_view(scene));
    PELL_TRY(pell_scene_check_extent(scene, params));
    PELL_TRY(pell_join_touching(scene, params->bare));
    PELL_TRY(complete_objects(scene, params->bare));
    for (size_t i = 0; i < scene->num_meshes; i++)
        thick |= scene->meshes[i].thicken > 0.0f;
    if (thick && !pell_scene_bounds(scene, scene->bounds_min, scene->bounds_max)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    PELL_TRY(complete_tangents(scene));
    if (pell_cancelled(scene->ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    pell_scene_drop_textures(scene);
    if (!params->bare)
        PELL_TRY(complete_view(scene, params, extras));
    pell_scene_find_light_shells(scene);
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_scene_complete(struct pell_scene *scene, const struct pell_load_params *params)
{
    if (!scene)
        return pell_null(NULL, "pell_scene_complete");

    struct pell_extras extras = { .ground_material = -1 };
    enum pell_result res = params ? pell_viewpoint_read(scene->ctx, params, &extras.view) : PELL_OK;

    if (params && res == PELL_OK)
        res = pell_surroundings_read(scene->ctx, params, &extras.surroundings);
    return res == PELL_OK ? pell_scene_finish(scene, params, &extras) : res;
}
