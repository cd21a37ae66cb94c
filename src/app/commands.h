/* What main.c can start. Each gets parsed options, prints results to stdout, and returns a status
 * that main.c turns into a message and an exit code. */
#ifndef KL_SRC_APP_COMMANDS_H
#define KL_SRC_APP_COMMANDS_H

#include "src/app/options.h"

kl_status kl_command_render(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_bake(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_compare(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_scene(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_devices(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_cache_info(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_cache_check(const struct kl_options *options,
                                 struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_flicker(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_cache_merge(const struct kl_options *options,
                                 struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_cache_prune(const struct kl_options *options,
                                 struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_cache_dump(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_cache_diff(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_cache_view(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_command_sheet(const struct kl_options *options, struct kl_err *err) KL_MUST_CHECK;

#endif
