/* SPDX-License-Identifier: Apache-2.0 */
/* tracer_query.h - an option of tracers of tracer_query_create: whether their hits name instances. */
#ifndef BVHCTL_TRACER_QUERY_H
#define BVHCTL_TRACER_QUERY_H

#include "client/bvhctl/trace/tracer.h"

/*
 * Sets whether hits name the instance (the default). They must not if the top level was only made for one bottom level.
 */
void tracer_query_set_top(struct tracer *tracer, bool has_top);

#endif
