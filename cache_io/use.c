#include "cache_io/store_impl.h"
#include "cache_io/use_impl.h"
#include "src/base/file.h"
#include "src/base/file_calls.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct kl_use {
    int dir_fd;      /* borrowed */
    int64_t oldest;  /* files that were changed before are only asked for their generation */
    uint64_t *names; /* of the files that were read */
    size_t capacity;
    struct use_set set; /* of all; no bits: no file */
    struct kl_use_summary summary;
};

/* ---- reading ---- */

static void complain(struct kl_use *use, const char *name, const struct kl_err *why)
{
    if (use->summary.damaged++ > 0) return;
    (void)!snprintf(use->summary.complaint, sizeof use->summary.complaint, "%s: %.200s", name,
                    why->msg);
}

static kl_status take_set(struct kl_use *use, uint64_t hash, struct use_set *set, int64_t changed,
                          struct kl_err *err)
{
    struct kl_use_summary *sum = &use->summary;

    if (changed < use->oldest) {
        if (set->generation > sum->earlier) sum->earlier = set->generation;
        return KL_OK;
    }
    kl_status st =
        kl_grow_array(&use->names, &use->capacity, sum->files + 1, sizeof *use->names, err);
    if (st != KL_OK) return st;
    use->names[sum->files++] = hash;
    if (set->generation > sum->generation) sum->generation = set->generation;
    if (changed > sum->newest) sum->newest = changed;
    if (use->set.bits != NULL) return use_set_join(&use->set, set, err);
    use->set = *set;
    set->bits = NULL;
    return KL_OK;
}

static kl_status take_file(void *context, const char *name, struct kl_err *err)
{
    const size_t most = USE_HEAD_SIZE + USE_HASH_SIZE + ((size_t)1 << (USE_MOST_BITS - 3));
    struct kl_use *use = context;
    struct use_set set = {0};
    struct kl_err why;
    uint64_t hash = 0;
    int64_t changed = 0;
    char *data = NULL;
    size_t size = 0;

    if (!use_name_parse(name, &hash)) return KL_OK;
    kl_status st = kl_file_read_at(use->dir_fd, name, most, &data, &size, &changed, &why);
    if (st == KL_ERR_INPUT && why.os_error != 0) return KL_OK; /* another one took its place */
    if (st == KL_OK) st = use_parse(data, size, &hash, false, &set, &why);
    free(data);
    if (st == KL_ERR_NO_MEMORY) {
        *err = why;
        return st;
    }
    if (st != KL_OK) {
        complain(use, name, &why);
        return KL_OK;
    }
    st = take_set(use, hash, &set, changed, err);
    free(set.bits);
    return st;
}

/* Now, as the file system sees it: the time of a file that is made for it. */
static kl_status find_now(int dir_fd, int64_t *now, struct kl_err *err)
{
    struct kl_file_temp file;
    struct stat info;
    char name[USE_NAME_SIZE];

    use_name_format(0, name);
    kl_status st = kl_file_temp_open_at(dir_fd, name, &file, err);
    if (st != KL_OK) return st;
    if (kl_file_calls->stat(file.fd, &info) != 0) st = kl_fail_errno(err, "stat %s", name);
    kl_file_temp_discard(&file);
    *now = (int64_t)info.st_mtime;
    return st;
}

/* Segments that are older than asked for know what was there before, too. */
static void note_old_segments(const struct kl_store *store, struct kl_use *use)
{
    for (size_t i = 0; i < store->segments.count; ++i) {
        const struct segment *segment = &store->segments.items[i];
        struct stat info;
        const int fd = kl_file_open_at(store->dir_fd, segment->name, O_RDONLY | O_NONBLOCK);
        if (fd < 0) continue;
        if (kl_file_calls->stat(fd, &info) == 0 && (int64_t)info.st_mtime < use->oldest &&
            segment->id.generation > use->summary.earlier) {
            use->summary.earlier = segment->id.generation;
        }
        (void)kl_file_calls->close(fd);
    }
}

kl_status kl_use_load(const struct kl_store *store, int64_t max_age, struct kl_use **out,
                      struct kl_err *err)
{
    struct kl_use *use = NULL;
    int64_t now = 0;
    kl_status st = kl_alloc_array(&use, 1, sizeof *use, err);

    if (st != KL_OK) return st;
    use->dir_fd = store->dir_fd;
    use->oldest = INT64_MIN;
    if (max_age > 0) {
        st = find_now(store->dir_fd, &now, err);
        if (st == KL_OK) {
            use->oldest = now - max_age;
            note_old_segments(store, use);
        }
    }
    if (st == KL_OK) st = store_for_each_name(store->dir_fd, take_file, use, err);
    if (st != KL_OK) {
        kl_use_destroy(use);
        return st;
    }
    *out = use;
    return KL_OK;
}

void kl_use_destroy(struct kl_use *use)
{
    if (use == NULL) return;
    free(use->names);
    free(use->set.bits);
    free(use);
}

void kl_use_get_summary(const struct kl_use *use, struct kl_use_summary *out)
{
    *out = use->summary;
}

bool kl_use_has(const struct kl_use *use, const kl_record_hot *hot)
{
    return use->set.bits != NULL && use_set_has(&use->set, use_place(hot));
}

/* ---- telling ---- */

static kl_status make_set(const struct kl_store *store, const kl_record_hot *hot, uint32_t count,
                          const uint8_t *used, struct use_set *out, struct kl_err *err)
{
    *out = (struct use_set){.log2_bits = USE_LEAST_BITS, .generation = kl_store_generation(store)};
    while (((uint64_t)1 << out->log2_bits) < 8 * (uint64_t)count)
        ++out->log2_bits;
    kl_status st = kl_alloc_array(&out->bits, (size_t)1 << (out->log2_bits - 3), 1, err);
    for (uint32_t i = 0; st == KL_OK && i < count; ++i) {
        if (used[i] != 0) use_set_add(out, use_place(&hot[i]));
    }
    return st;
}

static kl_status write_set(int dir_fd, const struct use_set *set, uint64_t *hash,
                           struct kl_err *err)
{
    const size_t bits_size = (size_t)1 << (set->log2_bits - 3);
    const size_t size = USE_HEAD_SIZE + bits_size + USE_HASH_SIZE;
    struct kl_file_temp file;
    char name[USE_NAME_SIZE];
    unsigned char *data = NULL;
    kl_status st = kl_alloc_array(&data, size, 1, err);

    if (st != KL_OK) return st;
    memcpy(data + USE_MAGIC_AT, USE_MAGIC, 8);
    put_u16(data + USE_MAJOR_AT, USE_MAJOR);
    put_u32(data + USE_BITS_AT, set->log2_bits);
    put_u64(data + USE_GENERATION_AT, set->generation);
    put_u64(data + USE_RECORDS_AT, set->records);
    memcpy(data + USE_HEAD_SIZE, set->bits, bits_size);
    *hash = kl_hash_block(data, size - USE_HASH_SIZE);
    put_u64(data + size - USE_HASH_SIZE, *hash);
    use_name_format(*hash, name);
    st = kl_file_temp_open_at(dir_fd, name, &file, err);
    if (st == KL_OK) {
        st = kl_file_write_all(file.fd, data, size, err);
        if (st == KL_OK) {
            st = kl_file_temp_commit(&file, err);
        } else {
            kl_file_temp_discard(&file);
        }
    }
    free(data);
    return st;
}

/* What `known` read is in the file `hash` now. */
static void remove_joined(int dir_fd, const struct kl_use *known, uint64_t hash)
{
    for (size_t i = 0; i < known->summary.files; ++i) {
        char name[USE_NAME_SIZE];
        if (known->names[i] == hash) continue;
        use_name_format(known->names[i], name);
        (void)kl_file_calls->unlink_at(dir_fd, name); /* where it stays, it says nothing new */
    }
}

kl_status kl_use_publish(const struct kl_store *store, const kl_record_hot *hot, uint32_t count,
                         const uint8_t *used, struct kl_err *err)
{
    struct use_set set = {0};
    struct kl_use *known = NULL;
    uint64_t hash = 0;
    bool joins = false;
    kl_status st = make_set(store, hot, count, used, &set, err);

    if (st == KL_OK && set.records == 0) goto cleanup;
    if (st == KL_OK) st = kl_use_load(store, 0, &known, err);
    joins = st == KL_OK && known->summary.files >= USE_MOST_FILES;
    if (joins) st = use_set_join(&set, &known->set, err);
    if (st == KL_OK) st = write_set(store->dir_fd, &set, &hash, err);
    if (st == KL_OK && joins) remove_joined(store->dir_fd, known, hash);

cleanup:
    free(set.bits);
    kl_use_destroy(known);
    return st;
}
