/* SPDX-License-Identifier: MIT
 *
 * samples.c - the sample set of a material: radii by inverting the mean of its channels' distributions and a broad distribution, angles by
 * the golden ratio, interleaved over a tile of pixels; and the radial tables for their weights.
 *
 * With `combined` the samples of both kinds are drawn from their common distribution, (N_r p_r + N_u p_u)/N, by which the balance heuristic
 * divides either kind anyway: weights then vary smoothly from sample to sample, and one well distributed set replaces two.
 */
#include "methods/image_space/image_space.h"

#include "base/base.h"
#include "math/sampling.h"

#include <pellucid/inversion.h>
#include <pellucid/sampling.h>

#include <string.h>

#define SILVER 0.4142135623730950

int is_importance_samples(const struct is_knobs *k)
{
    return k->sampling == IS_IMPORTANCE ? k->samples : k->sampling == IS_UNIFORM ? 0 : (k->samples + 1) / 2;
}

int is_uniform_samples(const struct is_knobs *k)
{
    return k->samples - is_importance_samples(k);
}

/* Sample counts do not adapt if there are two kinds that are normalised separately, or the paper's kinds, or many samples. */
bool is_adapts(const struct is_knobs *k)
{
    return k->adaptive && k->samples <= IS_MAX_ADAPTED && k->sampling != IS_SEPARATE && k->renormalise != IS_BY_COUNT;
}

int is_class_samples(const struct is_knobs *k, int class)
{
    const int shift = class - IS_CLASS_OF_ALL, samples = shift < 0 ? k->samples >> -shift : k->samples << (shift > 0 ? shift : 0);

    return shift == 0 ? k->samples : !is_adapts(k) ? 0 : samples > 1 ? samples : 1;
}

int is_row_samples(const struct is_knobs *k)
{
    int sum = 0;

    for (int class = 0; class < IS_CLASSES; class ++)
        sum += is_class_samples(k, class);
    return sum;
}

int is_tile_side(const struct is_knobs *k)
{
    return 1 << k->tile;
}

/* Identical to the last bit for any order of the channels. */
static double sum3(const double v[3])
{
    double a = v[0], b = v[1], c = v[2], t;

    if (a > b)
        t = a, a = b, b = t;
    if (b > c)
        t = b, b = c, c = t;
    if (a > b)
        t = a, a = b, b = t;
    return a + b + c;
}

static int lit_channels(const struct pell_frame_material *m, bool lit[3])
{
    int count = 0;

    for (int c = 0; c < 3; c++) {
        lit[c] = pell_profile_total(&m->profile[c]) > 0.0;
        count += lit[c];
    }
    return count;
}

double is_reach(const struct pell_frame_material *m)
{
    double reach = 0.0;
    bool lit[3];

    lit_channels(m, lit);
    for (int c = 0; c < 3; c++)
        if (lit[c])
            reach = fmax(reach, pell_profile_sample(&m->profile[c], IS_ENERGY));
    return reach;
}

/* The broad part of `combined`: density 1/(1 + r^2/R0^2)^2 over pi R0^2. It is nearly uniform well inside R' and extends beyond it, where a
 * uniform disc would leave the few samples of the profile's own tail with weights of 3/N_r. */
#define BROAD_RATIO (1.0 / 3.0) /* R0/R' */

/* The radius that contains the fraction xi of a mixture: the mean of the channels' distributions (`profiles` parts) and the broad density
 * (the other parts), if there is one: reach > 0. */
static double mixture_radius(const struct pell_frame_material *m, double profiles, double reach, double xi)
{
    const bool two = profiles < 1.0 && reach > 0.0;
    const double broad2 = reach * reach * BROAD_RATIO * BROAD_RATIO, broad = two ? sqrt(broad2 * xi / (1.0 - xi)) : 0.0;
    double low = INFINITY, high = 0.0;
    bool lit[3];
    const int count = lit_channels(m, lit);

    for (int c = 0; c < 3 && profiles > 0.0; c++) {
        if (!lit[c])
            continue;
        const double r = pell_profile_sample(&m->profile[c], xi);
        low = fmin(low, r);
        high = fmax(high, r);
    }
    if (count == 0)
        return 0.0;
    if (two) {
        low = fmin(low, broad);
        high = fmax(high, broad);
    }
    for (int i = 0; i < 40 && high - low > 1e-7 * high; i++) {
        const double mid = 0.5 * (low + high), of_broad = two ? mid * mid / (mid * mid + broad2) : 0.0;
        double inside[3] = { 0 };
        for (int c = 0; c < 3; c++)
            inside[c] = lit[c] ? pell_profile_cdf(&m->profile[c], mid) : 0.0;
        if (profiles * sum3(inside) / count + (1.0 - profiles) * of_broad < xi)
            low = mid;
        else
            high = mid;
    }
    return 0.5 * (low + high);
}

/* The paper's procedure as printed: the random number that chose the pole is not rescaled for reuse. */
static double misprinted_radius(const struct pell_frame_material *m, int k, double xi)
{
    bool lit[3];
    const int count = lit_channels(m, lit);
    int pick = count > 0 ? k % count : 0;

    for (int c = 0; c < 3; c++) {
        if (!lit[c] || pick-- > 0)
            continue;
        const struct pell_dipole d =
            pell_dipole_make(m->medium.sigma_a[c], m->medium.sigma_s_reduced[c], m->medium.eta, PELL_FRESNEL_EXACT);
        return pell_pole_sample(xi < pell_dipole_real_share(&d) ? d.zr : d.zv, d.sigma_tr, xi);
    }
    return 0.0;
}

/* --- Order of samples ----------------------------------------------------------------------------------------------------------- */

/* Ranks of a Bayer matrix of size n, a power of two: neighbouring entries differ widely. */
static int bayer(int x, int y, int n)
{
    int rank = 0;

    for (int bit = 1, weight = n * n / 4; bit < n; bit *= 2, weight /= 4)
        rank += weight * ((((x ^ y) & bit) ? 2 : 0) + ((y & bit) ? 1 : 0));
    return rank;
}

/* Stratified samples: sample i of a pixel is in the i-th of equal intervals of the light, and within it in the subinterval of the pixel's
 * rank in the tile, so all samples of a tile are in different subintervals. Angles advance by the golden ratio from sample to sample and by
 * sqrt(2) - 1 from rank to rank, both badly approximable by fractions, so the angles of each pixel's samples, and those of a tile in each
 * interval, are well distributed. */
void is_set_sample(const struct pell_frame_material *m, const struct is_knobs *knobs, double reach, int x, int y, int k, double *r_mm,
                   double *turns)
{
    const int n = is_tile_side(knobs), patterns = n * n, importance = is_importance_samples(knobs);
    const bool both = knobs->sampling == IS_COMBINED, uniform = !both && k >= importance;
    const int count = both ? knobs->samples : uniform ? is_uniform_samples(knobs) : importance, i = uniform ? k - importance : k;
    const int rank = bayer(x % n, y % n, n);
    const double xi = ((double) i + ((double) rank + 0.5) / patterns) / (double) count;
    const double turn = (double) i * PELL_GOLDEN_TURN + (double) rank * SILVER + (uniform ? 0.5 * PELL_GOLDEN_TURN : 0.0);

    if (both)
        *r_mm = mixture_radius(m, (double) importance / knobs->samples, reach, xi);
    else if (uniform)
        *r_mm = reach * sqrt(xi);
    else if (knobs->misprint == IS_MISPRINT_ONE_NUMBER && m->gaussians.count == 0 && pell_medium_valid(&m->medium, NULL))
        *r_mm = misprinted_radius(m, i, xi);
    else
        *r_mm = mixture_radius(m, 1.0, 0.0, xi);
    *turns = turn - floor(turn);
}

/* Position in a tile of a rank. */
static void pattern_offset(int rank, int n, int *x, int *y)
{
    for (*y = 0; *y < n; ++*y)
        for (*x = 0; *x < n; ++*x)
            if (bayer(*x, *y, n) == rank)
                return;
}

/* Images are numbered by seed and multisample. From one to the next the tile shifts, so that after n^2 of them each pixel has had every
 * pattern: the mean equals that of n^2 times as many stratified samples. After that all patterns are rotated by an angle that is badly
 * approximable by fractions. */
void is_set_turn(const struct is_knobs *knobs, uint64_t image_index, const struct is_set *set)
{
    const int n = is_tile_side(knobs);
    const uint64_t patterns = (uint64_t) (n * n), round = image_index / patterns % (1 << 24);
    const double turn = 2.0 * PELL_PI * fmod((double) round * PELL_GOLDEN_TURN, 1.0);
    const float c = (float) cos(turn), s = (float) sin(turn);
    const float *from = set->original;
    float *to = set->offset;
    int dx = 0, dy = 0;

    pattern_offset((int) (image_index % patterns), n, &dx, &dy);
    for (int profile = 0; profile < (set->level ? 1 + IS_LEVELS : 1); profile++)
        for (int class = 0; class < IS_CLASSES; class ++) {
            const int samples = is_class_samples(knobs, class);
            const size_t row = (size_t) samples * 3 * IS_BLOCK;
            for (int y = 0; y < n; y++)
                for (int k = 0; k < samples; k++)
                    for (int l = 0; l < IS_BLOCK; l++) {
                        const float *p = from + (size_t) ((y + dy) % n) * row + (size_t) k * 3 * IS_BLOCK + (l + dx) % IS_BLOCK;
                        float *q = to + (size_t) y * row + (size_t) k * 3 * IS_BLOCK + l;
                        q[0] = c * p[0] - s * p[IS_BLOCK];
                        q[IS_BLOCK] = s * p[0] + c * p[IS_BLOCK];
                        q[2 * IS_BLOCK] = p[2 * IS_BLOCK];
                    }
            from += (size_t) n * row;
            to += (size_t) n * row;
        }
}

/* --- Tables ----------------------------------------------------------------------------------------------------------------------- */

/* The four values of a row at a squared radius, in units of length^2. */
static void row_at(const struct pell_frame_material *m, double length, double square, double out[4])
{
    const double r = length * sqrt(square);
    bool lit[3];
    const int count = lit_channels(m, lit);

    for (int c = 0; c < 3; c++)
        out[c] = lit[c] ? fmin(pell_profile_pdf(&m->profile[c], r) * length * length, 1e12) : 0.0;
    out[3] = count > 0 ? sum3(out) / count : 0.0;
}

static double square_of(int row)
{
    const uint32_t bits = ((uint32_t) (127 - IS_OCTAVES) << 23) + ((uint32_t) row << IS_SHIFT);

    return (double) pell_bits_float((int32_t) bits);
}

static void make_rows(const struct pell_frame_material *m, double length, float (*rows)[8])
{
    double now[4], next[4];

    row_at(m, length, square_of(0), next);
    for (int i = 0; i < IS_ROWS; i++) {
        memcpy(now, next, sizeof(now));
        row_at(m, length, square_of(i + 1), next);
        for (int c = 0; c < 4; c++) {
            rows[i][c] = (float) now[c];
            rows[i][4 + c] = (float) (next[c] - now[c]);
        }
    }
}

/* The density as the kernels evaluate it. */
static double density_at(const float (*rows)[8], double square)
{
    const double at = fmax(square, square_of(0));
    const int octave = (int) floor(log2(at));
    const double coord = (at / exp2(octave) - 1.0) * IS_ROWS_OCTAVE + (double) (octave + IS_OCTAVES) * IS_ROWS_OCTAVE;
    const int row = (int) coord;

    if (row >= IS_ROWS)
        return 0.0;
    return (double) rows[row][3] + (coord - row) * (double) rows[row][7];
}

/* p_u: uniform, or broad. */
static double uniform_density(const struct is_set *set, double square)
{
    const double fall = 1.0 + (set->broad2 > 0.0f ? square / (double) set->broad2 : 0.0);

    return set->broad2 > 0.0f || square <= (double) set->reach2 ? (double) set->uniform / (fall * fall) : 0.0;
}

/* --- Sets ------------------------------------------------------------------------------------------------------------------------- */

/* Parameters of the samples of a profile. */
static void set_reach(const struct pell_frame_material *m, const struct is_knobs *knobs, double length, double reach, struct is_set *set)
{
    bool lit[3];

    lit_channels(m, lit);
    set->per_length2 = (float) (1.0 / (length * length));
    set->reach2 = (float) (reach * reach / (length * length));
    set->broad2 = knobs->sampling == IS_COMBINED ? (float) (BROAD_RATIO * BROAD_RATIO) * set->reach2 : 0.0f;
    set->uniform = 0.0f;
    if (reach > 0.0)
        set->uniform = 1.0f / (PELL_PI_F * (set->broad2 > 0.0f ? set->broad2 : set->reach2));
    for (int c = 0; c < 3; c++)
        set->quarter[c] = lit[c] ? (float) pell_profile_sample(&m->profile[c], 0.25) : 0.0f;
}

/* The offsets of a profile and a class, whose sample count is in `knobs`. */
static void fill_class(const struct pell_frame_material *m, const struct is_knobs *knobs, const struct is_set *set, double length,
                       double reach, float *offset, float (*rows)[8])
{
    const int n = is_tile_side(knobs), importance = is_importance_samples(knobs), uniform = is_uniform_samples(knobs);

    for (int y = 0; y < n; y++)
        for (int x = 0; x < n; x++)
            for (int k = 0; k < knobs->samples; k++) {
                float *to = offset + ((size_t) y * (size_t) knobs->samples + (size_t) k) * 3 * IS_BLOCK + x;
                double r, turns, square, density;
                is_set_sample(m, knobs, reach, x, y, k, &r, &turns);
                r = fmin(r, 1e15);
                square = r * r / (length * length);
                density = importance * density_at((const float(*)[8]) rows, square);
                density += uniform * uniform_density(set, square);
                for (int l = 0; l < IS_BLOCK; l += n) {
                    to[l] = (float) (r * cos(2.0 * PELL_PI * turns));
                    to[l + IS_BLOCK] = (float) (r * sin(2.0 * PELL_PI * turns));
                    to[l + 2 * IS_BLOCK] = density > 1e-20 ? (float) (1.0 / density) : 0.0f;
                }
            }
}

/* The rows and offsets of a profile. */
static void fill(const struct pell_frame_material *m, const struct is_knobs *knobs, const struct is_set *set, double length, double reach,
                 float *offset, float (*rows)[8])
{
    make_rows(m, length, rows);
    for (int class = 0; class < IS_CLASSES; class ++) {
        struct is_knobs class_knobs = *knobs;
        class_knobs.samples = is_class_samples(knobs, class);
        if (class_knobs.samples > 0)
            fill_class(m, &class_knobs, set, length, reach, offset, rows);
        offset += (size_t) is_tile_side(knobs) * (size_t) class_knobs.samples * 3 * IS_BLOCK;
    }
}

double is_level_albedo(int level)
{
    const double first = 1.0 - sqrt(1.0 - (double) IS_ALBEDO_MIN), last = 1.0 - sqrt(1.0 - (double) IS_ALBEDO_MAX);
    const double t = first + (last - first) * level / (IS_LEVELS - 1);

    return 1.0 - (1.0 - t) * (1.0 - t);
}

static bool same_profile(const struct pell_profile *a, const struct pell_profile *b)
{
    return a->kind == b->kind && a->count == b->count && memcmp(a->parameter, b->parameter, sizeof(a->parameter)) == 0 &&
           memcmp(a->r, b->r, sizeof(a->r)) == 0 && memcmp(a->value, b->value, sizeof(a->value)) == 0;
}

/* The model that computes this material's profile from its coefficients; false: none that is fast enough. */
static bool model_of(const struct pell_frame_material *m, struct pell_profile *scratch, enum pell_profile_model *model)
{
    static const enum pell_profile_model quick[] = { PELL_PROFILE_DIPOLE, PELL_PROFILE_BETTER_DIPOLE, PELL_PROFILE_NORMALIZED_DIFFUSION,
                                                     PELL_PROFILE_MONTE_CARLO };

    if (m->gaussians.count > 0 || !pell_medium_valid(&m->medium, NULL))
        return false;
    for (size_t i = 0; i < PELL_COUNT(quick); i++) {
        bool same = true;
        for (int c = 0; c < 3 && same; c++)
            same = pell_profile_make(quick[i], &m->medium, c, NULL, scratch) == PELL_OK && same_profile(scratch, &m->profile[c]);
        *model = quick[i];
        if (same)
            return true;
    }
    return false;
}

/* The material with the same albedo in all channels and unchanged mean free paths. */
static enum pell_result level_profile(struct pell_context *ctx, enum pell_profile_model model, double albedo, struct pell_frame_material *m,
                                      struct pell_profile *out)
{
    for (int c = 0; c < 3; c++) {
        const double sigma_t = m->medium.sigma_a[c] + m->medium.sigma_s_reduced[c];
        double reduced;
        enum pell_result res = pell_albedo_of_color(model, NULL, albedo, m->medium.g[c], m->medium.eta, &reduced, NULL);
        m->medium.sigma_s_reduced[c] = reduced * sigma_t;
        m->medium.sigma_a[c] = (1.0 - reduced) * sigma_t;
        if (res == PELL_OK)
            res = pell_profile_make(model, &m->medium, c, NULL, &out[c]);
        if (res != PELL_OK)
            return pell_error(ctx, res, m->name, "set spread=material", "has no profile of albedo %g", albedo);
    }
    m->profile = out;
    return PELL_OK;
}

/* Data shared by the levels of a set. */
struct levels {
    enum pell_profile_model model; /* of their profiles */
    double most, length;           /* mm: the largest R', and the unit of the tables */
    size_t offsets;                /* floats per level */
};

static enum pell_result make_levels(struct pell_context *ctx, const struct pell_frame_material *m, const struct is_knobs *knobs,
                                    const struct levels *levels, struct pell_profile *scratch, struct is_set *set)
{
    for (int i = 0; i < IS_LEVELS; i++) {
        struct pell_frame_material material = *m;
        struct is_set level_set = *set;
        float *row = set->level[i];
        double reach;
        const enum pell_result res = level_profile(ctx, levels->model, is_level_albedo(i), &material, scratch);
        if (res != PELL_OK)
            return res;
        reach = fmin(is_reach(&material), levels->most);
        set_reach(&material, knobs, levels->length, reach, &level_set);
        row[IS_UNIFORM_AT] = level_set.uniform;
        row[IS_BROAD2_AT] = level_set.broad2;
        row[IS_REACH2_AT] = level_set.reach2;
        memcpy(row + IS_QUARTER_AT, level_set.quarter, sizeof(level_set.quarter));
        fill(&material, knobs, &level_set, levels->length, reach, set->offset + (size_t) (i + 1) * levels->offsets,
             set->rows + (size_t) (i + 1) * IS_ROWS);
    }
    return PELL_OK;
}

enum pell_result is_set_make(struct pell_context *ctx, const struct pell_frame_material *m, const struct is_knobs *knobs, double most,
                             struct is_set *set)
{
    const size_t offsets = (size_t) is_tile_side(knobs) * (size_t) is_row_samples(knobs) * 3 * IS_BLOCK;
    const double median = mixture_radius(m, 1.0, 0.0, 0.5), length = median > 1e-15 ? fmin(median, 1e15) : 1e-15;
    const double reach = fmin(is_reach(m), most);
    struct pell_profile *scratch = NULL;
    enum pell_profile_model model = PELL_PROFILE_DIPOLE;
    enum pell_result res = PELL_ERR_NOMEM;
    size_t profiles = 1;
    bool lit[3];

    memset(set, 0, sizeof(*set));
    lit_channels(m, lit);
    set->owned = true;
    if (knobs->spread == IS_SPREAD_ALBEDO && m->white) {
        scratch = pell_calloc(ctx, 3, sizeof(*scratch));
        if (!scratch)
            goto fail;
        if (model_of(m, scratch, &model))
            profiles += IS_LEVELS;
        else
            pell_warn(ctx, m->name, "give it coefficients, and a profile other than photon-beam or a table",
                      "has no profiles that depend on the albedo: the scattering distance is the same for all colours");
    }
    set_reach(m, knobs, length, reach, set);
    set->median = (float) fmin(median, 1e15);
    for (int c = 0; c < 3; c++)
        set->scale[c] = lit[c] ? (m->white ? 1.0f : (float) pell_profile_total(&m->profile[c])) : 0.0f;
    set->offset = pell_calloc(ctx, profiles * offsets, sizeof(float));
    set->rows = pell_calloc(ctx, profiles * IS_ROWS, sizeof(*set->rows));
    if (knobs->progressive)
        set->original = pell_calloc(ctx, profiles * offsets, sizeof(float));
    if (!set->offset || !set->rows || (knobs->progressive && !set->original))
        goto fail;
    fill(m, knobs, set, length, reach, set->offset, set->rows);
    res = PELL_OK;
    if (profiles > 1) {
        const struct levels levels = { model, most, length, offsets };
        set->level = pell_calloc(ctx, IS_LEVELS, sizeof(*set->level));
        res = set->level ? make_levels(ctx, m, knobs, &levels, scratch, set) : PELL_ERR_NOMEM;
    }
    if (set->original)
        memcpy(set->original, set->offset, profiles * offsets * sizeof(float));

fail:
    pell_free(ctx, scratch);
    return res;
}
