/* SPDX-License-Identifier: MIT
 *
 * skin.c - the spectral two-layer skin. Formulas and constants: C. Donner, H. W. Jensen, "A Spectral BSSRDF for Shading Human Skin", EGSR
 * 2006, sections 4.1 and 4.2, which takes the absorption of melanin and bloodless skin from S. L. Jacques, Skin Optics, 1998. */
#include <pellucid/layers.h>
#include <pellucid/skin.h>

#include "optics/medium/range.h"
#include "optics/medium/spectra.h"

#include <math.h>
#include <string.h>

/* Blood: 150 g/l of haemoglobin at 64500 g/mol; ln 10, as the table is decadic; 10 mm in a cm. */
#define BLOOD_PER_MM (2.302585092994045684 * 150.0 / 64500.0 / 10.0)

struct pell_skin pell_skin_default(void)
{
    return (struct pell_skin) {
        .melanin = 0.025,
        .melanin_blend = 0.2,
        .haemoglobin = 0.012,
        .oxygenation = 0.75,
        .epidermis_mm = 0.1,
        .eta = 1.4,
    };
}

bool pell_skin_valid(const struct pell_skin *skin, struct pell_medium_fault *fault)
{
    const struct pell_medium_fault fields[] = {
        { "melanin", skin->melanin, 0.0, 1.0 },
        { "melanin_blend", skin->melanin_blend, 0.0, 1.0 },
        { "haemoglobin", skin->haemoglobin, 0.0, 1.0 },
        { "oxygenation", skin->oxygenation, 0.0, 1.0 },
        { "epidermis_mm", skin->epidermis_mm, 0.01, 1.0 },
        { "eta", skin->eta, 1.0, 2.0 },
    };

    if (fault)
        *fault = (struct pell_medium_fault) { 0 };
    for (size_t i = 0; i < sizeof(fields) / sizeof(fields[0]); i++)
        if (!pell_in_range(fields[i].field, fields[i].value, fields[i].min, fields[i].max, fault))
            return false;
    return true;
}

/* Decadic molar extinction of a kind of haemoglobin, linear between the rows of the table. */
static double extinction(double nm, int kind)
{
    const double x = (nm - PELL_WAVELENGTH_MIN) / PELL_HAEMOGLOBIN_STEP;
    const int i = x >= PELL_HAEMOGLOBIN_ROWS - 1 ? PELL_HAEMOGLOBIN_ROWS - 2 : (int) x;
    const double t = x - i;

    return (1.0 - t) * pell_haemoglobin[i][kind] + t * pell_haemoglobin[i + 1][kind];
}

static void coefficients(const struct pell_skin *s, double nm, struct pell_skin_coefficients *epidermis,
                         struct pell_skin_coefficients *dermis)
{
    const double eumelanin = 6.6e10 * pow(nm, -3.33), pheomelanin = 2.9e14 * pow(nm, -4.75);
    const double baseline = 0.0244 + 8.53 * exp(-(nm - 154.0) / 66.2);
    const double oxy = BLOOD_PER_MM * extinction(nm, 0), deoxy = BLOOD_PER_MM * extinction(nm, 1);
    const double melanin = s->melanin_blend * eumelanin + (1.0 - s->melanin_blend) * pheomelanin;
    const double blood = s->oxygenation * oxy + (1.0 - s->oxygenation) * deoxy;

    epidermis->sigma_a = s->melanin * melanin + (1.0 - s->melanin) * baseline;
    epidermis->sigma_s_reduced = 14.74 * pow(nm, -0.22) + 2.2e11 * pow(nm, -4.0);
    dermis->sigma_a = s->haemoglobin * blood + (1.0 - s->haemoglobin) * baseline;
    dermis->sigma_s_reduced = 0.5 * epidermis->sigma_s_reduced;
}

enum pell_result pell_skin_at(const struct pell_skin *skin, double nm, struct pell_skin_coefficients *epidermis,
                              struct pell_skin_coefficients *dermis)
{
    if (!skin || !epidermis || !dermis)
        return PELL_ERR_INVALID;

    if (!pell_skin_valid(skin, NULL) || !(nm >= PELL_WAVELENGTH_MIN && nm <= PELL_WAVELENGTH_MAX))
        return PELL_ERR_INVALID;
    coefficients(skin, nm, epidermis, dermis);
    return PELL_OK;
}

enum pell_result pell_skin_reflectance(const struct pell_skin *skin, double reflectance[PELL_WAVELENGTHS])
{
    if (!skin || !reflectance)
        return PELL_ERR_INVALID;

    struct pell_stack stack = { .count = 2 };
    double out[PELL_STACK_PARTS];

    if (!pell_skin_valid(skin, NULL))
        return PELL_ERR_INVALID;
    stack.layer[0].eta = stack.layer[1].eta = skin->eta;
    stack.layer[0].thickness = skin->epidermis_mm;
    stack.layer[1].thickness = INFINITY;
    for (int i = 0; i < PELL_WAVELENGTHS; i++) {
        struct pell_skin_coefficients k[2];
        coefficients(skin, PELL_WAVELENGTH_MIN + PELL_WAVELENGTH_STEP * i, &k[0], &k[1]);
        for (int l = 0; l < 2; l++)
            for (int c = 0; c < 3; c++) {
                stack.layer[l].sigma_a[c] = k[l].sigma_a;
                stack.layer[l].sigma_s_reduced[c] = k[l].sigma_s_reduced;
            }
        if (pell_stack_totals(&stack, 0, out, NULL) != PELL_OK)
            return PELL_ERR_INVALID;
        reflectance[i] = out[PELL_STACK_R_PLUS];
    }
    return PELL_OK;
}

enum pell_result pell_skin_color(const struct pell_skin *skin, double rgb[3])
{
    if (!skin || !rgb)
        return PELL_ERR_INVALID;

    double reflectance[PELL_WAVELENGTHS];

    if (pell_skin_reflectance(skin, reflectance) != PELL_OK)
        return PELL_ERR_INVALID;
    pell_spectrum_to_rgb(reflectance, rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] = fmax(rgb[c], 0.0);
    return PELL_OK;
}

/* Scales a channel's absorption in all layers such that the stack reflects `total`, which falls as absorption grows. */
static enum pell_result match(struct pell_stack *stack, int channel, double total)
{
    const struct pell_stack original = *stack;
    double low = -10.0, high = 10.0; /* logarithm of the factor */

    for (int i = 0; i < 50; i++) {
        const double middle = 0.5 * (low + high), factor = exp(middle);
        double out[PELL_STACK_PARTS];
        for (int l = 0; l < stack->count; l++)
            stack->layer[l].sigma_a[channel] = factor * original.layer[l].sigma_a[channel];
        const enum pell_result res = pell_stack_totals(stack, channel, out, NULL);
        if (res != PELL_OK)
            return res;
        if (out[PELL_STACK_R_PLUS] > total)
            low = middle;
        else
            high = middle;
    }
    return PELL_OK;
}

enum pell_result pell_skin_layers(const struct pell_skin *skin, struct pell_material_layers *out)
{
    if (!skin || !out)
        return PELL_ERR_INVALID;

    static const char names[2][10] = { "epidermis", "dermis" };
    double weight[PELL_WAVELENGTHS][3], sum[3] = { 0 }, color[3];
    struct pell_stack stack = { .count = 2 };

    if (!pell_skin_valid(skin, NULL) || pell_skin_color(skin, color) != PELL_OK)
        return PELL_ERR_INVALID;
    pell_spectrum_weights(weight);
    for (int i = 0; i < PELL_WAVELENGTHS; i++) {
        struct pell_skin_coefficients k[2];
        coefficients(skin, PELL_WAVELENGTH_MIN + PELL_WAVELENGTH_STEP * i, &k[0], &k[1]);
        for (int c = 0; c < 3; c++) {
            const double w = fmax(weight[i][c], 0.0);
            sum[c] += w;
            for (int l = 0; l < 2; l++) {
                stack.layer[l].sigma_a[c] += w * k[l].sigma_a;
                stack.layer[l].sigma_s_reduced[c] += w * k[l].sigma_s_reduced;
            }
        }
    }
    for (int l = 0; l < 2; l++) {
        stack.layer[l].eta = skin->eta;
        stack.layer[l].thickness = l == 0 ? skin->epidermis_mm : INFINITY;
        for (int c = 0; c < 3; c++) {
            stack.layer[l].sigma_a[c] /= sum[c];
            stack.layer[l].sigma_s_reduced[c] /= sum[c];
        }
    }
    for (int c = 0; c < 3; c++)
        if (match(&stack, c, color[c]) != PELL_OK)
            return PELL_ERR_INVALID;
    memset(out, 0, sizeof(*out));
    out->count = 2;
    for (int l = 0; l < 2; l++) {
        struct pell_material_layer *to = &out->item[l];
        memcpy(to->name, names[l], sizeof(names[l]));
        to->thickness_mm = stack.layer[l].thickness;
        to->medium.eta = skin->eta;
        memcpy(to->medium.sigma_a, stack.layer[l].sigma_a, sizeof(to->medium.sigma_a));
        memcpy(to->medium.sigma_s_reduced, stack.layer[l].sigma_s_reduced, sizeof(to->medium.sigma_s_reduced));
    }
    return PELL_OK;
}
