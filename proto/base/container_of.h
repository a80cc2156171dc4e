/* SPDX-License-Identifier: Apache-2.0 */
/*
 * container_of.h - finds the struct in which a given member is embedded.
 *
 * A callback or a list often gets a pointer to one member of a struct, while its owner needs the whole struct.
 */
#ifndef BVHD_CONTAINER_OF_H
#define BVHD_CONTAINER_OF_H

#include <stddef.h>

/*
 * Returns the `type` whose member `member` is at `pointer`, which must not be NULL. The compiler rejects a pointer
 * whose type is not that of the member.
 */
#define container_of(pointer, type, member)                                                                            \
    ((type *)(void *)((char *)(1 ? (pointer) : &((type *)NULL)->member) - offsetof(type, member)))

#endif
