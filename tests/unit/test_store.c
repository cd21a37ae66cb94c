/* The cache on disk. Numbers refer to the invariants of docs/cache_format.md. */
#include "cache_io/format_impl.h"
#include "src/base/file.h"
#include "src/base/hash.h"

#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

enum { RECORDS = 7, NODES = 1 + 8 + 8, ROWS = 5 };

/* Two levels of records; level 0 has an octree. */
struct batch {
    kl_record_hot hot[KL_CACHE_LEVELS][RECORDS];
    kl_record_cold cold[KL_CACHE_LEVELS][RECORDS];
    kl_u32 nodes[NODES];
    kl_u32 rows[ROWS];
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
};

struct fixture {
    char root[32], dir[64];
    struct kl_store_key key;
    struct batch batch;
};

static void make_batch(struct batch *b, float seed)
{
    memset(b, 0, sizeof *b);
    for (kl_u32 l = 0; l < KL_CACHE_LEVELS; ++l) {
        for (kl_u32 i = 0; i < RECORDS; ++i) {
            kl_record_hot *hot = &b->hot[l][i];
            kl_record_cold *cold = &b->cold[l][i];
            hot->pos[0] = seed + (float)i;
            hot->radius = 0.5f;
            hot->radius2 = 0.75f;
            hot->form = l << 20 | (i & 0xfffu);
            hot->object = KL_NONE;
            cold->irr[1] = 1.0f + (float)i;
            cold->raw_radius = 1.0f;
            cold->touched[0] = i * 77u;
        }
        b->levels[l].record_count = RECORDS - l;
        b->levels[l].hot = b->hot[l];
        b->levels[l].cold = b->cold[l];
    }
    /* Two rows: records 0, 1, 2 and 5, 6. The root divides by octants, one of these by faces. */
    const kl_u32 rows[ROWS] = {0, 1, 2 | KL_ROW_LAST, 5, 6 | KL_ROW_LAST};
    memcpy(b->rows, rows, sizeof rows);
    memset(b->nodes, 0, sizeof b->nodes);
    b->nodes[0] = 1;
    b->nodes[1 + 2] = KL_NODE_LEAF;
    b->nodes[1 + 7] = KL_NODE_FACES | 9;
    b->nodes[9 + 5] = KL_NODE_LEAF | 3;
    b->levels[0].octree = (kl_octree_header){.side = 4.0f,
                                             .node_count = NODES,
                                             .row_size = ROWS,
                                             .record_count = RECORDS,
                                             .reach = 1.0f};
    b->levels[0].nodes = b->nodes;
    b->levels[0].rows = b->rows;
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);

    assert_non_null(f);
    strcpy(f->root, "/tmp/kl_store_XXXXXX");
    assert_non_null(mkdtemp(f->root));
    (void)snprintf(f->dir, sizeof f->dir, "%s/a.klc", f->root);
    memset(f->key.scene, 0xab, sizeof f->key.scene);
    memset(f->key.settings, 0xcd, sizeof f->key.settings);
    f->key.origin[2] = 12.5;
    make_batch(&f->batch, 0.0f);
    *state = f;
    return 0;
}

static size_t for_each_file(const char *path, bool remove_them)
{
    char name[400];
    size_t n = 0;
    DIR *dir = opendir(path);

    if (dir == NULL) return 0;
    for (const struct dirent *e = readdir(dir); e != NULL; e = readdir(dir)) {
        if (strcmp(e->d_name, ".") == 0 || strcmp(e->d_name, "..") == 0) continue;
        (void)snprintf(name, sizeof name, "%s/%s", path, e->d_name);
        if (remove_them) (void)unlink(name);
        ++n;
    }
    (void)closedir(dir);
    return n;
}

static int teardown(void **state)
{
    struct fixture *f = *state;

    (void)for_each_file(f->dir, true);
    (void)rmdir(f->dir);
    assert_int_equal(rmdir(f->root), 0);
    free(f);
    return 0;
}

static struct kl_store *open_store(const struct fixture *f, enum kl_store_mode mode)
{
    struct kl_err err;
    struct kl_store *store = NULL;
    const kl_status st =
        kl_store_open(f->dir, mode, mode == KL_STORE_READ ? NULL : &f->key, &store, &err);

    if (st != KL_OK) fail_msg("%s", err.msg);
    return store;
}

static void append(struct kl_store *store, float seed)
{
    struct kl_err err;
    struct batch b;

    make_batch(&b, seed);
    if (kl_store_append(store, b.levels, &err) != KL_OK) fail_msg("%s", err.msg);
}

static void check_segment(const struct kl_store *store, size_t i, const struct batch *want,
                          bool with_octree)
{
    struct kl_level_arrays got[KL_CACHE_LEVELS];
    struct kl_store_segment_info info;

    kl_store_segment_get(store, i, &info, got);
    assert_int_equal(info.is_base, with_octree);
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        const uint32_t n = want->levels[l].record_count;
        assert_int_equal(got[l].record_count, n);
        assert_int_equal(info.records[l], n);
        assert_memory_equal(got[l].hot, want->hot[l], n * sizeof(kl_record_hot));
        assert_memory_equal(got[l].cold, want->cold[l], n * sizeof(kl_record_cold));
        assert_int_equal((uintptr_t)got[l].hot % 64, 0);
    }
    assert_int_equal(got[0].octree.record_count, with_octree ? RECORDS : 0);
    if (!with_octree) return;
    assert_memory_equal(&got[0].octree, &want->levels[0].octree, sizeof got[0].octree);
    assert_memory_equal(got[0].nodes, want->nodes, sizeof want->nodes);
    assert_memory_equal(got[0].rows, want->rows, sizeof want->rows);
}

static void batches_come_back(void **state)
{
    struct fixture *f = *state;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);
    struct batch second;
    struct kl_store_key key;

    make_batch(&second, 100.0f);
    append(store, 0.0f);
    append(store, 100.0f);
    assert_int_equal(kl_store_generation(store), 2);
    check_segment(store, 1, &second, false);
    kl_store_close(store);
    store = open_store(f, KL_STORE_READ);
    assert_int_equal(kl_store_segment_count(store), 2);
    assert_int_equal(kl_store_generation(store), 2);
    assert_int_equal(kl_store_damaged(store, NULL), 0);
    check_segment(store, 0, &f->batch, false);
    check_segment(store, 1, &second, false);
    kl_store_key_get(store, &key);
    assert_memory_equal(&key, &f->key, sizeof key);
    struct kl_err err;
    assert_int_equal(kl_store_append(store, second.levels, &err), KL_ERR_USAGE);
    kl_store_close(store);
}

static void a_base_replaces_what_it_was_made_from(void **state) /* 5 */
{
    struct fixture *f = *state;
    struct kl_err err;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);

    append(store, 1.0f);
    append(store, 2.0f);
    struct kl_store *other = open_store(f, KL_STORE_EXTEND);
    append(other, 3.0f); /* unknown to `store`: stays */
    assert_int_equal(kl_store_publish_base(store, f->batch.levels, &err), KL_OK);
    assert_int_equal(kl_store_segment_count(store), 1);
    check_segment(store, 0, &f->batch, true);
    append(store, 4.0f);
    kl_store_close(store);
    kl_store_close(other);
    store = open_store(f, KL_STORE_READ);
    assert_int_equal(kl_store_segment_count(store), 3);
    check_segment(store, 0, &f->batch, true);
    kl_store_close(store);
    assert_int_equal(for_each_file(f->dir, false), 3);
}

/* Path of the only file of a kind ('b' or 'd') in the cache. */
static void find_file(const struct fixture *f, char kind, char *path, size_t size)
{
    DIR *dir = opendir(f->dir);

    assert_non_null(dir);
    path[0] = '\0';
    for (const struct dirent *e = readdir(dir); e != NULL; e = readdir(dir)) {
        if (e->d_name[0] == kind) (void)snprintf(path, size, "%s/%s", f->dir, e->d_name);
    }
    (void)closedir(dir);
    assert_true(path[0] != '\0');
}

static void superseded_leftovers_are_ignored_and_removed_later(void **state) /* 6 */
{
    struct fixture *f = *state;
    struct kl_err err;
    char path[400];
    char *bytes = NULL;
    size_t size = 0;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);

    append(store, 1.0f);
    find_file(f, 'd', path, sizeof path);
    assert_int_equal(kl_file_read(path, 1 << 20, &bytes, &size, &err), KL_OK);
    assert_int_equal(kl_store_publish_base(store, f->batch.levels, &err), KL_OK);
    kl_store_close(store);
    assert_int_equal(kl_file_replace(path, bytes, size, &err), KL_OK); /* as after a crash */
    store = open_store(f, KL_STORE_EXTEND);
    assert_int_equal(kl_store_segment_count(store), 1);
    check_segment(store, 0, &f->batch, true);
    assert_int_equal(for_each_file(f->dir, false), 2);
    assert_int_equal(kl_store_publish_base(store, f->batch.levels, &err), KL_OK);
    kl_store_close(store);
    assert_int_equal(for_each_file(f->dir, false), 1);

    /* A damaged base supersedes nothing. */
    assert_int_equal(kl_file_replace(path, bytes, size, &err), KL_OK);
    free(bytes);
    find_file(f, 'b', path, sizeof path);
    assert_int_equal(truncate(path, 500), 0);
    store = open_store(f, KL_STORE_READ);
    assert_int_equal(kl_store_segment_count(store), 1);
    assert_int_equal(kl_store_damaged(store, NULL), 1);
    kl_store_close(store);
}

static void make_parts(kl_part parts[2])
{
    memset(parts, 0, 2 * sizeof *parts);
    parts[0].name[0] = 5;
    parts[0].box_max[1] = 2.0f;
    strcpy(parts[0].label, "ball");
    parts[1].kind = KL_PART_SETTINGS;
    strcpy(parts[1].label, "64 rays");
}

static void check_parts(const struct fixture *f, const kl_part *wanted)
{
    struct kl_store *store = NULL;
    struct kl_err err;
    uint32_t count = 99;

    assert_int_equal(kl_store_open(f->dir, KL_STORE_READ, NULL, &store, &err), KL_OK);
    const kl_part *found = kl_store_parts_get(store, &count);
    assert_int_equal(count, 2);
    assert_memory_equal(found, wanted, 2 * sizeof *wanted);
    kl_store_close(store);
}

/* The parts of the scene come with the first segment, once, and with every base; who opens a cache
 * without knowing the scene hands them on. */
static void parts_are_kept(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    kl_part parts[2];
    uint32_t count = 99;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);

    make_parts(parts);
    assert_null(kl_store_parts_get(store, &count));
    assert_int_equal(count, 0);
    assert_int_equal(kl_store_parts_set(store, parts, 2, &err), KL_OK);
    assert_int_equal(kl_store_append(store, f->batch.levels, &err), KL_OK);
    check_parts(f, parts);
    const uint64_t first = kl_store_bytes(store);
    make_batch(&f->batch, 100.0f);
    assert_int_equal(kl_store_append(store, f->batch.levels, &err), KL_OK);
    assert_true(kl_store_bytes(store) - first < first);
    kl_store_close(store);

    store = open_store(f, KL_STORE_EXTEND);
    assert_int_equal(kl_store_publish_base(store, f->batch.levels, &err), KL_OK);
    assert_int_equal(kl_store_segment_count(store), 1);
    kl_store_close(store);
    check_parts(f, parts);
}

static void unsound_parts_are_refused(void **state)
{
    struct kl_err err;
    kl_part parts[2];
    (void)state;

    make_parts(parts);
    assert_int_equal(parts_validate(parts, 2, &err), KL_OK);
    assert_int_equal(parts_validate(parts, KL_PARTS_MAX + 1, &err), KL_ERR_CORRUPT);
    parts[1].kind = KL_PART_KINDS;
    assert_int_equal(parts_validate(parts, 2, &err), KL_ERR_CORRUPT);
    make_parts(parts);
    parts[0].box_min[0] = NAN;
    assert_int_equal(parts_validate(parts, 2, &err), KL_ERR_CORRUPT);
    make_parts(parts);
    parts[0].box_min[1] = 3.0f;
    assert_int_equal(parts_validate(parts, 2, &err), KL_ERR_CORRUPT);
    make_parts(parts);
    memset(parts[0].label, 'x', sizeof parts[0].label);
    assert_int_equal(parts_validate(parts, 2, &err), KL_ERR_CORRUPT);
    make_parts(parts);
    parts[0].label[1] = '\n';
    assert_int_equal(parts_validate(parts, 2, &err), KL_ERR_CORRUPT);
}

/* A revision takes nothing from another edition of the scene and replaces it with its first base;
 * until then both editions lie there, and each reader finds its own. */
static void two_editions_share_a_directory(void **state)
{
    struct fixture *f = *state;
    struct kl_store_key edited = f->key;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);
    struct kl_store *other = NULL;
    struct kl_err err;

    assert_int_equal(kl_store_append(store, f->batch.levels, &err), KL_OK);
    kl_store_close(store);
    edited.scene[0] ^= 1;
    assert_int_equal(kl_store_open(f->dir, KL_STORE_EXTEND, &edited, &other, &err), KL_ERR_STALE);
    assert_int_equal(kl_store_open(f->dir, KL_STORE_REVISE, &edited, &other, &err), KL_OK);
    assert_int_equal(kl_store_segment_count(other), 0);
    assert_int_equal(kl_store_append(other, f->batch.levels, &err), KL_OK);
    assert_int_equal(for_each_file(f->dir, false), 2);
    store = open_store(f, KL_STORE_READ);
    assert_int_equal(kl_store_segment_count(store), 1);
    kl_store_close(store);
    assert_int_equal(kl_store_open(f->dir, KL_STORE_READ, NULL, &store, &err), KL_OK);
    struct kl_store_key newest;
    kl_store_key_get(store, &newest);
    assert_memory_equal(&newest, &edited, sizeof edited);
    assert_int_equal(kl_store_segment_count(store), 1);
    kl_store_close(store);
    assert_int_equal(kl_store_publish_base(other, f->batch.levels, &err), KL_OK);
    kl_store_close(other);
    assert_int_equal(for_each_file(f->dir, false), 1);
    assert_int_equal(kl_store_open(f->dir, KL_STORE_READ, &f->key, &store, &err), KL_ERR_STALE);

    /* Other settings stay a reason to refuse everything. */
    edited.settings[0] ^= 1;
    assert_int_equal(kl_store_open(f->dir, KL_STORE_EXTEND, &edited, &store, &err), KL_ERR_STALE);
}

static void another_key_is_refused(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);
    struct kl_store_key key = f->key;

    append(store, 0.0f);
    kl_store_close(store);
    store = NULL;
    key.scene[3] ^= 1;
    assert_int_equal(kl_store_open(f->dir, KL_STORE_EXTEND, &key, &store, &err), KL_ERR_STALE);
    assert_non_null(strstr(err.msg, "scene"));
    assert_null(strstr(err.msg, "settings"));
    key = f->key;
    key.settings[0] ^= 1;
    assert_int_equal(kl_store_open(f->dir, KL_STORE_READ, &key, &store, &err), KL_ERR_STALE);
    assert_non_null(strstr(err.msg, "settings"));
    key = f->key;
    key.origin[0] = 1.0;
    assert_int_equal(kl_store_open(f->dir, KL_STORE_READ, &key, &store, &err), KL_ERR_STALE);
    assert_non_null(strstr(err.msg, "origin"));
    key.scene[0] ^= 1;
    assert_int_equal(kl_store_open(f->dir, KL_STORE_REBUILD, &key, &store, &err), KL_OK);
    assert_int_equal(kl_store_segment_count(store), 0);
    kl_store_close(store);
    assert_int_equal(for_each_file(f->dir, false), 0);
}

static void missing_and_empty_directories(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    struct kl_store *store = NULL;

    assert_int_equal(kl_store_open(f->dir, KL_STORE_READ, NULL, &store, &err), KL_ERR_IO);
    assert_non_null(strstr(err.msg, f->dir));
    kl_store_close(open_store(f, KL_STORE_EXTEND));
    assert_int_equal(kl_store_open(f->dir, KL_STORE_READ, NULL, &store, &err), KL_ERR_INPUT);
    assert_int_equal(kl_store_open(f->dir, KL_STORE_READ, &f->key, &store, &err), KL_OK);
    assert_int_equal(kl_store_segment_count(store), 0);
    kl_store_close(store);
}

static void foreign_files_are_ignored(void **state)
{
    static const char *const names[] = {"notes.txt", ".d-00000001-0123456789abcdef.kls.tmp-7",
                                        "d-1-0123456789abcdef.kls", "d-00000001-0123.kls",
                                        "d-000000001-0123456789abcdef.kls"};
    struct fixture *f = *state;
    struct kl_err err;
    char path[400];
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);

    append(store, 0.0f);
    kl_store_close(store);
    for (size_t i = 0; i < sizeof names / sizeof names[0]; ++i) {
        (void)snprintf(path, sizeof path, "%s/%s", f->dir, names[i]);
        assert_int_equal(kl_file_replace(path, "x", 1, &err), KL_OK);
    }
    store = open_store(f, KL_STORE_READ);
    assert_int_equal(kl_store_segment_count(store), 1);
    assert_int_equal(kl_store_damaged(store, NULL), 0);
    kl_store_close(store);
}

static void two_writers_keep_both_batches(void **state)
{
    struct fixture *f = *state;
    struct kl_store *a = open_store(f, KL_STORE_EXTEND);
    struct kl_store *b = open_store(f, KL_STORE_EXTEND);

    append(a, 1.0f);
    append(b, 2.0f);
    append(a, 3.0f);
    append(b, 4.0f);
    kl_store_close(a);
    kl_store_close(b);
    a = open_store(f, KL_STORE_READ);
    assert_int_equal(kl_store_segment_count(a), 4);
    kl_store_close(a);
}

static void same_batches_same_files(void **state) /* 8 */
{
    struct fixture *f = *state;
    char first[400];
    char second[400];
    char *bytes[2] = {NULL, NULL};
    size_t size[2];
    struct kl_err err;

    for (int i = 0; i < 2; ++i) {
        struct kl_store *store = open_store(f, KL_STORE_REBUILD);
        append(store, 5.0f);
        kl_store_close(store);
        find_file(f, 'd', i ? second : first, sizeof first);
        assert_int_equal(kl_file_read(i ? second : first, 1 << 20, &bytes[i], &size[i], &err),
                         KL_OK);
    }
    assert_string_equal(first, second);
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    free(bytes[0]);
    free(bytes[1]);
}

static void copy_file(const char *from, const char *to)
{
    struct kl_err err;
    char *bytes = NULL;
    size_t size = 0;

    assert_int_equal(kl_file_read(from, 1 << 20, &bytes, &size, &err), KL_OK);
    assert_int_equal(kl_file_replace(to, bytes, size, &err), KL_OK);
    free(bytes);
}

/* Each alone in a directory, where nothing of the others is. */
static void segments_are_read_alone(void **state) /* 2 */
{
    struct fixture *f = *state;
    struct kl_err err;
    char path[2][400];
    char alone[400];
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);

    append(store, 1.0f);
    assert_int_equal(kl_store_publish_base(store, f->batch.levels, &err), KL_OK);
    append(store, 2.0f);
    kl_store_close(store);
    find_file(f, 'b', path[0], sizeof path[0]);
    find_file(f, 'd', path[1], sizeof path[1]);
    for (int i = 0; i < 2; ++i) {
        struct batch want;
        const char *name = strrchr(path[i], '/');
        (void)snprintf(alone, sizeof alone, "%s/alone", f->root);
        assert_int_equal(mkdir(alone, 0777), 0);
        (void)snprintf(alone, sizeof alone, "%s/alone%s", f->root, name);
        copy_file(path[i], alone);
        *strrchr(alone, '/') = '\0';
        assert_int_equal(kl_store_open(alone, KL_STORE_READ, NULL, &store, &err), KL_OK);
        assert_int_equal(kl_store_segment_count(store), 1);
        assert_int_equal(kl_store_damaged(store, NULL), 0);
        make_batch(&want, i == 0 ? 0.0f : 2.0f);
        check_segment(store, 0, &want, i == 0);
        kl_store_close(store);
        (void)for_each_file(alone, true);
        assert_int_equal(rmdir(alone), 0);
    }
}

static void names_say_what_files_are(void **state) /* 3 */
{
    static const char *const starts[] = {"b-00000001-", "d-00000002-", "d-00000001-0"};
    struct fixture *f = *state;
    char path[400];
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);

    append(store, 1.0f);
    kl_store_close(store);
    find_file(f, 'd', path, sizeof path);
    const char *hash = strrchr(path, '-') + 1;
    for (size_t i = 0; i < sizeof starts / sizeof starts[0]; ++i) {
        char other[400];
        const int digits = 27 - (int)strlen(starts[i]);
        (void)snprintf(other, sizeof other, "%s/%s%.*s.kls", f->dir, starts[i], digits, hash);
        copy_file(path, other);
        store = open_store(f, KL_STORE_READ);
        assert_int_equal(kl_store_segment_count(store), 1);
        assert_int_equal(kl_store_damaged(store, NULL), 1);
        kl_store_close(store);
        assert_int_equal(unlink(other), 0);
    }
}

static void unsound_batches_are_not_written(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);
    struct batch b = f->batch;

    make_batch(&b, 0.0f);
    b.hot[0][2].radius = NAN;
    assert_int_equal(kl_store_append(store, b.levels, &err), KL_ERR_USAGE);
    make_batch(&b, 0.0f);
    b.cold[1][2].irr[0] = -1.0f;
    assert_int_equal(kl_store_append(store, b.levels, &err), KL_ERR_USAGE);
    make_batch(&b, 0.0f);
    b.cold[0][0].grad[5] = 0x7c00;
    assert_int_equal(kl_store_append(store, b.levels, &err), KL_ERR_USAGE);
    make_batch(&b, 0.0f);
    b.rows[1] = RECORDS;
    assert_int_equal(kl_store_publish_base(store, b.levels, &err), KL_ERR_USAGE);
    make_batch(&b, 0.0f);
    b.nodes[9 + 5] = KL_NODE_LEAF | ROWS; /* behind the rows */
    assert_int_equal(kl_store_publish_base(store, b.levels, &err), KL_ERR_USAGE);
    make_batch(&b, 0.0f);
    b.nodes[9 + 5] = 9; /* back to where it came from: no end */
    assert_int_equal(kl_store_publish_base(store, b.levels, &err), KL_ERR_USAGE);
    make_batch(&b, 0.0f);
    b.nodes[1 + 7] = KL_NODE_FACES | 10; /* a group that goes on behind the end */
    assert_int_equal(kl_store_publish_base(store, b.levels, &err), KL_ERR_USAGE);
    make_batch(&b, 0.0f);
    b.levels[0].octree.top_bits = 2; /* 64 nodes */
    assert_int_equal(kl_store_publish_base(store, b.levels, &err), KL_ERR_USAGE);
    make_batch(&b, 0.0f);
    b.rows[ROWS - 1] = 6; /* the last row goes on behind the end */
    assert_int_equal(kl_store_publish_base(store, b.levels, &err), KL_ERR_USAGE);
    make_batch(&b, 0.0f);
    append(store, 0.0f); /* a refusal breaks nothing */
    kl_store_close(store);
    assert_int_equal(for_each_file(f->dir, false), 1);
}

/* The segment of f->batch as a base, and its name. */
static char *base_bytes(struct fixture *f, char *path, size_t path_size, size_t *size)
{
    struct kl_err err;
    char *bytes = NULL;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);

    append(store, 9.0f);
    assert_int_equal(kl_store_publish_base(store, f->batch.levels, &err), KL_OK);
    kl_store_close(store);
    find_file(f, 'b', path, path_size);
    assert_int_equal(kl_file_read(path, 1 << 20, &bytes, size, &err), KL_OK);
    return bytes;
}

/* Each level has its one block as it was, or nothing. */
static void check_blocks(const struct kl_store *store, const struct batch *want)
{
    struct kl_level_arrays got[KL_CACHE_LEVELS];

    kl_store_segment_get(store, 0, NULL, got);
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        const uint32_t n = got[l].record_count;
        if (n == 0) continue;
        assert_int_equal(n, want->levels[l].record_count);
        assert_memory_equal(got[l].hot, want->hot[l], n * sizeof(kl_record_hot));
        assert_memory_equal(got[l].cold, want->cold[l], n * sizeof(kl_record_cold));
    }
}

static void truncated_files_are_detected(void **state) /* 1 */
{
    struct fixture *f = *state;
    struct kl_err err;
    char path[400];
    size_t size = 0;
    size_t partly = 0;
    char *bytes = base_bytes(f, path, sizeof path, &size);

    for (size_t n = 0; n < size; n += n < 700 ? 7 : (n < 4096 ? 61 : 1021)) {
        struct kl_store *store = NULL;
        FILE *file = fopen(path, "wb");
        assert_non_null(file);
        assert_int_equal(fwrite(bytes, 1, n, file), n);
        assert_int_equal(fclose(file), 0);
        const kl_status st = kl_store_open(f->dir, KL_STORE_READ, NULL, &store, &err);
        if (st == KL_OK) {
            /* What lies before the cut is used, and the rest is missed. */
            assert_int_equal(kl_store_damaged(store, NULL), 1);
            check_blocks(store, &f->batch);
            ++partly;
        } else {
            assert_int_equal(st, KL_ERR_CORRUPT);
        }
        kl_store_close(store);
    }
    assert_true(partly > 10);
    free(bytes);
}

/* From every node to every record that it leads to. */
static void walk_octree(const struct kl_level_arrays *level)
{
    for (uint32_t i = 0; i < level->octree.node_count; ++i) {
        const kl_u32 entry = level->nodes[i];
        if (entry == KL_NODE_EMPTY) continue;
        if (!(entry & KL_NODE_LEAF)) {
            assert_true((entry & KL_NODE_INDEX) > i);
            assert_true((entry & KL_NODE_INDEX) + 8 <= level->octree.node_count);
            continue;
        }
        kl_u32 at = entry & ~KL_NODE_LEAF;
        do {
            assert_true(at < level->octree.row_size);
            assert_true((level->rows[at] & ~KL_ROW_LAST) < level->record_count);
        } while (!(level->rows[at++] & KL_ROW_LAST));
    }
}

/* Every third bit near both ends, where headers and rows lie; a sample of the directory between. */
static size_t step_at(size_t byte, size_t size)
{
    return byte < 4096 || byte + 4096 > size ? 3 : 4099;
}

static void flipped_bits_are_detected_or_harmless(void **state) /* 4, 7 */
{
    struct fixture *f = *state;
    struct kl_err err;
    char path[400];
    size_t size = 0;
    size_t unseen = 0;
    size_t tried = 0;
    char *bytes = base_bytes(f, path, sizeof path, &size);
    unsigned char *copy = aligned_alloc(64, (size + 63) / 64 * 64);
    struct segment segment;
    struct segment_id id;

    assert_non_null(copy);
    assert_true(segment_id_parse(strrchr(path, '/') + 1, &id));
    for (size_t bit = 0; bit < size * 8; bit += step_at(bit / 8, size)) {
        ++tried;
        memcpy(copy, bytes, size);
        copy[bit / 8] = (unsigned char)(copy[bit / 8] ^ (1u << (bit % 8)));
        if (segment_parse(copy, size, &id, false, &segment, &err) == KL_OK) {
            unseen += segment.damage.headers + segment.damage.blocks + segment.damage.octrees == 0;
            segment_fini(&segment);
        }
        /* Without checksums the structure alone must keep queries inside the arrays. */
        if (segment_parse(copy, size, NULL, true, &segment, &err) != KL_OK) continue;
        walk_octree(&segment.levels[0]);
        segment_fini(&segment);
    }
    assert_true(unseen < tried / 4); /* only padding between sections */
    free(copy);
    free(bytes);
}

static void one_damaged_segment_leaves_the_rest(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    char path[400];
    const char *complaint = NULL;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);

    append(store, 1.0f);
    find_file(f, 'd', path, sizeof path);
    append(store, 2.0f);
    kl_store_close(store);
    assert_int_equal(truncate(path, 300), 0); /* within the header */
    store = open_store(f, KL_STORE_EXTEND);
    assert_int_equal(kl_store_segment_count(store), 1);
    assert_int_equal(kl_store_damaged(store, &complaint), 1);
    assert_non_null(strstr(complaint, "d-00000001-"));
    append(store, 3.0f);
    kl_store_close(store);
    (void)for_each_file(f->dir, true);
    (void)snprintf(path, sizeof path, "%s/d-00000001-0123456789abcdef.kls", f->dir);
    assert_int_equal(kl_file_replace(path, "garbage", 7, &err), KL_OK);
    store = NULL;
    assert_int_equal(kl_store_open(f->dir, KL_STORE_EXTEND, &f->key, &store, &err), KL_ERR_CORRUPT);
    assert_int_equal(kl_store_open(f->dir, KL_STORE_REBUILD, &f->key, &store, &err), KL_OK);
    kl_store_close(store);
}

static void other_versions_are_named(void **state)
{
    struct fixture *f = *state;
    struct kl_err err;
    char path[400];
    size_t size = 0;
    struct kl_store *store = NULL;
    char *bytes = base_bytes(f, path, sizeof path, &size);

    const size_t head = (size_t)read_u64((const unsigned char *)bytes + size - HDR_END);
    bytes[HDR_MAJOR] = 9; /* in both headers: else the other one is taken */
    bytes[size - head + HDR_MAJOR] = 9;
    assert_int_equal(kl_file_replace(path, bytes, size, &err), KL_OK);
    assert_int_equal(kl_store_open(f->dir, KL_STORE_EXTEND, &f->key, &store, &err), KL_ERR_VERSION);
    assert_non_null(strstr(err.msg, "version 9"));
    free(bytes);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        TEST(batches_come_back),
        TEST(a_base_replaces_what_it_was_made_from),
        TEST(superseded_leftovers_are_ignored_and_removed_later),
        TEST(parts_are_kept),
        TEST(unsound_parts_are_refused),
        TEST(two_editions_share_a_directory),
        TEST(another_key_is_refused),
        TEST(missing_and_empty_directories),
        TEST(foreign_files_are_ignored),
        TEST(two_writers_keep_both_batches),
        TEST(same_batches_same_files),
        TEST(segments_are_read_alone),
        TEST(names_say_what_files_are),
        TEST(unsound_batches_are_not_written),
        TEST(truncated_files_are_detected),
        TEST(flipped_bits_are_detected_or_harmless),
        TEST(one_damaged_segment_leaves_the_rest),
        TEST(other_versions_are_named),
    };

    return cmocka_run_group_tests_name("store", tests, NULL, NULL);
}
