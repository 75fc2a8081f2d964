/* SPDX-License-Identifier: MIT
 *
 * update.c - updates the atlas after vertices have moved: triangles, charts, texels and border sources stay; lengths, skew and tilt of
 * texels are recomputed from the new positions.
 */
#include "methods/texture_space/atlas/internal.h"

#include "base/hash.h"
#include "base/pool.h"

uint64_t ts_atlas_hash(const struct pell_scene *scene, const struct pell_solids *solids, size_t solid)
{
    uint64_t hash = 0;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (solids->of_mesh[i] != (int32_t) solid)
            continue;
        hash = pell_hash_word(hash, i);
        hash = pell_hash_bytes(hash, m->index, 3 * sizeof(*m->index) * (size_t) m->num_triangles);
        hash = pell_hash_word(hash, m->num_vertices);
        for (int set = 0; set < PELL_UV_SETS; set++)
            if (m->uv[set])
                hash = pell_hash_bytes(hash, m->uv[set], 2 * sizeof(*m->uv[set]) * (size_t) m->num_vertices);
    }
    return hash;
}

uint64_t ts_atlas_positions(const struct ts_atlas *a)
{
    uint64_t hash = 0;

    for (uint32_t t = 0; t < a->num_triangles; t++) { /* triangles of a mesh are consecutive */
        const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
        if (t == 0 || a->triangles[t].mesh != a->triangles[t - 1].mesh)
            hash = pell_hash_bytes(hash, m->position, 3 * sizeof(*m->position) * (size_t) m->num_vertices);
    }
    return hash;
}

enum { TRIANGLES = 512 /* triangles per task */ };

static void measure_triangles(void *arg, int index, int worker)
{
    struct ts_atlas *a = arg;
    const uint32_t from = (uint32_t) index * TRIANGLES, to = from + TRIANGLES < a->num_triangles ? from + TRIANGLES : a->num_triangles;

    (void) worker;
    for (uint32_t t = from; t < to; t++) {
        struct ts_flat f;
        a->metric[t] = (struct ts_metric) { .length = { (float) a->mm_per_texel, (float) a->mm_per_texel } };
        if (a->chart[t] && flatten(a->corners[t], &f))
            a->metric[t] = ts_atlas_metric_of(a, t, &f);
    }
}

static void measure_rows(void *arg, int band, int worker)
{
    struct ts_atlas *a = arg;

    (void) worker;
    for (int y = band * BAND; y < (band + 1) * BAND && y < a->height; y++) {
        for (size_t i = a->first_orientation[y]; i < a->first_orientation[y + 1]; i++) {
            const struct ts_orientation *orientation = &a->orientations[i];
            const double u[2] = { (double) orientation->u[0], (double) orientation->u[1] },
                         v[2] = { (double) orientation->v[0], (double) orientation->v[1] };
            const struct ts_metric m = ts_atlas_metric_along(a, orientation->triangle, u, v);
            ts_atlas_set_metric(a, orientation->at, &m);
        }
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int b = a->runs[r].from; b < a->runs[r].to; b++) {
                const ptrdiff_t first = y * a->stride + b * TS_BLOCK;
                for (ptrdiff_t at = first; at < first + TS_BLOCK; at++)
                    if (a->source[at] != NONE)
                        ts_atlas_set_metric(a, at, &a->metric[a->source[at]]);
                ts_atlas_measure_cell(a, first, &a->cells[(ptrdiff_t) y * a->blocks + b]);
            }
    }
}

/* Curvature of lines from the change of lengths across them: for lines x = const the derivative of ly along x, over ly. */
static float change_of(const struct ts_atlas *a, const float *length, ptrdiff_t at, ptrdiff_t pitch, int steps, int low, int high)
{
    int back = steps < low ? steps : low, ahead = steps < high ? steps : high;

    while (back > 0 && a->key[at - back * pitch] != a->key[at])
        back /= 2;
    while (ahead > 0 && a->key[at + ahead * pitch] != a->key[at])
        ahead /= 2;
    return back + ahead > 0 ? (length[at + ahead * pitch] - length[at - back * pitch]) / ((float) (back + ahead) * length[at]) : 0.0f;
}

static void tilt_rows(void *arg, int band, int worker)
{
    struct ts_atlas *a = arg;
    const int steps = a->border > 2 * TAPS_SIGMAS ? a->border / TAPS_SIGMAS : 2;
    const float most = MAX_TILT / (float) steps;

    (void) worker;
    for (int y = band * BAND; y < (band + 1) * BAND && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int x = a->runs[r].from * TS_BLOCK; x < a->runs[r].to * TS_BLOCK; x++) {
                const ptrdiff_t at = y * a->stride + x;
                if (a->source[at] == NONE)
                    continue;
                a->tilt[0][at] = clamp_tilt(0.5f * change_of(a, a->length[1], at, 1, steps, x, a->width - 1 - x), most);
                a->tilt[1][at] = clamp_tilt(0.5f * change_of(a, a->length[0], at, a->stride, steps, y, a->height - 1 - y), most);
            }
}

void ts_atlas_tilt_by_lengths(struct ts_atlas *a, struct pell_pool *pool)
{
    pell_pool_run(pool, (a->height + BAND - 1) / BAND, tilt_rows, a);
}

bool ts_atlas_update(struct ts_atlas *a, struct pell_pool *pool, const struct pell_scene *scene)
{
    const struct pell_scene *before = a->scene;
    double area = 0.0;
    uint64_t positions;

    a->scene = scene;
    positions = ts_atlas_positions(a);
    if (positions == a->positions) /* as when only the camera moves */
        return true;
    for (uint32_t t = 0; t < a->num_triangles; t++) {
        const double own = area_of(a, t);
        if (a->buried > 0 || (own > 0.0) != (a->chart[t] != 0)) {
            a->scene = before;
            return false;
        }
        area += own;
    }
    a->positions = positions;
    a->mm_per_texel = a->inner > 0 ? sqrt(area / (double) a->inner) : 1.0;
    pell_pool_run(pool, (int) ((a->num_triangles + TRIANGLES - 1) / TRIANGLES), measure_triangles, a);
    pell_pool_run(pool, (a->height + BAND - 1) / BAND, measure_rows, a);
    ts_atlas_tilt_by_lengths(a, pool);
    return true;
}
