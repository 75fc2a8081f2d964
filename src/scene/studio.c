/* SPDX-License-Identifier: MIT
 * studio.c - defaults for a scene without camera or lights: a camera that frames it, the lights of a studio, a floor with a curved
 * backdrop. */
#include "base/base.h"
#include "scene/scene.h"

#include <string.h>

#define FRAMED 0.8f /* fraction of the image that the bounds fill */
#define FRAME_FOV_DEG 20.0f
#define DEFAULT_ASPECT (16.0f / 9.0f)

static struct pell_vec3 center_of(const struct pell_scene *scene)
{
    return vec3_mul(vec3_add(vec3_load(scene->bounds_min), vec3_load(scene->bounds_max)), 0.5f);
}

/* Half the diagonal of the bounds; never 0. */
static float radius_of(const struct pell_scene *scene)
{
    const float r = 0.5f * vec3_length(vec3_sub(vec3_load(scene->bounds_max), vec3_load(scene->bounds_min)));
    return r > 1e-6f ? r : 1e-6f;
}

enum pell_result pell_scene_frame(struct pell_scene *scene, float aspect)
{
    const struct pell_vec3 half = vec3_mul(vec3_sub(vec3_load(scene->bounds_max), vec3_load(scene->bounds_min)), 0.5f);
    const float fov = FRAME_FOV_DEG * PELL_PI_F / 180.0f, slope = FRAMED * tanf(0.5f * fov);
    struct pell_vec3 position = center_of(scene);
    struct pell_camera *c;
    float distance;
    size_t index;
    enum pell_result res;

    if (!(aspect > 0.0f) || !isfinite(aspect))
        aspect = DEFAULT_ASPECT;
    PELL_TRY(pell_scene_add_camera(scene, "default", &index));
    /* The box is seen frontally: its front face fills the image. */
    distance = fmaxf(half.y / slope, half.x / (slope * aspect));
    distance = fmaxf(distance, 0.05f * radius_of(scene));
    position.z += half.z + distance;
    c = &scene->cameras[index];
    vec3_store(position, c->position);
    vec3_store(vec3(0, 0, -1), c->forward);
    vec3_store(vec3(0, 1, 0), c->up);
    c->fov = fov;
    return PELL_OK;

fail:
    return res;
}

/* Irradiance on the axis of a square of unit radiance, facing it: half side over distance = x (four times the corner formula of a parallel
 * rectangle, e.g. Howell's catalogue of configuration factors, A-3). */
static float square_irradiance(float x)
{
    const float root = sqrtf(1.0f + x * x);
    return 4.0f * x / root * atanf(x / root);
}

static enum pell_result add_soft(struct pell_scene *scene, const char *name, struct pell_vec3 from, float distance, float side,
                                 float irradiance, const float *tint)
{
    const struct pell_vec3 center = center_of(scene), axis = vec3_normalize(from);
    const float r = radius_of(scene), radiance = irradiance / square_irradiance(0.5f * side / distance);
    struct pell_light *l;
    size_t index;
    enum pell_result res;

    PELL_TRY(pell_scene_add_light(scene, name, &index));
    l = &scene->lights[index];
    l->type = PELL_LIGHT_RECT;
    vec3_store(vec3_mad(center, distance * r, axis), l->position);
    vec3_store(vec3_mul(axis, -1.0f), l->direction);
    vec3_store(vec3(0, 1, 0), l->up);
    pell_scene_orthogonalize(l->direction, l->up);
    l->width = l->height = side * r;
    for (int c = 0; c < 3; c++)
        l->power[c] = radiance * tint[c];
    return PELL_OK;

fail:
    return res;
}

enum tint { WHITE, WARM, COOL };
static const float tints[][3] = { [WHITE] = { 1.0f, 1.0f, 1.0f }, [WARM] = { 1.0f, 0.97f, 0.92f }, [COOL] = { 0.92f, 0.96f, 1.0f } };

/* Positions are to the right, up and towards the camera; distances and sides in radii of the object, so that the irradiance at its centre
 * is the same for any size. */
static const struct soft_light {
    const char *name;
    float toward[3], distance, side, irradiance;
    enum tint tint;
} studios[][3] = {
    { { "studio key", { -0.75f, 0.7f, 0.8f }, 4.0f, 2.4f, 0.85f * PELL_PI_F, WARM },
      { "studio fill", { 0.9f, 0.12f, 0.6f }, 4.5f, 3.2f, 0.22f * PELL_PI_F, COOL },
      { "studio rim", { 0.55f, 0.6f, -0.9f }, 4.0f, 2.0f, 1.1f * PELL_PI_F, WHITE } },
    { { "studio fill", { 0.2f, 0.35f, 1.0f }, 4.5f, 3.6f, 0.25f * PELL_PI_F, COOL },
      { "studio left rim", { -0.85f, 0.35f, -0.7f }, 4.0f, 2.2f, 1.3f * PELL_PI_F, WARM },
      { "studio right rim", { 0.85f, 0.45f, -0.7f }, 4.0f, 2.2f, 1.3f * PELL_PI_F, WHITE } },
    { { "studio fill", { -0.5f, 0.3f, 0.9f }, 4.5f, 3.6f, 0.12f * PELL_PI_F, COOL },
      { "studio back", { 0.3f, 0.55f, -1.0f }, 4.0f, 3.0f, 1.8f * PELL_PI_F, WARM } },
    { { "studio window", { -1.0f, 0.3f, 0.25f }, 4.0f, 4.5f, 1.0f * PELL_PI_F, COOL },
      { "studio room", { 0.9f, 0.1f, 0.5f }, 5.0f, 5.0f, 0.1f * PELL_PI_F, WARM } },
};
/* A light behind the object leaves the ground behind the light's own plane dark. Over a ground it is this many times as far away and as
 * large, at 45 degrees: that border is on the backdrop, above what a level camera sees. */
#define RAISED 3.2f
enum { WINDOW = 3 };
static const char *const studio_names[] = { "soft", "rim", "back", [WINDOW] = "window" };
_Static_assert(PELL_COUNT(studio_names) == PELL_COUNT(studios), "one name per studio");

bool pell_studio_has_backdrop(int studio)
{
    return studio == WINDOW;
}

/* Horizontal direction into the image, unit: of a camera that looks up or down, that of the upper or lower border. */
static struct pell_vec3 level_direction(const struct pell_camera *camera)
{
    const struct pell_vec3 forward = vec3_load(camera->forward), up = vec3_load(camera->up);
    const struct pell_vec3 level = vec3(forward.x, 0, forward.z), border = vec3_mul(up, forward.y > 0.0f ? -1.0f : 1.0f);

    return vec3_normalize(vec3_length(level) > 1e-3f ? level : vec3(border.x, 0, border.z));
}

enum pell_result pell_scene_studio(struct pell_scene *scene, int studio, bool level)
{
    struct pell_vec3 front = vec3(0, 0, 1), up = vec3(0, 1, 0), right;
    enum pell_result res;

    if (scene->num_cameras && level) {
        front = vec3_mul(level_direction(&scene->cameras[0]), -1.0f);
    } else if (scene->num_cameras) {
        front = vec3_mul(vec3_load(scene->cameras[0].forward), -1.0f);
        up = vec3_load(scene->cameras[0].up);
    }
    right = vec3_cross(up, front);
    for (size_t i = 0; i < PELL_COUNT(studios[0]) && studios[studio][i].name; i++) {
        const struct soft_light *s = &studios[studio][i];
        const bool raised = level && s->toward[2] < 0.0f;
        const float away = raised ? RAISED : 1.0f, height = raised ? hypotf(s->toward[0], s->toward[2]) : s->toward[1];
        PELL_TRY(add_soft(scene, s->name, vec3_mad(vec3_mad(vec3_mul(right, s->toward[0]), height, up), s->toward[2], front),
                          away * s->distance, away * s->side, s->irradiance, tints[s->tint]));
    }
    return PELL_OK;

fail:
    return res;
}

/* --- Viewpoint ---------------------------------------------------------------------------------------------------------------- */

static const struct side {
    const char *name;
    double azimuth, elevation; /* degrees */
} sides[] = {
    { "front", 0, 0 }, { "right", 90, 0 }, { "back", 180, 0 }, { "left", -90, 0 }, { "top", 0, 90 }, { "34", 35, 15 },
};

const char *pell_side_name(size_t i)
{
    return i < PELL_COUNT(sides) ? sides[i].name : NULL;
}

const char *pell_studio_name(size_t i)
{
    return i < PELL_COUNT(studio_names) ? studio_names[i] : NULL;
}

static const char *const axes[] = { "y", "z" };
static const char *const normals_from[] = { "file", "smooth", "flat" }; /* enum pell_normals */

const char *pell_axis_name(size_t i)
{
    return i < PELL_COUNT(axes) ? axes[i] : NULL;
}

const char *pell_normals_name(size_t i)
{
    return i < PELL_COUNT(normals_from) ? normals_from[i] : NULL;
}

static void list_names(struct pell_text *hint, const char *const *names, size_t count, const char *more)
{
    pell_text_add(hint, "allowed: ");
    for (size_t i = 0; i < count; i++)
        pell_text_add(hint, "%s%s", i ? ", " : "", names[i]);
    pell_text_add(hint, "%s", more);
}

/* The index of `text`, or an error that lists the names; `more`: further allowed values, "" if none. */
static enum pell_result choose(struct pell_context *ctx, enum pell_result code, const char *where, const char *text,
                               const char *const *names, size_t count, const char *more, int *index)
{
    struct pell_text hint = { .length = 0 };
    char shown[96];

    for (size_t i = 0; i < count; i++)
        if (strcmp(names[i], text) == 0) {
            *index = (int) i;
            return PELL_OK;
        }
    if (pell_text_suggest(&hint, "", text, names, count))
        pell_text_add(&hint, " ");
    list_names(&hint, names, count, more);
    return pell_error(ctx, code, where, hint.str, "there is no \"%s\"", pell_printable(text, shown, sizeof(shown)));
}

enum pell_result pell_side_read(struct pell_context *ctx, enum pell_result code, const char *where, const char *text,
                                struct pell_viewpoint *view)
{
    static const char angles[] = ", or AZIMUTH,ELEVATION in degrees: 35,15";
    const char *names[PELL_COUNT(sides)], *comma = strchr(text, ',');
    struct pell_text hint = { .length = 0 };
    enum pell_result res;
    int index = 0;

    view->has_from = true;
    for (size_t i = 0; i < PELL_COUNT(sides); i++)
        names[i] = sides[i].name;
    if (!comma) {
        PELL_TRY(choose(ctx, code, where, text, names, PELL_COUNT(sides), angles, &index));
        view->azimuth = sides[index].azimuth;
        view->elevation = sides[index].elevation;
    } else if (!pell_parse_number(text, (size_t) (comma - text), &view->azimuth) ||
               !pell_parse_number(comma + 1, strlen(comma + 1), &view->elevation) || !(fabs(view->azimuth) <= 360.0) ||
               !(fabs(view->elevation) <= 90.0)) {
        char shown[96];
        list_names(&hint, names, PELL_COUNT(names), angles);
        return pell_error(ctx, code, where, hint.str, "\"%s\", must be an azimuth in [-360, 360] and an elevation in [-90, 90] degrees",
                          pell_printable(text, shown, sizeof(shown)));
    }
    view->azimuth *= PELL_PI / 180.0;
    view->elevation *= PELL_PI / 180.0;
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_studio_read(struct pell_context *ctx, enum pell_result code, const char *where, const char *text, int *studio)
{
    return choose(ctx, code, where, text, studio_names, PELL_COUNT(studio_names), "", studio);
}

enum pell_result pell_normals_read(struct pell_context *ctx, enum pell_result code, const char *where, const char *text,
                                   enum pell_normals *normals)
{
    int index = PELL_NORMALS_FILE;
    const enum pell_result res = choose(ctx, code, where, text, normals_from, PELL_COUNT(normals_from), "", &index);

    *normals = (enum pell_normals) index;
    return res;
}

enum pell_result pell_viewpoint_read(struct pell_context *ctx, const struct pell_load_params *params, struct pell_viewpoint *view)
{
    enum pell_result res;
    int axis = 0;

    *view = (struct pell_viewpoint) { .has_studio = params->studio != NULL };
    if (params->from && params->camera)
        return pell_error(ctx, PELL_ERR_INVALID, "--from", "give one of them", "--from and --camera both define the camera");
    if (params->up)
        PELL_TRY(choose(ctx, PELL_ERR_INVALID, "--up", params->up, axes, PELL_COUNT(axes), "", &axis));
    view->z_up = axis == 1;
    if (params->from)
        PELL_TRY(pell_side_read(ctx, PELL_ERR_INVALID, "--from", params->from, view));
    if (params->studio)
        PELL_TRY(pell_studio_read(ctx, PELL_ERR_INVALID, "--studio", params->studio, &view->studio));
    return PELL_OK;

fail:
    return res;
}

/* Minimum and maximum of the objects' vertices along an axis. */
static void extent_along(const struct pell_scene *scene, struct pell_vec3 axis, float *least, float *largest)
{
    *least = INFINITY;
    *largest = -INFINITY;
    for (size_t k = 0; k < scene->num_meshes; k++)
        for (uint32_t i = 0; i < scene->meshes[k].num_vertices && !pell_cancelled_at(scene->ctx, i); i++) {
            const float at = vec3_dot(axis, vec3_load(scene->meshes[k].position + 3 * (size_t) i));
            *least = fminf(*least, at);
            *largest = fmaxf(*largest, at);
        }
}

enum pell_result pell_scene_frame_from(struct pell_scene *scene, const struct pell_viewpoint *view, float aspect)
{
    const float fov = FRAME_FOV_DEG * PELL_PI_F / 180.0f, slope = FRAMED * tanf(0.5f * fov);
    const float sa = (float) sin(view->azimuth), ca = (float) cos(view->azimuth);
    const float se = (float) sin(view->elevation), ce = (float) cos(view->elevation);
    const struct pell_vec3 toward = vec3(sa * ce, se, ca * ce), up = vec3(-sa * se, ce, -ca * se), right = vec3(ca, 0, -sa);
    float low[3], high[3], distance = 0.05f * radius_of(scene);
    struct pell_camera *c, swap;
    struct pell_vec3 center;
    size_t index;
    enum pell_result res;

    if (!(aspect > 0.0f) || !isfinite(aspect))
        aspect = DEFAULT_ASPECT;
    PELL_TRY(pell_scene_add_camera(scene, "viewpoint", &index));
    extent_along(scene, right, &low[0], &high[0]);
    extent_along(scene, up, &low[1], &high[1]);
    extent_along(scene, toward, &low[2], &high[2]);
    center = vec3_mul(right, 0.5f * (low[0] + high[0]));
    center = vec3_mad(center, 0.5f * (low[1] + high[1]), up);
    center = vec3_mad(center, 0.5f * (low[2] + high[2]), toward);
    for (size_t k = 0; k < scene->num_meshes; k++)
        for (uint32_t i = 0; i < scene->meshes[k].num_vertices && !pell_cancelled_at(scene->ctx, i); i++) {
            const struct pell_vec3 p = vec3_sub(vec3_load(scene->meshes[k].position + 3 * (size_t) i), center);
            const float wide = fabsf(vec3_dot(p, right)) / (slope * aspect), tall = fabsf(vec3_dot(p, up)) / slope;
            distance = fmaxf(distance, vec3_dot(p, toward) + fmaxf(wide, tall));
        }
    if (pell_cancelled(scene->ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    distance = fmaxf(distance, 0.5f * (high[2] - low[2]) + 0.05f * radius_of(scene)); /* a thin object that points at the camera */
    c = &scene->cameras[index];
    vec3_store(vec3_mad(center, distance, toward), c->position);
    vec3_store(vec3_mul(toward, -1.0f), c->forward);
    vec3_store(up, c->up);
    c->fov = fov;
    swap = scene->cameras[0];
    scene->cameras[0] = *c;
    scene->cameras[index] = swap;
    return PELL_OK;

fail:
    return res;
}

/* --- Ground ------------------------------------------------------------------------------------------------------------------- */

enum { ARC = 48, PROFILE_POINTS = ARC + 3 }; /* points of the profile: floor's front, the arc's ARC + 1, the wall's top */
enum { TABLE_CORNERS = 128 };                /* corners of the round table */

static enum pell_result ground_material(struct pell_scene *scene, int *material)
{
    struct pell_material *m;
    size_t index;
    enum pell_result res;

    if (*material >= 0)
        return PELL_OK;
    PELL_TRY(pell_scene_add_material(scene, "ground", &index));
    m = &scene->materials[index];
    m->opaque = true;
    m->metallic = 0.0f;
    m->rho_s = 0.0f;
    m->base_color[0] = m->base_color[1] = m->base_color[2] = 0.35f;
    m->double_sided = true;
    *material = (int) index;
    return PELL_OK;

fail:
    return res;
}

/* In radii of the object: the floor begins 30 in front of it, the arc of radius 6 begins 7 behind it (behind the studio's lights), the wall
 * ends at 60, and all is 120 wide. */
static enum pell_result add_sweep(struct pell_scene *scene, size_t index)
{
    const float r = radius_of(scene), bend = 6.0f * r, back = 7.0f * r;
    const struct pell_vec3 center = center_of(scene);
    const struct pell_vec3 behind = scene->num_cameras ? level_direction(&scene->cameras[0]) : vec3(0, 0, -1);
    struct pell_vec3 side;
    struct pell_mesh *mesh;
    enum pell_result res;

    side = vec3_cross(behind, vec3(0, 1, 0));
    PELL_TRY(pell_mesh_allocate(scene, index, 2 * PROFILE_POINTS, 2 * (PROFILE_POINTS - 1)));
    mesh = &scene->meshes[index];
    for (int i = 0; i < PROFILE_POINTS; i++) {
        const float angle = i == 0 ? 0.0f : i == PROFILE_POINTS - 1 ? 0.5f * PELL_PI_F : 0.5f * PELL_PI_F * (float) (i - 1) / (float) ARC;
        const float along = i == 0 ? -30.0f * r : back + bend * sinf(angle);
        const float height = i == PROFILE_POINTS - 1 ? 60.0f * r : bend * (1.0f - cosf(angle));
        const struct pell_vec3 n = vec3_add(vec3_mul(behind, -sinf(angle)), vec3(0, cosf(angle), 0));
        for (int k = 0; k < 2; k++) {
            struct pell_vec3 p = vec3_mad(vec3_mad(center, along, behind), (k ? 60.0f : -60.0f) * r, side);
            p.y = scene->bounds_min[1] + height;
            vec3_store(p, mesh->position + 3 * (2 * i + k));
            vec3_store(n, mesh->normal + 3 * (2 * i + k));
        }
    }
    for (uint32_t i = 0; i + 1 < PROFILE_POINTS; i++) {
        const uint32_t quad[6] = { 2 * i, 2 * i + 1, 2 * i + 3, 2 * i, 2 * i + 3, 2 * i + 2 };
        memcpy(mesh->index + 6 * (size_t) i, quad, sizeof(quad));
    }
    return PELL_OK;

fail:
    return res;
}

/* In radii of the object: a round table of radius 3. A backdrop would hide the background and block the environment's light. */
static enum pell_result add_table(struct pell_scene *scene, size_t index)
{
    const float r = 3.0f * radius_of(scene);
    struct pell_vec3 center = center_of(scene);
    struct pell_mesh *mesh;
    enum pell_result res;

    center.y = scene->bounds_min[1];
    PELL_TRY(pell_mesh_allocate(scene, index, TABLE_CORNERS + 1, TABLE_CORNERS));
    mesh = &scene->meshes[index];
    for (uint32_t i = 0; i <= TABLE_CORNERS; i++) {
        const float angle = 2.0f * PELL_PI_F * (float) i / (float) TABLE_CORNERS, out = i < TABLE_CORNERS ? r : 0.0f;
        vec3_store(vec3_mad(center, out, vec3(cosf(angle), 0, -sinf(angle))), mesh->position + 3 * i);
        vec3_store(vec3(0, 1, 0), mesh->normal + 3 * i);
    }
    for (uint32_t i = 0; i < TABLE_CORNERS; i++) {
        const uint32_t sector[3] = { TABLE_CORNERS, i, (i + 1) % TABLE_CORNERS };
        memcpy(mesh->index + 3 * (size_t) i, sector, sizeof(sector));
    }
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_scene_ground(struct pell_scene *scene, int material)
{
    size_t index;
    int object = 0;
    enum pell_result res;

    PELL_TRY(ground_material(scene, &material));
    for (size_t i = 0; i < scene->num_meshes; i++)
        object = scene->meshes[i].object >= object ? scene->meshes[i].object + 1 : object;
    PELL_TRY(pell_scene_add_mesh(scene, "ground", &index));
    PELL_TRY(pell_scene_has_environment(scene) ? add_table(scene, index) : add_sweep(scene, index));
    scene->ground_mesh = (int) index;
    scene->meshes[index].material = material;
    scene->meshes[index].object = object;
    return PELL_OK;

fail:
    return res;
}
