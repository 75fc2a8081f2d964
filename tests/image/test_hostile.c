/* SPDX-License-Identifier: MIT
 * test_hostile.c - damaged, inconsistent and huge image files: each is refused with its name; none crashes, leaks or allocates as much
 * as its header claims. Run under the address sanitizer by make test-asan. */
#include "image_test.h"

/* --- Every variant, damaged ---------------------------------------------------------------------------------------------------- */

/* Decodes a copy whose allocation ends with the file, so that the sanitizer detects a read beyond it. A refusal gives one message with
 * the file's name and leaves {0}. */
static bool decodes(struct image_test *t, const char *name, const uint8_t *data, size_t size, struct pell_image *image)
{
    uint8_t *copy = malloc(size ? size : 1);
    enum pell_result res;

    REQUIRE(copy);
    if (size)
        memcpy(copy, data, size);
    t->kept.errors = 0;
    res = pell_image_decode(t->ctx, name, copy, size, PELL_ROLE_COLOR, image);
    free(copy);
    if (res == PELL_OK) {
        REQUIRE(image->pixels && image->width > 0 && image->height > 0 && image->channels >= 1 && image->channels <= 4);
        assert_int_equal(t->kept.errors, 0);
        return true;
    }
    REQUIRE(image->pixels == NULL && image->width == 0);
    assert_int_equal(t->kept.errors, 1);
    assert_int_equal(t->kept.code, res);
    assert_string_equal(t->kept.where, name);
    REQUIRE(t->kept.what[0]);
    return false;
}

static size_t image_bytes(const struct pell_image *image)
{
    return (size_t) image->width * (size_t) image->height * (size_t) image->channels *
           (image->type == PELL_PIXEL_F32   ? 4
            : image->type == PELL_PIXEL_U16 ? 2
                                            : 1);
}

/* Truncated at any byte: refused, or (where only data after the image is missing) decoded to the identical image. */
static void cut_everywhere(const char *name, const uint8_t *data, size_t size)
{
    struct image_test t;
    struct pell_image whole, image;
    const bool readable = !strstr(name, "dwa") && !strstr(name, ".pfm");
    const size_t step = size > 6000 ? 7 : 1;

    image_test_begin(&t);
    if (readable)
        REQUIRE(decodes(&t, name, data, size, &whole));
    for (size_t length = 0; length < size; length += length < 600 || size - length < 300 ? 1 : step)
        if (decodes(&t, name, data, length, &image)) {
            REQUIRE(readable);
            if (image_bytes(&image) != image_bytes(&whole) || memcmp(image.pixels, whole.pixels, image_bytes(&whole)) != 0)
                fail_msg("%s: cut at %zu of %zu gives another image", name, length, size);
            pell_image_finish(t.ctx, &image);
        }
    if (readable)
        pell_image_finish(t.ctx, &whole);
    image_test_end(&t);
}

static void files_cut_at_every_byte_are_refused(void **state)
{
    (void) state;
    for_each_variant(cut_everywhere);
}

/* A context in which a false header cannot cause seconds of clearing memory. */
static void begin_small(struct image_test *t)
{
    struct pell_limits limits;
    struct pell_context_params params = { .log = keep_message, .limits = &limits };

    memset(t, 0, sizeof(*t));
    params.log_user = &t->kept;
    params.allocator = pell_failing_allocator(&t->fault);
    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.image_pixels = 1 << 18;
    limits.memory_bytes = 64 << 20;
    assert_int_equal(pell_context_create(&params, &t->ctx), PELL_OK);
}

/* Bytes changed by a fixed sequence. PNG has checksums: a change must be refused or have no effect. */
static void change_bytes(const char *name, const uint8_t *data, size_t size)
{
    const bool png = strstr(name, ".png");
    const int rounds = 500;
    struct image_test t;
    struct pell_image whole = { 0 }, image;
    uint8_t *bad = malloc(size);
    uint32_t seed = 12345;

    REQUIRE(bad);
    begin_small(&t);
    if (png)
        REQUIRE(decodes(&t, name, data, size, &whole));
    for (int round = 0; round < rounds; round++) {
        const int changes = 1 + round % 3;
        memcpy(bad, data, size);
        for (int i = 0; i < changes; i++) {
            size_t at;
            seed = seed * 1664525 + 1013904223;
            at = (seed >> 8) % (round % 2 && size > 400 ? 400 : size); /* half of them in the header */
            seed = seed * 1664525 + 1013904223;
            bad[at] ^= (uint8_t) (1 + (seed >> 24) % 255);
        }
        if (decodes(&t, name, bad, size, &image)) {
            if (png && (image_bytes(&image) != image_bytes(&whole) || memcmp(image.pixels, whole.pixels, image_bytes(&whole)) != 0))
                fail_msg("%s: round %d gives another image", name, round);
            pell_image_finish(t.ctx, &image);
        }
    }
    pell_image_finish(t.ctx, &whole);
    free(bad);
    image_test_end(&t);
}

static void files_with_changed_bytes_do_no_harm(void **state)
{
    (void) state;
    for_each_variant(change_bytes);
}

/* --- Generated files: the same without the variants, where ../shared is absent --------------------------------------------------- */

static void our_own_files_cut_and_changed(void **state)
{
    static const char *const names[] = { "own.png", "own.exr", "own.hdr", "own.pfm" };
    struct image_test t;
    struct planes p;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 20, 10, pattern);
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        const char *path = temp_path(names[i]);
        size_t size;
        uint8_t *data;
        assert_int_equal(pell_image_write(t.ctx, path, NULL, &p.params), PELL_OK);
        data = file_bytes(path, &size);
        unlink(path);
        if (i < 3)
            cut_everywhere(names[i], data, size);
        change_bytes(names[i], data, size);
        free(data);
    }
    planes_free(&p);
    image_test_end(&t);
}

/* --- Out of memory -------------------------------------------------------------------------------------------------------------- */

static void no_memory(const char *name, const uint8_t *data, size_t size)
{
    for (uint64_t n = 1; n < 1000; n++) {
        struct kept_messages kept = { 0 };
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, &kept);
        struct pell_image image;
        enum pell_result res;
        bool done;

        REQUIRE(ctx);
        fault.fail_at = fault.calls + n;
        res = pell_image_decode(ctx, name, data, size, PELL_ROLE_COLOR, &image);
        done = fault.calls < fault.fail_at;
        if (!done) {
            assert_int_equal(res, PELL_ERR_NOMEM);
            assert_int_equal(kept.errors, 1);
        }
        pell_image_finish(ctx, &image);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
        if (done)
            return;
    }
    fail_msg("%s takes more than 1000 allocations", name);
}

static void every_allocation_of_a_decode_may_fail(void **state)
{
    (void) state;
    for_each_variant(no_memory);
}

static void every_allocation_of_write_and_layers_may_fail(void **state)
{
    static const struct pell_attribute attributes[] = { { "a", "1" }, { "b", "2" } };
    struct planes p;

    (void) state;
    planes_make(&p, 40, 50, pattern);
    p.params.num_channels = 4;
    p.params.attributes = attributes;
    p.params.num_attributes = 2;
    for (size_t i = 0; i < pell_write_format_count(); i++) {
        const char *path = temp_path("nomem");
        for (uint64_t n = 1;; n++) {
            struct kept_messages kept = { 0 };
            struct pell_alloc_fault fault = { 0 };
            struct pell_context *ctx = test_context(&fault, &kept);
            enum pell_result res;
            bool done;

            REQUIRE(ctx && n < 1000);
            fault.fail_at = fault.calls + n;
            res = pell_image_write(ctx, path, pell_write_format_at(i), &p.params);
            done = fault.calls < fault.fail_at;
            assert_int_equal(res, done ? PELL_OK : PELL_ERR_NOMEM);
            assert_int_equal(kept.errors, !done);
            pell_context_destroy(&ctx);
            assert_int_equal(fault.live, 0);
            assert_int_equal(access(path, F_OK) == 0, done); /* no partially filled result */
            if (done)
                break;
        }
        if (strcmp(pell_write_format_at(i), "exr") == 0)
            for (uint64_t n = 1;; n++) {
                struct pell_alloc_fault fault = { 0 };
                struct pell_context *ctx = test_context(&fault, NULL);
                struct pell_layers layers;
                bool done;

                REQUIRE(ctx && n < 1000);
                fault.fail_at = fault.calls + n;
                if (pell_exr_read(ctx, path, &layers) != PELL_OK)
                    REQUIRE(layers.layers == NULL && layers.count == 0);
                done = fault.calls < fault.fail_at;
                pell_layers_finish(ctx, &layers);
                pell_context_destroy(&ctx);
                assert_int_equal(fault.live, 0);
                if (done)
                    break;
            }
        unlink(path);
    }
    planes_free(&p);
}

/* --- False headers -------------------------------------------------------------------------------------------------------------- */

static void refused(const void *data, size_t size, enum pell_result code, const char *text)
{
    struct image_test t;
    struct pell_image image;
    const uint64_t most = 1 << 20;
    size_t used;

    image_test_begin(&t);
    used = pell_memory_used(t.ctx);
    if (decodes(&t, "memory", data, size, &image))
        fail_msg("a file that should say '%s' is read", text);
    if (t.kept.code != code)
        fail_msg("'%s' is code %d, must be %d", t.kept.what, t.kept.code, code);
    if (!strstr(t.kept.what, text))
        fail_msg("'%s' does not say '%s'", t.kept.what, text);
    assert_int_equal(pell_memory_used(t.ctx), used);
    REQUIRE(t.fault.calls < most);
    image_test_end(&t);
}

#define REFUSED(literal, code, text) refused("" literal, sizeof(literal) - 1, code, text)

static void other_formats_are_named_with_the_fix(void **state)
{
    static const struct {
        const char *bytes, *name, *fix;
        size_t size;
    } files[] = {
        { "GIF89a..........", "GIF", "oiiotool", 16 },       { "BM..............", "BMP", "bmptopnm", 16 },
        { "II*\0............", "TIFF", "oiiotool", 16 },     { "RIFF....WEBPVP8 ", "WebP", "dwebp IN.webp -o OUT.png", 16 },
        { "\xabKTX 20\xbb....", "KTX2", "ktx extract", 12 }, { "DDS ............", "DDS", "oiiotool", 16 },
        { "....ftypavif....", "AVIF", "heif-convert", 16 },  { "8BPS............", "Photoshop", "oiiotool", 16 },
        { "\xff\x0a..............", "JPEG XL", "djxl", 16 }, { "....jP  ........", "JPEG 2000", "opj_decompress", 16 },
    };
    struct image_test t;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    for (size_t i = 0; i < PELL_COUNT(files); i++) {
        assert_int_equal(pell_image_decode(t.ctx, "x.png", files[i].bytes, files[i].size, PELL_ROLE_DATA, &image), PELL_ERR_UNSUPPORTED);
        REQUIRE(strstr(t.kept.what, files[i].name));
        REQUIRE(strncmp(t.kept.hint, "convert it: ", 12) == 0 && strstr(t.kept.hint, files[i].fix));
    }
    image_test_end(&t);
    REFUSED("", PELL_ERR_FORMAT, "empty");
    REFUSED("hello", PELL_ERR_FORMAT, "68 65 6c 6c");
    REFUSED("P", PELL_ERR_FORMAT, "50 00 00 00");
    refused(NULL, 0, PELL_ERR_FORMAT, "empty");
}

static void put32(uint8_t *to, uint32_t value)
{
    for (int i = 0; i < 4; i++)
        to[i] = (uint8_t) (value >> (24 - 8 * i));
}

static uint32_t crc32_of(const uint8_t *data, size_t size)
{
    uint32_t crc = 0xffffffff;
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? 0xedb88320 : 0);
    }
    return ~crc;
}

/* A PNG whose header declares `width` x `height` in 16 bit RGBA, with a correct checksum and a few bytes of data. */
static size_t lying_png(uint8_t file[128], uint32_t width, uint32_t height)
{
    static const uint8_t start[] = "\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR", idat[] = "\0\0\0\x0aIDAT\x78\x9c\x63\0\0\0\1\0\1\0";
    memcpy(file, start, 16);
    put32(file + 16, width);
    put32(file + 20, height);
    memcpy(file + 24, "\x10\x06\0\0\0", 5);
    put32(file + 29, crc32_of(file + 12, 17));
    memcpy(file + 33, idat, 18);
    put32(file + 51, crc32_of(file + 37, 14));
    return 55;
}

static void sizes_are_checked_before_memory_is_taken(void **state)
{
    uint8_t file[128];

    (void) state;
    refused(file, lying_png(file, 0x7fffffff, 0x7fffffff), PELL_ERR_INVALID, "the limit is");
    refused(file, lying_png(file, 16384, 16384), PELL_ERR_FORMAT, "can't hold 16384 x 16384");
    refused(file, lying_png(file, 0, 5), PELL_ERR_FORMAT, "0 x 5");
    refused(file, lying_png(file, 4, 4), PELL_ERR_FORMAT, "PNG: image data");
    REFUSED("PF\n100000 100000\n-1.0\n....", PELL_ERR_INVALID, "100000 x 100000");
    REFUSED("PF\n10000 10000\n-1.0\n....", PELL_ERR_FORMAT, "must be 1200000000");
    REFUSED("PF\n0 10\n-1.0\n....", PELL_ERR_FORMAT, "0 x 10");
    REFUSED("PF\n-4 10\n-1.0\n....", PELL_ERR_FORMAT, "-4 x 10");
    REFUSED("PF\n99999999999999999999 1\n-1.0\n....", PELL_ERR_FORMAT, "width");
    REFUSED("#?RADIANCE\n\n-Y 99999999 +X 99999999\n", PELL_ERR_INVALID, "the limit is");
    REFUSED("#?RADIANCE\n\n-Y 16384 +X 16384\n", PELL_ERR_FORMAT, "fewer bytes follow");
    REFUSED("#?RADIANCE\n\n-Y 0 +X 4\n", PELL_ERR_FORMAT, "4 x 0");
    REFUSED("\xff\xd8\xff\xc0\x00\x0b\x08\xff\xff\xff\xff\x01\x01\x11\x00\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00...", PELL_ERR_INVALID,
            "65535 x 65535");
    REFUSED("\xff\xd8\xff\xc0\x00\x0b\x08\x00\x00\x00\x10\x01\x01\x11\x00\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00...", PELL_ERR_UNSUPPORTED,
            "height");
}

static void headers_that_make_no_sense_are_named(void **state)
{
    (void) state;
    REFUSED("PF\n4", PELL_ERR_FORMAT, "height");
    REFUSED("PF\n4 4\n0\n................", PELL_ERR_FORMAT, "scale");
    REFUSED("PF\n4 4\nnan\n................", PELL_ERR_FORMAT, "scale");
    REFUSED("PF\n4 x\n-1\n................", PELL_ERR_FORMAT, "height");
    REFUSED("#?RADIANCE", PELL_ERR_FORMAT, "header does not end");
    REFUSED("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", PELL_ERR_FORMAT, "header does not end");
    REFUSED("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n....", PELL_ERR_UNSUPPORTED, "XYZ");
    REFUSED("#?RADIANCE\nFORMAT=other\n\n-Y 1 +X 1\n....", PELL_ERR_UNSUPPORTED, "\"other\"");
    REFUSED("#?RADIANCE\nEXPOSURE=0\n\n-Y 1 +X 1\n....", PELL_ERR_FORMAT, "EXPOSURE");
    REFUSED("#?RADIANCE\nEXPOSURE=-2\n\n-Y 1 +X 1\n....", PELL_ERR_FORMAT, "EXPOSURE");
    REFUSED("#?RADIANCE\nEXPOSURE=inf\n\n-Y 1 +X 1\n....", PELL_ERR_FORMAT, "1 numbers");
    REFUSED("#?RADIANCE\nCOLORCORR=1 2\n\n-Y 1 +X 1\n....", PELL_ERR_FORMAT, "3 numbers");
    REFUSED("#?RADIANCE\n\n", PELL_ERR_FORMAT, "no line with the size");
    REFUSED("#?RADIANCE\n\n-Y 1 +Y 1\n....", PELL_ERR_FORMAT, "\"-Y 1 +Y 1\"");
    REFUSED("#?RADIANCE\n\n-Y 1 +X 1 junk\n....", PELL_ERR_FORMAT, "junk");
    REFUSED("#?RADIANCE\n\n-Y 1 +X\n....", PELL_ERR_FORMAT, "must be like");
    REFUSED("#?RADIANCE\n\n-Y 1 +X 2\n\1\1\1\2\0\0\0\0", PELL_ERR_FORMAT, "repeats nothing");
    REFUSED("#?RADIANCE\n\n-Y 1 +X 2\n\0\0\0\1\1\1\1\2", PELL_ERR_FORMAT, "passes the scanline's end");
    REFUSED("#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\7\x88\1\x88\1\x88\1\x88\1", PELL_ERR_FORMAT, "another length");
    REFUSED("#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\x8\x89\1\x88\1\x88\1\x88\1", PELL_ERR_FORMAT, "passes the scanline's end");
    REFUSED("#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\x8\0\1\x88\1\x88\1\x88\1", PELL_ERR_FORMAT, "a run is empty");
    REFUSED("#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\x8\x88\1\x88\1\x88\1\x88", PELL_ERR_FORMAT, "end early");
    REFUSED("\xff\xd8\xff\xe0", PELL_ERR_FORMAT, "chain of segments");
    REFUSED("\xff\xd8\xff\xe0\x00\x01zz", PELL_ERR_FORMAT, "chain of segments");
    REFUSED("\xff\xd8\xff\xc3\x00\x0b\x08\x00\x10\x00\x10\x01\x01\x11\x00\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00...", PELL_ERR_UNSUPPORTED,
            "SOF3");
    REFUSED("\xff\xd8\xff\xc1\x00\x0b\x0c\x00\x10\x00\x10\x01\x01\x11\x00\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00...", PELL_ERR_UNSUPPORTED,
            "12 bits per sample");
    REFUSED("\xff\xd8\xff\xc0\x00\x0e\x08\x00\x10\x00\x10\x02\x01\x11\x00\x02\x11\x00\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00...",
            PELL_ERR_UNSUPPORTED, "2 components");
    REFUSED("\x76\x2f\x31\x01", PELL_ERR_FORMAT, "OpenEXR");
    REFUSED("\x76\x2f\x31\x01\x02\x00\x00\x00\x00", PELL_ERR_FORMAT, "OpenEXR");
}

static void a_progressive_jpeg_of_very_many_scans_is_refused(void **state)
{
    static const uint8_t head[] = "\xff\xd8\xff\xc2\x00\x0b\x08\x00\x10\x00\x10\x01\x01\x11\x00";
    static const uint8_t scan[] = "\xff\xda\x00\x08\x01\x01\x00\x00\x00\x01\x55";
    const size_t scans = 600, length = sizeof(scan) - 1;
    uint8_t *file = malloc(sizeof(head) + scans * length);
    size_t at = sizeof(head) - 1;

    (void) state;
    REQUIRE(file);
    memcpy(file, head, at);
    for (size_t i = 0; i < scans; i++, at += length)
        memcpy(file + at, scan, length);
    refused(file, at, PELL_ERR_INVALID, "600 scans");
    free(file);
}

/* An EXR header built by hand: limits the memory that the library would allocate from it. */
struct exr_bytes {
    uint8_t data[1024];
    size_t size;
};

static void exr_put(struct exr_bytes *e, const void *bytes, size_t size)
{
    REQUIRE(e->size + size <= sizeof(e->data));
    memcpy(e->data + e->size, bytes, size);
    e->size += size;
}

static void exr_attribute(struct exr_bytes *e, const char *name, const char *type, const void *bytes, int32_t size)
{
    exr_put(e, name, strlen(name) + 1);
    exr_put(e, type, strlen(type) + 1);
    exr_put(e, &size, 4); /* little-endian, as the supported machines are */
    exr_put(e, bytes, (size_t) size);
}

static void exr_header(struct exr_bytes *e, const int32_t data[4], const int32_t display[4], int32_t tile)
{
    static const uint8_t channels[] = "R\0\1\0\0\0\0\0\0\0\1\0\0\0\1\0\0\0";
    const uint8_t compression = 0, order = 0;
    const float one = 1, centre[2] = { 0, 0 };
    const uint32_t version = tile ? 0x202 : 2;

    e->size = 0;
    exr_put(e, "\x76\x2f\x31\x01", 4);
    exr_put(e, &version, 4);
    exr_attribute(e, "channels", "chlist", channels, 19);
    exr_attribute(e, "compression", "compression", &compression, 1);
    exr_attribute(e, "dataWindow", "box2i", data, 16);
    exr_attribute(e, "displayWindow", "box2i", display, 16);
    exr_attribute(e, "lineOrder", "lineOrder", &order, 1);
    exr_attribute(e, "pixelAspectRatio", "float", &one, 4);
    exr_attribute(e, "screenWindowCenter", "v2f", centre, 8);
    exr_attribute(e, "screenWindowWidth", "float", &one, 4);
    if (tile) {
        uint8_t desc[9] = { 0 };
        memcpy(desc, &tile, 4);
        memcpy(desc + 4, &tile, 4);
        exr_attribute(e, "tiles", "tiledesc", desc, 9);
    }
    exr_put(e, "", 1);
}

static void exr_windows_and_tiles_are_checked(void **state)
{
    static const int32_t small[4] = { 0, 0, 3, 3 }, none[4] = { 5, 5, 0, 0 }, large[4] = { 0, 0, 99999, 99999 },
                         wide[4] = { 0, 0, 16383, 16383 }, huge[4] = { 0, 0, 2000000000, 2000000000 },
                         far[4] = { 2000000000, 0, 2000000003, 3 }, all[4] = { INT32_MIN, INT32_MIN, INT32_MAX, INT32_MAX };
    struct exr_bytes e;

    (void) state;
    exr_header(&e, small, huge, 0);
    refused(e.data, e.size, PELL_ERR_FORMAT, "Invalid display window");
    exr_header(&e, huge, small, 0);
    refused(e.data, e.size, PELL_ERR_FORMAT, "Invalid data window");
    exr_header(&e, small, large, 0);
    refused(e.data, e.size, PELL_ERR_INVALID, "the limit is");
    exr_header(&e, large, small, 0);
    refused(e.data, e.size, PELL_ERR_INVALID, "the limit is");
    exr_header(&e, all, all, 0);
    refused(e.data, e.size, PELL_ERR_FORMAT, "OpenEXR");
    exr_header(&e, none, small, 0);
    refused(e.data, e.size, PELL_ERR_FORMAT, "OpenEXR");
    exr_header(&e, wide, wide, 0);
    refused(e.data, e.size, PELL_ERR_FORMAT, "can't stand in a file");
    exr_header(&e, small, small, 2000000000);
    refused(e.data, e.size, PELL_ERR_FORMAT, "OpenEXR");
    /* a data window that does not overlap the display window: no pixel of it is visible, and none is read */
    exr_header(&e, far, small, 0);
    exr_put(&e, "\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", 32);
    refused(e.data, e.size, PELL_ERR_FORMAT, "OpenEXR");
}

static void exr_windows_that_the_bytes_can_not_fill_are_refused(void **state)
{
    static const int32_t small[4] = { 0, 0, 3, 3 }, empty[4] = { 0, 0, 11999, 11999 }, lines[4] = { 0, 0, 16383, 3 };
    static const uint8_t table[64] = { 0 };
    struct exr_bytes e;

    (void) state;
    exr_header(&e, small, empty, 0);
    exr_put(&e, table, sizeof(table));
    refused(e.data, e.size, PELL_ERR_UNSUPPORTED, "the display window of 12000 x 12000 pixels holds 4 x 4 pixels of data");
    exr_header(&e, lines, lines, 0);
    exr_put(&e, table, sizeof(table));
    refused(e.data, e.size, PELL_ERR_FORMAT, "a data window of 16384 x 4 pixels can't stand in a file of");
    exr_header(&e, empty, empty, 12000); /* one tile */
    exr_put(&e, table, sizeof(table));
    refused(e.data, e.size, PELL_ERR_FORMAT, "a data window of 12000 x 12000 pixels can't stand in a file of");
}

static void exr_attributes_that_do_not_fit_are_named_with_their_place(void **state)
{
    static const int32_t small[4] = { 0, 0, 3, 3 }, sizes[] = { -5, INT32_MIN, INT32_MAX, 1000 };
    struct exr_bytes e, head;

    (void) state;
    exr_header(&head, small, small, 0);
    for (size_t i = 0; i < PELL_COUNT(sizes); i++) {
        e = head;
        e.size--; /* the end of the header */
        exr_put(&e, "note\0string", 12);
        exr_put(&e, &sizes[i], 4);
        exr_put(&e, "abc", 4);
        refused(e.data, e.size, PELL_ERR_FORMAT, "attribute \"note\" has");
    }
    e = head;
    e.size--;
    exr_put(&e, "n\0", 2);
    refused(e.data, e.size, PELL_ERR_FORMAT, "there is no attribute with a name, a type and a size");
}

static void limits_of_the_context_hold(void **state)
{
    struct pell_limits limits;
    struct kept_messages kept = { 0 };
    struct pell_context_params params = { .log = keep_message, .log_user = &kept, .limits = &limits };
    struct pell_context *ctx;
    struct pell_image image;
    const char *path = project_file(VARIANTS "exr/half_zip.exr"), *png = project_file(VARIANTS "png/rgb8.png");

    (void) state;
    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.image_pixels = 64 * 32 - 1;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(pell_image_read(ctx, path, PELL_ROLE_COLOR, &image), PELL_ERR_INVALID);
    REQUIRE(strstr(kept.what, "64 x 32") && strstr(kept.what, "2047") && strstr(kept.hint, "image-pixels"));
    assert_int_equal(pell_image_read(ctx, png, PELL_ROLE_COLOR, &image), PELL_ERR_INVALID);
    pell_context_destroy(&ctx);
    limits.image_pixels = 64 * 32;
    limits.file_bytes = 100;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(pell_image_read(ctx, path, PELL_ROLE_COLOR, &image), PELL_ERR_INVALID);
    pell_context_destroy(&ctx);
    assert_int_equal(kept.errors, 3);
}

static void a_file_that_is_not_there_is_an_io_error(void **state)
{
    struct image_test t;
    struct pell_image image;
    struct pell_layers layers;

    (void) state;
    image_test_begin(&t);
    assert_int_equal(pell_image_read(t.ctx, "/nonexistent/a.png", PELL_ROLE_COLOR, &image), PELL_ERR_IO);
    assert_int_equal(pell_exr_read(t.ctx, "/nonexistent/a.exr", &layers), PELL_ERR_IO);
    REQUIRE(strstr(t.kept.where, "/nonexistent/a.exr"));
    assert_int_equal(t.kept.errors, 2);
    image_test_end(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(files_cut_at_every_byte_are_refused),
        cmocka_unit_test(files_with_changed_bytes_do_no_harm),
        cmocka_unit_test(our_own_files_cut_and_changed),
        cmocka_unit_test(every_allocation_of_a_decode_may_fail),
        cmocka_unit_test(every_allocation_of_write_and_layers_may_fail),
        cmocka_unit_test(other_formats_are_named_with_the_fix),
        cmocka_unit_test(sizes_are_checked_before_memory_is_taken),
        cmocka_unit_test(headers_that_make_no_sense_are_named),
        cmocka_unit_test(a_progressive_jpeg_of_very_many_scans_is_refused),
        cmocka_unit_test(exr_windows_and_tiles_are_checked),
        cmocka_unit_test(exr_attributes_that_do_not_fit_are_named_with_their_place),
        cmocka_unit_test(exr_windows_that_the_bytes_can_not_fill_are_refused),
        cmocka_unit_test(limits_of_the_context_hold),
        cmocka_unit_test(a_file_that_is_not_there_is_an_io_error),
    };
    return cmocka_run_group_tests_name("image.hostile", tests, NULL, NULL);
}
