/* SPDX-License-Identifier: MIT
 *
 * solve.c - refracting points in one triangle.
 *
 * With the geometric normal the path minimises the travel time through the triangle's plane (Fermat), which is a convex problem: Newton's
 * method with a bracket. With interpolated normals H x n = 0 (connect.c) is solved over (u, v): the triangle is subdivided until H x n is
 * nearly linear, so that a root is found, or excluded, at once.
 *
 * The spread of a narrow beam around the path follows from the derivative of the implicit function (u, v)(x). */
#include "transport/refraction/internal.h"

#define QUARTERS 4
#define MAX_PARTS 4000      /* maximum number of subdivisions of a triangle before it is given up */
#define MAX_DEPTH 20        /* maximum subdivision depth */
#define NEARLY_LINEAR 0.4   /* size over the distance to x or the light: below it H x n is evaluated */
#define EDGE_TOLERANCE 1e-9 /* barycentric tolerance outside of a triangle, so that no root on a shared edge is missed */
#define SAME_ROOT 1e-6      /* relative to a triangle's size: closer roots of two triangles are duplicates on their common edge */

/* Keeps a path unless an adjacent triangle has found it already; if there are too many, keeps the nearest ones. */
static void keep(struct query *q, const struct path *p)
{
    int at = q->count;

    if (!(p->inside_mm <= q->reach) || !(p->spread < INFINITY) || !(p->inside_mm > 0.0))
        return;
    for (int i = 0; i < q->count; i++) {
        const struct pell_dvec3 d = dvec3_sub(q->paths[i].at, p->at);
        const double near = SAME_ROOT * fmin(q->paths[i].size, p->size);
        if (dvec3_dot(d, d) <= near * near)
            return;
    }
    if (q->count == PELL_CONNECTIONS) {
        at = 0;
        for (int i = 1; i < q->count; i++)
            if (q->paths[i].inside_mm > q->paths[at].inside_mm)
                at = i;
        if (p->inside_mm >= q->paths[at].inside_mm)
            return;
    } else {
        q->count++;
    }
    q->paths[at] = *p;
}

/* Distance from the projection of x, along the plane, to the refracting point: x is `below` the plane, the light `above` it, their
 * projections are `offset`. */
static double planar_shift(double eta, double below, double above, double offset)
{
    const double straight = offset * below / (below + above);
    double low = 0.0, high = offset, s;

    /* The ray is closer to the normal on the side with the larger index, and never beyond the critical angle there. */
    if (eta > 1.0) {
        high = fmin(straight, below / sqrt(eta * eta - 1.0));
    } else if (eta < 1.0) {
        low = fmax(straight, offset - above * eta / sqrt(1.0 - eta * eta));
    }
    s = fmin(fmax(offset * below / (below + eta * above), low), high);
    for (int i = 0; i < 64; i++) {
        const double rest = offset - s, a2 = s * s + below * below, b2 = rest * rest + above * above;
        const double a = 1.0 / sqrt(a2), b = 1.0 / sqrt(b2);
        const double f = eta * s * a - rest * b, slope = eta * below * below * a * a * a + above * above * b * b * b;
        double next;
        if (f > 0.0)
            high = s;
        else
            low = s;
        next = s - f / slope;
        if (!(next >= low && next <= high))
            next = 0.5 * (low + high);
        if (fabs(next - s) <= 1e-15 * offset)
            return next;
        s = next;
    }
    return s;
}

static void solve_planar(struct query *q, const struct facet *f)
{
    const struct pell_dvec3 p0 = dvec3_load(f->p[0]), e1 = dvec3_sub(dvec3_load(f->p[1]), p0), e2 = dvec3_sub(dvec3_load(f->p[2]), p0);
    const struct pell_dvec3 cr = dvec3_cross(e1, e2);
    const double area2 = dvec3_dot(cr, cr), inverse = 1.0 / sqrt(area2);
    const struct pell_dvec3 n = dvec3_mul(cr, inverse);
    const double below = -dvec3_dot(dvec3_sub(q->x, p0), n);
    struct path p = { .facet = f, .normal = n };
    double s, offset, cos_i;
    struct pell_dvec3 foot, along, d, out;

    if (!(below > 0.0))
        return;
    foot = dvec3_mad(q->x, below, n);
    if (q->distant) {
        p.cos_o = dvec3_dot(q->light, n);
        along = dvec3_mad(q->light, -p.cos_o, n);
        offset = sqrt(dvec3_dot(along, along));
        s = offset / q->eta;
        if (!(p.cos_o > 0.0) || !(s < 1.0))
            return;
        s = below * s / sqrt(1.0 - s * s);
    } else {
        const struct pell_dvec3 to = dvec3_sub(q->light, p0);
        const double above = dvec3_dot(to, n);
        if (!(above > 0.0))
            return;
        along = dvec3_sub(dvec3_mad(q->light, -above, n), foot);
        offset = sqrt(dvec3_dot(along, along));
        s = planar_shift(q->eta, below, above, offset);
    }
    p.at = offset > 0.0 ? dvec3_mad(foot, s / offset, along) : foot;
    d = dvec3_sub(p.at, p0);
    p.u = dvec3_dot(dvec3_cross(d, e2), n) * inverse;
    p.v = dvec3_dot(dvec3_cross(e1, d), n) * inverse;
    if (!(p.u >= -EDGE_TOLERANCE && p.v >= -EDGE_TOLERANCE && p.u + p.v <= 1.0 + EDGE_TOLERANCE))
        return;
    p.inside_mm = sqrt(s * s + below * below);
    p.inside = dvec3_mul(dvec3_sub(p.at, q->x), 1.0 / p.inside_mm);
    cos_i = below / p.inside_mm;
    if (q->distant) {
        p.outside = q->light;
        p.outside_mm = INFINITY;
        p.spread = p.cos_o / cos_i;
    } else {
        /* Spread in the plane of incidence and perpendicular to it. */
        double across, within;
        out = dvec3_sub(q->light, p.at);
        p.outside_mm = sqrt(dvec3_dot(out, out));
        p.outside = dvec3_mul(out, 1.0 / p.outside_mm);
        p.cos_o = dvec3_dot(p.outside, n);
        across = p.inside_mm / q->eta + p.outside_mm;
        within = p.outside_mm * cos_i / p.cos_o + p.inside_mm * p.cos_o / (q->eta * cos_i);
        p.spread = 1.0 / (across * within);
    }
    p.facing_in = cos_i;
    p.facing_out = p.cos_o;
    p.size = sqrt(fmax(dvec3_dot(e1, e1), dvec3_dot(e2, e2)));
    keep(q, &p);
}

/* --- Interpolated normals ----------------------------------------------------------------------------------------------------- */

/* The triangle in a local frame: p0 at the origin, p1 on the x axis, z along its normal. */
struct curved {
    const struct facet *facet;
    double eta;
    bool distant;
    double ex1, ex2, ey2;           /* p1 = (ex1, 0, 0), p2 = (ex2, ey2, 0) */
    struct pell_dvec3 axis[3];      /* of the frame, in world space */
    struct pell_dvec3 p0, x, light; /* x and the light in the local frame */
    struct pell_dvec3 n, nu, nv;    /* normal = n + u nu + v nv, not unit */
    double area2;                   /* twice the area */
    double size, radius;            /* longest side; distance from the centroid to the farthest corner */
    double turn;                    /* largest angle between the normal at the centroid and a vertex normal */
    double grazing;
    double root[12][2];
    int roots;
};

struct state {
    struct pell_dvec3 v, l, h, n; /* to x, to the light, half vector, normal */
    double inverse_v, inverse_l;
    double r[2]; /* x and y of H x n */
};

static inline void evaluate(const struct curved *c, double u, double v, struct state *s)
{
    const struct pell_dvec3 p = { u * c->ex1 + v * c->ex2, v * c->ey2, 0.0 }, a = dvec3_sub(c->x, p);

    s->inverse_v = 1.0 / sqrt(dvec3_dot(a, a));
    s->v = dvec3_mul(a, s->inverse_v);
    if (c->distant) {
        s->inverse_l = 0.0;
        s->l = c->light;
    } else {
        const struct pell_dvec3 b = dvec3_sub(c->light, p);
        s->inverse_l = 1.0 / sqrt(dvec3_dot(b, b));
        s->l = dvec3_mul(b, s->inverse_l);
    }
    s->h = dvec3_mad(s->l, c->eta, s->v);
    s->n = dvec3_mad(dvec3_mad(c->n, u, c->nu), v, c->nv);
    s->r[0] = s->h.x * s->n.z - s->h.z * s->n.x;
    s->r[1] = s->h.y * s->n.z - s->h.z * s->n.y;
}

/* Derivative of r along one edge: p by `e`, n by `dn`. */
static inline void derive(const struct curved *c, const struct state *s, struct pell_dvec3 e, struct pell_dvec3 dn, double out[2])
{
    const double ev = dvec3_dot(e, s->v), el = dvec3_dot(e, s->l), fv = -c->eta * s->inverse_v, fl = -s->inverse_l;
    const struct pell_dvec3 dh = { fv * (e.x - ev * s->v.x) + fl * (e.x - el * s->l.x), fv * (e.y - ev * s->v.y) + fl * (e.y - el * s->l.y),
                                   fv * (e.z - ev * s->v.z) + fl * (e.z - el * s->l.z) };

    out[0] = dh.x * s->n.z + s->h.x * dn.z - dh.z * s->n.x - s->h.z * dn.x;
    out[1] = dh.y * s->n.z + s->h.y * dn.z - dh.z * s->n.y - s->h.z * dn.y;
}

static double jacobian(const struct curved *c, const struct state *s, double ju[2], double jv[2])
{
    derive(c, s, (struct pell_dvec3) { c->ex1, 0.0, 0.0 }, c->nu, ju);
    derive(c, s, (struct pell_dvec3) { c->ex2, c->ey2, 0.0 }, c->nv, jv);
    return ju[0] * jv[1] - ju[1] * jv[0];
}

/* Newton's method from (u, v); keeps a root inside the triangle once. */
static void refine(struct curved *c, double u, double v)
{
    for (int i = 0; i < 24; i++) {
        struct state s;
        double ju[2], jv[2], det, du, dv, most;
        evaluate(c, u, v, &s);
        det = jacobian(c, &s, ju, jv);
        du = (s.r[0] * jv[1] - s.r[1] * jv[0]) / det;
        dv = (ju[0] * s.r[1] - ju[1] * s.r[0]) / det;
        most = fmax(fabs(du), fabs(dv));
        if (!(most < 1e6))
            return;
        if (most > 0.5) { /* not beyond the region where r is known to be nearly linear */
            du *= 0.5 / most;
            dv *= 0.5 / most;
        }
        u -= du;
        v -= dv;
        if (!(u > -2.0 && u < 3.0 && v > -2.0 && v < 3.0))
            return;
        if (most > 1e-13)
            continue;
        if (!(u >= -EDGE_TOLERANCE && v >= -EDGE_TOLERANCE && u + v <= 1.0 + EDGE_TOLERANCE))
            return;
        for (int k = 0; k < c->roots; k++)
            if (fabs(c->root[k][0] - u) + fabs(c->root[k][1] - v) < SAME_ROOT)
                return;
        if (c->roots < (int) PELL_COUNT(c->root)) {
            c->root[c->roots][0] = u;
            c->root[c->roots++][1] = v;
        }
        return;
    }
}

/* A part of the triangle: its corner, and the extent of its sides along u and v (negative: the inverted central one of four). */
struct part {
    double u, v, side, near; /* near: its size over its distance to x or the light, whichever is nearer */
    int depth;
};

/* A curved triangle in single precision, for bounds; `finite`: 0 for a distant light, else 1. */
struct curved_single {
    float x[3], light[3], finite, ex1, ex2, ey2, eta, sign, grazing, n[3], nu[3], nv[3];
};

static struct curved_single to_single(const struct curved *c)
{
    return (struct curved_single) {
        .x = { (float) c->x.x, (float) c->x.y, (float) c->x.z },
        .light = { (float) c->light.x, (float) c->light.y, (float) c->light.z },
        .finite = c->distant ? 0.0f : 1.0f,
        .ex1 = (float) c->ex1,
        .ex2 = (float) c->ex2,
        .ey2 = (float) c->ey2,
        .eta = (float) c->eta,
        .sign = c->eta > 1.0 ? -1.0f : 1.0f,
        .grazing = (float) c->grazing,
        .n = { (float) c->n.x, (float) c->n.y, (float) c->n.z },
        .nu = { (float) c->nu.x, (float) c->nu.y, (float) c->nu.z },
        .nv = { (float) c->nv.x, (float) c->nv.y, (float) c->nv.z },
    };
}

/* Whether H can be along n within `radius` of (u, v), where n turns by at most `turn`: bounds that hold at any distance, as for nodes.
 * `near`: reciprocal of the distance to x or the light. */
static inline int is_possible(const struct curved_single *b, float u, float v, float radius, float turn, float *near)
{
    const float px = u * b->ex1 + v * b->ex2, py = v * b->ey2, ax = b->x[0] - px, ay = b->x[1] - py, z = b->x[2];
    const float bx = b->light[0] - b->finite * px, by = b->light[1] - b->finite * py, lz = b->light[2], eta = b->eta;
    const float iv = 1.0f / sqrtf(ax * ax + ay * ay + z * z), il = 1.0f / sqrtf(bx * bx + by * by + lz * lz);
    const float sv = radius * iv, sl = b->finite * radius * il;
    const float spread = eta * sv * (1.0f + 0.42f * sv * sv) + sl * (1.0f + 0.42f * sl * sl) + 2e-6f;
    const float hx = eta * ax * iv + bx * il, hy = eta * ay * iv + by * il, hz = eta * z * iv + lz * il;
    const float mx = b->n[0] + u * b->nu[0] + v * b->nv[0], my = b->n[1] + u * b->nu[1] + v * b->nv[1];
    const float mz = b->n[2] + u * b->nu[2] + v * b->nv[2];
    const float h = sqrtf(hx * hx + hy * hy + hz * hz), in = 1.0f / sqrtf(LARGER(mx * mx + my * my + mz * mz, 1e-30f));
    const float ih = 1.0f / LARGER(h, 1e-30f), sb = spread * ih, cb = sqrtf(LARGER(1.0f - sb * sb, 0.0f));
    const float sine = turn * in, cosine = sqrtf(LARGER(1.0f - sine * sine, 0.0f));
    const float facing = b->sign * (hx * mx + hy * my + hz * mz) * ih * in;
    const int inside = (sv >= 1.0f) | (sl >= 1.0f);
    const int along = (facing >= cosine * cb - sine * sb - 4e-6f) | (sb >= 0.99f) | (sine >= 0.99f);

    *near = LARGER(iv, b->finite * il);
    return inside | ((h <= b->grazing + spread) & along);
}

/* The quarters of a part where H can be along n. Returns their number. */
static int quarter(const struct curved *c, const struct curved_single *single, const struct part *part, struct part *out)
{
    static const float at[QUARTERS][3] = { { 0.0f, 0.0f, 1.0f }, { 1.0f, 0.0f, 1.0f }, { 0.0f, 1.0f, 1.0f }, { 1.0f, 1.0f, -1.0f } };
    const float half = 0.5f * (float) part->side, radius = (float) c->radius * fabsf(half), turn = (float) c->turn * fabsf(half);
    float near[QUARTERS];
    int possible[QUARTERS], count = 0;

    for (int i = 0; i < QUARTERS; i++) {
        const float u = (float) part->u + half * (at[i][0] + at[i][2] * (1.0f / 3.0f));
        const float v = (float) part->v + half * (at[i][1] + at[i][2] * (1.0f / 3.0f));
        possible[i] = is_possible(single, u, v, radius, turn, &near[i]);
    }
    for (int i = 0; i < QUARTERS; i++)
        if (possible[i])
            out[count++] =
                (struct part) { part->u + 0.5 * part->side * (double) at[i][0], part->v + 0.5 * part->side * (double) at[i][1],
                                0.5 * part->side * (double) at[i][2], c->size * fabs((double) half) * (double) near[i], part->depth + 1 };
    return count;
}

enum verdict { EMPTY, LINEAR, WILD };

/* Quadratic approximation of r over a part: six values define a patch that is contained in the hull of its Bezier points. */
static enum verdict classify(const struct curved *c, const struct part *part, double start[2])
{
    static const double at[6][2] = { { 0, 0 }, { 1, 0 }, { 0, 1 }, { 0.5, 0 }, { 0.5, 0.5 }, { 0, 0.5 } };
    double r[6][2], bend = 0.0, area, longest = 0.0, near;
    struct state s = { 0 };

    for (int k = 0; k < 6; k++) {
        evaluate(c, part->u + part->side * at[k][0], part->v + part->side * at[k][1], &s);
        r[k][0] = s.r[0];
        r[k][1] = s.r[1];
    }
    for (int k = 0; k < 3; k++) { /* from an edge's midpoint to its Bezier point */
        const double *a = r[k], *b = r[(k + 1) % 3];
        const double x = r[3 + k][0] - 0.5 * (a[0] + b[0]), y = r[3 + k][1] - 0.5 * (a[1] + b[1]);
        bend = fmax(bend, x * x + y * y);
        r[3 + k][0] += x;
        r[3 + k][1] += y;
    }
    near = c->size * fabs(part->side) * (s.inverse_v + s.inverse_l);
    bend = sqrt(bend) + 0.05 * near * near * near;
    /* Whether a line along one of the sides, or an axis, separates the hull from 0. */
    for (int k = 0; k < 5; k++) {
        const double *a = r[k % 3], *b = r[(k + 1) % 3];
        const double x = k < 3 ? a[1] - b[1] : k == 3, y = k < 3 ? b[0] - a[0] : k == 4, length = sqrt(x * x + y * y);
        double low = INFINITY, high = -INFINITY;
        for (int j = 0; j < 6; j++) {
            const double t = x * r[j][0] + y * r[j][1];
            low = fmin(low, t);
            high = fmax(high, t);
        }
        if (k < 3)
            longest = fmax(longest, length);
        if (low > (0.25 * bend + 1e-12) * length || high < -(0.25 * bend + 1e-12) * length)
            return EMPTY;
    }
    area = (r[1][0] - r[0][0]) * (r[2][1] - r[0][1]) - (r[1][1] - r[0][1]) * (r[2][0] - r[0][0]);
    start[0] = part->u + part->side * ((r[0][1] * (r[2][0] - r[0][0]) - r[0][0] * (r[2][1] - r[0][1])) / area);
    start[1] = part->v + part->side * ((r[0][0] * (r[1][1] - r[0][1]) - r[0][1] * (r[1][0] - r[0][0])) / area);
    return fabs(area) > 12.0 * bend * longest ? LINEAR : WILD;
}

static void search(struct curved *c, const struct curved_single *single)
{
    struct part stack[3 * MAX_DEPTH + 4];
    int count = 0, evaluated = 0;
    struct state s;

    evaluate(c, 1.0 / 3.0, 1.0 / 3.0, &s);
    stack[count++] = (struct part) { 0.0, 0.0, 1.0, c->size * fmax(s.inverse_v, s.inverse_l), 0 };
    while (count > 0) {
        const struct part p = stack[--count];
        const bool last = p.depth == MAX_DEPTH || evaluated >= MAX_PARTS;
        evaluated += 4;
        if (p.near < NEARLY_LINEAR || last) {
            double start[2];
            const enum verdict verdict = classify(c, &p, start);
            if (verdict == EMPTY)
                continue;
            if (verdict == LINEAR || last) {
                if (verdict == LINEAR)
                    refine(c, start[0], start[1]);
                else
                    refine(c, p.u + p.side / 3.0, p.v + p.side / 3.0);
                continue;
            }
        }
        count += quarter(c, single, &p, stack + count);
    }
}

static inline struct pell_dvec3 to_frame(const struct curved *c, struct pell_dvec3 a)
{
    return (struct pell_dvec3) { dvec3_dot(a, c->axis[0]), dvec3_dot(a, c->axis[1]), dvec3_dot(a, c->axis[2]) };
}

static inline struct pell_dvec3 from_frame(const struct curved *c, struct pell_dvec3 a)
{
    return dvec3_mad(dvec3_mad(dvec3_mul(c->axis[0], a.x), a.y, c->axis[1]), a.z, c->axis[2]);
}

/* A barycentric coordinate of the triangle at (u, v) of a piece. */
static double barycentric_at(const struct piece *p, int k, double u, double v)
{
    return (1.0 - u - v) * (double) p->uv[0][k] + u * (double) p->uv[1][k] + v * (double) p->uv[2][k];
}

static void keep_roots(struct query *q, const struct curved *c, const struct piece *piece)
{
    for (int i = 0; i < c->roots; i++) {
        const double u = c->root[i][0], v = c->root[i][1];
        struct path p = { .facet = c->facet, .size = c->size };
        const struct pell_dvec3 at = { u * c->ex1 + v * c->ex2, v * c->ey2, 0.0 };
        double ju[2], jv[2], det, n, cos_i;
        struct state s;
        evaluate(c, u, v, &s);
        det = fabs(jacobian(c, &s, ju, jv));
        n = sqrt(dvec3_dot(s.n, s.n));
        cos_i = -dvec3_dot(s.v, s.n) / n;
        p.cos_o = dvec3_dot(s.l, s.n) / n;
        p.facing_in = -s.v.z;
        p.facing_out = s.l.z;
        if (!(cos_i > 0.0 && p.cos_o > 0.0 && p.facing_in > 0.0 && p.facing_out > 0.0 && s.n.z > 0.0))
            continue;
        p.u = barycentric_at(piece, 0, u, v);
        p.v = barycentric_at(piece, 1, u, v);
        p.at = dvec3_mad(c->p0, 1.0, from_frame(c, at));
        p.normal = from_frame(c, dvec3_mul(s.n, 1.0 / n));
        p.inside = from_frame(c, dvec3_mul(s.v, -1.0));
        p.outside = from_frame(c, s.l);
        p.inside_mm = 1.0 / s.inverse_v;
        p.outside_mm = q->distant ? INFINITY : 1.0 / s.inverse_l;
        /* |d light / d(u, v)| |d r / d x| / |d r / d(u, v)|, x in the plane perpendicular to the path. */
        p.spread = c->area2 * p.facing_out * (q->distant ? 1.0 : s.inverse_l * s.inverse_l) * q->eta * q->eta * s.inverse_v * s.inverse_v *
                   s.n.z * cos_i * n / det;
        keep(q, &p);
    }
}

/* False: x is above the piece, or the light below it. */
static bool make_curved(const struct query *q, const struct facet *f, const struct piece *piece, struct curved *c)
{
    const struct pell_dvec3 p0 = facet_corner(f->p, piece->uv[0]), e1 = dvec3_sub(facet_corner(f->p, piece->uv[1]), p0),
                            e2 = dvec3_sub(facet_corner(f->p, piece->uv[2]), p0), cr = dvec3_cross(e1, e2), e3 = dvec3_sub(e2, e1);
    const double length = sqrt(dvec3_dot(e1, e1));

    *c = (struct curved) { .facet = f, .eta = q->eta, .distant = q->distant, .p0 = p0, .grazing = q->grazing };
    c->area2 = sqrt(dvec3_dot(cr, cr));
    c->axis[2] = dvec3_mul(cr, 1.0 / c->area2);
    c->axis[0] = dvec3_mul(e1, 1.0 / length);
    c->axis[1] = dvec3_cross(c->axis[2], c->axis[0]);
    c->x = to_frame(c, dvec3_sub(q->x, p0));
    c->light = to_frame(c, q->distant ? q->light : dvec3_sub(q->light, p0));
    if (!(c->x.z < 0.0) || !(c->light.z > 0.0))
        return false;
    c->ex1 = length;
    c->ex2 = dvec3_dot(e2, c->axis[0]);
    c->ey2 = dvec3_dot(e2, c->axis[1]);
    c->size = sqrt(fmax(fmax(length * length, dvec3_dot(e2, e2)), dvec3_dot(e3, e3)));
    c->n = to_frame(c, facet_corner(f->n, piece->uv[0]));
    c->nu = dvec3_sub(to_frame(c, facet_corner(f->n, piece->uv[1])), c->n);
    c->nv = dvec3_sub(to_frame(c, facet_corner(f->n, piece->uv[2])), c->n);
    for (int k = 0; k < 3; k++) {
        const double u = (k == 1) - 1.0 / 3.0, v = (k == 2) - 1.0 / 3.0, x = u * c->ex1 + v * c->ex2, y = v * c->ey2;
        const struct pell_dvec3 dn = dvec3_mad(dvec3_mul(c->nu, u), v, c->nv);
        c->radius = fmax(c->radius, sqrt(x * x + y * y) * (1.0 + 1e-6));
        c->turn = fmax(c->turn, sqrt(dvec3_dot(dn, dn)) * (1.0 + 1e-6));
    }
    return true;
}

static void solve_piece(struct query *q, const struct facet *f, const struct piece *piece)
{
    struct curved c;
    struct curved_single single;

    if (!make_curved(q, f, piece, &c))
        return;
    single = to_single(&c);
    search(&c, &single);
    keep_roots(q, &c, piece);
}

/* A piece in the local frame of the curved triangle that contains it. */
struct outline {
    float u, v, radius, turn, longest2;
    int longest;
};

static struct outline outline_of(const struct curved_single *b, const struct piece *p)
{
    struct outline o = { .u = (p->uv[0][0] + p->uv[1][0] + p->uv[2][0]) / 3.0f, .v = (p->uv[0][1] + p->uv[1][1] + p->uv[2][1]) / 3.0f };
    float radius2 = 0.0f, turn2 = 0.0f;

    for (int k = 0; k < 3; k++) {
        const float *corner = p->uv[k], *next = p->uv[(k + 1) % 3];
        const float u = corner[0] - o.u, v = corner[1] - o.v, x = u * b->ex1 + v * b->ex2, y = v * b->ey2;
        const float mx = u * b->nu[0] + v * b->nv[0], my = u * b->nu[1] + v * b->nv[1], mz = u * b->nu[2] + v * b->nv[2];
        const float du = next[0] - corner[0], dv = next[1] - corner[1], sx = du * b->ex1 + dv * b->ex2, sy = dv * b->ey2;
        const float side2 = sx * sx + sy * sy;
        radius2 = LARGER(radius2, x * x + y * y);
        turn2 = LARGER(turn2, mx * mx + my * my + mz * mz);
        if (side2 > o.longest2) {
            o.longest2 = side2;
            o.longest = k;
        }
    }
    o.radius = sqrtf(radius2) * (1.0f + 1e-5f);
    o.turn = sqrtf(turn2) * (1.0f + 1e-5f);
    return o;
}

/* Bisects a piece along the line from a corner to the midpoint of the opposite side. */
static void halve(const struct piece *p, int side, struct piece half[2])
{
    const int next = (side + 1) % 3;
    const struct piece from = *p;

    for (int i = 0; i < 2; i++) {
        half[i] = from;
        half[i].depth++;
        for (int k = 0; k < 2; k++)
            half[i].uv[i ? side : next][k] = 0.5f * (from.uv[side][k] + from.uv[next][k]);
    }
}

static const struct piece full_triangle = { { { 0.0f, 0.0f }, { 1.0f, 0.0f }, { 0.0f, 1.0f } }, 0 };

/* A sliver is bisected first: its quarters would be equally elongated, and four times as many. */
static void solve_sliver(struct query *q, const struct facet *f, const struct piece *of, const struct curved *c,
                         const struct curved_single *single)
{
    struct piece stack[MAX_DEPTH + 2] = { full_triangle };
    int count = 1;

    while (count > 0) {
        const struct piece p = stack[--count];
        const struct outline o = outline_of(single, &p);
        float near;
        if (!is_possible(single, o.u, o.v, o.radius, o.turn, &near))
            continue;
        if (p.depth < MAX_DEPTH && (double) o.longest2 > PELL_CONNECT_SLIVER * c->area2 / (double) (1u << p.depth) &&
            (double) (sqrtf(o.longest2) * near) >= NEARLY_LINEAR) {
            halve(&p, o.longest, stack + count);
            count += 2;
        } else {
            struct piece part = { .depth = p.depth };
            for (int i = 0; i < 3; i++)
                for (int k = 0; k < 2; k++)
                    part.uv[i][k] = (float) barycentric_at(of, k, (double) p.uv[i][0], (double) p.uv[i][1]);
            solve_piece(q, f, &part);
        }
    }
}

static void solve_curved(struct query *q, const struct facet *f)
{
    const struct piece piece = facet_piece(f);
    struct curved c;
    struct curved_single single;

    if (!make_curved(q, f, &piece, &c))
        return;
    single = to_single(&c);
    if (c.size * c.size > PELL_CONNECT_SLIVER * c.area2) {
        solve_sliver(q, f, &piece, &c, &single);
        return;
    }
    search(&c, &single);
    keep_roots(q, &c, &piece);
}

void pell_connect_solve(struct query *q, const struct facet *f)
{
    if (f->planar)
        solve_planar(q, f);
    else
        solve_curved(q, f);
}
