/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/counters.h"

#include "proto/wire/control.h"

/* The names in the form of the message, so that filling it is a copy. */
static const struct control_counter names[] = {
#define COUNTER(name) {#name, 0},
    COUNTERS(COUNTER)
#undef COUNTER
};

enum { COUNT = sizeof names / sizeof *names };

_Static_assert(sizeof(struct counters) == COUNT * sizeof(uint64_t), "counters are an array of numbers");

enum bvhd_status counters_pack(const struct counters *counters, struct memory *memory, struct bytes *ret_bytes,
                               struct bvhd_error *error)
{
    struct control_counter list[COUNT];
    uint64_t values[COUNT];
    memcpy(list, names, sizeof list);
    memcpy(values, counters, sizeof values);
    for (int i = 0; i < COUNT; i++)
        list[i].value = values[i];
    struct control_counters message = {COUNT, list, BVHD_DAEMON_VERSION};
    return control_pack_counters(&message, memory, ret_bytes, error);
}
