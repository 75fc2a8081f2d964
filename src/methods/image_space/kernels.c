/* SPDX-License-Identifier: MIT
 *
 * kernels.c - the inner loops of the image-space method; compiled once per level of base/simd.h. The mathematics is in kernels.h and
 * README.md.
 *
 * Vectors are the compiler's generic ones, as wide as the machine's registers; a lane is a pixel. All levels give the same bits: a pixel's
 * operations and their order do not depend on the width.
 */
#include "methods/image_space/image_space.h"

#include "base/simd.h"
#include "math/lanes.h"
#include "render/material_id.h"

#include <math.h>
#include <string.h>

#define HEAVIEST 1e12f /* weight of a sample; more is an accident of rounding */
#define STEEPEST 20.0f /* 1/cos of the steepest surface, seen from the view: what is steeper is taken for that */
#define FAR_PX 1e5f
enum { AHEAD = 8 };
#define THIN (1.0f / 16.0f) /* taps of the reconstruction may lie 4 footprints of a pixel off the planes, both together */

/* One float of each lane's place. */
#if defined(__AVX512F__)
#define gather(p, at) ((vf) _mm512_i32gather_ps((__m512i) (at), (p), 4))
#elif defined(__AVX2__)
#define gather(p, at) ((vf) _mm256_i32gather_ps((p), (__m256i) (at), 4))
#else
INLINE vf gather(const float *p, vi at)
{
    vf v;
    for (int l = 0; l < WIDTH; l++)
        v[l] = p[at[l]];
    return v;
}
#endif

/* Eight neighbouring floats of each lane's place: rows are loaded whole and turned, in half the time of eight gathers. `at` is best where
 * it has been in memory for a while: IN_MEMORY keeps compilers from taking vectors apart by shuffles, which are what is short here. */
#define IN_MEMORY(at) __asm__("" : "+m"(at))
#if defined(__AVX512F__)
INLINE void turn4(const __m512 in[4], __m512 out[4])
{
    const __m512 a = _mm512_unpacklo_ps(in[0], in[1]), b = _mm512_unpackhi_ps(in[0], in[1]);
    const __m512 c = _mm512_unpacklo_ps(in[2], in[3]), d = _mm512_unpackhi_ps(in[2], in[3]);
    out[0] = _mm512_shuffle_ps(a, c, 0x44);
    out[1] = _mm512_shuffle_ps(a, c, 0xee);
    out[2] = _mm512_shuffle_ps(b, d, 0x44);
    out[3] = _mm512_shuffle_ps(b, d, 0xee);
}

INLINE void gather8(const float *p, const vi *at, vf out[8])
{
    const int32_t *const index = (const int32_t *) at;
    __m512 rows[8], turned[8];

    for (int k = 0; k < 8; k++) { /* rows 0..3 beside 4..7, 8..11 beside 12..15 */
        const int32_t *i = index + (k & 3) + (k & 4) * 2;
        rows[k] = _mm512_castpd_ps(_mm512_insertf64x4(_mm512_castps_pd(_mm512_castps256_ps512(_mm256_loadu_ps(p + i[0]))),
                                                      _mm256_castps_pd(_mm256_loadu_ps(p + i[4])), 1));
    }
    turn4(rows, turned);
    turn4(rows + 4, turned + 4);
    for (int k = 0; k < 4; k++) {
        out[k] = (vf) _mm512_shuffle_f32x4(turned[k], turned[4 + k], 0x88);
        out[4 + k] = (vf) _mm512_shuffle_f32x4(turned[k], turned[4 + k], 0xdd);
    }
}
#elif defined(__AVX__)
INLINE void gather8(const float *p, const vi *at, vf out[8])
{
    const int32_t *const index = (const int32_t *) at;

    for (int half = 0; half < 8; half += 4) {
        __m256 rows[4], a, b, c, d;
        for (int k = 0; k < 4; k++)
            rows[k] =
                _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p + index[k] + half)), _mm_loadu_ps(p + index[k + 4] + half), 1);
        a = _mm256_unpacklo_ps(rows[0], rows[1]);
        b = _mm256_unpackhi_ps(rows[0], rows[1]);
        c = _mm256_unpacklo_ps(rows[2], rows[3]);
        d = _mm256_unpackhi_ps(rows[2], rows[3]);
        out[half] = (vf) _mm256_shuffle_ps(a, c, 0x44);
        out[half + 1] = (vf) _mm256_shuffle_ps(a, c, 0xee);
        out[half + 2] = (vf) _mm256_shuffle_ps(b, d, 0x44);
        out[half + 3] = (vf) _mm256_shuffle_ps(b, d, 0xee);
    }
}
#else
INLINE void gather8(const float *p, const vi *at, vf out[8])
{
    for (int k = 0; k < 8; k++)
        out[k] = gather(p + k, *at);
}
#endif

/* The nearest whole number, halves up, of numbers within FAR_PX. */
INLINE vi nearest(vf x)
{
    const vf up = x + 0.5f;
    const vi cut = __builtin_convertvector(up, vi);
    return cut + (__builtin_convertvector(cut, vf) > up);
}

INLINE vf within(vf x, float most)
{
    return greater(lesser(x, all(most)), all(-most)); /* no number becomes `most` */
}

/* --- The camera's irradiance image ---------------------------------------------------------------------------------------------------- */

static void is_load(const struct is_work *w, int y)
{
    const struct pell_frame *in = w->in;
    const ptrdiff_t from = y * in->shape.stride, to = y * w->stride;

    for (int x = in->rect.x0; x < in->rect.x1; x++) {
        const int m = pell_material_id(in, from + x);
        const float z = m ? in->depth[from + x] : 1.0f, safe = z > 1e-30f && z < 1e30f ? z : 1.0f;
        w->key[to + x] = m && w->solid ? (float) w->solid[y * w->texel_stride + x] : (float) m;
        w->w[to + x] = in->shape.orthographic ? safe : 1.0f / safe;
    }
}

/* The rise of w from a pixel to the next along `step`: the mean of both sides, limited to twice the smaller one, so that a jump in depth
 * is no slope; of one side where only that is of the same object. */
INLINE vf rise(const struct is_work *w, ptrdiff_t at, ptrdiff_t step, vf key, vf here)
{
    const vi before = load(w->key + at - step) == key, after = load(w->key + at + step) == key;
    const vf low = here - load(w->w + at - step), high = load(w->w + at + step) - here;
    const vf most = 2.0f * lesser(magnitude(low), magnitude(high));
    const vf both = greater(lesser(0.5f * (low + high), most), -most);

    return select(before & after, both, select(before, low, select(after, high, all(0.0f))));
}

static void is_measure(const struct is_work *w, int y)
{
    const struct pell_frame *in = w->in;
    const bool parallel = in->shape.orthographic;
    const float f = w->focal_px, ty = parallel ? 0.0f : ((float) y + 0.5f - w->mid_y) / f;

    for (int block = in->rect.x0 & ~(IS_BLOCK - 1); block < in->rect.x1; block += IS_BLOCK) {
        _Alignas(64) float gu[IS_BLOCK], gv[IS_BLOCK], h[IS_BLOCK];
        for (int l = 0; l < IS_BLOCK; l += WIDTH) {
            const ptrdiff_t at = y * w->stride + block + l;
            const vf key = load(w->key + at), here = load(w->w + at);
            vf tx = { 0 }, a = f * rise(w, at, 1, key, here), b = f * rise(w, at, w->stride, key, here), c, norm, ray, most, cut;
            for (int k = 0; k < WIDTH; k++)
                tx[k] = parallel ? 0.0f : ((float) (block + l + k) + 0.5f - w->mid_x) / f;
            c = parallel ? all(-1.0f) : here - a * tx - b * ty;
            ray = root(tx * tx + (ty * ty + 1.0f));
            most = STEEPEST * (parallel ? all(1.0f) : here) / ray;
            norm = root(a * a + b * b + c * c);
            cut = select(norm > most, most / norm, all(1.0f));
            a *= cut;
            b *= cut;
            c = parallel ? all(-1.0f) : here - a * tx - b * ty;
            store(h + l, root(a * a + b * b + c * c));
            store(gu + l, a / f);
            store(gv + l, b / f);
            /* Footprints of a pixel, facing, that a surface lies off this plane where w is off by one. */
            norm = load(h + l);
            store(w->flat + at, f / (parallel ? norm : norm * ray));
            store(w->gu + at, load(gu + l));
            store(w->gv + at, load(gv + l));
        }
        for (int l = 0; l < IS_BLOCK; l++) {
            const int x = block + l;
            float *t;
            if (x < in->rect.x0 || x >= in->rect.x1)
                continue;
            t = w->texels + IS_TEXEL * (y * w->texel_stride + x);
            memset(t, 0, IS_TEXEL * sizeof(float));
            if (w->key[y * w->stride + x] == 0.0f)
                continue;
            for (int c = 0; c < 3; c++)
                t[IS_RED + c] = in->irradiance[c][y * in->shape.stride + x];
            t[IS_W] = w->w[y * w->stride + x];
            t[IS_GU] = gu[l];
            t[IS_GV] = gv[l];
            t[IS_H] = h[l];
            t[IS_KEY] = w->key[y * w->stride + x];
        }
    }
}

/* --- Samples ----------------------------------------------------------------------------------------------------------------------- */

/* What the samples of a vector of pixels share. Vectors are in the camera's frame: x right, y down, z forward, mm. */
struct place {
    vf key;
    vi x;                       /* column */
    int y, lane;                /* lane: of the block */
    const float *samples;       /* offsets and shares of these pixels' samples; of all rows where levels vary */
    vf t[2], z, h, per_h;       /* ray, plane, 1/h */
    vf at[3], n[3], s[3], q[3]; /* x_o; unit: normal, tangents */
    vf strength, per_length2;   /* 1/(length strength)^2 */
    vf quarter[3];
    /* Where each pixel has a level of its own: its offsets, its rows, those of each channel and the part of the next level's; densities. */
    vi offset, density, rows[3];
    vf part[3], uniform, broad2, reach2;
};

/* Where a sample is on the surface. */
struct found {
    vi there;
    vf to[3];    /* p - x_o */
    vf jacobian; /* dA_p/dA_p' */
    vf light[3];
};

struct sums {
    int from, to; /* samples */
    vf light[3], weight[3], count;
};

/* The plane through x_o in which a view's samples lie, in the view's frame: tangent for the camera, as in the paper; facing the view for
 * lights, as rays of a light reach every point of the surface then (a tangent plane that turns away from the light is met by few), and r is
 * never less than r'. */
struct samples_plane {
    vf n[3], s[3], q[3], at[3];
    vf distance; /* from the centre of projection, or the cosine of a parallel view with it */
};

/* An irradiance image as the functions of several views see it. */
struct image {
    const float *texels;
    ptrdiff_t stride;
    struct pell_rect rect;
    bool parallel;
    float f, cx, cy;            /* column = f X/Z + cx */
    const struct is_view *view; /* NULL: the camera's */
};

/* The camera's image and those of lights, and the planes of a pixel's samples for each. */
struct views {
    const struct image *image;
    const struct samples_plane *plane;
};

/* The row of a squared radius, in units of length^2, and the place in it. */
INLINE vi find_row(vf square, vf *part)
{
    const float least = 1.0f / (1 << IS_OCTAVES), most = (float) (1 << IS_OCTAVES) * (1.0f - 0x1p-23f);
    const vi bits = (vi) greater(lesser(square, all(most)), all(least));

    *part = __builtin_convertvector(bits & ((1 << IS_SHIFT) - 1), vf) * (1.0f / (1 << IS_SHIFT));
    return ((bits >> IS_SHIFT) - ((127 - IS_OCTAVES) << (23 - IS_SHIFT))) * 8;
}

INLINE vi in_table(vf square)
{
    return square < (float) (1 << IS_OCTAVES);
}

INLINE vi texel_at(vi x, vi y, ptrdiff_t stride, vi inside)
{
    return ((y & inside) * (int) stride + (x & inside)) * IS_TEXEL;
}

INLINE vf plane_at(const vf texel[8], vf du, vf dv)
{
    return texel[IS_W] + texel[IS_GU] * du + texel[IS_GV] * dv;
}

/* Where in the camera's image a point of the tangent plane is looked up. */
struct aim {
    vf scale, du, dv; /* px a mm at the point; from the pixel that asks, px */
    vi at, there, own;
};

/* `o`: a point of the tangent plane, counted from x_o; everything is relative to the pixel, as radii may be far under the precision of a
 * depth. */
INLINE void camera_aims(const struct is_work *w, const struct place *p, const vf o[3], bool parallel, struct aim *to)
{
    const struct pell_rect *r = &w->in->rect;
    const float f = w->focal_px;
    const vf depth = p->z + o[2], scale = parallel ? all(f) : f / depth;
    const vf du = within(scale * (parallel ? o[0] : o[0] - p->t[0] * o[2]), FAR_PX);
    const vf dv = within(scale * (parallel ? o[1] : o[1] - p->t[1] * o[2]), FAR_PX);
    const vi iu = nearest(du), iv = nearest(dv), x = p->x + iu, y = p->y + iv;
    const vi before = parallel ? (vi) { 0 } - 1 : (vi) (depth > 0.0f);

    to->there = (x >= r->x0) & (x < r->x1) & (y >= r->y0) & (y < r->y1) & before;
    to->own = (iu == 0) & (iv == 0);
    to->at = texel_at(x, y, w->texel_stride, to->there);
    to->scale = scale;
    to->du = du;
    to->dv = dv;
}

/* The point that the camera sees where it sees point `o` of the tangent plane, counted from x_o. */
INLINE void camera_finds(const struct is_work *w, const struct place *p, const vf o[3], bool parallel, const struct aim *aim,
                         struct found *to)
{
    const float f = w->focal_px;
    const vf du = aim->du, dv = aim->dv;
    const vi own = aim->own;
    vf texel[8], plane, z, dz, step, jacobian;

    gather8(w->texels, &aim->at, texel);
    to->there = aim->there & (texel[IS_KEY] == p->key);
    plane = plane_at(texel, du - __builtin_convertvector(nearest(du), vf), dv - __builtin_convertvector(nearest(dv), vf));
    jacobian = texel[IS_H] * p->per_h;
    if (parallel) {
        z = plane;
        step = all(1.0f / f);
    } else {
        vf ratio;
        z = 1.0f / plane;
        step = z * (1.0f / f);
        ratio = step * aim->scale; /* z/z' */
        jacobian *= ratio * ratio * ratio;
        to->there &= own | (plane > 0.0f);
    }
    dz = z - p->z;
    to->to[0] = select(own, o[0], dz * p->t[0] + du * step);
    to->to[1] = select(own, o[1], dz * p->t[1] + dv * step);
    to->to[2] = select(own, o[2], dz);
    to->jacobian = select(own, all(1.0f), jacobian);
    for (int c = 0; c < 3; c++)
        to->light[c] = texel[IS_RED + c];
}

/* --- Several views ------------------------------------------------------------------------------------------------------------------ */

INLINE void into_view(const struct is_view *v, const vf p[3], float shifted, vf out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = v ? v->rotate[k][0] * p[0] + v->rotate[k][1] * p[1] + v->rotate[k][2] * p[2] + shifted * v->shift[k] : p[k];
}

/* The texel of a point, and how far the point is from its centre; where the image does not hold it, 0. */
INLINE vi look(const struct image *m, const vf p[3], vf *du, vf *dv, vi *at)
{
    const vf scale = m->parallel ? all(m->f) : m->f / p[2];
    const vf u = within(scale * p[0] + m->cx, FAR_PX), v = within(scale * p[1] + m->cy, FAR_PX);
    const vi x = nearest(u), y = nearest(v), before = m->parallel ? (vi) { 0 } - 1 : (vi) (p[2] > 0.0f);
    const vi inside = (x >= m->rect.x0) & (x < m->rect.x1) & (y >= m->rect.y0) & (y < m->rect.y1) & before;

    *du = u - __builtin_convertvector(x, vf);
    *dv = v - __builtin_convertvector(y, vf);
    *at = texel_at(x, y, m->stride, inside);
    return inside;
}

/* dA_p/dA_p' for a point at `ratio` = z/z'; `distance`: of the tangent plane from the centre of projection, or the cosine of a parallel
 * view with it. */
INLINE vf jacobian_of(const struct image *m, const vf texel[8], vf ratio, vf distance)
{
    const vf h = texel[IS_H] * magnitude(distance);
    return m->parallel ? h : h * ratio * ratio * ratio;
}

/* Tangents of n, a unit vector (Duff et al. 2017, "Building an Orthonormal Basis, Revisited"). */
INLINE void tangents(const vf n[3], vf s[3], vf q[3])
{
    const vf sign = select(n[2] < 0.0f, all(-1.0f), all(1.0f)), a = -1.0f / (sign + n[2]), b = n[0] * n[1] * a;

    s[0] = sign * n[0] * n[0] * a + 1.0f;
    s[1] = sign * b;
    s[2] = -sign * n[0];
    q[0] = b;
    q[1] = n[1] * n[1] * a + sign;
    q[2] = -n[1];
}

INLINE void make_plane(const struct image *m, const struct place *p, struct samples_plane *to)
{
    into_view(m->view, p->at, 1.0f, to->at);
    if (!m->view) {
        for (int k = 0; k < 3; k++)
            to->n[k] = p->n[k];
        to->distance = m->parallel ? p->n[2] : p->n[0] * p->at[0] + p->n[1] * p->at[1] + p->n[2] * p->at[2];
        return;
    }
    to->distance = m->parallel ? all(1.0f) : root(to->at[0] * to->at[0] + to->at[1] * to->at[1] + to->at[2] * to->at[2]);
    for (int k = 0; k < 3; k++)
        to->n[k] = m->parallel ? all(k == 2 ? 1.0f : 0.0f) : to->at[k] / to->distance;
    tangents(to->n, to->s, to->q);
}

/* As camera_finds, for sample (x, y), mm, in the view of a light. */
INLINE void light_finds(const struct image *m, const struct samples_plane *n, const struct place *p, vf x, vf y, struct found *to)
{
    vf there[3], du, dv, plane, z, ratio, texel[8];
    vi at;

    for (int k = 0; k < 3; k++)
        there[k] = n->at[k] + x * n->s[k] + y * n->q[k];
    to->there = look(m, there, &du, &dv, &at);
    gather8(m->texels, &at, texel);
    to->there &= texel[IS_KEY] == p->key;
    plane = plane_at(texel, du, dv);
    z = m->parallel ? plane : 1.0f / plane;
    to->there &= m->parallel ? (vi) { 0 } - 1 : (vi) (plane > 0.0f);
    ratio = z / there[2];
    to->jacobian = jacobian_of(m, texel, ratio, n->distance);
    if (!m->parallel)
        for (int k = 0; k < 2; k++)
            there[k] *= ratio;
    there[2] = z;
    for (int k = 0; k < 3; k++)
        there[k] -= n->at[k];
    for (int k = 0; k < 3; k++)
        to->to[k] = m->view->rotate[0][k] * there[0] + m->view->rotate[1][k] * there[1] + m->view->rotate[2][k] * there[2];
    for (int c = 0; c < 3; c++)
        to->light[c] = texel[IS_RED + c];
}

/* Samples per area, in units of 1/length^2, that a view sends to point p of the surface (x_o + to); 0 where it does not see it. */
INLINE vf density_from(const struct is_work *w, const struct image *m, const struct samples_plane *s, const struct place *p,
                       const struct is_set *set, bool varies, const vf to[3])
{
    const vf *const n = s->n, *const from = s->at, distance = s->distance;
    vf there[3], du, dv, plane, z, towards, ratio, square, part, density, jacobian, off, texel[8];
    vi at, seen;

    into_view(m->view, to, 0.0f, there);
    for (int k = 0; k < 3; k++)
        there[k] += from[k];
    seen = look(m, there, &du, &dv, &at);
    gather8(m->texels, &at, texel);
    seen &= texel[IS_KEY] == p->key;
    plane = plane_at(texel, du, dv);
    z = m->parallel ? plane : 1.0f / plane;
    /* Nearer to what is seen there than a pixel of it is deep. */
    off = texel[IS_H] * (m->parallel ? all(1.0f / m->f) : z * z * (1.0f / m->f));
    seen &= magnitude(there[2] - z) < off + 1e-5f * magnitude(z);
    /* The point p' of the tangent plane on the same ray. */
    towards = m->parallel ? n[2] : n[0] * there[0] + n[1] * there[1] + n[2] * there[2];
    if (m->parallel) {
        const vf along = (n[0] * (from[0] - there[0]) + n[1] * (from[1] - there[1]) + n[2] * (from[2] - there[2])) / towards;
        there[2] += along;
        ratio = all(1.0f);
    } else {
        ratio = towards / distance; /* z/z' */
        seen &= ratio > 0.0f;
        for (int k = 0; k < 3; k++)
            there[k] /= ratio;
    }
    square = all(0.0f);
    for (int k = 0; k < 3; k++)
        square += (there[k] - from[k]) * (there[k] - from[k]);
    square *= p->per_length2;
    seen &= in_table(square);
    jacobian = w->jacobian ? jacobian_of(m, texel, ratio, distance) : all(1.0f);
    at = find_row(square, &part);
    if (varies)
        at += p->density;
    density = (float) w->importance * (gather(&set->rows[0][3], at) + part * gather(&set->rows[0][7], at));
    if (set->broad2 > 0.0f) {
        const vf fall = 1.0f + square / (varies ? p->broad2 : all(set->broad2));
        density += (varies ? p->uniform : all(set->uniform)) / (fall * fall);
    } else {
        density += select(square <= (varies ? p->reach2 : all(set->reach2)), varies ? p->uniform : all(set->uniform), all(0.0f));
    }
    density = w->inverted ? density * jacobian : density / jacobian;
    seen &= (density >= 0.0f) & (density < 1e30f);
    return (vf) ((vi) density & seen);
}

/* --- Gathering ---------------------------------------------------------------------------------------------------------------------- */

/* R of channel c between the two levels of each pixel. */
INLINE vf between_levels(const struct is_set *set, const struct place *p, int c, vi at, vf part)
{
    enum { NEXT = IS_ROWS * 8 };
    const vi here = at + p->rows[c];
    const vf low = gather(&set->rows[0][c], here) + part * gather(&set->rows[0][4 + c], here);
    const vf high = gather(&set->rows[0][c] + NEXT, here) + part * gather(&set->rows[0][4 + c] + NEXT, here);

    return low + p->part[c] * (high - low);
}

/* Adds a sample that was found; `share`: of its 1/density, or of the sum over views of it. */
INLINE void add(const struct is_set *set, const struct place *p, const struct found *f, vf share, bool varies, struct sums *s, vi *counted)
{
    const vf square = (f->to[0] * f->to[0] + f->to[1] * f->to[1] + f->to[2] * f->to[2]) * p->per_length2;
    vi good = f->there & in_table(square);
    vf part, weight[3], row[8];
    vi at = find_row(square, &part);

    if (varies) {
        for (int c = 0; c < 3; c++)
            weight[c] = between_levels(set, p, c, at, part) * share;
    } else {
        IN_MEMORY(at);
        gather8(&set->rows[0][0], &at, row);
        for (int c = 0; c < 3; c++)
            weight[c] = (row[c] + part * row[4 + c]) * share;
    }
    good &= (share >= 0.0f) & (weight[0] <= HEAVIEST) & (weight[1] <= HEAVIEST) & (weight[2] <= HEAVIEST);
    for (int c = 0; c < 3; c++) {
        s->weight[c] += (vf) ((vi) weight[c] & good);
        s->light[c] += (vf) ((vi) (weight[c] * f->light[c]) & good);
    }
    *counted |= good;
}

INLINE vf jacobian_share(const struct is_work *w, vf jacobian)
{
    return !w->jacobian ? all(1.0f) : w->inverted ? 1.0f / jacobian : jacobian;
}

/* Sample k: its place in the plane of samples, mm, and 1/density. `offset`: of the pixels' row of the tile, or, where each pixel has its
 * own, of the set. */
INLINE void take_sample(const struct place *p, const float *offset, int k, bool varies, vf *x, vf *y, vf *share)
{
    offset += (size_t) k * 3 * IS_BLOCK;
    *x = (varies ? gather(offset, p->offset) : load(offset)) * p->strength;
    *y = (varies ? gather(offset + IS_BLOCK, p->offset) : load(offset + IS_BLOCK)) * p->strength;
    *share = varies ? gather(offset + 2 * IS_BLOCK, p->offset) : load(offset + 2 * IS_BLOCK);
}

INLINE void in_plane(const struct place *p, vf x, vf y, vf o[3])
{
    for (int k = 0; k < 3; k++)
        o[k] = x * p->s[k] + y * p->q[k];
}

/* Sums over the samples of pixels of one material, in the camera's image alone. Texels of a wide profile lie all over the outer caches:
 * they are asked for AHEAD samples at a time, which takes a fifth of the time off. */
INLINE void sample_camera(const struct is_work *w, const struct place *p, const struct is_set *set, vi live, bool parallel, bool varies,
                          struct sums *s)
{
    struct aim aims[AHEAD];

    for (int from = s->from; from < s->to; from += AHEAD) {
        const int count = s->to - from < AHEAD ? s->to - from : AHEAD;
        vf o[3], x, y, share;
        for (int k = 0; k < count; k++) {
            take_sample(p, p->samples, from + k, varies, &x, &y, &share);
            in_plane(p, x, y, o);
            camera_aims(w, p, o, parallel, &aims[k]);
        }
        for (int k = 0; k < count; k++)
            for (int l = 0; l < WIDTH; l++)
                __builtin_prefetch(w->texels + aims[k].at[l]);
        for (int k = 0; k < count; k++) {
            struct found f;
            vi counted = { 0 };
            take_sample(p, p->samples, from + k, varies, &x, &y, &share);
            in_plane(p, x, y, o);
            camera_finds(w, p, o, parallel, &aims[k], &f);
            f.there &= live & (share > 0.0f);
            add(set, p, &f, share * jacobian_share(w, f.jacobian), varies, s, &counted);
            s->count += select(counted, all(1.0f), all(0.0f));
        }
    }
}

/* The same with the views of lights, by the balance heuristic. */
INLINE void sample_all(const struct is_work *w, const struct place *p, const struct is_set *set, vi live, bool parallel, bool varies,
                       const struct views *views, struct sums *s)
{
    for (int k = s->from; k < s->to; k++) {
        vi counted = { 0 };
        vf x, y, share;
        take_sample(p, p->samples, k, varies, &x, &y, &share);
        for (int v = 0; v <= w->num_views; v++) {
            struct found f;
            vf sum;
            if (v == 0) {
                struct aim aim;
                vf o[3];
                in_plane(p, x, y, o);
                camera_aims(w, p, o, parallel, &aim);
                camera_finds(w, p, o, parallel, &aim, &f);
            } else {
                light_finds(&views->image[v], &views->plane[v], p, x, y, &f);
            }
            f.there &= live & (share > 0.0f);
            if (!any(f.there))
                continue;
            sum = 1.0f / (share * jacobian_share(w, f.jacobian));
            for (int u = 0; u <= w->num_views; u++)
                if (u != v)
                    sum += density_from(w, &views->image[u], &views->plane[u], p, set, varies, f.to);
            add(set, p, &f, 1.0f / sum, varies, s, &counted);
        }
        s->count += select(counted, all(1.0f), all(0.0f));
    }
}

/* The levels of each pixel of a vector. */
INLINE void choose_levels(const struct is_work *w, const struct is_set *set, vi live, struct place *p)
{
    const struct pell_frame *in = w->in;
    const float first = 1.0f - sqrtf(1.0f - IS_ALBEDO_LEAST), last = 1.0f - sqrtf(1.0f - IS_ALBEDO_MOST);
    const vi at = p->x & live;
    vf mean = { 0 }, row[IS_LEVEL];
    vi level;

    for (int c = 0; c < 3; c++) {
        const vf base = gather(in->base[c] + p->y * in->shape.stride, at);
        const vf albedo = greater(lesser(base, all(IS_ALBEDO_MOST)), all(IS_ALBEDO_LEAST)); /* no number is the most */
        const vf place = (1.0f - root(1.0f - albedo) - first) * ((IS_LEVELS - 1) / (last - first));
        vi low = __builtin_convertvector(greater(lesser(place, all(IS_LEVELS - 1.5f)), all(0.0f)), vi);
        p->part[c] = place - __builtin_convertvector(low, vf);
        p->rows[c] = (low + 1) * (IS_ROWS * 8);
        mean += place * (1.0f / 3.0f);
    }
    level = nearest(greater(lesser(mean, all(IS_LEVELS - 1.0f)), all(0.0f)));
    p->density = (level + 1) * (IS_ROWS * 8);
    p->offset = ((level + 1) * w->tile + p->y % w->tile) * (w->samples * 3 * IS_BLOCK) + (p->x & (IS_BLOCK - 1));
    level *= IS_LEVEL;
    for (int k = 0; k < IS_LEVEL; k++)
        row[k] = gather(&set->level[0][k], level);
    p->uniform = row[IS_UNIFORM_AT];
    p->broad2 = row[IS_BROAD2_AT];
    p->reach2 = row[IS_REACH2_AT];
    for (int c = 0; c < 3; c++)
        p->quarter[c] = row[IS_QUARTER_AT + c];
}

INLINE void sample_some(const struct is_work *w, const struct place *p, const struct is_set *set, vi live, bool parallel,
                        const struct views *views, struct sums *s)
{
    const bool varies = set->level && w->in->base[0];

    if (w->num_views > 0)
        sample_all(w, p, set, live, parallel, varies, views, s);
    else if (varies)
        sample_camera(w, p, set, live, parallel, true, s);
    else
        sample_camera(w, p, set, live, parallel, false, s);
}

/* Samples of a kind stand for those of the kind that found nothing. */
INLINE void make_up(struct sums *s)
{
    const vf times = select(s->count > 0.0f, (float) (s->to - s->from) / s->count, all(0.0f));

    for (int c = 0; c < 3; c++)
        s->light[c] *= times;
}

INLINE void sample(const struct is_work *w, struct place *p, const struct is_set *set, vi live, bool parallel, const struct views *views,
                   struct sums *s)
{
    *s = (struct sums) { .to = w->renormalise == IS_BY_COUNT ? w->first_kind : w->samples };
    p->samples = set->offset + (size_t) (p->y % w->tile) * (size_t) w->samples * 3 * IS_BLOCK + p->lane;
    for (int c = 0; c < 3; c++)
        p->quarter[c] = all(set->quarter[c]);
    if (set->level && w->in->base[0]) {
        choose_levels(w, set, live, p);
        p->samples = set->offset;
    }
    sample_some(w, p, set, live, parallel, views, s);
    if (w->renormalise != IS_BY_COUNT)
        return;
    make_up(s);
    if (w->first_kind < w->samples) {
        struct sums rest = { .from = w->first_kind, .to = w->samples };
        sample_some(w, p, set, live, parallel, views, &rest);
        make_up(&rest);
        for (int c = 0; c < 3; c++)
            s->light[c] += rest.light[c];
        s->count += rest.count;
    }
}

/* The pixels of a vector: rays, planes, tangents. */
INLINE void start(const struct is_work *w, int x, int y, bool parallel, struct place *p)
{
    const ptrdiff_t at = y * w->stride + x;
    const float f = w->focal_px, py = ((float) y + 0.5f - w->mid_y) / f;
    const vf here = load(w->w + at), gu = load(w->gu + at) * f, gv = load(w->gv + at) * f;
    vf px = { 0 };
    vi column = { 0 };

    for (int k = 0; k < WIDTH; k++) {
        px[k] = ((float) (x + k) + 0.5f - w->mid_x) / f;
        column[k] = x + k;
    }
    p->x = column;
    p->y = y;
    p->key = load(w->key + at);
    p->z = parallel ? here : 1.0f / here;
    p->t[0] = parallel ? all(0.0f) : px;
    p->t[1] = parallel ? all(0.0f) : all(py);
    p->at[0] = parallel ? px : px * p->z;
    p->at[1] = parallel ? all(py) : py * p->z;
    p->at[2] = p->z;
    p->n[0] = gu;
    p->n[1] = gv;
    p->n[2] = parallel ? all(-1.0f) : here - gu * px - gv * py;
    p->h = root(p->n[0] * p->n[0] + p->n[1] * p->n[1] + p->n[2] * p->n[2]);
    p->per_h = 1.0f / p->h;
    for (int k = 0; k < 3; k++)
        p->n[k] *= p->per_h;
    tangents(p->n, p->s, p->q);
    p->offset = p->density = (vi) { 0 };
    p->uniform = p->broad2 = p->reach2 = all(0.0f);
    for (int c = 0; c < 3; c++) {
        p->rows[c] = (vi) { 0 };
        p->part[c] = all(0.0f);
    }
}

/* How much each channel takes part in the reconstruction: not where a quarter of its light stays within half a pixel. */
INLINE vf takes_part(const struct place *p, int c, bool parallel, float f)
{
    const vf px = p->quarter[c] * p->strength * (parallel ? all(f) : f / p->z);
    const vf t = greater(lesser((px - 0.4f) / (1.5f - 0.4f), all(1.0f)), all(0.0f));
    return t * t * (3.0f - 2.0f * t);
}

INLINE void finish(const struct is_work *w, const struct place *p, const struct is_set *set, vi live, const struct sums *s, bool parallel,
                   float (*result)[IS_BLOCK], float (*alpha)[IS_BLOCK])
{
    const float *own = w->texels + IS_TEXEL * (p->y * w->texel_stride);
    const vi at = (p->x & live) * IS_TEXEL;

    for (int c = 0; c < 3; c++) {
        const vf here = gather(own + IS_RED + c, at);
        vf light = s->light[c];
        vi kept = p->strength > 1.0f / 1024.0f;
        if (w->renormalise == IS_BY_WEIGHT) {
            kept &= s->weight[c] > 1e-20f;
            light /= s->weight[c];
        } else if (w->renormalise == IS_BY_COUNT) {
            kept &= s->count > 0.0f;
        }
        light = select(kept, light, here) * (set->scale[c] * w->factor);
        store(result[c] + p->lane, select(live, light, load(result[c] + p->lane)));
        store(alpha[c] + p->lane, select(live, (vf) ((vi) takes_part(p, c, parallel, w->focal_px) & kept), load(alpha[c] + p->lane)));
    }
}

INLINE int gather_block(const struct is_work *w, int block, int y, bool parallel, const struct image *images)
{
    const struct pell_frame *in = w->in;
    const ptrdiff_t row = y * in->shape.stride;
    _Alignas(64) float result[3][IS_BLOCK] = { { 0 } }, alpha[3][IS_BLOCK] = { { 0 } }, strength[IS_BLOCK];
    _Alignas(64) int32_t index[IS_BLOCK];
    int count = 0;

    if (block >= in->rect.x0 && block + IS_BLOCK <= in->rect.x1) { /* whole vectors: what is stored in parts can't be loaded at once */
        for (int l = 0; l < IS_BLOCK; l++)
            index[l] = pell_material_id(in, row + block + l);
        for (int l = 0; l < IS_BLOCK; l++)
            strength[l] = in->strength ? in->strength[row + block + l] : 1.0f;
    } else {
        for (int l = 0; l < IS_BLOCK; l++) {
            const int x = block + l;
            const bool inside = x >= in->rect.x0 && x < in->rect.x1;
            index[l] = inside ? pell_material_id(in, row + x) : 0;
            strength[l] = index[l] && in->strength ? in->strength[row + x] : 1.0f;
        }
    }
    for (int l = 0; l < IS_BLOCK; l++) {
        strength[l] = strength[l] < 1.0f ? strength[l] : 1.0f; /* no number is 1 */
        strength[l] = strength[l] > 0.0f ? strength[l] : 0.0f;
        count += index[l] != 0;
    }
    if (count == 0)
        return 0;
    for (int l = 0; l < IS_BLOCK; l += WIDTH) {
        struct samples_plane planes[IS_VIEWS];
        const struct views views = { images, planes };
        struct place p;
        vi which, left;
        memcpy(&which, index + l, sizeof(which));
        left = which != 0;
        if (!any(left))
            continue;
        start(w, block + l, y, parallel, &p);
        p.lane = l;
        p.strength = load(strength + l);
        for (int v = 0; v <= w->num_views && w->num_views > 0; v++)
            make_plane(&images[v], &p, &planes[v]);
        for (int k = 0; k < WIDTH; k++) {
            struct sums s;
            const struct is_set *set;
            vi live;
            if (!left[k])
                continue;
            set = &w->sets[which[k] - 1];
            live = which == which[k];
            left &= ~live;
            p.per_length2 = set->per_length2 / greater(p.strength * p.strength, all(1e-7f));
            sample(w, &p, set, live, parallel, &views, &s);
            finish(w, &p, set, live, &s, parallel, result, alpha);
        }
    }
    if (w->reconstruct) {
        for (int c = 0; c < 3; c++) {
            memcpy(w->light[c] + y * w->stride + block, result[c], sizeof(result[c]));
            memcpy(w->alpha[c] + y * w->stride + block, alpha[c], sizeof(alpha[c]));
        }
        return count;
    }
    for (int c = 0; c < 3; c++)
        for (int l = 0; l < IS_BLOCK; l++)
            if (index[l])
                w->out->light[c][y * in->shape.stride + block + l] = result[c][l];
    return count;
}

INLINE int gather_row(const struct is_work *w, int y, bool parallel)
{
    struct image images[IS_VIEWS];
    int count = 0;

    images[0] = (struct image) { w->texels, w->texel_stride, w->in->rect, parallel, w->focal_px, w->mid_x - 0.5f, w->mid_y - 0.5f, NULL };
    for (int v = 0; v < w->num_views; v++) {
        const struct is_view *from = &w->views[v];
        images[v + 1] = (struct image) {
            from->texels,    from->size, { 0, 0, from->size, from->size }, from->orthographic, from->focal_px, from->centre_px,
            from->centre_px, from
        };
    }
    for (int block = w->in->rect.x0 & ~(IS_BLOCK - 1); block < w->in->rect.x1; block += IS_BLOCK)
        count += gather_block(w, block, y, parallel, images);
    return count;
}

static int is_gather(const struct is_work *w, int y)
{
    return w->in->shape.orthographic ? gather_row(w, y, true) : gather_row(w, y, false);
}

/* --- Reconstruction ------------------------------------------------------------------------------------------------------------------ */

/* Tiles' mean, each pattern of the tile counted once: 1/2 1 .. 1 1/2 along both axes, over n^2. Taps count as far as each of two pixels
 * lies on the other's plane, to a few pixels' footprints. What p takes from q, q takes from p, so that the sum over pixels stays. */
static void is_rebuild(const struct is_work *w, int y)
{
    const struct pell_frame *in = w->in;
    const int reach = w->tile / 2;
    const float over = 1.0f / (float) (w->tile * w->tile);

    for (int block = in->rect.x0 & ~(IS_BLOCK - 1); block < in->rect.x1; block += IS_BLOCK) {
        _Alignas(64) float result[3][IS_BLOCK];
        for (int l = 0; l < IS_BLOCK; l += WIDTH) {
            const ptrdiff_t at = y * w->stride + block + l;
            const vf key = load(w->key + at), here = load(w->w + at), gu = load(w->gu + at), gv = load(w->gv + at);
            const vf flat = load(w->flat + at);
            vf own[3], moved[3] = { { 0 } };
            for (int c = 0; c < 3; c++)
                own[c] = load(w->light[c] + at);
            for (int dy = -reach; dy <= reach && any(key != 0.0f); dy++) {
                for (int dx = -reach; dx <= reach; dx++) {
                    const float box = (dx == reach || dx == -reach ? 0.5f : 1.0f) * (dy == reach || dy == -reach ? 0.5f : 1.0f);
                    const ptrdiff_t other = at + dy * w->stride + dx;
                    const vf there = load(w->w + other), fx = all((float) dx), fy = all((float) dy);
                    const vf to = here + gu * fx + gv * fy - there;
                    const vf back = there - load(w->gu + other) * fx - load(w->gv + other) * fy - here;
                    const vf off = magnitude(to) * flat + magnitude(back) * load(w->flat + other);
                    vf weight = greater(1.0f - off * off * THIN, all(0.0f)) * (box * over);
                    if (dx == 0 && dy == 0)
                        continue;
                    weight = (vf) ((vi) weight & (load(w->key + other) == key));
                    for (int c = 0; c < 3; c++)
                        moved[c] += weight * load(w->alpha[c] + other) * (load(w->light[c] + other) - own[c]);
                }
            }
            for (int c = 0; c < 3; c++)
                store(result[c] + l, own[c] + load(w->alpha[c] + at) * moved[c]);
        }
        for (int c = 0; c < 3; c++)
            for (int l = 0; l < IS_BLOCK; l++)
                if (w->key[y * w->stride + block + l] != 0.0f)
                    w->out->light[c][y * in->shape.stride + block + l] = result[c][l];
    }
}

extern const struct is_kernels PELL_SIMD(pell_is_kernels);
const struct is_kernels PELL_SIMD(pell_is_kernels) = { .load = is_load, .measure = is_measure, .gather = is_gather, .rebuild = is_rebuild };
