/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cutouts.h - generated alpha textures of things that are cut out of a card by alpha: a leaf and a chain-link fence.
 *
 * A texture has size x size texels of one byte, row 0 first, 255 inside and 0 outside; at outlines alpha is the share
 * of the texel that lies inside, as if rendered smoothly. The pictures are the same at any size.
 */
#ifndef BVHD_CUTOUTS_H
#define BVHD_CUTOUTS_H

#include <stddef.h>
#include <stdint.h>

/* Which picture. */
enum cutout {
    CUTOUT_LEAF, /* one leaf with its stalk, which points down to the last row; nothing reaches the other edges */
    CUTOUT_FENCE, /* one mesh of a fence, whose wires are parallel to the diagonals; it repeats */
    CUTOUTS
};

/* Draws a picture to size * size bytes. */
void cutout_draw(enum cutout cutout, uint32_t size, unsigned char *ret_alpha);

/*
 * Draws count x count of them beside each other to a texture of size * size bytes, as in an atlas; leaves are turned
 * by quarters and mirrored, each in its own way. `size` is a multiple of `count`.
 */
void cutout_draw_atlas(enum cutout cutout, uint32_t size, uint32_t count, unsigned char *ret_alpha);

#endif
