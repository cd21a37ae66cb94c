// The only place where exceptions become status codes.
#ifndef KL_SRC_IMPORT_IMPORT_GUARD_HPP
#define KL_SRC_IMPORT_IMPORT_GUARD_HPP

#include "src/base/status.h"

#include <exception>
#include <new>
#include <stdexcept>
#include <string>

// What is wrong with the file: file, place, found, expected. Thrown anywhere in the glTF reader.
struct kl_import_failure : std::exception {
    kl_err err;
    explicit kl_import_failure(const kl_err &why) : err(why)
    {
    }
    const char *what() const noexcept override
    {
        return err.msg;
    }
};

[[noreturn]] void kl_import_refuse(const char *fmt, ...) KL_PRINTF(1, 2);

template <class Body> kl_status kl_import_guard(kl_err *err, const char *path, Body body) noexcept
{
    try {
        body();
        return KL_OK;
    } catch (const kl_import_failure &e) {
        *err = e.err;
        return kl_wrap(err, "%s", path);
    } catch (const std::bad_alloc &) {
        return kl_fail(err, KL_ERR_NO_MEMORY, "%s: out of memory", path);
    } catch (const std::length_error &) {
        return kl_fail(err, KL_ERR_NO_MEMORY, "%s: out of memory", path);
    } catch (const std::exception &e) {
        return kl_fail(err, KL_ERR_INPUT, "%s: %s", path, e.what());
    } catch (...) {
        return kl_fail(err, KL_ERR_INPUT, "%s: unknown C++ exception", path);
    }
}

#endif
