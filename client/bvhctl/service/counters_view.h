/* SPDX-License-Identifier: Apache-2.0 */
/* counters_view.h - prints a daemon's counters: the figures that matter most for people, and all of them as JSON. */
#ifndef BVHCTL_COUNTERS_VIEW_H
#define BVHCTL_COUNTERS_VIEW_H

#include "bvhd/bvhd.h"
#include "client/bvhctl/base/json.h"

/* Returns the value of a counter, or 0 if this daemon does not have it. */
uint64_t counters_view_value(const struct bvhd_counters *counters, const char *name);

/* Prints a few lines: the daemon, hits, queue, refusals, memory, latencies. */
void counters_view_print(const struct bvhd_counters *counters);

/* Prints a line with what was done in the time between two lists of counters of one daemon. */
void counters_view_print_rates(const struct bvhd_counters *before, const struct bvhd_counters *now);

/* Writes the version, the share of hits, and all counters into the JSON object that is open. */
void counters_view_write(const struct bvhd_counters *counters, struct json *json);

#endif
