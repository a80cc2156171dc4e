/* SPDX-License-Identifier: Apache-2.0 */
/*
 * replay.c - runs a fuzz target without libFuzzer: on its samples, on mutations of them, or on files. See usage below
 * and README.md.
 */
#include "tests/fuzz/fuzz.h"

#include <dirent.h>
#include <stdbool.h>
#include <string.h>
#include <sys/stat.h>

#include "tests/support/random.h"

enum { MOST_SAMPLES = 768, MOST_STEPS = 8, STRETCH = 64 };

struct sample {
    uint8_t bytes[FUZZ_ROOM];
    size_t size;
};

static struct sample samples[MOST_SAMPLES];
static uint32_t sample_count;

static int usage(void)
{
    fputs(
        "usage: replay [--mutations N] [--seed S] [--only N] [--verbose] [--write DIR] [FILE | DIR]...\n"
        "Runs the files, or without files the samples and N mutations of them. --only runs only mutation N,\n"
        "--verbose prints the number of each mutation before it runs, and --write writes the samples to a folder, as\n"
        "a corpus for a fuzzer.\n",
        stderr);
    return 2;
}

/* Runs the target on a copy in a block of exactly its size. */
static void run(const uint8_t *bytes, size_t size)
{
    uint8_t *exact = malloc(size ? size : 1);
    if (!exact)
        abort();
    memcpy(exact, bytes, size);
    LLVMFuzzerTestOneInput(exact, size);
    free(exact);
}

static void load_samples(void)
{
    for (uint32_t i = 0; i < MOST_SAMPLES && (samples[i].size = fuzz_sample(i, samples[i].bytes)) > 0; i++)
        sample_count++;
}

static size_t below(struct random *random, size_t count)
{
    return count ? random_next(random) % count : 0;
}

static void overwrite(struct sample *sample, struct random *random)
{
    static const uint64_t values[] = {0,
                                      1,
                                      2,
                                      3,
                                      16,
                                      79,
                                      80,
                                      81,
                                      96,
                                      127,
                                      128,
                                      255,
                                      4095,
                                      4096,
                                      4097,
                                      65535,
                                      65536,
                                      0x7fffffff,
                                      0x80000000u,
                                      UINT32_MAX,
                                      UINT32_MAX - 15,
                                      UINT64_MAX,
                                      UINT64_MAX / 2,
                                      UINT64_MAX - 15,
                                      1000165000};
    uint64_t value = values[below(random, sizeof values / sizeof values[0])];
    size_t width = (size_t)1 << below(random, 4), at = below(random, sample->size);
    if (at + width <= sample->size)
        memcpy(sample->bytes + at, &value, width);
}

static void cut_out(struct sample *sample, struct random *random)
{
    size_t at = below(random, sample->size), size = below(random, STRETCH) + 1;
    size = size < sample->size - at ? size : sample->size - at;
    memmove(sample->bytes + at, sample->bytes + at + size, sample->size - at - size);
    sample->size -= size;
}

/* Inserts some bytes of this sample or of another one at a random place. */
static void put_in(struct sample *sample, struct random *random)
{
    struct sample *from = below(random, 2) ? sample : &samples[below(random, sample_count)];
    uint8_t stretch[STRETCH];
    size_t source = below(random, from->size), size = below(random, STRETCH) + 1, at = below(random, sample->size + 1);
    size = size < from->size - source ? size : from->size - source;
    size = size < FUZZ_ROOM - sample->size ? size : FUZZ_ROOM - sample->size;
    memcpy(stretch, from->bytes + source, size);
    memmove(sample->bytes + at + size, sample->bytes + at, sample->size - at);
    memcpy(sample->bytes + at, stretch, size);
    sample->size += size;
}

static void mutate_once(struct sample *sample, struct random *random)
{
    size_t kind = below(random, 8), at = below(random, sample->size);
    if (sample->size == 0 || kind == 0)
        put_in(sample, random);
    else if (kind == 1)
        cut_out(sample, random);
    else if (kind == 2)
        sample->bytes[at] = (uint8_t)random_next(random);
    else if (kind < 5)
        sample->bytes[at] ^= (uint8_t)(1u << below(random, 8));
    else
        overwrite(sample, random);
}

/* The mutation depends only on the seed and the number. */
static void run_mutation(uint64_t seed, uint64_t number)
{
    static struct sample sample;
    struct random random = {seed * UINT64_C(0x9e3779b97f4a7c15) + number};
    sample = samples[below(&random, sample_count)];
    for (size_t steps = 1 + below(&random, MOST_STEPS); steps > 0; steps--)
        mutate_once(&sample, &random);
    if (below(&random, 16) == 0)
        sample.size = below(&random, sample.size + 1);
    run(sample.bytes, sample.size);
}

static int run_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    struct stat about;
    if (!file || fstat(fileno(file), &about) != 0) {
        perror(path);
        if (file)
            fclose(file);
        return 1;
    }
    uint8_t *bytes = malloc((size_t)about.st_size + 1);
    if (!bytes)
        abort();
    size_t size = fread(bytes, 1, (size_t)about.st_size, file);
    fclose(file);
    run(bytes, size);
    free(bytes);
    return 0;
}

static int run_path(const char *path)
{
    DIR *directory = opendir(path);
    if (!directory)
        return run_file(path);
    int failed = 0;
    for (struct dirent *entry; (entry = readdir(directory));) {
        char name[4096];
        snprintf(name, sizeof name, "%s/%s", path, entry->d_name);
        if (entry->d_name[0] != '.')
            failed |= run_file(name);
    }
    closedir(directory);
    return failed;
}

static int write_samples(const char *folder)
{
    for (uint32_t i = 0; i < sample_count; i++) {
        char name[4096];
        snprintf(name, sizeof name, "%s/sample-%02u", folder, i);
        FILE *file = fopen(name, "wb");
        bool good = file && fwrite(samples[i].bytes, 1, samples[i].size, file) == samples[i].size;
        if (!file || fclose(file) != 0 || !good) {
            perror(name);
            return 1;
        }
    }
    return 0;
}

static void run_all(uint64_t seed, uint64_t mutations, bool verbose)
{
    for (uint32_t i = 0; i < sample_count; i++)
        run(samples[i].bytes, samples[i].size);
    for (uint64_t i = 0; i < mutations; i++) {
        if (verbose)
            fprintf(stderr, "%llu\n", (unsigned long long)i);
        run_mutation(seed, i);
    }
    printf("%u samples, %llu mutations\n", sample_count, (unsigned long long)mutations);
}

int main(int argc, char **argv)
{
    uint64_t mutations = 0, seed = 1, only = UINT64_MAX;
    bool verbose = false;
    int i = 1, failed = 0;
    load_samples();
    for (; i < argc && strncmp(argv[i], "--", 2) == 0; i++) {
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (strcmp(argv[i], "--verbose") == 0) {
            verbose = true;
            continue;
        }
        if (!value)
            return usage();
        if (strcmp(argv[i], "--mutations") == 0)
            mutations = strtoull(value, NULL, 0);
        else if (strcmp(argv[i], "--seed") == 0)
            seed = strtoull(value, NULL, 0);
        else if (strcmp(argv[i], "--only") == 0)
            only = strtoull(value, NULL, 0);
        else if (strcmp(argv[i], "--write") == 0)
            return write_samples(value);
        else
            return usage();
        i++;
    }
    if (only != UINT64_MAX)
        run_mutation(seed, only);
    else if (i == argc)
        run_all(seed, mutations, verbose);
    for (; i < argc; i++)
        failed |= run_path(argv[i]);
    return failed;
}
