/* SPDX-License-Identifier: MIT
 * bvh_kernel.c - see bvh_kernel.h; compiled once per level of base/simd.h. It bounds the half vector of connect.c. */
#include "transport/refraction/bvh_kernel.h"

#include "math/lanes.h"

/* Bit mask of the children of a node where H may be along a normal. */
INLINE uint32_t candidate_children(const struct pell_connect_node *n, const struct pell_connect_search *s)
{
    const float finite = s->distant ? 0.0f : 1.0f, side = s->eta > 1.0f ? -1.0f : 1.0f;
    uint32_t set = 0;

    for (int l = 0; l < PELL_CONNECT_CHILDREN; l += WIDTH) {
        const vf cx = load(n->x + l), cy = load(n->y + l), cz = load(n->z + l), r = load(n->radius + l);
        const vf vx = s->x[0] - cx, vy = s->x[1] - cy, vz = s->x[2] - cz;
        const vf ux = s->light[0] - finite * cx, uy = s->light[1] - finite * cy, uz = s->light[2] - finite * cz;
        const vf v = vsqrt(vx * vx + vy * vy + vz * vz);
        const vi near = v - r <= s->reach;
        vi candidates;
        if (!any(near))
            continue;
        const vf u = vsqrt(ux * ux + uy * uy + uz * uz), iv = 1.0f / vmax(v, splat(1e-30f)), il = 1.0f / vmax(u, splat(1e-30f));
        const vf sv = r * iv, sl = finite * r * il;
        /* 2 sin(a/2) <= s (1 + 0.42 s^2), s = sin(a) */
        const vf spread = s->eta * sv * (1.0f + 0.42f * sv * sv) + sl * (1.0f + 0.42f * sl * sl) + 1e-6f;
        const vf hx = s->eta * vx * iv + ux * il, hy = s->eta * vy * iv + uy * il, hz = s->eta * vz * iv + uz * il;
        const vf h = vsqrt(hx * hx + hy * hy + hz * hz), ih = 1.0f / vmax(h, splat(1e-30f)), sb = spread * ih;
        const vf cb = vsqrt(vmax(1.0f - sb * sb, splat(0.0f))), sine = load(n->sine + l), cosine = load(n->cosine + l);
        const vf facing = side * (hx * load(n->ax + l) + hy * load(n->ay + l) + hz * load(n->az + l)) * ih;
        const vi inside = (sv >= 1.0f) | (sl >= 1.0f);
        const vi along = (facing >= cosine * cb - sine * sb - 2e-6f) | (sb >= 0.99f) | (cosine < 0.0f) | (s->narrow ? 0 : -1);
        candidates = near & (inside | ((h <= s->grazing + spread) & along));
        set |= movemask(candidates) << l;
    }
    return set;
}

static int find(struct pell_connect_search *s, uint32_t *facets, int room)
{
    int found = 0;

    while (s->count > 0 && found + PELL_CONNECT_CHILDREN <= room) {
        const struct pell_connect_node *n = &s->nodes[s->stack[--s->count]];
        for (uint32_t left = candidate_children(n, s); left; left &= left - 1) {
            const uint32_t child = n->child[__builtin_ctz(left)];
            if (child == PELL_CONNECT_NOTHING)
                continue;
            if (child < PELL_CONNECT_LEAF)
                s->stack[s->count++] = child;
            else
                facets[found++] = child - PELL_CONNECT_LEAF;
        }
    }
    return found;
}

extern const struct pell_connect_kernels PELL_SIMD(pell_connect_kernels);
const struct pell_connect_kernels PELL_SIMD(pell_connect_kernels) = { .find = find };
