#include "src/app/flight.h"

#include "sequences/path.h"
#include "sequences/turntable.h"
#include "src/base/memory.h"

#include <stdlib.h>
#include <string.h>

static const double elevation = 0.35; /* [rad], 20 degrees: tops and sides are both seen */

struct kl_flight {
    struct kl_turntable turntable; /* if path is NULL */
    struct kl_path *path;
    double fps, yfov;
};

kl_status kl_flight_create_orbit(const struct kl_flight_orbit *orbit, struct kl_flight **out,
                                 struct kl_err *err)
{
    struct kl_turntable turntable = {.radius = orbit->radius,
                                     .yfov = orbit->yfov,
                                     .aspect = orbit->aspect,
                                     .elevation = elevation,
                                     .start = orbit->start,
                                     .count = orbit->count};
    struct kl_flight *flight = NULL;

    memcpy(turntable.centre, orbit->center, sizeof turntable.centre);
    kl_status st = kl_turntable_check(&turntable, err);
    if (st == KL_OK) st = kl_alloc_array(&flight, 1, sizeof *flight, err);
    if (st != KL_OK) return st;
    flight->turntable = turntable;
    flight->yfov = orbit->yfov;
    *out = flight;
    return KL_OK;
}

kl_status kl_flight_create_path(const char *file, double fps, double yfov, struct kl_flight **out,
                                struct kl_err *err)
{
    struct kl_path *path = NULL;
    struct kl_flight *flight = NULL;
    kl_status st = kl_path_load(file, fps, &path, err);

    if (st == KL_OK) st = kl_alloc_array(&flight, 1, sizeof *flight, err);
    if (st != KL_OK) {
        kl_path_destroy(path);
        return st;
    }
    *flight = (struct kl_flight){.path = path, .fps = fps, .yfov = yfov};
    *out = flight;
    return KL_OK;
}

void kl_flight_destroy(struct kl_flight *flight)
{
    if (flight == NULL) return;
    kl_path_destroy(flight->path);
    free(flight);
}

void kl_flight_get_view(const struct kl_flight *flight, int64_t frame, double fraction,
                        struct kl_look *out)
{
    if (flight->path != NULL) {
        kl_path_evaluate(flight->path, ((double)frame + fraction) / flight->fps, out);
    } else {
        kl_turntable_pose(&flight->turntable, frame - 1, fraction, out);
    }
    if (!(out->yfov > 0.0)) out->yfov = flight->yfov;
}

void kl_flight_get_range(const struct kl_flight *flight, double *first, double *last)
{
    kl_path_range(flight->path, first, last);
}
