/* SPDX-License-Identifier: MIT
 *
 * dipole.h - declarations shared by the files of this method. Its only external symbol is pell_method_dipole.
 */
#ifndef PELL_DIPOLE_METHOD_H
#define PELL_DIPOLE_METHOD_H

#include <pellucid/method.h>

enum dipole_as { DI_BEST, DI_PAPER };
enum dipole_sampling { DI_BOTH, DI_PROBES, DI_AREA };

struct dipole_knobs {
    int as; /* enum dipole_as */
    float error;
    int most;
    int sampling; /* enum dipole_sampling */
    bool strength;
    int half; /* enum reference_half */
};

/* --- radii.c: radii distributed like a profile's light --------------------------------------------------------------------------- */

#define DI_RINGS 256

/* Rings with equal fractions of the light inside `largest`; a radius is uniform over the area of its ring, so that the density is known
 * exactly and costs one search. Channels without light have no rings. */
struct dipole_radii {
    double square[3][DI_RINGS + 1]; /* mm^2 */
    bool lit[3];
    double largest; /* mm, of all channels */
    int channels;   /* that have light */
};

void dipole_radii_make(const struct pell_frame_material *m, struct dipole_radii *r);
/* Samples a radius by xi in [0, 1), mm. */
double dipole_radii_draw(const struct dipole_radii *r, int channel, double xi);
/* Its density per area of the plane, 1/mm^2. */
double dipole_radii_density(const struct dipole_radii *r, int channel, double square);

extern const struct pell_method_engine pell_dipole_cpu;

#endif
