/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/morton.h"

#include "builder/kernel/bins.h"

enum { AXIS_BITS = 8, CELLS = 1 << AXIS_BITS, DIGIT_BITS = 12, DIGITS = 1 << DIGIT_BITS, PASSES = 2 };

/* Spreads eight bits of each lane, so that two zeros follow each bit. */
static inline vec4_int spread(vec4_int bits)
{
    bits = (bits | bits << 8) & 0x00f00f;
    bits = (bits | bits << 4) & 0x0c30c3;
    return (bits | bits << 2) & 0x249249;
}

static inline uint32_t digit(uint32_t code, int pass)
{
    return code >> (pass * DIGIT_BITS) & (DIGITS - 1);
}

static float cells_per_unit(const struct vec4_box *centroids)
{
    vec4 size = centroids->max - centroids->min;
    float longest = size[0] > size[1] ? size[0] : size[1];
    longest = size[2] > longest ? size[2] : longest;
    float scale = ((float)CELLS - 0.5f) / longest;
    return longest > 0 && scale <= FLT_MAX ? scale : 0;
}

/* Computes the codes of all refs, and how often each digit occurs in each pass. */
static void encode(const struct primitive_ref *refs, uint32_t count, struct morton_key *keys,
                   uint32_t histograms[PASSES][DIGITS])
{
    const struct vec4_box centroids = bins_centroids(refs, count);
    vec4 scale = vec4_all(cells_per_unit(&centroids));
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]);
        vec4_int cell = __builtin_convertvector(vec4_xyz(box.min + box.max - centroids.min) * scale, vec4_int);
        cell = spread(cell);
        uint32_t code = (uint32_t)cell[0] | (uint32_t)cell[1] << 1 | (uint32_t)cell[2] << 2;
        keys[i] = (struct morton_key){code, i};
        for (int pass = 0; pass < PASSES; pass++)
            histograms[pass][digit(code, pass)]++;
    }
}

void morton_sort(const struct primitive_ref *refs, uint32_t count, struct morton_key *keys,
                 struct primitive_ref *ret_sorted)
{
    uint32_t histograms[PASSES][DIGITS] = {{0}};
    struct morton_key *from = keys, *to = keys + count;
    encode(refs, count, from, histograms);
    for (int pass = 0; pass < PASSES; pass++) {
        uint32_t *places = histograms[pass], sum = 0;
        for (int i = 0; i < DIGITS; i++) {
            uint32_t here = places[i];
            places[i] = sum;
            sum += here;
        }
        for (uint32_t i = 0; i < count; i++)
            to[places[digit(from[i].code, pass)]++] = from[i];
        struct morton_key *swap = from;
        from = to;
        to = swap;
    }
    for (uint32_t i = 0; i < count; i++)
        vec4_box_store(&ret_sorted[i], vec4_box_load(&refs[from[i].ref]));
}
