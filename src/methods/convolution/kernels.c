/* SPDX-License-Identifier: MIT
 *
 * kernels.c - the inner loops of the convolution method; compiled once per level of base/simd.h. All levels give the same bits: lanes
 * never meet.
 */
#include "methods/convolution/kernels.h"

#include "base/simd.h"
#include "math/lanes.h"

#include <string.h>

enum { LANES = 16, ELEMENT = 32 };

INLINE const float *at(const struct conv_spectrum *s, int block, int y)
{
    return s->data + block * s->block + LANES * y;
}

INLINE int reaches(const struct conv_spectrum *s, int block, int y)
{
    return s && block < s->blocks && y < s->rows;
}

static void scale(float *element, vf k, int l)
{
    store(element + l, load(element + l) * k);
    store(element + LANES + l, load(element + LANES + l) * k);
}

/* Own kernels of planes, and of images between planes: the mean of the two planes' less what goes from one to the other. */
static void mix_own(const struct conv_mix *m, int block, int y, int k)
{
    for (int i = 0; i < m->planes; i++)
        for (int l = 0; l < LANES && m->column[i]; l += WIDTH)
            scale(m->column[i] + ELEMENT * y, load(at(m->own[i], block, k) + l), l);
    for (int i = 0; i < m->between; i++)
        for (int l = 0; l < LANES && m->column[m->planes + i]; l += WIDTH) {
            vf own = (load(at(m->own[i], block, k) + l) + load(at(m->own[i + 1], block, k) + l)) * 0.5f;
            if (reaches(m->next[i], block, k))
                own -= load(at(m->next[i], block, k) + l) * m->next_factor[i];
            scale(m->column[m->planes + i] + ELEMENT * y, own, l);
        }
}

/* What lies on a plane, in front and behind. */
static void load_plane(const struct conv_mix *m, int i, int y, float *to)
{
    const float *front = m->column[i], *behind = i < m->behind ? m->column[m->planes + m->between + i] : 0;

    for (int l = 0; l < ELEMENT; l += WIDTH) {
        vf sum = { 0 };
        if (front)
            sum = load(front + ELEMENT * y + l);
        if (behind)
            sum += load(behind + ELEMENT * y + l);
        store(to + l, sum);
    }
}

/* Light from behind, by the kernel of its distance. */
static void mix_behind(const struct conv_mix *m, int block, int y, int k)
{
    for (int i = 0; i < m->behind; i++) {
        float *to = m->column[i];
        const float *from = m->column[m->planes + m->between + i];
        if (!to || !from || !reaches(m->behind_own[i], block, k))
            continue;
        for (int l = 0; l < LANES; l += WIDTH) {
            const vf f = load(at(m->behind_own[i], block, k) + l);
            for (int part = l; part < ELEMENT; part += LANES)
                store(to + ELEMENT * y + part, load(to + ELEMENT * y + part) + load(from + ELEMENT * y + part) * f);
        }
    }
}

static void mix(const struct conv_mix *m, int block)
{
    int blocks = 0, rows = 0;

    for (int i = 0; i < m->num_pairs; i++) {
        const struct conv_spectrum *s = m->pairs[i].spectrum;
        blocks = s && s->blocks > blocks ? s->blocks : blocks;
        rows = s && s->rows > rows ? s->rows : rows;
    }
    for (int y = 0; y < m->height; y++) {
        const int k = 2 * y <= m->height ? y : m->height - y;
        _Alignas(64) float before[CONV_PLANES][ELEMENT];
        const int far = block < blocks && k < rows;
        for (int i = 0; far && i < m->planes; i++)
            load_plane(m, i, y, before[i]);
        mix_own(m, block, y, k);
        mix_behind(m, block, y, k);
        for (int i = 0; far && i < m->num_pairs; i++) {
            const struct conv_pair *p = &m->pairs[i];
            if (!reaches(p->spectrum, block, k))
                continue;
            for (int l = 0; l < LANES; l += WIDTH) {
                const vf f = load(at(p->spectrum, block, k) + l) * p->factor;
                for (int part = l; part < ELEMENT; part += LANES)
                    for (int way = 0; way < 2; way++) {
                        float *to = m->column[way ? p->from : p->to];
                        if (!to)
                            continue;
                        to += ELEMENT * y + part;
                        store(to, load(to) + load(before[way ? p->to : p->from] + part) * f);
                    }
            }
        }
    }
}

extern const struct conv_kernels PELL_SIMD(convolution_kernels);
const struct conv_kernels PELL_SIMD(convolution_kernels) = { .mix = mix };
