/* SPDX-License-Identifier: MIT
 * export.c - a profile as code to paste into an engine: constants, and the functions that read them. */
#include "cli/profile/profile.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TABLE = 64 };

enum language { C, GLSL, HLSL, JSON, LANGUAGES };
const char *const profile_language_names[LANGUAGES + 1] = { "c", "glsl", "hlsl", "json", NULL };

#define SEPARABLE_ERROR_WARNED 0.05 /* error above which a separable kernel is reported as inaccurate */

/* The contents of an export. */
struct kernel {
    const struct profile_fit *fit;  /* NULL: none */
    struct pell_kernel_chain chain; /* count 0: each channel has its own variances */
    struct pell_separable separable;
    double r_max; /* last radius of the table, mm */
    double table[TABLE][3];
    double coverage[3]; /* fraction of the light that the table covers */
};

static enum language find_language(const char *name)
{
    for (int i = 0; i < LANGUAGES; i++)
        if (strcmp(name, profile_language_names[i]) == 0)
            return (enum language) i;
    return LANGUAGES;
}

enum exit_code profile_check_export(struct cli *cli)
{
    if (find_language(cli->profile.export) == LANGUAGES)
        return cli_usage(cli, "--export", NULL, "\"%s\", must be c, glsl, hlsl or json", cli->profile.export);
    if (cli->numbers.taps % 2 == 0)
        return cli_usage(cli, "--taps", NULL, "is %d, must be odd: one tap is in the centre", cli->numbers.taps);
    return EXIT_OK;
}

static enum pell_result make_kernel(const struct profile_job *job, int taps, int rank, struct kernel *k)
{
    float texel[TABLE];
    enum pell_result res = PELL_OK;

    memset(k, 0, sizeof(*k));
    k->fit = job->num_fits ? &job->fits[0] : NULL;
    if (k->fit && k->fit->shared.count > 0)
        res = pell_kernel_chain_make(&k->fit->shared, &k->chain);
    if (res == PELL_OK)
        res = pell_separable_make(job->profile->R, &(struct pell_separable_params) { .taps = taps, .rank = rank }, &k->separable);
    for (int c = 0; c < 3; c++)
        k->r_max = fmax(k->r_max, pell_profile_sample(&job->profile->R[c], 0.99));
    for (int c = 0; c < 3 && res == PELL_OK; c++) {
        k->coverage[c] = pell_profile_cdf(&job->profile->R[c], k->r_max);
        res = pell_kernel_table_value(&job->profile->R[c], k->r_max, texel, TABLE);
        for (int i = 0; i < TABLE; i++)
            k->table[i][c] = texel[i];
    }
    return res;
}

/* --- Words of the languages ----------------------------------------------------------------------------------------------------- */

/* The material's name as the beginning of an identifier. */
static void identify(const char *name, char id[64])
{
    size_t n = 0;

    if (!((*name >= 'a' && *name <= 'z') || (*name >= 'A' && *name <= 'Z')) || strncmp(name, "gl_", 3) == 0)
        id[n++] = 'm';
    for (; *name && n < 48; name++) {
        const char c = *name;
        const bool fits = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
        if (c == '.')
            break; /* a file extension */
        if (fits)
            id[n++] = c;
        else if (n && id[n - 1] != '_')
            id[n++] = '_';
    }
    while (n > 1 && id[n - 1] == '_')
        n--;
    id[n] = '\0';
}

/* Formats a number so that it is of type float in all three languages. */
static const char *number(double value, char text[40])
{
    pell_format_number(value == 0.0 ? 0.0 : (float) value, true, text, 36); /* no -0 */
    if (!strpbrk(text, ".e"))
        strcat(text, ".0");
    return text;
}

/* Begins a constant with its type. In C, unused constants cause no warning: the code is pasted whole. */
static void add_constant(struct profile_text *t, enum language l, const char *id, const char *type)
{
    if (l == C)
        profile_add(t, "static %s_unused const %s ", id, type);
    else
        profile_add(t, "%sconst %s ", l == GLSL ? "" : "static ", type);
}

static void add_integer(struct profile_text *t, enum language l, const char *id, const char *name, int value)
{
    if (l == C)
        profile_add(t, "enum { %s_%s = %d };\n", id, name, value);
    else
        profile_add(t, "%sconst int %s_%s = %d;\n", l == HLSL ? "static " : "", id, name, value);
}

static void add_float(struct profile_text *t, enum language l, const char *id, const char *name, double value)
{
    char text[40];
    add_constant(t, l, id, "float");
    profile_add(t, "%s_%s = %s%s;\n", id, name, number(value, text), l == C ? "f" : "");
}

static void add_floats(struct profile_text *t, enum language l, const char *id, const char *name, const double *v, int n)
{
    char text[40];

    add_constant(t, l, id, "float");
    profile_add(t, "%s_%s[%d] = %s", id, name, n, l == GLSL ? "float[](" : "{");
    for (int i = 0; i < n; i++)
        profile_add(t, "%s%s%s%s", i ? "," : "", i % 8 ? " " : "\n    ", number(v[i], text), l == C ? "f" : "");
    profile_add(t, "\n%s;\n", l == GLSL ? ")" : "}");
}

static void add_vectors(struct profile_text *t, enum language l, const char *id, const char *name, const double (*v)[3], int n)
{
    static const char *const opening[] = { "{ ", "vec3(", "{ " }, *const closing[] = { " }", ")", " }" };
    char text[3][40];

    add_constant(t, l, id, l == C ? "float" : l == GLSL ? "vec3" : "float3");
    profile_add(t, "%s_%s[%d]%s = %s\n", id, name, n, l == C ? "[3]" : "", l == GLSL ? "vec3[](" : "{");
    for (int i = 0; i < n; i++) {
        const char *f = l == C ? "f" : "";
        profile_add(t, "    %s%s%s, %s%s, %s%s%s%s\n", opening[l], number(v[i][0], text[0]), f, number(v[i][1], text[1]), f,
                    number(v[i][2], text[2]), f, closing[l], i + 1 < n ? "," : "");
    }
    profile_add(t, "%s;\n", l == GLSL ? ")" : "}");
}

static void add_comment(struct profile_text *t, enum language l, const char *text)
{
    while (*text) {
        const size_t n = strcspn(text, "\n");
        profile_add(t, l == C ? "/* %.*s */\n" : "// %.*s\n", (int) n, text);
        text += n + (text[n] == '\n');
    }
}

/* --- Code ----------------------------------------------------------------------------------------------------------------------- */

static void fit_arrays(const struct profile_fit *fit, double variance[][3], double weight[][3])
{
    /* A channel with fewer Gaussians is padded with weights of 0. */
    for (int i = 0; i < fit->k; i++)
        for (int c = 0; c < 3; c++) {
            const struct pell_gaussians *g = &fit->sum[c];
            variance[i][c] = i < g->count ? g->variance[i] : 1.0;
            weight[i][c] = i < g->count ? g->weight[i][0] : 0.0;
        }
}

static void add_fit(struct profile_text *t, enum language l, const char *id, const struct kernel *k)
{
    double variance[PELL_GAUSSIANS_MAX][3], weight[PELL_GAUSSIANS_MAX][3], sd[PELL_GAUSSIANS_MAX];
    const int n = k->fit->k;

    fit_arrays(k->fit, variance, weight);
    profile_add(t, "\n");
    add_comment(t, l, "R(r) ~ Sum_i weight[i] exp(-r^2/(2 variance[i]))/(2 pi variance[i]), r in mm, R in 1/mm^2. The weights sum to the");
    add_comment(t, l, "diffuse reflectance: divide by it where a texture holds the albedo.");
    add_integer(t, l, id, "gaussians", n);
    add_vectors(t, l, id, "variance", (const double(*)[3]) variance, n);
    add_vectors(t, l, id, "weight", (const double(*)[3]) weight, n);
    if (l == C)
        profile_add(t,
                    "static inline %s_unused float %s_profile(int channel, float r)\n{\n    float sum = 0.0f;\n"
                    "    for (int i = 0; i < %s_gaussians; i++)\n"
                    "        sum += %s_weight[i][channel] * expf(-0.5f * r * r / %s_variance[i][channel]) /\n"
                    "               (6.28318531f * %s_variance[i][channel]);\n    return sum;\n}\n",
                    id, id, id, id, id, id);
    else
        profile_add(
            t,
            "%s %s_profile(float r)\n{\n    %s sum = %s;\n    for (int i = 0; i < %s_gaussians; i++)\n"
            "        sum += %s_weight[i] * exp(-0.5 * r * r / %s_variance[i]) / (6.28318531 * %s_variance[i]);\n    return sum;\n}\n",
            l == GLSL ? "vec3" : "float3", id, l == GLSL ? "vec3" : "float3", l == GLSL ? "vec3(0.0)" : "float3(0.0, 0.0, 0.0)", id, id, id,
            id);
    if (k->chain.count == 0)
        return;
    for (int i = 0; i < k->chain.count; i++)
        sd[i] = sqrt(k->chain.step_mm2[i]);
    profile_add(t, "\n");
    add_comment(t, l, "The same as a chain of blurs: blur the last result by a Gaussian of the standard deviation blur_sd[i] (mm), then");
    add_comment(t, l, "sum = mix(sum, blurred, blur_blend[i]); after the last, times blur_total.");
    add_floats(t, l, id, "blur_sd", sd, k->chain.count);
    add_vectors(t, l, id, "blur_blend", (const double(*)[3]) k->chain.blend, k->chain.count);
    add_vectors(t, l, id, "blur_total", (const double(*)[3]) k->chain.total, 1);
}

/* Writes the weights of all terms one after the other. */
static void list_weights(const struct pell_separable *s, double weight[][3])
{
    for (int k = 0; k < s->rank; k++)
        memcpy(weight[k * s->taps], s->weight[k][0], (size_t) s->taps * sizeof(*weight));
}

/* Adds a blur pass; for kernels of several terms it has an argument `term`. */
static void add_blur(struct profile_text *t, enum language l, const char *id, bool terms)
{
    const char *const last = terms ? ", int term" : "";
    char at[80] = "i";

    if (terms)
        snprintf(at, sizeof(at), "term * %s_taps + i", id);
    if (l == GLSL)
        profile_add(t,
                    "vec3 %s_blur(sampler2D image, vec2 uv, vec2 uv_per_mm%s)\n{\n    vec3 sum = vec3(0.0);\n"
                    "    for (int i = 0; i < %s_taps; i++)\n"
                    "        sum += %s_tap_weight[%s] * texture(image, uv + %s_tap_offset[i] * uv_per_mm).rgb;\n    return sum;\n}\n",
                    id, last, id, id, at, id);
    else if (l == HLSL)
        profile_add(t,
                    "float3 %s_blur(Texture2D image, SamplerState samples, float2 uv, float2 uv_per_mm%s)\n{\n"
                    "    float3 sum = float3(0.0, 0.0, 0.0);\n    for (int i = 0; i < %s_taps; i++)\n"
                    "        sum += %s_tap_weight[%s] * image.SampleLevel(samples, uv + %s_tap_offset[i] * uv_per_mm, 0.0).rgb;\n"
                    "    return sum;\n}\n",
                    id, last, id, id, at, id);
}

static void add_separable(struct profile_text *t, enum language l, const char *id, const struct kernel *k)
{
    const struct pell_separable *s = &k->separable;
    double weight[PELL_KERNEL_RANK_MAX * PELL_KERNEL_TAPS_MAX][3];
    char line[160];

    profile_add(t, "\n");
    if (s->rank == 1) {
        add_comment(t, l,
                    "The best separable kernel: two passes, along x and along y, with the same taps. Offsets are mm on the surface: times\n"
                    "pixels per mm they are pixels. Both passes together multiply by the diffuse reflectance.");
    } else {
        snprintf(line, sizeof(line), "The best kernel of %d separable terms: for each, two passes, along x and along y, with its taps,",
                 s->rank);
        add_comment(t, l, line);
        add_comment(t, l,
                    "tap_weight[term * taps + i]; then the sum of the terms times tap_sign[term]. Offsets are mm on the surface: times\n"
                    "pixels per mm they are pixels. All of it multiplies by the diffuse reflectance.");
    }
    snprintf(line, sizeof(line), "Being separable costs an error of %.2f %.2f %.2f %%.", 100.0 * s->error[0], 100.0 * s->error[1],
             100.0 * s->error[2]);
    add_comment(t, l, line);
    list_weights(s, weight);
    add_integer(t, l, id, "taps", s->taps);
    if (s->rank > 1)
        add_integer(t, l, id, "terms", s->rank);
    add_floats(t, l, id, "tap_offset", s->offset_mm, s->taps);
    add_vectors(t, l, id, "tap_weight", (const double(*)[3]) weight, s->rank * s->taps);
    if (s->rank > 1)
        add_vectors(t, l, id, "tap_sign", s->sign, s->rank);
    add_blur(t, l, id, s->rank > 1);
}

static void add_table(struct profile_text *t, enum language l, const char *id, const struct kernel *k)
{
    char line[160];

    profile_add(t, "\n");
    add_comment(t, l, "R(r) as a table, 1/mm^2: texel i is the mean over the ring i <= r texels/table_mm < i + 1; 0 beyond table_mm (mm).");
    snprintf(line, sizeof(line), "It holds %.2f %.2f %.2f %% of the light: scale it where that must be all.", 100.0 * k->coverage[0],
             100.0 * k->coverage[1], 100.0 * k->coverage[2]);
    add_comment(t, l, line);
    add_integer(t, l, id, "texels", TABLE);
    add_float(t, l, id, "table_mm", k->r_max);
    add_vectors(t, l, id, "table", k->table, TABLE);
}

static void add_code(struct profile_text *t, const struct profile_job *job, enum language l, const struct kernel *k)
{
    char id[64], line[512];

    identify(job->name, id);
    snprintf(line, sizeof(line), "%s: %s%s. Made by pellucid %s.", id, job->model, job->params.roughness > 0.0 ? ", rough boundary" : "",
             pell_version_string());
    add_comment(t, l, line);
    snprintf(line, sizeof(line), "Channels: %s, %s, %s.", job->titles[0], job->titles[1], job->titles[2]);
    add_comment(t, l, line);
    if (job->has_medium) {
        snprintf(line, sizeof(line), "eta %g; sigma_a %g %g %g, sigma_s' %g %g %g 1/mm.", job->medium.eta, job->medium.sigma_a[0],
                 job->medium.sigma_a[1], job->medium.sigma_a[2], job->medium.sigma_s_reduced[0], job->medium.sigma_s_reduced[1],
                 job->medium.sigma_s_reduced[2]);
        add_comment(t, l, line);
    }
    if (l == C)
        profile_add(
            t, "#include <math.h>\n\n#if defined(__GNUC__)\n#define %s_unused __attribute__((unused))\n#else\n#define %s_unused\n#endif\n",
            id, id);
    if (k->fit)
        add_fit(t, l, id, k);
    add_separable(t, l, id, k);
    add_table(t, l, id, k);
}

static json_t *rows_of(const double (*v)[3], int n)
{
    json_t *list = json_array();
    for (int i = 0; i < n; i++)
        json_array_append_new(list, cli_numbers(v[i], 3));
    return list;
}

static void add_json(struct profile_text *t, const struct profile_job *job, const struct kernel *k)
{
    const struct pell_separable *s = &k->separable;
    double all[PELL_KERNEL_RANK_MAX * PELL_KERNEL_TAPS_MAX][3];
    json_t *o;
    char *dump;

    list_weights(s, all);
    o = json_pack("{s:o,s:s,s:o,s:{s:o,s:o,s:o},s:{s:f,s:o,s:o},s:[s,s,s]}", "material", cli_text(job->name), "model", job->model, "unit",
                  json_string("mm"), "separable", "offset_mm", cli_numbers(s->offset_mm, (size_t) s->taps), "weight",
                  rows_of((const double(*)[3]) all, s->rank * s->taps), "error", cli_numbers(s->error, 3), "table", "r_max_mm", k->r_max,
                  "R", rows_of(k->table, TABLE), "share", cli_numbers(k->coverage, 3), "channels", job->titles[0], job->titles[1],
                  job->titles[2]);
    if (o) {
        json_object_set_new(json_object_get(o, "separable"), "rank", json_integer(s->rank));
        json_object_set_new(json_object_get(o, "separable"), "sign", rows_of(s->sign, s->rank));
    }
    if (o && k->fit) {
        double variance[PELL_GAUSSIANS_MAX][3], weight[PELL_GAUSSIANS_MAX][3];
        fit_arrays(k->fit, variance, weight);
        json_object_set_new(o, "gaussians",
                            json_pack("{s:o,s:o,s:o}", "variance_mm2", rows_of((const double(*)[3]) variance, k->fit->k), "weight",
                                      rows_of((const double(*)[3]) weight, k->fit->k), "error", cli_numbers(k->fit->error, 3)));
    }
    if (o && k->chain.count > 0)
        json_object_set_new(o, "chain",
                            json_pack("{s:o,s:o,s:o}", "step_mm2", cli_numbers(k->chain.step_mm2, (size_t) k->chain.count), "blend",
                                      rows_of((const double(*)[3]) k->chain.blend, k->chain.count), "total",
                                      cli_numbers(k->chain.total, 3)));
    dump = o ? json_dumps(o, JSON_INDENT(2) | JSON_REAL_PRECISION(9)) : NULL;
    json_decref(o);
    if (!dump)
        t->failed = true;
    for (const char *at = dump; at && *at; at += strlen(at) < 500 ? strlen(at) : 500)
        profile_add(t, "%.500s", at);
    profile_add(t, "\n");
    free(dump);
}

enum pell_result profile_code(const struct profile_job *job, const char *language, int taps, int rank, struct profile_text *text,
                              double *separable_error)
{
    const enum language l = find_language(language);
    struct kernel kernel;
    const enum pell_result res = l == LANGUAGES ? PELL_ERR_INVALID : make_kernel(job, taps, rank, &kernel);

    if (res != PELL_OK)
        return res;
    if (separable_error)
        *separable_error = fmax(fmax(kernel.separable.error[0], kernel.separable.error[1]), kernel.separable.error[2]);
    if (l == JSON)
        add_json(text, job, &kernel);
    else
        add_code(text, job, l, &kernel);
    return text->failed ? PELL_ERR_NOMEM : PELL_OK;
}

enum exit_code profile_export(struct cli *cli, const struct profile_job *job)
{
    struct profile_text text = { .length = 0 };
    double error = 0.0;
    const enum pell_result res = profile_code(job, cli->profile.export, cli->numbers.taps, cli->numbers.rank, &text, &error);

    if (res == PELL_OK) {
        const enum exit_code code = profile_write(cli, &text);
        if (code == EXIT_OK && error > SEPARABLE_ERROR_WARNED)
            pell_warn(cli->ctx, job->name,
                      cli->numbers.rank < 3 ? "raise --rank, or use the exported Gaussians, each a blur of its own"
                                            : "use the exported Gaussians, each a blur of its own",
                      "its separable kernel of rank %d has an error of %.1f %%", cli->numbers.rank, 100.0 * error);
        return code;
    }
    free(text.bytes);
    return res == PELL_ERR_NOMEM
               ? EXIT_MEMORY
               : cli_failed(cli, pell_error(cli->ctx, res, "--export", NULL, "%s gives no kernel (%s): its reflectance may be 0", job->name,
                                            pell_result_name(res)));
}
