/* SPDX-License-Identifier: Apache-2.0 */
/*
 * commands.h - one function for each command of bvhctl. It takes the parsed command line, prints everything that the
 * user is to see and returns the exit code.
 */
#ifndef BVHCTL_COMMANDS_H
#define BVHCTL_COMMANDS_H

#include "client/bvhctl/base/options.h"
#include "client/bvhctl/base/report.h"

enum exit_code command_build(const struct options *options);
enum exit_code command_cache(const struct options *options);
enum exit_code command_update(const struct options *options);
enum exit_code command_check(const struct options *options);
enum exit_code command_inspect(const struct options *options);
enum exit_code command_trace(const struct options *options);
enum exit_code command_copy(const struct options *options);
enum exit_code command_query(const struct options *options);
enum exit_code command_get(const struct options *options);
enum exit_code command_stats(const struct options *options);
enum exit_code command_clients(const struct options *options);
enum exit_code command_top(const struct options *options);
enum exit_code command_ping(const struct options *options);
enum exit_code command_stop(const struct options *options);
enum exit_code command_devices(const struct options *options);
enum exit_code command_probe(const struct options *options);

/*
 * Prints what may follow on a command line, whose last word is not complete, for the completions of shells. Devices are
 * looked for only if one is to be named.
 */
enum exit_code command_complete(int count, char *const *words);

#endif
