/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "contact": the shadow on the default background where the objects stand, so that they do not float. It is how much of an
 * even sky the objects hide from points of the level plane below them (ambient occlusion: Zhukov, Iones and Kronin 1998), kept on a grid:
 * it depends on the geometry alone, and a camera that moves costs no rays. It is a matter of the picture: no light comes from that plane.
 */
#ifndef PELL_CONTACT_H
#define PELL_CONTACT_H

#include "base/pool.h"
#include "render/camera_view.h"
#include "scene/scene.h"
#include "visibility/rays.h"

struct pell_contact;

/* *out is NULL where the scene has no contact shadow. The same bits for any number of threads. PELL_ERR_NOMEM, PELL_ERR_CANCELLED. */
PELL_NODISCARD enum pell_result pell_contact_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                                    const struct pell_rays *rays, struct pell_contact **out);
void pell_contact_destroy(struct pell_contact **contact);

/* The pixels that it may shade. */
struct pell_rect pell_contact_rect(const struct pell_contact *contact, const struct pell_view *view);
/* The factor, [0, 1], of the background's colour along a ray from a camera; 1 where it does not meet the plane near the objects. */
float pell_contact_shade(const struct pell_contact *contact, struct pell_vec3 start, struct pell_vec3 direction);

#endif
