/* SPDX-License-Identifier: MIT
 *
 * vec.h - three-component vectors, single and double, and 4x4 matrices. Pure.
 *
 * Matrices are column-major (element of row r, column c at m[4 c + r]) and act on column vectors, as in glTF.
 */
#ifndef PELL_VEC_H
#define PELL_VEC_H

#include "shared/language.h" /* PELL_PI_F */

#include <math.h>

#define PELL_PI 3.14159265358979323846

struct pell_vec3 {
    float x, y, z;
};

struct pell_mat4 {
    double m[16];
};

static inline struct pell_vec3 vec3(float x, float y, float z)
{
    return (struct pell_vec3) { x, y, z };
}

static inline struct pell_vec3 vec3_load(const float *p)
{
    return vec3(p[0], p[1], p[2]);
}

static inline void vec3_store(struct pell_vec3 a, float *p)
{
    p[0] = a.x;
    p[1] = a.y;
    p[2] = a.z;
}

static inline struct pell_vec3 vec3_add(struct pell_vec3 a, struct pell_vec3 b)
{
    return vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}

static inline struct pell_vec3 vec3_sub(struct pell_vec3 a, struct pell_vec3 b)
{
    return vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}

static inline struct pell_vec3 vec3_mul(struct pell_vec3 a, float s)
{
    return vec3(a.x * s, a.y * s, a.z * s);
}

/* a + s b */
static inline struct pell_vec3 vec3_mad(struct pell_vec3 a, float s, struct pell_vec3 b)
{
    return vec3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}

static inline float vec3_dot(struct pell_vec3 a, struct pell_vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct pell_vec3 vec3_cross(struct pell_vec3 a, struct pell_vec3 b)
{
    return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static inline float vec3_length(struct pell_vec3 a)
{
    return sqrtf(vec3_dot(a, a));
}

/* Largest absolute value of the coordinates (maximum norm). */
static inline float vec3_max_abs(struct pell_vec3 a)
{
    return fmaxf(fabsf(a.x), fmaxf(fabsf(a.y), fabsf(a.z)));
}

/* The zero vector is unchanged. */
static inline struct pell_vec3 vec3_normalize(struct pell_vec3 a)
{
    const float l = vec3_length(a);
    return l > 0.0f ? vec3_mul(a, 1.0f / l) : a;
}

/* Two unit vectors perpendicular to the unit vector n and to each other (Duff et al. 2017, "Building an Orthonormal Basis, Revisited"); t x
 * b = n. */
static inline void vec3_basis(struct pell_vec3 n, struct pell_vec3 *t, struct pell_vec3 *b)
{
    const float s = copysignf(1.0f, n.z), a = -1.0f / (s + n.z), c = n.x * n.y * a;
    *t = vec3(1.0f + s * n.x * n.x * a, s * c, -s * n.x);
    *b = vec3(c, s + n.y * n.y * a, -n.y);
}

/* --- The same in double precision ------------------------------------------------------------------------------------------------ */

struct pell_dvec3 {
    double x, y, z;
};

static inline struct pell_dvec3 dvec3(double x, double y, double z)
{
    return (struct pell_dvec3) { x, y, z };
}

static inline struct pell_dvec3 dvec3_load(const float *p)
{
    return dvec3((double) p[0], (double) p[1], (double) p[2]);
}

static inline struct pell_dvec3 dvec3_widen(struct pell_vec3 a)
{
    return dvec3((double) a.x, (double) a.y, (double) a.z);
}

static inline struct pell_vec3 dvec3_narrow(struct pell_dvec3 a)
{
    return vec3((float) a.x, (float) a.y, (float) a.z);
}

static inline struct pell_dvec3 dvec3_sub(struct pell_dvec3 a, struct pell_dvec3 b)
{
    return dvec3(a.x - b.x, a.y - b.y, a.z - b.z);
}

static inline struct pell_dvec3 dvec3_mul(struct pell_dvec3 a, double s)
{
    return dvec3(a.x * s, a.y * s, a.z * s);
}

/* a + s b */
static inline struct pell_dvec3 dvec3_mad(struct pell_dvec3 a, double s, struct pell_dvec3 b)
{
    return dvec3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}

static inline double dvec3_dot(struct pell_dvec3 a, struct pell_dvec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct pell_dvec3 dvec3_cross(struct pell_dvec3 a, struct pell_dvec3 b)
{
    return dvec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

/* The zero vector is unchanged. */
static inline struct pell_dvec3 dvec3_normalize(struct pell_dvec3 a)
{
    const double l = sqrt(dvec3_dot(a, a));
    return l > 0.0 ? dvec3_mul(a, 1.0 / l) : a;
}

/* a - b */
static inline struct pell_dvec3 dvec3_between(struct pell_vec3 a, struct pell_vec3 b)
{
    return dvec3_sub(dvec3_widen(a), dvec3_widen(b));
}

/* --- Matrices ---------------------------------------------------------------------------------------------------------------------- */

static inline struct pell_mat4 mat4_identity(void)
{
    return (struct pell_mat4) { { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 } };
}

static inline struct pell_mat4 mat4_mul(const struct pell_mat4 *a, const struct pell_mat4 *b)
{
    struct pell_mat4 r;
    for (int c = 0; c < 4; c++)
        for (int i = 0; i < 4; i++) {
            double s = 0.0;
            for (int k = 0; k < 4; k++)
                s += a->m[4 * k + i] * b->m[4 * c + k];
            r.m[4 * c + i] = s;
        }
    return r;
}

static inline struct pell_vec3 mat4_point(const struct pell_mat4 *a, struct pell_vec3 p)
{
    return vec3((float) (a->m[0] * p.x + a->m[4] * p.y + a->m[8] * p.z + a->m[12]),
                (float) (a->m[1] * p.x + a->m[5] * p.y + a->m[9] * p.z + a->m[13]),
                (float) (a->m[2] * p.x + a->m[6] * p.y + a->m[10] * p.z + a->m[14]));
}

static inline struct pell_vec3 mat4_direction(const struct pell_mat4 *a, struct pell_vec3 p)
{
    return vec3((float) (a->m[0] * p.x + a->m[4] * p.y + a->m[8] * p.z), (float) (a->m[1] * p.x + a->m[5] * p.y + a->m[9] * p.z),
                (float) (a->m[2] * p.x + a->m[6] * p.y + a->m[10] * p.z));
}

/* Determinant of the upper left 3x3: negative if the matrix mirrors. */
static inline double mat4_determinant3(const struct pell_mat4 *a)
{
    const double *m = a->m;
    return m[0] * (m[5] * m[10] - m[9] * m[6]) - m[4] * (m[1] * m[10] - m[9] * m[2]) + m[8] * (m[1] * m[6] - m[5] * m[2]);
}

/* Normals: the cofactor matrix of the 3x3 part (inverse transpose times the determinant), not normalised; mirroring does not flip them. */
static inline struct pell_vec3 mat4_normal(const struct pell_mat4 *a, struct pell_vec3 n)
{
    const double *m = a->m, s = mat4_determinant3(a) < 0.0 ? -1.0 : 1.0;
    const double c0 = m[5] * m[10] - m[6] * m[9], c1 = m[6] * m[8] - m[4] * m[10], c2 = m[4] * m[9] - m[5] * m[8];
    const double c3 = m[2] * m[9] - m[1] * m[10], c4 = m[0] * m[10] - m[2] * m[8], c5 = m[1] * m[8] - m[0] * m[9];
    const double c6 = m[1] * m[6] - m[2] * m[5], c7 = m[2] * m[4] - m[0] * m[6], c8 = m[0] * m[5] - m[1] * m[4];
    return vec3((float) (s * (c0 * n.x + c3 * n.y + c6 * n.z)), (float) (s * (c1 * n.x + c4 * n.y + c7 * n.z)),
                (float) (s * (c2 * n.x + c5 * n.y + c8 * n.z)));
}

#endif
