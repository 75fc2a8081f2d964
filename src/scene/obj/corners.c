/* SPDX-License-Identifier: MIT
 *
 * corners.c - indices for the distinct corners of one mesh, by a hash table.
 */
#include "scene/obj/corners.h"

enum { PROBES = 64 };

static size_t slot_of(const struct pell_obj_numbering *n, const struct pell_obj_corner *c)
{
    uint64_t h = (c->v * 0x9e3779b97f4a7c15ull) ^ (c->vt * 0xc2b2ae3d27d4eb4full) ^ (c->vn * 0x165667b19e3779f9ull);

    h ^= h >> 32;
    h *= 0xd6e8feb86659fd93ull;
    return (size_t) (h >> 32) & (n->num_slots - 1);
}

static enum pell_result grow_table(struct pell_obj_numbering *n)
{
    const size_t wanted = n->num_slots ? 2 * n->num_slots : 64;
    uint32_t *old = n->slots, *slots;
    const size_t old_slots = n->num_slots;

    if (2 * (n->used + 1) <= n->num_slots)
        return PELL_OK;
    slots = pell_calloc(n->ctx, wanted, sizeof(*slots));
    if (!slots)
        return PELL_ERR_NOMEM;
    n->slots = slots;
    n->num_slots = wanted;
    n->used = 0;
    for (size_t i = 0; i < old_slots; i++) {
        size_t k = old[i] ? slot_of(n, &n->unique[old[i] - 1]) : 0;
        for (int p = 0; old[i] && p < PROBES; p++, k = (k + 1) & (wanted - 1))
            if (!slots[k]) {
                slots[k] = old[i];
                n->used++;
                break;
            }
    }
    pell_free(n->ctx, old);
    return PELL_OK;
}

static bool equal(const struct pell_obj_corner *a, const struct pell_obj_corner *b)
{
    return a->v == b->v && a->vt == b->vt && a->vn == b->vn;
}

enum pell_result pell_obj_number_corner(struct pell_obj_numbering *n, const struct pell_obj_corner *c, uint32_t *number)
{
    uint32_t *slot = NULL;
    void *array = n->unique;
    enum pell_result res;

    if (n->first[c->v]) {
        *number = n->first[c->v] - 1;
        if (equal(&n->unique[*number], c))
            return PELL_OK;
        PELL_TRY(grow_table(n));
        for (size_t p = 0, k = slot_of(n, c); p < PROBES && !slot; p++, k = (k + 1) & (n->num_slots - 1)) {
            if (!n->slots[k]) {
                slot = &n->slots[k];
            } else if (equal(&n->unique[n->slots[k] - 1], c)) {
                *number = n->slots[k] - 1;
                return PELL_OK;
            }
        }
    }
    res = pell_grow(n->ctx, &array, n->count, &n->capacity, sizeof(*n->unique));
    n->unique = array;
    if (res != PELL_OK)
        goto fail;
    n->unique[n->count] = *c;
    *number = (uint32_t) n->count++;
    if (slot) {
        *slot = *number + 1;
        n->used++;
    } else if (!n->first[c->v]) {
        n->first[c->v] = *number + 1;
    }
    return PELL_OK;

fail:
    return res;
}
