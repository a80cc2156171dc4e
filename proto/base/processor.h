/* SPDX-License-Identifier: Apache-2.0 */
/* processor.h - the processor, for code that runs its own threads. */
#ifndef BVHD_PROCESSOR_H
#define BVHD_PROCESSOR_H

/* Returns how many processors this thread may use; at least 1. */
unsigned processor_count(void);

/* Tells the processor that the thread is spinning in a waiting loop. */
static inline void processor_relax(void)
{
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    __asm__ volatile("yield");
#endif
}

#endif
