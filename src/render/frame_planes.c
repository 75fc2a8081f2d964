/* SPDX-License-Identifier: MIT
 * frame_planes.c - the rows of pell_plane_at. */
#include "render/pass.h"

#include <string.h>

#define IN(member) .name = #member, .offset = offsetof(struct pell_frame, member)
#define OUT(member) .name = #member, .offset = offsetof(struct pell_frame_light, member), .of_light = true

/* clang-format off */
static const struct pell_plane_info planes[PELL_PLANES] = {
    [PELL_PLANE_MATERIAL] = { IN(material), .unit = "1", .components = 1, .format = PELL_PLANE_U16,
        .what = "id, from 1, of the translucent material and object; 0: nothing translucent is visible" },
    [PELL_PLANE_DEPTH] = { IN(depth), .unit = "mm", .components = 1,
        .what = "distance of the visible point from the camera, along the view axis" },
    [PELL_PLANE_STRENGTH] = { IN(strength), .unit = "1", .components = 1, .need = PELL_NEED_STRENGTH, .optional = true,
        .what = "scale of the scattering radius, from 0 to 1" },
    [PELL_PLANE_BASE] = { IN(base), .unit = "1", .components = 3, .optional = true,
        .what = "base colour of materials that take their colour from a texture; undefined for others" },
    [PELL_PLANE_IRRADIANCE] = { IN(irradiance), .unit = "W/m^2", .components = 3, .need = PELL_NEED_IRRADIANCE,
        .what = "irradiance that the method spreads: what enters, times albedo^m, m the mix exponent, less what solved diffusion "
                "accounts for" },
    [PELL_PLANE_SHADED] = { IN(shaded), .unit = "W/(m^2 sr)", .components = 3, .need = PELL_NEED_SHADED,
        .what = "radiance of the image without scattering" },
    [PELL_PLANE_NORMAL] = { IN(normal), .unit = "1", .components = 3, .need = PELL_NEED_NORMAL,
        .what = "unit shading normal in world space, on the side of the viewer" },
    [PELL_PLANE_POSITION] = { IN(position), .unit = "mm", .components = 3, .need = PELL_NEED_POSITION,
        .what = "visible point in world space" },
    [PELL_PLANE_MESH] = { IN(mesh), .unit = "1", .components = 1, .format = PELL_PLANE_U32, .need = PELL_NEED_HIT,
        .what = "index, from 0, of the visible mesh in the scene" },
    [PELL_PLANE_TRIANGLE] = { IN(triangle), .unit = "1", .components = 1, .format = PELL_PLANE_U32, .need = PELL_NEED_HIT,
        .what = "index, from 0, of the visible triangle in its mesh" },
    [PELL_PLANE_BARYCENTRIC] = { IN(barycentric), .unit = "1", .components = 2, .need = PELL_NEED_HIT,
        .what = "barycentric coordinates of the visible point: weights of its triangle's second and third corner" },
    [PELL_PLANE_LIGHT] = { OUT(light), .unit = "W/m^2 or W/(m^2 sr)", .components = 3,
        .what = "result of the method: light that leaves the surface, without that of the planes single and surface" },
    [PELL_PLANE_SINGLE] = { OUT(single), .unit = "W/(m^2 sr)", .components = 3, .output = PELL_OUTPUT_SINGLE, .optional = true,
        .what = "radiance of light scattered once below the surface" },
    [PELL_PLANE_SURFACE] = { OUT(surface), .unit = "W/(m^2 sr)", .components = 3, .output = PELL_OUTPUT_SURFACE, .optional = true,
        .what = "radiance of light reflected at the surface" },
};
/* clang-format on */

const char *pell_plane_unit(const struct pell_plane_info *p, enum pell_quantity quantity)
{
    if (p != &planes[PELL_PLANE_LIGHT])
        return p->unit;
    return quantity == PELL_QUANTITY_EXITANCE ? "W/m^2" : "W/(m^2 sr)";
}

void pell_plane_pointers(const struct pell_plane_info *p, const struct pell_frame *in, const struct pell_frame_light *out,
                         const void *pointers[3])
{
    memcpy(pointers, (const char *) (p->of_light ? (const void *) out : (const void *) in) + p->offset,
           (size_t) p->components * sizeof(*pointers));
}

const struct pell_plane_info *pell_plane_at(int plane)
{
    return plane >= 0 && plane < PELL_PLANES ? &planes[plane] : NULL;
}
