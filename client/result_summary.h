/* SPDX-License-Identifier: Apache-2.0 */
/* result_summary.h - shows programs the summary of a structure, in the fields of their result. */
#ifndef BVHD_RESULT_SUMMARY_H
#define BVHD_RESULT_SUMMARY_H

#include "bvhd/bvhd.h"
#include "proto/base/summary.h"

/* Sets the fields that the summary has, and no other. result->method is then the text in *summary itself. */
void result_summary_copy(const struct summary *summary, struct bvhd_result *result);

#endif
