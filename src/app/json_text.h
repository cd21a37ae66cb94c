/* JSON on its way out. */
#ifndef KL_SRC_APP_JSON_TEXT_H
#define KL_SRC_APP_JSON_TEXT_H

#include "src/base/status.h"

struct json_t;

/* Write `root` to a file, or to stdout where `path` is NULL. */
kl_status kl_json_write(const struct json_t *root, const char *path,
                        struct kl_err *err) KL_MUST_CHECK;
/* obj[key] = value, whose reference is taken also on failure; NULL counts as out of memory. */
kl_status kl_json_put(struct json_t *object, const char *key, struct json_t *value,
                      struct kl_err *err) KL_MUST_CHECK;

#endif
