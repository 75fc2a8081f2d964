/* SPDX-License-Identifier: MIT
 *
 * connect.c - see connect.h.
 *
 * With w_v the direction from a place P of the surface to x inside and w_l from P to the lamp, P refracts where the half vector
 *
 *     H = eta w_v + w_l = -k n,    |eta - 1| <= |k| <= sqrt(|eta^2 - 1|)
 *
 * is along the normal n (Walter et al. 2007, "Microfacet Models for Refraction", eq. (16); the greatest k is that of grazing light). A
 * hierarchy of spheres with cones of normals bounds H over a whole part of the surface, and leaves out what can't refract. The sides on
 * which x and the lamp are follow from k.
 *
 * What is left are single triangles. With the triangle's own normal the path is the shortest in time through its plane, which is convex: it
 * is found by Newton's method between bounds. With interpolated normals H x n = 0 is solved over (u, v): the triangle is halved both ways
 * until H x n is nearly linear in it, where a root is found, or ruled out, at once.
 *
 * Light in a narrow bundle about the path: the derivative of the implicit function (u, v)(x). */
#include "render/connect.h"
#include "render/connect_find.h"

#include <string.h>

#define LANES PELL_CONNECT_CHILDREN
#define LEAF PELL_CONNECT_LEAF
#define NOTHING PELL_CONNECT_NOTHING
#define QUARTERS 4
#define NEAR_ONE 1e-9       /* of an index: light goes straight on */
#define PARTS 4000          /* of a triangle that are looked at: what is wilder than that is no surface */
#define DEPTH 20            /* of halving a triangle */
#define BESIDE 1e-9         /* barycentric: how far beyond its edge a triangle still owns a root, so that none slips between two */
#define SAME 1e-6           /* of a triangle's size: roots nearer than this, of two triangles, are one on their edge */
#define FAR 1e15            /* mm: no place is beyond */
#define NORMAL_WEIGHT 0.125 /* of a unit of normal when the hierarchy is split, in sizes of the body */

/* Of numbers that are some: fmaxf is a call, which no lanes take. */
#define LARGER(a, b) ((a) > (b) ? (a) : (b))
#define SMALLER(a, b) ((a) < (b) ? (a) : (b))

struct facet {
    float p[3][3], n[3][3];
    uint32_t mesh, triangle;
    bool planar; /* the normals are the triangle's own */
};

struct tree {
    struct facet *facets;
    struct pell_connect_node *nodes;
    size_t num_facets, num_nodes;
    double rounding; /* mm */
};

struct pell_connector {
    struct pell_context *ctx;
    const struct pell_rays *rays;
    const struct pell_bodies *bodies;
    const struct pell_scene *scene;
    struct tree *trees; /* one a body */
    const struct pell_connect_kernels *kernels;
    bool flat;
};

/* --- Vectors of double -------------------------------------------------------------------------------------------------------- */

struct vec {
    double x, y, z;
};

static inline struct vec load(const float *p)
{
    return (struct vec){ (double) p[0], (double) p[1], (double) p[2] };
}

static inline struct vec widen(struct pell_vec3 a)
{
    return (struct vec){ (double) a.x, (double) a.y, (double) a.z };
}

static inline struct pell_vec3 narrow(struct vec a)
{
    return vec3((float) a.x, (float) a.y, (float) a.z);
}

static inline struct vec sub(struct vec a, struct vec b)
{
    return (struct vec){ a.x - b.x, a.y - b.y, a.z - b.z };
}

static inline struct vec mad(struct vec a, double s, struct vec b)
{
    return (struct vec){ a.x + s * b.x, a.y + s * b.y, a.z + s * b.z };
}

static inline struct vec scale(struct vec a, double s)
{
    return (struct vec){ a.x * s, a.y * s, a.z * s };
}

static inline double dot(struct vec a, struct vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct vec cross(struct vec a, struct vec b)
{
    return (struct vec){ a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}

/* --- Building ----------------------------------------------------------------------------------------------------------------- */

static void fill_facet(const struct pell_mesh *m, uint32_t mesh, uint32_t triangle, bool flat, struct facet *f)
{
    const uint32_t *index = m->index + 3 * (size_t) triangle;
    struct vec n, e1, e2;
    double length;

    memset(f, 0, sizeof(*f));
    f->mesh = mesh;
    f->triangle = triangle;
    for (int k = 0; k < 3; k++)
        memcpy(f->p[k], m->position + 3 * (size_t) index[k], sizeof(f->p[k]));
    e1 = sub(load(f->p[1]), load(f->p[0]));
    e2 = sub(load(f->p[2]), load(f->p[0]));
    n = cross(e1, e2);
    length = sqrt(dot(n, n));
    n = length > 0.0 ? scale(n, 1.0 / length) : (struct vec){ 0.0, 0.0, 1.0 };
    f->planar = true;
    for (int k = 0; k < 3; k++) {
        const float *v = m->normal + 3 * (size_t) index[k];
        const struct vec given = load(v);
        const bool none = !(dot(given, given) > 0.25 && dot(given, given) < 4.0);
        const struct vec own = flat || none ? n : given, off = sub(own, n);
        f->n[k][0] = (float) own.x;
        f->n[k][1] = (float) own.y;
        f->n[k][2] = (float) own.z;
        /* As near as floats tell. */
        f->planar = f->planar && dot(off, off) < 1e-13;
    }
}

static void bound(const struct facet *f, size_t count, struct pell_connect_node *node, int lane)
{
    float low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY }, largest = 0.0f;
    struct vec centre, sum = { 0.0, 0.0, 0.0 }, axis;
    double radius = 0.0, cosine = 1.0, length;

    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) {
            for (int j = 0; j < 3; j++) {
                low[j] = SMALLER(low[j], f[i].p[k][j]);
                high[j] = LARGER(high[j], f[i].p[k][j]);
                largest = LARGER(largest, fabsf(f[i].p[k][j]));
            }
            sum = mad(sum, 1.0, load(f[i].n[k]));
        }
    node->x[lane] = 0.5f * (low[0] + high[0]);
    node->y[lane] = 0.5f * (low[1] + high[1]);
    node->z[lane] = 0.5f * (low[2] + high[2]);
    centre = (struct vec){ (double) node->x[lane], (double) node->y[lane], (double) node->z[lane] };
    length = sqrt(dot(sum, sum));
    axis = length > 0.0 ? scale(sum, 1.0 / length) : (struct vec){ 0.0, 0.0, 1.0 };
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) {
            const struct vec d = sub(load(f[i].p[k]), centre), n = load(f[i].n[k]);
            const double l = sqrt(dot(n, n));
            const double r = dot(d, d), along = l > 0.0 ? dot(axis, n) / l : -1.0;
            radius = LARGER(radius, r);
            cosine = SMALLER(cosine, along);
        }
    /* More than what floats lose, here and in a query. */
    node->radius[lane] = (float) (sqrt(radius) * (1.0 + 1e-5)) + 1e-6f * largest;
    node->ax[lane] = (float) axis.x;
    node->ay[lane] = (float) axis.y;
    node->az[lane] = (float) axis.z;
    node->cosine[lane] = length > 0.0 && cosine > 0.02 ? (float) cosine : -1.0f;
    node->sine[lane] = node->cosine[lane] > 0.0f ? sqrtf(fmaxf(0.0f, 1.0f - node->cosine[lane] * node->cosine[lane])) : 0.0f;
}

/* Position, then normal, times `weight`, in one dimension of six. */
static float key(const struct facet *f, int dimension, float weight)
{
    const int j = dimension % 3;

    if (dimension < 3)
        return f->p[0][j] + f->p[1][j] + f->p[2][j];
    return weight * (f->n[0][j] + f->n[1][j] + f->n[2][j]);
}

/* The first half has keys up to those of the second. Gives up on orders made to be slow: any halves are valid. */
static void halve(struct facet *f, size_t count, size_t half, int dimension, float weight)
{
    size_t first = 0, last = count - 1;

    for (int turn = 0; first < last && turn < 96; turn++) {
        const float pivot = key(&f[first + (last - first) / 2], dimension, weight);
        size_t i = first, j = last;
        for (;;) {
            struct facet t;
            while (key(&f[i], dimension, weight) < pivot)
                i++;
            while (pivot < key(&f[j], dimension, weight))
                j--;
            if (i >= j)
                break;
            t = f[i];
            f[i++] = f[j];
            f[j--] = t;
        }
        /* [first, j] are at most the pivot, [j + 1, last] at least. */
        if (i == j && key(&f[j], dimension, weight) > pivot)
            j--;
        if (half <= j)
            last = j;
        else
            first = j + 1;
    }
}

/* The first `first` of them apart from the others, along the widest dimension. */
static void split(struct facet *f, size_t count, size_t first, float weight)
{
    float low[6], high[6];
    int widest = 0;

    for (int d = 0; d < 6; d++) {
        low[d] = INFINITY;
        high[d] = -INFINITY;
        for (size_t i = 0; i < count; i++) {
            const float k = key(&f[i], d, weight);
            low[d] = SMALLER(low[d], k);
            high[d] = LARGER(high[d], k);
        }
        if (high[d] - low[d] > high[widest] - low[widest])
            widest = d;
    }
    halve(f, count, first, widest, weight);
}

/* What one child of a node holds at most: a power of the children, so that all nodes but the last ones are full. */
static size_t capacity(size_t count)
{
    size_t c = 1;

    while (c * LANES < count)
        c *= LANES;
    return c;
}

static size_t count_nodes(size_t facets)
{
    const size_t c = capacity(facets), full = (facets - 1) / c, rest = facets - full * c;

    return 1 + (c > 1 ? full * count_nodes(c) + (rest > 1 ? count_nodes(rest) : 0) : 0);
}

static void divide(struct facet *f, size_t count, size_t parts, size_t c, float weight)
{
    const size_t half = parts / 2;

    if (parts < 2)
        return;
    split(f, count, half * c, weight);
    divide(f, half * c, half, c, weight);
    divide(f + half * c, count - half * c, parts - half, c, weight);
}

/* A node over `count` facets from `first` on; returns its number. As deep as the logarithm of count, base 16. */
static uint32_t build(struct tree *t, size_t first, size_t count, float weight)
{
    const uint32_t number = (uint32_t) t->num_nodes++;
    struct pell_connect_node *node = &t->nodes[number];
    const size_t c = capacity(count);

    if (c > 1)
        divide(t->facets + first, count, (count + c - 1) / c, c, weight);
    for (size_t i = 0; i < LANES; i++) {
        const size_t start = i * c, n = start >= count ? 0 : count - start < c ? count - start : c;
        if (n == 0) {
            node->child[i] = NOTHING;
            node->radius[i] = 0.0f;
            continue;
        }
        bound(t->facets + first + start, n, node, (int) i);
        node->child[i] = n == 1 ? LEAF + (uint32_t) (first + start) : build(t, first + start, n, weight);
    }
    return number;
}

static enum pell_result build_tree(struct pell_connector *c, size_t number)
{
    const struct pell_body *body = &c->bodies->bodies[number];
    struct tree *t = &c->trees[number];
    float low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY }, size = 0.0f, largest = 0.0f;

    if (body->num_triangles == 0)
        return PELL_OK;
    if (body->num_triangles >= LEAF)
        return pell_error(c->ctx, PELL_ERR_UNSUPPORTED, c->scene->path, NULL, "%zu triangles are too many", body->num_triangles);
    t->facets = pell_alloc_array(c->ctx, body->num_triangles, sizeof(*t->facets));
    t->nodes = pell_calloc(c->ctx, count_nodes(body->num_triangles), sizeof(*t->nodes));
    if (!t->facets || !t->nodes)
        return PELL_ERR_NOMEM;
    t->num_facets = body->num_triangles;
    for (size_t i = 0; i < t->num_facets; i++) {
        fill_facet(&c->scene->meshes[body->triangles[i].mesh], body->triangles[i].mesh, body->triangles[i].triangle, c->flat,
                   &t->facets[i]);
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < 3; j++) {
                low[j] = fminf(low[j], t->facets[i].p[k][j]);
                high[j] = fmaxf(high[j], t->facets[i].p[k][j]);
            }
    }
    for (int j = 0; j < 3; j++) {
        size = fmaxf(size, high[j] - low[j]);
        largest = fmaxf(largest, fmaxf(fabsf(low[j]), fabsf(high[j])));
    }
    t->rounding = 1e-6 * (double) largest;
    build(t, 0, t->num_facets, (float) NORMAL_WEIGHT * size);
    return pell_cancelled(c->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

void pell_connector_destroy(struct pell_connector **connector)
{
    struct pell_connector *c = *connector;

    if (!c)
        return;
    *connector = NULL;
    for (size_t i = 0; c->trees && i < c->bodies->count; i++) {
        pell_free(c->ctx, c->trees[i].facets);
        pell_free(c->ctx, c->trees[i].nodes);
    }
    pell_free(c->ctx, c->trees);
    pell_free(c->ctx, c);
}

enum pell_result pell_connector_create(struct pell_context *ctx, const struct pell_scene *scene, const struct pell_rays *rays,
                                       const struct pell_bodies *bodies, bool flat, struct pell_connector **out)
{
    struct pell_connector *c = pell_zalloc(ctx, sizeof(*c));
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!c)
        return PELL_ERR_NOMEM;
    c->ctx = ctx;
    c->rays = rays;
    c->bodies = bodies;
    c->scene = scene;
    c->flat = flat;
    c->kernels = pell_connect_kernels_tables[pell_simd_best()];
    c->trees = pell_calloc(ctx, bodies->count + 1, sizeof(*c->trees));
    if (!c->trees)
        goto fail;
    for (size_t i = 0; i < bodies->count; i++)
        PELL_TRY(build_tree(c, i));
    *out = c;
    return PELL_OK;

fail:
    pell_connector_destroy(&c);
    return res;
}

/* --- A query ------------------------------------------------------------------------------------------------------------------ */

/* A path that refracts; whether anything is in its way is not asked yet. */
struct path {
    const struct facet *facet;
    double u, v;
    struct vec at, normal, inside, outside; /* as in a connection */
    double inside_mm, outside_mm, spread, cos_o;
    double facing_in, facing_out; /* cosines of both parts with the triangle's own normal */
    double size;                  /* of the triangle */
};

struct query {
    double eta, grazing; /* grazing: the largest |k| */
    double reach;
    struct vec x, place; /* or direction */
    bool away;           /* a direction */
    struct path paths[PELL_CONNECTIONS];
    int count;
};

/* Keeps a path, unless a neighbour has found it, too: the nearest, where there are too many. */
static void keep(struct query *q, const struct path *p)
{
    int at = q->count;

    if (!(p->inside_mm <= q->reach) || !(p->spread < INFINITY) || !(p->inside_mm > 0.0))
        return;
    for (int i = 0; i < q->count; i++) {
        const struct vec d = sub(q->paths[i].at, p->at);
        const double near = SAME * fmin(q->paths[i].size, p->size);
        if (dot(d, d) <= near * near)
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

/* Distance of x's foot, along the plane, to where light refracts: x is `below` the plane, the lamp `above` it, their feet `apart`. */
static double planar_shift(double eta, double below, double above, double apart)
{
    const double straight = apart * below / (below + above);
    double low = 0.0, high = apart, s;

    /* Light is nearer to the normal on the side of the larger index, and there never beyond the critical angle. */
    if (eta > 1.0) {
        high = fmin(straight, below / sqrt(eta * eta - 1.0));
    } else if (eta < 1.0) {
        low = fmax(straight, apart - above * eta / sqrt(1.0 - eta * eta));
    }
    s = fmin(fmax(apart * below / (below + eta * above), low), high);
    for (int i = 0; i < 64; i++) {
        const double rest = apart - s, a2 = s * s + below * below, b2 = rest * rest + above * above;
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
        if (fabs(next - s) <= 1e-15 * apart)
            return next;
        s = next;
    }
    return s;
}

static void solve_planar(struct query *q, const struct facet *f)
{
    const struct vec p0 = load(f->p[0]), e1 = sub(load(f->p[1]), p0), e2 = sub(load(f->p[2]), p0);
    const struct vec cr = cross(e1, e2);
    const double area2 = dot(cr, cr), inverse = 1.0 / sqrt(area2);
    const struct vec n = scale(cr, inverse);
    const double below = -dot(sub(q->x, p0), n);
    struct path p = { .facet = f, .normal = n };
    double s, apart, cos_i;
    struct vec foot, along, d, out;

    if (!(below > 0.0))
        return;
    foot = mad(q->x, below, n);
    if (q->away) {
        p.cos_o = dot(q->place, n);
        along = mad(q->place, -p.cos_o, n);
        apart = sqrt(dot(along, along));
        s = apart / q->eta;
        if (!(p.cos_o > 0.0) || !(s < 1.0))
            return;
        s = below * s / sqrt(1.0 - s * s);
    } else {
        const struct vec to = sub(q->place, p0);
        const double above = dot(to, n);
        if (!(above > 0.0))
            return;
        along = sub(mad(q->place, -above, n), foot);
        apart = sqrt(dot(along, along));
        s = planar_shift(q->eta, below, above, apart);
    }
    p.at = apart > 0.0 ? mad(foot, s / apart, along) : foot;
    d = sub(p.at, p0);
    p.u = dot(cross(d, e2), n) * inverse;
    p.v = dot(cross(e1, d), n) * inverse;
    if (!(p.u >= -BESIDE && p.v >= -BESIDE && p.u + p.v <= 1.0 + BESIDE))
        return;
    p.inside_mm = sqrt(s * s + below * below);
    p.inside = scale(sub(p.at, q->x), 1.0 / p.inside_mm);
    cos_i = below / p.inside_mm;
    if (q->away) {
        p.outside = q->place;
        p.outside_mm = INFINITY;
        p.spread = p.cos_o / cos_i;
    } else {
        /* Rays about the path meet in the plane of incidence and across it. */
        double across, within;
        out = sub(q->place, p.at);
        p.outside_mm = sqrt(dot(out, out));
        p.outside = scale(out, 1.0 / p.outside_mm);
        p.cos_o = dot(p.outside, n);
        across = p.inside_mm / q->eta + p.outside_mm;
        within = p.outside_mm * cos_i / p.cos_o + p.inside_mm * p.cos_o / (q->eta * cos_i);
        p.spread = 1.0 / (across * within);
    }
    p.facing_in = cos_i;
    p.facing_out = p.cos_o;
    p.size = sqrt(fmax(dot(e1, e1), dot(e2, e2)));
    keep(q, &p);
}

/* --- Interpolated normals ----------------------------------------------------------------------------------------------------- */

/* The triangle in its own frame: p0 at the origin, p1 on the x axis, z along its normal. */
struct curved {
    const struct facet *facet;
    double eta;
    bool away;
    double ex1, ex2, ey2;    /* p1 = (ex1, 0, 0), p2 = (ex2, ey2, 0) */
    struct vec axis[3];      /* of the frame, in the world's */
    struct vec p0, x, place; /* x and the lamp in the frame */
    struct vec n, nu, nv;    /* normal = n + u nu + v nv, not unit */
    double size, radius;     /* longest side; from the middle to the farthest corner */
    double turn;             /* from the normal in the middle to that of a corner, at most */
    double grazing;
    double root[12][2];
    int roots;
};

struct state {
    struct vec v, l, h, n; /* to x, to the lamp, half vector, normal */
    double inverse_v, inverse_l;
    double r[2]; /* H x n but for its z part */
};

static inline void look(const struct curved *c, double u, double v, struct state *s)
{
    const struct vec p = { u * c->ex1 + v * c->ex2, v * c->ey2, 0.0 }, a = sub(c->x, p);

    s->inverse_v = 1.0 / sqrt(dot(a, a));
    s->v = scale(a, s->inverse_v);
    if (c->away) {
        s->inverse_l = 0.0;
        s->l = c->place;
    } else {
        const struct vec b = sub(c->place, p);
        s->inverse_l = 1.0 / sqrt(dot(b, b));
        s->l = scale(b, s->inverse_l);
    }
    s->h = mad(s->l, c->eta, s->v);
    s->n = mad(mad(c->n, u, c->nu), v, c->nv);
    s->r[0] = s->h.x * s->n.z - s->h.z * s->n.x;
    s->r[1] = s->h.y * s->n.z - s->h.z * s->n.y;
}

/* Derivative of r along one edge: p by `e`, n by `dn`. */
static inline void derive(const struct curved *c, const struct state *s, struct vec e, struct vec dn, double out[2])
{
    const double ev = dot(e, s->v), el = dot(e, s->l), fv = -c->eta * s->inverse_v, fl = -s->inverse_l;
    const struct vec dh = { fv * (e.x - ev * s->v.x) + fl * (e.x - el * s->l.x), fv * (e.y - ev * s->v.y) + fl * (e.y - el * s->l.y),
                            fv * (e.z - ev * s->v.z) + fl * (e.z - el * s->l.z) };

    out[0] = dh.x * s->n.z + s->h.x * dn.z - dh.z * s->n.x - s->h.z * dn.x;
    out[1] = dh.y * s->n.z + s->h.y * dn.z - dh.z * s->n.y - s->h.z * dn.y;
}

static double jacobian(const struct curved *c, const struct state *s, double ju[2], double jv[2])
{
    derive(c, s, (struct vec){ c->ex1, 0.0, 0.0 }, c->nu, ju);
    derive(c, s, (struct vec){ c->ex2, c->ey2, 0.0 }, c->nv, jv);
    return ju[0] * jv[1] - ju[1] * jv[0];
}

/* Newton's method from (u, v) on; a root inside the triangle is kept once. */
static void refine(struct curved *c, double u, double v)
{
    for (int i = 0; i < 24; i++) {
        struct state s;
        double ju[2], jv[2], det, du, dv, most;
        look(c, u, v, &s);
        det = jacobian(c, &s, ju, jv);
        du = (s.r[0] * jv[1] - s.r[1] * jv[0]) / det;
        dv = (ju[0] * s.r[1] - ju[1] * s.r[0]) / det;
        most = fmax(fabs(du), fabs(dv));
        if (!(most < 1e6))
            return;
        if (most > 0.5) { /* not beyond where the field is known to be nearly linear */
            du *= 0.5 / most;
            dv *= 0.5 / most;
        }
        u -= du;
        v -= dv;
        if (!(u > -2.0 && u < 3.0 && v > -2.0 && v < 3.0))
            return;
        if (most > 1e-13)
            continue;
        if (!(u >= -BESIDE && v >= -BESIDE && u + v <= 1.0 + BESIDE))
            return;
        for (int k = 0; k < c->roots; k++)
            if (fabs(c->root[k][0] - u) + fabs(c->root[k][1] - v) < SAME)
                return;
        if (c->roots < (int) PELL_COUNT(c->root)) {
            c->root[c->roots][0] = u;
            c->root[c->roots++][1] = v;
        }
        return;
    }
}

/* A part of the triangle: its corner, and how far its sides go along u and v (below 0: the middle one of four, turned round). */
struct part {
    double u, v, side, near; /* near: its size over its distance to x or the lamp, whichever is nearer */
    int depth;
};

/* The four quarters of a part in which H can be along n, by bounds that hold however far it is; as for nodes. Returns how many. */
static int quarter(const struct curved *c, const struct part *part, struct part *out)
{
    static const float at[QUARTERS][3] = { { 0.0f, 0.0f, 1.0f }, { 1.0f, 0.0f, 1.0f }, { 0.0f, 1.0f, 1.0f }, { 1.0f, 1.0f, -1.0f } };
    const float half = 0.5f * (float) part->side, x = (float) c->x.x, y = (float) c->x.y, z = (float) c->x.z;
    const float lx = (float) c->place.x, ly = (float) c->place.y, lz = (float) c->place.z, place = c->away ? 0.0f : 1.0f;
    const float ex1 = (float) c->ex1, ex2 = (float) c->ex2, ey2 = (float) c->ey2, eta = (float) c->eta, grazing = (float) c->grazing;
    const float nx = (float) c->n.x, ny = (float) c->n.y, nz = (float) c->n.z, ux = (float) c->nu.x, uy = (float) c->nu.y;
    const float uz = (float) c->nu.z, vx = (float) c->nv.x, vy = (float) c->nv.y, vz = (float) c->nv.z, sign = eta > 1.0f ? -1.0f : 1.0f;
    const float radius = (float) c->radius * fabsf(half), turn = (float) c->turn * fabsf(half);
    float near[QUARTERS];
    int open[QUARTERS], count = 0;

    for (int i = 0; i < QUARTERS; i++) {
        const float u = (float) part->u + half * (at[i][0] + at[i][2] * (1.0f / 3.0f));
        const float v = (float) part->v + half * (at[i][1] + at[i][2] * (1.0f / 3.0f));
        const float px = u * ex1 + v * ex2, py = v * ey2, ax = x - px, ay = y - py, bx = lx - place * px, by = ly - place * py;
        const float iv = 1.0f / sqrtf(ax * ax + ay * ay + z * z), il = 1.0f / sqrtf(bx * bx + by * by + lz * lz);
        const float sv = radius * iv, sl = place * radius * il;
        const float spread = eta * sv * (1.0f + 0.42f * sv * sv) + sl * (1.0f + 0.42f * sl * sl) + 2e-6f;
        const float hx = eta * ax * iv + bx * il, hy = eta * ay * iv + by * il, hz = eta * z * iv + lz * il;
        const float mx = nx + u * ux + v * vx, my = ny + u * uy + v * vy, mz = nz + u * uz + v * vz;
        const float h = sqrtf(hx * hx + hy * hy + hz * hz), in = 1.0f / sqrtf(LARGER(mx * mx + my * my + mz * mz, 1e-30f));
        const float ih = 1.0f / LARGER(h, 1e-30f), sb = spread * ih, cb = sqrtf(LARGER(1.0f - sb * sb, 0.0f));
        const float sine = turn * in, cosine = sqrtf(LARGER(1.0f - sine * sine, 0.0f));
        const float facing = sign * (hx * mx + hy * my + hz * mz) * ih * in;
        const int inside = (sv >= 1.0f) | (sl >= 1.0f);
        const int along = (facing >= cosine * cb - sine * sb - 4e-6f) | (sb >= 0.99f) | (sine >= 0.99f);
        open[i] = inside | ((h <= grazing + spread) & along);
        near[i] = LARGER(iv, place * il);
    }
    for (int i = 0; i < QUARTERS; i++)
        if (open[i])
            out[count++] =
                (struct part){ part->u + 0.5 * part->side * (double) at[i][0], part->v + 0.5 * part->side * (double) at[i][1],
                               0.5 * part->side * (double) at[i][2], c->size * fabs((double) half) * (double) near[i], part->depth + 1 };
    return count;
}

enum verdict { EMPTY, LINEAR, WILD };

/* What r is like over a part: six values make a quadratic patch, whose Bezier points hold it. */
static enum verdict weigh(const struct curved *c, const struct part *part, double start[2])
{
    static const double at[6][2] = { { 0, 0 }, { 1, 0 }, { 0, 1 }, { 0.5, 0 }, { 0.5, 0.5 }, { 0, 0.5 } };
    double r[6][2], bend = 0.0, area, longest = 0.0, near;
    struct state s = { 0 };

    for (int k = 0; k < 6; k++) {
        look(c, part->u + part->side * at[k][0], part->v + part->side * at[k][1], &s);
        r[k][0] = s.r[0];
        r[k][1] = s.r[1];
    }
    for (int k = 0; k < 3; k++) { /* from the middle of an edge to its Bezier point */
        const double *a = r[k], *b = r[(k + 1) % 3];
        const double x = r[3 + k][0] - 0.5 * (a[0] + b[0]), y = r[3 + k][1] - 0.5 * (a[1] + b[1]);
        bend = fmax(bend, x * x + y * y);
        r[3 + k][0] += x;
        r[3 + k][1] += y;
    }
    near = c->size * fabs(part->side) * (s.inverse_v + s.inverse_l);
    bend = sqrt(bend) + 0.05 * near * near * near;
    /* Parted from 0 by a line along one of the sides, or by an axis? */
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

static void search(struct curved *c)
{
    struct part stack[3 * DEPTH + 4];
    int count = 0, looked = 0;
    struct state s;

    look(c, 1.0 / 3.0, 1.0 / 3.0, &s);
    stack[count++] = (struct part){ 0.0, 0.0, 1.0, c->size * fmax(s.inverse_v, s.inverse_l), 0 };
    while (count > 0) {
        const struct part p = stack[--count];
        const bool last = p.depth == DEPTH || looked >= PARTS;
        looked += 4;
        if (p.near < 0.4 || last) {
            double start[2];
            const enum verdict verdict = weigh(c, &p, start);
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
        count += quarter(c, &p, stack + count);
    }
}

static inline struct vec to_frame(const struct curved *c, struct vec a)
{
    return (struct vec){ dot(a, c->axis[0]), dot(a, c->axis[1]), dot(a, c->axis[2]) };
}

static inline struct vec from_frame(const struct curved *c, struct vec a)
{
    return mad(mad(scale(c->axis[0], a.x), a.y, c->axis[1]), a.z, c->axis[2]);
}

static void solve_curved(struct query *q, const struct facet *f)
{
    const struct vec p0 = load(f->p[0]), e1 = sub(load(f->p[1]), p0), e2 = sub(load(f->p[2]), p0), cr = cross(e1, e2);
    const double area2 = sqrt(dot(cr, cr)), length = sqrt(dot(e1, e1));
    struct curved c = { .facet = f, .eta = q->eta, .away = q->away, .p0 = p0, .grazing = q->grazing };

    c.axis[2] = scale(cr, 1.0 / area2);
    c.axis[0] = scale(e1, 1.0 / length);
    c.axis[1] = cross(c.axis[2], c.axis[0]);
    c.x = to_frame(&c, sub(q->x, p0));
    c.place = to_frame(&c, q->away ? q->place : sub(q->place, p0));
    if (!(c.x.z < 0.0) || !(c.place.z > 0.0))
        return;
    c.ex1 = length;
    c.ex2 = dot(e2, c.axis[0]);
    c.ey2 = dot(e2, c.axis[1]);
    c.size = sqrt(fmax(fmax(length * length, dot(e2, e2)), dot(sub(e2, e1), sub(e2, e1))));
    c.n = to_frame(&c, load(f->n[0]));
    c.nu = sub(to_frame(&c, load(f->n[1])), c.n);
    c.nv = sub(to_frame(&c, load(f->n[2])), c.n);
    for (int k = 0; k < 3; k++) {
        const double u = (k == 1) - 1.0 / 3.0, v = (k == 2) - 1.0 / 3.0, x = u * c.ex1 + v * c.ex2, y = v * c.ey2;
        const struct vec dn = mad(scale(c.nu, u), v, c.nv);
        c.radius = fmax(c.radius, sqrt(x * x + y * y) * (1.0 + 1e-6));
        c.turn = fmax(c.turn, sqrt(dot(dn, dn)) * (1.0 + 1e-6));
    }
    search(&c);
    for (int i = 0; i < c.roots; i++) {
        struct path p = { .facet = f, .u = c.root[i][0], .v = c.root[i][1], .size = c.size };
        const struct vec at = { p.u * c.ex1 + p.v * c.ex2, p.v * c.ey2, 0.0 };
        double ju[2], jv[2], det, n, cos_i;
        struct state s;
        look(&c, p.u, p.v, &s);
        det = fabs(jacobian(&c, &s, ju, jv));
        n = sqrt(dot(s.n, s.n));
        cos_i = -dot(s.v, s.n) / n;
        p.cos_o = dot(s.l, s.n) / n;
        p.facing_in = -s.v.z;
        p.facing_out = s.l.z;
        if (!(cos_i > 0.0 && p.cos_o > 0.0 && p.facing_in > 0.0 && p.facing_out > 0.0 && s.n.z > 0.0))
            continue;
        p.at = mad(p0, 1.0, from_frame(&c, at));
        p.normal = from_frame(&c, scale(s.n, 1.0 / n));
        p.inside = from_frame(&c, scale(s.v, -1.0));
        p.outside = from_frame(&c, s.l);
        p.inside_mm = 1.0 / s.inverse_v;
        p.outside_mm = q->away ? INFINITY : 1.0 / s.inverse_l;
        /* |d lamp / d(u, v)| |d r / d x| / |d r / d(u, v)|, x in the plane across the path. */
        p.spread = area2 * p.facing_out * (q->away ? 1.0 : s.inverse_l * s.inverse_l) * q->eta * q->eta * s.inverse_v * s.inverse_v *
                   s.n.z * cos_i * n / det;
        keep(q, &p);
    }
}

/* --- The hierarchy ------------------------------------------------------------------------------------------------------------ */

static void find(struct query *q, const struct tree *t, const struct pell_connect_kernels *kernels)
{
    struct pell_connect_search s = { .nodes = t->nodes,
                                     .x = { (float) q->x.x, (float) q->x.y, (float) q->x.z },
                                     .place = { (float) q->place.x, (float) q->place.y, (float) q->place.z },
                                     .eta = (float) q->eta,
                                     .grazing = (float) q->grazing,
                                     .reach = (float) q->reach * (1.0f + 1e-5f),
                                     .away = q->away,
                                     .narrow = fabs(q->eta - 1.0) > 1e-3,
                                     .count = 1 };
    uint32_t facets[4 * LANES];

    for (int n; (n = kernels->find(&s, facets, (int) PELL_COUNT(facets))) > 0;)
        for (int i = 0; i < n; i++) {
            const struct facet *f = &t->facets[facets[i]];
            if (f->planar)
                solve_planar(q, f);
            else
                solve_curved(q, f);
        }
}

/* --- What is in the way ------------------------------------------------------------------------------------------------------- */

double pell_connector_rounding(const struct pell_connector *connector, int body)
{
    return body >= 0 && (size_t) body < connector->bodies->count ? connector->trees[body].rounding : 0.0;
}

static void aim(struct pell_ray_hit16 *r, int lane, struct vec from, struct vec along, double near, double far)
{
    r->ray.ox[lane] = (float) from.x;
    r->ray.oy[lane] = (float) from.y;
    r->ray.oz[lane] = (float) from.z;
    r->ray.dx[lane] = (float) along.x;
    r->ray.dy[lane] = (float) along.y;
    r->ray.dz[lane] = (float) along.z;
    r->ray.tnear[lane] = (float) near;
    r->ray.tfar[lane] = (float) far;
    r->ray.time[lane] = 0.0f;
    r->ray.mask[lane] = PELL_RAY_ALL;
    r->ray.id[lane] = (uint32_t) lane;
    r->ray.flags[lane] = 0;
}

/* Which of up to 8 paths are free, as bits; e: mm of rounding. The triangle that a path refracts through is in the way of neither part. */
static unsigned free_paths(const struct pell_connector *c, const struct query *q, double e, const struct path *const paths[8], int count)
{
    _Alignas(64) int valid[16] = { 0 };
    struct pell_ray_hit16 r;
    unsigned mask = 0;

    memset(&r, 0, sizeof(r));
    for (int i = 0; i < count; i++) {
        const struct path *p = paths[i];
        const double in = e / fmax(p->facing_in, 0.05), out = e / fmax(p->facing_out, 0.01);
        const struct vec to = p->outside_mm < INFINITY ? sub(q->place, p->at) : p->outside;
        const double unit = p->outside_mm < INFINITY ? 1.0 / p->outside_mm : 1.0;
        if (in < p->inside_mm) {
            valid[2 * i] = -1;
            aim(&r, 2 * i, q->x, sub(p->at, q->x), 0.0, 1.0 - in / p->inside_mm);
        }
        if (out < p->outside_mm) {
            valid[2 * i + 1] = -1;
            aim(&r, 2 * i + 1, p->at, to, out * unit, p->outside_mm < INFINITY ? 1.0 : INFINITY);
        }
    }
    pell_rays_closest16(c->rays, valid, false, &r);
    for (int i = 0; i < count; i++) {
        bool open = true;
        for (int k = 2 * i; k < 2 * i + 2; k++)
            open = open && (!valid[k] || r.hit.mesh[k] == PELL_NO_HIT ||
                            (k == 2 * i && r.hit.mesh[k] == paths[i]->facet->mesh && r.hit.triangle[k] == paths[i]->facet->triangle));
        mask |= (unsigned) open << i;
    }
    return mask;
}

static void give(const struct query *q, const struct path *p, struct pell_connection *out)
{
    *out = (struct pell_connection){
        .mesh = p->facet->mesh,
        .triangle = p->facet->triangle,
        .u = (float) fmin(fmax(p->u, 0.0), 1.0),
        .v = (float) fmin(fmax(p->v, 0.0), 1.0),
        .at = narrow(p->at),
        .normal = narrow(p->normal),
        .inside = narrow(p->inside),
        .outside = narrow(p->outside),
        .inside_mm = p->inside_mm,
        .outside_mm = p->outside_mm,
        .transmit = fabs(q->eta - 1.0) < NEAR_ONE ? 1.0 : 1.0 - pell_fresnel(q->eta, p->cos_o),
        .spread = p->spread,
    };
}

/* With one index there is one path, straight on, and the rays themselves say where. */
static int straight(const struct pell_connector *c, int body, const struct query *q, struct pell_connection *out, int64_t *rays)
{
    _Alignas(64) int valid[16] = { -1 };
    const struct vec to = q->away ? q->place : sub(q->place, q->x);
    const double whole = q->away ? INFINITY : sqrt(dot(to, to));
    struct pell_ray_hit16 r;
    struct facet f = { .planar = true };
    struct path p = { .facet = &f };
    struct vec geometric, n;
    double length;

    if (!(whole > 0.0))
        return 0;
    memset(&r, 0, sizeof(r));
    p.inside = p.outside = q->away ? to : scale(to, 1.0 / whole);
    aim(&r, 0, q->x, p.inside, 0.0, fmin(q->reach, whole));
    pell_rays_closest16(c->rays, valid, false, &r);
    *rays += 1;
    if (r.hit.mesh[0] >= c->bodies->num_meshes || c->bodies->of_mesh[r.hit.mesh[0]] != body)
        return 0;
    fill_facet(&c->scene->meshes[r.hit.mesh[0]], r.hit.mesh[0], r.hit.triangle[0], c->flat, &f);
    geometric = cross(sub(load(f.p[1]), load(f.p[0])), sub(load(f.p[2]), load(f.p[0])));
    length = sqrt(dot(geometric, geometric));
    p.facing_in = p.facing_out = length > 0.0 ? dot(p.inside, geometric) / length : 0.0;
    if (!(p.facing_in > 0.0))
        return 0;
    p.u = (double) r.hit.u[0];
    p.v = (double) r.hit.v[0];
    n = mad(mad(scale(load(f.n[0]), 1.0 - p.u - p.v), p.u, load(f.n[1])), p.v, load(f.n[2]));
    length = sqrt(dot(n, n));
    p.normal = length > 0.0 ? scale(n, 1.0 / length) : geometric;
    p.inside_mm = (double) r.ray.tfar[0];
    p.outside_mm = q->away ? INFINITY : whole - p.inside_mm;
    p.at = mad(q->x, p.inside_mm, p.inside);
    p.cos_o = 1.0;
    p.spread = q->away ? 1.0 : 1.0 / (whole * whole);
    if (!(p.inside_mm > 0.0) || !(p.outside_mm > 0.0))
        return 0;
    {
        const double near = c->trees[body].rounding / fmax(p.facing_out, 0.01);
        if (near < p.outside_mm) {
            memset(&r, 0, sizeof(r));
            aim(&r, 0, p.at, p.outside, near, p.outside_mm);
            pell_rays_closest16(c->rays, valid, false, &r);
            *rays += 1;
            if (r.hit.mesh[0] != PELL_NO_HIT)
                return 0;
        }
    }
    give(q, &p, out);
    return 1;
}

/* A number, and one that Embree takes. */
static bool number(struct vec a)
{
    return fabs(a.x) < FAR && fabs(a.y) < FAR && fabs(a.z) < FAR;
}

int pell_connect(const struct pell_connector *connector, int body, double eta, struct pell_vec3 x, struct pell_vec3 place, bool direction,
                 double reach, struct pell_connection *out, int max, int64_t *rays)
{
    struct query q;
    const struct path *order[PELL_CONNECTIONS];
    int64_t traced = 0;
    int given = 0;

    if (body < 0 || (size_t) body >= connector->bodies->count || connector->trees[body].num_facets == 0 || max <= 0 || !(reach > 0.0) ||
        !(eta >= PELL_ETA_MIN && eta <= PELL_ETA_MAX))
        return 0;
    q.eta = eta;
    q.grazing = sqrt(fabs(eta * eta - 1.0));
    q.reach = reach;
    q.x = widen(x);
    q.place = widen(place);
    q.away = direction;
    q.count = 0;
    if (!number(q.x) || !number(q.place))
        return 0;
    if (direction) {
        const double length = sqrt(dot(q.place, q.place));
        if (!(length > 0.0))
            return 0;
        q.place = scale(q.place, 1.0 / length);
    }
    if (fabs(eta - 1.0) < NEAR_ONE) {
        given = straight(connector, body, &q, out, &traced);
        if (rays)
            *rays += traced;
        return given;
    }
    find(&q, &connector->trees[body], connector->kernels);
    for (int i = 0; i < q.count; i++) {
        int at = i;
        for (; at > 0 && order[at - 1]->inside_mm > q.paths[i].inside_mm; at--)
            order[at] = order[at - 1];
        order[at] = &q.paths[i];
    }
    for (int first = 0; first < q.count && given < max; first += 8) {
        const int n = q.count - first < 8 ? q.count - first : 8;
        const unsigned open = free_paths(connector, &q, connector->trees[body].rounding, order + first, n);
        traced += 2 * n;
        for (int i = 0; i < n && given < max; i++)
            if (open >> i & 1)
                give(&q, order[first + i], &out[given++]);
    }
    if (rays)
        *rays += traced;
    return given;
}

/* --- How far the surface is --------------------------------------------------------------------------------------------------- */

/* Squared distance from x to a triangle: to its plane, an edge or a corner, whichever x projects to (C. Ericson, "Real-Time Collision
 * Detection", 2005, section 5.1.5). */
static double away_from(const struct facet *f, struct vec x)
{
    const struct vec a = load(f->p[0]), ab = sub(load(f->p[1]), a), ac = sub(load(f->p[2]), a), ax = sub(x, a);
    const double d1 = dot(ab, ax), d2 = dot(ac, ax), bb = dot(ab, ab), bc = dot(ab, ac), cc = dot(ac, ac);
    const double d3 = d1 - bb, d4 = d2 - bc, d5 = d1 - bc, d6 = d2 - cc, xx = dot(ax, ax);
    double va, vb, vc;
    struct vec n;

    if (d1 <= 0.0 && d2 <= 0.0)
        return xx;
    if (d3 >= 0.0 && d4 <= d3)
        return xx - 2.0 * d1 + bb;
    vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0)
        return xx - d1 * d1 / bb;
    if (d6 >= 0.0 && d5 <= d6)
        return xx - 2.0 * d2 + cc;
    vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0)
        return xx - d2 * d2 / cc;
    va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        const struct vec edge = sub(ac, ab), bx = sub(ax, ab);
        const double along = dot(edge, bx);
        return dot(bx, bx) - along * along / dot(edge, edge);
    }
    n = cross(ab, ac);
    return dot(n, ax) * dot(n, ax) / dot(n, n);
}

double pell_connector_distance(const struct pell_connector *connector, int body, struct pell_vec3 x, double most)
{
    const struct tree *t;
    const struct vec from = widen(x);
    uint32_t stack[PELL_CONNECT_STACK];
    double best = most * most;
    int count = 0;

    if (body < 0 || (size_t) body >= connector->bodies->count || connector->trees[body].num_facets == 0 || !(most > 0.0) || !number(from))
        return most;
    t = &connector->trees[body];
    stack[count++] = 0;
    while (count > 0) {
        const struct pell_connect_node *node = &t->nodes[stack[--count]];
        const float reach = best < INFINITY ? (float) sqrt(best) * (1.0f + 1e-6f) : INFINITY;
        float near[LANES];
        int order[LANES], n = 0;
        for (int i = 0; i < LANES; i++) {
            const float dx = x.x - node->x[i], dy = x.y - node->y[i], dz = x.z - node->z[i];
            near[i] = sqrtf(dx * dx + dy * dy + dz * dz) - node->radius[i];
        }
        for (int i = 0; i < LANES; i++) {
            int at = n;
            if (node->child[i] == NOTHING || near[i] > reach)
                continue;
            if (node->child[i] >= LEAF) {
                const double d = away_from(&t->facets[node->child[i] - LEAF], from);
                best = SMALLER(d, best);
                continue;
            }
            for (; at > 0 && near[order[at - 1]] < near[i]; at--)
                order[at] = order[at - 1];
            order[at] = i;
            n++;
        }
        for (int i = 0; i < n; i++) /* the nearest comes off first */
            stack[count++] = node->child[order[i]];
    }
    return sqrt(LARGER(best, 0.0));
}
