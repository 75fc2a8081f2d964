/* SPDX-License-Identifier: MIT
 *
 * profile_sum.h - the result of methods that integrate over the whole solid (`hierarchical` and `dipole`): the sum of the profile over all
 * of its faces, corrected between faces at an angle (optics/medium/opposed.h).
 */
#ifndef INDIRECT_PROFILE_SUM_H
#define INDIRECT_PROFILE_SUM_H

#include "optics/medium/opposed.h"
#include "render/indirect/radial.h"
#include "transport/light_tree.h"

struct profile_sum {
    struct pell_opposed opposed;
    struct pell_light_tree tree;
    struct radial radial[3];
    float window2, window_total[3]; /* window_total: integral of each profile inside the window */
};

/* Takes ownership of `samples`, also on failure; `spacing`: mm between them. */
PELL_NODISCARD enum pell_result indirect_profile_sum_make(struct pell_context *ctx, struct pell_surface_sample *samples, size_t count,
                                                          float spacing, const struct pell_profile profile[3],
                                                          const struct pell_opposed *opposed, struct profile_sum *out);
void indirect_profile_sum_finish(struct profile_sum *s);
/* W/m^2, without the factor `white` of struct pell_indirect_solid. */
void indirect_profile_sum_at(const struct profile_sum *s, const float position[3], const float normal[3], float M[3]);

#endif
