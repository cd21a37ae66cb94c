#include "tests/crash/faults.h"

#include "src/base/file_calls.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { FILES = 64, OPS = 256, NAME = 128 };

/* Contents, whatever their names are. */
struct node {
    ino_t inode;
    int fd;       /* ours: contents stay when names go */
    off_t synced; /* bytes that would survive */
};

enum op_kind { OP_CREATE, OP_RENAME, OP_UNLINK };
/* A change of the directory that is not durable yet. */
struct op {
    enum op_kind kind;
    char from[NAME], to[NAME];
    int node;
};

struct entry {
    char name[NAME];
    int node;
};
struct map {
    int count;
    struct entry entries[FILES];
};

static struct {
    struct fault_plan plan;
    int calls;
    const char *hit;
    bool is_cut;
    ino_t dir_inode;
    int node_count;
    struct node nodes[FILES];
    struct map now, durable;
    int op_count;
    struct op ops[OPS];
} f;

static void copy_name(char out[NAME], const char *name)
{
    const size_t size = strlen(name) + 1;

    if (size > NAME) abort();
    memmove(out, name, size);
}

static void map_set(struct map *map, const char *name, int node)
{
    for (int i = 0; i < map->count; ++i) {
        if (strcmp(map->entries[i].name, name) == 0) {
            map->entries[i].node = node;
            return;
        }
    }
    if (map->count == FILES) abort();
    copy_name(map->entries[map->count].name, name);
    map->entries[map->count++].node = node;
}

static int map_get(const struct map *map, const char *name)
{
    for (int i = 0; i < map->count; ++i) {
        if (strcmp(map->entries[i].name, name) == 0) return map->entries[i].node;
    }
    return -1;
}

static void map_remove(struct map *map, const char *name)
{
    for (int i = 0; i < map->count; ++i) {
        if (strcmp(map->entries[i].name, name) != 0) continue;
        map->entries[i] = map->entries[--map->count];
        return;
    }
}

static void apply(struct map *map, const struct op *op)
{
    if (op->kind != OP_CREATE) map_remove(map, op->from);
    if (op->kind != OP_UNLINK) map_set(map, op->to, op->node);
}

static void record_op(enum op_kind kind, const char *from, const char *to, int node)
{
    struct op *op = &f.ops[f.op_count];

    if (f.op_count++ == OPS) abort();
    op->kind = kind;
    op->node = node;
    copy_name(op->from, from);
    copy_name(op->to, to);
    apply(&f.now, op);
}

/* True: the call is to fail, errno is set. */
static bool fails(const char *name)
{
    const int number = f.calls++;

    if (f.is_cut) {
        errno = EIO;
        return true;
    }
    if (f.plan.kind != FAULT_ERROR && f.plan.kind != FAULT_POWER_CUT) return false;
    if (number != f.plan.at && !(f.plan.lasts && number > f.plan.at)) return false;
    if (number == f.plan.at) f.hit = name;
    if (f.plan.kind == FAULT_POWER_CUT) {
        f.is_cut = true; /* after this call */
        return false;
    }
    errno = f.plan.error;
    return true;
}

static int node_of(int fd)
{
    struct stat info;

    if (fstat(fd, &info) != 0) return -1;
    for (int i = 0; i < f.node_count; ++i) {
        if (f.nodes[i].inode == info.st_ino) return i;
    }
    return -1;
}

static int add_node(int fd, off_t synced)
{
    struct stat info;

    if (f.node_count == FILES || fstat(fd, &info) != 0) abort();
    f.nodes[f.node_count] = (struct node){info.st_ino, fcntl(fd, F_DUPFD_CLOEXEC, 500), synced};
    return f.node_count++;
}

static bool is_dir(int fd)
{
    struct stat info;

    return fstat(fd, &info) == 0 && info.st_ino == f.dir_inode;
}

static int fake_open(int dir_fd, const char *path, int flags, mode_t mode)
{
    if (fails("open")) return -1;
    const int fd = kl_file_system_calls.open_at(dir_fd, path, flags, mode);
    if (fd >= 0 && (flags & O_CREAT) != 0) record_op(OP_CREATE, "", path, add_node(fd, 0));
    return fd;
}

static int fake_close(int fd)
{
    (void)close(fd); /* a descriptor is gone, whatever close says */
    return fails("close") ? -1 : 0;
}

static ssize_t fake_read(int fd, void *data, size_t size)
{
    if (fails("read")) return -1;
    return read(fd, data, f.plan.kind == FAULT_SHORT && size > 1 ? 1 : size);
}

static ssize_t fake_write(int fd, const void *data, size_t size)
{
    if (fails("write")) return -1;
    return write(fd, data, f.plan.kind == FAULT_SHORT && size > 3 ? size / 2 + 1 : size);
}

static int fake_sync(int fd)
{
    struct stat info;

    if (fails("fsync")) return -1;
    const int node = node_of(fd);
    if (node >= 0 && fstat(fd, &info) == 0) f.nodes[node].synced = info.st_size;
    if (is_dir(fd)) {
        f.durable = f.now;
        f.op_count = 0;
    }
    return 0;
}

static int fake_stat(int fd, struct stat *info)
{
    return fails("fstat") ? -1 : fstat(fd, info);
}

static void *fake_map(size_t size, int fd)
{
    return fails("mmap") ? MAP_FAILED : kl_file_system_calls.map(size, fd);
}

static int fake_rename(int from_fd, const char *from, int to_fd, const char *to)
{
    if (fails("rename")) return -1;
    const int failed = renameat(from_fd, from, to_fd, to);
    if (failed == 0) record_op(OP_RENAME, from, to, map_get(&f.now, from));
    return failed;
}

static int fake_unlink(int dir_fd, const char *path)
{
    if (fails("unlink")) return -1;
    const int failed = unlinkat(dir_fd, path, 0);
    if (failed == 0) record_op(OP_UNLINK, path, "", -1);
    return failed;
}

static int fake_make_dir(const char *path, mode_t mode)
{
    return fails("mkdir") ? -1 : mkdir(path, mode);
}

static struct dirent *fake_read_dir(DIR *dir)
{
    return fails("readdir") ? NULL : readdir(dir);
}

static const struct kl_file_calls fake_calls = {
    .open_at = fake_open,
    .close = fake_close,
    .read = fake_read,
    .write = fake_write,
    .sync = fake_sync,
    .stat = fake_stat,
    .map = fake_map,
    .rename_at = fake_rename,
    .unlink_at = fake_unlink,
    .make_dir = fake_make_dir,
    .read_dir = fake_read_dir,
};

static void take_present(const char *path)
{
    struct stat info;
    DIR *dir = opendir(path);

    if (dir == NULL) return;
    for (const struct dirent *e = readdir(dir); e != NULL; e = readdir(dir)) {
        if (e->d_name[0] == '.') continue;
        const int fd = openat(dirfd(dir), e->d_name, O_RDONLY | O_CLOEXEC);
        if (fd < 0 || fstat(fd, &info) != 0) abort();
        map_set(&f.durable, e->d_name, add_node(fd, info.st_size));
        (void)close(fd);
    }
    if (fstat(dirfd(dir), &info) != 0) abort();
    f.dir_inode = info.st_ino;
    (void)closedir(dir);
}

void faults_begin(const char *dir, const struct fault_plan *plan)
{
    for (int i = 0; i < f.node_count; ++i)
        (void)close(f.nodes[i].fd);
    memset(&f, 0, sizeof f);
    f.plan = *plan;
    f.hit = "";
    take_present(dir);
    f.now = f.durable;
    kl_file_calls = &fake_calls;
}

int faults_call_count(void)
{
    return f.calls;
}

const char *faults_hit(void)
{
    return f.hit;
}

void faults_end(void)
{
    kl_file_calls = &kl_file_system_calls;
}

/* What of a file's unsynced bytes is there: none, a part, a hole of zeros, all. */
enum { REMAINS = 4 };

static void write_file(const char *folder, const char *name, const struct node *node, int remains)
{
    char path[1024];
    struct stat info;

    if (fstat(node->fd, &info) != 0) abort();
    const off_t size = info.st_size;
    char *data = calloc(1, (size_t)size + 1);
    /* A descriptor that was opened to write may still be read through its duplicate: O_RDWR. */
    if (data == NULL || pread(node->fd, data, (size_t)size, 0) != size) abort();
    off_t keep = size;
    if (remains == 0) keep = node->synced;
    if (remains == 1) keep = node->synced + (size - node->synced) / 2;
    if (remains == 2) memset(data + node->synced, 0, (size_t)(size - node->synced));
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "wb");
    if (file == NULL || fwrite(data, 1, (size_t)keep, file) != (size_t)keep) abort();
    if (fclose(file) != 0) abort();
    free(data);
}

bool faults_outcome(int i, const char *to)
{
    struct map map = f.durable;
    const int subset = i / REMAINS;

    if (f.op_count > 16) abort();
    if (subset >= 1 << f.op_count) return false;
    for (int k = 0; k < f.op_count; ++k) {
        if ((subset >> k) & 1) apply(&map, &f.ops[k]);
    }
    for (int k = 0; k < map.count; ++k) {
        write_file(to, map.entries[k].name, &f.nodes[map.entries[k].node], i % REMAINS);
    }
    return true;
}
