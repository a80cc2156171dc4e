/* SPDX-License-Identifier: Apache-2.0 */
#include "client/result_summary.h"

#include <string.h>

void result_summary_copy(const struct summary *summary, struct bvhd_result *result)
{
    result->primitives = summary->primitives;
    result->triangles = summary->triangles;
    result->instances = summary->instances;
    result->inactive = summary->inactive;
    result->degenerate = summary->degenerate;
    result->skipped = summary->skipped;
    result->refs = summary->refs;
    result->peak_bytes = summary->peak_bytes;
    result->depth = summary->depth;
    result->sah = summary->sah;
    result->original_build_ms = summary->build_ms;
    result->method = summary->method;
    memcpy(result->bounds, &summary->bounds, sizeof result->bounds);
    memcpy(result->slabs, &summary->slabs, sizeof result->slabs);
    result->target = (enum bvhd_target)summary->target;
    result->quality = (enum bvhd_quality)summary->quality;
    result->decay = summary->decay;
    result->refits = summary->refits;
}
