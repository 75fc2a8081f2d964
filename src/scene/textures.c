/* SPDX-License-Identifier: MIT
 *
 * textures.c - textures of a scene that is being read: each image is read once, found by its name and role.
 */
#include "scene/scene.h"

#include "base/file.h"

#include <string.h>

/* Names can be chosen so that they collide: a texture that finds no slot near its own is not found again, which only costs time. */
#define PROBES 64

/* FNV-1a, never 0. */
static uint64_t hash_bytes(uint64_t hash, const void *data, size_t size)
{
    const unsigned char *p = data;

    for (size_t i = 0; i < size; i++)
        hash = (hash ^ p[i]) * 0x100000001b3ull;
    return hash ? hash : 1;
}

static uint64_t texture_key(const char *name, int role)
{
    return hash_bytes(hash_bytes(0xcbf29ce484222325ull, name, strlen(name)), &role, sizeof(role));
}

static struct pell_texture *find_texture(const struct pell_scene *scene, uint64_t key, const char *name)
{
    const size_t mask = scene->num_texture_slots - 1;

    if (!scene->num_texture_slots)
        return NULL;
    for (size_t n = 0, i = (size_t) key & mask; n < PROBES && scene->texture_slots[i]; n++, i = (i + 1) & mask) {
        struct pell_texture *t = scene->textures[scene->texture_slots[i] - 1];
        if (t->key == key && strcmp(t->name, name) == 0)
            return t;
    }
    return NULL;
}

static void enter_texture(struct pell_scene *scene, size_t index)
{
    const size_t mask = scene->num_texture_slots - 1;
    size_t n = 0, i = (size_t) scene->textures[index]->key & mask;

    for (; n < PROBES && scene->texture_slots[i]; n++)
        i = (i + 1) & mask;
    if (n < PROBES)
        scene->texture_slots[i] = (uint32_t) index + 1;
}

/* Enters all textures that have a key into a table at most half full. */
static enum pell_result rebuild_slots(struct pell_scene *scene, size_t room)
{
    size_t wanted = 16;
    uint32_t *slots;

    while (wanted < 2 * room)
        wanted *= 2;
    slots = pell_calloc(scene->ctx, wanted, sizeof(*slots));
    if (!slots)
        return PELL_ERR_NOMEM;
    pell_free(scene->ctx, scene->texture_slots);
    scene->texture_slots = slots;
    scene->num_texture_slots = wanted;
    for (size_t i = 0; i < scene->num_textures; i++)
        if (scene->textures[i]->key)
            enter_texture(scene, i);
    return PELL_OK;
}

/* Adds a texture that later calls find by (name, key). */
static enum pell_result add_keyed(struct pell_scene *scene, const char *name, uint64_t key, struct pell_texture **out)
{
    enum pell_result res;

    if (2 * (scene->num_textures + 1) > scene->num_texture_slots)
        PELL_TRY(rebuild_slots(scene, 2 * (scene->num_textures + 1)));
    PELL_TRY(pell_scene_add_texture(scene, name, out));
    (*out)->key = key;
    enter_texture(scene, scene->num_textures - 1);
    return PELL_OK;

fail:
    return res;
}

static bool fatal(enum pell_result res)
{
    return res == PELL_ERR_NOMEM || res == PELL_ERR_CANCELLED;
}

static void left_out(struct pell_import *import, const char *where, const char *reference)
{
    char shown[160];

    if (import->needed)
        return;
    pell_warn(import->ctx, where, NULL, "the image \"%s\" can't be used and is left out", pell_printable(reference, shown, sizeof(shown)));
}

/* Images that can't be read stay in the scene without pixels, so that each is tried once; pell_scene_drop_textures removes them. */
enum pell_result pell_import_texture(struct pell_import *import, const char *where, const char *reference, enum pell_image_role role,
                                     struct pell_texture **texture)
{
    struct pell_texture *t = NULL;
    char *path = NULL;
    enum pell_result res;
    uint64_t key;

    *texture = NULL;
    if (pell_cancelled(import->ctx))
        return PELL_ERR_CANCELLED;
    pell_log_downgrade(import->ctx, 1);
    res = pell_path_resolve(import->ctx, where, import->root, reference, import->allow_outside, &path);
    pell_log_downgrade(import->ctx, -1);
    if (res != PELL_OK) {
        if (!fatal(res))
            left_out(import, where, reference);
        return fatal(res) ? res : PELL_OK;
    }
    key = texture_key(path, (int) role);
    t = find_texture(import->scene, key, path);
    if (!t) {
        PELL_TRY(add_keyed(import->scene, path, key, &t));
        pell_log_downgrade(import->ctx, 1);
        res = pell_image_read(import->ctx, path, role, &t->image);
        pell_log_downgrade(import->ctx, -1);
        if (fatal(res))
            goto fail;
        if (res != PELL_OK) {
            memset(&t->image, 0, sizeof(t->image));
            left_out(import, where, reference);
        }
    }
    *texture = t->image.pixels ? t : NULL;
    res = PELL_OK;

fail:
    pell_free(import->ctx, path);
    return res;
}

enum pell_result pell_import_texture_bytes(struct pell_import *import, const char *where, const char *name, const void *data, size_t size,
                                           enum pell_image_role role, struct pell_texture **texture)
{
    const uint64_t key = hash_bytes(texture_key(name, (int) role), data, size);
    struct pell_texture *t = find_texture(import->scene, key, name);
    enum pell_result res;

    *texture = NULL;
    if (pell_cancelled(import->ctx))
        return PELL_ERR_CANCELLED;
    if (!t) {
        PELL_TRY(add_keyed(import->scene, name, key, &t));
        pell_log_downgrade(import->ctx, 1);
        res = pell_image_decode(import->ctx, name, data, size, role, &t->image);
        pell_log_downgrade(import->ctx, -1);
        if (fatal(res))
            goto fail;
        if (res != PELL_OK) {
            memset(&t->image, 0, sizeof(t->image));
            left_out(import, where, name);
        }
    }
    *texture = t->image.pixels ? t : NULL;
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_texture_sampler(struct pell_scene *scene, struct pell_texture *texture, enum pell_wrap wrap_u, enum pell_wrap wrap_v,
                                      bool nearest, struct pell_texture **out)
{
    const int sampler[3] = { (int) wrap_u, (int) wrap_v, nearest };
    struct pell_texture *t = texture;
    enum pell_result res;

    *out = NULL;
    if (texture->sampled && (texture->wrap_u != wrap_u || texture->wrap_v != wrap_v || texture->nearest != nearest)) {
        const uint64_t key = hash_bytes(texture->key, sampler, sizeof(sampler));
        t = find_texture(scene, key, texture->name);
        if (!t) {
            PELL_TRY(add_keyed(scene, texture->name, key, &t));
            t->image = texture->image;
            t->shared = true;
        }
    }
    t->wrap_u = wrap_u;
    t->wrap_v = wrap_v;
    t->nearest = nearest;
    t->sampled = true;
    *out = t;
    return PELL_OK;

fail:
    return res;
}

void pell_scene_drop_textures(struct pell_scene *scene)
{
    size_t kept = 0;

    pell_free(scene->ctx, scene->texture_slots);
    scene->texture_slots = NULL;
    scene->num_texture_slots = 0;
    for (size_t i = 0; i < scene->num_textures; i++) {
        if (scene->textures[i]->image.pixels)
            scene->textures[kept++] = scene->textures[i];
        else
            pell_texture_destroy(scene->ctx, scene->textures[i]);
    }
    scene->num_textures = kept;
}
