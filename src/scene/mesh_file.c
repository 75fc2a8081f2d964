/* SPDX-License-Identifier: MIT
 *
 * mesh_file.c - reads one mesh file: detects its format, converts units into mm, merges the result into a scene.
 */
#include "base/file.h"
#include "scene/scene.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#define MM_MIN 1e-9 /* least value of one unit, and of a size */
#define MM_MAX 1e12

static bool contains(const uint8_t *data, size_t size, const char *text)
{
    const size_t n = strlen(text);
    const uint8_t *p = data, *end = data + size;

    while ((size_t) (end - p) >= n && (p = memchr(p, text[0], (size_t) (end - p) - n + 1)) != NULL) {
        if (memcmp(p, text, n) == 0)
            return true;
        p++;
    }
    return false;
}

static bool is_space(uint8_t c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\n';
}

/* Whether the first line that is no comment begins like a line of an OBJ file. */
static bool looks_like_obj(const uint8_t *p, const uint8_t *end)
{
    static const char *const words[] = { "v", "vt", "vn", "vp", "f", "o", "g", "s", "mtllib", "usemtl", "l", "p" };

    while (p < end) {
        const uint8_t *word;
        while (p < end && is_space(*p))
            p++;
        if (p < end && *p != '#') {
            word = p;
            while (p < end && !is_space(*p))
                p++;
            for (size_t i = 0; i < PELL_COUNT(words); i++)
                if ((size_t) (p - word) == strlen(words[i]) && memcmp(word, words[i], strlen(words[i])) == 0)
                    return true;
            return false;
        }
        while (p < end && *p != '\n' && *p != '\r')
            p++;
    }
    return false;
}

/* False for bytes that no text file begins with. */
static bool is_text(const uint8_t *p, const uint8_t *end)
{
    for (const uint8_t *stop = end - p > 256 ? p + 256 : end; p < stop; p++)
        if (*p < 0x20 && !is_space(*p))
            return false;
    return true;
}

enum pell_scene_format pell_scene_detect_format(const char *path, const uint8_t *data, size_t size)
{
    const uint8_t *p = data, *end = data + size;

    if (size >= 4 && memcmp(p, "glTF", 4) == 0)
        return PELL_SCENE_GLTF;
    if (size >= 4 && memcmp(p, "ply", 3) == 0 && is_space(p[3]))
        return PELL_SCENE_PLY;
    if (pell_path_has_extension(path, "stl") || pell_stl_is_binary(data, size) ||
        (size >= 6 && strncasecmp((const char *) p, "solid", 5) == 0 && is_space(p[5])))
        return PELL_SCENE_STL;
    if (size >= 3 && memcmp(p, "\xef\xbb\xbf", 3) == 0)
        p += 3;
    while (p < end && is_space(*p))
        p++;
    if (p < end && *p == '{') {
        if (pell_path_has_extension(path, "gltf"))
            return PELL_SCENE_GLTF;
        return contains(data, size, "\"pellucid\"") || !contains(data, size, "\"asset\"") ? PELL_SCENE_SCENE : PELL_SCENE_GLTF;
    }
    if (pell_path_has_extension(path, "obj") || looks_like_obj(p, end))
        return PELL_SCENE_OBJ;
    if (size == 0 || !is_text(p, end))
        return PELL_SCENE_UNKNOWN;
    if (pell_path_has_extension(path, "gltf"))
        return PELL_SCENE_GLTF;
    return pell_path_has_extension(path, "json") ? PELL_SCENE_SCENE : PELL_SCENE_UNKNOWN;
}

/* Refuses an unknown file, and reports its probable format. */
static enum pell_result refuse(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size)
{
    /* clang-format off */
    static const struct {
        const char *magic, *extension, *what, *fix;
    } others[] = {
        { "Kaydara FBX", "fbx", "an FBX file", "convert it: assimp export IN.fbx OUT.glb" },
        { "BLENDER", "blend", "a Blender file",
          "convert it: blender -b IN.blend --python-expr \"import bpy; bpy.ops.export_scene.gltf(filepath='OUT.glb')\"" },
        { "PXR-USDC", "usd", "a USD file", "convert it: usd2gltf -i IN.usd -o OUT.glb" },
        { "PXR-USDC", "usdc", "a USD file", "convert it: usd2gltf -i IN.usdc -o OUT.glb" },
        { "#usda", "usda", "a USD file", "convert it: usd2gltf -i IN.usda -o OUT.glb" },
        { "PK\x03\x04", "usdz", "a zip archive", "if it is USD: usd2gltf -i IN.usdz -o OUT.glb" },
        { "OFF", "off", "an OFF file", "convert it: assimp export IN.off OUT.ply" },
        { "<?xml", "dae", "an XML file", "if it is COLLADA: assimp export IN.dae OUT.glb" },
        { "\x89PNG", "png", "an image", NULL },
        { "\xff\xd8\xff", "jpg", "an image", NULL },
        { "\x76\x2f\x31\x01", "exr", "an image", NULL },
        { "#?RADIANCE", "hdr", "an image", NULL },
    };
    /* clang-format on */
    const char *fix = "convert it to glTF, or to OBJ, PLY or STL";
    const char *what = size == 0                              ? "an empty file"
                       : pell_path_has_extension(path, "glb") ? "no GLB, which begins with \"glTF\""
                       : pell_path_has_extension(path, "ply") ? "no PLY, which begins with \"ply\""
                                                              : "no format that is known here";

    for (size_t i = 0; i < PELL_COUNT(others); i++) {
        const size_t n = strlen(others[i].magic);
        if ((size >= n && memcmp(data, others[i].magic, n) == 0) || (size && pell_path_has_extension(path, others[i].extension))) {
            what = others[i].what;
            fix = others[i].fix;
        }
    }
    return pell_error(ctx, PELL_ERR_UNSUPPORTED, path, fix, "is %s; allowed are glTF (.gltf, .glb), OBJ, PLY, STL and scene files (.json)",
                      what);
}

enum pell_result pell_loader_read(const struct pell_loader *loader, const char *where, const char *reference, char **path, uint8_t **data,
                                  size_t *size)
{
    enum pell_result res;

    *data = NULL;
    *path = NULL;
    if (loader->read) {
        *path = pell_strdup(loader->ctx, reference);
        return *path ? loader->read(loader->user, loader->ctx, reference, data, size) : PELL_ERR_NOMEM;
    }
    PELL_TRY(pell_path_resolve(loader->ctx, where, loader->root, reference, loader->params->allow_outside, path));
    PELL_TRY(pell_file_read(loader->ctx, *path, data, size));

fail:
    return res;
}

static enum pell_result no_unit(struct pell_context *ctx, const char *path, const char *format)
{
    return pell_error(ctx, PELL_ERR_INVALID, path, "--size 70mm: the largest extent, or --unit 1mm: what one unit is",
                      "%s files have no unit, but scattering distances are lengths: without a size or a unit the image would be arbitrary",
                      format);
}

/* mm per unit of the imported scene: given, from a size, or the format's own. */
static enum pell_result find_unit(const struct pell_import *import, const struct pell_scale *scale, double *mm)
{
    float min[3], max[3];
    double extent = 0.0;

    *mm = scale->mm_per_unit > 0.0 ? scale->mm_per_unit : import->default_mm_per_unit;
    if (scale->size_mm > 0.0 && !(import->scene->total_triangles == 0 && import->scene->vanished)) {
        if (!pell_scene_bounds(import->scene, min, max))
            return pell_cancelled(import->ctx)
                       ? PELL_ERR_CANCELLED
                       : pell_error(
                             import->ctx, PELL_ERR_FORMAT, import->path, NULL,
                             import->scene->total_triangles > 0
                                 ? "its coordinates are too large for a size to be given to it: their differences must be in floats' range"
                                 : "holds no triangles, so a size can't be given to it");
        for (int c = 0; c < 3; c++)
            extent = fmax(extent, (double) max[c] - min[c]);
        if (!(extent > 0.0))
            return pell_error(import->ctx, PELL_ERR_FORMAT, import->path, NULL, "all points coincide, so a size can't be given to it");
        *mm = scale->size_mm / extent;
    }
    if (!(*mm >= MM_MIN && *mm <= MM_MAX))
        return pell_error(import->ctx, PELL_ERR_INVALID, scale->where, NULL, "one unit of the file would be %g mm, allowed: [%g, %g]", *mm,
                          MM_MIN, MM_MAX);
    return PELL_OK;
}

/* Unnamed meshes get the file's name, and the index of their object if there are several. */
static enum pell_result name_meshes(struct pell_import *import)
{
    struct pell_scene *scene = import->scene;
    const char *base = pell_path_name(import->path), *dot = strrchr(base, '.');
    const size_t length = dot && dot > base ? (size_t) (dot - base) : strlen(base);
    int first = -1;
    bool several = false;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        if (scene->meshes[i].name[0])
            continue;
        first = first < 0 ? scene->meshes[i].object : first;
        several |= scene->meshes[i].object != first;
    }
    for (size_t i = 0; i < scene->num_meshes; i++) {
        struct pell_mesh *mesh = &scene->meshes[i];
        char name[128];
        if (mesh->name[0])
            continue;
        if (several)
            snprintf(name, sizeof(name), "%.*s %d", (int) (length < 100 ? length : 100), base, mesh->object + 1);
        else
            snprintf(name, sizeof(name), "%.*s", (int) (length < 100 ? length : 100), base);
        pell_free(import->ctx, mesh->name);
        mesh->name = pell_strdup(import->ctx, name);
        if (!mesh->name)
            return PELL_ERR_NOMEM;
    }
    return PELL_OK;
}

/* Sets normals to zero: pell_make_normals computes them. */
static void forget_normals(struct pell_scene *scene, bool flat)
{
    for (size_t i = 0; i < scene->num_meshes; i++) {
        memset(scene->meshes[i].normal, 0, 3 * (size_t) scene->meshes[i].num_vertices * sizeof(float));
        scene->meshes[i].flat = flat;
    }
}

enum pell_result pell_load_mesh(const struct pell_loader *loader, const char *path, const uint8_t *data, size_t size,
                                const struct pell_scale *scale, const struct pell_moment *moment, struct pell_scene **out)
{
    struct pell_context *ctx = loader->ctx;
    const enum pell_scene_format format = pell_scene_detect_format(path, data, size);
    struct pell_import import = { .ctx = ctx,
                                  .loader = loader,
                                  .path = path,
                                  .allow_outside = loader->params->allow_outside,
                                  .moment = *moment,
                                  .replaces_materials = loader->params->material != NULL };
    struct pell_mat4 matrix = mat4_identity();
    char *folder = NULL;
    double mm;
    enum pell_result res;

    *out = NULL;
    if (scale->mm_per_unit > 0.0 && scale->size_mm > 0.0)
        return pell_error(ctx, PELL_ERR_INVALID, scale->where, NULL, "both a unit and a size are given; either of them settles the scale");
    if (format == PELL_SCENE_UNKNOWN)
        return refuse(ctx, path, data, size);
    if (format == PELL_SCENE_SCENE)
        return pell_error(ctx, PELL_ERR_FORMAT, path, NULL, "is a scene file; a mesh file is needed here");
    if (format != PELL_SCENE_GLTF && !(scale->mm_per_unit > 0.0) && !(scale->size_mm > 0.0))
        return no_unit(ctx, path, format == PELL_SCENE_OBJ ? "OBJ" : format == PELL_SCENE_PLY ? "PLY" : "STL");

    PELL_TRY(pell_scene_create(ctx, &import.scene));
    pell_free(ctx, import.scene->path);
    import.scene->path = pell_strdup(ctx, path);
    folder = loader->read ? pell_strdup(ctx, loader->root) : pell_path_folder(ctx, path);
    if (!import.scene->path || !folder) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    import.root = folder;
    PELL_TRY(format == PELL_SCENE_GLTF  ? pell_import_gltf(&import, data, size)
             : format == PELL_SCENE_OBJ ? pell_import_obj(&import, data, size)
             : format == PELL_SCENE_PLY ? pell_import_ply(&import, data, size)
                                        : pell_import_stl(&import, data, size));
    if (loader->normals != PELL_NORMALS_FILE)
        forget_normals(import.scene, loader->normals == PELL_NORMALS_FLAT);
    PELL_TRY(name_meshes(&import));
    PELL_TRY(find_unit(&import, scale, &mm));
    for (int i = 0; i < 3; i++)
        matrix.m[5 * i] = mm;
    PELL_TRY(pell_scene_transform(import.scene, &matrix, mm));
    for (size_t i = 0; i < import.scene->num_meshes; i++)
        import.scene->meshes[i].file = 1;
    import.scene->mm_per_unit = mm;
    import.scene->animated = import.animations > 0;
    *out = import.scene;
    import.scene = NULL;

fail:
    pell_scene_destroy(&import.scene);
    pell_free(ctx, folder);
    return res;
}

enum pell_result pell_scene_merge(struct pell_scene *to, struct pell_scene *from)
{
    const struct pell_limits *limits = pell_context_limits(to->ctx);
    const int materials = (int) to->num_materials;
    int objects = 0, files = 0;
    size_t index;
    enum pell_result res;

    if (to->total_vertices + from->total_vertices > limits->vertices || to->total_triangles + from->total_triangles > limits->triangles)
        return pell_error(
            to->ctx, PELL_ERR_UNSUPPORTED, to->path, "raise the limits: --limit vertices=N --limit triangles=N",
            "%lld vertices and %lld triangles; %lld and %lld are allowed", (long long) (to->total_vertices + from->total_vertices),
            (long long) (to->total_triangles + from->total_triangles), (long long) limits->vertices, (long long) limits->triangles);
    for (size_t i = 0; i < to->num_meshes; i++) {
        objects = to->meshes[i].object >= objects ? to->meshes[i].object + 1 : objects;
        files = to->meshes[i].file > files ? to->meshes[i].file : files;
    }
    for (size_t i = 0; i < from->num_meshes; i++) {
        struct pell_mesh *source = &from->meshes[i], *target;
        char *name;
        PELL_TRY(pell_scene_add_mesh(to, source->name, &index));
        target = &to->meshes[index];
        name = target->name;
        *target = *source;
        target->name = name;
        name = source->name;
        memset(source, 0, sizeof(*source));
        source->name = name;
        target->object = target->object > INT32_MAX - objects ? objects : target->object + objects;
        target->file = target->file > 0 && files < INT32_MAX - 1 ? files + 1 : 0;
        target->material += target->material >= 0 ? materials : 0;
    }
    to->animated |= from->animated;
    if (!to->vanished) {
        to->vanished = from->vanished;
        from->vanished = NULL;
    }
    to->total_vertices += from->total_vertices;
    to->total_triangles += from->total_triangles;
    from->total_vertices = from->total_triangles = 0;
    for (size_t i = 0; i < from->num_textures; i++) {
        struct pell_texture *empty;
        PELL_TRY(pell_scene_add_texture(to, "", &empty));
        to->textures[to->num_textures - 1] = from->textures[i];
        from->textures[i] = empty;
        to->textures[to->num_textures - 1]->key = 0;
    }
    for (size_t i = 0; i < from->num_materials; i++) {
        char *name;
        PELL_TRY(pell_scene_add_material(to, from->materials[i].name, &index));
        name = to->materials[index].name;
        to->materials[index] = from->materials[i];
        to->materials[index].name = name;
        from->materials[i].preset = NULL;
        from->materials[i].profile = NULL;
        from->materials[i].layers = NULL;
    }
    for (size_t i = 0; i < from->num_lights; i++) {
        char *name;
        PELL_TRY(pell_scene_add_light(to, from->lights[i].name, &index));
        name = to->lights[index].name;
        to->lights[index] = from->lights[i];
        to->lights[index].name = name;
    }
    for (size_t i = 0; i < from->num_cameras; i++) {
        char *name;
        PELL_TRY(pell_scene_add_camera(to, from->cameras[i].name, &index));
        name = to->cameras[index].name;
        to->cameras[index] = from->cameras[i];
        to->cameras[index].name = name;
    }
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_scene_choose_camera(struct pell_scene *scene, const char *where, const char *name, enum pell_result code)
{
    const char **names;
    struct pell_text hint = { 0 };
    struct pell_camera swap;
    char shown[96];

    for (size_t i = 0; i < scene->num_cameras; i++) {
        if (strcmp(scene->cameras[i].name, name) != 0)
            continue;
        swap = scene->cameras[0];
        scene->cameras[0] = scene->cameras[i];
        scene->cameras[i] = swap;
        return PELL_OK;
    }
    names = pell_alloc_array(scene->ctx, scene->num_cameras, sizeof(*names));
    if (!names)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < scene->num_cameras; i++)
        names[i] = scene->cameras[i].name;
    pell_text_suggest(&hint, "", name, names, scene->num_cameras);
    pell_free(scene->ctx, names);
    return pell_error(scene->ctx, code, where, hint.str, "there is no camera \"%s\"; the file has %zu",
                      pell_printable(name, shown, sizeof(shown)), scene->num_cameras);
}

void pell_load_moment(const struct pell_load_params *params, struct pell_moment *moment)
{
    if (params->timed || params->time != 0.0) {
        moment->timed = true;
        moment->time = params->time;
    }
    if (params->animation) {
        moment->timed = true;
        moment->animation = params->animation;
        moment->where = "--animation";
        moment->code = PELL_ERR_INVALID;
    }
}
