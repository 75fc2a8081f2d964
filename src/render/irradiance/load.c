/* SPDX-License-Identifier: MIT
 * load.c - fills a packet's lanes from the surface's planes and the materials. */
#include "render/irradiance/internal.h"
#include "shared/color_share.h"

#include <string.h>

/* Values of a lane that depend on its material. */
struct material_values {
    int32_t albedo_at, boundary_at, smooth, model, opaque, transmits, scatters_forward;
    const struct pell_angle *angle;
    const struct pell_separate_single *separate;
    float fd;
    bool textured;
};

static struct material_values values_of(const struct job *job, size_t material)
{
    const struct pell_specular_tables *t = job->p->tables;
    const struct pell_material *m = &job->p->scene->materials[material];
    const struct pell_thickness_table *thickness = job->p->thickness && !m->opaque ? job->p->thickness[material] : NULL;

    return (struct material_values) {
        .albedo_at = (int32_t) t->model[material] * PELL_ALBEDO_MU * PELL_ALBEDO_ROUGHNESS * 2,
        .boundary_at = (int32_t) ((size_t) t->boundary[material] * (sizeof(*t->boundaries) / sizeof(float))),
        .smooth = -(int32_t) (job->p->smooth && !m->opaque),
        .model = t->model[material],
        .opaque = -(int32_t) m->opaque,
        .transmits = -(int32_t) (thickness && thickness->max_mm > 0.0f),
        .scatters_forward = -(int32_t) (job->p->solid_light && pell_indirect_forward(job->p->solid_light, material)),
        .angle = job->p->angle && !m->opaque ? &job->p->angle[material] : NULL,
        .separate = job->p->separate && !m->opaque ? &job->p->separate[material] : NULL,
        .fd = t->boundaries[t->boundary[material]].f0,
        .textured = !m->opaque && m->color_from == PELL_COLOR_FROM_TEXTURE,
    };
}

static void set_angle(struct pell_lanes *l, int i, const struct pell_angle *angle, bool seen)
{
    l->inverse_eta2[i] = angle ? angle->inverse_eta2 : 1.0f;
    for (int c = 0; c < 3; c++) {
        l->enter_base[c][i] = angle ? angle->enter_base[c] : 1.0f;
        l->enter_slope[c][i] = angle ? angle->enter_slope[c] : 0.0f;
        l->enter_mean[c][i] = angle ? angle->enter_mean[c] : 1.0f;
        l->pass_base[c][i] = angle && seen ? angle->pass_base[c] : 1.0f;
        l->pass_slope[c][i] = angle && seen ? angle->pass_slope[c] : 0.0f;
        l->pass_per_mm[c][i] = angle ? angle->pass_per_mm[c] : 0.0f;
    }
}

static void set_single(struct pell_lanes *l, int i, const struct pell_separate_single *separate)
{
    l->single_eta2[i] = separate ? separate->inverse_eta2 : 0.0f;
    for (int c = 0; c < 3; c++) {
        l->single_albedo[c][i] = separate ? separate->albedo[c] : 0.0f;
        l->single_g[c][i] = separate ? separate->g[c] : 0.0f;
        l->any_single |= l->single_albedo[c][i] > 0.0f;
    }
}

/* Fills the lanes' material values. If all lanes have the material of the previous packet, the values are still loaded, except those
 * that the roughness modified. */
static void set_materials(const struct job *job, struct packet *k)
{
    struct pell_lanes *l = &k->lanes;
    struct material_values t = values_of(job, k->material[0]);

    if (k->one_material && k->cached_material == (int64_t) k->material[0]) {
        for (int i = 0; i < PELL_LANES; i++)
            l->albedo_at[i] = t.albedo_at;
        return;
    }
    k->cached_material = k->one_material ? (int64_t) k->material[0] : -1;
    l->any_smooth = l->any_transmits = l->any_single = 0;
    l->any_direction = job->p->directions;
    l->models = 0;
    memset(l->shift, 0, sizeof(l->shift));
    k->textured = false;
    for (int i = 0; i < PELL_LANES; i++) {
        if (!k->one_material)
            t = values_of(job, k->material[i]);
        l->albedo_at[i] = t.albedo_at;
        l->boundary_at[i] = t.boundary_at;
        l->fd[i] = t.fd;
        l->smooth[i] = t.smooth;
        l->model[i] = t.model;
        l->opaque[i] = t.opaque;
        l->transmits[i] = t.transmits;
        l->scatters_forward[i] = t.scatters_forward;
        k->textured |= t.textured;
        l->any_smooth |= t.smooth;
        l->models |= 1u << t.model;
        l->any_transmits |= t.transmits;
        set_angle(l, i, t.angle, !job->entering_only);
        set_single(l, i, t.separate);
    }
}

static void color_entering(const struct job *job, struct packet *k)
{
    const struct pell_surface *s = job->p->surface;

    if (!k->textured)
        return;
    for (int i = 0; i < k->count; i++) {
        const struct pell_material *m = &job->p->scene->materials[k->material[i]];
        const float mix = job->p->mix >= 0.0f ? job->p->mix : m->mix;
        if (!m->opaque && m->color_from == PELL_COLOR_FROM_TEXTURE)
            for (int c = 0; c < 3; c++)
                k->lanes.albedo[c][i] = pell_color_share(s->base[c][k->index[i]], mix);
    }
}

/* Splits the colour of thin sheets into reflection and transmission. */
static void split_sheets(const struct job *job, struct packet *k)
{
    const struct pell_surface *s = job->p->surface;
    struct pell_lanes *l = &k->lanes;

    l->any_thin = 0;
    if (!s->any_thin)
        return;
    memcpy(l->transmission, l->albedo, sizeof(l->transmission));
    for (int i = 0; i < PELL_LANES; i++) {
        const int32_t at = k->index[i];
        l->thin[i] = -(int32_t) pell_material_is_thin(&job->p->scene->materials[k->material[i]]);
        for (int c = 0; l->thin[i] && c < 3; c++) {
            l->transmission[c][i] = s->transmission[c][at];
            l->albedo[c][i] *= s->reflection[at];
        }
        l->any_thin |= l->thin[i];
    }
}

void pell_load_packet(const struct job *job, struct packet *k, const int32_t *x, const int32_t *y, const float *const *position)
{
    const struct pell_surface *s = job->p->surface;
    const struct pell_material *uniform[PELL_LANES];
    struct pell_lane_input input = {
        .view = job->p->view, .surface = s, .seed = job->p->seed, .light_bits = job->lights->light_bits, .position = position
    };
    uint32_t differ = 0;

    for (int i = 0; i < PELL_LANES; i++) {
        k->lanes.valid[i] = -(int32_t) (i < k->count);
        differ |= k->material[i] ^ k->material[0];
    }
    k->one_material = !differ;
    set_materials(job, k);
    if (k->one_material) {
        const struct pell_material *m = &job->p->scene->materials[k->material[0]];
        if (!m->opaque && m->metallic == 0.0f && pell_surface_is_uniform(m))
            input.plain = m;
    } else if (s->omit_uniform) {
        for (int i = 0; i < PELL_LANES; i++) {
            const struct pell_material *m = &job->p->scene->materials[k->material[i]];
            uniform[i] = pell_surface_is_plain(m) ? m : NULL;
        }
        input.uniform = uniform;
    }
    job->kernels->load(&input, k->index, x, y, &k->lanes, &k->sums);
    k->lanes.pattern_mask =
        job->entering_only ? UINT32_MAX : ~job->lights->together; /* points that are not pixels have other sample counts */
    color_entering(job, k);
    split_sheets(job, k);
    if (s->any_emissive)
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < k->count; i++)
                k->sums.specular[c][i] = s->emissive[c][k->index[i]];
}

void pell_turn_packet(struct packet *k)
{
    struct pell_lanes *l = &k->lanes;

    k->far_side = true;
    for (int i = 0; i < PELL_LANES; i++) {
        l->valid[i] &= l->thin[i];
        l->terminator_offset[i] = 0.0f;
        l->gx[i] = -l->gx[i];
        l->gy[i] = -l->gy[i];
        l->gz[i] = -l->gz[i];
        l->nx[i] = -l->nx[i];
        l->ny[i] = -l->ny[i];
        l->nz[i] = -l->nz[i];
        l->ox[i] = l->px[i] + l->epsilon[i] * l->gx[i];
        l->oy[i] = l->py[i] + l->epsilon[i] * l->gy[i];
        l->oz[i] = l->pz[i] + l->epsilon[i] * l->gz[i];
    }
}
