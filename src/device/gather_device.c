#include "src/device/gather_device.h"

#include "src/base/memory.h"
#include "src/device/device_scene.h"
#include "src/trace/device_bvh.h"

#include <stdlib.h>

enum {
    MAX_CELL_BYTES = 64 << 20, /* of one launch: bounds memory, and how long a display may hang */
    RAY_GROUP = 64,
    REDUCE_GROUP = 8, /* few records, much work in each */
};

struct kl_gather_device {
    struct kl_device *device;
    struct kl_device_bvh *bvh;
    struct kl_device_scene *scene;
    struct kl_device_program *program;
};

/* What one job needs on the device besides the scene. */
struct batch {
    struct kl_device_level *level1;
    struct kl_device_buffer *directions, *corners, *turn, *cells;
    struct kl_device_buffer *points, *results; /* of one launch */
};

kl_status kl_gather_device_create(const char *selector, struct kl_flat *flat,
                                  struct kl_gather_device **out, struct kl_err *err)
{
    struct kl_gather_device *g = NULL;
    kl_status st = kl_alloc_array(&g, 1, sizeof *g, err);

    if (st != KL_OK) return st;
    st = kl_device_open(selector, &g->device, err);
    if (st == KL_OK) {
        st = kl_device_program_create(g->device, "kernels/gather.cl", flat->view.needs, &g->program,
                                      err);
    }
    if (st == KL_OK) st = kl_device_bvh_create(flat, &g->bvh, err);
    if (st == KL_OK) st = kl_device_scene_create(g->device, flat, g->bvh, &g->scene, err);
    if (st != KL_OK) {
        kl_gather_device_destroy(g);
        return st;
    }
    *out = g;
    return KL_OK;
}

void kl_gather_device_destroy(struct kl_gather_device *gather)
{
    if (gather == NULL) return;
    kl_device_scene_destroy(gather->scene);
    kl_device_program_destroy(gather->program);
    kl_device_bvh_destroy(gather->bvh);
    kl_device_close(gather->device);
    free(gather);
}

const struct kl_device_info *kl_gather_device_get_info(const struct kl_gather_device *gather)
{
    return kl_device_get_info(gather->device);
}

/* OpenCL takes pointers to non-const even for memory that nobody writes. */
static void *without_const(const void *p)
{
    return (void *)(uintptr_t)p;
}

static kl_status input(struct kl_gather_device *g, const void *data, size_t bytes,
                       struct kl_device_buffer **out, struct kl_err *err)
{
    return kl_device_buffer_create(g->device, KL_DEVICE_INPUT, without_const(data), bytes, out,
                                   err);
}

static void batch_fini(struct batch *b)
{
    kl_device_level_destroy(b->level1);
    kl_device_buffer_destroy(b->directions);
    kl_device_buffer_destroy(b->corners);
    kl_device_buffer_destroy(b->turn);
    kl_device_buffer_destroy(b->cells);
}

/* On failure the caller still calls batch_fini. */
static kl_status batch_init(struct kl_gather_device *g, const struct kl_gather_job *job,
                            size_t launch, struct batch *b, struct kl_err *err)
{
    const struct kl_gather_tables *t = job->tables;
    const size_t side = t->side;
    const size_t rays = side * side;
    kl_status st = kl_device_level_create(g->device, job->level1, &b->level1, err);

    if (st == KL_OK) {
        st = input(g, t->directions, t->sets * rays * sizeof *t->directions, &b->directions, err);
    }
    if (st == KL_OK) {
        st = input(g, t->corners, 2 * (side + 1) * (side + 1) * sizeof(float), &b->corners, err);
    }
    if (st == KL_OK) st = input(g, t->turn, 2 * rays * sizeof(float), &b->turn, err);
    if (st == KL_OK) {
        st = kl_device_buffer_create(g->device, KL_DEVICE_SCRATCH, NULL,
                                     launch * rays * sizeof(kl_gather_cell), &b->cells, err);
    }
    return st;
}

static kl_status run_rays(struct kl_gather_device *g, const struct kl_gather_job *job,
                          const struct batch *b, uint32_t count, struct kl_err *err)
{
    enum { FIRST = KL_SCENE_ARG_COUNT + KL_LEVEL_ARG_COUNT, COUNT = FIRST + 5 };
    const size_t rays = (size_t)job->tables->side * job->tables->side;
    struct kl_device_arg args[COUNT];

    kl_device_scene_get_args(g->scene, args);
    kl_device_level_get_args(b->level1, args + KL_SCENE_ARG_COUNT);
    args[FIRST] = (struct kl_device_arg){.value = &job->settings, .size = sizeof job->settings};
    args[FIRST + 1] = (struct kl_device_arg){.buffer = b->points};
    args[FIRST + 2] = (struct kl_device_arg){.buffer = b->directions};
    args[FIRST + 3] = (struct kl_device_arg){.buffer = b->cells};
    args[FIRST + 4] = (struct kl_device_arg){.value = &count, .size = sizeof count};
    return kl_device_run(g->program, "kl_gather_rays", args, COUNT, count * rays, RAY_GROUP, err);
}

static kl_status run_reduce(struct kl_gather_device *g, const struct kl_gather_job *job,
                            const struct batch *b, uint32_t count, struct kl_err *err)
{
    const struct kl_device_arg args[] = {
        {.value = &job->settings, .size = sizeof job->settings},
        {.buffer = b->points},
        {.buffer = b->directions},
        {.buffer = b->corners},
        {.buffer = b->turn},
        {.buffer = b->cells},
        {.buffer = b->results},
        {.value = &count, .size = sizeof count},
    };
    return kl_device_run(g->program, "kl_gather_reduce", args, sizeof args / sizeof args[0], count,
                         REDUCE_GROUP, err);
}

/* Points first .. first + count of the job. */
static kl_status launch_points(struct kl_gather_device *g, const struct kl_gather_job *job,
                               struct batch *b, size_t first, size_t count, struct kl_err *err)
{
    kl_status st = input(g, job->points + first, count * sizeof *job->points, &b->points, err);

    if (st == KL_OK) {
        st = kl_device_buffer_create(g->device, KL_DEVICE_OUTPUT, job->results + first,
                                     count * sizeof *job->results, &b->results, err);
    }
    if (st == KL_OK) st = run_rays(g, job, b, (uint32_t)count, err);
    if (st == KL_OK) st = run_reduce(g, job, b, (uint32_t)count, err);
    if (st == KL_OK) st = kl_device_buffer_read(b->results, err);
    kl_device_buffer_destroy(b->points);
    kl_device_buffer_destroy(b->results);
    b->points = NULL;
    b->results = NULL;
    return st;
}

kl_status kl_gather_device_run(void *context, const struct kl_gather_job *job, struct kl_err *err)
{
    struct kl_gather_device *g = context;
    const size_t rays = (size_t)job->tables->side * job->tables->side;
    const size_t room = MAX_CELL_BYTES / (rays * sizeof(kl_gather_cell));
    const size_t most = room < 1 ? 1 : room;
    const size_t launch = job->count < most ? job->count : most;
    struct batch b = {0};

    if (job->count == 0) return KL_OK;
    kl_status st = batch_init(g, job, launch, &b, err);
    for (size_t first = 0; st == KL_OK && first < job->count; first += launch) {
        const size_t left = job->count - first;
        st = launch_points(g, job, &b, first, left < launch ? left : launch, err);
    }
    batch_fini(&b);
    if (st != KL_OK) return kl_wrap(err, "gathering %zu records", job->count);
    return KL_OK;
}
