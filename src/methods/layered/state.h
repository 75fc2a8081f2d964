/* SPDX-License-Identifier: MIT
 *
 * state.h - layered on the cpu engine: data that outlives a frame, and the stages of a packet. For the files of the cpu engine only.
 */
#ifndef PELL_LAYERED_STATE_H
#define PELL_LAYERED_STATE_H

#include "methods/layered/layered.h"

#include "lights/light_sampling.h"
#include "math/vec.h"
#include "render/services.h"
#include "transport/solids.h"
#include "visibility/light_grid.h"

/* A sample point on a light, or the rule to choose one per pixel. */
struct layered_light_point {
    const struct pell_light_sampler *sampler; /* of this light only */
    struct pell_light_sample sample;
    bool per_pixel;                     /* the point is chosen for each pixel */
    bool uniform;                       /* `power` describes the light completely */
    size_t light;                       /* index in the scene */
    const struct pell_light_grid *grid; /* of the frame: visibility from the light; NULL: trace shadow rays */
    int index, count;                   /* of the sample points of this light */
    int set, sets;                      /* for the multisamples whose index is `set` modulo `sets` */
    float power[3], scale;
};

struct layered_worker {
    struct layered_packet packet;
    struct layered_light sources[LAYERED_GROUP];
    int64_t pixels, rays;
};

struct layered_diffuse;
struct pell_connector;
struct layered_plane_cache;

struct layered_state {
    const struct pell_services *services; /* borrowed */
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct layered_kernels *kernels;
    struct layered_knobs knobs;
    struct layered_work work;
    struct pell_medium_layers **medium_layers; /* by material of the scene; NULL where no mesh needs them */
    struct layered_medium *media;
    size_t num_materials;
    float (**planes)[4]; /* by mesh */
    size_t num_meshes;
    struct pell_light_sampler **samplers; /* by light */
    size_t num_samplers;
    struct layered_light_point *light_points;
    int num_light_points;
    struct layered_worker *workers;
    struct pell_solids *solids;        /* refraction=exact, else NULL */
    struct pell_connector *connector;  /* refraction=exact, else NULL */
    struct layered_plane_cache *cache; /* between create and destroy; otherwise owned by the renderer */
    struct layered_diffuse *diffuse;   /* NULL: neither multiple scattering nor a film is requested */
    int most_layers, most_packs;
    float size; /* mm: diagonal of the scene */
    struct pell_pass_time times[3];
    size_t num_times;
    double fit_seconds; /* < 0: already reported */
    int64_t fitted;
    /* The current frame. */
    const struct pell_frame *in;
    const struct pell_frame_light *out;
    const struct pell_view *view;
};

static inline bool layered_scatters(const struct pell_scene *scene, const struct pell_mesh *mesh)
{
    return mesh->material >= 0 && !scene->materials[mesh->material].opaque && mesh->num_triangles > 0;
}

/* Whether a pixel of the frame shows a mesh that this method scatters in. */
static inline bool layered_shows(const struct layered_state *st, ptrdiff_t at)
{
    const struct pell_frame *in = st->in;

    return in->mesh[at] < st->num_meshes && st->planes[in->mesh[at]] &&
           in->triangle[at] < st->services->scene->meshes[in->mesh[at]].num_triangles;
}

static inline bool layered_same_solid(const struct pell_mesh *a, const struct pell_mesh *b)
{
    return a->object == b->object && a->material == b->material;
}

/* The interpolated outward normal of a hit. */
static inline struct pell_vec3 layered_normal_at(const struct pell_mesh *m, uint32_t triangle, float u, float v)
{
    const uint32_t *index = m->index + 3 * (size_t) triangle;
    struct pell_vec3 n = vec3_mul(vec3_load(m->normal + 3 * (size_t) index[0]), 1.0f - u - v);

    n = vec3_mad(n, u, vec3_load(m->normal + 3 * (size_t) index[1]));
    return vec3_normalize(vec3_mad(n, v, vec3_load(m->normal + 3 * (size_t) index[2])));
}

/* `rows`: float [3][LAYERED_LANES]. */
static inline struct pell_vec3 layered_lane3(const void *rows, int i)
{
    const float *a = rows;

    return vec3(a[i], a[LAYERED_LANES + i], a[2 * LAYERED_LANES + i]);
}

static inline void layered_map_uv(const struct pell_texture_map *map, const struct pell_mesh *mesh, uint32_t vertex, float out[2])
{
    const float *uv = mesh->uv[map->uv], *m = map->matrix;
    const float u = uv ? uv[2 * (size_t) vertex] : 0.0f, v = uv ? uv[2 * (size_t) vertex + 1] : 0.0f;

    out[0] = m[0] * u + m[1] * v + m[2];
    out[1] = m[3] * u + m[4] * v + m[5];
}

/* --- plane_fit.c: planes of the vertices of all solids -------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result layered_fit(struct layered_state *st, const struct pell_scene *scene);

/* --- plane_cache.c: reuse of planes between frames ------------------------------------------------------------------------------------ */

/* Takes over the kept planes of a scene with the same number of meshes, if any; layered_cache_end leaves them to the renderer's next
 * pass. */
PELL_NODISCARD enum pell_result layered_cache_begin(struct layered_state *st, const struct pell_scene *scene);
void layered_cache_end(struct layered_state *st);
/* Writes the reusable planes of the solid whose first mesh is `first`, and marks them in `keep`; *left: number of planes to fit. */
PELL_NODISCARD enum pell_result layered_cache_load(const struct layered_state *st, const struct pell_scene *scene, size_t first,
                                                   const struct layered_cloud *cloud, float (*plane)[4], uint8_t *keep, size_t *left);
PELL_NODISCARD enum pell_result layered_cache_store(const struct layered_state *st, const struct pell_scene *scene, size_t first,
                                                    const struct layered_cloud *cloud, const float (*plane)[4]);

/* --- light_points.c: sample points on lights ------------------------------------------------------------------------------------------ */

PELL_NODISCARD enum pell_result layered_make_lights(struct layered_state *st, const struct pell_scene *scene);

/* Power that the light sends to each pixel. False: none. */
bool layered_set_power(const struct layered_state *st, const struct layered_light_point *s, const struct layered_packet *p,
                       struct layered_light *source);

/* --- packet_rays.c: rays of a packet -------------------------------------------------------------------------------------------------- */

/* Finds where the camera rays leave the solid: marches end there, and in thin parts layers are counted from there, too. */
void layered_find_exits(const struct layered_state *st, const struct layered_medium *m, const uint32_t *mesh, struct layered_worker *w);

/* Sets the weight of the path by planes in each lane, and the visibility of the light from P. */
void layered_set_planes(const struct layered_state *st, const struct layered_light_point *s, const struct layered_packet *p,
                        struct layered_worker *w, struct layered_light *source);

/* Sets one node of a light for the active lanes: the path from the light to this point of the march. */
void layered_set_node(const struct layered_state *st, const struct layered_medium *m, const struct layered_packet *p,
                      struct layered_light *source, const uint32_t *mesh, const uint32_t *triangle, int node, struct layered_worker *w);

/* --- refracted.c: refraction=exact ---------------------------------------------------------------------------------------------------- */

/* Where light enters on its way to a point of the march. */
struct layered_entry {
    uint32_t mesh, triangle;
    float u, v, km, cosine; /* km: |KM|, mm; the cosine at K inside */
    float beam;             /* irradiance perpendicular to the beam at M without extinction, over the light's power */
    struct pell_vec3 dir;   /* unit, from M toward K */
};

PELL_NODISCARD enum pell_result layered_refracted_make(struct layered_state *st, const struct pell_scene *scene);
void layered_refracted_destroy(struct layered_state *st);

/* The shortest of the refracted paths from `light` (distant: a direction) to x inside; the light of the other paths is added to it, reduced
 * by the extinction along their extra length. False: no light reaches x. */
bool layered_refract(const struct layered_state *st, const struct layered_medium *m, int solid, struct pell_vec3 x, bool distant,
                     struct pell_vec3 light, struct layered_entry *out, int64_t *rays);

/* --- diffuse.c: diffuse radiant exitance ---------------------------------------------------------------------------------------------- */

PELL_NODISCARD enum pell_result layered_diffuse_make(struct layered_state *st, const struct pell_frame_shape *shape);
void layered_diffuse_destroy(struct layered_state *st);
/* Writes the frame's `light`: radiant exitance. */
PELL_NODISCARD enum pell_result layered_diffuse_render(struct layered_state *st);

/* show.c: intermediate images for observers of the renderer (pell_services_observed), of the frame in st->in. */
PELL_NODISCARD enum pell_result layered_show(const struct layered_state *st);

#endif
