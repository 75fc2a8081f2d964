/* SPDX-License-Identifier: MIT
 * path_trace_rig.h - for tests of path-trace's transport: scenes as in stage.h, and samples of single points, without images. */
#ifndef PELL_PATH_TRACE_RIG_H
#define PELL_PATH_TRACE_RIG_H

#include "stage.h"

#include "methods/path_trace/trace.h"
#include "render/renderer.h"

#include <time.h>

static inline struct pt_knobs rig_knobs(void)
{
    return (struct pt_knobs) { .normals = PT_NORMALS_SMOOTH,
                               .boundary = PT_BOUNDARY_SMOOTH,
                               .acceleration = PT_ACCELERATION_NONE,
                               .events = 100000,
                               .bounces = PT_BOUNCES_ALL,
                               .roulette = 0.1f,
                               .techniques = PT_ALL };
}

/* A custom medium: unreduced coefficients, 1/mm. */
static inline size_t rig_medium(struct stage *s, double sigma_s, double sigma_a, double g, double eta)
{
    size_t index;
    struct pell_material *m = stage_medium(s, "marble", &index);

    for (int c = 0; c < 3; c++) {
        m->medium.sigma_s_reduced[c] = sigma_s * (1.0 - g);
        m->medium.sigma_a[c] = sigma_a;
        m->medium.g[c] = g;
    }
    m->medium.eta = eta;
    return index;
}

static inline void rig_start(struct stage *s, int size)
{
    stage_start_threads(s, size, size, 1);
}

static inline struct pt_scene *rig_scene(struct stage *s, const struct pt_knobs *knobs)
{
    struct pt_scene *scene;

    stage_method(s, NULL, NULL);
    stage_render(s);
    OK(pt_scene_create(pell_renderer_services(s->r), knobs, &scene));
    return scene;
}

static inline struct pt_point rig_point(struct pell_vec3 at, struct pell_vec3 camera, uint32_t pixel)
{
    const struct pell_vec3 to = vec3_sub(camera, at);

    return (struct pt_point) { .at = at, .toward = vec3_normalize(to), .depth = vec3_length(to), .material = 1, .pixel = pixel };
}

/* Mean over samples of a component, its standard error, and the relative variance of a sample. */
struct rig_mean {
    double mean[4][3], error[4][3], variance[4][3]; /* [multiple, single, surface, sum] */
    struct pt_counts counts;
    double seconds; /* of processor time */
};

static inline struct rig_mean rig_measure(const struct pt_scene *scene, const struct pt_point *point, uint32_t first, int samples)
{
    struct rig_mean m = { 0 };
    struct pt_walker *w;
    double square[4][3] = { { 0 } };
    const clock_t start = clock();

    OK(pt_walker_create(scene, &w));
    for (int i = 0; i < samples; i++) {
        struct pt_light l;
        pt_trace(scene, w, point, first + (uint32_t) i, 1, &l);
        for (int c = 0; c < 3; c++) {
            const double v[4] = { l.multiple[c], l.single[c], l.surface[c], l.multiple[c] + l.single[c] + l.surface[c] };
            for (int k = 0; k < 4; k++) {
                if (!(v[k] >= 0.0 && v[k] < 1e300))
                    fail_msg("sample %d is %g", i, v[k]);
                m.mean[k][c] += v[k];
                square[k][c] += v[k] * v[k];
            }
        }
    }
    m.seconds = (double) (clock() - start) / CLOCKS_PER_SEC;
    for (int k = 0; k < 4; k++)
        for (int c = 0; c < 3; c++) {
            const double mean = m.mean[k][c] / samples, v = fmax(square[k][c] / samples - mean * mean, 0.0);
            m.mean[k][c] = mean;
            m.error[k][c] = sqrt(v / fmax(samples - 1.0, 1.0));
            m.variance[k][c] = mean > 0.0 ? v / (mean * mean) : 0.0;
        }
    m.counts = *pt_walker_counts(w);
    pt_walker_destroy(&w);
    return m;
}

#endif
