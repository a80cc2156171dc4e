/* SPDX-License-Identifier: Apache-2.0 */
/* connections_view.h - prints who is connected to a daemon and what each client holds: as a table, or as JSON. */
#ifndef BVHCTL_CONNECTIONS_VIEW_H
#define BVHCTL_CONNECTIONS_VIEW_H

#include "bvhd/bvhd.h"
#include "client/bvhctl/base/json.h"

/*
 * Prints a table with `most` rows at most: those first for which most threads work, and of these the ones with most
 * under way and most memory. Lines below it say how many connections are left out, and why.
 */
void connections_view_print(const struct bvhd_connections *connections, uint32_t most);

/* Writes the members "total", "hidden" and "clients" into the JSON object that is open. */
void connections_view_write(const struct bvhd_connections *connections, struct json *json);

#endif
