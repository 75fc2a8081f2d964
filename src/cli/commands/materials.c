/* SPDX-License-Identifier: MIT
 * materials.c - `pellucid materials`: lists built-in materials, and describes one of them or a material file. */
#include "cli/cli.h"

#include "image/color.h"
#include "scene/scene.h"

#include <pellucid/material.h>
#include <pellucid/profile.h>

#include <math.h>
#include <string.h>

#define NAMES_AND_TITLES 90 /* columns of a line of the list */

static const char *const kinds[] = { "medium", "gaussians", "layers" };
static const char *const kind_titles[] = { "Media", "Published profiles, normalised to white", "Layers" };
static const char *const phases[] = { "hg", "schlick", "rayleigh", "two-lobe" };

/* Quantities derived from a medium, per channel. */
struct derived {
    double sigma_s[3], albedo[3], albedo_reduced[3], free_path[3], mfp[3], dmfp[3], total[3];
    bool directed; /* some g is not 0: sigma_s is listed besides the reduced coefficient */
};

static struct derived derive(const struct pell_medium *m)
{
    struct derived d = { .directed = m->g[0] != 0.0 || m->g[1] != 0.0 || m->g[2] != 0.0 };

    for (int c = 0; c < 3; c++) {
        const struct pell_dipole dipole = pell_dipole_make(m->sigma_a[c], m->sigma_s_reduced[c], m->eta, PELL_FRESNEL_EXACT);
        d.sigma_s[c] = m->sigma_s_reduced[c] / (1.0 - m->g[c]);
        d.albedo[c] = d.sigma_s[c] / (m->sigma_a[c] + d.sigma_s[c]);
        d.albedo_reduced[c] = m->sigma_s_reduced[c] / (m->sigma_a[c] + m->sigma_s_reduced[c]);
        d.free_path[c] = 1.0 / (m->sigma_a[c] + d.sigma_s[c]);
        d.mfp[c] = pell_mean_free_path(m, c);
        d.dmfp[c] = pell_diffuse_mean_free_path(m, c);
        d.total[c] = pell_dipole_total(&dipole);
    }
    return d;
}

/* The colour under white light: the diffuse reflectance or, for a white profile, the base colour. */
static void color_of(const struct pell_material_entry *e, double color[3])
{
    for (int c = 0; c < 3; c++)
        color[c] = e->kind == PELL_MATERIAL_MEDIUM   ? derive(&e->medium).total[c]
                   : e->kind == PELL_MATERIAL_LAYERS ? pell_gaussians_total(&e->gaussians, c)
                                                     : e->color[c];
}

/* Its sRGB code values, 0 to 255. */
static void encode(const double color[3], int code[3])
{
    for (int c = 0; c < 3; c++)
        code[c] = (int) lrintf(255.0f * fminf(fmaxf(pell_srgb_encode((float) color[c]), 0.0f), 1.0f));
}

/* --- JSON --------------------------------------------------------------------------------------------------------------------- */

static json_t *layer_json(const struct pell_material_layer *l)
{
    const double g[3] = { l->phase[0].g[0], l->phase[1].g[0], l->phase[2].g[0] };
    double mfp[3], dmfp[3];

    for (int c = 0; c < 3; c++) {
        mfp[c] = pell_mean_free_path(&l->medium, c);
        dmfp[c] = pell_diffuse_mean_free_path(&l->medium, c);
    }
    return json_pack("{s:o,s:o,s:o,s:o,s:s,s:o,s:o,s:f,s:o,s:o}", "name", cli_text(l->name), "thickness_mm",
                     isfinite(l->thickness_mm) ? json_real(l->thickness_mm) : json_string("infinite"), "sigma_a",
                     cli_numbers(l->medium.sigma_a, 3), "sigma_s_reduced", cli_numbers(l->medium.sigma_s_reduced, 3), "phase",
                     phases[l->phase[0].kind], "g", cli_numbers(g, 3), "mean_cosine", cli_numbers(l->medium.g, 3), "eta", l->medium.eta,
                     "mean_free_path", cli_numbers(mfp, 3), "diffuse_mean_free_path", cli_numbers(dmfp, 3));
}

json_t *cli_material_json(const struct pell_material_entry *e)
{
    double color[3];
    char hex[8];
    int code[3];
    json_t *o;

    color_of(e, color);
    encode(color, code);
    snprintf(hex, sizeof(hex), "#%02x%02x%02x", (unsigned) code[0] & 0xff, (unsigned) code[1] & 0xff, (unsigned) code[2] & 0xff);
    o = json_pack("{s:o,s:o,s:s,s:o,s:o,s:o,s:o,s:f,s:f,s:f,s:o,s:o,s:o,s:s}", "name", cli_text(e->name), "title", cli_text(e->title),
                  "kind", kinds[e->kind], "family", cli_text(e->family), "sigma_a", cli_numbers(e->medium.sigma_a, 3), "sigma_s_reduced",
                  cli_numbers(e->medium.sigma_s_reduced, 3), "g", cli_numbers(e->medium.g, 3), "eta", e->medium.eta, "roughness",
                  e->roughness, "mix", e->mix, "source", cli_text(e->source), "note", cli_text(e->note), "color", cli_numbers(e->color, 3),
                  "srgb", hex);
    if (!o)
        return NULL;
    if (e->kind == PELL_MATERIAL_MEDIUM) {
        const struct derived d = derive(&e->medium);
        json_object_set_new(o, "concentration", json_real(e->concentration));
        json_object_set_new(o, "dilution", e->dilution > 0.0 ? json_real(e->dilution) : json_null());
        json_object_set_new(o, "sigma_s", d.directed ? cli_numbers(d.sigma_s, 3) : json_null());
        json_object_set_new(o, "mean_free_path", cli_numbers(d.mfp, 3));
        json_object_set_new(o, "diffuse_mean_free_path", cli_numbers(d.dmfp, 3));
        json_object_set_new(o, "reduced_albedo", cli_numbers(d.albedo_reduced, 3));
    } else {
        json_t *gaussians = json_array();
        for (int i = 0; i < e->gaussians.count; i++)
            json_array_append_new(gaussians, json_pack("{s:f,s:o}", "variance_mm2", e->gaussians.variance[i], "weight",
                                                       cli_numbers(e->gaussians.weight[i], 3)));
        json_object_set_new(o, "gaussians", gaussians);
    }
    if (e->kind != PELL_MATERIAL_GAUSSIANS)
        json_object_set_new(o, "diffuse_reflectance", cli_numbers(color, 3));
    if (e->kind == PELL_MATERIAL_LAYERS) {
        json_t *layers = json_array();
        for (int i = 0; i < e->layers.count; i++)
            json_array_append_new(layers, layer_json(&e->layers.item[i]));
        json_object_set_new(o, "layers", layers);
    }
    return o;
}

/* --- Text --------------------------------------------------------------------------------------------------------------------- */

static void print_row(const char *name, const double v[3], const char *unit)
{
    printf("  %-24s", name);
    for (int c = 0; c < 3; c++)
        if (isfinite(v[c]))
            printf(" %10.4g", v[c]);
        else
            printf(" %10s", "infinite");
    printf("  %s\n", unit);
}

static void print_swatch(const struct cli *cli, const double color[3])
{
    int code[3];

    encode(color, code);
    printf("  %-24s %10s#%02x%02x%02x  ", "as sRGB", "", (unsigned) code[0], (unsigned) code[1], (unsigned) code[2]);
    if (cli->color_out)
        printf("\x1b[48;2;%d;%d;%dm          \x1b[0m", code[0], code[1], code[2]);
    printf("under D65\n");
}

static void print_medium(const struct pell_medium *m)
{
    const struct derived d = derive(m);

    print_row("sigma_a", m->sigma_a, "1/mm");
    if (d.directed) {
        print_row("sigma_s", d.sigma_s, "1/mm");
        print_row("g (mean cosine)", m->g, "1");
    }
    print_row("sigma_s' (reduced)", m->sigma_s_reduced, "1/mm");
    if (d.directed) {
        print_row("free path, not reduced", d.free_path, "mm");
        print_row("albedo", d.albedo, "1");
    }
    print_row("mean free path", d.mfp, "mm");
    print_row("diffuse mean free path", d.dmfp, "mm");
    print_row("reduced albedo", d.albedo_reduced, "1");
}

static void print_layer(const struct cli *cli, const struct pell_material_layer *l, int index)
{
    char thickness[48] = "without a bottom", name[96];

    if (isfinite(l->thickness_mm))
        snprintf(thickness, sizeof(thickness), "%.4g mm", l->thickness_mm);
    printf("\n  %sLayer %d, %s%s: %s; eta %.4g; phase function %s\n", cli_style(cli, stdout, 1), index + 1,
           pell_printable(l->name, name, sizeof(name)), cli_style(cli, stdout, 0), thickness, l->medium.eta, phases[l->phase[0].kind]);
    if (l->phase[0].kind == PELL_PHASE_SCHLICK) {
        const double k[3] = { l->phase[0].g[0], l->phase[1].g[0], l->phase[2].g[0] };
        print_row("Schlick's k", k, "1");
    }
    print_medium(&l->medium);
}

static void print_gaussians(const struct pell_gaussians *g)
{
    for (int i = 0; i < g->count; i++) {
        char head[64];
        snprintf(head, sizeof(head), "variance %.4g mm^2", g->variance[i]);
        print_row(head, g->weight[i], "weight");
    }
}

static void print_material(const struct cli *cli, const struct pell_material_entry *e)
{
    char text[8192];
    double color[3];

    color_of(e, color);
    printf("%s%s%s", cli_style(cli, stdout, 1), pell_printable(e->name, text, sizeof(text)), cli_style(cli, stdout, 0));
    if (e->title[0])
        printf(" - %s", pell_printable(e->title, text, sizeof(text)));
    if (e->family[0])
        printf(" (%s)", pell_printable(e->family, text, sizeof(text)));
    putchar('\n');
    if (e->note[0])
        cli_wrap(stdout, 0, 0, pell_printable(e->note, text, sizeof(text)));
    printf("\n  %-24s %10s %10s %10s\n", "", "red", "green", "blue");
    switch (e->kind) {
    case PELL_MATERIAL_MEDIUM:
        print_medium(&e->medium);
        print_row("diffuse reflectance", color, "(dipole)");
        break;
    case PELL_MATERIAL_LAYERS:
        print_gaussians(&e->gaussians);
        print_row("diffuse reflectance", color, "(sum of the weights)");
        break;
    case PELL_MATERIAL_GAUSSIANS:
        print_gaussians(&e->gaussians);
        print_row("base colour", e->color, "linear, without a texture");
        break;
    }
    print_swatch(cli, color);
    for (int i = 0; i < e->layers.count; i++)
        print_layer(cli, &e->layers.item[i], i);
    printf("%s  %-24s %10.4g\n  %-24s %10.4g\n", e->layers.count ? "\n" : "", "eta", e->medium.eta, "roughness", e->roughness);
    if (e->kind == PELL_MATERIAL_MEDIUM && (e->dilution > 0.0 || e->concentration != 1.0)) {
        printf("  %-24s %10.4g  sigma_a and sigma_s are proportional to it\n", "concentration", e->concentration);
        if (e->dilution > 1.0)
            printf("  %-24s %10.4g  the sample that was measured\n", "  as measured", 1.0 / e->dilution);
    }
    if (e->source[0]) {
        fputs("\nSource: ", stdout);
        cli_wrap(stdout, 8, 8, pell_printable(e->source, text, sizeof(text)));
    }
}

static void print_line(const struct cli *cli, const struct pell_material_entry *e)
{
    double color[3];
    int code[3];

    color_of(e, color);
    encode(color, code);
    printf("  %-28s ", e->name);
    if (cli_columns(stdout) >= NAMES_AND_TITLES)
        printf("%-34s ", e->title);
    if (e->kind == PELL_MATERIAL_MEDIUM)
        for (int c = 0; c < 3; c++)
            printf(" %7.3g", pell_mean_free_path(&e->medium, c));
    else if (e->kind == PELL_MATERIAL_LAYERS)
        printf(" %s", pell_counted(e->layers.count, "layer", "layers").str);
    else
        printf(" %s, widest %.3g mm", pell_counted(e->gaussians.count, "Gaussian", "Gaussians").str,
               sqrt(e->gaussians.variance[e->gaussians.count - 1]));
    if (cli->color_out)
        printf("  \x1b[48;2;%d;%d;%dm  \x1b[0m", code[0], code[1], code[2]);
    putchar('\n');
}

/* Prints a kind's entries, family by family, artistic ones last. */
static void print_kind(const struct cli *cli, enum pell_material_kind kind)
{
    const size_t count = pell_material_count();

    for (int artistic = 0; artistic < 2; artistic++)
        for (size_t i = 0; i < count; i++) {
            const struct pell_material_entry *first = pell_material_at(i);
            bool seen = first->kind != kind || (strcmp(first->family, "artistic") == 0) != artistic;
            for (size_t j = 0; j < i && !seen; j++)
                seen = pell_material_at(j)->kind == kind && strcmp(pell_material_at(j)->family, first->family) == 0;
            if (seen)
                continue;
            printf("\n%s%s: %s%s%s\n", cli_style(cli, stdout, 1), kind_titles[kind], first->family, cli_style(cli, stdout, 0),
                   kind == PELL_MATERIAL_MEDIUM ? "; mean free path, mm: red green blue" : "");
            for (size_t j = i; j < count; j++)
                if (pell_material_at(j)->kind == kind && strcmp(pell_material_at(j)->family, first->family) == 0)
                    print_line(cli, pell_material_at(j));
        }
}

enum exit_code command_materials(struct cli *cli)
{
    const char *name = cli->num_arguments > 0 ? cli->arguments[0] : NULL;
    struct pell_material_entry one = { 0 };
    enum exit_code code = EXIT_OK;

    if (name && cli_is_image(name))
        return cli_usage(cli, "materials", "`pellucid materials` lists the materials", "\"%s\" is an image, not a material", name);
    if (name) {
        const enum pell_result res = pell_material_open(cli->ctx, "materials", name, &one);
        code = res == PELL_ERR_INVALID && !pell_material_is_path(name) ? EXIT_USAGE : cli_failed(cli, res);
    }
    if (code != EXIT_OK)
        return code;
    if (cli->json) {
        json_t *list = json_array();
        if (name)
            json_array_append_new(list, cli_material_json(&one));
        for (size_t i = 0; !name && i < pell_material_count(); i++)
            json_array_append_new(list, cli_material_json(pell_material_at(i)));
        code = cli_print_json(cli, json_pack("{s:o}", "materials", list));
    } else if (name) {
        print_material(cli, &one);
    } else {
        printf("%zu materials; `pellucid materials NAME` prints all about one\n", pell_material_count());
        print_kind(cli, PELL_MATERIAL_MEDIUM);
        print_kind(cli, PELL_MATERIAL_LAYERS);
        print_kind(cli, PELL_MATERIAL_GAUSSIANS);
    }
    pell_free(cli->ctx, (char *) one.name);
    return code;
}
