/* SPDX-License-Identifier: Apache-2.0 */
/*
 * synthetic_probe.h - probes as devices would make them, without a device, for tests on machines that have none. The
 * layout itself writes the structures, so they prove nothing about drivers.
 */
#ifndef BVHD_TEST_SYNTHETIC_PROBE_H
#define BVHD_TEST_SYNTHETIC_PROBE_H

#include "builder/format/lavapipe.h"

/* Returns the format of such a device: a variant, and UUIDs that begin with `seed`. */
struct device_format synthetic_format(enum lavapipe_variant variant, uint8_t seed);

/* Makes the probe of such a device, one block from `memory`, which the caller frees. Ends the program on failure. */
void synthetic_probe(enum lavapipe_variant variant, uint8_t seed, struct memory *memory, unsigned char **ret_data,
                     uint64_t *ret_size);

#endif
