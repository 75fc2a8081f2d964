// SPDX-License-Identifier: MIT
// elementary.glsl - sin, cos, acos and atan to a few units in the last place, under the names that the headers of src/shared call: Vulkan
// lets its own err by 2^-11 and, of acos and atan, by 4096 units in the last place.

#ifndef PELL_ELEMENTARY_GLSL
#define PELL_ELEMENTARY_GLSL

// For |x| up to some turns.
float pell_sin(float x)
{
    const float turns = round(x * (1.0 / 3.14159265));
    const float r = fma(turns, 8.74227766e-8, fma(turns, -3.14159274, x)), r2 = r * r; // pi in two floats
    const float sum = -1.66666667e-1 + r2 * (8.33333333e-3 + r2 * (-1.98412698e-4 + r2 * (2.75573192e-6 - r2 * 2.50521084e-8)));
    const float s = r + r * r2 * sum;
    return (int(turns) & 1) == 0 ? s : -s;
}

float pell_cos(float x)
{
    return pell_sin(x + 1.57079633);
}

// M. Abramowitz and I. A. Stegun 1964, "Handbook of Mathematical Functions", 4.4.46: error below 2e-8 of the root's factor.
float pell_acos(float x)
{
    const float a = abs(x);
    const float sum = 1.5707963050 + a * (-0.2145988016 + a * (0.0889789874 + a * (-0.0501743046 + a * (0.0308918810 +
                      a * (-0.0170881256 + a * (0.0066700901 - a * 0.0012624911))))));
    const float y = sqrt(max(1.0 - a, 0.0)) * sum;
    return x < 0.0 ? 3.14159265 - y : y;
}

// S. L. Moshier 1984, "Cephes", atanf.c: error below 2e-7.
float pell_atan2(float y, float x)
{
    const float a = min(abs(x), abs(y)), b = max(abs(x), abs(y));
    const bool diagonal = a > 0.414213562 * b; // measured from the diagonal
    const float t = diagonal ? (a - b) / (a + b) : a / max(b, 1e-30), t2 = t * t;
    const float sum = t2 * (-3.33329491539e-1 + t2 * (1.99777106478e-1 + t2 * (-1.38776856032e-1 + t2 * 8.05374449538e-2)));
    const float reduced = (diagonal ? 0.785398163 : 0.0) + (t + t * sum), steep = abs(y) > abs(x) ? 1.57079633 - reduced : reduced;
    const float angle = x < 0.0 ? 3.14159265 - steep : steep;
    return y < 0.0 ? -angle : angle;
}

#define sinf(x) pell_sin(x)
#define cosf(x) pell_cos(x)
#define acosf(x) pell_acos(x)
#define atan2f(y, x) pell_atan2(y, x)

#endif
