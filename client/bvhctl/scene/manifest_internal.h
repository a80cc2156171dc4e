/* SPDX-License-Identifier: Apache-2.0 */
/* manifest_internal.h - what the files of the module manifest share. */
#ifndef BVHCTL_MANIFEST_INTERNAL_H
#define BVHCTL_MANIFEST_INTERNAL_H

#include "client/bvhctl/scene/manifest.h"

struct cJSON;

/* Reads the options of the build from a parsed manifest. */
struct manifest_options manifest_read_options(const struct cJSON *root);

/*
 * Makes the arrays "nodes" in the structures of a manifest empty, in place, and returns the new size of the text. It
 * may be any text: one that is not JSON stays so.
 */
uint64_t manifest_drop_nodes(char *text, uint64_t size);

/* Write members of a structure: its bounds, which are null if nothing can be hit; the nodes of a top level. */
void manifest_write_bounds(struct json *json, const float bounds[6]);
void manifest_write_nodes(struct json *json, const struct import *import, const struct file_names *names);

#endif
