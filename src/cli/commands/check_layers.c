/* SPDX-License-Identifier: MIT
 * check_layers.c - `pellucid check --cross-section`: plots the layers below a line on the surface. */
#include "cli/commands/check_layers.h"

#include "cli/plot.h"
#include "math/vec.h"
#include "transport/medium_layers.h"
#include "visibility/rays.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SAMPLES = 1201, MAX_CURVES = PELL_LAYERS_MOST + 3 };
#define UNIFORM_LENGTH 10.0 /* mm, length of the plot for layers of uniform depth */

/* A sample of the line on the surface. */
struct surface_sample {
    const struct pell_mesh *mesh; /* NULL: not on the surface */
    uint32_t triangle;
    float u, v; /* barycentric */
    bool mirrored;
    struct pell_vec3 position, normal; /* mm; unit, outward */
};

struct section {
    struct cli *cli;
    const struct pell_scene *scene;
    const struct pell_material *material;
    struct pell_medium_layers medium_layers;
    double line[4]; /* texture coordinates */
    int uv;         /* index of the UV set of the line */
    double down_to; /* mm, 0: to be found */
    struct surface_sample samples[SAMPLES];
    double x[SAMPLES], across[SAMPLES];            /* mm along the surface; mm to the opposite side of the solid. Not finite: none */
    double bottoms[PELL_LAYERS_MOST + 2][SAMPLES]; /* the surface, then the bottoms of the layers, then the lower end of the plot */
};

/* --- Options ------------------------------------------------------------------------------------------------------------------ */

static bool painted(const struct pell_material *m)
{
    for (int i = 0; i < m->num_layers; i++)
        if (m->layers[i].depth_map.texture)
            return true;
    return false;
}

/* The named material; else the first with texture-mapped layers, else with layers, else translucent. */
static const struct pell_material *choose_material(const struct pell_scene *scene, const char *name)
{
    const struct pell_material *best = NULL;
    int rank = 0;

    for (size_t i = 0; i < scene->num_materials; i++) {
        const struct pell_material *m = &scene->materials[i];
        const int own_rank = painted(m) ? 3 : m->num_layers > 0 ? 2 : !m->opaque;
        if (name && strcmp(m->name ? m->name : "", name) == 0)
            return m;
        if (!name && own_rank > rank) {
            best = m;
            rank = own_rank;
        }
    }
    return best;
}

static bool read_line(const char *text, double line[4])
{
    for (int i = 0; i < 4; i++) {
        const size_t n = strcspn(text, ",");
        if (!pell_parse_number(text, n, &line[i]) || fabs(line[i]) > 1e4 || (text[n] == ',') != (i < 3))
            return false;
        text += n + 1;
    }
    return line[0] != line[2] || line[1] != line[3];
}

static enum exit_code read_options(struct section *s)
{
    struct cli *cli = s->cli;
    char name[96];

    s->line[0] = 0.0;
    s->line[2] = 1.0;
    s->line[1] = s->line[3] = 0.5;
    if (cli->check.line && !read_line(cli->check.line, s->line))
        return cli_usage(cli, "--line", "as in --line 0.2,0.5,0.8,0.5",
                         "\"%s\", must be four numbers with commas between, of two different places", cli->check.line);
    if (cli->check.down_to) {
        const enum pell_result res = pell_parse_length(cli->ctx, "--down-to", cli->check.down_to, &s->down_to);
        if (res != PELL_OK)
            return cli_failed(cli, res);
    }
    s->material = choose_material(s->scene, cli->check.layers_of);
    if (!s->material && cli->check.layers_of)
        return cli_usage(cli, "--layers-of", "`pellucid check` lists the materials", "\"%s\", no material has that name",
                         pell_printable(cli->check.layers_of, name, sizeof(name)));
    if (!s->material || s->material->opaque)
        return cli_failed(cli, pell_error(cli->ctx, PELL_ERR_INVALID, "--cross-section", "give one layers, coefficients or a preset",
                                          s->material ? "the material is opaque: there is nothing below its surface"
                                                      : "no material is translucent: there is nothing below a surface"));
    return cli_failed(cli, pell_medium_layers_make(cli->ctx, "check", s->material, &s->medium_layers));
}

/* --- Along the line ----------------------------------------------------------------------------------------------------------- */

static void set_sample(const struct pell_mesh *mesh, uint32_t triangle, const double w[3], bool mirrored, struct surface_sample *out)
{
    const uint32_t *corner = mesh->index + 3 * (size_t) triangle;
    double p[3][3];

    for (int k = 0; k < 3; k++)
        for (int c = 0; c < 3; c++)
            p[k][c] = (double) mesh->position[3 * (size_t) corner[k] + (size_t) c];
    const double a[3] = { p[1][0] - p[0][0], p[1][1] - p[0][1], p[1][2] - p[0][2] };
    const double b[3] = { p[2][0] - p[0][0], p[2][1] - p[0][1], p[2][2] - p[0][2] };
    const double n[3] = { a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0] };
    const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);

    if (!(length > 0.0))
        return;
    *out = (struct surface_sample) {
        .mesh = mesh,
        .triangle = triangle,
        .u = (float) w[1],
        .v = (float) w[2],
        .mirrored = mirrored,
        .position = { (float) (w[0] * p[0][0] + w[1] * p[1][0] + w[2] * p[2][0]),
                      (float) (w[0] * p[0][1] + w[1] * p[1][1] + w[2] * p[2][1]),
                      (float) (w[0] * p[0][2] + w[1] * p[1][2] + w[2] * p[2][2]) },
        .normal = { (float) (n[0] / length), (float) (n[1] / length), (float) (n[2] / length) },
    };
}

/* Assigns the samples of the line that lie in a triangle of the UV map. If several points have the same texture coordinates, the first that
 * is not mirrored counts, else the first. */
static void cut_triangle(struct section *s, const struct pell_mesh *mesh, uint32_t triangle)
{
    const uint32_t *corner = mesh->index + 3 * (size_t) triangle;
    const double du = s->line[2] - s->line[0], dv = s->line[3] - s->line[1];
    double t[3][2], low = 0.0, high = 1.0;

    for (int k = 0; k < 3; k++)
        for (int c = 0; c < 2; c++)
            t[k][c] = (double) mesh->uv[s->uv][2 * (size_t) corner[k] + (size_t) c];
    const double area = (t[1][0] - t[0][0]) * (t[2][1] - t[0][1]) - (t[2][0] - t[0][0]) * (t[1][1] - t[0][1]);
    if (area == 0.0 || !isfinite(area))
        return;
    for (int k = 0; k < 3; k++) { /* weight of corner k along the line: a + b f >= 0 */
        const double *p = t[(k + 1) % 3], *q = t[(k + 2) % 3];
        const double a = ((q[0] - p[0]) * (s->line[1] - p[1]) - (q[1] - p[1]) * (s->line[0] - p[0])) / area;
        const double b = ((q[0] - p[0]) * dv - (q[1] - p[1]) * du) / area;
        if (b == 0.0 && a < 0.0)
            return;
        if (b > 0.0)
            low = fmax(low, -a / b);
        else if (b < 0.0)
            high = fmin(high, -a / b);
    }
    if (!(low <= high)) /* low may be far outside [0, 1] then */
        return;
    for (int i = (int) ceil(low * (SAMPLES - 1)); i <= (int) floor(high * (SAMPLES - 1)); i++) {
        struct surface_sample *at = &s->samples[i];
        const double f = (double) i / (SAMPLES - 1), u = s->line[0] + f * du, v = s->line[1] + f * dv;
        double w[3];
        if (at->mesh && (!at->mirrored || area > 0.0))
            continue;
        for (int k = 0; k < 3; k++) {
            const double *p = t[(k + 1) % 3], *q = t[(k + 2) % 3];
            w[k] = fmin(fmax(((q[0] - p[0]) * (v - p[1]) - (q[1] - p[1]) * (u - p[0])) / area, 0.0), 1.0);
        }
        set_sample(mesh, triangle, w, area > 0.0, at); /* v points down: an unmirrored triangle is clockwise there */
    }
}

static void cut_surface(struct section *s)
{
    const int material = (int) (s->material - s->scene->materials);

    for (int i = 0; i < s->medium_layers.count; i++)
        if (s->medium_layers.item[i].map)
            s->uv = s->medium_layers.item[i].map->uv;
    for (size_t i = 0; i < s->scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &s->scene->meshes[i];
        for (uint32_t k = 0; mesh->material == material && mesh->uv[s->uv] && k < mesh->num_triangles; k++)
            cut_triangle(s, mesh, k);
    }
}

/* Traces along the inward normal to the opposite side of the solid, or to another surface. */
static enum pell_result trace_inward(struct section *s)
{
    struct pell_pool *pool = NULL;
    struct pell_rays *rays = NULL;
    enum pell_result res;

    PELL_TRY(pell_pool_create(s->cli->ctx, 1, &pool));
    PELL_TRY(pell_rays_create(s->cli->ctx, s->scene, pool, &rays));
    for (int i = 0; i < SAMPLES; i++) {
        const struct surface_sample *at = &s->samples[i];
        struct pell_ray ray = { .tnear = 1e-4f, .tfar = INFINITY, .mask = PELL_RAY_ALL };
        struct pell_hit hit;
        const float p[3] = { at->position.x, at->position.y, at->position.z }, n[3] = { at->normal.x, at->normal.y, at->normal.z };
        s->across[i] = (double) NAN;
        if (!at->mesh)
            continue;
        for (int c = 0; c < 3; c++) {
            ray.origin[c] = p[c];
            ray.direction[c] = -n[c];
            ray.tnear = fmaxf(ray.tnear, 4e-6f * fabsf(p[c]));
        }
        if (pell_rays_closest(rays, &ray, &hit))
            s->across[i] = (double) hit.t;
    }

fail:
    pell_rays_destroy(&rays);
    pell_pool_destroy(&pool);
    return res;
}

/* Measures lengths along the surface and the depths there. A jump between charts of the UV map breaks the curves. */
static int measure(struct section *s)
{
    const struct surface_sample *last = NULL;
    float depth[PELL_LAYERS_MOST];
    double step = 0.0, x = 0.0;
    int found = 0;

    for (int i = 0; i < SAMPLES; i++) {
        const struct surface_sample *at = &s->samples[i];
        bool broken = !at->mesh;
        if (at->mesh && last) {
            const double distance = hypot(hypot((double) (at->position.x - last->position.x), (double) (at->position.y - last->position.y)),
                                          (double) (at->position.z - last->position.z));
            broken = found > 1 && (last != at - 1 || distance > 20.0 * step + 1e-3 * x);
            x += broken ? 0.0 : distance;
            step = fmax(step, broken ? 0.0 : distance);
        }
        s->x[i] = broken ? (double) NAN : x;
        if (at->mesh) {
            last = at;
            found++;
            pell_medium_layers_depths(&s->medium_layers, at->mesh, at->triangle, at->u, at->v, depth);
        }
        for (int k = 0; k < s->medium_layers.count; k++)
            s->bottoms[k + 1][i] = at->mesh ? (double) depth[k] : (double) NAN;
    }
    return found;
}

/* Uniform layers need no surface. */
static void measure_uniform(struct section *s)
{
    for (int i = 0; i < SAMPLES; i++) {
        s->x[i] = UNIFORM_LENGTH * i / (SAMPLES - 1);
        s->across[i] = (double) NAN;
        for (int k = 0; k < s->medium_layers.count; k++)
            s->bottoms[k + 1][i] = s->medium_layers.item[k].depth;
    }
}

/* The depth range of the plot: the deepest bottom, no deeper than the solid; a layer without a bottom gets five more mean free paths. */
static double choose_depth(const struct section *s)
{
    const struct pell_layer_medium *lowest = &s->medium_layers.item[s->medium_layers.count - 1];
    double deepest = 0.0, solid = 0.0, mfp = 0.0;

    for (int i = 0; i < SAMPLES; i++) {
        for (int k = 1; k <= s->medium_layers.count; k++)
            if (isfinite(s->bottoms[k][i]))
                deepest = fmax(deepest, s->bottoms[k][i]);
        if (isfinite(s->across[i]))
            solid = fmax(solid, s->across[i]);
    }
    for (int c = 0; c < 3; c++)
        if (lowest->sigma_t[c] >= PELL_SIGMA_T_MIN)
            mfp = fmax(mfp, 1.0 / lowest->sigma_t[c]);
    if (!isfinite(lowest->depth))
        deepest += 5.0 * mfp;
    if (solid > 0.0)
        deepest = fmin(deepest, solid);
    return deepest > 0.0 ? 1.02 * deepest : 1.0;
}

/* --- The plot ----------------------------------------------------------------------------------------------------------------- */

static const enum plot_color layer_colors[] = { PLOT_ORANGE, PLOT_RED, PLOT_SKY, PLOT_GREEN, PLOT_PURPLE, PLOT_BLUE };

static const char *name_of(const struct section *s, int layer, char text[96])
{
    const char *name = s->medium_layers.item[layer].name;
    char shown[80];

    if (name && name[0])
        snprintf(text, 96, "%s", pell_printable(name, shown, sizeof(shown)));
    else
        snprintf(text, 96, s->medium_layers.count > 1 ? "layer %d" : "medium", layer);
    return text;
}

static void clip_to(struct section *s, double bottom)
{
    const int below = s->medium_layers.count + 1;

    for (int i = 0; i < SAMPLES; i++) {
        s->bottoms[0][i] = 0.0;
        s->bottoms[below][i] = isnan(s->bottoms[1][i]) ? (double) NAN : bottom;
        for (int k = 1; k <= below; k++)
            s->bottoms[k][i] = isnan(s->bottoms[k][i]) ? s->bottoms[k][i] : fmin(s->bottoms[k][i], bottom);
    }
}

/* Whether a layer, or the medium below all layers, is thick enough anywhere to be visible. */
static bool visible(const struct section *s, int layer, double bottom)
{
    for (int i = 0; i < SAMPLES; i++)
        if (s->bottoms[layer + 1][i] - s->bottoms[layer][i] > 1e-6 * bottom)
            return true;
    return false;
}

static enum pell_result draw(struct section *s, double length)
{
    static const char *const substrates[] = { "nothing below: black", "the last layer continues", "a surface of the base colour" };
    struct plot_curve curves[MAX_CURVES] = { 0 };
    struct plot_panel panel = { .x = { .label = "along the surface, mm", .max = length },
                                .y = { .label = "depth, mm", .down = true, .max = s->down_to },
                                .curves = curves,
                                .legend = true };
    char names[PELL_LAYERS_MOST][96], title[160], caption[240], shown[96];
    const int count = s->medium_layers.count;

    clip_to(s, s->down_to);
    for (int k = 0; k <= count; k++) {
        struct plot_curve *c = &curves[panel.num_curves];
        *c = (struct plot_curve) { .x = s->x, .y = s->bottoms[k + 1], .base = s->bottoms[k], .count = SAMPLES };
        c->color = s->medium_layers.substrate == PELL_SUBSTRATE_STOP ? PLOT_BLACK : PLOT_GREY;
        if (k < count)
            c->color = layer_colors[k % (int) PELL_COUNT(layer_colors)];
        c->label = k < count ? name_of(s, k, names[k]) : substrates[s->medium_layers.substrate];
        if (k == count && s->medium_layers.substrate == PELL_SUBSTRATE_LAST)
            c->color = layer_colors[(count - 1) % (int) PELL_COUNT(layer_colors)];
        panel.num_curves += visible(s, k, s->down_to);
    }
    curves[panel.num_curves] = (struct plot_curve) {
        .x = s->x, .y = s->across, .count = SAMPLES, .color = PLOT_BLACK, .line = PLOT_DASHED, .label = "other side of the solid"
    };
    for (int i = 0; i < SAMPLES; i++)
        if (s->across[i] <= s->down_to) {
            panel.num_curves++;
            break;
        }
    snprintf(title, sizeof(title), "Layers below the surface of %s",
             s->material->name && s->material->name[0] ? pell_printable(s->material->name, shown, sizeof(shown)) : "the material");
    if (s->medium_layers.has_maps)
        snprintf(caption, sizeof(caption),
                 "From texture coordinates %.4g, %.4g to %.4g, %.4g. \u00b7 Depth is drawn %.3g times as large as length.", s->line[0],
                 s->line[1], s->line[2], s->line[3], 330.0 / s->down_to / (780.0 / length));
    else
        snprintf(caption, sizeof(caption), "The same everywhere: no layer is painted.");
    return plot_write(s->cli->ctx, s->cli->check.cross_section,
                      &(struct plot) { .title = title,
                                       .caption = caption,
                                       .width = 860,
                                       .height = 440,
                                       .columns = 1,
                                       .rows = 1,
                                       .row_fraction = { 1.0 },
                                       .panels = &panel });
}

/* --- The answer --------------------------------------------------------------------------------------------------------------- */

static void add_answer(const struct section *s, double length, json_t **answer)
{
    json_t *layers = json_array();
    char name[96];

    for (int k = 1; k <= s->medium_layers.count; k++) {
        double low = INFINITY, high = -INFINITY, sum = 0.0;
        int n = 0;
        for (int i = 0; i < SAMPLES; i++)
            if (!isnan(s->bottoms[k][i])) {
                low = fmin(low, s->bottoms[k][i]);
                high = fmax(high, s->bottoms[k][i]);
                sum += s->bottoms[k][i];
                n++;
            }
        json_t *layer = json_pack("{s:o}", "name", cli_text(name_of(s, k - 1, name)));
        if (n > 0 && isfinite(sum)) /* without a bottom there are no depths to report */
            json_object_set_new(layer, "depth_mm", json_pack("{s:f,s:f,s:f}", "min", low, "mean", sum / n, "max", high));
        json_array_append_new(layers, layer);
    }
    *answer = json_pack("{s:o,s:o,s:f,s:f,s:o}", "file", cli_text(s->cli->check.cross_section), "material", cli_text(s->material->name),
                        "length_mm", length, "down_to_mm", s->down_to, "layers", layers);
}

static enum exit_code cut(struct section *s, json_t **answer)
{
    double length = UNIFORM_LENGTH;
    enum pell_result res = PELL_OK;
    enum exit_code code = read_options(s);

    if (code != EXIT_OK)
        return code;
    if (s->medium_layers.has_maps) {
        cut_surface(s);
        length = 0.0;
        if (measure(s) < 2)
            return cli_failed(s->cli, pell_error(s->cli->ctx, PELL_ERR_INVALID, "--line", "0,0 is the upper left corner of the depth map",
                                                 "the line from %g, %g to %g, %g crosses no surface of the material", s->line[0],
                                                 s->line[1], s->line[2], s->line[3]));
        for (int i = 0; i < SAMPLES; i++)
            length = isnan(s->x[i]) ? length : fmax(length, s->x[i]);
        res = trace_inward(s);
    } else {
        measure_uniform(s);
    }
    if (res == PELL_OK) {
        length = fmax(length, 1e-6);
        s->down_to = s->down_to > 0.0 ? s->down_to : choose_depth(s);
        add_answer(s, length, answer);
        res = draw(s, length);
    }
    return cli_failed(s->cli, res);
}

enum exit_code check_layers_options(struct cli *cli)
{
    const char *const path = cli->check.cross_section, *const idle[][2] = { { "--line", cli->check.line },
                                                                            { "--down-to", cli->check.down_to },
                                                                            { "--layers-of", cli->check.layers_of } };

    for (size_t i = 0; !path && i < PELL_COUNT(idle); i++)
        if (idle[i][1])
            return cli_usage(cli, idle[i][0], "add --cross-section layers.png", "needs --cross-section");
    if (path && !plot_can_write(path))
        return cli_usage(cli, "--cross-section", NULL, "\"%s\", a plot must end in .svg, .pdf or .png", path);
    if (path && strcmp(path, cli->arguments[0]) == 0)
        return cli_usage(cli, "--cross-section", NULL, "\"%s\" is the input", path);
    return EXIT_OK;
}

enum exit_code check_layers(struct cli *cli, const struct pell_scene *scene, json_t **answer)
{
    struct section *s = pell_alloc_array(cli->ctx, 1, sizeof(*s));
    enum exit_code code;

    if (!s)
        return cli_failed(cli, PELL_ERR_NOMEM);
    memset(s, 0, sizeof(*s));
    s->cli = cli;
    s->scene = scene;
    code = cli_spare_input(cli, "--cross-section", cli->check.cross_section);
    if (code == EXIT_OK)
        code = cut(s, answer);
    pell_free(cli->ctx, s);
    return code;
}
