/* SPDX-License-Identifier: MIT
 *
 * whole.h - what methods find that ask the whole solid, `hierarchical` and `dipole`: the sum of the profile over all of its faces, turned
 * between those at an angle (optics/medium/opposed.h).
 */
#ifndef INDIRECT_WHOLE_H
#define INDIRECT_WHOLE_H

#include "optics/medium/opposed.h"
#include "render/indirect/radial.h"
#include "transport/light_tree.h"

struct whole {
    struct pell_opposed law;
    struct pell_light_tree tree;
    struct radial radial[3];
    float window2, share[3]; /* share: of E, that a profile returns inside the window */
};

/* Takes over `samples`, also on failure; `spacing` mm lie between them. */
PELL_NODISCARD enum pell_result indirect_whole_make(struct pell_context *ctx, struct pell_lit_place *samples, size_t count, float spacing,
                                                    const struct pell_profile profile[3], const struct pell_opposed *law,
                                                    struct whole *out);
void indirect_whole_finish(struct whole *w);
/* W/m^2 without what white makes of it. */
void indirect_whole_at(const struct whole *w, const float position[3], const float normal[3], float M[3]);

#endif
