// SPDX-License-Identifier: MIT
// buffers.glsl - what direct.comp and transmission.comp read and write (device_data.h).
//   in  0 nodes      of visibility/wide_bvh.h
//   in  1 triangles
//   in  2 lights     sorted by environment, those of none first; `light` is the number in the scene, `image` one of the images below
//   in  3 materials  of the scene
//   in  4 tables     directional albedos, as struct pell_specular_tables has them; then smooth boundaries; then mean albedos
//   in  5 images     a struct pell_lit_image each, then texels
//   in  6 points
//   i/o 7 results    bits of floats
//   in  8 meshes     of the scene
#include "render/irradiance/device_data.h"
layout(set = 0, binding = 0) readonly buffer Nodes { uvec4 bvh_nodes[]; };
layout(set = 0, binding = 1) readonly buffer Triangles { uvec4 bvh_triangles[]; };
layout(set = 0, binding = 2) readonly buffer Lights { pell_light_data lights[]; };
layout(set = 0, binding = 3) readonly buffer Materials { pell_lit_material materials[]; };
layout(set = 0, binding = 4) readonly buffer Tables { float tables[]; };
layout(set = 0, binding = 5) readonly buffer Images { uvec4 images[]; };
layout(set = 0, binding = 6) readonly buffer Points { pell_lit_point points[]; };
layout(set = 0, binding = 7) buffer Results { uvec4 results[]; };
layout(set = 0, binding = 8) readonly buffer Meshes { pell_lit_mesh meshes[]; };
layout(push_constant) uniform Push { pell_lit_push pc; };
