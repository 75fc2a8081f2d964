/* SPDX-License-Identifier: MIT
 * test_cache.c - the file of compiled shaders: written, read back, and rejected where it is damaged. Skipped, by name, where there is no
 * driver or no validation layer. */
#include "gpu_test.h"

#include "base/file.h"

#include <dirent.h>
#include <sys/stat.h>
#include <unistd.h>

extern const struct pell_shader pell_test_scale_shader;

static char folder[64], path[400];

/* The only file in the folder; false: none. */
static bool find_file(void)
{
    DIR *d = opendir(folder);
    int count = 0;

    for (struct dirent *e = d ? readdir(d) : NULL; e; e = readdir(d))
        if (e->d_name[0] != '.') {
            snprintf(path, sizeof(path), "%s/%s", folder, e->d_name);
            count++;
        }
    if (d)
        closedir(d);
    REQUIRE(count <= 1);
    return count == 1;
}

/* Opens with the folder, makes a pipeline, closes. */
static void run(const char *where, uint64_t fail_at, enum pell_result expected, int warnings)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    const struct pell_gpu_params params = { .cache = where, .fail_at = fail_at, .validate = fail_at == 0 };
    struct pell_gpu_buffer *b[2] = { NULL };
    struct pell_gpu_pass *pass = NULL;
    struct pell_gpu *gpu;
    uint32_t one = 0x3f800000;
    enum pell_result res = pell_gpu_open(ctx, &params, &gpu);

    for (int i = 0; i < 2 && res == PELL_OK; i++)
        res = pell_gpu_buffer_create(gpu, PELL_GPU_ON_DEVICE, 64, "test", &b[i]);
    if (res == PELL_OK)
        res = pell_gpu_pass_create(gpu, &pell_test_scale_shader, &one, 1, b, &pass);
    pell_gpu_pass_destroy(&pass);
    pell_gpu_buffer_destroy(&b[0]);
    pell_gpu_buffer_destroy(&b[1]);
    pell_gpu_close(&gpu);
    if (res != expected || kept.errors != (expected != PELL_OK) || kept.warnings != warnings)
        fail_msg("result %d, %d errors, %d warnings, the last: %s: %s", (int) res, kept.errors, kept.warnings, kept.where, kept.what);
    REQUIRE(pell_memory_used(ctx) < 1024); /* the context knows which files were read */
    pell_context_destroy(&ctx);
}

static uint8_t *read_cache(size_t *size)
{
    FILE *file = fopen(path, "rb");
    uint8_t *data = malloc(1 << 20);

    assert_non_null(file);
    *size = fread(data, 1, 1 << 20, file);
    fclose(file);
    REQUIRE(*size >= 56 + 32 && *size < 1 << 20);
    return data;
}

static void write_bytes(const uint8_t *data, size_t size)
{
    FILE *file = fopen(path, "wb");

    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    fclose(file);
}

static void what_is_compiled_is_kept(void **state)
{
    struct stat first, second;
    (void) state;

    skip_without_gpu();
    run(NULL, 0, PELL_OK, 0);
    assert_false(find_file());
    run(folder, 0, PELL_OK, 0);
    assert_true(find_file());
    assert_int_equal(stat(path, &first), 0);
    run(folder, 0, PELL_OK, 0);
    assert_true(find_file());
    assert_int_equal(stat(path, &second), 0);
    REQUIRE(first.st_ino == second.st_ino); /* nothing new: not written again */
}

/* Truncated at any byte, or with any byte of the header and some of the rest changed, it causes a warning, is created again, and is then
 * read without a message. */
static void damage_is_found(void **state)
{
    uint8_t *data;
    size_t size;
    (void) state;

    skip_without_gpu();
    run(folder, 0, PELL_OK, 0);
    assert_true(find_file());
    data = read_cache(&size);
    for (size_t cut = 0; cut < size; cut += cut < 60 ? 29 : size / 3 + 1) {
        write_bytes(data, cut);
        run(folder, 0, PELL_OK, 1);
        run(folder, 0, PELL_OK, 0);
    }
    for (size_t at = 0; at < size; at += at < 56 ? 5 : size / 4 + 1) {
        data[at] ^= 0x40;
        write_bytes(data, size);
        run(folder, 0, PELL_OK, 1);
        data[at] ^= 0x40;
    }
    write_bytes(data, size);
    run(folder, 0, PELL_OK, 0);
    free(data);
}

static void what_cannot_be_written_is_not(void **state)
{
    char nowhere[80];
    (void) state;

    skip_without_gpu();
    snprintf(nowhere, sizeof(nowhere), "%s/no/such/place", folder);
    run(nowhere, 0, PELL_OK, 0);
    run("/dev/null", 0, PELL_OK, 0);
    run("", 0, PELL_OK, 0);
    assert_true(find_file());
    assert_int_equal(unlink(path), 0);
    assert_int_equal(mkdir(path, 0700), 0); /* the path of the file */
    run(folder, 0, PELL_OK, 0);
    assert_int_equal(rmdir(path), 0);
}

static void calls_that_fail_are_reported(void **state)
{
    uint64_t calls;
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = gpu_context(NULL, &kept);
    struct pell_gpu *gpu;
    (void) state;

    assert_int_equal(pell_gpu_open(ctx, &(struct pell_gpu_params) { .cache = folder }, &gpu), PELL_OK);
    calls = pell_gpu_fail_at(gpu, 0);
    pell_gpu_close(&gpu);
    pell_context_destroy(&ctx);
    for (uint64_t n = 1; n <= calls; n++)
        run(folder, n, PELL_ERR_NOMEM, 0);
    run(folder, 0, PELL_OK, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_compiled_is_kept),
        cmocka_unit_test(damage_is_found),
        cmocka_unit_test(what_cannot_be_written_is_not),
        cmocka_unit_test(calls_that_fail_are_reported),
    };
    int failed;

    snprintf(folder, sizeof(folder), "/tmp/pell-cache-XXXXXX");
    if (!mkdtemp(folder))
        return 1;
    failed = cmocka_run_group_tests(tests, NULL, NULL);
    if (find_file())
        unlink(path);
    rmdir(folder);
    return failed;
}
