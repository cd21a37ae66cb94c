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

/* What the steps of one job share on the device. */
struct job {
    struct kl_gather_device *gather;
    const struct kl_gather_job *in;
    struct kl_device_level *level1;
    struct step_tables {
        struct kl_device_buffer *directions, *corners, *turn;
    } tables[KL_GATHER_STEPS];
};

/* One launch: some of the job's records on one step. */
struct launch {
    uint32_t step, count;
    const uint32_t *numbers; /* of the records in the job */
    const uint32_t *from;    /* their numbers in the launch of the step before */
    kl_gather_point *points; /* count of them, as are the results */
    kl_gather_result *results;
    struct kl_device_buffer *cells;  /* written */
    kl_gather_cell *kept;            /* the same on the host; NULL: nobody wants them */
    struct kl_device_buffer *before; /* cells of the step before; on the first step its own */
};

/* What moves by itself is an instance of its own. */
static uint32_t needs_of(const struct kl_flat *flat, const struct kl_motion *motion)
{
    return motion != NULL ? motion->view.needs | KL_NEED_INSTANCES : flat->view.needs;
}

kl_status kl_gather_device_create(const char *selector, struct kl_flat *flat,
                                  struct kl_motion *motion, struct kl_gather_device **out,
                                  struct kl_err *err)
{
    struct kl_gather_device *g = NULL;
    kl_status st = kl_alloc_array(&g, 1, sizeof *g, err);

    if (st != KL_OK) return st;
    st = kl_device_open(selector, &g->device, err);
    if (st == KL_OK) {
        st = kl_device_program_create(g->device, "kernels/gather.cl", needs_of(flat, motion),
                                      &g->program, err);
    }
    if (st == KL_OK) st = kl_device_bvh_create(flat, motion, &g->bvh, err);
    if (st == KL_OK) st = kl_device_scene_create(g->device, flat, motion, g->bvh, &g->scene, err);
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

static void job_fini(struct job *j)
{
    kl_device_level_destroy(j->level1);
    for (uint32_t i = 0; i < KL_GATHER_STEPS; ++i) {
        kl_device_buffer_destroy(j->tables[i].directions);
        kl_device_buffer_destroy(j->tables[i].corners);
        kl_device_buffer_destroy(j->tables[i].turn);
    }
}

/* Tables of a step, uploaded when the first record needs it. */
static kl_status prepare_step(struct job *j, uint32_t step, struct kl_err *err)
{
    const struct kl_gather_tables *t = j->in->ladder.steps[step];
    struct step_tables *out = &j->tables[step];
    const size_t side = t->side;
    const size_t rays = side * side;
    if (out->turn != NULL) return KL_OK;
    kl_status st = input(j->gather, t->directions, t->sets * rays * sizeof *t->directions,
                         &out->directions, err);
    if (st == KL_OK) {
        st = input(j->gather, t->corners, 2 * (side + 1) * (side + 1) * sizeof(float),
                   &out->corners, err);
    }
    if (st == KL_OK) st = input(j->gather, t->turn, 2 * rays * sizeof(float), &out->turn, err);
    return st;
}

static kl_status run_rays(struct job *j, const struct launch *l, struct kl_device_buffer *points,
                          struct kl_device_buffer *from, struct kl_err *err)
{
    enum { FIRST = KL_SCENE_ARG_COUNT + KL_LEVEL_ARG_COUNT, COUNT = FIRST + 7 };
    const kl_gather_settings settings = kl_gather_step(j->in, l->step);
    const size_t rays = (size_t)settings.side * settings.side;
    struct kl_device_arg args[COUNT];

    kl_device_scene_get_args(j->gather->scene, args);
    kl_device_level_get_args(j->level1, args + KL_SCENE_ARG_COUNT);
    args[FIRST] = (struct kl_device_arg){.value = &settings, .size = sizeof settings};
    args[FIRST + 1] = (struct kl_device_arg){.buffer = points};
    args[FIRST + 2] = (struct kl_device_arg){.buffer = j->tables[l->step].directions};
    args[FIRST + 3] = (struct kl_device_arg){.buffer = l->cells};
    args[FIRST + 4] = (struct kl_device_arg){.buffer = l->before};
    args[FIRST + 5] = (struct kl_device_arg){.buffer = from};
    args[FIRST + 6] = (struct kl_device_arg){.value = &l->count, .size = sizeof l->count};
    return kl_device_run(j->gather->program, "kl_gather_rays", args, COUNT, l->count * rays,
                         RAY_GROUP, err);
}

static kl_status run_reduce(struct job *j, const struct launch *l, struct kl_device_buffer *points,
                            struct kl_device_buffer *smooth, struct kl_device_buffer *results,
                            struct kl_err *err)
{
    const kl_gather_settings settings = kl_gather_step(j->in, l->step);
    const struct step_tables *t = &j->tables[l->step];
    const struct kl_device_arg args[] = {
        {.value = &settings, .size = sizeof settings},
        {.buffer = points},
        {.buffer = t->directions},
        {.buffer = t->corners},
        {.buffer = t->turn},
        {.buffer = l->cells},
        {.buffer = smooth},
        {.buffer = results},
        {.value = &l->count, .size = sizeof l->count},
    };
    return kl_device_run(j->gather->program, "kl_gather_reduce", args, sizeof args / sizeof args[0],
                         l->count, REDUCE_GROUP, err);
}

static size_t cell_bytes(const struct job *j, const struct launch *l)
{
    const size_t side = j->in->ladder.steps[l->step]->side;
    return l->count * side * side * sizeof(kl_gather_cell);
}

/* Trace and reduce the records of a launch; results come back to the host, cells stay. */
static kl_status run_launch(struct job *j, struct launch *l, struct kl_err *err)
{
    struct kl_device *device = j->gather->device;
    struct kl_device_buffer *points = NULL;
    struct kl_device_buffer *from = NULL;
    struct kl_device_buffer *smooth = NULL;
    struct kl_device_buffer *results = NULL;
    kl_status st = prepare_step(j, l->step, err);
    if (st == KL_OK && j->in->cells != NULL) {
        st = kl_alloc_array(&l->kept, cell_bytes(j, l), 1, err);
    }
    if (st == KL_OK) {
        st = kl_device_buffer_create(device, l->kept != NULL ? KL_DEVICE_OUTPUT : KL_DEVICE_SCRATCH,
                                     l->kept, cell_bytes(j, l), &l->cells, err);
    }
    if (st == KL_OK && l->before == NULL) l->before = l->cells;
    if (st == KL_OK) {
        st = kl_device_buffer_create(device, KL_DEVICE_SCRATCH, NULL, cell_bytes(j, l), &smooth,
                                     err);
    }
    if (st == KL_OK) st = input(j->gather, l->points, l->count * sizeof *l->points, &points, err);
    if (st == KL_OK) st = input(j->gather, l->from, l->count * sizeof *l->from, &from, err);
    if (st == KL_OK) {
        st = kl_device_buffer_create(device, KL_DEVICE_OUTPUT, l->results,
                                     l->count * sizeof *l->results, &results, err);
    }
    if (st == KL_OK) st = run_rays(j, l, points, from, err);
    if (st == KL_OK) st = run_reduce(j, l, points, smooth, results, err);
    if (st == KL_OK) st = kl_device_buffer_read(results, err);
    if (st == KL_OK && l->kept != NULL) st = kl_device_buffer_read(l->cells, err);
    kl_device_buffer_destroy(points);
    kl_device_buffer_destroy(from);
    kl_device_buffer_destroy(smooth);
    kl_device_buffer_destroy(results);
    return st;
}

static kl_status gather_step(struct job *j, uint32_t step, const uint32_t *numbers,
                             const uint32_t *from, size_t count, struct kl_device_buffer *before,
                             struct kl_err *err);

/* Records of a launch that want more rays get them. */
static kl_status climb(struct job *j, const struct launch *l, struct kl_err *err)
{
    uint32_t *numbers = NULL;
    uint32_t *from = NULL;
    size_t left = 0;
    kl_status st = kl_alloc_array(&numbers, l->count, sizeof *numbers, err);
    if (st == KL_OK) st = kl_alloc_array(&from, l->count, sizeof *from, err);
    const size_t side = j->in->ladder.steps[l->step]->side;
    for (uint32_t i = 0; st == KL_OK && i < l->count; ++i) {
        j->in->results[l->numbers[i]] = l->results[i];
        if (kl_gather_is_done(&j->in->ladder, l->step, &l->results[i])) {
            if (l->kept != NULL) {
                kl_gather_keep(j->in, l->step, l->numbers[i], l->kept + i * side * side);
            }
            continue;
        }
        numbers[left] = l->numbers[i];
        from[left++] = i;
    }
    if (st == KL_OK && left > 0) {
        st = gather_step(j, l->step + 1, numbers, from, left, l->cells, err);
    }
    free(numbers);
    free(from);
    return st;
}

/* `count` records on one step and, where they need it, on the steps above, in launches of bounded
 * memory. The depth of the recursion is that of the ladder. */
static kl_status gather_step(struct job *j, uint32_t step, const uint32_t *numbers,
                             const uint32_t *from, size_t count, struct kl_device_buffer *before,
                             struct kl_err *err)
{
    const size_t side = j->in->ladder.steps[step]->side;
    const size_t room = MAX_CELL_BYTES / (side * side * sizeof(kl_gather_cell));
    const size_t most = room < 1 ? 1 : (room < count ? room : count);
    kl_gather_point *points = NULL;
    kl_gather_result *results = NULL;
    kl_status st = kl_alloc_array(&points, most, sizeof *points, err);
    if (st == KL_OK) st = kl_alloc_array(&results, most, sizeof *results, err);
    for (size_t first = 0; st == KL_OK && first < count; first += most) {
        const size_t n = count - first < most ? count - first : most;
        struct launch l = {.step = step,
                           .count = (uint32_t)n,
                           .numbers = numbers + first,
                           .from = from + first,
                           .points = points,
                           .results = results,
                           .before = before};
        for (size_t i = 0; i < n; ++i) {
            points[i] = j->in->points[l.numbers[i]];
        }
        st = run_launch(j, &l, err);
        if (st == KL_OK) st = climb(j, &l, err);
        kl_device_buffer_destroy(l.cells);
        free(l.kept);
    }
    free(points);
    free(results);
    return st;
}

kl_status kl_gather_device_run(void *context, const struct kl_gather_job *job, struct kl_err *err)
{
    struct job j = {.gather = context, .in = job};
    uint32_t *numbers = NULL;

    if (job->count == 0) return KL_OK;
    kl_status st = kl_alloc_array(&numbers, job->count, sizeof *numbers, err);
    if (st == KL_OK) st = kl_device_level_create(j.gather->device, job->level1, &j.level1, err);
    for (size_t i = 0; st == KL_OK && i < job->count; ++i) {
        numbers[i] = (uint32_t)i;
    }
    if (st == KL_OK) st = gather_step(&j, 0, numbers, numbers, job->count, NULL, err);
    job_fini(&j);
    free(numbers);
    if (st != KL_OK) return kl_wrap(err, "gathering %zu records", job->count);
    return KL_OK;
}

/* ---- single rays ---- */

struct pick_buffers {
    struct kl_device_level *level1;
    struct kl_device_buffer *points, *directions;
};

static kl_status run_picks(struct kl_gather_device *g, const struct kl_gather_picks *p,
                           const struct pick_buffers *b, size_t first, uint32_t count,
                           struct kl_err *err)
{
    enum { FIRST = KL_SCENE_ARG_COUNT + KL_LEVEL_ARG_COUNT, COUNT = FIRST + 6 };
    const kl_gather_settings settings = kl_gather_pick_settings(p);
    struct kl_device_buffer *picks = NULL;
    struct kl_device_buffer *cells = NULL;
    struct kl_device_arg args[COUNT];

    kl_status st = input(g, p->picks + first, count * sizeof *p->picks, &picks, err);
    if (st == KL_OK) {
        st = kl_device_buffer_create(g->device, KL_DEVICE_OUTPUT, p->cells + first,
                                     count * sizeof *p->cells, &cells, err);
    }
    if (st == KL_OK) {
        kl_device_scene_get_args(g->scene, args);
        kl_device_level_get_args(b->level1, args + KL_SCENE_ARG_COUNT);
        args[FIRST] = (struct kl_device_arg){.value = &settings, .size = sizeof settings};
        args[FIRST + 1] = (struct kl_device_arg){.buffer = b->points};
        args[FIRST + 2] = (struct kl_device_arg){.buffer = b->directions};
        args[FIRST + 3] = (struct kl_device_arg){.buffer = picks};
        args[FIRST + 4] = (struct kl_device_arg){.buffer = cells};
        args[FIRST + 5] = (struct kl_device_arg){.value = &count, .size = sizeof count};
        st = kl_device_run(g->program, "kl_gather_picked", args, COUNT, count, RAY_GROUP, err);
    }
    if (st == KL_OK) st = kl_device_buffer_read(cells, err);
    kl_device_buffer_destroy(picks);
    kl_device_buffer_destroy(cells);
    return st;
}

kl_status kl_gather_device_picks(struct kl_gather_device *gather,
                                 const struct kl_gather_picks *picks, struct kl_err *err)
{
    const size_t most = MAX_CELL_BYTES / sizeof(kl_gather_cell);
    const struct kl_gather_tables *t = picks->tables;
    struct pick_buffers b = {0};

    if (picks->count == 0) return KL_OK;
    kl_status st = kl_device_level_create(gather->device, picks->level1, &b.level1, err);
    if (st == KL_OK) {
        st = input(gather, picks->points, picks->point_count * sizeof *picks->points, &b.points,
                   err);
    }
    if (st == KL_OK) {
        st = input(gather, t->directions,
                   (size_t)t->sets * t->side * t->side * sizeof *t->directions, &b.directions, err);
    }
    for (size_t first = 0; st == KL_OK && first < picks->count; first += most) {
        const size_t n = picks->count - first < most ? picks->count - first : most;
        st = run_picks(gather, picks, &b, first, (uint32_t)n, err);
    }
    kl_device_level_destroy(b.level1);
    kl_device_buffer_destroy(b.points);
    kl_device_buffer_destroy(b.directions);
    if (st != KL_OK) return kl_wrap(err, "gathering %zu rays", picks->count);
    return KL_OK;
}
