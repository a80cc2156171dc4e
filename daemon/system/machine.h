/* SPDX-License-Identifier: Apache-2.0 */
/* machine.h - what the process may use of the machine that it runs on. */
#ifndef BVHD_MACHINE_H
#define BVHD_MACHINE_H

#include <stdint.h>

/* Bytes of memory: the machine's, or less where a control group of the process has less. */
uint64_t machine_memory(void);

#endif
