#include "sequences/shutter.h"

#include "sequences/text_impl.h"

#include <math.h>
#include <string.h>

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

static void set_cosine(struct kl_shutter_curve *curve)
{
    enum { COUNT = 33 };
    curve->count = COUNT;
    for (int i = 0; i < COUNT; ++i) {
        curve->weights[i] = 0.5 - 0.5 * cos(2.0 * 3.14159265358979323846 * i / (COUNT - 1));
    }
}

kl_status kl_shutter_parse_curve(const char *text, struct kl_shutter_curve *out, struct kl_err *err)
{
    struct text t = text_start("shutter curve", text);
    struct kl_shutter_curve curve = {0};
    double sum = 0.0;

    if (strcmp(text, "cosine") == 0) set_cosine(&curve);
    if (strcmp(text, "triangle") == 0) curve = (struct kl_shutter_curve){3, {0.0, 1.0, 0.0}};
    if (strcmp(text, "box") == 0 || curve.count > 0) {
        *out = curve;
        return KL_OK;
    }
    do {
        if (curve.count == KL_SHUTTER_WEIGHTS) {
            return kl_fail(err, KL_ERR_USAGE, "shutter curve: more than %d weights",
                           KL_SHUTTER_WEIGHTS);
        }
        kl_status st = text_read_decimal(&t, false, &curve.weights[curve.count], err);
        if (st != KL_OK) return st;
        sum += curve.weights[curve.count++];
    } while (text_take(&t, ","));
    if (!text_is_at_end(&t)) {
        return text_fail(&t, "box, triangle, cosine or weights such as 0,1,1,0", err);
    }
    if (curve.count < 2 || !(sum > 0.0) || !isfinite(sum)) {
        return kl_fail(err, KL_ERR_USAGE,
                       "shutter curve \"%.60s\": expected 2 or more weights, not "
                       "all 0",
                       text);
    }
    *out = curve;
    return KL_OK;
}

double kl_shutter_curve_time(const struct kl_shutter_curve *curve, double u)
{
    const double *w = curve->weights;
    double total = 0.0;

    if (curve->count < 2) return u;
    for (uint32_t i = 0; i + 1 < curve->count; ++i) {
        total += 0.5 * (w[i] + w[i + 1]);
    }
    double left = fmin(fmax(u, 0.0), 1.0) * total;
    uint32_t i = 0;
    /* While it is closed no light gets in: the first light comes behind that. */
    for (; i + 2 < curve->count; ++i) {
        const double area = 0.5 * (w[i] + w[i + 1]);
        if (area > 0.0 && left <= area) break;
        left -= area;
    }
    /* Within the span the area up to x is w0 x + (w1 - w0) x^2 / 2. */
    const double slope = w[i + 1] - w[i];
    const double root = sqrt(fmax(0.0, w[i] * w[i] + 2.0 * slope * left));
    const double x = w[i] + root > 0.0 ? 2.0 * left / (w[i] + root) : 0.0;
    return ((double)i + fmin(x, 1.0)) / (double)(curve->count - 1);
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
