/* SPDX-License-Identifier: Apache-2.0 */
/* local_library.h - loads the library of the builder (builder/local) into the program's process. */
#ifndef BVHD_LOCAL_LIBRARY_H
#define BVHD_LOCAL_LIBRARY_H

#include "builder/local/build_library.h"

/*
 * Returns the functions of the library. The first call that succeeds loads it, for the rest of the process's life; one
 * that fails is tried again by the next call. It is looked for beside libbvhd, unless that is linked into the program,
 * and then by its name where the system looks for libraries. May be called from any thread.
 *
 * BVHD_UNSUPPORTED: it cannot be loaded, for the reasons in the text. BVHD_INCOMPATIBLE: it has another version than
 * this libbvhd.
 */
enum bvhd_status local_library_load(const struct build_library **ret_library, struct bvhd_error *error);

#endif
