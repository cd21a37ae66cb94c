#include "sequences/pattern.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_WIDTH = 20 };

struct placeholder {
    size_t begin, end;
    int width;
    bool as_printf; /* the sign counts as a digit */
};

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

static bool is_letter(char c)
{
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
}

/* Digits from p on; *width is limited, so that no count overflows. */
static const char *read_width(const char *p, int *width)
{
    *width = 0;
    for (; is_digit(*p); ++p) {
        if (*width <= MAX_WIDTH) *width = *width * 10 + (*p - '0');
    }
    return p;
}

/* The end of a placeholder that starts at p, else NULL. */
static const char *match(const char *p, struct placeholder *out)
{
    const char *end = p;

    out->as_printf = false;
    if (*p == '#') {
        while (*end == '#')
            ++end;
        out->width = end - p > MAX_WIDTH ? MAX_WIDTH + 1 : (int)(end - p);
        return end;
    }
    if (p[0] == '$' && p[1] == 'F') {
        end = read_width(p + 2, &out->width);
        if (end == p + 2 && is_letter(*end)) return NULL;
        return end;
    }
    if (p[0] == '%' && (p[1] == 'd' || p[1] == '0')) {
        end = read_width(p + 1, &out->width);
        if (*end != 'd') return NULL;
        out->as_printf = true;
        return end + 1;
    }
    return NULL;
}

/* *found = 0 or 1. */
static kl_status find_placeholder(const char *pattern, struct placeholder *out, int *found,
                                  struct kl_err *err)
{
    *found = 0;
    for (const char *p = pattern; *p != '\0';) {
        struct placeholder here;
        const char *end = match(p, &here);
        if (end == NULL) {
            ++p;
            continue;
        }
        if (++*found > 1) {
            return kl_fail(err, KL_ERR_USAGE,
                           "file pattern \"%.200s\": a second frame number at character %d",
                           pattern, (int)(p - pattern) + 1);
        }
        if (here.width > MAX_WIDTH) {
            return kl_fail(err, KL_ERR_USAGE, "file pattern \"%.200s\": more than %d digits",
                           pattern, MAX_WIDTH);
        }
        here.begin = (size_t)(p - pattern);
        here.end = (size_t)(end - pattern);
        *out = here;
        p = end;
    }
    return KL_OK;
}

/* Where the extension starts: the last dot of the file's name, but not its first character. */
static size_t extension_get(const char *pattern)
{
    const char *slash = strrchr(pattern, '/');
    const char *name = slash != NULL ? slash + 1 : pattern;
    const char *dot = strrchr(name, '.');

    return dot != NULL && dot != name ? (size_t)(dot - pattern) : strlen(pattern);
}

static void format_number(const struct placeholder *place, int32_t frame, char *out, size_t size)
{
    const int64_t magnitude = llabs((long long)frame);

    if (place->as_printf) {
        (void)snprintf(out, size, "%0*" PRId32, place->width, frame);
    } else {
        (void)snprintf(out, size, "%s%0*" PRId64, frame < 0 ? "-" : "", place->width, magnitude);
    }
}

kl_status kl_pattern_format(const char *pattern, int32_t frame, bool many, char *out, size_t size,
                            struct kl_err *err)
{
    struct placeholder place = {0};
    char number[64] = "";
    int found = 0;
    const char *dot = "";
    const size_t length = strlen(pattern);

    if (length == 0 || pattern[length - 1] == '/') {
        return kl_fail(err, KL_ERR_USAGE, "file pattern \"%.200s\": no file name", pattern);
    }
    kl_status st = find_placeholder(pattern, &place, &found, err);
    if (st != KL_OK) return st;
    if (found == 0) {
        place.begin = place.end = extension_get(pattern);
        place.width = 4;
        if (many) dot = ".";
    }
    if (found != 0 || many) format_number(&place, frame, number, sizeof number);
    const int n = snprintf(out, size, "%.*s%s%s%s", (int)place.begin, pattern, dot, number,
                           pattern + place.end);
    if (n < 0 || (size_t)n >= size) {
        return kl_fail(err, KL_ERR_USAGE, "file pattern \"%.200s\": the name is too long", pattern);
    }
    return KL_OK;
}
