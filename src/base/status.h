#ifndef KL_SRC_BASE_STATUS_H
#define KL_SRC_BASE_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

/* Explicit values, never renumbered. src/app maps them to the exit codes of docs/errors.md. */
typedef enum kl_status {
    KL_OK = 0,
    KL_ERR_USAGE = 2,   /* the caller's fault: bad option, bad argument */
    KL_ERR_INPUT = 3,   /* scene, sequence or image unreadable or invalid */
    KL_ERR_IO = 4,      /* the system refused a read, write, sync or rename */
    KL_ERR_CORRUPT = 5, /* a cache file fails its checksum or its invariants */
    KL_ERR_VERSION = 6, /* a valid file of a format we do not write or read */
    KL_ERR_NO_MEMORY = 7,
    KL_ERR_DEVICE = 8,       /* OpenCL or Embree reported a failure */
    KL_ERR_STALE = 9,        /* a valid cache, but of another scene or algorithm */
    KL_ERR_INTERRUPTED = 10, /* asked to stop; what was committed can be resumed */
    KL_ERR_LIMIT = 11,       /* a time or error limit was reached */
} kl_status;

/* One per thread of work, on the caller's stack; no allocation, so it works when memory is out. */
struct kl_err {
    kl_status status;
    int os_error;  /* errno value, 0 if none */
    char msg[512]; /* outermost context first: "a.gltf: mesh 3: index 70 >= 64 vertices" */
};

#define KL_MUST_CHECK   __attribute__((warn_unused_result))
#define KL_PRINTF(f, a) __attribute__((format(printf, f, a)))

/* Record a failure; returns `status` so that a caller can write `return kl_fail(...)`. */
kl_status kl_fail(struct kl_err *err, kl_status status, const char *fmt, ...) KL_PRINTF(3, 4);
/* The same with errno, read before anything else can change it. */
kl_status kl_fail_errno(struct kl_err *err, const char *fmt, ...) KL_PRINTF(2, 3);
/* Put "context: " before the message on the way up. */
kl_status kl_wrap(struct kl_err *err, const char *fmt, ...) KL_PRINTF(2, 3);

#ifdef __cplusplus
}
#endif
#endif
