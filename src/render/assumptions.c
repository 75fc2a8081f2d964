/* SPDX-License-Identifier: MIT
 * assumptions.c - warns where diffusion is not valid for a scene, or its scattering is too small to show at this resolution. */
#include "render/renderer_state.h"

#include "base/hash.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* Scattering distances of a material, mm, in the channel where they are largest: mean free path, and distance below the surface. */
static void reach(const struct pell_material *m, double *largest_mfp, double *widest)
{
    *largest_mfp = *widest = 0.0;
    if (m->profile) {
        for (int c = 0; c < 3; c++)
            *widest = fmax(*widest, pell_profile_sample(&m->profile[c], 0.5));
        return;
    }
    if (m->gaussians.count > 0) {
        *widest = sqrt(m->gaussians.variance[m->gaussians.count - 1]);
        return;
    }
    for (int c = 0; c < 3; c++) {
        const double mfp = pell_mean_free_path(&m->medium, c), diffuse = pell_diffuse_mean_free_path(&m->medium, c);
        if (isfinite(mfp))
            *largest_mfp = fmax(*largest_mfp, mfp);
        if (isfinite(diffuse))
            *widest = fmax(*widest, diffuse);
    }
    if (*widest == 0.0)
        *widest = *largest_mfp;
}

/* Pixels per mm in the middle of the bounds. */
static double pixels_per_mm(const struct pell_scene *scene, const struct pell_settings *settings)
{
    const struct pell_view v = pell_view_make(&scene->cameras[0], settings->width, settings->height, 0.0f, 0.0f);
    const struct pell_vec3 middle = vec3_mul(vec3_add(vec3_load(scene->bounds_min), vec3_load(scene->bounds_max)), 0.5f);
    const float depth = vec3_dot(vec3_sub(middle, v.origin), v.forward);
    return v.orthographic ? v.focal_px : depth > 0.0f ? v.focal_px / depth : 0.0;
}

enum { OPEN, INVERTED, THIN, UNSEEN, FLAT, COINCIDENT, HOLDS_CAMERA, HOLDS_LIGHT, BARE, HOLLOW, KINDS };

/* The warnings of a scene so far: a limited number of each kind is logged, and none twice, as copies of an object have the same; the
 * others are counted. */
struct warnings {
    struct pell_context *ctx;
    int found[KINDS], logged[KINDS];
    uint64_t said[64]; /* hashes */
    size_t num_said;
};

static void warn(struct warnings *w, int kind, const char *where, const char *hint, const char *format, ...) PELL_PRINTF(5, 6);

static void warn(struct warnings *w, int kind, const char *where, const char *hint, const char *format, ...)
{
    char text[512];
    uint64_t hash;
    va_list args;

    va_start(args, format);
    vsnprintf(text, sizeof(text), format, args);
    va_end(args);
    hash = pell_hash_bytes(pell_hash_bytes((uint64_t) kind, where, strlen(where)), text, strlen(text));
    w->found[kind]++;
    for (size_t i = 0; i < w->num_said; i++)
        if (w->said[i] == hash)
            return;
    if (w->num_said < PELL_COUNT(w->said))
        w->said[w->num_said++] = hash;
    if (w->logged[kind] < pell_context_limits(w->ctx)->warnings) {
        w->logged[kind]++;
        pell_warn(w->ctx, where, hint, "%s", text);
    }
}

static void report_missing_uv(const struct pell_scene *scene, struct warnings *w)
{
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        const struct pell_material *m = &scene->materials[mesh->material];
        const int uv = pell_scene_missing_uv(mesh, m);
        if (uv >= 0)
            warn(w, BARE, mesh->name && mesh->name[0] ? mesh->name : "an unnamed mesh", "unwrap it, or leave the textures out",
                 "has no texture coordinates (UV set %d), which the textures of \"%s\" need", uv, m->name);
    }
}

enum pell_result pell_renderer_check_assumptions(struct pell_renderer *r, const struct pell_settings *settings)
{
    if (!r || !settings)
        return pell_null(r ? r->ctx : NULL, "pell_renderer_check_assumptions");

    const struct pell_scene *scene = r->scene;
    struct pell_context *ctx = r->ctx;
    static const char *const kinds[KINDS] = { "open surfaces",
                                              "surfaces with inverted normals",
                                              "mean free paths",
                                              "scattering too small to see",
                                              "objects without an area",
                                              "objects that coincide",
                                              "objects around the camera",
                                              "objects around lights",
                                              "meshes without texture coordinates",
                                              "objects that enclose no volume" };
    struct pell_scene_report report = { 0 };
    struct warnings w = { .ctx = ctx };
    double scale;
    enum pell_result res;

    if (!scene || scene->num_meshes == 0 || !r->method)
        return PELL_OK;
    scale = pixels_per_mm(scene, settings);
    res = pell_scene_check(scene, &report);
    if (res != PELL_OK)
        return res;
    for (size_t i = 0; i < report.num_objects; i++) {
        const struct pell_object_report *o = &report.objects[i];
        char shown[96], other[96];
        const char *name = o->name[0] ? pell_printable(o->name, shown, sizeof(shown)) : "an unnamed object";
        const struct pell_material *m;
        double mfp, widest;

        if (o->material < 0 || (size_t) o->material >= scene->num_materials || scene->materials[o->material].opaque)
            continue;
        m = &scene->materials[o->material];
        reach(m, &mfp, &widest);
        if (o->degenerate_triangles == o->triangles) {
            warn(&w, FLAT, name, NULL, "none of its triangles has an area: the object is invisible");
            continue;
        }
        if (o->coincident >= 0)
            warn(&w, COINCIDENT, name, "remove one of them", "has exactly the same surface as \"%s\": each hides the other",
                 pell_printable(report.objects[o->coincident].name, other, sizeof(other)));
        if (o->holds_camera)
            warn(&w, HOLDS_CAMERA, name, "move the camera, or check its unit against the mesh's",
                 "the camera is inside the object; methods render objects only from outside");
        if (o->holds_light >= 0)
            warn(&w, HOLDS_LIGHT, name, "put it into a cavity of the mesh, or outside",
                 "light %d of the scene is inside the object: light that begins inside a medium is not rendered", o->holds_light + 1);
        if (!o->closed && !o->joined)
            warn(&w, OPEN, name, "close it, or give it a thickness: --thicken 1mm",
                 "the surface is open (%lld boundary edges): a translucent object needs a closed surface", (long long) o->boundary_edges);
        if (pell_object_is_hollow(o)) {
            warn(&w, HOLLOW, name, "give it a thickness, or make it a sheet: opaque with diffuse_transmission",
                 "the surface encloses no volume: its sides coincide");
            continue;
        }
        if (o->closed && !o->outward)
            warn(&w, INVERTED, name, "flip its faces", "the surface has inverted normals");
        if (o->closed && !o->joined && o->thickness_mm > 0.0 && mfp > o->thickness_mm)
            warn(&w, THIN, name, "check --size or --unit: diffusion holds for objects many mean free paths thick",
                 "the mean free path of %s, %.3g mm, is longer than the object is thick (%.3g mm)",
                 m->preset && m->preset[0] ? m->preset : m->name, mfp, o->thickness_mm);
        if (scale > 0.0 && widest > 0.0 && widest * scale < 0.5)
            warn(&w, UNSEEN, name, "render it larger, or check --size or --unit",
                 "light travels %.3g mm below the surface of %s, which is %.2g pixels here: scattering is not visible", widest,
                 m->preset && m->preset[0] ? m->preset : m->name, widest * scale);
    }
    report_missing_uv(scene, &w);
    for (int k = 0; k < KINDS; k++)
        if (w.found[k] > w.logged[k])
            pell_warn(ctx, scene->path, NULL, "%s about %s", pell_counted(w.found[k] - w.logged[k], "more warning", "more warnings").str,
                      kinds[k]);
    pell_scene_report_finish(ctx, &report);
    return PELL_OK;
}
