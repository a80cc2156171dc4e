/* SPDX-License-Identifier: Apache-2.0 */
/* command_trace.h - `bvhctl trace` with any tracer: what commands.h offers takes tracer_choose. */
#ifndef BVHCTL_COMMAND_TRACE_H
#define BVHCTL_COMMAND_TRACE_H

#include "client/bvhctl/base/options.h"
#include "client/bvhctl/base/report.h"
#include "client/bvhctl/trace/tracer_choice.h"

/* `choose` gets the device that the options name. */
enum exit_code command_trace_by(const struct options *options, tracer_chooser choose);

#endif
