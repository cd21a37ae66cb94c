#include "src/app/json_text.h"

#include "src/base/file.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

kl_status kl_json_write(const struct json_t *root, const char *path, struct kl_err *err)
{
    /* 9 digits: seconds and errors stay readable, counts are integers and stay exact. */
    const size_t flags = JSON_INDENT(2) | JSON_REAL_PRECISION(9);
    kl_status st = KL_OK;
    char *text = json_dumps(root, flags);

    if (text == NULL) return kl_fail(err, KL_ERR_NO_MEMORY, "out of memory");
    if (path == NULL) {
        if (puts(text) < 0) st = kl_fail_errno(err, "stdout");
    } else {
        const size_t size = strlen(text);
        text[size] = '\n';
        st = kl_file_replace(path, text, size + 1, err);
    }
    free(text);
    return st;
}

kl_status kl_json_put(struct json_t *object, const char *key, struct json_t *value,
                      struct kl_err *err)
{
    if (json_object_set_new(object, key, value) == 0) return KL_OK;
    return kl_fail(err, KL_ERR_NO_MEMORY, "JSON: no memory or not a finite number: %s", key);
}
