#include "sequences/shutter.h"

#include "sequences/text_impl.h"

#include <math.h>

static const double longest_frames = 10.0;

static uint32_t common_divisor(uint32_t a, uint32_t b)
{
    while (b != 0) {
        const uint32_t rest = a % b;
        a = b;
        b = rest;
    }
    return a;
}

static struct kl_fps reduce(uint32_t numerator, uint32_t denominator)
{
    const uint32_t d = common_divisor(numerator, denominator);
    const struct kl_fps fps = {.numerator = (int32_t)(numerator / d),
                               .denominator = denominator / d};

    return fps;
}

kl_status kl_fps_parse(const char *text, struct kl_fps *out, struct kl_err *err)
{
    struct text t = text_start("fps", text);
    double value = 0.0;
    int64_t denominator = 1;
    kl_status st = text_read_decimal(&t, false, &value, err);

    if (st != KL_OK) return st;
    if (text_take(&t, "/")) {
        st = text_read_int(&t, 1000000, &denominator, err);
        if (st != KL_OK) return st;
        if (denominator < 1 || value != floor(value) || value > 100000000.0) {
            return kl_fail(err, KL_ERR_USAGE, "fps \"%.60s\": expected such as 24000/1001", text);
        }
    }
    if (!text_is_at_end(&t)) return text_fail(&t, "the end", err);
    const double rate = value / (double)denominator;
    if (!(rate >= 0.001 && rate <= 100000.0)) {
        return kl_fail(err, KL_ERR_USAGE, "fps \"%.60s\": not within 0.001 and 100000", text);
    }
    if (denominator > 1 || value == floor(value)) {
        *out = reduce((uint32_t)value, (uint32_t)denominator);
        return KL_OK;
    }
    /* 23.976, 23.98, 29.97, 59.94, ...: television's n * 1000 / 1001, rounded. */
    const double whole = ceil(rate);
    if (fabs(whole * 1000.0 / 1001.0 - rate) < 0.005 && whole >= 24.0) {
        *out = reduce((uint32_t)whole * 1000, 1001);
    } else {
        *out = reduce((uint32_t)lround(rate * 1000.0), 1000);
    }
    return KL_OK;
}

double kl_fps_get(struct kl_fps fps)
{
    return (double)fps.numerator / fps.denominator;
}

static kl_status read_frames(struct text *t, bool sign, double *out, struct kl_err *err)
{
    double value = 0.0;
    kl_status st = text_read_decimal(t, sign, &value, err);

    if (st != KL_OK) return st;
    if (!text_take(t, "f")) value /= 360.0;
    if (!text_is_at_end(t)) return text_fail(t, "degrees such as 180 or frames such as 0.5f", err);
    if (fabs(value) > longest_frames) {
        return kl_fail(err, KL_ERR_USAGE, "%s \"%.60s\": more than %g frames", t->what, t->start,
                       longest_frames);
    }
    *out = value;
    return KL_OK;
}

kl_status kl_shutter_parse_length(const char *text, double *out, struct kl_err *err)
{
    struct text t = text_start("shutter", text);

    return read_frames(&t, false, out, err);
}

kl_status kl_shutter_parse_offset(const char *text, double *out, struct kl_err *err)
{
    struct text t = text_start("shutter offset", text);

    return read_frames(&t, true, out, err);
}

struct kl_interval kl_shutter_interval(const struct kl_shutter *shutter, struct kl_fps fps,
                                       int32_t frame)
{
    const double seconds = (double)fps.denominator / fps.numerator;
    const double centre = frame + shutter->offset;
    struct kl_interval interval;

    interval.reference = centre * seconds;
    interval.open = (centre - 0.5 * shutter->length) * seconds;
    interval.close = (centre + 0.5 * shutter->length) * seconds;
    return interval;
}
