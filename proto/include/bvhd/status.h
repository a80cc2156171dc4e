/* SPDX-License-Identifier: Apache-2.0 */
/*
 * status.h - status numbers and errors: how every part of bvhd reports that something failed.
 *
 * The numbers are wire ABI: they never change, and a number is never used again with another meaning. An error is a
 * plain value of fixed size: it can be copied, stored and sent, and owns nothing.
 */
#ifndef BVHD_PUBLIC_STATUS_H
#define BVHD_PUBLIC_STATUS_H

#include "vuid.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The outcome of a call or of a build. */
enum bvhd_status {
    BVHD_OK = 0,
    BVHD_INVALID = 1, /* a rule is broken; the error names the rule and the place */
    BVHD_UNSUPPORTED = 2, /* a valid request for something that this version or this machine does not provide */
    BVHD_TOO_LARGE = 3, /* over an announced limit */
    BVHD_NO_MEMORY = 4, /* the memory budget or the machine's memory is used up */
    BVHD_CANCELLED = 5, /* the requester does not want the result any more */
    BVHD_CORRUPT = 6, /* bytes (a blob, a frame, a file) contradict their header */
    BVHD_NOT_FOUND = 7, /* there is no such key, file or structure */
    BVHD_BUSY = 8, /* queues are full; try again later */
    BVHD_UNAVAILABLE = 9, /* no daemon answers */
    BVHD_INCOMPATIBLE = 10, /* made for another target, driver or version */
    BVHD_IO = 11, /* the operating system refused; the text says what */
    BVHD_INTERNAL = 12, /* a defect of bvhd itself */
    BVHD_PENDING = 13, /* no failure: the result is not there yet */
    BVHD_SOURCE_LOST = 14, /* what is to be updated is not there any more: build it again */
    BVHD_STATUS_COUNT
};

/* Bytes of an error's texts, the final NUL included. */
enum { BVHD_WHERE_SIZE = 120, BVHD_TEXT_SIZE = 200 };

/* An error: its status, the rule that was broken, the place, and the reason. */
struct bvhd_error {
    enum bvhd_status status;
    enum bvhd_vuid vuid; /* BVHD_VUID_NONE if the rule is not one of Vulkan's */
    /* The place, a path such as "infos[2].geometries[3].triangles.vertexStride". It may be "". */
    char where[BVHD_WHERE_SIZE];
    char text[BVHD_TEXT_SIZE]; /* the reason, in words, without a newline */
};

/*
 * Returns the name "INVALID", "TOO_LARGE", ... as a static string; "UNKNOWN" for a number that this version does not
 * know.
 */
BVHD_API const char *bvhd_status_name(enum bvhd_status status);

#ifdef __cplusplus
}
#endif

#endif
