/* SPDX-License-Identifier: MIT
 *
 * reference_frame.h - results of a reference method's last frame besides the light; a reference is a single pass on the CPU.
 */
#ifndef PELL_METHODS_REFERENCE_FRAME_H
#define PELL_METHODS_REFERENCE_FRAME_H

#include "base/base.h"
#include "base/hash.h"

#include <pellucid/method.h>

#include <math.h>

/* One image, or one of two independent images with half of the samples each. */
enum reference_half { REFERENCE_WHOLE, REFERENCE_FIRST_HALF, REFERENCE_SECOND_HALF };

/* The number of images that share the work of one. */
static inline int reference_images(int half)
{
    return half == REFERENCE_WHOLE ? 1 : 2;
}

static inline uint32_t reference_half_seed(uint32_t seed, int half)
{
    return half == REFERENCE_WHOLE ? seed : pell_hash(seed ^ 0x9e3779b9u * (uint32_t) half);
}

/* The target relative standard error of one of `samples` multisamples, of the whole image or of one of two half images, such that their
 * mean has the relative error `error`. */
static inline double reference_sample_error(double error, int half, int samples)
{
    return error * sqrt((double) reference_images(half) * (samples > 1 ? samples : 1));
}

/* The first member of the method's state: the functions below implement struct pell_method_engine. */
struct reference_frame {
    struct pell_pass_time time; /* name NULL: none yet */
    float *standard_error[3];   /* planes of the frame's stride, in one block; NULL: unknown */
};

/* Reports `done` of `all` parts of a sample of the image. */
static inline void reference_progress(struct pell_context *ctx, const char *method, const struct pell_frame *in, int done, int all)
{
    const double part = done < all ? (double) done / all : 1.0;

    pell_progress(ctx, method, in->num_samples > 1 ? (in->sample + part) / in->num_samples : part);
}

static inline size_t reference_times(const void *state, struct pell_pass_time *times, size_t size)
{
    const struct reference_frame *f = state;

    if (size < 1 || !f->time.name)
        return 0;
    times[0] = f->time;
    return 1;
}

static inline bool reference_standard_error(const void *state, const float *planes[3])
{
    const struct reference_frame *f = state;

    for (int c = 0; c < 3; c++)
        planes[c] = f->standard_error[c];
    return true;
}

static inline PELL_NODISCARD enum pell_result reference_make_planes(struct pell_context *ctx, const struct pell_frame_shape *shape,
                                                                    struct reference_frame *f)
{
    const size_t pixels = (size_t) shape->stride * (size_t) shape->height;
    float *block = pell_calloc(ctx, 3 * pixels, sizeof(float));

    for (int c = 0; block && c < 3; c++)
        f->standard_error[c] = block + (size_t) c * pixels;
    return block ? PELL_OK : PELL_ERR_NOMEM;
}

#endif
