/* SPDX-License-Identifier: MIT
 * test_rows.c - images that are streamed by rows during a comparison: results are bit-identical to images in memory, and only requested
 * rows are read. */
#include "compare_test.h"

#include "compare/rows.h"

#include <math.h>

enum { WIDTH = 4100, HEIGHT = 130 }; /* three bands */

/* Serves copies of the requested rows, allocated exactly, so that a read beyond them is detected. */
struct copies {
    const struct pair *pair;
    float *rows[PICTURES][3], *mask;
    int moves, last, most, fail_at;
};

static void drop_copies(struct copies *copies)
{
    for (int i = 0; i < PICTURES; i++)
        for (int c = 0; c < 3; c++)
            free(copies->rows[i][c]);
    free(copies->mask);
    copies->mask = NULL;
}

static float *copy_rows(const float *plane, int first, int count)
{
    float *copy = malloc((size_t) count * WIDTH * sizeof(*copy));

    REQUIRE(copy);
    memcpy(copy, plane + (size_t) first * WIDTH, (size_t) count * WIDTH * sizeof(*copy));
    return copy;
}

static enum pell_result move(void *user, int first, int count, struct pell_compare_input *in)
{
    struct copies *copies = user;

    assert_true(first >= 0 && count > 0 && first + count <= HEIGHT);
    assert_true(first >= copies->last || first == 0); /* downwards, or restarted from the top */
    copies->last = first;
    copies->most = count > copies->most ? count : copies->most;
    if (++copies->moves == copies->fail_at)
        return PELL_ERR_IO;
    drop_copies(copies);
    for (int i = 0; i < PICTURES; i++)
        for (int c = 0; c < 3; c++)
            copies->rows[i][c] = copy_rows(copies->pair->plane[i][c], first, count);
    copies->mask = copy_rows(copies->pair->mask, first, count);
    for (int c = 0; c < 3; c++) {
        in->test[c] = copies->rows[TEST][c];
        in->reference[c] = copies->rows[REFERENCE][c];
        in->half[c] = in->half[c] ? copies->rows[HALF][c] : NULL;
    }
    in->mask = in->mask ? copies->mask : NULL;
    in->stride = WIDTH;
    return PELL_OK;
}

static void fill(struct pair *p)
{
    pair_begin(p, WIDTH, HEIGHT);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const size_t at = (size_t) y * WIDTH + (size_t) x;
            for (int c = 0; c < 3; c++) {
                const double light = exp(3.0 * sin(x * 0.003 + c) * cos(y * 0.05));
                p->plane[REFERENCE][c][at] = (float) (light * (0.9 + 0.2 * noise(x, y, c, 1)));
                p->plane[HALF][c][at] = (float) (light * (0.9 + 0.2 * noise(x, y, c, 2)));
                p->plane[TEST][c][at] = (float) (light * (0.95 + 0.2 * noise(x, y, c, 3)));
            }
            p->mask[at] = x + 20 * y > 4000 ? 1.0f : 0.0f;
        }
    p->plane[TEST][1][64 * WIDTH + 7] = NAN; /* invalid pixels next to the edges of bands */
    p->plane[REFERENCE][0][127 * WIDTH + 4000] = INFINITY;
    p->in.figures_only = true;
    p->params.exposures = 1;
    p->params.ppd = 10.0f;
}

static void bands_give_the_same_bits(void **state)
{
    struct pair p;
    struct copies copies = { .pair = &p };
    const struct pell_compare_rows rows = { move, &copies };

    (void) state;
    fill(&p);
    for (int variant = 0; variant < 3; variant++) {
        struct pell_comparison out;
        p.in.display = variant == 2;
        p.in.mask = variant ? p.mask : NULL;
        for (int c = 0; c < 3; c++)
            p.in.half[c] = variant == 1 ? p.plane[HALF][c] : NULL;
        pair_compare(&p);
        copies.moves = copies.last = copies.most = 0;
        assert_int_equal(pell_compare_by_rows(p.ctx, &p.in, &rows, &p.params, &out), PELL_OK);
        assert_int_equal(copies.moves, variant == 2 ? 6 : 9); /* three bands: survey, exposures, errors and filters */
        assert_true(copies.most <= pell_compare_band(WIDTH) + 2 * PELL_COMPARE_REACH);
        out.seconds = p.out.seconds;
        assert_memory_equal(&out, &p.out, sizeof(out));
        assert_true(out.whole.pixels == WIDTH * HEIGHT - 2 && out.bad_test == 1 && out.bad_reference == 1);
    }
    drop_copies(&copies);
    pair_end(&p);
}

static void rows_that_can_not_be_read_end_it(void **state)
{
    struct pair p;
    struct copies copies = { .pair = &p };
    const struct pell_compare_rows rows = { move, &copies };

    (void) state;
    fill(&p);
    for (copies.fail_at = 1; copies.fail_at <= 8; copies.fail_at += 3) {
        struct pell_comparison out;
        copies.moves = copies.last = 0;
        assert_int_equal(pell_compare_by_rows(p.ctx, &p.in, &rows, &p.params, &out), PELL_ERR_IO);
        assert_int_equal(copies.moves, copies.fail_at);
        assert_true(out.width == 0 && !out.flip);
    }
    drop_copies(&copies);
    pair_end(&p);
}

/* The exposures follow from the largest and the median luminance, which are found without sorting all values. */
static int by_value(const void *a, const void *b)
{
    const float x = *(const float *) a, y = *(const float *) b;
    return (x > y) - (x < y);
}

static void the_median_is_that_of_sorted_values(void **state)
{
    enum { ACROSS = 37, DOWN = 20, ALL = ACROSS * DOWN };
    struct pair p;
    float sorted[ALL];

    (void) state;
    for (int variant = 0; variant < 4; variant++) {
        double middle, t = 0.85, a, b, c, root;
        int count = variant == 1 ? ALL - 1 : ALL, first = 0;
        pair_begin(&p, ACROSS, DOWN);
        p.in.figures_only = true;
        for (int i = 0; i < ALL; i++) {
            const double light = variant == 3 && i % 3 ? -noise(i, 0, 0, 4) : exp2(20.0 * noise(i, 0, 0, variant) - 10.0);
            for (int k = 0; k < 3; k++)
                p.plane[TEST][k][i] = p.plane[REFERENCE][k][i] = (float) (variant == 2 && i % 3 ? 0.0 : light);
        }
        if (variant == 1)
            p.plane[TEST][0][ALL - 1] = NAN;
        pair_compare(&p);
        for (int i = 0; i < count; i++) {
            const double l = p.plane[REFERENCE][0][i];
            sorted[i] = (float) (0.2126 * l + 0.7152 * l + 0.0722 * l);
        }
        qsort(sorted, (size_t) count, sizeof(*sorted), by_value);
        assert_int_equal(p.out.hdr_above_black, variant >= 2);
        while (variant >= 2 && sorted[first] <= 1e-30f)
            first++;
        count -= first;
        middle = count % 2 ? (double) sorted[first + count / 2]
                           : 0.5 * ((double) sorted[first + count / 2] + (double) sorted[first + count / 2 - 1]);
        a = 0.36 * (2.51 - t * 2.43);
        b = 0.6 * (0.03 - t * 0.59);
        c = -t * 0.14;
        root = (-b + sqrt(b * b - 4.0 * a * c)) / (2.0 * a);
        REQUIRE_NEAR(p.out.hdr_stop, log2(root / middle), 1e-12);
        REQUIRE_NEAR(p.out.hdr_start, log2(root / (double) sorted[first + count - 1]), 1e-12);
        pair_end(&p);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bands_give_the_same_bits),
        cmocka_unit_test(rows_that_can_not_be_read_end_it),
        cmocka_unit_test(the_median_is_that_of_sorted_values),
    };
    return cmocka_run_group_tests_name("compare.rows", tests, NULL, NULL);
}
