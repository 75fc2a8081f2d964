/* SPDX-License-Identifier: MIT
 * bake_align.c - one order of layers for all texels, and their depths. A layer that is absent at a texel gets zero thickness there, at the
 * depth of the nearest texel that has it, so that maps can be filtered across its edge. */
#include "cli/commands/bake.h"

#include <math.h>
#include <string.h>

#define NO_TEXEL UINT32_MAX

/* Adds to `layer` what it lacks to contain the texel's stretches in their order; false: too many layers. */
static bool merge(struct bake *b, const struct bake_texel *t)
{
    uint8_t longest[PELL_LAYERS_MOST + 1][BAKE_STRETCHES + 1] = { { 0 } }, out[PELL_LAYERS_MOST + BAKE_STRETCHES];
    int i = b->num_layers, j = t->count, n = 0;

    for (int p = 1; p <= i; p++) /* the longest common subsequence */
        for (int q = 1; q <= j; q++) {
            const uint8_t a = longest[p - 1][q], c = longest[p][q - 1];
            longest[p][q] = b->layer[p - 1] == t->medium[q - 1] ? (uint8_t) (longest[p - 1][q - 1] + 1) : a > c ? a : c;
        }
    while (i > 0 || j > 0) { /* backwards */
        if (i > 0 && j > 0 && b->layer[i - 1] == t->medium[j - 1]) {
            out[n++] = b->layer[--i];
            j--;
        } else if (j > 0 && (i == 0 || longest[i][j - 1] >= longest[i - 1][j])) {
            out[n++] = t->medium[--j];
        } else {
            out[n++] = b->layer[--i];
        }
    }
    if (n > PELL_LAYERS_MOST - 1)
        return false;
    for (int k = 0; k < n; k++)
        b->layer[k] = out[n - 1 - k];
    b->num_layers = n;
    return true;
}

static bool is_in(const struct bake *b, const struct bake_texel *t)
{
    int j = 0;

    for (int k = 0; k < b->num_layers && j < t->count; k++)
        j += b->layer[k] == t->medium[j];
    return j == t->count;
}

static enum pell_result order_layers(struct bake *b)
{
    const size_t n = (size_t) b->size * (size_t) b->size;

    b->num_layers = 0;
    for (size_t i = 0; i < n; i++)
        if (!is_in(b, &b->texels[i]) && !merge(b, &b->texels[i]))
            return pell_error(b->ctx, PELL_ERR_UNSUPPORTED, b->outer.path, "leave meshes out, or give a smaller --down-to",
                              "has more than %d layers in all orders of its meshes", PELL_LAYERS_MOST);
    if (b->num_layers == 0 || b->layer[b->num_layers - 1] != 0)
        b->layer[b->num_layers++] = 0;
    return PELL_OK;
}

/* from[i] = the nearest texel with data, for those marked NO_TEXEL: two sweeps forward and two backward over the map, accurate to some
 * texels. */
static void spread(const struct bake *b, uint32_t *from)
{
    const int size = b->size;

    for (int sweep = 0; sweep < 4; sweep++)
        for (int row = 0; row < size; row++)
            for (int column = 0; column < size; column++) {
                const int y = sweep & 1 ? size - 1 - row : row, x = sweep & 1 ? size - 1 - column : column, d = sweep & 1 ? 1 : -1;
                const int near[4][2] = { { x + d, y }, { x, y + d }, { x + d, y + d }, { x - d, y + d } };
                const size_t at = (size_t) y * (size_t) size + (size_t) x;
                int64_t best = INT64_MAX;
                if (from[at] != NO_TEXEL) {
                    const int64_t dx = x - (int) (from[at] % (uint32_t) size), dy = y - (int) (from[at] / (uint32_t) size);
                    best = dx * dx + dy * dy;
                }
                for (int k = 0; k < 4 && best > 0; k++) {
                    uint32_t other;
                    int64_t dx, dy;
                    if (near[k][0] < 0 || near[k][0] >= size || near[k][1] < 0 || near[k][1] >= size)
                        continue;
                    other = from[(size_t) near[k][1] * (size_t) size + (size_t) near[k][0]];
                    if (other == NO_TEXEL)
                        continue;
                    dx = x - (int) (other % (uint32_t) size);
                    dy = y - (int) (other / (uint32_t) size);
                    if (dx * dx + dy * dy < best) {
                        best = dx * dx + dy * dy;
                        from[at] = other;
                    }
                }
            }
}

/* Sets the bottoms of the layers that a texel has; the others end where the layer above ends. */
static void set_bottoms(struct bake *b, size_t at, size_t n)
{
    const struct bake_texel *t = &b->texels[at];
    float above = 0.0f;
    int j = 0;

    for (int k = 0; k + 1 < b->num_layers; k++) {
        if (j < t->count && b->layer[k] == t->medium[j])
            above = t->end[j++];
        b->bottom[(size_t) k * n + at] = above;
    }
}

/* Places layer k, between two layers of one kind, at a texel that has neither it nor the one below: at the depth of its middle at the
 * nearest texel that has it. */
static void place_absent_layer(struct bake *b, int k, const uint32_t *from, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        float *above = &b->bottom[(size_t) (k - 1) * n + i], *here = &b->bottom[(size_t) k * n + i];
        float *below = k + 2 < b->num_layers ? &b->bottom[(size_t) (k + 1) * n + i] : NULL;
        const float top = k > 1 ? b->bottom[(size_t) (k - 2) * n + i] : 0.0f, end = *above;
        float middle;
        if (from[i] == NO_TEXEL || from[i] == i || *here > *above || (below && *below > *here) || !(end > top))
            continue;
        middle = 0.5f * (b->bottom[(size_t) (k - 1) * n + from[i]] + b->bottom[(size_t) k * n + from[i]]);
        middle = fminf(fmaxf(middle, top), end);
        *above = *here = middle;
        if (below)
            *below = end;
    }
}

enum pell_result bake_align(struct bake *b)
{
    const size_t n = (size_t) b->size * (size_t) b->size;
    uint32_t *from = pell_alloc_array(b->ctx, n, sizeof(*from));
    enum pell_result res = PELL_ERR_NOMEM;

    if (!from)
        return res;
    PELL_TRY(order_layers(b));
    res = PELL_ERR_NOMEM;
    b->bottom = pell_alloc_array(b->ctx, n, (size_t) (b->num_layers - 1) * sizeof(*b->bottom) + 1);
    if (!b->bottom)
        goto fail;
    for (size_t i = 0; i < n; i++)
        set_bottoms(b, i, n);
    for (int k = 1; k + 1 < b->num_layers; k++) {
        if (b->layer[k - 1] != b->layer[k + 1])
            continue;
        for (size_t i = 0; i < n; i++)
            from[i] = b->bottom[(size_t) k * n + i] > b->bottom[(size_t) (k - 1) * n + i] ? (uint32_t) i : NO_TEXEL;
        spread(b, from);
        place_absent_layer(b, k, from, n);
    }
    for (size_t i = 0; i < n; i++) /* uncovered texels copy the nearest covered one */
        from[i] = b->texels[i].count > 0 ? (uint32_t) i : NO_TEXEL;
    spread(b, from);
    for (int k = 0; k + 1 < b->num_layers; k++)
        for (size_t i = 0; i < n; i++)
            b->bottom[(size_t) k * n + i] = from[i] == NO_TEXEL ? 0.0f : b->bottom[(size_t) k * n + from[i]];
    res = pell_cancelled(b->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(b->ctx, from);
    return res;
}
