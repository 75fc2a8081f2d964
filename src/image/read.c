/* SPDX-License-Identifier: MIT
 *
 * read.c - reads an image of any format, detected from its content.
 */
#include "image/formats.h"

#include "base/file.h"

#include <string.h>

struct format {
    const char *title;
    size_t offset, length; /* position of the signature */
    const char *mark;
    /* NULL: not supported, */
    enum pell_result (*decode)(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image);
    /* but can be converted by this command */
    const char *fix;
    /* NULL: can't be read in pieces */
    enum pell_result (*rows)(struct pell_rows *rows);
};

/* clang-format off */
static const struct format formats[] = {
    { "PNG", 0, 8, "\x89PNG\r\n\x1a\n", pell_png_decode, NULL, pell_png_rows },
    { "JPEG", 0, 3, "\xff\xd8\xff", pell_jpeg_decode, NULL, NULL },
    { "OpenEXR", 0, 4, "\x76\x2f\x31\x01", pell_exr_decode, NULL, pell_exr_rows },
    { "Radiance HDR", 0, 2, "#?", pell_hdr_decode, NULL, pell_hdr_rows },
    { "PFM", 0, 3, "PF\n", pell_pfm_decode, NULL, pell_pfm_rows },
    { "PFM", 0, 3, "Pf\n", pell_pfm_decode, NULL, pell_pfm_rows },
    { "PFM", 0, 4, "PF\r\n", pell_pfm_decode, NULL, pell_pfm_rows },
    { "PFM", 0, 4, "Pf\r\n", pell_pfm_decode, NULL, pell_pfm_rows },
    { "PFM", 0, 3, "PF ", pell_pfm_decode, NULL, pell_pfm_rows },
    { "PFM", 0, 3, "Pf ", pell_pfm_decode, NULL, pell_pfm_rows },
    { "KTX2 (Basis Universal)", 0, 7, "\xabKTX 20", NULL, "ktx extract IN.ktx2 OUT.png", NULL },
    { "KTX", 0, 7, "\xabKTX 11", NULL, "ktx2ktx2 IN.ktx, then ktx extract IN.ktx2 OUT.png", NULL },
    { "DDS", 0, 4, "DDS ", NULL, "oiiotool IN.dds -o OUT.png", NULL },
    { "WebP", 8, 4, "WEBP", NULL, "dwebp IN.webp -o OUT.png", NULL },
    { "GIF", 0, 4, "GIF8", NULL, "oiiotool IN.gif --subimage 0 -o OUT.png", NULL },
    { "TIFF", 0, 4, "II*\0", NULL, "oiiotool IN.tif -o OUT.png, of floats OUT.exr", NULL },
    { "TIFF", 0, 4, "MM\0*", NULL, "oiiotool IN.tif -o OUT.png, of floats OUT.exr", NULL },
    { "Photoshop", 0, 4, "8BPS", NULL, "oiiotool IN.psd --subimage 0 -o OUT.png", NULL },
    { "AVIF or HEIC", 4, 4, "ftyp", NULL, "heif-convert IN OUT.png", NULL },
    { "JPEG XL", 0, 2, "\xff\x0a", NULL, "djxl IN.jxl OUT.png", NULL },
    { "JPEG XL", 4, 4, "JXL ", NULL, "djxl IN.jxl OUT.png", NULL },
    { "JPEG 2000", 4, 4, "jP  ", NULL, "opj_decompress -i IN.jp2 -o OUT.png", NULL },
    { "JPEG 2000", 0, 4, "\xff\x4f\xff\x51", NULL, "opj_decompress -i IN.j2k -o OUT.png", NULL },
    { "PGM", 0, 2, "P5", NULL, "pnmtopng IN.pgm > OUT.png", NULL },
    { "PPM", 0, 2, "P6", NULL, "pnmtopng IN.ppm > OUT.png", NULL },
    { "BMP", 0, 2, "BM", NULL, "bmptopnm IN.bmp | pnmtopng > OUT.png", NULL },
};
/* clang-format on */

static const struct format *find_format(const uint8_t *data, size_t size)
{
    for (size_t i = 0; i < PELL_COUNT(formats); i++) {
        const struct format *f = &formats[i];
        if (size >= f->offset + f->length && memcmp(data + f->offset, f->mark, f->length) == 0)
            return f;
    }
    return NULL;
}

enum pell_result (*pell_image_rows_of(const uint8_t *head, size_t size))(struct pell_rows *rows)
{
    const struct format *f = find_format(head, size);
    return f ? f->rows : NULL;
}

static enum pell_result refuse(struct pell_context *ctx, const char *name, const struct format *f)
{
    struct pell_text hint = { "" };

    pell_text_add(&hint, "convert it: %s", f->fix);
    return pell_error(ctx, PELL_ERR_UNSUPPORTED, name, hint.str, "%s images are not read; PNG, JPEG, Radiance HDR, OpenEXR and PFM are",
                      f->title);
}

enum pell_result pell_image_decode(struct pell_context *ctx, const char *name, const void *data, size_t size, enum pell_image_role role,
                                   struct pell_image *image)
{
    if (!ctx || !name || (!data && size) || !image)
        return pell_null(ctx, "pell_image_decode");

    const struct pell_source src = { .name = name, .data = data, .size = size, .role = role };
    const struct format *f;
    enum pell_result res;

    *image = (struct pell_image) { 0 };
    if (!data || size == 0)
        return pell_error(ctx, PELL_ERR_FORMAT, name, NULL, "the file is empty, must be a PNG, JPEG, Radiance HDR, OpenEXR or PFM image");
    if ((f = find_format(data, size))) {
        if (!f->decode)
            return refuse(ctx, name, f);
        res = f->decode(ctx, &src, image);
        if (res == PELL_OK)
            image->srgb = role != PELL_ROLE_DATA && image->type != PELL_PIXEL_F32;
        else
            pell_image_finish(ctx, image);
        return res;
    }
    return pell_error(ctx, PELL_ERR_FORMAT, name, "convert it to PNG, JPEG or OpenEXR",
                      "the first bytes (%02x %02x %02x %02x) are not those of a PNG, JPEG, Radiance HDR, OpenEXR or PFM image", src.data[0],
                      size > 1 ? src.data[1] : 0, size > 2 ? src.data[2] : 0, size > 3 ? src.data[3] : 0);
}

enum pell_result pell_image_read(struct pell_context *ctx, const char *path, enum pell_image_role role, struct pell_image *image)
{
    if (!ctx || !path || !image)
        return pell_null(ctx, "pell_image_read");

    enum pell_result res;
    uint8_t *data = NULL;
    size_t size = 0;

    *image = (struct pell_image) { 0 };
    PELL_TRY(pell_file_read(ctx, path, &data, &size));
    PELL_TRY(pell_image_decode(ctx, path, data, size, role, image));
fail:
    pell_free(ctx, data);
    return res;
}
