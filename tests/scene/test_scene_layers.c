/* SPDX-License-Identifier: MIT
 * test_scene_layers.c - painted layers of a scene file's materials, and of scenes built by hand. */
#include "scene_test.h"

#include "base/file.h"
#include "scene/layers.h"

#define OK(expr) assert_int_equal(expr, PELL_OK)

/* --- A folder of images ------------------------------------------------------------------------------------------------------- */

struct folder {
    struct kept_messages kept;
    struct pell_context *ctx;
    char path[256];
};

static void write_bytes(struct folder *f, const char *name, const void *data, size_t size)
{
    char path[512];

    snprintf(path, sizeof(path), "%s/%s", f->path, name);
    OK(pell_file_write(f->ctx, path, data, size));
}

/* PNG stores display values: returns the value that decodes to x. */
static float shown_as(float x)
{
    return x <= 0.04045f ? x / 12.92f : powf((x + 0.055f) / 1.055f, 2.4f);
}

static void write_picture(struct folder *f, const char *name, const float (*pixel)[4], int channels, int bits, bool full)
{
    static const char *const names[] = { "R", "G", "B", "A" };
    struct pell_channel channel[4];
    float plane[4][4];
    char path[512];
    const struct pell_write_params params = {
        .width = 2, .height = 2, .channels = channel, .num_channels = (size_t) channels, .png_bits = bits
    };

    for (int c = 0; c < channels; c++) {
        for (int i = 0; i < 4; i++)
            plane[c][i] = bits && c < 3 ? shown_as(pixel[i][c]) : pixel[i][c];
        channel[c] = (struct pell_channel) { channels == 1 ? "Y" : names[c], plane[c], 2, full };
    }
    snprintf(path, sizeof(path), "%s/%s", f->path, name);
    OK(pell_image_write(f->ctx, path, NULL, &params));
}

/* One channel of unmodified floats: bottom row first. */
static void write_pfm(struct folder *f, const char *name, const float value[4])
{
    char bytes[64];
    const int head = snprintf(bytes, sizeof(bytes), "Pf\n2 2\n-1.0\n");

    memcpy(bytes + head, value, 4 * sizeof(float));
    write_bytes(f, name, bytes, (size_t) head + 4 * sizeof(float));
}

static void folder_start(struct folder *f)
{
    static const float bytes[4][4] = {
        { 0.0f, 0.25f, 0.5f, 1.0f },
        { 0.1f, 0.3f, 0.6f, 1.0f },
        { 0.2f, 0.2f, 0.7f, 1.0f },
        { 0.3f, 0.4f, 0.8f, 0.9f },
    };
    static const float half[4][4] = {
        { 0.5f, 2.0f, 3.0f, 0.25f },
        { 0.5f, 2.0f, 3.0f, 0.25f },
        { 0.5f, 2.0f, 3.0f, 0.25f },
        { 1.5f, 2.0f, 3.0f, 0.25f },
    };

    memset(f, 0, sizeof(*f));
    f->ctx = test_context(NULL, &f->kept);
    snprintf(f->path, sizeof(f->path), "%s/pell-layers-XXXXXX", getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp");
    assert_non_null(mkdtemp(f->path));
    write_bytes(f, "c.obj", CUBE, strlen(CUBE));
    write_picture(f, "four.png", bytes, 4, 8, false);
    write_picture(f, "four16.png", bytes, 4, 16, false);
    write_picture(f, "grey.png", bytes, 1, 16, false);
    write_picture(f, "half.exr", half, 4, 0, false);
    write_picture(f, "full.exr", half, 3, 0, true);
    write_pfm(f, "good.pfm", (const float[4]) { 0.0f, 1.0f, 4.0f, 2.0f });
    write_pfm(f, "nan.pfm", (const float[4]) { 1.0f, NAN, 1.0f, 1.0f });
    write_pfm(f, "endless.pfm", (const float[4]) { 1.0f, 1.0f, INFINITY, 1.0f });
    write_pfm(f, "below.pfm", (const float[4]) { 1.0f, 1.0f, 1.0f, -0.5f });
    write_bytes(f, "empty.pfm", "Pf\n0 0\n-1.0\n", 12);
    write_bytes(f, "broken.png", "\x89PNG\r\n\x1a\nbroken", 14);
}

static void folder_finish(struct folder *f)
{
    static const char *const names[] = { "c.obj",   "four.png",    "four16.png", "grey.png",  "half.exr",   "full.exr", "good.pfm",
                                         "nan.pfm", "endless.pfm", "below.pfm",  "empty.pfm", "broken.png", "s.json" };
    char path[512];

    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        snprintf(path, sizeof(path), "%s/%s", f->path, names[i]);
        remove(path);
    }
    assert_int_equal(rmdir(f->path), 0);
    assert_int_equal(pell_memory_used(f->ctx), 0);
    pell_context_destroy(&f->ctx);
}

static enum pell_result load(struct folder *f, const char *material, struct pell_scene **s)
{
    const struct pell_load_params params = { .bare = true };
    char text[4096], path[512];

    snprintf(text, sizeof(text), "{\"pellucid\":1,\"mesh\":\"c.obj\",\"unit\":\"1mm\",\"materials\":{\"*\":{%s}}}", material);
    write_bytes(f, "s.json", text, strlen(text));
    snprintf(path, sizeof(path), "%s/s.json", f->path);
    return pell_scene_load(f->ctx, path, &params, s);
}

static struct pell_scene *must_load(struct folder *f, const char *material)
{
    struct pell_scene *s;

    if (load(f, material, &s) != PELL_OK)
        fail_msg("%s\nrefused: %s: %s", material, f->kept.where, f->kept.what);
    return s;
}

#define SIGMA "\"sigma_s\":[1,2,3],\"sigma_t\":[2,3,4]"

/* --- Reading ------------------------------------------------------------------------------------------------------------------ */

static void coefficients_and_phases(void **state)
{
    struct folder f;
    struct pell_scene *s;
    const struct pell_scene_layer *l;
    (void) state;

    folder_start(&f);
    s = must_load(&f, "\"eta\":1.35,\"layers\":["
                      "{\"name\":\"a\",\"sigma_s\":[2,1,1],\"sigma_t\":[2.5,1.5,1.5],\"phase\":\"schlick\",\"g\":0.25,\"depth\":\"1mm\"},"
                      "{\"sigma_a\":[1,2,3],\"sigma_s\":[4,5,6],\"g\":[0.1,0.2,0.3],\"depth\":\"0.2cm\"},"
                      "{\"sigma_a\":[0,0,0],\"sigma_t\":[0,0,0],\"phase\":\"rayleigh\",\"depth\":\"2mm\"},"
                      "{\"sigma_a\":[1,1,1],\"sigma_t\":[4,4,4],\"phase\":\"two-lobe\",\"g\":[0.9,-0.3],\"weight\":0.75}]");
    assert_int_equal(s->materials[0].num_layers, 4);
    assert_false(s->materials[0].opaque);
    assert_int_equal(s->materials[0].substrate, PELL_SUBSTRATE_LAST);
    REQUIRE_NEAR(s->materials[0].medium.eta, 1.35, 0.0);
    assert_null(s->materials[0].preset);
    l = s->materials[0].layers;
    assert_string_equal(l[0].name, "a");
    assert_int_equal(l[0].phase[1].kind, PELL_PHASE_SCHLICK);
    REQUIRE_NEAR(l[0].phase[1].g[0], 0.25, 0.0);
    REQUIRE_NEAR(l[0].medium.g[1], pell_phase_mean_cosine(&l[0].phase[1]), 0.0); /* 0.169, not k */
    REQUIRE_NEAR(l[0].medium.sigma_s_reduced[0], 2.0 * (1.0 - l[0].medium.g[0]), 1e-15);
    REQUIRE_NEAR(l[0].medium.sigma_a[0], 0.5, 1e-15);
    REQUIRE_NEAR(l[1].medium.sigma_s_reduced[2], 6.0 * 0.7, 1e-15);
    REQUIRE_NEAR(l[1].medium.sigma_a[2], 3.0, 0.0);
    REQUIRE_NEAR((double) l[1].depth, 2.0, 1e-6);
    assert_int_equal(l[2].phase[0].kind, PELL_PHASE_RAYLEIGH);
    REQUIRE_NEAR(l[3].medium.g[0], 0.75 * 0.9 - 0.25 * 0.3, 1e-12);
    REQUIRE(l[3].depth == INFINITY);
    pell_scene_destroy(&s);
    folder_finish(&f);
}

static void depths_by_pictures(void **state)
{
    struct pell_layer_measure measure[PELL_LAYERS_MOST];
    struct folder f;
    struct pell_scene *s;
    const struct pell_scene_layer *l;
    (void) state;

    folder_start(&f);
    s = must_load(&f, "\"textures\":{\"baseColor\":\"four.png\"},\"color_from\":\"texture\",\"below\":\"stop\",\"layers\":["
                      "{" SIGMA ",\"depth\":\"four.png#r\",\"depth_scale\":\"4mm\"},"
                      "{" SIGMA ",\"depth\":\"four16.png#b\",\"depth_scale\":\"0.4cm\"},"
                      "{" SIGMA ",\"depth\":\"half.exr#g\",\"depth_scale\":\"2mm\"},"
                      "{" SIGMA ",\"depth\":\"grey.png\",\"depth_scale\":\"10mm\",\"depth_encoding\":\"inverse\"},"
                      "{" SIGMA ",\"depth\":\"baseColor.a\",\"depth_scale\":\"20mm\"},"
                      "{" SIGMA ",\"depth\":\"good.pfm\",\"depth_scale\":\"50mm\"}]");
    l = s->materials[0].layers;
    assert_int_equal(s->materials[0].substrate, PELL_SUBSTRATE_STOP);
    assert_int_equal(l[1].depth_map.channel, 2);
    REQUIRE_NEAR((double) l[1].depth, 4.0, 1e-6);
    assert_false(l[0].depth_map.texture->image.srgb); /* numbers */
    REQUIRE(l[0].depth_map.texture != s->materials[0].base_color_map.texture && s->materials[0].base_color_map.texture->image.srgb);
    assert_ptr_equal(l[4].depth_map.texture, s->materials[0].base_color_map.texture);
    assert_int_equal(l[4].depth_map.channel, 3);
    REQUIRE(l[3].depth_inverse && !l[2].depth_inverse);
    assert_int_equal(pell_scene_layers_measure(&s->materials[0], measure), 4);
    REQUIRE_NEAR(measure[0].min, 0.0, 1e-6);
    REQUIRE_NEAR(measure[0].max, 4.0 * 0.3, 4.0 / 255 + 1e-6);
    REQUIRE_NEAR(measure[1].mean, 4.0 * 0.65, 2e-4);
    REQUIRE_NEAR(measure[2].mean, 4.0, 1e-6); /* floats may exceed 1 */
    REQUIRE_NEAR(measure[3].max, 10.0, 1e-3);
    REQUIRE_NEAR(measure[3].mean, 8.5, 1e-3);
    REQUIRE_NEAR(measure[5].max, 200.0, 1e-3);
    pell_scene_destroy(&s);
    folder_finish(&f);
}

static void one_picture_paints_four_layers(void **state)
{
    struct folder f;
    struct pell_scene *s;
    (void) state;

    folder_start(&f);
    s = must_load(&f, "\"depths\":[\"half.exr\",\"four.png\"],\"depth_scale\":\"2mm\",\"layers\":[{" SIGMA "},{" SIGMA "},"
                      "{" SIGMA ",\"depth\":\"6mm\"},{" SIGMA ",\"depth_scale\":\"3mm\",\"depth_encoding\":\"inverse\"},{" SIGMA "}]");
    for (int i = 0; i < 5; i++) {
        const struct pell_scene_layer *l = &s->materials[0].layers[i];
        REQUIRE((l->depth_map.texture != NULL) == (i != 2));
        if (i == 2)
            continue;
        assert_int_equal(l->depth_map.channel, i % 4);
        assert_ptr_equal(l->depth_map.texture, i < 4 ? s->materials[0].layers[0].depth_map.texture : l->depth_map.texture);
        REQUIRE_NEAR((double) l->depth, i == 3 ? 3.0 : 2.0, 1e-6);
        assert_int_equal(l->depth_inverse, i == 3);
    }
    pell_scene_destroy(&s);
    folder_finish(&f);
}

static void broken_maps_are_refused_with_their_place(void **state)
{
    static const struct {
        const char *depth, *where, *what;
    } cases[] = {
        { "\"nan.pfm\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "texel (1, 1), channel r, is nan, allowed: [0," },
        { "\"endless.pfm\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "texel (0, 0), channel r, is inf, allowed: [0, 1e+06]" },
        { "\"below.pfm\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "texel (1, 0), channel r, is -0.5, allowed: [0," },
        { "\"good.pfm\",\"depth_scale\":\"1mm\",\"depth_encoding\":\"inverse\"", "/layers/0/depth", "is 4, allowed: [0, 1]" },
        { "\"good.pfm\",\"depth_scale\":\"900m\"", "/layers/0/depth", "is 4, allowed: [0, 1.11" },
        { "\"grey.png#g\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "has no channel g: the image has 1" },
        { "\"full.exr#a\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "has no channel a: the image has 3" },
        { "\"empty.pfm\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "can't be read" },
        { "\"broken.png\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "can't be read" },
        { "\"gone.png\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "" },
        { "\"01.png\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "" }, /* a file name, not a length */
        { "\"/etc/passwd\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "" },
        { "\"normal.r\",\"depth_scale\":\"1mm\"", "/layers/0/depth", "has no such texture" },
    };
    struct folder f;
    (void) state;

    folder_start(&f);
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        const int before = f.kept.errors;
        struct pell_scene *s;
        char text[512];
        enum pell_result res;
        snprintf(text, sizeof(text), "\"layers\":[{" SIGMA ",\"depth\":%s}]", cases[i].depth);
        res = load(&f, text, &s);
        if (res == PELL_OK || f.kept.errors != before + 1 || !strstr(f.kept.where, cases[i].where) || !strstr(f.kept.what, cases[i].what))
            fail_msg("%s -> %d, %d errors, %s: %s\nwanted %s: %s", text, res, f.kept.errors - before, f.kept.where, f.kept.what,
                     cases[i].where, cases[i].what);
        assert_null(s);
    }
    folder_finish(&f);
}

static void crossings_are_counted_and_warned_of_once(void **state)
{
    struct pell_layer_measure measure[PELL_LAYERS_MOST];
    struct folder f;
    struct pell_scene *s;
    (void) state;

    folder_start(&f);
    /* r is 0, 0.1, 0.2, 0.3 and g 0.25, 0.3, 0.2, 0.4: at half the scale r exceeds g at the last two texels. */
    s = must_load(&f, "\"layers\":[{" SIGMA ",\"depth\":\"four.png#r\",\"depth_scale\":\"4mm\"},"
                      "{" SIGMA ",\"depth\":\"four.png#g\",\"depth_scale\":\"2mm\"},{" SIGMA ",\"depth\":\"0.9mm\"}]");
    pell_scene_layers_measure(&s->materials[0], measure);
    assert_int_equal(measure[0].crossings, 0);
    assert_int_equal(measure[1].crossings, 2);
    assert_int_equal(measure[2].crossings, 1);
    REQUIRE_NEAR(measure[2].max, measure[0].max, 1e-6); /* the upper layer has precedence */
    assert_int_equal(f.kept.warnings, 1);
    REQUIRE(strstr(f.kept.last_warning, "layer 1") && strstr(f.kept.last_warning, "50 %"));
    pell_scene_destroy(&s);
    folder_finish(&f);
}

/* --- Layers as seen by diffusion methods -------------------------------------------------------------------------------------- */

#define FISH                                                                                                                               \
    "\"eta\":%g,\"layers\":[{\"sigma_s\":[2,1,1],\"sigma_a\":[0.6,0.6,0.6],\"phase\":\"schlick\",\"g\":0.25,%s},"                          \
    "{\"sigma_s\":[6,3,2],\"sigma_a\":[0.6,0.6,0.6],\"phase\":\"schlick\",\"g\":0.4,\"depth\":\"2mm\"},"                                   \
    "{\"sigma_s\":[1,1,2],\"sigma_a\":[0.5,0.5,0.5],\"phase\":\"schlick\",\"g\":0.8%s}]"

static void uniform_layers_reflect_what_the_preset_does(void **state)
{
    const struct pell_material_entry *fish = pell_material_find("fish");
    static const char *const ends[2][2] = { { "\"depth\":\"1.5mm\"", "" }, /* the mean of this map is 1.5 mm, too */
                                            { "\"depth\":\"good.pfm\",\"depth_scale\":\"0.8571428571mm\"", ",\"depth\":\"3mm\"" } };
    struct folder f;
    (void) state;

    folder_start(&f);
    for (int i = 0; i < 2; i++) {
        struct pell_scene *s;
        char text[1024];
        snprintf(text, sizeof(text), FISH, fish->medium.eta, ends[i][0], ends[i][1]);
        s = must_load(&f, text);
        assert_int_equal(s->materials[0].gaussians.count, fish->gaussians.count);
        for (int c = 0; c < 3 && i == 0; c++)
            REQUIRE_REL(pell_gaussians_total(&s->materials[0].gaussians, c), pell_gaussians_total(&fish->gaussians, c), 1e-6);
        pell_scene_destroy(&s);
    }
    /* A preset or coefficients given with layers are used for diffusion. */
    for (int i = 0; i < 2; i++) {
        struct pell_scene *s = must_load(&f, i == 0 ? "\"preset\":\"marble\",\"layers\":[{" SIGMA "}]"
                                                    : "\"sigma_a\":[1,1,1],\"sigma_s_reduced\":[2,2,2],\"layers\":[{" SIGMA "}]");
        assert_int_equal(s->materials[0].gaussians.count, 0);
        assert_int_equal(s->materials[0].num_layers, 1);
        REQUIRE_NEAR(s->materials[0].medium.sigma_a[0], i == 0 ? pell_material_find("marble")->medium.sigma_a[0] : 1.0, 0.0);
        pell_scene_destroy(&s);
    }
    folder_finish(&f);
}

/* A preset overrides the layers of "*"; layers override a preset. */
static void later_words_win(void **state)
{
    static const struct memory_file files[] = { { "two.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
                                                             "usemtl A\nf 1 4 3 2\nf 5 6 7 8\nusemtl B\nf 1 2 6 5\nf 2 3 7 6\nusemtl C\n"
                                                             "f 3 4 8 7\nf 4 1 5 8\n" },
                                                { NULL, NULL } };
    static const char text[] =
        "{\"pellucid\":1,\"mesh\":\"two.obj\",\"unit\":\"1mm\",\"materials\":{\"*\":{\"layers\":[{\"name\":\"x\"," SIGMA "}]},"
        "\"A\":{\"preset\":\"apple\"},\"B\":{\"sigma_a\":[1,1,1],\"sigma_s_reduced\":[1,1,1]},\"C\":{\"roughness\":0.5}}}";
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_scene *s;
    (void) state;

    OK(load_bytes(ctx, "s.json", text, strlen(text), NULL, files, &s));
    for (size_t i = 0; i < s->num_materials; i++) {
        const struct pell_material *m = &s->materials[i];
        if (m->name[0] == 'A' || m->name[0] == 'B')
            assert_int_equal(m->num_layers, 0);
        if (m->name[0] == 'C') {
            assert_int_equal(m->num_layers, 1);
            assert_string_equal(m->layers[0].name, "x");
            REQUIRE(m->gaussians.count > 0 && !m->opaque);
        }
    }
    pell_scene_destroy(&s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void as_many_as_there_may_be(void **state)
{
    struct kept_messages kept = { 0 };
    (void) state;

    for (int count = PELL_LAYERS_MOST; count <= PELL_LAYERS_MOST + 1; count++) {
        static const struct memory_file files[] = { { "c.obj", CUBE }, { NULL, NULL } };
        struct pell_context *ctx = test_context(NULL, &kept);
        char text[16384];
        size_t at = (size_t) sprintf(text, "{\"pellucid\":1,\"mesh\":\"c.obj\",\"unit\":\"1mm\",\"materials\":{\"*\":{\"layers\":[");
        struct pell_scene *s;
        enum pell_result res;
        for (int i = 0; i < count; i++)
            at += (size_t) sprintf(text + at, "%s{" SIGMA ",\"depth\":\"%dum\"}", i ? "," : "", 100 * (i + 1));
        sprintf(text + at, "]}}}");
        res = load_bytes(ctx, "s.json", text, strlen(text), NULL, files, &s);
        if (count == PELL_LAYERS_MOST) {
            OK(res);
            /* 64 layers of one medium have its reflectance. */
            for (int c = 0; c < 3; c++) {
                const struct pell_medium *m = &s->materials[0].layers[0].medium;
                const struct pell_dipole d =
                    pell_dipole_make(m->sigma_a[c], m->sigma_s_reduced[c], s->materials[0].medium.eta, PELL_FRESNEL_EXACT);
                REQUIRE_REL(pell_gaussians_total(&s->materials[0].gaussians, c), pell_dipole_total(&d), 1e-3);
            }
        } else {
            REQUIRE(res != PELL_OK && strstr(kept.where, "/layers") && strstr(kept.what, "64"));
        }
        pell_scene_destroy(&s);
        pell_context_destroy(&ctx);
    }
}

/* --- By hand ------------------------------------------------------------------------------------------------------------------ */

static struct pell_scene *by_hand(struct pell_context *ctx, const float *pixels)
{
    struct pell_scene *s;
    struct pell_texture *t;
    size_t mesh, material;
    static const float corners[9] = { 0, 0, 0, 1, 0, 0, 0, 1, 0 };

    OK(pell_scene_create(ctx, &s));
    OK(pell_scene_add_mesh(s, "m", &mesh));
    OK(pell_mesh_allocate(s, mesh, 3, 1));
    memcpy(s->meshes[0].position, corners, sizeof(corners));
    s->meshes[0].index[1] = 1;
    s->meshes[0].index[2] = 2;
    OK(pell_scene_add_material(s, "a", &material));
    s->meshes[0].material = 0;
    s->materials[0].opaque = false;
    OK(pell_scene_add_texture(s, "t", &t));
    t->image = (struct pell_image) { .width = 2, .height = 1, .channels = 1, .type = PELL_PIXEL_F32 };
    t->image.pixels = pell_alloc(ctx, 2 * sizeof(float));
    memcpy(t->image.pixels, pixels, 2 * sizeof(float));
    OK(pell_material_allocate_layers(s, 0, 3));
    for (int i = 0; i < 3; i++) {
        struct pell_scene_layer *l = &s->materials[0].layers[i];
        l->depth = 1.0f + (float) i;
        for (int c = 0; c < 3; c++) {
            l->medium.sigma_a[c] = 0.5;
            l->medium.sigma_s_reduced[c] = 1.0;
        }
    }
    s->materials[0].layers[1].depth_map.texture = t;
    return s;
}

static void wrong_values_of_built_scenes_are_refused(void **state)
{
    static const float even[2] = { 1.0f, 0.75f };
    (void) state;

    for (int i = 0;; i++) {
        const float pixels[2] = { 1.0f, i == 12 ? NAN : i == 13 ? -1.0f : i == 14 ? 1e7f : 0.75f };
        struct kept_messages kept = { 0 };
        struct pell_context *ctx = test_context(NULL, &kept);
        struct pell_scene *s = by_hand(ctx, i > 11 ? pixels : even);
        struct pell_material *m = &s->materials[0];
        struct pell_scene_layer *l = m->layers;
        enum pell_result res;
        switch (i) {
        case 0: l[0].medium.sigma_a[1] = -1.0; break;
        case 1: l[0].medium.sigma_s_reduced[1] = (double) NAN; break;
        case 2: l[1].medium.g[2] = 0.5; break; /* not the phase function's */
        case 3: l[1].phase[0].kind = PELL_PHASE_KINDS; break;
        case 4: l[1].phase[0].g[0] = 1.0; break;
        case 5: l[2].depth = NAN; break;
        case 6: l[0].depth = INFINITY; break; /* not the last */
        case 7: l[2].depth = 0.5f; break;     /* above the first */
        case 8: l[1].depth_map.uv = PELL_UV_SETS; break;
        case 9: l[1].depth_map.channel = 1; break;
        case 10: l[1].depth_map.matrix[2] = INFINITY; break;
        case 11: m->substrate = (enum pell_substrate) 3; break;
        case 12:
        case 13:
        case 14: break;
        case 15: l[1].depth = 2e6f; break;
        case 16:
            l[1].depth_inverse = true;
            ((float *) l[1].depth_map.texture->image.pixels)[0] = 1.5f;
            break;
        default: break;
        }
        res = pell_scene_complete(s, &(struct pell_load_params) { .bare = true });
        if (i > 16)
            OK(res);
        else if (res != PELL_ERR_INVALID || kept.errors != 1 || !strstr(kept.what, "allowed"))
            fail_msg("case %d: %d, %s", i, res, kept.what);
        pell_scene_destroy(&s);
        assert_int_equal(pell_memory_used(ctx), 0);
        pell_context_destroy(&ctx);
        if (i > 16)
            return;
    }
}

static void layers_are_allocated_and_solved(void **state)
{
    static const float pixels[2] = { 1.0f, 0.75f };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_scene *s = by_hand(ctx, pixels);
    struct pell_material *m = &s->materials[0];
    (void) state;

    assert_int_equal(pell_material_allocate_layers(s, 5, 1), PELL_ERR_INVALID);
    assert_int_equal(pell_material_allocate_layers(s, 0, -1), PELL_ERR_INVALID);
    assert_int_equal(pell_material_allocate_layers(s, 0, PELL_LAYERS_MOST + 1), PELL_ERR_INVALID);
    assert_int_equal(m->num_layers, 3);
    for (int below = PELL_SUBSTRATE_STOP; below <= PELL_SUBSTRATE_SURFACE_COLOR; below++) {
        double total;
        static double last;
        m->substrate = (enum pell_substrate) below;
        OK(pell_material_solve_layers(s, 0));
        total = pell_gaussians_total(&m->gaussians, 0);
        REQUIRE(total > 0.05 && total < 1.0);
        REQUIRE(below == PELL_SUBSTRATE_STOP || total > last); /* black, then more of the medium, then white */
        REQUIRE_REL(m->medium.sigma_s_reduced[1], 1.0, 1e-12);
        last = total;
    }
    for (int i = 0; i < 3; i++)
        for (int c = 0; c < 3; c++)
            m->layers[i].medium.sigma_s_reduced[c] = 0.0;
    m->substrate = PELL_SUBSTRATE_STOP;
    assert_int_equal(pell_material_solve_layers(s, 0), PELL_ERR_INVALID);
    assert_int_equal(m->gaussians.count, 0);
    assert_true(pell_medium_valid(&m->medium, NULL));
    OK(pell_material_allocate_layers(s, 0, 0));
    assert_int_equal(pell_material_solve_layers(s, 0), PELL_ERR_INVALID);
    pell_scene_destroy(&s);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

/* A stack has fewer layers than a material may have: what is merged lies deep, and changes little. */
static void many_layers_are_merged_where_they_matter_least(void **state)
{
    static const float pixels[2] = { 1.0f, 0.75f };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = by_hand(ctx, pixels);
    struct pell_material *m = &s->materials[0];
    double total[2];
    (void) state;

    for (int k = 0; k < 2; k++) {
        const int count = k ? PELL_LAYERS_MOST : PELL_LAYERS_MAX - 2;
        OK(pell_material_allocate_layers(s, 0, count));
        for (int i = 0; i < count; i++) {
            m->layers[i].depth = 2.0f * (float) (i + 1);
            m->layers[i].medium.eta = 1.4;
            for (int c = 0; c < 3; c++) {
                m->layers[i].medium.sigma_a[c] = 0.01;
                m->layers[i].medium.sigma_s_reduced[c] = i + 1.0;
            }
        }
        OK(pell_material_solve_layers(s, 0));
        total[k] = pell_gaussians_total(&m->gaussians, 0);
    }
    REQUIRE_REL(total[1], total[0], 0.005);
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

static void the_hash_knows_all_of_a_layer(void **state)
{
    static const float pixels[2] = { 1.0f, 0.75f };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_scene *s = by_hand(ctx, pixels);
    struct pell_scene_layer *l = s->materials[0].layers;
    uint64_t seen[16];
    int count = 0;
    (void) state;

#define CHANGED(change)                                                                                                                    \
    do {                                                                                                                                   \
        change;                                                                                                                            \
        seen[count] = pell_scene_hash_materials(s);                                                                                        \
        for (int k = 0; k < count; k++)                                                                                                    \
            REQUIRE(seen[k] != seen[count]);                                                                                               \
        count++;                                                                                                                           \
    } while (0)
    CHANGED((void) 0);
    CHANGED(l[0].medium.sigma_a[2] = 0.75);
    CHANGED(l[2].medium.sigma_s_reduced[0] = 0.75);
    CHANGED(l[1].phase[2].g[0] = 0.25);
    CHANGED(l[1].phase[2].kind = PELL_PHASE_TWO_LOBE);
    CHANGED(l[1].phase[2].weight = 0.25);
    CHANGED(l[2].depth = 9.0f);
    CHANGED(l[1].depth_inverse = true);
    CHANGED(l[1].depth_map.uv = 1);
    CHANGED(l[1].depth_map.matrix[2] = 0.5f);
    CHANGED(((float *) l[1].depth_map.texture->image.pixels)[1] = 0.5f);
    CHANGED(s->materials[0].substrate = PELL_SUBSTRATE_LAST);
    CHANGED(OK(pell_material_allocate_layers(s, 0, 0)));
#undef CHANGED
    pell_scene_destroy(&s);
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(coefficients_and_phases),
        cmocka_unit_test(depths_by_pictures),
        cmocka_unit_test(one_picture_paints_four_layers),
        cmocka_unit_test(broken_maps_are_refused_with_their_place),
        cmocka_unit_test(crossings_are_counted_and_warned_of_once),
        cmocka_unit_test(uniform_layers_reflect_what_the_preset_does),
        cmocka_unit_test(later_words_win),
        cmocka_unit_test(as_many_as_there_may_be),
        cmocka_unit_test(wrong_values_of_built_scenes_are_refused),
        cmocka_unit_test(layers_are_allocated_and_solved),
        cmocka_unit_test(many_layers_are_merged_where_they_matter_least),
        cmocka_unit_test(the_hash_knows_all_of_a_layer),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
