/* SPDX-License-Identifier: Apache-2.0 */
/*
 * generation.h - which builds of bvhd share results on disk.
 *
 * All releases share "release-1": the key of a result covers everything that decides its bytes, BUILD_VERSION and the
 * layout's version included (content_key.h), so a result that an older release has written is the same, and an upgrade
 * keeps the cache. The number is for a change of what the entries of a key say about it.
 *
 * A development build is one whose bytes may differ while its versions do not. It has a generation of its own,
 * "development-" and a hash of the compiled builder: builds of equal code share results, others do not. Meson makes a
 * development build of a git checkout, and a release of sources without .git; its option `development` overrides that.
 */
#ifndef BVHD_GENERATION_H
#define BVHD_GENERATION_H

/* Returns the generation of this build, for store_options. */
const char *store_generation(void);

#endif
