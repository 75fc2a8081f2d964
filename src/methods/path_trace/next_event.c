/* SPDX-License-Identifier: MIT
 * next_event.c - next-event estimation: at surfaces outside of solids, and inside media by refractive connections
 * (transport/refraction/connect.h). Paths can also hit lights with extent: the balance heuristic combines both (Veach and Guibas 1995).
 *
 * The spread of a beam is computed with ray differentials of the path's own refraction (Igehy 1999, "Tracing Ray Differentials"): with
 * normals interpolated over flat triangles the light's beam and the camera's differ, and only the latter is consistent with the path. */
#include "methods/path_trace/path.h"

#define FAR 12.0          /* in mean free paths: beyond it no lobe is built for a rough boundary */
#define LOBE_FRACTION 0.8 /* fraction of the near connections sampled by lobes; the others by the phase function */

/* --- Scatterers --------------------------------------------------------------------------------------------------------------------- */

void pt_scatter_values(const struct pt_scatterer *at, struct pell_vec3 v, float out[3])
{
    if (at->medium)
        pt_phase_values(at->medium, at->w, v, out);
    else if (at->rough)
        out[0] = out[1] = out[2] = pt_rough_density(at->rough, at->facing, v);
    else
        out[0] = out[1] = out[2] = fmaxf(vec3_dot(v, at->n), 0.0f) * (1.0f / PELL_PI_F);
}

struct pell_vec3 pt_scatter_sample(const struct pt_scatterer *at, struct pt_sampler *s, float beta[3])
{
    struct pell_vec3 t, b, v;
    float u, phi, r;

    if (at->medium) {
        pt_phase_sample(at->medium, at->w, s, beta, &v);
        return v;
    }
    u = pt_random(s);
    phi = 2.0f * PELL_PI_F * pt_random(s);
    r = sqrtf(u);
    vec3_basis(at->n, &t, &b);
    return vec3_normalize(vec3_add(vec3_add(vec3_mul(t, r * cosf(phi)), vec3_mul(b, r * sinf(phi))), vec3_mul(at->n, sqrtf(1.0f - u))));
}

/* Density of v, per sr, with the channel weights of the path. */
static double scatter_density(const struct pt_scatterer *at, struct pell_vec3 v)
{
    const float *beta = at->beta;
    float values[3];

    pt_scatter_values(at, v, values);
    return (double) ((beta[0] * values[0] + beta[1] * values[1] + beta[2] * values[2]) / (beta[0] + beta[1] + beta[2]));
}

/* --- Beams -------------------------------------------------------------------------------------------------------------------------- */

double pt_beam(const struct pt_scene *s, const struct pt_exit *e, double distance)
{
    const struct pell_dvec3 w = dvec3_widen(e->w), n = dvec3_widen(e->hit.ns), ng = dvec3_widen(e->hit.ng);
    const double r = (double) s->solid[e->solid].medium.eta, c = dvec3_dot(w, n), square = 1.0 - r * r * (1.0 - c * c),
                 cg = dvec3_dot(w, ng);
    struct pell_vec3 t[2];
    struct pell_dvec3 out, moved[2], dw[2], dp[2], dn[2];
    double ct, across;

    if (!(c > 0.0 && square > 0.0 && cg > 0.0))
        return 0.0;
    ct = sqrt(square);
    out = dvec3_mad(dvec3_mul(w, r), ct - r * c, n);
    if (!(dvec3_dot(out, ng) > 0.0))
        return 0.0;
    vec3_basis(e->w, &t[0], &t[1]);
    for (int k = 0; k < 2; k++) {
        dw[k] = dvec3_widen(t[k]);
        dp[k] = dvec3_mad(dvec3_mul(dw[k], (double) e->length), -(double) e->length * dvec3_dot(dw[k], ng) / cg, w);
    }
    pt_normal_at(s, &e->hit, dvec3_widen(e->hit.p), dp, dn);
    for (int k = 0; k < 2; k++) {
        const double dc = dvec3_dot(dw[k], n) + dvec3_dot(w, dn[k]), dct = r * r * c * dc / ct;
        const struct pell_dvec3 dout = dvec3_mad(dvec3_mad(dvec3_mul(dw[k], r), dct - r * dc, n), ct - r * c, dn[k]);
        moved[k] = distance < INFINITY ? dvec3_mad(dp[k], distance, dout) : dout;
    }
    across = fabs(dvec3_dot(dvec3_cross(moved[0], moved[1]), out));
    return across > 1e-30 ? 1.0 / across : 0.0;
}

/* --- Lights -------------------------------------------------------------------------------------------------------------------------- */

bool pt_sample_light(const struct pt_scene *s, struct pell_vec3 x, struct pt_sampler *sampler, struct pell_light_sample *source)
{
    double u[3];

    for (int k = 0; k < 3; k++)
        u[k] = pt_fine(sampler);
    return pell_light_sampler_sample(s->light_sampler, x, u, source);
}

/* The unit direction from x to a light sample, and its distance in mm (INFINITY: distant). False: x is the position itself. */
static bool toward(const struct pell_light_sample *source, struct pell_vec3 x, struct pell_vec3 *v, double *distance)
{
    *v = source->distant ? source->toward : vec3_sub(source->at, x);
    *distance = source->distant ? INFINITY : (double) vec3_length(*v);
    if (!source->distant)
        *v = vec3_mul(*v, (float) (1.0 / *distance));
    return *distance > 0.0;
}

/* --- Refractive connections --------------------------------------------------------------------------------------------------------- */

static double source_fraction(const struct pt_scene *s, const struct pell_light_sample *source)
{
    return source->distant && !source->delta ? s->environment_fraction : 1.0;
}

double pt_exit_nee_probability(const struct pt_scene *s, const struct pt_exit *e, const struct pell_light_sample *source)
{
    return exp(-PT_RANGE_RATE * (double) (s->solid[e->solid].medium.min_sigma_t * e->length)) * (double) e->fraction *
           source_fraction(s, source);
}

double pt_exit_density(const struct pt_scene *s, const struct pt_exit *e)
{
    const struct pt_medium *m = &s->solid[e->solid].medium;
    double sum = 0.0, scattered = 0.0, passed = 0.0;
    float values[3];

    pt_scatter_values(&e->from, e->w, values);
    for (int c = 0; c < 3; c++) {
        const double weight = (double) e->from.beta[c] * (double) values[c];
        const double sigma = (double) (m->homogeneous ? m->layer[0].sigma_t[c] : m->min_sigma_t);
        sum += (double) e->from.beta[c];
        scattered += weight;
        passed += weight * exp(-sigma * (double) e->length);
    }
    return sum > 0.0 && scattered > 0.0 ? scattered / sum * (passed / scattered) * (double) e->transmit : 0.0;
}

/* Adds the light of one connection. */
static void add_connection(const struct pt_scene *s, const struct pt_scatterer *at, int solid, float fraction,
                           const struct pell_connection *c, const struct pell_light_sample *source, struct pt_sampler *sampler,
                           double sum[3])
{
    struct pt_exit e = { .from = *at, .solid = solid, .w = c->inside, .fraction = fraction };
    float power[3], values[3], passed[3];
    double scale, beam, nee_probability;

    e.length = (float) c->inside_mm;
    e.transmit = (float) c->transmit;
    pt_hit_at(s, c->mesh, c->triangle, c->u, c->v, c->inside, &e.hit);
    beam = pt_beam(s, &e, c->outside_mm);
    nee_probability = pt_exit_nee_probability(s, &e, source);
    if (!(beam > 0.0))
        return;
    scale = beam * c->transmit / (nee_probability * source->pdf);
    if (!source->delta) {
        const double facing = source->distant ? 1.0 : -(double) vec3_dot(source->normal, c->outside);
        if (!(facing > 0.0))
            return;
        scale *= facing;
        if (s->knobs.techniques & PT_HIT_LIGHTS) {
            const double light_pdf = source->pdf * nee_probability, path_pdf = pt_exit_density(s, &e) * beam * facing;
            scale *= light_pdf / (light_pdf + path_pdf);
        }
    }
    pell_light_sampler_power_at(s->light_sampler, source, c->at, power);
    pt_scatter_values(at, c->inside, values);
    pt_transmittance(s, solid, at->x, c->inside, e.length, sampler, passed);
    pt_tint(s, &e.hit, true, passed);
    for (int k = 0; k < 3; k++)
        sum[k] += (double) (at->beta[k] * values[k] * passed[k] * power[k]) * scale;
}

/* Selects the given fraction of the scatterers, evenly along the path. */
static bool select_scatterer(float fraction, float *selection)
{
    *selection += fraction;
    if (*selection < 1.0f)
        return false;
    *selection -= 1.0f;
    return true;
}

/* Maximum distance of connections from here; returns the sampler for the numbers that follow. */
static float draw_reach(const struct pt_scene *s, int solid, const struct pt_sampler *walk, struct pt_sampler *independent)
{
    *independent = pt_independent_sampler(walk, PT_NEE_SALT);
    return -pt_log(pt_chance(independent)) * s->solid[solid].connect_mm;
}

bool pt_should_connect(const struct pt_scene *s, int solid, struct pell_vec3 x, float *safe, float fraction, float *selection,
                       const struct pt_sampler *sampler)
{
    struct pt_sampler independent;
    const float reach = draw_reach(s, solid, sampler, &independent);

    if (!(reach > *safe))
        return false;
    if (s->solid[solid].grid) {
        const float bound = pell_distance_bound(s->distance, solid, x);
        *safe = fmaxf(*safe, bound);
        if (!(reach > bound))
            return false;
    }
    return select_scatterer(fraction, selection);
}

void pt_connect_lights(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_scatterer *at, float fraction,
                       const struct pt_sampler *sampler, double sum[3])
{
    const struct pt_medium *m = &s->solid[solid].medium;
    struct pell_connection found[PELL_CONNECTIONS];
    struct pell_light_sample source;
    struct pt_sampler independent;
    const float reach = draw_reach(s, solid, sampler, &independent);
    int count;

    if (!pt_sample_light(s, at->x, &independent, &source) || pt_fine(&independent) >= source_fraction(s, &source))
        return;
    counts->connections++;
    count = pell_connect(s->connector,
                         &(struct pell_connection_query) { solid, (double) m->eta, at->x, source.distant ? source.toward : source.at,
                                                           source.distant, (double) reach },
                         found, PELL_CONNECTIONS, &counts->rays);
    for (int i = 0; i < count; i++)
        add_connection(s, at, solid, fraction, &found[i], &source, &independent, sum);
}

/* --- Near connections through rough boundaries --------------------------------------------------------------------------------------- */

/* A scatterer receives light through a rough boundary in a lobe around the refracted direction of a smooth one. The lobe's width follows
 * from the tilt of facets: a tilt t rotates the inner direction by t |eta cos_i - cos_o| / eta. */
struct lobes {
    int count;
    struct pell_vec3 w[PT_LOBES];
    double width[PT_LOBES], fraction[PT_LOBES];
};

static void make_lobes(const struct pt_scene *s, struct pt_counts *counts, int solid, struct pell_vec3 x,
                       const struct pell_light_sample *source, struct lobes *out)
{
    const struct pt_medium *m = &s->solid[solid].medium;
    const double reach = m->min_sigma_t > 0.0f ? FAR / (double) m->min_sigma_t : INFINITY, eta = (double) m->eta;
    struct pell_connection found[PT_LOBES];
    double sum = 0.0;

    counts->connections++;
    out->count = pell_connect(
        s->connector,
        &(struct pell_connection_query) { solid, eta, x, source->distant ? source->toward : source->at, source->distant, reach }, found,
        PT_LOBES, &counts->rays);
    for (int i = 0; i < out->count; i++) {
        const double in = fmax((double) vec3_dot(found[i].inside, found[i].normal), 0.05),
                     to = (double) vec3_dot(found[i].outside, found[i].normal);
        struct pt_hit hit;
        double alpha;
        pt_hit_at(s, found[i].mesh, found[i].triangle, found[i].u, found[i].v, found[i].inside, &hit);
        alpha = (double) pt_alpha(s, &hit);
        out->w[i] = found[i].inside;
        out->width[i] = fmax(alpha * fabs(eta * in - to) / (eta * sqrt(in)), 1e-4);
        out->fraction[i] = (found[i].transmit + 0.01) * exp(-(double) m->min_sigma_t * found[i].inside_mm);
        sum += out->fraction[i];
    }
    for (int i = 0; i < out->count; i++)
        out->fraction[i] /= sum;
}

static double lobes_density(const struct lobes *l, struct pell_vec3 w)
{
    double sum = 0.0;

    for (int i = 0; i < l->count; i++) {
        const double c = (double) vec3_dot(w, l->w[i]), a2 = l->width[i] * l->width[i];
        const double t2 = c > 0.0 ? 1.0 / (c * c) - 1.0 : 0.0, d = a2 + fmax(t2, 0.0);
        sum += c > 1e-3 ? l->fraction[i] * a2 / (PELL_PI * d * d * c * c * c) : 0.0;
    }
    return sum;
}

static struct pell_vec3 lobes_sample(const struct lobes *l, struct pt_sampler *s)
{
    const double u = pt_fine(s), phi = 2.0 * PELL_PI * pt_fine(s);
    struct pell_vec3 t, b;
    double pick = pt_fine(s), r;
    int i = 0;

    while (i < l->count - 1 && pick >= l->fraction[i])
        pick -= l->fraction[i++];
    r = l->width[i] * sqrt(u / (1.0 - u));
    vec3_basis(l->w[i], &t, &b);
    return vec3_normalize(vec3_add(vec3_add(vec3_mul(t, (float) (r * cos(phi))), vec3_mul(b, (float) (r * sin(phi)))), l->w[i]));
}

static double near_density(const struct lobes *l, const struct pt_scatterer *at, struct pell_vec3 w)
{
    const double direct = scatter_density(at, w);

    return l->count > 0 ? LOBE_FRACTION * lobes_density(l, w) + (1.0 - LOBE_FRACTION) * direct : direct;
}

/* Probability that a scatterer connects; depends on its position only. */
static double connect_probability(const struct pt_scene *s, int solid, struct pell_vec3 x, float fraction)
{
    const struct pt_solid *b = &s->solid[solid];
    const double bound = b->grid ? (double) pell_distance_bound(s->distance, solid, x) : 0.0;

    return (double) fraction * exp(-PT_RANGE_RATE * (double) b->medium.min_sigma_t * bound);
}

double pt_rough_nee_density(const struct pt_scene *s, struct pt_counts *counts, const struct pt_exit *e,
                            const struct pell_light_sample *source)
{
    struct lobes lobes;

    make_lobes(s, counts, e->solid, e->from.x, source, &lobes);
    return connect_probability(s, e->solid, e->from.x, e->fraction) * near_density(&lobes, &e->from, e->w);
}

void pt_connect_rough(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_scatterer *at, float fraction,
                      float *selection, const struct pt_sampler *sampler, double sum[3])
{
    struct pt_sampler independent = pt_independent_sampler(sampler, 0x2545f4914f6cdd1du);
    const double probability = connect_probability(s, solid, at->x, fraction);
    struct pell_light_sample source;
    const struct pt_rough *rough;
    struct pt_shading_frame facing;
    struct lobes lobes;
    struct pt_exit e = { .from = *at, .solid = solid, .fraction = fraction, .transmit = 1.0f };
    struct pell_vec3 v;
    double distance, bsdf, mis_weight = 1.0, density, scale = 1.0;
    float power[3], values[3], passed[3];

    if (!select_scatterer((float) probability, selection))
        return;
    if (!pt_sample_light(s, at->x, &independent, &source) || (source.distant && !source.delta))
        return;
    make_lobes(s, counts, solid, at->x, &source, &lobes);
    if (lobes.count > 0 && pt_fine(&independent) < LOBE_FRACTION) {
        e.w = lobes_sample(&lobes, &independent);
    } else {
        float ignored[3] = { at->beta[0], at->beta[1], at->beta[2] };
        e.w = pt_scatter_sample(at, &independent, ignored);
    }
    density = near_density(&lobes, at, e.w);
    if (!(density > 0.0) || !pt_intersect(s, counts, at->x, e.w, INFINITY, PELL_RAY_ALL, &e.hit) || e.hit.solid != solid ||
        !(vec3_dot(e.w, e.hit.ng) > 0.0f))
        return;
    rough = pt_rough_find(s, &e.hit, s->solid[solid].medium.eta);
    if (!rough)
        return;
    e.length = e.hit.t;
    if (!toward(&source, e.hit.p, &v, &distance) || !(vec3_dot(v, e.hit.ng) > 0.0f))
        return;
    if (!source.distant)
        scale = 1.0 / (distance * distance);
    facing = (struct pt_shading_frame) { vec3_mul(e.w, -1.0f), vec3_mul(e.hit.ns, -1.0f), vec3_mul(e.hit.ng, -1.0f), 1 };
    if (!(vec3_dot(facing.o, facing.ns) > 1e-4f))
        facing.ns = facing.ng;
    bsdf = (double) pt_rough_density(rough, &facing, v);
    if (!source.delta) {
        scale *= -(double) vec3_dot(source.normal, v);
        if (!(scale > 0.0))
            return;
        if (s->knobs.techniques & PT_HIT_LIGHTS) {
            const double light_pdf = probability * density * source.pdf, path_pdf = pt_exit_density(s, &e) * bsdf * scale;
            mis_weight = light_pdf / (light_pdf + path_pdf);
        }
    }
    pell_light_sampler_power_at(s->light_sampler, &source, e.hit.p, power);
    if (!(bsdf > 0.0) || !(power[0] + power[1] + power[2] > 0.0f) ||
        !pt_unoccluded(s, counts, pt_offset_origin(&e.hit, v), v, source.distant ? INFINITY : (float) (distance * (1.0 - 1e-5)),
                       PELL_RAY_ALL))
        return;
    pt_scatter_values(at, e.w, values);
    pt_transmittance(s, solid, at->x, e.w, e.length, &independent, passed);
    pt_tint(s, &e.hit, true, passed);
    for (int k = 0; k < 3; k++)
        sum[k] +=
            (double) (at->beta[k] * values[k] * passed[k] * power[k]) * bsdf * scale * mis_weight / (probability * density * source.pdf);
}

/* --- Surfaces ------------------------------------------------------------------------------------------------------------------------ */

void pt_next_event(const struct pt_scene *s, struct pt_counts *counts, const struct pt_hit *hit, const struct pt_scatterer *at,
                   int outer_side, bool environments, struct pt_sampler *sampler, double sum[3])
{
    struct pell_light_sample source;
    struct pell_vec3 v;
    double distance, scale, bsdf, light_pdf;
    float power[3], facing;

    if (!pt_sample_light(s, hit->p, sampler, &source) || (environments && (!source.distant || source.delta)) ||
        !toward(&source, hit->p, &v, &distance))
        return;
    facing = vec3_dot(v, at->n);
    if (!(facing * (float) outer_side > 0.0f))
        return;
    bsdf = at->rough ? (double) pt_rough_density(at->rough, at->facing, v) : (double) (facing / PELL_PI_F);
    if (!(bsdf > 0.0))
        return;
    scale = source.distant ? 1.0 : 1.0 / (distance * distance);
    if (!source.delta) {
        const double cos_light = source.distant ? 1.0 : -(double) vec3_dot(source.normal, v);
        if (!(cos_light > 0.0))
            return;
        scale *= cos_light;
        light_pdf = source.pdf / scale;
        if (s->knobs.techniques & PT_HIT_LIGHTS)
            scale *= light_pdf / (light_pdf + bsdf);
    }
    pell_light_sampler_power_at(s->light_sampler, &source, hit->p, power);
    if (!(power[0] + power[1] + power[2] > 0.0f) ||
        !pt_unoccluded(s, counts, pt_offset_origin(hit, v), v, source.distant ? INFINITY : (float) (distance * (1.0 - 1e-5)), PELL_RAY_ALL))
        return;
    for (int k = 0; k < 3; k++)
        sum[k] += (double) (at->beta[k] * power[k] * (at->rough && outer_side < 0 ? at->tint[k] : 1.0f)) * bsdf * scale / source.pdf;
}
