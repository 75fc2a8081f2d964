/* SPDX-License-Identifier: MIT
 * radii.c - see dipole.h. */
#include "methods/dipole/dipole.h"

#include "math/vec.h"

#include <string.h>

#define INSIDE 0.9999 /* fraction of a channel's light inside the largest radius */

void dipole_radii_make(const struct pell_frame_material *m, struct dipole_radii *r)
{
    memset(r, 0, sizeof(*r));
    for (int c = 0; c < 3; c++) {
        if (!(pell_profile_total(&m->profile[c]) > 0.0))
            continue;
        for (int k = 1; k <= DI_RINGS; k++) {
            const double radius = pell_profile_sample(&m->profile[c], INSIDE * k / DI_RINGS);
            /* Rings have an area, even where a table's light is concentrated at one radius. */
            r->square[c][k] = fmax(radius * radius, r->square[c][k - 1] * (1.0 + 1e-9) + 1e-24);
        }
        r->lit[c] = true;
        r->channels++;
        r->largest = fmax(r->largest, sqrt(r->square[c][DI_RINGS]));
    }
}

double dipole_radii_draw(const struct dipole_radii *r, int channel, double xi)
{
    const double *s = r->square[channel], x = xi * DI_RINGS;
    const int k = x < DI_RINGS - 1 ? (int) x : DI_RINGS - 1;

    return sqrt(s[k] + (x - k) * (s[k + 1] - s[k]));
}

double dipole_radii_density(const struct dipole_radii *r, int channel, double square)
{
    const double *s = r->square[channel];
    int low = 0, high = DI_RINGS;

    if (!r->lit[channel] || square >= s[DI_RINGS])
        return 0.0;
    while (high - low > 1) {
        const int mid = (low + high) / 2;
        if (s[mid] <= square)
            low = mid;
        else
            high = mid;
    }
    return 1.0 / (DI_RINGS * PELL_PI * (s[low + 1] - s[low]));
}
