/* SPDX-License-Identifier: Apache-2.0 */
/* tracer_portable.h - which of the library's kernels (bvhd_trace.h) a tracer of portable structures runs. */
#ifndef BVHCTL_TRACER_PORTABLE_H
#define BVHCTL_TRACER_PORTABLE_H

#include "client/bvhctl/trace/tracer.h"

enum tracer_way {
    TRACER_WAY_AUTO, /* by the rays of each call */
    TRACER_WAY_QUERY, /* the ray query, which traces every kind of ray */
    TRACER_WAY_COHERENT, /* the kernel for coherent rays */
    TRACER_WAY_INCOHERENT, /* the kernel for incoherent rays */
};

/*
 * For a tracer of tracer_portable_create: from now on it traces that way. Rays with flags, and scenes with AABBs, are
 * traced by the ray query all the same.
 */
void tracer_portable_set_way(struct tracer *tracer, enum tracer_way way);

#endif
