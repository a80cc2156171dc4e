/* SPDX-License-Identifier: Apache-2.0 */
/* inspect_probe.h - reads a probe's file for `bvhctl inspect`, and prints what it contains. */
#ifndef BVHCTL_INSPECT_PROBE_H
#define BVHCTL_INSPECT_PROBE_H

#include "bvhd/bvhd.h"
#include "client/bvhctl/base/json.h"
#include "builder/format/probe.h"

struct inspect_probe {
    unsigned char *data; /* the file; owned */
    uint64_t size;
    struct probe probe; /* points into `data` */
    const char *target; /* the name of the target that the device loads; NULL: none that is known */
    struct bvhd_format format; /* of that target */
    struct bvhd_error why_not; /* without a target: the reason */
};

/*
 * Reads the file, which is hostile. BVHD_NOT_FOUND: the file is not a probe. BVHD_CORRUPT, BVHD_INCOMPATIBLE: it is a
 * probe with an error, or one of another version. End with inspect_probe_close.
 */
enum bvhd_status inspect_probe_open(const char *path, struct memory *memory, struct inspect_probe *ret_probe,
                                    struct bvhd_error *error);
void inspect_probe_close(struct inspect_probe *probe, struct memory *memory);

enum { INSPECT_UUID = 40 };
/* Writes a UUID in the usual form, with hyphens. */
void inspect_uuid(const uint8_t uuid[16], char ret_text[INSPECT_UUID]);

/* Print what the file contains: as lines on stdout, or as members of the JSON object that is open. */
void inspect_probe_print(const char *path, const struct inspect_probe *probe);
void inspect_probe_write(const char *path, const struct inspect_probe *probe, struct json *json);

#endif
