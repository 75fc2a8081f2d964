/* SPDX-License-Identifier: MIT
 * connect.c - time of refractive connections from points in a bumpy ball to a point outside it, on one core: smooth and flat normals,
 * deep inside and near the surface; number of paths found per query, and of rays traced.
 *
 *     bench_connect */
#include "connect_rig.h"

#include <time.h>

enum { QUERIES = 16000, RINGS = 120, PATHS = 8 };

int main(void)
{
    for (int flat = 0; flat < 2; flat++)
        for (int near_surface = 0; near_surface < 2; near_surface++) {
            uint64_t random = 3;
            int64_t rays = 0, found = 0;
            struct pell_connection paths[PATHS];
            struct pell_vec3 where = vec3(0, 0, 1);
            struct rig r;
            double start, us;
            rig_start(&r);
            bumpy(&r, 40.0f, 1.5f, RINGS);
            rig_build(&r, flat);
            start = (double) clock();
            for (int i = 0; i < QUERIES; i++) {
                struct pell_vec3 d;
                if (i % 16 == 0) /* like the points of one pixel: close together */
                    where = vec3_normalize(in_ball(&random));
                d = vec3_normalize(vec3_mad(where, 0.03f, in_ball(&random)));
                found += pell_connect(r.connector,
                                      &(struct pell_connection_query) { 0, 1.3, vec3_mul(d, near_surface ? 38.0f : 20.0f), vec3(30, 70, 20),
                                                                        false, near_surface ? 6.0 : INFINITY },
                                      paths, PATHS, &rays);
            }
            us = 1e6 * ((double) clock() - start) / CLOCKS_PER_SEC / QUERIES;
            printf("%u triangles, %s normals, %s: %.2f us a query, %.2f paths, %.2f rays\n", r.scene->meshes[0].num_triangles,
                   flat ? "flat" : "smooth", near_surface ? "near the surface" : "deep inside", us, (double) found / QUERIES,
                   (double) rays / QUERIES);
            rig_finish(&r);
        }
    return 0;
}
