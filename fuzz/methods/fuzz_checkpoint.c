/* SPDX-License-Identifier: MIT
 * fuzz_checkpoint.c - the reader of checkpoint files on arbitrary bytes: no crash, no leak, an error has one message, and what is accepted
 * is films that are written again as the same bytes. The mutator mends the hash, or little would pass it. */
#include "methods/path_trace/path_trace.h"

#include "base/hash.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t max_size);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed);

/* What the seeds are of. */
static const struct pt_checkpoint_key key = { .width = 3, .height = 2, .films = 2, .scene = 0x0123456789abcdef, .run = 42 };

static void require(bool holds)
{
    if (!holds)
        abort();
}

static void count_errors(void *user, const struct pell_message *message)
{
    if (message->level == PELL_LOG_ERROR) {
        require(message->what[0] && message->where[0]);
        ++*(int *) user;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    int errors = 0;
    struct pell_context *ctx;
    struct pt_film films[2];
    enum pell_result res;

    if (pell_context_create(&(struct pell_context_params) { .log = count_errors, .log_user = &errors }, &ctx) != PELL_OK)
        return 0;
    res = pt_checkpoint_decode(ctx, "fuzz", data, size, &key, films);
    require((res == PELL_OK) == (errors == 0) && errors <= 1);
    if (res == PELL_OK) {
        uint8_t *again;
        size_t length;
        require(pt_checkpoint_encode(ctx, &key, films, &again, &length) == PELL_OK);
        require(length == size && memcmp(again, data, size) == 0);
        pell_free(ctx, again);
        for (int f = 0; f < 2; f++) {
            const double error = pt_film_error(&films[f], true);
            require(error >= 0.0);
            pell_free(ctx, films[f].pixels);
        }
    }
    require(pell_memory_used(ctx) == 0);
    pell_context_destroy(&ctx);
    return 0;
}

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed)
{
    uint64_t hash;

    size = LLVMFuzzerMutate(data, size, max_size);
    if (seed % 8 == 0 || size < 8)
        return size;
    hash = pell_hash_bytes(0, data, size - 8);
    for (int i = 0; i < 8; i++)
        data[size - 8 + (size_t) i] = (uint8_t) (hash >> 8 * i);
    return size;
}
