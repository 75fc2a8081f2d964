/* SPDX-License-Identifier: MIT
 * test_cancel.c - cancellation: wherever the preparation of a large mesh or a render is cancelled, little work is done afterwards;
 * planes that were not computed are not used; and the next render is unaffected. */
#include "slow.h"
#include "stage.h"

/* Cancels at the n-th allocation of `least` bytes or more, as most allocations are followed by the loop that fills them. Allocated
 * memory initially holds garbage. */
static struct canceller {
    struct pell_alloc_fault fault;
    struct pell_allocator inner;
    struct pell_context *ctx; /* NULL: only counts */
    size_t least;
    int count, cancel_at;
    double since; /* processor time at the cancellation */
    double done;  /* progress of the image */
    int shown;    /* number of progress reports */
} canceller;

#define LARGE_BYTES ((size_t) 1 << 20)
#define RINGS (SLOW ? 50 : 300) /* 358,800 triangles */
#define RUNS (SLOW ? 4 : 8)     /* a method */
#define PLACES (SLOW ? 3 : 16)  /* of a small image */
#define GARBAGE 0xa5

static void *cancelling_alloc(void *user, size_t size)
{
    struct canceller *c = user;
    void *ptr;

    if (size >= c->least && ++c->count == c->cancel_at && c->ctx) {
        c->since = busy_seconds();
        pell_context_cancel(c->ctx);
    }
    ptr = c->inner.alloc(c->inner.user, size);
    return ptr && c->least < LARGE_BYTES / 16 ? memset(ptr, GARBAGE, size) : ptr;
}

static void cancelling_free(void *user, void *ptr)
{
    struct canceller *c = user;

    c->inner.free(c->inner.user, ptr);
}

/* Reported progress never decreases. */
static void watch(void *user, const char *task, double fraction)
{
    struct canceller *c = user;

    if (strcmp(task, "layouts") == 0) /* before the image begins */
        return;
    if (!(fraction >= c->done && fraction <= 1.0))
        fail_msg("%s: progress goes from %g to %g", task, c->done, fraction);
    c->done = fraction;
    c->shown++;
}

static void start(struct stage *s, size_t least)
{
    const struct pell_allocator allocator = { cancelling_alloc, cancelling_free, &canceller };

    memset(&canceller, 0, sizeof(canceller));
    canceller.inner = pell_failing_allocator(&canceller.fault);
    canceller.least = least;
    memset(s, 0, sizeof(*s));
    OK(pell_context_create(
        &(struct pell_context_params) {
            .log_level = PELL_LOG_ERROR, .progress = watch, .progress_user = &canceller, .allocator = allocator },
        &s->ctx));
    OK(pell_scene_create(s->ctx, &s->scene));
    OK(pell_device_create(s->ctx, &(struct pell_device_params) { .threads = 1 }, &s->device));
    OK(pell_renderer_create(s->device, &s->r));
    pell_knobs_default(pell_settings_knobs(), &s->settings);
    s->settings.msaa = 1;
}

/* Knobs with which a method of many samples takes few. */
static const char *const *few_samples(const char *method)
{
    static const char *const one[] = { "samples=1", NULL }, *const most[] = { "error=1", "most=128", NULL };

    return strcmp(method, "path-trace") == 0 ? one : strcmp(method, "single-scatter") == 0 ? most : NULL;
}

static void start_large(struct stage *s, const char *method)
{
    size_t material;

    start(s, LARGE_BYTES / (SLOW ? 16 : 1));
    s->settings.width = s->settings.height = 8;
    s->settings.bounces = 0;
    s->settings.curvature = s->settings.opposed = s->settings.angles = s->settings.single_scattering = false;
    stage_medium(s, "marble", &material);
    stage_ball(s, material, 0, vec3(0, 0, 0), 20.0f, RINGS);
    stage_light(s, PELL_LIGHT_POINT, vec3(70, 40, 60), vec3(0, 0, 0), 1.0f);
    stage_camera(s, vec3(0, 0, 260), vec3(0, 0, 0), 0.35f, 0.0f);
    stage_method(s, method, few_samples(method));
    stage_complete(s);
    canceller.count = 0;
}

static void require_soon(const char *method)
{
    const double most = SLOW ? 1.0 : 0.2;
    double worst = 0.0;
    struct stage s;
    int all;

    start_large(&s, method);
    OK(pell_renderer_set_scene(s.r, s.scene));
    OK(pell_renderer_render(s.r, &s.settings, &s.image));
    all = canceller.count;
    stage_finish(&s);
    REQUIRE(all > 4);
    start_large(&s, method);
    canceller.ctx = s.ctx;
    for (int run = 0; run < RUNS && run < all; run++) {
        enum pell_result res;
        double after;
        canceller.count = 0;
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

/* A ball on a ground below a light, with all stages that are on by default. */
static void start_small(struct stage *s, const char *method)
{
    size_t marble, ground;

    start(s, 1);
    s->settings.width = s->settings.height = 12;
    s->settings.indirect_samples = 1024;
    stage_medium(s, "marble", &marble);
    stage_opaque(s, 0.5f, &ground);
    stage_ball(s, marble, 0, vec3(0, 0, 0), 8.0f, 10);
    stage_box(s, ground, 1, vec3(-20, -10, -20), vec3(20, -8.5f, 20));
    stage_light(s, PELL_LIGHT_POINT, vec3(30, 50, 60), vec3(0, 0, 0), 1.0f);
    stage_camera(s, vec3(0, 0, 80), vec3(0, 0, 0), 0.35f, 0.0f);
    stage_method(s, method, few_samples(method));
    stage_complete(s);
    OK(pell_renderer_set_scene(s->r, s->scene));
    canceller.count = 0;
}

static void nothing_is_made_of_what_was_cancelled(void **state)
{
    const struct pell_method *method = *state;
    const double begin = busy_seconds();
    struct shot whole;
    struct stage s;
    size_t number = 0;
    int all;

    while (pell_method_at(number) != method)
        number++;
    if (!method->cpu)
        skip();
    start_small(&s, method->name);
    OK(pell_renderer_render(s.r, &s.settings, &s.image));
    all = canceller.count;
    whole = shot_copy(&s.image);
    canceller.done = 0.0;
    canceller.shown = 0;
    s.settings.msaa = 2;
    OK(pell_renderer_render(s.r, &s.settings, &s.image));
    REQUIRE(canceller.shown >= 2);
    stage_finish(&s);
    for (int run = 0; run < PLACES; run++) {
        start_small(&s, method->name);
        canceller.ctx = s.ctx;
        canceller.cancel_at = 1 + (run * all + (int) number * all / 9) / PLACES %
                                      all; /* methods share stages: cancelled at a different point for each method */
        assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_CANCELLED);
        canceller.ctx = NULL;
        pell_context_resume(s.ctx);
        if (run % 4 == 0) {
            struct shot again;
            canceller.done = 0.0;
            OK(pell_renderer_render(s.r, &s.settings, &s.image));
            again = shot_copy(&s.image);
            if (!shot_equal(&whole, &again))
                fail_msg("%s, cancelled at allocation %d of %d: the next image differs", method->name, canceller.cancel_at, all);
            shot_free(&again);
        }
        stage_finish(&s);
        assert_int_equal(canceller.fault.live, 0);
    }
    print_message("# %s: %d allocations, %.1f s\n", method->name, all, busy_seconds() - begin);
    shot_free(&whole);
}

int main(void)
{
    struct CMUnitTest tests[32] = { cmocka_unit_test(path_trace_lets_go_soon) };
    size_t count = 1;

    for (size_t i = 0; i < pell_method_count() && count < 32; i++)
        tests[count++] = (struct CMUnitTest) { .name = pell_method_at(i)->name,
                                               .test_func = nothing_is_made_of_what_was_cancelled,
                                               .initial_state = (void *) pell_method_at(i) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
