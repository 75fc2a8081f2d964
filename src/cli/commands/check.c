/* SPDX-License-Identifier: MIT
 * check.c - `pellucid check`: a summary of a scene and every problem in it. */
#include "cli/commands/check_layers.h"
#include "scene/layers.h"
#include "scene/material_maps.h"

#include <math.h>
#include <string.h>

static const char *const severities[] = { "note", "warning", "error" };
static const char *const substrate_names[] = { "stop", "last", "surface-color" }; /* in the order of enum pell_substrate */

static json_t *bounds_json(const struct pell_scene_report *r)
{
    return json_pack("[[f,f,f],[f,f,f]]", r->bounds_min[0], r->bounds_min[1], r->bounds_min[2], r->bounds_max[0], r->bounds_max[1],
                     r->bounds_max[2]);
}

/* What diffusion methods render for a material with layers. */
static const char *shown_of_layers(const struct pell_material *m)
{
    return m->preset && m->preset[0] ? m->preset
           : m->profile              ? "the table"
           : m->gaussians.count > 0  ? "reflectance of the layers at their mean depths"
                                     : "coefficients of one medium";
}

static json_t *layers_json(const struct pell_material *m)
{
    static const char *const phases[] = { "hg", "schlick", "rayleigh", "two-lobe" }; /* in the order of enum pell_phase_kind */
    struct pell_layer_measure measure[PELL_LAYERS_MOST];
    json_t *list = json_array();

    pell_scene_layers_measure(m, measure);
    for (int i = 0; i < m->num_layers; i++) {
        const struct pell_scene_layer *l = &m->layers[i];
        double s[3], t[3];
        json_t *o;
        for (int c = 0; c < 3; c++) {
            s[c] = l->medium.sigma_s_reduced[c] / (1.0 - l->medium.g[c]);
            t[c] = s[c] + l->medium.sigma_a[c];
        }
        o = json_pack("{s:o,s:o,s:o,s:o,s:s,s:b}", "name", cli_text(l->name), "sigma_s", cli_numbers(s, 3), "sigma_t", cli_numbers(t, 3),
                      "mean_cosine", cli_numbers(l->medium.g, 3), "phase", phases[l->phase[0].kind], "painted",
                      (int) (l->depth_map.texture != NULL));
        if (measure[i].max < (double) INFINITY)
            json_object_set_new(o, "depth_mm",
                                json_pack("{s:f,s:f,s:f}", "min", measure[i].min, "mean", measure[i].mean, "max", measure[i].max));
        if (l->depth_map.texture)
            json_object_set_new(o, "map", cli_text(l->depth_map.texture->name));
        json_object_set_new(o, "crossing_texels", json_integer((json_int_t) measure[i].crossings));
        json_array_append_new(list, o);
    }
    return list;
}

static json_t *material_json(const struct pell_material *m)
{
    double mfp[3], dmfp[3];
    json_t *o = json_pack("{s:o,s:o,s:b,s:f,s:s}", "name", cli_text(m->name), "preset", cli_text(m->preset), "opaque", (int) m->opaque,
                          "eta", m->medium.eta, "color_from", m->color_from == PELL_COLOR_FROM_TEXTURE ? "texture" : "profile");

    if (o && pell_material_is_thin(m))
        json_object_set_new(o, "diffuse_transmission", json_real((double) m->diffuse_transmission));
    if (!o || m->opaque)
        return o;
    if (m->num_layers > 0) {
        json_object_set_new(o, "layers", layers_json(m));
        json_object_set_new(o, "below", json_string(substrate_names[m->substrate]));
        json_object_set_new(o, "diffusion_shows", json_string(shown_of_layers(m)));
    }
    json_object_set_new(o, "profile",
                        json_string(m->profile               ? "table"
                                    : m->gaussians.count > 0 ? "gaussians"
                                                             : pell_profile_model_at(m->model)->name));
    if (m->profile) {
        const double total[3] = { pell_profile_total(&m->profile[0]), pell_profile_total(&m->profile[1]),
                                  pell_profile_total(&m->profile[2]) };
        json_object_set_new(o, "rd_total", cli_numbers(total, 3));
        return o;
    }
    if (m->gaussians.count > 0) {
        json_object_set_new(o, "gaussians", json_integer(m->gaussians.count));
        return o;
    }
    for (int c = 0; c < 3; c++) {
        mfp[c] = pell_mean_free_path(&m->medium, c);
        dmfp[c] = pell_diffuse_mean_free_path(&m->medium, c);
    }
    json_object_set_new(o, "sigma_a", cli_numbers(m->medium.sigma_a, 3));
    json_object_set_new(o, "sigma_s_reduced", cli_numbers(m->medium.sigma_s_reduced, 3));
    json_object_set_new(o, "mean_free_path", cli_numbers(mfp, 3));
    json_object_set_new(o, "diffuse_mean_free_path", cli_numbers(dmfp, 3));
    return o;
}

static json_t *object_json(const struct pell_object_report *o)
{
    return json_pack("{s:o,s:I,s:b,s:b,s:b,s:i,s:I,s:I,s:I,s:I,s:f,s:f,s:f,s:b,s:i,s:i}", "name", cli_text(o->name), "triangles",
                     (json_int_t) o->triangles, "closed", (int) o->closed, "outward", (int) o->outward, "faceted", (int) o->faceted,
                     "components", o->components, "boundary_edges", (json_int_t) o->boundary_edges, "nonmanifold_edges",
                     (json_int_t) o->nonmanifold_edges, "flipped_edges", (json_int_t) o->flipped_edges, "degenerate_triangles",
                     (json_int_t) o->degenerate_triangles, "volume_mm3", o->volume_mm3, "area_mm2", o->area_mm2, "thickness_mm",
                     o->thickness_mm, "holds_camera", (int) o->holds_camera, "holds_light", o->holds_light, "coincident", o->coincident);
}

static json_t *problem_json(const struct pell_problem *p)
{
    return json_pack("{s:s,s:o,s:o,s:s}", "severity", severities[p->severity], "where", cli_text(p->where), "what", cli_text(p->what),
                     "hint", "");
}

static enum exit_code answer_json(struct cli *cli, const struct pell_scene *scene, const struct pell_scene_report *r, json_t *section)
{
    json_t *materials = json_array(), *problems = json_array(), *objects = json_array(), *answer;

    for (size_t i = 0; i < scene->num_materials; i++)
        json_array_append_new(materials, material_json(&scene->materials[i]));
    json_array_extend(problems, cli->collected);
    for (size_t i = 0; i < r->num_problems; i++)
        json_array_append_new(problems, problem_json(&r->problems[i]));
    for (size_t i = 0; i < r->num_objects; i++)
        json_array_append_new(objects, object_json(&r->objects[i]));
    answer = json_pack("{s:I,s:I,s:o,s:f,s:I,s:I,s:I,s:o,s:o,s:o}", "meshes", (json_int_t) scene->num_meshes, "triangles",
                       (json_int_t) r->triangles, "bounds_mm", bounds_json(r), "mm_per_unit", scene->mm_per_unit, "lights",
                       (json_int_t) scene->num_lights, "cameras", (json_int_t) scene->num_cameras, "textures",
                       (json_int_t) scene->num_textures, "materials", materials, "objects", objects, "problems", problems);
    if (section)
        json_object_set(answer, "cross_section", section);
    return cli_print_json(cli, answer);
}

/* Makes a name printable: names in files may hold anything. */
static const char *shown(const char *name, char buffer[96])
{
    return name && name[0] ? pell_printable(name, buffer, 96) : "(no name)";
}

/* The notes describe materials: mean free paths, and the origin of the colour. */
static void print_problems(const struct cli *cli, const struct pell_scene_report *r, bool notes)
{
    json_t *m;
    size_t n;

    json_array_foreach(notes ? NULL : cli->collected, n, m)
    {
        const char *where = json_string_value(json_object_get(m, "where")), *hint = json_string_value(json_object_get(m, "hint"));
        char text[4096];
        snprintf(text, sizeof(text), "%s%s%s%s%s", where, where[0] ? ": " : "", json_string_value(json_object_get(m, "what")),
                 hint[0] ? "; " : "", hint);
        fputs("  warning  ", stdout);
        cli_wrap(stdout, 11, 11, text);
    }
    for (size_t i = 0; i < r->num_problems; i++) {
        const struct pell_problem *p = &r->problems[i];
        char text[1024], line[1024];
        if ((p->severity == PELL_SEVERITY_NOTE) != notes)
            continue;
        snprintf(text, sizeof(text), "%s%s%s", p->where, p->where[0] ? ": " : "", p->what);
        if (notes)
            fputs("  ", stdout);
        else
            printf("  %-8s ", severities[p->severity]);
        cli_wrap(stdout, notes ? 2 : 11, notes ? 4 : 11, pell_printable(text, line, sizeof(line)));
    }
}

static void print_object(const struct pell_object_report *o)
{
    char name[96];

    printf("  %-20s %s, %s%s", shown(o->name, name), pell_counted((long long) o->triangles, "triangle", "triangles").str,
           o->degenerate_triangles == o->triangles ? "no area"
           : o->closed                             ? "closed"
                                                   : "open",
           o->closed && !o->outward ? ", inverted normals" : "");
    if (o->components > 1)
        printf(", %d parts", o->components);
    if (o->thickness_mm > 0.0)
        printf(", mean thickness %.3g mm", o->thickness_mm);
    putchar('\n');
}

static void print_layers(const struct pell_material *m)
{
    struct pell_layer_measure measure[PELL_LAYERS_MOST];
    const int64_t texels = pell_scene_layers_measure(m, measure);
    char name[96];

    for (int i = 0; i < m->num_layers; i++) {
        const struct pell_scene_layer *l = &m->layers[i];
        const double *a = l->medium.sigma_a, *s = l->medium.sigma_s_reduced, *g = l->medium.g;
        printf("    %-18s ", shown(l->name, name));
        if (measure[i].max == (double) INFINITY)
            fputs("no bottom", stdout);
        else if (l->depth_map.texture)
            printf("bottom painted, %.3g to %.3g mm, mean %.3g mm", measure[i].min, measure[i].max, measure[i].mean);
        else
            printf("bottom at %.3g mm", measure[i].mean);
        printf("; sigma_a %.3g %.3g %.3g, sigma_s %.3g %.3g %.3g 1/mm, mean cosine %.3g %.3g %.3g\n", a[0], a[1], a[2], s[0] / (1.0 - g[0]),
               s[1] / (1.0 - g[1]), s[2] / (1.0 - g[2]), g[0], g[1], g[2]);
        if (measure[i].crossings > 0)
            printf("    %-18s painted above the bottom of a layer above it at %lld of %lld texels: the upper one wins\n", "",
                   (long long) measure[i].crossings, (long long) texels);
    }
    printf("    below them: %s; methods of diffusion show %s\n", substrate_names[m->substrate], shown_of_layers(m));
}

static void print_more(size_t count, size_t shown)
{
    if (count > shown)
        printf("  and %zu more: --json lists them all, the limit \"warnings\" says how many stand here\n", count - shown);
}

/* Prints a line about the plot that was drawn. */
static void print_section(const struct cli *cli, const json_t *section)
{
    json_t *layers = json_object_get(section, "layers"), *layer;
    char name[96];
    size_t i;

    printf("\n%sCross-section%s\n  %s, %.4g mm, down to %.4g mm: %s\n", cli_style(cli, stdout, 1), cli_style(cli, stdout, 0),
           shown(json_string_value(json_object_get(section, "material")), name), json_number_value(json_object_get(section, "length_mm")),
           json_number_value(json_object_get(section, "down_to_mm")), cli->check.cross_section);
    json_array_foreach(layers, i, layer)
    {
        const json_t *depth = json_object_get(layer, "depth_mm");
        printf("  %-20s ", shown(json_string_value(json_object_get(layer, "name")), name));
        if (depth)
            printf("bottom at %.3g to %.3g mm, mean %.3g mm\n", json_number_value(json_object_get(depth, "min")),
                   json_number_value(json_object_get(depth, "max")), json_number_value(json_object_get(depth, "mean")));
        else
            puts("without a bottom");
    }
}

static void answer_text(const struct cli *cli, const struct pell_scene *scene, const struct pell_scene_report *r, const json_t *section)
{
    const char *bold = cli_style(cli, stdout, 1), *plain = cli_style(cli, stdout, 0);
    const size_t most = (size_t) cli->limits.warnings;
    size_t problems = json_array_size(cli->collected), notes = 0;
    struct pell_text line = { .length = 0 };
    char name[96];

    for (size_t i = 0; i < r->num_problems; i++)
        *(r->problems[i].severity == PELL_SEVERITY_NOTE ? &notes : &problems) += 1;
    pell_text_add(&line, "%s, %s, %.4g x %.4g x %.4g mm (one unit of the file is %.6g mm)",
                  pell_counted((long long) scene->num_meshes, "mesh part", "mesh parts").str,
                  pell_counted((long long) r->triangles, "triangle", "triangles").str, (double) (r->bounds_max[0] - r->bounds_min[0]),
                  (double) (r->bounds_max[1] - r->bounds_min[1]), (double) (r->bounds_max[2] - r->bounds_min[2]), scene->mm_per_unit);
    cli_wrap(stdout, 0, 2, line.str);
    printf("from (%.4g, %.4g, %.4g) to (%.4g, %.4g, %.4g) mm\n", (double) r->bounds_min[0], (double) r->bounds_min[1],
           (double) r->bounds_min[2], (double) r->bounds_max[0], (double) r->bounds_max[1], (double) r->bounds_max[2]);
    printf("%s, %s, %s\n\n%sObjects%s\n", pell_counted((long long) scene->num_lights, "light", "lights").str,
           pell_counted((long long) scene->num_cameras, "camera", "cameras").str,
           pell_counted((long long) scene->num_textures, "texture", "textures").str, bold, plain);
    for (size_t i = 0; i < r->num_objects && i < most; i++)
        print_object(&r->objects[i]);
    print_more(r->num_objects, most);
    printf("\n%sMaterials%s\n", bold, plain);
    for (size_t i = 0; i < scene->num_materials && i < most; i++) {
        const struct pell_material *m = &scene->materials[i];
        const bool preset = m->preset && m->preset[0];
        printf("  %-20s %s\n", shown(m->name, name),
               pell_material_is_thin(m) ? "opaque, a thin sheet that transmits diffuse light"
               : m->opaque              ? "opaque"
               : m->num_layers > 0      ? "layers"
               : preset                 ? m->preset
                                        : "coefficients of the file");
        if (m->num_layers > 0 && !m->opaque)
            print_layers(m);
    }
    print_more(scene->num_materials, most);
    if (notes) {
        printf("\n%sNotes%s\n", bold, plain);
        print_problems(cli, r, true);
    }
    if (section)
        print_section(cli, section);
    printf("\n%s%s%s\n", bold, pell_counted((long long) problems, "problem", "problems").str, plain);
    print_problems(cli, r, false);
}

enum exit_code command_check(struct cli *cli)
{
    struct pell_scene *scene = NULL;
    struct pell_scene_report report = { 0 };
    struct pell_load_params params;
    enum exit_code code = cli_load_params(cli, &params);
    json_t *section = NULL;
    enum pell_result res;

    if (code == EXIT_OK)
        code = check_layers_options(cli);
    if (code != EXIT_OK)
        return code;
    params.bare = true;
    cli_collect(cli); /* warnings are part of the answer */
    res = pell_scene_load(cli->ctx, cli->arguments[0], &params, &scene);
    if (res == PELL_OK)
        res = pell_scene_check(scene, &report);
    code = cli_failed(cli, res);
    if (code == EXIT_OK)
        code = session_check(cli, scene);
    if (code == EXIT_OK && cli->check.cross_section)
        code = check_layers(cli, scene, &section);
    if (code == EXIT_OK) {
        if (cli->json)
            code = answer_json(cli, scene, &report, section);
        else
            answer_text(cli, scene, &report, section);
        for (size_t i = 0; i < report.num_problems; i++)
            if (report.problems[i].severity == PELL_SEVERITY_ERROR && code == EXIT_OK)
                code = EXIT_INPUT;
    }
    json_decref(section);
    pell_scene_report_finish(cli->ctx, &report);
    pell_scene_destroy(&scene);
    return code;
}
