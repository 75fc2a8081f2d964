/* SPDX-License-Identifier: MIT
 *
 * measure.c - the camera's irradiance image of the image-space method, row by row: keys and depths of pixels, then the plane visible in
 * each; compiled once per level of base/simd.h. The mathematics is in kernels.h.
 */
#include "methods/image_space/texels.h"

#include "render/material_id.h"

void PELL_SIMD(is_load)(const struct is_work *w, int y)
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

/* Derivative of w from a pixel to the next along `step`: the mean of both sides, limited to twice the smaller one, so that a depth
 * discontinuity is no slope; one-sided if only that side is on the same object. */
INLINE vf slope(const struct is_work *w, ptrdiff_t at, ptrdiff_t step, vf key, vf here)
{
    const vi before = load(w->key + at - step) == key, after = load(w->key + at + step) == key;
    const vf low = here - load(w->w + at - step), high = load(w->w + at + step) - here;
    const vf most = 2.0f * vmin(vabs(low), vabs(high));
    const vf both = vmax(vmin(0.5f * (low + high), most), -most);

    return select(before & after, both, select(before, low, select(after, high, splat(0.0f))));
}

void PELL_SIMD(is_measure)(const struct is_work *w, int y)
{
    const struct pell_frame *in = w->in;
    const bool parallel = in->shape.orthographic;
    const float f = w->focal_px, ty = parallel ? 0.0f : ((float) y + 0.5f - w->mid_y) / f;

    for (int block = in->rect.x0 & ~(IS_BLOCK - 1); block < in->rect.x1; block += IS_BLOCK) {
        _Alignas(64) float gu[IS_BLOCK], gv[IS_BLOCK], h[IS_BLOCK];
        for (int l = 0; l < IS_BLOCK; l += WIDTH) {
            const ptrdiff_t at = y * w->stride + block + l;
            const vf key = load(w->key + at), here = load(w->w + at);
            vf tx = { 0 }, a = f * slope(w, at, 1, key, here), b = f * slope(w, at, w->stride, key, here), c, norm, ray, most, cut;
            for (int k = 0; k < WIDTH; k++)
                tx[k] = parallel ? 0.0f : ((float) (block + l + k) + 0.5f - w->mid_x) / f;
            c = parallel ? splat(-1.0f) : here - a * tx - b * ty;
            ray = vsqrt(tx * tx + (ty * ty + 1.0f));
            most = IS_SLOPE_MAX * (parallel ? splat(1.0f) : here) / ray;
            norm = vsqrt(a * a + b * b + c * c);
            cut = select(norm > most, most / norm, splat(1.0f));
            a *= cut;
            b *= cut;
            c = parallel ? splat(-1.0f) : here - a * tx - b * ty;
            store(h + l, vsqrt(a * a + b * b + c * c));
            store(gu + l, a / f);
            store(gv + l, b / f);
            /* Distance from this plane, in footprints of a facing pixel, for a difference of one in w. */
            norm = load(h + l);
            store(w->footprints + at, f / (parallel ? norm : norm * ray));
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
