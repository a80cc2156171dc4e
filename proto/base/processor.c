/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/processor.h"

#include <sched.h>
#include <unistd.h>

unsigned processor_count(void)
{
    cpu_set_t set;
    long count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : sysconf(_SC_NPROCESSORS_ONLN);
    return count < 1 ? 1 : (unsigned)count;
}
