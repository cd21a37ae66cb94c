/* The scene that the command line names, with its sky. */
#ifndef KL_SRC_APP_SCENE_FILE_H
#define KL_SRC_APP_SCENE_FILE_H

#include "src/app/options.h"
#include "src/scene/scene.h"

/* Read arguments[0] and --env; warnings go to stderr. *animation: --animation, KL_NONE for all.
 * *out is the caller's: kl_scene_destroy. */
kl_status kl_scene_file_load(const struct kl_options *options, struct kl_scene **out,
                             uint32_t *animation, struct kl_err *err) KL_MUST_CHECK;

/* Names of KL_NEED_* bits, in their order; NULL ends the list. `names` holds KL_NEED_NAMES. */
enum { KL_NEED_NAMES = 16 };
void kl_need_names(uint32_t needs, const char *names[KL_NEED_NAMES]);

#endif
