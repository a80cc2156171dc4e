/* SPDX-License-Identifier: Apache-2.0 */
/*
 * probe.h - finds out which native format a device loads. The device builds a few tiny structures from geometry that
 * both sides know, and serializes them. If a layout's writer reproduces all of these bytes, that layout is the device's
 * native target. No table of drivers and versions is needed.
 *
 * A probe is the device's answer in one block of documented bytes (FORMATS.md). It can be written to a file and used on
 * machines without the device.
 *
 * The code that probes a device fills the memory of the structures with zeros before it builds, because drivers leave
 * gaps, whose contents are serialized too. It creates structures with exactly the size that the driver requests, and
 * builds them without build flags.
 */
#ifndef BVHD_PROBE_H
#define BVHD_PROBE_H

#include "proto/base/bytes.h"
#include "builder/format/canonical.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

enum { PROBE_NAME_SIZE = 256, PROBE_MAX_STRUCTURE = 1 << 20 };

/* The structures that are built, in this order. probe_request_init describes each of them. */
enum probe_structure {
    PROBE_TRIANGLES, /* a bottom level of two geometries, one opaque and one not */
    PROBE_AABBS, /* a bottom level of boxes */
    /*
     * A top level of two instances, of PROBE_TRIANGLES and PROBE_AABBS. Their flags, masks and matrices are chosen to
     * reveal the layout.
     */
    PROBE_INSTANCES,
    PROBE_COUNT
};

/*
 * The request for one of these structures, as a canonical view over static data: triangles without indices (three
 * packed positions each), boxes of six floats, 64-byte instance records whose reference is the row + 1 of `references`,
 * which for PROBE_INSTANCES are the previous structures in order. The storage belongs to the caller and must not move.
 */
struct probe_request {
    struct canonical canonical; /* without `bytes` */
    struct canonical_geometry geometries[2];
    struct canonical_reference references[PROBE_COUNT];
};
void probe_request_init(struct probe_request *request, enum probe_structure which);

/* The parts of a probe. */
struct probe {
    char device[PROBE_NAME_SIZE]; /* the device's name, for display */
    char driver[PROBE_NAME_SIZE]; /* its driver and version, for display */
    /* The handles that instances name: the addresses of the bottom levels on the device, or numbers in their place. */
    uint64_t handles[PROBE_COUNT];
    struct bytes structures[PROBE_COUNT]; /* the bytes that the device serialized */
};

/* Packs a probe into one block from `memory`, which the caller frees. Fails with BVHD_NO_MEMORY or BVHD_TOO_LARGE. */
enum bvhd_status probe_pack(const struct probe *probe, struct memory *memory, unsigned char **ret_data,
                            uint64_t *ret_size, struct bvhd_error *error);

/* Returns whether the data begin like a probe. */
bool probe_is(struct bytes data);

/*
 * Reads a hostile block: checks that names end in NUL, that sizes fit and that no bytes are left over. The structures
 * point into it. Fails with BVHD_CORRUPT, or with BVHD_INCOMPATIBLE for another version.
 */
enum bvhd_status probe_unpack(struct bytes data, struct probe *ret_probe, struct bvhd_error *error);

/*
 * Finds the native target that reproduces the probe byte for byte. Only the bounds of instances, which every driver
 * rounds in its own way, may differ, by 2^-20 of 1 + their size. Returns BVHD_UNSUPPORTED if no target does, because
 * the device has another layout or the bytes are hostile; the text says how far the nearest target came ("PROBE_AABBS
 * differs at byte 96"). Such a device can load only the portable target. BVHD_NO_MEMORY.
 */
enum bvhd_status probe_match(const struct probe *probe, struct memory *memory, enum target *ret_target,
                             struct device_format *ret_format, struct bvhd_error *error);

#endif
