/* SPDX-License-Identifier: Apache-2.0 */
/*
 * probe.h - finding out what a device loads. The device builds a few tiny structures from geometry that both sides
 * know, and serializes them; a layout whose writer reproduces all of these bytes is the device's native target. No
 * table of drivers and versions is needed.
 *
 * A probe is what the device gave, in one block of documented bytes (FORMATS.md): it can be written to a file and taken
 * to machines without the device.
 *
 * Who asks a device fills the memory of the structures with zeros before it builds: drivers leave gaps, and what lies
 * there is serialized too. Structures are created with exactly the size that the driver asks for, and built without
 * build flags.
 */
#ifndef BVHD_PROBE_H
#define BVHD_PROBE_H

#include "proto/base/bytes.h"
#include "builder/format/canonical.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

enum { PROBE_NAME_SIZE = 256, PROBE_MAX_STRUCTURE = 1 << 20 };

/* What is built, in this order. Each is described by probe_input. */
enum probe_structure {
    PROBE_TRIANGLES, /* a bottom level of two geometries, opaque and not */
    PROBE_AABBS, /* a bottom level of boxes */
    /*
     * a top level of two instances: of PROBE_TRIANGLES and PROBE_AABBS, with flags, masks and matrices that tell much
     */
    PROBE_INSTANCES,
    PROBE_COUNT
};

/*
 * What each of them is built from, as a canonical view over static data: triangles without indices (three packed
 * positions each), boxes of six floats, 64-byte instance records whose reference is the row + 1 of `references`, which
 * for PROBE_INSTANCES are the structures before it in order. The storage is the caller's and must stay where it is.
 */
struct probe_request {
    struct canonical canonical; /* without `bytes` */
    struct canonical_geometry geometries[2];
    struct canonical_reference references[PROBE_COUNT];
};
void probe_request_init(struct probe_request *request, enum probe_structure which);

/* A probe's parts. */
struct probe {
    char device[PROBE_NAME_SIZE]; /* the device's name, for people */
    char driver[PROBE_NAME_SIZE]; /* its driver and version, for people */
    uint64_t handles
        [PROBE_COUNT]; /* what instances name: the addresses of the bottom levels on the device, or numbers in their place */
    struct bytes structures[PROBE_COUNT]; /* as the device serialized them */
};

/* One block from `memory`; the caller frees it. BVHD_NO_MEMORY, BVHD_TOO_LARGE. */
enum bvhd_status probe_pack(const struct probe *probe, struct memory *memory, unsigned char **ret_data,
                            uint64_t *ret_size, struct bvhd_error *error);

/* Whether it begins as one. */
bool probe_is(struct bytes data);

/*
 * Reads a hostile block: names end, sizes fit, nothing is left over. Structures point into it. BVHD_CORRUPT,
 * BVHD_INCOMPATIBLE (another version).
 */
enum bvhd_status probe_unpack(struct bytes data, struct probe *ret_probe, struct bvhd_error *error);

/*
 * The native target that reproduces the probe, byte for byte; of the bounds of instances, which are everybody's own
 * rounding, to 2^-20 of 1 + their size. BVHD_UNSUPPORTED when none does: the text says how far the nearest one came
 * ("PROBE_AABBS differs at byte 96"), be it another layout or hostile bytes; such a device takes the portable target
 * alone. BVHD_NO_MEMORY.
 */
enum bvhd_status probe_match(const struct probe *probe, struct memory *memory, enum target *ret_target,
                             struct device_format *ret_format, struct bvhd_error *error);

#endif
