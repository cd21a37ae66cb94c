/* Points and volumes as an OpenVDB file. The library takes a twentieth of a second to start, so it
 * is a module of its own, keeplight-vdb.so, that is loaded only where it is needed. */
#ifndef KL_SRC_IMPORT_VDB_WRITE_H
#define KL_SRC_IMPORT_VDB_WRITE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* `count` points; arrays are borrowed. */
struct kl_vdb_points {
    size_t count;
    const double *positions; /* 3 each [m], world space */
    const float *normals;    /* 3 each, unit */
    const float *irradiance; /* 3 each */
    const float *radius;     /* [m] */
    const float *error;      /* relative */
    const int32_t *level, *born;
    double voxel; /* [m] edge of a voxel, > 0 */
};

/* Writes to `path`, in place: points "records" with N, Cd (irradiance), pscale (radius), error,
 * level and born; volumes "density" (records a voxel), "irradiance" and "error" (means). Returns 0,
 * else `message` (of `size` bytes) says why not. Threads: one at a time. */
int kl_vdb_write(const char *path, const struct kl_vdb_points *points, char *message, size_t size);
typedef int (*kl_vdb_write_fn)(const char *path, const struct kl_vdb_points *points, char *message,
                               size_t size);

#ifdef __cplusplus
}
#endif
#endif
