/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cell.h - measures one method on one scene in a separate process, because some methods abort, hang or take all memory
 * on some scenes.
 *
 * The process runs this same program with `--cell`.
 */
#ifndef BVHD_BENCH_CELL_H
#define BVHD_BENCH_CELL_H

#include "tests/bench/bvhd_bench/verdicts.h"

struct cell_request {
    const char *method;
    const char *scene; /* a file, or the name of a generated scene */
    /* size: triangles of a generated scene. rays: how many are compared with brute force; 0: the scene is only built */
    uint32_t size, rays;
    uint64_t seed;
    double seconds; /* time limit, after which the process is killed */
};

enum cell_outcome { CELL_DONE, CELL_REFUSED, CELL_CRASHED, CELL_HUNG };

struct cell_result {
    enum cell_outcome outcome;
    int signal; /* CELL_CRASHED: the signal that ended the process, or 0 */
    char failure[360]; /* CELL_REFUSED: the reason */
    double ms; /* time of the build */
    uint64_t peak_bytes; /* growth of peak resident memory over what was resident before the build */
    double sah; /* 0: the method has no tree */
    double mrays_s; /* million closest-hit rays a second, over the rays of the trial */
    struct verdicts verdicts;
};

const char *cell_outcome_name(enum cell_outcome outcome);

/*
 * Runs the request in a separate process and waits for it. Returns false, with a line on stderr, when no process can be
 * started.
 */
bool cell_run(const struct cell_request *request, struct cell_result *ret_result);

/*
 * Implements `--cell METHOD SCENE SIZE SEED RAYS`: writes the bytes of the result to the descriptor. Returns an exit
 * status.
 */
int cell_main(char **arguments, int descriptor);

#endif
