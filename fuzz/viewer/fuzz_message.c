/* SPDX-License-Identifier: MIT
 * fuzz_message.c - messages from a page to the viewer: no crash, no leak; one message per error; an accepted view is in range. */
#include "viewer/address.h"
#include "viewer/message.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool holds)
{
    if (!holds)
        abort();
}

static void count_errors(void *user, const struct pell_message *message)
{
    if (message->level == PELL_LOG_ERROR)
        ++*(int *) user;
}

static void check_settings(const struct pell_setting *list, size_t count)
{
    require(count <= VIEWER_SETTINGS_MOST);
    for (size_t i = 0; i < count; i++)
        require(list[i].name && list[i].value && list[i].where);
}

static void check(const struct viewer_message *m)
{
    require(m->id >= 0 && m->id <= INT64_C(1) << 53);
    require(m->x >= 0.0 && m->x <= 1.0 && m->y >= 0.0 && m->y <= 1.0);
    require(m->format >= VIEWER_SCENE && m->format <= VIEWER_REPORT);
    check_settings(m->setup.knobs, m->setup.num_knobs);
    check_settings(m->other.knobs, m->other.num_knobs);
    check_settings(m->settings, m->num_settings);
    require(!m->camera || json_is_object(m->camera));
    require(!m->lights || json_is_array(m->lights));
    require(!m->materials || json_is_object(m->materials));
    require(m->type != VIEWER_PROFILE || m->medium || (m->material && !m->export));
    require(m->gaussians >= 1 && m->gaussians <= PELL_GAUSSIANS_MAX);
}

/* The same bytes as the Host and the Origin of a request. */
static void check_host(const uint8_t *data, size_t size)
{
    char text[200];
    const size_t n = size < sizeof(text) - 1 ? size : sizeof(text) - 1;

    memcpy(text, data, n);
    text[n] = '\0';
    if (viewer_host_allowed(text, "127.0.0.1"))
        require(strncmp(text, "127.", 4) == 0 || strncmp(text, "[127.", 5) == 0 || strncmp(text, "[::1]", 5) == 0 ||
                strncasecmp(text, "localhost", 9) == 0 || strncasecmp(text, "[localhost]", 11) == 0);
    viewer_origin_allowed(text, "127.0.0.1:80");
    require(!viewer_token_equal("0123456789abcdef0123456789abcdef", text) || n == VIEWER_TOKEN);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    int errors = 0;
    const struct pell_context_params params = { .log = count_errors, .log_user = &errors, .log_level = PELL_LOG_ERROR };
    struct pell_context *ctx;
    struct viewer_message *m;
    enum pell_result res;

    if (pell_context_create(&params, &ctx) != PELL_OK)
        return 0;
    res = viewer_message_parse(ctx, data, size, &m);
    require((res == PELL_OK) == (m != NULL) && errors == (res != PELL_OK));
    if (m)
        check(m);
    viewer_message_destroy(&m);
    require(pell_memory_used(ctx) == 0);
    pell_context_destroy(&ctx);
    check_host(data, size);
    return 0;
}
