/* SPDX-License-Identifier: MIT
 *
 * trace.c - the samples of pixels: one path after the other, or many in SIMD lanes.
 */
#include "methods/path_trace/walk.h"

#include <string.h>

enum pell_result pt_walker_create(const struct pt_scene *scene, struct pt_walker **out)
{
    struct pt_walker *w = *out = pell_zalloc(scene->ctx, sizeof(**out));

    if (!w)
        return PELL_ERR_NOMEM;
    w->ctx = scene->ctx;
    w->branches = pell_zalloc(scene->ctx, sizeof(*w->branches));
    if (!w->branches)
        return PELL_ERR_NOMEM;
    return scene->knobs.acceleration != PT_ACCELERATION_NONE ? pt_wavefront_create(scene, &w->wavefront) : PELL_OK;
}

void pt_walker_destroy(struct pt_walker **walker)
{
    if (*walker) {
        pell_free((*walker)->ctx, (*walker)->branches);
        pt_wavefront_destroy((*walker)->ctx, &(*walker)->wavefront);
        pell_free((*walker)->ctx, *walker);
    }
    *walker = NULL;
}

const struct pt_counts *pt_walker_counts(const struct pt_walker *walker)
{
    return &walker->counts;
}

/* One path after the other. */
static void trace_one(const struct pt_scene *s, struct pt_walker *walker, const struct pt_hit *hit, struct pt_job *job)
{
    struct pt_walk walks[2];
    struct pt_sampler sampler[2];
    struct pt_light parts[2];
    struct pt_branches *branches = walker->branches;
    int count;

    memset(parts, 0, sizeof(parts));
    count = pt_begin(s, walker, job->point, hit, job->sample, walks, sampler, parts);
    for (int i = 0; i < count; i++) {
        walks[i].branches = branches;
        do {
            while (pt_step(&walks[i]))
                continue;
        } while (pt_next_branch(&walks[i]));
    }
    for (int i = 0; i < count; i++)
        pt_light_add(&job->light, &parts[i]);
}

void pt_trace_jobs(const struct pt_scene *s, struct pt_walker *walker, struct pt_job *jobs, int count)
{
    const struct pt_point *point = NULL;
    struct pt_hit hit;
    bool found = false;

    if (walker->wavefront) {
        pt_wavefront_trace(s, walker, jobs, count);
        return;
    }
    for (int i = 0; i < count; i++) {
        memset(&jobs[i].light, 0, sizeof(jobs[i].light));
        if (jobs[i].point != point)
            found = pt_find(s, &walker->counts, jobs[i].point, &hit);
        point = jobs[i].point;
        walker->counts.lost += !found;
        if (found)
            trace_one(s, walker, &hit, &jobs[i]);
    }
}

void pt_trace(const struct pt_scene *s, struct pt_walker *walker, const struct pt_point *point, uint32_t first, int count,
              struct pt_light *out)
{
    struct pt_job jobs[32];

    for (int begin = 0; begin < count; begin += (int) PELL_COUNT(jobs)) {
        const int n = count - begin < (int) PELL_COUNT(jobs) ? count - begin : (int) PELL_COUNT(jobs);
        for (int i = 0; i < n; i++)
            jobs[i] = (struct pt_job) { .point = point, .sample = first + (uint32_t) (begin + i) };
        pt_trace_jobs(s, walker, jobs, n);
        for (int i = 0; i < n; i++)
            out[begin + i] = jobs[i].light;
    }
}
