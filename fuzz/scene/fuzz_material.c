/* SPDX-License-Identifier: MIT
 * fuzz_material.c - material files of all kinds on arbitrary JSON: one message per refusal; an accepted material is in range and gives
 * profiles. */
#include "fuzz_scene.h"

#include <pellucid/layers.h>

static void check_medium(const struct pell_medium *medium)
{
    struct pell_profile profile;

    require(pell_medium_valid(medium, NULL));
    for (int c = 0; c < 3; c++) {
        require(pell_profile_make(PELL_PROFILE_DIPOLE, medium, c, NULL, &profile) == PELL_OK);
        require(profile.total >= 0.0 && profile.total <= 1.0);
    }
}

static void check_gaussians(const struct pell_gaussians *g)
{
    struct pell_profile profile;

    require(g->count >= 1);
    for (int c = 0; c < 3; c++)
        require(pell_profile_from_gaussians(g, c, &profile) == PELL_OK);
}

static void check_layers(const struct pell_material_layers *layers)
{
    require(layers->count >= 1 && layers->count <= PELL_MATERIAL_LAYERS_MAX);
    for (int i = 0; i < layers->count; i++) {
        const struct pell_material_layer *item = &layers->item[i];
        require(memchr(item->name, 0, sizeof(item->name)) && pell_medium_valid(&item->medium, NULL));
        require(item->thickness_mm >= PELL_THICKNESS_MIN && (item->thickness_mm <= PELL_THICKNESS_MAX || i + 1 == layers->count));
        for (int c = 0; c < 3; c++)
            require(pell_phase_valid(&item->phase[c], NULL));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct pell_limits limits;
    int errors = 0;
    struct pell_context_params context = { .log = count_errors, .log_user = &errors, .limits = &limits };
    struct pell_context *ctx = NULL;
    struct pell_material_entry e;
    uint8_t *copy = malloc(size + 1);
    enum pell_result res;

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.memory_bytes = 64 << 20;
    require(copy && pell_context_create(&context, &ctx) == PELL_OK);
    memcpy(copy, data, size);
    copy[size] = 0;
    res = pell_material_read(ctx, "fuzz/fuzz.json", copy, size, &e);
    require((res == PELL_OK ? errors == 0 : errors == 1) && (res == PELL_OK) == (e.name != NULL));
    if (res == PELL_OK) {
        if (e.kind == PELL_MATERIAL_MEDIUM)
            check_medium(&e.medium);
        else
            check_gaussians(&e.gaussians);
        if (e.kind == PELL_MATERIAL_LAYERS)
            check_layers(&e.layers);
        for (int c = 0; c < 3; c++)
            require(e.color[c] >= 0.0 && e.color[c] <= 1.0);
        require(e.roughness > 0.0 && e.roughness <= 1.0 && e.mix >= 0.0 && e.mix <= 1.0);
        require(e.medium.eta >= 1.0 && e.medium.eta <= 4.0 && e.concentration >= 0.0 && e.dilution >= 0.0);
    }
    pell_free(ctx, (char *) e.name);
    require(pell_memory_used(ctx) == 0);
    pell_context_destroy(&ctx);
    free(copy);
    return 0;
}
