/* SPDX-License-Identifier: MIT
 * test_file.c - reading and writing whole files, and references that try to leave their folder. */
#define _XOPEN_SOURCE 700
#include "pell_test.h"

#include "base/file.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>

struct fixture {
    struct kept_messages kept;
    struct pell_context *ctx;
    char folder[64];
    char name[8][128];
    int next;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof(*f));
    if (!f)
        return -1;
    snprintf(f->folder, sizeof(f->folder), "/tmp/pell-file-XXXXXX");
    if (!mkdtemp(f->folder) || !(f->ctx = test_context(NULL, &f->kept)))
        return -1;
    *state = f;
    return 0;
}

static void remove_tree(const char *path)
{
    DIR *dir = opendir(path);
    struct dirent *entry;

    while (dir && (entry = readdir(dir))) {
        char name[1024];
        struct stat st;
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0)
            continue;
        snprintf(name, sizeof(name), "%s/%s", path, entry->d_name);
        if (lstat(name, &st) == 0 && S_ISDIR(st.st_mode))
            remove_tree(name);
        else
            unlink(name);
    }
    if (dir)
        closedir(dir);
    rmdir(path);
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    int leaked = pell_memory_used(f->ctx) != 0;

    pell_context_destroy(&f->ctx);
    remove_tree(f->folder);
    free(f);
    return leaked;
}

static const char *in_folder(struct fixture *f, const char *name)
{
    char *path = f->name[f->next++ % 8];
    snprintf(path, sizeof(f->name[0]), "%s/%s", f->folder, name);
    return path;
}

static int entries(const char *path)
{
    DIR *dir = opendir(path);
    int n = 0;

    assert_non_null(dir);
    while (readdir(dir))
        n++;
    closedir(dir);
    return n - 2;
}

static void put(const char *path, const char *text)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(text, 1, strlen(text), file), strlen(text));
    assert_int_equal(fclose(file), 0);
}

static void require_text(struct fixture *f, const char *path, const char *text)
{
    uint8_t *data;
    size_t size;

    assert_int_equal(pell_file_read(f->ctx, path, &data, &size), PELL_OK);
    assert_int_equal(size, strlen(text));
    assert_string_equal((char *) data, text); /* including the NUL behind the last byte */
    pell_free(f->ctx, data);
}

static void refuse_read(struct fixture *f, const char *path, enum pell_result code, const char *why)
{
    uint8_t *data = (uint8_t *) f;
    size_t size = 1;
    const int before = f->kept.errors;

    assert_int_equal(pell_file_read(f->ctx, path, &data, &size), code);
    assert_null(data);
    assert_int_equal(size, 0);
    assert_int_equal(f->kept.errors, before + 1);
    assert_string_equal(f->kept.where, path);
    if (!strstr(f->kept.what, why))
        fail_msg("'%s' says nothing of '%s'", f->kept.what, why);
}

/* --- reading --- */

static void read_gives_all_bytes_and_a_nul(void **state)
{
    struct fixture *f = *state;
    const char *path = in_folder(f, "a");

    put(path, "");
    require_text(f, path, "");
    put(path, "some bytes");
    require_text(f, path, "some bytes");
}

static void read_refuses_what_is_no_regular_file(void **state)
{
    struct fixture *f = *state;

    refuse_read(f, in_folder(f, "absent"), PELL_ERR_IO, "no such file");
    refuse_read(f, f->folder, PELL_ERR_IO, "a folder");
    refuse_read(f, "/dev/zero", PELL_ERR_IO, "a device");
    assert_int_equal(mkfifo(in_folder(f, "pipe"), 0600), 0);
    alarm(10); /* a fifo without a writer must not hang */
    refuse_read(f, in_folder(f, "pipe"), PELL_ERR_IO, "a pipe");
    alarm(0);
    assert_int_equal(symlink("loop", in_folder(f, "loop")), 0);
    refuse_read(f, in_folder(f, "loop"), PELL_ERR_IO, "link");
}

static void read_refuses_files_over_the_limit(void **state)
{
    struct fixture *f = *state;
    struct pell_limits limits = *pell_context_limits(f->ctx);
    struct kept_messages kept = { 0 };
    struct pell_context_params params = { .log = keep_message, .log_user = &kept, .limits = &limits };
    struct pell_context *ctx;
    const char *path = in_folder(f, "a");
    uint8_t *data;
    size_t size;

    limits.file_bytes = 10;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    put(path, "0123456789");
    assert_int_equal(pell_file_read(ctx, path, &data, &size), PELL_OK);
    pell_free(ctx, data);
    put(path, "0123456789a");
    assert_int_equal(pell_file_read(ctx, path, &data, &size), PELL_ERR_INVALID);
    assert_null(data);
    assert_non_null(strstr(kept.what, "11"));
    assert_non_null(strstr(kept.what, "10"));
    assert_non_null(strstr(kept.hint, "file-bytes"));
    pell_context_destroy(&ctx);
}

/* The kernel reports a size of 0 bytes for these files and then delivers more: a file that grows while it is read. */
static void read_refuses_a_file_that_grows(void **state)
{
    if (access("/proc/self/status", R_OK) != 0)
        skip();
    refuse_read(*state, "/proc/self/status", PELL_ERR_IO, "changed its size");
}

/* A sparse file of one terabyte is refused by the size limit, not by an allocation that fails. */
static void read_refuses_a_huge_sparse_file_before_it_allocates(void **state)
{
    struct fixture *f = *state;
    const char *path = in_folder(f, "huge");
    const uint64_t before = pell_allocations(f->ctx);

    put(path, "");
    if (truncate(path, (off_t) 1 << 40) != 0) {
        print_message("# skipped: the file system has no sparse files of a terabyte\n");
        skip();
    }
    refuse_read(f, path, PELL_ERR_INVALID, "1099511627776");
    assert_int_equal(pell_allocations(f->ctx), before);
}

static void read_survives_failing_allocations(void **state)
{
    struct fixture *f = *state;
    struct pell_alloc_fault fault = { .fail_at = 2 }; /* 1 is the context */
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(&fault, &kept);
    uint8_t *data;
    size_t size;

    put(in_folder(f, "a"), "x");
    assert_int_equal(pell_file_read(ctx, in_folder(f, "a"), &data, &size), PELL_ERR_NOMEM);
    assert_null(data);
    assert_int_equal(kept.errors, 1);
    pell_context_destroy(&ctx);
    assert_int_equal(fault.live, 0);
}

/* --- writing --- */

static void write_makes_and_replaces_and_leaves_no_other_file(void **state)
{
    struct fixture *f = *state;
    const char *path = in_folder(f, "out");

    assert_int_equal(pell_file_write(f->ctx, path, "first", 5), PELL_OK);
    require_text(f, path, "first");
    assert_int_equal(pell_file_write(f->ctx, path, "2", 1), PELL_OK);
    require_text(f, path, "2");
    assert_int_equal(pell_file_write(f->ctx, path, "", 0), PELL_OK);
    require_text(f, path, "");
    assert_int_equal(entries(f->folder), 1);
}

static void write_follows_the_umask_and_keeps_an_old_mode(void **state)
{
    struct fixture *f = *state;
    const mode_t before = umask(027);
    struct stat st;

    assert_int_equal(pell_file_write(f->ctx, in_folder(f, "new"), "x", 1), PELL_OK);
    umask(before);
    assert_int_equal(stat(in_folder(f, "new"), &st), 0);
    assert_int_equal(st.st_mode & 0777, 0640);
    assert_int_equal(chmod(in_folder(f, "new"), 0604), 0);
    assert_int_equal(pell_file_write(f->ctx, in_folder(f, "new"), "y", 1), PELL_OK);
    assert_int_equal(stat(in_folder(f, "new"), &st), 0);
    assert_int_equal(st.st_mode & 0777, 0604);
}

static void write_goes_through_links_and_into_devices(void **state)
{
    struct fixture *f = *state;
    struct stat st;

    put(in_folder(f, "target"), "old");
    assert_int_equal(symlink("target", in_folder(f, "link")), 0);
    assert_int_equal(pell_file_write(f->ctx, in_folder(f, "link"), "new", 3), PELL_OK);
    assert_int_equal(lstat(in_folder(f, "link"), &st), 0);
    assert_true(S_ISLNK(st.st_mode));
    require_text(f, in_folder(f, "target"), "new");

    assert_int_equal(pell_file_write(f->ctx, "/dev/null", "gone", 4), PELL_OK);
    assert_int_equal(stat("/dev/null", &st), 0);
    assert_true(S_ISCHR(st.st_mode));
}

static void refuse_write(struct fixture *f, const char *path, const char *why)
{
    const int before = f->kept.errors;

    assert_int_equal(pell_file_write(f->ctx, path, "x", 1), PELL_ERR_IO);
    assert_int_equal(f->kept.errors, before + 1);
    if (!strstr(f->kept.what, why))
        fail_msg("'%s' says nothing of '%s'", f->kept.what, why);
}

static void write_refuses_folders_and_absent_places(void **state)
{
    struct fixture *f = *state;

    refuse_write(f, f->folder, "folder");
    refuse_write(f, in_folder(f, "sub/"), "folder");
    refuse_write(f, "", "empty path");
    refuse_write(f, in_folder(f, "absent/out"), "no such file");
    put(in_folder(f, "file"), "x");
    refuse_write(f, in_folder(f, "file/out"), "not a folder");
    assert_int_equal(symlink("nowhere", in_folder(f, "dangling")), 0);
    refuse_write(f, in_folder(f, "dangling"), "link");
    if (access("/dev/full", W_OK) == 0)
        refuse_write(f, "/dev/full", "no space");
    require_text(f, in_folder(f, "file"), "x");
    assert_int_equal(entries(f->folder), 2);
}

/* A disk that fills up in the middle of a write: the previous file stays, and no temporary file remains. */
static void write_that_fails_midway_leaves_the_old_file(void **state)
{
    struct fixture *f = *state;
    struct rlimit old, small;
    static char data[100000];
    const char *path = in_folder(f, "out");

    assert_int_equal(pell_file_write(f->ctx, path, "old", 3), PELL_OK);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
    small = old;
    small.rlim_cur = 5000;
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    const enum pell_result res = pell_file_write(f->ctx, path, data, sizeof(data));
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
    signal(SIGXFSZ, SIG_DFL);
    assert_int_equal(res, PELL_ERR_IO);
    assert_non_null(strstr(f->kept.what, "too large"));
    require_text(f, path, "old");
    assert_int_equal(entries(f->folder), 1);
}

static void write_that_is_cancelled_leaves_the_old_file(void **state)
{
    struct fixture *f = *state;
    const size_t size = 40 << 20;
    const char *path = in_folder(f, "out");
    char *data = pell_zalloc(f->ctx, size);

    assert_non_null(data);
    assert_int_equal(pell_file_write(f->ctx, path, "old", 3), PELL_OK);
    pell_context_cancel(f->ctx);
    assert_int_equal(pell_file_write(f->ctx, path, data, size), PELL_ERR_CANCELLED);
    pell_free(f->ctx, data);
    assert_int_equal(f->kept.errors, 0);
    require_text(f, path, "old");
    assert_int_equal(entries(f->folder), 1);
}

struct reader {
    int fd;
    size_t bytes;
    bool ordered;
};

static void *slow_reader(void *arg)
{
    struct reader *r = arg;
    unsigned char block[3000];
    ssize_t n;

    while ((n = read(r->fd, block, sizeof(block))) > 0) {
        for (ssize_t i = 0; i < n; i++)
            r->ordered = r->ordered && block[i] == (unsigned char) ((r->bytes + (size_t) i) * 7 >> 3);
        r->bytes += (size_t) n;
    }
    return NULL;
}

/* A pipe accepts 64 KiB at a time: tests the loop over partial writes. */
static void write_to_standard_output_is_whole_through_a_pipe(void **state)
{
    struct fixture *f = *state;
    struct reader reader = { .ordered = true };
    const size_t size = 1000003;
    unsigned char *data = pell_alloc(f->ctx, size);
    enum pell_result res;
    int ends[2], saved;
    pthread_t thread;

    assert_non_null(data);
    for (size_t i = 0; i < size; i++)
        data[i] = (unsigned char) (i * 7 >> 3);
    fflush(stdout);
    assert_int_equal(pipe(ends), 0);
    saved = dup(STDOUT_FILENO);
    reader.fd = ends[0];
    assert_int_equal(pthread_create(&thread, NULL, slow_reader, &reader), 0);
    assert_true(dup2(ends[1], STDOUT_FILENO) >= 0);
    close(ends[1]);
    res = pell_file_write(f->ctx, "-", data, size);
    assert_true(dup2(saved, STDOUT_FILENO) >= 0);
    close(saved);
    pthread_join(thread, NULL);
    close(ends[0]);
    pell_free(f->ctx, data);
    assert_int_equal(res, PELL_OK);
    assert_int_equal(reader.bytes, size);
    assert_true(reader.ordered);
}

/* --- references --- */

static void resolve(struct fixture *f, const char *root, const char *reference, bool outside, enum pell_result code, const char *expected)
{
    const int before = f->kept.errors;
    char *path = (char *) f;
    const enum pell_result res = pell_path_resolve(f->ctx, "scene.gltf:/images/0", root, reference, outside, &path);

    if (res != code)
        fail_msg("'%s' in '%s' gives %s, not %s: %s", reference, root, pell_result_name(res), pell_result_name(code), f->kept.what);
    if (code == PELL_OK) {
        assert_int_equal(f->kept.errors, before);
        assert_string_equal(path, expected);
    } else {
        assert_int_equal(f->kept.errors, before + 1);
        assert_null(path);
        assert_string_equal(f->kept.where, "scene.gltf:/images/0");
        if (!strstr(f->kept.what, expected))
            fail_msg("'%s' says nothing of '%s'", f->kept.what, expected);
    }
    pell_free(f->ctx, path);
}

static void references_stay_in_their_folder(void **state)
{
    struct fixture *f = *state;
    char root[80], slashed[96], inner[160];

    snprintf(root, sizeof(root), "%s/scene", f->folder);
    snprintf(slashed, sizeof(slashed), "%s/", root);
    mkdir(root, 0700);
    mkdir(in_folder(f, "scene/maps"), 0700);
    mkdir(in_folder(f, "scene-2"), 0700);
    put(in_folder(f, "scene/maps/skin.png"), "x");
    put(in_folder(f, "secret"), "x");
    put(in_folder(f, "scene-2/secret"), "x");
    assert_int_equal(symlink("..", in_folder(f, "scene/up")), 0);
    assert_int_equal(symlink("../scene-2", in_folder(f, "scene/sibling")), 0);
    assert_int_equal(symlink("/etc/passwd", in_folder(f, "scene/passwd")), 0);
    assert_int_equal(symlink("maps", in_folder(f, "scene/textures")), 0);
    assert_int_equal(symlink("scene", in_folder(f, "alias")), 0);

    snprintf(inner, sizeof(inner), "%s/maps/skin.png", root);
    resolve(f, root, "maps/skin.png", false, PELL_OK, inner);
    resolve(f, slashed, "maps/skin.png", false, PELL_OK, inner);
    snprintf(inner, sizeof(inner), "%s/./maps/../maps//skin.png", root);
    resolve(f, root, "./maps/../maps//skin.png", false, PELL_OK, inner);
    snprintf(inner, sizeof(inner), "%s/textures/skin.png", root);
    resolve(f, root, "textures/skin.png", false, PELL_OK, inner); /* a link that stays inside */
    snprintf(inner, sizeof(inner), "%s/alias/maps/skin.png", f->folder);
    resolve(f, in_folder(f, "alias"), "maps/skin.png", false, PELL_OK, inner); /* a root that is a link */

    resolve(f, root, "/etc/passwd", false, PELL_ERR_INVALID, "absolute");
    resolve(f, root, "../secret", false, PELL_ERR_INVALID, "leads out");
    resolve(f, root, "maps/../../secret", false, PELL_ERR_INVALID, "leads out");
    resolve(f, root, "maps/../../scene/maps/skin.png", false, PELL_ERR_INVALID, "leads out");
    resolve(f, root, "..", false, PELL_ERR_INVALID, "leads out");
    resolve(f, root, "passwd", false, PELL_ERR_INVALID, "through a link");
    resolve(f, root, "up/secret", false, PELL_ERR_INVALID, "through a link");
    resolve(f, root, "sibling/secret", false, PELL_ERR_INVALID, "through a link"); /* "scene-2" begins with "scene" */
    resolve(f, root, "maps/absent.png", false, PELL_ERR_IO, "can't be found");
    resolve(f, root, "", false, PELL_ERR_INVALID, "empty");
    resolve(f, root, "", true, PELL_ERR_INVALID, "empty");

    snprintf(inner, sizeof(inner), "%s/../secret", root);
    resolve(f, root, "../secret", true, PELL_OK, inner);
    snprintf(inner, sizeof(inner), "%s/secret", f->folder);
    resolve(f, root, inner, true, PELL_OK, inner);
}

static void files_that_were_read_are_known(void **state)
{
    struct fixture *f = *state;
    char path[1100], other[1100], link_to[1100];

    for (int i = 0; i < 100; i++) { /* exceeds the table's initial capacity */
        uint8_t *data;
        size_t size;
        snprintf(path, sizeof(path), "%s/read-%d", f->folder, i);
        snprintf(other, sizeof(other), "%s/other-%d", f->folder, i);
        snprintf(link_to, sizeof(link_to), "%s/link-%d", f->folder, i);
        assert_int_equal(pell_file_write(f->ctx, path, "a", 1), PELL_OK);
        assert_int_equal(pell_file_write(f->ctx, other, "b", 1), PELL_OK);
        assert_int_equal(link(path, link_to), 0);
        assert_false(pell_file_was_read(f->ctx, path));
        assert_int_equal(pell_file_read(f->ctx, path, &data, &size), PELL_OK);
        pell_free(f->ctx, data);
    }
    for (int i = 0; i < 100; i++) {
        snprintf(path, sizeof(path), "%s/read-%d", f->folder, i);
        snprintf(other, sizeof(other), "%s/other-%d", f->folder, i);
        snprintf(link_to, sizeof(link_to), "%s/link-%d", f->folder, i);
        assert_true(pell_file_was_read(f->ctx, path));
        assert_true(pell_file_was_read(f->ctx, link_to));
        assert_false(pell_file_was_read(f->ctx, other));
        unlink(path);
        unlink(other);
        unlink(link_to);
    }
    assert_false(pell_file_was_read(f->ctx, path));
}

static void reference_of_any_length_is_safe(void **state)
{
    struct fixture *f = *state;
    uint8_t *data;
    size_t size;
    static char reference[20000], joined[21000];

    memset(reference, 'a', sizeof(reference) - 1);
    resolve(f, f->folder, reference, false, PELL_ERR_IO, "too long");
    for (size_t i = 0; i + 1 < sizeof(reference); i += 2)
        memcpy(reference + i, "./", 2);
    reference[sizeof(reference) - 2] = '\0';
    snprintf(joined, sizeof(joined), "%s/%s", f->folder, reference);
    resolve(f, f->folder, reference, false, PELL_ERR_IO, "is a folder"); /* the folder itself */
    assert_int_equal(pell_file_read(f->ctx, joined, &data, &size), PELL_ERR_IO);
}

static void current_folder_is_a_root_too(void **state)
{
    struct fixture *f = *state;
    char before[1024];

    put(in_folder(f, "a"), "x");
    assert_non_null(getcwd(before, sizeof(before)));
    assert_int_equal(chdir(f->folder), 0);
    resolve(f, ".", "a", false, PELL_OK, "a");
    resolve(f, "", "a", false, PELL_OK, "a");
    resolve(f, "/", in_folder(f, "a") + 1, false, PELL_OK, in_folder(f, "a"));
    assert_int_equal(chdir(before), 0);
}

static void paths_fall_apart_right(void **state)
{
    static const struct {
        const char *path, *folder, *name;
    } cases[] = { { "a", ".", "a" },    { "a/b", "a", "b" },   { "/a", "/", "a" }, { "//a", "/", "a" },
                  { "a//b", "a", "b" }, { "../a", "..", "a" }, { "", ".", "" },    { "a/", "a", "" } };
    struct fixture *f = *state;

    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        char *folder = pell_path_folder(f->ctx, cases[i].path);
        assert_string_equal(folder, cases[i].folder);
        assert_string_equal(pell_path_name(cases[i].path), cases[i].name);
        pell_free(f->ctx, folder);
    }
    assert_true(pell_path_has_extension("a/b.PNG", "png"));
    assert_true(pell_path_has_extension("x.tar.gz", "gz"));
    assert_false(pell_path_has_extension("a.png/b", "png"));
    assert_false(pell_path_has_extension("png", "png"));
    assert_false(pell_path_has_extension(".png", "png"));
    assert_false(pell_path_has_extension("a.pn", "png"));
    assert_false(pell_path_has_extension("a.pngs", "png"));
    assert_false(pell_path_has_extension("a.", "png"));
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(read_gives_all_bytes_and_a_nul),
        TEST(read_refuses_what_is_no_regular_file),
        TEST(read_refuses_files_over_the_limit),
        TEST(read_refuses_a_file_that_grows),
        TEST(read_refuses_a_huge_sparse_file_before_it_allocates),
        TEST(read_survives_failing_allocations),
        TEST(write_makes_and_replaces_and_leaves_no_other_file),
        TEST(write_follows_the_umask_and_keeps_an_old_mode),
        TEST(write_goes_through_links_and_into_devices),
        TEST(write_refuses_folders_and_absent_places),
        TEST(write_that_fails_midway_leaves_the_old_file),
        TEST(write_that_is_cancelled_leaves_the_old_file),
        TEST(write_to_standard_output_is_whole_through_a_pipe),
        TEST(references_stay_in_their_folder),
        TEST(files_that_were_read_are_known),
        TEST(reference_of_any_length_is_safe),
        TEST(current_folder_is_a_root_too),
        TEST(paths_fall_apart_right),
    };
    return cmocka_run_group_tests_name("file", tests, NULL, NULL);
}
