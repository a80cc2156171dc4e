/* SPDX-License-Identifier: Apache-2.0 */
/*
 * container_of.h - from a member back to the struct that it is embedded in.
 *
 * A callback or a list often gets a pointer to one member of a struct, and its owner needs the whole struct.
 */
#ifndef BVHD_CONTAINER_OF_H
#define BVHD_CONTAINER_OF_H

#include <stddef.h>

/*
 * The `type` whose member `member` is at `pointer`, which must not be NULL. The compiler rejects a pointer of another
 * type than the member's.
 */
#define container_of(pointer, type, member)                                                                            \
    ((type *)(void *)((char *)(1 ? (pointer) : &((type *)NULL)->member) - offsetof(type, member)))

#endif
