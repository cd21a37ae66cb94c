#include "src/app/options.h"

#include "sequences/duration.h"
#include "src/app/option_tables.h"
#include "src/app/option_text.h"
#include "src/base/clock.h"
#include "src/base/memory.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Frames of a turn where --turntable object gives none: 5 seconds. */
enum { OBJECT_TURN = 120 };

static const struct kl_option_word movings[] = {{"rebuild", 0}, {"carry", 1}, {NULL, 0}};
static const struct kl_option_word radius_rules[] = {
    {"hessian", 0}, {"split-sphere", 1}, {NULL, 0}};

/* The names before the synonyms: kl_cache_mode_name takes the first. */
static const struct kl_option_word cache_modes[] = {
    {"extend", KL_CACHE_MODE_EXTEND},
    {"freeze", KL_CACHE_MODE_FREEZE},
    {"freeze-fill", KL_CACHE_MODE_FREEZE_FILL},
    {"rebuild", KL_CACHE_MODE_REBUILD},
    {"off", KL_CACHE_MODE_OFF},
    {"append", KL_CACHE_MODE_EXTEND},
    {"load", KL_CACHE_MODE_FREEZE},
    {"prepass", KL_CACHE_MODE_REBUILD},
    {NULL, 0},
};
static const struct kl_option_word indirects[] = {
    {"cache", KL_INDIRECT_OPTION_CACHE},
    {"path", KL_INDIRECT_OPTION_PATH},
    {"off", KL_INDIRECT_OPTION_OFF},
    {NULL, 0},
};
static const struct kl_option_word views[] = {
    {"level", KL_VIEW_BY_LEVEL}, {"age", KL_VIEW_BY_AGE}, {"error", KL_VIEW_BY_ERROR},
    {"late", KL_VIEW_BY_LATE},   {"use", KL_VIEW_BY_USE}, {NULL, 0},
};
static const struct kl_option_word progress_modes[] = {
    {"auto", KL_PROGRESS_AUTO},
    {"plain", KL_PROGRESS_PLAIN},
    {"json", KL_PROGRESS_JSON},
    {"off", KL_PROGRESS_OFF},
    {NULL, 0},
};

static const char *find_name(const struct kl_option_word *words, int value)
{
    while (words->word != NULL && words->value != value) {
        ++words;
    }
    return words->word;
}

const char *kl_cache_mode_name(enum kl_cache_mode mode)
{
    return find_name(cache_modes, (int)mode);
}

const char *kl_indirect_name(enum kl_indirect_option indirect)
{
    return find_name(indirects, (int)indirect);
}

static kl_status set_text(char **out, const char *text, struct kl_err *err)
{
    free(*out);
    *out = NULL;
    return kl_copy_string(out, text, err);
}

static kl_status set_word(const char *option, const char *text, const struct kl_option_word *words,
                          int *out, struct kl_err *err)
{
    return kl_option_read_word(option, text, words, out, err);
}

static kl_status set_frames(struct kl_options *o, const char *text, struct kl_err *err)
{
    kl_frames_fini(&o->frames);
    kl_status st = kl_frames_parse(text, &o->frames, err);
    o->has_frames = st == KL_OK;
    return st;
}

static kl_status set_choice(struct kl_options *o, int id, const char *text, struct kl_err *err)
{
    int value = 0;
    kl_status st = KL_OK;

    if (id == OPT_INDIRECT) {
        st = set_word("indirect", text, indirects, &value, err);
        if (st == KL_OK) o->indirect = (enum kl_indirect_option)value;
    } else if (id == OPT_BY) {
        st = set_word("by", text, views, &value, err);
        if (st == KL_OK) o->view_by = (enum kl_view_by)value;
    } else if (id == OPT_CACHE_MODE) {
        st = set_word("cache-mode", text, cache_modes, &value, err);
        if (st == KL_OK) o->cache_mode = (enum kl_cache_mode)value;
    } else if (id == OPT_MOVING) {
        st = set_word("moving", text, movings, &value, err);
        o->carry = value == 1;
    } else if (id == OPT_RADIUS) {
        st = set_word("radius", text, radius_rules, &value, err);
        o->split_sphere = value == 1;
    } else {
        st = set_word("progress", text, progress_modes, &value, err);
        if (st == KL_OK) o->progress = (enum kl_progress_mode)value;
    }
    return st;
}

static void set_flag(struct kl_options *o, int id)
{
    if (id == OPT_HELP) o->help = true;
    if (id == OPT_PNG) o->png = true;
    if (id == OPT_OVERWRITE) o->overwrite = true;
    if (id == OPT_REPAIR) o->repair = true;
    if (id == OPT_UNUSED) o->unused = true;
}

/* "96" or "camera:96": the camera goes round; "object", "object:96": the object turns. */
static kl_status set_turntable(struct kl_options *o, const char *text, struct kl_err *err)
{
    o->object_turns = strncmp(text, "object", 6) == 0;
    o->turntable = OBJECT_TURN;
    if (strcmp(text, "object") == 0) return KL_OK;
    if (strncmp(text, "object:", 7) == 0 || strncmp(text, "camera:", 7) == 0) text += 7;
    return kl_option_read_u32("turntable", text, 1, 1000000, &o->turntable, err);
}

/* Options whose value is a number. */
static kl_status set_number(struct kl_options *o, int id, const char *text, struct kl_err *err)
{
    switch (id) {
    case OPT_FPS:
        return kl_fps_parse(text, &o->fps, err);
    case OPT_SHUTTER:
        return kl_shutter_parse_length(text, &o->shutter.length, err);
    case OPT_SHUTTER_OFFSET:
        return kl_shutter_parse_offset(text, &o->shutter.offset, err);
    case OPT_SHUTTER_CURVE:
        return kl_shutter_parse_curve(text, &o->shutter_curve, err);
    case OPT_TURNTABLE:
        return set_turntable(o, text, err);
    case OPT_SIZE:
        return kl_option_read_size("size", text, &o->width, &o->height, err);
    case OPT_SPP:
        return kl_option_read_u32("spp", text, 1, 65536, &o->spp, err);
    case OPT_CACHE_BLEND:
        return kl_option_read_u32("cache-blend", text, 0, KL_CACHE_BLEND_MOST, &o->cache_blend,
                                  err);
    case OPT_ERROR:
        return kl_option_read_number("error", text, 0.001, 1.0, &o->error, err);
    case OPT_VERIFY:
        return kl_option_read_share("verify", text, &o->verify, err);
    case OPT_RAYS:
        return kl_option_read_u32("rays", text, 16, 65536, &o->rays, err);
    case OPT_THREADS:
        return kl_option_read_u32("threads", text, 1, 1024, &o->threads, err);
    case OPT_SEED:
        return kl_option_read_u32("seed", text, 0, UINT32_MAX, &o->seed, err);
    case OPT_TIME_LIMIT:
        return kl_duration_parse(text, &o->time_limit, err);
    case OPT_COLUMNS:
        return kl_option_read_u32("columns", text, 1, 1000, &o->columns, err);
    case OPT_OLDER_THAN:
        return kl_option_read_u32("older-than", text, 1, UINT32_MAX, &o->older_than, err);
    case OPT_UNUSED_FOR:
        return kl_duration_parse(text, &o->unused_for, err);
    case OPT_MAX_BYTES:
        return kl_option_read_bytes("max-bytes", text, &o->max_bytes, err);
    case OPT_REDUCE:
        return kl_option_read_u32("reduce", text, 1, 64, &o->reduce, err);
    case OPT_MAX_DIFFERENCE:
        return kl_option_read_number("max-difference", text, 0.0, 2.0, &o->max_difference, err);
    case OPT_MASK_ABOVE:
        return kl_option_read_number("mask-above", text, 0.0, 1e30, &o->mask_above, err);
    default:
        return kl_option_read_number("exposure", text, -64.0, 64.0, &o->exposure, err);
    }
}

static kl_status set_option(struct kl_options *o, int id, const char *text, struct kl_err *err)
{
    switch (id) {
    case OPT_ENV:
        return set_text(&o->env, text, err);
    case OPT_ANIMATION:
        return set_text(&o->animation, text, err);
    case OPT_FRAMES:
        return set_frames(o, text, err);
    case OPT_CAMERA:
        return set_text(&o->camera, text, err);
    case OPT_PATH:
        return set_text(&o->path, text, err);
    case OPT_CACHE:
        return set_text(&o->cache, text, err);
    case OPT_PRESET:
        return set_text(&o->preset, text, err);
    case OPT_DEVICE:
        return set_text(&o->device, text, err);
    case OPT_OUT:
        return set_text(&o->out, text, err);
    case OPT_AOV:
        return set_text(&o->aov, text, err);
    case OPT_REPORT:
        return set_text(&o->report, text, err);
    case OPT_DIFF:
        return set_text(&o->diff, text, err);
    case OPT_OUTPUT:
        return set_text(&o->output, text, err);
    case OPT_INSIDE:
        return set_text(&o->inside, text, err);
    case OPT_OUTSIDE:
        return set_text(&o->outside, text, err);
    case OPT_REFERENCE:
        return set_text(&o->reference, text, err);
    case OPT_LAYER:
        return set_text(&o->layer, text, err);
    case OPT_PLOT:
        return set_text(&o->plot, text, err);
    case OPT_HEAT:
        return set_text(&o->heat, text, err);
    case OPT_INDIRECT:
    case OPT_MOVING:
    case OPT_BY:
    case OPT_CACHE_MODE:
    case OPT_PROGRESS:
    case OPT_RADIUS:
        return set_choice(o, id, text, err);
    case OPT_JSON:
        o->json = true;
        return text == NULL ? KL_OK : set_text(&o->json_file, text, err);
    case OPT_HELP:
    case OPT_PNG:
    case OPT_OVERWRITE:
    case OPT_RESUME:
    case OPT_REPAIR:
    case OPT_UNUSED:
        set_flag(o, id);
        return KL_OK;
    default:
        return set_number(o, id, text, err);
    }
}

static kl_status apply_preset(struct kl_options *o, struct kl_err *err)
{
    static const struct {
        double error;
        uint32_t spp;
    } presets[] = {{0.06, 4}, {0.02, 64}, {0.02, 16}, {0.01, 64}};
    static const struct kl_option_word names[] = {
        {"draft", 0}, {"still", 1}, {"animation", 2}, {"final", 3}, {NULL, 0}};
    int i = 2;

    if (o->preset != NULL) {
        kl_status st = set_word("preset", o->preset, names, &i, err);
        if (st != KL_OK) return st;
    }
    if (o->error <= 0.0) o->error = presets[i].error;
    if (o->spp == 0) o->spp = presets[i].spp;
    return KL_OK;
}

static kl_status join_command_line(struct kl_options *o, int argc, const char **argv,
                                   struct kl_err *err)
{
    size_t size = 1;
    size_t used = 0;

    for (int i = 0; i < argc; ++i) {
        size += strlen(argv[i]) + 1;
    }
    kl_status st = kl_alloc_array(&o->command_line, size, 1, err);
    for (int i = 0; st == KL_OK && i < argc; ++i) {
        used += (size_t)snprintf(o->command_line + used, size - used, "%s%s", i > 0 ? " " : "",
                                 argv[i]);
    }
    return st;
}

static kl_status add_argument(struct kl_options *o, size_t *capacity, const char *text,
                              struct kl_err *err)
{
    kl_status st =
        kl_grow_array(&o->arguments, capacity, o->argument_count + 1, sizeof *o->arguments, err);
    if (st == KL_OK) st = kl_copy_string(&o->arguments[o->argument_count], text, err);
    if (st == KL_OK) ++o->argument_count;
    return st;
}

static void move_last_argument_to_front(struct kl_options *o)
{
    const size_t last = o->argument_count - 1;
    char *argument = o->arguments[last];

    memmove(o->arguments + 1, o->arguments, last * sizeof *o->arguments);
    o->arguments[0] = argument;
    ++o->reference_at;
}

static bool ends_with(const char *text, const char *end)
{
    const size_t n = strlen(text);
    const size_t m = strlen(end);

    return n >= m && strcmp(text + n - m, end) == 0;
}

/* "--json SCENE.glb": popt takes the word after an option with an optional value. Where a
 * positional argument is missing, or the word is an image, it was meant as an argument. */
static kl_status settle_arguments(struct kl_options *o, poptContext con, size_t least,
                                  struct kl_err *err)
{
    size_t capacity = 0;
    kl_status st = KL_OK;
    const char *text;

    while (st == KL_OK && (text = poptGetArg(con)) != NULL) {
        if (strcmp(text, "-") == 0 && o->json) continue;
        st = add_argument(o, &capacity, text, err);
    }
    if (st == KL_OK && o->json_file != NULL &&
        (o->argument_count < least || ends_with(o->json_file, ".exr"))) {
        st = add_argument(o, &capacity, o->json_file, err);
        if (st == KL_OK) move_last_argument_to_front(o);
        free(o->json_file);
        o->json_file = NULL;
    }
    return st;
}

static size_t count_arguments(poptContext con)
{
    const char **arguments = poptGetArgs(con);
    size_t n = 0;

    while (arguments != NULL && arguments[n] != NULL) {
        ++n;
    }
    return n;
}

static kl_status read_options(struct kl_options *o, poptContext con, struct kl_err *err)
{
    kl_status st = KL_OK;
    int id;

    while (st == KL_OK && (id = poptGetNextOpt(con)) > 0) {
        char *text = poptGetOptArg(con);
        if (id == OPT_REFERENCE) o->reference_at = count_arguments(con);
        st = set_option(o, id, text, err);
        free(text);
    }
    if (st == KL_OK && id < -1) {
        st = kl_fail(err, KL_ERR_USAGE, "%s: %s", poptBadOption(con, POPT_BADOPTION_NOALIAS),
                     poptStrerror(id));
    }
    return st;
}

static kl_status check_arguments(const struct kl_options *o, const struct kl_option_use *use,
                                 struct kl_err *err)
{
    if (o->argument_count < use->least) {
        return kl_fail(err, KL_ERR_USAGE, "%s: expected %s; see %s --help", use->name,
                       use->arguments, use->name);
    }
    if (o->argument_count > use->most) {
        return kl_fail(err, KL_ERR_USAGE, "%s: unexpected argument '%s'", use->name,
                       o->arguments[use->most]);
    }
    const int flights =
        (o->camera != NULL) + (o->turntable > 0 && !o->object_turns) + (o->path != NULL);
    if (flights > 1) {
        return kl_fail(err, KL_ERR_USAGE, "--camera, --turntable and --path exclude each other");
    }
    if (o->carry && o->cache_blend > 0) {
        return kl_fail(err, KL_ERR_USAGE, "--moving carry and --cache-blend exclude each other");
    }
    return KL_OK;
}

kl_status kl_options_parse(int argc, const char **argv, const struct kl_option_use *use,
                           struct kl_options *out, struct kl_err *err)
{
    poptContext con = NULL;
    kl_status st = KL_OK;

    *out = (struct kl_options){.start = kl_seconds(),
                               .fps = {24, 1},
                               .width = 1280,
                               .height = 720,
                               .rays = 1024,
                               .max_difference = -1.0};
    st = join_command_line(out, argc, argv, err);
    if (st != KL_OK) return st;
    con = poptGetContext(NULL, argc, argv, kl_option_table(use->set), 0);
    if (con == NULL) return kl_fail(err, KL_ERR_NO_MEMORY, "out of memory");
    poptSetOtherOptionHelp(con, use->arguments);
    st = read_options(out, con, err);
    if (st == KL_OK && out->help) {
        poptPrintHelp(con, stdout, 0);
    } else if (st == KL_OK) {
        st = settle_arguments(out, con, use->least, err);
        if (st == KL_OK) st = check_arguments(out, use, err);
        if (st == KL_OK) st = apply_preset(out, err);
    }
    poptFreeContext(con);
    return st;
}

void kl_options_fini(struct kl_options *options)
{
    struct kl_options *o = options;
    char *const texts[] = {o->output,    o->inside,    o->outside, o->command_line, o->env,
                           o->animation, o->camera,    o->path,    o->cache,        o->device,
                           o->preset,    o->out,       o->aov,     o->report,       o->json_file,
                           o->diff,      o->reference, o->layer,   o->plot,         o->heat};

    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; ++i) {
        free(texts[i]);
    }
    for (size_t i = 0; i < o->argument_count; ++i) {
        free(o->arguments[i]);
    }
    free(o->arguments);
    kl_frames_fini(&o->frames);
    *o = (struct kl_options){0};
}
