/* Shared by the EXR reader and writer; private to this folder. */
#ifndef KL_SRC_IMAGE_EXR_IMPL_H
#define KL_SRC_IMAGE_EXR_IMPL_H

#include "src/base/status.h"

#include <openexr.h>

/* The user data of an OpenEXR context: our file, and the first complaint of the library. */
struct exr_stream {
    int fd;
    int64_t size; /* of the file, reading only */
    char message[256];
};

/* A context initialiser whose file functions and error handler work on `stream`. */
exr_context_initializer_t exr_stream_setup(struct exr_stream *stream);

/* Turn a result of the library into a status; the complaint becomes the message. */
kl_status exr_stream_check(struct exr_stream *stream, exr_result_t result, kl_status otherwise,
                           struct kl_err *err) KL_MUST_CHECK;

#endif
