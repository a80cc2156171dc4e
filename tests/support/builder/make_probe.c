/* SPDX-License-Identifier: Apache-2.0 */
/* make_probe.c - writes the probe of a device that does not exist (synthetic_probe.h): make_probe VARIANT SEED FILE */
#include <stdio.h>
#include <stdlib.h>

#include "tests/support/builder/synthetic_probe.h"

int main(int argc, char **argv)
{
    struct memory memory;
    unsigned char *data;
    uint64_t size;
    if (argc != 4) {
        fprintf(stderr, "make_probe VARIANT SEED FILE\n");
        return 2;
    }
    memory_init(&memory, UINT64_MAX);
    synthetic_probe((enum lavapipe_variant)atoi(argv[1]), (uint8_t)atoi(argv[2]), &memory, &data, &size);
    FILE *file = fopen(argv[3], "wb");
    bool written = file && fwrite(data, 1, size, file) == size;
    written &= file && fclose(file) == 0;
    memory_free(&memory, data);
    if (!written)
        perror(argv[3]);
    return written ? 0 : 1;
}
