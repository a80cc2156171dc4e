/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_values.hpp - what the C++ headers of libbvhd share: arrays by pointer and count, errors, outcomes.
 */
#ifndef BVHD_BVHD_VALUES_HPP
#define BVHD_BVHD_VALUES_HPP

#include <bvhd/status.h>

#include <cstdio>
#include <cstddef>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>

namespace bvhd
{

/* An array that belongs to somebody else: a pointer and a count. It is made of anything with data() and size(). */
template <class T> class Span
{
  public:
    Span() = default;
    Span(T *data, std::size_t size) : data_(data), size_(size)
    {
    }
    template <std::size_t N> Span(T (&array)[N]) : data_(array), size_(N)
    {
    }
    template <class C,
              class = std::enable_if_t<std::is_convertible_v<decltype(std::declval<C &>().data()), T *> &&
                                       std::is_convertible_v<decltype(std::declval<C &>().size()), std::size_t>>>
    Span(C &&container) : data_(container.data()), size_(container.size())
    {
    }
    T *data() const
    {
        return data_;
    }
    std::size_t size() const
    {
        return size_;
    }
    bool empty() const
    {
        return size_ == 0;
    }
    T &operator[](std::size_t index) const
    {
        return data_[index];
    }
    T *begin() const
    {
        return data_;
    }
    T *end() const
    {
        return data_ + size_;
    }

  private:
    T *data_ = nullptr;
    std::size_t size_ = 0;
};

/* An error: the status, the broken rule, the place and the reason. */
class Error : public bvhd_error
{
  public:
    Error() : bvhd_error{}
    {
    }
    Error(const bvhd_error &error) : bvhd_error(error)
    {
    }
    const char *status_name() const
    {
        return bvhd_status_name(status);
    }
    /* The identifier of Vulkan's rule, or "". */
    const char *vuid_string() const
    {
        return bvhd_vuid_string(vuid);
    }
    /* All of it in one line. */
    std::string message() const
    {
        std::string line = status_name();
        for (const char *part : {static_cast<const char *>(where), static_cast<const char *>(text), vuid_string()})
            if (*part != '\0')
                line.append(": ").append(part);
        return line;
    }
};

#if defined(__cpp_exceptions)
/* An error as an exception, which value() throws. */
class Exception : public std::exception
{
  public:
    explicit Exception(const Error &error) : error_(error), message_(error.message())
    {
    }
    const char *what() const noexcept override
    {
        return message_.c_str();
    }
    const Error &error() const noexcept
    {
        return error_;
    }

  private:
    Error error_;
    std::string message_;
};
#endif

/* Throws the error or, without exceptions, prints it and ends the program. */
[[noreturn]] inline void fail(const Error &error)
{
#if defined(__cpp_exceptions)
    throw Exception(error);
#else
    std::fprintf(stderr, "bvhd: %s\n", error.message().c_str());
    std::abort();
#endif
}

/* A value, or the error because of which there is none. */
template <class T> class [[nodiscard]] Expected
{
  public:
    Expected(T value) : value_(std::move(value))
    {
    }
    Expected(const Error &error) : error_(error)
    {
    }
    bool has_value() const
    {
        return value_.has_value();
    }
    explicit operator bool() const
    {
        return has_value();
    }
    /* The error; its status is BVHD_OK if there is a value. */
    const Error &error() const
    {
        return error_;
    }
    /* The value. Without one it throws Exception or, without exceptions, ends the program. */
    T &value() &
    {
        return value_ ? *value_ : (fail(error_), *value_);
    }
    const T &value() const &
    {
        return value_ ? *value_ : (fail(error_), *value_);
    }
    T value() &&
    {
        return value_ ? std::move(*value_) : (fail(error_), std::move(*value_));
    }
    T &operator*()
    {
        return value();
    }
    T *operator->()
    {
        return &value();
    }

  private:
    std::optional<T> value_;
    Error error_;
};

/* The outcome of a call without a value. */
template <> class [[nodiscard]] Expected<void>
{
  public:
    Expected() = default;
    Expected(const Error &error) : error_(error)
    {
    }
    bool has_value() const
    {
        return error_.status == BVHD_OK;
    }
    explicit operator bool() const
    {
        return has_value();
    }
    const Error &error() const
    {
        return error_;
    }
    void value() const
    {
        if (!has_value())
            fail(error_);
    }

  private:
    Error error_;
};

} /* namespace bvhd */

#endif
