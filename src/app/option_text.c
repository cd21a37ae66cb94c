#include "src/app/option_text.h"

#include "src/image/image.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Whole numbers without sign or spaces; *end is what follows. */
static bool read_digits(const char *text, unsigned long long most, unsigned long long *out,
                        const char **end)
{
    char *after = NULL;

    if (*text < '0' || *text > '9') return false;
    errno = 0;
    *out = strtoull(text, &after, 10);
    *end = after;
    return errno == 0 && *out <= most;
}

kl_status kl_option_read_u32(const char *option, const char *text, uint32_t least, uint32_t most,
                             uint32_t *out, struct kl_err *err)
{
    unsigned long long value = 0;
    const char *end = NULL;

    if (!read_digits(text, most, &value, &end) || *end != '\0' || value < least) {
        return kl_fail(err, KL_ERR_USAGE, "--%s: '%s' is not a whole number from %lu to %lu",
                       option, text, (unsigned long)least, (unsigned long)most);
    }
    *out = (uint32_t)value;
    return KL_OK;
}

kl_status kl_option_read_number(const char *option, const char *text, double least, double most,
                                double *out, struct kl_err *err)
{
    char *end = NULL;
    const double value = strtod(text, &end);

    if (end == text || *end != '\0' || !isfinite(value) || value < least || value > most) {
        return kl_fail(err, KL_ERR_USAGE, "--%s: '%s' is not a number from %g to %g", option, text,
                       least, most);
    }
    *out = value;
    return KL_OK;
}

kl_status kl_option_read_share(const char *option, const char *text, double *out,
                               struct kl_err *err)
{
    char *end = NULL;
    double value = strtod(text, &end);
    const bool percent = end != text && *end == '%';

    if (percent) {
        ++end;
        value *= 0.01;
    }
    if (end == text || *end != '\0' || !(value > 0.0) || !(value <= 1.0)) {
        return kl_fail(err, KL_ERR_USAGE, "--%s: '%s' is not a share, as 1%% or 0.01", option,
                       text);
    }
    *out = value;
    return KL_OK;
}

kl_status kl_option_read_bytes(const char *option, const char *text, uint64_t *out,
                               struct kl_err *err)
{
    static const char units[] = "KMG";
    unsigned long long value = 0;
    const char *end = NULL;
    bool sound = read_digits(text, 1ull << 33, &value, &end);
    const char *unit = sound && *end != '\0' ? strchr(units, *end) : NULL;

    if (unit != NULL) {
        value <<= 10 * (unit - units + 1);
        ++end;
    }
    sound = sound && *end == '\0' && value > 0;
    if (!sound) {
        return kl_fail(err, KL_ERR_USAGE, "--%s: '%s' is not a number of bytes such as 500M",
                       option, text);
    }
    *out = value;
    return KL_OK;
}

kl_status kl_option_read_box(const char *option, const char *text, double out[2][3],
                             struct kl_err *err)
{
    const char *next = text;
    bool sound = true;

    for (int i = 0; i < 6 && sound; ++i) {
        char *end = NULL;
        const double x = strtod(next, &end);
        sound = end != next && isfinite(x) && *end == (i < 5 ? ',' : '\0');
        out[i / 3][i % 3] = x;
        next = end + 1;
    }
    if (!sound) {
        return kl_fail(err, KL_ERR_USAGE, "--%s: '%s' is not two corners such as 0,0,0,1,2.5,3",
                       option, text);
    }
    for (int k = 0; k < 3; ++k) {
        const double a = out[0][k];
        const double b = out[1][k];
        out[0][k] = fmin(a, b);
        out[1][k] = fmax(a, b);
    }
    return KL_OK;
}

kl_status kl_option_read_size(const char *option, const char *text, uint32_t *width,
                              uint32_t *height, struct kl_err *err)
{
    unsigned long long w = 0;
    unsigned long long h = 0;
    const char *end = NULL;
    const bool sound = read_digits(text, KL_IMAGE_MAX_SIDE, &w, &end) && *end == 'x' &&
                       read_digits(end + 1, KL_IMAGE_MAX_SIDE, &h, &end) && *end == '\0';

    if (!sound || w == 0 || h == 0) {
        return kl_fail(err, KL_ERR_USAGE, "--%s: '%s' is not WIDTHxHEIGHT with sides up to %d",
                       option, text, KL_IMAGE_MAX_SIDE);
    }
    *width = (uint32_t)w;
    *height = (uint32_t)h;
    return KL_OK;
}

kl_status kl_option_read_word(const char *option, const char *text,
                              const struct kl_option_word *words, int *out, struct kl_err *err)
{
    char list[256] = "";
    size_t used = 0;

    for (const struct kl_option_word *w = words; w->word != NULL; ++w) {
        if (strcmp(w->word, text) == 0) {
            *out = w->value;
            return KL_OK;
        }
        const int n = snprintf(list + used, sizeof list - used, "%s%s", used ? ", " : "", w->word);
        if (n > 0 && used + (size_t)n < sizeof list) used += (size_t)n;
    }
    return kl_fail(err, KL_ERR_USAGE, "--%s: '%s' is none of %s", option, text, list);
}
