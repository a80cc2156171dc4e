/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cell.h - one method and one scene in a process of their own, because some methods abort, hang or take all memory on
 * some scenes.
 *
 * The process is this program again, with `--cell`.
 */
#ifndef BVHD_BENCH_CELL_H
#define BVHD_BENCH_CELL_H

#include "tests/bench/bvhd_bench/verdicts.h"

struct cell_request {
    const char *method;
    const char *scene; /* a file, or a generated one's name */
    uint32_t size, rays; /* of a generated scene; rays 0: it is built only */
    uint64_t seed;
    double seconds; /* after which the process is ended */
};

enum cell_outcome { CELL_DONE, CELL_REFUSED, CELL_CRASHED, CELL_HUNG };

struct cell_result {
    enum cell_outcome outcome;
    int signal; /* CELL_CRASHED: by which, or 0 */
    char failure[360]; /* CELL_REFUSED */
    double ms; /* of the build */
    uint64_t peak_bytes; /* most resident memory beyond what was there before the build */
    double sah; /* 0: it has no tree */
    double mrays_s; /* closest hits, the same rays */
    struct verdicts verdicts;
};

const char *cell_outcome_name(enum cell_outcome outcome);

/* Runs it in a process of its own. False, and a line on stderr, when none can be started. */
bool cell_run(const struct cell_request *request, struct cell_result *ret_result);

/* What `--cell METHOD SCENE SIZE SEED RAYS` does: the result's bytes go to the descriptor. An exit status. */
int cell_main(char **arguments, int descriptor);

#endif
