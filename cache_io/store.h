/* The cache on disk: a directory of immutable segments (docs/cache_format.md).
 *
 * A base segment holds the sorted records and the octree of every level; delta segments hold
 * batches of records that came later. Segments are published by write, fsync, rename, fsync of the
 * directory and never change afterwards, so readers need no lock and a killed writer loses at most
 * the batch in flight.
 *
 * Threads: a store may be used by one thread at a time. Processes: any number may read and append;
 * publishing a base replaces only the segments that it was made from. */
#ifndef KL_CACHE_IO_STORE_H
#define KL_CACHE_IO_STORE_H

#include "kernels/cache_data.h"
#include "kernels/parts.h"
#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct kl_store;

enum { KL_DIGEST_SIZE = 16 };

/* What the records depend on. Another key is another cache. */
struct kl_store_key {
    uint8_t scene[KL_DIGEST_SIZE]; /* geometry, materials, lights, environment at one instant */
    uint8_t
        settings[KL_DIGEST_SIZE]; /* options that change irradiance, and the algorithm version */
    double origin[3];             /* [m] world position of render space's origin */
};

enum kl_store_mode {
    KL_STORE_READ,    /* nothing is written; the directory must exist */
    KL_STORE_EXTEND,  /* created where absent */
    KL_STORE_REVISE,  /* as EXTEND; segments of another key are left out, until the next base that
                       * this store publishes supersedes them */
    KL_STORE_REBUILD, /* as EXTEND; segments there are removed first, whatever their key */
};

/* What is missing from what the files once held. */
struct kl_store_damage {
    uint64_t segments; /* files of which nothing can be used */
    uint64_t foreign;  /* files that are whole but of another key */
    uint64_t headers;  /* segments with one of two headers lost, or of a wrong size */
    uint64_t blocks;   /* whose checksum or records are bad */
    uint64_t octrees;  /* left out for a bad block in them or their records; rebuilt when needed */
    uint64_t records[KL_CACHE_LEVELS]; /* lost with their blocks */
};

struct kl_store_segment_info {
    char name[64];
    char program[40]; /* that wrote it */
    uint64_t bytes, generation;
    bool is_base, has_octree[KL_CACHE_LEVELS];
    uint32_t records[KL_CACHE_LEVELS];
    /* The generation that each record was first written in; NULL: all in `born`. */
    const uint32_t *births[KL_CACHE_LEVELS];
    uint32_t born;
    struct kl_store_damage damage;
};

/* Open or create `dir`. `key` NULL (READ only): take the key of the newest segment, leave out those
 * of other keys. KL_ERR_STALE: no segment is of the key; the message says which part differs. Where
 * some are, those of another scene only are left out in silence: two editions of a scene share the
 * directory. Damaged blocks and segments of other settings are left out too, and counted in
 * kl_store_damaged. Every block was checked against its checksum, every record and octree for
 * soundness. KL_ERR_CORRUPT only where nothing is usable. KL_ERR_VERSION: written by another major
 * version. *out is the caller's: kl_store_close. */
kl_status kl_store_open(const char *dir, enum kl_store_mode mode, const struct kl_store_key *key,
                        struct kl_store **out, struct kl_err *err) KL_MUST_CHECK;
void kl_store_close(struct kl_store *store); /* accepts NULL */

/* Pick up segments that others have published. *changed: the list is another one, and arrays of
 * segments that are no longer in it are invalid; get all anew. On failure nothing has changed. A
 * run whose cache is frozen does not call it. */
kl_status kl_store_refresh(struct kl_store *store, bool *changed, struct kl_err *err) KL_MUST_CHECK;

/* Segments in the order in which they are to be read: the base (if any) first, then deltas by
 * generation and name. Level arrays of segment i. Every record was validated. */
size_t kl_store_segment_count(const struct kl_store *store);
void kl_store_segment_get(const struct kl_store *store, size_t i,
                          struct kl_store_segment_info *info,
                          struct kl_level_arrays levels[KL_CACHE_LEVELS]);
void kl_store_key_get(const struct kl_store *store, struct kl_store_key *key);
/* The parts of the scene that the segments were made for, borrowed until the store changes; NULL
 * and 0 where no segment lists them. */
const kl_part *kl_store_parts_get(const struct kl_store *store, uint32_t *count);
/* Parts to write: in every base, and in the first other segment of a directory that has none yet.
 * Copied. */
kl_status kl_store_parts_set(struct kl_store *store, const kl_part *parts, uint32_t count,
                             struct kl_err *err) KL_MUST_CHECK;
uint64_t kl_store_generation(const struct kl_store *store); /* +1 per published segment */
uint64_t kl_store_bytes(const struct kl_store *store);
/* Number of segments left out, in whole or in part, because they are damaged or foreign; text of
 * the first complaint (NULL: none). */
size_t kl_store_damaged(const struct kl_store *store, const char **first);
void kl_store_get_damage(const struct kl_store *store, struct kl_store_damage *out);

/* Append a batch: records[l] holds the new records of level l (octree ignored). The batch is on
 * disk when this returns KL_OK. The new segment also appears at the end of this store's list.
 * Content decides the file name, so the same batches give the same files. */
kl_status kl_store_append(struct kl_store *store,
                          const struct kl_level_arrays records[KL_CACHE_LEVELS],
                          struct kl_err *err) KL_MUST_CHECK;

/* Publish one base segment with these records and octrees in place of all segments of this store's
 * list, which are then removed (others that appeared meanwhile stay). Arrays that were borrowed
 * from the store are invalid afterwards: get them anew. */
kl_status kl_store_publish_base(struct kl_store *store,
                                const struct kl_level_arrays levels[KL_CACHE_LEVELS],
                                struct kl_err *err) KL_MUST_CHECK;

/* Is this record sound? Finite, irr >= 0, 0 < radius <= radius2, raw_radius > 0, level in range. */
bool kl_record_is_valid(const kl_record_hot *hot, const kl_record_cold *cold);

#endif
