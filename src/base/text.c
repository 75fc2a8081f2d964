/* SPDX-License-Identifier: MIT
 * text.c - bounded texts, nearest names, safe printing, and numbers that don't depend on the locale. */
#include "base/base.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void pell_text_add(struct pell_text *text, const char *fmt, ...)
{
    const size_t room = sizeof(text->str) - text->length;
    va_list args;
    int n;

    va_start(args, fmt);
    n = vsnprintf(text->str + text->length, room, fmt, args);
    va_end(args);
    if (n < 0)
        text->str[text->length] = '\0';
    else
        text->length += (size_t) n < room ? (size_t) n : room - 1;
}

void pell_text_add_path(struct pell_text *text, const char *path, const char *separator, const char *instead)
{
    pell_text_add(text, "%s%s", path, path[0] ? separator : instead);
}

/* --- Nearest names ------------------------------------------------------------------------------------------------------------ */

enum { NAME_MAX_BYTES = 64, SUGGESTIONS_MAX = 4 }; /* longer names, and more of them, are never suggested */
enum { LIST_ENDS = 3 * NAME_MAX_BYTES + 32 };      /* least free bytes required to add another name to a list */

char pell_lower(char c)
{
    return c >= 'A' && c <= 'Z' ? (char) (c - 'A' + 'a') : c;
}

static int min3(int a, int b, int c)
{
    const int m = a < b ? a : b;
    return m < c ? m : c;
}

/* Damerau's distance in the restricted form (no edit inside a transposition), three rows at a time. */
static int distance(const char *a, int na, const char *b, int nb)
{
    int rows[3][NAME_MAX_BYTES + 1];

    for (int j = 0; j <= nb; j++)
        rows[0][j] = j;
    for (int i = 1; i <= na; i++) {
        int *row = rows[i % 3];
        const int *above = rows[(i + 2) % 3], *above2 = rows[(i + 1) % 3];

        row[0] = i;
        for (int j = 1; j <= nb; j++) {
            const int differ = pell_lower(a[i - 1]) != pell_lower(b[j - 1]);
            row[j] = min3(above[j] + 1, row[j - 1] + 1, above[j - 1] + differ);
            if (i > 1 && j > 1 && pell_lower(a[i - 1]) == pell_lower(b[j - 2]) && pell_lower(a[i - 2]) == pell_lower(b[j - 1]) &&
                above2[j - 2] + 1 < row[j])
                row[j] = above2[j - 2] + 1;
        }
    }
    return rows[na % 3][nb];
}

bool pell_text_contains(const char *text, const char *part)
{
    for (; *text; text++) {
        size_t i = 0;
        while (part[i] && pell_lower(text[i]) == pell_lower(part[i]))
            i++;
        if (!part[i])
            return true;
    }
    return false;
}

static const char *nearest(const char *name, const char *const *candidates, size_t count)
{
    const size_t length = strlen(name);
    const char *best = NULL;
    /* One edit, and one more for every five letters. Names of one or two letters get no suggestion: one edit makes another name. */
    int least = (length < 3 ? 0 : 1) + (int) length / 5 + 1;

    for (size_t i = 0; i < count; i++) {
        const size_t n = candidates[i] ? strlen(candidates[i]) : 0;
        int d;
        if (n == 0 || n > NAME_MAX_BYTES)
            continue;
        d = distance(name, (int) length, candidates[i], (int) n);
        if (d < least && d < (int) (length > n ? length : n)) {
            least = d;
            best = candidates[i];
        }
    }
    return best;
}

/* Names that contain `piece` ("milk" of "wholemilk" is far in edits but just as likely meant), the shortest first. */
static size_t with_piece(const char *piece, const char *const *candidates, size_t count, const char *found[SUGGESTIONS_MAX])
{
    size_t n = 0;

    for (size_t i = 0; i < count; i++) {
        const size_t length = candidates[i] ? strlen(candidates[i]) : 0;
        size_t at = n;
        if (length == 0 || length > NAME_MAX_BYTES || !pell_text_contains(candidates[i], piece))
            continue;
        while (at > 0 && strlen(found[at - 1]) > length)
            at--;
        if (at == SUGGESTIONS_MAX)
            continue;
        n += n < SUGGESTIONS_MAX;
        memmove(&found[at + 1], &found[at], (n - at - 1) * sizeof(*found));
        found[at] = candidates[i];
    }
    return n;
}

bool pell_text_suggest(struct pell_text *text, const char *prefix, const char *name, const char *const *candidates, size_t count)
{
    const size_t length = strlen(name);
    const char *found[SUGGESTIONS_MAX];
    size_t n = 0;

    if (length == 0 || length > NAME_MAX_BYTES)
        return false;
    found[0] = nearest(name, candidates, count);
    if (found[0])
        n = 1;
    else if (length >= 3)
        n = with_piece(name, candidates, count, found);
    for (size_t i = 0; i < n; i++) {
        char shown[3 * NAME_MAX_BYTES];
        pell_text_add(text, "%s\"%s%s\"",
                      i == 0      ? "did you mean "
                      : i + 1 < n ? ", "
                                  : " or ",
                      prefix, pell_printable(found[i], shown, sizeof(shown)));
    }
    pell_text_add(text, "%s", n > 0 ? "?" : "");
    return n > 0;
}

void pell_text_suggest_or_list(struct pell_text *text, const char *known, const char *name, const char *const *candidates, size_t count)
{
    if (pell_text_suggest(text, "", name, candidates, count))
        return;
    for (size_t i = 0; i < count; i++) {
        char shown[3 * NAME_MAX_BYTES];
        if (text->length + LIST_ENDS > sizeof(text->str)) {
            pell_text_add(text, " and %zu more", count - i);
            return;
        }
        if (candidates[i])
            pell_text_add(text, "%s%s", i ? ", " : known, pell_printable(candidates[i], shown, sizeof(shown)));
    }
}

struct pell_counted pell_counted(long long count, const char *one, const char *many)
{
    struct pell_counted text;

    snprintf(text.str, sizeof(text.str), "%lld %s", count, count == 1 ? one : many);
    return text;
}

/* --- Safe printing ------------------------------------------------------------------------------------------------------------ */

/* Bytes of the UTF-8 character at `s` if it is complete, in shortest form and printable, else 0. The NUL that ends `s` stops the
 * look-ahead. */
static size_t printable_bytes(const unsigned char *s)
{
    uint32_t c;
    size_t n;

    if (s[0] < 0x80)
        return s[0] >= 0x20 && s[0] != 0x7f ? 1 : 0;
    if (s[0] >= 0xc2 && s[0] < 0xe0) {
        n = 2;
        c = s[0] & 0x1fu;
    } else if (s[0] >= 0xe0 && s[0] < 0xf0) {
        n = 3;
        c = s[0] & 0x0fu;
    } else if (s[0] >= 0xf0 && s[0] < 0xf5) {
        n = 4;
        c = s[0] & 0x07u;
    } else {
        return 0;
    }
    for (size_t i = 1; i < n; i++) {
        if ((s[i] & 0xc0) != 0x80)
            return 0;
        c = c << 6 | (s[i] & 0x3fu);
    }
    if ((n == 3 && c < 0x800) || (n == 4 && c < 0x10000) || c > 0x10ffff || (c >= 0xd800 && c <= 0xdfff))
        return 0;
    /* C1 controls; separators; marks that reorder what follows them on a terminal; the byte order mark. */
    if (c < 0xa0 || (c >= 0x200b && c <= 0x200f) || (c >= 0x2028 && c <= 0x202e) || (c >= 0x2066 && c <= 0x2069) || c == 0xfeff)
        return 0;
    return n;
}

const char *pell_printable(const char *text, char *buffer, size_t size)
{
    const unsigned char *s = (const unsigned char *) (text ? text : "");
    size_t length = 0, cut = 0; /* `cut`: bytes that fit with "..." after them */

    if (size == 0)
        return "";
    while (*s) {
        const size_t valid = printable_bytes(s), n = valid ? valid : 1;
        if (length + n >= size) {
            if (size > 3) {
                memcpy(buffer + cut, "...", 4);
                return buffer;
            }
            break;
        }
        if (valid)
            memcpy(buffer + length, s, n);
        else
            buffer[length] = '?';
        length += n;
        if (length + 3 < size)
            cut = length;
        s += n;
    }
    buffer[length] = '\0';
    return buffer;
}

/* --- Numbers ------------------------------------------------------------------------------------------------------------------- */

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

/* 767 digits decide every double; what follows them only matters as zero or not. */
enum { DIGITS = 800 };

struct decimal {
    char digits[DIGITS + 32]; /* without leading zeros; room for an exponent */
    size_t count;
    uint64_t value;   /* of the digits while they are 19 or fewer */
    int64_t exponent; /* exponent of ten that scales the digits read as an integer */
    bool negative;
};

static void add_digit(struct decimal *d, char c, bool fraction)
{
    if (c == '0' && d->count == 0) {
        d->exponent -= fraction;
    } else if (d->count < DIGITS) {
        if (d->count < 19)
            d->value = d->value * 10 + (uint64_t) (c - '0');
        d->digits[d->count++] = c;
        d->exponent -= fraction;
    } else {
        if (c != '0')
            d->digits[DIGITS - 1] |= 1; /* a digit other than 0 was dropped: the number is no exact tie */
        d->exponent += !fraction;
    }
}

static bool scan_decimal(const char *s, const char *end, struct decimal *d)
{
    bool any = false, negative_exponent = false;
    int64_t exponent = 0;

    d->count = 0;
    d->value = 0;
    d->exponent = 0;
    d->negative = s < end && *s == '-';
    if (s < end && (*s == '-' || *s == '+'))
        s++;
    for (; s < end && is_digit(*s); s++, any = true)
        add_digit(d, *s, false);
    if (s < end && *s == '.')
        for (s++; s < end && is_digit(*s); s++, any = true)
            add_digit(d, *s, true);
    if (!any)
        return false;
    if (s < end && (*s == 'e' || *s == 'E')) {
        s++;
        negative_exponent = s < end && *s == '-';
        if (s < end && (*s == '-' || *s == '+'))
            s++;
        if (s == end || !is_digit(*s))
            return false;
        for (; s < end && is_digit(*s); s++)
            if (exponent < INT64_C(1000000000000000000) / 10)
                exponent = exponent * 10 + (*s - '0');
    }
    d->exponent += negative_exponent ? -exponent : exponent;
    return s == end;
}

/* Passes the digits to strtod as an integer with an exponent: without a decimal point the locale is irrelevant. */
bool pell_parse_number(const char *text, size_t length, double *value)
{
    static const double powers[] = { 1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                     1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22 };
    struct decimal d;
    double v;

    if (!scan_decimal(text, text + length, &d))
        return false;
    if (d.count == 0) {
        v = 0.0;
    } else if (FLT_EVAL_METHOD == 0 && d.count <= 19 && d.value < (UINT64_C(1) << 53) && d.exponent >= -22 && d.exponent <= 22) {
        /* Both factors are exact, so one operation rounds correctly (Clinger 1990). */
        v = d.exponent < 0 ? (double) d.value / powers[-d.exponent] : (double) d.value * powers[d.exponent];
    } else {
        const int64_t e = d.exponent < -100000 ? -100000 : d.exponent > 100000 ? 100000 : d.exponent;
        snprintf(d.digits + d.count, sizeof(d.digits) - d.count, "e%d", (int) e);
        v = strtod(d.digits, NULL);
        if (!isfinite(v))
            return false;
    }
    *value = d.negative ? -v : v;
    return true;
}

bool pell_parse_int(const char *text, size_t length, int64_t *value)
{
    const char *s = text, *end = text + length;
    const bool negative = s < end && *s == '-';
    int64_t v = 0;

    if (s < end && (*s == '-' || *s == '+'))
        s++;
    if (s == end)
        return false;
    for (; s < end; s++)
        if (!is_digit(*s) || __builtin_mul_overflow(v, 10, &v) ||
            (negative ? __builtin_sub_overflow(v, *s - '0', &v) : __builtin_add_overflow(v, *s - '0', &v)))
            return false;
    *value = v;
    return true;
}

const char *pell_format_number(double value, bool single, char *buffer, size_t size)
{
    char text[40];
    size_t length = 0;

    for (int digits = single ? 6 : 15; digits <= (single ? 9 : 17); digits++) {
        bool point = false;
        double back;

        snprintf(text, sizeof(text), "%.*g", digits, value);
        if (!isfinite(value))
            break;
        /* The locale's decimal point may be any text, of any length. */
        length = 0;
        for (const char *s = text; *s; s++) {
            if (is_digit(*s) || *s == '-' || *s == '+' || *s == 'e') {
                text[length++] = *s;
            } else if (!point) {
                text[length++] = '.';
                point = true;
            }
        }
        text[length] = '\0';
        if (pell_parse_number(text, length, &back) && (single ? (float) back == (float) value : back == value))
            break;
    }
    if (size)
        snprintf(buffer, size, "%s", text);
    return buffer;
}

/* --- Lengths -------------------------------------------------------------------------------------------------------------------- */

static const struct unit {
    const char *name;
    double times, over; /* one of them is 1: a single rounding */
} units[] = {
    { "nm", 1, 1e6 }, { "um", 1, 1e3 }, { "\xc2\xb5m", 1, 1e3 }, { "\xce\xbcm", 1, 1e3 }, { "mm", 1, 1 },
    { "cm", 10, 1 },  { "m", 1e3, 1 },  { "km", 1e6, 1 },        { "in", 25.4, 1 },
};
#define UNIT_NAMES "nm, um, mm, cm, m, km or in"

static bool is_unit_byte(char c)
{
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (unsigned char) c >= 0x80;
}

enum pell_result pell_parse_length(struct pell_context *ctx, const char *where, const char *text, double *mm)
{
    const size_t length = strlen(text);
    size_t start = length, digits;
    struct pell_text hint = { .length = 0 };
    char shown[64];
    double number;

    pell_printable(text, shown, sizeof(shown));
    if (pell_parse_number(text, length, &number)) {
        if (number > 0)
            pell_text_add(&hint, "write the unit behind it, as in %smm or %scm", shown, shown);
        else
            pell_text_add(&hint, "write a positive number and its unit, as in 70mm");
        return pell_error(ctx, PELL_ERR_INVALID, where, hint.str, "\"%s\" has no unit; units are " UNIT_NAMES, shown);
    }
    while (start > 0 && is_unit_byte(text[start - 1]))
        start--;
    for (digits = start; digits > 0 && text[digits - 1] == ' '; digits--)
        ;
    if (!pell_parse_number(text, digits, &number))
        return pell_error(ctx, PELL_ERR_INVALID, where, "write a number and its unit, as in 70mm",
                          "\"%s\" is not a length: a finite number and one of " UNIT_NAMES, shown);
    for (size_t i = 0; i < PELL_COUNT(units); i++) {
        double v;
        if (strcmp(text + start, units[i].name) != 0)
            continue;
        v = number * units[i].times / units[i].over;
        if (!isfinite(v) || !(v > 0))
            return pell_error(ctx, PELL_ERR_INVALID, where, NULL, "\"%s\" must be a length above 0 that is finite in millimetres", shown);
        *mm = v;
        return PELL_OK;
    }
    return pell_error(ctx, PELL_ERR_INVALID, where, "write a number and its unit, as in 70mm",
                      "\"%s\" has an unknown unit; units are " UNIT_NAMES, shown);
}
