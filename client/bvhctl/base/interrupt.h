/* SPDX-License-Identifier: Apache-2.0 */
/*
 * interrupt.h - lets SIGINT, SIGTERM and SIGHUP end bvhctl without leaving a half-written file.
 *
 * The handler removes the temporary file that is being written, says that the command was interrupted, and raises the
 * signal again with its default action, so that the parent sees a process that the signal has ended. Structures that a
 * daemon is building for this process are cancelled by the daemon, which notices that the connection ends.
 */
#ifndef BVHCTL_INTERRUPT_H
#define BVHCTL_INTERRUPT_H

#include <stdbool.h>

/*
 * Installs the handler, for signals that the parent does not let this process ignore. `command` is for the message.
 * With `json`, an error object is printed to stdout, too, unless interrupt_output_begins() was called. Call it once,
 * from the main thread, and write files from this thread only.
 */
void interrupt_watch(const char *command, bool json);

/* Tells the handler that stdout gets the result now, so that no error object may follow. */
void interrupt_output_begins(void);

/*
 * Names the file that the handler removes: call it before the file is created. NULL: there is none any more. A path of
 * PATH_MAX bytes or more is not removed.
 */
void interrupt_removes(const char *path);

#endif
