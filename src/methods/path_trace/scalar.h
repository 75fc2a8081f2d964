/* SPDX-License-Identifier: MIT
 *
 * scalar.h - functions.inc for single floats: pt_log, pt_exp, pt_circle, pt_hg, ...
 */
#ifndef PELL_PATH_TRACE_SCALAR_H
#define PELL_PATH_TRACE_SCALAR_H

#include "math/vec.h"
#include "shared/phase.h"

#define REAL float
#define INT int32_t
#define FN(name) pt_##name
#define PICK(c, a, b) ((c) ? (a) : (b))
#define ALL(x) (x)
#define ROOT(x) sqrtf(x)
#define AS_REAL(i) ((float) (i))
#define AS_INT(x) ((int32_t) (x))
#define BITS(x) pell_float_bits(x)
#define OF_BITS(i) pell_bits_float(i)
#include "methods/path_trace/functions.inc"
#undef REAL
#undef INT
#undef FN
#undef PICK
#undef ALL
#undef ROOT
#undef AS_REAL
#undef AS_INT
#undef BITS
#undef OF_BITS

#endif
