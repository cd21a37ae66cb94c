#include "sequences/turntable.h"

#include <math.h>
#include <stdbool.h>

static const double pi = 3.14159265358979323846;

kl_status kl_turntable_check(const struct kl_turntable *t, struct kl_err *err)
{
    bool finite = isfinite(t->start);

    for (int i = 0; i < 3; ++i)
        finite = finite && isfinite(t->centre[i]);
    if (!finite) return kl_fail(err, KL_ERR_USAGE, "turntable: centre or start is not finite");
    if (!isfinite(t->radius) || !(t->radius > 0.0)) {
        return kl_fail(err, KL_ERR_USAGE, "turntable: radius %g is not above 0", t->radius);
    }
    if (!(t->yfov > 0.0 && t->yfov < pi) || !(t->aspect > 0.0 && t->aspect < 1e6)) {
        return kl_fail(err, KL_ERR_USAGE, "turntable: field of view %g or aspect %g out of range",
                       t->yfov, t->aspect);
    }
    if (!(fabs(t->elevation) < 0.5 * pi)) {
        return kl_fail(err, KL_ERR_USAGE, "turntable: elevation %g is not within a right angle",
                       t->elevation);
    }
    if (t->count == 0) return kl_fail(err, KL_ERR_USAGE, "turntable: 0 frames");
    return KL_OK;
}

void kl_turntable_pose(const struct kl_turntable *t, int64_t index, double fraction,
                       struct kl_look *out)
{
    const int64_t count = (int64_t)t->count;
    const double k = (double)((index % count + count) % count) + fraction;
    const double azimuth = t->start + 2.0 * pi * k / (double)count;
    /* The sphere touches the nearer pair of the picture's edges. */
    const double half_y = 0.5 * t->yfov;
    const double half_x = atan(t->aspect * tan(half_y));
    const double distance = t->radius / sin(fmin(half_x, half_y));
    const double level = distance * cos(t->elevation);

    out->eye[0] = t->centre[0] + level * sin(azimuth);
    out->eye[1] = t->centre[1] + distance * sin(t->elevation);
    out->eye[2] = t->centre[2] + level * cos(azimuth);
    for (int i = 0; i < 3; ++i) {
        out->target[i] = t->centre[i];
        out->up[i] = i == 1 ? 1.0 : 0.0;
    }
    out->yfov = t->yfov;
}
