/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "contact": the contact shadow on the default background, so that objects do not float. It is the fraction of a uniform
 * sky that the objects hide from points of the horizontal plane below them (ambient occlusion: Zhukov, Iones and Kronin 1998), stored on a
 * grid: it depends on the geometry alone, so a moving camera costs no rays. It only darkens the image: no light comes from that plane.
 */
#ifndef PELL_CONTACT_H
#define PELL_CONTACT_H

#include "base/pool.h"
#include "render/camera_view.h"
#include "scene/scene.h"
#include "visibility/rays.h"

struct pell_contact;

/* *out is NULL if the scene has no contact shadow. The result does not depend on the number of threads, to the bit. PELL_ERR_NOMEM,
 * PELL_ERR_CANCELLED. */
PELL_NODISCARD enum pell_result pell_contact_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                                    const struct pell_rays *rays, struct pell_contact **out);
void pell_contact_destroy(struct pell_contact **contact);

/* Bounds of the pixels that it may shade. */
struct pell_rect pell_contact_rect(const struct pell_contact *contact, const struct pell_view *view);
/* Factor, [0, 1], of the background's colour along a camera ray; 1 where the ray does not hit the plane near the objects. */
float pell_contact_shade(const struct pell_contact *contact, struct pell_vec3 start, struct pell_vec3 direction);

#endif
