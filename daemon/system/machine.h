/* SPDX-License-Identifier: Apache-2.0 */
/* machine.h - how much of the machine's resources the process is allowed to use. */
#ifndef BVHD_MACHINE_H
#define BVHD_MACHINE_H

#include <stdint.h>

/* Returns the bytes of memory of the machine, or the least limit of the process's control groups if that is less. */
uint64_t machine_memory(void);

#endif
