/* SPDX-License-Identifier: Apache-2.0 */
/*
 * metrics_text.h - the service's counters and latencies as text for monitoring, in the exposition format of Prometheus
 * (version 0.0.4): a line for each value, such as "bvhd_builds_done_total 7". Sums end in _total; latencies are
 * histograms of seconds since the start, by stage. For the loop thread only.
 */
#ifndef BVHD_METRICS_TEXT_H
#define BVHD_METRICS_TEXT_H

#include "proto/base/memory.h"

enum { METRICS_TEXT_SIZE = 64 * 1024 }; /* more than the text can have */

struct service;

/* Returns the text without a NUL, from `memory`, and its size; NULL without memory. */
char *metrics_text(const struct service *service, struct memory *memory, uint64_t *ret_size);

#endif
