/* SPDX-License-Identifier: MIT
 * test_nnls.c - the active-set solver of non-negative least squares against a search over all subsets of free weights. */
#include "pell_test.h"

#include "math/nnls.h"

static double uniform(uint64_t *seed)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (double) (*seed >> 11) * 0x1p-53 * 2.0 - 1.0;
}

static double cost(const struct pell_nnls *p, const double *w)
{
    double sum = 0.0;
    for (int i = 0; i < p->count; i++) {
        double r = -p->rhs[i];
        for (int j = 0; j < p->count; j++)
            r += w[j] * p->column[j][i];
        sum += r * r;
    }
    return sum;
}

/* Solves a small symmetric system by elimination with full pivoting; false if it is singular. */
static bool solve(int n, double a[][PELL_NNLS_MAX + 2], double *x)
{
    int col[PELL_NNLS_MAX + 2];
    for (int i = 0; i < n; i++)
        col[i] = i;
    for (int k = 0; k < n; k++) {
        int pi = k, pj = k;
        for (int i = k; i < n; i++)
            for (int j = k; j < n; j++)
                if (fabs(a[i][j]) > fabs(a[pi][pj])) {
                    pi = i;
                    pj = j;
                }
        if (fabs(a[pi][pj]) < 1e-13)
            return false;
        for (int j = 0; j <= n; j++) {
            const double t = a[k][j];
            a[k][j] = a[pi][j];
            a[pi][j] = t;
        }
        for (int i = 0; i < n; i++) {
            const double t = a[i][k];
            a[i][k] = a[i][pj];
            a[i][pj] = t;
        }
        const int c = col[k];
        col[k] = col[pj];
        col[pj] = c;
        for (int i = k + 1; i < n; i++)
            for (int j = n; j >= k; j--)
                a[i][j] -= a[i][k] / a[k][k] * a[k][j];
    }
    for (int k = n - 1; k >= 0; k--) {
        double s = a[k][n];
        for (int j = k + 1; j < n; j++)
            s -= a[k][j] * x[col[j]];
        x[col[k]] = s / a[k][k];
    }
    return true;
}

/* The least cost over all subsets whose normal equations (with a multiplier for the sum) have a feasible solution. */
static double best_subset(const struct pell_nnls *p)
{
    double best = INFINITY;
    for (unsigned mask = 0; mask < 1u << p->count; mask++) {
        double a[PELL_NNLS_MAX + 2][PELL_NNLS_MAX + 2] = { { 0 } }, x[PELL_NNLS_MAX + 2] = { 0 }, w[PELL_NNLS_MAX] = { 0 };
        int set[PELL_NNLS_MAX], n = 0;
        bool feasible = true;
        for (int j = 0; j < p->count; j++)
            if (mask >> j & 1u)
                set[n++] = j;
        if (n == 0 && p->fixed_sum)
            continue;
        const int size = n + (p->fixed_sum ? 1 : 0);
        for (int i = 0; i < n; i++) {
            for (int j = 0; j < n; j++)
                for (int k = 0; k < p->count; k++)
                    a[i][j] += p->column[set[i]][k] * p->column[set[j]][k];
            for (int k = 0; k < p->count; k++)
                a[i][size] += p->column[set[i]][k] * p->rhs[k];
            if (p->fixed_sum)
                a[i][n] = a[n][i] = 1.0;
        }
        if (p->fixed_sum)
            a[n][size] = p->sum;
        if (!solve(size, a, x))
            continue;
        for (int i = 0; i < n; i++) {
            w[set[i]] = x[i];
            feasible = feasible && x[i] >= 0.0;
        }
        if (feasible)
            best = fmin(best, cost(p, w));
    }
    return best;
}

static void random_problem(uint64_t *seed, int count, bool fixed_sum, struct pell_nnls *p)
{
    memset(p, 0, sizeof(*p));
    p->count = count;
    p->fixed_sum = fixed_sum;
    p->sum = 0.1 + fabs(uniform(seed));
    for (int j = 0; j < count; j++) {
        p->rhs[j] = uniform(seed);
        for (int i = 0; i < count; i++)
            p->column[j][i] = uniform(seed) + 0.5;
    }
}

static void no_subset_of_weights_is_better(void **state)
{
    uint64_t seed = 1;
    int held = 0;
    (void) state;
    for (int round = 0; round < 600; round++) {
        struct pell_nnls p;
        struct pell_nnls_solution s;
        double total = 0.0;
        random_problem(&seed, 1 + round % 7, round % 2, &p);
        pell_nnls_factor(&p, &s);
        pell_nnls_solve(&p, &s);
        for (int j = 0; j < p.count; j++) {
            REQUIRE(s.w[j] >= 0.0);
            held += s.w[j] == 0.0;
            total += s.w[j];
        }
        if (p.fixed_sum)
            REQUIRE_REL(total, p.sum, 1e-14);
        REQUIRE_NEAR(cost(&p, s.w), best_subset(&p), 1e-11);
    }
    REQUIRE(held > 300); /* the constraint was active */
}

static void basis_is_orthonormal_and_spans_the_free_directions(void **state)
{
    uint64_t seed = 2;
    (void) state;
    for (int round = 0; round < 100; round++) {
        struct pell_nnls p;
        struct pell_nnls_solution s;
        random_problem(&seed, 6, round % 2, &p);
        pell_nnls_factor(&p, &s);
        pell_nnls_solve(&p, &s);
        for (int a = 0; a < s.rank; a++) {
            for (int b = 0; b <= a; b++) {
                double d = 0.0;
                for (int i = 0; i < p.count; i++)
                    d += s.q[a][i] * s.q[b][i];
                REQUIRE_NEAR(d, a == b ? 1.0 : 0.0, 1e-13);
            }
            for (int i = 0; i < p.count; i++) {
                double v = 0.0;
                for (int k = 0; k <= a; k++)
                    v += s.q[k][i] * s.r[k][a];
                REQUIRE_NEAR(v, p.column[s.free[a]][i] - (s.pivot >= 0 ? p.column[s.pivot][i] : 0.0), 1e-13);
            }
        }
    }
}

static void equal_and_zero_columns_do_no_harm(void **state)
{
    uint64_t seed = 3;
    (void) state;
    for (int round = 0; round < 100; round++) {
        struct pell_nnls p;
        struct pell_nnls_solution s;
        double total = 0.0;
        random_problem(&seed, 5, round % 2, &p);
        memcpy(p.column[3], p.column[1], sizeof(p.column[1]));
        memset(p.column[4], 0, sizeof(p.column[4]));
        pell_nnls_factor(&p, &s);
        pell_nnls_solve(&p, &s);
        for (int j = 0; j < p.count; j++) {
            REQUIRE(isfinite(s.w[j]) && s.w[j] >= 0.0);
            total += s.w[j];
        }
        if (p.fixed_sum)
            REQUIRE_REL(total, p.sum, 1e-13);
        REQUIRE(cost(&p, s.w) <= best_subset(&p) + 1e-11);
    }
}

static void one_weight_takes_the_whole_sum(void **state)
{
    struct pell_nnls p = { .count = 1, .fixed_sum = true, .sum = 0.7, .column = { { -2.0 } }, .rhs = { 5.0 } };
    struct pell_nnls_solution s;
    (void) state;
    pell_nnls_factor(&p, &s);
    pell_nnls_solve(&p, &s);
    assert_true(s.w[0] == 0.7 && s.rank == 0 && s.pivot == 0);
    p.fixed_sum = false;
    pell_nnls_factor(&p, &s);
    pell_nnls_solve(&p, &s);
    assert_true(s.w[0] == 0.0 && s.rank == 0 && s.pivot == -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_subset_of_weights_is_better),
        cmocka_unit_test(basis_is_orthonormal_and_spans_the_free_directions),
        cmocka_unit_test(equal_and_zero_columns_do_no_harm),
        cmocka_unit_test(one_weight_takes_the_whole_sum),
    };
    return cmocka_run_group_tests_name("math.nnls", tests, NULL, NULL);
}
