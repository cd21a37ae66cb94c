#include "sequences/duration.h"

#include "sequences/text_impl.h"

kl_status kl_duration_parse(const char *text, double *out, struct kl_err *err)
{
    static const struct {
        const char *name;
        double seconds;
    } units[] = {{"d", 86400.0}, {"h", 3600.0}, {"m", 60.0}, {"s", 1.0}};
    enum { UNITS = sizeof units / sizeof units[0] };
    struct text t = text_start("duration", text);
    double total = 0.0;
    int next = 0; /* the largest unit that may still come */

    do {
        const bool is_first = t.next == t.start;
        double value = 0.0;
        kl_status st = text_read_decimal(&t, false, &value, err);
        if (st != KL_OK) return st;
        int unit = next;
        while (unit < UNITS && !text_take(&t, units[unit].name))
            ++unit;
        if (unit == UNITS && (!is_first || !text_is_at_end(&t))) {
            return text_fail(&t, "d, h, m or s, in this order", err);
        }
        total += value * (unit < UNITS ? units[unit].seconds : 1.0);
        next = unit + 1;
    } while (!text_is_at_end(&t));
    if (total > 1e9) return kl_fail(err, KL_ERR_USAGE, "duration \"%.60s\": too long", text);
    *out = total;
    return KL_OK;
}
