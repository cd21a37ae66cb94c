/* OpenVDB, loaded when it is asked for. */
#ifndef KL_SRC_APP_VDB_MODULE_H
#define KL_SRC_APP_VDB_MODULE_H

#include "src/base/status.h"
#include "src/import/vdb_write.h"

/* kl_vdb_write of keeplight-vdb.so, which lies beside the program or in ../lib/keeplight. `path`
 * appears whole or not at all. KL_ERR_IO: no such module, or the file cannot be written. */
kl_status kl_vdb_module_write(const char *path, const struct kl_vdb_points *points,
                              struct kl_err *err) KL_MUST_CHECK;

#endif
