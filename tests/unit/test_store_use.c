/* What renders tell of use: section 8 of docs/cache_format.md, by the numbers of its section 1. */
#include "cache_io/format_impl.h"
#include "cache_io/upkeep.h"
#include "cache_io/use_impl.h"
#include "kernels/sampling.h"
#include "src/base/file.h"

#include <dirent.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

enum { RECORDS = 400 };

struct fixture {
    char dir[64];
    struct kl_store_key key;
    kl_record_hot hot[RECORDS];
    kl_record_cold cold[RECORDS];
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);

    assert_non_null(f);
    strcpy(f->dir, "/tmp/kl_use_XXXXXX");
    assert_non_null(mkdtemp(f->dir));
    for (uint32_t i = 0; i < RECORDS; ++i) {
        f->hot[i].pos[0] = (float)i;
        f->hot[i].radius = 0.5f;
        f->hot[i].radius2 = 0.5f;
        f->cold[i].raw_radius = 1.0f;
    }
    *state = f;
    return 0;
}

static size_t count_files(const char *path, const char *start, bool remove_them)
{
    char name[400];
    size_t n = 0;
    DIR *dir = opendir(path);

    assert_non_null(dir);
    for (const struct dirent *e = readdir(dir); e != NULL; e = readdir(dir)) {
        if (strcmp(e->d_name, ".") == 0 || strcmp(e->d_name, "..") == 0) continue;
        if (strncmp(e->d_name, start, strlen(start)) != 0) continue;
        (void)snprintf(name, sizeof name, "%s/%s", path, e->d_name);
        if (remove_them) assert_int_equal(unlink(name), 0);
        ++n;
    }
    (void)closedir(dir);
    return n;
}

static int teardown(void **state)
{
    struct fixture *f = *state;

    (void)count_files(f->dir, "", true);
    assert_int_equal(rmdir(f->dir), 0);
    free(f);
    return 0;
}

static struct kl_store *open_store(const struct fixture *f, enum kl_store_mode mode)
{
    struct kl_err err;
    struct kl_store *store = NULL;

    if (kl_store_open(f->dir, mode, &f->key, &store, &err) != KL_OK) fail_msg("%s", err.msg);
    return store;
}

/* Records [first, end) come as a batch. */
static void append(const struct fixture *f, uint32_t first, uint32_t end)
{
    const struct kl_level_arrays levels[KL_CACHE_LEVELS] = {
        {.record_count = end - first, .hot = f->hot + first, .cold = f->cold + first}};
    struct kl_err err;
    struct kl_store *store = open_store(f, KL_STORE_EXTEND);

    if (kl_store_append(store, levels, &err) != KL_OK) fail_msg("%s", err.msg);
    kl_store_close(store);
}

/* A render by which records [first, end) served. */
static void render(const struct fixture *f, uint32_t first, uint32_t end)
{
    struct kl_err err;
    uint8_t used[RECORDS] = {0};
    struct kl_store *store = open_store(f, KL_STORE_READ);

    memset(used + first, 1, end - first);
    if (kl_use_publish(store, f->hot, RECORDS, used, &err) != KL_OK) fail_msg("%s", err.msg);
    kl_store_close(store);
}

static struct kl_use_summary count_used(const struct fixture *f, uint32_t used[2], uint32_t middle)
{
    struct kl_err err;
    struct kl_use *use = NULL;
    struct kl_use_summary sum;
    struct kl_store *store = open_store(f, KL_STORE_READ);

    if (kl_use_load(store, 0, &use, &err) != KL_OK) fail_msg("%s", err.msg);
    used[0] = used[1] = 0;
    for (uint32_t i = 0; i < RECORDS; ++i)
        used[i >= middle] += kl_use_has(use, &f->hot[i]);
    kl_use_get_summary(use, &sum);
    kl_use_destroy(use);
    kl_store_close(store);
    return sum;
}

static void set_age(const struct fixture *f, const char *start, time_t age)
{
    char name[400];
    DIR *dir = opendir(f->dir);
    const struct timespec then[2] = {{time(NULL) - age, 0}, {time(NULL) - age, 0}};

    assert_non_null(dir);
    for (const struct dirent *e = readdir(dir); e != NULL; e = readdir(dir)) {
        if (strncmp(e->d_name, start, strlen(start)) != 0) continue;
        (void)snprintf(name, sizeof name, "%s/%s", f->dir, e->d_name);
        assert_int_equal(utimensat(AT_FDCWD, name, then, 0), 0);
    }
    (void)closedir(dir);
}

static kl_status prune(const struct fixture *f, int64_t unused_for, struct kl_store_pruned *out)
{
    const struct kl_store_prune what = {.unused = true, .unused_for = unused_for};
    struct kl_err err;

    return kl_store_prune(f->dir, &what, out, &err);
}

static void what_served_is_known(void **state)
{
    const struct fixture *f = *state;
    uint32_t used[2];

    append(f, 0, RECORDS);
    assert_int_equal(count_used(f, used, 100).files, 0);
    assert_int_equal(used[0] + used[1], 0);
    render(f, 0, 100);
    const struct kl_use_summary sum = count_used(f, used, 100);
    assert_int_equal(sum.files, 1);
    assert_int_equal(sum.generation, 1);
    assert_int_equal(used[0], 100);
    assert_true(used[1] < 15); /* 300 times a few of 100 */
    render(f, 0, 100);         /* the same again: the same file (8) */
    assert_int_equal(count_files(f->dir, "u-", false), 1);
    render(f, 0, 0); /* nothing served: nothing is told */
    assert_int_equal(count_files(f->dir, "u-", false), 1);
}

/* Many renders leave few files, and nothing is forgotten. */
static void files_are_joined(void **state)
{
    const struct fixture *f = *state;
    uint32_t used[2];

    append(f, 0, RECORDS);
    for (uint32_t i = 0; i < 50; ++i) {
        render(f, 4 * i, 4 * i + 4);
        assert_true(count_files(f->dir, "u-", false) <= USE_MOST_FILES);
    }
    (void)count_used(f, used, 200);
    assert_int_equal(used[0], 200);
    assert_true(used[1] < 40);
    assert_int_equal(count_files(f->dir, ".", false), 0);
}

static void unused_records_are_dropped(void **state)
{
    const struct fixture *f = *state;
    struct kl_store_pruned pruned;

    append(f, 0, 200);
    assert_int_equal(prune(f, 0, &pruned), KL_OK);
    assert_true(pruned.untold && pruned.dropped == 0 && pruned.kept == 200); /* who knows? */
    render(f, 0, 50);
    append(f, 200, RECORDS); /* no render has seen them */
    assert_int_equal(prune(f, 0, &pruned), KL_OK);
    assert_true(pruned.dropped <= 150 && pruned.dropped > 135);
    assert_int_equal(pruned.kept + pruned.dropped, RECORDS);
    /* What was told stays true for the base that prune has written. */
    assert_int_equal(prune(f, 0, &pruned), KL_OK);
    assert_int_equal(pruned.dropped, 0);
    render(f, 0, 50);
    assert_int_equal(prune(f, 0, &pruned), KL_OK);
    assert_true(pruned.kept < 70);
    /* Generations begin anew with a rebuild: so does what is known. */
    kl_store_close(open_store(f, KL_STORE_REBUILD));
    assert_int_equal(count_files(f->dir, "", false), 0);
}

static void old_use_does_not_count(void **state)
{
    const struct fixture *f = *state;
    struct kl_store_pruned pruned;

    append(f, 0, 200);
    render(f, 0, 100);
    set_age(f, "u-", 1000);
    assert_int_equal(prune(f, 500, &pruned), KL_OK);
    assert_true(pruned.untold && pruned.dropped == 0); /* nobody has told since */
    render(f, 0, 50);
    append(f, 200, RECORDS);
    render(f, 0, 50);
    /* Of the first 200 it is known that they are older; of the others it is not. */
    assert_int_equal(prune(f, 500, &pruned), KL_OK);
    assert_true(pruned.dropped <= 150 && pruned.dropped > 135);
    /* Segments tell of their time, too. */
    set_age(f, "b-", 1000);
    assert_int_equal(prune(f, 500, &pruned), KL_OK);
    assert_true(pruned.kept < 70);
}

static char *read_use(const struct fixture *f, char path[400], size_t *size)
{
    char *bytes = NULL;
    struct kl_err err;
    DIR *dir = opendir(f->dir);

    assert_non_null(dir);
    for (const struct dirent *e = readdir(dir); e != NULL; e = readdir(dir)) {
        if (e->d_name[0] == 'u') (void)snprintf(path, 400, "%s/%s", f->dir, e->d_name);
    }
    (void)closedir(dir);
    assert_int_equal(kl_file_read(path, 1 << 20, &bytes, size, &err), KL_OK);
    return bytes;
}

/* Any bit, any cut: ignored, and said. */
static void damaged_files_are_ignored(void **state) /* 3, 4, 10 */
{
    const struct fixture *f = *state;
    char path[400];
    uint32_t used[2];
    size_t size = 0;
    struct kl_err err;
    uint64_t hash = 0;

    append(f, 0, RECORDS);
    render(f, 0, 100);
    char *bytes = read_use(f, path, &size);
    char *copy = malloc(size);
    assert_non_null(copy);
    assert_true(use_name_parse(strrchr(path, '/') + 1, &hash));
    for (size_t bit = 0; bit < 8 * size; ++bit) {
        struct use_set set;
        memcpy(copy, bytes, size);
        copy[bit / 8] = (char)(copy[bit / 8] ^ 1 << bit % 8);
        assert_int_not_equal(use_parse(copy, size, &hash, false, &set, &err), KL_OK);
        if (use_parse(copy, size, NULL, true, &set, &err) == KL_OK) free(set.bits);
    }
    for (size_t n = 0; n < size; n += 37) {
        assert_int_equal(kl_file_replace(path, bytes, n, &err), KL_OK);
        const struct kl_use_summary sum = count_used(f, used, 100);
        assert_int_equal(sum.files, 0);
        assert_int_equal(sum.damaged, 1);
        assert_non_null(strstr(sum.complaint, "u-"));
        assert_null(strchr(sum.complaint, '\n'));
    }
    /* The next render is not disturbed by it. */
    render(f, 0, 200);
    assert_int_equal(count_used(f, used, 200).files, 1);
    assert_int_equal(used[0], 200);
    free(copy);
    free(bytes);
}

static void strange_files_are_ignored(void **state)
{
    static const char *const names[] = {"u-0123.klu", "u-0123456789abcdeF.klu",
                                        "u-0123456789abcdef.kls", "u-0123456789abcdef.klu.bak"};
    const struct fixture *f = *state;
    char path[400];
    uint32_t used[2];
    struct kl_err err;

    append(f, 0, RECORDS);
    for (size_t i = 0; i < sizeof names / sizeof names[0]; ++i) {
        (void)snprintf(path, sizeof path, "%s/%s", f->dir, names[i]);
        assert_int_equal(kl_file_replace(path, "x", 1, &err), KL_OK);
    }
    (void)snprintf(path, sizeof path, "%s/u-00000000000000aa.klu", f->dir);
    assert_int_equal(mkfifo(path, 0600), 0); /* nobody writes to it: reading would wait */
    const struct kl_use_summary sum = count_used(f, used, 1);
    assert_int_equal(sum.files, 0);
    assert_int_equal(sum.damaged, 1);
}

/* Sets of different sizes hold together what each held. */
static void sets_of_all_sizes_are_joined(void **state)
{
    struct kl_err err;
    (void)state;

    for (uint32_t a = USE_LEAST_BITS; a < 14; ++a) {
        for (uint32_t b = USE_LEAST_BITS; b < 14; ++b) {
            struct use_set x = {.log2_bits = a, .bits = calloc(1, (size_t)1 << (a - 3))};
            struct use_set y = {.log2_bits = b, .bits = calloc(1, (size_t)1 << (b - 3))};
            assert_true(x.bits != NULL && y.bits != NULL);
            for (uint64_t i = 0; i < 50; ++i) {
                use_set_add(&x, i * 0x9e3779b97f4a7c15ull);
                use_set_add(&y, (i + 50) * 0x9e3779b97f4a7c15ull);
            }
            assert_int_equal(use_set_join(&x, &y, &err), KL_OK);
            assert_int_equal(x.log2_bits, a > b ? a : b);
            for (uint64_t i = 0; i < 100; ++i)
                assert_true(use_set_has(&x, i * 0x9e3779b97f4a7c15ull));
            free(x.bits);
            free(y.bits);
        }
    }
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        TEST(what_served_is_known),
        TEST(files_are_joined),
        TEST(unused_records_are_dropped),
        TEST(old_use_does_not_count),
        TEST(damaged_files_are_ignored),
        TEST(strange_files_are_ignored),
        cmocka_unit_test(sets_of_all_sizes_are_joined),
    };

    return cmocka_run_group_tests_name("store_use", tests, NULL, NULL);
}
