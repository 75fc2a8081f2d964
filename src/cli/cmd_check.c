/* SPDX-License-Identifier: MIT
 * cmd_check.c - `pellucid check`: what a scene holds, and every problem. */
#include "cli/cli.h"

#include <string.h>

static const char *const severities[] = { "note", "warning", "error" };

static json_t *bounds_json(const struct pell_scene_report *r)
{
    return json_pack("[[f,f,f],[f,f,f]]", r->bounds_min[0], r->bounds_min[1], r->bounds_min[2], r->bounds_max[0], r->bounds_max[1], r->bounds_max[2]);
}

static enum exit_code answer_json(struct cli *cli, const struct pell_scene *scene, const struct pell_scene_report *r)
{
    json_t *materials = json_array(), *problems = json_array(), *objects = json_array();

    for (size_t i = 0; i < scene->num_materials; i++) {
        const struct pell_material *m = &scene->materials[i];
        json_array_append_new(materials, json_pack("{s:s,s:s,s:b,s:o,s:o,s:f,s:s}", "name", m->name, "preset", m->preset ? m->preset : "", "opaque",
                                                   (int) m->opaque, "sigma_a", cli_numbers(m->medium.sigma_a, 3), "sigma_s_reduced",
                                                   cli_numbers(m->medium.sigma_s_reduced, 3), "eta", m->medium.eta, "color_from",
                                                   m->color_from == PELL_COLOR_FROM_TEXTURE ? "texture" : "profile"));
    }
    for (size_t i = 0; i < r->num_problems; i++)
        json_array_append_new(problems, json_pack("{s:s,s:s,s:s}", "severity", severities[r->problems[i].severity], "where", r->problems[i].where,
                                                  "what", r->problems[i].what));
    for (size_t i = 0; i < cli_warning_count(cli); i++)
        json_array_append_new(problems, json_pack("{s:s,s:s,s:s}", "severity", "warning", "where", "", "what", cli_warning(cli, i)));
    for (size_t i = 0; i < r->num_objects; i++) {
        const struct pell_object_report *o = &r->objects[i];
        json_array_append_new(objects, json_pack("{s:s,s:I,s:b,s:b,s:i,s:I,s:I,s:f,s:f,s:f}", "name", o->name, "triangles", (json_int_t) o->triangles,
                                                 "closed", (int) o->closed, "outward", (int) o->outward, "components", o->components,
                                                 "boundary_edges", (json_int_t) o->boundary_edges, "nonmanifold_edges",
                                                 (json_int_t) o->nonmanifold_edges, "volume_mm3", o->volume_mm3, "area_mm2", o->area_mm2,
                                                 "thickness_mm", o->thickness_mm));
    }
    return cli_print_json(cli, json_pack("{s:I,s:I,s:o,s:o,s:o,s:o}", "meshes", (json_int_t) scene->num_meshes, "triangles", (json_int_t) r->triangles,
                                         "bounds_mm", bounds_json(r), "materials", materials, "objects", objects, "problems", problems));
}

static void print_material(const struct cli *cli, const struct pell_material *m)
{
    (void) cli;
    printf("  %-20s ", m->name[0] ? m->name : "(no name)");
    if (m->opaque) {
        printf("opaque\n");
        return;
    }
    printf("%s%s", m->preset && m->preset[0] ? m->preset : "coefficients of the file", m->color_from == PELL_COLOR_FROM_TEXTURE ? ", colour from the texture" : ", colour from the profile");
    if (m->gaussians.count > 0)
        printf(", %d Gaussians\n", m->gaussians.count);
    else
        printf(", mean free path %.3g %.3g %.3g mm, eta %.3g\n", pell_mean_free_path(&m->medium, 0), pell_mean_free_path(&m->medium, 1),
               pell_mean_free_path(&m->medium, 2), m->medium.eta);
}

static void answer_text(const struct cli *cli, const struct pell_scene *scene, const struct pell_scene_report *r)
{
    printf("%zu meshes, %lld triangles, %.4g x %.4g x %.4g mm (one unit was taken for %.6g mm)\n", scene->num_meshes, (long long) r->triangles,
           (double) (r->bounds_max[0] - r->bounds_min[0]), (double) (r->bounds_max[1] - r->bounds_min[1]),
           (double) (r->bounds_max[2] - r->bounds_min[2]), scene->mm_per_unit);
    printf("%zu lights, %zu cameras, %zu textures\n\n%sObjects%s\n", scene->num_lights, scene->num_cameras, scene->num_textures, cli_style(cli, 1), cli_style(cli, 0));
    for (size_t i = 0; i < r->num_objects; i++) {
        const struct pell_object_report *o = &r->objects[i];
        printf("  %-20s %9lld triangles, %s%s, mean thickness %.3g mm\n", o->name[0] ? o->name : "(no name)", (long long) o->triangles,
               o->closed ? "closed" : "open", o->closed && !o->outward ? ", inside out" : "", o->thickness_mm);
    }
    printf("\n%sMaterials%s\n", cli_style(cli, 1), cli_style(cli, 0));
    for (size_t i = 0; i < scene->num_materials; i++)
        print_material(cli, &scene->materials[i]);
    printf("\n%s%zu problems%s\n", cli_style(cli, 1), r->num_problems, cli_style(cli, 0));
    for (size_t i = 0; i < r->num_problems; i++)
        printf("  %-8s %s%s%s\n", severities[r->problems[i].severity], r->problems[i].where, r->problems[i].where[0] ? ": " : "", r->problems[i].what);
}

enum exit_code command_check(struct cli *cli)
{
    struct pell_scene *scene = NULL;
    struct pell_scene_report report = { 0 };
    struct pell_load_params params;
    enum exit_code code = cli_load_params(cli, &params);
    enum pell_result res;

    if (code != EXIT_OK)
        return code;
    params.bare = true;
    res = pell_scene_load(cli->ctx, cli->arguments[0], &params, &scene);
    if (res == PELL_OK)
        res = pell_scene_check(scene, &report);
    code = cli_failed(cli, res);
    if (res == PELL_OK) {
        if (cli->json)
            code = answer_json(cli, scene, &report);
        else
            answer_text(cli, scene, &report);
        for (size_t i = 0; i < report.num_problems; i++)
            if (report.problems[i].severity == PELL_SEVERITY_ERROR)
                code = EXIT_INPUT;
    }
    pell_scene_report_finish(cli->ctx, &report);
    pell_scene_destroy(&scene);
    return code;
}
