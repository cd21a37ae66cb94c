/* Light along one camera ray, split into the parts that the image layers want. */
#ifndef KL_SRC_RENDER_SHADE_H
#define KL_SRC_RENDER_SHADE_H

#include "kernels/gather.h"

#include <stdbool.h>
#include <stdint.h>

struct kl_swept;

enum kl_indirect { KL_INDIRECT_CACHE, KL_INDIRECT_PATH, KL_INDIRECT_OFF };

struct kl_counts { /* of rays and look-ups, for the report */
    uint64_t primary, shadow, path, late;
    uint64_t lookups, lookup_hits, reused;
};

/* The cache of another instant, whose word counts beside that of the frame's own. */
struct kl_shade_moment {
    const kl_scene_view *scene; /* the frame's triangles where they are then; not traced */
    kl_level_view levels[KL_CACHE_LEVELS]; /* frozen */
    float weight;                          /* the frame's own has 1 */
};

/* What shading needs to know; constant while a frame renders, shared by all threads. */
struct kl_shade_context {
    const kl_scene_view *scene; /* in motion, where anything moves */
    const kl_scene_view
        *reference;               /* the same hits where the records are: at the shutter's centre */
    const struct kl_swept *swept; /* NULL: nothing moves */
    kl_level_view levels[KL_CACHE_LEVELS]; /* frozen */
    const struct kl_shade_moment *moments; /* blended into what `levels` say */
    uint32_t moment_count;
    enum kl_indirect indirect;
    kl_query query;            /* of level 0 */
    kl_gather_settings gather; /* for samples that no record serves */
};

/* The last queries of a pixel that went to the records (Krivanek, SIGGRAPH 2008 course): samples
 * that hit close by take their answer. Compared with queries that were evaluated, not with the last
 * that reused one, so nothing drifts. Some for each half of a pixel: where one sample spoke for
 * all, steep irradiance flickered with the place of that sample. Points and normals are those of
 * the frame's reference instant. */
enum { KL_REUSED = 4 };
struct kl_reuse {
    struct kl_reuse_entry {
        bool valid;
        kl_vec3 pos, smooth, bent;
        uint32_t object;
        kl_answer answer;
    } entries[KL_REUSED];
    uint32_t next; /* entry to replace */
};

struct kl_parts { /* radiance [nit] */
    kl_vec3 emission, diffuse_direct, diffuse_indirect, specular_direct, specular_indirect;
    kl_vec3 albedo;     /* diffuse albedo of the first hit */
    kl_vec3 irradiance; /* indirect irradiance there [lx]; path: estimate from this sample */
    float alpha;        /* 1: something was hit */
    float cache_weight, cache_error, late;
};

/* Shade by records or without indirect light (context->indirect CACHE or OFF). `pixel_size` [m] at
 * distance 1 decides what "close by" means for reuse. */
void kl_shade_cached(const struct kl_shade_context *context, kl_ray ray, kl_sampler *sampler,
                     float pixel_size, struct kl_reuse *reuse, struct kl_counts *counts,
                     struct kl_parts *parts);

/* Shade by path tracing: unbiased, with multiple importance sampling (Veach and Guibas 1995, power
 * heuristic) and Russian roulette. The reference for everything else. */
void kl_shade_path(const struct kl_shade_context *context, kl_ray ray, kl_sampler *sampler,
                   struct kl_counts *counts, struct kl_parts *parts);

#endif
