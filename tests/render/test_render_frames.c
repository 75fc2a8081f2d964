/* SPDX-License-Identifier: MIT
 * test_render_frames.c - the renderer from frame to frame: its allocations, its refusals, and images that depend only on scene, method
 * and settings. */
#include "stage.h"

#include "render/engine.h"

#include <fcntl.h>
#include <pthread.h>
#include <sys/stat.h>

static const char *const no_knobs[] = { NULL };
static const char *const paper[] = { "as=paper", NULL };

/* A ball of skin and an opaque box under several lights, seen in perspective. */
static void furnish(struct stage *s)
{
    size_t skin, paint, bright;

    stage_medium(s, "skin1", &skin)->rho_s = 1.0f;
    stage_medium(s, "wholemilk", &bright);
    stage_opaque(s, 0.5f, &paint)->rho_s = 1.0f;
    stage_ball(s, skin, 0, vec3(-14, 0, 0), 20.0f, 16);
    stage_ball(s, bright, 1, vec3(22, -6, 6), 14.0f, 12);
    stage_box(s, paint, 2, vec3(-60, -30, -40), vec3(60, -20, 40));
    stage_light(s, PELL_LIGHT_RECT, vec3(-80, 100, 90), vec3(0, 0, 0), 20.0f);
    stage_light(s, PELL_LIGHT_POINT, vec3(70, 40, -60), vec3(0, 0, 0), 0.02f);
    stage_environment(s, 0.3f);
    stage_camera(s, vec3(0, 30, 260), vec3(0, -5, 0), 0.35f, 0.0f);
    s->settings.light_samples = 4;
    s->settings.ambient_samples = 4;
    s->settings.msaa = 2;
}

/* --- Memory ---------------------------------------------------------------------------------------------------------------------- */

static void no_allocation_after_the_first_frame(void **state)
{
    static const struct {
        const char *method;
        const char *const *knobs;
    } cases[] = { { "none", NULL }, { "screen-space", no_knobs }, { "screen-space", paper } };
    struct stage s;

    (void) state;
    stage_start(&s, 90, 60);
    furnish(&s);
    for (size_t k = 0; k < PELL_COUNT(cases); k++)
        for (int layers = 0; layers < 2; layers++) {
            uint64_t before;
            s.settings.layers = layers;
            stage_camera(&s, vec3(0, 30, 260), vec3(0, -5, 0), 0.35f, 0.0f);
            stage_method(&s, cases[k].method, cases[k].knobs);
            stage_render(&s);
            before = pell_allocations(s.ctx);
            stage_render(&s);
            stage_camera(&s, vec3(100, 60, 150), vec3(0, 0, 0), 0.35f, 0.0f); /* elsewhere */
            stage_render(&s);
            stage_camera(&s, vec3(0, 0, 260), vec3(0, 0, 900), 0.35f, 0.0f); /* looking away */
            stage_render(&s);
            stage_camera(&s, vec3(-14, 0, 24), vec3(-14, 0, 0), 0.35f, 0.0f); /* filling the image */
            stage_render(&s);
            s.settings.exposure = 0.0f; /* planes that only post-processing reads */
            s.settings.exit = PELL_EXIT_NORMALIZATION_PUBLISHED;
            stage_render(&s);
            s.settings.exit = PELL_EXIT_NORMALIZATION_BALANCED;
            if (pell_allocations(s.ctx) != before)
                fail_msg("%s, layers %d: %llu allocations", cases[k].method, layers,
                         (unsigned long long) (pell_allocations(s.ctx) - before));
        }
    stage_finish(&s);
}

static const char *work_folder(void)
{
    static char folder[] = "/tmp/pell-frames-XXXXXX";
    static bool made;

    if (!made)
        assert_non_null(mkdtemp(folder));
    made = true;
    return folder;
}

static const char *work_file(const char *name)
{
    static char path[4][256];
    static int next;
    char *p = path[next++ % 4];

    snprintf(p, sizeof(path[0]), "%s/%s", work_folder(), name);
    return p;
}

static void write_file(const char *name, const char *text)
{
    FILE *f = fopen(work_file(name), "w");

    assert_non_null(f);
    fputs(text, f);
    fclose(f);
}

/* A scene file with meshes of two materials, a colour map, an environment and a projected image. */
static void write_scene_files(void)
{
    static const float grey[4 * 2 * 3] = { 1, 2, 3, 4, 5, 6, 7, 8, 9, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 50, 50, 50 };
    float planes[3][8];
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_channel channels[3] = { { "R", planes[0], 4, false }, { "G", planes[1], 4, false }, { "B", planes[2], 4, false } };
    const struct pell_write_params params = { .width = 4, .height = 2, .channels = channels, .num_channels = 3 };
    FILE *f = fopen(work_file("thing.obj"), "w");

    assert_non_null(f);
    for (int i = 0; i < 24; i++)
        planes[i % 3][i / 3] = grey[i] * 0.02f;
    OK(pell_image_write(ctx, work_file("map.png"), NULL, &params));
    OK(pell_image_write(ctx, work_file("sky.hdr"), NULL, &params));
    pell_context_destroy(&ctx);
    fputs("mtllib thing.mtl\n", f);
    for (int i = 0; i < 8; i++)
        fprintf(f, "v %d %d %d\n", i & 1 ? 10 : -10, i & 2 ? 10 : -10, i & 4 ? 10 : -10);
    fputs("vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl one\n"
          "f 1/1 3/2 4/3 2/4\nf 5/1 6/2 8/3 7/4\nf 1/1 2/2 6/3 5/4\nusemtl two\nf 3/1 7/2 8/3 4/4\nf 1/1 5/2 7/3 3/4\nf 2/1 4/2 8/3 6/4\n",
          f);
    fclose(f);
    write_file("thing.mtl", "newmtl one\nKd 1 0.8 0.6\nmap_Kd map.png\nnewmtl two\nKd 0.5 0.5 0.5\n");
    for (int environment = 0; environment < 2; environment++) {
        char text[1024];
        snprintf(text, sizeof(text),
                 "{\"pellucid\": 1, \"mesh\": \"thing.obj\", \"unit\": \"1mm\", \"ground\": true,"
                 " \"camera\": {\"from\": [30, 30, 60], \"to\": [0, 0, 0], \"fov_deg\": 30},"
                 " \"lights\": [%s{\"type\": \"point\", \"at\": [30, 50, 60], \"intensity\": [0.01, 0.01, 0.01]}],"
                 " \"materials\": {\"one\": {\"preset\": \"skin\"}, \"two\": {\"preset\": \"marble\"}}}",
                 environment ? "{\"type\": \"environment\", \"image\": \"sky.hdr\"}, " : "");
        write_file(environment ? "sky.json" : "scene.json", text);
    }
}

/* Loads, renders with a method and writes. Returns the first failure. */
static enum pell_result load_render_write(const char *file, struct pell_alloc_fault *fault, uint64_t calls[3])
{
    struct pell_context_params params = { .allocator = pell_failing_allocator(fault) };
    const struct pell_device_params threads = { .threads = 2 };
    struct pell_context *ctx = NULL;
    struct pell_scene *scene = NULL;
    struct pell_device *device = NULL;
    struct pell_renderer *r = NULL;
    struct pell_settings settings;
    struct pell_render_result image;
    struct pell_write_params write = { .width = 12, .height = 9 };
    struct pell_load_params load = { 0 };
    enum pell_result res;

    pell_knobs_default(pell_settings_knobs(), &settings);
    settings.width = 12;
    settings.height = 9;
    settings.msaa = 1;
    settings.light_samples = settings.ambient_samples = 1;
    settings.environment_lights = 2;
    settings.indirect_samples = 64;
    settings.layers = true;
    PELL_TRY(pell_context_create(&params, &ctx));
    PELL_TRY(pell_scene_load(ctx, work_file(file), &load, &scene));
    calls[0] = fault->calls;
    PELL_TRY(pell_device_create(ctx, &threads, &device));
    PELL_TRY(pell_renderer_create(device, &r));
    PELL_TRY(pell_renderer_set_scene(r, scene));
    PELL_TRY(pell_renderer_set_method(r, pell_method_at(0), NULL));
    PELL_TRY(pell_renderer_render(r, &settings, &image));
    PELL_TRY(pell_renderer_check_assumptions(r, &settings));
    calls[1] = fault->calls;
    write.channels = image.channels;
    write.num_channels = image.num_channels;
    PELL_TRY(pell_image_write(ctx, work_file("out.exr"), NULL, &write));
    calls[2] = fault->calls;

fail:
    pell_renderer_destroy(&r);
    pell_device_destroy(&device);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
    return res;
}

static void nth_allocation_fails_from_file_to_file(void **state)
{
    static const char *const scenes[] = { "scene.json", "sky.json" };
    static const char *const all[] = { "thing.obj", "thing.mtl", "scene.json", "sky.json", "map.png", "sky.hdr", "out.exr" };

    (void) state;
    write_scene_files();
    for (int k = 0; k < 2; k++) {
        uint64_t calls[3] = { 0 }, tried = 0;
        struct pell_alloc_fault none = { 0 };
        OK(load_render_write(scenes[k], &none, calls));
        assert_int_equal(none.live, 0);
        /* Every allocation of loading the first scene; some where a scene takes long. */
        for (uint64_t n = 1; n <= calls[2]; n = k == 0 && n < calls[0] ? n + 1 : next_allocation(n)) {
            struct pell_alloc_fault fault = { .fail_at = n, .sticky = n % 2 == 0 };
            uint64_t ignored[3];
            enum pell_result res;
            unlink(work_file("out.exr"));
            res = load_render_write(scenes[k], &fault, ignored);
            if (res != PELL_ERR_NOMEM)
                fail_msg("%s: allocation %llu of %llu failed, and the whole was \"%s\"", scenes[k], (unsigned long long) n,
                         (unsigned long long) calls[2], pell_result_name(res));
            if (fault.live != 0)
                fail_msg("%s: after allocation %llu failed %lld were not freed", scenes[k], (unsigned long long) n, (long long) fault.live);
            if (access(work_file("out.exr"), F_OK) == 0)
                fail_msg("%s: after allocation %llu failed an image was left", scenes[k], (unsigned long long) n);
            tried++;
        }
        print_message("# %s: %llu allocations to load, %llu to render, %llu to write; %llu failures tried\n", scenes[k],
                      (unsigned long long) calls[0], (unsigned long long) (calls[1] - calls[0]), (unsigned long long) (calls[2] - calls[1]),
                      (unsigned long long) tried);
    }
    for (size_t i = 0; i < PELL_COUNT(all); i++)
        unlink(work_file(all[i]));
    rmdir(work_folder());
}

/* A renderer that ran out of memory works again once memory is available. */
static void a_renderer_survives_want_of_memory(void **state)
{
    struct stage good;
    struct shot expected;
    uint64_t n;

    (void) state;
    stage_start(&good, 33, 21);
    furnish(&good);
    expected = stage_shot_of(&good, "screen-space", NULL);
    for (n = 1; n < 200; n += 3) {
        struct pell_alloc_fault fault = { 0 };
        struct pell_context *ctx = test_context(&fault, NULL);
        const struct pell_device_params params = { .threads = 2 };
        struct pell_device *device;
        struct pell_renderer *r;
        struct pell_render_result image;
        struct shot shot;
        bool failed = false;

        OK(pell_device_create(ctx, &params, &device));
        OK(pell_renderer_create(device, &r));
        fault.fail_at = fault.calls + n;
        if (pell_renderer_set_method(r, pell_method_at(0), NULL) != PELL_OK) {
            failed = true;
            OK(pell_renderer_set_method(r, pell_method_at(0), NULL));
        }
        if (pell_renderer_set_scene(r, good.scene) != PELL_OK) {
            failed = true;
            OK(pell_renderer_set_scene(r, good.scene));
        }
        if (pell_renderer_render(r, &good.settings, &image) != PELL_OK) {
            failed = true;
            OK(pell_renderer_render(r, &good.settings, &image));
        }
        shot = shot_copy(&image);
        REQUIRE(shot_equal(&shot, &expected));
        shot_free(&shot);
        pell_renderer_destroy(&r);
        pell_device_destroy(&device);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
        if (!failed)
            break;
    }
    print_message("# every third of %llu allocations failed in turn\n", (unsigned long long) n - 1);
    REQUIRE(n > 10 && n < 200);
    shot_free(&expected);
    stage_finish(&good);
}

/* --- The same bits ---------------------------------------------------------------------------------------------------------------- */

static void the_same_bits_on_any_number_of_threads(void **state)
{
    static const int threads[] = { 1, 2, 3, 5 };

    (void) state;
    for (int method = 0; method < 3; method++) {
        struct shot first = { 0 };
        for (size_t i = 0; i < PELL_COUNT(threads); i++) {
            struct stage s;
            stage_start_threads(&s, 101, 67, threads[i]);
            furnish(&s);
            s.settings.layers = true;
            s.settings.exposure = 0.0f;
            stage_method(&s, method ? "screen-space" : "none", method == 2 ? paper : NULL);
            for (int again = 0; again < 2; again++) {
                struct shot shot = stage_shot(&s);
                if (!first.data) {
                    first = shot;
                    continue;
                }
                if (!shot_equal(&first, &shot))
                    fail_msg("method %d on %d threads, frame %d differs", method, threads[i], again);
                shot_free(&shot);
            }
            stage_finish(&s);
        }
        shot_free(&first);
    }
}

struct twin {
    struct pell_device *device; /* of all */
    const struct pell_scene *scene;
    struct pell_settings settings;
    const struct shot *expected;
    bool scatter, right;
};

static void *run_twin(void *arg)
{
    struct twin *t = arg;
    struct pell_renderer *r;
    struct pell_render_result image;

    t->right = pell_renderer_create(t->device, &r) == PELL_OK && pell_renderer_set_scene(r, t->scene) == PELL_OK &&
               pell_renderer_set_method(r, t->scatter ? pell_method_at(0) : NULL, NULL) == PELL_OK;
    for (int i = 0; i < 3 && t->right; i++) {
        t->right = pell_renderer_render(r, &t->settings, &image) == PELL_OK;
        if (t->right) {
            struct shot shot = shot_copy(&image);
            t->right = shot_equal(&shot, t->expected);
            shot_free(&shot);
        }
    }
    pell_renderer_destroy(&r);
    return NULL;
}

static void renderers_share_a_scene_and_a_device(void **state)
{
    struct stage s;
    struct shot alone[2];
    struct twin twins[3];
    pthread_t threads[3];

    (void) state;
    stage_start(&s, 60, 40);
    furnish(&s);
    alone[0] = stage_shot_of(&s, "none", NULL);
    alone[1] = stage_shot_of(&s, "screen-space", NULL);
    for (int i = 0; i < 3; i++) {
        twins[i] = (struct twin) { s.device, s.scene, s.settings, &alone[i != 1], i != 1, false };
        assert_int_equal(pthread_create(&threads[i], NULL, run_twin, &twins[i]), 0);
    }
    for (int i = 0; i < 3; i++) {
        pthread_join(threads[i], NULL);
        REQUIRE(twins[i].right);
    }
    shot_free(&alone[0]);
    shot_free(&alone[1]);
    stage_finish(&s);
}

/* Independent of the renderer's history: other sizes, other settings, other cameras, other scenes. */
static void a_picture_has_no_history(void **state)
{
    static const int sizes[][2] = { { 1, 1 }, { 33, 17 }, { 1, 40 }, { 77, 1 }, { 64, 64 }, { 15, 16 }, { 17, 129 } };
    struct stage old, other;

    (void) state;
    stage_start(&old, 1, 1);
    furnish(&old);
    stage_start(&other, 1, 1);
    furnish(&other);
    stage_box(&other, 0, 9, vec3(-5, 20, -5), vec3(5, 30, 5));
    stage_complete(&other);
    stage_method(&old, "screen-space", NULL);
    stage_render(&old);
    for (size_t i = 0; i < PELL_COUNT(sizes); i++) {
        struct stage fresh;
        struct shot a, b;

        stage_start(&fresh, sizes[i][0], sizes[i][1]);
        furnish(&fresh);
        fresh.settings.layers = i % 2 == 1;
        fresh.settings.msaa = 1 + (int) i % 3;
        fresh.settings.boundary = (int) i % 2;
        fresh.settings.seed = (int64_t) (i / 2);
        stage_complete(&fresh);
        OK(pell_renderer_set_scene(fresh.r, fresh.scene));
        fresh.set = true;
        for (int k = 0; k < 2; k++) /* including zoom */
            stage_camera(k ? &fresh : &old, vec3(10.0f * (float) i, 30, 260), vec3(0, -5, 0), 0.35f - 0.04f * (float) i,
                         i == 4 ? 80.0f : 0.0f);
        stage_method(&fresh, i == 5 ? "none" : "screen-space", NULL);
        stage_method(&old, i == 5 ? "none" : "screen-space", NULL);
        a = stage_shot(&fresh);
        if (i == 3) {
            OK(pell_renderer_set_scene(old.r, other.scene));
            OK(pell_renderer_render(old.r, &old.settings, &old.image));
            OK(pell_renderer_set_scene(old.r, old.scene));
        }
        old.settings = fresh.settings;
        b = stage_shot(&old);
        for (size_t k = 0; k < a.planes; k++)
            for (size_t at = 0; at < a.size; at++)
                if (memcmp(&a.data[k * a.size + at], &b.data[k * a.size + at], sizeof(float)) != 0)
                    fail_msg("%d x %d: plane %zu, pixel %zu is %g, and %g after other images", sizes[i][0], sizes[i][1], k, at,
                             (double) a.data[k * a.size + at], (double) b.data[k * a.size + at]);
        shot_check(&a);
        shot_free(&a);
        shot_free(&b);
        stage_finish(&fresh);
    }
    stage_finish(&other);
    stage_finish(&old);
}

/* What was next to the object in the previous frame is gone, even where its depth is similar. */
static void a_method_sees_nothing_of_the_frame_before(void **state)
{
    struct stage s[2];
    struct shot shot[2];
    size_t marble;

    (void) state;
    for (int k = 0; k < 2; k++) {
        stage_start(&s[k], 160, 160);
        stage_gaussians(&s[k], 1.0, &marble);
        stage_box(&s[k], marble, 0, vec3(-20, -20, -40), vec3(20, 20, 0));
        stage_light(&s[k], PELL_LIGHT_POINT, vec3(0, -40, 200), vec3(0, 0, 0), 100.0f);
        stage_camera(&s[k], vec3(0, k ? 6 : 0, 100), vec3(0, k ? 6 : 0, 0), 0.0f, 60.0f);
        stage_method(&s[k], "screen-space", NULL);
    }
    stage_render(&s[1]);
    stage_camera(&s[1], vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 60.0f);
    for (int k = 0; k < 2; k++)
        shot[k] = stage_shot(&s[k]);
    REQUIRE(shot_equal(&shot[0], &shot[1]));
    for (int k = 0; k < 2; k++) {
        shot_free(&shot[k]);
        stage_finish(&s[k]);
    }
}

/* Only the scene's camera may change between frames, including its angle of view. */
static void a_camera_may_zoom_between_frames(void **state)
{
    struct stage s, fresh;
    struct shot a, b;

    (void) state;
    stage_start(&s, 60, 40);
    furnish(&s);
    stage_method(&s, "screen-space", NULL);
    stage_render(&s);
    s.scene->cameras[0].fov = 0.2f;
    a = stage_shot(&s);
    stage_start(&fresh, 60, 40);
    furnish(&fresh);
    fresh.scene->cameras[0].fov = 0.2f;
    b = stage_shot_of(&fresh, "screen-space", NULL);
    REQUIRE(shot_equal(&a, &b));
    s.scene->cameras[0].ortho_height = 80.0f;
    stage_render(&s);
    shot_free(&a);
    shot_free(&b);
    stage_finish(&fresh);
    stage_finish(&s);
}

static void lights_may_move_between_frames(void **state)
{
    static const char *const methods[] = { "none", "screen-space", "hierarchical" };
    struct stage s, fresh;
    struct shot a, b, before;

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(methods); k++) {
        stage_start(&s, 60, 40);
        furnish(&s);
        before = stage_shot_of(&s, methods[k], NULL);
        s.scene->lights[1].position[0] -= 90.0f;
        s.scene->lights[0].power[1] *= 0.5f;
        pell_renderer_lights_changed(s.r);
        a = stage_shot(&s);
        stage_start(&fresh, 60, 40);
        furnish(&fresh);
        fresh.scene->lights[1].position[0] -= 90.0f;
        fresh.scene->lights[0].power[1] *= 0.5f;
        b = stage_shot_of(&fresh, methods[k], NULL);
        REQUIRE(shot_equal(&a, &b) && !shot_equal(&a, &before));
        shot_free(&before);
        shot_free(&a);
        shot_free(&b);
        stage_finish(&fresh);
        stage_finish(&s);
    }
}

/* --- Refusals --------------------------------------------------------------------------------------------------------------------- */

static void settings_out_of_range_are_refused(void **state)
{
    struct stage s;

    (void) state;
    stage_start(&s, 8, 8);
    furnish(&s);
    stage_render(&s);
    for (const struct pell_knob *k = pell_settings_knobs(); k->name; k++) {
        double bad[3] = { k->min - 1.0, k->max + 2.0, NAN };
        if (k->type == PELL_KNOB_BOOL)
            continue;
        if (k->type == PELL_KNOB_ENUM) {
            bad[0] = -1.0;
            bad[1] = 0.0;
            while (k->choices[(int) bad[1]])
                bad[1] += 1.0;
        } else if (k->type == PELL_KNOB_FLOAT) {
            bad[1] = 2.0 * k->max;
        }
        for (int i = 0; i < (k->type == PELL_KNOB_FLOAT ? 3 : 2); i++) {
            struct pell_settings settings = s.settings;
            void *field = (char *) &settings + k->offset;
            struct pell_render_result image;
            if (k->type == PELL_KNOB_FLOAT)
                *(float *) field = (float) bad[i];
            else if (k->type == PELL_KNOB_INT64)
                *(int64_t *) field = (int64_t) bad[i];
            else
                *(int *) field = (int) bad[i];
            s.kept.errors = 0;
            if (pell_renderer_render(s.r, &settings, &image) != PELL_ERR_INVALID)
                fail_msg("%s = %g is not refused", k->name, bad[i]);
            assert_int_equal(s.kept.errors, 1);
            REQUIRE(strstr(s.kept.what, k->name) || strstr(s.kept.where, k->name));
        }
    }
    stage_render(&s); /* and the render continues */
    stage_finish(&s);
}

static void cameras_that_show_nothing_are_refused(void **state)
{
    static const struct {
        const char *what;
        float position, forward[3], up[3], fov, ortho;
    } cases[] = {
        { "position", NAN, { 0, 0, -1 }, { 0, 1, 0 }, 1.0f, 0.0f },
        { "position", INFINITY, { 0, 0, -1 }, { 0, 1, 0 }, 1.0f, 0.0f },
        { "forward", 0.0f, { 0, 0, 0 }, { 0, 1, 0 }, 1.0f, 0.0f },
        { "forward", 0.0f, { NAN, 0, -1 }, { 0, 1, 0 }, 1.0f, 0.0f },
        { "up", 0.0f, { 0, 0, -1 }, { 0, 0, 1 }, 1.0f, 0.0f },
        { "up", 0.0f, { 0, 0, -1 }, { 0, 0, 0 }, 1.0f, 0.0f },
        { "fov", 0.0f, { 0, 0, -1 }, { 0, 1, 0 }, 0.0f, 0.0f },
        { "fov", 0.0f, { 0, 0, -1 }, { 0, 1, 0 }, 3.15f, 0.0f },
        { "fov", 0.0f, { 0, 0, -1 }, { 0, 1, 0 }, NAN, 0.0f },
        { "ortho_height", 0.0f, { 0, 0, -1 }, { 0, 1, 0 }, 1.0f, -1.0f },
        { "ortho_height", 0.0f, { 0, 0, -1 }, { 0, 1, 0 }, 1.0f, INFINITY },
        { "forward", 0.0f, { INFINITY, 0, 0 }, { 0, 1, 0 }, 1.0f, 0.0f },
    };
    struct stage s;
    struct pell_camera good;

    (void) state;
    stage_start(&s, 16, 12);
    furnish(&s);
    stage_method(&s, "screen-space", NULL);
    stage_render(&s);
    good = s.scene->cameras[0];
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct pell_camera *c = &s.scene->cameras[0];
        c->position[0] = cases[i].position;
        memcpy(c->forward, cases[i].forward, sizeof(c->forward));
        memcpy(c->up, cases[i].up, sizeof(c->up));
        c->fov = cases[i].fov;
        c->ortho_height = cases[i].ortho;
        s.kept.errors = 0;
        if (pell_renderer_render(s.r, &s.settings, &s.image) != PELL_ERR_INVALID || s.kept.errors != 1 ||
            !strstr(s.kept.what, cases[i].what))
            fail_msg("camera %zu: %d errors, \"%s\", expected one about %s", i, s.kept.errors, s.kept.what, cases[i].what);
        *c = good;
    }
    stage_render(&s);
    stage_finish(&s);
}

/* A program may set them in place; what a file may not say is refused in the next frame, and mended in the one after. */
static void lights_out_of_range_are_refused(void **state)
{
    struct stage s;
    struct pell_light *l;
    float *value[4];

    (void) state;
    stage_start(&s, 16, 12);
    furnish(&s);
    stage_render(&s);
    l = &s.scene->lights[1];
    value[0] = &l->power[2];
    value[1] = &l->position[0];
    value[2] = &l->range;
    value[3] = &l->rotate;
    for (size_t i = 0; i < PELL_COUNT(value); i++) {
        const float good = *value[i];
        *value[i] = NAN;
        pell_renderer_lights_changed(s.r);
        s.kept.errors = 0;
        assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_INVALID);
        assert_int_equal(s.kept.errors, 1);
        REQUIRE(strstr(s.kept.where, "light"));
        *value[i] = good;
        pell_renderer_lights_changed(s.r);
        stage_render(&s);
    }
    l->power[0] = -5.0f;
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_INVALID);
    REQUIRE(strstr(s.kept.what, "its power is -5, allowed: [0, 1e+20]"));
    stage_finish(&s);
}

static void what_is_missing_is_named(void **state)
{
    const struct pell_device_params vulkan = { .engine = PELL_ENGINE_VULKAN, .vulkan_device = "no such device" };
    const struct pell_device_params unknown = { .engine = (enum pell_engine) 77 };
    struct pell_device *device = (struct pell_device *) 1;
    struct pell_scene *empty;
    struct stage s;

    (void) state;
    stage_start(&s, 16, 12);
    furnish(&s);
    assert_int_equal(pell_device_create(s.ctx, &vulkan, &device), PELL_ERR_DEVICE);
    assert_null(device);
    assert_int_equal(pell_device_create(s.ctx, &unknown, &device), PELL_ERR_DEVICE);
    assert_null(device);
    REQUIRE(strstr(s.kept.what, "no engine 77"));
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_INVALID);
    REQUIRE(strstr(s.kept.what, "no scene"));
    stage_render(&s);
    OK(pell_renderer_set_scene(s.r, NULL));
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_INVALID);
    OK(pell_renderer_check_assumptions(s.r, &s.settings));
    OK(pell_scene_create(s.ctx, &empty));
    assert_int_equal(pell_renderer_set_scene(s.r, empty), PELL_ERR_INVALID);
    REQUIRE(strstr(s.kept.what, "camera"));
    pell_scene_destroy(&empty);
    pell_renderer_destroy(&s.r);
    pell_device_destroy(&s.device);
    pell_renderer_destroy(&s.r);
    pell_device_destroy(&s.device); /* of NULL */
    stage_finish(&s);
}

/* Pixel blocks that an object covers partially are rendered by another code path than empty ones. */
static void a_background_of_one_colour_is_shown_flat(void **state)
{
    struct stage s;
    size_t paint;

    (void) state;
    stage_start(&s, 96, 64);
    stage_opaque(&s, 0.5f, &paint);
    stage_ball(&s, paint, 0, vec3(0, 0, 0), 10.0f, 12);
    stage_light(&s, PELL_LIGHT_POINT, vec3(0, -40, 200), vec3(0, 0, 0), 100.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.3f, 0.0f);
    stage_method(&s, "none", NULL);
    s.scene->background = PELL_BACKGROUND_COLOR;
    s.settings.exposure = 0.0f;
    for (int i = 1; i < 60; i++) {
        struct shot a;
        for (int c = 0; c < 3; c++)
            s.scene->background_color[c] = 0.015f * (float) i * (1.0f - 0.2f * (float) c);
        a = stage_shot(&s);
        for (size_t k = 0; k < 3 * a.size; k++)
            if (a.data[SHOT_A * a.size + k % a.size] == 0.0f)
                REQUIRE(a.data[SHOT_SHOWN * a.size + k] == a.data[SHOT_SHOWN * a.size + k / a.size * a.size]);
        shot_free(&a);
    }
    stage_finish(&s);
}

/* A scene of lights and a camera alone shows its background. */
static void a_scene_without_objects_is_its_background(void **state)
{
    struct stage s;
    struct shot shot;
    size_t index;

    (void) state;
    stage_start(&s, 19, 11);
    stage_medium(&s, "marble", &index);
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.3f, 0.0f);
    s.scene->background_color[0] = 0.5f;
    OK(pell_renderer_set_scene(s.r, s.scene));
    s.set = true;
    for (int layers = 0; layers < 2; layers++) {
        s.settings.layers = layers;
        shot = stage_shot_of(&s, "screen-space", NULL);
        for (int y = 0; y < 11; y++)
            for (int x = 0; x < 19; x++) {
                REQUIRE(shot_at(&shot, SHOT_A, x, y) == 0.0);
                REQUIRE_NEAR(shot_at(&shot, layers ? SHOT_SHOWN_LAYERS : SHOT_SHOWN, x, y), 0.5, 1e-6);
            }
        shot_free(&shot);
    }
    s.scene->background = PELL_BACKGROUND_ENVIRONMENT;
    shot = stage_shot(&s);
    REQUIRE_NEAR(shot_at(&shot, SHOT_G, 9, 5), 1.0, 1e-5);
    shot_free(&shot);
    OK(pell_renderer_check_assumptions(s.r, &s.settings));
    stage_finish(&s);
}

/* --- Cancelling -------------------------------------------------------------------------------------------------------------------- */

static void *cancel_soon(void *arg)
{
    const struct timespec wait = { .tv_nsec = 60 * 1000 * 1000 };

    nanosleep(&wait, NULL);
    pell_context_cancel(arg);
    return NULL;
}

static void cancelling_ends_a_frame_soon(void **state)
{
    struct stage s;
    pthread_t thread;
    double start;

    (void) state;
    stage_start(&s, 640, 640);
    furnish(&s);
    s.settings.msaa = 64;
    s.settings.light_samples = 1024;
    s.settings.ambient_samples = 1024;
    stage_method(&s, "screen-space", NULL);
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    start = pell_seconds();
    assert_int_equal(pthread_create(&thread, NULL, cancel_soon, s.ctx), 0);
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_CANCELLED);
    pthread_join(thread, NULL);
    print_message("# ended after %.2f s\n", pell_seconds() - start);
    REQUIRE(pell_seconds() - start < 5.0);
    assert_null(s.image.channels);
    assert_int_equal(s.kept.errors, 0);
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_CANCELLED);
    pell_context_resume(s.ctx);
    s.settings.msaa = s.settings.light_samples = s.settings.ambient_samples = 1;
    OK(pell_renderer_render(s.r, &s.settings, &s.image));
    stage_finish(&s);
}

/* --- Methods ----------------------------------------------------------------------------------------------------------------------- */

/* Methods defined by the test, to inspect the renderer's input to a method and the use of its output. */
struct probe_knobs {
    float gain;
};

static struct probe_seen {
    int creates, renders, destroys;
    bool fail_create, fail_render, positions_agree, hits_agree;
    const struct pell_scene *scene;
    unsigned needs;
    enum pell_quantity quantity;
    float focal_px;
} probe;

static enum pell_result probe_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                     void **state)
{
    REQUIRE(services->scene != NULL && services->ctx != NULL);
    probe.creates++;
    probe.focal_px = shape->focal_px;
    *state = malloc(sizeof(float));
    **(float **) state = ((const struct probe_knobs *) knobs)->gain;
    return probe.fail_create ? PELL_ERR_INVALID : PELL_OK;
}

/* The point of the triangle equals the pixel's position. */
static bool hit_is_there(const struct pell_frame *in, ptrdiff_t i)
{
    const struct pell_mesh *m = &probe.scene->meshes[in->mesh[i]];
    const uint32_t *index = m->index + 3 * (size_t) in->triangle[i];
    const float u = in->barycentric[0][i], v = in->barycentric[1][i];

    for (int c = 0; c < 3; c++) {
        const float p = (1.0f - u - v) * m->position[3 * index[0] + (uint32_t) c] + u * m->position[3 * index[1] + (uint32_t) c] +
                        v * m->position[3 * index[2] + (uint32_t) c];
        if (!(fabsf(p - in->position[c][i]) < 1e-3f))
            return false;
    }
    return true;
}

static enum pell_result probe_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    const float gain = *(float *) state;

    probe.renders++;
    if (probe.fail_render)
        return PELL_ERR_FORMAT;
    probe.positions_agree = in->position[0] != NULL;
    probe.hits_agree = in->mesh != NULL;
    for (int y = in->rect.y0; y < in->rect.y1; y++)
        for (int x = in->rect.x0; x < in->rect.x1; x++) {
            const ptrdiff_t i = y * in->shape.stride + x;
            for (int c = 0; c < 3 && in->material[i]; c++)
                out->light[c][i] = gain * ((probe.needs & PELL_NEED_SHADED) ? in->shaded[c][i] : in->irradiance[c][i]);
            if (in->material[i] && in->position[0]) /* the camera of `furnish_plane` is at z = 100 and looks along -z */
                probe.positions_agree =
                    probe.positions_agree && fabsf(in->position[2][i] - (100.0f - in->depth[i])) < 1e-3f &&
                    fabsf(in->position[0][i] - (x + 0.5f - 0.5f * in->shape.width) * in->depth[i] / in->shape.focal_px) < 1e-3f;
            if (in->material[i] && in->mesh)
                probe.hits_agree = probe.hits_agree && hit_is_there(in, i);
        }
    return PELL_OK;
}

static void probe_destroy(void *state)
{
    probe.destroys++;
    free(state);
}

static void probe_plan(const void *knobs, struct pell_plan *plan)
{
    (void) knobs;
    *plan = (struct pell_plan) { .needs = probe.needs, .quantity = probe.quantity, .mix = -1.0f };
}

static const struct pell_knob probe_knobs[] = {
    { "gain", PELL_KNOB_FLOAT, "1", offsetof(struct probe_knobs, gain), { 0.25 }, 0, 1, NULL, "factor" },
    { 0 },
};
static const struct pell_method_engine probe_engine = { .create = probe_create, .record = probe_render, .destroy = probe_destroy };
static const struct pell_method probe_method = {
    .name = "probe",
    .title = "Probe",
    .cite = "none",
    .limits = "none",
    .knobs = probe_knobs,
    .knobs_size = sizeof(struct probe_knobs),
    .plan = probe_plan,
    .cpu = &probe_engine,
};

static void furnish_plane(struct stage *s)
{
    size_t m;

    stage_gaussians(s, 1.0, &m);
    stage_box(s, m, 0, vec3(-30, -30, -20), vec3(30, 30, 0));
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 2.0f);
    stage_camera(s, vec3(0, 0, 100), vec3(0, 0, 0), 0.3f, 0.0f);
}

/* A method without transmitted light, without timings, and that needs positions. */
static void a_method_needs_only_three_functions(void **state)
{
    struct stage s;
    struct probe_knobs wrong = { 3.0f };

    (void) state;
    memset(&probe, 0, sizeof(probe));
    stage_start(&s, 32, 24);
    furnish_plane(&s);
    probe.needs = PELL_NEED_IRRADIANCE | PELL_NEED_POSITION | PELL_NEED_TRANSMISSION;
    OK(pell_renderer_set_method(s.r, &probe_method, NULL));
    stage_render(&s);
    REQUIRE(probe.positions_agree);
    REQUIRE_REL((double) s.image.channels[0].data[12 * s.image.stride + 16], 0.25 * 2.0 / PELL_PI, 1e-5);
    assert_int_equal(probe.creates, 1);
    stage_render(&s);
    assert_int_equal(probe.creates, 1);
    assert_int_equal(pell_renderer_set_method(s.r, &probe_method, &wrong), PELL_ERR_INVALID);
    stage_render(&s); /* the previous one still exists */
    assert_int_equal(probe.creates, 1);
    s.scene->cameras[0].fov = 0.2f;
    stage_render(&s);
    assert_int_equal(probe.creates, 2);
    REQUIRE_REL((double) probe.focal_px, 12.0 / tan(0.1), 1e-5);

    probe.needs = PELL_NEED_SCENE | PELL_NEED_POSITION | PELL_NEED_HIT | PELL_NEED_IRRADIANCE;
    probe.scene = s.scene;
    OK(pell_renderer_set_method(s.r, &probe_method, NULL));
    stage_render(&s);
    REQUIRE(probe.positions_agree && probe.hits_agree);

    probe.needs = PELL_NEED_SHADED;
    probe.quantity = PELL_QUANTITY_RADIANCE;
    OK(pell_renderer_set_method(s.r, &probe_method, NULL));
    stage_render(&s);
    REQUIRE_REL((double) s.image.channels[0].data[12 * s.image.stride + 16], 0.25 * 0.8 * 2.0 / PELL_PI, 1e-5);
    stage_finish(&s);
    assert_int_equal(probe.destroys, probe.creates);
}

static void a_failing_method_fails_the_frame_alone(void **state)
{
    struct stage s;

    (void) state;
    memset(&probe, 0, sizeof(probe));
    stage_start(&s, 32, 24);
    furnish_plane(&s);
    probe.needs = PELL_NEED_IRRADIANCE;
    probe.fail_create = true;
    OK(pell_renderer_set_method(s.r, &probe_method, NULL));
    stage_complete(&s);
    OK(pell_renderer_set_scene(s.r, s.scene));
    s.set = true;
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_INVALID);
    probe.fail_create = false;
    probe.fail_render = true;
    assert_int_equal(pell_renderer_render(s.r, &s.settings, &s.image), PELL_ERR_FORMAT);
    probe.fail_render = false;
    stage_render(&s);
    stage_finish(&s);
    assert_int_equal(probe.destroys, probe.creates);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_allocation_after_the_first_frame),
        cmocka_unit_test(nth_allocation_fails_from_file_to_file),
        cmocka_unit_test(a_renderer_survives_want_of_memory),
        cmocka_unit_test(the_same_bits_on_any_number_of_threads),
        cmocka_unit_test(renderers_share_a_scene_and_a_device),
        cmocka_unit_test(a_picture_has_no_history),
        cmocka_unit_test(a_method_sees_nothing_of_the_frame_before),
        cmocka_unit_test(a_camera_may_zoom_between_frames),
        cmocka_unit_test(lights_may_move_between_frames),
        cmocka_unit_test(settings_out_of_range_are_refused),
        cmocka_unit_test(cameras_that_show_nothing_are_refused),
        cmocka_unit_test(lights_out_of_range_are_refused),
        cmocka_unit_test(what_is_missing_is_named),
        cmocka_unit_test(a_background_of_one_colour_is_shown_flat),
        cmocka_unit_test(a_scene_without_objects_is_its_background),
        cmocka_unit_test(cancelling_ends_a_frame_soon),
        cmocka_unit_test(a_method_needs_only_three_functions),
        cmocka_unit_test(a_failing_method_fails_the_frame_alone),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
