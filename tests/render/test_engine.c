/* SPDX-License-Identifier: MIT
 * test_engine.c - the interface of engines: an engine that computes nothing but records the calls that it receives, under the real
 * renderer. */
#include "pell_test.h"
#include "stage.h"

#include "render/engine.h"

enum { WIDTH = 4, HEIGHT = 3, PIXELS = 16 * HEIGHT };

/* The calls to the engine and its method, and their replies. */
static struct {
    char calls[2048]; /* names in order, a space after each */
    const char *fail; /* the call of this name fails */
    int empty;        /* samples, from the first, without translucent pixels */
    unsigned needs;   /* of the method */
    bool survives_light_change;
    struct pell_frame in; /* of the method's last sample */
    int firsts;
    float plane[3 * PELL_PLANES][PIXELS];
} seen;

static enum pell_result call(const char *name)
{
    const size_t length = strlen(seen.calls);

    REQUIRE(length + strlen(name) + 2 < sizeof(seen.calls));
    snprintf(seen.calls + length, sizeof(seen.calls) - length, "%s ", name);
    return seen.fail && strcmp(seen.fail, name) == 0 ? PELL_ERR_FORMAT : PELL_OK;
}

/* The calls since the last query. */
static const char *take_calls(void)
{
    static char taken[sizeof(seen.calls)];

    memcpy(taken, seen.calls, sizeof(taken));
    seen.calls[0] = '\0';
    return taken;
}

/* --- The engine ------------------------------------------------------------------------------------------------------------------- */

struct null_engine {
    struct pell_context *ctx;
    void *kept[PELL_ENGINE_RESOURCES];
};

static const struct pell_method_engine *null_method(const struct pell_method *method)
{
    return method->vulkan;
}

static enum pell_result null_open(struct pell_context *ctx, struct pell_pool *pool, struct pell_gpu *gpu, void **engine)
{
    struct null_engine *e = pell_zalloc(ctx, sizeof(*e));

    (void) pool, (void) gpu;
    *engine = e;
    if (!e)
        return PELL_ERR_NOMEM;
    e->ctx = ctx;
    return call("open");
}

static enum pell_result null_make(void *engine, enum pell_engine_resource resource, const struct pell_engine_frame *frame)
{
    static const char *const names[] = { "scene",   "planes",    "raster", "lights",   "unscattered",
                                         "contact", "curvature", "links",  "indirect", "through" };
    struct null_engine *e = engine;
    enum pell_result res = call(names[resource]);

    REQUIRE(frame->scene != NULL && frame->settings != NULL && frame->materials != NULL);
    if (res == PELL_OK && !e->kept[resource] && !(e->kept[resource] = pell_alloc(e->ctx, 1)))
        res = PELL_ERR_NOMEM;
    return res;
}

static void null_drop(void *engine, enum pell_engine_resource resource)
{
    static const char *const names[] = { "-scene",   "-planes",    "-raster", "-lights",   "-unscattered",
                                         "-contact", "-curvature", "-links",  "-indirect", "-through" };
    struct null_engine *e = engine;

    (void) call(names[resource]);
    REQUIRE(e->kept[resource] != NULL); /* only existing objects are released */
    pell_free(e->ctx, e->kept[resource]);
    e->kept[resource] = NULL;
}

static void null_close(void *engine)
{
    struct null_engine *e = engine;

    if (!e)
        return;
    for (int i = 0; i < PELL_ENGINE_RESOURCES; i++)
        REQUIRE(e->kept[i] == NULL); /* the renderer has released everything that it created */
    pell_free(e->ctx, e);
}

static void null_lend(void *engine, struct pell_services *services)
{
    services->engine = engine;
}

static enum pell_result null_surface(void *engine, const struct pell_engine_sample *sample, struct pell_engine_seen *out)
{
    (void) engine;
    if (sample->index >= seen.empty)
        *out = (struct pell_engine_seen) { { 0, 0, WIDTH, HEIGHT }, WIDTH * HEIGHT };
    pell_stage_note(sample->frame->notes, "surface", 0.5, WIDTH * HEIGHT, 1, 0);
    return call("surface");
}

static enum pell_result null_irradiance(void *engine, const struct pell_engine_sample *sample)
{
    (void) engine;
    (void) sample;
    return call("irradiance");
}

static enum pell_result null_shade(void *engine, const struct pell_engine_sample *sample)
{
    (void) engine;
    (void) sample;
    return call("lit");
}

static void null_hand_over(void *engine, const struct pell_engine_sample *sample, struct pell_frame *in, struct pell_frame_light *out)
{
    (void) engine;
    (void) sample;
    in->rect = (struct pell_rect) { 0, 0, WIDTH, HEIGHT };
    for (int i = 0; i < PELL_PLANES; i++) {
        const struct pell_plane_info *p = pell_plane_at(i);
        float *const planes[] = { seen.plane[3 * i], seen.plane[3 * i + 1], seen.plane[3 * i + 2] };
        memcpy((char *) (p->of_light ? (void *) out : (void *) in) + p->offset, planes, (size_t) p->components * sizeof(*planes));
    }
    (void) call("hand-over");
}

static enum pell_result null_composite(void *engine, const struct pell_engine_sample *sample, const struct pell_engine_scattered *scattered)
{
    (void) engine;
    REQUIRE(scattered->present == (sample->index >= seen.empty));
    return call("composite");
}

static void null_average(void *engine, int done, int planned)
{
    (void) engine;
    (void) done;
    (void) planned;
    (void) call("average");
}

static enum pell_result null_post(void *engine, const struct pell_engine_frame *frame, const struct pell_view *view)
{
    (void) engine;
    (void) frame;
    (void) view;
    return call("post");
}

static void null_read_back(void *engine, const struct pell_engine_frame *frame, bool noisy, struct pell_channel *channels,
                           struct pell_engine_result *out)
{
    (void) engine;
    (void) frame;
    REQUIRE(!noisy);
    channels[0] = (struct pell_channel) { "R", seen.plane[3 * PELL_PLANE_LIGHT], 16, false };
    *out = (struct pell_engine_result) { .stride = 16, .num_channels = 1, .exposure = 2.0f, .covered = true, .any_light = true };
    (void) call("read-back");
}

static const struct pell_engine_interface null_engine = {
    .name = "null",
    .method = null_method,
    .open = null_open,
    .close = null_close,
    .make = null_make,
    .drop = null_drop,
    .lend = null_lend,
    .surface = null_surface,
    .irradiance = null_irradiance,
    .shade = null_shade,
    .hand_over = null_hand_over,
    .composite = null_composite,
    .average = null_average,
    .post = null_post,
    .read_back = null_read_back,
};

/* --- A method on this engine ------------------------------------------------------------------------------------------------------- */

struct probe {
    struct pell_context *ctx;
};

static enum pell_result probe_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                     void **state)
{
    struct probe *p = pell_zalloc(services->ctx, sizeof(*p));

    (void) knobs;
    REQUIRE(shape->width == WIDTH || shape->width == WIDTH + 1);
    REQUIRE(shape->materials[0].profile != NULL);
    *state = p;
    if (!p)
        return PELL_ERR_NOMEM;
    p->ctx = services->ctx;
    return call("create");
}

static enum pell_result probe_record(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    (void) state;
    REQUIRE(out->light[0] == seen.plane[3 * PELL_PLANE_LIGHT]);
    seen.in = *in;
    seen.firsts += in->first;
    return call("record");
}

static void probe_destroy(void *state)
{
    struct probe *p = state;

    (void) call("destroy");
    if (p)
        pell_free(p->ctx, p);
}

static void probe_plan(const void *knobs, struct pell_plan *plan)
{
    (void) knobs;
    *plan = (struct pell_plan) { .needs = seen.needs, .mix = -1.0f, .survives_light_change = seen.survives_light_change };
}

static const struct pell_knob probe_knobs[] = { { "gain", PELL_KNOB_FLOAT, "1", 0, { 0.25 }, 0, 1, NULL, "factor" }, { 0 } };
static const struct pell_method_engine probe_engine = { .create = probe_create, .record = probe_record, .destroy = probe_destroy };
static const struct pell_method probe_method = {
    .name = "probe",
    .title = "Probe",
    .cite = "none",
    .limits = "none",
    .knobs = probe_knobs,
    .knobs_size = sizeof(float),
    .plan = probe_plan,
    .vulkan = &probe_engine,
};

/* --- Tests -------------------------------------------------------------------------------------------------------------------------- */

static void start(struct stage *s, struct pell_alloc_fault *fault)
{
    size_t m;

    memset(&seen, 0, sizeof(seen));
    memset(s, 0, sizeof(*s));
    seen.needs = PELL_NEED_IRRADIANCE | PELL_NEED_SHADED;
    s->ctx = test_context(fault, &s->kept);
    OK(pell_scene_create(s->ctx, &s->scene));
    stage_gaussians(s, 1.0, &m);
    stage_box(s, m, 0, vec3(-30, -30, -20), vec3(30, 30, 0));
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 2.0f);
    stage_camera(s, vec3(0, 0, 100), vec3(0, 0, 0), 0.3f, 0.0f);
    stage_complete(s);
    pell_knobs_default(pell_settings_knobs(), &s->settings);
    s->settings.width = WIDTH;
    s->settings.height = HEIGHT;
    s->settings.msaa = 1;
    s->set = true;
}

static void start_renderer(struct stage *s)
{
    OK(pell_device_create_with_engine(s->ctx, 1, PELL_ENGINE_VULKAN, &null_engine, &s->device));
    OK(pell_renderer_create(s->device, &s->r));
    OK(pell_renderer_set_scene(s->r, s->scene));
    OK(pell_renderer_set_method(s->r, &probe_method, NULL));
}

static void a_frame_runs_its_stages_in_order(void **state)
{
    struct stage s;

    (void) state;
    start(&s, NULL);
    start_renderer(&s);
    assert_string_equal(take_calls(), "open scene ");
    s.settings.msaa = 3;
    s.settings.seed = ((int64_t) 5 << 32) + 9;
    seen.empty = 1;
    stage_render(&s);
    assert_string_equal(take_calls(), "planes raster lights unscattered curvature contact links indirect create through planes "
                                      "surface irradiance composite "
                                      "surface irradiance lit hand-over record composite "
                                      "surface irradiance lit hand-over record composite "
                                      "post read-back ");
    assert_int_equal(seen.in.sample, 2);
    assert_int_equal(seen.in.num_samples, 3);
    assert_int_equal(seen.in.seed, 5 ^ 9);
    assert_int_equal(seen.in.lights_revision, 1);
    assert_int_equal(seen.firsts, 1);
    REQUIRE(seen.in.view != NULL && !seen.in.first);
    assert_int_equal(seen.in.shape.width, WIDTH);
    assert_int_equal(seen.in.shape.num_materials, 1);
    assert_int_equal(s.image.num_channels, 1);
    assert_int_equal(s.image.rect.x1, WIDTH);
    REQUIRE(s.image.exposure == 2.0f);
    for (size_t i = 0; i < s.image.num_stages; i++)
        if (strcmp(s.image.stages[i].name, "surface") == 0)
            REQUIRE(s.image.stages[i].ms == 1500.0 && s.image.stages[i].rays == 3);
    stage_finish(&s);
}

/* A frame after a change, without the stages. */
static const char *again(struct stage *s)
{
    char *stages;
    static char kept[sizeof(seen.calls)];

    stage_render(s);
    snprintf(kept, sizeof(kept), "%s", take_calls());
    stages = strstr(kept, "surface ");
    REQUIRE(stages != NULL && strstr(stages, "read-back ") != NULL);
    *stages = '\0';
    return kept;
}

static void a_change_makes_anew_what_depends_on_it(void **state)
{
    struct stage s;

    (void) state;
    start(&s, NULL);
    start_renderer(&s);
    stage_render(&s);
    take_calls();
    assert_string_equal(again(&s), "planes ");
    s.scene->cameras[0].position[0] += 1.0f;
    assert_string_equal(again(&s), "planes ");
    s.scene->cameras[0].fov *= 0.5f;
    assert_string_equal(again(&s), "destroy create planes ");
    s.settings.exposure = 3.0f;
    s.settings.exit = PELL_EXIT_NORMALIZATION_PUBLISHED;
    assert_string_equal(again(&s), "planes ");
    s.settings.seed = 4;
    assert_string_equal(again(&s), "-through -indirect -links -lights lights links indirect through planes ");
    assert_int_equal(seen.in.lights_revision, 2);
    s.settings.profile = 2;
    assert_string_equal(again(&s),
                        "-through destroy -indirect -curvature -unscattered unscattered curvature indirect create through planes ");
    s.settings.bounces = 3;
    assert_string_equal(again(&s), "-through -indirect -links links indirect through planes ");
    s.settings.layers = true;
    assert_string_equal(again(&s), "destroy -raster -planes planes raster create planes ");
    s.settings.width++;
    assert_string_equal(again(&s), "destroy -raster -planes planes raster create planes ");
    OK(pell_renderer_set_method(s.r, &probe_method, NULL));
    assert_string_equal(again(&s), "-through destroy create through planes ");
    OK(pell_renderer_set_scene(s.r, s.scene));
    assert_string_equal(
        again(&s),
        "-through destroy -indirect -links -contact -curvature -unscattered -lights -raster -scene scene raster lights unscattered "
        "curvature contact links indirect create through planes ");
    OK(pell_renderer_set_scene(s.r, NULL));
    assert_string_equal(take_calls(), "-through destroy -indirect -links -contact -curvature -unscattered -lights -raster -scene ");
    stage_finish(&s);
    assert_string_equal(take_calls(), "-planes ");
}

/* A method that reads the scene keeps lighting that depends on it, unless it declares that lighting must be computed again. */
static void lights_take_a_pass_with_them_that_keeps_their_light(void **state)
{
    struct stage s;

    (void) state;
    start(&s, NULL);
    seen.needs |= PELL_NEED_SCENE;
    start_renderer(&s);
    stage_render(&s);
    take_calls();
    s.settings.light_samples++;
    assert_string_equal(again(&s), "-through destroy -indirect -lights lights indirect create through planes ");
    seen.survives_light_change = true;
    OK(pell_renderer_set_method(s.r, &probe_method, NULL));
    again(&s);
    s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
    assert_string_equal(again(&s), "-through -indirect -links -lights lights links indirect through planes ");
    stage_finish(&s);
}

static void errors_of_every_stage_end_the_frame(void **state)
{
    static const char *const names[] = { "planes", "raster",     "lights", "create",    "surface",
                                         "lit",    "irradiance", "record", "composite", "post" };
    struct stage s;

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        struct pell_alloc_fault fault = { 0 };
        const char *calls, *last;

        start(&s, &fault);
        start_renderer(&s);
        seen.fail = names[i];
        assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_FORMAT);
        assert_null(s.image.channels);
        calls = take_calls();
        last = strstr(calls, names[i]);
        REQUIRE(last != NULL);
        last += strlen(names[i]) + 1;
        REQUIRE(*last == '\0' || strcmp(last, "destroy ") == 0);
        seen.fail = NULL;
        OK(pell_renderer_render(s.r, &s.settings, &s.image));
        REQUIRE(strstr(take_calls(), "read-back ") != NULL);
        stage_finish(&s);
        assert_int_equal(fault.live, 0);
    }
    start(&s, NULL);
    start_renderer(&s);
    seen.fail = "scene";
    assert_int_equal(pell_renderer_set_scene(s.r, s.scene), PELL_ERR_FORMAT);
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_INVALID);
    REQUIRE(strstr(s.kept.what, "no scene"));
    stage_finish(&s);
}

static void survives_the_nth_allocation(void **state)
{
    uint64_t n;
    bool done = false;

    (void) state;
    for (n = 1; !done && n < 200; n++) {
        struct pell_alloc_fault fault = { 0 };
        struct stage s;
        enum pell_result res;

        start(&s, &fault);
        fault.fail_at = fault.calls + n;
        res = pell_device_create_with_engine(s.ctx, 1, PELL_ENGINE_VULKAN, &null_engine, &s.device);
        if (res == PELL_OK)
            res = pell_renderer_create(s.device, &s.r);
        if (res == PELL_OK)
            res = pell_renderer_set_scene(s.r, s.scene);
        if (res == PELL_OK)
            res = pell_renderer_set_method(s.r, &probe_method, NULL);
        if (res == PELL_OK)
            res = pell_renderer_render(s.r, &s.settings, &s.image);
        done = res == PELL_OK;
        if (!done)
            assert_int_equal(res, PELL_ERR_NOMEM);
        stage_finish(&s);
        assert_int_equal(fault.live, 0);
    }
    print_message("# %llu allocations failed in turn\n", (unsigned long long) n - 2);
    REQUIRE(done && n > 15);
}

static void a_frame_allocates_nothing(void **state)
{
    struct pell_alloc_fault fault = { 0 };
    struct stage s;
    uint64_t calls;

    (void) state;
    start(&s, &fault);
    start_renderer(&s);
    stage_render(&s);
    calls = fault.calls;
    stage_render(&s);
    assert_int_equal(fault.calls, calls);
    stage_finish(&s);
}

static void a_method_without_the_engine_is_refused_with_those_it_has(void **state)
{
    const struct pell_frame_material wall = { .gaussians = { .count = 1, .variance = { 1.0 } }, .name = "wall" };
    const struct pell_frame_shape shape = {
        .width = WIDTH, .height = HEIGHT, .stride = WIDTH, .focal_px = 1.0f, .materials = &wall, .num_materials = 1
    };
    struct pell_pass *pass;
    struct stage s;

    (void) state;
    start(&s, NULL);
    start_renderer(&s);
    assert_int_equal(pell_renderer_set_method(s.r, pell_method_find(s.ctx, "test", "layered"), NULL), PELL_ERR_DEVICE);
    assert_string_equal(s.kept.where, "layered");
    assert_string_equal(s.kept.what, "has no engine null, only cpu");
    stage_render(&s); /* the previous one still exists */
    assert_int_equal(pell_pass_create(s.device, pell_method_find(s.ctx, "test", "layered"), NULL, &shape, &pass), PELL_ERR_DEVICE);
    assert_null(pass);
    seen.needs = PELL_NEED_SCENE;
    assert_int_equal(pell_pass_create(s.device, &probe_method, NULL, &shape, &pass), PELL_ERR_UNSUPPORTED);
    assert_null(pass);
    stage_finish(&s);
}

/* Rows name members, and no two rows have the same pointer. */
static void rows_of_planes_are_whole(void **state)
{
    bool taken[2][sizeof(struct pell_frame)] = { { false } };

    (void) state;
    assert_null(pell_plane_at(-1));
    assert_null(pell_plane_at(PELL_PLANES));
    for (int i = 0; i < PELL_PLANES; i++) {
        const struct pell_plane_info *p = pell_plane_at(i);
        const size_t end = p->offset + (size_t) p->components * sizeof(void *);

        REQUIRE(p->name && p->name[0] && p->unit && p->unit[0] && p->what && p->what[0] && p->components >= 1 && p->components <= 3);
        REQUIRE(end <= (p->of_light ? sizeof(struct pell_frame_light) : sizeof(struct pell_frame)));
        for (size_t k = p->offset; k < end; k++) {
            REQUIRE(!taken[p->of_light][k]);
            taken[p->of_light][k] = true;
        }
        for (int j = 0; j < i; j++)
            REQUIRE(strcmp(p->what, pell_plane_at(j)->what) != 0);
    }
    for (size_t k = offsetof(struct pell_frame, material); k < sizeof(struct pell_frame); k++)
        REQUIRE(taken[false][k]); /* every plane has its row */
    for (size_t k = 0; k < sizeof(struct pell_frame_light); k++)
        REQUIRE(taken[true][k]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_frame_runs_its_stages_in_order),
        cmocka_unit_test(a_change_makes_anew_what_depends_on_it),
        cmocka_unit_test(lights_take_a_pass_with_them_that_keeps_their_light),
        cmocka_unit_test(errors_of_every_stage_end_the_frame),
        cmocka_unit_test(survives_the_nth_allocation),
        cmocka_unit_test(a_frame_allocates_nothing),
        cmocka_unit_test(a_method_without_the_engine_is_refused_with_those_it_has),
        cmocka_unit_test(rows_of_planes_are_whole),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
