/* What the files of this folder share about an open store. */
#ifndef KL_CACHE_IO_STORE_IMPL_H
#define KL_CACHE_IO_STORE_IMPL_H

#include "cache_io/format_impl.h"

enum reject_why {
    REJECT_DAMAGED, /* beyond use */
    REJECT_UNREAD,  /* perhaps whole, but the system did not let us read it */
    REJECT_VERSION, /* perhaps whole, but of another version of the format */
    REJECT_FOREIGN, /* whole, but of another key */
};

/* A file of the directory that is left out. */
struct store_reject {
    struct segment_id id;
    enum reject_why why;
    char message[512];
};

struct id_list {
    size_t count, capacity;
    struct segment_id *ids;
};

struct segment_list {
    size_t count, capacity;
    struct segment *items;
};

struct kl_store {
    int dir_fd;
    enum kl_store_mode mode;
    bool broken; /* a write failed: what the directory holds is not what we believe */
    bool has_key;
    struct kl_store_key key;
    uint64_t generation;
    struct segment_list segments; /* in reading order */
    struct id_list leftovers;     /* superseded, still there: the next base removes them too */
    struct id_list listed;        /* the directory when it was last read */
    size_t reject_count, reject_capacity;
    struct store_reject *rejects;
    kl_part *parts; /* to be written */
    uint32_t part_count;
    char complaint[512]; /* first damage; "": none */
};

/* The segments of the directory, sorted. */
kl_status store_list(int dir_fd, struct id_list *out, struct kl_err *err) KL_MUST_CHECK;
/* Call `visit` for every name in the directory until it fails. */
kl_status store_for_each_name(int dir_fd,
                              kl_status (*visit)(void *context, const char *name,
                                                 struct kl_err *err),
                              void *context, struct kl_err *err) KL_MUST_CHECK;
/* Open what the directory holds; segments that are open already stay as they are. On failure the
 * store is as it was. */
kl_status store_load(struct kl_store *store, struct kl_err *err) KL_MUST_CHECK;
/* Section 5 of the format: which segments are in use, and in which order. The others are closed and
 * added to `leftovers`. */
kl_status store_arrange(struct segment_list *segments, struct id_list *leftovers,
                        struct kl_err *err) KL_MUST_CHECK;
/* KL_ERR_STALE: the message says which part of the key differs. */
kl_status store_check_key(const struct kl_store_key *have, const struct kl_store_key *want,
                          const char *name, struct kl_err *err) KL_MUST_CHECK;
void segment_list_fini(struct segment_list *list);
bool segment_is_damaged(const struct segment *segment);
/* KL_ERR_IO: a segment could not be read this time. Who would judge a store as a whole stops here:
 * what such a segment holds, or supersedes, is not known. */
kl_status store_check_read(const struct kl_store *store, struct kl_err *err) KL_MUST_CHECK;
/* Open to write with the key of what is there; all of it was read. */
kl_status store_open_found(const char *dir, struct kl_store **out,
                           struct kl_err *err) KL_MUST_CHECK;

/* Publish one base with these levels (births: NULL, or as the format has them) in place of the
 * segments `old` (sorted here), and remove them. The store's list is not touched: store_load. */
kl_status store_replace(struct kl_store *store, struct id_list *old,
                        const struct kl_level_arrays levels[KL_CACHE_LEVELS],
                        const uint32_t *const births[KL_CACHE_LEVELS], struct segment *out,
                        struct kl_err *err) KL_MUST_CHECK;
/* births[l][i]: the generation that record i of levels[l] was first written in, judged by the
 * store's segments: `next` where none has it. Free each. */
kl_status store_find_births(const struct kl_store *store,
                            const struct kl_level_arrays levels[KL_CACHE_LEVELS], uint32_t next,
                            uint32_t *births[KL_CACHE_LEVELS], struct kl_err *err) KL_MUST_CHECK;

#endif
