/* SPDX-License-Identifier: Apache-2.0 */
/*
 * device_format.h - the details of a native format that a target leaves open. A probe finds them
 * (builder/format/probe.h), a build request states them, and they are part of the key. A target that leaves nothing
 * open (portable) has all of them zero.
 */
#ifndef BVHD_DEVICE_FORMAT_H
#define BVHD_DEVICE_FORMAT_H

#include <stdint.h>

/* All fields are part of the key. */
struct device_format {
    uint8_t driver_uuid[16]; /* the first two fields of every structure that the driver serializes */
    uint8_t compatibility_uuid[16];
    uint32_t variant; /* which variant of the target's layout; lavapipe: enum lavapipe_variant */
};

#endif
