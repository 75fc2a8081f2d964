/* SPDX-License-Identifier: MIT
 * studio.c - what a scene gets that says nothing of its own: a camera that frames it, three soft lights, a floor with a sweep. */
#include "scene/scene.h"

#include <string.h>

#define FRAMED 0.8f /* share of the picture that the bounds fill */
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
    /* The box is seen straight on: its front face is what fills the picture. */
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

/* Irradiance of a facing point on the axis of a square of unit radiance: half side over distance = x (four times the corner formula of
 * a parallel rectangle, e.g. Howell's catalogue of configuration factors, A-3). */
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
    pell_scene_square(l->direction, l->up);
    l->width = l->height = side * r;
    for (int c = 0; c < 3; c++)
        l->power[c] = radiance * tint[c];
    return PELL_OK;

fail:
    return res;
}

/* Distances and sides are in radii of the object, so that the irradiance at its centre is the same for any size. */
enum pell_result pell_scene_studio(struct pell_scene *scene)
{
    static const float warm[3] = { 1.0f, 0.97f, 0.92f }, cool[3] = { 0.92f, 0.96f, 1.0f }, white[3] = { 1, 1, 1 };
    struct pell_vec3 front = vec3(0, 0, 1), up = vec3(0, 1, 0), right;
    enum pell_result res;

    if (scene->num_cameras) {
        front = vec3_mul(vec3_load(scene->cameras[0].forward), -1.0f);
        up = vec3_load(scene->cameras[0].up);
    }
    right = vec3_cross(up, front);
#define TOWARD(x, y, z) vec3_mad(vec3_mad(vec3_mul(right, x), y, up), z, front)
    PELL_TRY(add_soft(scene, "studio key", TOWARD(-0.75f, 0.7f, 0.8f), 4.0f, 2.4f, 0.85f * PELL_PI_F, warm));
    PELL_TRY(add_soft(scene, "studio fill", TOWARD(0.9f, 0.12f, 0.6f), 4.5f, 3.2f, 0.22f * PELL_PI_F, cool));
    PELL_TRY(add_soft(scene, "studio rim", TOWARD(0.55f, 0.6f, -0.9f), 4.0f, 2.0f, 1.1f * PELL_PI_F, white));
#undef TOWARD
    return PELL_OK;

fail:
    return res;
}

/* --- Ground ------------------------------------------------------------------------------------------------------------------- */

enum { ARC = 48, RUNG = ARC + 3 }; /* points of the profile: floor's front, the arc's ARC + 1, the wall's top */

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

/* In radii: the floor begins 30 in front of the object, the arc of radius 6 begins 7 behind it (behind the studio's lights), the wall ends
 * at 60, and all is 120 wide. */
enum pell_result pell_scene_ground(struct pell_scene *scene, int material)
{
    const float r = radius_of(scene), bend = 6.0f * r, back = 7.0f * r;
    const struct pell_vec3 center = center_of(scene);
    struct pell_vec3 behind = vec3(0, 0, -1), side;
    struct pell_mesh *mesh;
    size_t index;
    int object = 0;
    enum pell_result res;

    if (scene->num_cameras) {
        const struct pell_vec3 f = vec3_load(scene->cameras[0].forward), level = vec3(f.x, 0, f.z);
        if (vec3_length(level) > 1e-3f)
            behind = vec3_normalize(level);
    }
    side = vec3_cross(behind, vec3(0, 1, 0));
    PELL_TRY(ground_material(scene, &material));
    for (size_t i = 0; i < scene->num_meshes; i++)
        object = scene->meshes[i].object >= object ? scene->meshes[i].object + 1 : object;
    PELL_TRY(pell_scene_add_mesh(scene, "ground", &index));
    PELL_TRY(pell_mesh_allocate(scene, index, 2 * RUNG, 2 * (RUNG - 1)));
    scene->ground_mesh = (int) index;
    mesh = &scene->meshes[index];
    mesh->material = material;
    mesh->object = object;
    for (int i = 0; i < RUNG; i++) {
        const float angle = i == 0 ? 0.0f : i == RUNG - 1 ? 0.5f * PELL_PI_F : 0.5f * PELL_PI_F * (float) (i - 1) / (float) ARC;
        const float along = i == 0 ? -30.0f * r : back + bend * sinf(angle);
        const float height = i == RUNG - 1 ? 60.0f * r : bend * (1.0f - cosf(angle));
        const struct pell_vec3 n = vec3_add(vec3_mul(behind, -sinf(angle)), vec3(0, cosf(angle), 0));
        for (int k = 0; k < 2; k++) {
            struct pell_vec3 p = vec3_mad(vec3_mad(center, along, behind), (k ? 60.0f : -60.0f) * r, side);
            p.y = scene->bounds_min[1] + height;
            vec3_store(p, mesh->position + 3 * (2 * i + k));
            vec3_store(n, mesh->normal + 3 * (2 * i + k));
        }
    }
    for (uint32_t i = 0; i + 1 < RUNG; i++) {
        const uint32_t quad[6] = { 2 * i, 2 * i + 1, 2 * i + 3, 2 * i, 2 * i + 3, 2 * i + 2 };
        memcpy(mesh->index + 6 * (size_t) i, quad, sizeof(quad));
    }
    return PELL_OK;

fail:
    return res;
}
