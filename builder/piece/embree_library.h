/* SPDX-License-Identifier: Apache-2.0 */
/*
 * embree_library.h - Embree's library, loaded at run time, and its device. Nothing links Embree, so programs that never
 * ask for it neither need nor load it.
 */
#ifndef BVHD_EMBREE_LIBRARY_H
#define BVHD_EMBREE_LIBRARY_H

#include "builder/piece/embree_version.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/* The functions that are used, with Embree's own types. */
struct embree_library {
    RTCDevice (*new_device)(const char *config);
    void (*release_device)(RTCDevice device);
    ssize_t (*get_device_property)(RTCDevice device, enum RTCDeviceProperty property);
    enum RTCError (*get_device_error)(RTCDevice device);
    void (*set_memory_monitor)(RTCDevice device, RTCMemoryMonitorFunction monitor, void *user);
    RTCBVH (*new_bvh)(RTCDevice device);
    void (*release_bvh)(RTCBVH bvh);
    void *(*build_bvh)(const struct RTCBuildArguments *arguments);
};

/*
 * Loads the library once. Returns NULL and fills the error with BVHD_UNSUPPORTED if it cannot be loaded or has another
 * major version than the headers of this build. From any thread.
 */
const struct embree_library *embree_library(struct bvhd_error *error);

/*
 * For tests: opens devices with this configuration from now on, a string that lives on; NULL: the one that builds use.
 */
void embree_library_configure(const char *config);

/* For tests, once the library is loaded: this function replaces rtcBuildBVH from now on; NULL: rtcBuildBVH again. */
void embree_library_replace_build(void *(*build_bvh)(const struct RTCBuildArguments *arguments));

/* Returns the device, which is open (embree.h). */
RTCDevice embree_library_device(void);

/*
 * Counts what Embree allocates on the calling thread in `memory` from now on, until the next call with NULL. Where
 * `memory` refuses, Embree fails.
 */
void embree_library_count_in(struct memory *memory);

#endif
