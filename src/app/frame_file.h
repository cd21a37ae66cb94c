/* Image files: pixels with where they come from, and reading that back. */
#ifndef KL_SRC_APP_FRAME_FILE_H
#define KL_SRC_APP_FRAME_FILE_H

#include "sequences/plan.h"
#include "src/app/job.h"
#include "src/image/image.h"

/* An image with the layers of --aov, and those that the report needs. *out is the caller's. */
kl_status kl_frame_file_create(const struct kl_job *job, struct kl_image **out,
                               struct kl_err *err) KL_MUST_CHECK;
/* Write the layers of --aov with all attributes, and the preview if asked. `seconds`: rendering. */
struct kl_frame_file {
    size_t index; /* of the job's frames */
    const char *path, *fingerprint;
    double seconds;
};
kl_status kl_frame_file_write(const struct kl_job *job, const struct kl_frame_file *file,
                              struct kl_image *image, struct kl_err *err) KL_MUST_CHECK;
/* Mean of cache.error where records served; negative where none did. */
double kl_frame_file_error(const struct kl_image *image);
/* A kl_plan_reader. */
kl_status kl_frame_file_read(void *context, const char *path, bool *complete,
                             char text[KL_FINGERPRINT_SIZE], struct kl_err *err) KL_MUST_CHECK;

#endif
