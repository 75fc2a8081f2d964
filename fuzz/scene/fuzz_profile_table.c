/* SPDX-License-Identifier: MIT
 * fuzz_profile_table.c - the reader of radial profiles on arbitrary text: one message per refusal; an accepted table is a valid profile. */
#include "fuzz_scene.h"
#include "scene/file/profile_table.h"

static void check_profile(const struct pell_profile *p)
{
    double last = 0.0;

    require(p->total >= 0.0 && p->total <= 1.0 + PELL_PROFILE_TOTAL_SLACK);
    for (int i = 0; i <= 16; i++) {
        const double r = p->count ? p->r[p->count - 1] * i / 15.0 : i, value = pell_profile_eval(p, r), inside = pell_profile_cdf(p, r);
        require(value >= 0.0 && isfinite(value) && inside >= last - 1e-9 && inside <= 1.0);
        last = inside;
    }
    for (int i = 0; i < 8; i++) {
        const double r = pell_profile_sample(p, i / 8.0);
        require(r >= 0.0 && isfinite(r) && fabs(pell_profile_transform(p, 0.1 * i)) <= 1.0 + 2.0 * PELL_PROFILE_TOTAL_SLACK);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct pell_limits limits;
    int errors = 0;
    struct pell_context_params context = { .log = count_errors, .log_user = &errors, .limits = &limits };
    struct pell_context *ctx = NULL;
    struct pell_profile *profiles = malloc(3 * sizeof(*profiles));
    uint8_t *copy = malloc(size + 1);
    enum pell_result res;

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.memory_bytes = 64 << 20;
    require(copy && profiles && pell_context_create(&context, &ctx) == PELL_OK);
    memcpy(copy, data, size);
    copy[size] = 0;
    res = pell_profile_table_read(ctx, "fuzz.csv", copy, size, profiles);
    require(res == PELL_OK ? errors == 0 : errors == 1);
    for (int c = 0; c < 3; c++)
        check_profile(&profiles[c]); /* after a refusal: a profile without light */
    require(res == PELL_OK || profiles[0].total + profiles[1].total + profiles[2].total == 0.0);
    require(pell_memory_used(ctx) == 0);
    pell_context_destroy(&ctx);
    free(profiles);
    free(copy);
    return 0;
}
