/* Which options the commands take, as popt and --help want them. */
#ifndef KL_SRC_APP_OPTION_TABLES_H
#define KL_SRC_APP_OPTION_TABLES_H

#include "src/app/options.h"

#include <popt.h>

enum kl_option_id {
    OPT_HELP = 1,
    OPT_ENV,
    OPT_ANIMATION,
    OPT_FRAMES,
    OPT_FPS,
    OPT_SHUTTER,
    OPT_SHUTTER_OFFSET,
    OPT_SHUTTER_CURVE,
    OPT_CAMERA,
    OPT_TURNTABLE,
    OPT_PATH,
    OPT_SIZE,
    OPT_SPP,
    OPT_INDIRECT,
    OPT_CACHE,
    OPT_CACHE_MODE,
    OPT_CACHE_BLEND,
    OPT_MOVING,
    OPT_ERROR,
    OPT_VERIFY,
    OPT_RADIUS,
    OPT_PRESET,
    OPT_RAYS,
    OPT_DEVICE,
    OPT_THREADS,
    OPT_SEED,
    OPT_OUT,
    OPT_AOV,
    OPT_PNG,
    OPT_OVERWRITE,
    OPT_RESUME,
    OPT_TIME_LIMIT,
    OPT_REPORT,
    OPT_PROGRESS,
    OPT_JSON,
    OPT_DIFF,
    OPT_MASK_ABOVE,
    OPT_COLUMNS,
    OPT_REDUCE,
    OPT_EXPOSURE,
    OPT_REPAIR,
    OPT_OUTPUT,
    OPT_MAX_DIFFERENCE,
    OPT_BY,
    OPT_OLDER_THAN,
    OPT_UNUSED,
    OPT_UNUSED_FOR,
    OPT_MAX_BYTES,
    OPT_INSIDE,
    OPT_OUTSIDE,
    OPT_REFERENCE,
    OPT_LAYER,
    OPT_PLOT,
    OPT_HEAT,
};

/* Ends with POPT_TABLEEND; each option returns its kl_option_id. */
const struct poptOption *kl_option_table(enum kl_option_set set);

#endif
