/* SPDX-License-Identifier: Apache-2.0 */
/* seal.h - seals of a memfd, in spite of what holds its pages for a moment. */
#ifndef BVHD_SEAL_H
#define BVHD_SEAL_H

/*
 * Adds F_SEAL_ flags. F_SEAL_WRITE is refused with EBUSY while anybody maps the file for writing or holds one of its
 * pages, as the kernel itself does when it moves memory about on a busy machine: it is tried again for about
 * SEAL_PATIENCE_MS. 0, or -1 with errno. Any thread.
 */
enum { SEAL_PATIENCE_MS = 500 };
int seal_add(int descriptor, int seals);

#endif
