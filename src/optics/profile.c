/* SPDX-License-Identifier: MIT
 *
 * profile.c - radial profiles behind one interface: models as rows, closed forms and nodes. */
#include <pellucid/profile.h>

#include "math/vec.h"

#include <math.h>
#include <string.h>

static const struct pell_profile_model_row models[PELL_PROFILE_MODELS] = {
    [PELL_PROFILE_DIPOLE] = { "dipole", "Dipole",
                              "H. W. Jensen, S. R. Marschner, M. Levoy, P. Hanrahan, \"A Practical Model for Subsurface Light Transport\", "
                              "SIGGRAPH 2001",
                              "13 to 17 % too bright at low albedos; its shape is off near the point of entry." },
};

const struct pell_profile_model_row *pell_profile_model_row(enum pell_profile_model model)
{
    return (int) model >= 0 && model < PELL_PROFILE_MODELS && models[model].name ? &models[model] : NULL;
}

bool pell_profile_model_find(const char *name, enum pell_profile_model *out)
{
    for (int i = 0; i < PELL_PROFILE_MODELS; i++) {
        if (models[i].name && strcmp(models[i].name, name) == 0) {
            *out = (enum pell_profile_model) i;
            return true;
        }
    }
    return false;
}

enum pell_result pell_profile_make(enum pell_profile_model model, const struct pell_medium *medium, int channel,
                                   const struct pell_profile_params *params, struct pell_profile *out)
{
    const struct pell_profile_params none = { 0 };
    const struct pell_profile_params *p = params ? params : &none;

    memset(out, 0, sizeof(*out));
    if (channel < 0 || channel > 2 || !pell_medium_valid(medium, NULL))
        return PELL_ERR_INVALID;
    if (model != PELL_PROFILE_DIPOLE)
        return PELL_ERR_UNSUPPORTED;
    const struct pell_dipole d =
        pell_dipole_make(medium->sigma_a[channel], medium->sigma_s_reduced[channel], medium->eta, p->fresnel);
    out->kind = PELL_PROFILE_KIND_POLES;
    out->total = pell_dipole_total(&d);
    memcpy(out->parameter, &d, sizeof(d));
    return PELL_OK;
}

static struct pell_dipole dipole_of(const struct pell_profile *p)
{
    struct pell_dipole d;
    memcpy(&d, p->parameter, sizeof(d));
    return d;
}

double pell_profile_eval(const struct pell_profile *p, double r_mm)
{
    const struct pell_dipole d = dipole_of(p);
    return pell_dipole_rd(&d, r_mm);
}

void pell_profile_eval_many(const struct pell_profile *p, const double *r_mm, double *R, size_t count)
{
    for (size_t i = 0; i < count; i++)
        R[i] = pell_profile_eval(p, r_mm[i]);
}

double pell_profile_total(const struct pell_profile *p)
{
    return p->total;
}

double pell_profile_cdf(const struct pell_profile *p, double r_mm)
{
    const struct pell_dipole d = dipole_of(p);
    return pell_dipole_cdf(&d, r_mm);
}

double pell_profile_pdf(const struct pell_profile *p, double r_mm)
{
    return p->total > 0.0 ? pell_profile_eval(p, r_mm) / p->total : 0.0;
}
