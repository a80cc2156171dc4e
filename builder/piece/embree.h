/* SPDX-License-Identifier: Apache-2.0 */
/*
 * embree.h - builds a piece's tree by Embree's rtcBuildBVH, for requests that name Embree as their builder.
 *
 * Embree is a library of others, which aborts the process on input that it does not expect, cannot be stopped, and
 * starts threads of its own. So it gets small pieces, one call each on the calling thread: a build can be cancelled
 * between them, and none is large enough for the parallel parts of Embree, whose results depend on the number of
 * threads. Each piece is moved to the origin and scaled to magnitudes of about 1. Embree decides which refs belong
 * together; the boxes of the tree are made from the refs themselves, and are exact.
 *
 * The library is loaded when it is first needed, by the name that the headers of the build imply (libembree3.so.3 or
 * libembree4.so.4), and stays loaded. A build without Embree's headers contains embree_absent.c instead, whose
 * functions refuse.
 */
#ifndef BVHD_EMBREE_H
#define BVHD_EMBREE_H

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "builder/kernel/primitive_ref.h"

/*
 * The most refs of a piece without splits, and with splits before it is split. Embree works in parallel from 3,072 refs
 * on; with splits it needs some 2 ms for 256.
 */
enum { EMBREE_PIECE_MOST = 3071, EMBREE_SPLIT_PIECE_MOST = 256 };

enum embree_quality { EMBREE_LOW, EMBREE_MEDIUM, EMBREE_HIGH };

/*
 * Names what decides Embree's trees beside its input, for keys. `estimate` is a digest of the processor's reciprocal
 * estimate, which differs between makers of processors: the Morton codes of quality LOW depend on it. Which instruction
 * set Embree chooses does not matter, because rtcBuildBVH exists once, for the processors' common one.
 */
struct embree_identity {
    uint32_t version; /* 31305 is 3.13.5 */
    uint32_t estimate;
};

/*
 * Loads Embree if that has not been done, and returns what it is. Returns BVHD_UNSUPPORTED, with "build.builder" as
 * the place and the reason, if there is none. May be called from any thread.
 */
enum bvhd_status embree_identify(struct embree_identity *ret_identity, struct bvhd_error *error);

/*
 * Opens Embree's device for builds, and closes it after the last of them. While it is open, Embree uses no threads of
 * its own, and the process's other users of TBB are limited to one thread as well, unless they have an open device of
 * Embree with more. embree_open fails as embree_identify does, and with BVHD_NO_MEMORY. From any thread, any number of
 * times.
 */
enum bvhd_status embree_open(struct bvhd_error *error);
void embree_close(void);

struct embree_request {
    enum embree_quality quality;
    /* used when capacity > count, which only EMBREE_HIGH allows: clip_allowed holds, and the refs are its triangles */
    const struct canonical *canonical;
    const struct primitive_ref *refs; /* `count`, none of them a run */
    struct primitive_ref *scratch; /* room for `capacity`; its contents afterwards have no meaning */
    uint32_t count, capacity; /* 1 <= count <= capacity; count is at most one of the constants above */
    uint32_t leaf_max; /* 1 .. 31 */
};

/*
 * Builds the tree, between embree_open and embree_close. Magnitudes are at most 2^40. *ret_ir is allocated from
 * `memory`, in which Embree's own memory counts too; the caller ends it with ir_finish. No leaf, and no subtree of at
 * most leaf_max refs, names a primitive twice. Returns BVHD_NO_MEMORY, or BVHD_INTERNAL if Embree fails otherwise.
 */
enum bvhd_status embree_build(const struct embree_request *request, struct memory *memory, struct ir *ret_ir,
                              struct bvhd_error *error);

#endif
