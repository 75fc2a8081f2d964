/* SPDX-License-Identifier: MIT
 *
 * rebuild.c - the reconstruction of the image-space method: a filter over tiles of pixels along the surface; compiled once per level of
 * base/simd.h.
 */
#include "methods/image_space/texels.h"

/* Mean over a tile in which each pattern has the same weight: 1/2 1 .. 1 1/2 along both axes, over n^2. The weight of a tap falls with the
 * distance of either pixel from the other's plane, to 0 at a few pixel footprints. Weights are symmetric, so the sum over pixels is
 * preserved. */
void PELL_SIMD(is_rebuild)(const struct is_work *w, int y)
{
    const struct pell_frame *in = w->in;
    const int reach = w->tile / 2;
    const float over = 1.0f / (float) (w->tile * w->tile);

    for (int block = in->rect.x0 & ~(IS_BLOCK - 1); block < in->rect.x1; block += IS_BLOCK) {
        _Alignas(64) float result[3][IS_BLOCK];
        for (int l = 0; l < IS_BLOCK; l += WIDTH) {
            const ptrdiff_t at = y * w->stride + block + l;
            const vf key = load(w->key + at), here = load(w->w + at), gu = load(w->gu + at), gv = load(w->gv + at);
            const vf footprints = load(w->footprints + at);
            vf own[3], moved[3] = { { 0 } };
            for (int c = 0; c < 3; c++)
                own[c] = load(w->light[c] + at);
            for (int dy = -reach; dy <= reach && any(key != 0.0f); dy++) {
                for (int dx = -reach; dx <= reach; dx++) {
                    const float box = (dx == reach || dx == -reach ? 0.5f : 1.0f) * (dy == reach || dy == -reach ? 0.5f : 1.0f);
                    const ptrdiff_t other = at + dy * w->stride + dx;
                    const vf w_other = load(w->w + other), fx = splat((float) dx), fy = splat((float) dy);
                    const vf to = here + gu * fx + gv * fy - w_other;
                    const vf back = w_other - load(w->gu + other) * fx - load(w->gv + other) * fy - here;
                    const vf off = vabs(to) * footprints + vabs(back) * load(w->footprints + other);
                    vf weight = vmax(1.0f - off * off * IS_OFF_PLANE, splat(0.0f)) * (box * over);
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
