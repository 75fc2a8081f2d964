/* SPDX-License-Identifier: MIT
 * version.c - the library's version, and compatibility with programs built against others. */
#include <pellucid/version.h>

int pell_version_number(void)
{
    return PELL_VERSION_NUMBER;
}

const char *pell_version_string(void)
{
    return PELL_VERSION_STRING;
}

bool pell_version_compatible(int headers)
{
    const int major = headers / 1000000, minor = headers / 1000 % 1000;

    if (headers < 0 || major != PELL_VERSION_MAJOR)
        return false;
    return major == 0 ? minor == PELL_VERSION_MINOR : minor <= PELL_VERSION_MINOR;
}
