/* SPDX-License-Identifier: Apache-2.0 */
/* tracer_query.h - what hits of a tracer of tracer_query_create say of instances. */
#ifndef BVHCTL_TRACER_QUERY_H
#define BVHCTL_TRACER_QUERY_H

#include "client/bvhctl/trace/tracer.h"

/* Whether hits name the instance (the default); without, the top level only stands around one bottom level. */
void tracer_query_set_top(struct tracer *tracer, bool has_top);

#endif
