/* SPDX-License-Identifier: MIT
 * test_read.c - every file of image_variants against the pattern that they encode, and valid files beyond those variants. */
#include "image_test.h"

#include <openexr.h>
#include <spng.h>
#include <turbojpeg.h>

/* Largest error of a float image against the pattern, relative to the pixel's largest channel (absolute where `scale` is 0). */
static double worst_error(const struct pell_image *image, const struct pell_image *ref, float scale)
{
    double worst = 0;
    for (int y = 0; y < image->height; y++)
        for (int x = 0; x < image->width; x++) {
            const float *want = (const float *) ref->pixels + ((size_t) y * (size_t) ref->width + (size_t) x) * 3;
            const float *got = (const float *) image->pixels + ((size_t) y * (size_t) image->width + (size_t) x) * (size_t) image->channels;
            const double top = fmax(fmax((double) want[0], (double) want[1]), fmax((double) want[2], 1e-6));
            for (int c = 0; c < 3; c++)
                worst = fmax(worst, fabs((double) (got[c] / scale - want[c])) / top);
        }
    return worst;
}

static void exr_variants_hold_the_pattern(void **state)
{
    /* half: 2^-11; b44 is lossy */
    static const struct {
        const char *name;
        double tolerance;
    } files[] = {
        { "float_none", 0 },     { "float_zip", 0 },     { "half_none", 4.9e-4 },        { "half_rle", 4.9e-4 },
        { "half_zips", 4.9e-4 }, { "half_zip", 4.9e-4 }, { "half_piz", 4.9e-4 },         { "half_pxr24", 4.9e-4 },
        { "half_b44", 0.12 },    { "half_b44a", 0.12 },  { "half_zip_tiled16", 4.9e-4 }, { "half_zip_rgb_plus_Z_id", 4.9e-4 },
    };
    struct image_test t;
    struct pell_image ref;

    (void) state;
    image_test_begin(&t);
    ref = read_variant(&t, "exr/pattern_64x32.pfm", PELL_ROLE_COLOR);
    for (size_t i = 0; i < PELL_COUNT(files); i++) {
        char name[64];
        struct pell_image image;
        snprintf(name, sizeof(name), "exr/%s.exr", files[i].name);
        image = read_variant(&t, name, PELL_ROLE_COLOR);
        assert_int_equal(image.width, 64);
        assert_int_equal(image.height, 32);
        assert_int_equal(image.channels, 3);
        assert_int_equal(image.type, PELL_PIXEL_F32);
        assert_false(image.srgb);
        if (!(worst_error(&image, &ref, 1) <= files[i].tolerance))
            fail_msg("%s: error %g, allowed %g", name, worst_error(&image, &ref, 1), files[i].tolerance);
        pell_image_finish(t.ctx, &image);
    }
    pell_image_finish(t.ctx, &ref);
    image_test_end(&t);
}

static void exr_luminance_is_one_channel(void **state)
{
    struct image_test t;
    struct pell_image ref, image;

    (void) state;
    image_test_begin(&t);
    ref = read_variant(&t, "exr/pattern_64x32.pfm", PELL_ROLE_COLOR);
    image = read_variant(&t, "exr/luminance_only_Y_half_zip.exr", PELL_ROLE_COLOR);
    assert_int_equal(image.channels, 1);
    for (int i = 0; i < 64 * 32; i++) /* contains the pattern's G */
        REQUIRE_REL(((float *) image.pixels)[i], ((float *) ref.pixels)[3 * i + 1], 4.9e-4);
    pell_image_finish(t.ctx, &image);
    pell_image_finish(t.ctx, &ref);
    image_test_end(&t);
}

/* The file stores the pattern as associated colour, alpha a ramp over x. */
static void exr_alpha_becomes_straight_for_color_only(void **state)
{
    struct image_test t;
    struct pell_image ref, data, color;

    (void) state;
    image_test_begin(&t);
    ref = read_variant(&t, "exr/pattern_64x32.pfm", PELL_ROLE_COLOR);
    data = read_variant(&t, "exr/half_zip_rgba.exr", PELL_ROLE_DATA);
    color = read_variant(&t, "exr/half_zip_rgba.exr", PELL_ROLE_COLOR);
    assert_int_equal(data.channels, 4);
    REQUIRE(worst_error(&data, &ref, 1) <= 4.9e-4);
    for (int i = 0; i < 64 * 32; i++) {
        const float *d = (const float *) data.pixels + 4 * i, *c = (const float *) color.pixels + 4 * i;
        REQUIRE_NEAR(d[3], (i % 64) / 63.0, 1e-3);
        for (int k = 0; k < 3; k++)
            REQUIRE_REL(c[k], d[3] > 0 ? d[k] / d[3] : d[k], 1e-6);
    }
    pell_image_finish(t.ctx, &color);
    pell_image_finish(t.ctx, &data);
    pell_image_finish(t.ctx, &ref);
    image_test_end(&t);
}

static void exr_data_window_is_placed_in_the_display_window(void **state)
{
    struct image_test t;
    struct pell_image ref, image;

    (void) state;
    image_test_begin(&t);
    ref = read_variant(&t, "exr/pattern_64x32.pfm", PELL_ROLE_COLOR);
    image = read_variant(&t, "exr/half_zip_datawindow_offset.exr", PELL_ROLE_COLOR); /* at (-5, 7) */
    assert_int_equal(image.width, 64);
    assert_int_equal(image.height, 32);
    for (int y = 0; y < 32; y++)
        for (int x = 0; x < 64; x++)
            for (int c = 0; c < 3; c++) {
                const bool inside = x + 5 < 64 && y >= 7;
                REQUIRE_REL(((float *) image.pixels)[(y * 64 + x) * 3 + c],
                            inside ? ((float *) ref.pixels)[((y - 7) * 64 + x + 5) * 3 + c] : 0, 4.9e-4);
            }
    pell_image_finish(t.ctx, &image);
    pell_image_finish(t.ctx, &ref);
    image_test_end(&t);
}

static void exr_dwa_is_refused_with_the_fix(void **state)
{
    static const char *const names[] = { "exr/half_dwaa.exr", "exr/half_dwab.exr" };
    struct image_test t;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    for (int i = 0; i < 2; i++) {
        char path[128];
        snprintf(path, sizeof(path), VARIANTS "%s", names[i]);
        assert_int_equal(pell_image_read(t.ctx, project_file(path), PELL_ROLE_COLOR, &image), PELL_ERR_UNSUPPORTED);
        REQUIRE(image.pixels == NULL);
        REQUIRE(strstr(t.kept.what, i ? "DWAB" : "DWAA"));
        REQUIRE(strstr(t.kept.hint, "oiiotool IN.exr --compression zip -o OUT.exr"));
        REQUIRE(strstr(t.kept.where, names[i]));
        assert_int_equal(t.kept.errors, i + 1);
    }
    image_test_end(&t);
}

static const float *find_layer(const struct pell_layers *layers, const char *name)
{
    for (size_t i = 0; i < layers->count; i++)
        if (strcmp(layers->layers[i].name, name) == 0)
            return layers->layers[i].data;
    fail_msg("no layer %s", name);
    return NULL;
}

static void exr_layers_hold_all_channels(void **state)
{
    struct image_test t;
    struct pell_image ref;
    struct pell_layers layers;
    const float *z, *id;

    (void) state;
    image_test_begin(&t);
    ref = read_variant(&t, "exr/pattern_64x32.pfm", PELL_ROLE_COLOR);
    assert_int_equal(pell_exr_read(t.ctx, project_file(VARIANTS "exr/half_zip_rgb_plus_Z_id.exr"), &layers), PELL_OK);
    assert_int_equal(layers.count, 5);
    z = find_layer(&layers, "Z");
    id = find_layer(&layers, "id"); /* 32 bit integers */
    for (int i = 0; i < 64 * 32; i++) {
        REQUIRE_REL(find_layer(&layers, "G")[i], ((float *) ref.pixels)[3 * i + 1], 4.9e-4);
        REQUIRE(z[i] >= 0 && z[i] < 1e4f && id[i] == floorf(id[i]));
    }
    REQUIRE(z[0] != z[64 * 31]);
    pell_layers_finish(t.ctx, &layers);
    pell_image_finish(t.ctx, &ref);
    image_test_end(&t);
}

/* A part of one kind of channel, written by the library alone: R, G, B or Z, each with value 1 + channel. */
static void add_part(exr_context_t exr, const char *name, bool rgb)
{
    int part;
    assert_int_equal(exr_add_part(exr, name, EXR_STORAGE_SCANLINE, &part), 0);
    assert_int_equal(exr_initialize_required_attr_simple(exr, part, 5, 3, EXR_COMPRESSION_ZIPS), 0);
    for (const char *c = rgb ? "BGR" : "Z"; *c; c++)
        assert_int_equal(exr_add_channel(exr, part, (const char[]) { *c, 0 }, EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1), 0);
}

static void fill_part(exr_context_t exr, int part)
{
    for (int y = 0; y < 3; y++) {
        exr_encode_pipeline_t pipe = EXR_ENCODE_PIPELINE_INITIALIZER;
        exr_chunk_info_t chunk;
        float values[3][5];
        assert_int_equal(exr_write_scanline_chunk_info(exr, part, y, &chunk), 0);
        assert_int_equal(exr_encoding_initialize(exr, part, &chunk, &pipe), 0);
        for (int c = 0; c < pipe.channel_count; c++) {
            for (int x = 0; x < 5; x++)
                values[c][x] = (float) (1 + c + 10 * y);
            pipe.channels[c].user_pixel_stride = 4;
            pipe.channels[c].user_line_stride = 20;
            pipe.channels[c].encode_from_ptr = (const uint8_t *) values[c];
        }
        assert_int_equal(exr_encoding_choose_default_routines(exr, part, &pipe), 0);
        assert_int_equal(exr_encoding_run(exr, part, &pipe), 0);
        exr_encoding_destroy(exr, &pipe);
    }
}

static void exr_of_several_parts_gives_the_first_with_rgb(void **state)
{
    const char *path = temp_path("parts.exr");
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    struct image_test t;
    struct pell_image image;
    struct pell_layers layers;
    exr_context_t exr;

    (void) state;
    assert_int_equal(exr_start_write(&exr, path, EXR_WRITE_FILE_DIRECTLY, &init), 0);
    add_part(exr, "depth", false);
    add_part(exr, "beauty", true);
    assert_int_equal(exr_write_header(exr), 0);
    fill_part(exr, 0);
    fill_part(exr, 1);
    assert_int_equal(exr_finish(&exr), 0);

    image_test_begin(&t);
    image = read_image(&t, path, PELL_ROLE_COLOR);
    assert_int_equal(image.channels, 3);
    for (int i = 0; i < 3 * 5 * 3; i++)
        REQUIRE_NEAR(((float *) image.pixels)[i], 3 - i % 3 + 10 * (i / 15), 0);
    pell_image_finish(t.ctx, &image);
    assert_int_equal(pell_exr_read(t.ctx, path, &layers), PELL_OK);
    assert_int_equal(layers.count, 4);
    REQUIRE_NEAR(find_layer(&layers, "depth.Z")[14], 21, 0);
    REQUIRE_NEAR(find_layer(&layers, "beauty.R")[14], 23, 0);
    pell_layers_finish(t.ctx, &layers);
    unlink(path);
    image_test_end(&t);
}

static void exr_deep_is_refused(void **state)
{
    const char *path = temp_path("deep.exr");
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    struct image_test t;
    struct pell_image image;
    exr_context_t exr;
    int part;

    (void) state;
    assert_int_equal(exr_start_write(&exr, path, EXR_WRITE_FILE_DIRECTLY, &init), 0);
    assert_int_equal(exr_add_part(exr, "deep", EXR_STORAGE_DEEP_SCANLINE, &part), 0);
    assert_int_equal(exr_initialize_required_attr_simple(exr, part, 1, 1, EXR_COMPRESSION_NONE), 0);
    assert_int_equal(exr_set_version(exr, part, 1), 0);
    assert_int_equal(exr_add_channel(exr, part, "Z", EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1), 0);
    assert_int_equal(exr_write_header(exr), 0);
    assert_int_equal(exr_write_deep_scanline_chunk(exr, part, 0, (const float[]) { 1 }, 4, 4, (const int32_t[]) { 1 }, 4), 0);
    assert_int_equal(exr_finish(&exr), 0);
    image_test_begin(&t);
    assert_int_equal(pell_image_read(t.ctx, path, PELL_ROLE_COLOR, &image), PELL_ERR_UNSUPPORTED);
    REQUIRE(strstr(t.kept.what, "deep"));
    unlink(path);
    image_test_end(&t);
}

/* --- Radiance ----------------------------------------------------------------------------------------------------------------- */

static void hdr_variants_hold_the_pattern(void **state)
{
    static const char *const names[] = { "new_rle",          "old_rle",        "flat_uncompressed",
                                         "bottom_up_plusY",  "flipped_minusX", "narrow_7_wide_flat",
                                         "exposure_4_header" };
    struct image_test t;
    struct pell_image ref, first = { 0 };

    (void) state;
    image_test_begin(&t);
    ref = read_variant(&t, "exr/pattern_64x32.pfm", PELL_ROLE_COLOR);
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        char name[64];
        const bool narrow = strcmp(names[i], "narrow_7_wide_flat") == 0;
        /* the stored values were multiplied by EXPOSURE, so they are divided by it */
        const float scale = strcmp(names[i], "exposure_4_header") == 0 ? 0.25f : 1.0f;
        struct pell_image image;
        snprintf(name, sizeof(name), "hdr/%s.hdr", names[i]);
        image = read_variant(&t, name, PELL_ROLE_COLOR);
        assert_int_equal(image.width, narrow ? 7 : 64);
        assert_int_equal(image.height, 32);
        /* the program that wrote the files truncated the mantissa: up to 1/128 of the largest channel */
        if (!(worst_error(&image, &ref, scale) <= 1 / 128.0))
            fail_msg("%s: error %g", name, worst_error(&image, &ref, scale));
        if (i == 0)
            first = image;
        else if (!narrow)
            for (int k = 0; k < 64 * 32 * 3; k++)
                REQUIRE_NEAR(((float *) image.pixels)[k] / scale, ((float *) first.pixels)[k], 0);
        if (i > 0)
            pell_image_finish(t.ctx, &image);
    }
    pell_image_finish(t.ctx, &first);
    pell_image_finish(t.ctx, &ref);
    image_test_end(&t);
}

static struct pell_image decode_ok(struct image_test *t, const void *data, size_t size, enum pell_image_role role)
{
    struct pell_image image;
    if (pell_image_decode(t->ctx, "memory", data, size, role, &image) != PELL_OK)
        fail_msg("%s: %s", t->kept.where, t->kept.what);
    return image;
}

/* All eight orders of rows and columns of a 3 x 2 image whose red channel is 1 + x + 3 y. */
static void hdr_all_eight_orientations(void **state)
{
    static const char *const lines[] = { "-Y 2 +X 3", "-Y 2 -X 3", "+Y 2 +X 3", "+Y 2 -X 3",
                                         "+X 3 -Y 2", "-X 3 -Y 2", "+X 3 +Y 2", "-X 3 +Y 2" };
    struct image_test t;

    (void) state;
    image_test_begin(&t);
    for (int i = 0; i < 8; i++) {
        uint8_t file[256];
        const bool columns = i >= 4, left = strstr(lines[i], "-X"), up = strstr(lines[i], "+Y");
        size_t at = (size_t) snprintf((char *) file, sizeof(file), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n%s\n", lines[i]);
        struct pell_image image;
        for (int a = 0; a < (columns ? 3 : 2); a++)
            for (int b = 0; b < (columns ? 2 : 3); b++) {
                const int x = columns ? a : b, y = columns ? b : a;
                const int value = 1 + (left ? 2 - x : x) + 3 * (up ? 1 - y : y);
                const uint8_t pixel[4] = { (uint8_t) (value * 16), 0, 128, 128 + 4 }; /* value = m 2^(132 - 136) */
                memcpy(file + at, pixel, 4);
                at += 4;
            }
        image = decode_ok(&t, file, at, PELL_ROLE_COLOR);
        assert_int_equal(image.width, 3);
        assert_int_equal(image.height, 2);
        for (int k = 0; k < 6; k++)
            REQUIRE_NEAR(((float *) image.pixels)[3 * k], 1 + k, 0);
        pell_image_finish(t.ctx, &image);
    }
    image_test_end(&t);
}

static void hdr_exposure_and_colorcorr_accumulate(void **state)
{
    static const char file[] = "#?RADIANCE\nEXPOSURE=2\nEXPOSURE= 4\nCOLORCORR= 1 0.5 2\nFORMAT=32-bit_rle_rgbe\nSOFTWARE=any\n\n"
                               "-Y 1 +X 1\n"
                               "\x80\x80\x80\x81"; /* (1, 1, 1) */
    struct image_test t;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    image = decode_ok(&t, file, sizeof(file) - 1, PELL_ROLE_COLOR);
    REQUIRE_NEAR(((float *) image.pixels)[0], 1 / 8.0, 1e-7);
    REQUIRE_NEAR(((float *) image.pixels)[1], 1 / 4.0, 1e-7);
    REQUIRE_NEAR(((float *) image.pixels)[2], 1 / 16.0, 1e-7);
    pell_image_finish(t.ctx, &image);
    image_test_end(&t);
}

static void environment_maps_agree_between_hdr_and_exr(void **state)
{
    struct image_test t;
    struct pell_image hdr, exr;
    double worst = 0;

    (void) state;
    image_test_begin_shared(&t, "assets/environments");
    hdr = read_image(&t, shared_file("assets/environments/brown_photostudio_02_1k.hdr"), PELL_ROLE_COLOR);
    exr = read_image(&t, shared_file("assets/environments/brown_photostudio_02_512.exr"), PELL_ROLE_COLOR);
    assert_int_equal(hdr.width, 1024);
    assert_int_equal(exr.width, 512);
    for (int y = 0; y < 256; y++)
        for (int x = 0; x < 512 * 3; x++) {
            const float *a = (const float *) hdr.pixels + (size_t) (2 * y) * 3072 + (x / 3) * 6 + x % 3, *b = a + 3072;
            const double want = ((double) a[0] + (double) a[3] + (double) b[0] + (double) b[3]) / 4;
            worst = fmax(worst, fabs(((float *) exr.pixels)[y * 1536 + x] - want) / fmax(want, 1e-3));
        }
    REQUIRE_NEAR(worst, 0, 6e-4); /* half */
    pell_image_finish(t.ctx, &hdr);
    pell_image_finish(t.ctx, &exr);
    image_test_end(&t);
}

/* --- PNG ---------------------------------------------------------------------------------------------------------------------- */

/* The variants encode the pattern by a plain power 1/2.2 in 8 bits. */
static int encoded(const struct pell_image *ref, int x, int y, int c)
{
    const float v = ((const float *) ref->pixels)[(y * 64 + x) * 3 + c];
    return (int) (255 * pow(fmin((double) v, 1), 1 / 2.2) + 0.5);
}

static void png_variants_hold_the_pattern(void **state)
{
    static const struct {
        const char *name;
        int channels, alpha; /* alpha: its channel, a ramp of 4 x */
        enum pell_pixel_type type;
        int grey;
    } files[] = {
        { "gray8", 1, -1, PELL_PIXEL_U8, 1 },      { "gray16", 1, -1, PELL_PIXEL_U16, 1 }, { "gray_alpha8", 2, 1, PELL_PIXEL_U8, 1 },
        { "rgb8", 3, -1, PELL_PIXEL_U8, 0 },       { "rgb16", 3, -1, PELL_PIXEL_U16, 0 },  { "rgba8", 4, 3, PELL_PIXEL_U8, 0 },
        { "rgba8_adam7", 4, 3, PELL_PIXEL_U8, 0 },
    };
    struct image_test t;
    struct pell_image ref;

    (void) state;
    image_test_begin(&t);
    ref = read_variant(&t, "exr/pattern_64x32.pfm", PELL_ROLE_COLOR);
    for (size_t i = 0; i < PELL_COUNT(files); i++) {
        char name[64];
        struct pell_image image;
        snprintf(name, sizeof(name), "png/%s.png", files[i].name);
        image = read_variant(&t, name, PELL_ROLE_COLOR);
        assert_int_equal(image.width, 64);
        assert_int_equal(image.height, 32);
        assert_int_equal(image.channels, files[i].channels);
        assert_int_equal(image.type, files[i].type);
        assert_true(image.srgb);
        for (int k = 0; k < 64 * 32 * image.channels; k++) {
            const int c = k % image.channels, x = k / image.channels % 64, y = k / image.channels / 64;
            const int got = image.type == PELL_PIXEL_U8 ? ((uint8_t *) image.pixels)[k] : ((uint16_t *) image.pixels)[k] / 257;
            const int want = c == files[i].alpha ? 4 * x : encoded(&ref, x, y, files[i].grey ? 1 : c);
            if (image.type == PELL_PIXEL_U16)
                assert_int_equal(((uint16_t *) image.pixels)[k] % 257, 0);
            if (abs(got - want) > (c == files[i].alpha ? 0 : 1))
                fail_msg("%s: (%d, %d) channel %d is %d, must be %d", name, x, y, c, got, want);
        }
        pell_image_finish(t.ctx, &image);
    }
    pell_image_finish(t.ctx, &ref);
    image_test_end(&t);
}

static void png_one_bit_is_spread_to_0_and_255(void **state)
{
    struct image_test t;
    struct pell_image image, grey;

    (void) state;
    image_test_begin(&t);
    grey = read_variant(&t, "png/gray8.png", PELL_ROLE_DATA);
    image = read_variant(&t, "png/gray1.png", PELL_ROLE_DATA);
    assert_int_equal(image.channels, 1);
    assert_int_equal(image.type, PELL_PIXEL_U8);
    assert_false(image.srgb);
    for (int y = 0; y < 32; y += 4) { /* dithered: four rows preserve their mean */
        int sum = 0, want = 0;
        for (int i = 0; i < 4 * 64; i++) {
            const uint8_t v = ((uint8_t *) image.pixels)[y * 64 + i];
            REQUIRE(v == 0 || v == 255);
            sum += v;
            want += ((uint8_t *) grey.pixels)[y * 64 + i];
        }
        REQUIRE_NEAR(sum / 256.0, want / 256.0, 8);
    }
    pell_image_finish(t.ctx, &image);
    pell_image_finish(t.ctx, &grey);
    image_test_end(&t);
}

static double mean_difference(const struct pell_image *a, const struct pell_image *b)
{
    const int count = a->width * a->height;
    double sum = 0;
    for (int i = 0; i < count; i++)
        for (int c = 0; c < 3; c++)
            sum += abs(((uint8_t *) a->pixels)[i * a->channels + (a->channels > 2 ? c : 0)] -
                       ((uint8_t *) b->pixels)[i * b->channels + (b->channels > 2 ? c : 0)]);
    return sum / (3.0 * count);
}

static void png_palettes_come_near_the_pattern(void **state)
{
    static const struct {
        const char *name;
        double mean; /* of 255: few colours for a noisy pattern */
    } files[] = { { "png/palette8.png", 12 }, { "png/palette8_trns.png", 12 }, { "png/palette4.png", 28 } };
    struct image_test t;
    struct pell_image rgb;

    (void) state;
    image_test_begin(&t);
    rgb = read_variant(&t, "png/rgb8.png", PELL_ROLE_COLOR);
    for (size_t i = 0; i < PELL_COUNT(files); i++) {
        struct pell_image image = read_variant(&t, files[i].name, PELL_ROLE_COLOR);
        assert_int_equal(image.channels, 3); /* the file called trns has no tRNS chunk */
        if (!(mean_difference(&image, &rgb) < files[i].mean))
            fail_msg("%s: mean difference %g of 255", files[i].name, mean_difference(&image, &rgb));
        pell_image_finish(t.ctx, &image);
    }
    pell_image_finish(t.ctx, &rgb);
    image_test_end(&t);
}

/* A PNG of `width` x 1 written by the library's own writer, as a palette or with a key colour. */
static uint8_t *make_png(const struct spng_ihdr *ihdr, struct spng_plte *plte, struct spng_trns *trns, const void *pixels, size_t bytes,
                         size_t *size)
{
    spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);
    struct spng_ihdr copy = *ihdr;
    uint8_t *file;
    int err;

    REQUIRE(png);
    assert_int_equal(spng_set_option(png, SPNG_ENCODE_TO_BUFFER, 1), 0);
    assert_int_equal(spng_set_ihdr(png, &copy), 0);
    if (plte)
        assert_int_equal(spng_set_plte(png, plte), 0);
    if (trns)
        assert_int_equal(spng_set_trns(png, trns), 0);
    assert_int_equal(spng_encode_image(png, pixels, bytes, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE), 0);
    file = spng_get_png_buffer(png, size, &err);
    REQUIRE(file && !err);
    spng_ctx_free(png);
    return file;
}

static void check_png(const struct spng_ihdr *ihdr, struct spng_plte *plte, struct spng_trns *trns, const void *pixels, size_t bytes,
                      int channels, enum pell_pixel_type type, const void *want)
{
    struct image_test t;
    struct pell_image image;
    size_t size, pixel = (size_t) channels * (type == PELL_PIXEL_U8 ? 1 : 2);
    uint8_t *file = make_png(ihdr, plte, trns, pixels, bytes, &size);

    image_test_begin(&t);
    image = decode_ok(&t, file, size, PELL_ROLE_COLOR);
    assert_int_equal(image.channels, channels);
    assert_int_equal(image.type, type);
    assert_memory_equal(image.pixels, want, pixel * ihdr->width * ihdr->height);
    pell_image_finish(t.ctx, &image);
    image_test_end(&t);
    free(file);
}

static void png_transparency_becomes_alpha(void **state)
{
    struct spng_plte plte = { .n_entries = 3, .entries = { { 10, 20, 30, 0 }, { 40, 50, 60, 0 }, { 70, 80, 90, 0 } } };
    struct spng_trns trns = { .n_type3_entries = 2, .type3_alpha = { 0, 128 } };
    struct spng_ihdr ihdr = { .width = 4, .height = 1, .bit_depth = 2, .color_type = SPNG_COLOR_TYPE_INDEXED };
    static const uint8_t want_palette[] = { 10, 20, 30, 0, 40, 50, 60, 128, 70, 80, 90, 255, 40, 50, 60, 128 };

    (void) state;
    check_png(&ihdr, &plte, &trns, "\x19", 1, 4, PELL_PIXEL_U8, want_palette); /* 0 1 2 1 */

    trns = (struct spng_trns) { .gray = 1 };
    ihdr = (struct spng_ihdr) { .width = 4, .height = 1, .bit_depth = 2, .color_type = SPNG_COLOR_TYPE_GRAYSCALE };
    check_png(&ihdr, NULL, &trns, "\x1b", 1, 2, PELL_PIXEL_U8, "\x00\xff\x55\x00\xaa\xff\xff\xff"); /* 0 1 2 3 */

    trns = (struct spng_trns) { .gray = 300 };
    ihdr = (struct spng_ihdr) { .width = 2, .height = 1, .bit_depth = 16, .color_type = SPNG_COLOR_TYPE_GRAYSCALE };
    check_png(&ihdr, NULL, &trns, (const uint16_t[]) { 300, 301 }, 4, 2, PELL_PIXEL_U16, (const uint16_t[]) { 300, 0, 301, 65535 });

    trns = (struct spng_trns) { .red = 1, .green = 2, .blue = 3 };
    ihdr = (struct spng_ihdr) { .width = 2, .height = 1, .bit_depth = 8, .color_type = SPNG_COLOR_TYPE_TRUECOLOR };
    check_png(&ihdr, NULL, &trns, "\1\2\3\1\2\4", 6, 4, PELL_PIXEL_U8, "\1\2\3\0\1\2\4\xff");

    ihdr.bit_depth = 16;
    check_png(&ihdr, NULL, &trns, (const uint16_t[]) { 1, 2, 3, 500, 2, 3 }, 12, 4, PELL_PIXEL_U16,
              (const uint16_t[]) { 1, 2, 3, 0, 500, 2, 3, 65535 });
}

static void png_small_depths_and_16_bit_grey_alpha(void **state)
{
    struct spng_ihdr ihdr = { .width = 4, .height = 1, .bit_depth = 4, .color_type = SPNG_COLOR_TYPE_GRAYSCALE };

    (void) state;
    check_png(&ihdr, NULL, NULL, "\x01\xef", 2, 1, PELL_PIXEL_U8, "\x00\x11\xee\xff");
    ihdr = (struct spng_ihdr) { .width = 2, .height = 1, .bit_depth = 16, .color_type = SPNG_COLOR_TYPE_GRAYSCALE_ALPHA };
    check_png(&ihdr, NULL, NULL, (const uint16_t[]) { 258, 1, 65535, 513 }, 8, 2, PELL_PIXEL_U16,
              (const uint16_t[]) { 258, 1, 65535, 513 });
}

/* --- JPEG --------------------------------------------------------------------------------------------------------------------- */

static void jpeg_variants_come_near_the_pattern(void **state)
{
    static const struct {
        const char *name;
        double mean; /* of 255: errors due to the quality and 4:2:0 subsampling of each file */
        int channels;
    } files[] = {
        { "jpeg/rgb_444_q95.jpg", 3, 3 },     { "jpeg/rgb_420_q90.jpg", 10, 3 }, { "jpeg/progressive.jpg", 10, 3 },
        { "jpeg/restart_markers.jpg", 5, 3 }, { "jpeg/cmyk.jpg", 2, 3 },
    };
    struct image_test t;
    struct pell_image rgb;

    (void) state;
    image_test_begin(&t);
    rgb = read_variant(&t, "png/rgb8.png", PELL_ROLE_COLOR);
    for (size_t i = 0; i < PELL_COUNT(files); i++) {
        struct pell_image image = read_variant(&t, files[i].name, PELL_ROLE_COLOR);
        assert_int_equal(image.width, 64);
        assert_int_equal(image.height, 32);
        assert_int_equal(image.channels, files[i].channels);
        assert_true(image.srgb);
        if (!(mean_difference(&image, &rgb) < files[i].mean))
            fail_msg("%s: mean difference %g of 255", files[i].name, mean_difference(&image, &rgb));
        pell_image_finish(t.ctx, &image);
    }
    assert_int_equal(t.kept.warnings, 1); /* CMYK has lost its profile */
    REQUIRE(strstr(t.kept.last_warning, "CMYK"));
    pell_image_finish(t.ctx, &rgb);
    image_test_end(&t);
}

static void jpeg_grey_stays_one_channel(void **state)
{
    struct image_test t;
    struct pell_image image, grey;

    (void) state;
    image_test_begin(&t);
    grey = read_variant(&t, "png/gray8.png", PELL_ROLE_DATA);
    image = read_variant(&t, "jpeg/gray.jpg", PELL_ROLE_DATA);
    assert_int_equal(image.channels, 1);
    REQUIRE(mean_difference(&image, &grey) < 1.5);
    pell_image_finish(t.ctx, &image);
    pell_image_finish(t.ctx, &grey);
    image_test_end(&t);
}

/* The pattern scaled to 61 x 29: red rises with x, green with y. */
static void jpeg_odd_size_keeps_its_edges(void **state)
{
    struct image_test t;
    struct pell_image image, rgb;
    double sum = 0;

    (void) state;
    image_test_begin(&t);
    rgb = read_variant(&t, "png/rgb8.png", PELL_ROLE_DATA);
    image = read_variant(&t, "jpeg/odd_61x29_420.jpg", PELL_ROLE_DATA);
    assert_int_equal(image.width, 61);
    assert_int_equal(image.height, 29);
    for (int y = 0; y < 29; y++)
        for (int x = 0; x < 61; x++) {
            float want[4];
            const uint8_t *got = (const uint8_t *) image.pixels + (y * 61 + x) * 3;
            pell_image_sample(&rgb, PELL_WRAP_CLAMP, PELL_WRAP_CLAMP, false, ((float) x + 0.5f) / 61, ((float) y + 0.5f) / 29, want);
            sum += fabs(got[0] / 255.0 - (double) want[0]) + fabs(got[1] / 255.0 - (double) want[1]);
        }
    REQUIRE_NEAR(sum / (61 * 29 * 2), 0, 0.04);
    pell_image_finish(t.ctx, &image);
    pell_image_finish(t.ctx, &rgb);
    image_test_end(&t);
}

/* All subsamplings that libjpeg-turbo writes, at odd sizes, against the constant colour of the image. */
static void jpeg_every_subsampling_and_odd_size(void **state)
{
    struct image_test t;

    (void) state;
    image_test_begin(&t);
    for (int sampling = 0; sampling < TJ_NUMSAMP; sampling++)
        for (int size = 1; size < 20; size += 3) {
            unsigned char *file = NULL, pixels[20 * 20 * 3];
            unsigned long bytes = 0;
            tjhandle jpeg = tjInitCompress();
            struct pell_image image;
            for (int i = 0; i < 20 * 20; i++)
                memcpy(pixels + 3 * i, sampling == TJSAMP_GRAY ? "\x80\x80\x80" : "\xc8\x64\x32", 3);
            assert_int_equal(
                tjCompress2(jpeg, pixels, size, 0, size + 1, TJPF_RGB, &file, &bytes, sampling, 95, size % 2 ? TJFLAG_PROGRESSIVE : 0), 0);
            image = decode_ok(&t, file, bytes, PELL_ROLE_COLOR);
            assert_int_equal(image.width, size);
            assert_int_equal(image.height, size + 1);
            for (int i = 0; i < size * (size + 1) * image.channels; i++)
                REQUIRE_NEAR(((uint8_t *) image.pixels)[i], image.channels == 1 ? 0x80 : pixels[i % 3], 3);
            pell_image_finish(t.ctx, &image);
            tjFree(file);
            tjDestroy(jpeg);
        }
    image_test_end(&t);
}

static void textures_of_a_head_load_in_half_a_second(void **state)
{
    static const char *const names[] = { "Map-COL.jpg", "Map-SPEC.jpg", "Infinite-Level_02_Tangent_SmoothUV.jpg",
                                         "Infinite-Level_02_Disp_NoSmoothUV-4096.jpg" };
    struct image_test t;
    double seconds = 0;

    (void) state;
    image_test_begin_shared(&t, "assets/head_lps");
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        char path[128];
        double start;
        struct pell_image image;
        snprintf(path, sizeof(path), "assets/head_lps/%s", names[i]);
        shared_file(path);
        start = pell_seconds();
        image = read_image(&t, shared_file(path), PELL_ROLE_COLOR);
        seconds += pell_seconds() - start;
        pell_image_finish(t.ctx, &image);
    }
    print_message("# four maps: %.0f ms\n", 1e3 * seconds);
    REQUIRE(seconds < 5); /* a sanitizer and a busy machine may be ten times slower */
    image_test_end(&t);
}

/* --- PFM, roles --------------------------------------------------------------------------------------------------------------- */

static void pfm_both_byte_orders_and_grey(void **state)
{
    static const uint8_t little[] = "Pf\n1 2\n-1.0\n\x00\x00\x80\x3f\x00\x00\x00\x40"; /* 1 below, 2 above */
    static const uint8_t big[] = "Pf 1 2 1.0\n\x3f\x80\x00\x00\x40\x00\x00\x00";
    static const uint8_t crlf[] = "PF\r\n1 1\r\n-1.0\r\n\x00\x00\x80\x3f\x00\x00\x00\x40\x00\x00\x40\x40";
    struct image_test t;
    struct pell_image image;

    (void) state;
    image_test_begin(&t);
    for (int i = 0; i < 2; i++) {
        image = decode_ok(&t, i ? big : little, (i ? sizeof(big) : sizeof(little)) - 1, PELL_ROLE_DATA);
        assert_int_equal(image.channels, 1);
        REQUIRE_NEAR(((float *) image.pixels)[0], 2, 0);
        REQUIRE_NEAR(((float *) image.pixels)[1], 1, 0);
        pell_image_finish(t.ctx, &image);
    }
    image = decode_ok(&t, crlf, sizeof(crlf) - 1, PELL_ROLE_DATA);
    assert_int_equal(image.channels, 3);
    for (int i = 0; i < 3; i++)
        REQUIRE_NEAR(((float *) image.pixels)[i], 1 + i, 0);
    pell_image_finish(t.ctx, &image);
    image_test_end(&t);
}

static void not_a_number_is_read_as_0_with_a_warning(void **state)
{
    static const uint8_t file[] = "PF\n1 1\n-1.0\n\x00\x00\xc0\x7f\x00\x00\x80\x7f\x00\x00\x80\xff";
    struct image_test t;
    struct pell_image image;
    int warnings;

    (void) state;
    image_test_begin(&t);
    image = decode_ok(&t, file, sizeof(file) - 1, PELL_ROLE_COLOR);
    REQUIRE_NEAR(((float *) image.pixels)[0], 0, 0);
    REQUIRE_NEAR(((float *) image.pixels)[1], 65504, 0);
    REQUIRE_NEAR(((float *) image.pixels)[2], -65504, 0);
    assert_int_equal(t.kept.warnings, 1);
    pell_image_finish(t.ctx, &image);
    warnings = t.kept.warnings;
    image = decode_ok(&t, file, sizeof(file) - 1, PELL_ROLE_RAW);
    assert_true(isnan(((float *) image.pixels)[0]) && isinf(((float *) image.pixels)[1]) && ((float *) image.pixels)[2] == -INFINITY);
    assert_int_equal(t.kept.warnings, warnings);
    pell_image_finish(t.ctx, &image);
    image_test_end(&t);
}

static void to_float_decodes_color_but_not_data_or_alpha(void **state)
{
    static const uint8_t pixels[] = { 188, 128, 64, 51 };
    const struct spng_ihdr ihdr = { .width = 1, .height = 1, .bit_depth = 8, .color_type = SPNG_COLOR_TYPE_TRUECOLOR_ALPHA };
    struct image_test t;
    struct pell_image image;
    size_t size;
    uint8_t *file = make_png(&ihdr, NULL, NULL, pixels, 4, &size);

    (void) state;
    image_test_begin(&t);
    for (int role = 0; role < 2; role++) {
        image = decode_ok(&t, file, size, (enum pell_image_role) role);
        assert_int_equal(pell_image_to_float(t.ctx, &image), PELL_OK);
        assert_int_equal(image.type, PELL_PIXEL_F32);
        assert_false(image.srgb);
        for (int c = 0; c < 4; c++)
            REQUIRE_NEAR(((float *) image.pixels)[c],
                         role == PELL_ROLE_COLOR && c < 3 ? pell_srgb_decode(pixels[c] / 255.0f) : pixels[c] / 255.0, 1e-6);
        assert_int_equal(pell_image_to_float(t.ctx, &image), PELL_OK); /* repeated: no effect */
        pell_image_finish(t.ctx, &image);
    }
    free(file);
    image_test_end(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exr_variants_hold_the_pattern),
        cmocka_unit_test(exr_luminance_is_one_channel),
        cmocka_unit_test(exr_alpha_becomes_straight_for_color_only),
        cmocka_unit_test(exr_data_window_is_placed_in_the_display_window),
        cmocka_unit_test(exr_dwa_is_refused_with_the_fix),
        cmocka_unit_test(exr_layers_hold_all_channels),
        cmocka_unit_test(exr_of_several_parts_gives_the_first_with_rgb),
        cmocka_unit_test(exr_deep_is_refused),
        cmocka_unit_test(hdr_variants_hold_the_pattern),
        cmocka_unit_test(hdr_all_eight_orientations),
        cmocka_unit_test(hdr_exposure_and_colorcorr_accumulate),
        cmocka_unit_test(environment_maps_agree_between_hdr_and_exr),
        cmocka_unit_test(png_variants_hold_the_pattern),
        cmocka_unit_test(png_one_bit_is_spread_to_0_and_255),
        cmocka_unit_test(png_palettes_come_near_the_pattern),
        cmocka_unit_test(png_transparency_becomes_alpha),
        cmocka_unit_test(png_small_depths_and_16_bit_grey_alpha),
        cmocka_unit_test(jpeg_variants_come_near_the_pattern),
        cmocka_unit_test(jpeg_grey_stays_one_channel),
        cmocka_unit_test(jpeg_odd_size_keeps_its_edges),
        cmocka_unit_test(jpeg_every_subsampling_and_odd_size),
        cmocka_unit_test(textures_of_a_head_load_in_half_a_second),
        cmocka_unit_test(pfm_both_byte_orders_and_grey),
        cmocka_unit_test(not_a_number_is_read_as_0_with_a_warning),
        cmocka_unit_test(to_float_decodes_color_but_not_data_or_alpha),
    };
    return cmocka_run_group_tests_name("image.read", tests, NULL, NULL);
}
