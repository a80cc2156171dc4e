/* SPDX-License-Identifier: Apache-2.0 */
/* capture_log.h - reads what log_event has written, by redirecting stderr to a file. For tests of the daemon. */
#ifndef BVHD_TEST_CAPTURE_LOG_H
#define BVHD_TEST_CAPTURE_LOG_H

#include <sys/mman.h>
#include <unistd.h>

#include "tests/support/unit.h"

enum { CAPTURE_SIZE = 8192 };

struct capture {
    int file, kept;
};

static inline struct capture capture_begin(void)
{
    struct capture capture = {memfd_create("log", MFD_CLOEXEC), dup(STDERR_FILENO)};
    assert_true(capture.file >= 0 && capture.kept >= 0 && dup2(capture.file, STDERR_FILENO) >= 0);
    return capture;
}

/* Ends the redirection, and fills ret_text with what was written: the beginning, if there is more. */
static inline void capture_end(struct capture *capture, char ret_text[CAPTURE_SIZE])
{
    dup2(capture->kept, STDERR_FILENO);
    ssize_t size = pread(capture->file, ret_text, CAPTURE_SIZE - 1, 0);
    assert_true(size >= 0);
    ret_text[size] = 0;
    close(capture->file);
    close(capture->kept);
}

#endif
