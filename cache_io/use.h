/* What renders have used of a store, as far as they told: section 8 of docs/cache_format.md. Each
 * leaves a small file that says which records of level 0 served it, by their places, so that it
 * stays true whatever becomes of the segments. Nothing ever fails for want of such a file.
 *
 * Threads: one at a time. Processes: any number. */
#ifndef KL_CACHE_IO_USE_H
#define KL_CACHE_IO_USE_H

#include "cache_io/store.h"

struct kl_use;

/* Tell that records of level 0 served: used[i] is not 0 where record i of `hot` did. Nothing is
 * written where none did. The store may be open for reading; KL_ERR_IO where its folder cannot be
 * written to. */
kl_status kl_use_publish(const struct kl_store *store, const kl_record_hot *hot, uint32_t count,
                         const uint8_t *used, struct kl_err *err) KL_MUST_CHECK;

struct kl_use_summary {
    uint64_t files;      /* that were read */
    uint64_t generation; /* largest that one of them saw */
    int64_t newest;      /* when the newest was written [s since 1970], as its file says; 0: none */
    uint64_t earlier;    /* largest generation that a file older than asked for saw */
    uint64_t damaged;    /* files that were ignored */
    char complaint[256]; /* about the first of these; "": none */
};

/* Read what the store's folder holds; max_age [s]: nothing that was told longer ago, judged by the
 * file system's time alone; 0: all. A folder without such files gives an empty set. */
kl_status kl_use_load(const struct kl_store *store, int64_t max_age, struct kl_use **out,
                      struct kl_err *err) KL_MUST_CHECK;
void kl_use_destroy(struct kl_use *use); /* accepts NULL */
void kl_use_get_summary(const struct kl_use *use, struct kl_use_summary *out);
/* Has a record of level 0 served? In a few of 100 cases yes where none was told of. */
bool kl_use_has(const struct kl_use *use, const kl_record_hot *hot);

#endif
