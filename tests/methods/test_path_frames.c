/* SPDX-License-Identifier: MIT
 * test_path_frames.c - path-trace over frames: layers that add up, stopping criteria, and runs that were interrupted and resumed. The
 * transport itself has tests of its own. */
#include "scenes.h"

#include "render/renderer.h"

#include <unistd.h>

/* Ends a run, as Ctrl-C does, at a given progress. */
struct interruption {
    struct pell_context *ctx;
    double at; /* fraction of the work; 2: never */
    double last;
};

static void watch(void *user, const char *task, double fraction)
{
    struct interruption *i = user;

    assert_string_equal(task, "path-trace");
    if (!(fraction >= i->last && fraction <= 1.0))
        fail_msg("progress goes from %g to %g", i->last, fraction);
    i->last = fraction;
    if (fraction >= i->at)
        pell_context_interrupt(i->ctx);
}

/* A small marble ball, partly occluded by another, under an environment and a directional light; `kept` and `interruption` may be NULL. */
static void start(struct stage *s, int size, int threads, struct kept_messages *kept, struct interruption *interruption)
{
    const struct pell_device_params params = { .threads = threads, .engine = PELL_ENGINE_CPU };
    const struct pell_context_params context = {
        .log = keep_message, .log_user = kept ? kept : &s->kept, .progress = interruption ? watch : NULL, .progress_user = interruption
    };
    size_t m, other;

    memset(s, 0, sizeof(*s));
    OK(pell_context_create(&context, &s->ctx));
    if (interruption) {
        interruption->ctx = s->ctx;
        interruption->last = 0.0;
    }
    OK(pell_scene_create(s->ctx, &s->scene));
    OK(pell_device_create(s->ctx, &params, &s->device));
    OK(pell_renderer_create(s->device, &s->r));
    pell_knobs_default(pell_settings_knobs(), &s->settings);
    s->settings.width = s->settings.height = size;
    s->settings.msaa = 1;
    s->settings.exposure = 1.0f;
    s->settings.layers = true;
    stage_medium(s, "marble", &m);
    s->scene->materials[m].rho_s = 1.0f;
    stage_medium(s, "skin1", &other);
    stage_ball(s, m, 0, vec3(0, 0, 0), 2.0f, 24);
    stage_ball(s, other, 1, vec3(2, 2, 2), 1.5f, 24);
    stage_environment(s, 1.0f);
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(80, 30, 60), vec3(0, 0, 0), 3.0f);
    stage_camera(s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 4.6f);
}

static const char *const quick[] = { "samples=8", "acceleration=none", "events=8", NULL };

static int plane_of(const struct pell_render_result *p, const char *name)
{
    for (size_t i = 0; i < p->num_channels; i++)
        if (strcmp(p->channels[i].name, name) == 0)
            return (int) i;
    return -1;
}

/* --- Images ----------------------------------------------------------------------------------------------------------------------- */

static void any_number_of_threads_gives_the_same_bits(void **state)
{
    struct shot first = { 0 };

    (void) state;
    for (int threads = 1; threads <= 3; threads++) {
        struct stage s;
        struct shot shot;

        start(&s, 10, threads, NULL, NULL);
        s.settings.msaa = 2;
        shot = stage_shot_of(&s, "path-trace", quick);
        shot_check(&shot);
        shot_require_same(&first, &shot);
        stage_finish(&s);
    }
    shot_free(&first);
}

/* The same renderer twice, and with another method between: a frame leaves no state for the next. */
static void frames_start_anew(void **state)
{
    struct stage s;
    struct shot a, b, c;

    (void) state;
    start(&s, 8, 2, NULL, NULL);
    a = stage_shot_of(&s, "path-trace", quick);
    b = stage_shot(&s);
    stage_method(&s, "none", NULL);
    stage_render(&s);
    assert_int_equal(plane_of(&s.image, "diffuse.single.R"), -1);
    c = stage_shot_of(&s, "path-trace", quick);
    assert_true(shot_equal(&a, &b));
    assert_true(shot_equal(&a, &c));
    s.settings.seed = 5;
    shot_free(&c);
    c = stage_shot(&s);
    assert_false(shot_equal(&a, &c));
    shot_free(&a);
    shot_free(&b);
    shot_free(&c);
    stage_finish(&s);
}

static void layers_add_up_to_the_picture(void **state)
{
    static const char *const traced[] = { "samples=8", "acceleration=none", "events=8", "surface=traced", NULL };
    static const char *const names[] = { "diffuse.multiple.", "diffuse.single.", "transmission.", "specular." };
    double parts[2][4] = { { 0 } };
    struct stage s;
    struct shot shot[2];

    (void) state;
    start(&s, 10, 2, NULL, NULL);
    s.settings.msaa = 2;
    for (int t = 0; t < 2; t++) {
        shot[t] = stage_shot_of(&s, "path-trace", t ? traced : quick);
        for (int c = 0; c < 3; c++)
            for (size_t i = 0; i < shot[t].size; i++) {
                double sum = 0.0;
                if (shot[t].data[SHOT_A * shot[t].size + i] < 1.0f) /* the environment behind the objects */
                    continue;
                for (int k = 0; k < 4; k++) {
                    char name[32];
                    double part;
                    snprintf(name, sizeof(name), "%s%c", names[k], "RGB"[c]);
                    assert_true(plane_of(&s.image, name) >= 0);
                    part = (double) shot[t].data[(size_t) plane_of(&s.image, name) * shot[t].size + i];
                    parts[t][k] += part;
                    sum += part;
                }
                REQUIRE_NEAR(sum, (double) shot[t].data[(size_t) c * shot[t].size + i], 1e-6 * (1.0 + sum));
            }
    }
    /* The samples below the surface are the same; surface reflection is the analytic lobe or was traced, and both are present. */
    for (int k = 0; k < 2; k++) {
        REQUIRE(parts[0][k] > 0.0);
        REQUIRE_REL(parts[0][k], parts[1][k], 1e-6);
    }
    REQUIRE(parts[0][2] == 0.0 && parts[1][2] == 0.0);
    REQUIRE(parts[0][3] > 0.0 && parts[1][3] > 0.0 && parts[0][3] != parts[1][3]);
    /* The image is the same without layers. */
    for (int t = 0; t < 2; t++) {
        struct shot flat;
        s.settings.layers = false;
        flat = stage_shot_of(&s, "path-trace", t ? traced : quick);
        for (size_t i = 0; i < 3 * flat.size; i++)
            REQUIRE_NEAR((double) flat.data[i], (double) shot[t].data[i], 1e-6 * (1.0 + fabs((double) flat.data[i])));
        s.settings.layers = true;
        shot_free(&flat);
        shot_free(&shot[t]);
    }
    stage_finish(&s);
}

/* --- Stopping criteria ------------------------------------------------------------------------------------------------------------ */

/* Root of the mean squared relative standard error, of luminance summed over channels, over all pixels of the method. */
static double said_error(const struct stage *s, const struct shot *shot, int *pixels)
{
    const float *standard_error[3];
    double square = 0.0, mean = 0.0;
    int n = 0;

    assert_true(pell_pass_standard_error(pell_renderer_pass(s->r), standard_error));
    for (int pass = 0; pass < 2; pass++)
        for (int y = 0; y < shot->height; y++)
            for (int x = 0; x < shot->width; x++) {
                double light = 0.0, error = 0.0;
                for (size_t c = 0; c < 3; c++) {
                    light += ((const double[]) { 0.2126, 0.7152, 0.0722 })[c] * shot_at(shot, c, x, y);
                    error += ((const double[]) { 0.2126, 0.7152, 0.0722 })[c] * (double) standard_error[c][y * s->image.stride + x];
                }
                if (!(error > 0.0))
                    continue;
                if (pass == 0) {
                    mean += light;
                    n++;
                } else {
                    square += pow(error / fmax(light, 0.01 * mean / n), 2.0);
                }
            }
    *pixels = n;
    return sqrt(square / n);
}

static void it_stops_where_the_error_is_reached(void **state)
{
    static const char *const knobs[3][5] = { { "error=0.4", "acceleration=none", "events=8", NULL },
                                             { "error=0.2", "acceleration=none", "events=8", NULL },
                                             { "error=0.001", "samples=20", "acceleration=none", "events=8", NULL } };
    double said[3];
    struct stage s;

    (void) state;
    start(&s, 6, 2, NULL, NULL);
    s.scene->materials[0].rho_s = s.scene->materials[1].rho_s = 0.0f;
    for (int k = 0; k < 3; k++) {
        struct shot shot = stage_shot_of(&s, "path-trace", knobs[k]);
        int pixels;
        said[k] = said_error(&s, &shot, &pixels);
        REQUIRE(pixels > 9);
        shot_free(&shot);
    }
    print_message("# error bars %.3f of 0.4, %.3f of 0.2, %.3f of 20 samples\n", said[0], said[1], said[2]);
    REQUIRE(said[0] < 0.6 && said[1] < 0.3 && said[1] < said[0]); /* the channels' errors summed exceed the luminance's */
    stage_finish(&s);
}

/* Pixels of two seeds differ by as much as their standard errors state. */
static void error_bars_are_honest(void **state)
{
    static const char *const knobs[] = { "samples=256", "acceleration=none", "events=200", NULL };
    double bars[2][3 * 64], z2 = 0.0;
    struct shot shot[2];
    struct stage s;
    int n = 0;

    (void) state;
    start(&s, 8, 2, NULL, NULL);
    s.scene->materials[0].rho_s = s.scene->materials[1].rho_s = 0.0f;
    for (int k = 0; k < 2; k++) {
        const float *standard_error[3];
        s.settings.seed = 10 + k;
        shot[k] = stage_shot_of(&s, "path-trace", knobs);
        assert_true(pell_pass_standard_error(pell_renderer_pass(s.r), standard_error));
        for (int i = 0; i < 3 * 64; i++)
            bars[k][i] = (double) standard_error[i / 64][i % 64 / 8 * s.image.stride + i % 8];
    }
    for (int i = 0; i < 3 * 64; i++)
        if (bars[0][i] > 0.0) {
            const double difference = (double) shot[0].data[i] - (double) shot[1].data[i];
            z2 += difference * difference / (bars[0][i] * bars[0][i] + bars[1][i] * bars[1][i]);
            n++;
        }
    print_message("# two seeds differ by %.3f error bars, root mean square of %d\n", sqrt(z2 / n), n);
    REQUIRE(n > 60);
    REQUIRE(sqrt(z2 / n) > 0.6 && sqrt(z2 / n) < 1.4);
    shot_free(&shot[0]);
    shot_free(&shot[1]);
    stage_finish(&s);
}

static void a_time_limit_ends_it(void **state)
{
    static const char *const brief[] = { "time-limit=0.1", "acceleration=none", NULL }, *const briefest[] = { "time-limit=0.000001",
                                                                                                              "acceleration=none", NULL };
    struct stage s;
    struct shot shot;

    (void) state;
    start(&s, 6, 2, NULL, NULL);
    s.settings.msaa = 2;
    for (int k = 0; k < 2; k++) {
        const double begin = pell_seconds();
        shot = stage_shot_of(&s, "path-trace", k ? briefest : brief);
        assert_false(s.image.partial);
        REQUIRE(pell_seconds() - begin < 30.0);             /* including scene and grid, on a busy machine */
        REQUIRE(shot_at(&shot, SHOT_MULTIPLE, 3, 3) > 0.0); /* at least one sample */
        shot_free(&shot);
    }
    stage_finish(&s);
}

/* --- Interrupted and resumed ------------------------------------------------------------------------------------------------------ */

static const char *const some[] = { "samples=24", "acceleration=none", "events=8", NULL };

/* A unique name in the folder for temporary files; no such file exists yet. */
static void temporary_name(char *path, size_t size)
{
    static int number;
    const char *folder = getenv("TMPDIR");
    snprintf(path, size, "%s/pellucid-test-%ld-%d.ckpt", folder ? folder : "/tmp", (long) getpid(), number++);
    unlink(path);
}

static void a_run_goes_on_to_the_same_bits(void **state)
{
    struct stage s;
    struct shot whole, shot;
    char path[512];

    (void) state;
    start(&s, 8, 2, NULL, NULL);
    s.settings.msaa = 3;
    whole = stage_shot_of(&s, "path-trace", some);
    stage_finish(&s);
    temporary_name(path, sizeof(path));
    for (int run = 0, runs = 6; run < runs; run++) { /* interrupted five times, with different numbers of threads */
        struct interruption interruption = { .at = run < runs - 1 ? (run + 0.5) / runs : 2.0 };
        const struct pell_checkpoint checkpoint = { path, 1e-6 };

        start(&s, 8, 1 + run % 3, NULL, &interruption);
        s.settings.msaa = 3;
        OK(pell_renderer_set_checkpoint(s.r, &checkpoint));
        shot = stage_shot_of(&s, "path-trace", some);
        assert_int_equal(s.image.partial, run < runs - 1);
        shot_check(&shot);
        assert_int_equal(access(path, R_OK), 0);
        if (run == runs - 1)
            assert_true(shot_equal(&whole, &shot));
        shot_free(&shot);
        stage_finish(&s);
    }
    /* Finished work is not repeated. */
    start(&s, 8, 2, NULL, NULL);
    s.settings.msaa = 3;
    OK(pell_renderer_set_checkpoint(s.r, &(struct pell_checkpoint) { path, 100.0 }));
    shot = stage_shot_of(&s, "path-trace", some);
    assert_true(shot_equal(&whole, &shot));
    for (size_t i = 0; i < s.image.num_stages; i++)
        if (strcmp(s.image.stages[i].name, "path-trace") == 0)
            assert_int_equal(s.image.stages[i].rays, 0);
    shot_free(&shot);
    shot_free(&whole);
    stage_finish(&s);
    unlink(path);
}

/* More samples than before, and an error target: the same bits as if these had been requested at once. */
static void more_can_be_asked_for_later(void **state)
{
    static const char *const more[] = { "samples=40", "acceleration=none", "events=8", NULL };
    static const char *const error[] = { "error=0.2", "acceleration=none", "events=8", NULL };

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct stage s;
        struct shot at_once, shot;
        char path[512];

        start(&s, 6, 2, NULL, NULL);
        at_once = stage_shot_of(&s, "path-trace", k ? error : more);
        stage_finish(&s);
        temporary_name(path, sizeof(path));
        for (int run = 0; run < 2; run++) {
            start(&s, 6, 2, NULL, NULL);
            OK(pell_renderer_set_checkpoint(s.r, &(struct pell_checkpoint) { path, 100.0 }));
            shot = stage_shot_of(&s, "path-trace",
                                 run == 0 ? (const char *const[]) { "samples=7", "acceleration=none", "events=8", NULL }
                                 : k      ? error
                                          : more);
            if (run == 1)
                assert_true(shot_equal(&at_once, &shot));
            shot_free(&shot);
            stage_finish(&s);
        }
        shot_free(&at_once);
        unlink(path);
    }
}

/* Of four samples of the multisample the second is interrupted, late or when few pixels had samples: the image is the mean of the
 * samples that exist, with the same brightness. */
static void a_picture_that_was_ended_is_whole(void **state)
{
    static const double ends[] = { 0.4, 0.2501 };
    struct stage s;
    struct shot whole;

    (void) state;
    start(&s, 12, 2, NULL, NULL);
    s.settings.msaa = 4;
    whole = stage_shot_of(&s, "path-trace", some);
    stage_finish(&s);
    for (size_t k = 0; k < PELL_COUNT(ends); k++) {
        struct interruption interruption = { .at = ends[k] };
        double sum[2] = { 0 }, middle;
        struct shot shot;

        start(&s, 12, 1, NULL, &interruption);
        s.settings.msaa = 4;
        shot = stage_shot_of(&s, "path-trace", some);
        assert_true(s.image.partial);
        assert_true(pell_context_interrupted(s.ctx) && !pell_cancelled(s.ctx));
        shot_check(&shot);
        REQUIRE_NEAR(shot_at(&shot, SHOT_A, 6, 6), 1.0, 1e-6);
        middle = shot_at(&whole, SHOT_IRRADIANCE, 6, 6);
        REQUIRE_NEAR(shot_at(&shot, SHOT_IRRADIANCE, 6, 6), middle, 0.2 * middle);
        for (size_t i = 0; i < shot.size; i++) {
            sum[0] += (double) whole.data[SHOT_MULTIPLE * whole.size + i];
            sum[1] += (double) shot.data[SHOT_MULTIPLE * shot.size + i];
        }
        print_message("# ended at %g: %.3f of the light\n", ends[k], sum[1] / sum[0]);
        REQUIRE_REL(sum[1], sum[0], 0.25);
        shot_free(&shot);
        stage_finish(&s);
    }
    shot_free(&whole);
}

/* Where nothing can end early, an interruption equals a cancellation. */
static void other_methods_are_cancelled(void **state)
{
    struct stage s;

    (void) state;
    start(&s, 6, 2, NULL, NULL);
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    stage_method(&s, "screen-space", NULL);
    pell_context_interrupt(s.ctx);
    assert_true(pell_cancelled(s.ctx) && !pell_context_interrupted(s.ctx));
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_CANCELLED);
    stage_finish(&s);
}

/* --- Foreign checkpoint files ----------------------------------------------------------------------------------------------------- */

static const char *const least[] = { "samples=1", "acceleration=none", "events=8", NULL };

static enum pell_result go_on(const char *path, int change, struct kept_messages *kept)
{
    static const char *const more[] = { "samples=1", "acceleration=none", "events=9", NULL };
    struct stage s;
    enum pell_result res;

    memset(kept, 0, sizeof(*kept));
    start(&s, 6, 2, kept, NULL);
    if (change == 1)
        s.settings.seed = 1;
    if (change == 2)
        s.scene->lights[1].power[0] = 2.0f;
    if (change == 3)
        s.settings.width = 7;
    if (change == 4)
        s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    stage_method(&s, change == 6 ? "dipole" : "path-trace", change == 6 ? NULL : change == 5 ? &more[0] : least);
    OK(pell_renderer_set_checkpoint(s.r, &(struct pell_checkpoint) { path, 100.0 }));
    res = pell_renderer_render(s.r, &s.settings, &s.image);
    stage_finish(&s);
    return res;
}

static void files_of_another_run_are_refused_and_kept(void **state)
{
    static const char *const words[] = { NULL, "seed", "scene", "6 x 6", "settings", "knobs", "no state" };
    struct kept_messages kept;
    char path[512];

    (void) state;
    temporary_name(path, sizeof(path));
    OK(go_on(path, 0, &kept));
    for (int change = 1; change <= 6; change++) {
        const enum pell_result res = go_on(path, change, &kept);
        assert_int_equal(res, change == 6 ? PELL_ERR_UNSUPPORTED : PELL_ERR_INVALID);
        assert_int_equal(kept.errors, 1);
        if (!strstr(kept.what, words[change]))
            fail_msg("\"%s\" does not hold \"%s\"", kept.what, words[change]);
    }
    OK(go_on(path, 0, &kept));
    assert_int_equal(truncate(path, 300), 0);
    assert_int_equal(go_on(path, 0, &kept), PELL_ERR_FORMAT);
    assert_string_equal(kept.where, path);
    unlink(path);
    OK(go_on("/nowhere/at/all.ckpt", 0, &kept)); /* cannot be written: reported, and the image is rendered */
    assert_int_equal(kept.errors, 1);
    assert_string_equal(kept.where, "/nowhere/at/all.ckpt");
}

static void survives_the_nth_allocation(void **state)
{
    const struct pell_device_params params = { .threads = 1, .engine = PELL_ENGINE_CPU };
    struct pell_alloc_fault fault = { 0 };
    struct stage s = { 0 };
    bool done = false;
    char path[512];
    size_t m;

    (void) state;
    temporary_name(path, sizeof(path));
    s.ctx = test_context(&fault, &s.kept);
    OK(pell_scene_create(s.ctx, &s.scene));
    OK(pell_device_create(s.ctx, &params, &s.device));
    OK(pell_renderer_create(s.device, &s.r));
    pell_knobs_default(pell_settings_knobs(), &s.settings);
    s.settings.width = s.settings.height = 2;
    s.settings.msaa = 1;
    s.settings.layers = true;
    stage_medium(&s, "marble", &m);
    stage_box(&s, m, 0, vec3(-1, -1, -1), vec3(1, 1, 1));
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 9), vec3(0, 0, 0), 3.0f);
    stage_camera(&s, vec3(0, 0, 9), vec3(0, 0, 0), 0.0f, 1.0f);
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    for (uint64_t at = 1; !done; at++) {
        stage_method(&s, "path-trace", (const char *const[]) { "samples=1", "events=4", "acceleration=none", NULL }); /* a new pass */
        fault.fail_at = fault.calls + at;
        if (pell_renderer_set_checkpoint(s.r, &(struct pell_checkpoint) { path, 100.0 }) == PELL_OK)
            switch (pell_renderer_render(s.r, &s.settings, &s.image)) {
            case PELL_OK: done = fault.calls < fault.fail_at; break;
            case PELL_ERR_NOMEM: break;
            default: fail_msg("allocation %d gave another error: %s", (int) at, s.kept.what);
            }
        fault.fail_at = 0;
    }
    stage_finish(&s);
    assert_int_equal(fault.live, 0);
    unlink(path);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_number_of_threads_gives_the_same_bits),
        cmocka_unit_test(frames_start_anew),
        cmocka_unit_test(layers_add_up_to_the_picture),
        cmocka_unit_test(it_stops_where_the_error_is_reached),
        cmocka_unit_test(a_time_limit_ends_it),
        cmocka_unit_test(a_run_goes_on_to_the_same_bits),
        cmocka_unit_test(more_can_be_asked_for_later),
        cmocka_unit_test(a_picture_that_was_ended_is_whole),
        cmocka_unit_test(other_methods_are_cancelled),
        cmocka_unit_test(files_of_another_run_are_refused_and_kept),
        cmocka_unit_test(survives_the_nth_allocation),
    };

    /* Too slow under sanitizers: other tests run the same code with fewer samples. */
    const struct CMUnitTest numbers[] = { cmocka_unit_test(error_bars_are_honest) };
    struct CMUnitTest all[PELL_COUNT(tests) + PELL_COUNT(numbers)];

    memcpy(all, tests, sizeof(tests));
    memcpy(all + PELL_COUNT(tests), numbers, sizeof(numbers));
    return _cmocka_run_group_tests("tests", all, SLOW ? PELL_COUNT(tests) : PELL_COUNT(all), NULL, NULL);
}
