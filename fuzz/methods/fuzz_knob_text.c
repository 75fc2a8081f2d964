/* SPDX-License-Identifier: MIT
 * fuzz_knob_text.c - knobs of a method from arbitrary text: no crash, no leak, one message per error; accepted values are in range and
 * survive printing and parsing. The first byte selects the method. */
#include "base/base.h"

#include <pellucid/method.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool holds)
{
    if (!holds)
        abort();
}

static void count_errors(void *user, const struct pell_message *message)
{
    if (message->level == PELL_LOG_ERROR) {
        require(message->what[0] && strcmp(message->where, "knobs") == 0);
        ++*(int *) user;
    }
}

static void check_printed(struct pell_context *ctx, const struct pell_method *method, const void *knobs)
{
    char text[8192], value[160];
    size_t length = 0;
    void *again;

    for (const struct pell_knob *k = method->knobs; k->type; k++) {
        length +=
            (size_t) snprintf(text + length, sizeof(text) - length, "%s=%s ", k->name, pell_knob_format(k, knobs, value, sizeof(value)));
        require(length < sizeof(text));
    }
    require(pell_method_knobs_create(ctx, method, text, &again) == PELL_OK);
    require(memcmp(knobs, again, method->knobs_size) == 0);
    pell_method_knobs_destroy(ctx, &again);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    int errors = 0;
    struct pell_context *ctx;
    const struct pell_method *method;
    enum pell_result res;
    void *knobs;
    char *text;

    if (size == 0 || pell_context_create(&(struct pell_context_params) { .log = count_errors, .log_user = &errors }, &ctx) != PELL_OK)
        return 0;
    method = pell_method_at(data[0] % pell_method_count());
    text = pell_strndup(ctx, (const char *) data + 1, size - 1);
    res = pell_method_knobs_create(ctx, method, text, &knobs);
    require((res == PELL_OK) == (errors == 0) && errors <= 1 && (res == PELL_OK) == (knobs != NULL));
    if (res == PELL_OK) {
        require(pell_knobs_check(ctx, method->knobs, method->name, knobs) == PELL_OK);
        check_printed(ctx, method, knobs);
        pell_method_knobs_destroy(ctx, &knobs);
    }
    pell_free(ctx, text);
    require(pell_memory_used(ctx) == 0);
    pell_context_destroy(&ctx);
    return 0;
}
