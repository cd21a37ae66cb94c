/* All records of a cache as one list: what dump, diff and view go through. */
#ifndef KL_SRC_APP_RECORD_LIST_H
#define KL_SRC_APP_RECORD_LIST_H

#include "kernels/cache_data.h"
#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct kl_record_item {
    kl_record_hot hot;
    kl_record_cold cold;
    double pos[3]; /* [m] world space */
    uint32_t level;
    uint32_t born;    /* generation that it was first kept in */
    bool used;        /* a render has told that it served; of level 0 only */
    uint32_t instant; /* number of the store in a moving scene's cache, by name; else 0 */
};

struct kl_record_list {
    size_t count, capacity;
    struct kl_record_item *items; /* by instant, level, position on the Z-curve */
    char **instants;              /* names, "t-..."; "" for a cache of a still scene */
    size_t instant_count;
};

/* Records that stand for the same place are there once. *out zeroed before; kl_record_list_fini
 * also after a failure. */
kl_status kl_record_list_load(const char *dir, struct kl_record_list *out,
                              struct kl_err *err) KL_MUST_CHECK;
void kl_record_list_fini(struct kl_record_list *list);

#endif
