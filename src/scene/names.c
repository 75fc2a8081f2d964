/* SPDX-License-Identifier: MIT
 * names.c - an open-addressing hash table of names. Ids depend on the order of insertion alone; the hash is seeded with an address, so that
 * no file can be made whose names collide on purpose. */
#include "scene/names.h"

#include <string.h>

static uint64_t hash_name(const struct pell_names *n, const char *text, size_t length)
{
    uint64_t h = (uint64_t) (uintptr_t) n->ctx * 0x9e3779b97f4a7c15ull ^ length;

    for (size_t i = 0; i < length; i++) {
        h = (h ^ (unsigned char) text[i]) * 0xff51afd7ed558ccdull;
        h ^= h >> 29;
    }
    return h ^ h >> 32;
}

static enum pell_result grow_slots(struct pell_names *n)
{
    const size_t wanted = n->num_slots ? 2 * n->num_slots : 32;
    uint32_t *slots;

    if (2 * (n->count + 1) <= n->num_slots)
        return PELL_OK;
    slots = pell_calloc(n->ctx, wanted, sizeof(*slots));
    if (!slots)
        return PELL_ERR_NOMEM;
    pell_free(n->ctx, n->slots);
    n->slots = slots;
    n->num_slots = wanted;
    for (size_t i = 0; i < n->count; i++) {
        size_t k = (size_t) n->names[i].hash & (wanted - 1);
        while (slots[k])
            k = (k + 1) & (wanted - 1);
        slots[k] = (uint32_t) i + 1;
    }
    return PELL_OK;
}

enum pell_result pell_names_enter(struct pell_names *n, const char *text, size_t length, uint32_t *number, bool *fresh)
{
    const uint64_t hash = hash_name(n, text, length);
    const size_t limit = (size_t) pell_context_limits(n->ctx)->items;
    void *array = n->names;
    size_t k;
    enum pell_result res;

    *fresh = false;
    PELL_TRY(grow_slots(n));
    for (k = (size_t) hash & (n->num_slots - 1); n->slots[k]; k = (k + 1) & (n->num_slots - 1)) {
        const struct pell_name *name = &n->names[n->slots[k] - 1];
        if (name->hash == hash && name->length == length && memcmp(name->text, text, length) == 0) {
            *number = n->slots[k] - 1;
            return PELL_OK;
        }
    }
    if (n->count >= limit)
        return pell_error(n->ctx, PELL_ERR_UNSUPPORTED, n->where, PELL_RAISE_LIMIT("items"), "more than %zu names in one file", limit);
    res = pell_grow(n->ctx, &array, n->count, &n->capacity, sizeof(*n->names));
    n->names = array;
    if (res != PELL_OK)
        goto fail;
    n->names[n->count] = (struct pell_name) { pell_strndup(n->ctx, text, length), length, hash };
    if (!n->names[n->count].text)
        return PELL_ERR_NOMEM;
    *number = (uint32_t) n->count++;
    n->slots[k] = *number + 1;
    *fresh = true;
    return PELL_OK;

fail:
    return res;
}

void pell_names_finish(struct pell_names *n)
{
    if (!n->ctx)
        return;
    for (size_t i = 0; i < n->count; i++)
        pell_free(n->ctx, n->names[i].text);
    pell_free(n->ctx, n->names);
    pell_free(n->ctx, n->slots);
    memset(n, 0, sizeof(*n));
}
