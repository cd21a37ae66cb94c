#include "src/render/frame.h"

#include "kernels/moving.h"
#include "src/base/memory.h"

#include <omp.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TILE = 16, SHARED_BITS = 6 };

/* Values of one pixel, in the order of `layers`. */
enum value {
    BEAUTY = 0,
    ALPHA = 3,
    DIFFUSE_DIRECT = 4,
    DIFFUSE_INDIRECT = 7,
    SPECULAR_DIRECT = 10,
    SPECULAR_INDIRECT = 13,
    EMISSION = 16,
    ALBEDO = 19,
    IRRADIANCE = 22,
    CACHE_WEIGHT = 25,
    CACHE_ERROR = 26,
    CACHE_LATE = 27,
    SAMPLED = 28, /* the values above are means of samples, those below belong to the centre ray */
    NORMAL = 28,
    POSITION = 31,
    DEPTH = 34,
    MOTION = 35,
    ID = 37,
    VALUES = 38,
};

static const struct layer {
    const char *name, *channels[4];
    int first;
    enum kl_pixel pixel;
} layers[] = {
    {"beauty", {"R", "G", "B", "A"}, BEAUTY, KL_PIXEL_HALF},
    {"diffuse_direct", {"R", "G", "B"}, DIFFUSE_DIRECT, KL_PIXEL_HALF},
    {"diffuse_indirect", {"R", "G", "B"}, DIFFUSE_INDIRECT, KL_PIXEL_HALF},
    {"specular_direct", {"R", "G", "B"}, SPECULAR_DIRECT, KL_PIXEL_HALF},
    {"specular_indirect", {"R", "G", "B"}, SPECULAR_INDIRECT, KL_PIXEL_HALF},
    {"emission", {"R", "G", "B"}, EMISSION, KL_PIXEL_HALF},
    {"albedo", {"R", "G", "B"}, ALBEDO, KL_PIXEL_HALF},
    {"irradiance", {"R", "G", "B"}, IRRADIANCE, KL_PIXEL_HALF},
    {"N", {"X", "Y", "Z"}, NORMAL, KL_PIXEL_HALF},
    {"P", {"X", "Y", "Z"}, POSITION, KL_PIXEL_FLOAT},
    {"Z", {""}, DEPTH, KL_PIXEL_FLOAT},
    {"motion", {"X", "Y"}, MOTION, KL_PIXEL_FLOAT},
    {"id", {""}, ID, KL_PIXEL_UINT},
    {"cache.weight", {""}, CACHE_WEIGHT, KL_PIXEL_HALF},
    {"cache.error", {""}, CACHE_ERROR, KL_PIXEL_HALF},
    {"cache.late", {""}, CACHE_LATE, KL_PIXEL_HALF},
};
enum { LAYERS = sizeof layers / sizeof layers[0] };

/* Name of channel k of a layer: "R", "albedo.R", "Z". False past the last one. */
static bool channel_name(const struct layer *layer, int k, char name[KL_IMAGE_NAME_SIZE])
{
    if (k >= 4 || layer->channels[k] == NULL) return false;
    const char *channel = layer->channels[k];
    if (layer == &layers[0]) {
        (void)snprintf(name, KL_IMAGE_NAME_SIZE, "%s", channel);
    } else {
        (void)snprintf(name, KL_IMAGE_NAME_SIZE, "%s%s%s", layer->name, channel[0] ? "." : "",
                       channel);
    }
    return true;
}

static kl_status add_layer(struct kl_image *image, const struct layer *layer, struct kl_err *err)
{
    char name[KL_IMAGE_NAME_SIZE];
    for (int k = 0; channel_name(layer, k, name); ++k) {
        if (kl_image_find(image, name) != NULL) continue;
        kl_status st = kl_image_add_channel(image, name, layer->pixel, NULL, err);
        if (st != KL_OK) return st;
    }
    return KL_OK;
}

static const struct layer *find_layer(const char *name, size_t length)
{
    for (int i = 0; i < LAYERS; ++i) {
        if (strlen(layers[i].name) == length && memcmp(layers[i].name, name, length) == 0) {
            return &layers[i];
        }
    }
    return NULL;
}

kl_status kl_frame_add_layers(struct kl_image *image, const char *list, struct kl_err *err)
{
    kl_status st = add_layer(image, &layers[0], err);
    if (list == NULL || strcmp(list, "all") == 0) {
        for (int i = 1; st == KL_OK && i < LAYERS; ++i) {
            st = add_layer(image, &layers[i], err);
        }
        return st;
    }
    while (st == KL_OK && *list != '\0') {
        const size_t length = strcspn(list, ",");
        const struct layer *layer = find_layer(list, length);
        if (layer == NULL) {
            return kl_fail(err, KL_ERR_USAGE, "--aov: no layer '%.*s'", (int)length, list);
        }
        st = add_layer(image, layer, err);
        list += length + (list[length] == ',');
    }
    return st;
}

/* Where each value goes: NULL where the image does not want it. */
struct sinks {
    float *floats[VALUES];
    uint32_t *ids;
};

static struct sinks find_sinks(const struct kl_image *image)
{
    struct sinks sinks = {0};
    char name[KL_IMAGE_NAME_SIZE];
    for (int i = 0; i < LAYERS; ++i) {
        for (int k = 0; channel_name(&layers[i], k, name); ++k) {
            const struct kl_channel *c = kl_image_find(image, name);
            if (c == NULL) continue;
            if (layers[i].first == ID) {
                sinks.ids = c->uints;
            } else {
                sinks.floats[layers[i].first + k] = c->data;
            }
        }
    }
    return sinks;
}

static void put(float *values, int first, kl_vec3 v)
{
    values[first] = v.x;
    values[first + 1] = v.y;
    values[first + 2] = v.z;
}

static kl_vec3 sum_parts(const struct kl_parts *p)
{
    const kl_vec3 direct = kl_v3_add(p->diffuse_direct, p->specular_direct);
    const kl_vec3 indirect = kl_v3_add(p->diffuse_indirect, p->specular_indirect);
    return kl_v3_add(p->emission, kl_v3_add(direct, indirect));
}

static void sample_values(const struct kl_parts *p, float values[SAMPLED])
{
    put(values, BEAUTY, sum_parts(p));
    values[ALPHA] = p->alpha;
    put(values, DIFFUSE_DIRECT, p->diffuse_direct);
    put(values, DIFFUSE_INDIRECT, p->diffuse_indirect);
    put(values, SPECULAR_DIRECT, p->specular_direct);
    put(values, SPECULAR_INDIRECT, p->specular_indirect);
    put(values, EMISSION, p->emission);
    put(values, ALBEDO, p->albedo);
    put(values, IRRADIANCE, p->irradiance);
    values[CACHE_WEIGHT] = p->cache_weight;
    values[CACHE_ERROR] = p->cache_error;
    values[CACHE_LATE] = p->late;
}

/* Normal, position, depth, motion and id of what the pixel's centre sees. Motion [pixels] points
 * from here to where the same surface point was one frame earlier. All at the reference instant. */
static uint32_t center_values(const struct kl_frame_job *job, uint32_t x, uint32_t y,
                              float values[VALUES])
{
    const float cx = (float)x + 0.5f;
    const float cy = (float)y + 0.5f;
    const kl_ray ray = kl_camera_ray(&job->camera, cx, cy);
    kl_hit hit;
    kl_surface surface;
    float depth;
    float mx;
    float my;

    values[DEPTH] = KL_INF;
    if (!kl_intersect(job->shade.reference, &ray, 0, &hit)) return KL_NONE;
    kl_surface_at(job->shade.reference, &ray, &hit, &surface);
    put(values, NORMAL, surface.shading);
    put(values, POSITION, surface.pos);
    for (int k = 0; k < 3; ++k) {
        values[POSITION + k] = (float)((double)values[POSITION + k] + job->origin[k]);
    }
    (void)kl_camera_project(&job->camera, surface.pos, &mx, &my, &depth);
    values[DEPTH] = depth;
    const kl_vec3 was = kl_motion_point(job->before_motion, &hit, KL_TIME_REFERENCE, surface.pos);
    if (kl_camera_project(&job->before, was, &mx, &my, &depth)) {
        values[MOTION] = mx - cx;
        values[MOTION + 1] = my - cy;
    }
    return surface.object;
}

static bool is_blurred(const struct kl_frame_job *job)
{
    return job->camera_count > 1 || KL_NEEDS(job->shade.scene, KL_NEED_MOTION);
}

/* When sample i of a pixel is taken: a dimension of its own, so that what stands still gets the
 * samples that it gets without blur. */
static float sample_time(const struct kl_frame_job *job, uint32_t i, uint32_t seed)
{
    kl_sampler sampler = kl_sampler_make(i, seed ^ 0x74696d65u);
    const float u = kl_sampler_1d(&sampler);

    return job->times != NULL ? kl_shutter_time(job->times, u) : u;
}

static uint32_t spread_bits(uint32_t x)
{
    uint32_t out = 0;
    for (uint32_t k = 0; k < SHARED_BITS; ++k) {
        out |= (x >> k & 1u) << 2 * k;
    }
    return out;
}

/* Sample 0 of a pixel. Its samples are a stretch of one sequence that a square of pixels shares
 * along a Z-curve: what neighbours get wrong cancels where the eye, or a filter, takes them
 * together. A. Ahmed and P. Wonka, "Screen-Space Blue-Noise Diffusion of Monte Carlo Sampling Error
 * via Hierarchical Ordering of Pixels", SIGGRAPH Asia 2020. */
static kl_sampler first_sample(const struct kl_frame_job *job, uint32_t x, uint32_t y)
{
    const uint32_t mask = (1u << SHARED_BITS) - 1u;
    const uint32_t place = spread_bits(x & mask) | spread_bits(y & mask) << 1;
    const uint32_t square = kl_hash2(x >> SHARED_BITS, y >> SHARED_BITS);
    uint32_t stride = 1;
    while (stride < job->spp && stride < 1u << (32 - 2 * SHARED_BITS)) {
        stride *= 2;
    }
    return kl_sampler_make(place * stride, kl_hash2(kl_hash2(job->seed, square), 0x51ed27u));
}

static uint32_t render_pixel(const struct kl_frame_job *job, uint32_t x, uint32_t y,
                             float values[VALUES], struct kl_counts *counts, uint64_t *bad)
{
    const kl_sampler first = first_sample(job, x, y);
    const float pixel_size = kl_camera_pixel_size(&job->camera, 1.0f);
    const bool blurred = is_blurred(job);
    struct kl_reuse reuse = {0};

    memset(values, 0, VALUES * sizeof *values);
    for (uint32_t i = 0; i < job->spp; ++i) {
        kl_sampler sampler = kl_sampler_make(first.index + i, first.seed);
        const kl_vec2 u = kl_sampler_2d(&sampler);
        struct kl_camera moved;
        const struct kl_camera *camera = &job->camera;
        if (blurred) {
            const float time = sample_time(job, sampler.index, sampler.seed);
            moved = job->camera;
            if (job->camera_count > 1) {
                moved = kl_camera_at(job->cameras, job->camera_count, time);
            }
            moved.time = time;
            camera = &moved;
        }
        const kl_ray ray = kl_camera_ray(camera, (float)x + u.x, (float)y + u.y);
        struct kl_parts parts;
        float sample[SAMPLED];
        if (job->shade.indirect == KL_INDIRECT_PATH) {
            kl_shade_path(&job->shade, ray, &sampler, counts, &parts);
        } else {
            kl_shade_cached(&job->shade, ray, &sampler, pixel_size, &reuse, counts, &parts);
        }
        sample_values(&parts, sample);
        if (!kl_v3_isfinite(kl_v3(sample[0], sample[1], sample[2]))) {
            ++*bad;
            continue;
        }
        for (int k = 0; k < SAMPLED; ++k) {
            values[k] += sample[k];
        }
    }
    for (int k = 0; k < SAMPLED; ++k) {
        values[k] /= (float)job->spp;
    }
    return center_values(job, x, y, values);
}

static void store_pixel(const struct sinks *sinks, size_t i, const float values[VALUES],
                        uint32_t id)
{
    for (int k = 0; k < VALUES; ++k) {
        if (sinks->floats[k] != NULL) sinks->floats[k][i] = values[k];
    }
    if (sinks->ids != NULL) sinks->ids[i] = id;
}

static void add_counts(struct kl_counts *sum, const struct kl_counts *c)
{
    sum->primary += c->primary;
    sum->shadow += c->shadow;
    sum->path += c->path;
    sum->late += c->late;
    sum->lookups += c->lookups;
    sum->lookup_hits += c->lookup_hits;
    sum->reused += c->reused;
}

kl_status kl_frame_render(const struct kl_frame_job *job, struct kl_image *image,
                          struct kl_counts *counts, uint64_t *bad_samples, struct kl_err *err)
{
    const uint32_t w = job->camera.width;
    const uint32_t h = job->camera.height;
    const uint32_t columns = (w + TILE - 1) / TILE;
    const uint32_t tiles = columns * ((h + TILE - 1) / TILE);
    const struct sinks sinks = find_sinks(image);
    struct kl_counts total = {0};
    uint64_t bad_total = 0;
    atomic_bool stop = false;
    atomic_uint done = 0;

#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t t = 0; t < tiles; ++t) {
        struct kl_counts local = {0};
        uint64_t bad = 0;
        if (atomic_load(&stop)) continue;
        const uint32_t x0 = t % columns * TILE;
        const uint32_t y0 = t / columns * TILE;
        for (uint32_t k = 0; k < TILE * TILE; ++k) {
            const uint32_t x = x0 + k % TILE;
            const uint32_t y = y0 + k / TILE;
            float values[VALUES];
            if (x >= w || y >= h) continue;
            const uint32_t id = render_pixel(job, x, y, values, &local, &bad);
            store_pixel(&sinks, (size_t)y * w + x, values, id);
        }
#pragma omp critical(kl_frame_counts)
        {
            add_counts(&total, &local);
            bad_total += bad;
        }
        const unsigned finished = atomic_fetch_add(&done, 1) + 1;
        if (omp_get_thread_num() == 0 && job->progress != NULL &&
            job->progress(job->progress_context, (double)finished / tiles)) {
            atomic_store(&stop, true);
        }
    }
    *counts = total;
    *bad_samples = bad_total;
    if (atomic_load(&stop)) return kl_fail(err, KL_ERR_INTERRUPTED, "interrupted");
    return KL_OK;
}
