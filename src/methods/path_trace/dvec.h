/* SPDX-License-Identifier: MIT
 *
 * dvec.h - vectors of double, for beams: how they widen is asked in more digits than floats have.
 */
#ifndef PELL_PATH_TRACE_DVEC_H
#define PELL_PATH_TRACE_DVEC_H

#include "math/vec.h"

struct dvec {
    double x, y, z;
};

static inline struct dvec wide(struct pell_vec3 a)
{
    return (struct dvec){ (double) a.x, (double) a.y, (double) a.z };
}

static inline struct pell_vec3 narrow(struct dvec a)
{
    return vec3((float) a.x, (float) a.y, (float) a.z);
}

static inline double dot(struct dvec a, struct dvec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

/* a + s b */
static inline struct dvec mad(struct dvec a, double s, struct dvec b)
{
    return (struct dvec){ a.x + s * b.x, a.y + s * b.y, a.z + s * b.z };
}

static inline struct dvec scale(double s, struct dvec a)
{
    return (struct dvec){ s * a.x, s * a.y, s * a.z };
}

static inline struct dvec cross(struct dvec a, struct dvec b)
{
    return (struct dvec){ a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}

static inline struct dvec unit(struct dvec a)
{
    const double length = sqrt(dot(a, a));
    return length > 0.0 ? scale(1.0 / length, a) : a;
}

#endif
