/* The command line: docs/cli.md. */
#ifndef KL_SRC_APP_OPTIONS_H
#define KL_SRC_APP_OPTIONS_H

#include "sequences/frames.h"
#include "sequences/shutter.h"
#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum kl_cache_mode {
    KL_CACHE_MODE_EXTEND,
    KL_CACHE_MODE_FREEZE,
    KL_CACHE_MODE_FREEZE_FILL,
    KL_CACHE_MODE_REBUILD,
    KL_CACHE_MODE_OFF,
};
enum kl_indirect_option {
    KL_INDIRECT_OPTION_CACHE,
    KL_INDIRECT_OPTION_PATH,
    KL_INDIRECT_OPTION_OFF
};
enum kl_progress_mode {
    KL_PROGRESS_AUTO,
    KL_PROGRESS_TERMINAL, /* auto, where stderr is a terminal */
    KL_PROGRESS_PLAIN,
    KL_PROGRESS_JSON,
    KL_PROGRESS_OFF,
};

enum kl_view_by {
    KL_VIEW_BY_LEVEL,
    KL_VIEW_BY_AGE,
    KL_VIEW_BY_ERROR,
    KL_VIEW_BY_LATE,
    KL_VIEW_BY_USE,
};

enum { KL_CACHE_BLEND_MOST = 8 }; /* frames each way: 17 scenes with their caches in memory */

/* Defaults are filled in. Strings are owned; NULL: not given. */
struct kl_options {
    double start; /* kl_seconds() when the program began */
    char *command_line;
    size_t argument_count; /* what is not an option */
    char **arguments;
    bool help; /* --help was asked for and has been printed */

    char *env, *animation;
    bool has_frames;
    struct kl_frames frames;
    struct kl_fps fps;
    struct kl_shutter shutter;
    struct kl_shutter_curve shutter_curve;
    char *camera, *path;
    uint32_t turntable; /* frames of a turn, 0: none */
    bool object_turns;  /* the turntable carries the object, not the camera */
    uint32_t width, height, spp;

    enum kl_indirect_option indirect;
    enum kl_cache_mode cache_mode;
    uint32_t cache_blend; /* frames each way whose caches are blended, 0: none */
    bool carry;           /* records of a moving scene go from frame to frame */
    char *cache, *device, *preset;
    double error;
    bool split_sphere;            /* rule of the radii, for comparison */
    double verify;                /* share of the pixels that is gathered anew, 0: none */
    uint32_t rays, threads, seed; /* threads 0: all cores */

    char *out, *aov;
    bool overwrite, png;
    double time_limit; /* [s], 0: none */
    char *report;
    enum kl_progress_mode progress;

    bool json; /* --json was given; without a file: to stdout */
    char *json_file, *diff;
    char *reference, *layer, *plot, *heat;
    size_t reference_at; /* arguments that came before --reference */
    bool repair;
    char *output;
    uint32_t older_than; /* generations, 0: any age */
    bool unused;
    double unused_for;           /* [s], 0: not asked */
    uint64_t max_bytes;          /* 0: any size */
    char *inside, *outside;      /* boxes: x,y,z,x,y,z */
    double mask_above, exposure; /* [nit], 0: no mask; [stops] */
    uint32_t columns, reduce;
    double max_difference; /* relative, < 0: none asked */
    enum kl_view_by view_by;
};

enum kl_option_set {
    KL_OPTIONS_RENDER,
    KL_OPTIONS_SCENE,
    KL_OPTIONS_COMPARE,
    KL_OPTIONS_JSON,
    KL_OPTIONS_SHEET,
    KL_OPTIONS_CACHE_CHECK,
    KL_OPTIONS_CACHE_MERGE,
    KL_OPTIONS_CACHE_PRUNE,
    KL_OPTIONS_CACHE_DUMP,
    KL_OPTIONS_CACHE_DIFF,
    KL_OPTIONS_CACHE_VIEW,
    KL_OPTIONS_FLICKER,
};

/* What one command takes. */
struct kl_option_use {
    const char *name;      /* "keeplight render" */
    const char *arguments; /* for help: "SCENE" */
    size_t least, most;    /* number of arguments */
    enum kl_option_set set;
};

/* argv[0] is the command's name. KL_ERR_USAGE: the message names the option. *out is the caller's:
 * kl_options_fini, also after a failure. */
kl_status kl_options_parse(int argc, const char **argv, const struct kl_option_use *use,
                           struct kl_options *out, struct kl_err *err) KL_MUST_CHECK;
void kl_options_fini(struct kl_options *options);

/* Names of the values, as the command line has them. */
const char *kl_cache_mode_name(enum kl_cache_mode mode);
const char *kl_indirect_name(enum kl_indirect_option indirect);

#endif
