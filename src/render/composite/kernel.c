/* SPDX-License-Identifier: MIT
 * kernel.c - see kernel.h; compiled once per SIMD level. */
#include "render/composite/kernel.h"

#include "shared/boundary.h"
#include "shared/tone.h"

#include <string.h>

#define INLINE static inline __attribute__((always_inline))

/* The materials of a block's lanes; a `full` block has one material in all lanes, which is the common case. */
struct block_materials {
    const struct pell_composite_material *one;         /* of all lanes if `full` */
    const struct pell_composite_material *lane[LANES]; /* else */
};

#define OF(field) (full ? m->one->field : m->lane[i]->field)

/* base^e for e in [0, 1]; the general power only if a material needs it. */
INLINE void power(const struct pell_composite_row *row, const float *restrict base, const float *restrict e, bool full, float *restrict out)
{
    if (!row->any_texture || (full && e[0] <= 0.0f)) {
        for (int i = 0; i < LANES; i++)
            out[i] = 1.0f;
        return;
    }
    for (int i = 0; i < LANES; i++) {
        const float b = base[i] > 0.0f ? base[i] : 0.0f, root = sqrtf(b);
        out[i] = e[i] <= 0.0f ? 1.0f : e[i] >= 1.0f ? b : root;
    }
    for (int i = 0; row->any_power && i < LANES; i++)
        if (e[i] > 0.0f && e[i] < 1.0f && e[i] != 0.5f)
            out[i] = base[i] > 0.0f ? powf(base[i], e[i]) : 0.0f;
}

/* mu = n . w_o per lane. */
INLINE void view_cosines(const struct pell_composite_row *row, int x, size_t at, float *restrict mu)
{
    const struct pell_view v = *row->p->view;
    const struct pell_surface *s = row->p->surface;
    const float inverse = v.orthographic ? 0.0f : 1.0f / v.focal_px;
    const float left = 0.5f + v.shift_x - 0.5f * (float) v.width + (float) x;
    const float py = (0.5f * (float) v.height - (float) row->y - 0.5f - v.shift_y) * inverse;
    const struct pell_vec3 start = vec3_mad(v.forward, py, v.up);
    const float *restrict nx = s->ns[0] + at, *restrict ny = s->ns[1] + at, *restrict nz = s->ns[2] + at;

    for (int i = 0; i < LANES; i++) {
        const float px = ((float) i + left) * inverse;
        const float dx = start.x + px * v.right.x, dy = start.y + px * v.right.y, dz = start.z + px * v.right.z;
        const float c = -(nx[i] * dx + ny[i] * dy + nz[i] * dz) / sqrtf(dx * dx + dy * dy + dz * dz);
        mu[i] = c > 0.0f ? c < 1.0f ? c : 1.0f : 0.0f;
    }
}

/* Tables of one roughness and one F0, over mu: most surfaces have no roughness map. */
static void make_cut(const struct pell_composite_row *row, const struct pell_composite_material *m, float roughness,
                     struct pell_composite_cut *restrict cut)
{
    int j;
    float g;
    pell_roughness_position(roughness, &j, &g);
    const float *restrict t = row->albedo + 2 * (m->model * PELL_ALBEDO_MU * PELL_ALBEDO_ROUGHNESS + j);
    const float *n = row->mean + 2 * (m->model * PELL_ALBEDO_ROUGHNESS + j);

    cut->material = m;
    cut->roughness = roughness;
    for (int k = 0; k < PELL_ALBEDO_MU; k++, t += 2 * PELL_ALBEDO_ROUGHNESS)
        cut->albedo[k] = m->f0 * (t[0] + g * (t[2] - t[0])) + t[1] + g * (t[3] - t[1]);
    cut->mean = m->f0 * (n[0] + g * (n[2] - n[0])) + n[1] + g * (n[3] - n[1]);
}

/* Directional albedo at mu, albedo[0], and its mean, albedo[1], per lane. */
INLINE void albedos(const struct pell_composite_row *row, const struct block_materials *m, const float *restrict mu,
                    const float *restrict roughness, bool full, bool uniform, struct pell_composite_cut *restrict cut,
                    float (*restrict albedo)[LANES])
{
    float fx[LANES], low[LANES], high[LANES];
    int cell[LANES], differ = 0;

    for (int i = 0; i < LANES; i++) {
        const float x = pell_cosine_coord(mu[i], PELL_ALBEDO_MU);
        cell[i] = pell_table_cell(x, PELL_ALBEDO_MU);
        fx[i] = x - (float) cell[i];
    }
    for (int i = 0; !uniform && i < LANES; i++)
        differ |= roughness[i] != roughness[0];
    if (full && !differ) {
        const float same = uniform ? m->one->roughness : roughness[0];
        if (cut->material != m->one || cut->roughness != same)
            make_cut(row, m->one, same, cut);
        for (int i = 0; i < LANES; i++) {
            low[i] = cut->albedo[cell[i]];
            high[i] = cut->albedo[cell[i] + 1];
        }
        for (int i = 0; i < LANES; i++) {
            albedo[0][i] = pell_lerp(low[i], high[i], fx[i]);
            albedo[1][i] = cut->mean;
        }
        return;
    }
    for (int i = 0; i < LANES; i++) {
        const int model = OF(model);
        int j;
        float g;
        pell_roughness_position(roughness[i], &j, &g);
        const float *t = row->albedo + 2 * ((model * PELL_ALBEDO_MU + cell[i]) * PELL_ALBEDO_ROUGHNESS + j);
        const float *r = t + 2 * PELL_ALBEDO_ROUGHNESS;
        const float *n = row->mean + 2 * (model * PELL_ALBEDO_ROUGHNESS + j), f0 = OF(f0);
        const float near = f0 * (t[0] + g * (t[2] - t[0])) + t[1] + g * (t[3] - t[1]);
        const float beyond = f0 * (r[0] + g * (r[2] - r[0])) + r[1] + g * (r[3] - r[1]);
        albedo[0][i] = pell_lerp(near, beyond, fx[i]);
        albedo[1][i] = f0 * (n[0] + g * (n[2] - n[0])) + n[1] + g * (n[3] - n[1]);
    }
}

/* Factor from radiant exitance to radiance toward the camera: T / (pi n). */
INLINE void exit_factors(const struct pell_composite_row *row, const struct block_materials *m, const float *restrict mu, size_t at,
                         bool full, bool uniform, struct pell_composite_cut *restrict cut, float *restrict factor)
{
    const struct pell_surface *s = row->p->surface;
    const bool published = row->p->published;
    const float *restrict r = s->specular[0] + at, *restrict g = s->specular[1] + at, *restrict b = s->specular[2] + at;
    const float normalized = published ? 0.0f : 1.0f;
    const float *restrict rough = s->roughness + at;
    float albedo[2][LANES], rho_s[LANES], roughness[LANES];

    /* Planes are undefined where a material is uniform: their values are read, but not used. */
    for (int i = 0; !uniform && i < LANES; i++)
        roughness[i] = OF(uniform) ? OF(roughness) : rough[i];
    albedos(row, m, mu, roughness, full, uniform, cut, albedo);
    for (int i = 0; i < LANES; i++)
        rho_s[i] = uniform ? m->one->rho_s : !full && OF(uniform) ? OF(rho_s) : (r[i] + g[i] + b[i]) * (1.0f / 3.0f);
    for (int i = 0; i < LANES; i++)
        factor[i] = pell_exit_factor(rho_s[i], albedo[0][i], albedo[1][i], normalized);
    for (int i = 0; row->any_smooth && i < LANES; i++)
        if (OF(smooth))
            factor[i] = pell_smooth_exit_factor(pell_boundary_lookup(OF(boundary), mu[i]), published ? 1.0f : OF(boundary_mean));
}

/* Composites a block; `on` is 1 where a lane is covered. */
INLINE void shade_block(const struct pell_composite_row *row, int x, const struct block_materials *m, const float *restrict on, bool full,
                        bool uniform, struct pell_composite_cut *restrict cut, struct pell_composite_lanes *restrict result)
{
    static const float luminance[3] = { PELL_LUMINANCE_R, PELL_LUMINANCE_G, PELL_LUMINANCE_B };
    const struct pell_composite_params *p = row->p;
    const size_t at = (size_t) ((ptrdiff_t) row->y * p->surface->stride + x);
    const float *restrict metallic = p->surface->metallic + at;
    const bool radiance = p->radiance;
    float mu[LANES], factor[LANES], out_exponent[LANES], in_exponent[LANES], scatters[LANES], metal[LANES], is_radiance[LANES],
        has_specular[LANES];
    static const float no_light[LANES];
    float transmits[LANES], sheet[LANES], off[LANES];
    float arriving[LANES]; /* results are local until complete: no aliasing */

    for (int i = 0; i < LANES; i++) {
        out_exponent[i] = OF(out_exponent);
        in_exponent[i] = OF(in_exponent);
        scatters[i] = OF(scatters);
        metal[i] = OF(in_metal);
        arriving[i] = 0.0f;
    }
    view_cosines(row, x, at, mu);
    for (int i = 0; i < LANES; i++)
        off[i] = pell_angle_off(OF(inverse_eta2), mu[i]);
    exit_factors(row, m, mu, at, full, uniform, cut, factor);
    for (int i = 0; i < LANES; i++) {
        if (full && m->one->in_metal == 0.0f)
            metal[i] = 1.0f;
        else
            metal[i] = metal[i] > 0.0f ? 1.0f - metal[i] * metallic[i] : 1.0f;
        is_radiance[i] = radiance ? scatters[i] : 0.0f;                                     /* the method returns radiance, */
        has_specular[i] = radiance && !p->excludes_surface_reflection ? scatters[i] : 0.0f; /* with the specular part */
        sheet[i] = OF(thin);
        transmits[i] = (radiance ? sheet[i] : scatters[i] + sheet[i]) * on[i];
    }

    for (int c = 0; c < 3; c++) {
        const float *restrict e = p->lighting->irradiance[c] + at, *restrict transmitted = p->lighting->transmitted[c] + at;
        const float *restrict entered = p->lighting->entered[c] ? p->lighting->entered[c] + at : no_light;
        const float *restrict spec = p->lighting->specular[c] + at, *restrict base = p->surface->base[c] + at;
        const float *light = p->exitance ? p->exitance[c] + at : e;
        float out[LANES], in[LANES], total[LANES], multiple[LANES], transmission[LANES], specular[LANES];

        power(row, base, out_exponent, full, out);
        power(row, base, in_exponent, full, in);
        for (int i = 0; i < LANES; i++)
            total[i] = OF(total[c]);
        for (int i = 0; i < LANES; i++) {
            const float angle = OF(exit_base[c]) + OF(exit_slope[c]) * off[i];
            const float a = in[i] * metal[i], k = is_radiance[i] > 0.0f ? 1.0f : factor[i] * angle * out[i];
            /* All values are loaded, then selected: inactive ones may be NaN and must not be multiplied. */
            const float by_method = light[i], unspread = total[i] * e[i], through = k * transmitted[i], reflected = spec[i];
            const float front = k * (scatters[i] > 0.0f ? by_method : unspread);
            const float all = e[i] + entered[i] + (sheet[i] > 0.0f ? transmitted[i] : 0.0f);
            const float metered = luminance[c] * OF(metered[c]) * all / (a > 0.02f ? a : 0.02f);
            /* Of the exitance of solved diffusion, what a half-space returns of the local light is not transmitted. */
            const float returned = k * total[i] * entered[i], local = returned < through ? returned : through;
            multiple[i] = on[i] > 0.0f ? front + local : 0.0f;
            transmission[i] = transmits[i] > 0.0f ? through - local : 0.0f;
            specular[i] = on[i] > has_specular[i] ? reflected : 0.0f;
            arriving[i] += on[i] > 0.0f ? metered : 0.0f;
        }
        memcpy(result->multiple[c], multiple, sizeof(multiple));
        memcpy(result->transmission[c], transmission, sizeof(transmission));
        memcpy(result->specular[c], specular, sizeof(specular));
    }
    memcpy(result->on, on, sizeof(result->on));
    memcpy(result->arriving, arriving, sizeof(arriving));
}

static bool shade(const struct pell_composite_row *row, int x, struct pell_composite_cut *cut, struct pell_composite_lanes *result)
{
    const struct pell_surface *s = row->p->surface;
    const uint16_t *restrict material =
        s->material + (ptrdiff_t) row->y * s->stride + x; /* rows are whole blocks; nothing outside the image is covered */
    struct block_materials m;
    float on[LANES];
    unsigned any = 0, differ = 0;

    for (int i = 0; i < LANES; i++) {
        any |= material[i];
        differ |= material[i] ^ (unsigned) material[0];
    }
    if (!any)
        return false;
    if (!differ) {
        m.one = &row->materials[material[0] - 1];
        for (int i = 0; i < LANES; i++)
            on[i] = 1.0f;
        if (m.one->uniform)
            shade_block(row, x, &m, on, true, true, cut, result);
        else
            shade_block(row, x, &m, on, true, false, cut, result);
        return true;
    }
    for (int i = 0; i < LANES; i++) {
        const int id = x + i < s->width ? material[i] : 0;
        on[i] = id ? 1.0f : 0.0f;
        m.lane[i] = &row->materials[id ? id - 1 : 0];
    }
    shade_block(row, x, &m, on, false, false, cut, result);
    return true;
}

INLINE void add_lanes(const struct pell_composite_lanes *restrict l, const float single[3][LANES], float weight, bool first, int count,
                      float *const color[3], float *alpha)
{
    float sum[LANES];

    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < LANES; i++)
            sum[i] = l->multiple[c][i] + single[c][i] + l->transmission[c][i] + l->specular[c][i];
        pell_composite_put(sum, weight, first, count, color[c]);
    }
    pell_composite_put(l->on, weight, first, count, alpha);
}

static void add(const struct pell_composite_lanes *l, const float single[3][LANES], float weight, bool first, int count,
                float *const color[3], float *alpha, struct pell_composite_meter *restrict meter)
{
    if (count == LANES)
        add_lanes(l, single, weight, first, LANES, color, alpha);
    else
        add_lanes(l, single, weight, first, count, color, alpha);
    for (int i = 0; i < LANES; i++) {
        meter->arriving[i] += (double) l->arriving[i];
        meter->covered[i] += (double) l->on[i];
    }
}

const struct pell_composite_kernels PELL_SIMD(pell_composite_kernels) = { shade, add };
