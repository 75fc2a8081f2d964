/* SPDX-License-Identifier: MIT
 * test_write.c - written images are read back; dither, names, attributes, refusals, atomic replacement. */
#include "image_test.h"

static void write_ok(struct image_test *t, const char *path, const char *format, const struct pell_write_params *params)
{
    if (pell_image_write(t->ctx, path, format, params) != PELL_OK)
        fail_msg("%s: %s", t->kept.where, t->kept.what);
}

static float value_at(const struct pell_image *image, int x, int y, int c)
{
    return ((const float *) image->pixels)[((size_t) y * (size_t) image->width + (size_t) x) * (size_t) image->channels + (size_t) c];
}

/* --- EXR ---------------------------------------------------------------------------------------------------------------------- */

static float wide_range(int x, int y, int c)
{
    return ldexpf(pattern(x, y, c) + 0.01f, (x + y) % 15 - 6) * (c == 1 && x % 7 == 0 ? -1.0f : 1.0f);
}

/* Sizes around the chunk heights (1, 16, 32) of the compressions. */
static void exr_round_trip_in_every_compression(void **state)
{
    static const int sizes[][2] = { { 1, 1 }, { 3, 2 }, { 17, 33 }, { 64, 64 }, { 257, 31 } };
    const char *path = temp_path("a.exr");
    struct image_test t;

    (void) state;
    image_test_begin(&t);
    for (int compression = PELL_EXR_PIZ; compression <= PELL_EXR_NONE; compression++)
        for (size_t s = 0; s < PELL_COUNT(sizes); s++)
            for (int full = 0; full < 3; full++) { /* half, float, mixed */
                struct planes p;
                struct pell_image image;
                planes_make(&p, sizes[s][0], sizes[s][1], wide_range);
                for (int c = 0; c < 3; c++)
                    p.channels[c].full_float = full == 1 || (full == 2 && c == 1);
                p.params.compression = (enum pell_exr_compression) compression;
                write_ok(&t, path, NULL, &p.params);
                image = read_image(&t, path, PELL_ROLE_COLOR);
                assert_int_equal(image.width, p.width);
                assert_int_equal(image.height, p.height);
                assert_int_equal(image.channels, 3);
                for (int y = 0; y < p.height; y++)
                    for (int x = 0; x < p.width; x++)
                        for (int c = 0; c < 3; c++) {
                            const float got = value_at(&image, x, y, c), want = p.data[c][y * p.width + x];
                            if (!(fabsf(got - want) <= (p.channels[c].full_float ? 0 : 4.9e-4f) * fabsf(want)))
                                fail_msg("compression %d, kind %d, %d x %d: (%d, %d) channel %d is %g, must be %g", compression, full,
                                         p.width, p.height, x, y, c, (double) got, (double) want);
                        }
                pell_image_finish(t.ctx, &image);
                planes_free(&p);
            }
    unlink(path);
    assert_int_equal(t.kept.warnings, 0);
    image_test_end(&t);
}

static float nearly_random(int x, int y, int c)
{
    return 0.7f + 0.2f * sinf((float) (x * (1 + y % 13)) * 0.2f + (float) y) + 0.002f * pattern(x, y, c);
}

/* Each row (ZIPS) is a chunk whose compressed size may equal that of its pixels, a case that the library's writer handles wrongly. */
static void exr_chunks_that_zip_does_not_shrink_are_right(void **state)
{
    static const enum pell_exr_compression kinds[] = { PELL_EXR_ZIPS, PELL_EXR_ZIP, PELL_EXR_PIZ };
    const char *path = temp_path("zips.exr");
    struct image_test t;

    (void) state;
    image_test_begin(&t);
    for (size_t k = 0; k < PELL_COUNT(kinds); k++)
        for (int width = 1; width < 60; width += 1 + width / 8) {
            struct planes p;
            struct pell_image image;
            planes_make(&p, width, 500, nearly_random);
            p.params.num_channels = 1;
            p.channels[0].name = "Y";
            p.channels[0].full_float = width % 2;
            p.params.compression = kinds[k];
            write_ok(&t, path, NULL, &p.params);
            image = read_image(&t, path, PELL_ROLE_DATA);
            for (int i = 0; i < width * 500; i++)
                REQUIRE_REL(((float *) image.pixels)[i], p.data[0][i], 4.9e-4);
            pell_image_finish(t.ctx, &image);
            planes_free(&p);
        }
    unlink(path);
    image_test_end(&t);
}

static void exr_layers_and_attributes_come_back(void **state)
{
    static const char *const names[] = { "R",
                                         "G",
                                         "B",
                                         "A",
                                         "diffuse.multiple.R",
                                         "diffuse.multiple.G",
                                         "diffuse.multiple.B",
                                         "depth.Z",
                                         "a.layer.with.a.name.of.more.than.thirty-one.characters.R" };
    static const struct pell_attribute attributes[] = { { "method", "screen-space" },
                                                        { "pellucid.a-name-of-more-than-thirty-one-characters", "1" },
                                                        { "comment", "caf\xc3\xa9" },
                                                        { "empty", "" } };
    const char *path = temp_path("layers.exr");
    struct image_test t;
    struct planes p;
    struct pell_channel channels[PELL_COUNT(names)];
    struct pell_write_params params;
    struct pell_layers layers;
    struct pell_image image;
    size_t found = 0;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 33, 20, wide_range);
    for (size_t i = 0; i < PELL_COUNT(names); i++)
        channels[i] = (struct pell_channel) { .name = names[i], .data = p.data[i % 4], .stride = 33, .full_float = i == 7 };
    params = (struct pell_write_params) { .width = 33,
                                          .height = 20,
                                          .channels = channels,
                                          .num_channels = PELL_COUNT(names),
                                          .attributes = attributes,
                                          .num_attributes = PELL_COUNT(attributes) };
    write_ok(&t, path, NULL, &params);
    assert_int_equal(pell_exr_read(t.ctx, path, &layers), PELL_OK);
    assert_int_equal(layers.count, PELL_COUNT(names));
    assert_int_equal(layers.width, 33);
    for (size_t i = 0; i < PELL_COUNT(names); i++)
        for (size_t k = 0; k < layers.count; k++) {
            if (strcmp(layers.layers[k].name, names[i]) != 0)
                continue;
            found++;
            for (int x = 0; x < 33 * 20; x++)
                REQUIRE_REL(layers.layers[k].data[x], p.data[i % 4][x], i == 7 ? 0 : 4.9e-4);
        }
    assert_int_equal(found, PELL_COUNT(names));
    found = 0;
    for (size_t i = 0; i < PELL_COUNT(attributes); i++)
        for (size_t k = 0; k < layers.num_attributes; k++)
            if (strcmp(layers.attributes[k].name, attributes[i].name) == 0) {
                assert_string_equal(layers.attributes[k].value, attributes[i].value);
                found++;
            }
    assert_int_equal(found, PELL_COUNT(attributes));
    pell_layers_finish(t.ctx, &layers);
    image = read_image(&t, path, PELL_ROLE_DATA); /* an image is R, G, B, A */
    assert_int_equal(image.channels, 4);
    REQUIRE_REL(value_at(&image, 5, 6, 3), p.data[3][6 * 33 + 5], 4.9e-4);
    pell_image_finish(t.ctx, &image);
    planes_free(&p);
    unlink(path);
    image_test_end(&t);
}

static void exr_layer_without_rgb_at_the_top_is_found(void **state)
{
    const char *path = temp_path("prefix.exr");
    struct image_test t;
    struct planes p;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 5, 4, wide_range);
    p.channels[0].name = "beauty.R";
    p.channels[1].name = "beauty.G";
    p.channels[2].name = "beauty.B";
    write_ok(&t, path, NULL, &p.params);
    image = read_image(&t, path, PELL_ROLE_COLOR);
    assert_int_equal(image.channels, 3);
    REQUIRE_REL(value_at(&image, 2, 3, 2), p.data[2][3 * 5 + 2], 4.9e-4);
    pell_image_finish(t.ctx, &image);
    p.channels[1].name = "other.G"; /* no layer is complete */
    write_ok(&t, path, NULL, &p.params);
    assert_int_equal(pell_image_read(t.ctx, path, PELL_ROLE_COLOR, &image), PELL_ERR_UNSUPPORTED);
    REQUIRE(strstr(t.kept.what, "other.G"));
    p.params.num_channels = 1; /* a single channel is a grey image */
    write_ok(&t, path, NULL, &p.params);
    image = read_image(&t, path, PELL_ROLE_DATA);
    assert_int_equal(image.channels, 1);
    pell_image_finish(t.ctx, &image);
    p.params.num_channels = 3;
    p.channels[0].name = "Y";
    p.channels[1].name = "RY";
    p.channels[2].name = "BY";
    write_ok(&t, path, NULL, &p.params);
    assert_int_equal(pell_image_read(t.ctx, path, PELL_ROLE_COLOR, &image), PELL_ERR_UNSUPPORTED);
    REQUIRE(strstr(t.kept.what, "chroma"));
    planes_free(&p);
    unlink(path);
    image_test_end(&t);
}

static void exr_names_that_no_file_can_hold_are_refused(void **state)
{
    const char *path = temp_path("names.exr");
    char long_name[300];
    const struct pell_attribute clash = { "compression", "x" };
    struct image_test t;
    struct planes p;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 2, 2, wide_range);
    p.channels[1].name = "R";
    assert_int_equal(pell_image_write(t.ctx, path, NULL, &p.params), PELL_ERR_INVALID);
    REQUIRE(strstr(t.kept.what, "two channels"));
    p.channels[1].name = "";
    assert_int_equal(pell_image_write(t.ctx, path, NULL, &p.params), PELL_ERR_INVALID);
    p.channels[1].name = NULL;
    assert_int_equal(pell_image_write(t.ctx, path, NULL, &p.params), PELL_ERR_INVALID);
    memset(long_name, 'a', sizeof(long_name));
    long_name[299] = '\0';
    p.channels[1].name = long_name;
    assert_int_equal(pell_image_write(t.ctx, path, NULL, &p.params), PELL_ERR_INVALID);
    p.channels[1].name = "G";
    p.params.attributes = &clash; /* an attribute whose type is not text */
    p.params.num_attributes = 1;
    assert_int_equal(pell_image_write(t.ctx, path, NULL, &p.params), PELL_ERR_INVALID);
    assert_int_equal(t.kept.errors, 5);
    assert_int_not_equal(access(path, F_OK), 0);
    planes_free(&p);
    image_test_end(&t);
}

static void half_clamps_what_it_cannot_hold(void **state)
{
    const char *path = temp_path("clamp.exr");
    const float data[4] = { 1e6f, -1e6f, 65504.0f, 1.0f };
    const struct pell_channel channel = { "Y", data, 4, false };
    const struct pell_write_params params = { .width = 4, .height = 1, .channels = &channel, .num_channels = 1 };
    struct image_test t;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    write_ok(&t, path, NULL, &params);
    assert_int_equal(t.kept.warnings, 1);
    REQUIRE(strstr(t.kept.last_warning, "2 values"));
    image = read_image(&t, path, PELL_ROLE_COLOR);
    REQUIRE_NEAR(value_at(&image, 0, 0, 0), 65504, 0);
    REQUIRE_NEAR(value_at(&image, 1, 0, 0), -65504, 0);
    REQUIRE_NEAR(value_at(&image, 2, 0, 0), 65504, 0);
    pell_image_finish(t.ctx, &image);
    unlink(path);
    image_test_end(&t);
}

/* --- PFM, HDR ----------------------------------------------------------------------------------------------------------------- */

static void pfm_round_trip_is_exact(void **state)
{
    const char *path = temp_path("a.pfm");
    struct image_test t;
    struct planes p;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 13, 7, wide_range);
    for (p.params.num_channels = 1; p.params.num_channels <= 4; p.params.num_channels++) {
        write_ok(&t, path, NULL, &p.params);
        image = read_image(&t, path, PELL_ROLE_DATA);
        assert_int_equal(image.channels, p.params.num_channels < 3 ? 1 : 3);
        for (int y = 0; y < 7; y++)
            for (int x = 0; x < 13; x++)
                for (int c = 0; c < image.channels; c++)
                    REQUIRE_NEAR(value_at(&image, x, y, c), p.data[c][y * 13 + x], 0);
        pell_image_finish(t.ctx, &image);
    }
    unlink(path);
    planes_free(&p);
    image_test_end(&t);
}

static float flat_and_noisy(int x, int y, int c)
{
    return x / 40 % 2 ? (float) (1 + y) * 0.125f : wide_range(x, y, c) * (wide_range(x, y, c) < 0 ? -1.0f : 1.0f);
}

static void hdr_round_trip_to_half_a_step(void **state)
{
    static const int widths[] = { 1, 7, 8, 9, 127, 128, 129, 500, 32767, 32768 };
    const char *path = temp_path("a.hdr");
    struct image_test t;

    (void) state;
    image_test_begin(&t);
    for (size_t i = 0; i < PELL_COUNT(widths); i++) {
        struct planes p;
        struct pell_image image;
        planes_make(&p, widths[i], 3, flat_and_noisy);
        write_ok(&t, path, NULL, &p.params);
        image = read_image(&t, path, PELL_ROLE_COLOR);
        assert_int_equal(image.width, widths[i]);
        for (int y = 0; y < 3; y++)
            for (int x = 0; x < widths[i]; x++) {
                const size_t at = (size_t) y * (size_t) widths[i] + (size_t) x;
                const double top = fmax(fmax((double) p.data[0][at], (double) p.data[1][at]), (double) p.data[2][at]);
                for (int c = 0; c < 3; c++) /* the largest mantissa is in [128, 256) */
                    REQUIRE_NEAR(value_at(&image, x, y, c), p.data[c][at], top / 256 + 1e-30);
            }
        pell_image_finish(t.ctx, &image);
        planes_free(&p);
    }
    assert_int_equal(t.kept.warnings, 0);
    unlink(path);
    image_test_end(&t);
}

static void hdr_extremes(void **state)
{
    static const float values[8] = { 0, -1, 1e-45f, 1e-38f, 3.4e38f, 255.9f, 0.999f, 256.0f };
    const char *path = temp_path("extreme.hdr");
    const struct pell_channel channel = { "Y", values, 8, false };
    const struct pell_write_params params = { .width = 8, .height = 1, .channels = &channel, .num_channels = 1 };
    struct image_test t;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    write_ok(&t, path, NULL, &params);
    REQUIRE(strstr(t.kept.last_warning, "written as its nearest value"));
    image = read_image(&t, path, PELL_ROLE_COLOR);
    REQUIRE_NEAR(value_at(&image, 0, 0, 0), 0, 0);
    REQUIRE_NEAR(value_at(&image, 1, 0, 1), 0, 0);
    REQUIRE_NEAR(value_at(&image, 2, 0, 2), 0, 1e-38);
    REQUIRE_REL(value_at(&image, 3, 0, 0), 1e-38, 1 / 256.0);
    REQUIRE_REL(value_at(&image, 4, 0, 0), 255 * pow(2, 119), 1e-6);
    REQUIRE_NEAR(value_at(&image, 5, 0, 0), 256, 0.5); /* rounds up to the next exponent */
    REQUIRE_NEAR(value_at(&image, 6, 0, 0), 1, 1 / 256.0);
    REQUIRE_NEAR(value_at(&image, 7, 0, 0), 256, 0);
    pell_image_finish(t.ctx, &image);
    unlink(path);
    image_test_end(&t);
}

/* --- PNG ---------------------------------------------------------------------------------------------------------------------- */

/* An image of all codes, decoded to linear light, is encoded to the same codes: dither and transfer curve preserve exact values. */
static void png_codes_survive(void **state)
{
    const char *path = temp_path("codes.png");
    struct image_test t;

    (void) state;
    image_test_begin(&t);
    for (int bits = 8; bits <= 16; bits += 8) {
        const int count = bits == 8 ? 256 : 65536, width = 256, height = 9 * count / 256;
        float *data = malloc((size_t) width * (size_t) height * sizeof(*data));
        const struct pell_channel channel = { "Y", data, width, false };
        const struct pell_write_params params = {
            .width = width, .height = height, .channels = &channel, .num_channels = 1, .png_bits = bits
        };
        struct pell_image image;
        REQUIRE(data);
        for (int i = 0; i < width * height; i++) {
            const double x = (i + i / 256 / 9) % count / (count - 1.0); /* each code at many positions of the dither pattern */
            data[i] = (float) (x <= 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4));
        }
        write_ok(&t, path, NULL, &params);
        image = read_image(&t, path, PELL_ROLE_COLOR);
        assert_int_equal(image.channels, 1);
        assert_int_equal(image.type, bits == 8 ? PELL_PIXEL_U8 : PELL_PIXEL_U16);
        for (int i = 0; i < width * height; i++) {
            const int got = bits == 8 ? ((uint8_t *) image.pixels)[i] : ((uint16_t *) image.pixels)[i];
            if (got != (i + i / 256 / 9) % count)
                fail_msg("%d bits: code %d came back as %d", bits, (i + i / 256 / 9) % count, got);
        }
        pell_image_finish(t.ctx, &image);
        free(data);
    }
    unlink(path);
    image_test_end(&t);
}

static float level; /* of the constant image below */
static float flat(int x, int y, int c)
{
    (void) x;
    (void) y;
    return c == 3 ? 0.5f : level;
}

/* The mean over the dither pattern is the value, and no code is off by one or more. */
static void png_dither_keeps_the_mean(void **state)
{
    const char *path = temp_path("dither.png");
    struct image_test t;

    (void) state;
    image_test_begin(&t);
    for (int i = 0; i <= 40; i++) {
        struct planes p;
        struct pell_image image;
        double sum[4] = { 0 };
        const double code = 255.0 * i / 40.0;
        level = pell_srgb_decode((float) (code / 255));
        planes_make(&p, 16, 16, flat);
        p.params.num_channels = 4;
        write_ok(&t, path, NULL, &p.params);
        image = read_image(&t, path, PELL_ROLE_COLOR);
        assert_int_equal(image.channels, 4);
        for (int k = 0; k < 16 * 16 * 4; k++) {
            const double got = ((uint8_t *) image.pixels)[k];
            REQUIRE(fabs(got - (k % 4 == 3 ? 127.5 : code)) < 1);
            sum[k % 4] += got / 256;
        }
        for (int c = 0; c < 4; c++)
            REQUIRE_NEAR(sum[c], c == 3 ? 127.5 : code, 1 / 64.0 + 0.003);
        pell_image_finish(t.ctx, &image);
        planes_free(&p);
    }
    unlink(path);
    image_test_end(&t);
}

static float out_of_range(int x, int y, int c)
{
    static const float values[] = { 0, 1, -5, 7, -0.0f, 1e30f, -1e30f, 0.9999999f };
    return values[(x + y + c) % 8];
}

static void png_clamps_to_0_and_1(void **state)
{
    const char *path = temp_path("clamp.png");
    struct image_test t;
    struct planes p;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 11, 9, out_of_range);
    for (p.params.png_bits = 8; p.params.png_bits <= 16; p.params.png_bits += 8) {
        write_ok(&t, path, NULL, &p.params);
        image = read_image(&t, path, PELL_ROLE_DATA);
        assert_int_equal(pell_image_to_float(t.ctx, &image), PELL_OK);
        for (int y = 0; y < 9; y++)
            for (int x = 0; x < 11; x++)
                for (int c = 0; c < 3; c++)
                    REQUIRE_NEAR(value_at(&image, x, y, c), out_of_range(x, y, c) > 0.5f ? 1 : 0, 0);
        pell_image_finish(t.ctx, &image);
    }
    planes_free(&p);
    unlink(path);
    image_test_end(&t);
}

static const uint8_t *find_bytes(const uint8_t *data, size_t size, const char *text)
{
    const size_t length = strlen(text);
    for (size_t i = 0; i + length <= size; i++)
        if (memcmp(data + i, text, length) == 0)
            return data + i;
    return NULL;
}

static void png_fourth_channel_is_alpha_only_by_name(void **state)
{
    const struct pell_attribute text[] = { { "Software", "Pellucid" }, { "Note", "caf\xc3\xa9" } };
    const char *path = temp_path("alpha.png");
    struct image_test t;
    struct planes p;
    struct pell_image image;
    size_t size;
    uint8_t *file;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 6, 5, pattern);
    p.params.num_channels = 4;
    p.params.attributes = text;
    p.params.num_attributes = 2;
    write_ok(&t, path, NULL, &p.params);
    image = read_image(&t, path, PELL_ROLE_COLOR);
    assert_int_equal(image.channels, 4);
    pell_image_finish(t.ctx, &image);
    file = file_bytes(path, &size);
    REQUIRE(find_bytes(file, size, "sRGB"));
    REQUIRE(find_bytes(file, size, "tEXtSoftware"));
    REQUIRE(find_bytes(file, size, "iTXtNote")); /* not Latin-1 */
    REQUIRE(find_bytes(file, size, "caf\xc3\xa9"));
    free(file);
    p.channels[3].name = "diffuse.R";
    write_ok(&t, path, NULL, &p.params);
    image = read_image(&t, path, PELL_ROLE_COLOR);
    assert_int_equal(image.channels, 3);
    pell_image_finish(t.ctx, &image);
    planes_free(&p);
    unlink(path);
    image_test_end(&t);
}

/* --- Front end ---------------------------------------------------------------------------------------------------------------- */

static float not_finite(int x, int y, int c)
{
    return x == 1 ? NAN : x == 2 ? INFINITY : x == 3 ? -INFINITY : y + c > 0 ? 0.5f : 1.0f;
}

static void not_a_number_is_written_as_0_with_one_warning(void **state)
{
    struct image_test t;
    struct planes p;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 5, 2, not_finite);
    for (size_t i = 0; i < pell_write_format_count(); i++) {
        char name[32];
        const char *path;
        struct pell_image image;
        snprintf(name, sizeof(name), "nan.%s", pell_write_format_at(i));
        path = temp_path(name);
        t.kept.warnings = 0;
        write_ok(&t, path, NULL, &p.params);
        assert_int_equal(t.kept.warnings, 1);
        REQUIRE(strstr(t.kept.last_warning, "18 values")); /* 3 columns, 2 rows, 3 channels */
        image = read_image(&t, path, PELL_ROLE_COLOR);
        assert_int_equal(pell_image_to_float(t.ctx, &image), PELL_OK);
        for (int c = 0; c < 3; c++) {
            REQUIRE_NEAR(value_at(&image, 1, 0, c), 0, 0);
            REQUIRE_NEAR(value_at(&image, 3, 1, c), 0, 0);
            REQUIRE_NEAR(value_at(&image, 4, 1, c), 0.5, 0.005);
        }
        pell_image_finish(t.ctx, &image);
        unlink(path);
    }
    planes_free(&p);
    image_test_end(&t);
}

static void stride_may_be_wider_than_the_picture_or_negative(void **state)
{
    const char *path = temp_path("stride.pfm");
    struct image_test t;
    struct planes p;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 8, 4, pattern);
    p.params.width = 3; /* columns 2 to 4, upside down */
    for (int c = 0; c < 3; c++) {
        p.channels[c].data = p.data[c] + 3 * 8 + 2;
        p.channels[c].stride = -8;
    }
    write_ok(&t, path, NULL, &p.params);
    image = read_image(&t, path, PELL_ROLE_DATA);
    for (int y = 0; y < 4; y++)
        for (int x = 0; x < 3; x++)
            REQUIRE_NEAR(value_at(&image, x, y, 1), p.data[1][(3 - y) * 8 + x + 2], 0);
    pell_image_finish(t.ctx, &image);
    planes_free(&p);
    unlink(path);
    image_test_end(&t);
}

static void wrong_arguments_are_refused_by_name(void **state)
{
    const char *path = temp_path("no.png");
    struct image_test t;
    struct planes p;
    struct pell_write_params params;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 4, 4, pattern);
#define REFUSED(file, format, change, text)                                                                                                \
    do {                                                                                                                                   \
        params = p.params;                                                                                                                 \
        change;                                                                                                                            \
        t.kept.what[0] = '\0';                                                                                                             \
        assert_int_equal(pell_image_write(t.ctx, file, format, &params), PELL_ERR_INVALID);                                                \
        if (!strstr(t.kept.what, text))                                                                                                    \
            fail_msg("'%s' does not say '%s'", t.kept.what, text);                                                                         \
    } while (0)
    REFUSED(temp_path("a.pgn"), NULL, (void) 0, "pgn");
    REQUIRE(strstr(t.kept.hint, "png"));
    REFUSED(temp_path("noending"), NULL, (void) 0, "must be png, exr, hdr or pfm");
    REFUSED("-", NULL, (void) 0, "standard output needs a format");
    REFUSED(path, "tiff", (void) 0, "tiff");
    REFUSED(path, NULL, params.width = 0, "0 x 4");
    REFUSED(path, NULL, params.height = -3, "4 x -3");
    REFUSED(path, NULL, (params.width = 2000000, params.height = 2000000), "at most");
    REFUSED(path, NULL, params.num_channels = 0, "without channels");
    REFUSED(path, NULL, params.png_bits = 12, "png_bits = 12");
    REFUSED(path, NULL, params.compression = (enum pell_exr_compression) 9, "compression = 9");
    REFUSED(path, NULL, params.num_attributes = 1, "attribute 0");
    p.channels[1].data = NULL;
    REFUSED(path, NULL, (void) 0, "channel 1 (\"G\")");
#undef REFUSED
    assert_int_not_equal(access(path, F_OK), 0);
    planes_free(&p);
    image_test_end(&t);
}

static void format_overrides_the_ending_and_case_does_not_matter(void **state)
{
    const char *path = temp_path("odd.txt"), *upper = temp_path("UPPER.PFM");
    struct image_test t;
    struct planes p;
    uint8_t *file;
    size_t size;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 4, 4, pattern);
    write_ok(&t, path, "hdr", &p.params);
    file = file_bytes(path, &size);
    assert_memory_equal(file, "#?RADIANCE\n", 11);
    free(file);
    write_ok(&t, upper, NULL, &p.params);
    file = file_bytes(upper, &size);
    assert_memory_equal(file, "PF\n", 3);
    free(file);
    unlink(path);
    unlink(upper);
    planes_free(&p);
    image_test_end(&t);
}

static void a_failed_write_leaves_the_old_file(void **state)
{
    const char *path = temp_path("old.exr");
    struct image_test t;
    struct planes p;
    size_t before, after;
    uint8_t *a, *b;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 4, 4, pattern);
    write_ok(&t, path, NULL, &p.params);
    a = file_bytes(path, &before);
    p.channels[1].name = "R";
    assert_int_equal(pell_image_write(t.ctx, path, NULL, &p.params), PELL_ERR_INVALID);
    b = file_bytes(path, &after);
    assert_int_equal(before, after);
    assert_memory_equal(a, b, before);
    free(a);
    free(b);
    p.channels[1].name = "G";
    assert_int_equal(pell_image_write(t.ctx, "/nonexistent-folder/a.exr", NULL, &p.params), PELL_ERR_IO);
    unlink(path);
    planes_free(&p);
    image_test_end(&t);
}

static void the_same_picture_gives_the_same_bytes(void **state)
{
    struct image_test t;
    struct planes p;

    (void) state;
    image_test_begin(&t);
    planes_make(&p, 50, 40, pattern);
    for (size_t i = 0; i < pell_write_format_count(); i++) {
        uint8_t *a, *b;
        size_t na, nb;
        const char *one = temp_path("one"), *two = temp_path("two");
        write_ok(&t, one, pell_write_format_at(i), &p.params);
        write_ok(&t, two, pell_write_format_at(i), &p.params);
        a = file_bytes(one, &na);
        b = file_bytes(two, &nb);
        assert_int_equal(na, nb);
        assert_memory_equal(a, b, na);
        free(a);
        free(b);
        unlink(one);
        unlink(two);
    }
    planes_free(&p);
    image_test_end(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exr_round_trip_in_every_compression),
        cmocka_unit_test(exr_chunks_that_zip_does_not_shrink_are_right),
        cmocka_unit_test(exr_layers_and_attributes_come_back),
        cmocka_unit_test(exr_layer_without_rgb_at_the_top_is_found),
        cmocka_unit_test(exr_names_that_no_file_can_hold_are_refused),
        cmocka_unit_test(half_clamps_what_it_cannot_hold),
        cmocka_unit_test(pfm_round_trip_is_exact),
        cmocka_unit_test(hdr_round_trip_to_half_a_step),
        cmocka_unit_test(hdr_extremes),
        cmocka_unit_test(png_codes_survive),
        cmocka_unit_test(png_dither_keeps_the_mean),
        cmocka_unit_test(png_clamps_to_0_and_1),
        cmocka_unit_test(png_fourth_channel_is_alpha_only_by_name),
        cmocka_unit_test(not_a_number_is_written_as_0_with_one_warning),
        cmocka_unit_test(stride_may_be_wider_than_the_picture_or_negative),
        cmocka_unit_test(wrong_arguments_are_refused_by_name),
        cmocka_unit_test(format_overrides_the_ending_and_case_does_not_matter),
        cmocka_unit_test(a_failed_write_leaves_the_old_file),
        cmocka_unit_test(the_same_picture_gives_the_same_bytes),
    };
    return cmocka_run_group_tests_name("image.write", tests, NULL, NULL);
}
