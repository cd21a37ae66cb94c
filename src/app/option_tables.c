#include "src/app/option_tables.h"

#define TEXT(name, id, help, value)                                                                \
    {                                                                                              \
        name, '\0', POPT_ARG_STRING, NULL, id, help, value                                         \
    }
#define FLAG(name, id, help)                                                                       \
    {                                                                                              \
        name, '\0', POPT_ARG_NONE, NULL, id, help, NULL                                            \
    }
#define HELP                                                                                       \
    {                                                                                              \
        "help", 'h', POPT_ARG_NONE, NULL, OPT_HELP, "Print this", NULL                             \
    }
#define JSON                                                                                       \
    {                                                                                              \
        "json", '\0', POPT_ARG_STRING | POPT_ARGFLAG_OPTIONAL, NULL, OPT_JSON,                     \
            "Write JSON to FILE, without one to stdout", "FILE"                                    \
    }
#define SCENE_OPTIONS                                                                              \
    TEXT("env", OPT_ENV, "Light from the sky: a lat-long OpenEXR image", "SKY.exr"),               \
        TEXT("animation", OPT_ANIMATION, "Animation of the scene to follow (default: all)",        \
             "NAME")

#define CAMERA_OPTIONS                                                                             \
    TEXT("camera", OPT_CAMERA, "Camera of the scene (default: the first)", "NAME"),                \
        TEXT("turntable", OPT_TURNTABLE,                                                           \
             "Orbit the scene once in N frames; object:N turns the object instead (object: 120)",  \
             "N"),                                                                                 \
        TEXT("path", OPT_PATH, "Fly along a keyframed path", "FILE.json"),                         \
        TEXT("size", OPT_SIZE, "Image size (default: 1280x720)", "WxH"),                           \
        TEXT("spp", OPT_SPP, "Samples a pixel (default: 16)", "N")

static const struct poptOption render_options[] = {
    SCENE_OPTIONS,
    TEXT("frames", OPT_FRAMES, "Frames, as 1-48x2,60 (default: the animation's range, or 1)",
         "LIST"),
    TEXT("fps", OPT_FPS, "Frames a second; frame f is the instant f/fps (default: 24)", "RATE"),
    TEXT("shutter", OPT_SHUTTER, "Shutter: 180 (degrees) or 0.5f (frames) (default: 0, no blur)",
         "LENGTH"),
    TEXT("shutter-offset", OPT_SHUTTER_OFFSET, "Move the shutter's centre (default: 0)", "LENGTH"),
    TEXT("shutter-curve", OPT_SHUTTER_CURVE,
         "How it opens and closes: box, triangle, cosine or weights as 0,1,1,0 (default: box)",
         "CURVE"),
    CAMERA_OPTIONS,
    TEXT("indirect", OPT_INDIRECT,
         "Where indirect diffuse light comes from: cache, path or off (default: cache)", "HOW"),
    TEXT("cache", OPT_CACHE, "Cache folder (default: SCENE.klc beside the output)", "DIR.klc"),
    TEXT("cache-mode", OPT_CACHE_MODE,
         "extend, freeze, freeze-fill, rebuild or off; append, load and prepass are other words "
         "for extend, freeze and rebuild (default: extend)",
         "MODE"),
    TEXT("cache-blend", OPT_CACHE_BLEND,
         "For comparison: where things move, blend the caches of N frames each way (default: 0)",
         "N"),
    TEXT("moving", OPT_MOVING,
         "Where things move: rebuild the records of every frame, or carry them on from the frame "
         "before, with a third of the rays; a frame then depends on those before it (default: "
         "rebuild)",
         "HOW"),
    TEXT("error", OPT_ERROR, "Relative error of indirect irradiance to aim at (default: 0.02)",
         "E"),
    TEXT("verify", OPT_VERIFY,
         "Measure: extend until --error is met, gather this share of the pixels anew, as 1%",
         "SHARE"),
    TEXT("radius", OPT_RADIUS,
         "Advanced: what decides how far records serve: hessian or split-sphere (default: hessian)",
         "RULE"),
    TEXT("preset", OPT_PRESET,
         "Choose --error and --spp together: draft, still, animation or final", "NAME"),
    TEXT("rays", OPT_RAYS, "Advanced: gather rays of a record (default: 1024)", "N"),
    TEXT("device", OPT_DEVICE, "Who gathers: auto, embree, opencl or opencl:N (default: auto)",
         "WHO"),
    TEXT("threads", OPT_THREADS, "Threads (default: all cores); results do not depend on it", "N"),
    TEXT("seed", OPT_SEED, "Seed of the image samples (default: 0)", "N"),
    TEXT("out", OPT_OUT, "Image files (default: SCENE.####.exr)", "PATTERN"),
    TEXT("aov", OPT_AOV, "Layers beside beauty: a list, all or none (default: all)", "LIST"),
    FLAG("png", OPT_PNG, "Write a PNG preview beside each image"),
    FLAG("overwrite", OPT_OVERWRITE, "Render frames that exist already"),
    FLAG("resume", OPT_RESUME, "Skip frames that are done (always so, without --overwrite)"),
    TEXT("time-limit", OPT_TIME_LIMIT, "Stop after this long, as 1h30m, with exit code 5", "TIME"),
    TEXT("report", OPT_REPORT, "Write what it took and how good it is as JSON", "FILE.json"),
    TEXT("progress", OPT_PROGRESS, "Progress on stderr: auto, plain, json or off (default: auto)",
         "HOW"),
    HELP,
    POPT_TABLEEND,
};
static const struct poptOption scene_options[] = {SCENE_OPTIONS, JSON, HELP, POPT_TABLEEND};
static const struct poptOption compare_options[] = {
    JSON,
    TEXT("diff", OPT_DIFF, "Draw the relative error: red too bright, blue too dark", "FILE.png"),
    TEXT("layer", OPT_LAYER, "Layer to compare (default: beauty)", "NAME"),
    TEXT("mask-above", OPT_MASK_ABOVE, "Leave out pixels whose reference is above X (lamps)", "X"),
    HELP,
    POPT_TABLEEND,
};
static const struct poptOption json_options[] = {JSON, HELP, POPT_TABLEEND};
static const struct poptOption sheet_options[] = {
    TEXT("columns", OPT_COLUMNS, "Images in a row (default: nearly square)", "N"),
    TEXT("reduce", OPT_REDUCE, "Make every image N times smaller (default: 1)", "N"),
    TEXT("exposure", OPT_EXPOSURE, "Brighten by 2^STOPS (default: 0)", "STOPS"),
    HELP,
    POPT_TABLEEND,
};
static const struct poptOption flicker_options[] = {
    TEXT("reference", OPT_REFERENCE, "The same frames of a reference: a pattern, or the files",
         "FRAMES"),
    TEXT("layer", OPT_LAYER, "Layer to measure (default: irradiance, without it beauty)", "NAME"),
    JSON,
    TEXT("plot", OPT_PLOT, "Plot the change from frame to frame (gnuplot)", "FILE.svg|png"),
    TEXT("heat", OPT_HEAT, "Draw the flicker in the last frame: white is 2 %", "FILE.png"),
    HELP,
    POPT_TABLEEND,
};

static const struct poptOption check_options[] = {
    FLAG("repair", OPT_REPAIR, "Drop what is damaged, keep the rest, say what was lost"), JSON,
    HELP, POPT_TABLEEND};
static const struct poptOption merge_options[] = {
    {"output", 'o', POPT_ARG_STRING, NULL, OPT_OUTPUT, "The new cache", "DIR.klc"},
    JSON,
    HELP,
    POPT_TABLEEND,
};
static const struct poptOption dump_options[] = {
    {"output", 'o', POPT_ARG_STRING, NULL, OPT_OUTPUT, "The table, points or volumes",
     "FILE.csv|.ply|.vdb"},
    JSON,
    HELP,
    POPT_TABLEEND,
};
static const struct poptOption diff_options[] = {
    TEXT("max-difference", OPT_MAX_DIFFERENCE,
         "Exit code 5 where values differ by more, relatively, or records are missing", "X"),
    JSON,
    HELP,
    POPT_TABLEEND,
};
static const struct poptOption view_options[] = {
    TEXT("reduce", OPT_REDUCE, "Draw radii N times smaller (default: 4)", "N"),
    TEXT("by", OPT_BY, "Colour: level, age, error, use or late (default: level)", "WHAT"),
    SCENE_OPTIONS,
    TEXT("frames", OPT_FRAMES, "The frame to draw over; of a list, the first", "N"),
    TEXT("fps", OPT_FPS, "Frames a second; frame f is the instant f/fps (default: 24)", "RATE"),
    CAMERA_OPTIONS,
    TEXT("rays", OPT_RAYS, "Gather rays of a record, as the cache was made with", "N"),
    TEXT("error", OPT_ERROR, "Relative error, as the cache was made with", "E"),
    TEXT("threads", OPT_THREADS, "Threads (default: all cores)", "N"),
    TEXT("out", OPT_OUT, "Image file (default: SCENE.####.exr); a PNG comes beside it", "PATTERN"),
    JSON,
    HELP,
    POPT_TABLEEND,
};
static const struct poptOption prune_options[] = {
    TEXT("older-than", OPT_OLDER_THAN, "Records first kept more than N generations ago", "N"),
    FLAG("unused", OPT_UNUSED, "Records that no render has used, as far as they told"),
    TEXT("unused-for", OPT_UNUSED_FOR, "Records that no render has used for so long, as 30d",
         "TIME"),
    TEXT("inside", OPT_INSIDE, "Records inside a box: two corners in metres", "X,Y,Z,X,Y,Z"),
    TEXT("outside", OPT_OUTSIDE, "Records outside a box", "X,Y,Z,X,Y,Z"),
    TEXT("max-bytes", OPT_MAX_BYTES, "The oldest and worst, until N bytes are left; K, M, G", "N"),
    JSON,
    HELP,
    POPT_TABLEEND,
};

static const struct poptOption *const option_sets[] = {
    [KL_OPTIONS_CACHE_CHECK] = check_options, [KL_OPTIONS_CACHE_MERGE] = merge_options,
    [KL_OPTIONS_CACHE_PRUNE] = prune_options, [KL_OPTIONS_CACHE_DUMP] = dump_options,
    [KL_OPTIONS_CACHE_DIFF] = diff_options,   [KL_OPTIONS_CACHE_VIEW] = view_options,
    [KL_OPTIONS_RENDER] = render_options,     [KL_OPTIONS_SCENE] = scene_options,
    [KL_OPTIONS_COMPARE] = compare_options,   [KL_OPTIONS_JSON] = json_options,
    [KL_OPTIONS_SHEET] = sheet_options,       [KL_OPTIONS_FLICKER] = flicker_options,
};

const struct poptOption *kl_option_table(enum kl_option_set set)
{
    return option_sets[set];
}
