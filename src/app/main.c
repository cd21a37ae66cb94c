#include "src/app/commands.h"
#include "src/app/exit_code.h"
#include "src/app/interrupt.h"
#include "src/app/version.h"
#include "src/base/memory.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MANY = 100000 };

static const struct command {
    const char *name, *verb; /* verb: second word, or NULL */
    struct kl_option_use use;
    kl_status (*run)(const struct kl_options *options, struct kl_err *err);
    const char *summary;
} commands[] = {
    {"render",
     NULL,
     {"keeplight render", "SCENE [OPTIONS]", 1, 1, KL_OPTIONS_RENDER},
     kl_command_render,
     "fill what is missing, render frames"},
    {"bake",
     NULL,
     {"keeplight bake", "SCENE [OPTIONS]", 1, 1, KL_OPTIONS_RENDER},
     kl_command_bake,
     "fill the cache along the camera's way, write no image"},
    {"cache",
     "info",
     {"keeplight cache info", "CACHE... [OPTIONS]", 1, MANY, KL_OPTIONS_JSON},
     kl_command_cache_info,
     "what a cache holds"},
    {"cache",
     "check",
     {"keeplight cache check", "CACHE... [OPTIONS]", 1, MANY, KL_OPTIONS_CACHE_CHECK},
     kl_command_cache_check,
     "whether a cache is whole; repair it"},
    {"cache",
     "merge",
     {"keeplight cache merge", "CACHE CACHE... -o CACHE [OPTIONS]", 1, MANY,
      KL_OPTIONS_CACHE_MERGE},
     kl_command_cache_merge,
     "one cache from several of one scene"},
    {"cache",
     "prune",
     {"keeplight cache prune", "CACHE... [OPTIONS]", 1, MANY, KL_OPTIONS_CACHE_PRUNE},
     kl_command_cache_prune,
     "drop records by age, place or size"},
    {"cache",
     "dump",
     {"keeplight cache dump", "CACHE -o FILE [OPTIONS]", 1, 1, KL_OPTIONS_CACHE_DUMP},
     kl_command_cache_dump,
     "records as a table, points or volumes"},
    {"cache",
     "diff",
     {"keeplight cache diff", "CACHE CACHE [OPTIONS]", 2, 2, KL_OPTIONS_CACHE_DIFF},
     kl_command_cache_diff,
     "what two caches share"},
    {"cache",
     "view",
     {"keeplight cache view", "CACHE SCENE [OPTIONS]", 2, 2, KL_OPTIONS_CACHE_VIEW},
     kl_command_cache_view,
     "records drawn over a frame"},
    {"compare",
     NULL,
     {"keeplight compare", "TEST.exr REFERENCE.exr [OPTIONS]", 2, 2, KL_OPTIONS_COMPARE},
     kl_command_compare,
     "error metrics of an image against a reference"},
    {"flicker",
     NULL,
     {"keeplight flicker", "FRAME.exr... [OPTIONS]", 2, MANY, KL_OPTIONS_FLICKER},
     kl_command_flicker,
     "how well the frames of a sequence hold together"},
    {"scene",
     NULL,
     {"keeplight scene", "SCENE [OPTIONS]", 1, 1, KL_OPTIONS_SCENE},
     kl_command_scene,
     "what was understood of a scene, what it needs"},
    {"devices",
     NULL,
     {"keeplight devices", "[OPTIONS]", 0, 0, KL_OPTIONS_JSON},
     kl_command_devices,
     "who can gather"},
    {"sheet",
     NULL,
     {"keeplight sheet", "SHEET.png FRAME.exr... [OPTIONS]", 2, MANY, KL_OPTIONS_SHEET},
     kl_command_sheet,
     "a contact sheet of frames"},
};
enum { COMMANDS = sizeof commands / sizeof commands[0] };

static void print_help(void)
{
    (void)printf(
        "keeplight %s: global illumination for animations that keeps the light\n\n"
        "usage: keeplight COMMAND [OPTIONS]; keeplight COMMAND --help lists its options\n\n",
        KL_VERSION);
    for (int i = 0; i < COMMANDS; ++i) {
        const struct command *c = &commands[i];
        (void)printf("  %-8s%-8s%s\n", c->name, c->verb != NULL ? c->verb : "", c->summary);
    }
    (void)printf("\n  --version       version and commit\n  --help          this\n\n"
                 "exit codes: 0 done, 1 bad input, 2 system or device, 3 interrupted, 4 cache "
                 "refused, 5 limit reached\n");
}

/* The command of argv[1] (and argv[2]); *words: how many name it. */
static const struct command *find_command(int argc, char **argv, int *words)
{
    for (int i = 0; i < COMMANDS; ++i) {
        const struct command *c = &commands[i];
        if (strcmp(argv[1], c->name) != 0) continue;
        *words = c->verb != NULL ? 2 : 1;
        if (c->verb == NULL || (argc > 2 && strcmp(argv[2], c->verb) == 0)) return c;
    }
    return NULL;
}

/* argv[0] is the last word of the command's name. */
static kl_status run_command(const struct command *command, int argc, char **argv,
                             struct kl_err *err)
{
    struct kl_options options = {0};
    const char **words = NULL;
    kl_status st = kl_alloc_array(&words, (size_t)argc + 1, sizeof *words, err);

    if (st != KL_OK) return st;
    words[0] = command->use.name; /* help and provenance show it as the program's name */
    for (int i = 1; i < argc; ++i) {
        words[i] = argv[i];
    }
    st = kl_options_parse(argc, words, &command->use, &options, err);
    if (st == KL_OK && !options.help) st = command->run(&options, err);
    kl_options_fini(&options);
    free(words);
    return st;
}

static kl_status dispatch(int argc, char **argv, struct kl_err *err)
{
    int words = 0;
    kl_status st = KL_OK;

    if (argc < 2) {
        print_help();
        return kl_fail(err, KL_ERR_USAGE, "no command");
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 ||
        strcmp(argv[1], "help") == 0) {
        print_help();
        return KL_OK;
    }
    if (strcmp(argv[1], "--version") == 0) {
        (void)printf("keeplight %s (%s)\n", KL_VERSION, KL_COMMIT);
        return KL_OK;
    }
    const struct command *command = find_command(argc, argv, &words);
    if (command == NULL && strcmp(argv[1], "cache") == 0) {
        return kl_fail(err, KL_ERR_USAGE,
                       "cache: expected info, check, merge, prune, dump, diff or view");
    }
    if (command == NULL) {
        return kl_fail(err, KL_ERR_USAGE, "'%s' is not a command; see keeplight --help", argv[1]);
    }
    st = kl_interrupt_watch(err);
    if (st != KL_OK) return st;
    return run_command(command, argc - words, argv + words, err);
}

int main(int argc, char **argv)
{
    struct kl_err err;
    kl_status st = dispatch(argc, argv, &err);

    if (st == KL_OK && fflush(stdout) != 0) st = kl_fail_errno(&err, "stdout");
    if (st != KL_OK) kl_say_error(&err);
    return kl_exit_code(st);
}
