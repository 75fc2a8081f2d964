/* SPDX-License-Identifier: MIT
 * skin_colors.h - published colours of skin, and the nearest colours of the spectral skin model; for test_skin and the figure of the
 * slider. */
#ifndef PELL_TEST_SKIN_COLORS_H
#define PELL_TEST_SKIN_COLORS_H

#include <pellucid/skin.h>

#include <math.h>

/* CIELAB (CIE 15:2004, D65) of a linear Rec.709 colour. */
static inline double lab_curve(double t)
{
    return t > 216.0 / 24389.0 ? cbrt(t) : (24389.0 / 27.0 * t + 16.0) / 116.0;
}

static inline void lab_of(const double rgb[3], double lab[3])
{
    const double x = lab_curve((0.412390799266 * rgb[0] + 0.357584339384 * rgb[1] + 0.180480788402 * rgb[2]) / 0.950455927051);
    const double y = lab_curve(0.212639005872 * rgb[0] + 0.715168678768 * rgb[1] + 0.072192315361 * rgb[2]);
    const double z = lab_curve((0.019330818716 * rgb[0] + 0.119194779795 * rgb[1] + 0.95053215225 * rgb[2]) / 1.089057750760);

    lab[0] = 116.0 * y - 16.0;
    lab[1] = 500.0 * (x - y);
    lab[2] = 200.0 * (y - z);
}

static inline double lab_inverse(double t)
{
    return t > 6.0 / 29.0 ? t * t * t : (116.0 * t - 16.0) * 27.0 / 24389.0;
}

static inline void rgb_of(const double lab[3], double rgb[3])
{
    const double fy = (lab[0] + 16.0) / 116.0, X = 0.950455927051 * lab_inverse(fy + lab[1] / 500.0), Y = lab_inverse(fy);
    const double Z = 1.089057750760 * lab_inverse(fy - lab[2] / 200.0);

    rgb[0] = 3.240969941905 * X - 1.53738317757 * Y - 0.498610760293 * Z;
    rgb[1] = -0.969243636281 * X + 1.875967501508 * Y + 0.041555057407 * Z;
    rgb[2] = 0.055630079697 * X - 0.203976958889 * Y + 1.056971514243 * Z;
}

/* Euclidean distance in CIELAB (CIE 1976). */
static inline double lab_distance(const double a[3], const double b[3])
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

/* Individual typology angle, degrees: the scale of constitutive skin colour of Chardon et al. 1991 (very light > 55 > light > 41 >
 * intermediate > 28 > tan > 10 > brown > -30 > dark), which follows the types of Fitzpatrick. */
static inline double typology_angle(const double lab[3])
{
    return atan2(lab[0] - 50.0, lab[2]) * (180.0 / 3.14159265358979323846);
}

enum { PUBLISHED_SKINS = 9 };

struct published_skin {
    const char *name, *source;
    double lab[3];
    double distance_paper,
        distance_thin; /* distance of our nearest colour with an epidermis of 0.25 and 0.1 mm: measured, as upper bounds */
};

/* ColorChecker: sRGB 194 150 130 and 115 82 68. Jensen: the linear diffuse reflectances of skin1 and skin2, whose channels are a
 * camera's. Clusters: centroids of the facial skin of 120 people, 45/0 geometry, "Proposed shade guide for human facial skin", IADR
 * abstract 120461, 2009. */
static const struct published_skin published_skins[PUBLISHED_SKINS] = {
    { "light skin", "ColorChecker", { 65.67, 13.68, 16.90 }, 9.0, 5.0 }, { "dark skin", "ColorChecker", { 38.02, 11.80, 13.66 }, 6.5, 2.5 },
    { "skin1", "Jensen et al. 2001", { 58.09, 14.9, 22.5 }, 11.0, 3.5 }, { "skin2", "Jensen et al. 2001", { 74.43, 8.1, 14.1 }, 7.0, 6.0 },
    { "cluster 1", "IADR 2009", { 52.5, 17.0, 18.9 }, 11.0, 3.0 },       { "cluster 2", "IADR 2009", { 37.7, 17.2, 14.7 }, 12.0, 3.5 },
    { "cluster 3", "IADR 2009", { 49.4, 22.0, 12.3 }, 15.5, 5.0 },       { "cluster 4", "IADR 2009", { 41.5, 25.5, 13.3 }, 20.0, 9.5 },
    { "cluster 5", "IADR 2009", { 26.7, 14.6, 14.7 }, 12.0, 5.5 },
};

/* The colours of a grid over melanin (0.001 to 0.6, geometric), melanin blend and haemoglobin (0; 0.002 to 0.2, geometric). */
enum { GRID_MELANIN = 24, GRID_BLEND = 6, GRID_BLOOD = 14, GRID = GRID_MELANIN * GRID_BLEND * GRID_BLOOD };

static inline struct pell_skin grid_skin(double epidermis_mm, int i)
{
    struct pell_skin s = pell_skin_default();
    const int blood = i % GRID_BLOOD;

    s.epidermis_mm = epidermis_mm;
    s.melanin = 0.001 * pow(600.0, i / (GRID_BLEND * GRID_BLOOD) / (GRID_MELANIN - 1.0));
    s.melanin_blend = i / GRID_BLOOD % GRID_BLEND / (GRID_BLEND - 1.0);
    s.haemoglobin = blood ? 0.002 * pow(100.0, (blood - 1) / (GRID_BLOOD - 2.0)) : 0.0;
    return s;
}

#endif
