/* SPDX-License-Identifier: Apache-2.0 */
/* seal.h - adds seals to a memfd, and retries while its pages are in use for a moment. */
#ifndef BVHD_SEAL_H
#define BVHD_SEAL_H

/*
 * Adds F_SEAL_ flags. The kernel refuses F_SEAL_WRITE with EBUSY while a process maps the file for writing or a page is
 * referenced, which the kernel itself does when it migrates memory on a busy machine. Therefore the call tries again
 * for about SEAL_PATIENCE_MS. Returns 0, or -1 with errno. May be called from any thread.
 */
enum { SEAL_PATIENCE_MS = 500 };
int seal_add(int descriptor, int seals);

#endif
