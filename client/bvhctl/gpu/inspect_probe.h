/* SPDX-License-Identifier: Apache-2.0 */
/* inspect_probe.h - what `bvhctl inspect` says of a probe's file. */
#ifndef BVHCTL_INSPECT_PROBE_H
#define BVHCTL_INSPECT_PROBE_H

#include "bvhd/bvhd.h"
#include "client/bvhctl/base/json.h"
#include "builder/format/probe.h"

struct inspect_probe {
    unsigned char *data; /* from memory */
    uint64_t size;
    struct probe probe; /* over data */
    const char *target; /* what reproduces it; NULL: nothing */
    struct bvhd_format format; /* of that */
    struct bvhd_error why_not;
};

/*
 * BVHD_NOT_FOUND: the file is no probe at all. BVHD_CORRUPT, BVHD_INCOMPATIBLE: not a sound one. End with
 * inspect_probe_close.
 */
enum bvhd_status inspect_probe_open(const char *path, struct memory *memory, struct inspect_probe *ret_probe,
                                    struct bvhd_error *error);
void inspect_probe_close(struct inspect_probe *probe, struct memory *memory);

/* As people write them, with hyphens. */
enum { INSPECT_UUID = 40 };
void inspect_uuid(const uint8_t uuid[16], char ret_text[INSPECT_UUID]);

void inspect_probe_print(const char *path, const struct inspect_probe *probe);
void inspect_probe_write(const char *path, const struct inspect_probe *probe, struct json *json);

#endif
