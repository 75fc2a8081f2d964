/* SPDX-License-Identifier: MIT
 * values.c - values of a scene file: lengths, positions, colours, directions, images. */
#include "scene/file/scene_file.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

bool pell_json_has(const struct pell_json *at, const char *key)
{
    return pell_json_get(at, key).value != NULL;
}

enum pell_result pell_scene_text_length(const struct pell_json *at, bool any_sign, double *mm)
{
    struct pell_text where, one = { 0 };
    const char *text, *unit, *digits;
    double number;
    enum pell_result res;

    if (json_is_number(at->value)) {
        number = json_number_value(at->value);
        pell_text_add(&one, "write a text with its unit, as in \"%gmm\"", number > 0.0 ? number : 70.0);
        return pell_json_error(at, PELL_ERR_FORMAT, one.str, "is %g, a number without a unit", number);
    }
    res = pell_json_to_string(at, &text);
    if (res != PELL_OK)
        return res;
    digits = text + (any_sign && *text == '-');
    for (unit = digits; *unit && strchr("+.0123456789", *unit); unit++)
        ;
    /* Zero is valid as a position; it still needs a valid unit. */
    if (any_sign && pell_parse_number(digits, (size_t) (unit - digits), &number) && number == 0.0) {
        pell_text_add(&one, "1%s", unit);
        res = pell_parse_length(at->file->ctx, pell_json_where(at, &where), one.str, mm);
        *mm = 0.0;
    } else {
        res = pell_parse_length(at->file->ctx, pell_json_where(at, &where), digits, mm);
        *mm = digits == text ? *mm : -*mm;
    }
    return res == PELL_ERR_INVALID ? PELL_ERR_FORMAT : res;
}

/* A number of mesh units, or a text with its unit. */
static enum pell_result to_length(const struct pell_json *at, double unit, bool any_sign, double *mm)
{
    double x;
    enum pell_result res;

    if (json_is_string(at->value))
        return pell_scene_text_length(at, any_sign, mm);
    res = pell_json_to_number(at, any_sign ? -1e12 : 0.0, 1e12, &x);
    if (res != PELL_OK)
        return res;
    if (!any_sign && x == 0.0)
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "is 0, must be above 0");
    if (!(fabs(x * unit) <= 1e12))
        return pell_json_error(at, PELL_ERR_FORMAT, "is the mesh's unit or size right?", "is %g mm, allowed are 1e12", x * unit);
    *mm = x * unit;
    return PELL_OK;
}

enum pell_result pell_scene_length(const struct pell_json *parent, const char *key, double unit, float *mm)
{
    const struct pell_json at = pell_json_get(parent, key);
    double x;
    enum pell_result res;

    if (!at.value)
        return PELL_OK;
    res = to_length(&at, unit, false, &x);
    if (res == PELL_OK)
        *mm = (float) x;
    return res;
}

enum pell_result pell_scene_position(const struct pell_json *parent, const char *key, double unit, double *mm)
{
    struct pell_json at;
    double p[3];
    enum pell_result res = pell_json_array(parent, key, 3, 3, &at);

    if (res != PELL_OK || !at.value)
        return res;
    for (size_t i = 0; i < 3; i++) {
        const struct pell_json element = pell_json_at(&at, i);
        if ((res = to_length(&element, unit, true, &p[i])) != PELL_OK)
            return res;
    }
    memcpy(mm, p, sizeof(p));
    return PELL_OK;
}

/* One number for all channels, or three. */
enum pell_result pell_scene_rgb(const struct pell_json *parent, const char *key, double max, float *rgb)
{
    const struct pell_json at = pell_json_get(parent, key);
    double x;
    enum pell_result res;

    if (!json_is_number(at.value))
        return pell_json_floats(parent, key, 3, 0.0, max, rgb);
    res = pell_json_to_number(&at, 0.0, max, &x);
    for (int c = 0; c < 3 && res == PELL_OK; c++)
        rgb[c] = (float) x;
    return res;
}

enum pell_result pell_scene_direction(const struct pell_json *parent, const char *key, float *v)
{
    const struct pell_json at = pell_json_get(parent, key);
    double d[3], length = 0.0;
    enum pell_result res;

    if (!at.value)
        return PELL_OK;
    PELL_TRY(pell_json_to_numbers(&at, 3, -1e6, 1e6, d));
    for (int c = 0; c < 3; c++)
        length += d[c] * d[c];
    length = sqrt(length);
    if (!(length > 1e-12))
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "has no length, must be a direction");
    for (int c = 0; c < 3; c++)
        v[c] = (float) (d[c] / length);
    return PELL_OK;

fail:
    return res;
}

/* From `at` towards `to`, which must differ. */
enum pell_result pell_scene_aim(const struct pell_json *parent, const char *key, const double *at, const double *to, float *direction)
{
    const struct pell_json target = pell_json_get(parent, key);
    double d[3], length = 0.0;

    for (int c = 0; c < 3; c++) {
        d[c] = to[c] - at[c];
        length += d[c] * d[c];
    }
    length = sqrt(length);
    if (!(length > 0.0) || !isfinite(length))
        return pell_json_error(target.value ? &target : parent, PELL_ERR_FORMAT, NULL,
                               "\"%s\" is where the %s stands, so it gives no direction", key,
                               strcmp(key, "to") == 0 && pell_json_has(parent, "from") ? "camera" : "light");
    for (int c = 0; c < 3; c++)
        direction[c] = (float) (d[c] / length);
    return PELL_OK;
}

/* Finds the next "%d", or "%01d" to "%09d", in `text`, its length and digits. NULL: none. */
static const char *find_number(const char *text, size_t *length, int *digits)
{
    for (const char *p = strchr(text, '%'); p; p = strchr(p + 1, '%')) {
        const bool padded = p[1] == '0' && p[2] >= '1' && p[2] <= '9';
        *digits = padded ? p[2] - '0' : 1;
        *length = padded ? 4 : 2;
        if (p[*length - 1] == 'd')
            return p;
    }
    return NULL;
}

/* "veins_%04d.png" is an image of a sequence: the one at the scene's time. Any other name is unchanged. */
static enum pell_result find_in_sequence(struct pell_scene_reader *r, const struct pell_json *at, const char **reference, char *name,
                                         size_t size)
{
    const double number = floor(r->moment.time * r->image_rate + 1e-6);
    size_t length, other;
    int digits, more;
    const char *p = find_number(*reference, &length, &digits);
    char shown[160];

    if (!p)
        return PELL_OK;
    if (find_number(p + length, &other, &more))
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "\"%s\": only one number may vary in the name of an image",
                               pell_printable(*reference, shown, sizeof(shown)));
    if (number > 999999999.0)
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "is image %.0f of its sequence at %g s, at most 999999999 is allowed", number,
                               r->moment.time);
    if (snprintf(name, size, "%.*s%0*d%s", (int) (p - *reference), *reference, digits, number > 0.0 ? (int) number : 0, p + length) >=
        (int) size)
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "the name has more than %zu characters", size - 1);
    *reference = name;
    r->scene->animated = r->sequences = true;
    return PELL_OK;
}

static enum pell_result read_picture(struct pell_scene_reader *r, const struct pell_json *at, const char *reference,
                                     enum pell_image_role role, bool needed, struct pell_texture **texture)
{
    const bool outside = r->import.allow_outside;
    struct pell_text where;
    char *path = NULL, name[4096];
    enum pell_result res;

    *texture = NULL;
    PELL_TRY(find_in_sequence(r, at, &reference, name, sizeof(name)));
    pell_json_where(at, &where);
    r->import.allow_outside |= r->granted && strcmp(reference, r->granted) == 0;
    PELL_TRY(pell_path_resolve(r->ctx, where.str, r->import.root, reference, r->import.allow_outside, &path));
    r->import.scene = r->scene;
    r->import.needed = needed;
    res = pell_import_texture(&r->import, where.str, reference, role, texture);
    r->import.needed = false;
    if (res == PELL_OK && *texture)
        res = pell_texture_sampler(r->scene, *texture, PELL_WRAP_REPEAT, PELL_WRAP_REPEAT, false, texture);

fail:
    r->import.allow_outside = outside;
    pell_free(r->ctx, path);
    return res == PELL_ERR_INVALID ? PELL_ERR_FORMAT : res;
}

enum pell_result pell_scene_picture(struct pell_scene_reader *r, const struct pell_json *at, const char *reference,
                                    enum pell_image_role role, struct pell_texture **texture)
{
    return read_picture(r, at, reference, role, false, texture);
}

enum pell_result pell_scene_need_picture(struct pell_scene_reader *r, const struct pell_json *at, const char *reference,
                                         enum pell_image_role role, struct pell_texture **texture)
{
    const enum pell_result res = read_picture(r, at, reference, role, true, texture);
    char shown[160];

    if (res != PELL_OK || *texture)
        return res;
    return pell_json_error(at, PELL_ERR_FORMAT, NULL, "the image \"%s\" can't be read", pell_printable(reference, shown, sizeof(shown)));
}

enum pell_result pell_scene_need_picture_at(struct pell_scene_reader *r, const struct pell_json *parent, const char *key,
                                            struct pell_texture **texture)
{
    const struct pell_json at = pell_json_get(parent, key);
    const char *reference;
    enum pell_result res;

    if (!at.value)
        return PELL_OK;
    res = pell_json_to_string(&at, &reference);
    return res == PELL_OK ? pell_scene_need_picture(r, &at, reference, PELL_ROLE_COLOR, texture) : res;
}
