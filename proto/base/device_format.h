/* SPDX-License-Identifier: Apache-2.0 */
/*
 * device_format.h - what a device's driver loads, as far as a target leaves it open: found by a probe (format/probe.h),
 * asked for by a build, part of the key. A target that leaves nothing open (portable) has it all zero.
 */
#ifndef BVHD_DEVICE_FORMAT_H
#define BVHD_DEVICE_FORMAT_H

#include <stdint.h>

struct device_format {
    uint8_t driver_uuid[16]; /* the first two fields of every structure that the driver serializes */
    uint8_t compatibility_uuid[16];
    uint32_t variant; /* of the target's layout; lavapipe: enum lavapipe_variant */
};

#endif
