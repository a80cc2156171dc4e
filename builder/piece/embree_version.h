/* SPDX-License-Identifier: Apache-2.0 */
/*
 * embree_version.h - includes the headers of Embree 4, or of Embree 3 where there is no 4. Only this file includes
 * them; it serves the builder (embree.h) and the benchmarks that compare with Embree.
 */
#ifndef BVHD_EMBREE_VERSION_H
#define BVHD_EMBREE_VERSION_H

#if defined(__has_include) && __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#endif
