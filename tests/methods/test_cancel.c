/* SPDX-License-Identifier: MIT
 * test_cancel.c - a large mesh is let go soon: wherever its preparation is cancelled, little work is done after that. */
#include "slow.h"
#include "stage.h"

/* Cancels at the n-th large allocation: what follows one is mostly a loop over what it is for. */
static struct canceller {
    struct pell_alloc_fault fault;
    struct pell_allocator inner;
    struct pell_context *ctx; /* NULL: counts alone */
    int large, cancel_at;
    double since; /* processor time when it cancelled */
} canceller;

#define LARGE_BYTES ((size_t) 1 << 20)
#define RINGS (SLOW ? 80 : 300) /* 358,800 triangles */
#define RUNS 8                  /* a method */

static void *cancelling_alloc(void *user, size_t size)
{
    struct canceller *c = user;

    if (size >= LARGE_BYTES / (SLOW ? 16 : 1) && ++c->large == c->cancel_at && c->ctx) {
        c->since = busy_seconds();
        pell_context_cancel(c->ctx);
    }
    return c->inner.alloc(c->inner.user, size);
}

static void cancelling_free(void *user, void *ptr)
{
    struct canceller *c = user;

    c->inner.free(c->inner.user, ptr);
}

static void start(struct stage *s, const char *method)
{
    const struct pell_allocator allocator = { cancelling_alloc, cancelling_free, &canceller };
    size_t material;

    memset(&canceller, 0, sizeof(canceller));
    canceller.inner = pell_failing_allocator(&canceller.fault);
    memset(s, 0, sizeof(*s));
    OK(pell_context_create(&(struct pell_context_params) { .allocator = allocator, .log_level = PELL_LOG_ERROR }, &s->ctx));
    OK(pell_scene_create(s->ctx, &s->scene));
    OK(pell_device_create(s->ctx, &(struct pell_device_params) { .threads = 1 }, &s->device));
    OK(pell_renderer_create(s->device, &s->r));
    pell_knobs_default(pell_settings_knobs(), &s->settings);
    s->settings.width = s->settings.height = 8;
    s->settings.msaa = 1;
    s->settings.bounces = 0;
    s->settings.curvature = s->settings.opposed = s->settings.angles = s->settings.single_scattering = false;
    stage_medium(s, "marble", &material);
    stage_ball(s, material, 0, vec3(0, 0, 0), 20.0f, RINGS);
    stage_light(s, PELL_LIGHT_POINT, vec3(70, 40, 60), vec3(0, 0, 0), 1.0f);
    stage_camera(s, vec3(0, 0, 260), vec3(0, 0, 0), 0.35f, 0.0f);
    stage_method(s, method, strcmp(method, "path-trace") == 0 ? (const char *const[]) { "samples=1", NULL } : NULL);
    stage_complete(s);
    canceller.large = 0;
}

static void require_soon(const char *method)
{
    const double most = SLOW ? 1.0 : 0.12;
    double worst = 0.0;
    struct stage s;
    int all;

    start(&s, method);
    OK(pell_renderer_set_scene(s.r, s.scene));
    OK(pell_renderer_render(s.r, &s.settings, &s.image));
    all = canceller.large;
    stage_finish(&s);
    REQUIRE(all > 4);
    start(&s, method);
    canceller.ctx = s.ctx;
    for (int run = 0; run < RUNS && run < all; run++) {
        enum pell_result res;
        double after;
        canceller.large = 0;
        canceller.cancel_at = all <= RUNS ? run + 1 : 1 + run * (all - 1) / (RUNS - 1);
        res = pell_renderer_set_scene(s.r, s.scene);
        if (res == PELL_OK)
            res = pell_renderer_render(s.r, &s.settings, &s.image);
        after = busy_seconds() - canceller.since;
        assert_int_equal(res, PELL_ERR_CANCELLED);
        worst = fmax(worst, after);
        pell_context_resume(s.ctx);
    }
    canceller.ctx = NULL;
    print_message("# %s: %d large allocations; %.3f s of work after a cancellation at most\n", method, all, worst);
    stage_finish(&s);
    assert_int_equal(canceller.fault.live, 0);
    REQUIRE(worst < most);
}

static void path_trace_lets_go_soon(void **state)
{
    (void) state;
    require_soon("path-trace");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(path_trace_lets_go_soon),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
