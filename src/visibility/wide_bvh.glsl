// SPDX-License-Identifier: MIT
// wide_bvh.glsl - rays through the hierarchy of visibility/wide_bvh.h, with the semantics of rays.h: closest hit, or any hit. An including
// file declares the buffers `uvec4 bvh_nodes[]` and `uvec4 bvh_triangles[]`.
#include "shared/triangle_ray.h"

#define WIDE_LEAF 0x80000000u
#define WIDE_NONE 0xffffffffu
#define WIDE_STACK 64      // three for each of PELL_WIDE_LEVELS, and one
#define RAY_CAMERA 15u     // PELL_RAY_CAMERA: backs of single-sided surfaces are culled
#define SINGLE_SIDED 256u

struct Ray {
    vec3 origin;
    float near;
    vec3 direction; // any length, t is in its units
    float far;
    uint mask; // enum pell_ray_mask
};

struct Hit {
    float t;
    float u, v; // barycentric: (1 - u - v) p0 + u p1 + v p2
    uint mesh, triangle;
    uint at; // index in bvh_triangles: its vertices are 3 at and the following
};

// Intersects the triangles of a leaf; `hit` keeps the nearest. Returns whether one was hit.
bool intersect_leaf(uint leaf, Ray ray, pell_ray_shear shear, inout Hit hit)
{
    const uint first = (leaf & ~WIDE_LEAF) >> 2, last = first + (leaf & 3u);
    bool any_hit = false;

    for (uint i = first; i <= last; i++) {
        const uvec4 a = bvh_triangles[3 * i], b = bvh_triangles[3 * i + 1], c = bvh_triangles[3 * i + 2];
        if ((c.w & ray.mask) == 0u)
            continue;
        const vec3 pa = uintBitsToFloat(a.xyz) - ray.origin, pb = uintBitsToFloat(b.xyz) - ray.origin,
                   pc = uintBitsToFloat(c.xyz) - ray.origin;
        const pell_triangle_hit m =
            pell_triangle_intersect(pell_ray_shear_point(shear, pa.x, pa.y, pa.z), pell_ray_shear_point(shear, pb.x, pb.y, pb.z),
                                    pell_ray_shear_point(shear, pc.x, pc.y, pc.z));
        if (!(m.t >= ray.near && m.t <= hit.t) || (ray.mask == RAY_CAMERA && (c.w & SINGLE_SIDED) != 0u && m.side < 0.0))
            continue;
        hit = Hit(m.t, m.u, m.v, a.w, b.w, i);
        any_hit = true;
    }
    return any_hit;
}

// Distances where the ray enters the four boxes of a node; beyond hit.t: it does not.
vec4 enter_boxes(uint node, Ray ray, vec3 inverse, float most)
{
    const uint at = 8 * node;
    vec4 near = vec4(ray.near), far = vec4(most);

    for (uint k = 0; k < 3; k++) {
        const vec4 low = uintBitsToFloat(bvh_nodes[at + 2 * k]) - ray.origin[k];
        const vec4 high = uintBitsToFloat(bvh_nodes[at + 2 * k + 1]) - ray.origin[k];
        near = max(near, PELL_SLAB_NEAR(low, high, inverse[k]));
        far = min(far, PELL_SLAB_FAR(low, high, inverse[k]) * PELL_SLAB_WIDER);
    }
    return mix(vec4(1e38), near, lessThanEqual(near, far));
}

// `any`: stops at the first hit. Without a hit hit.t is ray.far; returns whether there is a hit.
bool trace_ray(Ray ray, bool any, out Hit hit)
{
    const pell_ray_shear shear = pell_ray_shear_of(ray.direction.x, ray.direction.y, ray.direction.z);
    const vec3 inverse =
        vec3(pell_ray_inverse(ray.direction.x), pell_ray_inverse(ray.direction.y), pell_ray_inverse(ray.direction.z));
    uint stack[WIDE_STACK];
    int height = 1;
    bool any_hit = false;

    hit = Hit(ray.far, 0.0, 0.0, 0u, 0u, 0u);
    stack[0] = 0u;
    while (height > 0) {
        const uint next = stack[--height];
        if ((next & WIDE_LEAF) != 0u) {
            any_hit = intersect_leaf(next, ray, shear, hit) || any_hit;
            if (any && any_hit)
                return true;
            continue;
        }
        const uvec4 children = bvh_nodes[8 * next + 6];
        vec4 enters = enter_boxes(next, ray, inverse, hit.t);
        // The farthest is pushed first.
        for (int turns = 0; turns < 4; turns++) {
            int which = 0;
            float far = -1.0;
            for (int i = 0; i < 4; i++)
                if (enters[i] < 1e38 && enters[i] > far) {
                    far = enters[i];
                    which = i;
                }
            if (far < 0.0)
                break;
            enters[which] = 1e38;
            if (children[which] != WIDE_NONE)
                stack[height++] = children[which];
        }
    }
    return any_hit;
}

// A vertex of the triangle that was hit.
vec3 hit_corner(Hit hit, uint k)
{
    return uintBitsToFloat(bvh_triangles[3u * hit.at + k].xyz);
}
