#include "cache_io/claim.h"

#include "cache_io/store_impl.h"
#include "src/base/file.h"
#include "src/base/file_calls.h"
#include "src/base/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { NAME_SIZE = 80 };

struct kl_claim {
    int dir_fd, fd; /* both owned */
    char name[NAME_SIZE];
};

/* Is the file that `fd` is of younger than a claim lives, judged by a file made now? */
static bool is_alive(int fd, const struct stat *now)
{
    struct stat file;

    if (kl_file_calls->stat(fd, &file) != 0) return false;
    const long long age = (long long)now->st_mtime - (long long)file.st_mtime;
    return age <= KL_CLAIM_LIFE_S && age >= -KL_CLAIM_LIFE_S;
}

static bool another_lives(int dir_fd, const char *name, const struct stat *now)
{
    const int fd = kl_file_open_at(dir_fd, name, O_RDONLY);

    if (fd < 0) return false;
    const bool alive = is_alive(fd, now);
    (void)kl_file_calls->close(fd);
    return alive;
}

/* A file under a name of our own, to be renamed over the claim's. */
static int make_mine(int dir_fd, const char *name, char mine[NAME_SIZE + 32])
{
    (void)snprintf(mine, NAME_SIZE + 32, ".%s.%ld", name, (long)getpid());
    (void)kl_file_calls->unlink_at(dir_fd, mine); /* of a process of this number, long gone */
    return kl_file_open_at(dir_fd, mine, O_RDWR | O_CREAT | O_EXCL);
}

static bool sign(int fd)
{
    struct kl_err ignored;
    char host[64] = "?";
    char text[128];

    (void)gethostname(host, sizeof host - 1);
    const int size = snprintf(text, sizeof text, "%s %ld\n", host, (long)getpid());
    return kl_file_write_all(fd, text, (size_t)size, &ignored) == KL_OK;
}

/* Of several that find the same dead claim the last one to rename has it; the others do not know,
 * and work is done twice. */
static int take_over(int dir_fd, const char *name, bool *taken)
{
    char mine[NAME_SIZE + 32];
    struct stat now;
    const int fd = make_mine(dir_fd, name, mine);

    if (fd < 0) return -1;
    bool ok = sign(fd) && kl_file_calls->stat(fd, &now) == 0;
    if (ok && another_lives(dir_fd, name, &now)) *taken = ok = false;
    ok = ok && kl_file_calls->rename_at(dir_fd, mine, dir_fd, name) == 0;
    if (ok) return fd;
    (void)kl_file_calls->unlink_at(dir_fd, mine);
    (void)kl_file_calls->close(fd);
    return -1;
}

/* Of several that find none, one can make it. */
static int try_take(int dir_fd, const char *name, bool *taken)
{
    const int fd = kl_file_open_at(dir_fd, name, O_RDWR | O_CREAT | O_EXCL);

    *taken = true;
    if (fd < 0) return take_over(dir_fd, name, taken);
    (void)sign(fd);
    return fd;
}

struct kl_claim *kl_claim_take(const struct kl_store *store, uint64_t work, bool *taken)
{
    struct kl_claim *claim = NULL;
    struct kl_err ignored;

    *taken = true;
    if (kl_alloc_array(&claim, 1, sizeof *claim, &ignored) != KL_OK) return NULL;
    (void)snprintf(claim->name, sizeof claim->name, "claim-%016" PRIx64, work);
    claim->fd = -1;
    claim->dir_fd = kl_file_open_at(store->dir_fd, ".", O_RDONLY | O_DIRECTORY);
    if (claim->dir_fd >= 0) claim->fd = try_take(claim->dir_fd, claim->name, taken);
    if (claim->fd >= 0) return claim;
    if (claim->dir_fd >= 0) (void)kl_file_calls->close(claim->dir_fd);
    free(claim);
    return NULL;
}

void kl_claim_renew(struct kl_claim *claim)
{
    struct kl_err ignored;

    if (claim == NULL) return;
    if (kl_file_write_all(claim->fd, ".", 1, &ignored) != KL_OK) return; /* it will expire */
}

void kl_claim_release(struct kl_claim *claim)
{
    if (claim == NULL) return;
    (void)kl_file_calls->unlink_at(claim->dir_fd, claim->name);
    (void)kl_file_calls->close(claim->fd);
    (void)kl_file_calls->close(claim->dir_fd);
    free(claim);
}
