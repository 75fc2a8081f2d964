// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// inside.comp - effects of the solid's shape at a pixel, and of the light inside it, on entering light, before that is computed: the shift
// by curvature, and whether straight transmission is traced. Mirror of irradiance/inside.c, curvature/cpu.c, and of pell_indirect_at and
// pell_indirect_lookup16.
//   in  0 hits      1 materials in the format of the stage "irradiance"   2 frame   3 meshes   4 corners
//   in  5 shapes    words of pell_curvature_words
//   in  6 solids    words of pell_indirect_words: light inside solids
//   in  7 between   the same for interreflection between surfaces
//   i/o 8 points
//   out 9 insides
layout(local_size_x = 64) in;
#include "render/picture/device_data.h"
#include "shared/curvature.h"
#include "shared/leaving.h"
#include "shared/subdivision.h"
layout(set = 0, binding = 0) readonly buffer Hits { pell_picture_hit hits[]; };
layout(set = 0, binding = 1) readonly buffer Lit { pell_lit_material materials[]; };
layout(set = 0, binding = 2) readonly buffer Frame { pell_picture_frame fr; };
layout(set = 0, binding = 3) readonly buffer Meshes { pell_lit_mesh meshes[]; };
layout(set = 0, binding = 4) readonly buffer Corners { uint corners[]; };
layout(set = 0, binding = 5) readonly buffer Shapes { uint shapes[]; };
layout(set = 0, binding = 6) readonly buffer Solids { uint solids[]; };
layout(set = 0, binding = 7) readonly buffer Between { uint between[]; };
layout(set = 0, binding = 8) buffer Points { pell_lit_point points[]; };
layout(set = 0, binding = 9) writeonly buffer Insides { pell_picture_inside insides[]; };
layout(push_constant) uniform Push { pell_picture_push pc; };

const uint NONE = 0xffffffffu;

bool has(uint flag)
{
    return (fr.known & flag) != 0u;
}

// --- Shape ---------------------------------------------------------------------------------------------------------------------------

struct Shape {
    float mean, thinness;
};

float shape_float(uint at)
{
    return uintBitsToFloat(shapes[at]);
}

vec3 shape_rgb(uint at)
{
    return uintBitsToFloat(uvec3(shapes[at], shapes[at + 1u], shapes[at + 2u]));
}

// Area, turn and thin of a node of the grid; 0 if the node does not exist.
vec3 node_at(uint patch_index, ivec3 at)
{
    const uint capacity = shapes[0], node_index = uint((at.x * PELL_CURVATURE_SIDE + at.y) * PELL_CURVATURE_SIDE + at.z);
    uint slot = pell_curvature_slot(patch_index, node_index) & (capacity - 1u);

    for (uint step = 0u; step < capacity; step++) {
        const uint node = shapes[1] + 5u * slot;
        if (shapes[node] == 0u)
            break;
        if (shapes[node] == patch_index + 1u && shapes[node + 1u] == node_index)
            return shape_rgb(node + 2u);
        slot = (slot + 1u) & (capacity - 1u);
    }
    return vec3(0.0);
}

// Mirror of curvature_grid_at.
Shape shape_of_grid(uint part, vec3 position)
{
    const vec3 x = clamp((position - shape_rgb(part)) / shape_float(part + 3u), vec3(0.0), vec3(float(PELL_CURVATURE_SIDE) - 2.0));
    const ivec3 low = ivec3(x);
    const vec3 f = x - vec3(low);
    vec3 sum = vec3(0.0);

    for (int i = 0; i < 8 && shapes[0] != 0u; i++) {
        const ivec3 bits = ivec3(i & 1, i >> 1 & 1, i >> 2);
        const vec3 w = mix(1.0 - f, f, equal(bits, ivec3(1)));
        sum += w.x * w.y * w.z * node_at(shapes[part + 4u], low + bits);
    }
    return sum.x > 0.0 ? Shape(0.5 * sum.y / sum.x, sum.z / sum.x) : Shape(0.0, 0.0);
}

// Mirror of pell_curvature_at; `response`: first word of the material's response, or NONE.
Shape shape_at(uint i, out uint response)
{
    const uint mesh = hits[i].mesh, triangle = hits[i].triangle, row = 4u + 4u * mesh, values = shapes[row + 1u], longs = shapes[row + 2u];
    const vec3 w = vec3(1.0 - hits[i].u - hits[i].v, hits[i].u, hits[i].v);
    Shape shape = Shape(0.0, 0.0);

    response = shapes[row] == NONE ? NONE : shapes[row + 3u];
    if (response == NONE)
        return shape;
    if (longs != NONE && shapes[longs + triangle] != 0u)
        return shape_of_grid(shapes[row], points[i].position.xyz);
    for (uint k = 0u; k < 3u; k++) {
        const uint at = values + 2u * corners[meshes[mesh].corners + 3u * triangle + k];
        shape.mean += w[k] * shape_float(at);
        shape.thinness += w[k] * shape_float(at + 1u);
    }
    return shape;
}

// The required members of struct pell_curvature_effects.
struct Effect {
    vec3 gain, local, opposed, opposed_local, shift;
    float flat_weight;
};

// Interpolates between two entries of `each` floats in a table.
vec3 look_up(uint table, uint each, float coord)
{
    const uint at = table + each * uint(coord);

    return mix(shape_rgb(at), shape_rgb(at + each), coord - floor(coord));
}

// Mirror of `effects` in curvature/kernel.c.
Effect effect_at(uint i)
{
    Effect e = Effect(vec3(1.0), vec3(1.0), vec3(1.0), vec3(1.0), vec3(0.0), 0.0);
    vec3 across = vec3(0.0);
    uint response;
    const Shape shape = shape_at(i, response);

    if (response == NONE)
        return e;
    const float step = shape_float(response), excess = pell_curvature_excess(shape.mean, shape.thinness);
    const uint bent = response + 5u, slabs = bent + 12u * PELL_CURVATURE_GAINS, throughs = slabs + 4u * PELL_CURVATURE_GAINS;
    if (shape.mean != 0.0) {
        const float coord = pell_curvature_mean_coord(shape.mean, shape_float(response + 1u));
        e.gain = look_up(bent, 12u, coord);
        e.opposed = look_up(bent + 3u, 12u, coord);
        across = look_up(bent + 6u, 12u, coord);
        e.local = look_up(bent + 9u, 12u, coord);
        for (uint c = 0u; c < 3u; c++)
            e.shift[c] = pell_curvature_shift(shape.mean, shape_float(response + 2u + c));
    }
    if (!(shape.thinness > 0.0)) {
        e.opposed_local = max(e.local - across, vec3(0.0));
        return e;
    }
    e.flat_weight = pell_curvature_sheet(excess, shape.thinness);
    const vec3 through = look_up(throughs, 4u, pell_curvature_thinness_coord(shape.thinness, step));
    const vec3 slab = excess > 0.0 ? look_up(slabs, 4u, pell_curvature_thinness_coord(excess, step)) : vec3(1.0);
    const vec3 large = mix(e.local, vec3(1.0), e.flat_weight) * slab;
    const float coord = pell_curvature_thinness_coord(shape.thinness, step);
    const uint balls = throughs + 4u * PELL_CURVATURE_GAINS;
    const vec3 as_thick = mix(look_up(slabs, 4u, coord), look_up(balls, 4u, coord), pell_curvature_round(shape.mean, shape.thinness));
    const vec3 all = mix(large, as_thick, look_up(balls + 4u * PELL_CURVATURE_GAINS, 4u, coord));
    e.local = max(all - through, vec3(0.0));
    e.opposed_local = max(all - max(through, across), vec3(0.0));
    return e;
}

// --- Light at knots ----------------------------------------------------------------------------------------------------------------------

// Words of the knots around a point in one of two tables, and their interpolation weights. Mirror of indirect_find.
struct Knots {
    uint value[3]; // first word of each knot's values
    vec3 weight;
};

#define FIND_KNOTS(name, table, each)                                                                                                      \
    Knots name(uint i, bool back)                                                                                                          \
    {                                                                                                                                      \
        const uint mesh = hits[i].mesh, row = 8u + 3u * mesh, roots = table[0] + table[row + 2u];                                          \
        uint cell = table[roots + hits[i].triangle], knot[3];                                                                              \
        vec3 w = vec3(1.0 - hits[i].u - hits[i].v, hits[i].u, hits[i].v);                                                                  \
        Knots k;                                                                                                                           \
                                                                                                                                           \
        for (uint n = 0u; n < 3u; n++)                                                                                                     \
            knot[n] = table[row] + corners[meshes[mesh].corners + 3u * hits[i].triangle + n];                                              \
        if (cell != NONE) {                                                                                                                \
            while (table[table[1] + 4u * cell] != 0u) {                                                                                    \
                const uint word = table[table[1] + 4u * cell];                                                                             \
                const pell_child_cell q = pell_child_cell_at(word >> PELL_CELL_PATTERN_SHIFT, w[0], w[1], w[2]);                           \
                w = vec3(q.w0, q.w1, q.w2);                                                                                                \
                cell = (word & PELL_CELL_CHILD_MASK) + uint(q.child);                                                                      \
            }                                                                                                                              \
            for (uint n = 0u; n < 3u; n++)                                                                                                 \
                knot[n] = table[table[1] + 4u * cell + 1u + n];                                                                            \
        }                                                                                                                                  \
        for (uint n = 0u; n < 3u; n++) {                                                                                                   \
            if (back)                                                                                                                      \
                knot[n] = knot[n] < table[3] ? table[row + 1u] + (knot[n] - table[row]) : table[4] + (knot[n] - table[3]);                 \
            k.value[n] = table[2] + each * knot[n];                                                                                        \
        }                                                                                                                                  \
        k.weight = w;                                                                                                                      \
        return k;                                                                                                                          \
    }

FIND_KNOTS(solid_knots, solids, 32u)
FIND_KNOTS(between_knots, between, 6u)

// Interpolates three of the values' floats.
vec3 solid_at(Knots k, uint first)
{
    vec3 sum = vec3(0.0);

    for (uint n = 0u; n < 3u; n++) {
        const uint at = k.value[n] + first;
        sum += k.weight[n] * uintBitsToFloat(uvec3(solids[at], solids[at + 1u], solids[at + 2u]));
    }
    return sum;
}

vec3 between_at(Knots k, uint first)
{
    vec3 sum = vec3(0.0);

    for (uint n = 0u; n < 3u; n++) {
        const uint at = k.value[n] + first;
        sum += k.weight[n] * uintBitsToFloat(uvec3(between[at], between[at + 1u], between[at + 2u]));
    }
    return sum;
}

// --- A point -------------------------------------------------------------------------------------------------------------------------

// Applies the solution for light inside the solid, where it exists. Returns whether straight transmission is traced.
bool add_inside(uint i, pell_lit_material m, vec3 opposed_local, inout pell_picture_inside n)
{
    const Knots k = solid_knots(i, false);
    const vec3 sum_weight = solid_at(k, 0u), solved = solid_at(k, 6u), deep = solid_at(k, 24u);
    const vec3 normal = points[i].normal.xyz, view = points[i].view.xyz;
    const float nv = dot(normal, view);
    const vec3 pass_by = m.pass_base.rgb + m.pass_slope.rgb * pell_angle_off(m.inverse_eta2, pell_saturate(nv));
    vec3 exit = 1.0 + deep * (pass_by - 1.0);

    for (uint c = 0u; c < 3u; c++)
        exit[c] *= pell_gradient_exit(m.inverse_eta2, dot(view - nv * normal, solid_at(k, 15u + 3u * c)));
    if (has(PELL_KNOWN_BETWEEN))
        n.all.rgb = mix(n.all.rgb, opposed_local, sum_weight);
    n.all.rgb = solved + (1.0 - solved) * n.all.rgb;
    n.sum_weight.rgb = sum_weight;
    n.transmitted.rgb = exit * solid_at(k, 3u);
    n.solved.rgb = solved;
    n.light.rgb = exit * solid_at(k, 12u);
    n.entered.rgb = solid_at(k, 27u);
    return any(greaterThan((1.0 - sum_weight) * (1.0 - solved), vec3(PELL_LIT_STRAIGHT_LEAST)));
}

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    const bool far_side = i >= 64u * pc.count; // the far side of a thin sheet

    if (i >= 64u * pc.count + pc.far_sides || points[i].material == PELL_LIT_NONE)
        return;
    const pell_lit_material m = materials[points[i].material];
    pell_picture_inside n = pell_picture_inside(vec4(1.0), vec4(1.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0),
                                             vec4(0.0));
    vec3 opposed_local = vec3(1.0);

    if (has(PELL_KNOWN_SHAPE)) {
        Effect e = Effect(vec3(1.0), vec3(1.0), vec3(1.0), vec3(1.0), vec3(0.0), 0.0);
        if (m.opaque == 0)
            e = effect_at(i);
        n.all = vec4(has(PELL_KNOWN_LOCAL) ? e.local : has(PELL_KNOWN_OPPOSED) ? e.opposed : e.gain, e.flat_weight);
        for (uint c = 0u; c < 3u; c++) {
            const bool thin = has(PELL_KNOWN_LOCAL) && e.gain[c] > 0.0;
            n.single[c] = pell_curvature_single(e.shift[c], m.single_eta2) * (thin ? e.local[c] / e.gain[c] : 1.0);
        }
        opposed_local = e.opposed_local;
        points[i].view.w = e.shift.r;
        points[i].tint.w = e.shift.g;
        points[i].f0.w = e.shift.b;
    }
    if (has(PELL_KNOWN_SOLIDS) && m.opaque == 0 && !add_inside(i, m, opposed_local, n))
        points[i].flags &= ~PELL_LIT_STRAIGHT;
    if (has(PELL_KNOWN_INDIRECT)) {
        const Knots k = between_knots(far_side ? i - pc.far_sides : i, m.opaque != 0 && (points[i].flags & PELL_LIT_BACK) != 0u);
        n.indirect.rgb = between_at(k, 0u);
        n.indirect_transmitted.rgb = has(PELL_KNOWN_TRANSMITS) && !far_side ? between_at(k, 3u) : vec3(0.0);
    }
    insides[i] = n;
}
