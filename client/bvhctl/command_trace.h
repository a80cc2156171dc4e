/* SPDX-License-Identifier: Apache-2.0 */
/*
 * command_trace.h - `bvhctl trace` with a tracer of the caller's choice, for tests. command_trace() of commands.h is
 * the same with tracer_choose.
 */
#ifndef BVHCTL_COMMAND_TRACE_H
#define BVHCTL_COMMAND_TRACE_H

#include "client/bvhctl/base/options.h"
#include "client/bvhctl/base/report.h"
#include "client/bvhctl/trace/tracer_choice.h"

/* Calls `choose` with the device that the options name. */
enum exit_code command_trace_by(const struct options *options, tracer_chooser choose);

#endif
