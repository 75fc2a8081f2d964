/* SPDX-License-Identifier: MIT
 * message.c - parses requests of a page. */
#include "viewer/message.h"

#include <string.h>

#define WHERE "message"

static const char *const types[] = { "view", "ack", "save", "pick", "profile" };
const char *const viewer_format_names[] = { "scene", "exr", "report" };
static const char *const view_keys[] = { "type", "id", "moving", "state" };
static const char *const ack_keys[] = { "type", "serial" };
static const char *const save_keys[] = { "type", "id", "format" };
static const char *const pick_keys[] = { "type", "id", "x", "y" };
static const char *const profile_keys[] = { "type", "id", "medium", "material", "gaussians", "export" };
static const struct {
    const char *const *keys;
    size_t count;
} keys_of[] = {
    { view_keys, PELL_COUNT(view_keys) }, { ack_keys, PELL_COUNT(ack_keys) },         { save_keys, PELL_COUNT(save_keys) },
    { pick_keys, PELL_COUNT(pick_keys) }, { profile_keys, PELL_COUNT(profile_keys) },
};
static const char *const state_keys[] = { "method", "knobs", "settings", "camera", "lights", "materials", "time", "other", "truth" };
static const char *const setup_keys[] = { "method", "knobs" };

/* Reads an object of texts. */
static enum pell_result read_settings(const struct pell_json *parent, const char *key, const char *where, struct pell_setting *list,
                                      size_t *count)
{
    struct pell_json at;
    const char *name;
    json_t *value;
    enum pell_result res = pell_json_object(parent, key, &at);

    *count = 0;
    if (res != PELL_OK || !at.value)
        return res;
    if (json_object_size(at.value) > VIEWER_SETTINGS_MOST)
        return pell_json_error(&at, PELL_ERR_INVALID, NULL, "has %zu members, at most %d are allowed", json_object_size(at.value),
                               VIEWER_SETTINGS_MOST);
    json_object_foreach((json_t *) at.value, name, value)
    {
        const struct pell_json member = pell_json_get(&at, name);
        const char *text;
        if ((res = pell_json_to_string(&member, &text)) != PELL_OK)
            return res;
        list[(*count)++] = (struct pell_setting) { name, text, where };
    }
    return PELL_OK;
}

static enum pell_result read_setup(const struct pell_json *at, struct viewer_setup *setup)
{
    const enum pell_result res = pell_json_string(at, "method", &setup->method);

    return res == PELL_OK ? read_settings(at, "knobs", "knob", setup->knobs, &setup->num_knobs) : res;
}

static enum pell_result read_state(const struct pell_json *root, struct viewer_message *m)
{
    struct pell_json state, other, part;
    enum pell_result res;

    PELL_TRY(pell_json_require(root, "state"));
    PELL_TRY(pell_json_object(root, "state", &state));
    PELL_TRY(pell_json_only(&state, state_keys, PELL_COUNT(state_keys)));
    PELL_TRY(read_setup(&state, &m->setup));
    PELL_TRY(read_settings(&state, "settings", "setting", m->settings, &m->num_settings));
    PELL_TRY(pell_json_object(&state, "other", &other));
    if (other.value) {
        PELL_TRY(pell_json_only(&other, setup_keys, PELL_COUNT(setup_keys)));
        PELL_TRY(pell_json_require(&other, "method"));
        PELL_TRY(read_setup(&other, &m->other));
    }
    PELL_TRY(pell_json_object(&state, "camera", &part));
    m->camera = (json_t *) part.value;
    PELL_TRY(pell_json_array(&state, "lights", 0, 4096, &part));
    m->lights = (json_t *) part.value;
    PELL_TRY(pell_json_object(&state, "materials", &part));
    m->materials = (json_t *) part.value;
    m->timed = pell_json_get(&state, "time").value != NULL;
    PELL_TRY(pell_json_number(&state, "time", -1e9, 1e9, &m->time));
    PELL_TRY(pell_json_string(&state, "truth", &m->truth));
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_message(struct viewer_message *m, const void *data, size_t size)
{
    struct pell_json root, medium, material;
    const char *number;
    int64_t gaussians = 4;
    int type = 0, format = VIEWER_SCENE;
    enum pell_result res;

    if (size > VIEWER_MESSAGE_BYTES)
        return pell_error(m->file.ctx, PELL_ERR_INVALID, WHERE, NULL, "has %zu bytes, at most %u are allowed", size, VIEWER_MESSAGE_BYTES);
    PELL_TRY(pell_json_parse(&m->file, data, size));
    root = pell_json_root(&m->file);
    PELL_TRY(pell_json_is_object(&root));
    PELL_TRY(pell_json_require(&root, "type"));
    PELL_TRY(pell_json_choice(&root, "type", types, PELL_COUNT(types), &type));
    PELL_TRY(pell_json_only(&root, keys_of[type].keys, keys_of[type].count));
    m->type = (enum viewer_message_type) type;
    number = m->type == VIEWER_ACK ? "serial" : "id";
    PELL_TRY(pell_json_require(&root, number));
    PELL_TRY(pell_json_int(&root, number, 0, INT64_C(1) << 53, &m->id));
    PELL_TRY(pell_json_bool(&root, "moving", &m->moving));
    if (m->type == VIEWER_VIEW)
        PELL_TRY(read_state(&root, m));
    if (m->type == VIEWER_SAVE)
        PELL_TRY(pell_json_require(&root, "format"));
    PELL_TRY(pell_json_choice(&root, "format", viewer_format_names, PELL_COUNT(viewer_format_names), &format));
    m->format = (enum viewer_format) format;
    PELL_TRY(pell_json_number(&root, "x", 0.0, 1.0, &m->x));
    PELL_TRY(pell_json_number(&root, "y", 0.0, 1.0, &m->y));
    PELL_TRY(pell_json_object(&root, "medium", &medium));
    m->medium = (json_t *) medium.value;
    PELL_TRY(pell_json_object(&root, "material", &material));
    m->material = (json_t *) material.value;
    PELL_TRY(pell_json_string(&root, "export", &m->export));
    if (m->type == VIEWER_PROFILE && (!m->material || m->medium || m->export))
        PELL_TRY(pell_json_require(&root, "medium"));
    PELL_TRY(pell_json_int(&root, "gaussians", 1, PELL_GAUSSIANS_MAX, &gaussians));
    m->gaussians = (int) gaussians;
    return PELL_OK;

fail:
    return res;
}

enum pell_result viewer_message_parse(struct pell_context *ctx, const void *data, size_t size, struct viewer_message **out)
{
    struct viewer_message *m = pell_zalloc(ctx, sizeof(*m));
    enum pell_result res;

    *out = NULL;
    if (!m)
        return PELL_ERR_NOMEM;
    m->file = (struct pell_json_file) { .ctx = ctx, .path = WHERE };
    res = read_message(m, data, size);
    if (res == PELL_OK)
        *out = m;
    else
        viewer_message_destroy(&m);
    return res;
}

void viewer_message_destroy(struct viewer_message **message)
{
    struct viewer_message *m = *message;

    if (!m)
        return;
    *message = NULL;
    pell_json_finish(&m->file);
    pell_free(m->file.ctx, m);
}
