/* SPDX-License-Identifier: MIT
 * fuzz_scene.h - shared by the targets of this folder: loading of bytes with small limits and no files, and the properties of an
 * accepted scene. */
#ifndef PELL_FUZZ_SCENE_H
#define PELL_FUZZ_SCENE_H

#include "scene/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool holds)
{
    if (!holds)
        abort();
}

static void count_errors(void *user, const struct pell_message *message)
{
    if (message->level == PELL_LOG_ERROR) {
        require(message->what[0]);
        ++*(int *) user;
    }
}

static inline void check_scene(const struct pell_scene *s)
{
    struct pell_scene_report report;

    require(s->num_meshes > 0 && s->num_materials > 0 && s->num_lights + s->num_cameras > 0);
    for (size_t i = 0; i < s->num_meshes; i++) {
        const struct pell_mesh *m = &s->meshes[i];
        require(m->material >= 0 && (size_t) m->material < s->num_materials);
        for (size_t k = 0; k < 3 * (size_t) m->num_triangles; k++)
            require(m->index[k] < m->num_vertices);
        for (size_t k = 0; k < 3 * (size_t) m->num_vertices; k++)
            require(isfinite(m->position[k]) && isfinite(m->normal[k]));
        for (size_t k = 0; k < m->num_vertices; k++) {
            const struct pell_vec3 n = vec3_load(m->normal + 3 * k);
            require(fabsf(vec3_dot(n, n) - 1.0f) < 1e-3f);
        }
    }
    require(pell_scene_check(s, &report) == PELL_OK);
    pell_scene_report_finish(s->ctx, &report);
}

static inline enum pell_result read_nothing(void *user, struct pell_context *ctx, const char *path, uint8_t **data, size_t *size)
{
    (void) user;
    *data = NULL;
    *size = 0;
    return pell_error(ctx, PELL_ERR_IO, path, NULL, "there are no files here");
}

typedef enum pell_result (*read_fn)(void *user, struct pell_context *ctx, const char *path, uint8_t **data, size_t *size);

/* Loads the bytes as the file `name`, and passes an accepted scene to `use`; other files come from `read` (NULL: there are none). */
static inline void load_for(const char *name, const uint8_t *data, size_t size, read_fn read, const struct pell_load_params *params,
                            void (*use)(const struct pell_scene *scene))
{
    struct pell_limits limits;
    int errors = 0;
    struct pell_context_params context = { .log = count_errors, .log_user = &errors, .limits = &limits };
    struct pell_loader loader = { .params = params, .root = "/nowhere", .read = read ? read : read_nothing };
    struct pell_context *ctx = NULL;
    struct pell_scene *scene;
    uint8_t *copy = malloc(size + 1); /* exact, so that the sanitizer detects a read beyond */

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.memory_bytes = 256 << 20;
    limits.vertices = limits.triangles = 100000;
    limits.nodes = limits.items = 2000;
    require(copy && pell_context_create(&context, &ctx) == PELL_OK);
    memcpy(copy, data, size);
    copy[size] = 0;
    loader.ctx = ctx;
    if (pell_scene_load_bytes(&loader, name, copy, size, &scene) == PELL_OK) {
        require(errors == 0);
        use(scene);
        pell_scene_destroy(&scene);
    } else {
        require(errors == 1 && !scene);
    }
    require(pell_memory_used(ctx) == 0);
    pell_context_destroy(&ctx);
    free(copy);
}

static inline void load(const char *name, const uint8_t *data, size_t size, read_fn read, const struct pell_load_params *params)
{
    load_for(name, data, size, read, params, check_scene);
}

#endif
