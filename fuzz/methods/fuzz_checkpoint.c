/* SPDX-License-Identifier: MIT
 * fuzz_checkpoint.c - the reader of checkpoint files on arbitrary bytes: no crash, no leak, one message per error; accepted films are
 * written again as the same bytes. The mutator repairs the hash, since otherwise little input would pass it. */
#include "methods/path_trace/path_trace.h"

#include "base/hash.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t max_size);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed);

/* The render that the seeds belong to. */
static const struct pt_checkpoint_key key = {
    .width = 11, .height = 2, .films = 2, .scene = 0x0123456789abcdef, .seed = 42, .roulette = 0.5f, .version = "fuzz"
};

enum { HEADER = 8 + 4 * 4 + 8 + 8 + 2 * 4 + 4 + 4 * PT_KEY_WORDS + 32 };

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
    for (int f = 0; res == PELL_OK && f < 2; f++) {
        struct pt_film sum = { .count = 0 };
        const struct pt_film *film = &films[f];
        uint8_t pixels[2];
        size_t tile;
        uint32_t sample;

        require(film->tiles == 2 && film->starts[2] == film->count);
        require(pt_film_error(film, true) >= 0.0);
        for (int t = 0; t < 2; t++)
            pixels[t] = (uint8_t) (film->starts[t + 1] - film->starts[t]);
        if (pt_film_create(ctx, pixels, 2, &sum) == PELL_OK) { /* merged once it is complete, merged twice it overlaps */
            require(pt_film_merge(ctx, &sum, film, &tile, &sample) == PELL_OK && pt_film_holds(&sum, film));
            require(film->num_spans[0] + film->num_spans[1] == 0 || pt_film_merge(ctx, &sum, film, &tile, &sample) == PELL_ERR_INVALID);
        }
        pt_film_free(ctx, &sum);
    }
    if (res == PELL_OK) {
        uint8_t *again;
        size_t length;
        char note[1 << 16] = "";
        const uint32_t bytes = (uint32_t) data[44] | (uint32_t) data[45] << 8;

        memcpy(note, data + HEADER, bytes);
        require(pt_checkpoint_encode(ctx, &key, note, films, &again, &length) == PELL_OK);
        require(strlen(note) != bytes || (length == size && memcmp(again, data, size) == 0));
        pell_free(ctx, again);
        for (int f = 0; f < 2; f++)
            pt_film_free(ctx, &films[f]);
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
