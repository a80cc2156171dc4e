/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/seal.h"

#include <errno.h>
#include <fcntl.h>
#include <time.h>

#include "proto/base/clock.h"

int seal_add(int descriptor, int seals)
{
    const double end = clock_ms() + SEAL_PATIENCE_MS;
    int result = fcntl(descriptor, F_ADD_SEALS, seals);
    while (result != 0 && errno == EBUSY && clock_ms() < end) {
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
        result = fcntl(descriptor, F_ADD_SEALS, seals);
    }
    return result;
}
