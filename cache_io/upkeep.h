/* Looking after stores that lie there: repair, merge, prune. Others may read and extend a store
 * meanwhile; what they publish stays. */
#ifndef KL_CACHE_IO_UPKEEP_H
#define KL_CACHE_IO_UPKEEP_H

#include "cache_io/records.h"

struct kl_store_repaired {
    uint64_t rewritten;          /* segments, without their bad blocks */
    uint64_t removed;            /* files of which nothing could be used */
    struct kl_store_damage lost; /* what was found */
};
/* Replace damaged segments by what is whole of them; files that are foreign, or of another version,
 * stay. KL_ERR_CORRUPT: nothing at all is usable. */
kl_status kl_store_repair(const char *dir, struct kl_store_repaired *out,
                          struct kl_err *err) KL_MUST_CHECK;

struct kl_store_merged {
    uint64_t records[KL_CACHE_LEVELS]; /* now */
    uint64_t merged;                   /* that stood for the same place as a better one */
    uint64_t damaged;                  /* segments of the sources that were left out or in part */
};
/* Write the records of all sources to the new store `target`, as one base without octrees: the
 * first run that extends it indexes it. The order of the sources does not matter. KL_ERR_STALE:
 * they are not of one scene and settings; KL_ERR_USAGE: there is a cache at `target` already. */
kl_status kl_store_merge(const char *const *sources, size_t count, const char *target,
                         struct kl_store_merged *out, struct kl_err *err) KL_MUST_CHECK;

/* What is to go; zero: nothing. */
struct kl_store_prune {
    uint32_t older_than; /* records first written more than this many generations ago; 0: none */
    bool has_inside, has_outside;       /* records inside, outside a box */
    double inside[2][3], outside[2][3]; /* [m] world: least and largest corner */
    /* Records of level 0 that no render has told to have used (cache_io/use.h): ever, or for so
     * long [s] (0: ever). Those that came after the last render that told stay, and with
     * `unused_for` what may be younger. KL_ERR_INPUT: no render has told anything in that time. */
    bool unused;
    int64_t unused_for;
    uint64_t max_bytes; /* then the oldest, of these the worst, until the rest fits; 0: any size */
    kl_records_keep_fn keep; /* then those for which this says no; NULL: none */
    void *keep_context;
};
struct kl_store_pruned {
    uint64_t kept, dropped;
    bool untold;           /* `unused` was asked for, and no render has told what it used */
    uint64_t damaged_uses; /* files of use that were ignored */
    char complaint[256];   /* about the first; "": none */
};
/* Drop records, publish the rest as one base (nothing is written where none goes). */
kl_status kl_store_prune(const char *dir, const struct kl_store_prune *what,
                         struct kl_store_pruned *out, struct kl_err *err) KL_MUST_CHECK;

#endif
