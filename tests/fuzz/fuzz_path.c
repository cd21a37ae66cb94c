/* Any bytes as a camera path: what is accepted gives finite, usable poses at any time. */
#include "sequences/path.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check_pose(const struct kl_path *path, double time)
{
    struct kl_look pose;
    double view = 0.0;
    double up = 0.0;

    kl_path_evaluate(path, time, &pose);
    for (int i = 0; i < 3; ++i) {
        if (!isfinite(pose.eye[i]) || !isfinite(pose.target[i]) || !isfinite(pose.up[i])) abort();
        view += fabs(pose.target[i] - pose.eye[i]);
        up += pose.up[i] * pose.up[i];
    }
    if (!(view > 0.0) || fabs(up - 1.0) > 1e-6) abort();
    if (!(pose.yfov >= 0.0 && pose.yfov < 3.15)) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct kl_err err;
    struct kl_path *path = NULL;
    double first = 0.0;
    double last = 0.0;

    if (kl_path_parse((const char *)data, size, "fuzz", 24.0, &path, &err) != KL_OK) return 0;
    kl_path_range(path, &first, &last);
    for (int i = -1; i <= 9; ++i)
        check_pose(path, first + (last - first) * i / 8.0);
    kl_path_destroy(path);
    return 0;
}
