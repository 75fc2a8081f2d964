/* SPDX-License-Identifier: MIT
 * animation.c - one animation of glTF 2.0 (section 3.11 and appendix C of the specification) at one time: selects it, reads its samplers
 * and channels, and computes the poses of nodes.
 *
 * Before its first key and after its last a sampler holds that key's value; nothing is repeated. Accessors become floats once, however
 * many samplers share them. */
#include "scene/gltf/gltf.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

static const char *const paths[] = { "translation", "rotation", "scale", "weights", "pointer" };

/* --- Samplers --------------------------------------------------------------------------------------------------------------- */

enum { STEP, LINEAR, CUBICSPLINE };

/* `width` numbers per key: CUBICSPLINE has three times as many: in-tangent, value, out-tangent. */
struct sampler {
    const float *time, *value;
    uint32_t count;
    size_t width;
    int interpolation;
};

/* The floats of an accessor that parent.key has named. */
static enum pell_result read_track(struct gltf *g, const struct pell_json *at, int64_t index, const struct gltf_accessor *a,
                                   const float **out)
{
    struct gltf_track *t = &g->track[index];
    const size_t count = (size_t) a->count * (size_t) a->components;

    if (!t->value) {
        float *value = pell_alloc_array(g->ctx, count, sizeof(*value));
        size_t bad;
        if (!value)
            return PELL_ERR_NOMEM;
        gltf_read_floats(a, a->type != GLTF_F32, value);
        bad = gltf_first_not_finite(value, count);
        if (bad < count) {
            const double number = (double) value[bad];
            pell_free(g->ctx, value);
            return pell_json_error(at, PELL_ERR_FORMAT, NULL, "element %zu of accessor %" PRId64 " is %g, allowed: finite numbers",
                                   bad / (size_t) a->components, index, number);
        }
        t->value = value;
    }
    *out = t->value;
    return PELL_OK;
}

static enum pell_result read_times(struct gltf *g, const struct pell_json *at, struct sampler *s)
{
    const struct pell_json input = pell_json_get(at, "input");
    const struct gltf_accessor *a;
    struct gltf_track *t;
    int64_t index = -1;
    enum pell_result res;

    PELL_TRY(pell_json_require(at, "input"));
    PELL_TRY(gltf_index(at, "input", &g->accessors, &index));
    PELL_TRY(gltf_accessor(g, index, &a));
    if (a->components != 1 || a->type != GLTF_F32)
        return pell_json_error(&input, PELL_ERR_FORMAT, NULL,
                               "accessor %" PRId64 " has %d components of type %d, allowed: SCALAR of 5126 (float)", index, a->components,
                               a->type);
    PELL_TRY(read_track(g, &input, index, a, &s->time));
    s->count = a->count;
    t = &g->track[index];
    for (uint32_t i = 0; !t->ordered && i < a->count; i++)
        if (!(s->time[i] >= 0.0f) || (i > 0 && !(s->time[i] > s->time[i - 1])))
            return pell_json_error(&input, PELL_ERR_FORMAT, NULL, "key %" PRIu32 " is at %g s%s, allowed: times of 0 or more that increase",
                                   i, (double) s->time[i], i > 0 ? ", not after the one before it" : "");
    t->ordered = true;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result find_sampler(struct gltf *g, const struct pell_json *channel, struct pell_json *out)
{
    int64_t sampler = -1;
    enum pell_result res;

    PELL_TRY(pell_json_require(channel, "sampler"));
    PELL_TRY(gltf_index(channel, "sampler", &g->animation_samplers, &sampler));
    *out = pell_json_at(&g->animation_samplers, (size_t) sampler);
    PELL_TRY(pell_json_is_object(out));
    return PELL_OK;

fail:
    return res;
}

/* A sampler whose values have `components` each, and, for morph targets, `targets` of them per key. */
static enum pell_result read_sampler(struct gltf *g, const struct pell_json *channel, int path, size_t targets, struct sampler *s)
{
    static const char *const interpolations[] = { "STEP", "LINEAR", "CUBICSPLINE" };
    static const int components[GLTF_PATHS] = { 3, 4, 3, 1 };
    const struct gltf_accessor *a;
    struct pell_json at, output;
    int64_t index = -1;
    uint64_t want;
    enum pell_result res;

    s->interpolation = LINEAR;
    PELL_TRY(find_sampler(g, channel, &at));
    PELL_TRY(pell_json_choice(&at, "interpolation", interpolations, PELL_COUNT(interpolations), &s->interpolation));
    PELL_TRY(read_times(g, &at, s));
    PELL_TRY(pell_json_require(&at, "output"));
    PELL_TRY(gltf_index(&at, "output", &g->accessors, &index));
    output = pell_json_get(&at, "output");
    PELL_TRY(gltf_accessor(g, index, &a));
    if (a->components != components[path] || a->type == GLTF_U32 ||
        (a->type != GLTF_F32 && (path == GLTF_TRANSLATION || path == GLTF_SCALE)))
        return pell_json_error(&output, PELL_ERR_FORMAT, NULL,
                               "accessor %" PRId64 " has %d components of type %d, allowed for %s: %d of %s", index, a->components, a->type,
                               paths[path], components[path],
                               path == GLTF_TRANSLATION || path == GLTF_SCALE ? "5126" : "5126 or 5120 to 5123");
    want = (uint64_t) s->count * targets * (s->interpolation == CUBICSPLINE ? 3 : 1); /* below 2^33 x 2^30 x 3 */
    if (a->count != want)
        return pell_json_error(&output, PELL_ERR_FORMAT, NULL,
                               "accessor %" PRId64 " has %" PRIu32 " elements, allowed: %" PRIu64 " for %" PRIu32 " keys of %s%s", index,
                               a->count, want, s->count, paths[path], s->interpolation == CUBICSPLINE ? " with two tangents" : "");
    s->width = (size_t) components[path] * targets;
    return read_track(g, &output, index, a, &s->value);

fail:
    return res;
}

/* Spherical interpolation from p to q, unit quaternions, along the shorter arc: appendix C.4. */
static void slerp(const double *p, const double *q, double along, double *out)
{
    const double dot = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3], c = fmin(fabs(dot), 1.0), angle = acos(c);
    double a = 1.0 - along, b = along;

    if (angle > 1e-6) { /* linear interpolation is as good below that */
        a = sin(a * angle) / sin(angle);
        b = sin(b * angle) / sin(angle);
    }
    for (int i = 0; i < 4; i++)
        out[i] = a * p[i] + (dot < 0.0 ? -b : b) * q[i];
}

/* The key at or before a time, or the first. */
static uint32_t find_key(const struct sampler *s, double time)
{
    uint32_t low = 0, high = s->count;

    while (high - low > 1) {
        const uint32_t middle = low + (high - low) / 2;
        if ((double) s->time[middle] <= time)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* The value at a time; quaternions may have any length. */
static void sample(const struct sampler *s, bool rotation, double time, double *out)
{
    const uint32_t key = find_key(s, time);
    const bool cubic = s->interpolation == CUBICSPLINE, held = time <= (double) s->time[key] || key + 1 == s->count;
    const size_t n = s->width, step = cubic ? 3 * n : n;
    const float *here = s->value + (size_t) key * step + (cubic ? n : 0), *next = here + step;
    double length, t;

    if (held || s->interpolation == STEP) {
        for (size_t i = 0; i < n; i++)
            out[i] = (double) here[i];
        return;
    }
    length = (double) s->time[key + 1] - (double) s->time[key];
    t = (time - (double) s->time[key]) / length;
    if (cubic) {
        /* Hermite's polynomials on the values, and on the tangents times the length: appendix C.5 */
        const double t2 = t * t, t3 = t2 * t, h00 = 2 * t3 - 3 * t2 + 1, h10 = t3 - 2 * t2 + t, h01 = 3 * t2 - 2 * t3, h11 = t3 - t2;
        for (size_t i = 0; i < n; i++)
            out[i] = h00 * (double) here[i] + length * h10 * (double) here[n + i] + h01 * (double) next[i] +
                     length * h11 * (double) (next - n)[i];
    } else if (rotation) {
        double p[4], q[4], l;
        for (int i = 0; i < 4; i++) {
            p[i] = (double) here[i];
            q[i] = (double) next[i];
        }
        if (gltf_normalize_quaternion(p, &l) && gltf_normalize_quaternion(q, &l))
            slerp(p, q, t, out);
        else
            memset(out, 0, 4 * sizeof(*out)); /* the caller refuses it */
    } else {
        for (size_t i = 0; i < n; i++)
            out[i] = (1.0 - t) * (double) here[i] + t * (double) next[i];
    }
}

/* --- Channels --------------------------------------------------------------------------------------------------------------- */

static enum pell_result read_channel(struct gltf *g, int32_t index)
{
    const struct pell_json at = pell_json_at(&g->animation_channels, (size_t) index);
    struct pell_json target, path_at;
    struct gltf_pose *pose;
    struct sampler s;
    int64_t node = -1;
    double length;
    int path = 0;
    enum pell_result res;

    PELL_TRY(pell_json_is_object(&at));
    PELL_TRY(pell_json_require(&at, "target"));
    PELL_TRY(pell_json_object(&at, "target", &target));
    PELL_TRY(pell_json_require(&target, "path"));
    PELL_TRY(pell_json_choice(&target, "path", paths, PELL_COUNT(paths), &path));
    if (path == GLTF_PATHS) {
        gltf_mention(g, &target, "KHR_animation_pointer");
        return PELL_OK;
    }
    PELL_TRY(gltf_index(&target, "node", &g->nodes, &node));
    if (node < 0) /* "when undefined, the animated object MAY be defined by an extension" */
        return PELL_OK;
    path_at = pell_json_get(&target, "path");
    pose = &g->pose[node];
    if (pose->moved[path])
        return pell_json_error(&path_at, PELL_ERR_FORMAT, NULL, "the animation moves the %s of node %" PRId64 " already, allowed: once",
                               paths[path], node);
    pose->moved[path] = true;
    if (path == GLTF_WEIGHTS) { /* their number is known when the mesh is placed */
        struct pell_json sampler;
        pose->weights = index;
        PELL_TRY(find_sampler(g, &at, &sampler));
        PELL_TRY(read_times(g, &sampler, &s));
        return PELL_OK;
    }
    PELL_TRY(read_sampler(g, &at, path, 1, &s));
    sample(&s, path == GLTF_ROTATION, g->time, pose->value[path]);
    if (path == GLTF_ROTATION && !gltf_normalize_quaternion(pose->value[path], &length))
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "at %g s the quaternion has length %g, allowed: 1", g->time, length);
    return PELL_OK;

fail:
    return res;
}

enum pell_result gltf_animated_weights(struct gltf *g, int32_t channel, size_t count, double *weights)
{
    const struct pell_json at = pell_json_at(&g->animation_channels, (size_t) channel);
    struct sampler s;
    enum pell_result res = read_sampler(g, &at, GLTF_WEIGHTS, count, &s);

    if (res == PELL_OK)
        sample(&s, false, g->time, weights);
    return res;
}

/* --- Which animation -------------------------------------------------------------------------------------------------------- */

/* By name, else by number, else the first. */
static enum pell_result choose(struct gltf *g, size_t *index)
{
    const struct pell_moment *m = &g->import->moment;
    const size_t count = pell_json_count(&g->animations);
    struct pell_text hint = { 0 };
    const char **names;
    char shown[96];
    int64_t number;

    *index = 0;
    if (!m->animation)
        return PELL_OK;
    names = pell_calloc(g->ctx, count, sizeof(*names));
    if (!names)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < count; i++) {
        const struct pell_json at = pell_json_at(&g->animations, i), name = pell_json_get(&at, "name");
        names[i] = json_is_string(name.value) ? json_string_value(name.value) : "";
        if (strcmp(names[i], m->animation) == 0) {
            pell_free(g->ctx, names);
            *index = i;
            return PELL_OK;
        }
    }
    pell_text_suggest(&hint, "", m->animation, names, count);
    pell_free(g->ctx, names);
    if (pell_parse_int(m->animation, strlen(m->animation), &number) && number >= 0 && number < (int64_t) count) {
        *index = (size_t) number;
        return PELL_OK;
    }
    return pell_error(g->ctx, m->code ? m->code : PELL_ERR_INVALID, m->where, hint.length ? hint.str : NULL,
                      "there is no animation \"%s\" in %s, which has %zu: their names, or numbers from 0, are allowed",
                      pell_printable(m->animation, shown, sizeof(shown)), g->import->path, count);
}

/* From the first to the last key of the animation, as far as its channels have been read. */
static void log_time_range(struct gltf *g, const struct pell_json *animation)
{
    struct pell_text where;
    char name[96];
    double last = 0.0;

    for (size_t i = 0; i < pell_json_count(&g->animation_samplers); i++) {
        const struct pell_json at = pell_json_at(&g->animation_samplers, i), input = pell_json_get(&at, "input");
        const int64_t index = json_is_integer(input.value) ? (int64_t) json_integer_value(input.value) : -1;
        if (index >= 0 && index < (int64_t) pell_json_count(&g->accessors) && g->track[index].ordered)
            last = fmax(last, (double) g->track[index].value[g->accessor[index].count - 1]);
    }
    pell_info(g->ctx, pell_json_where(animation, &where), "%s at %g s of %g s", gltf_name(animation, "animation", name, sizeof(name)),
              g->time, last);
}

enum pell_result gltf_animate(struct gltf *g)
{
    const struct pell_moment *m = &g->import->moment;
    size_t index;
    enum pell_result res;

    g->import->animations = pell_json_count(&g->animations);
    g->time = m->time;
    if (g->import->animations == 0)
        return PELL_OK;
    if (!m->timed) {
        struct pell_text where;
        pell_info(g->ctx, pell_json_where(&g->animations, &where), "%s: a time in seconds plays one",
                  pell_counted((long long) g->import->animations, "animation, which is not played", "animations, none of them played").str);
        return PELL_OK;
    }
    PELL_TRY(choose(g, &index));
    g->animation = pell_json_at(&g->animations, index);
    PELL_TRY(pell_json_is_object(&g->animation));
    PELL_TRY(pell_json_require(&g->animation, "samplers"));
    PELL_TRY(pell_json_require(&g->animation, "channels"));
    PELL_TRY(pell_json_array(&g->animation, "samplers", 1, (size_t) g->limits->items, &g->animation_samplers));
    PELL_TRY(pell_json_array(&g->animation, "channels", 1, (size_t) g->limits->items, &g->animation_channels));
    g->pose = pell_calloc(g->ctx, pell_json_count(&g->nodes), sizeof(*g->pose));
    g->track = pell_calloc(g->ctx, pell_json_count(&g->accessors), sizeof(*g->track));
    if (!g->pose || !g->track)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < pell_json_count(&g->animation_channels); i++)
        PELL_TRY(read_channel(g, (int32_t) i));
    log_time_range(g, &g->animation);
    return PELL_OK;

fail:
    return res;
}
