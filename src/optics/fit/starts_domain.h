/* SPDX-License-Identifier: MIT
 *
 * starts_domain.h - the coordinates of starts.h, both in [-1, 1]: of x = sigma_tr zr in [0, sqrt 3], with room for the bend that
 * absorption makes, and of q = zv/zr. */
#ifndef PELL_OPTICS_FIT_STARTS_DOMAIN_H
#define PELL_OPTICS_FIT_STARTS_DOMAIN_H

#include <math.h>

#define START_X 8
#define START_Q 3
#define START_X_MAX 1.7320508075688772
#define START_Q_MIN 2.3  /* a refractive index from 1 .. */
#define START_Q_MAX 12.5 /* .. to 2 */
#define START_BEND 0.01

static inline double start_x_of(double t)
{
    return START_BEND * sinh(0.5 * (1.0 + t) * asinh(START_X_MAX / START_BEND));
}

static inline double start_t_of_x(double x)
{
    return 2.0 * asinh(x / START_BEND) / asinh(START_X_MAX / START_BEND) - 1.0;
}

static inline double start_q_of(double t)
{
    return START_Q_MIN * pow(START_Q_MAX / START_Q_MIN, 0.5 * (1.0 + t));
}

static inline double start_t_of_q(double q)
{
    return 2.0 * log(q / START_Q_MIN) / log(START_Q_MAX / START_Q_MIN) - 1.0;
}

#endif
