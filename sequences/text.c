#include "sequences/text_impl.h"

#include <string.h>

struct text text_start(const char *what, const char *text)
{
    const struct text t = {.what = what, .start = text, .next = text};

    return t;
}

void text_skip_spaces(struct text *text)
{
    while (*text->next == ' ' || *text->next == '\t')
        ++text->next;
}

bool text_take(struct text *text, const char *token)
{
    const size_t size = strlen(token);

    if (strncmp(text->next, token, size) != 0) return false;
    text->next += size;
    return true;
}

bool text_is_at_end(const struct text *text)
{
    return *text->next == '\0';
}

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

kl_status text_fail(const struct text *text, const char *expected, struct kl_err *err)
{
    const int column = (int)(text->next - text->start) + 1;
    const unsigned char c = (unsigned char)*text->next;

    if (c == '\0') {
        return kl_fail(err, KL_ERR_USAGE, "%s \"%.60s\": ends at character %d, expected %s",
                       text->what, text->start, column, expected);
    }
    if (c < 32 || c > 126) {
        return kl_fail(err, KL_ERR_USAGE, "%s: character %d is byte 0x%02x, expected %s",
                       text->what, column, c, expected);
    }
    return kl_fail(err, KL_ERR_USAGE, "%s \"%.60s\": character %d is '%c', expected %s", text->what,
                   text->start, column, c, expected);
}

kl_status text_read_int(struct text *text, int64_t limit, int64_t *out, struct kl_err *err)
{
    const struct text start = *text;
    const bool minus = text_take(text, "-");
    int64_t value = 0;

    if (!is_digit(*text->next)) return text_fail(text, "a whole number", err);
    for (; is_digit(*text->next); ++text->next) {
        value = value * 10 + (*text->next - '0');
        if (value > limit) {
            return kl_fail(err, KL_ERR_USAGE,
                           "%s \"%.60s\": the number at character %d is beyond %lld", text->what,
                           text->start, (int)(start.next - start.start) + 1, (long long)limit);
        }
    }
    *out = minus ? -value : value;
    return KL_OK;
}

kl_status text_read_decimal(struct text *text, bool sign, double *out, struct kl_err *err)
{
    const bool minus = sign && text_take(text, "-");
    double value = 0.0;
    double unit = 1.0;
    bool any = false;

    for (; is_digit(*text->next); ++text->next) {
        value = value * 10.0 + (*text->next - '0');
        any = true;
        if (value > 1e15) return text_fail(text, "a smaller number", err);
    }
    if (text_take(text, ".")) {
        for (; is_digit(*text->next); ++text->next) {
            any = true;
            if (unit > 1e15) continue; /* digits that a double does not see */
            unit *= 10.0;
            value = value * 10.0 + (*text->next - '0');
        }
    }
    if (!any) return text_fail(text, "a number", err);
    value /= unit; /* one rounding: 0.1 is the double nearest to 0.1 */
    *out = minus ? -value : value;
    return KL_OK;
}
