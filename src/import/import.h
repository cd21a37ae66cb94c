/* Files into scenes. The only C++ behind a C header: tinygltf, OpenEXR's C core for skies. */
#ifndef KL_SRC_IMPORT_IMPORT_H
#define KL_SRC_IMPORT_IMPORT_H

#include "src/base/status.h"
#include "src/scene/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Called for each thing in the file that is understood but not supported, or repaired: one line
 * without newline, naming the place ("mesh 3 primitive 0: ..."). The same text is given once. */
typedef void (*kl_warn_fn)(void *context, const char *line);

/* Read a .gltf or .glb file with everything it refers to. KL_ERR_INPUT with one line (file, place,
 * found, expected) where the file, or one that it names, is not there or not usable; KL_ERR_IO
 * where the system refuses to read it. A required extension that is not known is refused. *out is
 * the caller's: kl_scene_destroy. `warn` may be NULL. Threads: any number of imports at once. */
kl_status kl_import_gltf(const char *path, kl_warn_fn warn, void *warn_context,
                         struct kl_scene **out, struct kl_err *err) KL_MUST_CHECK;

/* The same from bytes in memory; `name` stands for the path in messages. The scene must be in one
 * piece: a reference to another file is refused. */
kl_status kl_import_gltf_memory(const void *bytes, size_t size, const char *name, kl_warn_fn warn,
                                void *warn_context, struct kl_scene **out,
                                struct kl_err *err) KL_MUST_CHECK;

/* Read a lat-long OpenEXR image (scan lines or tiles, any compression, half or float, RGB(A),
 * luminance Y, or Y/RY/BY) and make it the scene's environment. NaN, Inf and negative texels are
 * set to 0 and reported by one warning with their count. The scene is unchanged on failure. */
kl_status kl_import_environment(struct kl_scene *scene, const char *path, kl_warn_fn warn,
                                void *warn_context, struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
