/* SPDX-License-Identifier: Apache-2.0 */
/* import_hash.h - a number by which two imports of a file are compared. */
#ifndef BVHCTL_IMPORT_HASH_H
#define BVHCTL_IMPORT_HASH_H

#include "client/bvhctl/scene/import.h"

/* Returns a hash of everything that builds, pictures and messages take from an import. It is not stored anywhere. */
uint64_t import_hash(const struct import *import);

#endif
