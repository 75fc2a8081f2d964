/* SPDX-License-Identifier: MIT
 * scene.c - scenes as plain data: making, growing and destroying one, built-in materials, transforms. */
#include "scene/scene.h"
#include "base/file.h"
#include "scene/layers.h"

#include <string.h>

enum { MESHES, MATERIALS, TEXTURES, LIGHTS, CAMERAS, OPTIONS };

enum pell_result pell_scene_create(struct pell_context *ctx, struct pell_scene **out)
{
    if (out)
        *out = NULL;
    if (!ctx || !out)
        return pell_null(ctx, "pell_scene_create");

    struct pell_scene *scene = pell_zalloc(ctx, sizeof(*scene));

    *out = NULL;
    if (!scene)
        return PELL_ERR_NOMEM;
    scene->ctx = ctx;
    scene->ground_mesh = -1;
    for (int c = 0; c < 3; c++)
        scene->background_color[c] = 0.18f;
    scene->path = pell_strdup(ctx, "");
    if (!scene->path) {
        pell_free(ctx, scene);
        return PELL_ERR_NOMEM;
    }
    *out = scene;
    return PELL_OK;
}

void pell_mesh_finish(struct pell_context *ctx, struct pell_mesh *mesh)
{
    pell_free(ctx, mesh->name);
    pell_free(ctx, mesh->position);
    pell_free(ctx, mesh->normal);
    pell_free(ctx, mesh->tangent);
    for (int i = 0; i < PELL_UV_SETS; i++)
        pell_free(ctx, mesh->uv[i]);
    pell_free(ctx, mesh->color);
    pell_free(ctx, mesh->index);
    memset(mesh, 0, sizeof(*mesh));
}

void pell_texture_destroy(struct pell_context *ctx, struct pell_texture *texture)
{
    if (!texture)
        return;
    if (!texture->shared)
        pell_image_finish(ctx, &texture->image);
    pell_free(ctx, texture->name);
    pell_free(ctx, texture);
}

void pell_scene_destroy(struct pell_scene **scene)
{
    struct pell_scene *s = *scene;
    struct pell_context *ctx;

    if (!s)
        return;
    *scene = NULL;
    ctx = s->ctx;
    pell_free(ctx, s->vanished);
    for (size_t i = 0; i < s->num_meshes; i++)
        pell_mesh_finish(ctx, &s->meshes[i]);
    for (size_t i = 0; i < s->num_materials; i++) {
        pell_free(ctx, s->materials[i].name);
        pell_free(ctx, s->materials[i].preset);
        pell_free(ctx, s->materials[i].profile);
        pell_scene_layers_finish(ctx, &s->materials[i]);
    }
    for (size_t i = 0; i < s->num_textures; i++)
        pell_texture_destroy(ctx, s->textures[i]);
    for (size_t i = 0; i < s->num_lights; i++)
        pell_free(ctx, s->lights[i].name);
    for (size_t i = 0; i < s->num_cameras; i++)
        pell_free(ctx, s->cameras[i].name);
    for (size_t i = 0; i < s->num_options; i++) {
        pell_free(ctx, s->options[i].name);
        pell_free(ctx, s->options[i].value);
        pell_free(ctx, s->options[i].where);
    }
    pell_free(ctx, s->meshes);
    pell_free(ctx, s->materials);
    pell_free(ctx, s->textures);
    pell_free(ctx, s->lights);
    pell_free(ctx, s->cameras);
    pell_free(ctx, s->options);
    pell_free(ctx, s->texture_slots);
    pell_free(ctx, s->path);
    pell_free(ctx, s);
}

/* --- Adding ------------------------------------------------------------------------------------------------------------------- */

/* Makes room for one more zeroed element of `size` bytes in *array, with a copy of its name. */
static enum pell_result add(struct pell_scene *scene, int kind, const char *kinds, void **array, size_t count, size_t size,
                            const char *name, char **copy)
{
    const int limit = pell_context_limits(scene->ctx)->items;
    enum pell_result res;

    *copy = NULL;
    if (count >= (size_t) limit)
        return pell_error(scene->ctx, PELL_ERR_UNSUPPORTED, scene->path, PELL_RAISE_LIMIT("items"), "more than %d %s; %d are allowed",
                          limit, kinds, limit);
    PELL_TRY(pell_grow(scene->ctx, array, count, &scene->capacity[kind], size));
    *copy = pell_strdup(scene->ctx, name ? name : "");
    if (!*copy)
        return PELL_ERR_NOMEM;
    memset((char *) *array + count * size, 0, size);
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_scene_add_mesh(struct pell_scene *scene, const char *name, size_t *index)
{
    if (!scene || !index)
        return pell_null(scene ? scene->ctx : NULL, "pell_scene_add_mesh");

    void *array = scene->meshes;
    char *copy;
    const enum pell_result res = add(scene, MESHES, "meshes", &array, scene->num_meshes, sizeof(scene->meshes[0]), name, &copy);

    scene->meshes = array;
    if (res != PELL_OK)
        return res;
    *index = scene->num_meshes++;
    scene->meshes[*index].name = copy;
    return PELL_OK;
}

struct pell_texture_map pell_texture_map_none(void)
{
    return (struct pell_texture_map) { .matrix = { 1, 0, 0, 0, 1, 0 } };
}

enum pell_result pell_scene_add_material(struct pell_scene *scene, const char *name, size_t *index)
{
    if (!scene || !index)
        return pell_null(scene ? scene->ctx : NULL, "pell_scene_add_material");

    const struct pell_material_entry *marble = pell_material_find("marble");
    struct pell_material *m;
    void *array = scene->materials;
    char *copy;
    const enum pell_result res = add(scene, MATERIALS, "materials", &array, scene->num_materials, sizeof(scene->materials[0]), name, &copy);

    scene->materials = array;
    if (res != PELL_OK)
        return res;
    *index = scene->num_materials++;
    m = &scene->materials[*index];
    m->name = copy;
    m->opaque = true;
    m->double_sided = true;
    if (marble)
        m->medium = marble->medium;
    m->model = PELL_MATERIAL_MODEL;
    m->mix = 0.5f;
    m->strength = 1.0f;
    m->metallic = m->roughness = 1.0f;
    m->rho_s = 1.0f;
    m->normal_scale = 1.0f;
    m->alpha_cutoff = 0.5f;
    m->base_color[3] = 1.0f;
    for (int c = 0; c < 3; c++)
        m->base_color[c] = m->specular_color[c] = m->diffuse_transmission_color[c] = 1.0f;
    for (enum pell_map i = 0; i < PELL_MAPS; i++)
        *pell_material_map_of(m, i) = pell_texture_map_none();
    return PELL_OK;
}

enum pell_result pell_scene_add_texture(struct pell_scene *scene, const char *name, struct pell_texture **texture)
{
    if (!scene || !texture)
        return pell_null(scene ? scene->ctx : NULL, "pell_scene_add_texture");

    void *array = scene->textures;
    struct pell_texture *t = pell_zalloc(scene->ctx, sizeof(*t));
    enum pell_result res;

    *texture = NULL;
    if (!t)
        return PELL_ERR_NOMEM;
    res = add(scene, TEXTURES, "textures", &array, scene->num_textures, sizeof(scene->textures[0]), name, &t->name);
    scene->textures = array;
    if (res != PELL_OK) {
        pell_free(scene->ctx, t);
        return res;
    }
    scene->textures[scene->num_textures++] = t;
    *texture = t;
    return PELL_OK;
}

enum pell_result pell_scene_add_light(struct pell_scene *scene, const char *name, size_t *index)
{
    if (!scene || !index)
        return pell_null(scene ? scene->ctx : NULL, "pell_scene_add_light");

    void *array = scene->lights;
    char *copy;
    const enum pell_result res = add(scene, LIGHTS, "lights", &array, scene->num_lights, sizeof(scene->lights[0]), name, &copy);

    scene->lights = array;
    if (res != PELL_OK)
        return res;
    *index = scene->num_lights++;
    scene->lights[*index].name = copy;
    return PELL_OK;
}

enum pell_result pell_scene_add_camera(struct pell_scene *scene, const char *name, size_t *index)
{
    if (!scene || !index)
        return pell_null(scene ? scene->ctx : NULL, "pell_scene_add_camera");

    void *array = scene->cameras;
    char *copy;
    const enum pell_result res = add(scene, CAMERAS, "cameras", &array, scene->num_cameras, sizeof(scene->cameras[0]), name, &copy);

    scene->cameras = array;
    if (res != PELL_OK)
        return res;
    *index = scene->num_cameras++;
    scene->cameras[*index].name = copy;
    return PELL_OK;
}

enum pell_result pell_scene_add_option(struct pell_scene *scene, const char *name, const char *value, const char *where)
{
    void *array = scene->options;
    struct pell_scene_option *o;
    char *copy;
    const enum pell_result res = add(scene, OPTIONS, "render options", &array, scene->num_options, sizeof(scene->options[0]), name, &copy);

    scene->options = array;
    if (res != PELL_OK)
        return res;
    o = &scene->options[scene->num_options++];
    o->name = copy;
    o->value = pell_strdup(scene->ctx, value);
    o->where = pell_strdup(scene->ctx, where);
    return o->value && o->where ? PELL_OK : PELL_ERR_NOMEM;
}

/* Reports an index that is out of range. */
static bool index_valid(const struct pell_scene *scene, const char *where, const char *kind, size_t index, size_t count)
{
    if (index >= count)
        pell_error(scene->ctx, PELL_ERR_INVALID, where, NULL, "%s %zu does not exist; there are %zu", kind, index, count);
    return index < count;
}

enum pell_result pell_mesh_allocate(struct pell_scene *scene, size_t mesh, uint32_t vertices, uint32_t triangles)
{
    if (!scene)
        return pell_null(NULL, "pell_mesh_allocate");

    const struct pell_limits *limits = pell_context_limits(scene->ctx);
    struct pell_mesh *m;
    int64_t all_vertices, all_triangles;

    if (!index_valid(scene, scene->path, "mesh", mesh, scene->num_meshes))
        return PELL_ERR_INVALID;
    m = &scene->meshes[mesh];
    if (m->position)
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL, "the mesh has its arrays already");
    all_vertices = scene->total_vertices + vertices;
    all_triangles = scene->total_triangles + triangles;
    if (all_vertices > limits->vertices)
        return pell_error(scene->ctx, PELL_ERR_UNSUPPORTED, scene->path, PELL_RAISE_LIMIT("vertices"), "%lld vertices; %lld are allowed",
                          (long long) all_vertices, (long long) limits->vertices);
    if (all_triangles > limits->triangles)
        return pell_error(scene->ctx, PELL_ERR_UNSUPPORTED, scene->path, PELL_RAISE_LIMIT("triangles"), "%lld triangles; %lld are allowed",
                          (long long) all_triangles, (long long) limits->triangles);

    /* One more vertex than used: ray packets read positions 16 bytes at a time. */
    m->position = pell_calloc(scene->ctx, (size_t) vertices + 1, 3 * sizeof(float));
    m->normal = pell_calloc(scene->ctx, vertices, 3 * sizeof(float));
    m->index = pell_calloc(scene->ctx, triangles, 3 * sizeof(uint32_t));
    if (!m->position || !m->normal || !m->index) {
        pell_free(scene->ctx, m->position);
        pell_free(scene->ctx, m->normal);
        pell_free(scene->ctx, m->index);
        m->position = m->normal = NULL;
        m->index = NULL;
        return PELL_ERR_NOMEM;
    }
    m->num_vertices = vertices;
    m->num_triangles = triangles;
    scene->total_vertices = all_vertices;
    scene->total_triangles = all_triangles;
    return PELL_OK;
}

enum pell_result pell_mesh_allocate_uv(struct pell_scene *scene, size_t mesh, int set)
{
    if (!scene)
        return pell_null(NULL, "pell_mesh_allocate_uv");

    struct pell_mesh *m;

    if (!index_valid(scene, scene->path, "mesh", mesh, scene->num_meshes))
        return PELL_ERR_INVALID;
    m = &scene->meshes[mesh];
    if (set < 0 || set >= PELL_UV_SETS)
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL, "UV set %d, must be in [0, %d]", set, PELL_UV_SETS - 1);
    if (!m->position || m->uv[set])
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL, "UV set %d %s", set,
                          m->position ? "is there already" : "has no vertices: allocate the mesh first");
    m->uv[set] = pell_calloc(scene->ctx, m->num_vertices, 2 * sizeof(float));
    return m->uv[set] ? PELL_OK : PELL_ERR_NOMEM;
}

enum pell_result pell_texture_allocate(struct pell_scene *scene, struct pell_texture *texture, int width, int height, int channels,
                                       enum pell_pixel_type type)
{
    if (!scene || !texture)
        return pell_null(scene ? scene->ctx : NULL, "pell_texture_allocate");

    static const size_t bytes[] = { [PELL_PIXEL_U8] = 1, [PELL_PIXEL_U16] = 2, [PELL_PIXEL_F32] = 4 };
    const int64_t most = pell_context_limits(scene->ctx)->image_pixels;
    struct pell_image *image = &texture->image;

    if (channels < 1 || channels > 4 || (unsigned) type >= PELL_COUNT(bytes))
        return pell_error(scene->ctx, PELL_ERR_INVALID, texture->name, NULL, "%d channels of type %d, must be 1 to 4 of a known type",
                          channels, (int) type);
    if (width < 1 || height < 1 || width > most / height)
        return pell_error(scene->ctx, PELL_ERR_INVALID, texture->name, PELL_RAISE_LIMIT("image-pixels"),
                          "%d x %d pixels, must be 1 to %lld", width, height, (long long) most);
    if (image->pixels)
        return pell_error(scene->ctx, PELL_ERR_INVALID, texture->name, NULL, "the texture has its pixels already");
    image->pixels = pell_calloc(scene->ctx, (size_t) width * (size_t) height, (size_t) channels * bytes[type]);
    if (!image->pixels)
        return PELL_ERR_NOMEM;
    image->width = width;
    image->height = height;
    image->channels = channels;
    image->type = type;
    return PELL_OK;
}

static enum pell_result grow_floats(struct pell_context *ctx, float **array, uint32_t count, int each, const uint32_t *from, uint32_t more,
                                    size_t pad)
{
    float *grown;

    if (!*array)
        return PELL_OK;
    grown = pell_realloc_array(ctx, *array, (size_t) count + more + pad, (size_t) each * sizeof(float));
    if (!grown)
        return PELL_ERR_NOMEM;
    for (uint32_t i = 0; i < more; i++)
        memcpy(grown + (size_t) each * ((size_t) count + i), grown + (size_t) each * from[i], (size_t) each * sizeof(float));
    if (pad)
        memset(grown + (size_t) each * ((size_t) count + more), 0, pad * (size_t) each * sizeof(float));
    *array = grown;
    return PELL_OK;
}

enum pell_result pell_mesh_duplicate(struct pell_scene *scene, size_t mesh, const uint32_t *from, uint32_t more)
{
    struct pell_mesh *m = &scene->meshes[mesh];
    const int64_t limit = pell_context_limits(scene->ctx)->vertices;
    enum pell_result res;

    if (scene->total_vertices + more > limit)
        return pell_error(scene->ctx, PELL_ERR_UNSUPPORTED, scene->path, PELL_RAISE_LIMIT("vertices"),
                          "%lld vertices after splitting creases and seams; %lld are allowed", (long long) (scene->total_vertices + more),
                          (long long) limit);
    PELL_TRY(grow_floats(scene->ctx, &m->position, m->num_vertices, 3, from, more, 1));
    PELL_TRY(grow_floats(scene->ctx, &m->normal, m->num_vertices, 3, from, more, 0));
    PELL_TRY(grow_floats(scene->ctx, &m->tangent, m->num_vertices, 4, from, more, 0));
    PELL_TRY(grow_floats(scene->ctx, &m->color, m->num_vertices, 4, from, more, 0));
    for (int i = 0; i < PELL_UV_SETS; i++)
        PELL_TRY(grow_floats(scene->ctx, &m->uv[i], m->num_vertices, 2, from, more, 0));
    m->num_vertices += more;
    scene->total_vertices += more;
    return PELL_OK;

fail:
    return res;
}

/* --- Materials ---------------------------------------------------------------------------------------------------------------- */

enum pell_result pell_material_unknown(struct pell_context *ctx, const char *where, const char *name)
{
    const size_t count = pell_material_count();
    const char **names = pell_alloc_array(ctx, count ? count : 1, sizeof(*names));
    struct pell_text hint = { 0 };
    char shown[128];

    if (!names)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < count; i++)
        names[i] = pell_material_at(i)->name;
    if (pell_text_suggest(&hint, "", name, names, count))
        pell_text_add(&hint, " ");
    pell_text_add(&hint, "`pellucid materials` lists all");
    pell_free(ctx, names);
    return pell_error(ctx, PELL_ERR_INVALID, where, hint.str, "there is no material \"%s\"", pell_printable(name, shown, sizeof(shown)));
}

enum pell_result pell_material_set(struct pell_context *ctx, struct pell_material *m, const struct pell_material_entry *entry)
{
    char *preset = pell_strdup(ctx, entry->name);

    if (!preset)
        return PELL_ERR_NOMEM;
    pell_free(ctx, m->preset);
    m->preset = preset;
    m->opaque = false;
    m->medium = entry->medium;
    m->gaussians = entry->gaussians;
    if (entry->kind == PELL_MATERIAL_MEDIUM)
        m->gaussians.count = 0;
    pell_free(ctx, m->profile);
    m->profile = NULL;
    pell_scene_layers_finish(ctx, m);
    m->model = PELL_MATERIAL_MODEL;
    m->color_from = entry->color_from_texture ? PELL_COLOR_FROM_TEXTURE : PELL_COLOR_FROM_PROFILE;
    m->mix = (float) entry->mix;
    /* A colour the file gives by a texture stays; a plain factor of the file would tint the entry. */
    for (int c = 0; c < 3; c++)
        m->base_color[c] = m->base_color_map.texture ? 1.0f : (float) entry->color[c];
    m->metallic = 0.0f;
    m->metallic_map = pell_texture_map_none();
    if (!m->roughness_map.texture)
        m->roughness = (float) entry->roughness;
    return PELL_OK;
}

enum pell_result pell_material_apply(struct pell_scene *scene, size_t material, const char *where, const char *entry)
{
    if (!scene || !where || !entry)
        return pell_null(scene ? scene->ctx : NULL, "pell_material_apply");

    const struct pell_material_entry *found = pell_material_find(entry);

    if (!index_valid(scene, where, "material", material, scene->num_materials))
        return PELL_ERR_INVALID;
    if (!found)
        return pell_material_unknown(scene->ctx, where, entry);
    return pell_material_set(scene->ctx, &scene->materials[material], found);
}

enum pell_result pell_material_allocate_layers(struct pell_scene *scene, size_t material, int count)
{
    if (!scene)
        return pell_null(NULL, "pell_material_allocate_layers");

    struct pell_material *m;

    if (!index_valid(scene, scene->path, "material", material, scene->num_materials))
        return PELL_ERR_INVALID;
    m = &scene->materials[material];
    if (count < 0 || count > PELL_LAYERS_MOST)
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL, "the number of layers is %d, allowed: [0, %d]", count,
                          PELL_LAYERS_MOST);
    pell_scene_layers_finish(scene->ctx, m);
    if (count == 0)
        return PELL_OK;
    m->layers = pell_calloc(scene->ctx, (size_t) count, sizeof(*m->layers));
    if (!m->layers)
        return PELL_ERR_NOMEM;
    m->num_layers = count;
    for (int i = 0; i < count; i++)
        m->layers[i].depth_map = pell_texture_map_none();
    return PELL_OK;
}

enum pell_result pell_material_solve_layers(struct pell_scene *scene, size_t material)
{
    if (!scene)
        return pell_null(NULL, "pell_material_solve_layers");

    struct pell_layer_measure measure[PELL_LAYERS_MOST];
    struct pell_layer_fault fault;
    struct pell_material *m;

    if (!index_valid(scene, scene->path, "material", material, scene->num_materials))
        return PELL_ERR_INVALID;
    m = &scene->materials[material];
    if (m->num_layers < 1)
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL, "the material has no layers");
    if (!(m->medium.eta >= 1.0 && m->medium.eta <= 4.0))
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL, "eta is %g, allowed: [1, 4]", m->medium.eta);
    if (!pell_scene_layers_valid(m, &fault))
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL, "%s is %g, allowed: [%g, %g]", fault.field, fault.value, fault.min,
                          fault.max);
    pell_scene_layers_measure(m, measure);
    if (!pell_scene_layers_solve(m, measure))
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL,
                          "the layers reflect no light, so there is no sum of Gaussians for them");
    return PELL_OK;
}

/* --- Transform ---------------------------------------------------------------------------------------------------------------- */

static void transform_direction(const struct pell_mat4 *matrix, float *v, bool normal)
{
    const struct pell_vec3 old = vec3_load(v), d = vec3_normalize(normal ? mat4_normal(matrix, old) : mat4_direction(matrix, old));
    const float l2 = vec3_dot(d, d);

    /* A singular matrix can collapse a direction: then the old one is kept. */
    if (l2 > 0.5f && l2 < 2.0f)
        vec3_store(d, v);
}

static void transform_point(const struct pell_mat4 *matrix, float *p)
{
    vec3_store(mat4_point(matrix, vec3_load(p)), p);
}

/* Makes `up` a unit vector perpendicular to `forward`. */
void pell_scene_orthogonalize(const float *forward, float *up)
{
    const struct pell_vec3 f = vec3_load(forward), u = vec3_load(up);
    struct pell_vec3 t, b = vec3_mad(u, -vec3_dot(u, f), f);

    if (vec3_dot(b, b) > 1e-12f)
        b = vec3_normalize(b);
    else
        vec3_basis(f, &t, &b);
    vec3_store(b, up);
}

static void transform_mesh(struct pell_mesh *mesh, const struct pell_mat4 *matrix)
{
    const bool mirrors = mat4_determinant3(matrix) < 0.0;
    /* Cofactors are squares of scales: mm per unit cubed and its inverse fit into floats only if scaled to one first. */
    const struct pell_mat4 unit = pell_mat4_scaled_to_one(matrix);

    for (uint32_t i = 0; i < mesh->num_vertices; i++) {
        transform_point(matrix, mesh->position + 3 * (size_t) i);
        if (mesh->normal)
            transform_direction(&unit, mesh->normal + 3 * (size_t) i, true);
        if (mesh->tangent) {
            transform_direction(&unit, mesh->tangent + 4 * (size_t) i, false);
            if (mirrors)
                mesh->tangent[4 * (size_t) i + 3] *= -1.0f;
        }
    }
    for (uint32_t i = 0; mirrors && i < mesh->num_triangles; i++) {
        uint32_t *t = mesh->index + 3 * (size_t) i, swap = t[1];
        t[1] = t[2];
        t[2] = swap;
    }
}

enum pell_result pell_scene_transform(struct pell_scene *scene, const struct pell_mat4 *matrix, double unit_scale)
{
    const float k = (float) unit_scale;

    for (int i = 0; i < 16; i++)
        if (!isfinite(matrix->m[i]))
            return pell_error(scene->ctx, PELL_ERR_INVALID, scene->path, NULL, "a transform is not finite");
    if (!(unit_scale > 0.0) || !isfinite(k) || !isfinite(1.0 / unit_scale))
        return pell_error(scene->ctx, PELL_ERR_INVALID, scene->path, NULL, "a unit of %g mm is out of range", unit_scale);

    for (size_t i = 0; i < scene->num_meshes; i++)
        transform_mesh(&scene->meshes[i], matrix);
    for (size_t i = 0; i < scene->num_lights; i++) {
        struct pell_light *l = &scene->lights[i];
        transform_point(matrix, l->position);
        transform_direction(matrix, l->direction, false);
        transform_direction(matrix, l->up, false);
        pell_scene_orthogonalize(l->direction, l->up);
        l->width *= k;
        l->height *= k;
        l->radius *= k;
        l->range *= k;
    }
    for (size_t i = 0; i < scene->num_cameras; i++) {
        struct pell_camera *c = &scene->cameras[i];
        transform_point(matrix, c->position);
        transform_direction(matrix, c->forward, false);
        transform_direction(matrix, c->up, false);
        pell_scene_orthogonalize(c->forward, c->up);
        c->ortho_height *= k;
        c->focus *= k;
    }
    /* Built-in entries are in mm already; an opaque material's medium is not used and remains marble's. */
    for (size_t i = 0; i < scene->num_materials; i++) {
        struct pell_material *m = &scene->materials[i];
        if (m->preset || m->opaque)
            continue;
        for (int c = 0; c < 3; c++) {
            m->medium.sigma_a[c] /= unit_scale;
            m->medium.sigma_s_reduced[c] /= unit_scale;
        }
        for (int g = 0; g < m->gaussians.count; g++)
            m->gaussians.variance[g] *= unit_scale * unit_scale;
    }
    return PELL_OK;
}
