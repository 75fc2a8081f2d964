/* SPDX-License-Identifier: MIT
 * lex.h - a fast scanner of words and numbers for the OBJ, MTL and ASCII PLY readers. The text ends with a NUL. */
#ifndef PELL_LEX_H
#define PELL_LEX_H

#include "base/base.h"

#include <float.h>
#include <math.h>
#include <string.h>

struct pell_lex {
    const char *at, *end;
    int64_t line; /* counted from 1 */
};

/* "path:line N" for messages: where the cursor is. Returns text->str. */
static inline const char *pell_lex_where(const struct pell_lex *l, const char *path, struct pell_text *text)
{
    memset(text, 0, sizeof(*text));
    pell_text_add_path(text, path, ":", "line ");
    pell_text_add(text, "%lld", (long long) l->line);
    return text->str;
}

static inline bool pell_lex_eol(const struct pell_lex *l)
{
    return l->at >= l->end || *l->at == '\n' || *l->at == '\r';
}

/* Skips blanks, and line ends after a backslash. */
static inline void pell_lex_blank(struct pell_lex *l)
{
    for (;;) {
        if (l->at >= l->end)
            return;
        if (*l->at == ' ' || *l->at == '\t' || *l->at == '\v' || *l->at == '\f') {
            l->at++;
        } else if (*l->at == '\\' && l->at + 1 < l->end && (l->at[1] == '\n' || l->at[1] == '\r')) {
            l->at += l->at[1] == '\r' && l->at + 2 < l->end && l->at[2] == '\n' ? 3 : 2;
            l->line++;
        } else {
            return;
        }
    }
}

/* Moves to the start of the next line; "\n", "\r\n" and "\r" end one. */
static inline void pell_lex_next_line(struct pell_lex *l)
{
    for (;;) {
        while (!pell_lex_eol(l) && *l->at != '\\')
            l->at++;
        if (l->at >= l->end)
            return;
        if (*l->at != '\\')
            break;
        if (l->at + 1 < l->end && (l->at[1] == '\n' || l->at[1] == '\r'))
            pell_lex_blank(l);
        else
            l->at++;
    }
    l->at += *l->at == '\r' && l->at + 1 < l->end && l->at[1] == '\n' ? 2 : 1;
    l->line++;
}

/* The word at the cursor, which moves past it; length 0 at the end of the line. */
static inline size_t pell_lex_word(struct pell_lex *l, const char **word)
{
    pell_lex_blank(l);
    *word = l->at;
    while (l->at < l->end && (unsigned char) *l->at > ' ') {
        if (*l->at == '\\' && l->at + 1 < l->end && (l->at[1] == '\n' || l->at[1] == '\r'))
            break;
        l->at++;
    }
    return (size_t) (l->at - *word);
}

static inline bool pell_word_is(const char *word, size_t length, const char *text)
{
    return length == strlen(text) && memcmp(word, text, length) == 0;
}

/* The rest of the line without blanks at either end: names may hold blanks. */
static inline size_t pell_lex_rest(struct pell_lex *l, const char **text)
{
    const char *end;

    pell_lex_blank(l);
    *text = l->at;
    while (!pell_lex_eol(l))
        l->at++;
    end = l->at;
    while (end > *text && (end[-1] == ' ' || end[-1] == '\t'))
        end--;
    return (size_t) (end - *text);
}

/* A number that fits a float. Most have few digits: they are accumulated as an integer and scaled once, which is exact; the others go to
 * pell_parse_number. False and the cursor unmoved if the word is no such number. */
static inline bool pell_lex_float(struct pell_lex *l, float *value)
{
    static const double powers[] = { 1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                     1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22 };
    struct pell_lex start;
    const char *p, *word;
    uint64_t mantissa = 0;
    int digits = 0, point = 0, exponent = 0, after = 0;
    bool negative, negative_exponent;
    double v;
    size_t length;

    pell_lex_blank(l);
    start = *l;
    p = l->at;
    negative = *p == '-';
    p += *p == '-' || *p == '+';
    for (;; p++) {
        if (*p >= '0' && *p <= '9') {
            mantissa = mantissa * 10 + (uint64_t) (*p - '0');
            digits++;
            after += point;
        } else if (*p == '.' && !point) {
            point = 1;
        } else {
            break;
        }
    }
    if (digits && (*p == 'e' || *p == 'E')) {
        const char *q = p + 1;
        negative_exponent = *q == '-';
        q += *q == '-' || *q == '+';
        if (*q >= '0' && *q <= '9') {
            for (; *q >= '0' && *q <= '9' && exponent < 10000; q++)
                exponent = exponent * 10 + (*q - '0');
            exponent = negative_exponent ? -exponent : exponent;
            p = q;
        }
    }
    exponent -= after;
    if (digits > 0 && digits <= 19 && mantissa < (UINT64_C(1) << 53) && exponent >= -22 && exponent <= 22 &&
        ((unsigned char) *p <= ' ' || *p == '\\')) {
        v = exponent < 0 ? (double) mantissa / powers[-exponent] : (double) mantissa * powers[exponent];
        l->at = p;
        *value = (float) (negative ? -v : v);
        return true;
    }
    length = pell_lex_word(l, &word);
    if (pell_parse_number(word, length, &v) && fabs(v) <= FLT_MAX) {
        *value = (float) v;
        return true;
    }
    *l = start;
    return false;
}

/* An integer of at most 18 digits; stops at the first other character. */
static inline bool pell_lex_integer(struct pell_lex *l, int64_t *value)
{
    const char *p = l->at;
    const bool negative = *p == '-';
    int64_t v = 0;
    int digits = 0;

    p += *p == '-' || *p == '+';
    for (; *p >= '0' && *p <= '9' && digits < 18; p++, digits++)
        v = v * 10 + (*p - '0');
    if (digits == 0 || (*p >= '0' && *p <= '9'))
        return false;
    l->at = p;
    *value = negative ? -v : v;
    return true;
}

#endif
