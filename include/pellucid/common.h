/* SPDX-License-Identifier: MIT
 *
 * pellucid/common.h - results, export marks and the small types that every header shares.
 *
 * Units      everywhere lengths mm, coefficients 1/mm, angles in radians unless a name ends in _deg, colour linear Rec.709
 *            (channel 0, 1, 2 = R, G, B), irradiance and radiant exitance W/m^2, radiance W/(m^2 sr).
 * Ownership  returned strings are constant.
 * Errors     enum pell_result, below. In all headers, functions that return it refuse NULL (PELL_ERR_INVALID) for a pointer whose comment
 *            doesn't allow it; an array of no elements may be NULL. Other functions trust their pointers.
 * Threads    all functions are pure and safe.
 */
#ifndef PELLUCID_COMMON_H
#define PELLUCID_COMMON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define PELL_API __attribute__((visibility("default")))
#define PELL_NODISCARD __attribute__((warn_unused_result))
#define PELL_PRINTF(fmt, args) __attribute__((format(printf, fmt, args)))
#else
#define PELL_API
#define PELL_NODISCARD
#define PELL_PRINTF(fmt, args)
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Result of a function that can fail. The function that detects an error logs it once, through the context; callers that pass it on
 * do not. Values are stable. */
enum pell_result {
    PELL_OK = 0,
    PELL_ERR_INVALID = -1,     /* an argument or a user's value is out of range */
    PELL_ERR_NOMEM = -2,       /* out of memory, or over the memory limit */
    PELL_ERR_IO = -3,          /* a file can't be opened, read or written */
    PELL_ERR_FORMAT = -4,      /* a file is damaged or breaks its format's rules */
    PELL_ERR_UNSUPPORTED = -5, /* well formed, but not supported by this build */
    PELL_ERR_DEVICE = -6,      /* the requested engine or device does not exist, or was lost */
    PELL_ERR_CANCELLED = -7,   /* the context's cancel flag was raised */
};

/* A short name in English ("invalid value"); never NULL, for any number. Thread-safe. */
PELL_API const char *pell_result_name(enum pell_result result);

/* A half-open rectangle of pixels: x0 <= x < x1, y0 <= y < y1; empty when x0 >= x1 or y0 >= y1. */
struct pell_rect {
    int x0, y0, x1, y1;
};

#ifdef __cplusplus
}
#endif
#endif
