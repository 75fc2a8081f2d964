/* SPDX-License-Identifier: MIT
 * test_refraction.c - refractive connections against closed forms, finite differences, and light traced from the light source. */
#include "connect_rig.h"
#include "slow.h"

#define QUERY(...) (&(struct pell_connection_query) { __VA_ARGS__ })

/* A box whose top, z = 0, is a grid of `cells` x `cells` squares of two triangles. */
static void block(struct rig *r, float half, float deep, int cells)
{
    const int side = cells + 1;
    struct pell_mesh *m = shapes_mesh(r->scene, 0, (uint32_t) (side * side + 20), (uint32_t) (2 * cells * cells + 10));
    static const float corner[5][4][3] = {
        { { -1, -1, -1 }, { -1, 1, -1 }, { 1, 1, -1 }, { 1, -1, -1 } }, { { -1, -1, -1 }, { 1, -1, -1 }, { 1, -1, 0 }, { -1, -1, 0 } },
        { { 1, -1, -1 }, { 1, 1, -1 }, { 1, 1, 0 }, { 1, -1, 0 } },     { { 1, 1, -1 }, { -1, 1, -1 }, { -1, 1, 0 }, { 1, 1, 0 } },
        { { -1, 1, -1 }, { -1, -1, -1 }, { -1, -1, 0 }, { -1, 1, 0 } },
    };
    static const float normal[5][3] = { { 0, 0, -1 }, { 0, -1, 0 }, { 1, 0, 0 }, { 0, 1, 0 }, { -1, 0, 0 } };
    uint32_t *out = m->index, v = (uint32_t) (side * side);

    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            vec3_store(vec3(half * (float) (2 * i - cells) / (float) cells, half * (float) (2 * j - cells) / (float) cells, 0.0f),
                       m->position + 3 * (j * side + i));
            vec3_store(vec3(0, 0, 1), m->normal + 3 * (j * side + i));
        }
    for (int j = 0; j < cells; j++)
        for (int i = 0; i < cells; i++) {
            const uint32_t a = (uint32_t) (j * side + i), b = a + 1, c = a + (uint32_t) side, d = c + 1;
            const uint32_t list[6] = { a, b, d, a, d, c };
            memcpy(out, list, sizeof(list));
            out += 6;
        }
    for (int f = 0; f < 5; f++, v += 4) {
        const uint32_t list[6] = { v, v + 1, v + 2, v, v + 2, v + 3 };
        for (int k = 0; k < 4; k++) {
            vec3_store(vec3(half * corner[f][k][0], half * corner[f][k][1], deep * corner[f][k][2]), m->position + 3 * (v + (uint32_t) k));
            memcpy(m->normal + 3 * (v + (uint32_t) k), normal[f], sizeof(normal[f]));
        }
        memcpy(out, list, sizeof(list));
        out += 6;
    }
    shapes_bound(r->scene, m);
}

/* The fields of a connection are consistent. */
static void check(const struct rig *r, const struct pell_connection *c, double eta, struct pell_vec3 x, struct pell_vec3 target,
                  bool distant, bool flat)
{
    const struct pell_mesh *m = &r->scene->meshes[c->mesh];
    const uint32_t *i = m->index + 3 * (size_t) c->triangle;
    const struct pell_vec3 a = vec3_load(m->position + 3 * (size_t) i[0]), b = vec3_load(m->position + 3 * (size_t) i[1]),
                           d = vec3_load(m->position + 3 * (size_t) i[2]);
    const struct pell_vec3 at = vec3_add(vec3_mul(a, 1.0f - c->u - c->v), vec3_add(vec3_mul(b, c->u), vec3_mul(d, c->v)));
    const double cos_i = (double) vec3_dot(c->inside, c->normal), cos_o = (double) vec3_dot(c->outside, c->normal);
    const struct pell_vec3 half = vec3_mad(vec3_mul(c->inside, (float) -eta), 1.0f, c->outside);
    const struct pell_vec3 off = vec3_cross(half, c->normal), to_exit = vec3_sub(c->at, x), out = vec3_sub(target, c->at);

    REQUIRE(c->u >= 0.0f && c->v >= 0.0f && c->u + c->v <= 1.00001f);
    REQUIRE_NEAR((double) vec3_length(vec3_sub(at, c->at)), 0.0, 1e-4 + 1e-6 * (double) (vec3_length(a) + vec3_length(b)));
    REQUIRE_NEAR((double) vec3_length(c->normal), 1.0, 1e-5);
    REQUIRE(cos_i > 0.0 && cos_o > 0.0);
    REQUIRE_NEAR((double) vec3_length(off), 0.0, 2e-6);
    REQUIRE_NEAR((double) vec3_length(to_exit), c->inside_mm, 1e-4);
    REQUIRE_NEAR((double) vec3_dot(to_exit, c->inside), c->inside_mm, 1e-4);
    if (distant) {
        REQUIRE(isinf(c->outside_mm));
        REQUIRE_NEAR((double) vec3_length(vec3_sub(c->outside, vec3_normalize(target))), 0.0, 1e-6);
    } else {
        REQUIRE_NEAR((double) vec3_dot(out, c->outside), c->outside_mm, 1e-4 * c->outside_mm);
    }
    REQUIRE_NEAR(c->transmit, eta == 1.0 ? 1.0 : 1.0 - pell_fresnel(eta, cos_o), 2e-4);
    REQUIRE(c->spread > 0.0 && isfinite(c->spread));
    if (flat)
        REQUIRE_NEAR((double) vec3_length(vec3_sub(c->normal, vec3_normalize(vec3_cross(vec3_sub(b, a), vec3_sub(d, a))))), 0.0, 1e-5);
}

/* --- Closed forms ------------------------------------------------------------------------------------------------------------- */

/* Through a plane: one path, which must be found exactly once also where x, light and vertices are vertically aligned. */
static void plane(void **state)
{
    static const double etas[] = { 1.0, 1.3, 1.5, 0.75, 1.0005, 2.4 };
    uint64_t random = 1;

    (void) state;
    for (int cells = 1; cells <= 8; cells *= 8)
        for (size_t e = 0; e < PELL_COUNT(etas); e++)
            for (int flat = 0; flat < 2; flat++) {
                const double eta = etas[e];
                struct rig r;
                double worst = 0.0;
                rig_start(&r);
                block(&r, 400.0f, 10.0f, cells);
                rig_build(&r, flat);
                for (int k = 0; k < 200; k++) {
                    const bool grid = k < 100, distant = k % 2;
                    const struct pell_vec3 x = grid ? vec3((float) (k % 5 - 2) * 50.0f, (float) (k / 5 % 5 - 2) * 25.0f, -2.0f)
                                                    : vec3((float) (8.0 * unit(&random) - 4.0), (float) (8.0 * unit(&random) - 4.0),
                                                           (float) (-1e-3 - 3.0 * unit(&random)));
                    const double cos_o = k < 50 ? 1.0 : 0.05 + 0.95 * unit(&random), phi = 6.2831853 * unit(&random);
                    const double sin_o = sqrt(1.0 - cos_o * cos_o), sin_i = sin_o / eta, cos_i = sqrt(1.0 - sin_i * sin_i);
                    const double below = -(double) x.z, above = 3.0 + 30.0 * unit(&random);
                    const double lateral = below * sin_i / cos_i + above * sin_o / cos_o;
                    struct pell_vec3 target =
                        vec3((float) ((double) x.x + lateral * cos(phi)), (float) ((double) x.y + lateral * sin(phi)), (float) above);
                    struct pell_connection c[4];
                    double spread;
                    int n;
                    if (!(sin_i < 0.999) || below * sin_i / cos_i > 14.0)
                        continue;
                    if (distant)
                        target = vec3((float) (sin_o * cos(phi)), (float) (sin_o * sin(phi)), (float) cos_o);
                    n = pell_connect(r.connector, QUERY(0, eta, x, target, distant, INFINITY), c, 4, NULL);
                    if (n != 1)
                        fail_msg("%d paths through a plane, eta %g, x %g %g %g, cos %g, cells %d", n, eta, (double) x.x, (double) x.y,
                                 (double) x.z, cos_o, cells);
                    check(&r, c, eta, x, target, distant, true);
                    REQUIRE_NEAR((double) vec3_dot(c->outside, c->normal), cos_o, 2e-5);
                    REQUIRE_NEAR((double) vec3_dot(c->inside, c->normal), cos_i, 2e-5);
                    /* Rays within the plane of incidence diverge by their angle (Snell's law differentiated), those across it by
                     * rotation. */
                    spread = cos_o / cos_i;
                    if (!distant)
                        spread = 1.0 / ((above / cos_o * cos_i / cos_o + below / cos_i * cos_o / (eta * cos_i)) *
                                        (sin_o > 1e-9 ? lateral / sin_o : below / eta + above));
                    worst = fmax(worst, fabs(c->spread / spread - 1.0));
                    if (eta == 1.0)
                        REQUIRE_NEAR(c->spread, distant ? 1.0 : 1.0 / (double) vec3_dot(vec3_sub(target, x), vec3_sub(target, x)),
                                     1e-6 * c->spread);
                    REQUIRE(pell_connect(r.connector, QUERY(0, eta, x, target, distant, 0.999 * c->inside_mm), c + 1, 3, NULL) == 0);
                }
                REQUIRE(worst < 2e-4);
                rig_finish(&r);
            }
}

/* On the axis of a ball: the paraxial formula of one spherical surface. */
static void ball_on_axis(void **state)
{
    static const double etas[] = { 1.3, 1.5, 0.8 };
    double worst = 0.0, coarse = 0.0;

    (void) state;
    for (int rings = 48; rings <= 192; rings *= 4)
        for (size_t e = 0; e < PELL_COUNT(etas); e++) {
            const struct pell_vec3 axis = vec3_normalize(vec3(0.3f, 0.85f, 0.2f));
            const double radius = 10.0, eta = etas[e];
            struct rig r;
            rig_start(&r);
            shapes_ball(r.scene, 0, vec3(0, 0, 0), (float) radius, rings);
            rig_build(&r, false);
            for (double deep = 0.5; deep < 16.0; deep += 2.5)
                for (int distant = 0; distant < 2; distant++) {
                    const double far = 25.0, y = distant ? 1.0 - deep * (eta - 1.0) / (eta * radius)
                                                         : far + deep / eta * (1.0 - far * (eta - 1.0) / radius);
                    const struct pell_vec3 x = vec3_mul(axis, (float) (radius - deep));
                    struct pell_connection c[16];
                    const int n = pell_connect(r.connector,
                                               QUERY(0, eta, x, distant ? axis : vec3_mul(axis, (float) (radius + far)), distant, INFINITY),
                                               c, 16, NULL);
                    int at = -1;
                    for (int i = 0; i < n; i++)
                        if (vec3_dot(c[i].inside, axis) > 0.99999f)
                            at = i;
                    REQUIRE(at >= 0);
                    check(&r, &c[at], eta, x, distant ? axis : vec3_mul(axis, (float) (radius + far)), distant, false);
                    if (rings == 48)
                        coarse = fmax(coarse, fabs(c[at].spread * y * y - 1.0));
                    else
                        worst = fmax(worst, fabs(c[at].spread * y * y - 1.0));
                }
            rig_finish(&r);
        }
    print_message("# spread on the axis of a ball: off by %.5f at most with 48 rings, %.5f with 192\n", coarse, worst);
    REQUIRE(coarse < 0.01 && worst < 0.002);
}

/* --- Finite differences ------------------------------------------------------------------------------------------------------- */

static const struct pell_connection *same_path(const struct pell_connection *list, int n, const struct pell_connection *to)
{
    const struct pell_connection *best = NULL;

    for (int i = 0; i < n; i++)
        if (!best || vec3_length(vec3_sub(list[i].at, to->at)) < vec3_length(vec3_sub(best->at, to->at)))
            best = &list[i];
    return best;
}

/* Derivative of the direction at the light, or of the position in the beam, with respect to x, for each triangle that contains the
 * refraction point. */
static void spread_by_differences(void **state)
{
    const double eta = 1.4;
    uint64_t random = 5;

    (void) state;
    for (int flat = 0; flat < 2; flat++) {
        struct rig r;
        double sum = 0.0, worst = 0.0;
        int count = 0;
        rig_start(&r);
        bumpy(&r, 10.0f, 0.6f, 24);
        rig_build(&r, flat);
        for (int k = 0; k < (SLOW ? 300 : 1200); k++) {
            const bool distant = k % 2;
            const struct pell_vec3 d = vec3_normalize(in_ball(&random)), x = vec3_mul(in_ball(&random), 9.0f);
            const struct pell_vec3 target = distant ? d : vec3_mul(d, 14.0f);
            struct pell_connection c[16];
            const int n = pell_connect(r.connector, QUERY(0, eta, x, target, distant, INFINITY), c, 16, NULL);
            for (int i = 0; i < n; i++) {
                struct pell_vec3 axis[2], to[2], along[2];
                double moved[2][2] = { { 0 } }, step = 1.0 / 256.0, area, found;
                bool stayed = true;
                check(&r, &c[i], eta, x, target, distant, flat);
                vec3_basis(c[i].inside, &axis[0], &axis[1]);
                vec3_basis(c[i].outside, &along[0], &along[1]);
                for (int a = 0; a < 2 && stayed; a++) {
                    struct pell_vec3 real[2];
                    for (int s = 0; s < 2 && stayed; s++) {
                        struct pell_connection other[16];
                        const struct pell_connection *p;
                        real[s] = vec3_mad(x, (float) (s ? step : -step), axis[a]);
                        p = same_path(other, pell_connect(r.connector, QUERY(0, eta, real[s], target, distant, INFINITY), other, 16, NULL),
                                      &c[i]);
                        stayed = p && p->mesh == c[i].mesh && p->triangle == c[i].triangle && vec3_length(vec3_sub(p->at, c[i].at)) < 0.2f;
                        if (stayed)
                            to[s] = p->at;
                    }
                    for (int b = 0; b < 2 && stayed; b++)
                        moved[a][b] =
                            (double) vec3_dot(vec3_sub(to[1], to[0]), along[b]) / (2.0 * step) / (distant ? 1.0 : c[i].outside_mm);
                }
                area = fabs(moved[0][0] * moved[1][1] - moved[0][1] * moved[1][0]);
                found = c[i].spread;
                if (!stayed || area > (distant ? 5.0 : 0.05)) /* near a caustic, finite differences do not approximate the derivative */
                    continue;
                sum += fabs(area / found - 1.0);
                worst = fmax(worst, fabs(area - found) / (found + (distant ? 0.05 : 5e-4)));
                count++;
            }
        }
        print_message("# spread of %d paths (%s) by differences: off by %.5f on average, %.4f at most\n", count, flat ? "flat" : "smooth",
                      sum / count, worst);
        REQUIRE(count > (SLOW ? 50 : 300));
        REQUIRE(sum / count < 0.004);
        REQUIRE(worst < 0.15);
        rig_finish(&r);
    }
}

/* --- Number of paths ---------------------------------------------------------------------------------------------------------- */

/* Paths into a ball lie in the plane of x, light and centre: roots of one equation in the angle, found by brute force. */
static int count_on_circle(double eta, double radius, const double x[2], const double source[2], bool distant, double *nearest)
{
    double before = 0.0, best = INFINITY;
    int count = 0;

    for (int k = 0; k <= 20000; k++) {
        const double t = 2.0 * PELL_PI * k / 20000.0, n[2] = { cos(t), sin(t) }, p[2] = { radius * n[0], radius * n[1] };
        double w[2] = { distant ? source[0] : source[0] - p[0], distant ? source[1] : source[1] - p[1] },
               in[2] = { x[0] - p[0], x[1] - p[1] }, l, f;
        l = hypot(w[0], w[1]);
        w[0] /= l;
        w[1] /= l;
        l = hypot(in[0], in[1]);
        in[0] /= l;
        in[1] /= l;
        if (w[0] * n[0] + w[1] * n[1] <= 0.0) {
            before = NAN;
            continue;
        }
        f = (eta * in[0] + w[0]) * n[1] - (eta * in[1] + w[1]) * n[0];
        if (k > 0 && before == before && (before > 0.0) != (f > 0.0))
            count++;
        else
            best = fmin(best, fabs(f));
        before = f;
    }
    *nearest = best;
    return count;
}

static void how_many_in_a_ball(void **state)
{
    const double radius = 10.0;
    int counts[8] = { 0 }, wrong = 0, near = 0;
    uint64_t random = 9;
    struct rig r;

    (void) state;
    rig_start(&r);
    shapes_ball(r.scene, 0, vec3(0, 0, 0), (float) radius, SLOW ? 60 : 200);
    rig_build(&r, false);
    for (int k = 0; k < (SLOW ? 60 : 600); k++) {
        const double eta = k % 4 < 2 ? 1.5 : 2.4; /* the latter has its focus inside */
        const bool distant = k % 2;
        const struct pell_vec3 d = vec3_normalize(in_ball(&random)), x = vec3_mul(in_ball(&random), 9.8f);
        const struct pell_vec3 side = vec3_sub(x, vec3_mul(d, vec3_dot(x, d))), target = distant ? d : vec3_mul(d, 30.0f);
        const double flat_x[2] = { (double) vec3_dot(x, d), (double) vec3_length(side) }, source[2] = { distant ? 1.0 : 30.0, 0.0 };
        struct pell_connection c[16];
        double nearest;
        const int n = pell_connect(r.connector, QUERY(0, eta, x, target, distant, INFINITY), c, 16, NULL);
        const int expected = count_on_circle(eta, radius, flat_x, source, distant, &nearest);
        for (int i = 0; i < n; i++)
            check(&r, &c[i], eta, x, target, distant, false);
        counts[expected < 8 ? expected : 7]++;
        wrong += n != expected;
        near += n != expected && nearest > 0.02; /* not close to gaining or losing a pair */
    }
    print_message("# in a ball: %d without, %d with one, %d with two, %d with three paths; %d counted differently, %d not at a caustic\n",
                  counts[0], counts[1], counts[2], counts[3], wrong, near);
    REQUIRE(counts[0] > 0 && counts[1] > 0 && counts[2] > 0 && (SLOW || counts[3] > 0));
    REQUIRE(wrong <= (SLOW ? 2 : 12));
    REQUIRE(near <= wrong / 2 + 1);
    rig_finish(&r);
}

/* Traces a random ray from inside to outside: from the point that it reaches, the connection must find the same path back. */
/* A ball of long thin triangles. */
static void spindle(struct rig *r, float radius, float longer, int rings)
{
    struct pell_mesh *m = shapes_ball(r->scene, 0, vec3(0, 0, 0), radius, rings);

    for (uint32_t i = 0; i < m->num_vertices; i++) {
        const struct pell_vec3 n = vec3_load(m->normal + 3 * i);
        m->position[3 * i + 1] *= longer;
        vec3_store(vec3_normalize(vec3(n.x, n.y / longer, n.z)), m->normal + 3 * i);
    }
}

static void no_path_is_missing(void **state)
{
    static const char *const shapes[] = { "ball", "bumpy", "spindle" };
    static const double etas[] = { 1.4, 1.05, 0.8, 1.0 };
    uint64_t random = 13;

    (void) state;
    for (size_t shape = 0; shape < PELL_COUNT(shapes); shape++)
        for (int flat = 0; flat < 2; flat++) {
            int tried = 0, missing = 0, blocked = 0;
            struct rig r;
            rig_start(&r);
            if (shape == 0)
                shapes_ball(r.scene, 0, vec3(0, 0, 0), 10.0f, 14);
            else if (shape == 1)
                bumpy(&r, 10.0f, 0.6f, 30);
            else
                spindle(&r, 10.0f, 20.0f, 14);
            rig_build(&r, flat);
            for (int k = 0; k < (SLOW ? 400 : 6000); k++) {
                const double eta = etas[k % 4];
                const struct pell_vec3 w = vec3_normalize(in_ball(&random)), d = vec3_normalize(in_ball(&random));
                const bool distant = k / 4 % 2;
                _Alignas(64) int valid[16] = { -1 };
                struct pell_connection c[PELL_CONNECTIONS];
                struct pell_vec3 x = vec3_mul(in_ball(&random), 9.0f);
                struct pell_ray_hit16 p;
                struct pell_vec3 n, g, at, out;
                double ci, co;
                bool found = false;
                int count;
                memset(&p, 0, sizeof(p));
                if (k / 8 % 2) { /* shallow */
                    p.ray.dx[0] = d.x;
                    p.ray.dy[0] = d.y;
                    p.ray.dz[0] = d.z;
                    p.ray.tfar[0] = INFINITY;
                    p.ray.mask[0] = PELL_RAY_ALL;
                    pell_rays_closest16(r.rays, valid, false, &p);
                    x = vec3_mul(d, p.ray.tfar[0] - (float) pow(10.0, -3.0 + 3.0 * unit(&random)));
                    memset(&p, 0, sizeof(p));
                }
                p.ray.ox[0] = x.x;
                p.ray.oy[0] = x.y;
                p.ray.oz[0] = x.z;
                p.ray.dx[0] = w.x;
                p.ray.dy[0] = w.y;
                p.ray.dz[0] = w.z;
                p.ray.tfar[0] = INFINITY;
                p.ray.mask[0] = PELL_RAY_ALL;
                pell_rays_closest16(r.rays, valid, false, &p);
                g = n = vec3_normalize(vec3(p.hit.ngx[0], p.hit.ngy[0], p.hit.ngz[0]));
                if (!flat) {
                    const uint32_t *v = r.scene->meshes[0].index + 3 * (size_t) p.hit.triangle[0];
                    const float *normals = r.scene->meshes[0].normal;
                    n = vec3_mul(vec3_load(normals + 3 * v[0]), 1.0f - p.hit.u[0] - p.hit.v[0]);
                    n = vec3_mad(n, p.hit.u[0], vec3_load(normals + 3 * v[1]));
                    n = vec3_normalize(vec3_mad(n, p.hit.v[0], vec3_load(normals + 3 * v[2])));
                }
                ci = (double) vec3_dot(w, n);
                co = 1.0 - eta * eta * (1.0 - ci * ci);
                if (p.hit.mesh[0] != 0 || !(ci > 1e-3 && co > 1e-6))
                    continue;
                co = sqrt(co);
                at = vec3_mad(x, p.ray.tfar[0], w);
                out = vec3_normalize(vec3_mad(vec3_mul(w, (float) eta), (float) (co - eta * ci), n));
                if (!(vec3_dot(out, g) > 1e-4f))
                    continue;
                memset(&p, 0, sizeof(p));
                p.ray.ox[0] = at.x;
                p.ray.oy[0] = at.y;
                p.ray.oz[0] = at.z;
                p.ray.dx[0] = out.x;
                p.ray.dy[0] = out.y;
                p.ray.dz[0] = out.z;
                p.ray.tnear[0] = 1e-3f;
                p.ray.tfar[0] = distant ? INFINITY : 15.0f;
                p.ray.mask[0] = PELL_RAY_ALL;
                pell_rays_closest16(r.rays, valid, false, &p);
                if (p.hit.mesh[0] != PELL_NO_HIT) {
                    blocked++;
                    continue;
                }
                count = pell_connect(r.connector, QUERY(0, eta, x, distant ? out : vec3_mad(at, 15.0f, out), distant, INFINITY), c,
                                     PELL_CONNECTIONS, NULL);
                for (int i = 0; i < count; i++)
                    found = found || vec3_length(vec3_sub(c[i].at, at)) < 0.01f;
                tried++;
                missing += !found;
            }
            print_message("# %s, %s: %d of %d paths missing, %d blocked\n", shapes[shape], flat ? "flat" : "smooth", missing, tried,
                          blocked);
            REQUIRE(tried > (SLOW ? 100 : 1500));
            REQUIRE(missing <= (flat ? 0 : tried / 1000)); /* at a caustic a small rounding of the direction moves the point far */
            rig_finish(&r);
        }
}

/* --- Light traced from the source ---------------------------------------------------------------------------------------------- */

#define PROBES 24

/* A solid illuminated by a source, and probe balls in it. */
struct entering {
    struct rig r;
    bool flat, distant;
    double eta;
    struct pell_vec3 target, direction, t, b; /* of the source; toward it, and perpendicular */
    double cos_max, each;                     /* of the cone of rays from a point; flux of a ray */
    struct pell_vec3 probe[PROBES];
    float size;
    double traced[PROBES], square[PROBES], variance;
};

/* Rays from the source, at random over the solid. */
static void aim(const struct entering *e, uint64_t *random, struct pell_ray_hit16 *p, int valid[16])
{
    memset(p, 0, sizeof(*p));
    for (int i = 0; i < 16; i++) {
        struct pell_vec3 o = vec3_mul(e->direction, 22.0f), w = vec3_mul(e->direction, -1.0f);
        valid[i] = -1;
        if (e->distant) {
            o = vec3_mad(vec3_mad(o, (float) (21.6 * unit(random) - 10.8), e->t), (float) (21.6 * unit(random) - 10.8), e->b);
        } else {
            const double c = 1.0 - unit(random) * (1.0 - e->cos_max), s = sqrt(1.0 - c * c), phi = 2.0 * PELL_PI * unit(random);
            w = vec3_mad(vec3_mad(vec3_mul(w, (float) c), (float) (s * cos(phi)), e->t), (float) (s * sin(phi)), e->b);
        }
        p->ray.ox[i] = o.x;
        p->ray.oy[i] = o.y;
        p->ray.oz[i] = o.z;
        p->ray.dx[i] = w.x;
        p->ray.dy[i] = w.y;
        p->ray.dz[i] = w.z;
        p->ray.tfar[i] = INFINITY;
        p->ray.mask[i] = PELL_RAY_ALL;
    }
}

/* Continues inside, refracted where the rays hit the solid. */
static void enter(const struct entering *e, struct pell_ray_hit16 *p, int valid[16], double weight[16])
{
    for (int i = 0; i < 16; i++) {
        const struct pell_vec3 w = vec3(p->ray.dx[i], p->ray.dy[i], p->ray.dz[i]);
        const struct pell_vec3 g = vec3_normalize(vec3(p->hit.ngx[i], p->hit.ngy[i], p->hit.ngz[i]));
        struct pell_vec3 n = g, in;
        double cos_o, cos_i;
        if (p->hit.mesh[i] == PELL_NO_HIT) {
            valid[i] = 0;
            continue;
        }
        if (!e->flat) {
            const struct pell_mesh *m = &e->r.scene->meshes[p->hit.mesh[i]];
            const uint32_t *v = m->index + 3 * (size_t) p->hit.triangle[i];
            n = vec3_mul(vec3_load(m->normal + 3 * (size_t) v[0]), 1.0f - p->hit.u[i] - p->hit.v[i]);
            n = vec3_mad(n, p->hit.u[i], vec3_load(m->normal + 3 * (size_t) v[1]));
            n = vec3_normalize(vec3_mad(n, p->hit.v[i], vec3_load(m->normal + 3 * (size_t) v[2])));
        }
        cos_o = -(double) vec3_dot(w, n);
        cos_i = sqrt(1.0 - (1.0 - cos_o * cos_o) / (e->eta * e->eta));
        in = vec3_mad(vec3_mul(w, (float) (1.0 / e->eta)), (float) (cos_o / e->eta - cos_i), n);
        if (!(cos_o > 0.0) || !(vec3_dot(w, g) < 0.0f) || !(vec3_dot(in, g) < 0.0f)) {
            valid[i] = 0;
            continue;
        }
        weight[i] = e->each * (1.0 - pell_fresnel(e->eta, cos_o));
        p->ray.ox[i] += p->ray.tfar[i] * w.x;
        p->ray.oy[i] += p->ray.tfar[i] * w.y;
        p->ray.oz[i] += p->ray.tfar[i] * w.z;
        p->ray.dx[i] = in.x;
        p->ray.dy[i] = in.y;
        p->ray.dz[i] = in.z;
        p->ray.tnear[i] = 1e-4f;
        p->ray.tfar[i] = INFINITY;
    }
}

/* Estimates the fluence in the probe balls by path length. */
static void count(struct entering *e, const struct pell_ray_hit16 *p, const int valid[16], const double weight[16])
{
    for (int i = 0; i < 16; i++) {
        double both = 0.0;
        for (int k = 0; valid[i] && k < PROBES; k++) {
            const struct pell_vec3 to = vec3_sub(e->probe[k], vec3(p->ray.ox[i], p->ray.oy[i], p->ray.oz[i]));
            const double along = (double) vec3_dot(to, vec3(p->ray.dx[i], p->ray.dy[i], p->ray.dz[i]));
            const double distance2 = (double) vec3_dot(to, to) - along * along, half2 = (double) (e->size * e->size) - distance2;
            double length;
            if (half2 <= 0.0 || along <= 0.0)
                continue;
            length = fmin(along + sqrt(half2), (double) p->ray.tfar[i]) - fmax(along - sqrt(half2), 0.0);
            length = fmax(length, 0.0) * weight[i] / (4.0 / 3.0 * PELL_PI * pow((double) e->size, 3.0));
            e->traced[k] += length;
            e->square[k] += length * length;
            both += length;
        }
        e->variance += both * both; /* balls overlap */
    }
}

/* Contribution of connections, averaged over a ball; returns its variance, too. */
static double connect_ball(const struct entering *e, int k, uint64_t *random, double *variance)
{
    const int points = SLOW ? 20 : 100;
    double sum = 0.0, sum2 = 0.0;

    for (int i = 0; i < points; i++) {
        const struct pell_vec3 x = vec3_mad(e->probe[k], e->size, in_ball(random));
        struct pell_connection c[32];
        const int n = pell_connect(e->r.connector, QUERY(0, e->eta, x, e->target, e->distant, INFINITY), c, 32, NULL);
        double light = 0.0;
        for (int j = 0; j < n; j++)
            light += c[j].spread * c[j].transmit;
        sum += light / points;
        sum2 += light * light / points;
    }
    *variance = (sum2 - sum * sum) / points;
    return sum;
}

static void light_that_enters_as_traced(int shape, bool flat, bool distant, uint64_t *random)
{
    static const char *const names[] = { "box", "ball", "bumpy" };
    const int64_t rays = SLOW ? 16000 : 96000;
    const struct pell_vec3 d = vec3_normalize(vec3(0.3f, 0.2f, 0.9f));
    struct entering e = {
        .flat = flat, .distant = distant, .eta = 1.4, .direction = d, .target = distant ? d : vec3_mul(d, 22.0f), .size = 0.8f
    };
    double chi = 0.0, total[2] = { 0 };

    e.cos_max = sqrt(1.0 - 10.8 * 10.8 / (22.0 * 22.0));
    e.each = distant ? 4.0 * 10.8 * 10.8 / (double) rays : 2.0 * PELL_PI * (1.0 - e.cos_max) / (double) rays;
    rig_start(&e.r);
    if (shape == 0)
        block(&e.r, 7.0f, 9.0f, 1);
    else if (shape == 1)
        shapes_ball(e.r.scene, 0, vec3(0, 0, 0), 10.0f, 32);
    else
        bumpy(&e.r, 10.0f, 0.6f, 40);
    rig_build(&e.r, flat);
    vec3_basis(d, &e.t, &e.b);
    for (int k = 0; k < PROBES; k++)
        e.probe[k] = shape == 0 ? vec3_add(vec3_mul(in_ball(random), 3.5f), vec3(0, 0, -4.5f)) : vec3_mul(in_ball(random), 8.0f);
    for (int64_t first = 0; first < rays; first += 16) {
        _Alignas(64) int valid[16];
        struct pell_ray_hit16 p;
        double weight[16];
        aim(&e, random, &p, valid);
        pell_rays_closest16(e.r.rays, valid, false, &p);
        enter(&e, &p, valid, weight);
        pell_rays_closest16(e.r.rays, valid, false, &p);
        count(&e, &p, valid, weight);
    }
    for (int k = 0; k < PROBES; k++) {
        double variance;
        const double sum = connect_ball(&e, k, random, &variance), v = e.square[k] + variance;
        if (v > 0.0)
            chi += (e.traced[k] - sum) * (e.traced[k] - sum) / v / PROBES;
        else
            assert_true(e.traced[k] == sum);
        total[0] += e.traced[k];
        total[1] += sum;
        e.variance += variance;
    }
    print_message("# %s, %s, %s: connections give %.4f of the light that enters, +- %.4f; chi^2 per probe %.2f\n", names[shape],
                  flat ? "flat" : "smooth", distant ? "sun" : "point", total[1] / total[0], sqrt(e.variance) / total[0], chi);
    REQUIRE_NEAR(total[1], total[0], 4.0 * sqrt(e.variance) + 0.002 * total[0]);
    REQUIRE(chi < 2.0);
    rig_finish(&e.r);
}

/* Light traced at random from the source, with the fluence estimated in small balls, equals the contribution of connections averaged
 * over the same balls. */
static void light_that_enters(void **state)
{
    uint64_t random = 21;

    (void) state;
    for (int shape = 0; shape < 3; shape++)
        for (int flat = 0; flat < 2; flat++)
            for (int distant = 0; distant < 2; distant++)
                light_that_enters_as_traced(shape, flat, distant, &random);
}

/* --- Occluders, and invalid queries ------------------------------------------------------------------------------------------- */

static void objects_in_the_way(void **state)
{
    struct pell_connection c[4];
    struct rig r;

    (void) state;
    for (int where = 0; where < 3; where++) {
        const size_t before = where;
        rig_start(&r);
        block(&r, 20.0f, 10.0f, 2);
        if (where > 0)
            shapes_quad(r.scene, shapes_material(r.scene, true), vec3(0, 0, before == 1 ? 3.0f : -1.0f), vec3(2, 0, 0), vec3(0, 2, 0));
        rig_build(&r, true);
        for (int eta = 0; eta < 2; eta++)
            for (int distant = 0; distant < 2; distant++) {
                const struct pell_vec3 target = distant ? vec3(0, 0, 1) : vec3(0.2f, 0.1f, 8.0f);
                int64_t rays = 0;
                assert_int_equal(
                    pell_connect(r.connector, QUERY(0, eta ? 1.3 : 1.0, vec3(0.1f, 0.3f, -2.0f), target, distant, INFINITY), c, 4, &rays),
                    where == 0);
                REQUIRE(rays > 0);
                assert_int_equal(
                    pell_connect(r.connector, QUERY(0, eta ? 1.3 : 1.0, vec3(9.1f, 0.3f, -2.0f), target, distant, INFINITY), c, 4, NULL),
                    1);
            }
        rig_finish(&r);
    }
}

static void hostile(void **state)
{
    static const float odd[] = { NAN, INFINITY, -INFINITY, 1e38f, -1e38f, 1e-38f, 0.0f };
    struct pell_connection c[4];
    struct pell_mesh *m;
    struct rig r;

    (void) state;
    rig_start(&r);
    shapes_ball(r.scene, 0, vec3(0, 0, 0), 10.0f, 24);
    m = shapes_mesh(r.scene, 0, 9, 3); /* zero area; needles; missing normals */
    for (int i = 0; i < 9; i++)
        vec3_store(vec3((float) (i % 3), i >= 3 ? 1e-7f * (float) (i % 3 == 1) : 0.0f, 11.0f), m->position + 3 * i);
    for (uint32_t i = 0; i < 9; i++)
        m->index[i] = i;
    shapes_bound(r.scene, m);
    for (int flat = 0; flat < 2; flat++) {
        rig_build(&r, flat);
        for (int distant = 0; distant < 2; distant++) {
            const struct pell_vec3 in = vec3(0, 1, 3), source = vec3(0, 3, 20);
            assert_int_equal(pell_connect(r.connector, QUERY(-1, 1.3, in, source, distant, INFINITY), c, 4, NULL), 0);
            assert_int_equal(pell_connect(r.connector, QUERY(1, 1.3, in, source, distant, INFINITY), c, 4, NULL), 0);
            assert_int_equal(pell_connect(r.connector, QUERY(0, 1.3, in, source, distant, 0.0), c, 4, NULL), 0);
            assert_int_equal(pell_connect(r.connector, QUERY(0, 1.3, in, source, distant, NAN), c, 4, NULL), 0);
            assert_int_equal(pell_connect(r.connector, QUERY(0, 1.3, in, source, distant, INFINITY), c, 0, NULL), 0);
            assert_int_equal(pell_connect(r.connector, QUERY(0, 1.3, in, source, distant, INFINITY), c, -1, NULL), 0);
            assert_int_equal(pell_connect(r.connector, QUERY(0, NAN, in, source, distant, INFINITY), c, 4, NULL), 0);
            assert_int_equal(pell_connect(r.connector, QUERY(0, 0.0, in, source, distant, INFINITY), c, 4, NULL), 0);
            assert_int_equal(pell_connect(r.connector, QUERY(0, -1.3, in, source, distant, INFINITY), c, 4, NULL), 0);
            assert_int_equal(pell_connect(r.connector, QUERY(0, INFINITY, in, source, distant, INFINITY), c, 4, NULL), 0);
            for (size_t i = 0; i < PELL_COUNT(odd); i++)
                for (int eta = 0; eta < 3; eta++) {
                    const double index = eta == 0 ? 1.0 : eta == 1 ? 1.5 : 0.7;
                    const struct pell_vec3 strange = vec3(odd[i], odd[(i + 1) % PELL_COUNT(odd)], odd[(i + 2) % PELL_COUNT(odd)]);
                    int n = pell_connect(r.connector, QUERY(0, index, strange, source, distant, INFINITY), c, 4, NULL);
                    REQUIRE(n >= 0 && n <= 4);
                    n = pell_connect(r.connector, QUERY(0, index, in, strange, distant, INFINITY), c, 4, NULL);
                    REQUIRE(n >= 0 && n <= 4);
                    for (int k = 0; k < n; k++)
                        REQUIRE(isfinite(c[k].spread) && isfinite(c[k].inside_mm) && c[k].transmit >= 0.0 && c[k].transmit <= 1.0);
                }
            /* Outside, on the surface, and a light inside: no path, or at most one as short as the rounding error. */
            for (int eta = 0; eta < 2; eta++) {
                const double index = eta ? 1.4 : 1.0;
                assert_int_equal(pell_connect(r.connector, QUERY(0, index, vec3(0, 3, 12), source, distant, INFINITY), c, 4, NULL), 0);
                assert_int_equal(pell_connect(r.connector, QUERY(0, index, vec3(0, -30, 0), source, distant, INFINITY), c, 4, NULL), 0);
                if (!distant) {
                    assert_int_equal(pell_connect(r.connector, QUERY(0, index, in, vec3(0, 2, 2), distant, INFINITY), c, 4, NULL), 0);
                    assert_int_equal(pell_connect(r.connector, QUERY(0, index, in, in, distant, INFINITY), c, 4, NULL), 0);
                }
                for (int k = 0; k < 3; k++) {
                    const struct pell_vec3 on = vec3_load(r.scene->meshes[0].position + 3 * (100 + 77 * k));
                    const int n = pell_connect(r.connector, QUERY(0, index, on, vec3_mul(on, 2.0f), distant, INFINITY), c, 4, NULL);
                    REQUIRE(n >= 0 && n <= 4);
                    for (int j = 0; j < n; j++)
                        REQUIRE(isfinite(c[j].spread) && c[j].inside_mm < 10.0);
                }
            }
        }
    }
    rig_finish(&r);
}

/* The nearest point by brute force: every triangle, sampled finely around its best point. */
static void how_far_the_surface_is(void **state)
{
    uint64_t random = 31;
    struct rig r;

    (void) state;
    rig_start(&r);
    bumpy(&r, 10.0f, 0.6f, 20);
    rig_build(&r, true);
    for (int k = 0; k < 40; k++) {
        const struct pell_mesh *m = &r.scene->meshes[0];
        const struct pell_vec3 x = vec3_mul(in_ball(&random), 12.0f);
        const double found = pell_connector_distance(r.connector, 0, x, INFINITY);
        double best = INFINITY;
        for (uint32_t t = 0; t < m->num_triangles; t++) {
            const uint32_t *i = m->index + 3 * t;
            const struct pell_vec3 a = vec3_load(m->position + 3 * i[0]), b = vec3_load(m->position + 3 * i[1]),
                                   c = vec3_load(m->position + 3 * i[2]);
            double u = 1.0 / 3.0, v = 1.0 / 3.0, d = INFINITY;
            if (vec3_length(vec3_sub(a, x)) > 4.0f + (float) found)
                continue;
            for (double step = 0.5; step > 1e-4; step *= 0.6)
                for (int turn = 0; turn < 24; turn++) {
                    double p = fmax(u + step * (2.0 * unit(&random) - 1.0), 0.0), q = fmax(v + step * (2.0 * unit(&random) - 1.0), 0.0);
                    const double over = fmax(p + q, 1.0);
                    double e;
                    p /= over;
                    q /= over;
                    e = (double) vec3_length(
                        vec3_sub(vec3_mad(vec3_mad(vec3_mul(a, (float) (1.0 - p - q)), (float) p, b), (float) q, c), x));
                    if (e < d) {
                        d = e;
                        u = p;
                        v = q;
                    }
                }
            best = fmin(best, d);
        }
        REQUIRE(found <= best + 1e-5);
        REQUIRE_NEAR(found, best, 2e-3);
        REQUIRE_NEAR(pell_connector_distance(r.connector, 0, x, 0.5 * found), 0.5 * found, 1e-12);
        REQUIRE_NEAR(pell_connector_distance(r.connector, 0, x, 1.5 * found), found, 1e-9);
    }
    REQUIRE(pell_connector_distance(r.connector, 7, vec3(0, 0, 0), 3.0) == 3.0);
    REQUIRE(pell_connector_distance(r.connector, -1, vec3(0, 0, 0), 3.0) == 3.0);
    REQUIRE(pell_connector_distance(r.connector, 0, vec3(NAN, 0, 0), 3.0) == 3.0);
    rig_finish(&r);
}

/* Zero, NaN or random normals: any path found is valid, and the search ends soon. */
static void wild_normals(void **state)
{
    uint64_t random = 17;

    (void) state;
    for (int kind = 0; kind < 3; kind++) {
        const double start = busy_seconds();
        struct pell_mesh *m;
        struct rig r;
        rig_start(&r);
        m = shapes_ball(r.scene, 0, vec3(0, 0, 0), 10.0f, 8);
        for (uint32_t i = 0; i < m->num_vertices; i++)
            vec3_store(kind == 0   ? vec3(0, 0, 0)
                       : kind == 1 ? vec3(NAN, INFINITY, 1e30f)
                                   : vec3_normalize(in_ball(&random)),
                       m->normal + 3 * i);
        rig_build(&r, false);
        for (int k = 0; k < 50; k++) {
            const struct pell_vec3 x = vec3_mul(in_ball(&random), 9.0f), target = vec3_mul(vec3_normalize(in_ball(&random)), 30.0f);
            struct pell_connection c[8];
            const int n = pell_connect(r.connector, QUERY(0, k % 2 ? 1.4 : 1.0 + 1e-8, x, target, k % 4 < 2, INFINITY), c, 8, NULL);
            for (int i = 0; i < n; i++)
                REQUIRE(isfinite(c[i].spread) && c[i].spread > 0.0 && c[i].transmit >= 0.0 && vec3_dot(c[i].inside, c[i].normal) > 0.0f);
        }
        REQUIRE(busy_seconds() - start < 20.0);
        rig_finish(&r);
    }
}

static void survives_the_nth_allocation(void **state)
{
    (void) state;
    for (uint64_t at = 1, done = 0; !done; at++) {
        static const uint16_t index[8] = { 0, 1 };
        const struct pell_frame_material material = { .medium = { .eta = 1.3 }, .name = "test" };
        struct pell_alloc_fault fault = { 0 };
        struct rig r = { 0 };
        enum pell_result res;
        r.ctx = test_context(&fault, NULL);
        r.scene = shapes_scene(r.ctx);
        OK(pell_pool_create(r.ctx, 1, &r.pool));
        shapes_ball(r.scene, 0, vec3(0, 0, 0), 1.0f, 4);
        OK(pell_rays_create(r.ctx, r.scene, r.pool, &r.rays));
        OK(pell_solids_create(r.ctx, r.scene, index, &material, &r.solids));
        fault.fail_at = fault.calls + at;
        res = pell_connector_create(r.ctx, r.scene, r.rays, r.solids, true, &r.connector);
        done = res == PELL_OK;
        REQUIRE(done || (res == PELL_ERR_NOMEM && !r.connector));
        fault.fail_at = 0;
        rig_finish(&r);
        assert_int_equal(fault.live, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plane),
        cmocka_unit_test(ball_on_axis),
        cmocka_unit_test(spread_by_differences),
        cmocka_unit_test(how_many_in_a_ball),
        cmocka_unit_test(no_path_is_missing),
        cmocka_unit_test(light_that_enters),
        cmocka_unit_test(objects_in_the_way),
        cmocka_unit_test(hostile),
        cmocka_unit_test(how_far_the_surface_is),
        cmocka_unit_test(wild_normals),
        cmocka_unit_test(survives_the_nth_allocation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
