/* SPDX-License-Identifier: MIT
 * kernel.c - kernels for an engine's convolution: layered skin as a sum of Gaussians, that sum as a chain of blurs, a separable kernel,
 * a table of rings, and sampling radii. No scene, no files.
 *
 *     kernel [MELANIN] */
#include <pellucid/optics.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { TAPS = 17, TEXELS = 16, SAMPLES = 8 };

static int fail(const char *what)
{
    fprintf(stderr, "%s\n", what);
    return 1;
}

static int print_chain(const struct pell_gaussians *skin)
{
    struct pell_kernel_chain chain;

    if (pell_kernel_chain_make(skin, &chain) != PELL_OK)
        return fail("no chain of blurs");
    printf("blur after blur: standard deviation mm, share of the new result R G B\n");
    for (int i = 0; i < chain.count; i++)
        printf("%10.5f  %.4f %.4f %.4f\n", sqrt(chain.step_mm2[i]), chain.blend[i][0], chain.blend[i][1], chain.blend[i][2]);
    printf("total %.4f %.4f %.4f\n\n", chain.total[0], chain.total[1], chain.total[2]);
    return 0;
}

static int print_separable(const struct pell_profile profiles[3])
{
    static struct pell_separable s;

    if (pell_separable_make(profiles, &(struct pell_separable_params) { .taps = TAPS }, &s) != PELL_OK)
        return fail("no separable kernel");
    printf("separable, %d taps: offset mm, weight R G B\n", s.taps);
    for (int i = 0; i < s.taps; i++)
        printf("%10.5f  %.5f %.5f %.5f\n", s.offset_mm[i], s.weight[0][i][0], s.weight[0][i][1], s.weight[0][i][2]);
    printf("\n");
    return 0;
}

static int print_table(const struct pell_profile *profile)
{
    const double r_max = pell_profile_sample(profile, 0.99);
    float ring[TEXELS];
    double sum = 0.0;

    if (pell_kernel_table_ring(profile, r_max, ring, TEXELS) != PELL_OK)
        return fail("no table");
    printf("red light in %d rings out to %.3f mm:", TEXELS, r_max);
    for (int i = 0; i < TEXELS; i++) {
        printf(" %.4f", ring[i]);
        sum += ring[i];
    }
    printf("\nrings hold %.4f of %.4f\n\n", sum, pell_profile_total(profile));
    return 0;
}

int main(int argc, char **argv)
{
    static struct pell_profile profiles[3];
    struct pell_skin skin = pell_skin_default();
    struct pell_material_layers layers;
    struct pell_gaussians sum;
    struct pell_medium_fault fault;

    if (argc > 1)
        skin.melanin = strtod(argv[1], NULL);
    if (!pell_skin_valid(&skin, &fault)) {
        fprintf(stderr, "%s is %g, allowed: [%g, %g]\n", fault.field, fault.value, fault.min, fault.max);
        return 2;
    }
    if (pell_skin_layers(&skin, &layers) != PELL_OK || pell_material_solve(&layers, &sum, NULL) != PELL_OK)
        return fail("these layers have no answer");
    for (int c = 0; c < 3; c++)
        if (pell_profile_from_gaussians(&sum, c, &profiles[c]) != PELL_OK)
            return fail("no profile");
    if (print_chain(&sum) || print_separable(profiles) || print_table(&profiles[0]))
        return 1;
    printf("radii of equal light, red:");
    for (int i = 0; i < SAMPLES; i++)
        printf(" %.4f", pell_profile_sample(&profiles[0], (i + 0.5) / SAMPLES));
    printf("\n");
    return 0;
}
