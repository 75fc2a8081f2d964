/* SPDX-License-Identifier: MIT
 * test_paper_settings.c - as=paper uses the settings of the papers: knobs and settings of each method, row by row. */
#include "pell_test.h"

#include <pellucid/method.h>
#include <pellucid/render.h>

#include <stdlib.h>

#define LIGHT "bounces=0 angles=off curvature=off single-scattering=off"

static const struct row {
    const char *method, *knobs, *settings;
    float mix; /* -2: any */
} rows[] = {
    { "screen-space",
      "input=lit profile=published first=skin edges=paper foreshortening=paper correction=800 maxdd=0.001 lod=0.5 ssslevel=31.5 "
      "through=off",
      LIGHT, 1.0f },
    { "texture-space",
      "kernel=seven border=0 first=unblurred tsm=map thickness=printed through=gaussian fade=linear soften=off lights=sum gaussians=6",
      LIGHT " exit=published bloom=0.05", 0.5f },
    { "image-space",
      "adaptive=off progressive=off sampling=separate views=eye renormalise=count jacobian=off reconstruct=off profile=dipole "
      "misprint=none",
      LIGHT " exit=published", -2.0f },
    { "layered", "samples=100 march=sum refraction=none light-path=planes planes=vertex lamps=1 below=stop shadows=off", LIGHT, -2.0f },
    { "convolution",
      "planes=4 placement=equal split=half restore=off threshold=0.001 threshold-by=printed resolution=1/2 pixels=one apart=off edges=off",
      LIGHT " exit=published specular=phong", -2.0f },
    { "dipole", "", LIGHT, -2.0f },
    { "hierarchical", "", LIGHT, -2.0f },
    { "single-scatter", "", LIGHT, -2.0f },
};

/* Whether the knobs have every "name=value" of a text; reports those that differ. */
static void require_all(const char *owner, const struct pell_knob *knobs, const void *values, const char *text)
{
    char copy[512], *rest = copy, *word;

    assert_true(strlen(text) < sizeof(copy));
    strcpy(copy, text);
    while ((word = strtok_r(rest, " ", &rest))) {
        char *value = strchr(word, '='), shown[160];
        const struct pell_knob *k;
        *value++ = '\0';
        k = pell_knob_find(knobs, word);
        if (!k)
            fail_msg("%s has no %s", owner, word);
        if (strcmp(pell_knob_format(k, values, shown, sizeof(shown)), value) != 0)
            fail_msg("%s: %s is %s, not %s", owner, word, shown, value);
    }
}

static void as_paper_is_what_the_papers_ran(void **state)
{
    struct kept_messages kept;
    struct pell_context *ctx = test_context(NULL, &kept);

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(rows); i++) {
        const struct pell_method *m = pell_method_find(ctx, "test", rows[i].method);
        struct pell_settings settings, usual;
        struct pell_plan plan;
        void *knobs = NULL, *best = NULL;
        assert_non_null(m);
        assert_int_equal(pell_method_knobs_create(ctx, m, "as=paper", &knobs), PELL_OK);
        assert_int_equal(pell_method_knobs_create(ctx, m, "", &best), PELL_OK);
        assert_true(pell_method_as_paper(m, knobs) && !pell_method_as_paper(m, best) && !pell_method_as_paper(m, NULL));
        require_all(m->name, m->knobs, knobs, rows[i].knobs);
        pell_settings_default(m, knobs, &settings);
        require_all(m->name, pell_settings_knobs(), &settings, rows[i].settings);
        m->plan(knobs, &plan);
        if (rows[i].mix > -2.0f)
            REQUIRE_NEAR((double) plan.mix, (double) rows[i].mix, 0.0);
        pell_settings_default(m, best, &settings);
        pell_settings_default(NULL, NULL, &usual);
        for (const struct pell_knob *k = pell_settings_knobs(); k->name; k++) {
            char a[160], b[160];
            assert_string_equal(pell_knob_format(k, &settings, a, sizeof(a)), pell_knob_format(k, &usual, b, sizeof(b)));
        }
        pell_method_knobs_destroy(ctx, &best);
        pell_method_knobs_destroy(ctx, &knobs);
    }
    pell_context_destroy(&ctx);
}

/* No method that follows a paper is missing from the rows above. */
static void every_published_method_has_its_row(void **state)
{
    (void) state;
    for (size_t i = 0; i < pell_method_count(); i++) {
        const struct pell_method *m = pell_method_at(i);
        bool there = false;
        for (size_t k = 0; k < PELL_COUNT(rows); k++)
            there = there || strcmp(rows[k].method, m->name) == 0;
        assert_true(there || strcmp(m->name, "path-trace") == 0); /* which follows no paper's settings */
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(as_paper_is_what_the_papers_ran),
        cmocka_unit_test(every_published_method_has_its_row),
    };
    return cmocka_run_group_tests_name("methods.paper-settings", tests, NULL, NULL);
}
