/* SPDX-License-Identifier: MIT
 * image_test.h - shared by the image tests: files in memory, images to write, the folder for temporary files. */
#ifndef PELL_IMAGE_TEST_H
#define PELL_IMAGE_TEST_H

#include "pell_test.h"

#include "base/file.h"
#include "image/color.h"

#include <pellucid/image.h>

#include <dirent.h>

#define VARIANTS "tests/assets/image_variants/"

/* Creates a context with counted memory and recorded messages; image_test_end checks that nothing leaked. */
struct image_test {
    struct pell_alloc_fault fault;
    struct kept_messages kept;
    struct pell_context *ctx;
};

static inline void image_test_begin(struct image_test *t)
{
    memset(t, 0, sizeof(*t));
    t->ctx = test_context(&t->fault, &t->kept);
    REQUIRE(t->ctx);
}

/* The same for a test that needs a folder of ../shared: skips before anything is allocated that could leak. */
static inline void image_test_begin_shared(struct image_test *t, const char *folder)
{
    shared_file(folder);
    image_test_begin(t);
}

static inline void image_test_end(struct image_test *t)
{
    pell_context_destroy(&t->ctx);
    assert_int_equal(t->fault.live, 0);
}

static inline struct pell_image read_image(struct image_test *t, const char *path, enum pell_image_role role)
{
    struct pell_image image;
    if (pell_image_read(t->ctx, path, role, &image) != PELL_OK)
        fail_msg("%s: %s", t->kept.where, t->kept.what);
    return image;
}

static inline struct pell_image read_variant(struct image_test *t, const char *name, enum pell_image_role role)
{
    char path[256];
    snprintf(path, sizeof(path), VARIANTS "%s", name);
    return read_image(t, project_file(path), role);
}

/* A new path in the folder for temporary files; the static buffer depends on the file name's ending. */
static inline const char *temp_path(const char *name)
{
    static char buffers[8][512];
    static int next;
    char *path = buffers[next++ % 8];
    const char *folder = getenv("TMPDIR");
    snprintf(path, sizeof(buffers[0]), "%s/pell-image-%ld-%s", folder ? folder : "/tmp", (long) getpid(), name);
    return path;
}

/* Three or four planes of an image with dark and bright values: value = f(x, y, c). */
struct planes {
    int width, height;
    float *data[4];
    struct pell_channel channels[4];
    struct pell_write_params params;
};

static inline float pattern(int x, int y, int c)
{
    const uint32_t h = (uint32_t) x * 73856093u ^ (uint32_t) y * 19349663u ^ (uint32_t) c * 83492791u;
    const float noise = (float) ((h * 2654435761u) >> 8) / 16777216.0f;
    return noise * noise * (float) (1 + (x + y + c) % 5) * 0.2f;
}

static inline void planes_make(struct planes *p, int width, int height, float (*value)(int x, int y, int c))
{
    static const char *const names[4] = { "R", "G", "B", "A" };
    memset(p, 0, sizeof(*p));
    p->width = width;
    p->height = height;
    for (int c = 0; c < 4; c++) {
        p->data[c] = malloc((size_t) width * (size_t) height * sizeof(float));
        REQUIRE(p->data[c]);
        for (int y = 0; y < height; y++)
            for (int x = 0; x < width; x++)
                p->data[c][y * width + x] = value(x, y, c);
        p->channels[c] = (struct pell_channel) { .name = names[c], .data = p->data[c], .stride = width };
    }
    p->params = (struct pell_write_params) { .width = width, .height = height, .channels = p->channels, .num_channels = 3 };
}

static inline void planes_free(struct planes *p)
{
    for (int c = 0; c < 4; c++)
        free(p->data[c]);
}

/* A file's content as bytes; released by free(). */
static inline uint8_t *file_bytes(const char *path, size_t *size)
{
    FILE *f = fopen(path, "rb");
    uint8_t *data;
    long end;
    REQUIRE(f);
    fseek(f, 0, SEEK_END);
    end = ftell(f);
    rewind(f);
    data = malloc((size_t) end + 1);
    REQUIRE(data && fread(data, 1, (size_t) end, f) == (size_t) end);
    fclose(f);
    *size = (size_t) end;
    return data;
}

/* --- Every variant --------------------------------------------------------------------------------------------------------------- */

static inline int by_text(const void *a, const void *b)
{
    return strcmp(*(char *const *) a, *(char *const *) b);
}

static inline void for_each_variant(void (*run)(const char *name, const uint8_t *data, size_t size))
{
    static const char *const folders[] = { VARIANTS "exr", VARIANTS "hdr", VARIANTS "jpeg", VARIANTS "png" };

    for (size_t f = 0; f < PELL_COUNT(folders); f++) {
        char *names[64];
        size_t count = 0;
        const char *folder = project_file(folders[f]);
        DIR *dir = opendir(folder);
        REQUIRE(dir);
        for (const struct dirent *e; (e = readdir(dir)) && count < 64;)
            if (e->d_name[0] != '.')
                REQUIRE(names[count++] = strdup(e->d_name));
        closedir(dir);
        REQUIRE(count > 0);
        qsort(names, count, sizeof(*names), by_text);
        for (size_t i = 0; i < count; i++) {
            char path[1200];
            size_t size;
            uint8_t *data;
            snprintf(path, sizeof(path), "%s/%s", folder, names[i]);
            data = file_bytes(path, &size);
            run(names[i], data, size);
            free(data);
            free(names[i]);
        }
    }
}

#endif
