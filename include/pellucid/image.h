/* SPDX-License-Identifier: MIT
 *
 * pellucid/image.h - images in memory, and functions that read and write image files.
 *
 * Formats    read: PNG 1 to 16 bit, JPEG, Radiance HDR, OpenEXR (not DWA, deep, subsampled), PFM; written: PNG, HDR, EXR with
 *            layers, PFM.
 * Layout     interleaved rows, top row first, left to right, no padding.
 * Units      pixels; colour linear Rec.709 or sRGB-encoded, as each image says.
 * Ownership  an image that a function fills is released with pell_image_finish.
 * Errors     logged with the file, the location, the value and the allowed range; no partial file remains.
 * Threads    all functions are safe; an image belongs to one thread while it is written.
 */
#ifndef PELLUCID_IMAGE_H
#define PELLUCID_IMAGE_H

#include <pellucid/common.h>

#ifdef __cplusplus
extern "C" {
#endif

struct pell_context;

enum pell_pixel_type { PELL_PIXEL_U8, PELL_PIXEL_U16, PELL_PIXEL_F32 };

/* The meaning of a file's values. The caller defines it; it is never guessed from the content. */
enum pell_image_role {
    PELL_ROLE_COLOR, /* 8 and 16 bit integers are sRGB-encoded; floats are linear */
    PELL_ROLE_DATA,  /* normals, roughness, masks, lengths: linear, never passed through a colour transform */
    PELL_ROLE_RAW,   /* as COLOR, but floats stay as stored, for measurements: also NaN, infinity, premultiplied alpha */
};

struct pell_image {
    int width, height;
    int channels; /* 1 grey, 2 grey + alpha, 3 RGB, 4 RGB + alpha (straight, never premultiplied) */
    enum pell_pixel_type type;
    bool srgb; /* colour channels are sRGB-encoded (alpha never is) */
    void *pixels;
};

/* Addressing mode for coordinates outside [0, 1). */
enum pell_wrap { PELL_WRAP_REPEAT, PELL_WRAP_CLAMP, PELL_WRAP_MIRROR };

/* Reads a file by its content (the file name's extension is ignored). Limits: image-pixels, file-bytes, memory-bytes. `image` is {0} on
 * failure. The layout is the narrowest that holds the file: grey stays 1 channel, a palette becomes 8 bit RGB(A), a key colour alpha. Float
 * files are made finite (NaN 0, infinity +-65504, with a warning) unless RAW. EXR: R, G, B (A), else Y (A), else the first layer with R, G,
 * B, else a single channel, over the display window; 0 outside the data window; COLOR: divided by an alpha in (0, 1), because EXR's is
 * premultiplied. HDR: divided by EXPOSURE and COLORCORR. CMYK JPEG: converted without a profile, with a warning. */
PELL_API PELL_NODISCARD enum pell_result pell_image_read(struct pell_context *ctx, const char *path, enum pell_image_role role,
                                                         struct pell_image *image);

/* The same from memory; `name` is used in messages. */
PELL_API PELL_NODISCARD enum pell_result pell_image_decode(struct pell_context *ctx, const char *name, const void *data, size_t size,
                                                           enum pell_image_role role, struct pell_image *image);

/* Converts in place to linear floats (sRGB decoded where the image is sRGB-encoded). */
PELL_API PELL_NODISCARD enum pell_result pell_image_to_float(struct pell_context *ctx, struct pell_image *image);

/* Releases the pixels of an image and sets it to {0}. */
PELL_API void pell_image_finish(struct pell_context *ctx, struct pell_image *image);

/* --- All channels of an OpenEXR file -------------------------------------------------------------------------------------------- */

/* One channel over the display window, top row first; 0 outside the data window. Values as stored: may be infinite or NaN. */
struct pell_layer {
    char *name;  /* "R", "diffuse.multiple.G"; in a file with several parts: "part.R" */
    float *data; /* width * height */
};

struct pell_layer_attribute {
    char *name, *value;
};

struct pell_layers {
    int width, height;
    size_t count;
    struct pell_layer *layers; /* sorted by name within a part */
    size_t num_attributes;
    struct pell_layer_attribute *attributes; /* the text attributes of the first part, sorted by name */
};

/* `layers` is {0} on failure; release it with pell_layers_finish. */
PELL_API PELL_NODISCARD enum pell_result pell_exr_read(struct pell_context *ctx, const char *path, struct pell_layers *layers);
PELL_API void pell_layers_finish(struct pell_context *ctx, struct pell_layers *layers);

/* --- Writing ------------------------------------------------------------------------------------------------------------------ */

/* One channel of an image to write: floats, `stride` floats from row to row. */
struct pell_channel {
    const char *name; /* EXR: "R", "diffuse.multiple.G", "depth.Z" */
    const float *data;
    ptrdiff_t stride;
    bool full_float; /* EXR: store 32 bits; else 16 */
};

struct pell_attribute {
    const char *name, *value;
};

enum pell_exr_compression { PELL_EXR_PIZ, PELL_EXR_ZIPS, PELL_EXR_ZIP, PELL_EXR_NONE };

struct pell_write_params {
    int width, height;
    /* PNG, HDR, PFM take channels 0..2 as R, G, B, or 0 as grey if there are 1 or 2; PNG takes 3 as straight alpha if it is called "A". */
    const struct pell_channel *channels;
    size_t num_channels;
    const struct pell_attribute *attributes; /* EXR and PNG text; may be NULL */
    size_t num_attributes;
    enum pell_exr_compression compression;
    int png_bits; /* 8 (also 0) or 16 */
};

/* Writes `path` in the format of its extension, or of `format` ("png", "exr", "hdr", "pfm") where that is not NULL (path "-" needs it).
 * PNG: values are display-referred in [0, 1] and are sRGB-encoded here, with a fixed ordered dither of under one step; other formats
 * hold the values as they are, clamped to the range of their type (half: +-65504; HDR: 0 and up), counted in one warning. NaN and
 * infinity are written as 0 and counted in one warning. Atomic. */
PELL_API PELL_NODISCARD enum pell_result pell_image_write(struct pell_context *ctx, const char *path, const char *format,
                                                          const struct pell_write_params *params);

/* The formats that pell_image_write takes, which are also the file extensions: "png", "exr", "hdr", "pfm"; NULL for an index of
 * pell_write_format_count() or more. Constant data; thread-safe. */
PELL_API size_t pell_write_format_count(void);
PELL_API const char *pell_write_format_at(size_t index);

#ifdef __cplusplus
}
#endif
#endif
