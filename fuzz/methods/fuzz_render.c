/* SPDX-License-Identifier: MIT
 * fuzz_render.c - from a scene file to pixels: the first byte selects the method, the rest is the file. An accepted scene is rendered at
 * a small size, with the file's own options, and all radiances must be finite. Every mesh path is a tetrahedron of two materials with
 * texture coordinates; a render is cancelled after a second. */
#include "fuzz_scene.h"

#include <pellucid/method.h>
#include <pellucid/render.h>

#include <pthread.h>
#include <time.h>

enum { WIDTH = 12, HEIGHT = 8, PATIENCE_MS = 1000 };

static uint8_t chosen;

/* --- Limited to a second ------------------------------------------------------------------------------------------------------------ */

static struct {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    struct pell_context *ctx; /* the one that is rendering, or NULL */
    unsigned run;
} watch = { .lock = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER };

static void *watch_over(void *unused)
{
    pthread_mutex_lock(&watch.lock);
    for (;;) {
        const unsigned run = watch.run;
        struct timespec until;
        clock_gettime(CLOCK_REALTIME, &until);
        until.tv_sec += PATIENCE_MS / 1000;
        while (watch.run == run && pthread_cond_timedwait(&watch.changed, &watch.lock, &until) == 0)
            ;
        if (watch.run == run && watch.ctx)
            pell_context_cancel(watch.ctx);
    }
    return unused;
}

static void begin(struct pell_context *ctx)
{
    static pthread_t thread;
    static bool started;

    if (!started)
        require(pthread_create(&thread, NULL, watch_over, NULL) == 0);
    started = true;
    pthread_mutex_lock(&watch.lock);
    watch.ctx = ctx;
    watch.run++;
    pthread_cond_signal(&watch.changed);
    pthread_mutex_unlock(&watch.lock);
}

/* --- The options of the file --------------------------------------------------------------------------------------------------------- */

/* Invalid options are refused, which is not an error here. */
static void read_options(const struct pell_scene *scene, const struct pell_method *method, void *knobs, struct pell_settings *settings)
{
    for (size_t i = 0; i < scene->num_options; i++) {
        const struct pell_scene_option *o = &scene->options[i];
        const struct pell_setting knob = { o->name + 6, o->value, o->where };
        enum pell_result res = PELL_OK;
        if (strncmp(o->name, "knobs/", 6) != 0)
            res = pell_knob_set(scene->ctx, pell_settings_knobs(), "render", o->where, settings, o->name, o->value);
        else if (method)
            res = pell_method_configure(scene->ctx, method, &knob, 1, knobs);
        require(res == PELL_OK || res == PELL_ERR_INVALID || res == PELL_ERR_NOMEM);
    }
    settings->width = WIDTH;
    settings->height = HEIGHT;
}

static void draw(const struct pell_scene *scene)
{
    const size_t count = pell_method_count();
    const struct pell_method *method = chosen % (count + 1) == count ? NULL : pell_method_at(chosen % (count + 1));
    struct pell_device_params params = { .threads = 1 };
    struct pell_settings settings;
    struct pell_device *device = NULL;
    struct pell_renderer *renderer = NULL;
    struct pell_render_result image = { 0 };
    void *knobs = NULL;
    enum pell_result res;

    PELL_TRY(pell_device_create(scene->ctx, &params, &device));
    PELL_TRY(pell_renderer_create(device, &renderer));
    if (method)
        PELL_TRY(pell_method_knobs_create(scene->ctx, method, NULL, &knobs));
    pell_settings_default(method, knobs, &settings);
    settings.msaa = settings.light_samples = 1;
    settings.indirect_samples = 64;
    read_options(scene, method, knobs, &settings);
    begin(scene->ctx);
    PELL_TRY(pell_renderer_set_method(renderer, method, knobs));
    PELL_TRY(pell_renderer_set_scene(renderer, scene));
    PELL_TRY(pell_renderer_render(renderer, &settings, &image));
    require(image.width == WIDTH && image.height == HEIGHT);
    for (size_t c = 0; c < image.num_channels; c++)
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++)
                require(!isnan(image.channels[c].data[y * image.stride + x]));

fail:
    begin(NULL);
    pell_renderer_destroy(&renderer);
    pell_method_knobs_destroy(scene->ctx, &knobs);
    pell_device_destroy(&device);
}

static enum pell_result read_mesh(void *user, struct pell_context *ctx, const char *path, uint8_t **data, size_t *size)
{
    static const char mesh[] = "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nusemtl Skin\nf 1/1 3/3 2/2\n"
                               "f 1/1 2/2 4/4\nusemtl Cloth\nf 2/2 3/3 4/4\nf 1/1 4/4 3/3\n";
    static const char material[] = "{\"sigma_a\":[0.1,0.2,0.3],\"sigma_s_reduced\":[1,2,3]}";
    const char *text = strstr(path, ".json") ? material : mesh;
    (void) user;

    *size = strlen(text);
    *data = (uint8_t *) pell_strdup(ctx, text);
    return *data ? PELL_OK : PELL_ERR_NOMEM;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const struct pell_load_params params;

    if (size < 2)
        return 0;
    chosen = data[0];
    load_for("fuzz.json", data + 1, size - 1, read_mesh, &params, draw);
    return 0;
}
