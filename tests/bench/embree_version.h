/* SPDX-License-Identifier: Apache-2.0 */
/* embree_version.h - includes Embree 4, or Embree 3 where there is no 4. */
#ifndef BVHD_BENCH_EMBREE_VERSION_H
#define BVHD_BENCH_EMBREE_VERSION_H

#if defined(__has_include) && __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#endif
