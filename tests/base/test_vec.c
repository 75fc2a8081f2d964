/* SPDX-License-Identifier: MIT
 * test_vec.c - src/math/vec.h: vectors, frames and matrices against their defining identities. */
#include "pell_test.h"

#include "math/vec.h"

static uint32_t seed = 1;

static float number(void) /* in [-1, 1) */
{
    seed = seed * 1664525u + 1013904223u;
    return (float) (seed >> 8) * 0x1p-23f - 1.0f;
}

static struct pell_vec3 vector(void)
{
    const float x = number(), y = number();
    return vec3(x, y, number());
}

static struct pell_mat4 affine(void)
{
    struct pell_mat4 m = mat4_identity();
    for (int i = 0; i < 16; i++)
        if (i % 4 < 3)
            m.m[i] = number() + (i % 5 == 0 ? 2.0 : 0.0);
    return m;
}

static void require_vec(struct pell_vec3 a, struct pell_vec3 b, double tolerance)
{
    REQUIRE_NEAR(a.x, b.x, tolerance);
    REQUIRE_NEAR(a.y, b.y, tolerance);
    REQUIRE_NEAR(a.z, b.z, tolerance);
}

static void vectors_obey_their_identities(void **state)
{
    float p[3] = { 1, 2, 3 }, q[3];
    (void) state;

    vec3_store(vec3_load(p), q);
    assert_memory_equal(p, q, sizeof(p));
    require_vec(vec3_cross(vec3(1, 0, 0), vec3(0, 1, 0)), vec3(0, 0, 1), 0);
    require_vec(vec3_normalize(vec3(0, 0, 0)), vec3(0, 0, 0), 0);
    for (int i = 0; i < 1000; i++) {
        const struct pell_vec3 a = vector(), b = vector(), c = vec3_cross(a, b);
        const float s = number();

        REQUIRE_NEAR(vec3_dot(a, c), 0, 1e-6);
        REQUIRE_NEAR(vec3_dot(b, c), 0, 1e-6);
        /* Lagrange: |a x b|^2 + (a.b)^2 = |a|^2 |b|^2 */
        REQUIRE_NEAR(vec3_dot(c, c) + (double) vec3_dot(a, b) * vec3_dot(a, b), (double) vec3_dot(a, a) * vec3_dot(b, b), 1e-5);
        REQUIRE_NEAR(vec3_length(vec3_normalize(a)), 1, 1e-6);
        require_vec(vec3_mad(a, s, b), vec3_add(a, vec3_mul(b, s)), 1e-6);
        require_vec(vec3_sub(vec3_add(a, b), b), a, 1e-6);
    }
}

static void basis_is_orthonormal_and_right_handed_everywhere(void **state)
{
    (void) state;
    for (int i = 0; i < 10000; i++) {
        struct pell_vec3 n = vec3_normalize(vector()), t, b;

        if (i < 6) /* the poles and the other axes */
            n = vec3(i / 2 == 0 ? 1.0f - 2 * (i % 2) : 0, i / 2 == 1 ? 1.0f - 2 * (i % 2) : 0, i / 2 == 2 ? 1.0f - 2 * (i % 2) : 0);
        else if (i < 100)
            n = vec3_normalize(vec3(number() * 1e-4f, number() * 1e-4f, i % 2 ? 1.0f : -1.0f));
        vec3_basis(n, &t, &b);
        REQUIRE_NEAR(vec3_dot(t, t), 1, 2e-6);
        REQUIRE_NEAR(vec3_dot(b, b), 1, 2e-6);
        REQUIRE_NEAR(vec3_dot(t, b), 0, 2e-6);
        REQUIRE_NEAR(vec3_dot(t, n), 0, 2e-6);
        REQUIRE_NEAR(vec3_dot(b, n), 0, 2e-6);
        require_vec(vec3_cross(t, b), n, 4e-6);
    }
}

static void matrices_compose_right_to_left(void **state)
{
    (void) state;
    for (int i = 0; i < 1000; i++) {
        const struct pell_mat4 a = affine(), b = affine(), ab = mat4_mul(&a, &b), id = mat4_identity(), aid = mat4_mul(&a, &id);
        const struct pell_vec3 p = vector(), zero = vec3(0, 0, 0);

        require_vec(mat4_point(&ab, p), mat4_point(&a, mat4_point(&b, p)), 1e-5);
        require_vec(mat4_direction(&ab, p), mat4_direction(&a, mat4_direction(&b, p)), 1e-5);
        require_vec(vec3_sub(mat4_point(&a, p), mat4_point(&a, zero)), mat4_direction(&a, p), 1e-5);
        assert_memory_equal(&aid, &a, sizeof(a));
        REQUIRE_NEAR(mat4_determinant3(&ab), mat4_determinant3(&a) * mat4_determinant3(&b), 1e-9);
    }
}

/* A transformed normal stays perpendicular to the transformed tangents, and on its side under a reflection. */
static void normals_stay_normal_and_on_their_side(void **state)
{
    int mirrors = 0;
    (void) state;

    for (int i = 0; i < 1000; i++) {
        struct pell_mat4 a = affine();
        const struct pell_vec3 n = vec3_normalize(vector());
        struct pell_vec3 t, b, out, cross;
        double det;

        if (i % 2)
            for (int k = 0; k < 3; k++)
                a.m[k] = -a.m[k];
        det = mat4_determinant3(&a);
        if (fabs(det) < 0.1)
            continue;
        mirrors += det < 0;
        vec3_basis(n, &t, &b);
        out = mat4_normal(&a, n);
        REQUIRE_NEAR(vec3_dot(out, mat4_direction(&a, t)), 0, 2e-5);
        REQUIRE_NEAR(vec3_dot(out, mat4_direction(&a, b)), 0, 2e-5);
        REQUIRE(vec3_dot(out, mat4_direction(&a, n)) > 0);
        cross = vec3_cross(mat4_direction(&a, t), mat4_direction(&a, b));
        REQUIRE_NEAR(vec3_length(out), vec3_length(cross), 2e-5);
    }
    assert_in_range(mirrors, 100, 900);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(vectors_obey_their_identities),
        cmocka_unit_test(basis_is_orthonormal_and_right_handed_everywhere),
        cmocka_unit_test(matrices_compose_right_to_left),
        cmocka_unit_test(normals_stay_normal_and_on_their_side),
    };
    return cmocka_run_group_tests_name("vec", tests, NULL, NULL);
}
