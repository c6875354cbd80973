/* guarded.hpp - no exception leaves a C++ module: an entry runs its body by guarded(), which makes an error of it.
 * Errors are a pvx_err value and one line of text in `err`. */
#ifndef PVX_GUARDED_HPP
#define PVX_GUARDED_HPP
#include <cstdio>
#include <exception>
#include <new>
#include <string>

#include "base/err.h"

namespace
{

inline int fail(int e, char *err, size_t err_size, const char *text) noexcept
{
    snprintf(err, err_size, "%s", text);
    for (char *p = err; *p != '\0'; p++) /* a library's texts may have several lines */
        if (static_cast<unsigned char>(*p) < ' ')
            *p = ' ';
    return e;
}

inline int fail(int e, char *err, size_t err_size, const std::string &text) noexcept
{
    return fail(e, err, err_size, text.c_str());
}

/* `of`: the error of what f threw, but for memory. */
template <typename F> int guarded(char *err, size_t err_size, F f, int of = PVX_EIO) noexcept
{
    try {
        return f();
    } catch (const std::bad_alloc &) {
        return fail(PVX_ENOMEM, err, err_size, "out of memory");
    } catch (const std::exception &e) {
        return fail(of, err, err_size, e.what());
    } catch (...) {
        return fail(of, err, err_size, "unknown failure in a library");
    }
}

} // namespace
#endif
