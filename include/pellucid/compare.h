/* SPDX-License-Identifier: MIT
 *
 * pellucid/compare.h - measures the difference between an image and a reference, as numbers and as maps.
 *
 *     pell_knobs_default(pell_compare_knobs(), &params);
 *     pell_compare(ctx, &input, &params, &result);      // any number of times
 *     pell_comparison_finish(ctx, &result);
 *
 * Let t be the test image, b the reference and d = t - b; means are over the selected pixels (the mask) and the three channels:
 *
 *     mse      mean d^2                                   in the image's unit, squared
 *     rel_mse  mean d^2 / (b^2 + e^2),                    e = floor x the mean of |luminance| of b over the selected pixels
 *     mae      mean |d|
 *     bias     mean d, by channel;  rel_bias  bias divided by the mean of b
 *     ssim     Wang et al. 2004: Gaussian window 11 x 11, sigma 1.5, K1 = 0.01, K2 = 0.03, of the displayed images, sRGB-encoded in [0, 1]:
 *              `ssim` of its luma (Rec.709 weights), `ssim_rgb` by channel; as published, the mean is over windows inside the image
 *     flip     Andersson et al. 2020, of the displayed images: 0 (identical) to 1
 *     flip_hdr Andersson et al. 2021: the largest FLIP over a range of exposures through the ACES curve of Narkowicz 2015
 *
 * A displayed image is the image times an exposure, mapped by a tone curve. Both images use the same exposure, metered on the reference.
 *
 * Noise      a sampled reference has a variance per pixel, or two independent halves, b1 and b2: then b is their mean, and (b1 - b2)^2/4
 *            estimates its variance. d^2 is replaced by (t - b1)(t - b2), or by d^2 - variance, whose expected value is d^2 for a reference
 *            without noise. In the denominator of rel_mse, b is replaced by the mean of its neighbours on the same side of the mask, in the
 *            smallest of four windows in which the noise of the mean is small. So mse and rel_mse are unbiased, may be negative where noise
 *            exceeds the error, and have standard errors; the noise of the test image is part of its error. Noise can't be subtracted from
 *            mae, ssim and flip. Z-test: struct pell_agreement. See docs/adr/0015-errors-under-noise.md
 * Bad pixels pixels with NaN or infinity in any channel of either image, or with a negative variance, are excluded and counted in
 *            `bad_test` and `bad_reference`; in the windows of neighbouring pixels both images get the reference's value there, or 0.
 * Mask       selects pixels where the mask is over 0.5. Windows and exposures use the whole image; only means are restricted.
 *
 * Units      images in any unit of light, the same for both; angles of the camera in degrees; times in seconds.
 * Ownership  planes of the input are borrowed for the call; maps of the result are released with pell_comparison_finish.
 * Errors     enum pell_result, logged once with the value and what is allowed.
 * Threads    calls are independent; each has its own thread pool. Results are bit-identical for any number of threads.
 */
#ifndef PELLUCID_COMPARE_H
#define PELLUCID_COMPARE_H

#include <pellucid/common.h>
#include <pellucid/knob.h>

#ifdef __cplusplus
extern "C" {
#endif

struct pell_context;

/* Tone curve from exposed radiance to the display: Reinhard et al. 2002 on luminance, as in `render`; ACES after Narkowicz 2015, as in
 * HDR-FLIP; none; the filmic curve of `render`. */
enum pell_compare_tonemap { PELL_COMPARE_REINHARD, PELL_COMPARE_ACES, PELL_COMPARE_LINEAR, PELL_COMPARE_FILMIC };

/* Defaults, ranges and help: pell_compare_knobs(). */
struct pell_compare_params {
    float ppd;      /* pixels per degree of the camera: distance x pixels/width x pi/180 */
    float exposure; /* of the displayed images; 0: 0.18 over the log-average luminance of the reference */
    float white;    /* luminance after exposure that becomes display white (reinhard); 0: the reference's largest, at least 1 */
    int tonemap;    /* enum pell_compare_tonemap */
    int exposures;  /* number for HDR-FLIP; 0: one per stop and at least 2, as published */
    float floor;
    int threads; /* 0: one per core */
};

/* The rows of struct pell_compare_params, ending with {0}. Constant data; thread-safe. */
PELL_API const struct pell_knob *pell_compare_knobs(void);

struct pell_compare_input {
    int width, height;
    ptrdiff_t stride; /* floats from row to row, of every plane */
    /* Linear Rec.709 in any unit of light; the three pointers may be equal. */
    const float *test[3], *reference[3];
    const float *half[3]; /* NULL, or the second half of the reference: `reference` is then the first */
    /* NULL, or squared standard errors of the reference; with two halves those of their mean, used only for `beyond_3`. */
    const float *variance[3];
    const float *test_variance[3]; /* NULL, or squared standard errors of the test image, for the standard errors of bias and the Z-test */
    const float *mask;             /* NULL: all pixels are selected */
    bool figures_only;             /* no maps are made: 16 bytes a pixel less */
    bool display;                  /* values are display values in [0, 1]: no exposure, no curve, no HDR-FLIP */
};

/* An mse is significant (distinguishable from noise) if it is larger than this many times its standard error. */
#define PELL_RESOLVED 2.0

/* Whether `value`, an mse or rel_mse, is significant; also true if the standard error is not known (NAN). Thread-safe. */
PELL_API bool pell_metric_resolved(double value, double standard_error);

/* Tests whether both images estimate the same light: z = d/sigma, with sigma^2 the sum of both images' variances. The test combines each
 * channel's mean and its sums over blocks of 16 x 16 pixels, which are nearly normally distributed whatever the noise of a pixel: it uses
 * the sum of their squares and the largest of them. */
struct pell_agreement {
    int64_t pixels, blocks; /* number of those that have noise and so are tested */
    double beyond_3;        /* fraction of values with |z| > 3; normal noise: 0.0027; NAN: no variance */
    double p;               /* upper bound of the probability that noise alone causes such differences; NAN: no noise is known */
};

struct pell_metrics {
    int64_t pixels;                  /* number of selected pixels; 0: all other members are 0 */
    double mse, rel_mse;             /* without the reference's noise; rel_mse is infinite where the reference is all black */
    double mse_error, rel_mse_error; /* standard errors due to noise; NAN: neither halves nor a variance */
    double bias_error[3], rel_bias_error[3];
    double noise_mse, noise_rel_mse;  /* the subtracted amounts: 0 without halves or a variance */
    double floor;                     /* e of rel_mse, in the unit of the images */
    double mae, bias[3], rel_bias[3]; /* rel_bias: 0 where the reference's mean is 0 */
    double ssim, ssim_rgb[3];
    double flip, flip_hdr; /* flip_hdr: 0 for display images */
    struct pell_agreement agreement;
};

struct pell_comparison {
    struct pell_metrics masked, whole; /* `whole`: without the mask */
    int64_t bad_test, bad_reference;   /* number of bad pixels; of the reference: in either half */
    int64_t bad_variance;              /* of bad_reference: those where only the variance is bad */
    float exposure, white;             /* the values used */
    /* HDR-FLIP: log2 of the first and last exposure, the number of exposures, and whether more than half of the reference is black, so that
     * the median of the other pixels was used. */
    double hdr_start, hdr_stop;
    int hdr_exposures;
    bool hdr_above_black;
    double seconds;
    int width, height;
    /* Maps, rows without padding, finite. `relative`: (Y_t - Y_b)/(|Y_b| + e), signed. NULL on failure; flip_hdr is NULL also for display
     * images. */
    float *relative, *ssim, *flip, *flip_hdr;
};

/* PELL_ERR_INVALID for knobs out of range or a size that is not positive or over image-pixels; PELL_ERR_NOMEM; PELL_ERR_CANCELLED.
 * `out` is {0} on failure. */
PELL_API PELL_NODISCARD enum pell_result pell_compare(struct pell_context *ctx, const struct pell_compare_input *input,
                                                      const struct pell_compare_params *params, struct pell_comparison *out);

/* Releases the maps of a comparison and sets it to {0}. */
PELL_API void pell_comparison_finish(struct pell_context *ctx, struct pell_comparison *comparison);

/* Colours of maps, sRGB-encoded in [0, 1]. Values are clamped to the range, NaN counts as 0. Thread-safe. */

/* Colour map magma (Smith and van der Walt 2015, CC0) for [0, 1]; dark: no difference. */
PELL_API void pell_color_magma(float value, float srgb[3]);
/* Diverging colour map for [-1, 1] (Moreland 2009): blue too dark, grey equal, red too bright. */
PELL_API void pell_color_diverging(float value, float srgb[3]);

#ifdef __cplusplus
}
#endif
#endif
