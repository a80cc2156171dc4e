/* SPDX-License-Identifier: Apache-2.0 */
/*
 * release.h - giving back large files and mappings. The system takes some 50 us for each MiB of a memfd's pages, wherever the last hold on them
 * ends, and that may be the loop: from RELEASE_LATER_MIN bytes on a thread of the module's own does it, a moment later. From any thread.
 */
#ifndef BVHD_RELEASE_H
#define BVHD_RELEASE_H

#include <stdint.h>

enum { RELEASE_LATER_MIN = 1024 * 1024 };

void release_mapping(void *address, uint64_t size);

/* A memfd of `size` bytes. Its count may be given back at once: as long as it is open it lingers (descriptors.h). */
void release_memfd(int descriptor, uint64_t size);

#endif
