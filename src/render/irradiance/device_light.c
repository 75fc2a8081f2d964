/* SPDX-License-Identifier: MIT
 * device_light.c - sends points to the device and reads their light (device.h). */
#include "render/irradiance/device.h"
#include "render/irradiance/internal.h"

/* Writes 16 points; lanes without a point get no material. */
static void write_points(const struct job *job, const struct packet *k, uint32_t sample_index, struct pell_lit_point *out)
{
    const struct pell_lanes *l = &k->lanes;
    const bool needs_ambient = pell_any_environment(job) && (k->far_side || !(job->entering_only && job->p->ambient));

    for (int i = 0; i < PELL_LANES; i++) {
        struct pell_lit_point point = {
            .position = { l->px[i], l->py[i], l->pz[i], l->epsilon[i] },
            .geometric = { l->gx[i], l->gy[i], l->gz[i], l->terminator_offset[i] },
            .normal = { l->nx[i], l->ny[i], l->nz[i], l->roughness[i] },
            .view = { l->vx[i], l->vy[i], l->vz[i], l->shift[0][i] },
            .tint = { l->tint[0][i], l->tint[1][i], l->tint[2][i], l->shift[1][i] },
            .f0 = { l->f0[0][i], l->f0[1][i], l->f0[2][i], l->shift[2][i] },
            .hash0 = l->hash[0][i],
            .hash1 = l->hash[1][i],
            .curve = l->curve[i],
            .first = l->first[i],
            .material = l->valid[i] ? k->material[i] : PELL_LIT_NONE,
            .flags = (needs_ambient ? PELL_LIT_AMBIENT : 0u) | (k->straight[i] && !k->far_side ? PELL_LIT_STRAIGHT : 0u) |
                     (job->entering_only ? 0u : PELL_LIT_SEEN) | ~l->pattern_mask,
            .sample_index = sample_index,
            .slope_variance = l->slope_variance[i],
        };
        out[i] = point;
    }
}

uint32_t pell_send_packet(const struct job *job, struct packet *k, int samples)
{
    const uint32_t per_sample = pell_packet_points(k), first = pell_light_device_claim(job->p->device, per_sample * (uint32_t) samples);
    struct pell_lit_point *points = pell_light_device_points(job->p->device) + first;
    struct pell_inside inside;
    struct pell_gains gains;

    pell_prepare_inside(job, k, &gains, &inside); /* for the lanes' shift, and the lanes with straight transmission */
    for (int n = 0; n < samples; n++)
        write_points(job, k, job->p->sample + (uint32_t) n, points + (uint32_t) n * per_sample);
    if (per_sample > PELL_LANES) {
        struct packet b = *k;
        pell_turn_packet(&b);
        for (int n = 0; n < samples; n++)
            write_points(job, &b, job->p->sample + (uint32_t) n, points + (uint32_t) n * per_sample + PELL_LANES);
    }
    return first;
}

static float as_float(uint32_t word)
{
    return pell_bits_float((int32_t) word);
}

static void add_rgb(const uint32_t *word, int i, float sum[3][PELL_LANES])
{
    for (int c = 0; c < 3; c++)
        sum[c][i] += as_float(word[c]);
}

/* Returns a point's words, from four-word group `at` on. */
static const uint32_t *words_at(const struct job *job, const struct packet *k, int i, size_t at)
{
    return pell_light_device_result(job->p->device, k->slot + (size_t) i) + 4 * at;
}

void pell_read_lights(const struct job *job, struct packet *k)
{
    for (int i = 0; i < k->count; i++) {
        size_t at = 1;
        if (!k->lanes.valid[i])
            continue;
        add_rgb(words_at(job, k, i, 0), i, k->sums.irradiance);
        k->device_rays += words_at(job, k, i, 0)[3];
        if (!job->entering_only) {
            if (shows_highlights(job, k)) {
                add_rgb(words_at(job, k, i, at), i, k->sums.specular);
                add_rgb(words_at(job, k, i, at + 1), i, k->sums.hidden);
                add_rgb(words_at(job, k, i, at + 2), i, k->sums.lost);
            }
            at += PELL_LIT_HIGHLIGHT_WORDS;
        }
        if (job->p->separate)
            add_rgb(words_at(job, k, i, at), i, k->sums.single);
    }
}

void pell_read_environment(const struct job *job, struct packet *k, size_t e, struct pell_sums *sums)
{
    const size_t at = 1 + PELL_LIT_HIGHLIGHT_WORDS * (size_t) !job->entering_only + (size_t) (job->p->separate != NULL) + 2 * e;
    const bool known = job->entering_only && job->p->ambient && !k->far_side;

    for (int i = 0; i < k->count; i++) {
        k->ambient[i] = known ? k->ambient[i] : 0.0f;
        if (!k->lanes.valid[i])
            continue;
        add_rgb(words_at(job, k, i, at), i, sums->irradiance);
        add_rgb(words_at(job, k, i, at + 1), i, sums->unshadowed);
        if (!known)
            k->ambient[i] = (float) words_at(job, k, i, at)[3] / ((float) PELL_THROUGH_WHOLE * (float) job->lights->ambient_samples);
    }
}

/* Whether the device computed straight transmission at lane i. */
static bool has_straight(const struct packet *k, int i)
{
    return !k->far_side && k->lanes.valid[i] & k->lanes.transmits[i] & k->straight[i];
}

void pell_read_transmitted(const struct job *job, struct packet *k)
{
    for (int i = 0; i < k->count; i++) {
        const uint32_t *w = pell_light_device_through(job->p->device, k->slot + (size_t) i);
        if (!has_straight(k, i))
            continue;
        add_rgb(w, i, k->sums.transmitted);
        k->sums.straight[i] += as_float(w[0]) + as_float(w[1]) + as_float(w[2]);
        k->sums.path[i] += k->flat[i] * as_float(w[3]);
        k->through_rays += w[11];
    }
}

bool pell_read_exit(const struct job *job, const struct packet *k, int i, float fraction[3], float *m, struct pell_vec3 *normal)
{
    const uint32_t *w = pell_light_device_through(job->p->device, k->slot + (size_t) i);

    if (!has_straight(k, i))
        return false;
    for (int c = 0; c < 3; c++)
        fraction[c] = as_float(w[4 + c]);
    *m = as_float(w[7]);
    *normal = vec3(as_float(w[8]), as_float(w[9]), as_float(w[10]));
    return fraction[0] + fraction[1] + fraction[2] > 0.0f;
}
