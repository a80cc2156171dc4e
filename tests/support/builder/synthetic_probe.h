/* SPDX-License-Identifier: Apache-2.0 */
/*
 * synthetic_probe.h - probes as devices would give them, without a device: for tests on machines that have none. The
 * structures are written by the layout itself, so they say nothing about drivers.
 */
#ifndef BVHD_TEST_SYNTHETIC_PROBE_H
#define BVHD_TEST_SYNTHETIC_PROBE_H

#include "builder/format/lavapipe.h"

/* The format that the device has: a variant, and UUIDs that begin with `seed`. */
struct device_format synthetic_format(enum lavapipe_variant variant, uint8_t seed);

/* The probe of such a device, one block from `memory`; the caller frees it. Ends the program when something fails. */
void synthetic_probe(enum lavapipe_variant variant, uint8_t seed, struct memory *memory, unsigned char **ret_data,
                     uint64_t *ret_size);

#endif
