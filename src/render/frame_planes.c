/* SPDX-License-Identifier: MIT
 * frame_planes.c - the rows of pell_plane_at. */
#include "render/pass.h"

#include <string.h>

#define IN(member) .name = #member, .offset = offsetof(struct pell_frame, member)
#define OUT(member) .name = #member, .offset = offsetof(struct pell_frame_light, member), .of_light = true

static const struct pell_plane_info planes[PELL_PLANES] = {
    [PELL_PLANE_MATERIAL] = { IN(material), .unit = "1", .components = 1, .format = PELL_PLANE_U16 },
    [PELL_PLANE_DEPTH] = { IN(depth), .unit = "mm", .components = 1 },
    [PELL_PLANE_STRENGTH] = { IN(strength), .unit = "1", .components = 1, .need = PELL_NEED_STRENGTH, .optional = true },
    [PELL_PLANE_BASE] = { IN(base), .unit = "1", .components = 3, .optional = true },
    [PELL_PLANE_IRRADIANCE] = { IN(irradiance), .unit = "W/m^2", .components = 3, .need = PELL_NEED_IRRADIANCE },
    [PELL_PLANE_SHADED] = { IN(shaded), .unit = "W/(m^2 sr)", .components = 3, .need = PELL_NEED_SHADED },
    [PELL_PLANE_NORMAL] = { IN(normal), .unit = "1", .components = 3, .need = PELL_NEED_NORMAL },
    [PELL_PLANE_POSITION] = { IN(position), .unit = "mm", .components = 3, .need = PELL_NEED_POSITION },
    [PELL_PLANE_MESH] = { IN(mesh), .unit = "1", .components = 1, .format = PELL_PLANE_U32, .need = PELL_NEED_HIT },
    [PELL_PLANE_TRIANGLE] = { IN(triangle), .unit = "1", .components = 1, .format = PELL_PLANE_U32, .need = PELL_NEED_HIT },
    [PELL_PLANE_BARYCENTRIC] = { IN(barycentric), .unit = "1", .components = 2, .need = PELL_NEED_HIT },
    [PELL_PLANE_LIGHT] = { OUT(light), .unit = "W/m^2 or W/(m^2 sr)", .components = 3 },
    [PELL_PLANE_SINGLE] = { OUT(single), .unit = "W/(m^2 sr)", .components = 3, .output = PELL_OUTPUT_SINGLE, .optional = true },
    [PELL_PLANE_SURFACE] = { OUT(surface), .unit = "W/(m^2 sr)", .components = 3, .output = PELL_OUTPUT_SURFACE, .optional = true },
};

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
