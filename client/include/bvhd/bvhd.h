/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd.h - acceleration structures built by a service, or in the program's own process where there is none: the
 * interface of the client library.
 *
 * A program describes the structures that it needs in Vulkan's own structs, with host addresses, and gets serialized
 * acceleration structures. The service does equal work once, so a request for a structure that exists already is cheap.
 * A program that has kept a result's key can fetch the bytes again without sending geometry.
 *
 *     struct bvhd_client *client;
 *     bvhd_client_create(NULL, &client, &error);
 *     bvhd_batch_submit(client, &build, &batch, &error);
 *     bvhd_batch_wait(batch, -1);
 *     const struct bvhd_result *result = bvhd_batch_result(batch, 0);    its error.status, data, size, key
 *     bvhd_batch_destroy(batch);
 *     bvhd_client_destroy(client);
 *
 * Threads: every function may be called from any thread, on any object, at any time, with one exception: the call that
 * destroys an object must be the last call on it. Several threads may wait at once. The library starts no threads,
 * except those that `local_threads` allows: it makes progress only inside its own calls (wait, dispatch, submit, ...).
 * Only the functions named "wait", "connect", "ping", "counters" and "connections" block. Submit, dispatch and wait
 * copy geometry, which takes time in proportion to its size.
 *
 * Errors: a function that can fail returns a status, and fills *ret_error (which may be NULL) with the broken rule, the
 * place and the reason. A function that fails leaves its other results untouched and keeps no resources.
 *
 * Without a daemon: a client builds structures in the program's own process if no daemon answers, unless the program
 * sets `local`. The results are the same: bytes, keys, statistics and errors. The builder is a library of its own,
 * libbvhd_build, which is loaded when it is needed. Builds run inside of bvhd_batch_wait and bvhd_batch_wait_copied, on
 * the threads that call them, or on threads that the program allows by `local_threads`; never inside of submit or
 * dispatch. Nothing is kept beyond what batches hold: a structure is built again unless a batch of this client has it.
 *
 * Loss of the daemon: when the daemon's process ends, its socket says so. Everything under way then fails with
 * BVHD_UNAVAILABLE at the next call, or at once if a thread waits or the program watches bvhd_client_descriptor; it is
 * never continued in the program's process. A daemon that is alive but stays completely silent while it owes an answer
 * is given up after `lost_after_ms`. The next submission after a loss connects again, so a restarted daemon is found,
 * and is built in the program's process if there is none.
 *
 * Absence of a daemon: if nobody listens on any place where a daemon may be, that is known at once. The structures are
 * then built in the program's process. With BVHD_LOCAL_NEVER they fail with BVHD_UNAVAILABLE, whose text names the
 * places: at once or, if the socket was named by the program or by $BVHD_SOCKET, after `connect_timeout_ms`, because
 * its daemon may be about to start. A daemon that listens but does not answer is given up after `connect_timeout_ms`,
 * too. A program that gets BVHD_UNAVAILABLE can use the device's own build instead, or submit again.
 *
 * A daemon that announces its end finishes the requests that it has; later submissions go to the next daemon. A daemon,
 * for its part, gives up a client that leaves results unread for 30 s: a program that requests much and then does other
 * work for a long time should call bvhd_client_dispatch meanwhile.
 *
 * NULL: a pointer that a call needs is refused as BVHD_INVALID with its name as the place ("client is NULL"). Functions
 * without a status do nothing for NULL, or return NULL, 0 or an empty text; a batch that is NULL has no items and is
 * done.
 *
 * Versions: BVHD_VERSION is the version of this header, bvhd_version() that of the library. What was compiled with this
 * header runs with every later library of the same soname (libbvhd.so.0): before 1.0 a release that increases the minor
 * number may have another soname, from 1.0 on only one that increases the major number. Within a soname:
 *
 *   functions     are added, and never removed or changed in meaning;
 *   structs       with a struct_size grow at their end, and 0 in a new field means what was before: set struct_size to
 *                 sizeof, and all other fields, by an initialiser. The library takes the sizes of earlier versions. A
 *                 field that is set and that it does not know yet is an error (BVHD_UNSUPPORTED), not ignored;
 *   bvhd_result   and others that only the library makes grow at their end: read their fields through the pointer;
 *   other structs do not change;
 *   enums         get more values, also those that the library returns (a status, a target, an origin): treat unknown
 *                 ones as numbers. Values and bits never change their meaning. An unknown one in an argument is an
 *                 error;
 *   texts         of errors may change. Programs decide by status, rule and place.
 *
 * Processes: the process may fork, but the child must not use the parent's objects. The library raises and handles no
 * signals. Its descriptors are close-on-exec.
 */
#ifndef BVHD_BVHD_H
#define BVHD_BVHD_H

#include <stddef.h>
#include <stdint.h>

#include <bvhd/status.h>
#include <vulkan/vulkan_core.h>

#ifdef __cplusplus
extern "C" {
#endif

struct bvhd_client; /* A connection to the service, or a builder in this process. */
struct bvhd_batch; /* Structures that were requested together, and their results. */
struct bvhd_blob; /* The bytes of a result, whose references are counted. */
struct bvhd_counters; /* The service's counters at one time. */
struct bvhd_connections; /* The service's connections at one time. */

/* The version of this header, as three numbers, as a text, and as one number that grows: for #if. */
#define BVHD_VERSION_MAJOR 0
#define BVHD_VERSION_MINOR 1
#define BVHD_VERSION_PATCH 0
#define BVHD_VERSION_STRING "0.1.0"
#define BVHD_MAKE_VERSION(major, minor, patch) ((major)*1000000 + (minor)*1000 + (patch))
#define BVHD_VERSION BVHD_MAKE_VERSION(BVHD_VERSION_MAJOR, BVHD_VERSION_MINOR, BVHD_VERSION_PATCH)

/* The version of the library at run time, for example "0.1.0". A static string. */
BVHD_API const char *bvhd_version(void);

/* ---- Keys: the names of immutable bytes, and as secret: a program that knows a key may fetch the bytes. ---- */

enum { BVHD_KEY_SIZE = 32, BVHD_KEY_TEXT_SIZE = 65 };

/* A key: 32 bytes in binary, or 64 hexadecimal digits and a NUL as text. */
struct bvhd_key {
    uint8_t bytes[BVHD_KEY_SIZE];
};

/* Writes a key as 64 lower-case hexadecimal digits and a NUL; an empty text if `key` is NULL. */
BVHD_API void bvhd_key_to_text(const struct bvhd_key *key, char ret_text[BVHD_KEY_TEXT_SIZE]);

/* Reads a key from text. Returns BVHD_INVALID unless the text is exactly 64 hexadecimal digits, of either case. */
BVHD_API enum bvhd_status bvhd_key_from_text(const char *text, struct bvhd_key *ret_key);

/* ---- The client: a connection to the service, which is made when it is needed. ---- */

/*
 * Whether a client builds structures in the program's own process, by the library libbvhd_build. That is looked for
 * beside libbvhd.so, and then by its name where the system looks for libraries. If it cannot be loaded, the builds fail
 * with BVHD_UNSUPPORTED; if it has another version than libbvhd, with BVHD_INCOMPATIBLE.
 */
enum bvhd_local {
    BVHD_LOCAL_IF_NO_DAEMON = 0, /* only if no daemon answers */
    BVHD_LOCAL_NEVER = 1,
    BVHD_LOCAL_ALWAYS = 2, /* always: the client never looks for a daemon */
};

/* How a client finds its daemon, and how long it waits. All fields but struct_size may be 0. */
struct bvhd_client_options {
    size_t struct_size; /* sizeof(struct bvhd_client_options): later versions may add fields */
    /*
     * Path of the daemon's socket. NULL stands for $BVHD_SOCKET. If that is not set, the places are the user's own
     * socket and then /run/bvhd/bvhd.sock, as for bvhctl. The user's own is $XDG_RUNTIME_DIR/bvhd.sock, or without such
     * a directory bvhd-UID/bvhd.sock in $TMPDIR or /tmp, if only this user may access the directory bvhd-UID.
     */
    const char *socket_path;
    uint32_t connect_timeout_ms; /* how long the client looks for a daemon; 0: 5,000 */
    uint32_t lost_after_ms; /* how long a daemon that owes an answer may be silent; 0: 10,000 */
    /*
     * Bytes of memory shared with the daemon, which is allocated as needed and then kept. 0 stands for 64 MiB, which is
     * also the maximum.
     */
    uint64_t pool_size;
    enum bvhd_local local; /* whether structures may be built in this process */
    /*
     * How many threads the client may start for builds in this process, at most one for each processor. They start with
     * the first such build, block all signals, and end in bvhd_client_destroy. 0: it starts none, and builds inside of
     * bvhd_batch_wait and bvhd_batch_wait_copied, on the threads that call them. A program that uses
     * bvhd_client_descriptor has to allow threads: with 0, what needs a build in this process is refused with
     * BVHD_UNSUPPORTED, because its event loop must not build.
     */
    uint32_t local_threads;
};

/*
 * Creates a client, which does not connect yet. `options` may be NULL, which is the same as all 0. Fails with
 * BVHD_INVALID (struct_size), BVHD_NO_MEMORY or BVHD_IO. The caller destroys the client with bvhd_client_destroy.
 */
BVHD_API enum bvhd_status bvhd_client_create(const struct bvhd_client_options *options, struct bvhd_client **ret_client,
                                             struct bvhd_error *ret_error);

/*
 * Closes the connection and frees the client. All its batches must have been destroyed before, and no other thread may
 * be in a call on it; blobs, counters and lists of connections live on. NULL is allowed and does nothing.
 */
BVHD_API void bvhd_client_destroy(struct bvhd_client *client);

/*
 * Connects, and waits until the daemon has answered. This call is not needed before a submission. Returns
 * BVHD_UNAVAILABLE when no daemon answers within `connect_timeout_ms`, or at once when nobody listens and no socket was
 * named, and BVHD_INCOMPATIBLE when the daemon speaks no common version of the protocol. With BVHD_LOCAL_ALWAYS there
 * is no daemon: this call, bvhd_client_ping, bvhd_client_counters and bvhd_client_connections return BVHD_UNAVAILABLE.
 */
BVHD_API enum bvhd_status bvhd_client_connect(struct bvhd_client *client, struct bvhd_error *ret_error);

/*
 * Returns a descriptor for the program's event loop: when it is readable, call bvhd_client_dispatch. It stays the same
 * for the client's whole life and belongs to the client. (It is an epoll descriptor that also covers timeouts and
 * changes of the connection.)
 */
BVHD_API int bvhd_client_descriptor(const struct bvhd_client *client);

/*
 * Does all work that is possible without blocking: sends, receives, checks timeouts. It never builds: structures that
 * are built in this process make progress on the client's threads or in calls that wait. Failures show in the batches'
 * results.
 */
BVHD_API void bvhd_client_dispatch(struct bvhd_client *client);

/* ---- Batches: several structures requested at once, each of which succeeds or fails alone. ---- */

/* How much time to spend on a structure: a higher quality takes longer to build and less time to trace. */
enum bvhd_quality {
    /* Vulkan's PREFER flags decide: FAST_BUILD is fast, FAST_TRACE is high, neither is auto */
    BVHD_QUALITY_UNSPECIFIED = 0,
    BVHD_QUALITY_FAST = 1,
    BVHD_QUALITY_BALANCED = 2,
    BVHD_QUALITY_HIGH = 3,
    BVHD_QUALITY_AUTO = 4, /* decided by the geometry and rays_per_primitive; balanced if rays_per_primitive is 0 */
};

/*
 * Whose methods build the trees. Both give structures of the same formats and the same answers to rays. Embree's fast,
 * balanced and high are its qualities LOW, MEDIUM and HIGH, and their bytes and keys are those of one version of
 * Embree. A daemon, or a program's process, may be without Embree: then such builds fail with BVHD_UNSUPPORTED.
 *
 * A build by Embree in the program's own process loads libembree3.so.3 or libembree4.so.4, whichever libbvhd_build was
 * made for. While it runs, it limits the threads of TBB in the process to one, unless the program has a device of
 * Embree with more.
 */
enum bvhd_builder {
    BVHD_BUILDER_OWN = 0, /* bvhd's own, which are faster and, with the quality high, better */
    BVHD_BUILDER_EMBREE = 1, /* Embree's rtcBuildBVH, over pieces of a few thousand primitives */
};

/* The formats in which the service can write structures. */
enum bvhd_target {
    BVHD_TARGET_PORTABLE = 1, /* read by shaders from storage buffers, and on the CPU */
    BVHD_TARGET_LAVAPIPE = 2, /* the native format of Mesa's CPU driver; needs bvhd_build.format */
};

/*
 * The native format that a device's driver loads. A probe finds it (bvhd_vulkan.h, or `bvhctl probe`), and the program
 * passes it to builds. It holds plain values: copy, keep and compare them freely.
 */
struct bvhd_format {
    size_t struct_size; /* sizeof(struct bvhd_format) */
    enum bvhd_target target;
    uint32_t variant; /* which variant of the target's layout the driver reads */
    uint8_t driver_uuid[16]; /* the first two fields of every structure that the driver serializes */
    uint8_t compatibility_uuid[16];
};

/*
 * Finds the native format of the device that produced a probe, and sets struct_size too. The probe may come from an
 * untrusted source and have any alignment. Fails with BVHD_UNSUPPORTED if no format that this library knows reproduces
 * the probe (the device can then load only the portable target), BVHD_CORRUPT if the bytes are not a probe,
 * BVHD_INCOMPATIBLE if the probe has another version, and BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_format_from_probe(const void *probe, uint64_t size, struct bvhd_format *ret_format,
                                                 struct bvhd_error *ret_error);

/* Returns the name of a target, "portable" or "lavapipe", as a static string; NULL for an unknown number. */
BVHD_API const char *bvhd_target_name(enum bvhd_target target);

/* layout_flags: three float4 per triangle instead of shared, indexed vertices */
enum { BVHD_PORTABLE_FAST_TRIANGLES = 0x1 };

/* Orders the batches of one client. The service shares its time fairly between clients, whatever their priorities. */
enum bvhd_priority { BVHD_PRIORITY_LOW = -1, BVHD_PRIORITY_NORMAL = 0, BVHD_PRIORITY_HIGH = 1 };

/*
 * A bottom level that instances may reference, as its result describes it: bvhd_reference_from_result makes one. With a
 * key, what follows it may be left out: the service then takes what the structure has that has this key. It is also how
 * an update names what it updates, for which the key is enough.
 */
struct bvhd_reference {
    /*
     * The VkAccelerationStructureKHR in the instances, or the srcAccelerationStructure of an update, as a number: not
     * 0, unique within the call, and not what an info of the call builds, unless that info updates it in place.
     */
    uint64_t handle;
    int has_key; /* 1: `key` is set; 0: it is not */
    struct bvhd_key key;
    /*
     * Minimum, maximum; copied from result->bounds, for an empty structure too (whose minimum is over its maximum). All
     * bits 0 means not given. The bounds of a structure that is a single point at the origin are given as minima of
     * -0.0 and maxima of 0.0, and count as 0.
     */
    float bounds[6];
    /* Copied from result->slabs: makes the world boxes of rotated instances smaller. All 0 means unknown. */
    float slabs[20];
    int moves; /* copied from result->moves. 1: only a top level with the flag MOTION may name it */
};

/* A request for several structures: what they are built from, and in which quality and format. */
struct bvhd_build {
    size_t struct_size; /* sizeof(struct bvhd_build) */
    uint32_t info_count; /* number of structures to build; may be 0 */
    /* One build info for each structure. Addresses in them are the host's; handles are only compared, as numbers. */
    const VkAccelerationStructureBuildGeometryInfoKHR *infos;
    /* ranges[i] points to infos[i].geometryCount ranges */
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges;
    /*
     * The structures that instances of any info may reference, in addition to the bottom levels that this call builds:
     * those are named by their dstAccelerationStructure. And the sources of updates, which may be top levels, too.
     */
    const struct bvhd_reference *references;
    uint32_t reference_count;
    enum bvhd_quality quality;
    enum bvhd_target target; /* 0: the target of `format`, or portable if `format` is NULL */
    uint32_t layout_flags;
    enum bvhd_priority priority;
    /* The format that the device loads, with the same target. Required for a native target, NULL for portable. */
    const struct bvhd_format *format;
    /*
     * The number of rays that each structure will meet in its life, divided by its number of primitives. With AUTO, the
     * service minimises the time of building and tracing together. The number counts rays that one thread of a
     * processor traces: for a device that is a hundred times as fast, give a hundredth. 0 means unknown; the value is
     * finite and not negative.
     */
    float rays_per_primitive;
    /*
     * Milliseconds from the call on after which structures without a result are cancelled; 0: none. Their error is then
     * BVHD_CANCELLED with the place "deadline". A daemon stops working on them by itself, and a build in this process
     * stops within a few tens of milliseconds. As always, the program learns of it by calls of dispatch and wait.
     */
    uint32_t deadline_ms;
    enum bvhd_builder builder; /* 0: bvhd's own */
    uint32_t reserved; /* 0 */
};

/*
 * Requests the structures infos[0 .. info_count) and returns without waiting for them. Geometry may also be spheres and
 * linear swept spheres (<bvhd/vulkan_nv.h>), and it may move (VK_NV_ray_tracing_motion_blur).
 *
 * Everything that the structs point to, except geometry memory, is copied before this call returns. Geometry memory
 * (vertices, radii, indices, boxes, transforms, instances) must stay readable and unchanged until bvhd_batch_is_copied
 * is true. For a batch that fits into the shared memory it is true on return, even without a daemon.
 *
 * A top level may name bottom levels of the same call: its instances have the handle that is the bottom level's
 * dstAccelerationStructure, any number but 0. The library requests the top level when these bottom levels have their
 * results. (Vulkan's rule 03407, which forbids that within one vkBuildAccelerationStructuresKHR, holds for all other
 * structures, and for a handle that build.references has, too.) The bytes are those of two calls. If such a bottom
 * level fails or is cancelled, the top level fails with the same status and a text that names both.
 *
 * A reference without bounds is looked up by its key. If that fails, every info whose instances name the reference
 * fails with that status and the place "build.references[3].key": BVHD_NOT_FOUND if the service does not have the
 * structure, or no longer, and BVHD_INVALID if it is a top level.
 *
 * An info of the mode UPDATE gives the tree of its source other positions, boxes, matrices or instances, much quicker
 * than a build. srcAccelerationStructure is the handle of an entry of build.references with the source's key, a result
 * that was built with ALLOW_UPDATE, or an update of one. What Vulkan's rules about updates name has to be as in the
 * source, and so have target, layout_flags and format; quality, builder and rays_per_primitive are ignored. The result
 * has a new key, which the next update names, and the source stays as it is. If it is also dstAccelerationStructure,
 * instances of the call name the new structure by it. Sources are kept for a while only, updates never on disk; where
 * this process builds, they are those whose blobs it still holds. What is not there any more when the request
 * arrives is BVHD_SOURCE_LOST, at "infos[3].srcAccelerationStructure": build again.
 *
 * An info that breaks a rule has that error as its result, as does every info that the service refuses:
 * BVHD_UNSUPPORTED when the daemon's version does not know the target, does not take a rays_per_primitive other than 0
 * where it would matter, has no Embree that could be the builder, or does not know updates. The call itself fails only
 * with BVHD_NO_MEMORY, with BVHD_INVALID if the struct bvhd_build or one of its references is wrong, as
 * "build.references[3].handle", or with BVHD_UNSUPPORTED and the place "options.local_threads" if there is no daemon
 * and no thread may build; where that shows later, it is the items' error. The caller destroys the batch with
 * bvhd_batch_destroy.
 */
BVHD_API enum bvhd_status bvhd_batch_submit(struct bvhd_client *client, const struct bvhd_build *build,
                                            struct bvhd_batch **ret_batch, struct bvhd_error *ret_error);

/*
 * Requests results by key, without geometry: item i of the batch is keys[i]. The keys are copied. An item gets
 * BVHD_NOT_FOUND if the service does not have its key, or no longer has it; a structure that is still being built is
 * waited for. Structures that this client has built in the program's own process are found as long as a batch that has
 * them is not destroyed; where there is no daemon, no others are. The call itself fails with BVHD_NO_MEMORY, or with
 * BVHD_INVALID for a NULL pointer.
 */
BVHD_API enum bvhd_status bvhd_batch_fetch(struct bvhd_client *client, uint32_t key_count, const struct bvhd_key *keys,
                                           struct bvhd_batch **ret_batch, struct bvhd_error *ret_error);

/* Returns the number of items: info_count or key_count of the call that made the batch. */
BVHD_API uint32_t bvhd_batch_count(const struct bvhd_batch *batch);

/*
 * Returns whether the caller may free or change its geometry memory. Becomes true during calls of dispatch and wait, or
 * on threads that build.
 */
BVHD_API int bvhd_batch_is_copied(struct bvhd_batch *batch);

/* Returns whether every item has its result. */
BVHD_API int bvhd_batch_is_done(struct bvhd_batch *batch);

/*
 * Returns how far an item is, from 0 to 1: the part of its build that is done, as far as it is known; 1 for an item
 * that has its result, whatever that is, so that results found in the cache go from 0 to 1 at once; 0 if there is no
 * such item. It never decreases. A daemon tells a few times a second, which the calls of dispatch and wait receive; one
 * that does not know of progress tells nothing. Where this process builds, the number is that of this moment.
 */
BVHD_API float bvhd_batch_progress(struct bvhd_batch *batch, uint32_t item);

/*
 * Waits until every item has its result, for at most `timeout_ms`; < 0 sets no limit, but the client's own timeouts end
 * the wait when the daemon is lost. Returns BVHD_OK, or BVHD_PENDING if time ran out.
 *
 * Where this call builds (`local_threads` is 0), it begins no structure after the time has run out, but it finishes the
 * one that it has begun, and begins at least one, so that repeated calls with any limit come to an end. It may build
 * items of other batches of the client: those of higher priority come first.
 */
BVHD_API enum bvhd_status bvhd_batch_wait(struct bvhd_batch *batch, int timeout_ms);

/* Waits in the same way until bvhd_batch_is_copied is true. */
BVHD_API enum bvhd_status bvhd_batch_wait_copied(struct bvhd_batch *batch, int timeout_ms);

/* A function of the program that is called for a batch that is done. `user` is what bvhd_batch_set_callback got. */
typedef void (*bvhd_batch_callback)(struct bvhd_batch *batch, void *user);

/*
 * Has `callback` called, exactly once, when every item of the batch has its result, by cancelling too. It is called
 * from bvhd_client_dispatch and from the calls that block (wait, connect, ping, counters, connections), on the thread
 * that makes such a call on any object of the client; never from this call or another one, and never with a lock held.
 * If the batch is done already, the next such call calls it, and bvhd_client_descriptor becomes readable.
 *
 * The callback may call every function of the library, bvhd_batch_submit and the destruction of its own batch included,
 * except bvhd_client_destroy. bvhd_batch_destroy drops a callback that was not called, and waits for one that another
 * thread is in. A second bvhd_batch_set_callback replaces a callback that was not called; NULL removes it.
 */
BVHD_API void bvhd_batch_set_callback(struct bvhd_batch *batch, bvhd_batch_callback callback, void *user);

/* Returns the `user` of the last bvhd_batch_set_callback, or NULL. */
BVHD_API void *bvhd_batch_user(struct bvhd_batch *batch);

/*
 * Cancels all items, or one item, that have no result yet. On return their results are BVHD_CANCELLED and their
 * geometry memory may be freed; the service stops working on them.
 */
BVHD_API void bvhd_batch_cancel(struct bvhd_batch *batch);
BVHD_API void bvhd_batch_cancel_item(struct bvhd_batch *batch, uint32_t item);

/*
 * Cancels what is not done, and frees the batch and its results. Geometry memory may be freed afterwards. A blob lives
 * on while the program holds a reference to it. NULL is allowed and does nothing.
 */
BVHD_API void bvhd_batch_destroy(struct bvhd_batch *batch);

/* Where a result came from. */
enum bvhd_origin {
    BVHD_ORIGIN_NONE = 0,
    BVHD_ORIGIN_BUILT = 1, /* built for this request */
    BVHD_ORIGIN_COALESCED = 2, /* another client or request was building the same structure */
    BVHD_ORIGIN_MEMORY = 3, /* built before and kept in memory */
    BVHD_ORIGIN_DISK = 4, /* built before and kept on disk */
};

/* The outcome of one item of a batch. */
struct bvhd_result {
    /*
     * BVHD_OK: the other fields are set. BVHD_PENDING: there is no result yet. `where` is a path such as
     * "infos[3].flags", with the indices of the call that made the batch.
     */
    struct bvhd_error error;
    struct bvhd_key key;
    /* The serialized acceleration structure: read only, 64-byte aligned, valid as long as `blob` or the batch lives. */
    const void *data;
    uint64_t size;
    struct bvhd_blob *blob; /* the batch's reference; take another one with bvhd_blob_ref to keep the bytes */
    enum bvhd_origin origin;
    double queued_ms, prepare_ms, build_ms; /* spent in the service for this request */
    /* Statistics. `peak_bytes` is the build's peak memory; `sah` and `depth` belong to the 2-wide tree. */
    uint64_t primitives, triangles, instances, inactive, degenerate, skipped, refs, peak_bytes;
    uint32_t depth;
    double sah;
    double original_build_ms; /* duration of the build that made the bytes, whichever request caused it */
    /*
     * the algorithm that built it: "ploc", "spatial", "binned", by Embree "embree-low", "embree-medium", "embree-high",
     * "refit" for an update, or "none" if there are no primitives
     */
    const char *method;
    float bounds[6]; /* minimum, maximum: for bvhd_reference_from_result */
    /*
     * Ten minima, then ten maxima, of the structure along x + y, y + z, z + x, x - y, y - z, z - x, x + y - z, y + z -
     * x, z + x - y, x + y + z: for bvhd_reference_from_result.
     */
    float slabs[20];
    enum bvhd_target target; /* the format of the bytes */
    enum bvhd_quality quality; /* the quality that was built: FAST, BALANCED or HIGH, whatever was requested */
    /* Of an update: the expected cost of tracing it, over that of the last build: 2 is twice as dear. 0: a build. */
    double decay;
    uint32_t refits; /* updates since the last build, this one included; 0: a build */
    int moves; /* 1: it has motion triangles, or is a top level with the flag MOTION */
};

/*
 * Returns an item's result, or NULL if there is no such item. A finished result never changes and lives as long as the
 * batch. Before the item is done, the call returns another struct whose error.status is BVHD_PENDING: call again later.
 */
BVHD_API const struct bvhd_result *bvhd_batch_result(struct bvhd_batch *batch, uint32_t item);

/*
 * Makes the reference by which instances can name the structure of a result: they contain `handle`, a number other than
 * 0. Returns the status of a result that is not BVHD_OK, and BVHD_INVALID for a top level, a handle of 0 or a NULL
 * pointer; *ret_reference is then untouched. It copies values: the result and its batch are not needed afterwards.
 */
BVHD_API enum bvhd_status bvhd_reference_from_result(const struct bvhd_result *result, uint64_t handle,
                                                     struct bvhd_reference *ret_reference);

/* ---- Blobs: bytes of results, which may outlive batch and client. References are counted, from any thread. ---- */

/*
 * Takes another reference and returns `blob`. The bytes are freed with the last reference; bvhd_blob_unref allows NULL.
 * If a batch has more than 2 MiB of results that a daemon sends inside messages, which are those of up to 64 KiB, they
 * share blocks of memory: one result that is kept keeps up to 4 MiB.
 */
BVHD_API struct bvhd_blob *bvhd_blob_ref(struct bvhd_blob *blob);
BVHD_API void bvhd_blob_unref(struct bvhd_blob *blob);
/* Return the bytes and their number. They never change, and live as long as the reference is held. */
BVHD_API const void *bvhd_blob_data(const struct bvhd_blob *blob);
BVHD_API uint64_t bvhd_blob_size(const struct bvhd_blob *blob);

/* ---- The service itself ---- */

/*
 * Sends an empty request and waits for its answer. *ret_ms (may be NULL) is the round trip in milliseconds, connecting
 * included. Returns BVHD_UNAVAILABLE when no answer comes within `timeout_ms`; < 0 leaves the limit to the client's
 * timeouts.
 */
BVHD_API enum bvhd_status bvhd_client_ping(struct bvhd_client *client, int timeout_ms, double *ret_ms,
                                           struct bvhd_error *ret_error);

/*
 * Waits for the service's counters: names and values, in a fixed order. Fails as bvhd_client_ping does, and with
 * BVHD_NO_MEMORY. The caller destroys them with bvhd_counters_destroy, which allows NULL. An `index` out of range gives
 * NULL as the name and 0 as the value.
 */
BVHD_API enum bvhd_status bvhd_client_counters(struct bvhd_client *client, int timeout_ms,
                                               struct bvhd_counters **ret_counters, struct bvhd_error *ret_error);
BVHD_API uint32_t bvhd_counters_count(const struct bvhd_counters *counters);
BVHD_API const char *bvhd_counters_name(const struct bvhd_counters *counters, uint32_t index);
BVHD_API uint64_t bvhd_counters_value(const struct bvhd_counters *counters, uint32_t index);
BVHD_API void bvhd_counters_destroy(struct bvhd_counters *counters);

/*
 * Returns the version of the daemon that sent the counters, such as "0.1.0", or "". It lives as long as the counters.
 */
BVHD_API const char *bvhd_counters_version(const struct bvhd_counters *counters);

/* One connection of the service, and what it holds there now. Later versions of the library may append members. */
struct bvhd_connection {
    uint64_t number; /* as in the daemon's log */
    uint32_t uid; /* of the process that has connected */
    int32_t pid; /* of that process, which may have passed the connection on */
    uint64_t connected_ms; /* since it has connected */
    uint64_t busy_ms; /* that threads have worked for it, in sum */
    uint64_t memory_bytes; /* for its structures under way, as promised */
    uint64_t result_bytes; /* of results that it has not read, or still holds */
    uint64_t pool_bytes; /* of the memory that it shares with the daemon */
    uint32_t requests, items; /* under way: requests, and structures in them */
    uint32_t waiting; /* of its structures, and of the builds for them: they wait for memory */
    uint32_t threads; /* that work for it now */
    uint32_t descriptors; /* that the daemon holds for it */
    const char *software; /* what it calls itself, such as "libbvhd 0.1.0"; "": it has not said */
};

/* Flags of bvhd_client_connections. By default it lists the connections that the caller is allowed to see. */
enum bvhd_connections_flags {
    BVHD_CONNECTIONS_ALL =
        1 /* if the caller may not see all, the call fails with BVHD_UNSUPPORTED and names the rule */
};

/*
 * Waits for the list of the service's connections, the newest first, at most 4,096. Root and the user who runs the
 * daemon see all of them, other users those of their own user. `flags` are BVHD_CONNECTIONS_. Fails as
 * bvhd_client_counters does, and with BVHD_UNSUPPORTED when the daemon is of a version without such a list. The caller
 * destroys the list with bvhd_connections_destroy, which allows NULL.
 */
BVHD_API enum bvhd_status bvhd_client_connections(struct bvhd_client *client, uint32_t flags, int timeout_ms,
                                                  struct bvhd_connections **ret_connections,
                                                  struct bvhd_error *ret_error);
BVHD_API uint32_t bvhd_connections_count(const struct bvhd_connections *connections);
/* Returns one connection, which lives as long as the list; NULL if there is no such index. */
BVHD_API const struct bvhd_connection *bvhd_connections_get(const struct bvhd_connections *connections, uint32_t index);
/* Return how many connections the daemon has in all, and how many are not listed because they are another user's. */
BVHD_API uint32_t bvhd_connections_total(const struct bvhd_connections *connections);
BVHD_API uint32_t bvhd_connections_hidden(const struct bvhd_connections *connections);
BVHD_API void bvhd_connections_destroy(struct bvhd_connections *connections);

/* Actions of bvhd_client_cache on the results that the service keeps. */
enum bvhd_cache_action {
    BVHD_CACHE_SHOW = 0, /* nothing */
    BVHD_CACHE_TRIM = 1, /* removes the least recently used results on disk, until at most `bytes` are left there */
    BVHD_CACHE_CLEAR = 2, /* removes all results, on disk and in memory */
};

/* What the service keeps, on disk and in memory. Later versions of the library may append members. */
struct bvhd_cache_state {
    const char *directory; /* of the results on disk, an absolute path; "": there are none, and the next three are 0 */
    uint64_t entries, bytes, budget; /* results on disk; the bytes of their files, damaged ones included; at most */
    uint64_t memory_entries, memory_bytes, memory_budget; /* the same in memory */
    /* 1: the daemon has read the directory; 0: `entries` and `bytes` are only what it has written itself */
    uint32_t counted;
};

/*
 * Trims or clears the service's caches, and waits for that and for their state afterwards. `bytes` is for
 * BVHD_CACHE_TRIM. Fails as bvhd_client_counters does, and with BVHD_UNSUPPORTED when the daemon keeps nothing on disk
 * that could be trimmed, when it is of a version without this request, and when the caller is neither root nor the user
 * who runs the daemon: only these may trim and clear. BVHD_INVALID is for an action that does not exist. The caller
 * destroys the state with bvhd_cache_state_destroy, which allows NULL.
 */
BVHD_API enum bvhd_status bvhd_client_cache(struct bvhd_client *client, enum bvhd_cache_action action, uint64_t bytes,
                                            int timeout_ms, struct bvhd_cache_state **ret_state,
                                            struct bvhd_error *ret_error);
BVHD_API void bvhd_cache_state_destroy(struct bvhd_cache_state *state);

#ifdef __cplusplus
}
#endif

#endif
