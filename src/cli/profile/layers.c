/* SPDX-License-Identifier: MIT
 * layers.c - layered materials for `pellucid profile`: a stack from a file, or skin, by three solvers. */
#include "cli/profile/profile.h"
#include "cli/profile/stack.h"

#include "scene/scene.h"

#include <pellucid/skin.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SKIN_FIELDS = 6 };

/* Returns -1 and reports an error if there is no solver of that name. */
static int find_solver(struct cli *cli, const char *name)
{
    struct pell_text hint = { .length = 0 };
    bool near;

    for (int i = 0; i < STACK_SOLVERS; i++)
        if (strcmp(name, stack_solver_names[i]) == 0)
            return i;
    near = pell_text_suggest(&hint, "", name, stack_solver_names, STACK_SOLVERS);
    cli_usage(cli, "--solver", near ? hint.str : NULL, "\"%s\", must be hankel, gaussian, analytic or all", name);
    return -1;
}

/* Solves the three problems (one per channel) by --solver, or by all solvers, the first of which the others are compared with. */
static enum exit_code solve_all(struct cli *cli, struct profile_job *job, struct stack_problem problems[3])
{
    const char *name = cli->profile.solver ? cli->profile.solver : stack_solver_names[0];
    const bool all = strcmp(name, "all") == 0;
    const int only = all ? 0 : find_solver(cli, name);
    unsigned flags = 0;
    enum exit_code code =
        only < 0 ? EXIT_USAGE : profile_take_number(cli, "--roughness", cli->profile.roughness, 0.0, 1.0, &job->params.roughness);

    if (code == EXIT_OK && all && !(job->others = calloc(STACK_SOLVERS - 1, sizeof(*job->others))))
        code = EXIT_MEMORY;
    job->layers = true;
    for (int s = only; s < (all ? STACK_SOLVERS : only + 1) && code == EXIT_OK; s++) {
        struct candidate *k = all && s ? &job->others[s - 1] : job->profile;
        k->name = stack_solver_names[s];
        for (int c = 0; c < 3 && code == EXIT_OK; c++) {
            unsigned raised = 0;
            problems[c].solver = (enum stack_solver) s;
            /* A stack that begins inside has no boundary of its own. */
            problems[c].roughness = problems[c].eta_above == 0.0 ? job->params.roughness : 0.0;
            code = cli_failed(cli, stack_solve(cli->ctx, &problems[c], &k->R[c], job->slab ? &k->T[c] : NULL, &raised));
            flags |= raised;
            if (pell_cancelled(cli->ctx))
                code = EXIT_INTERRUPTED;
        }
        job->num_others += k != job->profile && code == EXIT_OK;
    }
    if (code == EXIT_OK && stack_warning(flags))
        pell_warn(cli->ctx, job->name, NULL, "%s", stack_warning(flags));
    job->model = job->profile->name;
    return code;
}

enum exit_code profile_open_layers(struct cli *cli, struct profile_job *job, const struct pell_material_layers *layers)
{
    struct stack_problem problems[3];
    enum exit_code code = profile_refuse_medium_options(cli, job, "stack of layers");

    if (code != EXIT_OK)
        return code;
    job->slab = !isinf(layers->item[layers->count - 1].thickness_mm);
    for (int c = 0; c < 3; c++)
        problems[c] = (struct stack_problem) { .where = job->name, .layers = layers, .channel = c };
    return solve_all(cli, job, problems);
}

enum exit_code profile_open_stack_file(struct cli *cli, struct profile_job *job)
{
    struct pell_material_entry entry = { 0 };
    enum exit_code code = EXIT_OK;

    pell_printable(cli->profile.layers, job->name, sizeof(job->name));
    if (!pell_material_is_path(cli->profile.layers) && !pell_material_find(cli->profile.layers))
        return cli_usage(cli, "--layers", NULL,
                         "\"%s\", must be a material file with layers (stack.json), or a built-in material of layers", cli->profile.layers);
    code = cli_failed(cli, pell_material_open(cli->ctx, "--layers", cli->profile.layers, &entry));
    if (code == EXIT_OK && entry.kind != PELL_MATERIAL_LAYERS)
        code = cli_usage(cli, "--layers", "`pellucid profile` takes it without --layers", "\"%s\" has no layers", cli->profile.layers);
    if (code == EXIT_OK)
        code = profile_open_layers(cli, job, &entry.layers);
    pell_free(cli->ctx, (char *) entry.name);
    return code;
}

/* --- Skin ----------------------------------------------------------------------------------------------------------------------- */

/* Parses NAME=VALUE,NAME=VALUE over the defaults. */
static enum exit_code read_skin(struct cli *cli, struct pell_skin *skin)
{
    const struct {
        const char *name;
        double *value;
    } fields[SKIN_FIELDS] = { { "melanin", &skin->melanin },         { "melanin-blend", &skin->melanin_blend },
                              { "haemoglobin", &skin->haemoglobin }, { "oxygenation", &skin->oxygenation },
                              { "epidermis", &skin->epidermis_mm },  { "eta", &skin->eta } };
    const char *text = cli->profile.skin ? cli->profile.skin : "default", *names[SKIN_FIELDS];
    struct pell_medium_fault fault;
    bool seen[SKIN_FIELDS] = { false };

    for (int i = 0; i < SKIN_FIELDS; i++)
        names[i] = fields[i].name;
    *skin = pell_skin_default();
    while (strcmp(text, "default") != 0) {
        const size_t length = strcspn(text, ","), n = strcspn(text, "=,");
        char name[40], value[40];
        int found = -1;

        snprintf(name, sizeof(name), "%.*s", (int) (n < 39 ? n : 39), text);
        snprintf(value, sizeof(value), "%.*s", (int) (length - n < 40 ? length - n : 39), n < length ? text + n + 1 : "");
        if (n < length && length - n <= sizeof(value))
            value[length - n - 1] = '\0';
        for (int i = 0; i < SKIN_FIELDS; i++)
            if (strcmp(name, names[i]) == 0)
                found = i;
        if (found < 0) {
            struct pell_text hint = { .length = 0 };
            const bool near = pell_text_suggest(&hint, "", name, names, SKIN_FIELDS);
            return cli_usage(cli, "--skin", near ? hint.str : NULL,
                             "there is no \"%s\", only melanin, melanin-blend, haemoglobin, oxygenation, epidermis and eta", name);
        }
        if (seen[found])
            return cli_usage(cli, "--skin", NULL, "gives %s twice", name);
        seen[found] = true;
        if (found == 4) {
            if (pell_parse_length(cli->ctx, "--skin", value, fields[found].value) != PELL_OK)
                return EXIT_USAGE;
        } else if (!pell_parse_number(value, strlen(value), fields[found].value)) {
            return cli_usage(cli, "--skin", NULL, "%s is \"%s\", which is no number", name, value);
        }
        text += length;
        if (!*text++)
            break;
    }
    if (!pell_skin_valid(skin, &fault))
        return cli_usage(cli, "--skin", NULL, "%s is %g, allowed: [%g, %g]", fault.field, fault.value, fault.min, fault.max);
    return EXIT_OK;
}

/* One wavelength: all channels have the same coefficients. */
static void set_layer(struct pell_material_layers *layers, int i, const struct pell_skin_coefficients *k, double eta, double thickness)
{
    struct pell_material_layer *layer = &layers->item[i];

    memset(layer, 0, sizeof(*layer));
    for (int c = 0; c < 3; c++) {
        layer->medium.sigma_a[c] = k->sigma_a;
        layer->medium.sigma_s_reduced[c] = k->sigma_s_reduced;
    }
    layer->medium.eta = eta;
    layer->thickness_mm = thickness;
    layers->count = i + 1;
}

static enum exit_code read_wavelength(struct cli *cli, double *nm)
{
    const char *text = cli->profile.wavelength;
    char hint[80];
    double mm;

    if (pell_parse_number(text, strlen(text), &mm)) {
        snprintf(hint, sizeof(hint), "write --wavelength %.40snm", text);
        return cli_usage(cli, "--wavelength", hint, "\"%s\" has no unit", text);
    }
    if (pell_parse_length(cli->ctx, "--wavelength", text, &mm) != PELL_OK)
        return EXIT_USAGE;
    *nm = mm * 1e6;
    if (!(*nm >= PELL_WAVELENGTH_MIN - 1e-6 && *nm <= PELL_WAVELENGTH_MAX + 1e-6))
        return cli_usage(cli, "--wavelength", NULL, "is %s, allowed: [%gnm, %gnm]", text, PELL_WAVELENGTH_MIN, PELL_WAVELENGTH_MAX);
    return EXIT_OK;
}

/* Figure 12 of d'Eon et al. 2007: the reflectance of the epidermis, the dermis and both at one wavelength. */
static enum exit_code open_wavelength(struct cli *cli, struct profile_job *job, const struct pell_skin *skin)
{
    static const char *const names[3] = { "epidermis", "dermis", "skin" };
    struct pell_skin_coefficients epidermis, dermis;
    struct pell_material_layers alone[2] = { { .count = 0 } }, both = { .count = 0 };
    double nm = 0.0;
    enum exit_code code = read_wavelength(cli, &nm);

    if (code == EXIT_OK)
        code = cli_failed(cli, pell_skin_at(skin, fmin(fmax(nm, PELL_WAVELENGTH_MIN), PELL_WAVELENGTH_MAX), &epidermis, &dermis));
    if (code != EXIT_OK)
        return code;
    memcpy(job->names, names, sizeof(names));
    memcpy(job->titles, names, sizeof(names));
    memcpy(job->columns, names, sizeof(names));
    snprintf(job->name, sizeof(job->name), "skin at %g nm", nm);
    set_layer(&alone[0], 0, &epidermis, skin->eta, skin->epidermis_mm);
    set_layer(&alone[1], 0, &dermis, skin->eta, INFINITY);
    set_layer(&both, 0, &epidermis, skin->eta, skin->epidermis_mm);
    set_layer(&both, 1, &dermis, skin->eta, INFINITY);
    /* A layer on its own has the same neighbouring indices as in the stack, where the index does not change between layers. */
    return solve_all(cli, job,
                     (struct stack_problem[3]) { { .where = job->name, .layers = &alone[0], .eta_below = skin->eta },
                                                 { .where = job->name, .layers = &alone[1], .eta_above = skin->eta },
                                                 { .where = job->name, .layers = &both } });
}

enum exit_code profile_open_skin(struct cli *cli, struct profile_job *job)
{
    struct pell_material_layers layers;
    struct pell_skin skin;
    enum exit_code code;

    snprintf(job->name, sizeof(job->name), "skin");
    code = profile_refuse_medium_options(cli, job, "stack of layers");
    if (code == EXIT_OK)
        code = read_skin(cli, &skin);
    if (code == EXIT_OK && cli->profile.wavelength)
        return open_wavelength(cli, job, &skin);
    if (code == EXIT_OK)
        code = cli_failed(cli, pell_skin_layers(&skin, &layers));
    return code == EXIT_OK ? profile_open_layers(cli, job, &layers) : code;
}
