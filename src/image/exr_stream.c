#include "src/image/exr_impl.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static struct exr_stream *stream_get(exr_const_context_t context)
{
    void *data = NULL;

    if (exr_get_user_data(context, &data) != EXR_ERR_SUCCESS) return NULL;
    return data;
}

/* The first complaint is the cause; later ones are its consequences. */
static void keep_message(exr_const_context_t context, exr_result_t code, const char *text)
{
    struct exr_stream *stream = context != NULL ? stream_get(context) : NULL;

    (void)code;
    if (stream == NULL || stream->message[0] != '\0') return;
    (void)!snprintf(stream->message, sizeof stream->message, "%s", text != NULL ? text : "");
}

static int64_t read_at(exr_const_context_t context, void *data, void *buffer, uint64_t size,
                       uint64_t offset, exr_stream_error_func_ptr_t complain)
{
    const struct exr_stream *stream = data;
    uint64_t done = 0;

    while (done < size) {
        const ssize_t n =
            pread(stream->fd, (char *)buffer + done, (size_t)(size - done), (off_t)(offset + done));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) {
            (void)complain(context, EXR_ERR_READ_IO, "read error %d", errno);
            return -1;
        }
        if (n == 0) break;
        done += (uint64_t)n;
    }
    return (int64_t)done;
}

static int64_t write_at(exr_const_context_t context, void *data, const void *buffer, uint64_t size,
                        uint64_t offset, exr_stream_error_func_ptr_t complain)
{
    const struct exr_stream *stream = data;
    uint64_t done = 0;

    while (done < size) {
        const ssize_t n = pwrite(stream->fd, (const char *)buffer + done, (size_t)(size - done),
                                 (off_t)(offset + done));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) {
            char text[128];
            if (strerror_r(errno, text, sizeof text) != 0) text[0] = '\0';
            (void)complain(context, EXR_ERR_WRITE_IO, "write: %s", text);
            return -1;
        }
        done += (uint64_t)n;
    }
    return (int64_t)done;
}

static int64_t size_get(exr_const_context_t context, void *data)
{
    const struct exr_stream *stream = data;

    (void)context;
    return stream->size;
}

exr_context_initializer_t exr_stream_setup(struct exr_stream *stream)
{
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;

    setup.user_data = stream;
    setup.error_handler_fn = keep_message;
    setup.read_fn = read_at;
    setup.write_fn = write_at;
    setup.size_fn = size_get;
    return setup;
}

kl_status exr_stream_check(struct exr_stream *stream, exr_result_t result, kl_status otherwise,
                           struct kl_err *err)
{
    if (result == EXR_ERR_SUCCESS) return KL_OK;
    if (result == EXR_ERR_OUT_OF_MEMORY) otherwise = KL_ERR_NO_MEMORY;
    if (stream->message[0] != '\0') return kl_fail(err, otherwise, "%s", stream->message);
    return kl_fail(err, otherwise, "%s", exr_get_default_error_message(result));
}
