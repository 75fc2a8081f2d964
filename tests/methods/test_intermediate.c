/* SPDX-License-Identifier: MIT
 * test_intermediate.c - the intermediate images of every method: named and described correctly, finite, consistent with the final image,
 * and without an effect on it. */
#include "stage.h"

#include <stdlib.h>

enum { MOST = 96 };

struct seen {
    char name[MOST][64];
    int width[MOST], height[MOST], components[MOST];
    float *data[MOST]; /* planes after each other */
    struct pell_intermediate_gaussian gaussian[MOST];
    char unit[MOST][16];
    int count, fail_at;
};

/* Planes of a frame have the description and, but for the method's result, the unit of their row. */
static void check_plane(const struct pell_intermediate *image)
{
    for (int i = 0; i < PELL_PLANES; i++) {
        const struct pell_plane_info *p = pell_plane_at(i);
        if (strcmp(image->name + strlen("frame."), p->name) != 0)
            continue;
        assert_string_equal(image->what, p->what);
        assert_true(i == PELL_PLANE_LIGHT || strcmp(image->unit, p->unit) == 0);
        return;
    }
    fail_msg("%s is no plane of a frame", image->name);
}

static enum pell_result show(void *user, const struct pell_intermediate *image)
{
    struct seen *s = user;
    const size_t size = (size_t) image->width * (size_t) image->height;

    if (s->count == s->fail_at)
        return PELL_ERR_IO;
    assert_true(s->count < MOST && image->width > 0 && image->height > 0 && image->stride >= image->width);
    assert_true(image->components >= 1 && image->components <= 3 && (!image->color || image->components == 3));
    assert_true(strlen(image->unit) > 0 && strlen(image->what) > 0 && strlen(image->name) < sizeof(s->name[0]));
    assert_int_equal(strspn(image->name, "abcdefghijklmnopqrstuvwxyz0123456789.-"), strlen(image->name));
    for (int i = 0; i < s->count; i++)
        assert_string_not_equal(s->name[i], image->name);
    if (strncmp(image->name, "frame.", strlen("frame.")) == 0)
        check_plane(image);
    assert_int_equal(image->num_gaussians, strstr(image->name, ".blur-") ? 1 : 0); /* the scenes have one material */
    assert_true(strstr(image->name, "-0") == NULL);                                /* numbers in names begin at 1 */
    for (size_t i = 0; i < image->num_gaussians; i++) {
        const struct pell_intermediate_gaussian *g = &image->gaussians[i];
        const bool step = strstr(image->name, ".step-") != NULL;
        assert_true(g->variance > 0.0 && strlen(g->material) > 0);
        assert_true(!step || (g->weight[0] == 0.0 && g->weight[1] == 0.0 && g->weight[2] == 0.0));
        s->gaussian[s->count] = *g;
        s->gaussian[s->count].material = NULL; /* it lives during the call */
    }
    snprintf(s->unit[s->count], sizeof(s->unit[0]), "%s", image->unit);
    strcpy(s->name[s->count], image->name);
    s->width[s->count] = image->width;
    s->height[s->count] = image->height;
    s->components[s->count] = image->components;
    assert_non_null(s->data[s->count] = malloc(size * (size_t) image->components * sizeof(float)));
    for (int c = 0; c < image->components; c++)
        for (int y = 0; y < image->height; y++)
            for (int x = 0; x < image->width; x++) {
                const float v = image->planes[c][y * image->stride + x];
                assert_true(isfinite(v));
                s->data[s->count][(size_t) c * size + (size_t) (y * image->width + x)] = v;
            }
    s->count++;
    return PELL_OK;
}

static void forget(struct seen *s)
{
    for (int i = 0; i < s->count; i++)
        free(s->data[i]);
    *s = (struct seen) { .fail_at = -1 };
}

static int look_for(const struct seen *s, const char *name)
{
    for (int i = 0; i < s->count; i++)
        if (strcmp(s->name[i], name) == 0)
            return i;
    return -1;
}

static int find(const struct seen *s, const char *name)
{
    const int i = look_for(s, name);

    if (i < 0)
        fail_msg("there is no image %s", name);
    return i;
}

static double sum_of(const struct seen *s, int image)
{
    const size_t size = (size_t) s->width[image] * (size_t) s->height[image] * (size_t) s->components[image];
    double sum = 0.0;

    for (size_t i = 0; i < size; i++)
        sum += (double) s->data[image][i];
    return sum;
}

/* A ball between a light from the side and one from behind. */
static void start(struct stage *s, const char *method)
{
    size_t m;

    stage_start(s, 48, 40);
    if (strcmp(method, "layered") == 0) /* which requires a medium */
        stage_medium(s, "ketchup", &m);
    else
        stage_gaussians(s, 0.3, &m);
    stage_ball(s, m, 0, vec3(0, 0, 0), 12.0f, 12);
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(100, 30, 60), vec3(0, 0, 0), 1.0f);
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(-20, 10, -100), vec3(0, 0, 0), 1.0f);
    stage_camera(s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 14.0f);
}

static void render_observed(struct stage *s, struct seen *seen, struct shot *shot)
{
    const struct pell_observer observer = { show, seen };

    forget(seen);
    pell_renderer_set_observer(s->r, &observer);
    *shot = stage_shot(s);
    pell_renderer_set_observer(s->r, NULL);
}

static void every_method_shows_its_images_and_stays_what_it_is(void **state)
{
    static const struct {
        const char *method, *knobs[4], *images[8], *not_shown;
        bool radiance; /* of the result */
    } cases[] = {
        { "screen-space", { "gaussians=3", NULL }, { "frame.irradiance", "frame.light", "screen-space.blur-1", "screen-space.blur-3" } },
        { "screen-space", { "input=lit", NULL }, { "frame.shaded", "screen-space.blur-1" }, .radiance = true },
        { "screen-space",
          { "kernel=separable", "rank=2", NULL },
          { "screen-space.kernel-1", "screen-space.kernel-2" },
          "screen-space.blur-1" },
        { "texture-space",
          { "size=128", NULL },
          { "texture-space.texel-size", "texture-space.light-1.irradiance", "texture-space.light-1.thickness",
            "texture-space.light-1.blur-1", "texture-space.light-2.blur-1", "texture-space.exitance" },
          "texture-space.light-3.blur-1" },
        { "texture-space",
          { "size=128", "as=paper", NULL },
          { "texture-space.irradiance", "texture-space.light-1.thickness", "texture-space.light-2.thickness", "texture-space.blur-2" },
          "texture-space.light-1.blur-2" },
        { "image-space", { NULL }, { "image-space.material-1.samples" } },
        { "image-space",
          { "views=eye+lights", "view-size=64", NULL },
          { "image-space.view-1.irradiance", "image-space.view-2.irradiance" } },
        { "layered", { NULL }, { "layered.plane-normal", "layered.plane-distance", "layered.bottom-1" }, .radiance = true },
        { "convolution", { NULL }, { "convolution.plane-1.irradiance", "convolution.plane-4.exitance" } },
        { "convolution", { "as=paper", NULL }, { "convolution.plane-2.irradiance" } },
        { "hierarchical", { NULL }, { "frame.light" } },
    };
    struct seen seen = { .fail_at = -1 };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct stage s;
        struct shot plain, shot, again;
        start(&s, cases[i].method);
        s.settings.msaa = 2;
        plain = stage_shot_of(&s, cases[i].method, cases[i].knobs);
        render_observed(&s, &seen, &shot);
        assert_true(shot_equal(&plain, &shot));
        for (int k = 0; cases[i].images[k]; k++)
            find(&seen, cases[i].images[k]);
        assert_true(!cases[i].not_shown || look_for(&seen, cases[i].not_shown) < 0);
        assert_string_equal(seen.unit[find(&seen, "frame.light")], cases[i].radiance ? "W/(m^2 sr)" : "W/m^2");
        again = stage_shot(&s);
        assert_true(shot_equal(&plain, &again));
        shot_free(&again);
        shot_free(&shot);
        shot_free(&plain);
        stage_finish(&s);
    }
    forget(&seen);
}

/* M is the sum of the blurred images by the weights that they are shown with. */
static void blurs_of_screen_space_add_up_to_its_light(void **state)
{
    static const char *const knobs[] = { "through=off", "lod=100", NULL }; /* no Gaussian is omitted */
    struct seen seen = { .fail_at = -1 };
    struct stage s;
    struct shot shot;
    double worst = 0.0, most = 0.0;
    int light, blur[3];

    (void) state;
    start(&s, "screen-space");
    shot = stage_shot_of(&s, "screen-space", knobs);
    shot_free(&shot);
    render_observed(&s, &seen, &shot);
    light = find(&seen, "frame.light");
    for (int k = 0; k < 3; k++) {
        char name[64];
        snprintf(name, sizeof(name), "screen-space.blur-%d", k + 1);
        blur[k] = find(&seen, name);
        REQUIRE_NEAR(seen.gaussian[blur[k]].variance, s.scene->materials[0].gaussians.variance[k], 1e-6);
    }
    for (size_t i = 0; i < 3 * 48 * 40; i++) {
        double sum = 0.0;
        for (int k = 0; k < 3; k++)
            sum += seen.gaussian[blur[k]].weight[i / (48 * 40)] * (double) seen.data[blur[k]][i];
        worst = fmax(worst, fabs(sum - (double) seen.data[light][i]));
        most = fmax(most, (double) seen.data[light][i]);
    }
    print_message("# of %.3f at most, M and its blurs differ by %.2g\n", most, worst);
    REQUIRE(most > 0.1 && worst < 1e-5 * most);
    forget(&seen);
    shot_free(&shot);
    stage_finish(&s);
}

/* Without transmission the exitance is the sum of the blurred maps by their weights. A Gaussian narrower than a texel has no image: its
 * weight is that of the image before it. The third Gaussian is so wide that two blurs without weight precede it. */
static void blurs_of_texture_space_add_up_to_its_exitance(void **state)
{
    static const char *const knobs[] = { "size=128", "charts=planar", "tsm=off", NULL };
    struct seen seen = { .fail_at = -1 };
    struct stage s;
    struct shot shot;
    const struct pell_gaussians *g;
    double worst = 0.0, most = 0.0;
    int exitance, blur[3], shown = 0;

    (void) state;
    start(&s, "texture-space");
    s.scene->materials[0].gaussians.variance[2] *= 6.0;
    g = &s.scene->materials[0].gaussians;
    shot = stage_shot_of(&s, "texture-space", knobs);
    shot_free(&shot);
    render_observed(&s, &seen, &shot);
    exitance = find(&seen, "texture-space.exitance");
    for (int k = 0; k < 3; k++) {
        char name[64];
        int image;
        snprintf(name, sizeof(name), "texture-space.blur-%d", k + 1);
        image = look_for(&seen, name);
        blur[k] = image >= 0 ? image : k > 0 ? blur[k - 1] : find(&seen, "texture-space.irradiance");
        for (int c = 0; c < 3 && image >= 0; c++)
            REQUIRE(seen.gaussian[image].weight[c] == g->weight[k][c]);
        REQUIRE(image < 0 || seen.gaussian[image].variance == g->variance[k]);
        shown += image >= 0;
    }
    for (int k = 1; k <= 2; k++) {
        char name[64];
        snprintf(name, sizeof(name), "texture-space.blur-3.step-%d", k);
        REQUIRE_NEAR(seen.gaussian[find(&seen, name)].variance, g->variance[1] * pow(24.0, k / 3.0), 1e-6);
    }
    for (int i = 0; i < 3 * seen.width[exitance] * seen.height[exitance]; i++) {
        const int c = i / (seen.width[exitance] * seen.height[exitance]);
        double sum = 0.0;
        for (int k = 0; k < 3; k++)
            sum += g->weight[k][c] * (double) seen.data[blur[k]][i];
        worst = fmax(worst, fabs(sum - (double) seen.data[exitance][i]));
        most = fmax(most, (double) seen.data[exitance][i]);
    }
    print_message("# of %.3f at most, the exitance and %d blurs differ by %.2g\n", most, shown, worst);
    REQUIRE(shown >= 2 && most > 0.1 && worst < 1e-5 * most);
    forget(&seen);
    shot_free(&shot);
    stage_finish(&s);
}

/* The light assigned to the depth planes is all light that enters, times the area that it enters; the planes emit this light times the
 * profile's total. */
static void planes_of_convolution_share_out_the_light(void **state)
{
    static const char *const knobs[] = { "surfaces=1", "visible=off", "restore=off", "threshold=0", NULL };
    struct seen seen = { .fail_at = -1 };
    struct stage s;
    struct shot shot;
    double in = 0.0, out = 0.0;

    (void) state;
    start(&s, "convolution");
    shot = stage_shot_of(&s, "convolution", knobs);
    shot_free(&shot);
    render_observed(&s, &seen, &shot);
    for (int k = 1; k <= 4; k++) {
        char name[64];
        snprintf(name, sizeof(name), "convolution.plane-%d.irradiance", k);
        in += sum_of(&seen, find(&seen, name));
        snprintf(name, sizeof(name), "convolution.plane-%d.exitance", k);
        out += sum_of(&seen, find(&seen, name));
    }
    print_message("# planes are given %.3f and send %.3f\n", in, out);
    REQUIRE(in > 0.0 && out > 0.1 * in && out < 4.0 * in); /* each of the four receives a part of all light */
    forget(&seen);
    shot_free(&shot);
    stage_finish(&s);
}

/* At the light's direction the ball is nearly as thick as it is deep. */
static void thickness_is_that_of_the_object(void **state)
{
    static const char *const knobs[] = { "size=128", "charts=planar", NULL };
    struct seen seen = { .fail_at = -1 };
    struct stage s;
    struct shot shot;
    double most = 0.0;
    int image;

    (void) state;
    start(&s, "texture-space");
    shot = stage_shot_of(&s, "texture-space", knobs);
    shot_free(&shot);
    render_observed(&s, &seen, &shot);
    image = find(&seen, "texture-space.light-1.thickness");
    for (int i = 0; i < seen.width[image] * seen.height[image]; i++)
        most = fmax(most, (double) seen.data[image][i]);
    print_message("# the ball of 24 mm transmits through %.2f mm at most\n", most);
    REQUIRE(most > 4.0 && most < 24.5); /* beyond several widths of its Gaussians nothing is transmitted */
    forget(&seen);
    shot_free(&shot);
    stage_finish(&s);
}

/* The resolution of maps follows from the image; their content depends only on the camera and the first frame, not on frames in between. */
static void maps_are_as_fine_as_the_picture_needs(void **state)
{
    RELEASE_ONLY();
    static const char *const none[] = { NULL };
    static const float distance[] = { 100.0f, 30.0f, 400.0f, 100.0f };
    struct seen seen = { .fail_at = -1 };
    struct stage s;
    struct shot shot, first = { 0 };
    int side[PELL_COUNT(distance)];

    (void) state;
    start(&s, "texture-space");
    stage_camera(&s, vec3(0, 0, 60), vec3(0, 0, 0), 0.4f, 0.0f);
    shot = stage_shot_of(&s, "texture-space", none);
    for (size_t i = 0; i < PELL_COUNT(distance); i++) {
        int image;
        shot_free(&shot);
        stage_camera(&s, vec3(0, 0, distance[i]), vec3(0, 0, 0), 0.4f, 0.0f);
        render_observed(&s, &seen, &shot);
        image = find(&seen, "texture-space.light-1.thickness");
        side[i] = seen.width[image];
        if (i == 0) {
            first = shot;
            shot = (struct shot) { 0 };
        }
    }
    print_message("# %d texels at 100 mm, %d at 30, %d at 400, %d at 100 again\n", side[0], side[1], side[2], side[3]);
    REQUIRE(side[1] > 2 * side[0] && side[1] <= 1024 && side[0] > 2 * side[2] && side[3] == side[0]);
    REQUIRE(shot_difference(&first, &shot).rms == 0.0);
    forget(&seen);
    shot_free(&shot);
    shot_free(&first);
    stage_finish(&s);
}

static void an_observer_ends_the_frame(void **state)
{
    static const char *const methods[] = { "screen-space", "texture-space", "image-space", "layered", "convolution" };
    static const char *const knobs[] = { NULL };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(methods); i++)
        for (int at = 0; at < 12; at += 3) {
            struct seen seen = { .fail_at = at };
            const struct pell_observer observer = { show, &seen };
            struct stage s;
            struct shot shot;
            start(&s, methods[i]);
            shot = stage_shot_of(&s, methods[i], knobs);
            pell_renderer_set_observer(s.r, &observer);
            if (pell_renderer_render(s.r, &s.settings, &s.image) == PELL_OK)
                assert_true(seen.count <= at); /* it has fewer images */
            pell_renderer_set_observer(s.r, NULL);
            shot_free(&shot);
            shot = stage_shot(&s); /* the renderer is still usable */
            shot_free(&shot);
            forget(&seen);
            stage_finish(&s);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_method_shows_its_images_and_stays_what_it_is),
        cmocka_unit_test(blurs_of_screen_space_add_up_to_its_light),
        cmocka_unit_test(blurs_of_texture_space_add_up_to_its_exitance),
        cmocka_unit_test(planes_of_convolution_share_out_the_light),
        cmocka_unit_test(thickness_is_that_of_the_object),
        cmocka_unit_test(maps_are_as_fine_as_the_picture_needs),
        cmocka_unit_test(an_observer_ends_the_frame),
    };
    return cmocka_run_group_tests_name("methods.intermediate", tests, NULL, NULL);
}
