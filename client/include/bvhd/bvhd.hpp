/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd.hpp - the interface of bvhd.h for C++17 and newer: objects that end by themselves, and errors that cannot be
 * overlooked. It is all in this header; programs link libbvhd as those in C do.
 *
 *     bvhd::Client client = bvhd::Client::create().value();
 *     bvhd::Batch batch = client.submit(infos, ranges).value();
 *     batch.wait();
 *     bvhd::Result result = batch.result(0).value();
 *     upload(result.data(), result.size());
 *
 * Errors: a function that can fail returns an Expected, which holds a value or an Error. Its value() throws Exception
 * if there is an error; a program that is compiled without exceptions ends there, so it asks has_value() first. Errors
 * are values, because tools and games are often compiled with -fno-exceptions, and because the items of a batch fail
 * one by one. No other function throws, but for memory of std::shared_ptr.
 *
 * Ownership: Client and Batch can be moved but not copied; a batch keeps its client. A Blob is a counted reference: its
 * copies share the bytes. A Result holds a Blob, so it outlives its batch. An object that was moved from can only be
 * assigned to or destroyed.
 *
 * Threads: as in bvhd.h. Like any object of C++, one Client, Batch, Blob or Result must not be assigned to or destroyed
 * while another thread uses it.
 */
#ifndef BVHD_BVHD_HPP
#define BVHD_BVHD_HPP

#include <bvhd/bvhd.h>
#include <bvhd/bvhd_values.hpp>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

namespace bvhd
{

/* The name of immutable bytes. Keep it as secret as the bytes. */
class Key : public bvhd_key
{
  public:
    Key() : bvhd_key{}
    {
    }
    Key(const bvhd_key &key) : bvhd_key(key)
    {
    }
    static std::optional<Key> from_text(const char *text)
    {
        Key key;
        if (bvhd_key_from_text(text, &key) != BVHD_OK)
            return std::nullopt;
        return key;
    }
    std::string text() const
    {
        char text[BVHD_KEY_TEXT_SIZE];
        bvhd_key_to_text(this, text);
        return text;
    }
    friend bool operator==(const Key &a, const Key &b)
    {
        return std::memcmp(a.bytes, b.bytes, sizeof a.bytes) == 0;
    }
    friend bool operator!=(const Key &a, const Key &b)
    {
        return !(a == b);
    }
    friend bool operator<(const Key &a, const Key &b)
    {
        return std::memcmp(a.bytes, b.bytes, sizeof a.bytes) < 0;
    }
};

/* The bytes of a result: a counted reference, or none. */
class Blob
{
  public:
    Blob() = default;
    /* Takes another reference. */
    explicit Blob(bvhd_blob *blob) : blob_(blob ? bvhd_blob_ref(blob) : nullptr)
    {
    }
    Blob(const Blob &other) : Blob(other.blob_)
    {
    }
    Blob(Blob &&other) noexcept : blob_(std::exchange(other.blob_, nullptr))
    {
    }
    Blob &operator=(Blob other) noexcept
    {
        std::swap(blob_, other.blob_);
        return *this;
    }
    ~Blob()
    {
        bvhd_blob_unref(blob_);
    }
    explicit operator bool() const
    {
        return blob_ != nullptr;
    }
    const void *data() const
    {
        return blob_ ? bvhd_blob_data(blob_) : nullptr;
    }
    std::size_t size() const
    {
        return blob_ ? static_cast<std::size_t>(bvhd_blob_size(blob_)) : 0;
    }
    Span<const unsigned char> bytes() const
    {
        return {static_cast<const unsigned char *>(data()), size()};
    }
    bvhd_blob *get() const
    {
        return blob_;
    }

  private:
    bvhd_blob *blob_ = nullptr;
};

/* A structure that was built: its bytes, and everything else that bvhd_result says. It outlives its batch. */
class Result
{
  public:
    /* Copies a result whose status is BVHD_OK. */
    explicit Result(const bvhd_result &result) : info_(result), blob_(result.blob)
    {
    }
    const void *data() const
    {
        return blob_.data();
    }
    std::size_t size() const
    {
        return blob_.size();
    }
    Key key() const
    {
        return info_.key;
    }
    const Blob &blob() const
    {
        return blob_;
    }
    /* The fields of bvhd.h. */
    const bvhd_result *operator->() const
    {
        return &info_;
    }
    /* The reference for instances that name the structure by this handle. */
    Expected<bvhd_reference> reference(std::uint64_t handle) const
    {
        bvhd_reference reference;
        Error error;
        error.status = bvhd_reference_from_result(&info_, handle, &reference);
        if (error.status == BVHD_OK)
            return reference;
        std::snprintf(error.text, sizeof error.text, "no reference can be made with handle %llu",
                      static_cast<unsigned long long>(handle));
        return error;
    }

  private:
    bvhd_result info_;
    Blob blob_;
};

/* Structures that were requested together. Its end cancels what is not done. */
class Batch
{
  public:
    /* Takes a batch over. The client, if it is given, lives at least as long. */
    explicit Batch(bvhd_batch *batch, std::shared_ptr<bvhd_client> client = nullptr)
        : client_(std::move(client)), batch_(batch)
    {
    }
    Batch(Batch &&) = default;
    /* The batch that this object had ends before the client that it keeps. */
    Batch &operator=(Batch &&other) noexcept
    {
        batch_ = std::move(other.batch_);
        done_ = std::move(other.done_);
        client_ = std::move(other.client_);
        return *this;
    }
    std::uint32_t size() const
    {
        return bvhd_batch_count(batch_.get());
    }
    /* Whether geometry memory may be freed or changed. */
    bool is_copied() const
    {
        return bvhd_batch_is_copied(batch_.get()) != 0;
    }
    bool is_done() const
    {
        return bvhd_batch_is_done(batch_.get()) != 0;
    }
    /* How far an item is, from 0 to 1, as far as it is known. */
    float progress(std::uint32_t item) const
    {
        return bvhd_batch_progress(batch_.get(), item);
    }
    /* Waits until every item has its result. */
    void wait() const
    {
        (void)bvhd_batch_wait(batch_.get(), -1);
    }
    void wait_copied() const
    {
        (void)bvhd_batch_wait_copied(batch_.get(), -1);
    }
    /* Returns whether every item had its result in time. */
    bool wait_for(std::chrono::milliseconds time) const
    {
        return bvhd_batch_wait(batch_.get(), milliseconds(time)) == BVHD_OK;
    }
    bool wait_copied_for(std::chrono::milliseconds time) const
    {
        return bvhd_batch_wait_copied(batch_.get(), milliseconds(time)) == BVHD_OK;
    }
    /*
     * Has `call` called once when every item has its result, from Client::dispatch and from calls that wait. It must
     * not throw, and not end this Batch. A second call replaces the first.
     */
    void on_done(std::function<void()> call)
    {
        auto next = std::make_unique<std::function<void()>>(std::move(call));
        bvhd_batch_set_callback(
            batch_.get(), [](bvhd_batch *, void *user) noexcept { (*static_cast<std::function<void()> *>(user))(); },
            next.get());
        done_ = std::move(next);
    }
    void cancel() const
    {
        bvhd_batch_cancel(batch_.get());
    }
    void cancel(std::uint32_t item) const
    {
        bvhd_batch_cancel_item(batch_.get(), item);
    }
    /* The result of an item, or its error: BVHD_PENDING if it is not done, BVHD_NOT_FOUND if there is no such item. */
    Expected<Result> result(std::uint32_t item) const
    {
        const bvhd_result *result = bvhd_batch_result(batch_.get(), item);
        Error error;
        if (!result) {
            error.status = BVHD_NOT_FOUND;
            std::snprintf(error.text, sizeof error.text, "the batch has no item %u", static_cast<unsigned>(item));
            return error;
        }
        if (result->error.status != BVHD_OK)
            return Error(result->error);
        return Result(*result);
    }
    bvhd_batch *get() const
    {
        return batch_.get();
    }

    /* A time for the functions of bvhd.h, which take it as an int. */
    static int milliseconds(std::chrono::milliseconds time)
    {
        const auto count = time.count();
        return count < 0 ? 0 : count > 0x7fffffff ? 0x7fffffff : static_cast<int>(count);
    }

  private:
    struct Destroy {
        void operator()(bvhd_batch *batch) const
        {
            bvhd_batch_destroy(batch);
        }
    };
    /* Members end in the opposite order: the batch before its callback and its client. */
    std::shared_ptr<bvhd_client> client_;
    std::unique_ptr<std::function<void()>> done_;
    std::unique_ptr<bvhd_batch, Destroy> batch_;
};

/* The service's counters: names and values. */
class Counters
{
  public:
    explicit Counters(bvhd_counters *counters) : counters_(counters)
    {
    }
    std::uint32_t size() const
    {
        return bvhd_counters_count(counters_.get());
    }
    const char *name(std::uint32_t index) const
    {
        return bvhd_counters_name(counters_.get(), index);
    }
    std::uint64_t value(std::uint32_t index) const
    {
        return bvhd_counters_value(counters_.get(), index);
    }
    /* The daemon's version; it lives as long as the counters. */
    const char *version() const
    {
        return bvhd_counters_version(counters_.get());
    }

  private:
    struct Destroy {
        void operator()(bvhd_counters *counters) const
        {
            bvhd_counters_destroy(counters);
        }
    };
    std::unique_ptr<bvhd_counters, Destroy> counters_;
};

/* The service's connections that this program may see, and what each of them holds. */
class Connections
{
  public:
    explicit Connections(bvhd_connections *connections) : connections_(connections)
    {
    }
    std::uint32_t size() const
    {
        return bvhd_connections_count(connections_.get());
    }
    /* One connection, which lives as long as the list; `index` is below size(). */
    const bvhd_connection &operator[](std::uint32_t index) const
    {
        return *bvhd_connections_get(connections_.get(), index);
    }
    std::uint32_t total() const
    {
        return bvhd_connections_total(connections_.get());
    }
    std::uint32_t hidden() const
    {
        return bvhd_connections_hidden(connections_.get());
    }

  private:
    struct Destroy {
        void operator()(bvhd_connections *connections) const
        {
            bvhd_connections_destroy(connections);
        }
    };
    std::unique_ptr<bvhd_connections, Destroy> connections_;
};

/* What the service keeps, on disk and in memory. The members are those of bvhd_cache_state. */
class CacheState
{
  public:
    explicit CacheState(bvhd_cache_state *state) : state_(state)
    {
    }
    const bvhd_cache_state *operator->() const
    {
        return state_.get();
    }

  private:
    struct Destroy {
        void operator()(bvhd_cache_state *state) const
        {
            bvhd_cache_state_destroy(state);
        }
    };
    std::unique_ptr<bvhd_cache_state, Destroy> state_;
};

/* How structures are built. The fields are those of bvhd_build. */
struct BuildOptions {
    Span<const bvhd_reference> references = {};
    bvhd_quality quality = BVHD_QUALITY_UNSPECIFIED;
    bvhd_priority priority = BVHD_PRIORITY_NORMAL;
    std::uint32_t layout_flags = 0;
    float rays_per_primitive = 0;
    std::uint32_t deadline_ms = 0;
    bvhd_builder builder = BVHD_BUILDER_OWN;
    const bvhd_format *format = nullptr; /* native structures for this device; portable without it */
};

/* A connection to the service, which is made when it is needed. */
class Client
{
  public:
    using Milliseconds = std::chrono::milliseconds;

    /* The default options: all 0 but for their size. */
    static bvhd_client_options default_options()
    {
        bvhd_client_options options = {};
        options.struct_size = sizeof options;
        return options;
    }
    static Expected<Client> create(const bvhd_client_options &options = default_options())
    {
        bvhd_client *client = nullptr;
        Error error;
        if (bvhd_client_create(&options, &client, &error) != BVHD_OK)
            return error;
        return Client(client);
    }
    Expected<void> connect() const
    {
        Error error;
        return bvhd_client_connect(client_.get(), &error) == BVHD_OK ? Error() : error;
    }
    /* Returns the milliseconds of a round trip. Without a time the client's own limits hold. */
    Expected<double> ping(std::optional<Milliseconds> time = std::nullopt) const
    {
        Error error;
        double milliseconds = 0;
        if (bvhd_client_ping(client_.get(), limit(time), &milliseconds, &error) != BVHD_OK)
            return error;
        return milliseconds;
    }
    Expected<Counters> counters(std::optional<Milliseconds> time = std::nullopt) const
    {
        Error error;
        bvhd_counters *counters = nullptr;
        if (bvhd_client_counters(client_.get(), limit(time), &counters, &error) != BVHD_OK)
            return error;
        return Counters(counters);
    }
    /* `flags` are BVHD_CONNECTIONS_. */
    Expected<Connections> connections(std::uint32_t flags = 0, std::optional<Milliseconds> time = std::nullopt) const
    {
        Error error;
        bvhd_connections *connections = nullptr;
        if (bvhd_client_connections(client_.get(), flags, limit(time), &connections, &error) != BVHD_OK)
            return error;
        return Connections(connections);
    }
    /* `bytes` is for BVHD_CACHE_TRIM. */
    Expected<CacheState> cache(bvhd_cache_action action = BVHD_CACHE_SHOW, std::uint64_t bytes = 0,
                               std::optional<Milliseconds> time = std::nullopt) const
    {
        Error error;
        bvhd_cache_state *state = nullptr;
        if (bvhd_client_cache(client_.get(), action, bytes, limit(time), &state, &error) != BVHD_OK)
            return error;
        return CacheState(state);
    }
    /* A descriptor for event loops: when it is readable, call dispatch. */
    int descriptor() const
    {
        return bvhd_client_descriptor(client_.get());
    }
    void dispatch() const
    {
        bvhd_client_dispatch(client_.get());
    }
    /*
     * Requests one structure for each info, with as many pointers to ranges. Geometry memory must stay as it is until
     * Batch::is_copied.
     */
    Expected<Batch> submit(Span<const VkAccelerationStructureBuildGeometryInfoKHR> infos,
                           Span<const VkAccelerationStructureBuildRangeInfoKHR *const> ranges,
                           const BuildOptions &options = {}) const
    {
        if (infos.size() != ranges.size() || infos.size() > UINT32_MAX || options.references.size() > UINT32_MAX) {
            Error error;
            error.status = BVHD_INVALID;
            std::snprintf(error.text, sizeof error.text, "there are %zu infos, %zu ranges and %zu references",
                          infos.size(), ranges.size(), options.references.size());
            return error;
        }
        bvhd_build build = {};
        build.struct_size = sizeof build;
        build.info_count = static_cast<std::uint32_t>(infos.size());
        build.infos = infos.data();
        build.ranges = ranges.data();
        build.references = options.references.data();
        build.reference_count = static_cast<std::uint32_t>(options.references.size());
        build.quality = options.quality;
        build.layout_flags = options.layout_flags;
        build.priority = options.priority;
        build.format = options.format;
        build.rays_per_primitive = options.rays_per_primitive;
        build.deadline_ms = options.deadline_ms;
        build.builder = options.builder;
        return submit(build);
    }
    Expected<Batch> submit(const bvhd_build &build) const
    {
        bvhd_batch *batch = nullptr;
        Error error;
        if (bvhd_batch_submit(client_.get(), &build, &batch, &error) != BVHD_OK)
            return error;
        return Batch(batch, client_);
    }
    /* Requests structures that were built before, by their keys. */
    Expected<Batch> fetch(Span<const Key> keys) const
    {
        static_assert(sizeof(Key) == sizeof(bvhd_key), "an array of Key is one of bvhd_key");
        bvhd_batch *batch = nullptr;
        Error error;
        if (keys.size() > UINT32_MAX) {
            error.status = BVHD_INVALID;
            std::snprintf(error.text, sizeof error.text, "there are %zu keys", keys.size());
            return error;
        }
        if (bvhd_batch_fetch(client_.get(), static_cast<std::uint32_t>(keys.size()), keys.data(), &batch, &error) !=
            BVHD_OK)
            return error;
        return Batch(batch, client_);
    }
    bvhd_client *get() const
    {
        return client_.get();
    }

    Client(Client &&) = default;
    Client &operator=(Client &&) = default;
    Client(const Client &) = delete;
    Client &operator=(const Client &) = delete;
    ~Client() = default;

  private:
    explicit Client(bvhd_client *client) : client_(client, bvhd_client_destroy)
    {
    }
    static int limit(std::optional<Milliseconds> time)
    {
        return time ? Batch::milliseconds(*time) : -1;
    }
    std::shared_ptr<bvhd_client> client_;
};

} /* namespace bvhd */

#endif
