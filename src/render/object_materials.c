/* SPDX-License-Identifier: MIT
 * object_materials.c - see object_materials.h. */
#include "render/object_materials.h"

#include <stdlib.h>
#include <string.h>

/* A mesh with its object and its material, from 1, in the frame, for sorting. */
struct mesh_key {
    uint16_t material;
    int object;
    uint32_t mesh;
};

static int compare(const void *a, const void *b)
{
    const struct mesh_key *p = a, *q = b;

    if (p->material != q->material)
        return p->material < q->material ? -1 : 1;
    if (p->object != q->object)
        return p->object < q->object ? -1 : 1;
    return p->mesh < q->mesh ? -1 : p->mesh > q->mesh;
}

/* Whether entry i is the first of an object whose material an earlier object has, too. */
static bool is_further(const struct mesh_key *keys, size_t i)
{
    return i > 0 && keys[i].material == keys[i - 1].material && keys[i].object != keys[i - 1].object;
}

/* Lists the meshes of translucent materials in order; returns how many. */
static size_t list_keys(const struct pell_scene *scene, const struct pell_scene_materials *m, struct mesh_key *keys)
{
    size_t n = 0;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        if (mesh->material >= 0 && (size_t) mesh->material < scene->num_materials && m->frame_index[mesh->material + 1])
            keys[n++] = (struct mesh_key) { m->frame_index[mesh->material + 1], pell_mesh_assembly(mesh), (uint32_t) i };
    }
    qsort(keys, n, sizeof(*keys), compare);
    return n;
}

enum pell_result pell_object_materials_make(struct pell_context *ctx, const struct pell_scene *scene, struct pell_scene_materials *m)
{
    struct mesh_key *keys = pell_alloc_array(ctx, scene->num_meshes + 1, sizeof(*keys));
    struct pell_frame_material *frame;
    size_t n, further = 0, room;
    uint16_t id = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    m->count_with_copies = m->count;
    if (!keys)
        goto fail;
    n = list_keys(scene, m, keys);
    for (size_t i = 0; i < n; i++)
        further += is_further(keys, i);
    res = PELL_OK;
    if (further == 0)
        goto fail;
    room = PELL_FRAME_MATERIALS - m->count;
    if (further > room) {
        pell_warn(ctx, scene->path, "give neighbours materials of their own",
                  "%zu pairs of an object and its material, screen-space methods distinguish %d: the other objects may exchange light",
                  m->count + further, PELL_FRAME_MATERIALS);
        further = room;
    }
    res = PELL_ERR_NOMEM;
    frame = pell_realloc_array(ctx, m->frame, m->count + further + 1, sizeof(*m->frame));
    if (!frame)
        goto fail;
    m->frame = frame;
    m->of_mesh = pell_calloc(ctx, scene->num_meshes, sizeof(*m->of_mesh));
    if (!m->of_mesh)
        goto fail;
    for (size_t i = 0; i < n; i++) {
        const uint16_t own = keys[i].material;
        if (i == 0 || keys[i].material != keys[i - 1].material || is_further(keys, i))
            id = own;
        if (is_further(keys, i) && m->count_with_copies < m->count + further) {
            m->frame[m->count_with_copies] = m->frame[own - 1];
            id = (uint16_t) ++m->count_with_copies;
        }
        m->of_mesh[keys[i].mesh] = id;
    }
    res = PELL_OK;

fail:
    pell_free(ctx, keys);
    return res;
}
