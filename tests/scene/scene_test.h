/* SPDX-License-Identifier: MIT
 * scene_test.h - shared by the tests of src/scene: scenes loaded from texts in memory, and small shapes. */
#ifndef PELL_SCENE_TEST_H
#define PELL_SCENE_TEST_H

#include "pell_test.h"
#include "scene/scene.h"

/* Files that exist in memory only; the list ends with a NULL name. */
struct memory_file {
    const char *name, *text;
};

static inline enum pell_result read_memory(void *user, struct pell_context *ctx, const char *path, uint8_t **data, size_t *size)
{
    for (const struct memory_file *f = user; f && f->name; f++) {
        if (strcmp(f->name, path) != 0)
            continue;
        *size = strlen(f->text);
        *data = (uint8_t *) pell_strdup(ctx, f->text);
        return *data ? PELL_OK : PELL_ERR_NOMEM;
    }
    return pell_error(ctx, PELL_ERR_IO, path, NULL, "there is no such file");
}

/* Loads bytes under a name; other files come from `files`, or do not exist. */
static inline enum pell_result load_bytes(struct pell_context *ctx, const char *name, const void *data, size_t size,
                                          const struct pell_load_params *params, const struct memory_file *files, struct pell_scene **scene)
{
    static const struct pell_load_params none;
    const struct pell_loader loader = { ctx, params ? params : &none, "/nowhere", read_memory, (void *) files };
    uint8_t *copy = malloc(size + 1); /* exact: the sanitizer detects a read beyond */
    enum pell_result res;

    if (!copy)
        fail_msg("no memory for a test");
    memcpy(copy, data, size);
    copy[size] = 0;
    res = pell_scene_load_bytes(&loader, name, copy, size, scene);
    free(copy);
    return res;
}

static inline enum pell_result load_text(struct pell_context *ctx, const char *name, const char *text,
                                         const struct pell_load_params *params, struct pell_scene **scene)
{
    return load_bytes(ctx, name, text, strlen(text), params, NULL, scene);
}

static const struct pell_load_params in_mm = { .mm_per_unit = 1.0 };
static const struct pell_load_params bare_mm = { .mm_per_unit = 1.0, .bare = true };

#define CUBE_VERTICES "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
#define CUBE_FACES "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"
#define CUBE CUBE_VERTICES CUBE_FACES
#define CUBE_INSIDE_OUT CUBE_VERTICES "f 2 3 4 1\nf 8 7 6 5\nf 5 6 2 1\nf 6 7 3 2\nf 7 8 4 3\nf 8 5 1 4\n"

static inline double mesh_area(const struct pell_mesh *m)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < m->num_triangles; i++) {
        const float *a = m->position + 3 * m->index[3 * i], *b = m->position + 3 * m->index[3 * i + 1],
                    *c = m->position + 3 * m->index[3 * i + 2];
        double n[3], e[3], f[3];
        for (int k = 0; k < 3; k++) {
            e[k] = (double) b[k] - a[k];
            f[k] = (double) c[k] - a[k];
        }
        for (int k = 0; k < 3; k++)
            n[k] = e[(k + 1) % 3] * f[(k + 2) % 3] - e[(k + 2) % 3] * f[(k + 1) % 3];
        sum += 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    }
    return sum;
}

/* A sphere about the origin as OBJ text, with poles; `split` writes separate vertices for each triangle. free() it. */
static inline char *sphere_obj(int rings, double radius, bool split, bool inward)
{
    const int around = 2 * rings;
    char *text = malloc((size_t) rings * (size_t) around * 400 + 4096), *at = text;
    int count = 0;

    if (!text)
        fail_msg("no memory for a test");
#define POINT(i, j)                                                                                                                        \
    radius *sin(PELL_PI *(i) / rings) * cos(2 * PELL_PI * ((j) % around) / around), radius *cos(PELL_PI *(i) / rings),                     \
        -radius *sin(PELL_PI *(i) / rings) * sin(2 * PELL_PI * ((j) % around) / around)
    for (int i = 0; i < rings; i++)
        for (int j = 0; j < around; j++) {
            const int quad[4][2] = { { i, j }, { i + 1, j }, { i + 1, j + 1 }, { i, j + 1 } };
            const int triangles[2][3] = { { 0, 1, 2 }, { 0, 2, 3 } };
            for (int t = 0; t < 2; t++) {
                if ((t == 0 && i + 1 == rings) || (t == 1 && i == 0))
                    continue;
                for (int k = 0; k < 3; k++) {
                    const int *c = quad[triangles[t][inward ? 2 - k : k]];
                    const bool pole = c[0] == 0 || c[0] == rings;
                    at += sprintf(at, "v %.9g %.9g %.9g\n", POINT(c[0], pole ? 0 : c[1]));
                }
                count += 3;
                at += split ? sprintf(at, "f %d %d %d\n", count - 2, count - 1, count) : sprintf(at, "f -3 -2 -1\n");
            }
        }
#undef POINT
    return text;
}

#endif
