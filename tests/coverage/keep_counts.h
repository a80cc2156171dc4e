/* SPDX-License-Identifier: Apache-2.0 */
/*
 * keep_counts.h - keeps what processes that end by _exit have executed, because gcc's --coverage writes counts when
 * processes end by exit. The step `coverage` of ./check includes it at the head of each source. It includes no header,
 * so that nothing is declared that the source does not include itself.
 */
#ifndef TESTS_KEEP_COUNTS_H
#define TESTS_KEEP_COUNTS_H

void __gcov_dump(void);
_Noreturn void _Exit(int status);

static inline _Noreturn void keep_counts_and_exit(int status)
{
    __gcov_dump();
    _Exit(status);
}

#define _exit keep_counts_and_exit

#endif
