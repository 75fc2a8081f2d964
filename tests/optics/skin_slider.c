/* SPDX-License-Identifier: MIT
 * skin_slider.c - prints the colours of docs/images/skin-slider.png, which scripts/draw_skin_slider.py draws: for an epidermis of 0.1
 * and of 0.25 mm melanin (rows) by haemoglobin (columns), then published skin colours with our nearest ones. Linear Rec.709. */
#include "skin_colors.h"

#include <stdio.h>

static const double melanin[] = { 0, 0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.18, 0.25, 0.35, 0.5 };
static const double haemoglobin[] = { 0, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1 };

#define COUNT(array) ((int) (sizeof(array) / sizeof(array[0])))

static bool sheet(double epidermis_mm)
{
    for (int m = 0; m < COUNT(melanin); m++)
        for (int h = 0; h < COUNT(haemoglobin); h++) {
            struct pell_skin s = pell_skin_default();
            double rgb[3];
            s.epidermis_mm = epidermis_mm;
            s.melanin = melanin[m];
            s.haemoglobin = haemoglobin[h];
            if (pell_skin_color(&s, rgb) != PELL_OK)
                return false;
            printf("sheet %g %g %g %.6f %.6f %.6f\n", epidermis_mm, melanin[m], haemoglobin[h], rgb[0], rgb[1], rgb[2]);
        }
    return true;
}

/* The nearest colour of the grid to each published one. */
static bool nearest(double epidermis_mm)
{
    double best[PUBLISHED_SKINS], found[PUBLISHED_SKINS][3] = { { 0 } };
    int index[PUBLISHED_SKINS] = { 0 };

    for (int p = 0; p < PUBLISHED_SKINS; p++)
        best[p] = INFINITY;
    for (int i = 0; i < GRID; i++) {
        const struct pell_skin s = grid_skin(epidermis_mm, i);
        double rgb[3], lab[3];
        if (pell_skin_color(&s, rgb) != PELL_OK)
            return false;
        lab_of(rgb, lab);
        for (int p = 0; p < PUBLISHED_SKINS; p++)
            if (lab_distance(lab, published_skins[p].lab) < best[p]) {
                best[p] = lab_distance(lab, published_skins[p].lab);
                index[p] = i;
                for (int c = 0; c < 3; c++)
                    found[p][c] = rgb[c];
            }
    }
    for (int p = 0; p < PUBLISHED_SKINS; p++) {
        const struct pell_skin s = grid_skin(epidermis_mm, index[p]);
        double rgb[3];
        rgb_of(published_skins[p].lab, rgb);
        printf("published %g %.6f %.6f %.6f %.6f %.6f %.6f # %s, %s: distance %.1f at melanin %.3f, blend %.1f, haemoglobin %.3f\n",
               epidermis_mm, rgb[0], rgb[1], rgb[2], found[p][0], found[p][1], found[p][2], published_skins[p].source,
               published_skins[p].name, best[p], s.melanin, s.melanin_blend, s.haemoglobin);
    }
    return true;
}

int main(void)
{
    return sheet(0.1) && sheet(0.25) && nearest(0.1) && nearest(0.25) ? 0 : 1;
}
